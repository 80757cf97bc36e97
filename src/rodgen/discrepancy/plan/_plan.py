"""What to measure next, from a fit or a diagnosis."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy._problem import one_thread_in_blas
from rodgen.discrepancy.plan._attempt import MOST_TRIED, Attempt, Class, Question, attempt
from rodgen.discrepancy.plan._goals import Gain, Goal
from rodgen.discrepancy.plan._table import as_csv, as_text, table
from rodgen.discrepancy.plan._words import differences, listed, number, range_text
from rodgen.errors import RodgenError, shown
from rodgen.machines.machine import Target

if TYPE_CHECKING:
    from rodgen.discrepancy.diagnose import Diagnosis
    from rodgen.discrepancy.fit import Fit
    from rodgen.machines.machine import Effect, Machine

__all__ = ["Plan", "PlanError", "plan", "plan_for"]

Array: TypeAlias = NDArray[np.float64]

MOST = 500
"""Readings that are planned at most."""
WAITS = (2.0, -1.0)
"""Before measuring on: for how many times the duration of the data to wait; or to begin when the machine is cold."""
WORTH = 0.3
"""A new target, or a wait, is proposed where it brings so much more, in parts of what is needed."""
LINES = 12
"""Gains of a goal that the text tells, at most."""
WIDER = (0.15, 0.5, 1.0)
"""By what parts of a travel that the machine does not say more of it is imagined, to either side."""
A_LITTLE_WIDER = (0.1, 0.2)
"""The same where directions are measured: below the horizon there is no star."""
FEW_TARGETS = 3
"""With so many, a further target is not proposed."""
LARGEST_CLASS = 8
"""Members of a class that are looked at."""


class PlanError(RodgenError):
    """A plan that cannot be made, in one sentence."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Measurements to take next.

    Attributes
    ----------
    rows : mapping of str to list
        Columns of commands, named with their units as those of the measurement file, in the order in which they are to
        be taken; without readings.
    goals : tuple of Goal
        What is to be settled, and whether these readings are expected to.
    words : tuple of str
        What these measurements have that the old ones lack, in sentences.
    notes : tuple of str
        What cannot be settled, and what else is to be known.
    needed : int or None
        How many readings would settle what these do not; None where these do, or no number would.
    new_targets : tuple of Target
        Targets that are to be mounted, and put into the machine file.
    """

    rows: Mapping[str, list[Any]]
    goals: tuple[Goal, ...]
    words: tuple[str, ...]
    notes: tuple[str, ...]
    needed: int | None
    new_targets: tuple[Target, ...] = ()
    _unit: str = field(default="", repr=False)

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(next(iter(self.rows.values()), []))

    @property
    def resolvable(self) -> bool:
        """Whether readings within the travel could settle every goal."""
        return all(goal.resolvable for goal in self.goals)

    @property
    def reached(self) -> bool:
        """Whether these are expected to settle every goal."""
        return all(goal.reached for goal in self.goals)

    @property
    def gain(self) -> tuple[Gain, ...]:
        """Of all goals, what there is now and what is expected."""
        return tuple(gain for goal in self.goals for gain in goal.gains)

    def csv(self) -> str:
        """Return the rows as the text of a measurement file without readings."""
        return as_csv(self.rows)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rows as a measurement file without readings.

        Raises
        ------
        InputFileError
            When it cannot be written.
        """
        from rodgen._files import write_file

        write_file(path, self.csv().encode())

    def target_blocks(self) -> str:
        """Return the ``[[target]]`` blocks to put into the machine file; empty where no new target is proposed."""
        return "\n".join(
            f'[[target]]\nname = "{t.name}"\npoint = [{", ".join(number(x) for x in t.point)}]\n'
            for t in self.new_targets
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, as `rodgen plan --json` prints it."""
        return {
            "readings": self.count,
            "needed": self.needed,
            "resolvable": self.resolvable,
            "reached": self.reached,
            "rows": {name: list(values) for name, values in self.rows.items()},
            "goals": [goal.to_dict() for goal in self.goals],
            "words": list(self.words),
            "notes": list(self.notes),
            "new_targets": [{"name": t.name, "point": list(t.point)} for t in self.new_targets],
        }

    def summary(self) -> str:
        """Return the plan as text."""
        return "\n".join(self._lines())

    def __str__(self) -> str:
        return self.summary()

    def _lines(self) -> Iterator[str]:
        if not self.goals:
            yield from self.notes
            return
        yield "What to settle"
        for goal in self.goals:
            yield from (f"  {line}" for line in goal.sentence.split("\n"))
            if goal.resolvable and self.count:
                if goal.kind == "separate":
                    yield "    By how much the second fits worse if the first is there, in chi-square:"
                yield from (f"    {_gain_text(gain)}" for gain in goal.gains[:LINES])
                if len(goal.gains) > LINES:
                    yield f"    and {len(goal.gains) - LINES} more"
        if self.count:
            yield f"What to measure: {self.count} reading{'s' * (self.count != 1)}"
            yield from (f"  {sentence}" for sentence in self.words)
            yield from (f"    {line}" for line in as_text(self.rows))
        if self.new_targets:
            yield "In the machine file"
            yield from (f"    {line}" for line in self.target_blocks().splitlines())
        yield from self.notes


def _gain_text(gain: Gain) -> str:
    if gain.what == "std":
        unit = "" if gain.unit == "1" else f" {gain.unit}"
        now, after = ("not determined" if x is None else f"± {x:.3g}{unit}" for x in (gain.now, gain.after))
        return f"{gain.of}: {now} now, {after} expected"
    after = "open" if gain.after is None else f"{gain.after:.3g}"
    chance = "" if gain.probability is None else f", reached with {_percent(gain.probability)}"
    needed = "" if gain.needed is None else f" ({gain.needed:.3g} needed{chance})"
    return f"{gain.of}: {0.0 if gain.now is None else gain.now:.3g} now, {after} expected{needed}"


def _percent(probability: float) -> str:
    if probability > 0.995:
        return "more than 99 %"
    return f"{100 * probability:.0f} %"


# from a fit or a diagnosis -------------------------------------------------------------------------------------


def plan(of: Fit | Diagnosis, n: int = 12, *, wanted: Iterable[str] | None = None) -> Plan:
    """Say what to measure next.

    Of a diagnosis with effects that the data cannot tell apart: readings that do. Else readings that determine what is
    not determined, or sharpen all parameters, or those that are wanted.

    Parameters
    ----------
    of : Fit or Diagnosis
    n : int
        Readings at most; fewer are planned where they are enough to tell effects apart.
    wanted : iterable of str, optional
        Keys of parameters, such as ``"C.axis.a"``, or of effects that the model does not have yet, such as
        ``"C.backlash"``: their standard deviations are to be as small as can be.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        When a key is unknown, or `n` is no number from 1 to 500.

    Examples
    --------
    >>> from rodgen.discrepancy.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
    ...     (Joint("C", "revolute", (0.0, 0.0, 1.0), travel=(0.0, 3.0)),), (Target("ball", (100.0, 0.0, 0.0)),),
    ...     Measured("point", "machine", noise=0.001), estimate=("C.axis",),
    ... )
    >>> data = {"C [deg]": [0.0, 5.0, 10.0], "x [mm]": [100.0, 99.619, 98.481],
    ...         "y [mm]": [0.0, 8.716, 17.365], "z [mm]": [0.0, 0.0, 0.0]}
    >>> found = plan(table.fit(Measurements.from_frame(data)), 4)
    >>> found.count, found.reached
    (4, True)
    """
    steps = getattr(of, "steps", None)
    if steps is None:
        return plan_for(of, (), n, wanted=wanted or ())  # type: ignore[arg-type]
    classes = [
        (step.effect, *(alias.effect for alias in step.indistinguishable_from))
        for step in steps
        if step.indistinguishable_from and not wanted
    ]
    correlation = getattr(of, "correlation", None)
    dependent = correlation is not None and not correlation.independent
    return plan_for(of.final, classes, n, wanted=wanted or (), trusted=dependent)  # type: ignore[union-attr]


def plan_for(
    fit: Fit,
    classes: Sequence[Sequence[Effect]] = (),
    n: int = 12,
    *,
    wanted: Iterable[str] = (),
    trusted: bool = False,
) -> Plan:
    """Say what to measure to tell effects apart, or to sharpen parameters; see :func:`plan`.

    Parameters
    ----------
    fit : Fit
        Of the machine with or without the effects of the classes.
    classes : sequence of sequences of Effect
        Effects of which one is there, and the data do not say which; the likeliest first.
    n : int
    wanted : iterable of str
    trusted : bool
        Whether the classes are those of a diagnosis that found readings to depend on each other. Otherwise effects that
        independent readings refute are left out.

    Raises
    ------
    PlanError
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= MOST:
        raise PlanError(f"n {shown(n)}; expected a whole number from 1 to {MOST}")
    wanted = [wanted] if isinstance(wanted, str) else wanted
    question = _question(fit, [c for c in classes if len(c) > 1], wanted, trusted)
    if not question.classes and not question.keys:
        return Plan({}, (), (), ("Nothing is estimated that measurements could sharpen.",), None)
    with one_thread_in_blas():
        return _Planner(fit, question, int(n)).plan()


