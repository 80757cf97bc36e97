"""What a model is written with: the numbers of a tape; or another algebra, such as SymPy's in the tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rodgen.codegen import tape
from rodgen.codegen.tape_matrix import Matrix
from rodgen.symbolic.legs import solved as solved


@dataclass(frozen=True)
class Algebra:
    """How values are computed."""

    matrix: Any
    """As SymPy's ``Matrix``: a column of a list, or of rows, columns and components; ``zeros``, ``eye``, ``hstack``."""
    functions: Mapping[str, Callable[[Any], Any]]
    """Those of formulas, by name."""
    atan2: Callable[[Any, Any], Any]
    """The angle of a point, of its coordinates y and x."""
    select: Callable[[Any, Any, Any], Any]
    """Takes one of two values."""
    nan: Any
    pi: Any
    """Not a number; the ratio of a circle to its diameter."""
    number: Callable[[Fraction], Any]
    """What a Fraction becomes."""
    circle: Callable[[Any], tuple[Any, Any]]
    """Cosine and sine of an angle in degrees."""
    is_real: Callable[[Any], bool]
    """Whether a value may be a real number."""
    builder: Callable[[str], Any]
    """Makes the builder of a kernel of a name."""


class TapeBuilder:
    """Inputs and outputs of a program; the first input is that of the rows.

    Attributes
    ----------
    inputs : dict of str to list of Number
    outputs : dict of str to list of values
    """

    def __init__(self, on: tape.Tape) -> None:
        self.tape = on
        self.inputs: dict[str, list[tape.Number]] = {}
        self.outputs: dict[str, list[Any]] = {}

    def input(self, name: str, shape: tuple[int, ...], *, unit: str, doc: str) -> list[tape.Number]:
        """Declare an input."""
        self.inputs[name] = self.tape.inputs(name, math.prod(shape), same=bool(self.inputs))
        return self.inputs[name]

    def let(self, name: str, value: Any) -> Any:
        """Return the value: a tape computes nothing twice."""
        return value

    def output(self, name: str, value: Matrix, *, unit: str, doc: str) -> None:
        """Declare an output."""
        self.outputs[name] = value.flat

    def build(self) -> TapeBuilder:
        """Return the builder, which has all that a program is made of."""
        return self


def on_tape(on: tape.Tape) -> Algebra:
    """Return the algebra whose kernels are operations of a tape."""
    names = ("sin", "cos", "tan", "exp", "log", "sqrt")
    return Algebra(
        matrix=Matrix,
        functions={
            **{name: getattr(tape, name) for name in names},
            "abs": tape.absolute,
            "sign": lambda x: tape.select(x > 0, 1, tape.select(x < 0, -1, 0)),
        },
        atan2=tape.atan2,
        select=tape.select,
        nan=math.nan,
        pi=math.pi,
        number=lambda x: x,
        circle=_circle,
        is_real=lambda x: isinstance(x, tape.Number) or (not isinstance(x, complex) and x == x),
        builder=lambda name: TapeBuilder(on),
    )


def _circle(degrees: float) -> tuple[float, float]:
    """Return cosine and sine, exact where they are rational."""
    twelfths = {30: 0.5, 90: 1.0, 150: 0.5, 180: 0.0, 210: -0.5, 270: -1.0, 330: -0.5, 0: 0.0}

    def sine(x: float) -> float:
        return twelfths.get(x % 360, math.sin(math.radians(x)))  # type: ignore[call-overload, no-any-return]

    return sine(degrees + 90), sine(degrees)
