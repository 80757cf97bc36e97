"""How well a machine could be modelled at all, from the data alone: the noise floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgen.discrepancy.fit import Fit

__all__ = ["LackOfFit", "NoiseFloor", "lack_of_fit", "noise_floor"]


@dataclass(frozen=True)
class NoiseFloor:
    """Standard deviation of a scalar reading."""

    value: float | None
    text: str

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"value": self.value}


@dataclass(frozen=True)
class LackOfFit:
    """Whether the residuals are larger than the noise."""

    p_value: float
    text: str

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"p_value": self.p_value}


def noise_floor(fit: Fit) -> NoiseFloor:
    """Return the noise floor."""
    return NoiseFloor(None, "the noise is not known")


def lack_of_fit(fit: Fit) -> LackOfFit | None:
    """Return the lack of fit."""
    return None
