"""``rodgen tricept workspace``: the region that the rods leave, its size, and planes through it."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from rodgen.cli._console import OK, Command, conclude, located, refused, show, show_json
from rodgen.cli._tables import add_output, status_names
from rodgen.cli._values import plane, whole
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of, needed, unit_of

_TEXT = """\
Measure the region that the lengths of the rods leave to the point: its volume, extents, greatest tilt, and how near it
comes to a singularity (det W33 over its value in an upright pose, which is 1).

With --slice a table of a plane through it is written: Qx, Qy, Qz, status, and that ratio, for a grid of points.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("workspace", _run, "volume, extents and planes of the workspace", _TEXT)
    add_geometry(parser)
    parser.add_argument(
        "--samples", metavar="N", type=whole(2, 4000), help="beams of the quadrature in each direction (400)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON: angles in rad")
    parser.add_argument(
        "--slice", metavar="AXIS=LENGTH", type=plane("--slice", "z=700mm"), help="a plane, such as z=700mm"
    )
    parser.add_argument(
        "--points",
        metavar="N",
        type=whole(2, 4000),
        default=101,
        help="points of the plane in each direction (101)",
    )
    add_output(parser, "where the plane goes: ")


def _run(options: argparse.Namespace) -> int:
    from rodgen.kinematics import tricept

    unit = unit_of(options)
    geometry, limits = geometry_of(options, unit), needed(limits_of(options, unit))
    if options.output and not options.slice:
        raise refused("--output", "no --slice", "a plane for the table, --slice z=700mm")
    if options.json and options.slice:
        raise refused("--slice", "together with --json", "one of the two")
    with located("command line", "--limits"):
        if options.slice:
            return _write_slice(options, geometry, limits, unit)
        measured = tricept.workspace(geometry, limits, options.samples or 400)
    if options.json:
        show_json({"unit": unit, **measured.to_dict()})
        return OK
    low, high = limits
    show(f"rods from {low:.6g} to {high:.6g} {unit}, R = {geometry.R:.6g}, r = {geometry.r:.6g} {unit}")
    show(f"volume      {measured.volume:.6g} {unit}³ (quadrature to about {measured.volume_error:.1g})")
    for name, (least, greatest) in zip(("Qx", "Qy", "Qz"), measured.extents, strict=True):
        show(f"{name:10}  {least:10.3f} … {greatest:10.3f} {unit}")
    for name, (least, greatest) in zip(("alpha", "beta"), measured.pose_extents, strict=False):
        show(f"{name:10}  {math.degrees(least):10.3f} … {math.degrees(greatest):10.3f} deg")
    show(f"z           {measured.pose_extents[2][0]:10.3f} … {measured.pose_extents[2][1]:10.3f} {unit}")
    show(f"tilt        to {math.degrees(measured.tilt):.3f} deg")
    show(
        f"det W33     {measured.ratio[0]:.4f} … {measured.ratio[1]:.4f} of its value 8 R² z³ in an upright pose"
    )
    return OK


def _write_slice(options: argparse.Namespace, geometry: Any, limits: tuple[float, float], unit: str) -> int:
    from rodgen.data.tables import write_columns
    from rodgen.kinematics import tricept

    axis, given = options.slice
    found = tricept.workspace_slice(geometry, limits, axis, given.to(unit)[0], options.points)
    columns = {f"Q{name} [{unit}]": found.points[..., n] for n, name in enumerate("xyz")}
    columns["status"] = status_names(tricept.TriceptStatus, found.status)
    columns["ratio"] = np.ma.masked_invalid(found.ratio)
    write_columns(options.output, columns)
    inside = int((found.status == tricept.TriceptStatus.REACHABLE).sum())
    conclude(f"{axis} = {given.numbers[0]:g} {given.unit}: {found.status.size} points, {inside} reachable")
    return OK
