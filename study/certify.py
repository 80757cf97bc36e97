"""Certify bounds of rounding errors for whole boxes of inputs, and write docs/science/certified.md: `make certify`."""

from __future__ import annotations

import argparse
import hashlib
import inspect
import itertools
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb
from newton_program import newton_box
from rounding import (
    EPS,
    FUNCTION_ULPS,
    ROOM,
    BallFunctions,
    Box,
    Certificate,
    Number,
    Tape,
    UndecidedError,
    ball,
    body,
    bounds,
    certify,
    paths,
    upper,
)
from vector_programs import Balls, rotate, solve_axis, solve_axis_usual

from rodgen.files import write_files
from rodgen.generated.numpy import instantaneous_euler, rotations, tricept

RIGHT = math.pi / 2


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


def logarithmic(low: float, high: float, ratio: float) -> list[tuple[float, float]]:
    """Return intervals that are next to each other."""
    ends = np.geomspace(low, high, math.ceil(math.log(high / low) / math.log(ratio)) + 1)
    return list(itertools.pairwise(ends.tolist()))


RIGHT = math.nextafter(math.pi / 2, 2)
"""Not below a right angle."""


def axis_boxes(x_least: float, y_least: float) -> list[Box]:
    """Return boxes of all pairs of which none is the largest of three numbers whose sum is a right angle.

    Numbers below 1e-4 are in one box with 0, where the least is 0.
    """
    sides = [
        [*([] if least else [(0.0, 1e-4)]), *logarithmic(least or 1e-4, RIGHT / 2, 2)]
        for least in (x_least, y_least)
    ]
    return [(x, y) for x in sides[0] for y in sides[1] if x[0] + y[0] + max(x[0], y[0]) <= RIGHT]


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


def conversion(
    name: str, source: str, outputs: tuple[tuple[int, str], ...], module: object = rotations
) -> Callable[[Box], float]:
    """Return the measure of a conversion: its largest error over eps.

    A box of rotations has the number of the axis's largest component, the ratios of the others to it, and its ratio to
    w in the quaternion.
    """
    made, _, within = REPRESENTATIONS[source]

    def measure(box: Box) -> float:
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

    return measure


def tricept_box(name: str, box: Box, constants: Sequence[float], angles: int) -> float:
    """Return the largest error of a pose, a leg or a coordinate over eps; of a length over the length.

    `angles` is how many angles come first.
    """
    tape = Tape()
    inputs = [*(tape.input(ball(*side)) for side in box), *(tape.input(arb(x)) for x in constants)]
    found = body(tricept, name, tape)(*inputs)
    results = [x for x in found if isinstance(x, Number)]
    sizes = [1.0 if i < angles else float(x.value.abs_lower()) for i, x in enumerate(results)]
    return max(b / size for b, size in zip(bounds(tape, [[x] for x in results]), sizes, strict=True)) * ROOM


def rotation_boxes() -> list[Box]:
    """Return boxes of rotations far from none and half a turn, about axes far from the coordinate planes."""
    return [((k, k), RATIOS, RATIOS, t) for k in range(3) for t in TANGENTS]


@dataclass(frozen=True)
class Claim:
    """A bound, and the boxes for which it is certified.

    Attributes
    ----------
    kernel, unit, where : str
        What is certified, in what the bound is counted, and for which inputs.
    bound : float
    measure : callable
        From a box to its own bound.
    boxes, small : list of Box
        All, and a few small ones in them that take a moment.
    """

    kernel: str
    unit: str
    where: str
    bound: float
    measure: Callable[[Box], float]
    boxes: list[Box]
    small: list[Box]

    def certificate(self) -> Certificate:
        """Go through all boxes."""
        return certify(self.measure, self.boxes, self.bound, DEPTH)


DEPTH = 20
"""How often a box is halved at most."""

RATIOS, TANGENTS = (0.3, 0.7), ((0.4, 0.8), (1.25, 2.5))
"""Of components of the rotations for which conversions are certified; wider ones take hours."""
ANGLES = list(itertools.pairwise(np.linspace(-0.4, 0.4, 17).tolist()))
CONVERSIONS = {
    "rodrigues_vector_from_axis_angle": 9,
    "matrix_from_axis_angle": 20,
    "quaternion_from_axis_angle": 4.5,
    "axis_angle_from_rodrigues_vector": 7,
    "matrix_from_rodrigues_vector": 15,
    "quaternion_from_rodrigues_vector": 3,
    "axis_angle_from_quaternion": 6,
    "rodrigues_vector_from_quaternion": 4,
    "matrix_from_quaternion": 15,
    "quaternion_from_matrix": 4,
    "rodrigues_vector_from_matrix": 8,
    "axis_angle_from_matrix": 14,
}
"""Bound of each, in eps; the weights of the errors are those of `REPRESENTATIONS`."""


