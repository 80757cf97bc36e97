"""The residuals of a fit: an array, and on request a table of the measurements with predictions and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.views import Tabular


class Residuals(Tabular, np.ndarray[Any, np.dtype[np.float64]]):
    """Measured less predicted, (n, m); what is computed from it is an ordinary array."""

    _fit: Any = None
    """The fit that they are the residuals of."""

    @classmethod
    def of(cls, fit: Any, values: NDArray[np.float64]) -> Residuals:
        """Return the residuals of a fit."""
        residuals = values.view(cls)
        residuals._fit = fit
        return residuals

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
        data = o.data if o.aside is None else o.aside.data
        of = rows if o.counted_as is None or o.aside else o.counted_as[rows]
        measured = {column.text: column.take(of).values for column in data.columns.values()}
        return measured | {name: values[rows] for name, values in self._source.residual_columns().items()}

    @property
    def _source(self) -> Any:
        if self._fit is None:
            raise TypeError("these are no longer the residuals of a fit; expected those of its attribute")
        return self._fit
