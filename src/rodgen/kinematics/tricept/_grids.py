"""Grids of points or beams that are fitted to a region."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError


def grid_points(*axes: Array) -> Array:
    """Return the points (k, n) of a grid, given the values of each of its k coordinates; the last one runs fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1)


def around(grid: Array, inside: NDArray[np.bool_], count: int) -> Array:
    """Return `count` values over the part of a grid that is inside, and one step of the grid more on both sides."""
    some = np.flatnonzero(inside)
    return np.linspace(grid[max(some[0] - 1, 0)], grid[min(some[-1] + 1, len(grid) - 1)], count)


def coordinates_of(plane: str) -> tuple[int, int, int]:
    """Return which coordinate a plane holds constant, and the other two."""
    if plane not in ("x", "y", "z"):
        raise RodgenError(f"{plane!r} is not a coordinate; expected x, y or z")
    held = "xyz".index(plane)
    first, second = (n for n in range(3) if n != held)
    return held, first, second


def plane_points(plane: str, value: float, one: Array, other: Array) -> Array:
    """Return the points (n, m, 3) of a plane at n values of its first coordinate and m of its second one."""
    held, first, second = coordinates_of(plane)
    points = np.empty((len(one), len(other), 3))
    points[..., held] = value
    points[..., first], points[..., second] = one[:, None], other
    return points
