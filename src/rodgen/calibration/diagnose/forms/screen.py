"""Every term at every place, scored at once.

A column is a sensitivity, a vector for every row, times a function of drivers, a number for every row. So its products
with the residuals and with the basis of what the model can make up for are those of the function with sums over the
vector's components: for all functions and all sensitivities one product of matrices, in single precision, for ranking
only.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.forms.dictionary import Term
from rodgen.calibration.diagnose.forms.projected_rows import ProjectedRows

__all__ = ["Functions", "Screen"]

Array: TypeAlias = NDArray[np.float64]
Single: TypeAlias = NDArray[np.float32]

VISIBLE = 1e-4
"""Part of a column's sum of squares that must remain. In single precision it is known to 1e-6 (measured: 7e-7), so that
what remains is known to a percent."""
RIDGE = 1e-5
"""Added to the squares, which are 1, of a term's functions: two that are the same but for rounding have a solution."""


@dataclass(frozen=True, eq=False)
class Functions:
    """Terms that may stand at the same sensitivities, as numbers.

    Attributes
    ----------
    at : str or None
        The joint where alone they stand.
    terms : list of Term
    columns : list of list of int
        Of each term, numbers of its functions.
    values : ndarray, shape (b, n)
        Functions of length 1.
    pairs : ndarray of int, shape (2, x)
        Functions of one term.
    """

    at: str | None
    terms: list[Term]
    columns: list[list[int]]
    values: Single
    pairs: NDArray[np.int_]

    @classmethod
    def of(cls, terms: Sequence[Term], drivers: Sequence[Array]) -> list[Functions]:
        """Evaluate terms on some rows.

        Parameters
        ----------
        terms : sequence of Term
        drivers : sequence of ndarray, shape (n,)
        """
        by: dict[str | None, list[Term]] = {}
        for term in terms:
            by.setdefault(term.at, []).append(term)
        return [cls._at(joint, some, drivers) for joint, some in by.items()]

    @classmethod
    def _at(cls, joint: str | None, terms: list[Term], drivers: Sequence[Array]) -> Functions:
        columns: list[list[int]] = []
        functions: list[Array] = []
        for term in terms:
            made = term.columns(drivers)
            if any(factor.kind == "series" for factor in term.factors):
                size = np.linalg.norm(made, axis=0)
                made = np.linalg.qr(made / np.where(size > 0, size, 1.0))[0]  # powers are nearly one
            columns.append(list(range(len(functions), len(functions) + made.shape[1])))
            functions.extend(made.T)
        values = np.array(functions).reshape(len(functions), -1)
        size = np.sqrt(np.einsum("bn,bn->b", values, values))
        values /= np.where(size > 0, size, 1.0)[:, None]
        pairs = [pair for own in columns for pair in itertools.combinations(own, 2)]
        return cls(
            joint, terms, columns, values.astype(np.float32), np.array(pairs, np.int_).reshape(-1, 2).T
        )


@dataclass
class _Block:
    """Terms at their sensitivities."""

    of: Functions
    sensitivities: list[int]
    vectors: Single  # (n, c, m), sensitivities of length 1
    start: Single  # (b, c): squares of columns, before the model
    squares: Single  # (b, c), and products of pairs (x, c): what V^-1 and the model leave
    crossed: Single
    pull: Single  # (b, c)


