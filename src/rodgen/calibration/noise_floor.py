"""How well a machine could be modelled at all, from the data alone: the noise floor.

Replicates, which are poses that are repeated, show the noise without a model: their scatter holds the instrument's
noise and how well the machine repeats. What differs from run to run, or wanders slowly, and is not modelled is
taken out where it shows. Without replicates the noise is what is stated. How much of it the readings of one
pose do not share is what the variance components say (:mod:`rodgen.calibration.dependence`).

All as standard deviations of a scalar reading. What is read in one pose is dependent, so that degrees of freedom are
not counted but estimated (Satterthwaite 1946): those of independent normal readings whose sum of squares would scatter
as this one does. Its variance is twice the sum of the squared covariances within a pose, of which the estimates are
corrected for their own scatter (Bai and Saranadasa 1996).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array, Index
from rodgen.calibration.dependence import Correlation
from rodgen.calibration.fitted import Fit
from rodgen.calibration.words import sized
from rodgen.data.poses import stretches
from rodgen.data.units import readable
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.views import Result

ALIKE = 1.1
"""A figure that contradicts another must also be off by more than this factor: finer differences do not matter."""
ONE_BODY = 1e-4
"""Part of the residuals below which distances between targets hardly differ from pose to pose. Of targets that are
read one by one they differ by what a reading is uncertain, and no model is ten thousand times worse than that."""
FEW_POSES = 5
"""Fewer differences between poses do not show what the readings of a pose share."""
MOST_POSES = 20_000
"""Poses that covariances are estimated from at most: their sum is then good to about 1 %."""


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
    """Residuals of equal commands, target by target ("cells"), less the mean of their replicates.

    The readings of a target in one pose count as one cell.
    """

    normalized: Array
    """Of cells that are repeated, times the roots of their weights, (n, c); standard deviation √(variance · left)."""
    left: Array
    """Part of the variance that the mean of the replicates leaves: 1 - weight / (sum of their weights), (n, c)."""
    pose: Index
    target: Index
    """Numbers of the pose and of the target, (n,)."""
    lost: float
    """Degrees of freedom that something fitted has taken away."""
    unit: float
    """A weighted residual of 1, in the unit of these."""
    cells: int
    """Of all rows, repeated or not."""
    cell_squares: float
    """Weighted sum of the squares of all cells' residuals."""
    within: float
    """Variance of the readings of one cell; 0 where each is a single one."""
    readings: float
    """Of a cell, in the mean."""

    @property
    def sum_of_squares(self) -> float:
        """Weighted."""
        return float(np.sum(self.normalized**2))

    @property
    def count(self) -> float:
        """Degrees of freedom, were all values independent."""
        return float(self.left.sum()) - self.lost

    @property
    def differences(self) -> float:
        """Number of differences between poses."""
        largest = np.zeros(int(self.pose.max(initial=-1)) + 1)
        np.maximum.at(largest, self.pose, self.left.max(axis=1))
        return float(largest.sum())

    @property
    def variance(self) -> float:
        """Mean square per degree of freedom."""
        return self.sum_of_squares / self.count

    @property
    def share(self) -> float:
        """Share of the degrees of freedom that remains because values of one pose depend on each other."""
        share = independent_share(self.normalized, self.left, self.pose, self.target)
        if self.differences < FEW_POSES and self.count > 0:
            share = min(share, self.left.shape[1] * self.differences / self.count)
        return share

    @property
    def noise(self) -> StandardDeviation | None:
        """The standard deviation of a single reading; None without replicates.

        The mean of n readings of a pose scatters by τ² + ω²/n, a single one by τ² + ω².
        """
        if self.count < 1:
            return None
        of_reading = self.variance / self.readings + self.within * (1 - 1 / self.readings)
        return StandardDeviation.of(of_reading, max(self.share * self.count, 1.0))

    def without_drift(self, correlation: Correlation) -> Replicates:
        """Return them without what runs or a wander of the set-up add: no larger than the variance components say."""
        drifts = correlation.claimed and (correlation.wanders or correlation.size("run") > 0)
        found = self.noise if drifts else None
        if found is None or not found.value > (least := correlation.of_neighbours * self.unit):
            return self
        return replace(
            self,
            normalized=self.normalized * least / found.value,
            within=self.within * (least / found.value) ** 2,
        )


