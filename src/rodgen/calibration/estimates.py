"""The estimates of a fit's parameters, and their uncertainties."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.determinacy import Determinacy, determinacy
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.machines.known import Tied
from rodgen.statistics.columns import unit_diagonal


def covariance(fit: Fit) -> Array:
    """Return the covariance of the parameters, internal units, (p, p); it allows for the dependence of readings."""
    found = fit.dependence.covariance
    return fit.independent_covariance if found is None else found


def correlation(fit: Fit) -> Array:
    """Return the correlations of the parameters, (p, p); zero for what is not estimated."""
    return unit_diagonal(fit.covariance)[0]


def estimates(fit: Fit) -> dict[str, Estimate]:
    """Return every parameter by its key, in the unit that it is shown in."""
    return _estimates(fit, fit.determinacy, fit.covariance)


def estimates_with(fit: Fit, further: Array) -> dict[str, Estimate]:
    """Return the estimates that are expected when further readings are taken: values as now, and their spread.

    What readings have in common enlarges the spread as it does now.

    Parameters
    ----------
    further : ndarray, shape (k, free)
        Derivatives of the weighted readings by the free parameters.
    """
    theta, frame = fit.solution.theta, fit.solution.frame
    with one_thread_in_blas():
        more = determinacy(fit.problem, theta, frame, fit.free, further)
        alone, now = np.diag(fit.independent_covariance), np.diag(fit.covariance)
        enlarged = np.divide(now, alone, out=np.ones_like(now), where=alone > 0)
        larger = np.sqrt(np.outer(enlarged, enlarged))
        return _estimates(fit, more, more.covariance * fit.variance_factor * larger)


def _estimates(fit: Fit, of: Determinacy, covariance: Array) -> dict[str, Estimate]:
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found, bounds = {}, fit.problem.at_bounds(fit.solution.theta)
    for i, p in enumerate(fit.parameters):
        held, lacking = i not in fit.free, bool(of.lacking[i])
        at = None if held else bounds.get(i)
        spread = None if held or lacking or at or np.isnan(std[i]) else float(std[i] / p.factor)
        convention = bool(of.undetermined[i]) and not lacking
        value = float(fit.values[i] / p.factor)
        found[p.key] = Estimate(p.key, p.unit, value, spread, held, not lacking, convention, at)
    for tied in fit.problem.model.tied:
        found[tied.parameter.key] = _tied(fit, tied, found, covariance)
    return found


def _tied(fit: Fit, tied: Tied, others: Mapping[str, Estimate], covariance: Array) -> Estimate:
    """Return the estimate of a parameter that is tied to others."""
    p, weights = tied.parameter, np.zeros(len(fit.parameters))
    for i, factor in tied.factors:
        weights[i] = factor
    parts = [others[fit.parameters[i].key] for i, _ in tied.factors]
    moving = [part for part in parts if not part.held and not part.at_bound]
    variance = float(weights @ np.nan_to_num(covariance) @ weights)
    std = float(np.sqrt(max(variance, 0.0)) / p.factor)
    known = bool(moving) and all(part.std is not None for part in moving)
    return Estimate(
        p.key,
        p.unit,
        fit.problem.model.tied_value(tied, fit.values) / p.factor,
        std if known else None,
        not moving,
        all(part.determined for part in parts),
        any(part.convention for part in parts),
        tied_to=tied.text,
    )
