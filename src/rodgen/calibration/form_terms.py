"""The terms of a form outside the catalogue: functions of recorded quantities that a formula can write.

A factor is a family of one or a few functions of one driver, such as a sine with its cosine; some have values that are
searched: a period, a place. A term is a factor, or a product of two.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import mul

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.solve.starting_values import most_waves
from rodgen.data.units import ANGLE, ONE, Dimension, display_unit, parse_unit
from rodgen.machines.drivers import Driver
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import component_dimension
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.measured import READING_COLUMNS
from rodgen.machines.observations import Observations

HARMONICS, HARMONICS_IN_PRODUCTS, HARMONICS_OF_TWO, DEGREE = 12, 4, 2, 3
"""Most waves of a turn, alone, in products, and in products of two joints; and the highest power: a curve of a higher
degree bends somewhere, which a local function shows better."""
FEWEST_WAVES, MOST_WAVES = 0.75, 25.0
"""Waves over the range of the data; a drive's fine waves are in the catalogue."""
PLACES = 12
"""Where a step, a bend or a bump is tried; between them it is looked for later."""
WIDTHS = (1 / 6, 1 / 16)
"""Of a bump, in ranges of the data."""
DECAYS = 9
"""Time constants, from a thirtieth of the duration to three times it."""
STANDS_STILL = 1e-3
"""Part of the largest range of joints of its kind below which a joint stands still: it moves by a servo's jitter."""
LARGEST = 1e100
"""Functions with values beyond are left out: their squares leave the range of a double."""
_LETTERS = "abcghkmnpuwABCDEGHKLMNQRSUVXYZ"
_WITH_UNIT = {"wave": (0, "P"), "bump": (1, "W"), "decay": (0, "tau")}
"""Which searched value has the unit of its driver, and what a formula calls it."""
_OF_KIND = {"joint": "q", "approach": "s", "velocity": "v", "temperature": "T", "time": "t", "load": "F"}
"""What a formula calls a driver; those of a joint at their own joint only."""
_WORDS = frozenset({*_OF_KIND.values(), "pi"}) | FUNCTION_NAMES | READING_COLUMNS
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")


# drivers -------------------------------------------------------------------------------------------------------------


def drivers_of(o: Observations) -> list[Driver]:
    """Return the drivers that vary and that a formula can name: joint by joint, then those of the whole machine."""
    of_joints = sorted(o.drivers("joint", "approach", "velocity", "temperature"), key=lambda d: d.number or 0)
    every = [
        driver
        for driver in (*of_joints, *o.drivers("time", "load", "column"))
        if word(driver, driver.joint, o.machine) and driver.levels > 1 and np.isfinite(driver.span)
    ]
    joints = sorted((driver for driver in every if driver.kind == "joint"), key=lambda d: d.span)
    # by the widest, which is the last
    still = {driver.revolute: STANDS_STILL * driver.span for driver in joints}
    return [d for d in every if d.kind != "joint" or d.span > still[d.revolute]]


def word(driver: Driver, place: str | None, machine: Machine) -> str | None:
    """Return what a formula at a place calls a driver; None where it has no word for it.

    A letter that is also the name of a joint is in no formula.
    """
    nameable = _IDENTIFIER.fullmatch(driver.name) is not None and driver.name not in _WORDS
    if driver.kind == "column":
        return driver.name if nameable else None
    letter: str | None = _OF_KIND[driver.kind]
    if letter in {joint.name for joint in machine.joints}:
        letter = None
    if driver.joint is None or (place == driver.joint and letter):
        return letter
    return driver.name if driver.kind == "joint" and nameable else None


def _far(driver: Driver) -> bool:
    """Whether the values are all farther from zero than their range is wide."""
    return bool(min(abs(driver.distinct[0]), abs(driver.distinct[-1])) > driver.span)


def _middle(driver: Driver) -> float:
    """Return about the middle of the range, in few digits."""
    middle = round(driver.low + driver.span / 2, 1 - int(np.floor(np.log10(driver.span))))
    return 0.0 if abs(middle) < 0.05 * driver.span else middle


def _origin(driver: Driver) -> float:
    """Return where powers are zero: the middle of the range where zero is far from it."""
    return _middle(driver) if _far(driver) else 0.0


