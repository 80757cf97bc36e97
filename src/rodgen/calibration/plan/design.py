r"""Which readings, of all that are considered, do best.

Of two models A and B let A be true, with the values that it was fitted with. New readings then differ from what B
predicts by d. B fits them anew together with the data: of d remains, as a rise of its chi-square,

    λ = min over δ of  |d - J δ|² + δᵀ M δ,

J the derivative of the readings by B's parameters, M the information of the data about them. This λ is what the
readings are chosen for (T-optimality: Atkinson and Fedorov 1975): of all pairs, over what is needed, and the least of
them counts most. For parameters it is their variance, in the mean of the logarithms (D_s-optimality).

Readings are added one by one, best first, over a background of all that are considered, which is taken away in turn:
without it the first ones would see nothing where several are needed at once. Then each is exchanged for a better one
until none is (Fedorov 1972). A reading updates the inverse of the information by a matrix of its own size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem
from rodgen.machines.observations import Observations
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh

SEEN = 1e-13
"""Combinations that change all readings together by less than this part (of squares) change nothing."""
UNKNOWN = 1e-8
"""Prior information of a combination that changes a usual reading by one standard deviation: it is below 1e4, so that
what the data do not determine stays finite."""
VALUES = 100
"""Number of values of a model's parameters that are drawn from what the data leave open."""
OPEN = 1e-2
"""Prior information of these values: what the data do not determine changes a usual reading by ten deviations."""
STEEP = 4.0
"""Exponent of the soft minimum of all gains: the least of them counts most."""
EQUAL = 1e-9
"""Differences of what readings are good for that are rounding."""
SWEEPS = 3
"""How often every reading is exchanged at most; the search ends before where a sweep gains less than a thousandth."""


@dataclass(frozen=True, eq=False)
class Linearized:
    """A fit linearized for some readings; parameters scaled so that a usual reading informs of all alike.

    Attributes
    ----------
    residual : ndarray, shape (n, m)
        Of readings as the first model predicts them, in standard deviations of a reading.
    jacobian : ndarray, shape (n, m, p)
        Of the free parameters, likewise.
    root : ndarray, shape (p, r)
        A change of the parameters is root @ x; without combinations that nothing shows.
    prior : ndarray, shape (r, r)
        What the data inform of x.
    values : ndarray, shape (r, k)
        Some that the data leave open, as differences from those fitted.
    """

    residual: Array
    jacobian: Array
    root: Array
    prior: Array
    values: Array

    def take(self, index: Mask) -> Linearized:
        """Return it for some of the readings."""
        return replace(self, residual=self.residual[index], jacobian=self.jacobian[index])

    @property
    def derivative(self) -> Array:
        """The derivative of readings by x, (n, m, r)."""
        return np.asarray(self.jacobian @ self.root)


def linearized(
    fits: Sequence[Fit], readings: Observations, variance: float, like: Sequence[Linearized] = ()
) -> list[Linearized]:
    """Return fits linearized for readings, these as the first one predicts them.

    Parameters
    ----------
    variance : float
        Of a weighted residual.
    like : sequence of Linearized
        Of all readings that are considered, whose scales hold; left out: these are all.
    """
    first = fits[0]
    problem = Problem(first.problem.model, readings)
    readings = problem.predicted_observations(first.solution.theta, first.solution.frame)
    parts = []
    for k, fit in enumerate(fits):
        problem, at = Problem(fit.problem.model, readings), (fit.solution.theta, fit.solution.frame)
        residual = problem.residuals(*at, weighted=True) / np.sqrt(variance)
        jacobian = problem.jacobian(*at)[:, :, list(fit.free)] / np.sqrt(variance)
        if like:
            parts.append(replace(like[k], residual=residual, jacobian=jacobian))
        else:
            information = fit.problem.normal_equations(*at)[1][np.ix_(fit.free, fit.free)] / variance
            parts.append(Linearized(residual, jacobian, *_scaled(information, fit.rows, jacobian)))
    return parts


