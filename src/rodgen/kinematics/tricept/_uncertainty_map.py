"""Map of the uncertainty of the tool over a slice of the workspace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._uncertainty import ellipsoid, place_covariance

__all__ = ["UncertaintyMap", "uncertainty_map"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class UncertaintyMap:
    """Standard uncertainties over a slice of space.

    Attributes
    ----------
    across, up : ndarray, shape (n,) and (m,)
        Coordinates of the points in the slice.
    names : tuple of str
        Which coordinates these are, and which one is held: such as ``("x", "z", "y")``.
    value : float
        At what that is held.
    u : ndarray, shape (m, n, 3)
        u(Qx), u(Qy), u(Qz); NaN outside the workspace.
    largest : ndarray, shape (m, n)
        The largest semi-axis of the standard ellipsoid.
    status : ndarray, shape (m, n) of int8
        Codes of :class:`TriceptStatus`.
    """

    across: Floats
    up: Floats
    names: tuple[str, str, str]
    value: float
    u: Floats
    largest: Floats
    status: NDArray[np.int8]


def uncertainty_map(
    geometry: Geometry,
    U: ArrayLike,
    plane: str,
    value: float,
    limits: Sequence[float],
    n: int = 121,
) -> UncertaintyMap:
    """Return the uncertainty of points of a slice of the workspace from the covariance of the parameters.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    U : array_like (5, 5) or (n, n)
        Covariance of the paper's five parameters, or of all.
    plane : {"x", "y", "z"}
        The coordinate that is held.
    value : float
        Its value.
    limits : pair of floats
        Least and greatest length of a rod; outside is no map.
    n : int, optional
        Points along each side.

    Returns
    -------
    UncertaintyMap

    Raises
    ------
    RodgenError
        When the plane is not x, y or z, or no point of the slice is in the workspace.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    >>> found = tricept.uncertainty_map(tricept.PAPER, U_x, "z", 700.0, tricept.LEG_LIMITS, n=41)
    >>> bool(np.nanmin(found.u) > 0.002)
    True
    """
    if plane not in ("x", "y", "z"):
        raise RodgenError(f"{plane!r} is no coordinate; expected x, y or z")
    held = "xyz".index(plane)
    first, second = (k for k in range(3) if k != held)
    reach = float(limits[1]) + geometry.R + geometry.r + float(np.abs(geometry.q).sum())
    span = [(-reach, reach), (-reach, reach), (0.0, reach)]
    # once to find where the workspace is, once to map it
    across, up = (np.linspace(*span[k], 161) for k in (first, second))
    for attempt in range(2):
        points = np.empty((len(up), len(across), 3))
        points[..., held] = value
        points[..., first], points[..., second] = across, up[:, None]
        U_y, status = place_covariance(points, geometry, U, limits)
        inside = np.asarray(status) == TriceptStatus.REACHABLE
        if not inside.any():
            raise RodgenError(
                f"no point with {plane} = {value:g} is in the workspace; expected another value"
            )
        if attempt == 0:
            columns, rows = np.flatnonzero(inside.any(axis=0)), np.flatnonzero(inside.any(axis=1))
            ends = [
                (grid[max(some[0] - 1, 0)], grid[min(some[-1] + 1, len(grid) - 1)])
                for grid, some in ((across, columns), (up, rows))
            ]
            across, up = (np.linspace(*end, n) for end in ends)
    U_y = np.where(inside[..., None, None], U_y, np.nan)
    u = np.sqrt(np.diagonal(U_y, axis1=-2, axis2=-1))
    largest = np.asarray(ellipsoid(U_y).semi_axes)[..., 0]
    names = ("xyz"[first], "xyz"[second], plane)
    return UncertaintyMap(across, up, names, float(value), u, largest, np.asarray(status))
