"""What makes a fit or a diagnosis take long, known before it begins."""

from __future__ import annotations

from rodgen.data.measurements import Measurements, Scan
from rodgen.machines.machine import Machine

MULTIPLICATIONS = 5e9
"""Of the normal equations; a fit does as many some ten times, a diagnosis a hundred times: half a minute and more."""
IN_A_DIAGNOSIS = MULTIPLICATIONS / 10
"""That a diagnosis takes more than ten seconds."""
JOINTS = 15
"""With more a diagnosis takes more than five seconds."""
TARGETS = 20
"""Up to as many are not why a model has many parameters."""
COLUMNS = 2000
"""Columns of the file; each is tried in some twenty functions at every sensitivity."""


def why_long(machine: Machine, data: Measurements | Scan, *, diagnosis: bool = False) -> str:
    """Return one sentence on what will take long, and how to spend less; empty where nothing does.

    Parameters
    ----------
    diagnosis : bool
        Whether effects and forms are looked for, too.
    """
    targets = [t for t in machine.targets if {"target", f"target.{t.name}"} & set(machine.estimate)]
    parameters = 3 * len(targets) + 4 * len(machine.joints)
    work = 3 * data.rows * parameters**2
    if work > (IN_A_DIAGNOSIS if diagnosis else MULTIPLICATIONS):
        how_long = "minutes" if work > MULTIPLICATIONS else "a while"
        if len(targets) <= TARGETS:
            return f"This takes {how_long}: there are {data.rows} rows, and some {parameters} parameters."
        return (
            f"This takes {how_long}: {len(targets)} targets of unknown position make some {parameters} parameters for "
            f"{data.rows} rows. Targets that [estimate] does not name keep the positions of the machine file."
        )
    if diagnosis and len(data.columns) > COLUMNS:
        return (
            f"This takes a while: each of {len(data.columns)} columns is tried as a cause. Leave out those that "
            "cannot be one."
        )
    if diagnosis and len(machine.joints) > JOINTS:
        return (
            f"This takes a while: the effects of {len(machine.joints)} joints are tried, alone and together. "
            "'rodgen add' tries a single one."
        )
    return ""
