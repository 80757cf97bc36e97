"""Measure the two equations of docs/mechanisms/spatial_mechanisms.md and write their tables: python docs/mechanisms/make_spatial_accuracy.py

Each row is a family of equations that are hard in one way. An equation is its coefficients in floating point; the
reference is the solutions for exactly these numbers, with 60 digits. The error is the largest one of an angle in the
family; "lost" counts the solutions of the reference that were not found.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np

from rodgen.kinematics import spatial

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/mechanisms/spatial_mechanisms.md"
LOST = 1e-2
"""rad; an angle further off than this is not a solution."""

sys.path.insert(0, str(ROOT / "tests"))
from numeric_reverse import wrapped  # noqa: E402
from pair_reference import DIGITS, all_angles  # noqa: E402 - the reference of the tests, too

Solver = Callable[[np.ndarray], np.ndarray]
"""From one equation to its angles, (k) or (k, 2); NaN where there is none."""


def worst(solver: Solver, equations: np.ndarray, references: list[np.ndarray]) -> str:
    """The largest error over a family, or how many solutions are lost."""
    largest, lost = 0.0, 0
    for equation, wanted in zip(equations, references, strict=True):
        with np.errstate(all="ignore"):
            found = solver(equation)
        for one in wanted:
            off = np.abs(wrapped(found - one)).reshape(len(found), -1).max(axis=1)
            off = off[np.isfinite(off)]
            if not off.size or off.min() > LOST:
                lost += 1
            else:
                largest = max(largest, float(off.min()))
    return f"{lost} lost" if lost else f"{largest:.0e}" if largest else "0"


# A cos + B sin + D = 0 -----------------------------------------------------------------------------------


def trig_families(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rows of A, B, D."""
    A, B = rng.uniform(0.5, 2.0, (2, 60)) * rng.choice([-1.0, 1.0], (2, 60))
    made = {"random": np.column_stack([A, B, rng.uniform(-0.9, 0.9, 60) * np.hypot(A, B)])}
    for gap in (0.0, 1e-15, 1e-12, 1e-8):
        name = f"D = A (1 + {gap:.0e})" if gap else "D = A"
        made[name] = np.column_stack([A, B, A * (1 + gap)])
    for gap in (1e-6, 1e-13):
        made[f"abs(D) = r (1 − {gap:.0e})"] = np.column_stack([A, B, np.hypot(A, B) * (1 - gap)])
    return made


def trig_reference(row: np.ndarray) -> np.ndarray:
    """Both angles, with 60 digits."""
    with mpmath.workdps(DIGITS):
        A, B, D = map(mpmath.mpf, row.tolist())
        r = mpmath.hypot(A, B)
        if abs(D) > r:
            return np.empty(0)
        turn, half = mpmath.atan2(B, A), mpmath.acos(-D / r)
        return np.array([float(turn + half), float(turn - half)])


def quadratic(row: np.ndarray) -> np.ndarray:
    """The half-angle method as it is printed: the quadratic formula for x = tan(theta/2)."""
    A, B, D = row
    root = np.sqrt(np.maximum(A * A + B * B - D * D, 0.0))
    return 2 * np.arctan((-B + np.array([root, -root])) / (D - A))


def trig_rows() -> list[str]:
    solvers: dict[str, Solver] = {
        "quadratic formula": quadratic,
        "`solve_trig`": lambda row: spatial.solve_trig(*row)[0],
    }
    lines = [
        f"| equations, 60 each | solutions | {' | '.join(solvers)} |",
        "| --- " * (len(solvers) + 2) + "|",
    ]
    for name, rows in trig_families(np.random.default_rng(1)).items():
        references = [trig_reference(row) for row in rows]
        cells = [worst(solver, rows, references) for solver in solvers.values()]
        lines.append(f"| {name} | {sum(map(len, references))} | {' | '.join(cells)} |")
    return lines


# pairs ---------------------------------------------------------------------------------------------------


