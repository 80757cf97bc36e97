"""Whiten readings one after the other: each less what those before it predict of an error that they share.

The errors are those of :mod:`rodgen.statistics.whitening`, e = ε + H (u + x), u of each pose by itself, x a process
that forgets. Here a Kalman filter goes from row to row and keeps what it knows of u and x, so that rows may come in
any parts.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.thresholds import WATCH
from rodgen.statistics.whitening import MotionDeviations

__all__ = ["StreamWhitener"]


class StreamWhitener:
    """What earlier rows say of the motion that the next ones share.

    Parameters
    ----------
    deviations : MotionDeviations
    width : int
        Number of columns; the last is that of the readings.
    white : float
        Standard deviation of the independent errors.
    """

    def __init__(self, deviations: MotionDeviations, width: int, white: float) -> None:
        shared, wander = np.flatnonzero(deviations.shared), np.flatnonzero(deviations.wander)
        self._used = np.concatenate([shared, wander])
        self._sizes = np.concatenate([deviations.shared[shared], deviations.wander[wander]])
        self._wanders = np.arange(len(self._used)) >= len(shared)
        self._time, self._white = deviations.time, white
        self._mean = np.zeros((len(self._used), width))
        self._covariance = np.eye(len(self._used))

    def __call__(self, columns: Array, motion: Array, gap: Array, expected: Array) -> Array:
        """Return rows, (n, m, K), whitened.

        Parameters
        ----------
        columns : ndarray, shape (n, m, K)
        motion : ndarray, shape (n, m, k)
            H.
        gap : ndarray, shape (n,)
            Time since the row before: 0 of the same pose, infinite at the beginning of a run.
        expected : ndarray, shape (K - 1,)
            Coefficients of the columns by which readings are expected; one that is far from there predicts nothing.
        """
        found, m = np.empty(columns.shape), columns.shape[1]
        contrast = np.append(-expected, 1.0) / self._white
        for i, (row, H) in enumerate(zip(columns, motion[:, :, self._used] * self._sizes, strict=True)):
            if gap[i] > 0:
                keeps = np.where(self._wanders, np.exp(-gap[i] / self._time), 0.0)
                self._mean = keeps[:, None] * self._mean
                self._covariance = keeps[:, None] * self._covariance * keeps + np.diag(1 - keeps**2)
            across = self._covariance @ H.T
            inverse = np.linalg.inv(np.linalg.cholesky(np.eye(m) + H @ across))
            found[i] = inverse @ (row - H @ self._mean)
            if np.linalg.norm(found[i] @ contrast) > WATCH.clip(m):
                continue
            gain = across @ inverse.T
            self._mean = self._mean + gain @ found[i]
            self._covariance = self._covariance - gain @ gain.T
        return found

    def state(self) -> dict[str, Array]:
        """Return what is known, as arrays."""
        return {"whitener.mean": self._mean, "whitener.covariance": self._covariance}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        self._mean, self._covariance = state["whitener.mean"], state["whitener.covariance"]
