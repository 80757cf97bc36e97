"""A slide along the axis that all pairs share: a screw, an axial run-out, or a body that is pushed while it turns.

A slide of s a pair, or of s for each radian, makes the residual d - a s e, with a = 1 or the angle. It is one more
parameter of the fit: where chance explains it, its estimate is reported and none is taken; otherwise it is fitted with
the axis. Both are least squares of the same likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

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
