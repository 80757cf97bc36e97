"""What the data determine: the covariance of the parameters, and the directions in which nothing holds them.

The Jacobian is reduced to a triangle by orthogonal transformations, block by block, so that its condition number is
not squared as in the normal equations. Its singular values, with the columns scaled to equal length, show which
combinations of parameters change the readings at all. Where the normal equations, which the fit has made, show that
all are well determined, they are good to ten digits and will do.

A combination that is not determined is a choice of coordinates (gauge) where no reading changes whatever is measured,
wherever the joints stand: a free frame moves with all that is in it. Otherwise the data are to blame, and the readings
that would change show what to measure. Which of the two it is shows when the combination is evaluated on readings that
were not taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.determinacy.hypothetical_readings import HypotheticalReadings
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.file_values import ASIDE, Pull
from rodgen.calibration.solve.least_squares import NearFile
from rodgen.calibration.words import NAMES
from rodgen.errors import joined
from rodgen.machines.model import Frame
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh, lstsq, svd
from rodgen.statistics.thresholds import DETERMINACY

WEAK = 1e-3
"""A combination below this part is hardly determined: its parameters have a standard deviation a thousand times as
large as if the others were known."""
SAYS_LESS = 0.5
"""Part of the variance of a prior that readings must leave along its direction for the prior to count: they leave
more than all of it where the prior is needed, and none where a choice of coordinates left none."""
PART = 0.3
"""A parameter is named with a direction along which the file holds a fit that has this part of it, measured in the
largest deviations of a machine from its file."""

LARGEST = 1e150
"""Standard deviations are no larger, for unit variance, so that their squares are finite."""
NEARLY_WEAK = 2.0
"""Combinations that are less than so many times as strong as weak ones are looked at more closely."""
SUSPECT = 1e-6
"""Parameters that change the readings by less than this part of what another one does, units left aside, are looked at
more closely."""
SHARE = 0.02
"""Parts of a combination below this, measured by how they change the readings, are not named."""
INVARIANT = 1e-3
"""A combination is invariant that changes no reading of the data, and others by less than this part of what its parts
change: at best it would be hardly determined. An error motion of 1e-5 rad bends the exact symmetries by as much."""
SHOWN = 0.01
"""Readings would determine a combination that they show by this part of what its parts change ..."""
SHOWN_BETTER = 30.0
"""... or, of one that the data show a little, by so many times more."""
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
        hint = self._hint(d, SHOWN_BETTER * self._shown(d, self.readings.taken))
        return f"{self._names(d)} {what}{hint}."

    def _still(self, d: Array) -> tuple[str, ...]:
        """Return the joints that never moved of which other positions would show a combination."""
        moved = [kind for kind in self.readings.kinds if kind.still]
        return tuple(kind.still or "" for kind in moved if self._shown(d, kind.jacobian) > SHOWN)

    def _hint(self, d: Array, needed: float = SHOWN) -> str:
        """Return what to measure, or nothing where no single thing would do."""
        parts = [(self._shown(d, kind.jacobian), kind) for kind in self.readings.kinds]
        hints_by_rank = sorted((k.fresh, not k.wanting, -part, k.hint) for part, k in parts if part > needed)
        hints = [x[3] for x in hints_by_rank if x[:2] == hints_by_rank[0][:2]]
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


@dataclass(frozen=True)
class Determinacy:
    """What the data determine of the parameters.

    Attributes
    ----------
    covariance : ndarray, shape (parameters, parameters)
        For unit variance of the weighted residuals, internal units; zero for what is not estimated. Along directions
        that are not determined it is that of the solution nearest to the machine file, which does not vary along them.
    undetermined : ndarray of bool, shape (parameters,)
        Parameters whose value rests on such a direction.
    rank : int
        Number of combinations that are determined.
    null : ndarray, shape (k, parameters)
        Changes of the parameters that change no reading of these data, internal units.
    held : tuple of str
        Keys of parameters along which the readings determine so little that the machine file holds them.
    """

    covariance: Array
    undetermined: NDArray[np.bool_]
    rank: int
    null: Array
    held: tuple[str, ...] = ()
    _spectrum: Spectrum | None = field(default=None, repr=False)

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Combinations that the data do not determine: choices of coordinates first, then what data are lacking for."""
        return self._described[0]

    @property
    def weak(self) -> tuple[Direction, ...]:
        """Combinations that the data hardly determine."""
        return self._described[1]

    @cached_property
    def lacking(self) -> NDArray[np.bool_]:
        """Parameters whose value rests on a direction that other data would determine, (parameters,).

        Those that are `undetermined` and not among them rest on a choice of coordinates only.
        """
        lacks = np.zeros(len(self.undetermined), bool)
        if self._spectrum is not None and self.undetermined.any():
            with one_thread_in_blas():
                rows = self._spectrum.split[1]
            size = np.linalg.norm(rows, axis=1, keepdims=True)
            lacks[self._spectrum.index] = np.any(np.abs(rows) > DETERMINACY.rests * size, axis=0)
        return lacks

    @cached_property
    def _described(self) -> tuple[tuple[Direction, ...], tuple[Direction, ...]]:
        if self._spectrum is None:
            return (), ()
        with one_thread_in_blas():
            return self._spectrum.described


