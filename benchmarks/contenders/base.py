"""What a contender is: a name, and a way to bind itself to arrays so that one call solves them all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from problem import Problem

Call = Callable[[], object]

OWN = "this package"
YARDSTICK = "yardstick"  # shown and compared, but not one of the peers


class UnavailableError(Exception):
    """Raised while a contender is made; its message is the reason printed in the table."""


@dataclass(frozen=True)
class Contender:
    name: str
    family: str  # OWN, YARDSTICK, "C/C++", "JIT", "NumPy", "Python loop"
    bind: Callable[[Problem], Call]
    note: str = ""
    largest_n: int = 10**9  # more than this is timed on this many and scaled per solve
    strict: bool = True  # False: compiled with -ffast-math, which deletes tests for NaN

    @staticmethod
    def blocked(block: int, solve: Callable[[Problem], object]) -> Callable[[Problem], Call]:
        """Bind ``solve`` so that it walks the arrays in blocks that stay in cache."""

        def bind(problem: Problem) -> Call:
            parts = [
                Problem(
                    *(a[i : i + block] for a in (problem.rho, problem.rho_prime, problem.angle, problem.axes))
                )
                for i in range(0, len(problem), block)
            ]

            def call() -> None:
                for part in parts:
                    solve(part)

            return call

        return bind


def columns(vectors: np.ndarray) -> np.ndarray:
    """Component rows (3, N), contiguous: each is read many times, so one copy pays."""
    return np.ascontiguousarray(vectors.T)
