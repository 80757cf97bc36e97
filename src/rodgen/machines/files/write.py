"""Write a `Machine` as the text of a machine file, and as a short summary."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rodgen.data.set_aside import SetAside
from rodgen.data.units import ANGLE, unit_factor
from rodgen.errors import joined
from rodgen.files import write_file
from rodgen.machines.files.schema import (
    Scaled,
    decimal,
    joint_keys,
    measured_keys,
    target_keys,
    toml_key,
    toml_string,
    written,
    written_keys,
)
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.known import unit_of
from rodgen.machines.machine import Machine
from rodgen.machines.parts import BRANCHES, ColumnSource, Effect, Joint, Known, StatedPlausibility

# the file ----------------------------------------------------------------------------------------------------------


def save_machine(machine: Machine, path: str | os.PathLike[str], *, fixed: bool = False) -> None:
    """Write a machine file.

    Parameters
    ----------
    path : str or os.PathLike
        Is replaced when the new file is complete.
    fixed : bool
        Write the fitted numbers too: axes, points and targets in place, the parameters of effects as ``hold``, and
        nothing to estimate. Where the free frame is, and the frame shift of each run, is not a property of
        the machine and has no place in its file: these are found again with the next measurements. Without `fixed`
        the fitted numbers are not written, and the file reads back as an equal machine.

    Raises
    ------
    InputFileError
        When it cannot be written; with `fixed`, also when an effect is measured over a travel that the
        machine does not give.
    """
    write_file(path, machine_text(fixed_machine(machine) if fixed else machine).encode())


def machine_text(machine: Machine) -> str:
    """Return a complete machine file, without fitted numbers; it reads back as an equal machine."""
    angle = machine.file_factor(ANGLE)
    own = measured_keys(machine.measurand, machine.length_unit, angle, branches=bool(machine.branches))
    tables: list[tuple[str, dict[str, Any]]] = [
        ("", {"name": machine.name, "family": machine.kinematics.family}),
        ("[units]", {"length": machine.length_unit, "angle": machine.angle_unit}),
        (
            "[environment]",
            {"gravity": machine.gravity, "reference_temperature": machine.reference_temperature},
        ),
        *_of_chain(machine),
    ]
    blocks = [_block(header, _entries(content)) for header, content in tables]
    if not machine.kinematics.is_closed:
        blocks += [
            _block("[[joint]]", written_keys(joint, joint_keys(machine.file_factor(joint.dimension))))
            for joint in machine.joints
        ]
    keys = target_keys(machine.measurand, angle)
    blocks += [_block("[[target]]", written_keys(target, keys)) for target in machine.targets]
    measured = list(written_keys(machine.measured, [key for key in own if key.name != "set_aside"]))
    if machine.measured.set_aside:
        measured.append(set_aside_text(machine.measured.set_aside))
    blocks.append(_block("[measured]", measured))
    more = {
        "[estimate]": _entries({"parameters": machine.estimate}),
        "[known]": [known_line(machine, key, known) for key, known in machine.known.items()],
        "[ties]": [f"{toml_string(key)} = {toml_string(tie.text)}" for key, tie in machine.ties.items()],
        "[plausibility]": [_plausible_line(*entry) for entry in machine.plausible.items()],
        "[columns]": _entries({name: _source(source) for name, source in machine.column_sources.items()}),
        "[record]": _entries(machine.record),
    }
    blocks += [_block(header, lines) for header, lines in more.items() if lines]
    blocks += [_effect_block(machine, effect) for effect in machine.effects]
    return "\n\n".join(blocks) + "\n"


def _block(header: str, lines: Iterable[str]) -> str:
    return "\n".join(filter(None, [header, *lines]))


def _entries(content: Mapping[str, Any]) -> list[str]:
    """Return the lines of a table, without what is empty."""
    return [
        f"{toml_key(name)} = {written(value)}" for name, value in content.items() if value not in ("", ())
    ]


def _of_chain(machine: Machine) -> list[tuple[str, dict[str, Any]]]:
    """Return the blocks of branches, or that of a closed chain's geometry."""
    kinematics = machine.kinematics
    if not kinematics.is_closed:
        return [
            ("[[branch]]", {"name": name, "joints": tuple(joint.name for joint in joints)})
            for name, joints in machine.branches.items()
        ]
    values = {name: kinematics.number(name) for name in kinematics.numbers}
    content: dict[str, Any] = {name: x if len(x) > 1 else x[0] for name, x in values.items()}
    content["home"] = kinematics.home or ()
    start = kinematics.start
    content["start"] = () if start is None else Scaled(start, machine.file_factor(ANGLE))
    return [("[geometry]", content)]


