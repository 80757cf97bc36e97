"""The autocorrelation of a sequence in parts, such as the mean residuals of successive poses in runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array


def autocorrelation(values: Array, part: NDArray[np.intp], most: int) -> tuple[Array, NDArray[np.intp]]:
    """Return the correlation of values k places apart in one part, and of how many pairs, for k = 1 … `most`.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        In order; their mean is taken out.
    part : ndarray of int, shape (n,)
        Pairs in different parts do not count.

    Returns
    -------
    correlation : ndarray, shape (most, m)
        Mean product of pairs over the mean square; NaN without a pair. Of independent values its standard deviation is
        1/√pairs (Bartlett 1946).
    pairs : ndarray of int, shape (most,)

    Examples
    --------
    >>> wave = np.cos(np.arange(12) * np.pi / 2)[:, None]  # 1, 0, -1, 0, …
    >>> correlation, pairs = autocorrelation(wave, np.zeros(12, int), 4)
    >>> correlation[:, 0].round(6) + 0.0, pairs
    (array([ 0., -1.,  0.,  1.]), array([11, 10,  9,  8]))
    """
    e = values - values.mean(axis=0)
    square = np.mean(e**2, axis=0)
    found, pairs = np.full((most, values.shape[1]), np.nan), np.zeros(most, np.intp)
    for k in range(1, min(most, len(e) - 1) + 1):
        same = part[k:] == part[:-k]
        pairs[k - 1] = np.count_nonzero(same)
        if pairs[k - 1]:
            product = np.mean((e[k:] * e[:-k])[same], axis=0)
            found[k - 1] = np.divide(product, square, out=np.full(len(square), np.nan), where=square > 0)
    return found, pairs
