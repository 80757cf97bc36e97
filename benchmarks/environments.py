"""Environments for the peers, made once from pinned requirements.

The package under test is the one that the calling Python imports. The peers' packages are
appended *behind* that Python's own, so that all use the same NumPy.
"""

from __future__ import annotations

import hashlib
import os
import site
import subprocess
import sys
import venv
from pathlib import Path

# One thread for all; read by those libraries when they are first imported, which is after this module.
for _library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

HERE = Path(__file__).resolve().parent
BUILD = HERE / "build"
PEERS = HERE / ".venv-peers"
SYMFORCE = HERE / ".venv-symforce"


class CommandError(Exception):
    """A subprocess failed; the message is the last line of its output."""


def run(command: list[str | Path], **keywords) -> str:
    """Run ``command`` and return its standard output; raise `CommandError` with its last words."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **keywords)
    if done.returncode:
        said = [line for line in (done.stderr + "\n" + done.stdout).splitlines() if line.strip()]
        errors = [line for line in said if "error" in line.lower()]
        raise CommandError(
            f"{Path(command[0]).name} failed: {(errors or said or ['no message'])[-1].strip()}"
        )
    return done.stdout


def python_of(environment: Path) -> Path:
    return environment / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def site_packages(environment: Path) -> Path:
    return next(environment.glob("lib/python*/site-packages"), environment / "Lib/site-packages")


def ensure(environment: Path, requirements: Path) -> None:
    """Make ``environment`` hold exactly what ``requirements`` names; do nothing where it already does."""
    wanted = hashlib.sha256(requirements.read_bytes() + sys.version.encode()).hexdigest()
    stamp = environment / "requirements.sha256"
    if stamp.exists() and stamp.read_text() == wanted:
        return
    print(f"making {environment.name} from {requirements.name} (once) ...", flush=True)
    venv.create(environment, with_pip=True, clear=True)
    run([python_of(environment), "-m", "pip", "install", "--quiet", "--requirement", requirements])
    stamp.write_text(wanted)


def append_to_path(environment: Path) -> None:
    """Let this process import what ``environment`` holds, behind everything that it can import already."""
    folder = str(site_packages(environment))
    if folder not in sys.path:
        site.addsitedir(folder)
