"""What is asked of a fit: its noise, the dependence of its readings, its error on poses left out, its rows."""

from __future__ import annotations

from typing import Any

from rodgen.calibration import held_out as checks
from rodgen.calibration.dependence import Dependence
from rodgen.calibration.dependence import dependence as dependence_of
from rodgen.calibration.fitted import Fit
from rodgen.calibration.noise_floor import NoiseFloor, noise_floor
from rodgen.stages import Progress, reporting, stage


@stage("estimating the noise")
def noise(fit: Fit) -> NoiseFloor:
    """Return how well the machine could be modelled at all, from the data alone."""
    return noise_floor(fit)


@stage("how readings depend on each other")
def dependence(fit: Fit) -> Dependence:
    """Return how the errors of readings depend on each other: within a pose, and of successive poses."""
    return dependence_of(fit)


def held_out(fit: Fit, folds: int | None = None, *, progress: Progress | None = None) -> checks.HeldOut:
    """Return the error on whole poses that a fit did not see: each is predicted by a fit to others.

    Parameters
    ----------
    folds : int, optional
        Into how many parts the poses are dealt; left out: each of up to 100 poses is one, else 10 parts, or 5 of
        more than 50 000 rows.
    progress : callable, optional
        As of :func:`fit`.
    """
    with reporting(progress):
        found: checks.HeldOut = fit.held_out_of_poses if folds is None else checks.held_out(fit, folds=folds)
        return found


def used_rows(fit: Fit) -> dict[str, Any]:
    """Return how many rows were fitted, which were not, and which disagree grossly with the others, as plain data."""
    return {
        "rows": fit.problem.count,
        **fit.observations.not_here,
        "outliers": fit.outlier_numbers,
        "gross": [one.to_dict(fit.observations) for one in fit.gross_readings],
    }
