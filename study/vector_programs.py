"""`solve_axis` and `rotate` once more, operation by operation, on vectors in place of components.

The roundings of a vector's three components move it by a vector whose length has a bound in any orientation: so a bound
that is found for points in one plane holds for points anywhere, and boxes have two dimensions in place of seven.
tests/test_certified.py checks that these programs, on floats, give bit for bit what the generated kernels give.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from flint import arb
from rounding import (
    EPS,
    FUNCTION_ULPS,
    ROOM,
    Box,
    Condition,
    Number,
    Tape,
    U,
    UndecidedError,
    ball,
    bounds,
    paths,
    upper,
)

Vector = Sequence[Any]

CROSS = 2 / 3**0.5 * ROOM
"""Largest length of the vector of all |a₂b₃| + |a₃b₂| for unit vectors a and b.

Its square is 1 + (Σ|aᵢbᵢ|)² - 2 Σ aᵢ²bᵢ², and (Σ|aᵢbᵢ|)² is at most 1 and at most 3 Σ aᵢ²bᵢ²."""


class Floats:
    """Arithmetic on arrays; a vector is three of them."""

    sqrt = staticmethod(np.sqrt)

    def plus(self, a: Vector, b: Vector) -> Vector:
        return [x + y for x, y in zip(a, b, strict=True)]

    def minus(self, a: Vector, b: Vector) -> Vector:
        return [x - y for x, y in zip(a, b, strict=True)]

    def times(self, a: Vector, s: Any) -> Vector:
        return [x * s for x in a]

    def dot(self, a: Vector, b: Vector) -> Any:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def one_and_square(self, a: Vector) -> Any:
        return 1.0 + a[0] * a[0] + a[1] * a[1] + a[2] * a[2]

    def cross(self, a: Vector, b: Vector) -> Vector:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def itself_and_cross(self, a: Vector, b: Vector) -> Vector:
        """Return b + a x b, the sum before the difference."""
        return [b[i] + b[i - 1] * a[i - 2] - b[i - 2] * a[i - 1] for i in range(3)]

    def known(self, x: Any, value: Any) -> Any:
        return x

    def off(self, x: Any, size: float) -> Any:
        return x

    def less(self, a: Any, b: Any, difference: Any) -> Any:
        return a < b

    def where(self, condition: Any, yes: Callable[[], Vector], no: Vector) -> Vector:
        return [np.where(condition, x, y) for x, y in zip(yes(), no, strict=True)]


class Balls(Floats):
    """Arithmetic on `Number`s: without rounding first, then the result is moved as roundings in any orientation may."""

    def __init__(self, tape: Tape) -> None:
        self.tape = tape

    def _rounded(self, compute: Callable[[], Any], *sizes: Any) -> Any:
        """Return a vector or a number that is moved by at most these multiples of u, and by its own rounding."""
        kept, self.tape.roundings = self.tape.roundings, []
        result = compute()
        self.tape.roundings = kept
        parts = list(result) if isinstance(result, list) else [result]
        total = _length(parts) + sum(upper(x) if isinstance(x, arb) else x for x in sizes)
        moved = self.tape.rounded(parts, total * (1 + 1e-12))  # roundings of roundings
        return moved if isinstance(result, list) else moved[0]

    def sqrt(self, x: Number) -> Number:
        return x.sqrt()

    def plus(self, a: Vector, b: Vector) -> Vector:
        return self._rounded(lambda: super(Balls, self).plus(a, b))

    def minus(self, a: Vector, b: Vector) -> Vector:
        return self._rounded(lambda: super(Balls, self).minus(a, b))

    def times(self, a: Vector, s: Any) -> Vector:
        if not isinstance(s, Number):
            return super().times(a, s)  # by a power of two
        return self._rounded(lambda: super(Balls, self).times(a, s))

    def dot(self, a: Vector, b: Vector) -> Any:
        # the products are rounded, and the sum of the first two: each at most the product of the lengths together
        return self._rounded(lambda: super(Balls, self).dot(a, b), 2 * _length(a) * _length(b))

    def one_and_square(self, a: Vector) -> Any:
        square = _length(a) ** 2
        return self._rounded(lambda: super(Balls, self).one_and_square(a), square, 2 * (1 + square))

    def cross(self, a: Vector, b: Vector) -> Vector:
        return self._rounded(lambda: super(Balls, self).cross(a, b), CROSS * _length(a) * _length(b))

    def itself_and_cross(self, a: Vector, b: Vector) -> Vector:
        product = _length(a) * _length(b)
        return self._rounded(
            lambda: super(Balls, self).itself_and_cross(a, b), CROSS * product, _length(b) + product
        )

    def known(self, x: Any, value: Any) -> Any:
        """Return numbers whose exact values a formula encloses closer than the operations do."""
        if isinstance(x, list):
            return [self.known(part, v) for part, v in zip(x, value, strict=True)]
        closer = (value + arb(0, x.off)).intersection(x.value)
        return replace(x, value=closer)

    def off(self, x: Any, size: float) -> Any:
        """Return a number that is off by so many u."""
        return self.tape.rounded([x], size)[0]

    def less(self, a: Any, b: Any, difference: Any) -> Condition:
        """Compare numbers by what is known of a - b without roundings, and how far these move it."""
        found = difference + arb(0, (a.off + b.off) * ROOM)
        holds = True if found < 0 else False if found > 0 else None
        return Condition(self.tape, holds, (a.index, b.index))

    def where(self, condition: Any, yes: Callable[[], Vector], no: Vector) -> Vector:
        return yes() if condition else no


def _length(a: Vector) -> float:
    return upper(sum((x.value.abs_upper() * x.value.abs_upper() for x in a), arb(0)).sqrt())


def solve_axis(on: Floats, u: Vector, v: Vector, S: Any, C: Any, exact: dict[str, Any]) -> tuple[Any, ...]:
    """Return both axes that turn u into v, where two are found, and what that depends on.

    S and C are the sine and the cosine of half the angle, with the sign of the sine taken out of both. The scales of
    the kernel are powers of two, and leave all results as they are.
    """
    difference = on.known(on.minus(v, u), exact.get("difference"))
    total = on.known(on.plus(u, v), exact.get("total"))
    length_squared, length_prime_squared = on.dot(u, u), on.dot(v, v)
    length_product = on.sqrt(length_prime_squared * length_squared)
    gain = on.known(on.dot(difference, total), exact.get("gain"))
    excess = on.known(gain * (1.0 / (length_prime_squared + length_product)), exact.get("excess"))
    x = on.times(v, excess)
    m = on.known(on.minus(total, x), exact.get("m"))
    r = on.known(on.minus(difference, x), exact.get("r"))
    m_squared, r_squared = on.known(on.dot(m, m), exact.get("m_squared")), on.dot(r, r)
    along_m = m_squared * (S * S)
    n = on.times(r, C)
    root_squared = on.known(along_m - on.dot(n, n), exact.get("root_squared"))
    w = on.known(on.cross(m, r), exact.get("w"))
    area_squared = on.dot(w, w)
    root = on.sqrt(root_squared)
    inverse = 1.0 / (S * m_squared)
    base = on.known(on.times(w, inverse * C), exact.get("base"))
    offset = on.known(on.times(m, inverse * root), exact.get("offset"))
    axes = [
        on.known(on.plus(base, offset), exact.get("plus")),
        on.known(on.minus(base, offset), exact.get("minus")),
    ]
    # nothing is lost if m and r are perpendicular: the exact difference is 32 eps |m|² |r|²
    crooked = on.less(area_squared, m_squared * r_squared * (1.0 - 32.0 * EPS), exact.get("straightness"))
    one = exact.get("one")
    axes = [
        on.where(crooked, lambda a=a: on.times(a, 1.0 / on.sqrt(on.known(on.dot(a, a), one))), a)
        for a in axes
    ]
    return axes, m_squared, r_squared, root_squared, area_squared


def solve_axis_usual(on: Floats, u: Vector, v: Vector, T: Any, exact: dict[str, Any]) -> tuple[Any, ...]:
    """Return the axes as the kernel's program for usual inputs finds them; T is the tangent of half the angle.

    Its correction of the lengths is x = s + s³ of the series s + s³ + 2 s⁵ + ...; s is at most 2⁻¹² there, so what is
    left out counts as a rounding.
    """
    difference = on.known(on.minus(v, u), exact.get("difference"))
    total = on.known(on.plus(u, v), exact.get("total"))
    length_squared = on.dot(u, u)
    gain = on.known(on.dot(difference, total), exact.get("gain"))
    s = gain / (2.0 * gain + 4.0 * length_squared)
    x = on.known(on.off(s * (s * s + 1.0), 2.1 * 2.0**-60 / U), exact.get("x"))
    m = on.known(on.minus(total, on.times(difference, x)), exact.get("m"))
    r = on.known(on.minus(difference, on.times(total, x)), exact.get("r"))
    m_squared = on.known(on.dot(m, m), exact.get("m_squared"))
    along_m = m_squared * (T * T)
    root_squared = on.known(along_m - on.dot(r, r), exact.get("root_squared"))
    w = on.known(on.cross(m, r), exact.get("w"))
    root = on.sqrt(root_squared)
    inverse = 1.0 / (m_squared * T)
    base = on.known(on.times(w, inverse), exact.get("base"))
    offset = on.known(on.times(m, root * abs(inverse)), exact.get("offset"))
    return [on.plus(base, offset), on.minus(base, offset)], root_squared


def rotate(on: Floats, rho: Vector, turn: Vector) -> Vector:
    """Return rho rotated by the Rodrigues vector 2 `turn`."""
    divisor = on.one_and_square(turn)
    inner = on.itself_and_cross(turn, rho)
    x1 = 1.0 / divisor
    return on.plus(rho, on.times(on.times(on.cross(turn, inner), 2.0), x1))


RIGHT = math.nextafter(math.pi / 2, 2)
"""Not below a right angle."""


def axis_box(box: Box, largest: str, usual: bool) -> float:
    """Return the largest error of an axis over cond eps, by the program for usual inputs or by that for all.

    Half the angle between the points is a, half the angle of the rotation h = a + g, and k what h lacks of a right
    angle, which is a + g + k. The box is of the two of these that are not the largest.
    """
    (x_low, x_high), (y_low, y_high) = box
    if RIGHT - x_low - y_low < max(x_low, y_low):
        return 0.0  # the third is not the largest anywhere in the box
    x, y = ball(x_low, x_high), ball(y_low, y_high)
    both = (x + y).sin_cos()
    # nothing small is a difference: sin g and sin(h + a), and sine and cosine of a and h
    if largest == "a":
        g, k = x, y
        (sin_a, cos_a), (cos_h, sin_h), sin_g, sin_sum = both[::-1], k.sin_cos(), g.sin(), (2 * k + g).sin()
    elif largest == "g":
        a, k = x, y
        (sin_a, cos_a), (cos_h, sin_h), sin_g, sin_sum = a.sin_cos(), k.sin_cos(), both[1], (a - k).cos()
    else:
        a, g = x, y
        (sin_a, cos_a), (sin_h, cos_h), sin_g, sin_sum = a.sin_cos(), both, g.sin(), (2 * a + g).sin()
    divisors = (cos_a, sin_h, sin_g, sin_sum, *([sin_a, cos_h] if usual else []))
    if not all(x > 0 for x in divisors):
        raise UndecidedError
    under = sin_g * sin_sum
    # relative difference of the lengths
    e = arb(0, min(5e-4, 0.51 * float((sin_a * cos_a).abs_upper()))) if usual else arb(0, 1e-3)
    zero, one = arb(0), arb(1)
    longer = 2 * (1 + e) / (2 + e) if usual else one
    up, across = cos_h * sin_a / (sin_h * cos_a), under.sqrt() / (sin_h * cos_a)
    exact = {
        "difference": [e * cos_a, (2 + e) * sin_a, zero],
        "total": [(2 + e) * cos_a, e * sin_a, zero],
        "gain": 2 * e + e * e,
        "excess": e / (1 + e),
        "x": e / (2 + e),
        "m": [2 * longer * cos_a, zero, zero],
        "r": [zero, 2 * longer * sin_a, zero],
        "m_squared": 4 * longer * longer * cos_a * cos_a,
        "root_squared": 4 * longer * longer * under / (cos_h * cos_h if usual else one),
        "w": [zero, zero, 4 * longer * longer * sin_a * cos_a],
        "straightness": 32 * EPS * 16 * sin_a * sin_a * cos_a * cos_a,
        "base": [zero, zero, up],
        "offset": [across, zero, zero],
        "one": one,
        "plus": [across, zero, up],
        "minus": [-across, zero, up],
    }

    def program(tape: Tape) -> float:
        u = [tape.input(x) for x in (cos_a, -sin_a, zero)]
        v = [tape.input((1 + e) * x) for x in (cos_a, sin_a, zero)]
        if usual:
            T = tape.number(lambda: sin_h / cos_h, ulps=FUNCTION_ULPS)
            axes, root_squared = solve_axis_usual(Balls(tape), u, v, T, exact)
            return max(bounds(tape, axes))
        S, C = (tape.number(lambda x=x: x, ulps=FUNCTION_ULPS) for x in (sin_h, cos_h))
        axes, m_squared, r_squared, root_squared, area_squared = solve_axis(Balls(tape), u, v, S, C, exact)
        # the conditions for two axes, for turns to both sides
        band = 8 * EPS * S.value * (1 + arb.pi()) * abs(C.value) * (1 + arb(0, 1e-9))
        plane = area_squared.value > m_squared.value * r_squared.value / 2 and area_squared.value > EPS**4
        if not (root_squared.value > band and (plane or m_squared.value > r_squared.value)):
            raise UndecidedError
        return max(bounds(tape, axes))

    return max(paths(program)) * upper(2 * under.sqrt())


def rotate_box(box: Box) -> float:
    """Return the largest error of a rotated vector over eps times its length.

    The box is of half the length of the Rodrigues vector and its angle with the vector that is rotated.
    """
    size, angle = (ball(*side) for side in box)
    tape = Tape()
    sine, cosine = angle.sin_cos()
    rho = [tape.input(x) for x in (cosine, sine, arb(0))]
    turn = [tape.input(x) for x in (size, arb(0), arb(0))]
    return bounds(tape, [rotate(Balls(tape), rho, turn)])[0]
