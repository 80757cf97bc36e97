"""The page about a fleet, as one file that asks for nothing from outside."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from rodgen.calibration.fleet.summary import drawn_parameters, machines
from rodgen.document import Document
from rodgen.files import OutputSet, write_file
from rodgen.output.figures import fleet_nights, fleet_parameter, save_figures
from rodgen.output.figures.html import figure_block, page

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rodgen.calibration.fleet import Fleet

NIGHTS = 6
"""Changes that are drawn."""


def fleet_figures(fleet: Fleet) -> list[go.Figure]:
    """Return the figures of a page about a fleet."""
    surest = {change.machine: change for change in reversed(fleet.changes.found)}  # one of each machine
    drawn = sorted(surest.values(), key=lambda change: change.p_value)[:NIGHTS]
    figures = [fleet_nights(fleet.changes, change) for change in drawn]
    return figures + [fleet_parameter(p) for kind in fleet.kinds for p in drawn_parameters(kind)]


def write_fleet_report(
    fleet: Fleet, path: str | os.PathLike[str], *, images: str | os.PathLike[str] | None = None
) -> list[str]:
    """Write what is known of a fleet as one HTML file that needs no network.

    Parameters
    ----------
    fleet : rodgen.calibration.fleet.Fleet
    path : str or os.PathLike
    images : str or os.PathLike, optional
        A folder for its figures, each as PNG and as SVG, which need Chrome or Chromium.

    Returns
    -------
    list of str
        The files that were written, the page first.

    Raises
    ------
    InputFileError
        When one of them cannot be written, or there is no browser for images.
    """
    figures, found = fleet_figures(fleet), fleet.document()
    places = [figure_block(number, figure) for number, figure in enumerate(figures)]
    blocks = [*found.blocks, *places, *map(machines, fleet.kinds)]
    text = page(Document(blocks, f"Fleet, {fleet.plan.date}"), figures, over="Many machines")
    with OutputSet():
        write_file(path, text.encode())
        return [os.fspath(path), *(save_figures(figures, images) if images is not None else [])]
