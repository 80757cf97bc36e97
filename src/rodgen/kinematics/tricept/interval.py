"""Interval arithmetic with derivatives: enclosures of a formula and its gradient over a box.

Every result encloses the exact one: each operation of IEEE 754 (+, −, ·, /, √) has a relative error of at most
the unit roundoff, 2⁻⁵³, and both ends are moved outwards by four times that. Where something is not bounded the ends
are NaN or infinite, never too narrow.
"""

from __future__ import annotations

from typing import Any, Union

import numpy as np

from rodgen.array_types import Array

_RELATIVE = 2.0**-51
# Far above the rounding of results that are not normal numbers, 2^-1075.
_ABSOLUTE = 1e-300


def outward(low: Array, high: Array) -> tuple[Array, Array]:
    """Return both ends moved outwards by more than what rounding to nearest can have moved them inwards.

    A result v of one operation is off by at most 2^-53 |v| + 2^-1075; 2^-51 |v| + 1e-300 is taken off, and the rounding
    of that is again at most about 2^-53 |v|.
    """
    return low - (np.abs(low) * _RELATIVE + _ABSOLUTE), high + (np.abs(high) * _RELATIVE + _ABSOLUTE)


def _times(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    one, two, three, four = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return outward(
        np.minimum(np.minimum(one, two), np.minimum(three, four)),
        np.maximum(np.maximum(one, two), np.maximum(three, four)),
    )


def _plus(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    return outward(a[0] + b[0], a[1] + b[1])


Operand = Union["Jet", float]


class Jet:
    """Enclosures of values and, where there are any, of their derivatives by the box's coordinates.

    Parameters
    ----------
    value : pair of ndarray, shape (..., n)
        Lower and upper ends; n boxes.
    slope : pair of ndarray, shape (3, ..., n), or None
        The same of the derivatives; None for values alone.
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: tuple[Array, Array], slope: tuple[Array, Array] | None = None) -> None:
        self.value = value
        self.slope = slope

    def __getitem__(self, index: Any) -> Jet:
        index = index if isinstance(index, tuple) else (index,)
        slope = None
        if self.slope is not None:
            slope = self.slope[0][(slice(None), *index)], self.slope[1][(slice(None), *index)]
        return Jet((self.value[0][index], self.value[1][index]), slope)

    def __neg__(self) -> Jet:
        slope = None if self.slope is None else (-self.slope[1], -self.slope[0])
        return Jet((-self.value[1], -self.value[0]), slope)

    def __add__(self, other: Operand) -> Jet:
        if not isinstance(other, Jet):
            return Jet(_plus(self.value, (np.float64(other),) * 2), self.slope)  # type: ignore[arg-type]
        slope = None
        if self.slope is not None and other.slope is not None:
            slope = _plus(self.slope, other.slope)
        return Jet(_plus(self.value, other.value), slope)

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Jet:
        return self + (-other)

    def __rsub__(self, other: float) -> Jet:
        return -self + other

    def __mul__(self, other: Operand) -> Jet:
        if not isinstance(other, Jet):
            factor = np.float64(other), np.float64(other)
            slope = None if self.slope is None else _times(self.slope, factor)  # type: ignore[arg-type]
            return Jet(_times(self.value, factor), slope)  # type: ignore[arg-type]
        slope = None
        if self.slope is not None and other.slope is not None:
            slope = _plus(_times(self.slope, other.value), _times(other.slope, self.value))
        return Jet(_times(self.value, other.value), slope)

    __rmul__ = __mul__

    def square(self) -> Jet:
        """Return the square; never negative."""
        low, high = self.value
        ends = low * low, high * high
        least = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(*ends))
        least, greatest = outward(least, np.maximum(*ends))
        slope = None
        if self.slope is not None:
            slope = _times(_times(self.slope, self.value), (np.float64(2.0),) * 2)  # type: ignore[arg-type]
        return Jet((np.maximum(least, 0.0), greatest), slope)

    def inverse(self) -> Jet:
        """Return the reciprocal; not bounded where 0 is inside."""
        low, high = self.value
        with np.errstate(divide="ignore", invalid="ignore"):
            bad = (low <= 0) & (high >= 0)
            ends = np.where(bad, -np.inf, 1.0 / high), np.where(bad, np.inf, 1.0 / low)
        value = outward(*ends)
        slope = None
        if self.slope is not None:
            factor = Jet(value).square().value
            slope = _times(self.slope, (-factor[1], -factor[0]))
        return Jet(value, slope)

    def __truediv__(self, other: Jet) -> Jet:
        return self * other.inverse()

    def sqrt(self) -> Jet:
        """Return the square root; NaN where the argument can be negative."""
        with np.errstate(invalid="ignore"):
            low, high = outward(np.sqrt(self.value[0]), np.sqrt(self.value[1]))
        root = Jet((np.maximum(low, 0.0), high))
        if self.slope is not None:
            half = root.inverse() * 0.5
            root.slope = _times(self.slope, half.value)
        return root


def stack(parts: list[Any]) -> Jet:
    """Return jets (a list, or lists of lists) as one, along leading axes."""
    if isinstance(parts[0], list):
        parts = [stack(part) for part in parts]
    value = np.stack([p.value[0] for p in parts]), np.stack([p.value[1] for p in parts])
    slope = None
    if parts[0].slope is not None:
        slope = np.stack([p.slope[0] for p in parts], axis=1), np.stack([p.slope[1] for p in parts], axis=1)
    return Jet(value, slope)


def dot(a: Jet, b: Jet) -> Jet:
    """Return the scalar product over the first axis."""
    total = a[0] * b[0]
    for n in range(1, len(a.value[0])):
        total = total + a[n] * b[n]
    return total


def matmul(a: Jet, b: Jet) -> Jet:
    """Return the product of matrices, which stand along the first two axes."""
    total = a[:, 0, None] * b[None, 0, :]
    for n in range(1, len(b.value[0])):
        total = total + a[:, n, None] * b[None, n, :]
    return total


def cross(a: Jet, b: Jet) -> Jet:
    """Return the vector product over the first axis."""
    return stack([a[(n + 1) % 3] * b[(n + 2) % 3] - a[(n + 2) % 3] * b[(n + 1) % 3] for n in range(3)])
