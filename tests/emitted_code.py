"""Emitted code as users have it: compiled and run with its own test, and called row by row."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from conftest import C_WARNINGS, CPP_WARNINGS, compile_shared
from rodgen.files import write_files
from rodgen.machines.emit._content import Content, content_of
from rodgen.machines.emit._render import render
from rodgen.machines.machine import Machine

REACHED = 5e-9
COMPILERS = [c for c in ("gcc", "clang") if shutil.which(c)]


def succeeds(*command: object, **options: Any) -> str:
    """Run a program that must end well and complain of nothing; return what it prints."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    return done.stdout


def emit_both(machine: Machine, folder: Path, travel: Any = None) -> Content:
    """Do what `emit` does for C and NumPy, but derive the machine's kernels once; return what the files are made of."""
    content = content_of(machine, "device", travel)
    write_files(folder, render(content, "c") | render(replace(content, name="device_np"), "numpy"))
    return content


# own tests -----------------------------------------------------------------------------------------------------------


def passes_in_c(name: str, folder: Path, compiler: str, optimisation: str = "-O0") -> None:
    """Compile the C of a folder with its own test, and run it."""
    sources = [folder / f"{name}.c", folder / f"{name}_test.c"]
    succeeds(compiler, *C_WARNINGS, optimisation, *sources, "-o", folder / "run_c", "-lm")
    all_hold(succeeds(folder / "run_c"))


def passes_in_cpp(
    content: Content, cpp_compiler: str, folder: Path, optimisation: str = "-O0", *more: str
) -> None:
    """Write a header and its test into a folder; compile and run it, with other sources there."""
    write_files(folder, render(content, "cpp"))
    sources = [folder / name for name in (f"{content.name}_test.cpp", *more)]
    succeeds(cpp_compiler, *CPP_WARNINGS, optimisation, *sources, "-o", folder / "run_cpp")
    all_hold(succeeds(folder / "run_cpp"))


def all_hold(printed: str) -> None:
    held, checks = map(int, re.findall(r"(\d+) of (\d+) checks hold", printed)[0])
    assert held == checks >= 150


def passes_in_octave(content: Content, folder: Path) -> None:
    """Write the MATLAB class and its test into a folder, and run it where there is GNU Octave."""
    write_files(folder, render(content, "matlab"))
    if shutil.which("octave-cli"):
        done = in_octave(folder, f"{content.name}_test")
        assert (done.returncode, done.stdout) == (0, f"{content.name}: all tests hold\n"), done.stderr


def in_octave(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run statements in a folder, in a process of their own: Octave reads a class once."""
    command = ["octave-cli", "--norc", "--quiet", "--eval", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def passes_in_python(name: str, folder: Path) -> None:
    """Run the test of a module in a Python that has neither rodgen nor SymPy."""
    code = "import sys; sys.modules['rodgen'] = sys.modules['sympy'] = None; import runpy, warnings\n"
    code += f"warnings.simplefilter('error'); sys.path.insert(0, {str(folder)!r})\n"
    code += f"runpy.run_path({str(folder / f'test_{name}.py')!r}, run_name='__main__')"
    assert succeeds(sys.executable, "-c", code) == f"{name}: all tests hold\n"


# calls ---------------------------------------------------------------------------------------------------------------


def loaded(folder: Path, name: str = "device_np") -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{name}_{abs(hash(folder))}", folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Functions:
    """The functions of a machine in a library, called row by row; a place has so many numbers."""

    def __init__(self, library: ctypes.CDLL, name: str, numbers: int = 3) -> None:
        self.function = lambda what: getattr(library, f"{name}_{what}")
        self.numbers = numbers

    def rows(self, q: Any, conditions: Mapping[str, np.ndarray]) -> np.ndarray:
        q = np.atleast_2d(q)
        columns = [np.asarray(c, float).reshape(len(q), -1) for c in conditions.values()]
        return np.ascontiguousarray(np.hstack([q, *columns]))

    @staticmethod
    def at(array: np.ndarray | None) -> Any:
        return None if array is None else array.ctypes.data_as(ctypes.c_void_p)

    def forward(self, q: Any, target: Any, conditions: Mapping[str, np.ndarray]) -> np.ndarray:
        rows = self.rows(q, conditions)
        places = np.empty((len(rows), self.numbers))
        for row, t, place in zip(rows, np.broadcast_to(target, len(rows)), places, strict=True):
            self.function("forward")(self.at(row), int(t), self.at(place))
        return places

    def jacobian(
        self, q: Any, target: Any, conditions: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        rows, joints = self.rows(q, conditions), np.atleast_2d(q).shape[1]
        places, slopes = np.empty((len(rows), self.numbers)), np.empty((len(rows), self.numbers, joints))
        targets = np.broadcast_to(target, len(rows))
        for row, t, place, slope in zip(rows, targets, places, slopes, strict=True):
            self.function("jacobian")(self.at(row), int(t), self.at(place), self.at(slope))
        return places, slopes

    def compensate(
        self, wanted: Any, q: Any, target: Any, conditions: Mapping[str, np.ndarray], weight: Any = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows, q = self.rows(q, conditions), np.atleast_2d(q)
        wanted = np.asarray(wanted, float)
        wanted = np.ascontiguousarray(np.broadcast_to(wanted, (len(rows), wanted.shape[-1])))
        weight = None if weight is None else np.ascontiguousarray(weight, float)
        corrected, status, distance = np.empty(q.shape), np.empty(len(rows), int), np.empty(len(rows))
        for i, (row, t) in enumerate(zip(rows, np.broadcast_to(target, len(rows)), strict=True)):
            arguments = self.at(row), int(t), self.at(wanted[i]), self.at(weight), self.at(corrected[i])
            status[i] = self.function("compensate")(*arguments, self.at(distance[i : i + 1]))
        return corrected, status, distance


class Compiled(Functions):
    """The emitted C of a folder."""

    def __init__(self, compiler: str, folder: Path, name: str = "device") -> None:
        file = compile_shared(compiler, [folder / f"{name}.c"], folder / f"{name}.so", "-O1")
        super().__init__(ctypes.CDLL(str(file)), name)
