"""``rodgen tricept uncertainty``: uncertainty of the tool at points, its budget, and maps."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._console import OK, Command, located, notify, refused, show, show_json
from rodgen.cli._plot import add_plot, figures_for
from rodgen.cli._tables import Columns, add_table, map_rows, named
from rodgen.cli._values import number, plane, quantity, whole
from rodgen.cli.tricept._covariance import COVARIANCE_TEXT, add_covariance, covariance_of, source_of
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of, needed, unit_of
from rodgen.errors import InputFileError

_TEXT = f"""\
Propagate the uncertainty of a Tricept's parameters to its tool at every point of a table, with the columns

  Qx [mm],Qy [mm],Qz [mm]

in any unit of length. The output gets every column of the table, then
  u(Qx) [mm] u(Qy) [mm] u(Qz) [mm]                   standard uncertainties
  cov(Qx,Qy) [mm**2] cov(Qx,Qz) ... cov(Qy,Qz) ...   covariances
  a1 [mm] a2 [mm] a3 [mm]                            semi-axes of the ellipsoid, the greatest first
  a1_x a1_y ... a3_z                                 their directions
  status                                             reachable; out_of_limits; unreachable; singular; ...
With --budget or --monte-carlo, these are printed for each point instead, with its status. With --plot and --slice a map
is drawn, and the table may be left out.

