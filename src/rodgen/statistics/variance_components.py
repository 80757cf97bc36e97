"""Variance components of readings that depend on each other, by restricted maximum likelihood (REML).

A machine does not repeat a pose exactly, which all readings of the pose share; a position that is read again has the
same errors again; runs differ; and a set-up wanders while it is measured. To a test that takes readings for
independent, all of these look like effects. Each is a motion of the set-up with a variance of its own, estimated by
restricted maximum likelihood (Patterson and Thompson 1971) with the columns of the model as fixed effects. They compete
with each other, and with the effects that a diagnosis knows, in one currency:

    cost = -2 ln L + ln(n) (number of variances, times and columns) + 2 ln(number of effects tried),

n the degrees of freedom (Schwarz 1978). The cheapest set is taken; so a missing effect is not taken for a drift, nor a
drift for an effect.

Whether there is anything at all is seen at independent readings, from sums over poses, positions, runs and stretches of
time only: what a component is worth there by the likelihood ratio of a balanced design.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.statistics.columns import directions_above, falls_from_products, orthonormal_basis, project_out
from rodgen.statistics.decompositions import eigh, lstsq
from rodgen.statistics.whitening import Moments, MotionDeviations, SharedMotion, Weighted, Whitener, sums

MOST_EFFECTS = 6
"""Most effects that are taken as fixed, one after the other."""
TRIED = 3
"""Effects whose likelihood is evaluated at each step: those of which the columns promise most."""
VISIBLE = 1e-3
"""Part of a direction of the candidates' columns that must remain outside of the others for a column of its own."""
SMALLEST = 0.03
"""Standard deviation, relative to that of a reading's independent error, below which a component is zero."""
LARGEST = 1e5
"""The same, at most: markers that are one body, whose pose was measured, share an error of a thousand times what
their digits leave between them. With a lower bound what they do not scatter against each other makes the variance
of a pose too small, by half for three points; beyond it, rounding decides (1e-5 squared leaves six digits)."""
LONGEST_VARIANCE = 5.0
"""Correlation time, in durations of a run, beyond which the wander is a random walk."""

