"""Rows that are wrong: those whose readings are likelier with an error of their own than with what else explains them.

A good row is predicted by all others: by the fitted parameters, by as many columns of candidates as pay for themselves,
and by the errors of the rows before and after it, in time and along each joint. Its error has the covariance of that
prediction, which is wide where only this row tells (leverage), and is normal or has heavier tails, those of Student's
t. An error of its own has any direction. Its size is that of other wrong rows, or on a logarithmic scale any (Jeffreys
1961, 3.1). That k of n rows are wrong, at a rate of which nothing is known, costs 2 ln C(n, k) + 2 ln(n + 1). The wrong
rows are those with which -2 ln of the probability of all errors is least.

They are found by expectation and maximization (Dempster, Laird and Rubin 1977) from two starts: all rows count, or
large errors hardly do. The end that costs less is believed. This takes no fit of the machine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.calibration.dependence import frame_motion
from rodgen.calibration.displaced_stretch import DisplacedStretch, stretch_of
from rodgen.calibration.positions import position_numbers
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import Solution
from rodgen.machines.observations import Observations
from rodgen.stages import stage
from rodgen.statistics.columns import inverse_root
from rodgen.statistics.decompositions import eigh

SIZES = 6 * math.log(10.0)
"""Logarithm of the ratio of the largest error to the noise: six decades, from a micron to a meter."""
TAILS = (8.0, 4.0, 2.0)
"""Degrees of freedom of Student's t that are tried for the errors of good rows, beside normal ones."""
STEPS = 30
"""Steps of expectation and maximization at most; they end where no weight changes."""
PATIENCE = 4
"""Rounds without a cheaper verdict after which the search ends: it then goes to and fro, or away."""
AROUND = 2
"""Good rows before, and after, in each order, whose mean error a row is compared with."""
RESTS = 0.75
"""Part of a straight line along a joint that rests on one position: without it the line is twice as uncertain there."""
BESIDE = 1000.0
"""Odds against chance from which wrong rows that follow each other are of one cause, and good."""
MOST_COLUMNS = 200
"""Columns of candidates, those that explain most alone, that may explain the residuals together."""
SEEN = 0.1
"""Part of a column of a candidate that the fitted parameters must not imitate."""


