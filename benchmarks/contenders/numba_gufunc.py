"""Numba: the compact form written out by hand, compiled by guvectorize for one thread."""

from __future__ import annotations

import math

import numpy as np
from problem import Problem

from contenders.base import Contender


def _axes(rho, rho_prime, angle, two, axes):
    r0, r1, r2 = rho_prime[0] - rho[0], rho_prime[1] - rho[1], rho_prime[2] - rho[2]
    m0, m1, m2 = rho_prime[0] + rho[0], rho_prime[1] + rho[1], rho_prime[2] + rho[2]
    kappa = 1 / math.tan(0.5 * angle)
    inverse = 1 / (m0 * m0 + m1 * m1 + m2 * m2)
    square = m0 * m0 + m1 * m1 + m2 * m2 - kappa * kappa * (r0 * r0 + r1 * r1 + r2 * r2)
    along = math.sqrt(max(square, 0.0)) * inverse
    across = kappa * inverse
    n0, n1, n2 = across * (m1 * r2 - m2 * r1), across * (m2 * r0 - m0 * r2), across * (m0 * r1 - m1 * r0)
    m0, m1, m2 = along * m0, along * m1, along * m2
    axes[0, 0], axes[0, 1], axes[0, 2] = n0 + m0, n1 + m1, n2 + m2
    axes[1, 0], axes[1, 1], axes[1, 2] = n0 - m0, n1 - m1, n2 - m2


def _make(fastmath: bool) -> Contender:
    import numba

    signature = [
        (numba.float64[::1], numba.float64[::1], numba.float64, numba.float64[::1], numba.float64[:, ::1])
    ]
    types = [numba.void(*signature[0])]
    # An output dimension must occur among the inputs: `two` is a dummy of length 2.
    function = numba.guvectorize(types, "(n),(n),(),(k)->(k,n)", nopython=True, fastmath=fastmath)(_axes)
    two = np.zeros(2)

    def bind(problem: Problem):
        return lambda: function(problem.rho, problem.rho_prime, problem.angle, two, problem.axes)

    name = "Numba guvectorize" + (", fastmath" if fastmath else "")
    return Contender(name, "JIT", bind, "contiguous signature, out given, one thread", strict=not fastmath)


def strict() -> Contender:
    return _make(fastmath=False)


def fast() -> Contender:
    return _make(fastmath=True)


FACTORIES = (strict, fast)
