"""How results look in a notebook, as DataFrames and as plain data; pandas is imported only for a DataFrame."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np

from rodgen.errors import RodgenError

FEW = 12
"""Numbers of an array that are shown; of a larger one the shape is."""
SHORT = 40
"""Characters of a text in the one line of a result."""
ROWS = 60
"""Rows of a table that are shown, as pandas does ..."""
ENDS = 5
"""... and of a longer one the first and the last."""

Item = TypeVar("Item")


class Tabular:
    """What has `columns()`: a DataFrame on request, and a table in a notebook.

    Its `shown_columns` are those of the first and last rows alone, so that a table costs what is shown.
    """

    columns: Callable[[], Mapping[str, Any]]
    shown_columns: Callable[[Sequence[int]], Mapping[str, Any]]

    @property
    def row_count(self) -> int:
        """Number of rows of the table."""
        raise NotImplementedError

    def to_pandas(self) -> Any:
        """Return :meth:`columns` as a DataFrame.

        Raises
        ------
        RodgenError
            Where pandas is not installed.
        """
        return data_frame(self.columns())

    def _repr_html_(self) -> str:
        return html_of_table(self.shown_columns(shown_rows(self.row_count)), count=self.row_count)


class Records(Tabular, tuple[Item, ...]):
    """A tuple of results that is a DataFrame on request.

    Parameters
    ----------
    items : iterable
    record : callable
        From an item to a mapping of column names to cells; a function of a module, or a method, so that it is pickled.
    """

    _record: Callable[[Item], Mapping[str, Any]]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({_brief(tuple(self))})"

    def __new__(cls, items: Iterable[Item], record: Callable[[Item], Mapping[str, Any]]) -> Records[Item]:
        """Return them as a tuple."""
        made = super().__new__(cls, items)
        made._record = record
        return made

    def __getnewargs__(self) -> tuple[Any, ...]:
        return tuple(self), self._record

    @property
    def row_count(self) -> int:
        """How many there are."""
        return len(self)

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of a table with a row for each."""
        return self.shown_columns(range(len(self)))

    def shown_columns(self, indices: Sequence[int]) -> dict[str, list[Any]]:
        """Return the columns of a table with some of them."""
        rows = [self._record(self[i]) for i in indices]
        return {name: [row.get(name) for row in rows] for name in dict.fromkeys(n for r in rows for n in r)}


def plain(result: Any, names: str = "") -> dict[str, Any]:
    """Return attributes of a result as plain data, with the results in them; tuples become lists.

    Parameters
    ----------
    result : object
    names : str, optional
        Of attributes, with spaces in between, or ``key=attribute.of_that``, which is None where the attribute is; by
        default the fields of a dataclass.

    Examples
    --------
    >>> plain(slice(1, (2, 3)), "start end=stop real=start.real none=step.real")
    {'start': 1, 'end': [2, 3], 'real': 1, 'none': None}
    """
    found = {}
    for name in names.split() or [field.name for field in dataclasses.fields(result)]:
        key, _, path = name.partition("=")
        value = result
        for part in (path or key).split("."):
            value = None if value is None else getattr(value, part)
        found[key] = _encoded(value)
    return found


def _encoded(value: Any) -> Any:
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return plain(value)
    if isinstance(value, Mapping):
        return {key: _encoded(part) for key, part in value.items()}
    return [_encoded(part) for part in value] if isinstance(value, tuple | list) else value


def finite(data: Any) -> Any:
    """Return plain data with None for numbers that are not finite, which JSON has not.

    Examples
    --------
    >>> finite({1: (0.5, float("nan"))})
    {'1': [0.5, None]}
    """
    if isinstance(data, Mapping):
        return {str(key): finite(value) for key, value in data.items()}
    if isinstance(data, Iterable) and not isinstance(data, str):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return columns as a DataFrame.

    Raises
    ------
    RodgenError
        Where pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise RodgenError("a DataFrame needs pandas, which is not installed; pip install pandas") from None
    return pandas.DataFrame(dict(columns))


