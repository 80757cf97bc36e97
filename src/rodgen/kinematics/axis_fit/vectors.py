"""Vector products of arrays of points (…, 3), and vectors in messages."""

from __future__ import annotations

import numpy as np

from rodgen.array_types import Array


def dot(a: Array, b: Array) -> Array:
    """Return scalar products (…)."""
    product: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product


def cross(a: Array, b: Array) -> Array:
    """Return cross products; numpy.cross takes several times as long on (N, 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def skew(a: Array) -> Array:
    """Return the matrices (…, 3, 3) with skew(a) @ b = a × b."""
    out = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j] = a[..., i]
        out[..., j, k] = -a[..., i]
    return out


def shown(vector: Array) -> str:
    """Return a unit vector as a message shows it, with 0 for rounding."""
    return "(" + ", ".join(f"{c:z.4g}" if abs(c) > 1e-12 else "0" for c in vector) + ")"
