"""``rodgen euler angles | rotations | rates | ridge | trajectory``: tables of attitudes and their angles."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._attitude import ATTITUDE_TEXT, QUATERNION, add_form, columns_of, matrices, quaternions
from rodgen.cli._console import Command, refused
from rodgen.cli._tables import add_table, map_rows, named, rows_of
from rodgen.cli._values import number
from rodgen.errors import UnexpectedError, shown

_CHI = named("angle", "chi_x chi_y chi_z")

_ANGLES = f"""\
Find the instantaneous Euler angles of the attitude in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
The output gets every column of the table, then
  chi_x chi_y chi_z [deg]   the angles, in the unit of the first angle
  status                    angles; no_ridge (one is 0 or 180 deg); identity; not_normal (made a rotation); invalid
"""

_ROTATIONS = """\
Find all rotations with the instantaneous Euler angles in every row of a table, or the one with given ridge lines.

The table, CSV (gzip or not) or Parquet, has the columns

  chi_x [deg],chi_y [deg],chi_z [deg]

in any unit of angle, 0 to 180 deg, and may have further ones. The output has a row for each rotation with every column
of the table, then
  rotation                        its number, from 1; 0 where there is none
  q0 qx qy qz                     its unit quaternion
  status                          eight, four, two, one: so many there are; infeasible: there is none; invalid
  distance                        of the cosines from those of the nearest triple that there is
  nearest_x nearest_y nearest_z   that triple
With --ridge x, y or z (also several, as in --ridge xz) the table has the directions of these ridge lines, such as
Zr_x,Zr_y,Zr_z, of any length, and the output one row for each of its own: q0 qx qy qz, then
  misfit                          largest angle between a given ridge line and the rotation's
  left                            rotations that fit as well
  status                          chosen; ambiguous; infeasible; invalid
"""

_RATES = f"""\
Find how fast the instantaneous Euler angles of a turning body change, in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
Each row also has the angular velocity in fixed axes,
  omega_x [deg/s],omega_y [deg/s],omega_z [deg/s]
or, with --euler-rates, the rates of the sequence's angles,
  alpha_rate [deg/s],beta_rate [deg/s],gamma_rate [deg/s]
The output gets every column of the table, then
  chi_x_rate chi_y_rate chi_z_rate [deg/s]   the rates, in the unit of the first rate
  determinant                                16 q0 qx qy qz; 0 where they do not determine the angular velocity
  status                                     regular; near_singular; singular (undetermined);
                                             kink (an angle is 0 or 180 deg: the rate is that towards later times);
                                             not_normal; invalid
"""

_RIDGE = f"""\
Find the lines in which the yz, xz and xy planes meet their images, for every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
With --point it also has where the origin has moved, x [mm],y [mm],z [mm]; without it stays.
The output gets every column of the table, then for each of Xr, Yr, Zr
  Xr_x Xr_y Xr_z                 its direction; the rotation by chi about it brings the plane to its image
  Xr_mx Xr_my Xr_mz [mm]         its moment about the fixed origin, with --point
  status_x                       line; planes_coincide (the angle is 0 or 180 deg); planes_parallel; not_normal; invalid
"""

_TRAJECTORY = f"""\
Put instantaneous and conventional Euler angles side by side along a motion, whose attitudes are the rows of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
The output gets every column of the table, then
  chi_x chi_y chi_z                  the instantaneous Euler angles
  signed_x signed_y signed_z         the same, continuous: followed by their ridge lines through 0 and 180 deg
  path_x path_y path_z               smooth; turned (passed 0 or 180 deg since the row before); no_ridge; coarse (the
                                     rows are too far apart to decide); invalid
  ZYX_1 ZYX_2 ZYX_3, ZYZ_1 ...       angles of each sequence of --to, continuous
  ZYX_status, ZYZ_status             regular; singular (gimbal lock; the third angle is held); not_normal; invalid
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    angles = command("angles", _angles, "instantaneous Euler angles of attitudes", _ANGLES)
    add_table(angles, "ATTITUDES")
    add_form(angles)

    rotations = command(
        "rotations", _rotations, "all rotations with given instantaneous Euler angles", _ROTATIONS
    )
    add_table(rotations, "ANGLES")
    rotations.add_argument(
        "--tolerance",
        metavar="RATIO",
        type=number("a ratio: a number from 0 up, such as 1e-6", lambda x: x >= 0),
        default=0.0,
        help="squared component of the quaternion, relative to the rotation's size, that is taken for 0 (default: 16 "
        "times the machine epsilon; for measured angles some three times their uncertainty over the largest)",
    )
    rotations.add_argument(
        "--ridge", metavar="AXES", type=_axes, help="choose by the ridge lines of these axes"
    )
    rotations.add_argument("--unoriented", action="store_true", help="the ridge lines have no sense")

    rates = command("rates", _rates, "rates of instantaneous Euler angles", _RATES)
    add_table(rates, "MOTIONS")
    add_form(rates)
    rates.add_argument(
        "--euler-rates", action="store_true", help="the table has the rates of the sequence's angles"
    )

    ridge = command("ridge", _ridge, "ridge lines of attitudes", _RIDGE)
    add_table(ridge, "ATTITUDES")
    add_form(ridge)
    ridge.add_argument("--point", action="store_true", dest="moved", help="the origin moves, too")

    trajectory = command(
        "trajectory", _trajectory, "instantaneous and conventional angles along a motion", _TRAJECTORY
    )
    add_table(trajectory, "MOTION")
    add_form(trajectory)
    trajectory.add_argument(
        "--to",
        metavar="SEQUENCE,...",
        type=_sequences,
        default=("ZYX", "ZYZ"),
        help="conventional sequences; default: ZYX,ZYZ",
    )


