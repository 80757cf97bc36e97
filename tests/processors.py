"""Run the tests as on other processors: what is rounded otherwise must not decide whether they pass.

    python tests/processors.py WHICH -m pytest ...

`WHICH` is the name of one of `SETTINGS`, `all`, or the hash of a commit, which draws one. What this processor lacks is
skipped with a notice.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Setting:
    """How linear algebra, NumPy's loops and rodgen's loops are chosen."""

    blas: str | None
    """Processor for which OpenBLAS takes its routines; None: that of the environment."""
    threads: int
    without: tuple[str, ...]
    """How the names begin of instruction sets that NumPy's loops must not use."""
    level: str
    """Of rodgen's own loops: `RODGEN_CPU`."""
    needs: tuple[str, ...] = ()
    """How the names of instruction sets begin one of which this processor must have."""


AVX512 = ("X86_V4", "AVX512")
AVX2 = ("X86_V3", "AVX2", "FMA3")  # from NumPy 2.4, and before
SETTINGS = {
    "haswell": Setting("Haswell", 1, AVX512, "avx2", AVX2),
    "skylakex": Setting("SkylakeX", 1, (), "avx512", AVX512),
    "zen": Setting("Zen", 2, AVX512, "avx2", AVX2),
    "prescott": Setting("Prescott", 1, AVX512 + AVX2, "baseline"),
    "numpy": Setting(None, 1, (), "numpy"),  # where no C compiler was
}
"""Every OpenBLAS family, each level of NumPy's and of rodgen's loops, one thread and two."""


def instruction_sets() -> list[str]:
    """Return what NumPy can choose from on this processor."""
    return np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])


def environment(setting: Setting) -> dict[str, str]:
    off = " ".join(
        name for name in instruction_sets() if setting.without and name.startswith(setting.without)
    )
    chosen = {
        "OPENBLAS_CORETYPE": setting.blas or "",
        "OPENBLAS_NUM_THREADS": str(setting.threads),
        "OPENBLAS_THREAD_TIMEOUT": "4" * (setting.threads > 1),  # a thread that waits gives its core away
        "NPY_DISABLE_CPU_FEATURES": off,
        "RODGEN_CPU": setting.level,
    }
    return {name: value for name, value in chosen.items() if value}


def missing(setting: Setting) -> str | None:
    """Say why this processor cannot stand for that of a setting."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return f"a processor of type {platform.machine()}"
    if setting.needs and not any(name.startswith(setting.needs) for name in instruction_sets()):
        return f"no {setting.needs[0]}"
    return None


def run(name: str, command: list[str]) -> int | None:
    """Run Python with a command as on another processor; return the exit code, or None where it was skipped."""
    setting = SETTINGS[name]
    why = missing(setting)
    if why is not None:
        print(f"Skipped {name}: {why}.", flush=True)
        return None
    chosen = environment(setting)
    print(f"As {name}: {' '.join(f'{key}={value!r}' for key, value in chosen.items())}", flush=True)
    return subprocess.run([sys.executable, *command], env={**os.environ, **chosen}, check=False).returncode


def main(which: str, *command: str) -> int:
    if which in SETTINGS:
        return run(which, list(command)) or 0
    if which != "all":
        there = [name for name, setting in SETTINGS.items() if missing(setting) is None] or [*SETTINGS]
        return run(there[int(which, 16) % len(there)], list(command)) or 0
    codes = {name: run(name, list(command)) for name in SETTINGS}
    for name, code in codes.items():
        print(f"{name:<10}{'skipped' if code is None else 'passed' if code == 0 else 'FAILED'}")
    return int(any(codes.values()))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
