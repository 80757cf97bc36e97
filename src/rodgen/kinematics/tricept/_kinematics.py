"""Point and rods of a Tricept in a pose, and poses with a given point or given rods, with errors of all parameters.

The platform's centre is at z along the middle rod, which is turned by α and β; the point q of the platform is at Q =
Oy(β) Ox(α) (q + z e₃). Ox is the paper's, the transposed of the right-handed rotation: a positive α moves the centre
towards +y.

With errors of all ``PARAMETERS`` at commanded rods, the three closures |m_k − F_k| = A_k are solved for the pose by
Newton's iteration from the nominal pose. Nothing is linearised.

All poses with given rods, assembled or not: equations (7) to (9) of Kureková et al. are three equations for α, β and z.
With w = z², m = cos α + cos β, e = (m r + k₃)/2 and p = r − z sin β the cosines are e/p and m − e/p, and both circles
sin² + cos² = 1 are polynomials in p and w. Their resultant in p is the determinant of a 7x7 Sylvester matrix whose
elements are polynomials of degree 4 in w. Where it is singular w belongs to a solution, so the solutions are among the
eigenvalues of a matrix polynomial: no root is searched for, and none depends on a start. What rounding may hide are
solutions that nearly meet. Real solutions have |m| ≤ 2, so w lies in a known interval. Each candidate is polished by
Newton's method on the three equations, and counts when it solves them to rounding.

Proved in the derivation ``tricept``, entries elimination, two-circles, in-pairs and degree: 28 solutions at most, in
pairs (α, β, z), (−α, −β, −z).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy import tricept as generated
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import broadcast_shapes, length_limits, real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.numerics import Polynomials, roots
from rodgen.kinematics.ports import documented_by
from rodgen.kinematics.tricept._geometry import (
    FIXED,
    GUIDE,
    MOVING,
    PARAMETERS,
    RODS,
    TOOL,
    ZEROS,
    Geometry,
    joints,
)

MOST_POSES = 28
"""Complex solutions of the three equations."""

_ROWS_AT_ONCE = 512
"""Rows in one pass: matrices of 28x28 complex numbers, 6 MB."""
_SHIFT = 0.3 + 1.0j
"""Origin of the eigenvalues, away from the interval −1 … 1 of real solutions."""
_NEAR_REAL = 1e-3
"""Imaginary part up to which an eigenvalue may be real: a double one is known to about the square root of the machine
epsilon. Newton's method rejects what is not a solution."""
_SAME = 1e-6
"""Poses that differ by less in every sine, cosine and relative height are one."""
_SOLVED = 2e-13
"""Residual of a solution, whose terms are near 1: some hundred roundings."""
_NEWTON_STEPS = 60
"""A simple solution needs 2 or 3; where two meet, each step halves the error."""


def direct_all(legs: ArrayLike, geometry: Geometry) -> tuple[Any, Any]:
    """Return all real poses with given rods, the one of the assembled machine first.

    Parameters
    ----------
    legs : array_like (..., 3)
        A0, A1, A-1, from joint to joint.
    geometry : Geometry
        The machine.

    Returns
    -------
    poses : array (..., 28, 3)
        α and β in rad, and z; NaN beyond the last. Poses with both cosines and z positive come first (for rods like the
        paper's there is one), then the others above the base by falling z, then, in the same order, their mirror images
        (−α, −β, −z) below it.
    count : array (...) of int
        How many there are; 0 where a rod is not a positive, finite number. Two poses nearer to each other than 1e-6, as
        where the machine is singular, count as one.

    Raises
    ------
    RodgenError
        When the last axis is not 3 long.

    Notes
    -----
    Kureková et al., eqs. (7) to (9). Computed in float64, some 500 rows a second.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> poses, count = tricept.direct_all([650.0, 700.0, 760.0], tricept.PAPER)
    >>> int(count)
    8
    >>> np.column_stack([np.degrees(poses[:4, :2]), poses[:4, 2]]).round(3)
    array([[   6.379,    9.653,  677.982],
           [   6.896,  156.036,  609.794],
           [ 172.786,    2.565,  607.058],
           [ 171.387, -167.626,  526.682]])
    """
    lengths = real_array("legs", legs, (3,))
    rows = lengths.reshape(-1, 3)
    poses = np.full((len(rows), MOST_POSES, 3), np.nan)
    count = np.zeros(len(rows), int)
    with np.errstate(all="ignore"):
        square = (rows**2).mean(axis=1)
        unit = np.sqrt(
            square + geometry.R**2 + geometry.r**2
        )  # no term of an equation is much greater than 1
        possible = (rows > 0).all(axis=1) & (square > (geometry.R - geometry.r) ** 2)
        # Of a pose no two rods differ by more than the sides of both triangles; and where the rounding of a rod is
        # as large as a platform no pose can be told from another.
        possible &= np.ptp(rows, axis=1) <= (geometry.R + geometry.r) * 1.7321
        possible &= unit * np.finfo(float).eps < min(geometry.R, geometry.r)
        good = np.flatnonzero(np.isfinite(unit) & possible)
        for start in range(0, len(good), _ROWS_AT_ONCE):
            part = good[start : start + _ROWS_AT_ONCE]
            poses[part], count[part] = _solved_rows(_Rods(rows[part], geometry, unit[part]))
    return poses.reshape(*lengths.shape[:-1], MOST_POSES, 3), count.reshape(lengths.shape[:-1])[()]


