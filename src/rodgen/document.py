"""What a result says, as a list of blocks, and how a terminal, a notebook and a page show them.

Numbers in blocks are text already, so that no two places can show different digits of one number.
"""

from __future__ import annotations

import base64
import html
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

WIDTH = 100
"""Characters of a line of text."""
LABEL = 13
"""Characters of the names of facts in text."""
MANY = 6
"""Columns from which on a narrow page shows the rows of a table as cells with their names."""


@dataclass(frozen=True)
class Paragraph:
    """One or more sentences; of kind "line" they stand on one line in text, however long it is."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Facts:
    """Names with what there is to say of each; facts without text are left out."""

    rows: Sequence[tuple[str, str]]
    title: str = ""
    kind: str = ""

    @property
    def said(self) -> list[tuple[str, str]]:
        """The rows that have a text."""
        return [(name, text) for name, text in self.rows if text]


@dataclass(frozen=True)
class Table:
    """A table, which may have no header.

    Attributes
    ----------
    header : sequence of str
    rows : sequence of sequence of str
    align : str
        A letter a column: "l" left, "r" right, "b" right, and a bar of so many per cent; "l" where there is none.
    title : str
    most : int
        Rows that are shown at once; 0: all.
    more : str
        What text calls the others.
    kind : str
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    align: str = ""
    title: str = ""
    most: int = 0
    more: str = "more"
    kind: str = ""

    @property
    def further(self) -> int:
        """Number of rows that are not shown at once."""
        return max(len(self.rows) - self.most, 0) if self.most else 0


@dataclass(frozen=True)
class Bullets:
    """Sentences, each an item of a list."""

    texts: Sequence[str]


@dataclass(frozen=True)
class Code:
    """Text to copy unchanged; a page has a button for it, whose label is `what`."""

    text: str
    what: str = ""


@dataclass(frozen=True)
class Download:
    """A file that a page has in it."""

    name: str
    text: str


@dataclass(frozen=True)
class Figure:
    """The place of a figure, by its number on the page; `alt` is what it shows, in words; its title may be empty."""

    number: int
    name: str
    title: str
    note: str
    alt: str


@dataclass(frozen=True)
class Part:
    """Blocks that belong together, perhaps below a title.

    The kinds that have a layout on a page: "section", "effect", "two" (two columns), "folded" and "verdict".
    """

    blocks: Sequence[Block]
    title: str = ""
    kind: str = ""


Block: TypeAlias = Paragraph | Facts | Table | Bullets | Code | Download | Figure | Part


