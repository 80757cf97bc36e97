"""Angles less whole turns, how far apart they are, and the angle between two directions in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np


def principal(angles: Any) -> Any:
    """Return angles in (-π, π]; those that are there already come back as they are, to the last bit."""
    found = angles - 2 * np.pi * np.round(np.asarray(angles) / (2 * np.pi))
    return np.where(found <= -np.pi, np.pi, found)


def apart(one: Any, other: Any) -> Any:
    """Return the largest difference (...) of sets of angles (..., n), whole turns not counted."""
    return np.abs(principal(one - other)).max(axis=-1)


def angle_between(x: Any, y: Any, u: Any, v: Any) -> Any:
    """Return the angle from the direction (x, y) to (u, v)."""
    return np.arctan2(x * v - y * u, x * u + y * v)
