"""``rodgen mechanism``: forward and reverse analysis of spatial mechanisms."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._console import Command, argument, group, located, option, refused
from rodgen.cli._tables import OUTPUT, Columns, map_rows, named, rows_of, table
from rodgen.cli._values import InputFile, quantity
from rodgen.errors import InputFileError, UnexpectedError, listed, shown

if TYPE_CHECKING:
    from rodgen.kinematics.spatial import Mechanism, Placement, Reverse

_PRESETS = {"puma_560": "PUMA_560", "ge_p60": "GE_P60", "t3_776": "T3_776"}

_MECHANISM_TEXT = """\
MECHANISM is a link table, a machine file (.toml), or puma_560, ge_p60 or t3_776. A link table is a CSV
with a row for each joint, of type R, P, C, H, E, T or S, and the link after it:

  joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]

A cell is empty where the joint has its variable. Without a link after the last joint it is an open chain, a robot."""

_QUATERNION = named("number", "q0 qx qy qz")
"""The columns of an attitude as a quaternion."""

_ATTITUDE_TEXT = """\
Attitudes are, by --from,
  ZYX, ZYZ or another of the twelve sequences: alpha [deg],beta [deg],gamma [deg], the three angles in the
      order of the sequence, in any unit of angle. Capitals are intrinsic, about turned axes; small letters extrinsic.
  quaternion: q0,qx,qy,qz, of unit length, scalar part first
  matrix: r11,r12,r13,r21,...,r33; its columns are the moved axes
"""

_SUMMARIES = {
    "forward": "poses of a robot from its joint coordinates",
    "reverse": "all joint coordinates of poses, or of a loop's input",
}
_TEXT = """\
Robots and closed loops of joints R, P, C and H in the convention of Crane and Duffy, Kinematic Analysis of Robot
Manipulators: where the last link is, and all joint values that bring it somewhere.
"""

_FORWARD = f"""\
Find the pose of the last link of a robot for the joint coordinates in every row of a table.

{_MECHANISM_TEXT}

The table, CSV (gzip or not) or Parquet, has a column for each joint, under its name and with any unit, such as
R1 [deg], and for a joint C two, such as C3.theta [deg],C3.S [mm]. The output gets every column of the table, then
  x y z          of the point --tool, in the unit of the first length column, else in that of the mechanism
  q0 qx qy qz    the attitude of the last link, a quaternion, scalar part first
both in the fixed frame: origin at the meeting of S1 and a12 (at S1 = 0), z along S1, x from where theta1 counts; of a
machine file in machine axes.
"""

_USUAL = "quaternion"
"""How 'rodgen mechanism forward' writes attitudes."""
_OFF = 1e-3
"""How far an attitude in a table may be off a rotation: digits that were cut off, not another convention."""


class _Status(IntEnum):
    """Codes of `rodgen.kinematics.spatial.ReverseStatus`, and one for an attitude that was made a rotation."""

    REGULAR = 0
    DOUBLE = 1
    FAMILY = 2
    NONE = 3
    INCOMPLETE = 4
    INVALID = 5
    NOT_NORMAL = 6


_REVERSE = f"""\
Find all joint coordinates that bring the last link of a robot to the pose in every row of a table, or all that close a
loop whose input is given.

{_MECHANISM_TEXT}

The table, CSV (gzip or not) or Parquet, has for a robot the pose, as 'rodgen mechanism forward' writes it:

  x [mm],y [mm],z [mm] of the point --tool, and the attitude of the last link

{_ATTITUDE_TEXT}
For a loop it has the coordinates of the joints that are given, such as R1 [deg]: by --given, else the first that there
are. The output has a row for each solution with every column of the table, then
  solution   its number, from 1; 0 where there is none
             a column for each joint, under its name; of a joint C two, such as C3.theta and C3.S
  status     regular; double (two solutions meet there); family (one of infinitely many); none; incomplete (a further
             solution may be missing); invalid; not_normal (regular, but the attitude was made a rotation)