def _question(
    fit: Fit, classes: Sequence[Sequence[Effect]], wanted: Iterable[str], trusted: bool
) -> Question:
    """Return what is asked, in the terms of the machine without the effects in question."""
    machine = fit.machine
    notes = []
    members = []
    for each in classes:
        unique = list({(e.name, e.place): e for e in each}.values())
        if len(unique) > LARGEST_CLASS:
            out = listed([e.title for e in unique[LARGEST_CLASS:]])
            notes.append(f"Only {LARGEST_CLASS} of {len(unique)} effects are looked at, without {out}.")
        members.append(tuple(unique[:LARGEST_CLASS]))
    there = {(e.name, e.place): e for e in machine.effects}
    for effect in {(e.name, e.place): e for c in members for e in c}:
        if effect in there:
            machine = machine.without_effect(*effect)
    further: dict[tuple[str, str | None], Effect] = {}
    keys = []
    for text in wanted:
        found, effect_wanted = _wanted(fit, str(text))
        keys += found
        if effect_wanted is not None:
            further[effect_wanted.name, effect_wanted.place] = effect_wanted
    kind, of_all = "sharpen", not keys
    if not keys and not members:
        kind, keys = _open(fit)
    return Question(
        machine,
        tuple(Class(c) for c in members),
        tuple(dict.fromkeys(keys)),
        tuple(further.values()),
        kind,
        of_all,
        trusted,
        notes,
    )


