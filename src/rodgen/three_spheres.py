"""The points at given distances from three centres, over any algebra: SymPy's, a tape's, or plain numbers.

Platforms that only shift, such as that of a delta robot, are there. Proved in derivation/delta.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple


class ThreeSpheres(NamedTuple):
    """Where three spheres meet: foot ± normal · √ratio."""

    foot: Any
    """The point of the centres' plane between the two."""
    normal: Any
    """Of that plane, as long as twice the triangle of the centres is large."""
    area: Any
    """Square of the length of the normal: zero where the centres are in a line."""
    ratio: Any
    """Square of the height above the plane, over that of the normal: negative where the spheres do not meet."""
    height: Any
    """Square of the height above the plane."""


def three_spheres(
    let: Callable[[str, Any], Any], centres: Sequence[Any], squares: Sequence[Any]
) -> ThreeSpheres:
    """Return the points with given distances from three centres.

    Parameters
    ----------
    let : callable
        Names a step.
    centres : sequence of column (3,)
        With `dot` and `cross`.
    squares : sequence of 3 values
        Squares of the distances.
    """
    a, b = let("to_second", centres[1] - centres[0]), let("to_third", centres[2] - centres[0])
    normal = let("normal", a.cross(b))
    area = let("area", normal.dot(normal))
    along_a = let("along_second", (a.dot(a) + squares[0] - squares[1]) / 2)
    along_b = let("along_third", (b.dot(b) + squares[0] - squares[2]) / 2)
    way = let("way", (b.cross(normal) * along_a + normal.cross(a) * along_b) / area)
    height = let("height", squares[0] - way.dot(way))
    return ThreeSpheres(let("foot", centres[0] + way), normal, area, let("ratio", height / area), height)