class _Rods:
    """The three equations of many rows, in a unit of each row's size."""

    def __init__(self, rods: Array, geometry: Geometry, unit: Array) -> None:
        self.unit = unit
        self.R, self.r = geometry.R / unit, geometry.r / unit
        s0, s1, sm = (rods / unit[:, None]).T ** 2
        self.c1 = self.R**2 + self.r**2 - (s0 + s1 + sm) / 3
        self.c2 = (s1 - sm) / np.sqrt(3)
        self.c3 = (2 * s0 - s1 - sm) / 3

    def __len__(self) -> int:
        return len(self.unit)

    def take(self, index: NDArray[np.int64]) -> _Rods:
        """Return the equations of some rows, which may repeat."""
        some = object.__new__(_Rods)
        for name in ("unit", "R", "r", "c1", "c2", "c3"):
            setattr(some, name, getattr(self, name)[index])
        return some


def _solved_rows(rods: _Rods) -> tuple[Array, NDArray[np.int64]]:
    row, start = _candidates(rods)
    some = rods.take(row)
    pose, good = _polished(some, start)
    return _distinct(len(rods), row[good], pose[good], rods)


# candidates --------------------------------------------------------------------------------------------


def _candidates(rods: _Rods) -> tuple[NDArray[np.int64], Array]:
    """Return starts near every real solution with z > 0, and the row of each.

    With h the greatest possible z, w = h² ω and p = r − h s: then ω and s are numbers up to 1, however low the
    platform.
    """
    R, r = rods.R, rods.r
    high = -rods.c1 + 2 * R * r
    low = np.maximum(-rods.c1 - 2 * R * r, 0) / high
    middle, half = (1 + low) / 2, (1 - low) / 2
    top = np.sqrt(high)
    eigenvalues = _eigenvalues(rods, top, middle, half)
    real = (np.abs(eigenvalues.imag) < _NEAR_REAL) & (np.abs(eigenvalues.real) < 1 + _NEAR_REAL)
    row, at = np.nonzero(real)
    some, h = rods.take(row), top[row]
    omega = np.clip(middle[row] + half[row] * eigenvalues.real[row, at], 1e-12, None)
    m = (h * h * omega + some.c1) / (some.R * some.r)
    e = (m * some.r + some.c3 / some.R) / 2
    k2 = some.c2 / some.R

    f = _circle_of_beta(omega, m, e, some.r, h)
    quartic = roots(np.stack(f[::-1], axis=1))
    near = np.abs(quartic.imag) < 0.03 * (1 + np.abs(quartic))
    at, which = np.nonzero(near)
    s, row, omega, m, e, k2 = quartic.real[at, which], row[at], omega[at], m[at], e[at], k2[at]
    r, h = some.r[at], h[at]

    root_of_omega = np.sqrt(omega)
    p = r - h * s
    spread = 2 * h * omega + r * s
    sin_beta = s / root_of_omega
    cos_alpha = e / p
    sin_alpha = -k2 * root_of_omega / spread
    off_circle = np.abs(np.hypot(cos_alpha, sin_alpha) - 1)
    starts = []

    def add(keep: NDArray[np.bool_], sine: Array, cosine: Array, cosine_beta: Array) -> None:
        angles = np.arctan2(sine, cosine), np.arctan2(sin_beta, cosine_beta)
        pose = np.stack([*angles, h * root_of_omega], axis=1)
        keep = keep & np.isfinite(pose).all(axis=1)
        starts.append((row[keep], pose[keep]))

    add(off_circle < 0.2, sin_alpha, cos_alpha, m - cos_alpha)
    # where (8) is 0 = 0 both signs of sin α may solve it, and near there the formula is not a good start
    unknown = (np.abs(spread) < 0.2 * (h + r)) & (np.abs(cos_alpha) < 1.1)
    root = np.sqrt(np.clip(1 - cos_alpha**2, 0, None))
    for sign in (1.0, -1.0):
        add(unknown, sign * root, cos_alpha, m - cos_alpha)
    # where p and e are nothing their quotient is unknown: cos α follows from the other circle
    lost = (np.abs(p) < 3e-3 * r) & (np.abs(sin_beta) < 1.1)
    root = np.sqrt(np.clip(1 - sin_beta**2, 0, None))
    for sign in (1.0, -1.0):
        for other in (1.0, -1.0):
            cosine = np.clip(m - sign * root, -1, 1)
            add(lost, other * np.sqrt(1 - cosine**2), cosine, sign * root)
    return np.concatenate([x[0] for x in starts]), np.concatenate([x[1] for x in starts])


