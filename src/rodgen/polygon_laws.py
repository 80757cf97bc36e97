"""The laws of the closed spherical polygons, made and not typed: triangle to heptagon, and any n.

Five families, each with every cyclic shift of its subscripts. With the polygon 1, 2, …, n:

- fundamental: X, Y, Z of all joints but the two that a link joins;
- subsidiary: X, Y, Z of a row of joints by those of the rest;
- polar, and polar subsidiary: the same with twists and joint angles exchanged, in U, V, W;
- half tangent: tan θ₁/2 by a fundamental pair.

In each of the first four the law of X is the sine law, that of Y the sine-cosine law, that of Z the cosine law.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

from rodgen.polygon_notation import Angle, Monomial, Name, Term

POLYGONS = {3: "triangle", 4: "quadrilateral", 5: "pentagon", 6: "hexagon", 7: "heptagon"}
FAMILIES = ("fundamental", "subsidiary", "polar", "polar subsidiary", "half tangent")
_KINDS = {"X": "sine", "Y": "sine-cosine", "Z": "cosine", "U": "sine", "V": "sine-cosine", "W": "cosine"}


@dataclass(frozen=True)
class Law:
    """An equation between two names that holds for every closed polygon: left = sign times right."""

    family: str
    left: Term
    sign: int
    right: Name

    @property
    def kind(self) -> str:
        """Whether it is a sine, a sine-cosine or a cosine law."""
        return _KINDS[self.left.letter]

    def holds(self) -> bool:
        """Tell whether both sides are the same entry of a product, on every closed polygon: a proof."""
        left, right = self.left.entry().canonical(), self.right.entry().canonical()
        return left == replace(right, sign=self.sign * right.sign)

    def text(self) -> str:
        """Write it in plain characters."""
        return f"{self.left.text()} = {'-' if self.sign < 0 else ''}{self.right.text()}"


@dataclass(frozen=True)
class HalfTangent:
    """Tangent of half a joint's angle: x = X / (Y + s) = (s - Y) / X, with X = s sin θ and Y = s cos θ."""

    sine: Law
    sine_cosine: Law
    """The two fundamental laws of one row of subscripts."""

    family = "half tangent"
    kind = "half tangent"

    @property
    def joint(self) -> int:
        """Which joint's angle."""
        return self._factors[1][1][1]

    @property
    def twist(self) -> Angle:
        """The twist whose sine is s."""
        return self._factors[0][1]

    @property
    def _factors(self) -> tuple[tuple[str, Angle], ...]:
        assert isinstance(self.sine.right, Monomial)
        return self.sine.right.factors

    def holds(self) -> bool:
        """Tell whether both laws hold, and are of one angle and one twist: x follows from sin θ and cos θ."""
        twist, turn = ("s", self.twist), ("theta", self.joint)
        pair = (twist, ("s", turn)), (twist, ("c", turn))
        claims = [
            law.right.factors for law in (self.sine, self.sine_cosine) if isinstance(law.right, Monomial)
        ]
        return self.sine.holds() and self.sine_cosine.holds() and tuple(claims) == pair

    def text(self) -> str:
        """Write it in plain characters."""
        s, x, y = self._sine().text(), self.sine.left.text(), self.sine_cosine.left.text()
        return f"x_{self.joint} = {x} / ({y} + {s}) = ({s} - {y}) / {x}"

    def _sine(self) -> Monomial:
        return Monomial((("s", self.twist),), self.sine.left.n)


AnyLaw: TypeAlias = Law | HalfTangent


