"""Enclosures of a Tricept's matrix A and its rods while the point is anywhere in a box of space.

Q is in an axis-aligned box; enclosed are every element of A35(Q), its derivatives by Q, and the rods' lengths. The
pose comes from the conditions below the paper's eq. (4), S = K = 1, as sines and cosines without angles, so that only
+, −, ·, / and √ occur, which intervals enclose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept.interval import Jet, cross, dot, matmul, stack

_ROOT = float(np.sqrt(3.0))


class Enclosed(NamedTuple):
    """Enclosures over n boxes, of `enclose`."""

    A: Jet
    """The sensitivities, (3, 5, n)."""
    rods: Jet
    """A0, A1, A-1, (3, n)."""


def _constant(value: float, like: Jet) -> Jet:
    low, high = like.value
    slope = None if like.slope is None else (np.zeros_like(like.slope[0]), np.zeros_like(like.slope[1]))
    return Jet((np.full_like(low, value), np.full_like(high, value)), slope)


def enclose(low: Array, high: Array, geometry: Geometry, slopes: bool) -> Enclosed:
    """Return enclosures of A35 and the rods over boxes.

    Parameters
    ----------
    low, high : ndarray, shape (3, n)
        Opposite corners of n boxes.
    geometry : Geometry
        The machine.
    slopes : bool
        Whether to enclose the derivatives by Q, too.
    """
    R, r, (qx, qy, qz) = geometry.R, geometry.r, geometry.q
    unit = np.zeros((3, 3, low.shape[1])) + np.eye(3)[:, :, None]
    x, y, z = (Jet((low[n], high[n]), (unit[n], unit[n]) if slopes else None) for n in range(3))
    zero = _constant(0.0, x)

    level = x.square() + z.square()
    whole = level + y.square()
    if geometry.q == (0.0, 0.0, 0.0):
        across, length = level.sqrt(), whole.sqrt()
        shorter, longer = across.inverse(), length.inverse()
        sb, cb = x * shorter, z * shorter
        sa, ca = y * longer, across * longer
    else:
        square_x, square_y = Jet((zero.value[0] + qx,) * 2).square(), Jet((zero.value[0] + qy,) * 2).square()
        if slopes:
            square_x.slope = square_y.slope = zero.slope
        under = whole - square_x
        across, root = (level - square_x).sqrt(), (under - square_y).sqrt()
        shorter, longer = level.inverse(), under.inverse()
        sb, cb = (x * across - z * qx) * shorter, (x * qx + z * across) * shorter
        sa, ca = (y * root - across * qy) * longer, (root * across + y * qy) * longer
        length = root - qz

    thick = Jet((zero.value[0] + np.nextafter(_ROOT, 0), zero.value[1] + np.nextafter(_ROOT, 2)), zero.slope)
    rods = _rods(length, ca, sa, cb, sb, R, r, thick)
    # W33 by rows, and its inverse by their cross products over the determinant
    Rr = zero + R
    twice = length * 2.0
    rows = [
        stack([sa * r * Rr, sb * r * Rr, twice]),
        stack([ca * (twice + sb * r) * Rr, sa * cb * r * Rr, sa * 2.0 * Rr]),
        stack([sa * (r - twice * sb) * Rr, (twice * ca * cb - sb * r) * Rr, ca * sb * 2.0 * Rr]),
    ]
    turned = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])]
    determinant = dot(rows[0], turned[0])
    adjugate = stack([[turned[column][row] for column in range(3)] for row in range(3)])
    third = (zero + 1.0) / (zero + 3.0)
    by_root = thick * third
    both = ca + cb
    W35 = stack(
        [
            [-third * 2.0] * 3 + [zero + 2 * r - both * Rr, 2.0 * Rr - both * r],
            [zero, by_root * 2.0, -by_root * 2.0, sa * sb * Rr, sa * (twice + sb * r)],
            [
                third * 4.0,
                -third * 2.0,
                -third * 2.0,
                (cb - ca) * Rr,
                cb * r + ca * (twice * sb - r),
            ],
        ]
    )
    if geometry.q == (0.0, 0.0, 0.0):
        M33 = stack([[-sb * y, z, sb * ca], [across, zero, sa], [-cb * y, -x, cb * ca]])
    else:
        # dQ/dα = Oy Ox'(q + z e3), dQ/dβ = (Qz, 0, −Qx), dQ/dz = Oy Ox e3
        up = length + qz
        turn_y, turn_z = ca * up - sa * qy, -(sa * up + ca * qy)
        M33 = stack([[sb * turn_z, z, sb * ca], [turn_y, zero, sa], [cb * turn_z, -x, cb * ca]])
    A = matmul(matmul(-M33, adjugate), W35) * determinant.inverse()[None, None]
    lengths = stack([rods[0], rods[1], rods[2], zero + 1.0, zero + 1.0])
    return Enclosed(A * lengths[None], rods)


def _rods(z: Jet, ca: Jet, sa: Jet, cb: Jet, sb: Jet, R: float, r: float, root: Jet) -> Jet:
    """Return enclosures of the rods by the paper's (2) to (4)."""
    like = z * 0.0  # numbers as jets, because the square of one is rounded
    base = z.square() + (like + r).square() + (like + R).square()
    straight = (cb * r + z * sb * ca) * (2.0 * R)
    along = cb * (0.25 * r) + ca * ((like + r) * 0.75 - z * sb * 0.5)
    side = root * 0.5 * sa * (z + sb * (0.5 * r))
    squares = [base - straight, base - (along + side) * (2.0 * R), base - (along - side) * (2.0 * R)]
    return stack(squares).sqrt()
