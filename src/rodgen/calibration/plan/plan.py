"""What to measure next, from a fit or a diagnosis: fit the rivals, choose the readings, say what they decide."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rodgen.calibration.fitted import Fit
from rodgen.calibration.open_questions import HasOpenQuestions, OpenQuestions
from rodgen.calibration.plan.constraints import WELL_SEEN, Constraints
from rodgen.calibration.plan.goals import MOST_READINGS, Gain, Goal, PlanError
from rodgen.calibration.plan.pool import Planned
from rodgen.calibration.plan.rows import as_csv, for_people, table
from rodgen.calibration.plan.separation import Separation
from rodgen.calibration.plan.sharpening import Sharpening
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.document import Block, Bullets, Document, Documented, Paragraph, Part, Table
from rodgen.errors import counted, joined, shown
from rodgen.machines.machine import Effect
from rodgen.views import Result

__all__ = ["Plan", "PlanError", "plan", "plan_for"]


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Documented, Result):
    """Measurements to take next.

    Attributes
    ----------
    rows : mapping of str to list
        Columns of commands, named with their units as those of the measurement file, in the order in which they are to
        be taken; without readings.
    goals : tuple of Goal
        What is to be settled, and whether these readings are expected to.
    notes : tuple of str
        What limits the plan, and what else is to be known.
    needed : int or None
        How many readings would settle what these do not; None where these do, or no number would.
    sky : mapping of str to list
        Altitudes and azimuths of the stars, deg, of a mount whose rows say hour angle and declination; else empty.
    """

    rows: Mapping[str, list[Any]]
    goals: tuple[Goal, ...]
    notes: tuple[str, ...]
    needed: int | None
    sky: Mapping[str, list[Any]] = field(default_factory=dict)

    _keys = "readings=count needed resolvable reached rows sky goals notes"

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

    def document(self) -> Document:
        """Return what to measure, what it settles, and notes."""
        return Document(list(self._blocks()))

    def _blocks(self) -> Iterator[Block]:
        if not self.goals:
            yield from map(Paragraph, self.notes)
            return
        if self.count:
            columns = for_people({**self.rows, **self.sky})
            rows = list(zip(*columns.values(), strict=True))
            title = f"What to measure: {counted(self.count, 'reading')}"
            yield Part([Table(list(columns), rows, "r" * len(columns))], title)
        else:
            sharpens = all(goal.kind == "sharpen" and goal.gains for goal in self.goals)
            why = " would tell more." if sharpens else ": no reading within the travel settles what is open."
            yield Paragraph(f"Nothing to measure{why}")
        sentences = [sentence for goal in self.goals for sentence in goal.sentences]
        yield Part([Bullets(sentences)], "What it settles" if self.count else "What is open")
        if self.notes:
            yield Part([Bullets(self.notes)], "Notes")


def plan(
    of: Fit | HasOpenQuestions,
    n: int = 12,
    *,
    wanted: Iterable[str] | None = None,
    constraints: Constraints | None = None,
) -> Plan:
    """Return what to measure next.

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
    constraints : Constraints, optional
        What readings can be taken, see :func:`rodgen.calibration.plan.constraints.load_constraints`.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        When a key is unknown, or `n` is no number from 1 to 500.
    InputFileError
        When no reading satisfies the constraints.

    Examples
    --------
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
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
    questions = OpenQuestions(of) if isinstance(of, Fit) else of.open_questions
    final = questions.final
    if wanted or questions.found is None:
        return plan_for(final, (), n, wanted=wanted or (), constraints=constraints)
    apart = Plan({}, (), (), None)
    if questions.alternatives:
        apart = plan_for(final, questions.alternatives, n, trusted=True, constraints=constraints)
        if apart.count:
            return apart
    free = [final.parameters[i].key for i in final.free]
    keys = [key for key in free if any(effect.owns(key) for effect in questions.found)]
    keys += [key for effect in questions.sides if (key := effect.key("b")) not in keys]
    asked = bool(questions.why)
    sharper = plan_for(final, (), n, wanted=keys, asked=asked, constraints=constraints)
    if asked:
        goals = [replace(goal, sentences=(questions.why, *goal.sentences)) for goal in sharper.goals]
        sharper = replace(sharper, goals=tuple(goals))
    notes = tuple(dict.fromkeys((*apart.notes, *sharper.notes)))
    return replace(sharper, goals=(*apart.goals, *sharper.goals), notes=notes)


