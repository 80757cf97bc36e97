"""Remarks on a fitted axis: suspicious angles, outliers, noise, a wrong known point."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rodgen.kinematics.axis_fit.contradiction import contradiction
from rodgen.kinematics.axis_fit.noise import Noise
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.residual import Line
from rodgen.kinematics.axis_fit.robust import Loss
from rodgen.kinematics.axis_fit.solve import MOST_REWEIGHTINGS, Solution

# Probability below which a better fit is not taken for luck.
_CHANCE = 1e-5
# A statistic this many of its standard deviations off is no accident.
_NO_ACCIDENT = 5.0
# Below this many degrees of freedom the estimated noise is too uncertain for the usual two sigma.
_FEW_FREEDOMS = 10
_DEGREES = 4 * math.pi


def remarks_on(
    pairs: Pairs, solution: Solution, loss: Loss, noise: Noise, line: Line, determined: bool
) -> list[str]:
    """Return sentences, the most important first."""
    remarks: list[str] = []
    largest = max(float(np.abs(block.angle).max()) for _, block in pairs.blocks())
    if largest > _DEGREES:
        remarks.append(f"An angle is {largest:.4g} rad: angles are taken in rad, not in degrees.")
    if math.isnan(noise.variance):
        remarks.append(
            "The pairs leave no degrees of freedom to estimate the noise: give sigma to learn the uncertainty."
        )
    bad, used = int(noise.outliers.sum()), int(noise.used.sum())
    if bad and loss.name == "linear":
        remarks.append(
            f"{bad} of {used} pairs are farther off than noise explains and still count fully: loss='huber' "
            "would limit their influence."
        )
    remarks += contradiction(pairs, loss, noise, line)
    if determined and pairs.variance is None and 0 < noise.dof < _FEW_FREEDOMS:
        remarks.append(_few_freedoms(noise.dof))
    excess = 0.0 if noise.chi_square is None else noise.chi_square - noise.dof
    if noise.dof > 0 and abs(excess) > _NO_ACCIDENT * math.sqrt(2 * noise.dof):
        remarks.append(
            f"The residuals are {math.sqrt(1 + excess / noise.dof):.3g} times what sigma leads to expect; "
            "the reported uncertainties are those of sigma."
        )
    if not solution.converged:
        remarks.append(
            f"The weights of loss={loss.name!r} had not settled after {MOST_REWEIGHTINGS} solutions."
        )
    if pairs.point is not None:
        remarks += _point_off(pairs, solution, noise, line) + _lengths_differ(pairs, noise, line)
    return remarks


def _few_freedoms(dof: int) -> str:
    """Return how far the 95 % region reaches when the noise is estimated with `dof` degrees of freedom.

    The direction has two components: the region is where their squares, in units of the uncertainties, sum
    to less than twice the quantile of F with 2 and `dof` degrees of freedom, dof (0.05^(-2/dof) - 1) in
    closed form; with a known noise it is -2 log 0.05.
    """
    reach = math.sqrt(dof * (0.05 ** (-2 / dof) - 1))
    known = math.sqrt(-2 * math.log(0.05))
    degrees = "1 degree" if dof == 1 else f"{dof} degrees"
    return (
        f"The noise is estimated with {degrees} of freedom: the region that holds the direction with 95 % "
        f"probability reaches to {reach:.2g} standard uncertainties, {reach / known:.2g} times as far as "
        "if the noise were known."
    )


def _point_off(pairs: Pairs, solution: Solution, noise: Noise, line: Line) -> list[str]:
    """Return a remark when a free point fits better than two more parameters do by chance."""
    good = noise.good
    freedoms = 3 * int(good.sum()) - 4
    if freedoms <= 0:
        return []
    some = replace(pairs.weighted(solution.share * good), point=None)
    free = some.best_line().nearest(np.zeros(3))
    left = sum(float(block.half_squares(free).sum()) for _, block in some.blocks())
    gain = sum(float(block.half_squares(line).sum()) for _, block in some.blocks()) - left
    if gain <= (64 * pairs.rounding) ** 2 * int(good.sum()):
        return []
    # Survival functions of χ² with 2 degrees of freedom, and of F with 2 and `freedoms`, in closed form.
    if pairs.variance is not None:
        chance = math.exp(-gain / pairs.variance / 2)
    else:
        chance = math.exp(-freedoms / 2 * math.log1p(gain / left)) if left > 0 else 0.0
    if chance > _CHANCE:
        return []
    away = math.sqrt(float(free.point @ free.point)) * pairs.scale
    return [
        f"With a free point the pairs fit far better, and the axis passes {away:.3g} from the point given: is "
        "that point on the axis?"
    ]


def _lengths_differ(pairs: Pairs, noise: Noise, line: Line) -> list[str]:
    """Return a remark when distances from the known point change more than the rest of the residuals explains."""
    good = noise.good
    count = int(good.sum())
    changes = np.empty(len(good))
    squares = radial = 0.0
    for rows, block in pairs.blocks():
        before, after = (np.sqrt((x**2).sum(axis=-1)) for x in (block.rho, block.rho_prime))
        changes[rows] = change = np.abs(after - before) * good[rows]
        squares += float(change @ change)
        radial += float(block.weight @ change**2) / count / 2
    worst = int(np.argmax(changes))
    if changes[worst] <= 64 * pairs.rounding:
        return []
    if pairs.variance is not None:
        limit = pairs.variance * (1 + _NO_ACCIDENT * math.sqrt(2 / count))
    else:
        freedoms = 2 * count - 2
        if freedoms <= 0:
            return []
        across = max(float(pairs.half_squares(line).sum(where=good)) - count * radial, 0.0) / freedoms
        limit = across * (1 + _NO_ACCIDENT * math.sqrt(2 / count + 2 / freedoms))
    if radial <= limit:
        return []
    rms = math.sqrt(squares / count) * pairs.scale
    return [
        f"Distances from the known point change by {rms:.3g} rms (most in pair {worst}), more than the other "
        "residuals explain."
    ]
