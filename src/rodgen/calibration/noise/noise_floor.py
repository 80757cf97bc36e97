"""How well a machine could be modelled at all, from the data alone: the noise floor.

Three sources, each of which shows something else:

- replicates: poses that are repeated. Their scatter holds the instrument's noise and how well the machine repeats;
  what else differs between them and is not modelled (time, temperature, run) is taken out where it shows, and named.
- distances (for directions: angles) between targets in one pose: constant, whatever the machine does, so that their
  scatter is the instrument's noise. What the readings of a pose share is not in it; a scale that changes is.
- what is stated.

All as standard deviations of a scalar reading.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.noise.deviations import DRIFTS, Deviations, StandardDeviation
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import Solution
from rodgen.calibration.words import sized
from rodgen.data.poses import stretches
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.f_tests import f_tail
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.statistics.thresholds import DETERMINACY, NOISE
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel

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
    distance_drifts : tuple of str
        What the scale of these follows.
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
    distance_drifts: tuple[str, ...]
    stated: float | None
    one_body: bool = False

    _keys = (
        "value unit source replicates replicated_poses drifts with_drifts repeated "
        "distances distance_drifts stated one_body text"
    )

    @property
    def text(self) -> str:
        """The noise in sentences."""
        return " ".join(_sentences(self))


def noise_floor(fit: FittedModel) -> NoiseFloor:
    """Return the noise by every source.

    Parameters
    ----------
    fit : FittedModel
        Its residuals are looked at, so that what is modelled of time and temperature does not count as noise between
        replicates; outliers are left out.
    """
    repeated = replicates(fit)
    pure = repeated.noise(repeated.deviations)
    stated = None
    if fit.observations.sigma is not None:
        stated = float(np.sqrt(np.mean(fit.observations.sigma[~fit.outliers] ** 2)) / fit.unit_factor)
    distances, distance_drifts = _distances(fit)
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
        distance_drifts=distance_drifts,
        stated=stated,
        one_body=distances is not None and distances.value < NOISE.one_body * _least_error(fit, pure, stated),
    )


def _least_error(fit: FittedModel, replicates: StandardDeviation | None, stated: float | None) -> float:
    """Return the least figure for a reading's error: gross errors and wrong files enlarge the others."""
    typical = float(np.median(np.abs(fit.residuals[~fit.outliers]))) / HALF_OF_NORMAL
    return min([typical, *([replicates.value] if replicates else []), *([stated] if stated else [])])


# replicates ------------------------------------------------------------------------------------------------------


def replicates(fit: FittedModel, *, weighted: bool = False) -> Replicates:
    """Return how the residuals of equal commands differ.

    Parameters
    ----------
    fit : FittedModel
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


def _in_one_basis(fit: FittedModel, order: NDArray[np.int_], group: NDArray[np.int_]) -> Array:
    """Return residuals; those of directions along the basis of their group's first row, for near the pole it turns."""
    residuals: Array = fit.residuals[order]
    if not fit.machine.measurand.is_direction:
        return residuals
    left, above = (e[order] for e in fit.observations.basis)
    across = residuals[:, :1] * left + residuals[:, 1:] * above
    first = np.repeat(*stretches(group))
    return np.stack([np.einsum("ij,ij->i", across, e[first]) for e in (left, above)], axis=-1)


def _differing_parameters(fit: FittedModel) -> float:
    """Return how many fitted parameters may differ between replicates: those of time, temperature, velocity, run."""
    model, runs = fit.problem.model, len(fit.observations.run_names)
    count = 0.0
    for i in fit.free:
        slot = model.parameters[i].slot
        if slot[0] == "shift":
            count += (runs - 1) / runs  # what all runs share is the same for all replicates
        elif slot[0] == "e":
            kinds = {kind for _, (kind, _) in model.structure.terms[int(str(slot[1]))].columns}
            count += bool(kinds & {"t", "T", "v", "x"})
    return count


# distances -------------------------------------------------------------------------------------------------------


