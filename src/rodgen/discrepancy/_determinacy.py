"""What the data determine: the covariance of the parameters, and the directions in which nothing holds them.

The Jacobian is reduced to a triangle by orthogonal transformations, block by block, so that its condition number is
not squared as in the normal equations. Its singular values, with the columns scaled to equal length, tell which
combinations of parameters change the readings at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy._problem import Problem
from rodgen.machines._model import Frame
from rodgen.machines._parameters import Parameter

__all__ = ["Determinacy", "Direction", "determinacy"]

Array: TypeAlias = NDArray[np.float64]

NOTHING = 1e-9
"""A combination whose effect is below this part of the largest one, all parameters scaled alike, changes nothing:
rounding in the Jacobian of a gauge direction leaves about 1e-14, a combination worth estimating at least 1e-7."""
SHARE = 0.05
"""Parts of a combination below this are not named."""


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that changes no reading.

    Attributes
    ----------
    parts : tuple of (str, float)
        Keys of the parameters and their parts, the largest first, in internal units, the largest set to 1.
    gauge : bool
        Whether it is a choice of coordinates: a free frame moves with the machine, and nothing that is measured changes.
    text : str
        One sentence.
    """

    parts: tuple[tuple[str, float], ...]
    gauge: bool
    text: str


@dataclass(frozen=True)
class Determinacy:
    """What the data say of the parameters.

    Attributes
    ----------
    covariance : ndarray, shape (parameters, parameters)
        For unit variance of the weighted residuals, internal units; zero for what is not estimated. Along directions
        that are not determined it is that of the solution nearest to the start.
    undetermined : ndarray of bool, shape (parameters,)
        Parameters whose value rests on such a direction.
    rank : int
        Number of combinations that are determined.
    directions : tuple of Direction
    """

    covariance: Array
    undetermined: NDArray[np.bool_]
    rank: int
    directions: tuple[Direction, ...]


def determinacy(problem: Problem, theta: Array, frame: Frame, free: Sequence[int]) -> Determinacy:
    """Look at the Jacobian where a fit ended.

    Parameters
    ----------
    problem : Problem
    theta, frame : ndarray, Frame
        The end of the fit.
    free : sequence of int
        The parameters that were adjusted.
    """
    p = len(problem.model.parameters)
    covariance, undetermined = np.zeros((p, p)), np.zeros(p, bool)
    index = np.asarray(free, int)
    if not len(index):
        return Determinacy(covariance, undetermined, 0, ())
    triangle = _triangle(problem, theta, frame, index)
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0.0] = 1.0
    _, values, vt = np.linalg.svd(triangle / scale)
    values = np.concatenate([values, np.zeros(len(index) - len(values))])
    held = values > NOTHING * max(values[0], 1e-300)
    held &= values > 0
    v = vt[held].T / values[held]
    covariance[np.ix_(index, index)] = (v @ v.T) / np.outer(scale, scale)
    null = vt[~held]
    undetermined[index] = np.any(np.abs(null) > SHARE * 0.1, axis=0) if len(null) else False
    directions = tuple(_direction(problem, index, d, scale) for d in _sparse(null))
    return Determinacy(covariance, undetermined, int(held.sum()), directions)


def _triangle(problem: Problem, theta: Array, frame: Frame, index: NDArray[np.int_]) -> Array:
    """Return R of the QR decomposition of the weighted Jacobian, in bounded memory."""
    found = np.zeros((0, len(index)))
    waiting: list[Array] = []
    for _, block in problem.jacobian_blocks(theta, frame):
        waiting.append(block.reshape(-1, block.shape[-1])[:, index])
        if sum(map(len, waiting)) > 50 * len(index) + 20_000:
            found = np.linalg.qr(np.concatenate([found, *waiting]), mode="r")
            waiting = []
    return np.linalg.qr(np.concatenate([found, *waiting]), mode="r") if waiting else found


def _sparse(null: Array) -> Array:
    """Rotate a basis of the directions so that each has few parts: row echelon form with the largest pivots."""
    basis = null.copy()
    done: list[int] = []
    for row in range(len(basis)):
        rest = np.abs(basis[row:])
        rest[:, done] = 0.0
        r, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        basis[[row, row + r]] = basis[[row + r, row]]
        basis[row] /= basis[row, column]
        others = np.arange(len(basis)) != row
        basis[others] -= np.outer(basis[others, column], basis[row])
        done.append(int(column))
    return basis


def _direction(problem: Problem, index: NDArray[np.int_], direction: Array, scale: Array) -> Direction:
    parameters = [problem.model.parameters[i] for i in index]
    values = direction / scale
    shares = np.abs(direction) / np.abs(direction).max()
    order = [i for i in np.argsort(-shares, kind="stable") if shares[i] >= SHARE]
    largest = values[order[0]]
    parts = tuple((parameters[i].key, float(values[i] / largest)) for i in order)
    gauge = any(parameters[i].slot[0] in {"frame", "shift"} for i in order) and len(order) > 1
    return Direction(parts, gauge, _sentence([parameters[i] for i in order], gauge))


def _sentence(parameters: Sequence[Parameter], gauge: bool) -> str:
    names = [p.key for p in parameters]
    if len(names) == 1:
        return f"{names[0]} changes no reading: these data say nothing of it."
    listed = ", ".join(names[:-1]) + f" and {names[-1]}"
    if gauge:
        return (
            f"{listed} move together without a change of any reading: a choice of coordinates, not a fault."
        )
    return f"{listed} change together without a change of any reading: only their combination is determined."
