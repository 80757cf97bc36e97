"""Motions of a machine's parts, what gravity does to them, and how readings compare, over any algebra.

`derivation/machine_model.py` proves these functions, in letters of SymPy; the models of machines are built with the
same functions, on a tape or with SymPy. So what is proved is what runs. Each docstring names the entries of its proof.

Vectors are columns (3, 1): they are added, subtracted and multiplied by numbers. A turn is the pair of the cosine and
the sine of an angle. All that turns or moves is given in one frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, Protocol, TypeAlias

Vector: TypeAlias = Any
"""A column of three values."""
Turn: TypeAlias = tuple[Any, Any]
"""Cosine and sine of an angle."""

SERIES_BELOW = Fraction(1, 4)
"""Squared angle below which sin(x)/x and (1 - cos x)/x² are series: eight terms leave 4e-20 there (series-bound)."""
TERMS = 8
"""Of these series."""
TANGENT_TO = Fraction(87, 1000)
"""Cosine of the zenith angle, 85°, up to which the air lifts by the tangent, which is infinite at the horizon."""

LEGENDRE: Mapping[int, Callable[[Any], Any]] = {
    1: lambda x: x,
    2: lambda x: (3 * x**2 - 1) / 2,
    3: lambda x: (5 * x**3 - 3 * x) / 2,
    4: lambda x: (35 * x**4 - 30 * x**2 + 3) / 8,
}
"""Legendre polynomials by degree (legendre)."""


class Algebra(Protocol):
    """What the functions compute with."""

    @property
    def matrix(self) -> Any:
        """Makes a matrix, as SymPy's ``Matrix`` does."""

    def dot(self, x: Vector, y: Vector, /) -> Any:
        """Return the scalar product."""

    def cross(self, x: Vector, y: Vector, /) -> Vector:
        """Return the vector product."""

    def sin(self, angle: Any, /) -> Any:
        """Return the sine."""

    def cos(self, angle: Any, /) -> Any:
        """Return the cosine."""

    def sqrt(self, x: Any, /) -> Any:
        """Return the square root."""

    def select(self, condition: Any, x: Any, y: Any, /) -> Any:
        """Return x where a condition holds, else y."""

    def let(self, name: str, value: Any, /) -> Any:
        """Return a value, named."""


def length(a: Algebra, x: Vector) -> Any:
    """Return the length of a vector."""
    return a.sqrt(a.dot(x, x))


# joints ----------------------------------------------------------------------------------------------------------


def turned(a: Algebra, x: Vector, n: Vector, turn: Turn) -> Vector:
    """Turn a vector about a unit vector by Rodrigues' formula (turn-is-eq-1, turn-is-rigid)."""
    cosine, sine = turn
    along = a.let("along", a.dot(n, x) * (1 - cosine))
    return x * cosine + a.cross(n, x) * sine + n * along


def back(turn: Turn) -> Turn:
    """Return the opposite turn (joint-backwards)."""
    return turn[0], -turn[1]


def turned_about(a: Algebra, x: Vector, n: Vector, point: Vector, turn: Turn) -> Vector:
    """Turn a point about the axis through another point: what a rotary joint does (axis-stays, by-reading)."""
    return turned(a, a.let("arm", x - point), n, turn) + point


def slid(x: Vector, n: Vector, q: Any) -> Vector:
    """Move a point along a unit vector: what a linear joint does (slide-is-rigid, by-slide)."""
    return x + n * q


# error motions ---------------------------------------------------------------------------------------------------


class Quotients(NamedTuple):
    """An angle with its square, for quotients that are smooth at zero."""

    square: Any
    is_small: Any
    safe: Any
    """The square, or 1 where it is small."""
    angle: Any
    """Root of that."""

    def sine(self, a: Algebra) -> Any:
        """Return sin φ/φ (quotients, series-S)."""
        small, large = series(self.square, 1), a.sin(self.angle) / self.angle
        return a.let("by_sine", a.select(self.is_small, small, large))

    def cosine(self, a: Algebra) -> Any:
        """Return (1 - cos φ)/φ² (quotients, series-K)."""
        small, large = series(self.square, 2), (1 - a.cos(self.angle)) / self.safe
        return a.let("by_cosine", a.select(self.is_small, small, large))


def quotients(a: Algebra, square: Any) -> Quotients:
    """Return the quotients of an angle whose square is given."""
    is_small = square < SERIES_BELOW
    safe = a.let("safe", a.select(is_small, 1, square))
    return Quotients(square, is_small, safe, a.let("angle", a.sqrt(safe)))


def series(square: Any, first: int) -> Any:
    """Return the sum of (-1)^k square^k / (2k + first)! by Horner's rule (series-S, series-K, series-T)."""
    value = 0
    for k in reversed(range(TERMS)):
        value = Fraction((-1) ** k, math.factorial(2 * k + first)) + square * value
    return value


