"""Whether an effect takes away more of the error than chance does: the one test that `add` and `diagnose` report.

A larger model always fits better. The fall of the sum of squares for each further parameter is held against what
remains, by F, given all else that the larger model has. Where successive poses or readings of one pose may share errors
(what chance does in one of ten data sets is allowed for), residuals of both models are whitened and fitted to first
order (generalised least squares); how well the variances of that are known then limits the degrees of freedom.
Readings of one pose may share what is no motion of the frame, such as where a joint stopped: an effect that acts on
whole poses fits that, too. So the residuals count as much as they scatter along the new parameters from pose to pose
(the design effect of Rao and Scott 1987, by residuals with the correction of Bell and McCaffrey 2002), and the degrees
of freedom count a pose as one. A function of one coordinate is tested by its distinct positions, or, where these are
too few to show its shape, for the kind of motion that the joint makes at them (`positions`); one of time against walks
of all sizes (:mod:`rodgen.statistics.unknown_walk`), whether these can be seen or not. A
parameter that was searched for had many chances: the probability is multiplied by their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.positions import (
    few_positions,
    log_p_by_position,
    log_p_of_kind,
    position_of,
)
from rodgen.calibration.determinacy.whitened_parameters import Whitened
from rodgen.calibration.noise.correlation import (
    FitRows,
    believed_readings,
    estimate_correlation,
    shared_motion,
)
from rodgen.calibration.possible_effects import (
    MOTIONS,
    bare_effects,
    bare_key,
    catalogue_effects,
    problem_with,
)
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import Solution, minimise
from rodgen.calibration.words import capitalized
from rodgen.machines.effects.definition import StartSearch
from rodgen.statistics.columns import (
    DEPENDENT,
    ColumnSpace,
    Whiten,
    orthonormal_basis,
    unit_columns,
    visible_part,
)
from rodgen.statistics.decompositions import singular_values, svd
from rodgen.statistics.f_tests import log10_f_tail, p_of_log10
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import EFFECT_TEST
from rodgen.statistics.unknown_walk import log_p_under_walks
from rodgen.statistics.whitening import MotionDeviations

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.machines.machine import Effect

__all__ = ["EffectTest", "design_effect", "effect_test", "nested", "worth_of"]

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class EffectTest:
    """What the further parameters of a larger model are worth.

    Attributes
    ----------
    p_value, log10_p : float
        Probability that chance lowers the error as much; at least 1e-300, and its logarithm.
    statistic : float
        F. Of what follows the time the probability is averaged over those of several walks.
    degrees_of_freedom : tuple of float
        Of F.
    design_effect : float
        By what factor readings of one pose, in common, make chance look larger.
    only_at : tuple of (str, int), optional
        A joint and the number of its positions, where these are so few that they show what kind of motion it makes, but
        not what it does between them.
    """

    p_value: float
    log10_p: float
    statistic: float
    degrees_of_freedom: tuple[float, float]
    design_effect: float
    only_at: tuple[str, int] | None = None

    @property
    def significant(self) -> bool:
        """Whether chance does not do that."""
        return self.p_value < EFFECT_TEST.significant

    def on_shape(self, effect: Effect) -> str:
        """Return that the effect tested is only known at the positions of its joint; empty where its shape is."""
        if self.only_at is None:
            return ""
        joint, positions = self.only_at
        return (
            f"{capitalized(effect.title)} is known at the {positions} positions of {joint}: they show what kind of "
            "motion it is, but not what it does between them. More positions would tell."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "p_value": self.p_value,
            "statistic": self.statistic,
            "degrees_of_freedom": list(self.degrees_of_freedom),
            "design_effect": self.design_effect,
            "significant": self.significant,
        }


def worth_of(fit: FittedModel, effect: Effect, without: FittedModel | None = None) -> EffectTest | None:
    """Return the test of one of a fit's effects, given all others.

    Parameters
    ----------
    fit : FittedModel
    effect : Effect
    without : FittedModel, optional
        The fit without the effect, where it is known.

    Returns
    -------
    EffectTest or None
        As of :func:`effect_test`.
    """
    if without is None:
        machine = fit.machine.without_effect(effect.name, effect.place)
        without = fit.refit(machine, outliers=fit.outliers)
    return effect_test(without, fit)


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
    smaller, larger = nested(smaller, larger)
    further = larger.determinacy.rank - smaller.determinacy.rank
    residual_dof = larger.degrees_of_freedom
    if further < 1 or residual_dof < 1:
        return None
    with one_thread_in_blas():
        problem, solution = _on_the_same_rows(smaller, larger)
        pair = _Whitened(smaller, larger, problem, solution)
        known = np.inf
        if larger.dependence.correlation.independent:
            left = larger.chi_square / residual_dof
            fall, effect = max(solution.cost - larger.chi_square, 0.0), _design_effect(smaller, larger, left)
        else:
            fall, left, effect = pair.test(further, residual_dof)
            known = pair.known()
        by_position, of_kind = pair.log_p_by_position()
        poses = len(np.unique(larger.observations.pose[~larger.outliers]))
        independent = residual_dof * min(poses / (residual_dof + larger.determinacy.rank), 1.0)
        walks = pair.log_p_under_walks(independent, effect) if pair.of_time else -np.inf
    dof = (float(further), max(min(independent, known), 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        statistic = float(np.divide(fall / further, left * effect)) if fall > 0 else 0.0
    log10 = walks / float(np.log(10)) if np.isfinite(walks) else log10_f_tail(statistic, *dof)
    log10 += float(np.log10(_tried(smaller, larger)))
    log10 = min(max(log10, by_position / float(np.log(10))), 0.0)
    only_at = few_positions(pair.added[0], larger.observations) if of_kind else None
    return EffectTest(p_of_log10(log10), log10, statistic, dof, effect, only_at)


def nested(smaller: FittedModel, larger: FittedModel) -> tuple[FittedModel, FittedModel]:
    """Return both fits with the weights at later joints that either took in: one model is inside the other then.

    Each fit takes in the weights that its data call for, and that of the model without an effect may call for some that
    imitate it.
    """
    weights = smaller.later_weights | larger.later_weights
    return smaller.with_weights(weights), larger.with_weights(weights)


class _Whitened:
    """Residuals of two fits and their derivatives, where errors are independent.

    Parameters
    ----------
    smaller, larger : FittedModel
    problem, solution : Problem, Solution
        Of the smaller one, on the rows that the larger one believes.
    """

    def __init__(
        self, smaller: FittedModel, larger: FittedModel, problem: Problem, solution: Solution
    ) -> None:
        self.smaller, self.larger = smaller, larger
        self.rows = FitRows.of(larger)
        self.whiten = larger.dependence.correlation.whiten
        some = Problem(problem.model, self.rows.observations)
        some.set_weight((self.rows.weight / some.base_weight)[:, 0])
        at = solution.theta, solution.frame
        self.residual = some.residuals(*at, weighted=True)
        self.model = some.jacobian(*at)[:, :, list(smaller.moving)]
        inside = {smaller.parameters[i].key for i in smaller.moving}
        self.further = new = [i for i in larger.moving if larger.parameters[i].key not in inside]
        self.searched = sum(larger.parameters[i].searched is not None for i in new)
        self.new = self.rows.jacobian[:, :, new]
        self.own = self.rows.jacobian[:, :, [i for i in new if larger.parameters[i].searched is None]]
        there = {effect.identity for effect in smaller.machine.effects}
        self.added = [effect for effect in larger.machine.effects if effect.identity not in there]

    def test(self, further: int, residual_dof: int) -> tuple[float, float, float]:
        """Return the fall of the sum of squares, the variance of what remains, and the design effect."""
        sizes = np.cumsum([x.shape[2] for x in (self.model, self.rows.model, self.new)])
        parts = [
            self.model,
            self.rows.model,
            self.new,
            self.residual[:, :, None],
            self.rows.residual[:, :, None],
        ]
        white = self.whiten(np.concatenate(parts, axis=2)).reshape(self.residual.size, -1)
        small, large, new = np.split(white[:, :-2], sizes[:-1], axis=1)
        base = ColumnSpace.of(unit_columns(small))
        before, after = (
            base.project_out(white[:, -2]),
            ColumnSpace.of(unit_columns(large)).project_out(white[:, -1]),
        )
        remains = float(after @ after)
        part = self.residual.size / max(int((~self.larger.outliers).sum()) * self.residual.shape[1], 1)
        left = remains / max(part * residual_dof, 1.0)
        directions, _, _ = svd(base.project_out(unit_columns(new)), full_matrices=False)
        pose = np.repeat(self.rows.observations.pose, self.residual.shape[1])
        effect = design_effect(directions[:, :further], after, pose, left)
        return max(float(before @ before) - remains, 0.0), left, effect

    def known(self) -> float:
        """Return as many degrees of freedom as the variance of what is new has, because V is estimated.

        2 over the variance of the logarithm of its generalised variance, a parameter (Satterthwaite 1946).
        """
        k, size = self.model.shape[2], np.linalg.norm(self.new.reshape(self.residual.size, -1), axis=0)
        size[size == 0.0] = 1.0  # what a time constant of nearly zero does

        def log_variance(white: Array) -> float:
            flat = white.reshape(self.residual.size, -1)
            base = ColumnSpace.of(unit_columns(flat[:, :k]))
            seen, left = base.project_out(flat[:, k:-1]), base.project_out(flat[:, -1])
            values = singular_values(seen / size)
            left = ColumnSpace.of(unit_columns(seen)).project_out(left)
            return float(np.log(left @ left) - 2 * np.mean(np.log(values[values > DEPENDENT * values[0]])))

        columns = np.concatenate([self.model, self.new, self.rows.residual[:, :, None]], axis=2)
        pairs = self.larger.dependence.correlation.whiten_within_error(columns)
        error = sum((log_variance(one) - log_variance(other)) ** 2 / 4 for one, other in pairs)
        return 2 / error if error > 0 else np.inf

    @property
    def of_time(self) -> bool:
        """Whether all that is new follows the time, as a walk does."""
        return bool(self.added) and all(effect.definition.follows_time for effect in self.added)

    def log_p_under_walks(self, independent: float, design_effect: float) -> float:
        """Return the logarithm of the probability where the set-up wanders by an amount that is not known."""
        motion, groups = shared_motion(self.rows)
        old = [i for i in self.larger.moving if i not in self.further]
        N = self.residual.size
        basis = orthonormal_basis(self.rows.jacobian[:, :, old].reshape(N, -1))
        new = visible_part(basis, unit_columns(self.new.reshape(N, -1)), DEPENDENT)
        dof = float(believed_readings(self.rows).sum() - basis.shape[1] - new.shape[1]), independent
        none = MotionDeviations(np.zeros(motion.dof), np.zeros(motion.dof), np.inf)
        estimated = self.larger.dependence.correlation.deviations or none
        residual = self.residual.ravel()
        return log_p_under_walks(motion, groups, basis, new, residual, dof, estimated, design_effect)

    def log_p_by_position(self) -> tuple[float, bool]:
        """Return the logarithm of the probability by the positions of a joint; -inf where readings are what counts.

        And whether the positions show the kind of motion only, not its shape.
        """
        o, added = self.rows.observations, self.added
        joint = position_of(added[0], o) if len(added) == 1 else None
        if joint is None or not self.own.shape[2]:
            return -np.inf, False
        tries = float(_tried(self.smaller, self.larger))
        of = o, self.model, self.own, self.residual
        by_shape, enough = log_p_by_position(*of, self.whiten, joint, self.searched, tries)
        enough = enough or by_shape < np.log(EFFECT_TEST.significant)
        if enough or self.searched or added[0].definition.own or joint != added[0].place:
            return by_shape, False

        def whiten_given(columns: Array) -> Whiten:
            return estimate_correlation(self.rows, (), included=[columns]).whiten

        of_kind = log_p_of_kind(*of, whiten_given, joint, *self._motions(joint))
        return min((by_shape, False), (of_kind, True))

    def _motions(self, joint: str) -> tuple[Array, list[Array], list[Array]]:
        """Return derivatives by the motions of what a joint carries, and by other effects of that joint.

        The latter apart: those without, and those with searched parameters.
        """
        o = self.rows.observations
        effects = [e for e in catalogue_effects(self.larger.machine, o) if e.place == joint]
        bare = [e for e in bare_effects(self.larger.machine) if e.place == joint]
        problem, theta = problem_with(self.larger, [*effects, *bare], self.rows.rows)
        columns = problem.jacobian(theta, self.larger.solution.frame)
        index = {parameter.key: i for i, parameter in enumerate(problem.model.parameters)}
        motions = [index[key] for x in MOTIONS if (key := bare_key(joint, x)) in index]
        rivals: tuple[list[Array], list[Array]] = [], []
        for effect in effects:
            own = columns[:, :, [i for key, i in index.items() if effect.owns(key)]]
            rivals[bool(effect.definition.searched)].append(own)
        return columns[:, :, motions], *rivals


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


def _tried(smaller: FittedModel, larger: FittedModel) -> int:
    """Return how many different values a searched parameter may have found something at."""
    before = {smaller.parameters[i].key for i in smaller.free}
    tried = 1
    for parameter in (larger.parameters[i] for i in larger.free):
        if parameter.searched is StartSearch.TIME_CONSTANT and parameter.key not in before:
            tried = max(tried, EFFECT_TEST.time_constants)
        elif parameter.searched and parameter.key not in before:
            tried = max(tried, EFFECT_TEST.searched_values)
            names = [joint.name for joint in larger.machine.joints]
            if parameter.place in names:  # a period: as many waves as there are places, and those between
                places = np.unique(larger.observations.q[:, names.index(str(parameter.place))])
                tried = max(tried, 2 * len(places))
    return tried


def _on_the_same_rows(smaller: FittedModel, larger: FittedModel) -> tuple[Problem, Solution]:
    """Return the smaller model fitted to the rows that the larger one believes."""
    if np.array_equal(smaller.outliers, larger.outliers):
        return smaller.problem, smaller.solution
    problem = Problem(smaller.problem.model, smaller.observations)
    problem.leave_out(larger.outliers)
    return problem, minimise(problem, smaller.solution.theta, smaller.solution.frame, smaller.free)


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
