"""The problem, its random inputs, and the reference solution.

Given a point before (rho) and after (rho_prime) a rotation by the angle chi, find both unit axes:
with r = rho' - rho, m = rho' + rho, kappa = cot(chi/2),

    e± = (kappa m x r ± sqrt(max(|m|^2 - kappa^2 |r|^2, 0)) m) / |m|^2.

Every closed-form peer gets this compact form: it is the shortest, and what a good engineer who has
solved the equation would hand to a generator. The iterative peers get r = tan(chi/2) e x m, |e| = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SMALLEST_COS_GAMMA = 0.05
ANGLES = (0.05, 3.09)
# Condition number of the axis is 1 / (2 sin(chi/2) |cos gamma|): at most this for the inputs made here.
LARGEST_CONDITION = 1 / (2 * np.sin(ANGLES[0] / 2) * SMALLEST_COS_GAMMA)


@dataclass(frozen=True)
class Problem:
    rho: np.ndarray
    rho_prime: np.ndarray
    angle: np.ndarray
    axes: np.ndarray  # (N, 2, 3), preallocated and touched: where a contender writes its answer

    def __len__(self) -> int:
        return len(self.angle)

    def head(self, n: int) -> Problem:
        return Problem(self.rho[:n], self.rho_prime[:n], self.angle[:n], self.axes[:n])


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def make(n: int, seed: int = 20240521) -> Problem:
    """Random generic problems: no tangent, parallel or half-turn case, because the peers handle none."""
    rng = np.random.default_rng(seed)
    rho, rho_prime, angle = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    for start in range(0, n, 100_000):
        part = slice(start, min(start + 100_000, n))
        count = part.stop - part.start
        axis = _unit(rng.normal(size=(count, 3)))
        across = _unit(np.cross(axis, rng.normal(size=(count, 3))))
        cos_gamma = rng.uniform(SMALLEST_COS_GAMMA, 0.995, count) * rng.choice([-1.0, 1.0], count)
        length = np.exp(rng.uniform(-1, 1, count))
        along = (length * cos_gamma)[:, None] * axis
        outward = (length * np.sqrt(1 - cos_gamma**2))[:, None]
        chi = rng.uniform(*ANGLES, count)
        third = np.cross(axis, across)
        rho[part] = along + outward * across
        rho_prime[part] = along + outward * (np.cos(chi)[:, None] * across + np.sin(chi)[:, None] * third)
        angle[part] = chi
    return Problem(rho, rho_prime, angle, np.zeros((n, 2, 3)))


def reference(problem: Problem) -> np.ndarray:
    """Both axes from the half-angle form in extended precision: another formula than the contenders' own."""
    rho, rho_prime = (v.astype(np.longdouble) for v in (problem.rho, problem.rho_prime))
    half = problem.angle.astype(np.longdouble)[:, None] / 2
    r, m = rho_prime - rho, rho_prime + rho
    r_length, m_length = (np.sqrt((v * v).sum(-1, keepdims=True)) for v in (r, m))
    n = np.cross(m / m_length, r / r_length)
    sin_h, cos_h = np.sin(half), np.cos(half)
    cos_b = cos_h * r_length / (sin_h * m_length)
    sin_b = np.sqrt((1 - cos_b) * (1 + cos_b))
    bisector = m / m_length
    return np.stack([cos_b * n + sin_b * bisector, cos_b * n - sin_b * bisector], axis=1)


def largest_error(axes: np.ndarray, expected: np.ndarray) -> float:
    """Largest |e - e_reference|, whichever of the two axes a contender writes first."""
    straight = np.abs(axes - expected).max(axis=(1, 2))
    swapped = np.abs(axes[:, ::-1] - expected).max(axis=(1, 2))
    return float(np.minimum(straight, swapped).max())
