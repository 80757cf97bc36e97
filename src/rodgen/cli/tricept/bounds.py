"""``rodgen tricept bounds``: between which values U_y stays in a cube, the largest cube, and influence maps."""

from __future__ import annotations

import argparse
import re
from typing import Any

import numpy as np

from rodgen.cli._console import OK, Command, conclude, located, notify, refused, show, show_json
from rodgen.cli._plot import add_plot, figures_for
from rodgen.cli._values import OutputFile, number, quantity, whole
from rodgen.cli.tricept._covariance import COVARIANCE_TEXT, add_covariance, covariance_of, source_of
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of, needed, unit_of
from rodgen.errors import shown

_TEXT = f"""\
Bound the six elements of U_y while the tool is anywhere in a cube (or a box): their true range, certified by intervals
and reached at points, and the sums of the influences' ranges, which is the paper's way and encloses that.

The cube is given by --centre and --edge, or found: --largest axis (its centre on the z axis), --largest free, or
--largest about the --centre. With --influence one element of U_x on one of U_y is followed along every beam in the cube
and within the limits of the rods, as in the paper's figures 3 to 10: A0,xx is the variance of A0 on u²(Qx), A0:r,xy the
covariance of A0 and r on u(Qx,Qy). Bounds need the paper's five parameters only.

{COVARIANCE_TEXT}"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("bounds", _run, "bounds of U_y over a cube, the largest cube, influence maps", _TEXT)
    parser.add_argument(
        "--centre",
        metavar="X,Y,Z",
        type=quantity("--centre", "0,0,685mm", 3),
        help="of the cube, such as 0,0,685mm",
    )
    parser.add_argument(
        "--edge",
        metavar="LENGTH",
        type=_edges,
        help="of the cube, such as 160mm; X,Y,Z of a box: 160,160,80mm",
    )
    parser.add_argument(
        "--largest", metavar="WHERE", nargs="?", const="axis", choices=("axis", "free", "centre"),
        help="the largest cube within the limits: axis (default), free, or centre",
    )  # fmt: skip
    add_geometry(parser)
    add_covariance(parser)
    parser.add_argument(
        "--gap", metavar="RATIO", type=number("a ratio from 1e-9 to 1", lambda x: 1e-9 <= x < 1), default=1e-3,
        help="how far certified and reached values may differ, of the greatest magnitude (1e-3)",
    )  # fmt: skip
    parser.add_argument("--influence", metavar="PAIR,ELEMENT", type=_pair, help="such as A0,xx or A0:r,xy")
    parser.add_argument(
        "--beams",
        metavar="N",
        type=whole(2, 2000),
        default=121,
        help="beams of the map in each direction (121)",
    )
    add_plot(parser, "the influence map")
    parser.add_argument("--json", action="store_true", help="print JSON: angles in rad")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=OutputFile,
        help="table of the bounds or of the map: .csv or .parquet",
    )


def _edges(text: str) -> Any:
    found = quantity("--edge", "160mm", 3 if "," in text else 1)(text)
    if min(found.numbers) < 0:
        raise argparse.ArgumentTypeError(f"{shown(text)} is negative")
    return found


def _pair(text: str) -> tuple[tuple[str, str], str]:
    found = re.fullmatch(r"\s*([^,:\s]+)\s*(?::\s*([^,:\s]+)\s*)?,\s*([xyz]{2})\s*", text)
    if found:
        element = "".join(sorted(found[3]))
        return (found[1], found[2] or found[1]), element
    raise argparse.ArgumentTypeError(f"{shown(text)} is not a pair and an element, such as A0,xx or A0:r,xy")


def _run(options: argparse.Namespace) -> int:
    from rodgen.kinematics import tricept

    _check(options)
    unit = unit_of(options) if options.centre is None else options.centre.unit
    geometry, limits = geometry_of(options, unit), limits_of(options, unit)
    with located("command line", "--influence" if options.influence else "cube", "another one"):
        cube = None
        if options.largest:
            centre = options.centre.to(unit) if options.largest == "centre" else options.largest
            cube = tricept.largest_cube(geometry, needed(limits), centre)
            low, high = cube.low, cube.high
        elif options.centre is not None:
            place, edge = np.array(options.centre.to(unit)), np.array(options.edge.to(unit))
            low, high = place - edge / 2, place + edge / 2
        else:
            return _influence(options, geometry, limits, None, unit)
        if options.influence:
            return _influence(options, geometry, limits, (low, high), unit)
        U = covariance_of(options, unit)
        if U[5:, 5:].any():
            raise refused("--u", "parameters beyond the paper's", "A0, A1, A-1, r and R alone (rods, radii)")
        rods = cube.rods if cube else tricept.rod_bounds(low, high, geometry)
        found = tricept.bounds(low, high, geometry, U[:5, :5], gap=options.gap)
    if options.output:
        _write_bounds(options.output, found, unit)
    inside = limits is None or bool(
        (rods.outer[:, 0] >= limits[0]).all() and (rods.outer[:, 1] <= limits[1]).all()
    )
    if options.json:
        extra = {"cube": cube.to_dict()} if cube else {}
        show_json(
            {
                "unit": unit,
                "U_x": source_of(options),
                **extra,
                "rods_certified": rods.outer.tolist(),
                "within_limits": None if limits is None else inside,
                **found.to_dict(),
            }
        )
        return OK
    _print(found, cube, rods, limits, inside, unit)
    notify(source_of(options))
    return OK


def _check(options: argparse.Namespace) -> None:
    if options.largest and options.edge:
        raise refused("--edge", "together with --largest", "one of the two")
    if options.largest == "centre" and options.centre is None:
        raise refused("--centre", "nothing", "the centre of the cube, such as 0,0,685mm")
    if options.largest in ("axis", "free") and options.centre is not None:
        raise refused("--centre", f"together with --largest {options.largest}", "--largest centre")
    if not options.largest and (options.centre is None) != (options.edge is None):
        raise refused("--centre, --edge", "one of them", "both, or --largest")
    if not options.largest and options.centre is None and not options.influence:
        raise refused("--centre, --edge", "nothing", "a cube, or --largest")
    if options.plot and not options.influence:
        raise refused("--plot", "without --influence", "what to draw, such as --influence A0,xx")


def _print(found: Any, cube: Any, rods: Any, limits: Any, inside: bool, unit: str) -> None:
    from rodgen.kinematics import tricept

    text = ", ".join(f"{a:.6g}…{b:.6g}" for a, b in zip(found.low, found.high, strict=True))
    show(f"box {text} {unit}" + (f", edge {cube.edge:.6g} {unit}" if cube else ""))
    for name, (least, greatest) in zip(("A0", "A1", "A-1"), rods.outer, strict=True):
        show(f"  {name:4} {least:.4f} … {greatest:.4f} {unit} certified")
    if limits is not None:
        low, high = limits
        show(f"  {'within' if inside else 'NOT certified to be within'} the limits {low:g} … {high:g} {unit}")
    show(f"U_y [{unit}²]: range certified (reached), and the paper's sum of influences")
    for n, name in enumerate(tricept.ELEMENTS):
        (a, b), (c, d), (e, f) = found.outer[n], found.inner[n], found.base_outer[n]
        show(
            f"  {name}  {a: .5e} … {b: .5e}  ({c: .5e} … {d: .5e})   sum {e: .5e} … {f: .5e}, "
            f"{found.excess[n]:.2f} times as wide"
        )
    if not found.complete:
        show("  the wanted gap was not reached everywhere: the bounds are right, and wider than they need be")


def _write_bounds(path: str, found: Any, unit: str) -> None:
    from rodgen.data.tables import write_columns
    from rodgen.kinematics import tricept

    columns: dict[str, Any] = {"element": list(tricept.ELEMENTS)}
    for name, ends in (
        ("certified", found.outer),
        ("reached", found.inner),
        ("base_sum_certified", found.base_outer),
        ("base_sum_reached", found.base_inner),
    ):
        for k, end in enumerate(("least", "greatest")):
            columns[f"{end}_{name} [{unit}**2]"] = ends[:, k]
    for k, end in enumerate(("least", "greatest")):
        for n, axis in enumerate("xyz"):
            columns[f"{end}_Q{axis} [{unit}]"] = found.points[:, k, n]
    write_columns(path, columns)


def _influence(options: argparse.Namespace, geometry: Any, limits: Any, box: Any, unit: str) -> int:
    from rodgen.data.tables import write_columns
    from rodgen.kinematics import tricept

    figures = figures_for(options.plot)
    pair, element = options.influence
    found = tricept.influence_region(geometry, pair, element, options.beams, limits=limits, box=box)
    known = np.isfinite(found.least)
    if figures:
        figures.save_figure(figures.influence(found), options.plot)
    if options.output:
        columns = {"alpha [deg]": np.degrees(found.alpha), "beta [deg]": np.degrees(found.beta)}
        columns |= {"least": found.least, "greatest": found.greatest}
        columns |= {f"z_least [{unit}]": found.z_least, f"z_greatest [{unit}]": found.z_greatest}
        write_columns(options.output, {name: values[known] for name, values in columns.items()})
    least, greatest = float(np.nanmin(found.least)), float(np.nanmax(found.greatest))
    if options.json:
        show_json(
            {"pair": list(pair), "element": element, "beams": int(known.sum()), "range": [least, greatest]}
        )
    else:
        conclude(
            f"U_x[{pair[0]}, {pair[1]}] on U_y[{element}]: {least:.6g} … {greatest:.6g} on {known.sum()} beams"
        )
    return OK
