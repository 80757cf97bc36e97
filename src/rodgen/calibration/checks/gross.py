"""Readings that are grossly wrong, such as a typing error, and that pull a fit by least squares.

Only what no physics does is called that: rows that are farther off, by a factor, than any other, seen from a fit
without them. A smaller outlier is left to the robust loss and to a diagnosis. A grossly wrong row has most of the sum
of squares, unless the fit follows it; so rows are left out one after the other while few have most of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.words import capitalized, in_component, sized
from rodgen.data.set_aside import rows_text
from rodgen.statistics.thresholds import GROSS
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


def gross_readings(fit: FittedModel) -> tuple[GrossReading, ...]:
    """Return the readings that are grossly wrong, in the order of the rows.

    Parameters
    ----------
    fit : FittedModel
        None are looked for where rows were left out already.
    """
    size, without = _sizes(fit), fit
    gone = np.zeros(len(size), bool)
    # not from what was fitted, where such a row may have turned an axis by a whole turn
    fitted = {fit.parameters[i].key for i in fit.free}
    values = {key: value for key, value in fit.machine.values.items() if key not in fitted}
    start = replace(fit.machine, values=values)
    few = max(GROSS.few, int(GROSS.part * len(size)))
    if fit.outliers.any() or len(size) < GROSS.fewest_rows:
        return ()
    while gone.sum() < few and _are_few(size[~gone], few):
        gone[np.flatnonzero(~gone)[np.argmax(size[~gone])]] = True
        without = fit.refit(start, outliers=gone)
        size = _sizes(without)
    spare = without.degrees_of_freedom / (np.sum(~gone) * fit.problem.components)
    order = np.argsort(-size)
    gaps = np.flatnonzero(size[order[:-1]] > GROSS.factor * size[order[1:]])
    gaps = gaps[gaps < gone.sum()]
    if not len(gaps) or spare < GROSS.spare:
        return ()
    wrong = np.zeros(len(size), bool)
    wrong[order[: gaps[-1] + 1]] = True
    residuals = without.residuals
    others = float(np.abs(residuals[~wrong]).max())
    rows = np.flatnonzero(wrong)
    return tuple(
        GrossReading(int(row), component, off, others)
        for row, off, component in zip(rows, *_worst(without, rows), strict=True)
    )


def _are_few(size: Array, few: int) -> bool:
    """Return whether few rows hold most of the sum of squares, as one that is grossly wrong does."""
    squares = size**2
    total = float(squares.sum())
    return bool(np.isfinite(total) and np.sum(np.partition(squares, -few)[-few:]) > GROSS.share * total)


def _sizes(fit: FittedModel) -> Array:
    """Return the lengths of the weighted residuals, (n,)."""
    return np.asarray(np.linalg.norm(fit.relative_residuals, axis=1))


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
        f"correct {them}, or set {it} aside with rodgen set-aside --rows {rows}, or fit with --loss huber; a fit by "
        "least squares follows such errors."
    )
