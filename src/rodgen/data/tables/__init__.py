"""Tables of measured numbers: from a file into arrays, and results back into a file.

A table is a CSV file (UTF-8, commas, decimal points; gzip or not) or a Parquet file. Its column names
carry their units in brackets, in both::

    rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]

Any unit that Pint knows and that fits the column will do, and it may differ from column to column.

- `open_table` reads in blocks, so that a file of any length passes through bounded memory; `open_frame` takes
  a table that is in memory instead.
- `open_sink` writes in blocks, into a temporary file that takes its name only when it is complete.
- `read_pairs` reads pairs of points; `map_table` adds columns of results to a table, row by row.

Whatever is wrong with a file is an :class:`rodgen.errors.InputFileError`: one sentence with the file, the
line and column, what was found and what was expected.
"""

from typing import TYPE_CHECKING, Any

from rodgen.data.tables.columns import Column, EveryColumn, nearest

if TYPE_CHECKING:
    from rodgen.data.tables.mapped import Answer, MapSummary, Result, map_table
    from rodgen.data.tables.pairs import PAIR_COLUMNS, Pairs, read_pairs
    from rodgen.data.tables.reader import Rows, open_frame, open_table
    from rodgen.data.tables.writer import open_sink

__all__ = [
    "PAIR_COLUMNS",
    "Answer",
    "Column",
    "EveryColumn",
    "MapSummary",
    "Pairs",
    "Result",
    "Rows",
    "map_table",
    "nearest",
    "open_frame",
    "open_sink",
    "open_table",
    "read_pairs",
]


def __getattr__(name: str) -> Any:
    """Import what reads and writes when it is asked for: PyArrow takes 0.13 s, and a unit needs none of it."""
    if name in __all__:
        from rodgen.data.tables import mapped, pairs
        from rodgen.data.tables import reader as _source
        from rodgen.data.tables import writer as _sink

        for module in (_sink, _source, mapped, pairs):
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
