"""How the prediction moves with a joint's reading, and the error of that reading which would explain a residual."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.machines.observations import Observations


STEP = 1e-5
"""Step of the central differences: radians, or a part of the range. They are good to six digits for any machine, far
more than a regression needs."""
TURN = 0.1
"""Angle to both sides by which points are turned to find where the axis is, radians; exact for any."""
SMALL_MOTION = 0.1
"""Where a joint moves the target less than this part of the median motion, residuals say nothing about its reading."""


def motion_with_reading(fit: Fit, observations: Observations, joint: int, *, weighted: bool = False) -> Array:
    """Return the derivative of the prediction with respect to a joint's reading, (n, m).

    Parameters
    ----------
    observations : Observations
        Rows at which it is taken.
    joint : int
        Number of the joint.
    weighted : bool
        Whether to multiply it by the weights that the data state.

    Returns
    -------
    ndarray
        Per radian, or per internal unit of length.
    """
    turns = fit.machine.joints[joint].revolute
    step = STEP if turns else STEP * float(np.ptp(observations.q[:, joint]) or 1.0)
    behind, ahead = (_residuals(fit, observations, joint, x, weighted=weighted) for x in (-step, step))
    return np.asarray((behind - ahead) / (2 * step))


def _residuals(
    fit: Fit, observations: Observations, joint: int, moved: float, *, weighted: bool = False
) -> Array:
    """Return the residuals with a joint's reading moved, (n, m)."""
    q = observations.q.copy()
    q[:, joint] += moved
    problem = Problem(fit.problem.model, replace(observations, q=q))
    return problem.residuals(fit.solution.theta, fit.solution.frame, weighted=weighted)


def directions_about(fit: Fit, observations: Observations, joint: int) -> Array:
    """Return the radial, tangential and axial directions of measured points about a revolute joint, (n, 3, 3).

    Row by row unit vectors in the frame of the readings: away from the axis, ahead with the joint's reading, and along
    the axis about which the target is then seen to turn. NaN where a point is on the axis.
    """
    behind, here, before = (_residuals(fit, observations, joint, x)[:, :3] for x in (-TURN, 0.0, TURN))
    ahead, away = behind - before, behind + before - 2 * here  # exact on a circle
    radius = np.linalg.norm(ahead, axis=1)
    on_axis = radius <= SMALL_MOTION**2 * np.max(radius, initial=0.0)
    ahead[on_axis] = away[on_axis] = np.nan
    radial, tangential = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (away, ahead))
    return np.stack([radial, tangential, np.cross(radial, tangential)], axis=1)


def error_of_reading(motion: Array, residual: Array) -> Array:
    """Return the error of a joint's reading that would explain each residual best, (n,).

    Parameters
    ----------
    motion : ndarray, shape (n, m)
        As of :func:`motion_with_reading`.
    residual : ndarray, shape (n, m)
        In the same units.

    Returns
    -------
    ndarray
        NaN where the joint hardly moves the prediction.
    """
    square = np.sum(motion**2, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.sum(motion * residual, axis=1) / square
    return np.where(square > SMALL_MOTION**2 * np.median(square), along, np.nan)
