"""The geometry of a fitted machine as a Denavit-Hartenberg table, which `rodgen import` reads again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rodgen.kinematics.spatial.robots.denavit_hartenberg import (
    to_denavit_hartenberg,
    to_modified_denavit_hartenberg,
)
from rodgen.machines.emit._geometry import of_couplings
from rodgen.machines.emit._numbers import K, said_of_uncertainties, standard, uncertain_number
from rodgen.machines.files.write import toml_string
from rodgen.machines.mechanism import to_mechanism

if TYPE_CHECKING:
    from rodgen.machines.emit._geometry import Geometry

_CONVENTIONS = {
    "standard": (to_denavit_hartenberg, "Rz(theta) Tz(d) Tx(a) Rx(alpha)"),
    "modified": (to_modified_denavit_hartenberg, "Tx(a) Rx(alpha) Tz(d) Rz(theta)"),
}


PARALLEL = 1e-9, math.sin(math.radians(1.0))
"""Sine of the angle between axes whose common normal is badly determined: beyond it, by less than some 50 times."""
_ON_PARALLEL = (
    "nearly parallel axes: a large d here or in the next row stands for a small tilt; URDF has none such"
)


def table_texts(geometries: Sequence[Geometry], name: str, note: str) -> dict[str, str]:
    """Return a TOML file for each convention, by its name, of the first of the geometries of varied machines."""
    return {
        f"{name}_{convention}_dh.toml": _text(geometries, convention, note) for convention in _CONVENTIONS
    }


def _text(geometries: Sequence[Geometry], convention: str, note: str) -> str:
    geometry = geometries[0]
    machine = geometry.machine
    make, order = _CONVENTIONS[convention]
    # axes that a fit has found are parallel by no more than rounding
    tables = [make(to_mechanism(each.machine, tolerance=1e-12)) for each in geometries]
    table = tables[0]
    u = {
        "theta": K * standard([np.degrees(each.angle) for each in tables], 360.0),
        "d": K * standard([np.array(each.offset) for each in tables]),
        "a": K * standard([np.array(each.a) for each in tables]),
        "alpha": K * standard([np.degrees(each.alpha) for each in tables], 360.0),
    }
    coupled = of_couplings(machine, [joint.name for joint in machine.joints if joint.coordinate])
    lines = [f"# {note}", *(f"# not in it: {what}" for what in (*geometry.left_out, *coupled))]
    lines += [f"# {line}" for line in said_of_uncertainties(geometries)]
    lines += [
        f"# A row is {order}; the coordinate of a joint is added to its theta, or to its d where it slides.",
        f"# The frame before the first row, in machine axes ({machine.length_unit}), a row each of its matrix:",
        *(f"#   {' '.join(map(_number, row))}" for row in table.base),
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
        lines += ["", "[[joint]]", f"name = {toml_string(joint.name)}", f'type = "{table.joints[j]}"']
        row = {
            "theta": math.degrees(table.angle[j]),
            "d": table.offset[j],
            "a": table.a[j],
            "alpha": math.degrees(table.alpha[j]),
        }
        for key, value in row.items():
            said = uncertain_number(value, float(u[key][j]), machine.length_unit)[1]
            lines.append(f"{key} = {_number(value)}" + f"  # U = {said}" * bool(said))
        both = table.joints[j - 1 : j + 1] if convention == "modified" else table.joints[j : j + 2]
        if "".join(both) == "RR" and PARALLEL[0] < abs(math.sin(table.alpha[j])) < PARALLEL[1]:
            lines.append(f"# {_ON_PARALLEL}")
        if joint.travel:
            scale = math.degrees(1.0) if joint.revolute else 1.0
            lines.append(f"travel = {_listed([x * scale for x in joint.travel])}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


def _listed(values: object) -> str:
    return f"[{', '.join(_number(x) for x in values)}]"  # type: ignore[attr-defined]
