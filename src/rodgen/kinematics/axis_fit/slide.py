"""A slide along the axis that all pairs share: a screw, an axial run-out, or a body that is pushed while it turns."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.moments import shown
from rodgen.kinematics.axis_fit.pairs import Line, Pairs
from rodgen.kinematics.axis_fit.shared_readings import SharedReadings

CHANCE = 1e-5
"""Probability below which a better fit is not taken for luck."""
_MOST = 50
"""Fits in turn of the axis and of the slide."""


@dataclass(frozen=True, eq=False)
class Slide:
    """What moves the points along the axis.

    Attributes
    ----------
    size, uncertainty : float
        Scaled length, of each pair or of each radian.
    by_angle : bool
        Whether it is in proportion to the angle.
    pairs : Pairs
        Without it.
    line : Line
        The axis without it.
    """

    size: float
    uncertainty: float
    by_angle: bool
    pairs: Pairs
    line: Line

    @classmethod
    def of(cls, pairs: Pairs, line: Line, shared: SharedReadings | None) -> Slide | None:
        """Return the slide that the pairs show; None where chance explains as much."""
        freedoms = 3 * int(np.count_nonzero(pairs.weight)) - pairs.parameters - 1
        if freedoms <= 0:
            return None
        before = float(pairs.half_squares(line).sum())
        found, most = None, 0.0
        for by_angle in (False, True):
            amount = pairs.angle if by_angle else np.ones(len(pairs.angle))
            if by_angle and np.ptp(amount) == 0:
                continue
            weight = pairs.weight * amount
            total, moved, now = float(weight @ amount), pairs, line
            if not total > 0:
                continue
            spread = 1.0 if shared is None else shared.inflation(pairs, amount)
            size = float(weight @ (pairs.rho_prime - pairs.rho) @ now.axis) / total
            variance = pairs.variance if pairs.variance is not None else before / freedoms
            if size**2 * total <= -4 * math.log(CHANCE) * variance * spread:
                continue
            for _ in range(_MOST):
                moved = replace(pairs, rho_prime=pairs.rho_prime - size * amount[:, None] * now.axis)
                now, last = moved.best_line(), size
                size = float(weight @ (pairs.rho_prime - pairs.rho) @ now.axis) / total
                if abs(size - last) <= 1e-12 * abs(size):
                    break
            left = float(moved.half_squares(now).sum())
            left = max(left, 3 * np.count_nonzero(pairs.weight) * (4 * pairs.rounding) ** 2)
            gain = (before - left) / spread
            if gain <= most or (
                -gain / pairs.variance / 2
                if pairs.variance is not None
                else -freedoms / 2 * math.log1p(gain / left)
            ) > math.log(CHANCE):
                continue
            variance = pairs.variance if pairs.variance is not None else left / freedoms
            most = gain
            found = cls(size, math.sqrt(2 * variance * spread / total), by_angle, moved, now)
        return found

    def text(self, outliers: int, count: int, residuals: Array) -> str:
        """Return a sentence for users; `residuals` (N, 3) are those without the slide, scaled."""
        scale = self.pairs.scale
        digits = max(0, 1 - math.floor(math.log10(self.uncertainty * scale))) if self.uncertainty > 0 else 6
        size = f"{self.size * scale:+.{min(digits, 15)}f} ± {self.uncertainty * scale:.2g}"
        how = f"{size} for each radian of the turn" if self.by_angle else size
        rms = math.sqrt(float(np.mean((residuals**2).sum(axis=1)))) * scale
        return (
            f"All pairs are moved by {how} along the axis, as by a screw or an axial run-out: without that the axis "
            f"is {shown(self.line.axis)}, the residuals are {rms:.4g} rms, and {outliers} of {count} pairs "
            "contradict it."
        )
