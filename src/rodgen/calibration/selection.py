"""The cheapest set of effects, and what else would do instead of each of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.diagnosis import Ranked
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.sensitivities import NUMBER
from rodgen.machines.plausibility import kind_of_machine
from rodgen.stages import stage
from rodgen.statistics.thresholds import COST, VERDICT

BEAM = 4
"""Sets that are kept from one size to the next."""
PROMISING = 12
"""Candidates, the likeliest by a bound, whose cost is computed for each set."""
LOOKAHEAD = 6.0
"""How much dearer a larger set may be than the best one before the search ends: two effects may hide each other."""
FEW = 8
"""Candidates of which pairs with their best partners are looked at."""

MOST_REPLACED = 3
"""Effects that one may replace, such as three zeros by one offset of a target."""


@stage("testing effects")
def select(evidence: Evidence, before: Sequence[Candidate] = ()) -> list[Candidate]:
    """Return the cheapest set of candidates: a beam forwards, then exchanges, removals and merges.

    They begin with what was chosen before among these candidates, or fewer of them. Empty where no set is so many
    times as probable as none; see `COST.something`.
    """
    best = _grown(evidence, [c for c in before if c in evidence.candidates])
    while (better := _improved(evidence, best)) is not None:
        best = better
    best = _needed(evidence, best)
    if evidence.cost([]) - evidence.cost(best) < COST.something:
        return []
    return _needed(evidence, _named(evidence, _plausible(evidence, best)))


def ordered(evidence: Evidence, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Return a set in the order in which its effects lower the cost most, those of the catalogue before forms.

    Of a robot zeros come first, then its other dimensions, then weight and loads.
    """
    left, order = list(chosen), list[Candidate]()
    robot = kind_of_machine(evidence.base.machine) == "robot"
    while left:
        larger = evidence.weighed([*order, c] for c in left)

        def place(some: Sequence[Candidate]) -> tuple[bool, int, float]:
            last = some[-1]
            return bool(last.driver), last.effect.definition.rung if robot else 0, evidence.cost(some)

        order = min(larger, key=place)
        left = [c for c in left if c is not order[-1]]
    return order


def _grown(evidence: Evidence, best: list[Candidate]) -> list[Candidate]:
    """Return the cheapest set that a beam finds by steps forwards."""
    beam = [best]
    for _ in range(COST.most - len(best)):
        limit = evidence.cost(best) + LOOKAHEAD
        near = evidence.promising(beam, PROMISING, limit)
        larger = [[*chosen, c] for chosen, some in zip(beam, near, strict=True) for c in some]
        # two effects may hide each other
        larger += [[*beam[0], a, b] for a, b in _pairs(evidence, beam[0], limit)]
        grown = dict[frozenset[tuple[str, str | None]], list[Candidate]]()
        for tried in sorted(evidence.weighed(larger), key=evidence.cost):
            grown.setdefault(frozenset(c.key for c in tried), tried)
        beam = [*grown.values()][:BEAM]
        if not beam or evidence.cost(beam[0]) > limit:
            break
        best = min([best, beam[0]], key=evidence.cost)
    return best


def _improved(evidence: Evidence, chosen: list[Candidate]) -> list[Candidate] | None:
    """Return a cheaper set, with one less, one or two instead of one, or one instead of several; None without.

    An effect of all legs and a second one are also replaced by two effects of single legs, and the other way round.
    """
    others, cost = [chosen[:i] + chosen[i + 1 :] for i in range(len(chosen))], evidence.cost(chosen)
    tried = [*others]
    for rest, near in zip(others, evidence.promising(others, PROMISING, cost), strict=True):
        tried += [[*rest, c] for c in near]
        tried += [[*rest, a, b] for a, b in _pairs(evidence, rest, cost)]
    tried += [[*(c for c in chosen if c not in two), *new] for two, new in _sums(evidence, chosen)]
    (more,) = evidence.promising([chosen], PROMISING)
    tried += (merged := evidence.weighed([*chosen, c] for c in more))
    while merged := [some for some in merged if len(some) > 2]:
        less = [_less(evidence, some) for some in merged]
        evidence.weighed(itertools.chain(*less))
        nearest = [min(some, key=evidence.cost) for some in less]
        # two effects may hide each other
        both = zip(nearest, merged, strict=True)
        merged = [new for new, old in both if evidence.cost(new) < evidence.cost(old) + LOOKAHEAD]
        tried += merged
    few = (some for some in tried if len(some) <= max(COST.most, len(chosen)))
    better = min(evidence.weighed(few), key=evidence.cost, default=chosen)
    return better if evidence.cost(better) < cost - 1e-6 else None


