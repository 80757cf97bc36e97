"""Sentences beside a verdict: on residuals that exceed the noise, on impossible signs, on preferred effects."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.candidates import FEWEST_WAVES, Candidate
from rodgen.calibration.dependence import Correlation
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.calibration.solve.starting_values import grid_step
from rodgen.calibration.words import chance, odds_text, sized, uncapitalized
from rodgen.data.poses import groups, positions
from rodgen.data.poses import moved_one_way as joints_one_way
from rodgen.errors import joined
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.observations import Observations
from rodgen.machines.plausibility import plausibility
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.statistics.thresholds import COST, LACK_OF_FIT, SELECTION, VERDICT

ROUNDING = 1e-12
"""Residuals of a component, relative to the largest component's, that are none."""
FEWEST_SIZES = 40
"""Residuals from which on those of normal errors are as uneven as `VERDICT.uneven` in one of a thousand cases."""


def disagreement(final: Fit, correlation: Correlation) -> str:
    """Return a sentence on how the residuals exceed the noise; empty where they agree with it.

    Parameters
    ----------
    correlation : Correlation
        Of its residuals.
    """
    lack = final.lack_of_fit
    if lack is None or not lack.p_value < LACK_OF_FIT.rare:
        return ""
    noise = "the stated noise" if lack.against == "stated" else "the noise between replicates"
    if not correlation.claimed:
        return (
            f"The residuals are {lack.ratio:.3g} times {noise} ({chance(lack.p_value)}), but no effect explains that "
            "beyond chance: the noise is larger than that, or several effects act that are too small to be found, or "
            "something that was not recorded."
        )
    if lack.ratio > VERDICT.wander:
        return (
            f"The residuals are {lack.ratio:.3g} times {noise}. {correlation.text} No effect explains this dependence "
            f"beyond chance.{_more_positions(final.observations) if correlation.size('position') else ''}"
        )
    if lack.against == "stated" and correlation.white > VERDICT.independent_error:
        independent = f"The independent error of a reading is {correlation.white:.3g} times {noise}"
        return f"{independent}, and {uncapitalized(correlation.text)}"
    return ""


def _more_positions(o: Observations) -> str:
    """Return that errors belong to positions of which there are too few, as a sentence after others."""
    moved = np.flatnonzero(np.ptp(o.q, axis=0) > 0)
    count = int(groups([positions(o.q[:, j]) for j in moved], o.n).max(initial=0)) + 1
    names = joined([o.machine.joints[j].name for j in moved])
    what = f"{count} positions of {names} do not tell what it follows"
    return f" {what}: measure at more positions, each from both sides."


def uneven(final: Fit) -> str:
    """Return a sentence on residuals of which many are far larger than most, so that no fit is sure; empty without."""
    sizes = _sizes(final)
    half, worst = np.quantile(np.abs(sizes), [0.5, 0.95])
    if sizes.size < FEWEST_SIZES or not VERDICT.uneven * half < HALF_OF_NORMAL:
        return ""
    return (
        f"Half of the residuals are within {sized(half * final.rms, final.unit, '.2g')}, but one of twenty is beyond "
        f"{sized(worst * final.rms, final.unit, '.2g')}, far more than normal errors are: either many rows are wrong, "
        "such as misidentified targets, or something acts that was not recorded."
    )


def _sizes(final: Fit) -> Array:
    """Return the residuals of one reading of each pose that is believed, (poses, m); of each component the rms is 1.

    A component that has none but rounding, such as that of a direction across a plane, is left out.
    """
    inliers = np.flatnonzero(~final.outliers)
    first = inliers[np.unique(final.observations.pose[inliers], return_index=True)[1]]
    residuals: Array = final.residuals[first] * final.problem.base_weight[first]
    size = np.sqrt(np.mean(residuals**2, axis=0))
    seen = size > ROUNDING * np.max(size)
    relative: Array = residuals[:, seen] / size[seen]
    return relative


def unknown_approach(o: Observations) -> str:
    """Return a sentence on joints that moved, from which side is not known; empty where there are none."""
    names = [
        joint.name
        for joint, q, told in zip(o.machine.joints, o.q.T, o.approach_known | o.approach_assumed, strict=True)
        if np.ptp(q) > 0 and not told
    ]
    if not names:
        return ""
    return (
        f"Backlash is not seen: from which side {joined(names)} came is not known, and the order of these rows does "
        f"not tell. Note it in {joined([f'dir_{name}' for name in names])}, +1 or -1."
    )


def unknown_acceleration(o: Observations) -> str:
    """Return a sentence on joints that are read at several speeds without their acceleration; empty without."""
    present = o.columns_given
    names = [
        joint.column
        for joint, v in zip(o.machine.joints, np.abs(o.v).T, strict=True)
        if f"v_{joint.column}" in present
        and f"a_{joint.column}" not in present
        and len(np.unique(v[v > 0])) > 1
    ]
    columns = joined([f"a_{name}" for name in names])
    return (
        f"What follows the acceleration of {joined(names)} is not seen: note it in {columns}."
        if names
        else ""
    )


def moved_one_way(sensitivities: Sensitivities, correlation: Correlation) -> str:
    """Return a sentence on joints that went from end to end once while the set-up wandered; empty where there are none.

    An error that follows such a joint slowly looks the same as the wander.

    Parameters
    ----------
    correlation : Correlation
        Of the residuals.
    """
    if not (correlation.wanders and correlation.claimed):
        return ""
    one_way = joints_one_way(sensitivities.observations.q)
    names = [j.name for j, is_one in zip(sensitivities.fit.machine.joints, one_way, strict=True) if is_one]
    if not names:
        return ""
    its, them = ("its", "it") if len(names) == 1 else ("their", "them")
    return (
        f"{joined(names)} went through {its} range once while the set-up wandered: an error that follows {them} slowly "
        "looks the same as that. Measure in another order, or there and back."
    )


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


def aliased(final: Fit, effects: Sequence[Effect]) -> Iterator[str]:
    """Yield a sentence for each searched period that the travel hardly repeats, or a grid does not tell from others."""
    model, o = final.problem.model, final.observations
    for effect in effects:
        name = next((n for n, x in effect.definition.searched.items() if x is StartSearch.PERIOD), "")
        joint = next((x for x in final.machine.joints if x.name == effect.place), None)
        if not name or joint is None or joint.period is not None:
            continue
        positions = np.unique(o.q[~final.outliers, final.machine.number_of(joint.name)])
        step, index = grid_step(positions), model.keys[effect.key(name)]
        period, unit = final.solution.theta[index], model.parameters[index]
        if (waves := float(np.ptp(positions) / period)) < FEWEST_WAVES:
            yield (
                f"The travel of {joint.name} holds {waves:.2g} waves of {effect.title}: these data do not show that it "
                "repeats, and another slow error could look the same."
            )
        if not step or not period > step:
            continue
        here, there, apart = (f"{x / unit.factor:.3g}" for x in (period, 1 / (1 / step - 1 / period), step))
        yield (
            f"At positions {apart} {unit.unit} apart a wave of {here} {unit.unit} is the same as one of {there} "
            f"{unit.unit}: state the period of {joint.name}, or measure at uneven distances."
        )


def on_preferred(
    evidence: Evidence, chosen: Sequence[Candidate], prefer: Collection[tuple[str, str | None]]
) -> Iterator[str]:
    """Yield a sentence for each preferred effect that was not chosen: its odds, instead of another one or added.

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
