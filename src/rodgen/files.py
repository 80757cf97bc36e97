"""Read small files, and write files that are either complete or not there."""

from __future__ import annotations

import abc
import contextlib
import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from io import BufferedReader
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rodgen import limits
from rodgen.errors import InputFileError

if TYPE_CHECKING:
    import zipfile


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


def read_input(file: str, expected: str, usual: str = "", *, largest: int | None = None) -> bytes:
    """Return the content of a small file.

    Parameters
    ----------
    expected : str
        What the file should be, for error messages.
    usual : str
        What is expected instead of a larger file; left out, `expected`.
    largest : int, optional
        Largest size in bytes, whole megabytes; of a larger file no more is read. Default: `limits.FILE`.

    Raises
    ------
    InputFileError
        When it cannot be read, or is larger.
    """
    most = limits.FILE if largest is None else largest
    try:
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
    def publish(self) -> None:
        """Show the output under its name."""

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

    All of them are on the disk under temporary names before the first gets its own. Where a disk fails between two
    names, those before stay, and are `completed`. None replaces a file that was read in the block, by whatever name.
    The files of a set in the block of another one appear with those of the latter.

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
                self._around._folders[:0] = self._folders
                self._written, self._folders = [], []
            elif kind is None:
                self.commit()
        finally:
            for output in self._written:
                output.clean()
            for folder in self._folders:
                with contextlib.suppress(OSError):  # it has files that are complete
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
        elif not is_device(file):
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
        if output.place and any(output.place == written.place for written in self._written):
            raise _twice(output.file)
        self._written.append(output)

    def commit(self) -> None:
        """Publish what was written until now."""
        # What was read since it was written counts, too; standard output comes last, since its reader may leave.
        outputs = sorted(self._written, key=lambda output: not output.place)
        for output in outputs:
            if output.place:
                self.check(output.file, output.place)
        for output in outputs:
            output.publish()
            if output.place:
                self.completed.append(output.file)
        for output in outputs:
            output.clean()
        self._written, self._folders = [], []


class _AtOnce(OutputSet):
    """Files that appear one by one, in the block of another set."""

    def __init__(self, around: OutputSet) -> None:
        super().__init__()
        self.completed = around.completed

    def check(self, file: str, place: str) -> None:
        """Accept any file: what is read here, such as a state, may be written again."""

    def add(self, output: Output) -> None:
        self._written = [output]
        self.commit()


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
    """Let each file of the block appear as soon as it is complete; an `OutputSet` around counts it as `completed`."""
    around = _outputs.get()
    token = _outputs.set(around and _AtOnce(around))
    try:
        yield
    finally:
        _outputs.reset(token)


def _temporary(place: str) -> str:
    """Return a name next to a file or folder that no other has."""
    folder, name = os.path.split(place)
    return os.path.join(folder, f".{name[:50]}.rodgen-{secrets.token_hex(8)}")


class AtomicFile(Output):
    """A file that has a temporary name, in its final folder, until it is complete and on the disk.

    A device or a pipe is written directly. A symbolic link stays a link: its target is replaced. A file that is
    replaced keeps its permissions.

    Parameters
    ----------
    file : str
        The final name, as the user gave it.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._part = ""

    def open(self) -> IO[bytes]:
        """Open for writing; the caller closes it."""
        try:
            if is_device(self.file):
                return open(self.file, "wb")
            self.place = os.path.realpath(self.file)
            if os.path.isdir(self.place) or not os.path.basename(self.file):
                raise InputFileError(self.file, "file", "a folder", "the name of a file")
            if (around := _outputs.get()) is not None:
                around.check(self.file, self.place)
            mode = os.stat(self.place).st_mode if os.path.exists(self.place) else None
            if mode is not None and not (os.access(self.place, os.W_OK) and mode & 0o222):
                # a superuser may write to it, too, but it was made so on purpose
                raise PermissionError(errno.EACCES, "it is read-only")
            self._part = _temporary(self.place)
            Path(self._part).touch(exist_ok=False)
            if mode is not None:
                os.chmod(self._part, stat.S_IMODE(mode) | stat.S_IWUSR)
            return open(self._part, "wb")
        except BaseException as error:
            self.clean()
            if isinstance(error, OSError | ValueError) and not isinstance(error, InputFileError):
                raise unwritable(self.file, error) from None
            raise

    def write(self, content: bytes) -> None:
        """Write all of the content under the temporary name."""
        stream = self.open()
        with self.located(), stream:
            stream.write(content)

    def commit(self) -> None:
        """Wait until the file is on the disk, and publish it as `Output` does."""
        if self._part:
            with self.located():
                _synchronise(self._part)
        super().commit()

    def publish(self) -> None:
        """Give the file its name."""
        if self._part:
            with self.located():
                os.replace(self._part, self.place)

    def clean(self) -> None:
        """Remove what has a temporary name."""
        if self._part:
            with contextlib.suppress(OSError):
                os.unlink(self._part)


def _synchronise(file: str) -> None:
    """Wait until a file is on the disk, where the disk says so."""
    descriptor = os.open(file, os.O_WRONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


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
    part = Path(_temporary(os.path.abspath(file)))
    try:
        with written_at_once():
            part.mkdir()
            yield part
        part.rename(file)
        if (around := _outputs.get()) is not None:
            around.completed.append(file)
    except OSError as error:
        raise unwritable(file, error) from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


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
            around._folders[:0] = (each for each in (path, *path.parents) if not each.exists())
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        found = f"no folder can be made ({_reason(error)})"
        raise InputFileError(path, "file", found, "a writable place") from None
