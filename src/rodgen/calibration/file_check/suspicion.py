"""What makes files suspicious, seen in a fit that was made anyway."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rodgen.calibration.file_check.near_file import exchanged, motion
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.problem.assembly_modes import other_mode
from rodgen.machines.plausible import relative_corrections
from rodgen.statistics.thresholds import CHECK


def suspicions(fit: FittedModel) -> Iterator[str]:
    """Yield what a right file hardly ever shows: no convergence, large corrections, errors that no physics makes."""
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
