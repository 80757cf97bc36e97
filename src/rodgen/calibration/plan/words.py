"""Numbers, ranges and lists in the sentences of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.units import parse_unit
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.data.observations import Observations

__all__ = ["it_or_them", "joint_unit", "number", "range_text", "some"]

NAMES = 4
"""Names in a list that is not the point of its sentence; the others are counted."""


def number(value: float) -> str:
    """Write a number of a command."""
    return f"{value + 0.0:.4g}"


def joint_unit(o: Observations, j: int) -> tuple[str, float]:
    """Return the unit that a joint is commanded in, and its internal value."""
    unit = o.data.columns[o.machine.joints[j].name].unit or ""
    return unit, parse_unit(unit).factor(o.machine.length_unit)


def range_text(o: Observations, j: int, values: NDArray[Any]) -> str:
    """Write a range of coordinates, or the one."""
    unit, factor = joint_unit(o, j)
    low, high = number(np.min(values) / factor), number(np.max(values) / factor)
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def some(names: Sequence[str], most: int = NAMES) -> str:
    """Join names, and count those beyond the first few."""
    return joined([*names[:most], f"{len(names) - most} more"] if len(names) > most + 1 else list(names))


def it_or_them(names: Sequence[str]) -> str:
    """Return the pronoun for one or several names."""
    return "it" if len(names) == 1 else "them"
