"""The axis of screws whose angles are not known exactly, from readings of points or poses.

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

The axis of screws whose angles are not known exactly: the noise, the uncertainty, and what is not determined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array, Index, Mask
from rodgen.errors import RodgenError, counted
from rodgen.kinematics.arrays import positive_length, real_array
from rodgen.kinematics.axis_fit.pairs import Line, demand_finite, shown, tangents
from rodgen.kinematics.axis_fit.result import (
    TWO_SIDED,
    AxisFit,
    AxisFitStatus,
    Motions,
    nearest,
    remarks_on_noise,
)
from rodgen.kinematics.axis_fit.solve import LOST_RADIANS, chi_cut, condition_number, joint_covariance
from rodgen.kinematics.backend import kernels

_EPS = float(np.finfo(float).eps)
_FEWEST = 3
"""Points that make a body: with fewer its place is not known."""
_NO_ROTATION = 1e-3
"""By how much a matrix with elements of four decimals stretches at most, generously."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of a body's points and directions in its places, in scaled lengths.

    Attributes
    ----------
    value : (n, 3) array
    place, part : (n,) int arrays
        Where the body was, and which of its points or directions it is.
    slides : (n,) bool array
        True of a point, false of a direction.
    first : (P,) bool array
        The places from which angles and slides count, one of each body.
    start, end : (M,) int arrays
        The places between which each motion is.
    angle : (M,) array
        The angle of each motion as it was read; NaN where it was not.
    attitudes : int
        Number of attitudes, each of three directions.
    row : (n,) int array
        The row of the table in which each reading stands first.
    motion : (N,) int array
        The motion of each row; -1 of the first pose, which has none.
    labels : tuple of str
        Of the motions.
    pairs : (2, N, 3) array
        The points of each row before and after; empty of poses.
    centre : (3,) array
    scale : float
        In the user's unit.
    """

    value: Array
    place: Index
    part: Index
    slides: Mask
    first: Mask
    start: Index
    end: Index
    angle: Array
    attitudes: int
    row: Index
    motion: Index
    labels: tuple[str, ...]
    pairs: Array
    centre: Array
    scale: float

    @property
    def parts(self) -> int:
        """Number of points and directions of all bodies."""
        return int(self.part.max()) + 1

    @property
    def dof(self) -> int:
        """Degrees of freedom: an attitude has three, its directions nine."""
        bodies = int(self.first.sum()) if self.attitudes else 0
        readings = 3 * len(self.value) - 6 * self.attitudes + int(np.isfinite(self.angle).sum())
        unknown = 3 * self.parts - 6 * bodies + 2 * int((~self.first).sum()) + 4
        return readings - unknown


def _displacement(before: Array, after: Array) -> tuple[Array, Array]:
    """Return the rotation and the shift y = R x + t that fit two sets of points best (K. S. Arun and others, 1987)."""
    x, y = before.mean(axis=0), after.mean(axis=0)
    u, _, vt = np.linalg.svd((before - x).T @ (after - y))
    turn = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation = (u @ turn @ vt).T
    return rotation, y - rotation @ x


def read_points(rho: ArrayLike, rho_prime: ArrayLike, move: Any, angle: Any) -> tuple[Readings, Array, Array]:
    """Return readings of points, and the displacement of each motion."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    x, y = real_array("rho", rho, (3,)), real_array("rho_prime", rho_prime, (3,))
    if x.ndim != 2 or x.shape != y.shape or not len(x):
        raise RodgenError(
            f"rho {x.shape} and rho_prime {y.shape} do not fit together; expected (N, 3) and (N, 3)"
        )
    demand_finite("rho", x)
    demand_finite("rho_prime", y)
    N = len(x)
    labels, begins, motion = np.unique(
        np.zeros(N, int) if move is None else np.asarray(move), return_index=True, return_inverse=True
    )
    order = np.argsort(begins)  # as they arrive
    labels, motion = labels[order], np.argsort(order)[motion]
    if motion.shape != (N,):
        raise RodgenError(f"move has the shape {motion.shape}; expected one label a row: ({N},)")
    centre, scale = frame_of(np.concatenate([x, y]))
    values = (np.concatenate([x, y]) - centre) / scale
    side = np.concatenate([2 * motion, 2 * motion + 1])
    for k, label in enumerate(labels):
        some = motion == k
        _check_body(values[:N][some], values[N:][some], label, len(labels) > 1)
    reading = np.unique(values + 0.0, axis=0, return_inverse=True)[1].ravel()
    stands = coo_array((np.ones(2 * N), (side, reading)), (2 * len(labels), reading.max() + 1)).tocsr()
    stands.data[:] = 1
    common = (stands @ stands.T).tocoo()
    alike = (common.data >= _FEWEST) & (common.row // 2 != common.col // 2)
    links = coo_array((common.data[alike], (common.row[alike], common.col[alike])), common.shape)
    place_of_side = connected_components(links, directed=False)[1]
    place = place_of_side[side]
    nodes, row, node = np.unique(
        np.stack([place, reading], axis=1), axis=0, return_index=True, return_inverse=True
    )
    node = node.ravel()
    ties = coo_array((np.ones(N), (node[:N], node[N:])), (len(nodes), len(nodes)))
    part = connected_components(ties, directed=False)[1]
    start, end = place_of_side[0::2], place_of_side[1::2]
    P = int(place.max()) + 1
    body = connected_components(coo_array((np.ones(len(start)), (start, end)), (P, P)), directed=False)[1]
    first = np.zeros(P, bool)
    first[np.unique(body, return_index=True)[1]] = True
    readings = Readings(
        values[row], nodes[:, 0], part, np.ones(len(row), bool), first, start, end,
        _one_a_turn(angle, motion, labels), 0, row % N, motion, tuple(map(str, labels)),
        values.reshape(2, N, 3), centre, scale,
    )  # fmt: skip
    displacements = [
        _displacement(values[:N][motion == k], values[N:][motion == k]) for k in range(len(labels))
    ]
    return readings, np.array([r for r, _ in displacements]), np.array([s for _, s in displacements])


def read_poses(position: ArrayLike, rotation: ArrayLike) -> tuple[Readings, Array, Array]:
    """Return readings of poses, and the displacement of each from the first."""
    p, R = poses_of(position, rotation)
    if len(p) < 2:
        raise RodgenError("there is one pose; a motion has two at least")
    centre, scale = frame_of(p)
    n, x = len(p), (p - centre) / scale
    values = np.concatenate([x[:, None], R.mT], axis=1).reshape(-1, 3)
    first, others = np.zeros(n, bool), np.arange(1, n)
    first[0] = True
    readings = Readings(
        values, np.repeat(np.arange(n), 4), np.tile(np.arange(4), n), np.tile([True, False, False, False], n),
        first, np.zeros(n - 1, int), others, np.full(n - 1, np.nan), n,
        np.repeat(np.arange(n), 4), np.arange(-1, n - 1), tuple(str(k + 1) for k in others), np.empty((2, 0, 3)),
        centre, scale,
    )  # fmt: skip
    turns = R[1:] @ R[0].T
    return readings, turns, x[1:] - (turns @ x[0])


def poses_of(position: ArrayLike, rotation: ArrayLike) -> tuple[Array, Array]:
    """Return positions and rotations after a check."""
    p, R = real_array("position", position, (3,)), real_array("rotation", rotation, (3, 3))
    if p.ndim != 2 or R.shape[:-2] != p.shape[:-1]:
        raise RodgenError(
            f"position {p.shape} and rotation {R.shape} do not fit together; expected (N, 3) and (N, 3, 3)"
        )
    demand_finite("position", p)
    demand_finite("rotation", R)
    return p, proper_rotations(R)


def proper_rotations(matrix: Array) -> Array:
    """Return the rotations nearest to matrices (n, 3, 3).

    Raises
    ------
    RodgenError
        For the first that is none: farther from one than four decimals of its elements leave.
    """
    u, size, vt = np.linalg.svd(matrix)
    bad = np.flatnonzero((np.abs(size - 1).max(axis=-1) > _NO_ROTATION) | (np.linalg.det(u @ vt) < 0))
    if len(bad):
        raise RodgenError(
            f"rotation, row {bad[0]} (counted from 0) is no rotation; expected an orthogonal matrix"
        )
    return np.asarray(u @ vt)


def _check_body(points: Array, after: Array, label: Any, named: bool) -> None:
    of = f"move {str(label)!r}" if named else "the table"
    count = len(np.unique(points, axis=0))
    if count < _FEWEST:
        raise RodgenError(
            f"{of} has {counted(count, 'point')}; without an angle a motion needs three, not on one line"
        )
    if len(np.unique(np.concatenate([points, after], axis=1), axis=0)) > count:
        raise RodgenError(
            f"a reading before the motion is in several rows of {of} with other readings after it; expected a "
            "label of its motion in each row, move"
        )
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if size[1] <= 64 * _EPS * max(size[0], float(np.abs(points).max())):
        raise RodgenError(
            f"the points of {of} lie on one line; the turn about it is not known: expected three others"
        )


def _one_a_turn(angle: Any, motion: Index, labels: Array) -> Array:
    """Return the angle of each motion that its rows share; NaN where none was read."""
    if angle is None:
        return np.full(len(labels), np.nan)
    angles = np.broadcast_to(real_array("angle", angle), motion.shape)
    demand_finite("angle", angles)
    angle_of = angles[np.unique(motion, return_index=True)[1]]
    differing = np.flatnonzero(angles != angle_of[motion])
    if len(differing):
        raise RodgenError(
            f"angle, row {differing[0]} (counted from 0) differs from that of other rows of move "
            f"{str(labels[motion[differing[0]]])!r}; expected one reading of the angle a move"
        )
    return np.asarray(angle_of)


def frame_of(points: Array) -> tuple[Array, float]:
    """Return the middle of points, and a power of two near their size about it."""
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max())
    return centre, float(2.0 ** math.frexp(size)[1]) if size > 0 else 1.0


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
            is_read = ends >= 0
            turns = coo_array((sign[is_read], (row[is_read], ends[is_read])), (len(read), self.size)).tocsr()
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
        for neighbour, by, to in ways.get(place, []):
            if not reached[neighbour]:
                reached[neighbour] = True
                angle[neighbour], slide[neighbour] = angle[place] + by, slide[place] + to
                front.append(neighbour)
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