{COVARIANCE_TEXT}"""

_PROBABILITY = number("a probability between 0 and 1, such as 0.95", lambda x: 0 < x < 1)

# A budget or a million draws for more points than this is unreadable.
_MOST_POINTS = 100


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command(
        "uncertainty", _run, "uncertainty of the tool at points, budget, Monte Carlo, maps", _TEXT
    )
    add_table(parser, "POINTS", needed=False)
    parser.add_argument(
        "--point",
        metavar="X,Y,Z",
        type=quantity("--point", "0,0,700mm", 3),
        help="one point instead of a table",
    )
    add_geometry(parser)
    add_covariance(parser)
    parser.add_argument(
        "--probability", metavar="P", type=_PROBABILITY, help="of the ellipsoid and of intervals; default: the "
        "standard ellipsoid (k = 1), and intervals of 0.95",
    )  # fmt: skip
    parser.add_argument("--budget", action="store_true", help="the contribution of each parameter")
    parser.add_argument(
        "--monte-carlo",
        metavar="N",
        type=whole(1000, 100_000_000),
        help="N draws through the exact direct problem (GUM Supplement 1)",
    )
    parser.add_argument(
        "--rectangular",
        action="store_true",
        help="draw errors from rectangles, ±√3 u, instead of normal ones",
    )
    parser.add_argument("--seed", metavar="N", type=whole(0), default=0, help="of the draws (0)")
    parser.add_argument(
        "--json", action="store_true", help="print JSON, of at most 100 points: angles in rad"
    )
    add_plot(parser, "the map of --slice")
    parser.add_argument(
        "--slice",
        metavar="AXIS=LENGTH",
        type=plane("--slice", "y=0mm"),
        help="the plane of the map, such as y=0mm",
    )


def _run(options: argparse.Namespace) -> int:
    if options.point and options.table:
        raise refused("--point", "together with a table", "one of the two")
    if bool(options.plot) != bool(options.slice):
        missing, other = ("--slice", "y=0mm") if options.plot else ("--plot", "map.png")
        raise refused(missing, "nothing", f"both --plot and --slice, such as {other}")
    if not (options.point or options.table or options.plot):
        raise refused("POINTS", "nothing", "a table, --point, or --plot with --slice")
    if options.json and options.output:
        raise refused("--output", "together with --json", "one of the two")
    if options.plot:
        _draw(options)
    if options.budget or options.monte_carlo:
        if options.output:
            raise refused("--output", "together with --budget or --monte-carlo", "one of the two")
        if not (options.point or options.table):
            raise refused("POINTS", "nothing", "a table, or --point")
        return _analyse(options)
    if options.table and not options.json:
        return _table(options)
    return _listed(options) if options.point or options.table else OK


def _draw(options: argparse.Namespace) -> None:
    from rodgen.kinematics import tricept

    figures = figures_for(options.plot)
    axis, given = options.slice
    unit = unit_of(options)
    geometry, limits = geometry_of(options, unit), needed(limits_of(options, unit))
    with located("command line", "--slice"):
        found = tricept.uncertainty_map(
            geometry, covariance_of(options, unit), axis, given.to(unit)[0], limits
        )
    figures.save_figure(figures.uncertainty_map(found, unit), options.plot)


def _points(options: argparse.Namespace) -> tuple[Any, str]:
    """Return the points, and their unit."""
    if options.point:
        unit = options.point.unit
        return np.array([options.point.to(unit)]), unit
    from rodgen.data.tables import Column, open_table

    with open_table(options.table, [Column(f"Q{axis}", "length") for axis in "xyz"]) as table:
        blocks = [values for values, _ in table.map(lambda rows: np.column_stack(rows.values))]
        unit = table.units()["Qx"]
    points = np.concatenate(blocks)
    if len(points) > _MOST_POINTS:
        raise InputFileError(
            options.table,
            "file",
            f"{len(points)} points",
            f"at most {_MOST_POINTS} with --json, --budget or --monte-carlo",
        )
    return points, unit


def _machine(options: argparse.Namespace, unit: str) -> tuple[Any, Any, Any]:
    """Return geometry, limits and covariance in a unit of length."""
    return geometry_of(options, unit), limits_of(options, unit), covariance_of(options, unit)


def _analyse(options: argparse.Namespace) -> int:
    from rodgen.kinematics import tricept

    points, unit = _points(options)
    geometry, limits, U = _machine(options, unit)
    states = np.atleast_1d(tricept.place_covariance(points, geometry, U, limits)[1])
    rectangular = [name for n, name in enumerate(tricept.PARAMETERS) if U[n, n] > 0]
    answers, texts = [], []
    for nth, point in enumerate(points, start=1):
        status = tricept.TriceptStatus(states[nth - 1]).name.lower()
        answer: dict[str, Any] = {"point": point.tolist(), "unit": unit, "status": status}
        head = f"Q = ({', '.join(f'{x:g}' for x in point)}) {unit}, {status}"
        file, place = ("command line", "--point") if options.point else (options.table, f"point {nth}")
        with located(file, place, "another one"):
            if options.budget:
                made = tricept.budget(point, geometry, U)
                answer["budget"] = made.to_dict()
                texts.append(f"{head}\n{made.summary(unit)}")
            if options.monte_carlo:
                drawn = tricept.monte_carlo(
                    point,
                    geometry,
                    U,
                    draws=options.monte_carlo,
                    rectangular=rectangular if options.rectangular else (),
                    probability=options.probability or 0.95,
                    seed=options.seed,
                )
                answer["monte_carlo"] = drawn.to_dict()
                texts.append(f"{head}\n{drawn.summary(unit)}")
        answers.append(answer)
    if options.json:
        show_json(answers)
    else:
        show("\n".join(texts))
        notify(source_of(options))
    return OK


def _columns() -> Columns:
    from rodgen.kinematics import tricept

    return [
        *named("length", "u(Qx) u(Qy) u(Qz)"),
        *named("area", "cov(Qx,Qy) cov(Qx,Qz) cov(Qy,Qz)"),
        *named("length", "a1 a2 a3"),
        *named("number", "a1_x a1_y a1_z a2_x a2_y a2_z a3_x a3_y a3_z"),
        ("status", tricept.TriceptStatus),
    ]


def _values(points: Any, geometry: Any, limits: Any, U: Any, probability: float | None) -> list[Any]:
    from rodgen.kinematics import tricept

    U_y, status = tricept.place_covariance(points, geometry, U, limits)
    found = tricept.ellipsoid(U_y, probability)
    with np.errstate(invalid="ignore"):
        u = np.sqrt(np.diagonal(U_y, axis1=-2, axis2=-1))
    directions = np.swapaxes(found.directions, -1, -2).reshape(-1, 9)
    off = [U_y[:, 0, 1], U_y[:, 0, 2], U_y[:, 1, 2]]
    return [*u.T, *off, *found.semi_axes.T, *directions.T, np.asarray(status)]


def _table(options: argparse.Namespace) -> int:
    def prepare(unit: str) -> tuple[Columns, Any]:
        machine = _machine(options, unit)
        return _columns(), lambda points: (_values(points, *machine, options.probability), None)

    code = map_rows(options, named("length", "Qx Qy Qz"), prepare)
    notify(source_of(options))
    return code


def _listed(options: argparse.Namespace) -> int:
    """Print one point, or as JSON those of a table."""
    from rodgen.kinematics import tricept

    points, unit = _points(options)
    values = _values(points, *_machine(options, unit), options.probability)
    columns = _columns()
    answers = []
    for n, point in enumerate(points.tolist()):
        answer = {name: value[n].item() for (name, _), value in zip(columns, values, strict=True)}
        answer["status"] = tricept.TriceptStatus(answer["status"]).name.lower()
        answers.append({"point": point, **answer})
    if options.json:
        common = {"unit": unit, "U_x": source_of(options)}
        show_json(common | ({"points": answers} if options.table else answers[0]))
        return OK
    units = {"length": unit, "area": f"{unit}²"}
    lines = []
    for name, kind in columns:
        value = answers[0][name]
        text = value if isinstance(value, str) else format(value, ".5g")
        lines.append(f"{name:11} {text} {units.get(kind, '')}".rstrip())
    show("\n".join(lines))
    notify(source_of(options))
    return OK
