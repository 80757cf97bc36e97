"""The combinations of parameters that the data do not determine, each described in a sentence.

Such a combination is a choice of coordinates (gauge) where no reading changes whatever is measured, wherever the joints
stand: a free frame moves with all that is in it. Otherwise the data are to blame, and the readings that would change
show what to measure. Which of the two it is shows when the combination is evaluated on readings that were not taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.determinacy.hypothetical_readings import HypotheticalReadings
from rodgen.calibration.problem import Problem
from rodgen.calibration.words import NAMES
from rodgen.errors import joined
from rodgen.machines.model import Frame
from rodgen.statistics.decompositions import svd
from rodgen.statistics.thresholds import DETERMINACY

SHARE = 0.02
"""Parts of a combination below this, measured by how they change the readings, are not named."""
INVARIANT = 1e-3
"""A combination is invariant that changes no reading of the data, and others by less than this part of what its parts
change: at best it would be hardly determined. An error motion of 1e-5 rad bends the exact symmetries by as much."""
SHOWN = 0.01
"""Readings would determine a combination that they show by this part of what its parts change."""
NAMED = 4
"""Parameters that a sentence names; the rest is counted."""


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that changes no reading, or hardly any.

    Attributes
    ----------
    parts : tuple of (str, float)
        Keys of the parameters and their parts, the largest first, in internal units, the largest set to 1.
    gauge : bool
        Whether no reading changes whatever is measured: a choice of coordinates, not a lack of data.
    text : str
        One sentence: what it is, and what to measure where that is plain.
    still : tuple of str
        Joints that never moved, of which other positions would show it.
    """

    parts: tuple[tuple[str, float], ...]
    gauge: bool
    text: str
    still: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The directions in which a fit's readings change not at all, or hardly.

    Attributes
    ----------
    problem : Problem
    theta, frame : ndarray, Frame
        The end of the fit.
    index : ndarray of int, shape (p,)
        Numbers of the parameters that are adjusted.
    scale : ndarray, shape (p,)
        By how much each parameter changes all readings together.
    null, weak : ndarray, shape (k, p)
        Bases of both kinds of directions, in parameters times `scale`.
    """

    problem: Problem
    theta: Array
    frame: Frame
    index: NDArray[np.int_]
    scale: Array
    null: Array
    weak: Array

    @cached_property
    def readings(self) -> HypotheticalReadings:
        """Readings that were not taken."""
        return HypotheticalReadings(self.problem, self.theta, self.frame, self.index)

    @cached_property
    def split(self) -> tuple[Array, Array]:
        """The directions that no reading shows, and the others without these, each with few parts."""
        if not len(self.null):
            return self.null, self.null
        jacobian = self.readings.everywhere
        size = self.readings.size * np.sqrt(len(jacobian))
        size[size == 0.0] = 1.0
        basis, _ = np.linalg.qr((self.null / self.scale * size).T)
        changes = jacobian / size @ basis
        _, values, vt = svd(changes, full_matrices=len(changes) < basis.shape[1])  # all of Vᵀ, little of U
        values = np.concatenate([values, np.zeros(len(vt) - len(values))])
        # each motion of the frame in one direction
        of_frame = [self.problem.model.parameters[i].slot[0] == "frame" for i in self.index]
        gauge, pivots = sparse(
            (vt[values < INVARIANT] @ basis.T) / size * self.scale, np.array(of_frame, bool)
        )
        _, _, vt = svd(self.null - self.null[:, pivots] @ gauge)
        return gauge, sparse(vt[: len(self.null) - len(gauge)])[0]

    @property
    def lacking(self) -> NDArray[np.bool_]:
        """Parameters that have a part in a direction that other readings would show, (p,)."""
        found = self.split[1]
        size = np.linalg.norm(found, axis=1, keepdims=True)
        return np.asarray(np.any(np.abs(found) > DETERMINACY.rests * size, axis=0))

    @cached_property
    def described(self) -> tuple[tuple[Direction, ...], tuple[Direction, ...]]:
        """The directions that are not determined, choices of coordinates first, and those that hardly are."""
        gauge, lacking = self.split
        undetermined = [Direction(self._parts(d), True, self._on_choice(d)) for d in gauge]
        undetermined += [Direction(self._parts(d), False, self._on_lack(d), self._still(d)) for d in lacking]
        named = {key for d in undetermined for key, _ in d.parts}
        # what changes the readings far less than it would others
        usual = self.readings.size * float(np.linalg.norm(self.problem.weight))
        hardly = []
        for d in (*sparse(self.weak)[0], *np.eye(len(self.index))[self.scale < INVARIANT * usual]):
            parts = self._parts(d)
            if len(parts) > 1 or parts[0][0] not in named:
                hardly.append(Direction(parts, False, self._on_weakness(d)))
                named |= {key for key, _ in parts}
        return tuple(undetermined), tuple(hardly)

    # words -----------------------------------------------------------------------------------------------------------

    def _on_choice(self, d: Array) -> str:
        order = self._order(d)
        verb = "change together" if len(order) > 1 else "changes"
        if {self.problem.model.parameters[self.index[i]].slot[0] for i in order} & {"frame", "shift"}:
            rest = "without changing any reading, which is a choice of coordinates, not a fault"
        elif len(order) > 1:
            rest = "without changing any reading, whatever is measured: hold one of them"
        else:
            rest = "no reading, whatever is measured: leave it out"
        return f"{self._names(d)} {verb} {rest}."

    def _on_lack(self, d: Array) -> str:
        hint = self._hint(d)
        if len(self._order(d)) == 1:
            return f"{self._names(d)} changes no reading in these data{hint}."
        rest = hint or ": only their combination is determined"
        return f"{self._names(d)} change together without changing any reading in these data{rest}."

    def _on_weakness(self, d: Array) -> str:
        one = len(self._order(d)) == 1
        what = "hardly changes a reading" if one else "are hardly distinguished by these data"
        return f"{self._names(d)} {what}{self._hint(d)}."

    def _still(self, d: Array) -> tuple[str, ...]:
        """Return the joints that never moved of which other positions would show a combination."""
        moved = [kind for kind in self.readings.kinds if kind.still]
        return tuple(kind.still or "" for kind in moved if self._shown(d, kind.jacobian) > SHOWN)

    def _hint(self, d: Array) -> str:
        """Return what to measure, or nothing where no single thing would do."""
        shown = [(self._shown(d, kind.jacobian), kind) for kind in self.readings.kinds]
        found = sorted((k.fresh, not k.wanting, -part, k.hint) for part, k in shown if part > SHOWN)
        hints = [x[3] for x in found if x[:2] == found[0][:2]]
        return f": {' or '.join(hints[:2])}" if hints else ""

    def _shown(self, d: Array, jacobian: Array) -> float:
        """Return how readings change along a direction, relative to what its parts change anywhere."""
        raw = d / self.scale
        parts = np.linalg.norm(self.readings.size * raw)
        change = np.linalg.norm(jacobian @ raw) / np.sqrt(len(jacobian))
        return float(change / parts) if parts > 0 else 0.0

    def _order(self, d: Array) -> list[int]:
        """Return the numbers of the parts that count, the largest first."""
        shares = np.abs(d) / np.abs(d).max()
        return [int(i) for i in np.argsort(-shares, kind="stable") if shares[i] >= SHARE]

    def _parts(self, d: Array) -> tuple[tuple[str, float], ...]:
        """Return keys and parts, the largest set to 1."""
        values, order = d / self.scale, self._order(d)
        keys = [self.problem.model.parameters[self.index[i]].key for i in order]
        return tuple((key, float(values[i] / values[order[0]])) for key, i in zip(keys, order, strict=True))

    def _names(self, d: Array) -> str:
        """Name the parameters, those of the frame before the others, and what is tied to them."""
        model = self.problem.model
        parameters = [model.parameters[self.index[i]] for i in self._order(d)]
        names = []
        for p in sorted(parameters, key=lambda p: p.slot[0] != "frame"):
            tied = [x.parameter.key for x in model.tied if model.keys[p.key] in dict(x.factors)]
            names.append(f"{p.key} (with {joined(tied, most=NAMES)}, tied to it)" if tied else p.key)
        return joined(names, most=NAMED)


def sparse(basis: Array, first: NDArray[np.bool_] | None = None) -> tuple[Array, list[int]]:
    """Return directions that span the same and have few parts each: row echelon form with the largest pivots.

    And the columns of the pivots, in the order of the rows, which is theirs.

    Parameters
    ----------
    first : ndarray of bool, shape (p,), optional
        Columns of which pivots are taken before others.
    """
    rows = basis.copy()
    pivots: list[int] = []
    preferred = 1.0 if first is None else np.where(first, 1 / INVARIANT, 1.0)
    for row in range(len(rows)):
        rest = np.abs(rows[row:]) * preferred
        rest[:, pivots] = 0.0
        r, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        rows[[row, row + int(r)]] = rows[[row + int(r), row]]
        rows[row] /= rows[row, column]
        others = np.arange(len(rows)) != row
        rows[others] -= np.outer(rows[others, column], rows[row])
        pivots.append(int(column))
    order = np.argsort(pivots, kind="stable")  # which is found first depends on rounding
    return rows[order], [pivots[i] for i in order]
