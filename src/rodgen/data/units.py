"""The meaning of a unit's text: its dimension, and its factor to internal units.

Internal units are the machine file's unit of length, the radian, the second, the kelvin (for differences) and the
newton. Mass is force over acceleration, so these five make up every unit of mechanics; other base units (ampere,
candela, count) keep the name and size that Pint gives them.

A unit's text consists of unit names, products, quotients and exponents of one digit. A table here holds the everyday
names; Pint knows all others and is imported only when one of them occurs, because it takes longer to load than a model.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal, TypeAlias

from rodgen.errors import UnexpectedError, shown

Quantity: TypeAlias = Literal["length", "angle", "rate", "time"]
"""What a table's column measures; a rate is an angle per time."""

ARCSEC = math.pi / 648000
"""An arc second in radians."""

_BASES = ("angle", "length", "force", "temperature", "time")
"""Order of the factors of a display unit: arcsec/mm, mm/K."""

_BELOW = ("force", "length", "temperature", "time", "angle")
"""Order of its divisors: arcsec/N/mm."""

_NUMBER_AND_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)

MICROMETRES = {"mm": 1e3, "cm": 1e4, "m": 1e6}
FEW_MICROMETRES = 100.0
"""Lengths below this many are shown in micrometres."""


class UnitError(UnexpectedError):
    """A unit that cannot be used: what was found, and what was expected."""


@dataclass(frozen=True)
class Dimension:
    """A product of powers of length, angle, time, temperature, force, and other base quantities.

    Examples
    --------
    >>> (ANGLE / (FORCE * LENGTH)).powers
    (('angle', Fraction(1, 1)), ('force', Fraction(-1, 1)), ('length', Fraction(-1, 1)))
    >>> print(ANGLE / (FORCE * LENGTH))
    angle/force/length
    """

    powers: tuple[tuple[str, Fraction], ...] = ()
    """Names with their exponents, sorted; none is zero."""

    @classmethod
    def of(cls, powers: Iterable[tuple[str, int | Fraction]]) -> Dimension:
        """Return the product of powers; names may repeat, exponents may be zero."""
        total: dict[str, Fraction] = {}
        for name, exponent in powers:
            total[name] = total.get(name, Fraction(0)) + exponent
        return cls(tuple(sorted((name, exponent) for name, exponent in total.items() if exponent)))

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension.of(self.powers + other.powers)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, exponent: int | Fraction) -> Dimension:
        return Dimension.of((name, power * exponent) for name, power in self.powers)

    def __getitem__(self, name: str) -> Fraction:
        return dict(self.powers).get(name, Fraction(0))

    def __str__(self) -> str:
        return _product({name: name for name, _ in self.powers}, self) if self.powers else "a plain number"

    def fits(self, other: Dimension) -> bool:
        """Return whether quantities of the two dimensions may be added: an angle in radians is a plain number.

        Examples
        --------
        >>> (LENGTH * ANGLE).fits(LENGTH), LENGTH.fits(ANGLE)
        (True, False)
        """
        return self._without_angle == other._without_angle

    @property
    def _without_angle(self) -> tuple[tuple[str, Fraction], ...]:
        return tuple((name, power) for name, power in self.powers if name != "angle")


ONE = Dimension()
LENGTH, ANGLE, TIME, TEMPERATURE, FORCE = (
    Dimension.of([(name, 1)]) for name in ("length", "angle", "time", "temperature", "force")
)


@dataclass(frozen=True)
class Unit:
    """A unit of measurement."""

    text: str
    """The unit as written."""
    dimension: Dimension
    scale: Fraction = Fraction(1)
    """Its size in metres, radians, seconds, kelvins and newtons, over the `turns`-th power of pi."""
    turns: int = 0
    """The power of pi in its size: a degree is exactly pi/180."""
    zero: Fraction | None = None
    """Zero of a temperature scale (degC, degF), in degrees Celsius; None for every other unit. The factor of such a
    unit is that of a difference."""

    def factor(self, length_unit: str = "mm") -> float:
        """Return the factor from this unit to internal units.

        Parameters
        ----------
        length_unit : str
            The machine's unit of length.

        Examples
        --------
        >>> parse_unit("inch").factor("mm"), parse_unit("um/m").factor("mm"), parse_unit("deg").factor("mm")
        (25.4, 1e-06, 0.017453292519943295)
        """
        power = self.dimension["length"]
        length = parse_unit(length_unit).scale if power else Fraction(1)
        if power.denominator == 1:
            return _size(self.scale / length**power.numerator, self.turns)
        return _size(self.scale, self.turns) / math.pow(length, power)


