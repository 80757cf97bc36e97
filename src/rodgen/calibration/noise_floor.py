"""How well a machine could be modelled at all, from the data alone: the noise floor.

Three sources, each of which shows something else:

- replicates: poses that are repeated. Their scatter holds the instrument's noise and how well the machine repeats;
  what else differs between them and is not modelled (time, temperature, run) is taken out where it shows, and named.
- distances (for directions: angles) between targets in one pose: constant, whatever the machine does, so that their
  scatter is the instrument's noise. What the readings of a pose share is not in it; a scale that changes is.
- what is stated.

All as standard deviations of a scalar reading. What is read in one pose is dependent, so that degrees of freedom are
not counted but estimated (Satterthwaite 1946): those of independent normal readings whose sum of squares would scatter
as this one does. Its variance is twice the sum of the squared covariances within a pose, of which the estimates are
corrected for their own scatter (Bai and Saranadasa 1996).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.dependence import Fitted
from rodgen.calibration.words import sized
from rodgen.data.poses import stretches
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.machines.drivers import Driver, Kind
from rodgen.statistics.decompositions import svd
from rodgen.statistics.f_tests import f_tail
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.statistics.thresholds import NOISE
from rodgen.views import Result

ALIKE = 1.1
"""A figure that contradicts another must also be off by more than this factor: finer differences do not matter."""
ONE_BODY = 1e-4
"""Part of the residuals below which distances between targets hardly differ from pose to pose. Of targets that are
read one by one they differ by what a reading is uncertain, and no model is ten thousand times worse than that."""

Ints: TypeAlias = NDArray[np.integer[Any]]

DRIFTS: tuple[Kind, ...] = ("run", "time", "order", "temperature", "column")
"""Kinds of drivers that differ between poses with equal commands."""
SURE = 1e-4
"""Probability by chance, over all that is tried, below which something drives the deviations."""
DEGREE = 3
"""Of the polynomial in a driver that deviations are compared with: a drift and its bend."""
MOST_RUNS = 50
"""Runs that are looked at one by one; of more, a drift from run to run."""
MOST_POSES = 20_000
"""Poses that covariances are estimated from at most: their sum is then good to about 1 %."""
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
    def of(cls, variance: float, degrees_of_freedom: float, factor: float = 1.0) -> StandardDeviation:
        """Return the root of a variance, times a factor, with its interval."""
        from scipy import special

        value = factor * float(np.sqrt(variance))
        low, high = (
            float(np.sqrt(degrees_of_freedom / special.chdtri(degrees_of_freedom, p))) for p in (0.025, 0.975)
        )
        return cls(value, degrees_of_freedom, value * low, value * high)


@dataclass(frozen=True)
class Deviations:
    """Values less the mean of their group.

    Each has c components; its standard deviation is √variance · √(left / weight).
    """

    value: Array
    """Shape (n, c)."""
    weight: Array
    """Shape (n, c)."""
    left: Array
    """Part of the variance that the mean of the group leaves: 1 - weight / (sum of the group's weights), (n, c)."""
    group: Ints
    pose: Ints
    column: Ints
    """`column` numbers what is looked at in a pose, such as targets, (n,)."""
    row: Ints
    """A row of the data that it comes from, (n,)."""
    lost: float = 0.0
    """Degrees of freedom that something fitted has taken away."""

    @classmethod
    def of(
        cls,
        value: Array,
        weight: Array,
        group: Ints,
        pose: Ints,
        column: Ints,
        row: Ints,
    ) -> Deviations:
        """Take the means of the groups off, and leave out groups of one value. All in the order of the groups."""
        starts, sizes = stretches(group)
        total = np.repeat(np.add.reduceat(weight, starts), sizes, axis=0) if len(group) else weight
        mean = (
            np.repeat(np.add.reduceat(weight * value, starts), sizes, axis=0) / total if len(group) else value
        )
        several = np.repeat(sizes > 1, sizes)
        return cls(value - mean, weight, 1 - weight / total, group, pose, column, row).take(several)

    def take(self, rows: NDArray[np.bool_]) -> Deviations:
        """Return some of them."""
        names = ("value", "weight", "left", "group", "pose", "column", "row")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def normalized(self) -> Array:
        """Values times the roots of their weights."""
        return self.value * np.sqrt(self.weight)

    @property
    def sum_of_squares(self) -> float:
        """Weighted."""
        return float(np.sum(self.weight * self.value**2))

    @property
    def count(self) -> float:
        """Degrees of freedom, were all values independent."""
        return float(self.left.sum()) - self.lost

    @property
    def poses(self) -> float:
        """Number of differences between poses."""
        if not len(self.pose):
            return 0.0
        order = np.argsort(self.pose, kind="stable")
        starts, _ = stretches(self.pose[order])
        return float(np.maximum.reduceat(self.left.max(axis=1)[order], starts).sum())

    @property
    def variance(self) -> float:
        """Mean square per degree of freedom."""
        return self.sum_of_squares / self.count

    @property
    def share(self) -> float:
        """Share of the degrees of freedom that remains because values of one pose depend on each other."""
        share = independent_share(self.normalized, self.left, self.pose, self.column)
        if self.poses < FEW_POSES and self.count > 0:
            share = min(share, self.value.shape[1] * self.poses / self.count)
        return share

    def estimate(self, factor: float = 1.0) -> StandardDeviation:
        """Return the standard deviation at weight 1, times a factor."""
        return StandardDeviation.of(self.variance, max(self.share * self.count, 1.0), factor)

    def without_drift(self, candidates: Iterable[Driver]) -> tuple[Deviations, list[str]]:
        """Take out what follows a driver beyond doubt, the strongest first; return the rest, and the drivers' names."""
        left, named = self, list[str]()
        if not len(self.group):
            return left, named
        candidates = [driver for driver in candidates if len(driver.categories) != 1]
        while True:
            tried = [driver for driver in candidates if driver.text not in named]
            found = [(*left._explained(driver, SURE / len(tried)), driver.text) for driver in tried]
            best = min(found, key=lambda t: t[0], default=None)
            if best is None or best[0] > SURE / len(tried):
                return left, named
            left = best[1]
            named.append(best[2])

    def _explained(self, driver: Driver, enough: float) -> tuple[float, Deviations]:
        """Return the probability that chance explains as much as a driver does, and what it leaves.

        The probability is that for independent values where this is more than `enough` already.
        """
        by_row = _curve(driver, self.row)
        mean_weight = self.weight.mean(axis=1, keepdims=True)
        starts, sizes = stretches(self.group)
        mean = np.add.reduceat(mean_weight * by_row, starts) / np.add.reduceat(mean_weight, starts)
        columns = (by_row - np.repeat(mean, sizes, axis=0)) * np.sqrt(mean_weight)
        u, size, _ = svd(columns)
        u = u[:, size > 1e-9 * np.linalg.norm(by_row * np.sqrt(mean_weight))]
        used = u.shape[1] * self.value.shape[1]
        residual_dof = self.count - used
        if not used or residual_dof < FEW_POSES:
            return 1.0, self
        explained = u @ (u.T @ self.normalized)
        gain = float(np.sum(explained**2))
        rest = replace(self, value=self.value - explained / np.sqrt(self.weight), lost=self.lost + used)
        if not gain > 0:
            return 1.0, self
        with np.errstate(divide="ignore"):
            ratio = float(np.divide(gain / used, rest.variance))
        p = f_tail(ratio, used, residual_dof)
        if p > enough:  # fewer degrees of freedom make it no less
            return p, rest
        share = rest.share
        return f_tail(ratio, max(share * used, 1.0), max(share * residual_dof, 1.0)), rest


def _curve(driver: Driver, rows: Ints) -> Array:
    """Return functions of a driver for some rows, (rows, k): one for each category, or powers."""
    if 0 < len(driver.categories) <= MOST_RUNS:
        return np.asarray(np.eye(len(driver.categories))[driver.values[rows]])
    x = np.asarray(driver.values[rows], float)
    middle, half = (x.max() + x.min()) / 2, np.ptp(x) / 2
    return np.asarray(np.polynomial.legendre.legvander((x - middle) / (half or 1.0), DEGREE)[:, 1:])


def independent_share(value: Array, left: Array, pose: Ints, column: Ints) -> float:
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
    columns, at = np.unique(column, return_inverse=True)
    poses = int(place.max()) + 1
    if poses > MOST_POSES:
        some = place % (poses // MOST_POSES + 1) == 0
        _, place = np.unique(place[some], return_inverse=True)
        value, left, at, poses = value[some], left[some], at[some], int(place.max()) + 1
    c = value.shape[1]
    both = np.zeros((2, poses, len(columns), c))
    both[0, place, at], both[1, place, at] = value, np.sqrt(left)
    table, seen = both.reshape(2, poses, -1)
    number = seen.T @ seen
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = np.where(number > 0, table.T @ table / number, 0.0)
        own = np.diag(covariance)
        squares = (covariance**2 - np.outer(own, own) / number) / (1 + 1 / number)
        alone = own**2 / (1 + 2 / np.diag(number))
    total, alone_sum = float(np.sum(table**2)), float(np.nansum(np.diag(number) * alone))
    np.fill_diagonal(squares, 0.0)
    shared = float(np.sum(np.where(number > 0, number * np.nan_to_num(squares), 0.0)))
    scatter = alone_sum + max(shared, 0.0)
    return min(total**2 / scatter / float(np.diag(number).sum()), 1.0) if scatter > 0 else 1.0


# the three sources ----------------------------------------------------------------------------------------------

MOST_PAIRS = 60
"""Distances between targets that are looked at in a pose: more add little."""
MOST_ROWS = 1_000_000
"""Of more rows, every other (third, ...) group of equal commands is looked at."""
LONGEST = 200_000
"""Poses whose distances are looked at: a standard deviation from them is good to 0.2 %."""
CLOSE = 10.0
"""Targets nearer than so many scatters of their distance are left out: noise across their line changes it, too."""


@dataclass(frozen=True)
class Replicates:
    """Residuals of equal commands.

    Attributes
    ----------
    deviations : Deviations
        Of poses from the mean of those with equal commands, target, directions of approach and load; what follows
        time, run or temperature beyond doubt is taken out.
    drifts : tuple of str
        What that was.
    before : Deviations
        With it.
    cells : int
        Targets in poses: readings of one target in one pose count as one.
    cell_squares : float
        Weighted sum of the squares of the cells' residuals.
    readings : float
        Of a cell, in the mean.
    repeated : StandardDeviation or None
        Scatter of the readings of one target in one pose.
    """

    deviations: Deviations
    drifts: tuple[str, ...]
    before: Deviations
    cells: int
    cell_squares: float
    readings: float
    repeated: StandardDeviation | None

    @property
    def poses(self) -> int:
        """Number of poses that are repeated or repetitions."""
        return len(np.unique(self.deviations.pose))

    def noise(self, deviations: Deviations) -> StandardDeviation | None:
        """Return the standard deviation of a single reading; None without replicates.

        The mean of n readings of a pose scatters by τ² + ω²/n, a single one by τ² + ω²; ω is known from the repeats.
        """
        if deviations.count < 1:
            return None
        found = deviations.estimate()
        if self.repeated is None:
            return found
        between = found.value**2 / self.readings
        within = self.repeated.value**2 * (1 - 1 / self.readings)
        scatter = between**2 / found.degrees_of_freedom + within**2 / self.repeated.degrees_of_freedom
        return StandardDeviation.of(
            between + within, (between + within) ** 2 / scatter if scatter else found.degrees_of_freedom
        )


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
    drifts : tuple of str
        What differs between replicates and was taken out because their readings follow it.
    with_drifts : StandardDeviation or None
        `replicates` before that.
    repeated : StandardDeviation or None
        Scatter of readings of one target in one pose: the instrument's part, at least.
    distances : StandardDeviation or None
        From distances or angles between targets in one pose.
    stated : float or None
        Root mean square of the stated uncertainties.
    one_body : bool
        Whether the targets keep their distances so much better than the model predicts readings that what was measured
        is the pose of one body: an error is then one of all readings of the pose.
    text : str
        The same for people.
    """

    value: float | None
    unit: str
    source: str | None
    replicates: StandardDeviation | None
    replicated_poses: int
    drifts: tuple[str, ...]
    with_drifts: StandardDeviation | None
    repeated: StandardDeviation | None
    distances: StandardDeviation | None
    stated: float | None
    one_body: bool = False

    _keys = (
        "value unit source replicates replicated_poses drifts with_drifts repeated "
        "distances stated one_body text"
    )

    @property
    def text(self) -> str:
        """The noise in sentences."""
        return " ".join(_sentences(self))


def noise_floor(fit: Fitted) -> NoiseFloor:
    """Return the noise by every source.

    Parameters
    ----------
    fit : Fitted
        Its residuals are looked at, so that what is modelled of time and temperature does not count as noise between
        replicates; outliers are left out.
    """
    repeated = replicates(fit)
    pure = repeated.noise(repeated.deviations)
    stated = None
    if fit.observations.sigma is not None:
        stated = float(np.sqrt(np.mean(fit.observations.sigma[~fit.outliers] ** 2)) / fit.unit_factor)
    distances = _distances(fit)
    return NoiseFloor(
        value=pure.value if pure else stated,
        unit=fit.unit,
        source="replicates" if pure else "stated" if stated else None,
        replicates=pure,
        replicated_poses=repeated.poses if pure else 0,
        drifts=repeated.drifts,
        with_drifts=repeated.noise(repeated.before) if repeated.drifts else None,
        repeated=repeated.repeated,
        distances=distances,
        stated=stated,
        one_body=distances is not None and distances.value < ONE_BODY * _least_error(fit, pure, stated),
    )


def _least_error(fit: Fitted, replicates: StandardDeviation | None, stated: float | None) -> float:
    """Return the least figure for a reading's error: gross errors and wrong files enlarge the others."""
    typical = float(np.median(np.abs(fit.residuals[~fit.outliers]))) / HALF_OF_NORMAL
    return min([typical, *([replicates.value] if replicates else []), *([stated] if stated else [])])


# replicates ------------------------------------------------------------------------------------------------------


def replicates(fit: Fitted, *, weighted: bool = False) -> Replicates:
    """Return how the residuals of equal commands differ.

    Parameters
    ----------
    fit : Fitted
    weighted : bool
        Whether residuals are taken as parts of their stated uncertainty.
    """
    o = fit.observations
    many = max(o.n - 1, 0) // MOST_ROWS + 1
    rows = np.flatnonzero(~fit.outliers & (o.replicate % many == 0))
    order = rows[np.lexsort((o.pose[rows], o.replicate[rows]))]
    group, pose = o.replicate[order], o.pose[order]
    value = _in_one_basis(fit, order, group)
    weight = np.ones_like(value)
    if weighted:
        weight = (fit.problem.base_weight[order] * fit.unit_factor) ** 2
    starts, sizes = stretches(group, pose)
    total = np.add.reduceat(weight, starts)
    mean = np.add.reduceat(weight * value, starts) / total
    within = float(np.sum(weight * (value - np.repeat(mean, sizes, axis=0)) ** 2))
    residual_dof = (len(order) - len(starts)) * value.shape[1]
    at = order[starts]
    before = Deviations.of(mean, total, group[starts], pose[starts], np.asarray(o.target[at]), at)
    before = replace(before, lost=_differing_parameters(fit))
    deviations, drifts = before.without_drift(o.drivers(*DRIFTS))
    repeats = sizes[np.isin(group[starts], before.group)]
    return Replicates(
        deviations=deviations,
        drifts=tuple(drifts),
        before=before,
        cells=len(starts),
        cell_squares=float(np.sum(total * mean**2)),
        readings=float(1 / np.mean(1 / repeats)) if len(repeats) else 1.0,
        repeated=StandardDeviation.of(within / residual_dof, residual_dof) if residual_dof else None,
    )


def _in_one_basis(fit: Fitted, order: NDArray[np.int_], group: NDArray[np.int_]) -> Array:
    """Return residuals; those of directions along the basis of their group's first row, for near the pole it turns."""
    residuals: Array = fit.residuals[order]
    if not fit.machine.measurand.is_direction:
        return residuals
    left, above = (e[order] for e in fit.observations.basis)
    across = residuals[:, :1] * left + residuals[:, 1:] * above
    first = np.repeat(*stretches(group))
    return np.stack([np.einsum("ij,ij->i", across, e[first]) for e in (left, above)], axis=-1)


def _differing_parameters(fit: Fitted) -> float:
    """Return how many fitted parameters may differ between replicates: those of time, temperature, velocity, run."""
    model, runs = fit.problem.model, len(fit.observations.run_names)
    count = 0.0
    for i in fit.free:
        slot = model.parameters[i].slot
        if slot[0] == "shift":
            count += (runs - 1) / runs  # what all runs share is the same for all replicates
        elif slot[0] == "remounting":
            count += 1
        elif slot[0] == "e":
            kinds = {kind for _, (kind, _) in model.structure.terms[int(str(slot[1]))].columns}
            count += bool(kinds & {"t", "T", "v", "x"})
    return count


# distances -------------------------------------------------------------------------------------------------------


def _distances(fit: Fitted) -> StandardDeviation | None:
    """Return the noise by distances between targets in one pose."""
    o, measurand = fit.observations, fit.machine.measurand
    if not measurand.is_place or len(fit.machine.targets) < 2:
        return None
    made = list(_pairs(fit))
    if not made:
        return None
    group = np.concatenate([np.full(len(row), k) for k, (row, *_) in enumerate(made)])
    row, distance, variance = (np.concatenate([part[i] for part in made]) for i in range(3))
    deviations = Deviations.of(distance[:, None], 1 / variance[:, None], group, o.pose[row], group, row)
    if deviations.count < 1:
        return None
    factor = 1 / fit.unit_factor
    if o.sigma is not None:
        factor *= float(np.sqrt(np.mean(o.sigma[row] ** 2)))
    return deviations.estimate(factor)


def _pairs(fit: Fitted) -> Iterator[tuple[NDArray[np.int_], Array, Array]]:
    """Yield, for pairs of targets, rows of the first, distances or angles, and their variances for noise 1.

    Of a target that is read several times in a pose the first reading is taken: how the others depend on it is unknown.
    The noise enters along the line between the two; of directions along the great circle.
    """
    o, measurand, targets = fit.observations, fit.machine.measurand, len(fit.machine.targets)
    rows = np.flatnonzero(~fit.outliers)
    cell = o.pose[rows].astype(np.int64) * targets + o.target[rows]
    cell, first = np.unique(cell, return_index=True)
    pose, target, rows = cell // targets, cell % targets, rows[first]
    many = int(pose[-1]) // LONGEST + 1 if len(pose) else 1
    some = pose % many == 0
    pose, target, rows = pose[some], target[some], rows[some]
    pairs = list(combinations(range(targets), 2))
    for a, b in pairs[:: len(pairs) // MOST_PAIRS + 1]:
        _, at_a, at_b = np.intersect1d(pose[target == a], pose[target == b], return_indices=True)
        i, j = rows[target == a][at_a], rows[target == b][at_b]
        if not len(i):
            continue
        x, y = o.reading[i], o.reading[j]
        distance, longest = np.linalg.norm(y - x, axis=1), np.inf
        if not measurand.moving:
            distance, longest = 2 * np.arcsin(np.minimum(distance / 2, 1.0)), np.pi
        if min(distance.mean(), longest - distance.mean()) <= CLOSE * distance.std():
            continue
        along = [(y - x) / distance[:, None]] * 2 if measurand.moving else [_tangent(x, y), _tangent(y, x)]
        variance = np.full(len(i), 2.0)
        if o.sigma is not None:
            variance = sum(
                np.sum((e * o.sigma[k, :3]) ** 2, axis=1) for e, k in zip(along, (i, j), strict=True)
            )
        yield i, distance, variance


def _tangent(x: Array, y: Array) -> Array:
    """Return unit vectors across x towards y."""
    across = y - np.einsum("ij,ij->i", x, y)[:, None] * x
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


# words -----------------------------------------------------------------------------------------------------------


def _sentences(floor: NoiseFloor) -> Iterator[str]:
    unit, main = floor.unit, floor.replicates
    if main is not None:
        poses = f"{floor.replicated_poses} replicated poses ({_range(main, unit)})"
        said = f"The noise is {sized(main.value, unit, '.3g')} from {poses}"
        if floor.stated is not None:
            said += f"; the stated {sized(floor.stated, unit, '.3g')} {_verdict(floor.stated, main)}"
        yield f"{said}."
    elif floor.stated is not None:
        yield f"The noise is {sized(floor.stated, unit, '.3g')}, as stated."
    else:
        yield "The noise is not known: none is stated, and no pose was repeated."
    if floor.drifts:
        before = f"with it {sized(floor.with_drifts.value, unit, '.3g')}" if floor.with_drifts else ""
        yield (
            f"Between replicates the readings follow {joined(floor.drifts)}, which is taken out as a curve that all "
            f"poses share ({before}); where it differs from pose to pose, the noise is less."
        )
    if floor.distances is not None:
        yield _of_distances(floor, floor.distances)
    if floor.repeated is not None and main is None:
        said = sized(floor.repeated.value, unit, ".3g")
        yield f"Readings repeated in one pose scatter by {said}: the instrument's part, at least."


def _of_distances(floor: NoiseFloor, found: StandardDeviation) -> str:
    if floor.one_body:
        kept = f"The targets keep their distances to {sized(found.value, floor.unit, '.3g')}"
        return f"{kept}: what was measured is the pose of one body, and this does not say how well."
    said = f"Distances between targets say {sized(found.value, floor.unit, '.3g')}"
    against = floor.replicates or (None if floor.stated is None else _known(floor.stated))
    if against is None:
        return f"{said}, without what the readings of a pose share."
    match _compared(found, against):
        case 0:
            return f"{said}, which agrees."
        case -1:
            return f"{said}, {_times(against.value / found.value)} less: the rest is shared by the readings of a pose."
    more = f"{said}, {_times(found.value / against.value)} more"
    return f"{more}: the targets move on their body, the scale changes, or single readings are wrong."


def _verdict(stated: float, found: StandardDeviation) -> str:
    match _compared(_known(stated), found):
        case 0:
            return "agrees"
        case 1:
            return f"is {_times(stated / found.value)} larger than the replicates say"
    return f"is {_times(found.value / stated)} smaller than the replicates say"


def _known(value: float) -> StandardDeviation:
    return StandardDeviation(value, np.inf, value, value)


def _compared(one: StandardDeviation, other: StandardDeviation) -> int:
    """Return 1 where one figure is clearly larger than the other, -1 where it is smaller, 0 where they agree."""
    return 1 if _exceeds(one, other) else -1 if _exceeds(other, one) else 0


def _exceeds(one: StandardDeviation, other: StandardDeviation) -> bool:
    # From a million on F is chi-square to six digits; infinity is not taken.
    dof = min(one.degrees_of_freedom, 1e6), min(other.degrees_of_freedom, 1e6)
    with np.errstate(divide="ignore"):
        ratio = float(np.divide(one.value, other.value))
    return ratio > ALIKE and f_tail(ratio**2, *dof) < NOISE.chance


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio < 1000 else "over 1000 times"


def _range(found: StandardDeviation, unit: str) -> str:
    factor, _ = readable(unit, found.value)
    return f"95 %: {found.low * factor:.3g} to {found.high * factor:.3g}"
