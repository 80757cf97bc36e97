"""Sentences on the residuals with a verdict: they exceed the noise, they jump, joints moved once from end to end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.gross import displaced_rows
from rodgen.calibration.checks.positions import distinct_positions
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.noise.correlation import Correlation
from rodgen.calibration.words import chance, sized, uncapitalized
from rodgen.data.poses import moved_one_way as joints_one_way
from rodgen.errors import joined
from rodgen.statistics.columns import DEPENDENT, falls_from_products
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.robust import HALF_OF_NORMAL, has_heavy_tails
from rodgen.statistics.thresholds import VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations


NOTE_RUNS = "Note the set-ups in a column run, and diagnose again."
MOST_ENDS = 120
"""Rows at which a displaced stretch may begin or end, that are tried; more take a second."""


def disagreement(final: FittedModel, correlation: Correlation) -> str:
    """Return a sentence on how the residuals exceed the noise; empty where they agree with it.

    Parameters
    ----------
    correlation : Correlation
        Of its residuals.
    """
    lack = final.lack_of_fit
    if lack is None or not lack.p_value < VERDICT.rare:
        return ""
    noise = "the stated noise" if lack.against == "stated" else "the noise between replicates"
    if not correlation.claimed:
        larger = f"The residuals are {lack.ratio:.3g} times {noise} ({chance(lack.p_value)})"
        where = "the poses" if lack.against == "replicates" else _repeat_at(final)
        if where:
            return f"{larger} and repeat at {where}, but follow no function that the data could show."
        return (
            f"{larger}, but no effect explains that beyond chance: the noise is larger than that, or several effects "
            "act that are too small to be found, or something that was not recorded."
        )
    if lack.ratio > VERDICT.wander:
        return (
            f"The residuals are {lack.ratio:.3g} times {noise}. {correlation.text} No effect explains this dependence "
            "beyond chance."
        )
    if lack.against == "stated" and correlation.white > VERDICT.independent_error:
        independent = f"The independent error of a reading is {correlation.white:.3g} times {noise}"
        return f"{independent}, and {uncapitalized(correlation.text)}"
    return ""


def _repeat_at(final: FittedModel) -> str:
    """Return at which joint's positions the residuals of different poses are alike; empty where they are not."""
    kept = ~final.outliers
    o = final.observations.take(np.flatnonzero(kept))
    residuals = (final.residuals * final.problem.base_weight)[kept]
    n, m = residuals.shape
    for joint, q in zip(o.machine.joints, o.q.T, strict=True):
        number = distinct_positions(q, len(np.unique(o.pose)))
        if number is None or not number.any():
            continue
        count = np.bincount(number)
        means = np.stack([np.bincount(number, column) for column in residuals.T], axis=1) / count[:, None]
        along, across = (
            float(count @ np.sum(means**2, axis=1)),
            float(np.sum((residuals - means[number]) ** 2)),
        )
        dof = m * (len(count) - 1), m * (n - len(count))
        chance = log_p_of_fall(along, across, *dof) + np.log(len(o.machine.joints))
        if chance < np.log(VERDICT.rare):
            return f"the {len(count)} positions of {joint.name}"
    return ""


def uneven(final: FittedModel, too_many: int) -> str:
    """Return a sentence on residuals of which many are far larger than most, so that no fit is sure; empty without.

    Parameters
    ----------
    too_many : int
        Rows that disagree with the others where these are too many to leave out, else 0.
    """
    either = (
        "either many rows are wrong, such as misidentified targets, or something acts that was not recorded"
    )
    if too_many:
        n = final.observations.n
        return f"{too_many} of {n} rows disagree with the others by far more than these do: {either}."
    sizes = _sizes(final)
    half, worst = np.quantile(np.abs(sizes), [0.5, 0.95])
    if not VERDICT.uneven * half < HALF_OF_NORMAL or not has_heavy_tails(sizes):
        return ""
    return (
        f"Half of the residuals are within {sized(half * final.rms, final.unit, '.2g')}, but one of twenty is beyond "
        f"{sized(worst * final.rms, final.unit, '.2g')}, far more than normal errors are: {either}."
    )


def _sizes(final: FittedModel) -> Array:
    """Return the residuals of one reading of each pose that is believed, (poses, m); of each component the rms is 1."""
    kept = np.flatnonzero(~final.outliers)
    first = kept[np.unique(final.observations.pose[kept], return_index=True)[1]]
    residuals: Array = final.residuals[first] * final.problem.base_weight[first]
    size = np.sqrt(np.mean(residuals**2, axis=0))
    return residuals / np.where(size > 0, size, 1.0)


def unknown_approach(o: Observations) -> str:
    """Return a sentence on joints that moved, from which side is not known; empty where there are none."""
    names = [
        joint.name
        for joint, q, known in zip(o.machine.joints, o.q.T, o.approach_known, strict=True)
        if np.ptp(q) > 0 and not known
    ]
    if not names:
        return ""
    return (
        f"Backlash is not seen: from which side {joined(names)} came is not known, and the order of these rows does "
        f"not tell. Note it in {joined([f'dir_{name}' for name in names])}, +1 or -1."
    )


