"""General solvers: what one does without a closed form (and, last, with half of one).

fsolve, least_squares and Newton solve the square system

    F(e) = r/|m| - tan(chi/2) e x m̂ + (|e|^2 - 1) m̂ = 0.

r is perpendicular to m, so the part along m̂ is |e| = 1 and the rest is r = tan(chi/2) e x m:
three equations for three unknowns, without the antipodal root that squaring would bring in.
Each gets the analytic Jacobian tan(chi/2) [m̂]x + 2 m̂ e^T and, as starts, (n̂ ± m̂)/sqrt(2)
with n̂ = m̂ x r̂, one in the basin of each axis.
"""

from __future__ import annotations

import math

import numpy as np
from problem import Problem

from contenders.base import Contender, columns

SQRT_HALF = math.sqrt(0.5)


def _system(rho: np.ndarray, rho_prime: np.ndarray, angle: float):
    r, m = rho_prime - rho, rho_prime + rho
    m_length = math.sqrt(m @ m)
    bisector, offset, t = m / m_length, r / m_length, math.tan(angle / 2)
    mx, my, mz = bisector
    twist = t * np.array([[0.0, -mz, my], [mz, 0.0, -mx], [-my, mx, 0.0]])
    double = 2 * bisector

    def residual(e: np.ndarray) -> np.ndarray:
        return offset + twist @ e + (e @ e - 1) * bisector

    def jacobian(e: np.ndarray) -> np.ndarray:
        return twist + double[:, None] * e

    normal = np.array(
        [my * offset[2] - mz * offset[1], mz * offset[0] - mx * offset[2], mx * offset[1] - my * offset[0]]
    )
    normal *= SQRT_HALF / math.sqrt(normal @ normal)
    return residual, jacobian, (normal + SQRT_HALF * bisector, normal - SQRT_HALF * bisector)


def fsolve() -> Contender:
    from scipy.optimize import fsolve

    def bind(problem: Problem):
        def call() -> None:
            rows = zip(problem.rho, problem.rho_prime, problem.angle, problem.axes, strict=True)
            for rho, rho_prime, angle, axes in rows:
                residual, jacobian, starts = _system(rho, rho_prime, float(angle))
                for axis, start in zip(axes, starts, strict=True):
                    axis[:] = fsolve(residual, start, fprime=jacobian, xtol=1e-14)

        return call

    return Contender("SciPy fsolve", "Python loop", bind, "two starts, analytic Jacobian")


def least_squares() -> Contender:
    from scipy.optimize import least_squares

    def bind(problem: Problem):
        def call() -> None:
            rows = zip(problem.rho, problem.rho_prime, problem.angle, problem.axes, strict=True)
            for rho, rho_prime, angle, axes in rows:
                residual, jacobian, starts = _system(rho, rho_prime, float(angle))
                for axis, start in zip(axes, starts, strict=True):
                    axis[:] = least_squares(
                        residual, start, jac=jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14
                    ).x

        return call

    return Contender("SciPy least_squares", "Python loop", bind, "method='lm', two starts, analytic Jacobian")


def _newton_block(problem: Problem) -> None:
    rho, rho_prime = columns(problem.rho), columns(problem.rho_prime)
    r, m = rho_prime - rho, rho_prime + rho
    inverse = 1 / np.sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    r *= inverse
    m *= inverse
    t = np.tan(problem.angle / 2)
    mx, my, mz = m
    normal = np.stack([my * r[2] - mz * r[1], mz * r[0] - mx * r[2], mx * r[1] - my * r[0]])
    normal *= SQRT_HALF / np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for row, sign in enumerate((SQRT_HALF, -SQRT_HALF)):
        x, y, z = normal + sign * m
        for _ in range(50):
            excess = x * x + y * y + z * z - 1
            fx = r[0] + t * (my * z - mz * y) + excess * mx
            fy = r[1] + t * (mz * x - mx * z) + excess * my
            fz = r[2] + t * (mx * y - my * x) + excess * mz
            # Columns a, b, c of the Jacobian, and Cramer's rule: far faster than LAPACK on 3x3.
            x2, y2, z2 = 2 * x, 2 * y, 2 * z
            ax, ay, az = mx * x2, t * mz + my * x2, -t * my + mz * x2
            bx, by, bz = -t * mz + mx * y2, my * y2, t * mx + mz * y2
            cx, cy, cz = t * my + mx * z2, -t * mx + my * z2, mz * z2
            bcx, bcy, bcz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
            scale = -1 / (ax * bcx + ay * bcy + az * bcz)
            dx = (fx * bcx + fy * bcy + fz * bcz) * scale
            fax, fay, faz = fy * az - fz * ay, fz * ax - fx * az, fx * ay - fy * ax
            dy = -(cx * fax + cy * fay + cz * faz) * scale
            dz = (bx * fax + by * fay + bz * faz) * scale
            x, y, z = x + dx, y + dy, z + dz
            if max(np.abs(dx).max(), np.abs(dy).max(), np.abs(dz).max()) < 1e-10:
                break  # quadratic: the step after one of 1e-10 would be 1e-20
        problem.axes[:, row, 0], problem.axes[:, row, 1], problem.axes[:, row, 2] = x, y, z