_WIDEST = 30.0
"""Logarithm of the ratio of the two noises' variances, in scaled lengths, that no data have."""
_FREE = 1e-6
"""Part of a reading that the others check: below it they do not."""
_AT_ONCE = 256
"""Columns of the inverse that are in memory together."""


def fit_points(
    rho: ArrayLike,
    rho_prime: ArrayLike,
    *,
    move: Any,
    angle: ArrayLike | None,
    sigma: Any,
    sigma_angle: float | None,
    origin: ArrayLike | None,
) -> AxisFit:
    """Return the axis of motions with angles that are not known, or were read; see :func:`.fit.fit_axis`."""
    if angle is None and sigma_angle is not None:
        raise RodgenError("sigma_angle is that of readings of the angle; there are none")
    if angle is not None and (sigma is None or sigma_angle is None):
        raise RodgenError(
            "readings of the angle need their sigma_angle, and the points' sigma to weigh them against"
        )
    readings, turns, shifts = read_points(rho, rho_prime, move, angle)
    noise = _given(readings, sigma, sigma_angle)
    state = first_guess(readings, turns, shifts)
    if noise is None:
        noise = _Noise(1.0, 0.0, known=False)
    return _assess(readings, state, noise, origin)


def fit_pose_axis(
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    sigma: float | None = None,
    sigma_angle: float | None = None,
    origin: ArrayLike | None = None,
) -> AxisFit:
    """Fit one axis of screws to poses of a body, each reached from the others by screws about it.

    Maximum likelihood for independent isotropic noise of every position and every attitude. The motions of the result
    are those from the first pose, whose error they share; the uncertainties know it. Two poses have one axis exactly,
    the finite helical axis; its uncertainty then needs `sigma` and `sigma_angle`.

    Parameters
    ----------
    position : (N, 3) array_like
        A point of the body, in a fixed frame, any one length unit.
    rotation : (N, 3, 3) array_like
        Attitudes: the body's axes are the columns. See :func:`rodgen.matrix_from_quaternion` for quaternions.
    sigma : float, optional
        Standard uncertainty of one coordinate of a position.
    sigma_angle : float, optional
        Standard uncertainty of an attitude about each axis, in rad. Both are given, or both estimated.
    origin : (3,) array_like, optional
        The axis's point nearest to it is returned; left out, nearest to the mean of the positions.

    Returns
    -------
    AxisFit

    Raises
    ------
    RodgenError
        (a ValueError) Shapes that do not fit together, fewer than two poses, a number that is not finite or a matrix
        that is no rotation (with its row), one of `sigma` and `sigma_angle` without the other.

    Examples
    --------
    >>> import numpy as np, rodgen
    >>> turns, _ = rodgen.matrix_from_axis_angle([0, 0, 1], np.radians([0, 30, 60, 90]))
    >>> place = np.array([[2, 0, 0], [3**0.5, 1, 0.5], [1, 3**0.5, 1], [0, 2, 1.5]])
    >>> fit = fit_pose_axis(place, turns, sigma=0.01, sigma_angle=1e-4)
    >>> found = fit.motions
    >>> (fit.axis.round(6) + 0.0).tolist(), np.degrees(found.angles).round(6).tolist(), found.slides.round(6).tolist()
    ([0.0, 0.0, 1.0], [30.0, 60.0, 90.0], [0.5, 1.0, 1.5])
    """
    readings, turns, shifts = read_poses(position, rotation)
    noise = _given(readings, sigma, sigma_angle)
    state = first_guess(readings, turns, shifts)
    if noise is None:
        noise, state = _estimated(readings, state)
    return _assess(readings, state, noise, origin)


