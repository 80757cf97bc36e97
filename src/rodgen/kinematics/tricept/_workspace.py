"""The workspace of a Tricept: the points that the limits of its rods allow, its size, singularities and uncertainty.

Along a beam, α and β fixed, the squared length of a rod is a quadratic in z, so the z that a rod allows is an interval
less another one, and what three rods allow is known exactly. Two variables remain: the volume is a
quadrature over beams of an integral that is exact along each of them, and extremes are searched among the beams' ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import length_limits
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._kinematics import pose
from rodgen.kinematics.tricept._uncertainty import ellipsoid, propagate
from rodgen.views import with_html

Value = Callable[[Array, Array, Array], Array]
"""A function of α, β and z."""

_COARSE = 181  # beams in each direction of the first pass over all tilts: one per degree
_ZOOM = 41  # beams in each direction of a closer pass
_ZOOMS = 44  # each pass is half as wide as the one before


@with_html
@dataclass(frozen=True)
class Beams:
    """The z that the rods allow along beams of fixed α and β.

    Attributes
    ----------
    ends : array (..., 9)
        Values of z in rising order; between two of them the rods either allow every z or none.
    inside : array (..., 8) of bool
        Whether they allow what is between an end and the next.
    """

    ends: Array
    inside: NDArray[np.bool_]


@with_html
@dataclass(frozen=True)
class Workspace:
    """The region of the point that the rods allow.

    Attributes
    ----------
    volume, volume_error : float
        Its volume, and by how much it changed when the number of beams was doubled in both directions, which is about
        three times the remaining error.
    extents : array (3, 2)
        Least and greatest Qx, Qy, Qz.
    pose_extents : array (3, 2)
        Least and greatest α, β (rad) and z.
    tilt : float
        Greatest angle of the middle rod to the base's axis, rad.
    ratio : array (2,)
        Least and greatest det W33 / (8 R² z³). The machine is nowhere singular when both have one sign.
    limits : tuple of two floats
        Least and greatest length of a rod.
    """

    volume: float
    volume_error: float
    extents: Array
    pose_extents: Array
    tilt: float
    ratio: Array
    limits: tuple[float, float]


def reachable(point: ArrayLike, geometry: Geometry, limits: Sequence[float]) -> Any:
    """Return whether the assembled machine can bring its point to a given one.

    Parameters
    ----------
    point : array_like (..., 3)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    limits : pair of floats
        Least and greatest length of a rod.

    Returns
    -------
    array (...) of bool
        False for points that are not finite.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.reachable([[0, 0, 600], [0, 0, 500]], tricept.PAPER, tricept.LEG_LIMITS)
    array([ True, False])
    """
    pose_there, _, status = (np.asarray(x) for x in pose(point, geometry, limits))
    upright = (np.cos(pose_there[..., :2]) > 0).all(axis=-1) & (pose_there[..., 2] > 0)
    return (status == TriceptStatus.REACHABLE) & upright


def beams(
    alpha: ArrayLike, beta: ArrayLike, geometry: Geometry, limits: Sequence[float] | None = None
) -> Beams:
    """Return the z that the rods allow when α and β are given.

    Parameters
    ----------
    alpha, beta : array_like (...)
        Angles in rad.
    geometry : Geometry
        The machine.
    limits : pair of floats, optional
        Least and greatest length of a rod; none when left out.

    Returns
    -------
    Beams
        Only z of the assembled machine: positive, with the point beyond both singularities of the inverse problem. No
        part is inside where cos α or cos β is not positive.

    Notes
    -----
    Kureková et al., eqs. (2) to (4): A² = z² − 2 z h + c with h = R e·n and c = r² + R² − 2 r R e·Oe.

    Examples
    --------
    >>> from rodgen import tricept
    >>> found = tricept.beams(0.0, 0.0, tricept.PAPER, tricept.LEG_LIMITS)
    >>> part = found.inside.argmax()  # the first part that is inside
    >>> found.ends[part : part + 2].round(3)
    array([535.279, 836.698])
    """
    low, high = length_limits(limits, "rod")
    a, b = np.broadcast_arrays(np.asarray(alpha, float), np.asarray(beta, float))
    sa, ca, sb, cb = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
    R, r = geometry.R, geometry.r
    _, qy, qz = geometry.q
    with np.errstate(all="ignore"):
        least = np.maximum(np.maximum(0.0, -qz), qy * sa / np.where(ca > 0, ca, 1) - qz)
        middles, inner, outer = [], [], []
        for cosine, sine in ((1.0, 0.0), (-0.5, np.sqrt(0.75)), (-0.5, -np.sqrt(0.75))):
            h = R * (cosine * sb * ca + sine * sa)
            along = cosine * (cb * cosine - sb * sa * sine) + sine * ca * sine
            c = r * r + R * R - 2 * r * R * along
            middles.append(h)
            inner.append(np.sqrt(np.maximum(low * low - c + h * h, 0.0)))
            outer.append(np.sqrt(np.maximum(high * high - c + h * h, 0.0)))
        h, lo, hi = np.stack(middles), np.stack(inner), np.stack(outer)
        first = np.maximum(least, (h - hi).max(axis=0))
        last = np.maximum((h + hi).min(axis=0), first)
        cuts = np.clip(np.concatenate([h - lo, h + lo]), first, last)
        ends = np.sort(np.concatenate([cuts, [first], [last], [last]]), axis=0)
        centre = (ends[1:] + ends[:-1]) / 2
        centre = np.where(np.isfinite(centre), centre, ends[:-1])
        inside = (ends[1:] > ends[:-1]) & (ca > 0) & (cb > 0)
        for n in range(3):
            inside &= np.abs(centre - h[n]) >= lo[n]
    return Beams(np.moveaxis(ends, 0, -1), np.moveaxis(inside, 0, -1))


def workspace(geometry: Geometry, limits: Sequence[float], samples: int = 400) -> Workspace:
    """Return size and extents of the region that the rods allow the point of the assembled machine.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    limits : pair of floats
        Least and greatest length of a rod.
    samples : int, optional
        Beams in each direction of the finer of the two quadratures.

    Returns
    -------
    Workspace

    Raises
    ------
    RodgenError
        When the rods allow no pose, or the limits are infinite.

    Notes
    -----
    The volume is the integral of |det M33| over the poses. Extremes are found among the ends of beams by closer and
    closer grids around the best one, so they are reached, and not exceeded by any beam of these grids.

    Examples
    --------
    >>> from rodgen import tricept
    >>> found = tricept.workspace(tricept.PAPER, tricept.LEG_LIMITS, samples=100)
    >>> round(found.volume / 1e6, 1)  # litres
    47.5
    """
    low, high = length_limits(limits, "rod")
    if not np.isfinite(high):
        raise RodgenError("limits are infinite; expected the greatest length of a rod")
    box = _tilts(geometry, (low, high))
    coarse, fine = (_volume(geometry, (low, high), box, n) for n in (max(samples // 2, 2), max(samples, 4)))

    def extreme(value: Value, sign: float, *, turning: bool = False) -> float:
        return sign * _greatest(
            lambda *pose: sign * value(*pose), geometry, (low, high), box, turning=turning
        )

    def both(value: Value, *, turning: bool = False) -> list[float]:
        return [extreme(value, sign, turning=turning) for sign in (-1.0, 1.0)]

    qx, qy, qz = geometry.q

    def place(component: int) -> Value:
        def value(alpha: Array, beta: Array, z: Array) -> Array:
            sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
            across, along = ca * qy + sa * (qz + z), ca * (qz + z) - sa * qy
            return (cb * qx + sb * along, across, cb * along - sb * qx)[component]

        return value

    extents = np.array([both(place(n)) for n in range(3)])
    poses = [both(lambda a, b, z: a + 0 * z), both(lambda a, b, z: b + 0 * z), both(lambda a, b, z: z)]
    tilt = extreme(lambda a, b, z: np.arccos(np.cos(a) * np.cos(b)) + 0 * z, 1.0)
    ratio = both(lambda a, b, z: _ratio(geometry, a, b, z), turning=True)
    return Workspace(fine, abs(fine - coarse), extents, np.array(poses), tilt, np.array(ratio), (low, high))


def _tilts(geometry: Geometry, limits: tuple[float, float]) -> Array:
    """Return bounds of α and β around all beams that have a pose."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _COARSE + 2)[1:-1]
    has = np.any(beams(angles[:, None], angles[None, :], geometry, limits).inside, axis=-1)
    if not has.any():
        raise RodgenError(
            f"rods between {limits[0]:g} and {limits[1]:g} allow no pose; expected wider limits"
        )
    step = angles[1] - angles[0]
    tilts = [angles[np.flatnonzero(np.any(has, axis=axis))] for axis in (1, 0)]
    ends: Array = np.array([[x[0] - step, x[-1] + step] for x in tilts])
    return np.clip(ends, -np.pi / 2, np.pi / 2)


