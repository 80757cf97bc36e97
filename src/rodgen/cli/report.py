"""``rodgen report``: what is missing in a machine's model, on one page."""

from __future__ import annotations

import argparse
import contextlib
import math
import os

from rodgen.cli._console import OK, Command, after_fits, option, refused, repeated, show
from rodgen.cli._machine import DATA_OR_NONE, FILES, MACHINE, TEST, diagnosed
from rodgen.cli._values import OutputFile, OutputFolder
from rodgen.errors import InputFileError, RodgenError
from rodgen.files import is_device
from rodgen.stages import stage

_REPORT = f"""\
Diagnose a machine, plan what to measure next, and write both as one HTML page, which needs no network; its figures can
be zoomed, and saved as PNG and SVG. With the folder of a fleet's results instead of both files, it shows what
'rodgen fleet' found. --images needs Chrome or Chromium.

{FILES}
  rodgen report table.toml balls.csv -o report.html --radius C=40mm
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "report",
        _run,
        _REPORT,
        MACHINE,
        DATA_OR_NONE,
        option("-o --output PAGE.html", "the page; .json: what it says as JSON", OutputFile, required=True),
        TEST,
        option("--images FOLDER", "write the page's figures there, too, as PNG and SVG", OutputFolder),
        repeated("--radius JOINT=LENGTH", "of a joint's scale, such as C=40mm; may be repeated"),
    )


def _run(options: argparse.Namespace) -> int:
    import jinja2  # noqa: F401 - its absence is reported before a long diagnosis, not after
    import plotly  # noqa: F401

    if options.data is None:
        return _of_fleet(options)
    from rodgen.calibration.plan import PlanError, plan
    from rodgen.output.report import write_report

    _check_output(options)
    if options.images:
        from rodgen.output.figures import check_images

        check_images(options.images)
    radii = dict(_radius(text) for text in options.radius)
    diagnosis = diagnosed(options, options.test)
    planned = None
    with stage("planning"), contextlib.suppress(PlanError):
        planned = plan(diagnosis)
    with stage("drawing"):
        files = write_report(diagnosis, options.output, planned, images=options.images, radii=radii)
    show("\n".join(files))
    return after_fits(all(each.solution.converged for each in diagnosis.fits))


def _of_fleet(options: argparse.Namespace) -> int:
    if not os.path.isdir(options.machine):
        raise refused("rodgen report", "no DATA", "it, or the folder of results of a fleet")
    if options.test or options.radius:
        found = "--test" if options.test else "--radius"
        raise refused(found, "given with results of a fleet", "MACHINE and DATA")
    from rodgen.calibration.fleet import Fleet
    from rodgen.output.report import write_fleet_report

    _check_output(options)
    fleet = Fleet.load(options.machine)
    with stage("drawing"):
        show("\n".join(write_fleet_report(fleet, options.output, images=options.images)))
    return OK


def _check_output(options: argparse.Namespace) -> None:
    """Check the name of the page, before a long diagnosis."""
    if not options.output.lower().endswith((".html", ".htm", ".json")) and not is_device(options.output):
        raise InputFileError(
            options.output, "file", "not the name of a page", "one that ends in .html, .htm or .json"
        )


def _radius(text: str) -> tuple[str, float]:
    """Read ``C=40mm`` as a joint and millimetres."""
    from rodgen.data.units import conversion_factor, number_and_unit

    joint, _, size = text.partition("=")
    number, unit = number_and_unit(size) or (0.0, "")
    with contextlib.suppress(RodgenError):
        value = number * conversion_factor(unit, "length", "mm")
        if joint and 0 < value < math.inf:
            return joint, value
    raise refused("--radius", f"{text!r}", "a joint, '=', a length and its unit, such as C=40mm")
