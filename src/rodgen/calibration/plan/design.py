r"""Which readings, of all that are considered, do best.

Of two models A and B let A be true, with the values that it was fitted with. New readings then differ from what B
predicts by d. B fits them anew together with the data: of d remains, as a rise of its chi-square,

    λ = min over δ of  |d - J δ|² + δᵀ M δ,

J the derivative of the readings by B's parameters, M the information of the data about them. This λ is what the
readings are chosen for (T-optimality: Atkinson and Fedorov 1975): the least of all pairs, over what is needed, is
made as large as can be. For parameters it is their variance, in the mean of the logarithms (D_s-optimality).

Readings are added one by one, best first, over a background of all that are considered, which is taken away in turn:
without it the first ones would see nothing where several are needed at once. Then each is exchanged for a better one
until none is (Fedorov 1972). A reading updates the inverse of the information by a matrix of its own size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh

SEEN = 1e-13
"""Combinations that change all readings together by less than this part (of squares) change nothing."""
UNKNOWN = 1e-8
"""Prior information of a combination that changes a usual reading by one standard deviation: it is below 1e4, so that
what the data do not determine stays finite."""
VALUES = 100
"""Number of values of a model's parameters that are drawn from what the data leave open."""
STEEP = 4.0
"""Exponent of the soft minimum of all gains: the least of them counts most."""
ENOUGH = 3.0
"""A gain beyond this multiple of what is needed counts no further."""
SWEEPS = 4
"""How often every reading is exchanged at most; the search ends before where a sweep gains less than a thousandth."""
TOGETHER = 1e-3
"""What it is worth that a reading is taken where another one is: a move less."""
PARTS, FEWEST_PARTS = 8, 3
"""Parts of a travel, of equal length, and from how many of them readings come that are to show the function of one
coordinate: a diagnosis leaves positions out, and a line is seen without one of three. With two, as many as differ most,
scales of slides that had never moved were not found; with four a quarter more readings were needed."""


@dataclass(frozen=True)
class Linearized:
    """A model at its fitted parameters, linearized for some readings, in standard deviations of a reading."""

    residual: Array
    """Of readings as the first model predicts them, (n, m)."""
    jacobian: Array
    """Of its free parameters, (n, m, p)."""

    def take(self, index: NDArray[np.bool_]) -> Linearized:
        """Return it for some of the readings."""
        return Linearized(self.residual[index], self.jacobian[index])


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
    group: int
    """Number of the alternatives that they belong to."""
    possible: bool = True
    """Whether all readings considered together would do, in whichever of the two is true."""

    @property
    def models(self) -> frozenset[int]:
        """Numbers of the two models."""
        return frozenset((self.true, self.wrong))

    def difference(self, models: Sequence[Linearized]) -> Array:
        """Return what the true model predicts beyond the wrong one, (n, m)."""
        return np.asarray(models[self.wrong].residual - models[self.true].residual)


def both_ways(pairs: Iterable[Pair]) -> list[Pair]:
    """Return pairs that are possible only where the two can be distinguished whichever is true."""
    pairs = list(pairs)
    hopeless = {p.models for p in pairs if not p.possible}
    return [replace(p, possible=p.models not in hopeless) for p in pairs]


@dataclass(frozen=True)
class Sharpen:
    """A parameter whose variance is to fall."""

    model: int
    parameter: int
    """Numbers of the model, and of the parameter among its free ones."""
    key: str


