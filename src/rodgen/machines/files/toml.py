"""Read a TOML file as tables; every error names its place: ``[units], length`` or ``joint C, axis``.

What a key may hold is a `Kind`: what an error message expects, and a function that takes the value or is `UnfitError`.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeGuard, TypeVar, overload

from rodgen.errors import InputFileError, listed, nearest_name, shown, suggestion
from rodgen.files import decoded, read_input
from rodgen.limits import NESTING

_T = TypeVar("_T")
_D = TypeVar("_D")
REQUIRED: Any = object()
_TOML = "TOML, such as axis = [0, 0, 1]"
_NAME = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""


# files ---------------------------------------------------------------------------------------------------------


def read_text(file: str, expected: str = "a machine file") -> str:
    """Return the text of a machine file, or of what else is expected, with its byte order mark if it has one.

    Raises
    ------
    InputFileError
    """
    return decoded(read_input(file, expected, f"{expected}, of a few kB"), file)


def parse(text: str, file: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    InputFileError
    """
    text = text.removeprefix("\ufeff")
    # tomllib takes the square of the number of names, in time and memory
    key = re.search(rf"(?:^|[\[{{,])[ \t]*+(?:{_NAME}[ \t]*+\.[ \t]*+){{{NESTING}}}", text, re.M)
    if key:
        line = text.count("\n", 0, key.end()) + 1
        found = f"a key of more names than {NESTING}"
        raise InputFileError(file, f"line {line}", found, f"at most {NESTING}")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(str(error), text, file) from None
    except ValueError:  # Python's own limit on the digits of an integer
        raise InputFileError(
            file, "file", "a number of thousands of digits", "numbers of a usual size"
        ) from None
    except RecursionError:
        raise InputFileError(file, "file", "arrays or tables nested too deep", _TOML) from None
    if _depth(content) > NESTING:
        found = f"arrays or tables nested more than {NESTING} deep"
        raise InputFileError(file, "file", found, f"at most {NESTING}")
    return content


def _depth(value: Any) -> int:
    inside = value.values() if isinstance(value, dict) else value
    return 1 + max(map(_depth, inside), default=0) if isinstance(value, dict | list) else 0


def _syntax_error(message: str, text: str, file: str) -> InputFileError:
    place = re.fullmatch(
        r"(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|.*)\)", message, re.S
    )
    what = place["what"] if place else message
    what = re.sub(r"\('(.*?)',?\)", lambda m: f"'{m[1]}'", what)  # tomllib writes a key as a tuple
    what = what[:1].lower() + what[1:]
    if place and place["line"]:
        return InputFileError(file, f"line {place['line']}", f"{what}, at column {place['column']}", _TOML)
    return InputFileError(file, f"line {text.rstrip().count(chr(10)) + 1}", f"{what}, at the end", _TOML)


# values --------------------------------------------------------------------------------------------------------


class UnfitError(Exception):
    """A value that a key cannot hold: what is wrong with it, and what was expected if not what its `Kind` says."""

    def __init__(self, found: str | None = None, expected: str | None = None) -> None:
        self.found = found
        self.expected = expected


@dataclass(frozen=True)
class Kind(Generic[_T]):
    """What a key may hold."""

    expected: str
    """For the error message."""
    read: Callable[[Any], _T]
    """From the value as TOML has it; raises `UnfitError`."""

    def then(self, step: Callable[[_T], Any], expected: str | None = None) -> Kind[Any]:
        """Return this kind with one more step after reading."""
        return Kind(expected or self.expected, lambda value: step(self.read(value)))


def _read_number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UnfitError
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise UnfitError(None if isinstance(value, float) else "a number beyond floating point")
    return number


def _positive(number: float) -> float:
    if number <= 0:
        raise UnfitError
    return number


def _not_empty(text: str) -> str:
    if not text.strip():
        raise UnfitError("an empty text")
    return text


def of_type(wanted: type[_T], expected: str) -> Kind[_T]:
    """Return the kind of a value of a type."""

    def read(value: Any) -> _T:
        if not isinstance(value, wanted):
            raise UnfitError
        return value

    return Kind(expected, read)


def several(one: Kind[_T], expected: str, count: int | None = None) -> Kind[tuple[_T, ...]]:
    """Return the kind of a list of values of a kind: of so many, or of any number."""

    def read(value: Any) -> tuple[_T, ...]:
        if not isinstance(value, list) or (count is not None and len(value) != count):
            raise UnfitError
        return tuple(map(one.read, value))

    return Kind(expected, read)