# factors -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Factor:
    """A family of functions of one driver, whose coefficients are estimated."""

    driver: int
    """Its number."""
    kind: str
    """``power`` (order: the exponent), ``series`` (all powers up to the order), ``curve`` (without the first),
    ``polynomial`` (with a constant; in products), ``harmonic`` (sine and cosine of so many times the angle), ``wave``
    (of any angular frequency), ``step``, ``kink``, ``bump``, ``decay``, ``signed`` (x·|x|)."""
    order: int = 1
    values: tuple[float, ...] = ()
    """What was searched for, internal units: the frequency of a wave; the place of a step or a kink; place and width of
    a bump; the time constant of a decay."""
    origin: float = 0.0
    """From where a decay counts the time, a power its column, and where a step or a kink is that was not searched."""

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(_exponents(self.kind, self.order) or _SHAPES[self.kind])

    def functions(self, x: Array) -> list[Array]:
        """Return the functions at x, (n,) each."""
        since = x - self.origin
        if exponents := _exponents(self.kind, self.order):
            return [since**d for d in exponents]
        numbers = (float(self.order),) if self.kind == "harmonic" else self.values or (self.origin,)
        at = since if self.kind == "decay" else x
        return [function(at, *numbers) for function, _ in _SHAPES[self.kind]]

    def texts(self, word: str, numbers: Sequence[str]) -> list[str]:
        """Write the functions.

        Parameters
        ----------
        word : str
            What the formula calls the driver.
        numbers : sequence of str
            What it calls the searched values: numbers, or names of parameters.
        """
        since = f"({_less(word, _written(self.origin))})" if self.origin else word
        if exponents := _exponents(self.kind, self.order):
            return ["" if d == 0 else since if d == 1 else f"{since}**{d}" for d in exponents]
        angle = word if self.order == 1 else f"{self.order}*{word}"
        if self.kind == "wave":
            angle = f"2*pi*{word}/{numbers[0]}" if numbers[0][0].isalpha() else f"{numbers[0]}*{word}"
        numbers = [*numbers, _written(self.origin)]
        words = {"x": word, "since": since, "angle": angle, "less": _less(word, numbers[0]), "v": numbers}
        return [text.format(**words) for _, text in _SHAPES[self.kind]]

    @property
    def powers(self) -> list[int]:
        """Of the driver, in each function: its dimension."""
        return _exponents(self.kind, self.order) or [{"kink": 1, "signed": 2}.get(self.kind, 0)] * self.count


_WAVE: list[tuple[Callable[..., Array], str]] = [
    (lambda x, f: np.sin(f * x), "sin({angle})"),
    (lambda x, f: np.cos(f * x), "cos({angle})"),
]
_SHAPES: dict[str, list[tuple[Callable[..., Array], str]]] = {
    "harmonic": _WAVE,
    "wave": _WAVE,
    "step": [(lambda x, at: np.sign(x - at), "sign({less})")],
    "kink": [(lambda x, at: np.abs(x - at), "abs({less})")],
    "bump": [(lambda x, at, width: np.exp(-(((x - at) / width) ** 2)), "exp(-(({less})/{v[1]})**2)")],
    "decay": [(lambda since, tau: 1 - np.exp(-since / tau), "(1 - exp(-{since}/{v[0]}))")],
    "signed": [(lambda x, _: x * np.abs(x), "{x}*abs({x})")],
}
"""Functions of a driver and the numbers of a factor that are no polynomials, and how a formula writes them."""


def _exponents(kind: str, order: int) -> list[int]:
    """Return the powers that a factor consists of; none where it is no polynomial."""
    first = {"power": order, "polynomial": 0, "series": 1, "curve": 2}
    return [*range(first[kind], order + 1)] if kind in first else []


def _less(word: str, number: str) -> str:
    if number == "0":
        return word
    return f"{word} + {number[1:]}" if number.startswith("-") else f"{word} - {number}"


def _written(value: float) -> str:
    """Write a number as a formula has it."""
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))


