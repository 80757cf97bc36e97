"""Matrices of the numbers of a tape, with the methods and the names of SymPy's that a model needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any


class Matrix:
    """A matrix of values; made of a list of components, or of rows, columns and components, row by row."""

    __slots__ = ("flat", "shape")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, *given: Any) -> None:
        if len(given) == 3:
            rows, columns, flat = given
        else:
            (flat,) = given
            rows, columns = len(flat), 1
            if flat and isinstance(flat[0], list | tuple):
                columns, flat = len(flat[0]), [x for row in flat for x in row]
        self.shape: tuple[int, int] = rows, columns
        self.flat = list(flat)

    @staticmethod
    def zeros(rows: int, columns: int) -> Matrix:
        """Return a matrix of zeros."""
        return Matrix(rows, columns, [0] * (rows * columns))

    @staticmethod
    def eye(n: int) -> Matrix:
        """Return a unit matrix."""
        return Matrix([[int(i == j) for j in range(n)] for i in range(n)])

    @staticmethod
    def hstack(*parts: Matrix) -> Matrix:
        """Return matrices side by side."""
        return Matrix([[x for part in parts for x in part.row(i)] for i in range(parts[0].shape[0])])

    @staticmethod
    def vstack(*parts: Matrix) -> Matrix:
        """Return matrices below each other."""
        return Matrix(
            sum(part.shape[0] for part in parts), parts[0].shape[1], [x for part in parts for x in part]
        )

    def __iter__(self) -> Iterator[Any]:
        return iter(self.flat)

    def __len__(self) -> int:
        return len(self.flat)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Matrix) and (self.shape, self.flat) == (other.shape, other.flat)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, int | slice):
            return self.flat[at]
        rows, columns = (
            [k] if isinstance(k, int) else list(range(n)[k]) for k, n in zip(at, self.shape, strict=True)
        )
        entries = [self.flat[self.shape[1] * i + j] for i in rows for j in columns]
        return entries[0] if all(isinstance(k, int) for k in at) else Matrix(len(rows), len(columns), entries)

    def row(self, i: int) -> Matrix:
        """Return a row, (1, columns)."""
        columns = self.shape[1]
        return Matrix(1, columns, self.flat[columns * i : columns * (i + 1)])

    def col(self, j: int) -> Matrix:
        """Return a column, (rows, 1)."""
        return Matrix(self.shape[0], 1, self.flat[j :: self.shape[1]])

    @property
    def T(self) -> Matrix:
        """The transpose."""
        rows, columns = self.shape
        return Matrix(
            columns, rows, [self.flat[columns * i + j] for j in range(columns) for i in range(rows)]
        )

    def __neg__(self) -> Matrix:
        return Matrix(*self.shape, [-x for x in self.flat])

    def __add__(self, other: Matrix) -> Matrix:
        return Matrix(*self.shape, [x + y for x, y in zip(self.flat, other.flat, strict=True)])

    def __sub__(self, other: Matrix) -> Matrix:
        return Matrix(*self.shape, [x - y for x, y in zip(self.flat, other.flat, strict=True)])

    def __mul__(self, other: Any) -> Matrix:
        if not isinstance(other, Matrix):
            return Matrix(*self.shape, [x * other for x in self.flat])
        rows, columns = self.shape[0], other.shape[1]
        return Matrix(
            rows, columns, [self.row(i).dot(other.col(j)) for i in range(rows) for j in range(columns)]
        )

    def __rmul__(self, factor: Any) -> Matrix:
        return self.__mul__(factor)

    def __truediv__(self, divisor: Any) -> Matrix:
        return self.__mul__(1 / divisor)

    def dot(self, other: Matrix) -> Any:
        """Return the sum of the products of the components."""
        return _total([x * y for x, y in zip(self.flat, other.flat, strict=True)])

    def cross(self, other: Matrix) -> Matrix:
        """Return the cross product of two vectors."""
        (a, b, c), (x, y, z) = self.flat, other.flat
        return Matrix([b * z - c * y, c * x - a * z, a * y - b * x])

    def adjugate(self) -> Matrix:
        """Return the adjugate of a (3, 3) matrix: its inverse times its determinant."""
        a, b, c = (self.row(i) for i in range(3))
        return Matrix.hstack(b.cross(c), c.cross(a), a.cross(b))

    def tolist(self) -> list[list[Any]]:
        """Return the rows as lists."""
        return [self.row(i).flat for i in range(self.shape[0])]


def _total(parts: Sequence[Any]) -> Any:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
