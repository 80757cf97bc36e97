"""Read small files whole, and write files that are either complete or not there."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from rodgen.errors import InputFileError

__all__ = ["AtomicFile", "is_device", "read_start", "write_file", "write_files"]


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
            folder, name = os.path.split(self._final)
            part = os.path.join(folder, f".{name[:80]}.{secrets.token_hex(4)}")
            stream = open(part, "xb")  # noqa: SIM115
            self._part = part
            if os.path.exists(self._final):
                shutil.copymode(self._final, part)
        except (OSError, ValueError) as error:
            raise self.error(error) from None
        return stream

    def commit(self) -> None:
        """Give the complete, closed file its name."""
        with self.located():
            if not self._device:
                os.replace(self._part, self._final)

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
            raise self.error(error) from None

    def discard(self) -> None:
        """Remove the temporary file, if there is one."""
        if self._part:
            with contextlib.suppress(OSError):
                os.unlink(self._part)

    def error(self, error: BaseException) -> Exception:
        """Return the error that gives the reason why the file cannot be written."""
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        return InputFileError(
            self.file, "file", f"cannot be written ({reason})", "a writable place with room"
        )


def is_device(file: str) -> bool:
    """Return whether `file` is a pipe or a device."""
    with contextlib.suppress(OSError, ValueError):
        mode = os.stat(file).st_mode
        return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)
    return False


def read_start(file: str, size: int, expected: str) -> bytes:
    """Return the first `size` bytes of a file, or all where it is shorter.

    Raises
    ------
    InputFileError
        When it cannot be read; `expected` says what should be there.
    """
    try:
        with open(file, "rb") as stream:
            return stream.read(size)
    except FileNotFoundError:
        raise InputFileError(file, "file", "no such file", expected) from None
    except IsADirectoryError:
        raise InputFileError(file, "file", "a folder", expected) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputFileError(file, "file", f"cannot be read ({reason})", expected) from None


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
        reason = getattr(error, "strerror", None) or str(error)
        raise InputFileError(
            folder, "file", f"no folder can be made ({reason})", "a writable place"
        ) from None
    for path in paths:
        if path.is_dir():
            raise InputFileError(path, "file", "a folder stands in its place", "a file, or nothing")
