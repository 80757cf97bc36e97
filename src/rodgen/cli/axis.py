"""``rodgen solve`` and ``rodgen fit-axis``: axes from pairs of points."""

from __future__ import annotations

import argparse
import contextlib
import math
import re

from rodgen.cli._console import OK, Command, reading, show, tell
from rodgen.errors import InputFileError, RodgenError, shown

__all__ = ["add_to"]

_PAIRS = """\
The table, CSV (gzip or not) or Parquet, has one row a pair of points, seen before and after a rotation by a
known angle, with a unit in brackets after each column's name; it may have further columns:

  rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]

Any units of length and angle will do, also different ones in one table: um, m, inch, rad, arcsec, mrad, ...
"""

_SOLVE = f"""\
Find, for every pair of a table, both unit axes about which the rotation can have been, through the origin.

{_PAIRS}
The output gets every column of the table, then
  e1_x e1_y e1_z e2_x e2_y e2_z   the unit axes
  status                          two_axes; one_axis (tangent); no_axis (the angle is too small: both are the
                                  least-squares axis); parallel; perpendicular; every_axis; lengths_differ;
                                  invalid
  length_mismatch                 |rho'|/|rho| - 1
  condition                       by how much errors of the points grow in the axes
"""

_FIT = f"""\
Fit one axis to all pairs of a table: its direction, a point on it, their uncertainties, and what the data do
not determine.

{_PAIRS}"""


def add_to(command: Command) -> None:
    """Add the commands."""
    solve = command("solve", _solve, "axes of every pair of points of a table", _SOLVE)
    solve.add_argument("pairs", metavar="PAIRS", help="the table; '-' is CSV on standard input")
    solve.add_argument(
        "-o", "--output", metavar="FILE", help=".csv, .csv.gz or .parquet; default: CSV on standard output"
    )
    solve.add_argument(
        "--length-tolerance",
        metavar="RATIO",
        type=_ratio,
        help="mismatch of the lengths of rho and rho' beyond which the status is lengths_differ "
        "(a ratio; default 1e-8; measured points need some six times their relative uncertainty)",
    )

    fit = command("fit-axis", _fit_axis, "one axis from all pairs of a table", _FIT)
    fit.add_argument("pairs", metavar="PAIRS", help="the table; '-' is CSV on standard input")
    fit.add_argument(
        "--point",
        type=_point,
        default="free",
        metavar="free|origin|X,Y,Z",
        help="the point on the axis: fitted too (default), the origin, or this one, in the unit of rho_x",
    )
    fit.add_argument(
        "--loss",
        choices=("linear", "huber", "cauchy", "tukey"),
        default="linear",
        help="what a large residual costs: linear is least squares (default), the others resist outliers",
    )
    fit.add_argument(
        "--sigma",
        type=_length,
        metavar="LENGTH",
        help="standard uncertainty of one coordinate of one reading, with its unit, such as 0.01mm; "
        "default: estimated from the residuals",
    )
    fit.add_argument(
        "--json", action="store_true", help="print JSON: lengths in the unit of rho_x, angles in rad"
    )
    fit.add_argument("--plot", metavar="FILE", help="draw the pairs and residuals: .png, .svg or .pdf")


def _ratio(text: str) -> float:
    with contextlib.suppress(ValueError):
        value = float(text)
        if 0 <= value < math.inf:
            return value
    raise argparse.ArgumentTypeError(f"{shown(text)} is no ratio: a number from 0 up, such as 1e-6")


def _point(text: str) -> str | tuple[float, ...]:
    if text in ("free", "origin"):
        return "free" if text == "free" else (0.0, 0.0, 0.0)
    with contextlib.suppress(ValueError):
        point = tuple(float(part) for part in text.split(","))
        if len(point) == 3 and all(map(math.isfinite, point)):
            return point
    raise argparse.ArgumentTypeError(
        f"{shown(text)} is none of free, origin, and three numbers such as 1,2.5,-3"
    )


def _length(text: str) -> tuple[float, str]:
    found = re.fullmatch(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*?)\s*", text)
    if found and 0 < float(found[1]) < math.inf:
        return float(found[1]), found[2]
    raise argparse.ArgumentTypeError(f"{shown(text)} is no positive length with its unit, such as 0.01mm")


def _solve(options: argparse.Namespace) -> int:
    from rodgen.data.tables import solve_table

    with contextlib.ExitStack() as stack:
        summary = solve_table(
            options.pairs,
            options.output,
            length_tolerance=options.length_tolerance,
            progress=reading(stack),
        )
    counts = ", ".join(f"{count} {name}" for name, count in summary.counts.items())
    name = "standard input" if options.pairs == "-" else options.pairs
    if "lengths_differ" in summary.counts:
        counts += " (see --length-tolerance)"
    tell(f"{name}: {summary.rows} pair{'s' * (summary.rows != 1)}: {counts}")
    return OK


def _fit_axis(options: argparse.Namespace) -> int:
    from rodgen.data.tables import read_pairs
    from rodgen.kinematics.axis_fit import fit_axis

    pairs = read_pairs(options.pairs)
    sigma = None
    if options.sigma is not None:
        value, unit = options.sigma
        sigma = _in_unit(value, unit, pairs.unit)
    try:
        fit = fit_axis(
            pairs.rho, pairs.rho_prime, pairs.angle, point=options.point, loss=options.loss, sigma=sigma
        )
    except InputFileError:
        raise
    except RodgenError as error:
        raise RodgenError(f"{options.pairs}: {error}") from None
    if options.plot:
        from rodgen.output.axis_figure import save_axis_plot

        save_axis_plot(options.plot, pairs, fit)
    if options.json:
        import json

        show(json.dumps({"file": options.pairs, "unit": pairs.unit, **fit.to_dict()}, allow_nan=False))
    else:
        show(f"{options.pairs}, lengths in {pairs.unit}")
        show(fit.summary())
    return OK


def _in_unit(value: float, unit: str, target: str) -> float:
    from rodgen.data.units import UnitError, conversion_factor

    try:
        return value * conversion_factor(unit, "length", target)
    except UnitError as error:
        raise InputFileError("command line", "--sigma", error.found, error.expected) from None
