"""The axis and point of least weighted squares, or of least robust loss, and the other local optimum.

The solution is the global minimum in closed form (:mod:`.moments`, :mod:`.sphere`); a
robust loss repeats it with reduced weights from a start that gross errors cannot move
(:mod:`.robust`); Newton steps on the residuals themselves remove what rounding of the
sums has left: the sums lose the square of the condition number, the residuals only its first power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.axis_fit.moments import Moments, tangents
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.residual import Line, residual_gradient
from rodgen.kinematics.axis_fit.robust import Loss, robust_start, trimmed_variance
from rodgen.kinematics.axis_fit.sphere import global_maximum, maximise_on_sphere

# Reweighting converges by a factor of three to ten a solution; a fit that has not converged by then gets a remark.
MOST_REWEIGHTINGS = 100
_SETTLED = 1e-12
# Two optima of one data set are farther apart than the step from one solution to the next.
_SAME_OPTIMUM = 0.99
# From the closed form one step is enough, and one more shows that it was.
_MOST_NEWTON_STEPS = 5
_STEP_ENOUGH = 1e-12
# The closed form is nearer than this wherever a step makes sense at all.
_LONGEST_STEP = 1e-3
# Turns with less than this share of the best one's information are left as the closed form has them.
_LEAST_INFORMATION = 1e-11


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum, the other local optimum if it is worth a comparison, and the weight of each pair."""

    best: Line
    other: Line | None
    share: Array
    """(N,) factor of the loss on each pair's weight; 0 for pairs that are left out."""
    iterations: int
    converged: bool


def solve(pairs: Pairs, loss: Loss) -> Solution:
    """Return the optimum, the other local optimum, and the weight that the loss leaves each pair.

    Raises
    ------
    RodgenError
        When there are too few pairs for a robust loss.
    """
    used = pairs.weight > 0
    counted = pairs if used.all() else pairs.only(used)
    share, iterations, converged, near = np.broadcast_to(1.0, counted.weight.shape), 0, True, None
    if loss.name != "linear":
        needed = 4 if pairs.point is None else 3
        if len(share) < needed:
            raise RodgenError(
                f"loss={loss.name!r} has {len(share)} pairs; it needs at least {needed} to tell a bad one from "
                "the good ones; use loss='linear'"
            )
        near, share, iterations, converged = _reweight(counted, loss, *robust_start(counted))
        counted = counted.weighted(share)
    best, other = _optima(counted, near)
    everyone = np.zeros(len(used))
    everyone[used] = share
    return Solution(best, other, everyone, iterations, converged)


def _optima(pairs: Pairs, near: Line | None) -> tuple[Line, Line | None]:
    """Return both optima for given weights; `near` says to which one the weights belong."""
    moments = pairs.moments()
    A, b = moments.quadratic()
    first, second = maximise_on_sphere(A, b)
    if near is not None and second @ near.axis > first @ near.axis:
        first, second = second, first
    best = _polish(pairs, moments, first)
    if not np.isfinite(second).all():
        return best, None
    # ½ Σ w |d|² is a constant less the quadratic: a far worse optimum is known without another look at
    # the pairs.
    worse = float(first @ A @ first + b @ first - second @ A @ second - b @ second)
    if worse > 100 * float(pairs.half_squares(best).sum()) + 1e-6 * float(np.abs(A).max()):
        return best, None
    return best, _polish(pairs, moments, second)


def _reweight(pairs: Pairs, loss: Loss, line: Line, variance: float) -> tuple[Line, Array, int, bool]:
    """Solve with the loss's weights until they stay; each solution is a global one.

    The noise, where it is not given, follows the solutions until it stays too. Which pairs it is taken from
    changes by whole pairs and may go in a circle: half way it is held. Exact pairs have the noise of rounding.
    """
    share = np.ones(len(pairs.weight))
    for count in range(1, MOST_REWEIGHTINGS + 1):
        squares = pairs.half_squares(line)
        if pairs.variance is not None:
            variance = pairs.variance
        elif count <= MOST_REWEIGHTINGS // 2:
            variance = trimmed_variance(squares, pairs.parameters, variance)
        squares /= max(variance, pairs.rounding**2)
        share = loss.weight(np.sqrt(squares, out=squares))
        del squares
        moments = pairs.weighted(share).moments()
        axis = global_maximum(*moments.quadratic())
        if axis @ line.axis < _SAME_OPTIMUM:
            # Of two optima stay with the one that the start has chosen.
            axis = max(maximise_on_sphere(*moments.quadratic()), key=lambda e: float(e @ line.axis))
        new = Line(axis, moments.point(axis)).nearest(line.point)
        moved = max(float(np.abs(axis - line.axis).max()), float(np.abs(new.point - line.point).max()))
        line = new
        if moved <= _SETTLED:
            return line, share, count, True
    return line, share, MOST_REWEIGHTINGS, False


def _gradient(pairs: Pairs, line: Line) -> tuple[Array, Array]:
    parts = [
        residual_gradient(block.rho, block.rho_prime, block.angle, block.weight, line.axis, line.point)
        for _, block in pairs.blocks()
    ]
    by_axis, by_point = zip(*parts, strict=True)
    return np.sum(by_axis, axis=0), np.sum(by_point, axis=0)


def _polish(pairs: Pairs, moments: Moments, axis: Array) -> Line:
    """Return the line after Newton steps on the residuals, in the turns and shifts that are determined."""
    point = moments.point(axis)
    squares = sum(float(((block.rho - point) ** 2).sum()) for _, block in pairs.blocks())
    arm = math.sqrt(squares / len(pairs.angle)) or 1.0
    last = _LONGEST_STEP
    for _ in range(_MOST_NEWTON_STEPS):
        basis = tangents(axis)
        by_axis, by_point = _gradient(pairs, Line(axis, point))
        gradient, units = by_axis @ basis / arm, np.repeat(1 / arm, 2)
        if moments.free:
            gradient = np.concatenate([gradient, by_point @ basis])
            units = np.concatenate([units, np.ones(2)])
        values, vectors = np.linalg.eigh(moments.hessian(axis, point, basis) * np.outer(units, units))
        kept = values > max(_LEAST_INFORMATION * values[-1], 0.0)
        step = -vectors[:, kept] @ ((vectors[:, kept].T @ gradient) / values[kept])
        size = float(np.abs(step).max()) / arm
        if not size < last / 2:
            break
        axis = axis + basis @ step[:2] / arm
        axis = axis / math.sqrt(axis @ axis)
        if moments.free:
            point = point + basis @ step[2:]
        if size < _STEP_ENOUGH:
            break
        last = size
    return Line(axis, point)
