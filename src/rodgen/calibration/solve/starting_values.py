"""Where a fit starts: the measuring frame in closed form, and the parameters that need a search."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.attitudes import nearest_attitudes, nearest_frame, nearest_rotation
from rodgen.calibration.solve.least_squares import Solution, minimise
from rodgen.data.poses import positions
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.measured import HEIGHT, TURNS
from rodgen.machines.model import Frame
from rodgen.machines.rigid import rotation_matrix, rotation_vector
from rodgen.stages import step
from rodgen.statistics.columns import falls_from_products, orthonormal_basis, project_out, unit_diagonal
from rodgen.statistics.decompositions import eigh, lstsq

__all__ = [
    "linear_falls",
    "most_waves",
    "nearest_frames",
    "placed",
    "searched",
    "thinned",
    "trilaterated",
    "wave_falls",
    "with_attitudes",
]

Array: TypeAlias = NDArray[np.float64]

ROUGH = 0.005
"""A fit that leaves more than this part of the readings' spread may be a wrong valley: others are tried."""
SEARCH_ROWS = 20_000
"""A search looks at so many rows at most."""
PERIOD_ROWS = 5_000
"""And that for a period, which tries many more values."""
LEAST_WAVES, MOST_WAVES = 0.75, 1000.0
"""Waves over the whole way that are tried. Neighbours are half a wave apart: a quarter off leaves 80 % of the fall."""
AT_ONCE = 64
"""Waves whose columns are in memory at once."""
HIDDEN = 1e-10
"""Part of a wave's square below which what a base leaves of it is taken for rounding."""
GRID = 0.01
"""Places are on a grid when all distances are whole multiples of the least one, within this."""
PEAKS = 10
"""The best of them, from which a fit is tried."""
ANY_SIZE = np.geomspace(1e-6, 1e6, 97)
"""Sizes that are tried for a parameter in a user's formula, of either sign, internal units: eight a decade."""


def placed(problem: Problem, theta: Array, free: Sequence[int]) -> Solution:
    """Place the frame and fit; where the result is rough, try other frames, too.

    The closed form is exact for a known geometry. Far from it the fit may end in a wrong valley, so that others all
    around are tried when the residuals are a visible part of the readings' spread.
    """
    model = problem.model
    if model.structure.measurand.has_attitude:
        turned = with_attitudes(thinned(problem), theta, free)
        theta = min((theta, turned), key=lambda t: problem.cost(t, nearest_frames(problem, t)[0]))

    if model.structure.measurand.has_zero:
        theta = with_zeros(thinned(problem), theta, free)

    def fitted(theta: Array, frame: Frame) -> Solution:
        return minimise(problem, theta, frame, free, progress=step)

    if not model.structure.frame:
        return fitted(theta, Frame.identity())
    best = _best(fitted(theta, frame) for frame in nearest_frames(problem, theta))
    if best.cost > ROUGH**2 * problem.spread:
        some = thinned(problem)
        tried = sorted(
            (minimise(some, theta, frame, free, max_iterations=8) for frame in _others(some, theta)),
            key=lambda s: s.cost,
        )
        best = _best([best, *(fitted(s.theta, s.frame) for s in tried[:3])])
    return best


def thinned(problem: Problem, most: int = SEARCH_ROWS) -> Problem:
    """Return the problem with as many rows as a search looks at: any, as every tenth may be of one kind."""
    if problem.count <= most:
        return problem
    most = min(most, problem.rows)
    return problem.take(np.sort(np.random.default_rng(0).choice(problem.rows, most, replace=False)))


def _best(solutions: Iterable[Solution]) -> Solution:
    return min(solutions, key=lambda s: s.cost)


def nearest_frames(problem: Problem, theta: Array) -> list[Frame]:
    """Return the frame, or for distances the few frames, that are right where the geometry is.

    Of these and one that was fitted before, only the better one: the instrument stands there still, or elsewhere now.
    """
    if not problem.model.structure.frame:
        return [Frame.identity()]
    frames, known = _in_closed_form(thinned(problem), theta), Frame.fitted(problem.model.machine.values)
    if known is not None:
        return [min((known, *frames), key=lambda frame: problem.cost(theta, frame))]
    return frames


