"""Sentences on what planned measurements have that those taken do not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.plan.variations import about_axis
from rodgen.calibration.plan.words import number, range_text, values_text
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.campaign import Campaign
    from rodgen.calibration.plan.pool import Levels
    from rodgen.calibration.plan.rows import Rows
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine


BEYOND = 0.05
"""Part of the travel by which positions lie beyond those measured, to be called new."""
BETWEEN = 0.1
"""Part of the travel by which positions lie off the few that were measured."""
FEW = 4
"""Positions of a joint that are counted as single ones."""
IN_STEP = 0.9
"""Correlation of a joint with time from which on one hides the other."""
OTHER_PLACE = 0.1
"""Part of the largest radius by which a target's radius or height about a joint differs from those measured."""


def differences(campaign: Campaign, rows: Rows) -> Iterator[str]:
    """Yield sentences on how planned readings, in order, differ from the data, the most important first."""
    found = list(_differences(campaign, rows))
    yield from found or [_same_kind(campaign, rows)]


def _same_kind(campaign: Campaign, rows: Rows) -> str:
    where = [
        f"{joint.column} {range_text(campaign.o, j, rows.q[:, j])}"
        for j, joint in enumerate(campaign.o.machine.joints)
        if np.ptp(campaign.travel[j]) > 0 and joint.is_read
    ]
    return (
        f"Readings as before, where they are most informative: {joined(where)}."
        if where
        else "Readings as before."
    )


def _differences(campaign: Campaign, rows: Rows) -> Iterator[str]:
    machine, o, choice, wait = campaign.machine, campaign.o, campaign.choice, campaign.wait
    yield from _targets(machine, o, rows)
    yield from _sides(o, rows, choice)
    yield from _loads(o, rows, campaign.asks_load)
    for j in (j for j, joint in enumerate(machine.joints) if joint.is_read):
        yield from _positions(o, rows, j, campaign.travel)
    if campaign.asks_time:
        yield from _order(o, rows)
    yield from _speeds(o, rows, choice)
    yield from _temperatures(o, rows, choice)
    if wait > 0 and o.t is not None:
        end = (float(o.t.max()) + wait * float(np.ptp(o.t))) / o.unit_of("t", "s")[1]
        yield (
            f"Measure later, from t = {end:.3g} {o.data.columns['t'].unit} on: what moves with time has then moved "
            f"further, or has come to rest."
        )
    if wait < 0:
        yield "Begin when the machine is cold, with t as at the start of the data: the drift must be seen again."


def _targets(machine: Machine, o: Observations, rows: Rows) -> Iterator[str]:
    measured, planned = set(np.unique(o.target).tolist()), np.unique(rows.target).tolist()
    fresh = [k for k in planned if k not in measured]
    if not machine.measurand.moving or not fresh:
        if fresh:
            yield f"Measure {joined([machine.targets[k].name for k in fresh])}, too, which is in no row of the data."
        return
    carrier = next((j for j in reversed(machine.joints[machine.inner :]) if j.revolute), None)
    old = sorted(measured)
    for k in fresh:
        new, place = machine.targets[k], ""
        if carrier is not None:
            height, across = about_axis(carrier, np.array([target.point for target in machine.targets]))
            radius = np.linalg.norm(across, axis=1)
            unit, largest = machine.length_unit, max(float(radius[old].max()), 1e-300)
            if np.min(np.abs(radius[k] - radius[old])) > OTHER_PLACE * max(largest, radius[k]):
                before = joined(list(dict.fromkeys(number(round(r, 6)) for r in np.sort(radius[old]))))
                place = f" at a second radius about {carrier.name}, {radius[k]:.4g} {unit} ({before} {unit} before)"
            elif np.min(np.abs(height[k] - height[old])) > OTHER_PLACE * largest:
                place = f" at another height, {height[k]:.4g} {unit} along {carrier.name}"
            else:
                place = " on another side"
        where = ", ".join(f"{x:.6g}" for x in new.point)
        there = "at" if k >= len(o.machine.targets) else "which is in no row of the data, at"
        yield f"Measure target {new.name}{place}: {there} ({where}) {machine.length_unit} with all joints at zero."


