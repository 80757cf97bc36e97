"""The definition of an effect: where it acts, what it changes and by which formula, and its description."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from rodgen.data.units import ANGLE, LENGTH, ONE, Dimension
from rodgen.machines.effects.formula import Formula
from rodgen.machines.measured import DIRECTION, POINT, Measurand
from rodgen.views import plain

COMPONENTS = {
    "reading": "reading += {formula}",
    "base_joint": "the leg's joint on the base moved by {formula}",
    "platform_joint": "the leg's joint on the platform moved by {formula}, in platform axes",
    "heading": "the tower or arm turned about z by {formula}",
    "arm": "the arm longer by {formula}",
    "rod": "the rod longer by {formula}",
    "translation": "translation {formula}",
    "rotation": "rotation vector {formula}",
    "axis": "the axis turned by the rotation vector {formula}",
    "point": "point moved by {formula}",
    "target": "the target moved by {formula}",
    "remounting": "in each run but the first the target moved by {formula}",
    "frame": "the frame moves by {formula}",
    "frame_shift": "the frame moved by {formula} and turned by {slope}",
    "factor": "reading × (1 + {formula})",
    "axes": "reading += {formula}",
    "plate": "the plate higher by {formula}",
    "lift": "direction lifted towards −g by {formula}",
    "sag": "drop along g {formula}, turned about N × g by {slope}",
    "tx": "translation along x {formula}",
    "ty": "translation along y {formula}",
    "tz": "translation along z {formula}",
    "rx": "rotation about x {formula}",
    "ry": "rotation about y {formula}",
    "rz": "rotation about z {formula}",
}
"""What an effect may change, as the pattern of its equation."""

_TURNED = {
    "target": "the target turned by the rotation vector {formula}",
    "remounting": "in each run but the first the target turned by the rotation vector {formula}",
    "frame_shift": "the frame turned by the rotation vector {formula}",
}
"""The same where directions are measured and the formula differs."""

_PLACES = {
    "revolute": "at a revolute joint",
    "prismatic": "at a prismatic joint",
    "leg": "at a leg of a closed chain",
    "tower": "at a tower of a linear delta",
    "arm": "at an arm of a rotary delta",
    "legs": "of all legs of a closed chain alike",
    "towers": "of all towers of a linear delta alike",
    "arms": "of all arms of a rotary delta alike",
    "machine": "of the whole machine",
    "target": "of a target",
}
_WIDTH = 100


DIMENSIONS = frozenset({"axis", "point", "target", "base_joint", "platform_joint", "heading", "rod", "arm"})
"""What a dimension that is off changes."""
WEIGHTS = frozenset({"M", "M_perp", "M_across", "M_guide", "F", "bend", "fork", "leg_tension"})
"""Words of formulas for moments, loads and the bending by weight."""

SKY = frozenset({"z", "azimuth"})
"""Words of users' formulas where directions are measured: zenith angle and azimuth of the line of sight."""


OF_A_LOOP = {"leg": "a leg", "tower": "a tower", "arm": "an arm"}
"""Types of joints that hold a platform together, in words; they have no axis of their own in a file."""
ALL_OF_A_LOOP = {f"{joint}s": f"all {joint}s" for joint in OF_A_LOOP}
"""All these joints together, which an effect may change alike, in words."""
TURNING = ("revolute", "arm")
"""Types of joints whose coordinates are angles."""


def coordinate_dimension(joint_type: str) -> Dimension:
    """Return the dimension of the coordinate of a joint of this type."""
    return ANGLE if joint_type in TURNING else LENGTH


class StartSearch(Enum):
    """What the start of a parameter is searched as, where the readings do not depend on it smoothly enough."""

    PERIOD = "the period of a wave along a joint's way"
    TIME_CONSTANT = "a time constant"
    ANY = "a parameter of a user's formula"

    @property
    def before(self) -> float:
        """Value before it is found, internal units; the effect's other parameters are zero then."""
        # longer than any measurement: exp(-t/tau) is 1 with any origin of t
        return 1e12 if self is StartSearch.TIME_CONSTANT else 1.0


