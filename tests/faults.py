"""Let the operations of a command fail, one after the other, as curl's torture tests do.

Counted are operations on files below one folder and on standard output. One may also be where Ctrl-C is pressed.
"""

from __future__ import annotations

import builtins
import contextlib
import errno
import io
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rodgen.cli.main import main

ERRORS = {
    "open to read": errno.EIO,
    "open to write": errno.EACCES,
    "read": errno.EIO,
    "write": errno.ENOSPC,
    "close": errno.EDQUOT,
    "fsync": errno.EIO,
    "replace": errno.EXDEV,
    "unlink": errno.EIO,
    "mkdir": errno.EROFS,
    "chmod": errno.EPERM,
}
"""The operations, and what they fail with."""


@dataclass(frozen=True)
class Fault:
    """The operation that fails, as a number from 0."""

    at: int
    error: type[BaseException] = OSError


class Operations:
    """What a command does below a folder, in order, and the fault that happens to it."""

    def __init__(self, root: Path, fault: Fault | None = None) -> None:
        self.root = os.path.realpath(root)
        self.fault = fault
        self.done: list[str] = []

    def count(self, what: str) -> None:
        """Note an operation; raise where it is the one that fails."""
        self.done.append(what)
        if self.fault is not None and len(self.done) == self.fault.at + 1:
            if self.fault.error is not OSError:
                raise self.fault.error
            code = ERRORS[what.partition(":")[0]]
            raise OSError(code, os.strerror(code))

    def _here(self, path: Any) -> bool:
        return isinstance(path, str | os.PathLike) and os.path.abspath(os.fspath(path)).startswith(self.root)

    @contextlib.contextmanager
    def watched(self) -> Iterator[Operations]:
        """Count the operations of the block, and let them fail."""
        with pytest.MonkeyPatch.context() as patch:
            self._patch(patch)
            yield self

    def _patch(self, patch: pytest.MonkeyPatch) -> None:
        plain, os_open = builtins.open, os.open

        def opened(file: Any, mode: str = "r", *others: Any, **more: Any) -> Any:
            ours = self._here(file) or (isinstance(file, int) and self._here(_path_of(file)))
            if ours:
                self.count(f"open to {'write' if set(mode) & set('wax+') else 'read'}: {file}")
            stream = plain(file, mode, *others, **more)
            return Stream(stream, self) if ours else stream

        def os_opened(path: Any, flags: int, *others: Any, **more: Any) -> int:
            if self._here(path):
                writing = flags & (os.O_WRONLY | os.O_RDWR)
                self.count(f"open to {'write' if writing else 'read'}: {path}")
            return os_open(path, flags, *others, **more)

        patch.setattr(builtins, "open", opened)
        patch.setattr(io, "open", opened)
        patch.setattr(os, "open", os_opened)
        for name in ("replace", "unlink", "mkdir", "chmod"):
            patch.setattr(os, name, self._counted(name, getattr(os, name), self._here))
        patch.setattr(os, "fsync", self._counted("fsync", os.fsync, lambda fd: self._here(_path_of(fd))))

    def _counted(self, kind: str, function: Any, ours: Callable[[Any], bool] = lambda _: True) -> Any:
        def counted(*arguments: Any, **more: Any) -> Any:
            first = arguments[0] if arguments else None
            if ours(first):
                self.count(f"{kind}: {first}")
            return function(*arguments, **more)

        return counted


def _path_of(descriptor: Any) -> str:
    try:
        return os.readlink(f"/proc/self/fd/{descriptor}")
    except OSError:
        return ""


class Stream:
    """A file whose reads, writes and closing are counted."""

    def __init__(self, stream: Any, operations: Operations) -> None:
        self._stream = stream
        self._operations = operations

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._stream, name)
        kind = {"read": "read", "readinto": "read", "readline": "read", "write": "write"}.get(name)
        return self._operations._counted(kind, found) if kind else found

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Any]:
        self._operations.count("read")
        return iter(self._stream)

    def close(self) -> None:
        """Close, and then say that what was written has no room, as a disk over a network does."""
        closed = self._stream.closed
        self._stream.close()
        if not closed and self._stream.mode != "rb":
            self._operations.count("close: what was written")


class Out(io.BytesIO):
    """Standard output, whose writes are counted."""

    operations: Operations | None = None

    def write(self, text: Any) -> int:
        """Write as a file does."""
        if self.operations:
            self.operations.count("write: standard output")
        return super().write(text)


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, what it printed, its files, and what stayed in other folders."""

    code: int
    out: bytes
    err: str
    files: dict[str, bytes]
    strays: list[str]
    operations: Operations


class Torture:
    """A command in a folder of its own, with its input files, and old files where it writes.

    Parameters
    ----------
    folder : Path
    inputs : dict of str to bytes
    arguments : list of str
    old : list of str
        Outputs that are there before.
    """

    def __init__(self, folder: Path, inputs: dict[str, bytes], arguments: list[str], old: list[str]) -> None:
        self.folder, self.arguments = folder, arguments
        self.before = {**inputs, **dict.fromkeys(old, b"old\n")}

    def run(self, fault: Fault | None = None) -> Ended:
        """Run the command in a folder as new; the fault may happen to it."""
        for place in ("work", "temporary"):
            _empty(self.folder / place)
        for name, content in self.before.items():
            path = self.folder / "work" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return self.run_again(fault)

    def run_again(self, fault: Fault | None = None) -> Ended:
        """Run the command on what another run left."""
        operations, raw, err = Operations(self.folder, fault), Out(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(self.folder / "work")
            patch.setattr(tempfile, "tempdir", str(self.folder / "temporary"))
            patch.setattr(sys, "stdout", io.TextIOWrapper(raw, "utf-8", write_through=True))
            patch.setattr(sys, "stderr", err)
            raw.operations = operations
            with operations.watched():
                code = main(self.arguments)
            raw.operations = None
            out = b"" if raw.closed else raw.getvalue()
        work = self.folder / "work"
        files = {str(path.relative_to(work)): path.read_bytes() for path in work.rglob("*") if path.is_file()}
        return Ended(
            code,
            out,
            err.getvalue(),
            files,
            [p.name for p in (self.folder / "temporary").rglob("*")],
            operations,
        )

    def check(self, good: Ended, found: Ended) -> None:
        """Assert that a command to which a fault happened did all or nothing, and said so."""
        fault, failed = found.operations.fault, found.operations.done[found.operations.fault.at]
        said = f"{failed} ({fault}): exit code {found.code}\n{found.err}"
        own = found.err.splitlines()
        for line in good.err.splitlines():
            if line in own:
                own.remove(line)
        expected = {OSError: (good.code, 2), KeyboardInterrupt: (130,)}[fault.error]
        assert found.code in expected, said
        assert len(own) == 1 or (len(own) == 0 and found.code == good.code), said
        cleaning = failed.startswith("unlink")
        strays = [name for name in found.files if name not in good.files] + found.strays
        assert cleaning or strays == [], said
        if found.code == good.code:
            whole = {name: content for name, content in found.files.items() if name in good.files}
            assert whole == good.files, said
            assert found.out == good.out, said
            return
        if found.code == 2:
            assert found.out in (b"", good.out) or "standard output" in found.err, said
        for name, content in good.files.items():
            now, old = found.files.get(name), self.before.get(name)
            assert now in (old, content), f"{name} is neither old nor new; {said}"
            if now != old and not cleaning:
                assert name in found.err.partition("complete: ")[2], f"{name} is new; {said}"


def _empty(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
