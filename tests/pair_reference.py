"""All solutions of two equations in two angles with 60 digits, by Bezout's octic: no code in common with rodgen."""

from __future__ import annotations

import mpmath
import numpy as np

DIGITS = 60
TURN = (0.4321, 0.8765)
"""Where both angles are counted from, so that no solution is at infinity."""


def _turned(m: np.ndarray) -> list[list[mpmath.mpf]]:
    """Coefficients of one equation with both angles counted from TURN, by (1, cos, sin)."""
    found = [[mpmath.mpf(float(x)) for x in row] for row in m]
    for axis, turn in enumerate(TURN):
        c, s = mpmath.cos(turn), mpmath.sin(turn)
        if axis == 1:
            found = [list(column) for column in zip(*found, strict=True)]
        one, cosine, sine = found
        found = [
            one,
            [c * a + s * b for a, b in zip(cosine, sine, strict=True)],
            [c * b - s * a for a, b in zip(cosine, sine, strict=True)],
        ]
        if axis == 1:
            found = [list(column) for column in zip(*found, strict=True)]
    return found


def _powers(m: list[list[mpmath.mpf]]) -> list[list[mpmath.mpf]]:
    """Coefficients [power of x2][power of x1] of (1 + x1²)(1 + x2²) times the equation."""

    def halves(a: list[mpmath.mpf]) -> list[mpmath.mpf]:
        return [a[0] + a[1], 2 * a[2], a[0] - a[1]]

    by_first = [halves([m[i][j] for i in range(3)]) for j in range(3)]  # [second basis][power of x1]
    return [
        list(p) for p in zip(*(halves([by_first[j][a] for j in range(3)]) for a in range(3)), strict=True)
    ]


def _product(a: list[mpmath.mpf], b: list[mpmath.mpf]) -> list[mpmath.mpf]:
    found = [mpmath.mpf(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] += x * y
    return found


def _minus(a: list[mpmath.mpf], b: list[mpmath.mpf]) -> list[mpmath.mpf]:
    return [x - y for x, y in zip(a, b, strict=True)]


def all_roots(M: np.ndarray) -> list[tuple[mpmath.mpc, mpmath.mpc]]:
    """Return the tangents (x1, x2) of the half angles from TURN on, all eight, complex ones among them."""
    with mpmath.workdps(DIGITS):
        E = [_powers(_turned(m)) for m in np.asarray(M)]

        def bracket(i: int, j: int) -> list[mpmath.mpf]:
            return _minus(_product(E[0][i], E[1][j]), _product(E[1][i], E[0][j]))

        pq, pr, qr = bracket(2, 1), bracket(2, 0), bracket(1, 0)
        octic = _minus(_product(pr, pr), _product(pq, qr))
        size = max(map(abs, octic))
        found = []
        for x1 in mpmath.polyroots([c / size for c in octic[::-1]], maxsteps=400, extraprec=400):
            a, b, c = (mpmath.polyval(p[::-1], x1) for p in (pq, pr, qr))
            x2 = -b / a if abs(a) >= abs(c) else -c / b
            found.append((x1, x2))
        return found


def all_angles(M: np.ndarray, real_below: float = 1e-20) -> np.ndarray:
    """Return the real solutions (n, 2) in the order of the first angle, as floats, from -π to π."""
    found = []
    with mpmath.workdps(DIGITS):
        for x1, x2 in all_roots(M):
            if abs(x1.imag) <= real_below * (1 + abs(x1) ** 2):
                pair = [2 * mpmath.atan(x.real) + turn for x, turn in zip((x1, x2), TURN, strict=True)]
                found.append([float(mpmath.fmod(a + 3 * mpmath.pi, 2 * mpmath.pi) - mpmath.pi) for a in pair])
    return np.array(sorted(found)).reshape(-1, 2)