@dataclass(frozen=True)
class EffectDefinition:
    """An effect, of the catalogue or of a user."""

    name: str
    at: frozenset[str]
    """Where it may stand: ``"revolute"``, ``"prismatic"``, one of `OF_A_LOOP` or `ALL_OF_A_LOOP`,
    ``"machine"``, ``"target"``."""
    component: str
    """What it changes, one of :data:`COMPONENTS`."""
    formula: Formula
    """By how much. In the catalogue a formula may be a vector, and has more names than users' formulas: U V N (unit
    vectors that complete the axis, the axis), EX EY EZ (machine axes), M M_perp M_across M_guide (moments of a unit
    force along gravity), bend (N × gravity), fork (the part along N of n × gravity, n the axis before, upwards), zeta
    (place in the travel, 0 to 1), P1 to P4 (Legendre polynomials of 2 zeta - 1), L (length of the travel), q_before
    (coordinate of the joint before), acc (its acceleration), tan_zenith, sin_zenith, read_x, read_y, read_z
    (components of the reading; over a plate those of the place), leg_tension (force in the leg, tension positive,
    per unit load along gravity at the target). At a tower or an arm U points outwards, V across, N upwards;
    at a plate of a hexapod U points from the middle of its joints to that of the leg, across z."""
    parameters: Mapping[str, str] = field(hash=False)
    """Names with units, in which ``{length}`` is the machine file's unit of length, ``{arm}`` that too, or 1 where
    directions are measured, and ``{move}`` that too, or arcsec where directions are measured."""
    meaning: str = ""
    usual_size: str = ""
    remedy: str = ""
    source: str = ""
    """The physical cause and how it shows; its usual size; what to do about it; the reference."""
    iso: str = ""
    """Symbols of ISO 230, where there are any."""
    tpoint: Mapping[str, str] = field(default_factory=dict, hash=False)
    """TPOINT's terms, each with what it is: ``{"TF": "a"}``. Signs are those of a mount whose azimuth turns about -z
    and elevation about x, or whose hour angle turns about -z and declination about -y."""
    slope: Formula | None = None
    """A second formula: the slope of a sag, the rotation vector of a frame shift."""
    searched: Mapping[str, StartSearch] = field(default_factory=dict, hash=False)
    """Parameters whose start comes from a search."""
    given_by_joint: Mapping[str, str] = field(default_factory=dict, hash=False)
    """Parameters that a key of the joint's block may give, such as ``period``."""
    per_run: bool = False
    """Whether each set-up of the measurements has parameters of its own."""
    own: bool = False
    """Whether a user wrote it."""
    others: tuple[tuple[str, Formula], ...] = ()
    """Of a user's effect that changes several components: the further ones, each with its formula."""
    later_joints: bool = False
    """Whether the weights of what the joint carries add parameters, angles over lengths; see :meth:`weights`."""
    of_directions: bool = False
    """Whether it is seen where directions are measured, only."""
    of_drive: bool = False
    """Whether the drive of a joint causes it, so that a passive joint has none."""
    directions: EffectDefinition | None = None
    """The same effect where directions are measured, if its parameters differ there; see :meth:`for_measurand`."""
    poses: EffectDefinition | None = None
    """The same where poses are."""
    entry: str = ""
    """Of the catalogue: the entry of the derivation ``effects`` that says where its formulas come from."""

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """All its formulas."""
        slope = () if self.slope is None else (self.slope,)
        return (self.formula, *slope, *(formula for _, formula in self.others))

    @property
    def of_all_legs(self) -> bool:
        """Whether it changes all legs of a closed chain alike."""
        return self.at <= ALL_OF_A_LOOP.keys()

    @property
    def rung(self) -> int:
        """Where it is in the ladder of a robot: 0 a zero, 1 another dimension, 2 weight and loads, 3 the rest."""
        if (
            self.component == "reading"
            and len(self.parameters) == 1
            and not self.formula.names - set(self.parameters)
        ):
            return 0
        if self.component in DIMENSIONS:
            return 1
        return 2 if self.component == "sag" or self.formula.names & WEIGHTS else 3

    @property
    def follows_time(self) -> bool:
        """Whether it changes with time or from run to run."""
        return self.per_run or "t" in self.formula.names

    def weights(self, later: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the parameters of weights: at each later joint, and off the line to the next one.

        Parameters
        ----------
        later : sequence of str
            Names of the joints beyond.

        Examples
        --------
        >>> from rodgen.machines.effects.catalogue import definitions
        >>> definitions("gravity_windup")[0].weights(["J3", "J4"])
        ('k_J3', 'k_J4', 'k2_J3')
        """
        if not self.later_joints or not later:
            return ()
        return (*(f"k_{name}" for name in later), f"k2_{later[0]}")

    def for_measurand(self, measurand: Measurand) -> EffectDefinition:
        """Return the definition for what is measured.

        Where it is directions, a frame shift has no translation, and a target has two freedoms; of poses it has six.
        Of heights a frame shift has three freedoms.
        """
        if (
            self.component == "frame_shift"
            and measurand.moving
            and len(measurand.rigid) < len(self.parameters)
        ):
            return replace(self, parameters={x: self.parameters[x] for x in measurand.rigid})
        if measurand.moving:
            return self.poses if measurand.has_attitude and self.poses else self
        if measurand.has_attitude and self.poses and self.poses.slope:
            turned = {
                name: unit for name, unit in self.poses.parameters.items() if name not in self.parameters
            }
            return replace(self, formula=self.poses.slope, parameters=turned, directions=None)
        if measurand.has_zero and self.component in {"target", "remounting"}:
            units = dict.fromkeys(measurand.freedoms, "arcsec")
            return replace(self, formula=self.formula, parameters=units, directions=None)
        return self.directions or self

    @property
    def equation(self) -> str:
        """The equation of the effect, in one line.

        Examples
        --------
        >>> from rodgen.machines.effects.catalogue import definitions
        >>> definitions("encoder_eccentricity")[0].equation
        'reading += a*cos(q) + b*sin(q)'
        """
        formula = f"{self.formula.text} + k_NAME*M_NAME + …" if self.later_joints else self.formula.text
        slope = self.slope.text if self.slope is not None else ""
        template = COMPONENTS[self.component]
        if self.component in _TURNED and "{length}" not in self.parameters.values():
            template = _TURNED[self.component]
        elif slope and "{slope}" not in template:
            template += " and turned by the rotation vector {slope}"
        if self.component == "reading" and re.fullmatch(r"-[^ ]+", formula):
            template, formula = "reading -= {formula}", formula[1:]
        if self.component == "lift" and formula.startswith("-"):
            template, formula = "direction lowered towards g by {formula}", formula[1:]
        more = [
            COMPONENTS[component].format(formula=formula_there.text)
            for component, formula_there in self.others
        ]
        return "; ".join([template.format(formula=formula, slope=slope), *more])

    def units(self, length: str = "length", measurand: Measurand = POINT) -> dict[str, str]:
        """Return the unit of each parameter.

        Parameters
        ----------
        length : str
            The machine file's unit of length; left out, the word itself.
        measurand : Measurand
            What is measured.

        Examples
        --------
        >>> from rodgen.machines.effects.catalogue import definitions
        >>> from rodgen.machines.measured import DIRECTION
        >>> definitions("load_windup")[0].units("mm")
        {'k': 'arcsec/N/mm'}
        >>> definitions("load_windup")[0].units(measurand=DIRECTION)
        {'k': 'arcsec/N'}
        """
        words = {"{length}": length, "{arm}": measurand.arm(length), "{move}": measurand.unit(length)}
        units = dict(self.parameters)
        for placeholder, word in words.items():
            units = {name: unit.replace(placeholder, word) for name, unit in units.items()}
        return {name: unit.removesuffix("/1") for name, unit in units.items()}

    def listed(self, measurand: Measurand = POINT) -> str:
        """Return the parameters with their units in one line.

        Examples
        --------
        >>> from rodgen.machines.effects.catalogue import definitions
        >>> definitions("warm_up_drift")[0].listed()
        'x, y, z [length]; tau [s]'
        """
        units = self.units(measurand=measurand)
        groups = itertools.groupby(units, key=lambda name: units[name])
        return "; ".join(f"{', '.join(names)} [{unit}]" for unit, names in groups)

    def describe(self) -> str:
        """Return the whole description as lines of plain text.

        Examples
        --------
        >>> from rodgen.machines.effects.catalogue import definitions
        >>> print(definitions("zero_offset", "revolute")[0].describe().partition("Meaning")[0].rstrip())
        zero_offset   at a revolute joint   ISO 230: EC0C
          reading += a
          Parameters   a [arcsec]
          TPOINT       IA = -a at the azimuth axis; IE = a at the elevation axis; IH = a at the polar axis;
                       ID = a at the declination axis
        """
        places = " or ".join(text for place, text in _PLACES.items() if place in self.at)
        head = f"{self.name}   {places}" + (f"   ISO 230: {self.iso}" if self.iso else "")
        lines = [head, *_wrapped(self.equation, ""), *_wrapped(self.listed(), "Parameters")]
        if self.tpoint:
            lines += _wrapped("; ".join(f"{term} = {what}" for term, what in self.tpoint.items()), "TPOINT")
        if self.later_joints:
            lines += _wrapped(
                "and one k_NAME [arcsec/length] for each joint beyond, and k2_NAME for the next one, where the data "
                "call for it",
                " ",
            )
        if self.searched:
            lines += _wrapped(f"{', '.join(self.searched)} is searched for, unless it is given", " ")
        turned = self.for_measurand(DIRECTION)
        if turned.listed(DIRECTION) != self.listed():
            lines += _wrapped(turned.listed(DIRECTION), "Directions")
        if turned.equation != self.equation:
            lines += _wrapped(turned.equation, " ")
        return "\n".join([*lines, *self.paragraphs("Meaning", "Usual size", "Remedy", "Source")])

    def paragraphs(self, *titles: str) -> list[str]:
        """Return the lines of some of ``Meaning``, ``Usual size``, ``Remedy`` and ``Source``."""
        texts = {
            "Meaning": self.meaning,
            "Usual size": self.usual_size,
            "Remedy": self.remedy,
            "Source": self.source,
        }
        return [line for title in titles for line in _wrapped(texts[title], title)]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain data for JSON; in units, the unit of length is the word ``length``."""
        return {
            "name": self.name,
            "at": sorted(self.at),
            **plain(self, "component formula=formula.text slope=slope.text equation"),
            "parameters": self.units(),
            "parameters_of_directions": self.for_measurand(DIRECTION).units(measurand=DIRECTION),
            **plain(self, "later_joints of_drive"),
            "searched": list(self.searched),
            "iso": self.iso or None,
            "tpoint": dict(self.tpoint),
            **plain(self, "meaning usual_size remedy source"),
        }

    def with_directions(self, formula: str, parameters: Mapping[str, str]) -> EffectDefinition:
        """Return the definition with another formula where directions are measured."""
        turned = Formula.parse(formula, file="catalogue", place=self.name)
        return replace(self, directions=replace(self, formula=turned, parameters=parameters, slope=None))

    def with_poses(self, slope: str, parameters: Mapping[str, str]) -> EffectDefinition:
        """Return the definition with a rotation vector, and its parameters, where poses are measured."""
        parameters = {**self.parameters, **parameters}
        turn = Formula.parse(slope, file="catalogue", place=self.name)
        return replace(self, poses=replace(self, slope=turn, parameters=parameters, directions=None))


def component_dimension(component: str, at: str, measurand: Measurand = POINT) -> Dimension:
    """Return the dimension that an effect's formula has.

    Parameters
    ----------
    component : str
        One of :data:`COMPONENTS`.
    at : str
        The type of joint, ``"machine"`` or ``"target"``.
    measurand : Measurand
        What is measured: where it is directions, a frame moves by turning.

    Examples
    --------
    >>> print(component_dimension("reading", "prismatic"))
    length
    """
    if component == "reading":
        return coordinate_dimension(at)
    if component in {"frame", "frame_shift", "target", "remounting"}:
        return measurand.dimension
    if component == "factor":
        return ONE
    return ANGLE if component in {"rotation", "axis", "lift", "heading", "rx", "ry", "rz"} else LENGTH


def _wrapped(text: str, title: str) -> list[str]:
    indent = "  " + (f"{title:<13}" if title else "")
    further = " " * len(indent) if title else "    "
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=further,
        break_long_words=False,
        break_on_hyphens=False,
    )
