"""Whether an effect takes away more of the error than chance does: the one test that `add` and `diagnose` report.

A larger model always fits better. The fall of the sum of squares for each further parameter is held against what
remains, by F, given all else that the larger model has, with what `design_effect` says of readings of one pose; the
degrees of freedom count a pose as one. Where successive poses or readings of one pose may share errors (what chance
does in one of ten data sets is allowed for), residuals of both models are whitened and fitted to first order
(generalised least squares); how well the variances of that are known then limits the degrees of freedom
(`shared_errors`). A function of one coordinate is tested by its distinct positions (`positions`), or, where these are
too few to show its shape, for the kind of motion that the joint makes at them (`kind_of_motion`); one of time against
walks of all sizes (:mod:`rodgen.statistics.unknown_walk`), whether these can be seen or not. A parameter that was
searched for had many chances: the probability is multiplied by their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.calibration.checks.design_effect import design_effect_of_fits
from rodgen.calibration.checks.kind_of_motion import log_p_of_kind
from rodgen.calibration.checks.nested_models import NestedModels, further_combinations, with_the_same_weights
from rodgen.calibration.checks.positions import few_positions, log_p_by_position, position_of
from rodgen.calibration.checks.shared_errors import (
    generalised_f,
    known_degrees_of_freedom,
    log_p_where_it_wanders,
)
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.machines.effects.definition import StartSearch
from rodgen.statistics.f_tests import log10_f_tail, p_of_log10
from rodgen.statistics.thresholds import EFFECT_TEST
from rodgen.views import html_of, plain

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.machines.machine import Effect

LN10 = float(np.log(10))


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

    _repr_html_ = html_of

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

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return plain(self, "p_value statistic degrees_of_freedom design_effect significant")


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
