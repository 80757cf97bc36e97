"""Numbers, ranges and lists in the sentences of a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.data.observations import Observations

VALUES = 5
"""Values that a sentence lists; of more only the first and the last."""


def number(value: float) -> str:
    """Write a number of a command."""
    return f"{value + 0.0:.4g}"


def range_text(o: Observations, j: int, values: NDArray[Any]) -> str:
    """Write a range of coordinates, or the one."""
    unit, factor = o.unit_of(o.machine.joints[j].column)
    low, high = number(np.min(values) / factor), number(np.max(values) / factor)
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def values_text(values: NDArray[Any], unit: str) -> str:
    """Write values with their unit."""
    texts = list(dict.fromkeys(number(x) for x in np.unique(values)))
    some = f"{len(texts)} values from {texts[0]} to {texts[-1]}" if len(texts) > VALUES else joined(texts)
    return f"{some} {unit}"