@dataclass(frozen=True)
class Document:
    """What a result says; `str` is its text."""

    blocks: Sequence[Block]
    title: str = ""

    def __str__(self) -> str:
        lines = [self.title] if self.title else []
        return "\n".join([*lines, *_lines(self.blocks)]).lstrip("\n")

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data: each block with its name and what it holds."""
        return {"title": self.title, "blocks": as_data(self.blocks)}

    def _repr_html_(self) -> str:
        head = f'<p class="title"><strong>{_text(self.title)}</strong></p>' if self.title else ""
        return f'<div class="rodgen">{head}{as_html(self.blocks, 4)}</div>'


class Documented:
    """A result that has a document: its text and its HTML are made of that."""

    document: Callable[..., Document]

    def summary(self) -> str:
        """Return it as text."""
        return str(self.document())

    def __str__(self) -> str:
        return str(self.document())

    def _repr_html_(self) -> str:
        return self.document()._repr_html_()


# plain data ----------------------------------------------------------------------------------------------------------


def as_data(blocks: Iterable[Block]) -> list[dict[str, Any]]:
    """Return blocks as plain data."""
    return [
        {"block": type(block).__name__.lower()}
        | {
            field.name: as_data(value) if field.name == "blocks" else value
            for field in fields(block)
            if (value := getattr(block, field.name)) != field.default
        }
        for block in blocks
    ]


# text ----------------------------------------------------------------------------------------------------------------


def _lines(blocks: Iterable[Block]) -> Iterator[str]:
    """Yield lines; before each part there is an empty one."""
    for block in blocks:
        match block:
            case Part():
                yield ""
                if block.title:
                    yield block.title
                yield from list(_lines(block.blocks))[0 if block.title or not _begins(block) else 1 :]
            case Paragraph(kind="line"):
                yield block.text
            case Paragraph():
                yield from _wrapped(block.text, "", "")
            case Facts():
                yield from [f"  {block.title}"] * bool(block.title)
                for name, text in block.said:
                    yield from _fact(name, text)
            case Table():
                yield from _table(block)
            case Bullets():
                for text in block.texts:
                    yield from _wrapped(text, "  ", "    ")
            case Code():
                yield from (f"    {line}" for line in block.text.splitlines())


def _begins(part: Part) -> bool:
    return bool(part.blocks) and isinstance(part.blocks[0], Part)


def _fact(name: str, text: str) -> list[str]:
    return _wrapped(text, f"  {name:<{LABEL - 1}} ", " " * (LABEL + 2))


def _wrapped(text: str, first: str, others: str) -> list[str]:
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _table(table: Table) -> Iterator[str]:
    rows = [*([table.header] if table.header else []), *table.rows[: table.most or None]]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = table.align.ljust(len(widths), "l")
    indent = "" if table.header else "  "
    if table.title:
        yield table.title
    for row in rows:
        cells = [
            cell.ljust(width) if side == "l" else cell.rjust(width)
            for cell, width, side in zip(row, widths, sides, strict=True)
        ]
        yield (indent + "  ".join(cells)).rstrip()
    if table.further:
        yield f"  and {table.further} {table.more}"


# HTML ----------------------------------------------------------------------------------------------------------------


def as_html(blocks: Iterable[Block], level: int = 2) -> str:
    """Return blocks as HTML, titles of parts as headings of a level, from 1 to 6."""
    return "\n".join(_html(block, level) for block in blocks)


def _text(text: str) -> str:
    """Return text as HTML, with the signs that people write: µ after a number or as a unit, and minus before a number.

    What is in quotation marks is to be copied, and stays.
    """
    parts = re.split(r"((?<!\w)'[^']*'(?!\w))", text)
    for k in range(0, len(parts), 2):
        part = re.sub(r"(?<=\d )um\b|(?<=\bin )um\b|(?<=\[)um\b|^um(?=$|[ /*])", "µm", parts[k])
        parts[k] = re.sub(r"(?<![\w.)])-(?=\d)", "−", part)
    return html.escape("".join(parts))


def _tag(name: str, content: str, kind: str = "", more: str = "") -> str:
    attributes = (f' class="{html.escape(kind)}"' if kind else "") + more
    return f"<{name}{attributes}>{content}</{name}>"


def _label(text: str) -> str:
    return f' aria-label="{html.escape(text)}"'


def _html(block: Block, level: int) -> str:
    match block:
        case Paragraph():
            return _tag("p", _text(block.text), block.kind)
        case Facts(kind="sizes" | "todo"):
            return _tag("dl", "".join(_of_list(*row) for row in block.said), block.kind)
        case Facts():
            rows = (
                f'<tr><th scope="row">{_text(name)}</th><td>{_text(text)}</td></tr>'
                for name, text in block.said
            )
            return _boxed(f"{_caption(block.title)}<tbody>{''.join(rows)}</tbody>", "facts", block.title)
        case Table():
            return _html_of_table(block)
        case Bullets():
            return _tag("ul", "".join(_tag("li", _text(text)) for text in block.texts))
        case Code():
            code = _tag("pre", html.escape(block.text), "", ' tabindex="0"')
            return (
                _tag("div", code, "copy", f' data-what="{html.escape(block.what)}"') if block.what else code
            )
        case Download():
            data = base64.b64encode(block.text.encode()).decode()
            name = html.escape(block.name)
            link = f'<a download="{name}" href="data:text/csv;charset=utf-8;base64,{data}">{name}</a>'
            return _tag("p", f"As a file: {link}", "files")
        case Figure():
            note = _tag("p", _text(block.note), "note") if block.note else ""
            plot = _tag("div", "", "plot", f' data-figure="{block.number}" role="img"{_label(block.alt)}')
            caption = _tag("figcaption", _text(block.title)) if block.title else ""
            return _tag("figure", caption + note + plot, "", f' id="{html.escape(block.name)}"')
        case Part():
            return _html_of_part(block, level)


def _of_list(name: str, text: str) -> str:
    value, _, unit = text.partition(" ")
    value_html = f"{_text(value)} <span>{_text(unit)}</span>" if value[:1].isdigit() else _text(text)
    kind = re.sub(r"\W+", "-", name)
    return _tag("div", f"<dt>{_text(name)}</dt><dd>{value_html}</dd>", kind)


def _html_of_part(part: Part, level: int) -> str:
    inner = as_html(part.blocks, level + 1 if part.title else level)
    if part.kind == "folded":
        return _tag("details", f"<summary>{_text(part.title)}</summary>{inner}")
    name = {"section": "section", "verdict": "section", "effect": "article"}.get(
        part.kind.partition(" ")[0], "div"
    )
    head = _tag(f"h{min(level, 6)}", _text(part.title)) if part.title else ""
    return _tag(name, head + inner, part.kind, _label(part.title) if name == "section" and head else "")


def _caption(title: str) -> str:
    return _tag("caption", _text(title)) if title else ""


def _boxed(content: str, kind: str, title: str) -> str:
    more = f' tabindex="0" role="region"{_label(title)}' if title else ""
    return _tag("div", _tag("table", content, kind), "box", more)


def _html_of_table(table: Table) -> str:
    sides = table.align.ljust(max(len(table.header), *map(len, table.rows), 0), "l") if table.rows else ""
    head = "".join(
        _tag("th", _text(words), side if side != "l" else "", ' scope="col"')
        for words, side in zip(table.header, sides, strict=False)
    )
    head = f"<thead><tr>{head}</tr></thead>" if head else ""
    many = len(table.header) >= MANY
    names = table.header if many else [""] * len(sides)
    rows = ["".join(map(_html_of_cell, range(len(row)), row, sides, names)) for row in table.rows]
    kind = f"{table.kind} many".strip() if many else table.kind
    bodies = [rows[: table.most or None], rows[table.most :] if table.further else []]
    bodies_html = [f"{head}<tbody>{''.join(f'<tr>{row}</tr>' for row in body)}</tbody>" for body in bodies]
    first = _boxed(_caption(table.title) + bodies_html[0], kind, table.title)
    if not table.further:
        return first
    return first + _tag(
        "details", f"<summary>{table.further} more</summary>{_boxed(bodies_html[1], kind, '')}"
    )


def _html_of_cell(column: int, cell: str, side: str, name: str) -> str:
    if column == 0 and side == "l":
        return _tag("th", _text(cell), "", ' scope="row"')
    bar = ""
    if side == "b" and (match := re.search(r"[\d.]+", cell)):
        bar = (
            '<svg class="mini" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect class="track" '
            f'width="100" height="10"/><rect class="fill" width="{match[0]}" height="10"/></svg>'
        )
    kind = {"l": "m" if len(cell) < 40 else ""}.get(side, side)
    return _tag("td", bar + _text(cell), kind, f' data-column="{html.escape(name)}"' if name else "")
