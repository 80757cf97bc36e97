"""Rows that are left out as wrong before anything is found: those that no candidate explains."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rodgen.array_types import Mask
from rodgen.calibration.checks.gross import unless_neighbours
from rodgen.calibration.checks.outliers import gross_errors
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.evidence import Screening
from rodgen.calibration.fitted import FittedModel
from rodgen.stages import stage


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