def claims() -> list[Claim]:
    """Return all claims."""
    small: list[Box] = [((0.3, 0.305), (0.4, 0.405)), ((0.01, 0.0103), (0.1, 0.103))]
    found = [
        Claim(
            "solve_axis",
            "cond eps",
            where,
            12,
            lambda box, largest=largest, usual=usual: axis_box(box, largest, usual),
            axis_boxes(x, y),
            [*small, *more],
        )
        for usual, largest, where, x, y, more in (
            (
                True,
                "a",
                "the program for usual inputs; a is the largest, the others are at least 0.0001",
                1e-4,
                1e-4,
                [],
            ),
            # the tangent of a half turn is huge
            (
                True,
                "g",
                "the program for usual inputs; h - a is the largest, the others are at least 0.01",
                1e-2,
                1e-2,
                [],
            ),
            (
                True,
                "k",
                "the program for usual inputs; π/2 - h is the largest, the others are at least 0.0001",
                1e-4,
                1e-4,
                [],
            ),
            (
                False,
                "a",
                "that for all inputs; a is the largest, h - a is at least 1e-6",
                1e-6,
                0,
                [((0.3, 0.305), (0, 1e-4))],
            ),
            (False, "g", "that for all inputs; h - a is the largest", 0, 0, [((0, 1e-4), (0, 1e-4))]),
            (
                False,
                "k",
                "that for all inputs; π/2 - h is the largest, h - a is at least 1e-6",
                0,
                1e-6,
                [((0, 1e-4), (0.3, 0.305))],
            ),
        )
    ]
    directions = list(itertools.pairwise(np.linspace(0, np.pi, 9).tolist()))
    found.append(
        Claim(
            "rotate",
            "eps of the vector's length",
            "turns by 0.11° to 179.89°, all vectors",
            16,
            rotate_box,
            [(t, a) for t in logarithmic(1e-3, 1e3, 1.5) for a in directions],
            [((0.5, 0.51), (1.0, 1.05)), ((20.0, 20.5), (0.1, 0.15))],
        )
    )
    turns = "the box of conversions"
    near = [((0, 0), (0.5, 0.52), (0.4, 0.42), (0.7, 0.72)), ((2, 2), (0.35, 0.36), (0.6, 0.61), (2.0, 2.05))]
    for name, bound in CONVERSIONS.items():
        target, _, source = name.partition("_from_")
        measure = conversion(name, source, REPRESENTATIONS[target][1])
        found.append(Claim(name, "eps", turns, bound, measure, rotation_boxes(), near))
    for source, bound in (("quaternion", 7), ("matrix", 16)):
        name = f"chi_from_{source}"
        measure = conversion(name, source, ((1, "1"),) * 3, instantaneous_euler)
        found.append(Claim(name, "eps", turns, bound, measure, rotation_boxes(), near))
    found += [
        Claim(
            "tricept_legs",
            "eps of the length",
            "alpha and beta from -0.3 to 0.3, z from 600 to 700, r = 140, R = 330",
            12,
            lambda box: tricept_box("tricept_legs", box, (140, 330), 0),
            [((-0.3, 0.3), (-0.3, 0.3), (600.0, 700.0))],
            [((0.1, 0.12), (-0.2, -0.18), (600.0, 610.0))],
        ),
        Claim(
            "tricept_pose",
            "eps; of lengths eps of the length",
            "x and y from 100 to 150, z from 600 to 650, r = 140, R = 330, q = (30, 20, 40), legs of any length",
            30,
            lambda box: tricept_box("tricept_pose", box, (140, 330, 30, 20, 40, 0, 1e6), 2),
            [((100.0, 150.0), (100.0, 150.0), (600.0, 650.0))],
            [((100.0, 102.0), (120.0, 122.0), (600.0, 604.0))],
        ),
        Claim(
            "tricept_direct",
            "eps; of z eps of z",
            "rods of all poses with alpha and beta from -0.4 to 0.4, z from 550 to 800, r = 140, R = 330; it converges",
            50,
            lambda box: newton_box(box, (140, 330)),
            [(a, b, z) for a in ANGLES for b in ANGLES for z in itertools.pairwise(range(550, 801, 25))],
            [((0.2, 0.22), (-0.3, -0.28), (600.0, 610.0)), ((-0.01, 0.01), (-0.01, 0.01), (700.0, 710.0))],
        ),
    ]
    return found


