"""A fit's parameters in coordinates that the data determine equally well: the information is the identity.

A change of the parameters that the data determine is L·x, L·Lᵀ their covariance for unit variance. The derivative
of the weighted residuals by x has orthonormal columns, so that what a row, a pose or a fold adds to the information
reads as a part of 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.fitted import Fit
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh


class Whitened:
    """Coordinates x of the parameters of a fit.

    Attributes
    ----------
    root : ndarray, shape (parameters, r)
        L; r is the number of combinations that the data determine.
    inverse : ndarray, shape (r, parameters)
        Column i is what parameter i alone does, seen in x.
    """

    def __init__(self, fit: Fit) -> None:
        covariance, rank = fit.determinacy.covariance, fit.determinacy.rank
        correlation, scale = unit_diagonal(covariance)
        values, vectors = eigh(correlation)
        largest = np.argsort(values)[len(values) - rank :]
        size = np.sqrt(np.maximum(values[largest], np.finfo(float).tiny))
        self.root = scale[:, None] * vectors[:, largest] * size
        _, square, _ = fit.problem.normal_equations(fit.solution.theta, fit.solution.frame)
        self.inverse = self.root.T @ square
        self._fit = fit

    def jacobian_blocks(self) -> Iterator[tuple[NDArray[np.int_], Array]]:
        """Yield rows and the derivative of their weighted residuals by x, (rows, m, r), block by block."""
        fit = self._fit
        every = np.arange(fit.observations.n)
        for rows, jacobian in fit.problem.jacobian_blocks(fit.solution.theta, fit.solution.frame):
            yield every[rows], np.tensordot(jacobian, self.root, 1)