def parse_unit(text: str) -> Unit:
    """Return the unit of its text.

    Parameters
    ----------
    text : str
        Unit names that Pint knows, joined by ``*`` and ``/``, with exponents of one digit; ``1`` for no unit.

    Returns
    -------
    Unit

    Raises
    ------
    UnitError
        When it is not such a unit; also for logarithmic units (dB), which have no factor.

    Examples
    --------
    >>> unit = parse_unit("arcsec/N/m")
    >>> print(unit.dimension)
    angle/force/length
    >>> parse_unit("arcsec/(N*m)")
    Traceback (most recent call last):
    rodgen.data.units.UnitError: unit 'arcsec/(N*m)' with parentheses; expected 'arcsec/N/m', without them
    """
    try:
        return _read(text.strip())
    except _UnknownUnitError as error:
        raise _explained(error.text) from None


@functools.lru_cache(maxsize=1024)
def unit_factor(text: str, length_unit: str = "mm") -> tuple[float, Dimension]:
    """Return the factor from a unit to internal units, and its dimension.

    Parameters
    ----------
    text : str
        The unit, as for :func:`parse_unit`.
    length_unit : str
        The machine's unit of length.

    Examples
    --------
    >>> factor, dimension = unit_factor("mm/kN", "mm")
    >>> factor, str(dimension)
    (0.001, 'length/force')
    """
    unit = parse_unit(text)
    return unit.factor(length_unit), unit.dimension


def readable(unit: str, size: float) -> tuple[float, str]:
    """Return a factor and the unit in which people read a length: micrometres where millimetres begin with zeros.

    Parameters
    ----------
    unit : str
        What the length, or a length by something, is in.
    size : float
        The largest number that is shown.

    Examples
    --------
    >>> readable("mm", 0.0123), readable("mm", 12.3), readable("m/K", 2e-6), readable("arcsec", 0.01)
    ((1000.0, 'um'), (1.0, 'mm'), (1000000.0, 'um/K'), (1.0, 'arcsec'))
    """
    length, by, denominator = unit.partition("/")
    factor = MICROMETRES.get(length)
    if factor is None or not 0 < abs(size) * factor < FEW_MICROMETRES:
        return 1.0, unit
    return factor, f"um{by}{denominator}"


def is_unit(text: str) -> bool:
    """Return whether :func:`parse_unit` accepts a text.

    Examples
    --------
    >>> is_unit("mm/K"), is_unit("of 5")
    (True, False)
    """
    try:
        _read(text.strip())
    except UnitError:
        return False
    return True


def conversion_factor(unit: str, quantity: Quantity, target: str) -> float:
    """Return the factor from one unit to another that measures the same quantity.

    Parameters
    ----------
    unit, target : str
        As for :func:`parse_unit`.
    quantity : {"length", "angle", "rate", "time"}
        What both must measure. A length may hold angles (``mm/rad``), which are plain numbers; but an angle is not a
        plain number: ``angle [%]`` is an error.

    Raises
    ------
    UnitError
        When one is not a unit, or measures something else.

    Examples
    --------
    >>> conversion_factor("inch", "length", "mm"), conversion_factor("deg", "angle", "arcmin")
    (25.4, 60.0)
    """
    one, other = _unit_of(unit, quantity), _unit_of(target, quantity)
    return _size(one.scale / other.scale, one.turns - other.turns)


def number_and_unit(text: str) -> tuple[float, str] | None:
    """Return a number and its unit, which may be empty; None where the text does not begin with a finite number.

    Examples
    --------
    >>> number_and_unit("-2.5e-3 um"), number_and_unit("12"), number_and_unit("um")
    ((-0.0025, 'um'), (12.0, ''), None)
    """
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        return None
    return float(match[1]), match[2]


