"""The axis of screws: rotations by angles that are not known about one axis, with slides along it.

A body is read in several places, as points or as poses. All its places are reached about one axis: a point that is at
x in the first place is at p + R(e, θ)(x - p) + s e in another one. Unknown are the axis, an angle θ and a slide s for
each further place, and the true x:

    minimise  Σ |y - p - R(e, θ)(x - p) - s e|²/σ²  over  |e| = 1, p, θ, s and x,

with the readings y. Screws about one axis add, so each place has an angle and a slide of its own from the first one,
which is read as the others are: the error of a reading with which many others are compared is one unknown, and the
covariance knows it. An angle that an encoder has read is one more reading, of an angle, however many points turn by
it.

A pose is a point and three directions, which turn and do not slide. Directions of an attitude with an error of σ
radians about every axis have together the squares of that error, twice: their weight is 1/(2σ²). (An attitude has
three degrees of freedom, its directions nine; their other six carry no error and determine the six of x that are no
attitude.) Where neither noise is known, both follow from the residuals by restricted maximum likelihood (D. A.
Harville, Journal of the American Statistical Association 72, 1977, 320-338).

The residual, and that screws add, are proved in ``derivation/helical_axis.py``, and so is where the solution starts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.moments import tangents
from rodgen.kinematics.axis_fit.pairs import Line
from rodgen.kinematics.axis_fit.readings import Readings
from rodgen.kinematics.backend import kernels

_EPS = float(np.finfo(float).eps)
_MOST_STEPS = 60
_SETTLED = 1e-13


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns: scaled lengths."""

    line: Line
    angle: Array
    slide: Array
    """Of each place, (P,)."""
    body: Array
    """Points and directions in the first place, (parts, 3)."""


class Equations:
    """The normal equations of readings with given weights."""

    def __init__(self, readings: Readings, weight: Array, angle_weight: float, *, known: bool) -> None:
        self.readings, self.weight, self.angle_weight, self.known = readings, weight, angle_weight, known
        places, n = np.flatnonzero(~readings.first), len(weight)
        self.column = np.full(len(readings.first), -1)
        self.column[places] = 2 * np.arange(len(places))
        body = 2 * len(places)
        self.line = body + 3 * readings.parts
        self.size = self.line + 4
        by = np.empty((n, 9), int)
        by[:, 0] = self.column[readings.place]
        by[:, 1] = np.where(by[:, 0] < 0, -1, by[:, 0] + 1)
        by[:, 2:5] = body + 3 * readings.part[:, None] + np.arange(3)
        by[:, 5:] = self.line + np.arange(4)
        self.rows = np.broadcast_to(3 * np.arange(n)[:, None, None] + np.arange(3)[:, None], (n, 3, 9))
        self.columns = np.broadcast_to(by[:, None, :], (n, 3, 9))
        self.used = self.columns >= 0

    def residuals(self, state: State) -> tuple[Array, Array]:
        """Return the residuals (n, 3), and their derivatives (n, 3, 11) as the kernel has them."""
        r, slides = self.readings, self.readings.slides
        d, by = kernels.screw_residual(
            state.body[r.part],
            r.value,
            state.angle[r.place],
            np.where(slides, state.slide[r.place], 0.0),
            state.line.axis,
            slides[:, None] * state.line.point,
        )
        return d, by

    def angle_residual(self, state: State) -> Array:
        """Return what is left of each angle that was read, to the nearest turn; 0 of others."""
        r = self.readings
        left = r.angle - state.angle[r.end] + state.angle[r.start]
        return np.where(np.isfinite(left), np.remainder(left + math.pi, 2 * math.pi) - math.pi, 0.0)

    def cost(self, state: State) -> float:
        """Return the weighted squares."""
        d, _ = self.residuals(state)
        return float(
            self.weight @ (d**2).sum(axis=1) + self.angle_weight * (self.angle_residual(state) ** 2).sum()
        )

    def jacobian(self, state: State, basis: Array) -> Any:
        """Return the derivatives of the residuals (3 n) by all unknowns, sparse."""
        from scipy.sparse import coo_array

        _, by = self.residuals(state)
        slides = self.readings.slides[:, None, None]
        J = np.concatenate(
            [
                by[:, :, 3:4],
                slides * by[:, :, 4:5],
                by[:, :, :3],
                by[:, :, 5:8] @ basis,
                slides * (by[:, :, 8:] @ basis),
            ],
            axis=2,
        )
        some = self.used
        return coo_array((J[some], (self.rows[some], self.columns[some])), (3 * len(J), self.size))

    def linearise(self, state: State, basis: Array) -> tuple[Any, Array, Array]:
        """Return the normal matrix, the right side, and the residuals."""
        from scipy.sparse import coo_array, diags_array

        r, d = self.readings, self.residuals(state)[0]
        jacobian = self.jacobian(state, basis).tocsr()
        weighted = jacobian.T @ diags_array(np.repeat(self.weight, 3))
        normal, side = weighted @ jacobian, -(weighted @ d.ravel())
        if self.angle_weight:
            read = np.flatnonzero(np.isfinite(r.angle))
            ends = self.column[np.stack([r.end[read], r.start[read]])]
            sign, row = np.array([[1.0], [-1.0]]) + 0 * ends, np.arange(len(read)) + 0 * ends
            kept = ends >= 0
            turns = coo_array((sign[kept], (row[kept], ends[kept])), (len(read), self.size)).tocsr()
            normal = normal + self.angle_weight * (turns.T @ turns)
            side = side + self.angle_weight * (turns.T @ self.angle_residual(state)[read])
        return normal.tocsc(), side, d

    def moved(self, state: State, step: Array, basis: Array) -> State:
        """Return the state after a step."""
        angle, slide = state.angle.copy(), state.slide.copy()
        free = self.column >= 0
        angle[free] += step[self.column[free]]
        slide[free] += step[self.column[free] + 1]
        axis = state.line.axis + basis @ step[self.line : self.line + 2]
        axis = axis / math.sqrt(axis @ axis)
        line = Line(axis, state.line.point + basis @ step[self.line + 2 :]).nearest(np.zeros(3))
        body = state.body + step[2 * int(free.sum()) : self.line].reshape(-1, 3)
        return State(line, angle, slide, body)

    def solve(self, state: State) -> tuple[State, bool]:
        """Return the least squares by Gauss-Newton steps, halved where they do not gain, and whether they ended."""
        cost = self.cost(state)
        for _ in range(_MOST_STEPS):
            basis = tangents(state.line.axis)
            normal, side, _ = self.linearise(state, basis)
            step = Factorised(normal).solve(side)
            new = self.moved(state, step, basis)
            now = self.cost(new)
            while now > cost * (1 + 1e-9) and np.abs(step).max() > _SETTLED:
                step = step / 2
                new = self.moved(state, step, basis)
                now = self.cost(new)
            gain, cost, state = cost - now, now, new
            if np.abs(step).max() < _SETTLED or gain <= 1e-14 * now:
                return state, True
        return state, False


