"""Terms at a component of a place, written as a formula of a user, with units of its parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import product
from operator import mul

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.diagnose.forms.dictionary import WORDS, Factor, Term, leader, word, written
from rodgen.data.drivers import Driver
from rodgen.data.observations import Observations
from rodgen.data.units import ANGLE, ONE, Dimension, UnitError, display_unit, parse_unit, unit_factor
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import EffectDefinition, component_dimension
from rodgen.machines.effects.formula import Formula
from rodgen.machines.machine import Effect, Machine
from rodgen.statistics.f_tests import p_of_log10

_LETTERS = "abcghkmnpuwABCDEGHKLMNQRSUVXYZ"


@dataclass(frozen=True)
class Piece:
    """A term at a sensitivity, or some of its functions."""

    term: Term
    sensitivity: int
    kept: tuple[int, ...]
    """Numbers of the functions."""

    @classmethod
    def whole(cls, term: Term, sensitivity: int) -> Piece:
        """Return all functions of a term."""
        return cls(term, sensitivity, tuple(range(term.count)))

    @property
    def parameters(self) -> int:
        """Number of coefficients and searched values."""
        return len(self.kept) + len(self.term.searched)


@dataclass(frozen=True)
class Written:
    """Pieces at one component of one place as a formula."""

    formula: str
    units: Mapping[str, str]
    hold: Mapping[str, float]
    coefficients: tuple[str, ...]
    driver: str
    name: str


def write(
    pieces: Sequence[Piece], place: str | None, component: str, drivers: Sequence[Driver], o: Observations
) -> Written:
    """Write pieces as a formula, its parameters with their units."""
    machine = o.machine
    taken = WORDS | {joint.name for joint in machine.joints} | set(o.data.columns)
    names = _names(taken)
    wanted = component_dimension(component, machine.kind_of(place), machine.measurand)
    texts: list[str] = []
    units: dict[str, str] = {}
    hold: dict[str, float] = {}
    coefficients: list[str] = []
    for piece in pieces:
        parts = [
            _factor(factor, drivers[factor.driver], place, machine, taken, units, hold)
            for factor in piece.term.factors
        ]
        functions = ["*".join(filter(None, texts)) for texts in product(*(part[0] for part in parts))]
        dimensions = [reduce(mul, each, ONE) for each in product(*(part[1] for part in parts))]
        for k in piece.kept:
            name = next(n for n in names if n not in units)
            own = [drivers[factor.driver] for factor in piece.term.factors]
            units[name] = _unit(wanted, dimensions[k], own, machine)
            coefficients.append(name)
            texts.append(f"{name}*{functions[k]}")
    formula = Formula.parse(" + ".join(texts), file="diagnosis", place="formula").text
    used = [drivers[f.driver] for piece in pieces for f in piece.term.factors]
    driver = _driver(used)
    ordered = {name: units[name] for name in [*coefficients, *(n for n in units if n not in coefficients)]}
    called = re.sub(r"[^A-Za-z0-9]+", "_", f"{component}_by_{driver}")[:50].strip("_")
    return Written(formula, ordered, hold, tuple(coefficients), driver, called)


def _driver(used: Sequence[Driver]) -> str:
    """Name what drives a form: columns before joints, each once."""
    joints = {d.joint for d in used if d.kind == "joint"}
    ways = [d for d in used if d.kind == "approach" and d.joint not in joints]
    others = [d for d in used if d.kind not in {"joint", "approach"}]
    ordered = [*others, *ways, *(d for d in used if d.kind == "joint")]
    return " and ".join(dict.fromkeys(leader(d) for d in ordered))


def _names(taken: frozenset[str] | set[str]) -> Iterator[str]:
    yield from (letter for letter in _LETTERS if letter not in taken)
    yield from (name for k in range(1, 1000) if (name := f"a{k}") not in taken)


def _factor(
    factor: Factor,
    driver: Driver,
    place: str | None,
    machine: Machine,
    taken: set[str] | frozenset[str],
    units: dict[str, str],
    hold: dict[str, float],
) -> tuple[list[str], list[Dimension]]:
    """Return a factor's functions and their dimensions; searched values with a unit become parameters that are held."""
    called = word(driver, place, machine)
    assert called is not None
    plain = driver.dimension.fits(ONE)
    of_unit = display_unit(driver.dimension, machine.length_unit).text

    def held(name: str, value: float) -> str:
        free = next(
            n for n in (name, *(f"{name}{k}" for k in range(2, 99))) if n not in taken and n not in units
        )
        units[free] = of_unit
        hold[free] = float(f"{value:.12g}")
        return free

    numbers = [written(value) for value in factor.values]
    if factor.kind == "wave" and not plain:
        numbers = [held("P", 2 * np.pi / factor.values[0])]
    elif factor.kind == "bump" and not plain:
        numbers[1] = held("W", factor.values[1])
    elif factor.kind == "decay":
        numbers = [held("tau", factor.values[0])]
    of = driver.dimension
    powers = {"power": [factor.order], "series": list(range(1, factor.order + 1)), "kink": [1], "abs": [1]}
    powers |= {"signed": [2], "polynomial": list(range(factor.order + 1))}
    return factor.texts(called, numbers), [of**p for p in powers.get(factor.kind, [0] * factor.count)]


