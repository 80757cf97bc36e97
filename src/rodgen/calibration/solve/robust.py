"""A fit that gross errors do not pull, and the rows that they are in.

The size z of a row is the root of the sum of its squared residuals, in units of the stated noise (or of 1). Of a good
row with m residuals z/s is chi-distributed with m degrees of freedom. The scale s is the noise where none is stated;
where it is, 1, or the scatter of the rows if that is more, so that what a model misses does not make outliers of many.

1. Start: Huber's weights min(1, k s/z) (Huber 1964) bring the fit from least squares to where most rows agree, unless
   rows far out in their commands hold it; so fits of a few random rows are tried, too (Rousseeuw 1984), and those that
   bring the better half of the rows nearest are improved on that half (Rousseeuw and Van Driessen 2006).
2. Scale: from the median, then from the rows inside the cut that it makes, until it stays.
3. Rows beyond the cut are left out, the others get full weight, until nothing changes. At a given scale s and cut c
   every step lowers the robust cost Σ min(z², c²s²), so that more freedom, started from less, never ends higher.

The rest is least squares of the rows that are believed: covariances, chi-squares and tests are theirs. The cut is
the size which the largest of all good rows exceeds in one of 100 data sets; and that the outliers, as many as they are,
should be the worst of good rows must be as improbable. So good data have none in about 99 of 100 sets. A row that is
left out is judged by the variance of its prediction, too: rows that alone determine something are not called wrong.

Limits: more than half of the rows must be good, and not agree less than the bad ones do. Up to 30 % of gross errors
in readings or in commands do no harm to machines from one joint to six (tests). Rows far out in their commands that
agree with each other can win where there are so many parameters that no random set is free of them. Moderate errors,
below the cut, keep their weight. What a model misses in few rows, much more than elsewhere, looks like outliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.blocks import BlockProblem
from rodgen.calibration.solve.least_squares import Solution, minimise, minimise_each
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.f_tests import f_tail
from rodgen.statistics.robust import HUBER, huber_weight, median_factor
from rodgen.statistics.thresholds import NEGLIGIBLE_WEIGHT, ROBUST

MOST_SETS = 100
"""Random sets that are tried at most."""

__all__ = ["Judgement", "robust_fit"]

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

SAMPLE = 2000
"""Rows on which starts are compared: their median is good to 2 %."""
SPARE_ROWS = 2
"""Rows in a random set beyond those that a fit needs: more determine it better, fewer are more often good."""
NEARLY = 0.8
"""Part of the cut from which rows of a scan are looked at one by one: with all rows the cut may be so much lower."""
HUBER_STEPS, HALVES, BEST_SETS, SETTLED = 20, 6, 3, 50


@dataclass(frozen=True)
class Judgement:
    """A fit, and which rows it believes.

    Attributes
    ----------
    solution : Solution
        Its cost is that of the believed rows.
    free : tuple of int
        Numbers of the parameters that were adjusted.
    outliers : ndarray of bool, shape (n,)
    scale : float
        s, in units of the stated noise, or of a residual.
    cut : float
        z/s from which a row is an outlier.
    cost : float
        Σ min(z², c²s²) over all rows.
    """

    solution: Solution
    free: tuple[int, ...]
    outliers: Mask
    scale: float
    cut: float
    cost: float


def robust_fit(problem: Problem, solve: Callable[[], tuple[Solution, list[int]]]) -> Judgement:
    """Fit, and find the rows that are not to be believed.

    Parameters
    ----------
    problem : Problem
        Its weights are changed: in the end outliers have none.
    solve : callable
        Fits with the weights that the problem has.
    """
    problem.set_weight(np.ones(problem.rows))
    solution, free = solve()
    search = _OutlierSearch(problem, free)
    if not search.enough_rows:
        return search.judgement(solution, math.inf, math.inf)
    solution, scale = search.settled(search.start(solution))
    # What is searched, and what is taken in where the data call for it, is found again without the outliers.
    problem.leave_out(search.sizes(solution) > search.cut * scale)
    solution, free = solve()
    search = _OutlierSearch(problem, free)
    solution, scale = search.settled(solution)
    best = search.judgement(solution, scale, search.cut)
    for other in search.others(best):
        solution, _ = search.settled(other, scale)
        found = search.judgement(solution, scale, search.cut)
        best = min(best, found, key=lambda j: j.cost)
    best = search.confirmed(best)
    problem.leave_out(best.outliers)
    return best


def robust_fit_of_parts(
    problem: BlockProblem, solve: Callable[[Problem], tuple[Solution, list[int]]]
) -> tuple[BlockProblem, Judgement]:
    """Fit all rows of a scan, and find those that are not to be believed; see `robust_fit`.

    Where the search ends on the sample, one on all rows begins: all that are nearly beyond the cut are added to the
    sample, and judged there, while the others stay in the sums.

    Returns
    -------
    problem
        Of the sample with these rows; outliers have no weight in its sums.
    """
    sample = Problem(problem.model, problem.observations)
    found = robust_fit(sample, partial(solve, sample))
    free = found.free
    search = _OutlierSearch(problem, free)
    solution, scale = found.solution, found.scale
    if not math.isfinite(scale):  # good rows of the sample could differ as much by chance
        scale = search.rough_scale(search.sizes(solution))
    limit = NEARLY * search.cut * scale
    place = solution.theta, solution.frame
    observations = problem.blocks.with_rows_beyond(problem.observations, problem.model, place, limit)
    problem = BlockProblem(problem.model, observations)
    search = _OutlierSearch(problem, free)
    outliers, scale = search.beyond(solution, scale)
    for _ in range(SETTLED):
        solution = minimise(problem, solution.theta, solution.frame, free)
        before = outliers
        outliers, scale = search.beyond(solution, scale)
        if np.array_equal(outliers, before):
            break
    best = search.confirmed(Judgement(solution, free, outliers, scale, search.cut, math.inf))
    problem.leave_out(best.outliers)
    return problem, best


class _OutlierSearch:
    """The search for the rows that do not agree with a fit of some parameters."""

    def __init__(self, problem: Problem, free: Sequence[int]) -> None:
        self.problem, self.free = problem, list(free)
        self.m, self.n, self.p = problem.components, problem.count, len(free)
        self.stated = problem.observations.sigma is not None
        # Exact data leave rounding, of which none is an outlier.
        reading = problem.observations.reading
        self.rounding = 64 * np.finfo(float).eps * float(np.max(np.abs(reading), initial=0.0))
        residual_dof = self.m * self.n - self.p
        self.enough_rows = self.n > 2 and residual_dof > self.m
        self.half = min((self.n + math.ceil(self.p / self.m) + 1) // 2, self.n)
        self.cut = self._cut(residual_dof) if self.enough_rows else math.inf

    def _cut(self, residual_dof: int) -> float:
        from scipy import special

        chance = ROBUST.false_alarm / self.n
        if self.stated:
            return float(np.sqrt(special.chdtri(self.m, chance)))
        return float(np.sqrt(self.m * special.fdtri(self.m, residual_dof, 1 - chance)))

    def sizes(self, solution: Solution) -> Array:
        """Return z of each row."""
        residuals = self.problem.residuals(solution.theta, solution.frame) * self.problem.base_weight
        size = np.sqrt(np.einsum("ij,ij->i", residuals, residuals))
        return np.where(np.isfinite(size), size, np.inf)

    # scale ---------------------------------------------------------------------------------------------------

    def scale(self, size: Array) -> float:
        """Return s: of the rows inside the cut, which the scale itself makes."""
        scale = self.rough_scale(size)
        for _ in range(SETTLED):
            inside = size <= self.cut * scale
            residual_dof = self.m * int(inside.sum()) - self.p
            if residual_dof <= 0:
                break
            new = self._at_least(math.sqrt(float(np.sum(size[inside] ** 2)) / residual_dof))
            if new == scale:
                break
            scale = new
        return scale

    def rough_scale(self, size: Array) -> float:
        """Return s from the median; rather too large in small samples."""
        from scipy import special

        factor = median_factor(len(size) - self.p / self.m)
        return self._at_least(float(np.median(size)) / math.sqrt(special.chdtri(self.m, 0.5)) * factor)

    def _at_least(self, scale: float) -> float:
        return max(scale, 1.0) if self.stated else max(scale, self.rounding)

    def beyond(self, solution: Solution, scale: float) -> tuple[Mask, float]:
        """Return the rows beyond the cut of those that are looked at, and s of all others, where most are not."""
        size = self.sizes(solution)
        for _ in range(SETTLED):
            outliers = size > self.cut * scale
            self.problem.leave_out(outliers)
            cost = self.problem.cost(solution.theta, solution.frame)
            new = self._at_least(math.sqrt(cost / (self.m * (self.n - int(outliers.sum())) - self.p)))
            if np.array_equal(size > self.cut * new, outliers):
                return outliers, new
            scale = new
        return outliers, scale

    # from a start to rows that agree -------------------------------------------------------------------------

    def settled(self, solution: Solution, scale: float | None = None) -> tuple[Solution, float]:
        """Fit the rows inside the cut until these stay the same; at a given scale, or finding it, too."""
        before, found = np.zeros(self.n, bool), scale or math.inf
        for step in range(SETTLED):
            size = self.sizes(solution)
            # half way the scale is held, so that there is an end
            if scale is None and step < SETTLED // 2:
                found = self.scale(size)
            inside = size <= self.cut * found
            if np.array_equal(inside, before):
                break
            before = inside
            self.problem.leave_out(~inside)
            solution = minimise(self.problem, solution.theta, solution.frame, self.free)
        return solution, found

    def judgement(self, solution: Solution, scale: float, cut: float) -> Judgement:
        """Return a verdict on all rows."""
        size = self.sizes(solution)
        outliers = size > cut * scale
        if self.problem.rows < self.problem.count:  # what is seen here is not all of the cost
            return Judgement(solution, tuple(self.free), outliers, scale, cut, math.inf)
        limit = (cut * scale) ** 2
        cost = float(np.sum(np.minimum(size**2, limit)))
        solution = replace(solution, cost=float(np.sum(size[~outliers] ** 2)))
        return Judgement(solution, tuple(self.free), outliers, scale, cut, cost)

    def others(self, best: Judgement) -> Iterator[Solution]:
        """Yield other starts: with rows that are only badly predicted, and from the values the machine came with."""
        rows = self._badly_predicted(best)
        if rows.any():
            self.problem.leave_out(best.outliers & ~rows)
            yield minimise(self.problem, best.solution.theta, best.solution.frame, self.free)
        given = self.problem.model.machine.values
        if given:
            model = self.problem.model
            frame = [i for i in self.free if model.parameters[i].slot[0] == "frame"]
            self.problem.leave_out(best.outliers)
            yield minimise(self.problem, model.start(), best.solution.frame, frame)

    def confirmed(self, best: Judgement) -> Judgement:
        """Return a judgement, or one without outliers where good rows could differ as much by chance."""
        if not best.outliers.any():
            return best
        self.problem.leave_out(np.zeros(self.problem.rows, bool))
        every = minimise(self.problem, best.solution.theta, best.solution.frame, self.free)
        return self.judgement(every, math.inf, math.inf) if self._may_be_chance(best, every) else best

    def _may_be_chance(self, best: Judgement, every: Solution) -> bool:
        """Return whether good rows, too, could differ so much; `every` is the fit of all rows.

        Of the rows of a small data set the best few may agree very well by chance. So the fall of the cost, with as
        many degrees of freedom as the outliers have, must be improbable over all ways to choose as many rows.
        """
        from scipy import special

        k = int(best.outliers.sum())
        gone, residual_dof = self.m * k, self.m * (self.n - k) - self.p
        if residual_dof < 1:
            return True
        fall = (every.cost - best.solution.cost) / gone
        if self.stated:
            p = float(special.chdtrc(gone, gone * fall / best.scale**2))
        else:
            variance = max(best.solution.cost / residual_dof, self.rounding**2)
            p = f_tail(fall / variance, gone, residual_dof)
        ways = special.gammaln(self.n + 1) - special.gammaln(k + 1) - special.gammaln(self.n - k + 1)
        return p > 0 and math.log(p) + ways > math.log(ROBUST.false_alarm)

    def _badly_predicted(self, best: Judgement) -> Mask:
        """Return the outliers whose size is expected: a fit to the others predicts them badly."""
        found = np.zeros(self.n, bool)
        rows = np.flatnonzero(best.outliers)
        if not len(rows) or not self.free:
            return found
        self.problem.leave_out(best.outliers)
        solution, index = best.solution, np.asarray(self.free, int)
        _, square, _ = self.problem.normal_equations(solution.theta, solution.frame)
        scaled, scale = unit_diagonal(square[np.ix_(index, index)])
        values, vectors = eigh(scaled)
        # A direction that the others do not determine predicts nothing, whatever the row's part along it.
        values = np.maximum(values, np.finfo(float).eps * values[-1])
        root = vectors / np.sqrt(values) / scale[:, None]
        self.problem.set_weight(np.ones(self.n))
        jacobian = self._jacobian(solution, rows)[:, :, index] @ root
        residual = (
            self.problem.residuals(solution.theta, solution.frame)[rows] * self.problem.base_weight[rows]
        )
        variance = np.eye(self.m) + jacobian @ np.swapaxes(jacobian, 1, 2)
        size = np.einsum("ij,ij->i", residual, np.linalg.solve(variance, residual[..., None])[..., 0])
        found[rows] = size <= (best.cut * best.scale) ** 2
        return found

    def _jacobian(self, solution: Solution, rows: NDArray[np.int_]) -> Array:
        part = Problem(self.problem.model, self.problem.observations.take(rows))
        return part.jacobian(solution.theta, solution.frame)

    # start ---------------------------------------------------------------------------------------------------

    def start(self, solution: Solution) -> Solution:
        """Return the best of several starts, found on some of the rows."""
        random = np.random.default_rng(0)
        problem = self.problem
        if self.n > SAMPLE:
            rows = np.sort(random.choice(self.n, SAMPLE, replace=False))
            problem = Problem(problem.model, problem.observations.take(rows))
        search = _OutlierSearch(problem, self.free)
        tried = [solution, search._by_huber(solution), *search._by_sets(solution, random)]
        tried.sort(key=search._better_half)
        return min(map(search._on_better_half, tried[:BEST_SETS]), key=search._better_half)

    def _by_huber(self, solution: Solution) -> Solution:
        k = HUBER[self.m]
        for _ in range(HUBER_STEPS):
            size = self.sizes(solution)
            weight = huber_weight(size, k * self.rough_scale(size))
            self.problem.set_weight(np.sqrt(np.maximum(weight, NEGLIGIBLE_WEIGHT)))
            new = minimise(
                self.problem, solution.theta, solution.frame, self.free, max_iterations=3, final=False
            )
            if np.allclose(self.sizes(new), size, rtol=0.01):
                return new
            solution = new
        return solution

    def _by_sets(self, solution: Solution, random: np.random.Generator) -> list[Solution]:
        needed = math.ceil(self.p / self.m) + SPARE_ROWS
        if needed >= self.n:
            return []
        sets = min(math.ceil(math.log(ROBUST.miss) / math.log1p(-((1 - ROBUST.bad) ** needed))), MOST_SETS)
        parts = []
        for _ in range(sets):
            rows = np.sort(random.choice(self.n, needed, replace=False))
            parts.append(Problem(self.problem.model, self.problem.observations.take(rows)))
        return minimise_each(parts, solution.theta, solution.frame, self.free, max_iterations=15)

    def _better_half(self, solution: Solution) -> float:
        """Return the sum of squares of the better half of the rows."""
        return float(np.sum(np.partition(self.sizes(solution), self.half - 1)[: self.half] ** 2))

    def _on_better_half(self, solution: Solution) -> Solution:
        for _ in range(HALVES):
            size = self.sizes(solution)
            self.problem.leave_out(size > np.partition(size, self.half - 1)[self.half - 1])
            solution = minimise(
                self.problem, solution.theta, solution.frame, self.free, max_iterations=5, final=False
            )
        return solution
