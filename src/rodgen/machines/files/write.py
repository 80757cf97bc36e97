"""Write a `Machine` as the text of a machine file, and as a short summary."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence

from rodgen.data.set_aside import SetAside
from rodgen.data.units import ANGLE, unit_factor
from rodgen.errors import joined
from rodgen.files import write_file
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.known import unit_of
from rodgen.machines.machine import Machine
from rodgen.machines.parts import BRANCHES, ColumnSource, Effect, Joint, Known, StatedPlausibility, Target

# numbers and texts -------------------------------------------------------------------------------------------------


def decimal(value: float, factor: float = 1.0) -> str:
    """Return the shortest decimal that, read and multiplied by `factor`, is `value` to the last bit.

    Where there is none (a product of floats skips some values), the nearest is returned: within 2e-16 of the value.

    Examples
    --------
    >>> import math
    >>> decimal(math.pi, math.pi / 180), decimal(0.1 + 0.2), decimal(800.0)
    ('180', '0.30000000000000004', '800')
    """
    quotient = value / factor
    near = [quotient, math.nextafter(quotient, math.inf), math.nextafter(quotient, -math.inf)]
    exact = next((x for x in near if x * factor == value), quotient)
    short = (float(f"{exact:.{digits}g}") for digits in range(1, 17))
    number = next((x for x in short if x * factor == exact * factor), exact)
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _vector(values: Sequence[float], factor: float = 1.0) -> str:
    return f"[{', '.join(decimal(x, factor) for x in values)}]"


def toml_string(text: str) -> str:
    """Return a TOML string. JSON's escapes are valid in TOML, which wants DEL escaped too."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _toml_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def _inline_table(items: Mapping[str, str]) -> str:
    return f"{{ {', '.join(f'{_toml_key(name)} = {value}' for name, value in items.items())} }}"


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
    measured = machine.measured
    blocks = [
        [f"name = {toml_string(machine.name)}", *_family_lines(machine)],
        [
            "[units]",
            f"length = {toml_string(machine.length_unit)}",
            f"angle = {toml_string(machine.angle_unit)}",
        ],
        [
            "[environment]",
            f"gravity = {_vector(machine.gravity)}",
            f"reference_temperature = {decimal(machine.reference_temperature)}",
        ],
        *_chain_blocks(machine),
        *(_target_lines(machine, target) for target in machine.targets),
        ["[measured]", f"kind = {toml_string(measured.kind)}", f"frame = {toml_string(measured.frame)}"],
    ]
    if measured.origin is not None:
        blocks[-1].append(f"from = {_vector(measured.origin)}")
    if measured.about is not None:
        blocks[-1].append(f"about = {_vector(measured.about)}")
    if machine.branches:
        blocks[-1].append(f"instrument = {toml_string(measured.instrument)}")
    if measured.noise is not None:
        noise = decimal(measured.noise, machine.file_factor(machine.measurand.dimension))
        blocks[-1].append(f"noise = {noise}")
    if measured.attitude_noise is not None:
        blocks[-1].append(f"attitude_noise = {decimal(measured.attitude_noise, machine.file_factor(ANGLE))}")
    if measured.correlation == "columns":
        blocks[-1].append('correlation = "columns"')
    elif measured.correlation is not None:
        rows = (f"[{', '.join(map(decimal, row))}]" for row in measured.correlation)
        blocks[-1].append(f"correlation = [{', '.join(rows)}]")
    if measured.set_aside:
        blocks[-1].append(set_aside_text(measured.set_aside))
    if machine.estimate:
        blocks.append(["[estimate]", f"parameters = [{', '.join(map(toml_string, machine.estimate))}]"])
    if machine.known:
        blocks.append(["[known]", *(known_line(machine, key, known) for key, known in machine.known.items())])
    if machine.ties:
        lines = (f"{toml_string(key)} = {toml_string(tie.text)}" for key, tie in machine.ties.items())
        blocks.append(["[ties]", *lines])
    if machine.plausible:
        blocks.append(["[plausibility]", *(_plausible_line(*entry) for entry in machine.plausible.items())])
    if machine.column_sources:
        sources = machine.column_sources.items()
        blocks.append(["[columns]", *(f"{_toml_key(name)} = {_source(source)}" for name, source in sources)])
    if machine.record:
        noted = machine.record.items()
        blocks.append(["[record]", *(f"{key} = {toml_string(text)}" for key, text in noted)])
    blocks += [_effect_lines(machine, effect) for effect in machine.effects]
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _source(source: ColumnSource) -> str:
    said = {"from": toml_string(source.name)}
    if source.unit:
        said["unit"] = toml_string(source.unit)
    if source.sign != 1.0:
        said["sign"] = decimal(source.sign)
    if source.offset:
        said["offset"] = decimal(source.offset)
    return _inline_table(said)


def set_aside_text(entries: Sequence[SetAside]) -> str:
    """Return the key of ``[measured]`` on rows that are set aside, an entry a line."""
    lines = ["set_aside = ["]
    for entry in entries:
        said = {key: "true" if x is True else toml_string(x) for key, x in entry.to_dict().items()}
        lines.append(f"    {_inline_table(said)},")
    return "\n".join([*lines, "]"])


