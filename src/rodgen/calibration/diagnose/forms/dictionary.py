"""The terms that a form may consist of: functions of drivers that a formula can write.

A factor is a family of one or a few functions of one driver, such as a sine with its cosine; some have values that are
searched for: a period, a place. A term is a factor, or a product of two. Products of low functions of two drivers are
tried from the start; others are made in a search from what shows there already, times a function of a further driver.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.solve.starting_values import most_waves
from rodgen.data.drivers import Driver, Kind
from rodgen.data.observations import Observations
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.machine import Machine
from rodgen.machines.measured import READING_COLUMNS

HARMONICS = 12
"""Waves of a whole turn."""
DEGREE = 5
LEAST_WAVES, WAVES = 0.75, 25.0
"""Waves of any other length, over the range of the data; a drive's fine waves are in the catalogue."""
PLACES = 12
"""Where a step, a bend or a bump may be; between them it is looked for later."""
WIDTHS = (1 / 6, 1 / 16)
"""Of a bump, in ranges of the data."""
DECAYS = 9
"""Time constants, from a thirtieth of the duration to three times it."""
LARGEST = 1e100
"""Functions with values beyond are left out: their squares leave the range of a double."""
AT_ONCE = 1 << 18
"""Rows of functions that are evaluated together: few enough for the cache."""
PRODUCTS = 2
"""Harmonics that are multiplied by functions of other drivers."""
HARDLY_SEEN = 0.5
"""Part of a driver's rms, at most, that its mean is where a function times it hardly shows without it: what does show
is found first, and multiplied then."""
HIGHEST_IN_PRODUCT = 3
"""Degree of a polynomial that is a factor."""
MOST_DRIVERS = 24
"""Products are formed of at most this many drivers."""
_FIRST_MULTIPLIED: tuple[Kind, ...] = (
    "joint",
    "load",
    "time",
    "approach",
    "temperature",
    "column",
    "velocity",
)
"""Of which first, where there are more."""

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")
LETTERS: dict[Kind, str] = {
    "joint": "q",
    "approach": "s",
    "velocity": "v",
    "temperature": "T",
    "time": "t",
    "load": "F",
}
"""What a formula calls a driver; those of a joint at their own joint only."""
WORDS = frozenset({*LETTERS.values(), "pi"}) | FUNCTION_NAMES | READING_COLUMNS
"""What names in formulas cannot be."""


def _nameable(name: str) -> bool:
    return _IDENTIFIER.fullmatch(name) is not None and name not in WORDS


def drivers_of(o: Observations) -> list[Driver]:
    """Return the drivers that vary and that a formula can name: joint by joint, then those of the whole machine."""
    of_joints = sorted(o.drivers("joint", "approach", "velocity", "temperature"), key=lambda d: d.number or 0)
    every = [
        replace(driver, values=np.asarray(driver.values, float))
        for driver in (*of_joints, *o.drivers("time", "load", "column"))
        if word(driver, driver.joint, o.machine)
    ]
    return [driver for driver in every if len(driver.distinct) > 1 and np.isfinite(driver.span)]


def word(driver: Driver, place: str | None, machine: Machine) -> str | None:
    """Return what a formula at a place calls a driver; None where it has no word for it.

    A letter that is also the name of a joint stands in no formula.
    """
    if driver.kind == "column":
        return driver.name if _nameable(driver.name) else None
    letter: str | None = LETTERS[driver.kind]
    if letter in {joint.name for joint in machine.joints}:
        letter = None
    if driver.joint is None or (place == driver.joint and letter):
        return letter
    return driver.name if driver.kind == "joint" and _nameable(driver.name) else None


def leader(driver: Driver) -> str:
    """Return what a form driven by it is said to follow: the joint for its direction of approach, too."""
    return driver.joint if driver.kind == "approach" and driver.joint else driver.name


def _far(driver: Driver) -> bool:
    """Whether the values are all farther from zero than their range is wide."""
    return bool(min(abs(driver.distinct[0]), abs(driver.distinct[-1])) > driver.span)


