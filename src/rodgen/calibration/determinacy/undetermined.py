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
from rodgen.calibration.determinacy.hypothetical_readings import Variation, elsewhere, variations
from rodgen.calibration.problem import Problem
from rodgen.calibration.words import NAMES
from rodgen.errors import joined
from rodgen.machines.model import Frame
from rodgen.machines.parameters import Parameter
from rodgen.statistics.decompositions import lstsq, svd
from rodgen.statistics.thresholds import DETERMINACY

SHARE = 0.02
"""Parts of a combination below this, measured by how they change the readings, are not named."""
INVARIANT = 1e-3
"""A combination is invariant that changes no reading of the data, and others by less than this part of what its parts
change: at best it would be hardly determined. An error motion of 1e-5 rad bends the exact symmetries by as much."""
SHOWN = 0.01
"""Readings would determine a combination that they show by this part of what its parts change ..."""
SHOWN_BETTER = 30.0
"""... or, of one that the data show a little, by so many times more."""
ALIGNED = 1e-3
"""Axes are the same when they differ by less than this angle, in rad; estimated ones differ by a squareness."""
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
    """The directions in which a fit's readings change not at all, or hardly."""

    problem: Problem
    theta: Array
    frame: Frame
    """The end of the fit."""
    index: NDArray[np.int_]
    """Numbers of the parameters that are adjusted, (p,)."""
    scale: Array
    """By how much each parameter changes all readings together, (p,)."""
    null: Array
    weak: Array
    """Bases of both kinds of directions, in parameters times `scale`, (k, p)."""

    @cached_property
    def describer(self) -> _Describer:
        """What describes them."""
        return _Describer(self)


@dataclass(frozen=True)
class Elsewhere:
    """The derivative of hypothetical readings of every kind."""

    jacobian: Array
    """Of the machine's targets, (readings, p)."""
    of_others: Array
    """Of targets at other places on the body, (readings, p)."""
    fresh: NDArray[np.bool_]
    """Parameters that differ for these, (p,)."""
    size: Array
    """By how much each parameter usually changes a reading: root mean square, of either, (p,)."""

    @classmethod
    def of(cls, problem: Problem, theta: Array, frame: Frame, index: NDArray[np.int_]) -> Elsewhere:
        """Return the derivative at random readings."""
        there, others = elsewhere(problem, theta, frame)
        both = [jacobian_of(p, theta, frame, index) for p in (there, others.problem)]
        size = np.max(
            [np.sqrt(np.mean(j**2, axis=0)) if len(j) else np.zeros(len(index)) for j in both], axis=0
        )
        return cls(both[0], both[1], np.isin(index, others.fresh), size)


def jacobian_of(problem: Problem, theta: Array, frame: Frame, index: NDArray[np.int_]) -> Array:
    """Return the derivative of hypothetical readings, (readings, p), without those that are not finite."""
    found = problem.jacobian(theta, frame)[:, :, index].reshape(-1, len(index))
    return np.asarray(found[np.isfinite(found).all(axis=1)])


@dataclass(frozen=True)
class _Shown:
    """A variation and what it would show."""

    variation: Variation
    jacobian: Array
    fresh: NDArray[np.bool_]


