"""Delta printers: the printer.cfg of Klipper as a machine, and logs of probe heights as readings of it.

A probe log says where, x and y, and at which z of the firmware the nozzle or the probe touched the plate. With the
firmware's own dimensions that is the height of each carriage, and there the nozzle really was on the plate. Read are

- what Klipper saves after DELTA_CALIBRATE at the end of printer.cfg: heights and their positions;
- Klipper's ``probe at 10.000,20.000 is z=0.123456``;
- Marlin's ``Bed X: 10.00 Y: 20.00 Z: 0.12`` of G30;
- RepRapFirmware's ``heightmap.csv`` of G29.

Klipper's printers with arms (``rotary_delta``) are read, too: x of the machine points to the first arm, as they know no
other direction, and what a log says is turned into these axes.
"""

from __future__ import annotations

import configparser
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.errors import InputFileError, shown
from rodgen.files import decoded, read_input
from rodgen.kinematics import delta
from rodgen.machines.families.delta import LinearDelta, RotaryDelta
from rodgen.machines.imports.imported import Imported
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.rigid import rotation_matrix

_SAVED = "#*#"
"""What the lines begin with that Klipper writes itself."""
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_LINES = (
    re.compile(rf"probe(?:: )?(?: at)? {_NUMBER},\s*{_NUMBER} (?:is|bed will contact at) z=\s*{_NUMBER}"),
    re.compile(rf"Bed X:\s*{_NUMBER}\s+Y:\s*{_NUMBER}\s+Z:\s*{_NUMBER}", re.IGNORECASE),
)
"""How Klipper and Marlin say x, y and z of a touch."""
_MAP = "RepRapFirmware height map file"
_HEAD = (
    ("xmin", "min0"),
    ("ymin", "min1"),
    ("xspacing", "spacing0", "spacing"),
    ("yspacing", "spacing1", "spacing"),
)
"""What a height map calls its first place and its steps, in versions of its format."""
_STEPS_A_TURN = 200.0
_EXPECTED = "the printer.cfg of a delta printer, as Klipper reads it"


class Touch(NamedTuple):
    """The nozzle on the plate, as firmware says it."""

    line: int
    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Firmware:
    """Dimensions that firmware has, by tower A, B, C; lengths in mm."""

    geometry: delta.LinearGeometry
    endstops: Array
    """Height of each carriage at its endstop."""
    steps: Array
    """Length of a step."""


def is_printer(start: bytes) -> bool:
    """Return whether a file begins as the printer.cfg of a delta printer does."""
    text = start.decode("utf-8", "replace")
    return bool(re.search(r"^kinematics\s*[:=]\s*(?:rotary_)?delta\s*(?:[#;].*)?$", text, re.MULTILINE))


def is_probe_log(start: bytes) -> bool:
    """Return whether a file begins as a log of probe heights does."""
    text = start.decode("utf-8", "replace")
    return text.startswith(_MAP) or any(line.search(text) for line in _LINES)


def machine_from_klipper(file: str | os.PathLike[str]) -> Imported:
    """Return the machine of a printer.cfg, with the heights that DELTA_CALIBRATE saved in it, if it has any.

    Raises
    ------
    InputFileError
        When a number is missing, or is none.
    """
    name = os.fspath(file)
    config = _read(name)
    if config.get("printer", {}).get("kinematics") == "rotary_delta":
        machine = _of_arms(name, config)[0]
        note = f"{name}: the rotary delta of Klipper, in mm; x points to arm A1, and z = 0 is the plate."
        return Imported(machine, (note, *_notes(machine)))
    firmware = _firmware(name, config)
    machine = _machine(firmware, name)
    heights = list(_saved_heights(name, config, firmware))
    notes = [
        f"{name}: the delta printer of Klipper, delta_radius and arm_length as R and L, in mm.",
        *_notes(machine),
    ]
    if not heights:
        return Imported(machine, tuple(notes))
    notes.append(
        f"{len(heights)} heights that DELTA_CALIBRATE saved are readings; distances that it saved are not."
    )
    found = np.array(heights)
    columns = {f"{tower} [mm]": found[:, k].round(6) for k, tower in enumerate(machine.kinematics.legs)}
    return Imported(machine, tuple(notes), columns | {"d [mm]": found[:, 3]}, name)