def _in_closed_form(problem: Problem, theta: Array) -> list[Frame]:
    readings = problem.observations.reading
    places = problem.places(theta, Frame.identity())
    if not np.isfinite(places).all():  # the fit says so
        return [Frame.identity()]
    if problem.model.structure.measurand is HEIGHT:  # a plate lies nearly as in the file
        return [Frame.identity()]
    if problem.model.structure.measurand.has_origin:
        return [_standing(problem, at) for at in trilaterated(places, readings[:, 0])]
    if problem.model.structure.measurand.has_attitude:
        attitudes = problem.attitudes(theta, Frame.identity())
        read = np.asarray(problem.observations.attitude) * problem.weight[:, -1, None, None]
        turn = nearest_rotation(np.einsum("nij,nkj->ik", read, attitudes))
        if not problem.model.structure.moving:
            return [Frame(turn, np.zeros(3))]
        share = problem.weight[:, 0] / problem.weight[:, 0].sum()
        return [Frame(turn, share @ readings - turn @ (share @ places))]
    moving = problem.model.structure.moving
    return [nearest_frame(places, readings, problem.weight[:, 0] ** 2, moving=moving)]


def with_attitudes(problem: Problem, theta: Array, free: Sequence[int]) -> Array:
    """Return the values with those attitudes of targets that are free as attitudes were read.

    The frame is found with that of the target with most rows, then the others in this frame.
    """
    model, o = problem.model, problem.observations
    assert o.attitude is not None
    predicted = problem.attitudes(theta, Frame.identity())
    numbers = [[model.index.get(("target", k, x)) for x in TURNS] for k in range(len(model.machine.targets))]
    theta, frame = theta.copy(), np.eye(3)
    if not np.isfinite(predicted).all():  # the fit says so
        return theta
    counts = np.bincount(o.target, minlength=len(numbers))
    for k in np.argsort(-counts, kind="stable"):
        of = o.target == k
        if not counts[k] or not set(numbers[k]) <= set(free):
            continue
        if model.structure.frame and k == np.argmax(counts):
            frame, body = nearest_attitudes(predicted[of], o.attitude[of])
        else:
            body = nearest_rotation(np.einsum("nji,lj,nlk->ik", predicted[of], frame.T, o.attitude[of]))
        turned = model.attitude(theta, k) @ body @ rotation_matrix(model.machine.targets[k].attitude).T
        theta[numbers[k]] = rotation_vector(turned)
    return theta


def with_zeros(problem: Problem, theta: Array, free: Sequence[int]) -> Array:
    """Return the values with those zeros of instruments that are free as angles were read: circular means."""
    theta, model = theta.copy(), problem.model
    off = model.structure.measurand.error(problem.residuals(theta, Frame.identity()))[:, 0]
    for k in range(len(model.machine.targets)):
        index, of = model.index.get(("target", k, "zero")), problem.observations.target == k
        if index in free and of.any():
            theta[index] += float(np.angle(np.mean(np.exp(1j * off[of]))))
    return theta


def _others(problem: Problem, theta: Array) -> Iterator[Frame]:
    """Yield frames all around: for distances from all sides, else with the rotations of a cube; the means agree."""
    if problem.model.structure.measurand is HEIGHT:
        return
    mean_reading = problem.observations.reading.mean(axis=0)
    mean_place = problem.places(theta, Frame.identity()).mean(axis=0)
    if problem.model.structure.measurand.has_origin:  # how the frame is turned changes nothing
        for side in np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)]) - 1.0:
            yield _standing(problem, mean_place + mean_reading * side / np.linalg.norm(side))
        return
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]):
        for signs in np.ndindex(2, 2, 2):
            rotation = np.diag(1.0 - 2.0 * np.array(signs))[:, order]
            if np.linalg.det(rotation) > 0:
                if problem.model.structure.moving:
                    yield Frame(rotation, mean_reading - rotation @ mean_place)
                else:
                    yield Frame(rotation, np.zeros(3))


def _standing(problem: Problem, at: Array) -> Frame:
    """Return the frame in which distances are measured from a place in machine axes."""
    return Frame(np.eye(3), np.asarray(problem.model.machine.measured.origin) - at)