@dataclass(frozen=True)
class _Noise:
    """Variances: of a coordinate, scaled, and of an angle; relative ones where they are not known."""

    length: float
    angle: float
    known: bool

    def equations(self, readings: Readings) -> Equations:
        """Return the normal equations with weights of one over these."""
        weight = np.full(len(readings.value), 1 / self.length)
        if readings.attitudes:
            weight[~readings.slides] = 1 / (2 * self.angle)
        read = np.isfinite(readings.angle).any()
        return Equations(readings, weight, 1 / self.angle if read else 0.0, known=self.known)


def _given(readings: Readings, sigma: Any, sigma_angle: float | None) -> _Noise | None:
    lengths = None if sigma is None else positive_length("sigma", sigma)
    angles = None if sigma_angle is None else positive_length("sigma_angle", sigma_angle)
    if readings.attitudes and (lengths is None) != (angles is None):
        raise RodgenError("poses need both sigma and sigma_angle, or neither")
    return (
        None if lengths is None else _Noise((lengths / readings.scale) ** 2, (angles or 0.0) ** 2, known=True)
    )


def _estimated(readings: Readings, state: State) -> tuple[_Noise, State]:
    """Return the noises of positions and attitudes of largest restricted likelihood, relative, and the solution."""
    n, dof = readings.attitudes, readings.dof
    found = state
    if dof <= 0:
        return _Noise(1.0, 1.0, known=False), found

    def deviance(ratio: float) -> float:
        nonlocal found
        noise = _Noise(1.0, math.exp(ratio), known=False)
        equations = noise.equations(readings)
        found, _ = equations.solve(found)
        factor = Factorised(equations.linearise(found, tangents(found.line.axis))[0])
        # six of the nine freedoms of the directions carry no error
        observed = -(3 * n + 6) * -ratio
        return (
            factor.log_determinant + observed + dof * math.log(equations.cost(found) + _rounding(equations))
        )

    from scipy.optimize import minimize_scalar

    best = minimize_scalar(deviance, bounds=(-_WIDEST, _WIDEST), method="bounded", options={"xatol": 1e-4})
    noise = _Noise(1.0, math.exp(float(best.x)), known=False)
    return noise, noise.equations(readings).solve(found)[0]


