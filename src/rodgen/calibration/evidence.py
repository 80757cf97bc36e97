"""The evidence: how probable a set of effects is, given the readings of a fit.

Of the whitened residuals only what the fitted parameters cannot imitate counts: y = X θ + noise, with the columns X of
the candidates. An effect's sizes are N(0, width²), and the width has a Cauchy distribution of the usual size: sizes of
one unit are large or small together. The variance σ² of a reading is profiled, but never below what the imperfection of
formulas leaves. Then, with the eigenvalues Λ of the scaled products XᵀX and the pull u = Xᵀy along their eigenvectors,

    cost(set) = n ln σ² + |y|²/σ² - uᵀ(Λ + σ²)⁻¹u / σ² + ln|1 + Λ/σ²| - 2 ln odds(set)

is -2 ln of the probability of the set, up to a constant (MacKay 1992, Bayesian interpolation; Kass and Raftery 1995,
Bayes factors). Readings of a pose, of a position or of a run share errors, or the set-up wanders (`dependence`). That
competes with the effects: what is estimated beside all candidates, without any effect, and independence are noise
models with columns of their own, and a set costs what it costs with the best of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.candidates import Candidate, candidates
from rodgen.calibration.dependence import INDEPENDENT, Correlation, estimate_correlation
from rodgen.calibration.fitted import Fit
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.data.poses import positions
from rodgen.machines.plausibility import Size
from rodgen.stages import stage
from rodgen.statistics.columns import (
    Whiten,
    falls_from_products,
    orthonormal_basis,
    project_out,
    unchanged,
    unit_diagonal,
)
from rodgen.statistics.decompositions import eigh, solve, svd
from rodgen.statistics.thresholds import COST

SCALES = frozenset({"scale", "instrument_scale", "instrument_axis_scales", "leg_scale"})
"""Effects that multiply a reading."""
EXACT = frozenset({"scale", "servo_lag"})
"""Effects that are numbers of a control: a ratio, and at steady speeds a delay. On an axis alone they are exact."""
FEW_COLUMNS = 2
"""Columns up to which an effect has all of them: a wave has a sine and a cosine. Of more, such as the harmonics of an
error motion, all are there, or each is there or not, which are two choices."""
NARROWEST, WIDEST = 1e-4, 1e6
"""Times that sizes are taken wider than usual at least, where several have one unit, and at most."""
HIDDEN = 1e-7
"""Part of a column that remains beyond the fitted parameters below which it is rounding."""
ROUNDING = 1e-12
"""Part of the largest eigenvalue of products below which a direction is rounding."""


@dataclass(frozen=True, eq=False)
class Space:
    """One noise model: what it makes of whitened columns, and what the fitted parameters imitate there.

    Attributes
    ----------
    basis : ndarray, shape (N, p)
        Orthonormal basis of the fitted parameters' columns.
    residual : ndarray, shape (N,)
        y, without its projection onto the basis.
    imperfect : ndarray, shape (N,)
        The same of y less what exact dimensions explain.
    log_determinant : float
        Of the covariance of y, compared with that of independent readings, and twice the logarithm of the number of
        models that were tried.
    whiten : callable
        Brings columns of weighted readings, (n, m, K), to where their errors are independent.
    """

    basis: Array
    residual: Array
    imperfect: Array
    log_determinant: float
    whiten: Whiten = unchanged

    @classmethod
    def of(
        cls, model: Array, y: Array, imperfect: Array, log_determinant: float, whiten: Whiten = unchanged
    ) -> Space:
        """Return the space of the fitted parameters' columns, (N, p), and of the readings, (N,), all whitened."""
        basis = orthonormal_basis(model)
        return cls(basis, project_out(basis, y), project_out(basis, imperfect), log_determinant, whiten)

    def seen(self, columns: Array) -> Array:
        """Return what of columns of weighted readings, (n, m, K), the fitted parameters do not imitate, (N, K)."""
        return self.beyond(self.whiten(columns).reshape(len(self.residual), -1))

    def beyond(self, columns: Array) -> Array:
        """Return what of whitened columns, (N, K), the fitted parameters do not imitate."""
        return project_out(self.basis, columns)


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of all candidates in one space, and their products."""

    space: Space
    across: Array
    """X, (N, K)."""
    gram: Array
    """XᵀX, (K, K)."""
    pull: Array
    """Xᵀy, (K,)."""
    _falls: dict[bytes, float] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, space: Space, across: Array) -> Columns:
        """Return columns, (N, K), that are beyond the fitted parameters, with their products."""
        return cls(space, across, across.T @ across, across.T @ space.residual)

    def beyond(self, index: Ints, width: Array) -> Columns:
        """Return the columns as if some of them, (q,), of that width, were those of fitted parameters."""
        there = self.across[:, index] * width
        basis, space = orthonormal_basis(there), self.space
        across = project_out(basis, self.across)
        across *= np.linalg.norm(across, axis=0) >= HIDDEN * np.linalg.norm(self.across, axis=0)
        every = np.concatenate([space.basis, basis], axis=1)
        cost = space.log_determinant + _log_determinant(there)
        left, imperfect = (project_out(basis, y) for y in (space.residual, space.imperfect))
        return Columns.of(Space(every, left, imperfect, cost, space.whiten), across)

    def explained(self, index: Ints) -> float:
        """Return by how much some columns, (q,), lower the sum of squares, of directions that are determined."""
        key = index.tobytes()
        if key not in self._falls:
            scaled, length = unit_diagonal(self.gram[np.ix_(index, index)])
            fall = falls_from_products(scaled, self.pull[index] / length, least=COST.visible**2)
            self._falls[key] = float(fall)
        return self._falls[key]

    @property
    def square(self) -> float:
        """|y|²."""
        return float(self.space.residual @ self.space.residual)

    @property
    def imperfect(self) -> float:
        """|y|² without what exact dimensions explain."""
        return float(self.space.imperfect @ self.space.imperfect)


KNOWN = np.dtype(
    [
        ("usual", float),
        ("largest", float),
        ("positive", bool),
        ("relative", bool),
        ("exact", bool),
        ("effect", int),
        ("group", int),
        ("many", bool),
        ("rank", float),
    ]
)
"""What is known of a column before the readings: its usual and largest size, whether it has a sign, whether it
multiplies a reading, and has an exact formula; a number that the columns of an effect share, and one of those with one
usual size; whether the effect has more than few columns; and in the first column of one how many directions the
readings determine of it."""


@dataclass(eq=False)
class Evidence:
    """The residuals of a fit, the columns of every candidate, and the cost of sets of them.

    Attributes
    ----------
    base : Fit
    sensitivities : Sensitivities
    correlation : Correlation
        How readings depend on each other.
    candidates : list of Candidate
        Those that these data may show.
    unseen : list of Candidate
        Those that the fitted parameters imitate all but completely.
    unusable : list of Candidate
        Those whose formula has no finite value in some row.
    dof : int
        Readings less the parameters that were fitted.
    screened : list of Candidate
        All effects of the catalogue that the machine may have.
    dependences : sequence of Correlation
        All that compete.
    curves : bool
        Whether the candidates are curves of several orders, not formulas: their own error is seen as noise, and all of
        their columns are there.
    """

    base: Fit
    sensitivities: Sensitivities
    correlation: Correlation
    candidates: list[Candidate]
    unseen: list[Candidate]
    unusable: list[Candidate]
    dof: int
    models: list[Columns] = field(repr=False)
    screened: list[Candidate] = field(default_factory=list, repr=False)
    parts: dict[int, Ints] = field(default_factory=dict, repr=False)
    shares: dict[int, float] = field(default_factory=dict, repr=False)
    known: NDArray[Any] = field(default_factory=lambda: np.zeros(0, KNOWN), repr=False)
    dependences: Sequence[Correlation] = ()
    curves: bool = False
    refused: Collection[tuple[str, str | None]] = ()
    """Name and place of candidates that are in no set: full fits did not confirm them."""
    _estimates: dict[frozenset[Candidate], list[Estimated]] = field(default_factory=dict, repr=False)
    _bounds: dict[frozenset[Candidate], Array] = field(default_factory=dict, repr=False)

    # the columns ------------------------------------------------------------------------------------------------------

    @classmethod
    def of(
        cls,
        base: Fit,
        *,
        prefer: Collection[tuple[str, str | None]] = (),
        known: Collection[tuple[str, str | None]] = (),
        beside: Array | None = None,
        further: Sequence[Candidate] = (),
        like: Evidence | None = None,
        at: Fit | None = None,
    ) -> Evidence:
        """Return the evidence of a fit.

        Parameters
        ----------
        prefer : collection of (name, place)
            Effects that a user holds for the likeliest; place None is every place.
        known : collection of (name, place)
            Effects that are there, so that how readings depend on each other is estimated with them.
        beside : ndarray, shape (n, m, k), optional
            Derivatives of the weighted residuals of all rows by what else is there.
        further : sequence of Candidate
            Effects of a user, instead of those of the catalogue that have their names and places.
        like : Evidence, optional
            Made before with the same preference: that of the same fit has the candidates already.
        at : Fit, optional
            The fit with some candidates in its model, at which the columns are linearised.
        """
        if at is None and like is not None and like.base is base:
            rows, screened = like.sensitivities, like.screened
        else:
            with stage("sensitivities of the candidates"):
                effects = catalogue_effects(base.machine, base.observations)
                rows = Sensitivities.of(base, effects, at)
                screened = candidates(rows, effects, prefer)
        every = _in_place(screened, further)
        unusable = [c for c in every if not np.isfinite(c.columns).all()]
        every = [c for c in every if c not in unusable]
        more = None if beside is None else beside[rows.rows]
        there = [c for c in every if c.key in known or c in further]
        return replace(cls._weighed(base, rows, every, there, every, unusable, more), screened=screened)

    @classmethod
    def of_curves(
        cls,
        base: Fit,
        sensitivities: Sensitivities,
        nuisance: Sequence[Candidate],
        known: Sequence[Candidate] = (),
        beside: Array | None = None,
    ) -> Evidence:
        """Return the evidence of a fit for curves instead of the catalogue's effects, which are to be included.

        Parameters
        ----------
        nuisance : sequence of Candidate
            What may explain that readings seem to depend on each other.
        known : sequence of Candidate
            What is there.
        beside : ndarray, shape (n, m, K), optional
            Columns that count as those of the fitted parameters do.
        """
        return replace(cls._weighed(base, sensitivities, nuisance, known, [], [], beside), curves=True)

    @classmethod
    @stage("columns of the candidates")
    def _weighed(
        cls,
        base: Fit,
        rows: Sensitivities,
        nuisance: Sequence[Candidate],
        known: Sequence[Candidate],
        every: Sequence[Candidate],
        unusable: list[Candidate],
        beside: Array | None,
    ) -> Evidence:
        model = rows.model if beside is None else np.concatenate([rows.model, beside], axis=2)
        runs = not any(c.effect.definition.per_run for c in every)
        dependences = _dependences(rows, nuisance, known, [] if beside is None else [beside], runs=runs)
        spaces = [_space(rows, model, one) for one in dependences]
        none = np.zeros((rows.residual.size, 0))
        dof = rows.residual.size - spaces[0].basis.shape[1]
        models = [Columns.of(space, none) for space in spaces]
        empty = cls(base, rows, dependences[0], [], [], unusable, dof, models, dependences=dependences)
        return empty.including(every)

    def including(self, more: Sequence[Candidate]) -> Evidence:
        """Return the evidence with further candidates, such as forms outside the catalogue."""
        if not more:
            return self
        sizes = [c.columns.shape[2] for c in more]
        n, m = self.sensitivities.residual.shape
        whole = np.concatenate([np.zeros((n, m, 0)), *(c.columns for c in more)], axis=2)
        part_of_model = self.models[0].space.whiten(whole).reshape(n * m, -1)
        lengths = np.linalg.norm(part_of_model, axis=0)
        z = self.models[0].space.beyond(part_of_model)
        shares = np.linalg.norm(z, axis=0) / np.where(lengths > 0, lengths, 1.0)
        largest = [
            float(part_of_model.max(initial=0.0)) for part_of_model in np.split(shares, np.cumsum(sizes)[:-1])
        ]
        seen = [share >= COST.visible for share in largest]
        is_seen = np.repeat(np.array(seen, bool), np.array(sizes, int))
        hidden = shares < HIDDEN
        z[:, hidden] = 0.0
        visible = whole[:, :, is_seen] * ~hidden[is_seen]
        models = [
            Columns.of(
                model.space,
                np.concatenate(
                    [model.across, z[:, is_seen] if k == 0 else model.space.seen(visible)], axis=1
                ),
            )
            for k, model in enumerate(self.models)
        ]
        parts, end = dict(self.parts), self.models[0].across.shape[1]
        added = [c for c, there in zip(more, seen, strict=True) if there]
        exact, dimensions = self._exact, self.sensitivities.exact
        for c in added:
            parts[id(c)] = np.arange(end, end := end + c.columns.shape[2])
        sure = [c.effect.name in exact or c.key in dimensions for c in added]
        known = [_known(c, models[0], parts[id(c)], one) for c, one in zip(added, sure, strict=True)]
        every = [*self.candidates, *added]
        unseen = [*self.unseen, *(c for c, there in zip(more, seen, strict=True) if not there)]
        return replace(
            self,
            candidates=every,
            unseen=unseen,
            models=models,
            parts=parts,
            shares=self.shares | {id(c): share for c, share in zip(more, largest, strict=True)},
            known=np.concatenate([self.known, *known]),
            _bounds={},
            _log_choices=None,
        )

    @property
    def _exact(self) -> frozenset[str]:
        """Names of effects whose formulas are exact; speeds are steady where they repeat."""
        v = self.sensitivities.observations.v
        if v.shape[1] != 1:
            return frozenset()
        steady = positions(v[:, 0]).max(initial=0) < len(v) / 2
        return EXACT if steady else EXACT - {"servo_lag"}

    # the cost of a set ------------------------------------------------------------------------------------------------

    def cost(self, chosen: Sequence[Candidate]) -> float:
        """Return -2 ln of the probability of a set of candidates, up to a constant."""
        return min(one.cost for one in self._under_each(chosen)) + self.choice(chosen)

    def estimated(self, chosen: Sequence[Candidate]) -> Estimated:
        """Return the cost of a set of candidates, their sizes by their columns, and the variance that they leave."""
        best = min(self._under_each(chosen), key=lambda one: one.cost)
        return replace(best, cost=best.cost + self.choice(chosen))

    def sizes(self, chosen: Sequence[Candidate]) -> list[Array]:
        """Return the sizes of each of a set of candidates by its columns."""
        return [self.size(chosen, c)[0] for c in chosen]

    def size(self, chosen: Sequence[Candidate], one: Candidate) -> tuple[Array, Array]:
        """Return the sizes of one of a set of candidates by its columns, (k,), and their standard deviations."""
        estimates, part = self.estimated(chosen), np.searchsorted(self._index(chosen), self.parts[id(one)])
        return estimates.theta[part], estimates.spread[part]

    @property
    def imperfect(self) -> float:
        """Part of a candidate that may look like another one; see `CostPolicy`."""
        return 0.0 if self.curves else COST.imperfect

    def dearer_without(self, chosen: Sequence[Candidate]) -> list[float]:
        """Return about how much dearer a set is without each of its candidates, widths and variance held.

        With the covariance S of the sizes of the set, those of a candidate explain θᵀS⁻¹θ in addition to the others.
        """
        best, index, differences = self.estimated(chosen), self._index(chosen), list[float]()
        width, gram = best.width, self.model_for(chosen).gram[np.ix_(index, index)]
        values, vectors = eigh(width[:, None] * gram * width)
        covariance = vectors / (1 + np.maximum(values, 0.0) / best.variance) @ vectors.T
        theta = best.theta / np.where(width > 0, width, 1.0)
        for c in chosen:
            part = np.searchsorted(index, self.parts[id(c)])
            variance = covariance[np.ix_(part, part)]
            paid = best.of_width[part].sum() - np.linalg.slogdet(variance)[1]
            choice = self.choice([candidate for candidate in chosen if candidate is not c])
            differences.append(
                float(theta[part] @ solve(variance, theta[part]) - paid) + choice - self.choice(chosen)
            )
        return differences

    def misfit(self, chosen: Sequence[Candidate]) -> float:
        """Return the cost of a set without that of its odds and of the sizes of its effects."""
        best = min(self._under_each(chosen), key=lambda one: one.cost)
        return best.cost - best.of_sizes

    def model_for(self, chosen: Sequence[Candidate]) -> Columns:
        """Return the noise model under which a set of candidates costs least."""
        costs = [one.cost for one in self._under_each(chosen)]
        return self.models[int(np.argmin(costs))]

    @property
    def independent(self) -> Columns:
        """The noise model of independent readings, as a fit weighs them."""
        return self.models[0 if self.correlation.independent else -1]

    def correlation_for(self, chosen: Sequence[Candidate]) -> Correlation:
        """Return how readings depend on each other where a set of candidates costs least."""
        return self.dependences[self.models.index(self.model_for(chosen))]

    def dearer(self, model: Columns, chosen: Sequence[Candidate]) -> float:
        """Return how much dearer a set is under one noise model than under the best one."""
        costs = [one.cost for one in self._under_each(chosen)]
        return costs[self.models.index(model)] - min(costs)

    def _under_each(self, chosen: Sequence[Candidate]) -> list[Estimated]:
        key = frozenset(chosen)
        if key not in self._estimates:
            self.weighed([[*chosen]])
        return self._estimates[key]

    def _index(self, chosen: Collection[Candidate]) -> Ints:
        """Return the numbers of the columns of a set, in their order."""
        parts = [self.parts[id(c)] for c in chosen]
        return np.sort(np.concatenate([np.zeros(0, int), *parts]))

    def weighed(self, sets: Iterable[list[Candidate]]) -> list[list[Candidate]]:
        """Return sets of candidates whose costs are known, those of as many columns computed together."""
        those, alike = [*sets], dict[tuple[int, bool], dict[frozenset[Candidate], Ints]]()
        for chosen in those:
            key = frozenset(chosen)
            if key not in self._estimates:
                index = self._index(chosen)
                many = not self.curves and any(len(c.names) > FEW_COLUMNS for c in chosen)
                alike.setdefault((len(index), many), {})[key] = index
        for (_, many), some in alike.items():
            self._estimates |= zip(some, self._weigh(np.array([*some.values()]), many), strict=True)
        return those

    def _weigh(self, index: Ints, many: bool) -> Iterator[list[Estimated]]:
        """Yield the costs of sets of as many columns, (S, k), under each noise model: (variants, models, S, k).

        Variants, where an effect has many columns: all are there; or those that count; or those of one unit that count
        together, such as the turns of a set-up that was shifted only.
        """
        n, k = self.dof, index.shape[1]
        known, (grams, pulls, squares, imperfect, determinants) = self.known[index], self._products
        gram, pull = grams[:, index[:, :, None], index[:, None, :]], pulls[:, index]
        square = squares[:, None]
        exact = np.where(known["exact"], pull**2 / np.maximum(np.diagonal(gram, 0, -2, -1), 1e-300), 0.0)
        bent = np.maximum(square - np.max(exact, axis=-1, initial=0.0), 0.0)
        bent = np.minimum(bent, imperfect[:, None])
        floor = (ROUNDING * square if self.curves else COST.bent**2 * bent) / n + 1e-300
        same = known["group"][:, :, None] == known["group"][:, None, :]
        first = ~np.any(np.tril(same, -1), axis=2)
        narrow = np.where(same.sum(axis=2) > 1, NARROWEST, 1.0)
        usual, times, there = known["usual"], np.ones(index.shape), np.ones((1, *pull.shape))
        for last in (False, False, True):
            width = usual * times * there
            scaled, force = width[..., None] * gram * width[..., None, :], width * pull
            if last:
                values, vectors = eigh(scaled)
                values, along = np.maximum(values, 0.0), (force[..., None, :] @ vectors)[..., 0, :]
                real = values > ROUNDING * values[..., -1:]
                explained = np.sum(np.where(real, along**2 / np.where(real, values, 1.0), 0.0), axis=-1)
                variance = np.maximum((square - explained) / max(n - k, 1), floor)
                # of equal columns no solution of equations is as exact
                theta = width * (vectors @ (along / (values + variance[..., None]))[..., None])[..., 0]
            else:  # in a tenth of the time
                largest = np.max(np.diagonal(scaled, axis1=-2, axis2=-1), axis=-1, initial=0.0)
                rounding = ROUNDING * largest + 1e-300
                explained = np.sum(force * _ridge(scaled, force, rounding), axis=-1)
                variance = np.maximum((square - explained) / max(n - k, 1), floor)
                theta = width * _ridge(scaled, force, variance)
            ratio = np.abs(theta) / np.where(usual > 0, usual, np.inf)
            ratio = np.max(np.where(same, ratio[..., None, :], 0.0), axis=-1, initial=0.0)
            times = np.clip(ratio, narrow, WIDEST)
            if many:
                there = _there(usual * times, gram, theta, variance, known["many"], same)
        is_paid = first & ((same @ there[..., None])[..., 0] > 0)
        of_width = 2 * is_paid * np.where(times > 1, np.log1p(times**2), -np.log(times))
        sizes = np.sum(of_width, axis=-1)
        if many:
            of_variants = [0 * index[:, 0], known["rank"].sum(axis=1), (first & known["many"]).sum(axis=1)]
            sizes += 2 * math.log(2) * np.array(of_variants)[:, None]

        def costs(logs: Array) -> Array:
            """Return the costs at logarithms of the variance, (..., g)."""
            s2, of, pulled = np.exp(logs)[..., None], values[..., None, :], along[..., None, :]
            fall = np.sum(np.log1p(of / s2) - pulled**2 / (s2 * (of + s2)), axis=-1)
            return np.asarray(n * logs + square[..., None] / s2[..., 0] + fall)

        log = _least(costs, np.log(variance), np.broadcast_to(np.log(floor), variance.shape))
        variance = np.exp(log)
        spread = np.linalg.norm(
            width[..., None] * vectors / np.sqrt(values + variance[..., None])[..., None, :], axis=-1
        ) * np.sqrt(variance[..., None])
        sizes += _impossible(known, theta, spread)
        costs_of_models = costs(log[..., None])[..., 0] + sizes + determinants[:, None]
        best, of_sets = costs_of_models.argmin(axis=0), (theta, spread, sizes, width, of_width)
        for s in range(len(index)):
            at = [(best[m, s], m, s) for m in range(len(self.models))]
            yield [
                Estimated(float(costs_of_models[i]), float(variance[i]), *(x[i] for x in of_sets)) for i in at
            ]

    @cached_property
    def _products(self) -> tuple[Array, ...]:
        """Of each noise model XᵀX and Xᵀy, with a last column of zeros, |y|², that without dimensions, ln|V|."""
        products = (
            (np.pad(m.gram, (0, 1)), np.pad(m.pull, (0, 1)), m.square, m.imperfect, m.space.log_determinant)
            for m in self.models
        )
        return tuple(np.array(of_models) for of_models in zip(*products, strict=True))

    def choice(self, chosen: Sequence[Candidate]) -> float:
        """Return -2 ln of the odds of choosing these: how often machines have them, and how many values were tried.

        One kind of effect at several places is one choice of a kind. What every such machine has is no choice.
        """
        kinds, cost = set[str](), 0.0
        for c in chosen:
            _, name, first, again = self._price(c)
            cost += again if name in kinds else first
            if not c.prior.certain:
                kinds.add(name)
        return cost

    def _price(self, c: Candidate) -> tuple[tuple[str, str | None], str, float, float]:
        """Return key and name of a candidate, and what choosing it costs as the first of its kind, or one more.

        Nothing where it is the commonest of all, but no less.
        """
        if c not in self._prices:
            tried = 2 * math.log(c.tries) + len(c.searched) * math.log(self.dof)
            of_kinds = (max(2 * (choices - c.prior.log_odds), 0.0) for choices in (self.log_choices, 0.0))
            first, again = (0.0 if c.prior.certain else of_kind + tried for of_kind in of_kinds)
            self._prices[c] = c.key, c.effect.name, first, again
        return self._prices[c]

    @cached_property
    def _prices(self) -> dict[Candidate, tuple[tuple[str, str | None], str, float, float]]:
        return {}

    @property
    def log_choices(self) -> float:
        """Logarithm of the sum of the odds of all candidates."""
        if self._log_choices is None:
            odds = {
                c.key: min(c.prior.log_odds, 0.0)
                for c in (*self.candidates, *self.unseen)
                if not c.prior.certain
            }
            self._log_choices = math.log(max(sum(map(math.exp, odds.values())), 1.0))
        return self._log_choices

    _log_choices: float | None = field(default=None, repr=False)

    def variance(self, model: Columns, chosen: Sequence[Candidate]) -> float:
        """Return the variance of a whitened reading under one noise model, with a set of candidates."""
        return self._under_each(chosen)[self.models.index(model)].variance

    def inexact(self, chosen: Sequence[Candidate], model: Columns | None = None) -> float:
        """Return the sum of squares that a set explains beyond what its exact formulas explain alone."""
        exact = [c for c in chosen if self.known["exact"][self.parts[id(c)]].all()]
        return self.explained(chosen, model) - (self.explained(exact, model) if exact else 0.0)

    def explained(self, chosen: Sequence[Candidate], model: Columns | None = None) -> float:
        """Return by how much a set lowers the sum of squares, of directions that are determined.

        Under one noise model; the first one without.
        """
        index, model = self._index(chosen), model or self.models[0]
        return model.explained(index) if len(index) else 0.0

    def lengths(self, candidate: Candidate) -> Array:
        """Return the lengths of a candidate's columns beyond what the fitted parameters imitate, (k,).

        Under the noise model that the readings have without any effect.
        """
        return np.sqrt(np.maximum(np.diag(self.model_for([]).gram)[self.parts[id(candidate)]], 0.0))

    def visible(self, candidate: Candidate) -> float:
        """Return the largest part of a candidate's columns, 0 to 1, that the fitted parameters do not imitate."""
        return self.shares[id(candidate)]

    def width(self, candidate: Candidate) -> float:
        """Return what a candidate costs because its sizes are not known before, ln|1 + Λ/σ²|."""
        index = self.parts[id(candidate)]
        usual = self.known["usual"][index]
        values = np.linalg.eigvalsh(usual[:, None] * self.model_for([]).gram[np.ix_(index, index)] * usual)
        return float(np.sum(np.log1p(np.maximum(values, 0.0) / self.estimated([]).variance)))

    def without(self, keys: Collection[tuple[str, str | None]]) -> Evidence:
        """Return the evidence with some candidates in no set, by name and place; what they are stays known."""
        return replace(self, refused=frozenset(keys))

    def beside(self, some: Sequence[Candidate]) -> Evidence:
        """Return the evidence of the other candidates as if the columns of some were those of fitted parameters."""
        index = self._index(some)
        models = [model.beyond(index, self.known["usual"][index]) for model in self.models]
        fitted = models[0].space.basis.shape[1] - self.models[0].space.basis.shape[1]
        return replace(
            self,
            candidates=[c for c in self.candidates if c not in some],
            models=models,
            dof=self.dof - fitted,
            _estimates={},
            _bounds={},
            _log_choices=self.log_choices,
        )

    def as_one_cause(self, some: Sequence[Candidate]) -> Evidence:
        """Return the evidence with some candidates as one: sizes of the same usual size have one width."""
        index, known = self._index(some), self.known.copy()
        _, first, group = np.unique(known["usual"][index], return_index=True, return_inverse=True)
        known["effect"][index], known["group"][index], known["many"][index] = (
            index[0],
            index[first][group],
            True,
        )
        known["rank"][index] = 0.0
        known["rank"][index[0]] = _rank(self.models[0].gram[np.ix_(index, index)])
        return replace(self, known=known, _estimates={})

    def promising(
        self, sets: Sequence[Sequence[Candidate]], most: int, under: float = math.inf
    ) -> list[list[Candidate]]:
        """Return for each set the candidates that may lower its cost most when they join, by a bound of their fall.

        Only those with which it may cost less than a limit.
        """
        keys = [*map(frozenset, sets)]
        if new := [key for key in dict.fromkeys(keys) if key not in self._bounds]:
            self._bounds |= zip(new, self._gains(new), strict=True)
        promising = list[list[Candidate]]()
        prices = [self._price(c) for c in self.candidates]
        for key in keys:
            there, kinds = {c.key for c in key} | {*self.refused}, {c.effect.name for c in key}
            choices = [
                math.inf if inverse in there else again if name in kinds else first
                for inverse, name, first, again in prices
            ]
            costs, limit = self._bounds[key] + choices, under - self.choice([*key])
            order = np.argsort(costs, kind="stable")[:most].tolist()
            promising.append([self.candidates[i] for i in order if costs[i] < limit])
        return promising

    def _gains(self, sets: Sequence[Collection[Candidate]]) -> Array:
        """Return what sets cost with each candidate at least, but for odds and sizes, (S, candidates)."""
        gram, pull, square, _, log_determinant = self._products
        diagonal = np.maximum(np.diagonal(gram, axis1=1, axis2=2), 1e-300)
        # shorter ones end with a column of zeros
        columns = itertools.zip_longest(*map(self._index, sets), fillvalue=gram.shape[1] - 1)
        index = np.array([*columns], int).reshape(-1, len(sets)).T
        scaled, length = unit_diagonal(gram[:, index[:, :, None], index[:, None, :]])
        values, vectors = eigh(scaled)
        real = values > ROUNDING * values[..., -1:]
        root = vectors / np.sqrt(np.where(real, values, np.inf))[..., None, :] / length[..., None]
        root = np.swapaxes(root, 2, 3)
        cross = root @ gram[:, index]
        along = root @ pull[:, index, None]
        pull = pull[:, None] - (np.swapaxes(cross, 2, 3) @ along)[..., 0]
        left = np.maximum(square[:, None] - np.sum(along[..., 0] ** 2, axis=2), 1e-300)[..., None]
        falls = np.full((*pull.shape[:2], len(self.candidates)), -np.inf)
        for size, members in self._by_size.items():
            part = np.stack([self.parts[id(self.candidates[i])] for i in members])
            beside, scale = cross[..., part], np.sqrt(diagonal[:, None, part])
            within = gram[:, None, part[:, :, None], part[:, None, :]] - np.einsum(
                "mnisk,mnisl->mnskl", beside, beside
            )
            within = within / scale[..., :, None] / scale[..., None, :] + COST.visible**2 * np.eye(size)
            force = pull[..., part] / scale
            falls[..., members] = np.sum(force * np.linalg.solve(within, force[..., None])[..., 0], axis=-1)
        with np.errstate(invalid="ignore"):
            rests = np.log(left) + np.log1p(-np.minimum(falls / left, 1 - 1e-12))
        constant = self.dof * (1 - math.log(self.dof))
        return np.asarray(np.min(self.dof * rests + log_determinant[:, None, None], axis=0) + constant)

    @cached_property
    def _by_size(self) -> dict[int, Ints]:
        """Numbers of the candidates of each number of columns."""
        sizes = np.array([len(self.parts[id(c)]) for c in self.candidates], int)
        return {int(s): np.flatnonzero(sizes == s) for s in np.unique(sizes)}


