"""What a change among the last readings was, reading by reading: which columns, how much, and since which of them.

A detector clips readings that are far from what is expected, so that it knows neither how large a large change is
nor, therefore, which columns it follows. Here the readings are as they are. Each is a good one, with normal errors,
or a wrong one of any value: the loss of its error z is min(z², c²)/2. An alternative is fitted to those since it
began, and that is moved to where the loss falls most, until both stay. A change of the noise by a factor f makes
the loss m log f + z²/2f².
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rodgen.array_types import Array, Index
from rodgen.statistics.thresholds import WATCH

WRONG = 10.0
"""Standard deviations beyond which a reading says no more of a change than that it is wrong."""
LARGE = (0.1, 0.5, 2.5, 12.5, 62.5, 312.5)
"""The same as `sizes` where readings are as they are."""
TOGETHER = 6
"""Alternatives that may change together, at most, as where a machine was set up anew, ..."""
FURTHER = 5.0
"""... each of which must make the readings e^5 times as likely, the choice among hundred of them counted."""


class RecentChange(NamedTuple):
    """One alternative among the last readings.

    Attributes
    ----------
    log_evidence : float
        Of the readings with this change of unknown size, compared with none.
    began : ndarray, shape (n,)
        Probability that each reading was the first changed one.
    size, covariance : ndarray, shape (p,) and (p, p)
        In units of the columns; of the noise the factor, (1,), and nothing.
    """

    log_evidence: float
    began: Array
    size: Array
    covariance: Array


def recent_change(
    columns: Array, error: Array, groups: Sequence[Index], largest: Array
) -> tuple[list[RecentChange], tuple[int, ...], RecentChange]:
    """Return what each alternative would be, which of them changed together, and what a change of the noise would be.

    The last but one of the changes is that of all that changed together, where these are several.

    Parameters
    ----------
    columns : ndarray, shape (n, m, d)
    error : ndarray, shape (n, m)
        Of readings, less what was expected before the change, with variance 1.
    groups : sequence of ndarray of int
        Columns of each alternative.
    largest : ndarray, shape (d,)
        What no coefficient exceeds.
    """
    before = _loss(np.sum(error**2, axis=1))
    found = [_moved(columns[:, :, group], error, before, largest[group]) for group in groups]
    together = [int(np.argmax([each.log_evidence for each in found]))]
    best = found[together[0]]
    while len(together) < TOGETHER:
        union = np.concatenate([groups[k] for k in together])
        left = error - columns[:, :, union] @ best.size
        after = slice(int(np.argmax(best.began)), None)
        gains = [_gain(columns[after][:, :, group], left[after], largest[group]) for group in groups]
        further = int(np.argmax([-np.inf if k in together else gain for k, gain in enumerate(gains)]))
        wider = np.concatenate([union, groups[further]])
        more = _moved(columns[:, :, wider], error, before, largest[wider])
        if more.log_evidence < best.log_evidence + FURTHER:
            break
        together, best = [*together, further], more
    return [*found, *([best] if len(together) > 1 else [])], tuple(together), _noisier(error, before)


def _gain(columns: Array, left: Array, largest: Array) -> float:
    """Return by how much columns lower half the sum of squares."""
    flat, across = columns.reshape(-1, columns.shape[2]), np.einsum("nik,ni->k", columns, left)
    inner = flat.T @ flat
    prior = np.diag(np.minimum(LARGE[-1], largest) ** -2.0)
    return float(across @ np.linalg.solve(inner + prior, across)) / 2


def _loss(squares: Array) -> Array:
    return np.asarray(np.minimum(squares, WRONG**2) / 2)


def _moved(columns: Array, error: Array, before: Array, largest: Array) -> RecentChange:
    n, m, p = columns.shape
    usual, limit = np.minimum(np.array(LARGE)[:, None], largest), WATCH.clip(m) ** 2
    prior = np.diag(usual[-1] ** -2.0)
    weight = (np.arange(n) >= n // 2).astype(float)  # what is last has changed, if anything has
    size, inner, since = np.zeros(p), np.eye(p), np.zeros(n)
    for _ in range(WATCH.rounds):
        left = np.zeros(n)
        for _ in range(WATCH.rounds):
            weighted = columns * weight[:, None, None]
            inner = np.einsum("nik,nil->kl", weighted, columns)
            across = np.einsum("nik,ni->k", weighted, error)
            size = np.linalg.solve(inner + prior, across)
            left = np.sum((error - columns @ size) ** 2, axis=1)
            scale = max(float(np.median(left[weight > 0])), 1.0)
            weight = np.where(weight > 0, 1 / (1 + left / (limit * scale)), 0.0)
        since = np.cumsum((before - _loss(left))[::-1])[::-1]
        after = np.arange(n) >= int(np.argmax(since))
        weight = np.where(after & (left < limit), 1.0, 0.0) if np.any(after & (left < limit)) else after * 1.0
    began = np.exp(since - since.max())
    _, information = np.linalg.slogdet(np.eye(p) + inner * usual[:, :, None] * usual[:, None, :])
    occam = np.logaddexp.reduce(-information / 2 - np.sum((size / usual) ** 2, axis=1) / 2) - np.log(
        len(usual)
    )
    evidence = float(np.log(np.mean(began)) + since.max() + occam)
    return RecentChange(evidence, began / began.sum(), size, np.asarray(np.linalg.inv(inner + prior)))


def _noisier(error: Array, before: Array) -> RecentChange:
    factors, m = np.geomspace(0.1, 100, 121), error.shape[1]
    squares = np.sum(error**2, axis=1)
    loss = m * np.log(factors) + np.minimum(squares[:, None] / factors**2, WRONG**2) / 2
    since = np.cumsum((before[:, None] - loss)[::-1], axis=0)[::-1]  # (n, factors)
    whole = np.logaddexp.reduce(since.ravel())
    likely = np.exp(since - whole)
    factor = factors[int(np.argmax(likely.sum(axis=0)))]
    return RecentChange(
        float(whole - np.log(since.size)), likely.sum(axis=1), np.array([factor]), np.empty((0, 0))
    )
