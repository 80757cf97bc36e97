"""The evidence: how probable a set of effects is, given the readings of a fit.

Of the whitened residuals only what the fitted parameters cannot imitate counts: y = X θ + noise, with the columns X of
the candidates. An effect's sizes are N(0, width²), and the width has a Cauchy distribution of the usual size: sizes of
one unit are large or small together. The variance σ² of a reading is profiled, but never below what the imperfection of
formulas leaves. Then, with the eigenvalues Λ of the scaled products XᵀX and the pull u = Xᵀy along their eigenvectors,

    cost(set) = n ln σ² + |y|²/σ² - uᵀ(Λ + σ²)⁻¹u / σ² + ln|1 + Λ/σ²| - 2 ln odds(set)

is -2 ln of the probability of the set, up to a constant (MacKay 1992, Bayesian interpolation; Kass and Raftery 1995,
Bayes factors). Readings at one position share an error of unknown size, and those of a pose share where its joints
stopped. That competes with the effects: each size that is tried is a noise model with columns of its own, and a set
costs what it costs with the best of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property

import numpy as np

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.candidates import Candidate, candidates
from rodgen.calibration.dependence import INDEPENDENT, Correlation, estimate_correlation
from rodgen.calibration.fitted import Fit
from rodgen.calibration.positions import shared_positions
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.machines.plausibility import Size
from rodgen.stages import stage
from rodgen.statistics.columns import (
    Whiten,
    falls_from_products,
    orthonormal_basis,
    project_out,
    unchanged,
    unit_columns,
    unit_diagonal,
)
from rodgen.statistics.decompositions import eigh, svd
from rodgen.statistics.thresholds import COST

POSITION_ERRORS = (1.0, 3.0, 10.0)
"""Errors that the readings of one position may share, in errors of a reading: a factor of three from one to the next
costs less than 1 in chi-square."""
MOST_STOPS = 600
"""Poses times joints beyond which it changes little of what is decided where each joint stopped."""
SCALES = frozenset({"scale", "instrument_scale", "instrument_axis_scales", "leg_scale"})
"""Effects that multiply a reading."""
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
    directions : ndarray, shape (N, r)
        Orthonormal; along these readings share errors.
    shrinks : ndarray, shape (r,)
        By how much columns become shorter along these.
    basis : ndarray, shape (N, p)
        Orthonormal basis of the fitted parameters' columns.
    residual : ndarray, shape (N,)
        y, without its projection onto the basis.
    log_determinant : float
        Of the covariance of y, compared with that of independent readings, and twice the logarithm of the number of
        models that were tried.
    whiten : callable
        Brings columns of weighted readings, (n, m, K), to where their errors are independent.
    """

    directions: Array
    shrinks: Array
    basis: Array
    residual: Array
    log_determinant: float
    whiten: Whiten = unchanged

    @classmethod
    def of(
        cls,
        model: Array,
        y: Array,
        directions: Array,
        shrinks: Array,
        log_determinant: float,
        whiten: Whiten = unchanged,
    ) -> Space:
        """Return the space of the fitted parameters' columns, (N, p), and of the whitened readings y, (N,)."""
        basis = orthonormal_basis(_shrunk(model, directions, shrinks))
        residual = project_out(basis, _shrunk(y, directions, shrinks))
        return cls(directions, shrinks, basis, residual, log_determinant, whiten)

    def seen(self, columns: Array) -> Array:
        """Return what of columns of weighted readings, (n, m, K), the fitted parameters do not imitate, (N, K)."""
        return self.beyond(self.whiten(columns).reshape(len(self.residual), -1))

    def beyond(self, columns: Array) -> Array:
        """Return what of whitened columns, (N, K), the fitted parameters do not imitate."""
        return project_out(self.basis, self.shrunk(columns))

    def shrunk(self, columns: Array) -> Array:
        """Return whitened columns, (N, K), of which readings no longer share errors."""
        return _shrunk(columns, self.directions, self.shrinks)


