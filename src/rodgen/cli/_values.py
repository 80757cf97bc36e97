"""Read the values of options: numbers within limits, and quantities with their unit."""

from __future__ import annotations

import argparse
import contextlib
import math
import re
from collections.abc import Callable
from typing import Literal, NamedTuple

from rodgen.errors import UnexpectedError, in_file, shown

_NUMBERS = r"\s*([-+.,\deE\s]*\d\.?)\s*([^\d\s,.+-].*?)\s*"


class InputFile(str):
    """The name of a file that is read, or of a folder or pattern of such."""


class OutputFile(str):
    """The name of a file that is written, or of a new folder."""


class OutputTable(OutputFile):
    """The name of a table that is written; '-' is standard output."""


class OutputFolder(str):
    """The name of a folder that files are written into; it may be there."""


class EditedMachine(OutputFile):
    """The name of a machine file that is written, which may be MACHINE itself."""


class StateFile(OutputFile):
    """The name of a file that is read where it is there, and written again."""


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return the reader of a whole number from `low` to `high`, both included."""
    limits = f"from {low} up" if high is None else f"from {low} to {high}"

    def read(text: str) -> int:
        if text.isascii() and text.isdigit() and len(text) <= 18:
            value = int(text)
            if low <= value <= (math.inf if high is None else high):
                return value
        raise argparse.ArgumentTypeError(f"{shown(text)} is not a whole number {limits}")

    return read


def frequency(text: str) -> float:
    """Return how often something happens, per second, as ``1/year`` says it."""
    from rodgen.calibration.watch.watch import frequency as per_second

    try:
        return per_second(text)
    except UnexpectedError as error:
        raise argparse.ArgumentTypeError(f"{error.found} is not {error.expected}") from None


def number(expected: str, holds: Callable[[float], bool]) -> Callable[[str], float]:
    """Return the reader of a finite number for which `holds` is true; an error names what was `expected`."""

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            value = float(text)
            if math.isfinite(value) and holds(value):
                return value
        raise argparse.ArgumentTypeError(f"{shown(text)} is not {expected}")

    return read


class Quantity(NamedTuple):
    """Numbers with one unit, as they were typed."""

    numbers: tuple[float, ...]
    unit: str
    option: str
    """Where they were given, for error messages."""
    dimension: Literal["length", "angle"] = "length"

    def to(self, unit: str) -> tuple[float, ...]:
        """Return the numbers in another unit.

        Raises
        ------
        InputFileError
            When the unit that was typed is unknown or of another dimension.
        """
        from rodgen.data.units import conversion_factor

        with in_file("command line", self.option):
            factor = conversion_factor(self.unit, self.dimension, unit)
        return tuple(number * factor for number in self.numbers)


def quantity(
    option: str,
    example: str,
    count: int = 1,
    dimension: Literal["length", "angle"] = "length",
    *,
    positive: bool = False,
) -> Callable[[str], Quantity]:
    """Return the reader of `count` numbers with one unit behind them, such as ``0,0,50mm``.

    Parameters
    ----------
    option, example : str
        What error messages name.
    count : int
        How many numbers.
    positive : bool
        Whether each number must be greater than zero.
    """
    sign = "positive " if positive else ""
    if count == 1:
        article = "an" if dimension == "angle" and not positive else "a"
        expected = f"{article} {sign}{dimension} with its unit"
    else:
        expected = f"{count} {sign}{dimension}s with their unit"

    def read(text: str) -> Quantity:
        match = re.fullmatch(_NUMBERS, text)
        if match:
            with contextlib.suppress(ValueError):
                numbers = tuple(float(part) for part in match[1].split(","))
                if count == len(numbers) and all(
                    math.isfinite(x) and (x > 0 or not positive) for x in numbers
                ):
                    return Quantity(numbers, match[2], option, dimension)
        raise argparse.ArgumentTypeError(f"{shown(text)} is not {expected}, such as {example}")

    return read
