"""The residuals of a fit: an array, and on request a table of the measurements with predictions and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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
        from rodgen.calibration.residual_columns import residual_columns

        if self._fit is None:
            raise TypeError("these are no longer the residuals of a fit; expected those of its attribute")
        o = self._fit.observations
        given = o.data if o.aside is None else o.aside.data
        rows = slice(None) if o.counted_as is None or o.aside else o.counted_as
        measured = {column.text: column.values[rows] for column in given.columns.values()}
        return measured | residual_columns(self._fit)
