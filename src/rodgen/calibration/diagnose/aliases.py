"""Which other effects explain the data as well as one that was found.

Candidates that come near by their columns are fitted in full, in the place of the effect, all in one model that has
them all; pairs are compared by their columns. What has a chi-square that is larger by less than
`SelectionPolicy.parameter_cost` for each parameter that it has fewer, or smaller by less than that for each that it has
more, cannot be distinguished from it, if it has a size that a machine may have. The combination of the model's own
parameters that must change with it is named. Which of them is the likeliest is decided by what is known before the data
(:mod:`rodgen.machines.effects.plausibility`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.diagnose.acceptance import MORE, why_empty
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.diagnosis import Alias
from rodgen.calibration.diagnose.selection import Selection, of_one_leg
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.problem import Problem
from rodgen.calibration.solve.least_squares import minimise
from rodgen.errors import joined
from rodgen.machines.model import Model
from rodgen.statistics.columns import project_out
from rodgen.statistics.decompositions import lstsq
from rodgen.statistics.thresholds import SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


NAMED = 3
"""Most parameters of a combination that are named."""
PART = 0.1
"""Least part of the effect that a parameter of the combination must change the readings by to be named."""
OUTSIDE = "form outside the catalogue"


@dataclass(frozen=True)
class _Alternative:
    """Candidates for the place of an effect; `linear` is by how much chi-square is larger by their columns."""

    candidates: tuple[Candidate, ...]
    dof: int
    linear: float


@dataclass(frozen=True)
class Equal:
    """A candidate, or two, that the data cannot distinguish from an effect that was found."""

    candidates: tuple[Candidate, ...]
    alias: Alias
    cost: float
    """How much dearer it is in units of chi-square: negative where it is the likelier one, all considered."""
    before: float
    """The same before the data."""
    part: float
    """What part of the effect they do not do."""

    @property
    def likelier(self) -> bool:
        """Whether it is to be named: it is likelier, or as likely as odds are known, and clearly likelier before."""
        tie = abs(self.cost) < SELECTION.tie and abs(self.before) > SELECTION.clearly
        return self.before < 0 if tie else self.cost < 0


def equals_of(
    selection: Selection,
    sensitivities: Sensitivities,
    final: Fit,
    kept: Sequence[Candidate],
    k: int,
    full: bool,
    undecided: Sequence[Candidate] = (),
) -> list[Equal]:
    """Return the effects that the data cannot distinguish from one that was found, the likeliest first.

    Parameters
    ----------
    final : Fit
        With everything that was found.
    kept : sequence of Candidate
        What was found.
    k : int
        Number of the effect among them.
    full : bool
        Whether full fits decide; else whitened columns do: where readings depend on each other chi-square means
        little, and forms are in no model.
    undecided : sequence of Candidate
        Those among the candidates that are refused as long as there are no more positions of a joint: one of these may
        explain the readings better, too.
    """
    own = kept[k]
    others = [c for c in kept if c is not own]
    alternatives, dof, explained = _alternatives(selection, sensitivities, kept, own, others)
    differences = (
        _differences_of_full_fits(sensitivities, final, own, alternatives)
        if full and alternatives
        else [alternative.linear for alternative in alternatives]
    )
    pairs = _pairs(selection, sensitivities, kept, k, dof, explained)
    found = list[Equal]()
    compared = zip([*alternatives, *pairs], [*differences, *(pair.linear for pair in pairs)], strict=True)
    for alternative, difference in compared:
        further, rivals = alternative.dof - dof, alternative.candidates
        open_ = any(rival in undecided for rival in rivals)
        if not selection.are_alike(max(difference, 0.0) if open_ else difference, further):
            continue
        prior, cost = selection.preference(kept, k, rivals, difference, explained)
        if not prior < np.inf:  # no machine has so much of it
            continue
        # one that was searched for fits better by chance alone
        cost += 2 * float(sum(np.log(rival.tries) for rival in rivals) - np.log(own.tries))
        if rivals[1:] and cost > SELECTION.unlikely:
            continue
        if any({*equal.candidates} < {*rivals} and equal.cost <= cost for equal in found):
            continue  # one of the two does it alone
        if rivals[1:] and not all(
            selection.is_needed([*others, *(c for c in rivals if c is not rival)], rival) for rival in rivals
        ):
            continue
        why, part = why_alike(selection, sensitivities, own, others, rivals)
        if part > SELECTION.in_part and cost > SELECTION.unlikely:
            continue
        odds, with_data = (float(np.exp(-x / 2)) for x in (prior, cost))
        alias = Alias(tuple(rival.effect for rival in rivals), why, float(difference), odds, with_data)
        found.append(Equal(rivals, alias, cost, prior, part))
    return sorted(found, key=lambda equal: equal.cost)


def imitation(
    undecided: Sequence[Candidate], kept: Sequence[Candidate], equals: Sequence[Sequence[Equal]]
) -> tuple[Candidate, str] | None:
    """Return an effect that may only imitate an undecided one, and why it is not to be reported; None without any.

    Parameters
    ----------
    undecided : sequence of Candidate
        Effects that are refused as long as there are no more positions of a joint.
    kept : sequence of Candidate
        What was found.
    equals : sequence of sequence of Equal
        What the data cannot distinguish from each of these.
    """
    for candidate, of_one in zip(kept, equals, strict=True):
        for equal in of_one:
            open_ = [rival.effect.title for rival in equal.candidates if rival in undecided]
            if open_ and equal.likelier and equal.part <= SELECTION.in_part:
                return candidate, f"{open_[0]} explains as much and is likelier: {MORE}"
    return None


def _alternatives(
    selection: Selection,
    sensitivities: Sensitivities,
    kept: Sequence[Candidate],
    own: Candidate,
    others: Sequence[Candidate],
) -> tuple[list[_Alternative], int, float]:
    """Return the candidates that come near, the effect's own parameters, and by how much it lowers chi-square."""
    space = selection.space
    dof = space.across(others, own).shape[1] + len(own.searched)
    best = selection.left(kept)
    without = selection.left(others)
    variance = selection.variance(kept) / _sampling_factor(sensitivities)
    keys = {c.key for c in kept}
    found = []
    for score in selection.scores(others):
        if score.candidate.key in keys or not score.dof:
            continue
        left = min(score.left, _left_alone(selection, others, score.candidate))
        if without - left < SELECTION.same * (without - best):
            continue
        difference = (left - best) / variance
        limit = SELECTION.parameter_cost(selection.rows) * max(abs(score.parameters - dof), 1)
        if (
            difference
            < SELECTION.alternative_limits * limit + SELECTION.alternative_bent * (without - best) / variance
        ):
            found.append(_Alternative((score.candidate,), score.parameters, difference))
    nearest = sorted(found, key=lambda alternative: alternative.linear)[: SELECTION.most_alternatives]
    return nearest, dof, (without - best) / variance


