"""wrenfold: C++ generated here, compiled, in a loop over N."""

from __future__ import annotations

import functools

from environments import PEERS

from contenders import native
from contenders.base import Contender, UnavailableError

LOOP = f"""
extern "C" void {native.LOOP_SIGNATURE} {{
  constexpr auto three = wf::make_constant_value_pack<3, 1>();
  constexpr auto column = wf::make_constant_value_pack<1, 3>();
  for (long i = 0; i < n; ++i) {{
    gen::solve_axis<double>(wf::make_span(rho + 3 * i, three, column),
                            wf::make_span(rho_prime + 3 * i, three, column), angle[i],
                            wf::make_span(axes + 6 * i, wf::make_constant_value_pack<2, 3>(),
                                          wf::make_constant_value_pack<3, 1>()));
  }}
}}
"""


@functools.cache
def _source() -> tuple[str, tuple]:
    from wrenfold import code_generation, sym
    from wrenfold.type_annotations import FloatScalar, Vector3

    def solve_axis(rho, rho_prime, angle):
        r, m = rho_prime - rho, rho_prime + rho
        kappa, m_squared = 1 / sym.tan(angle / 2), (m.T * m)[0]
        cross = sym.vector(m[1] * r[2] - m[2] * r[1], m[2] * r[0] - m[0] * r[2], m[0] * r[1] - m[1] * r[0])
        normal = cross * (kappa / m_squared)
        along = m * (sym.sqrt(sym.max(m_squared - kappa**2 * (r.T * r)[0], 0)) / m_squared)
        axes = sym.vstack([(normal + along).T, (normal - along).T])
        return [code_generation.OutputArg(axes, name="axes")]

    # wrenfold reads the types as objects, which postponed annotations would hide from it.
    solve_axis.__annotations__ = {"rho": Vector3, "rho_prime": Vector3, "angle": FloatScalar}
    generator = code_generation.CppGenerator()
    code = code_generation.generate_function(solve_axis, generator=generator)
    headers = next(PEERS.rglob("wrenfold/span.h"), None)
    if headers is None:
        raise UnavailableError("wrenfold's run-time header span.h is not in its environment")
    return generator.apply_preamble(code, namespace="gen") + LOOP, (headers.parent, headers.parent.parent)


def _make(fast: bool) -> Contender:
    code, includes = _source()
    return native.contender(
        "wrenfold generated C++", code, "c++", "inlined in a loop over N", fast=fast, includes=includes
    )


def generated() -> Contender:
    return _make(fast=False)


def generated_fast() -> Contender:
    return _make(fast=True)


FACTORIES = (generated, generated_fast)
