"""Limits on what an input or a tool may cost: they protect from damaged files, and lie far above what machines need."""

from __future__ import annotations

from rodgen.errors import InputFileError

FILE = 1_000_000
"""Of a file that is read whole, B: machine, link table, constraints, covariance, hidden truth."""
NESTING = 50
"""Of names that dots join into a key of a TOML file, and of arrays in each other."""
FORMULA = 2000
"""Of a formula, characters."""
CELLS = 1_000_000_000
"""Of the columns of measurements or pairs that a command keeps, of 8 B each."""
COMPILE = 600.0
"""Of one run of the compiler, s."""


def check_cells(file: str, cells: int) -> None:
    """Refuse a table of which a command would keep more cells than the limit.

    Raises
    ------
    InputFileError
    """
    if cells > CELLS:
        raise InputFileError(file, "file", f"more than {CELLS:g} cells", f"at most {CELLS:g} cells")
