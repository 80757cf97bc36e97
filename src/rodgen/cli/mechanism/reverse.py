"""``rodgen mechanism reverse``: every set of joint coordinates that brings a robot to a pose, or closes a loop."""

from __future__ import annotations

import argparse
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._console import Command, located, option, refused
from rodgen.cli._tables import OUTPUT, Columns, map_rows, named, rows_of, table
from rodgen.cli.mechanism._attitude import ATTITUDE_TEXT, columns_of, form, matrices
from rodgen.cli.mechanism._mechanism import (
    MECHANISM,
    MECHANISM_TEXT,
    TOOL,
    Chain,
    chain_of,
    column_name,
    quantity_of,
    tool_of,
)
from rodgen.errors import listed, shown

if TYPE_CHECKING:
    from rodgen.kinematics.spatial import Reverse

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


_TEXT = f"""\
Find all joint coordinates that bring the last link of a robot to the pose in every row of a table, or all that close a
loop whose input is given.

{MECHANISM_TEXT}

The table, CSV (gzip or not) or Parquet, has for a robot the pose, as 'rodgen mechanism forward' writes it:

  x [mm],y [mm],z [mm] of the point --tool, and the attitude of the last link

{ATTITUDE_TEXT}
For a loop it has the coordinates of the joints that are given, such as R1 [deg]: by --given, else the first that there
are. The output has a row for each solution with every column of the table, then
  solution   its number, from 1; 0 where there is none
             a column for each joint, under its name; of a joint C two, such as C3.theta and C3.S
  status     regular; double (two solutions meet there); family (one of infinitely many, as where a wrist is singular);
             none; incomplete (a further solution may be missing); invalid; not_normal (regular, but the attitude was
             made a rotation)
A column of the table that has such a name, a joint's say, is kept as 'given R1', and so on.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "reverse",
        _run,
        _TEXT,
        MECHANISM,
        table("POSES"),
        OUTPUT,
        option(
            "--from SEQUENCE|quaternion|matrix",
            f"how the table writes attitudes; default: {_USUAL}",
            form,
            dest="form",
        ),
        TOOL,
        option("--given NAMES", "of a loop: the columns that are its inputs, such as R1 or C2.theta,C2.S"),
    )


def _run(options: argparse.Namespace) -> int:
    chain = chain_of(options.mechanism)
    with located(chain.file, "mechanism"):
        return _loop(options, chain) if chain.mechanism.closed else _robot(options, chain)


def _robot(options: argparse.Namespace, chain: Chain) -> int:
    if options.given is not None:
        raise refused("--given", "for an open chain", "a closed loop, or no --given")
    form = options.form or _USUAL  # a loop has no poses: there the option must not be given
    columns = [*named("length", "x y z"), *columns_of(form)]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)
        to_end = np.linalg.inv(tool_of(options, here))
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


def _loop(options: argparse.Namespace, chain: Chain) -> int:
    from rodgen.kinematics import spatial

    for name, value in (("--tool", options.tool), ("--from", options.form)):
        if value is not None:
            raise refused(name, "for a closed loop", f"an open chain, or no {name}")
    mechanism = chain.mechanism
    names = [column_name(mechanism, v) for v in range(len(mechanism.variables))]
    wanted = _given(options, names)
    columns = [(names[v], quantity_of(mechanism, v)) for v in wanted]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)

        def function(values: Any) -> Any:
            found = spatial.reverse_loop(here.mechanism, dict(zip(wanted, values.T, strict=True)))
            return _answers(found, left)

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
    made, abnormal = matrices(form, values)
    if form == "quaternion":
        size = np.linalg.norm(values, axis=1, keepdims=True)
        values = np.where(np.abs(size - 1) < _OFF, values / np.where(size > 0, size, 1.0), np.nan)
        return matrices(form, values)[0], abnormal
    if form != "matrix":
        return made, abnormal
    # The nearest rotation, so that a matrix of five digits is one.
    left, stretch, right = np.linalg.svd(made)
    nearest = left @ right
    good = (np.abs(stretch - 1) < _OFF).all(axis=1) & (np.linalg.det(nearest) > 0)
    return np.where(good[:, None, None], nearest, np.nan), abnormal


def _results(chain: Chain, variables: list[int]) -> Columns:
    unit = chain.mechanism.unit
    made: Columns = [("solution", "count")]
    for v in variables:
        name = column_name(chain.mechanism, v)
        if quantity_of(chain.mechanism, v) == "angle":
            made.append((name, "angle"))
        else:
            made.append((f"{name} [{unit}]", "number"))
    return [*made, ("status", _Status)]


def _answers(found: Reverse, variables: Any = slice(None)) -> Any:
    """Return a row for each solution, one for what may be missing, and one where there is nothing."""
    from rodgen.kinematics.spatial import ReverseStatus

    solutions, status = found
    missing = (status == ReverseStatus.INCOMPLETE).any(axis=1)
    index, slot, number = rows_of((status <= ReverseStatus.FAMILY).sum(axis=1), missing)
    is_solution = number > 0
    # Solutions come first; a row without one has the status of the slot after them.
    slot = np.minimum(slot, status.shape[1] - 1)
    codes = np.where(missing[index] & ~is_solution, ReverseStatus.INCOMPLETE, status[index, slot])
    q = np.where(is_solution[:, None], solutions[index, slot], np.nan)[:, variables]
    return [number, *q.T, codes], index
