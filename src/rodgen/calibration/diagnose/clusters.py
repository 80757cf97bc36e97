"""The design effect: how much more the residuals scatter along an effect because readings of a pose share errors.

A joint that stops a little off shifts all readings of a pose in the way of that joint's errors: along an effect at
it, residuals then scatter from pose to pose more than from reading to reading, and the usual test takes that for the
effect. How much more is seen from the residuals themselves (the design effect of Rao and Scott 1987, by residuals with
the correction of Bell and McCaffrey 2002, `undo_leverage`); what an effect explains is divided by it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.checks.positions import log_p_by_position
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.statistics.columns import ColumnSpace, Whiten, project_out, unit_columns
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import SELECTION, VARIANCES


class Clusters:
    """Poses as clusters of readings."""

    def __init__(self, sensitivities: Sensitivities, whiten: Whiten) -> None:
        self.model, self.residual, self.whiten = sensitivities.model, sensitivities.residual, whiten
        self.observations = sensitivities.observations
        _, pose = np.unique(sensitivities.observations.pose, return_inverse=True)
        self.poses = int(pose.max(initial=0)) + 1
        self.pose = np.repeat(pose, self.residual.shape[1])
        self.replicated = len(pose) >= VARIANCES.several_readings * self.poses

    def penalty(self, included: Sequence[Array], columns: Array) -> float:
        """Return by how much the logarithm of an effect's probability by chance is larger than it seems.

        Parameters
        ----------
        included : sequence of ndarray, each of shape (n, m, k)
            What the model has in addition.
        columns : ndarray, shape (n, m, k)
            Of the effect.
        """
        if not self.replicated:
            return 0.0
        parts = [self.model, *included, columns, self.residual[:, :, None]]
        k = columns.shape[2]
        white = self.whiten(np.concatenate(parts, axis=2)).reshape(len(self.pose), -1)
        base = ColumnSpace.of(white[:, : -k - 1])
        r = base.project_out(white[:, -1])
        u = base.visible_part(unit_columns(white[:, -k - 1 : -1]), SELECTION.visible)
        test = base.score_test(r, u)
        if test is None:
            return 0.0
        dof, residual_dof, left = test.dof, test.residual_dof, project_out(u, r)
        variance = float(left @ left) / residual_dof
        if not variance > 0:
            return 0.0
        pulls = np.zeros((self.poses, dof))
        np.add.at(pulls, self.pose, u * left[:, None])
        shares = np.zeros((self.poses, dof, dof))
        np.add.at(shares, self.pose, u[:, :, None] * u[:, None, :])
        effect = float(np.sum(undo_leverage(shares, pulls, 0.5) ** 2)) / (dof * variance)
        if effect < VARIANCES.design_effect:
            return 0.0
        few = min(residual_dof, self.poses)
        return log_p_of_fall(test.fall / variance / effect, few, dof, few) - test.log_p

    def log_p_by_position(
        self, included: Sequence[Array], columns: Array, driver: str, searched: int, tries: float = 1.0
    ) -> float:
        """Return the logarithm of the probability that chance explains as much as a function of one coordinate.

        Of the model with the columns `included`; for the rest see `positions.log_p_by_position`.
        """
        model = np.concatenate([self.model, *included], axis=2)
        o, residual = self.observations, self.residual
        return log_p_by_position(o, model, columns, residual, self.whiten, driver, searched, tries)[0]
