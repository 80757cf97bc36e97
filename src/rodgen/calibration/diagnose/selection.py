"""Which candidates together explain the residuals, in the space of their columns.

Forward: the candidate that chance imitates least, as long as that is improbable over all of them and errors on poses
left out fall noticeably. Backward: what the others explain as well is removed again; and one or two of the set are
exchanged for a single other that does better. An effect with few parameters is preferred to one
with more that does the same: the larger one must lower chi-square by `SelectionPolicy.parameter_cost` for each further
parameter, and by more than the little by which real effects differ from formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.candidate_space import CandidateSpace, Score
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.held_out_blocks import Blocks
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION

__all__ = ["Selection", "follows_position", "of_one_leg"]

Array: TypeAlias = NDArray[np.float64]

COORDINATE = {"q", "zeta", *(f"P{k}" for k in range(1, 5))}
FIXED = {"L", "N", "U", "V", "EX", "EY", "EZ", "pi"}
"""Names in the formula of an effect for its joint's coordinate, and for what the coordinate does not change."""


@dataclass(frozen=True)
class Selection:
    """Stepwise selection of candidates: forward, exchange, backward.

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
    """

    space: CandidateSpace
    blocks: Blocks
    rows: int
    clusters: Clusters
    stretches: Blocks | None = None
    level: float = SELECTION.family_wise
    _tests: dict[frozenset[tuple[str, str | None]], float] = field(default_factory=dict, repr=False)

    def run(self, residual: Array, total: float) -> list[Candidate]:
        """Return the candidates that explain the residuals, in the order of adding.

        Parameters
        ----------
        residual, total : ndarray, float
            Coordinates of the residuals of the model as it was, and their sum of squares: `CandidateSpace.residual`.
        """
        included = self._forward(residual, total, [])
        for _ in range(3):
            better = self._exchanged(residual, total, included)
            better = self._backward(residual, total, better)
            more = self._forward(residual, total, better)
            if [c.key for c in more] == [c.key for c in included]:
                break
            included = more
        included = self._of_one_cause(residual, total, included)
        return self.pruned(residual, total, self._ordered(residual, total, included))

    def pruned(self, residual: Array, total: float, included: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates needed given all others: beyond chance, and with a lower error on poses left out."""
        kept = self._backward(residual, total, list(included))
        for candidate in list(reversed(kept)):
            others = [c for c in kept if c is not candidate]
            if not self._lowers(others, candidate):
                kept = others
        return kept

    # forward -------------------------------------------------------------------------------------------------

    def _forward(self, residual: Array, total: float, included: list[Candidate]) -> list[Candidate]:
        included = list(included)
        while len(included) < SELECTION.most_steps:
            best = self.best(residual, total, included)
            if best is None or not self.is_worth(residual, total, included, best):
                break
            included.append(best.candidate)
        return included

    def best(self, residual: Array, total: float, included: Sequence[Candidate]) -> Score | None:
        """Return the candidate to add next, None where chance explains as much."""
        left = self.left(residual, total, included)
        scores = self.space.scores(residual, left, included)
        if not scores:
            return None
        tests = self.tests(included)
        # Stricter with each step: each may be wrong, and the model is less exact.
        level = np.log(self.level / (1 + len(included)))
        real = [s for s in scores if s.dof and s.log_p + np.log(tests) < level]
        if not real:
            return None
        real.sort(key=lambda s: s.log_p + SELECTION.rarer.get(s.candidate.effect.name, 0.0))
        first = real[0]
        variance = first.left / max(first.residual_dof, 1)
        needed = SELECTION.parameter_cost(self.rows) * variance

        def alike(score: Score) -> bool:
            saved = first.parameters - score.parameters
            return saved > 0 and first.fall - score.fall < max(needed * saved, SELECTION.alike * first.fall)

        simpler = [s for s in real if alike(s)]
        return min(simpler, key=lambda s: (s.parameters, -s.fall)) if simpler else first

    def is_worth(self, residual: Array, total: float, included: Sequence[Candidate], best: Score) -> bool:
        """Return whether a candidate noticeably lowers the error, beyond an imperfection of an included formula."""
        here = [c for c in included if _related(c, best.candidate)]
        if here:
            others = [c for c in included if not _related(c, best.candidate)]
            explained = self.left(residual, total, others) - self.left(residual, total, included)
            if best.fall < SELECTION.imperfect**2 * explained:
                return False
        columns = [c.columns for c in included]
        chance = best.log_p + self.clusters.penalty(columns, best.candidate.columns)
        chance = max(chance, self._log_p_with_wander(included, best.candidate)) + np.log(self.tests(included))
        return chance < np.log(self.level) and self._lowers(included, best.candidate)

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

    def _lowers(self, included: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether a candidate noticeably lowers the error on poses left out."""
        kinds = [self.blocks]
        if self.stretches is not None and _follows_time(candidate):
            kinds.append(self.stretches)
        if follows_position(candidate):
            kinds += filter(None, [self.blocks.by_position(str(candidate.effect.place))])
        more = [c.columns for c in (*included, candidate)]
        return all(
            blocks.held_out(more) < (1 - SELECTION.noticed) * blocks.held_out(more[:-1]) for blocks in kinds
        )

    def left(self, residual: Array, total: float, included: Sequence[Candidate]) -> float:
        """Return the residual sum of squares with some candidates in the model."""
        base = self.space.base(included)
        along = base.basis.T @ residual
        return max(total - float(along @ along), 1e-12 * total)

    # backward ------------------------------------------------------------------------------------------------

    def _backward(self, residual: Array, total: float, included: list[Candidate]) -> list[Candidate]:
        """Return the effects without those that the others explain as well; the least significant is removed first."""
        included = list(included)
        while included:
            worst, chance = None, np.log(self.level)
            for candidate in included:
                others = [c for c in included if c is not candidate]
                log = self.log_p(residual, total, others, candidate)
                if log > chance:
                    worst, chance = candidate, log
            if worst is None:
                break
            included.remove(worst)
        return included

    def log_p(
        self, residual: Array, total: float, others: Sequence[Candidate], candidate: Candidate
    ) -> float:
        """Return the logarithm of the probability that chance explains as much as an effect, given others.

        It holds for any of the candidates: it is multiplied by the number of independent tests.
        """
        score = self.space.score(others, residual, self.left(residual, total, others), candidate)
        if not score.dof:
            return 0.0
        log = score.log_p + self.clusters.penalty([c.columns for c in others], candidate.columns)
        log = max(log, self._log_p_with_wander(others, candidate))
        return min(log + float(np.log(self.tests(others))), 0.0)

    def tests(self, included: Sequence[Candidate]) -> float:
        """Return the number of independent tests that all candidates amount to, given those included."""
        key = frozenset(c.key for c in included)
        if key not in self._tests:
            scores = self.space.scores(np.zeros(len(self.space.model)), 1.0, included)
            self._tests[key] = self.space.tests(scores, included)
        return self._tests[key]

    # exchange ------------------------------------------------------------------------------------------------

    def _exchanged(self, residual: Array, total: float, included: list[Candidate]) -> list[Candidate]:
        """Return the effects after exchanging one or two for another while that lowers `cost`."""
        best = list(included)
        for _ in range(SELECTION.most_steps):
            found = best
            cost = self.cost(residual, total, best, best)
            for gone in (*combinations(best, 1), *combinations(best, 2)):
                kept = [c for c in best if c not in gone]
                left = self.left(residual, total, kept)
                for score in self.space.scores(residual, left, kept)[: SELECTION.rivals]:
                    if score.candidate in gone or not score.dof:
                        continue
                    tried = [*kept, score.candidate]
                    new = self.cost(residual, total, tried, best)
                    if new < cost - 1e-6:
                        found, cost = tried, new
            if found is best:
                break
            best = found
        return best

    def _of_one_cause(self, residual: Array, total: float, included: list[Candidate]) -> list[Candidate]:
        """Return the effects with two of legs replaced by a single one where these only imitate it.

        What displaces a leg's end or changes its length does nearly the same all over a small workspace, so that two of
        these imitate a third: what one of them leaves falls to another, there or at another leg. One cause is likelier
        than two: it may have a parameter more.
        """
        for gone in combinations(included, 2):
            if not all(map(_is_of_a_leg, gone)):
                continue
            kept = [c for c in included if c not in gone]
            most = self.cost(residual, total, included, included) + SELECTION.parameter_cost(self.rows)
            legs = {c.effect.place for c in gone}
            alone = [
                c
                for c in self.space.candidates
                if _is_of_a_leg(c) and c.effect.place in legs and c not in gone
            ]
            costs = [self.cost(residual, total, [*kept, c], included) for c in alone]
            if costs and min(costs) < most:
                return self._of_one_cause(residual, total, [*kept, alone[int(np.argmin(costs))]])
        return included

    def cost(
        self, residual: Array, total: float, included: Sequence[Candidate], best: Sequence[Candidate]
    ) -> float:
        """Return chi-square, in variances that the best set leaves, plus the cost of each parameter."""
        rank = self.space.base(best).rank
        bent = SELECTION.bent**2 * self.left(residual, total, [])
        variance = max(self.left(residual, total, best), bent) / max(self.space.readings - rank, 1)
        own = self.space.base(included).rank + sum(len(c.searched) for c in included)
        rare = sum(2 * SELECTION.rarer.get(c.effect.name, 0.0) for c in included)
        left = max(self.left(residual, total, included), bent)
        return float(left / variance + SELECTION.parameter_cost(self.rows) * own + rare)

    def _ordered(self, residual: Array, total: float, included: list[Candidate]) -> list[Candidate]:
        """Return the effects in the order in which each lowers the sum of squares most."""
        order: list[Candidate] = []
        rest = list(included)
        while rest:
            nxt = min(rest, key=lambda c: self.left(residual, total, [*order, c]))
            order.append(nxt)
            rest.remove(nxt)
        return order


def _related(one: Candidate, other: Candidate) -> bool:
    """Return whether one may be an imperfection of the other's formula: same place, or both follow temperature."""
    if one.effect.place == other.effect.place:
        return True
    return _is_thermal(one) and _is_thermal(other)


def of_one_leg(candidates: Sequence[Candidate]) -> bool:
    """Return whether all of them are at the same leg of a closed chain."""
    return len({c.effect.place for c in candidates}) == 1 and all(map(_is_of_a_leg, candidates))


def _is_of_a_leg(candidate: Candidate) -> bool:
    return "leg" in candidate.effect.definition.at


def _follows_time(candidate: Candidate) -> bool:
    definition = candidate.effect.definition
    return definition.per_run or "t" in definition.formula.names


def follows_position(candidate: Candidate) -> bool:
    """Return whether an effect is a function of its joint's coordinate alone."""
    definition = candidate.effect.definition
    names = definition.formula.names - definition.parameters.keys()
    return bool(names & COORDINATE) and names <= COORDINATE | FIXED


def _is_thermal(candidate: Candidate) -> bool:
    return bool(candidate.effect.definition.formula.names & {"T", "t"})
