"""What an import has made of a file, and the names that joints and targets get in a machine file."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.measurements import Measurements
from rodgen.machines.files.schema import JOINT_NAME, PLACE_NAME
from rodgen.machines.files.toml import UnfitError
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine
from rodgen.machines.parts import Vector
from rodgen.views import brief, html_of


@dataclass(frozen=True)
class Imported:
    """A machine that was made of another file, and readings where it has any.

    Attributes
    ----------
    machine : Machine
    notes : tuple of str
        What was taken for what, and what was not taken: a sentence each.
    columns : mapping of str to sequence
        Of a measurement file, by names with units; empty where there are no readings.
    source : str
        The file of the readings, or the files.
    places : sequence of str
        Of the rows of `columns` in that file, such as ``"line 17"``, where they are known.
    is_given : bool
        Whether the machine is that of a machine file, with readings in another form.
    """

    machine: Machine
    notes: tuple[str, ...]
    columns: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    places: Sequence[str] = ()
    is_given: bool = False

    __repr__ = brief
    _repr_html_ = html_of

    def __post_init__(self) -> None:
        """Keep each note in one line, so that what it quotes of a file ends no comment."""
        object.__setattr__(self, "notes", tuple(printable(note) for note in self.notes))

    @property
    def text(self) -> str:
        """The machine file, with the notes as comments above."""
        return "".join(f"# {note}\n" for note in self.notes) + machine_text(self.machine)

    def measurements(self) -> Measurements:
        """Return the readings, with their places in the file that they come from."""
        data = Measurements.from_frame(self.columns, name=self.source)
        parts = [place.rpartition(" ") for place in self.places]
        counted = {what for what, _, _ in parts}
        if len(counted) != 1:
            return data
        # rows of a workbook are counted from 1, those of a table in memory from 0
        what = {"row": "table row"}.get(*counted, *counted)
        return data.placed([int(number) for _, _, number in parts], what)

    def write_data(self, file: str) -> None:
        """Write the measurement file, in the form that the ending of its name says."""
        from rodgen.data.tables import write_columns

        write_columns(file, self.columns)


def clean(vector: NDArray[np.float64], digits: int) -> Vector:
    """Return three numbers without the rounding errors of the products that they come from."""
    x, y, z = (float(x) + 0.0 for x in vector.round(digits))
    return x, y, z


def one_line(text: str) -> str:
    """Return a title as a machine file may have it: at most 200 characters, all of which can be printed."""
    return printable(text)[:200].strip()


def printable(text: str) -> str:
    """Return a text with a blank for each character that cannot be printed, such as the end of a line."""
    return "".join(c if c.isprintable() else " " for c in text)


def machine_name(text: str, others: Collection[str] = (), *, joint: bool = False) -> str:
    """Return the name, as a machine file may have it, of what is called `text` elsewhere.

    Parameters
    ----------
    others : collection of str
        Names that are given already.
    joint : bool
        Whether it is a joint's, which is the name of a column of measurements, too.

    Examples
    --------
    >>> machine_name("arm/elbow.1"), machine_name("load", joint=True), machine_name("J1", ["J1"])
    ('arm_elbow_1', 'load_joint', 'J1_2')
    """
    kind = JOINT_NAME if joint else PLACE_NAME
    base = re.sub(r"[^\w+-]", "_", text).lstrip("_+-")[:50] or "unnamed"
    try:
        name = kind.read(base)
    except UnfitError:  # the name of an effect or of a column
        name = f"{base}_{'joint' if joint else 'target'}"
    number = 2
    while name in others:
        name, number = f"{base}_{number}", number + 1
    return str(name)
