"""Least squares for peers that bring residuals with an exact Jacobian: rodgen's own driver, and SciPy's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from rodgen.calibration.problem.file_values import FileValues
from rodgen.calibration.solve.least_squares import minimise
from rodgen.machines.model import Frame

TOLERANCE = 1e-10
NormalEquations = tuple[float, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Exact:
    """What a peer brings.

    ``residuals(theta)`` is (n,), ``residuals_and_jacobian(theta)`` that and (n, parameters); ``seconds`` is what it
    took to derive and compile them. ``normal_equations`` and ``cost`` are given where the peer has a better way.
    """

    residuals: Callable[[np.ndarray], np.ndarray]
    residuals_and_jacobian: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    seconds: float
    normal_equations: Callable[[np.ndarray], NormalEquations] | None = None
    cost: Callable[[np.ndarray], float] | None = None


class _Problem:
    """A least-squares problem as `rodgen.calibration.solve.least_squares.minimise` wants it."""

    def __init__(self, exact: Exact, rows: int, components: int, parameters: int) -> None:
        self.exact, self.rows, self.count, self.components = exact, rows, rows, components
        self.scale = 1.0  # only data without noise come near what it is for
        self.is_closed_chain, self.starts = False, None  # no pose to solve for
        free = np.full(parameters, np.inf)
        none = np.zeros(parameters)
        self.file_values = FileValues(
            free, free, none > 0, none, none, -free, free, none
        )  # no file holds any
        self.total_weight, self.at_bounds = 1.0, lambda theta: {}
        self.freedom = lambda adjusted: max(rows * components - adjusted, 1)
        self.parameters = parameters
        # none is of a frame, and none is searched for
        self.model = SimpleNamespace(
            kinds=("peer",) * parameters, parameters=(SimpleNamespace(searched=None),) * parameters
        )

    def normal_equations(self, theta: np.ndarray, _: Any) -> NormalEquations:
        if self.exact.normal_equations:
            return self.exact.normal_equations(theta)
        r, j = self.exact.residuals_and_jacobian(theta)
        return float(r @ r), j.T @ j, j.T @ r

    def cost(self, theta: np.ndarray, _: Any) -> float:
        if self.exact.cost:
            return self.exact.cost(theta)
        r = self.exact.residuals(theta)
        return float(r @ r)

    def follow(self, *_: Any) -> bool:
        """Return that no pose was solved anew."""
        return False

    def keep_equations(self, *_: Any) -> None:
        """Accept that no equations are asked for again."""

    def start_from(self, _: None) -> None:
        """Accept that no pose has a start."""

    def bend(self, *_: Any) -> np.ndarray:
        """Return no curvature: these fits have ended before it is asked for."""
        return np.zeros(self.parameters)


def same_driver(exact: Exact, rows: int, start: np.ndarray) -> Callable[[], np.ndarray]:
    """Fit with rodgen's damped least squares."""
    problem: Any = _Problem(exact, rows, len(exact.residuals(start)) // rows, len(start))
    frame, free = Frame.identity(), range(len(start))
    return lambda: minimise(problem, start, frame, free).theta


def scipy_driver(exact: Exact, start: np.ndarray, method: str) -> Callable[[], np.ndarray]:
    """Fit with SciPy's least_squares; with its usual tolerances some would end too far from the minimum."""
    from scipy.optimize import least_squares

    def jacobian(theta: np.ndarray) -> np.ndarray:
        return exact.residuals_and_jacobian(theta)[1]

    options: Any = {"method": method, "x_scale": "jac", **dict.fromkeys(("ftol", "xtol", "gtol"), TOLERANCE)}
    return lambda: least_squares(exact.residuals, start, jacobian, **options).x
