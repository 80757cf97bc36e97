"""A mechanism as a table for reading and typing: a row for each joint, with the link after it.

    joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]
    base,R,0,,,120,90
    slide,P,,30,,0,-90
    tool,R,15.5,,,,

A cell is empty where the joint has its variable, or where there is nothing: the link after the last joint of an open
chain. With the last link given the loop is closed.
"""

from __future__ import annotations

import math
import os
import re

import numpy as np
from numpy.typing import NDArray

from rodgen.files import write_file
from rodgen.kinematics.spatial.links.link_table_reader import read_link_table
from rodgen.kinematics.spatial.links.mechanism import Mechanism


def load_mechanism(path: str | os.PathLike[str]) -> Mechanism:
    """Return the mechanism of a link table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV (UTF-8, commas, decimal points) with the columns ``joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],
        alpha [deg]`` in any order and with any units; a pitch may be per revolution, ``pitch [mm/rev]``. `type` is R,
        P, C, H, E, T or S. An empty cell is a variable of the joint; `a` and `alpha` are of the link after the joint
        and empty after the last joint of an open chain. The columns `joint` (names), `S`, `theta` and `pitch` may be
        left out: a constant is then zero.

    Returns
    -------
    Mechanism
        Lengths in the unit of the first length column; its name is the file's, without the ending.

    Raises
    ------
    InputFileError
        When the file cannot be read or is not a link table: one sentence with line and column.

    Examples
    --------
    >>> import os, tempfile
    >>> from rodgen import spatial
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "puma.csv")
    ...     spatial.save_mechanism(path, spatial.PUMA_560)
    ...     puma = spatial.load_mechanism(path)
    >>> puma.name, puma.unit, puma.offset.tolist()
    ('puma', 'in', [0.0, 5.9, 0.0, 17.0, 0.0, 4.0])
    """
    return read_link_table(os.fspath(path))


def save_mechanism(path: str | os.PathLike[str], mechanism: Mechanism) -> None:
    """Write a mechanism as a link table, from which `load_mechanism` gets the same numbers.

    Parameters
    ----------
    path : str or os.PathLike
    mechanism : Mechanism

    Raises
    ------
    InputFileError
        When the place cannot be written.
    """
    write_file(path, link_table(mechanism).encode())


def link_table(mechanism: Mechanism) -> str:
    """Return the text of a mechanism's link table.

    Parameters
    ----------
    mechanism : Mechanism

    Returns
    -------
    str
        CSV. A column of angles is in degrees where that gives back every number to the last bit, else in rad.

    Examples
    --------
    >>> from rodgen import spatial
    >>> print(spatial.link_table(spatial.T3_776))
    joint,type,S [in],theta [deg],pitch [in/rad],a [in],alpha [deg]
    R1,R,0,,,0,90
    R2,R,0,,,44,0
    R3,R,0,,,0,90
    R4,R,55,,,0,61
    R5,R,0,,,0,61
    R6,R,6,,,,
    <BLANKLINE>
    """
    theta_unit, theta = _angle_cells(mechanism.angle)
    alpha_unit, alpha = _angle_cells(mechanism.alpha)
    offset, length = (list(map(_cell, values)) for values in (mechanism.offset, mechanism.a))
    pitch = [_cell(value) if value else "" for value in mechanism.pitch]
    units = {"S": mechanism.unit, "theta": theta_unit, "pitch": f"{mechanism.unit}/rad"}
    units |= {"a": mechanism.unit, "alpha": alpha_unit}
    out = [["joint", "type", *(f"{name} [{unit}]" for name, unit in units.items())]]
    for j, (name, kind) in enumerate(zip(mechanism.names, mechanism.joints, strict=True)):
        link = [length[j], alpha[j]] if j < len(length) else ["", ""]
        out.append([name, kind, offset[j], theta[j], pitch[j], *link])
    return "".join(",".join(map(_quoted, cells)) + "\n" for cells in out)


def _cell(value: float) -> str:
    if math.isnan(value):
        return ""
    return repr(float(value)).removesuffix(".0")


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if re.search('[",\n\r]', text) else text


def _angle_cells(values: NDArray[np.float64]) -> tuple[str, list[str]]:
    cells = []
    for value in values.tolist():
        near = math.degrees(value)
        candidates = [float(f"{near:.{digits}g}") for digits in (13, 15, 16, 17)]
        cell = next((x for x in candidates if math.isnan(x) or math.radians(x) == value), None)
        if cell is None:
            return "rad", [_cell(x) for x in values]
        cells.append(_cell(cell))
    return "deg", cells