class Coordinates:
    """Parameters of a model scaled so that a usual reading informs of all alike, without combinations that none shows.

    Parameters
    ----------
    information : ndarray, shape (p, p)
        Of the data, in variances of a reading.
    jacobian : ndarray, shape (N, m, p)
        Of the readings that are considered.

    Attributes
    ----------
    root : ndarray, shape (p, r)
        A change of the parameters is root @ x.
    unseen : ndarray, shape (p, k)
        The combinations that nothing shows, parameters scaled by what they change.
    prior : ndarray, shape (r, r)
        What is known of x.
    values : ndarray, shape (r, k)
        Some that the data leave open, as differences from those fitted.
    """

    def __init__(self, information: Array, rows: int, jacobian: Array) -> None:
        flat = jacobian.reshape(-1, jacobian.shape[-1])
        every = information / max(rows, 1) + flat.T @ flat / len(jacobian)
        scaled, scale = unit_diagonal(every)
        values, vectors = eigh(scaled)
        seen = values > SEEN * max(values[-1] if len(values) else 0.0, 1e-300)
        self.root = vectors[:, seen] / np.sqrt(values[seen]) / scale[:, None]
        self.unseen = vectors[:, ~seen]
        known, turned = eigh(self.root.T @ information @ self.root)
        known = np.maximum(known, 0.0)  # rounding
        self.prior = (turned * (known + UNKNOWN)) @ turned.T
        normal = np.random.default_rng(0).normal(size=(len(known), VALUES // 2))
        values = turned @ (normal / np.sqrt(known + 1e-2)[:, None])
        self.values = np.concatenate([values, -values], axis=1)

    def derivative(self, model: Linearized) -> Array:
        """Return the derivative of readings by x, all components below each other, (n·m, r)."""
        return np.asarray(model.jacobian.reshape(-1, model.jacobian.shape[-1]) @ self.root)


class Task:
    """Goals, and what readings contribute to them.

    Parameters
    ----------
    coordinates : sequence of Coordinates
        Of each model.
    """

    def __init__(
        self, coordinates: Sequence[Coordinates], pairs: Sequence[Pair], sharpen: Sequence[Sharpen]
    ) -> None:
        self.coordinates, self.pairs, self.sharpen = coordinates, pairs, sharpen
        self.models = sorted({p.wrong for p in pairs} | {s.model for s in sharpen})

    def value(self, gains: Array, variances: Array) -> Array:
        """Return how good gains (..., pairs) and variances (..., parameters) are."""
        found = np.zeros(np.broadcast_shapes(gains.shape[:-1], variances.shape[:-1]))
        if self.pairs:
            now = np.array([p.now for p in self.pairs])
            needed = np.array([p.needed for p in self.pairs])
            part = (gains + now) / needed
            part = np.where(part > ENOUGH, ENOUGH + 0.02 * np.log1p(np.maximum(part - ENOUGH, 0)), part)
            found = found - np.log(np.mean(np.exp(-STEEP * part), axis=-1)) / STEEP
        if self.sharpen:
            found = found - 0.5 * np.mean(np.log(np.maximum(variances, 1e-300)), axis=-1)
        return np.asarray(found)

    def gains(self, models: Sequence[Linearized]) -> tuple[Array, Array]:
        """Return the rise of chi-square of each pair, and the variances, that readings bring."""
        derivatives = {k: self.coordinates[k].derivative(models[k]) for k in self.models}
        inverse = {k: np.linalg.inv(self.coordinates[k].prior + j.T @ j) for k, j in derivatives.items()}
        gains = []
        for p in self.pairs:
            d = p.difference(models).ravel()
            b = derivatives[p.wrong].T @ d
            gains.append(max(float(d @ d - b @ inverse[p.wrong] @ b), 0.0))
        directions = [(self.coordinates[s.model].root[s.parameter], inverse[s.model]) for s in self.sharpen]
        return np.array(gains), np.array([w @ covariance @ w for w, covariance in directions])

    def probability(self, pair: Pair, models: Sequence[Linearized]) -> float:
        """Return the probability that the wrong model fits worse by the threshold.

        The data leave the parameters of the true model open to some extent: it is the mean over many of their values.
        """
        from scipy import special

        a, b = self.coordinates[pair.true], self.coordinates[pair.wrong]
        d = pair.difference(models).ravel()
        of_a, of_b = a.derivative(models[pair.true]), b.derivative(models[pair.wrong])
        expected = np.eye(len(d)) + of_b @ np.linalg.solve(b.prior, of_b.T)
        differences = d[:, None] - of_a @ a.values
        rise = np.einsum("nk,nk->k", differences, np.linalg.solve(expected, differences))
        return float(np.mean(special.ndtr((pair.now + rise - pair.threshold) / np.sqrt(4 * rise + 4))))


@dataclass(frozen=True, eq=False)
class Considered:
    """The readings that a plan chooses from.

    Attributes
    ----------
    models : sequence of Linearized
        For all of them.
    effort : ndarray, shape (N,)
        What each costs, as a fraction of what is needed: of two equally good ones the easier is taken.
    poses : ndarray, shape (N,)
        Equal where readings can be taken in one pose.
    parts : ndarray, shape (N, K)
        In which part of the travel joints are whose effects in question are seen at distinct positions only.
    """

    models: Sequence[Linearized]
    effort: Array
    poses: NDArray[np.int_]
    parts: NDArray[np.int_]

    def allowed(self, picked: list[int], n: int) -> NDArray[np.bool_]:
        """Return which readings may follow others, (N,), if n are to come from at least `FEWEST_PARTS` of each travel.

        Any, where none may: a list of poses may have fewer.
        """
        found = np.ones(len(self.poses), np.bool_)
        for part in self.parts.T:
            count = np.bincount(part[picked], minlength=int(part.max()) + 1)
            found &= count[part] < max(-(-n // FEWEST_PARTS), 1)
        return found if found.any() else ~found


class _ReadingSearch:
    """Sums over the readings that were chosen, and what each further one would add."""

    def __init__(self, task: Task, considered: Considered) -> None:
        self.task, self.considered = task, considered
        self.n, models = len(considered.effort), considered.models
        self.j = {k: models[k].jacobian @ task.coordinates[k].root for k in task.models}
        self.every = {k: np.einsum("nmr,nms->rs", j, j, optimize=True) for k, j in self.j.items()}
        # of each wrong model: the numbers of its pairs, and what the true ones predict beyond it, (n, m, pairs)
        self.of = {k: [i for i, p in enumerate(task.pairs) if p.wrong == k] for k in task.models}
        self.of = {k: pairs for k, pairs in self.of.items() if pairs}
        self.d = {
            k: np.stack([task.pairs[i].difference(models) for i in pairs], axis=2)
            for k, pairs in self.of.items()
        }
        self.every_b = {k: np.einsum("nmr,nmi->ri", self.j[k], d, optimize=True) for k, d in self.d.items()}
        self.every_c = {k: np.sum(d**2, axis=(0, 1)) for k, d in self.d.items()}

    def best(self, picked: list[int], background: float, count: int) -> tuple[int, float]:
        """Return the reading of so many that does best in addition to others, and the value that is then reached."""
        task = self.task
        inverse, influence, own = {}, {}, {}
        gains = np.zeros((self.n, len(task.pairs)))
        for k in task.models:
            j = self.j[k]
            flat = j[picked].reshape(-1, j.shape[-1])
            m = task.coordinates[k].prior + flat.T @ flat + background * self.every[k]
            inverse[k] = np.linalg.inv((m + m.T) / 2)
            influence[k] = j @ inverse[k]
            own[k] = np.linalg.inv(np.eye(j.shape[1]) + influence[k] @ j.transpose(0, 2, 1))
            if k in self.d:
                d, here = self.d[k], self.d[k][picked].reshape(-1, self.d[k].shape[-1])
                b = flat.T @ here + background * self.every_b[k]
                so_far = np.sum(here**2, axis=0) + background * self.every_c[k]
                so_far -= np.sum(b * (inverse[k] @ b), axis=0)
                left = d - influence[k] @ b
                gains[:, self.of[k]] = np.maximum(so_far, 0.0) + np.sum(left * (own[k] @ left), axis=1)
        variances = np.zeros((self.n, len(task.sharpen)))
        for i, s in enumerate(task.sharpen):
            w = task.coordinates[s.model].root[s.parameter]
            change = influence[s.model] @ w
            fall = np.einsum("nm,nml,nl->n", change, own[s.model], change)
            variances[:, i] = np.maximum(w @ inverse[s.model] @ w - fall, 1e-300)
        value = task.value(gains, variances)
        poses = self.considered.poses
        shown = value - self.considered.effort + TOGETHER * np.isin(poses, poses[picked])
        if len(picked) < self.n:
            shown[picked] = -np.inf  # the same reading once more would share what was wrong with it
        if (may := self.considered.allowed(picked, count) & np.isfinite(shown)).any():
            shown[~may] = -np.inf
        k = int(np.argmax(shown))
        return k, float(value[k])


def chosen(task: Task, considered: Considered, n: int, *, sweeps: int = SWEEPS) -> list[int]:
    """Return the numbers of n readings of those considered; each is exchanged so many times at most."""
    search = _ReadingSearch(task, considered)
    picked: list[int] = []
    for left in range(n - 1, -1, -1):
        picked.append(search.best(picked, left / search.n, n)[0])
    best = -np.inf
    for _ in range(sweeps):
        before = best
        for i in range(n):
            others = picked[:i] + picked[i + 1 :]
            k, value = search.best(others, 0.0, n)
            picked[i], best = k, value
        if not best > before + 1e-3 * abs(before):
            break
    return picked