def _origin(driver: Driver) -> float:
    """Return where powers are zero: about the middle of the range, in few digits, where zero is far from it."""
    if not _far(driver):
        return 0.0
    decimals = 1 - int(np.floor(np.log10(driver.span)))
    return round(driver.low + driver.span / 2, decimals)


# factors -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Factor:
    """A family of functions of one driver, whose coefficients are estimated."""

    driver: int
    """Its number."""
    kind: str
    """``power`` (order: the exponent), ``series`` (all powers up to the order), ``polynomial`` (with a constant; in
    products), ``harmonic`` (sine and cosine of so many times the angle), ``wave`` (of any angular frequency), ``step``,
    ``kink``, ``bump``, ``decay``, ``sign``, ``abs``, ``signed`` (x·|x|)."""
    order: int = 1
    values: tuple[float, ...] = ()
    """What was searched for, internal units: the frequency of a wave; the place of a step or a kink; place and width of
    a bump; the time constant of a decay."""
    origin: float = 0.0
    """From where a decay counts the time, and a power counts a column that is never near zero."""

    @property
    def count(self) -> int:
        """Number of functions."""
        several = {"series": self.order, "polynomial": self.order + 1, "harmonic": 2, "wave": 2}
        return several.get(self.kind, 1)

    def functions(self, x: Array) -> list[Array]:
        """Return the functions at x, (n,) each."""
        return _functions(self.kind, self.order, self.values, self.origin, x)

    def texts(self, word: str, numbers: Sequence[str]) -> list[str]:
        """Write the functions.

        Parameters
        ----------
        word : str
            What the formula calls the driver.
        numbers : sequence of str
            What it calls the searched values: numbers, or names of parameters.
        """
        match self.kind:
            case "power":
                return [_power(self._since(word), self.order)]
            case "series":
                return [_power(self._since(word), d) for d in range(1, self.order + 1)]
            case "polynomial":
                return ["", *(_power(self._since(word), d) for d in range(1, self.order + 1))]
            case "harmonic":
                angle = word if self.order == 1 else f"{self.order}*{word}"
                return [f"sin({angle})", f"cos({angle})"]
            case "wave":
                angle = f"{numbers[0]}*{word}" if _is_number(numbers[0]) else f"2*pi*{word}/{numbers[0]}"
                return [f"sin({angle})", f"cos({angle})"]
            case "step":
                return [f"sign({_less(word, numbers[0])})"]
            case "kink":
                return [f"abs({_less(word, numbers[0])})"]
            case "bump":
                return [f"exp(-(({_less(word, numbers[0])})/{numbers[1]})**2)"]
            case "decay":
                return [f"(1 - exp(-{self._since(word)}/{numbers[0]}))"]
            case "sign":
                return [f"sign({word})"]
            case "abs":
                return [f"abs({word})"]
            case "signed":
                return [f"{word}*abs({word})"]
        raise AssertionError(self.kind)

    def _since(self, word: str) -> str:
        return f"({_less(word, written(self.origin))})" if self.origin else word


def _functions(
    kind: str, order: int, values: Sequence[float | Array], origin: float | Array, x: Array
) -> list[Array]:
    """Return the functions of a factor at x, (..., n) each; values and origin broadcast with x."""
    match kind:
        case "power":
            return [(x - origin) ** order]
        case "series":
            return [(x - origin) ** d for d in range(1, order + 1)]
        case "polynomial":
            return [(x - origin) ** d for d in range(order + 1)]
        case "harmonic":
            return [np.sin(order * x), np.cos(order * x)]
        case "wave":
            return [np.sin(values[0] * x), np.cos(values[0] * x)]
        case "step":
            return [np.sign(x - values[0])]
        case "kink":
            return [np.abs(x - values[0])]
        case "bump":
            return [np.exp(-(((x - values[0]) / values[1]) ** 2))]
        case "decay":
            return [1 - np.exp(-(x - origin) / values[0])]
        case "sign":
            return [np.sign(x)]
        case "abs":
            return [np.abs(x)]
        case "signed":
            return [x * np.abs(x)]
    raise AssertionError(kind)


