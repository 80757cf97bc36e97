"""Closed spherical polygons and spatial loops with many digits, or exact, from rotation matrices alone."""

from __future__ import annotations

import random
from fractions import Fraction
from math import isqrt
from typing import Any

import mpmath


def rotate_x(c: Any, s: Any) -> list[list[Any]]:
    """Rotation about x from the angle's cosine and sine, of any kind of number."""
    return [[1, 0, 0], [0, c, -s], [0, s, c]]


def rotate_z(c: Any, s: Any) -> list[list[Any]]:
    """Rotation about z."""
    return [[c, -s, 0], [s, c, 0], [0, 0, 1]]


def product(*matrices: list[list[Any]]) -> list[list[Any]]:
    """Product of 3x3 matrices."""
    found = [[int(i == j) for j in range(3)] for i in range(3)]
    for matrix in matrices:
        found = [[sum(row[k] * matrix[k][j] for k in range(3)) for j in range(3)] for row in found]
    return found


def closing(open_chain: list[list[Any]], sine: Any) -> dict[str, tuple[Any, Any]]:
    """Cosines and sines of θ₁, of the last twist and of the last joint angle, given that twist's sine.

    The open chain is Rx(α₁₂) Rz(θ₂) … Rx(αₙ₋₁,ₙ) = (Rz(θₙ) Rx(αₙ₁) Rz(θ₁))ᵀ.
    """
    m = open_chain
    first = m[1][2] / sine, m[0][2] / sine
    last_twist = m[2][2], sine
    rest = product(rotate_x(*last_twist), rotate_z(*first), m)  # Rz(θₙ) transposed
    return {"theta_1": first, "alpha_n": last_twist, "theta_n": (rest[0][0], rest[0][1])}


def many_digits(n: int, seed: int) -> dict[tuple[str, int], tuple[Any, Any]]:
    """Cosine and sine of each angle of a closed polygon, in the precision of mpmath; twists of either sign."""
    rng = random.Random(seed)
    angles = {}
    for kind, count in (("alpha", n - 1), ("theta", n)):
        for number in range(1, count + 1):
            angle = mpmath.mpf(rng.uniform(0.3, 2.8) * rng.choice([-1, 1]))
            angles[kind, number] = mpmath.cos(angle), mpmath.sin(angle)
    chain = _chain(n, angles)
    sine = rng.choice([-1, 1]) * mpmath.sqrt(1 - chain[2][2] ** 2)
    return _closed(n, angles, chain, sine)


def _chain(n: int, angles: dict[tuple[str, int], tuple[Any, Any]]) -> list[list[Any]]:
    factors = [rotate_x(*angles["alpha", 1])]
    for j in range(2, n):
        factors += [rotate_z(*angles["theta", j]), rotate_x(*angles["alpha", j])]
    return product(*factors)


def _closed(n: int, angles: dict, chain: list[list[Any]], sine: Any) -> dict:
    found = closing(chain, sine)
    angles.update(
        {("alpha", n): found["alpha_n"], ("theta", 1): found["theta_1"], ("theta", n): found["theta_n"]}
    )
    return angles


class Root:
    """a + b √d with rational a and b: numbers in which a polygon with rational chain closes exactly."""

    def __init__(self, a: Any, b: Any, d: Fraction) -> None:
        self.a, self.b, self.d = Fraction(a), Fraction(b), d

    def _other(self, other: Any) -> Root:
        return other if isinstance(other, Root) else Root(other, 0, self.d)

    def __add__(self, other: Any) -> Root:
        other = self._other(other)
        return Root(self.a + other.a, self.b + other.b, self.d)

    def __mul__(self, other: Any) -> Root:
        other = self._other(other)
        return Root(self.a * other.a + self.b * other.b * self.d, self.a * other.b + self.b * other.a, self.d)

    def __neg__(self) -> Root:
        return Root(-self.a, -self.b, self.d)

    def __sub__(self, other: Any) -> Root:
        return self + -self._other(other)

    def __rsub__(self, other: Any) -> Root:
        return self._other(other) - self

    def __truediv__(self, other: Any) -> Root:
        other = self._other(other)
        norm = other.a**2 - other.b**2 * self.d
        return self * Root(other.a / norm, -other.b / norm, self.d)

    def __rtruediv__(self, other: Any) -> Root:
        return self._other(other) / self

    __radd__ = __add__
    __rmul__ = __mul__

    def __eq__(self, other: object) -> bool:
        other = self._other(other)
        return self.a == other.a and self.b == other.b

    __hash__ = None  # type: ignore[assignment]


