"""SymForce: C++ generated in an environment of its own, compiled here, in a loop over N."""

from __future__ import annotations

import functools

from environments import BUILD, HERE, SYMFORCE, ensure, python_of, run, site_packages

from contenders import native
from contenders.base import Contender, UnavailableError

LOOP = f"""
#include "solve_axis.h"
extern "C" void {native.LOOP_SIGNATURE} {{
  using V3 = Eigen::Matrix<double, 3, 1>;
  using V6 = Eigen::Matrix<double, 6, 1>;
  for (long i = 0; i < n; ++i) {{
    Eigen::Map<V6>(axes + 6 * i) =
        sym::SolveAxis<double>(V3(rho + 3 * i), V3(rho_prime + 3 * i), angle[i]);
  }}
}}
"""


@functools.cache
def _source() -> tuple[str, tuple]:
    ensure(SYMFORCE, HERE / "requirements-symforce.txt")
    folder = BUILD / "symforce"
    run([python_of(SYMFORCE), HERE / "contenders" / "symforce_generate.py", folder])
    eigen = next(site_packages(SYMFORCE).glob("cmeel.prefix/include/eigen3"), None)
    if eigen is None:
        raise UnavailableError("Eigen's headers are not where cmeel-eigen puts them")
    code = next(folder.rglob("solve_axis.h")).read_text()
    return LOOP.replace('#include "solve_axis.h"', code), (eigen,)


def _make(fast: bool) -> Contender:
    code, includes = _source()
    return native.contender(
        "SymForce generated C++", code, "c++", "inlined in a loop over N", fast=fast, includes=includes
    )


def generated() -> Contender:
    return _make(fast=False)


def generated_fast() -> Contender:
    return _make(fast=True)


FACTORIES = (generated, generated_fast)
