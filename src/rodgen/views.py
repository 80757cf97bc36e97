"""How results look in a notebook, as DataFrames and as plain data; pandas is imported only for a DataFrame."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from typing import Any, ClassVar, TypeVar

import numpy as np

from rodgen.document import Code, Document, Facts, Table
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

    def document(self) -> Document:
        """Return the table, of a long one the first and the last rows."""
        return shown_table(self.shown_columns, self.row_count)

    def _repr_html_(self) -> str:
        return self.document()._repr_html_()


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
        records = super().__new__(cls, items)
        records._record = record
        return records

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
    """Return attributes of a result as :func:`encoded` data.

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
    content = {}
    for name in names.split() or [field.name for field in dataclasses.fields(result)]:
        key, _, path = name.partition("=")
        value = result
        for part in (path or key).split("."):
            value = None if value is None else getattr(value, part)
        content[key] = encoded(value)
    return content


def encoded(value: Any) -> Any:
    """Return a result, or what holds some, as data for JSON; numbers keep all digits.

    A result is what its `to_dict` returns, else its fields; an enumeration is a name, an array a list, and a number
    that is not finite None.

    Examples
    --------
    >>> encoded({1: (0.5, float("nan")), "a": np.eye(2, dtype=int), "b": np.float32(0.25)})
    {'1': [0.5, None], 'a': [[1, 0], [0, 1]], 'b': 0.25}
    """
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, int):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return encoded(value.tolist())
    if hasattr(value, "to_dict"):
        return encoded(value.to_dict())
    if dataclasses.is_dataclass(value):
        return plain(value)
    if isinstance(value, Mapping):
        return {str(key): encoded(part) for key, part in value.items()}
    return [encoded(part) for part in value]


def to_json(data: Any, *, indent: int | None = None, only_ascii: bool = False) -> str:
    """Return a result, or what holds some, as a text of JSON; see :func:`encoded`."""
    return json.dumps(encoded(data), indent=indent, ensure_ascii=only_ascii, allow_nan=False)


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
    """Return a result as HTML: its text where it has one, else its fields.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> class Place(NamedTuple):
    ...     "Where something is."
    ...     x: float
    ...     found: bool
    >>> html_of(Place(1 / 3, True)).partition("<tbody>")[2].partition("</tbody>")[0]
    '<tr><th scope="row">x</th><td>0.333333</td></tr><tr><th scope="row">found</th><td>True</td></tr>'
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
    title = (type(result).__doc__ or "").partition("\n")[0]
    return Document([Facts([(name, _cell(getattr(result, name))) for name in names])], title)._repr_html_()


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
    return Document([Code(text)])._repr_html_()


def shown_table(shown: Callable[[Sequence[int]], Mapping[str, Any]], count: int, title: str = "") -> Document:
    """Return a table as a document, of a long one the first and the last rows.

    Parameters
    ----------
    shown : callable
        From indices of rows to the columns with these.
    count : int
        Of all rows.
    title : str
    """
    many = count > ROWS
    columns = shown([*range(ENDS), *range(count - ENDS, count)] if many else range(count))
    rows = [[_cell(cell) for cell in row] for row in zip(*columns.values(), strict=True)]
    if many:
        title = f"{title} {count} rows".strip()
        rows.insert(ENDS, ["…"] * len(columns))
    return Document([Table(list(columns), rows)], title)


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
