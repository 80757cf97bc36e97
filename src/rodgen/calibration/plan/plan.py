"""What to measure next, from a fit or a diagnosis."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from textwrap import wrap
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.plan.candidate_plan import MOST_TRIED, Attempt, Class, Question, attempt
from rodgen.calibration.plan.goals import Gain, Goal
from rodgen.calibration.plan.table import as_csv, as_text, table
from rodgen.calibration.plan.words import differences, listed, number, range_text
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.undetermined import Elsewhere
from rodgen.errors import RodgenError, UnexpectedError, shown
from rodgen.machines.machine import Target
from rodgen.machines.model import Model

if TYPE_CHECKING:
    from rodgen.calibration.diagnose import Diagnosis
    from rodgen.calibration.fit import Fit
    from rodgen.machines.machine import Effect, Machine

__all__ = ["Plan", "PlanError", "plan", "plan_for"]

Array: TypeAlias = NDArray[np.float64]

MOST = 500
"""Readings that are planned at most."""
WAITS = (2.0, -1.0)
"""Before measuring on: for how many times the duration of the data to wait; or to begin when the machine is cold."""
WORTH = 0.3
"""A new target, or a wait, is proposed where it brings so much more, in parts of what is needed."""
LINES = 6
"""Gains of a goal that the text tells, at most."""
MOST_TOLD = 2
"""Sentences on which effects are told from which."""
WIDTH = 100
"""Of a line of text."""
NAMES = 4
"""Effects that a sentence names; the rest is counted."""
HARDLY = 0.005
"""A smaller probability is told in words."""
UNSEEN = 0.02
"""An effect of which the model's parameters imitate all but this part is not visible in the data."""
NO_CHANGE = 1e-9
"""A parameter that changes readings by less than this part of what another one does is rounding."""
LOOKED_AT = 12
"""Of so many of them is found out whether they are a choice of coordinates."""
WIDER = (0.15, 0.5, 1.0)
"""By what parts of a travel that the machine does not say more of it is imagined, to either side."""
A_LITTLE_WIDER = (0.1, 0.2)
"""The same where directions are measured: below the horizon there is no star."""
FEW_TARGETS = 3
"""With so many, a further target is not proposed."""
LARGEST_CLASS = 8
"""Members of a class that are looked at."""


