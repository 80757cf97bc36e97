"""What a linear fit would leave on groups of readings that it did not see, without a refit, and folds to group them by.

With Q, an orthonormal basis of the columns, and e the residuals of the fit to all readings, those of a group g by the
fit to the others are

    eₖ + Qₖ (1 - QₖᵀQₖ)⁻¹ Qₖᵀ eₖ.

The same matrix to the power -½ in place of -1 brings the residuals of a group to the size of its errors, which the fit
has shrunk (Bell and McCaffrey 2002).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.statistics.decompositions import eigh

ALONE = 1e-6
"""A group whose removal leaves less than this part of the information on a direction is the only one to know it; the
others then predict nothing along it. Far above rounding (1e-13), far below what a pose of many leaves."""


def undo_leverage(hat: Array, residual: Array, power: float, *, cap: float | None = None) -> Array:
    """Return (1 - H)⁻ᵖ r of each group, H its block of the hat matrix.

    Parameters
    ----------
    hat : ndarray, shape (…, b, b)
        H, with eigenvalues between 0 and 1.
    residual : ndarray, shape (…, b)
    power : float
        p: 1 for residuals of a fit without the group, ½ for residuals of the size of errors.
    cap : float, optional
        Eigenvalues of H above it count as it. Left out: where they exceed 1 - :data:`ALONE` the group alone determines
        that direction, and the result is 0.
    """
    if hat.shape[-1] == 1 and cap is not None:
        return np.asarray(residual / (1 - np.clip(hat[..., 0], 0.0, cap)) ** power)
    values, vectors = eigh(hat)
    if cap is None:
        known = values <= 1 - ALONE
        factor = np.where(known, (1 - np.where(known, values, 0.0)) ** -power, 0.0)
    else:
        factor = (1 - np.clip(values, 0.0, cap)) ** -power
    along = np.einsum("...ji,...j->...i", vectors, residual) * factor
    return np.asarray(np.einsum("...ij,...j->...i", vectors, along))


def deal(count: int, folds: int) -> NDArray[np.int_]:
    """Return the fold of each of several things in order, (count,), so that each fold has one of every stretch.

    Within a stretch they are dealt at random, because what is dealt may repeat in any period; always the same.
    """
    random = np.random.default_rng(0)
    stretches = -(-count // folds)
    return np.concatenate([random.permutation(folds) for _ in range(stretches)])[:count]


def neighbours(points: Array, folds: int) -> NDArray[np.int_]:
    """Return the fold of each of several points, (count,), so that each fold has neighbours, and as many as the others.

    The points are cut in two across the direction in which they spread most, and so are the parts.

    Parameters
    ----------
    points : ndarray, shape (count, J)
    folds : int
        At most as many as there are points.

    Examples
    --------
    >>> neighbours(np.array([[0.0, 0.0], [9.0, 1.0], [0.0, 1.0], [9.0, 0.0], [5.0, 0.0], [5.0, 1.0]]), 3).tolist()
    [0, 2, 0, 2, 1, 1]
    """
    counts = np.zeros(len(points), int)
    parts = [(np.arange(len(points)), 0, folds)]
    while parts:
        some, first, count = parts.pop()
        if count == 1:
            counts[some] = first
            continue
        _, directions = eigh(np.atleast_2d(np.cov(points[some].T, bias=True)))
        widest = directions[:, -1] * np.sign(directions[np.argmax(np.abs(directions[:, -1])), -1])
        order = some[np.argsort(points[some] @ widest, kind="stable")]
        less = count // 2
        cut = len(some) * less // count
        parts += [(order[:cut], first, less), (order[cut:], first + less, count - less)]
    return counts
