"""Whether data allow a diagnosis: file or bounds are wrong, rows too few, or parameters not determined."""

from __future__ import annotations

import math

import numpy as np

from rodgen.calibration.check import check
from rodgen.calibration.dependence import FitRows
from rodgen.calibration.fit import Fit
from rodgen.calibration.geometry import with_geometry
from rodgen.calibration.problem.assembly_modes import weakest
from rodgen.calibration.words import comparison, fall
from rodgen.errors import counted, joined
from rodgen.machines.observations import Observations
from rodgen.machines.parameters import parameters_of
from rodgen.machines.plausibility import kind_of_machine
from rodgen.stages import stage
from rodgen.statistics.thresholds import COST, EVIDENCE


def why_undecidable(base: Fit, *, checked: bool = False) -> str:
    """Return why the data allow no answer; empty where they do.

    Parameters
    ----------
    base : Fit
        Without outliers.
    checked : bool
        Whether the files were checked before, which does not depend on the outliers.
    """
    with stage("checking the files"):
        wrong = "" if checked else check(base).sentence
    if wrong := wrong or why_wrong_geometry(base):
        return wrong
    if base.degrees_of_freedom < EVIDENCE.fewest_residual_dof:
        return (
            f"The degrees of freedom are {base.degrees_of_freedom}, readings less parameters; "
            f"a diagnosis needs at least {EVIDENCE.fewest_residual_dof}."
        )
    poses = len(np.unique(base.observations.pose[~base.outliers]))
    if poses < EVIDENCE.fewest_poses:
        return f"Only {counted(poses, 'pose')}; a diagnosis needs at least {EVIDENCE.fewest_poses}."
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


def on_few_poses(base: Fit) -> list[str]:
    """Return a sentence where poses are too few to show wrong dimensions of a robot; nothing where they are not."""
    machine = base.machine
    calibrated = with_geometry(machine) if kind_of_machine(machine) == "robot" else None
    if calibrated is None:
        return []
    runs, poses = base.observations.run_names, len(np.unique(base.observations.pose[~base.outliers]))
    before, after = (len(parameters_of(one, one.structure, runs)) for one in (machine, calibrated))
    if base.degrees_of_freedom - (after - before) >= EVIDENCE.fewest_residual_dof:
        return []
    return [
        f"Whether the dimensions are those of the file {poses} poses cannot show: estimated ones are "
        f"{after - before} numbers more. Measure at more postures."
    ]


def why_wrong_geometry(base: Fit) -> str:
    """Return why a closed chain is far from what was measured; empty where it is not."""
    if base.problem.is_closed_chain and not base.solution.converged:
        row = weakest(base.observations)
        near = f", as in {base.observations.data.place(row)}" if row is not None else ""
        return f"The fit stopped where legs do not close: near a singular pose{near}, or far from the right geometry."
    return ""


# bounds of the machine file


def are_wrong(bounded: Fit, freed: Fit) -> bool:
    """Return whether the readings contradict bounds: it is likelier that the file is wrong there.

    Parameters
    ----------
    bounded, freed : Fit
        With bounds that hold it, and the same without these.
    """
    held = sum(bool(e.at_bound) for e in bounded.estimates.values())
    return cost_of_bounds(bounded, freed) > 2 * COST.impossible * held


def cost_of_bounds(bounded: Fit, freed: Fit) -> float:
    """Return by how much the bounds raise -2 ln of the likelihood, with the noise that the readings show."""
    correlation = freed.dependence.correlation

    residuals = [FitRows.of(fit).residual for fit in (bounded, freed)]
    before, after = (float((correlation.whiten(r[:, :, None]) ** 2).sum()) for r in residuals)
    count = min(freed.degrees_of_freedom, residuals[1].size)
    if count < 1 or not before > after:
        return 0.0
    return count * math.log(before / after) if after > 0 else math.inf


def held_at_bounds(bounded: Fit, freed: Fit) -> str:
    """Return a sentence on bounds that hold a fit, and what they cost.

    Parameters
    ----------
    bounded, freed : Fit
        With bounds that hold it, and the same without these.
    """
    held = [e for e in bounded.estimates.values() if e.at_bound]
    units = ["" if e.unit == "1" else f" {e.unit}" for e in held]
    names = joined([e.key for e in held])
    ends = joined([f"{e.value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    free = joined([f"{freed.estimates[e.key].value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    is_held, it = ("is held at its bound", "it") if len(held) == 1 else ("are held at their bounds", "these")
    odds = math.exp(min(cost_of_bounds(bounded, freed) / 2, 100.0))
    error = fall(bounded.rms, freed.rms, bounded.unit)
    return (
        f"{names} {is_held}, {ends}; without {it} the error {error}, with {names} = {free}, and the readings are "
        f"{comparison(odds)}."
    )
