"""Bodies that joints carry one after another, how they yield under their weight, and what is read of the last one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from physics.parts import Array, play, rotation

Title = tuple[str, str | None]
Law = Callable[..., Any]


@dataclass
class Axis:
    """A joint and the body that it carries, of which all axes are machine axes at zero."""

    name: str
    kind: str
    axis: tuple[float, float, float]
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    travel: tuple[float, float] = (-180.0, 180.0)  # deg or mm
    weight: float = 0.0  # N
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of gravity at zero
    text: dict[str, object] = field(default_factory=dict)  # what the file says of its hardware
    seat: Array = None  # how its axis stands in fact (3, 3)
    place: Array = None  # where it stands in fact (3,)
    estimated: bool = False

    @property
    def turns(self) -> bool:
        return self.kind == "revolute"


@dataclass
class Rows:
    """Readings: commands (n, J) in rad and mm, and what else is known of each."""

    q: Array
    target: Array  # numbers of targets (n,)
    pose: Array  # numbers of poses (n,)
    t: Array  # s
    T: Array  # by joint (n, J), K above the reference
    load: Array  # N
    run: Array  # numbers from 0
    side: Array  # directions of approach (n, J)
    v: Array  # (n, J) per s
    approached: bool  # whether every pose is approached from `side`, or straight from the pose before
    columns: dict[str, Array] = field(default_factory=dict)  # further recorded columns by their headers

    def __len__(self) -> int:
        return len(self.q)

    def stands(self, j: int, width: Callable[[Array], Array]) -> Array:
        """Return where joint j stands behind a play of a width that may follow its coordinate."""
        first = np.unique(self.pose, return_index=True)[1]
        q, side = self.q[first, j], self.side[first, j]
        far = 0.05 * max(np.ptp(q), 1e-9)
        if self.approached:
            path = np.stack([q - side * far, q], 1).ravel()
            return (play(path, width(path))[1::2] - q)[self.pose]
        path = np.concatenate([[q[0] - side[0] * far], q])
        return (play(path, width(path))[1:] - q)[self.pose]


@dataclass
class State:
    """What bodies do to joints: moments (n, J, 3) of weights and of a load of 1 N, about and in axes of each joint."""

    moment: Array
    load_moment: Array
    gravity: Array  # in axes of the fixed side of each joint (n, J, 3)


@dataclass(frozen=True)
class Fault:
    """What is wrong, and the names that an expert gives it.

    `law` is a function of rows, state and a size, which is 1 where the fault is as large as such machines have it. It
    returns, by `acts`: of "drive" how far the joint is ahead; of "before", "seat" and "after" by what rotation vector
    and translation the fixed side of the joint, its axis alone, or the body that it carries, is displaced; of "target"
    how far targets are displaced; of "instrument" the readings, which it takes as the last argument.
    """

    titles: tuple[Title, ...]
    acts: str
    law: Law
    joint: int = -1
    values: dict[str, float] = field(
        default_factory=dict
    )  # the catalogue's, at a size of 1, in arcsec, mm, s, K, N
    equal: tuple[Title, ...] = ()
    needs: frozenset[str] = frozenset()
    drivers: frozenset[str] = frozenset()  # outside the catalogue
    where: str | None = None

    @property
    def outside(self) -> bool:
        return not self.titles


@dataclass
class Model:
    """A machine as it is, and as its file describes it."""

    name: str
    axes: list[Axis]
    targets: dict[str, Array]
    kind: str  # point | direction | distance | angle | pose
    frame: str
    noise: float  # mm, or rad
    estimate: list[str]
    faults: list[Fault]
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)
    measured: dict[str, object] = field(default_factory=dict)
    effects: list[tuple[Fault, float]] = field(default_factory=list)  # that the file knows
    layouts: tuple[str, ...] = ("random",)
    allowed: Callable[[Array], Array] | None = None  # which commands (n, J) can be measured
    station: tuple[Array, Array] | None = None  # rotation and place of a free instrument
    true_targets: dict[str, Array] = field(default_factory=dict)
    size: float = 1000.0  # mm

    def _walk(self, x: Array, moved: dict[tuple[int, str], tuple[Array, Array]]) -> list[tuple[Array, ...]]:
        """Return of each joint attitude and origin of its fixed side and of its body, and its place at zero."""
        n = len(x)
        R, o, before = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)), np.zeros(3)
        found = []
        for j, a in enumerate(self.axes):
            place = np.array(a.point, float) if a.place is None else a.place
            seat = np.eye(3) if a.seat is None else a.seat
            if (j, "seat") in moved:
                w, d = moved[j, "seat"]
                seat, place = rotation(w[0]) @ seat, place + d[0]
            o = o + R @ (place - before)
            if (j, "before") in moved:
                w, d = moved[j, "before"]
                o, R = o + (R @ d[..., None])[..., 0], R @ rotation(w)
            fixed, origin = R, o
            R = R @ seat
            along = np.array(a.axis, float) * x[:, j : j + 1]
            if a.turns:
                R = R @ rotation(along)
            else:
                o = o + (R @ along[..., None])[..., 0]
            R = R @ seat.T  # the body was aligned with the machine, its axis was not
            if (j, "after") in moved:
                w, d = moved[j, "after"]
                o, R = o + (R @ d[..., None])[..., 0], R @ rotation(w)
            found.append((fixed, origin, R, o, place))
            before = place
        return found

    def _state(self, walked: list[tuple[Array, ...]]) -> State:
        g = np.array(self.gravity)
        loads = []  # places of weights, and the weights
        for a, (_, _, R, o, place) in zip(self.axes, walked, strict=True):
            loads.append((o + R @ (np.array(a.centre) - place), a.weight))
        middle = np.mean([*self.true_targets.values()], 0)
        held = walked[-1][3] + walked[-1][2] @ (middle - walked[-1][4])
        moments, of_load, down = [], [], []
        for j, (fixed, origin, *_) in enumerate(walked):
            whole = sum(np.cross(at - origin, weight * g) for at, weight in loads[j:])
            back = np.swapaxes(fixed, 1, 2)
            moments.append((back @ whole[..., None])[..., 0])
            of_load.append((back @ np.cross(held - origin, g)[..., None])[..., 0])
            down.append(back @ g)
        return State(np.stack(moments, 1), np.stack(of_load, 1), np.stack(down, 1))

    def read(self, rows: Rows, faults: list[tuple[Fault, float]]) -> Array:
        """Return readings without noise: points, directions, distances, angles, or points and matrices."""
        there = [*self.effects, *faults]
        state = self._state(self._walk(rows.q, {}))
        for _ in range(2):  # moments change as weights sink, a little
            x, moved = rows.q.copy(), dict[tuple[int, str], tuple[Array, Array]]()
            for fault, size in there:
                if fault.acts == "drive":
                    x[:, fault.joint] += fault.law(rows, state, size)
                elif fault.acts not in ("instrument", "target"):
                    w, d = (np.broadcast_to(part, (len(rows), 3)) for part in fault.law(rows, state, size))
                    w0, d0 = moved.get((fault.joint, fault.acts), (0.0, 0.0))
                    moved[fault.joint, fault.acts] = w0 + w, d0 + d
            walked = self._walk(x, moved)
            state = self._state(walked)
        R, o, place = walked[-1][2:]
        places = np.array([*self.true_targets.values()])[rows.target]
        for fault, size in there:
            if fault.acts == "target":
                places = places + fault.law(rows, state, size)
        if self.kind == "direction":
            read = (R @ places[..., None])[..., 0]
        elif self.kind == "angle":
            n = np.array(self.measured["about"])
            across = np.cross(n, np.roll(n, 1))
            turned = R @ across
            read = np.arctan2(turned @ np.cross(n, across), turned @ across)[:, None]
        else:
            read = o + (R @ (places - place)[..., None])[..., 0]
            if self.station is not None:
                turn, origin = self.station
                read, R = (read - origin) @ turn, turn.T @ R
        for fault, size in there:
            if fault.acts == "instrument":
                read = fault.law(rows, state, size, read)
        if self.kind == "distance":
            read = np.linalg.norm(read - np.array(self.measured["from"]), axis=1)[:, None]
        if self.kind == "pose":
            return np.concatenate([read, R.reshape(-1, 9)], 1)
        return read
