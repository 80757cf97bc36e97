"""A Sphinx extension for docstrings that are read in a terminal as well.

- A bar is an absolute value, never reStructuredText's substitution.
- The lines ``NAME: text`` in the docstring of an enumeration are a list.
- One entry may describe several names: ``low, high : ndarray``.
- What another package made is not described.
- In a type only names of classes are references: not the words of ``shape (parameters, 3)``.
- A reference to something that exists, but has no page, is shown as code. One to nothing stays a warning.
"""

from __future__ import annotations

import enum
import importlib
import inspect
import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject

_LITERAL = re.compile(r"(``.*?``)")
_SEVERAL = re.compile(r"^(\s*:(?:param|type|ivar|vartype) )((?:[\w*\\]+, )+[\w*\\]+):")
_COMMA = ",\u2060"
"""A comma and a word joiner: Sphinx takes what is before a space for a type."""


def _process(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    members = set(found.__members__) if isinstance(found, enum.EnumMeta) else set()
    text = []
    for number, line in enumerate(lines):
        parts = _LITERAL.split(line)
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        line = "".join(parts)
        member, colon, rest = line.partition(": ")
        if colon and member in members:
            line = f"- ``{member}``: {rest}"
            if number and lines[number - 1].strip() and not text[-1].startswith(("-", " ")):
                text.append("")
        elif members and line.strip() and text and text[-1].startswith(("-", "  ")):
            line = f"  {line.strip()}"
        text.append(line)
    lines[:] = text


def _join_names(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [
        _SEVERAL.sub(lambda match: f"{match[1]}{match[2].replace(', ', _COMMA)}:", line) for line in lines
    ]


def _skip(app: Sphinx, what: str, name: str, found: Any, skip: bool, options: Any) -> bool | None:
    if inspect.isclass(found) or inspect.isroutine(found):
        return None if (getattr(found, "__module__", "") or "rodgen").partition(".")[0] == "rodgen" else True
    return None


def _as_written(app: Sphinx, document: nodes.document) -> None:
    for text in list(document.findall(nodes.Text)):
        if _COMMA in text:
            text.parent.replace(text, nodes.Text(text.replace(_COMMA, ", ")))
    for reference in list(document.findall(pending_xref)):
        if reference["reftype"] == "class" and reference["reftarget"].rpartition(".")[2][:1].islower():
            reference.replace_self(reference.children)


def _resolve(name: str) -> bool:
    """Whether there is something of this dotted name."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ImportError:
            continue
        try:
            for part in parts[count:]:
                found = getattr(found, part)
        except AttributeError:
            return False
        return True
    return False


def _missing(app: Sphinx, env: Any, node: Any, content: nodes.Node) -> nodes.Node | None:
    if node.get("refdomain") != "py" or node["reftype"] == "class":
        return None
    target, places = node["reftarget"].lstrip("."), (node.get("py:module"), node.get("py:class"))
    module, cls = (place or "" for place in places)
    names = (target, f"{module}.{target}", f"{module}.{cls}.{target}", f"{cls}.{target}")
    if any(_resolve(name.strip(".")) for name in names):
        return nodes.literal(target, content.astext())
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to the events of Sphinx."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-process-docstring", _join_names, priority=900)  # after napoleon
    app.connect("autodoc-skip-member", _skip)
    app.connect("doctree-read", _as_written)
    app.connect("missing-reference", _missing)
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
