"""How the residuals of a fit depend on each other: those of a pose, and those of neighbours in time.

The variance components are estimated by :mod:`rodgen.statistics.variance_components`, with the columns of the model and
of all candidates; this module supplies the columns and the units, and puts the result into a sentence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.words import capitalized
from rodgen.statistics.columns import DEPENDENT, orthonormal_basis, project_out, unit_columns
from rodgen.statistics.decompositions import svd
from rodgen.statistics.thresholds import VARIANCES
from rodgen.statistics.variance_components import VarianceEstimator
from rodgen.statistics.whitening import MotionDeviations, Poses, SharedMotion, Whitener

if TYPE_CHECKING:
    from rodgen.calibration.diagnose.sensitivities import Sensitivities

__all__ = ["Correlation", "covariance_of_estimates", "estimate_correlation"]

Array: TypeAlias = NDArray[np.float64]

NO_READING = 1e-30
"""Weights below this part of the largest are those of readings that the fit leaves out."""
NO_RESIDUAL = 1e-13
"""Residuals below this part of the readings are rounding."""


@dataclass(frozen=True)
class Correlation:
    """How errors of readings depend on each other.

    Attributes
    ----------
    white : float
        Standard deviation of a reading's independent error, in units of a weighted residual: 1 where it is the
        stated noise.
    pose_t, pose_r : float
        Standard deviation of what the readings of a pose share, at the mean reading and in the same units: from a
        translation, and from a turn, of the frame.
    wander_t, wander_r : float
        The same of what changes slowly from pose to pose.
    time : float
        Correlation time of the wander (to 1/e); seconds, or poses where there are no times.
    text : str
        The same as a sentence; empty where readings are independent, or their dependence is too slight to be claimed.
    """

    white: float
    pose_t: float
    pose_r: float
    wander_t: float
    wander_r: float
    time: float
    text: str
    _motion: SharedMotion | None = field(default=None, repr=False, compare=False)
    _deviations: MotionDeviations | None = field(default=None, repr=False, compare=False)

    @property
    def independent(self) -> bool:
        """Whether readings are treated as independent."""
        return self._deviations is None

    @property
    def wanders(self) -> bool:
        """Whether the set-up wanders from pose to pose."""
        return bool(self.wander_t or self.wander_r)

    @property
    def claimed(self) -> bool:
        """Whether the dependence is beyond chance, so that it is reported; one that is less is only allowed for."""
        return bool(self.text)

    def whiten(self, columns: Array) -> Array:
        """Bring columns of weighted readings to where errors are independent, with the variance `white`².

        Parameters
        ----------
        columns : ndarray, shape (n, m, K)
            In the rows that the correlation was estimated on.

        Returns
        -------
        ndarray, shape (n, m, K)
        """
        if self._whitener is None:
            return columns
        with one_thread_in_blas():
            return self._whitener(columns)

    @cached_property
    def _whitener(self) -> Whitener | None:
        if self._motion is None or self._deviations is None:
            return None
        return Whitener(self._motion, self._deviations)


def covariance_of_estimates(correlation: Correlation, jacobian: Array) -> Array:
    """Return the covariance of what an ordinary least-squares fit estimates where errors are correlated.

    Parameters
    ----------
    correlation : Correlation
    jacobian : ndarray, shape (n, m, p)
        Derivatives of the weighted residuals.

    Returns
    -------
    ndarray, shape (p, p)
        (JᵀJ)⁺ JᵀVJ (JᵀJ)⁺, V as estimated; zero along directions that change no reading.
    """
    p = jacobian.shape[2]
    if not p:
        return np.zeros((0, 0))
    size = np.linalg.norm(jacobian.reshape(-1, p), axis=0)
    size[size == 0.0] = 1.0
    scaled = jacobian / size
    with one_thread_in_blas():
        triangle = np.asarray(np.linalg.qr(scaled.reshape(-1, p), mode="r"))
        _, values, vt = svd(triangle, full_matrices=True)
        kept = values > DEPENDENT * max(values.max(initial=0.0), 1e-300)
        v = vt[: len(values)][kept].T / values[kept]  # scaled @ v is orthonormal
        motion, deviations = correlation._motion, correlation._deviations
        middle = np.eye(v.shape[1])
        if motion is not None and deviations is not None:
            middle = motion.covariance_of(deviations, scaled @ v)
        v = v / values[kept]
        return np.asarray(
            correlation.white**2 * (v * values[kept] @ middle @ (v * values[kept]).T)
        ) / np.outer(size, size)


def estimate_correlation(
    sensitivities: Sensitivities,
    nuisance: Array | Sequence[Array],
    tries: Sequence[float] | None = None,
    included: Sequence[Array] = (),
) -> Correlation:
    """Return how the residuals of a fit depend on each other, estimated by REML.

    Parameters
    ----------
    sensitivities : Sensitivities
    nuisance : sequence of ndarray, each of shape (n, m, k), or ndarray, shape (n, m, K)
        Columns of each candidate, or of all with each column by itself; the columns of the fit's own parameters are
        always projected out.
    tries : sequence of float, optional
        Number of independent tests that the values tried for each candidate amount to; left out: one of each.
    included : sequence of ndarray, each of shape (n, m, k)
        Columns of effects that are there; they are projected out, too.
    """
    with one_thread_in_blas():
        return _estimate(sensitivities, nuisance, tries, included)


def _estimate(
    sensitivities: Sensitivities,
    nuisance: Array | Sequence[Array],
    tries: Sequence[float] | None,
    included: Sequence[Array],
) -> Correlation:
    fit, o = sensitivities.fit, sensitivities.observations
    weight = np.broadcast_to(sensitivities.weight, sensitivities.residual.shape)
    believed = weight > NO_READING * weight.max(initial=0.0)
    poses = Poses.among(o.pose, o.run, o.t)
    motion, groups = _motion(poses, sensitivities.frame, believed)
    rows, some = poses.taken(_chosen(poses.count))
    residual = np.where(believed, sensitivities.residual, 0.0)[rows].ravel()
    readings = int(believed[rows].sum())
    model = np.concatenate([sensitivities.model, *included], axis=2)
    basis = orthonormal_basis(_flat(model[rows]))
    residual = project_out(basis, residual)
    dof = readings - basis.shape[1]
    scatter = float(residual @ residual)
    rounding = NO_RESIDUAL**2 * fit.problem.scale * len(some.of) / max(fit.observations.n, 1)
    if dof < 1 or scatter <= rounding:
        return Correlation(0.0, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    white = float(np.sqrt(scatter / dof))
    known = np.bincount(poses.of[believed.any(axis=1)], minlength=poses.count)
    if np.count_nonzero(known) < VARIANCES.least_poses or dof < VARIANCES.least_poses:
        return Correlation(white, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    effects = (
        [nuisance[:, :, [i]] for i in range(nuisance.shape[2])]
        if isinstance(nuisance, np.ndarray)
        else nuisance
    )
    columns = [_flat(effect[rows]) for effect in effects]
    sample = SharedMotion(some, motion.columns[rows])
    several = int(np.count_nonzero(known > 1)) >= VARIANCES.least_poses
    estimator = VarianceEstimator(sample, groups, poses, basis, columns, residual / white, readings, tries)
    found, deviations = estimator.best(pose=several)
    if deviations is None:
        return Correlation(white, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    white *= float(np.sqrt(found.variance))
    sizes = {name: white * size for name, size in zip(found.names, found.sizes, strict=True)}
    pose_t, pose_r, wander_t, wander_r = (
        sizes.get(name, 0.0) for name in ("pose t", "pose r", "wander t", "wander r")
    )
    time = found.time if wander_t or wander_r else np.inf
    typical = 1 / (float(np.median(weight[believed])) * fit.unit_factor)
    text = ""
    # where readings scatter no more than their stated noise, nothing else is needed
    within_noise = o.sigma is not None and scatter <= dof
    if found.gain > VARIANCES.claimed and not within_noise:
        text = _text(
            [typical * x for x in (white, pose_t, pose_r, wander_t, wander_r)], fit.unit, time, poses
        )
    return Correlation(white, pose_t, pose_r, wander_t, wander_r, time, text, motion, deviations)


def _motion(poses: Poses, frame: Array, believed: NDArray[np.bool_]) -> tuple[SharedMotion, dict[str, slice]]:
    """Return the frame's motion in units of what it does to the mean reading, and its degrees of freedom by name."""
    H = np.where(believed[:, :, None], frame, 0.0)
    named = {"r": slice(0, 3)} if H.shape[2] == 3 else {"t": slice(0, 3), "r": slice(3, 6)}
    groups = {}
    for name, of in named.items():
        size = np.sqrt(np.sum(H[:, :, of] ** 2) / max(int(believed.sum()), 1))
        if size > 0:
            H[:, :, of] /= size
            groups[name] = of
    return SharedMotion(poses, H), groups


