"""Read a machine file: check what may stand where, and bring it to internal units.

A place in an error message is the block as its user calls it and the key: ``[units], length``, ``joint C, axis``,
``target ball_1, point``, ``[[effect]] 2, hold.b``; blocks whose name is in doubt go by their number, ``[[joint]] 3``.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rodgen import limits
from rodgen.data.set_aside import SetAside
from rodgen.data.units import ANGLE, LENGTH, parse_unit
from rodgen.errors import InputFileError, UnexpectedError, in_file, joined, listed, shown, suggestion
from rodgen.machines.coupling import CouplingError
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.custom import OWN_COMPONENTS, own_effect
from rodgen.machines.effects.definition import coordinate_dimension
from rodgen.machines.families import FAMILIES
from rodgen.machines.families.kinematics import Chain, Kinematics
from rodgen.machines.families.on_legs import OnLegs
from rodgen.machines.files import schema
from rodgen.machines.files.toml import (
    NUMBER,
    POSITIVE,
    TABLE,
    TEXT,
    VECTOR,
    Kind,
    Table,
    UnfitError,
    one_of,
    parse,
    read_text,
)
from rodgen.machines.files.write import machine_text
from rodgen.machines.known import read_known
from rodgen.machines.machine import Machine
from rodgen.machines.measured import MEASURANDS, Measurand, Measured
from rodgen.machines.parts import (
    BRANCHES,
    ColumnSource,
    Effect,
    Joint,
    Known,
    StatedPlausibility,
    Target,
)
from rodgen.machines.plausibility import stated_plausibility
from rodgen.machines.rules import (
    catalogue_effect,
    check_effect,
    check_estimate,
    held,
    unknown_name,
)

_SOURCE = re.compile(
    r"(?P<sign>[-+]?)\s*(?P<name>.+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?(?:\s+(?P<op>[-+])\s+(?P<offset>[\d.]+(?:[eE][-+]?\d+)?))?"
)
EXAMPLE = '"-A_axis [deg] + 90"'


def column_source(text: str) -> ColumnSource:
    """Return what a text such as ``-A_axis [deg] + 90`` says.

    Raises
    ------
    UnexpectedError

    Examples
    --------
    >>> column_source("-A axis [deg] + 90")
    ColumnSource(name='A axis', unit='deg', sign=-1.0, offset=90.0)
    """
    match = _SOURCE.fullmatch(text.strip())
    if match is None:
        raise UnexpectedError(shown(text), f"a column of a table, such as {EXAMPLE}")
    offset = float(match["offset"] or 0) * (-1 if match["op"] == "-" else 1)
    sign = -1.0 if match["sign"] == "-" else 1.0
    return ColumnSource(match["name"], (match["unit"] or "").strip(), sign, offset)


def stated_columns(file: str, content: Mapping[str, Any]) -> dict[str, ColumnSource]:
    """Return what the table ``[columns]`` of a machine file says, by the names of measurements.

    Raises
    ------
    InputFileError
    """
    columns = {}
    for name, entry in content.items():
        if isinstance(entry, str):
            with in_file(file, f"[columns], {shown(name)[1:-1]}"):
                columns[name] = column_source(entry)
            continue
        if not isinstance(entry, dict):
            raise InputFileError(
                file, f"[columns], {shown(name)[1:-1]}", "no text and no table", f"a text such as {EXAMPLE}"
            )
        table = Table(file, f"[columns], {name}", entry, ("from", "unit", "sign", "offset"))
        sign = table.get("sign", NUMBER, 1.0)
        if abs(sign) != 1.0 or not math.isfinite(sign):
            raise table.error("sign", f"{sign:g}", "1 or -1")
        columns[name] = ColumnSource(
            table.get("from", TEXT), table.get("unit", TEXT, ""), sign, table.get("offset", NUMBER, 0.0)
        )
    return columns


MOST_JOINTS, MOST_TARGETS, MOST_EFFECTS = 64, 1000, 200
PLATFORM = "platform"
"""Name of the target where the file of a closed chain gives none: the middle of its platform."""

_OF_FAMILY, _OF_CHAIN = frozenset({"family", "geometry"}), frozenset({"branch", "joint"})
"""Keys of the file that are in that of a family of machines alone, and of a chain of joints alone."""
_TOP = (
    "name family units environment geometry branch joint target measured estimate known ties plausibility columns "
    "record effect"
).split()
_RECORD = ("date", "instrument", "conditions")
_OWN = ("component", "formula", "parameters", "meaning", *OWN_COMPONENTS)

_MISSING = {
    "units": 'length = "mm" and angle = "deg", or other units, in it',
    "joint": "one block for each joint, the base's first",
    "target": "one block or more, each with name and point",
    "geometry": "R, r and what else the family needs in it",
    "measured": 'kind = "point" (or "direction", "distance", "height", "pose", "orientation", "angle", "inclination") '
    'and frame = "machine" (or "free") in it',
}


UNIT_LENGTH = 1e-9
"""How far the length of a unit vector may be off 1."""


def read_machine(path: str | os.PathLike[str]) -> Machine:
    """Read a machine file.

    Parameters
    ----------
    path : str or os.PathLike
        A TOML file, at most 1 MB.

    Returns
    -------
    Machine

    Raises
    ------
    InputFileError
        One line with the place, what stands there and what should.
    """
    file = os.fspath(path)
    return machine_of(read_text(file), file)


def machine_of(text: str, file: str) -> Machine:
    """Return the machine that the text of a file describes.

    Parameters
    ----------
    text : str
        TOML.
    file : str
        For error messages, and the machine's own `file`.

    Raises
    ------
    InputFileError
    """
    content = parse(text, file)
    if "family" in content and "joint" in content:
        raise InputFileError(
            file, "[[joint]]", "given together with family", "a chain of joints, or a family"
        )
    if "geometry" in content and "family" not in content:
        raise InputFileError(file, "[geometry]", "given without a family", f"family = {listed(FAMILIES)}")
    others = _OF_CHAIN if "family" in content else _OF_FAMILY
    top = Table(file, "", content, [key for key in _TOP if key not in others])
    name = top.get("name", schema.TITLE)
    units = top.sub("units", ("length", "angle"), missing=_MISSING["units"])
    length, angle = (
        units.get("length", schema.unit_of(LENGTH, "mm")),
        units.get("angle", schema.unit_of(ANGLE, "deg")),
    )
    per_radian = parse_unit(angle).factor()
    environment = top.sub("environment", ("gravity", "reference_temperature"))
    measured = _measured(top, length, per_radian)
    kinematics = _on_legs(top, per_radian) if "family" in top else Chain()
    columns = _entries(top, "columns", f"A = {EXAMPLE}")
    machine = Machine(
        name=name,
        length_unit=length,
        angle_unit=angle,
        gravity=environment.get("gravity", schema.DIRECTION, (0.0, 0.0, -1.0)),
        reference_temperature=environment.get("reference_temperature", NUMBER, 20.0),
        joints=_legs(kinematics)
        if kinematics.is_closed
        else _of_branches(top, _joints(top, per_radian), measured.instrument),
        targets=_targets(top, measured.measurand, per_radian, closed=kinematics.is_closed),
        measured=measured,
        file=file,
        kinematics=kinematics,
        record=_record(top),
        column_sources=stated_columns(file, columns),
    )
    _check_names(machine)
    try:
        _ = machine.couplings
    except CouplingError as error:
        raise InputFileError(file, f"joint {error.joint}, {error.key}", error.found, error.expected) from None
    machine = replace(machine, estimate=_estimate(top, machine))
    for number, block in enumerate(top.blocks("effect", MOST_EFFECTS), start=1):
        effect = effect_of(machine, block, file, f"[[effect]] {number}")
        machine = replace(machine, effects=(*machine.effects, effect))
    if known := _entries(top, "known", '"C.axis.a" = { prior = "0 ± 20 arcsec" }'):
        machine = replace(machine, known=dict(_known(file, machine, known)))
    for key, text in _flat(file, _entries(top, "ties", _TIE)):
        machine = machine.tying(key, text)
    plausible = _entries(top, "plausibility", _PLAUSIBLE)
    return replace(machine, plausible=dict(_plausible(file, machine, plausible))) if plausible else machine


def validate(machine: Machine) -> None:
    """Check what was built in Python as a machine file is checked; one that was read has been.

    Raises
    ------
    InputFileError
        One line with the place, what stands there and what should.
    """
    if machine.file is not None:
        return
    read = machine_of(machine_text(machine), machine.name)
    directions = () if machine.measurand.moving else machine.targets
    vectors = {"gravity": machine.gravity} | {f"target {t.name}, point": t.point for t in directions}
    for place, vector in vectors.items():
        if abs(math.hypot(*vector) - 1) > UNIT_LENGTH:
            found = f"a vector of length {math.hypot(*vector):.6g}"
            raise InputFileError(machine.name, place, found, "one of length 1")
    order = [joint.name for joint in read.joints]
    if order != [joint.name for joint in machine.joints]:
        found = f"in the order {joined(joint.name for joint in machine.joints)}"
        raise InputFileError(machine.name, "joints", found, f"from instrument to target: {joined(order)}")


def _entries(top: Table, key: str, example: str) -> dict[str, Any]:
    """Return the entries of a table whose keys are names of the machine's; `example` is one of them."""
    content = top.content.get(key, {})
    if not isinstance(content, dict):
        raise InputFileError(top.file, f"[{key}]", "no table", f"entries such as {example}")
    return content