class Screen:
    """Scores of all terms.

    Parameters
    ----------
    projected : ProjectedRows
    functions : sequence of Functions
        In the same rows.
    at : dict of str to list of int
        Numbers of the sensitivities of each joint, by its name.

    Attributes
    ----------
    tried : int
        Number of columns that were looked at.
    """

    def __init__(
        self, projected: ProjectedRows, functions: Sequence[Functions], at: dict[str, list[int]]
    ) -> None:
        self.projected = projected
        every = list(range(len(projected.sensitivities)))
        standing = [(some, every if some.at is None else at.get(some.at, [])) for some in functions]
        self._blocks = [self._block(some, sensitivities) for some, sensitivities in standing if sensitivities]
        self.take_out(projected.basis)
        self.tried = int(sum(np.sum(self._visible(block)) for block in self._blocks))

    def _block(self, of: Functions, sensitivities: list[int]) -> _Block:
        C = self.projected.sensitivities[sensitivities]
        size = np.sqrt(np.einsum("cnm,cnm->c", C, C))
        C = C / np.where(size > 0, size, 1.0)[:, None, None]
        weight = np.einsum("cnm,cnm->nc", C, C).astype(np.float32)
        start = (of.values**2) @ weight
        i, j = of.pairs
        crossed = (of.values[i] * of.values[j]) @ weight
        vectors = np.ascontiguousarray(C.transpose(1, 0, 2), np.float32)
        return _Block(of, sensitivities, vectors, start, start, crossed, np.zeros_like(start))

    def _carried(self, block: _Block, columns: Array) -> Single:
        """Return products of all terms' columns with columns (N, p), as (b, c, p)."""
        n, c, m = block.vectors.shape
        p = columns.shape[1]
        sums = np.matmul(block.vectors, columns.reshape(n, m, p).astype(np.float32))  # (n, c, p)
        made = block.of.values @ sums.reshape(n, c * p)
        return np.asarray(made.reshape(-1, c, p))

    def take_out(self, new: Array) -> None:
        """Follow the rows, to whose basis these columns were added."""
        for block in self._blocks:
            along = self._carried(block, np.concatenate([new, self.projected.left[:, None]], axis=1))
            block.pull = along[:, :, -1]
            along = along[:, :, :-1]
            block.squares = block.squares - np.einsum("bcp,bcp->bc", along, along)
            i, j = block.of.pairs
            if len(i):
                block.crossed = block.crossed - np.einsum("xcp,xcp->xc", along[i], along[j])

    def state(self) -> list[tuple[Single, Single, Single]]:
        """Return what `take_out` changes, for `restore`."""
        return [(block.squares, block.crossed, block.pull) for block in self._blocks]

    def restore(self, state: list[tuple[Single, Single, Single]]) -> None:
        """Go back to an earlier state."""
        for block, (squares, crossed, pull) in zip(self._blocks, state, strict=True):
            block.squares, block.crossed, block.pull = squares, crossed, pull

    def _visible(self, block: _Block) -> NDArray[np.bool_]:
        seen = block.squares > VISIBLE * block.start
        return np.array([seen[own].any(axis=0) for own in block.of.columns])

    def best(self, score: Any) -> Iterator[tuple[float, Term, int]]:
        """Yield score, term and sensitivity, the best first.

        Parameters
        ----------
        score : callable
            From parts of the sum of squares that are taken away, (terms, sensitivities), and the terms' numbers of
            parameters, (terms, 1).
        """
        values, starts = [], [0]
        for block in self._blocks:
            parameters = np.array([[term.parameters] for term in block.of.terms])
            values.append(score(self._falls(block) / max(self.projected.total, 1e-300), parameters).ravel())
            starts.append(starts[-1] + len(values[-1]))
        every = np.concatenate(values) if values else np.zeros(0)
        for index in np.argsort(-every, kind="stable"):
            number = int(np.searchsorted(starts, index, side="right")) - 1
            block = self._blocks[number]
            term, sensitivity = divmod(int(index) - starts[number], len(block.sensitivities))
            yield float(every[index]), block.of.terms[term], block.sensitivities[sensitivity]

    def _falls(self, block: _Block) -> Array:
        """Return the falls, (terms, sensitivities)."""
        seen = block.squares > VISIBLE * block.start
        size = np.sqrt(np.where(seen, block.squares, 1.0)).astype(float)
        pull = np.where(seen, block.pull, 0.0) / size
        columns = block.of.columns
        i, j = block.of.pairs
        shared = np.where(seen[i] & seen[j], block.crossed, 0.0) / (size[i] * size[j])
        falls = np.zeros((len(columns), len(block.sensitivities)))
        first = np.cumsum([0, *[len(own) * (len(own) - 1) // 2 for own in columns]])
        for count in {len(own) for own in columns}:
            terms = [t for t, own in enumerate(columns) if len(own) == count]
            g = pull[np.array([columns[t] for t in terms])]  # (t, count, c)
            gram = np.zeros((len(terms), len(block.sensitivities), count, count))
            gram[:, :, range(count), range(count)] = 1.0 + RIDGE
            for number, (a, b) in enumerate(itertools.combinations(range(count), 2)):
                gram[:, :, a, b] = gram[:, :, b, a] = shared[first[terms] + number]
            g = g.swapaxes(1, 2)
            falls[terms] = np.sum(_solved(gram, g) * g, axis=-1)
        return np.clip(falls, 0.0, self.projected.total)


def _solved(gram: Array, g: Array) -> Array:
    count = gram.shape[-1]
    if count == 1:
        return np.asarray(g / gram[..., 0])
    if count == 2:
        r = gram[..., 0, 1]
        det = np.maximum(gram[..., 0, 0] * gram[..., 1, 1] - r**2, RIDGE)
        first = (gram[..., 1, 1] * g[..., 0] - r * g[..., 1]) / det
        second = (gram[..., 0, 0] * g[..., 1] - r * g[..., 0]) / det
        return np.stack([first, second], axis=-1)
    values, vectors = np.linalg.eigh(gram)
    along = np.einsum("...ij,...i->...j", vectors, g)
    return np.asarray(np.einsum("...ij,...j->...i", vectors, along / np.maximum(values, 1e-3)))
