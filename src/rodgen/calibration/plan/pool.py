"""All readings that are considered: positions within the travel, from both sides, of every target, with every load.

What the constraints of a plan forbid is not among them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.plan.rows import Rows, Surroundings
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.assembly_modes import attainable
from rodgen.errors import InputFileError, joined
from rodgen.statistics.decompositions import svd

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan.constraints import Constraints
    from rodgen.machines.observations import Observations


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
FINER = (8, 64)
"""By what factors more positions are looked at where constraints leave few of them."""
ENOUGH_READINGS = 200
"""Readings to choose from that are enough."""
SMALL = 0.1
"""Where readings cover less than this part of what positions within the range of those measured make of them, the
instrument reads small deviations only, and only positions that keep to these are considered."""
FEWEST_STARTS = 40
"""From how many positions at least one is sought that brings the target to a place."""
STEP = 1e-6
"""Of the derivative of places, as a part of a joint's travel."""
ROUNDS = 15
"""Newton's steps at most."""
REACHED = 1e-6
"""Distance from a place that counts as none, as a part of the distance of the places that are reached at all."""
SAME = 1e-4
"""Positions nearer to each other than this part of the travel are one."""


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
        targets=len(o.machine.targets),
    )


class Pool:
    """The readings of a machine that are considered.

    Parameters
    ----------
    fit : Fit
        Says where the target is.
    travel : ndarray, shape (J, 2)
        Within the limits.
    choice : Levels
    surroundings : Surroundings
        Of the data.
    constraints : Constraints

    Attributes
    ----------
    out_of_reach : list of int
        Numbers, from 1, of given places that no target reaches.
    """

    def __init__(
        self,
        fit: Fit,
        travel: Array,
        choice: Levels,
        surroundings: Surroundings,
        constraints: Constraints,
    ) -> None:
        self.fit, self.travel, self.choice = fit, travel, choice
        self.surroundings, self.constraints = surroundings, constraints
        self.o, self.machine = surroundings.o, fit.machine
        self.out_of_reach: list[int] = []

    def readings(self) -> Rows:
        """Return the readings that can be taken.

        Raises
        ------
        InputFileError
            When the constraints leave none; it names the first that no reading meets together with those before.
        """
        constraints = self.constraints
        if constraints.poses is not None:
            pool = self._listed(constraints.poses)
        elif constraints.places is not None:
            pool = self._at_places(constraints.places)
        else:
            pool = self._within_reach()
        if not constraints.regions and not constraints.boxes:
            return pool
        found, reason = self._allowed(pool)
        for finer in FINER if constraints.poses is None and constraints.places is None else ():
            if found.n >= ENOUGH_READINGS:
                break
            found, reason = self._allowed(self._every(finer=finer))
        if not found.n:
            within = "the list of poses" if constraints.poses is not None else "the travel and the limits"
            expected = "constraints that some reading meets"
            raise InputFileError(constraints.file, reason, f"no reading within {within} meets it", expected)
        some = np.random.default_rng(0).permutation(found.n)[:READINGS]
        return found.take(np.sort(some))

    def _allowed(self, pool: Rows) -> tuple[Rows, str]:
        """Return readings within regions and outside boxes; where there are none, which condition none meets."""
        reason = ""
        met = np.ones(pool.n, bool)
        before: list[str] = []
        for text, mask in self.constraints.allowed(self.machine, pool.q, self._places(pool)):
            before.append(text)
            if not mask.any():
                reason = text
            elif met.any() and not (met & mask).any():
                reason = joined(before)
            met &= mask
        return pool.take(met), reason

    def _listed(self, poses: Observations) -> Rows:
        """Return readings in listed poses that are within the travel, as far as the columns of the list go."""
        low, high = self.travel.T
        q = poses.q[np.all((poses.q >= low) & (poses.q <= high), axis=1)]
        none = InputFileError(
            poses.data.file, "file", "no pose within the travel and the limits", "one at least"
        )
        if not len(q):
            raise none
        pool = self._every(among=q)
        given = poses.columns_given
        sides = [j for j, joint in enumerate(poses.machine.joints) if f"dir_{joint.column}" in given]

        def kinds(rows: Rows | Observations) -> list[tuple[float, ...]]:
            columns: list[NDArray[Any]] = [rows.q, rows.s[:, sides]]
            columns += [np.asarray(getattr(rows, name)) for name in ("target", "load") if name in given]
            return [tuple(kind) for kind in np.column_stack(columns).astype(float).tolist()]

        wanted = set(kinds(poses))
        pool = pool.take(np.array([kind in wanted for kind in kinds(pool)], bool))
        if not pool.n:
            raise none
        return pool

    def _at_places(self, places: Array) -> Rows:
        """Return readings whose target is brought to one of some places, by small moves from readings elsewhere."""
        random = np.random.default_rng(0)
        starts = self._every()
        starts = starts.take(random.permutation(starts.n)[: max(READINGS // len(places), FEWEST_STARTS)])
        found = [self._brought_to(starts, place) for place in places]
        pool = Rows.joined(found)
        pool = replace(pool, q=self.machine.followed(pool.q))
        self.out_of_reach = [k for k, rows in enumerate(found, 1) if not rows.n]
        if not pool.n:
            expected = "a ball that some target reaches within the travel and the limits"
            raise InputFileError(self.constraints.file, "[artefact], balls", "out of reach", expected)
        return pool

    def _brought_to(self, starts: Rows, place: Array) -> Rows:
        """Return readings whose target is at a place, by Newton's method: the shortest way in each step."""
        span = np.ptp(self.travel, axis=1)
        rows = starts
        for _ in range(ROUNDS):
            at = self._places(rows)
            jacobian = np.zeros((rows.n, 3, len(span)))
            for j in np.flatnonzero(span):
                q = rows.q.copy()
                q[:, j] += STEP * span[j]
                jacobian[:, :, j] = (self._places(replace(rows, q=q)) - at) / STEP
            u, s, vt = svd(jacobian)
            inverse = np.divide(1.0, s, out=np.zeros_like(s), where=s > 1e-6 * s[:, :1])
            step = np.einsum("nij,ni,nki,nk->nj", vt, inverse, u, place - at) * span
            rows = replace(rows, q=np.clip(rows.q + step, self.travel[:, 0], self.travel[:, 1]))
        at = self._places(rows)
        size = max(float(np.abs(at).max(initial=0.0)), float(np.abs(place).max()))
        with np.errstate(invalid="ignore"):
            rows = rows.take(np.linalg.norm(at - place, axis=1) < REACHED * size)
        near = np.round(rows.q / np.where(span > 0, span, 1.0) / SAME)
        kind = np.column_stack([near, rows.s, np.sign(rows.v), rows.target, rows.load, rows.state])
        _, first = np.unique(kind, axis=0, return_index=True)
        return rows.take(np.sort(first))

    def _within_reach(self) -> Rows:
        """Return readings without those beyond an instrument for deviations only: a probe on a ball, a ball bar."""
        pool = self._every()
        if not self.machine.measurand.moving:
            return pool
        low, high = self.o.reading.min(axis=0), self.o.reading.max(axis=0)
        measured = np.stack([self.o.q.min(axis=0), self.o.q.max(axis=0)], axis=1)
        near = self._every(measured)
        usual = np.linalg.norm(np.nanstd(self._predicted(near), axis=0)) if near.n > 1 else 0.0
        if not np.linalg.norm(high - low) < SMALL * usual:
            return pool
        room = 0.5 * (high - low)
        pool = self._every(among=self.o.q)
        predicted = self._predicted(pool)
        inside = np.all((predicted > low - room) & (predicted < high + room), axis=1)
        return pool.take(inside) if inside.sum() > 1 else pool

    def _places(self, pool: Rows) -> Array:
        """Return where the target is, or the direction, in machine axes, (n, 3)."""
        return self.fit.places(self.surroundings.observations(pool, at_once=True))

    def _predicted(self, pool: Rows) -> Array:
        """Return what the model predicts for readings, (n, m)."""
        problem = Problem(self.fit.problem.model, self.surroundings.observations(pool, at_once=True))
        return problem.predicted(self.fit.solution.theta, self.fit.solution.frame)

    def _every(self, travel: Array | None = None, *, among: Array | None = None, finer: int = 1) -> Rows:
        """Return all readings, whatever the constraints forbid.

        Parameters
        ----------
        travel : ndarray, shape (J, 2), optional
            Another one than that of the plan.
        among : ndarray, shape (n, J), optional
            The only positions; left out: any within the travel.
        finer : int
            Factor of the number of positions, of which many will be left out.
        """
        machine, o, choice = self.machine, self.o, self.choice
        travel = self.travel if travel is None else travel
        count = max(FEWEST_POSITIONS, READINGS // min(choice.variants, VARIANTS)) * finer
        taken = np.asarray(o.q)
        if among is not None:
            q = np.unique(among, axis=0)
            q = q[np.linspace(0, len(q) - 1, min(len(q), count)).astype(int)]
        else:
            units = np.array([o.unit_of(joint.column)[1] for joint in machine.joints])
            still = [not joint.is_read for joint in machine.joints]
            within = np.where(np.array(still)[:, None], np.median(taken, axis=0)[:, None], travel)
            q = machine.followed(positions(within, units, count, taken))
            q = q[machine.within_travel(q)]
        if machine.kinematics.is_closed:
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
        n = len(pick)
        s, v = np.repeat(usual[None], n, axis=0), np.repeat(np.median(np.abs(o.v), axis=0)[None], n, axis=0)
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