LONGEST = 1.5
"""Step of a logarithm at most: far from the maximum the information tells little."""
FLATTEST = 1e-3
"""Information at least: a direction without any is not followed to infinity."""
CLIMBS, HALVINGS = 15, 4
"""Steps of a climb, and shorter trials of one, at most; three to five steps are usual."""
OF_STRETCH = (1 + math.exp(-2)) / 2
"""Part of the variance of what wanders that the mean over two correlation times has."""
NEAR = 1e-4
"""Step in logarithms of sizes and time between which slopes are compared: the root of their rounding, and more."""
RISE = 0.01
"""Log likelihood that a step promises, below which a climb ends: a tenth of a standard error. And what further or fewer
components must lower the cost by: by less two sets could take turns for ever."""
SAME = 1e-10
"""Part of a sum of squares that is rounding."""


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
    price: float = 0.0
    """What as many variances cost."""
    information: Array | None = None
    """Of the logarithms of the sizes and, where there is a wander, of its time."""
    slope: Array | None = None
    """Of the likelihood by the same."""

    @property
    def wanders(self) -> bool:
        """Whether something wanders."""
        return any(name.startswith("wander") for name in self.names)

    @property
    def cost(self) -> float:
        """-2 ln of the likelihood, and the price of their number."""
        return self.price - 2 * self.likelihood

    def deviations(
        self, groups: dict[str, slice], dof: int, factors: Array | None = None
    ) -> MotionDeviations:
        """Return the standard deviation along each degree of freedom.

        Parameters
        ----------
        factors : ndarray, optional
            What the sizes and the time are multiplied by.
        """
        by = {kind: np.zeros(dof) for kind in ("pose", "wander", "position", "run")}
        factors = np.ones(len(self.sizes) + 1) if factors is None else factors
        for name, size, factor in zip(self.names, self.sizes, factors[: len(self.sizes)], strict=True):
            kind, group = name.split()
            by[kind][groups[group]] = size * factor
        time = self.time * float(factors[-1]) if self.wanders else self.time
        return MotionDeviations(by["pose"], by["wander"], time, by["position"], by["run"])


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
    least : float
        Least variance of a reading's own error.
    """

    def __init__(
        self,
        moments: Moments,
        readings: int,
        fixed: int,
        groups: dict[str, slice],
        least: float = 0.0,
    ) -> None:
        self.moments = moments
        self.fixed = fixed
        self.dof = readings - fixed
        self.groups = groups
        self.poses = moments.poses
        self.count = moments.gram.shape[1]
        self.least = least
        self.price = float(np.log(max(self.dof, 2)))
        """What a variance, or a column, costs."""

    def deviations(self, components: VarianceComponents) -> MotionDeviations:
        """Return the standard deviation along each degree of freedom."""
        return components.deviations(self.groups, self.count)

    def at(self, names: Sequence[str], sizes: Sequence[float], time: float) -> VarianceComponents:
        """Evaluate the restricted likelihood, of which the variance of the readings' own errors is the best."""
        return self._weighed(_unweighed(names, sizes, time))[0]

    def _weighed(self, there: VarianceComponents) -> tuple[VarianceComponents, Weighted | None]:
        """Return components with their likelihood, and the products that it was made of; None where it is zero."""
        try:
            weighted = Weighted(self.moments, self.deviations(there))
        except np.linalg.LinAlgError:
            return there, None
        components = self._likely(
            there, weighted.triangle[weighted.levels :, weighted.levels :], weighted.log_determinant
        )
        return components, weighted if components.variance > 0 else None

    def _likely(
        self, there: VarianceComponents, triangle: NDArray[np.floating[Any]], log_determinant: float
    ) -> VarianceComponents:
        """Return components with their likelihood, from the triangle of the columns' products."""
        diagonal = triangle.diagonal()
        left = float(diagonal[-1] ** 2)  # what the fixed effects leave
        variance = max(left / self.dof, self.least)
        if not variance > 0:
            return replace(there, variance=0.0)
        of_fixed = float(np.sum(np.log(diagonal[: self.fixed])))
        excess = left / variance - self.dof  # 0 where the variance is the best
        likelihood = -0.5 * (self.dof * np.log(variance) + excess + log_determinant) - of_fixed
        price = self.price * (len(there.names) + there.wanders)
        return replace(there, likelihood=likelihood, variance=variance, price=price)

    @cached_property
    def independent(self) -> VarianceComponents:
        """No component."""
        none = _unweighed((), (), np.inf)
        return none if self._triangle is None else self._likely(none, self._triangle, 0.0)

    @cached_property
    def _triangle(self) -> Array | None:
        """The triangle of the columns' products; None where they depend on each other."""
        try:
            return np.asarray(np.linalg.cholesky(self.moments.square), float)
        except np.linalg.LinAlgError:
            return None

    def best(self, kinds: Sequence[str]) -> VarianceComponents:
        """Return the cheapest components of some kinds."""
        now = self.independent
        starts = self._starts(kinds)
        while starts:
            best = min((self._pruned(self.climbed(start)) for start in starts), key=lambda x: x.cost)
            if best.cost > now.cost - RISE:
                break
            now = best
            there = {name.split()[0] for name in now.names}
            starts = self._extended(now, [kind for kind in kinds if kind not in there])
        return self._with_curvature(now)

    def _starts(self, kinds: Sequence[str]) -> list[VarianceComponents]:
        """Return a start with each kind of component of which there is a sign."""
        signs: dict[str, dict[str, tuple[float, float, float]]] = {}
        for worth, name, size, time in self.signs(kinds):
            of_kind = signs.setdefault(name.split()[0], {})
            of_kind[name] = max(of_kind.get(name, (0.0, 0.0, 0.0)), (worth, size, time))
        starts = []
        for of_kind in signs.values():
            worth, _, time = max(of_kind.values())
            if worth > self.price:
                starts.append(_unweighed(of_kind, [size for _, size, _ in of_kind.values()], time))
        return starts

    def _extended(self, now: VarianceComponents, kinds: Sequence[str]) -> list[VarianceComponents]:
        """Return a start with each kind of component more of which there is a sign."""
        starts = []
        for kind in kinds:
            times = (
                np.geomspace(self.shortest, self.longest, 5)[1:].tolist() if kind == "wander" else [now.time]
            )
            worth, start = max((self._sign_beside(now, kind, time) for time in times), key=lambda x: x[0])
            if worth > self.price:
                starts.append(start)
        return starts

    def _sign_beside(
        self, now: VarianceComponents, kind: str, time: float
    ) -> tuple[float, VarianceComponents]:
        """Return the square of the slope over its standard deviation, at next to none of a kind, and a start.

        All other sizes, and the time, go where they are likeliest (the score test of Rao 1948).
        """
        names = [f"{kind} {group}" for group in self.groups]
        sizes = (*now.sizes, *[SMALLEST] * len(names))
        there, weighted = self._weighed(_unweighed((*now.names, *names), sizes, time))
        of, known = slice(len(now.sizes), len(sizes)), len(sizes) + now.wanders
        slope, information = (x[..., :known] for x in self._derivatives(there, weighted))
        rounding = known * float(np.finfo(float).eps)
        inverse = lstsq(information[:known], np.eye(known), relative=rounding)
        step, spread = (inverse @ slope)[of], inverse.diagonal()[of]
        rising = np.flatnonzero((step > 0) & (spread > 0))
        trial_sizes = np.clip(SMALLEST * np.sqrt(1 + 2 * step[rising]), 4 * SMALLEST, LARGEST)
        start = _unweighed(
            (*now.names, *(names[i] for i in rising)), (*now.sizes, *trial_sizes.tolist()), time
        )
        return float(np.max(step[rising] ** 2 / spread[rising], initial=0.0)), start

    def _pruned(self, now: VarianceComponents) -> VarianceComponents:
        """Return the components without those that are not worth their price in addition to the others."""
        while len(now.names) > 1:
            fewer = min((self._without(now, i) for i in range(len(now.names))), key=lambda x: x.cost)
            best = fewer if fewer.cost > now.cost + 2 * self.price else self.climbed(fewer)
            if best.cost > now.cost - RISE:
                break
            now = best
        return now

    def _without(self, now: VarianceComponents, i: int) -> VarianceComponents:
        names, sizes = now.names[:i] + now.names[i + 1 :], now.sizes[:i] + now.sizes[i + 1 :]
        return self.at(names, sizes, now.time)

    def near(self, now: VarianceComponents) -> VarianceComponents:
        """Return the components that there are, or less of them: the likelier, from where :meth:`climbed` leads on."""
        if not now.names:
            return self.independent
        starts = [self.at(now.names, [part * x for x in now.sizes], now.time) for part in (1.0, 0.4, 0.1)]
        return max(starts, key=lambda x: x.likelihood)

    @property
    def shortest(self) -> float:
        """The least correlation time."""
        return self.poses.spacing

    @property
    def longest(self) -> float:
        """The greatest correlation time."""
        return max(LONGEST_VARIANCE * self.poses.duration, 4 * self.shortest)

    # whether there is anything: a balanced design, at independent readings

    def signs(self, kinds: Sequence[str]) -> Iterator[tuple[float, str, float, float]]:
        """Yield, of each component, by how much it raises twice the log likelihood, its name, and a start.

        The start is a size and a time. A wander is seen by what stretches of time share, of 2, 4, 8, ... poses.
        """
        if self._triangle is None:
            return
        onto = self.moments.onto @ np.linalg.inv(self._triangle).T  # of orthonormal columns
        products = np.concatenate([self.moments.gram, onto], axis=2)
        for kind in kinds:
            if kind != "wander":
                level = None if kind == "pose" else getattr(self.poses, kind)
                yield from self._signs_of(kind, products if level is None else sums(products, level), np.inf)
                continue
            sums_of, counts, time = products, np.bincount(self.poses.run), self.poses.spacing / 2
            while counts.max() > 1 and len(sums_of) > 2:
                if (odd := counts % 2 > 0).any():
                    sums_of = np.insert(sums_of, np.cumsum(counts)[odd], 0.0, axis=0)
                sums_of, counts, time = sums_of[::2] + sums_of[1::2], (counts + 1) // 2, 2 * time
                yield from self._signs_of(kind, sums_of, time)

    def _signs_of(self, kind: str, products: Array, time: float) -> Iterator[tuple[float, str, float, float]]:
        """Yield signs from the products of each level's motion with all motions and columns, (levels, k, k + K).

        With A = P H Hᵀ P, P the projection onto what the fixed effects leave, the component has f = (tr A)² / tr A²
        directions (Satterthwaite 1946), on each of which it adds c = tr A² / tr A times its variance. Where all are
        alike the likelihood is greatest at the ratio of the mean squares of both kinds of directions.
        """
        n = self.dof
        for group, of in self.groups.items():
            g, o, z = products[:, of, of], products[:, of, self.count : -1], products[:, of, -1]
            flat = o.reshape(o.shape[0] * o.shape[1], o.shape[2])
            inner = flat.T @ flat
            mean = float(np.einsum("lii->", g)) - float(inner.trace())
            square = float(np.vdot(g, g)) - 2 * float(np.vdot(o, g @ o)) + float(np.vdot(inner, inner))
            if not (mean > 0 and square > SAME * mean**2):
                continue
            f, along = mean**2 / square, n * float(np.vdot(z, z)) / mean  # mean square, of 1 in all
            rest = max(n - f, SAME * n)
            others = max(n - f * along, SAME * n) / rest
            if along > others:
                worth = -f * math.log(along) - rest * math.log(others)
                size = math.sqrt(
                    (along / others - 1) * mean / square / (OF_STRETCH if kind == "wander" else 1)
                )
                size = min(max(size, 4 * SMALLEST), LARGEST)
                yield worth, f"{kind} {group}", size, min(time, self.longest)

    # maxima

    def climbed(self, start: VarianceComponents) -> VarianceComponents:
        """Climb to a maximum by logarithms of sizes and time; parts that are negligible there are removed.

        By steps with the average information (Gilmour, Thompson and Cullis 1995), which is never negative, so that
        steps go up; corrected by how the slope changed along the last step (Dennis, Gay and Welsch 1981).
        """
        if not start.names:
            return self.independent
        low = np.log([*[SMALLEST / 3] * len(start.sizes), *[self.shortest] * start.wanders])
        high = np.log([*[LARGEST] * len(start.sizes), *[self.longest] * start.wanders])
        at = np.clip(_logarithms(start), low, high)
        best, weighted = self._moved(start, at)
        before: tuple[Array, Array] | None = None
        for _ in range(CLIMBS):
            slope, information = self._derivatives(best, weighted)
            if before is not None:
                information = _corrected(information, at - before[0], before[1] - slope)
            free = ~(((at <= low) & (slope < 0)) | ((at >= high) & (slope > 0)))
            known = np.diag(np.where(free, 0.0, 1 / SAME))  # what a bound holds has no error
            known[np.ix_(free, free)] = information[np.ix_(free, free)]
            best = replace(best, information=known, slope=slope)
            if not free.any():
                break
            values, vectors = eigh(information[np.ix_(free, free)])
            along = vectors.T @ slope[free]
            step = np.zeros(len(at))
            step[free] = vectors @ (along / np.maximum(values, FLATTEST))
            step *= min(1.0, LONGEST / max(float(np.abs(step).max()), LONGEST))
            if slope @ step < RISE:
                break
            for _ in range(HALVINGS):
                to = np.clip(at + step, low, high)
                there, further = self._moved(best, to)
                if there.likelihood > best.likelihood:
                    break
                step = step / 4
            else:
                break
            before, at, best, weighted = (at, slope), to, there, further
        positive = [i for i, size in enumerate(best.sizes) if size > SMALLEST]
        if len(positive) == len(best.sizes):
            return best
        return self.climbed(
            _unweighed([best.names[i] for i in positive], [best.sizes[i] for i in positive], best.time)
        )

    def _with_curvature(self, now: VarianceComponents) -> VarianceComponents:
        """Return a maximum with its observed information, by differences of the slope.

        The average information stays where that is not positive, and of what a bound holds.
        """
        if now.information is None or now.slope is None:
            return now
        at, free = _logarithms(now), np.flatnonzero(now.information.diagonal() < 1 / SAME)
        falls = [
            now.slope - self._derivatives(*self._moved(now, at + NEAR * unit))[0]
            for unit in np.eye(len(at))[free]
        ]
        curvature = np.array(falls).reshape(len(free), len(at))[:, free] / NEAR
        curvature = (curvature + curvature.T) / 2
        if not np.isfinite(curvature).all() or eigh(curvature)[0].min(initial=np.inf) <= FLATTEST:
            return now
        information = now.information.copy()
        information[np.ix_(free, free)] = curvature
        return replace(now, information=information)

    def _moved(
        self, now: VarianceComponents, logarithms: Array
    ) -> tuple[VarianceComponents, Weighted | None]:
        values = tuple(np.exp(logarithms).tolist())
        count = len(now.names)
        time = values[count] if now.wanders else np.inf
        return self._weighed(replace(now, sizes=values[:count], time=time, likelihood=-np.inf))

    def _derivatives(self, now: VarianceComponents, weighted: Weighted | None) -> tuple[Array, Array]:
        """Return the slope and the information by logarithms of sizes and time; zeros where there is no likelihood."""
        parts = [(kind, self.groups[group]) for kind, group in map(str.split, now.names)]
        parts += [("time", slice(None))] * now.wanders
        if weighted is None:
            return np.zeros(len(parts)), np.zeros((len(parts), len(parts)))
        return weighted.score(parts, self.fixed, now.variance, profiled=now.variance > self.least)