def _axes(text: str) -> str:
    if text and set(text) <= set("xyz") and len(set(text)) == len(text):
        return text
    raise argparse.ArgumentTypeError(f"{shown(text)} names no axes: x, y, z, or several of them, such as xz")


def _sequences(text: str) -> tuple[str, ...]:
    from rodgen.kinematics.instantaneous_euler.sequences import sequence_of

    names = tuple(text.split(","))
    for name in names:
        try:
            sequence_of(name)
        except UnexpectedError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f"{text}: a sequence twice")
    return names


def _angles(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    def function(values: Any) -> Any:
        if options.form == "quaternion":
            chi, status = ie.angles_from_quaternion(values)
        elif options.form == "matrix":
            chi, status = ie.angles_from_matrix(values.reshape(-1, 3, 3))
        else:
            chi, status = ie.angles_from_euler(values, options.form)
        return [*chi.T, status], None

    results = [*_CHI, ("status", ie.AngleStatus)]
    return map_rows(options, columns_of(options.form), lambda unit: (results, function))


def _rotations(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    if options.ridge:
        return _chosen_rotation(options)
    results = [
        ("rotation", "count"),
        *QUATERNION,
        ("status", ie.RotationsStatus),
        ("distance", "number"),
        *named("angle", "nearest_x nearest_y nearest_z"),
    ]

    def function(values: Any) -> Any:
        found = ie.rotations(values, tolerance=options.tolerance)
        index, slot, numbers = rows_of(found.count)
        return [
            numbers,
            *found.quaternions[index, slot].T,
            found.status[index],
            found.distance[index],
            *found.nearest[index].T,
        ], index

    return map_rows(options, _CHI, lambda unit: (results, function))


def _chosen_rotation(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    lines = [(f"{axis.upper()}r_{along}", "number") for axis in options.ridge for along in "xyz"]
    results = [*QUATERNION, ("misfit", "angle"), ("left", "count"), ("status", ie.ChoiceStatus)]

    def function(values: Any) -> Any:
        given = {axis: values[:, 3 + 3 * n : 6 + 3 * n] for n, axis in enumerate(options.ridge)}
        choice = ie.choose(
            values[:, :3], **given, oriented=not options.unoriented, tolerance=options.tolerance
        )
        return [*choice.quaternion.T, choice.misfit, choice.left, choice.status], None

    return map_rows(options, [*_CHI, *lines], lambda unit: (results, function))


def _rates(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    if options.euler_rates and options.form in ("quaternion", "matrix"):
        found = f"--from {options.form}"
        raise refused("--euler-rates", found, "a sequence, such as --from ZYX")
    attitude = columns_of(options.form)
    turning = "alpha_rate beta_rate gamma_rate" if options.euler_rates else "omega_x omega_y omega_z"
    results = [
        *named("rate", "chi_x_rate chi_y_rate chi_z_rate"),
        ("determinant", "number"),
        ("status", ie.MotionStatus),
    ]

    def function(values: Any) -> Any:
        if options.euler_rates:
            found = ie.rates_from_euler(values[:, :3], values[:, 3:], options.form)
            return [*found.rate.T, found.determinant, found.status], None
        made, abnormal = matrices(options.form, values[:, : len(attitude)])
        found = ie.rates(made, values[:, len(attitude) :])
        right = np.isin(found.status, (ie.MotionStatus.REGULAR, ie.MotionStatus.NEAR_SINGULAR))
        status = np.where(abnormal & right, ie.MotionStatus.NOT_NORMAL, found.status)
        return [*found.rate.T, found.determinant, status], None

    return map_rows(options, [*attitude, *named("rate", turning)], lambda unit: (results, function))


def _ridge(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    attitude = columns_of(options.form)
    place = named("length", "x y z") if options.moved else []
    results: list[tuple[str, Any]] = []
    for axis in "xyz":
        line = f"{axis.upper()}r"
        results += named("number", f"{line}_x {line}_y {line}_z")
        if options.moved:
            results += named("length", f"{line}_mx {line}_my {line}_mz")
        results.append((f"status_{axis}", ie.RidgeStatus))

    def function(values: Any) -> Any:
        points = values[:, len(attitude) :] if options.moved else np.zeros(3)
        attitudes, abnormal = matrices(options.form, values[:, : len(attitude)])
        lines, status = ie.ridge_lines(attitudes, points)
        line = status == ie.RidgeStatus.LINE
        status = np.where(abnormal[:, None] & line, ie.RidgeStatus.NOT_NORMAL, status)
        made = []
        for i in range(3):
            made += [*lines[:, i, : 6 if options.moved else 3].T, status[:, i]]
        return made, None

    return map_rows(options, [*attitude, *place], lambda unit: (results, function))


def _trajectory(options: argparse.Namespace) -> int:
    from rodgen.kinematics import instantaneous_euler as ie

    results = [
        *_CHI,
        *named("angle", "signed_x signed_y signed_z"),
        *((f"path_{axis}", ie.PathStatus) for axis in "xyz"),
    ]
    for name in options.to:
        results += [*named("angle", f"{name}_1 {name}_2 {name}_3"), (f"{name}_status", ie.MotionStatus)]

    def function(values: Any) -> Any:
        attitudes, abnormal = quaternions(options.form, values)
        found = ie.trajectory(attitudes, options.to)
        made = [*found.chi.T, *found.signed.T, *found.status.T]
        for name in options.to:
            status = found.euler_status[name]
            regular = status == ie.MotionStatus.REGULAR
            status = np.where(abnormal & regular, ie.MotionStatus.NOT_NORMAL, status)
            made += [*found.continuous[name].T, status]
        return made, None

    return map_rows(options, columns_of(options.form), lambda unit: (results, function), whole=True)
