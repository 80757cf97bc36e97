"""Files and options that the commands of machines have in common."""

from __future__ import annotations

import argparse
import contextlib
from typing import TYPE_CHECKING

from rodgen.cli._console import reading_progress

if TYPE_CHECKING:
    from rodgen.data.measurements import Measurements

__all__ = ["FILES", "add_files", "add_json", "add_loss", "add_place", "load_data"]

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
