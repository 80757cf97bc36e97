"""Readings that may be taken: as observations for a model, in the order in which they are taken, and as a table."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints
from rodgen.calibration.problem.assembly_modes import with_commands
from rodgen.data.poses import approach
from rodgen.data.units import parse_unit

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.observations import Observations

WRONG = 100.0
"""What a wrong direction of approach counts, in ways through the whole travel."""
SHORTER = 1e-9
"""Part of the whole travel that is rounding."""
DIGITS = 9
TO_BE_SET, TO_BE_MET = 4, 2
"""Digits of the range of a column that people read, as of positions, and of temperatures, which can hardly be set."""


@dataclass(frozen=True)
class Rows:
    """Readings that may be taken, in internal units."""

    q: Array
    """Shape (n, J)."""
    s: NDArray[np.int8]
    """Direction of approach, (n, J)."""
    target: Ints
    """Shape (n,)."""
    load: Array
    """Zero where the data have no such column, (n,)."""
    state: Ints
    """The row of the data in which speeds, temperatures and further columns were as they are to be now, (n,)."""

    @property
    def n(self) -> int:
        """Number of readings."""
        return len(self.q)

    def take(self, index: Any) -> Rows:
        """Return some of them."""
        return Rows(*(getattr(self, field.name)[index] for field in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Return readings one after the other."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def as_moved(self, start: Array) -> Rows:
        """Return them with the directions of approach that their order makes from a start on."""
        s = np.stack([approach(column)[1:] for column in np.concatenate([start[None], self.q]).T], axis=1)
        return replace(self, s=np.where(s == 0, self.s, s).astype(np.int8))


class Surroundings:
    """Makes observations of commanded readings: adds times, speeds, temperatures and uncertainties.

    Parameters
    ----------
    observations : Observations
        What was measured.
    """

    def __init__(self, observations: Observations) -> None:
        self.o = o = observations
        self.sigma = None if o.sigma is None else np.median(o.sigma, axis=0)
        self.step = self.begin = 0.0
        if o.t is not None:
            starts = np.unique(o.t[np.diff(o.pose, prepend=o.pose[0] - 1) != 0])  # of the poses
            self.step = float(np.median(np.diff(starts))) if len(starts) > 1 else 0.0
            self.begin = float(o.t.max()) + self.step

    def times(self, rows: Rows) -> Array | None:
        """Return when each is taken, one pose after the other.

        Until temperatures are others the time passes that it took in the data.
        """
        if self.o.t is None:
            return None
        steps = self.step * np.any(np.diff(rows.q, axis=0, prepend=rows.q[:1]) != 0, axis=1)
        waited = np.abs(np.diff(self.o.t[rows.state], prepend=self.o.t.max()))
        return np.asarray(self.begin + np.cumsum(steps + waited))

    def observations(self, rows: Rows, *, at_once: bool = False) -> Observations:
        """Return the rows as observations without readings: one pose after the other, or all soon after the data."""
        o, n = self.o, rows.n
        times = self.times(rows)
        if times is not None and at_once:
            times = np.full(n, self.begin + 6 * self.step)
        commanded = replace(
            o.take(rows.state),
            q=rows.q,
            s=rows.s,
            v=np.abs(o.v[rows.state]) * rows.s,
            t=times,
            load=None if o.load is None else rows.load,
            target=rows.target.astype(np.int32),
            run=np.full(n, o.run[-1], np.int32),
            pose=np.arange(n, dtype=np.int32),
            sigma=None if self.sigma is None else np.repeat(self.sigma[None], n, axis=0),
            reading=np.ones((n, o.reading.shape[1])),
        )
        return with_commands(commanded, o)


# the order -------------------------------------------------------------------------------------------------------


def ordered(rows: Rows, sides: Sequence[int], span: Array, start: Array) -> Rows:
    """Return readings in an order with a short way in which a joint comes from the sides that were planned.

    What cannot be changed in passing comes first: the temperature, the load. Where the sides cannot be had for all,
    `Rows.as_moved` says what the order makes of them.

    Parameters
    ----------
    sides : sequence of int
        Joints whose direction of approach counts: that of the first reading, too, on the way from the start.
    span : ndarray, shape (J,)
        Travel of each joint.
    start : ndarray, shape (J,)
        Where the machine stands.
    """
    scale = np.where(span > 0, span, 1.0)
    block = np.stack([rows.state, rows.load], axis=1)
    order: list[int] = []
    for kind in np.unique(block, axis=0)[::-1]:  # the temperature of the last rows is met first
        inside = np.flatnonzero(np.all(block == kind, axis=1))
        some = rows.take(inside)
        key = np.concatenate([some.q, some.s[:, sides]], axis=1)
        _, first, pose = np.unique(key, axis=0, return_index=True, return_inverse=True)
        rank = np.argsort(_poses(some.q[first] / scale, some.s[first], sides, start / scale))
        order += inside[np.lexsort((some.target, rank[pose.ravel()]))].tolist()
        start = rows.q[order[-1]]
    return rows.take(np.array(order))


def _poses(q: Array, s: NDArray[np.int8], sides: Sequence[int], start: Array) -> Ints:
    """Return the order of poses: to the nearest each time, or up and down a joint whose side counts; then shortened.

    Joints move together: a way takes as long as its longest part.
    """
    at = np.concatenate([start[None], q])
    moved = np.sign(at[:, sides] - at[:, None, sides])
    came = np.concatenate([np.zeros_like(s[:1]), s])[:, sides]
    sides_reached = np.where(
        moved != 0, moved, came[:, None]
    )  # a joint that rests keeps the side from which it came
    wrong = (sides_reached != 0) & (sides_reached != came)
    costs = np.abs(at - at[:, None]).max(axis=2, initial=0.0) + WRONG * wrong.sum(axis=2)
    free, nearest = np.where(np.arange(len(at)), 0.0, np.inf), [0]
    while len(nearest) < len(at):
        nearest.append(int(np.argmin(costs[nearest[-1]] + free)))
        free[nearest[-1]] = np.inf
    orders = [np.array(nearest)]
    for j in sides:
        for side in (1, -1):
            orders.append(np.append(0, 1 + np.lexsort((s[:, j] * q[:, j], s[:, j] != side))))

    def cost(order: Ints) -> float:  # a joint that rests carries a wrong side on, which `costs` does not know
        way, wanted = at[order], came[order[1:]].T
        side = np.reshape([approach(column)[1:] for column in way[:, sides].T], wanted.shape)
        wrong = np.count_nonzero((side != 0) & (side != wanted))
        return float(np.abs(np.diff(way, axis=0)).max(axis=1, initial=0.0).sum()) + WRONG * wrong

    first = min(orders, key=cost)
    return min(_shortened(first, costs), first, key=cost)[1:] - 1


def _shortened(order: Ints, costs: Array) -> Ints:
    """Return a way in which to turn no stretch round is cheaper (2-opt: Croes 1958); its first place stays."""
    open_end = np.pad(costs, ((0, 1), (0, 1)))
    i, j = np.triu_indices(len(order) - 1, 1)
    while len(i):
        way = np.append(order, len(order))
        forth = np.append(0.0, np.cumsum(open_end[way[:-1], way[1:]]))
        back = np.append(0.0, np.cumsum(open_end[way[1:], way[:-1]]))
        before, first, last, after = way[i], way[i + 1], way[j + 1], way[j + 2]
        turned = open_end[before, last] + back[j + 1] - back[i + 1] + open_end[first, after]
        gain = forth[j + 2] - forth[i] - turned
        best = int(np.argmax(gain))
        if gain[best] < SHORTER:
            break
        stretch = slice(i[best] + 1, j[best] + 2)
        order = np.concatenate([order[: stretch.start], order[stretch][::-1], order[stretch.stop :]])
    return order


# the table -------------------------------------------------------------------------------------------------------


def table(machine: Machine, surroundings: Surroundings, rows: Rows) -> dict[str, list[Any]]:
    """Return columns by their names with units, in the order of the data's, without readings; rows are in order."""
    o = surroundings.o
    columns = o.data.columns
    names = [joint.column for joint in machine.joints]
    follow = {joint.name for joint in machine.joints if joint.coordinate} - {
        joint.name for joint in machine.joints if joint.reading == joint.name
    }
    readings = machine.measurand.read_columns
    targets = [target.name for target in machine.targets]
    columns_of_table: dict[str, list[Any]] = {}

    def numbers(values: Any, unit: str | None) -> list[float]:
        factor = parse_unit(unit).factor(machine.length_unit) if unit else 1.0
        return [float(f"{x:.{DIGITS}g}") + 0.0 for x in np.asarray(values, float) / factor]

    for name, column in columns.items():
        prefix, _, rest = name.partition("_")
        if name in readings or name in follow:
            continue
        if name in names:
            columns_of_table[column.text] = numbers(rows.q[:, names.index(name)], column.unit)
        elif name == "target":
            columns_of_table[column.text] = [targets[k] for k in rows.target]
        elif name == "run":
            columns_of_table[column.text] = [str(o.run_names[o.run[-1]])] * rows.n
        elif name == "t":
            columns_of_table[column.text] = numbers(surroundings.times(rows), column.unit)
        elif name == "load":
            columns_of_table[column.text] = numbers(rows.load, column.unit)
        elif prefix == "dir" and rest in names:
            columns_of_table[column.text] = [int(x) or 1 for x in rows.s[:, names.index(rest)]]
        elif prefix == "v" and rest in names:
            columns_of_table[column.text] = numbers(
                surroundings.observations(rows).v[:, names.index(rest)], column.unit
            )
        elif prefix == "u" and rest in readings:
            columns_of_table[column.text] = [float(np.median(np.asarray(column.values)))] * rows.n
        elif not hasattr(column, "codes"):  # temperatures and covariates, as they were
            values = np.asarray(column.values)
            columns_of_table[column.text] = np.round(
                values[rows.state], _decimals(values, TO_BE_MET)
            ).tolist()
    if "target" not in columns and len(targets) > 1:
        columns_of_table["target"] = [targets[k] for k in rows.target]
    return columns_of_table


def as_csv(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return a table as the text of a CSV file."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(map(_cell, values) for values in columns.values()), strict=True))
    return stream.getvalue()


def for_people(columns: Mapping[str, Sequence[Any]]) -> dict[str, list[str]]:
    """Return a table as texts for people, a list of cells for each column."""
    return {name: [_cell(value) for value in _for_people(values)] for name, values in columns.items()}


def _decimals(values: Any, digits: int) -> int:
    """Return the decimals that tell so many digits of the range of values, or of themselves where all are alike."""
    size = float(np.ptp(values)) or float(np.abs(values).max(initial=0.0))
    return digits - 1 - math.floor(math.log10(size)) if size > 0 else 0


def _for_people(values: Sequence[Any]) -> Sequence[Any]:
    if not all(isinstance(value, float) for value in values):
        return values
    return [float(x) + 0.0 for x in np.round(values, _decimals(values, TO_BE_SET))]


def _cell(value: Any) -> str:
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
