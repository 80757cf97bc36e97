"""Write a table: a file that is complete or not there, or standard output, which gets all of it or nothing."""

from __future__ import annotations

import contextlib
import csv
import gzip
import io
import os
import sys
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from rodgen.errors import InputFileError, shown
from rodgen.files import AtomicFile, Output, is_device

# Row groups of a few MB per column are read fast; larger ones would only take more memory.
_ROW_GROUP = 1 << 17
_KINDS = "a name that ends in .csv, .csv.gz or .parquet"


def check_table_name(path: str | os.PathLike[str] | None) -> None:
    """Refuse a name of an output that does not say what to write.

    Raises
    ------
    InputFileError
    """
    file = "-" if path is None else os.fspath(path)
    known = file == "-" or file.lower().endswith((".csv", ".csv.gz", ".parquet")) or is_device(file)
    if not known:
        raise InputFileError(file, "file", "a name that does not say what to write", _KINDS)


def write_table(path: str | os.PathLike[str] | None, table: pa.Table) -> None:
    """Write a table.

    Parameters
    ----------
    path : str, os.PathLike or None
        Ends in ``.csv``, ``.csv.gz`` or ``.parquet``; None or ``"-"`` is CSV on standard output.
    table : pyarrow.Table

    Raises
    ------
    InputFileError
        When the place cannot be written, or its name has no known ending.
    """
    check_table_name(path)
    place: AtomicFile | _Stdout = (
        _Stdout() if path is None or os.fspath(path) == "-" else AtomicFile(os.fspath(path))
    )
    name = place.file.lower()
    is_parquet = name.endswith(".parquet")
    for field in table.schema:
        if pa.types.is_nested(field.type) and not is_parquet:
            found = f"the type {shown(str(field.type))}"
            raise InputFileError(place.file, f"column {shown(field.name)}", found, "Parquet as the output")
    try:
        with contextlib.ExitStack() as closing:
            stream = place.open()
            closing.enter_context(place.located())
            closing.enter_context(stream)
            if is_parquet:
                import pyarrow.parquet as pq

                pq.write_table(table, stream, row_group_size=_ROW_GROUP, write_page_checksum=True)
            elif name.endswith(".gz"):
                # No name and no time in the header: the same input gives the same bytes.
                with gzip.GzipFile(
                    filename="", mode="wb", fileobj=stream, compresslevel=5, mtime=0
                ) as packed:
                    _write_csv(table, packed)
            else:
                _write_csv(table, stream)
        place.commit()
    finally:
        place.discard()


def write_columns(path: str | os.PathLike[str] | None, columns: Mapping[str, Any]) -> None:
    """Write arrays of one size as the columns of a table.

    Parameters
    ----------
    path : str, os.PathLike or None
        As for `write_table`.
    columns : mapping of str to array_like
        By name with unit; masked elements become empty cells.
    """
    write_table(path, pa.table({name: _array(values) for name, values in columns.items()}))


def _array(values: Any) -> pa.Array:
    if not isinstance(values, np.ndarray):
        return pa.array(values)
    flat = np.ma.ravel(values)
    return pa.array(flat.data, mask=np.ma.getmaskarray(flat))


def _write_csv(table: pa.Table, stream: Any) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(table.column_names)
    stream.write(header.getvalue().encode())
    for batch in table.to_batches(max_chunksize=_ROW_GROUP):
        stream.write(_encoded(batch))


def _encoded(batch: pa.RecordBatch) -> pa.Buffer:
    # Arrow quotes all text or none; none is shorter, and correct unless a cell holds a comma or a quotation mark.
    for style in ("none", "needed"):
        out = pa.BufferOutputStream()
        try:
            pa_csv.write_csv(batch, out, pa_csv.WriteOptions(include_header=False, quoting_style=style))
        except pa.ArrowInvalid:
            if style == "needed":
                raise
            continue
        return out.getvalue()
    raise AssertionError("unreachable")


class _Stdout(Output):
    """Standard output, which gets everything or nothing."""

    file = "standard output"

    def open(self) -> IO[bytes]:
        if sys.stdout is None:
            raise InputFileError(self.file, "file", "closed", "an open standard output, or -o FILE")
        self._held = _Held()
        return self._held

    def publish(self) -> None:
        with self.located():
            sys.stdout.flush()
            binary = getattr(sys.stdout, "buffer", None)
            if binary is None:  # standard output was replaced by a text buffer
                sys.stdout.write(self._held.getvalue().decode())
            else:
                rest = self._held.getbuffer()
                while rest:  # where standard output is not buffered, it may take a part
                    rest = rest[binary.write(rest) :]
                binary.flush()

    def clean(self) -> None:
        self._held = _Held()


class _Held(io.BytesIO):
    """Bytes that outlive the end of writing."""

    def close(self) -> None:
        pass