def _circle_of_beta(omega: Any, m: Any, e: Any, r: Any, h: Any) -> tuple[Any, ...]:
    """Return the coefficients in s of ω (m p − e)² + p² (s² − ω), p = r − h s, the highest first."""
    a, b = m * r - e, m * h * -1
    none = omega * 0
    return (
        none + h * h,
        none + r * h * -2,
        omega * (b * b - h * h) + r * r,
        omega * (a * b + r * h) * 2,
        omega * (a * a - r * r),
    )


def _eigenvalues(rods: _Rods, top: Array, middle: Array, half: Array) -> NDArray[np.complex128]:
    """Return where the Sylvester matrix is singular: values of t in ω = middle + half t."""

    def constant(values: Array) -> Polynomials:
        return Polynomials(values[:, None])

    r, h = constant(rods.r), constant(top)
    w = Polynomials(np.stack([middle + half * _SHIFT, half + 0j], axis=1))
    k2_squared = constant((rods.c2 / rods.R) ** 2)
    m = (w * constant(top**2) + constant(rods.c1)) * constant(1 / (rods.R * rods.r))
    e = (m * r + constant(rods.c3 / rods.R)) * 0.5
    f = _circle_of_beta(w, m, e, r, h)
    # e² D² + k₂² ω p² − p² D² with D = 2 h ω + r s, the circle of α, with r² times the other added: no s⁴ is left
    a, b, square = m * r - e, m * h * -1, e * e
    g = (
        w * h * h * h * r * -4,
        square * r * r + w * (h * h * (k2_squared + r * r * 7) + r * r * b * b) - w * w * h * h * h * h * 4,
        w * r * (h * (square * 4 - k2_squared * 2 - r * r * 2 + w * h * h * 8) + r * a * b * 2),
        w * (w * h * h * (square - r * r) * 4 + r * r * (k2_squared + a * a - r * r)),
    )
    sylvester = np.zeros((5, len(rods), 7, 7), complex)
    for rows, coefficients in ((range(3), f), (range(3, 7), g)):
        for shift, i in enumerate(rows):
            for j, polynomial in enumerate(coefficients):
                for power, values in enumerate(polynomial.values.T):
                    sylvester[power, :, i, j + shift] = values
    # 1 / (t − shift) solves the reversed problem, whose leading matrix is regular
    companion = np.zeros((len(rods), 28, 28), complex)
    companion[:, :7] = -np.linalg.solve(sylvester[0], np.concatenate(list(sylvester[1:]), axis=2))
    companion[:, np.arange(7, 28), np.arange(21)] = 1.0
    return np.asarray(_SHIFT + 1 / np.linalg.eigvals(companion))


# polish ------------------------------------------------------------------------------------------------