class RowsOfFit(Protocol):
    """What is asked of a fit."""

    @property
    def problem(self) -> Problem:
        """Of all its rows."""

    @property
    def solution(self) -> Solution:
        """Its values."""

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the parameters that were adjusted and are not at a bound."""

    def with_bodies(self, rows: Mask) -> Mask:
        """Return rows with the others of their poses where these were measured as one body."""


@stage("looking for outliers")
def wrong_rows(fit: RowsOfFit, columns: Array | None = None) -> Mask:
    """Return the rows of a fit, (n,), that are likelier to have an error of their own than to be good.

    Rows that follow each other, as a missing effect or a displaced stretch makes them, are none, nor are the only ones
    of a posture.

    Parameters
    ----------
    fit : Fit
        Whether or not it left rows out: all are judged.
    columns : ndarray, shape (n, m, K), optional
        Derivatives of the weighted residuals by what the model may miss.
    """
    with one_thread_in_blas():
        rows = Rows.of(fit, columns)
        found = wrong_in(rows)
        near = rows.following(found)
        if near.any() and (stretch := rows.stretch(found.wrong & ~near)) is not None:
            found = wrong_in(replace(rows, model=np.concatenate([rows.model, stretch.columns], axis=2)))
            near = rows.following(found)
        wrong = found.wrong & ~near
        if np.count_nonzero(near) > np.count_nonzero(wrong):  # what is missing displaces these, too
            wrong[:] = False
        return rows.without_sole_postures(fit.with_bodies(wrong))


def displaced_stretch(fit: RowsOfFit, wrong: Mask | None = None) -> DisplacedStretch | None:
    """Return the poses that follow each other and most probably lie displaced; None where that is improbable.

    Parameters
    ----------
    wrong : ndarray of bool, shape (n,), optional
        Rows that do not count.
    """
    with one_thread_in_blas():
        rows = Rows.of(fit)
        return rows.stretch(np.zeros(len(rows.residual), bool) if wrong is None else wrong)


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a linear model.

    Attributes
    ----------
    residual : ndarray, shape (n, m)
        Weighted.
    model : ndarray, shape (n, m, p)
        Columns of the fitted parameters.
    columns : ndarray, shape (n, m, K)
        What else may explain the residuals.
    motion : ndarray, shape (n, m, k)
        Columns of a motion of the frame.
    q : ndarray, shape (n, J)
        Coordinates of joints.
    pose : ndarray of int, shape (n,)
    orders : sequence of ndarray of int, each of shape (n,)
        The rows as they were measured, and as they follow each other along each joint.
    least : float
        Standard deviation of a reading at least: that which is stated, or rounding.
    """

    residual: Array
    model: Array
    columns: Array
    motion: Array
    q: Array
    pose: NDArray[np.int_]
    orders: Sequence[NDArray[np.int_]]
    least: float

    @classmethod
    def of(cls, fit: RowsOfFit, columns: Array | None = None) -> Rows:
        """Return all rows of a fit; see `wrong_rows`."""
        problem = Problem(fit.problem.model, fit.problem.observations)
        theta, frame, o = fit.solution.theta, fit.solution.frame, problem.observations
        residual = np.nan_to_num(problem.residuals(theta, frame, weighted=True), posinf=1e100, neginf=-1e100)
        largest = float(np.nanmax(np.abs(o.reading), initial=0.0) * np.max(problem.weight))
        return cls(
            residual,
            np.nan_to_num(problem.jacobian(theta, frame)[:, :, list(fit.moving)]),
            residual[:, :, None][:, :, :0] if columns is None else columns,
            frame_motion(problem.model, o, theta, frame, problem.weight),
            o.q,
            o.pose.astype(int),
            _orders(o),
            max(64 * np.finfo(float).eps * largest, 0.0 if o.sigma is None else 1.0, 1e-150),
        )

    def stretch(self, wrong: Mask) -> DisplacedStretch | None:
        """Return the displaced stretch; see `displaced_stretch`."""
        return stretch_of(self.residual, self.model, self.motion, self.pose, self.orders[0], wrong)

    def following(self, found: Verdict) -> Mask:
        """Return the wrong rows, (n,), whose poses follow each other in an order more than by chance.

        Of k wrong ones among n poses k (k - 1) / n follow another in the mean, and their errors have any direction.
        """
        numbers, of_row = np.unique(self.pose, return_inverse=True)
        error = np.zeros((len(numbers), found.error.shape[1]))
        np.add.at(error, of_row[found.wrong], found.error[found.wrong])
        length = np.linalg.norm(error, axis=1)
        wrong = length > 0
        unit = error / np.where(wrong, length, 1.0)[:, None]
        k, (n, m) = int(np.count_nonzero(wrong)), error.shape
        near = np.zeros(n, bool)
        for order in self.orders if k > 2 else ():
            _, first = np.unique(of_row[order], return_index=True)
            along = of_row[order][np.sort(first)]
            pair = np.flatnonzero(wrong[along[1:]] & wrong[along[:-1]])
            if not len(pair):
                continue
            one, other = along[pair], along[pair + 1]
            alike = max(float(np.sum(unit[one] * unit[other])), 0.0)
            cost = m * alike**2 / len(pair) - 2 * _log_poisson_tail(len(pair), k * (k - 1) / n)
            if cost > 2 * math.log(BESIDE * len(self.orders)):
                near[one] = near[other] = True
        return np.asarray(found.wrong & near[of_row])

    def without_sole_postures(self, wrong: Mask) -> Mask:
        """Return wrong rows, (n,), without those that are all at a position of a joint of which no others tell."""
        found = wrong.copy()
        for q in self.q.T if wrong.any() else ():
            if not np.ptp(q) > 0:
                continue
            position, away = position_numbers(q), (q - q.mean()) / np.std(q)
            count = np.bincount(position)
            rests = (count + np.bincount(position, away) ** 2 / count) / len(q)
            lost = np.bincount(position, wrong) == count
            found &= ~(lost & (rests > RESTS))[position]
        return found