def _shrunk(columns: Array, directions: Array, shrinks: Array) -> Array:
    if not len(shrinks):
        return columns
    return np.asarray(columns - (directions * (1 - shrinks)) @ (directions.T @ columns))


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

    @classmethod
    def of(cls, space: Space, across: Array) -> Columns:
        """Return columns, (N, K), that are beyond the fitted parameters, with their products."""
        return cls(space, across, across.T @ across, across.T @ space.residual)

    @property
    def square(self) -> float:
        """|y|²."""
        return float(self.space.residual @ self.space.residual)

    @property
    def log_determinant(self) -> float:
        """As of the space."""
        return self.space.log_determinant


class Sparse(Enum):
    """Which columns of an effect of many may be left out."""

    NONE = auto()
    COLUMNS = auto()
    UNITS = auto()
    """All of one unit together, such as the turns of a set-up that was shifted only."""


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
    ranks: dict[int, int] = field(default_factory=dict, repr=False)
    usual: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    largest: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    positive: Mask = field(default_factory=lambda: np.zeros(0, bool), repr=False)
    groups: Ints = field(default_factory=lambda: np.zeros(0, int), repr=False)
    relative: Mask = field(default_factory=lambda: np.zeros(0, bool), repr=False)
    _estimates: dict[frozenset[int], Estimated] = field(default_factory=dict, repr=False)

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
    ) -> Evidence:
        """Return the evidence of a fit.

        Parameters
        ----------
        prefer : collection of (name, place)
            Effects that a user holds for the likeliest; place None is every place.
        known : collection of (name, place)
            Effects that are there, so that how readings depend on each other is estimated with them.
        beside : ndarray, shape (n, m, k), optional
            Derivatives of the weighted residuals by what else is there, in the rows that count.
        further : sequence of Candidate
            Effects of a user, in the place of those of the catalogue that have their names and places.
        like : Evidence, optional
            Made before with the same preference: that of the same fit has the candidates already.
        """
        if like is not None and like.base is base:
            rows, screened = like.sensitivities, like.screened
        else:
            with stage("sensitivities of the candidates"):
                effects = catalogue_effects(base.machine, base.observations)
                rows = Sensitivities.of(base, effects)
                screened = candidates(rows, effects, prefer)
        every = _in_place(screened, further)
        unusable = [c for c in every if not np.isfinite(c.columns).all()]
        every = [c for c in every if np.isfinite(c.columns).all()]
        more = None if beside is None or len(beside) != len(rows.residual) else beside
        with stage("estimating the correlation"):
            correlation = estimate_correlation(
                rows,
                [c.columns for c in every],
                [c.tries for c in every],
                [
                    *(c.columns for c in every if c.key in known or c in further),
                    *([] if more is None else [more]),
                ],
                runs=_may_differ(every),
            )
        return replace(cls._weighed(base, rows, correlation, every, unusable, more), screened=screened)

    @classmethod
    def without_candidates(
        cls,
        base: Fit,
        sensitivities: Sensitivities,
        nuisance: Sequence[Candidate],
        known: Sequence[Candidate] = (),
        beside: Array | None = None,
    ) -> Evidence:
        """Return the evidence of a fit for candidates other than the catalogue's, which are to be included.

        Parameters
        ----------
        nuisance : sequence of Candidate
            What may explain that readings seem to depend on each other.
        known : sequence of Candidate
            What is there.
        beside : ndarray, shape (n, m, K), optional
            Columns that count as those of the fitted parameters do.
        """
        with stage("estimating the correlation"):
            columns, tries = [c.columns for c in nuisance], [c.tries for c in nuisance]
            there = [c.columns for c in known] + ([] if beside is None else [beside])
            correlation = estimate_correlation(sensitivities, columns, tries, there)
        return cls._weighed(base, sensitivities, correlation, [], [], beside)

    @classmethod
    @stage("columns of the candidates")
    def _weighed(
        cls,
        base: Fit,
        rows: Sensitivities,
        correlation: Correlation,
        every: Sequence[Candidate],
        unusable: list[Candidate],
        beside: Array | None,
    ) -> Evidence:
        model = rows.model if beside is None else np.concatenate([rows.model, beside], axis=2)
        with stage("estimating the correlation"):
            dependences = [
                correlation,
                *_other_dependences(rows, correlation, beside, runs=_may_differ(every)),
            ]
        spaces = list[Space]()
        for number, one in enumerate(dependences):
            spaces += _spaces(rows, model, one, shared=number == 0)
        none = np.zeros((rows.residual.size, 0))
        dof = rows.residual.size - spaces[0].basis.shape[1]
        models = [Columns.of(space, none) for space in spaces]
        empty = cls(base, rows, correlation, [], [], unusable, dof, models)
        return empty.including(every)

    def including(self, more: Sequence[Candidate]) -> Evidence:
        """Return the evidence with further candidates, such as forms outside the catalogue."""
        sizes = [c.columns.shape[2] for c in more]
        n, m = self.sensitivities.residual.shape
        whole = np.concatenate([np.zeros((n, m, 0)), *(c.columns for c in more)], axis=2)
        own = self.models[0].space.whiten(whole).reshape(n * m, -1)
        lengths = np.linalg.norm(own, axis=0)
        z = self.models[0].space.beyond(own)
        shares = np.linalg.norm(z, axis=0) / np.where(lengths > 0, lengths, 1.0)
        ends = np.cumsum(sizes)
        largest = [
            float(np.max(shares[end - size : end], initial=0.0))
            for size, end in zip(sizes, ends, strict=True)
        ]
        seen = [share >= COST.visible for share in largest]
        kept = np.repeat(np.array(seen, bool), np.array(sizes, int))
        hidden = shares < HIDDEN
        z[:, hidden] = 0.0
        shown = whole[:, :, kept] * ~hidden[kept]
        models = [
            Columns.of(
                model.space,
                np.concatenate([model.across, z[:, kept] if k == 0 else model.space.seen(shown)], axis=1),
            )
            for k, model in enumerate(self.models)
        ]
        parts, end = dict(self.parts), self.models[0].across.shape[1]
        found = [c for c, there in zip(more, seen, strict=True) if there]
        for c in found:
            parts[id(c)] = np.arange(end, end := end + c.columns.shape[2])
        gram = models[0].gram
        ranks = self.ranks | {id(c): _rank(gram[np.ix_(parts[id(c)], parts[id(c)])]) for c in found}
        every = [*self.candidates, *found]
        unseen = [*self.unseen, *(c for c, there in zip(more, seen, strict=True) if not there)]
        first = self.models[0].across.shape[1]
        unknown = Size(math.inf, math.inf)
        sized = [c.prior.sizes.get(name, unknown) for c in found for name in c.short_names]
        own_largest = np.array([size.largest for size in sized])
        own_positive = np.array([size.positive for size in sized], bool)
        own_relative = np.array([c.effect.name in SCALES for c in found for _ in c.names], bool)
        return replace(
            self,
            candidates=every,
            unseen=unseen,
            models=models,
            parts=parts,
            ranks=ranks,
            shares=self.shares | {id(c): share for c, share in zip(more, largest, strict=True)},
            usual=np.concatenate([self.usual, _usual_sizes(found, models[0], first)]),
            largest=np.concatenate([self.largest, own_largest]),
            positive=np.concatenate([self.positive, own_positive]),
            groups=np.concatenate([self.groups, self._groups_of(found)]),
            relative=np.concatenate([self.relative, own_relative]),
            _estimates={},
            _log_choices=None,
        )

    def _groups_of(self, found: Sequence[Candidate]) -> Ints:
        """Return a number for each column, (K,), that those of one effect with one usual size share."""
        groups, last = list[int](), int(np.max(self.groups, initial=-1))
        for c in found:
            sizes, own = np.unique(c.prior.usual(c.short_names), return_inverse=True)
            groups += (last + 1 + own).tolist()
            last += len(sizes)
        return np.array(groups, int)

    # the cost of a set ------------------------------------------------------------------------------------------------

    def cost(self, chosen: Sequence[Candidate]) -> float:
        """Return -2 ln of the probability of a set of candidates, up to a constant."""
        return self.estimated(chosen).cost

    def estimated(self, chosen: Sequence[Candidate]) -> Estimated:
        """Return the cost of a set of candidates, their sizes by their columns, and the variance that they leave."""
        key = frozenset(map(id, chosen))
        if key not in self._estimates:
            self._estimates[key] = self._estimated(chosen)
        return self._estimates[key]

    def misfit(self, chosen: Sequence[Candidate]) -> float:
        """Return the cost of a set without that of its odds and of the sizes of its effects."""
        return self.cost(chosen) - self.choice(chosen) - self.estimated(chosen).of_sizes

    def _estimated(self, chosen: Sequence[Candidate]) -> Estimated:
        found = [self._under(model, chosen) for model in self.models]
        best = min(found, key=lambda one: one.cost)
        best.cost += self.choice(chosen)
        return best

    def model_for(self, chosen: Sequence[Candidate]) -> Columns:
        """Return the noise model under which a set of candidates costs least."""
        return min(self.models, key=lambda model: self._under(model, chosen).cost)

    def _under(self, model: Columns, chosen: Sequence[Candidate]) -> Estimated:
        """Return the cost of a set under one noise model: with all columns of its effects, or with those that count."""
        if all(len(c.names) <= FEW_COLUMNS for c in chosen):
            return self._with(model, chosen, Sparse.NONE)
        return min((self._with(model, chosen, sparse) for sparse in Sparse), key=lambda one: one.cost)

    def _with(self, model: Columns, chosen: Sequence[Candidate], sparse: Sparse) -> Estimated:
        n, square = self.dof, model.square
        floor = COST.bent**2 * square / n + 1e-300
        if not chosen:
            variance = square / n + 1e-300
            none = np.zeros(0)
            return Estimated(n * math.log(variance) + n + model.log_determinant, variance, none, none)
        parts = [self.parts[id(c)] for c in chosen]
        index, lengths = np.concatenate(parts), np.array([len(part) for part in parts])
        starts = np.cumsum(lengths) - lengths
        many = np.repeat(lengths > FEW_COLUMNS, lengths)
        _, group = np.unique(self.groups[index], return_inverse=True)
        narrow = np.where(np.bincount(group) > 1, NARROWEST, 1.0)
        gram, pull, usual = model.gram[np.ix_(index, index)], model.pull[index], self.usual[index]
        times, there = np.ones(len(index)), np.ones(len(index))
        for _ in range(3):
            width = usual * times * there
            values, vectors = eigh(width[:, None] * gram * width)
            values, along = np.maximum(values, 0.0), vectors.T @ (width * pull)
            real = values > ROUNDING * values[-1]
            explained = float(np.sum(along[real] ** 2 / values[real]))
            variance = max((square - explained) / max(n - len(index), 1), floor)
            theta = width * (vectors @ (along / (values + variance)))
            ratio = np.zeros(len(narrow))
            np.maximum.at(ratio, group, np.abs(theta) / np.where(usual > 0, usual, np.inf))
            scale = np.clip(ratio, narrow, WIDEST)
            times = scale[group]
            if sparse is not Sparse.NONE:
                of = np.arange(len(index)) if sparse is Sparse.COLUMNS else group
                there = self._there(usual * times, gram, theta, variance, many, of)
        sizes = 0.0
        if sparse is Sparse.COLUMNS:
            sizes = 2 * math.log(2) * sum(self.ranks[id(c)] for c in chosen if len(c.names) > FEW_COLUMNS)
        elif sparse is Sparse.UNITS:
            sizes = 2 * math.log(2) * len(np.unique(group[many]))
        sized = np.where(scale > 1, np.log1p(scale**2), -np.log(scale))
        sizes += 2 * float(np.sum(sized, where=np.bincount(group, there) > 0))

        def costs(logs: Array) -> Array:
            """Return the cost at logarithms of the variance."""
            s2 = np.exp(logs)[:, None]
            fall = np.sum(np.log1p(values / s2) - along**2 / (s2 * (values + s2)), axis=1)
            return np.asarray(n * logs + square / s2[:, 0] + fall)

        log = _least(costs, max(math.log(variance), math.log(floor)), math.log(floor))
        variance, least = math.exp(log), float(costs(np.array([log]))[0])
        spread = np.linalg.norm((width[:, None] * vectors) / np.sqrt(values + variance), axis=1) * math.sqrt(
            variance
        )
        sizes += self._impossible(index, starts, theta, spread)
        return Estimated(least + sizes + model.log_determinant, variance, theta, spread, sizes)

    @staticmethod
    def _there(width: Array, gram: Array, theta: Array, variance: float, many: Mask, group: Ints) -> Array:
        """Return 0 for columns, (k,), of effects of many that are cheaper left out, with those of their group, else 1.

        A column costs ln(1 + width² x²/σ²) because its size is not known before, and is worth (θ/std)².
        """
        precision = np.diag(gram) / variance
        worth, cost = theta**2 * precision, np.log1p(width**2 * precision)
        gains = np.bincount(group, worth - cost)[group]
        return np.where(many & (gains < 0), 0.0, 1.0)

    def _impossible(self, index: Ints, starts: Ints, theta: Array, spread: Array) -> float:
        """Return what signs and sizes cost that no machine should have, beyond their uncertainty."""
        large = np.abs(theta) - COST.certain * spread > self.largest[index]
        lifted = self.positive[index] & (theta + COST.certain * spread < 0)
        if np.any(self.relative[index] & (np.abs(theta) - COST.certain * spread > COST.no_scale)):
            return math.inf
        strange = np.logical_or.reduceat(large, starts).sum() + np.logical_or.reduceat(lifted, starts).sum()
        return 2 * COST.impossible * float(strange)

    def choice(self, chosen: Sequence[Candidate]) -> float:
        """Return -2 ln of the odds of choosing these: how often machines have them, and how many values were tried.

        One kind of effect at several places is one choice of a kind. What every such machine has is no choice.
        """
        kinds, cost = set[str](), 0.0
        for c in chosen:
            if c.prior.certain:
                continue
            again = c.effect.name in kinds
            kinds.add(c.effect.name)
            cost += self._of_choice(c, 0.0 if again else self.log_choices)
        return cost

    def _of_choice(self, c: Candidate, log_choices: float) -> float:
        """Return what choosing a candidate costs: nothing where it is the commonest of all, but no less."""
        cost = max(2 * (log_choices - c.prior.log_odds), 0.0) + 2 * math.log(c.tries)
        return cost + len(c.searched) * math.log(self.dof)

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
        return self._under(model, chosen).variance

    def explained(self, chosen: Sequence[Candidate], model: Columns | None = None) -> float:
        """Return by how much a set lowers the sum of squares, of directions that are determined.

        Under one noise model; the first one without.
        """
        if not chosen:
            return 0.0
        model = model or self.models[0]
        index = np.concatenate([self.parts[id(c)] for c in chosen])
        scaled, length = unit_diagonal(model.gram[np.ix_(index, index)])
        return float(falls_from_products(scaled, model.pull[index] / length, least=COST.visible**2))

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
        usual = self.usual[index]
        values = np.linalg.eigvalsh(usual[:, None] * self.model_for([]).gram[np.ix_(index, index)] * usual)
        return float(np.sum(np.log1p(np.maximum(values, 0.0) / self.estimated([]).variance)))

    def without(self, keys: Collection[tuple[str, str | None]]) -> Evidence:
        """Return the evidence without some candidates, by name and place."""
        kept = [c for c in self.candidates if c.key not in keys]
        return replace(self, candidates=kept, _log_choices=self.log_choices)

    def promising(self, chosen: Sequence[Candidate], most: int) -> list[Candidate]:
        """Return the candidates that may lower the cost of a set most when they join it, by a bound of their fall."""
        there = {c.key for c in chosen}
        kinds = {c.effect.name for c in chosen}
        gains = np.min([self._gains(model, chosen) for model in self.models], axis=0)
        costs = [
            math.inf if c.key in there else gain + self._alone(c, kinds)
            for c, gain in zip(self.candidates, gains, strict=True)
        ]
        return [self.candidates[i] for i in np.argsort(costs, kind="stable")[:most] if costs[i] < math.inf]

    def _gains(self, model: Columns, chosen: Sequence[Candidate]) -> Array:
        """Return what a set costs with each candidate, under one noise model, but for odds and sizes."""
        gram, pull = model.gram, model.pull
        diagonal = np.maximum(np.diag(gram), 1e-300)
        if chosen:
            index = np.concatenate([self.parts[id(c)] for c in chosen])
            scaled, length = unit_diagonal(gram[np.ix_(index, index)])
            values, vectors = eigh(scaled)
            real = values > ROUNDING * values[-1]
            root = (vectors[:, real] / np.sqrt(values[real])) / length[:, None]
            cross = root.T @ gram[index]
            along = root.T @ pull[index]
            pull = pull - cross.T @ along
            left = max(model.square - float(along @ along), 1e-300)
        else:
            cross, left = np.zeros((0, len(pull))), model.square
        falls = np.full(len(self.candidates), -np.inf)
        for size, members in self._by_size.items():
            part = np.stack([self.parts[id(self.candidates[i])] for i in members])
            own = gram[part[:, :, None], part[:, None, :]]
            if len(cross):
                beside = cross[:, part]
                own = own - np.einsum("sik,sil->ikl", beside, beside)
            scale = np.sqrt(diagonal[part])
            own = own / scale[:, :, None] / scale[:, None, :] + COST.visible**2 * np.eye(size)
            force = pull[part] / scale
            falls[members] = np.einsum("ik,ik->i", force, np.linalg.solve(own, force[:, :, None])[:, :, 0])
        with np.errstate(invalid="ignore"):
            rests = np.log(max(left, 1e-300)) + np.log1p(-np.minimum(falls / left, 1 - 1e-12))
        return np.asarray(self.dof * rests + model.log_determinant)

    def _alone(self, c: Candidate, kinds: Collection[str]) -> float:
        if c.prior.certain:
            return 0.0
        return self._of_choice(c, 0.0 if c.effect.name in kinds else self.log_choices)

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
    """

    cost: float
    variance: float
    theta: Array
    spread: Array
    of_sizes: float = 0.0


def _in_place(found: Sequence[Candidate], further: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with a user's in the place of those that have the same names and places."""
    keys = {c.key for c in further}
    return [*(c for c in found if c.key not in keys), *further]


