"""Rows that are left out as wrong: outliers, unless their neighbours show that something is missing in the model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.evidence import Screening
from rodgen.calibration.diagnose.outliers import are_neighbours, gross_errors, on_a_branch
from rodgen.calibration.fitted import FittedModel
from rodgen.data.observations import Observations
from rodgen.stages import stage
from rodgen.statistics.thresholds import VERDICT


@stage("looking for outliers")
def gross_rows_of(fitted: FittedModel, screening: Screening) -> Mask:
    """Return the rows, (n,), that no candidate explains.

    Parameters
    ----------
    screening : Screening
        Of it.
    """
    sensitivities = screening.sensitivities
    some = (c.columns for c in _a_few_of_each(screening.candidates))
    every = np.concatenate([sensitivities.model[:, :, :0], *some], axis=2)
    wrong, left = gross_errors(sensitivities.model, every, sensitivities.residual)
    found = np.zeros(fitted.observations.n, bool)
    residual = np.zeros((len(found), left.shape[1]))
    found[sensitivities.rows[wrong]] = True
    residual[sensitivities.rows] = left
    return unless_neighbours(fitted, found, residual)


def unless_neighbours(fitted: FittedModel, outliers: Mask, residual: Array) -> Mask:
    """Return the outliers, or none where they are neighbours in a driver: then they show a missing effect.

    Where most poses of a stretch are outliers, the others there are displaced as well. Of the rest, those are none
    that lie where rows measured before and after them do.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    residual : ndarray, shape (n, m)
        What was judged, weighted.
    """
    o, outliers = fitted.observations, fitted.with_bodies(outliers)
    recorded = o.drivers("joint", "time", "temperature", "column", "load")
    # two targets of a pose that were mixed up are no neighbours: a pose counts once
    poses, first = np.unique(o.pose, return_index=True)
    wrong = np.isin(poses, o.pose[outliers])
    if outliers.any() and are_neighbours(wrong, [driver.values[first] for driver in recorded]):
        return np.zeros_like(outliers)
    outliers = outliers | displaced_rows(o, outliers)
    order = np.arange(o.n) if o.t is None else np.argsort(o.t, kind="stable")
    return outliers & ~on_a_branch(outliers, residual, order)


def displaced_rows(o: Observations, outliers: Mask) -> Mask:
    """Return the rows, (n,), of the poses from the first outlier to the last, where most of these are; else none.

    Parameters
    ----------
    outliers : ndarray of bool, shape (n,)
    """
    numbers = np.unique(o.pose)
    wrong = np.isin(numbers, o.pose[outliers])
    found = np.flatnonzero(wrong)
    if (
        not len(found)
        or np.mean(wrong[found[0] : found[-1] + 1]) < VERDICT.together
        or not are_neighbours(wrong, [np.arange(len(numbers), dtype=float)])
    ):
        return np.zeros(o.n, bool)
    return np.isin(o.pose, numbers[found[0] : found[-1] + 1])


def _a_few_of_each(found: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates; of those with a searched parameter at most seven of its values, evenly spread.

    Of those with weights at later joints the one with all of these.
    """
    by_key: dict[tuple[str, str | None], list[Candidate]] = {}
    for candidate in found:
        by_key.setdefault(candidate.key, []).append(candidate)
    return [
        c
        for several in by_key.values()
        for c in (several[-1:] if several[-1].later_weights else several[:: max(len(several) // 4, 1)])
    ]
