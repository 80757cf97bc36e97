"""How the residuals of a fit depend on each other: those of a pose, and those of neighbours in time.

The variance components are estimated by :mod:`rodgen.statistics.variance_components`, with the columns of the model
and, in a diagnosis, of all candidates; this module supplies columns and units, and puts the result into a sentence.
What a fit, a prediction, a plan and a diagnosis state as standard deviations is the covariance that is made here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.words import capitalized, two_digits
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.statistics.columns import orthonormal_basis, project_out, unit_columns
from rodgen.statistics.thresholds import VARIANCES
from rodgen.statistics.variance_components import VarianceEstimator
from rodgen.statistics.whitening import MotionDeviations, Poses, SharedMotion, Whitener
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations
    from rodgen.machines.model import Frame, Model

NO_READING = 1e-30
"""Weights below this part of the largest are those of readings that the fit leaves out."""
NO_ERROR = 1e-3
"""Part of what readings share from which on an independent error of each is stated: a lesser one changes no figure."""
NO_RESIDUAL = 1e-13
"""Residuals below this part of the readings are rounding."""


@dataclass(frozen=True)
class Correlation:
    """How errors of readings depend on each other."""

    white: float
    """Standard deviation of a reading's independent error, in units of a weighted residual: 1 where it is the stated
    noise."""
    pose_t: float
    pose_r: float
    """Standard deviation of what the readings of a pose share, at the mean reading and in the same units: from a
    translation, and from a turn, of the frame."""
    wander_t: float
    wander_r: float
    """The same of what changes slowly from pose to pose."""
    time: float
    """Correlation time of the wander (to 1/e); seconds, or poses where there are no times."""
    text: str
    """The same as a sentence; empty where readings are independent, or their dependence is too slight to be claimed."""
    gain: float = 0.0
    """By how much twice the log restricted likelihood exceeds that of independent readings."""
    _motion: SharedMotion | None = field(default=None, repr=False, compare=False)
    deviations: MotionDeviations | None = field(default=None, repr=False, compare=False)
    """Standard deviations of what readings share, relative to `white`; None where they are independent."""
    _within_error: Sequence[tuple[MotionDeviations, MotionDeviations]] = field(
        default=(), repr=False, compare=False
    )

    @property
    def independent(self) -> bool:
        """Whether readings are treated as independent."""
        return self.deviations is None

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

    def whiten_within_error(self, columns: Array) -> list[tuple[Array, Array]]:
        """Return columns whitened by variances one standard error off, to both sides along independent directions."""
        motion = self._motion
        if motion is None:
            return []
        with one_thread_in_blas():
            return [
                (Whitener(motion, one)(columns), Whitener(motion, other)(columns))
                for one, other in self._within_error
            ]

    def covariance_of(self, columns: Array) -> Array:
        """Return the covariance of sums of the errors of weighted readings, (K, K); readings must depend on each other.

        A slow wander is known from few independent values, so that variances v are uncertain. They are enlarged by
        ν / (ν - 2), the variance of t (JCGM 101, 6.4.9), where ν = 2 / var(log v) degrees of freedom (Satterthwaite
        1946).

        Parameters
        ----------
        columns : ndarray, shape (n, m, K)
            What readings are multiplied with, in the rows that the correlation was estimated on.
        """
        motion, deviations = self._motion, self.deviations
        assert motion is not None
        assert deviations is not None
        with one_thread_in_blas():
            spread = motion.covariance_of(deviations, columns)
            error = np.zeros(len(spread))  # variance of log v
            for pair in self._within_error:
                one, other = (motion.variances_of(end, columns) for end in pair)
                error += np.log(np.divide(one, other, out=np.ones_like(one), where=other > 0)) ** 2 / 4
            enlarged = 1 / np.sqrt(1 - np.minimum(error, VARIANCES.uncertain))
            return np.asarray(self.white**2 * spread * np.outer(enlarged, enlarged))

    @property
    def cautious(self) -> MotionDeviations | None:
        """Deviations that are one standard error larger along each direction in which they were estimated."""
        found = estimated = self.deviations
        if found is None or estimated is None:
            return None
        for pair in self._within_error:
            larger = max(pair, key=lambda end: float(np.sum(end.shared**2) + np.sum(end.wander**2)))
            found = found.times(larger, estimated)
        return found

    @cached_property
    def _whitener(self) -> Whitener | None:
        if self._motion is None or self.deviations is None:
            return None
        return Whitener(self._motion, self.deviations)


INDEPENDENT = Correlation(0.0, 0.0, 0.0, 0.0, 0.0, np.inf, "")
"""Of readings without an error, and of those that nothing is fitted to."""


class LinearRows(Protocol):
    """Rows of a fit with the derivatives of their weighted residuals."""

    @property
    def fit(self) -> FittedModel:
        """The fit."""

    @property
    def observations(self) -> Observations:
        """These rows."""

    @property
    def weight(self) -> Array:
        """Weights, (n, m)."""

    @property
    def residual(self) -> Array:
        """Weighted residuals, (n, m)."""

    @property
    def model(self) -> Array:
        """Derivatives with respect to the parameters that the fit adjusted, (n, m, p)."""

    @property
    def frame(self) -> Array:
        """Derivatives with respect to a motion of the whole frame, (n, m, 6), or (n, m, 3) of directions."""


@dataclass(frozen=True, eq=False)
class FitRows:
    """The rows of a fit that its correlation is estimated on.

    Attributes
    ----------
    fit, observations, weight, residual, frame
        As of `LinearRows`.
    rows : ndarray of int, shape (n,)
        Their numbers among the fit's observations.
    jacobian : ndarray, shape (n, m, parameters)
        Derivatives with respect to all parameters.
    """

    fit: FittedModel
    rows: NDArray[np.int_]
    observations: Observations
    weight: Array
    residual: Array
    jacobian: Array
    frame: Array

    @classmethod
    def of(cls, fit: FittedModel) -> FitRows:
        """Return the rows of a fit, without outliers; of very many a sample."""
        rows = sample_of(fit.observations, ~fit.outliers)
        theta, frame = fit.solution.theta, fit.solution.frame
        problem = fit.problem if len(rows) == fit.observations.n else fit.problem.take(rows)
        o, weight = problem.observations, problem.weight
        return cls(
            fit,
            rows,
            o,
            weight,
            problem.residuals(theta, frame, weighted=True),
            problem.jacobian(theta, frame),
            frame_motion(problem.model, o, theta, frame, weight),
        )

    @property
    def model(self) -> Array:
        """Derivatives with respect to the parameters that the fit adjusted, (n, m, p)."""
        return np.asarray(self.jacobian[:, :, list(self.fit.moving)])


@dataclass(frozen=True, repr=False, eq=False)
class Dependence(Result):
    """How the errors of a fit's readings depend on each other, and the covariance of its parameters therefore.

    Attributes
    ----------
    correlation : Correlation
        With the model's parameters as the only fixed effects.
    covariance : ndarray, shape (parameters, parameters), or None
        Internal units; None where readings are independent.
    factor : float
        How many times as large the standard deviations are as those of independent readings, at most.
    """

    correlation: Correlation
    covariance: Array | None
    factor: float = 1.0

    _keys = "independent factor text"

    @property
    def independent(self) -> bool:
        """Whether readings are treated as independent."""
        return self.covariance is None

    @property
    def text(self) -> str:
        """A sentence on what the standard deviations allow for."""
        if self.independent:
            return "The standard deviations are those of independent readings: no errors that they share are seen."
        found = self.correlation
        who = []
        if found.pose_t or found.pose_r:
            who.append("the readings of one pose")
        if found.wanders:
            who.append("successive poses")
        return (
            f"{capitalized(joined(who))} share errors; the standard deviations allow for that, and are up to "
            f"{self.factor:.2g} times those of independent readings."
        )


def dependence(fit: FittedModel) -> Dependence:
    """Return how the errors of a fit's readings depend on each other.

    Notes
    -----
    The fit weighs readings as if they were independent, so that its estimates have the covariance C JᵀVJ C, C that of
    independent readings of variance 1 and V as estimated (White 1980). Priors of the file are counted as they are.
    """
    if not fit.free:
        return Dependence(INDEPENDENT, None)
    rows = FitRows.of(fit)
    found = estimate_correlation(rows, ())
    if found._motion is None or found.deviations is None or found.gain < VARIANCES.claimed:
        return Dependence(found, None)
    single = fit.determinacy.covariance
    with one_thread_in_blas():
        n, m, p = rows.jacobian.shape
        columns = (rows.jacobian.reshape(n * m, p) @ single).reshape(n, m, p)
        part = len(rows.residual) / max(fit.rows, 1)
        covariance = found.covariance_of(columns) / part
        if fit.problem.file_values.is_prior or fit.determinacy.held:
            _, square, _ = fit.problem.normal_equations(fit.solution.theta, fit.solution.frame)
            covariance += fit.variance_factor * (single - single @ square @ single)
    alone = np.diag(fit.independent_covariance)
    factors = np.diag(covariance)[alone > 0] / alone[alone > 0]
    return Dependence(found, np.asarray(covariance), float(np.sqrt(factors.max(initial=0.0))))


def estimate_correlation(
    rows: LinearRows,
    nuisance: Array | Sequence[Array],
    tries: Sequence[float] | None = None,
    included: Sequence[Array] = (),
) -> Correlation:
    """Return how the residuals of a fit depend on each other, estimated by REML.

    Parameters
    ----------
    nuisance : sequence of ndarray, each of shape (n, m, k), or ndarray, shape (n, m, K)
        Columns of each candidate, or of all with each column by itself; the columns of the fit's own parameters are
        always projected out.
    tries : sequence of float, optional
        Number of independent tests that the values tried for each candidate amount to; left out: one of each.
    included : sequence of ndarray, each of shape (n, m, k)
        Columns of effects that are there; they are projected out, too.
    """
    with one_thread_in_blas():
        return _estimate(rows, nuisance, tries, included)


def _estimate(
    linear: LinearRows,
    nuisance: Array | Sequence[Array],
    tries: Sequence[float] | None,
    included: Sequence[Array],
) -> Correlation:
    fit, o = linear.fit, linear.observations
    believed = believed_readings(linear)
    motion, groups = shared_motion(linear)
    poses = motion.poses
    rows = _chosen(poses.count)[poses.of]
    rows &= _often_read(o.target, rows)
    some = poses.taken(rows)
    residual = np.where(believed, linear.residual, 0.0)[rows].ravel()
    readings = int(believed[rows].sum())
    model = np.concatenate([linear.model, *included], axis=2)
    model = _flat(model[rows])
    basis = orthonormal_basis(
        model[:, model.any(axis=0)]
    )  # not with the columns of all targets that are left out
    residual = project_out(basis, residual)
    dof = readings - basis.shape[1]
    scatter = float(residual @ residual)
    rounding = NO_RESIDUAL**2 * fit.problem.scale * len(some.of) / max(fit.problem.count, 1)
    if dof < 1 or scatter <= rounding:
        return INDEPENDENT
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
    found, deviations, within_error = estimator.best(pose=several)
    if deviations is None:
        return Correlation(white, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    white *= float(np.sqrt(found.variance))
    sizes = {name: white * size for name, size in zip(found.names, found.sizes, strict=True)}
    pose_t, pose_r, wander_t, wander_r = (
        sizes.get(name, 0.0) for name in ("pose t", "pose r", "wander t", "wander r")
    )
    time = found.time if wander_t or wander_r else np.inf
    typical = 1 / (
        float(np.median(np.broadcast_to(linear.weight, believed.shape)[believed])) * fit.unit_factor
    )
    text = ""
    # where readings scatter no more than their stated noise, nothing else is needed
    within_noise = o.sigma is not None and scatter <= dof
    if found.gain > VARIANCES.claimed and not within_noise:
        text = _text(
            [typical * x for x in (white, pose_t, pose_r, wander_t, wander_r)], fit.unit, time, poses
        )
    sizes_of_all = (white, pose_t, pose_r, wander_t, wander_r, time)
    return Correlation(*sizes_of_all, text, found.gain, motion, deviations, tuple(within_error))


def shared_motion(linear: LinearRows) -> tuple[SharedMotion, dict[str, slice]]:
    """Return the frame's motion in units of what it does to the mean reading, and its degrees of freedom by name."""
    o = linear.observations
    poses, believed = Poses.among(o.pose, o.run, o.t), believed_readings(linear)
    H = np.where(believed[:, :, None], linear.frame, 0.0)
    named = {"r": slice(0, 3)} if H.shape[2] == 3 else {"t": slice(0, 3), "r": slice(3, 6)}
    groups = {}
    for name, of in named.items():
        size = np.sqrt(np.sum(H[:, :, of] ** 2) / max(int(believed.sum()), 1))
        if size > 0:
            H[:, :, of] /= size
            groups[name] = of
    return SharedMotion(poses, H), groups


