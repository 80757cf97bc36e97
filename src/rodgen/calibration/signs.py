"""Sentences on effects whose sign physics refuses, and on preferred effects that were not chosen."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fit import Estimate
from rodgen.calibration.words import odds_text
from rodgen.errors import joined
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.plausibility import plausibility
from rodgen.statistics.thresholds import COST, SELECTION


def lifted(machine: Machine, effects: Sequence[Effect], estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield a question for weight, and one for a load, that moves parts against gravity.

    Weights at several joints may trade with each other; so it is asked only where none that is significant pulls down.

    Parameters
    ----------
    effects : sequence of Effect
        Of a diagnosis.
    estimates : mapping of str to Estimate
        By the keys of their parameters.
    """
    places: dict[str, list[str]] = {"weight": [], "the load": []}
    for effect in effects:
        sizes = plausibility(machine, effect).sizes
        keys = [effect.key(name) for name, size in sizes.items() if size.positive]
        weights = [estimates[key] for key in keys if key in estimates]
        sure = [one.value for one in weights if abs(one.value) > SELECTION.impossible * (one.std or 0.0)]
        if max(sure, default=0.0) < 0:
            cause = "the load" if "F" in effect.definition.formula.names else "weight"
            places[cause].append(str(effect.place))
    for cause, names in places.items():
        if names:
            yield f"{cause} lifts {joined(dict.fromkeys(names))}: is gravity the right way round?"


def on_preferred(
    evidence: Evidence, chosen: Sequence[Candidate], prefer: Collection[tuple[str, str | None]]
) -> Iterator[str]:
    """Yield a sentence for each preferred effect that was not chosen: its odds, in the place of another one or added.

    Parameters
    ----------
    prefer : collection of (name, place)
        Place None is every place. The odds that a sentence states are those without the preference.
    """
    for name, place in prefer:
        title = f"{name} at {place}" if place else name
        wanted = [c for c in evidence.candidates if c.effect.name == name and place in {None, c.effect.place}]
        if any(c.effect.name == name and place in {None, c.effect.place} for c in chosen):
            continue
        if not wanted:
            unseen = any(c.effect.name == name and place in {None, c.effect.place} for c in evidence.unseen)
            yield f"{title} was preferred, but " + (
                "these data could not show it."
                if unseen
                else "no such effect can be seen in this machine or table."
            )
            continue
        rests = [list(chosen), *([c for c in chosen if c is not one] for one in chosen)]
        best = min(([*rest, c] for rest in rests for c in wanted), key=evidence.cost)
        new, usual = (
            best[-1],
            max(plausibility(evidence.base.machine, best[-1].effect).log_odds, -COST.impossible),
        )
        more = evidence.cost(best) - evidence.cost(chosen) + 2 * (new.prior.log_odds - usual)
        times = f"{odds_text(math.exp(min(more / 2, 700.0)))} times"
        yield f"{new.effect.title} was preferred: it is {times} less probable than what was chosen."
