"""All readings that are considered: positions within the travel, from both sides, of every target, with every load.

What the constraints of a plan forbid is not among them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.calibration.fitted import Fit
from rodgen.calibration.plan.constraints import Constraints, is_altitude
from rodgen.calibration.plan.goals import Goal
from rodgen.calibration.plan.rows import Rows, Surroundings, ordered
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.assembly_modes import attainable
from rodgen.errors import InputFileError, joined
from rodgen.machines.machine import Effect
from rodgen.machines.mounts import ALTAZ, mount_of
from rodgen.machines.observations import Observations
from rodgen.statistics.decompositions import svd

READINGS = 2400
"""Readings that are considered at most."""
VARIANTS = 16
"""Readings that are considered at each position, at most."""
MOST_SIDES = 3
"""Joints that are considered from both sides, at most."""
ENDS = 1.25
"""How much wider than the travel positions are spread: those beyond an end stand at it, where most is seen."""
STEPS = 101
"""Positions are rounded to a power of ten of their unit, such that the travel has at least this many: finer ones would
only be the same reading again and again. A metre has 1000, as on every tenth millimetre a screw stands alike."""
FINER = (1, 8, 64)
"""By what factors more positions are looked at where constraints leave few of them."""
ENOUGH_READINGS = 200
"""Readings to choose from that are enough."""
SMALL = 0.1
"""Where readings cover less than this part of what positions within the range of those measured make of them, the
instrument reads small deviations only, and only positions that keep to these are considered."""
STEP = 1e-6
"""Of the derivative of places, as a part of a joint's travel."""
ROUNDS = 15
"""Newton's steps at most."""
REACHED = 1e-6
"""Distance from a place that counts as none, as a part of the distance of the places that are reached at all."""
WHOLE_TURN = 0.9
"""Part of a turn from which data of a revolute joint cover all there is."""
SAME = 1e-4
"""Positions nearer to each other than this part of the travel are one."""


