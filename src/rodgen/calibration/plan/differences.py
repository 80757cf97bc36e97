"""Sentences on what planned measurements have that those taken do not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.plan.words import joint_unit, number, range_text
from rodgen.data.units import parse_unit
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.campaign import Campaign
    from rodgen.calibration.plan.pool import Levels
    from rodgen.calibration.plan.rows import Rows
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine

__all__ = ["differences"]

Array: TypeAlias = NDArray[np.float64]

BEYOND = 0.05
"""Part of the travel by which positions lie beyond those measured, to be called new."""
BETWEEN = 0.1
"""Part of the travel by which positions lie off the few that were measured."""
FEW = 4
"""Positions of a joint that are counted as single ones."""
IN_STEP = 0.9
"""Correlation of a joint with time from which on one hides the other."""
NAMED = 5


def _values(values: Array, unit: str) -> str:
    texts = list(dict.fromkeys(number(x) for x in np.unique(values)))
    if len(texts) > NAMED:
        texts = [texts[0], "…", texts[-1]]
        return f"{', '.join(texts)} {unit}"
    return f"{joined(texts)} {unit}"


def differences(campaign: Campaign, rows: Rows) -> Iterator[str]:
    """Yield sentences on how planned readings differ from the data, the most important first; at least one.

    Parameters
    ----------
    campaign : Campaign
    rows : Rows
        In order.
    """
    found = list(_differences(campaign, rows))
    yield from found or [_same_kind(campaign, rows)]


def _same_kind(campaign: Campaign, rows: Rows) -> str:
    where = [
        f"{joint.name} {range_text(campaign.o, j, rows.q[:, j])}"
        for j, joint in enumerate(campaign.o.machine.joints)
        if np.ptp(campaign.travel[j]) > 0
    ]
    return f"Readings as before, where they tell most: {joined(where)}."


def _differences(campaign: Campaign, rows: Rows) -> Iterator[str]:
    machine, o, choice, wait = campaign.machine, campaign.o, campaign.choice, campaign.wait
    yield from _targets(machine, o, rows)
    yield from _sides(o, rows, choice)
    yield from _loads(o, rows, campaign.asks_load)
    for j in range(rows.q.shape[1]):
        yield from _positions(o, rows, j, campaign.travel)
    if campaign.asks_time:
        yield from _order(o, rows)
    yield from _speeds(o, rows, choice)
    yield from _temperatures(o, rows, choice)
    if wait > 0 and o.t is not None:
        column = o.data.columns["t"]
        end = (float(o.t.max()) + wait * float(np.ptp(o.t))) / parse_unit(column.unit or "s").factor()
        yield (
            f"Measure later, from t = {end:.3g} {column.unit} on: what moves with time has then moved further, or has "
            f"come to rest."
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
    carrier = next((j for j in reversed(machine.joints) if j.type == "revolute"), None)
    for k in fresh:
        new, place = machine.targets[k], ""
        if carrier is not None:
            axis, foot = np.array(carrier.axis), np.array(carrier.point)

            def radius(t: int, axis: Array = axis, foot: Array = foot) -> float:
                return float(np.linalg.norm(np.cross(np.array(machine.targets[t].point) - foot, axis)))

            def height(t: int, axis: Array = axis, foot: Array = foot) -> float:
                return float((np.array(machine.targets[t].point) - foot) @ axis)

            unit = machine.length_unit
            radii = [radius(t) for t in measured]
            if min(abs(radius(k) - r) for r in radii) > 0.1 * max(*radii, radius(k), 1e-300):
                before = joined(list(dict.fromkeys(number(round(r, 6)) for r in sorted(radii))))
                place = f" at a second radius about {carrier.name}, {radius(k):.4g} {unit} ({before} {unit} before)"
            elif min(abs(height(k) - height(t)) for t in measured) > 0.1 * max(*radii, 1e-300):
                place = f" at another height, {height(k):.4g} {unit} along {carrier.name}"
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
    column = o.data.columns["load"]
    factor = parse_unit(column.unit or "N").factor(o.machine.length_unit)
    new = np.unique(rows.load)
    fresh = [x for x in new if not np.any(np.isclose(x, o.load))]
    if len(new) < 2 and not fresh:
        return
    where = []
    for j in range(rows.q.shape[1]):
        if np.ptp(rows.q[:, j]) > 0:
            unit, f = joint_unit(o, j)
            where.append(f"{o.machine.joints[j].name} = {_values(rows.q[:, j] / f, unit)}")
    words = {1: "Another load", 2: "Two loads"}.get(len(new), f"{len(new)} loads")
    at = f" at {'; '.join(where)}" if where else ""
    yield f"{words}, {_values(new / factor, column.unit or 'N')},{at}.".replace(",.", ".")


def _positions(o: Observations, rows: Rows, j: int, travel: Array) -> Iterator[str]:
    name, old, new = o.machine.joints[j].name, np.asarray(o.q[:, j]), rows.q[:, j]
    span = max(float(np.ptp(travel[j])), float(np.ptp(old)))
    if span <= 0:
        return
    unit, factor = joint_unit(o, j)
    if np.ptp(old) == 0:
        off = new[np.abs(new - old[0]) > 1e-9 * span]
        if len(off):
            yield f"Move {name}, which never moved: to {_values(off / factor, unit)}."
        return
    out = new[(new < old.min() - BEYOND * span) | (new > old.max() + BEYOND * span)]
    if len(out):
        yield f"Go beyond the {range_text(o, j, old)} of {name} that were measured: to {_values(out / factor, unit)}."
        return
    places = np.unique(old)
    if len(places) <= FEW:
        off = new[np.min(np.abs(new[:, None] - places), axis=1) > BETWEEN * span]
        if len(off):
            yield (
                f"Measure at further positions of {name} than {_values(places / factor, unit)}: "
                f"{_values(off / factor, unit)}."
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
        column = o.data.columns.get(f"v_{o.machine.joints[j].name}")
        if column is not None and np.ptp(rows.v[:, j]) > 0:
            unit = str(column.unit)
            factor = parse_unit(unit).factor(o.machine.length_unit)
            speeds = _values(np.abs(rows.v[:, j]) / factor, unit)
            yield f"Read {o.machine.joints[j].name} in motion at {speeds}, both ways."


def _temperatures(o: Observations, rows: Rows, choice: Levels) -> Iterator[str]:
    if len(choice.states) < 2:
        return
    for name, values in o.temperature.items():
        if np.ptp(values) > 0:
            column = o.data.columns[f"T_{name}"]
            met = [float(np.asarray(column.values)[k]) for k in np.unique(rows.state)]
            yield (
                f"Take some rows when {name} is at about {joined([number(round(x, 1)) for x in met])} {column.unit}: "
                f"temperatures cannot be commanded, so wait until they are met, and write down what they are."
            )
