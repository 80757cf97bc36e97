"""A fitted printer of three towers as the numbers that its firmware takes: Klipper, Marlin and RepRapFirmware.

Firmware knows three towers on one circle, with an angle and rods of their own, and an endstop each. Any three towers
are on one circle; its middle is where x = y = 0 will be. An endstop is entered by the height of the nozzle over the
plate at which its carriage is there, were the other two as high.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.errors import InputFileError, joined, shown
from rodgen.machines.emit._content import title_of
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.families.delta import LinearDelta

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

_TAKEN = ("zero_offset", "delta_radius", "delta_angle", "rod_length")
"""Effects at a tower that firmware has a number for."""


class Numbers(NamedTuple):
    """What firmware takes; lengths in the unit of the machine file."""

    radius: float
    rods: Array
    angles: Array
    """Degrees, as `LinearDelta.legs`."""
    endstops: Array
    """By how much higher the nozzle is, at each endstop, than the firmware believes now."""
    middle: Array
    """Where x = y = 0 will be, in coordinates of now."""
    nozzle: float
    """By how much higher the nozzle is than in the file, which is part of the endstops."""


def printer_text(machine: Machine, note: str) -> str:
    """Return the numbers as lines to enter, for each firmware.

    Raises
    ------
    InputFileError
        When the machine is no printer of three towers, or a parameter has no value.
    """
    return "\n".join(_lines(machine, numbers_of(machine), note)) + "\n"


def numbers_of(machine: Machine) -> Numbers:
    """Return the numbers of a fitted machine.

    Raises
    ------
    InputFileError
        As of :func:`printer_text`.
    """
    kinematics = machine.kinematics
    if not isinstance(kinematics, LinearDelta):
        found = f"a {kinematics.words.partition(':')[0]}"
        raise InputFileError(
            machine.file or machine.name, "family", found, "a linear-delta, a printer of three towers"
        )
    model = scope_of(machine).model
    theta = model.start()
    values = {p.key: x for p, x in zip(model.parameters, theta, strict=True)}
    of = {
        name: np.array([sum(_of(values, f"{tower}.{name}.{x}") for x in "ra") for tower in kinematics.legs])
        for name in _TAKEN
    }
    (R,), (L,) = model.number(theta, "R"), model.number(theta, "L")
    at = np.radians(list(kinematics.legs.values())) + of["delta_angle"]
    feet = (R + of["delta_radius"])[:, None] * np.stack([np.cos(at), np.sin(at)], axis=1)
    # |p - m|² is the same for all three
    middle = np.linalg.solve(2 * (feet[1:] - feet[0]), np.sum(feet[1:] ** 2 - feet[0] ** 2, axis=1))
    radius = float(np.linalg.norm(feet[0] - middle))
    rods = L + of["rod_length"]
    angles = np.degrees(np.arctan2(*(feet - middle).T[::-1]))
    nominal = np.array(list(kinematics.legs.values()), float)
    angles = nominal + (angles - nominal + 180) % 360 - 180
    before = np.sqrt(kinematics.L**2 - kinematics.R**2)
    nozzle = float(model.target(theta, 0)[2] - machine.targets[0].point[2])
    endstops = (
        of["zero_offset"]
        + _of(values, "common_zero_offset.a")
        + before
        - np.sqrt(rods**2 - radius**2)
        + nozzle
    )
    angles, endstops, middle = (x.round(4) + 0.0 for x in (angles, endstops, middle))  # no -0.0000
    return Numbers(radius, rods, angles, endstops, middle, nozzle)


def _of(values: Mapping[str, float], key: str) -> float:
    return float(values.get(key, 0.0))


def _lines(machine: Machine, numbers: Numbers, note: str) -> Iterator[str]:
    unit = machine.length_unit
    radius, rods, angles, endstops, middle, nozzle = numbers
    trims = angles - list(machine.kinematics.legs.values())
    mean, least = float(endstops.mean()), float(endstops.min())
    taken = {*_TAKEN, "target_offset", "common_zero_offset"}
    others = [e.title for e in machine.effects if e.name not in taken]
    yield f"# {title_of(machine)}. {note}"
    yield f"# Lengths in {unit}, angles in degrees. 'Now' is what the firmware had when the readings were taken."
    yield f"# Afterwards x = y = 0 is where x = {middle[0]:.4f}, y = {middle[1]:.4f} is now."
    if abs(nozzle) >= 5e-5:
        yield f"# Endstops take up that the nozzle is {nozzle:+.4f} higher; of a probe that may be its z offset."
    if others:
        yield f"# Not in it, as firmware has no number for it: {joined(map(shown, others))}."
    yield ""
    yield "# Klipper, printer.cfg: add to each position_endstop what is said, then enter these"
    yield "[printer]"
    yield f"delta_radius: {radius:.4f}"
    for name, rod, angle, endstop in zip("abc", rods, angles, endstops, strict=True):
        yield f"[stepper_{name}]"
        yield f"arm_length: {rod:.4f}"
        yield f"angle: {angle:.4f}"
        yield f"# position_endstop: {endstop:+.4f} to what it is now"
    yield ""
    yield "# Marlin: M666 of now has no positive number; keep it so"
    rod = float(rods[0])
    angles_of_towers = "".join(f" {x}{trim:.4f}" for x, trim in zip("XYZ", trims, strict=True))
    words = "".join(f" {x}{one - rod:.4f}" for x, one in zip("ABC", rods, strict=True))
    yield f"M665 L{rod:.4f} R{radius:.4f}{angles_of_towers}{words}"
    yield f"; M665 H: {least:+.4f} to what it is now"
    changes = ", ".join(f"{x} {least - one:+.4f}" for x, one in zip("XYZ", endstops, strict=True))
    yield f"; M666: {changes} to what they are now"
    yield "M500"
    yield ""
    yield "# RepRapFirmware, config.g"
    yield f"M665 L{':'.join(f'{one:.4f}' for one in rods)} R{radius:.4f}{angles_of_towers}"
    yield f"; M665 H: {mean:+.4f} to what it is now"
    changes = ", ".join(f"{x} {one - mean:+.4f}" for x, one in zip("XYZ", endstops, strict=True))
    yield f"; M666: {changes} to what they are now"
