"""Readings that stand in several pairs, such as one rest pose against which all others are paired.

Their errors are in several residuals. With A_i the derivative of the score by the error of a reading in pair i, the
score has the variance v Σ_g (Σ_i A_i)ᵀ (Σ_i A_i), over readings g and the pairs i in which they stand, where
independent readings have v Σ_g Σ_i A_iᵀ A_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.pairs import Pairs, residual_and_jacobian
from rodgen.kinematics.axis_fit.slide import Slide

_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers with bits that look random: sums of multiples of coordinates rarely agree by chance."""


@dataclass(frozen=True, eq=False)
class SharedReadings:
    """Readings that stand in more than one of the pairs that count.

    Attributes
    ----------
    pair, reading : (k,) int arrays
        The pair and the reading of each place where one stands.
    before : (k,) bool array
        Whether it is a point before the turn.
    """

    pair: NDArray[np.intp]
    reading: NDArray[np.intp]
    before: NDArray[np.bool_]

    @classmethod
    def of(cls, pairs: Pairs) -> SharedReadings | None:
        """Return those of the pairs with a weight; None where each reading stands in one pair."""
        counted = np.flatnonzero(pairs.weight > 0)
        points = np.concatenate([pairs.rho[counted], pairs.rho_prime[counted]]) + 0.0  # no zero with a sign
        bits = points.view(np.uint64)
        mixed = ((bits ^ (bits >> np.uint64(32))) * _MIX).sum(axis=1)
        order = np.argsort(mixed, kind="stable")
        alike = np.diff(mixed[order]) == 0
        if not alike.any():
            return None
        place = order[np.r_[alike, False] | np.r_[False, alike]]
        reading = np.unique(points[place], axis=0, return_inverse=True)[1].ravel()
        pair = place % len(counted)
        several = np.zeros(reading.max() + 1, bool)
        first = np.full(len(several), -1)
        first[reading[::-1]] = pair[::-1]
        several[reading[pair != first[reading]]] = True  # one at rest is alike before and after
        inside = several[reading]
        if not inside.any():
            return None
        reading = np.unique(reading[inside], return_inverse=True)[1]
        return cls(counted[pair[inside]], reading, place[inside] < len(counted))

    @property
    def text(self) -> str:
        """A sentence for users."""
        number, most = int(self.reading.max()) + 1, int(np.bincount(self.reading).max())
        stand = "readings stand" if number > 1 else "reading stands"
        return (
            f"{number} {stand} in several pairs, one in {most}: the uncertainties allow for the errors that "
            "pairs share."
        )

    def excess(self, pairs: Pairs, share: Array, basis: Array, slide: Slide) -> Array:
        """Return by how much the score's variance exceeds that of independent readings, in units of the noise's.

        `pairs` are those without the slide, `basis` (3, 2) directions across its axis; the result is by axis, a free
        point, and slide: (5, 5) or (3, 3).
        """
        i, line = self.pair, slide.line
        some = pairs.only(i)
        jacobian = residual_and_jacobian(some.rho, some.rho_prime, some.angle, line.axis, line.point)[1]
        parts = [jacobian[:, :, :3] @ basis] + ([jacobian[:, :, 3:] @ basis] if pairs.point is None else [])
        parts.append(-slide.amount(some)[:, None, None] * line.axis[:, None])
        by = np.concatenate(parts, axis=2) * (np.sqrt(some.weight) * share[i])[:, None, None]
        cosine, sine = (f(some.angle)[:, None, None] for f in (np.cos, np.sin))
        along = line.axis[:, None] * np.einsum("j,njp->np", line.axis, by)[:, None, :]
        back = cosine * by - sine * np.cross(line.axis[None, :, None], by, axis=1) + (1 - cosine) * along
        by = np.where(self.before[:, None, None], -back, by)
        total = np.zeros((int(self.reading.max()) + 1, *by.shape[1:]))
        np.add.at(total, self.reading, by)
        found: Array = np.einsum("njp,njq->pq", total, total) - np.einsum("njp,njq->pq", by, by)
        return found