def _volume(geometry: Geometry, limits: tuple[float, float], box: Array, samples: int) -> float:
    """Return the integral of |det M33| over the poses: exactly along z, by the midpoint rule over α and β."""
    (a_low, a_high), (b_low, b_high) = box
    a_step, b_step = (a_high - a_low) / samples, (b_high - b_low) / samples
    beta = b_low + b_step * (np.arange(samples) + 0.5)
    _, qy, qz = geometry.q
    total = 0.0
    for alpha in a_low + a_step * (np.arange(samples) + 0.5):
        along_beams = beams(alpha, beta, geometry, limits)
        h = qz + along_beams.ends
        primitive = np.cos(alpha) * h**3 / 3 - qy * np.sin(alpha) * h**2 / 2
        total += float(np.where(along_beams.inside, np.diff(primitive, axis=-1), 0.0).sum())
    return total * float(a_step * b_step)


def _ratio_terms(geometry: Geometry, alpha: Array, beta: Array) -> tuple[Array, ...]:
    """Return the coefficients of det W33 / (8 R² z³) in 1/z."""
    R, r = geometry.R, geometry.r
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    return (
        ca**2 * cb,
        r * sb * (cb - ca) / 2,
        -r * (2 * R * sa**2 * ca * cb + 2 * R * sb**2 + r * sa**2 * cb + r * sb**2 * ca) / 4,
        R * r**2 * sb * (sa**2 * ca * cb + 2 * sa**2 - sb**2 * ca**2) / 4,
    )


