"""Definitions of effects from a user's formula, with every check that needs no measurements."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rodgen.data.units import ANGLE, FORCE, ONE, TEMPERATURE, TIME, Dimension, UnitError, parse_unit
from rodgen.errors import InputFileError, shown
from rodgen.machines.effects.definition import (
    OF_A_LOOP,
    SKY,
    EffectDefinition,
    StartSearch,
    component_dimension,
    coordinate_dimension,
)
from rodgen.machines.effects.formula import FUNCTION_NAMES, Formula, FormulaError
from rodgen.machines.measured import POINT, Measurand

_MOST_PARAMETERS = 40
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")
_OF_JOINT = frozenset({"q", "s", "v", "T"})
WORDS = _OF_JOINT | {"t", "F", "pi"} | FUNCTION_NAMES
"""Words of formulas: no parameter has such a name, nor a joint that a formula names."""
_MOTIONS = ("tx", "ty", "tz", "rx", "ry", "rz")
WAVE = "a*sin(2*pi*q/P) + b*cos(2*pi*q/P)"
"""Formula of a wave along a joint's way, of which the period is searched as such."""
OWN_COMPONENTS = ("reading", *_MOTIONS)
"""What a user's effect may change."""


def own_effect(
    name: str,
    component: str,
    formula: str,
    parameters: Mapping[str, str],
    meaning: str = "",
    *,
    others: Mapping[str, str] | None = None,
    at: str,
    joints: Mapping[str, str] | None = None,
    columns: Mapping[str, Dimension | None] | None = None,
    measurand: Measurand = POINT,
    file: str | os.PathLike[str],
    place: str,
) -> EffectDefinition:
    """Return the definition of an effect with a user's formula.

    Parameters
    ----------
    name : str
        A name of its own.
    component : str
        ``"reading"`` (of a joint), or one of ``tx ty tz rx ry rz``.
    formula : str
        In the words of users' formulas: q s v T (of the joint), t, F, joints, columns, pi, functions, parameters.
    parameters : mapping of str to str
        Names with units; at most 40, each in a formula.
    others : mapping of str to str
        Further components that it changes, each with a formula of the same parameters.
    at : {"revolute", "prismatic", "leg", "tower", "arm", "machine", "target"}
        Where it stands.
    joints : mapping of str to str
        Name and type of each joint of the machine.
    columns : mapping of str to Dimension or None
        Further columns of the measurements; None as a dimension is not known. Left out altogether: there are no
        measurements yet, and every other name in the formula is taken for a column.
    measurand : Measurand
        What the machine measures.
    file, place : str
        Where it stands, for error messages.

    Raises
    ------
    InputFileError
        One sentence with the key that is wrong.

    Examples
    --------
    >>> effect = own_effect(
    ...     "coupling_windup", "reading", "a*sin(q) + k*F", {"a": "arcsec", "k": "arcsec/N"},
    ...     at="revolute", file="machine.toml", place="effect 1",
    ... )
    >>> effect.equation
    'reading += a*sin(q) + k*F'
    """
    checked = _Check(at, joints or {}, columns, measurand, file, place)
    checked.name(name)
    key = {component: "formula" if others is None else component}
    texts = {component: formula, **(others or {})}
    for each in texts:
        checked.component(each)
    checked.parameters(parameters)
    parsed = {
        each: Formula.parse(text, file=file, place=f"{place}, {key.get(each, each)}")
        for each, text in texts.items()
    }
    checked.used(list(parsed.values()), parameters)
    for each, one in parsed.items():
        checked.names(one, parameters, key.get(each, each))
        checked.dimension(one, parameters, each, key.get(each, each))
    first, *more = parsed.items()
    wave = component == "reading" and formula == WAVE and not others
    searched = {
        p: StartSearch.PERIOD if wave else StartSearch.ANY
        for p in parameters
        if any(p in one.inner_names for one in parsed.values())
    }
    return EffectDefinition(
        name, frozenset({at}), first[0], first[1], dict(parameters), meaning, searched=searched, own=True,
        others=tuple(more),
    )  # fmt: skip