def _sides(o: Observations, rows: Rows, choice: Levels) -> Iterator[str]:
    for j in choice.sides:
        name, new = o.machine.joints[j].name, set(np.unique(rows.s[:, j]).tolist()) - {0}
        old = set(np.unique(o.s[:, j]).tolist()) - {0}
        if new - old and old:
            side = "above" if -1 in new - old else "below"
            yield f"Approach {name} from the other side, too: from {side}, as the order of these rows does."
        elif len(new) == 2 and old:
            yield f"Approach {name} from both sides at places where both differ most."


def _loads(o: Observations, rows: Rows, load: bool) -> Iterator[str]:
    if o.load is None or not load:
        return
    unit, factor = o.unit_of("load", "N")
    new = np.unique(rows.load)
    fresh = [x for x in new if not np.any(np.isclose(x, o.load))]
    if len(new) < 2 and not fresh:
        return
    where = []
    for joint, q in zip(o.machine.joints, rows.q.T, strict=True):
        if np.ptp(q) > 0 and joint.is_read:
            of_joint, size = o.unit_of(joint.column)
            where.append(f"{joint.column} = {values_text(q / size, of_joint)}")
    words = {1: "Another load", 2: "Two loads"}.get(len(new), f"{len(new)} loads")
    at = f" at {'; '.join(where)}" if where else ""
    yield f"{words}, {values_text(new / factor, unit)},{at}.".replace(",.", ".")


def _positions(o: Observations, rows: Rows, j: int, travel: Array) -> Iterator[str]:
    name, old, new = o.machine.joints[j].column, np.asarray(o.q[:, j]), rows.q[:, j]
    span = max(float(np.ptp(travel[j])), float(np.ptp(old)))
    if span <= 0:
        return
    unit, factor = o.unit_of(name)
    if np.ptp(old) == 0:
        off = new[np.abs(new - old[0]) > 1e-9 * span]
        if len(off):
            yield f"Move {name}, which never moved: to {values_text(off / factor, unit)}."
        return
    out = new[(new < old.min() - BEYOND * span) | (new > old.max() + BEYOND * span)]
    if len(out):
        beyond = values_text(out / factor, unit)
        yield f"Go beyond the {range_text(o, j, old)} of {name} that were measured: to {beyond}."
        return
    places = np.unique(old)
    if len(places) <= FEW:
        off = new[np.min(np.abs(new[:, None] - places), axis=1) > BETWEEN * span]
        if len(off):
            yield (
                f"Measure at further positions of {name} than {values_text(places / factor, unit)}: "
                f"{values_text(off / factor, unit)}."
            )


def _order(o: Observations, rows: Rows) -> Iterator[str]:
    """Say where a joint went with time, and does not now."""
    clock = np.asarray(o.t if o.t is not None else np.arange(o.n), float)
    if np.ptp(clock) == 0:
        return
    for j, joint in enumerate(o.machine.joints):
        old, new = np.asarray(o.q[:, j]), rows.q[:, j]
        if np.ptp(old) == 0 or np.ptp(new) == 0:
            continue
        r = float(np.corrcoef(clock, old)[0, 1])
        if abs(r) > IN_STEP:
            way = "up" if r > 0 else "down"
            back = float(np.sum(np.diff(new) * np.sign(r) < 0))
            how = "scan back" if back else "measure again"
            yield f"{joint.name} only went {way} while time went on: {how}, so that the two come apart."


def _speeds(o: Observations, rows: Rows, choice: Levels) -> Iterator[str]:
    for j in choice.speeds:
        name = o.machine.joints[j].column
        if f"v_{name}" in o.data.columns and np.ptp(rows.v[:, j]) > 0:
            unit, factor = o.unit_of(f"v_{name}")
            yield f"Read {name} in motion at {values_text(np.abs(rows.v[:, j]) / factor, unit)}, both ways."


def _temperatures(o: Observations, rows: Rows, choice: Levels) -> Iterator[str]:
    if len(choice.states) < 2:
        return
    for name, values in o.temperature.items():
        if np.ptp(values) > 0:
            column = o.data.columns[f"T_{o.machine.joint(name).column}"]
            met = [float(np.asarray(column.values)[k]) for k in np.unique(rows.state)]
            yield (
                f"Take some rows when {name} is at about {joined([number(round(x, 1)) for x in met])} {column.unit}: "
                f"temperatures cannot be commanded, so wait until they are met, and write down what they are."
            )
