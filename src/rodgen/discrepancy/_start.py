"""Where a fit starts: the measuring frame in closed form, and the parameters that need a search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy._least_squares import Solution, minimise
from rodgen.discrepancy._problem import Problem
from rodgen.machines._model import Frame

__all__ = ["linear_falls", "nearest_frame", "placed", "searched"]

Array: TypeAlias = NDArray[np.float64]

ROUGH = 0.02
"""A fit that leaves more than this part of the readings' spread may be a wrong valley: others are tried."""
SEARCH_ROWS = 20_000
"""A search looks at so many rows at most, evenly taken."""
ANY_SIZE = np.geomspace(1e-6, 1e6, 97)
"""Sizes that are tried for a parameter in a user's formula, of either sign, internal units: eight a decade."""
SEARCH_STEPS = 400
"""Values that are tried for a searched parameter at most."""


def nearest_frame(places: Array, readings: Array, weight: Array, *, moving: bool) -> Frame:
    """Return the rigid motion that brings predicted places nearest to readings.

    Parameters
    ----------
    places, readings : ndarray, shape (n, 3)
    weight : ndarray, shape (n,)
        Of the squares.
    moving : bool
        Whether the frame may be displaced, too; directions only turn.

    Notes
    -----
    Orthogonal Procrustes problem with the determinant held at 1 (Kabsch 1976, Umeyama 1991).
    """
    weight = weight / weight.sum()
    zero = np.zeros(3)
    from_mean = weight @ places if moving else zero
    to_mean = weight @ readings if moving else zero
    u, _, vt = np.linalg.svd((readings - to_mean).T @ ((places - from_mean) * weight[:, None]))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return Frame(rotation, to_mean - rotation @ from_mean)


def placed(problem: Problem, theta: Array, free: Sequence[int]) -> Solution:
    """Place the frame and fit; where the result is rough, try other frames, too.

    The closed form is exact for a known geometry. Far from it the fit may end in a wrong valley, so that 24 further
    frames, the rotations of a cube, are tried when what is left is a visible part of the readings' spread.
    """
    model = problem.model
    if not model.structure.frame:
        return minimise(problem, theta, Frame.identity(), free)
    moving = model.structure.moving
    first = Frame.identity()
    if model.structure.kind != "distance":
        places = problem.places(theta, first)
        first = nearest_frame(places, problem.observations.reading, problem.weight[:, 0] ** 2, moving=moving)
    best = minimise(problem, theta, first, free)
    if best.cost > ROUGH**2 * problem.spread:
        tried = sorted(
            (minimise(problem, theta, frame, free, max_iterations=8) for frame in _frames(problem, theta)),
            key=lambda s: s.cost,
        )
        for candidate in tried[:3]:
            better = minimise(problem, candidate.theta, candidate.frame, free)
            best = min(best, better, key=lambda s: s.cost)
    return best


def _frames(problem: Problem, theta: Array) -> Iterator[Frame]:
    """Yield frames with the rotations of a cube, each placed so that the means agree."""
    mean_reading = problem.observations.reading.mean(axis=0)
    mean_place = problem.places(theta, Frame.identity()).mean(axis=0)
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]):
        for signs in np.ndindex(2, 2, 2):
            rotation = np.diag(1.0 - 2.0 * np.array(signs))[:, order]
            if np.linalg.det(rotation) > 0:
                if problem.model.structure.kind == "point":
                    yield Frame(rotation, mean_reading - rotation @ mean_place)
                else:
                    yield Frame(rotation, np.zeros(3))


def searched(problem: Problem, solution: Solution, free: Sequence[int], new: Sequence[int]) -> Solution:
    """Give the searched parameters among `new` the values from which the cost falls most.

    Each is tried on a grid while the others of `new` may take any value: the fall of the cost by a linear step is
    compared, so that no candidate needs a fit of its own.
    """
    theta = solution.theta.copy()
    every = -(-problem.rows // SEARCH_ROWS)
    if every > 1:
        problem = Problem(problem.model, problem.observations.take(slice(None, None, every)))
    for index in new:
        parameter = problem.model.parameters[index]
        if not parameter.searched or parameter.key in problem.model.machine.values:
            continue
        others = [i for i in (*free, *new) if i != index]
        best = (-np.inf, theta[index])
        for value in _grid(problem, index):
            theta[index] = value
            fall = _fall(*problem.normal_equations(theta, solution.frame), others)
            best = max(best, (fall, value))
        theta[index] = best[1]
    return replace(solution, theta=theta)


def linear_falls(
    problem: Problem, solution: Solution, free: Sequence[int], new: Sequence[int]
) -> list[float]:
    """Return by how much a Gauss-Newton step with each further parameter would lower the cost of a fit."""
    equations = problem.normal_equations(solution.theta, solution.frame)
    alone = _fall(*equations, free)
    return [_fall(*equations, [*free, index]) - alone for index in new]


def _fall(cost: float, square: Array, gradient: Array, free: Sequence[int]) -> float:
    """Return by how much a Gauss-Newton step would lower the cost."""
    if not np.isfinite(cost):
        return -np.inf
    index = np.asarray(free, int)
    scale = np.sqrt(np.diag(square)[index])
    kept = scale > 0
    index, scale = index[kept], scale[kept]
    values, vectors = np.linalg.eigh(square[np.ix_(index, index)] / np.outer(scale, scale))
    along = vectors.T @ (gradient[index] / scale)
    determined = values > 1e-10 * values[-1]
    return float(np.sum(along[determined] ** 2 / values[determined]))


def _grid(problem: Problem, index: int) -> Array:
    """Return the values that are tried for a parameter."""
    effects = problem.model.machine.effects
    parameter, o = problem.model.parameters[index], problem.observations
    name, own = parameter.slot[-1], any(e.name == parameter.effect and e.definition.own for e in effects)
    if own:
        return np.concatenate([-ANY_SIZE, ANY_SIZE])
    if name == "tau" and o.t is not None:
        t = np.unique(o.t)
        if len(t) > 1:
            return np.asarray(np.geomspace(np.diff(t).min(), 3 * (t[-1] - t[0]), 60))
    if name == "P":
        joint = [joint.name for joint in problem.model.machine.joints].index(str(parameter.place))
        q = np.unique(o.q[:, joint])
        if len(q) > 3:
            span = q[-1] - q[0]
            # frequencies closer than a quarter of 1/span look alike; above half the number of places none is seen
            highest = (len(q) - 1) / 2
            return span / np.linspace(0.75, highest, int(min(SEARCH_STEPS, 4 * highest)))
    return np.array([1.0])
