"""Whether a function of time is beyond chance where the readings may wander by an amount that is not known.

A random walk that goes one way looks like a drift, and one that is too small to be seen between neighbours still moves
far from the first reading to the last: a test that takes the readings for independent, or the estimated walk for the
true one, finds drifts in innocent data (spurious regression: Granger and Newbold 1974, Phillips 1986). So the walk is
integrated out: the probability of F by chance is that given a walk, averaged over walks of all sizes, each as likely as
the readings make it without the directions that are tested. The p-value is then uniform over walks of all these sizes,
whether they can be seen or not. What comes back, as a day's warmth does, goes less far than a walk does, and has
smaller p-values seldom: a walk without a trend looks as if it came back, so that this cannot be seen from the readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.thresholds import VARIANCES, WALK
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion


def log_p_under_walks(
    motion: SharedMotion,
    groups: Mapping[str, slice],
    basis: Array,
    new: Array,
    residual: Array,
    dof: tuple[float, float],
    estimated: MotionDeviations,
    design_effect: float = 1.0,
) -> float:
    """Return the logarithm of the probability that readings which may wander show as much along some directions.

    Parameters
    ----------
    motion : SharedMotion
        Of the set-up, H in units of what it does to the mean reading.
    groups : mapping of str to slice
        Degrees of freedom that share a variance.
    basis : ndarray, shape (N, q)
        Orthonormal basis of what the model without them does.
    new : ndarray, shape (N, k)
        Orthonormal, and across it.
    residual : ndarray, shape (N,)
        Of the model without them.
    dof : (float, float)
        Contrasts of the readings, N - q - k, and how many of them count as independent in F.
    estimated : MotionDeviations
        What readings of a pose share, and how the set-up wanders, as far as it is seen.
    design_effect : float
        By what factor readings of one pose make chance look larger.
    """
    contrasts, independent = dof
    q, k = basis.shape[1], new.shape[1]
    motion = replace(motion, poses=_without_runs(motion.poses))
    shape = (*motion.columns.shape[:2], -1)
    moments = Moments(motion, np.concatenate([basis, new, residual[:, None]], axis=1).reshape(shape))
    weights, logs = [], []
    for deviations in _walks(motion.poses, groups, estimated):
        inverse = moments.inverse(deviations)
        try:
            triangle = np.linalg.cholesky(inverse.products)
        except np.linalg.LinAlgError:
            continue
        *along, root = triangle[-1, q:]
        fall, left = float(np.sum(np.square(along))), float(root**2)
        logs.append(log_p_of_fall(fall, design_effect * left * independent / contrasts, k, independent))
        of_fixed = float(np.sum(np.log(np.diagonal(triangle)[:-1])))
        weights.append(-0.5 * (contrasts * np.log(left) + inverse.log_determinant) - of_fixed)
    if not logs:
        return 0.0
    weight = np.array(weights) - max(weights)
    weight -= np.log(np.sum(np.exp(weight)))
    return float(np.logaddexp.reduce(weight + np.array(logs)))


def _without_runs(poses: Poses) -> Poses:
    """Return the poses as one run: what wanders by itself does not begin anew where a run does."""
    gap = np.where(np.isinf(poses.gap), poses.spacing, poses.gap)
    gap[:1] = np.inf
    return replace(poses, gap=gap, duration=float(np.sum(gap[1:])))


def _walks(
    poses: Poses, groups: Mapping[str, slice], estimated: MotionDeviations
) -> Iterator[MotionDeviations]:
    """Yield walks of all sizes, with the groups as they are estimated and each of them alone."""
    k = len(estimated.wander)
    alone = [np.zeros(k) for _ in groups]
    for one, of in zip(alone, groups.values(), strict=True):
        one[of] = 1.0
    together = estimated.wander if estimated.wander.any() else np.ones(k)
    together = together / np.sqrt(np.mean([np.max(together[of]) ** 2 for of in groups.values()]))
    shapes = alone if len(alone) == 1 else [together, *alone]
    unit = float(np.hypot(1, estimated.shared.max(initial=0.0)))
    largest = max(WALK.largest * unit, WALK.beyond * float(estimated.wander.max(initial=0.0)))
    sizes = np.geomspace(largest * WALK.smallest / WALK.largest, largest, WALK.sizes)
    part = VARIANCES.longest  # of so slow a wander the run shows a part of its size only
    for size, shape in product(np.sqrt(1 + 3 * part) * sizes, shapes):
        yield MotionDeviations(estimated.shared, size * shape, part * poses.duration)
