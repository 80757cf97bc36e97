"""``rodgen euler workspace``: the attitudes that a 3-SPS-S machine can take up."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from rodgen.cli._console import OK, Command, show, show_json
from rodgen.cli._tables import status_names, write_columns
from rodgen.cli._values import number, quantity, whole
from rodgen.cli.euler._three_sps_s import MACHINE_TEXT, add_limits, add_machine, limits_of, machine_of

__all__ = ["add_to"]

_TEXT = f"""\
Find the attitudes that a 3-SPS-S machine can take up: legs within --limits, on one side of the singularity, which a
machine must not pass, and joined to one another without doing so. {MACHINE_TEXT}

Attitudes are a tilt of the axis (0 to 180 deg) towards an azimuth, and a torsion. What is printed are parts of all
attitudes. The attitude at the start is singular; torsions between 0 and 180 deg are on the one side, + , those between
-180 and 0 deg on the other.

With --output the grid is written as a table: azimuth, tilt, torsion, L1, L2, L3, normed determinant, status, joined.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("workspace", _run, "attitudes that a 3-SPS-S machine can take up", _TEXT)
    add_machine(parser)
    add_limits(parser)
    parser.add_argument(
        "--torsion",
        metavar="ANGLE",
        type=quantity("--torsion", "30deg", 1, "angle"),
        help="one torsion, such as 30deg; default: all",
    )
    parser.add_argument(
        "--side", choices=("+", "-", "either"), default="+", help="sign of the determinant; default: +"
    )
    parser.add_argument(
        "--margin", metavar="NUMBER", type=number("a number from 0 to below 1", lambda x: 0 <= x < 1), default=1e-6,
        help="normed determinant that must be exceeded (from 0 to below 1; default: 1e-6)",
    )  # fmt: skip
    parser.add_argument(
        "--samples", metavar="N", type=whole(4, 400), default=45, help="cells of the tilt, 4 to 400 (45)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON: angles in rad")
    parser.add_argument(
        "--plot", metavar="FILE", help="draw maps of tilt and azimuth: .html, .png, .svg or .pdf"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="the grid: .csv, .csv.gz or .parquet")


def _run(options: argparse.Namespace) -> int:
    from rodgen.kinematics import three_sps_s

    if options.plot:
        from rodgen.output import figures

        figures.check_figure_name(options.plot)
    geometry, unit = machine_of(options)
    limits = limits_of(options, unit)
    side = {"+": 1, "-": -1, "either": 0}[options.side]
    torsion = None if options.torsion is None else options.torsion.to("rad")[0]
    found = three_sps_s.workspace(
        geometry, limits, torsion=torsion, side=side, margin=options.margin, samples=options.samples
    )
    if options.plot:
        figures.save_figure(figures.orientation_workspace(found), options.plot)
    if options.output:
        _write(options.output, found, geometry, unit)
    codes = np.bincount(found.status.ravel(), minlength=len(three_sps_s.OrientationStatus))
    allowed = found.status == three_sps_s.OrientationStatus.ALLOWED
    greatest = float(np.abs(found.determinant[allowed]).max(initial=0.0))
    reach = _reach(found)
    if options.json:
        show_json(
            {
                "unit": unit,
                "share": found.share,
                "joined_share": found.joined_share,
                "best": dict(zip(("azimuth", "tilt", "torsion"), found.best, strict=True)),
                "greatest_determinant": greatest,
                "joined_tilt": reach,
                "cells": {code.name.lower(): int(codes[code]) for code in three_sps_s.OrientationStatus},
            }
        )
        return OK
    R, r, h = geometry.lengths
    between = "of any length" if limits is None else f"from {limits[0]:.6g} to {limits[1]:.6g} {unit}"
    show(f"legs {between}, R = {R:.6g}, r = {r:.6g}, h = {h:.6g} {unit}")
    of = "attitudes" if torsion is None else f"tilts at a torsion of {math.degrees(torsion):g} deg"
    show(f"allowed     {found.share:.4f} of all {of}")
    show(f"joined      {found.joined_share:.4f}")
    if allowed.any():
        best = ", ".join(
            f"{name} {math.degrees(value):.1f}"
            for name, value in zip(("azimuth", "tilt", "torsion"), found.best, strict=True)
        )
        show(f"best        {best} deg: normed determinant {greatest:.4f}")
        show(
            f"tilt        to {math.degrees(reach):.1f} deg in every direction, joined, at the torsion that allows most"
        )
    show("home        singular: the legs do not hold the platform against a yaw, whatever R, r and h")
    return OK


def _reach(found: Any) -> float:
    """Return the greatest tilt up to which every azimuth is joined, at the best torsion."""
    full = np.logical_and.accumulate(found.joined.all(axis=1), axis=-1).sum(axis=-1).max(initial=0)
    return float(full * math.pi / len(found.tilt))


def _write(path: str, found: Any, geometry: Any, unit: str) -> None:
    from rodgen.kinematics import three_sps_s

    torsion, azimuth, tilt = np.meshgrid(found.torsion, found.azimuth, found.tilt, indexing="ij")
    rotation = three_sps_s.rotation_from_tilt_torsion(azimuth, tilt, torsion)
    legs = three_sps_s.legs(rotation, geometry)
    angles = {"azimuth": azimuth, "tilt": tilt, "torsion": torsion}
    columns = {f"{name} [deg]": np.degrees(values) for name, values in angles.items()}
    columns |= {f"L{n + 1} [{unit}]": legs[..., n] for n in range(3)}
    columns["determinant"] = found.determinant
    columns["status"] = status_names(three_sps_s.OrientationStatus, found.status)
    columns["joined"] = found.joined.astype(np.int64)
    write_columns(path, columns)
