"""The keys of a machine file: what each may hold, which attribute it is, and how it is written.

Joints, targets and what is measured are read and written by the tables at the end: a further key is a row there.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from rodgen import limits
from rodgen.data.units import ANGLE, LENGTH, Dimension, UnitError, parse_unit, typed_quantity
from rodgen.errors import listed, shown
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.files.toml import (
    NUMBER,
    PAIR,
    POSITIVE,
    REQUIRED,
    TABLE,
    TEXT,
    VECTOR,
    Kind,
    Table,
    UnfitError,
    of_type,
    one_of,
    several,
)
from rodgen.machines.measured import MEASURANDS, READING_COLUMNS, Measurand
from rodgen.machines.parts import BRANCHES, DRIVES, ENCODERS, JOINT_TYPES, Vector, suggested_type, unit_vector

# kinds of values ---------------------------------------------------------------------------------------------------

_COLUMNS = READING_COLUMNS | {"t", "load", "run", "target"}
_PREFIXES = ("u_", "dir_", "v_", "T_")
_NAME_TEXT = re.compile(r"[^\W_](?:[\w+-]|(?<=[\w+-]) (?=[\w+-])){0,59}")


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


def squarable(number: float) -> float:
    """Return a number whose square can be added up."""
    if not number < limits.NUMBER:
        raise UnfitError
    return number


def noise_in(dimension: Dimension, length: str, unit: float) -> Kind[float]:
    """Return the kind of a noise: a number, whose internal value is `unit`, or a text with a unit."""

    def read(value: Any) -> float:
        if isinstance(value, str):
            try:
                number = typed_quantity(value, dimension, length, unit)
            except UnitError:
                raise UnfitError from None
        else:
            number = NUMBER.read(value) * unit
        if not 1e-100 <= number <= 1e100:  # beyond, its square or the inverse of its square is no number
            raise UnfitError
        return number

    return Kind(f'a positive number, or one with its unit, such as "{_SUCH_NOISE[dimension]}"', read)


_SUCH_NOISE = {LENGTH: "2 um", ANGLE: "0.5 arcsec"}


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise UnfitError(None, "the lower number first, then a higher one")
    return pair


def scaled(factor: float) -> Any:
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


def _joint_type(value: Any) -> str:
    if not isinstance(value, str):
        raise UnfitError
    if value not in JOINT_TYPES:
        raise UnfitError(shown(value), suggested_type(value))
    return value


def _word(value: Any) -> str:
    return str(value) if type(value) is int else TEXT.read(value)


WORD = Kind("a text in quotes, or a whole number", _word)
ENTRIES = several(TABLE, 'a list of tables, such as [{ run = "3", why = "clouds" }]')
TITLE = TEXT.then(_title)
NOTED = Kind("a text in quotes, or a date", _noted).then(_title)
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


POINT: Kind[Vector] = VECTOR.then(_point)
ORIGIN: Vector = (0.0, 0.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
DIRECTION: Kind[Vector] = VECTOR.then(_direction)
PARAMETER_UNIT = Kind('a unit in quotes, such as "arcsec"', TEXT.read)
YES_OR_NO = of_type(bool, "true or false")
TEXTS = several(TEXT, 'a list of texts, such as ["target"]')
JOINT_TYPE = Kind(listed(JOINT_TYPES), _joint_type)
JOINTS = several(TEXT, 'the names of its joints, such as ["A", "C"], the first one from the bed first')


def correlation_of(m: int) -> Kind[tuple[tuple[float, ...], ...] | Literal["columns"]]:
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


# values as text ----------------------------------------------------------------------------------------------------


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


def toml_string(text: str) -> str:
    """Return a TOML string. JSON's escapes are valid in TOML, which wants DEL escaped too."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_key(name: str) -> str:
    """Return a name as a key: in quotes where it must be."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


class Scaled(NamedTuple):
    """A number, or several, in internal units, and the factor that brings those of the file there."""

    value: Any
    factor: float


def written(value: Any) -> str:
    """Return a value as TOML: a truth value, a text, a number, `Scaled`, or a sequence or mapping of these."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return toml_string(value)
        case Scaled(tuple(several), factor):
            return written([Scaled(x, factor) for x in several])
        case Scaled(number, factor):
            return decimal(number, factor)
        case Mapping():
            return f"{{ {', '.join(f'{toml_key(name)} = {written(x)}' for name, x in value.items())} }}"
        case Sequence():
            return f"[{', '.join(map(written, value))}]"
    return decimal(value)