def _ratio(geometry: Geometry, alpha: Array, beta: Array, z: Array) -> Array:
    y = 1 / z
    c0, c1, c2, c3 = _ratio_terms(geometry, alpha, beta)
    return np.asarray(c0 + y * (c1 + y * (c2 + y * c3)))


def _greatest(
    value: Value, geometry: Geometry, limits: tuple[float, float], box: Array, *, turning: bool
) -> float:
    """Return the greatest value at the ends of beams; with `turning` also where the ratio turns between them."""
    window, best, at = box, -np.inf, None
    for look in range(_ZOOMS + 1):
        number = _COARSE if look == 0 else _ZOOM
        sides = [np.linspace(low, high, number) for low, high in window]
        alpha, beta = np.meshgrid(*sides, indexing="ij")
        along_beams = beams(alpha, beta, geometry, limits)
        z = [along_beams.ends[..., :-1], along_beams.ends[..., 1:]]
        if turning:
            z += _turns(geometry, alpha, beta, along_beams)
        with np.errstate(all="ignore"):
            values = np.stack([value(alpha[..., None], beta[..., None], x) for x in z])
        values = np.where(along_beams.inside, values, -np.inf)
        values = np.where(np.isfinite(values), values, -np.inf).max(axis=(0, -1))
        place = np.unravel_index(np.argmax(values), values.shape)
        if values[place] > best:
            best, at = float(values[place]), np.array([alpha[place], beta[place]])
        if at is None:
            return best
        half = (box[:, 1] - box[:, 0]) * 0.5 ** (look + 3)
        window = np.clip(np.stack([at - half, at + half], axis=1), box[:, :1], box[:, 1:])
    return best


