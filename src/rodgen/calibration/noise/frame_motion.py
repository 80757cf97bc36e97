"""What a small motion of the measuring frame does to readings; errors that a pose's readings share are such motions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem, one_thread_in_blas

if TYPE_CHECKING:
    from rodgen.data.observations import Observations
    from rodgen.machines.model import Frame, Model


def frame_motion(
    model: Model,
    o: Observations,
    theta: Array,
    frame: Frame,
    weight: Array,
    *,
    middle: Array | None = None,
) -> Array:
    """Return the derivatives of weighted residuals with respect to a motion of the whole frame, (n, m, 6).

    Translations along the machine's axes, then turns about the middle of the places that were measured. Directions are
    only turned: (n, m, 3).

    Parameters
    ----------
    theta, frame : ndarray, Frame
        Of the fit.
    weight : ndarray, shape (n, m)
    middle : ndarray, shape (3,), optional
        Another point than the middle.
    """
    found, whitening = _independent(model, o, theta, frame, weight, middle), o.whitening
    return found if whitening is None else whitening @ found


def _independent(
    model: Model, o: Observations, theta: Array, frame: Frame, weight: Array, middle: Array | None
) -> Array:
    """Return them of independent errors."""
    with one_thread_in_blas():
        place = Problem(model, o).places(theta, frame)
    axes, measurand = frame.rotation.T, model.structure.measurand
    middle = place.mean(axis=0) if middle is None else middle
    turns = np.stack([np.cross(axis, place - middle if measurand.moving else place) for axis in axes])
    if measurand.has_zero:
        line = model.line(theta)
        if not measurand.has_axes:  # what rises above the horizon turns about a level axis
            level = np.cross(place, line)
            line = level / np.linalg.norm(level, axis=1, keepdims=True)
        return np.asarray(-weight[:, :, None] * np.broadcast_to(line, place.shape)[:, None])
    if measurand.has_attitude and not measurand.is_pose:
        return np.asarray(-np.einsum("km,nm->nmk", axes, weight))
    if not measurand.moving:
        return np.asarray(-np.einsum("mni,kni,nm->nmk", np.stack(o.basis), turns, weight))
    motions = np.concatenate([np.broadcast_to(axes[:, None], turns.shape), turns])
    if measurand.has_attitude:
        turned = np.concatenate([np.zeros((3, 3)), axes])[:, None] * o.arm
        motions = np.concatenate([motions, np.broadcast_to(turned, motions.shape)], axis=2)
    if measurand.is_place:
        return np.asarray(-np.einsum("kni,ni->nik", motions, weight))
    arm = place - np.asarray(model.machine.measured.origin)
    away = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    return np.asarray(-np.einsum("kni,ni,nm->nmk", motions, away, weight))
