"""A picture of the orientations that a 3-SPS-S machine can take up."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from rodgen.kinematics.three_sps_s._workspace import OrientationStatus, Workspace

__all__ = ["draw_workspace", "save_workspace_plot"]

PANELS = 6
COLOURS = {
    OrientationStatus.ALLOWED: "#9ecae1",
    OrientationStatus.TOO_SHORT: "#d9d9d9",
    OrientationStatus.TOO_LONG: "#bdbdbd",
    OrientationStatus.NEAR_SINGULAR: "#d62728",
    OrientationStatus.OTHER_SIDE: "#fdd0a2",
    OrientationStatus.NOT_NORMAL: "#9ecae1",
    OrientationStatus.INVALID: "#ffffff",
}
JOINED = "#3182bd"


def draw_workspace(found: Workspace) -> Any:
    """Draw maps of tilt and azimuth, one for each of up to six torsions.

    Parameters
    ----------
    found : Workspace
        What is drawn: the tilt is the distance from the middle, the azimuth the direction.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    count = min(PANELS, len(found.torsion))
    # middles of equal parts, so that a torsion and its opposite are both there
    chosen = ((np.arange(count) + 0.5) * len(found.torsion) / count).astype(int)
    columns = min(3, count)
    figure = Figure(figsize=(3.6 * columns + 0.4, 3.9 * -(-count // columns) + 0.6), layout="constrained")
    colours = ListedColormap([*COLOURS.values(), JOINED])
    step_azimuth, step_tilt = np.pi / len(found.tilt), np.degrees(np.pi / len(found.tilt))
    edges_azimuth = np.append(found.azimuth - step_azimuth / 2, found.azimuth[-1] + step_azimuth / 2)
    edges_tilt = np.append(np.degrees(found.tilt) - step_tilt / 2, 180.0)
    for panel, n in enumerate(chosen, 1):
        axes: Any = figure.add_subplot(-(-count // columns), columns, panel, projection="polar")
        codes = np.where(found.joined[n], len(COLOURS), found.status[n])
        axes.pcolormesh(
            edges_azimuth,
            edges_tilt,
            codes.T,
            cmap=colours,
            vmin=-0.5,
            vmax=len(COLOURS) + 0.5,
            rasterized=True,
        )
        closed = np.append(found.determinant[n], found.determinant[n][:1], axis=0)
        around = np.append(found.azimuth, found.azimuth[0] + 2 * np.pi)
        axes.contour(around, np.degrees(found.tilt), closed.T, levels=[0.0], colors="black", linewidths=1.2)
        axes.set_rticks([45, 90, 135])
        axes.set_title(f"torsion {np.degrees(found.torsion[n]):.0f}°", fontsize=10)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    present = set(np.unique(found.status).tolist())
    patches = [
        Patch(color=colour, label=code.name.lower().replace("_", " "))
        for code, colour in COLOURS.items()
        if int(code) in present
    ]
    patches.insert(0, Patch(color=JOINED, label="allowed, joined to the best"))
    figure.legend(handles=patches, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def save_workspace_plot(path: str | os.PathLike[str], found: Workspace) -> None:
    """Draw the maps of :func:`draw_workspace` into a file.

    Parameters
    ----------
    path : str or os.PathLike
        ``.png``, ``.svg`` or ``.pdf``.
    found : Workspace
        What is drawn.
    """
    draw_workspace(found).savefig(path, dpi=100)
