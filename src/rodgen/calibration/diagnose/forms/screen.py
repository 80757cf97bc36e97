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

from rodgen.array_types import Array
from rodgen.calibration.diagnose.forms.dictionary import Term, in_rows
from rodgen.calibration.diagnose.forms.projected_rows import ProjectedRows
from rodgen.statistics.columns import unit_columns

Single: TypeAlias = NDArray[np.float32]

VISIBLE = 1e-4
"""Part of a column's sum of squares that must remain. In single precision it is known to 1e-6 (measured: 7e-7), so that
what remains is known to a percent."""
RIDGE = 1e-5
"""Added to the squares, which are 1, of a term's functions: two that are the same but for rounding have a solution."""
LEAST = 1e-3
"""Part of a function's square, at least, that those before it in its term leave: with less it is not known."""
AT_ONCE = 1 << 20
"""Products with the model's columns that are held at a time: few enough for the cache."""
FIRST = 4096
"""Best terms that are put in order first."""


@dataclass(frozen=True, eq=False)
class Functions:
    """Terms that may stand at the same sensitivities, as numbers."""

    at: str | None
    """The joint where alone they stand."""
    terms: list[Term]
    parameters: NDArray[np.int_]
    """Their numbers of parameters, (terms, 1)."""
    starts: NDArray[np.int_]
    """The first function of each term, (terms,)."""
    sizes: tuple[tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_]], ...]
    """For each number k of functions that some terms have: these terms, (t,), their functions, (t, k), and the pairs of
    these, (t, k (k - 1) / 2)."""
    values: Single
    """Functions of length 1, (b, n)."""
    pairs: NDArray[np.int_]
    """Functions of one term, (2, x)."""

    @classmethod
    def of(cls, terms: Sequence[Term], drivers: Sequence[Array]) -> list[Functions]:
        """Evaluate terms on some rows.

        Parameters
        ----------
        drivers : sequence of ndarray, shape (n,)
        """
        by: dict[str | None, list[Term]] = {}
        for term in terms:
            by.setdefault(term.at, []).append(term)
        return [cls._at(joint, some, drivers) for joint, some in by.items()]

    @classmethod
    def _at(cls, joint: str | None, terms: list[Term], drivers: Sequence[Array]) -> Functions:
        counts = np.array([term.count for term in terms])
        values = np.empty((counts.sum(), len(drivers[0])), np.float32)
        starts = np.cumsum(counts) - counts
        for numbers, made in in_rows(terms, drivers):
            if {factor.kind for factor in terms[numbers[0]].factors} & {"series", "polynomial"}:
                made = np.linalg.qr(unit_columns(made))[0]  # powers are nearly one
            made = unit_columns(made).swapaxes(1, 2)
            values[starts[numbers, None] + np.arange(made.shape[1])] = made
        of_pairs = counts * (counts - 1) // 2
        first = np.cumsum(of_pairs) - of_pairs
        sizes = []
        for k in np.unique(counts):
            own = np.flatnonzero(counts == k)
            functions = starts[own, None] + np.arange(k)
            sizes.append((own, functions, first[own, None] + np.arange(k * (k - 1) // 2)))
        pairs = [
            (start + i, start + j)
            for start, count in zip(starts.tolist(), counts.tolist(), strict=True)
            for i, j in itertools.combinations(range(count), 2)
        ]
        return cls(
            joint,
            terms,
            np.array([[term.parameters] for term in terms]),
            starts,
            tuple(sizes),
            values,
            np.array(pairs, np.int_).reshape(-1, 2).T,
        )


@dataclass
class _Block:
    """Terms at their sensitivities."""

    of: Functions
    sensitivities: NDArray[np.int_]
    vectors: Single  # (n, c, m), sensitivities of length 1
    start: Single  # (b, c): squares of columns, before the model
    squares: Single  # (b, c), and products of pairs (x, c): what V^-1 and the model leave
    crossed: Single


class Screen:
    """Scores of all terms.

    Parameters
    ----------
    functions : sequence of Functions
        In the same rows.
    at : dict of str to list of int
        Numbers of the sensitivities of each joint, by its name.
    """

    def __init__(
        self, projected: ProjectedRows, functions: Sequence[Functions], at: dict[str, list[int]]
    ) -> None:
        self.projected = projected
        every = list(range(len(projected.sensitivities)))
        standing = [(some, every if some.at is None else at.get(some.at, [])) for some in functions]
        self._blocks = [self._block(some, sensitivities) for some, sensitivities in standing if sensitivities]
        self.take_out(projected.basis)

    @property
    def tried(self) -> int:
        """Number of terms, at all sensitivities, of which the model leaves something visible."""
        return int(
            sum(np.sum(np.logical_or.reduceat(self._seen(block), block.of.starts)) for block in self._blocks)
        )

    def _block(self, of: Functions, sensitivities: list[int]) -> _Block:
        C = self.projected.sensitivities[sensitivities]
        size = np.sqrt(np.einsum("cnm,cnm->c", C, C))
        C = C / np.where(size > 0, size, 1.0)[:, None, None]
        weight = np.einsum("cnm,cnm->nc", C, C).astype(np.float32)
        start = (of.values**2) @ weight
        i, j = of.pairs
        crossed = (of.values[i] * of.values[j]) @ weight
        vectors = np.ascontiguousarray(C.transpose(1, 0, 2), np.float32)
        return _Block(of, np.array(sensitivities), vectors, start, start, crossed)

    def take_out(self, new: Array) -> None:
        """Follow the rows, to whose basis these columns were added."""
        p = new.shape[1]
        if not p:
            return
        for block in self._blocks:
            n, c, m = block.vectors.shape
            columns = new.reshape(n, m, p).astype(np.float32)
            i, j = block.of.pairs
            squares, crossed = block.squares.copy(), block.crossed.copy()
            step = max(1, AT_ONCE // (len(squares) * p))
            for start in range(0, c, step):
                some = slice(start, min(start + step, c))
                sums = np.matmul(block.vectors[:, some], columns)  # (n, some, p)
                along = (block.of.values @ sums.reshape(n, -1)).reshape(len(squares), -1, p)
                squares[:, some] -= np.einsum("bcp,bcp->bc", along, along)
                if len(i):
                    crossed[:, some] -= np.einsum("xcp,xcp->xc", along[i], along[j])
            block.squares, block.crossed = squares, crossed

    def state(self) -> list[tuple[Single, Single]]:
        """Return what `take_out` changes, for `restore`."""
        return [(block.squares, block.crossed) for block in self._blocks]

    def restore(self, state: list[tuple[Single, Single]]) -> None:
        """Go back to an earlier state."""
        for block, (squares, crossed) in zip(self._blocks, state, strict=True):
            block.squares, block.crossed = squares, crossed

    def _seen(self, block: _Block) -> NDArray[np.bool_]:
        return np.asarray(block.squares > VISIBLE * block.start)

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
            part = self._falls(block) / max(self.projected.total, 1e-300)
            values.append(score(part, block.of.parameters).ravel())
            starts.append(starts[-1] + len(values[-1]))
        every = np.concatenate(values) if values else np.zeros(0)
        for some in _descending(every):
            number = np.searchsorted(starts, some, side="right") - 1
            for value, index, n in zip(every[some].tolist(), some.tolist(), number.tolist(), strict=True):
                block = self._blocks[n]
                term, sensitivity = divmod(index - starts[n], len(block.sensitivities))
                yield value, block.of.terms[term], int(block.sensitivities[sensitivity])

    def _falls(self, block: _Block) -> Array:
        """Return the falls, (terms, sensitivities)."""
        n, c, m = block.vectors.shape
        left = self.projected.left.reshape(n, m).astype(np.float32)
        seen = self._seen(block)
        size = np.sqrt(np.where(seen, block.squares, 1.0))
        pull = np.where(seen, block.of.values @ np.einsum("ncm,nm->nc", block.vectors, left), 0.0) / size
        i, j = block.of.pairs
        shared = np.where(seen[i] & seen[j], block.crossed, 0.0) / (size[i] * size[j])
        falls = np.zeros((len(block.of.terms), c))
        for terms, functions, pairs in block.of.sizes:
            falls[terms] = _falls_of_pulls(pull[functions], shared[pairs])
        return np.clip(falls, 0.0, self.projected.total)


def _descending(values: Array) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of values, the largest first, equal ones in order: some, then the rest, seldom asked for."""
    if len(values) > FIRST:
        limit = np.partition(values, len(values) - FIRST)[len(values) - FIRST]
        large = values >= limit
        first = np.flatnonzero(large)
        yield first[np.argsort(-values[first], kind="stable")]
        rest = np.flatnonzero(~large)
    else:
        rest = np.arange(len(values))
    yield rest[np.argsort(-values[rest], kind="stable")]


def _falls_of_pulls(pull: NDArray[Any], shared: NDArray[Any]) -> Array:
    """Return the falls of terms of as many functions each, (t, c): of one function after the other, given those before.

    Parameters
    ----------
    pull : ndarray, shape (t, k, c)
        Products of the functions, of length 1, with the residuals.
    shared : ndarray, shape (t, k (k - 1) / 2, c)
        Products of the pairs of functions.
    """
    k = pull.shape[1]
    g = [pull[:, i].astype(float) for i in range(k)]
    gram = {(i, i): np.full_like(g[i], 1.0 + RIDGE) for i in range(k)}
    for number, pair in enumerate(itertools.combinations(range(k), 2)):
        gram[pair] = shared[:, number].astype(float)
    falls = np.zeros_like(g[0])
    for i in range(k):
        pivot = np.maximum(gram[i, i], LEAST)
        falls += g[i] ** 2 / pivot
        for a in range(i + 1, k):
            factor = gram[i, a] / pivot
            g[a] -= factor * g[i]
            for b in range(a, k):
                gram[a, b] -= factor * gram[i, b]
    return falls