def _power(word: str, exponent: int) -> str:
    return word if exponent == 1 else f"{word}**{exponent}"


def _is_number(text: str) -> bool:
    return not text[0].isalpha()


def _less(word: str, number: str) -> str:
    if _is_number(number) and float(number) == 0:
        return word
    return f"{word} + {number[1:]}" if number.startswith("-") else f"{word} - {number}"


def written(value: float) -> str:
    """Write a number as a formula has it."""
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))


# terms ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Term:
    """A product of factors: every function of one times every function of the others."""

    factors: tuple[Factor, ...]
    at: str | None = None
    """The joint where alone it can stand, because a formula has no word for one of its drivers elsewhere."""

    @cached_property
    def count(self) -> int:
        """Number of coefficients."""
        return math.prod(factor.count for factor in self.factors)

    @cached_property
    def searched(self) -> tuple[float, ...]:
        """The values that were searched for."""
        return tuple(value for factor in self.factors for value in factor.values)

    @property
    def parameters(self) -> int:
        """Number of coefficients and searched values."""
        return self.count + len(self.searched)

    @cached_property
    def family(self) -> tuple[tuple[int, str], ...]:
        """Drivers and kinds, whatever the orders and values."""
        return tuple((factor.driver, factor.kind) for factor in self.factors)

    @property
    def order(self) -> int:
        """Sum of the orders; what is local or of any period counts as much as a third harmonic."""
        return sum(
            factor.order if factor.kind in {"power", "series", "polynomial", "harmonic"} else 3
            for factor in self.factors
        )

    def with_values(self, values: Sequence[float]) -> Term:
        """Return it with other searched values."""
        rest = iter(values)
        return replace(
            self, factors=tuple(replace(f, values=tuple(next(rest) for _ in f.values)) for f in self.factors)
        )

    def columns(self, drivers: Sequence[Array], known: dict[Factor, list[Array]] | None = None) -> Array:
        """Return its functions in every row, (n, count).

        Parameters
        ----------
        drivers : sequence of ndarray, shape (n,)
        known : dict, optional
            Functions of factors, which are taken from there, or added.
        """
        known = {} if known is None else known
        with np.errstate(over="ignore", invalid="ignore"):
            for factor in self.factors:
                if factor not in known:
                    known[factor] = factor.functions(drivers[factor.driver])
            parts = [known[factor] for factor in self.factors]
            made = np.stack([reduce(np.multiply, several) for several in itertools.product(*parts)], axis=1)
        return made if np.abs(made).max(initial=0.0) < LARGEST else np.zeros_like(made)


