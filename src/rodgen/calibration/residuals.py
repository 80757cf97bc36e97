"""The residuals of a fit: an array, and on request a table of the measurements with predictions and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.attitudes import attitude_columns
from rodgen.data.units import parse_unit
from rodgen.machines.measured import TURNS
from rodgen.views import Tabular

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel


class Residuals(Tabular, np.ndarray[Any, np.dtype[np.float64]]):
    """Measured less predicted, (n, m); what is computed from it is an ordinary array."""

    _fit: FittedModel | None = None

    @classmethod
    def of(cls, fit: FittedModel, values: NDArray[np.float64]) -> Residuals:
        """Return the residuals of a fit."""
        made = values.view(cls)
        made._fit = fit
        return made

    def __getitem__(self, key: Any) -> Any:
        return np.asarray(self)[key]

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return array[()] if return_scalar else np.asarray(array)

    def __reduce__(self) -> Any:
        return np.asarray(self).__reduce__()

    def columns(self) -> dict[str, Any]:
        """Return the columns of the measurements, then predictions, residuals, and which rows are outliers.

        Raises
        ------
        TypeError
            Of an array that was computed from residuals.
        """
        return self.shown_columns(slice(None))

    @property
    def row_count(self) -> int:
        """Number of rows of the table."""
        counted_as = self._source.observations.counted_as
        return len(self if counted_as is None else counted_as)

    def shown_columns(self, rows: Sequence[int] | slice) -> dict[str, Any]:
        """Return the columns of some rows of the table."""
        o = self._source.observations
        given = o.data if o.aside is None else o.aside.data
        of = rows if o.counted_as is None or o.aside else o.counted_as[rows]
        measured = {column.text: column.take(of).values for column in given.columns.values()}
        return measured | {name: values[rows] for name, values in residual_columns(self._source).items()}

    @property
    def _source(self) -> FittedModel:
        if self._fit is None:
            raise TypeError("these are no longer the residuals of a fit; expected those of its attribute")
        return self._fit


def residual_columns(fit: FittedModel) -> dict[str, NDArray[Any]]:
    """Return predictions and residuals as columns for the measurement file.

    Returns
    -------
    dict of str to ndarray
        ``predicted_x`` … and ``residual_x`` … in the unit of the column ``x``. Of directions the prediction, and the
        angle between both, split into a horizontal part (to the left) and one towards the zenith. Of poses also the
        predicted attitude, in the notation of the readings, and the rotation vector from there to these.
        ``outlier``, 1 or 0.
        A row that is a copy of another has what that has; those of rows that are set aside are masked.
    """
    measurand = fit.machine.measurand
    names = measurand.columns
    found: dict[str, NDArray[Any]] = {}
    if measurand.is_direction:
        places = fit.problem.places(fit.solution.theta, fit.solution.frame)
        found |= {f"predicted_{name}": values for name, values in zip(names, places.T, strict=True)}
        parts = zip(("horizontal", "vertical"), fit.residuals.T, strict=True)
        found |= {f"residual_{part} [{fit.unit}]": values for part, values in parts}
    else:
        data, residuals = fit.observations.data, fit.residuals * fit.unit_factor
        reading = (
            residuals[:, :0] if measurand.has_attitude and not measurand.is_pose else fit.observations.reading
        )
        of_places = residuals[:, : reading.shape[1]]
        for label, values in (("predicted", reading - of_places), ("residual", of_places)):
            for name, part in zip(names, values.T, strict=False):
                unit = str(data.columns[name].unit)
                found[f"{label}_{name} [{unit}]"] = part / parse_unit(unit).factor(fit.machine.length_unit)
        if measurand.has_attitude:
            attitudes = fit.problem.attitudes(fit.solution.theta, fit.solution.frame)
            found |= {f"predicted_{name}": part for name, part in attitude_columns(attitudes, data).items()}
            turns = (fit.residuals * fit.in_units)[:, -3:]
            found |= {f"residual_{name} [arcsec]": part for name, part in zip(TURNS, turns.T, strict=True)}
    found["outlier"] = fit.outliers.astype(np.int8)
    rows = fit.observations.counted_as
    if rows is None:
        return found
    everywhere = {name: values[rows] for name, values in found.items()}
    return (
        {n: np.ma.array(x, mask=rows < 0) for n, x in everywhere.items()} if (rows < 0).any() else everywhere
    )
