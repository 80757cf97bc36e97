"""Every term at every place, scored at once.

A column is a carrier, a vector for every row, times a function of drivers, a number for every row. So its products with
the residuals and with the basis of what the model can make up for are those of the function with sums over the vector's
components: for all functions and all carriers one product of matrices, in single precision, for ranking only.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy.diagnose._unexplained._dictionary import Term
from rodgen.discrepancy.diagnose._unexplained._level import Level

__all__ = ["Screen"]

Array: TypeAlias = NDArray[np.float64]
Single: TypeAlias = NDArray[np.float32]

VISIBLE = 1e-4
"""Part of a column that must be left, in single precision."""
RIDGE = 1e-5


@dataclass
class _Block:
    """Terms that may stand at the same carriers."""

    terms: list[Term]
    carriers: list[int]
    columns: list[list[int]]  # of each term, numbers of its functions
    functions: Single  # (n, b), of size 1
    pairs: NDArray[np.int_]  # (2, x), of functions whose products are needed
    squares: Single  # (b, c) and (x, c): what V^-1 and the model leave
    crossed: Single
    start: Single  # (b, c), before the model
    pull: Single  # (b, c)


class Screen:
    """Scores of all terms.

    Parameters
    ----------
    level : Level
    terms : sequence of Term
    at : dict of str to list of int
        Numbers of the carriers of each joint, by its name.

    Attributes
    ----------
    tried : int
        Number of columns that were looked at.
    """

    def __init__(self, level: Level, terms: Sequence[Term], at: dict[str, list[int]]) -> None:
        self.level = level
        n, m = level.carriers.shape[1:]
        self._shape = (n, m)
        by: dict[str | None, list[Term]] = {}
        for term in terms:
            by.setdefault(term.at, []).append(term)
        every = list(range(len(level.carriers)))
        standing = [(some, every if joint is None else at.get(joint, [])) for joint, some in by.items()]
        self._blocks = [self._block(some, carriers) for some, carriers in standing if carriers]
        self._take_out(level.basis)
        self.tried = int(sum(np.sum(self._visible(block)) for block in self._blocks))

    def _block(self, terms: list[Term], carriers: list[int]) -> _Block:
        n, _ = self._shape
        columns: list[list[int]] = []
        functions: list[Array] = []
        for term in terms:
            made = term.columns(self.level.drivers)
            if any(factor.kind == "series" for factor in term.factors):
                made = np.linalg.qr(made / np.linalg.norm(made, axis=0))[0]  # powers are nearly one
            size = np.linalg.norm(made, axis=0)
            made = made / np.where(size > 0, size, 1.0)
            columns.append(list(range(len(functions), len(functions) + made.shape[1])))
            functions.extend(made.T)
        B = np.array(functions, np.float32).reshape(-1, n)
        pairs = np.array(
            [pair for own in columns for pair in itertools.combinations(own, 2)], np.int64
        ).reshape(-1, 2)
        C = self.level.carriers[carriers]
        size = np.sqrt(np.einsum("cnm,cnm->c", C, C))
        C = C / np.where(size > 0, size, 1.0)[:, None, None]
        weight = np.einsum("cnm,cnm->nc", C, C).astype(np.float32)
        start = (B**2) @ weight
        crossed = (B[pairs[:, 0]] * B[pairs[:, 1]]) @ weight
        return _Block(
            terms, carriers, columns, B, pairs.T, start.copy(), crossed, start, np.zeros_like(start)
        )

    def _carried(self, block: _Block, vectors: Array) -> Single:
        """Return products of all columns with vectors (N, p), as (b, c, p)."""
        C = self.level.carriers[block.carriers]
        size = np.sqrt(np.einsum("cnm,cnm->c", C, C))
        C = (C / np.where(size > 0, size, 1.0)[:, None, None]).astype(np.float32)
        n, m = self._shape
        p = vectors.shape[1]
        sums = np.matmul(C.transpose(1, 0, 2), vectors.reshape(n, m, p).astype(np.float32))  # (n, c, p)
        made = block.functions @ sums.reshape(n, -1)
        return np.asarray(made.reshape(len(block.functions), len(C), p))

    def _take_out(self, new: Array) -> None:
        for block in self._blocks:
            along = self._carried(block, np.concatenate([new, self.level.left[:, None]], axis=1))
            block.pull = along[:, :, -1]
            along = along[:, :, :-1]
            block.squares = block.squares - np.einsum("bcp,bcp->bc", along, along)
            i, j = block.pairs
            if len(i):
                block.crossed = block.crossed - np.einsum("xcp,xcp->xc", along[i], along[j])

    def take_out(self, new: Array) -> None:
        """Follow the level, to whose basis these columns were added."""
        self._take_out(new)

    def state(self) -> list[tuple[Single, Single, Single]]:
        """Return what `take_out` changes, for `restore`."""
        return [(block.squares, block.crossed, block.pull) for block in self._blocks]

    def restore(self, state: list[tuple[Single, Single, Single]]) -> None:
        """Go back to an earlier state."""
        for block, (squares, crossed, pull) in zip(self._blocks, state, strict=True):
            block.squares, block.crossed, block.pull = squares, crossed, pull

    def _visible(self, block: _Block) -> NDArray[np.bool_]:
        seen = block.squares > VISIBLE * block.start
        return np.array([seen[own].any(axis=0) for own in block.columns]).reshape(-1, len(block.carriers))

    def best(self, score: Any) -> Iterator[tuple[float, Term, int]]:
        """Yield score, term and carrier, the best first.

        Parameters
        ----------
        score : callable
            From the part of the sum of squares that is taken away, an array, and the term's number of parameters.
        """
        scores, where = [], []
        for number, block in enumerate(self._blocks):
            falls = self._falls(block)
            for i, term in enumerate(block.terms):
                scores.append(score(falls[i] / max(self.level.total, 1e-300), term.parameters))
                where += [(number, i, c) for c in range(len(block.carriers))]
        values = np.concatenate(scores) if scores else np.zeros(0)
        for index in np.argsort(-values, kind="stable"):
            number, i, c = where[index]
            block = self._blocks[number]
            yield float(values[index]), block.terms[i], block.carriers[c]

    def _falls(self, block: _Block) -> Array:
        """Return the falls, (terms, carriers)."""
        seen = block.squares > VISIBLE * block.start
        size = np.sqrt(np.where(seen, block.squares, 1.0)).astype(float)
        pull = np.where(seen, block.pull, 0.0) / size
        i, j = block.pairs
        shared = np.where(seen[i] & seen[j], block.crossed, 0.0) / (size[i] * size[j])
        falls = np.zeros((len(block.terms), len(block.carriers)))
        first = np.cumsum([0, *[len(own) * (len(own) - 1) // 2 for own in block.columns]])
        for count in {len(own) for own in block.columns}:
            terms = [t for t, own in enumerate(block.columns) if len(own) == count]
            g = pull[np.array([block.columns[t] for t in terms])]  # (t, count, c)
            gram = np.zeros((len(terms), len(block.carriers), count, count))
            gram[:, :, range(count), range(count)] = 1.0 + RIDGE
            for number, (a, b) in enumerate(itertools.combinations(range(count), 2)):
                gram[:, :, a, b] = gram[:, :, b, a] = shared[first[terms] + number]
            g = g.swapaxes(1, 2)
            falls[terms] = np.sum(_solved(gram, g) * g, axis=-1)
        return np.clip(falls, 0.0, self.level.total)


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
