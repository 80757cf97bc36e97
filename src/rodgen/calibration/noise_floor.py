"""How well a machine could be modelled at all, from the data alone: the noise floor.

Replicates, which are poses that are repeated, show the noise without a model: their scatter holds the instrument's
noise and how well the machine repeats. What differs from run to run, or wanders slowly, and is not modelled is
taken out where it shows. Without replicates the noise is what is stated. How much of it the readings of one
pose do not share is what the variance components say (:mod:`rodgen.calibration.dependence`).

All as standard deviations of a scalar reading. What is read in one pose is dependent, so that degrees of freedom are
those of independent normal readings whose sum of squares would scatter as this one does (Satterthwaite 1946).

Whether residuals are larger than the noise, that is, whether the model misses something, is tested. Where poses were
repeated, the squares of the residuals split into those from the mean of the replicates (pure error) and those of that
mean from the model, and their ratio is compared with F. Where a noise is stated, their sum is compared with chi-square
with it. A stated noise may be too small, and replicates that follow each other share errors and scatter too little: so
where both are known the residuals exceed the noise only if they exceed either.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array, Index
from rodgen.calibration.fitted import Fit
from rodgen.calibration.words import chance, sized
from rodgen.data.poses import stretches
from rodgen.data.units import readable
from rodgen.stages import stage
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.statistics.thresholds import LACK_OF_FIT, SMALLEST_P
from rodgen.views import Result

ALIKE = 1.1
"""A figure that contradicts another must also be off by more than this factor: finer differences do not matter."""
ONE_BODY = 1e-4
"""Part of the residuals below which distances between targets hardly differ from pose to pose. Of targets that are
read one by one they differ by what a reading is uncertain, and no model is ten thousand times worse than that."""
FEW_POSES = 5
"""Fewer differences between poses do not show what the readings of a pose share."""


@dataclass(frozen=True)
class StandardDeviation:
    """An estimated standard deviation."""

    value: float
    degrees_of_freedom: float
    """Of independent normal values with as much information."""
    low: float
    high: float
    """It is between them with 95 % probability."""

    @classmethod
    def of(cls, variance: float, degrees_of_freedom: float) -> StandardDeviation:
        """Return the root of a variance, with its interval."""
        from scipy import special

        value = math.sqrt(variance)
        low, high = (
            math.sqrt(degrees_of_freedom / special.chdtri(degrees_of_freedom, p)) for p in (0.025, 0.975)
        )
        return cls(value, degrees_of_freedom, value * low, value * high)


@dataclass(frozen=True)
class Replicates:
    """Residuals of the first reading of each target in each pose ("cells"), and how those of equal commands differ."""

    variance: float
    """Mean square of the differences from their mean per degree of freedom, weighted."""
    count: float
    """Degrees of freedom, were all readings independent."""
    poses: int
    """That are repeated."""
    differences: int
    """Between poses."""
    cells: int
    """Of all rows, repeated or not."""
    squares: float
    """Weighted sum of the squares of all cells' residuals."""
    share: float
    """Part of the degrees of freedom that remains because components are unequally uncertain, and readings of one pose
    depend on each other."""
    drifting: float | None = None
    """Variance with what runs or a wander of the set-up add, where these show."""

    @property
    def noise(self) -> StandardDeviation | None:
        """The standard deviation of a reading; None without replicates."""
        return self._deviation(self.variance)

    @property
    def with_drift(self) -> StandardDeviation | None:
        """The same with what runs or a wander of the set-up add; None where these do not show."""
        return None if self.drifting is None else self._deviation(self.drifting)

    def _deviation(self, variance: float) -> StandardDeviation | None:
        return StandardDeviation.of(variance, max(self.share * self.count, 1.0)) if self.count >= 1 else None


@dataclass(frozen=True, repr=False)
class NoiseFloor(Result):
    """Standard deviation of a scalar reading, without any model or nearly so.

    Attributes
    ----------
    value : float or None
        By replicates where there are any, else what is stated; None where neither is there.
    unit : str
    source : {"replicates", "stated", None}
        Where `value` comes from.
    replicates : StandardDeviation or None
        Pure error of poses that are repeated.
    replicated_poses : int
    with_drift : StandardDeviation or None
        `replicates` with what runs, or a wander of the set-up, add to them; None where they do not.
    within_poses : float or None
        What the readings of a pose do not share: the instrument's part, at least. None where they share nothing.
    stated : float or None
        Root mean square of the stated uncertainties.
    distances : float or None
        Scatter of the distances between targets in one pose, for one reading.
    one_body : bool
        Whether that is so much less than the model predicts readings to that what was measured is the pose of one
        body: an error is then one of all readings of the pose.
    text : str
        The same for people.
    """

    value: float | None
    unit: str
    source: str | None
    replicates: StandardDeviation | None
    replicated_poses: int
    with_drift: StandardDeviation | None
    within_poses: float | None
    stated: float | None
    distances: float | None
    one_body: bool

    _keys = (
        "value unit source replicates replicated_poses with_drift within_poses stated distances one_body text"
    )

    @property
    def text(self) -> str:
        """The noise in sentences."""
        return " ".join(_sentences(self))


