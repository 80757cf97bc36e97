"""Take a table that is in memory as an Arrow table, whatever library it is of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from rodgen.errors import InputFileError, shown

__all__ = ["as_arrow"]


def as_arrow(frame: Any, name: str) -> pa.Table:
    """Return a table's columns as Arrow's; numbers are not copied where their memory is laid out as Arrow's.

    Parameters
    ----------
    frame : mapping, DataFrame or Arrow table
        See `rodgen.data.tables.open_frame`.
    name : str
        What stands for the file's name in error messages.

    Raises
    ------
    InputFileError
        When it is no table, or a column is no sequence of one type as long as the others.

    Examples
    --------
    >>> as_arrow({"C [deg]": [0, 90], "run": ["a", "b"]}, "data").schema.names
    ['C [deg]', 'run']
    """
    if isinstance(frame, pa.RecordBatch):
        return pa.Table.from_batches([frame])
    if isinstance(frame, pa.Table):
        return frame
    # Before Arrow's interface: through it pandas hands over its index as one more column.
    if isinstance(frame, Mapping):
        texts = list(frame)
    elif hasattr(frame, "columns") and hasattr(frame, "__getitem__"):
        texts = list(frame.columns)
    elif hasattr(frame, "__arrow_c_stream__"):
        return pa.table(frame)
    else:
        expected = "a mapping from column names to sequences, a DataFrame or an Arrow table"
        raise InputFileError(name, "file", f"an object of type {type(frame).__name__}", expected)
    arrays = []
    for number, text in enumerate(texts):
        if text in texts[:number]:  # a DataFrame hands out both at once
            raise InputFileError(name, "columns", f"column {shown(text)} twice", "every column name once")
        if not isinstance(text, str):
            raise InputFileError(name, "columns", f"{shown(text)} as a column's name", "text")
        arrays.append(_array(frame[text], f"column {shown(text)}", name))
        if len(arrays[-1]) != len(arrays[0]):
            found = f"{len(arrays[-1])} row{'s' * (len(arrays[-1]) != 1)}"
            expected = f"{len(arrays[0])}, as in the column {shown(texts[0])}"
            raise InputFileError(name, f"column {shown(text)}", found, expected)
    return pa.Table.from_arrays(arrays, names=texts)


def _array(values: Any, place: str, name: str) -> Any:
    if isinstance(values, pa.Array | pa.ChunkedArray):
        return values
    try:
        mask = np.ma.getmaskarray(values) if np.ma.isMaskedArray(values) else None
        array = np.asarray(values.to_numpy() if hasattr(values, "to_numpy") else values)
        if array.ndim != 1:
            found = f"an array of shape {array.shape}" if array.ndim else "a single value"
            raise InputFileError(name, place, found, "a sequence of numbers, one for each row")
        # Arrow takes no foreign byte order, in which FITS files are.
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        return pa.array(array, mask=mask, from_pandas=array.dtype.kind == "O")
    except InputFileError:
        raise
    except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        found = f"what is no sequence of numbers or of names ({shown(reason, 100)[1:-1]})"
        raise InputFileError(name, place, found, "one type in all of its cells") from None
