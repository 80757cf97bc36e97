"""All eight solutions of two equations in two angles, complex ones among them.

When two solutions have met and are no longer real, they are complex, and the octic still has eight roots. A root ±i of
it is not an angle at all: its sine and cosine are infinite.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.kinematics.angles import principal
from rodgen.kinematics.spatial.pairs.eigenvalues import eigenvalues
from rodgen.kinematics.spatial.pairs.solutions import (
    ROUNDING,
    basis,
    condition_number,
    newton_step,
    regular_below,
    slope,
)
from rodgen.kinematics.spatial.status import PairStatus

STEPS = 6
"""Newton's method from eigenvalues, right to 1e-6 or better where solutions stand alone."""
FAR = 14.0
"""Imaginary part, in rad, beyond which a root is ±i: that of the tangent is off by 4 exp(-14) then, some 1e-6."""


def complex_solutions(M: Any, loss: Any) -> tuple[Any, Any]:
    """Return angles (n, 8, 2) and statuses (n, 8) for prepared equations (n, 2, 3, 3) without a common factor."""
    n = len(M)
    theta1, _ = eigenvalues(M)
    far = ~(np.abs(theta1.imag) <= FAR)
    theta1 = np.where(far, 0.0, theta1)
    rows = np.einsum("neij,nki->nkej", M, basis(theta1))
    n0, n1, n2 = np.moveaxis(np.cross(rows[:, :, 0], rows[:, :, 1]), -1, 0)
    # tan(θ2/2) is n2/(n0 + n1) = (n0 - n1)/n2
    steep = np.abs(n0 + n1) < np.abs(n0 - n1)
    above, below = np.where(steep, n0 - n1, n2), np.where(steep, n2, n0 + n1)
    with np.errstate(all="ignore"):
        theta2 = np.where(below == 0, np.pi, 2 * np.arctan(above / np.where(below == 0, 1.0, below)))
    far |= ~(np.abs(theta2.imag) <= FAR)
    angles = np.stack([theta1, np.where(far, 0.0, theta2)], axis=-1)
    for _ in range(STEPS):
        value, J, _ = _at(M, angles)
        step = newton_step(J, value, np.inf)
        length = np.abs(step).max(axis=-1, keepdims=True)
        angles = angles - step * np.minimum(1.0, 0.1 / np.maximum(length, 1e-300))
    value, J, size = _at(M, angles)
    with np.errstate(all="ignore"):
        condition = condition_number(J, size)
        right = (np.abs(value) / size).max(axis=-1) <= 4 * ROUNDING * loss[:, None]
        regular = right & (condition <= regular_below(loss)[:, None])
    status = np.select([far, regular], [PairStatus.NONE, PairStatus.REGULAR], PairStatus.DOUBLE).astype(
        np.int8
    )
    angles = principal(angles.real) + 1j * angles.imag
    angles = np.where(far[..., None], np.nan, angles)
    order = np.lexsort((angles[..., 0].imag, angles[..., 0].real, far), axis=-1)
    return np.take_along_axis(angles, order[..., None], axis=1).reshape(n, 8, 2), np.take_along_axis(
        status, order, axis=1
    )


def _at(M: Any, angles: Any) -> tuple[Any, Any, Any]:
    """Return values, derivatives and sizes of the terms of equations (n, 2, 3, 3) at complex angles (n, 8, 2)."""
    u, v = basis(angles[..., 0]), basis(angles[..., 1])
    value = np.einsum("neij,nki,nkj->nke", M, u, v)
    by_first = np.einsum("neij,nki,nkj->nke", M, slope(u), v)
    by_second = np.einsum("neij,nki,nkj->nke", M, u, slope(v))
    size = np.einsum("neij,nki,nkj->nke", np.abs(M), np.abs(u), np.abs(v))
    return value, np.stack([by_first, by_second], axis=-1), size