@stage("estimating the noise")
def noise_floor(fit: Fit) -> NoiseFloor:
    """Return the noise by every source.

    Parameters
    ----------
    fit : Fit
        Its residuals are looked at, so that what is modelled of time and temperature does not count as noise between
        replicates; outliers are left out.
    """
    correlation, repeated = fit.dependence.correlation, replicates(fit)
    pure, stated, distances = repeated.noise, _stated(fit), distances_between_targets(fit)
    several = len(np.unique(fit.observations.pose)) < fit.observations.n
    return NoiseFloor(
        value=pure.value if pure else stated,
        unit=fit.unit,
        source="replicates" if pure else "stated" if stated else None,
        replicates=pure,
        replicated_poses=repeated.poses if pure else 0,
        with_drift=repeated.with_drift,
        within_poses=correlation.white * _of_weighted(fit) if correlation.claimed and several else None,
        stated=stated,
        distances=distances,
        one_body=is_one_body(fit),
    )


def _stated(fit: Fit) -> float | None:
    sigma = fit.observations.sigma
    return None if sigma is None else float(np.sqrt(np.mean(sigma[~fit.outliers] ** 2)) / fit.unit_factor)


def _of_weighted(fit: Fit) -> float:
    """Return a weighted residual of 1 in the unit of the fit."""
    return _stated(fit) or 1 / float(np.median(fit.problem.base_weight[~fit.outliers])) / fit.unit_factor


def replicates(fit: Fit, *, weighted: bool = False) -> Replicates:
    """Return how the residuals of equal commands differ: equal targets, directions of approach and load, too.

    Parameters
    ----------
    fit : Fit
    weighted : bool
        Whether residuals are taken as parts of their stated uncertainty.
    """
    deviation, unit = _pure_error(fit, weighted), 1.0 if weighted else _of_weighted(fit)
    correlation = fit.dependence.correlation
    share = independent_share(fit, deviation.cells, is_stated=deviation.differences >= FEW_POSES)
    deviation = replace(deviation, share=share * deviation.share)
    least = (correlation.of_neighbours * unit) ** 2
    drifts = correlation.claimed and (correlation.wanders or correlation.size("run") > 0)
    if drifts and deviation.count >= 1 and deviation.variance > least:
        return replace(deviation, variance=least, drifting=deviation.variance)
    return deviation


def _pure_error(fit: Fit, weighted: bool) -> Replicates:
    """Return how the residuals of equal commands differ, as if all readings were independent."""
    o = fit.observations
    rows = np.flatnonzero(~fit.outliers)
    cell = o.pose[rows].astype(np.int64) * len(fit.machine.targets) + o.target[rows]
    first = np.unique(cell, return_index=True)[1]
    rows = rows[first]
    order = rows[np.argsort(o.replicate[rows], kind="stable")]
    group, pose = o.replicate[order], o.pose[order]
    value = _in_one_basis(fit, order, group)
    weight = np.ones_like(value)
    if weighted:
        weight = (fit.problem.base_weight[order] * fit.unit_factor) ** 2
    starts, counts = stretches(group)
    total = np.add.reduceat(weight, starts)
    mean = np.add.reduceat(weight * value, starts) / total
    squares = np.sum(weight * (value - np.repeat(mean, counts, axis=0)) ** 2, axis=0)
    count = value.size - mean.size - _differing_parameters(fit)
    some = np.repeat(counts > 1, counts)
    poses, groups = len(np.unique(pose[some])), len(np.unique(o.pose[order[starts]][counts > 1]))
    return Replicates(
        float(squares.sum()) / count if count >= 1 else math.nan,
        count,
        poses,
        poses - groups,
        len(order),
        float(np.sum(weight * value**2)),
        float(squares.sum() ** 2 / (squares @ squares) / len(squares)) if squares.any() else 1.0,
    )


