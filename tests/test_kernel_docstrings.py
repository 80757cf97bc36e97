"""Docstrings of functions over a kernel say what the kernel's ports are."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import rodgen.generated
import rodgen.kinematics
from rodgen.generated import numpy as generated
from rodgen.kinematics.ports import documented_by

HEADERS = "\n".join(
    path.read_text(encoding="utf-8")
    for path in sorted((Path(rodgen.generated.__file__).parent / "c").glob("*.h"))
)


def ports(kernel: str) -> dict[str, tuple[str, str]]:
    """Shape and unit of each port by its name, from the comment of the C function."""
    module = getattr(generated.ALL, kernel).__module__.rpartition(".")[2]
    (comment,) = re.findall(rf"/\*((?:(?!/\*).)*?)\*/\nvoid {module}_{kernel}_f64\(", HEADERS, re.DOTALL)
    rows = re.findall(r"^ \* (\w+)(?: \(([\d, ]+)\))?, ([^:]*): ", comment, re.MULTILINE)
    return {name: (f"(..., {shape})" if shape else "(...)", unit) for name, shape, unit in rows}


def test_own_words_follow_those_of_the_kernel():
    def kernel():
        """Double a length.

        Source: a ruler

        Parameters
        ----------
        x : array (..., 3), length
            three lengths

        Returns
        -------
        y : array (...), length
            their sum
        status : int8 array (...), codes of Kind
            what it is
        """

    @documented_by(kernel)
    def function(x, *, unit="m"):
        """Return twice the sum.

        Parameters
        ----------
        x
            Not negative.
        unit : str, optional
            The unit.
        """

    assert inspect.getdoc(function) == "\n".join(
        [
            *("Return twice the sum.", "", "Parameters", "----------"),
            *("x : array_like (..., 3), length", "    Three lengths. Not negative."),
            *("unit : str, optional", "    The unit.", "", "Returns", "-------"),
            *("y : array (...), length", "    Their sum."),
            *("status : int8 array (...)", "    What it is: codes of :class:`Kind`.", "", "Raises", "------"),
            "ValueError",
            "    When shapes do not broadcast, or the last axes of an argument are others than those above.",
            *("TypeError", "    When an argument is not real.", "", "Notes", "-----"),
            "Source: a ruler; proved in the derivation ``test_kernel_docstrings``.",
        ]
    )


def test_without_docstrings_functions_stay_as_they_are():
    def kernel():
        pass

    function = documented_by(kernel)(lambda x: x)
    assert (function(2), function.__doc__) == (2, None)
