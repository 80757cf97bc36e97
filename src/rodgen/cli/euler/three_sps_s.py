"""``rodgen euler legs | direct | workspace``: a 3-SPS-S machine, from its dimensions or a machine file."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._attitude import ATTITUDE_TEXT, QUATERNION, add_form, columns_of, matrices
from rodgen.cli._closed_chain import ordered_limits, take_machine
from rodgen.cli._console import OK, Command, located, refused, show, show_json
from rodgen.cli._plot import add_plot, figures_for
from rodgen.cli._tables import add_table, map_rows, named, rows_of, status_names
from rodgen.cli._values import InputFile, OutputFile, number, quantity, whole

if TYPE_CHECKING:
    from rodgen.kinematics.three_sps_s import Geometry

_MACHINE = """\
The machine is given by --R, --r and --h, or by the file of a machine of the family 3-sps-s with --machine. Legs 1, 2
and 3 stand at -30, 90 and 210 deg about the z axis."""

_LEGS = f"""\
Find the lengths of the three legs of a 3-SPS-S machine for the attitude in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
{_MACHINE}
The output gets every column of the table, then
  L1 L2 L3       lengths of the legs, in the unit of --R
  determinant    of the legs' moments, normed to lie between -1 and 1: 0 where the legs do not hold the platform, and
                 of another sign in another region; the attitude at the start is singular
  status         allowed; too_short, too_long (a leg, by --limits); near_singular; not_normal (allowed, and made a
                 rotation); invalid
"""

_DIRECT = f"""\
Find the attitude of a 3-SPS-S machine for the legs in every row of a table.

The table, CSV (gzip or not) or Parquet, has the columns

  L1 [mm],L2 [mm],L3 [mm]

in any unit of length, and may have further ones. {_MACHINE}
Up to eight attitudes have the same legs. The output has the one nearest to --near; with --follow the one nearest to
that of the row before; with --all every one, a row each, the smallest rotation first. It gets every column of the
table, then
  q0 qx qy qz               the attitude, a quaternion, scalar part first
  chi_x chi_y chi_z [deg]   its instantaneous Euler angles
  status                    converged; singular (two attitudes meet there); no_assembly (no attitude has these legs);
                            ambiguous (two are equally near: from the start, which is singular, they often are);
                            incomplete (one was not found); invalid
and with --all, first, mode: the number of the attitude, 0 where there is none.
"""

_WORKSPACE = f"""\
Find the attitudes that a 3-SPS-S machine can take up: legs within --limits, on one side of the singularity, which a
machine must not pass, and joined to one another without doing so. {_MACHINE}

Attitudes are a tilt of the axis (0 to 180 deg) towards an azimuth, and a torsion. What is printed are parts of all
attitudes. The attitude at the start is singular; torsions between 0 and 180 deg are on the one side, + , those between
-180 and 0 deg on the other.

With --output the grid is written as a table: azimuth, tilt, torsion, L1, L2, L3, normed determinant, status, joined.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    legs = command("legs", _legs, "legs of a 3-SPS-S machine from attitudes", _LEGS)
    add_table(legs, "ATTITUDES")
    add_form(legs)
    _add_machine(legs)
    _add_limits(legs)

    direct = command("direct", _direct, "attitudes of a 3-SPS-S machine from its legs", _DIRECT)
    add_table(direct, "LEGS")
    direct.add_argument("--all", action="store_true", help="every attitude, a row each")
    direct.add_argument(
        "--near",
        metavar="X,Y,Z",
        type=quantity("--near", "0,0,30deg", 3, "angle", what="a rotation vector"),
        help="rotation vector (axis times angle) with its unit, such as 0,0,30deg; default: the start in the machine "
        "file, else no rotation",
    )
    direct.add_argument(
        "--follow", action="store_true", help="the rows are a motion, which begins near --near"
    )
    _add_machine(direct)
    direct.set_defaults(start=None)

    space = command("workspace", _workspace, "attitudes that a 3-SPS-S machine can take up", _WORKSPACE)
    _add_machine(space)
    _add_limits(space)
    space.add_argument(
        "--torsion",
        metavar="ANGLE",
        type=quantity("--torsion", "30deg", 1, "angle"),
        help="one torsion, such as 30deg; default: all",
    )
    space.add_argument(
        "--side", choices=("+", "-", "either"), default="+", help="sign of the determinant; default: +"
    )
    space.add_argument(
        "--margin", metavar="NUMBER", type=number("a number from 0 to below 1", lambda x: 0 <= x < 1), default=1e-6,
        help="normed determinant that must be exceeded (from 0 to below 1; default: 1e-6)",
    )  # fmt: skip
    space.add_argument(
        "--samples", metavar="N", type=whole(4, 400), default=45, help="cells of the tilt, 4 to 400 (45)"
    )
    space.add_argument("--json", action="store_true", help="print JSON: angles in rad")
    add_plot(space, "maps of tilt and azimuth")
    about = "the grid: .csv, .csv.gz or .parquet"
    space.add_argument("-o", "--output", metavar="FILE", type=OutputFile, help=about)


def _add_machine(parser: argparse.ArgumentParser) -> None:
    """Add the options of the machine."""
    for name, example, text in (
        ("R", "200mm", "radius of the joints on the base, such as 200mm"),
        ("r", "120mm", "radius of the joints on the platform"),
        ("h", "260mm", "height of the pivot over the base"),
    ):
        parser.add_argument(f"--{name}", metavar="LENGTH", type=quantity(f"--{name}", example), help=text)
    about = "machine file that has R, r and h"
    parser.add_argument("--machine", metavar="FILE", type=InputFile, help=about)