@dataclass(frozen=True)
class Term:
    """A product of factors: every function of one times every function of the others."""

    factors: tuple[Factor, ...]
    choices: float = 1.0
    """Among how many such terms it is one: kinds, orders, values on the grid, further drivers."""

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return math.prod(factor.count for factor in self.factors)

    @property
    def searched(self) -> tuple[float, ...]:
        """The values that were searched for."""
        return tuple(value for factor in self.factors for value in factor.values)

    def with_values(self, values: Sequence[float]) -> Term:
        """Return it with other searched values."""
        rest = iter(values)
        factors = tuple(replace(f, values=tuple(float(next(rest)) for _ in f.values)) for f in self.factors)
        return replace(self, factors=factors)

    def functions(self, drivers: Sequence[Driver]) -> Array:
        """Return its functions in every row, (n, count); zero where they are too large to be squared."""
        with np.errstate(over="ignore", invalid="ignore"):
            parts = [factor.functions(drivers[factor.driver].values) for factor in self.factors]
            functions = np.stack(
                [reduce(np.multiply, several) for several in itertools.product(*parts)], axis=1
            )
        return functions if np.abs(functions).max(initial=0.0) < LARGEST else np.zeros_like(functions)

    def multiplied(self, drivers: Sequence[Driver]) -> list[Term]:
        """Return products with a low function of each driver that it does not follow; of two, with further powers."""
        if len(self.factors) > 1:
            return [
                replace(self, factors=(*self.factors[:k], _polynomial(factor), *self.factors[k + 1 :]))
                for k, factor in enumerate(self.factors)
                if factor.kind == "power" and drivers[factor.driver].levels > DEGREE
            ]
        (factor,) = self.factors
        curve = factor.kind in {"power", "series", "curve"} and drivers[factor.driver].levels > DEGREE
        return [
            Term((factors, second), self.choices * len(low))
            for k, driver in enumerate(drivers)
            if k != factor.driver and _multiply(drivers[factor.driver], driver)
            for low in [_low(k, driver)]
            for second in low
            for factors in (factor, *([_polynomial(factor)] if curve else []))
        ]

    def neighbours(self, drivers: Sequence[Driver], part: float) -> Iterator[Term]:
        """Yield it with one of its searched values changed by a part of the step of the grid, to either side."""
        values = [(drivers[f.driver], f.kind, k, v) for f in self.factors for k, v in enumerate(f.values)]
        for (number, (driver, kind, k, value)), sign in itertools.product(enumerate(values), (-part, part)):
            least, most = driver.low, driver.low + driver.span
            if kind == "decay" or k == 1:  # a time constant, or a width
                near, least, most = value * 2**sign, driver.span / 200, 10 * driver.span
            elif kind == "wave":
                near, least, most = value + sign * np.pi / driver.span, np.pi / driver.span, math.inf
            else:
                near = value + sign * driver.span / PLACES
            if least <= near <= most:
                yield self.with_values([near if i == number else known[3] for i, known in enumerate(values)])

    def rounded(self, digits: int, drivers: Sequence[Driver]) -> Term:
        """Return it with searched values of so many digits."""
        values = list[float]()
        for factor in self.factors:
            driver = drivers[factor.driver]
            decimals = digits - 1 - int(np.floor(np.log10(driver.span)))
            for k, value in enumerate(factor.values):
                if factor.kind == "wave" and driver.dimension != ANGLE:  # a period
                    values.append(2 * np.pi / float(f"{2 * np.pi / value:.{digits}g}"))
                elif factor.kind in {"wave", "decay"} or k == 1:
                    values.append(float(f"{value:.{digits}g}"))
                else:  # a place has decimals relative to the range
                    values.append(round(value, decimals) + 0.0)
        return self.with_values(values)

    def follows(self, drivers: Sequence[Driver]) -> str:
        """Return what drives it, in words: columns before joints, each once; of a direction of approach its joint."""
        of_factors = [drivers[factor.driver] for factor in self.factors]
        ordered = sorted(of_factors, key=lambda d: d.kind in {"joint", "approach"})
        return " and ".join(dict.fromkeys(str(d.joint) if d.kind == "approach" else d.name for d in ordered))


# the terms that are tried --------------------------------------------------------------------------------------------


