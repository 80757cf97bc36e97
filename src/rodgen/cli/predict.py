"""``rodgen predict``: predicted positions of a fitted machine, with their uncertainty."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgen.cli._console import Command, after_fits, argument, conclude, flag, notify, option
from rodgen.cli._machine import DATA, LOSS, MACHINE, SCHEDULER, fitted, load_data
from rodgen.cli._tables import OUTPUT
from rodgen.cli._values import InputFile, number
from rodgen.errors import InputFileError, counted, shown

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

_PREDICT = """\
Fit a machine to measurements, and predict its positions at other commands, with their standard uncertainty from the
fit: U_y = J U_x J^T. It does not include what the model lacks.

DESIGN is a measurement file that needs no readings: what is commanded, and what else the effects depend on (target, t,
T_..., load, run). The output is the same table with the predicted places, their model_u_..., and "determined": 0 where
the measurements do not determine the position. Where DESIGN are many Parquet files, a pattern, a folder or an address,
the output is a new folder of such.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "predict",
        _run,
        _PREDICT,
        MACHINE,
        DATA,
        argument("DESIGN", "what is commanded", InputFile),
        LOSS,
        option(
            "--coverage K",
            "write expanded uncertainties, K times the standard ones",
            number("a coverage factor: a number above 0, such as 2", lambda k: k > 0),
        ),
        flag("--all-digits", "do not round by the uncertainty"),
        SCHEDULER,
        OUTPUT,
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import check_output, copy_with
    from rodgen.data.tables.parts import is_many

    if is_many(options.design):
        return _run_parts(options)
    file = None if options.output == "-" else options.output
    check_output(options.design, options.output)
    design = load_data(options.design)
    fit = fitted(options)
    prediction = fit.predict(design)
    columns = prediction.columns(coverage=options.coverage, rounded=not options.all_digits)
    copy_with(options.design, options.output, columns)
    return _end(options, fit, file or "standard output", design.rows, int((~prediction.determined).sum()))


def _run_parts(options: argparse.Namespace) -> int:
    """Write the predictions for many files into a folder."""
    from rodgen.calibration.predict import predict_parts

    folder = options.output
    if folder in {None, "-"} or folder.endswith((".csv", ".csv.gz", ".parquet")):
        found = "standard output" if folder in {None, "-"} else f"the file {shown(folder)}"
        raise InputFileError(options.design, "file", f"{found} for many files", "a new folder: -o FOLDER")
    design = load_data(options.design)
    fit = fitted(options)
    undetermined = predict_parts(
        fit, design, folder, coverage=options.coverage, rounded=not options.all_digits
    )
    return _end(options, fit, folder, design.rows, undetermined)


def _end(options: argparse.Namespace, fit: Fit, output: str, rows: int, undetermined: int) -> int:
    """Say what was written, and what its uncertainties are."""
    more = f"; {undetermined} not determined by these measurements" if undetermined else ""
    conclude(f"{output}: {counted(rows, 'row')}{more}")
    if options.coverage is not None:
        notify(f"Uncertainties are expanded, k = {options.coverage:g}.")
    notify(fit.dependence.text)
    return after_fits(fit.solution.converged)
