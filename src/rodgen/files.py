"""Write files that are either complete or not there."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
from typing import IO

from rodgen.errors import InputFileError

__all__ = ["AtomicFile", "is_device", "write_file"]


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
        if not self._device:
            os.replace(self._part, self._final)

    def discard(self) -> None:
        """Remove the temporary file, if there is one."""
        if self._part:
            with contextlib.suppress(OSError):
                os.unlink(self._part)

    def error(self, error: BaseException) -> Exception:
        """Return the error that says why the file cannot be written."""
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


def write_file(file: str | os.PathLike[str], content: bytes) -> None:
    """Write all of `content` to `file`, or nothing.

    Raises
    ------
    InputFileError
        When the place cannot be written.
    """
    target = AtomicFile(os.fspath(file))
    stream = target.open()
    try:
        with stream:
            stream.write(content)
        target.commit()
    except OSError as error:
        raise target.error(error) from None
    finally:
        target.discard()
