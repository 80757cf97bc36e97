"""Read a CSV file that grows, or standard input, as whole lines when they are there, and know how far it was read."""

from __future__ import annotations

import hashlib
import os
import select
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import IO, Any

from rodgen.data.tables.table import READABLE
from rodgen.errors import InputFileError
from rodgen.files import open_input, unreadable

AT_ONCE = 1 << 14
"""Bytes that are read at once: some hundred rows, after which a signal is heard."""
POLL = 0.2
"""Seconds between two looks at a file that does not grow."""
LONGEST = 1 << 20
"""Bytes without the end of a line that are no row of a table."""


@dataclass(frozen=True)
class Lines:
    """Whole lines that follow each other; none where nothing has come for a while.

    Attributes
    ----------
    header : bytes
        Of the file that they are of.
    text : bytes
    first : int
        Number of the first of them, from 1.
    notice : str
        What happened to the file before: it was replaced, or became shorter.
    """

    header: bytes
    text: bytes
    first: int
    notice: str = ""


class Tail:
    """A CSV file, from its beginning or a place that was reached before.

    Parameters
    ----------
    file : str
        ``"-"`` is standard input.
    follow : bool
        Whether to wait for more at its end.
    place : mapping, optional
        What :attr:`place` was, to go on from there.
    stopped : callable
        Returns whether to stop; asked again and again.
    """

    def __init__(
        self, file: str, *, follow: bool, place: Mapping[str, Any] | None, stopped: Callable[[], bool]
    ) -> None:
        self.file = "standard input" if file == "-" else file
        self._follow, self._stopped = follow, stopped
        self._stdin = file == "-"
        self._notice = ""
        self._begin()
        if place is not None and not self._stdin:
            self._go_to(place)

    def _begin(self) -> None:
        """Open the file at its beginning."""
        self._header, self._next, self._offset, self._rest = b"", 1, 0, b""
        self._hash = hashlib.sha256()
        self._stream = self._open()

    def _open(self) -> IO[bytes]:
        if not self._stdin:
            return open_input(self.file, READABLE)
        if sys.stdin is None:
            raise InputFileError("standard input", "file", "closed", "CSV, or the name of a file")
        return sys.stdin.buffer

    @property
    def place(self) -> dict[str, Any]:
        """How far the lines that were handed out reach, as plain data."""
        return {"offset": self._offset, "line": self._next, "before": self._hash.hexdigest()}

    def _go_to(self, place: Mapping[str, Any]) -> None:
        """Go on from a place if all that stands before it, the header too, is as it was."""
        try:
            while (left := int(place["offset"]) - self._offset) > 0:
                text = self._stream.read(min(left, AT_ONCE)) if self._header else self._stream.readline(left)
                if not text:
                    break
                for _ in self._handed(text):
                    pass
        except OSError as error:
            raise unreadable(self.file, error, READABLE) from None
        if self.place != place:
            self._notice = "is another file than before, and is read from its beginning"
            self._stream.close()
            self._begin()

    def __iter__(self) -> Iterator[Lines]:
        """Yield lines as they arrive; where none have come for a while, none, so that a caller may do other things."""
        while not self._stopped():
            for lines in self._whole_lines():
                notice, self._notice = self._notice, ""
                yield Lines(self._header, *lines, notice)
                if self._stopped():
                    return
            if not self._follow or self._stdin:
                if self._rest.strip():  # the last line may lack its end
                    yield from self._handed(self._rest)
                return
            yield Lines(self._header, b"", self._next)
            if not self._replaced():
                time.sleep(POLL)

    def _whole_lines(self) -> Iterator[tuple[bytes, int]]:
        """Yield lines until there are no more."""
        while chunk := self._read():
            self._rest += chunk
            end = self._rest.rfind(b"\n") + 1
            if not end and len(self._rest) > LONGEST:
                found = f"a line longer than {LONGEST >> 20} MiB"
                raise InputFileError(self.file, f"line {self._next}", found, "CSV, one row a line")
            whole, self._rest = self._rest[:end], self._rest[end:]
            if whole:
                yield from ((lines.text, lines.first) for lines in self._handed(whole))

    def _handed(self, whole: bytes) -> Iterator[Lines]:
        """Yield lines without the header, which is kept, and count them."""
        while whole and not self._header:
            line, end, rest = whole.partition(b"\n")
            self._hash.update(line + end)
            self._offset, self._next = self._offset + len(line) + len(end), self._next + 1
            whole = rest
            if line.strip():
                self._header = line.removeprefix(b"\xef\xbb\xbf").rstrip(b"\r")
        if whole:
            first = self._next
            self._hash.update(whole)
            self._offset, self._next = self._offset + len(whole), first + whole.count(b"\n")
            yield Lines(self._header, whole, first)

    def _read(self) -> bytes:
        try:
            if not self._stdin:
                return self._stream.read(AT_ONCE)
            while not self._stopped():
                if sys.platform == "win32" or select.select([self._stream], [], [], POLL)[0]:
                    return os.read(self._stream.fileno(), AT_ONCE)
            return b""
        except OSError as error:
            raise unreadable(self.file, error, READABLE) from None

    def _replaced(self) -> bool:
        """Open the file again where another one has its name, or where it is shorter than what was read."""
        try:
            now, here = os.stat(self.file), os.fstat(self._stream.fileno())
        except OSError:  # between two files
            return False
        if (now.st_ino, now.st_dev) != (here.st_ino, here.st_dev):
            self._notice = "was replaced by another file, which is read from its beginning"
        elif now.st_size < self._offset:
            self._notice = "became shorter, and is read from its beginning"
        else:
            if now.st_size < self._offset + len(self._rest):  # the unfinished last line was taken back
                self._stream.seek(self._offset)
                self._rest = b""
            return False
        self._stream.close()
        self._begin()
        return True

    def close(self) -> None:
        """Close the file."""
        if not self._stdin:
            self._stream.close()
