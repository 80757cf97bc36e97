"""Compiles a translation unit that ends in one loop over N, and calls it through ctypes."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
from pathlib import Path

from environments import BUILD, run
from problem import Problem

from contenders.base import Call, Contender, UnavailableError

STRICT = ("-O3", "-march=native")
FAST = (*STRICT, "-ffast-math")

# __restrict__: the caller promises that the answer does not overlap the input, as NumPy does to a gufunc.
LOOP_SIGNATURE = (
    "solve_many(long n, const double* __restrict__ rho, const double* __restrict__ rho_prime, "
    "const double* __restrict__ angle, double* __restrict__ axes)"
)


def compiler(language: str) -> str:
    """Name of the compiler for "c" or "c++"; the CC and CXX variables choose another."""
    variable, names = {"c": ("CC", ("gcc", "clang", "cc")), "c++": ("CXX", ("g++", "clang++", "c++"))}[
        language
    ]
    for name in (os.environ.get(variable), *names):
        if name and shutil.which(name):
            return name
    raise UnavailableError(f"no {language} compiler found (tried ${variable}, {', '.join(names)})")


def shared_library(
    name: str, source: str, language: str, flags: tuple[str, ...], includes: tuple[Path, ...] = ()
):
    """Compile ``source`` once and load it."""
    tool = compiler(language)
    options = [
        *flags,
        *(f"-I{folder}" for folder in includes),
        *(["-std=c++17"] if language == "c++" else []),
    ]
    digest = hashlib.sha256(repr((source, tool, options)).encode()).hexdigest()[:16]
    folder = BUILD / "native"
    folder.mkdir(parents=True, exist_ok=True)
    library = folder / f"{name}-{digest}.so"
    if not library.exists():
        code = folder / f"{name}-{digest}.{'cpp' if language == 'c++' else 'c'}"
        code.write_text(source)
        unit = code.with_suffix(".o")
        run([tool, *options, "-fno-semantic-interposition", "-fPIC", "-c", code, "-o", unit])
        # Linked without the flags: with -ffast-math gcc would link a start-up file that
        # switches subnormals off for the whole process, for every contender.
        run([tool, "-shared", unit, "-o", library, "-lm"])
    return ctypes.CDLL(str(library))


def contender(
    name: str,
    source: str,
    language: str,
    note: str,
    *,
    fast: bool = False,
    includes: tuple[Path, ...] = (),
) -> Contender:
    """Make a contender of a source that defines `LOOP_SIGNATURE` with C linkage."""
    stem = "".join(c if c.isalnum() else "_" for c in name.lower())
    function = shared_library(stem, source, language, FAST if fast else STRICT, includes).solve_many
    function.argtypes = (ctypes.c_long, *[ctypes.c_void_p] * 4)
    function.restype = None

    def bind(problem: Problem) -> Call:
        arrays = (problem.rho, problem.rho_prime, problem.angle, problem.axes)
        arguments = (len(problem), *(array.ctypes.data for array in arrays))
        return lambda: function(*arguments)

    flags = " ".join(FAST if fast else STRICT)
    return Contender(
        name + (", -ffast-math" if fast else ""), "C/C++", bind, f"{note}; {flags}", strict=not fast
    )
