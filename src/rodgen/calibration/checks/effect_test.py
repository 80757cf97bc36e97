"""Whether an effect takes away more of the error than chance does: the one test that `add` and `diagnose` report.

A larger model always fits better. The fall of the sum of squares for each further parameter is held against what
remains, by F, given all else that the larger model has, with what `design_effect` says of readings of one pose; the
degrees of freedom count a pose as one. Where successive poses or readings of one pose may share errors (what chance
does in one of ten data sets is allowed for), residuals of both models are whitened and fitted to first order
(generalised least squares); how well the variances of that are known then limits the degrees of freedom
(`generalised_f`). A function of one coordinate is tested by its distinct positions (`positions`), or, where these are
too few to show its shape, for the kind of motion that the joint makes at them (`log_p_of_kind`); one of time against
walks of all sizes (:mod:`rodgen.statistics.unknown_walk`), whether these can be seen or not. A parameter that was
searched for had many chances: the probability is multiplied by their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.positions import (
    bases_by_rows,
    explained_within,
    few_positions,
    log_p_by_position,
    position_of,
    rows_by_position,
)
from rodgen.calibration.determinacy.determinacy import Whitened
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
from rodgen.calibration.words import chance, fall
from rodgen.errors import joined
from rodgen.machines.effects.definition import StartSearch
from rodgen.statistics.columns import DEPENDENT, ColumnSpace, orthonormal_basis, unit_columns, visible_part
from rodgen.statistics.decompositions import singular_values, svd
from rodgen.statistics.f_tests import log10_f_tail, p_of_log10
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import EFFECT_TEST, SELECTION
from rodgen.statistics.unknown_walk import log_p_under_walks
from rodgen.statistics.whitening import MotionDeviations
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.machines.machine import Effect

# A model and one inside it, on the same readings: what the tests of the further parameters work on.


def with_the_same_weights(smaller: FittedModel, larger: FittedModel) -> tuple[FittedModel, FittedModel]:
    """Return both fits with the weights at later joints that either took in: one model is inside the other then.

    Each fit takes in the weights that its data call for, and that of the model without an effect may call for some that
    imitate it.
    """
    weights = smaller.later_weights | larger.later_weights
    return smaller.with_weights(weights), larger.with_weights(weights)


def further_combinations(smaller: FittedModel, larger: FittedModel) -> int:
    """Return how many combinations of parameters the data determine that a larger model has in addition.

    A combination of old parameters may be at the edge of being determined, and be so in one of the fits only: the ranks
    then differ by less than what is new. A new parameter that is determined by itself counts all the same.
    """
    inside, fixed = {smaller.parameters[i].key for i in smaller.moving}, larger.determinacy
    known = [
        i for i in larger.moving if not fixed.undetermined[i] and larger.parameters[i].key not in fixed.held
    ]
    alone = sum(larger.parameters[i].key not in inside for i in known)
    return max(fixed.rank - smaller.determinacy.rank, alone)


class NestedModels:
    """Residuals of two fits on the rows that the larger one believes, and their derivatives.

    Parameters
    ----------
    smaller, larger : FittedModel
        To the same observations, with the same weights at later joints (`with_the_same_weights`).

    Attributes
    ----------
    larger : FittedModel
    fall : float
        By how much the sum of squares is smaller with the larger one.
    rows : FitRows
        Of the larger one.
    residual : ndarray, shape (n, m)
        Of the smaller one, weighted, on these rows.
    model, new, own : ndarray, shape (n, m, parameters)
        Derivatives with respect to the parameters of the smaller one, to the further ones of the larger, and to those
        of the latter that are not searched for.
    further : list of int
        Numbers of the further parameters.
    searched : int
        How many of these are searched for.
    added : list of Effect
        Effects of the larger one only.
    """

    def __init__(self, smaller: FittedModel, larger: FittedModel) -> None:
        problem, solution = _on_the_same_rows(smaller, larger)
        self.larger = larger
        self.fall = max(solution.cost - larger.chi_square, 0.0)
        self.rows = FitRows.of(larger)
        self._smaller, self._problem = smaller, problem
        self._at = solution.theta, solution.frame
        inside = {smaller.parameters[i].key for i in smaller.moving}
        self.further = [i for i in larger.moving if larger.parameters[i].key not in inside]
        self._own = [i for i in self.further if larger.parameters[i].searched is None]
        self.searched = len(self.further) - len(self._own)
        there = {effect.identity for effect in smaller.machine.effects}
        self.added = [effect for effect in larger.machine.effects if effect.identity not in there]

    # derivatives are found where a test asks for them: that of independent readings needs none

    @cached_property
    def _on_rows(self) -> Problem:
        some = Problem(self._problem.model, self.rows.observations)
        some.set_weight((self.rows.weight / some.base_weight)[:, 0])
        return some

    @cached_property
    def residual(self) -> Array:
        """Residuals of the smaller model, weighted."""
        return self._on_rows.residuals(*self._at, weighted=True)

    @cached_property
    def model(self) -> Array:
        """Derivatives by the parameters of the smaller model."""
        return self._on_rows.jacobian(*self._at)[:, :, list(self._smaller.moving)]

    @property
    def new(self) -> Array:
        """Derivatives by the further parameters."""
        return self.rows.jacobian[:, :, self.further]

    @property
    def own(self) -> Array:
        """Those of the further parameters that are not searched for."""
        return self.rows.jacobian[:, :, self._own]

    @property
    def of_time(self) -> bool:
        """Whether all that is new follows the time, as a walk does."""
        return bool(self.added) and all(effect.definition.follows_time for effect in self.added)


def _on_the_same_rows(smaller: FittedModel, larger: FittedModel) -> tuple[Problem, Solution]:
    """Return the smaller model fitted to the rows that the larger one believes."""
    if np.array_equal(smaller.outliers, larger.outliers):
        return smaller.problem, smaller.solution
    problem = Problem(smaller.problem.model, smaller.observations)
    problem.leave_out(larger.outliers)
    return problem, minimise(problem, smaller.solution.theta, smaller.solution.frame, smaller.free)


LN10 = float(np.log(10))


@dataclass(frozen=True)
class EffectTest(Result):
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
    as_a_walk : bool
        Whether what follows the time would be beyond chance if the set-up were known not to wander otherwise.
    """

    p_value: float
    log10_p: float
    statistic: float
    degrees_of_freedom: tuple[float, float]
    design_effect: float
    only_at: tuple[str, int] | None = None
    as_a_walk: bool = False

    _keys = "p_value statistic degrees_of_freedom design_effect significant"

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
            f"{effect.title} is known at the {positions} positions of {joint}: they show what kind of "
            "motion it is, but not what it does between them. More positions would tell."
        )


