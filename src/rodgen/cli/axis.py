"""``rodgen solve`` and ``rodgen fit-axis``: axes from pairs of points."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import NOT_CONVERGED, OK, Command, conclude, reading_progress, show
from rodgen.cli._machine import add_scheduler
from rodgen.cli._plot import add_plot, figures_for
from rodgen.cli._tables import add_table, counted, map_files
from rodgen.cli._values import InputFile, number, quantity
from rodgen.errors import InputFileError, RodgenError, shown

if TYPE_CHECKING:
    from rodgen.data.tables import MapSummary

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
  condition                       factor by which errors of the points grow in the axes

Where PAIRS are many Parquet files, a pattern or a folder, the output is a new folder of such.
"""

_FIT = f"""\
Fit one axis to all pairs of a table: its direction, a point on it, their uncertainties, and what the data do
not determine. The exit code is 3 where they determine no single line.

{_PAIRS}"""


def add_to(command: Command) -> None:
    """Add the commands."""
    solve = command("solve", _solve, "axes of every pair of points of a table", _SOLVE)
    add_table(solve, "PAIRS")
    add_scheduler(solve)
    solve.add_argument(
        "--length-tolerance",
        metavar="RATIO",
        type=number("a ratio: a number from 0 up, such as 1e-6", lambda x: x >= 0),
        help="mismatch of the lengths of rho and rho' beyond which the status is lengths_differ "
        "(a ratio; default 1e-8; for measured points about six times their relative uncertainty)",
    )

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


def solve_table(path: str, output: str | None = None, *, progress: Any = None, **options: Any) -> MapSummary:
    """Write both axes of every pair of a table, in bounded memory.

    Parameters
    ----------
    path, output, progress
        As in `rodgen.data.tables.map_table`.
    **options
        As in `rodgen.solve_axis`.

    Returns
    -------
    MapSummary
    """
    import numpy as np

    from rodgen.data.tables import PAIR_COLUMNS, Result, map_table
    from rodgen.kinematics.axis import AxisStatus, axis_condition, length_mismatch, solve_axis

    results = [
        *(Result(f"e{root}_{axis}", "number") for root in (1, 2) for axis in "xyz"),
        Result("status", AxisStatus),
        Result("length_mismatch", "number"),
        Result("condition", "number"),
    ]

    def solve(values: Sequence[Any]) -> Any:
        rho, rho_prime, angle = np.column_stack(values[:3]), np.column_stack(values[3:6]), values[6]
        axes, status = solve_axis(rho, rho_prime, angle, **options)
        numbers = length_mismatch(rho, rho_prime), axis_condition(rho, rho_prime, angle)
        return [*axes.reshape(-1, 6).T, status, *numbers], None

    return map_table(path, output, PAIR_COLUMNS, lambda unit: (results, solve), progress=progress)


def _solve(options: argparse.Namespace) -> int:
    given = {} if options.length_tolerance is None else {"length_tolerance": options.length_tolerance}
    from rodgen.data.tables.parts import is_many

    if is_many(options.table):
        summary = map_files(options.table, options.output, lambda file, to: solve_table(file, to, **given))
    else:
        with contextlib.ExitStack() as stack:
            summary = solve_table(options.table, options.output, progress=reading_progress(stack), **given)
    hint = " (see --length-tolerance)" if "lengths_differ" in summary.counts else ""
    conclude(counted(options.table, summary, "pair") + hint)
    return OK


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