def _orders(o: Observations) -> list[NDArray[np.int_]]:
    time = np.arange(o.n) if o.t is None else np.argsort(o.t, kind="stable")
    along = [time[np.argsort(q[time], kind="stable")] for q in o.q.T if o.n and np.ptp(q) > 0]
    return [time, *along]


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of rows as the others predict them, in the unit of a reading.

    Attributes
    ----------
    error : ndarray, shape (n, m)
    square : ndarray, shape (n,)
        By the covariance of the prediction, in units of the variance of a reading.
    wide : ndarray, shape (n,)
        Logarithm of the determinant of that covariance.
    dof : float
        Good readings less what was fitted to them.
    price : float
        What was fitted beside the parameters, in -2 ln of odds.
    """

    error: Array
    square: Array
    wide: Array
    dof: float
    price: float


@dataclass(frozen=True, eq=False)
class Verdict:
    """Which rows are wrong, (n,), what all rows cost, the weight of each in the next fit, (n,), and the errors."""

    wrong: Mask
    cost: float
    weight: Array
    error: Array


def wrong_in(rows: Rows) -> Verdict:
    """Return which rows of a linear model are likelier to have an error of their own."""
    n, m = rows.residual.shape
    none = Verdict(np.zeros(n, bool), 0.0, np.ones(n), rows.residual)
    search = _Search(rows)
    if n * m - search.p <= 2 * m or not rows.residual.any():
        return none
    every = np.ones(n)
    products = search.products(every)
    errors = search.errors(search.chosen(every, products, clip=True), every, products)
    sigma = max(0.9 * math.sqrt(float(np.median(errors.square)) / m), rows.least)
    good, wrong = _costs(errors, errors.dof, sigma, 0.0)
    if float(np.max(good - wrong)) < 2 * math.log(n):
        return none
    ends = [search.settled(start) for start in (None, search.robust())]
    return min(ends, key=lambda end: end.cost)


class _Search:
    """The search for wrong rows: what explains the others, given these, and so on."""

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self.n, self.m = rows.residual.shape
        self.N = self.n * self.m
        flat = rows.model.reshape(self.N, -1)
        base = flat @ inverse_root(flat.T @ flat, relative=1e-14)
        base = base @ inverse_root(base.T @ base)
        self.p, self.y = base.shape[1], rows.residual.ravel()
        self.y = self.y - base @ (base.T @ self.y)
        columns = self._promising(base)
        self.X = np.concatenate([base, columns], axis=1)
        self.price = 2 * math.log(max(rows.columns.shape[2], 1)) + math.log(self.N)
        self.most = max(self.N // 4 - self.p, 0)

    def _clipped(self, left: Array) -> Array:
        """Return errors, (N,), none much larger than most: else the columns would be chosen that follow these."""
        left = left.reshape(self.n, self.m)
        size = np.linalg.norm(left, axis=1)
        return np.ravel(left * np.minimum(1, 3 * np.median(size) / np.maximum(size, 1e-300))[:, None])

    def _promising(self, base: Array) -> Array:
        """Return what candidates' columns are beyond the model, at length 1, (N, K), those that explain most alone."""
        flat = self.rows.columns.reshape(self.N, -1)
        along = base.T @ flat
        square, pull = np.einsum("ij,ij->j", flat, flat), self._clipped(self.y) @ flat
        beyond = square - np.einsum("ij,ij->j", along, along)
        seen = np.flatnonzero(beyond > SEEN**2 * square)
        best = seen[np.argsort(-(pull[seen] ** 2) / beyond[seen], kind="stable")[:MOST_COLUMNS]]
        return np.asarray((flat[:, best] - base @ along[:, best]) / np.sqrt(beyond[best]))

    def robust(self) -> Array:
        """Return weights by which large errors hardly count, (n,): those of a Cauchy distribution."""
        weight = np.ones(self.n)
        for _ in range(STEPS):
            left = self._fit([*range(self.p)], weight, self.products(weight))[0]
            size = np.einsum("nm,nm->n", left, left)
            new = 1 / (1 + size / max(float(np.median(size)), 1e-300))
            if np.max(np.abs(new - weight)) < 1e-2:
                break
            weight = new
        return weight

    def settled(self, weight: Array | None) -> Verdict:
        """Return the verdict on rows from a start; without weights all rows count, but clipped."""
        clip = weight is None
        weight = np.ones(self.n) if weight is None else weight
        best: Verdict | None = None
        since = 0
        for _ in range(STEPS):
            products = self.products(weight)
            found = self.judged(self.errors(self.chosen(weight, products, clip), weight, products))
            if np.max(np.abs(found.weight - weight)) < 1e-2:
                return found
            since += 1
            if best is None or found.cost < best.cost:
                best, since = found, 0
            if since == PATIENCE:
                break
            weight, clip = found.weight, False
        return best or found

    def products(self, weight: Array) -> Array:
        """Return XᵀWX."""
        return np.asarray((self.X * np.repeat(weight, self.m)[:, None]).T @ self.X)

    def chosen(self, weight: Array, products: Array, clip: bool) -> list[int]:
        """Return columns that pay for themselves, one after the other; by errors of which none is much larger."""
        w, p = np.repeat(weight, self.m), self.p
        found = list[int]()
        dof = float(np.sum(w)) - p
        while len(found) < min(self.most, self.X.shape[1] - p, dof - 2):
            index = [*range(p), *found]
            root = inverse_root(products[np.ix_(index, index)], relative=1e-14)
            left = self.y - self.X[:, index] @ (root @ (root.T @ (self.X[:, index].T @ (w * self.y))))
            left = self._clipped(left) if clip else left
            pull, across = self.X.T @ (w * left), root.T @ products[index]
            along = root.T @ pull[index]
            square = products.diagonal() - np.einsum("ij,ij->j", across, across)
            seen = square > SEEN**2 * products.diagonal()
            falls = np.where(seen, (pull - across.T @ along) ** 2 / np.where(seen, square, 1.0), 0.0)
            falls[index] = 0.0
            best, total = int(np.argmax(falls)), float(np.sum(w * left**2) - along @ along)
            rest = max(total - float(falls[best]), 1e-300)
            if total <= 0 or (dof - len(found)) * math.log(total / rest) < self.price:
                break
            found.append(best)
        return found

    def _fit(self, index: Sequence[int], weight: Array, products: Array) -> tuple[Array, Array]:
        """Return what a weighted fit of some columns leaves, (n, m), and the covariance of its rows, (n, m, m)."""
        half = self.X[:, index] @ inverse_root(products[np.ix_(index, index)], relative=1e-14)
        left = self.y - half @ (half.T @ (np.repeat(weight, self.m) * self.y))
        of_rows = half.reshape(self.n, self.m, half.shape[1])
        return left.reshape(self.n, self.m), of_rows @ of_rows.transpose(0, 2, 1)

    def errors(self, chosen: Sequence[int], weight: Array, products: Array) -> Errors:
        """Return the errors of rows as the others predict them, with some of the candidates' columns."""
        index = [*range(self.p), *chosen]
        left, spread = self._fit(index, weight, products)
        left, price = self._beside_neighbours(left, weight)
        h, vectors = eigh(spread)
        rest = np.clip(1 - weight[:, None] * h, 1e-9, None)
        wider = 1 + np.maximum(1 - weight[:, None], 0.0) * h
        along = np.einsum("nji,nj->ni", vectors, left)
        return Errors(
            np.einsum("nji,ni->nj", vectors, along / rest),
            np.sum(along**2 / (rest * wider), axis=1),
            np.sum(np.log(wider / rest), axis=1),
            max(self.m * float(weight.sum()) - len(index), 1.0),
            len(chosen) * self.price + price,
        )

    def _beside_neighbours(self, left: Array, weight: Array) -> tuple[Array, float]:
        """Return what the mean errors of neighbours do not predict of errors, (n, m), and what that costs.

        Neighbours in one order after the other are asked, as long as that pays.
        """
        good, price, orders = weight > 0.5, 0.0, list(self.rows.orders)
        w, dof = weight[:, None], float(weight.sum()) * self.m
        cost = math.log(max(dof, 1.0)) + 2 * math.log(max(len(orders), 1))
        total = float(np.sum(w * left**2))
        while orders and np.count_nonzero(good) > 4 * AROUND:
            means = [_mean_around(left, good, order) for order in orders]
            parts = [max(float(np.sum(w * x * left) / max(np.sum(w * x**2), 1e-300)), 0.0) for x in means]
            rests = [float(np.sum(w * (left - a * x) ** 2)) for a, x in zip(parts, means, strict=True)]
            k = int(np.argmin(rests))
            if dof * math.log(max(total, 1e-300) / max(rests[k], 1e-300)) <= cost:
                break
            left, total, price = left - parts[k] * means[k], rests[k], price + cost
            orders.pop(k)
        return left, price

    def judged(self, errors: Errors) -> Verdict:
        """Return which rows are wrong, with the tails of good rows that cost least."""
        tails = [errors.dof, *(nu for nu in TAILS if nu < errors.dof / 2)]
        return min((self._with_tails(errors, nu) for nu in tails), key=lambda one: one.cost)

    def _with_tails(self, errors: Errors, nu: float) -> Verdict:
        n, m = errors.error.shape
        sigma = max(math.sqrt(float(np.median(errors.square)) / m), self.rows.least)
        length, rate, spread = np.einsum("nm,nm->n", errors.error, errors.error), 0.1, 0.0
        for _ in range(STEPS):
            good, wrong = _costs(errors, nu, sigma, spread)
            odds = np.exp(np.clip((good - wrong) / 2, -300, 300)) * rate / (1 - rate)
            believed = 1 / (1 + odds)
            tail = (nu + m) / (nu + errors.square / sigma**2)
            lost = max(n - float(believed.sum()), 1e-300)
            before, rate = sigma, (lost + 0.5) / (n + 1)
            sigma = math.sqrt(
                float(np.sum(believed * tail * errors.square)) / max(m * float(believed.sum()), 1e-300)
            )
            sigma, spread = max(sigma, self.rows.least), float(np.sum((1 - believed) * length)) / (m * lost)
            if abs(sigma - before) < 1e-4 * sigma:
                break
        cost, mask = min(_cheapest(errors, nu, sigma, spread), key=lambda one: one[0])
        cost += errors.price + 2 * math.log(1 + len(TAILS))
        return Verdict(mask, cost, np.minimum(believed * tail, 1.0), errors.error)


