"""The user's cache of compiled libraries and generated text. Needs no SymPy.

The name of a kept file is a hash of everything that its bytes depend on. A file gets its name only when it is complete,
so that several processes may make the same one at once.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
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

from rodgen.stages import stage

__all__ = [
    "CompilerError",
    "cache_folder",
    "cache_problem",
    "cached_text",
    "check_compiler",
    "compiler",
    "compiler_version",
    "native_flag",
    "notice",
    "shared_library",
]

Command = tuple[str, ...]


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
        words = shlex.split(command)
        found = shutil.which(words[0])
        if found:
            return (found, *words[1:])
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
    source = "#include <math.h>\ndouble half_turn(double x) { return fmod(x + 3.0, 6.0); }\n"
    with tempfile.TemporaryDirectory(prefix="rodgen-", ignore_cleanup_errors=True) as folder:
        library = Path(folder) / "check.so"
        try:
            _build(command, ("-fPIC", "-shared"), {"kernels.c": source}, library)
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
        "text": True,
        **({"process_group": 0} if apart else {}),
    }
    try:
        with subprocess.Popen(command, **how) as process:
            try:
                out, errors = process.communicate(timeout=600)
            except BaseException:
                if apart:
                    with contextlib.suppress(ProcessLookupError):  # it has just ended
                        os.killpg(process.pid, signal.SIGKILL)
                process.kill()
                raise
            return subprocess.CompletedProcess(command, process.returncode, out, errors)
    except subprocess.TimeoutExpired as error:
        raise CompilerError(f"{command[0]} does not end ({error})") from None
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


@functools.cache
def _folder_of_this_process() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="rodgen-")


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
    if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return "other users may write to it"
    return None if os.access(folder, os.W_OK) else "it cannot be written to"


def _safe_cache() -> Path:
    """Return the cache, or a folder of this process when others could put a library into the cache."""
    return cache_folder() if cache_problem() is None else Path(_folder_of_this_process().name)


def _name(about: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(about).encode()).hexdigest()[:32]


def shared_library(
    about: Sequence[str], files: Callable[[], Mapping[str, str]], command: Command, flags: Sequence[str]
) -> ctypes.CDLL:
    """Load a library from the cache, or compile it.

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

    Raises
    ------
    CompilerError
        When the library cannot be compiled, written or loaded; the message says why.
    """
    about = (platform.system(), platform.machine(), *command, compiler_version(command), *flags, *about)
    name = _name(about) + ".so"
    for folder in (_safe_cache(), Path(_folder_of_this_process().name)):
        path = folder / name
        try:
            if path.exists():
                return ctypes.CDLL(str(path))
        except OSError:
            pass  # not a library: a disk that was full, say; it is made anew
        try:
            with stage("compiling"):
                _build(command, flags, files(), path)
            return ctypes.CDLL(str(path))
        except OSError as error:  # a disk that is full, or from which nothing may be run
            reason = error
    raise CompilerError(f"the compiled library cannot be written or loaded ({reason})")


def _build(command: Command, flags: Sequence[str], files: Mapping[str, str], path: Path) -> None:
    """Compile in a temporary folder next to `path`, and move the finished library there."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix="build-") as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        done = _run([*command, *flags, "kernels.c", "-o", "kernels.so", "-lm"], folder)
        if done.returncode != 0:
            lines = done.stderr.splitlines() or [f"exit code {done.returncode}"]
            said = next((line for line in lines if "error" in line), lines[0])
            raise CompilerError(f"{command[0]} fails: {said}")
        os.replace(Path(folder) / "kernels.so", path)


def cached_text(about: Sequence[str], make: Callable[[], str]) -> str:
    """Return a text from the cache, or make it; if the cache cannot be written, the text is not kept."""
    path = _safe_cache() / (_name(about) + ".py")
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        text = make()
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix="build-") as folder:
            part = Path(folder) / path.name
            part.write_text(text, encoding="utf-8")
            os.replace(part, path)
    except OSError:
        pass
    return text
