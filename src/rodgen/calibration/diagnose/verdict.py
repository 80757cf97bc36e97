"""Whether the residuals agree with what is known of the noise, and the words for it where they do not."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.correlation import Correlation
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.noise import figure
from rodgen.statistics.columns import DEPENDENT
from rodgen.statistics.f_tests import fall_from_products
from rodgen.statistics.thresholds import VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel

__all__ = ["disagreement", "jump", "moved_one_way"]

Array: TypeAlias = NDArray[np.float64]


def disagreement(final: FittedModel, how: Correlation) -> str:
    """Return why the residuals do not agree with the noise, or nothing.

    Parameters
    ----------
    final : FittedModel
    how : Correlation
        Of what it leaves.
    """
    lack = final.lack_of_fit
    if lack is None or not lack.p_value < VERDICT.rare:
        return ""
    noise = "the stated noise" if lack.against == "stated" else "the noise between replicates"
    if how.independent:
        return (
            f"The residuals are {figure(lack.ratio)} times {noise} (p = {lack.p_value:.2g}), but follow nothing "
            "that was recorded: either the noise is larger than that, or something acts that was not recorded."
        )
    if lack.ratio > VERDICT.wander:
        return (
            f"The residuals are {figure(lack.ratio)} times {noise}. {how.text} What moves it follows nothing that "
            "was recorded."
        )
    if lack.against == "stated" and how.white > VERDICT.own_error:
        return f"What readings do not share is {figure(how.white)} times {noise}, and {_small(how.text)}"
    return ""


def _small(text: str) -> str:
    return text[:1].lower() + text[1:]


def moved_one_way(sensitivities: Sensitivities, how: Correlation) -> str:
    """Return which joints only ever went one way, so that what follows them slowly looks like a set-up that wanders.

    Parameters
    ----------
    sensitivities : Sensitivities
    how : Correlation
        Of the residuals.
    """
    if not (how.wander_t or how.wander_r):
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
        f"{' and '.join(names)} went one way only while the set-up wandered: what follows {them} slowly looks the "
        "same as that. Measure in another order, or there and back."
    )


def jump(sensitivities: Sensitivities, residual: Array) -> str:
    """Return where the readings jump, as when a set-up is pushed; nothing where they do not.

    Parameters
    ----------
    sensitivities : Sensitivities
    residual : ndarray, shape (n, m)
        Weighted residuals.

    Notes
    -----
    The two motions of the frame before and after each row that lower the sum of squares most (a change point).
    """
    H = sensitivities.frame
    scale = np.sqrt(np.sum(H**2, axis=(0, 1)))
    H = H[:, :, scale > 0] / scale[scale > 0]
    pulls = np.cumsum(np.einsum("nmk,nm->nk", H, residual), axis=0)
    shares = np.cumsum(np.einsum("nmk,nml->nkl", H, H), axis=0)
    pose = sensitivities.observations.pose
    ends = np.flatnonzero(np.diff(pose))
    k = H.shape[2]
    ends = ends[(ends >= k) & (ends < len(H) - k)]
    total = float(np.sum(residual**2))
    if not len(ends) or not total > 0:
        return ""
    whole, all_pulls = shares[-1], pulls[-1]
    falls = [
        _fall(pulls[i], shares[i]) + _fall(all_pulls - pulls[i], whole - shares[i]) - _fall(all_pulls, whole)
        for i in ends
    ]
    best = int(np.argmax(falls))
    steady = np.concatenate([H, H * np.linspace(-1, 1, len(H))[:, None, None]], axis=2).reshape(-1, 2 * k)
    drift = _fall(steady.T @ residual.ravel(), steady.T @ steady) - _fall(all_pulls, whole)
    if falls[best] < VERDICT.jump * total or falls[best] < VERDICT.sudden * drift:
        return ""
    row = int(sensitivities.rows[ends[best]])
    place = sensitivities.fit.observations.data.place(row)
    return (
        f"The readings jump after {place}: the set-up may have been moved there. Note the set-ups in a column run, "
        "and diagnose again."
    )


def _fall(pull: Array, share: Array) -> float:
    return fall_from_products(share, pull, relative=DEPENDENT)
