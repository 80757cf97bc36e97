"""Exceptions of rodgen, and the parts of their messages.

:class:`RodgenError` is the base class of all. A file that cannot be used raises :class:`InputFileError`, whose text is
one line of fixed form, ``FILE: PLACE: what was found; expected what``, so that a person can act on it and an editor can
jump to the place.
"""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

__all__ = [
    "InputFileError",
    "MissingOptionError",
    "NotConvergedError",
    "RodgenError",
    "UnexpectedError",
    "UnfitArgumentError",
    "UnprovedError",
    "counted",
    "joined",
    "listed",
    "nearest_hint",
    "nearest_name",
    "shown",
    "suggestion",
]


MOST_NAMES = 8
"""In a list; a single name more is named, too, and of more their number is."""


class RodgenError(ValueError):
    """Base class of every error that rodgen raises on purpose."""

    def _render_traceback_(self, *_: object) -> list[str]:
        """Return what a notebook shows: the caller's line, and the sentence; rodgen's own lines help nobody."""
        import traceback  # in notebooks alone

        frames = traceback.extract_tb(self.__traceback__)
        ours = os.path.dirname(__file__) + os.sep
        begin = next((k for k, frame in enumerate(frames) if frame.filename.startswith(ours)), len(frames))
        return [*traceback.format_list(frames[max(begin - 1, 0) : begin]), f"{type(self).__name__}: {self}"]


class UnexpectedError(RodgenError):
    """Something that cannot be used: what was found, and what was expected. The caller adds the place.

    Parameters
    ----------
    found, expected : str
    """

    key = ""
    """Of a table, where the place is a key in it."""

    def __init__(self, found: str, expected: str) -> None:
        self.found = found
        self.expected = expected
        super().__init__(found, expected)

    def __str__(self) -> str:
        return f"{self.found}; expected {self.expected}"


class UnfitArgumentError(UnexpectedError):
    """An argument that cannot be used, or does not go with others; `key` is its name."""

    def __init__(self, key: str, found: str, expected: str) -> None:
        super().__init__(found, expected)
        self.args, self.key = (key, found, expected), key

    def __str__(self) -> str:
        return f"{self.key}: {super().__str__()}"


class InputFileError(RodgenError):
    """A file, or what it holds, that cannot be used.

    Parameters
    ----------
    file : str or os.PathLike
        The file as the user named it.
    place : str
        Line, column or key; ``"file"`` where the file cannot be read or written at all.
    found : str
        What stands there.
    expected : str
        What should stand there, and where there is something to do about it, what to do.

    Examples
    --------
    >>> print(InputFileError("pairs.csv", "line 7, column 'angle [deg]'", "'12,5'", "a decimal point: 12.5"))
    pairs.csv: line 7, column 'angle [deg]': '12,5'; expected a decimal point: 12.5
    """

    def __init__(self, file: str | os.PathLike[str], place: str, found: str, expected: str) -> None:
        self.file = os.fspath(file)
        self.place = place
        self.found = found
        self.expected = expected
        # All four as arguments: an exception is pickled, and thus crosses processes, by its arguments.
        super().__init__(self.file, place, found, expected)

    def __str__(self) -> str:
        return _one_line(f"{self.file}: {self.place}: {self.found}; expected {self.expected}")


class MissingOptionError(InputFileError):
    """A file that lacks something which an option of ``rodgen import`` states.

    Parameters
    ----------
    file, place, found, expected : str
        As of an `InputFileError`.
    option : str
        What stands before the answer, such as ``"--column=A="``.
    choices : sequence of str, optional
        What the answer may be, such as the file's columns; empty where that cannot be listed.
    """

    def __init__(
        self, file: str, place: str, found: str, expected: str, option: str, choices: Sequence[str] = ()
    ) -> None:
        super().__init__(file, place, found, expected)
        self.option, self.choices = option, tuple(choices)
        self.args = (*self.args, option, self.choices)


class NotConvergedError(InputFileError):
    """A fit that did not converge, where its end is needed."""

    reason = "the fit did not converge"


