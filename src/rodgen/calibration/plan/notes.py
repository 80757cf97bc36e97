"""Notes of a plan: what the set-up has to be, and what could not be planned."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.plan.campaign import MOST_READINGS
from rodgen.calibration.plan.variations import plan_over_more_travel
from rodgen.calibration.plan.words import range_text
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.candidate_plan import CandidatePlan
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Target

__all__ = ["about_rows", "about_target_column", "about_travel", "not_enough"]


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
    if o.sigma is not None and any(name.startswith("u_") for name in o.columns_given):
        yield "The uncertainties in the rows are those that are usual in the data."


def about_travel(best: CandidatePlan, n: int) -> Iterator[str]:
    """Yield a sentence on joints without a travel in the machine file, of which there may be more than in the data."""
    question, o = best.campaign.question, best.campaign.o
    machine = question.machine
    if machine.kinematics.is_closed:  # whose file states no travel of its legs
        return
    unstated = [j for j, joint in enumerate(machine.joints) if joint.travel is None and not _whole_turn(o, j)]
    places = {e.place for each in question.alternatives for e in each}
    places |= {key.split(".")[0] for key in question.keys}
    of_joints = bool(places & {joint.name for joint in machine.joints})
    named = [j for j in unstated if machine.joints[j].name in places or not of_joints]
    if not named:
        return
    names = joined([machine.joints[j].name for j in named])
    further = _with_more_travel(best, named, n) if question.alternatives else ""
    yield (
        f"The machine file gives no travel of {names}, so that of the data was used: {_ranges(best, named)}. If there "
        f"is more, state it there (travel = [low, high]) and plan again{further}."
    )


def _with_more_travel(best: CandidatePlan, joints: Sequence[int], n: int) -> str:
    """Say what readings beyond the travel of the data would settle."""
    wider = plan_over_more_travel(best, joints, n)
    if wider is None:
        return ""
    but = "" if wider.reached else ", except where two effects change every reading in the same way"
    return f": with {_ranges(wider, joints)}, {wider.rows.n} readings would do{but}"


def _ranges(plan: CandidatePlan, joints: Sequence[int]) -> str:
    o, travel = plan.campaign.o, plan.campaign.travel
    return joined([f"{o.machine.joints[j].name} {range_text(o, j, travel[j])}" for j in joints])


def _whole_turn(o: Observations, j: int) -> bool:
    return o.machine.joints[j].type == "revolute" and float(np.ptp(o.q[:, j])) > 2 * math.pi * 0.9


def not_enough(best: CandidatePlan) -> Iterator[str]:
    """Yield how many readings would be enough, where these are not."""
    if not best.reached_as_far_as_possible:
        count = best.rows.n
        if best.needed:
            yield f"{count} readings may not be enough; about {best.needed} would be."
        else:
            yield f"{count} readings may not be enough, and neither may {MOST_READINGS}."


def about_target_column(o: Observations, new_targets: Sequence[Target]) -> Iterator[str]:
    """Yield what a first new target means for the old data."""
    if new_targets and "target" not in o.data.columns:
        name = o.machine.targets[0].name
        yield f"With a second target the old data need a column target, {name} in every row."
