"""What users install: built with whatever flags, in a wheel, with and without a compiler."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CHECK = ROOT / "supply" / "check_extension.py"
HARMFUL = "-ffast-math -funsafe-math-optimizations -fno-signed-zeros"
needs_gcc = pytest.mark.skipif(
    not all(map(shutil.which, ("gcc", "cmake", "ninja"))), reason="needs gcc, cmake and ninja"
)


def run(*command: object, **environment: str) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    return subprocess.run(
        words, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )


def configured(folder: Path, flags: str, *options: str) -> None:
    command = ["cmake", "-G", "Ninja", "-S", ROOT, "-B", folder, f"-DPython_EXECUTABLE={sys.executable}"]
    done = run(*command, "-DCMAKE_BUILD_TYPE=Release", *options, CC="gcc", CFLAGS=flags)
    assert done.returncode == 0, done.stderr


def test_the_installed_extension_computes_what_numpy_computes() -> None:
    spec = importlib.util.find_spec("rodgen._gufuncs")
    if spec is None:
        pytest.skip("no compiled kernels")
    done = run(sys.executable, CHECK, spec.origin)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@needs_gcc
def test_an_extension_built_with_such_flags_is_right_and_a_wrong_one_is_not_installed(tmp_path: Path) -> None:
    configured(tmp_path, HARMFUL)
    done = run("ninja", "-C", tmp_path)
    assert done.returncode == 0, done.stdout  # it ends with check_extension.py
    # what GCC's linker adds for -ffast-math, which sets subnormal numbers to zero in the whole process
    culprit = run("gcc", "-print-file-name=crtfastmath.o").stdout.strip()
    configured(tmp_path, HARMFUL, f"-DCMAKE_MODULE_LINKER_FLAGS={culprit}")
    done = run("ninja", "-C", tmp_path, CFLAGS=HARMFUL)
    assert done.returncode != 0
    assert "not installed: it sets subnormal numbers to zero in the whole process" in done.stdout
    assert f"CFLAGS is {HARMFUL!r}: install without it." in done.stdout


def test_other_numbers_than_those_of_numpy_are_not_installed(tmp_path: Path) -> None:
    """A stand-in for an extension that a compiler has spoilt: the NumPy modules with one wrong constant."""
    folder = tmp_path / "rodgen"
    shutil.copytree(ROOT / "generated", folder / "generated")
    shutil.copytree(ROOT / "supply", folder / "supply")
    module = folder / "generated" / "numpy" / "rotations.py"
    text = module.read_text(encoding="utf-8")
    assert "= 0.5*factor" in text
    module.write_text(text.replace("= 0.5*factor", "= 0.50000001*factor", 1), encoding="utf-8")
    spec = importlib.util.find_spec("rodgen._gufuncs")
    if spec is None:
        pytest.skip("no compiled kernels")
    done = run(sys.executable, folder / "supply" / CHECK.name, spec.origin)
    assert done.returncode != 0
    assert "not installed: rotate gives" in done.stderr
