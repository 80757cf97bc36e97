"""Rows of measurements that a machine file sets aside: nothing is fitted to them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rodgen.data.measurements import Measurements
from rodgen.data.set_aside import RowsAside, SetAside, edited, others, rows_aside, rows_text
from rodgen.errors import in_file
from rodgen.machines.machine import Machine


def aside(machine: Machine, data: Any) -> RowsAside | None:
    """Return which rows of measurements are set aside; None where the machine file sets none aside.

    Parameters
    ----------
    data : Measurements, or a table in memory
        As of :func:`rodgen.calibration.fit.fit`.

    Raises
    ------
    InputFileError
        When what the file says does not fit the measurements, or no row is left.
    """
    if not machine.measured.set_aside:
        return None
    return rows_aside(
        machine.measured.set_aside, Measurements.of(data), _compared(machine), machine.file or machine.name
    )


def _compared(machine: Machine) -> frozenset[str]:
    """Names of the columns of what is commanded and read."""
    return machine.measurand.read_columns.union((joint.column for joint in machine.joints), ("target",))


def setting_aside(
    machine: Machine,
    data: Any,
    *,
    rows: str | Sequence[int] = "",
    run: str = "",
    where: str = "",
    why: str = "",
) -> Machine:
    """Return this machine with rows of its measurements set aside: nothing is fitted to them.

    Parameters
    ----------
    data : Measurements, or a table in memory
        As of :func:`rodgen.calibration.fit.fit`.
    rows : str or sequence of int
        As the table counts them: lines of a CSV file from 1, else rows from 0, such as ``"12, 40-43"``.
    run : str
        Or a run of that table.
    where : str
        Or a rule on columns, of any table: ``"EL < 20 deg"``; several are joined by ``and``.
    why : str
        A note.

    Raises
    ------
    InputFileError
        When there are no such rows, or none is left.

    Examples
    --------
    >>> from rodgen.machines.machine import Joint, Measured, Target
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("distance", "machine"),
    ... )
    >>> data = {"C [deg]": [0, 120, 240], "d [mm]": [100, 100.01, 140]}
    >>> table.setting_aside(data, rows=[2], why="bumped").aside(data).text
    '1 of the 3 rows of data is set aside: row 2 (bumped).'
    """
    return _with_rows(machine, data, rows=rows, run=run, where=where, why=why)


def bringing_back(
    machine: Machine,
    data: Any,
    *,
    rows: str | Sequence[int] = "",
    run: str = "",
    where: str = "",
    why: str = "",
) -> Machine:
    """Return this machine with rows of its measurements counting again; without a choice, all of that table.

    Parameters
    ----------
    data, rows, run, where, why
        As of :meth:`setting_aside`.

    Raises
    ------
    InputFileError
        When there are no such rows, or none of them is set aside.
    """
    if not (len(rows) or run or where):
        left = others(machine.measured.set_aside, Measurements.of(data), _compared(machine))
        return replace(machine, measured=replace(machine.measured, set_aside=left))
    return _with_rows(machine, data, rows=rows, run=run, where=where, why=why, back=True)


def _with_rows(machine: Machine, data: Any, *, rows: str | Sequence[int], **keys: Any) -> Machine:
    table, file = Measurements.of(data), machine.file or machine.name
    listed = rows if isinstance(rows, str) else rows_text(rows)
    of = "" if keys["where"] else os.path.basename(table.file)
    with in_file(file, "[measured], set_aside"):
        new = SetAside(listed, file=of, **keys)
        entries = edited(machine.measured.set_aside, new, table, _compared(machine), file)
    changed = replace(machine, measured=replace(machine.measured, set_aside=entries))
    aside(changed, table)
    return changed
