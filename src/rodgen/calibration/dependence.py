"""How the residuals of a fit depend on each other: those of a pose, of a position, of a run, of neighbours in time.

The variance components are estimated by :mod:`rodgen.statistics.variance_components`, with the columns of the model
and, in a diagnosis, of all candidates; this module supplies columns and units, and puts the result into a sentence.
What a fit, a prediction, a plan and a diagnosis state as standard deviations is the covariance that is made here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.fitted import Fit
from rodgen.calibration.noise_floor import is_one_body
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import moved
from rodgen.calibration.whitened import Whitened
from rodgen.calibration.words import capitalized, two_digits
from rodgen.data import poses as places
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.stages import stage
from rodgen.statistics.columns import orthonormal_basis, project_out, unit_columns
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.digits import resolution
from rodgen.statistics.thresholds import LACK_OF_FIT, VARIANCES
from rodgen.statistics.variance_components import VarianceComponents, VarianceEstimator
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion, Weighted, Whitener
from rodgen.views import Result

LEAST_POSES = 8
"""Poses from which on a wander is looked for: with fewer every one looks like an effect."""
MOST_POSES = 300
"""Poses that the restricted likelihood is evaluated on; more change the variances by less than their errors."""
MOST_TARGETS = 100
"""Targets whose readings it is evaluated on, those read most often: the place of each is three fixed effects, time
grows with their square, and a thousand degrees of freedom already give a standard deviation to 2 %."""
STRETCHES_VARIANCE = 5
"""Number of stretches taken of more poses: neighbours show short correlation times, stretches long ones."""
WIDEST = 2.0
"""Standard error, in logarithms, of a size or a time that readings show nothing of."""
UNCERTAIN = 2 / 3
"""Variance of the logarithm of a parameter's variance, at most: that of three degrees of freedom, with which a
standard deviation is 1.7 times as large. With fewer it would have no end."""

STEPS = 3
"""Steps from independent readings to those of one body: the model is nearly linear there."""

WORSE = 4.0
"""Factor on the sum of squares beyond which no estimate by other weights is taken. It is expected to grow by at most
one variance for each parameter, and there are fewer of these than degrees of freedom: so it doubles, at most."""

ALIKE = 1e-6
"""Part of the largest difference of two variances below which others are rounding."""

NO_READING = 1e-30
"""Weights below this part of the largest are those of readings that the fit leaves out."""
NO_ERROR = 1e-3
"""Part of what readings share from which on an independent error of each is stated: a lesser one changes no figure."""
NO_RESIDUAL = 1e-13
"""Residuals below this part of the readings are rounding."""
FEWEST_LEVELS = 3
"""Poses, positions or runs that tell a variance at least: nine numbers of translations."""
MOST_LEVELS = 300
"""Motions of positions that are estimated at most: their matrix is a dense one."""


@dataclass(frozen=True, eq=False)
class Correlation:
    """How errors of readings depend on each other."""

    white: float
    """Standard deviation of a reading's independent error, in units of a weighted residual: 1 where it is the stated
    noise."""
    components: VarianceComponents | None = None
    """What readings share, in units of `white`; None where they are independent."""
    text: str = ""
    """The same as a sentence; empty where readings are independent, or their dependence is too slight to be claimed."""
    _motion: SharedMotion | None = field(default=None, repr=False)
    _groups: dict[str, slice] = field(default_factory=dict, repr=False)

    @property
    def independent(self) -> bool:
        """Whether readings are treated as independent."""
        return self.components is None

    @property
    def wanders(self) -> bool:
        """Whether the set-up wanders from pose to pose."""
        return self.components is not None and self.components.wanders

    @property
    def claimed(self) -> bool:
        """Whether the dependence is beyond chance, so that it is reported; one that is less is only allowed for."""
        return bool(self.text)

    @property
    def position(self) -> Ints | None:
        """Number of the position of each row, (n,); None where few are read again."""
        poses = None if self._motion is None else self._motion.poses
        return None if poses is None or poses.position is None else np.asarray(poses.position[poses.of])

    @property
    def gain(self) -> float:
        """By how much twice the log restricted likelihood exceeds that of independent readings."""
        return 0.0 if self.components is None else self.components.gain

    @property
    def time(self) -> float:
        """Correlation time of the wander (to 1/e); seconds, or poses where there are no times."""
        return self.components.time if self.components is not None and self.wanders else np.inf

    @property
    def of_neighbours(self) -> float:
        """Standard deviation of a reading without what runs, positions and slow wander add; as `white`.

        What wanders from one pose to the next is in it.
        """
        moved = -math.expm1(-self._motion.poses.spacing / self.time) if self._motion is not None else 0.0
        return math.hypot(self.white, self.size("pose"), self.size("wander") * math.sqrt(moved))

    def size(self, kind: str) -> float:
        """Return the standard deviation of what readings share, at the mean reading, in units of a weighted residual.

        Parameters
        ----------
        kind : str
            ``"pose"``, ``"position"``, ``"run"`` or ``"wander"``, with `` t`` or `` r`` for that from translations or
            turns of the frame alone.
        """
        if self.components is None:
            return 0.0
        pairs = zip(self.components.names, self.components.sizes, strict=True)
        return self.white * float(np.linalg.norm([size for name, size in pairs if name.startswith(kind)]))

    @property
    def cost(self) -> float:
        """What the dependence costs in a comparison of sets of effects that are whitened by different ones.

        ln of the determinant of V over all rows, and ln(n) for each variance: to be added to -2 ln of the probability
        of the whitened residuals.
        """
        if self.components is None or self._motion is None or self.deviations is None:
            return 0.0
        nothing = np.ones((*self._motion.columns.shape[:2], 1))
        return (
            Weighted(Moments(self._motion, nothing), self.deviations).log_determinant + self.components.price
        )

    @cached_property
    def deviations(self) -> MotionDeviations | None:
        """Standard deviations of what readings share, relative to `white`; None where they are independent."""
        if self.components is None or self._motion is None:
            return None
        return self.components.deviations(self._groups, self._motion.dof)

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
        if self._motion is None or self.deviations is None:
            return None
        return Whitener(self._motion, self.deviations)

    def _errors(self) -> list[Array]:
        """Return standard errors of the logarithms of sizes and time, along independent directions."""
        if self.components is None or self.components.information is None:
            return []
        values, vectors = eigh(self.components.information)
        return [*(vectors / np.sqrt(np.maximum(values, 0.0) + WIDEST**-2)).T]

    def _moved(self, step: Array) -> MotionDeviations:
        """Return the deviations where logarithms of sizes and time are others."""
        assert self.components is not None
        assert self._motion is not None
        return self.components.deviations(self._groups, self._motion.dof, np.exp(step))

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
            onto = motion.onto(columns)
            spread = motion.covariance_of(deviations, columns, onto)
            error = np.zeros(len(spread))  # variance of log v
            for step in self._errors():
                one, below = (motion.variances_of(self._moved(x), columns, onto) for x in (step, -step))
                error += np.log(np.divide(one, below, out=np.ones_like(one), where=below > 0)) ** 2 / 4
            enlarged = 1 / np.sqrt(1 - np.minimum(error, UNCERTAIN))
            return np.asarray(self.white**2 * spread * np.outer(enlarged, enlarged))

    @property
    def cautious(self) -> MotionDeviations | None:
        """Deviations that are one standard error larger along each direction in which they were estimated."""
        if self.deviations is None:
            return None

        def size(step: Array) -> float:
            end = self._moved(step)
            return sum(float(x @ x) for x in (end.shared, end.wander, end.position, end.run))

        errors = self._errors()
        return self._moved(sum((max(x, -x, key=size) for x in errors), np.zeros(len(errors))))


INDEPENDENT = Correlation(0.0)
"""Of readings without an error, and of those that nothing is fitted to."""


@dataclass(frozen=True, eq=False)
class FitRows:
    """Rows of a fit with the derivatives of their weighted residuals, which its correlation is estimated on.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Their numbers among the fit's observations; no outliers.
    observations : Observations
        These rows.
    weight, residual : ndarray, shape (n, m)
        Weights, and weighted residuals.
    columns : ndarray, shape (n, m, parameters)
        Derivatives with respect to all parameters.
    """

    fit: Fit
    rows: NDArray[np.int_]
    observations: Observations
    weight: Array
    residual: Array
    columns: Array

    @classmethod
    def of(cls, fit: Fit) -> FitRows:
        """Return the rows of a fit, without outliers; of very many a sample."""
        return cls.at(fit, sample_of(fit.observations, ~fit.outliers))

    @classmethod
    def at(cls, fit: Fit, rows: NDArray[np.int_]) -> FitRows:
        """Return some rows of a fit."""
        theta, frame = fit.solution.theta, fit.solution.frame
        problem = fit.problem if len(rows) == fit.observations.n else fit.problem.take(rows)
        residual = problem.residuals(theta, frame, weighted=True)
        return FitRows(
            fit, rows, problem.observations, problem.weight, residual, problem.jacobian(theta, frame)
        )

    @property
    def model(self) -> Array:
        """Derivatives with respect to the parameters that the fit adjusted, (n, m, p)."""
        moving = list(self.fit.moving)
        return self.columns if len(moving) == self.columns.shape[2] else self.columns[:, :, moving]

    @cached_property
    def frame(self) -> Array:
        """Derivatives with respect to a motion of the whole frame, (n, m, 6), or (n, m, 3) of directions."""
        model, solution = self.fit.problem.model, self.fit.solution
        return frame_motion(model, self.observations, solution.theta, solution.frame, self.weight)


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
    weighed : bool
        Whether the estimates weigh readings by their dependence, as those of points of one body do.
    """

    correlation: Correlation
    covariance: Array | None
    factor: float = 1.0
    weighed: bool = False

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
        who = [words for kind, words, _ in SHARED if self.correlation.size(kind)]
        if self.weighed:
            return (
                f"{capitalized(joined(who))} share errors; the estimates weigh shifts and turns of poses by the "
                "noise of each."
            )
        return (
            f"{capitalized(joined(who))} share errors; the standard deviations allow for that, and are up to "
            f"{self.factor:.2g} times those of independent readings."
        )