def typed_quantity(text: str, dimension: Dimension, length_unit: str, own: float = 1.0) -> float:
    """Return a number that was typed with its unit in internal units.

    Parameters
    ----------
    text : str
        Such as ``"2 um"``.
    dimension : Dimension
        What it must measure.
    length_unit : str
        That of internal units.
    own : float
        Internal value of the unit that a number without one has.

    Raises
    ------
    UnitError
        When it is no number, or its unit is unknown or of another dimension.

    Examples
    --------
    >>> typed_quantity("2 um", LENGTH, "mm")
    0.002
    """
    parts = number_and_unit(text)
    if parts is None:
        raise UnitError("no such number", "a number with its unit")
    number, typed = parts
    if not typed:
        return number * own
    unit = parse_unit(typed)
    if unit.dimension != dimension:
        raise UnitError(
            f"the unit {shown(typed)}", f"one such as {display_unit(dimension, length_unit).text}"
        )
    return number * unit.factor(length_unit)


def display_unit(dimension: Dimension, length_unit: str = "mm", angle_unit: str = "arcsec") -> Unit:
    """Return the unit in which a number of this dimension is shown.

    Parameters
    ----------
    dimension : Dimension
    length_unit, angle_unit : str
        Units of length and of angle; times are in seconds, temperatures in kelvins, forces in newtons.

    Examples
    --------
    >>> display_unit(ANGLE / (FORCE * LENGTH)).text, display_unit(ONE / TEMPERATURE).text, display_unit(ONE).text
    ('arcsec/N/mm', '1/K', '1')
    >>> display_unit(ANGLE, angle_unit="deg").factor("mm")
    0.017453292519943295
    """
    units = {
        "angle": parse_unit(angle_unit),
        "length": parse_unit(length_unit),
        "force": parse_unit("N"),
        "temperature": parse_unit("K"),
        "time": parse_unit("s"),
    }
    as_mass = Dimension.of(
        ("mass", power) if base == "force" else (base, power)
        for base, power in (dimension * (LENGTH / TIME**2) ** dimension["force"]).powers
    )
    if sum(abs(p) for _, p in as_mass.powers) < sum(abs(p) for _, p in dimension.powers):
        dimension = as_mass  # kg reads better than N*s**2/mm
    kilogram = parse_unit("kg")
    sizes = units | {"mass": kilogram}
    names = {base: sizes[base].text if base in sizes else base for base, _ in dimension.powers}
    scale, turns, total = Fraction(1), 0, ONE
    for base, power in dimension.powers:
        unit = sizes.get(base)
        total *= (unit.dimension if unit else Dimension.of([(base, 1)])) ** power
        if unit and power.denominator == 1:
            scale *= unit.scale**power.numerator
            turns += unit.turns * power.numerator
        elif unit:
            scale *= Fraction(_size(unit.scale, unit.turns) ** float(power))
    return Unit(_product(names, dimension), total, scale, turns)


# reading a unit -------------------------------------------------------------------------------------------

_NAME = r"[^\W\d_]\w*|°[^\W\d_]*|%|1"
_FACTOR = rf"(?:{_NAME})(?:\s*(?:\*\*|\^)\s*-?\d)?"
_TEXT = re.compile(rf"{_FACTOR}(?:\s*[*/]\s*{_FACTOR})*")
_EACH = re.compile(rf"(?P<sign>[*/]?)\s*(?P<name>{_NAME})(?:\s*(?:\*\*|\^)\s*(?P<exponent>-?\d))?\s*")
_LONGEST = 60
_SPELLINGS = str.maketrans({"μ": "µ", "º": "°", "·": "*", "⋅": "*", "×": "*", "²": "^2", "³": "^3"})