def plan_for(
    fit: Fit,
    alternatives: Sequence[Sequence[Effect]] = (),
    n: int = 12,
    *,
    wanted: Iterable[str] = (),
    trusted: bool = False,
    asked: bool = True,
    constraints: Constraints | None = None,
) -> Plan:
    """Return what to measure to tell effects apart, or else to sharpen parameters; see :func:`plan`.

    Parameters
    ----------
    fit : Fit
        Of the machine with or without these effects.
    alternatives : sequence of sequences of Effect
        Effects of which one is there, and the data do not say which; the likeliest first.
    n : int
    wanted : iterable of str
        Only where there are no alternatives.
    trusted : bool
        Whether the alternatives are those of a diagnosis. Otherwise effects that independent readings refute are left
        out.
    asked : bool
        Whether a user asked for the wanted parameters. Otherwise no readings are planned that sharpen none of them.
    constraints : Constraints, optional

    Raises
    ------
    PlanError, InputFileError
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= MOST_READINGS:
        raise PlanError(f"n {shown(n)}", f"a whole number from 1 to {MOST_READINGS}")
    texts = [wanted] if isinstance(wanted, str) else list(map(str, wanted))
    if alternatives and texts:
        raise PlanError("both alternatives and wanted parameters", "one of them")
    constraints = constraints or Constraints()
    most = min(int(n), constraints.session or int(n))
    o = fit.observations.take(~fit.outliers) if fit.outliers.any() else fit.observations
    planned: Planned
    with one_thread_in_blas():
        if alternatives:
            planned = Separation(fit, o, alternatives, constraints, most, trusted)
        else:
            planned = Sharpening(fit, o, texts, constraints, most, asked)
        rows = {} if planned.rows is None else table(fit.machine, planned.pool.surroundings, planned.rows)
        sky = {} if planned.rows is None else planned.pool.sky(planned.rows)
    notes = [*planned.notes, *_notes(planned)] if planned.goals else planned.notes
    return Plan(rows, tuple(planned.goals), tuple(notes), planned.needed, sky)


def _notes(planned: Planned) -> Iterator[str]:
    """Yield sentences on what limits a plan: the travel, the run, the constraints, and the number of readings."""
    pool = planned.pool
    if pool.without_travel and not all(goal.reached for goal in planned.goals):
        ranges = []
        for j in pool.without_travel:
            joint = pool.machine.joints[j]
            unit, factor = pool.o.unit_of(joint.column)
            low, high = (f"{x / factor + 0.0:.4g}" for x in pool.travel[j])
            ranges.append(
                f"{joint.name} {low} {unit}" if low == high else f"{joint.name} {low} to {high} {unit}"
            )
        names = joined([pool.machine.joints[j].name for j in pool.without_travel])
        yield (
            f"The machine file gives no travel of {names}, so that of the data was used: {joined(ranges)}. If there is "
            f"more, state it there (travel = [low, high]) and plan again."
        )
    if planned.rows is None:
        return
    if "run" in pool.o.columns_given:
        run = pool.o.run_names[pool.o.run[-1]]
        yield f"The rows continue run {run}, in its set-up; after a new set-up give them a run of their own."
    if pool.constraints.regions[-2:] == WELL_SEEN:
        yield (
            "Stars are taken at altitudes of 20 to 80 deg, within the travel of the file; --constraints states others, "
            'such as allowed = ["altitude > 10 deg"].'
        )
    if pool.badly_seen:
        yield (
            "No star within the travel and the constraints is at an altitude of 20 to 80 deg, so all are considered; "
            "low stars shimmer in the air, and a mount follows high ones badly."
        )
    if far := pool.out_of_reach:
        balls = f"ball{'s' * (len(far) > 1)} {joined(map(str, far))}"
        yield f"Out of reach within the travel and the limits: {balls} of the artefact."
    if pool.constraints.boxes:
        yield "The target keeps out of the boxes in the planned readings, not on the ways between them."
    if isinstance(planned, Separation):
        yield from planned.not_enough()
