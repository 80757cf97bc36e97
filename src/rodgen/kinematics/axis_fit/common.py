"""What pairs share: a slide along the axis, and readings that stand in several of them.

A slide is that of a screw, an axial run-out, or a body that is pushed while it turns. A slide of s a pair, or of s for
each radian, makes the residual d - a s e, with a = 1 or the angle. It is one more parameter of the fit: where chance
explains it, its estimate is reported and none is taken; otherwise it is fitted with the axis. Both are least squares of
the same likelihood.

A reading may stand in several pairs, such as one rest pose against which all others are paired; its errors are in
several residuals. With A_i the derivative of the score by the error of a reading in pair i, the score has the variance
v Σ_g (Σ_i A_i)ᵀ (Σ_i A_i), over readings g and the pairs i in which they stand, where independent readings have
v Σ_g Σ_i A_iᵀ A_i.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.moments import tangents
from rodgen.kinematics.axis_fit.pairs import Line, Pairs, residual_and_jacobian

CHANCE = 1e-5
"""Probability below which a better fit is not taken for luck."""
_MOST_STEPS = 30
_SETTLED = 1e-13
_ROUNDING = 1e-12
"""Of a relative information: 64 times rounding, for a hundred roundings in its sums."""


@dataclass(frozen=True, eq=False)
class Slide:
    """A slide of `size` times `amount` along the axis.

    Attributes
    ----------
    size : float
        Scaled length, of each pair or of each radian.
    by_angle : bool
        Whether it is in proportion to the angle.
    line : Line
    """

    size: float
    by_angle: bool
    line: Line

    def amount(self, pairs: Pairs) -> Array:
        """Return by what the size is multiplied in each pair, (n,)."""
        return pairs.angle if self.by_angle else np.ones(len(pairs.angle))

    def without(self, pairs: Pairs) -> Pairs:
        """Return the pairs less the slide, which have one parameter more."""
        moved = pairs.rho_prime - self.size * self.amount(pairs)[:, None] * self.line.axis
        return replace(pairs, rho_prime=moved, slid=True)

    def information(self, pairs: Pairs, basis: Array, alone: Array) -> tuple[Array, float]:
        """Return the information by axis, point and slide, and the slope of half the squares by the slide.

        `pairs` are those without the slide; `alone` is the information by axis and point where there is none.
        """
        normal, without, gradient = self._normal(pairs, basis)
        normal[:-1, :-1] += alone - without
        return normal, float(gradient[-1])

    def gain(self, pairs: Pairs) -> float:
        """Return by what half the squares fall by a step to the least squares, of pairs without the slide."""
        normal, _, gradient = self._normal(pairs, tangents(self.line.axis))
        return float(gradient @ np.linalg.lstsq(normal, gradient, rcond=None)[0]) / 2

    @staticmethod
    def is_determined(information: Array) -> bool:
        """Return whether the slide changes the residuals otherwise than axis and point, by more than rounding."""
        diagonal = np.diag(information)
        if not (diagonal > 0).all():
            return False
        return bool(np.linalg.eigvalsh(information / np.sqrt(np.outer(diagonal, diagonal)))[0] > _ROUNDING)

    def _normal(self, pairs: Pairs, basis: Array) -> tuple[Array, Array, Array]:
        """Return Σ w JᵀJ by axis, point and slide, that of a slide of none by axis and point, and Σ w Jᵀd."""
        size = 2 if pairs.point is not None else 4
        normal, without = np.zeros((size + 1, size + 1)), np.zeros((size, size))
        gradient = np.zeros(size + 1)
        for _, block in pairs.blocks():
            d, jacobian = residual_and_jacobian(
                block.rho, block.rho_prime, block.angle, self.line.axis, self.line.point
            )
            w, amount = block.weight, self.amount(block)[:, None, None]
            by = np.concatenate([jacobian[:, :, :3] @ basis, jacobian[:, :, 3:] @ basis], axis=2)[:, :, :size]
            without += np.einsum("n,nip,niq->pq", w, by, by)
            by[:, :, :2] -= self.size * amount * basis
            by = np.concatenate([by, -amount * self.line.axis[:, None]], axis=2)
            normal += np.einsum("n,nip,niq->pq", w, by, by)
            gradient += np.einsum("n,nip,ni->p", w, by, d)
        return normal, without, gradient

    @classmethod
    def fitted(cls, pairs: Pairs, line: Line, *, by_angle: bool) -> Slide:
        """Return the least squares of axis, point and slide, from those without a slide."""
        slide = cls(0.0, by_angle, line)
        for _ in range(_MOST_STEPS):
            basis = tangents(slide.line.axis)
            normal, _, gradient = slide._normal(slide.without(pairs), basis)
            step = -np.linalg.lstsq(normal, gradient, rcond=None)[0]
            axis = slide.line.axis + basis @ step[:2]
            point = slide.line.point + (basis @ step[2:4] if pairs.point is None else 0.0)
            slide = cls(slide.size + float(step[-1]), by_angle, Line(axis / math.sqrt(axis @ axis), point))
            if np.abs(step).max() < _SETTLED:
                break
        return slide


def chance_of(slide: float, variance: float, freedoms: int, *, known: bool) -> float:
    """Return an upper bound of the logarithm of the probability of a slide so far from none, by chance.

    `variance` is that of the slide, known or estimated with `freedoms` degrees of freedom.
    """
    z = slide**2 / variance if variance > 0 else math.inf
    return -z / 2 if known else -freedoms / 2 * math.log1p(z / freedoms)


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