# blocks ------------------------------------------------------------------------------------------------------------


def _record(top: Table) -> dict[str, str]:
    """Return what is noted of the measurements."""
    table = top.sub("record", _RECORD)
    return {key: table.get(key, schema.NOTED) for key in _RECORD if key in table}


def _measured(top: Table, length: str, per_radian: float) -> Measured:
    branches = "branch" in top
    names = [
        key.name for key in schema.measured_keys(MEASURANDS["point"], length, per_radian, branches=branches)
    ]
    table = top.sub("measured", names, missing=_MISSING["measured"])
    kind = table.get("kind", one_of(tuple(MEASURANDS)))
    measurand = MEASURANDS[kind]
    if "instrument" in table and not branches:
        raise table.error("instrument", "given without [[branch]]", "it with blocks [[branch]] only")
    keys = schema.read_keys(
        table, schema.measured_keys(measurand, length, per_radian, branches=branches), kind
    )
    noises = ("noise", "attitude_noise")
    missing = [name for name in noises if keys[name] is None]
    if measurand.is_pose and len(missing) == 1:
        stated = noises[1 - noises.index(missing[0])]
        raise table.error(missing[0], f"missing, while {stated} is stated", "both of them, or neither")
    keys["set_aside"] = entries_of(keys["set_aside"], table.file, f"{table.place}, set_aside")
    return Measured(**keys)


