"""A machine as data: its joints, its targets, what is measured, and the effects of its model, each in its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

from rodgen.data.units import ANGLE, Dimension, unit_factor
from rodgen.errors import RodgenError, listed, shown, suggestion
from rodgen.machines.effects.definition import OF_A_LOOP, TURNING, EffectDefinition, coordinate_dimension
from rodgen.machines.families.kinematics import Chain, Kinematics, beyond, carriers
from rodgen.machines.linear import Combination
from rodgen.machines.measured import Measurand, Measured
from rodgen.views import with_html

Vector: TypeAlias = tuple[float, float, float]
EffectIdentity: TypeAlias = tuple[str, str | None]
"""Name and place of an effect."""

ENCODERS = ("axis", "motor")
"""Where the encoder of a joint may sit."""
DRIVES = ("direct", "worm", "gear", "belt", "friction", "harmonic", "screw")
"""What may move a joint; harmonic is a strain wave gear."""
BRANCHES = ("workpiece", "tool")
"""The two arms of a machine that stands between them: what each joint, counted from the bed, brings along."""
JOINT_TYPES = ("prismatic", "revolute")
"""The types of joints of a chain."""
_OTHER_WORDS = {
    "linear": "prismatic",
    "translational": "prismatic",
    "rotary": "revolute",
    "rotational": "revolute",
}


def suggested_type(word: str) -> str:
    """Return what is expected instead of a word that is no type of a joint, for an error message.

    Examples
    --------
    >>> suggested_type("rotary"), suggested_type("leg of a table")
    ("'revolute', perhaps", "'prismatic' or 'revolute'")
    """
    return f"{_OTHER_WORDS[word]!r}, perhaps" if word in _OTHER_WORDS else suggestion(word, JOINT_TYPES)


def unit_vector(vector: Iterable[float]) -> Vector:
    """Return a vector scaled to unit length; one that has it, to rounding, is not changed.

    Raises
    ------
    ValueError
        When it is zero.
    """
    components = tuple(vector)
    largest = max(map(abs, components))
    if largest == 0:
        raise ValueError("[0, 0, 0], which has no direction")
    if abs(math.hypot(*components) - 1.0) > 1e-15:
        components = tuple(x / largest for x in components)
        length = math.hypot(*components)
        components = tuple(x / length for x in components)
    x, y, z = components
    return x, y, z


def _three(where: str, vector: Iterable[float]) -> Vector:
    try:
        x, y, z = map(float, vector)
    except (TypeError, ValueError):
        raise RodgenError(
            f"{where}: {shown(str(vector))}; expected three numbers, such as (0, 0, 1)"
        ) from None
    return x, y, z


@with_html
@dataclass(frozen=True)
class Joint:
    """A joint, given with all joints at zero, or one of a closed chain: a leg, a tower or an arm.

    Attributes
    ----------
    name : str
    type : {"prismatic", "revolute", "leg", "tower", "arm"}
    axis : tuple of float, length 3
        Unit vector of positive motion, in machine axes; zeros in a closed chain, whose family has it.
    point : tuple of float, length 3
        A point on the axis; of a prismatic joint, where its error motion turns.
    travel : tuple of (float, float), or None
        Lowest and highest coordinate; None: the range of the data.
    period : float or None
        Of a periodic drive error, in the joint's own unit.
    encoder : str or None
        Where the encoder sits, one of `ENCODERS`; None: not known.
    drive : str or None
        What moves it, one of `DRIVES`; None: not known.
    passive : bool
        Whether nothing moves it, so that it has no errors of a drive.
    counterbalance : bool
        Whether a counterweight or a spring bears weight there, so that weight may turn it either way.
    branch : str
        ``"workpiece"`` or ``"tool"``: what it brings along, of a machine of two branches; empty in a chain.
    coordinate : str or None
        The coordinate as a linear combination of readings and of coordinates of other joints, such as ``"J3m - J2m"``
        or ``"0.5*J2 + 10 deg"``; None: it is the joint's reading.
    reading : str or None
        Name of the joint's reading, which is that of its column in the measurements; None: the joint's name, or, with a
        `coordinate`, that nothing reads or moves it by itself.
    reading_travel : tuple of (float, float), or None
        Lowest and highest reading of a joint with a `coordinate`, whose own limits are `travel`.
    """

    name: str
    type: str
    axis: Vector = (0.0, 0.0, 0.0)
    point: Vector = (0.0, 0.0, 0.0)
    travel: tuple[float, float] | None = None
    period: float | None = None
    encoder: str | None = None
    drive: str | None = None
    passive: bool = False
    counterbalance: bool = False
    branch: str = ""
    coordinate: str | None = None
    reading: str | None = None
    reading_travel: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        words = {"encoder": ENCODERS, "drive": DRIVES, "branch": BRANCHES, "type": (*JOINT_TYPES, *OF_A_LOOP)}
        for key, options in words.items():
            word = getattr(self, key)
            if word and word not in options:
                hint = suggested_type(word) if key == "type" else suggestion(word, options)
                raise RodgenError(f"joint {self.name}, {key}: {shown(word)}; expected {hint}")
        axis = _three(f"joint {self.name}, axis", self.axis)
        if not self.in_loop:
            try:
                axis = unit_vector(axis)
            except ValueError as error:
                raise RodgenError(
                    f"joint {self.name}, axis: {error}; expected a vector, such as (0, 0, 1)"
                ) from None
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "point", _three(f"joint {self.name}, point", self.point))

    @property
    def is_read(self) -> bool:
        """Whether it has a reading of its own; else its coordinate follows from others."""
        return self.coordinate is None or self.reading is not None

    @property
    def column(self) -> str:
        """Name of its column in the measurements."""
        return self.reading or self.name

    @property
    def revolute(self) -> bool:
        """Whether it turns; else its coordinate is a length."""
        return self.type in TURNING

    @property
    def in_loop(self) -> bool:
        """Whether it holds the platform of a closed chain, with others."""
        return self.type in OF_A_LOOP

    @property
    def dimension(self) -> Dimension:
        """Dimension of its coordinate."""
        return coordinate_dimension(self.type)


@with_html
@dataclass(frozen=True)
class Target:
    """What is measured: a point of the last body, or a direction fixed to it, with all joints at zero.

    Attributes
    ----------
    name : str
    point : tuple of float, length 3
        In machine axes; of length 1 where directions are measured.
    attitude : tuple of float, length 3
        Rotation vector in radians, in machine axes, that turns these to the target's own; where poses are measured.
    zero : float
        What the instrument reads at an angle of zero, radians; where angles are measured.
    """

    name: str
    point: Vector
    attitude: Vector = (0.0, 0.0, 0.0)
    zero: float = 0.0

    def __post_init__(self) -> None:
        for key in ("point", "attitude"):
            object.__setattr__(self, key, _three(f"target {self.name}, {key}", getattr(self, key)))


@with_html
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
    terms : mapping of str to str
        On a mount, the terms of TPOINT that parameters are, such as ``{"a": "-TX"}``.
    """

    definition: EffectDefinition
    place: str | None = None
    hold: Mapping[str, float] = field(default_factory=dict, hash=False)
    terms: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.definition.name

    @property
    def identity(self) -> EffectIdentity:
        """Name and place, which no two effects of a machine share."""
        return self.name, self.place

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters, without those that depend on the other joints (see `units`)."""
        return tuple(self.definition.parameters)

    @property
    def title(self) -> str:
        """Name and place, such as ``backlash at C``; on a mount with TPOINT's terms, ``tube_flexure (TF)``."""
        return self.titled()

    @property
    def term_names(self) -> Set[str]:
        """TPOINT's terms that its parameters are, in the order of these."""
        return {term.removeprefix("-").partition("/")[0]: None for term in self.terms.values()}.keys()

    def titled(self, *more: str) -> str:
        """Return the title, with what more is to be said of the effect in the brackets of its terms."""
        title = f"{self.name} at {self.place}" if self.place else self.name
        if self.definition.component == "geometry":  # a number of a closed chain
            title = f"another {self.place}"
        names = "; ".join(filter(None, (", ".join(self.term_names), *more)))
        return f"{title} ({names})" if names else title

    def label(self, parameter: str) -> str:
        """Return a parameter's name; on a mount with the term of TPOINT that it is, such as ``a = -TX``."""
        return f"{parameter} = {self.terms[parameter]}" if parameter in self.terms else parameter

    def key(self, parameter: str) -> str:
        """Return the key of a parameter, unique in the machine.

        Parameters
        ----------
        parameter : str
            One of `units`.
        """
        return ".".join(filter(None, (self.place, self.name, parameter)))

    def owns(self, key: str) -> bool:
        """Return whether a parameter's key is of this effect, also of one set-up, such as ``frame_shift[2].x``."""
        prefix = self.key("")
        return key.startswith((f"{prefix}.", f"{prefix}["))

    def is_per_run(self, values: Mapping[str, float]) -> bool:
        """Return whether fitted values hold this effect for each set-up, such as ``frame_shift[2].x``."""
        return any(key.startswith(f"{self.key('')}[") for key in values)

    def given(self, machine: MachineData, parameter: str) -> float | None:
        """Return the value of a parameter that the joint's block gives, None where it gives none."""
        key = self.definition.given_by_joint.get(parameter)
        return None if key is None else getattr(machine.joint(str(self.place)), key)

    def units(self, machine: MachineData) -> dict[str, str]:
        """Return every parameter with the unit in which it is shown.

        Parameters
        ----------
        machine : MachineData
            Which this is, or may become, an effect of.

        Returns
        -------
        dict of str to str
            In the catalogue's order; then those of weights, where the effect has these.
        """
        units = self.definition.units(machine.length_unit, machine.measurand)
        if self.definition.later_joints:
            later = machine.beyond(machine.number_of(str(self.place)))
            weights = self.definition.weights([machine.joints[k].name for k in later])
            units |= dict.fromkeys(weights, f"arcsec/{machine.length_unit}")
        return units