def _open(fit: Fit) -> tuple[str, list[str]]:
    """Return the parameters that the data do not determine, or all."""
    d = fit.determinacy
    lacking = [key for x in (*d.directions, *d.weak) if not x.gauge for key, _ in x.parts]
    if lacking:
        return "show", lacking
    gauge = {key for x in d.directions for key, _ in x.parts}
    every = [fit.parameters[i].key for i in fit.free]
    return "sharpen", [key for key in every if key not in gauge and not key.startswith("frame.")] or every


def _wanted(fit: Fit, text: str) -> tuple[list[str], Effect | None]:
    """Return the keys that a text means, and an effect that is not in the model yet."""
    keys = [fit.parameters[i].key for i in fit.free]
    inside = [key for key in keys if key == text or key.startswith((f"{text}.", f"{text}["))]
    if inside:
        return inside, None
    machine = fit.machine
    names = {p.key for p in fit.parameters}
    if text in names:
        raise PlanError(f"parameter {shown(text)} is held; expected one that is estimated: {listed(keys)}")
    places = {joint.name for joint in machine.joints} | {target.name for target in machine.targets}
    effect_text, _, at = text.partition("@")
    if at:
        place: str | None = at
        parts = effect_text.split(".")
    else:
        place = next((p for p in sorted(places, key=len, reverse=True) if text.startswith(f"{p}.")), None)
        parts = (text if place is None else text[len(place) + 1 :]).split(".")
    try:
        effect = machine.effect(parts[0], place)
        machine.with_effect(effect)
    except RodgenError:
        some = listed(keys[:8]) + (", …" if len(keys) > 8 else "")
        raise PlanError(
            f"no parameter {shown(text)}; expected one of {some or 'none, as nothing is estimated'}, or an effect "
            f"that the machine may have, such as EFFECT@JOINT"
        ) from None
    units = effect.units(machine)
    own = [name for name in units if not name.startswith("k_")] or list(units)
    if parts[1:] and parts[1] not in units:
        raise PlanError(
            f"no parameter {shown(parts[1])} of {effect.title}; expected one of {listed(list(units))}"
        )
    return [effect.key(name) for name in (parts[1:2] or own)], effect