def _source(source: ColumnSource) -> dict[str, Any]:
    said: dict[str, Any] = {
        "from": source.name,
        "unit": source.unit,
        "sign": source.sign,
        "offset": source.offset,
    }
    usual = {"unit": "", "sign": 1.0, "offset": 0.0}
    return {key: value for key, value in said.items() if usual.get(key) != value}


def set_aside_text(entries: Sequence[SetAside]) -> str:
    """Return the key of ``[measured]`` on rows that are set aside, an entry a line."""
    lines = (f"    {written(entry.to_dict())}," for entry in entries)
    return "\n".join(["set_aside = [", *lines, "]"])


def known_line(machine: Machine, key: str, known: Known) -> str:
    """Return the line of ``[known]`` on a parameter."""
    unit = unit_of(machine, key)
    factor, _ = unit_factor(unit, machine.length_unit)
    of = "" if unit == "1" else f" {unit}"
    found: dict[str, Any] = {}
    if known.prior is not None:
        mean, std = (decimal(x, factor) for x in known.prior)
        found["prior"] = f"{mean} ± {std}{of}"
    if known.bounds is not None:
        found["bounds"] = [x if math.isinf(x) else f"{decimal(x, factor)}{of}" for x in known.bounds]
    return f"{toml_string(key)} = {written(found)}"


def _plausible_line(key: str, stated: StatedPlausibility) -> str:
    said = {"odds": stated.odds, "usual": stated.usual, "largest": stated.largest, "sign": stated.sign}
    found = {name: value for name, value in said.items() if value is not None and value != ()}
    return f"{toml_string(key)} = {written(found)}"


def effect_text(machine: Machine, effect: Effect) -> str:
    """Return the block of an effect, with a line break at its end."""
    return _effect_block(machine, effect) + "\n"


def _effect_block(machine: Machine, effect: Effect) -> str:
    definition = effect.definition
    content: dict[str, Any] = {"name": effect.name}
    if effect.place is not None:
        content["target" if machine.kind_of(effect.place) == "target" else "joint"] = effect.place
    if definition.own:
        if definition.others:
            content[definition.component] = definition.formula.text
            content |= {component: formula.text for component, formula in definition.others}
        else:
            content |= {"component": definition.component, "formula": definition.formula.text}
        content |= {"parameters": dict(definition.parameters) or (), "meaning": definition.meaning}
    if effect.hold:
        factors = _factors(machine, effect)
        content["hold"] = {name: Scaled(value, factors[name]) for name, value in effect.hold.items()}
    return _block("[[effect]]", _entries(content))


def _factors(machine: Machine, effect: Effect) -> dict[str, float]:
    """Return the factor from the file's unit to internal units of each parameter of an effect."""
    dimensions = {
        name: unit_factor(unit, machine.length_unit)[1] for name, unit in effect.units(machine).items()
    }
    return {name: machine.file_factor(dimension) for name, dimension in dimensions.items()}


# for people ----------------------------------------------------------------------------------------------------------


def description(machine: Machine) -> str:
    """Return a short summary; see :meth:`Machine.describe`."""
    return "\n".join(_described(machine))