GRID = np.linspace(-0.4, 1.6, 11)
"""Logarithms of the factors on the least variance at which the cost is looked at first."""


def _least(costs: Callable[[Array], Array], start: float, floor: float) -> float:
    """Return where a cost is least: on a grid about a start, then by two parabolas through its neighbours."""
    logs = np.maximum(start + GRID, floor)
    best, step = float(logs[int(np.argmin(costs(logs)))]), float(GRID[1] - GRID[0])
    for _ in range(2):
        low, middle, high = costs(np.array([best - step, best, best + step]))
        bend = low - 2 * middle + high
        if bend > 0:
            best = max(best + float(np.clip((low - high) / (2 * bend), -1, 1)) * step, floor)
        step /= 10
    return best


def _rank(gram: Array) -> int:
    """Return how many directions of an effect's columns are determined beside the fitted parameters."""
    values = np.linalg.eigvalsh(unit_diagonal(gram)[0])
    return int(np.count_nonzero(values > COST.visible**2))


def _may_differ(every: Sequence[Candidate]) -> bool:
    """Return whether runs may differ for no reason: not where a candidate says how they do."""
    return not any(c.effect.definition.per_run for c in every)


def _other_dependences(
    rows: Sensitivities, correlation: Correlation, beside: Array | None, *, runs: bool
) -> list[Correlation]:
    """Return how readings may depend on each other, besides: as without any effect, and not at all.

    Errors that poses share, or that wander, are estimated with all candidates beside them; so a wander is as small as
    it can be. Where nothing is missing it is larger; where an effect does what looks like a wander, there is none.
    """
    alone = estimate_correlation(rows, (), None, [] if beside is None else [beside], runs=runs)
    if alone.independent:
        return [] if correlation.independent else [INDEPENDENT]
    return [alone] if correlation.independent else [alone, INDEPENDENT]