@stage("how readings depend on each other")
def dependence(fit: Fit) -> Dependence:
    """Return how the errors of a fit's readings depend on each other.

    Notes
    -----
    The fit weighs readings as if they were independent, so that its estimates have the covariance C JᵀVJ C, C that of
    independent readings of variance 1 and V as estimated (White 1980). Priors of the file are counted as they are.

    Of the points of one body it would weigh their distances, which are exact, as it does the place of the body. Their
    estimates are those of generalized least squares (Aitken 1935), with the covariance (JᵀV⁻¹J)⁻¹.
    """
    if not fit.free:
        return Dependence(INDEPENDENT, None)
    rows = FitRows.of(fit)
    correlation = estimate_correlation(rows, ())
    if correlation.independent:
        return Dependence(correlation, None)
    if _is_weighed(fit, correlation):
        covariance, _, p_value = _generalized(fit, correlation)
        if fit.weighed or p_value > LACK_OF_FIT.rare:
            return Dependence(correlation, covariance, weighed=True)
    single = fit.determinacy.covariance
    with one_thread_in_blas():
        n, m, p = rows.columns.shape
        columns = (rows.columns.reshape(n * m, p) @ single).reshape(n, m, p)
        part = len(rows.residual) / max(fit.rows, 1)
        covariance = correlation.covariance_of(columns) / part
        if fit.problem.file_values.is_prior or fit.determinacy.held:
            _, square, _ = fit.problem.normal_equations(fit.solution.theta, fit.solution.frame)
            covariance += fit.variance_factor * (single - single @ square @ single)
    alone = np.diag(fit.independent_covariance)
    factors = np.diag(covariance)[alone > 0] / alone[alone > 0]
    return Dependence(correlation, np.asarray(covariance), float(np.sqrt(factors.max(initial=0.0))))


