"""Read measured pairs of points from a table.

A pair is a point before (`rho`) and after (`rho_prime`) a rotation by `angle` about an axis through the
origin of the frame in which both were measured.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.data.spool import GrowingArray
from rodgen.data.tables.columns import Column
from rodgen.data.tables.reader import open_table
from rodgen.data.tables.table import places_of
from rodgen.limits import check_cells

PAIR_COLUMNS = (
    *(Column(f"{point}_{axis}", "length") for point in ("rho", "rho_prime") for axis in "xyz"),
    Column("angle", "angle"),
)


@dataclass(frozen=True)
class Pairs:
    """Measured pairs; the arrays of many are in temporary files."""

    rho: NDArray[np.float64]
    rho_prime: NDArray[np.float64]
    """The points before and after, in `unit`, (n, 3)."""
    angle: NDArray[np.float64]
    """The rotations in radians, (n,)."""
    unit: str
    """The unit of the table's first length column."""
    file: str
    counted: str
    """What `numbers` are: ``"line"`` of a CSV file, or ``"row"``."""
    numbers: NDArray[np.int64]
    """Of each pair: its line, from 1, or its row, from 0, (n,)."""

    def places(self, chosen: Sequence[int] | NDArray[np.int_]) -> str:
        """Return the places of some pairs, one at least, such as ``"lines 4 and 9 of pairs.csv"``."""
        return places_of(self.file, self.counted, chosen, lambda some: self.numbers[some])


def read_pairs(path: str | os.PathLike[str]) -> Pairs:
    """Return all pairs of a table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV or Parquet with the columns ``rho_x … rho_z``, ``rho_prime_x … rho_prime_z`` and ``angle``,
        each with its unit in brackets; ``"-"`` is CSV on standard input.

    Returns
    -------
    Pairs

    Raises
    ------
    InputFileError
        When the file cannot be read or a cell in these columns is not a finite number.
    """
    with open_table(path, PAIR_COLUMNS) as table, ExitStack() as stack:
        points = [stack.enter_context(GrowingArray(np.float64, (3,))) for _ in range(2)]
        angle, numbers = (stack.enter_context(GrowingArray(kind)) for kind in (np.float64, np.int64))
        cells = 0
        for rows, _ in table.map(lambda rows: rows):
            for k, point in enumerate(points):
                point.append(np.column_stack(rows.values[3 * k : 3 * k + 3]))
            angle.append(rows.values[6])
            numbers.append(rows.numbers)
            cells += 7 * len(rows.numbers)
            check_cells(table.file, cells)
        rho, rho_prime, turn, places = (column.array() for column in (*points, angle, numbers))
        return Pairs(rho, rho_prime, turn, table.units()["rho_x"], table.file, table.counted, places)