class Factorised:
    """A positive matrix, scaled to ones on its diagonal, ready to solve with.

    What no reading determines gets a variance of 1/rounding, not none: the result then says that it is not determined.
    """

    def __init__(self, normal: Any) -> None:
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        diagonal = normal.diagonal()
        self.scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scale = diags_array(self.scale)
        scaled = scale @ normal @ scale + diags_array(np.full(len(diagonal), 4 * _EPS))
        options = {"SymmetricMode": True}
        self.factor = splu(scaled.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)

    def solve(self, side: Array) -> Array:
        """Return the solution of a column, or of columns."""
        scale = self.scale if side.ndim == 1 else self.scale[:, None]
        return np.asarray(scale * self.factor.solve(scale * side))

    @property
    def log_determinant(self) -> float:
        """Of the matrix."""
        return float(np.log(np.abs(self.factor.U.diagonal())).sum() - 2 * np.log(self.scale).sum())


def _axis_of(rotations: Array, shifts: Array) -> tuple[Line, Array, Array]:
    """Return the line, the angles and the slides of displacements (entries unmoved, sense, trace)."""
    symmetric = 2 * np.eye(3) - rotations - rotations.mT
    axis = np.linalg.eigh(symmetric.sum(axis=0))[1][:, 0]
    axial = np.stack([rotations[:, i, j] - rotations[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    angle = np.arctan2(axial @ axis, np.trace(rotations, axis1=1, axis2=2) - 1)
    slide = shifts @ axis
    basis = tangents(axis)
    across = shifts - slide[:, None] * axis
    rows = ((np.eye(3) - rotations) @ basis).reshape(-1, 2)
    point = basis @ np.linalg.lstsq(rows, across.ravel(), rcond=None)[0]
    return Line(axis, point), angle, slide


def first_guess(readings: Readings, rotations: Array, shifts: Array) -> State:
    """Return the axis of all motions, each place by the motions that lead to it, and the bodies from all places."""
    line, turn, push = _axis_of(rotations, shifts)
    known = np.isfinite(readings.angle)
    if known.any() and float(np.cos(readings.angle - turn)[known].sum()) < float(
        np.cos(readings.angle + turn)[known].sum()
    ):
        line, turn = Line(-line.axis, line.point), -turn
        push = -push
    turn = np.where(known, readings.angle, turn)
    P = len(readings.first)
    angle, slide, reached = np.zeros(P), np.zeros(P), readings.first.copy()
    ways: dict[int, list[tuple[int, float, float]]] = {}
    for start, end, by, to in zip(readings.start.tolist(), readings.end.tolist(), turn, push, strict=True):
        ways.setdefault(start, []).append((end, by, to))
        ways.setdefault(end, []).append((start, -by, -to))
    front = np.flatnonzero(reached).tolist()
    while front:
        place = front.pop()
        for other, by, to in ways.get(place, []):
            if not reached[other]:
                reached[other] = True
                angle[other], slide[other] = angle[place] + by, slide[place] + to
                front.append(other)
    back = _turned_back(readings, line, angle, slide)
    count = np.bincount(readings.part)
    body = np.stack([np.bincount(readings.part, column) / count for column in back.T], axis=1)
    return State(line, angle, slide, body)


def _turned_back(readings: Readings, line: Line, angle: Array, slide: Array) -> Array:
    """Return each reading as it would be in the first place of its body."""
    slides = readings.slides[:, None]
    x = readings.value - slides * (line.point + slide[readings.place][:, None] * line.axis)
    by = -angle[readings.place][:, None]
    e = line.axis
    turned = x + np.sin(by) * np.cross(e, x) + (1 - np.cos(by)) * np.cross(e, np.cross(e, x))
    return np.asarray(turned + slides * line.point)
