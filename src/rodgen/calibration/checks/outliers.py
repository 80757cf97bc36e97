"""Rows that are grossly wrong, before anything is known of what the model misses.

What the model misses is not to be taken for outliers, nor outliers for an effect. So rows are judged by their
residuals when every candidate is in the model: an effect explains much of them, a slip of the hand nothing. The fit of
all these columns is made robust by weights (Huber 1964), and a row counts as wrong by the size which the largest of
all good rows exceeds in one of a hundred data sets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.statistics.columns import inverse_root, project_out, unit_columns
from rodgen.statistics.decompositions import eigh, lstsq
from rodgen.statistics.robust import HUBER, huber_weight, median_factor
from rodgen.statistics.thresholds import OUTLIERS

STEPS = 30
"""Reweighted fits at most."""
NO_WEIGHT = 3 * HUBER[1]
"""Size from which a row has no weight."""


def gross_errors(model: Array, candidates: Array, residual: Array) -> tuple[Mask, Array]:
    """Return the rows that no candidate explains, (n,), and what a fit of all leaves of the residuals, (n, m).

    Parameters
    ----------
    model : ndarray, shape (n, m, p)
        The model's columns.
    candidates : ndarray, shape (n, m, K)
        All others.
    residual : ndarray, shape (n, m)
        Weighted residuals.
    """
    n, m = residual.shape
    base = _directions(model.reshape(n * m, -1), residual.ravel(), n * m, n * m)
    rest = candidates.reshape(n * m, -1)
    size = np.linalg.norm(rest, axis=0)
    rest = project_out(base, rest)
    rest = rest[:, np.linalg.norm(rest, axis=0) > OUTLIERS.visible * size]
    most = min(n * m // OUTLIERS.readings_a_column - base.shape[1], OUTLIERS.most_columns)
    common = min(most, OUTLIERS.common_columns)
    further = _directions(rest, _without_gross(project_out(base, residual.ravel())), most, common)
    basis = np.concatenate([base, further], axis=1)
    residual_dof = n * m - basis.shape[1]
    left, none = residual, np.zeros(n, bool)
    if n < OUTLIERS.fewest_rows or residual_dof < 2 * m or not residual.any():
        return none, left
    cut = _cut(n, m, residual_dof)
    weight = np.ones(n)
    size = np.zeros(n)
    for step in range(STEPS):
        left, own = _weighted_fit(basis, residual, weight) if step else _fit(basis, residual)
        share = np.clip(1 - weight * own / m, OUTLIERS.least_left, 1.0)
        size = np.sqrt(np.einsum("nm,nm->n", left, left) / share)
        scale = _scale(size, m)
        if scale <= 0 or (step == 0 and size.max() < OUTLIERS.suspicion * cut * scale):
            return none, left
        z = size / scale / np.sqrt(m)
        new = np.where(z > NO_WEIGHT, 1e-8, huber_weight(z, HUBER[1]))
        if np.max(np.abs(new - weight)) < 1e-3:
            break
        weight = new
    found = np.asarray(size > cut * scale)
    return (none if found.mean() > OUTLIERS.largest_part else found), left


def _fit(basis: Array, residual: Array) -> tuple[Array, Array]:
    """Return what a fit with an orthonormal basis leaves, (n, m), and the leverage of each row, (n,)."""
    left = residual.ravel() - basis @ (basis.T @ residual.ravel())
    of_rows = basis.reshape(len(residual), -1)
    return left.reshape(residual.shape), np.einsum("nk,nk->n", of_rows, of_rows)


def _weighted_fit(basis: Array, residual: Array, weight: Array) -> tuple[Array, Array]:
    """Return the same of a fit with a weight of each row; the leverage is that of its readings without their weight."""
    n, m = residual.shape
    root = np.repeat(np.sqrt(weight), m)
    weighted = basis * root[:, None]
    square = weighted.T @ weighted
    along = lstsq(square, weighted.T @ (root * residual.ravel()), relative=1e-10)
    across = (basis @ inverse_root(square, least=1e-300, relative=1e-12)).reshape(n, -1)
    return (residual.ravel() - basis @ along).reshape(n, m), np.einsum("nk,nk->n", across, across)


def _scale(size: Array, m: int) -> float:
    from scipy import special

    return float(np.median(size) / np.sqrt(special.chdtri(m, 0.5)))


def _cut(n: int, m: int, residual_dof: int) -> float:
    """Return the size, in scales, that the largest of all good rows exceeds in one of a hundred data sets."""
    from scipy import special

    quantile = special.fdtri(m, max(residual_dof, 2), 1 - OUTLIERS.false_alarm / n)
    return float(np.sqrt(m * quantile)) * median_factor(residual_dof)


def _without_gross(residual: Array) -> Array:
    """Return residuals cut off where only gross errors are: one of these would choose the directions that follow it."""
    limit = OUTLIERS.cut_off * _scale(np.abs(residual), 1)
    return np.clip(residual, -limit, limit) if limit > 0 else residual


def _directions(columns: Array, residual: Array, most: int, common: int) -> Array:
    """Return an orthonormal basis of directions that columns, taken at length 1, span, (N, most) or fewer.

    Those along which the residual is largest come first, while it exceeds what chance does. Where these are fewer than
    `common`, those follow that the columns have most in common.
    """
    columns = unit_columns(columns)
    if not columns.any() or most < 1:
        return np.zeros((len(columns), 0))
    values, vectors = eigh(columns.T @ columns)
    keep = np.flatnonzero(values > 1e-9 * max(values[-1], 1e-300))[::-1]
    square = (vectors[:, keep].T @ (columns.T @ residual)) ** 2 / values[keep]
    order = np.argsort(-square, kind="stable")
    left = float(residual @ residual) - np.cumsum(square[order])
    variance = np.maximum(left, 0.0) / np.maximum(len(residual) - np.arange(1, len(order) + 1), 1)
    beyond = square[order] > OUTLIERS.beyond_chance**2 * variance
    first = order[: len(order) if beyond.all() else int(np.argmin(beyond))]
    others = np.setdiff1d(np.arange(len(keep)), first)[: max(common - len(first), 0)]
    chosen = keep[[*first, *others]][:most]
    basis = columns @ (vectors[:, chosen] / np.sqrt(values[chosen]))
    # orthonormal but for rounding over the least value: once more, from its own products
    return np.asarray(basis @ np.linalg.inv(np.linalg.cholesky(basis.T @ basis)).T)


def on_a_branch(outliers: Mask, residual: Array, order: NDArray[np.int_]) -> Mask:
    """Return the rows that look wrong, but lie where those measured before and after them do, as others do, (n,).

    A set-up that wanders goes far at times, and the rows there are as good as others.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    residual : ndarray, shape (n, m)
        What was judged, weighted.
    order : ndarray of int, shape (n,)
        The rows in the order in which they were measured.
    """
    (n, m), good = residual.shape, ~outliers[order]
    others = residual[order[good]]
    if not outliers.any() or len(others) < OUTLIERS.fewest_rows:
        return np.zeros(n, bool)
    steps = np.arange(-OUTLIERS.rows_around, OUTLIERS.rows_around)
    beside = np.cumsum(good)[:, None] - good[:, None] + steps + (good[:, None] & (steps >= 0))  # not itself
    apart = np.empty(n)
    mean = others[np.clip(beside, 0, len(others) - 1)].mean(axis=1)
    apart[order] = np.linalg.norm(residual[order] - mean, axis=1)
    near = apart <= _cut(n, m, n * m) * _scale(apart[~outliers], m)
    return np.asarray(outliers & near & (apart < OUTLIERS.branch * np.linalg.norm(residual, axis=1)))


def are_neighbours(outliers: Mask, drivers: list[Array]) -> bool:
    """Return whether poses that look wrong are neighbours in a driver: then they are right, and an effect is missing.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
        Of each pose.
    drivers : list of ndarray, each of shape (n,)
        Coordinates of joints, time.

    Notes
    -----
    The number of neighbours that are both outliers is tested against that of a random order, which is Poisson.
    """
    from scipy import special

    k, n = int(outliers.sum()), len(outliers)
    if k < 3:
        return False
    chance = 1.0
    random = np.argsort(np.random.default_rng(0).random(n))  # order of rows with the same coordinate
    for driver in drivers:
        if np.ptp(driver) == 0:
            continue
        marked = outliers[random[np.argsort(driver[random], kind="stable")]]
        pairs = int(np.sum(marked[1:] & marked[:-1]))
        expected = k * (k - 1) / n
        if pairs:
            chance = min(chance, float(special.pdtrc(pairs - 1, expected)))
    return chance * max(len(drivers), 1) < OUTLIERS.neighbours
