"""The values of the machine file, and how a fit stays near them where the readings do not hold it.

A free frame moves with all that is in it, a joint that never moves with what it carries: along such directions the
readings say nothing, and those values are taken that change the file least. A change is measured in the largest
deviations that a machine has from its file, so that an angle counts as the length by which it moves a point at the
machine's distance. Where the measuring frame stands is in no file, and costs nothing.

Nor does a fit go along a direction that the readings hardly determine as far as noise and unknown effects lead it.
Where the standard deviation along one is s > 1 of these deviations, the file says more than the readings: it is a prior
that brings the standard deviation to 1, and the fit keeps the part 1/s² of what least squares would change. Where the
readings say more everywhere, nothing is pulled, and the fit is that of least squares.

Effects may do together with geometry what neither does alone, such as a bearing that moves by 60 mm, with targets that
moved by as much, and a fit that went there finds no way back. So on the way effects that a step would make large are
held by the largest size of a machine as a standard deviation about zero. Readings that show a parameter to a hundredth
of that are biased by less than a hundredth of their own standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.statistics.decompositions import eigh

__all__ = ["ASIDE", "CHANCE", "FileValues", "Pull", "pulled"]

Array: TypeAlias = NDArray[np.float64]

INVISIBLE = 1e-14
"""Part of the largest information below which a direction has none: normal equations are good to 1e-16."""
STRONG = 1e-6
"""Part of the largest information that pulls along such a direction, where any pull leads to the same place."""
CHANCE = 4.0
"""What values far from the file bring, in variances, is noise up to this: two standard deviations."""
ASIDE = 1e-6
"""A direction that changes the frame only, within this part, is not pulled."""


@dataclass(frozen=True)
class Pull:
    """A pull towards the file along some directions.

    Attributes
    ----------
    prior : ndarray, shape (v, k)
        Along directions that the readings determine a little: ``prior @ (values - file)`` are further residuals.
    gauge : ndarray, shape (w, k)
        Along those of which the readings show nothing.
    unit : ndarray, shape (v + w, k)
        The rows of both as a prior, for unit variance.
    variance : float
        Of a weighted reading, which the residuals of `prior` have.
    """

    prior: Array
    gauge: Array
    unit: Array
    variance: float


def pulled(rows: Array, away: Array) -> float:
    """Return what rows of a pull add to a sum of squares where the values are `away`, (k,), from the file."""
    with np.errstate(over="ignore", invalid="ignore"):  # of a step that goes far too far
        residual = rows @ away
        return float(residual @ residual)


@dataclass(frozen=True)
class FileValues:
    """The values of the machine file, and how far a machine may be from them.

    Attributes
    ----------
    largest : ndarray, shape (parameters,)
        Largest deviation of a machine from its file, internal units; infinite where nothing is known.
    change : ndarray, shape (parameters,)
        Of a parameter of an effect, too: the largest change of the readings, root mean square; else infinite.
    anchored : ndarray of bool, shape (parameters,)
        Whether the file says anything of the value: nothing of a free frame, nor of what is searched.
    centre, precision : ndarray, shape (parameters,)
        Mean of the prior that the file states, and the inverse of its standard deviation; both 0 where there is none.
    lowest, highest : ndarray, shape (parameters,)
        Bounds that the file states, infinite where there are none.
    possible : ndarray, shape (parameters,)
        Of a parameter of an effect without a prior of the file: the inverse of the largest size of a machine; 0 where
        none is known.
    """

    largest: Array
    change: Array
    anchored: NDArray[np.bool_]
    centre: Array
    precision: Array
    lowest: Array
    highest: Array
    possible: Array

    @cached_property
    def is_prior(self) -> bool:
        """Whether any parameter has a prior of its own."""
        return bool(self.precision.any())

    @cached_property
    def is_bounded(self) -> bool:
        """Whether any parameter has bounds."""
        return bool(np.isfinite(self.lowest).any() or np.isfinite(self.highest).any())

    def largest_deviations(self, information: Array, weight: float) -> Array:
        """Return the largest deviation of each parameter, (parameters,).

        Parameters
        ----------
        information : ndarray, shape (parameters,)
            Sums of squares of the weighted derivatives.
        weight : float
            Root of the sum of the squared weights.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            of_effects = self.change * weight / np.sqrt(information)
        largest = np.fmin(self.largest, of_effects)
        largest[np.isinf(largest)] = 1.0
        return largest

    def pull(
        self, square: Array, largest: Array, anchored: NDArray[np.bool_], variance: float
    ) -> Pull | None:
        """Return the pull of some parameters towards the file, None where the readings hold them.

        Parameters
        ----------
        square : ndarray, shape (k, k)
            Normal equations.
        largest : ndarray, shape (k,)
            See `largest_deviations`.
        anchored : ndarray of bool, shape (k,)
        variance : float
            Of a weighted reading.
        """
        flat = self._flat(square, largest, variance)
        if flat is None:
            return None
        values, vectors, most = flat
        variance = max(variance, INVISIBLE * most)
        # along the directions the change of the file is least where it has no part in this space
        space, part = np.linalg.qr(vectors * anchored[:, None])
        felt = np.abs(part.diagonal()) > ASIDE
        invisible = values < INVISIBLE * most
        strong = max(STRONG * most, variance)
        rows = space.T[felt] / largest
        weight = np.sqrt(1 - np.where(invisible, 0.0, values / variance))[felt, None]
        is_gauge = invisible[felt]
        return Pull(
            prior=(rows * weight)[~is_gauge] * np.sqrt(variance),
            gauge=rows[is_gauge] * np.sqrt(strong),
            unit=rows * weight,
            variance=variance,
        )

    @np.errstate(over="ignore", invalid="ignore")  # of readings that no machine gives
    def idle(self, square: Array, largest: Array, downhill: Array, variance: float) -> Array:
        """Return the directions along which a step would go far for what noise may bring.

        Parameters
        ----------
        square, largest, variance
            As of `pull`.
        downhill : ndarray, shape (k,)
            Right-hand side of the normal equations.

        Returns
        -------
        ndarray, shape (w, k)
            Rows, of unit length in largest deviations.
        """
        flat = self._flat(square, largest, variance)
        if flat is None:
            return np.zeros((0, len(largest)))
        values, vectors, most = flat
        brings = (vectors.T @ (downhill * largest)) ** 2
        return (vectors.T / largest)[(brings < CHANCE * variance * values) | (values < INVISIBLE * most)]

    def _flat(self, square: Array, largest: Array, variance: float) -> tuple[Array, Array, float] | None:
        """Return information and directions, in largest deviations, where the first is less than the file's.

        And the largest information. None where there are no such directions.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # of readings that no machine gives
            scaled = square * (largest[:, None] * largest)
            if self._held(square, largest, variance) or not np.isfinite(scaled).all():
                return None
        values, vectors = eigh(scaled)
        count = int(np.sum(values < max(variance, INVISIBLE * float(values[-1]))))
        return (values[:count], vectors[:, :count], float(values[-1])) if count else None

    @staticmethod
    def _held(square: Array, largest: Array, variance: float) -> bool:
        """Return whether the readings hold all: the sum of the variances is no less than that of any direction."""
        try:
            variances = np.abs(np.linalg.inv(square).diagonal()) * variance
        except np.linalg.LinAlgError:
            return False
        return bool(np.sum(variances / largest**2) < 1.0)
