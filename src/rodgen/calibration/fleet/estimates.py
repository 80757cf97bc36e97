"""The parameters of a machine, and of every effect that it may have, as numbers that machines and nights share.

Whether an effect is found depends on chance where it is as large as the noise. Were only found ones compared, their
mean would be too large (those that chance enlarges are found), and their spread too small. So every effect of the
catalogue has an estimate in every machine: that of the fit where it is in the model, else that of adding it, to first
order. All readings count alike, as in the fit: were they weighed by how they depend on each other, which is estimated
anew each night, what the model lacks would change the estimates from night to night.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate, candidates
from rodgen.calibration.fitted import Fit
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.data.units import unit_factor
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import COST


def estimates_of(fit: Fit) -> dict[str, Any]:
    """Return what can be compared with other machines and nights, as plain data.

    Parameters
    ----------
    fit : Fit

    Returns
    -------
    dict
        ``"values"``: by key of a parameter its value, standard deviation and unit; ``"effects"``: by the start of
        these keys, the effect's name and place. Parameters that are held or not determined are left out, and so are
        those of set-ups, and effects with a parameter that is searched for, such as a period. What is a choice of
        coordinates is the nearest to the machine file, and thus the same choice for machines of one design.
    """
    values = {
        key: [e.value, e.std, e.unit]
        for key, e in fit.estimates.items()
        if e.std and e.determined and "[" not in key and not key.startswith("frame.")
    }
    effects = {effect.key(""): [effect.name, effect.place] for effect in fit.machine.effects}
    wanted = [e for e in catalogue_effects(fit.machine, fit.observations) if not e.definition.searched]
    with one_thread_in_blas():
        of = Sensitivities.of(fit, wanted)
        basis = orthonormal_basis(of.model.reshape(of.residual.size, -1))
        for candidate in candidates(of, wanted):
            effect = candidate.effect
            if effect.key("") in effects:  # with weights at later joints, too
                continue
            effects[effect.key("")] = [effect.name, effect.place]
            units = effect.units(fit.machine)
            for name, value, std in _first_order(of, basis, candidate):
                factor, _ = unit_factor(units[name], fit.machine.length_unit)
                values[effect.key(name)] = [value / factor, std / factor, units[name]]
    return {"values": values, "effects": effects}


def _first_order(of: Sensitivities, basis: Array, candidate: Candidate) -> list[tuple[str, float, float]]:
    """Return the parameters that a candidate would have, with standard deviations; none where they cannot be seen.

    Parameters
    ----------
    of : Sensitivities
    basis : ndarray, shape (n m, p)
        Of the model's columns.
    candidate : Candidate
    """
    columns = candidate.columns.reshape(of.residual.size, -1)
    length = np.linalg.norm(columns, axis=0)
    if not (np.isfinite(length).all() and length.all()):
        return []
    seen = project_out(basis, columns / length)
    values, vectors = eigh(seen.T @ seen)
    if values.min() < COST.visible**2:
        return []
    covariance = (vectors / values) @ vectors.T
    weights, residual, fit = seen @ covariance, of.residual.ravel(), of.fit
    found = -(weights.T @ residual)
    if fit.dependence.independent:
        variances = fit.variance_factor * np.diag(covariance)
    else:
        variances = np.diag(fit.dependence.correlation.covariance_of(weights.reshape(*of.residual.shape, -1)))
    if of.observations.sigma is None:  # what the candidate explains is no noise
        total, degrees = float(residual @ residual), max(fit.degrees_of_freedom - len(found), 1)
        left = max(total + float(found @ (seen.T @ residual)), 0.0)
        variances = variances * (left / total * fit.degrees_of_freedom / degrees)
    std = np.sqrt(variances)
    if not (np.isfinite(std).all() and std.all()):
        return []
    return [*zip(candidate.short_names, (found / length).tolist(), (std / length).tolist(), strict=True)]
