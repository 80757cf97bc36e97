"""Runs inside .venv-symforce: writes the C++ of the compact form to the folder named on the command line."""

import sys

import symforce

symforce.set_epsilon_to_number(0)

import symforce.symbolic as sf  # noqa: E402
from symforce import codegen  # noqa: E402


def solve_axis(rho: sf.V3, rho_prime: sf.V3, angle: sf.Scalar) -> sf.V6:
    r, m = rho_prime - rho, rho_prime + rho
    kappa, m_squared = 1 / sf.tan(angle / 2), m.dot(m)
    normal = kappa / m_squared * m.cross(r)
    along = sf.sqrt(sf.Max(m_squared - kappa**2 * r.dot(r), 0)) / m_squared * m
    return sf.V6([*(normal + along), *(normal - along)])


codegen.Codegen.function(solve_axis, config=codegen.CppConfig()).generate_function(output_dir=sys.argv[1])
