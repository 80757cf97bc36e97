"""Limits on what an input or a tool may cost, each with a name; the environment variable ``RODGEN_LIMITS`` raises them.

They protect from files that are damaged or made to harm, and lie far above what a machine needs. An error names the
limit that was met: ``RODGEN_LIMITS="file=1e8,compile=1200"`` then lets it pass.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from rodgen.errors import InputFileError, listed, shown

VARIABLE = "RODGEN_LIMITS"


@dataclass(frozen=True)
class Limit:
    """What is limited, to how much, and in which unit."""

    usual: float
    unit: str
    of: str


LIMITS = {
    "file": Limit(
        1_000_000,
        "B",
        "a file that is read whole: machine, link table, constraints, covariance, hidden truth",
    ),
    "nesting": Limit(50, "", "names that dots join into a key of a TOML file, and arrays in each other"),
    "formula": Limit(2000, "characters", "a formula"),
    "cells": Limit(
        1_000_000_000, "cells", "the columns of measurements or pairs that a command keeps, of 8 B each"
    ),
    "compile": Limit(120, "s", "one run of the compiler"),
}


def limit(name: str) -> float:
    """Return a limit: its usual value, or what ``RODGEN_LIMITS`` gives.

    Raises
    ------
    InputFileError
        When ``RODGEN_LIMITS`` is not of the form ``NAME=NUMBER,NAME=NUMBER``.
    """
    value = LIMITS[name].usual
    for item in filter(None, os.environ.get(VARIABLE, "").split(",")):
        key, _, text = (part.strip() for part in item.partition("="))
        if key not in LIMITS:
            raise InputFileError("environment", VARIABLE, shown(item), f"NAME=NUMBER, of {listed(LIMITS)}")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not number > 0:
            raise InputFileError("environment", VARIABLE, shown(item), "a number above 0, such as file=1e7")
        if key == name:
            value = number
    return value


def hint(name: str) -> str:
    """Return how to raise a limit, for the end of an error message."""
    return (
        f"at most {limit(name):g} {LIMITS[name].unit}".rstrip() + f" ({VARIABLE}={name}=NUMBER raises that)"
    )


def check_cells(file: str, cells: int) -> None:
    """Refuse a table of which a command would keep more cells than the limit.

    Raises
    ------
    InputFileError
    """
    if cells > limit("cells"):
        raise InputFileError(file, "file", f"more than {limit('cells'):g} cells", hint("cells"))
