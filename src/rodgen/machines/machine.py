"""What a machine is made of: joints, targets, what is measured, and the effects that its model has.

All numbers are in internal units: lengths in the unit of the machine file, angles in radians, times in seconds,
temperatures in kelvins from the reference, forces in newtons. Nothing changes a machine; what seems to returns
another one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.machines.closed_chain import ClosedChain

if TYPE_CHECKING:
    from rodgen.calibration.diagnose import DiagnosedEffect
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.simulate import Simulation
    from rodgen.data.measurements import Measurements
    from rodgen.data.units import Dimension
    from rodgen.machines.effects.catalogue import EffectDefinition

__all__ = ["Effect", "Joint", "Machine", "Measured", "Target"]

Vector: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Joint:
    """A joint, given with all joints at zero, or a leg of a closed chain.

    Attributes
    ----------
    name : str
    type : {"prismatic", "revolute", "leg"}
    axis : tuple of float, length 3
        Unit vector of positive motion, in machine axes; zeros of a leg, which has none of its own.
    point : tuple of float, length 3
        A point on the axis; of a prismatic joint, where its error motion turns.
    travel : tuple of (float, float), or None
        Lowest and highest coordinate; None: the range of the data.
    period : float or None
        Of a periodic drive error, in the joint's own unit.
    """

    name: str
    type: str
    axis: Vector = (0.0, 0.0, 0.0)
    point: Vector = (0.0, 0.0, 0.0)
    travel: tuple[float, float] | None = None
    period: float | None = None


@dataclass(frozen=True)
class Target:
    """What is measured: a point of the last body, or a direction fixed to it, with all joints at zero.

    Attributes
    ----------
    name : str
    point : tuple of float, length 3
        In machine axes; of length 1 where directions are measured.
    """

    name: str
    point: Vector


@dataclass(frozen=True)
class Measured:
    """What a reading is.

    Attributes
    ----------
    kind : {"point", "direction", "distance"}
    frame : {"machine", "free"}
        Readings are in machine axes, or in a frame that is found with the rest.
    origin : tuple of float, length 3, or None
        Where a distance is measured from, in the measuring frame.
    noise : float or None
        Standard uncertainty of a scalar reading.
    """

    kind: str
    frame: str
    origin: Vector | None = None
    noise: float | None = None


@dataclass(frozen=True)
class Effect:
    """An effect in its place.

    Attributes
    ----------
    definition : EffectDefinition
        From the catalogue, or the user's own.
    place : str or None
        Name of a joint or of a target; None: the whole machine.
    hold : mapping of str to float
        Parameters that are not estimated, with their values.
    """

    definition: EffectDefinition
    place: str | None = None
    hold: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.definition.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters, without those that depend on the other joints (see `units`)."""
        return tuple(self.definition.parameters)

    @property
    def title(self) -> str:
        """What a sentence calls it, such as ``backlash at C``."""
        return f"{self.name} at {self.place}" if self.place else self.name

    def key(self, parameter: str) -> str:
        """Return what a parameter is called beside all others of the machine.

        Parameters
        ----------
        parameter : str
            One of `units`.
        """
        return ".".join(filter(None, (self.place, self.name, parameter)))

    def owns(self, key: str) -> bool:
        """Tell whether a parameter's key is of this effect; an indexed name is that of a set-up: frame_shift[2].x."""
        prefix = self.key("")
        return key.startswith((f"{prefix}.", f"{prefix}["))

    def units(self, machine: Machine) -> dict[str, str]:
        """Return every parameter with the unit in which it is shown.

        Parameters
        ----------
        machine : Machine
            Which this is, or may become, an effect of.

        Returns
        -------
        dict of str to str
            In the catalogue's order; then one ``k_NAME`` for each later joint, where the effect has these.
        """
        units = self.definition.units(machine.length_unit, machine.measured.kind)
        if self.definition.later_joints:
            names = [joint.name for joint in machine.joints]
            later = names[names.index(str(self.place)) + 1 :]
            units |= {f"k_{name}": f"arcsec/{machine.length_unit}" for name in later}
        return units


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
        The base's first.
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
    geometry : ClosedChain or None
        Of a closed chain, whose joints are legs; None for a chain of joints.

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
    geometry: ClosedChain | None = None

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
        from rodgen.machines.files.read import read_machine

        return read_machine(path)

    def save(self, path: str | os.PathLike[str], *, fixed: bool = False) -> None:
        """Write a machine file.

        Parameters
        ----------
        path : str or os.PathLike
            Is replaced when the new file is complete.
        fixed : bool
            Write the fitted numbers too: axes, points and targets in place, the parameters of effects as ``hold``, and
            nothing to estimate. Where the free frame is, and the frame shift of each run, is not a property of
            the machine and has no place in its file: these are found again with the next measurements. Left out: the
            fitted numbers are not written, and the file reads back as an equal machine.

        Raises
        ------
        InputFileError
            When it cannot be written; with `fixed`, also when an effect is measured over a travel that the
            machine does not say.
        """
        from rodgen.files import write_file
        from rodgen.machines.files.write import fixed_machine, machine_text

        write_file(path, machine_text(fixed_machine(self) if fixed else self).encode())

    def joint(self, name: str) -> Joint:
        """Return a joint by its name.

        Raises
        ------
        RodgenError
            When there is none.
        """
        return _named(name, "joint", self.joints)

    def target(self, name: str) -> Target:
        """Return a target by its name.

        Raises
        ------
        RodgenError
            When there is none.
        """
        return _named(name, "target", self.targets)

    def kind_of(self, place: str | None) -> str:
        """Tell what stands at a place: ``"revolute"``, ``"prismatic"``, ``"leg"``, ``"target"``, or ``"machine"``.

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
        """Return what a number of this dimension in the machine file is multiplied by to be in internal units."""
        from rodgen.data.units import unit_factor

        angle, _ = unit_factor(self.angle_unit)
        return math.pow(angle, dimension["angle"])

    def effect(
        self, name: str, place: str | None = None, *, hold: Mapping[str, float] | None = None
    ) -> Effect:
        """Make an effect of the catalogue for a place of this machine.

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
        from rodgen.machines.effects.rules import UnfitEffectError, catalogue_effect

        try:
            return catalogue_effect(self, name, place, hold or {})
        except UnfitEffectError as error:
            raise self._unfit(f"{name} at {place}" if place else name, error) from None

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
        from rodgen.machines.effects.rules import UnfitEffectError, check_effect

        try:
            check_effect(self, effect)
        except UnfitEffectError as error:
            raise self._unfit(effect.title, error) from None
        return replace(self, effects=(*self.effects, effect))

    def _unfit(self, title: str, error: RodgenError) -> InputFileError:
        key, found, expected = error.args
        place = f"{title}, {key}" if key.startswith("hold.") else title
        return InputFileError(self.file or self.name, place, found, expected)

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
        gone = [e for e in self.effects if (e.name, e.place) == (name, place)]
        if not gone:
            there = ", ".join(e.title for e in self.effects) or "none: this machine has no effects"
            title = f"{name} at {place}" if place else name
            raise InputFileError(self.file or self.name, "[[effect]]", f"no {shown(title)}", there)
        kept = {k: v for k, v in self.values.items() if not gone[0].owns(k)}
        return replace(self, effects=tuple(e for e in self.effects if e is not gone[0]), values=kept)

    # what is done with it ------------------------------------------------------------------------------------

    def fit(
        self,
        data: Measurements,
        *,
        loss: str = "linear",
        progress: Callable[[str, int, float], object] | None = None,
    ) -> Fit:
        """Adjust the parameters until the model meets measurements best.

        Parameters
        ----------
        data : Measurements
        loss : {"linear", "huber"}
            Sum of squares, or one that outliers do not pull: they are found, named and taken out.
        progress : callable, optional
            Called with what is done, the iteration and the cost.

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
        from rodgen.calibration.fit import fit

        return fit(self, data, loss=loss, progress=progress)

    def add(
        self,
        effect: str | Effect | DiagnosedEffect,
        *,
        joint: str | None = None,
        target: str | None = None,
        hold: Mapping[str, float] | None = None,
    ) -> Machine:
        """Return this machine with one more effect.

        Parameters
        ----------
        effect : str, Effect or DiagnosedEffect
            A name of the catalogue, as ``rodgen effects`` lists it, or a step of a diagnosis.
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
        """Write the fitted machine as standalone code; see :func:`rodgen.machines.emit.emit`.

        Parameters
        ----------
        lang : {"c", "numpy"}
        folder : str or os.PathLike
            Is made where there is none.
        **options
            ``name`` of the files, and ``travel`` of the joints in the data.

        Returns
        -------
        list of Path
            The files.
        """
        from rodgen.machines.emit import emit

        return emit(self, lang, folder, **options)

    def simulate(
        self, design: Measurements, effects: Sequence[str | Effect] = (), **options: Any
    ) -> Simulation:
        """Make up measurements of this machine; see :func:`rodgen.calibration.simulate.simulate`.

        Parameters
        ----------
        design : Measurements
            What is commanded; readings are not needed.
        effects : sequence of str or Effect
            What the data have in them beside what the machine has, such as ``"backlash@C:b=20arcsec"``.
        **options
            ``hidden``, ``noise``, ``seed``.

        Returns
        -------
        Simulation
        """
        from rodgen.calibration.simulate import simulate

        return simulate(self, design, effects, **options)

    def describe(self) -> str:
        """Return a short summary: joints, targets, what is measured and estimated, effects."""
        from rodgen.machines.files.write import description

        return description(self)


_Thing = TypeVar("_Thing", Joint, Target)


def _named(name: str, kind: str, things: tuple[_Thing, ...]) -> _Thing:
    found = next((thing for thing in things if thing.name == name), None)
    if found is None:
        names = ", ".join(thing.name for thing in things)
        raise RodgenError(f"no {kind} {shown(name)}; expected one of {names}")
    return found
