"""Whether data allow a diagnosis: the file is wrong, rows are too few, or parameters are not determined."""

from __future__ import annotations

import numpy as np

from rodgen.calibration.check import check
from rodgen.calibration.fit import Fit
from rodgen.calibration.problem.assembly_modes import weakest
from rodgen.errors import joined
from rodgen.machines.observations import Observations
from rodgen.stages import stage
from rodgen.statistics.thresholds import EVIDENCE


def why_undecidable(base: Fit) -> str:
    """Return why the data allow no answer; empty where they do.

    Parameters
    ----------
    base : Fit
        Without outliers.
    """
    with stage("checking the files"):
        wrong = check(base).sentence or why_wrong_geometry(base)
    if wrong:
        return wrong
    if base.degrees_of_freedom < EVIDENCE.fewest_residual_dof:
        return (
            f"Only {base.degrees_of_freedom} readings more than parameters that they determine; "
            f"a diagnosis needs at least {EVIDENCE.fewest_residual_dof}."
        )
    poses = len(np.unique(base.observations.pose[~base.outliers]))
    if poses < EVIDENCE.fewest_poses:
        return f"Only {poses} pose{'s' * (poses != 1)}; a diagnosis needs at least {EVIDENCE.fewest_poses}."
    unread = tuple(f"target.{name}." for name in unread_targets(base.observations))
    lacking = [
        d.text
        for d in base.determinacy.directions
        if not d.gauge and not d.still and not all(key.startswith(unread) for key, _ in d.parts)
    ]
    return " ".join(lacking[:3])


def unread_targets(o: Observations) -> list[str]:
    """Return the names of targets without a reading: where they are changes nothing here."""
    return [target.name for k, target in enumerate(o.machine.targets) if k not in o.target]


def on_unmoved_joints(base: Fit) -> list[str]:
    """Return a sentence on joints that never moved though parameters depend on that; nothing without any."""
    names = list(dict.fromkeys(name for d in base.determinacy.directions for name in d.still))
    if not names:
        return []
    moves, it = ("never moves", "it") if len(names) == 1 else ("never move", "they")
    return [
        f"{joined(names)} {moves} in these data: what {it} would determine of the machine is held near the file, and "
        f"effects that show only when {it} move{'s' * (it == 'it')} are not judged. Measure at other positions, too."
    ]


def why_wrong_geometry(base: Fit) -> str:
    """Return why a closed chain is far from what was measured; empty where it is not."""
    if base.problem.is_closed_chain and not base.solution.converged:
        row = weakest(base.observations)
        near = f", as in {base.observations.data.place(row)}" if row is not None else ""
        return f"The fit stopped where legs do not close: near a singular pose{near}, or far from the right geometry."
    return ""
