"""Steps that several arms share: a wrist, a triangle in a plane, and rotations of vectors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rodgen.kinematics.angles import angle_between

EPS = float(np.finfo(float).eps)
MEETING = 64 * EPS
"""Solutions meet within this, relative to what an equation is made of: the rounding of some thirty operations."""
FREE = 4096 * EPS
"""A vector shorter than this, relative to all lengths, has no direction: poses with 12 digits are that exact."""


class Branch(NamedTuple):
    """Two branches, last axis 2: angles (..., 2, m), and whether each is there, is double, holds a free angle."""

    angles: Any
    there: Any
    double: Any
    free: Any


def about_x(c: Any, s: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about x."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1)


def back_x(c: Any, s: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about x by the opposite angle."""
    return about_x(c, -s, v)


def about_z(theta: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about z by angles (...)."""
    c, s = np.cos(theta), np.sin(theta)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, np.shape(c * x))], axis=-1)


def back_z(theta: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about z by the opposite angles."""
    return about_z(-np.asarray(theta), v)


def both_branches(angles: Any, there: Any, double: Any, free: Any, single: Any) -> Branch:
    """Return two branches, of which only the first counts where they are `single`."""
    both = np.stack([there, there & ~single], axis=-1)
    return Branch(angles, both, double[..., None] & both, free[..., None] & both)


def wrist(N: Any, cosine: Any, sine: Any) -> Branch:
    """Return the angles of three axes that meet: N = Rz(first) Rx(alpha) Rz(middle) Rx(beta) Rz(last).

    Derivation ``robots_6r``. `N` is (..., 3, 3), `cosine` and `sine` of alpha and beta (2). The angles are (..., 2, 3).
    """
    (ca, cb), (sa, sb) = cosine, sine
    h = np.hypot(N[..., 0, 2], N[..., 1, 2])
    ahead = N[..., 2, 2] >= 0
    apart = np.where(ahead, ca - cb, ca + cb)
    product = np.where(ahead, ca * cb, -ca * cb)
    gram = h**2 * (1 - 2 * product / (1 + np.abs(N[..., 2, 2]))) - apart**2
    tolerance = MEETING * (h + apart**2)
    there = gram >= -tolerance
    free = (h <= FREE) & there
    double = (np.abs(gram) <= tolerance) & ~free
    q = np.sqrt(np.where((gram > 0) & ~double, gram, 0.0))
    middle = np.arctan2(np.sign(sa * sb) * q, np.sign(sa * sb) * (ca * cb - N[..., 2, 2]))
    middle = np.stack([middle, -middle], axis=-1)
    c, s = np.cos(middle), np.sin(middle)
    M = N[..., None, :, :]
    first = np.where(
        free[..., None], 0.0, angle_between(sb * s, -ca * sb * c - sa * cb, M[..., 0, 2], M[..., 1, 2])
    )
    rest = back_x(cb, sb, back_z(middle, back_x(ca, sa, back_z(first, M[..., :, 0]))))
    last = np.arctan2(rest[..., 1], rest[..., 0])
    return both_branches(np.stack([first, middle, last], axis=-1), there, double, free, double | free)


def triangle(end: Any, upper: float, forearm: float, spare: Any) -> Branch:
    """Return both angles of two links in a plane that reach `end` (..., 2); `spare` is the size of all lengths."""
    square = np.square(end).sum(axis=-1)
    size = 2 * upper * forearm
    cosine = (square - upper**2 - forearm**2) / size
    tolerance = MEETING * np.square(spare) / abs(size)
    with np.errstate(over="ignore", invalid="ignore"):
        room = 1 - np.abs(cosine)
    there = room >= -tolerance
    double = np.abs(room) <= tolerance
    sine = np.sqrt(np.where((room > 0) & ~double, room * (1 + np.abs(cosine)), 0.0))
    second = np.arctan2(sine, cosine)
    second = np.stack([second, -second], axis=-1)
    x, y = upper + forearm * np.cos(second), forearm * np.sin(second)
    free = (np.abs(end).sum(axis=-1) <= FREE * spare) & there
    first = np.where(free[..., None], 0.0, angle_between(x, y, end[..., None, 0], end[..., None, 1]))
    return both_branches(np.stack([first, second], axis=-1), there, double, free, double)
