"""The user's cache of compiled libraries and generated text. Needs no SymPy.

The name of a kept file is a hash of everything that its bytes depend on. A file gets its name only when it is complete,
so that several processes may make the same one at once.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import hashlib
import json
import os
import platform
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rodgen import limits
from rodgen.array_types import Array
from rodgen.stages import stage

Command = tuple[str, ...]

_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_MOST_BYTES = 1 << 28


ARITHMETIC_GUARD = """\
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || __FINITE_MATH_ONLY__ + 0
#error "compile without -ffast-math and its parts: this code tests for NaN, and its sums are in an order that matters"
#endif"""
"""Is in every C source: a compiler that is told to change arithmetic makes no program."""

AS_WRITTEN = ("-fno-fast-math", "-fno-unsafe-math-optimizations")
"""Undo such flags. GCC's linker looks at each by itself: one that stands makes it add code that sets subnormal numbers
to zero in the whole process."""


class CompilerError(Exception):
    """No compiled library could be made or loaded; the message says why."""


@functools.cache
def notice(reason: str) -> None:
    """Warn once for each reason."""
    warnings.warn(
        f"kernels that are made at run time run on NumPy, not in C: {reason}",
        RuntimeWarning,
        stacklevel=4,
    )


# the compiler ----------------------------------------------------------------------------------------------


def compiler() -> Command:
    """Return the command of the compiler: what ``CC`` names, else cc, gcc or clang."""
    chosen = os.environ.get("CC", "").strip()
    for command in [chosen] if chosen else ["cc", "gcc", "clang"]:
        try:
            words = shlex.split(command)
        except ValueError as error:  # a quotation mark without its partner
            raise CompilerError(f"CC holds {chosen!r}, which is no command ({error})") from None
        program = shutil.which(words[0]) if words else None
        if program:
            return (os.path.abspath(program), *words[1:])  # it runs in another folder
    if chosen:
        raise CompilerError(f"CC names the compiler {chosen!r}, which is not found")
    raise CompilerError("no C compiler is found (cc, gcc or clang); install one, or name one in CC")


@functools.cache
def compiler_version(command: Command) -> str:
    """Return the compiler's version message: the same command may be another compiler tomorrow."""
    return _run([*command, "--version"]).stdout


@functools.cache
def native_flag(command: Command) -> tuple[str, str]:
    """Return the flag with which the compiler uses all instructions of this processor, and the macros it then defines.

    A file in a cache that several processors share must have a name that depends on these macros. Both texts are
    empty where the compiler knows no such flag.
    """
    for flag in ("-march=native", "-mcpu=native"):
        done = _run([*command, flag, "-dM", "-E", "-x", "c", os.devnull])
        if done.returncode == 0:
            return flag, done.stdout
    return "", ""


def check_compiler(command: Command) -> None:
    """Compile a few lines of C into a library and load it; nothing is kept.

    Raises
    ------
    CompilerError
        When it fails, and why.
    """
    source = f"{ARITHMETIC_GUARD}\n#include <math.h>\ndouble half_turn(double x) {{ return fmod(x + 3.0, 6.0); }}\n"
    try:
        with _temporary_folder() as folder:
            library = Path(folder) / "check.so"
            _build(command, ("-fPIC", "-shared"), {"kernels.c": source}, library, [])
            ctypes.CDLL(str(library))
    except OSError as error:
        raise CompilerError(f"the compiled library cannot be written or loaded ({error})") from None


