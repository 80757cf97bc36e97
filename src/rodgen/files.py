"""Read small files, and write files that are either complete or not there."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator, Mapping
from io import BufferedReader
from pathlib import Path
from typing import IO

from rodgen.errors import InputFileError
from rodgen.limits import VARIABLE, limit

__all__ = [
    "AtomicFile",
    "decoded",
    "is_device",
    "noting_completed",
    "open_input",
    "read_input",
    "unreadable",
    "unwritable",
    "write_file",
    "write_files",
]


# reading -----------------------------------------------------------------------------------------------


def open_input(file: str, expected: str) -> BufferedReader:
    """Return a file that is open for reading bytes.

    Parameters
    ----------
    file : str
    expected : str
        What the file should be, for error messages.

    Raises
    ------
    InputFileError
        When it cannot be opened.
    """
    try:
        return open(file, "rb")
    except (OSError, ValueError) as error:
        raise unreadable(file, error, expected) from None


def read_input(
    file: str, expected: str, usual: str = "", *, largest: int | None = None, pipe: bool = False
) -> bytes:
    """Return the content of a small file.

    Parameters
    ----------
    file : str
    expected : str
        What the file should be, for error messages.
    usual : str
        What is expected instead of a larger file; left out, `expected`.
    largest : int, optional
        Largest size in bytes, whole megabytes; of a larger file no more is read. Default: the limit ``file``.
    pipe : bool
        Whether ``"-"`` is standard input.

    Raises
    ------
    InputFileError
        When it cannot be read, or is larger.
    """
    most = int(limit("file")) if largest is None else largest
    try:
        if pipe and file == "-":
            file = "standard input"
            if sys.stdin is None:
                raise InputFileError(file, "file", "closed", expected)
            content = sys.stdin.buffer.read(most + 1)
        else:
            with open_input(file, expected) as stream:
                content = stream.read(most + 1)
    except OSError as error:
        raise unreadable(file, error, expected) from None
    if len(content) > most:
        raised = "" if largest else f" ({VARIABLE}=file=NUMBER raises that)"
        raise InputFileError(file, "file", f"more than {most / 1e6:g} MB", (usual or expected) + raised)
    return content


def decoded(content: bytes, file: str) -> str:
    """Return the text of a file, with its byte order mark if it has one.

    Raises
    ------
    InputFileError
        When it is not UTF-8, with the line.
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputFileError(file, "file", "UTF-16 text", "UTF-8 text")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputFileError(file, f"line {line}", "bytes that are not UTF-8", "UTF-8 text") from None


def unreadable(file: str, error: BaseException, expected: str) -> InputFileError:
    """Return the error that gives the reason why a file cannot be read."""
    found = f"cannot be read ({_reason(error)})"
    if isinstance(error, FileNotFoundError):
        found = "no such file"
    elif isinstance(error, IsADirectoryError):
        found = "a folder"
    return InputFileError(file, "file", found, expected)


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or str(error).partition("\n")[0].rstrip(".")


# writing -----------------------------------------------------------------------------------------------


def unwritable(file: str, error: BaseException) -> InputFileError:
    """Return the error that gives the reason why a file cannot be written."""
    found = f"cannot be written ({_reason(error)})"
    return InputFileError(file, "file", found, "a writable place with room")


_completed: list[str] | None = None


@contextlib.contextmanager
def noting_completed() -> Iterator[list[str]]:
    """Yield the list to which the files are added that are completed in the block."""
    global _completed
    before, _completed = _completed, []
    try:
        yield _completed
    finally:
        _completed = before


class AtomicFile:
    """A file that has a temporary name, in its final folder, until it is complete.

    A device or a pipe is written directly. A symbolic link stays a link: its target is replaced. A file that is
    replaced keeps its permissions.

    Parameters
    ----------
    file : str
        The final name, as the user gave it.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._device = is_device(file)
        self._final = self._part = ""

    def open(self) -> IO[bytes]:
        """Open for writing; the caller closes it."""
        try:
            if self._device:
                return open(self.file, "wb")
            self._final = os.path.realpath(self.file)
            if os.path.exists(self._final) and not (
                os.access(self._final, os.W_OK) and os.stat(self._final).st_mode & 0o222
            ):  # a superuser may write to it, too, but it was made so on purpose
                raise PermissionError(errno.EACCES, "it is read-only")
            folder, name = os.path.split(self._final)
            part = os.path.join(folder, f".{name[:80]}.{secrets.token_hex(4)}")
            stream = open(part, "xb")  # noqa: SIM115
            self._part = part
            if os.path.exists(self._final):
                shutil.copymode(self._final, part)
        except (OSError, ValueError) as error:
            raise unwritable(self.file, error) from None
        return stream

    def commit(self) -> None:
        """Give the complete, closed file its name."""
        with self.located():
            if not self._device:
                os.replace(self._part, self._final)
        if _completed is not None:
            _completed.append(self.file)

    def write(self, content: bytes) -> None:
        """Write all of the content under the temporary name."""
        stream = self.open()
        with self.located(), stream:
            stream.write(content)

    @contextlib.contextmanager
    def located(self) -> Iterator[None]:
        """Raise an OSError of the block as the InputFileError of this file."""
        try:
            yield
        except OSError as error:
            raise unwritable(self.file, error) from None

    def discard(self) -> None:
        """Remove the temporary file, if there is one."""
        if self._part:
            with contextlib.suppress(OSError):
                os.unlink(self._part)

    def error(self, error: BaseException) -> Exception:
        """Return the error that gives the reason why the file cannot be written."""
        return unwritable(self.file, error)


def is_device(file: str) -> bool:
    """Return whether `file` is a pipe or a device."""
    with contextlib.suppress(OSError, ValueError):
        mode = os.stat(file).st_mode
        return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)
    return False


def write_file(file: str | os.PathLike[str], content: bytes) -> None:
    """Write all of `content` to `file`, or nothing.

    Raises
    ------
    InputFileError
        When the place cannot be written.
    """
    target = AtomicFile(os.fspath(file))
    try:
        target.write(content)
        target.commit()
    finally:
        target.discard()


def write_files(folder: Path, files: Mapping[str, str]) -> list[Path]:
    """Write texts by file name; no file gets its final name before all are written.

    Parameters
    ----------
    folder : Path
        Is made where there is none, and taken away again when the files cannot be written.
    files : mapping of str to str

    Returns
    -------
    list of Path
        Sorted.

    Raises
    ------
    InputFileError
        When the folder cannot be made or written.
    """
    names = sorted(files)
    paths = [folder / name for name in names]
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    new = [path for path in paths if not path.exists()]
    targets = [AtomicFile(str(path)) for path in paths]
    complete = False
    try:
        _make(folder, paths)
        for target, name in zip(targets, names, strict=True):
            target.write(files[name].encode())
        for target in targets:
            target.commit()
        complete = True
    finally:
        for target in targets:
            target.discard()
        if not complete:
            for path in new:
                with contextlib.suppress(OSError):
                    path.unlink()
            for parent in missing:
                with contextlib.suppress(OSError):
                    parent.rmdir()
    return paths


def _make(folder: Path, paths: list[Path]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        found = f"no folder can be made ({_reason(error)})"
        raise InputFileError(folder, "file", found, "a writable place") from None
    for path in paths:
        if path.is_dir():
            raise InputFileError(path, "file", "a folder stands in its place", "a file, or nothing")
