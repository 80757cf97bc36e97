"""The columns of a model and of all candidates, as coordinates in the space that they span together.

Whitened residuals of n rows are compared with columns in that space only, which has as many dimensions as there are
columns; the part of the residuals outside of it is the same for every model. So a score test of a candidate costs a
product of small matrices, whatever n is.

A candidate is scored by F: the fall of the sum of squares that its columns, with what the model can imitate taken off,
bring for each of them, over what remains (Rao 1948). Directions in which the model imitates a candidate nearly whole
are left out: to be seen there its parameters would have to be far beyond what is usual.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.statistics.columns import (
    ColumnSpace,
    Coordinates,
    Whiten,
    directions_above,
    directions_of_each,
    pair_falls,
    unit_columns,
)
from rodgen.statistics.multiple_testing import effective_tests
from rodgen.statistics.thresholds import SELECTION


@dataclass(frozen=True)
class Score:
    """The score test of a candidate."""

    candidate: Candidate
    fall: float
    """Of the sum of squares."""
    dof: int
    """Combinations of its parameters that are seen."""
    log_p: float
    """Natural logarithm of the probability that chance explains as much for it alone, all values of a searched
    parameter counted."""
    statistic: float
    residual_dof: int
    """Degrees of freedom that remain."""
    visible: float
    """Part of the columns that the model cannot imitate."""
    left: float
    """Residual sum of squares with it."""

    @property
    def parameters(self) -> int:
        """Number of parameters that are seen, searched ones among them."""
        return self.dof + (len(self.candidate.searched) if self.dof else 0)


BASES = 32
"""Bases that are kept at most, each with what all candidates do that it cannot imitate."""


@dataclass(frozen=True, eq=False)
class _Base:
    """The space of the model and some candidates; what others do across it, by their ids."""

    space: ColumnSpace
    across: dict[int, tuple[Array, float]]


class CandidateSpace:
    """Coordinates of columns and residuals.

    Parameters
    ----------
    model : ndarray, shape (n, m, p)
        The model's columns.
    whiten : callable
        From columns (n, m, k) to columns whose errors are independent and alike.
    """

    def __init__(self, model: Array, found: Sequence[Candidate], whiten: Whiten) -> None:
        self.whiten = whiten
        self.candidates = list(found)
        columns = [model, *(c.columns for c in found)]
        sizes = [c.shape[2] for c in columns]
        whole = whiten(np.concatenate(columns, axis=2)).reshape(-1, sum(sizes))
        whole = np.where(np.isfinite(whole), whole, 0.0)
        self.readings = len(whole)
        self.length = np.linalg.norm(whole, axis=0)
        self._coordinates = Coordinates(unit_columns(whole))
        self._bases: dict[tuple[int, ...], _Base] = {}
        ends = np.cumsum(sizes)
        self._model = slice(0, int(ends[0]))
        self._parts = {
            id(c): slice(int(a), int(b)) for c, a, b in zip(found, ends[:-1], ends[1:], strict=True)
        }
        self._there = {id(c): max(int((self.sizes(c) > 0).sum()), 1) for c in found}

    def without(self, keys: Collection[tuple[str, str | None]]) -> CandidateSpace:
        """Return the same coordinates for all candidates but those of some effects."""
        found = copy(self)
        found.candidates = [c for c in self.candidates if c.key not in keys]
        return found

    def including(self, some: Sequence[Candidate]) -> CandidateSpace:
        """Return the same coordinates for these candidates, too, which were left out before.

        Those that had none, because they were left out when this space was made, stay out.
        """
        found = copy(self)
        found.candidates = [*self.candidates, *(c for c in some if id(c) in self._parts)]
        return found

    # coordinates ---------------------------------------------------------------------------------------------

    def residual(self, residual: Array) -> tuple[Array, float]:
        """Return the coordinates of weighted residuals (n, m), and the sum of squares of all of it."""
        white = self.whiten(residual[:, :, None]).ravel()
        return self._coordinates.of(white), float(white @ white)

    def columns(self, candidate: Candidate) -> Array:
        """Return a candidate's columns in coordinates, of length 1."""
        return np.asarray(self._coordinates.triangle[:, self._parts[id(candidate)]])

    def sizes(self, candidate: Candidate) -> Array:
        """Return the lengths that these columns have."""
        return np.asarray(self.length[self._parts[id(candidate)]])

    def numbers(self, included: Sequence[Candidate]) -> list[int]:
        """Return the numbers of some candidates' columns among all."""
        return [i for c in included for i in range(*self._parts[id(c)].indices(len(self.length)))]

    @cached_property
    def across_model(self) -> Array:
        """All columns of length 1, without what the model does, in coordinates."""
        return self.base().project_out(self._coordinates.triangle)

    @cached_property
    def products(self) -> Array:
        """Their products with each other."""
        return self.across_model.T @ self.across_model

    @property
    def model(self) -> Array:
        """The model's columns in coordinates, of length 1, (K, p)."""
        return np.asarray(self._coordinates.triangle[:, self._model])

    def base(self, included: Sequence[Candidate] = ()) -> ColumnSpace:
        """Return the space of the model's columns with those of some candidates."""
        return self._given(included).space

    def _given(self, included: Sequence[Candidate]) -> _Base:
        """Return the base with some candidates; those asked for last are kept."""
        key = tuple(id(c) for c in included)
        found = self._bases.pop(key, None)
        if found is None:
            found = _Base(ColumnSpace.of([self.model, *(self.columns(c) for c in included)]), {})
        self._bases[key] = found
        if len(self._bases) > BASES:
            del self._bases[next(iter(self._bases))]
        return found

    # scores --------------------------------------------------------------------------------------------------

    def across(self, included: Sequence[Candidate], candidate: Candidate) -> Array:
        """Return an orthonormal basis of what a candidate does that the model with others cannot imitate, (K, k)."""
        return self._across(self._given(included), candidate)[0]

    def _across(self, base: _Base, candidate: Candidate) -> tuple[Array, float]:
        """Return an orthonormal basis of what a candidate does that a base cannot imitate, and how much that is."""
        found = base.across.get(id(candidate))
        if found is None:
            rest = base.space.project_out(self.columns(candidate))
            visible = float(np.linalg.norm(rest) / np.sqrt(self._there[id(candidate)]))
            found = base.across[id(candidate)] = directions_above(rest, SELECTION.visible), visible
        return found

    def _look_at_all(self, base: _Base) -> None:
        """Find at once what `_across` returns of each candidate."""
        by_size: dict[int, list[Candidate]] = {}
        for candidate in self.candidates:
            if id(candidate) not in base.across:
                by_size.setdefault(candidate.columns.shape[2], []).append(candidate)
        if not by_size:
            return
        rest = base.space.project_out(self._coordinates.triangle)
        squares = np.einsum("ij,ij->j", rest, rest)
        for size, some in by_size.items():
            blocks = np.array([self._parts[id(c)].start for c in some])[:, None] + np.arange(size)
            visible = np.sqrt(squares[blocks].sum(axis=1) / [self._there[id(c)] for c in some])
            directions = directions_of_each(rest, blocks, SELECTION.visible)
            base.across.update(
                zip(map(id, some), zip(directions, visible.tolist(), strict=True), strict=True)
            )

    def score(
        self, included: Sequence[Candidate], residual: Array, total: float, candidate: Candidate
    ) -> Score:
        """Score a candidate, given others.

        Parameters
        ----------
        residual, total : ndarray, float
            Of the model with what is included; see `residual`.
        """
        given = self._given(included)
        return self._score(given, given.space.project_out(residual), total, candidate)

    def _score(self, given: _Base, residual: Array, total: float, candidate: Candidate) -> Score:
        base = given.space
        directions, visible = self._across(given, candidate)
        test = base.score_test(residual, directions, readings=self.readings, total=total)
        if test is None:
            left = max(total, float(residual @ residual))
            return Score(candidate, 0.0, 0, 0.0, 0.0, max(self.readings - base.rank, 0), visible, left)
        log = min(test.log_p + float(np.log(candidate.tries)), 0.0)
        return Score(
            candidate, test.fall, test.dof, log, test.statistic, test.residual_dof, visible, test.left
        )

    def scores(self, residual: Array, total: float, included: Sequence[Candidate] = ()) -> list[Score]:
        """Score every candidate that is not included, the best value of a searched parameter of each; best first.

        Parameters
        ----------
        residual, total : ndarray, float
            Of the model with what is included; see `residual`.
        """
        given = self._given(included)
        self._look_at_all(given)
        residual = given.space.project_out(residual)
        gone = {c.key for c in included}
        best: dict[tuple[str, str | None], Score] = {}
        for candidate in self.candidates:
            if candidate.key in gone:
                continue
            score = self._score(given, residual, total, candidate)
            if candidate.key not in best or self._log_p(score) < self._log_p(best[candidate.key]):
                best[candidate.key] = score
        # what cannot be seen at all is so to rounding: there the order of the catalogue decides
        return sorted(best.values(), key=lambda score: (score.log_p, -round(score.visible, 6)))

    def _log_p(self, score: Score) -> float:
        """Return by what the best of a candidate's variants is chosen: a further weight must be worth its cost."""
        weights = score.candidate.later_weights
        return score.log_p + SELECTION.parameter_cost(self.readings) / 2 * weights

    def pair_falls(
        self, residual: Array, scores: Sequence[Score], included: Sequence[Candidate] = ()
    ) -> Array:
        """Return by how much each two of some scored candidates together lower the sum of squares, (n, n).

        Parameters
        ----------
        residual : ndarray
            Of the model as it was; see `residual`.
        scores : sequence of Score
            Given those included.
        """
        given = self._given(included)
        self._look_at_all(given)  # unless they were looked at for the scores just before
        bases = [self._across(given, score.candidate)[0] for score in scores]
        return pair_falls(bases, given.space.project_out(residual), least=SELECTION.visible)

    def tests(self, scores: Sequence[Score], included: Sequence[Candidate] = ()) -> float:
        """Return the number of independent tests that the scores amount to; see :func:`effective_tests`."""
        given = self._given(included)
        self._look_at_all(given)
        parts = [self._across(given, score.candidate)[0] for score in scores if score.dof]
        residual_dof = max(self.readings - given.space.rank, 1)
        return effective_tests(parts, residual_dof, given.space.basis)
