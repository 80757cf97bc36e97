"""Write reports, of a machine or of a fleet, as one file that asks for nothing from outside."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import starmap
from typing import TYPE_CHECKING

from rodgen.calibration.diagnosis import VERDICTS, Diagnosis
from rodgen.calibration.fleet.summary import drawn_parameters, machines
from rodgen.calibration.words import capitalized
from rodgen.document import Document
from rodgen.errors import InputFileError, joined
from rodgen.files import OutputSet, write_file
from rodgen.output.figures import diagnosis as figures_of
from rodgen.output.figures import fleet_nights, fleet_parameter, save_figures
from rodgen.output.figures.diagnoses import unit_of
from rodgen.output.figures.html import figure_block, page
from rodgen.output.report.content import below_the_title, report
from rodgen.views import to_json

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rodgen.calibration.fleet import Fleet
    from rodgen.calibration.plan import Plan


NIGHTS = 6
"""Changes that are drawn."""


def write_report(
    diagnosis: Diagnosis,
    path: str | os.PathLike[str],
    plan: Plan | None = None,
    *,
    images: str | os.PathLike[str] | None = None,
    radii: Mapping[str, float] | None = None,
) -> list[str]:
    """Write what a diagnosis found as one HTML file that needs no network, or the same as JSON.

    Parameters
    ----------
    diagnosis : Diagnosis
    path : str or os.PathLike
        The page; JSON where it ends in ``.json``.
    plan : Plan, optional
        What to measure next; see `Diagnosis.plan`.
    images : str or os.PathLike, optional
        A folder for its figures, each as PNG and as SVG, which need Chrome or Chromium.
    radii : mapping of str to float, optional
        Radii of the scales of joints, by name, in millimetres: an eccentricity is then given in micrometres.

    Returns
    -------
    list of str
        The files that were written, the page first.

    Raises
    ------
    InputFileError
        When one of them cannot be written, a radius is that of no joint, or there is no browser for images.
    """
    figures, document, text = _drawn(diagnosis, plan, radii or {})
    return _written(path, document, text, figures, images)


def report_page(
    diagnosis: Diagnosis,
    plan: Plan | None = None,
    *,
    radii: Mapping[str, float] | None = None,
) -> str:
    """Return the page as text; see `write_report`."""
    return _drawn(diagnosis, plan, radii or {})[2]


def _drawn(
    diagnosis: Diagnosis, plan: Plan | None, radii: Mapping[str, float]
) -> tuple[list[go.Figure], Document, str]:
    _check(diagnosis, radii)
    figures = list(figures_of(diagnosis, plan))
    # The page has the ranking as a table, with bars of its own.
    drawn = [figure for figure in figures if figure.layout.meta["name"] != "ranking"]
    document = report(
        diagnosis, plan, unit_of(diagnosis), radii, list(starmap(figure_block, enumerate(drawn)))
    )
    window = capitalized(VERDICTS[diagnosis.verdict])
    text = page(document, drawn, over="Diagnosis", more=below_the_title(diagnosis), window=window)
    return figures, document, text


def _written(
    path: str | os.PathLike[str],
    document: Document,
    text: str,
    figures: list[go.Figure],
    images: str | os.PathLike[str] | None,
) -> list[str]:
    if os.fspath(path).lower().endswith(".json"):
        text = f"{to_json(document, indent=1)}\n"
    with OutputSet():
        write_file(path, text.encode())
        return [os.fspath(path), *(save_figures(figures, images) if images is not None else [])]


def _check(diagnosis: Diagnosis, radii: Mapping[str, float]) -> None:
    joints = [joint.name for joint in diagnosis.base.machine.joints if joint.revolute]
    for name in radii:
        if name not in joints:
            there = joined(joints) or "none: this machine has no revolute joint"
            raise InputFileError("command line", "--radius", f"no revolute joint {name!r}", there)


def fleet_figures(fleet: Fleet) -> list[go.Figure]:
    """Return the figures of a page about a fleet."""
    surest = {change.machine: change for change in reversed(fleet.changes.found)}  # one of each machine
    drawn = sorted(surest.values(), key=lambda change: change.p_value)[:NIGHTS]
    figures = [fleet_nights(fleet.changes, change) for change in drawn]
    return figures + [fleet_parameter(p) for kind in fleet.kinds for p in drawn_parameters(kind)]


def write_fleet_report(
    fleet: Fleet, path: str | os.PathLike[str], *, images: str | os.PathLike[str] | None = None
) -> list[str]:
    """Write what is known of a fleet as one HTML file that needs no network, or the same as JSON.

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
    figures, summary = fleet_figures(fleet), fleet.document()
    places = [figure_block(number, figure) for number, figure in enumerate(figures)]
    blocks = [*summary.blocks, *places, *map(machines, fleet.kinds)]
    document = Document(blocks, f"Fleet, {fleet.plan.date}")
    return _written(path, document, page(document, figures, over="Many machines"), figures, images)
