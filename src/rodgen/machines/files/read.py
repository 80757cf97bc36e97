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
from typing import Any, Literal

import numpy as np

from rodgen import limits
from rodgen.data.set_aside import SetAside
from rodgen.data.units import ANGLE, LENGTH, Dimension, UnitError, parse_unit, typed_quantity
from rodgen.errors import InputFileError, UnexpectedError, in_file, joined, listed, shown, suggestion
from rodgen.machines.coupling import CouplingError
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.custom import OWN_COMPONENTS, own_effect
from rodgen.machines.effects.definition import coordinate_dimension
from rodgen.machines.families import FAMILIES
from rodgen.machines.families.kinematics import Chain, Kinematics
from rodgen.machines.families.on_legs import OnLegs
from rodgen.machines.files.toml import (
    NUMBER,
    PAIR,
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
from rodgen.machines.measured import MEASURANDS, READING_COLUMNS, Measurand, Measured
from rodgen.machines.parts import (
    BRANCHES,
    DRIVES,
    ENCODERS,
    JOINT_TYPES,
    ColumnSource,
    Effect,
    Joint,
    Known,
    StatedPlausibility,
    Target,
    Vector,
    suggested_type,
    unit_vector,
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
    found = _SOURCE.fullmatch(text.strip())
    if found is None:
        raise UnexpectedError(shown(text), f"a column of a table, such as {EXAMPLE}")
    offset = float(found["offset"] or 0) * (-1 if found["op"] == "-" else 1)
    sign = -1.0 if found["sign"] == "-" else 1.0
    return ColumnSource(found["name"], (found["unit"] or "").strip(), sign, offset)


def stated_columns(file: str, content: Mapping[str, Any]) -> dict[str, ColumnSource]:
    """Return what the table ``[columns]`` of a machine file says, by the names of measurements.

    Raises
    ------
    InputFileError
    """
    found = {}
    for name, entry in content.items():
        if isinstance(entry, str):
            with in_file(file, f"[columns], {shown(name)[1:-1]}"):
                found[name] = column_source(entry)
            continue
        if not isinstance(entry, dict):
            raise InputFileError(
                file, f"[columns], {shown(name)[1:-1]}", "no text and no table", f"a text such as {EXAMPLE}"
            )
        table = Table(file, f"[columns], {name}", entry, ("from", "unit", "sign", "offset"))
        sign = table.get("sign", NUMBER, 1.0)
        if abs(sign) != 1.0 or not math.isfinite(sign):
            raise table.error("sign", f"{sign:g}", "1 or -1")
        found[name] = ColumnSource(
            table.get("from", TEXT), table.get("unit", TEXT, ""), sign, table.get("offset", NUMBER, 0.0)
        )
    return found


MOST_JOINTS, MOST_TARGETS, MOST_EFFECTS = 64, 1000, 200
PLATFORM = "platform"
"""Name of the target where the file of a closed chain gives none: the middle of its platform."""

_OF_FAMILY, _OF_CHAIN = frozenset({"family", "geometry"}), frozenset({"branch", "joint"})
"""Keys of the file that stand in that of a family of machines alone, and of a chain of joints alone."""
_KEYS = {
    "file": (
        "name",
        "family",
        "units",
        "environment",
        "geometry",
        "branch",
        "joint",
        "target",
        "measured",
        "estimate",
        "known",
        "ties",
        "plausibility",
        "columns",
        "record",
        "effect",
    ),
    "units": ("length", "angle"),
    "environment": ("gravity", "reference_temperature"),
    "record": ("date", "instrument", "conditions"),
    "joint": (
        "name",
        "type",
        "axis",
        "point",
        "travel",
        "period",
        "encoder",
        "drive",
        "passive",
        "counterbalance",
        "reading",
        "coordinate",
        "reading_travel",
    ),
    "branch": ("name", "joints"),
    "target": ("name", "point", "attitude", "zero"),
    "measured": (
        "kind",
        "frame",
        "from",
        "about",
        "noise",
        "attitude_noise",
        "correlation",
        "instrument",
        "set_aside",
    ),
    "estimate": ("parameters",),
    "effect": (
        "name",
        "joint",
        "target",
        "hold",
        "component",
        "formula",
        "parameters",
        "meaning",
        *OWN_COMPONENTS,
    ),
}
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
    top = Table(file, "", content, [key for key in _KEYS["file"] if key not in others])
    name = top.get("name", _TITLE)
    units = top.sub("units", _KEYS["units"], missing=_MISSING["units"])
    length, angle = units.get("length", unit_of(LENGTH, "mm")), units.get("angle", unit_of(ANGLE, "deg"))
    per_radian = parse_unit(angle).factor()
    environment = top.sub("environment", _KEYS["environment"])
    measured = _measured(top, length, per_radian)
    kinematics = _on_legs(top, per_radian) if "family" in top else Chain()
    columns = _entries(top, "columns", f"A = {EXAMPLE}")
    machine = Machine(
        name=name,
        length_unit=length,
        angle_unit=angle,
        gravity=environment.get("gravity", _DIRECTION, (0.0, 0.0, -1.0)),
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


# what a key may hold -------------------------------------------------------------------------------------------

_COLUMNS = READING_COLUMNS | {"t", "load", "run", "target"}
_PREFIXES = ("u_", "dir_", "v_", "T_")
_NAME_TEXT = re.compile(r"[^\W_](?:[\w+-]|(?<=[\w+-]) (?=[\w+-])){0,59}")


def _record(top: Table) -> dict[str, str]:
    """Return what is noted of the measurements."""
    table = top.sub("record", _KEYS["record"])
    return {key: table.get(key, _NOTED) for key in _KEYS["record"] if key in table}


def _noted(value: Any) -> str:
    """Return a text, or a date or time that TOML reads without quotes, as text."""
    return str(value.isoformat()) if hasattr(value, "isoformat") else TEXT.read(value)


def _title(text: str) -> str:
    if not text.isprintable() or len(text) > 200:
        raise UnfitError(
            "a text of several lines" if "\n" in text else "a text that cannot be printed on a line"
        )
    return text


def _name(text: str) -> str:
    if not _NAME_TEXT.fullmatch(text):
        raise UnfitError(shown(text))
    if text in NAMES:
        raise UnfitError(f"{shown(text)}, the name of an effect", "another name")
    return text


def _column_name(text: str) -> str:
    if text in _COLUMNS or text.startswith(_PREFIXES):
        raise UnfitError(f"{shown(text)}, which is a column of measurements of its own", "another name")
    return _name(text)


def _direction(vector: tuple[float, ...]) -> Vector:
    """Return a vector scaled to unit length; one that has it, to rounding, is not changed."""
    try:
        return unit_vector(vector)
    except ValueError as error:
        raise UnfitError(str(error)) from None


def _squarable(number: float) -> float:
    if not number < limits.NUMBER:
        raise UnfitError
    return number


def _noise_in(dimension: Dimension, length: str, own: float) -> Kind[float]:
    """Return the kind of a noise: a number in the file's unit, whose internal value is `own`, or a text with a unit."""

    def read(value: Any) -> float:
        if isinstance(value, str):
            try:
                number = typed_quantity(value, dimension, length, own)
            except UnitError:
                raise UnfitError from None
        else:
            number = NUMBER.read(value) * own
        if not 1e-100 <= number <= 1e100:  # beyond, its square or the inverse of its square is no number
            raise UnfitError
        return number

    return Kind(f'a positive number, or one with its unit, such as "{_SUCH_NOISE[dimension]}"', read)


_SUCH_NOISE = {LENGTH: "2 um", ANGLE: "0.5 arcsec"}


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise UnfitError(None, "the lower number first, then a higher one")
    return pair


def _scaled(factor: float) -> Any:
    """Return the function that brings a number, or several, to internal units."""

    def step(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(step, value))
        if not math.isfinite(value * factor):
            raise UnfitError("a number beyond floating point")
        return value * factor

    return step


def unit_of(dimension: Dimension, example: str) -> Kind[str]:
    """Return how the name of a unit is read: one name, no product, that measures a dimension."""
    wanted = f"a unit of {dimension}, such as {example}"

    def check(text: str) -> str:
        text = text.strip()
        try:
            unit = parse_unit(text)
        except UnitError as error:
            raise UnfitError(error.found, error.expected) from None
        if unit.dimension != dimension:
            raise UnfitError(f"{shown(text)}, which measures {unit.dimension}")
        if re.search(r"[*/^]", text):
            raise UnfitError(f"{shown(text)}, a product of units", f"one name, such as {example}")
        return text

    return Kind(wanted, lambda value: check(TEXT.read(value)))


def _texts(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise UnfitError
    return tuple(map(TEXT.read, value))


def _joint_type(value: Any) -> str:
    if not isinstance(value, str):
        raise UnfitError
    if value not in JOINT_TYPES:
        raise UnfitError(shown(value), suggested_type(value))
    return value


def _yes_or_no(value: Any) -> bool:
    if not isinstance(value, bool):
        raise UnfitError
    return value


def _word(value: Any) -> str:
    return str(value) if type(value) is int else TEXT.read(value)


def _tables(value: Any) -> Sequence[Any]:
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise UnfitError
    return value


_WORD = Kind("a text in quotes, or a whole number", _word)
_ENTRIES = Kind('a list of tables, such as [{ run = "3", why = "clouds" }]', _tables)
_TITLE = TEXT.then(_title)
_NOTED = Kind("a text in quotes, or a date", _noted).then(_title)
_RULE = "a name of letters, digits, '_', '-' and '+', at most 60"
PLACE_NAME = TEXT.then(_name, _RULE)
"""What may be the name of a target."""
JOINT_NAME = TEXT.then(_column_name, _RULE)
"""What may be the name of a joint, which is that of its column, too."""


def _point(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if not max(map(abs, numbers)) < limits.NUMBER:
        raise UnfitError(
            f"numbers of {limits.NUMBER:g} and more", "three numbers whose squares can be added up"
        )
    return numbers


_POINT: Kind[Vector] = VECTOR.then(_point)
_ORIGIN: Vector = (0.0, 0.0, 0.0)
_Z: Vector = (0.0, 0.0, 1.0)
_DIRECTION: Kind[Vector] = VECTOR.then(_direction)
_PARAMETER_UNIT = Kind('a unit in quotes, such as "arcsec"', TEXT.read)
_YES_OR_NO = Kind("true or false", _yes_or_no)
_TEXTS = Kind('a list of texts, such as ["target"]', _texts)
_JOINT_TYPE = Kind(listed(JOINT_TYPES), _joint_type)
_JOINTS = Kind('the names of its joints, such as ["A", "C"], the first one from the bed first', _texts)


# blocks ------------------------------------------------------------------------------------------------------------


def _measured(top: Table, length: str, per_radian: float) -> Measured:
    table = top.sub("measured", _KEYS["measured"], missing=_MISSING["measured"])
    kind = table.get("kind", one_of(tuple(MEASURANDS)))
    measurand = MEASURANDS[kind]
    frame = table.get("frame", one_of(("machine", "free")))
    if "from" in table and not measurand.has_origin:
        raise table.error("from", f"given together with kind = {kind!r}", "it with kind = 'distance' only")
    origin = table.get("from", _POINT) if measurand.has_origin else None
    has_axis = measurand.line == "about"
    if "about" in table and not has_axis:
        raise table.error("about", f"given together with kind = {kind!r}", "it with kind = 'angle' only")
    about = table.get("about", _DIRECTION) if has_axis else None
    own = per_radian if measurand.dimension == ANGLE else 1.0
    noise = table.get("noise", _noise_in(measurand.dimension, length, own), None)
    attitude_noise = table.get("attitude_noise", _noise_in(ANGLE, length, per_radian), None)
    if attitude_noise is not None and not measurand.is_pose:
        raise table.error(
            "attitude_noise", f"given together with kind = {kind!r}", "it with kind = 'pose' only"
        )
    if measurand.is_pose and (noise is None) != (attitude_noise is None):
        given, lacking = (
            ("noise", "attitude_noise") if attitude_noise is None else ("attitude_noise", "noise")
        )
        raise table.error(lacking, f"missing, while {given} is stated", "both of them, or neither")
    correlation = table.get("correlation", _correlation(len(measurand.components)), None)
    if correlation is not None and measurand.is_direction:
        raise table.error("correlation", f"given together with kind = {kind!r}", "it with another kind")
    if "instrument" in table and "branch" not in top:
        raise table.error("instrument", "given without [[branch]]", "it with blocks [[branch]] only")
    instrument = table.get("instrument", one_of(BRANCHES), BRANCHES[0])
    entries = table.get("set_aside", _ENTRIES) if "set_aside" in table else ()
    set_aside = entries_of(entries, table.file, f"{table.place}, set_aside")
    return Measured(kind, frame, origin, noise, attitude_noise, correlation, about, instrument, set_aside)


def entries_of(contents: Sequence[dict[str, Any]], file: str, place: str) -> tuple[SetAside, ...]:
    """Return the entries of ``set_aside`` that tables describe.

    Raises
    ------
    InputFileError
    """
    found = []
    for number, content in enumerate(contents, 1):
        entry = Table(file, f"{place} {number}", content, tuple(SetAside.__dataclass_fields__))
        said = {
            key: entry.get(key, _WORD if key in {"rows", "run"} else TEXT) for key in content if key != "back"
        }
        with in_file(entry.file, entry.place):
            found.append(SetAside(**said, back=entry.get("back", _YES_OR_NO, False)))
    return tuple(found)


def _correlation(m: int) -> Kind[tuple[tuple[float, ...], ...] | Literal["columns"]]:
    """Return the kind of a matrix of correlation coefficients of m components, or of the word for those by row."""

    def read(value: Any) -> tuple[tuple[float, ...], ...] | Literal["columns"]:
        if value == "columns" and m > 1:
            return "columns"
        rows = (
            tuple(tuple(map(float, map(NUMBER.read, row))) for row in value) if _is_square(value, m) else ()
        )
        if not rows or any(rows[i][j] != rows[j][i] or rows[i][i] != 1 for i in range(m) for j in range(m)):
            raise UnfitError
        try:
            np.linalg.cholesky(rows)
        except np.linalg.LinAlgError:
            raise UnfitError("a matrix that is not positive definite") from None
        return rows

    return Kind(
        f'{m} rows of {m} correlation coefficients, symmetric, with 1 on the diagonal, or "columns"', read
    )


def _is_square(value: Any, m: int) -> bool:
    lists = isinstance(value, list) and all(isinstance(row, list) for row in value)
    return lists and [len(row) for row in value] == [m] * m


def _joints(top: Table, per_radian: float) -> list[Joint]:
    joints = []
    for table in _named_blocks(top, "joint", MOST_JOINTS, JOINT_NAME):
        name = table.get("name", JOINT_NAME)
        kind = table.get("type", _JOINT_TYPE)
        scale = _scaled(per_radian if coordinate_dimension(kind) == ANGLE else 1.0)
        travel = PAIR.then(scale).then(_rising)
        period = POSITIVE.then(scale)
        joints.append(
            Joint(
                name=name,
                type=kind,
                axis=table.get("axis", _DIRECTION),
                point=table.get("point", _POINT, _ORIGIN),
                travel=table.get("travel", travel, None),
                period=table.get("period", period, None),
                encoder=table.get("encoder", one_of(ENCODERS), None),
                drive=table.get("drive", one_of(DRIVES), None),
                passive=_passive(table),
                counterbalance=table.get("counterbalance", _YES_OR_NO, False),
                coordinate=table.get("coordinate", TEXT, None),
                reading=table.get("reading", JOINT_NAME, None),
                reading_travel=_reading_travel(table, travel),
            )
        )
    return joints


def _reading_travel(table: Table, travel: Kind[tuple[float, float]]) -> tuple[float, float] | None:
    if "reading_travel" in table and not {"coordinate", "reading"} <= table.content.keys():
        raise table.error("reading_travel", "given without coordinate and reading", "travel")
    return table.get("reading_travel", travel, None)


def _of_branches(top: Table, joints: list[Joint], instrument: str) -> tuple[Joint, ...]:
    """Return the joints of a chain as they are; of two branches in the order from the instrument to the target."""
    if "branch" not in top:
        return tuple(joints)
    at = {joint.name: joint for joint in joints}
    found: dict[str, list[Joint]] = {}
    for number, block in enumerate(top.blocks("branch", len(BRANCHES)), start=1):
        table = Table(top.file, f"[[branch]] {number}", block, _KEYS["branch"])
        branch = table.get("name", one_of(BRANCHES))
        if branch in found:
            raise table.error("name", f"{shown(branch)} twice", "it once")
        found[branch] = []
        for name in table.get("joints", _JOINTS):
            if name not in at:
                elsewhere = any(joint.name == name for joint in joints)
                what = f"{shown(name)} twice" if elsewhere else f"no joint {shown(name)}"
                raise table.error("joints", what, "it once" if elsewhere else suggestion(name, list(at)))
            found[branch].append(replace(at.pop(name), branch=branch))
    if at:
        left = listed(list(at))
        raise InputFileError(
            top.file, "[[branch]]", f"none with {left}", "each joint in the joints of a branch"
        )
    inner = found.pop(instrument, [])
    return (*reversed(inner), *(joint for outer in found.values() for joint in outer))


def _passive(table: Table) -> bool:
    passive = table.get("passive", _YES_OR_NO, False)
    of_drive = [key for key in ("drive", "period") if key in table]
    of_drive += ["encoder"] if table.content.get("encoder") == "motor" else []
    if passive and of_drive:
        found = f"true, together with {of_drive[0]} = {table.content[of_drive[0]]!r}"
        raise table.error("passive", found, "one of the two: nothing drives a passive joint")
    return passive


def _on_legs(top: Table, per_radian: float) -> OnLegs:
    family = FAMILIES[top.get("family", one_of(tuple(FAMILIES)))]
    table = top.sub("geometry", family.keys, missing=_MISSING["geometry"])
    length = POSITIVE.then(_squarable, f"a positive number below {limits.NUMBER:g}")
    found: dict[str, Any] = {}
    for name, components in family.numbers.items():
        if len(components) == 1:
            found[name] = table.get(name, length)
        else:
            found[name] = table.get(name, _POINT, *([_ORIGIN] if hasattr(family, name) else []))
    if "home" in family.keys:
        found["home"] = table.get("home", _POINT)
    if "start" in family.keys:
        found["start"] = table.get("start", VECTOR.then(_scaled(per_radian)), None)
    return family(**found)


def _legs(kinematics: Kinematics) -> tuple[Joint, ...]:
    return tuple(Joint(name, kinematics.leg) for name in kinematics.legs)


def _targets(top: Table, measurand: Measurand, per_radian: float, *, closed: bool) -> tuple[Target, ...]:
    anywhere = measurand.has_axes and not measurand.moving  # where it is read does not matter
    if closed and "target" not in top:
        if anywhere:
            return (Target(PLATFORM, _Z),)
        if not measurand.moving:
            raise InputFileError(
                top.file, "[[target]]", "missing", "the direction on the platform that is seen"
            )
        return (Target(PLATFORM, _ORIGIN),)
    point = _POINT if measurand.moving else _DIRECTION
    found = []
    for table in _named_blocks(top, "target", MOST_TARGETS, PLACE_NAME):
        if "attitude" in table and not measurand.has_attitude:
            given = f"given together with kind = {measurand.kind!r}"
            raise table.error("attitude", given, "it with kind = 'pose' or 'orientation' only")
        attitude = table.get("attitude", VECTOR.then(_scaled(per_radian)), _ORIGIN)
        place = table.get("point", point, *([_Z] if anywhere else []))
        if "zero" in table and not measurand.has_zero:
            given = f"given together with kind = {measurand.kind!r}"
            raise table.error("zero", given, "it with kind = 'angle' or 'inclination' only")
        zero = table.get("zero", NUMBER.then(lambda x: x * per_radian), 0.0)
        found.append(Target(table.get("name", PLACE_NAME), place, attitude, zero))
    return tuple(found)


def _named_blocks(top: Table, key: str, most: int, kind: Kind[str]) -> list[Table]:
    """Return the blocks `[[key]]`, each with its name as its place where it has a valid one."""
    tables = []
    for number, block in enumerate(top.blocks(key, most, missing=_MISSING[key]), start=1):
        try:
            place = f"{key} {kind.read(block.get('name'))}"
        except UnfitError:
            place = f"[[{key}]] {number}"
        tables.append(Table(top.file, place, block, _KEYS[key]))
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
    other = "joint" if twice in joints else "target"
    raise InputFileError(
        str(machine.file), f"{place}, name", f"{shown(twice)}, as another {other}", "a name of its own"
    )


def _estimate(top: Table, machine: Machine) -> tuple[str, ...]:
    if "estimate" not in top:
        return ()
    table = top.sub("estimate", _KEYS["estimate"])
    entries = table.get("parameters", _TEXTS)
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
        own = {x: value for x, value in entry.items() if x not in inner}
        if not own and inner:
            continue
        for x in own:
            if x not in {"prior", "bounds"}:
                raise table.error(x, "unknown key", "prior or bounds")
        with in_file(table.file, table.place):
            known = read_known(machine, key, own)
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
    table = Table(file, where, block, _KEYS["effect"])
    name = table.get("name", TEXT)
    place = _place(table, machine)
    hold = {
        key: table.convert(f"hold.{key}", value, NUMBER)
        for key, value in table.get("hold", TABLE, {}).items()
    }
    own = next((key for key in _OWN if key in table), None)
    with in_file(file, where):
        if name in NAMES:
            if own is not None:
                raise table.error(
                    own, f"given for {shown(name)}, which the catalogue has", f"another name, or no {own}"
                )
            effect = catalogue_effect(machine, name, place, hold)
        elif own is None:
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
        key: table.convert(f"parameters.{key}", value, _PARAMETER_UNIT)
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
    """Yield what is stated of each effect; those at a place may stand in a table of it, as TOML reads dots."""
    places = {*(joint.name for joint in machine.joints), *(target.name for target in machine.targets)}
    for name, entry in content.items():
        tables = isinstance(entry, dict) and entry and all(isinstance(x, dict) for x in entry.values())
        inner = entry if tables or (name in places and isinstance(entry, dict)) else None
        for key, own in [(name, entry)] if inner is None else [(f"{name}.{x}", inner[x]) for x in inner]:
            if not isinstance(own, dict):
                place, expected = f"[plausibility], {shown(key)[1:-1]}", f"one such as {_PLAUSIBLE}"
                raise InputFileError(file, place, "no table", expected)
            with in_file(file, f"[plausibility], {shown(key)[1:-1]}"):
                stated = stated_plausibility(machine, key, own)
            yield key, stated