_PI_PARTS = {
    **dict.fromkeys(("turn", "revolution"), Fraction(2)),
    **dict.fromkeys(("deg", "°", "degree"), Fraction(1, 180)),
    "gon": Fraction(1, 200),
    "arcmin": Fraction(1, 10800),
    "arcsec": Fraction(1, 648000),
    "mas": Fraction(1, 648000000),
}
_SHORT = {"rev": "revolution"}
"""Names that Pint does not know."""
_EVERYDAY: dict[str, tuple[Dimension, Fraction]] = {
    **dict.fromkeys(("1", "dimensionless"), (ONE, Fraction(1))),
    **dict.fromkeys(("%", "percent"), (ONE, Fraction(1, 100))),
    "ppm": (ONE, Fraction(1, 10**6)),
    **dict.fromkeys(("m", "meter", "metre"), (LENGTH, Fraction(1))),
    "cm": (LENGTH, Fraction(1, 100)),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), (LENGTH, Fraction(1, 1000))),
    **dict.fromkeys(("um", "µm", "micron", "micrometer", "micrometre"), (LENGTH, Fraction(1, 10**6))),
    "nm": (LENGTH, Fraction(1, 10**9)),
    **dict.fromkeys(("inch", "in"), (LENGTH, Fraction(254, 10000))),
    "ft": (LENGTH, Fraction(3048, 10000)),
    **dict.fromkeys(("rad", "radian"), (ANGLE, Fraction(1))),
    "mrad": (ANGLE, Fraction(1, 1000)),
    **dict.fromkeys(("urad", "µrad"), (ANGLE, Fraction(1, 10**6))),
    **dict.fromkeys(("s", "second"), (TIME, Fraction(1))),
    "ms": (TIME, Fraction(1, 1000)),
    **dict.fromkeys(("min", "minute"), (TIME, Fraction(60))),
    **dict.fromkeys(("h", "hour"), (TIME, Fraction(3600))),
    **dict.fromkeys(("K", "kelvin", "degC", "°C", "delta_degC"), (TEMPERATURE, Fraction(1))),
    "mK": (TEMPERATURE, Fraction(1, 1000)),
    **dict.fromkeys(("N", "newton"), (FORCE, Fraction(1))),
    "kN": (FORCE, Fraction(1000)),
    "kg": (FORCE * TIME**2 / LENGTH, Fraction(1)),
}
UNITS = (*_EVERYDAY, *_PI_PARTS)
"""Names of units, for completion; every unit that Pint knows can be read."""
_ZEROS = {
    **dict.fromkeys(("degC", "°C", "celsius", "degree_Celsius"), Fraction(0)),
    **dict.fromkeys(("degF", "°F", "fahrenheit", "degree_Fahrenheit"), Fraction(-160, 9)),
}


_QUANTITIES = {"length": LENGTH, "angle": ANGLE, "rate": ANGLE / TIME, "time": TIME}
_EXAMPLES = {
    "length": "a unit of length, such as mm, um, m or inch",
    "angle": "a unit of angle, such as deg, rad, arcsec or mrad",
    "rate": "a unit of angle per time, such as deg/s, rad/s or rev/min",
    "time": "a unit of time, such as s, ms or min",
}


class _UnknownUnitError(UnitError):
    """A text that is not a unit, or has a name in it that is not."""

    def __init__(self, text: str) -> None:
        super().__init__(f"unknown unit {shown(text)}", "a unit such as mm, arcsec, N or mm/K")
        self.text = text


@functools.lru_cache(maxsize=1024)
def _read(written: str) -> Unit:
    text = written.translate(_SPELLINGS)
    if not text:
        raise UnitError("no unit", "one such as mm, arcsec or 1/K, or 1 for a plain number")
    if len(text) > _LONGEST or not _TEXT.fullmatch(text):
        raise _UnknownUnitError(text)
    dimension, scale, turns = ONE, Fraction(1), 0
    for part in _EACH.finditer(text):
        exponent = int(part["exponent"] or 1) * (-1 if part["sign"] == "/" else 1)
        one = _named(part["name"])
        dimension *= one.dimension**exponent
        scale *= one.scale**exponent
        turns += one.turns * exponent
    unit = Unit(written, dimension, scale, turns, _ZEROS.get(text))
    try:
        usable = math.isfinite(_size(scale, turns)) and _size(scale, turns) > 0
    except OverflowError:
        usable = False
    if not usable:
        raise UnitError(f"unit {shown(text)}, whose size is beyond floating point", "a unit of a usual size")
    return unit


def _named(name: str) -> Unit:
    name = _SHORT.get(name, name)
    if name in _PI_PARTS:
        return Unit(name, ANGLE, _PI_PARTS[name], 1)
    if name in _EVERYDAY:
        return Unit(name, *_EVERYDAY[name])
    return _by_pint(name)


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


_BY_PINT = {
    "meter": LENGTH,
    "radian": ANGLE,
    "second": TIME,
    "kelvin": TEMPERATURE,
    "gram": FORCE * TIME**2 / LENGTH,
}


