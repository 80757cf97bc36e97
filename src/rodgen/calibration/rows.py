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
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.dependence import frame_motion
from rodgen.calibration.displaced_stretch import DisplacedStretch, stretch_of
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.data.poses import positions
from rodgen.machines.mounts import mount_of
from rodgen.machines.observations import Observations
from rodgen.stages import stage
from rodgen.statistics.columns import inverse_root, orthonormalizing
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
BLOCK = 20_000
"""Rows whose columns are in memory at once where there are more."""


@stage("looking for outliers")
def wrong_rows(fit: Fit, rows: Rows | None = None) -> Mask:
    """Return the rows of a fit, (n,), that are likelier to have an error of their own than to be good.

    Rows that follow each other, as a missing effect or a displaced stretch makes them, are none, nor are the only ones
    of a posture.

    Parameters
    ----------
    fit : Fit
        Whether or not it left rows out: all are judged.
    rows : Rows, optional
        The rows that are judged; left out: all.
    """
    with one_thread_in_blas():
        rows = Rows.of(fit) if rows is None else rows
        verdict = wrong_in(rows)
        near = rows.following(verdict)
        if near.any() and (stretch := rows.stretch(verdict.wrong & ~near)) is not None:
            verdict = wrong_in(replace(rows, model=np.concatenate([rows.model, stretch.columns], axis=2)))
            near = rows.following(verdict)
        wrong = verdict.wrong & ~near
        if np.count_nonzero(near) > np.count_nonzero(wrong):  # what is missing displaces these, too
            wrong &= _beyond(verdict, near)
        if rows.numbers is None:
            return rows.without_sole_postures(fit.with_bodies(wrong))
        whole = np.zeros(fit.problem.observations.n, bool)
        whole[rows.numbers] = wrong
        whole = fit.with_bodies(whole)
        whole[rows.numbers] = rows.without_sole_postures(whole[rows.numbers])
        return whole


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
    numbers : ndarray of int, shape (n,), or None
        Of the rows among those of the fit; None of all.
    of_targets : ndarray of bool, shape (p,), or None
        Which of the fitted parameters belong to targets that may have been mounted anew; none on a mount.
    """

    residual: Array
    model: Array
    columns: Array
    motion: Array
    q: Array
    pose: NDArray[np.int_]
    orders: Sequence[NDArray[np.int_]]
    least: float
    numbers: Ints | None = None
    of_targets: Mask | None = None

    @classmethod
    def of(cls, fit: Fit, columns: Array | None = None, some: Ints | None = None) -> Rows:
        """Return all rows of a fit, or some, with derivatives of the weighted residuals by what the model may miss."""
        o = fit.problem.observations
        problem = Problem(fit.problem.model, o if some is None or len(some) == o.n else o.take(some))
        theta, frame, o = fit.solution.theta, fit.solution.frame, problem.observations
        residual = np.nan_to_num(problem.residuals(theta, frame, weighted=True), posinf=1e100, neginf=-1e100)
        largest = float(np.nanmax(np.abs(o.reading), initial=0.0) * np.max(problem.weight))
        moving, on_sky = list(fit.moving), mount_of(fit.machine) is not None
        model = np.zeros((*residual.shape, len(moving)))
        for rows, block in problem.jacobian_blocks(theta, frame):
            model[rows] = np.take(block, moving, axis=2)
        return cls(
            residual,
            model if np.isfinite(np.vdot(model, model)) else np.nan_to_num(model),
            residual[:, :, None][:, :, :0] if columns is None else columns,
            frame_motion(problem.model, o, theta, frame, problem.weight),
            o.q,
            o.pose.astype(int),
            _orders(o),
            max(64 * np.finfo(float).eps * largest, 0.0 if o.sigma is None else 1.0, 1e-150),
            some,
            np.array([not on_sky and fit.parameters[i].key.startswith("target.") for i in moving], bool),
        )

    def stretch(self, wrong: Mask) -> DisplacedStretch | None:
        """Return the poses that follow each other and most probably lie displaced; None where that is improbable.

        Parameters
        ----------
        wrong : ndarray of bool, shape (n,)
            Rows that do not count.
        """
        motions = [self.motion, *([] if self.of_targets is None else [self.model[:, :, self.of_targets]])]
        with one_thread_in_blas():
            candidates = [
                None if one is None else replace(one, of_target=k > 0)
                for k, motion in enumerate(motions)
                if motion.shape[2]
                for one in [stretch_of(self.residual, self.model, motion, self.pose, self.orders[0], wrong)]
            ]
        best = max(filter(None, candidates), key=lambda one: one.gain, default=None)
        # a frame that moves slowly wanders
        return None if best is not None and best.creeps and not best.of_target else best

    def following(self, verdict: Verdict) -> Mask:
        """Return the wrong rows, (n,), whose poses follow each other in an order more than by chance.

        Of k wrong ones among n poses k (k - 1) / n follow another in the mean, and their errors have any direction.
        """
        from scipy import special

        numbers, of_row = np.unique(self.pose, return_inverse=True)
        error = np.zeros((len(numbers), verdict.error.shape[1]))
        np.add.at(error, of_row[verdict.wrong], verdict.error[verdict.wrong])
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
            one, next_row = along[pair], along[pair + 1]
            alike = max(float(np.sum(unit[one] * unit[next_row])), 0.0)
            chance = float(special.pdtrc(len(pair) - 1, k * (k - 1) / n))
            cost = m * alike**2 / len(pair) - 2 * math.log(max(chance, 1e-300))
            if cost > 2 * math.log(BESIDE * len(self.orders)):
                near[one] = near[next_row] = True
        followed = np.asarray(verdict.wrong & near[of_row])
        return followed & ~_beyond(verdict, followed)

    def without_sole_postures(self, wrong: Mask) -> Mask:
        """Return wrong rows, (n,), without those that are all at a position of a joint of which no others tell."""
        remaining = wrong.copy()
        for q in self.q.T if wrong.any() else ():
            if not np.ptp(q) > 0:
                continue
            position, away = positions(q), (q - q.mean()) / np.std(q)
            count = np.bincount(position)
            rests = (count + np.bincount(position, away) ** 2 / count) / len(q)
            lost = np.bincount(position, wrong) == count
            remaining &= ~(lost & (rests > RESTS))[position]
        return remaining


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
        What was fitted in addition to the parameters, in -2 ln of odds.
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


def wrong_in(rows: Rows, *, many: bool = False) -> Verdict:
    """Return which rows of a linear model are likelier to have an error of their own.

    Parameters
    ----------
    rows : Rows
    many : bool
        Whether so many may be wrong that none stands out from a fit of all.
    """
    n, m = rows.residual.shape
    none = Verdict(np.zeros(n, bool), 0.0, np.ones(n), rows.residual)
    search = _Search(rows)
    if n * m - search.p <= 2 * m or not rows.residual.any():
        return none
    every = np.ones(n)
    products = search.products(every)
    errors = search.errors(search.chosen(every, products, clip=True), every, products)
    # the median of chi-square (Wilson and Hilferty 1931), less its standard error
    middle = float(np.median(errors.square)) / (m * (1 - 2 / (9 * m)) ** 3)
    sigma = max((1 - 1 / math.sqrt(n)) * math.sqrt(middle), rows.least)
    if not many and not next(_cheapest(errors, errors.dof, sigma, 0.0))[1].any():
        return none
    ends = [search.settled(start) for start in (None, search.robust())]
    return min(ends, key=lambda end: end.cost)


def _beyond(verdict: Verdict, near: Mask) -> Mask:
    """Return the rows, (n,), whose errors are larger than what displaces others makes them, but for chance."""
    n, m = verdict.error.shape
    square = np.einsum("nm,nm->n", verdict.error, verdict.error)
    usual = float(np.sum(square[near])) / max(int(np.count_nonzero(near)), 1)
    return np.asarray(m * square > 2 * math.log(BESIDE * n) * usual)


class _Search:
    """The search for wrong rows: what explains the others, given these, and so on.

    The columns X are those of the model, orthonormal; what these leave of the residuals; the promising ones of
    candidates.
    """

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self.n, self.m = rows.residual.shape
        size = self.n * self.m
        model = self._flat(rows.model)
        self.basis = orthonormalizing(model, BLOCK * self.m)
        self.p = self.basis.shape[1]
        pull = self.basis.T @ (model.T @ rows.residual.ravel())
        self.left = rows.residual - (model @ (self.basis @ pull)).reshape(self.n, self.m)
        self.columns, self._kept = np.zeros((self.n, self.m, 0)), cast("Array | None", None)
        self.columns, self._kept = self._promising(), None
        self.price = 2 * math.log(max(rows.columns.shape[2], 1)) + math.log(size)
        self.most = max(size // 4 - self.p, 0)

    @staticmethod
    def _flat(columns: Array) -> Array:
        return columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])

    def _blocks(self) -> Iterator[tuple[slice, Array]]:
        """Yield rows, and X there, (rows m, p + 1 + K)."""
        if self._kept is not None:
            yield slice(0, self.n), self._kept
            return
        for start in range(0, self.n, BLOCK):
            some = slice(start, start + BLOCK)
            parts = [self.rows.model[some], self.left[some, :, None], self.columns[some]]
            model, *others = map(self._flat, parts)
            X = np.concatenate([model @ self.basis, *others], axis=1)
            if self.n <= BLOCK:
                self._kept = X
            yield some, X

    def _clipped(self, left: Array) -> Array:
        """Return errors, (n, m), none much larger than most: else columns would be chosen that follow these."""
        size = np.linalg.norm(left, axis=1)
        return np.asarray(left * np.minimum(1, 3 * np.median(size) / np.maximum(size, 1e-300))[:, None])

    def _promising(self) -> Array:
        """Return what candidates' columns are beyond the model, at length 1, (n, m, K), those that explain most."""
        flat, left = self._flat(self.rows.columns), self._clipped(self.left)
        if not flat.shape[1]:
            return self.rows.columns
        along = np.zeros((self.p, flat.shape[1]))
        for some, X in self._blocks():
            along += X[:, : self.p].T @ self._flat(self.rows.columns[some])
        square, pull = np.einsum("ij,ij->j", flat, flat), left.ravel() @ flat
        beyond = square - np.einsum("ij,ij->j", along, along)
        seen = np.flatnonzero(beyond > SEEN**2 * square)
        best = seen[np.argsort(-(pull[seen] ** 2) / beyond[seen], kind="stable")[:MOST_COLUMNS]]
        falls = np.empty((self.n, self.m, len(best)))
        for some, X in self._blocks():
            imitated = (X[:, : self.p] @ along[:, best]).reshape(-1, self.m, len(best))
            falls[some] = (self.rows.columns[some][:, :, best] - imitated) / np.sqrt(beyond[best])
        return falls

    def robust(self) -> Array:
        """Return weights by which large errors hardly count, (n,): those of a Cauchy distribution."""
        weight = np.ones(self.n)
        for _ in range(STEPS):
            products, index = self.products(weight, self.p + 1), [*range(self.p)]
            left = self._left(index, products, inverse_root(products[index][:, index], relative=1e-14))
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
            verdict = self.judged(self.errors(self.chosen(weight, products, clip), weight, products))
            if np.max(np.abs(verdict.weight - weight)) < 1e-2:
                return verdict
            since += 1
            if best is None or verdict.cost < best.cost:
                best, since = verdict, 0
            if since == PATIENCE:
                break
            weight, clip = verdict.weight, False
        return best or verdict

    def products(self, weight: Array, first: int | None = None) -> Array:
        """Return XᵀWX, of the first columns only where so many are asked for."""
        return np.asarray(
            sum(
                (X[:, :first] * np.repeat(weight[some], self.m)[:, None]).T @ X[:, :first]
                for some, X in self._blocks()
            )
        )

    def chosen(self, weight: Array, products: Array, clip: bool) -> list[int]:
        """Return columns that pay for themselves, one after the other; by errors of which none is much larger."""
        p, rows = self.p, list[int]()
        dof = float(np.sum(weight)) * self.m - p
        pull, total = products[:, p], float(products[p, p])
        while len(rows) < min(self.most, self.columns.shape[2], dof - 2):
            index = [*range(p), *rows]
            root = inverse_root(products[np.ix_(index, index)], relative=1e-14)
            if clip:
                left = self._clipped(self._left(index, products, root))
                weighted = weight[:, None] * left
                pull = np.asarray(sum(X.T @ weighted[some].ravel() for some, X in self._blocks()))
                total = float(np.sum(weighted * left))
            along, across = root.T @ pull[index], root.T @ products[index]
            square = products.diagonal() - np.einsum("ij,ij->j", across, across)
            seen = square > SEEN**2 * products.diagonal()
            falls = np.where(seen, (pull - across.T @ along) ** 2 / np.where(seen, square, 1.0), 0.0)
            falls[[*index, p]] = 0.0
            best, unexplained = int(np.argmax(falls)), total - float(along @ along)
            rest = max(unexplained - float(falls[best]), 1e-300)
            if unexplained <= 0 or (dof - len(rows)) * math.log(unexplained / rest) < self.price:
                break
            rows.append(best)
        return rows

    def _halves(self, index: Sequence[int], root: Array) -> Iterator[tuple[slice, Array]]:
        """Yield rows, and there the columns of a fit as combinations that are independent of each other."""
        for some, X in self._blocks():
            yield some, (X[:, : self.p] if len(index) == self.p else X[:, index]) @ root

    def _left(self, index: Sequence[int], products: Array, root: Array) -> Array:
        """Return what a weighted fit of some columns leaves, (n, m)."""
        along, left = root.T @ products[index, self.p], np.empty((self.n, self.m))
        for some, half in self._halves(index, root):
            left[some] = self.left[some] - (half @ along).reshape(-1, self.m)
        return left

    def errors(self, chosen: Sequence[int], weight: Array, products: Array) -> Errors:
        """Return the errors of rows as the others predict them, with some of the candidates' columns."""
        index = [*range(self.p), *chosen]
        root = inverse_root(products[np.ix_(index, index)], relative=1e-14)
        along, left = root.T @ products[index, self.p], np.empty((self.n, self.m))
        spread = np.empty((self.n, self.m, self.m))
        for some, half in self._halves(index, root):
            of_rows = half.reshape(len(half) // self.m, self.m, half.shape[1])
            spread[some] = of_rows @ of_rows.transpose(0, 2, 1)
            left[some] = self.left[some] - (half @ along).reshape(-1, self.m)
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
            errors = list[tuple[float, float, Array]]()
            for order in orders:
                of_rows = left.take(order, axis=0)  # a quarter of the time of an index
                x = _mean_around(of_rows, good[order])
                weighted = w[order] * x
                pull = max(float(np.vdot(weighted, of_rows)), 0.0)
                part = pull / max(float(np.vdot(weighted, x)), 1e-300)
                errors.append((total - part * pull, part, x))
            k = int(np.argmin([rest for rest, _, _ in errors]))
            rest, part, x = errors[k]
            if dof * math.log(max(total, 1e-300) / max(rest, 1e-300)) <= cost:
                break
            left, total, price = left.copy(), rest, price + cost
            left[orders.pop(k)] -= part * x
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
    # no error of its own is known to be smaller than that of the prediction
    variance = sigma**2 * np.exp(errors.wide / m)
    length = np.maximum(np.einsum("nm,nm->n", errors.error, errors.error), m * variance)
    wrong = m * np.log(length) + 2 * (surface + math.log(SIZES))
    if spread > sigma**2:
        variance += spread
        wrong = np.minimum(wrong, length / variance + m * np.log(2 * math.pi * variance)) + 2 * math.log(2.0)
    return good, wrong


def _mean_around(left: Array, there: Mask) -> Array:
    """Return the mean error, (n, m), of those rows before and after each row that are there."""
    others = left[there]
    padded = np.concatenate(
        [np.repeat(others[:1], AROUND, axis=0), others, np.repeat(others[-1:], AROUND, axis=0)]
    )
    ends = len(padded) + 1 - AROUND
    sums = padded[:ends].copy()  # of so many rows from each one on
    for step in range(1, AROUND):
        sums += padded[step : ends + step]
    after = np.cumsum(there)  # not itself
    return np.asarray((sums.take(after - there, axis=0) + sums.take(after + AROUND, axis=0)) / (2 * AROUND))
