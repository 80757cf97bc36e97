"""``rodgen fit-axis``: one axis from pairs of points."""

from __future__ import annotations

import argparse
import contextlib
import math
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import (
    NOT_CONVERGED,
    OK,
    Command,
    argument,
    arguments_as_options,
    choice,
    flag,
    option,
    refused,
    show,
    show_json,
)
from rodgen.cli._machine import figures_for, plot
from rodgen.cli._values import InputFile, OutputFile, quantity
from rodgen.errors import shown

if TYPE_CHECKING:
    pass

_FIT = """\
Fit one axis to all rows of a table: its direction, a point on it, their uncertainties, and what the data do
not determine. The exit code is 3 where they determine no single line. The table, CSV (gzip or not) or Parquet, has

  rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]
             a pair of points a row, before and after a rotation by a known angle
  the same with move instead of angle
             the angle is not known; rows of one label, three points or more, are one motion
  x [mm],y [mm],z [mm],qw,qx,qy,qz
             a pose a row, of a body that turns and slides along one axis; also r11 ... r33, rx,ry,rz (axis times
             angle) or roll,pitch,yaw; with --instantaneous and a column t [s]: the helical axis at each instant
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "fit-axis",
        _fit_axis,
        _FIT,
        argument("PAIRS", "the table; '-' is CSV on standard input", InputFile),
        option(
            "--point free|origin|X,Y,Z", "a point on the axis, where angles are known; default: free", _point
        ),
        option(
            "--near X,Y,Z",
            "give the point nearest to this one; default: to the middle of the readings",
            _coordinates,
        ),
        choice(
            "--loss",
            ("linear", "huber"),
            "where angles are known: linear (default), or huber, which resists outliers",
        ),
        option(
            "--sigma LENGTH",
            "standard uncertainty of a coordinate; default: estimated",
            quantity("--sigma", "0.01mm", positive=True),
        ),
        option(
            "--sigma-angle ANGLE",
            "standard uncertainty of an attitude or an angle; with --sigma",
            quantity("--sigma-angle", "0.01deg", dimension="angle", positive=True),
        ),
        flag("--instantaneous", "the axis at each instant of a trajectory, from poses with their time"),
        option("-o --output FILE", "with --instantaneous: write a table of all instants", OutputFile),
        flag("--json", "print JSON: lengths in the unit of rho_x, angles in rad"),
        plot("the readings and residuals"),
    )


def _coordinates(text: str) -> tuple[float, ...]:
    with contextlib.suppress(ValueError):
        point = tuple(float(part) for part in text.split(","))
        if len(point) == 3 and all(map(math.isfinite, point)):
            return point
    raise argparse.ArgumentTypeError(f"{shown(text)} is not three numbers such as 1,2.5,-3")


def _point(text: str) -> str | tuple[float, ...]:
    if text in ("free", "origin"):
        return "free" if text == "free" else (0.0, 0.0, 0.0)
    with contextlib.suppress(argparse.ArgumentTypeError):
        return _coordinates(text)
    raise argparse.ArgumentTypeError(
        f"{shown(text)} is neither free, origin nor three numbers such as 1,2.5,-3"
    )


def _fit_axis(options: argparse.Namespace) -> int:
    from rodgen.calibration.axis_of_table import fit_axis_of
    from rodgen.data.tables import read_motions, write_columns
    from rodgen.kinematics.axis_fit import AxisFitStatus

    figures = figures_for(options.plot)
    table = read_motions(options.pairs)
    if options.plot and options.instantaneous:
        raise refused("--plot", "--instantaneous", "it with one axis of all rows")
    if options.output and not options.instantaneous:
        raise refused("--output", "no --instantaneous", "both, for the table of all instants")
    with arguments_as_options():
        fit: Any = fit_axis_of(
            table,
            point=options.point,
            near=options.near,
            loss=options.loss,
            sigma=options.sigma.to(table.unit)[0] if options.sigma else None,
            sigma_angle=options.sigma_angle.to("rad")[0] if options.sigma_angle else None,
            instantaneous=options.instantaneous,
        )
    if options.output:
        write_columns(options.output, fit.columns(table.unit))
    if figures:
        figures.save_figure(figures.axis_fit(fit, table), options.plot)
    if options.json:
        show_json({"file": options.pairs, "unit": table.unit, **fit.to_dict()}, indent=None)
    else:
        show(f"{options.pairs}, lengths in {table.unit}")
        show(fit.summary() if options.instantaneous else fit.summary(table.places))
    return OK if options.instantaneous or fit.status < AxisFitStatus.TWO_AXES else NOT_CONVERGED
