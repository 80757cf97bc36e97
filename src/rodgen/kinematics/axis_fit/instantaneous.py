"""The instantaneous helical axis of a body along a trajectory of measured poses.

Velocities are those of the smoothest motion that agrees with the poses: the accelerations of the point and of the
rotation are random walks, whose size follows from the poses by restricted maximum likelihood, as the noise does
where it is not given. For a point this is the quintic smoothing spline in its stochastic form (G. Wahba, Journal of
the Royal Statistical Society B 40, 1978, 364-372); attitudes are smoothed alike, in the turns by which they differ
from those of the solution. So the uncertainty knows the noise, and what the motion may have done between the poses.

The helical axis of a velocity, and the turn of an angular velocity that changes, are proved in
``derivation/helical_axis.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array, Index, Mask
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import positive_length, real_array
from rodgen.kinematics.axis_fit.result import (
    MOST_SHOWN,
    TWO_SIDED,
    ZERO_CHANCE,
    angle_text,
    table_lines,
    vector_text,
)
from rodgen.kinematics.axis_fit.screws import Factorised, frame_of, poses_of
from rodgen.kinematics.axis_fit.solve import LOST_RADIANS
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.rotation import axis_angle_from_matrix, matrix_from_axis_angle
from rodgen.kinematics.screws import ScrewStatus
from rodgen.statistics.digits import measured
from rodgen.views import plain, with_html

_FEWEST = 5
"""Poses: three are a motion of constant acceleration, and the noise and its change need two more."""
_SMOOTHEST, _ROUGHEST = -24.0, 20.0
"""Logarithms of what an acceleration changes by in a step, over the noise, both squared. Below the first, rounding
hides the likelihood; a smoothing then reaches over about a hundred poses. Above the second nothing is smoothed."""
_NEAR = 0.05
"""Of that logarithm: the velocities change by far less than their uncertainties."""
_MOST_STEPS = 20
_STAY = 1e-6
"""Of the squares: their logarithm, some hundred times, then stays within the search's step."""
_DIFFUSE = 1e8
"""Variance of what is not known before the first pose, in units of the noise's: far above all that poses leave."""