@dataclass
class Estimated:
    """The cost of a set of candidates, and their sizes by their columns.

    Attributes
    ----------
    cost : float
    variance : float
        Of a whitened reading, with the set.
    theta, spread : ndarray, shape (k,)
        Sizes and their standard deviations, internal units.
    of_sizes : float
        What of the cost is that of large and of strange sizes.
    width, of_width : ndarray, shape (k,)
        How wide the sizes are distributed before the readings, and what of the cost is that of each width.
    """

    cost: float
    variance: float
    theta: Array
    spread: Array
    of_sizes: float
    width: Array
    of_width: Array


def _in_place(chosen: Sequence[Candidate], further: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with a user's instead of those that have the same names and places."""
    keys = {c.key for c in further}
    return [*(c for c in chosen if c.key not in keys), *further]


GRID = np.linspace(-0.4, 1.6, 11)
"""Logarithms of the factors on the least variance at which the cost is looked at first."""


def _least(costs: Callable[[Array], Array], start: Array, floor: Array) -> Array:
    """Return where costs are least: on a grid about a start, then by two parabolas through its neighbours."""
    start, floor, step = start[..., None], floor[..., None], float(GRID[1] - GRID[0])
    logs = np.maximum(start + GRID, floor)
    best = np.take_along_axis(logs, costs(logs).argmin(axis=-1)[..., None], axis=-1)
    for _ in range(2):
        low, middle, high = np.split(costs(best + step * np.arange(-1, 2)), 3, axis=-1)
        bend = low - 2 * middle + high
        move = np.clip((low - high) / (2 * np.where(bend > 0, bend, np.inf)), -1, 1) * step
        best = np.where(bend > 0, np.maximum(best + move, floor), best)
        step /= 10
    return np.asarray(best[..., 0])


def _ridge(gram: Array, pull: Array, added: Array) -> Array:
    """Return the solutions x of (G + added) x = pull, (..., k), of products (..., k, k) and numbers (...)."""
    unit = np.eye(gram.shape[-1])
    return np.asarray(np.linalg.solve(gram + added[..., None, None] * unit, pull[..., None])[..., 0])


def _rank(gram: Array) -> int:
    """Return how many directions of an effect's columns are determined in addition to the fitted parameters."""
    values = np.linalg.eigvalsh(unit_diagonal(gram)[0])
    return int(np.count_nonzero(values > COST.visible**2))


def _known(c: Candidate, model: Columns, part: Ints, exact: bool) -> NDArray[Any]:
    """Return what is known of the columns of a candidate, (k,), whose formula is `exact` or not.

    They are as large as all that is to be explained where no usual size is known.
    """
    unknown, stated = Size(math.inf, math.inf), c.prior.usual(c.short_names)
    sizes = [c.prior.sizes.get(name, unknown) for name in c.short_names]
    gram = model.gram[np.ix_(part, part)]
    lengths = np.sqrt(np.maximum(np.diag(gram), 0.0))
    # a column that is hidden has no size
    unit = np.where(lengths > 0, math.sqrt(model.imperfect) / np.where(lengths > 0, lengths, 1.0), 0.0)
    known = np.zeros(len(part), KNOWN)
    known["usual"] = np.minimum(np.where(np.isfinite(stated), stated, unit), 1e4 * unit)
    known["largest"] = [size.largest for size in sizes]
    known["positive"] = [size.positive for size in sizes]
    known["relative"] = c.effect.name in SCALES
    known["exact"] = exact
    known["effect"] = part[0]
    known["group"] = part[0] + np.unique(stated, return_inverse=True)[1]
    known["many"] = len(part) > FEW_COLUMNS
    if known["many"][0]:
        known["rank"][0] = _rank(gram)
    return known


def _there(width: Array, gram: Array, theta: Array, variance: Array, many: Mask, same: Mask) -> Array:
    """Return 0 for columns of effects of many that are cheaper left out, else 1, (variants, models, S, k).

    A column costs ln(1 + width² x²/σ²) because its size is not known before, and is worth (θ/std)².
    """
    precision = np.diagonal(gram, axis1=-2, axis2=-1) / variance[..., None]
    gains = theta**2 * precision - np.log1p(width**2 * precision)
    of_units = (same @ gains[-1][..., None])[..., 0]
    out = many & (np.array([0 * gains[0], gains[len(gains) // 2], of_units]) < 0)
    return np.where(out, 0.0, 1.0)


def _impossible(known: NDArray[Any], theta: Array, spread: Array) -> Array:
    """Return what signs and sizes cost that no machine should have, beyond their uncertainty."""
    large = np.abs(theta) - COST.certain * spread
    lifted = known["positive"] & (theta + COST.certain * spread < 0)
    same = known["effect"][:, :, None] == known["effect"][:, None, :]
    first = ~np.any(np.tril(same, -1), axis=2)
    strange = sum(
        first & np.any(same & one[..., None, :], axis=-1) for one in (large > known["largest"], lifted)
    )
    scaled = np.any(known["relative"] & (large > COST.no_scale), axis=-1)
    return np.asarray(np.where(scaled, math.inf, 2 * COST.impossible * np.sum(strange, axis=-1)))


@stage("estimating the correlation")
def _dependences(
    rows: Sensitivities,
    nuisance: Sequence[Candidate],
    known: Sequence[Candidate],
    beside: list[Array],
    *,
    runs: bool,
) -> list[Correlation]:
    """Return how readings may depend on each other: with all candidates, without any effect, and not at all.

    Errors that poses share, or that wander, are estimated together with all candidates, so that a wander is as small
    as it can be. Where nothing is missing it is larger; where an effect does what looks like a wander, there is none.
    Where readings of a position share errors, also with what candidates change within positions: else play, which
    they scatter by there, hides that a position has any error.
    """
    alone = estimate_correlation(rows, (), None, beside, runs=runs)
    columns, tries = [c.columns for c in nuisance], [c.tries for c in nuisance]
    there = [*(c.columns for c in known), *beside]
    correlation = estimate_correlation(rows, columns, tries, there, runs=runs, alone=None if known else alone)
    competing = [correlation, *([] if alone.independent else [alone])]
    if (
        (position := alone.position) is not None
        and alone.size("position")
        and not correlation.size("position")
    ):
        within = [_within(x, position) for x in (*columns, *there)]
        competing.append(estimate_correlation(rows, within, None, beside, runs=runs, alone=alone))
    return [*competing, *([] if correlation.independent else [INDEPENDENT])]


def _within(columns: Array, position: Ints) -> Array:
    """Return columns, (n, m, k), less their means at each position, (n,)."""
    sums = np.zeros((int(position.max()) + 1, *columns.shape[1:]))
    np.add.at(sums, position, columns)
    left = columns - (sums / np.bincount(position)[:, None, None])[position]
    hidden = np.linalg.norm(left, axis=(0, 1)) < HIDDEN * np.linalg.norm(columns, axis=(0, 1))
    return np.asarray(left * ~hidden)


def _space(rows: Sensitivities, model: Array, correlation: Correlation) -> Space:
    """Return the noise model of one dependence of the readings.

    The restricted likelihood has the determinant of the fitted parameters' products, too (Patterson and Thompson 1971).
    """
    n, m, p = model.shape
    imperfect = rows.residual - rows.of_exact
    whole = np.concatenate([model, rows.residual[:, :, None], imperfect[:, :, None]], axis=2)
    white = correlation.whiten(whole).reshape(n * m, -1)
    cost = correlation.cost
    if not correlation.independent:
        flat = model.reshape(n * m, -1)
        lengths = np.linalg.norm(flat, axis=0)
        lengths[lengths == 0] = 1.0
        cost += _log_determinant(white[:, :p] / lengths) - _log_determinant(flat / lengths)
    return Space.of(white[:, :p], -white[:, p], -white[:, p + 1], cost, correlation.whiten)


def _log_determinant(columns: Array) -> float:
    """Return ln|XᵀX| along the directions that columns span."""
    if not columns.shape[1]:
        return 0.0
    values = svd(np.asarray(np.linalg.qr(columns, mode="r")))[1]
    return 2 * float(np.sum(np.log(values[values > 1e-9 * values[0]])))
