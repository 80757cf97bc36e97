"""Run a table command: read a table, add result columns to each row, write it, and count the results."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rodgen.cli._console import OK, Option, argument, conclude, option
from rodgen.cli._values import InputFile, OutputTable
from rodgen.errors import InputFileError, counted

if TYPE_CHECKING:
    from rodgen.data.tables import Answer, MapSummary

Columns: TypeAlias = list[tuple[str, Any]]
"""Columns of a table: the name of each, and its quantity or, of a status, the `IntEnum`."""


OUTPUT = option("-o --output FILE", ".csv, .csv.gz or .parquet; default: CSV on standard output", OutputTable)


def table(name: str, **how: Any) -> Option:
    """Return the argument for the table that is read, `options.table`."""
    return argument(name, "the table; '-' is CSV on standard input", InputFile, dest="table", **how)


def named(quantity: str, names: str) -> Columns:
    """Return columns of one quantity, from their names with spaces in between."""
    return [(name, quantity) for name in names.split()]


def map_rows(
    options: argparse.Namespace,
    columns: Columns,
    prepare: Callable[[str], tuple[Columns, Callable[[Any], Answer]]],
    *,
    by_order: bool = False,
) -> int:
    """Add results to `options.table`, write it to `options.output`, and count the results on standard error.

    Parameters
    ----------
    columns : list of (str, str)
        Names and quantities of the columns that are read, as of `rodgen.data.tables.Column`.
    prepare : callable
        Called once with the unit of length; returns names and quantities of the results, as of
        `rodgen.data.tables.Result`, and the function from the values of `columns`, an array with a column for each, to
        an `Answer`.
    by_order : bool
        Whether results depend on the rows before, so that the table is one file.

    Returns
    -------
    int
        The exit code.
    """
    from rodgen.data.tables import Column, Result, map_files, map_table
    from rodgen.data.tables.parts import is_many

    def prepared(unit: str) -> Any:
        results, function = prepare(unit)
        return [Result(*result) for result in results], lambda values: function(np.column_stack(values))

    wanted = [Column(*column) for column in columns]
    if is_many(options.table):
        if by_order:
            raise InputFileError(
                options.table, "file", "many files", "one: results depend on the rows before"
            )
        summary = map_files(
            options.table, options.output, lambda file, to: map_table(file, to, wanted, prepared)
        )
    else:
        summary = map_table(options.table, options.output, wanted, prepared)
    conclude(_counted(options.table, summary))
    return OK


def _counted(table: str, summary: MapSummary) -> str:
    """Return the line that counts the rows of an output by their status."""
    name = "standard input" if table == "-" else table
    counts = ", ".join(f"{count} {status}" for status, count in summary.counts.items())
    return f"{name}: {counted(summary.rows, 'row')} written{': ' * bool(counts)}{counts}"


def rows_of(count: Any, further: Any = False) -> tuple[Any, Any, Any]:
    """Lay out several solutions of a row as rows of their own; a row without any keeps one.

    Parameters
    ----------
    count : array_like of int, shape (n,)
        Solutions of each row.
    further : array_like of bool, shape (n,), optional
        Where a row that is not a solution follows them.

    Returns
    -------
    index, slot, number : arrays of int, shape (m,)
        Of each row of the output: the row of the input, which of its solutions, and that counted from 1, 0 for none.
    """
    solutions = np.asarray(count)
    index = np.repeat(np.arange(len(solutions)), solutions + ((solutions == 0) | further))
    slot = np.arange(len(index)) - np.searchsorted(index, index)
    return index, slot, np.where(slot < solutions[index], slot + 1, 0)
