"""Run commands and make environments for what `make wheel` and `make pythons` check."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SMOKE = ROOT / "supply" / "smoke.py"


def run(*command: object, **environment: str) -> str:
    """Run a command outside the checkout and return its output; when it fails, print that and stop.

    `environment` has variables that the command gets besides those of this process.
    """
    words = [str(word) for word in command]
    done = subprocess.run(
        words,
        cwd=ROOT.parent if ROOT.parent != ROOT else None,
        env={**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{done.stdout}\n{' '.join(words)}: exit code {done.returncode}")
    return done.stdout


def make(folder: Path, python: object = sys.executable) -> Path:
    """Make an environment in which nothing is installed, not even pip, and return its Python."""
    run(python, "-m", "venv", "--clear", "--without-pip", folder)
    return folder / ("Scripts" if os.name == "nt" else "bin") / "python"


def install(python: Path, *requirements: object, **environment: str) -> str:
    """Install packages; rodgen is only what the requirements name by its file."""
    return run(
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "-q",
        "--no-compile",
        *requirements,
        **environment,
    )


def smoke(python: Path, backend: str) -> str:
    """Use the rodgen of an environment as on a machine without a compiler; return the line that says what was right."""
    return run(python, "-I", SMOKE, backend, PATH=str(python.parent), CC="").splitlines()[-1]
