"""Effects by the names of other systems: TPOINT's terms, such as TF, and the symbols of ISO 230, such as EBZ.

TPOINT's terms stand in the rows of the catalogue. A symbol of ISO 230 is composed: E, the direction of an error (X Y Z
along, A B C about an axis of the machine), 0 for a location error, and the axis that has it. An axis named X, Y or Z
slides along machine axis x, y or z, one named A, B or C turns about it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

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
    found = _ISO.fullmatch(text)
    if found is None or not (text.startswith("E") or found["location"]):
        return
    slides = found["axis"] in _ALONG
    axis = (_ALONG if slides else _ABOUT).index(found["axis"])
    along = found["error"] in _ALONG
    # 0 is the axis' own direction; 1 and 2 are those of u and v, which complete it
    direction = ((_ALONG if along else _ABOUT).index(found["error"]) - axis) % 3
    place = "prismatic" if slides else "revolute"
    parts = _location if found["location"] else _motion
    for effect, parameters in parts(slides, along, direction, found["error"]):
        (definition,) = definitions(effect, place)
        yield Symbol(text, "ISO 230", definition, f"{parameters} at {found['axis']}", found["axis"])


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