@with_html
@dataclass(frozen=True, eq=False)
class InstantaneousAxes:
    """The helical axis of a body at each instant of a trajectory; what :func:`instantaneous_axes` returns.

    Uncertainties are standard uncertainties. Lengths are in the unit of the input, angles in radians.

    Attributes
    ----------
    time : (n,) array
    axis, point : (n, 3) arrays
        Unit direction of the angular velocity, and the point of the axis nearest to `origin`; NaN without an axis.
    rate, slide_rate, pitch : (n,) arrays
        Angular velocity, velocity along the axis, and their ratio, a length for each radian; the last two are NaN
        without an axis.
    axis_uncertainty : (n,) array
        Of the direction, in its worst direction.
    point_uncertainty : (n, 3) array
    rate_uncertainty, slide_rate_uncertainty, pitch_uncertainty : (n,) arrays
    covariance : (n, 9, 9) array
        Joint covariance of axis, point, pitch, rate and slide rate.
    status : (n,) int8 array
        Codes of :class:`rodgen.kinematics.screws.ScrewStatus`: SCREW; LINE, where the slide is zero within its
        uncertainty; COUPLE, where the angular velocity is too small to have an axis; ZERO, where the body is at rest
        within its uncertainty.
    origin : (3,) array
    sigma, sigma_angle : float
        Standard uncertainty of a coordinate, and of an attitude about each axis.
    sigma_given : bool
    """

    time: Array
    axis: Array
    point: Array
    rate: Array
    slide_rate: Array
    pitch: Array
    axis_uncertainty: Array
    point_uncertainty: Array
    rate_uncertainty: Array
    slide_rate_uncertainty: Array
    pitch_uncertainty: Array
    covariance: Array
    status: Index
    origin: Array
    sigma: float
    sigma_angle: float
    sigma_given: bool

    def summary(self) -> str:
        """Return a summary: some of the instants, the noise, and how many have no axis or no slide."""
        n = len(self.time)
        some = np.unique(np.linspace(0, n - 1, min(n, MOST_SHOWN)).round().astype(int))
        columns = {
            "t [s]": [f"{t:.6g}" for t in self.time[some]],
            "axis": [
                vector_text(e, u) if math.isfinite(u) else "–"
                for e, u in zip(self.axis[some], self.axis_uncertainty[some], strict=True)
            ],
            "rate [deg/s]": _texts(np.degrees(self.rate[some]), np.degrees(self.rate_uncertainty[some])),
            "slide": _texts(self.slide_rate[some], self.slide_rate_uncertainty[some]),
            "pitch": _texts(self.pitch[some], self.pitch_uncertainty[some]),
            "point": [
                vector_text(p, u.max()) if math.isfinite(u.max()) else "–"
                for p, u in zip(self.point[some], self.point_uncertainty[some], strict=True)
            ],
            "status": [ScrewStatus(s).name for s in self.status[some].tolist()],
        }
        source = "given" if self.sigma_given else "estimated"
        none = int((self.status >= ScrewStatus.COUPLE).sum())
        lines = [
            f"Instantaneous helical axes of {n} poses",
            *table_lines(columns),
            f"  points      nearest to {vector_text(self.origin, math.nan)}; slide: velocity along the axis",
            f"  noise       {self.sigma:.4g} a coordinate, {angle_text(self.sigma_angle)[2:]} an attitude ({source})",
            f"  {none} of {n} instants have no axis: the angular velocity is too small for its uncertainty",
            f"  {int((self.status == ScrewStatus.LINE).sum())} of {n - none} others have a slide of zero within its "
            "uncertainty",
        ]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.summary()

    def columns(self, unit: str) -> dict[str, Any]:
        """Return the columns of a table with a row for each instant, by name with unit; lengths are in `unit`."""
        columns: dict[str, Any] = {"t [s]": self.time}
        columns |= {f"axis_{c}": x for c, x in zip("xyz", self.axis.T, strict=True)}
        columns["u_axis [rad]"] = self.axis_uncertainty
        columns |= {f"point_{c} [{unit}]": x for c, x in zip("xyz", self.point.T, strict=True)}
        columns |= {f"u_point_{c} [{unit}]": x for c, x in zip("xyz", self.point_uncertainty.T, strict=True)}
        columns |= {"rate [rad/s]": self.rate, "u_rate [rad/s]": self.rate_uncertainty}
        columns |= {
            f"slide_rate [{unit}/s]": self.slide_rate,
            f"u_slide_rate [{unit}/s]": self.slide_rate_uncertainty,
        }
        columns |= {f"pitch [{unit}/rad]": self.pitch, f"u_pitch [{unit}/rad]": self.pitch_uncertainty}
        columns = {name: np.ma.masked_invalid(values) for name, values in columns.items()}
        return {**columns, "status": [ScrewStatus(s).name for s in self.status.tolist()]}

    def to_dict(self) -> dict[str, Any]:
        """Return all results as plain Python values for :mod:`json`; numbers that are not finite are None."""
        names = "time axis point rate slide_rate pitch axis_uncertainty point_uncertainty rate_uncertainty"
        more = "slide_rate_uncertainty pitch_uncertainty origin sigma sigma_angle_rad=sigma_angle sigma_given"
        return {
            "status": [ScrewStatus(s).name for s in self.status.tolist()],
            **plain(self, f"{names} {more}"),
        }