# the search ----------------------------------------------------------------------------------------------------


class _Planner:
    """Tries what may be done, and says what came out."""

    def __init__(self, fit: Fit, question: Question, n: int) -> None:
        self.question, self.n = question, n
        self.fit = fit
        o = fit.observations
        self.o = o.take(~fit.outliers) if fit.outliers.any() else o

    def plan(self) -> Plan:
        best = self._best()
        goals = (*self._class_goals(best), *self._key_goals(best))
        words: tuple[str, ...] = ()
        notes = list(self.question.notes) + best.rivals.refused
        rows = best.rows
        useful = any(goal.resolvable for goal in goals)
        columns: dict[str, list[Any]] = {}
        if useful:
            columns = table(best.machine, best.surroundings, rows)
            told = differences(
                best.machine,
                self.o,
                rows,
                best.choice,
                best.travel,
                wait=best.wait,
                load=best.asks_load,
                time=best.asks_time,
            )
            words = tuple(dict.fromkeys(told)) or (self._same_kind(best),)
            if best.wrong:
                notes.append(
                    "The order of these rows does not bring every joint from the side that would tell most; the gain "
                    "is that of the order as it stands."
                )
            notes += self._about_setup()
        notes += self._about_travel(best, goals)
        needed = best.needed if useful else None
        if useful and not best.reached_so_far:
            notes.append(
                f"{best.rows.n} readings are not enough for sure; about {needed} would be."
                if needed
                else f"{best.rows.n} readings are not enough for sure, nor would {MOST_TRIED} be."
            )
        used = np.unique(rows.target) if useful else np.array([], int)
        fresh = tuple(best.machine.targets[k] for k in used if k >= len(self.o.machine.targets))
        if fresh and "target" not in self.o.data.columns:
            name = self.o.machine.targets[0].name
            notes.append(f"With a second target the old data need a column target, {name} in every row.")
        return Plan(columns, goals, words, tuple(dict.fromkeys(notes)), needed, fresh)

    def _best(self) -> Attempt:
        question, o = self.question, self.o
        found = attempt(question, question.machine, o, self.n)
        if found.reached or not question.classes:
            return found
        ways: list[tuple[Machine, float]] = []
        if found.asks_time and o.t is not None and np.ptp(o.t) > 0:
            ways += [(question.machine, wait) for wait in WAITS]
        structure = found.models[0].fit.problem.model.structure
        # where moments count, one more target would move the mean of the targets, and with it what the effects mean
        if structure.moving and not structure.centre and len(question.machine.targets) < FEW_TARGETS:
            ways += [(machine, 0.0) for machine in _with_a_new_target(question, question.machine)]
        best = found
        for machine, wait in ways:
            other = attempt(question, machine, o, self.n, wait=wait, quick=True)
            if other.worth > best.worth + WORTH or (other.reached and not best.reached):
                best = other
            if best.reached:
                break
        if best is found or best.reached:
            return best
        return attempt(question, best.machine, o, self.n, wait=best.wait)

    # goals -------------------------------------------------------------------------------------------------------

    def _class_goals(self, best: Attempt) -> Iterator[Goal]:
        for k, each in enumerate(self.question.classes):
            titles = tuple(e.title for e in each.effects)
            of = [p for p in best.pairs if p.of == k]
            gains = tuple(
                Gain(
                    "chi_square",
                    f"{best.title(p.pair.true)}, not {best.title(p.pair.wrong)}",
                    p.pair.now,
                    p.after,
                    p.threshold,
                    p.probability,
                )
                for p in sorted(of, key=lambda p: (p.probability, p.after))
                if p.possible
            )
            sentence = " ".join(self._class_sentences(best, k, titles))
            solvable = any(p.possible for p in of)
            yield Goal("separate", titles, (), sentence, solvable, all(p.reached for p in of), gains)

    def _class_sentences(self, best: Attempt, k: int, titles: Sequence[str]) -> Iterator[str]:
        refuted = [best.title(a) for c, a in best.refuted if c == k]
        left = [title for title in titles if title not in refuted]
        possible = {frozenset((p.pair.true, p.pair.wrong)) for p in best.pairs if p.of == k and p.possible}
        yield from (f"Tell {text}." for text in _from_each_other(possible, best))
        if refuted:
            verb = "fits" if len(refuted) == 1 else "fit"
            yield f"{listed(refuted)} {verb} the data worse already, or with sizes that no machine has."
        if len(left) == 1:
            yield f"{left[0]} is left."
        alike = [p for p in best.pairs if p.of == k and not p.possible]
        exact = {frozenset((p.pair.true, p.pair.wrong)) for p in alike if not p.tiny}
        small = {frozenset((p.pair.true, p.pair.wrong)) for p in alike} - exact
        for group in _together(exact):
            names = listed([best.title(x) for x in group])
            yield f"{names} do the same to every reading within the travel: no measurement there tells them apart."
        if small:
            groups = "; ".join(listed([best.title(x) for x in group]) for group in _together(small))
            yield (
                f"Too much alike within the travel, as they were fitted, for a reasonable number of readings: {groups}."
            )
        for c, less, more in best.included:
            if c == k and frozenset((less, more)) not in exact | small:
                yield (
                    f"{best.title(more)} can do all that {best.title(less)} does: for {best.title(less)} speaks "
                    f"that it has fewer parameters, and no reading can."
                )

    def _key_goals(self, best: Attempt) -> Iterator[Goal]:
        if not best.keys:
            return
        show = self.question.kind == "show"
        lost = [k.key for k in best.keys if k.gauge]
        keys = [k for k in best.keys if not k.gauge and not (show and k.now is not None)]
        open_ = [k.key for k in keys if k.after is None]
        verb = "Determine" if show else "Sharpen"
        sentence = f"{verb} {_some([k.key for k in keys])}." if keys else ""
        if lost and not self.question.of_all:
            sentence += (
                f" No reading shows {_some(lost)}: a choice of coordinates, or without any effect here."
            )
        if open_:
            some = "them" if len(open_) == len(keys) else _some(open_)
            sentence += f" No reading within the travel determines {some}."
        gains = tuple(Gain("std", k.key, k.now, k.after, unit=k.unit) for k in keys)
        names = tuple(k.key for k in best.keys)
        solved = len(open_) < len(keys)
        reached = not open_ and (self.question.of_all or not lost)
        yield Goal(self.question.kind, (), names, sentence.strip(), solved, reached, gains)

    # notes -------------------------------------------------------------------------------------------------------

    def _same_kind(self, best: Attempt) -> str:
        joints = self.o.machine.joints
        where = [
            f"{joint.name} {range_text(self.o, j, best.rows.q[:, j])}"
            for j, joint in enumerate(joints)
            if np.ptp(best.travel[j]) > 0
        ]
        return f"Readings as before, where they tell most: {listed(where)}."

    def _about_setup(self) -> Iterator[str]:
        if "run" in self.o.columns_given:
            run = self.o.run_names[self.o.run[-1]]
            yield f"The rows continue run {run}, in its set-up; after a new set-up give them a run of their own."
        if self.o.sigma is not None and any(name.startswith("u_") for name in self.o.columns_given):
            yield "The uncertainties in the rows are those that are usual in the data."

    def _about_travel(self, best: Attempt, goals: Sequence[Goal]) -> Iterator[str]:
        if all(goal.reached for goal in goals):
            return
        machine, o = self.question.machine, self.o
        unsaid = [
            j for j, joint in enumerate(machine.joints) if joint.travel is None and not _whole(o, j, joint)
        ]
        places = {e.place for c in self.question.classes for e in c.effects}
        places |= {key.split(".")[0] for key in self.question.keys}
        of_joints = bool(places & {joint.name for joint in machine.joints})
        named = [j for j in unsaid if machine.joints[j].name in places or not of_joints]
        if not named:
            return
        names = listed([machine.joints[j].name for j in named])
        there = listed([f"{machine.joints[j].name} {range_text(o, j, best.travel[j])}" for j in named])
        further = self._further(best, named) if self.question.classes else ""
        yield (
            f"The machine file says no travel of {names}, so that of the data was taken: {there}. If there is more, "
            f"say so there (travel = [low, high]) and plan again{further}."
        )

    def _further(self, best: Attempt, joints: Sequence[int]) -> str:
        """Say what readings beyond the data would bring."""
        directions = self.question.machine.measured.kind == "direction"
        for part in A_LITTLE_WIDER if directions else WIDER:
            travel = np.array(best.travel)
            for j in joints:
                low, high = travel[j]
                more = part * (high - low)
                if self.question.machine.joints[j].type == "revolute":
                    more = min(more, math.pi - (high - low) / 2)
                travel[j] = low - more, high + more
            wider = attempt(
                self.question,
                self.question.machine,
                self.o,
                self.n,
                wait=best.wait,
                travel=travel,
                quick=True,
            )
            if wider.settled:
                but = "" if wider.reached else ", but for what does the same to every reading"
                ranges = [
                    f"{self.o.machine.joints[j].name} {range_text(self.o, j, travel[j])}" for j in joints
                ]
                return f": with {listed(ranges)}, {wider.rows.n} readings would do{but}"
        return ""


