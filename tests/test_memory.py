"""No call of compiled code touches memory that is not its own, whatever size is zero or one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import degenerate_calls
import pytest

PROGRAM = Path(degenerate_calls.__file__)
CHECKED_HEAP = {
    "RODGEN_CPU": "",
    "LD_PRELOAD": "libc_malloc_debug.so.0",
    "MALLOC_CHECK_": "3",
    "MALLOC_PERTURB_": "165",
}
"""The GNU C library ends a process that wrote beyond a block of the heap; others ignore it."""


def run(environment: dict[str, str], cache: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run all calls with memory from the C library, which NumPy and Python else share out by themselves."""
    return subprocess.run(
        [*command, sys.executable, str(PROGRAM)],
        env={**os.environ, "PYTHONMALLOC": "malloc", "RODGEN_CACHE": str(cache), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.thorough
@pytest.mark.usefixtures("compiler")
def test_calls_of_every_size_leave_the_heap_as_it_is(tmp_path: Path) -> None:
    done = run(CHECKED_HEAP, tmp_path)
    assert (done.returncode, done.stdout) == (0, f"{len(degenerate_calls.CALLS)}\n"), done.stderr[-3000:]


LOADER = "{{\n   {kind}\n   Memcheck:{kind}\n   fun:strncmp\n   fun:is_dst\n   ...\n}}\n"
"""What the GNU loader itself reads too far, eight bytes at a time, while it looks for a library."""


@pytest.mark.slow
@pytest.mark.usefixtures("compiler")
def test_valgrind_finds_nothing_in_calls_of_every_size(tmp_path: Path) -> None:
    """Valgrind has no AVX-512, and of what Python itself does it need not tell."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("no valgrind")
    known = tmp_path / "known"
    known.write_text("".join(LOADER.format(kind=kind) for kind in ("Addr8", "Addr16", "Addr32")))
    environment = {"RODGEN_CPU": "baseline", "OPENBLAS_CORETYPE": "Haswell"}
    options = ["-q", "--error-exitcode=99", "--undef-value-errors=no", f"--suppressions={known}"]
    done = run(environment, tmp_path / "cache", valgrind, *options)
    assert (done.returncode, done.stdout) == (0, f"{len(degenerate_calls.CALLS)}\n"), done.stderr[-3000:]