def _rounding(equations: Equations) -> float:
    """Return the weighted squares that rounding leaves."""
    return float(equations.weight.sum()) * (4 * _EPS) ** 2


def _oriented(readings: Readings, state: State) -> State:
    """Return the state with the first motion that is near neither a half turn nor none positive."""
    if np.isfinite(readings.angle).any():
        return state
    sines = np.sin(state.angle[readings.end] - state.angle[readings.start])
    first = int(np.argmax(np.abs(sines) >= np.abs(sines).max() / 2))
    if sines[first] >= 0:
        return state
    return State(Line(-state.line.axis, state.line.point), -state.angle, -state.slide, state.body)


def _assess(readings: Readings, state: State, noise: _Noise, origin: ArrayLike | None) -> AxisFit:
    """Return the result in the user's unit."""
    equations, dof, scale = noise.equations(readings), readings.dof, readings.scale
    state, converged = equations.solve(state)
    state = _oriented(readings, state)
    basis = tangents(state.line.axis)
    normal, _, d = equations.linearise(state, basis)
    cost = equations.cost(state)
    variance = 1.0 if noise.known else cost / dof if dof > 0 else math.nan
    total = dof
    if readings.attitudes and not noise.known:
        dof //= 2  # of each of the two noises
    factor = Factorised(normal)
    last = np.zeros((equations.size, 4))
    last[equations.line :] = np.eye(4)
    unit = factor.solve(last)[equations.line :]
    covariance = variance * (unit + unit.T) / 2
    if covariance[:2, :2].trace() > math.pi**2:  # beyond every direction
        covariance[:] = math.nan
    joint = joint_covariance(covariance, state.line, np.zeros(3), basis, scale)
    near = readings.centre if origin is None else real_array("origin", origin, (3,))
    point, joint = nearest(state.line.axis, readings.centre + scale * state.line.point, joint, near)

    angles, slides = (x[readings.end] - x[readings.start] for x in (state.angle, state.slide))
    spread = math.sqrt(variance) * _motion_spread(equations, factor)
    angles = np.where(
        np.isfinite(readings.angle), angles, np.remainder(angles + math.pi, -2 * math.pi) + math.pi
    )
    judged = max(variance, (64 * _EPS) ** 2 / noise.length) if math.isfinite(variance) else (64 * _EPS) ** 2
    status, free, undetermined = _status(readings, judged * (unit + unit.T) / 2, basis, angles, spread[:, 0])
    if status is AxisFitStatus.ANY_AXIS and not variance:  # exact readings
        joint[:] = math.nan
    tests = _slides(equations, state, normal, variance, dof, noise.known)
    outliers = np.zeros(len(readings.motion), bool)
    worst = _outlier(equations, state, basis, factor, cost, total)
    if worst is not None:
        outliers[readings.row[readings.slides][worst]] = True
    if readings.attitudes:
        missed = d[readings.slides]
    else:
        of = readings.motion
        missed = kernels.screw_residual(
            *readings.pairs, angles[of], slides[of], state.line.axis, state.line.point
        )[0]
    rms = math.sqrt(float((missed[~outliers] ** 2).sum(axis=1).mean())) * scale
    points = readings.value[readings.slides]
    arm = (
        math.sqrt(float(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())) or 1.0
    )  # all at one place
    determined = status < AxisFitStatus.ONE_FREEDOM
    information = np.asarray(np.linalg.inv((unit + unit.T) / 2), float) if determined else unit
    several = len(slides) > 1
    alike = np.array([[1.0], [-1.0]][: 1 + (status is AxisFitStatus.SIGN_FREE)])
    remarks = []
    if not (noise.known or dof > 0):
        remarks.append(
            "The readings leave no degrees of freedom to estimate the noise: give it to learn the uncertainty."
        )
    chi_square = cost if noise.known else None
    remarks += remarks_on_noise(noise.known, dof, chi_square, status is AxisFitStatus.DETERMINED)
    if not converged:
        remarks.append("The least squares had not settled.")
    return AxisFit(
        axis=state.line.axis,
        point=point,
        origin=near,
        covariance=joint,
        sigma=math.sqrt(variance * noise.length) * scale,
        sigma_angle=math.sqrt(variance * noise.angle) if noise.angle else math.nan,
        sigma_given=noise.known,
        dof=dof,
        chi_square=chi_square,
        rms=rms,
        residuals=missed * scale,
        turns=np.append(angles, 0.0)[readings.motion],
        weights=np.ones(len(outliers)),
        outliers=outliers,
        condition=condition_number(information, arm) if determined else math.inf,
        status=status,
        undetermined=tuple(undetermined),
        remarks=tuple(remarks),
        candidate_axes=alike * state.line.axis,
        candidate_points=np.repeat(point[None], len(alike), axis=0),
        candidate_rms=np.full(len(alike), rms),
        free_directions=free,
        point_known=False,
        loss="linear",
        iterations=0,
        motions=Motions(
            readings.labels, angles, spread[:, 0], slides * scale, spread[:, 1] * scale, tests.none, tests.one
        ),
        slide=(tests.pitch if several else float(slides[0])) * scale,
        slide_uncertainty=(tests.uncertainty if several else float(spread[0, 1])) * scale,
        slide_fitted=True,
        slide_by_angle=several,
    )


