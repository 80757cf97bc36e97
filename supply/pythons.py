"""Build and use wheels for the Pythons, NumPys and compilers that rodgen promises: `make pythons`.

What is not on this machine is skipped, and said. A Python is looked for as `python3.12` on PATH and among those of
pyenv.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import environments
from environments import ROOT, run

PYTHONS = ("3.11", "3.12", "3.13")
COMPILERS = ("gcc", "clang")
NUMPYS = {"2.0": "numpy==2.0.*", "newest": "numpy"}


def main() -> None:
    """Go through all combinations, and end with what was skipped."""
    skipped = []
    compilers = [compiler for compiler in COMPILERS if shutil.which(compiler)]
    skipped += [f"{compiler}: it is not on PATH" for compiler in COMPILERS if compiler not in compilers]
    with tempfile.TemporaryDirectory(prefix="rodgen-pythons-") as name:
        for version in PYTHONS:
            python = interpreter(version)
            if python is None:
                skipped.append(
                    f"Python {version}: no python{version} on PATH or of pyenv that makes environments"
                )
                continue
            numpys = {label: text for label, text in NUMPYS.items() if has_wheel(python, text)}
            skipped += [
                f"NumPy {x} with Python {version}: it has no wheel" for x in NUMPYS if x not in numpys
            ]
            for compiler in compilers:
                folder = Path(name) / f"{version}-{compiler}"
                options = ["-q", "--no-deps", "-C", f"build-dir={folder / 'build'}", "-w", folder]
                run(python, "-m", "pip", "wheel", *options, ROOT, CC=compiler)
                (wheel,) = folder.glob("*.whl")
                for label, numpy in numpys.items():
                    inside = environments.make(folder / label, python)
                    environments.install(inside, f"{wheel}[machines]", numpy)
                    print(f"{compiler}: {environments.smoke(inside, 'compiled')}", flush=True)
    print("\n".join(["Skipped:", *skipped] if skipped else ["Nothing was skipped."]))


def interpreter(version: str) -> str | None:
    """Return the command of a Python that runs and can make environments."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True)]
    for python in filter(None, found):
        test = f"import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != {tuple(map(int, version.split('.')))})"
        if subprocess.run([python, "-c", test], capture_output=True, check=False).returncode == 0:
            return str(python)
    return None


def has_wheel(python: str, requirement: str) -> bool:
    """Return whether a package that is already compiled can be had for a Python."""
    with tempfile.TemporaryDirectory() as folder:
        command = [python, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:", "-d", folder]
        return subprocess.run([*command, requirement], capture_output=True, check=False).returncode == 0


if __name__ == "__main__":
    main()
