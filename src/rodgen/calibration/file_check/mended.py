"""Write the measurements that a repair makes of others."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.attitudes import attitude_numbers
from rodgen.data.observations import Observations
from rodgen.data.tables.writer import write_columns
from rodgen.data.units import parse_unit
from rodgen.machines.measured import TURNS


def write_mended_data(mended: Observations, observations: Observations, path: str | os.PathLike[str]) -> None:
    """Write the table of mended observations; what was not changed keeps its digits.

    Parameters
    ----------
    mended, observations : Observations
        After and before the change.
    path : str or os.PathLike
        Ends in ``.csv``, ``.csv.gz`` or ``.parquet``.

    Raises
    ------
    InputFileError
        When it cannot be written.
    """
    machine, data = observations.machine, mended.data
    changed: dict[str, NDArray[np.float64]] = {}
    for j, joint in enumerate(machine.joints):
        changed[joint.column] = mended.q[:, j]
        changed[f"v_{joint.column}"] = mended.v[:, j]
        changed[f"dir_{joint.column}"] = mended.s[:, j].astype(float)
    for i, name in enumerate(machine.measurand.columns):
        if i < mended.reading.shape[1]:
            changed[name] = mended.reading[:, i]
        if mended.sigma is not None:
            changed[f"u_{name}"] = mended.sigma[:, i] / (mended.arm if name in TURNS else 1.0)
    if mended.attitude is not None:
        changed |= attitude_numbers(mended.attitude, data)
    columns: dict[str, Any] = {}
    for name, column in data.columns.items():
        values = column.values
        if name in changed:
            factor = parse_unit(column.unit).factor(machine.length_unit) if column.unit else 1.0
            new = np.array([float(f"{x:.12g}") for x in changed[name] / factor])
            if not np.allclose(new, values, rtol=1e-11, atol=0):
                values = new
        columns[column.text] = values
    write_columns(path, columns)
