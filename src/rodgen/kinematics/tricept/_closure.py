"""The place of the tool of a Tricept with errors: the exact direct problem with all parameters.

Given errors of all ``PARAMETERS`` at commanded rods, the three closures |m_k − F_k| = A_k are solved for
the pose by Newton's iteration from the nominal pose. Nothing is linearised.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import broadcast_shapes, real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._kinematics import legs
from rodgen.kinematics.tricept._parameters import FIXED, GUIDE, MOVING, PARAMETERS, RODS, TOOL, ZEROS, joints

_COLUMNS = {
    name: [PARAMETERS.index(member) for member in members]
    for name, members in (
        ("rods", RODS),
        ("zeros", ZEROS),
        ("fixed", FIXED),
        ("moving", MOVING),
        ("q", TOOL),
        ("guide", tuple(GUIDE)),
    )
}
_r, _R = PARAMETERS.index("r"), PARAMETERS.index("R")

# Quadratic convergence: errors of a thousandth of the machine need four steps.
_MOST_STEPS = 12
_BLOCK = 20_000


def disturbed_point(pose: ArrayLike, geometry: Geometry, errors: ArrayLike) -> tuple[Any, Any]:
    """Return the place of the tool when the rods are commanded for a pose and the parameters have errors.

    Parameters
    ----------
    pose : array_like (..., 3)
        The nominal pose: α and β in rad, and z.
    geometry : Geometry
        The nominal machine.
    errors : array_like (..., n)
        Errors of all ``PARAMETERS``, lengths and rad: true value minus nominal one.

    Returns
    -------
    point : array (..., 3)
        The true place of the tool; NaN where the status is UNREACHABLE or INVALID.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`: REACHABLE; UNREACHABLE where no pose near the nominal one closes; INVALID.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> errors = np.zeros(len(tricept.PARAMETERS))
    >>> errors[tricept.PARAMETERS.index("zero_A0")] = 0.1
    >>> tricept.disturbed_point([0.0, 0.0, 600.0], tricept.PAPER, errors)[0].round(5) + 0.0
    array([-1.2715000e-01,  0.0000000e+00,  6.0003495e+02])
    """
    poses, shifts = real_array("pose", pose, (3,)), real_array("errors", errors, (len(PARAMETERS),))
    shape = broadcast_shapes({"pose": (poses, 1), "errors": (shifts, 1)})
    flat_pose = np.broadcast_to(poses, (*shape, 3)).reshape(-1, 3)
    flat = np.broadcast_to(shifts, (*shape, len(PARAMETERS))).reshape(-1, len(PARAMETERS))
    points, status = np.empty((len(flat), 3)), np.empty(len(flat), np.int8)
    for start in range(0, len(flat), _BLOCK):
        part = slice(start, start + _BLOCK)
        points[part], status[part] = _solved(flat_pose[part], geometry, flat[part])
    return points.reshape(*shape, 3), status.reshape(shape)[()]


def _solved(pose: Array, geometry: Geometry, errors: Array) -> tuple[Array, NDArray[np.int8]]:
    fixed, moving = joints(geometry)
    n = len(errors)
    rods = np.asarray(legs(pose, geometry)) + errors[:, _COLUMNS["rods"]] + errors[:, _COLUMNS["zeros"]]
    base = (
        fixed + errors[:, _R, None, None] * fixed / geometry.R + errors[:, _COLUMNS["fixed"]].reshape(n, 3, 3)
    )
    platform = (
        moving
        + errors[:, _r, None, None] * moving / geometry.r
        + errors[:, _COLUMNS["moving"]].reshape(n, 3, 3)
    )
    tool = np.asarray(geometry.q) + errors[:, _COLUMNS["q"]]
    guide = errors[:, _COLUMNS["guide"]]
    now = pose.copy()
    # α and β act on lengths of the machine's size
    size = np.array([geometry.R, geometry.R, 1.0]) / geometry.R
    left = np.ones(n, bool)
    with np.errstate(all="ignore"):
        for _ in range(_MOST_STEPS):
            some = np.flatnonzero(left)
            if not some.size:
                break
            answer = call_kernel(
                kernels.tricept_closure,
                (now[some], rods[some], base[some], platform[some], tool[some], guide[some]),
            )
            step = _solve(answer[_JACOBIAN], answer[_RESIDUAL])
            now[some] -= step
            # a step this small was the last one: the next would be its square
            left[some] = ~(np.abs(step * size).max(axis=1) <= 1e-9)
        points = np.asarray(
            call_kernel(kernels.tricept_closure, (now, rods, base, platform, tool, guide))[_PLACE]
        )
    invalid = ~(np.isfinite(pose).all(axis=1) & np.isfinite(errors).all(axis=1))
    far = np.abs(now[:, :2] - pose[:, :2]).max(axis=1) > 1.0
    bad = left | far | ~np.isfinite(points).all(axis=1)
    status = np.where(invalid, TriceptStatus.INVALID, np.where(bad, TriceptStatus.UNREACHABLE, 0))
    return np.where((bad | invalid)[:, None], np.nan, points), status.astype(np.int8)


def _solve(matrix: Array, right: Array) -> Array:
    """Return solutions of three equations by cross products: a singular matrix gives infinite steps."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    solved: Array = (columns @ right[..., None])[..., 0] / (a * columns[..., 0]).sum(axis=-1)[:, None]
    return solved


# Order of the kernel's outputs.
_RESIDUAL, _PLACE, _JACOBIAN = 0, 1, 2