def _unweighed(names: Iterable[str], sizes: Iterable[float], time: float) -> VarianceComponents:
    """Return components of which the likelihood is not known yet."""
    components = VarianceComponents(tuple(names), tuple(sizes), time, -np.inf, 1.0)
    return components if components.wanders else replace(components, time=np.inf)


def _corrected(information: Array, step: Array, fall: Array) -> Array:
    """Return information that is right along a step, by how much the slope falls there: an update of BFGS."""
    along = information @ step
    if not min(float(step @ fall), float(step @ along)) > 0:
        return information
    return np.asarray(
        information - np.outer(along, along) / (step @ along) + np.outer(fall, fall) / (step @ fall)
    )


def _logarithms(components: VarianceComponents) -> Array:
    return np.log([*components.sizes, *[components.time] * components.wanders])


# Components and effects together.


class VarianceEstimator:
    """Estimates variance components, with the effects that the data call for as fixed effects.

    Parameters
    ----------
    motion : SharedMotion
    groups : mapping of str to slice
        Degrees of freedom that share a variance.
    adjusted : ndarray, shape (N, q)
        Orthonormal basis of the model's columns.
    effects : sequence of ndarray, each of shape (N, k)
        Columns of candidates, of length 1.
    residual : ndarray, shape (N,)
        Where there are effects: without what the model's columns explain.
    tries : sequence of float, optional
        Number of independent tests that the values tried for each effect amount to; left out: one of each.
    least : float
        Least variance of a reading's own error.
    """

    def __init__(
        self,
        motion: SharedMotion,
        groups: dict[str, slice],
        adjusted: Array,
        effects: Sequence[Array],
        residual: Array,
        readings: int,
        tries: Sequence[float] | None = None,
        least: float = 0.0,
    ) -> None:
        self.log_tries = np.log(np.ones(len(effects)) if tries is None else tries)
        self.motion, self.groups, self.least = motion, groups, least
        self.own, self.effects, self.residual, self.readings = adjusted, effects, residual, readings

    def best(self, kinds: Sequence[str], alone: VarianceComponents | None = None) -> VarianceComponents:
        """Return the cheapest components of some kinds; none where readings are independent.

        Parameters
        ----------
        alone : VarianceComponents, optional
            Those without any effect, where they are known.
        """
        likelihood = self._likelihood(self.own, np.zeros((len(self.own), 0)))
        components = alone or likelihood.best(kinds)
        if components.names and self.effects:
            fixed = self._called_for(components, kinds)
            if fixed.shape[1]:
                adjusted = np.concatenate([self.own, fixed], axis=1)
                likelihood = self._likelihood(adjusted, fixed[:, :0])
                components = likelihood.best(kinds)
        return replace(components, gain=2 * (components.likelihood - likelihood.independent.likelihood))

    def _likelihood(self, fixed: Array, further: Array) -> RestrictedLikelihood:
        whole = np.concatenate([fixed, further, self.residual[:, None]], axis=1)
        moments = Moments(self.motion, whole.reshape(*self.motion.columns.shape[:2], -1))
        return RestrictedLikelihood(moments, self.readings, fixed.shape[1], self.groups, self.least)

    def _called_for(self, components: VarianceComponents, kinds: Sequence[str]) -> Array:
        """Return an orthonormal basis of the effects of the cheapest set of effects and components.

        The set is grown from the components without any effect, one effect after the other; and from independent
        readings, with components afterwards: what wanders takes what several small effects do together, and shrinks
        only once they are all there.
        """
        seen = _visible_parts(self.own, self.effects)
        first = self._grown(seen, components, [])
        none = self._likelihood(self.own, self.own[:, :0]).independent
        _, alone, _ = self._grown(seen, none, [])
        further = _together(seen, alone)
        second = self._grown(seen, self._likelihood(self.own, further).best(kinds), alone) if alone else first
        _, chosen, _ = min(first, second, key=lambda x: x[0])
        return _together(seen, chosen)

    def _grown(
        self, seen: Sequence[Array], components: VarianceComponents, chosen: list[int]
    ) -> tuple[float, list[int], VarianceComponents]:
        """Add effects while the cost falls, then remove those not worth theirs; return cost, effects and components."""
        cost = self._cost(seen, chosen, components)
        while len(chosen) < MOST_EFFECTS:
            tried = []
            for i in self._promising(seen, components, chosen):
                likelihood = self._likelihood(self.own, _together(seen, [*chosen, i]))
                start = likelihood.near(components)
                tried.append((self._cost(seen, [*chosen, i], start), i, likelihood, start))
            if not tried:
                break
            _, best, likelihood, start = min(tried, key=lambda x: x[0])
            there = likelihood.climbed(start)
            if (less := self._cost(seen, [*chosen, best], there)) >= cost:
                break
            cost, components, chosen = less, there, [*chosen, best]
        for i in list(chosen):
            fewer = [j for j in chosen if j != i]
            likelihood = self._likelihood(self.own, _together(seen, fewer))
            there = likelihood.climbed(likelihood.near(components))
            if (less := self._cost(seen, fewer, there)) < cost:
                cost, chosen, components = less, fewer, there
        return cost, chosen, components

    def _cost(self, seen: Sequence[Array], chosen: Sequence[int], components: VarianceComponents) -> float:
        price = np.log(max(self.readings - self.own.shape[1], 2))
        effects = sum(price * seen[i].shape[1] + 2 * (self.log_tries[i] + np.log(len(seen))) for i in chosen)
        return float(components.cost + effects)

    def _promising(self, seen: Sequence[Array], now: VarianceComponents, chosen: Sequence[int]) -> list[int]:
        """Return the effects that lower the cost most, as readings are taken to be now, or were independent."""
        base = np.concatenate([seen[0][:, :0], *(seen[i] for i in chosen)], axis=1)
        columns = np.concatenate([*seen, self.residual[:, None]], axis=1)
        sizes = np.array([u.shape[1] for u in seen])
        dof = self.readings - self.own.shape[1] - base.shape[1]
        promising: list[int] = []
        views = [(base, columns)]  # the model's columns explain nothing of them
        if now.names:
            whitener = Whitener(self.motion, now.deviations(self.groups, self.motion.dof))
            whole = np.concatenate([self.own, base, columns], axis=1)
            white = whitener(whole.reshape(*self.motion.columns.shape[:2], -1)).reshape(whole.shape)
            views.append((white[:, : -columns.shape[1]], white[:, -columns.shape[1] :]))
        for basis, rest in views:
            if basis.shape[1]:
                rest = project_out(orthonormal_basis(basis), rest)
            total = float(rest[:, -1] @ rest[:, -1])
            if dof - sizes.max(initial=0) < 1 or not total > 0:
                continue
            left = np.maximum(total - _falls(rest[:, :-1], rest[:, -1], sizes), SAME * total)
            worth = dof * np.log(total / left) - np.log(dof) * sizes - 2 * self.log_tries
            worth[[*chosen, *np.flatnonzero(sizes == 0)]] = -np.inf
            best = np.argsort(-worth)[:TRIED]
            promising += [int(i) for i in best if worth[i] > 2 * np.log(len(seen)) and i not in promising]
        return promising