@dataclass(frozen=True)
class Known:
    """What is known of a parameter, internal units."""

    prior: tuple[float, float] | None = None
    """Mean and standard deviation."""
    bounds: tuple[float, float] | None = None
    """Lowest and highest value; one of them may be infinite."""


@dataclass(frozen=True)
class StatedPlausibility:
    """What a machine file says of the plausibility of an effect; None and empty: what is usual on such machines."""

    odds: float | None = None
    """Compared with the commonest effects."""
    usual: tuple[str, ...] = ()
    largest: tuple[str, ...] = ()
    """Sizes with units, such as ``"20 arcsec"``."""
    sign: str | None = None
    """"any" or "positive"."""


@dataclass(frozen=True)
class ColumnSource:
    """Where a column of measurements comes from: sign times theirs, and an offset."""

    name: str
    """Of their column, without its unit."""
    unit: str = ""
    """Where theirs has none, or another; empty: as it says itself."""
    sign: float = 1.0
    offset: float = 0.0
    """In that unit."""


@dataclass(frozen=True)
class MachineData:
    """A machine as its file describes it; :class:`rodgen.machines.machine.Machine` has its attributes."""

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
    ties: Mapping[str, Combination] = field(default_factory=dict, hash=False)
    column_sources: Mapping[str, ColumnSource] = field(default_factory=dict, hash=False)
    doubts: Callable[[], str] | None = field(default=None, compare=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"doubts": None}  # a copy in another process does not take a fit's data along

    @cached_property
    def inner(self) -> int:
        """How many of the joints, the first ones, carry the instrument: none in a chain."""
        return sum(joint.branch == self.measured.instrument for joint in self.joints)

    @property
    def branches(self) -> dict[str, tuple[Joint, ...]]:
        """The joints of the workpiece's and of the tool's branch, the bed's first; empty for a chain."""
        branches = {
            name: tuple(joint for joint in self.joints if joint.branch == name)[:: -1 if inner else 1]
            for name, inner in ((name, name == self.measured.instrument) for name in BRANCHES)
        }
        return {name: joints for name, joints in branches.items() if joints}

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
        """Return what is at a place: the type of a joint, ``"target"``, or ``"machine"``.

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

    def kinds_of(self, place: str | None) -> set[str]:
        """Return what is at a place as `kind_of` does; of the whole machine also all its legs, such as ``"arms"``."""
        legs = {f"{joint.type}s" for joint in self.joints if joint.in_loop and place is None}
        return {self.kind_of(place), *legs}

    def file_factor(self, dimension: Dimension) -> float:
        """Return the factor from the machine file's unit of this dimension to internal units."""
        angle, _ = unit_factor(self.angle_unit)
        return math.pow(angle, dimension["angle"])

    def file_unit(self, dimension: Dimension) -> str:
        """Return the machine file's unit of a length or an angle."""
        return self.angle_unit if dimension == ANGLE else self.length_unit


_Thing = TypeVar("_Thing", Joint, Target)


def _named(name: str, kind: str, things: tuple[_Thing, ...]) -> _Thing:
    match = next((thing for thing in things if thing.name == name), None)
    if match is None:
        names = listed([thing.name for thing in things])
        raise RodgenError(f"no {kind} {shown(name)}; expected {names}")
    return match


def known_of(known: Mapping[str, Known], key: str) -> Known:
    """Return what is known of a parameter: what is said of its key, or else of what it belongs to.

    Parameters
    ----------
    known : mapping of str to Known
        By keys of parameters, or by what several belong to, such as ``"C.axis"``.
    key : str
        The parameter's.
    """
    known_there = Known()
    for name in sorted((name for name in known if belongs(key, name)), key=len):
        entry = known[name]
        known_there = Known(entry.prior or known_there.prior, entry.bounds or known_there.bounds)
    return known_there


def belongs(key: str, name: str) -> bool:
    """Return whether a parameter's key is a name, or of what it names, such as ``C.axis.a`` of ``C.axis``."""
    return key == name or key.startswith((f"{name}.", f"{name}["))