def independent_share(fit: Fit, readings: int, *, is_stated: bool = True) -> float:
    """Return the effective degrees of freedom of a sum of squares, as part of those of independent readings.

    The variance of a sum of squares of n readings of which any two have the correlation ρ is 1 + (n - 1) ρ² times as
    large.

    Parameters
    ----------
    readings : int
        Of all poses.
    is_stated : bool
        Whether there are enough poses to show what their readings share; else it may be all.
    """
    correlation = fit.dependence.correlation
    shared = float(correlation.size("")) ** 2
    rho = 1.0 if not is_stated else shared / (shared + correlation.white**2) if shared > 0 else 0.0
    each = readings / max(len(np.unique(fit.observations.pose[~fit.outliers])), 1)
    return float(1 / (1 + (each - 1) * rho**2))


def _in_one_basis(fit: Fit, order: Index, group: Index) -> Array:
    """Return residuals; those of directions along the basis of their group's first row, for near the pole it turns."""
    residuals: Array = fit.residuals[order]
    if not fit.machine.measurand.is_direction:
        return residuals
    basis = np.stack([e[order] for e in fit.observations.basis], axis=1)
    return np.asarray(np.einsum("nk,nki,nli->nl", residuals, basis, basis[np.repeat(*stretches(group))]))


def _differing_parameters(fit: Fit) -> float:
    """Return how many fitted parameters may differ between replicates: those of time, temperature, velocity, run."""
    model, runs = fit.problem.model, len(fit.observations.run_names)
    parts = {"shift": 1 - 1 / runs, "remounting": 1.0}  # what all runs share is the same for all replicates
    count = 0.0
    for slot in (model.parameters[i].slot for i in fit.free):
        terms = model.structure.terms[int(str(slot[1]))].columns if slot[0] == "e" else ()
        count += parts.get(str(slot[0]), float(any(kind in {"t", "T", "v", "x"} for _, (kind, _) in terms)))
    return count


def distances_between_targets(fit: Fit) -> float | None:
    """Return the scatter of the distances between targets that are read in one pose, for one reading; fit's unit.

    None where there are none. Each target is compared with the next one in its pose, by its first reading; of
    directions chords are compared.
    """
    o, count = fit.observations, len(fit.machine.targets)
    rows = np.flatnonzero(~fit.outliers)
    cell, first = np.unique(o.pose[rows].astype(np.int64) * count + o.target[rows], return_index=True)
    pose, target, reading = cell // count, cell % count, o.reading[rows[first]]
    same = np.diff(pose) == 0
    if not fit.machine.measurand.is_place or not same.any():
        return None
    distance = np.linalg.norm(np.diff(reading, axis=0)[same], axis=1)
    _, pair = np.unique((target[:-1] * count + target[1:])[same], return_inverse=True)
    times = np.bincount(pair)
    off = distance - (np.bincount(pair, distance) / times)[pair]
    dof = len(off) - len(times)
    return float(np.sqrt(off @ off / dof / 2) / fit.unit_factor) if dof else None


def is_one_body(fit: Fit) -> bool:
    """Return whether what was measured is the pose of one body, whose points were calculated.

    Their distances then scatter far below any figure for a reading's error: gross errors and wrong files enlarge some.
    """
    distances, repeated = distances_between_targets(fit), _pure_error(fit, False)
    typical = float(np.median(np.abs(fit.residuals[~fit.outliers]))) / HALF_OF_NORMAL
    least = min(
        typical, math.sqrt(repeated.variance) if repeated.count >= 1 else math.inf, _stated(fit) or math.inf
    )
    return distances is not None and distances < ONE_BODY * least


def _sentences(floor: NoiseFloor) -> Iterator[str]:
    unit, main = floor.unit, floor.replicates
    if main is not None:
        factor, _ = readable(unit, main.value)
        interval = f"95 %: {main.low * factor:.3g} to {main.high * factor:.3g}"
        poses = f"{floor.replicated_poses} replicated poses ({interval})"
        stated = "" if floor.stated is None else f"; the stated {sized(floor.stated, unit, '.3g')} "
        yield f"The noise is {sized(main.value, unit, '.3g')} from {poses}{stated}{_verdict(floor.stated, main)}."
    elif floor.stated is not None:
        yield f"The noise is {sized(floor.stated, unit, '.3g')}, as stated."
    else:
        yield "The noise is not known: none is stated, and no pose was repeated."
    if floor.with_drift is not None:
        drifting = sized(floor.with_drift.value, unit, ".3g")
        yield f"With what differs from run to run, or wanders slowly, replicates differ by {drifting}."
    if floor.one_body:
        distances = f"The targets keep their distances to {sized(floor.distances or 0.0, unit, '.3g')}"
        yield f"{distances}: what was measured is the pose of one body, and this does not say how well."
    elif floor.within_poses is not None and floor.within_poses * ALIKE < (floor.value or math.inf):
        yield f"Readings of one pose differ by {sized(floor.within_poses, unit, '.3g')}; the rest they share."


