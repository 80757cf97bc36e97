"""Effects by the names of other systems: TPOINT's terms, such as TF, and the symbols of ISO 230, such as EBZ.

TPOINT's terms are in the rows of the catalogue. A symbol of ISO 230 is composed: E, the direction of an error (X Y Z
along, A B C about an axis of the machine), 0 for a location error, and the axis that has it. An axis named X, Y or Z
slides along machine axis x, y or z, one named A, B or C turns about it.

Terms of TPOINT that are no effect of the catalogue are effects of one's own, ready to paste into a machine file. Joints
go by TPOINT's letters: H, the hour angle, is joint HA, D is DEC, A is AZ and E is EL; who names them otherwise changes
the names. Harmonics are Hrfcn, a sine or cosine (f) of n times a coordinate (c) that is added to another (r), or in
older models rncf, such as X2HC; r may also be a shift on the sky, X across the hour circle and S across the vertical
one, which is a reading divided by a cosine, or Z, the zenith distance, which is a coordinate, too. Polynomials are
Prcn, the power n of a coordinate in rad, or the product of two, such as PDD2 and PXHD; not of azimuths, of which a
power depends on where they count from.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rodgen.machines.effects.catalogue import NAMES, TERMS, definitions
from rodgen.machines.effects.definition import EffectDefinition

_ISO = re.compile(r"E?(?P<error>[XYZABC])(?P<location>0?)(?P<axis>[XYZABC])")
_ALONG, _ABOUT = "XYZ", "ABC"


@dataclass(frozen=True)
class Symbol:
    """What a name of another system is in the catalogue."""

    name: str
    system: str
    """``"TPOINT"`` or ``"ISO 230"``."""
    definition: EffectDefinition
    relation: str
    """What it is of the effect's parameters, and where: ``"-a at the azimuth axis"``."""
    joint: str | None = None
    """The joint, where the name says it."""

    def __str__(self) -> str:
        return f"{self.name} of {self.system} is {self.relation} of {self.definition.name}."


def symbols(name: str) -> tuple[Symbol, ...]:
    """Return what a name of TPOINT or ISO 230 is in the catalogue; several where it names several effects, or none.

    Examples
    --------
    >>> [str(symbol) for name in ("TF", "EBZ") for symbol in symbols(name)]
    ['TF of TPOINT is a of tube_flexure.', 'EBZ of ISO 230 is y_1, y_2, y_3 at Z of angular_error_motion.']
    """
    if name in NAMES:
        return ()
    text = name.upper()
    if text in TERMS:
        return (Symbol(text, "TPOINT", TERMS[text], TERMS[text].tpoint[text]),)
    return tuple(_of_iso(text))


def _of_iso(text: str) -> Iterator[Symbol]:
    match = _ISO.fullmatch(text)
    if match is None or not (text.startswith("E") or match["location"]):
        return
    slides = match["axis"] in _ALONG
    axis = (_ALONG if slides else _ABOUT).index(match["axis"])
    along = match["error"] in _ALONG
    # 0 is the axis' own direction; 1 and 2 are those of u and v, which complete it
    direction = ((_ALONG if along else _ABOUT).index(match["error"]) - axis) % 3
    place = "prismatic" if slides else "revolute"
    parts = _location if match["location"] else _motion
    for effect, parameters in parts(slides, along, direction, match["error"]):
        (definition,) = definitions(effect, place)
        yield Symbol(text, "ISO 230", definition, f"{parameters} at {match['axis']}", match["axis"])


def _location(slides: bool, along: bool, direction: int, _: str) -> Iterator[tuple[str, str]]:
    """Yield the effects, each with its parameters, of a location error."""
    if direction == 0:
        if slides == along:
            yield "zero_offset", "a"
    elif not along:
        yield "squareness" if slides else "axis_tilt", "-ab"[direction]
    elif not slides:
        yield "axis_offset", "-ab"[direction]


def _motion(slides: bool, along: bool, direction: int, error: str) -> Iterator[tuple[str, str]]:
    """Yield the effects, each with its parameters, of an error motion."""
    harmonics = "c1, s1, c2, s2"
    if slides == along and direction == 0:
        yield "scale", "k (the linear part)"
        if not slides:
            yield "encoder_eccentricity", "a, b (once per turn)"
            yield "encoder_ellipticity", "a, b (twice per turn)"
        yield "periodic_drive_error", "a, b (the periodic part)"
        yield "backlash", "b (the reversal value)"
    elif slides and along:
        yield "straightness", ", ".join(f"{'-uv'[direction]}_{k}" for k in (2, 3, 4))
    elif slides:
        yield (
            "angular_error_motion",
            ", ".join(f"{_ALONG[_ABOUT.index(error)].lower()}_{k}" for k in (1, 2, 3)),
        )
    elif direction == 0:
        yield "axial_error_motion", harmonics
    else:
        name = "radial_error_motion" if along else "tilt_error_motion"
        yield name, ", ".join(f"{'-uv'[direction]}_{k}" for k in harmonics.split(", "))


# terms that the catalogue lacks ------------------------------------------------------------------------------------