def _visible_parts(basis: Array, effects: Sequence[Array]) -> list[Array]:
    """Return an orthonormal basis of what each of several effects does outside of a space."""
    ends = np.cumsum([effect.shape[1] for effect in effects])[:-1]
    rest = np.split(project_out(basis, np.concatenate(effects, axis=1)), ends, axis=1)
    return [directions_above(columns, VISIBLE) for columns in rest]


def _together(seen: Sequence[Array], some: Sequence[int]) -> Array:
    """Return an orthonormal basis of what some effects do together."""
    if len(some) == 1:
        return seen[some[0]]
    columns = np.concatenate([seen[0][:, :0], *(seen[i] for i in some)], axis=1)
    return directions_above(columns, VISIBLE) if some else columns


def _falls(columns: Array, residual: Array, sizes: Index) -> Array:
    """Return by how much the columns of each of several effects lower the sum of squares of a residual."""
    falls, starts = np.zeros(len(sizes)), np.cumsum(sizes) - sizes
    pull = columns.T @ residual
    for k in np.unique(sizes[sizes > 0]):
        which = np.flatnonzero(sizes == k)
        at = starts[which][:, None] + np.arange(k)
        blocks = columns.T[at]  # (effects, k, N)
        falls[which] = falls_from_products(blocks @ np.swapaxes(blocks, 1, 2), pull[at], relative=SAME)
    return falls