def _verdict(stated: float | None, replicated: StandardDeviation) -> str:
    """Return how a stated noise compares with the interval of what was found; empty where none is stated."""
    if stated is None:
        return ""
    if stated > max(replicated.high, ALIKE * replicated.value):
        return f"is {_times(stated / replicated.value)} larger than the replicates say"
    if stated < min(replicated.low, replicated.value / ALIKE):
        return f"is {_times(replicated.value / stated)} smaller than the replicates say"
    return "agrees"


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio < 1000 else "over 1000 times"


@dataclass(frozen=True)
class LackOfFit(Result):
    """Whether the residuals are larger than the noise.

    Attributes
    ----------
    p_value : float
        Probability of residuals as large, were the model right; at least 1e-300.
    ratio : float
        Residuals over noise, as standard deviations with their degrees of freedom.
    against : {"replicates", "stated"}
        What the noise is known from.
    statistic : float
        F against replicates, chi-square against the stated noise.
    degrees_of_freedom : tuple of float
        Of F, or one of chi-square; effective ones.
    text : str
        One sentence.
    """

    p_value: float
    ratio: float
    against: str
    statistic: float
    degrees_of_freedom: tuple[float, ...]

    _keys = "p_value ratio against statistic degrees_of_freedom text"

    @property
    def misses(self) -> bool:
        """Whether the model misses something."""
        return self.p_value < LACK_OF_FIT.rare

    @property
    def text(self) -> str:
        """One sentence."""
        noise = "the stated noise" if self.against == "stated" else "the noise"
        p = chance(self.p_value)
        if self.misses:
            return f"The residuals are {self.ratio:.3g} times {noise}: the model misses something ({p})."
        if self.against == "stated" and self.p_value > 1 - LACK_OF_FIT.rare / 2:
            return f"The residuals are only {self.ratio:.3g} times {noise}: the noise is less than stated."
        return f"The residuals agree with {noise} ({self.ratio:.3g} times it, {p})."


def lack_of_fit(fit: Fit) -> LackOfFit | None:
    """Return the test of the residuals against the noise.

    Returns
    -------
    LackOfFit or None
        None where the noise is not known or zero, or no degree of freedom is left.
    """
    stated = fit.observations.sigma is not None
    pure = replicates(fit, weighted=stated)
    if not stated:
        return _against_replicates(fit, pure)
    by_stated = _against_stated(fit)
    by_replicates = _against_replicates(fit, pure) if pure.differences >= FEW_POSES else None
    if by_replicates is None or by_stated is None:
        return by_stated
    # a noise that the residuals contradict says nothing
    too_large = by_stated.p_value > 1 - LACK_OF_FIT.rare / 2
    return by_replicates if too_large or by_replicates.p_value > by_stated.p_value else by_stated


def _against_replicates(fit: Fit, pure: Replicates) -> LackOfFit | None:
    from scipy import special

    cells = pure.cells * fit.problem.components - fit.determinacy.rank
    residual_dof = cells - pure.count
    if pure.count < 1 or residual_dof < 1 or not pure.variance > 0:
        return None
    squares = max(pure.squares - pure.variance * pure.count, 0.0)
    dof = (max(pure.share * residual_dof, 1.0), max(pure.share * pure.count, 1.0))
    statistic = squares / residual_dof / pure.variance
    ratio = float(np.sqrt(pure.squares / cells / pure.variance))
    p_value = max(float(special.fdtrc(*dof, statistic)), SMALLEST_P)
    return LackOfFit(p_value, ratio, "replicates", statistic, dof)


def _against_stated(fit: Fit) -> LackOfFit | None:
    """Return the test of the residuals against the stated noise; None where no degree of freedom is left."""
    from scipy import special

    left = fit.degrees_of_freedom
    if left < 1:
        return None
    dof, ratio = max(independent_share(fit, fit.rows) * left, 1.0), fit.chi_square / left
    p = max(float(special.chdtrc(dof, dof * ratio)), SMALLEST_P)
    return LackOfFit(p, float(np.sqrt(ratio)), "stated", dof * ratio, (dof,))