def _some(names: Sequence[str]) -> str:
    return listed([*names[:6], f"{len(names) - 6} more"] if len(names) > 7 else list(names))


def _from_each_other(pairs: set[frozenset[int]], best: Attempt) -> list[str]:
    """Say which effects are to be told from which: all from each other, or one from some after the other."""
    nodes = sorted({k for pair in pairs for k in pair})
    if nodes and 2 * len(pairs) == len(nodes) * (len(nodes) - 1):
        return [f"{listed([best.title(k) for k in nodes])} apart"]
    left, found = set(pairs), []
    while left:
        most = max(nodes, key=lambda k: sum(k in pair for pair in left))
        others = [k for k in nodes if frozenset((k, most)) in left]
        left -= {frozenset((k, most)) for k in others}
        found.append(f"{best.title(most)} from {listed([best.title(k) for k in others])}")
    return found


def _together(pairs: Iterable[frozenset[int]]) -> list[list[int]]:
    """Return groups of numbers of which all are pairs; every pair is in one."""
    every = set(pairs)
    nodes = sorted({k for pair in every for k in pair})
    groups: list[list[int]] = []
    for pair in sorted(every, key=sorted):
        if any(pair <= set(group) for group in groups):
            continue
        group = sorted(pair)
        while True:
            more = [k for k in nodes if k not in group and all(frozenset((k, x)) in every for x in group)]
            if not more:
                break
            group.append(more[0])
        groups.append(sorted(group))
    return groups


