"""Readings that are grossly wrong, such as a typing error, and that pull a fit by least squares.

Only what no physics does is called that: rows that are farther off, by a factor, than any other, seen from a fit
without them. A smaller outlier is left to the robust loss and to a diagnosis. A grossly wrong row has most of the sum
of squares, unless the fit follows it; so rows are left out one after the other while few have most of it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.words import capitalized, in_component
from rodgen.statistics.thresholds import GROSS

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations

__all__ = ["GrossReading", "gross_readings", "on_gross_readings"]

Array: TypeAlias = NDArray[np.float64]


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


def gross_readings(fit: FittedModel) -> tuple[GrossReading, ...]:
    """Return the readings that are grossly wrong, in the order of the rows.

    Parameters
    ----------
    fit : FittedModel
        None are looked for where rows were left out already.
    """
    size, without = _sizes(fit), fit
    gone = np.zeros(len(size), bool)
    few = max(GROSS.few, int(GROSS.part * len(size)))
    if fit.outliers.any() or len(size) < GROSS.fewest_rows:
        return ()
    while gone.sum() < few and _are_few(size[~gone], few):
        gone[np.flatnonzero(~gone)[np.argmax(size[~gone])]] = True
        without = fit.refit(outliers=gone)
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
    names = fit.machine.measurand.components
    worst = np.argmax(np.abs(residuals), axis=1)
    return tuple(
        GrossReading(int(row), names[worst[row]], float(residuals[row, worst[row]]), others)
        for row in np.flatnonzero(wrong)
    )


def _are_few(size: Array, few: int) -> bool:
    """Return whether few rows hold most of the sum of squares, as one that is grossly wrong does."""
    squares = size**2
    total = float(squares.sum())
    return bool(np.isfinite(total) and np.sum(np.partition(squares, -few)[-few:]) > GROSS.share * total)


def _sizes(fit: FittedModel) -> Array:
    """Return the lengths of the weighted residuals, (n,)."""
    return np.asarray(np.linalg.norm(fit.relative_residuals, axis=1))


def on_gross_readings(fit: FittedModel) -> str:
    """Return a sentence on the readings that are grossly wrong; empty where there are none.

    Parameters
    ----------
    fit : FittedModel
    """
    gross = fit.gross_readings
    if not gross:
        return ""
    data = fit.observations.data
    place = capitalized(data.places([one.row for one in gross]))
    several = len(fit.machine.measurand.components) > 1
    off = ", ".join(
        f"{one.off:+.3g} {fit.unit}{f' {in_component(one.component)}' if several else ''}"
        for one in gross[: GROSS.named]
    )
    more = f" and {len(gross) - GROSS.named} more" if len(gross) > GROSS.named else ""
    are, them = ("are", "these rows") if len(gross) > 1 else ("is", "this row")
    return (
        f"{place} {are} off by {off}{more}, all other rows by {gross[0].others:.3g} {fit.unit} at most: correct or "
        f"remove {them}, or fit with --loss huber; a fit by least squares follows such errors."
    )
