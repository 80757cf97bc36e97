"""Poses as blocks that are left out, and as clusters of readings that share errors.

Without a block g the residuals there are e_g = (1 - H_g)⁻¹ r_g, H_g the block's part of the hat matrix, so that no fit
is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.effect_test import design_effect
from rodgen.calibration.checks.held_out import folds_of_rows
from rodgen.calibration.checks.positions import distinct_positions, log_p_by_position
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.data.observations import Observations
from rodgen.statistics.columns import ColumnSpace, Whiten, orthonormal_basis, project_out, unit_columns
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.leave_out import LeaveOut, deal, group_slices
from rodgen.statistics.thresholds import EVIDENCE, SELECTION, VARIANCES


class Blocks:
    """Blocks of poses, each of which is left out in turn.

    Parameters
    ----------
    observations : Observations
        The rows.
    model : ndarray, shape (n, m, p)
        Columns of the model.
    residual : ndarray, shape (n, m)
        Weighted residuals.
    fold : ndarray of int, shape (n,), optional
        Of each row: :func:`stretches_of_time`, or positions of a joint. Left out: poses from everywhere.
    """

    def __init__(
        self,
        observations: Observations,
        model: Array,
        residual: Array,
        fold: NDArray[np.int_] | None = None,
    ) -> None:
        self.observations = observations
        fold = folds_of_rows(observations, EVIDENCE.folds) if fold is None else fold
        fold = np.repeat(fold, residual.shape[1])
        self.order = np.argsort(fold, kind="stable")
        self.blocks = group_slices(fold[self.order])
        self.model = model.reshape(len(fold), -1)
        self.residual = residual.ravel()
        self._by_position: dict[str, Blocks | None] = {}
        self._held_out: dict[frozenset[int], tuple[Sequence[Array], float]] = {}
        """Errors of sets of columns by their ids, and the columns, so that no others get these ids."""

    def by_position(self, joint: str) -> Blocks | None:
        """Return blocks of whole positions of a joint, on which an error of its coordinate is predicted from others.

        None where poses are as good as positions: see `distinct_positions`.
        """
        o = self.observations
        names = [j.name for j in o.machine.joints]
        if joint not in names:
            return None
        if joint not in self._by_position:
            number = distinct_positions(o.q[:, names.index(joint)], len(np.unique(o.pose)))
            self._by_position[joint] = None if number is None else self._of_positions(number)
        return self._by_position[joint]

    def _of_positions(self, number: NDArray[np.int_]) -> Blocks | None:
        count, residual = int(number.max()) + 1, self.residual.reshape(len(number), -1)
        fold = deal(count, min(EVIDENCE.folds, count))[number]
        model = self.model.reshape(*residual.shape, -1)
        return Blocks(self.observations, model, residual, fold) if count > 1 else None

    def held_out(self, further: Sequence[Array]) -> float:
        """Return the root mean square of the weighted residuals of the model with further columns, each block left out.

        Parameters
        ----------
        further : sequence of ndarray, each of shape (n, m, k)
        """
        key = frozenset(map(id, further))
        if key not in self._held_out:
            self._held_out[key] = further, float(np.sqrt(np.mean(self.errors(further) ** 2)))
        return self._held_out[key][1]

    def errors(self, further: Sequence[Array]) -> Array:
        """Return the weighted residuals with each block left out, in the order of blocks, (n m,)."""
        columns = [self.model, *(c.reshape(len(self.model), -1) for c in further)]
        basis = orthonormal_basis(np.concatenate(columns, axis=1)[self.order])
        residual = self.residual[self.order]
        amount = basis.T @ residual
        return LeaveOut(basis, self.blocks).residuals(project_out(basis, residual), amount=amount)


def stretches_of_time(observations: Observations) -> NDArray[np.int_]:
    """Return the block of each row where a block is all that was measured in a stretch of time, (n,)."""
    _, number = np.unique(observations.pose, return_inverse=True)
    return np.asarray(number * EVIDENCE.folds // (int(number.max(initial=0)) + 1))


# The design effect: how much more the residuals scatter along an effect because readings of a pose share errors.
#
# A joint that stops a little off shifts all readings of a pose in the way of that joint's errors: along an effect at
# it, residuals then scatter from pose to pose more than from reading to reading, and the usual test takes that for
# the effect. How much more is seen from the residuals themselves (the design effect of Rao and Scott 1987, by
# residuals with the correction of Bell and McCaffrey 2002, `undo_leverage`); what an effect explains is divided by
# it.


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
        effect = design_effect(u, left, self.pose, variance)
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