KEPT = Path(__file__).parents[1] / "build" / "certified"
"""Has the certificates of claims that were finished, so that a run goes on where one before it ended."""
PAGE = Path(__file__).parents[1] / "docs/science/certified.md"
TOP = """# Certified bounds of rounding errors

Made by `make certify`. A row holds for every input of its boxes. The operations of the generated NumPy function are
evaluated with balls (of Arb, by python-flint). These contain all inputs of a box and all roundings `(a ∘ b)(1 +
δ)`, `|δ| ≤ 2⁻⁵³`. The C code has the same order of operations. Boxes are halved until the bound is below the claim.
The bound is that of the difference to exact arithmetic on the same floating-point inputs. Errors that occur are
about a third of it, because roundings seldom all add up.
"""
BOTTOM = """
*At most* is the claim, *found* the largest bound of a box. `study/rounding.py` says how, `study/certify.py` for what.

- **Errors.** ε is 2⁻⁵². The error of an axis is a length. In conversions it is multiplied by the sine of half the
  angle, and that of a Rodrigues vector, over its length, by the cosine. Of matrices and quaternions it is that of
  the worst number. A given matrix may be off a rotation by 4 ε.
- **Assumed.** Sine, cosine, tangent and arc tangent are accurate to one unit in the last place. Nothing overflows
  or underflows, and no flag changes arithmetic. Fused operations are included.
- **`solve_axis`.** Points are anywhere, of any length. Half the angle between them is a, half the angle of the
  rotation is h, up to a turn. The program for all inputs is certified but for points within 1e-6 rad of h = a. The
  rows say how near the program for usual inputs is. Lengths differ by up to 1e-3. At single inputs the bound is up
  to 9.4 cond ε; the tests find at most 4 cond ε in their [families](accuracy.md).
- **The box of conversions.** Ratios of the axis's components to the largest are 0.3 to 0.7, of that to w 0.4 to 0.8
  and 1.25 to 2.5. Components have one sign; the others follow by symmetry.
- **`tricept_direct`.** The error is the distance from the exact pose. All six steps of Newton's method are followed
  for a box at once (`study/newton_program.py`). Errors that occur are about 1 eps.
- **Not certified.** Inputs nearer to an undetermined case, the status there, other iterations, kernels that are not
  listed, and float32.
"""


def certified(number: int) -> tuple[Certificate, float]:
    """Return the certificate of a claim, and the seconds of a processor that it took; a finished one is kept."""
    claim = claims()[number]
    programs = [vars(module).get(f"_{claim.kernel}") for module in (instantaneous_euler, rotations, tricept)]
    text = [path.read_text(encoding="utf-8") for path in sorted(Path(__file__).parent.glob("*.py"))]
    about = [str(number), *text, *map(inspect.getsource, filter(None, programs))]
    kept = KEPT / f"{hashlib.sha256(''.join(about).encode()).hexdigest()}.json"
    if kept.is_file():
        worst, boxes, left, seconds = json.loads(kept.read_text(encoding="utf-8"))
        return Certificate(worst, boxes, [tuple(map(tuple, box)) for box in left]), seconds
    start = time.process_time()
    found = claim.certificate()
    seconds = time.process_time() - start
    write_files(KEPT, {kept.name: json.dumps([found.worst, found.boxes, found.open, seconds])})
    return found, seconds


def row(claim: Claim, found: Certificate) -> str:
    """Return a row of the page's table."""
    verdict = f"{found.worst:.2f}" + (f", **{len(found.open)} boxes open**" if found.open else "")
    return f"| `{claim.kernel}` | {claim.where} | {claim.bound:g} {claim.unit} | {verdict} | {found.boxes} |"


def page(certificates: Sequence[Certificate]) -> str:
    """Return the page about all claims."""
    head = ["| kernel | inputs | at most | found | boxes |", "| --- | --- | --- | ---: | ---: |"]
    return "\n".join([TOP, *head, *map(row, claims(), certificates), BOTTOM])


def main() -> None:
    """Certify all, and write the page; the exit code is 1 where a bound does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", "--jobs", type=int, default=1, help="processes")
    jobs = parser.parse_args().jobs
    everything, found, failed = claims(), [], False
    with ProcessPoolExecutor(jobs) as processes:
        for claim, (certificate, seconds) in zip(
            everything, processes.map(certified, range(len(everything))), strict=True
        ):
            found.append(certificate)
            print(f"{row(claim, certificate)} {seconds:.0f} s", flush=True)
            if certificate.open:
                print(f"  open: {certificate.open[:3]}", flush=True)
            failed |= certificate.worst > claim.bound or bool(certificate.open)
    PAGE.write_text(page(found), encoding="utf-8")
    sys.exit(failed)


if __name__ == "__main__":
    main()
