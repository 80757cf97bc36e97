"""Write the report as one file that asks for nothing from outside."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import starmap
from typing import TYPE_CHECKING

from rodgen.calibration.diagnosis import Diagnosis
from rodgen.errors import InputFileError, joined
from rodgen.files import OutputSet, write_file
from rodgen.output.figures import diagnosis as figures_of
from rodgen.output.figures import save_figures
from rodgen.output.figures.diagnoses import unit_of
from rodgen.output.figures.html import figure_block, page
from rodgen.output.report.content import below_the_title, report

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rodgen.calibration.plan import Plan


def write_report(
    diagnosis: Diagnosis,
    path: str | os.PathLike[str],
    plan: Plan | None = None,
    *,
    images: str | os.PathLike[str] | None = None,
    radii: Mapping[str, float] | None = None,
) -> list[str]:
    """Write what a diagnosis found as one HTML file that needs no network.

    Parameters
    ----------
    diagnosis : Diagnosis
    path : str or os.PathLike
        The page.
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
    figures, page = _made(diagnosis, plan, radii or {})
    with OutputSet():
        write_file(path, page.encode())
        return [os.fspath(path), *(save_figures(figures, images) if images is not None else [])]


def report_page(
    diagnosis: Diagnosis,
    plan: Plan | None = None,
    *,
    radii: Mapping[str, float] | None = None,
) -> str:
    """Return the page as text; see `write_report`."""
    return _made(diagnosis, plan, radii or {})[1]


def _made(diagnosis: Diagnosis, plan: Plan | None, radii: Mapping[str, float]) -> tuple[list[go.Figure], str]:
    _check(diagnosis, radii)
    figures = list(figures_of(diagnosis, plan))
    # The page has the ranking as a table, with bars of its own.
    drawn = [figure for figure in figures if figure.layout.meta["name"] != "ranking"]
    document = report(
        diagnosis, plan, unit_of(diagnosis), radii, list(starmap(figure_block, enumerate(drawn)))
    )
    return figures, page(document, drawn, over="Diagnosis", more=below_the_title(diagnosis))


def _check(diagnosis: Diagnosis, radii: Mapping[str, float]) -> None:
    joints = [joint.name for joint in diagnosis.base.machine.joints if joint.revolute]
    for name in radii:
        if name not in joints:
            there = joined(joints) or "none: this machine has no revolute joint"
            raise InputFileError("command line", "--radius", f"no revolute joint {name!r}", there)