def _turns(geometry: Geometry, alpha: Array, beta: Array, along_beams: Beams) -> list[Array]:
    """Return the z inside the beams where the ratio is stationary along them; an end where it is not."""
    _, c1, c2, c3 = _ratio_terms(geometry, alpha, beta)
    with np.errstate(all="ignore"):
        root = np.sqrt(c2**2 - 3 * c1 * c3)
        # 3 c3 y² + 2 c2 y + c1 = 0, by the two forms that do not cancel
        stable = -(c2 + np.where(c2 < 0, -1, 1) * root)
        roots = [3 * c3 / stable, stable / c1]
    low, high = along_beams.ends[..., :-1], along_beams.ends[..., 1:]
    return [np.where((x[..., None] > low) & (x[..., None] < high), x[..., None], low) for x in roots]


@with_html
@dataclass(frozen=True)
class UncertaintyMap:
    """Standard uncertainties over a slice of space.

    Attributes
    ----------
    across, up : ndarray, shape (n,) and (m,)
        Coordinates of the points in the slice.
    names : tuple of str
        Which coordinates these are, and which one is held: such as ``("x", "z", "y")``.
    value : float
        At what that is held.
    u : ndarray, shape (m, n, 3)
        u(Qx), u(Qy), u(Qz); NaN outside the workspace.
    largest : ndarray, shape (m, n)
        The largest semi-axis of the standard ellipsoid.
    status : ndarray, shape (m, n) of int8
        Codes of :class:`TriceptStatus`.
    """

    across: Array
    up: Array
    names: tuple[str, str, str]
    value: float
    u: Array
    largest: Array
    status: NDArray[np.int8]


def uncertainty_map(
    geometry: Geometry,
    U: ArrayLike,
    plane: str,
    value: float,
    limits: Sequence[float],
    n: int = 121,
) -> UncertaintyMap:
    """Return the uncertainty of points of a slice of the workspace from the covariance of the parameters.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    U : array_like (5, 5) or (n, n)
        Covariance of the paper's five parameters, or of all.
    plane : {"x", "y", "z"}
        The coordinate that is held.
    value : float
        Its value.
    limits : pair of floats
        Least and greatest length of a rod; outside is no map.
    n : int, optional
        Points along each side.

    Returns
    -------
    UncertaintyMap

    Raises
    ------
    RodgenError
        When the plane is not x, y or z, or no point of the slice is in the workspace.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    >>> found = tricept.uncertainty_map(tricept.PAPER, U_x, "z", 700.0, tricept.LEG_LIMITS, n=41)
    >>> bool(np.nanmin(found.u) > 0.002)
    True
    """
    if plane not in ("x", "y", "z"):
        raise RodgenError(f"{plane!r} is not a coordinate; expected x, y or z")
    held = "xyz".index(plane)
    first, second = (n for n in range(3) if n != held)
    reach = float(limits[1]) + geometry.R + geometry.r + float(np.abs(geometry.q).sum())
    # once to find where the workspace is, once to map it
    across, up = (np.linspace(0.0 if k == 2 else -reach, reach, 161) for k in (first, second))
    for attempt in range(2):
        points = np.empty((len(up), len(across), 3))
        points[..., held], points[..., first], points[..., second] = value, across, up[:, None]
        U_y, status = propagate(points, geometry, U, limits)
        inside = np.asarray(status) == TriceptStatus.REACHABLE
        if not inside.any():
            raise RodgenError(
                f"no point with {plane} = {value:g} is in the workspace; expected another value"
            )
        if attempt == 0:
            sides = (across, inside.any(axis=0)), (up, inside.any(axis=1))
            across, up = (_around(grid, some, n) for grid, some in sides)
    U_y = np.where(inside[..., None, None], U_y, np.nan)
    u = np.sqrt(np.diagonal(U_y, axis1=-2, axis2=-1))
    largest = np.asarray(ellipsoid(U_y).semi_axes)[..., 0]
    names = ("xyz"[first], "xyz"[second], plane)
    return UncertaintyMap(across, up, names, float(value), u, largest, np.asarray(status))


def _around(grid: Array, inside: NDArray[np.bool_], count: int) -> Array:
    """Return `count` values over the part of a grid that is inside, and one step of the grid more on both sides."""
    some = np.flatnonzero(inside)
    return np.linspace(grid[max(some[0] - 1, 0)], grid[min(some[-1] + 1, len(grid) - 1)], count)
