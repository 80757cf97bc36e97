"""Sentences on the residuals with a verdict: they exceed the noise, they jump, joints moved one way only."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.lack_of_fit import against_stated
from rodgen.calibration.diagnose.correlation import Correlation
from rodgen.calibration.diagnose.outliers import are_neighbours
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.words import uncapitalized
from rodgen.errors import joined
from rodgen.statistics.columns import DEPENDENT, falls_from_products
from rodgen.statistics.thresholds import VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations

__all__ = ["disagreement", "displaced", "jump", "moved_one_way", "unknown_approach"]

Array: TypeAlias = NDArray[np.float64]

NOTE_RUNS = "Note the set-ups in a column run, and diagnose again."
MOST_ENDS = 120
"""Rows at which a displaced stretch may begin or end, that are tried; more take a second."""


def disagreement(final: FittedModel, correlation: Correlation) -> str:
    """Return a sentence on how the residuals exceed the noise; empty where they agree with it.

    Parameters
    ----------
    final : FittedModel
    correlation : Correlation
        Of its residuals.
    """
    # stated noise is what standard deviations are by, and what the user holds for noise: replicates may share errors
    lack = final.lack_of_fit if final.observations.sigma is None else against_stated(final)
    if lack is None or not lack.p_value < VERDICT.rare:
        return ""
    noise = "the stated noise" if lack.against == "stated" else "the noise between replicates"
    if not correlation.claimed:
        return (
            f"The residuals are {lack.ratio:.3g} times {noise} (p = {lack.p_value:.2g}), but follow nothing "
            "that was recorded: either the noise is larger than that, or something acts that was not recorded."
        )
    if lack.ratio > VERDICT.wander:
        return (
            f"The residuals are {lack.ratio:.3g} times {noise}. {correlation.text} This dependence follows "
            "nothing that was recorded."
        )
    if lack.against == "stated" and correlation.white > VERDICT.independent_error:
        independent = f"The independent error of a reading is {correlation.white:.3g} times {noise}"
        return f"{independent}, and {uncapitalized(correlation.text)}"
    return ""


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
    o : Observations
    outliers : ndarray of bool, shape (n,)
    """
    numbers = np.unique(o.pose)
    wrong = np.isin(numbers, o.pose[outliers])
    stretch = np.flatnonzero(wrong)
    if not len(stretch) or np.mean(wrong[stretch[0] : stretch[-1] + 1]) < VERDICT.together:
        return ""
    if not are_neighbours(wrong, [np.arange(len(numbers), dtype=float)]):
        return ""
    first, last = o.data.place(int(np.argmax(outliers))), o.data.place(int(np.flatnonzero(outliers)[-1]))
    return (
        f"The outliers from {first} to {last} were taken one after the other: the set-up may have been another there. "
        f"{NOTE_RUNS}"
    )


def moved_one_way(sensitivities: Sensitivities, correlation: Correlation) -> str:
    """Return a sentence on joints that moved one way only while the set-up wandered; empty where there are none.

    An error that follows such a joint slowly looks the same as the wander.

    Parameters
    ----------
    sensitivities : Sensitivities
    correlation : Correlation
        Of the residuals.
    """
    if not (correlation.wanders and correlation.claimed):
        return ""
    o = sensitivities.observations
    names = []
    for j, joint in enumerate(sensitivities.fit.machine.joints):
        steps = np.diff(o.q[:, j])
        if np.ptp(o.q[:, j]) > 0 and np.abs(steps.sum()) > VERDICT.one_way * np.abs(steps).sum():
            names.append(joint.name)
    if not names:
        return ""
    them = "it" if len(names) == 1 else "them"
    return (
        f"{' and '.join(names)} went one way only while the set-up wandered: an error that follows {them} slowly looks "
        "the same as that. Measure in another order, or there and back."
    )


def jump(sensitivities: Sensitivities, residual: Array) -> str:
    """Return a sentence on where the readings jump, as when a set-up is pushed; empty where they do not.

    Parameters
    ----------
    sensitivities : Sensitivities
    residual : ndarray, shape (n, m)
        Weighted residuals.

    Notes
    -----
    The two motions of the frame before and after each row that lower the sum of squares most (a change point), and
    those within and outside of each stretch of rows (two of them). A steady drift must do less than a jump, and one
    that turns, as over a day, less than a stretch.
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
    if len(stretches) and stretches.max() > max(
        VERDICT.jump * total, VERDICT.sudden * max(drift(3), float(falls[best]))
    ):
        at = int(np.argmax(stretches))
        begin, end = sensitivities.rows[first[at] + 1], sensitivities.rows[last[at]]
        return (
            f"The readings from {place(int(begin))} to {place(int(end))} lie displaced against the others: the set-up "
            f"may have been another there. {NOTE_RUNS}"
        )
    if falls[best] < VERDICT.jump * total or falls[best] < VERDICT.sudden * drift(1):
        return ""
    row = int(sensitivities.rows[ends[best]])
    return f"The readings jump after {place(row)}: the set-up may have been moved there. {NOTE_RUNS}"


def _falls(pull: Array, gram: Array) -> Array:
    return falls_from_products(gram, pull, relative=DEPENDENT)
