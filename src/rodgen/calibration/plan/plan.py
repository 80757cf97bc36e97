"""What to measure next, from a fit or a diagnosis: fit the rivals, design the readings, put the result in words."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.calibration.plan.campaign import MOST_READINGS, Campaign
from rodgen.calibration.plan.chosen_places import gone_back
from rodgen.calibration.plan.constraints import Constraints
from rodgen.calibration.plan.differences import differences
from rodgen.calibration.plan.goals import Gain, Goal, goals_of, no_gain
from rodgen.calibration.plan.invisible import invisible_effects
from rodgen.calibration.plan.notes import about_rows, about_target_column, about_travel, not_enough
from rodgen.calibration.plan.question import (
    PlanError,
    Question,
    ask,
    determined_parameters,
    parameters_to_sharpen,
    undetermined_sentences,
)
from rodgen.calibration.plan.summary import lines_of
from rodgen.calibration.plan.table import as_csv, table
from rodgen.calibration.plan.variations import best_plan, joints_without_travel, plan_over_more_travel
from rodgen.calibration.plan.words import number
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.data.poses import moved_one_way
from rodgen.errors import joined, shown
from rodgen.machines.machine import Target
from rodgen.views import brief, html_of, plain

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.calibration.open_questions import HasOpenQuestions, OpenQuestions
    from rodgen.machines.machine import Effect

__all__ = ["Plan", "PlanError", "plan", "plan_for"]


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
    travel_missing : tuple of str
        Joints whose travel the machine file is to state first, where readings within more of it would do.
    """

    rows: Mapping[str, list[Any]]
    goals: tuple[Goal, ...]
    words: tuple[str, ...]
    notes: tuple[str, ...]
    needed: int | None
    new_targets: tuple[Target, ...] = ()
    travel_missing: tuple[str, ...] = ()

    __repr__ = brief
    _repr_html_ = html_of

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
            **plain(self, "needed resolvable reached"),
            "rows": {name: list(values) for name, values in self.rows.items()},
            "goals": [goal.to_dict() for goal in self.goals],
            **plain(self, "words notes"),
            "new_targets": [{"name": t.name, "point": list(t.point)} for t in self.new_targets],
            "travel_missing": list(self.travel_missing),
        }

    def summary(self) -> str:
        """Return the plan as text."""
        return "\n".join(lines_of(self))

    def __str__(self) -> str:
        return self.summary()


