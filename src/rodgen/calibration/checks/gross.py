"""Rows that disagree with the others: the one pass by which every command finds them, and its words.

A robust fit finds the rows that do not agree with the others and a model (`rodgen.calibration.solve.robust`). Rows that
are neighbours are right, and something is missing in the model. A diagnosis leaves the others out. A fit names those
that are farther off, by a factor, than any row that agrees: what an incomplete model misses makes no such gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.calibration.solve.robust import gross_rows, sizes_in_cuts
from rodgen.calibration.words import capitalized, in_component, sized
from rodgen.data.set_aside import rows_text
from rodgen.statistics.columns import inverse_root, project_out, unit_columns
from rodgen.statistics.decompositions import eigh, lstsq
from rodgen.statistics.robust import HUBER, huber_weight, median_factor
from rodgen.statistics.thresholds import EVIDENCE, GROSS, OUTLIERS, VERDICT
from rodgen.views import with_html

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations


@with_html
@dataclass(frozen=True)
class GrossReading:
    """A reading that is grossly wrong.

    Attributes
    ----------
    row : int
        From 0, of the observations.
    component : str
        The component that is the farthest off.
    off : float
        Measured less predicted by a fit to the other rows, in the fit's unit.
    others : float
        Largest residual of the other rows there.
    """

    row: int
    component: str
    off: float
    others: float

    def to_dict(self, observations: Observations) -> dict[str, Any]:
        """Return it as plain data, with the number of its row in the data as they were given."""
        return asdict(self) | {"row": int(observations.given(np.array(self.row)))}


def disagreeing_rows(fit: FittedModel, *, complete: bool = True) -> Mask:
    """Return the rows, (n,), that do not agree with the others and a model that was fitted to these.

    More than the largest part that may be wrong are returned as they are found: the model is then in doubt, not they.

    Parameters
    ----------
    complete : bool
        Whether the model is thought to have all that acts, so that tails of its residuals are of wrong rows.
    """
    found = gross_rows(fit.problem, fit.solution, fit.free, restart=complete)
    too_many = found.mean() > EVIDENCE.largest_wrong_part
    return found if too_many else unless_neighbours(fit, found, fit.relative_residuals)


def gross_readings(fit: FittedModel) -> tuple[GrossReading, ...]:
    """Return the readings that are grossly wrong, in the order of the rows.

    Parameters
    ----------
    fit : FittedModel
        None are looked for where rows were left out already.
    """
    if fit.outliers.any() or fit.observations.n < GROSS.fewest_rows:
        return ()
    size = sizes_in_cuts(fit.problem, fit.solution, fit.free)
    if not size.max() > GROSS.suspicion:
        return ()
    # not from what was fitted, where such a row may have turned an axis by a whole turn
    fitted = {fit.parameters[i].key for i in fit.free}
    values = {key: value for key, value in fit.machine.values.items() if key not in fitted}
    start = replace(fit.machine, values=values)
    found = size >= max(1.0, size.max() / GROSS.factor)  # the worst: they make others look wrong
    if found.mean() > GROSS.largest_part:
        return ()
    without = fit.refit(start, outliers=found)
    again = disagreeing_rows(without, complete=False)
    if not np.array_equal(found, again):
        found, without = again, fit.refit(start, outliers=again)
    length = np.linalg.norm(without.relative_residuals, axis=1)
    wrong = found & (length > GROSS.factor * length[~found].max())
    spare = without.degrees_of_freedom / (without.rows * without.problem.components)
    if not wrong.any() or found.mean() > GROSS.largest_part or spare < GROSS.spare:
        return ()
    others = float(np.abs(without.residuals[~wrong]).max())
    rows = np.flatnonzero(wrong)
    return tuple(
        GrossReading(int(row), component, off, others)
        for row, off, component in zip(rows, *_worst(without, rows), strict=True)
    )


def unless_neighbours(fitted: FittedModel, outliers: Mask, residual: Array) -> Mask:
    """Return the outliers, or none where they are neighbours in a driver: then they show a missing effect.

    Where most poses of a stretch are outliers, the others there are displaced as well. Of the rest, those are none
    that lie where rows measured before and after them do.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    residual : ndarray, shape (n, m)
        What was judged, weighted.
    """
    o, outliers = fitted.observations, fitted.with_bodies(outliers)
    recorded = o.drivers("joint", "time", "temperature", "column", "load")
    # two targets of a pose that were mixed up are no neighbours: a pose counts once
    poses, first = np.unique(o.pose, return_index=True)
    wrong = np.isin(poses, o.pose[outliers])
    if outliers.any() and are_neighbours(wrong, [driver.values[first] for driver in recorded]):
        return np.zeros_like(outliers)
    outliers = outliers | displaced_rows(o, outliers)
    order = np.arange(o.n) if o.t is None else np.argsort(o.t, kind="stable")
    return outliers & ~on_a_branch(outliers, residual, order)


def displaced_rows(o: Observations, outliers: Mask) -> Mask:
    """Return the rows, (n,), of the poses from the first outlier to the last, where most of these are; else none.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    """
    numbers = np.unique(o.pose)
    wrong = np.isin(numbers, o.pose[outliers])
    found = np.flatnonzero(wrong)
    if (
        not len(found)
        or np.mean(wrong[found[0] : found[-1] + 1]) < VERDICT.together
        or not are_neighbours(wrong, [np.arange(len(numbers), dtype=float)])
    ):
        return np.zeros(o.n, bool)
    return np.isin(o.pose, numbers[found[0] : found[-1] + 1])


def _worst(fit: FittedModel, rows: NDArray[np.int_]) -> tuple[list[float], list[str]]:
    """Return the largest residual of each row, in the fit's unit, and its component."""
    residuals, names = fit.residuals[rows], fit.machine.measurand.components
    worst = np.argmax(np.abs(residuals), axis=1)
    return residuals[np.arange(len(rows)), worst].tolist(), [names[i] for i in worst]


