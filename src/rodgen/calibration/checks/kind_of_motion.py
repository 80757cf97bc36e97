"""What kind of motion a joint makes at positions that are too few to show its shape.

The readings show, say, that it is a translation along the axis, whatever its size at each position. That is tested
against all other motions of what the joint carries, after all that other effects of this joint could do by a motion of
the same kind: only then does no shape need to tell them apart.
"""

from __future__ import annotations

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.checks.nested_models import NestedModels
from rodgen.calibration.checks.positions import bases_by_rows, explained_within, rows_by_position
from rodgen.calibration.noise.correlation import estimate_correlation
from rodgen.calibration.possible_effects import (
    MOTIONS,
    bare_effects,
    bare_key,
    catalogue_effects,
    problem_with,
)
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION


def log_p_of_kind(models: NestedModels, joint: str) -> float:
    """Return the logarithm of the probability that chance makes a joint move as an effect does, by whatever amounts.

    Parameters
    ----------
    models : NestedModels
        The larger one with one effect more, a function of the coordinate of its joint.
    joint : str
        In few positions.

    Returns
    -------
    float
        0 where the positions are too few for that, too, or other effects are motions of this kind of any shape; minus
        infinity where positions are nearly as many as poses.
    """
    residual = models.residual
    rows = rows_by_position(models.rows.observations, joint)
    if rows is None:
        return -np.inf
    motions, rivals, searched_rivals = _motions(models, joint)
    at = bases_by_rows(models.own, rows)
    base = ColumnSpace.of(models.model.reshape(len(at), -1))
    kind = base.visible_part(unit_columns(at), SELECTION.visible)
    alike = []
    # where a value is searched for, the shape is anything
    for rival in (*rivals, *(bases_by_rows(c, rows).reshape(*c.shape[:2], -1) for c in searched_rivals)):
        seen = base.visible_part(unit_columns(rival.reshape(len(at), -1)), SELECTION.visible)
        if np.sum((kind.T @ seen) ** 2) > SELECTION.same * seen.shape[1]:
            alike.append(rival)
    own = at.reshape(*residual.shape, -1)
    every = np.concatenate([at, bases_by_rows(motions, rows)], axis=1)
    # a part that repeats at the same positions does not come from a wandering set-up
    whiten = estimate_correlation(models.rows, (), included=[every.reshape(*residual.shape, -1)]).whiten
    found = explained_within(
        np.concatenate([models.model, *alike], axis=2), own, [every], residual, whiten, 0
    )
    return 0.0 if found.few < found.freedoms else found.log_p


def _motions(models: NestedModels, joint: str) -> tuple[Array, list[Array], list[Array]]:
    """Return derivatives by the motions of what a joint carries, and by other effects of that joint.

    The latter are those without, then those with searched parameters.
    """
    o = models.rows.observations
    effects = [e for e in catalogue_effects(models.larger.machine, o) if e.place == joint]
    bare = [e for e in bare_effects(models.larger.machine) if e.place == joint]
    problem, theta = problem_with(models.larger, [*effects, *bare], models.rows.rows)
    columns = problem.jacobian(theta, models.larger.solution.frame)
    index = {parameter.key: i for i, parameter in enumerate(problem.model.parameters)}
    motions = [index[key] for x in MOTIONS if (key := bare_key(joint, x)) in index]
    rivals: tuple[list[Array], list[Array]] = [], []
    for effect in effects:
        own = columns[:, :, [i for key, i in index.items() if effect.owns(key)]]
        rivals[bool(effect.definition.searched)].append(own)
    return columns[:, :, motions], *rivals
