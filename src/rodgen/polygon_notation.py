"""The X-Y-Z notation of spherical polygons: what each name stands for, and when two of them are equal.

The closed spherical n-gon with the twists α₁₂, α₂₃, …, αₙ₁ and the joint angles θ₁, …, θₙ is the product

    Rz(θ₁) Rx(α₁₂) Rz(θ₂) Rx(α₂₃) … Rz(θₙ) Rx(αₙ₁) = I.

Every name is an entry of a product of neighbouring factors, up to sign. Two entries are equal on all closed polygons by
three rules: what Rx leaves of its own axis x and Rz of z; the factors that a product lacks are its inverse; an inverse
is transposed. That gives each entry one shortest form, so a law is proved by comparing two of them, without expanding
anything. The rules hold for dual angles as well, so each law so proved has a secondary law.

This is of the lowest floor, but it needs no SymPy, so that numeric functions can use it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, TypeAlias

Angle: TypeAlias = tuple[Literal["alpha", "theta"], int]
"""An angle of the polygon: ``("alpha", i)`` is the twist from joint i to the next one, ``("theta", j)`` the joint's."""

_POLAR = "UVW"
_X, _Y, _Z = range(3)


@dataclass(frozen=True)
class Entry:
    """An entry, up to sign, of the product of `length` neighbouring factors of a closed n-gon.

    Attributes
    ----------
    n : int
        Number of joints.
    sign : int
        1 or -1.
    row, column : int
        Which entry, 0 to 2.
    start, length : int
        The first factor, and how many. Factor 2 j - 2 is Rz(θⱼ), factor 2 j - 1 is Rx of the twist after it.
    """

    n: int
    sign: int
    row: int
    start: int
    length: int
    column: int

    def reduced(self) -> Entry:
        """Drop the factors at both ends that leave the row or the column as it is."""
        row, start, length, column = self.row, self.start, self.length, self.column
        while length and row == _axis(start):
            start, length = (start + 1) % (2 * self.n), length - 1
        while length and column == _axis(start + length - 1):
            length -= 1
        return Entry(self.n, self.sign, row, start, length, column)

    def complement(self) -> Entry:
        """Write the entry with the factors that it lacks: the product of the two is I."""
        start = (self.start + self.length) % (2 * self.n)
        return Entry(self.n, self.sign, self.column, start, 2 * self.n - self.length, self.row)

    def canonical(self) -> Entry:
        """Return the shortest entry that is equal on every closed polygon."""
        both = self.reduced(), self.complement().reduced()
        return min(both, key=lambda e: (e.length, e.start, e.row, e.column))


@dataclass(frozen=True)
class Term:
    """A name of the notation in a closed n-gon (or in an open chain of n joints).

    Raises
    ------
    ValueError
        For a letter or subscripts that mean nothing.
    """

    letter: str
    """X, Y or Z, or of the polar polygon U, V or W."""
    subscripts: tuple[int, ...]
    """Neighbouring joints, 1 to n, that rise or fall by one, with n and 1 as neighbours."""
    n: int
    """Number of joints."""
    bar: bool = False
    """Whether a single X, Y or Z has a bar. Two and more subscripts tell by their order."""
    star: bool = False
    """Whether it is X* or U*, with a sine for each cosine of the last rotation."""

    def __post_init__(self) -> None:
        """Refuse what means nothing."""
        numbers, name = self.subscripts, "".join(map(str, self.subscripts))
        if self.letter not in ("X", "Y", "Z", "U", "V", "W"):
            raise ValueError(f"{self.letter} is not a name of the notation: expected X, Y, Z, U, V or W")
        if self.star and self.letter not in "XU":
            raise ValueError(f"{self.letter} has no star: only X and U have")
        least, most = (2, self.n - 1) if self.polar else (1, self.n - 2)
        if not least <= len(numbers) <= most or not set(numbers) <= set(range(1, self.n + 1)):
            raise ValueError(
                f"{self.letter} in a polygon of {self.n} has {least} to {most} subscripts from 1 to {self.n}, not "
                f"{name or 'none'}"
            )
        if self.bar and (self.polar or len(numbers) > 1):
            raise ValueError(f"{self.letter}_{name} has no bar: only a single X, Y or Z has")
        steps = {(b - a) % self.n for a, b in pairwise(numbers)}
        if len(steps) > 1 or not steps <= {1, self.n - 1}:
            raise ValueError(f"the subscripts {name} neither rise nor fall by one from each to the next")

    @property
    def polar(self) -> bool:
        """Whether it is one of U, V, W."""
        return self.letter in _POLAR

    @property
    def falling(self) -> bool:
        """Whether the subscripts fall, as a single one with a bar is taken to do."""
        if len(self.subscripts) == 1:
            return self.bar
        return (self.subscripts[1] - self.subscripts[0]) % self.n == self.n - 1

    def angles(self) -> tuple[Angle, ...]:
        """Angles in the order of the recursion, the near one first: see :func:`chain_value`."""
        back = 1 if self.falling else 0  # a joint lies between the twists j - 1 and j
        thetas: list[Angle] = [("theta", j) for j in self.subscripts]
        if self.polar:
            twists: list[Angle] = [("alpha", (j - 1 - back) % self.n + 1) for j in self.subscripts[:-1]]
            outer, inner = thetas, twists
        else:
            near = (self.subscripts[0] - 2 + back) % self.n + 1
            far = [("alpha", (j - 1 - back) % self.n + 1) for j in self.subscripts]
            outer, inner = [("alpha", near), *far], thetas  # type: ignore[list-item]
        woven = [angle for pair in zip(outer, inner, strict=False) for angle in pair]
        return (*woven, outer[-1])

    def value(self, angles: Mapping[Angle, tuple[Any, Any]]) -> Any:
        """Evaluate with the cosine and the sine of each angle, numbers of any kind."""
        x, star, y, z = chain_value([angles[angle] for angle in self.angles()])
        return star if self.star else {"X": x, "Y": y, "Z": z}[self._letter]

    @property
    def _letter(self) -> str:
        return "XYZ"[_POLAR.index(self.letter)] if self.polar else self.letter

    def entry(self) -> Entry:
        """Return the entry of a product that the name stands for."""
        joints = len(self.subscripts)
        low = self.subscripts[-1] if self.falling else self.subscripts[0]
        if self.polar:
            fixed, start, length = _X, 2 * low - 2, 2 * joints - 1
        else:
            fixed, start, length = _Z, 2 * low - 3, 2 * joints + 1
        if self._letter == "X":  # it does without the last factor
            moving, length = _Y if self.star else _X + _Z - fixed, length - 1
            start += self.falling
        else:
            moving = _Y if self._letter == "Y" else fixed
        sign = -1 if moving == _Y and self.falling == self.polar else 1
        row, column = (moving, fixed) if self.falling else (fixed, moving)
        return Entry(self.n, sign, row, start % (2 * self.n), length, column)

    def text(self) -> str:
        """Write it in plain characters: ``Xb_2`` with a bar, ``X*_21`` with a star."""
        mark = "b" * self.bar + "*" * self.star
        return f"{self.letter}{mark}_{''.join(map(str, self.subscripts))}"

    def latex(self) -> str:
        """Write it in LaTeX."""
        letter = (rf"\bar{{{self.letter}}}" if self.bar else self.letter) + "^*" * self.star
        return f"{letter}_{{{''.join(map(str, self.subscripts))}}}"


