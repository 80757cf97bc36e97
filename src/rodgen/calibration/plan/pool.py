"""All readings that are considered: positions within the travel, from both sides, of every target, with every load."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.plan.rows import Rows
from rodgen.calibration.problem.assembly_modes import attainable

if TYPE_CHECKING:
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine


READINGS = 2400
"""Readings that are considered at most."""
FEWEST_POSITIONS = 80
LEVELS = 13
"""Places along each joint while the others stand in the middle."""
CORNERS = 6
"""Joints of which every combination of ends is considered."""
VARIANTS = 16
"""Readings that are considered at each position, at most."""
STEPS, FEW_STEPS = 200, 30
"""Positions are rounded to a round number, such that the travel has at least this many: FEW_STEPS where three joints or
more can move. Finer ones would only be the same reading again and again."""


def rounding(low: float, high: float, unit: float, steps: int) -> float:
    """Return the step that positions are rounded to, internal units: 1, 2 or 5 times a power of ten of the unit."""
    span = (high - low) / unit
    if span <= 0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(span / steps))
    step = max(k * power for k in (1, 2, 5) if k * power <= span / steps * (1 + 1e-9))
    return float(step * unit)


def positions(travel: Array, units: Array, count: int, taken: Array) -> Array:
    """Return positions within the travel, (n, J): scans of each joint, corners, some that were measured, and others.

    Parameters
    ----------
    travel : ndarray, shape (J, 2)
    units : ndarray, shape (J,)
        Internal value of the unit that each joint is commanded in.
    count : int
        At least.
    taken : ndarray, shape (n, J)
        What was measured.
    """
    from scipy.stats import qmc  # takes half a second to import

    low, high = travel.T
    joints = len(travel)
    middle = np.clip(np.median(taken, axis=0), low, high)
    found = [middle[None]]
    for j in range(joints):
        scan = np.repeat(middle[None], LEVELS, axis=0)
        scan[:, j] = np.linspace(low[j], high[j], LEVELS)
        found.append(scan)
    moving = np.flatnonzero(high > low)
    if 0 < len(moving) <= CORNERS:
        corners = np.repeat(middle[None], 2 ** len(moving), axis=0)
        corners[:, moving] = list(itertools.product(*(travel[j] for j in moving)))
        found.append(corners)
    if len(moving) == 2:
        grid = np.repeat(middle[None], 49, axis=0)
        grid[:, moving] = list(itertools.product(*(np.linspace(low[j], high[j], 7) for j in moving)))
        found.append(grid)
    found.append(
        np.clip(taken[np.linspace(0, len(taken) - 1, min(len(taken), count // 4)).astype(int)], low, high)
    )
    rest = max(count - sum(map(len, found)), count // 4)
    evenly = qmc.Halton(joints, scramble=False)
    evenly.fast_forward(1)
    found.append(low + evenly.random(rest) * (high - low))
    every = np.concatenate(found)
    steps = STEPS if len(moving) < 3 else FEW_STEPS
    step = np.array([rounding(low[j], high[j], units[j], steps) for j in range(joints)])
    with np.errstate(divide="ignore", invalid="ignore"):
        rounded = np.where(step > 0, np.round(every / step) * step, every)
        first, last = np.ceil(low / step - 1e-9) * step, np.floor(high / step + 1e-9) * step
    rounded = np.where(step > 0, np.clip(rounded, first, last), rounded)
    rounded = np.where(np.isclose(rounded, 0.0, atol=1e-9 * np.maximum(step, 1e-300)), 0.0, rounded)
    return np.unique(rounded, axis=0)


@dataclass(frozen=True)
class Levels:
    """What else may be chosen."""

    sides: tuple[int, ...]
    """Joints that are considered from both sides."""
    speeds: dict[int, tuple[float, ...]]
    """Speeds of a joint, without sign."""
    loads: tuple[float, ...]
    states: tuple[int, ...]
    """Rows of the data whose temperatures are to be met again."""
    targets: int

    @property
    def variants(self) -> int:
        """How many readings there may be at a position."""
        speeds = int(np.prod([len(x) for x in self.speeds.values()], dtype=int))
        return int(2 ** len(self.sides) * speeds * len(self.loads) * len(self.states) * self.targets)


def levels(
    o: Observations,
    targets: int,
    *,
    sides: list[int],
    speeds: list[int],
    temperatures: list[int],
    load: bool,
) -> Levels:
    """Return what may be chosen in addition to positions.

    Parameters
    ----------
    o : Observations
        The data: loads, speeds and temperatures lie within theirs.
    sides, speeds, temperatures : list of int
        Joints of which the effects in question ask for the direction, the speed, the temperature.
    load : bool
        Whether they ask for the load.
    """
    last = o.n - 1
    extremes: set[int] = set()
    for j in temperatures:
        values = o.temperature.get(o.machine.joints[j].name)
        if values is not None and np.ptp(values) > 0:
            extremes |= {int(np.argmin(values)), int(np.argmax(values))}
    states = extremes or {last}
    loads: tuple[float, ...] = (0.0,) if o.load is None else (float(o.load[last]),)
    if o.load is not None and load:
        loads = tuple(sorted({0.0, float(o.load.min()), float(o.load.max())}))
    fastest = {j: float(np.max(np.abs(o.v[:, j]))) for j in speeds}
    return Levels(
        sides=tuple(sorted({*sides, *speeds}))[:3],
        speeds={j: (v / 3, v) if v > 0 else (0.0,) for j, v in fastest.items()},
        loads=loads,
        states=tuple(sorted(states)),
        targets=targets,
    )


def readings(
    machine: Machine,
    o: Observations,
    travel: Array,
    units: Array,
    choice: Levels,
    *,
    among: Array | None = None,
    finer: int = 1,
) -> Rows:
    """Return all readings that are considered.

    Parameters
    ----------
    o : Observations
        The data.
    travel : ndarray, shape (J, 2)
    units : ndarray, shape (J,)
        Internal value of the unit that each joint is commanded in.
    among : ndarray, shape (n, J), optional
        The only positions; left out: any within the travel.
    finer : int
        Factor of the number of positions, of which many will be left out.
    """
    count = max(FEWEST_POSITIONS, READINGS // min(choice.variants, VARIANTS)) * finer
    taken = np.asarray(o.q)
    if among is not None:
        q = np.unique(among, axis=0)
        q = q[np.linspace(0, len(q) - 1, min(len(q), count)).astype(int)]
    else:
        still = [not joint.is_read for joint in machine.joints]
        within = np.where(np.array(still)[:, None], np.median(taken, axis=0)[:, None], travel)
        q = machine.followed(positions(within, units, count, taken))
        q = q[machine.within_travel(q)]
    if o.machine.kinematics.is_closed:
        q = q[attainable(o, q)]
    random = np.random.default_rng(0)
    kinds = list(
        itertools.product(
            itertools.product((-1, 1), repeat=len(choice.sides)),
            itertools.product(*choice.speeds.values()),
            choice.loads,
            choice.states,
            range(choice.targets),
        )
    )
    if len(kinds) * len(q) <= READINGS:
        pick = np.indices((len(q), len(kinds))).reshape(2, -1).T
    else:
        most = max(1, min(VARIANTS, READINGS // len(q)))
        some = [random.choice(len(kinds), min(most, len(kinds)), replace=False) for _ in q]
        pick = np.array([(i, k) for i, row in enumerate(some) for k in row])
    usual = np.array([1 if np.sum(o.s[:, j] < 0) <= o.n / 2 else -1 for j in range(q.shape[1])], np.int8)
    pace = np.median(np.abs(o.v), axis=0)
    n = len(pick)
    s, v = np.repeat(usual[None], n, axis=0), np.repeat(pace[None], n, axis=0)
    load, state, target = np.empty(n), np.empty(n, int), np.empty(n, int)
    for i, (_, k) in enumerate(pick):
        signs, speed, load[i], state[i], target[i] = kinds[k]
        s[i, list(choice.sides)] = signs
        v[i, list(choice.speeds)] = speed
    q = q[pick[:, 0]]
    # at an end of the travel a joint comes from inside, and one that cannot move comes from nowhere
    low, high = travel.T
    inside = ~np.any((s[:, choice.sides] > 0) & (q <= low)[:, choice.sides], axis=1)
    inside &= ~np.any((s[:, choice.sides] < 0) & (q >= high)[:, choice.sides], axis=1)
    still = high <= low
    s[:, still] = o.s[-1, still]
    return Rows(q, s, v * s, target, load, state).take(inside)
