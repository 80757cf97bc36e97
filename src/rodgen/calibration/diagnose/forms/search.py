"""Which forms the residuals have: a forward search through the dictionary, the simplest of what predicts equally well.

All terms at all places are scored at once on some of the rows. The best of every kind are scored anew on all rows,
their searched values are refined, and they are multiplied by functions of further drivers: a wave that grows with the
load shows as a wave first. The errors of the best of all these on poses left out follow by linear algebra. The
simplest whose error is within one standard error of the lowest is taken, if chance does not do as much for any of all
terms tried, and if it lowers that error noticeably at all. Then the next is looked for with it in the model. At the end
each is looked for anew, given the others: the first was found when they were still in the residuals.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.diagnose.forms.dictionary import (
    Term,
    dictionary,
    drivers_of,
    is_catalogued,
    leader,
    multiplied,
)
from rodgen.calibration.diagnose.forms.formula import Form, Piece, values_of, write
from rodgen.calibration.diagnose.forms.projected_rows import PosesLeftOut, ProjectedRows, folds_of
from rodgen.calibration.diagnose.forms.refine import refined, short
from rodgen.calibration.diagnose.forms.screen import Functions, Screen
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.statistics.columns import Whiten, project_out, unchanged, unit_columns
from rodgen.statistics.decompositions import lstsq
from rodgen.statistics.f_tests import log10_p_of_fall
from rodgen.statistics.thresholds import FORMS, SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.diagnose.sensitivities import Sensitivities


ROUGH_ROWS = 1500
"""All terms are scored on so many rows; a form that lowers the error by a percent shows on them, too."""
COSINES = 12
"""Of each degree of freedom of a drift of the frame, where readings depend on each other."""
STRETCHED = 0.05
"""Cosines whose variance is below this part of a reading's are left out, which changes rough scores by 5 % at most."""
SHORT_LIST, OF_TERM, OF_FAMILY, OF_SENSITIVITY = 140, 8, 16, 12
"""Terms that are scored anew on all rows, and how many of them may be one term, of one family, at one sensitivity: a
strong form has so many near copies that they would leave no room for anything else."""
REFINED, REFINED_OF_FAMILY = 14, 2
"""Of these so many are looked at between the values on the grid, each of which takes ten rounds."""
WORTH_REFINING = 0.3
"""Part of the best fall that such a term needs: between the values on the grid a fall grows by a factor of 2.2 at most,
see BETTER."""
POLISHED = 5
"""Of these so many are looked at closer on all rows, and at other places, too."""
MULTIPLIED = 6
"""The best so many are multiplied by functions of drivers that they do not follow."""
DIVIDED = 6
"""Of the best so many, some of the functions alone are tried, too."""
ASKED = 32
"""Best terms by which it is decided whether anything can be found."""
JUDGED = 24
"""Terms of which the error on unseen poses is worked out."""
BETTER = 1.4
"""Where a fall on the grid would be chance even if a search between its values raised it so much, no search is made.
Measured with a straight line in the model, over evenly spread coordinates: waves gain 1.24 at most, bends 1.3, time
constants 1.02; steps and bumps halfway between two places up to 2.2, so that a weak one of these may be missed."""
HARDLY = 0.3
"""Nothing is looked for where the best term on the grid takes away less than this part of what is noticeable: for the
same reason as with WORTH_REFINING."""
COMPONENTS = ("reading", "tx", "ty", "tz", "rx", "ry", "rz")
NO_RESIDUAL = 1e-13
"""Residuals below this part of the readings are rounding."""


def find_forms(
    sensitivities: Sensitivities,
    whiten: Whiten,
    model: Array,
    further: Array | None = None,
    *,
    most: int = 3,
) -> list[Form]:
    """Return the forms of the residuals, the most important first; none where they are noise.

    Parameters
    ----------
    sensitivities : Sensitivities
        Of the fitted model.
    whiten : callable
        Brings columns (n, m, K) to where errors are independent; `unchanged` where they are.
    model : ndarray, shape (n, m, p)
        Columns that the model's parameters can make up for.
    further : ndarray, shape (n, m, k), optional
        More of them.
    most : int
        Terms at most.
    """
    with one_thread_in_blas():
        search = _Search.of(sensitivities, whiten, model, model[:, :, :0] if further is None else further)
        return [] if search is None else search.forms(most, np.log10(SELECTION.family_wise))