def entries_of(contents: Sequence[dict[str, Any]], file: str, place: str) -> tuple[SetAside, ...]:
    """Return the entries of ``set_aside`` that tables describe.

    Raises
    ------
    InputFileError
    """
    entries = []
    for number, content in enumerate(contents, 1):
        entry = Table(file, f"{place} {number}", content, tuple(SetAside.__dataclass_fields__))
        keys = {
            key: entry.get(key, schema.WORD if key in {"rows", "run"} else TEXT)
            for key in content
            if key != "back"
        }
        with in_file(entry.file, entry.place):
            entries.append(SetAside(**keys, back=entry.get("back", schema.YES_OR_NO, False)))
    return tuple(entries)


def _joints(top: Table, per_radian: float) -> list[Joint]:
    joints = []
    for table in _named_blocks(top, "joint", MOST_JOINTS, schema.JOINT_NAME, schema.joint_keys(1.0)):
        table.get("name", schema.JOINT_NAME)
        turns = coordinate_dimension(table.get("type", schema.JOINT_TYPE)) == ANGLE
        joint = Joint(**schema.read_keys(table, schema.joint_keys(per_radian if turns else 1.0)))
        if joint.passive:
            of_drive = [key for key in ("drive", "period") if key in table]
            of_drive += ["encoder"] if joint.encoder == "motor" else []
            if of_drive:
                found = f"true, together with {of_drive[0]} = {table.content[of_drive[0]]!r}"
                raise table.error("passive", found, "one of the two: nothing drives a passive joint")
        if joint.reading_travel is not None and None in (joint.coordinate, joint.reading):
            raise table.error("reading_travel", "given without coordinate and reading", "travel")
        joints.append(joint)
    return joints


