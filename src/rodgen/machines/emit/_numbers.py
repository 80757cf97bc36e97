"""The numbers of emitted files: as many digits as uncertainties allow where people read, else what controls resolve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.data.units import parse_unit
from rodgen.statistics.digits import measured

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine


K = 2.0
"""Coverage factor of expanded uncertainties, as certificates have it."""
STEP = 1e-3
"""Standard deviations by which machines are varied: so little that all changes in proportion, which links of nearly
parallel axes do not over whole ones."""
ROUNDING = 1e-12
"""Uncertainties below this part of a number, or of the size of the machine, count as rounding."""
DECIMALS = 10
"""Of millimetres and degrees: far below what any control resolves, so that rounding is no error."""


Covariance: TypeAlias = tuple[Sequence[str], Any]
"""Keys of parameters, and their covariance in internal units."""


def varied(machine: Machine, covariance: Covariance | None) -> list[Machine]:
    """Return the machine, and it moved a step along each principal axis of a covariance."""
    machines = [machine]
    if covariance is None or not np.isfinite(covariance[1]).all():
        return machines
    keys, matrix = covariance
    values, vectors = np.linalg.eigh(matrix)
    for value, vector in zip(values, vectors.T, strict=True):
        if value > 0:
            step = dict(zip(keys, STEP * math.sqrt(value) * vector, strict=True))
            moved = {key: machine.values.get(key, 0.0) + change for key, change in step.items()}
            machines.append(replace(machine, values={**machine.values, **moved}))
    return machines


def standard(variants: Sequence[Array], turn: float = math.inf) -> Array:
    """Return standard uncertainties of what is found on the first of varied machines, to first order.

    Changes are those within half a `turn`, for angles. What does not vary has 0, but for rounding.
    """
    first, *others = variants
    total, largest = np.zeros(np.shape(first)), np.abs(first)
    for variant in others:
        change = variant - first
        change = change - turn * np.round(change / turn) if math.isfinite(turn) else change
        total, largest = total + change**2, np.maximum(largest, np.abs(variant))
    u = np.sqrt(total)
    return np.where(u > ROUNDING * largest, u / STEP, 0.0)


def said_of_uncertainties(machines: Sequence[object]) -> list[str]:
    """Say what U is, where there are varied machines."""
    if len(machines) == 1:
        return []
    lacks = "what the model lacks is not in it, and numbers without one are held"
    return [f"U is the expanded uncertainty, k = {K:g}, from the fit; {lacks}."]


def number(value: float, unit: str) -> str:
    """Return a number of a table in a unit, as controls read it.

    Examples
    --------
    >>> number(0.1 + 0.2, "mm"), number(-1e-11, "deg"), number(12.0, "um"), number(1.23456789, "m")
    ('0.3', '0', '12', '1.23456789')
    """
    if not math.isfinite(value):
        return "nan"
    of = parse_unit(unit)
    scale = of.factor("mm") / (1.0 if of.dimension["length"] else parse_unit("deg").factor())
    text = f"{value:.{max(round(DECIMALS + math.log10(scale)), 0)}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text


def numbers(values: Array, unit: str) -> list[str]:
    """Return the texts of numbers, as controls read them."""
    return [number(x, unit) for x in values.tolist()]


def uncertain_number(value: float, u: float, unit: str) -> tuple[str, str]:
    """Return a number as people read it, and its expanded uncertainty; none where that is 0."""
    return measured(value, u) if u > 0 else (number(value, unit), "")


def csv_text(columns: Mapping[str, Array], uncertain: Mapping[str, Array] | None = None) -> str:
    """Return a table whose headers end with their units in brackets.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (n,)
    uncertain : mapping of str to ndarray, optional
        Expanded uncertainties of columns, each a column U(...) after its own unless nothing varies there. They say how
        many digits their columns have.
    """
    texts: dict[str, Sequence[str]] = {}
    for header, values in columns.items():
        name, _, unit = header.rstrip("]").partition(" [")
        u = (uncertain or {}).get(header)
        if u is None or not np.any(u > 0):
            texts[header] = numbers(values, unit)
            continue
        pairs = [uncertain_number(*pair, unit) for pair in zip(values.tolist(), u.tolist(), strict=True)]
        texts[header], texts[f"U({name}) [{unit}]"] = zip(*pairs, strict=True)
    return "".join(f"{','.join(row)}\n" for row in ([*texts], *zip(*texts.values(), strict=True)))