def _equations(rods: _Rods, pose: Array) -> tuple[Array, Array]:
    """Return the left sides of (7) to (9), and their derivatives W33."""
    R, r = rods.R, rods.r
    (sa, sb), (ca, cb), z = np.sin(pose[:, :2]).T, np.cos(pose[:, :2]).T, pose[:, 2]
    left = [
        rods.c1 + z**2 - R * r * (ca + cb),
        rods.c2 + R * sa * (2 * z + r * sb),
        rods.c3 + R * (2 * z * ca * sb + r * (cb - ca)),
    ]
    rows = [
        [R * r * sa, R * r * sb, 2 * z],
        [R * ca * (2 * z + r * sb), R * r * sa * cb, 2 * R * sa],
        [R * sa * (r - 2 * z * sb), R * (2 * z * ca * cb - r * sb), 2 * R * ca * sb],
    ]
    return np.stack(left, axis=1), np.moveaxis(np.array(rows), -1, 0)


def _polished(rods: _Rods, start: Array) -> tuple[Array, NDArray[np.bool_]]:
    pose = start.copy()
    active = np.arange(len(pose))
    for _ in range(_NEWTON_STEPS):
        some = rods.take(active)
        left, W = _equations(some, pose[active])
        a, b, c = W[:, :, 0], W[:, :, 1], W[:, :, 2]
        across = np.cross(b, c)
        determinant = (a * across).sum(axis=1)
        step = -np.stack(
            [(left * across).sum(axis=1), (np.cross(c, a) * left).sum(axis=1), (np.cross(a, b) * left).sum(axis=1)],
            axis=1,
        ) / np.where(determinant == 0, 1, determinant)[:, None]  # fmt: skip
        size = np.abs(step).max(axis=1)
        pose[active] += step * np.minimum(1, 0.5 / np.maximum(size, 0.5))[:, None]
        active = active[(size > 1e-15) & np.isfinite(size)]
        if not len(active):
            break
    left, _ = _equations(rods, pose)
    return pose, np.abs(left).max(axis=1, initial=0.0) < _SOLVED


# answer ------------------------------------------------------------------------------------------------