# keys --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Key:
    """A key of a block, with the attribute that it says."""

    name: str
    kind: Kind[Any]
    default: Any = REQUIRED
    """Value where the key is missing; then it is not written either."""
    factor: float = 1.0
    """Internal value of 1 in the file."""
    attribute: str = ""
    """Where not of the key's name."""
    refused: str = ""
    """What is expected where the key may not stand with what is measured."""
    always: bool = False
    """Whether it is written where it has its default, too."""


def read_keys(table: Table, keys: Sequence[Key], kind: str = "") -> dict[str, Any]:
    """Return the attributes that the keys of a block say.

    Parameters
    ----------
    kind : str
        What is measured, for error messages.

    Raises
    ------
    InputFileError
    """
    values = {}
    for key in keys:
        if key.refused and key.name in table:
            raise table.error(key.name, f"given together with kind = {kind!r}", key.refused)
        values[key.attribute or key.name] = table.get(key.name, key.kind, key.default)
    return values


def written_keys(thing: Any, keys: Sequence[Key]) -> Iterator[str]:
    """Yield the lines of a block that say the attributes of a joint, a target or what is measured."""
    for key in keys:
        value = getattr(thing, key.attribute or key.name)
        if value is not None and (key.always or value != key.default):
            yield f"{key.name} = {written(value if key.factor == 1.0 else Scaled(value, key.factor))}"


def joint_keys(factor: float) -> tuple[Key, ...]:
    """Return the keys of a joint, whose coordinate has this internal value of 1 in the file."""
    scale = scaled(factor)
    travel = PAIR.then(_rising).then(scale)
    return (
        Key("name", JOINT_NAME),
        Key("type", JOINT_TYPE),
        Key("axis", DIRECTION),
        Key("point", POINT, ORIGIN, always=True),
        Key("travel", travel, None, factor),
        Key("period", POSITIVE.then(scale), None, factor),
        Key("encoder", one_of(ENCODERS), None),
        Key("drive", one_of(DRIVES), None),
        Key("passive", YES_OR_NO, False),
        Key("counterbalance", YES_OR_NO, False),
        Key("reading", JOINT_NAME, None),
        Key("coordinate", TEXT, None),
        Key("reading_travel", travel, None, factor),
    )


def target_keys(measurand: Measurand, per_radian: float) -> tuple[Key, ...]:
    """Return the keys of a target."""
    scale = scaled(per_radian)
    # where attitudes alone are read, the place does not matter
    place = Z if measurand.has_axes and not measurand.moving else REQUIRED
    attitude = "" if measurand.has_attitude else "it with kind = 'pose' or 'orientation' only"
    zero = "" if measurand.has_zero else "it with kind = 'angle' or 'inclination' only"
    return (
        Key("name", PLACE_NAME),
        Key("point", POINT if measurand.moving else DIRECTION, place, always=True),
        Key("attitude", VECTOR.then(scale), ORIGIN, per_radian, refused=attitude),
        Key("zero", NUMBER.then(scale), 0.0, per_radian, refused=zero),
    )


def measured_keys(measurand: Measurand, length: str, per_radian: float, *, branches: bool) -> tuple[Key, ...]:
    """Return the keys of what is measured."""
    unit = per_radian if measurand.dimension == ANGLE else 1.0
    origin = "" if measurand.has_origin else "it with kind = 'distance' only"
    about = "" if measurand.line == "about" else "it with kind = 'angle' only"
    attitude = "" if measurand.is_pose else "it with kind = 'pose' only"
    correlation = "it with another kind" if measurand.is_direction else ""
    noise, attitude_noise = noise_in(measurand.dimension, length, unit), noise_in(ANGLE, length, per_radian)
    return (
        Key("kind", one_of(tuple(MEASURANDS))),
        Key("frame", one_of(("machine", "free"))),
        Key("from", POINT, None if origin else REQUIRED, attribute="origin", refused=origin),
        Key("about", DIRECTION, None if about else REQUIRED, refused=about),
        Key("noise", noise, None, unit),
        Key("attitude_noise", attitude_noise, None, per_radian, refused=attitude),
        Key("correlation", correlation_of(len(measurand.components)), None, refused=correlation),
        Key("instrument", one_of(BRANCHES), BRANCHES[0], always=branches),
        Key("set_aside", ENTRIES, ()),
    )
