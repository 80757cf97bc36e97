"""Which candidates together explain the residuals, in the space of their columns.

Forward: the candidate that chance imitates least, as long as that is improbable over all of them and errors on poses
left out fall noticeably. Backward: what the others explain as well is removed again; and up to three of the set, or
none, are exchanged for a single other, any two, or one effect at several joints, where these are likelier, over all
sizes that they may have (`Criteria.cost`). An effect with few parameters is preferred to one with more that does the
same, but for what the further parameters cost there, or for the little by which real effects differ from formulas.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rodgen.calibration.diagnose.candidate_space import Score
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.criteria import SHARED, Criteria
from rodgen.machines.effects.plausibility import BALANCED
from rodgen.statistics.thresholds import SELECTION


@dataclass(frozen=True)
class Selection(Criteria):
    """Stepwise selection of candidates: forward, exchange, backward."""

    def run(self) -> list[Candidate]:
        """Return the candidates that explain the residuals, in the order of adding."""
        included = self._forward([])
        for _ in range(3):
            better = self._exchanged(included)
            better = self._backward(better)
            more = self._forward(better)
            if [c.key for c in more] == [c.key for c in included]:
                break
            included = more
        included = self._of_one_cause(included)
        included = self._likeliest(included)
        return self.pruned(self._ordered(included))

    def pruned(self, included: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates needed given all others: beyond chance, and with a lower error on poses left out."""
        kept = self._backward(list(included))
        while kept and (impossible := self.impossible(kept)):
            kept.remove(impossible[-1])
        for candidate in list(reversed(kept)):
            others = [c for c in kept if c is not candidate]
            if not self.lowers_error(others, candidate):
                kept = others
        return kept

    # forward -----------------------------------------------------------------------------------------------

    def _forward(self, included: list[Candidate]) -> list[Candidate]:
        included = list(included)
        while len(included) < SELECTION.most_steps:
            best = self.best(included)
            if best is None or not self.is_worth(included, best):
                break
            included.append(best.candidate)
        return included

    def best(self, included: Sequence[Candidate]) -> Score | None:
        """Return the candidate to add next, None where chance explains as much."""
        real = self._beyond_chance_alone(included)
        while real:
            best = self._simplest(included, real)
            if self._is_possible(included, best) and self.is_beyond_chance(included, best.candidate):
                return best
            real.remove(best)
        return None

    def too_large(self, included: Sequence[Candidate]) -> Candidate | None:
        """Return the candidate that is beyond chance given others, but of a size or sign that no machine has."""
        for score in self._beyond_chance_alone(included):
            if not self._is_possible(included, score) and self.is_beyond_chance(included, score.candidate):
                return score.candidate
        return None

    def _beyond_chance_alone(self, included: Sequence[Candidate]) -> list[Score]:
        """Return the scores that chance hardly reaches, the likeliest effects first."""
        log_tests, level = np.log(self.tests(included)), np.log(self.level)
        real = [
            s
            for s in self.scores(included)
            if s.dof and s.log_p + log_tests - self.log_weight(s.candidate) < level
        ]
        return sorted(real, key=lambda s: s.log_p - s.candidate.prior.log_odds)

    def _is_possible(self, included: Sequence[Candidate], score: Score) -> bool:
        return score.candidate not in self.impossible([*included, score.candidate], score.left)

    def _simplest(self, included: Sequence[Candidate], real: Sequence[Score]) -> Score:
        """Return the first of the scores, or the simplest that explains nearly as much."""
        first = real[0]
        variance = first.left / max(first.residual_dof, 1)
        prices = self.price_of_each(variance, included, [s.candidate for s in real])

        def alike(score: Score, price: float) -> bool:
            less = max((prices[0] - price) * variance, SELECTION.alike * first.fall)
            return score.parameters < first.parameters and first.fall - score.fall < less

        simpler = [s for s, price in zip(real, prices, strict=True) if alike(s, price)]
        return min(simpler, key=lambda s: (s.parameters, -s.fall)) if simpler else first

    def is_worth(self, included: Sequence[Candidate], best: Score) -> bool:
        """Return whether a candidate noticeably lowers the error, beyond an imperfection of an included formula."""
        here = [c for c in included if _related(c, best.candidate)]
        if here:
            others = [c for c in included if not _related(c, best.candidate)]
            explained = self.left(others) - self.left(included)
            if best.fall < SELECTION.imperfect**2 * explained:
                return False
        return self.is_needed(included, best.candidate)

    # backward ----------------------------------------------------------------------------------------------

    def _backward(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects without those that the others explain as well; the least significant is removed first."""
        included = list(included)
        while included:
            worst, chance = None, np.log(self.level)
            for candidate in included:
                others = [c for c in included if c is not candidate]
                log = self.log_doubt(others, candidate)
                if log > chance:
                    worst, chance = candidate, log
            if worst is None:
                break
            included.remove(worst)
        return included

    # exchange ----------------------------------------------------------------------------------------------

    def _exchanged(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects after exchanging up to three for one, two or a group, while that lowers `cost`."""
        best = list(included)
        for _ in range(SELECTION.most_steps):
            cost = self.cost(best, best)
            cheaper = [
                (new, i, kept, tried)
                for i, (kept, tried) in enumerate(self._exchanges(best, cost))
                if (new := self.cost(tried, best)) < cost - 1e-6
            ]
            needed = (
                tried
                for *_, kept, tried in sorted(cheaper)
                if all(
                    self.is_needed([c for c in tried if c is not new], new)
                    for new in tried
                    if new not in kept
                )
            )
            if (found := next(needed, None)) is None:
                break
            best = found
        return best

    def _exchanges(
        self, best: list[Candidate], cost: float
    ) -> Iterator[tuple[list[Candidate], list[Candidate]]]:
        """Yield what is kept of a set, and sets with something else in the place of the rest that may cost less."""
        for count in range(min(len(best), SELECTION.most_exchanged) + 1):
            for gone in combinations(best, count):
                kept = [c for c in best if c not in gone]
                for tried in self._in_their_place(kept, gone, best, cost):
                    yield kept, tried

    def _in_their_place(
        self,
        kept: list[Candidate],
        gone: Sequence[Candidate],
        best: Sequence[Candidate],
        most: float,
    ) -> Iterator[list[Candidate]]:
        """Yield the sets with one candidate, two, or a physical group in the place of those that are gone."""
        scores = [s for s in self.scores(kept) if s.dof]
        variance = self.variance_of_best(best)
        before = self.cost_of_any_size(variance, kept)
        price = self.price_of_each(variance, kept, [s.candidate for s in scores])
        alone = before + price - np.array([s.fall for s in scores]) / variance
        for k in np.flatnonzero(alone[: SELECTION.rivals] < most) if gone else ():
            if scores[k].candidate not in gone:
                yield [*kept, scores[k].candidate]
        if len(kept) + 2 <= SELECTION.most_steps and len(scores) > 1:
            falls = self.space.pair_falls(self.residual, scores, kept) / variance
            costs = np.where(
                np.triu(np.ones_like(falls), 1) > 0, before - falls + price + price[:, None], np.inf
            )
            for k in np.argsort(costs, axis=None)[: SELECTION.pairs]:
                i, j = np.unravel_index(k, costs.shape)
                if not costs[i, j] < most:
                    break
                if not {scores[i].candidate, scores[j].candidate} & set(gone):
                    yield [*kept, scores[i].candidate, scores[j].candidate]
        for name in SHARED:
            members = [s.candidate for s in scores if s.candidate.effect.name == name]
            if len(members) > 1 and len(gone) in {0, len(best)}:
                yield self._cheapest(kept, members[: SELECTION.most_steps - len(kept)], best)

    def sets_like(
        self, included: Sequence[Candidate]
    ) -> Iterator[tuple[tuple[Candidate, ...], tuple[Candidate, ...], float]]:
        """Yield two of the effects, what may be in the place of both, and by how much it costs more than they do."""
        best = list(included)
        most = self.cost(best, best) + SELECTION.unlikely
        for gone in combinations(best, 2):
            kept = [c for c in best if c not in gone]
            for tried in self._in_their_place(kept, gone, best, most):
                new = tried[len(kept) :]
                cost = self.cost(tried, best)
                if cost < most and all(self.is_needed([c for c in tried if c is not n], n) for n in new):
                    yield gone, tuple(new), cost - most + SELECTION.unlikely

    def _cheapest(
        self,
        kept: list[Candidate],
        members: list[Candidate],
        best: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return a set with those of a group's members that are worth their cost together."""
        found = [*kept, *members]
        cost = self.cost(found, best)
        while len(found) > len(kept):
            fewer = [[c for c in found if c is not member] for member in found[len(kept) :]]
            costs = [self.cost(some, best) for some in fewer]
            if not min(costs) < cost:
                break
            found, cost = fewer[int(np.argmin(costs))], min(costs)
        return found

    def _of_one_cause(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects with two of legs replaced by a single one where these only imitate it.

        What displaces a leg's end or changes its length does nearly the same all over a small workspace, so that two of
        these imitate a third: what one of them leaves falls to another, there or at another leg. One cause is likelier
        than two.
        """
        for gone in combinations(included, 2):
            if not all(map(_is_of_a_leg, gone)):
                continue
            kept = [c for c in included if c not in gone]
            legs = {c.effect.place for c in gone}
            alone = [
                [*kept, c]
                for c in self.space.candidates
                if _is_of_a_leg(c) and c.effect.place in legs and c not in gone
            ]
            alone += self._with_lengths(kept, gone, included)
            costs = [self.cost(some, included) for some in alone]
            if costs and min(costs) < self.cost(included, included):
                return self._of_one_cause(alone[int(np.argmin(costs))])
        return included

    def _with_lengths(
        self, kept: list[Candidate], gone: Sequence[Candidate], best: Sequence[Candidate]
    ) -> Iterator[list[Candidate]]:
        """Yield sets with wrong lengths of several legs, and one effect more, in the place of a joint that is off.

        A joint's three coordinates do nearly what the lengths of two legs do, which are set together.
        """
        lengths = [c for c in self.space.candidates if c.effect.name == "leg_zero_offset" and c not in best]
        if len(lengths) < 2 or not any(c.effect.name.endswith("joint_offset") for c in gone):
            return
        several = self._cheapest(kept, lengths, best)
        if len(several) < len(kept) + 2:
            return
        for score in self.scores(several)[: SELECTION.pairs]:
            tried = [*several, score.candidate]
            new = [c for c in tried if c not in kept]
            if all(self.is_needed([c for c in tried if c is not n], n) for n in new):
                yield tried

    def _likeliest(self, included: Sequence[Candidate]) -> list[Candidate]:
        """Return the effects, each exchanged for the likeliest of those that the data cannot tell from it."""
        found = list(included)
        left, variance = self.left(found), self.variance(found)
        for k, own in enumerate(included):
            others = [c for c in found if c is not found[k]]
            without = self.left(others)
            dof = self.space.across(others, own).shape[1] + len(own.searched)
            kept, best = found, 0.0
            for score in self.scores(others)[: SELECTION.rivals]:
                difference = (score.left - left) / variance
                if score.candidate.key == own.key or not self.are_alike(difference, score.parameters - dof):
                    continue
                _, cost = self.preference(kept, k, [score.candidate], difference, (without - left) / variance)
                if cost < best and self.is_needed(others, score.candidate):
                    best, found = cost, [*kept[:k], score.candidate, *kept[k + 1 :]]
        return found

    def _ordered(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects in the order in which each lowers the sum of squares most."""
        order: list[Candidate] = []
        rest = list(included)
        while rest:
            nxt = min(rest, key=lambda c: self.left([*order, c]))
            order.append(nxt)
            rest.remove(nxt)
        return order

    # other candidates --------------------------------------------------------------------------------------

    def without(self, candidate: Candidate) -> Selection:
        """Return the selection without an effect."""
        return replace(
            self, space=self.space.without({candidate.key}), _found=self._found.for_other_candidates()
        )

    def including(self, some: Sequence[Candidate]) -> Selection:
        """Return the selection with candidates that were left out before."""
        return replace(self, space=self.space.including(some), _found=self._found.for_other_candidates())

    def or_balanced(self, chosen: list[Candidate]) -> tuple[Selection, list[Candidate]]:
        """Return the selection and what it chose, or one in which weight may turn joints upwards, if much likelier."""
        balanced = replace(self, balanced=True)
        if any(balanced._is_balanced(given) for given in ([], chosen)):
            better = balanced.run()
            if balanced._is_likelier(better, chosen):
                return balanced, better
        return self, chosen

    def balanced_with(self, candidate: Candidate, chosen: Sequence[Candidate]) -> Selection | None:
        """Return a selection in which weight may turn joints upwards if what it allows is much likelier; else None.

        Parameters
        ----------
        candidate : Candidate
            An effect of the wrong sign.
        chosen : sequence of Candidate
            What was chosen, with it.
        """
        balanced = replace(self, balanced=True)
        if candidate.effect.name in BALANCED and balanced._is_likelier(chosen, self.without(candidate).run()):
            return balanced
        return None

    def _is_likelier(self, better: Sequence[Candidate], other: Sequence[Candidate]) -> bool:
        """Return whether a set in which weight turns joints upwards is much likelier than another."""
        return self.cost(other, better) - self.cost(better, better) > SELECTION.balanced

    def _is_balanced(self, given: list[Candidate]) -> bool:
        """Return whether weight seems to turn a joint upwards where some candidates are in the model."""
        weights = [c for c in self.space.candidates if c.effect.name in BALANCED and c not in given]
        return any(
            not c.prior.is_possible(c.short_names, *self.estimates_of([*given, c])[-1])
            and self.log_p(given, c) < np.log(self.level)
            for c in weights
        )


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


def _is_thermal(candidate: Candidate) -> bool:
    return bool(candidate.effect.definition.formula.names & {"T", "t"})
