"""What is asked of a fit: its estimates and their uncertainties, its noise, its error on poses left out, its rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration import held_out as checks
from rodgen.calibration.determinacy import Determinacy, determinacy
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.machines.known import Tied
from rodgen.machines.machine import Effect
from rodgen.stages import Progress, reporting
from rodgen.statistics.columns import inverse_root, unit_diagonal

ROUNDING = 2.0**-44
"""Turns, and parts of the machine's size, below which a value that is nearest to the file is that of the file: 256
roundings, which the projection on what the data leave open has."""


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
    by_key, bounds, model = {}, fit.problem.at_bounds(fit.solution.theta), fit.problem.model
    rounding = ROUNDING * np.where(model.ways, model.farthest, model.turns)
    for i, p in enumerate(fit.parameters):
        held, lacking = i not in fit.free, bool(of.lacking[i])
        at = None if held else bounds.get(i)
        spread = None if held or lacking or at or np.isnan(std[i]) else float(std[i])
        convention = bool(of.undetermined[i]) and not lacking
        value = float(fit.values[i] / p.factor)
        if of.undetermined[i] and max(abs(fit.values[i]), spread or 0.0) < rounding[i]:
            value, spread = 0.0, spread and 0.0
        spread = spread and spread / p.factor
        by_key[p.key] = Estimate(p.key, p.unit, value, spread, held, not lacking, convention, at)
    for tied in fit.problem.model.tied:
        by_key[tied.parameter.key] = _tied(fit, tied, by_key, covariance)
    return by_key


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


@dataclass(frozen=True)
class EffectEstimates:
    """The estimates of a fit's parameters, with standard deviations that allow for correlated readings."""

    final: Fit

    def of(self, effect: Effect) -> dict[str, Estimate]:
        """Return the parameters of an effect by their short names.

        Those of set-ups are relative to the first one where only their differences are determined.
        """
        numbers = self._numbers(effect)
        first = {self.final.parameters[i].slot[2]: i for i in reversed(numbers) if self._is_shift(i)}
        relative = bool(first) and any(self.final.determinacy.undetermined[i] for i in numbers)
        by_name = {}
        for i in numbers:
            parameter = self.final.parameters[i]
            name = parameter.key[len(effect.key("")) :].removeprefix(".")
            start = first[parameter.slot[2]] if relative else None
            if start is None:
                by_name[name] = self.final.estimates[parameter.key]
            elif i != start:
                by_name[name] = self._difference(i, start)
        return by_name

    def _numbers(self, effect: Effect) -> list[int]:
        return [
            i
            for i, parameter in enumerate(self.final.parameters)
            if effect.owns(parameter.key) and not (parameter.optional and i not in self.final.free)
        ]

    def _is_shift(self, i: int) -> bool:
        return self.final.parameters[i].slot[0] == "shift" and "[" in self.final.parameters[i].key

    def _difference(self, i: int, start: int) -> Estimate:
        parameter, C = self.final.parameters[i], self.final.covariance
        variance = C[i, i] + C[start, start] - 2 * C[i, start]
        value = (self.final.values[i] - self.final.values[start]) / parameter.factor
        std = float(np.sqrt(max(variance, 0.0)) / parameter.factor)
        return Estimate(parameter.key, parameter.unit, float(value), std, False, True)

    def significance(self, effect: Effect) -> float:
        """Return the p-value of an effect, by Wald's test of the hypothesis that all its parameters are zero."""
        from scipy import special

        final = self.final
        searched = [p.searched for p in final.parameters]
        numbers = [i for i in self._numbers(effect) if i in final.free and not searched[i]]
        if not numbers or any(self._is_shift(i) for i in numbers):
            return 0.0
        C = self.final.covariance[np.ix_(numbers, numbers)]
        size = np.sqrt(np.maximum(np.diag(C), 1e-300))
        along = inverse_root(C / np.outer(size, size), relative=1e-12).T @ (final.values[numbers] / size)
        return float(special.chdtrc(len(along), float(along @ along)))


def held_out(fit: Fit, folds: int | None = None, *, progress: Progress | None = None) -> checks.HeldOut:
    """Return the error on whole poses that a fit did not see: each is predicted by a fit to others.

    Parameters
    ----------
    folds : int, optional
        Into how many parts the poses are dealt; left out: 5 groups of neighbouring postures; where poses do not form a
        cloud, each of up to 100 is a part, else there are 10, or 5 of more than 50 000 rows.
    progress : callable, optional
        As of :func:`rodgen.calibration.fit.fit`.
    """
    with reporting(progress):
        validated: checks.HeldOut = (
            fit.held_out_of_poses if folds is None else checks.held_out(fit, folds=folds)
        )
        return validated


def used_rows(fit: Fit) -> dict[str, Any]:
    """Return how many rows were fitted, which were not, and which disagree grossly with the others, as plain data."""
    return {
        "rows": fit.problem.count,
        **fit.observations.not_here,
        "outliers": fit.outlier_numbers,
        "gross": [one.to_dict(fit.observations) for one in fit.gross_readings],
    }