def plan(
    of: HasOpenQuestions,
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
    questions = of.open_questions
    final = questions.final
    if wanted or questions.found is None:
        return plan_for(final, (), n, wanted=wanted or (), constraints=constraints)
    found = None
    if questions.alternatives:
        found = plan_for(
            final, questions.alternatives, n, trusted=questions.dependent, constraints=constraints
        )
    if found is None or not any(goal.resolvable for goal in found.goals):
        found = _there_and_back(questions, n, constraints) or _sharper(questions, n, found, constraints)
    return replace(found, notes=(*found.notes, *invisible_effects(questions)))


def _there_and_back(questions: OpenQuestions, n: int, constraints: Constraints | None) -> Plan | None:
    """Return a plan that goes back where joints went one way only while the set-up wandered; else None."""
    o = questions.final.observations
    one_way = np.flatnonzero(moved_one_way(np.asarray(o.q)))
    if questions.found or not questions.wanders or not len(one_way):
        return None
    names = joined([o.machine.joints[j].name for j in one_way])
    question = replace(ask(questions.final, (), (), trusted=True), constraints=constraints or Constraints())
    if not question.keys:
        return None
    with one_thread_in_blas():
        campaign = Campaign(question, question.machine, o)
    rows = gone_back(campaign.pool, np.asarray(o.q), campaign.way, min(n, question.constraints.session or n))
    them = "it" if len(one_way) == 1 else "them"
    sentence = (
        f"Tell errors that follow {names} from a set-up that wanders: {names} went one way only meanwhile."
    )
    return Plan(
        rows=table(campaign.machine, campaign.surroundings, rows),
        goals=(Goal("order", (), (), sentence, True, False, ()),),
        words=(
            f"Go back through the positions of {names}, so that what follows {them} comes apart from the wander.",
        ),
        notes=(),
        needed=None,
    )


def _sharper(questions: OpenQuestions, n: int, before: Plan | None, constraints: Constraints | None) -> Plan:
    """Return a plan that sharpens the parameters of effects, with what an earlier plan could not settle."""
    keys, notes = determined_parameters(questions.final, questions.found or ())
    if before is not None and not keys:
        return before
    sharper = plan_for(questions.final, (), n, wanted=keys, asked=False, constraints=constraints)
    before = before or Plan({}, (), (), (), None)
    every = dict.fromkeys((*before.notes, *sharper.notes, *notes))
    return replace(sharper, goals=(*before.goals, *sharper.goals), notes=tuple(every))


def plan_for(
    fit: FittedModel,
    alternatives: Sequence[Sequence[Effect]] = (),
    n: int = 12,
    *,
    wanted: Iterable[str] = (),
    trusted: bool = False,
    asked: bool = True,
    constraints: Constraints | None = None,
) -> Plan:
    """Return what to measure to tell effects apart, or to sharpen parameters; see :func:`plan`.

    Parameters
    ----------
    fit : Fit
        Of the machine with or without these effects.
    alternatives : sequence of sequences of Effect
        Effects of which one is there, and the data do not say which; the likeliest first.
    n : int
    wanted : iterable of str
    trusted : bool
        Whether the alternatives are those of a diagnosis that found readings to depend on each other. Otherwise effects
        that independent readings refute are left out.
    asked : bool
        Whether a user asked for the wanted parameters. Otherwise no readings are planned that sharpen none of them.
    constraints : Constraints, optional

    Raises
    ------
    PlanError, InputFileError
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= MOST_READINGS:
        raise PlanError(f"n {shown(n)}", f"a whole number from 1 to {MOST_READINGS}")
    question = ask(
        fit, alternatives, [wanted] if isinstance(wanted, str) else wanted, trusted=trusted, asked=asked
    )
    question = replace(question, constraints=constraints or Constraints())
    most = min(int(n), question.constraints.session or int(n))
    if not question.alternatives and not question.keys:
        return Plan({}, (), (), ("Nothing is estimated that measurements could sharpen.",), None)
    with one_thread_in_blas():
        found = _planned(fit, question, most)
        if question.kind == "show" and not found.count and not found.travel_missing:
            keys = parameters_to_sharpen(fit, question.keys)
            notes = undetermined_sentences(fit)
            question = replace(question, kind="sharpen", keys=tuple(keys), notes=notes)
            found = _planned(fit, question, most)
    return found


def _planned(fit: FittedModel, question: Question, n: int) -> Plan:
    """Return the plan for a question, in words."""
    o = fit.observations.take(~fit.outliers) if fit.outliers.any() else fit.observations
    best = best_plan(question, o, n)
    campaign, rows = best.campaign, best.rows
    goals = tuple(goals_of(best, fit))
    useful = any(goal.resolvable for goal in goals)
    notes = [*question.notes, *campaign.rivals.refused]
    if question.keys and not fit.dependence.independent:
        notes.append(fit.dependence.text)
    joints = [] if all(goal.reached for goal in goals) else joints_without_travel(best)
    wider = plan_over_more_travel(best, joints, n) if joints else None
    if joints:
        notes.append(about_travel(best, joints, wider))
    if not useful or (wider is not None and best.hopeless):
        missing = tuple(campaign.machine.joints[j].name for j in joints) if wider is not None else ()
        return Plan({}, goals, (), tuple(dict.fromkeys(notes)), None, travel_missing=missing)
    notes += filter(None, [no_gain(best)])
    notes += about_rows(best)
    notes += not_enough(best)
    new = tuple(campaign.machine.targets[k] for k in np.unique(rows.target) if k >= len(o.machine.targets))
    notes += about_target_column(o, new)
    return Plan(
        rows=table(campaign.machine, campaign.surroundings, rows),
        goals=goals,
        words=tuple(dict.fromkeys(differences(campaign, rows))),
        notes=tuple(dict.fromkeys(notes)),
        needed=best.needed,
        new_targets=new,
    )