def basis(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def through(M: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Change the least so that the equations hold at these angles, (n, k)."""
    u, v = basis(first), basis(second)
    points = np.einsum("nki,nkj->nkij", u, v).reshape(len(M), first.shape[1], 9)
    flat = M.reshape(len(M), 2, 9)
    gram = points @ np.swapaxes(points, 1, 2)
    weights = np.linalg.solve(gram, points @ np.swapaxes(flat, 1, 2))
    return (flat - np.swapaxes(weights, 1, 2) @ points).reshape(M.shape)


def loop_equations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Z_512 = c34 and its dual part in θ1, θ2, of RRRCC loops that close, fitted to the bilinear form."""
    made = []
    theta = rng.uniform(-3, 3, (9, 2))
    products = np.einsum("ni,nj->nij", basis(theta[:, 0]), basis(theta[:, 1])).reshape(9, 9)
    while len(made) < count:
        alpha, a, offset = rng.uniform(0.4, 2.7, 5), rng.uniform(0.5, 2, 5), rng.uniform(-1, 1, 5)
        angles = np.zeros((9, 5))
        angles[:, :2], angles[:, 4] = theta, rng.uniform(-3, 3)
        value, dual = spatial.secondary_notation("Z_512", alpha, angles, a, offset)
        rows = np.stack([value - np.cos(alpha[2]), dual + a[2] * np.sin(alpha[2])])
        made.append(np.linalg.solve(products, rows.T).T.reshape(2, 3, 3))
    return np.array(made)


def pair_families(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rows of M, (n, 2, 3, 3)."""
    plain = rng.normal(size=(40, 2, 3, 3))
    one, two = rng.uniform(-3, 3, (2, 40, 1))
    apart = np.concatenate([one, one + 1e-4], axis=1)
    return {
        "N(0, 1)": plain,
        "times 10^U(−3, 3)": plain * 10.0 ** rng.uniform(-3, 3, plain.shape),
        "θ₁ within 1e-10 of π": through(plain, np.full((40, 1), np.pi - 1e-10), two),
        "two solutions 1e-4 apart": through(plain, apart, np.concatenate([two, two + 0.7e-4], axis=1)),
        "loops RRRCC": loop_equations(rng, 40),
    }


def by_coefficients(M: np.ndarray) -> np.ndarray:
    """The method as it is printed: coefficients of the octic in x1, its roots, x2 from a quotient."""
    tangent = np.array(
        [[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]]
    )  # (1 + x²) (1, cos, sin) by powers of x
    E = np.einsum("bj,ai,eij->eba", tangent, tangent, M)  # equation, power of x2, power of x1

    def bracket(i: int, j: int) -> np.ndarray:
        return np.convolve(E[0, i], E[1, j]) - np.convolve(E[1, i], E[0, j])

    pq, pr, qr = bracket(2, 1), bracket(2, 0), bracket(1, 0)
    roots = np.roots((np.convolve(pr, pr) - np.convolve(pq, qr))[::-1])
    x1 = roots[np.abs(roots.imag) < 1e-6 * (1 + np.abs(roots) ** 2)].real
    x2 = -np.polyval(pr[::-1], x1) / np.polyval(pq[::-1], x1)
    return 2 * np.arctan(np.column_stack([x1, x2]))


def pair_rows() -> list[str]:
    solvers: dict[str, Solver] = {"coefficients and roots": by_coefficients}
    for method in ("fast", "sylvester"):
        solvers[f'`method="{method}"`'] = lambda M, method=method: np.column_stack(
            spatial.solve_pair(M, method=method)[:2]
        )
    lines = [f"| pairs, 40 each | solutions | {' | '.join(solvers)} |", "| --- " * (len(solvers) + 2) + "|"]
    for name, rows in pair_families(np.random.default_rng(2)).items():
        references = [all_angles(M) for M in rows]
        cells = [worst(solver, rows, references) for solver in solvers.values()]
        lines.append(f"| {name} | {sum(map(len, references))} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for key, lines in (("trig", trig_rows()), ("pairs", pair_rows())):
        start, end = f"<!-- {key}: make_spatial_accuracy.py -->\n", f"<!-- end of {key} -->"
        head, rest = text.split(start)
        text = f"{head}{start}{chr(10).join(lines)}\n{end}{rest.split(end)[1]}"
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