def worth_of(fit: FittedModel, effect: Effect, without: FittedModel | None = None) -> EffectTest | None:
    """Return the test of one of a fit's effects, given all others.

    Parameters
    ----------
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
    smaller, larger = with_the_same_weights(smaller, larger)
    further = further_combinations(smaller, larger)
    residual_dof = larger.degrees_of_freedom
    if further < 1 or residual_dof < 1:
        return None
    with one_thread_in_blas():
        models = NestedModels(smaller, larger)
        known = np.inf
        if larger.dependence.correlation.independent:
            fall, left = models.fall, larger.chi_square / residual_dof
            design_effect = design_effect_of_fits(smaller, larger, left)
        else:
            fall, left, design_effect = generalised_f(models, further, residual_dof)
            known = known_degrees_of_freedom(models)
        tries = _tried(smaller, larger)
        by_position, of_kind = _log_p_by_position(models, tries)
        poses = len(np.unique(larger.observations.pose[~larger.outliers]))
        independent = residual_dof * min(poses / (residual_dof + larger.determinacy.rank), 1.0)
        walks = log_p_where_it_wanders(models, independent, design_effect) if models.of_time else -np.inf
    dof = (float(further), max(min(independent, known), 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        statistic = float(np.divide(fall / further, left * design_effect)) if fall > 0 else 0.0
    log10 = at_rest = log10_f_tail(statistic, *dof) + float(np.log10(tries))
    if np.isfinite(walks):
        log10 = walks / LN10 + float(np.log10(tries))
    log10 = min(max(log10, by_position / LN10), 0.0)
    only_at = few_positions(models.added[0], larger.observations) if of_kind else None
    as_a_walk = bool(np.isfinite(walks)) and at_rest < np.log10(EFFECT_TEST.significant) < log10
    return EffectTest(p_of_log10(log10), log10, statistic, dof, design_effect, only_at, as_a_walk)


def _log_p_by_position(models: NestedModels, tries: int) -> tuple[float, bool]:
    """Return the logarithm of the probability by the positions of a joint; -inf where readings are what counts.

    And whether the positions show the kind of motion only, not its shape.
    """
    o, added = models.rows.observations, models.added
    joint = position_of(added[0], o) if len(added) == 1 else None
    if joint is None or not models.own.shape[2]:
        return -np.inf, False
    whiten = models.larger.dependence.correlation.whiten
    by_shape, enough = log_p_by_position(
        o, models.model, models.own, models.residual, whiten, joint, models.searched, float(tries)
    )
    enough = enough or by_shape < np.log(EFFECT_TEST.significant)
    if enough or models.searched or added[0].definition.own or joint != added[0].place:
        return by_shape, False
    return min((by_shape, False), (log_p_of_kind(models, joint), True))


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


# Whether a bound of the machine file keeps a fit from the readings.


def are_wrong(bounded: FittedModel, freed: FittedModel) -> bool:
    """Return whether the readings contradict bounds.

    Parameters
    ----------
    bounded, freed : FittedModel
        With bounds that hold it, and the same without these.
    """
    test = effect_test(bounded, freed)
    return test is not None and test.significant


def held_at_bounds(bounded: FittedModel, freed: FittedModel) -> str:
    """Return a sentence on bounds that hold a fit, and what they cost.

    Parameters
    ----------
    bounded, freed : FittedModel
        With bounds that hold it, and the same without these.
    """
    held = [e for e in bounded.estimates.values() if e.at_bound]
    units = ["" if e.unit == "1" else f" {e.unit}" for e in held]
    names = joined([e.key for e in held])
    ends = joined([f"{e.value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    free = joined([f"{freed.estimates[e.key].value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    is_held, it = ("is held at its bound", "it") if len(held) == 1 else ("are held at their bounds", "these")
    test = effect_test(bounded, freed)
    p = f" ({chance(test.p_value)})" if test else ""
    error = fall(bounded.rms, freed.rms, bounded.unit)
    return f"{names} {is_held}, {ends}; without {it} the error {error}{p}, with {names} = {free}."


# What kind of motion a joint makes at positions that are too few to show its shape.
#
# The readings show, say, that it is a translation along the axis, whatever its size at each position. That is tested
# against all other motions of what the joint carries, after all that other effects of this joint could do by a motion
# of the same kind: only then does no shape need to tell them apart.


def log_p_of_kind(models: NestedModels, joint: str) -> float:
    """Return the logarithm of the probability that chance makes a joint move as an effect does, by whatever amounts.

    Parameters
    ----------
    models : NestedModels
        The larger one with one effect more, a function of the coordinate of its joint.
    joint : str
        In few positions.

    Returns
    -------
    float
        0 where the positions are too few for that, too, or other effects are motions of this kind of any shape; minus
        infinity where positions are nearly as many as poses.
    """
    residual = models.residual
    rows = rows_by_position(models.rows.observations, joint)
    if rows is None:
        return -np.inf
    motions, rivals, searched_rivals = _motions(models, joint)
    at = bases_by_rows(models.own, rows)
    base = ColumnSpace.of(models.model.reshape(len(at), -1))
    kind = base.visible_part(unit_columns(at), SELECTION.visible)
    alike = []
    # where a value is searched for, the shape is anything
    for rival in (*rivals, *(bases_by_rows(c, rows).reshape(*c.shape[:2], -1) for c in searched_rivals)):
        seen = base.visible_part(unit_columns(rival.reshape(len(at), -1)), SELECTION.visible)
        if np.sum((kind.T @ seen) ** 2) > SELECTION.same * seen.shape[1]:
            alike.append(rival)
    own = at.reshape(*residual.shape, -1)
    every = np.concatenate([at, bases_by_rows(motions, rows)], axis=1)
    # a part that repeats at the same positions does not come from a wandering set-up
    whiten = estimate_correlation(models.rows, (), included=[every.reshape(*residual.shape, -1)]).whiten
    found = explained_within(
        np.concatenate([models.model, *alike], axis=2), own, [every], residual, whiten, 0
    )
    return 0.0 if found.few < found.freedoms else found.log_p


def _motions(models: NestedModels, joint: str) -> tuple[Array, list[Array], list[Array]]:
    """Return derivatives by the motions of what a joint carries, and by other effects of that joint.

    The latter are those without, then those with searched parameters.
    """
    o = models.rows.observations
    effects = [e for e in catalogue_effects(models.larger.machine, o) if e.place == joint]
    bare = [e for e in bare_effects(models.larger.machine) if e.place == joint]
    problem, theta = problem_with(models.larger, [*effects, *bare], models.rows.rows)
    columns = problem.jacobian(theta, models.larger.solution.frame)
    index = {parameter.key: i for i, parameter in enumerate(problem.model.parameters)}
    motions = [index[key] for x in MOTIONS if (key := bare_key(joint, x)) in index]
    rivals: tuple[list[Array], list[Array]] = [], []
    for effect in effects:
        own = columns[:, :, [i for key, i in index.items() if effect.owns(key)]]
        rivals[bool(effect.definition.searched)].append(own)
    return columns[:, :, motions], *rivals


# Tests of further parameters where successive poses, or readings of one pose, may share errors.


def generalised_f(models: NestedModels, further: int, residual_dof: int) -> tuple[float, float, float]:
    """Return the fall of the sum of squares, the variance of what remains, and the design effect."""
    correlation = models.larger.dependence.correlation
    sizes = np.cumsum([x.shape[2] for x in (models.model, models.rows.model, models.new)])
    residuals = models.residual[:, :, None], models.rows.residual[:, :, None]
    parts = [models.model, models.rows.model, models.new, *residuals]
    white = correlation.whiten(np.concatenate(parts, axis=2)).reshape(models.residual.size, -1)
    small, large, new = np.split(white[:, :-2], sizes[:-1], axis=1)
    base = ColumnSpace.of(unit_columns(small))
    before = base.project_out(white[:, -2])
    after = ColumnSpace.of(unit_columns(large)).project_out(white[:, -1])
    remains = float(after @ after)
    part = models.residual.size / max(models.larger.rows * models.residual.shape[1], 1)
    left = remains / max(part * residual_dof, 1.0)
    directions, _, _ = svd(base.project_out(unit_columns(new)), full_matrices=False)
    pose = np.repeat(models.rows.observations.pose, models.residual.shape[1])
    effect = design_effect(directions[:, :further], after, pose, left)
    return max(float(before @ before) - remains, 0.0), left, effect


def known_degrees_of_freedom(models: NestedModels) -> float:
    """Return as many degrees of freedom as the variance of what is new has, because V is estimated.

    2 over the variance of the logarithm of its generalised variance, a parameter (Satterthwaite 1946).
    """
    k, size = models.model.shape[2], np.linalg.norm(models.new.reshape(models.residual.size, -1), axis=0)
    size[size == 0.0] = 1.0  # what a time constant of nearly zero does

    def log_variance(white: Array) -> float:
        flat = white.reshape(models.residual.size, -1)
        base = ColumnSpace.of(unit_columns(flat[:, :k]))
        seen, left = base.project_out(flat[:, k:-1]), base.project_out(flat[:, -1])
        values = singular_values(seen / size)
        left = ColumnSpace.of(unit_columns(seen)).project_out(left)
        return float(np.log(left @ left) - 2 * np.mean(np.log(values[values > DEPENDENT * values[0]])))

    columns = np.concatenate([models.model, models.new, models.rows.residual[:, :, None]], axis=2)
    pairs = models.larger.dependence.correlation.whiten_within_error(columns)
    error = sum((log_variance(one) - log_variance(other)) ** 2 / 4 for one, other in pairs)
    return 2 / error if error > 0 else np.inf


def log_p_where_it_wanders(models: NestedModels, independent: float, design_effect: float) -> float:
    """Return the logarithm of the probability where the set-up wanders by an amount that is not known."""
    motion, groups = shared_motion(models.rows)
    old = [i for i in models.larger.moving if i not in models.further]
    N = models.residual.size
    basis = orthonormal_basis(models.rows.jacobian[:, :, old].reshape(N, -1))
    new = visible_part(basis, unit_columns(models.new.reshape(N, -1)), DEPENDENT)
    dof = float(believed_readings(models.rows).sum() - basis.shape[1] - new.shape[1]), independent
    none = MotionDeviations(np.zeros(motion.dof), np.zeros(motion.dof), np.inf)
    estimated = models.larger.dependence.correlation.deviations or none
    residual = models.residual.ravel()
    return log_p_under_walks(motion, groups, basis, new, residual, dof, estimated, design_effect)


# By what factor readings of one pose make chance look larger (Rao and Scott 1987).
#
# Readings of one pose may share what is no motion of the frame, such as where a joint stopped: an effect that acts on
# whole poses fits that, too. So residuals count as much as they scatter along the new parameters from pose to pose,
# by residuals with the correction of Bell and McCaffrey (2002).


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