class PlanError(UnexpectedError):
    """A plan that cannot be made, in one sentence: what was found, and what was expected."""


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
        """Return the rows as the text of a measurement file without readings; empty where there are none."""
        return as_csv(self.rows) if self.count else ""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rows as a measurement file without readings.

        Raises
        ------
        PlanError
            When there are no rows.
        InputFileError
            When it cannot be written.
        """
        from rodgen.files import write_file

        if not self.count:
            raise PlanError("no rows to write", "a plan with something to measure, see its notes")
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
        if self.count:
            yield f"What to measure: {self.count} reading{'s' * (self.count != 1)}"
            yield from _wrapped(self.words)
            yield from (f"    {line}" for line in as_text(self.rows))
            if self.new_targets:
                yield "In the machine file"
                yield from (f"    {line}" for line in self.target_blocks().splitlines())
            yield "What it settles"
        else:
            yield "Nothing to measure: no reading within the travel settles what is open."
            yield "What is open"
        for goal in self.goals:
            yield from _wrapped(_told(goal, bool(self.count)))
        if self.notes:
            yield "Besides"
        yield from _wrapped(self.notes)
        if not self.count:
            return
        for goal in self.goals:
            if goal.resolvable and goal.gains:
                yield from _gain_lines(goal)


def _wrapped(sentences: Iterable[str]) -> Iterator[str]:
    """Yield sentences as indented lines, each from a line of its own on."""
    for sentence in sentences:
        yield from wrap(
            sentence,
            WIDTH,
            initial_indent="  ",
            subsequent_indent="    ",
            break_long_words=False,
            break_on_hyphens=False,
        )


def _told(goal: Goal, planned: bool) -> Iterator[str]:
    """Yield the sentences of a goal, and after the first one what the chances are."""
    first, stop, rest = goal.sentence.partition(". ")
    yield f"{first}." if stop else first
    chances = [gain.probability for gain in goal.gains if gain.probability is not None]
    if goal.resolvable and planned and chances:
        if goal.reached:
            yield f"Chance that these readings do: {_percent(min(chances))}."
        elif max(chances) < HARDLY:
            yield "These readings alone will hardly do it."
        else:
            low, high = (_percent(x) for x in (min(chances), max(chances)))
            of = low if low == high else f"{low} to {high}, depending on which is there"
            yield f"Chance that these readings do: {of}."
    if rest:
        *most, last = rest.split(". ")
        yield from (f"{sentence}." for sentence in most)
        yield last


def _gain_lines(goal: Goal) -> Iterator[str]:
    """Yield a small table of what is expected."""
    if goal.kind == "separate":
        yield "By how much the wrong effect fits worse, in chi-square"
        rows = [["", "now", "then", "needed", "chance"]]
    else:
        yield "Standard deviations"
        rows = [["", "now", "then"]]
    rows += [_gain_cells(gain) for gain in goal.gains[:LINES]]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for name, *cells in rows:
        numbers = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        yield f"  {'  '.join([name.ljust(widths[0]), *numbers])}"
    if len(goal.gains) > LINES:
        yield f"  and {len(goal.gains) - LINES} more"


def _gain_cells(gain: Gain) -> list[str]:
    if gain.what == "std":
        unit = "" if gain.unit == "1" else f" {gain.unit}"
        return [gain.of, *("open" if x is None else f"± {x:.3g}{unit}" for x in (gain.now, gain.after))]
    found = [f"{x:.3g}" if x is not None else "" for x in (gain.now, gain.after, gain.needed)]
    return [gain.of, *found, "" if gain.probability is None else _percent(gain.probability)]


def _percent(probability: float) -> str:
    if probability > 1 - HARDLY:
        return "more than 99 %"
    return "hardly any" if probability < HARDLY else f"{100 * probability:.0f} %"


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
    >>> from rodgen.data.measurements import Measurements
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
    final: Fit = of.final  # type: ignore[union-attr]
    if wanted:
        return plan_for(final, (), n, wanted=wanted)
    classes = [
        (step.effect, *(alias.effect for alias in step.indistinguishable_from))
        for step in steps
        if step.indistinguishable_from
    ]
    correlation = getattr(of, "correlation", None)
    dependent = correlation is not None and not correlation.independent
    found = plan_for(final, classes, n, trusted=dependent) if classes else None
    if found is None or not any(goal.resolvable for goal in found.goals):
        keys, notes = _determined(final, [step.effect for step in steps])
        sharper = plan_for(final, (), n, wanted=keys) if keys or found is None else None
        if sharper is not None:
            before = found or Plan({}, (), (), (), None)
            found = replace(
                sharper,
                goals=(*before.goals, *sharper.goals),
                notes=tuple(dict.fromkeys((*before.notes, *sharper.notes, *notes))),
            )
    assert found is not None
    return replace(found, notes=(*found.notes, *_not_visible(of, classes)))  # type: ignore[arg-type]


def _determined(fit: Fit, effects: Sequence[Effect]) -> tuple[list[str], list[str]]:
    """Return the keys of effects' parameters that the data determine, and sentences on those that they do not."""
    prefixes = tuple(e.key("").rstrip(".") + x for e in effects for x in ".[")
    keys = [fit.parameters[i].key for i in fit.free if fit.parameters[i].key.startswith(prefixes)]
    open_ = {fit.parameters[i].key for i in fit.free if fit.determinacy.undetermined[i]}
    loose = [key for x in fit.determinacy.weak for key, _ in x.parts]
    left_out = [key for key in keys if key in open_ or key in loose]
    notes = []
    if left_out:
        others = [key for key in loose if key not in keys]
        of = f" from others, such as {others[0]}" if others else ""
        verb = "is" if len(left_out) == 1 else "are"
        notes.append(f"{_some(left_out, NAMES)} {verb} left out: nothing tells {_it(left_out)}{of}.")
    notes += _lacking(fit)
    return [key for key in keys if key not in left_out], notes