class _Describer:
    """Directions of one fit; each is a vector of the adjusted parameters times how they change the readings."""

    def __init__(self, spectrum: Spectrum) -> None:
        self.problem, self.theta, self.frame = spectrum.problem, spectrum.theta, spectrum.frame
        self.index, self.scale, self.null = spectrum.index, spectrum.scale, spectrum.null
        self.parameters: list[Parameter] = [self.problem.model.parameters[i] for i in self.index]

    # choices of coordinates ----------------------------------------------------------------------------------

    @cached_property
    def split(self) -> tuple[Array, Array]:
        """The directions that no reading shows, and the others without these, each with few parts."""
        null = self.null
        if not len(null):
            return null, null
        there = self._elsewhere
        invariant = self._invariant(null, there.jacobian, None)
        if len(invariant):
            invariant = self._invariant(invariant, there.of_others, there.fresh)
        gauge, probe = self._as_motions(invariant)
        lacking = null - null @ probe @ gauge
        _, _, vt = svd(lacking)
        return gauge, sparse(vt[: len(null) - len(gauge)])

    @cached_property
    def _elsewhere(self) -> Elsewhere:
        return Elsewhere.of(self.problem, self.theta, self.frame, self.index)

    def _invariant(self, directions: Array, jacobian: Array, fresh: NDArray[np.bool_] | None) -> Array:
        """Return a basis of the directions, among those spanned, that hypothetical readings do not show."""
        size = self._elsewhere.size * np.sqrt(len(jacobian))
        size[size == 0.0] = 1.0
        basis, _ = np.linalg.qr((directions / self.scale * size).T)
        changes = _changes(jacobian / size, fresh, basis)
        _, values, vt = svd(changes, full_matrices=len(changes) < basis.shape[1])  # all of Vᵀ, little of U
        values = np.concatenate([values, np.zeros(len(vt) - len(values))])
        return np.asarray((vt[values < INVARIANT] @ basis.T) / size * self.scale)

    def _as_motions(self, gauge: Array) -> tuple[Array, Array]:
        """Return choices of coordinates as motions of the frame, one along or about each axis of the machine.

        And columns that distinguish them: each has the product 1 with one direction and 0 with the rest. What moves no
        frame is distinguished by its largest parts.
        """
        rows = gauge / np.linalg.norm(gauge, axis=1, keepdims=True)
        chosen = np.zeros((len(self.index), 0))
        places: list[int] = []  # motions of the frame before single parameters
        candidates, before = self._motions(), 0
        candidates = candidates[:, candidates.any(axis=0)]
        candidates /= np.linalg.norm(candidates, axis=0)
        for row in range(len(rows)):
            values = np.abs(rows[row:] @ candidates)
            if values.max(initial=0.0) < INVARIANT:
                before = before or candidates.shape[1]
                candidates = np.eye(len(self.index))
                values = np.abs(rows[row:])
            r, k = np.unravel_index(int(np.argmax(values)), values.shape)
            probe = candidates[:, k]
            rows[[row, row + r]] = rows[[row + r, row]]
            rows[row] /= rows[row] @ probe
            others = np.arange(len(rows)) != row
            rows[others] -= np.outer(rows[others] @ probe, rows[row])
            chosen = np.column_stack([chosen, probe])
            places.append(before + int(k))
        # which is found first depends on rounding, as the basis of the directions does
        order = np.argsort(places, kind="stable")
        return rows[order], chosen[:, order]

    def _motions(self) -> Array:
        """Return columns whose products with a direction are its motion along the machine's x, y, z, and about them."""
        columns = np.zeros((len(self.index), 6))
        for i, p in enumerate(self.parameters):
            if p.slot[0] == "frame":
                x = str(p.slot[1])
                if x.startswith("r"):
                    columns[i, 3 + "xyz".index(x[1])] = 1.0
                else:
                    columns[i, :3] = self.frame.rotation["xyz".index(x)]
        return columns / self.scale[:, None]

    def choice(self, d: Array) -> str:
        """Return a sentence on a choice of coordinates."""
        parts = [self.parameters[i] for i in self.order(d)]
        together = "change together" if len(parts) > 1 else "changes"
        names = self.listed(d, first="frame")
        if not any(p.slot[0] in {"frame", "shift"} for p in parts):
            if len(parts) == 1:
                return f"{names} changes no reading, whatever is measured: leave it out."
            return f"{names} change together without changing any reading, whatever is measured: hold one of them."
        said = (
            f"{names} {together} without changing any reading, which is a choice of coordinates, not a fault."
        )
        where = self._where(d, parts) if any(p.slot[0] == "frame" for p in parts) else ""
        return f"{where}: {said}" if where else said

    def _where(self, d: Array, parts: list[Parameter]) -> str:
        """Return what is not determined of the machine, or of its targets where only these move."""
        kinds = {str(p.slot[0]).split(".")[0] for p in parts}
        targets = self.problem.model.machine.targets
        if kinds & {"axis", "point"}:
            what = "the machine"
        elif "target" in kinds:
            what = f"target {targets[0].name}" if len(targets) == 1 else "the body with the targets"
        else:
            return ""
        moved = {p.place for p in parts}
        motion = d @ self._motions()
        along, about = motion[:3], motion[3:]
        size = float(np.linalg.norm(self.problem.observations.reading, axis=1).max())
        if np.linalg.norm(about) * size > ALIGNED * np.linalg.norm(along):
            return f"Nothing determines how far {what} is turned about {self._axis(about, along, moved)}"
        return f"Nothing determines where {what} is along {self._axis(along, None, moved)}"

    def _axis(self, vector: Array, moment: Array | None, moved: set[str | None]) -> str:
        """Name an axis: that of a joint that is not moved, the machine's own, or a vector.

        That of a turn is where its moment, the translation of the origin per turn, puts it.
        """
        n = vector / np.linalg.norm(vector)
        model = self.problem.model
        # Targets alone move along the axis of any joint that carries them; a machine along that of its first.
        joints = model.machine.joints if moved <= self._targets else model.machine.joints[:1]
        for j, joint in enumerate(joints):
            axis, point = model.axis(self.theta, j)[0], model.point(self.theta, j)
            off = np.zeros(3)
            if moment is not None and model.structure.moving:
                off = np.cross(n, moment / np.linalg.norm(vector) + np.cross(n, point))
            same = np.linalg.norm(np.cross(n, axis)) < ALIGNED
            still = joint.revolute and joint.name not in moved
            if still and same and np.linalg.norm(off) < ALIGNED * self._reach:
                return f"the axis of {joint.name}"
        largest = int(np.argmax(np.abs(n)))
        if np.linalg.norm(np.delete(n, largest)) < ALIGNED:
            return "xyz"[largest]
        return f"({n[0]:.3g}, {n[1]:.3g}, {n[2]:.3g})"

    @property
    def _targets(self) -> set[str | None]:
        return {None, *(t.name for t in self.problem.model.machine.targets)}

    @cached_property
    def _reach(self) -> float:
        points = [t.point for t in self.problem.model.machine.targets]
        return max(float(np.linalg.norm(points, axis=1).max()), 1.0)

    # a lack of data ------------------------------------------------------------------------------------------

    def lack(self, d: Array) -> str:
        """Return a sentence on what the data do not determine, and what would."""
        names, hint = self.listed(d), self._hint(d, SHOWN)
        if len(self.order(d)) == 1:
            return f"{names} changes no reading in these data{hint}."
        rest = hint or ": only their combination is determined"
        return f"{names} change together without changing any reading in these data{rest}."

    def still(self, d: Array) -> tuple[str, ...]:
        """Return the joints that never moved of which other positions would show a combination."""
        moved = [s for s in self._hypothetical[1:] if s.variation.still]
        shown = [s.variation.still for s in moved if self._shown(d, s.jacobian, s.fresh) > SHOWN]
        return tuple(filter(None, shown))

    def hardly_changing(self) -> Array:
        """Return the parameters, one a row, that change the readings far less than they would others."""
        usual = self._elsewhere.size * float(np.linalg.norm(self.problem.weight))
        return np.eye(len(self.index))[self.scale < INVARIANT * usual]

    def hardly(self, d: Array) -> str:
        """Return a sentence on what changes the readings, but little."""
        needed = SHOWN_BETTER * self._shown(d, self._hypothetical[0].jacobian)
        rest = self._hint(d, needed)
        if len(self.order(d)) == 1:
            return f"{self.listed(d)} hardly changes a reading{rest}."
        return f"{self.listed(d)} are hardly distinguished by these data{rest}."

    def _hint(self, d: Array, needed: float) -> str:
        """Return what to measure, or nothing where no single thing would do."""
        found = [(self._shown(d, s.jacobian, s.fresh), s.variation) for s in self._hypothetical[1:]]
        found = [(size, v) for size, v in found if size > needed]
        found = [f for f in found if f[1].wanting] or found
        found = [f for f in found if not f[1].fresh] or found
        found.sort(key=lambda f: -f[0])
        return ": " + " or ".join(v.hint for _, v in found[:2]) if found else ""

    @cached_property
    def _hypothetical(self) -> list[_Shown]:
        found = []
        for variation in variations(self.problem, self.theta, self.frame):
            fresh = np.isin(self.index, variation.fresh)
            found.append(
                _Shown(variation, jacobian_of(variation.problem, self.theta, self.frame, self.index), fresh)
            )
        return found

    def _shown(self, d: Array, jacobian: Array, fresh: NDArray[np.bool_] | None = None) -> float:
        """Return how hypothetical readings change along a direction, relative to what its parts change anywhere."""
        raw = d / self.scale
        parts = np.linalg.norm(self._elsewhere.size * raw)
        change = np.linalg.norm(_changes(jacobian, fresh, raw[:, None])) / np.sqrt(len(jacobian))
        return float(change / parts) if parts > 0 else 0.0

    # names ---------------------------------------------------------------------------------------------------

    def order(self, d: Array) -> list[int]:
        """Return the numbers of the parts that count, the largest first."""
        shares = np.abs(d) / np.abs(d).max()
        return [int(i) for i in np.argsort(-shares, kind="stable") if shares[i] >= SHARE]

    def parts(self, d: Array) -> tuple[tuple[str, float], ...]:
        """Return keys and parts, the largest set to 1."""
        values, order = d / self.scale, self.order(d)
        return tuple((self.parameters[i].key, float(values[i] / values[order[0]])) for i in order)

    def listed(self, d: Array, first: str = "") -> str:
        """Name the parameters, those of a kind before the others, and what is tied to them."""
        parameters = [self.parameters[i] for i in self.order(d)]
        model = self.problem.model
        names = []
        for p in sorted(parameters, key=lambda p: p.slot[0] != first):
            number = model.keys[p.key]
            tied = [x.parameter.key for x in model.tied if number in dict(x.factors)]
            names.append(f"{p.key} (with {joined(tied, most=NAMES)}, tied to it)" if tied else p.key)
        return joined(names, most=NAMED)


