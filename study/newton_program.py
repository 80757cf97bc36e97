"""Newton's method of `tricept_direct` for all rods of the poses in a box: that it converges, and how near.

The program is the text of the generated function itself, cut before each of its steps. Let a step begin off the exact
pose p by e. In exact arithmetic its end is off by

    W⁻¹ H[e, e] / 2  and, as the step turns by 2 arctan(δ / 2) in place of δ, by at most |δ|³ / 12 more,

where H, the second derivatives of L, are taken somewhere between both. Added are the roundings of the step, whose bound
`rounding.py` finds with p and e as parameters, and those before it by which sine and cosine left the unit circle. So e
has a bound after each step, beginning with that of the start.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import sympy as sp
from flint import arb, arb_mat
from rounding import (
    EPS,
    ROOM,
    BallFunctions,
    Box,
    Condition,
    Number,
    Tape,
    U,
    UndecidedError,
    ball,
    bounds,
    upper,
)

from rodgen.generated.numpy import tricept

_text = re.sub(
    r"^ +(del|return|def|#) ?.*\n", "", inspect.getsource(tricept._tricept_direct), flags=re.MULTILINE
)
_lines = [line.strip() for line in _text.splitlines()[1:]]
BEFORE, *STEPS, RESULTS = re.split(r"\n(?=L\d_1 = |valid = |.*xp\.abs\(move\d_1\))", "\n".join(_lines))
"""The pieces of the program; those of a step are its equations and the turn by what they give."""
CARRIED = ("sa", "ca", "sb", "cb", "z")
"""What a step hands to the next."""
_once = [
    line
    for piece in STEPS[:-2]
    for line in piece.splitlines()
    if re.match(r"x\d+ = [\d.]+\*r$", line, re.IGNORECASE)
]
BEFORE = "\n".join((BEFORE, *_once))  # what all steps share stands where the first of them needs it


def begins(step: int) -> list[str]:
    """Return the names of what a step, from 1 on, begins with."""
    return [f"{name}{step - 1}" if step > 1 else f"start_{name}" for name in CARRIED]


class Decided(BallFunctions):
    """Functions of a program without a choice that depends on where in the box the input is."""

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """Return one of two values; of two plain numbers that are not chosen later, both."""
        holds = condition.holds if isinstance(condition, Condition) else bool(condition)
        if holds is not None:
            return yes if holds else no
        if isinstance(yes, Number) or isinstance(no, Number) or abs(yes) != abs(no):
            raise UndecidedError
        return self.tape.input(arb(0, abs(yes)))


def second_derivatives() -> Any:
    """Return the function of α, β, z, r and R that gives those of L, three matrices."""
    pose = a, b, z = sp.symbols("a b z")
    r, R = sp.symbols("r R")
    L = (
        z**2 - R * r * (sp.cos(a) + sp.cos(b)),
        2 * R * z * sp.sin(a) + R * r * sp.sin(a) * sp.sin(b),
        2 * R * z * sp.cos(a) * sp.sin(b) + R * r * (sp.cos(b) - sp.cos(a)),
    )
    found = [sp.hessian(each, pose).tolist() for each in L]
    return sp.lambdify((*pose, r, R), found, modules=[{"sin": arb.sin, "cos": arb.cos}])


SECOND = second_derivatives()


def begun(r: float, R: float, zeros: tuple[arb, ...]) -> Callable[..., list[Number]]:
    """Return what gives, for a pose and what a step is off it, the rods and what the step begins with."""

    def made(a: Number, b: Number, z: Number, *off: Number) -> list[Number]:
        (sa, ca), (sb, cb) = ((x.function("sin"), x.function("cos")) for x in (a, b))
        half_root = arb(3).sqrt() / 2
        across = sa * (z + sb * (r / 2)) * z.tape.input(half_root, half_root, zeros)
        along = cb * (r / 4) + ca * (0.75 * r - z * sb * 0.5)
        sums = (cb * r + z * sb * ca, along + across, along - across)
        rods = [(z * z - x * (2 * R) + (r * r + R * R)).sqrt() for x in sums]
        turned = [a + off[0], b + off[1]]
        return [*rods, *(x.function(name) for x in turned for name in ("sin", "cos")), z + off[2]]

    return made


def run(
    box: Box, off: Sequence[arb], stretched: float, radii: tuple[float, float], step: int = 0
) -> dict[str, Any]:
    """Return the variables of the program's text after the equations of a step; without one, before the first.

    The sines, cosines and z of the pose and what it is off by are `begin_sa` to `begin_z`.
    """
    tape = Tape()
    sides = [*box, *((float(x.lower()) - upper(x) * 1e-9, float(x.upper()) + upper(x) * 1e-9) for x in off)]
    *rods, sa, ca, sb, cb, z = tape.inputs(sides, begun(*radii, (arb(0),) * len(sides)))
    sa, ca = tape.rounded((sa, ca), stretched / U)
    sb, cb = tape.rounded((sb, cb), stretched / U)
    names = {f"legs_{n}": rod for n, rod in enumerate(rods, 1)}
    begin = dict(zip(CARRIED, (sa, ca, sb, cb, z), strict=True))
    names |= {f"begin_{name}": x for name, x in begin.items()}
    names |= dict(zip("rR", (tape.input(arb(x)) for x in radii), strict=True))
    variables = {**names, "xp": Decided(tape), "eps": EPS, "largest": 1e308}
    exec(BEFORE, variables)
    if step:
        variables |= zip(begins(step), begin.values(), strict=True)
        exec(STEPS[2 * step - 2], variables)
    return variables


def start(box: Box, radii: tuple[float, float]) -> list[arb]:
    """Return how far the start is from the pose: less than a right angle, as the start's angles are at most 62°."""
    got = run(box, [arb(0)] * 3, 0.0, radii)
    got["xp"].tape.exact = True
    turns = [got[f"start_s{n}"] * got[f"begin_c{n}"] - got[f"start_c{n}"] * got[f"begin_s{n}"] for n in "ab"]
    return [*(x.value.asin() for x in turns), (got["start_z"] - got["begin_z"]).value]