def change_by_quotients(a: Algebra, x: Vector, w: Vector, by_sine: Any, by_cosine: Any) -> Vector:
    """Return what a turn by a rotation vector adds to a vector, by the two quotients (vector-is-eq-1)."""
    across = a.let("across", a.cross(w, x))
    return by_sine * across + by_cosine * a.cross(w, across)


def change_by_vector(a: Algebra, x: Vector, w: Vector) -> Vector:
    """Return what a turn by a rotation vector adds to a vector, smooth at zero (vector-is-eq-1, quotients)."""
    w = a.let("turn", w)
    angle = quotients(a, a.let("square", a.dot(w, w)))
    return change_by_quotients(a, x, w, angle.sine(a), angle.cosine(a))


def turned_by_vector(a: Algebra, x: Vector, w: Vector) -> Vector:
    """Turn a vector by a rotation vector, exactly (vector-is-eq-1)."""
    return x + change_by_vector(a, x, w)


def moved(a: Algebra, x: Vector, pivot: Vector, t: Vector, w: Vector) -> Vector:
    """Move a point by an error motion: turn it by a rotation vector about a pivot, and shift it (by-error-motion)."""
    return turned_by_vector(a, a.let("arm", x - pivot), w) + pivot + t


def moved_back(a: Algebra, x: Vector, pivot: Vector, t: Vector, w: Vector) -> Vector:
    """Move a point back: the opposite of :func:`moved` (error-backwards)."""
    x, w = x - t, -w
    return turned_by_vector(a, a.let("arm", x - pivot), w) + pivot


def turned_a_little(a: Algebra, x: Vector, w: Vector) -> Vector:
    """Turn a vector by a rotation vector that is zero: of it there is the derivative alone (at-zero, by-frame)."""
    return x + a.cross(w, x)


# gravity ---------------------------------------------------------------------------------------------------------


def moment(a: Algebra, arm: Vector, gravity: Vector) -> Vector:
    """Return the moment of a unit force along gravity at the end of an arm (moment-in-the-pose)."""
    return a.let("moment", a.cross(a.let("arm", arm), gravity))


def moment_rate(a: Algebra, n: Vector, gravity: Vector) -> Vector:
    """Return by how much the moment about an axis grows with the place of a unit force (moment-about-the-axis)."""
    return a.let("rate", a.cross(gravity, n))


def moment_about(a: Algebra, rate: Vector, arm: Vector) -> Any:
    """Return the moment about an axis, by its rate (moment-about-the-axis)."""
    return a.let("about_axis", a.dot(rate, arm))


def moment_turned(a: Algebra, n: Vector, rate: Vector, arm: Vector) -> Any:
    """Return the same after a quarter turn of the arm; what is along the axis has no moment (moment-turned)."""
    return a.dot(a.cross(rate, n), arm)


def across(x: Vector, n: Vector, along: Any) -> Vector:
    """Return the part of a vector across a unit vector, given that along it (moment-across)."""
    return x - n * along


class Link(NamedTuple):
    """A joint on the way outwards: how it moves, and where it and the next one are."""

    axis: Vector
    turn: Turn | None
    """By its coordinate; None of a linear joint."""
    coordinate: Any
    point: Vector
    after: Vector
    """Point of the next joint."""


def moments_of_weights(a: Algebra, n: Vector, rate: Vector, links: Sequence[Link]) -> list[Any]:
    """Return the moments about an axis of unit forces along gravity at the points of later joints (weights).

    The last number is that at the first of these points after a quarter turn of its arm: of the joint's own link, which
    may be heavy off that line (weight-of-the-own-link). The moment n · ((x - P) × g) of a force at x grows by g × n as
    x moves. Where joints turn x, this rate is turned back, so that one vector goes from joint to joint outwards,
    instead of every point inwards.

    Parameters
    ----------
    a : Algebra
    n : Vector
        The axis of the first link.
    rate : Vector
        As :func:`moment_rate`.
    links : sequence of Link
        From the joint itself outwards.
    """
    moments: list[Any] = []
    total, off_the_line = 0, 0
    for k, link in enumerate(links):
        if link.turn is not None:
            rate = a.let("rate", turned(a, rate, link.axis, back(link.turn)))
        else:
            total = total + a.dot(rate, link.axis) * link.coordinate
        arm = link.after - link.point
        if k == 0:
            off_the_line = a.let("moment", moment_turned(a, n, rate, arm))
        total = a.let("moment", total + a.dot(rate, arm))
        moments.append(total)
    return [*moments, off_the_line]


def shaft_bend(a: Algebra, n: Vector, gravity: Vector) -> Vector:
    """Return the rotation vector by which a shaft along an axis sinks, per unit of its slope (flexures)."""
    return a.cross(n, gravity)