def _spaces(rows: Sensitivities, model: Array, correlation: Correlation, *, shared: bool) -> Iterator[Space]:
    """Yield the noise models of one dependence of the readings, with errors of positions if they may be shared."""
    n, m, p = model.shape
    whole = np.concatenate([model, rows.residual[:, :, None]], axis=2)
    white = correlation.whiten(whole).reshape(n * m, -1)
    cost = correlation.cost
    if not correlation.independent:
        flat = model.reshape(n * m, -1)
        lengths = np.linalg.norm(flat, axis=0)
        lengths[lengths == 0] = 1.0
        cost += _log_determinant(white[:, :p] / lengths) - _log_determinant(flat / lengths)
    none = np.zeros((n * m, 0))
    yield Space.of(white[:, :p], -white[:, p], none, np.zeros(0), cost, correlation.whiten)
    for errors in (shared_positions(rows.observations, m), _stops(rows)) if shared else ():
        if errors is not None:
            shares = correlation.whiten(errors).reshape(n * m, -1)
            for space in _sharing(shares, white[:, :p], -white[:, p]):
                yield replace(space, log_determinant=space.log_determinant + cost, whiten=correlation.whiten)


def _stops(rows: Sensitivities) -> Array | None:
    """Return how the readings of each pose follow errors of where each joint stopped, (n, m, poses × joints).

    None where poses are not read several times, or are too many to matter. Each column is as large, in the mean, as an
    error of a reading that moves the readings by their own error.
    """
    o = rows.observations
    poses, pose = np.unique(o.pose, return_inverse=True)
    follow = [rows.component(joint.name, "reading") for joint in o.machine.joints]
    some = [column for column in follow if column is not None and column.any()]
    if not some or 2 * len(poses) > o.n or len(poses) * len(some) > MOST_STOPS:
        return None
    found = np.zeros((*rows.residual.shape, len(some), len(poses)))
    for k, column in enumerate(some):
        found[np.arange(o.n), :, k, pose] = column / math.sqrt(float(np.mean(column**2)))
    return found.reshape(*rows.residual.shape, -1)