Level: TypeAlias = tuple[Sequence[float], Sequence[float]]
EAST_AND_NORTH: Level = ((1, 0, 0), (0, 1, 0))
_JOINTS = {"H": "HA", "D": "DEC", "A": "AZ", "E": "EL", "X": "HA", "S": "AZ", "V": "AZ"}
_TIMES = {"X": "/cos(DEC)", "S": "/cos(EL)", "V": "*tan(EL)"}
_SHIFTED = {"X": "across on the sky", "S": "across on the sky", "V": "as by a lean of the elevation axis"}
_FUNCTIONS = {"S": "sin", "C": "cos"}
_HARMONIC = re.compile(r"H(?P<result>[HDXAESVZ])(?P<factors>(?:[SC][HDAEZ](?:[1-9]\d?)?){1,2})")
_OLD_HARMONIC = re.compile(r"(?P<result>[HDX])(?P<times>[1-9])(?P<of>[HD])(?P<function>[SC])")
_POLYNOMIAL = re.compile(r"P(?P<result>[HDXAESZ])(?P<factors>(?:[HDEZ][1-9]?){1,2})")


@dataclass(frozen=True)
class OwnTerm:
    """A term of TPOINT as an effect of one's own."""

    name: str
    meaning: str
    """What it stands for."""
    joint: str | None
    """Where; None for the whole machine."""
    formulas: tuple[tuple[str, str], ...]
    """Each component with its formula of the parameter a."""

    @property
    def block(self) -> str:
        """An ``[[effect]]`` for the machine file."""
        lines = ["[[effect]]", f'name = "{self.name.lower()}"']
        lines += [f'joint = "{self.joint}"'] if self.joint else []
        if len(self.formulas) > 1:
            lines += [f'{component} = "{formula}"' for component, formula in self.formulas]
        else:
            ((component, formula),) = self.formulas
            lines += [f'component = "{component}"', f'formula = "{formula}"']
        return "\n".join([*lines, 'parameters = { a = "arcsec" }', f'meaning = "{self.meaning}"'])

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain data; `effect` has the keys of its block."""
        return {"name": self.name, "meaning": self.meaning, "effect": tomllib.loads(self.block)["effect"][0]}

    def __str__(self) -> str:
        return (
            f"{self.name} of TPOINT is no effect of the catalogue. It is a of this effect of your own, for the\n"
            f"machine file, where HA, DEC, AZ and EL are the names of its joints"
            f"{'' if self.joint else ', x is east and y north'}:\n\n{self.block}"
        )


def _vertical(name: str, meaning: str, up: str, level: Level) -> OwnTerm:
    """Return a term that moves what is seen upwards: a rotation about u cos(azimuth) - v sin(azimuth)."""
    formulas = []
    for component, u, v in zip(("rx", "ry", "rz"), *level, strict=True):
        parts = [f"{size:+.17g}*{wave}" for size, wave in ((u, "cos(azimuth)"), (-v, "sin(azimuth)")) if size]
        if parts:
            sum_of = re.sub(r"(^|[-+])1\*", r"\1", "".join(parts)).removeprefix("+")
            formulas.append((component, f"{up}*({sum_of})"))
    return OwnTerm(name, meaning, None, tuple(formulas))


_OWN = {
    "DNP": OwnTerm(
        "DNP", "The axes are perpendicular to a degree that changes with the hour angle.", "HA",
        (("reading", "a*sin(q)*tan(DEC)"),),
    ),
}  # fmt: skip


def own_term(name: str, level: Level = EAST_AND_NORTH) -> OwnTerm | None:
    """Return a term of TPOINT as an effect of one's own; None where it is none that is known.

    Parameters
    ----------
    level : pair of vectors
        Those that complete the direction upwards, in machine axes; default: z is upwards.

    Examples
    --------
    >>> own_term("HDSH5").formulas, own_term("X2HC").formulas
    ((('reading', 'a*sin(5*HA)'),), (('reading', 'a*cos(2*q)/cos(DEC)'),))
    """
    text = name.upper()
    if text in TERMS:
        return None
    if text in _OWN:
        return _OWN[text]
    if text == "FLOP":
        meaning = "What is seen is displaced vertically, by the same amount everywhere."
        return _vertical(text, meaning, "a", level)
    if term := _HARMONIC.fullmatch(text) or _POLYNOMIAL.fullmatch(text):
        factors = re.findall(r"([SC]?)([HDAEZ])(\d*)", term["factors"])
    elif term := _OLD_HARMONIC.fullmatch(text):
        factors = [(term["function"], term["of"], term["times"])]
    else:
        return None
    result = term["result"]
    joint = _JOINTS.get(result)
    waves, negative = [], result in "ASVZ"
    for function, of, times in factors:
        coordinate = "z" if of == "Z" else "q" if _JOINTS[of] == joint else _JOINTS[of]
        once = times in ("", "1")
        if function:
            # of azimuth from south through east: pi less that of the joint
            negative ^= of == "A" and (function == "C") == bool(int(times or 1) % 2)
            waves.append(f"{_FUNCTIONS[function]}({'' if once else f'{times}*'}{coordinate})")
        else:
            waves.append(coordinate if once else f"{coordinate}**{times}")
    what = "A polynomial" if text.startswith("P") else "A harmonic"
    size = f"{'-' * negative}a*{'*'.join(waves)}"
    if joint is None:
        return _vertical(text, f"{what}, by which zenith distances grow.", size, level)
    meaning = f"{what}, by which readings are shifted {_SHIFTED.get(result, f'along {joint}')}."
    return OwnTerm(text, meaning, joint, (("reading", f"{size}{_TIMES.get(result, '')}"),))