def positions(travel: Array, units: Array, count: int, taken: Array) -> Array:
    """Return positions within the travel, (n, J): some that were measured, and others, many of them at its ends.

    Parameters
    ----------
    travel : ndarray, shape (J, 2)
    units : ndarray, shape (J,)
        Internal value of the unit that each joint is commanded in.
    count : int
    taken : ndarray, shape (n, J)
        What was measured.
    """
    from scipy.stats import qmc  # takes half a second to import

    low, high = travel.T
    measured = taken[np.linspace(0, len(taken) - 1, min(len(taken), count // 4)).astype(int)]
    evenly = qmc.Halton(len(travel), scramble=False)
    evenly.fast_forward(1)
    part = 0.5 + ENDS * (evenly.random(count - len(measured)) - 0.5)
    every = np.concatenate([measured, low + part * (high - low)])
    moving = high > low
    step = units * 10.0 ** np.floor(np.log10(np.where(moving, high - low, 1.0) / units / STEPS))
    first, last = np.ceil(low / step - 1e-9) * step, np.floor(high / step + 1e-9) * step
    rounded = np.clip(np.round(every / step) * step, first, last)
    return np.unique(np.where(moving, rounded, np.clip(every, low, high)), axis=0)


class Pool:
    """The readings of a machine that are considered.

    Parameters
    ----------
    fit : Fit
        Says where the target is.
    o : Observations
        The data without outliers.
    effects : sequence of Effect
        Those in question: they say which sides, loads and temperatures matter.
    constraints : Constraints

    Attributes
    ----------
    travel : ndarray, shape (J, 2)
        Within the limits.
    rows : Rows
    out_of_reach : list of int
        Numbers, from 1, of given places that no target reaches.
    badly_seen : bool
        Whether stars are at any altitude, because none is where a mount sees them well.

    Raises
    ------
    InputFileError
        When the constraints leave no reading; it names the first that none meets together with those before.
    """

    def __init__(
        self, fit: Fit, o: Observations, effects: Sequence[Effect], constraints: Constraints
    ) -> None:
        self.fit, self.o, self.machine = fit, o, fit.machine
        self.stated, self.constraints = constraints, constraints.of_stars(self.machine)
        self.travel = constraints.travel(self.machine, fit.problem.model.travel)
        self.surroundings = Surroundings(o)
        self.out_of_reach, self.badly_seen = list[int](), False
        self._vary(effects)
        self.rows = self._readings()

    def _vary(self, effects: Sequence[Effect]) -> None:
        """Find what is varied beside positions: sides, loads, and the surroundings of some rows of the data."""
        o, joints = self.o, self.machine.joints
        names = [(e.place, formula.names) for e in effects for formula in e.definition.formulas]
        users = {column: {place for place, of in names if column in of} for column in (*"svTF", "acc")}
        self.moving = (np.ptp(self.travel, axis=1) > 0) & [joint.is_read for joint in joints]
        turning = users["s"] | users["v"]
        varied = [j for j, joint in enumerate(joints) if joint.name in turning and self.moving[j]]
        self.varied = varied[:MOST_SIDES]
        one_way = np.abs(o.s.sum(axis=0, dtype=int)) == o.n  # as measured: a change would be one more
        self.sides = sorted({*self.varied, *np.flatnonzero(one_way).tolist()})
        accelerated = {joint.column for joint in joints if joint.name in users["acc"]}
        columns = [np.abs(o.v[:, j]) for j, joint in enumerate(joints) if joint.name in users["v"]]
        columns += [values for name, values in o.covariates.items() if name[2:] in accelerated]
        columns += [values for name, values in o.temperature.items() if name in users["T"]]
        extremes = {int(f(x)) for x in columns if np.ptp(x) > 0 for f in (np.argmin, np.argmax)}
        loads = {0.0} if o.load is None else {float(o.load[-1])}
        if o.load is not None and users["F"]:
            loads |= {0.0, float(o.load.min()), float(o.load.max())}
        either = [(-1, 1)] * len(self.varied)
        states, targets = sorted(extremes) or [o.n - 1], range(len(self.machine.targets))
        self.kinds = np.array(list(itertools.product(*either, sorted(loads), states, targets)), float)

    def _readings(self) -> Rows:
        constraints = self.constraints
        if constraints.poses is not None:
            pool = self._listed(constraints.poses)
        elif constraints.places is not None:
            pool = self._at_places(constraints.places)
        else:
            pool = self._within_reach()
        if not constraints.regions and not constraints.boxes:
            return pool
        for finer in FINER:
            if finer > 1:
                pool = self._variants(self._positions(finer), most=finer * READINGS)
            allowed, reason = self._allowed(pool)
            if (
                allowed.n >= ENOUGH_READINGS
                or constraints.poses is not None
                or constraints.places is not None
            ):
                break
        if not allowed.n and constraints is not self.stated:  # no star is well seen
            self.constraints, self.badly_seen = self.stated, True
            return self._readings()
        if not allowed.n:
            within = "the list of poses" if constraints.poses is not None else "the travel and the limits"
            expected = "constraints that some reading meets"
            raise InputFileError(constraints.file, reason, f"no reading within {within} meets it", expected)
        some = np.random.default_rng(0).permutation(allowed.n)[:READINGS]
        return allowed.take(np.sort(some))

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
        poses = poses.take(np.all((poses.q >= low) & (poses.q <= high), axis=1))
        if not poses.n:
            expected = "one at least"
            raise InputFileError(
                poses.data.file, "file", "no pose within the travel and the limits", expected
            )
        rows = self._variants(poses.q, poses)
        kind = np.column_stack([rows.q, rows.s, rows.target, rows.load, rows.state])
        return rows.take(np.sort(np.unique(kind, axis=0, return_index=True)[1]))

    def _at_places(self, places: Array) -> Rows:
        """Return readings whose target is brought to one of some places, by small moves from readings elsewhere."""
        random = np.random.default_rng(0)
        starts = self._variants(self._positions())
        starts = starts.take(random.permutation(starts.n)[: READINGS // len(places)])
        rows_of_places = [self._brought_to(starts, place) for place in places]
        pool = Rows.joined(rows_of_places)
        pool = replace(pool, q=self.machine.followed(pool.q))
        self.out_of_reach = [k for k, rows in enumerate(rows_of_places, 1) if not rows.n]
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
        kind = np.column_stack([near, rows.s, rows.target, rows.load, rows.state])
        _, first = np.unique(kind, axis=0, return_index=True)
        return rows.take(np.sort(first))

    def _within_reach(self) -> Rows:
        """Return readings without those beyond an instrument for deviations only: a probe on a ball, a ball bar."""
        pool = self._variants(self._positions())
        if not self.machine.measurand.moving:
            return pool
        low, high = self.o.reading.min(axis=0), self.o.reading.max(axis=0)
        near = pool.take(np.all((pool.q >= self.o.q.min(axis=0)) & (pool.q <= self.o.q.max(axis=0)), axis=1))
        usual = np.linalg.norm(np.nanstd(self._predicted(near), axis=0)) if near.n > 1 else 0.0
        if not np.linalg.norm(high - low) < SMALL * usual:
            return pool
        pool = self._variants(np.unique(self.o.q, axis=0))
        predicted, room = self._predicted(pool), 0.5 * (high - low)
        inside = np.all((predicted > low - room) & (predicted < high + room), axis=1)
        return pool.take(inside) if inside.sum() > 1 else pool

    @property
    def over(self) -> Mask | None:
        """Which readings are on the other side of a mount's pier; None of other machines, and where none is."""
        over = np.cos(self.rows.q[:, 1]) < 0 if mount_of(self.machine) is not None else np.zeros(1, bool)
        return over if over.any() and self.constraints.poses is None else None

    def sky(self, rows: Rows) -> dict[str, list[float]]:
        """Return altitude and azimuth of the stars of a mount that does not count by them; empty of others."""
        mount = mount_of(self.machine)
        if mount is None or mount is ALTAZ:
            return {}
        angles = mount.horizontal(self._places(rows), self.machine.gravity)
        names = ("altitude [deg]", "azimuth [deg]")
        return {name: np.degrees(x).round(2).tolist() for name, x in zip(names, angles, strict=True)}

    def _places(self, pool: Rows) -> Array:
        """Return where the target is, or the direction, in machine axes, (n, 3)."""
        return self.fit.places(self.surroundings.observations(pool, at_once=True))

    def _predicted(self, pool: Rows) -> Array:
        """Return what the model predicts for readings, (n, m)."""
        problem = Problem(self.fit.problem.model, self.surroundings.observations(pool, at_once=True))
        return problem.predicted(self.fit.solution.theta, self.fit.solution.frame)

    def _positions(self, finer: int = 1) -> Array:
        """Return positions that the machine can take, (n, J), whatever the constraints forbid; so many times more."""
        machine, o = self.machine, self.o
        count = finer * READINGS // min(len(self.kinds), VARIANTS)
        units = np.array([o.unit_of(joint.column)[1] for joint in machine.joints])
        still = np.array([not joint.is_read for joint in machine.joints])
        within = np.where(still[:, None], np.median(o.q, axis=0)[:, None], self.travel)
        q = machine.followed(positions(within, units, count, np.asarray(o.q)))
        q = q[machine.within_travel(q)]
        return q[attainable(o, q)] if machine.kinematics.is_closed else q

    def _variants(self, q: Array, listed: Observations | None = None, most: int = READINGS) -> Rows:
        """Return readings at positions, (n, J), with what else is varied; what a list of poses has is as listed."""
        o, low, high = self.o, *self.travel.T
        pick = np.arange(len(q) * len(self.kinds))
        if len(pick) > most:
            pick = np.sort(np.random.default_rng(0).choice(len(pick), most, replace=False))
        at, kind = np.divmod(pick, len(self.kinds))
        q, columns = q[at], self.kinds[kind].T
        load, state, target = columns[-3], columns[-2].astype(int), columns[-1].astype(int)
        usual = np.where(self.moving, np.where(np.sum(o.s < 0, axis=0) <= o.n / 2, 1, -1), o.s[-1])
        s = np.repeat(usual[None], len(q), axis=0)
        s[:, self.varied] = columns[:-3].T
        if listed is not None:
            present = listed.columns_given
            s = np.where([f"dir_{joint.column}" in present for joint in self.machine.joints], listed.s[at], s)
            load = listed.load[at] if listed.load is not None and "load" in present else load
            target = listed.target[at].astype(int) if "target" in present else target
        rows = Rows(q, s.astype(np.int8), target, load, state)
        # at an end of the travel a joint comes from inside
        outside = (((s > 0) & (q <= low)) | ((s < 0) & (q >= high)))[:, self.varied].any(axis=1)
        return rows if listed is not None else rows.take(~outside)

    @cached_property
    def without_travel(self) -> list[int]:
        """Joints without a travel in the machine file, of which there may be more than in the data."""
        # the file of a closed chain states no travel of its legs; a list of poses has all that there are
        if self.machine.kinematics.is_closed or self.constraints.poses is not None:
            return []
        turned = np.ptp(self.o.q, axis=0) > 2 * math.pi * WHOLE_TURN
        return [
            j
            for j, joint in enumerate(self.machine.joints)
            if self.machine.limits[j] is None
            and joint.is_read
            and joint.column not in self.constraints.limits
            and not (joint.revolute and turned[j])
            and not is_altitude(self.machine, j)
        ]

    def places_of(self, q: Array, s: NDArray[np.int8]) -> Array:
        """Return where readings are, (n, d), in parts of the travel; one side is as far from the other as the ends."""
        span = np.ptp(self.travel, axis=1)
        at = q[:, span > 0] / span[span > 0]
        return np.concatenate([at, s[:, self.varied] / 2], axis=1)

    def ordered(self, picked: Sequence[int]) -> Rows:
        """Return some of the readings in the order in which they are to be taken, with the directions it makes."""
        start = np.asarray(self.o.q[-1])
        rows = ordered(self.rows.take(np.array(picked)), self.sides, np.ptp(self.travel, axis=1), start)
        stated = [f"dir_{joint.column}" in self.o.columns_given for joint in self.machine.joints]
        return replace(
            rows.as_moved(start), s=np.where(stated, rows.s, rows.as_moved(start).s).astype(np.int8)
        )


class Planned:
    """What a plan is made of.

    Attributes
    ----------
    pool : Pool
    rows : Rows or None
        In the order in which the readings are to be taken; None where none would tell more.
    goals : list of Goal
    notes : list of str
    needed : int or None
        How many readings would be enough, where these are not.
    """

    pool: Pool
    rows: Rows | None = None
    goals: list[Goal]
    notes: list[str]
    needed: int | None = None