def instantaneous_axes(
    time: ArrayLike,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    sigma: float | None = None,
    sigma_angle: float | None = None,
    origin: ArrayLike | None = None,
) -> InstantaneousAxes:
    """Return the instantaneous helical axis of a body at each of its measured poses.

    Parameters
    ----------
    time : (n,) array_like
        In seconds, rising; five at least.
    position : (n, 3) array_like
        A point of the body, in a fixed frame, any one length unit.
    rotation : (n, 3, 3) array_like
        Attitudes: the body's axes are the columns. Between two poses the body turns by less than half a turn.
    sigma : float, optional
        Standard uncertainty of one coordinate of a position; left out, it is estimated.
    sigma_angle : float, optional
        Standard uncertainty of an attitude about each axis, in rad; left out, it is estimated.
    origin : (3,) array_like, optional
        The axis's point nearest to it is returned; left out, nearest to the mean of the positions.

    Returns
    -------
    InstantaneousAxes
        With a status for each instant: where the direction is uncertain by more than a third of a radian, the angular
        velocity is too small to have an axis.

    Raises
    ------
    RodgenError
        (a ValueError) Shapes that do not fit together, fewer than five poses, times that do not rise (with the row), a
        number that is not finite or a matrix that is no rotation (with its row).

    Notes
    -----
    The motion is smooth: a blow between two poses is spread over its neighbours. The smoothing reaches over about a
    hundred poses at most. Source: derivation ``helical_axis``, entries slides-only, nearest, and changing-turn.

    Examples
    --------
    A body turns about z through (1, 2, ·) at 0.5 rad/s, and rises by 3 a second:

    >>> import numpy as np, rodgen
    >>> t = np.linspace(0, 2, 21)
    >>> turns, _ = rodgen.matrix_from_axis_angle([0, 0, 1], 0.5 * t)
    >>> place = np.array([1, 2, 0]) + turns @ [1.0, 0, 0] + 3 * t[:, None] * [0, 0, 1]
    >>> axes = instantaneous_axes(t, place, turns, sigma=1e-3, sigma_angle=1e-4, origin=(0, 0, 0))
    >>> (axes.axis[10].round(3) + 0.0).tolist(), axes.point[10].round(1).tolist(), float(axes.pitch[10].round(1))
    ([0.0, 0.0, 1.0], [1.0, 2.0, 0.0], 6.0)
    """
    p, R = poses_of(position, rotation)
    t = real_array("time", time)
    if t.shape != p.shape[:1]:
        raise RodgenError(
            f"time {t.shape} and position {p.shape} do not fit together; expected (n,) and (n, 3)"
        )
    if len(t) < _FEWEST:
        raise RodgenError(f"there are {len(t)} poses; velocities need {_FEWEST} at least")
    steps = np.diff(t)
    if not (steps > 0).all():
        row = int(np.argmin(steps > 0)) + 1
        raise RodgenError(
            f"time, row {row} (counted from 0) is not after the row before; expected rising times"
        )
    centre, scale = frame_of(p)
    step = float(np.median(steps))
    lengths = None if sigma is None else (positive_length("sigma", sigma) / scale) ** 2
    angles = None if sigma_angle is None else positive_length("sigma_angle", sigma_angle) ** 2
    moved = _smooth(_Path((p - centre) / scale, steps / step), lengths)
    turned = _smooth(_Turns(R, steps / step), angles)

    near = centre if origin is None else real_array("origin", origin, (3,))
    at, speed = centre + scale * moved.value, moved.rate * scale / step
    omega = turned.rate / step
    inner = np.zeros((len(t), 9, 9))
    inner[:, :3, :3] = turned.covariance[:, 3:6, 3:6] / step**2
    units = np.repeat([scale / step, scale], 3)
    order = np.r_[3:6, :3]
    inner[:, 3:, 3:] = moved.covariance[:, order[:, None], order] * units * units[:, None]
    still = ~(np.abs(omega).max(axis=1) > 0)
    helical, jacobian = kernels.velocity_axis(np.where(still[:, None], 1.0, omega), speed, at, near)
    covariance = jacobian @ inner @ jacobian.mT
    spread = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0))
    direction = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[:, :3, :3])[:, -1], 0))
    none = still | (direction > LOST_RADIANS)
    return InstantaneousAxes(
        time=t,
        axis=_without(none, helical[:, :3]),
        point=_without(none, helical[:, 3:6]),
        rate=np.where(still, 0.0, helical[:, 7]),
        slide_rate=_without(none, helical[:, 8]),
        pitch=_without(none, helical[:, 6]),
        axis_uncertainty=_without(none, direction),
        point_uncertainty=_without(none, spread[:, 3:6]),
        rate_uncertainty=_without(still, spread[:, 7]),
        slide_rate_uncertainty=_without(none, spread[:, 8]),
        pitch_uncertainty=_without(none, spread[:, 6]),
        covariance=_without(none, covariance),
        status=_status(none, helical[:, 8], spread[:, 8], speed, inner[:, 3:6, 3:6]),
        origin=near,
        sigma=math.sqrt(moved.variance) * scale,
        sigma_angle=math.sqrt(turned.variance),
        sigma_given=lengths is not None and angles is not None,
    )


def _texts(values: Array, uncertainty: Array) -> list[str]:
    return [
        " ± ".join(measured(v, u)) if math.isfinite(u) else "–"
        for v, u in zip(values.tolist(), uncertainty.tolist(), strict=True)
    ]


def _without(none: Mask, values: Array) -> Array:
    return np.asarray(np.where(none.reshape(-1, *(1,) * (values.ndim - 1)), np.nan, values))


def _status(none: Mask, slide: Array, spread: Array, speed: Array, covariance: Array) -> Index:
    from scipy.special import chdtrc

    inverse = np.linalg.pinv(covariance, hermitian=True)
    rests = chdtrc(3, np.einsum("ni,nij,nj->n", speed, inverse, speed)) >= ZERO_CHANCE
    line = np.abs(slide) <= TWO_SIDED * spread
    cases = [none & rests, none, line]
    return np.select(
        cases, [ScrewStatus.ZERO, ScrewStatus.COUPLE, ScrewStatus.LINE], ScrewStatus.SCREW
    ).astype(np.int8)


