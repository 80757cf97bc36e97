"""Arrays that may be larger than memory: small ones in memory, large ones in temporary files.

The files have no names, so each disappears with its array, even if the process is killed. A fit of ten million rows
thus needs some hundred megabytes of memory, and as much disk as its columns.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import tempfile
from collections.abc import Iterator
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rodgen.errors import InputFileError

IN_MEMORY = 16 << 20
"""Bytes up to which an array stays in memory: above that a file costs no noticeable time."""
BLOCK = 1 << 16
"""Rows at a time of an array that may be in a file."""


class GrowingArray:
    """A column that is appended to block by block; a context manager, which its `array` outlives.

    Parameters
    ----------
    width : tuple of int
        Shape of one entry.

    Examples
    --------
    >>> with GrowingArray(float) as column:
    ...     column.append(np.array([1.0, 2.0]))
    ...     column.append(np.array([3.0]))
    ...     column.array()
    array([1., 2., 3.])
    """

    def __init__(self, dtype: DTypeLike, width: tuple[int, ...] = ()) -> None:
        self._dtype = np.dtype(dtype)
        self._width = width
        self._size = 0
        self._length = 0
        self._blocks: list[NDArray[Any]] = []
        self._file: IO[bytes] | None = None

    def __enter__(self) -> GrowingArray:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._file:
            # A full disk is reported when a block is written; closing may fail once more.
            with contextlib.suppress(OSError):
                self._file.close()

    def append(self, block: NDArray[Any]) -> None:
        """Append a block; it is kept, not copied, while the column is small."""
        self._blocks.append(np.ascontiguousarray(block, self._dtype))
        self._length += len(block)
        self._size += self._blocks[-1].nbytes
        if self._file is None and self._size <= IN_MEMORY:
            return
        with _disk_faults():
            self._file = self._file or tempfile.TemporaryFile()  # noqa: SIM115 - closed with the column
            for each in self._blocks:
                self._file.write(each.data)
        self._blocks = []

    def array(self) -> NDArray[Any]:
        """Return all of it, read-only; nothing can be appended any more."""
        if self._file is None:
            whole = np.concatenate([np.empty((0, *self._width), self._dtype), *self._blocks])
            self._blocks = []
        else:
            with _disk_faults():
                self._file.flush()
            shape = (self._length, *self._width)
            whole = np.memmap(self._file, self._dtype, "r", shape=shape).view(np.ndarray)
        whole.flags.writeable = False
        return whole


def empty(shape: tuple[int, ...], dtype: DTypeLike = np.float64, *, large: int | None = None) -> NDArray[Any]:
    """Return a writable array of any content, in a temporary file when it is large.

    Parameters
    ----------
    shape : tuple of int
    large : int, optional
        Bytes up to which it stays in memory; default: `IN_MEMORY`.

    Raises
    ------
    InputFileError
        When the folder of temporary files has no room for it.
    """
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if size <= (IN_MEMORY if large is None else large):
        return np.empty(shape, dtype)
    with _disk_faults(), tempfile.TemporaryFile() as file:
        # Writing to a mapped file with holes kills the process when the disk is full: reserve the room first.
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        return np.memmap(file, dtype, "w+", shape=shape).view(np.ndarray)


def blocks(*arrays: NDArray[Any]) -> Iterator[slice]:
    """Yield slices that cover arrays of one length; after each, what was read of those in files leaves memory.

    Parameters
    ----------
    *arrays : ndarray, each of shape (n, ...)

    Examples
    --------
    >>> [(rows.start, rows.stop) for rows in blocks(np.zeros(100_000))]
    [(0, 65536), (65536, 100000)]
    """
    n = len(arrays[0])
    for first in range(0, n, BLOCK):
        yield slice(first, min(first + BLOCK, n))
        for array in arrays:
            release(array)


def take(array: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Return some rows, (k,), of an array, (n, ...), in a temporary file when they are many."""
    some = empty((len(rows), *array.shape[1:]), array.dtype)
    for part in blocks(some):
        some[part] = array[rows[part]]
        release(array)
    return some


def release(array: Any) -> None:
    """Let the pages of an array in a file leave memory: the file keeps them."""
    while isinstance(array, np.ndarray):
        array = array.base
    if isinstance(array, mmap.mmap) and hasattr(array, "madvise"):
        array.madvise(mmap.MADV_DONTNEED)


@contextlib.contextmanager
def _disk_faults() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        expected = "room for the columns of a large table (TMPDIR names another folder)"
        raise InputFileError(
            tempfile.gettempdir(), "file", f"cannot be written ({reason})", expected
        ) from None
