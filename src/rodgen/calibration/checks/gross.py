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
from rodgen.calibration.checks.outliers import are_neighbours, on_a_branch
from rodgen.calibration.solve.robust import gross_rows, sizes_in_cuts
from rodgen.calibration.words import capitalized, in_component, sized
from rodgen.data.set_aside import rows_text
from rodgen.statistics.thresholds import EVIDENCE, GROSS, VERDICT
from rodgen.views import html_of

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations


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

    _repr_html_ = html_of

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
