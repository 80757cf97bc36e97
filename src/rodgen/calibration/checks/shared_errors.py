"""Tests of further parameters where successive poses, or readings of one pose, may share errors."""

from __future__ import annotations

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.checks.design_effect import design_effect
from rodgen.calibration.checks.nested_models import NestedModels
from rodgen.calibration.noise.correlation import believed_readings, shared_motion
from rodgen.statistics.columns import DEPENDENT, ColumnSpace, orthonormal_basis, unit_columns, visible_part
from rodgen.statistics.decompositions import singular_values, svd
from rodgen.statistics.unknown_walk import log_p_under_walks
from rodgen.statistics.whitening import MotionDeviations


def generalised_f(models: NestedModels, further: int, residual_dof: int) -> tuple[float, float, float]:
    """Return the fall of the sum of squares, the variance of what remains, and the design effect."""
    correlation = models.larger.dependence.correlation
    sizes = np.cumsum([x.shape[2] for x in (models.model, models.rows.model, models.new)])
    residuals = models.residual[:, :, None], models.rows.residual[:, :, None]
    parts = [models.model, models.rows.model, models.new, *residuals]
    white = correlation.whiten(np.concatenate(parts, axis=2)).reshape(models.residual.size, -1)
    small, large, new = np.split(white[:, :-2], sizes[:-1], axis=1)
    base = ColumnSpace.of(unit_columns(small))
    before = base.project_out(white[:, -2])
    after = ColumnSpace.of(unit_columns(large)).project_out(white[:, -1])
    remains = float(after @ after)
    part = models.residual.size / max(models.larger.rows * models.residual.shape[1], 1)
    left = remains / max(part * residual_dof, 1.0)
    directions, _, _ = svd(base.project_out(unit_columns(new)), full_matrices=False)
    pose = np.repeat(models.rows.observations.pose, models.residual.shape[1])
    effect = design_effect(directions[:, :further], after, pose, left)
    return max(float(before @ before) - remains, 0.0), left, effect


def known_degrees_of_freedom(models: NestedModels) -> float:
    """Return as many degrees of freedom as the variance of what is new has, because V is estimated.

    2 over the variance of the logarithm of its generalised variance, a parameter (Satterthwaite 1946).
    """
    k, size = models.model.shape[2], np.linalg.norm(models.new.reshape(models.residual.size, -1), axis=0)
    size[size == 0.0] = 1.0  # what a time constant of nearly zero does

    def log_variance(white: Array) -> float:
        flat = white.reshape(models.residual.size, -1)
        base = ColumnSpace.of(unit_columns(flat[:, :k]))
        seen, left = base.project_out(flat[:, k:-1]), base.project_out(flat[:, -1])
        values = singular_values(seen / size)
        left = ColumnSpace.of(unit_columns(seen)).project_out(left)
        return float(np.log(left @ left) - 2 * np.mean(np.log(values[values > DEPENDENT * values[0]])))

    columns = np.concatenate([models.model, models.new, models.rows.residual[:, :, None]], axis=2)
    pairs = models.larger.dependence.correlation.whiten_within_error(columns)
    error = sum((log_variance(one) - log_variance(other)) ** 2 / 4 for one, other in pairs)
    return 2 / error if error > 0 else np.inf


def log_p_where_it_wanders(models: NestedModels, independent: float, design_effect: float) -> float:
    """Return the logarithm of the probability where the set-up wanders by an amount that is not known."""
    motion, groups = shared_motion(models.rows)
    old = [i for i in models.larger.moving if i not in models.further]
    N = models.residual.size
    basis = orthonormal_basis(models.rows.jacobian[:, :, old].reshape(N, -1))
    new = visible_part(basis, unit_columns(models.new.reshape(N, -1)), DEPENDENT)
    dof = float(believed_readings(models.rows).sum() - basis.shape[1] - new.shape[1]), independent
    none = MotionDeviations(np.zeros(motion.dof), np.zeros(motion.dof), np.inf)
    estimated = models.larger.dependence.correlation.deviations or none
    residual = models.residual.ravel()
    return log_p_under_walks(motion, groups, basis, new, residual, dof, estimated, design_effect)
