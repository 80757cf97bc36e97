"""Files and options that the commands of machines have in common."""

from __future__ import annotations

import argparse
import contextlib
from typing import TYPE_CHECKING

from rodgen.cli._console import fit_progress, reading_progress

if TYPE_CHECKING:
    from rodgen.calibration.diagnose import Diagnosis
    from rodgen.calibration.fit import Fit
    from rodgen.data.measurements import Measurements

__all__ = [
    "FILES",
    "add_files",
    "add_json",
    "add_loss",
    "add_place",
    "add_test",
    "diagnosed",
    "fitted",
    "load_data",
]

FILES = """\
MACHINE is a machine file (TOML), DATA a measurement file, CSV (gzip or not) or Parquet, one row a measurement, with a
unit in brackets after each column's name:

  X [mm],C [deg],target,x [mm],y [mm],z [mm],t [s],T_C [degC],load [N],run
"""


def add_files(command: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add MACHINE and DATA; DATA is optional unless `needed`."""
    command.add_argument("machine", metavar="MACHINE", help="the machine file")
    about = "the measurements; '-' is CSV on standard input"
    command.add_argument("data", metavar="DATA", nargs=None if needed else "?", help=about)


def add_loss(command: argparse.ArgumentParser) -> None:
    """Add --loss."""
    command.add_argument(
        "--loss",
        choices=("linear", "huber"),
        default="linear",
        help="linear is least squares (default); huber finds outliers, reports them and sets them aside",
    )


def add_json(command: argparse.ArgumentParser) -> None:
    """Add --json."""
    command.add_argument(
        "--json", action="store_true", help="print JSON, and nothing else, on standard output"
    )


def add_test(command: argparse.ArgumentParser) -> None:
    """Add --test."""
    about = "further measurements, on which the error before and after is reported"
    command.add_argument("--test", metavar="FILE", help=about)


def add_place(command: argparse.ArgumentParser) -> None:
    """Add --joint and --target."""
    place = command.add_mutually_exclusive_group()
    place.add_argument("--joint", metavar="J", help="the joint that the effect is at")
    place.add_argument("--target", metavar="T", help="the target that the effect is at")


def load_data(file: str) -> Measurements:
    """Read measurements, with a progress bar on a terminal."""
    from rodgen.data.measurements import Measurements

    with contextlib.ExitStack() as stack:
        return Measurements.load(file, progress=reading_progress(stack))


def fitted(options: argparse.Namespace) -> Fit:
    """Return the fit of MACHINE to DATA, with its progress on a terminal."""
    from rodgen.machines.machine import Machine

    machine, data = Machine.load(options.machine), load_data(options.data)
    with fit_progress() as progress:
        return machine.fit(data, loss=options.loss, progress=progress)


def diagnosed(options: argparse.Namespace, test: str | None = None) -> Diagnosis:
    """Return the diagnosis of MACHINE from DATA, with its progress on a terminal; `test` is the file of --test."""
    from rodgen.calibration.diagnose import diagnose
    from rodgen.machines.machine import Machine

    machine, data = Machine.load(options.machine), load_data(options.data)
    further = load_data(test) if test else None
    with fit_progress() as progress:
        return diagnose(machine, data, test=further, progress=progress)