def _distinct(rows: int, row: NDArray[np.int64], pose: Array, rods: _Rods) -> tuple[Array, NDArray[np.int64]]:
    """Return solutions above the base in one table, each once and in order, with their mirror images."""
    poses = np.full((rows, MOST_POSES, 3), np.nan)
    pose = pose * np.where(pose[:, 2:] < 0, -1.0, 1.0)
    place, most = _places(rows, row)
    parts = np.full((rows, most, 5), np.nan)
    parts[row, place] = np.column_stack([np.cos(pose[:, :2]), np.sin(pose[:, :2]), pose[:, 2]])
    is_real = np.isfinite(parts[..., 0])
    for n in range(1, most):
        near = (np.abs(parts[:, :n] - parts[:, n, None]) < _SAME).all(axis=2) & is_real[:, :n]
        is_real[:, n] &= ~near.any(axis=1)
    cosines = parts[..., :2]
    physical = (cosines > 0).all(axis=2) & is_real
    order = np.lexsort((-np.nan_to_num(parts[..., 4]), ~physical, ~is_real), axis=1)
    parts = np.take_along_axis(parts, order[..., None], axis=1)
    above = np.minimum(is_real.sum(axis=1), MOST_POSES // 2)
    for n in range(min(most, MOST_POSES // 2)):
        there = n < above
        ca, cb, sa, sb, z = parts[there, n].T
        distinct = np.column_stack([np.arctan2(sa, ca), np.arctan2(sb, cb), z * rods.unit[there]])
        poses[there, n] = distinct
        poses[np.flatnonzero(there), n + above[there]] = -distinct
    return poses, 2 * above


def _places(rows: int, row: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the number of each entry within its row, from 0, and how many the fullest row has."""
    order = np.argsort(row, kind="stable")
    counts = np.bincount(row, minlength=rows)
    first = np.cumsum(counts) - counts
    place = np.empty(len(row), int)
    place[order] = np.arange(len(row)) - first[row[order]]
    return place, int(counts.max(initial=1))


@documented_by(generated.tricept_point, ["point"])
def point(pose: ArrayLike, geometry: Geometry) -> Any:
    """Return the place of the platform's point in a pose.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q counts.

    Returns
    -------
    point
        NaN where an input is.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.point([0.1, 0.0, 600.0], tricept.PAPER).round(3)
    array([  0.   ,  59.9  , 597.002])
    """
    return call_kernel(kernels.tricept_point, (pose, *geometry.q))[0]


@documented_by(generated.tricept_point, ["rotation"])
def rotation(pose: ArrayLike) -> Any:
    """Return the orientation of the platform in a pose, Oy(β) Ox(α).

    Returns
    -------
    rotation
        Rotation matrix, from the platform's axes to the base's.

    Notes
    -----
    In the usual, right-handed sense the angle about x is −α.

    Examples
    --------
    >>> from rodgen import tricept
    >>> (tricept.rotation([0.1, 0.2, 600.0])[:, 2] * 600).round(3)  # the middle rod
    array([118.606,  59.9  , 585.102])
    """
    return call_kernel(kernels.tricept_point, (pose, 0.0, 0.0, 0.0))[1]


@documented_by(generated.tricept_legs)
def legs(pose: ArrayLike, geometry: Geometry) -> Any:
    """Return the lengths of the three rods in a pose.

    Parameters
    ----------
    geometry : Geometry
        The machine.

    Returns
    -------
    legs
        The rods at 0°, +120° and −120°, from joint to joint, computed as lengths of vectors.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.legs([0.0, 0.0, 456.0], tricept.PAPER)
    array([494., 494., 494.])
    """
    return call_kernel(kernels.tricept_legs, (pose, *geometry.radii))


@documented_by(generated.tricept_inverse)
def inverse(
    point: ArrayLike, geometry: Geometry, limits: Sequence[float] | None = None
) -> tuple[Any, Any, Any]:
    """Return all poses in which the platform's point is at a given point, and the rods they need.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q is brought to `point`.
    limits : pair of floats, optional
        Least and greatest length of a rod; none when left out.

    Returns
    -------
    poses
        The rows are for the signs (S, K) = (+, +), (+, −), (−, +), (−, −) of the two roots; the
        first is that of the machine as it is assembled, for points before the base. A point behind it, where Qz is
        negative, has no such pose: there cos β is not positive in the first row, either. With K = −1 the platform is
        turned by half a turn about the middle rod, with S = −1 it is below the base; the rods may be within the limits
        there, too.
    status
        REACHABLE, OUT_OF_LIMITS, DOUBLE_POSE where two of the poses meet to rounding,
        GIMBAL_LOCK where an angle is not determined and 0 stands for it. Poses and rods are NaN where it is UNREACHABLE
        or INVALID.

    Notes
    -----
    That there are these four and no others is proved there, too. float32 input gives float32 results.

    Examples
    --------
    >>> from rodgen import tricept
    >>> poses, legs, status = tricept.inverse([100.0, 50.0, 650.0], tricept.PAPER, tricept.LEG_LIMITS)
    >>> legs[0].round(3)
    array([637.318, 689.585, 730.485])
    >>> [tricept.TriceptStatus(code).name for code in status]
    ['REACHABLE', 'REACHABLE', 'REACHABLE', 'REACHABLE']
    """
    arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"))
    return call_kernel(kernels.tricept_inverse, arguments)  # type: ignore[no-any-return]


@documented_by(generated.tricept_pose)
def pose(point: ArrayLike, geometry: Geometry, limits: Sequence[float] | None = None) -> tuple[Any, Any, Any]:
    """Return the pose in which the assembled machine has its point at a given one, and its rods.

    Parameters
    ----------
    geometry : Geometry
        As for :func:`inverse`.
    limits : pair of floats, optional
        As for :func:`inverse`.

    Returns
    -------
    pose
        The first row of what :func:`inverse` gives.
    status
        As for :func:`inverse`. UNREACHABLE, too, for points behind the base: there
        neither cosine is positive in the first row, and the assembled machine has no such pose.

    Notes
    -----
    With S = K = +1. It takes a third of the time of all four poses.

    Examples
    --------
    >>> from rodgen import tricept
    >>> pose, legs, status = tricept.pose([100.0, 50.0, 650.0], tricept.PAPER, tricept.LEG_LIMITS)
    >>> legs.round(3)
    array([637.318, 689.585, 730.485])
    """
    arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"))
    poses, rods, status = call_kernel(kernels.tricept_pose, arguments)
    lost = lost_behind(point, geometry, status)
    if lost is None:
        return poses, rods, status
    poses, rods = (np.where(lost[..., None], np.nan, x) for x in (poses, rods))
    return poses, rods, np.where(lost, np.int8(TriceptStatus.UNREACHABLE), status)


def lost_behind(point: ArrayLike, geometry: Geometry, status: Any) -> Any:
    """Return which points have a pose by their status, but lie behind the base, (...); None where none does."""
    lost = (status <= TriceptStatus.OUT_OF_LIMITS) & behind(point, geometry)
    return None if isinstance(lost, np.ndarray | np.bool_) and not lost.any() else lost


def behind(point: Any, geometry: Geometry) -> Any:
    """Return which points are reached by no pose with positive cosines, (...); others may be out of reach, too.

    cos α and cos β have the signs of √(|Q|² − qx² − qy²) g + qy Qy and qx Qx + g Qz, with g = √(Qx² + Qz² − qx²).
    """
    x, y, z = np.moveaxis(np.asarray(point, dtype=float) if np.ndim(point) < 2 else point, -1, 0)
    if geometry.q == (0.0, 0.0, 0.0):
        return z <= 0
    qx, qy, _ = geometry.q
    g = np.sqrt(np.maximum(x * x + z * z - qx * qx, 0))
    root = np.sqrt(np.maximum(x * x + y * y + z * z - qx * qx - qy * qy, 0))
    return (qx * x + g * z <= 0) | (root * g + qy * y <= 0)


@documented_by(generated.tricept_direct)
def direct(legs: ArrayLike, geometry: Geometry) -> tuple[Any, Any]:
    """Return the pose of the machine as it is assembled, from its rods: cos α, cos β and z are positive.

    Parameters
    ----------
    legs
        From joint to joint.
    geometry : Geometry
        The machine.

    Returns
    -------
    status
        REACHABLE, SINGULAR where the pose is not determined to first order; NaN where
        it is UNREACHABLE, because there is no such pose, or INVALID.

    Notes
    -----
    Newton's method. Rods from which it does not come to a pose are solved by :func:`direct_all`, except in Dask arrays;
    so UNREACHABLE is a statement about the equations. Where there are several such poses, which needs rods far from the
    paper's, it is one of them.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> pose, status = tricept.direct([650.0, 700.0, 760.0], tricept.PAPER)
    >>> np.degrees(pose[:2]).round(3), round(float(pose[2]), 3)
    (array([6.379, 9.653]), 677.982)
    """
    pose, status = call_kernel(kernels.tricept_direct, (legs, *geometry.radii))
    if not isinstance(status, np.ndarray | np.generic):
        return pose, status
    lost = np.asarray(status) == TriceptStatus.UNREACHABLE
    if not lost.any():
        return pose, status
    rows = np.broadcast_to(np.asarray(legs), np.shape(pose))[lost]
    poses, count = direct_all(rows, geometry)
    first = poses[:, 0]
    is_reached = (count > 0) & (np.cos(first[:, :2]) > 0).all(axis=1) & (first[:, 2] > 0)
    pose, status = np.array(pose), np.array(status)
    pose[lost] = np.where(is_reached[:, None], first, np.nan)
    status[lost] = np.where(is_reached, TriceptStatus.REACHABLE, TriceptStatus.UNREACHABLE)
    return pose, status


_COLUMNS = {
    name: [PARAMETERS.index(member) for member in members]
    for name, members in (
        ("rods", RODS),
        ("zeros", ZEROS),
        ("fixed", FIXED),
        ("moving", MOVING),
        ("q", TOOL),
        ("guide", tuple(GUIDE)),
    )
}
_r, _R = PARAMETERS.index("r"), PARAMETERS.index("R")

# Quadratic convergence: errors of a thousandth of the machine need four steps.
_MOST_STEPS = 12
_BLOCK = 20_000


def disturbed_point(pose: ArrayLike, geometry: Geometry, errors: ArrayLike) -> tuple[Any, Any]:
    """Return the place of the tool when the rods are commanded for a pose and the parameters have errors.

    Parameters
    ----------
    pose : array_like (..., 3)
        The nominal pose: α and β in rad, and z.
    geometry : Geometry
        The nominal machine.
    errors : array_like (..., n)
        Errors of all ``PARAMETERS``, lengths and rad: true value minus nominal one.

    Returns
    -------
    point : array (..., 3)
        The true place of the tool; NaN where the status is UNREACHABLE or INVALID.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`: REACHABLE; UNREACHABLE where no pose near the nominal one closes; INVALID.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> errors = np.zeros(len(tricept.PARAMETERS))
    >>> errors[tricept.PARAMETERS.index("zero_A0")] = 0.1
    >>> tricept.disturbed_point([0.0, 0.0, 600.0], tricept.PAPER, errors)[0].round(5) + 0.0
    array([-1.2715000e-01,  0.0000000e+00,  6.0003495e+02])
    """
    poses, shifts = real_array("pose", pose, (3,)), real_array("errors", errors, (len(PARAMETERS),))
    shape = broadcast_shapes({"pose": (poses, 1), "errors": (shifts, 1)})
    flat_pose = np.broadcast_to(poses, (*shape, 3)).reshape(-1, 3)
    flat = np.broadcast_to(shifts, (*shape, len(PARAMETERS))).reshape(-1, len(PARAMETERS))
    points, status = np.empty((len(flat), 3)), np.empty(len(flat), np.int8)
    for start in range(0, len(flat), _BLOCK):
        part = slice(start, start + _BLOCK)
        points[part], status[part] = _solved(flat_pose[part], geometry, flat[part])
    return points.reshape(*shape, 3), status.reshape(shape)[()]


def _solved(pose: Array, geometry: Geometry, errors: Array) -> tuple[Array, NDArray[np.int8]]:
    fixed, moving = joints(geometry)
    n = len(errors)
    rods = np.asarray(legs(pose, geometry)) + errors[:, _COLUMNS["rods"]] + errors[:, _COLUMNS["zeros"]]
    base = (
        fixed + errors[:, _R, None, None] * fixed / geometry.R + errors[:, _COLUMNS["fixed"]].reshape(n, 3, 3)
    )
    platform = (
        moving
        + errors[:, _r, None, None] * moving / geometry.r
        + errors[:, _COLUMNS["moving"]].reshape(n, 3, 3)
    )
    tool = np.asarray(geometry.q) + errors[:, _COLUMNS["q"]]
    guide = errors[:, _COLUMNS["guide"]]
    now = pose.copy()
    # α and β act on lengths of the machine's size
    size = np.array([geometry.R, geometry.R, 1.0]) / geometry.R
    left = np.ones(n, bool)
    with np.errstate(all="ignore"):
        for _ in range(_MOST_STEPS):
            some = np.flatnonzero(left)
            if not some.size:
                break
            answer = call_kernel(
                kernels.tricept_closure,
                (now[some], rods[some], base[some], platform[some], tool[some], guide[some]),
            )
            step = _solve(answer[_JACOBIAN], answer[_RESIDUAL])
            now[some] -= step
            # a step this small was the last one: the next would be its square
            left[some] = ~(np.abs(step * size).max(axis=1) <= 1e-9)
        points = np.asarray(
            call_kernel(kernels.tricept_closure, (now, rods, base, platform, tool, guide))[_PLACE]
        )
    invalid = ~(np.isfinite(pose).all(axis=1) & np.isfinite(errors).all(axis=1))
    far = np.abs(now[:, :2] - pose[:, :2]).max(axis=1) > 1.0
    bad = left | far | ~np.isfinite(points).all(axis=1)
    status = np.where(invalid, TriceptStatus.INVALID, np.where(bad, TriceptStatus.UNREACHABLE, 0))
    return np.where((bad | invalid)[:, None], np.nan, points), status.astype(np.int8)


def _solve(matrix: Array, right: Array) -> Array:
    """Return solutions of three equations by cross products: a singular matrix gives infinite steps."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    solved: Array = (columns @ right[..., None])[..., 0] / (a * columns[..., 0]).sum(axis=-1)[:, None]
    return solved


# Order of the kernel's outputs.
_RESIDUAL, _PLACE, _JACOBIAN = 0, 1, 2