def trilaterated(places: Array, distances: Array) -> list[Array]:
    """Return points from which places have given distances: one by a linear equation, and two on either side.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
    distances : ndarray, shape (n,)

    Notes
    -----
    |x - p|² = d² is linear in p and |p|². Where the places are nearly in a plane this determines the height of p over
    it badly; |p|² determines it better, but not the side.
    """
    mean = places.mean(axis=0)
    around = places - mean
    _, axes = eigh(around.T @ around)  # the first is the normal of that plane
    along = around @ axes
    right = distances**2 - np.sum(along**2, axis=1)
    alone, level = (
        lstsq(np.column_stack([-2 * along[:, first:], np.ones(len(along))]), right, relative=None)
        for first in (0, 1)
    )
    height = np.sqrt(max(level[2] - level[0] ** 2 - level[1] ** 2, 0.0))
    return [mean + axes @ p for p in (alone[:3], [height, *level[:2]], [-height, *level[:2]])]


def searched(problem: Problem, solution: Solution, free: Sequence[int], new: Sequence[int]) -> Solution:
    """Give the searched parameters among `new` the values from which the cost falls most.

    Each is tried on a grid while the others of `new` may take any value: what a linear step would leave of the cost is
    compared, so that no candidate needs a fit of its own.
    """
    theta = solution.theta.copy()
    problem = thinned(problem)
    for index in new:
        parameter = problem.model.parameters[index]
        if not parameter.searched or parameter.key in problem.model.machine.values:
            continue
        others = [i for i in (*free, *new) if i != index]
        waves = [i for i in new if problem.model.parameters[i].slot[-1] in {"a", "b"}]
        if parameter.searched is StartSearch.PERIOD and len(waves) == 2 and not theta[waves].any():
            theta[index] = _period(problem, replace(solution, theta=theta), free, waves, index)
            continue
        best = (np.inf, theta[index])
        for value in _grid(problem, index):
            theta[index] = value
            cost, square, gradient = problem.normal_equations(theta, solution.frame)
            best = min(best, (cost - _fall(cost, square, gradient, others), value))
        theta[index] = best[1]
    return replace(solution, theta=theta)


def _period(
    problem: Problem, solution: Solution, free: Sequence[int], waves: Sequence[int], index: int
) -> float:
    """Return the period with which a wave along a joint's way lowers the cost most: a periodogram of the residuals.

    As in `searched`, but a wave of any period is a multiple of how the readings follow the joint, so that the kernels
    are called only once. What the parameters `free` can make up for is taken off (Lomb 1976, Scargle 1982, with
    weights and nuisance parameters).
    """
    some = thinned(problem, PERIOD_ROWS)
    joint = problem.model.machine.number_of(str(problem.model.parameters[index].place))
    q = some.observations.q[:, joint]
    places = np.unique(q)
    span = places[-1] - places[0]
    highest = most_waves(places)
    if highest < LEAST_WAVES:
        return float(span) or 1.0
    jacobian = some.jacobian(solution.theta, solution.frame)
    residual = some.residuals(solution.theta, solution.frame, weighted=True).ravel()
    at = 2 * np.pi * q / solution.theta[index]
    follows = jacobian[:, :, waves[0]] * np.sin(at)[:, None] + jacobian[:, :, waves[1]] * np.cos(at)[:, None]
    base = orthonormal_basis(jacobian[:, :, list(free)].reshape(len(residual), -1))
    residual = project_out(base, residual)

    def falls(frequencies: Array) -> Array:
        return wave_falls(base, residual, follows, q, 2 * np.pi / span * frequencies)

    rough = np.arange(LEAST_WAVES, highest + 0.25, 0.5)
    height = np.pad(falls(rough), 1)
    peaks = np.flatnonzero((height[1:-1] >= height[:-2]) & (height[1:-1] >= height[2:]))
    best = []
    for peak in peaks[np.argsort(-height[1:-1][peaks], kind="stable")][:PEAKS]:
        fine = np.linspace(max(rough[peak] - 0.5, LEAST_WAVES), rough[peak] + 0.5, 21)
        theta = solution.theta.copy()
        theta[index] = span / fine[int(np.argmax(falls(fine)))]
        ended = minimise(some, theta, solution.frame, [*free, *waves, index])
        best.append((ended.cost, float(ended.theta[index])))
    return min(best)[1]


