"""The columns of a model and of all candidates, as coordinates in the space that they span together.

Whitened residuals of n rows are compared with columns in that space only, which has as many dimensions as there are
columns; what of the residuals lies outside is the same for every model. So a score test of a candidate costs a product
of small matrices, whatever n is.

A candidate is scored by F: the fall of the sum of squares that its columns, with what the model can imitate taken off,
bring for each of them, over what is left (Rao 1948). Directions in which the model imitates a candidate nearly whole
are left out: to be seen there its parameters would have to be far beyond what is usual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.statistics.f_distribution import log10_of_f
from rodgen.statistics.orthonormal import orthonormal

__all__ = ["VISIBLE", "Score", "Space", "Whiten", "log_p"]

Array: TypeAlias = NDArray[np.float64]
Whiten: TypeAlias = Callable[[Array], Array]

VISIBLE = 0.02
"""Part of a candidate's column, or combination of columns, that must be left beside the model to be looked at: with
less an effect would have to be fifty times as large as what it shows."""
SIMULATIONS = 2000
RATE = 0.01
"""Rate of false alarms at which the number of independent candidates is counted."""


@dataclass(frozen=True)
class Score:
    """What a candidate would bring.

    Attributes
    ----------
    candidate : Candidate
    fall : float
        Of the sum of squares.
    freedoms : int
        Combinations of its parameters that are seen.
    log_p : float
        Natural logarithm of the probability that chance does as much for it alone, all values of a searched parameter
        counted.
    statistic : float
    spare : int
        Degrees of freedom of what is left.
    visible : float
        Part of the columns that the model cannot imitate.
    left : float
        Sum of squares that is left.
    """

    candidate: Candidate
    fall: float
    freedoms: int
    log_p: float
    statistic: float
    spare: int
    visible: float
    left: float

    @property
    def parameters(self) -> int:
        """Number of parameters that are seen, searched ones among them."""
        return self.freedoms + (len(self.candidate.searched) if self.freedoms else 0)


class Space:
    """Coordinates of columns and residuals.

    Parameters
    ----------
    model : ndarray, shape (n, m, p)
        The model's columns.
    found : sequence of Candidate
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
        whole = whole / np.where(self.length > 0, self.length, 1.0)
        basis, self._triangle = _reduced(whole)
        self._basis = basis
        ends = np.cumsum(sizes)
        self._model = slice(0, int(ends[0]))
        self._parts = {
            id(c): slice(int(a), int(b)) for c, a, b in zip(found, ends[:-1], ends[1:], strict=True)
        }

    # coordinates ---------------------------------------------------------------------------------------------

    def residual(self, residual: Array) -> tuple[Array, float]:
        """Return the coordinates of weighted residuals (n, m), and the sum of squares of all of it."""
        white = self.whiten(residual[:, :, None]).ravel()
        return self._basis.T @ white, float(white @ white)

    def columns(self, candidate: Candidate) -> Array:
        """Return a candidate's columns in coordinates, of length 1."""
        return np.asarray(self._triangle[:, self._parts[id(candidate)]])

    def sizes(self, candidate: Candidate) -> Array:
        """Return the lengths that these columns have."""
        return np.asarray(self.length[self._parts[id(candidate)]])

    @property
    def model(self) -> Array:
        """The model's columns in coordinates, of length 1, (K, p)."""
        return np.asarray(self._triangle[:, self._model])

    def base(self, included: Sequence[Candidate] = ()) -> Array:
        """Return an orthonormal basis of the model with some candidates, (K, rank)."""
        columns = [self.model, *(self.columns(c) for c in included)]
        return orthonormal(np.concatenate(columns, axis=1))

    # scores --------------------------------------------------------------------------------------------------

    def across(self, base: Array, candidate: Candidate) -> tuple[Array, float]:
        """Return an orthonormal basis of what a candidate does that a base does not, and how much that is."""
        columns = self.columns(candidate)
        rest = columns - base @ (base.T @ columns)
        rest -= base @ (base.T @ rest)
        u, s, _ = np.linalg.svd(rest, full_matrices=False)
        seen = s > VISIBLE
        there = max(int((self.sizes(candidate) > 0).sum()), 1)
        return u[:, seen], float(np.sqrt(np.sum(s**2) / there))

    def scores(self, residual: Array, total: float, included: Sequence[Candidate] = ()) -> list[Score]:
        """Score every candidate that is not included, the best value of a searched parameter of each; best first.

        Parameters
        ----------
        residual, total : ndarray, float
            Of the model with what is included; see `residual`.
        included : sequence of Candidate
        """
        base = self.base(included)
        residual = residual - base @ (base.T @ residual)
        spare = self.readings - base.shape[1]
        gone = {c.key for c in included}
        best: dict[tuple[str, str | None], Score] = {}
        for candidate in self.candidates:
            if candidate.key in gone:
                continue
            directions, visible = self.across(base, candidate)
            k = directions.shape[1]
            left = max(total, float(residual @ residual))
            if k == 0 or spare - k < 1 or left <= 0:
                score = Score(candidate, 0.0, 0, 0.0, 0.0, max(spare, 0), visible, left)
            else:
                fall = float(np.sum((directions.T @ residual) ** 2))
                log = min(log_p(fall, left, k, spare - k) + float(np.log(candidate.tries)), 0.0)
                f = fall / k / max((left - fall) / (spare - k), 1e-300)
                score = Score(candidate, fall, k, log, f, spare - k, visible, left - fall)
            if candidate.key not in best or score.log_p < best[candidate.key].log_p:
                best[candidate.key] = score
        return sorted(best.values(), key=lambda score: (score.log_p, -score.visible))

    def tests(self, scores: Sequence[Score], included: Sequence[Candidate] = ()) -> float:
        """Return as how many independent tests all of them count: by the least probability of simulated chance."""
        base = self.base(included)
        parts = []
        for score in scores:
            if score.freedoms:
                parts.append(self.across(base, score.candidate)[0])
        if not parts:
            return 1.0
        spare = max(scores[0].spare, 1)
        random = np.random.default_rng(0)
        u, _, _ = np.linalg.svd(np.concatenate(parts, axis=1), full_matrices=False)
        inside = random.normal(size=(u.shape[1], SIMULATIONS))
        rest = max(spare - u.shape[1], 0)
        total = np.sum(inside**2, axis=0) + (random.chisquare(rest, SIMULATIONS) if rest else 0.0)
        from scipy.special import betainc

        least = np.ones(SIMULATIONS)
        for part in parts:
            k = part.shape[1]
            fall = np.sum(((u.T @ part).T @ inside) ** 2, axis=0)
            x = np.clip(1 - fall / total, 0.0, 1.0)
            least = np.minimum(least, betainc(max(spare - k, 1) / 2, k / 2, x))
        quantile = float(np.quantile(least, RATE))
        return max(-np.log1p(-RATE) / quantile, 1.0) if quantile > 0 else float(len(parts))


def _reduced(whole: Array) -> tuple[Array, Array]:
    basis, triangle = np.linalg.qr(whole)
    return basis, triangle


def log_p(fall: float, total: float, freedoms: int, spare: int) -> float:
    """Return the logarithm of the probability of F by chance, also where it is too small for a double.

    Parameters
    ----------
    fall, total : float
        Sum of squares that is taken away, and before.
    freedoms, spare : int
        Degrees of freedom of F.
    """
    return log10_of_f(fall, total - fall, freedoms, spare) * float(np.log(10))