def as_one_body(fit: Fit, correlation: Correlation | None = None) -> Fit:
    """Return the fit by generalized least squares where targets are points of one body, else itself.

    Also itself where both estimates differ by more than the noise: then the model is wrong, and what it misses tells
    nothing of the noise (Hausman 1978).

    Parameters
    ----------
    correlation : Correlation, optional
        How the readings depend on each other, where the estimates are known to agree; left out: as the fit leaves them.
    """
    if not is_one_body(fit):
        return fit
    found = correlation or fit.dependence.correlation
    for _ in range(STEPS) if _is_weighed(fit, found) else ():
        _, step, p_value = _generalized(fit, found)
        if correlation is None and p_value < LACK_OF_FIT.rare:
            break
        solution, problem = fit.solution, fit.problem
        theta, frame = moved(problem, solution.theta, solution.frame, step)
        there = replace(solution, theta=theta, frame=frame, cost=problem.cost(theta, frame))
        if not there.cost < WORSE * solution.cost:
            break
        fit = Fit.of(problem, there, fit.free, fit.outliers, fit.loss, weighed=True)
    return fit


def _is_weighed(fit: Fit, correlation: Correlation) -> bool:
    """Return whether estimates may weigh readings by what poses share."""
    return (
        not (correlation.independent or correlation.wanders)
        and fit.degrees_of_freedom > 0
        and is_one_body(fit)
    )