def with_probe_log(imported: Imported, file: str | os.PathLike[str], printer: str | None = None) -> Imported:
    """Return a machine with the readings of a probe log.

    Parameters
    ----------
    imported : Imported
        A linear delta whose heights are measured.
    file : str or os.PathLike
    printer : str, optional
        The printer.cfg with which the log was made, where the machine is from it.

    Raises
    ------
    InputFileError
        When the machine is none, the log has no touch, or one is out of reach.
    """
    name, machine = os.fspath(file), imported.machine
    kinematics, unit = machine.kinematics, machine.length_unit
    if not isinstance(kinematics, LinearDelta | RotaryDelta) or machine.measured.kind != "height":
        found = "a probe log, but the machine is no delta whose kind of reading is 'height'"
        raise InputFileError(name, "file", found, "the machine file that 'rodgen new linear-delta' makes")
    touches = list(_touches(name))
    if not touches:
        raise InputFileError(name, "file", "no touch of a probe", "lines such as 'probe at 10,20 is z=0.12'")
    places = np.array([touch[1:] for touch in touches])
    if isinstance(kinematics, RotaryDelta):
        arms, turn = delta.RotaryGeometry(kinematics.R, kinematics.A, kinematics.L), 0.0
        if printer is not None:
            _, arms, turn = _of_arms(printer, _read(printer))
        places = places @ rotation_matrix([0.0, 0.0, turn]) - machine.targets[0].point
        carriages, status = delta.rotary_inverse(places, arms)
        carriages, of = np.degrees(carriages), "deg"
    else:
        geometry, of = delta.LinearGeometry(kinematics.R, kinematics.L), unit
        if printer is not None:
            geometry = _firmware(printer, _read(printer)).geometry
        carriages, status = delta.linear_inverse(places, geometry)
    if np.any(status):
        touch = touches[int(np.argmax(status != 0))]
        found = f"x = {touch.x:g}, y = {touch.y:g}, which the rods do not reach"
        raise InputFileError(name, f"line {touch.line}", found, f"places within R = {kinematics.R:g} {unit}")
    columns: dict[str, Any] = {
        f"{tower} [{of}]": carriages[:, k].round(6) for k, tower in enumerate(kinematics.legs)
    }
    columns[f"d [{unit}]"] = np.zeros(len(touches))
    note = (
        f"{name}: {len(touches)} touches, x, y, z in {unit}; there the nozzle is taken to be on the plate, d = 0. "
        "The offset of a probe is common to all rows, as one of all endstops is."
    )
    lines = [f"line {touch.line}" for touch in touches]
    notes = (
        imported.notes[:-1] if imported.columns else imported.notes
    )  # the last one is of heights in printer.cfg
    return replace(imported, notes=(*notes, note), columns=columns, source=name, places=lines)


# Klipper's file ------------------------------------------------------------------------------------------------------


def _read(name: str) -> Mapping[str, Mapping[str, str]]:
    """Return the sections of a printer.cfg; what Klipper saved overrides what is above."""
    lines = decoded(read_input(name, _EXPECTED), name).splitlines()
    saved = [line.removeprefix(_SAVED).removeprefix(" ") for line in lines if line.startswith(_SAVED)]
    mark = next((k for k, line in enumerate(saved) if line.startswith("[")), len(saved))
    lines_of_file = [line for line in lines if not line.startswith(_SAVED)]
    parser = configparser.RawConfigParser(
        strict=False, delimiters=(":", "="), inline_comment_prefixes=("#", ";"), interpolation=None
    )
    try:
        parser.read_string("\n".join(lines_of_file), name)
        parser.read_string("\n".join(saved[mark:]), name)
    except configparser.Error as error:
        raise InputFileError(name, "file", str(error).splitlines()[0], _EXPECTED) from None
    return {section: dict(parser.items(section)) for section in parser.sections()}


