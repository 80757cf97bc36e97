"""What to measure next, from a fit or a diagnosis: fit the rivals, choose the readings, say what they decide."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.calibration.fitted import Fit
from rodgen.calibration.open_questions import HasOpenQuestions, OpenQuestions
from rodgen.calibration.plan.campaign import MOST_READINGS, Campaign, Search
from rodgen.calibration.plan.constraints import Constraints
from rodgen.calibration.plan.goals import Gain, Goal, goals_of
from rodgen.calibration.plan.question import (
    PlanError,
    Question,
    ask,
    determined_parameters,
    parameters_to_sharpen,
    undetermined_sentences,
)
from rodgen.calibration.plan.rows import as_csv, as_text, table
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.data.poses import moved_one_way
from rodgen.errors import joined, shown
from rodgen.statistics.thresholds import PLAN
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.machines.machine import Effect
    from rodgen.machines.observations import Observations

__all__ = ["Plan", "PlanError", "plan", "plan_for"]

WIDTH = 100
"""Of a line of text."""
WHOLE_TURN = 0.9
"""Part of a turn from which data of a revolute joint cover all there is."""


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Result):
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
    """

    rows: Mapping[str, list[Any]]
    goals: tuple[Goal, ...]
    notes: tuple[str, ...]
    needed: int | None

    _keys = "readings=count needed resolvable reached rows goals notes"

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
            yield from (f"    {line}" for line in as_text(self.rows))
            yield "What it settles"
        else:
            sharpens = all(goal.kind == "sharpen" for goal in self.goals)
            why = " would tell more." if sharpens else ": no reading within the travel settles what is open."
            yield f"Nothing to measure{why}"
            yield "What is open"
        yield from _wrapped(sentence for goal in self.goals for sentence in goal.sentences)
        if self.notes:
            yield "Notes"
        yield from _wrapped(self.notes)


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
    found = None
    if questions.alternatives:
        found = plan_for(
            final, questions.alternatives, n, trusted=questions.dependent, constraints=constraints
        )
    if found is None or not any(goal.resolvable for goal in found.goals):
        found = _there_and_back(questions, n, constraints) or _sharper(questions, n, found, constraints)
    return found


def _there_and_back(questions: OpenQuestions, n: int, constraints: Constraints | None) -> Plan | None:
    """Return a plan that goes back where joints went one way only while the set-up wandered; else None."""
    o = questions.final.observations
    q = np.asarray(o.q)
    one_way = np.flatnonzero(moved_one_way(q))
    if questions.found or not questions.wanders or not len(one_way):
        return None
    names = joined([o.machine.joints[j].name for j in one_way])
    question = replace(ask(questions.final, (), (), trusted=True), constraints=constraints or Constraints())
    if not question.keys:
        return None
    with one_thread_in_blas():
        campaign = Campaign(question, o)
    span = np.ptp(campaign.travel, axis=1)
    scale = np.where(span > 0, span, 1.0)
    places = q[np.linspace(o.n - 1, 0, min(n, question.constraints.session or n, o.n)).astype(int)]
    nearest = [int(np.argmin(np.abs((campaign.rows.q - place) / scale).max(axis=1))) for place in places]
    rows = campaign.rows.take(np.array(list(dict.fromkeys(nearest)))).as_moved(q[-1])
    sentence = (
        f"Tell errors that follow {names} from a set-up that wanders: {names} went one way only meanwhile, and goes "
        f"back through its positions."
    )
    goal = Goal("order", (), (), (sentence,), True, False, ())
    return Plan(table(campaign.machine, campaign.surroundings, rows), (goal,), (), None)


def _sharper(questions: OpenQuestions, n: int, before: Plan | None, constraints: Constraints | None) -> Plan:
    """Return a plan that sharpens the parameters of effects, with what an earlier plan could not settle."""
    keys, notes = determined_parameters(questions.final, questions.found or ())
    if before is not None and not keys:
        return before
    sharper = plan_for(questions.final, (), n, wanted=keys, asked=False, constraints=constraints)
    before = before or Plan({}, (), (), None)
    every = dict.fromkeys((*before.notes, *sharper.notes, *notes))
    return replace(sharper, goals=(*before.goals, *sharper.goals), notes=tuple(every))


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
        return Plan({}, (), ("Nothing is estimated that measurements could sharpen.",), None)
    with one_thread_in_blas():
        found = _planned(fit, question, most)
        if question.kind == "show" and not found.count and not _without_travel(question, fit.observations):
            keys = parameters_to_sharpen(fit, question.keys)
            notes = undetermined_sentences(fit)
            question = replace(question, kind="sharpen", keys=tuple(keys), notes=notes)
            found = _planned(fit, question, most)
    return found