def _less(evidence: Evidence, merged: list[Candidate]) -> list[list[Candidate]]:
    """Return a set without one of its candidates but the last: those two that seem to cost least."""
    dearer = evidence.dearer_without(merged)[:-1]
    return [[*merged[:i], *merged[i + 1 :]] for i in np.argsort(dearer, kind="stable")[:2].tolist()]


def _pairs(
    evidence: Evidence, rest: Sequence[Candidate], under: float = math.inf
) -> list[tuple[Candidate, Candidate]]:
    """Return the pairs of candidates that may explain most beside a set: each likely one with its best partner.

    Only those with which it may cost less than a limit.
    """
    pairs = dict[frozenset[tuple[str, str | None]], tuple[Candidate, Candidate]]()
    (near,) = evidence.promising([rest], FEW)
    partners = evidence.promising([[*rest, a] for a in near], 2, under)
    for a, some in zip(near, partners, strict=True):
        for b in some:
            pairs.setdefault(frozenset({a.key, b.key}), (a, b))
    return list(pairs.values())


def _sums(
    evidence: Evidence, chosen: Sequence[Candidate]
) -> Iterator[tuple[tuple[Candidate, ...], tuple[Candidate, ...]]]:
    """Yield pairs with an effect of all legs, and pairs of its terms, the same at each leg, and the other way round.

    Either may be the cause.
    """
    free = [c for c in evidence.candidates if c.key not in evidence.refused]
    for whole in (c for c in free if c.effect.definition.of_all_legs):
        formula = whole.effect.definition.formula
        terms = [c for c in free if c.effect.place and c.effect.definition.formula == formula]
        for two in itertools.combinations(chosen, 2):
            out = {c.key for c in chosen if c not in two}
            if whole in two:
                several: Iterator[tuple[Candidate, Candidate]] = itertools.combinations(terms, 2)
            elif two[0] in terms and two[1] in terms:
                several = ((whole, one) for one in terms if one not in two)
            else:
                continue
            yield from ((two, new) for new in several if not any(c.key in out for c in new))


def _needed(evidence: Evidence, chosen: list[Candidate]) -> list[Candidate]:
    """Return the set without effects that it hardly needs."""
    while chosen:
        weak = min(chosen, key=lambda c: worth(evidence, chosen, c))
        if worth(evidence, chosen, weak) >= COST.needed:
            break
        chosen = [c for c in chosen if c is not weak]
    return chosen


def worth(evidence: Evidence, chosen: Sequence[Candidate], one: Candidate) -> float:
    """Return what a set costs more without one effect; nothing where others' formulas need only be a little wrong.

    An effect whose formula is imperfect leaves a part that another effect at the same place, or of the whole machine,
    may look like.
    """
    others, place = [c for c in chosen if c is not one], one.effect.place
    near = [c for c in others if place is None or c.effect.place in {place, None}]
    explained = evidence.explained(chosen) - evidence.explained(others)
    if explained < evidence.imperfect**2 * evidence.inexact(near):
        return 0.0
    return evidence.cost(others) - evidence.cost(chosen)


def _plausible(evidence: Evidence, chosen: list[Candidate]) -> list[Candidate]:
    """Return the set with each effect exchanged for what such machines rather have, where formulas decide no more.

    The table of odds is true to a factor; what it makes more probable by that alone is no better than what is usual.
    What replaces an effect must itself be needed.
    """
    for k in range(len(chosen)):
        rest = [c for c in chosen if c is not chosen[k]]
        (near,) = evidence.promising([rest], PROMISING)
        evidence.weighed([*rest, c] for c in near)
        near = [c for c in near if evidence.cost([*rest, c]) + COST.needed <= evidence.cost(rest)]
        dearer = {chosen[k]: 0.0} | {c: _dearer(evidence, chosen, rest, [c]) for c in near}
        alike = [c for c in dearer if dearer[c] < min(dearer.values()) + COST.alike]
        best = max(alike, key=lambda c: (c.prior.log_odds, -dearer[c]))
        chosen = [*chosen[:k], best, *chosen[k + 1 :]]
    return chosen


