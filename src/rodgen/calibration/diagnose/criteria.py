"""The criteria of a selection: whether a candidate is needed, given others, and what a set of candidates costs.

Two rules decide. A candidate is *needed*, given others, if chance hardly explains as much and the error on poses left
out falls noticeably. Of two sets, that which *costs* less is the likelier: chi-square, plus
`SelectionPolicy.parameter_cost` for each parameter, plus what odds and sizes before the data cost.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.positions import position_of
from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.held_out_blocks import Blocks
from rodgen.machines.effects.catalogue import OFFSETS, SCALES, WINDUPS
from rodgen.machines.effects.plausibility import BALANCED, Plausibility
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION

__all__ = ["SHARED", "Criteria"]

Array: TypeAlias = NDArray[np.float64]

SHARED = OFFSETS | SCALES | WINDUPS
"""Effects that a machine has at several joints if it has them at one: further ones need no evidence of their kind."""


@dataclass(frozen=True)
class Criteria:
    """Tests and costs of sets of candidates.

    Attributes
    ----------
    space : CandidateSpace
    blocks : Blocks
        Of poses, for the error on poses left out.
    rows : int
    clusters : Clusters
        Of readings of one pose.
    stretches : Blocks or None
        Of time, where the set-up wanders: what follows the time must predict stretches of it that it did not see.
    level : float
        Rate of false alarms.
    balanced : bool
        Whether weight may turn any joint upwards, as a counterweight or a spring makes it do.
    """

    space: CandidateSpace
    blocks: Blocks
    rows: int
    clusters: Clusters
    stretches: Blocks | None = None
    level: float = SELECTION.family_wise
    balanced: bool = False
    _tests: dict[frozenset[tuple[str, str | None]], float] = field(default_factory=dict, repr=False)

    # what candidates explain -------------------------------------------------------------------------------

    @cached_property
    def _coordinates(self) -> tuple[Array, float]:
        """Coordinates of the residuals of the model as it was, and their whole sum of squares."""
        return self.space.residual(self.clusters.residual)

    @property
    def residual(self) -> Array:
        """Coordinates of the residuals of the model as it was."""
        return self._coordinates[0]

    @property
    def total(self) -> float:
        """Their whole sum of squares."""
        return self._coordinates[1]

    def left(self, included: Sequence[Candidate]) -> float:
        """Return the residual sum of squares with some candidates in the model."""
        base = self.space.base(included)
        along = base.basis.T @ self.residual
        return max(self.total - float(along @ along), 1e-12 * self.total)

    def variance(self, included: Sequence[Candidate], left: float | None = None) -> float:
        """Return the variance of a reading that candidates leave together."""
        left = self.left(included) if left is None else left
        return left / max(self.space.readings - self.space.base(included).rank, 1)

    def lowers_error(self, included: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether a candidate noticeably lowers the error on poses left out."""
        kinds = [self.blocks]
        if self.stretches is not None and candidate.effect.definition.follows_time:
            kinds.append(self.stretches)
        if joint := position_of(candidate.effect, self.blocks.observations):
            kinds += filter(None, [self.blocks.by_position(joint)])
        more = [c.columns for c in (*included, candidate)]
        return all(
            blocks.held_out(more) < (1 - SELECTION.noticed) * blocks.held_out(more[:-1]) for blocks in kinds
        )

    # whether chance explains as much -----------------------------------------------------------------------

    def is_needed(self, others: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether a candidate, given others, explains more than chance does, on poses left out, too."""
        return self.is_beyond_chance(others, candidate) and self.lowers_error(others, candidate)

    def is_beyond_chance(self, others: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether chance hardly explains as much as a candidate, given others: `log_doubt`."""
        return bool(self.log_doubt(others, candidate) < np.log(self.level))

    def log_doubt(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return what must be below the logarithm of the rate of false alarms.

        It is `log_p`, where the likelier effects before the data have a larger share of the false alarms, and sizes far
        beyond the usual one a smaller share.
        """
        log = self.log_p(others, candidate) - self.log_weight(candidate)
        if log >= np.log(self.level):
            return log
        values, _ = self.estimates_of([*others, candidate])[-1]
        return log + candidate.prior.size_cost(candidate.short_names, values) / 2

    def log_p(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much as an effect, given others.

        It holds for any of the candidates: it is multiplied by the number of independent tests. Where weights wind
        up joints, it must hold with a weight at every later joint, too: what the fit takes in is only what the data
        call for, and all parts weigh something.
        """
        log = max(self._log_p(given, candidate) for given in self._with_weights(others))
        tests = self.tests(others)
        name = candidate.effect.name
        if name in SHARED and any(c.effect.name == name for c in others):
            # what yields at one joint yields at others: there is not much to choose from
            tests = min(tests, len({c.key for c in self.space.candidates if c.effect.name == name}))
        return min(log + float(np.log(tests)), 0.0)

    def _log_p(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much as this one effect, given others."""
        score = self.space.score(others, self.residual, self.left(others), candidate)
        if not score.dof:
            return 0.0
        log = score.log_p + self.clusters.penalty([c.columns for c in others], candidate.columns)
        return max(log, self._log_p_with_wander(others, candidate))

    def _log_p_with_wander(self, included: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much, where the wander counts as noise.

        How a set-up wanders is estimated from the same residuals, and once it is taken out some period always fits what
        remains: an effect with a searched value must be seen without that.
        """
        if self.stretches is None or not candidate.searched:
            return -np.inf
        N = len(self.blocks.residual)
        flat = [self.blocks.model, *(c.columns.reshape(N, -1) for c in included)]
        base = ColumnSpace.of(flat)
        visible = base.visible_part(unit_columns(candidate.columns.reshape(N, -1)), SELECTION.visible)
        test = base.score_test(base.project_out(self.blocks.residual), visible)
        return 0.0 if test is None else test.log_p + float(np.log(candidate.tries))

    def _with_weights(self, included: Sequence[Candidate]) -> Iterator[Sequence[Candidate]]:
        """Yield the effects, and the same with a weight at every later joint that has a lever arm."""
        yield included
        most = {c.key: c for c in self.space.candidates if c.later_weights}  # the last one has all of them
        every = [most.get(c.key, c) for c in included]
        if any(map(operator.is_not, every, included)):
            yield every

    def tests(self, included: Sequence[Candidate]) -> float:
        """Return the number of independent tests that all candidates amount to, given those included."""
        key = frozenset(c.key for c in included)
        if key not in self._tests:
            scores = self.space.scores(np.zeros(len(self.space.model)), 1.0, included)
            self._tests[key] = self.space.tests(scores, included)
        return self._tests[key]

    def log_weight(self, candidate: Candidate) -> float:
        """Return the logarithm of a candidate's share of the false alarms, compared with that of all alike.

        The likelier before the data, the larger; the mean of the shares is 1, so that the rate of false alarms over all
        of them is kept (Genovese, Roeder, Wasserman 2006, weighted Bonferroni).
        """
        return min(candidate.prior.log_odds, 0.0) - self._mean_odds

    @cached_property
    def _mean_odds(self) -> float:
        """The logarithm of the mean of the odds of all candidates."""
        odds = {c.key: min(np.exp(c.prior.log_odds), 1.0) for c in self.space.candidates}
        return float(np.log(np.mean(list(odds.values()))))

    # what a set costs --------------------------------------------------------------------------------------

    def cost(self, included: Sequence[Candidate], best: Sequence[Candidate]) -> float:
        """Return chi-square, in variances that the best set leaves, plus what parameters, odds and sizes cost."""
        least = self.least_cost(included, best, self.left(included), self.space.base(included).rank)
        return least + self._size_cost(self.variance_of_best(best), included)

    def least_cost(
        self, included: Sequence[Candidate], best: Sequence[Candidate], left: float, rank: int
    ) -> float:
        """Return the same as `cost` but for what sizes cost, of a set that leaves so much and has such a rank."""
        own = rank + sum(len(c.searched) for c in included)
        shared = SELECTION.parameter * self._shared(included)
        left = max(left, self._bent) / self.variance_of_best(best)
        return float(left + SELECTION.parameter_cost(self.rows) * own - shared + self.odds_cost(included))

    def variance_of_best(self, best: Sequence[Candidate]) -> float:
        """Return the variance of a reading that a set leaves, as far as columns are right."""
        return self.variance(best, max(self.left(best), self._bent))

    @property
    def _bent(self) -> float:
        """The part of what is explained that columns of large effects get wrong."""
        return SELECTION.bent**2 * self.left([])

    def _shared(self, included: Sequence[Candidate]) -> int:
        """Return the number of parameters of effects that a machine has at several joints if it has them at one.

        Weights at later joints are not counted.
        """
        count = 0
        for name in SHARED:
            sizes = [
                max(self.space.across((), c).shape[1] - c.later_weights, 0)
                for c in included
                if c.effect.name == name
            ]
            count += sum(sizes) - max(sizes, default=0)
        return count

    def odds_cost(self, included: Sequence[Candidate]) -> float:
        """Return what the odds of candidates before the data, over their mean, cost in units of chi-square.

        Where most are unlikely, as on a telescope, there is less to choose from, and two likely ones may cost no more
        than an unlikely one.
        """
        return -2 * sum(c.prior.log_odds - self._mean_odds for c in included)

    def _width_cost(self, variance: float, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return what an effect's parameters cost in units of chi-square: how much narrower the data make them.

        It is -2 ln of the part of the values before the data that remain after them (Laplace's approximation of the
        evidence); ln(rows), as of Schwarz, for one that has no usual size or was searched. Values before the data are
        of the usual sizes or, where the effect is larger, of the size that it has: a tenfold effect is unlikely as a
        whole, which `prior_cost` counts, and each of its parameters has tenfold values to choose from.

        Parameters
        ----------
        variance : float
            Of a reading.
        others : sequence of Candidate
            What else is there.
        candidate : Candidate
        """
        names = candidate.short_names
        usual = candidate.prior.usual(names)
        known = np.isfinite(usual)
        values, _ = self.estimates(variance, [*others, candidate])[-1]
        larger = candidate.prior.size_cost(names, values) / 2  # of one parameter, which `prior_cost` has
        columns = self.space.columns(candidate) * np.where(known, usual, 0.0) * self.space.sizes(candidate)
        across = self.space.base(others).project_out(columns) * np.exp(larger / 2)
        narrower = np.linalg.slogdet(np.eye(len(usual)) + across.T @ across / variance)[1]
        return float(narrower - larger + np.log(self.rows) * (np.sum(~known) + len(candidate.searched)))

    def preference(
        self, kept: Sequence[Candidate], k: int, rival: Candidate, difference: float, explained: float
    ) -> tuple[float, float]:
        """Return how much dearer a rival is that does nearly the same, before the data and with them.

        Parameters
        ----------
        kept : sequence of Candidate
            What was found.
        k : int
            Number of the effect among them in whose place the rival would be.
        rival : Candidate
        difference : float
            By how much chi-square is larger with the rival. What real effects may differ from their formulas by does
            not count.
        explained : float
            By how much the effect lowers chi-square.

        Returns
        -------
        (float, float)
            In units of chi-square; inf where no machine has so much of the rival.
        """
        others, variance = [c for c in kept if c is not kept[k]], self.variance(kept)
        tried = [*kept[:k], rival, *kept[k + 1 :]]
        before = self.prior_cost(variance, tried) - self.prior_cost(variance, kept)
        widths = [self._width_cost(variance, others, c) for c in (rival, kept[k])]
        part = SELECTION.imperfect * float(np.sqrt(max(explained, 0.0)))
        counts = max(abs(difference) - part**2 - 2 * part, 0.0)
        return before, float(np.copysign(counts, difference) + before + widths[0] - widths[1])

    def are_alike(self, difference: float, further: int) -> bool:
        """Return whether the data cannot tell two effects apart.

        Parameters
        ----------
        difference : float
            By how much chi-square is larger with the other one.
        further : int
            Parameters that the other one has more.
        """
        each = SELECTION.parameter_cost(self.rows)
        return -each * max(further, 1) < difference < each * max(-further, 1)

    # what is known before the data -------------------------------------------------------------------------

    def prior_of(self, candidate: Candidate) -> Plausibility:
        """Return what is known of a candidate before the data."""
        lifted = self.balanced and candidate.effect.name in BALANCED
        return candidate.prior.of_any_sign if lifted else candidate.prior

    def prior_cost(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what candidates cost in units of chi-square by what is known before the data; inf if impossible."""
        return self._size_cost(variance, included) - 2 * sum(c.prior.log_odds for c in included)

    def _size_cost(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what their sizes cost in units of chi-square; inf if impossible."""
        return sum(
            c.prior.size_cost(c.short_names, values)
            if self.prior_of(c).is_possible(c.short_names, values, std)
            else np.inf
            for c, (values, std) in zip(included, self.estimates(variance, included), strict=True)
        )

    def impossible(self, included: Sequence[Candidate], left: float | None = None) -> list[Candidate]:
        """Return the candidates that have, together with the others, a size or a sign that no machine has.

        Parameters
        ----------
        included : sequence of Candidate
        left : float, optional
            What they leave.
        """
        found = zip(included, self.estimates_of(included, left), strict=True)
        return [c for c, estimates in found if not self.prior_of(c).is_possible(c.short_names, *estimates)]

    def estimates_of(
        self, included: Sequence[Candidate], left: float | None = None
    ) -> list[tuple[Array, Array]]:
        """Return the estimates with the variance that the candidates leave together."""
        return self.estimates(self.variance(included, left), included)

    def estimates(self, variance: float, included: Sequence[Candidate]) -> list[tuple[Array, Array]]:
        """Return the linear estimates of each candidate's parameters with their standard deviations, internal units.

        What the data hardly determine is held within some usual sizes.

        Parameters
        ----------
        variance : float
            Of a reading.
        included : sequence of Candidate

        Returns
        -------
        list of (ndarray, ndarray), each of shape (k,)
        """
        if not included:
            return []
        sizes = [self.space.sizes(c) for c in included]
        units = []
        for c, size in zip(included, sizes, strict=True):
            usual, own = SELECTION.shrunk * c.prior.usual(c.short_names), np.where(size > 0, size, 1.0)
            # without a usual size: a million standard deviations
            units.append(np.where(np.isfinite(usual), usual, 1e6 * np.sqrt(variance) / own))
        ends = np.cumsum([len(unit) for unit in units])[:-1]
        unit = np.concatenate(units)
        columns = np.concatenate(
            [self.space.columns(c) * s for c, s in zip(included, sizes, strict=True)], axis=1
        )
        base = self.space.base()
        across = base.project_out(columns) * unit
        covariance = np.linalg.inv(across.T @ across / variance + np.eye(len(unit)))
        values = -unit * (covariance @ (across.T @ base.project_out(self.residual))) / variance
        std = unit * np.sqrt(covariance.diagonal())
        return list(zip(np.split(values, ends), np.split(std, ends), strict=True))
