"""The readings that determine or sharpen parameters, and the standard deviations that are expected of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rodgen.calibration.fit import fitted
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.plan.constraints import Constraints
from rodgen.calibration.plan.design import Design, linearized
from rodgen.calibration.plan.goals import Gain, Goal, PlanError
from rodgen.calibration.plan.pool import Planned, Pool
from rodgen.errors import RodgenError, joined, listed, shown
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.observations import Observations

NOTICED = 0.95
"""Readings that lower every standard deviation to no less than this part sharpen nothing: how large a standard
deviation is, is known to a twentieth from 200 readings."""
KEYS = 6
"""Keys of parameters that a sentence names; the others are counted."""


class Sharpening(Planned):
    """A plan of readings that determine parameters, or lower their standard deviations.

    Parameters
    ----------
    fit : Fit
    o : Observations
        The data without outliers.
    wanted : sequence of str
        Keys of parameters, or of effects that the machine may not have yet; none: the model as a whole.
    constraints : Constraints
    n : int
        Readings at most.
    asked : bool
        Whether a user asked for these parameters. Otherwise no readings are planned that sharpen none of them.

    Raises
    ------
    PlanError
        When a wanted key is unknown.
    """

    def __init__(
        self, fit: Fit, o: Observations, wanted: Sequence[str], constraints: Constraints, n: int, asked: bool
    ) -> None:
        before = [fit.parameters[i].key for i in fit.free]
        texts, machine = [], fit.machine
        for text in wanted:
            if not any(_means(text, key) for key in before):
                effect, text = _further(fit, text, before)
                there = effect.identity in {e.identity for e in machine.effects}
                machine = machine if there else machine.with_effect(effect)
            texts.append(text)
        further = len(machine.effects) > len(fit.machine.effects)
        self.fit = fitted(machine, o) if further or fit.outliers.any() else fit
        free = [self.fit.parameters[i].key for i in self.fit.free]
        self.as_a_whole = not wanted
        if self.as_a_whole:
            self.keys = [key for key in free if not key.startswith("frame.")] or free
        else:
            self.keys = [key for key in free if any(_means(text, key) for text in texts)]
        if wanted and not self.keys:
            raise PlanError(f"no parameter {shown(wanted[0])}", f"one of {joined(free, most=KEYS)}")
        effects = [e for e in machine.effects if any(map(e.owns, self.keys))]
        self.pool = Pool(self.fit, o, effects, constraints)
        self.notes = [] if fit.dependence.independent else [fit.dependence.text]
        self.goals = []
        if not free:
            self.notes = ["Nothing is estimated that measurements could sharpen."]
            return
        readings = self.pool.surroundings.observations(self.pool.rows, at_once=True)
        (model,) = linearized([self.fit], readings, 1.0)
        finite = np.asarray(np.isfinite(model.jacobian).all((1, 2)))
        model, self.pool.rows = model.take(finite), self.pool.rows.take(finite)
        in_reach = self.fit.estimates_with(model.jacobian.reshape(-1, len(free)))
        lacking = [key for key in self.keys if not in_reach[key].determined]
        seen = [key for key in self.keys if not (key in lacking or in_reach[key].convention)]
        self.hidden = lacking if self.as_a_whole else [key for key in self.keys if key not in seen]
        self.gains: list[Gain] = []
        if not (lacking and self.pool.without_travel) if self.as_a_whole else seen:
            directions = None if self.as_a_whole else model.root[[free.index(key) for key in seen]].T
            places, taken = (
                self.pool.places_of(self.pool.rows.q, self.pool.rows.s),
                self.pool.places_of(o.q, o.s),
            )
            design = Design([model], [], directions, places, taken, self.pool.over)
            picked = design.chosen(min(n, self.pool.rows.n))
            self.rows = self.pool.ordered(picked)
            (then,) = linearized([self.fit], self.pool.surroundings.observations(self.rows), 1.0, [model])
            after = self.fit.estimates_with(then.jacobian.reshape(-1, len(free)))
            self.gains = [self._gain(key, after[key]) for key in seen]
        self.goals = [self._goal(o.n, asked and not self.as_a_whole)]

    def _gain(self, key: str, after: Estimate) -> Gain:
        now = self.fit.estimates[key]
        return Gain("std", key, now.std, after.std, unit=now.unit, determined=after.determined)

    def _goal(self, count: int, asked: bool) -> Goal:
        """Return the goal to determine or sharpen parameters, beside so many readings that there are."""
        gains, estimates = self.gains, self.fit.estimates
        newly_determined = [gain for gain in gains if gain.determined and not estimates[gain.of].determined]
        ratios = [gain.after / gain.now if gain.now and gain.after else 0.0 for gain in gains]
        names = joined([gain.of for gain in gains], most=KEYS)
        sentences: list[str] = []
        idle = not newly_determined and len(gains) > 0 and min(ratios) > NOTICED
        if self.rows is not None and (asked or not idle):
            sentences += self._sentences(names, ratios)
        if self.rows is not None and idle:
            sentences.append(
                f"{self.rows.n} further readings would lower no standard deviation of {names} by more than "
                f"{100 * (1 - min(ratios)):.1g} %, compared with the {count} that there are."
            )
            self.rows = self.rows if asked else None
        if self.hidden:
            why = "" if self.as_a_whole else ": a choice of coordinates, or without any effect here"
            sentences.append(
                f"No reading within the travel determines {joined(self.hidden, most=KEYS)}{why}."
            )
        reached = self.rows is not None and not self.hidden and all(gain.determined for gain in gains)
        kind = "show" if newly_determined or (self.hidden and self.as_a_whole) else "sharpen"
        return Goal(
            kind, (), tuple(self.keys), tuple(sentences), self.rows is not None, reached, tuple(gains)
        )

    def _sentences(self, names: str, ratios: Sequence[float]) -> Iterator[str]:
        """Yield what readings determine or sharpen, that of which most is learnt first."""
        if not self.gains:
            yield "Sharpen the model as a whole, as each parameter rests on a choice of coordinates."
            return
        yield "Sharpen the model as a whole." if self.as_a_whole else f"Sharpen {names}."
        order = np.argsort(ratios, kind="stable")[:KEYS] if self.as_a_whole else range(len(ratios))
        more = len(self.gains) - KEYS
        texts = [_std(self.gains[i]) for i in order][:KEYS]
        yield f"Standard deviations: {'; '.join(texts)}{f'; and {more} more' if more > 0 else ''}."


def _std(gain: Gain) -> str:
    unit = "" if gain.unit == "1" else f" {gain.unit}"
    now = "not determined" if gain.now is None else f"± {gain.now:.3g}{unit}"
    known = "known from these readings" if gain.determined else "not determined"
    return f"{gain.of} now {now}, then {known if gain.after is None else f'± {gain.after:.3g}{unit}'}"


# what is wanted ------------------------------------------------------------------------------------------------------


def _means(text: str, key: str) -> bool:
    """Return whether a text means a parameter: its key, or what this begins with."""
    return key == text or key.startswith((f"{text}.", f"{text}["))


def _further(fit: Fit, text: str, free: Sequence[str]) -> tuple[Effect, str]:
    """Return the effect that a text means and that is not in the model yet, and what its keys begin with."""
    machine = fit.machine
    if text in {p.key for p in fit.parameters}:
        raise PlanError(f"parameter {shown(text)} is held", f"one that is estimated: {joined(free, most=6)}")
    parts, place = _split(machine, text)
    try:
        effect = machine.effect(parts[0], place)
        machine.with_effect(effect)
    except RodgenError:
        few = joined(free)
        raise PlanError(
            f"no parameter {shown(text)}",
            f"one of {few or 'none, as nothing is estimated'}, or an effect that the machine may have, such as "
            f"EFFECT@JOINT",
        ) from None
    units = effect.units(machine)
    if parts[1:] and parts[1] not in units:
        raise PlanError(f"no parameter {shown(parts[1])} of {effect.title}", listed(units))
    return effect, effect.key("".join(parts[1:2])).rstrip(".")


def _split(machine: Machine, text: str) -> tuple[list[str], str | None]:
    """Return the effect and the parameter that a text names, and its place: ``C.backlash.b`` or ``backlash@C``."""
    effect, _, at = text.partition("@")
    if at:
        return effect.split("."), at
    places = {joint.name for joint in machine.joints} | {target.name for target in machine.targets}
    place = next((p for p in sorted(places, key=len, reverse=True) if text.startswith(f"{p}.")), None)
    return (text if place is None else text[len(place) + 1 :]).split("."), place