def _named(evidence: Evidence, chosen: list[Candidate]) -> list[Candidate]:
    """Return the set with effects of the catalogue instead of forms that fit the readings hardly better.

    What nobody has named has no usual size, so that the size of what has one decides nothing between the two. Nor does
    the number of its parameters where an effect fits as well: the form is a part of it.
    """
    for form in [c for c in chosen if c.driver]:
        rest, model = [c for c in chosen if c is not form], evidence.model_for(chosen)
        limit = evidence.misfit(chosen) + COST.needed
        least = evidence.explained(chosen, model) - COST.needed * evidence.variance(model, chosen)
        near = [
            c
            for c in evidence.promising([rest], 2 * PROMISING)[0]
            if not c.driver
            and (evidence.misfit([*rest, c]) < limit or evidence.explained([*rest, c], model) >= least)
        ]
        best = min(near, key=lambda c: evidence.misfit([*rest, c]), default=form)
        chosen = [*rest, best]
    return chosen


def _dearer(
    evidence: Evidence, chosen: Sequence[Candidate], rest: Sequence[Candidate], new: Sequence[Candidate]
) -> float:
    """Return how much dearer a set is with other effects instead of some, as far as formulas are exact.

    What the effects in question explain they explain to a part `Evidence.imperfect`: a difference in chi-square that is
    smaller says nothing. What says nothing is no more than what the other effects cost by what they leave: where they
    leave far more, that grows with its logarithm.
    """
    tried = [*rest, *new]
    more = evidence.cost(tried) - evidence.cost(chosen)
    if not math.isfinite(more):
        return more
    # errors that readings share may explain what the other effects do not
    model = evidence.model_for(tried)
    variance, whole = evidence.variance(model, chosen), evidence.explained(chosen, model)
    inexact = max(evidence.inexact(chosen, model) - evidence.inexact(rest, model), 0.0)
    known = evidence.imperfect**2 * inexact / variance
    better = (whole - evidence.explained(tried, model)) / variance
    left = max(evidence.misfit(tried) - evidence.misfit(chosen), 0.0)
    return more - min(max(better, -known), known, left)


@dataclass(frozen=True)
class Equal:
    """Effects that may replace others that were chosen.

    Attributes
    ----------
    replaced : tuple of Candidate
        One to three of the set.
    candidates : tuple of Candidate
        One or more in their place.
    cost : float
        How much dearer the set is with them.
    """

    replaced: tuple[Candidate, ...]
    candidates: tuple[Candidate, ...]
    cost: float


def _is_listed(evidence: Evidence, c: Candidate) -> bool:
    """Return whether a candidate may be named beside others: of the catalogue, of many curves, or a dimension."""
    return evidence.curves or c.effect.name == NUMBER or not c.effect.definition.own


def _parts(evidence: Evidence, rest: Sequence[Candidate], one: Candidate) -> list[Candidate]:
    """Return effects of fewer columns that together may replace one, such as zeros an offset.

    As many as it has columns at most: each explains most of what those before it leave.
    """
    left = [c for c in evidence.candidates if len(c.names) < len(one.names) and _is_listed(evidence, c)]
    parts = list[Candidate]()
    for _ in one.names:
        there = {*(c.key for c in (*rest, *parts)), *evidence.refused}
        left = [c for c in left if c.key not in there]
        if left:
            parts.append(max(left, key=lambda c: evidence.explained([*rest, *parts, c])))
    return parts


@stage("what else would explain it")
def equals(evidence: Evidence, chosen: Sequence[Candidate]) -> list[Equal]:
    """Return what these data cannot distinguish from the effects of a set, the likeliest first.

    One effect instead of one, two or as many as it has columns instead of one, one instead of several, and two
    instead of two.
    """
    equal_sets = list[Equal]()
    for one in chosen:
        rest = [c for c in chosen if c is not one]
        (near,), parts = evidence.promising([rest], PROMISING), _parts(evidence, rest, one)
        tried = [(c,) for c in near] + _pairs(evidence, rest)
        equal_sets += _alike(
            evidence, chosen, (one,), [*tried, *(parts[:n] for n in range(3, len(parts) + 1))]
        )
    sums = [*_sums(evidence, chosen)]
    for several in (s for n in range(2, MOST_REPLACED + 1) for s in itertools.combinations(chosen, n)):
        rest = [c for c in chosen if c not in several]
        (near,) = evidence.promising([rest], FEW)
        others = [(c,) for c in near] + [new for two, new in sums if two == several]
        if len(several) == 2 and not any(c.prior.certain for c in several):
            others += _pairs(evidence, rest)
        equal_sets += _alike(evidence, chosen, several, others)
    equal_sets += _shared(evidence, chosen, equal_sets)
    return sorted(equal_sets, key=lambda one: one.cost)


