"""The geometry of a fitted machine as a Denavit-Hartenberg table, which `rodgen import` reads again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rodgen.kinematics.spatial.robots.denavit_hartenberg import (
    to_denavit_hartenberg,
    to_modified_denavit_hartenberg,
)
from rodgen.machines.files.write import toml_string
from rodgen.machines.mechanism import to_mechanism

if TYPE_CHECKING:
    from rodgen.machines.emit._geometry import Geometry

__all__ = ["table_texts"]

_CONVENTIONS = {
    "standard": (to_denavit_hartenberg, "Rz(theta) Tz(d) Tx(a) Rx(alpha)"),
    "modified": (to_modified_denavit_hartenberg, "Tx(a) Rx(alpha) Tz(d) Rz(theta)"),
}


def table_texts(geometry: Geometry, name: str, note: str) -> dict[str, str]:
    """Return a TOML file for each convention, by its name."""
    return {f"{name}_{convention}_dh.toml": _text(geometry, convention, note) for convention in _CONVENTIONS}


def _text(geometry: Geometry, convention: str, note: str) -> str:
    machine = geometry.machine
    make, order = _CONVENTIONS[convention]
    # axes that a fit has found are parallel by no more than rounding
    table = make(to_mechanism(machine, tolerance=1e-12))
    lines = [f"# {note}", *(f"# not in it: {what}" for what in geometry.left_out)]
    lines += [
        f"# A row is {order}; the coordinate of a joint is added to its theta, or to its d where it slides.",
        f"# The frame before the first row, in machine axes ({machine.length_unit}), a row each of its matrix:",
        *(f"#   {' '.join(f'{x:.12g}' for x in row)}" for row in table.base),
        f"name = {toml_string(machine.name)}",
        f'convention = "{convention}"',
        f'units = {{ length = {toml_string(machine.length_unit)}, angle = "deg" }}',
    ]
    place = float(machine.measurand.moving)  # a direction is turned, and not displaced
    tools = [(table.end @ [*target.point, place])[:3] for target in machine.targets]
    for target, tool in zip(machine.targets[1:], tools[1:], strict=True):
        lines.append(f"# {target.name} in the frame after the last row: {_listed(tool)}")
    lines.append(f"tool = {_listed(tools[0])}  # {machine.targets[0].name}, in the frame after the last row")
    for j, joint in enumerate(machine.joints):
        lines += [
            "",
            "[[joint]]",
            f"name = {toml_string(joint.name)}",
            f'type = "{table.joints[j]}"',
            f"theta = {_number(math.degrees(table.angle[j]))}",
            f"d = {_number(table.offset[j])}",
            f"a = {_number(table.a[j])}",
            f"alpha = {_number(math.degrees(table.alpha[j]))}",
        ]
        if joint.travel:
            scale = math.degrees(1.0) if joint.revolute else 1.0
            lines.append(f"travel = {_listed([x * scale for x in joint.travel])}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


def _listed(values: object) -> str:
    return f"[{', '.join(_number(x) for x in values)}]"  # type: ignore[attr-defined]
