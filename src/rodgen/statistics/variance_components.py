"""Variance components of readings that depend on each other, by restricted maximum likelihood (REML).

A machine does not repeat a pose exactly, which all readings of the pose share, and a set-up wanders while it is
measured. To a test that takes readings for independent, both look like effects. So their variances are estimated, by
restricted maximum likelihood (Patterson and Thompson 1971) with the columns of the model as fixed effects, and those of
the effects that the data call for: a missing effect is not taken for a drift, and a drift that resembles an effect is
known from how it wanders otherwise. What :mod:`rodgen.statistics.whitening` calls u is the pose's part, x the wander.

A component stays where the restricted likelihood falls without it by more than chance alone makes of it in one of ten
cases: a drift that is overlooked makes false claims, one too many costs a little power.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.columns import directions_above, orthonormal_basis, pair_falls, project_out
from rodgen.statistics.decompositions import eigh, lstsq
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.thresholds import SMALLEST_P, VARIANCES
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion


class VarianceEstimator:
    """Estimates variance components, with effects that the data call for, whatever wanders, as fixed effects.

    Parameters
    ----------
    groups : mapping of str to slice
        Degrees of freedom that share a variance.
    poses : Poses
        All of them.
    own : ndarray, shape (N, q)
        Orthonormal basis of the model's columns.
    effects : sequence of ndarray, each of shape (N, k)
        Columns of candidates, of length 1.
    residual : ndarray, shape (N,)
    tries : sequence of float, optional
        Number of independent tests that the values tried for each effect amount to; left out: one of each.
    """

    def __init__(
        self,
        motion: SharedMotion,
        groups: dict[str, slice],
        poses: Poses,
        own: Array,
        effects: Sequence[Array],
        residual: Array,
        readings: int,
        tries: Sequence[float] | None = None,
    ) -> None:
        self.log_tries = np.log(np.ones(len(effects)) if tries is None else tries)
        self.motion, self.groups, self.poses = motion, groups, poses
        self.own, self.effects, self.residual, self.readings = own, effects, residual, readings

    def best(
        self, *, pose: bool
    ) -> tuple[VarianceComponents, MotionDeviations | None, list[tuple[MotionDeviations, MotionDeviations]]]:
        """Return the variances, no part where readings are independent, and those `within_error`."""
        basis, seen = self.own, _visible_parts(self.own, self.effects)
        likelihood = self._likelihood(basis)
        found = likelihood.best(pose=pose)
        for _ in range(VARIANCES.most_effects):
            if not found.names:
                return found, None, []
            called = self._called_for(basis, seen, found, pose)
            if called is None:
                break
            fixed = _together(seen, called)
            for i in called:
                seen[i] = seen[i][:, :0]
            basis, seen = np.concatenate([basis, fixed], axis=1), _visible_parts(fixed, seen)
            likelihood = self._likelihood(basis)
            found = likelihood.best(pose=pose)
        independent = likelihood.at((), (), np.inf)
        found = replace(found, gain=2 * (found.likelihood - independent.likelihood))
        if not found.names:
            return found, None, []
        return found, likelihood.deviations(found), likelihood.within_error(found)

    def _likelihood(self, fixed: Array, further: Array | None = None) -> RestrictedLikelihood:
        columns = (
            [fixed, self.residual[:, None]] if further is None else [fixed, further, self.residual[:, None]]
        )
        whole = np.concatenate(columns, axis=1).reshape(*self.motion.columns.shape[:2], -1)
        return RestrictedLikelihood(
            Moments(self.motion, whole), self.readings, fixed.shape[1], self.groups, self.poses
        )

    def _called_for(
        self, basis: Array, seen: Sequence[Array], now: VarianceComponents, pose: bool
    ) -> tuple[int, ...] | None:
        """Return the effect that is there whatever wanders, or that explains more than a wander does; None without any.

        Or, where something wanders and no single one is, two of them: a wander takes what several small effects do
        together, and shrinks only once they are all there. Wander and effects are compared with wander alone, each with
        the variances that suit it best. The restricted likelihood is that of the residuals given the model's columns
        alone, or two of them could not be compared.
        """
        wanders = any(name.startswith("wander") for name in now.names)
        count = sum(1 for u in seen if u.shape[1])
        products = self._products(basis, seen, now)
        order = self._promising(basis.shape[1], seen, products)
        best, found = np.log(VARIANCES.effect_p), None
        most, instead = VARIANCES.instead, None
        for i, log_now in order:
            k = seen[i].shape[1]
            likelihood = self._likelihood(basis, seen[i])
            alone = likelihood.best(pose=pose and wanders, wander=False)
            # each parameter gains one by chance
            more = 2 * (alone.likelihood - now.likelihood - self.log_tries[i]) - k
            if more > most and (
                more > VARIANCES.certain
                or self._chance(basis, seen[i], now, alone) < VARIANCES.looks_like_effect
            ):
                most, instead = more, i
            tries = self.log_tries[i]
            log = self._log_p_given(likelihood, k, now, log_now - tries) + np.log(count) + tries
            if log < best:
                best, found = log, i
        called = found if instead is None else instead
        if called is not None:
            return (called,)
        return self._pair_called_for(basis, seen, now, products) if wanders else None

    def _pair_called_for(
        self, basis: Array, seen: Sequence[Array], now: VarianceComponents, products: Sequence[Array]
    ) -> tuple[int, int] | None:
        """Return two effects that are there together whatever wanders; None without any."""
        there = [i for i, u in enumerate(seen) if u.shape[1]]
        pairs = len(there) * (len(there) - 1) / 2
        if not pairs:
            return None
        values, vectors = eigh(_left(products[0], basis.shape[1]))
        coordinates = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        ends = np.cumsum([u.shape[1] for u in seen])[:-1]
        bases = np.split(coordinates[:, :-1], ends, axis=1)
        residual = coordinates[:, -1]
        bases = [orthonormal_basis(bases[i], relative=VARIANCES.visible) for i in there]
        falls = np.triu(pair_falls(bases, residual, least=VARIANCES.visible)) / float(residual @ residual)
        sizes = np.array([u.shape[1] for u in bases])
        sizes = sizes[:, None] + sizes
        worth = self.readings * falls - sizes  # each parameter gains one by chance
        best, found = np.log(VARIANCES.effect_p), None
        for at in np.argsort(-worth, axis=None)[: VARIANCES.tried]:
            a, b = np.unravel_index(at, worth.shape)
            pair = there[a], there[b]
            tries = float(np.log(pairs) + self.log_tries[list(pair)].sum())
            further = _together(seen, pair)
            k, likelihood = further.shape[1], self._likelihood(basis, further)
            log_now = _log_p(float(falls[a, b]), k, self.readings - basis.shape[1] - k)
            log = self._log_p_given(likelihood, k, now, log_now) + tries
            if log < best:
                best, found = log, pair
        return found

    def _log_p_given(
        self, likelihood: RestrictedLikelihood, k: int, now: VarianceComponents, log_now: float
    ) -> float:
        """Return the logarithm of the probability of k further columns: by likelihood and, where it wanders, by F."""
        there = likelihood.again(now)
        gain = max(2 * (there.likelihood - now.likelihood), 0.0)
        log = _log_p(-float(np.expm1(-gain / likelihood.dof)), k, likelihood.dof - k)
        if not any(name.startswith("wander") for name in there.names):
            return log
        return VARIANCES.likelihood_share * log + (1 - VARIANCES.likelihood_share) * log_now

    def _chance(
        self, basis: Array, further: Array, now: VarianceComponents, alone: VarianceComponents
    ) -> float:
        """Return the probability that wander alone makes an effect look so much better than itself.

        A walk that goes one way looks like a drift, and how often it does depends on its size and on the poses: the
        ratio of both likelihoods is drawn as if wander were all (Cox's test of separate families, by simulation). Only
        what the residuals leave of the variance changes from draw to draw.
        """
        N = VARIANCES.draws
        columns = self.motion.columns
        shape = (*columns.shape[:2], -1)
        deviations = _deviations_of(now.names, now.sizes, now.time, self.groups, self.motion.dof)
        drawn = self.motion.drawn(deviations, N, np.random.default_rng(0))
        every = np.concatenate(
            [basis.reshape(shape), further.reshape(shape), self.residual.reshape(shape), drawn], axis=2
        )
        moments = Moments(self.motion, every)
        q, k = basis.shape[1], further.shape[1]

        def left(found: VarianceComponents, fixed: int) -> Array:
            by = _deviations_of(found.names, found.sizes, found.time, self.groups, self.motion.dof)
            products = moments.inverse(by).products
            A, B = products[:fixed, :fixed], products[:fixed, q + k :]
            explained = np.sum(B * np.linalg.solve(A, B), axis=0) if fixed else 0.0
            return np.asarray(np.diagonal(products)[q + k :] - explained)

        better = left(now, q) / left(alone, q + k)
        return float(1 + np.count_nonzero(better[1:] >= better[0])) / (N + 1)

    def _products(self, basis: Array, seen: Sequence[Array], now: VarianceComponents) -> tuple[Array, Array]:
        """Return the products of basis, effects and residual, as readings are taken to be now, and independent."""
        columns = np.concatenate([basis, *seen, self.residual[:, None]], axis=1)
        moments = Moments(self.motion, columns.reshape(*self.motion.columns.shape[:2], -1))
        deviations = _deviations_of(now.names, now.sizes, now.time, self.groups, self.motion.dof)
        return moments.inverse(deviations).products, moments.square

    def _promising(self, q: int, seen: Sequence[Array], products: Sequence[Array]) -> list[tuple[int, float]]:
        """Return the effects that explain most, if readings are as they are taken to be now, or were independent.

        With the logarithm of the probability of the former.
        """
        chosen: dict[int, float] = {}
        both = [
            {i: log + self.log_tries[i] for i, log in _log_ps(of, q, seen, self.readings).items()}
            for of in products
        ]
        for logs in both:
            some: list[int] = []
            for i in sorted(logs, key=lambda i: logs[i]):
                if len(some) < VARIANCES.tried and not any(_alike(seen[i], seen[j]) for j in some):
                    some.append(i)
                    chosen[i] = both[0].get(i, 0.0)
        return list(chosen.items())


def _visible_parts(basis: Array, effects: Sequence[Array]) -> list[Array]:
    """Return an orthonormal basis of what each of several effects does outside of a space."""
    if not effects:
        return []
    ends = np.cumsum([effect.shape[1] for effect in effects])[:-1]
    rest = np.split(project_out(basis, np.concatenate(effects, axis=1)), ends, axis=1)
    return [directions_above(columns, VARIANCES.visible) for columns in rest]


def _alike(one: Array, other: Array) -> bool:
    """Return whether two orthonormal bases span nearly the same space, as one effect with two periods does."""
    return one.shape == other.shape and float(np.sum((one.T @ other) ** 2)) > VARIANCES.alike * one.shape[1]


def _log_ps(products: Array, q: int, seen: Sequence[Array], readings: int) -> dict[int, float]:
    """Return the logarithm of the probability of F of each effect, from products of [fixed, effects, residual]."""
    left = _left(products, q)
    total, found, start = float(left[-1, -1]), {}, 0
    for i, u in enumerate(seen):
        k = u.shape[1]
        of = slice(start, start + k)
        start += k
        if not k or readings - q - k < 1 or total <= 0:
            continue
        along = left[of, -1]
        fall = float(along @ lstsq(left[of, of], along, relative=1e-10))
        found[i] = _log_p(fall / total, k, readings - q - k)
    return found


def _left(products: Array, q: int) -> Array:
    """Return what the first q columns leave of products of columns."""
    A, B = products[:q, :q], products[:q, q:]
    return np.asarray(products[q:, q:] - (B.T @ np.linalg.solve(A, B) if q else 0.0))


def _together(seen: Sequence[Array], some: Sequence[int]) -> Array:
    """Return an orthonormal basis of what some effects do together."""
    if len(some) == 1:
        return seen[some[0]]
    return directions_above(np.concatenate([seen[i] for i in some], axis=1), VARIANCES.visible)


def _log_p(part: float, k: int, residual_dof: int) -> float:
    """Return the logarithm of the probability that k columns explain such a part by chance; at least that of 1e-300."""
    return max(log_p_of_fall(part, max(1 - part, 0.0), k, residual_dof), float(np.log(SMALLEST_P)))


@dataclass(frozen=True)
class VarianceComponents:
    """Variance components where the restricted likelihood is largest."""

    names: tuple[str, ...]
    """``"pose t"``, ``"wander r"``, ...: kind of component, and group of degrees of freedom that share it."""
    sizes: tuple[float, ...]
    """Standard deviation of each, in those of a reading's own error."""
    time: float
    """Correlation time of the wander."""
    likelihood: float
    """Logarithm of the restricted likelihood."""
    variance: float
    """Of a reading's own error."""
    gain: float = 0.0
    """By how much twice the logarithm exceeds that of independent readings."""


def _deviations_of(
    names: Sequence[str], sizes: Sequence[float], time: float, groups: dict[str, slice], dof: int
) -> MotionDeviations:
    by = {"pose": np.zeros(dof), "wander": np.zeros(dof)}
    for name, size in zip(names, sizes, strict=True):
        what, group = name.split()
        by[what][groups[group]] = size
    return MotionDeviations(by["pose"], by["wander"], time)


def _nowhere() -> tuple[Array, Array]:
    """Raise, where derivatives are asked for at a place without a likelihood."""
    raise AssertionError("no climb goes where the likelihood is not defined")


class RestrictedLikelihood:
    """The restricted likelihood of variance components, and its maxima.

    Parameters
    ----------
    moments : Moments
        Of an orthonormal basis of fixed effects, of further ones, and of the residuals last.
    fixed : int
        Number of fixed effects that are not further ones: what they explain is no evidence of anything.
    groups : mapping of str to slice
        Degrees of freedom that share a variance.
    """

    def __init__(
        self, moments: Moments, readings: int, fixed: int, groups: dict[str, slice], poses: Poses
    ) -> None:
        self.moments = moments
        self.fixed = fixed
        self.dof = readings - fixed
        self.groups = groups
        self.poses = poses
        self.count = moments.gram.shape[1]

    def deviations(self, found: VarianceComponents) -> MotionDeviations:
        """Return the standard deviation along each degree of freedom."""
        return _deviations_of(found.names, found.sizes, found.time, self.groups, self.count)

    def at(self, names: Sequence[str], sizes: Sequence[float], time: float) -> VarianceComponents:
        """Evaluate the restricted likelihood, of which the variance of the readings' own errors is the best."""
        return self._evaluated(names, sizes, time)[0]

    def _evaluated(
        self, names: Sequence[str], sizes: Sequence[float], time: float
    ) -> tuple[VarianceComponents, Callable[[], tuple[Array, Array]]]:
        """Return the same, and a function of its slope and average information by the logarithms of sizes and time."""
        there = VarianceComponents(tuple(names), tuple(sizes), time, -np.inf, 1.0)
        deviations = _deviations_of(names, sizes, time, self.groups, self.count)
        try:
            inverse = self.moments.inverse(deviations)
            triangle = np.linalg.cholesky(inverse.products)  # its last entry: what the fixed effects leave
        except np.linalg.LinAlgError:
            return there, _nowhere
        diagonal = np.diagonal(triangle)
        variance = float(diagonal[-1] ** 2) / self.dof
        if not variance > 0:
            return there, _nowhere
        of_fixed = float(np.sum(np.log(diagonal[: self.fixed])))
        likelihood = -0.5 * (self.dof * np.log(variance) + inverse.log_determinant) - of_fixed

        def derivatives() -> tuple[Array, Array]:
            # d log |XᵀV⁻¹X| and d log(left) are both traces of d(CᵀV⁻¹C), between columns of the inverse triangle
            root = np.linalg.inv(triangle)
            roots = root.T[:, [*range(self.fixed), -1]]
            roots[:, -1] *= np.sqrt(self.dof)
            change = inverse.change(roots, self._together(names))
            across = root @ change.products
            return -0.5 * change.slope, 0.5 * (change.square - across.T @ across)

        return replace(there, likelihood=likelihood, variance=variance), derivatives

    def within_error(self, found: VarianceComponents) -> list[tuple[MotionDeviations, MotionDeviations]]:
        """Return deviations one standard error of their estimates away, to both sides along independent directions.

        Parameters
        ----------
        found : VarianceComponents
            Where the likelihood is largest; what is at a limit there stays.
        """
        timed = [found.time] if any(name.startswith("wander") for name in found.names) else []
        at = np.log([*found.sizes, *timed])
        low = np.log([*[VARIANCES.smallest] * len(found.sizes), *[self.shortest for _ in timed]])
        high = np.log([*[VARIANCES.largest] * len(found.sizes), *[self.longest for _ in timed]])
        free = np.flatnonzero((at > low) & (at < high))
        _, information = self._evaluated(found.names, found.sizes, found.time)[1]()
        if not len(free) or not np.isfinite(information).all():
            return []

        def moved(step: Array) -> MotionDeviations:
            values = np.exp(np.clip(at + step, low, high)).tolist()
            time = values[-1] if timed else np.inf
            return _deviations_of(found.names, values[: len(found.sizes)], time, self.groups, self.count)

        values, vectors = eigh(information[np.ix_(free, free)])
        steps = np.zeros((len(values), len(at)))
        steps[:, free] = (vectors / np.sqrt(np.maximum(values, 0.0) + VARIANCES.widest**-2)).T
        return [(moved(step), moved(-step)) for step in steps]

    def _together(self, names: Sequence[str]) -> Array:
        """Return which deviations change with that of each component; the time of a wander is the last."""
        timed = any(name.startswith("wander") for name in names)
        found = np.zeros((2 * self.count + 1, len(names) + timed))
        for i, (what, group) in enumerate(map(str.split, names)):
            start = {"pose": 0, "wander": self.count}[what]
            found[start : start + self.count][self.groups[group], i] = 1.0
        if timed:
            found[-1, -1] = 1.0
        return found

    def best(self, *, pose: bool, wander: bool = True) -> VarianceComponents:
        """Add the part that is worth more, then the other, while they are worth it; only those that are asked for."""
        now = self.at((), (), np.inf)
        waiting: dict[str, Callable[[VarianceComponents], VarianceComponents]] = {}
        if wander:
            times = np.geomspace(self.shortest, self.longest, 6)[1:]
            waiting["wander"] = lambda now: self._with(now, "wander", times, (0.4, 1.5))
        if pose:
            waiting["pose"] = lambda now: self._with(now, "pose", [now.time], (0.5, 2.0))
        while waiting:
            tried = {name: add(now) for name, add in waiting.items()}
            gains = {
                name: 2 * (there.likelihood - now.likelihood) - VARIANCES.gain[name]
                for name, there in tried.items()
            }
            name = max(gains, key=lambda x: gains[x])
            if not gains[name] > 0:
                break
            now = tried[name]
            del waiting[name]
        return now

    def again(self, now: VarianceComponents) -> VarianceComponents:
        """Climb with the components that there are, from where they are or from nearly nothing: the likelier of both.

        From either the same maximum was reached in 240 of 240 climbs, for simulated machines of 21 kinds.
        """
        little = [min(size, 4 * VARIANCES.smallest) for size in now.sizes]
        starts = [self.at(now.names, sizes, now.time) for sizes in (now.sizes, little)]
        return self._climbed(max(starts, key=lambda x: x.likelihood))

    def _with(
        self, now: VarianceComponents, part: str, times: Iterable[float], sizes: Sequence[float]
    ) -> VarianceComponents:
        """Climb with a further part of each group, from the likeliest of some times and sizes."""
        names = tuple(f"{part} {group}" for group in self.groups)
        started = [
            self.at((*now.names, *names), (*now.sizes, *[size] * len(names)), time)
            for time in times
            for size in sizes
        ]
        return self._climbed(max(started, key=lambda x: x.likelihood))

    @property
    def shortest(self) -> float:
        """The least correlation time."""
        return self.poses.spacing

    @property
    def longest(self) -> float:
        """The greatest correlation time."""
        return max(VARIANCES.longest * self.poses.duration, 4 * self.shortest)

    def _climbed(self, start: VarianceComponents) -> VarianceComponents:
        """Climb to a maximum; parts that are negligible there are removed."""
        timed = any(name.startswith("wander") for name in start.names)
        low = np.log([*[VARIANCES.smallest / 3] * len(start.sizes), *[self.shortest] * timed])
        high = np.log([*[VARIANCES.largest] * len(start.sizes), *[self.longest] * timed])
        best = start

        def likelihood(x: Array) -> tuple[float, Callable[[], tuple[Array, Array]]]:
            nonlocal best
            values = np.exp(x).tolist()
            time = values[-1] if timed else np.inf
            there, derivatives = self._evaluated(start.names, values[: len(start.sizes)], time)
            if there.likelihood > best.likelihood:
                best = there
            return there.likelihood, derivatives

        climb(likelihood, np.log([*start.sizes, *[start.time] * timed]), low, high, rise=VARIANCES.rise)
        kept = [i for i, size in enumerate(best.sizes) if size > VARIANCES.smallest]
        if len(kept) == len(best.sizes):
            return best
        return self.at([best.names[i] for i in kept], [best.sizes[i] for i in kept], best.time)


# The maximum of a smooth function of a few variables in a box, where an evaluation costs a millisecond.
#
# Newton's method with derivatives and an estimate of the curvature that is never negative, as the information of a
# likelihood is (Nocedal and Wright 2006, chapters 3 and 16). Variables that a bound holds back wait.


Function: TypeAlias = Callable[[Array], tuple[float, Callable[[], tuple[Array, Array]]]]

LONGEST = 1.0
"""Step of one variable: far from the maximum second derivatives tell little."""
FLATTEST = 1e-6
"""Part of the largest curvature that is added to all: along a direction without any a step is to stay finite."""
ITERATIONS, HALVINGS = 25, 6
SUFFICIENT = 1e-4
"""Part of the predicted rise that a step must bring (Armijo 1966)."""


def climb(function: Function, start: Array, low: Array, high: Array, *, rise: float) -> Array:
    """Return where a function is largest, near a start, (n,).

    Parameters
    ----------
    function : callable
        From (n,) to a number, -inf where it is not defined, and to a function that returns the derivatives there, (n,),
        and the curvature, (n, n): about minus the second derivatives, positive semidefinite.
    start : ndarray, shape (n,)
    low, high : ndarray, shape (n,)
        Bounds.
    rise : float
        The climb ends where a step promises less than this.
    """
    x = np.clip(start, low, high)
    value, derivatives = function(x)
    if not np.isfinite(value):
        return x
    for _ in range(ITERATIONS):
        slope, curvature = derivatives()
        if not (np.isfinite(slope).all() and np.isfinite(curvature).all()):
            break  # beyond the range of numbers no step is known
        free = ~(((x <= low) & (slope < 0)) | ((x >= high) & (slope > 0)))
        if not free.any():
            break
        step = np.zeros(len(x))
        step[free] = _newton(slope[free], curvature[np.ix_(free, free)])
        if slope @ step < rise:
            break
        for _ in range(HALVINGS):
            there = np.clip(x + step, low, high)
            reached, derivatives = function(there)
            if reached > value + SUFFICIENT * slope @ (there - x):
                break
            step = step / 3
        else:
            break
        x, value = there, reached
    return x


def _newton(slope: Array, curvature: Array) -> Array:
    """Return the step to where the slope vanishes, damped so that no variable moves by more than `LONGEST`."""
    values, vectors = eigh(curvature)
    along = vectors.T @ slope
    damping = max(FLATTEST * float(values[-1]), 1e-300)
    while True:
        step = vectors @ (along / (np.maximum(values, 0.0) + damping))
        if np.abs(step).max() <= LONGEST:
            return np.asarray(step)
        damping *= 4
