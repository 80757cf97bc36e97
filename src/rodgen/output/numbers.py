"""Numbers as people read them: one unit for all errors of a report."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rodgen.calibration.words import three_digits
from rodgen.data.units import readable

_SYMBOLS = {"um": "µm", "micrometer": "µm", "micron": "µm"}


@dataclass(frozen=True)
class Shown:
    """The unit of errors."""

    unit: str
    factor: float
    """What an error in the diagnosis' unit is multiplied by."""

    def __call__(self, value: float | None) -> str:
        """Write an error of the diagnosis, without its unit."""
        if value is None or not math.isfinite(value):
            return "–"
        return self.plain(value * self.factor)

    def plain(self, value: float) -> str:
        """Write an error that is in `unit` already."""
        return three_digits(value)


def shown_unit(unit: str, values: list[float | None]) -> Shown:
    """Choose the unit in which errors are shown: micrometres where millimetres would begin with zeros.

    Examples
    --------
    >>> shown = shown_unit("mm", [0.0214, 0.0021])
    >>> shown.unit, shown(0.0214), shown(None)
    ('µm', '21.4', '–')
    """
    known = (v for v in values if v is not None and math.isfinite(v))
    factor, unit = readable(unit, max(known, default=0.0))
    return Shown(_SYMBOLS.get(unit, unit), factor)


def minus(text: str) -> str:
    """Return a number's text with the sign that people write."""
    return text.replace("-", "−")
