"""The remark that many pairs contradict the fitted axis, when they do.

A robust loss is safe while the bad pairs are a minority without a common answer. When many pairs contradict the rest
consistently, for example because the sign of their angle is reversed, the data support two axes about equally; the fit
then takes one of them, or lies between both and estimates a noise that hides the conflict. So the two fifths of the
pairs that agree best with one another are fitted alone: if their noise is far smaller than that of the fit with all
pairs, and the other pairs contradict them, the remark says so.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.kinematics.axis_fit.moments import tangents
from rodgen.kinematics.axis_fit.noise import Noise
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.residual import Line
from rodgen.kinematics.axis_fit.robust import Loss, best_agreement, chi_cut
from rodgen.kinematics.axis_fit.vectors import shown

# Share of the pairs whose contradiction leaves no answer safe.
_MANY = 0.3
# Share of the pairs that are searched for as agreeing: fewer than half, so that one of two camps is enough.
_CAMP = 0.4
# By how much the fit's noise must exceed that of the agreeing pairs. They are the best of many choices, so
# their own noise is already taken at a multiple.
_FAR_BETTER = 10.0
# Least ratio of information within a camp for its axis to be one.
_LEAST_INFORMATION = 1e-4


def contradiction(pairs: Pairs, loss: Loss, noise: Noise, line: Line) -> list[str]:
    """Return one sentence when three pairs in ten or more contradict the others, else none."""
    count = int(noise.used.sum())
    bad = noise.outliers
    hidden = loss.name != "linear" and pairs.variance is None
    if bad.sum() < _MANY * count:
        camp = _hidden_camp(pairs, noise) if hidden else None
        if camp is None:
            return []
        line, bad = camp
        start = (
            f"{int(bad.sum())} of {count} pairs contradict the other {count - int(bad.sum())}, which agree "
            f"on the axis {shown(line.axis)} far better than with the fit"
        )
    else:
        start = f"{int(bad.sum())} of {count} pairs contradict the axis"
    good = noise.used & ~bad
    against = _axis_of(pairs, bad, _variance(pairs, good, line))
    if against is None:
        return [f"{start}: with so many the answer is not safe."]
    opposite = "the opposite axis " if float(against @ line.axis) < -0.99 else "the axis "
    return [
        f"{start}; they agree with one another on {opposite}{shown(against)}: with so many the answer is not "
        "safe (check the signs of the angles and the order of the points)."
    ]


def _hidden_camp(pairs: Pairs, noise: Noise) -> tuple[Line, Mask] | None:
    """Return the line of the pairs that agree far better than the fit, and which pairs contradict it."""
    used = np.flatnonzero(noise.used)
    count = max(math.ceil(_CAMP * len(used)), 3)
    if len(used) - count < max(_MANY * len(used), 1) or not noise.variance > 0:
        return None
    line = best_agreement(pairs.only(used), _CAMP)
    squares = pairs.half_squares(line)
    inside = np.sort(used[np.argsort(squares[used], kind="stable")[:count]])
    own = max(float(squares[inside].sum()) / (3 * count - pairs.parameters), (4 * pairs.rounding) ** 2)
    # The factor of the least median of squares, for a variance that was made small by choice.
    own *= (1 + 5 / (count - pairs.parameters / 3)) ** 2
    bad = noise.used & (squares > chi_cut(len(used)) ** 2 * own)
    if noise.variance < _FAR_BETTER**2 * own or bad.sum() < _MANY * len(used):
        return None
    return (line, bad) if _is_axis(pairs, inside, line) else None


def _axis_of(pairs: Pairs, bad: Mask, variance: float) -> Array | None:
    """Return the axis on which the contradicting pairs agree, to three times the noise of the others, or None."""
    chosen = np.flatnonzero(bad)
    if 3 * len(chosen) - pairs.parameters < 5:
        return None
    line = pairs.only(chosen).best_line()
    if not _is_axis(pairs, chosen, line):
        return None
    return line.axis if _variance(pairs, bad, line) <= 9 * variance else None


def _variance(pairs: Pairs, chosen: Mask, line: Line) -> float:
    freedoms = max(3 * int(chosen.sum()) - pairs.parameters, 1)
    return max(float(pairs.half_squares(line)[chosen].sum()) / freedoms, (4 * pairs.rounding) ** 2)


def _is_axis(pairs: Pairs, chosen: NDArray[np.intp], line: Line) -> bool:
    """Return whether these pairs alone determine the line, and not by the noise of repeated readings."""
    H = pairs.only(chosen).moments().hessian(line.axis, line.point, tangents(line.axis))
    values = np.linalg.eigvalsh(H)
    return bool(values[0] > _LEAST_INFORMATION * values[-1])