def _whole(o: Any, j: int, joint: Any) -> bool:
    return joint.type == "revolute" and float(np.ptp(o.q[:, j])) > 2 * math.pi * 0.9


def _with_a_new_target(question: Question, machine: Machine) -> Iterator[Machine]:
    """Yield the machine with one more target, at another radius or height about the last axis that is in question."""
    places = {e.place for c in question.classes for e in c.effects}
    turning = [j for j in machine.joints if j.type == "revolute"]
    carrier = next((j for j in reversed(turning) if j.name in places), turning[-1] if turning else None)
    names = {t.name for t in machine.targets} | {j.name for j in machine.joints}
    name = next(text for k in range(2, 1000) if (text := f"{machine.targets[0].name}_{k}") not in names)
    points = np.array([t.point for t in machine.targets])
    if carrier is None:
        size = float(np.linalg.norm(points, axis=1).max()) or 100.0
        new = [points[0] + 0.5 * size * e for e in np.eye(3)]
    else:
        axis, foot = np.array(carrier.axis), np.array(carrier.point)
        height = (points - foot) @ axis
        across = points - foot - height[:, None] * axis
        radius = np.linalg.norm(across, axis=1)
        k = int(np.argmax(radius))
        size = radius[k] or float(np.linalg.norm(points, axis=1).max()) or 100.0
        out = across[k] if radius[k] > 0 else _across(axis) * size
        new = [
            foot + height[k] * axis + 0.4 * out,
            foot + height[k] * axis - 0.7 * out,
            foot + (height[k] + size) * axis + out,
        ]
    for point in new:
        x, y, z = (
            float(f"{v:.4g}") + 0.0 for v in np.where(np.abs(point) < 1e-9 * size, 0.0, point).tolist()
        )
        target = Target(name, (x, y, z))
        yield replace(machine, targets=(*machine.targets, target))


def _across(axis: Array) -> Array:
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    found = np.cross(axis, other)
    return np.asarray(found / np.linalg.norm(found))
