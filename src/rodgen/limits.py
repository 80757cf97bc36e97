"""Limits on what an input or a tool may cost: they protect from damaged files, and lie far above what machines need."""

from __future__ import annotations

FILE = 1_000_000
"""Of a file that is read whole, B: machine, link table, constraints, covariance, hidden truth."""
NESTING = 50
"""Of names that dots join into a key of a TOML file, and of arrays in each other."""
FORMULA = 2000
"""Of a formula, characters."""
COMPILE = 600.0
"""Of one run of the compiler, s."""
NUMBER = 1e100
"""Of a number in a file: larger ones leave the range of a double when they are squared and summed."""