def _pairs(
    selection: Selection,
    sensitivities: Sensitivities,
    kept: Sequence[Candidate],
    k: int,
    dof: int,
    explained: float,
) -> list[_Alternative]:
    """Return the pairs of candidates that may be as likely as an effect with so many parameters, the nearest first."""
    others = [c for c in kept if c is not kept[k]]
    keys = {c.key for c in kept}
    scores = [
        score
        for score in selection.scores(others)
        if score.dof and score.candidate.key not in keys and not score.candidate.searched
    ]
    if len(scores) < 2:
        return []
    variance = selection.variance(kept) / _sampling_factor(sensitivities)
    falls = selection.space.pair_falls(selection.residual, scores, others) / variance
    odds = np.array([score.candidate.prior.log_odds for score in scores])
    least = explained - falls - 2 * (odds[:, None] + odds - kept[k].prior.log_odds)
    near = np.argwhere(np.triu(least < SELECTION.unlikely, 1))
    order = sorted(near.tolist(), key=lambda ij: float(least[tuple(ij)]))
    return [
        _Alternative(
            (scores[i].candidate, scores[j].candidate),
            scores[i].parameters + scores[j].parameters,
            explained - float(falls[i, j]),
        )
        for i, j in order[: SELECTION.most_pairs]
    ]


def _left_alone(selection: Selection, others: Sequence[Candidate], alternative: Candidate) -> float:
    """Return what a leg's effect leaves in the place of all others of that leg.

    With them in the model, which are nearly the same, little is seen of it, and too little would be ascribed to it.
    """
    elsewhere = [c for c in others if not of_one_leg([c, alternative])]
    if len(elsewhere) == len(others):
        return np.inf
    return selection.left([*elsewhere, alternative])