# ---------------------------------------------------------------- smoothing


class _Path:
    """Places of a point: what the smoothing asks of it. A step of it adds, and so does a motion."""

    def __init__(self, reading: Array, steps: Array) -> None:
        self.reading, self.value, self.steps = reading, reading, steps
        self.rate = _slopes(self.differences(), steps)
        self.change = np.zeros_like(self.rate)

    def differences(self) -> Array:
        """Return by what each reading differs from the one before, (n - 1, 3)."""
        return np.diff(self.reading, axis=0)

    def off(self) -> Array:
        """Return by what the readings differ from the solution, (n, 3)."""
        return self.reading - self.value

    def beyond(self) -> tuple[Array, Array, Array]:
        """Return what each step has beyond constant acceleration (n - 1, 3), and its derivatives.

        These are by the value before, and by the integral of the rate, (n - 1, 3, 3) each, with the sign changed.
        """
        h = self.steps[:, None]
        by_rate = self.rate[:-1] * h + self.change[:-1] * h**2 / 2
        same = np.broadcast_to(np.eye(3), (len(h), 3, 3))
        return np.diff(self.value, axis=0) - by_rate, same, same

    def move(self, step: Array) -> None:
        """Add to values, rates and their changes, (n, 9)."""
        self.value = self.value + step[:, :3]
        self.rate, self.change = self.rate + step[:, 3:6], self.change + step[:, 6:]


class _Turns(_Path):
    """Attitudes, (n, 3, 3); rates are angular velocities in fixed axes."""

    def differences(self) -> Array:
        return _turn_of(self.reading[1:] @ self.reading[:-1].mT)

    def off(self) -> Array:
        return _turn_of(self.reading @ self.value.mT)

    def beyond(self) -> tuple[Array, Array, Array]:
        h = self.steps[:, None]
        rate, change = self.rate[:-1], self.change[:-1]
        turn = rate * h + change * h**2 / 2 - h**3 / 12 * np.cross(rate, change)
        moved = _matrix_of(turn)
        beyond = _turn_of(self.value[1:] @ self.value[:-1].mT @ moved.mT)
        cross = np.cross(np.eye(3), turn[:, None, :]).mT * -1
        return beyond, moved, np.eye(3) + cross / 2 + cross @ cross / 6

    def move(self, step: Array) -> None:
        self.value = _matrix_of(step[:, :3]) @ self.value
        self.rate, self.change = self.rate + step[:, 3:6], self.change + step[:, 6:]


def _turn_of(matrix: Array) -> Array:
    axis, angle, _ = axis_angle_from_matrix(matrix)
    return np.asarray(np.where(np.isfinite(axis), axis, 0.0) * angle[..., None])


def _matrix_of(turn: Array) -> Array:
    angle = np.linalg.norm(turn, axis=-1)
    axis = np.where(angle[..., None] > 0, turn, [0.0, 0.0, 1.0]) / np.where(angle > 0, angle, 1.0)[..., None]
    return np.asarray(matrix_from_axis_angle(axis, angle)[0])


def _slopes(differences: Array, steps: Array) -> Array:
    """Return rates at all readings, (n, 3): the means of those of the steps beside."""
    rate = differences / steps[:, None]
    return np.concatenate([rate[:1], (rate[1:] + rate[:-1]) / 2, rate[-1:]])


@dataclass(frozen=True, eq=False)
class _Smoothed:
    """Values and rates, their covariance (n, 9, 9) with those of the changes of rate, and the variance of a reading."""

    value: Array
    rate: Array
    covariance: Array
    variance: float


def _smooth(path: _Path, variance: float | None) -> _Smoothed:
    """Smooth by the likeliest roughness; the variance of a reading is known or None."""
    from scipy.optimize import minimize_scalar

    n = len(path.reading)
    dof = 3 * n - 9
    rounding = 3 * n * (16 * float(np.finfo(float).eps)) ** 2
    walk = _Walk(path.steps)

    def deviance(roughness: float) -> float:
        factor, squares = walk.settle(path, roughness)
        fit = math.log(squares + rounding) * dof if variance is None else squares / variance
        return factor.log_determinant + 9 * (n - 1) * roughness + fit

    options = {"xatol": _NEAR}
    best = float(
        minimize_scalar(deviance, bounds=(_SMOOTHEST, _ROUGHEST), method="bounded", options=options).x
    )
    _, squares = walk.settle(path, best)
    variance = (squares + rounding) / dof if variance is None else variance
    return _Smoothed(path.value, path.rate, variance * walk.covariance(path, best), variance)


