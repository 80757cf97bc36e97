"""Map of the uncertainty of the tool over a slice of the workspace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._grids import around, coordinates_of, plane_points
from rodgen.kinematics.tricept._uncertainty import ellipsoid, place_covariance
from rodgen.views import html_of


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

    across: Array
    up: Array
    names: tuple[str, str, str]
    value: float
    u: Array
    largest: Array
    status: NDArray[np.int8]

    _repr_html_ = html_of


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
    _, first, second = coordinates_of(plane)
    reach = float(limits[1]) + geometry.R + geometry.r + float(np.abs(geometry.q).sum())
    # once to find where the workspace is, once to map it
    across, up = (np.linspace(0.0 if k == 2 else -reach, reach, 161) for k in (first, second))
    for attempt in range(2):
        points = plane_points(plane, value, across, up).swapaxes(0, 1)
        U_y, status = place_covariance(points, geometry, U, limits)
        inside = np.asarray(status) == TriceptStatus.REACHABLE
        if not inside.any():
            raise RodgenError(
                f"no point with {plane} = {value:g} is in the workspace; expected another value"
            )
        if attempt == 0:
            across, up = around(across, inside.any(axis=0), n), around(up, inside.any(axis=1), n)
    U_y = np.where(inside[..., None, None], U_y, np.nan)
    u = np.sqrt(np.diagonal(U_y, axis1=-2, axis2=-1))
    largest = np.asarray(ellipsoid(U_y).semi_axes)[..., 0]
    names = ("xyz"[first], "xyz"[second], plane)
    return UncertaintyMap(across, up, names, float(value), u, largest, np.asarray(status))