def _motion_spread(equations: Equations, factor: Factorised) -> Array:
    """Return the standard uncertainties (M, 2) of angle and slide of each motion for a unit variance."""
    r = equations.readings
    spread = np.empty((len(r.start), 2))
    for first in range(0, len(r.start), _AT_ONCE // 2):
        some = slice(first, first + _AT_ONCE // 2)
        ends = equations.column[np.stack([r.end[some], r.start[some]])]
        count = ends.shape[1]
        select = np.zeros((equations.size, 2 * count))
        for places, sign in zip(ends, (1.0, -1.0), strict=True):
            for what in (0, 1):
                moved = np.flatnonzero(places >= 0)
                select[places[moved] + what, 2 * moved + what] += sign
        spread[some] = np.sqrt(np.einsum("ij,ij->j", select, factor.solve(select)).reshape(-1, 2))
    return spread


def _outlier(
    equations: Equations, state: State, basis: Array, factor: Factorised, cost: float, dof: int
) -> int | None:
    """Return the reading of a point, or the pose, without which the squares fall most, unless chance explains that.

    Without a reading they fall by dᵀ (I - h)⁻¹ d in units of the noise, with its part h of the fit (W. Baarda, 1968).
    """
    r, known = equations.readings, equations.known
    if dof <= 3 and not known:
        return None
    jacobian, weight = equations.jacobian(state, basis).tocsr(), equations.weight
    d = equations.residuals(state)[0]
    points = np.flatnonzero(r.slides)
    falls = np.zeros(len(points))
    for first in range(0, len(points), _AT_ONCE // 3):
        some = points[first : first + _AT_ONCE // 3]
        rows = (3 * some[:, None] + np.arange(3)).ravel()
        J = jacobian[rows]
        part = J @ factor.solve(J.T.toarray())
        diagonal = np.arange(len(some))
        h = weight[some][:, None, None] * part.reshape(len(some), 3, len(some), 3)[diagonal, :, diagonal]
        size, axes = np.linalg.eigh(np.eye(3) - h)
        along = np.einsum("nij,ni->nj", axes, d[some]) ** 2
        free = size > _FREE
        falls[first : first + len(some)] = weight[some] * (along / np.where(free, size, np.inf)).sum(axis=1)
    worst = int(np.argmax(falls))
    left = 1.0 if known else (cost - falls[worst]) / (dof - 3)
    return worst if falls[worst] > chi_cut(len(falls)) ** 2 * (left + _rounding(equations)) else None


def _status(
    readings: Readings, covariance: Array, basis: Array, angles: Array, spread: Array
) -> tuple[AxisFitStatus, Array, list[str]]:
    """Return the status, the turns of the axis (F, 3) that are free, and sentences on them."""
    variances, along = np.linalg.eigh(covariance[:2, :2])
    hidden = np.flatnonzero(variances > LOST_RADIANS**2)
    texts = []
    known = np.where(np.isfinite(spread), spread, 0.0) * TWO_SIDED + 64 * _EPS
    still = bool((2 * np.abs(np.sin(angles / 2)) <= known).all())
    if still or len(hidden) == 2:
        texts.append("the axis: no motion turns by more than noise explains, so any direction fits.")
    elif len(hidden) == 1:
        degrees = math.degrees(math.sqrt(variances[hidden[0]]))
        texts.append(
            f"the axis direction towards {shown(basis @ along[:, hidden[0]])}: its standard uncertainty is "
            f"{degrees:.0f} deg, so the noise hides it."
        )
    if texts:
        texts.append("the point: it moves with the axis direction.")
        if len(hidden) == 1 and not still:
            return AxisFitStatus.ONE_FREEDOM, (basis @ along[:, hidden]).T, texts
        return AxisFitStatus.ANY_AXIS, basis.T, texts
    free = np.empty((0, 3))
    if not np.isfinite(readings.angle).any() and (np.abs(np.sin(angles)) <= known).all():
        texts.append("the sign of the axis: the motions are half turns within their uncertainty.")
        return AxisFitStatus.SIGN_FREE, free, texts
    return AxisFitStatus.DETERMINED, free, texts


@dataclass(frozen=True)
class _Slides:
    """What the slides are: probabilities that they are none, or of one pitch, and the pitch."""

    none: float | None
    pitch: float
    uncertainty: float
    one: float | None


def _slides(
    equations: Equations, state: State, normal: Any, variance: float, dof: int, known: bool
) -> _Slides:
    """Compare with no slides, and with slides in proportion to the angles, by what the squares grow (Wald's test)."""
    from scipy.sparse import coo_array
    from scipy.special import chdtrc, fdtrc

    column = equations.column[equations.column >= 0]
    free = equations.column >= 0
    K, size = len(column), equations.size
    if not K or math.isnan(variance):
        return _Slides(None, math.nan, math.nan, None)
    turn, slide = state.angle[free], state.slide[free]
    others = np.setdiff1d(np.arange(size), column + 1)

    def chance(squares: float, count: int) -> float:
        squares /= variance or _EPS**2  # of exact readings nothing is left, not even by rounding
        return float(chdtrc(count, squares) if known else fdtrc(count, dof, squares / count))

    def constrained(pitch: float, extra: bool) -> tuple[float, float, float]:
        """Return by what the squares grow where slides are `pitch` times the angles, a step of it, and its variance."""
        offset = np.zeros(size)
        offset[column + 1] = pitch * turn - slide
        where = np.searchsorted(others, column)
        rows, columns = np.concatenate([others, column + 1]), np.concatenate([np.arange(len(others)), where])
        values = np.concatenate([np.ones(len(others)), np.full(K, pitch)])
        if extra:
            rows, columns = (
                np.concatenate([rows, column + 1]),
                np.concatenate([columns, np.full(K, len(others))]),
            )
            values = np.concatenate([values, turn])
        T = coo_array((values, (rows, columns)), (size, len(others) + extra)).tocsc()
        factor = Factorised((T.T @ normal @ T).tocsc())
        step = -factor.solve(T.T @ (normal @ offset))
        change = offset + T @ step
        unit = np.zeros(T.shape[1])
        unit[-1] = 1.0
        return float(change @ (normal @ change)), float(step[-1]), float(factor.solve(unit)[-1])

    none = chance(constrained(0.0, extra=False)[0], K)
    if K < 2 or not np.abs(np.sin(turn / 2)).max() > 64 * _EPS:
        return _Slides(none, math.nan, math.nan, None)
    pitch, squares, spread = float(turn @ slide / (turn @ turn)), 0.0, 0.0
    for _ in range(4):
        squares, step, spread = constrained(pitch, extra=True)
        pitch += step
    return _Slides(none, pitch, math.sqrt(variance * spread), chance(squares, K - 1))