NUMBER = Kind("a number", _read_number)
POSITIVE = NUMBER.then(_positive, "a positive number")
PAIR: Kind[tuple[float, float]] = several(NUMBER, "two numbers, such as [0, 360]", 2).then(tuple)
VECTOR = several(NUMBER, "three numbers, such as [0, 0, 1]", 3)
TEXT = of_type(str, "a text in quotes").then(_not_empty)
TABLE: Kind[dict[str, Any]] = of_type(dict, "a table")


def one_of(options: Collection[str]) -> Kind[str]:
    """Return the kind of a text that is one of some options."""

    def read(value: Any) -> str:
        if not isinstance(value, str):
            raise UnfitError
        if value not in options:
            raise UnfitError(shown(value), suggestion(value, options))
        return value

    return Kind(listed(options), read)


def _described(value: Any) -> str:
    """Return what stands at a key, in words."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"the text {shown(value)}"
    if isinstance(value, int | float):
        return str(value) if isinstance(value, float) or abs(value) < 10**18 else "a long number"
    if isinstance(value, list):
        parts = ", ".join(map(_described, value[:4])) + (", …" if len(value) > 4 else "")
        return f"[{parts}]" if len(parts) < 80 else f"a list of {len(value)}"
    return "a table" if isinstance(value, dict) else "a date or time"


# tables --------------------------------------------------------------------------------------------------------


def _is_blocks(content: Any) -> TypeGuard[list[dict[str, Any]]]:
    return isinstance(content, list) and all(isinstance(block, dict) for block in content)


class Table:
    """A table of a file, read key by key.

    Parameters
    ----------
    file, place : str
        For error messages; an empty place is the file's top level.
    keys : collection of str
        Those that may stand there.

    Raises
    ------
    InputFileError
        At the first key that may not.
    """

    def __init__(self, file: str, place: str, content: Mapping[str, Any], keys: Collection[str]) -> None:
        self.file = file
        self.place = place
        self.content = content
        for key in content:
            if key not in keys:
                near = nearest_name(key, keys)
                expected = f"{near!r}, perhaps" if near else f"one of {', '.join(keys)}"
                raise self.error(key, "unknown key", expected)

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, key: str, found: str, expected: str) -> InputFileError:
        """Return the error for what is wrong at a key; an empty key is the table itself."""
        key = shown(key)[1:-1]
        return InputFileError(
            self.file, ", ".join(filter(None, (self.place, key))) or "file", found, expected
        )

    @overload
    def get(self, key: str, kind: Kind[_T]) -> _T: ...

    @overload
    def get(self, key: str, kind: Kind[_T], default: _D) -> _T | _D: ...

    def get(self, key: str, kind: Kind[Any], default: Any = REQUIRED) -> Any:
        """Return the value at a key.

        Parameters
        ----------
        default : optional
            For a key that is not there; left out, the key must be.

        Raises
        ------
        InputFileError
        """
        if key not in self.content:
            if default is REQUIRED:
                raise self.error(key, "missing", kind.expected)
            return default
        return self.convert(key, self.content[key], kind)

    def convert(self, key: str, value: Any, kind: Kind[_T]) -> _T:
        """Return a value of a kind; errors name the key."""
        try:
            return kind.read(value)
        except UnfitError as unfit:
            found = unfit.found or _described(value)
            raise self.error(key, found, unfit.expected or kind.expected) from None

    def sub(self, key: str, keys: Collection[str], *, missing: str | None = None) -> Table:
        """Return a table in this one, empty when it is not there.

        Parameters
        ----------
        keys : collection of str
            Those that may be in it.
        missing : str, optional
            What is expected where the table must be there.
        """
        place = f"[{key}]"
        if key not in self.content and missing is not None:
            raise InputFileError(self.file, place, "missing", missing)
        content = self.content.get(key, {})
        if not isinstance(content, dict):
            found = f"blocks, [{place}]" if _is_blocks(content) else _described(content)
            raise InputFileError(self.file, place, found, f"a table, {place}")
        return Table(self.file, place, content, keys)

    def blocks(self, key: str, most: int, *, missing: str | None = None) -> list[dict[str, Any]]:
        """Return the content of the blocks ``[[key]]``.

        Parameters
        ----------
        most : int
            How many there may be.
        missing : str, optional
            What is expected where there must be one at least.
        """
        content = self.content.get(key, [])
        place = f"[[{key}]]"
        if not _is_blocks(content):
            found = f"a single table, [{key}]" if isinstance(content, dict) else _described(content)
            raise InputFileError(self.file, place, found, f"blocks {place}")
        if not content and missing is not None:
            raise InputFileError(self.file, place, "missing", missing)
        if len(content) > most:
            raise InputFileError(self.file, place, f"{len(content)} blocks", f"at most {most}")
        return content
