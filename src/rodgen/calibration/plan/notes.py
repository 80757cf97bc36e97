"""Notes of a plan: what the set-up has to be, and what could not be planned."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.plan.campaign import MOST_READINGS
from rodgen.calibration.plan.words import range_text
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.candidate_plan import CandidatePlan
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Target

HALF = 0.5
"""A smaller probability of success is not called uncertain, but improbable."""
ON_THE_WAY = 20
"""Places on the way from one reading to the next that are looked at: all joints move at once."""
MOST_WAYS = 3
"""Ways through a box that are named."""


def about_rows(best: CandidatePlan) -> Iterator[str]:
    """Yield what is to be known of the rows when they are measured."""
    o = best.campaign.o
    if best.wrong_sides:
        yield (
            "The order of these rows does not bring every joint from the most informative side; the gain is that of "
            "the order as it stands."
        )
    if "run" in o.columns_given:
        run = o.run_names[o.run[-1]]
        yield f"The rows continue run {run}, in its set-up; after a new set-up give them a run of their own."
    far = best.campaign.out_of_reach
    if far:
        balls = f"ball{'s' * (len(far) > 1)} {joined(map(str, far))}"
        yield f"Out of reach within the travel and the limits: {balls} of the artefact."
    if through := _through_boxes(best):
        rows = joined([f"{k} and {k + 1}" for k in through], most=MOST_WAYS)
        yield f"The straight way between rows {rows} of the plan leads through a box to keep out of: go round it."
    pace = best.campaign.question.constraints.pace
    if pace is not None:
        minutes = float(pace.intervals(o.q[-1], best.rows.q).sum()) / 60
        yield f"Moves and readings take about {minutes:.3g} min."
    if o.sigma is not None and any(name.startswith("u_") for name in o.columns_given):
        yield "The uncertainties in the rows are those that are usual in the data."


def about_travel(best: CandidatePlan, joints: Sequence[int], wider: CandidatePlan | None) -> str:
    """Return a sentence on joints without a travel in the machine file, of which there may be more than in the data.

    The wider plan, if there is one, settles the question within more travel of these joints.
    """
    names = joined([best.campaign.machine.joints[j].name for j in joints])
    further = ""
    if wider is not None:
        but = "" if wider.reached else ", except where two effects change every reading in the same way"
        further = f": with {_ranges(wider, joints)}, {wider.rows.n} readings would do{but}"
    return (
        f"The machine file gives no travel of {names}, so that of the data was used: {_ranges(best, joints)}. If there "
        f"is more, state it there (travel = [low, high]) and plan again{further}."
    )


def _ranges(plan: CandidatePlan, joints: Sequence[int]) -> str:
    o, travel = plan.campaign.o, plan.campaign.travel
    return joined([f"{o.machine.joints[j].name} {range_text(o, j, travel[j])}" for j in joints])


def not_enough(best: CandidatePlan) -> Iterator[str]:
    """Yield how many readings would be enough, where these are not."""
    if not best.reached_as_far_as_possible:
        count = best.rows.n
        session = best.campaign.question.constraints.session
        if best.needed:
            sessions = f", in {math.ceil(best.needed / session)} sessions" if session else ""
            yield f"{count} readings {_not_enough(best)}; about {best.needed} would be{sessions}."
        else:
            yield f"{count} readings {_not_enough(best)}, and neither may {MOST_READINGS}."


def _not_enough(best: CandidatePlan) -> str:
    """Say how sure it is that the readings are too few for one of the pairs."""
    least = min((gain.probability for gain in best.gains if gain.pair.possible), default=1.0)
    return "are probably not enough" if least < HALF else "may not be enough"


def about_target_column(o: Observations, new_targets: Sequence[Target]) -> Iterator[str]:
    """Yield what a first new target means for the old data."""
    if new_targets and "target" not in o.data.columns:
        name = o.machine.targets[0].name
        yield f"With a second target the old data need a column target, {name} in every row."


def _through_boxes(best: CandidatePlan) -> list[int]:
    """Return the rows, from 1, from which the way of the target to the next row leads through a box to keep out of."""
    campaign, rows = best.campaign, best.rows
    boxes = campaign.question.constraints.boxes
    if not boxes or rows.n < 2:
        return []
    part = np.linspace(0, 1, ON_THE_WAY + 2)[1:-1, None]
    q = rows.q[:-1, None] + part * np.diff(rows.q, axis=0)[:, None]
    between = rows.take(np.repeat(np.arange(rows.n - 1), ON_THE_WAY))
    place = campaign.places(replace(between, q=q.reshape(between.n, -1)))
    inside = [np.all((place >= box[:, 0]) & (place <= box[:, 1]), axis=1) for box in boxes]
    return (np.flatnonzero(np.any(inside, axis=0).reshape(rows.n - 1, -1).any(axis=1)) + 1).tolist()
