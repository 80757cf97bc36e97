"""Read small files, and write files that are either complete or not there."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from io import BufferedReader
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rodgen.errors import InputFileError
from rodgen.limits import VARIABLE, limit

if TYPE_CHECKING:
    import zipfile
if sys.platform != "win32":
    import fcntl


# reading -----------------------------------------------------------------------------------------------


def open_input(file: str, expected: str) -> BufferedReader:
    """Return a file that is open for reading bytes.

    Parameters
    ----------
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


def check_unpacked(file: str, archive: zipfile.ZipFile, expected: str, largest: int) -> None:
    """Refuse an archive whose files are larger than so many bytes when unpacked.

    Raises
    ------
    InputFileError
    """
    if sum(each.file_size for each in archive.infolist()) > largest:
        raise InputFileError(file, "file", f"more than {largest / 1e6:g} MB when unpacked", expected)


def read_start(file: str, expected: str, size: int = 1 << 16) -> bytes:
    """Return the first bytes of a file, by which it is known.

    Raises
    ------
    InputFileError
        When it cannot be read.
    """
    try:
        with open_input(file, expected) as stream:
            return stream.read(size)
    except OSError as error:
        raise unreadable(file, error, expected) from None


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


_BINARY: int = getattr(os, "O_BINARY", 0)

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
    """A file that has a temporary name, in its final folder, until it is complete and on the disk.

    A device or a pipe is written directly. A symbolic link stays a link: its target is replaced. A file that is
    replaced keeps its permissions. What a killed process left of this file is removed.

    Parameters
    ----------
    file : str
        The final name, as the user gave it.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._device = is_device(file)
        self._final = self._part = self._before = ""
        self._was_there = False
        self._descriptor = -1

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
            self._part, self._descriptor = _locked(
                os.path.join(folder, f".{name[:80]}.rodgen-"),
                lambda part: os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o666),
            )
            if os.path.exists(self._final):
                shutil.copymode(self._final, self._part)
            return open(os.dup(self._descriptor), "wb")
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError | ValueError):
                raise unwritable(self.file, error) from None
            raise

    def commit(self, *, undoable: bool = False) -> None:
        """Give the complete, closed file its name; what is `undoable` can be undone until it is discarded."""
        with self.located():
            if not self._device:
                _synchronise(self._descriptor)
                self._was_there = os.path.exists(self._final)
                if undoable and self._was_there:
                    self._before = f"{self._part}-before"
                    try:
                        os.link(self._final, self._before)
                    except OSError:  # a disk without hard links
                        shutil.copy2(self._final, self._before)
                if sys.platform == "win32":  # where an open file keeps its name
                    self._close()
                os.replace(self._part, self._final)
            if _completed is not None:
                _completed.append(self.file)

    def undo(self) -> None:
        """Bring back what stood there before a commit: the other file, or none."""
        if not self._part or os.path.exists(self._part):
            return
        with contextlib.suppress(OSError):
            if self._was_there:
                os.replace(self._before, self._final)
            else:
                os.unlink(self._final)
            if _completed is not None and self.file in _completed:
                _completed.remove(self.file)

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
        """Remove what has a temporary name."""
        for name in filter(None, (self._part, self._before)):
            _remove(name)
        self._close()

    def _close(self) -> None:
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1


def _synchronise(descriptor: int) -> None:
    """Wait until a file is on the disk, where the disk says so."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
            raise


def commit_all(files: Iterable[AtomicFile]) -> None:
    """Give complete files their names: all of them, or none."""
    done: list[AtomicFile] = []
    try:
        for file in files:
            done.append(file)
            file.commit(undoable=True)
    except BaseException:
        for file in done:
            file.undo()
        raise


@contextlib.contextmanager
def temporary_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """Yield a new folder, removed at the end; those that killed processes left there are removed first.

    Parameters
    ----------
    parent : Path
        The folder that it is in.
    prefix : str
        Its name, to which eight hexadecimal digits are added: no name that anyone else gives a folder.
    """

    def make(name: str) -> int:
        os.mkdir(name, 0o700)
        if sys.platform == "win32":
            return -1
        try:
            return os.open(name, os.O_RDONLY)
        except BaseException:
            os.rmdir(name)
            raise

    name, descriptor = _locked(os.path.join(parent, prefix), make)
    try:
        yield Path(name)
    finally:
        shutil.rmtree(name, ignore_errors=True)
        if descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(descriptor)