def displaced(o: Observations, outliers: NDArray[np.bool_]) -> str:
    """Return a sentence on outliers that are poses one after the other, as when a set-up is pushed; else empty.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    """
    stretch = np.flatnonzero(displaced_rows(o, outliers))
    if not len(stretch):
        return ""
    first, last = o.data.place(int(stretch[0])), o.data.place(int(stretch[-1]))
    return (
        f"The outliers from {first} to {last} were taken one after the other: the set-up may have been another there. "
        f"{NOTE_RUNS}"
    )


def moved_one_way(sensitivities: Sensitivities, correlation: Correlation) -> str:
    """Return a sentence on joints that went from end to end once while the set-up wandered; empty where there are none.

    An error that follows such a joint slowly looks the same as the wander.

    Parameters
    ----------
    correlation : Correlation
        Of the residuals.
    """
    if not (correlation.wanders and correlation.claimed):
        return ""
    one_way = joints_one_way(sensitivities.observations.q)
    names = [j.name for j, is_one in zip(sensitivities.fit.machine.joints, one_way, strict=True) if is_one]
    if not names:
        return ""
    its, them = ("its", "it") if len(names) == 1 else ("their", "them")
    return (
        f"{joined(names)} went through {its} range once while the set-up wandered: an error that follows {them} slowly "
        "looks the same as that. Measure in another order, or there and back."
    )


def jump(sensitivities: Sensitivities, residual: Array) -> str:
    """Return a sentence on where the readings jump, as when a set-up is pushed; empty where they do not.

    Parameters
    ----------
    residual : ndarray, shape (n, m)
        Weighted residuals.

    Notes
    -----
    The two motions of the frame before and after each row that lower the sum of squares most (a change point), and
    those within and outside of each stretch of rows (two of them). A smooth drift, which may turn as over a day, must
    do less than a jump, and clearly less than a stretch. The fall must be beyond chance, over all places that are
    tried. Where a joint stood at other positions there than elsewhere, these may be what displaces the readings.
    """
    H = sensitivities.frame
    scale = np.sqrt(np.sum(H**2, axis=(0, 1)))
    H = H[:, :, scale > 0] / scale[scale > 0]
    pulls = np.cumsum(np.einsum("nmk,nm->nk", H, residual), axis=0)
    grams = np.cumsum(np.einsum("nmk,nml->nkl", H, H), axis=0)
    pose = sensitivities.observations.pose
    ends = np.flatnonzero(np.diff(pose))
    k = H.shape[2]
    ends = ends[(ends >= k) & (ends < len(H) - k)]
    total = float(np.sum(residual**2))
    if not len(ends) or not total > 0:
        return ""
    whole, all_pulls = grams[-1], pulls[-1]
    of_all = float(_falls(all_pulls, whole))

    def fall(part_pulls: Array, part_grams: Array) -> Array:
        rest = _falls(all_pulls - part_pulls, whole - part_grams)
        return _falls(part_pulls, part_grams) + rest - of_all

    dof = np.count_nonzero(sensitivities.weight) - sensitivities.model.shape[2] - k

    def by_chance(fall: float, tried: int) -> bool:
        return bool(log_p_of_fall(fall, total - fall, k, dof) + np.log(tried) > np.log(VERDICT.rare))

    falls = fall(pulls[ends], grams[ends])
    best = int(np.argmax(falls))
    time = np.linspace(-1, 1, len(H))[:, None, None]

    def drift(order: int) -> float:
        columns = np.concatenate([H * time**i for i in range(order + 1)], axis=2).reshape(residual.size, -1)
        return float(_falls(columns.T @ residual.ravel(), columns.T @ columns)) - of_all

    place = sensitivities.fit.observations.data.place
    some = ends[:: -(-len(ends) // MOST_ENDS)]
    first, last = (some[i] for i in np.triu_indices(len(some), 2))
    stretches = fall(pulls[last] - pulls[first], grams[last] - grams[first])
    at = int(np.argmax(stretches)) if len(stretches) else 0
    if (
        len(stretches)
        and stretches[at] > max(VERDICT.jump * total, VERDICT.sudden * max(drift(3), float(falls[best])))
        and not by_chance(float(stretches[at]), len(stretches))
    ):
        rows = slice(first[at] + 1, last[at] + 1)
        if _has_own_positions(sensitivities.observations, rows):
            return ""
        begin, end = sensitivities.rows[rows][[0, -1]]
        return (
            f"The readings from {place(int(begin))} to {place(int(end))} lie displaced against the others: the set-up "
            f"may have been another there. {NOTE_RUNS}"
        )
    if falls[best] < max(VERDICT.jump * total, drift(3)) or by_chance(float(falls[best]), len(ends)):
        return ""
    if _has_own_positions(sensitivities.observations, slice(0, ends[best] + 1)):
        return ""
    row = int(sensitivities.rows[ends[best]])
    return f"The readings jump after {place(row)}: the set-up may have been moved there. {NOTE_RUNS}"


def _has_own_positions(o: Observations, rows: slice) -> bool:
    """Return whether some joint, of few positions, stood at none of those of some rows in any other row."""
    inside = np.zeros(o.n, bool)
    inside[rows] = True
    poses = len(np.unique(o.pose))
    numbers = [distinct_positions(q, poses) for q in o.q.T]
    return any(n is not None and not np.intersect1d(n[inside], n[~inside]).size for n in numbers)


def _falls(pull: Array, gram: Array) -> Array:
    return falls_from_products(gram, pull, relative=DEPENDENT)