def _run(command: list[str], folder: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run the compiler, with its temporary files in a folder; an interrupt ends it, and the programs that it runs."""
    apart = os.name == "posix"  # in a group of its own, all of which can be ended
    how: dict[str, Any] = {
        "cwd": folder,
        "env": {**os.environ, "TMPDIR": folder} if folder else None,
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "encoding": "utf-8",
        "errors": "replace",
        **({"process_group": 0} if apart else {}),
    }
    try:
        with subprocess.Popen(command, **how) as process:
            try:
                out, errors = process.communicate(timeout=limits.COMPILE)
            except BaseException:
                if apart:
                    with contextlib.suppress(ProcessLookupError):  # it has just ended
                        os.killpg(process.pid, signal.SIGKILL)
                process.kill()
                raise
            return subprocess.CompletedProcess(command, process.returncode, out, errors)
    except subprocess.TimeoutExpired as error:
        raise CompilerError(f"{command[0]} does not end in {error.timeout:g} s") from None
    except (OSError, subprocess.SubprocessError) as error:
        raise CompilerError(f"{command[0]} does not run ({error})") from None


# the cache -------------------------------------------------------------------------------------------------


def cache_folder() -> Path:
    """Return where compiled kernels are kept: ``RODGEN_CACHE``, else the platform's place for caches."""
    if os.environ.get("RODGEN_CACHE"):
        return Path(os.environ["RODGEN_CACHE"])
    if os.environ.get("LOCALAPPDATA") and sys.platform == "win32":
        return Path(os.environ["LOCALAPPDATA"]) / "rodgen" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "rodgen"
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"]) / "rodgen"
    return Path.home() / ".cache" / "rodgen"


def _temporary_folder(
    prefix: str = "rodgen-kernels-", parent: Path | None = None
) -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True)


@functools.cache
def _folder_of_this_process() -> Path:
    stack = contextlib.ExitStack()
    atexit.register(stack.close)
    return Path(stack.enter_context(_temporary_folder()))


def cache_problem() -> str | None:
    """Return why the cache is not used, or None where it is; the folder is made where there is none."""
    try:
        folder = cache_folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()
    except (OSError, RuntimeError) as error:  # no home, a file in its place, a full or read-only disk
        return f"it cannot be made ({getattr(error, 'strerror', None) or error})"
    if hasattr(os, "getuid") and about.st_uid != os.getuid():
        return "it belongs to another user"
    if about.st_mode & _BY_OTHERS:
        return "other users may write to it"
    return None if os.access(folder, os.W_OK) else "it cannot be written to"


def _safe_cache() -> Path:
    """Return the cache, or a folder of this process when others could put a library into the cache."""
    return cache_folder() if cache_problem() is None else _folder_of_this_process()


def _name(about: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(about).encode()).hexdigest()[:32]


@functools.cache
def source_hash(*places: Path) -> str:
    """Return a hash of the text of modules and templates, or of all in folders: another text is another key."""
    text = hashlib.sha256()
    for place in places:
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.suffix in {".py", ".j2"}:
                text.update(path.read_bytes())
    return text.hexdigest()


def shared_library(
    about: Sequence[str],
    files: Callable[[], Mapping[str, str]],
    command: Command,
    flags: Sequence[str],
    computed: Callable[[ctypes.CDLL], list[Array]],
    expected: Callable[[], list[Array]],
) -> ctypes.CDLL:
    """Load a library from the cache, or compile it.

    It is kept with a hash of its bytes, without which it is never loaded, and with what NumPy computes of one row. The
    library must compute that, too: a compiler told to be fast, or another processor, may make it compute otherwise.

    Parameters
    ----------
    about : sequence of str
        What the text of the files depends on; compiler, flags and platform are added to it.
    files : callable
        Returns the text of the sources by name, ``kernels.c`` among them; called when nothing is kept.
    command : tuple of str
        The compiler.
    flags : sequence of str
        Its flags.
    computed : callable
        Returns what a library computes of one row, by output.
    expected : callable
        Returns what it should compute, by other means; called when nothing is kept.

    Raises
    ------
    CompilerError
        When the library cannot be compiled, written or loaded, or computes something else; the message says why.
    """
    about = (platform.system(), platform.machine(), *command, compiler_version(command), *flags, *about)
    name = _name(about) + ".so"
    for folder in (_safe_cache, _folder_of_this_process):
        try:
            path = folder() / name
            right = _kept_row(path)
            if right is None:
                with stage("compiling"):
                    right = expected()
                    _build(command, flags, files(), path, right)
            library = ctypes.CDLL(str(path))
        except OSError as error:  # a disk that is full, or from which nothing may be run
            reason = error
            continue
        if not _agree(computed(library), right):
            _delete(path)
            raise CompilerError(
                f"what {command[0]} made computes other numbers than NumPy; see its flags in CC"
            )
        return library
    raise CompilerError(f"the compiled library cannot be written or loaded ({reason})")


