"""What makes files suspicious: seen in a fit that was made anyway, or in the numbers of a machine alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rodgen.calibration.file_check.near_file import exchanged, motion, relative_corrections
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.problem.assembly_modes import other_mode
from rodgen.machines.effects.catalogue import SCALES
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model
from rodgen.statistics.thresholds import CHECK

__all__ = ["implausible_numbers", "suspicions"]


def suspicions(fit: FittedModel) -> Iterator[str]:
    """Yield what a right file hardly ever shows: no convergence, large corrections, errors that no physics makes.

    Parameters
    ----------
    fit : FittedModel
    """
    if mode := other_mode(fit.observations, fit.problem.model.machine):
        yield mode
    if not fit.solution.converged:
        yield "the fit does not converge"
    moved = motion(fit.problem, fit.solution.theta)
    sizes = np.abs(relative_corrections(fit.problem.model, fit.values, moved))
    if sizes.max(initial=0.0) > CHECK.suspicious_correction:
        worst = fit.parameters[int(np.argmax(sizes))]
        value = fit.values[int(np.argmax(sizes))] / worst.factor
        yield f"the fit changes {worst.key} by {value:.4g} {worst.unit}"
    if swapped := exchanged(fit.problem.model, fit.solution.theta):
        yield swapped
    error = fit.rms * fit.unit_factor
    if moved > 0 and error > CHECK.suspicious_error * moved:
        yield f"the error is {100 * error / moved:.1f} % of the motion"


def implausible_numbers(machine: Machine) -> Iterator[str]:
    """Yield the numbers that a machine carries, held or fitted, and that no machine has.

    Parameters
    ----------
    machine : Machine
    """
    model = Model(machine, compiled=False)
    theta = model.start()
    points = np.array([*(j.point for j in machine.joints), *(t.point for t in machine.targets)])
    extent = float(np.ptp(points, axis=0).max())
    sizes = np.abs(relative_corrections(model, theta, extent)) if extent else np.zeros(len(theta))
    for parameter, value, size in zip(model.parameters, theta, sizes, strict=True):
        is_scale = parameter.slot[0] == "e" and parameter.effect in SCALES
        if size > 1 or (is_scale and abs(value) > CHECK.largest_scale):
            yield f"{parameter.key} = {value / parameter.factor:.4g} {parameter.unit}, which no machine has"