def _described(machine: Machine) -> Iterator[str]:
    yield f"{machine.name} ({machine.length_unit}, {machine.angle_unit})"
    if machine.kinematics.is_closed:
        yield from _described_legs(machine)
    width = max(len(joint.name) for joint in machine.joints)
    for joint in () if machine.kinematics.is_closed else machine.joints:
        way = f"{joint.type} {'about' if joint.revolute else 'along'} {_rounded(joint.axis)}"
        placed = machine.measurand.moving and (joint.revolute or any(joint.point))
        through = f" through {_rounded(joint.point)}" if placed else ""
        travel = ""
        if joint.travel is not None:
            low, high = (f"{x / machine.file_factor(joint.dimension):g}" for x in joint.travel)
            travel = f", travel {low} to {high} {machine.file_unit(joint.dimension)}"
        yield f"  {joint.name:<{width}}  {way}{through}{travel}{_moved(joint)}"
    if machine.branches:
        yield f"branches: {_code(machine)}"
    shown = [f"{target.name} {_rounded(target.point)}" for target in machine.targets[:4]]
    more = f", and {len(machine.targets) - 4} more" if len(machine.targets) > 4 else ""
    yield f"targets: {', '.join(shown)}{more}"
    yield f"measured: {_measured(machine)}"
    if machine.measured.set_aside:
        yield f"set aside: {joined(entry.named() for entry in machine.measured.set_aside)}"
    yield f"estimated: {', '.join(machine.estimate) or 'nothing but the effects'}"
    yield f"effects: {', '.join(_effect(machine, effect) for effect in machine.effects) or 'none'}"


def _code(machine: Machine) -> str:
    """Return the code of ISO 10791 for a machine of two branches, and which of them the instrument is on."""
    workpiece, tool = ([joint.name for joint in machine.branches.get(name, ())] for name in BRANCHES)
    code = " ".join(["w", *reversed(workpiece), "b", *tool, "t"])
    return f"[{code}], instrument on the {machine.measured.instrument}"


def _moved(joint: Joint) -> str:
    """Return what is known of coordinate, drive and encoder."""
    reading = f", read as {joint.reading}" if joint.reading else ""
    coordinate = f", coordinate {joint.coordinate}" if joint.coordinate else ""
    drive = "" if joint.drive is None else f", {joint.drive} drive"
    encoder = "" if joint.encoder is None else f", encoder on the {joint.encoder}"
    passive = ", passive" if joint.passive else ""
    return (
        coordinate
        + reading
        + drive
        + encoder
        + passive
        + (", counterbalanced" if joint.counterbalance else "")
    )


def _described_legs(machine: Machine) -> Iterator[str]:
    kinematics = machine.kinematics
    numbers = []
    for name in kinematics.numbers:
        value = kinematics.number(name)
        numbers.append(f"{name} = {_rounded(value) if len(value) > 1 else format(value[0], '.6g')}")
    if kinematics.home is not None:
        numbers.append(f"home = {_rounded(kinematics.home)}")
    if kinematics.start is not None:
        degrees = [x / machine.file_factor(ANGLE) for x in kinematics.start]
        numbers.append(f"start = {_rounded(degrees)}")
    yield f"  {kinematics.words}; {', '.join(numbers)}"
    yield f"  legs: {', '.join(joint.name for joint in machine.joints)}"


def _rounded(vector: Sequence[float]) -> str:
    return f"[{', '.join(f'{x + 0.0:.6g}' for x in vector)}]"


def _measured(machine: Machine) -> str:
    measured = machine.measured
    origin = f" from {_rounded(measured.origin)}" if measured.origin is not None else ""
    free = {"about": "about a free axis", "vertical": "against a free vertical"}
    frame = f"in {machine.axes_of_places}"
    if measured.frame == "free":
        frame = free.get(machine.measurand.line, "in a free frame")
    noise = ""
    if measured.noise is not None:
        dimension = measured.measurand.dimension
        size = measured.noise / machine.file_factor(dimension)
        noise = f", noise {size:.6g} {machine.file_unit(dimension)}"
    if measured.attitude_noise is not None:
        noise += f" and {measured.attitude_noise / machine.file_factor(ANGLE):.6g} {machine.file_unit(ANGLE)}"
    return f"{measured.kind}{origin} {frame}{noise}"


def _effect(machine: Machine, effect: Effect) -> str:
    units = effect.units(machine)
    held = []
    for name, value in effect.hold.items():
        factor, _ = unit_factor(units[name], machine.length_unit)
        held.append(f"{name} = {value / factor:.6g}{'' if units[name] == '1' else ' ' + units[name]}")
    return effect.title + (f" ({', '.join(held)} held)" if held else "")