def exact(n: int, seed: int) -> dict[tuple[str, int], tuple[Root, Root]]:
    """Cosine and sine of each angle of a closed polygon, exactly, in rational numbers with one square root."""
    rng = random.Random(seed)
    rational = {}
    for kind, count in (("alpha", n - 1), ("theta", n)):
        for number in range(1, count + 1):
            t = Fraction(rng.choice([-1, 1]) * rng.randint(1, 9), rng.randint(2, 9))
            rational[kind, number] = (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)
    chain = _chain(n, rational)
    d = 1 - Fraction(chain[2][2]) ** 2
    assert isqrt(d.numerator * d.denominator) ** 2 != d.numerator * d.denominator, (
        "rational: take another seed"
    )
    angles = {key: (Root(c, 0, d), Root(s, 0, d)) for key, (c, s) in rational.items()}
    return _closed(n, angles, [[Root(x, 0, d) for x in row] for row in chain], Root(0, 1, d))


def frames(n: int, angles: dict[tuple[str, int], tuple[Any, Any]]) -> list[list[list[Any]]]:
    """Frames in the first joint's one: columns a_j,j+1, and S_j third, for j = 1 to n."""
    found, current = [], product(rotate_z(*angles["theta", 1]))
    for j in range(1, n + 1):
        found.append(current)
        if j < n:
            current = product(current, rotate_x(*angles["alpha", j]), rotate_z(*angles["theta", j + 1]))
    return found


class Pair:
    """A dual number a + ε b over any kind of number."""

    def __init__(self, a: Any, b: Any) -> None:
        self.a, self.b = a, b

    def _other(self, other: Any) -> Pair:
        return other if isinstance(other, Pair) else Pair(other, 0)

    def __add__(self, other: Any) -> Pair:
        other = self._other(other)
        return Pair(self.a + other.a, self.b + other.b)

    def __mul__(self, other: Any) -> Pair:
        other = self._other(other)
        return Pair(self.a * other.a, self.a * other.b + self.b * other.a)

    def __neg__(self) -> Pair:
        return Pair(-self.a, -self.b)

    def __sub__(self, other: Any) -> Pair:
        return self + -self._other(other)

    def __rsub__(self, other: Any) -> Pair:
        return self._other(other) - self

    __radd__ = __add__
    __rmul__ = __mul__


def spatial(
    n: int, angles: dict[tuple[str, int], tuple[Any, Any]], seed: int
) -> tuple[dict[tuple[str, int], Any], dict[tuple[str, int], tuple[Pair, Pair]]]:
    """Close a loop in space above a closed polygon: lengths and offsets, and cosine and sine of each dual angle.

    All lengths and all offsets but three are whole numbers; the three are linear in them.
    """
    rng = random.Random(seed)
    lengths: dict[tuple[str, int], Any] = {}
    total: list[Any] = [0, 0, 0]
    all_frames = frames(n, angles)
    for j, frame in enumerate(all_frames, start=1):
        lengths["alpha", j] = rng.randint(-5, 5)
        lengths["theta", j] = rng.randint(-5, 5) if j > 3 else 0
        total = [
            t + lengths["alpha", j] * row[0] + lengths["theta", j] * row[2]
            for t, row in zip(total, frame, strict=True)
        ]
    axes = [[frame[i][2] for i in range(3)] for frame in all_frames[:3]]
    volume = _triple(*axes)
    for j in range(3):
        lengths["theta", j + 1] = -_triple(*(total if k == j else axes[k] for k in range(3))) / volume
    dual = {
        key: (Pair(c, -length * s), Pair(s, length * c))
        for (key, (c, s)), length in ((item, lengths[item[0]]) for item in angles.items())
    }
    return lengths, dual


def _triple(a: list[Any], b: list[Any], c: list[Any]) -> Any:
    cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]]
    return sum((x * y for x, y in zip(a, cross, strict=True)), 0)