def believed_readings(linear: LinearRows) -> NDArray[np.bool_]:
    """Return which readings the fit does not leave out, (n, m)."""
    weight = np.broadcast_to(linear.weight, linear.residual.shape)
    return np.asarray(weight > NO_READING * weight.max(initial=0.0))


def _chosen(count: int) -> NDArray[np.bool_]:
    """Return which poses the variance components are estimated from."""
    kept = np.ones(count, np.bool_)
    if count > VARIANCES.most_poses:
        kept[:] = False
        length = VARIANCES.most_poses // VARIANCES.stretches
        for start in np.linspace(0, count - length, VARIANCES.stretches).astype(int):
            kept[start : start + length] = True
    return kept


def _often_read(target: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows, (n,), are of the targets from which the variance components are estimated."""
    times = np.bincount(target[rows], minlength=int(target.max(initial=0)) + 1)
    kept = np.zeros(len(times), np.bool_)
    kept[np.argsort(-times, kind="stable")[: VARIANCES.most_targets]] = True
    return np.asarray(kept[target])


def _flat(columns: Array) -> Array:
    """Return columns, (n m, K), of length 1."""
    n, m, K = columns.shape
    return unit_columns(columns.reshape(n * m, K))


def _sized(size: float, unit: str) -> str:
    factor, unit = readable(unit, size)
    return f"{two_digits(size * factor)} {unit}"


def _text(sizes: Sequence[float], unit: str, time: float, poses: Poses) -> str:
    """Return the sentence; sizes in the fit's unit: the independent error, pose t, pose r, wander t, wander r."""
    shared, wander = float(np.linalg.norm(sizes[1:3])), float(np.linalg.norm(sizes[3:5]))
    parts = []
    if shared:
        parts.append(f"readings of one pose share an error of {_sized(shared, unit)}")
    if wander:
        over = _time(time, poses)
        parts.append(f"the set-up wanders by {_sized(wander, unit)} {over}")
    if not parts:
        return ""
    text = ", and ".join(parts)
    if sizes[0] < NO_ERROR * math.hypot(shared, wander):  # markers of a body whose pose was measured
        return f"{capitalized(text)}; single readings have no error of their own compared with that."
    return (
        f"{capitalized(text)}, in addition to an independent error of {_sized(sizes[0], unit)} per reading."
    )


def _time(time: float, poses: Poses) -> str:
    if time > 2 * poses.duration:
        return "from beginning to end, as a random walk does"
    if not poses.timed:
        return f"within some {two_digits(time)} poses"
    for size, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if time >= 2 * size:
            return f"within some {two_digits(time / size)} {name}"
    return f"within some {two_digits(time)} seconds"


# The rows of many that decisions are made on: stretches of whole poses, so that neighbours in time stay neighbours.


MOST_ROWS = 5_000
"""Rows that decisions are made on: an effect that is worth half a percent of the error lowers chi-square on them by 50,
which chance does with p = 2e-12."""
STRETCHES = 20
"""Number of stretches taken of more rows, so that neighbours in time stay neighbours."""


def sample_of(observations: Observations, believed: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return the rows that decisions are made on: all but outliers, or stretches of whole poses of many rows."""
    rows = np.flatnonzero(believed)
    if len(rows) <= MOST_ROWS:
        return rows
    pose = observations.pose[rows]
    starts = np.linspace(0, len(rows), STRETCHES, endpoint=False).astype(int)
    taken = []
    for start in starts:
        some = rows[start : start + MOST_ROWS // STRETCHES]
        own = pose[start : start + MOST_ROWS // STRETCHES]
        taken.append(some[(own != own[0]) & (own != own[-1])] if len(np.unique(own)) > 2 else some)
    return np.unique(np.concatenate(taken))


# What a small motion of the measuring frame does to readings; errors that a pose's readings share are such motions.


def frame_motion(
    model: Model,
    o: Observations,
    theta: Array,
    frame: Frame,
    weight: Array,
    *,
    middle: Array | None = None,
) -> Array:
    """Return the derivatives of weighted residuals with respect to a motion of the whole frame, (n, m, 6).

    Translations along the machine's axes, then turns about the middle of the places that were measured. Directions are
    only turned: (n, m, 3).

    Parameters
    ----------
    theta, frame : ndarray, Frame
        Of the fit.
    weight : ndarray, shape (n, m)
    middle : ndarray, shape (3,), optional
        Another point than the middle.
    """
    found, whitening = _independent(model, o, theta, frame, weight, middle), o.whitening
    return found if whitening is None else whitening @ found


def _independent(
    model: Model, o: Observations, theta: Array, frame: Frame, weight: Array, middle: Array | None
) -> Array:
    """Return them of independent errors."""
    with one_thread_in_blas():
        place = Problem(model, o).places(theta, frame)
    axes, measurand = frame.rotation.T, model.structure.measurand
    middle = place.mean(axis=0) if middle is None else middle
    turns = np.stack([np.cross(axis, place - middle if measurand.moving else place) for axis in axes])
    if measurand.has_zero:
        line = model.line(theta)
        if not measurand.has_axes:  # what rises above the horizon turns about a level axis
            level = np.cross(place, line)
            line = level / np.linalg.norm(level, axis=1, keepdims=True)
        return np.asarray(-weight[:, :, None] * np.broadcast_to(line, place.shape)[:, None])
    if measurand.has_attitude and not measurand.is_pose:
        return np.asarray(-np.einsum("km,nm->nmk", axes, weight))
    if not measurand.moving:
        return np.asarray(-np.einsum("mni,kni,nm->nmk", np.stack(o.basis), turns, weight))
    motions = np.concatenate([np.broadcast_to(axes[:, None], turns.shape), turns])
    if measurand.has_attitude:
        turned = np.concatenate([np.zeros((3, 3)), axes])[:, None] * o.arm
        motions = np.concatenate([motions, np.broadcast_to(turned, motions.shape)], axis=2)
    if measurand.is_place:
        return np.asarray(-np.einsum("kni,ni->nik", motions, weight))
    arm = place - np.asarray(model.machine.measured.origin)
    away = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    return np.asarray(-np.einsum("kni,ni,nm->nmk", motions, away, weight))