def how_far_off(fit: FittedModel, offs: Sequence[float], components: Sequence[str]) -> str:
    """Return by how much readings are off, as a sentence lists it: of many the first few.

    Parameters
    ----------
    offs : sequence of float
        In its unit.
    components : sequence of str
        Of the readings.
    """
    names = fit.machine.measurand.components
    shown = dict(zip(names, zip(fit.in_units, fit.units, strict=True), strict=True))
    listed = [
        f"{_signed(off * shown[name][0])} {shown[name][1]}{f' {in_component(name)}' if len(names) > 1 else ''}"
        for off, name in zip(offs[: GROSS.named], components, strict=False)
    ]
    more = f" and {len(offs) - GROSS.named} more" if len(offs) > GROSS.named else ""
    return f"{', '.join(listed)}{more}"


def _signed(off: float) -> str:
    """Return a number with its sign and three digits, without an exponent where that is readable."""
    return f"{off:+.0f}" if 1e3 <= abs(off) < 1e6 else f"{off:+.3g}"


def on_outliers(fit: FittedModel, rows: NDArray[np.bool_]) -> str:
    """Return which rows were taken out and by how much they are off; empty where none were.

    Parameters
    ----------
    fit : FittedModel
        Without them.
    rows : ndarray of bool, shape (n,)
    """
    out = np.flatnonzero(rows)
    if not len(out):
        return ""
    off = how_far_off(fit, *_worst(fit, out))
    places = fit.observations.data.places(out)
    return f"{len(out)} outlier{'s' * (len(out) != 1)}, taken out: {places}, off by {off}."


def on_gross_readings(fit: FittedModel) -> str:
    """Return a sentence on the readings that are grossly wrong; empty where there are none."""
    gross = fit.gross_readings
    if not gross:
        return ""
    data = fit.observations.data
    wrong = [one.row for one in gross]
    place = capitalized(data.places(wrong))
    off = how_far_off(fit, [one.off for one in gross], [one.component for one in gross])
    are, them, it = ("are", "these rows", "them") if len(gross) > 1 else ("is", "this row", "it")
    rows = rows_text(data.numbers(wrong).tolist()).replace(" ", "")
    return (
        f"{place} {are} off by {off}, all other rows by {sized(gross[0].others, fit.unit, '.3g')} at most: "
        f"correct {them}, or exclude {it} with rodgen exclude --rows {rows}, or fit with --loss huber; a fit by "
        "least squares follows such errors."
    )


# Rows that are grossly wrong, before anything is known of what the model misses.
#
# What the model misses is not to be taken for outliers, nor outliers for an effect. So rows are judged by their
# residuals when every candidate is in the model: an effect explains much of them, a slip of the hand nothing. The fit
# of all these columns is made robust by weights (Huber 1964), and a row counts as wrong by the size which the largest
# of all good rows exceeds in one of a hundred data sets.


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
    around = np.cumsum(good)[:, None] - good[:, None] + steps + (good[:, None] & (steps >= 0))  # not itself
    apart = np.empty(n)
    mean = others[np.clip(around, 0, len(others) - 1)].mean(axis=1)
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
