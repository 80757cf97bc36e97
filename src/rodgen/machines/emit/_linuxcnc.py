"""A fitted machine as a kinematics component of LinuxCNC: poses are commands, joints what brings the machine there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rodgen.codegen.source_text import in_comment
from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError
from rodgen.machines.emit._content import content_of, title_of
from rodgen.machines.emit._render import DO_NOT_EDIT, ENVIRONMENT, model_words, render

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

_LONGEST = 23
"""Of a name, with kins: HAL tells names apart by their first 31 characters, HAL_ before them."""
_FIELDS = {x: f"tran.{x.lower()}" for x in "XYZ"} | {x: x.lower() for x in "ABCUVW"}
"""Of a pose, by the axis, in the order in which LinuxCNC lists axes and numbers their joints."""


def component_texts(machine: Machine, name: str, travel: Any) -> dict[str, str]:
    """Return the component, with the emitted C in it.

    Raises
    ------
    InputFileError
        When the machine is on legs, points in directions, or has joints that are no axes of LinuxCNC.
    """
    content = content_of(machine, name, travel)
    file = machine.file or machine.name
    if not machine.measurand.moving or machine.kinematics.is_closed:
        raise InputFileError(file, "file", "no chain that moves a point", "axes that bring a tool to a place")
    if follower := next((joint for joint in machine.joints if not joint.is_read), None):
        found = f"{follower.coordinate}, which no motor moves by itself"
        raise InputFileError(file, f"joint {follower.name}, coordinate", found, "joints with motors alone")
    letters = _letters(machine, file)
    order = sorted(range(len(letters)), key=lambda j: [*_FIELDS].index(letters[j]))
    linear = "inch" if parse_unit(machine.length_unit).factor("inch") == 1 else "mm"
    factors = [
        math.radians(1.0) if joint.revolute else parse_unit(linear).factor(machine.length_unit)
        for joint in machine.joints
    ]
    component = f"{name[:_LONGEST].rstrip('_')}kins"
    files = render(content, "c")
    # without their heads: they are one file here, and the description says what is in it
    header, source = (files[f"{name}.{ending}"].partition("*/\n")[2] for ending in "hc")
    text = ENVIRONMENT.get_template("kinematics.comp.j2").render(
        component=component,
        title=title_of(machine),
        do_not_edit=DO_NOT_EDIT,
        order=", ".join(machine.joints[j].name for j in order),
        letters="".join(letters[j] for j in order),
        target=0,
        target_name=machine.targets[0].name,
        linear=linear,
        joints=machine.joints,
        words=[in_comment(word).replace('"', "'") for word in (*content.at_rest, *model_words(content))],
        header=header,
        source=source.replace(f'#include "{name}.h"\n', ""),
        name=name,
        numbers=content.numbers,
        NAME=name.upper(),
        axes=[{"field": _FIELDS[letters[j]], "factor": repr(factors[j]), "q": j} for j in order],
    )
    return {f"{component}.comp": text}


def _letters(machine: Machine, file: str) -> list[str]:
    """Return the axis of LinuxCNC that each joint is, by the first letter of its name."""
    letters = [joint.name[:1].upper() for joint in machine.joints]
    for joint, letter in zip(machine.joints, letters, strict=True):
        usual = "ABC" if joint.revolute else "XYZUVW"
        if letter not in usual or letters.count(letter) > 1:
            expected = f"a name that begins with a letter of its own, one of {usual}"
            raise InputFileError(file, f"joint {joint.name}", "no axis of LinuxCNC", expected)
    return letters