def laws(n: int, *, shifts: bool = True) -> tuple[AnyLaw, ...]:
    """List the laws of the spherical n-gon.

    Parameters
    ----------
    n : int
        Number of joints, at least 3.
    shifts : bool, optional
        Whether every cyclic shift of the subscripts is listed, or one of each n only.

    Examples
    --------
    >>> for law in laws(4, shifts=False)[:6]:
    ...     print(law.kind, law.text(), sep=": ")
    sine: X_32 = s41 s1
    sine-cosine: Y_32 = s41 c1
    cosine: Z_32 = c41
    sine: X_34 = s12 s1
    sine-cosine: Y_34 = s12 c1
    cosine: Z_34 = c12
    >>> all(law.holds() for law in laws(7))
    True
    """
    if n < 3:
        raise ValueError(f"a spherical polygon has 3 joints and more, not {n}")
    every_law = []
    for make in (_fundamental, _subsidiary, _polar, _polar_subsidiary):
        for shift in range(n if shifts else 1):
            every_law += list(make(n, shift))
    half = [
        HalfTangent(sine, next_sine)
        for sine, next_sine in pairwise(every_law)
        if sine.family == "fundamental" and sine.kind == "sine"
    ]
    return (*every_law, *half)


def _fundamental(n: int, shift: int) -> Iterator[Law]:
    falling = range(n - 1, 1, -1)
    rising = range(3, n + 1)
    for row, twist in ((falling, n), (rising, 1)):
        s, right = ("s", _angle("alpha", twist, n, shift)), _angle("theta", 1, n, shift)
        cosine = Monomial((("c", s[1]),), n)
        for letter, name in zip("XYZ", (*(Monomial((s, (f, right)), n) for f in "sc"), cosine), strict=True):
            yield Law("fundamental", _term(letter, row, n, shift, bar=row is falling), 1, name)


def _subsidiary(n: int, shift: int) -> Iterator[Law]:
    for j in range(2, n - 1):
        falling, rest = range(j, 1, -1), range(j + 2, n + 1)
        yield from _pair("subsidiary", "XYZ", falling, rest, 1, n, shift)
        rising, rest = range(n - j + 2, n + 1), range(n - j, 1, -1)  # its mirror image
        yield from _pair("subsidiary", "XYZ", rising, rest, 1, n, shift)


def _polar(n: int, shift: int) -> Iterator[Law]:
    rising, falling = range(1, n), range(n - 1, 0, -1)
    for row, twist in ((rising, n - 1), (falling, n)):
        joint, angle = ("s", _angle("theta", n, n, shift)), _angle("alpha", twist, n, shift)
        cosine = Monomial((("c", joint[1]),), n)
        for letter, name in zip(
            "UVW", (*(Monomial(((f, angle), joint), n) for f in "sc"), cosine), strict=True
        ):
            yield Law("polar", _term(letter, row, n, shift), 1, name)


def _polar_subsidiary(n: int, shift: int) -> Iterator[Law]:
    for m in range(2, n - 1):
        yield from _pair("polar subsidiary", "UVW", range(1, m + 1), range(n, m, -1), m, n, shift)
        yield from _pair("polar subsidiary", "UVW", range(m, 0, -1), range(m + 1, n + 1), 1, n, shift)


def _pair(family: str, letters: str, row: range, rest: range, last: int, n: int, shift: int) -> Iterator[Law]:
    """Give the three laws of a row of joints and the rest of them, with the joint between as the last half step."""
    near, cross, whole = letters[0], letters[1], letters[2]
    bar = letters == "XYZ" and row.step < 0
    longer = (*rest, last)
    yield Law(family, _term(near, row, n, shift, bar=bar), 1, _term(near, longer, n, shift))
    yield Law(family, _term(cross, row, n, shift, bar=bar), -1, _term(near, longer, n, shift, star=True))
    yield Law(family, _term(whole, row, n, shift, bar=bar), 1, _term(whole, rest, n, shift))


def _term(
    letter: str,
    row: range | tuple[int, ...],
    n: int,
    shift: int,
    *,
    bar: bool = False,
    star: bool = False,
) -> Term:
    subscripts = tuple((j - 1 + shift) % n + 1 for j in row)
    return Term(letter, subscripts, n, bar=bar and len(subscripts) == 1, star=star)


def _angle(kind: str, number: int, n: int, shift: int) -> Angle:
    return ("alpha" if kind == "alpha" else "theta", (number - 1 + shift) % n + 1)