def newton() -> Contender:
    note = "Cramer's rule, blocks of 4096, two starts"
    return Contender("batched Newton (NumPy)", "NumPy", Contender.blocked(4096, _newton_block), note)


def find_root() -> Contender:
    from scipy.optimize import elementwise

    def residual(beta, along, across):
        return along * np.cos(beta) - across

    def solve(problem: Problem) -> None:
        r, m = problem.rho_prime - problem.rho, problem.rho_prime + problem.rho
        r_length, m_length = (np.sqrt(np.einsum("ij,ij->i", v, v)) for v in (r, m))
        half = problem.angle / 2
        arguments = (np.sin(half) * m_length, np.cos(half) * r_length)
        zero = np.zeros(len(problem))
        beta = elementwise.find_root(residual, (zero, zero + np.pi / 2), args=arguments).x
        normal = np.cross(m, r) * (np.cos(beta) / (m_length * r_length))[:, None]
        bisector = m * (np.sin(beta) / m_length)[:, None]
        np.add(normal, bisector, out=problem.axes[:, 0])
        np.subtract(normal, bisector, out=problem.axes[:, 1])

    note = "the axis' angle about r in (0, pi/2); the second axis by symmetry; blocks of 16384"
    return Contender("SciPy elementwise.find_root", "NumPy", Contender.blocked(16384, solve), note)


def ssik_loop() -> Contender:
    from ssik.subproblems import sp4

    def bind(problem: Problem):
        def call() -> None:
            rows = zip(problem.rho, problem.rho_prime, problem.angle, problem.axes, strict=True)
            for rho, rho_prime, angle, axes in rows:
                r, m = rho_prime - rho, rho_prime + rho
                r_length, m_length = math.sqrt(r @ r), math.sqrt(m @ m)
                r /= r_length
                m /= m_length
                normal = np.array(
                    [m[1] * r[2] - m[2] * r[1], m[2] * r[0] - m[0] * r[2], m[0] * r[1] - m[1] * r[0]]
                )
                height = r_length / (m_length * math.tan(angle / 2))
                solutions, _ = sp4.solve(normal, r, m, height)
                for axis, theta in zip(axes, solutions, strict=False):
                    # r x m = -normal, and m is perpendicular to r: Rot(r, theta) m.
                    axis[:] = math.cos(theta) * m - math.sin(theta) * normal

        return call

    note = "sp4.solve(n̂, r̂, m̂, cot(chi/2)|r|/|m|): turn m̂ about r̂"
    return Contender("ssik subproblem 4", "Python loop", bind, note)


def ssik_batch() -> Contender:
    from ssik.solvers.seven_r.spherical_shoulder import _sp4_batch

    def solve(problem: Problem) -> None:
        r, m = problem.rho_prime - problem.rho, problem.rho_prime + problem.rho
        r_length, m_length = (np.sqrt(np.einsum("ij,ij->i", v, v)) for v in (r, m))
        r /= r_length[:, None]
        m /= m_length[:, None]
        normal = np.cross(m, r)
        height = r_length / (m_length * np.tan(problem.angle / 2))
        theta, _ = _sp4_batch(normal, r, m, height, 1e-9, 1e-9)
        np.multiply(np.cos(theta)[:, :, None], m[:, None], out=problem.axes)
        np.subtract(problem.axes, np.sin(theta)[:, :, None] * normal[:, None], out=problem.axes)

    note = "its private vectorised form, blocks of 4096"
    return Contender("ssik subproblem 4 (batch)", "NumPy", Contender.blocked(4096, solve), note)


FACTORIES = (fsolve, least_squares, newton, find_root, ssik_loop, ssik_batch)
