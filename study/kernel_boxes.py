"""The largest error of a kernel's own program over a box of inputs: conversions of rotations, and the Tricept."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from flint import arb
from rounding import EPS, ROOM, BallFunctions, Box, Number, Tape, ball, body, bounds, paths, upper

from rodgen.generated.numpy import tricept


def direction(largest: int, *ratios: Number) -> list[Any]:
    """Return a rotation's axis whose largest component is 1."""
    found: list[Any] = list(ratios)
    found.insert(largest, ratios[0].tape.input(arb(1)))
    return found


def quaternion(axis: Sequence[Number], t: Number, small: bool) -> list[Number]:
    """Return w, x, y, z, of any length; t is the ratio of the largest component of the axis to w."""
    return [t.tape.input(arb(1)), *(t * x for x in axis)] if small else [1.0 / t, *axis]


def sine_and_cosine(axis: Sequence[Number], t: Number) -> tuple[Number, Number]:
    """Return those of half the rotation's angle."""
    tangent = t * sum((x * x for x in axis), t * 0.0).sqrt()
    cosine = 1.0 / (1.0 + tangent * tangent).sqrt()
    return tangent * cosine, cosine


def rodrigues_vector(axis: Sequence[Number], t: Number, small: bool) -> list[Number]:
    """Return the Rodrigues vector of such a quaternion."""
    return [2.0 * t * x for x in axis]


def axis_angle(axis: Sequence[Number], t: Number, small: bool) -> list[Number]:
    """Return the axis of such a quaternion, of any length, and its angle."""
    length = sum((x * x for x in axis), t * 0.0).sqrt()
    return [*axis, BallFunctions(t.tape).atan2(t * length, 1.0) * 2.0]


def matrix(axis: Sequence[Number], t: Number, small: bool) -> list[Number]:
    """Return the matrix of such a quaternion, row by row."""
    w, *v = quaternion(axis, t, small)
    squares = [x * x for x in (w, *v)]
    double = 2.0 / (squares[0] + squares[1] + squares[2] + squares[3])
    found = []
    for i, j in itertools.product(range(3), repeat=2):
        if i == j:
            found.append(1.0 - double * (squares[(i + 1) % 3 + 1] + squares[(i + 2) % 3 + 1]))
        else:
            turned = w * v[3 - i - j]
            found.append(double * (v[i] * v[j] + (turned if (i - j) % 3 == 1 else -turned)))
    return found


REPRESENTATIONS = {
    "axis_angle": (axis_angle, ((3, "sine"), (1, "1")), 0.0),
    "rodrigues_vector": (rodrigues_vector, ((3, "cosine"),), 0.0),
    "matrix": (matrix, ((1, "1"),) * 9, 4 * EPS),
    "quaternion": (quaternion, ((1, "1"),) * 4, 0.0),
}
"""What gives each, what it consists of (how many numbers, and what their error is multiplied by), and how far a given
one is off a rotation.

It is the error of each number, but of three the length. That of an axis is multiplied by the sine of half the angle,
that of a Rodrigues vector, over its length, by the cosine: the smaller they are, the less is an axis or a length
determined.
"""


def conversion_box(
    name: str, source: str, outputs: tuple[tuple[int, str], ...], module: object, box: Box
) -> float:
    """Return the largest error of a conversion over eps.

    A box of rotations has the number of the axis's largest component, the ratios of the others to it, and its ratio to
    w in the quaternion.
    """
    made, _, within = REPRESENTATIONS[source]

    (largest, _), *sides = box

    def program(tape: Tape) -> float:
        factors = {"1": arb(1)}

        def inputs(b: Number, c: Number, t: Number) -> list[Number]:
            axis = direction(int(largest), b, c)
            sine, cosine = sine_and_cosine(axis, t)
            factors.update(sine=sine.value, cosine=(cosine * cosine / (2.0 * sine)).value)
            return made(axis, t, sides[2][1] <= 1)

        results = iter(body(module, name, tape)(*tape.inputs(sides, inputs, within)))
        parts = [[next(results) for _ in range(count)] for count, _ in outputs]
        weights = [upper(factors[weight]) for _, weight in outputs]
        return max(b * w for b, w in zip(bounds(tape, parts), weights, strict=True))

    return max(paths(program))


def tricept_box(name: str, constants: Sequence[float], angles: int, box: Box) -> float:
    """Return the largest error of a pose, a leg or a coordinate over eps; of a length over the length.

    `angles` is how many angles come first.
    """
    tape = Tape()
    inputs = [*(tape.input(ball(*side)) for side in box), *(tape.input(arb(x)) for x in constants)]
    found = body(tricept, name, tape)(*inputs)
    results = [x for x in found if isinstance(x, Number)]
    sizes = [1.0 if i < angles else float(x.value.abs_lower()) for i, x in enumerate(results)]
    return max(b / size for b, size in zip(bounds(tape, [[x] for x in results]), sizes, strict=True)) * ROOM
