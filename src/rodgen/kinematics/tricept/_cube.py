"""The largest cube in which a Tricept works: everywhere in it, all rods are within their limits.

The largest edge of an axis-aligned cube, about a given centre, on the axis of the machine, or anywhere, is wanted.
Cubes about one centre are nested, so the edge is found by bisection; a rod is not always shortest in a
corner (the rod A is in the middle of an edge), so the result is certified with intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.dimensions import length_limits
from rodgen.kinematics.tricept._bounds import rod_bounds
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._grids import grid_points
from rodgen.kinematics.tricept._kinematics import inverse
from rodgen.kinematics.tricept.branch_and_bound import Extremes
from rodgen.views import html_of

# Corners, middles of edges and of faces: where rods have their extremes, or nearly.
_SPOTS = grid_points(*[np.array([-0.5, 0.0, 0.5])] * 3).T


@dataclass(frozen=True)
class Cube:
    """A cube in which all rods are within their limits.

    Attributes
    ----------
    centre : ndarray, shape (3,)
        Its centre.
    edge : float
        Its edge.
    rods : Extremes
        The rods' certified least and greatest lengths in it, where they are reached, and how it was certified.
    limiting : tuple of (str, str, ndarray)
        Which rods keep it from being larger: name, ``"least"`` or ``"greatest"``, and the point.
    """

    centre: Array
    edge: float
    rods: Extremes
    limiting: tuple[tuple[str, str, Array], ...]

    _repr_html_ = html_of

    @property
    def low(self) -> Array:
        """Its lower corner."""
        return self.centre - self.edge / 2

    @property
    def high(self) -> Array:
        """Its upper corner."""
        return self.centre + self.edge / 2

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON."""
        return {
            "centre": self.centre.tolist(),
            "edge": self.edge,
            "rods_certified": self.rods.outer.tolist(),
            "limited_by": [
                {"rod": rod, "end": end, "point": point.tolist()} for rod, end, point in self.limiting
            ],
        }


def largest_cube(
    geometry: Geometry,
    limits: Sequence[float],
    centre: Literal["axis", "free"] | Sequence[float] = "axis",
) -> Cube:
    """Return the largest cube, parallel to the axes, in which all rods are within their limits.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    limits : pair of floats
        Least and greatest length of a rod.
    centre : {"axis", "free"} or three floats, optional
        Where the cube's centre is: on the z axis, anywhere before the base, or there.

    Returns
    -------
    Cube
        Certified to be inside. About a given centre and on the axis none is larger by 1e-6 of the edge, judged by
        corners and middles; for a free centre it is the best of a search, which may have missed a better one.

    Raises
    ------
    RodgenError
        When there is no such cube.

    Examples
    --------
    >>> from rodgen import tricept
    >>> found = tricept.largest_cube(tricept.PAPER, tricept.LEG_LIMITS)
    >>> round(found.edge, 3), found.centre.round(2)
    (182.705, array([  0.  ,   0.  , 683.14]))
    """
    low, high = length_limits(limits, "rod")
    if not high < np.inf:
        raise RodgenError("the rods have no greatest length; expected limits, between which a cube ends")
    if isinstance(centre, str):
        if centre not in ("axis", "free"):
            raise RodgenError(f"the centre is {centre!r}; expected 'axis', 'free' or three coordinates")
        place, edge = _searched(geometry, low, high, free=centre == "free")
    else:
        place = np.asarray(centre, float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise RodgenError(f"the centre is {centre!r}; expected three finite coordinates")
        edge = float(_edges(place[None], geometry, low, high)[0])
    if not edge > 0:
        raise RodgenError("there is no place for a cube: a rod is beyond its limits at the centre")
    for _ in range(60):
        found = rod_bounds(place - edge / 2, place + edge / 2, geometry, gap=1e-9 * high)
        beyond = max(float((low - found.outer[:, 0]).max()), float((found.outer[:, 1] - high).max()))
        if beyond <= 0:
            return Cube(place, edge, found, _limiting(found, low, high))
        # a rod changes by at most some three times as much as the edge
        edge -= max(beyond / 3, 1e-10 * edge)
    raise RodgenError("no cube could be certified; expected limits that are farther apart")


def _limiting(found: Extremes, low: float, high: float) -> tuple[tuple[str, str, Array], ...]:
    near = 1e-6 * high
    made = []
    for n, name in enumerate(("A0", "A1", "A-1")):
        if found.inner[n, 0] - low < near:
            made.append((name, "least", found.points[n, 0]))
        if high - found.inner[n, 1] < near:
            made.append((name, "greatest", found.points[n, 1]))
    return tuple(made)


def _inside(centres: Array, edges: Array, geometry: Geometry, low: float, high: float) -> NDArray[np.bool_]:
    points = centres[:, None, :] + edges[:, None, None] * _SPOTS
    rods = np.asarray(inverse(points, geometry)[1])[:, :, 0]
    ahead = points[..., 2] > 0  # behind the base the machine is not assembled
    with np.errstate(invalid="ignore"):
        return np.asarray(((rods >= low) & (rods <= high)).all(axis=(1, 2)) & ahead.all(axis=1))


def _edges(centres: Array, geometry: Geometry, low: float, high: float) -> Array:
    """Return the largest edge about each centre, by its spots; 0 where there is none."""
    small, large = np.zeros(len(centres)), np.full(len(centres), 2 * high)
    possible = _inside(centres, small, geometry, low, high)
    for _ in range(44):
        middle = (small + large) / 2
        good = _inside(centres, middle, geometry, low, high)
        small, large = np.where(good, middle, small), np.where(good, large, middle)
    return np.where(possible, small, 0.0)


def _searched(geometry: Geometry, low: float, high: float, *, free: bool) -> tuple[Array, float]:
    """Return the best centre and its edge: a grid about the best one moves there, or shrinks if none is better."""
    start = np.zeros((400, 3))
    start[:, 2] = np.linspace(0, high + abs(geometry.q[2]), 402)[1:-1]
    found = _edges(start, geometry, low, high)
    best, edge = start[found.argmax()], float(found.max())
    if free:
        radius, grid = high / 8, grid_points(*[np.linspace(-1.0, 1.0, 5)] * 3).T
    else:
        radius, grid = float(start[1, 2] - start[0, 2]), np.linspace(-1.0, 1.0, 9)[:, None] * [0.0, 0.0, 1.0]
    random = np.random.default_rng(0)
    while radius > 1e-10 * high:
        around = grid
        if free:  # other directions each time: the best edge has kinks that a fixed grid follows badly
            around = np.concatenate([grid, random.normal(size=(60, 3)) / 2])
        centres = best + radius * around
        found = _edges(centres, geometry, low, high)
        n = int(found.argmax())
        better = found[n] > edge
        if better:
            best, edge = centres[n], float(found[n])
        if not (better and free):
            radius *= 0.5
    return best, edge
