"""Write a table in blocks without ever leaving an incomplete file.

A file is written under a temporary name in its final folder and renamed when it is complete; standard output gets its
text when all of it is known to be good. So a reader of the output gets all of it, and an error in row nine million
leaves the file that was there before.
"""

from __future__ import annotations

import abc
import contextlib
import csv
import gzip
import io
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from rodgen.errors import InputFileError, shown
from rodgen.files import AtomicFile, Output, is_device

# Row groups of a few MB per column are read fast; larger ones would only stay in memory longer.
_ROW_GROUP = 1 << 17
_SPOOLED_BYTES = 16 << 20
_KINDS = "a name that ends in .csv, .csv.gz or .parquet"


class Sink(abc.ABC):
    """A table that is being written; `open_sink` makes it.

    As a context manager it completes the output when its block ends without an error, and otherwise leaves nothing.
    """

    def __init__(self, place: AtomicFile | _Stdout, schema: pa.Schema) -> None:
        self._place = place
        self._schema = schema
        self._streams: list[Any] = []  # each writes to the one after it

    @abc.abstractmethod
    def encode(self, batch: pa.RecordBatch) -> Any:
        """Return a block in the form that `write` takes; safe to call in threads."""

    @abc.abstractmethod
    def write(self, encoded: Any) -> None:
        """Append a block."""

    @abc.abstractmethod
    def _begin(self) -> None:
        """Write what stands before the first block."""

    @abc.abstractmethod
    def _end(self) -> None:
        """Write what is held back after the last block."""

    def __enter__(self) -> Sink:
        """Create the temporary file."""
        self._streams = [self._place.open()]
        try:
            with self._place.located():
                self._begin()
        except BaseException:
            self._finish(False)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Commit the temporary file, or remove it when there was an error."""
        complete = False
        try:
            if kind is None:
                with self._place.located():
                    self._end()
                complete = True
        finally:
            self._finish(complete)

    def _finish(self, complete: bool) -> None:
        try:
            with self._place.located() if complete else contextlib.suppress(OSError):
                with contextlib.ExitStack() as closing:
                    for stream in reversed(self._streams):
                        closing.callback(stream.close)
                if complete:
                    self._place.commit()
        finally:
            self._place.discard()


def open_sink(path: str | os.PathLike[str] | None, schema: pa.Schema) -> Sink:
    """Return a file, or standard output, open for writing a table in blocks.

    Parameters
    ----------
    path : str, os.PathLike or None
        Ends in ``.csv``, ``.csv.gz`` or ``.parquet``; None or ``"-"`` is CSV on standard output.
    schema : pyarrow.Schema
        Of the blocks.

    Returns
    -------
    Sink
        A context manager; ``write(encode(batch))`` appends.

    Raises
    ------
    InputFileError
        When the place cannot be written, here or in `Sink.write`, or its name has no known ending.
    """
    if path is None or os.fspath(path) == "-":
        _check_csv_holds("standard output", schema)
        return _CsvSink(_Stdout(), schema)
    file = os.fspath(path)
    name = file.lower()
    if not name.endswith((".csv", ".csv.gz", ".parquet")) and not is_device(file):
        raise InputFileError(file, "file", "a name that does not say what to write", _KINDS)
    if name.endswith(".parquet"):
        return _ParquetSink(AtomicFile(file), schema)
    _check_csv_holds(file, schema)
    return _CsvSink(AtomicFile(file), schema, compress=name.endswith(".gz"))


def write_columns(path: str | os.PathLike[str] | None, columns: Mapping[str, Any]) -> None:
    """Write arrays of one size as the columns of a table.

    Parameters
    ----------
    path : str, os.PathLike or None
        As for `open_sink`.
    columns : mapping of str to array_like
        By name with unit; masked elements become empty cells.
    """
    batch = pa.RecordBatch.from_pydict({name: _array(values) for name, values in columns.items()})
    with open_sink(path, batch.schema) as sink:
        sink.write(sink.encode(batch))


def _array(values: Any) -> pa.Array:
    if not isinstance(values, np.ndarray):
        return pa.array(values)
    flat = np.ma.ravel(values)
    return pa.array(flat.data, mask=np.ma.getmaskarray(flat))


def _check_csv_holds(file: str, schema: pa.Schema) -> None:
    for field in schema:
        if pa.types.is_nested(field.type):
            raise InputFileError(
                file,
                f"column {shown(field.name)}",
                f"the type {shown(str(field.type))}",
                "Parquet as the output",
            )


class _Stdout(Output):
    """Standard output, which gets everything or nothing."""

    file = "standard output"

    def open(self) -> IO[bytes]:
        if sys.stdout is None:
            raise InputFileError(self.file, "file", "closed", "an open standard output, or -o FILE")
        self._spool = tempfile.SpooledTemporaryFile(_SPOOLED_BYTES)  # noqa: SIM115
        # The sink closes what it wrote to; the spool has to outlive that.
        return _Unclosed(self._spool)  # type: ignore[return-value]

    def publish(self) -> None:
        with self.located():
            self._spool.seek(0)
            sys.stdout.flush()
            binary = getattr(sys.stdout, "buffer", None)
            if binary is None:  # standard output was replaced by a text buffer
                sys.stdout.write(self._spool.read().decode())
            else:
                shutil.copyfileobj(self._spool, binary, 1 << 20)
                binary.flush()

    def clean(self) -> None:
        self._spool.close()


class _Unclosed:
    closed = False

    def __init__(self, stream: Any) -> None:
        self.write, self.tell, self.flush = stream.write, stream.tell, stream.flush

    def close(self) -> None:
        pass


class _CsvSink(Sink):
    def __init__(self, place: AtomicFile | _Stdout, schema: pa.Schema, *, compress: bool = False) -> None:
        super().__init__(place, schema)
        self._compress = compress

    def _begin(self) -> None:
        if self._compress:
            # No name and no time in the header: the same input gives the same bytes.
            self._streams.insert(
                0, gzip.GzipFile(filename="", mode="wb", fileobj=self._streams[0], compresslevel=5, mtime=0)
            )
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(self._schema.names)
        self._streams[0].write(header.getvalue().encode())

    def encode(self, batch: pa.RecordBatch) -> pa.Buffer:
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

    def write(self, encoded: Any) -> None:
        with self._place.located():
            self._streams[0].write(encoded)

    def _end(self) -> None:
        pass


class _ParquetSink(Sink):
    def __init__(self, place: AtomicFile, schema: pa.Schema) -> None:
        super().__init__(place, schema)
        self._held: list[pa.RecordBatch] = []
        self._held_rows = 0

    def _begin(self) -> None:
        import pyarrow.parquet as pq

        self._streams.insert(0, pq.ParquetWriter(self._streams[0], self._schema, write_page_checksum=True))

    def encode(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        return batch

    def write(self, encoded: pa.RecordBatch) -> None:
        self._held.append(encoded)
        self._held_rows += len(encoded)
        if self._held_rows >= _ROW_GROUP:
            with self._place.located():
                self._end()

    def _end(self) -> None:
        if self._held:
            self._streams[0].write_table(pa.Table.from_batches(self._held, self._schema))
        self._held, self._held_rows = [], 0
