"""Tables of measured numbers: from a file into arrays, and results back into a file.

A table is a CSV file (UTF-8, commas, decimal points; gzip or not) or a Parquet file. In both, column names carry their
units in brackets::

    rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]

Any unit that Pint knows and that fits the column is valid, and it may differ from column to column.

- `open_table` opens a file, and `open_frame` a table in memory; it is read whole.
- `write_table` writes a file that takes its name only when it is complete.
- `read_motions` reads pairs of points, or poses; `map_table` adds columns of results to a table;
  `copy_with` adds columns that are known already.
- More rows than memory holds are read in parts, from Parquet files: :mod:`rodgen.data.tables.parts`.

Whatever is wrong with a file is an :class:`rodgen.errors.InputFileError`: one sentence with the file, the
line and column, what was found and what was expected.
"""

from rodgen.data.tables.columns import Column, EveryColumn
from rodgen.data.tables.mapped import (
    Answer,
    MapSummary,
    Result,
    check_output,
    copy_with,
    map_files,
    map_table,
)
from rodgen.data.tables.reader import (
    PAIR_COLUMNS,
    Pairs,
    Poses,
    open_csv,
    open_frame,
    open_table,
    read_motions,
)
from rodgen.data.tables.table import Rows, Table
from rodgen.data.tables.writer import write_columns, write_table

__all__ = [
    "PAIR_COLUMNS",
    "Answer",
    "Column",
    "EveryColumn",
    "MapSummary",
    "Pairs",
    "Poses",
    "Result",
    "Rows",
    "Table",
    "check_output",
    "copy_with",
    "map_files",
    "map_table",
    "open_csv",
    "open_frame",
    "open_table",
    "read_motions",
    "write_columns",
    "write_table",
]
