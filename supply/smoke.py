"""Use an installed rodgen as its users do: an axis, a fit, a diagnosis, ``rodgen doctor``.

``VENV/bin/python -I supply/smoke.py BACKEND``, where BACKEND is ``compiled`` or ``numpy``: what the functions must run
on. Machines are tried where SciPy is installed. Of the checkout it needs this file and ``examples``.
"""

from __future__ import annotations

import importlib.util
import json
import platform
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np

import rodgen
from rodgen.kinematics.backend import backend

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
MOUNT = EXAMPLES / "machines" / "mount"


def functions(expected: str) -> None:
    """Solve for an axis, float64 and float32: on NumPy with one notice, compiled with none."""
    assert (backend == "numpy") == (expected == "numpy"), f"the functions run on {backend}"
    with warnings.catch_warnings(record=True) as notices:
        warnings.simplefilter("always")
        for number, allowed in ((np.float64, 4e-16), (np.float32, 3e-7)):
            points = np.array([[2, 0, 1], [0, 2, 1]], number)
            axes, status = rodgen.solve_axis(*points, number(np.pi / 2))
            assert axes.dtype == number
            assert status == rodgen.AxisStatus.TWO_AXES
            assert np.abs(axes - [[0, 0, 1], [-2 / 3, -2 / 3, 1 / 3]]).max() <= allowed
    assert len(notices) == (expected == "numpy"), [str(notice.message) for notice in notices]
    if notices:
        assert "has no compiled kernels" in str(notices[0].message)
    assert np.array([5e-324]) * 1.0 > 0, "subnormal numbers are set to zero"


def machines() -> None:
    """Fit and diagnose a real telescope: what it lacks is known."""
    machine = rodgen.Machine.load(MOUNT / "machine.toml")
    diagnosis = machine.fit(rodgen.Measurements.load(MOUNT / "mmt_2021.csv")).diagnose()
    assert abs(diagnosis.base.rms - 2.711) < 1e-3, diagnosis.base.rms
    assert abs(diagnosis.final.rms - 0.659) < 1e-3, diagnosis.final.rms


def command() -> None:
    """Ask the command line whether anything is broken."""
    done = subprocess.run(
        [sys.executable, "-I", "-m", "rodgen", "doctor", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["kernels"]["instruction_set"] == backend


if __name__ == "__main__":
    functions(sys.argv[1])
    done = ["an axis"]
    if importlib.util.find_spec("scipy"):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "kernels that are made at run time run on NumPy")
            machines()
        done += ["a fit", "a diagnosis"]
    command()
    about = f"Python {platform.python_version()}, NumPy {np.__version__}, {backend}"
    print(f"{about}: {', '.join(done)} and rodgen doctor are right.")
