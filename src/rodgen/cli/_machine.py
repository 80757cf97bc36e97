"""Files and options that the commands of machines have in common."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import OneOf, Option, argument, choice, flag, notify, option
from rodgen.cli._values import InputFile, OutputFile
from rodgen.errors import RodgenError
from rodgen.stages import stage

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Diagnosis
    from rodgen.calibration.fitted import Fit
    from rodgen.machines.observations import Observations


FILES = """\
MACHINE is a machine file (TOML), DATA a measurement file, CSV (gzip or not) or Parquet, one row a measurement:

  X [mm],C [deg],target,x [mm],y [mm],z [mm],t [s],T_C [degC],load [N],run
"""


MACHINE = argument("MACHINE", "the machine file", InputFile)
DATA = argument("DATA", "the measurements; '-' is CSV on standard input", InputFile)
DATA_OR_NONE = argument("DATA", "the measurements; '-' is CSV on standard input", InputFile, nargs="?")
LOSS = choice(
    "--loss",
    ("linear", "huber"),
    "linear is least squares (default); huber sets outliers aside",
    default="linear",
)
JSON = flag("--json", "print JSON, and nothing else, on standard output")
SCHEDULER = option(
    "--scheduler WHERE", "threads (default), processes, either with =N, or Dask: tcp://HOST:PORT"
)
TEST = option("--test FILE", "further measurements: the error on them before and after", InputFile)
PLACE = OneOf(
    option("--joint J", "the joint that the effect is at"),
    option("--target T", "the target that the effect is at"),
)


def plot(what: str) -> Option:
    """Return ``--plot``, the file in which `what` is drawn."""
    return option("--plot FILE", f"draw {what}: .html, .png, .svg or .pdf", OutputFile)


def load_data(file: str, scheduler: str | None = None) -> Any:
    """Read measurements; those of many files, or for a scheduler, are a `Scan`, which is read later."""
    with stage("starting"):
        from rodgen.data.measurements import Measurements
        from rodgen.data.tables.parts import is_many

    with stage("reading"):
        return Measurements.scan(file) if scheduler is not None or is_many(file) else Measurements.load(file)


def fitted(options: argparse.Namespace, *, shown: bool = False) -> Fit:
    """Return the fit of MACHINE to DATA; where no answer shows what it says of wrong readings, a remark names these."""
    with stage("starting"):
        from rodgen.calibration.effort import why_long
        from rodgen.calibration.fit import fit
        from rodgen.machines.machine import Machine

    with stage("reading"):
        machine = Machine.load(options.machine)
    data = load_data(options.data, getattr(options, "scheduler", None))
    _remark(why_long(machine, data))
    fit_of_data = fit(machine, data, loss=options.loss)
    if not shown:
        remark_on_rows(fit_of_data.observations)
        remark_on_readings(fit_of_data)
    return fit_of_data


def _remark(text: str) -> None:
    if text:
        notify(text)


def remark_on_rows(observations: Observations) -> None:
    """Say on standard error that rows are copies of others, or set aside."""
    for sentence in observations.on_rows:
        notify(sentence)


def remark_on_readings(fit: Fit) -> None:
    """Name readings that are grossly wrong, on standard error."""
    from rodgen.calibration.gross_readings import on_gross_readings

    _remark(on_gross_readings(fit))


def wrong_file(fit: Fit, options: argparse.Namespace) -> str:
    """Return one line on what is wrong with MACHINE or DATA; empty where they are plausible."""
    with stage("checking the files"):
        sentence = fit.check().sentence
    return f"{sentence} 'rodgen check {options.machine} {options.data}' says more." if sentence else ""


def diagnosed(
    options: argparse.Namespace,
    test: str | None = None,
    prefer: Collection[tuple[str, str | None]] = (),
    *,
    shown: bool = False,
) -> Diagnosis:
    """Return the diagnosis of MACHINE from DATA; `test` is the file of --test, `prefer` what --prefer says.

    Where no answer shows what it says of copied rows, a remark does.
    """
    with stage("starting"):
        from rodgen.calibration.diagnose import diagnose
        from rodgen.calibration.effort import why_long
        from rodgen.machines.machine import Machine

    with stage("reading"):
        machine = Machine.load(options.machine)
    for name, place in prefer:
        try:
            machine.kind_of(place)
        except RodgenError as error:
            raise RodgenError(f"command line: --prefer {name}@{place}: {error}") from None
    data = load_data(options.data, getattr(options, "scheduler", None))
    _remark(why_long(machine, data, diagnosis=True))
    diagnosis = diagnose(machine, data, test=load_data(test) if test else None, prefer=prefer)
    if not shown:
        remark_on_rows(diagnosis.base.observations)
    return diagnosis


def figures_for(path: str | None) -> Any:
    """Return `rodgen.output.figures` to draw into a file, whose name is checked first; None without a file.

    Raises
    ------
    InputFileError
        When the name is none of a figure.
    """
    if not path:
        return None
    from rodgen.output import figures

    figures.check_figure_name(path)
    return figures