"""

_MECHANISM = argument("MECHANISM", "link table, machine file, or robot", InputFile)
_TOOL = option(
    "--tool X,Y,Z",
    "point of the last link, in its frame, such as 2,3,5cm; default: its origin",
    quantity("--tool", "2,3,5cm", 3),
)


def add_to(command: Command) -> None:
    """Add the commands."""
    command = group(command, "mechanism", _TEXT, _SUMMARIES)
    command("forward", _forward, _FORWARD, _MECHANISM, table("COORDINATES"), OUTPUT, _TOOL)
    command(
        "reverse",
        _reverse,
        _REVERSE,
        _MECHANISM,
        table("POSES"),
        OUTPUT,
        option(
            "--from SEQUENCE|quaternion|matrix",
            f"how the table writes attitudes; default: {_USUAL}",
            _form,
            dest="form",
        ),
        _TOOL,
        option("--given NAMES", "of a loop: the columns that are its inputs, such as R1 or C2.theta,C2.S"),
    )


def _forward(options: argparse.Namespace) -> int:
    from rodgen import quaternion_from_matrix

    chain = _chain_of(options.mechanism)
    chain.robot()  # is no loop
    count = len(chain.mechanism.variables)
    columns = [(_column_name(chain.mechanism, v), _quantity_of(chain.mechanism, v)) for v in range(count)]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)
        robot = here.robot()
        tool = _tool_of(options, here)

        def function(values: Any) -> Any:
            T = robot.forward(values) @ tool
            return [*T[:, :3, 3].T, *quaternion_from_matrix(T[:, :3, :3])[0].T], None

        return [*_place("xyz", here.mechanism.unit), *_QUATERNION], function

    with located(chain.file, "mechanism"):
        return map_rows(options, columns, prepare)


def _reverse(options: argparse.Namespace) -> int:
    chain = _chain_of(options.mechanism)
    with located(chain.file, "mechanism"):
        return _loop(options, chain) if chain.mechanism.closed else _robot(options, chain)


def _robot(options: argparse.Namespace, chain: _Chain) -> int:
    if options.given is not None:
        raise refused("--given", "for an open chain", "a closed loop, or no --given")
    form = options.form or _USUAL  # a loop has no poses: there the option must not be given
    columns = [*named("length", "x y z"), *_columns_of(form)]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)
        to_end = np.linalg.inv(_tool_of(options, here))
        robot = here.robot()

        def function(values: Any) -> Any:
            T = np.zeros((len(values), 4, 4))
            rotations, abnormal = _rotations(form, values[:, 3:])
            T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = rotations, values[:, :3], 1.0
            (*columns, status), index = _answers(robot.reverse(T @ to_end))
            rounded = abnormal[index] & (status == _Status.REGULAR)
            return [*columns, np.where(rounded, _Status.NOT_NORMAL, status)], index

        return _results(here, list(range(len(here.mechanism.variables)))), function

    return map_rows(options, columns, prepare)


def _loop(options: argparse.Namespace, chain: _Chain) -> int:
    from rodgen.kinematics import spatial

    for name, value in (("--tool", options.tool), ("--from", options.form)):
        if value is not None:
            raise refused(name, "for a closed loop", f"an open chain, or no {name}")
    mechanism = chain.mechanism
    names = [_column_name(mechanism, v) for v in range(len(mechanism.variables))]
    wanted = _given(options, names)
    columns = [(names[v], _quantity_of(mechanism, v)) for v in wanted]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)

        def function(values: Any) -> Any:
            solutions = spatial.reverse_loop(here.mechanism, dict(zip(wanted, values.T, strict=True)))
            return _answers(solutions, left)

        left = [v for v in range(len(names)) if v not in wanted]
        return _results(here, left), function

    return map_rows(options, columns, prepare)


def _given(options: argparse.Namespace, names: list[str]) -> list[int]:
    if options.given is None:
        return list(range(max(1, len(names) - 6)))
    wanted = []
    for name in options.given.split(","):
        if name.strip() not in names:
            raise refused("--given", shown(name.strip()), listed(names))
        wanted.append(names.index(name.strip()))
    if len(set(wanted)) < len(wanted):
        raise refused("--given", shown(options.given), "every name once")
    return wanted


def _rotations(form: str, values: Any) -> Any:
    """Return the rotations that are meant, NaN where none is, and which attitudes were only nearly rotations."""
    columns, abnormal = _matrices(form, values)
    if form == "quaternion":
        size = np.linalg.norm(values, axis=1, keepdims=True)
        values = np.where(np.abs(size - 1) < _OFF, values / np.where(size > 0, size, 1.0), np.nan)
        return _matrices(form, values)[0], abnormal
    if form != "matrix":
        return columns, abnormal
    # The nearest rotation, so that a matrix of five digits is one.
    left, stretch, right = np.linalg.svd(columns)
    nearest = left @ right
    good = (np.abs(stretch - 1) < _OFF).all(axis=1) & (np.linalg.det(nearest) > 0)
    return np.where(good[:, None, None], nearest, np.nan), abnormal


def _results(chain: _Chain, variables: list[int]) -> Columns:
    unit = chain.mechanism.unit
    columns: Columns = [("solution", "count")]
    for v in variables:
        name = _column_name(chain.mechanism, v)
        if _quantity_of(chain.mechanism, v) == "angle":
            columns.append((name, "angle"))
        else:
            columns.append((f"{name} [{unit}]", "number"))
    return [*columns, ("status", _Status)]


def _answers(reverse: Reverse, variables: Any = slice(None)) -> Any:
    """Return a row for each solution, one for what may be missing, and one where there is nothing."""
    from rodgen.kinematics.spatial import ReverseStatus

    solutions, status = reverse
    missing = (status == ReverseStatus.INCOMPLETE).any(axis=1)
    index, slot, number = rows_of((status <= ReverseStatus.FAMILY).sum(axis=1), missing)
    is_solution = number > 0
    # Solutions come first; a row without one has the status of the slot after them.
    slot = np.minimum(slot, status.shape[1] - 1)
    codes = np.where(missing[index] & ~is_solution, ReverseStatus.INCOMPLETE, status[index, slot])
    q = np.where(is_solution[:, None], solutions[index, slot], np.nan)[:, variables]
    return [number, *q.T, codes], index


# the mechanism ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Chain:
    """A mechanism with the name of its file; a robot also has its placement."""

    file: str
    mechanism: Mechanism
    placement: Placement | None = None

    def robot(self) -> Placement:
        """Return the placement of an open chain.

        Raises
        ------
        InputFileError
            When the mechanism is a loop.
        """
        if self.placement is None:
            expected = "an open chain; 'rodgen mechanism reverse' solves loops"
            raise InputFileError(self.file, "mechanism", "a closed loop", expected)
        return self.placement

    def to(self, unit: str) -> _Chain:
        """Return the chain in another unit of length; unchanged when `unit` is empty."""
        if not unit:
            return self
        placement = self.placement.in_unit(unit) if self.placement else None
        return _Chain(self.file, self.mechanism.in_unit(unit), placement)


def _tool_of(options: argparse.Namespace, chain: _Chain) -> Any:
    """Return the frame at the tool in that of the last link, (4, 4)."""
    shift = np.eye(4)
    if options.tool:
        shift[:3, 3] = options.tool.to(chain.mechanism.unit)
    return shift


def _chain_of(name: str) -> _Chain:
    """Read a mechanism, its joints E, T and S replaced by joints R and P."""
    from rodgen.kinematics import spatial

    if name.lower().endswith(".toml"):
        return _of_machine(name)
    if name in _PRESETS and not os.path.exists(name):
        mechanism: Mechanism = getattr(spatial, _PRESETS[name])
    elif not os.path.exists(name):
        known = ", ".join(_PRESETS)
        raise InputFileError(name, "file", "no such file", f"a link table, a machine file, or one of {known}")
    else:
        mechanism = spatial.load_mechanism(name)
    mechanism = mechanism.expanded()
    if mechanism.closed:
        return _Chain(name, mechanism)
    return _Chain(name, mechanism, spatial.Placement(mechanism))


def _of_machine(file: str) -> _Chain:
    from rodgen.machines.machine import Machine
    from rodgen.machines.mechanism import to_mechanism

    with located(file, "mechanism"):
        chain = to_mechanism(Machine.load(file))
    return _Chain(file, chain.mechanism, chain)


def _column_name(mechanism: Mechanism, variable: int) -> str:
    """Return the column name of a variable: the name of its joint, with the kind of variable for a joint C."""
    joint, kind = mechanism.variables[variable]
    name = mechanism.names[joint]
    return f"{name}.{kind}" if mechanism.joints[joint] == "C" else name


def _quantity_of(mechanism: Mechanism, variable: int) -> Any:
    """Return the quantity of a variable, angle or length."""
    return "angle" if mechanism.variables[variable][1] == "theta" else "length"


def _place(names: Sequence[str], unit: str) -> Columns:
    """Return result columns for lengths in a unit, also when the table has no length column."""
    return [(f"{name} [{unit}]", "number") for name in names]


# attitudes ----------------------------------------------------------------------------------------------------------


def _form(text: str) -> str:
    """Read the form in which a table has attitudes."""
    from rodgen.kinematics.instantaneous_euler.sequences import sequence_of

    if text not in ("quaternion", "matrix"):
        try:
            sequence_of(text)
        except UnexpectedError:
            raise argparse.ArgumentTypeError(
                f"{shown(text)} is none of quaternion, matrix and the twelve sequences, such as ZYX"
            ) from None
    return text


def _columns_of(form: str) -> Columns:
    """Return the columns of an attitude."""
    if form == "quaternion":
        return _QUATERNION
    if form == "matrix":
        return named("number", "r11 r12 r13 r21 r22 r23 r31 r32 r33")
    return named("angle", "alpha beta gamma")


def _matrices(form: str, values: Any) -> tuple[Any, Any]:
    """Return the rotation matrices of attitudes, and which of the attitudes were only nearly rotations."""
    from rodgen import matrix_from_quaternion
    from rodgen.kinematics import instantaneous_euler as ie

    if form == "matrix":
        matrices = values.reshape(-1, 3, 3)
        return matrices, _abnormal(ie.angles_from_matrix(matrices)[1])
    if form == "quaternion":
        matrices, _ = matrix_from_quaternion(values)
        return matrices, _abnormal(ie.angles_from_quaternion(values)[1])
    return ie.motion_from_euler(values, np.zeros_like(values), form)[0], np.zeros(len(values), bool)


def _abnormal(status: Any) -> Any:
    from rodgen.kinematics.instantaneous_euler import AngleStatus

    return status == AngleStatus.NOT_NORMAL
