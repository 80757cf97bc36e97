"""Maps: how uncertain the tool is over a slice of the workspace, and what one element of U_x does along every beam.

Values are computed by functions that need NumPy alone; Matplotlib is imported where something is drawn.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import InputFileError, RodgenError
from rodgen.files import write_file
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._influence import Influence
from rodgen.kinematics.tricept._uncertainty import ellipsoid, place_covariance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["UncertaintyMap", "draw_influence", "draw_uncertainty_map", "save_figure", "uncertainty_map"]

Floats = NDArray[np.float64]

_QUANTITIES = {
    "x": "u(Qx)",
    "y": "u(Qy)",
    "z": "u(Qz)",
    "largest": "largest semi-axis of the standard ellipsoid",
}


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
    """Propagate the covariance of the parameters to points of a slice of the workspace.

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
        When the plane is none, or no point of the slice is in the workspace.

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


def draw_uncertainty_map(found: UncertaintyMap, unit: str = "mm") -> Figure:
    """Draw a map: u(Qx), u(Qy), u(Qz) and the largest semi-axis, each with contours.

    Parameters
    ----------
    found : UncertaintyMap
        What to draw.
    unit : str, optional
        The unit of length.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    factor, small = (1000.0, "µm") if unit == "mm" else (1.0, unit)
    figure = Figure(figsize=(9.5, 8), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    layers = [*np.moveaxis(found.u, -1, 0), found.largest]
    for panel, values, title in zip(panels.flat, layers, _QUANTITIES.values(), strict=True):
        _shade(panel, figure, found.across, found.up, factor * values, f"{title} [{small}]")
        panel.set_aspect("equal")
    for panel in panels[-1]:
        panel.set_xlabel(f"Q{found.names[0]} [{unit}]")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"Q{found.names[1]} [{unit}]")
    figure.suptitle(
        f"Standard uncertainty of the tool where Q{found.names[2]} = {found.value:g} {unit}", fontsize=11
    )
    return figure


def draw_influence(found: Influence) -> Figure:
    """Draw the least and the greatest influence along each beam, as the paper's figures 3 to 10 do.

    Parameters
    ----------
    found : Influence
        With arrays of two dimensions: alpha along the first, beta along the second or the other way round.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.3), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, values, name in zip(panels, (found.least, found.greatest), ("least", "greatest"), strict=True):
        _shade(
            panel,
            figure,
            np.degrees(found.beta),
            np.degrees(found.alpha),
            values,
            f"{name} value on the beam",
        )
        panel.set_xlabel("β [°]")
    panels[0].set_ylabel("α [°]")
    one, two = found.pair
    figure.suptitle(f"Influence of U_x[{one}, {two}] on U_y[{found.element}]", fontsize=11)
    return figure


def _shade(panel: Any, figure: Any, x: Floats, y: Floats, values: Floats, title: str) -> None:
    known = values[np.isfinite(values)]
    panel.set_title(title, fontsize=10)
    panel.set_facecolor("0.94")
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    shades = panel.pcolormesh(x, y, values, cmap="cividis", shading="nearest", vmin=low, vmax=high)
    shades.set_rasterized(True)
    if high - low > 1e-9 * max(abs(high), abs(low)):
        lines = panel.contour(x, y, values, levels=8, colors="white", linewidths=0.7)
        panel.clabel(lines, fontsize=7)
    figure.colorbar(shades, ax=panel, shrink=0.85)


def save_figure(path: str | os.PathLike[str], figure: Figure) -> None:
    """Write a drawn figure into a file.

    Parameters
    ----------
    path : str or os.PathLike
        Ends in ``.png``, ``.svg`` or ``.pdf``.
    figure : matplotlib.figure.Figure
        What `draw_uncertainty_map` or `draw_influence` returned.

    Raises
    ------
    InputFileError
        When the file cannot be written, or its name has another ending.
    """
    import matplotlib as mpl

    file = os.fspath(path)
    kind = figure_kind(file)
    out = io.BytesIO()
    # No date and no random names: the same map gives the same bytes.
    metadata: Any = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    with mpl.rc_context({"svg.hashsalt": "rodgen"}):
        figure.savefig(out, format=kind, dpi=110, metadata=metadata)
    write_file(file, out.getvalue())


def figure_kind(path: str) -> str:
    """Return what kind of picture a name asks for.

    Raises
    ------
    InputFileError
        When it asks for none.
    """
    kind = os.path.splitext(path)[1].lower()[1:]
    if kind not in ("png", "svg", "pdf"):
        raise InputFileError(
            path, "file", "a name that does not say what to draw", "a name that ends in .png, .svg or .pdf"
        )
    return kind