def _kept_row(path: Path) -> list[Array] | None:
    """Return what a kept library should compute of one row, or None where it is not kept, or not as it was written."""
    try:
        library = _own_bytes(path)
    except FileNotFoundError:
        return None
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError, RecursionError):
        note = json.loads(_own_bytes(_note(path)) or "")
        if hashlib.sha256(library or b"").hexdigest() == note["sha256"]:
            return [np.array(output, float) for output in note["outputs"]]
    _delete(path)
    warnings.warn(
        f"{path} is not as it was written; it is deleted and made again", RuntimeWarning, stacklevel=5
    )
    return None


def _own_bytes(path: Path) -> bytes | None:
    """Return what a file of this user holds, to which no one else may write; None for what cannot be kept here.

    Raises
    ------
    FileNotFoundError
    """
    without_waiting = getattr(os, "O_NONBLOCK", 0)  # for who writes into a pipe
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | without_waiting)) as file:
        about = os.fstat(file.fileno())
        foreign = hasattr(os, "getuid") and about.st_uid != os.getuid()
        is_readable = stat.S_ISREG(about.st_mode) and about.st_size <= _MOST_BYTES
        return file.read() if is_readable and not foreign and not about.st_mode & _BY_OTHERS else None


def _note(library: Path) -> Path:
    return library.with_suffix(".json")


def _delete(library: Path) -> None:
    for path in (library, _note(library)):
        with contextlib.suppress(OSError):
            path.unlink()


def _agree(results: Sequence[Array], expected: Sequence[Array]) -> bool:
    """Return whether outputs are equal but for rounding: of a few thousand operations on numbers of their own size.

    The last part of the tolerance is for an output that is small because large numbers cancel in it.
    """
    sizes = [float(np.abs(output[np.isfinite(output)]).max(initial=0.0)) for output in expected]
    cancelled = 1e-13 * max(sizes, default=0.0)
    return [a.shape for a in results] == [b.shape for b in expected] and all(
        np.allclose(a, b, rtol=0, atol=1e-9 * size + cancelled, equal_nan=True)
        for a, b, size in zip(results, expected, sizes, strict=True)
    )


def _build(
    command: Command, flags: Sequence[str], files: Mapping[str, str], path: Path, row: Sequence[Array]
) -> None:
    """Compile in a temporary folder next to `path`, and move the finished library there, with its note."""
    with _temporary_folder("build-", path.parent) as name:
        folder = Path(name)
        for source, text in files.items():
            (folder / source).write_text(text, encoding="utf-8")
        # after the flags in CC, which they undo
        done = _run([*command, *AS_WRITTEN, *flags, "kernels.c", "-o", "kernels.so", "-lm"], str(folder))
        if done.returncode != 0:
            lines = done.stderr.splitlines() or [f"exit code {done.returncode}"]
            message = next((line for line in lines if "error" in line), lines[0])
            raise CompilerError(f"{command[0]} fails: {message}")
        library = (folder / "kernels.so").read_bytes()
        note = {"sha256": hashlib.sha256(library).hexdigest(), "outputs": [output.tolist() for output in row]}
        _keep(folder / "note.json", json.dumps(note).encode(), _note(path))
        _keep(folder / "kernels.so", library, path)


def _keep(part: Path, content: bytes, path: Path) -> None:
    """Write a file that only this user may read or write, and give it its name when all of it is on the disk."""
    part.unlink(missing_ok=True)
    with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def cached_text(about: Sequence[str], make: Callable[[], str]) -> str:
    """Return a text from the cache, or make it; if the cache cannot be written, the text is not kept.

    Its first line is a hash of the rest, without which it is not used.
    """
    path = _safe_cache() / (_name(about) + ".py")
    with contextlib.suppress(OSError):
        first, _, rest = (_own_bytes(path) or b"").partition(b"\n")
        if first.decode("ascii", "replace") == hashlib.sha256(rest).hexdigest():
            return rest.decode("utf-8")
    text = make()
    content = text.encode()
    with contextlib.suppress(OSError), _temporary_folder("build-", path.parent) as folder:
        whole = hashlib.sha256(content).hexdigest().encode() + b"\n" + content
        _keep(Path(folder, path.name), whole, path)
    return text