@dataclass
class _Found:
    """A piece with what it explains, given all others."""

    piece: Piece
    fall: float
    log10_p: float


class _Search:
    def __init__(
        self,
        sensitivities: Sensitivities,
        whiten: Whiten,
        places: list[tuple[str | None, str]],
        C: Array,
        model: Array,
        further: Array,
    ) -> None:
        self.o = o = sensitivities.observations
        self.places = places
        self.drivers, self.rows = drivers_of(o), _some(o.n, ROUGH_ROWS)
        self._known: dict[Piece, float] = {}
        self._multiplied: set[Piece] = set()
        residual, m = sensitivities.residual, C.shape[2]
        pose, fold = (np.repeat(numbers, m) for numbers in folds_of(o.pose))
        order = np.argsort(fold, kind="stable")
        self.exact = ProjectedRows(C, [d.values for d in self.drivers], residual, whiten, order=order)
        self.exact.take_out(self.exact.flat(np.concatenate([model, further], axis=2)))
        if not self.possible:
            return
        drift = _drift(sensitivities, whiten)
        self.rough, self.screen = self._screened(residual, C, model, drift)
        if further.shape[2]:
            self.screen.take_out(self.rough.take_out(self.rough.flat(further[self.rows])))
        self.tried = self.screen.tried
        self.unseen = PosesLeftOut(self.exact, pose[order], fold[order])
        self.start = self.exact.total

    def _screened(
        self, residual: Array, C: Array, model: Array, drift: Array | None
    ) -> tuple[ProjectedRows, Screen]:
        """Return some rows less the model's columns, and the scores of all terms on them."""
        rows = self.rows
        drivers = [driver.values[rows] for driver in self.drivers]
        if drift is not None:
            drift = drift[rows].reshape(len(rows) * C.shape[2], -1)
        rough = ProjectedRows(C[:, rows], drivers, residual[rows], unchanged, drift=drift)
        rough.take_out(rough.flat(model[rows]))
        at: dict[str, list[int]] = {}
        for i, (place, _) in enumerate(self.places):
            if place is not None:
                at.setdefault(place, []).append(i)
        functions = Functions.of(dictionary(self.drivers, self.o.machine), drivers)
        return rough, Screen(rough, functions, at)

    @property
    def possible(self) -> bool:
        """Whether there is anything to look for, and something to look with."""
        return self.exact.dof >= FORMS.fewest_residual_dof and bool(self.drivers) and self.exact.total > 0

    @classmethod
    def of(cls, sensitivities: Sensitivities, whiten: Whiten, model: Array, further: Array) -> _Search | None:
        """Return a prepared search; None where there is nothing to look for."""
        joints = [joint.name for joint in sensitivities.fit.machine.joints]
        found = [
            ((place, component), column)
            for place in (*joints, None)
            for component in COMPONENTS
            if (column := sensitivities.component(place, component)) is not None and np.any(column)
        ]
        problem = sensitivities.fit.problem
        rounding = NO_RESIDUAL**2 * problem.scale * len(sensitivities.residual) / max(problem.count, 1)
        if (
            not found
            or sensitivities.residual.size < FORMS.fewest_residual_dof
            or np.sum(sensitivities.residual**2) <= rounding
        ):
            return None
        places, C = [place for place, _ in found], np.stack([column for _, column in found])
        search = cls(sensitivities, whiten, places, C, model, further)
        return search if search.possible else None

    rough: ProjectedRows
    screen: Screen
    tried: int

    # one step ------------------------------------------------------------------------------------------------------

    @property
    def variance(self) -> float:
        """The variance of a whitened reading."""
        return self.exact.total / max(self.exact.dof, 1)

    def _score(self, part: Any, parameters: Any) -> Any:
        """Return half the fall of the deviance, less what parameters cost (Schwarz's criterion, BIC)."""
        n = self.exact.dof
        gain = -n / 2 * np.log1p(-np.minimum(part, 1 - 1e-15))
        return gain - parameters / 2 * np.log(max(n, 2))

    def _flat(self, piece: Piece) -> Array:
        return self.exact.flat(self.exact.columns_of(piece))

    def _falls(self, pieces: Sequence[Piece]) -> Array:
        new = [piece for piece in dict.fromkeys(pieces) if piece not in self._known]
        self._known.update(zip(new, self.exact.falls_of(new).tolist(), strict=True))
        return np.array([self._known[piece] for piece in pieces])

    def candidates(self, limit: float, known: Sequence[Piece] = ()) -> list[tuple[float, float, Piece]]:
        """Return score, fall and piece of the best terms, the best first, searched values refined.

        None of them where all that may be found is too probable by chance, or too little.
        """
        short_list = [*known, *self._short_list()]
        if not self._promising(short_list[:ASKED], limit):
            return []
        falls = self._falls(short_list)
        top = falls.max(initial=0.0)
        order = np.argsort(-falls, kind="stable")
        count: dict[Any, int] = {}
        again: list[Piece] = []
        for i in order:
            piece = short_list[i]
            family = piece.term.family
            if piece.term.searched and falls[i] > WORTH_REFINING * top and len(again) < REFINED:
                count[family] = count.get(family, 0) + 1
                if count[family] <= REFINED_OF_FAMILY:
                    again.append(piece)
        near = self._refined(again)
        better = [self._polished(piece) for _, _, piece in self._scored(near)[:POLISHED]]
        moved = [other for piece in better for other in self._elsewhere(piece)]
        pieces = list(dict.fromkeys([*short_list, *better, *moved]))
        best = [piece for _, _, piece in self._scored(pieces)[:MULTIPLIED]]
        pieces += self._products(best)
        whole = [piece for _, _, piece in self._scored(list(dict.fromkeys(pieces)))[: 2 * JUDGED]]
        parts = [part for piece in whole[:DIVIDED] for part in _parts(piece)]
        return self._scored(list(dict.fromkeys([*whole, *parts])))

    def _promising(self, pieces: Sequence[Piece], limit: float) -> bool:
        falls = self._falls(pieces)
        if falls.max(initial=0.0) < HARDLY * FORMS.noticeable * self.exact.total:
            return False
        gains = [BETTER if piece.term.searched else 1.0 for piece in pieces]
        chances = (
            self._chance(piece, min(gain * fall, self.exact.total))
            for piece, fall, gain in zip(pieces, falls, gains, strict=True)
        )
        return any(chance < limit for chance in chances)

    def _refined(self, pieces: Sequence[Piece]) -> list[Piece]:
        return [
            Piece.whole(refined(self.rough, p.term, p.sensitivity, self.drivers), p.sensitivity)
            for p in pieces
        ]

    def _polished(self, piece: Piece) -> Piece:
        term = refined(self.exact, piece.term, piece.sensitivity, self.drivers, last=True)
        return Piece.whole(short(self.exact, term, piece.sensitivity, self.drivers), piece.sensitivity)

    def _products(self, pieces: Sequence[Piece]) -> list[Piece]:
        """Return the best products of pieces with functions of further drivers; these count as tried."""
        made = dict.fromkeys(
            Piece.whole(term, piece.sensitivity)
            for piece in pieces
            for term in multiplied(piece.term, self.drivers, self.o.machine)
            if term.at in {None, self.places[piece.sensitivity][0]}
        )
        new = made.keys() - self._multiplied
        self._multiplied |= new
        self.tried += len(new)
        found = self._best_of(list(made))
        searched = [piece for _, _, piece in self._scored(found)[:POLISHED] if piece.term.searched]
        return [*found, *(self._polished(piece) for piece in self._refined(searched))]

    def _best_of(self, pieces: Sequence[Piece]) -> list[Piece]:
        if not pieces:
            return []
        parts = self.rough.falls_of(pieces) / max(self.rough.total, 1e-300)
        scores = self._score(parts, np.array([piece.parameters for piece in pieces]))
        return [pieces[i] for i in np.argsort(-scores, kind="stable")[:MULTIPLIED]]

    def _elsewhere(self, piece: Piece) -> list[Piece]:
        """Return a piece at the other sensitivities that are nearly as good on some rows."""
        pieces = [
            replace(piece, sensitivity=i)
            for i, (place, _) in enumerate(self.places)
            if piece.term.at is None or place == piece.term.at
        ]
        falls = self.rough.falls_of(pieces)
        return [pieces[i] for i in np.argsort(-falls, kind="stable")[:OF_TERM]]

    def _short_list(self) -> list[Piece]:
        """Return the best terms of every kind and place by the scores on some rows."""
        chosen: list[Piece] = []
        at: dict[int, int] = defaultdict(int)
        of_family: dict[Any, int] = defaultdict(int)
        of_term: dict[Term, int] = defaultdict(int)
        for score, term, sensitivity in self.screen.best(self._score):
            if not score > -np.inf or len(chosen) >= SHORT_LIST:
                break
            if (  # the quickest to ask first
                at[sensitivity] < OF_SENSITIVITY
                and of_family[term.family] < OF_FAMILY
                and of_term[term] < OF_TERM
            ):
                at[sensitivity] += 1
                of_family[term.family] += 1
                of_term[term] += 1
                chosen.append(Piece.whole(term, sensitivity))
        return chosen

    def _scored(self, pieces: Sequence[Piece]) -> list[tuple[float, float, Piece]]:
        falls = self._falls(pieces)
        scores = [
            float(self._score(fall / self.exact.total, piece.parameters))
            for fall, piece in zip(falls, pieces, strict=True)
        ]
        order = np.argsort(-np.array(scores), kind="stable")
        return [(scores[i], float(falls[i]), pieces[i]) for i in order]

    def _once(self, candidates: Sequence[tuple[float, float, Piece]]) -> list[tuple[float, float, Piece]]:
        """Return, of candidates whose columns are the same on these data, the simplest."""
        by: dict[Any, tuple[float, float, Piece]] = {}
        for one in candidates:
            _, fall, piece = one
            key = piece.term.factors, piece.kept, round(fall / self.variance, 3)
            if key not in by or self._simplicity(piece) < self._simplicity(by[key][2]):
                by[key] = one
        return list(by.values())

    def next(self, limit: float, known: Sequence[Piece] = ()) -> _Found | None:
        """Return the simplest piece of those that predict best; None where chance does as much.

        Parameters
        ----------
        known : sequence of Piece
            To be tried in any case: the scores on some rows may miss it.
        """
        candidates = self._once(self.candidates(limit, known))[:JUDGED]
        if not candidates:
            return None
        before = self.unseen.squares()
        errors = np.array([self.unseen.squares(self._flat(piece)) for _, _, piece in candidates])
        best = int(np.argmin(errors.sum(axis=1)))
        choices = [
            len(piece.term.searched) + FORMS.a_driver * (self._drivers(piece) - 1)
            for _, _, piece in candidates
        ]
        within = [
            i
            for i, more in enumerate(errors - errors[best])
            if _excess(more) <= 1.0
            or more.sum() <= FORMS.slight * self.variance * (1 + max(choices[best] - choices[i], 0))
        ]
        chosen = min(within, key=lambda i: (self._simplicity(candidates[i][2]), errors[i].sum()))
        _, fall, piece = candidates[chosen]
        found = _Found(piece, fall, self._chance(piece, fall))
        gained = before - errors[chosen]
        noticeable = gained.sum() > FORMS.noticeable * before.sum() and _excess(gained) > 1.0
        return found if noticeable and found.log10_p < limit else None

    def _chance(self, piece: Piece, fall: float) -> float:
        k = piece.parameters
        left = max(self.exact.total - fall, 0.0)
        tried = np.log10(max(self.tried, 1)) + np.log10(FORMS.choices) * len(piece.term.searched)
        return min(log10_p_of_fall(fall, left, k, self.exact.dof - k) + float(tried), 0.0)

    def _simplicity(self, piece: Piece) -> tuple[int, int, bool, int, int, int]:
        """Return the key by which the simplest piece is the least.

        Parameters, factors, whether the catalogue lacks it, order, columns among its drivers, how far from its driver's
        joint it acts. Every further driver counts as `FORMS.a_driver` parameters.
        """
        term = piece.term
        place, component = self.places[piece.sensitivity]
        driven = {
            self.drivers[f.driver].joint for f in term.factors if self.drivers[f.driver].kind == "joint"
        }
        own = place in driven if driven else place is not None
        rank = {"e": 0, "t": 1, "r": 2}["e" if component == "reading" else component[0]] + 3 * (not own)
        new = not is_catalogued(term, place, component, self.drivers, self.o.machine)
        noted = sum(self.drivers[f.driver].kind == "column" for f in term.factors)
        parameters = piece.parameters + FORMS.a_driver * (self._drivers(piece) - 1)
        return parameters, len(term.factors), new, term.order, noted, rank

    def _drivers(self, piece: Piece) -> int:
        """Return how many drivers a piece follows; what belongs to one joint counts as one."""
        drivers = [self.drivers[factor.driver] for factor in piece.term.factors]
        return len({driver.joint or driver.name for driver in drivers})

    # all steps -----------------------------------------------------------------------------------------------------

    def _take_out(self, piece: Piece) -> None:
        self.exact.take_out(self._flat(piece))
        self._known = {}
        self.screen.take_out(self.rough.take_out(self.rough.flat(self.rough.columns_of(piece))))
        self.unseen.refresh()

    def _restart_with(self, state: Any, pieces: Sequence[Piece]) -> None:
        """Go back to the model alone, and take out some pieces."""
        self._known = {}
        self.exact.restore(state[0])
        self.rough.restore(state[1])
        self.screen.restore(state[2])
        self.unseen.refresh()
        for piece in pieces:
            self._take_out(piece)

    def forms(self, most: int, limit: float) -> list[Form]:
        """Search, and write what was found."""
        state = self.exact.state(), self.rough.state(), self.screen.state()
        pieces: list[Piece] = []
        while len(pieces) < most:
            found = self.next(limit)
            if found is None:
                break
            pieces.append(found.piece)
            if len(pieces) < most:
                self._take_out(found.piece)
        if not pieces:
            return []
        if len(pieces) > 1:
            pieces = self._looked_for_anew(state, pieces, limit)
        return self._written(state, pieces)

    def _looked_for_anew(self, state: Any, pieces: list[Piece], limit: float) -> list[Piece]:
        """Look for each piece anew, given the others, in order; what is no longer called for goes."""
        pieces = list(pieces)
        for piece in list(pieces)[:-1]:
            others = [other for other in pieces if other is not piece]
            self._restart_with(state, others)
            found = self.next(limit, [piece])
            if found is None:
                pieces = others
            elif found.piece != piece:
                own = float(self._falls([piece])[0])
                if found.fall > own or found.piece.parameters < piece.parameters:
                    pieces = [found.piece if other is piece else other for other in pieces]
        return pieces

    def _written(self, state: Any, pieces: Sequence[Piece]) -> list[Form]:
        found = []
        for piece in pieces:
            self._restart_with(state, [other for other in pieces if other is not piece])
            fall = float(self._falls([piece])[0])
            found.append(_Found(piece, fall, self._chance(piece, fall)))
        self._restart_with(state, [])
        size = -self._coefficients(pieces)
        starts = np.cumsum([0, *[len(piece.kept) for piece in pieces]])
        # a function f(q), and f(q) times X: one form f(q)*(a + b*X), and f(q) says nothing where X is zero
        drives = [
            max((self._drives(other) for other in pieces if _belongs(piece, other)), key=len)
            for piece in pieces
        ]
        groups: dict[Any, list[int]] = {}
        for i, piece in enumerate(pieces):
            groups.setdefault((piece.sensitivity, drives[i]), []).append(i)
        forms = []
        for (sensitivity, _), numbers in groups.items():
            coefficients = [float(x) for i in numbers for x in size[starts[i] : starts[i + 1]]]
            forms.append(self._form(sensitivity, [found[i] for i in numbers], coefficients))
        return sorted(forms, key=lambda form: -form.explains)

    def _drives(self, piece: Piece) -> frozenset[str]:
        return frozenset(leader(self.drivers[factor.driver]) for factor in piece.term.factors)

    def _coefficients(self, pieces: Sequence[Piece]) -> Array:
        flat = np.concatenate([self._flat(piece) for piece in pieces], axis=1)
        size = np.linalg.norm(flat, axis=0)
        rest = project_out(self.exact.basis, unit_columns(flat))
        return np.asarray(lstsq(rest, self.exact.left, relative=1e-9) / np.where(size > 0, size, 1.0))

    def _form(self, sensitivity: int, found: Sequence[_Found], coefficients: Sequence[float]) -> Form:
        place, component = self.places[sensitivity]
        machine = self.o.machine
        pieces = [one.piece for one in found]
        text = write(pieces, place, component, self.drivers, self.o)
        numbers = {**dict(zip(text.coefficients, coefficients, strict=True)), **text.hold}
        log10_p = min(one.log10_p for one in found)
        return Form(
            place,
            component,
            text.driver,
            text.formula,
            values_of(text.units, numbers, machine),
            log10_p,
            min(sum(one.fall for one in found) / self.start, 1.0),
            np.concatenate([self.exact.columns_of(piece) for piece in pieces], axis=2),
            text.units,
            text.hold,
            text.name,
            all(is_catalogued(piece.term, place, component, self.drivers, machine) for piece in pieces),
            len(pieces),
            sum(len(piece.term.searched) for piece in pieces),
        )