class UnprovedError(RodgenError):
    """A statement of a derivation is false or not proved."""


@contextlib.contextmanager
def in_file(file: str | os.PathLike[str], place: str) -> Iterator[None]:
    """Raise an `UnexpectedError` of the block as an `InputFileError` at a place of a file."""
    try:
        yield
    except UnexpectedError as error:
        place = ", ".join(filter(None, (place, error.key)))
        raise InputFileError(file, place, error.found, error.expected) from None


def shown(text: object, limit: int = 60) -> str:
    """Return a piece of a user's file, quoted for an error message: on one line, no longer than `limit`.

    Parameters
    ----------
    text : object
        What was found; bytes are read as UTF-8 where they are.
    limit : int
        Longest text shown in full.

    Returns
    -------
    str

    Examples
    --------
    >>> shown("rho_x (mm)")
    "'rho_x (mm)'"
    """
    if isinstance(text, bytes):
        text = text.decode("utf-8", "backslashreplace")
    try:
        text = str(text)
    except ValueError:  # an integer of more digits than Python writes
        text = f"{text:#x}"
    line = _one_line(text)
    return f"'{line if len(line) <= limit else line[: limit - 1] + '…'}'"


def counted(count: float, word: str) -> str:
    """Return how many there are of something.

    Examples
    --------
    >>> counted(1, "row"), counted(0, "row"), counted(0.25, "false alarm")
    ('1 row', '0 rows', '0.25 false alarms')
    """
    number = f"{count:g}" if isinstance(count, float) else count
    return f"{number} {word}{'s' * (count != 1)}"


def joined(names: Iterable[str], word: str = "and", most: int = MOST_NAMES) -> str:
    """Return names as a sentence lists them; of many the first few, and how many more there are.

    Examples
    --------
    >>> joined(["x", "y", "z"]), joined(["x", "y", "z"], "or", most=1)
    ('x, y and z', 'x or 2 more')
    """
    every = [*names]
    if len(every) > most + 1:
        every[most:] = [f"{len(every) - most} more"]
    *first, last = every or [""]
    return f"{', '.join(first)} {word} {last}" if first else last


def listed(options: Iterable[object]) -> str:
    """Return the names of which one is expected, quoted, for an error message; see :func:`joined`.

    Examples
    --------
    >>> listed(["x", "y", "z"])
    "'x', 'y' or 'z'"
    """
    return joined(map(shown, options), "or")


def nearest_name(name: str, options: Collection[str]) -> str | None:
    """Return the option that `name` is probably a misspelling of, None where none is similar.

    Examples
    --------
    >>> nearest_name("Axsi", ["axis", "point"])
    'axis'
    """
    folded = {option.casefold().replace(" ", "_"): option for option in options}
    similar = difflib.get_close_matches(name.casefold()[:60], folded, n=1, cutoff=0.7)
    return folded[similar[0]] if similar else None


def nearest_hint(name: str, options: Mapping[str, str]) -> str:
    """Return a hint, for an error message, at the option that `name` is probably a misspelling of.

    Parameters
    ----------
    name : str
        What was not found.
    options : mapping
        Names, and how each is written in the file.

    Returns
    -------
    str
        Empty when none is similar.

    Examples
    --------
    >>> nearest_hint("load", {"Load": "Load [kN]", "t": "t [s]"})
    " (the nearest is 'Load [kN]')"
    """
    near = nearest_name(name, options)
    return "" if near is None else f" (the nearest is {shown(options[near])})"


def suggestion(name: str, options: Collection[str]) -> str:
    """Return the option that is probably meant by `name`, or all of them, for the end of an error message.

    Examples
    --------
    >>> suggestion("Axsi", ["axis", "point"]), suggestion("?", ["axis", "point"])
    ("'axis', perhaps", "'axis' or 'point'")
    """
    near = nearest_name(name, options)
    return f"{near!r}, perhaps" if near else listed(options)


def _one_line(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