def in_rows(terms: Sequence[Term], drivers: Sequence[Array]) -> Iterator[tuple[NDArray[np.int_], Array]]:
    """Yield numbers of terms, (t,), and their functions in every row, (t, n, count); those of one kind together.

    Parameters
    ----------
    drivers : sequence of ndarray, shape (n,)
    """
    alone: dict[tuple[str, int], list[int]] = {}
    known: dict[Factor, list[Array]] = {}
    for number, term in enumerate(terms):
        if len(term.factors) == 1:
            alone.setdefault((term.factors[0].kind, term.factors[0].order), []).append(number)
        else:
            yield np.array([number]), term.columns(drivers, known)[None]
    at_once = max(1, AT_ONCE // len(drivers[0]))
    for (kind, order), every in alone.items():
        for start in range(0, len(every), at_once):
            numbers = every[start : start + at_once]
            factors = [terms[number].factors[0] for number in numbers]
            x = np.stack([drivers[factor.driver] for factor in factors])
            values = np.array([factor.values for factor in factors]).T[..., None]
            origin = np.array([[factor.origin] for factor in factors])
            with np.errstate(over="ignore", invalid="ignore"):
                made = np.stack(_functions(kind, order, tuple(values), origin, x), axis=2)
                made[~(np.abs(made).max(axis=(1, 2)) < LARGEST)] = 0.0
            yield np.array(numbers), made


class _Writer:
    """Collects the terms that the drivers allow."""

    def __init__(self, drivers: Sequence[Driver], machine: Machine) -> None:
        self.terms: dict[Term, None] = {}
        self._only_at = [None if word(driver, None, machine) else driver.joint for driver in drivers]

    def term(self, *factors: Factor) -> Term | None:
        """Return a product; None where it can stand nowhere."""
        own = {self._only_at[f.driver] for f in factors} - {None}
        return Term(tuple(factors), own.pop() if own else None) if len(own) < 2 else None

    def add(self, *factors: Factor) -> None:
        if (term := self.term(*factors)) is not None:
            self.terms[term] = None

    def add_products(self, first: Sequence[Factor], second: Sequence[Factor]) -> None:
        for pair in itertools.product(first, second):
            self.add(*pair)


def dictionary(drivers: Sequence[Driver], machine: Machine) -> list[Term]:
    """Return the terms that are tried, searched values on a coarse grid."""
    writer = _Writer(drivers, machine)
    for i, driver in enumerate(drivers):
        for factor in _ALONE[driver.kind](i, driver):
            writer.add(factor)
    low = {i: _low(i, drivers[i]) for i in _multipliable(drivers)}
    for i, k in itertools.combinations(low, 2):
        if _of_one_joint(drivers[i], drivers[k]):
            continue
        writer.add_products(low[i], low[k])
        for own, other in ((i, k), (k, i)):
            if drivers[own].kind == "joint" and _changes_sign(drivers[other]):
                writer.add_products(_further(own, drivers[own]), low[other])
    return list(writer.terms)


def _multipliable(drivers: Sequence[Driver]) -> list[int]:
    """Return the numbers of the drivers of which products are formed: not of all where there are many columns."""
    order = sorted(range(len(drivers)), key=lambda i: _FIRST_MULTIPLIED.index(drivers[i].kind))
    return sorted(order[:MOST_DRIVERS])


def _of_one_joint(first: Driver, second: Driver) -> bool:
    """Return whether they are direction, velocity or temperature of one joint, which are not multiplied."""
    return (
        first.joint is not None and first.joint == second.joint and "joint" not in {first.kind, second.kind}
    )


def _changes_sign(driver: Driver) -> bool:
    """Return whether what it multiplies does not show without it: a function of a joint times a load would."""
    values = driver.values - _origin(driver)
    return driver.kind != "joint" and bool(abs(values.mean()) < HARDLY_SEEN * np.sqrt(np.mean(values**2)))


def _further(i: int, driver: Driver) -> list[Factor]:
    """Return functions of a joint that only take part in products with a driver that changes sign."""
    harmonics = _harmonics(i, driver, 2 * PRODUCTS)[PRODUCTS:] if driver.revolute else []
    origin = _origin(driver)
    powers = [Factor(i, "power", d, origin=origin) for d in (3,) if len(driver.distinct) > d]
    return [*harmonics, *powers, *_local(i, driver, PLACES // 3, widths=WIDTHS[:1])]


def multiplied(term: Term, drivers: Sequence[Driver], machine: Machine) -> list[Term]:
    """Return the products of a term of one factor with a low function of each driver that it does not follow."""
    if len(term.factors) > 1:
        return []
    writer = _Writer(drivers, machine)
    (factor,) = term.factors
    own = drivers[factor.driver]
    for i in _multipliable(drivers):
        if drivers[i] is own or _of_one_joint(drivers[i], own):
            continue
        for other in _low(i, drivers[i]):
            writer.add(factor, other)
            if factor.kind in {"power", "series"}:
                degree = min(factor.order, HIGHEST_IN_PRODUCT)
                writer.add(replace(factor, kind="polynomial", order=degree), other)
    return list(writer.terms)


def _low(i: int, driver: Driver) -> list[Factor]:
    """Return what takes part in products."""
    origin = _origin(driver)
    if driver.kind == "joint":
        powers = [Factor(i, "power", d, origin=origin) for d in (1, 2) if len(driver.distinct) > d]
        return [*powers, *(_harmonics(i, driver, PRODUCTS) if driver.revolute else [])]
    if driver.kind == "time":
        return [Factor(i, "power", origin=origin), *_decays(i, driver)[1::3]]
    if driver.kind == "load":
        return [Factor(i, "power", d, origin=origin) for d in (1, 2) if len(driver.distinct) > d]
    return [Factor(i, "power", origin=origin)]


def _of_joint(i: int, driver: Driver) -> list[Factor]:
    harmonics = _harmonics(i, driver, HARMONICS) if driver.revolute else []
    crossed = driver.low < 0 < driver.low + driver.span
    signs = [Factor(i, "sign"), Factor(i, "abs")] if crossed else []
    return [
        *harmonics,
        *_powers(i, driver, DEGREE),
        *signs,
        *_local(i, driver, PLACES),
        *_waves(i, driver, WAVES),
    ]


def _of_time(i: int, driver: Driver) -> list[Factor]:
    return [*_powers(i, driver, 3), *_decays(i, driver), *_waves(i, driver, WAVES)]


def _of_column(i: int, driver: Driver) -> list[Factor]:
    crossed = driver.low < 0 < driver.low + driver.span
    signs = [Factor(i, kind) for kind in ("sign", "abs", "signed")] if crossed else []
    return [*_powers(i, driver, 3), *signs, *_local(i, driver, PLACES // 2, widths=())]


def _of_velocity(i: int, driver: Driver) -> list[Factor]:
    return [*_powers(i, driver, 2), *(Factor(i, kind) for kind in ("sign", "abs", "signed"))]


def _of_direction(i: int, driver: Driver) -> list[Factor]:
    return [Factor(i, "power")]


_ALONE: dict[Kind, Callable[[int, Driver], list[Factor]]] = {
    "joint": _of_joint,
    "approach": _of_direction,
    "velocity": _of_velocity,
    "temperature": _of_column,
    "time": _of_time,
    "load": _of_column,
    "column": _of_column,
}


def _powers(i: int, driver: Driver, degree: int) -> list[Factor]:
    highest = min(degree, len(driver.distinct) - 1)
    origin = _origin(driver)
    powers = [Factor(i, "power", d, origin=origin) for d in range(1, highest + 1)]
    return [*powers, *(Factor(i, "series", d, origin=origin) for d in range(2, highest + 1))]


def _harmonics(i: int, driver: Driver, highest: int) -> list[Factor]:
    """Return the harmonics that the angles of the data distinguish from lower ones."""
    angles = len(np.unique(np.round(driver.distinct % (2 * np.pi), 9)))
    return [Factor(i, "harmonic", h) for h in range(1, min(highest, (angles - 1) // 2) + 1)]


def _waves(i: int, driver: Driver, most: float) -> list[Factor]:
    highest = min(most, most_waves(driver.distinct))
    unit = 2 * np.pi / driver.span
    return [Factor(i, "wave", 1, (unit * w,)) for w in np.arange(LEAST_WAVES, highest + 0.25, 0.5)]


def _local(i: int, driver: Driver, places: int, widths: Sequence[float] = WIDTHS) -> list[Factor]:
    x = driver.distinct
    if len(x) < 4:
        return []
    between = np.unique(np.linspace(1, len(x) - 1, min(places, len(x) - 1), dtype=int))
    at = [float(a) for a in (x[between] + x[between - 1]) / 2]
    found = [Factor(i, kind, 1, (a,)) for kind in ("step", "kink") for a in at]
    for width in widths:
        centres = np.linspace(x[0], x[-1], round(0.75 / width) + 1)
        found += [Factor(i, "bump", 1, (float(c), width * driver.span)) for c in centres]
    return found


def _decays(i: int, driver: Driver) -> list[Factor]:
    # a time is counted from its zero, unless the measurements began long after
    origin = driver.low if _far(driver) else 0.0
    times = np.geomspace(driver.span / 30, driver.span * 3, DECAYS)
    return [Factor(i, "decay", 1, (float(tau),), origin) for tau in times]


# Whether an effect of the catalogue has the same form as a term: what the catalogue explains is not outside of it.


_OF_ANY_READING = {
    (("joint", "power", 1),),
    (("approach", "power", 1),),
    (("approach", "power", 1), ("joint", "power", 1)),
    (("velocity", "power", 1),),
    (("temperature", "power", 1),),
}
_COUPLED = (("joint", "power", 1),)
_EXPANSION = (("joint", "power", 1), ("temperature", "power", 1))
_OF_A_LEG = {
    (("joint", "power", 1),),
    (("approach", "power", 1),),
    (("temperature", "power", 1),),
    _EXPANSION,
}
"""A leg's length changes by a small part of itself, so that what grows by T alone is what grows by T q."""
_OF_FRAME = {(("time", "power", 1),), (("time", "decay", 1),)}
_HARMONICS = 2
"""Of an encoder, and of error motions."""
_STRAIGHTNESS, _ANGULAR = 4, 3
"""Degrees of a slide's errors."""
_ACROSS = 0.7
"""Cosine of the angle to the axis of what is still across it: a slide has no straightness along its way."""
_SAME = 0.02
"""Relative difference of two frequencies that are taken for one."""


def is_catalogued(
    term: Term, place: str | None, component: str, drivers: Sequence[Driver], machine: Machine
) -> bool:
    """Return whether an effect of the catalogue is this term at this place, along some direction."""
    parts = tuple(sorted((drivers[f.driver].kind, f.kind, f.order) for f in term.factors))
    others = {drivers[f.driver].joint for f in term.factors} - {None, place}
    if others:
        return component == "reading" and parts == _COUPLED and others == _before(place, machine)
    if place is None:
        return parts in _OF_FRAME
    if machine.kind_of(place) == "leg":
        return parts in _OF_A_LEG
    turns = machine.kind_of(place) == "revolute"
    waves = len(parts) == 1 and parts[0][:2] in {("joint", "harmonic"), ("joint", "wave")}
    if component == "reading":
        if waves:
            return _is_wave_of_reading(term.factors[0], place, turns, machine)
        return parts in _OF_ANY_READING or (parts == _EXPANSION and not turns)
    if parts == (("temperature", "power", 1),):
        return turns and component[0] == "t"
    if len(parts) != 1 or parts[0][0] != "joint":
        return False
    _, kind, order = parts[0]
    if turns:
        return kind == "harmonic" and order <= _HARMONICS
    if component[0] == "t":
        along = abs(machine.joint(place).axis["xyz".index(component[1])])
        return kind in {"power", "series"} and order <= _STRAIGHTNESS and along < _ACROSS
    return kind in {"power", "series"} and order <= _ANGULAR


def _before(place: str | None, machine: Machine) -> set[str | None]:
    """Return the joint that a joint may be coupled with, if there is one."""
    if place is None or machine.kind_of(place) != "revolute":
        return set()
    before = [machine.joints[k] for k in machine.carriers(machine.number_of(place))[-1:]]
    return {joint.name for joint in before if joint.revolute}


def _is_wave_of_reading(factor: Factor, place: str, turns: bool, machine: Machine) -> bool:
    """Return whether it is of an encoder, or of a drive of the period that is given, or of any where none is."""
    if turns and factor.kind == "harmonic" and factor.order <= _HARMONICS:
        return True
    period = machine.joint(place).period
    frequency = float(factor.order) if factor.kind == "harmonic" else factor.values[0]
    return period is None or abs(frequency * period / (2 * np.pi) - 1) < _SAME