def _generalized(fit: Fit, correlation: Correlation) -> tuple[Array, Array, float]:
    """Return the covariance of the estimates of generalized least squares, the step to these, and how likely it is.

    The step from the estimates of least squares has the difference of both covariances.
    """
    from scipy import special

    assert correlation.deviations is not None
    rows, root = FitRows.at(fit, np.flatnonzero(~fit.outliers)), Whitened(fit).root
    with one_thread_in_blas():
        motion, _ = shared_motion(rows)
        columns = np.concatenate([rows.columns @ root, rows.residual[:, :, None]], axis=2)
        white = Whitener(motion, correlation.deviations)(columns).reshape(-1, columns.shape[2])
        file = fit.problem.file_values
        away = np.column_stack([root, fit.solution.theta - file.centre]) * file.precision[:, None]
        known = away[file.precision > 0] * correlation.white
        triangle = np.asarray(np.linalg.qr(np.concatenate([white, known]), mode="r"))
        half = np.linalg.inv(triangle[:-1, :-1])
        step = -half @ triangle[:-1, -1]
        spread = motion.covariance_of(correlation.deviations, columns[:, :, :-1])
        values, vectors = eigh(correlation.white**2 * (spread - half @ half.T))
    real = values > ALIKE * values[-1]
    off = float(np.sum((vectors[:, real].T @ step) ** 2 / values[real]))
    half, p_value = root @ half, float(special.chdtrc(np.count_nonzero(real), off))
    return correlation.white**2 * half @ half.T, root @ step, p_value


