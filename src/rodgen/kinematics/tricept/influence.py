"""The influence of an element of U_x on an element of U_y along beams of the workspace: the paper's figures 3 to 10.

Along a beam (α and β fixed) the influence of a base matrix is √S P/D², polynomials in z: D = det W33, and S is 1 or the
square of a rod or of a product of two. Its stationary points are among the real roots of S′PD + 2S(P′D − 2PD′); its
least and greatest values are there or at the ends of the beam.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import length_limits
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.numerics import Polynomials, roots
from rodgen.kinematics.tricept._bounds import ELEMENTS
from rodgen.kinematics.tricept._geometry import PARAMETERS, Geometry
from rodgen.kinematics.tricept._kinematics import point
from rodgen.views import with_html

Box = tuple[ArrayLike, ArrayLike]

# On the beam, scaled to -1…1, coefficients below this are rounding.
_NEGLIGIBLE = 1e-13
# A complex root this near the beam may be a double real one; to evaluate there as well costs nothing.
_NEARLY_REAL = 1e-3


@with_html
@dataclass(frozen=True)
class Influence:
    """Least and greatest influence along beams.

    Attributes
    ----------
    alpha, beta : ndarray, shape (...)
        The beams, rad.
    least, greatest : ndarray, shape (...)
        Of the element of U_y per unit of the element of U_x; NaN where no part of the beam is in the region.
    z_least, z_greatest : ndarray, shape (...)
        Where on the beam.
    pair : tuple of str
        The two parameters of the element of U_x.
    element : str
        The element of U_y.
    """

    alpha: Array
    beta: Array
    least: Array
    greatest: Array
    z_least: Array
    z_greatest: Array
    pair: tuple[str, str]
    element: str


def influence_map(
    alpha: ArrayLike,
    beta: ArrayLike,
    geometry: Geometry,
    pair: Sequence[str],
    element: str,
    *,
    limits: Sequence[float] | None = None,
    box: Box | None = None,
) -> Influence:
    """Return the least and the greatest influence of one element of U_x on one of U_y along each beam.

    Parameters
    ----------
    alpha, beta : array_like (...)
        Beams, rad; they broadcast. |α| and |β| below π/2.
    geometry : Geometry
        The machine.
    pair : two of "A0", "A1", "A-1", "r", "R"
        The element of U_x: a variance when both are the same, else a covariance and its mirror image.
    element : {"xx", "yy", "zz", "xy", "xz", "yz"}
        The element of U_y.
    limits : pair of floats, optional
        Least and greatest length of a rod.
    box : two corners, optional
        Where the point is to be. Limits, box, or both must be given.

    Returns
    -------
    Influence

    Raises
    ------
    RodgenError
        When a name is unknown, or the beams have no end.

    Notes
    -----
    Kureková et al., sec. 4; the polynomials are derived in ``tricept_uncertainty``.

    Examples
    --------
    >>> from rodgen import tricept
    >>> found = tricept.influence_map(0.0, 0.0, tricept.PAPER, ("A0", "A0"), "zz", limits=tricept.LEG_LIMITS)
    >>> round(float(found.least), 5), round(float(found.z_least), 2)  # A²/(9z²), A² = z² + (R - r)²
    (0.11684, 836.7)
    """
    i, j = _parameters(pair)
    if element not in ELEMENTS:
        raise RodgenError(f"{element!r} is not an element of U_y; expected one of {', '.join(ELEMENTS)}")
    if limits is None and box is None:
        raise RodgenError("neither limits nor a box: the beams have no end; expected one of them")
    angles = np.broadcast_arrays(np.asarray(alpha, float), np.asarray(beta, float))
    shape = angles[0].shape
    a, b = (x.ravel() for x in angles)
    numerator, denominator, squares = (
        np.asarray(x, float) for x in kernels.tricept_beam(a, b, geometry.R, geometry.r, geometry.q)
    )
    S, P = _parts(numerator, squares, i, j, *ELEMENTS[element])
    low, high, pieces = _pieces(a, b, geometry, squares, limits, box)
    length = np.where(high > low, high - low, 1.0)
    beam = Polynomials(np.stack([low + length / 2, length / 2], axis=1))  # z from -1 to 1 along the beam
    S, P, D = S.of(beam), P.of(beam), Polynomials(denominator).of(beam)
    stationary = S.derivative() * P * D + S * (P.derivative() * D - P * D.derivative() * 2.0) * 2.0
    ends = (pieces - low[:, None]) * 2 / length[:, None] - 1
    places = np.concatenate([ends, _roots_on_beam(stationary.values)], axis=1)
    z = low[:, None] + (places + 1) / 2 * length[:, None]
    inside = np.isfinite(places) & _allowed(z, a, b, geometry, squares, limits, box)
    with np.errstate(all="ignore"):
        values = np.sqrt(np.maximum(S(places), 0)) * P(places) / D(places) ** 2
    inside &= np.isfinite(values)
    some = inside.any(axis=1)
    rows = np.arange(len(a))
    found = []
    for worst, choose in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        n = choose(np.where(inside, values, worst), axis=1)
        found.append(tuple(np.where(some, x[rows, n], np.nan).reshape(shape)[()] for x in (values, z)))
    (least, z_least), (greatest, z_greatest) = found
    return Influence(
        angles[0], angles[1], least, greatest, z_least, z_greatest, (PARAMETERS[i], PARAMETERS[j]), element
    )


def _parameters(pair: Sequence[str]) -> tuple[int, int]:
    if isinstance(pair, str) or len(pair) != 2:
        raise RodgenError(f"{pair!r} is not an element of U_x; expected two of {', '.join(PARAMETERS[:5])}")
    for name in pair:
        if name not in PARAMETERS[:5]:
            raise RodgenError(
                f"{name!r} is none of the paper's parameters; expected {', '.join(PARAMETERS[:5])}"
            )
    i, j = sorted(PARAMETERS.index(name) for name in pair)
    return i, j


def _parts(
    numerator: Array, squares: Array, i: int, j: int, k: int, m: int
) -> tuple[Polynomials, Polynomials]:
    """Return S and P of the influence of (i, j) on (k, m)."""

    def entry(row: int, column: int) -> Polynomials:
        return Polynomials(numerator[:, row, column])

    one = Polynomials(np.ones((len(numerator), 1)))
    if i == j:
        P = entry(k, i) * entry(m, i)
        return one, (P * Polynomials(squares[:, i]) if i < 3 else P)
    S = one
    for index in (i, j):
        if index < 3:
            S = S * Polynomials(squares[:, index])
    return S, entry(k, i) * entry(m, j) + entry(k, j) * entry(m, i)


def _line(a: Array, b: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return point and direction of the beams: Q = point + z direction."""
    zero = np.zeros_like(a)
    start = np.asarray(point(np.stack([a, b, zero], axis=-1), geometry))
    return start, np.asarray(point(np.stack([a, b, zero + 1], axis=-1), geometry)) - start


