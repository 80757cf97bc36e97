"""``rodgen fit-axis``: one axis from pairs of points."""

from __future__ import annotations

import argparse
import contextlib
import math

from rodgen.cli._console import NOT_CONVERGED, OK, Command, show
from rodgen.cli._machine import add_plot, figures_for
from rodgen.cli._values import InputFile, quantity
from rodgen.errors import InputFileError, RodgenError, shown

_FIT = """\
Fit one axis to all pairs of a table: its direction, a point on it, their uncertainties, and what the data do
not determine. The exit code is 3 where they determine no single line.

The table, CSV (gzip or not) or Parquet, has one row a pair of points, seen before and after a rotation by a
known angle, with a unit in brackets after each column's name; it may have further columns:

  rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]

Any units of length and angle will do, also different ones in one table: um, m, inch, rad, arcsec, mrad, ...
"""


def add_to(command: Command) -> None:
    """Add the command."""
    fit = command("fit-axis", _fit_axis, "one axis from all pairs of a table", _FIT)
    fit.add_argument("pairs", metavar="PAIRS", type=InputFile, help="the table; '-' is CSV on standard input")
    fit.add_argument(
        "--point",
        type=_point,
        default="free",
        metavar="free|origin|X,Y,Z",
        help="the point on the axis: fitted too (default), the origin, or this one, in the unit of rho_x",
    )
    fit.add_argument(
        "--loss",
        choices=("linear", "huber"),
        default="linear",
        help="what a large residual costs: linear is least squares (default), huber resists outliers",
    )
    fit.add_argument(
        "--sigma",
        type=quantity("--sigma", "0.01mm", positive=True),
        metavar="LENGTH",
        help="standard uncertainty of one coordinate of one reading, with its unit, such as 0.01mm; "
        "default: estimated from the residuals",
    )
    fit.add_argument(
        "--json", action="store_true", help="print JSON: lengths in the unit of rho_x, angles in rad"
    )
    add_plot(fit, "the pairs and residuals")


def _point(text: str) -> str | tuple[float, ...]:
    if text in ("free", "origin"):
        return "free" if text == "free" else (0.0, 0.0, 0.0)
    with contextlib.suppress(ValueError):
        point = tuple(float(part) for part in text.split(","))
        if len(point) == 3 and all(map(math.isfinite, point)):
            return point
    raise argparse.ArgumentTypeError(
        f"{shown(text)} is neither free, origin nor three numbers such as 1,2.5,-3"
    )


def _fit_axis(options: argparse.Namespace) -> int:
    from rodgen.data.tables import read_pairs
    from rodgen.kinematics.axis_fit import AxisFitStatus, fit_axis

    figures = figures_for(options.plot)
    pairs = read_pairs(options.pairs)
    sigma = options.sigma.to(pairs.unit)[0] if options.sigma else None
    try:
        fit = fit_axis(
            pairs.rho, pairs.rho_prime, pairs.angle, point=options.point, loss=options.loss, sigma=sigma
        )
    except InputFileError:
        raise
    except RodgenError as error:
        raise RodgenError(f"{options.pairs}: {error}") from None
    if figures:
        figures.save_figure(figures.axis_fit(fit, pairs), options.plot)
    if options.json:
        import json

        show(json.dumps({"file": options.pairs, "unit": pairs.unit, **fit.to_dict()}, allow_nan=False))
    else:
        show(f"{options.pairs}, lengths in {pairs.unit}")
        show(fit.summary(pairs.places))
    return OK if fit.status < AxisFitStatus.TWO_AXES else NOT_CONVERGED
