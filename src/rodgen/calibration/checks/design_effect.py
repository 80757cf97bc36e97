"""By what factor readings of one pose make chance look larger (Rao and Scott 1987).

Readings of one pose may share what is no motion of the frame, such as where a joint stopped: an effect that acts on
whole poses fits that, too. So residuals count as much as they scatter along the new parameters from pose to pose, by
residuals with the correction of Bell and McCaffrey (2002).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.nested_models import further_combinations
from rodgen.calibration.determinacy.whitened_parameters import Whitened
from rodgen.statistics.columns import unit_columns
from rodgen.statistics.decompositions import svd
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import EFFECT_TEST

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel


def design_effect(directions: Array, residual: Array, pose: NDArray[np.integer], variance: float) -> float:
    """Return the variance along directions from pose to pose, over that of independent readings; 1 or more.

    Parameters
    ----------
    directions : ndarray, shape (N, k)
        Orthonormal.
    residual : ndarray, shape (N,)
        Of the model with them.
    pose : ndarray of int, shape (N,)
    variance : float
        Of a reading.
    """
    k = directions.shape[1]
    if not k or not variance > 0:
        return 1.0
    number = np.unique(pose, return_inverse=True)[1]
    pulls, shares = np.zeros((int(number.max()) + 1, k)), np.zeros((int(number.max()) + 1, k, k))
    np.add.at(pulls, number, directions * residual[:, None])
    np.add.at(shares, number, directions[:, :, None] * directions[:, None, :])
    return float(max(np.sum(undo_leverage(shares, pulls, 0.5) ** 2) / (k * variance), 1.0))


def design_effect_of_fits(smaller: FittedModel, larger: FittedModel, left: float) -> float:
    """Return the variance along the new parameters from pose to pose, over that of independent readings; 1 or more."""
    whitened = Whitened(larger)
    new = _further(smaller, larger, whitened)
    if not new.shape[1] or not left > 0:
        return 1.0
    pose = np.unique(larger.observations.pose, return_inverse=True)[1]
    poses, r = int(pose.max()) + 1, len(new)
    residuals = larger.problem.residuals(larger.solution.theta, larger.solution.frame, weighted=True)
    pull = np.zeros((poses, r))
    if poses > EFFECT_TEST.poses_a_parameter * r:
        for rows, jacobian in whitened.jacobian_blocks():
            np.add.at(pull, pose[rows], np.einsum("nmr,nm->nr", jacobian, residuals[rows]))
    else:
        whole, shares = np.empty((*residuals.shape, r)), np.empty((poses, r, r))
        for rows, jacobian in whitened.jacobian_blocks():
            whole[rows] = jacobian
        order = np.argsort(pose, kind="stable")
        for p, rows in enumerate(np.split(order, np.cumsum(np.bincount(pose))[:-1])):
            columns = whole[rows].reshape(-1, r)
            pull[p], shares[p] = residuals[rows].ravel() @ columns, columns.T @ columns
        pull = undo_leverage(shares, pull, 0.5)
    return float(max(np.sum((pull @ new) ** 2) / (new.shape[1] * left), 1.0))


def _further(smaller: FittedModel, larger: FittedModel, whitened: Whitened) -> Array:
    """Return unit vectors across all that the smaller model can do, (r, further)."""
    inside = {smaller.parameters[i].key for i in smaller.moving}
    index = [i for i in larger.free if larger.parameters[i].key in inside]
    basis, _, _ = svd(unit_columns(whitened.inverse[:, index]), full_matrices=True)
    return np.asarray(basis[:, len(basis) - further_combinations(smaller, larger) :])
