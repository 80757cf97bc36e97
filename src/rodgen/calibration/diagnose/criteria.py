"""The criteria of a selection: whether a candidate is needed, given others, and what a set of candidates costs.

Two rules decide. A candidate is *needed*, given others, if chance hardly explains as much and the error on poses left
out falls noticeably. Of two sets, that which *costs* less is the likelier: chi-square, plus what its parameters cost
by how much narrower the data make them than they usually are, plus what odds and sizes before the data cost.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.checks.positions import position_of
from rodgen.calibration.diagnose.candidate_space import CandidateSpace, Score
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.poses import Blocks, Clusters
from rodgen.machines.effects.catalogue import OFFSETS, SCALES, WINDUPS
from rodgen.machines.effects.plausibility import BALANCED, Plausibility
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION

KEPT_SCORES = 512
"""Sets of candidates whose scores are kept."""
SHARED = OFFSETS | SCALES | WINDUPS | {"squareness"}
"""Effects that a machine has at several joints if it has them at one: further ones need no evidence of their kind."""


@dataclass(frozen=True)
class Found:
    """What was found of sets of candidates: rounds of exchanges ask for the same again."""

    tests: dict[frozenset[tuple[str, str | None]], float] = field(default_factory=dict)
    """Numbers of independent tests, by the keys of what is included."""
    scores: dict[tuple[Candidate, ...], list[Score]] = field(default_factory=dict)
    """Scores of all others, by what is included; those asked for last."""
    logs: dict[tuple[frozenset[Candidate], Candidate], float] = field(default_factory=dict)
    """Logarithms of the probability of each candidate by chance, by the others and itself."""
    estimates: dict[tuple[float, tuple[Candidate, ...]], list[tuple[Array, Array]]] = field(
        default_factory=dict
    )
    """Linear estimates, by the variance of a reading and what is included."""

    def for_other_candidates(self) -> Found:
        """Return what holds whichever other candidates there are."""
        return Found(logs=self.logs, estimates=self.estimates)


@dataclass(frozen=True)
class Criteria:
    """Tests and costs of sets of candidates."""

    space: CandidateSpace
    blocks: Blocks
    """Of poses, for the error on poses left out."""
    rows: int
    clusters: Clusters
    """Of readings of one pose."""
    stretches: Blocks | None = None
    """Of time, where the set-up wanders: what follows the time must predict stretches of it that it did not see."""
    level: float = SELECTION.family_wise
    """Rate of false alarms."""
    balanced: bool = False
    """Whether weight may turn any joint upwards, as a counterweight or a spring makes it do."""
    _found: Found = field(default_factory=Found, repr=False)

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

    def scores(self, included: Sequence[Candidate]) -> list[Score]:
        """Return the scores of all other candidates, given some, the best first; those asked for last are kept."""
        key = tuple(included)
        found = self._found.scores.pop(key, None)
        if found is None:
            found = self.space.scores(self.residual, self.left(included), included)
        self._found.scores[key] = found
        if len(self._found.scores) > KEPT_SCORES:
            del self._found.scores[next(iter(self._found.scores))]
        return found

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
        # more sets fail by the error, and the number of tests takes longer
        return self.lowers_error(others, candidate) and self.is_beyond_chance(others, candidate)

    def is_beyond_chance(self, others: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether chance hardly explains as much as a candidate, given others: `log_doubt`."""
        return bool(self.log_doubt(others, candidate) < np.log(self.level))

    def suspected(self, included: Sequence[Candidate]) -> Candidate | None:
        """Return the candidate that is nearest to being needed, if chance explains as much in few data sets only."""
        scores = self.scores(included)
        doubts = {
            s.candidate: self.log_doubt(included, s.candidate) for s in scores[: SELECTION.suspects] if s.dof
        }
        possible = [
            candidate
            for candidate, doubt in doubts.items()
            if doubt < np.log(SELECTION.suspected)
            and candidate not in self.impossible([*included, candidate])
        ]
        return min(possible, key=doubts.__getitem__, default=None)

    def log_doubt(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return what must be below the logarithm of the rate of false alarms.

        It is `log_p`, where the likelier effects before the data have a larger share of the false alarms, and sizes far
        beyond the usual one a smaller share.
        """
        log = self.log_p(others, candidate) - self.log_weight(candidate)
        if log >= np.log(SELECTION.suspected):
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
        key = frozenset(others), candidate
        if key not in self._found.logs:
            score = self.space.score(others, self.residual, self.left(others), candidate)
            penalty = (
                self.clusters.penalty([c.columns for c in others], candidate.columns) if score.dof else 0.0
            )
            wander = self._log_p_with_wander(others, candidate) if score.dof else 0.0
            self._found.logs[key] = max(score.log_p + penalty, wander)
        return self._found.logs[key]

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
        if key not in self._found.tests:
            scores = self.space.scores(np.zeros(len(self.space.model)), 1.0, included)
            self._found.tests[key] = self.space.tests(scores, included)
        return self._found.tests[key]

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
        """Return -2 ln of the probability of a set of candidates, given the data, up to a constant.

        It is that of the readings, over all sizes that the effects may have, and of the choice of these effects; inf
        where no machine has so much of one. The variance is that of a reading that the best set leaves.
        """
        variance = self.variance_of_best(best)
        return self.cost_of_any_size(variance, included) + self._size_cost(variance, included)

    def cost_of_any_size(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return the same but for what sizes cost, given the variance of a reading."""
        products, pull, _ = self._of_usual_sizes(variance, included)
        left = max(
            self.left([]) / variance - float(pull @ np.linalg.solve(products, pull)), self._bent / variance
        )
        return left + self.width_cost(variance, included) + self.choice_cost(included)

    def variance_of_best(self, best: Sequence[Candidate]) -> float:
        """Return the variance of a reading that a set leaves, as far as columns are right."""
        return self.variance(best, max(self.left(best), self._bent))

    @property
    def _bent(self) -> float:
        """The part of what is explained that columns of large effects get wrong."""
        return SELECTION.bent**2 * self.left([])

    def choice_cost(self, included: Sequence[Candidate]) -> float:
        """Return what the choice of these of all candidates costs in units of chi-square.

        The odds of each before the data are shared among all. Further effects of a kind that a machine has at several
        joints, if it has them at one, are no choice.
        """
        return sum(self._choice_cost_of(c, included[:k]) for k, c in enumerate(included))

    def _choice_cost_of(self, candidate: Candidate, others: Sequence[Candidate]) -> float:
        name = candidate.effect.name
        no_choice = name in SHARED and any(c.effect.name == name for c in others)
        return 2 * ((0.0 if no_choice else self._log_choices) - candidate.prior.log_odds)

    @cached_property
    def _log_choices(self) -> float:
        """The logarithm of as many candidates of odds 1 as there is choice among all."""
        return self._mean_odds + float(np.log(len({c.key for c in self.space.candidates})))

    def cost_before(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what candidates cost but for chi-square: their choice, sizes and parameters; inf if impossible."""
        costs = self.choice_cost(included), self._size_cost(variance, included)
        return sum(costs) + self.width_cost(variance, included)

    def width_cost(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what the parameters of candidates cost in units of chi-square: how much narrower the data make them.

        It is -2 ln of the part of the values before the data that remain after them (Laplace's approximation of the
        evidence); ln(rows), as of Schwarz, for one that has no usual size or was searched. Values before the data are
        of the usual sizes or, where the effect is larger, of the size that it has: a tenfold effect is unlikely as a
        whole, which `prior_cost` counts, and each of its parameters has tenfold values to choose from.

        Parameters
        ----------
        variance : float
            Of a reading.
        """
        products, _, larger = self._of_usual_sizes(variance, included)
        searched = sum(len(c.searched) for c in included)
        return float(np.linalg.slogdet(products)[1] - larger + np.log(self.rows) * searched)

    def _of_usual_sizes(self, variance: float, included: Sequence[Candidate]) -> tuple[Array, Array, float]:
        """Return the normal equations of effects in their usual sizes, or larger ones where they are, with these known.

        One without a usual size has as much to choose from as a reading tells of it. By how much that is more than
        usual, `size_cost` halved, summed over the effects, comes last.
        """
        products, pull = self._normal_equations(variance, included)
        estimates = self.estimates(variance, included)
        larger = [
            c.prior.size_cost(c.short_names, values) / 2
            for c, (values, _) in zip(included, estimates, strict=True)
        ]
        times = np.exp(np.repeat(larger, [len(c.names) for c in included]) / 2)
        width = self._usual(included) * times
        width = np.where(np.isfinite(width), width, np.sqrt(self.rows * variance))
        return np.eye(len(width)) + width[:, None] * products * width, width * pull, sum(larger)

    def _normal_equations(self, variance: float, included: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return the products of columns of length 1, and theirs with the residuals, over the variance of a reading."""
        numbers = self.space.numbers(included)
        return self.space.products[np.ix_(numbers, numbers)] / variance, self._pull[numbers] / variance

    @cached_property
    def _pull(self) -> Array:
        """The products of all columns of length 1, across the model, with the residuals."""
        return self.space.across_model.T @ self.residual

    def _usual(self, included: Sequence[Candidate]) -> Array:
        """Return the usual sizes of parameters of columns of length 1; NaN where it is not known."""
        return np.concatenate(
            [np.zeros(0), *(c.prior.usual(c.short_names) * self.space.sizes(c) for c in included)]
        )

    def price_of_each(self, variance: float, given: Sequence[Candidate], some: Sequence[Candidate]) -> Array:
        """Return what each of some candidates would cost at least in addition to others, but for chi-square, (n,)."""
        usual = self._usual(some)
        width = np.where(np.isfinite(usual), usual / np.sqrt(variance), np.sqrt(self.rows))
        columns = np.concatenate([self.space.model[:, :0], *map(self.space.columns, some)], axis=1) * width
        across = self.space.base(given).project_out(columns)
        price = np.array([self._choice_cost_of(candidate, given) for candidate in some])
        price += np.log(self.rows) * np.array([len(c.searched) for c in some])
        sizes = np.array([len(c.names) for c in some])
        starts = np.cumsum(sizes) - sizes
        for size in np.unique(sizes):
            alike = np.flatnonzero(sizes == size)
            own = across.T[starts[alike][:, None] + np.arange(size)]
            price[alike] += np.linalg.slogdet(np.eye(size) + own @ own.transpose(0, 2, 1))[1]
        return price

    def preference(
        self,
        kept: Sequence[Candidate],
        k: int,
        rivals: Sequence[Candidate],
        difference: float,
        explained: float,
    ) -> tuple[float, float]:
        """Return how much dearer rivals are that together do nearly the same, before the data and with them.

        Parameters
        ----------
        kept : sequence of Candidate
            What was found.
        k : int
            Number of the effect among them in whose place the rivals would be.
        difference : float
            By how much chi-square is larger with the rivals. What real effects may differ from their formulas by does
            not count.
        explained : float
            By how much the effect lowers chi-square.

        Returns
        -------
        (float, float)
            In units of chi-square; inf where no machine has so much of a rival.
        """
        variance = self.variance(kept)
        tried = [*kept[:k], *rivals, *kept[k + 1 :]]
        before = self.prior_cost(variance, tried) - self.prior_cost(variance, kept)
        widths = self.width_cost(variance, tried) - self.width_cost(variance, kept)
        choices = 0.0
        if rivals[
            1:
        ]:  # two in the place of one are more to choose from, but for what nearly every machine has
            choices = 2 * self._log_choices * (sum(c.prior.log_odds < 0 for c in rivals) - 1)
        part = SELECTION.imperfect * float(np.sqrt(max(explained, 0.0)))
        counts = max(abs(difference) - part**2 - 2 * part, 0.0)
        return before, float(np.copysign(counts, difference) + before + widths + max(choices, 0.0))

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

        Returns
        -------
        list of (ndarray, ndarray), each of shape (k,)
        """
        key = variance, tuple(included)
        if key not in self._found.estimates:
            self._found.estimates[key] = self._estimated(variance, included)
        return self._found.estimates[key]

    def _estimated(self, variance: float, included: Sequence[Candidate]) -> list[tuple[Array, Array]]:
        if not included:
            return []
        products, pull = self._normal_equations(variance, included)
        lengths = np.concatenate([self.space.sizes(c) for c in included])
        # without a usual size: a million standard deviations
        usual = SELECTION.shrunk * self._usual(included)
        unit = np.where(np.isfinite(usual), usual, 1e6 * np.sqrt(variance))
        covariance = np.linalg.inv(unit[:, None] * products * unit + np.eye(len(unit)))
        unit_of_each = unit / np.where(lengths > 0, lengths, 1.0)
        values = -unit_of_each * (covariance @ (unit * pull))
        std = unit_of_each * np.sqrt(covariance.diagonal())
        ends = np.cumsum([len(c.names) for c in included])[:-1]
        return list(zip(np.split(values, ends), np.split(std, ends), strict=True))
