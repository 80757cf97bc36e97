"""``rodgen compare``: where a machine's model is worst, and what its error depends on."""

from __future__ import annotations

import argparse

from rodgen.cli._console import Command, after_fits, show_result
from rodgen.cli._machine import (
    FILES,
    add_files,
    add_json,
    add_loss,
    add_scheduler,
    fitted,
    wrong_file,
)
from rodgen.cli._values import OutputFile, OutputFolder
from rodgen.stages import stage

_COMPARE = f"""\
Fit a machine, and compare the residuals with everything that was recorded: each joint, direction of approach, time,
run, temperatures, load, further columns, and the position in the workspace. Shows where the model is worst, and how
much of the error each of them explains.

{FILES}"""


def add_to(command: Command) -> None:
    """Add the command."""
    compare = command("compare", _run, "what the error of a machine's model depends on", _COMPARE)
    add_files(compare)
    add_loss(compare)
    compare.add_argument(
        "--plot",
        metavar="PLACE",
        type=_place,
        help="draw the residuals: a page such as residuals.html, or a folder for PNG and SVG",
    )
    add_json(compare)
    add_scheduler(compare)


def _place(text: str) -> OutputFile | OutputFolder:
    return OutputFile(text) if text.lower().endswith((".html", ".htm")) else OutputFolder(text)


def _run(options: argparse.Namespace) -> int:
    if options.plot:
        from rodgen.output import figures

        figures.check_place(options.plot)
    fit = fitted(options, shown=True)
    wrong = wrong_file(fit, options)
    with stage("comparing"):
        comparison = fit.compare()
    plots = []
    if options.plot:
        with stage("drawing"):
            plots = figures.save_figures(figures.comparison(comparison), options.plot)
    show_result(
        options,
        lambda: comparison.to_dict() | {"plots": plots} | ({"wrong_file": wrong} if wrong else {}),
        lambda: "\n".join([*filter(None, [wrong]), str(comparison), *plots]),
    )
    return after_fits(fit.solution.converged)