def _pieces(
    a: Array,
    b: Array,
    geometry: Geometry,
    squares: Array,
    limits: Sequence[float] | None,
    box: Box | None,
) -> tuple[Array, Array, Array]:
    """Return the least and the greatest place in the region, and where its parts may begin and end (else NaN)."""
    marks = []
    with np.errstate(all="ignore"):
        if limits is not None:
            for limit in length_limits(limits, "rod"):
                p = squares[:, :, 1] / 2
                root = np.sqrt(p**2 - squares[:, :, 0] + limit**2)
                marks += [-p - root, -p + root]
        if box is not None:
            start, direction = _line(a, b, geometry)
            for corner in box:
                marks.append((np.asarray(corner, float) - start) / direction)
    places = np.concatenate(marks, axis=1)
    # only S = 1: the platform is before the base
    places = np.where(np.isfinite(places) & (places > max(0.0, -geometry.q[2])), places, np.nan)
    good = _allowed(places, a, b, geometry, squares, limits, box)
    places = np.where(good, places, np.nan)
    none = ~good.any(axis=1)
    low = np.where(none, 0.0, np.min(np.where(good, places, np.inf), axis=1))
    high = np.where(none, 1.0, np.max(np.where(good, places, -np.inf), axis=1))
    return low, high, places


def _allowed(
    z: Array,
    a: Array,
    b: Array,
    geometry: Geometry,
    squares: Array,
    limits: Sequence[float] | None,
    box: Box | None,
) -> NDArray[np.bool_]:
    """Return which places on the beams are in the region, its border included to rounding."""
    good = np.isfinite(z)
    with np.errstate(invalid="ignore"):
        if limits is not None:
            least, greatest = length_limits(limits, "rod")
            rods = squares[:, None, :, 0] + z[..., None] * (squares[:, None, :, 1] + z[..., None])
            room = 1e-9 * geometry.R**2
            good = good & (rods >= least**2 - room).all(axis=-1) & (rods <= greatest**2 + room).all(axis=-1)
        if box is not None:
            start, direction = _line(a, b, geometry)
            places = start[:, None] + z[..., None] * direction[:, None]
            low, high = (np.asarray(corner, float) for corner in box)
            room = 1e-9 * geometry.R
            good = good & (places >= low - room).all(axis=-1) & (places <= high + room).all(axis=-1)
    return np.asarray(good)


def _roots_on_beam(p: Array) -> Array:
    """Return the real roots between -1 and 1, NaN for the others; as many columns as the greatest degree."""
    found = np.full((len(p), max(p.shape[1] - 1, 1)), np.nan)
    size = np.abs(p).max(axis=1, keepdims=True)
    scaled = np.divide(p, size, out=np.zeros_like(p), where=(size > 0) & np.isfinite(size))
    big = np.abs(scaled) > _NEGLIGIBLE
    degree = np.where(big.any(axis=1), p.shape[1] - 1 - big[:, ::-1].argmax(axis=1), 0)
    for d in np.unique(degree[degree > 0]):
        rows = np.flatnonzero(degree == d)
        all_roots = roots(scaled[rows, : d + 1])
        real = (np.abs(all_roots.imag) < _NEARLY_REAL) & (np.abs(all_roots.real) <= 1)
        found[rows, :d] = np.where(real, all_roots.real, np.nan)
    return found