def _of_branches(top: Table, joints: list[Joint], instrument: str) -> tuple[Joint, ...]:
    """Return the joints of a chain as they are; of two branches in the order from the instrument to the target."""
    if "branch" not in top:
        return tuple(joints)
    at = {joint.name: joint for joint in joints}
    branches: dict[str, list[Joint]] = {}
    for number, block in enumerate(top.blocks("branch", len(BRANCHES)), start=1):
        table = Table(top.file, f"[[branch]] {number}", block, ("name", "joints"))
        branch = table.get("name", one_of(BRANCHES))
        if branch in branches:
            raise table.error("name", f"{shown(branch)} twice", "it once")
        branches[branch] = []
        for name in table.get("joints", schema.JOINTS):
            if name not in at:
                elsewhere = any(joint.name == name for joint in joints)
                what = f"{shown(name)} twice" if elsewhere else f"no joint {shown(name)}"
                raise table.error("joints", what, "it once" if elsewhere else suggestion(name, list(at)))
            branches[branch].append(replace(at.pop(name), branch=branch))
    if at:
        left = listed(list(at))
        raise InputFileError(
            top.file, "[[branch]]", f"none with {left}", "each joint in the joints of a branch"
        )
    inner = branches.pop(instrument, [])
    return (*reversed(inner), *(joint for outer in branches.values() for joint in outer))


def _on_legs(top: Table, per_radian: float) -> OnLegs:
    family = FAMILIES[top.get("family", one_of(tuple(FAMILIES)))]
    table = top.sub("geometry", family.keys, missing=_MISSING["geometry"])
    length = POSITIVE.then(schema.squarable, f"a positive number below {limits.NUMBER:g}")
    numbers: dict[str, Any] = {}
    for name, components in family.numbers.items():
        if len(components) == 1:
            numbers[name] = table.get(name, length)
        else:
            numbers[name] = table.get(name, schema.POINT, *([schema.ORIGIN] if hasattr(family, name) else []))
    if "home" in family.keys:
        numbers["home"] = table.get("home", schema.POINT)
    if "start" in family.keys:
        numbers["start"] = table.get("start", VECTOR.then(schema.scaled(per_radian)), None)
    kinematics = family(**numbers)
    if kinematics.fault:
        raise table.error(*kinematics.fault)
    return kinematics


def _legs(kinematics: Kinematics) -> tuple[Joint, ...]:
    return tuple(Joint(name, kinematics.leg) for name in kinematics.legs)


def _targets(top: Table, measurand: Measurand, per_radian: float, *, closed: bool) -> tuple[Target, ...]:
    if closed and "target" not in top:
        if not measurand.moving and not measurand.has_axes:
            raise InputFileError(
                top.file, "[[target]]", "missing", "the direction on the platform that is seen"
            )
        return (Target(PLATFORM, schema.ORIGIN if measurand.moving else schema.Z),)
    keys = schema.target_keys(measurand, per_radian)
    tables = _named_blocks(top, "target", MOST_TARGETS, schema.PLACE_NAME, keys)
    return tuple(Target(**schema.read_keys(table, keys, measurand.kind)) for table in tables)