def _differences_of_full_fits(
    sensitivities: Sensitivities, final: Fit, own: Candidate, alternatives: Sequence[_Alternative]
) -> list[float]:
    """Return by how much chi-square is larger with each alternative in the effect's place, after a full fit."""
    machine = final.machine
    effects = [alternative.candidates[0].effect for alternative in alternatives]
    machine = replace(machine, effects=(*machine.effects, *effects))
    o = sensitivities.observations
    model = Model(machine, final.problem.model.travel, o.run_names, compiled=False)
    problem = Problem(model, o)
    problem.set_weight((sensitivities.weight / problem.base_weight)[:, 0])
    start = model.start()
    fitted = {final.parameters[i].key: final.solution.theta[i] for i in final.free}
    free = {key for key in fitted if not own.effect.owns(key)}
    for i, parameter in enumerate(model.parameters):
        start[i] = fitted.get(parameter.key, start[i])
    keys = {parameter.key: i for i, parameter in enumerate(model.parameters)}
    whole = minimise(problem, start, final.solution.frame, sorted(keys[key] for key in fitted))
    variance = 1.0
    if o.sigma is None:
        variance = whole.cost / max(problem.rows * problem.components - final.determinacy.rank, 1)
    variance /= _sampling_factor(sensitivities)
    for key in fitted:
        if own.effect.owns(key) and not model.parameters[keys[key]].searched:
            start[keys[key]] = 0.0
    found = []
    for alternative in alternatives:
        theta = start.copy()
        numbers = {keys[key] for key in free}
        (candidate,) = alternative.candidates
        for i, parameter in enumerate(model.parameters):
            if (
                candidate.effect.owns(parameter.key)
                and parameter.hold is None
                and (not parameter.optional or parameter.key in candidate.names)
            ):
                numbers.add(i)
        for name, value in candidate.searched.items():
            theta[keys[candidate.effect.key(name)]] = value
        solution = minimise(problem, theta, final.solution.frame, sorted(numbers), max_iterations=40)
        empty = why_empty(o, candidate.effect, model.parameters, solution.theta)
        found.append(np.inf if empty else (solution.cost - whole.cost) / max(variance, 1e-300))
    return found


def _sampling_factor(sensitivities: Sensitivities) -> float:
    """Return the ratio of all rows to those examined, by which chi-square of all is larger."""
    return sensitivities.fit.rows / len(sensitivities.rows)


def why_alike(
    selection: Selection,
    sensitivities: Sensitivities,
    own: Candidate,
    others: Sequence[Candidate],
    rivals: Sequence[Candidate],
) -> tuple[str, float]:
    """Return with which other parameters rivals reproduce the effect, and which part of it they lack."""
    space = selection.space
    base = space.base(others)
    columns = space.columns(own)
    across = base.project_out(columns)
    size = lstsq(across, -base.project_out(selection.residual), relative=1e-6)
    effect = columns @ size
    wanted = base.project_out(effect)
    given, left = list(others), wanted
    for rival in rivals:
        left = project_out(space.across(given, rival), left)
        given.append(rival)
    there = float(np.linalg.norm(wanted))
    part = float(np.linalg.norm(left)) / there if there > 0 else 0.0
    does = "explains these readings about as well, though it changes them differently"
    for limit, what in (
        (SELECTION.in_part, "changes these readings in a similar way, and explains them about as well"),
        (
            SELECTION.same_change,
            f"does the same to these readings, except for {100 * part:.2g} % of the change",
        ),
        (5e-4, "does the same to these readings, all but exactly"),
        (1e-6, "does the same to these readings, exactly"),
    ):
        does = what if part < limit else does
    model = space.model
    does_it = np.concatenate([space.columns(rival) for rival in rivals], axis=1)
    combination = lstsq(np.concatenate([does_it, model], axis=1), effect, relative=1e-8)[does_it.shape[1] :]
    shares = np.abs(combination) / max(float(np.linalg.norm(effect)), 1e-300)
    free = [sensitivities.fit.parameters[i].key for i in sensitivities.fit.free]
    free += [OUTSIDE] * (len(shares) - len(free))  # forms stand behind the model's own columns
    order = [i for i in np.argsort(-shares) if shares[i] > PART]
    names = list(dict.fromkeys(free[i] for i in order))
    with_ = f", with another {joined(names, most=NAMED)}," if names else ""
    who = " together with ".join(rival.effect.title for rival in rivals)
    return f"{who}{with_} {does}.", part