def _number(
    name: str,
    config: Mapping[str, Mapping[str, str]],
    section: str,
    key: str,
    default: float | None = None,
) -> float:
    text = config.get(section, {}).get(key)
    if text is None and default is not None:
        return default
    found = "missing" if text is None else shown(text)
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputFileError(name, f"[{section}], {key}", found, "a number")
    return value


def _of_arms(
    name: str, config: Mapping[str, Mapping[str, str]]
) -> tuple[Machine, delta.RotaryGeometry, float]:
    """Return a printer with arms, its geometry in the machine's axes, and by how much these are turned, rad."""
    number = partial(_number, name, config)
    radius, height = number("printer", "shoulder_radius"), number("printer", "shoulder_height")
    arms, rods, angles = list[float](), list[float](), list[float]()
    for letter, usual in zip("abc", (30.0, 150.0, 270.0), strict=True):
        section = f"stepper_{letter}"
        arms.append(number(section, "upper_arm_length", arms[0] if arms else None))
        rods.append(number(section, "lower_arm_length", rods[0] if rods else None))
        angles.append(number(section, "angle", usual))
    heading = (0.0, angles[1] - angles[0], angles[2] - angles[0])
    kinematics = RotaryDelta(radius, rods[0], arms[0])
    if not (min(radius, *arms) > 0 and kinematics.fault is None):
        found = f"shoulder_radius {radius:g}, upper_arm_length {arms[0]:g}, lower_arm_length {rods[0]:g}"
        raise InputFileError(name, "[printer]", found, "positive numbers, with which rods reach the middle")
    machine = replace(_printer(kinematics), targets=(Target("nozzle", (0.0, 0.0, height)),))
    for leg, (arm, rod, at) in zip(kinematics.legs, zip(arms, rods, heading, strict=True), strict=True):
        for effect, off in (("arm_length", arm - arms[0]), ("rod_length", rod - rods[0])):
            if off:
                machine = machine.with_effect(machine.effect(effect, leg, hold={"a": off}))
        if math.remainder(at - kinematics.legs[leg], 360):
            machine = machine.with_effect(machine.effect("delta_angle", leg))
    geometry = delta.RotaryGeometry(radius, (arms[0], arms[1], arms[2]), (rods[0], rods[1], rods[2]), heading)
    return machine, geometry, math.radians(angles[0])


def _firmware(name: str, config: Mapping[str, Mapping[str, str]]) -> Firmware:
    number = partial(_number, name, config)
    radius = number("printer", "delta_radius")
    rods: list[float] = []
    angles: list[float] = []
    endstops: list[float] = []
    steps: list[float] = []
    for tower, angle in zip("abc", delta.OF_PRINTERS, strict=True):
        section = f"stepper_{tower}"
        rods.append(number(section, "arm_length", rods[0] if rods else None))
        angles.append(number(section, "angle", angle))
        endstops.append(number(section, "position_endstop", endstops[0] if endstops else None))
        whole = number(section, "full_steps_per_rotation", _STEPS_A_TURN) * number(section, "microsteps", 1)
        ratio = _ratio(name, section, config.get(section, {}).get("gear_ratio", ""))
        usual = number(section, "rotation_distance", steps[0] * whole * ratio if steps else math.nan)
        steps.append(number(section, "step_distance", usual / (whole * ratio)))
    if not (radius > 0 and min(rods) > radius):
        found = f"arm_length {min(rods):g} and delta_radius {radius:g}"
        raise InputFileError(
            name, "[printer]", found, "rods that are longer than the radius, which is positive"
        )
    geometry = delta.LinearGeometry(radius, (rods[0], rods[1], rods[2]), (angles[0], angles[1], angles[2]))
    heights = np.array(endstops) + np.sqrt(np.array(rods) ** 2 - radius**2)
    return Firmware(geometry, heights, np.array(steps))