def _named_blocks(
    top: Table, key: str, most: int, kind: Kind[str], keys: Sequence[schema.Key]
) -> list[Table]:
    """Return the blocks `[[key]]`, each with its name as its place where it has a valid one."""
    tables = []
    for number, block in enumerate(top.blocks(key, most, missing=_MISSING[key]), start=1):
        try:
            place = f"{key} {kind.read(block.get('name'))}"
        except UnfitError:
            place = f"[[{key}]] {number}"
        tables.append(Table(top.file, place, block, [each.name for each in keys]))
    return tables


def _check_names(machine: Machine) -> None:
    """Check that joints and targets have different names: an effect is identified by its name and its place."""
    joints = [joint.name for joint in machine.joints]
    reading = next((name for name in joints if name in machine.measurand.read_columns), None)
    if reading is not None:
        found = f"{shown(reading)}, a column of readings"
        raise InputFileError(str(machine.file), f"joint {reading}, name", found, "another name")
    names = [*joints, *(target.name for target in machine.targets)]
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is None:
        return
    number = len(names) - names[::-1].index(twice)
    if machine.kinematics.is_closed and twice in joints:
        place = f"[[target]] {number - len(joints)}, name"
        raise InputFileError(str(machine.file), place, f"{shown(twice)}, the name of a leg", "another name")
    place = f"[[joint]] {number}" if number <= len(joints) else f"[[target]] {number - len(joints)}"
    kind_there = "joint" if twice in joints else "target"
    raise InputFileError(
        str(machine.file), f"{place}, name", f"{shown(twice)}, as another {kind_there}", "a name of its own"
    )


def _estimate(top: Table, machine: Machine) -> tuple[str, ...]:
    if "estimate" not in top:
        return ()
    table = top.sub("estimate", ("parameters",))
    entries = table.get("parameters", schema.TEXTS)
    for entry in entries:
        if fault := check_estimate(machine, entry):
            raise table.error("parameters", *fault)
        if entries.count(entry) > 1:
            raise table.error("parameters", f"{shown(entry)} twice", "it once")
        if "geometry" in entries and entry in machine.kinematics.numbers:
            raise table.error("parameters", f"{shown(entry)}, which is part of 'geometry'", "one of the two")
    return entries


def _known(
    file: str, machine: Machine, content: dict[str, Any], above: str = ""
) -> Iterator[tuple[str, Known]]:
    """Yield what is known of each key; a key with dots may be written as tables in tables, as TOML reads it."""
    for name, entry in content.items():
        key = f"{above}{name}"
        table = Table(file, f"[known], {key}", entry, tuple(entry)) if isinstance(entry, dict) else None
        if table is None:
            raise InputFileError(
                file, f"[known], {shown(key)}", "no table", '{ prior = "0 ± 20 arcsec" }, or bounds'
            )
        inner = {x for x, value in entry.items() if isinstance(value, dict)}
        if inner:
            yield from _known(file, machine, {x: entry[x] for x in inner}, f"{key}.")
        entry_of_all = {x: value for x, value in entry.items() if x not in inner}
        if not entry_of_all and inner:
            continue
        for x in entry_of_all:
            if x not in {"prior", "bounds"}:
                raise table.error(x, "unknown key", "prior or bounds")
        with in_file(table.file, table.place):
            known = read_known(machine, key, entry_of_all)
        yield key, known


_TIE = '"J2.gravity_windup.k" = "2 * J3.gravity_windup.k"'