def _target_lines(machine: Machine, target: Target) -> list[str]:
    lines = ["[[target]]", f"name = {toml_string(target.name)}", f"point = {_vector(target.point)}"]
    if any(target.attitude):
        numbers = ", ".join(decimal(x, machine.file_factor(ANGLE)) for x in target.attitude)
        lines.append(f"attitude = [{numbers}]")
    if target.zero:
        lines.append(f"zero = {decimal(target.zero, machine.file_factor(ANGLE))}")
    return lines


def known_line(machine: Machine, key: str, known: Known) -> str:
    """Return the line of ``[known]`` on a parameter."""
    unit = unit_of(machine, key)
    factor, _ = unit_factor(unit, machine.length_unit)
    of = "" if unit == "1" else f" {unit}"
    found = {}
    if known.prior is not None:
        mean, std = (decimal(x, factor) for x in known.prior)
        found["prior"] = toml_string(f"{mean} ± {std}{of}")
    if known.bounds is not None:
        ends = (f"{x}" if math.isinf(x) else toml_string(f"{decimal(x, factor)}{of}") for x in known.bounds)
        found["bounds"] = f"[{', '.join(ends)}]"
    return f"{toml_string(key)} = {_inline_table(found)}"


def _plausible_line(key: str, stated: StatedPlausibility) -> str:
    found = {} if stated.odds is None else {"odds": decimal(stated.odds)}
    sizes = {"usual": stated.usual, "largest": stated.largest}
    found |= {name: f"[{', '.join(map(toml_string, texts))}]" for name, texts in sizes.items() if texts}
    found |= {} if stated.sign is None else {"sign": toml_string(stated.sign)}
    return f"{toml_string(key)} = {_inline_table(found)}"


def _family_lines(machine: Machine) -> list[str]:
    family = machine.kinematics.family
    return [f"family = {toml_string(family)}"] if family else []


def _chain_blocks(machine: Machine) -> list[list[str]]:
    """Return the blocks of the joints, or that of a closed chain's geometry."""
    kinematics = machine.kinematics
    if not kinematics.is_closed:
        joints = [_joint_lines(joint, machine.file_factor(joint.dimension)) for joint in machine.joints]
        return [*(_branch_lines(*branch) for branch in machine.branches.items()), *joints]
    lines = ["[geometry]"]
    for name, components in kinematics.numbers.items():
        value = kinematics.number(name)
        lines.append(f"{name} = {decimal(value[0]) if len(components) == 1 else _vector(value)}")
    if kinematics.home is not None:
        lines.append(f"home = {_vector(kinematics.home)}")
    if kinematics.start is not None:
        lines.append(f"start = {_vector(kinematics.start, machine.file_factor(ANGLE))}")
    return [lines]


def _branch_lines(name: str, joints: Sequence[Joint]) -> list[str]:
    names = ", ".join(toml_string(joint.name) for joint in joints)
    return ["[[branch]]", f"name = {toml_string(name)}", f"joints = [{names}]"]


def _joint_lines(joint: Joint, factor: float) -> list[str]:
    lines = [
        "[[joint]]",
        f"name = {toml_string(joint.name)}",
        f"type = {toml_string(joint.type)}",
        f"axis = {_vector(joint.axis)}",
        f"point = {_vector(joint.point)}",
    ]
    if joint.travel is not None:
        lines.append(f"travel = {_vector(joint.travel, factor)}")
    if joint.reading_travel is not None:
        lines.append(f"reading_travel = {_vector(joint.reading_travel, factor)}")
    if joint.period is not None:
        lines.append(f"period = {decimal(joint.period, factor)}")
    words = {"reading": joint.reading, "coordinate": joint.coordinate}
    words |= {"encoder": joint.encoder, "drive": joint.drive}
    lines += [f"{key} = {toml_string(word)}" for key, word in words.items() if word is not None]
    lines += [f"{key} = true" for key in ("passive", "counterbalance") if getattr(joint, key)]
    return lines


def effect_text(machine: Machine, effect: Effect) -> str:
    """Return the block of an effect, with a line break at its end."""
    return "\n".join(_effect_lines(machine, effect)) + "\n"


def _effect_lines(machine: Machine, effect: Effect) -> list[str]:
    lines = ["[[effect]]", f"name = {toml_string(effect.name)}"]
    if effect.place is not None:
        key = "target" if machine.kind_of(effect.place) == "target" else "joint"
        lines.append(f"{key} = {toml_string(effect.place)}")
    definition = effect.definition
    if definition.own:
        parts = {"component": definition.component, "formula": definition.formula.text}
        if definition.others:
            parts = {definition.component: definition.formula.text}
            parts |= {component: formula.text for component, formula in definition.others}
        lines += [f"{key} = {toml_string(text)}" for key, text in parts.items()]
        if definition.parameters:
            units = {name: toml_string(unit) for name, unit in definition.parameters.items()}
            lines.append(f"parameters = {_inline_table(units)}")
        if definition.meaning:
            lines.append(f"meaning = {toml_string(definition.meaning)}")
    if effect.hold:
        factors = _factors(machine, effect)
        held = {name: decimal(value, factors[name]) for name, value in effect.hold.items()}
        lines.append(f"hold = {_inline_table(held)}")
    return lines


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