def _cheapest(errors: Errors, nu: float, sigma: float, spread: float) -> Iterator[tuple[float, Mask]]:
    """Yield what all rows cost with the wrong ones that cost least, and these: of any size, or of one that is learned.

    What is learned of k m numbers, on a logarithmic scale, costs as much as one of √(k m) sizes in each unit.
    """
    n, m = errors.error.shape
    k = np.arange(n // 2 + 1)
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, n + 1)))])
    ways = 2 * (logs[n] - logs[k] - logs[n - k] + math.log(n + 1))
    learned = np.where(k > 0, 2 * math.log(SIZES) + np.log(np.maximum(k * m, 1)), 0.0)
    for width, price in ((0.0, 0.0), (spread, learned)):
        good, wrong = _costs(errors, nu, sigma, width)
        order = np.argsort(wrong - good, kind="stable")
        costs = np.concatenate([[0.0], np.cumsum((wrong - good)[order])])[: len(k)] + ways + price
        count = int(np.argmin(costs))
        mask = np.zeros(n, bool)
        mask[order[:count]] = True
        yield float(good.sum() + costs[count]), mask


def _costs(errors: Errors, nu: float, sigma: float, spread: float) -> tuple[Array, Array]:
    """Return -2 ln of the probability density of each row's error if it is good, and if it is wrong, (n,).

    Parameters
    ----------
    nu : float
        Degrees of freedom of the errors of good rows.
    sigma : float
        Standard deviation of a reading of these.
    spread : float
        Variance of a reading of wrong rows; 0 where none is known.
    """
    m = errors.error.shape[1]
    scale = math.lgamma((nu + m) / 2) - math.lgamma(nu / 2) - m / 2 * math.log(nu * math.pi * sigma**2)
    good = (nu + m) * np.log1p(errors.square / (nu * sigma**2)) + errors.wide - 2 * scale
    surface = math.log(2.0) + m / 2 * math.log(math.pi) - math.lgamma(m / 2)
    length = np.maximum(np.einsum("nm,nm->n", errors.error, errors.error), m * sigma**2)
    wrong = m * np.log(length) + 2 * (surface + math.log(SIZES))
    if spread > sigma**2:
        wrong = np.minimum(wrong, length / spread + m * math.log(2 * math.pi * spread)) + 2 * math.log(2.0)
    return good, wrong


def _mean_around(left: Array, good: Mask, order: NDArray[np.int_]) -> Array:
    """Return the mean error of the good rows before and after each row in an order, (n, m)."""
    there = good[order]
    others = left[order[there]]
    padded = np.concatenate(
        [np.repeat(others[:1], AROUND, axis=0), others, np.repeat(others[-1:], AROUND, axis=0)]
    )
    ends = len(padded) + 1 - AROUND
    sums = padded[:ends].copy()  # of so many rows from each one on
    for step in range(1, AROUND):
        sums += padded[step : ends + step]
    after = np.cumsum(there)  # not itself
    found = np.empty_like(left)
    found[order] = (sums[after - there] + sums[np.minimum(after, len(others)) + AROUND]) / (2 * AROUND)
    return found


def _log_poisson_tail(least: int, mean: float) -> float:
    """Return the logarithm of the probability that a Poisson variable is so large."""
    if mean <= 0:
        return 0.0 if least <= 0 else math.log(1e-300)
    last = least + int(mean + 40 * math.sqrt(mean)) + 100
    logs = [k * math.log(mean) - mean - math.lgamma(k + 1) for k in range(max(least, 0), last)]
    return min(max(float(np.logaddexp.reduce(logs)), math.log(1e-300)), 0.0)
