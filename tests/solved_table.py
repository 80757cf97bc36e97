"""Both axes of every pair of a table: what the tests of tables and of their files compute."""

import numpy as np

from rodgen.data.tables import PAIR_COLUMNS, Result, map_table
from rodgen.kinematics.axis import AxisStatus, axis_condition, length_mismatch, solve_axis

RESULTS = [
    *(Result(f"e{root}_{axis}", "number") for root in (1, 2) for axis in "xyz"),
    Result("status", AxisStatus),
    Result("length_mismatch", "number"),
    Result("condition", "number"),
]


def solve_table(path, output=None, **options):
    """Write the table with both axes, their status, and what `length_mismatch` and `axis_condition` say."""

    def solve(values):
        rho, rho_prime, angle = np.column_stack(values[:3]), np.column_stack(values[3:6]), values[6]
        axes, status = solve_axis(rho, rho_prime, angle, **options)
        numbers = length_mismatch(rho, rho_prime), axis_condition(rho, rho_prime, angle)
        return [*axes.reshape(-1, 6).T, status, *numbers], None

    return map_table(path, output, PAIR_COLUMNS, lambda unit: (RESULTS, solve))