def estimate_correlation(
    linear: FitRows,
    nuisance: Sequence[Array],
    tries: Sequence[float] | None = None,
    included: Sequence[Array] = (),
    *,
    runs: bool = True,
    alone: Correlation | None = None,
) -> Correlation:
    """Return how the residuals of a fit depend on each other, estimated by REML.

    Parameters
    ----------
    nuisance : sequence of ndarray, each of shape (n, m, k)
        Columns of each candidate; the columns of the fit's own parameters are always projected out.
    tries : sequence of float, optional
        Number of independent tests that the values tried for each candidate amount to; left out: one of each.
    included : sequence of ndarray, each of shape (n, m, k)
        Columns of effects that are there; they are projected out, too.
    runs : bool
        Whether runs may differ for no reason, and what wanders begins anew in each: not where a candidate says how they
        differ.
    alone : Correlation, optional
        The same without candidates, where it is known.
    """
    if alone is not None and alone.independent:
        return alone
    with one_thread_in_blas():
        fit, o = linear.fit, linear.observations
        believed = believed_readings(linear)
        motion, groups = shared_motion(linear, runs=runs)
        poses = motion.poses
        rows = _chosen(poses.count)[poses.of]
        rows &= _often_read(o.target, rows)
        every = bool(rows.all())
        some = poses if every else poses.taken(rows)
        residual = np.where(believed, linear.residual, 0.0)[rows].ravel()
        readings = int(believed[rows].sum())
        # without a constant displacement of the frame, which does not wander
        model = np.concatenate([linear.model, *included, linear.frame], axis=2)
        model = (model if every else model[rows]).reshape(len(residual), -1)
        read = model.any(axis=0)  # not of the targets that are left out
        basis = orthonormal_basis(model if read.all() else model[:, read])
        residual = project_out(basis, residual)
        dof = readings - basis.shape[1]
        scatter = float(residual @ residual)
        rounding = NO_RESIDUAL**2 * fit.problem.scale * len(some.of) / max(fit.problem.count, 1)
        if dof < 1 or scatter <= rounding:
            return INDEPENDENT
        white = float(np.sqrt(scatter / dof))
        known = np.bincount(poses.of[believed.any(axis=1)], minlength=poses.count)
        columns = [unit_columns(effect[rows].reshape(len(residual), -1)) for effect in nuisance]
        kinds = ["pose"] if int(np.count_nonzero(known > 1)) >= FEWEST_LEVELS else []
        levels = {"position": some.position} | ({"run": some.run} if runs else {})
        kinds += [
            kind
            for kind, level in levels.items()
            if level is not None
            and FEWEST_LEVELS <= int(level.max(initial=0)) + 1 <= MOST_LEVELS // motion.dof
        ]
        kinds += ["wander"] if np.count_nonzero(known) >= LEAST_POSES else []
        if not kinds or dof < LEAST_POSES:
            return Correlation(white)
        least = _least_error(linear, believed, kinds) / white
        sample = motion if every else SharedMotion(some, motion.columns[rows])
        estimator = VarianceEstimator(
            sample, groups, basis, columns, residual / white, readings, tries, least**2
        )
        components = estimator.best(kinds, None if alone is None else alone.components)
        if not components.names:
            return Correlation(white)
        white *= float(np.sqrt(components.variance))
        correlation = Correlation(white, components, "", motion, groups)
        # where readings scatter no more than their stated noise, nothing else is needed
        within_noise = o.sigma is not None and scatter <= dof
        if components.gain - components.price <= VARIANCES.claimed or within_noise:
            return correlation
        typical = 1 / (
            float(np.median(np.broadcast_to(linear.weight, believed.shape)[believed])) * fit.unit_factor
        )
        return replace(correlation, text=_text(correlation, typical, fit.unit, poses))


def _least_error(linear: FitRows, believed: Mask, kinds: Sequence[str]) -> float:
    """Return the least error that a reading has by itself, weighted: its rounding, or what is stated.

    Of what is stated, readings of one pose may share a part.
    """
    weight = np.broadcast_to(linear.weight, believed.shape)
    step = resolution(linear.observations.reading) / math.sqrt(12)
    rounding = float(np.median(weight[believed])) * step
    stated = linear.observations.sigma is not None and "pose" not in kinds
    return max(rounding, 1.0 if stated else 0.0)


def shared_motion(linear: FitRows, *, runs: bool = True) -> tuple[SharedMotion, dict[str, slice]]:
    """Return the frame's motion in units of what it does to the mean reading, and its degrees of freedom by name.

    Parameters
    ----------
    runs : bool
        Whether what wanders begins anew in each run.
    """
    o = linear.observations
    run = o.run if runs else np.zeros_like(o.run)
    _, first, pose = np.unique(o.pose, return_index=True, return_inverse=True)
    position = _few_positions(o.q[first])
    poses = Poses.among(o.pose, run, o.t, None if position is None else position[pose])
    believed = believed_readings(linear)
    H = np.where(believed[:, :, None], linear.frame, 0.0)
    named = {"r": slice(0, 3)} if H.shape[2] == 3 else {"t": slice(0, 3), "r": slice(3, 6)}
    groups = {}
    for name, of in named.items():
        size = np.sqrt(np.sum(H[:, :, of] ** 2) / max(int(believed.sum()), 1))
        if size > 0:
            H[:, :, of] /= size
            groups[name] = of
    return SharedMotion(poses, H), groups


def _few_positions(q: Array) -> NDArray[np.intp] | None:
    """Return the position of all joints in each pose; None where most poses, (P, J), are at one of their own."""
    most, columns = len(q) // 2, []
    for column in q.T:
        columns.append(places.positions(column))
        if int(columns[-1].max(initial=0)) >= most:
            return None
    position = places.groups(columns, len(q))
    return position if int(position.max(initial=0)) < most else None


