"""Put the page together: content, figures, style and scripts in one file that asks for nothing from outside."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import jinja2
from markupsafe import Markup

from rodgen.calibration.diagnosis import Diagnosis
from rodgen.errors import InputFileError, joined
from rodgen.files import OutputSet, write_file
from rodgen.output.figures import diagnosis as figures_of
from rodgen.output.figures import save_figures
from rodgen.output.figures.diagnoses import unit_of
from rodgen.output.figures.html import asset, figures_json, policy, scripts
from rodgen.output.report.content import content

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rodgen.calibration.plan import Plan

RESIDUALS = ("residuals", "around_", "quantiles", "autocorrelation")
"""What names of figures of residuals begin with."""
report_asset = partial(asset, package=__package__)


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
    text = content(diagnosis, plan, unit_of(diagnosis), radii)
    if text["plan"] and text["plan"]["csv"]:
        csv = base64.b64encode(text["plan"]["csv"].encode()).decode()
        text["plan"]["link"] = Markup(f"data:text/csv;charset=utf-8;base64,{csv}")
    # The page has the ranking as a table, with bars of its own.
    drawn = [figure for figure in figures if figure.layout.meta["name"] != "ranking"]
    entries = [{"number": number, **figure.layout.meta} for number, figure in enumerate(drawn)]
    code = [*scripts(), report_asset("report.js")]
    page = (
        environment()
        .get_template("report.html.j2")
        .render(
            **text,
            figures_by_name={entry["name"]: entry for entry in entries},
            residuals=[entry for entry in entries if entry["name"].startswith(RESIDUALS)],
            covariates=[entry for entry in entries if entry["name"].startswith("covariate_")],
            drawn=Markup(figures_json(drawn)),
            style=Markup(asset("figures.css") + "\n" + report_asset("report.css")),
            scripts=[Markup(text) for text in code],
            policy=policy(*code),
        )
    )
    return figures, page


def _check(diagnosis: Diagnosis, radii: Mapping[str, float]) -> None:
    joints = [joint.name for joint in diagnosis.base.machine.joints if joint.revolute]
    for name in radii:
        if name not in joints:
            there = joined(joints) or "none: this machine has no revolute joint"
            raise InputFileError("command line", "--radius", f"no revolute joint {name!r}", there)


def environment() -> jinja2.Environment:
    """Return what makes pages of the templates here."""
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(report_asset),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