def _it(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _lacking(fit: Fit) -> list[str]:
    """Return a sentence on what more data would determine; choices of coordinates are none of it."""
    texts = [x.text for x in fit.determinacy.directions if not x.gauge]
    return [f"{texts[0]} {len(texts) - 1} more such." if len(texts) > 1 else texts[0]] if texts else []


def _not_visible(diagnosis: Diagnosis, classes: Sequence[Sequence[Effect]]) -> Iterator[str]:
    """Say which effects the data could not show at all, though other data would."""
    final = diagnosis.final
    said = {(e.name, e.place) for c in classes for e in c}
    said |= {(e.name, e.place) for e in final.machine.effects}
    unseen = [
        r.effect
        for r in diagnosis.ranking
        if r.visible < UNSEEN and (r.effect.name, r.effect.place) not in said
    ]
    unseen = [e for e in unseen[:LOOKED_AT] if not _is_choice(diagnosis.base, e)] + unseen[LOOKED_AT:]
    if unseen:
        key = unseen[0].name if unseen[0].place is None else f"{unseen[0].place}.{unseen[0].name}"
        these = "it" if len(unseen) == 1 else "the first"
        yield (
            f"Not visible in these data, whether there or not: {_some([e.title for e in unseen], NAMES)} "
            f"(--for {key} plans for {these})."
        )


def _is_choice(fit: Fit, effect: Effect) -> bool:
    """Whether what is estimated imitates an effect wherever is measured: a mere choice of coordinates."""
    o = fit.observations
    try:
        machine = fit.machine.with_effect(effect)
        problem = Problem(Model(machine, fit.problem.model.travel, o.run_names, compiled=False), o)
    except RodgenError:
        return True
    theta, known = (
        problem.model.start(),
        dict(zip((p.key for p in fit.parameters), fit.solution.theta, strict=True)),
    )
    keys = [p.key for p in problem.model.parameters]
    theta = np.array([known.get(key, x) for key, x in zip(keys, theta, strict=True)])
    own = [i for i, p in enumerate(problem.model.parameters) if p.key not in known and not p.searched]
    free = {fit.parameters[i].key for i in fit.free}
    index = np.array([i for i, key in enumerate(keys) if key in free or i in own], int)
    with np.errstate(all="ignore"):
        there = Elsewhere.of(problem, theta, fit.solution.frame, index)
    mine = np.isin(index, own)
    return all(_imitated(jacobian, mine) for jacobian in (there.jacobian, there.of_others))


def _imitated(jacobian: Array, mine: NDArray[np.bool_]) -> bool:
    """Whether some columns are combinations of the others, but for a small part."""
    size = np.linalg.norm(jacobian, axis=0)
    shown = size > NO_CHANGE * size.max(initial=0.0)
    others, own = (jacobian[:, these & shown] / size[these & shown] for these in (~mine, mine))
    left = own - others @ np.linalg.lstsq(others, own, rcond=None)[0] if others.size else own
    return bool(np.all(np.linalg.norm(left, axis=0) <= UNSEEN))


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
        raise PlanError(f"n {shown(n)}", f"a whole number from 1 to {MOST}")
    wanted = [wanted] if isinstance(wanted, str) else wanted
    question = _question(fit, [c for c in classes if len(c) > 1], wanted, trusted)
    if not question.classes and not question.keys:
        return Plan({}, (), (), ("Nothing is estimated that measurements could sharpen.",), None)
    with one_thread_in_blas():
        found = _Planner(fit, question, int(n)).plan()
        if question.kind == "show" and not found.count:
            rest = _sharpened(fit, question.keys) or [fit.parameters[i].key for i in fit.free]
            question = replace(question, kind="sharpen", keys=tuple(rest), notes=_lacking(fit))
            found = _Planner(fit, question, int(n)).plan()
    return found


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
    return "sharpen", _sharpened(fit) or [fit.parameters[i].key for i in fit.free]


def _sharpened(fit: Fit, without: Sequence[str] = ()) -> list[str]:
    """Return the parameters that the data determine, without the frame's."""
    out = {key for x in fit.determinacy.directions for key, _ in x.parts} | set(without)
    every = [fit.parameters[i].key for i in fit.free]
    return [key for key in every if key not in out and not key.startswith("frame.")]


def _wanted(fit: Fit, text: str) -> tuple[list[str], Effect | None]:
    """Return the keys that a text means, and an effect that is not in the model yet."""
    keys = [fit.parameters[i].key for i in fit.free]
    inside = [key for key in keys if key == text or key.startswith((f"{text}.", f"{text}["))]
    if inside:
        return inside, None
    machine = fit.machine
    names = {p.key for p in fit.parameters}
    if text in names:
        raise PlanError(f"parameter {shown(text)} is held", f"one that is estimated: {_some(keys)}")
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
            f"no parameter {shown(text)}",
            f"one of {some or 'none, as nothing is estimated'}, or an effect that the machine may have, such as "
            f"EFFECT@JOINT",
        ) from None
    units = effect.units(machine)
    own = [name for name in units if not name.startswith("k_")] or list(units)
    if parts[1:] and parts[1] not in units:
        raise PlanError(f"no parameter {shown(parts[1])} of {effect.title}", f"one of {listed(list(units))}")
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
        texts = _from_each_other(possible, best)
        yield from (f"Tell {text}." for text in texts[:MOST_TOLD])
        if len(texts) > MOST_TOLD:
            yield f"And so on, for {len(texts) - MOST_TOLD} more of them."
        if refuted:
            verb = "fits" if len(refuted) == 1 else "fit"
            yield f"{listed(refuted)} {verb} the data worse already, or with sizes that no machine has."
        if len(left) == 1:
            yield f"{left[0]} is left."
        alike = [p for p in best.pairs if p.of == k and not p.possible]
        exact = {frozenset((p.pair.true, p.pair.wrong)) for p in alike if not p.tiny}
        small = {frozenset((p.pair.true, p.pair.wrong)) for p in alike} - exact
        if exact:
            yield (
                f"No measurement tells {_groups(exact, best, 2)} apart: they do the same to every reading within the "
                f"travel."
            )
        if small:
            yield (
                f"Too much alike, as fitted, for a reasonable number of readings: {_groups(small, best, 1)}."
            )
        larger = [
            (less, more)
            for c, less, more in best.included
            if c == k and frozenset((less, more)) not in exact | small
        ]
        if larger:
            less, more = larger[0]
            others = f" ({len(larger) - 1} more such)" if len(larger) > 1 else ""
            yield (
                f"{best.title(more)} can do all that {best.title(less)} does: no reading speaks for the latter, only "
                f"that it is simpler{others}."
            )

    def _key_goals(self, best: Attempt) -> Iterator[Goal]:
        if not best.keys:
            return
        show = self.question.kind == "show"
        lost = [k.key for k in best.keys if k.gauge]
        keys = [k for k in best.keys if not k.gauge and not (show and k.now is not None)]
        open_ = [k.key for k in keys if k.after is None]
        if show and len(open_) < len(keys):
            keys = [k for k in keys if k.after is not None]
        verb = "Determine" if show else "Sharpen"
        sentences = [f"{verb} {_some([k.key for k in keys])}."] if keys else []
        if lost and not show and not self.question.of_all:
            sentences.append(
                f"No reading shows {_some(lost)}: a choice of coordinates, or without any effect here."
            )
        if show:
            undetermined = self.fit.determinacy.undetermined
            lacking = {p.key for p, yes in zip(self.fit.parameters, undetermined, strict=True) if yes}
            open_ = [key for key in open_ if key in lacking or not any(k.after is not None for k in keys)]
        if open_:
            some = "them" if len(open_) == len(keys) else _some(open_)
            sentences.append(f"No reading within the travel determines {some}.")
        sentence = " ".join(sentences)
        gains = tuple(Gain("std", k.key, k.now, k.after, unit=k.unit) for k in keys)
        names = tuple(k.key for k in best.keys)
        solved = any(k.after is not None for k in keys)
        if not keys and self.question.of_all:
            sentence, solved = (
                "Sharpen the model as a whole, as each parameter rests on a choice of coordinates.",
                True,
            )
        reached = not open_ and (self.question.of_all or not lost)
        yield Goal(self.question.kind, (), names, sentence, solved, reached, gains)

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
        if machine.kinematics.is_closed:  # whose file says no travel of its legs
            return
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
        directions = not self.question.machine.measurand.moving
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