def _distances(fit: FittedModel) -> tuple[StandardDeviation | None, tuple[str, ...]]:
    """Return the noise by distances between targets in one pose, and what their scale follows."""
    o, measurand = fit.observations, fit.machine.measurand
    if not measurand.is_place or len(fit.machine.targets) < 2:
        return None, ()
    made = list(_pairs(fit))
    if not made:
        return None, ()
    group = np.concatenate([np.full(len(row), k) for k, (row, *_) in enumerate(made)])
    row, distance, variance = (np.concatenate([part[i] for part in made]) for i in range(3))
    weight = 1 / variance[:, None]
    lever = np.concatenate([np.full(len(part), part.mean()) for _, part, _ in made])
    deviations = Deviations.of(distance[:, None], weight, group, o.pose[row], group, row, lever)
    if deviations.count < 1:
        return None, ()
    left, drifts = deviations.without_drift(o.drivers(*DRIFTS))
    factor = 1 / fit.unit_factor
    if o.sigma is not None:
        factor *= float(np.sqrt(np.mean(o.sigma[row] ** 2)))
    return left.estimate(factor), tuple(drifts)


def _pairs(fit: FittedModel) -> Iterator[tuple[NDArray[np.int_], Array, Array]]:
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
    if floor.distance_drifts:
        said += f", when their scale, which follows {joined(floor.distance_drifts)}, is taken out"
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
    return ratio > NOISE.alike and f_tail(ratio**2, *dof) < NOISE.chance


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio < 1000 else "over 1000 times"


def _range(found: StandardDeviation, unit: str) -> str:
    factor, _ = readable(unit, found.value)
    return f"95 %: {found.low * factor:.3g} to {found.high * factor:.3g}"


# How much of the noise of poses is in their attitudes: the lever arm at which a turn is as uncertain as a place.


def estimated_arm(
    problem: Problem, solution: Solution, free: Sequence[int], kept: NDArray[np.bool_]
) -> float:
    """Return the ratio of the standard deviations of positions and attitudes, by their residuals; length unit.

    Parameters
    ----------
    problem : Problem
        Of poses.
    kept : ndarray of bool, shape (n,)
        Rows that are no outliers.

    Notes
    -----
    Each variance is a sum of squares by its own redundancy: the number of its residuals less the part of the parameters
    that they determine, the trace of J (JᵀJ)⁻¹ Jᵀ over them (Helmert 1907; Förstner 1979). Repeated until the ratio
    stays, this is the estimate of restricted maximum likelihood.
    """
    index = np.asarray(free, int)
    squares, grams = np.zeros(2), np.zeros((2, len(index), len(index)))
    residual = problem.residuals(solution.theta, solution.frame, weighted=True)
    with one_thread_in_blas():
        for rows, block in problem.jacobian_blocks(solution.theta, solution.frame):
            some = kept[rows]
            for k, of in enumerate((slice(0, 3), slice(3, 6))):
                flat = block[some][:, of, index].reshape(-1, len(index))
                grams[k] += flat.T @ flat
    squares = np.array([np.sum(residual[kept, of] ** 2) for of in (slice(0, 3), slice(3, 6))])
    scaled, scale = unit_diagonal(grams.sum(axis=0))
    values, vectors = eigh(scaled)
    seen = values > DETERMINACY.nothing**2 * values[-1] if len(values) else np.zeros(0, bool)
    along = vectors[:, seen] / scale[:, None]
    used = [np.sum(along * (gram @ along), axis=0) @ (1 / values[seen]) for gram in grams]
    freedom = 3 * np.count_nonzero(kept) - np.array(used)
    arm = problem.observations.arm
    rounding = _ROUNDING**2 * problem.scale
    if not (np.isfinite(squares).all() and freedom.min() > 1 and squares.min() > rounding):
        return arm
    (place, turn) = squares / freedom
    return float(arm * np.sqrt(place / turn))


_ROUNDING = 1e-12
"""Residuals below this part of the readings are rounding, whose ratio says nothing of the noise."""
