"""Measured pairs of points, and the axes of each, row by row.

A pair is a point before (`rho`) and after (`rho_prime`) a rotation by `angle` about an axis through the
origin of the frame in which both were measured.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column
from rodgen.data.tables.reader import Rows, open_table
from rodgen.data.tables.writer import open_sink
from rodgen.errors import InputFileError, shown

__all__ = ["PAIR_COLUMNS", "RESULT_COLUMNS", "Pairs", "SolveSummary", "read_pairs", "solve_table"]

PAIR_COLUMNS = (
    *(Column(f"{point}_{axis}", "length") for point in ("rho", "rho_prime") for axis in "xyz"),
    Column("angle", "angle"),
)
RESULT_COLUMNS = (
    *((f"e{root}_{axis}", pa.float64()) for root in (1, 2) for axis in "xyz"),
    ("status", pa.string()),
    ("length_mismatch", pa.float64()),
    ("condition", pa.float64()),
)

Progress = Callable[[int | None, str], Callable[[int], object]]


@dataclass(frozen=True)
class Pairs:
    """Measured pairs.

    Attributes
    ----------
    rho, rho_prime : ndarray, shape (n, 3)
        The points before and after, in `unit`.
    angle : ndarray, shape (n,)
        The rotations in radians.
    unit : str
        The unit of the table's first length column.
    """

    rho: NDArray[np.float64]
    rho_prime: NDArray[np.float64]
    angle: NDArray[np.float64]
    unit: str


@dataclass
class SolveSummary:
    """What `solve_table` found.

    Attributes
    ----------
    rows : int
        Pairs solved.
    counts : dict
        Rows of each status, by its name in lower case, in the order of `rodgen.AxisStatus`; only those
        that occur.
    """

    rows: int = 0
    counts: dict[str, int] = field(default_factory=dict)


def read_pairs(path: str | os.PathLike[str]) -> Pairs:
    """Read a table of pairs whole.

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
        When the file cannot be read or a cell in these columns is no finite number.
    """
    with open_table(path, PAIR_COLUMNS) as table:
        blocks = [values for values, _ in table.map(lambda rows: np.column_stack(rows.values))]
        values = np.concatenate(blocks)
        unit = table.units()["rho_x"]
    return Pairs(
        np.ascontiguousarray(values[:, :3]),
        np.ascontiguousarray(values[:, 3:6]),
        np.ascontiguousarray(values[:, 6]),
        unit,
    )


def solve_table(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    length_tolerance: float | None = None,
    progress: Progress | None = None,
) -> SolveSummary:
    """Find the axes of every pair of a table, in bounded memory.

    Parameters
    ----------
    path : str or os.PathLike
        The pairs, as `read_pairs` takes them.
    output : str or os.PathLike, optional
        ``.csv``, ``.csv.gz`` or ``.parquet``; CSV on standard output when left out or ``"-"``. It gets
        every column of the input as it stands there, then the unit axes ``e1_x … e2_z``, ``status``,
        ``length_mismatch`` (``|rho'|/|rho| - 1``) and ``condition`` (see `rodgen.axis_condition`).
        Columns that are not used are copied unread: text from CSV, also into Parquet, and with their own
        type from Parquet.
    length_tolerance : float, optional
        As in `rodgen.solve_axis`; its default when left out.
    progress : callable, optional
        Called once with the total (or None) and its unit, returns what is called with every advance.

    Returns
    -------
    SolveSummary

    Raises
    ------
    InputFileError
        When the input or the output cannot be used. The output is then what it was before.
    """
    import rodgen

    options: dict[str, Any] = {} if length_tolerance is None else {"length_tolerance": length_tolerance}
    names = np.array([status.name.lower() for status in rodgen.AxisStatus])
    codes = np.array([int(status) for status in rodgen.AxisStatus])
    if not np.array_equal(codes, np.arange(len(codes))):
        raise AssertionError("AxisStatus must count from zero: its values index the names")
    status_names = pa.array(names.tolist(), pa.string())
    counts = np.zeros(len(names), np.int64)

    keep_text = output is None or not os.fspath(output).lower().endswith(".parquet")
    with open_table(path, PAIR_COLUMNS, keep_text=keep_text) as table:
        for name, _ in RESULT_COLUMNS:
            if name in table.schema.names:
                raise InputFileError(
                    table.file,
                    f"column {shown(name)}",
                    "a result of an earlier run",
                    "a table without results",
                )
        schema = pa.schema([*table.schema, *(pa.field(name, kind) for name, kind in RESULT_COLUMNS)])

        with open_sink(output, schema, source=path) as sink:

            def solve(rows: Rows) -> tuple[object, NDArray[np.int64]]:
                rho = np.column_stack(rows.values[:3])
                rho_prime = np.column_stack(rows.values[3:6])
                angle = rows.values[6]
                axes, status = rodgen.solve_axis(rho, rho_prime, angle, **options)
                results = [
                    *(pa.array(column) for column in axes.reshape(-1, 6).T.copy()),
                    status_names.take(pa.array(status)),
                    pa.array(rodgen.length_mismatch(rho, rho_prime)),
                    pa.array(rodgen.axis_condition(rho, rho_prime, angle)),
                ]
                batch = pa.RecordBatch.from_arrays([*rows.batch.columns, *results], schema=schema)
                return sink.encode(batch), np.bincount(status, minlength=len(names))

            advance = progress(table.total, table.amount_unit) if progress else None
            for (encoded, found), amount in table.map(solve):
                sink.write(encoded)
                counts += found
                if advance:
                    advance(amount)
    return SolveSummary(int(counts.sum()), {str(n): int(c) for n, c in zip(names, counts, strict=True) if c})
