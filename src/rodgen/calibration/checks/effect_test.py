"""Whether an effect takes away more of the error than chance does.

A larger model always fits better. The fall of the sum of squares for each further parameter is held against what is
left, by F; deviations from priors of the machine file count as those of readings. Readings of one pose share errors,
such as where the machine stopped: an effect that acts on whole poses fits those, too. So the residuals count as much as
they scatter along the new parameters from pose to pose (the design effect of Rao and Scott 1987, by residuals with the
correction of Bell and McCaffrey 2002), and the degrees of freedom count a pose as one. A parameter that was searched
for had many chances: the probability is multiplied by their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.determinacy.whitened_parameters import Whitened
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import minimise
from rodgen.statistics.columns import unit_columns
from rodgen.statistics.decompositions import svd
from rodgen.statistics.f_tests import f_tail
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import EFFECT_TEST, SMALLEST_P

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel

__all__ = ["EffectTest", "effect_test"]

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class EffectTest:
    """What the further parameters of a larger model are worth.

    Attributes
    ----------
    p_value : float
        Probability that chance lowers the error as much; at least 1e-300.
    statistic : float
        F.
    degrees_of_freedom : tuple of float
        Of F.
    design_effect : float
        By what factor readings of one pose, in common, make chance look larger.
    """

    p_value: float
    statistic: float
    degrees_of_freedom: tuple[float, float]
    design_effect: float

    @property
    def significant(self) -> bool:
        """Whether chance does not do that."""
        return self.p_value < EFFECT_TEST.significant

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "p_value": self.p_value,
            "statistic": self.statistic,
            "degrees_of_freedom": list(self.degrees_of_freedom),
            "design_effect": self.design_effect,
            "significant": self.significant,
        }


def effect_test(smaller: FittedModel, larger: FittedModel) -> EffectTest | None:
    """Return the F test of a larger model against one inside it.

    Parameters
    ----------
    smaller, larger : FittedModel
        To the same observations. Rows that are outliers of the larger one are left out of both.

    Returns
    -------
    EffectTest or None
        None where the larger model has nothing more that the data determine, or no degree of freedom is left.
    """
    further = larger.determinacy.rank - smaller.determinacy.rank
    residual_dof = larger.degrees_of_freedom
    if further < 1 or residual_dof < 1:
        return None
    left = larger.chi_square / residual_dof
    with one_thread_in_blas():
        fall = max(_cost(smaller, larger) - larger.least_sum, 0.0)
        effect = _design_effect(smaller, larger, left)
    poses = len(np.unique(larger.observations.pose[~larger.outliers]))
    readings = residual_dof + larger.determinacy.rank
    dof = (float(further), max(residual_dof * min(poses / readings, 1.0), 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        statistic = float(np.divide(fall / further, left * effect)) if fall > 0 else 0.0
    p = f_tail(statistic, *dof) * _tried(smaller, larger)
    return EffectTest(min(max(p, SMALLEST_P), 1.0), statistic, dof, effect)


def _tried(smaller: FittedModel, larger: FittedModel) -> int:
    """Return how many different values a searched parameter may have found something at."""
    before = {smaller.parameters[i].key for i in smaller.free}
    tried = 1
    for parameter in (larger.parameters[i] for i in larger.free):
        if parameter.searched and parameter.key not in before:
            tried = max(tried, EFFECT_TEST.searched_values)
            names = [joint.name for joint in larger.machine.joints]
            if parameter.place in names:  # a period: as many waves as there are places, and those between
                places = np.unique(larger.observations.q[:, names.index(str(parameter.place))])
                tried = max(tried, 2 * len(places))
    return tried


def _cost(smaller: FittedModel, larger: FittedModel) -> float:
    """Return what the smaller model makes least on the rows that the larger one believes."""
    if np.array_equal(smaller.outliers, larger.outliers):
        return smaller.least_sum
    problem = Problem(smaller.problem.model, smaller.observations)
    problem.leave_out(larger.outliers)
    cost = minimise(problem, smaller.solution.theta, smaller.solution.frame, smaller.free).cost
    return float(cost + smaller.least_sum - smaller.chi_square)


def _design_effect(smaller: FittedModel, larger: FittedModel, left: float) -> float:
    """Return the variance along the new parameters from pose to pose, over that of independent readings; 1 or more."""
    whitened = Whitened(larger)
    new = _further(smaller, larger, whitened)
    if not new.shape[1] or not left > 0:
        return 1.0
    pose = np.unique(larger.observations.pose, return_inverse=True)[1]
    poses, r = int(pose.max()) + 1, len(new)
    residuals = larger.problem.residuals(larger.solution.theta, larger.solution.frame, weighted=True)
    pull = np.zeros((poses, r))
    shares = np.zeros((poses, r, r)) if poses <= EFFECT_TEST.poses_a_parameter * r else None
    for rows, jacobian in whitened.jacobian_blocks():
        np.add.at(pull, pose[rows], np.einsum("nmr,nm->nr", jacobian, residuals[rows]))
        if shares is not None:
            np.add.at(shares, pose[rows], np.einsum("nmr,nms->nrs", jacobian, jacobian))
    if shares is not None:
        pull = undo_leverage(shares, pull, 0.5)
    return float(max(np.sum((pull @ new) ** 2) / (new.shape[1] * left), 1.0))


def _further(smaller: FittedModel, larger: FittedModel, whitened: Whitened) -> Array:
    """Return unit vectors across all that the smaller model can do, (r, further)."""
    inside = {smaller.parameters[i].key for i in smaller.moving}
    index = [i for i in larger.free if larger.parameters[i].key in inside]
    basis, _, _ = svd(unit_columns(whitened.inverse[:, index]), full_matrices=True)
    return np.asarray(basis[:, smaller.determinacy.rank :])
