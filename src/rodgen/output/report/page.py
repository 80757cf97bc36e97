"""Put the page together: content, pictures, style and script in one file that asks for nothing from outside."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Callable, Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.errors import InputFileError
from rodgen.files import write_file
from rodgen.output.report.chart import Chart
from rodgen.output.report.charts import charts
from rodgen.output.report.content import content, unit_of
from rodgen.output.report.last_model import last_fit
from rodgen.output.report.pictures import png
from rodgen.output.report.svg import STYLE, legend_svg, standalone, view_svg

if TYPE_CHECKING:
    from rodgen.calibration.plan import Plan

__all__ = ["report_page", "write_report"]

Progress = Callable[[str], object]


def write_report(
    diagnosis: Diagnosis,
    plan: Plan | None,
    path: str | os.PathLike[str],
    *,
    images: str | os.PathLike[str] | None = None,
    radii: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Write what a diagnosis found as one HTML file that needs no network.

    Parameters
    ----------
    diagnosis : Diagnosis
    plan : Plan or None
        What to measure next.
    path : str or os.PathLike
        The page.
    images : str or os.PathLike, optional
        A folder for its pictures, each as PNG and as SVG.
    radii : mapping of str to float, optional
        Radii of the scales of joints, by name, in millimetres: an eccentricity is then told in micrometres.
    progress : callable, optional
        Called with what is drawn.

    Returns
    -------
    list of str
        The files that were written, the page first.

    Raises
    ------
    InputFileError
        When one of them cannot be written, a radius is that of no joint, or Matplotlib is not there.
    """
    page, pictures = _made(diagnosis, plan, radii or {}, progress)
    files = [os.fspath(path)]
    write_file(path, page.encode())
    if images is not None:
        folder = os.fspath(images)
        try:
            os.makedirs(folder, exist_ok=True)
        except OSError as error:
            found = f"cannot be made ({error.strerror or error})"
            raise InputFileError(folder, "file", found, "a writable folder") from None
        for name, image in pictures.items():
            file = os.path.join(folder, name)
            write_file(file, image)
            files.append(file)
    return files


def report_page(
    diagnosis: Diagnosis,
    plan: Plan | None = None,
    *,
    radii: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> str:
    """Return the page as text; see `write_report`."""
    return _made(diagnosis, plan, radii or {}, progress)[0]


def _made(
    diagnosis: Diagnosis, plan: Plan | None, radii: Mapping[str, float], progress: Progress | None
) -> tuple[str, dict[str, bytes]]:
    _check(diagnosis, radii)
    shown = unit_of(diagnosis)
    last = last_fit(diagnosis)
    made = charts(diagnosis, last, shown, plan)
    pictures: dict[str, bytes] = {}
    figures = []
    for chart in made:
        if progress:
            progress(f"drawing {chart.name}")
        drawn = png(chart), standalone(chart).encode()
        pictures[f"{chart.name}.png"], pictures[f"{chart.name}.svg"] = drawn
        figures.append(_figure(chart, *drawn))
    style, script = _asset("report.css") + "\n" + STYLE, _asset("report.js")
    text = content(diagnosis, last, plan, shown, radii)
    if text["plan"] and text["plan"]["csv"]:
        text["plan"]["link"] = _data("text/csv;charset=utf-8", text["plan"]["csv"].encode())
    page = (
        _environment()
        .get_template("report.html.j2")
        .render(
            **text,
            charts={figure["name"]: figure for figure in figures},
            residuals=[figure for figure in figures if figure["name"].startswith("residuals")],
            tips={figure["ident"]: figure["tips"] for figure in figures if figure["tips"]},
            style=Markup(style),
            script=Markup(script),
            policy=(
                "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
                f"style-src '{_hash(style)}'; script-src '{_hash(script)}'"
            ),
        )
    )
    return page, pictures


def _check(diagnosis: Diagnosis, radii: Mapping[str, float]) -> None:
    joints = [joint.name for joint in diagnosis.base.machine.joints if joint.type == "revolute"]
    for name in radii:
        if name not in joints:
            there = ", ".join(joints) or "none: this machine has no revolute joint"
            raise InputFileError("command line", "--radius", f"no revolute joint {name!r}", there)


def _figure(chart: Chart, as_png: bytes, as_svg: bytes) -> dict[str, Any]:
    """Return what the template needs of a chart."""
    # Charts of the same rows share their tips.
    ident = "rows" if chart.name.startswith("residuals") else chart.name
    return {
        "name": chart.name,
        "ident": ident,
        "title": chart.title,
        "note": chart.note,
        "alt": chart.alt,
        "views": [
            {"key": view.key, "title": view.title, "svg": Markup(view_svg(chart, i, ident=ident))}
            for i, view in enumerate(chart.views)
        ],
        "legend": [{"svg": Markup(legend_svg(look)), "words": words} for look, words in chart.legend],
        "tips": chart.tips,
        "png": _data("image/png", as_png),
        "svg": _data("image/svg+xml", as_svg),
    }


def _data(kind: str, content: bytes) -> Markup:
    return Markup(f"data:{kind};base64,{base64.b64encode(content).decode()}")


def _hash(text: str) -> str:
    """Return what the policy calls a piece of style or script: nothing else runs."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8").strip()


def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
