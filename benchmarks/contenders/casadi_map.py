"""CasADi: the function mapped over N, by its virtual machine and as generated C."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
from problem import Problem

from contenders import native
from contenders.base import Contender


def _function():
    import casadi as ca

    rho, rho_prime, angle = ca.SX.sym("rho", 3), ca.SX.sym("rho_prime", 3), ca.SX.sym("angle")
    r, m = rho_prime - rho, rho_prime + rho
    kappa, m_squared = 1 / ca.tan(angle / 2), ca.dot(m, m)
    normal = kappa / m_squared * ca.cross(m, r)
    along = ca.sqrt(ca.fmax(m_squared - kappa**2 * ca.dot(r, r), 0)) / m_squared * m
    axes = ca.vertcat(normal + along, normal - along)
    return ca.Function("solve_axis", [rho, rho_prime, angle], [axes], {"cse": True})


def virtual_machine() -> Contender:
    function = _function()

    def bind(problem: Problem):
        mapped = function.map(len(problem)) if len(problem) > 1 else function
        # The buffer interface works on the arrays where they are: (N, 3) in C order is CasADi's 3 x N.
        buffer, trigger = mapped.buffer()
        for position, array in enumerate((problem.rho, problem.rho_prime, problem.angle)):
            buffer.set_arg(position, memoryview(np.ascontiguousarray(array)))
        buffer.set_res(0, memoryview(problem.axes))

        def call() -> None:
            trigger()

        call.keep_alive = (mapped, buffer)
        return call

    return Contender("CasADi map (VM)", "C/C++", bind, "buffer interface, no copies", 1_000_000)


def _generated(fast: bool) -> Contender:
    function = _function()
    with tempfile.TemporaryDirectory() as folder:
        before = Path.cwd()
        os.chdir(folder)  # CasADi writes into the current folder only
        try:
            function.generate("solve_axis.c")
            code = Path("solve_axis.c").read_text()
        finally:
            os.chdir(before)
    loop = (
        f"\nvoid {native.LOOP_SIGNATURE} {{\n"
        "  for (long i = 0; i < n; ++i) {\n"
        "    const casadi_real* arg[3] = {rho + 3 * i, rho_prime + 3 * i, angle + i};\n"
        "    casadi_real* res[1] = {axes + 6 * i};\n"
        "    casadi_f0(arg, res, 0, 0, 0);\n"
        "  }\n}\n"
    )
    return native.contender("CasADi generated C", code + loop, "c", "inlined in a loop over N", fast=fast)


def generated() -> Contender:
    return _generated(fast=False)


def generated_fast() -> Contender:
    return _generated(fast=True)


FACTORIES = (virtual_machine, generated, generated_fast)
