"""Certify bounds of rounding errors for whole boxes of inputs, and write docs/science/certified.md: `make certify`."""

from __future__ import annotations

import argparse
import hashlib
import inspect
import itertools
import json
import math
import re
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from kernel_boxes import REPRESENTATIONS, conversion_box, tricept_box
from newton_program import newton_box
from rounding import Box, Certificate, certify
from vector_programs import RIGHT, axis_box, rotate_box

from rodgen.files import write_files
from rodgen.generated.numpy import axis, instantaneous_euler, rotations, tricept


def logarithmic(low: float, high: float, ratio: float) -> list[tuple[float, float]]:
    """Return intervals that are next to each other."""
    ends = np.geomspace(low, high, math.ceil(math.log(high / low) / math.log(ratio)) + 1)
    return list(itertools.pairwise(ends.tolist()))


def axis_boxes(x_least: float, y_least: float) -> list[Box]:
    """Return boxes of all pairs of which none is the largest of three numbers whose sum is a right angle.

    Numbers below 1e-4 are in one box with 0, where the least is 0.
    """
    sides = [
        [*([] if least else [(0.0, 1e-4)]), *logarithmic(least or 1e-4, RIGHT / 2, 2)]
        for least in (x_least, y_least)
    ]
    return [(x, y) for x in sides[0] for y in sides[1] if x[0] + y[0] + max(x[0], y[0]) <= RIGHT]


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
    measure : partial
        From a box to its own bound.
    boxes, small : list of Box
        All, and a few small ones in them that take a moment.
    """

    kernel: str
    unit: str
    where: str
    bound: float
    measure: partial[float]
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
            partial(axis_box, largest=largest, usual=usual),
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
            partial(rotate_box),
            [(t, a) for t in logarithmic(1e-3, 1e3, 1.5) for a in directions],
            [((0.5, 0.51), (1.0, 1.05)), ((20.0, 20.5), (0.1, 0.15))],
        )
    )
    turns = "the box of conversions"
    near = [((0, 0), (0.5, 0.52), (0.4, 0.42), (0.7, 0.72)), ((2, 2), (0.35, 0.36), (0.6, 0.61), (2.0, 2.05))]
    for name, bound in CONVERSIONS.items():
        target, _, source = name.partition("_from_")
        outputs = REPRESENTATIONS[target][1]
        measure = partial(conversion_box, name, source, outputs, rotations)
        found.append(Claim(name, "eps", turns, bound, measure, rotation_boxes(), near))
    for source, bound in (("quaternion", 7), ("matrix", 16)):
        name = f"chi_from_{source}"
        measure = partial(conversion_box, name, source, ((1, "1"),) * 3, instantaneous_euler)
        found.append(Claim(name, "eps", turns, bound, measure, rotation_boxes(), near))
    found += [
        Claim(
            "tricept_legs",
            "eps of the length",
            "alpha and beta from -0.3 to 0.3, z from 600 to 700, r = 140, R = 330",
            12,
            partial(tricept_box, "tricept_legs", (140, 330), 0),
            [((-0.3, 0.3), (-0.3, 0.3), (600.0, 700.0))],
            [((0.1, 0.12), (-0.2, -0.18), (600.0, 610.0))],
        ),
        Claim(
            "tricept_pose",
            "eps; of lengths eps of the length",
            "x and y from 100 to 150, z from 600 to 650, r = 140, R = 330, q = (30, 20, 40), legs of any length",
            30,
            partial(tricept_box, "tricept_pose", (140, 330, 30, 20, 40, 0, 1e6), 2),
            [((100.0, 150.0), (100.0, 150.0), (600.0, 650.0))],
            [((100.0, 102.0), (120.0, 122.0), (600.0, 604.0))],
        ),
        Claim(
            "tricept_direct",
            "eps; of z eps of z",
            "rods of all poses with alpha and beta from -0.4 to 0.4, z from 550 to 800, r = 140, R = 330; it converges",
            50,
            partial(newton_box, radii=(140, 330)),
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


def depends_on(claim: Claim) -> str:
    """Return a key of all that a certificate follows from: the boxes, the kernel's program, and what measures it."""
    measure, study = claim.measure, Path(__file__).parent
    modules, waiting = set[str](), {measure.func.__module__}
    while waiting:
        modules.add(name := waiting.pop())
        imported = re.findall(
            r"^(?:from|import) (\w+)", (study / f"{name}.py").read_text("utf-8"), re.MULTILINE
        )
        waiting |= {other for other in imported if (study / f"{other}.py").is_file()} - modules
    names = (f"_{claim.kernel}", f"_{claim.kernel}_usual")
    programs = [
        vars(module).get(name) for module in (axis, instantaneous_euler, rotations, tricept) for name in names
    ]
    given = [x for x in (*measure.args, *measure.keywords.items()) if not inspect.ismodule(x)]
    about = [claim.kernel, repr((claim.bound, DEPTH, claim.boxes, measure.func.__name__, given))]
    about += [(study / f"{name}.py").read_text("utf-8") for name in sorted(modules)]
    return hashlib.sha256(
        "".join([*about, *map(inspect.getsource, filter(None, programs))]).encode()
    ).hexdigest()


def certified(number: int) -> tuple[Certificate, float]:
    """Return the certificate of a claim, and the seconds of a processor that it took; a finished one is kept."""
    claim = claims()[number]
    kept = KEPT / f"{depends_on(claim)}.json"
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