def terms(drivers: Sequence[Driver]) -> list[Term]:
    """Return the terms that are tried first, searched values on a coarse grid."""
    every = list[Term]()
    for i, driver in enumerate(drivers):
        alone = _alone(i, driver)
        kinds = Counter(factor.kind for factor in alone)
        every += [Term((factor,), float(len(kinds) * kinds[factor.kind])) for factor in alone]
    for i, k in itertools.combinations(range(len(drivers)), 2):
        one, latter = drivers[i], drivers[k]
        if one.kind != "joint" or not _multiply(one, latter):
            continue
        if latter.kind == "joint":
            first, second = (_low(j, drivers[j])[: 1 + HARMONICS_OF_TWO] for j in (i, k))
        else:
            first = [*_low(i, one), *_local(i, one, PLACES // 3, WIDTHS[:1])]
            second = _low(k, latter)
        choices = float(len(first) * len(second))
        every += [Term(pair, choices) for pair in itertools.product(first, second)]
    return every


def _polynomial(factor: Factor) -> Factor:
    return replace(factor, kind="polynomial", order=DEGREE)


def _multiply(one: Driver, second: Driver) -> bool:
    """Return whether products of two drivers are formed: what belongs to a joint is multiplied with its coordinate."""
    of_one = [d for d in (one, second) if d.joint is not None and d.kind != "joint"]
    return all(one.joint == second.joint and "joint" in {one.kind, second.kind} for _ in of_one)


def _alone(i: int, driver: Driver) -> list[Factor]:
    if driver.kind == "approach":
        return [Factor(i, "power")]
    powers = _powers(i, driver)
    if driver.kind == "time":
        return [*powers, *_decays(i, driver), *_waves(i, driver)]
    if driver.low < 0 < driver.low + driver.span:
        powers += [Factor(i, "step"), Factor(i, "kink")]
    if driver.kind == "velocity":
        return [*powers, Factor(i, "signed")]
    if driver.kind == "joint":
        local = _local(i, driver, PLACES, WIDTHS)
        return [*_harmonics(i, driver, HARMONICS), *powers, *local, *_waves(i, driver)]
    return [*powers, *_local(i, driver, PLACES // 2, ())]


def _low(i: int, driver: Driver) -> list[Factor]:
    """Return what takes part in products, the simplest first."""
    origins = dict.fromkeys([_origin(driver), _middle(driver)])
    lines = [Factor(i, "power", origin=origin) for origin in origins]
    square = _powers(i, driver)[1:2]
    if driver.kind == "joint":
        return [lines[-1], *_harmonics(i, driver, HARMONICS_IN_PRODUCTS), *lines[:-1], *square]
    if driver.kind == "time":
        return [*lines, *_decays(i, driver)[1::3]]
    return [*lines, *(square if driver.kind == "load" else [])]


def _powers(i: int, driver: Driver) -> list[Factor]:
    highest = min(DEGREE, driver.levels - 1)
    origin = _origin(driver)
    powers = [Factor(i, "power", d, origin=origin) for d in range(1, highest + 1)]
    series = [Factor(i, "series", d, origin=origin) for d in range(2, highest + 1)]
    return [*powers, *series, *(Factor(i, "curve", d, origin=origin) for d in range(3, highest + 1))]


def _harmonics(i: int, driver: Driver, highest: int) -> list[Factor]:
    """Return the harmonics that the angles of the data distinguish from lower ones; of a slide none."""
    if not driver.revolute:
        return []
    angles = len(np.unique(np.round(driver.distinct % (2 * np.pi), 9)))
    return [Factor(i, "harmonic", h) for h in range(1, min(highest, (angles - 1) // 2) + 1)]


def _waves(i: int, driver: Driver) -> list[Factor]:
    unit, highest = 2 * np.pi / driver.span, min(MOST_WAVES, most_waves(driver.distinct))
    return [Factor(i, "wave", 1, (unit * w,)) for w in np.arange(FEWEST_WAVES, highest + 0.25, 0.5)]


def _local(i: int, driver: Driver, places: int, widths: Sequence[float]) -> list[Factor]:
    x = driver.distinct
    if len(x) < 4:
        return []
    between = np.unique(np.linspace(1, len(x) - 1, min(places, len(x) - 1), dtype=int))
    at = [float(a) for a in (x[between] + x[between - 1]) / 2]
    factors = [Factor(i, kind, 1, (a,)) for kind in ("step", "kink") for a in at]
    for width in widths:
        centres = np.linspace(x[0], x[-1], round(0.75 / width) + 1)
        factors += [Factor(i, "bump", 1, (float(c), width * driver.span)) for c in centres]
    return factors


def _decays(i: int, driver: Driver) -> list[Factor]:
    # a time is counted from its zero, unless the measurements began long after
    origin = driver.low if _far(driver) else 0.0
    times = np.geomspace(driver.span / 30, driver.span * 3, DECAYS)
    return [Factor(i, "decay", 1, (float(tau),), origin) for tau in times]


# as a formula --------------------------------------------------------------------------------------------------------


def effect_of(
    term: Term,
    at: tuple[str | None, str],
    drivers: Sequence[Driver],
    o: Observations,
    others: Sequence[Effect] = (),
) -> Effect:
    """Return a term at a component of a place as an effect that a user could have written, unlike others in name.

    What was searched and has a unit is a parameter that is held; other searched values are numbers in the formula.
    """
    (place, component), machine, driven = at, o.machine, term.follows(drivers)
    joints = {joint.name for joint in machine.joints}
    taken, free = {*_WORDS, *joints, *o.data.columns}, iter(_LETTERS)
    units, hold = dict[str, str](), dict[str, float]()
    texts, dimensions = list[list[str]](), list[list[Dimension]]()
    for factor in term.factors:
        driver = drivers[factor.driver]
        numbers = [_written(value) for value in factor.values]
        if factor.kind in _WITH_UNIT and not driver.dimension.fits(ONE):
            k, letter = _WITH_UNIT[factor.kind]
            value = 2 * np.pi / factor.values[0] if factor.kind == "wave" else factor.values[k]
            numbers[k] = _free(letter, taken | units.keys())
            units[numbers[k]] = display_unit(driver.dimension, machine.length_unit).text
            hold[numbers[k]] = float(f"{value:.12g}")
        texts.append(factor.texts(str(word(driver, place, machine)), numbers))
        dimensions.append([driver.dimension**p for p in factor.powers])
    wanted = component_dimension(component, machine.kind_of(place), machine.measurand)
    of_factors = [drivers[factor.driver] for factor in term.factors]
    columns = [driver.unit for driver in of_factors if driver.kind == "column"]
    coefficients: dict[str, str] = {}
    parts = list[str]()
    for several, of in zip(itertools.product(*texts), itertools.product(*dimensions), strict=True):
        letter = next(letter for letter in free if letter not in taken | units.keys())
        coefficients[letter] = _unit(wanted, reduce(mul, of, ONE), columns, machine.length_unit)
        parts.append("*".join(filter(None, [letter, *several])))
    names = {*NAMES, *joints, *(target.name for target in machine.targets)}
    names |= {effect.name for effect in (*machine.effects, *others)}
    name = re.sub(r"[^A-Za-z0-9]+", "_", f"{component}_by_{driven}")[:50].strip("_")
    where = f"{component} at {place}" if place else f"{component} of the whole machine"
    definition = own_effect(
        _free(name, names, "_"),
        component,
        " + ".join(parts),
        coefficients | units,
        f"Found by a diagnosis: {where} follows {driven}.",
        at=machine.kind_of(place),
        joints=machine.quantities,
        measurand=machine.measurand,
        file=machine.file or machine.name,
        place=f"form at {place}",
    )
    return Effect(definition, place, hold)


def _free(name: str, taken: set[str], between: str = "") -> str:
    return next(n for n in (name, *(f"{name}{between}{k}" for k in range(2, 1000))) if n not in taken)


def _unit(wanted: Dimension, function: Dimension, columns: Sequence[str], length: str) -> str:
    """Return the unit of a coefficient, by those of columns; an angle in a function is a plain number."""
    function = Dimension.of((name, power) for name, power in function.powers if name != "angle")
    unit_of_place = "arcsec" if wanted == ANGLE else length
    if function == ONE:
        return unit_of_place
    simple = (unit for unit in columns if unit and not re.search(r"[*/^ ]", unit))
    same = (f"{unit_of_place}/{unit}" for unit in simple if parse_unit(unit).dimension == function)
    return next(same, display_unit(wanted / function, length).text)
