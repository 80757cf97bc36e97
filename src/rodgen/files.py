"""Read small files, and write files that are either complete or not there."""

from __future__ import annotations

import abc
import contextlib
import errno
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from io import BufferedReader
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rodgen import limits
from rodgen.errors import InputFileError

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
        if (around := _outputs.get()) is not None:
            around.protect(file)
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
        Largest size in bytes, whole megabytes; of a larger file no more is read. Default: `limits.FILE`.
    pipe : bool
        Whether ``"-"`` is standard input.

    Raises
    ------
    InputFileError
        When it cannot be read, or is larger.
    """
    most = limits.FILE if largest is None else largest
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
        raise InputFileError(file, "file", f"more than {most / 1e6:g} MB", usual or expected)
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

_outputs: ContextVar[OutputSet | None] = ContextVar("outputs", default=None)
"""The set around; each thread has its own, so that files written by several threads appear one by one."""


class Output(abc.ABC):
    """What is written under a temporary name, or held back, until it is complete; `file` is its name for messages."""

    file: str
    place = ""
    """Where a file gets its name; empty of what replaces no file."""
    _joined = False

    def commit(self) -> None:
        """Publish the complete, closed output: now, or together with the others of the `OutputSet` around."""
        if (around := _outputs.get()) is None:
            self.publish()
        else:
            around.add(self)
            self._joined = True

    def discard(self) -> None:
        """Remove what is temporary, unless an `OutputSet` has it."""
        if not self._joined:
            self.clean()

    @abc.abstractmethod
    def publish(self, *, undoable: bool = False) -> None:
        """Show the output under its name; what is `undoable` can be undone until it is cleaned."""

    @abc.abstractmethod
    def undo(self) -> None:
        """Bring back what stood there before: another file, or none."""

    @abc.abstractmethod
    def clean(self) -> None:
        """Remove what is temporary."""

    @contextlib.contextmanager
    def located(self) -> Iterator[None]:
        """Raise an OSError of the block as the InputFileError of this output, unless its reader has seen enough."""
        try:
            yield
        except BrokenPipeError:
            raise
        except OSError as error:
            raise unwritable(self.file, error) from None


class OutputSet:
    """Files that appear together: all that is written in its block gets its name at the end, or nothing does.

    None of them replaces a file that was read in the block, by whatever name. The files of a set in the block of
    another one appear with those of the latter.

    Attributes
    ----------
    completed : list of str
        The files that have their names.
    """

    def __init__(self) -> None:
        self.completed: list[str] = []
        self._written: list[Output] = []
        self._folders: list[Path] = []
        self._inputs: set[tuple[int, int]] = set()
        self._input_folders: set[str] = set()
        self._rewritten: set[str] = set()
        self._claimed: set[str] = set()

    def __enter__(self) -> OutputSet:
        self._around = around = _outputs.get()
        self._token = _outputs.set(self)
        if around is not None:
            self._inputs, self._input_folders = around._inputs, around._input_folders
            self._rewritten = around._rewritten
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        _outputs.reset(self._token)
        try:
            if kind is None and self._around is not None:
                for output in self._written:
                    self._around.add(output)
                self._around._folders += self._folders
                self._written, self._folders = [], []
            elif kind is None:
                self.commit()
        finally:
            self._clean()
            for folder in self._folders:
                with contextlib.suppress(OSError):
                    folder.rmdir()

    def protect(self, file: str) -> None:
        """Note an input; of a folder, the Parquet files that may be in it."""
        if os.path.isdir(file):
            self._input_folders.add(os.path.realpath(file))
        elif (identity := _identity(file)) is not None:
            self._inputs.add(identity)

    def allow(self, file: str) -> None:
        """Note an input that may be replaced."""
        self._rewritten.add(os.path.realpath(file))

    def claim(self, file: str, *, folder: bool = False) -> None:
        """Reserve the name of an output, and find out whether it can be written, before the work that leads to it.

        Parameters
        ----------
        folder : bool
            Whether it is a folder for files, which is made where it is not there.

        Raises
        ------
        InputFileError
        """
        if file == "-":
            raise InputFileError(file, "file", "standard output", "a name; './-' is one")
        place = os.path.realpath(file)
        if place in self._claimed:
            raise _twice(file)
        self._claimed.add(place)
        self.check(file, place)
        if folder:
            there = next(each for each in (Path(place), *Path(place).parents) if os.path.exists(each))
            if not there.is_dir():
                raise InputFileError(file, "file", f"{there.name} is no folder", "the name of a folder")
        if not folder and not is_device(file):
            trial = AtomicFile(file)
            try:
                trial.write(b"")
            finally:
                trial.clean()

    def check(self, file: str, place: str) -> None:
        """Refuse a file that is an input, or would become one.

        Parameters
        ----------
        file, place : str
            Its name as it was given, and without symbolic links.

        Raises
        ------
        InputFileError
        """
        if place in self._rewritten:
            return
        if _identity(place) in self._inputs:
            raise InputFileError(file, "file", "the input file itself", "another name for the output")
        folder = os.path.dirname(place)
        if folder in self._input_folders and place.endswith(".parquet"):
            raise InputFileError(file, "file", "a file in the input folder", "another folder for the output")

    def add(self, output: Output) -> None:
        """Take a complete output."""
        if output.place and any(output.place == other.place for other in self._written):
            raise _twice(output.file)
        self._written.append(output)

    def commit(self) -> None:
        """Publish what was written until now: all of it, or nothing."""
        # What was read since it was written counts, too; standard output comes last, since its reader may leave.
        outputs = sorted(self._written, key=lambda output: not output.place)
        begun: list[Output] = []
        before = len(self.completed)
        try:
            for output in outputs:
                if output.place:
                    self.check(output.file, output.place)
            for output in outputs:
                begun.append(output)
                output.publish(undoable=True)
                if output.place:
                    self.completed.append(output.file)
            self._folders = []
        except BrokenPipeError:  # no fault of the files, which are complete
            self._folders = []
            raise
        except BaseException:
            del self.completed[before:]
            for output in reversed(begun):
                output.undo()
            raise
        self._clean()

    def _clean(self) -> None:
        for output in self._written:
            output.clean()
        self._written = []

    def folder_made(self, *folders: Path) -> None:
        """Note new folders, the innermost first, which go again where the files do not appear."""
        self._folders[:0] = folders


def _identity(file: str) -> tuple[int, int] | None:
    """Return what is the same for all names of a file; None where there is no file, or a device."""
    with contextlib.suppress(OSError, ValueError):
        status = os.stat(file)
        if stat.S_ISREG(status.st_mode):
            return status.st_dev, status.st_ino
    return None


def _twice(file: str) -> InputFileError:
    return InputFileError(file, "file", "the name of two outputs", "a name for each")


def publish_outputs() -> None:
    """Publish what was written until now in the `OutputSet` around, if there is one: what comes may fail or be cut."""
    if (around := _outputs.get()) is not None:
        around.commit()


@contextlib.contextmanager
def written_at_once() -> Iterator[None]:
    """Let each file of the block appear as soon as it is complete, as where no `OutputSet` is around."""
    token = _outputs.set(None)
    try:
        yield
    finally:
        _outputs.reset(token)


class AtomicFile(Output):
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
        self.place = self._part = self._before = ""
        self._was_there = False
        self._descriptor = -1

    def open(self) -> IO[bytes]:
        """Open for writing; the caller closes it."""
        try:
            if self._device:
                return open(self.file, "wb")
            self.place = os.path.realpath(self.file)
            if os.path.isdir(self.place) or not os.path.basename(self.file):
                raise InputFileError(self.file, "file", "a folder", "the name of a file")
            if (around := _outputs.get()) is not None:
                around.check(self.file, self.place)
            if os.path.exists(self.place) and not (
                os.access(self.place, os.W_OK) and os.stat(self.place).st_mode & 0o222
            ):  # a superuser may write to it, too, but it was made so on purpose
                raise PermissionError(errno.EACCES, "it is read-only")
            folder, name = os.path.split(self.place)
            self._part, self._descriptor = _locked(
                os.path.join(folder, f".{name[:80]}.rodgen-"),
                lambda part: os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o666),
            )
            if os.path.exists(self.place):
                shutil.copymode(self.place, self._part)
            return open(os.dup(self._descriptor), "wb")
        except BaseException as error:
            self.clean()
            if isinstance(error, OSError | ValueError) and not isinstance(error, InputFileError):
                raise unwritable(self.file, error) from None
            raise

    def publish(self, *, undoable: bool = False) -> None:
        """Give the file its name."""
        with self.located():
            if not self._device:
                _synchronise(self._descriptor)
                self._was_there = os.path.exists(self.place)
                if undoable and self._was_there:
                    self._before = f"{self._part}-before"
                    try:
                        os.link(self.place, self._before)
                    except OSError:  # a disk without hard links
                        shutil.copy2(self.place, self._before)
                if sys.platform == "win32":  # where an open file keeps its name
                    self._close()
                os.replace(self._part, self.place)

    def undo(self) -> None:
        """Bring back what stood there before: the other file, or none."""
        if not self._part or os.path.exists(self._part):
            return
        with contextlib.suppress(OSError):
            if self._was_there:
                os.replace(self._before, self.place)
            else:
                os.unlink(self.place)

    def write(self, content: bytes) -> None:
        """Write all of the content under the temporary name."""
        stream = self.open()
        with self.located(), stream:
            stream.write(content)

    def clean(self) -> None:
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


class _NewFolder(Output):
    """A folder that has a temporary name until it is complete."""

    def __init__(self, file: str) -> None:
        self.file, self.place = file, os.path.abspath(file)
        self._stack = contextlib.ExitStack()
        self._made = Path()

    def open(self) -> Path:
        """Make it, under its temporary name."""
        parent, name = os.path.split(self.place)
        with self.located():
            self._made = self._stack.enter_context(temporary_folder(Path(parent), f".{name}.")) / "made"
            self._made.mkdir()
        return self._made

    def publish(self, *, undoable: bool = False) -> None:
        with self.located():
            self._made.rename(self.place)

    def undo(self) -> None:
        if not self._made.exists():
            with contextlib.suppress(OSError):
                os.rename(self.place, self._made)

    def clean(self) -> None:
        self._stack.close()


@contextlib.contextmanager
def new_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a folder for files that appear together: it takes its name when the block ends without an error.

    Raises
    ------
    InputFileError
        When something has this name already, or it cannot be written.
    """
    file = os.fspath(path)
    if os.path.lexists(file):
        raise InputFileError(file, "file", "is there already", "the name of a new folder")
    folder = _NewFolder(file)
    try:
        made = folder.open()
        with written_at_once(), folder.located():
            yield made
        folder.commit()
    finally:
        folder.discard()


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
    paths = {name: folder / name for name in sorted(files)}
    with OutputSet():
        for parent in dict.fromkeys((folder, *(path.parent for path in paths.values()))):
            make_folder(parent)
        for name, path in paths.items():
            write_file(path, files[name].encode())
    return list(paths.values())


def make_folder(folder: str | os.PathLike[str]) -> None:
    """Make a folder, and those that it is in; they go again where the `OutputSet` around fails.

    Raises
    ------
    InputFileError
        When it cannot be made.
    """
    path = Path(folder)
    try:
        if (around := _outputs.get()) is not None:
            around.folder_made(*(each for each in (path, *path.parents) if not each.exists()))
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        found = f"no folder can be made ({_reason(error)})"
        raise InputFileError(path, "file", found, "a writable place") from None