def wave_falls(base: Array, residual: Array, follows: Array, q: Array, frequencies: Array) -> Array:
    """Return by how much a wave of each frequency lowers the sum of squares that a base leaves.

    Parameters
    ----------
    base : ndarray, shape (n m, p)
        Orthonormal.
    residual : ndarray, shape (n m,)
        Across the base.
    follows : ndarray, shape (n, m)
        How the readings follow the coordinate.
    q : ndarray, shape (n,)
        The coordinate.
    frequencies : ndarray, shape (f,)
        Radians by one unit of q.

    Returns
    -------
    ndarray, shape (f,)
    """
    n, m = follows.shape
    # a wave's columns are products of `follows` and a number for each row: their products are sums over rows
    onto = np.einsum("nmp,nm->np", base.reshape(n, m, -1), follows)
    weight = np.sum(follows**2, axis=1)
    pull = np.sum(residual.reshape(n, m) * follows, axis=1)
    falls = []
    for several in np.array_split(frequencies, -(-len(frequencies) // AT_ONCE)):
        phase = np.multiply.outer(q, several)
        s, c = np.sin(phase), np.cos(phase)
        along_s, along_c = onto.T @ s, onto.T @ c
        ss = weight @ s**2 - np.sum(along_s**2, axis=0)
        cc = weight @ c**2 - np.sum(along_c**2, axis=0)
        sc = weight @ (s * c) - np.sum(along_s * along_c, axis=0)
        rs, rc = pull @ s, pull @ c
        det = ss * cc - sc**2
        with np.errstate(invalid="ignore", divide="ignore"):
            fall = (cc * rs**2 - 2 * sc * rs * rc + ss * rc**2) / det
        # else sine or cosine is zero at all coordinates, the base makes up for it, or both are one
        seen = (np.minimum(ss, cc) > HIDDEN * weight.sum()) & (det > HIDDEN * ss * cc)
        falls.append(np.where(seen, fall, 0.0))
    return np.concatenate(falls)


def most_waves(places: Array) -> float:
    """Return the most waves over the way that the places can show: on a grid half its steps, else any number."""
    if len(places) < 2:
        return 0.0
    step = grid_step(places)
    return float(min((places[-1] - places[0]) / step / 2, MOST_WAVES)) if step else MOST_WAVES


def grid_step(places: Array) -> float:
    """Return the step of the grid that places, in order, lie on, as encoders read them; 0 where they lie on none."""
    number = positions(places)
    steps = np.diff(np.bincount(number, places) / np.bincount(number))
    multiples = steps / steps.min(initial=np.inf)
    on_grid = len(steps) > 0 and bool(np.all(np.abs(multiples - np.round(multiples)) < GRID))
    return float(steps.min()) if on_grid else 0.0


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
    index = index[np.diag(square)[index] > 0]
    gram, scale = unit_diagonal(square[np.ix_(index, index)])
    return float(falls_from_products(gram, gradient[index] / scale, relative=1e-10))


def _grid(problem: Problem, index: int) -> Array:
    """Return the values that are tried for a parameter."""
    parameter, o = problem.model.parameters[index], problem.observations
    if parameter.searched is StartSearch.ANY:
        return np.concatenate([-ANY_SIZE, ANY_SIZE])
    if parameter.searched is StartSearch.TIME_CONSTANT and o.t is not None:
        t = np.unique(o.t)
        if len(t) > 1:
            return np.geomspace(np.diff(t).min(), 3 * (t[-1] - t[0]), 60)
    if parameter.searched is StartSearch.PERIOD:
        joint = problem.model.machine.number_of(str(parameter.place))
        q = np.unique(o.q[:, joint])
        if len(q) > 3:
            highest = min(most_waves(q), MOST_WAVES / 10)
            return np.asarray((q[-1] - q[0]) / np.arange(LEAST_WAVES, highest + 0.25, 0.25))
    return np.array([1.0])