def _planned(fit: Fit, question: Question, n: int) -> Plan:
    """Return the plan for a question."""
    o = fit.observations.take(~fit.outliers) if fit.outliers.any() else fit.observations
    campaign = Campaign(question, o)
    search = Search(campaign, n)
    goals = tuple(goals_of(search, fit))
    notes = [*question.notes, *campaign.rivals.refused]
    if question.keys and not fit.dependence.independent:
        notes.append(fit.dependence.text)
    if not all(goal.reached for goal in goals):
        notes += _about_travel(campaign)
    if not any(goal.resolvable for goal in goals):
        return Plan({}, goals, tuple(dict.fromkeys(notes)), None)
    notes += _about_rows(campaign)
    notes += _not_enough(search)
    rows = table(campaign.machine, campaign.surroundings, search.rows)
    return Plan(rows, goals, tuple(dict.fromkeys(notes)), search.needed)


# what limits it ------------------------------------------------------------------------------------------------------


def _without_travel(question: Question, o: Observations) -> list[int]:
    """Return joints in question without a travel in the machine file, of which there may be more than in the data."""
    machine = question.machine
    # the file of a closed chain states no travel of its legs; a list of poses has all that there are
    if machine.kinematics.is_closed or question.constraints.poses is not None:
        return []
    places = {e.place for each in question.alternatives for e in each}
    places |= {key.split(".")[0] for key in question.keys}
    of_joints = bool(places & {joint.name for joint in machine.joints})
    turned = np.ptp(o.q, axis=0) > 2 * math.pi * WHOLE_TURN
    return [
        j
        for j, joint in enumerate(machine.joints)
        if machine.limits[j] is None
        and joint.is_read
        and joint.column not in question.constraints.limits
        and not (joint.revolute and turned[j])
        and (joint.name in places or not of_joints)
    ]


def _about_travel(campaign: Campaign) -> Iterator[str]:
    """Yield a sentence on joints without a travel in the machine file."""
    joints = _without_travel(campaign.question, campaign.o)
    if joints:
        names = [campaign.machine.joints[j].name for j in joints]
        ranges = []
        for j, name in zip(joints, names, strict=True):
            unit, factor = campaign.o.unit_of(campaign.machine.joints[j].column)
            low, high = (f"{x / factor + 0.0:.4g}" for x in campaign.travel[j])
            ranges.append(f"{name} {low} {unit}" if low == high else f"{name} {low} to {high} {unit}")
        yield (
            f"The machine file gives no travel of {joined(names)}, so that of the data was used: {joined(ranges)}. If "
            f"there is more, state it there (travel = [low, high]) and plan again."
        )


def _about_rows(campaign: Campaign) -> Iterator[str]:
    """Yield sentences on the run of the rows, on what the constraints exclude, and on what they do not."""
    if "run" in campaign.o.columns_given:
        run = campaign.o.run_names[campaign.o.run[-1]]
        yield f"The rows continue run {run}, in its set-up; after a new set-up give them a run of their own."
    if far := campaign.out_of_reach:
        balls = f"ball{'s' * (len(far) > 1)} {joined(map(str, far))}"
        yield f"Out of reach within the travel and the limits: {balls} of the artefact."
    if campaign.question.constraints.boxes:
        yield "The target keeps out of the boxes in the planned readings, not on the ways between them."


def _not_enough(search: Search) -> Iterator[str]:
    """Yield how many readings would be enough, where these are not."""
    question, count = search.campaign.question, search.rows.n
    planned = [gain for gain in search.gains() if gain.pair.possible]
    if all(gain.reached for gain in planned):
        return
    least = min(gain.probability for gain in planned)
    said = "are probably not enough" if least < PLAN.hopeless else "may not be enough"
    if search.needed:
        session = question.constraints.session
        sessions = f", in {math.ceil(search.needed / session)} sessions" if session else ""
        yield f"{count} readings {said}; about {search.needed} would be{sessions}."
    else:
        yield f"{count} readings {said}, and neither may {MOST_READINGS}."