@dataclass(frozen=True)
class _Check:
    """What a definition is checked against; see :func:`own_effect`."""

    at: str
    joints: Mapping[str, str]
    columns: Mapping[str, Dimension | None] | None
    measurand: Measurand
    file: str | os.PathLike[str]
    place: str

    def error(self, key: str, found: str, expected: str) -> InputFileError:
        return InputFileError(self.file, f"{self.place}, {key}", found, expected)

    def name(self, name: str) -> None:
        if not _IDENTIFIER.fullmatch(name):
            raise self.error("name", shown(name), "letters, digits and '_', a letter first, 60 at most")

    def component(self, component: str) -> None:
        turns = not self.measurand.moving
        # a direction is not moved, and a point is not turned about itself
        fitting = {
            "revolute": ("reading", *_MOTIONS),
            "prismatic": ("reading", *_MOTIONS),
            **dict.fromkeys(OF_A_LOOP, ("reading",)),
            "target": _MOTIONS[3:] if turns else _MOTIONS[:3],
            "machine": _MOTIONS,
        }[self.at]
        if turns:
            fitting = tuple(c for c in fitting if c not in _MOTIONS[:3])
        if component not in fitting:
            where = f"a {self.at}" + (" joint" if self.at in {"revolute", "prismatic"} else "")
            raise self.error("component", f"{shown(component)} at {where}", f"one of {', '.join(fitting)}")

    def parameters(self, parameters: Mapping[str, str]) -> None:
        if len(parameters) > _MOST_PARAMETERS:
            raise self.error("parameters", f"{len(parameters)} parameters", f"at most {_MOST_PARAMETERS}")
        for name, unit in parameters.items():
            key = f"parameters.{shown(name)[1:-1]}"
            if not _IDENTIFIER.fullmatch(name):
                raise self.error(key, shown(name), "letters, digits and '_', a letter first, 60 at most")
            if name in WORDS or name in self.joints:
                what = "a joint" if name in self.joints else "a word of formulas"
                raise self.error(key, f"{name!r}, the name of {what}", "another name")
            try:
                parse_unit(unit)
            except UnitError as error:
                raise self.error(key, error.found, error.expected) from None

    def used(self, formulas: Sequence[Formula], parameters: Mapping[str, str]) -> None:
        names = frozenset[str]().union(*(formula.names for formula in formulas))
        for name in parameters:
            if name not in names:
                raise self.error(
                    f"parameters.{name}", "a parameter that is not in the formula", "those that are"
                )

    def names(self, formula: Formula, parameters: Mapping[str, str], key: str) -> None:
        for name in sorted(formula.names - parameters.keys() - self.joints.keys()):
            if name in _OF_JOINT and self.at not in {"revolute", "prismatic", *OF_A_LOOP}:
                raise self.error(
                    key,
                    f"{name!r}, which only a joint has",
                    "a joint by its name, or an effect at a joint",
                )
            if name in SKY and self.measurand.is_direction:
                continue
            if name not in WORDS and self.columns is not None and name not in self.columns:
                columns = ", ".join(self.columns) or "none"
                raise self.error(key, f"{name!r}, no parameter, joint or column", f"a column: {columns}")

    def dimension(self, formula: Formula, parameters: Mapping[str, str], component: str, key: str) -> None:
        wanted = component_dimension(component, self.at, self.measurand)
        known: dict[str, Dimension | None] = dict.fromkeys(formula.names)
        known |= self.columns or {}
        known |= dict.fromkeys(SKY, ANGLE) if self.measurand.is_direction else {}
        known |= {joint: coordinate_dimension(kind) for joint, kind in self.joints.items()}
        of_coordinate = coordinate_dimension(self.at)
        known |= {
            "t": TIME,
            "F": FORCE,
            "q": of_coordinate,
            "s": ONE,
            "v": of_coordinate / TIME,
            "T": TEMPERATURE,
        }
        known |= {name: parse_unit(unit).dimension for name, unit in parameters.items()}
        try:
            dimension = formula.dimension(known)
        except FormulaError as error:
            raise self.error(key, error.found, error.expected) from None
        bare = formula.names <= {"pi"}
        if dimension is not None and not bare and not dimension.fits(wanted):
            raise self.error(
                key,
                f"a value in {dimension}",
                f"{wanted} for component {component!r}; check the parameters' units",
            )