def _sharing(indicators: Array, model: Array, y: Array) -> Iterator[Space]:
    """Yield the spaces where readings of a position share an error, for each size of it that is tried.

    With the indicators B of the positions readings have the covariance 1 + τ²BBᵀ; its root is taken along the singular
    vectors of B. The restricted likelihood has the determinant of the fitted parameters' products, too (Patterson and
    Thompson 1971).
    """
    u, s, _ = svd(indicators)
    u, s = u[:, s > 1e-9 * s[0]], s[s > 1e-9 * s[0]]
    unit = unit_columns(model)
    independent, tried = _log_determinant(unit), 2 * math.log(1 + len(POSITION_ERRORS))
    for tau in POSITION_ERRORS:
        enlarged = 1 + (tau * s) ** 2
        shrinks = 1 / np.sqrt(enlarged)
        more = float(np.sum(np.log(enlarged))) + _log_determinant(_shrunk(unit, u, shrinks)) - independent
        yield Space.of(model, y, u, shrinks, more + tried)


def _log_determinant(columns: Array) -> float:
    """Return ln|XᵀX| along the directions that columns span."""
    if not columns.shape[1]:
        return 0.0
    values = svd(np.asarray(np.linalg.qr(columns, mode="r")))[1]
    return 2 * float(np.sum(np.log(values[values > 1e-9 * values[0]])))


def _usual_sizes(found: Sequence[Candidate], model: Columns, first: int) -> Array:
    """Return the usual sizes of the columns from a first one on, (K,).

    As large as all that is to be explained where none is known.
    """
    square = np.diag(model.gram)[first:]
    unit = np.sqrt(model.square / np.maximum(square, 1e-300))
    stated = np.concatenate([np.zeros(0), *(c.prior.usual(c.short_names) for c in found)])
    return np.asarray(np.minimum(np.where(np.isfinite(stated), stated, unit), 1e4 * unit))
