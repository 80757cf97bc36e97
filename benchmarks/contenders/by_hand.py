"""Not a peer but a yardstick: the compact form in C by hand, as a plain loop over (N, 3) arrays."""

from __future__ import annotations

import dataclasses

from contenders import native
from contenders.base import YARDSTICK, Contender

LOOP = f"""
#include <math.h>
void {native.LOOP_SIGNATURE} {{
  for (long i = 0; i < n; ++i) {{
    const double *p = rho + 3 * i, *q = rho_prime + 3 * i;
    double r0 = q[0] - p[0], r1 = q[1] - p[1], r2 = q[2] - p[2];
    double m0 = q[0] + p[0], m1 = q[1] + p[1], m2 = q[2] + p[2];
    double kappa = 1 / tan(0.5 * angle[i]), square = m0 * m0 + m1 * m1 + m2 * m2;
    double under = square - kappa * kappa * (r0 * r0 + r1 * r1 + r2 * r2);
    double inverse = 1 / square, along = sqrt(under > 0 ? under : 0) * inverse, across = kappa * inverse;
    double n0 = across * (m1 * r2 - m2 * r1), n1 = across * (m2 * r0 - m0 * r2);
    double n2 = across * (m0 * r1 - m1 * r0);
    double* e = axes + 6 * i;
    e[0] = n0 + along * m0, e[1] = n1 + along * m1, e[2] = n2 + along * m2;
    e[3] = n0 - along * m0, e[4] = n1 - along * m1, e[5] = n2 - along * m2;
  }}
}}
"""


def _make(fast: bool) -> Contender:
    made = native.contender("C by hand", LOOP, "c", "a loop over N", fast=fast)
    return dataclasses.replace(made, family=YARDSTICK)


def strict() -> Contender:
    return _make(fast=False)


def fast() -> Contender:
    return _make(fast=True)


FACTORIES = (strict, fast)
