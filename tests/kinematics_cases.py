"""Unit vectors, rotations and displacements from their definitions, for tests of kinematics."""

from __future__ import annotations

from typing import Any

import numpy as np


def unit(vectors: Any) -> np.ndarray:
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rotations(angle: Any, axis: int) -> np.ndarray:
    """Rotations (..., 3, 3) about x, y or z, which are 0, 1, 2."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((*np.shape(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[..., axis, axis] = 1
    found[..., i, i] = found[..., j, j] = c
    found[..., i, j], found[..., j, i] = -s, s
    return found


def rx(angle: float) -> np.ndarray:
    return _displacement(rotations(angle, 0))


def rz(angle: float) -> np.ndarray:
    return _displacement(rotations(angle, 2))


def shift(x: float = 0.0, z: float = 0.0) -> np.ndarray:
    return _displacement(np.eye(3), (x, 0.0, z))


def _displacement(rotation: np.ndarray, origin: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, origin
    return found