def _ratio(name: str, section: str, text: str) -> float:
    """Return a gear ratio such as ``"57:11, 2:1"``."""
    try:
        pairs = [[float(x) for x in part.split(":")] for part in text.split(",") if part.strip()]
        return math.prod(teeth / others for teeth, others in pairs)
    except (ValueError, ZeroDivisionError):
        raise InputFileError(name, f"[{section}], gear_ratio", shown(text), "80:16, say") from None


def _saved_heights(
    name: str, config: Mapping[str, Mapping[str, str]], firmware: Firmware
) -> Iterator[tuple[float, float, float, float]]:
    """Yield carriages and height of each point; positions are in steps down from the endstops."""
    section = config.get("delta_calibrate", {})
    for key in filter(re.compile(r"(?:manual_)?height\d+").fullmatch, section):
        if not np.isfinite(firmware.steps).all():
            raise InputFileError(name, "[stepper_a], rotation_distance", "missing", "a number")
        try:
            (height,), steps = (_numbers(section.get(k, "")) for k in (key, f"{key}_pos"))
            a, b, c = firmware.endstops - np.array(steps) * firmware.steps
        except ValueError:
            found = f"{shown(section[key])} with {shown(section.get(f'{key}_pos', ''))}"
            raise InputFileError(
                name, f"[delta_calibrate], {key}", found, "a height, and three positions"
            ) from None
        yield float(a), float(b), float(c), height


def _numbers(text: str) -> Sequence[float]:
    return [float(part) for part in text.split(",")]


def _machine(firmware: Firmware, name: str) -> Machine:
    """Return the machine, with effects for what its towers have of their own."""
    geometry = firmware.geometry
    (radius, *_), rods, _ = geometry.numbers
    legs = LinearDelta.legs
    machine = _printer(LinearDelta(float(radius), float(rods[0])))
    for (tower, usual), angle, rod in zip(legs.items(), geometry.heading, rods, strict=True):
        if rod != rods[0]:
            machine = machine.with_effect(
                machine.effect("rod_length", tower, hold={"a": float(rod - rods[0])})
            )
        if angle != usual:
            machine = machine.with_effect(machine.effect("delta_angle", tower))
    return machine


def _printer(kinematics: LinearDelta | RotaryDelta) -> Machine:
    return Machine(
        "Delta printer",
        "mm",
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        tuple(Joint(leg, kinematics.leg) for leg in kinematics.legs),
        (Target("nozzle", (0.0, 0.0, 0.0)),),
        Measured("height", "machine"),
        ("R",),
        kinematics=kinematics,
    )


def _notes(machine: Machine) -> Iterator[str]:
    for effect in machine.effects:
        if effect.name == "delta_angle":
            yield f"The angle of {effect.place} is not the usual one: a fit estimates it, from the usual one."
        else:
            part = "arm" if effect.name == "arm_length" else "rods"
            yield f"{effect.place}: the length of its {part} is its own, which is held."


# logs -------------------------------------------------------------------------------------------------------------


def _touches(name: str) -> Iterator[Touch]:
    text = decoded(read_input(name, "a log of probe heights"), name).removeprefix("\ufeff")
    if text.startswith(_MAP):
        yield from _of_map(name, text.splitlines())
        return
    for number, line in enumerate(text.splitlines(), 1):
        for pattern in _LINES:
            if touch := pattern.search(line):
                x, y, z = map(float, touch.groups())
                yield Touch(number, x, y, z)


def _of_map(name: str, lines: Sequence[str]) -> Iterator[Touch]:
    """Yield the points of a height map: 0 without decimals is a place that was not probed."""
    try:
        keys = [key.strip() for key in lines[1].split(",")]
        of = dict(zip(keys, lines[2].split(","), strict=True))
        x, y, dx, dy = (float(next(of[key] for key in some if key in of)) for some in _HEAD)
        for row, line in enumerate(lines[3:]):
            for column, cell in enumerate(line.split(",") if line.strip() else ()):
                if cell.strip() != "0":
                    yield Touch(row + 4, x + column * dx, y + row * dy, float(cell))
    except (IndexError, ValueError, StopIteration):
        expected = "its three lines of head, and rows of numbers"
        raise InputFileError(name, "file", "a height map that cannot be read", expected) from None
