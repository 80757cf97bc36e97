"""The same by hand: legs as a loop and vectorised, all modes by numpy.roots and by SciPy's solver from many starts."""

from __future__ import annotations

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

R, r, h = 2.0, 1.0, 1.5
DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([-30, 90, 210])])
BASE, PLATFORM = R * DIRECTIONS, r * DIRECTIONS
PIVOT = np.array([0, 0, h])
STARTS = 40


def vectorised(matrices: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.einsum("nij,kj->nki", matrices, PLATFORM) + PIVOT - BASE, axis=-1)


def loop(matrices: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.norm(PLATFORM @ m.T + PIVOT - BASE, axis=1) for m in matrices])


def by_roots(legs: np.ndarray) -> list[list[np.ndarray]]:
    """Quaternions of all modes from the octic's roots, one triple of legs after the other; nothing is polished."""
    k, found = 4 * R * R + 16 * h * h, []
    for squares in np.square(legs):
        A = (3 * (R * R + r * r + h * h) - squares.sum()) / (3 * r * R)
        Z = complex(2 * squares[1] - squares[0] - squares[2], np.sqrt(3) * (squares[0] - squares[2])) / (
            3 * r
        )
        M, cube = abs(Z) ** 2, Z**3
        P = np.polymul([k, -16 * h * h, M], [k * k, -32 * k * h * h, 256 * h**4 - 12 * R * R * M])
        P[-1] += 16 * R * R * M * M - 32 * A * h * h * R * cube.real
        octic = np.polymul(P, P)
        octic[-3:] -= 1024 * R * R * h**4 * cube.imag**2 * np.array([4, -8, 4 - A * A])
        modes = []
        for rho in np.roots(octic):
            if abs(rho.imag) > 1e-6 or not 0 < rho.real <= 1:
                continue
            rho = rho.real
            along = (M + k * rho * rho - 16 * h * h * rho) / (4 * R * abs(Z))
            across = np.sqrt(max(rho * rho - along * along, 0))
            ways = []
            for sign in (1, -1):
                W = Z / abs(Z) * complex(along, sign * across)
                w = np.sqrt(W)
                v = (Z - 2 * R * W) * w / (4 * h * rho)
                ways.append((abs(2 * (v * v).real - A), v, w))
            _, v, w = min(ways, key=lambda way: way[0])
            modes.append(np.array([v.real, w.real, w.imag, v.imag]))
        found.append(modes)
    return found


def searched(legs: np.ndarray) -> list[list[np.ndarray]]:
    """Rotation matrices of the modes that SciPy finds from random starts."""
    starts, found = Rotation.random(STARTS, random_state=0), []
    for wanted in legs:
        modes: list[np.ndarray] = []
        for start in starts:

            def missing(turn: np.ndarray, start: Rotation = start, wanted: np.ndarray = wanted) -> np.ndarray:
                return loop((Rotation.from_rotvec(turn) * start).as_matrix()[None])[0] - wanted

            solution = root(missing, np.zeros(3), tol=1e-12)
            matrix = (Rotation.from_rotvec(solution.x) * start).as_matrix()
            if np.abs(solution.fun).max() < 1e-9 and all(np.abs(matrix - m).max() > 1e-5 for m in modes):
                modes.append(matrix)
        found.append(modes)
    return found