def _chosen(count: int) -> NDArray[np.bool_]:
    """Return which poses the variance components are estimated from."""
    kept = np.ones(count, np.bool_)
    if count > VARIANCES.most_poses:
        kept[:] = False
        length = VARIANCES.most_poses // VARIANCES.stretches
        for start in np.linspace(0, count - length, VARIANCES.stretches).astype(int):
            kept[start : start + length] = True
    return kept


def _flat(columns: Array) -> Array:
    """Return columns, (n m, K), of length 1."""
    n, m, K = columns.shape
    return unit_columns(columns.reshape(n * m, K))


def _text(sizes: Sequence[float], unit: str, time: float, poses: Poses) -> str:
    """Return the sentence; sizes in the fit's unit: the independent error, pose t, pose r, wander t, wander r."""
    shared, wander = float(np.linalg.norm(sizes[1:3])), float(np.linalg.norm(sizes[3:5]))
    parts = []
    if shared:
        parts.append(f"readings of one pose share an error of {shared:.2g} {unit}")
    if wander:
        over = _time(time, poses)
        parts.append(f"the set-up wanders by {wander:.2g} {unit} {over}")
    if not parts:
        return ""
    text = ", and ".join(parts)
    return f"{capitalized(text)}, in addition to an independent error of {sizes[0]:.2g} {unit} per reading."


def _time(time: float, poses: Poses) -> str:
    if time > 2 * poses.duration:
        return "from beginning to end, as a random walk does"
    if not poses.timed:
        return f"within some {time:.2g} poses" if time < 100 else f"within some {time:.0f} poses"
    for size, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if time >= 2 * size:
            return f"within some {time / size:.2g} {name}"
    return f"within some {time:.2g} seconds"