@dataclass(frozen=True)
class Monomial:
    """A cosine or a sine, or the product of two for an angle and the next one, as on the right side of a law."""

    factors: tuple[tuple[str, Angle], ...]
    """``"c"`` or ``"s"`` with the angle; the twist before the joint's angle."""
    n: int
    """Number of joints."""

    def value(self, angles: Mapping[Angle, tuple[Any, Any]]) -> Any:
        """Evaluate with the cosine and the sine of each angle, numbers of any kind."""
        first, *rest = (angles[angle]["cs".index(which)] for which, angle in self.factors)
        return first * rest[0] if rest else first

    def entry(self) -> Entry:
        """Return the entry of a product that it stands for."""
        if len(self.factors) == 1:
            ((_, (kind, number)),) = self.factors  # a cosine
            polar = kind == "theta"
            return Entry(self.n, 1, _X if polar else _Z, 2 * number - 1 - polar, 1, _X if polar else _Z)
        (twist, (_, i)), (turn, (_, j)) = self.factors
        before = j == i % self.n + 1  # the twist comes before the joint
        start = 2 * i - 1 if before else 2 * j - 2
        ends = _Y if twist == "c" else _Z, _Y if turn == "c" else _X
        sign = 1 if before or ends == (_Z, _X) else -1
        row, column = ends if before else ends[::-1]
        return Entry(self.n, sign, row, start, 2, column)

    def text(self) -> str:
        """Write it in plain characters: ``s71 c1``."""
        return " ".join(which + self._subscript(angle) for which, angle in self.factors)

    def latex(self) -> str:
        """Write it in LaTeX."""
        return " ".join(f"{which}_{{{self._subscript(angle)}}}" for which, angle in self.factors)

    def _subscript(self, angle: Angle) -> str:
        kind, number = angle
        return f"{number}{number % self.n + 1}" if kind == "alpha" else str(number)


Name: TypeAlias = Term | Monomial


def chain_value(angles: Sequence[tuple[Any, Any]]) -> tuple[Any, Any, Any, Any]:
    """Evaluate X, X*, Y, Z of a chain of angles: near twist, joint, twist, joint, …, far twist.

    For U, U*, V, W joints and twists change places: near joint, twist, joint, …, far joint.

    Parameters
    ----------
    angles : sequence of (cosine, sine)
        An odd number of them, three and more, of any kind of number.

    Returns
    -------
    tuple
        X, X*, Y and Z (or U, U*, V and W). X and X* do without the last angle.

    Examples
    --------
    >>> import sympy as sp
    >>> a, t, b = sp.symbols("a t b", real=True)
    >>> x, _, y, z = chain_value([(sp.cos(angle), sp.sin(angle)) for angle in (a, t, b)])
    >>> x, z
    (sin(a)*sin(t), -sin(a)*sin(b)*cos(t) + cos(a)*cos(b))
    """
    (z, near), *rest = angles
    if not rest or len(rest) % 2:
        raise ValueError(f"a chain has an odd number of angles, three and more, not {len(angles)}")
    c, s = rest[0]
    x, star, y = near * s, -near * c, None
    for step in range(0, len(rest), 2):
        if step:
            c, s = rest[step]
            x, star = x * c - y * s, x * s + y * c
        ce, se = rest[step + 1]
        y, z = star * ce - z * se, star * se + z * ce
    return x, star, y, z


def _axis(factor: int) -> int:
    return _X if factor % 2 else _Z