def believed_readings(linear: FitRows) -> NDArray[np.bool_]:
    """Return which readings the fit does not leave out, (n, m)."""
    weight = np.broadcast_to(linear.weight, linear.residual.shape)
    return np.asarray(weight > NO_READING * weight.max(initial=0.0))


def _chosen(count: int) -> NDArray[np.bool_]:
    """Return which poses the variance components are estimated from."""
    is_chosen = np.ones(count, np.bool_)
    if count > MOST_POSES:
        is_chosen[:] = False
        length = MOST_POSES // STRETCHES_VARIANCE
        for start in np.linspace(0, count - length, STRETCHES_VARIANCE).astype(int):
            is_chosen[start : start + length] = True
    return is_chosen


def _often_read(target: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows, (n,), are of the targets from which the variance components are estimated."""
    times = np.bincount(target[rows], minlength=int(target.max(initial=0)) + 1)
    is_chosen = np.zeros(len(times), np.bool_)
    is_chosen[np.argsort(-times, kind="stable")[:MOST_TARGETS]] = True
    return np.asarray(is_chosen[target])


def _sized(size: float, unit: str) -> str:
    factor, unit = readable(unit, size)
    return f"{two_digits(size * factor)} {unit}"


def _text(correlation: Correlation, typical: float, unit: str, poses: Poses) -> str:
    """Return the sentence; `typical` brings a weighted residual to the fit's unit."""
    parts = []
    for kind, _, words in SHARED:
        if correlation.size(kind):
            parts.append(f"{words} {_sized(typical * correlation.size(kind), unit)}")
    if correlation.wanders:
        parts[-1] += f" {_time(correlation.time, poses)}"
    text = ", and ".join(parts)
    if correlation.white < NO_ERROR * math.hypot(*(correlation.size(kind) for kind, _, _ in SHARED)):
        return f"{capitalized(text)}; single readings have no error of their own compared with that."
    alone = _sized(typical * correlation.white, unit)
    if not correlation.size("pose") and np.bincount(poses.of).max() > 1:
        return (
            f"{capitalized(text)}, in addition to an error of {alone} by which readings of one pose differ."
        )
    return f"{capitalized(text)}, in addition to an independent error of {alone} per reading."


SHARED = (
    ("pose", "the readings of one pose", "readings of one pose share an error of"),
    ("position", "those of one position", "readings of one position share an error of"),
    ("run", "those of one run", "runs differ by"),
    ("wander", "successive poses", "the set-up wanders by"),
)
"""What shares errors of each kind, and how a sentence on them begins."""


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


MOST_READINGS = 6_000
"""Readings that decisions are made on: an effect that is worth half a percent of the error lowers chi-square on them by
60, which chance does with p = 1e-14; one that is worth less is no discovery."""
STRETCHES = 20
"""Number of stretches taken of more rows, so that neighbours in time stay neighbours."""


def sample_of(observations: Observations, believed: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return the rows that decisions are made on: all but outliers, or stretches of whole poses of many rows."""
    most = MOST_READINGS // len(observations.machine.measurand.components)
    if np.count_nonzero(believed) <= most:
        return np.flatnonzero(believed)
    pose, taken = observations.pose, np.zeros(observations.n, bool)
    for start in np.linspace(0, observations.n, STRETCHES, endpoint=False).astype(int):
        some = slice(start, start + most // STRETCHES)
        pose_of_row = pose[some]
        taken[some] = (
            (pose_of_row != pose_of_row[0]) & (pose_of_row != pose_of_row[-1])
            if len(np.unique(pose_of_row)) > 2
            else True
        )
    return np.flatnonzero(taken & believed)


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
    motion, whitening = _independent(model, o, theta, frame, weight, middle), o.whitening
    return motion if whitening is None else whitening @ motion


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
    if measurand.has_origin:
        arm = place - np.asarray(model.machine.measured.origin)
        away = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    else:  # a height
        away = np.broadcast_to([0.0, 0.0, 1.0], place.shape)
    return np.asarray(-np.einsum("kni,ni,nm->nmk", motions, away, weight))
