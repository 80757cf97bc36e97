"""Angles less whole turns."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["nearest_turn", "principal"]


def nearest_turn(angles: Any) -> Any:
    """Return angles in [-pi, pi): what is between two directions."""
    return np.remainder(angles + np.pi, 2 * np.pi) - np.pi


def principal(angles: Any) -> Any:
    """Return angles in (-pi, pi], as every solution gives them."""
    found = nearest_turn(angles)
    return np.where(found <= -np.pi, np.pi, found)