@contextlib.contextmanager
def new_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a folder for files that appear together: it takes its name when the block ends without an error.

    Raises
    ------
    InputFileError
        When something has this name already, or it cannot be written.
    """
    place = Path(path)
    if place.exists():
        raise InputFileError(place, "file", "is there already", "the name of a new folder")
    try:
        with temporary_folder(place.absolute().parent, f".{place.name}.") as made:
            (made / "made").mkdir()
            yield made / "made"
            (made / "made").rename(place)
    except OSError as error:
        raise unwritable(os.fspath(place), error) from None


@contextlib.contextmanager
def one_process_in(folder: str) -> Iterator[None]:
    """Hold a folder for this process: another one that asks for it meanwhile is refused.

    The end of the process, also a sudden one, frees it. Disks without locks, and Windows, refuse no second process.

    Raises
    ------
    InputFileError
        When another process has it.
    """
    if sys.platform == "win32":
        yield
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise unreadable(folder, error, "a folder") from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            found, expected = "another run of rodgen writes to it", "the end of that run, or another folder"
            raise InputFileError(folder, "file", found, expected) from None
        except OSError:
            pass
        yield
    finally:
        os.close(descriptor)


def _locked(start: str, make: Callable[[str], int]) -> tuple[str, int]:
    """Make a file or folder of a name that starts so, which no process sweeps away while this one has it open."""
    _sweep(start)
    while True:
        name = start + secrets.token_hex(4)
        descriptor = make(name)
        try:
            if _lock(descriptor) is False or os.path.lexists(name):
                return name, descriptor
        except BaseException:
            _remove(name)
            raise
        os.close(descriptor)  # it was swept away before it was locked


def _lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed, also by the end of the process; return whether that succeeds."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another process has it, or the disk knows no locks
        return False
    return True


def _remove(name: str) -> None:
    if os.path.isdir(name):
        shutil.rmtree(name, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            os.unlink(name)


def _sweep(start: str) -> None:
    """Remove files and folders that `_locked` made for processes that were killed since."""
    name = re.compile(re.escape(os.path.basename(start)) + "[0-9a-f]{8}(-before)?")
    with contextlib.suppress(OSError):
        for left in os.scandir(os.path.dirname(start)) if sys.platform != "win32" else ():
            if name.fullmatch(left.name) and not left.is_symlink():
                with contextlib.suppress(OSError):
                    descriptor = os.open(left.path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
                    try:
                        if _lock(descriptor):
                            _remove(left.path)
                    finally:
                        os.close(descriptor)


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
    """Write texts by file name, in the folder or below it; no file gets its final name before all are written.

    Parameters
    ----------
    folder : Path
        Is made where there is none, and taken away again when the files cannot be written.

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
    folders = {folder, *(parent for path in paths for parent in path.parents)}
    missing = sorted((f for f in folders if not f.exists()), key=lambda f: -len(f.parts))
    targets = [AtomicFile(str(path)) for path in paths]
    complete = False
    try:
        _make(folder, paths)
        for target, name in zip(targets, names, strict=True):
            target.write(files[name].encode())
        commit_all(targets)
        complete = True
    finally:
        for target in targets:
            target.discard()
        if not complete:
            for parent in missing:
                with contextlib.suppress(OSError):
                    parent.rmdir()
    return paths


def _make(folder: Path, paths: list[Path]) -> None:
    for parent in dict.fromkeys((folder, *(path.parent for path in paths))):
        try:
            parent.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            found = f"no folder can be made ({_reason(error)})"
            raise InputFileError(parent, "file", found, "a writable place") from None
    for path in paths:
        if path.is_dir():
            raise InputFileError(path, "file", "a folder stands in its place", "a file, or nothing")