def _flat(file: str, content: dict[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield each key with its text; a key with dots may be written as tables in tables, as TOML reads it."""
    for name, entry in content.items():
        key = f"{above}{name}"
        if isinstance(entry, dict) and entry:
            yield from _flat(file, entry, f"{key}.")
        elif isinstance(entry, str):
            yield key, entry
        else:
            raise InputFileError(file, f"[ties], {shown(key)[1:-1]}", "no text", f"one such as {_TIE}")


# effects -----------------------------------------------------------------------------------------------------------


def effect_of(machine: Machine, block: Mapping[str, Any], file: str, where: str) -> Effect:
    """Return the effect that a block describes, in its place in a machine.

    Parameters
    ----------
    machine : Machine
        With the effects before it.
    block : mapping
        The keys of an ``[[effect]]``.
    file, where : str
        Its place, for error messages.

    Raises
    ------
    InputFileError
    """
    table = Table(file, where, block, ("name", "joint", "target", "hold", *_OWN))
    name = table.get("name", TEXT)
    place = _place(table, machine)
    hold = {
        key: table.convert(f"hold.{key}", value, NUMBER)
        for key, value in table.get("hold", TABLE, {}).items()
    }
    key_of_formula = next((key for key in _OWN if key in table), None)
    with in_file(file, where):
        if name in NAMES:
            if key_of_formula is not None:
                raise table.error(
                    key_of_formula,
                    f"given for {shown(name)}, which the catalogue has",
                    f"another name, or no {key_of_formula}",
                )
            effect = catalogue_effect(machine, name, place, hold)
        elif key_of_formula is None:
            raise unknown_name(name)
        else:
            effect = _own_effect(table, machine, place)
            effect = replace(effect, hold=held(machine, effect, hold))
        check_effect(machine, effect)
    return effect


def _place(table: Table, machine: Machine) -> str | None:
    if "joint" in table and "target" in table:
        raise table.error("target", "given together with joint", "one place")
    if "joint" in table:
        return table.get("joint", one_of([joint.name for joint in machine.joints]))
    if "target" in table:
        return table.get("target", one_of([target.name for target in machine.targets]))
    return None


def _own_effect(table: Table, machine: Machine, place: str | None) -> Effect:
    parameters = {
        key: table.convert(f"parameters.{key}", value, schema.PARAMETER_UNIT)
        for key, value in table.get("parameters", TABLE, {}).items()
    }
    several = {key: table.get(key, TEXT) for key in table.content if key in OWN_COMPONENTS}
    if several and (single := next((key for key in ("component", "formula") if key in table), None)):
        raise table.error(
            single,
            f"given together with {next(iter(several))}",
            "component and formula, or formulas by component",
        )
    (component, formula), *_ = several.items() or [(table.get("component", TEXT), table.get("formula", TEXT))]
    definition = own_effect(
        table.get("name", TEXT),
        component,
        formula,
        parameters,
        table.get("meaning", TEXT, ""),
        others={key: text for key, text in several.items() if key != component} if several else None,
        at=machine.kind_of(place),
        joints=machine.quantities,
        measurand=machine.measurand,
        file=table.file,
        place=table.place,
    )
    return Effect(definition, place)


_PLAUSIBLE = 'J2.gravity_windup = { odds = 2, usual = "3 arcmin" }'


def _plausible(
    file: str, machine: Machine, content: dict[str, Any]
) -> Iterator[tuple[str, StatedPlausibility]]:
    """Yield what is stated of each effect; those at a place may be in a table of it, as TOML reads dots."""
    places = {*(joint.name for joint in machine.joints), *(target.name for target in machine.targets)}
    for name, entry in content.items():
        tables = isinstance(entry, dict) and entry and all(isinstance(x, dict) for x in entry.values())
        inner = entry if tables or (name in places and isinstance(entry, dict)) else None
        for key, stated_entry in (
            [(name, entry)] if inner is None else [(f"{name}.{x}", inner[x]) for x in inner]
        ):
            if not isinstance(stated_entry, dict):
                place, expected = f"[plausibility], {shown(key)[1:-1]}", f"one such as {_PLAUSIBLE}"
                raise InputFileError(file, place, "no table", expected)
            with in_file(file, f"[plausibility], {shown(key)[1:-1]}"):
                stated = stated_plausibility(machine, key, stated_entry)
            yield key, stated
