"""Planned readings as a table like the measurement file that they continue, to be measured and read back."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.calibration.plan.rows import Rows, Surroundings, usual_by_target
from rodgen.data.units import parse_unit

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

DIGITS = 9
TO_BE_SET, TO_BE_MET = 4, 2
"""Digits of the range of a column that people read, as of positions, and of temperatures, which can hardly be set."""


def table(machine: Machine, surroundings: Surroundings, rows: Rows) -> dict[str, list[Any]]:
    """Return columns by their names with units, in the order of the data's, without readings.

    The machine has the new targets, too; the rows are in order.
    """
    o = surroundings.o
    columns = o.data.columns
    names = [joint.column for joint in machine.joints]
    follow = {joint.name for joint in machine.joints if joint.coordinate} - {
        joint.name for joint in machine.joints if joint.reading == joint.name
    }
    readings = machine.measurand.read_columns
    targets = [target.name for target in machine.targets]
    found: dict[str, list[Any]] = {}

    def numbers(values: Any, unit: str | None) -> list[float]:
        factor = parse_unit(unit).factor(machine.length_unit) if unit else 1.0
        return [float(f"{x:.{DIGITS}g}") + 0.0 for x in np.asarray(values, float) / factor]

    for name, column in columns.items():
        prefix, _, rest = name.partition("_")
        if name in readings or name in follow:
            continue
        if name in names:
            found[column.text] = numbers(rows.q[:, names.index(name)], column.unit)
        elif name == "target":
            found[column.text] = [targets[k] for k in rows.target]
        elif name == "run":
            found[column.text] = [str(o.run_names[o.run[-1]])] * rows.n
        elif name == "t":
            found[column.text] = numbers(surroundings.times(rows), column.unit)
        elif name == "load":
            found[column.text] = numbers(rows.load, column.unit)
        elif prefix == "dir" and rest in names:
            found[column.text] = [int(x) or 1 for x in rows.s[:, names.index(rest)]]
        elif prefix == "v" and rest in names:
            found[column.text] = numbers(rows.v[:, names.index(rest)], column.unit)
        elif prefix == "u" and rest in readings:
            usual = usual_by_target(o, np.asarray(column.values), len(targets))
            found[column.text] = usual[rows.target].tolist()
        elif not hasattr(column, "codes"):  # temperatures and covariates, as they were
            values = np.asarray(column.values)
            found[column.text] = np.round(values[rows.state], _decimals(values, TO_BE_MET)).tolist()
    if "target" not in columns and len(targets) > 1:
        found["target"] = [targets[k] for k in rows.target]
    return found


def as_csv(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return a table as the text of a CSV file."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(map(_cell, values) for values in columns.values()), strict=True))
    return stream.getvalue()


def _decimals(values: Any, digits: int) -> int:
    """Return the decimals that tell so many digits of the range of values, or of themselves where all are alike."""
    size = float(np.ptp(values)) or float(np.abs(values).max(initial=0.0))
    return digits - 1 - math.floor(math.log10(size)) if size > 0 else 0


def _for_people(values: Sequence[Any]) -> Sequence[Any]:
    if not all(isinstance(value, float) for value in values):
        return values
    return [float(x) + 0.0 for x in np.round(values, _decimals(values, TO_BE_SET))]


def _cell(value: Any) -> str:
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


def as_text(columns: Mapping[str, Sequence[Any]]) -> list[str]:
    """Return a table as lines for people."""
    cells = [[name, *map(_cell, _for_people(values))] for name, values in columns.items()]
    widths = [max(map(len, column)) for column in cells]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in zip(*cells, strict=True)
    ]
