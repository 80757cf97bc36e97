"""``rodgen fit`` and ``compare``: a machine's parameters from measurements, and what the error depends on."""

from __future__ import annotations

import argparse

from rodgen.cli._console import Command, after_fits, option, show_result
from rodgen.cli._machine import DATA, FILES, JSON, LOSS, MACHINE, SCHEDULER, fitted, wrong_file
from rodgen.cli._values import OutputFile, OutputFolder
from rodgen.errors import InputFileError
from rodgen.files import write_file
from rodgen.stages import stage

_FIT = f"""\
Fit a machine's parameters to measurements: values with uncertainties, the remaining error compared with the noise, and
what the measurements do not determine.

{FILES}"""


_COMPARE = f"""\
Fit a machine, and compare the residuals with everything that was recorded: where the model is worst, and how much of
the error each joint, approach, time, run, temperature, load, column, and place in the workspace explains.

{FILES}"""


def add_to(command: Command) -> None:
    """Add the commands."""
    command(
        "fit",
        _run,
        _FIT,
        MACHINE,
        DATA,
        option("-o --output FITTED.toml", "write the machine with the fitted values", OutputFile),
        LOSS,
        option("--residuals FILE", "write the table, with predictions and residuals added", OutputFile),
        JSON,
        SCHEDULER,
    )
    command(
        "compare",
        _compare,
        _COMPARE,
        MACHINE,
        DATA,
        LOSS,
        option("--plot PLACE", "draw the residuals: an HTML page, or a folder for PNG and SVG", _place),
        JSON,
        SCHEDULER,
    )


def _run(options: argparse.Namespace) -> int:
    if options.residuals:
        from rodgen.data.tables import check_output
        from rodgen.data.tables.parts import is_many

        if is_many(options.data):
            expected = "one file; 'rodgen predict' writes the predictions for many"
            raise InputFileError(options.data, "file", "--residuals of many files", expected)
        check_output(options.data, options.residuals)
    fit = fitted(options, shown=True)
    wrong = wrong_file(fit, options)
    with stage("writing the answer"):
        text = "" if options.json else "\n".join(filter(None, [wrong, fit.summary()]))
    if options.output:
        from rodgen.machines.files.write import machine_text
        from rodgen.machines.fixed import fixed_machine

        with stage("writing files"):
            write_file(options.output, machine_text(fixed_machine(fit.excluding_outliers())).encode())
    if options.residuals:
        from rodgen.data.tables import copy_with

        with stage("writing files"):
            copy_with(options.data, options.residuals, fit.residual_columns())
    show_result(options, lambda: fit.to_dict() | ({"wrong_file": wrong} if wrong else {}), lambda: text)
    return after_fits(fit.solution.converged)


def _place(text: str) -> OutputFile | OutputFolder:
    return OutputFile(text) if text.lower().endswith((".html", ".htm")) else OutputFolder(text)


def _compare(options: argparse.Namespace) -> int:
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
