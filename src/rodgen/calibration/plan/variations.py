"""Ways to continue measuring when readings with the present targets do not settle a question.

The machine may be measured after a wait or from cold again, with one more target, or over more of its travel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.plan.campaign import Campaign
from rodgen.calibration.plan.candidate_plan import CandidatePlan, plan_campaign, rough_plan
from rodgen.kinematics.axis_fit.moments import tangents
from rodgen.statistics.thresholds import PLAN

if TYPE_CHECKING:
    from rodgen.calibration.plan.question import Question
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine
    from rodgen.machines.parts import Joint


WAITS = (2.0, -1.0)
"""For how many times the duration of the data to wait; negative: to begin when the machine is cold."""
FEW_TARGETS = 3
"""With this many, a further target is not proposed."""
WHOLE_TURN = 0.9
"""Part of a turn from which data of a revolute joint cover all there is."""
WIDER = (0.15, 0.5, 1.0)
"""By what parts of the travel of the data more of it is tried, to either side."""
A_LITTLE_WIDER = (0.1, 0.2)
"""The same where directions are measured: below the horizon there is no star."""


def best_plan(question: Question, o: Observations, n: int) -> CandidatePlan:
    """Return the plan of n readings at most that settles most, with as few changes to the set-up as possible."""
    found = best = plan_campaign(Campaign(question, question.machine, o), n)
    if not question.alternatives or (found.reached and found.rows.n <= PLAN.few_readings):
        return found
    for machine, wait in _ways(found):
        most = best.rows.n // 2 if best.reached else n
        if not most:
            break
        other = rough_plan(Campaign(question, machine, o, wait=wait), most)
        if other.reached or (not best.reached and other.worth > best.worth + PLAN.worth):
            best = other
    return found if best is found else plan_campaign(best.campaign, n)


def _ways(found: CandidatePlan) -> Iterator[tuple[Machine, float]]:
    """Yield machines, with another target where one may help, and waits."""
    campaign, machine, o = found.campaign, found.campaign.machine, found.campaign.o
    constraints = campaign.question.constraints
    if campaign.asks_time and o.t is not None and np.ptp(o.t) > 0:
        yield from ((machine, wait) for wait in WAITS)
    structure = campaign.models[0].fit.problem.model.structure
    # where moments count, one more target would move the mean of the targets, and with it what the effects mean
    free = constraints.places is None and constraints.poses is None
    if free and structure.moving and not structure.centre and len(machine.targets) < FEW_TARGETS:
        yield from ((other, 0.0) for other in _with_a_new_target(campaign.question))


def _with_a_new_target(question: Question) -> Iterator[Machine]:
    """Yield the machine with one more target, at another radius or height about the last axis that is in question."""
    machine = question.machine
    places = {e.place for each in question.alternatives for e in each}
    turning = [joint for joint in machine.joints if joint.revolute]
    carrier = next((j for j in reversed(turning) if j.name in places), turning[-1] if turning else None)
    names = {t.name for t in machine.targets} | {joint.name for joint in machine.joints}
    name = next(text for k in range(2, 1000) if (text := f"{machine.targets[0].name}_{k}") not in names)
    points = np.array([t.point for t in machine.targets])
    if carrier is None:
        size = float(np.linalg.norm(points, axis=1).max()) or 100.0
        new = [points[0] + 0.5 * size * e for e in np.eye(3)]
    else:
        axis, foot = np.array(carrier.axis), np.array(carrier.point)
        height, across = about_axis(carrier, points)
        radius = np.linalg.norm(across, axis=1)
        k = int(np.argmax(radius))
        size = radius[k] or float(np.linalg.norm(points, axis=1).max()) or 100.0
        out = across[k] if radius[k] > 0 else tangents(axis)[:, 0] * size
        new = [
            foot + height[k] * axis + 0.4 * out,
            foot + height[k] * axis - 0.7 * out,
            foot + (height[k] + size) * axis + out,
        ]
    for point in new:
        x, y, z = (
            float(f"{v:.4g}") + 0.0 for v in np.where(np.abs(point) < 1e-9 * size, 0.0, point).tolist()
        )
        yield replace(
            machine, targets=(*machine.targets, replace(machine.targets[0], name=name, point=(x, y, z)))
        )


def about_axis(joint: Joint, points: Array) -> tuple[Array, Array]:
    """Return heights of points (n, 3) along a joint's axis, (n,), and vectors from the axis to them, (n, 3)."""
    axis, foot = np.array(joint.axis), np.array(joint.point)
    height = (points - foot) @ axis
    return height, points - foot - height[:, None] * axis


def joints_without_travel(best: CandidatePlan) -> list[int]:
    """Return joints in question without a travel in the machine file, of which there may be more than in the data."""
    question, o = best.campaign.question, best.campaign.o
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


def plan_over_more_travel(best: CandidatePlan, joints: Sequence[int], n: int) -> CandidatePlan | None:
    """Return a plan that settles the question within more travel of some joints; None where no plan does."""
    question = best.campaign.question
    machine = question.machine
    directions = not machine.measurand.moving
    slides = [
        np.ptp(span)
        for span, joint in zip(best.campaign.travel, machine.joints, strict=True)
        if not joint.revolute
    ]
    size = max([machine.kinematics.size, *slides, *(float(np.linalg.norm(t.point)) for t in machine.targets)])
    for part in A_LITTLE_WIDER if directions else WIDER:
        travel = np.array(best.campaign.travel)
        for j in joints:
            low, high = travel[j]
            usual = math.pi / 2 if machine.joints[j].revolute else size
            more = part * (high - low if high > low else usual)
            if machine.joints[j].revolute:
                more = min(more, math.pi - (high - low) / 2)
            travel[j] = low - more, high + more
        campaign = Campaign(question, machine, best.campaign.o, wait=best.campaign.wait, travel=travel)
        wider = plan_campaign(campaign, n, quick=True)
        if wider.settled:
            return wider
    return None