def _belongs(piece: Piece, other: Piece) -> bool:
    """Return whether all factors of a piece are among those of another at its place."""
    return piece.sensitivity == other.sensitivity and set(piece.term.factors) <= set(other.term.factors)


def _parts(piece: Piece) -> list[Piece]:
    """Return pieces with some of the functions only, where these are more than a sine with its cosine."""
    term, count = piece.term, piece.term.count
    powers = any(factor.kind in {"series", "polynomial"} for factor in term.factors)
    if len(piece.kept) < count or count > 5 or not (powers or (len(term.factors) > 1 and count > 1)):
        return []
    return [
        replace(piece, kept=kept) for size in range(1, count) for kept in combinations(range(count), size)
    ]


def _excess(differences: Array) -> float:
    """Return a sum over poses in its standard errors."""
    spread = float(np.std(differences)) * np.sqrt(len(differences))
    total = float(differences.sum())
    return total / spread if spread > 0 else (np.inf if total > 0 else 0.0)


def _some(count: int, most: int) -> NDArray[np.int_]:
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def _drift(sensitivities: Sensitivities, whiten: Whiten) -> Array | None:
    """Return columns of the drift that readings have in common, (n, m, d), of variance 1; None where there is none.

    The frame's degrees of freedom times cosines over the row are nearly what the covariance of a drift only stretches:
    by how much is seen from what whitening makes of them.
    """
    if whiten is unchanged:
        return None
    n = sensitivities.observations.n
    waves = np.cos(np.pi * np.outer((np.arange(n) + 0.5) / n, np.arange(COSINES)))
    made = sensitivities.frame[:, :, :, None] * waves[:, None, None, :]
    made = made.reshape(*made.shape[:2], -1)
    size = np.sqrt(np.sum(made**2, axis=(0, 1)))
    made = made[:, :, size > 0] / size[size > 0]
    left = np.sum(whiten(made) ** 2, axis=(0, 1))
    stretched = np.maximum(1 / np.maximum(left, 1e-12) - 1, 0.0)
    kept = stretched > STRETCHED
    return np.asarray(made[:, :, kept] * np.sqrt(stretched[kept])) if kept.any() else None