def _alike(
    evidence: Evidence,
    chosen: Sequence[Candidate],
    replaced: tuple[Candidate, ...],
    tried: Sequence[Sequence[Candidate]],
) -> list[Equal]:
    """Return which of some sets, the smaller ones first, may replace effects that were chosen.

    More effects only where fewer of them would not do. The readings may make them `COST.tied` less probable, and what
    machines have one as much again: that is no reading. Instead of what every such machine has only readings count.
    """
    rest = [c for c in chosen if c not in replaced]
    certain, choice = any(c.prior.certain for c in replaced), evidence.choice(chosen)
    out, alike = {c.key for c in replaced}, dict[frozenset[tuple[str, str | None]], Equal]()
    tried = [some for some in tried if not any(c.key in out or not _is_listed(evidence, c) for c in some)]
    evidence.weighed([*rest, *some] for some in tried)
    for some in tried:
        keys = frozenset(c.key for c in some)
        more = evidence.cost([*rest, *some]) - evidence.cost(chosen)
        cost = max(
            _dearer(evidence, chosen, rest, some), min(more, 0.0)
        )  # what says nothing makes nothing likelier
        fewer = [x.cost - COST.needed * (smaller < keys) for smaller, x in alike.items() if smaller <= keys]
        before = max(evidence.choice([*rest, *some]) - choice, 0.0)
        if not certain:
            before = min(before, COST.tied) if len(some) == 1 else 0.0
        if cost < min([COST.tied + before, *fewer]):
            alike[keys] = Equal(replaced, tuple(some), cost)
    return [*alike.values()]


def _shared(evidence: Evidence, chosen: Sequence[Candidate], known: Sequence[Equal]) -> list[Equal]:
    """Return effects of which the same one elsewhere may have a part, where the readings do not say which part.

    Only where that alone would not do, as is known. The readings may make both together `COST.tied` less probable, and
    what machines have as much again. Of one of an unusual size any other effect may have a part, such as a zero of the
    joint before that of an axis's tilt, where both together are no less probable than `COST.tied` in all.
    """
    out, best = {*(c.key for c in chosen), *evidence.refused}, dict[tuple[Any, ...], Equal]()
    alone = {(one.replaced, one.candidates[0].key) for one in known if len(one.candidates) == 1}
    others = [b for b in evidence.candidates if b.key not in out and _is_listed(evidence, b)]
    strange = [a for a in chosen if _is_unusual(evidence, chosen, a)]
    pairs = [(a, b) for a in chosen for b in others if a in strange or a.effect.name == b.effect.name]
    evidence.weighed([*chosen, b] for a, b in pairs)
    for a, b in pairs:
        more, key = [*chosen, b], ((a,), b.key)
        cost = evidence.cost(more) - evidence.cost(chosen)
        alike = a.effect.name == b.effect.name
        before = min(evidence.choice(more) - evidence.choice(chosen), COST.tied) if alike else 0.0
        if key not in alone and cost < min(COST.tied + before, best[key].cost if key in best else math.inf):
            (size, std), (size_beside, beside) = evidence.size(chosen, a), evidence.size(more, a)
            if np.any(np.hypot(size_beside - size, beside)[std > 0] > COST.shared * std[std > 0]):
                best[key] = Equal((a,), (a, b), cost)
    return [*best.values()]


def _is_unusual(evidence: Evidence, chosen: Sequence[Candidate], one: Candidate) -> bool:
    """Return whether few machines have so much of one of a set of effects."""
    size, std = evidence.size(chosen, one)
    usual = one.prior.usual(one.short_names)
    return bool(np.any(np.abs(size) - COST.certain * std > VERDICT.unusual * usual))


def ranking(evidence: Evidence) -> tuple[Ranked, ...]:
    """Return every effect of the catalogue, weighed on the model without anything, the most probable first."""
    nothing, total = evidence.cost([]), evidence.models[0].square
    best: dict[tuple[str, str | None], Ranked] = {}
    for (c,) in evidence.weighed([one] for one in evidence.candidates if _is_listed(evidence, one)):
        explains = evidence.explained([c]) / total if total > 0 else 0.0
        one = Ranked(c.effect, log10_of(nothing - evidence.cost([c])), evidence.visible(c), explains)
        if c.key not in best or one.log10_odds > best[c.key].log10_odds:
            best[c.key] = one
    for c in evidence.unseen:
        best.setdefault(c.key, Ranked(c.effect, -math.inf, evidence.visible(c), 0.0))
    return tuple(sorted(best.values(), key=lambda one: -one.log10_odds))


def log10_of(cost: float) -> float:
    """Return the logarithm of the odds that a difference of costs is."""
    return cost / 2 / math.log(10)