def _unit(wanted: Dimension, function: Dimension, drivers: Sequence[Driver], machine: Machine) -> str:
    """Return the unit of a coefficient; an angle in a function is a plain number."""
    function = Dimension.of((name, power) for name, power in function.powers if name != "angle")
    own = "arcsec" if wanted == ANGLE else machine.length_unit
    if function == ONE:
        return own
    for driver in drivers:
        if driver.kind == "column" and driver.unit and parse_unit(driver.unit).dimension == function:
            try:
                if parse_unit(f"{own}/{driver.unit}").dimension == wanted / function:
                    return f"{own}/{driver.unit}"
            except UnitError:
                pass
    return display_unit(wanted / function, machine.length_unit).text


def values_of(
    units: Mapping[str, str], numbers: Mapping[str, float], machine: Machine
) -> dict[str, tuple[float, str]]:
    """Return internal values in their units."""
    return {
        name: (numbers[name] / unit_factor(unit, machine.length_unit)[0], unit)
        for name, unit in units.items()
    }


# A form of the residuals, in the words of users' formulas, as an effect of a machine.


@dataclass(frozen=True, eq=False)
class Form:
    """A form of what no effect of the catalogue explains."""

    place: str | None
    """The joint; None for the whole machine."""
    component: str
    """``reading``, or one of ``tx ty tz rx ry rz``."""
    driver: str
    """The joint or column that it follows; several with "and" between them."""
    formula: str
    parameters: Mapping[str, tuple[float, str]]
    """Values with units, of what was searched for too."""
    log10_p: float
    """Logarithm of the probability that chance does as much for any of the terms tried."""
    explains: float
    """Part of the whitened sum of squares that it takes away."""
    columns: Array = field(repr=False)
    """Derivatives of the weighted residuals with respect to its coefficients, (n, m, k)."""
    units: Mapping[str, str] = field(repr=False)
    """Of all parameters."""
    hold: Mapping[str, float] = field(repr=False)
    """What was searched for and has a unit, internal units: it is not estimated by a fit."""
    name: str = ""
    """Of the effect."""
    in_catalogue: bool = False
    """Whether an effect of the catalogue has the same form."""
    terms: int = 1
    searched: int = 0
    """Number of its terms, and of the values that were searched for."""

    @property
    def p_value(self) -> float:
        """Probability that chance does as much for any of the terms tried; at least 1e-300."""
        return p_of_log10(self.log10_p)

    @property
    def where(self) -> str:
        """Component and place in a sentence."""
        return f"{self.component} at {self.place}" if self.place else f"{self.component} of the whole machine"

    def effect_definition(self, machine: Machine) -> EffectDefinition:
        """Return it as an effect that a user could have written.

        Parameters
        ----------
        machine : Machine
            Which it is for.
        """
        return own_effect(
            self._free_name(machine),
            self.component,
            self.formula,
            self.units,
            f"Found by a diagnosis: {self.where} follows {self.driver}.",
            at=machine.kind_of(self.place),
            joints=machine.quantities,
            measurand=machine.measurand,
            file=machine.file or machine.name,
            place=f"form at {self.place}",
        )

    def effect(self, machine: Machine) -> Effect:
        """Return it as an effect in its place, for :meth:`Machine.add`."""
        return Effect(self.effect_definition(machine), self.place, dict(self.hold))

    def _free_name(self, machine: Machine) -> str:
        taken = {effect.name for effect in machine.effects}
        taken |= {joint.name for joint in machine.joints} | {target.name for target in machine.targets}
        name, number = self.name, 1
        while name in taken or name in NAMES:
            number += 1
            name = f"{self.name}_{number}"
        return name