class _Walk:
    """Random walks of accelerations, in steps of time, with unit variance for each unit of time."""

    def __init__(self, steps: Array) -> None:
        h = steps
        self.steps = h
        self.noise = np.empty((len(h), 3, 3))
        for i in range(3):
            for j in range(3):
                power = 5 - i - j
                self.noise[:, i, j] = h**power / (power * math.factorial(2 - i) * math.factorial(2 - j))
        self.root = np.kron(np.linalg.inv(np.linalg.cholesky(self.noise)), np.eye(3))
        n = len(h) + 1
        step, row, column = np.meshgrid(np.arange(n - 1), np.arange(9), np.arange(18), indexing="ij")
        self.rows, self.columns = 9 * step + row, 9 * step + column

    def onward(self, path: _Path) -> tuple[Array, Array]:
        """Return what each step has beyond its prediction, (n - 1, 9), and how it carries on a state, (n - 1, 9, 9)."""
        beyond, by_value, by_rate = path.beyond()
        h = self.steps[:, None, None]
        carried = np.zeros((len(h), 9, 9))
        one = np.eye(3)
        carried[:, :3, :3], carried[:, :3, 3:6], carried[:, :3, 6:] = (
            by_value,
            h * by_rate,
            h**2 / 2 * by_rate,
        )
        carried[:, 3:6, 3:6], carried[:, 3:6, 6:], carried[:, 6:, 6:] = one, h * one, one
        changed = np.diff(path.change, axis=0)
        sped = np.diff(path.rate, axis=0) - path.change[:-1] * self.steps[:, None]
        return np.concatenate([beyond, sped, changed], axis=1), carried

    def settle(self, path: _Path, roughness: float) -> tuple[Factorised, float]:
        """Step to the least squares until these stay; return as :meth:`improve`."""
        factor, squares = self.improve(path, roughness)
        for _ in range(_MOST_STEPS):
            last, (factor, squares) = squares, self.improve(path, roughness)
            if last - squares <= _STAY * squares:
                break
        return factor, squares

    def improve(self, path: _Path, roughness: float) -> tuple[Factorised, float]:
        """Make one step to the least squares; return the normal matrix, and the squares after the step."""
        from scipy.sparse import coo_array, diags_array

        n = len(path.reading)
        weight = math.exp(-roughness)
        beyond, carried = self.onward(path)
        J = self.root @ np.concatenate([-carried, np.broadcast_to(np.eye(9), carried.shape)], axis=2)
        jacobian = coo_array(
            (J.ravel(), (self.rows.ravel(), self.columns.ravel())), (9 * (n - 1), 9 * n)
        ).tocsr()
        read = np.zeros((n, 9))
        read[:, :3] = 1.0
        normal = weight * (jacobian.T @ jacobian) + diags_array(read.ravel())
        off = np.zeros((n, 9))
        off[:, :3] = path.off()
        whitened = (self.root @ beyond[..., None]).ravel()
        factor = Factorised(normal.tocsc())
        path.move(factor.solve(off.ravel() - weight * (jacobian.T @ whitened)).reshape(n, 9))
        beyond, _ = self.onward(path)
        squares = weight * float(((self.root @ beyond[..., None]) ** 2).sum()) + float(
            (path.off() ** 2).sum()
        )
        return factor, squares

    def covariance(self, path: _Path, roughness: float) -> Array:
        """Return the covariances of the states, (n, 9, 9), for readings of unit variance.

        H. E. Rauch, F. Tung and C. T. Striebel, AIAA Journal 3, 1965, 1445-1450.
        """
        _, carried = self.onward(path)
        noise = math.exp(roughness) * np.kron(self.noise, np.eye(3))
        n = len(path.reading)
        here, ahead = np.empty((n, 9, 9)), np.empty((n - 1, 9, 9))
        before = _DIFFUSE * np.eye(9)
        for k in range(n):
            gain = np.linalg.solve(before[:3, :3] + np.eye(3), before[:3]).T
            remaining = np.eye(9)
            remaining[:, :3] -= gain
            here[k] = remaining @ before @ remaining.T + gain @ gain.T
            if k < n - 1:
                before = ahead[k] = carried[k] @ here[k] @ carried[k].T + noise[k]
        for k in range(n - 2, -1, -1):
            back = np.linalg.solve(ahead[k], carried[k] @ here[k]).T
            here[k] += back @ (here[k + 1] - ahead[k]) @ back.T
        return here
