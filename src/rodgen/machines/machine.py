"""A machine: its joints, targets, what is measured, the effects that its model has, and what is done with it.

All numbers are in internal units: lengths in the unit of the machine file, angles in radians, times in seconds,
temperatures in kelvins from the reference, forces in newtons. Nothing changes a machine; what seems to returns
another one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rodgen.data.set_aside import RowsAside, SetAside, edited, others, rows_aside, rows_text
from rodgen.data.units import ANGLE, Dimension, unit_factor
from rodgen.errors import InputFileError, RodgenError, UnexpectedError, in_file, joined, listed, shown
from rodgen.files import write_file
from rodgen.machines.coupling import Couplings, couplings_of
from rodgen.machines.effects.rules import UnfitEffectError, catalogue_effect, check_effect
from rodgen.machines.files.read import ColumnSource, machine_of, read_machine
from rodgen.machines.files.write import description, machine_text
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.kinematics import Chain, Kinematics, beyond, carriers
from rodgen.machines.known import read_known, read_tie
from rodgen.machines.measured import Measurand, Measured
from rodgen.machines.parts import (
    BRANCHES,
    Effect,
    Joint,
    Known,
    StatedPlausibility,
    Target,
    Tie,
    Vector,
    belongs,
)
from rodgen.machines.structure import Structure, structure_of
from rodgen.views import html_of_text

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit
    from rodgen.data.measurements import Measurements

_UNIT = 1e-9
"""How far the length of a unit vector may be off 1."""

__all__ = ["Effect", "EffectBearer", "Joint", "Machine", "Measured", "Target"]


class EffectBearer(Protocol):
    """Anything that has an effect, such as a step of a diagnosis."""

    @property
    def effect(self) -> Effect:
        """The effect, in its place."""


@dataclass(frozen=True)
class Machine:
    """A chain of joints, or a platform on legs, from the measuring frame to the measured point, with its errors.

    Attributes
    ----------
    name : str
    length_unit, angle_unit : str
        Of the plain numbers in the machine file.
    gravity : tuple of float, length 3
        Unit vector, in machine axes.
    reference_temperature : float
        In degrees Celsius.
    joints : tuple of Joint
        The base's first. Of a machine of two branches in the order from the instrument to the target: first those of
        the instrument's branch, that next to the bed last, then those of the other one.
    targets : tuple of Target
    measured : Measured
    estimate : tuple of str
        What a base fit adjusts: ``"target"``, ``"NAME.axis"``, ``"NAME.point"``; of a closed chain ``"target"``,
        ``"geometry"`` or its numbers by name.
    effects : tuple of Effect
    file : str or None
        Where it was read from; two machines may be equal from different files.
    values : mapping of str to float
        Fitted numbers, by the parameters' keys, such as ``"C.axis.a"``; empty as read: all are zero.
    kinematics : Kinematics
        How the joints carry the target: one after the other, or as the legs of a platform.
    known : mapping of str to Known
        What is known of parameters before they are measured, by their keys or by what they belong to; see `knowing`.
    plausible : mapping of str to StatedPlausibility
        What the file says of the plausibility of effects, by ``PLACE.EFFECT``, or ``EFFECT`` for every place.
    record : mapping of str to str
        What is noted of the measurements for reports: ``date``, ``instrument``, ``conditions``.
    ties : mapping of str to Tie
        Parameters, by their keys, that are combinations of others; see `tying`.
    column_sources : mapping of str to ColumnSource
        What the columns of other people's tables are, for ``rodgen import``.
    doubts : callable, optional
        Returns what is wrong with the files that the machine was fitted to, in one sentence, or an empty text; `emit`
        asks.

    Examples
    --------
    >>> machine = Machine(
    ...     "Rotary table", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
    ...     joints=(Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     targets=(Target("ball", (120.0, 0.0, 40.0)),),
    ...     measured=Measured("point", "machine", noise=0.002),
    ...     estimate=("C.axis", "target"),
    ... )
    >>> print(machine.with_effect(machine.effect("backlash", "C", hold={"b": 0.01})).describe())
    Rotary table (mm, deg)
      C  revolute about [0, 0, 1] through [0, 0, 0]
    targets: ball [120, 0, 40]
    measured: point in machine axes, noise 0.002 mm
    estimated: C.axis, target
    effects: backlash at C (b = 36 arcsec held)
    """

    name: str
    length_unit: str
    angle_unit: str
    gravity: Vector
    reference_temperature: float
    joints: tuple[Joint, ...]
    targets: tuple[Target, ...]
    measured: Measured
    estimate: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    file: str | None = field(default=None, compare=False)
    values: Mapping[str, float] = field(default_factory=dict, hash=False)
    kinematics: Kinematics = field(default_factory=Chain)
    known: Mapping[str, Known] = field(default_factory=dict, hash=False)
    plausible: Mapping[str, StatedPlausibility] = field(default_factory=dict, hash=False)
    record: Mapping[str, str] = field(default_factory=dict, hash=False)
    ties: Mapping[str, Tie] = field(default_factory=dict, hash=False)
    column_sources: Mapping[str, ColumnSource] = field(default_factory=dict, hash=False)
    doubts: Callable[[], str] | None = field(default=None, compare=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"doubts": None}  # a copy in another process does not take a fit's data along

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Machine:
        """Read a machine file.

        Parameters
        ----------
        path : str or os.PathLike
            A TOML file, at most 1 MB.

        Returns
        -------
        Machine

        Raises
        ------
        InputFileError
            One line with the place, what stands there and what should.
        """
        return read_machine(path, cls)

    def save(self, path: str | os.PathLike[str], *, fixed: bool = False) -> None:
        """Write a machine file.

        Parameters
        ----------
        path : str or os.PathLike
            Is replaced when the new file is complete.
        fixed : bool
            Write the fitted numbers too: axes, points and targets in place, the parameters of effects as ``hold``, and
            nothing to estimate. Where the free frame is, and the frame shift of each run, is not a property of
            the machine and has no place in its file: these are found again with the next measurements. Without `fixed`
            the fitted numbers are not written, and the file reads back as an equal machine.

        Raises
        ------
        InputFileError
            When it cannot be written; with `fixed`, also when an effect is measured over a travel that the
            machine does not give.
        """
        write_file(path, machine_text(fixed_machine(self) if fixed else self).encode())

    def validate(self) -> None:
        """Check what was built in Python as a machine file is checked; one that was read has been.

        Raises
        ------
        InputFileError
            One line with the place, what stands there and what should.
        """
        if self.file is not None:
            return
        read = machine_of(machine_text(self), self.name, type(self))
        directions = () if self.measurand.moving else self.targets
        vectors = {"gravity": self.gravity} | {f"target {t.name}, point": t.point for t in directions}
        for place, vector in vectors.items():
            if abs(math.hypot(*vector) - 1) > _UNIT:
                found = f"a vector of length {math.hypot(*vector):.6g}"
                raise InputFileError(self.name, place, found, "one of length 1")
        order = [joint.name for joint in read.joints]
        if order != [joint.name for joint in self.joints]:
            found = f"in the order {joined(joint.name for joint in self.joints)}"
            raise InputFileError(self.name, "joints", found, f"from instrument to target: {joined(order)}")

    @cached_property
    def structure(self) -> Structure:
        """What its kernels depend on."""
        return structure_of(self)

    @cached_property
    def inner(self) -> int:
        """How many of the joints, the first ones, carry the instrument: none in a chain."""
        return sum(joint.branch == self.measured.instrument for joint in self.joints)

    @property
    def branches(self) -> dict[str, tuple[Joint, ...]]:
        """The joints of the workpiece's and of the tool's branch, the bed's first; empty for a chain."""
        found = {
            name: tuple(joint for joint in self.joints if joint.branch == name)[:: -1 if inner else 1]
            for name, inner in ((name, name == self.measured.instrument) for name in BRANCHES)
        }
        return {name: joints for name, joints in found.items() if joints}

    @property
    def axes_of_places(self) -> str:
        """What the axes in which targets are seen are called in a sentence."""
        moved = f" that move with the {self.measured.instrument}" if self.branches else ""
        return f"machine axes{moved}"

    def carriers(self, j: int) -> range:
        """Return the numbers of the joints that carry joint j, the first one from the base or bed first."""
        return carriers(j, self.inner)

    def beyond(self, j: int) -> range:
        """Return the numbers of the joints that joint j carries, the next one first."""
        return beyond(j, self.inner, len(self.joints))

    @property
    def measurand(self) -> Measurand:
        """What is measured, with all that depends on it."""
        return self.measured.measurand

    def joint(self, name: str) -> Joint:
        """Return a joint by its name.

        Raises
        ------
        RodgenError
            When there is none.
        """
        return _named(name, "joint", self.joints)

    def number_of(self, joint: str) -> int:
        """Return the number of a joint by its name, from 0 at the base.

        Raises
        ------
        ValueError
            When there is none.
        """
        return [each.name for each in self.joints].index(joint)

    def target(self, name: str) -> Target:
        """Return a target by its name.

        Raises
        ------
        RodgenError
            When there is none.
        """
        return _named(name, "target", self.targets)

    def kind_of(self, place: str | None) -> str:
        """Return what is at a place: ``"revolute"``, ``"prismatic"``, ``"leg"``, ``"target"``, or ``"machine"``.

        Raises
        ------
        RodgenError
            When nothing does.
        """
        if place is None:
            return "machine"
        if any(place == target.name for target in self.targets):
            return "target"
        return self.joint(place).type

    def file_factor(self, dimension: Dimension) -> float:
        """Return the factor from the machine file's unit of this dimension to internal units."""
        angle, _ = unit_factor(self.angle_unit)
        return math.pow(angle, dimension["angle"])

    def file_unit(self, dimension: Dimension) -> str:
        """Return the machine file's unit of a length or an angle."""
        return self.angle_unit if dimension == ANGLE else self.length_unit

    def effect(
        self, name: str, place: str | None = None, *, hold: Mapping[str, float] | None = None
    ) -> Effect:
        """Return an effect of the catalogue at a place of this machine.

        Parameters
        ----------
        name : str
            As ``rodgen effects`` lists it.
        place : str, optional
            A joint or a target; left out: the whole machine.
        hold : mapping of str to float, optional
            Parameters that are not estimated, in the units of the machine file.

        Returns
        -------
        Effect
            For :meth:`with_effect`.

        Raises
        ------
        InputFileError
            When it cannot stand there.
        """
        try:
            return catalogue_effect(self, name, place, hold or {})
        except UnfitEffectError as error:
            raise self._unfit(f"{name} at {place}" if place else name, error) from None

    @cached_property
    def couplings(self) -> Couplings | None:
        """How the coordinates of joints follow from readings; None where each is the joint's reading."""
        return couplings_of(self)

    @cached_property
    def limits(self) -> tuple[tuple[float, float] | None, ...]:
        """Lowest and highest reading of each joint: stated, or what the coordinates' travels allow; else None."""
        if self.couplings is None:
            return tuple(joint.travel for joint in self.joints)
        stated = np.array([joint.travel or (np.nan, np.nan) for joint in self.joints])
        within = self.couplings.readings_within(stated)
        found: list[tuple[float, float] | None] = []
        for joint, coupling, (low, high) in zip(self.joints, self.couplings.of, within.tolist(), strict=True):
            known = joint.is_read and math.isfinite(low) and math.isfinite(high)
            own = joint.travel if coupling is None else joint.reading_travel
            found.append(own or ((low, high) if known else None))
        return tuple(found)

    @property
    def quantities(self) -> dict[str, str]:
        """Names of joints, which are their coordinates, and of readings, each with the type of the joint."""
        return {name: joint.type for joint in self.joints for name in (joint.column, joint.name)}

    def coordinates(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates of the joints that belong to readings, (..., J): the same without a coupling."""
        return q if self.couplings is None else self.couplings.coordinates(q)

    def followed(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return readings, (..., J), with the coordinate in the place of each joint that has no reading."""
        if self.couplings is None:
            return q
        return np.where([joint.is_read for joint in self.joints], q, self.couplings.coordinates(q))

    def within_travel(self, q: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which readings, (n, J), leave coupled joints within their own travels, (n,)."""
        inside = np.ones(len(q), bool)
        for joint, values in zip(self.joints, self.coordinates(q).T, strict=True):
            if joint.coordinate is not None and joint.travel is not None:
                inside &= (values >= joint.travel[0]) & (values <= joint.travel[1])
        return inside

    def with_effect(self, effect: Effect) -> Machine:
        """Return this machine with one more effect, after those that it has.

        Parameters
        ----------
        effect : Effect
            See :meth:`effect`.

        Raises
        ------
        InputFileError
            When it is there already, cannot stand at its place, changes no reading, or has the freedoms of another.
        """
        try:
            check_effect(self, effect)
        except UnfitEffectError as error:
            raise self._unfit(effect.title, error) from None
        return replace(self, effects=(*self.effects, effect))

    def _unfit(self, title: str, error: UnfitEffectError) -> InputFileError:
        place = f"{title}, {error.key}" if error.key.startswith("hold.") else title
        return InputFileError(self.file or self.name, place, error.found, error.expected)

    def without_effect(self, name: str, place: str | None = None) -> Machine:
        """Return this machine without one of its effects, and without that effect's fitted numbers.

        Parameters
        ----------
        name : str
        place : str, optional
            The effect's joint or target; left out for the whole machine.

        Raises
        ------
        InputFileError
            When there is no such effect.
        """
        gone = [e for e in self.effects if e.identity == (name, place)]
        if not gone:
            there = joined(e.title for e in self.effects) or "none: this machine has no effects"
            title = f"{name} at {place}" if place else name
            raise InputFileError(self.file or self.name, "[[effect]]", f"no {shown(title)}", there)
        kept = {k: v for k, v in self.values.items() if not gone[0].owns(k)}
        ties = {k: tie for k, tie in self.ties.items() if not gone[0].owns(k)}
        return replace(
            self, effects=tuple(e for e in self.effects if e is not gone[0]), values=kept, ties=ties
        )

    def knowing(
        self, key: str, *, prior: str | None = None, bounds: tuple[float | str, float | str] | None = None
    ) -> Machine:
        """Return this machine with a prior or bounds of some of its parameters.

        Parameters
        ----------
        key : str
            Of a parameter, such as ``"C.axis.a"``, or of what several belong to, such as ``"C.axis"``.
        prior : str, optional
            Value and standard deviation, such as ``"0 ± 20 arcsec"``.
        bounds : tuple, optional
            Lowest and highest value: numbers in the units of the machine file, or texts with a unit.

        Raises
        ------
        InputFileError
            When there is no such parameter, or the unit is of something else.
        """
        given = {name: x for name, x in (("prior", prior), ("bounds", bounds)) if x is not None}
        with in_file(self.file or self.name, f"[known], {key}"):
            if tied := next((name for name in self.ties if belongs(name, key)), None):
                raise UnexpectedError(f"{shown(tied)}, which is tied", "a parameter that is not")
            known = read_known(self, key, given)
        return replace(self, known={**self.known, key: known})

    def tying(self, key: str, to: str) -> Machine:
        """Return this machine with one more parameter tied to others.

        Parameters
        ----------
        key : str
            Of the parameter, such as ``"J2.gravity_windup.k"``.
        to : str
            A linear combination of others, such as ``"2 * J3.gravity_windup.k"``.

        Raises
        ------
        InputFileError
            When there is no such parameter, or one of the others is tied itself.
        """
        with in_file(self.file or self.name, f"[ties], {key}"):
            tie = read_tie(self, key, to)
        return replace(self, ties={**self.ties, key: tie})

    def without_bounds(self, keys: Collection[str]) -> Machine:
        """Return this machine without what it says of the bounds of some parameters.

        Parameters
        ----------
        keys : collection of str
            Of the parameters. Bounds that others have in common with them are left out, too.
        """
        concerned = {name for name in self.known if any(belongs(key, name) for key in keys)}
        known = {
            name: replace(known, bounds=None) if name in concerned else known
            for name, known in self.known.items()
            if name not in concerned or known.prior is not None
        }
        return replace(self, known=known)

    # rows of measurements ------------------------------------------------------------------------------------

    def aside(self, data: Any) -> RowsAside | None:
        """Return which rows of measurements are set aside; None where the machine file sets none aside.

        Parameters
        ----------
        data : Measurements, or a table in memory
            As of :meth:`fit`.

        Raises
        ------
        InputFileError
            When what the file says does not fit the measurements, or no row is left.
        """
        if not self.measured.set_aside:
            return None
        return rows_aside(self.measured.set_aside, _table(data), self._compared, self.file or self.name)

    @property
    def _compared(self) -> frozenset[str]:
        """Names of the columns of what is commanded and read."""
        return self.measurand.read_columns.union((joint.column for joint in self.joints), ("target",))

    def setting_aside(
        self,
        data: Any,
        *,
        rows: str | Sequence[int] = "",
        run: str = "",
        where: str = "",
        why: str = "",
    ) -> Machine:
        """Return this machine with rows of its measurements set aside: nothing is fitted to them.

        Parameters
        ----------
        data : Measurements, or a table in memory
            As of :meth:`fit`.
        rows : str or sequence of int
            As the table counts them: lines of a CSV file from 1, else rows from 0, such as ``"12, 40-43"``.
        run : str
            Or a run of that table.
        where : str
            Or a rule on columns, of any table: ``"EL < 20 deg"``; several are joined by ``and``.
        why : str
            A note.

        Raises
        ------
        InputFileError
            When there are no such rows, or none is left.

        Examples
        --------
        >>> table = Machine(
        ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
        ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("distance", "machine"),
        ... )
        >>> data = {"C [deg]": [0, 120, 240], "d [mm]": [100, 100.01, 140]}
        >>> table.setting_aside(data, rows=[2], why="bumped").aside(data).text
        '1 of the 3 rows of data is set aside: row 2 (bumped).'
        """
        return self._with_rows(data, rows=rows, run=run, where=where, why=why)

    def bringing_back(
        self,
        data: Any,
        *,
        rows: str | Sequence[int] = "",
        run: str = "",
        where: str = "",
        why: str = "",
    ) -> Machine:
        """Return this machine with rows of its measurements counting again; without a choice, all of that table.

        Parameters
        ----------
        data, rows, run, where, why
            As of :meth:`setting_aside`.

        Raises
        ------
        InputFileError
            When there are no such rows, or none of them is set aside.
        """
        if not (len(rows) or run or where):
            left = others(self.measured.set_aside, _table(data), self._compared)
            return replace(self, measured=replace(self.measured, set_aside=left))
        return self._with_rows(data, rows=rows, run=run, where=where, why=why, back=True)

    def _with_rows(self, data: Any, *, rows: str | Sequence[int], **said: Any) -> Machine:
        table, file = _table(data), self.file or self.name
        listed = rows if isinstance(rows, str) else rows_text(rows)
        of = "" if said["where"] else os.path.basename(table.file)
        with in_file(file, "[measured], set_aside"):
            new = SetAside(listed, file=of, **said)
            entries = edited(self.measured.set_aside, new, table, self._compared, file)
        changed = replace(self, measured=replace(self.measured, set_aside=entries))
        changed.aside(table)
        return changed

    # what is done with it ------------------------------------------------------------------------------------

    def fit(
        self,
        data: Any,
        *,
        loss: str = "linear",
        progress: Callable[[str, int, int | None], object] | None = None,
    ) -> Fit:
        """Return the fit of the model to measurements.

        Parameters
        ----------
        data : Measurements, Observations or a table in memory
            Such as a DataFrame, whose columns are named as those of a measurement file; see
            :meth:`rodgen.data.measurements.Measurements.from_frame`.
        loss : {"linear", "huber"}
            Least squares, or a robust loss: outliers are found, named and left out.
        progress : callable, optional
            Called with the stage, such as "fitting", how many of its steps are done, and of how many; None where
            that is not known.

        Returns
        -------
        Fit
            Its ``machine`` is this one with the fitted values.

        Raises
        ------
        InputFileError
            When the data do not fit the machine.
        FitError
            When there is nothing to fit, or the model is not finite at the start.
        """
        # The one import of a higher floor: `machine.fit(data)` reads as users think, and needs no second name.
        from rodgen.calibration.fit import fit

        return fit(self, data, loss=loss, progress=progress)

    def add(
        self,
        effect: str | Effect | EffectBearer,
        *,
        joint: str | None = None,
        target: str | None = None,
        hold: Mapping[str, float] | None = None,
    ) -> Machine:
        """Return this machine with one more effect.

        Parameters
        ----------
        effect : str, Effect or EffectBearer
            A name of the catalogue, as ``rodgen effects`` lists it; an effect in its place; or an object that has one
            as its ``effect``, such as a step of a diagnosis.
        joint, target : str, optional
            Where it is; left out: the whole machine.
        hold : mapping of str to float, optional
            Parameters that are not estimated, in the units of the machine file.

        Raises
        ------
        InputFileError
            When it cannot stand there, or is there already.

        Examples
        --------
        >>> table = Machine(
        ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
        ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
        ... )
        >>> [effect.title for effect in table.add("backlash", joint="C").effects]
        ['backlash at C']
        """
        if isinstance(effect, str):
            return self.with_effect(self.effect(effect, self._place(joint, target), hold=hold))
        return self.with_effect(effect if isinstance(effect, Effect) else effect.effect)

    def remove(self, effect: str, *, joint: str | None = None, target: str | None = None) -> Machine:
        """Return this machine without one of its effects.

        Parameters
        ----------
        effect : str
            Its name.
        joint, target : str, optional
            Where it is; left out: the whole machine.

        Raises
        ------
        InputFileError
            When there is no such effect.
        """
        return self.without_effect(effect, self._place(joint, target))

    def _place(self, joint: str | None, target: str | None) -> str | None:
        if joint is not None and target is not None:
            found = f"joint {shown(joint)} and target {shown(target)}"
            raise InputFileError(self.file or self.name, "effect", found, "one of the two, or neither")
        return joint if joint is not None else target

    def emit(self, lang: str, folder: str | os.PathLike[str], **options: Any) -> list[Path]:
        """Write the fitted machine as standalone code, or as what others read; see :func:`rodgen.machines.emit.emit`.

        Parameters
        ----------
        lang : {"c", "cpp", "matlab", "numpy", "jax", "urdf", "dh", "tpoint", "iso230", "screw", "linuxcnc"}
        folder : str or os.PathLike
            Is made where there is none.
        **options
            ``name``, ``travel``, ``covariance``, ``residual``, ``into`` and ``force`` of that function.

        Returns
        -------
        list of Path
            The files.
        """
        from rodgen.machines.emit import emit  # needs SymPy

        return emit(self, lang, folder, **options)

    def describe(self) -> str:
        """Return a short summary: joints, targets, what is measured and estimated, effects."""
        return description(self)

    def _repr_html_(self) -> str:
        return html_of_text(self.describe())


def _table(data: Any) -> Measurements:
    from rodgen.data.measurements import Measurements  # imports what reads tables

    return Measurements.of(data)


_Thing = TypeVar("_Thing", Joint, Target)


def _named(name: str, kind: str, things: tuple[_Thing, ...]) -> _Thing:
    found = next((thing for thing in things if thing.name == name), None)
    if found is None:
        names = listed([thing.name for thing in things])
        raise RodgenError(f"no {kind} {shown(name)}; expected {names}")
    return found