def _by_pint(name: str) -> Unit:
    try:
        registry = _registry()
    except ImportError:
        raise UnitError(
            f"unknown unit {shown(name)}",
            "another one, or Pint, which knows more: pip install rodgen[tables]",
        ) from None
    try:
        parsed = registry.parse_units(name.replace("°", "deg") if len(name) > 1 else name)
        size, root = registry.get_root_units(parsed)
    except Exception:  # Pint answers a bad unit with AssertionError, ValueError, tokenize errors and its own
        raise _UnknownUnitError(name) from None
    if not all(registry._units[n].is_multiplicative for n in parsed._units) and name not in _ZEROS:
        raise UnitError(f"logarithmic unit {shown(name)}", "a linear one")
    dimension, scale = ONE, _shortest(float(size))
    for base, power in root._units.items():
        power = Fraction(power).limit_denominator(10)
        dimension *= _BY_PINT.get(base, Dimension.of([(base, 1)])) ** power
        if base == "gram":
            scale *= (
                Fraction(1, 1000) ** power.numerator
                if power.denominator == 1
                else _shortest(1e-3 ** float(power))
            )
    return Unit(name, dimension, scale)


def _shortest(size: float) -> Fraction:
    """Return the shortest decimal within rounding of a size: Pint's pound is 0.45359237000000005 kg."""
    short = float(f"{size:.14g}")
    return Fraction(repr(short if abs(short / size - 1.0) < 5e-16 else size))


def _unit_of(text: str, quantity: Quantity) -> Unit:
    """Return the unit of its text, after checking that it measures the quantity."""
    try:
        unit = _read(text.strip())
    except _UnknownUnitError:
        raise _explained(text, quantity) from None
    if _measures(unit, quantity):
        return unit
    lower = text.lower()
    is_lower = lower != text and _is_unit_of(lower, quantity)
    raise UnitError(
        f"unit {shown(text)}, which is not a unit of {quantity}",
        f"{lower!r}, or another unit" if is_lower else _EXAMPLES[quantity],
    )


def _measures(unit: Unit, quantity: Quantity) -> bool:
    wanted = _QUANTITIES[quantity]
    return unit.dimension.fits(wanted) if quantity == "length" else unit.dimension == wanted


def _is_unit_of(text: str, quantity: Quantity | None) -> bool:
    return is_unit(text) and (quantity is None or _measures(_read(text), quantity))


def _explained(text: str, quantity: Quantity | None = None) -> UnitError:
    """Return the error for a text that is not a unit, with the nearest unit if there is one."""
    simple = re.sub(r"[()\s]", "", re.sub(r"/\(([^()/]*)\)", lambda m: "/" + m[1].replace("*", "/"), text))
    if simple != text and "(" in text and _is_unit_of(simple, quantity):
        return UnitError(f"unit {shown(text)} with parentheses", f"{simple!r}, without them")
    unknown = _UnknownUnitError(text)
    for variant in (re.sub(r"\s+", "*", text), text.lower(), text.upper(), text.strip("\"'")):
        if variant != text and _is_unit_of(variant, quantity):
            return UnitError(unknown.found, f"{variant!r}, or another unit")
    near = difflib.get_close_matches(text, _EVERYDAY | _PI_PARTS, n=1, cutoff=0.75)
    if near and _is_unit_of(near[0], quantity):
        return UnitError(unknown.found, f"{near[0]!r}, or another unit")
    return UnitError(unknown.found, _EXAMPLES[quantity] if quantity else unknown.expected)


def _size(scale: Fraction, turns: int) -> float:
    """Return scale·πⁿ with one rounding of π: a degree is math.pi/180."""
    return math.pow(math.pi, turns) * scale.numerator / scale.denominator if turns else float(scale)


def _product(names: dict[str, str], dimension: Dimension) -> str:
    """Return a product of powers as text: first the factors, then each divisor."""

    def order(bases: tuple[str, ...]) -> list[str]:
        return sorted(names, key=lambda n: (bases.index(n) if n in bases else len(bases), n))

    def power(base: str, exponent: Fraction) -> str:
        if exponent == 1:
            return names[base]
        return f"{names[base]}**{exponent if exponent.denominator == 1 else float(exponent)}"

    above = "*".join(power(base, dimension[base]) for base in order(_BASES) if dimension[base] > 0)
    below = "".join(f"/{power(base, -dimension[base])}" for base in order(_BELOW) if dimension[base] < 0)
    return (above or "1") + below