def _changes(jacobian: Array, fresh: NDArray[np.bool_] | None, directions: Array) -> Array:
    """Return how readings change along directions (columns), where what is unknown there, too, makes up for it."""
    if fresh is None or not fresh.any():
        return jacobian @ directions
    change = jacobian[:, ~fresh] @ directions[~fresh]
    own = jacobian[:, fresh]
    return np.asarray(change - own @ lstsq(own, change, relative=None))


def lacking(spectrum: Spectrum) -> NDArray[np.bool_]:
    """Return the parameters that have a part in a direction that other readings would show, (p,)."""
    _, found = spectrum.describer.split
    size = np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(np.any(np.abs(found) > DETERMINACY.rests * size, axis=0))


def describe(spectrum: Spectrum) -> tuple[tuple[Direction, ...], tuple[Direction, ...]]:
    """Return the directions that are not determined, choices of coordinates first, and those that hardly are."""
    describer = spectrum.describer
    gauge, lacking = describer.split
    undetermined = [Direction(describer.parts(d), True, describer.choice(d)) for d in gauge]
    undetermined += [
        Direction(describer.parts(d), False, describer.lack(d), describer.still(d)) for d in lacking
    ]
    named = {key for d in undetermined for key, _ in d.parts}
    hardly = []
    for d in (*sparse(spectrum.weak), *describer.hardly_changing()):
        parts = describer.parts(d)
        if len(parts) > 1 or parts[0][0] not in named:
            hardly.append(Direction(parts, False, describer.hardly(d)))
            named |= {key for key, _ in parts}
    return tuple(undetermined), tuple(hardly)


def sparse(basis: Array) -> Array:
    """Return directions that span the same and have few parts each: row echelon form with the largest pivots."""
    rows = basis.copy()
    done = np.zeros(rows.shape[1], bool)
    for row in range(len(rows)):
        rest = np.where(done, 0.0, np.abs(rows[row:]))
        r, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        rows[[row, row + int(r)]] = rows[[row + int(r), row]]
        rows[row] /= rows[row, column]
        others = np.arange(len(rows)) != row
        rows[others] -= np.outer(rows[others, column], rows[row])
        done[column] = True
    return rows