def independent_share(value: Array, left: Array, pose: Index, column: Index) -> float:
    """Return the effective degrees of freedom of a sum of squares, as part of those of independent values.

    Parameters
    ----------
    value : ndarray, shape (n, c)
        Of equal variance but for `left`, without weights.
    left : ndarray, shape (n, c)
        Part of the variance that is left of each.
    pose, column : ndarray of int, shape (n,)
        Values of different poses are independent; equal columns of different poses are alike.
    """
    if not len(value):
        return 1.0
    _, place = np.unique(pose, return_inverse=True)
    _, at = np.unique(column, return_inverse=True)
    step = int(place.max()) // MOST_POSES + 1
    some = place % step == 0
    table = np.zeros((2, int(place.max()) // step + 1, int(at.max()) + 1, value.shape[1]))
    table[:, place[some] // step, at[some]] = value[some], np.sqrt(left[some])
    values, seen = table.reshape(2, table.shape[1], -1)
    number = seen.T @ seen
    covariance = values.T @ values / np.where(number > 0, number, np.inf)
    own, each = np.diag(covariance), np.diag(number)
    shared = (number * covariance**2 - np.where(number > 0, np.outer(own, own), 0.0)) * number / (number + 1)
    np.fill_diagonal(shared, 0.0)
    scatter = float(np.sum(each**2 * own**2 / (each + 2))) + max(float(shared.sum()), 0.0)
    return min(float(np.sum(values**2)) ** 2 / scatter / float(each.sum()), 1.0) if scatter > 0 else 1.0


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


def noise_floor(fit: Fit) -> NoiseFloor:
    """Return the noise by every source.

    Parameters
    ----------
    fit : Fit
        Its residuals are looked at, so that what is modelled of time and temperature does not count as noise between
        replicates; outliers are left out.
    """
    before, correlation = replicates(fit), fit.dependence.correlation
    repeated = before.without_drift(correlation)
    pure, stated, distances = repeated.noise, _stated(fit), distances_between_targets(fit)
    several = len(np.unique(fit.observations.pose)) < fit.observations.n
    return NoiseFloor(
        value=pure.value if pure else stated,
        unit=fit.unit,
        source="replicates" if pure else "stated" if stated else None,
        replicates=pure,
        replicated_poses=len(np.unique(repeated.pose)) if pure else 0,
        with_drift=before.noise if repeated is not before else None,
        within_poses=correlation.white * before.unit if correlation.claimed and several else None,
        stated=stated,
        distances=distances,
        one_body=is_one_body(fit, distances, pure),
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
    o = fit.observations
    rows = np.flatnonzero(~fit.outliers)
    order = rows[np.lexsort((o.pose[rows], o.replicate[rows]))]
    group, pose = o.replicate[order], o.pose[order]
    value = _in_one_basis(fit, order, group)
    weight = np.ones_like(value)
    if weighted:
        weight = (fit.problem.base_weight[order] * fit.unit_factor) ** 2
    starts, readings = stretches(group, pose)
    total = np.add.reduceat(weight, starts)
    mean = np.add.reduceat(weight * value, starts) / total
    within = float(np.sum(weight * (value - np.repeat(mean, readings, axis=0)) ** 2))
    first, poses = stretches(group[starts])
    whole = np.repeat(np.add.reduceat(total, first), poses, axis=0)
    middle = np.repeat(np.add.reduceat(total * mean, first), poses, axis=0) / whole
    some = np.repeat(poses > 1, poses)
    return Replicates(
        ((mean - middle) * np.sqrt(total))[some],
        (1 - total / whole)[some],
        pose[starts][some].astype(int),
        o.target[order[starts]][some].astype(int),
        _differing_parameters(fit),
        1.0 if weighted else _of_weighted(fit),
        len(starts),
        float(np.sum(total * mean**2)),
        within / max((len(order) - len(starts)) * value.shape[1], 1),
        float(1 / np.mean(1 / readings[some])) if some.any() else 1.0,
    )


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


def is_one_body(fit: Fit, distances: float | None, replicates: StandardDeviation | None) -> bool:
    """Return whether what was measured is the pose of one body, whose points were calculated.

    Their distances then scatter far below any figure for a reading's error: gross errors and wrong files enlarge some.
    """
    typical = float(np.median(np.abs(fit.residuals[~fit.outliers]))) / HALF_OF_NORMAL
    least = min(typical, replicates.value if replicates else math.inf, _stated(fit) or math.inf)
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
        kept = f"The targets keep their distances to {sized(floor.distances or 0.0, unit, '.3g')}"
        yield f"{kept}: what was measured is the pose of one body, and this does not say how well."
    elif floor.within_poses is not None and floor.within_poses * ALIKE < (floor.value or math.inf):
        yield f"Readings of one pose differ by {sized(floor.within_poses, unit, '.3g')}; the rest they share."


def _verdict(stated: float | None, found: StandardDeviation) -> str:
    """Return how a stated noise compares with the interval of what was found; empty where none is stated."""
    if stated is None:
        return ""
    if stated > max(found.high, ALIKE * found.value):
        return f"is {_times(stated / found.value)} larger than the replicates say"
    if stated < min(found.low, found.value / ALIKE):
        return f"is {_times(found.value / stated)} smaller than the replicates say"
    return "agrees"


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio < 1000 else "over 1000 times"