def _some(names: Sequence[str], most: int = 6) -> str:
    return listed([*names[:most], f"{len(names) - most} more"] if len(names) > most + 1 else list(names))


def _groups(pairs: set[frozenset[int]], best: Attempt, most: int) -> str:
    """Name the largest groups of models of which all are pairs, and count the others."""
    groups = sorted(_together(pairs), key=len, reverse=True)
    texts = [_some([best.title(k) for k in group], NAMES) for group in groups[:most]]
    more = len(groups) - len(texts)
    return "; ".join([*texts, *([f"and {more} more group{'s' * (more > 1)}"] if more else [])])


def _from_each_other(pairs: set[frozenset[int]], best: Attempt) -> list[str]:
    """Say which effects are to be told from which: all from each other, or one from some after the other."""
    nodes = sorted({k for pair in pairs for k in pair})
    if nodes and 2 * len(pairs) == len(nodes) * (len(nodes) - 1):
        return [f"{_some([best.title(k) for k in nodes], NAMES)} apart"]
    left, found = set(pairs), []
    while left:
        most = max(nodes, key=lambda k: sum(k in pair for pair in left))
        others = [k for k in nodes if frozenset((k, most)) in left]
        left -= {frozenset((k, most)) for k in others}
        found.append(f"{best.title(most)} from {_some([best.title(k) for k in others], NAMES)}")
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