def _add_limits(parser: argparse.ArgumentParser) -> None:
    """Add ``--limits``, the lengths that a leg may have."""
    parser.add_argument(
        "--limits",
        metavar="LEAST,GREATEST",
        type=quantity("--limits", "200,400mm", 2),
        help="lengths of a leg, such as 200,400mm; default: any",
    )


def _machine_of(options: argparse.Namespace, unit: str = "") -> tuple[Geometry, str]:
    """Return the machine, and the unit of its lengths: `unit`, or that in which they were given.

    The start of a machine file, a rotation vector in rad, is stored in `options.start`.
    """
    from rodgen.kinematics.three_sps_s import Geometry

    chain = take_machine(options, "3-sps-s", ("R", "r", "h"))
    if chain is not None:
        options.start = chain.start
    given = {name: getattr(options, name) for name in ("R", "r", "h")}
    missing = [f"--{name}" for name, value in given.items() if value is None]
    if missing:
        expected = "all of --R, --r and --h, each with its unit, or --machine"
        raise refused(", ".join(missing), "nothing", expected)
    for value in given.values():
        value.to("mm")  # checks the dimension of each under its own name
    unit = unit or given["R"].unit
    R, r, h = (value.to(unit)[0] for value in given.values())
    with located("command line", "--R, --r, --h"):
        return Geometry(R, r, h), unit


def _limits_of(options: argparse.Namespace, unit: str) -> tuple[float, float] | None:
    """Return the limits of the legs in a unit of length."""
    return None if options.limits is None else ordered_limits(options.limits, unit, "200,400mm")


def _legs(options: argparse.Namespace) -> int:
    from rodgen.kinematics import three_sps_s

    Status = three_sps_s.OrientationStatus
    geometry, unit = _machine_of(options)
    limits = _limits_of(options, unit)
    results = [
        *((f"L{n} [{unit}]", "number") for n in (1, 2, 3)),
        ("determinant", "number"),
        ("status", Status),
    ]

    def function(values: Any) -> Any:
        rotation, abnormal = matrices(options.form, values)
        status, determinant = three_sps_s.orientation_status(rotation, geometry, limits)
        status = np.where(abnormal & (status == Status.ALLOWED), Status.NOT_NORMAL, status)
        # the legs, too, are those of the nearest rotation
        rotation = np.where(abnormal[:, None, None], _made_normal(rotation), rotation)
        legs = np.where((status == Status.INVALID)[:, None], np.nan, three_sps_s.legs(rotation, geometry))
        return [*legs.T, np.where(status == Status.INVALID, np.nan, determinant), status], None

    return map_rows(options, columns_of(options.form), lambda unit: (results, function))


def _made_normal(matrices: Any) -> Any:
    """Return the rotations nearest matrices that are almost rotations."""
    from rodgen import matrix_from_quaternion, quaternion_from_matrix

    return matrix_from_quaternion(quaternion_from_matrix(matrices)[0])[0]


def _direct(options: argparse.Namespace) -> int:
    from rodgen import matrix_from_axis_angle, quaternion_from_matrix
    from rodgen.kinematics import instantaneous_euler, three_sps_s

    if options.all and (options.follow or options.near is not None):
        raise refused("--all", "together with --near or --follow", "one of the two")
    results = [
        *([("mode", "count")] if options.all else []),
        *QUATERNION,
        *named("angle", "chi_x chi_y chi_z"),
        ("status", three_sps_s.DirectStatus),
    ]

    def prepare(unit: str) -> Any:
        geometry, _ = _machine_of(options, unit)
        near = np.zeros(3)
        if options.near is not None or options.start is not None:
            near = np.array(options.start if options.near is None else options.near.to("rad"))
        angle = float(np.linalg.norm(near))
        start = matrix_from_axis_angle(near / angle if angle else [0.0, 0.0, 1.0], angle)[0]

        def function(legs: Any) -> Any:
            index, first = None, []
            if options.all:
                rotations, count, status = three_sps_s.direct_all(legs, geometry)
                index, slot, number = rows_of(count)
                first = [number]
                rotation, status = rotations[index, slot], status[index]
            elif options.follow:
                rotation, status = three_sps_s.follow(legs, geometry, start=start)
            else:
                rotation, status = three_sps_s.direct(legs, geometry, near=start)
            quaternion = quaternion_from_matrix(rotation)[0]
            chi = instantaneous_euler.angles_from_matrix(rotation)[0]
            return [*first, *quaternion.T, *chi.T, status], index

        return results, function

    return map_rows(options, named("length", "L1 L2 L3"), prepare, whole=options.follow)


def _workspace(options: argparse.Namespace) -> int:
    from rodgen.kinematics import three_sps_s

    figures = figures_for(options.plot)
    geometry, unit = _machine_of(options)
    limits = _limits_of(options, unit)
    side = {"+": 1, "-": -1, "either": 0}[options.side]
    torsion = None if options.torsion is None else options.torsion.to("rad")[0]
    found = three_sps_s.workspace(
        geometry, limits, torsion=torsion, side=side, margin=options.margin, samples=options.samples
    )
    if figures:
        figures.save_figure(figures.orientation_workspace(found), options.plot)
    if options.output:
        _write(options.output, found, geometry, unit)
    codes = np.bincount(found.status.ravel(), minlength=len(three_sps_s.OrientationStatus))
    allowed = found.status == three_sps_s.OrientationStatus.ALLOWED
    greatest = found.greatest_determinant
    reach = found.joined_tilt
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


def _write(path: str, found: Any, geometry: Any, unit: str) -> None:
    from rodgen.data.tables import write_columns
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
