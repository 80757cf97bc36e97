"""The axis of screws whose angles are not known exactly: the noise, the uncertainty, and what is not determined."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import positive_length, real_array
from rodgen.kinematics.axis_fit.determinacy import LOST_RADIANS, condition_number, joint_covariance
from rodgen.kinematics.axis_fit.equations import Equations, Factorised, State, first_guess
from rodgen.kinematics.axis_fit.moments import shown, tangents
from rodgen.kinematics.axis_fit.pairs import Line
from rodgen.kinematics.axis_fit.readings import Readings, read_points, read_poses
from rodgen.kinematics.axis_fit.result import (
    TWO_SIDED,
    AxisFit,
    AxisFitStatus,
    Motions,
    nearest,
    remarks_on_noise,
)
from rodgen.kinematics.axis_fit.solve import chi_cut
from rodgen.kinematics.backend import kernels

_EPS = float(np.finfo(float).eps)
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
                kept = np.flatnonzero(places >= 0)
                select[places[kept] + what, 2 * kept + what] += sign
        spread[some] = np.sqrt(np.einsum("ij,ij->j", select, factor.solve(select)).reshape(-1, 2))
    return spread


def _outlier(
    equations: Equations, state: State, basis: Array, factor: Factorised, cost: float, dof: int
) -> int | None:
    """Return the reading of a point, or the pose, without which the squares fall most, where chance explains it not.

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
        own = np.arange(len(some))
        h = weight[some][:, None, None] * part.reshape(len(some), 3, len(some), 3)[own, :, own]
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