def determinacy(
    problem: Problem, theta: Array, frame: Frame, free: Sequence[int], further: Array | None = None
) -> Determinacy:
    """Return what the readings determine where a fit ended.

    Parameters
    ----------
    problem : Problem
    theta, frame : ndarray, Frame
        The end of the fit.
    free : sequence of int
        The parameters that were adjusted.
    further : ndarray, shape (k, free), optional
        Derivatives of weighted readings that are still to be taken, by these parameters.
    """
    p = len(problem.model.parameters)
    covariance, undetermined = np.zeros((p, p)), np.zeros(p, bool)
    bounds = problem.at_bounds(theta)
    moves = [k for k, i in enumerate(free) if i not in bounds]
    index = np.asarray(free, int)[moves]
    further = None if further is None else further[:, moves]
    if not len(index):
        return Determinacy(covariance, undetermined, 0, np.zeros((0, p)))
    cost, square, _ = problem.normal_equations(theta, frame)
    if further is not None:
        square = square.copy()
        square[np.ix_(index, index)] += further.T @ further
    near, left = NearFile(problem, index), problem.freedom(len(index))
    variance = max(cost, 0.0) / left  # a sum of squares is below 0 by rounding only
    stated = near.stated(variance)
    pull = near.pull(square, variance) if np.isfinite(cost) else None
    block = square[index[:, None], index] + stated.T @ stated
    known = _of_normal_equations(block) if pull is None and np.isfinite(cost) else None
    if known is None:
        rows = stated if further is None else np.concatenate([stated, further])
        triangle = problem.triangle(theta, frame, index, rows)
        triangle[:, _without_effect(problem, theta, frame, index, triangle)] = 0.0
        scale = np.linalg.norm(triangle, axis=0)
        scale[scale == 0.0] = 1.0
        _, values, vt = svd(triangle / scale, full_matrices=True)
        values = np.concatenate([values, np.zeros(len(index) - len(values))])
    else:
        scale, values, vt = known
    held = values > DETERMINACY.nothing * max(values[0], 1e-300)
    held &= values > 0
    root = vt[held].T / values[held] / scale[:, None]
    keys: tuple[str, ...] = ()
    null = vt[~held]
    if len(null):
        root = _nearest(root, null, scale, near, square)
    if pull is not None:
        root, rows = _with_prior(root, pull, variance if problem.observations.sigma is None else 1.0)
        parts = np.max(np.abs(rows * near.largest(square)), axis=0, initial=0.0)
        keys = tuple(problem.model.parameters[i].key for i in index[parts > PART])
    root = np.clip(root, -LARGEST, LARGEST)  # finite of numbers that no machine gives, too
    covariance[np.ix_(index, index)] = root @ root.T
    undetermined[index] = np.any(np.abs(null) > DETERMINACY.rests, axis=0) if len(null) else False
    weak = held & (values < WEAK * values[0])
    spectrum = Spectrum(problem, theta, frame, index, scale, null, vt[weak])
    changes = np.zeros((len(null), p))
    changes[:, index] = null / scale
    return Determinacy(covariance, undetermined, int(held.sum()), changes, keys, spectrum)


def _nearest(root: Array, null: Array, scale: Array, near: NearFile, square: Array) -> Array:
    """Return a root C of the covariance CCᵀ of the values nearest to the file, from that of any that fit equally.

    Parameters
    ----------
    root : ndarray, shape (k, r)
    null : ndarray, shape (d, k)
        Orthonormal directions that change no reading, of the parameters times `scale`.
    scale : ndarray, shape (k,)
    square : ndarray, shape (k, k)
        Normal equations.
    """
    anchored = near.file.anchored[near.index]
    # where only the frame moves, of which the file says nothing, the rest of a direction is rounding
    left, part, _ = svd(null * anchored, full_matrices=False)
    null = left[:, part > ASIDE].T @ null / scale
    metric = anchored / near.largest(square)
    null /= np.linalg.norm(null * metric, axis=1)[:, None]
    # of a change, the part along each direction
    along = lstsq((null * metric).T, np.diag(metric), relative=DETERMINACY.nothing)
    return np.asarray(root - null.T @ (along @ root))


def _with_prior(root: Array, pull: Pull, factor: float) -> tuple[Array, Array]:
    """Return a root of a covariance with the file as a prior, and the rows that say more than the readings.

    Roots, because rounding makes variances negative where a large covariance is reduced to a small one: with S what the
    prior sees of C, the covariance is C (1 + SᵀS)⁻¹ Cᵀ.

    Parameters
    ----------
    root : ndarray, shape (k, r)
        C of the covariance CCᵀ for unit variance; zero along directions of which the readings show nothing.
    factor : float
        What the covariance is multiplied by in the end.
    """
    rows = pull.unit[factor * np.sum((pull.unit @ root) ** 2, axis=1) > SAYS_LESS]
    _, values, vt = svd(rows @ root * np.sqrt(factor), full_matrices=True)
    values = np.concatenate([values, np.zeros(len(vt) - len(values))])
    return root @ vt.T / np.hypot(1.0, values), rows


def _of_normal_equations(square: Array) -> tuple[Array, Array, Array] | None:
    """Return the columns' lengths, singular values and directions where no combination is nearly weak, else None."""
    scaled, size = unit_diagonal(square)
    values, vectors = eigh(scaled)
    if values[0] <= (NEARLY_WEAK * WEAK) ** 2 * values[-1] or size.min() < SUSPECT * size.max():
        return None
    return size, np.sqrt(values[::-1]), vectors.T[::-1]


def _without_effect(
    problem: Problem, theta: Array, frame: Frame, index: NDArray[np.int_], triangle: Array
) -> NDArray[np.bool_]:
    """Return the parameters of which the readings show nothing but rounding, compared with other readings."""
    size = np.linalg.norm(triangle, axis=0)
    if not np.any(size < SUSPECT * size.max(initial=0.0)):
        return np.zeros(len(size), bool)
    usual = HypotheticalReadings(problem, theta, frame, index).size * problem.total_weight
    is_idle: NDArray[np.bool_] = size < DETERMINACY.nothing * usual
    return is_idle


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
