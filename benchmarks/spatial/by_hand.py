"""The same by hand: eigenvalues of Sylvester's matrix, and roots of Bezout's octic, one pair after another."""

from __future__ import annotations

import numpy as np
from scipy import linalg

HALF = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]])
REAL = 1e-6
"""Imaginary part over 1 + |x|² up to which a tangent counts as real."""


def _biquadratics(m: np.ndarray) -> np.ndarray:
    """Coefficients [equation][power of x2][power of x1]."""
    return HALF @ m.transpose(0, 2, 1) @ HALF.T


def _sylvester(E: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices of the pencil of order 8: those of x1 to the powers 0, 1 and 2, linearised."""
    S = np.zeros((3, 4, 4))
    for row, (equation, shift) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        for power in range(3):
            S[:, row, shift + 2 - power] = E[equation, power]
    A, B = np.zeros((8, 8)), np.eye(8)
    A[:4, 4:], A[4:, :4], A[4:, 4:], B[4:, 4:] = np.eye(4), -S[0], -S[1], S[2]
    return A, B


def _angles(x1: np.ndarray, E: np.ndarray) -> np.ndarray:
    """Keep the real tangents, and find the other angle of each."""
    x1 = x1[np.isfinite(x1)]
    x1 = x1[np.abs(x1.imag) <= REAL * (1 + np.abs(x1) ** 2)].real
    r, q, p = (E @ np.array([np.ones_like(x1), x1, x1 * x1])).swapaxes(0, 1)
    pq, pr = p[0] * q[1] - p[1] * q[0], p[0] * r[1] - p[1] * r[0]
    return np.stack([2 * np.arctan(x1), 2 * np.arctan2(-pr, pq)], axis=-1)


def by_eigenvalues(M: np.ndarray) -> list[np.ndarray]:
    """NumPy's eigenvalues, one pair after the other; nothing is turned, polished or tested."""
    found = []
    for m in M:
        E = _biquadratics(m)
        A, B = _sylvester(E)
        found.append(_angles(np.linalg.eigvals(np.linalg.solve(B, A)), E))
    return found


def companions(M: np.ndarray) -> list[np.ndarray]:
    """Matrices (8, 8) of each pair, for :func:`eigenvalues_alone`."""
    found = []
    for m in M:
        A, B = _sylvester(_biquadratics(m))
        found.append(np.linalg.solve(B, A))
    return found


def eigenvalues_alone(matrices: list[np.ndarray]) -> list[np.ndarray]:
    """NumPy's eigenvalues of matrices that are there already: no angles, and no part of the way to them."""
    return [np.linalg.eigvals(matrix) for matrix in matrices]


def by_pencils(M: np.ndarray) -> list[np.ndarray]:
    """The same with SciPy's generalised eigenvalues, which do not divide by a matrix that may be singular."""
    found = []
    for m in M:
        E = _biquadratics(m)
        found.append(_angles(linalg.eigvals(*_sylvester(E)), E))
    return found


def by_roots(M: np.ndarray) -> list[np.ndarray]:
    """Roots of Bezout's octic by numpy.roots."""
    found = []
    for m in M:
        E = _biquadratics(m)

        def bracket(i: int, j: int, E: np.ndarray = E) -> np.ndarray:
            return np.convolve(E[0, i], E[1, j]) - np.convolve(E[1, i], E[0, j])

        pq, pr, qr = bracket(2, 1), bracket(2, 0), bracket(1, 0)
        found.append(_angles(np.roots((np.convolve(pr, pr) - np.convolve(pq, qr))[::-1]), E))
    return found


def all_at_once(M: np.ndarray) -> np.ndarray:
    """NumPy's eigenvalues of a stack of matrices, and nothing else: tangents x1 (n, 8)."""
    E = np.einsum("bj,ai,neij->neba", HALF, HALF, M)
    S = np.zeros((len(M), 3, 4, 4))
    for row, (equation, shift) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        for power in range(3):
            S[:, :, row, shift + 2 - power] = E[:, equation, power]
    A = np.zeros((len(M), 8, 8))
    A[:, :4, 4:] = np.eye(4)
    A[:, 4:, :4], A[:, 4:, 4:] = -np.linalg.solve(S[:, 2], S[:, 0]), -np.linalg.solve(S[:, 2], S[:, 1])
    return np.linalg.eigvals(A)


def trig_vectorised(A: np.ndarray, B: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Both angles as the notes have them, without a status."""
    gamma, half = np.arctan2(B, A), np.arccos(-D / np.hypot(A, B))
    return np.stack([gamma + half, gamma - half], axis=-1)
