"""Check an extension that was just built: it computes what the NumPy modules compute, on each instruction set.

``python supply/check_extension.py EXTENSION``. CMake runs it at the end of a build, whatever CFLAGS and the compiler
are, and installs nothing when it fails.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

TOLERANCE = 1e-12
"""The rows below are far from singular, so that rounding in another order changes 1e-14."""

AXIS, ANGLE = np.array([2.0, -1.0, 2.0]) / 3, 0.7
RHO = np.array([0.3, 1.1, -0.4])
QUATERNION = np.array([np.cos(ANGLE / 2), *np.sin(ANGLE / 2) * AXIS])


def results(kernels: ModuleType | SimpleNamespace) -> dict[str, np.ndarray]:
    """Return numbers of a dozen kernels: sums, square roots, series, angles, tests for NaN, statuses."""
    theta = 2 * np.tan(ANGLE / 2) * AXIS
    matrix = kernels.matrix_from_axis_angle(AXIS, ANGLE)[0]
    turned = kernels.rotate(RHO, theta)
    rows = np.array([RHO, [np.nan, 0, 1], [np.inf, 0, 1], 1e-310 * RHO, 0 * RHO])
    found = {
        "rotate": turned,
        "matrix_from_axis_angle": matrix,
        "matrix_from_rodrigues_vector": kernels.matrix_from_rodrigues_vector(theta),
        "quaternion_from_matrix": kernels.quaternion_from_matrix(matrix),
        "axis_angle_from_quaternion": kernels.axis_angle_from_quaternion(QUATERNION),
        "rotation_from_vector": kernels.rotation_from_vector(np.array([[0.1, 0.02, -0.3], [1.0, 2.0, -1.5]])),
        "chi_from_quaternion": kernels.chi_from_quaternion(QUATERNION),
        "solve_axis": kernels.solve_axis(RHO, turned, ANGLE, 1e-8),
        "solve_axis of special rows": kernels.solve_axis(rows, rows, np.array([ANGLE, 1, 1, 1, 1]), 1e-8),
        "axis_jacobian": kernels.axis_jacobian(RHO, turned, ANGLE, 1e-8),
    }
    return {
        name: np.concatenate(
            [np.ravel(x).astype(float) for x in (value if isinstance(value, tuple) else (value,))]
        )
        for name, value in found.items()
    }


def loaded(extension: Path, level: str, folder: Path) -> ModuleType:
    """Return the extension with the loops of an instruction set; Python imports a file once, so of a copy."""
    os.environ["RODGEN_CPU"] = level
    copy = folder / level / extension.name
    copy.parent.mkdir()
    shutil.copy(extension, copy)
    spec = importlib.util.spec_from_file_location("_gufuncs", copy)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def problem(extension: Path, folder: Path) -> str | None:
    """Return what is wrong with an extension in one sentence, or None."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from generated.numpy import ALL

    expected = results(ALL)
    for level in ("baseline", "avx2", "avx512"):
        module = loaded(extension, level, folder)
        if not np.array([5e-324]) * 1.0 > 0:
            return "it sets subnormal numbers to zero in the whole process"
        for name, found in results(module).items():
            if not np.allclose(found, expected[name], rtol=0, atol=TOLERANCE, equal_nan=True):
                return f"{name} gives {found} ({module.instruction_set}), NumPy {expected[name]}"
    return None


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        wrong = problem(Path(sys.argv[1]), Path(name))
    if wrong:
        flags = os.environ.get("CFLAGS")
        sys.exit(
            f"The compiled kernels are wrong and are not installed: {wrong}. "
            + (f"CFLAGS is {flags!r}: install without it." if flags else "Try another compiler, named in CC.")
        )