def html_of(result: Any) -> str:
    """Return a result as HTML: its text where it has one, else a table of its fields.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> class Place(NamedTuple):
    ...     "Where something is."
    ...     x: float
    ...     found: bool
    >>> html_of(Place(1 / 3, True)).partition("</thead>")[2]
    '<tbody><tr><td>x</td><td>0.333333</td></tr><tr><td>found</td><td>True</td></tr></tbody></table>'
    """
    if callable(getattr(result, "summary", None)):
        return html_of_text(result.summary())
    text: Any = type(result).__str__
    if text is not object.__str__:
        return html_of_text(str(result))
    if dataclasses.is_dataclass(result):
        names = [field.name for field in dataclasses.fields(result) if field.repr and field.name[0] != "_"]
    else:
        names = list(result._fields)
    fields = {"field": names, "value": [getattr(result, name) for name in names]}
    return html_of_table(fields, (type(result).__doc__ or "").partition("\n")[0])


def with_html(result: type[Item]) -> type[Item]:
    """Give a class of results its HTML in a notebook, that of :func:`html_of`; a decorator."""
    result._repr_html_ = html_of  # type: ignore[attr-defined]
    return result


def brief(result: Any) -> str:
    """Return a dataclass in one line: its type and those of its fields that are not empty, of large ones the size.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(repr=False)
    ... class Found:
    ...     verdict: str
    ...     rows: tuple[int, ...]
    ...     table: object
    ...     notes: tuple[str, ...] = ()
    ...     __repr__ = brief
    >>> Found("good", (1, 2), np.eye(3))
    Found(verdict='good', rows=2 of int, table=array (3, 3))
    """
    texts = {f.name: _brief(getattr(result, f.name)) for f in dataclasses.fields(result) if f.repr}
    return f"{type(result).__name__}({', '.join(f'{name}={text}' for name, text in texts.items() if text)})"


def _brief(value: Any) -> str:
    """Return a value in at most some forty characters; empty of what is empty."""
    if value is None or (isinstance(value, str) and not value):
        return ""
    if isinstance(value, np.ndarray):
        return f"array {value.shape}"
    if isinstance(value, tuple | list | Mapping):
        first = next(iter(value.values() if isinstance(value, Mapping) else value), None)
        return f"{len(value)} of {type(first).__name__}" if value else ""
    if isinstance(value, str | float | int):
        text = repr(value)
        return text if len(text) <= SHORT else f"{text[:SHORT]}…"
    name = getattr(value, "name", None)
    return f"{type(value).__name__}({repr(name) if isinstance(name, str) else '…'})"


class Result:
    """What is shown in a notebook, and is plain data on request."""

    _keys: ClassVar[str] = ""
    """Keys of the data, as `plain` takes them; by default the fields."""
    __repr__ = brief
    _repr_html_ = html_of

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as ``--json`` of the command prints it."""
        return plain(self, self._keys)


def html_of_text(text: str) -> str:
    """Return text as HTML, its columns one below the other."""
    return f'<pre style="white-space: pre; overflow-x: auto">{html.escape(text)}</pre>'


def shown_rows(count: int) -> list[int]:
    """Return the indices of the rows of a table that are shown: of a long one the first and the last."""
    return [*range(count)] if count <= ROWS else [*range(ENDS), *range(count - ENDS, count)]


def html_of_table(columns: Mapping[str, Any], caption: str = "", count: int | None = None) -> str:
    """Return columns as an HTML table, of a long one the first and the last rows.

    Parameters
    ----------
    columns : mapping of str to sequence
    caption : str
    count : int, optional
        Of the rows, where the columns hold only those of `shown_rows`.
    """
    if count is None:
        count = max(map(len, columns.values()), default=0)
        columns = {name: [cells[i] for i in shown_rows(count)] for name, cells in columns.items()}
    rows = list(zip(*columns.values(), strict=True))
    if count > ROWS:
        caption = f"{caption} {count} rows".strip()
        rows.insert(ENDS, tuple("…" for _ in columns))
    head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
    lines = ("".join(f"<td>{html.escape(_cell(cell))}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    above = f'<caption style="text-align: left">{html.escape(caption)}</caption>' if caption else ""
    return f"<table>{above}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, np.ndarray) and value.size > FEW:
        return f"array of shape {value.shape}"
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=6, separator=", ")
    if isinstance(value, list | tuple | set | frozenset | Mapping) and len(value) > FEW:
        return f"{type(value).__name__} of {len(value)}"
    return "" if value is None else str(value)