def fork_bend(a: Algebra, n: Vector, before: Vector, gravity: Vector) -> Any:
    """Return the part along an axis by which a fork sinks that stands upwards on the axis before (flexures)."""
    part = a.let("moment", a.dot(n, a.cross(before, gravity)))
    return a.select(a.dot(before, gravity) > 0, -part, part)


def sag_turn(a: Algebra, n: Vector, gravity: Vector, slope: Any) -> Vector:
    """Return the rotation vector of a beam along an axis that sags with a slope (sag-turns-down)."""
    return a.let("turn", shaft_bend(a, n, gravity) * slope)


def sag_shift(a: Algebra, arm: Vector, gravity: Vector, drop: Any, w: Vector) -> Vector:
    """Return the translation of a beam's error motion: its load, at the end of an arm, drops along gravity (sag)."""
    return gravity * drop - change_by_vector(a, arm, w)


# directions ------------------------------------------------------------------------------------------------------


def air_depth(a: Algebra, cosine: Any) -> Any:
    """Return 1 over the tangent of the zenith angle per sine, finite at the horizon (finite-lift)."""
    low = TANGENT_TO
    return a.let("depth", a.select(cosine > low, cosine, (low**2 + cosine**2) / (2 * low)))


def lifted(a: Algebra, x: Vector, up: Vector, cosine: Any, f: Any) -> Vector:
    """Lift a direction towards the zenith by f times the sine of its zenith angle (lift).

    Parameters
    ----------
    a : Algebra
    x, up : Vector
        Unit vectors.
    cosine : value
        Of the zenith angle.
    f : value
        In rad; of refraction the coefficient over :func:`air_depth` (by-refraction).
    """
    angle = quotients(a, a.let("square", f**2 * (1 - cosine**2)))
    by_sine = angle.sine(a)
    small = 1 - angle.square * series(angle.square, 2)
    turn = a.let("cosine", a.select(angle.is_small, small, a.cos(angle.angle)))
    return a.let("lifted", x * turn + (up - x * cosine) * (f * by_sine))


def stereographic(a: Algebra, measured: Vector, seen: Vector) -> Callable[[Vector], Any]:
    """Return the residual of a direction, as a function of a unit vector across the measured one (residual)."""
    factor = a.let("stereographic", -2 / (1 + a.dot(measured, seen)))
    return lambda across: a.dot(across, seen) * factor


# attitudes -------------------------------------------------------------------------------------------------------


def quaternion_between(a: Algebra, axes: Sequence[Vector], goal: Sequence[Vector]) -> tuple[Vector, Any]:
    """Return vector and scalar of a quaternion, 4 cos h long, that turns axes by 2h to others (attitude-residual)."""
    vector, scalar = a.matrix.zeros(3, 1), 1
    for m, r in zip(axes, goal, strict=True):
        vector = vector + a.cross(m, r)
        scalar = scalar + a.dot(m, r)
    return vector, scalar


def rodrigues_between(a: Algebra, axes: Sequence[Vector], goal: Sequence[Vector]) -> Vector:
    """Return the Rodrigues vector that turns axes of a body to those that were read (attitude-residual)."""
    vector, scalar = quaternion_between(a, axes, goal)
    return vector * a.let("rodrigues", 2 / scalar)


def half_twist(a: Algebra, line: Vector, unit: Sequence[Vector], axes: Sequence[Vector]) -> tuple[Any, Any]:
    """Return numbers as sine and cosine of half the twist of a body about a line (angle-residual, half-twist).

    With a unit quaternion (w, v) of the rotation the twist φ about e has tan(φ/2) = v·e / w, and w and v are as
    1 + Σ e_i·m_i and Σ e_i × m_i, with the axes m of the body that were the machine's e_i at zero. Beyond a quarter
    turn, where both may vanish, v·e and w are as 1 - Σ e_i·m_i + 2 e·M e and (Σ e_i × m_i)·e, M the matrix of m.
    """
    vector, scalar = quaternion_between(a, unit, axes)
    moved = axes[0] * line[0] + axes[1] * line[1] + axes[2] * line[2]
    both, cosine = a.let("both_half", a.dot(vector, line)), a.let("along_half", scalar)
    sine = a.let("across_half", 2 - scalar + 2 * a.dot(line, moved))
    is_near = sine < cosine
    return (
        a.let("sine_half", a.select(is_near, both, sine)),
        a.let("cosine_half", a.select(is_near, cosine, both)),
    )


def half_tilt(a: Algebra, up: Vector, x: Vector) -> tuple[Any, Any]:
    """Return numbers as sine and cosine of half the angle of a line over the horizon (inclination)."""
    level = length(a, a.cross(up, x))
    return a.let("sine_half", a.dot(up, x)), a.let("cosine_half", 1 + level)


def angle_between(cosine: Any, sine: Any, c: Any, s: Any) -> Any:
    """Return 2 tan of the difference of two half angles: of that with c and s, less the first (angle-residual)."""
    return 2 * (s * cosine - c * sine) / (c * cosine + s * sine)