def _scaled(information: Array, rows: int, jacobian: Array) -> tuple[Array, Array, Array]:
    """Return root, prior and values of a model of which the data inform by a matrix, (p, p)."""
    finite = jacobian[np.isfinite(jacobian).all(axis=(1, 2))]
    flat = finite.reshape(-1, jacobian.shape[-1])
    scaled, scale = unit_diagonal(information / max(rows, 1) + flat.T @ flat / max(len(finite), 1))
    values, vectors = eigh(scaled)
    seen = values > SEEN * max(values[-1] if len(values) else 0.0, 1e-300)
    root = vectors[:, seen] / np.sqrt(values[seen]) / scale[:, None]
    known, turned = eigh(root.T @ information @ root)
    known = np.maximum(known, 0.0)  # rounding
    normal = np.random.default_rng(0).normal(size=(len(known), VALUES // 2))
    drawn = turned @ (normal / np.sqrt(known + OPEN)[:, None])
    return root, (turned * (known + UNKNOWN)) @ turned.T, np.concatenate([drawn, -drawn], axis=1)


@dataclass(frozen=True)
class Pair:
    """A true and a wrong model that a plan is to distinguish."""

    true: int
    wrong: int
    """Numbers of the models."""
    now: float
    """By how much the wrong one fits the data worse, in chi-square."""
    needed: float
    """By how much it should for the threshold to be exceeded with the probability that is planned for."""
    threshold: float
    """Chi-square from which they count as distinguished."""

    @property
    def models(self) -> frozenset[int]:
        """Numbers of the two models."""
        return frozenset((self.true, self.wrong))

    def difference(self, models: Sequence[Linearized]) -> Array:
        """Return what the true model predicts beyond the wrong one, (n, m)."""
        return np.asarray(models[self.wrong].residual - models[self.true].residual)

    def gain(self, models: Sequence[Linearized], times: float = 1.0) -> float:
        """Return the rise of chi-square that readings bring, each taken several times."""
        d, wrong = self.difference(models).ravel(), models[self.wrong]
        j = wrong.derivative.reshape(len(d), -1)
        b = j.T @ d
        return max(times * float(d @ d - times * b @ np.linalg.solve(wrong.prior + times * j.T @ j, b)), 0.0)

    def probability(self, models: Sequence[Linearized]) -> float:
        """Return the probability that the wrong model fits worse by the threshold.

        The data leave the parameters of the true model open to some extent: it is the mean over many of their values.
        """
        from scipy import special

        a, b = models[self.true], models[self.wrong]
        d = self.difference(models).ravel()
        of_a, of_b = (x.derivative.reshape(len(d), -1) for x in (a, b))
        expected = np.eye(len(d)) + of_b @ np.linalg.solve(b.prior, of_b.T)
        differences = d[:, None] - of_a @ a.values
        rise = np.einsum("nk,nk->k", differences, np.linalg.solve(expected, differences))
        return float(np.mean(special.ndtr((self.now + rise - self.threshold) / np.sqrt(4 * rise + 4))))


class Design:
    """The readings that do best, of all that are considered.

    Parameters
    ----------
    models : sequence of Linearized
        For all readings that are considered.
    pairs : sequence of Pair
        That are to be distinguished; where there are none, parameters of the first model are sharpened.
    directions : ndarray, shape (r, k), optional
        These parameters, in its scaled ones; all where left out.
    places : ndarray, shape (n, d), optional
        Where readings are. Of those that are as good as the best the one farthest from all others is taken (Kennard and
        Stone 1969).
    taken : ndarray, shape (N, d), optional
        Where the data were read; needed with `places`.
    sides : ndarray of bool, shape (n,), optional
        On which of two sides each is; as many are chosen on either where both have enough.
    """

    def __init__(
        self,
        models: Sequence[Linearized],
        pairs: Sequence[Pair],
        directions: Array | None = None,
        places: Array | None = None,
        taken: Array | None = None,
        sides: Mask | None = None,
    ) -> None:
        self.pairs, self.models, self.sides = pairs, models, sides
        self.places, self.taken = places, taken
        self.n = len(models[0].residual)
        self.j = {k: models[k].derivative for k in ({p.wrong for p in pairs} or {0})}
        self.directions = np.eye(models[0].root.shape[1]) if directions is None else directions
        self.every = {k: np.einsum("nmr,nms->rs", j, j, optimize=True) for k, j in self.j.items()}
        self.d = {
            k: np.stack([p.difference(models) for p in pairs if p.wrong == k], axis=2)
            for k in self.j
            if pairs
        }
        self.every_b = {k: np.einsum("nmr,nmi->ri", self.j[k], d, optimize=True) for k, d in self.d.items()}
        self.every_c = {k: np.sum(d**2, axis=(0, 1)) for k, d in self.d.items()}

    def _values(self, picked: list[int], background: float) -> Array:
        """Return how good each reading is in addition to others, (n,), over a part of all readings."""
        gains = np.zeros((self.n, len(self.pairs)))
        value = np.zeros(self.n)
        for k, j in self.j.items():
            flat = j[picked].reshape(-1, j.shape[-1])
            m = self.models[k].prior + flat.T @ flat + background * self.every[k]
            inverse = np.linalg.inv((m + m.T) / 2)
            influence = j @ inverse
            inverses = np.linalg.inv(np.eye(j.shape[1]) + influence @ j.transpose(0, 2, 1))
            if not self.pairs:
                change = influence @ self.directions
                fall = np.sum(change * (inverses @ change), axis=1)
                now = np.einsum("rk,rs,sk->k", self.directions, inverse, self.directions)
                value = -0.5 * np.mean(np.log(np.maximum(now - fall, 1e-300)), axis=1)
                continue
            d, here = self.d[k], self.d[k][picked].reshape(-1, self.d[k].shape[-1])
            b = flat.T @ here + background * self.every_b[k]
            so_far = (
                np.sum(here**2, axis=0) + background * self.every_c[k] - np.sum(b * (inverse @ b), axis=0)
            )
            left = d - influence @ b
            rise = np.maximum(so_far, 0.0) + np.sum(left * (inverses @ left), axis=1)
            gains[:, [i for i, p in enumerate(self.pairs) if p.wrong == k]] = rise
        if self.pairs:
            now, needed = np.array([(p.now, p.needed) for p in self.pairs]).T
            value = -np.log(np.mean(np.exp(-STEEP * (gains + now) / needed), axis=1) + 1e-300) / STEEP
        if len(picked) < self.n:
            value[picked] = -np.inf  # the same reading once more would share what was wrong with it
        return np.asarray(value)

    def _best(self, values: Array, picked: list[int], n: int) -> int:
        """Return the reading of the highest value, of equal ones the farthest from those picked and from the data.

        None of a side that has its half of n already.
        """
        if self.sides is not None and 2 * np.bincount(self.sides, minlength=2).min() >= n:
            full = 2 * np.bincount(self.sides[picked], minlength=2) >= n + n % 2
            values = np.where(full[self.sides.astype(int)], -np.inf, values)
        if self.places is None or self.taken is None:
            return int(np.argmax(values))
        equal = np.flatnonzero(values > np.max(values) - EQUAL)
        there = np.unique(np.concatenate([self.taken, self.places[picked]]), axis=0)
        apart = np.linalg.norm(self.places[equal][:, None] - there, axis=2).min(axis=1)
        return int(equal[np.argmax(apart)])

    def chosen(self, n: int, sweeps: int = SWEEPS) -> list[int]:
        """Return the numbers of n readings; each is exchanged so many times at most."""
        picked: list[int] = []
        for left in range(n - 1, -1, -1):
            picked.append(self._best(self._values(picked, left / self.n), picked, n))
        best = -np.inf
        for _ in range(sweeps):
            before = best
            for i in range(n):
                others = picked[:i] + picked[i + 1 :]
                values = self._values(others, 0.0)
                picked[i] = self._best(values, others, n)
                best = float(values[picked[i]])
            if not best > before + 1e-3 * abs(before):
                break
        return picked