def newton_box(box: Box, radii: tuple[float, float]) -> float:
    """Return the largest error of an angle, and of z over z, in eps, for all rods of the poses in a box.

    The angles of the box are at most 28°.
    """
    pose = [ball(*side) for side in box]
    off, stretched = start(box, radii), 4 * EPS  # of sqrt(1 - sine²), in which three roundings are
    for step in range(1, len(STEPS) // 2 + 1):
        got = run(box, off, stretched, radii, step)
        tape, e = got["xp"].tape, arb_mat([[x] for x in off])
        between = [x + each * ball(0, 1) for x, each in zip(pose, off, strict=True)]
        half = arb_mat([[(e.transpose() * arb_mat(h) * e)[0, 0] / 2] for h in SECOND(*between, *radii)])
        W = arb_mat([[got[f"W{step}_{i}_{j}"].value for j in (1, 2, 3)] for i in (1, 2, 3)])
        try:
            exact = (W.inv() * half).entries()
        except ZeroDivisionError as error:
            raise UndecidedError from error
        moves = [end - begin for end, begin in zip(exact, off, strict=True)]
        for name, move in zip((f"move{step}_{n}" for n in (1, 2, 3)), moves, strict=True):
            got[name] = replace(got[name], value=got[name].value.intersection(move + arb(0, got[name].off)))
        exec(STEPS[2 * step - 1], got)
        ends = [*(got["xp"].atan2(got[f"s{n}{step}"], got[f"c{n}{step}"]) for n in "ab"), got[f"z{step}"]]
        tape.exact = True
        for sine, cosine in ((got[f"s{n}{step}"], got[f"c{n}{step}"]) for n in "ab"):
            ends.append(sine * sine + cosine * cosine)
        tape.exact = False
        *rounded, a, b = (EPS * x for x in bounds(tape, [[x] for x in ends]))
        arcs = [upper(move) ** 3 / 12 for move in moves[:2]]
        off = [x + arb(0, sum(more) * ROOM) for x, *more in zip(exact, rounded, [*arcs, 0.0], strict=True)]
        stretched = max(a, b) / 2  # squares of lengths near 1
    exec(RESULTS, got)
    if got["status_value"] != 0.0:
        raise UndecidedError
    return max(upper(off[0]), upper(off[1]), upper(off[2]) / float(pose[2].abs_lower()) * ROOM) / EPS
