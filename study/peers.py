"""Other methods of selection on the same columns: stepwise F tests, the LASSO and PySINDy's optimisers.

All of them get the data of the diagnosis: the weighted residuals of the base fit, and for every effect of the
catalogue, at every place, the derivatives of the readings with respect to its parameters. The base's own parameters
are projected out of both. For an effect with a searched parameter (period, time constant) they get the value that fits
best.

    stepwise    adds the effect with the smallest p of an F test on single readings while p is below a limit, as
                TPOINT's automatic mode and pulsar timing do; everything is refitted after each step
    lasso       scikit-learn's LassoCV (five folds of rows) and LassoLarsIC (BIC); effects with a nonzero coefficient
    pysindy     STLSQ, SR3, SSR, FROLS; threshold or number of terms by the error on a random fifth of the rows

An effect is selected when one of its columns is; the first effect is the one that explains most of the residuals alone.
The held-out error is that of ordinary least squares with the selected effects, on whole poses left out of the fit; a
period or time constant is searched again without them. The selection itself used all poses, which favours methods that
select many effects.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats
from scipy.linalg import qr

from rodgen.calibration.candidates import candidates
from rodgen.calibration.fit import Fit
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.sensitivities import Sensitivities

Array = np.ndarray[Any, np.dtype[np.float64]]
Title = tuple[str, str | None]
MOST_STEPS = 12
ALONE = 1e-5
"""A column is dropped if less than this fraction of it remains after projecting out the base."""


@dataclass(frozen=True)
class Columns:
    """Residuals and columns, as they are and with the base projected out."""

    y: Array  # (readings,)
    base: Array  # (readings, base)
    raw: Array  # (readings, columns), of length 1 after the base is projected out
    x: Array
    title: tuple[Title, ...]  # of each column
    tried: Mapping[Title, list[tuple[Array, Array]]]  # x and raw for each value of a searched parameter
    pose: Array  # of each reading
    spare: int  # readings less the base's parameters

    @property
    def titles(self) -> list[Title]:
        return list(dict.fromkeys(self.title))

    def of(self, chosen: Iterable[Title]) -> Array:
        chosen = set(chosen)
        return np.array([i for i, title in enumerate(self.title) if title in chosen], dtype=int)

    def held_out(self, chosen: Iterable[Title], folds: int = 5) -> float:
        """Return the weighted RMS on poses left out of the fit."""
        chosen = list(chosen)
        fixed = self.raw[:, self.of(t for t in chosen if t not in self.tried)]
        fold = np.random.default_rng(0).permutation(int(self.pose.max()) + 1)[self.pose] % folds
        left = np.empty_like(self.y)
        for k in range(folds):
            test = fold == k
            found = [_best(self.tried[t], self.y, ~test) for t in chosen if t in self.tried]
            a = np.concatenate([self.base, fixed, *found], 1)
            solution = np.linalg.lstsq(a[~test], self.y[~test], rcond=1e-7)[0]
            left[test] = self.y[test] - a[test] @ solution
        return float(np.sqrt(np.mean(left**2)))

    def explained(self, chosen: Iterable[Title]) -> float:
        """Return the fraction of the sum of squares that effects explain."""
        which = self.of(chosen)
        if not len(which):
            return 0.0
        u, s, _ = np.linalg.svd(self.x[:, which], full_matrices=False)
        u = u[:, s > 1e-6 * s[0]]
        return float(np.sum((u.T @ self.y) ** 2) / (self.y @ self.y))


def _best(tried: list[tuple[Array, Array]], y: Array, rows: Array) -> Array:
    """Return the columns for the value of a searched parameter that explains most in the given rows."""
    takes = []
    for x, _ in tried:
        q, r = np.linalg.qr(x[rows])
        takes.append(np.sum((q.T @ y[rows]) ** 2) if np.abs(np.diag(r)).min() > 1e-9 else 0.0)
    return tried[int(np.argmax(takes))][1]


def columns_of(fit: Fit) -> Columns:
    """Return the columns of all candidates on a base fit."""
    effects = catalogue_effects(fit.machine, fit.observations)
    sensitivities = Sensitivities.of(fit, effects)
    n, m = sensitivities.residual.shape
    base = sensitivities.model.reshape(n * m, -1)
    base = base / np.maximum(np.linalg.norm(base, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(base, full_matrices=False)
    u = u[:, s > 1e-8 * s[0]]
    y = sensitivities.residual.reshape(-1)
    y = y - u @ (u.T @ y)
    best: dict[Title, tuple[float, Array, Array]] = {}
    tried: dict[Title, list[tuple[Array, Array]]] = {}
    for candidate in candidates(sensitivities, effects):
        raw = candidate.columns.reshape(n * m, -1)
        left = raw - u @ (u.T @ raw)
        length = np.linalg.norm(left, axis=0)
        seen = length > ALONE * np.maximum(np.linalg.norm(raw, axis=0), 1e-300)
        if not seen.any():
            continue
        left, raw = left[:, seen] / length[seen], raw[:, seen] / length[seen]
        if candidate.searched:
            tried.setdefault(candidate.key, []).append((left, raw))
        q, r, _ = np.linalg.svd(left, full_matrices=False)
        takes = float(np.sum((q[:, r > 1e-6 * r[0]].T @ y) ** 2))
        if candidate.key not in best or takes > best[candidate.key][0]:
            best[candidate.key] = takes, left, raw
    titles = tuple(title for title, (_, left, _) in best.items() for _ in range(left.shape[1]))
    pose = np.repeat(np.unique(sensitivities.observations.pose, return_inverse=True)[1], m)
    return Columns(
        y, base, np.concatenate([raw for _, _, raw in best.values()], 1),
        np.concatenate([left for _, left, _ in best.values()], 1), titles, tried, pose, n * m - u.shape[1],
    )  # fmt: skip


def stepwise(c: Columns, limit: float) -> list[Title]:
    """Add effects by F tests on single readings."""
    chosen: list[Title] = []
    y, x, spare = c.y.copy(), c.x.copy(), c.spare
    while len(chosen) < MOST_STEPS:
        best: tuple[float, Title, Array] | None = None
        for title in c.titles:
            if title in chosen:
                continue
            u, s, _ = np.linalg.svd(x[:, c.of([title])], full_matrices=False)
            u = u[:, s > 1e-4]
            k = u.shape[1]
            if not k or spare - k < 1:
                continue
            fall = float(np.sum((u.T @ y) ** 2))
            log_p = float(stats.f.logsf(fall / k / ((y @ y - fall) / (spare - k)), k, spare - k))
            if best is None or log_p < best[0]:
                best = log_p, title, u
        if best is None or best[0] > np.log(limit):
            break
        _, title, u = best
        chosen.append(title)
        y, x, spare = y - u @ (u.T @ y), x - u @ (u.T @ x), spare - u.shape[1]
    return chosen


def _ordered(c: Columns, coefficients: Array) -> list[Title]:
    """Return the effects with a nonzero coefficient, the one that explains most first."""
    kept = [t for t in c.titles if np.any(np.abs(coefficients[c.of([t])]) > 1e-8)]
    return sorted(kept, key=lambda title: -c.explained([title]))


def _scaled(c: Columns) -> tuple[Array, Array]:
    """Return columns and residuals with a mean square of 1."""
    return c.x * np.sqrt(len(c.y)), c.y / np.sqrt(np.mean(c.y**2))


def lasso_cv(c: Columns) -> list[Title]:
    from sklearn.linear_model import LassoCV

    x, y = _scaled(c)
    return _ordered(c, LassoCV(cv=5, fit_intercept=False, max_iter=5000, alphas=40).fit(x, y).coef_)


def lasso_bic(c: Columns) -> list[Title]:
    from sklearn.linear_model import LassoLarsIC

    x, y = _scaled(c)
    rank = np.linalg.lstsq(x, y, rcond=1e-6)
    left = y - x @ rank[0]
    spare = max(len(y) - int(rank[2]), 1)
    found = LassoLarsIC(
        criterion="bic", fit_intercept=False, noise_variance=float(left @ left / spare), eps=1e-9
    )
    return _ordered(c, found.fit(x, y).coef_)


def _validated(c: Columns, models: Callable[[Array, Array], Iterable[Array]]) -> list[Title]:
    """Return the effects of the model that predicts a random fifth of the rows best."""
    x, y = _scaled(c)
    test = np.random.default_rng(0).uniform(size=len(y)) < 0.2
    best, error = np.zeros(x.shape[1]), np.inf
    for coefficients in models(x[~test], y[~test]):
        w = np.ravel(coefficients)
        off = float(np.mean((y[test] - x[test] @ w) ** 2))
        if np.isfinite(off) and off < error - 1e-12:
            best, error = w, off
    return _ordered(c, best)


THRESHOLDS = (0.02, 0.035, 0.06, 0.1, 0.17, 0.3, 0.5)


def stlsq(c: Columns) -> list[Title]:
    from pysindy import STLSQ

    def models(x: Array, y: Array) -> Iterable[Array]:
        yield np.zeros(x.shape[1])
        for threshold in THRESHOLDS:
            yield STLSQ(threshold=threshold, alpha=1e-3).fit(x, y).coef_

    return _validated(c, models)


def sr3(c: Columns) -> list[Title]:
    from pysindy import SR3

    def models(x: Array, y: Array) -> Iterable[Array]:
        yield np.zeros(x.shape[1])
        for threshold in THRESHOLDS:
            yield SR3(reg_weight_lam=threshold**2 / 2 * len(y), relax_coeff_nu=1 / len(y)).fit(x, y).coef_

    return _validated(c, models)


def ssr(c: Columns) -> list[Title]:
    from pysindy import SSR

    def models(x: Array, y: Array) -> Iterable[Array]:
        yield np.zeros(x.shape[1])
        yield from SSR(alpha=1e-3, max_iter=x.shape[1] - 1).fit(x, y).history_

    return _validated(c, models)


def frols(c: Columns) -> list[Title]:
    from pysindy import FROLS

    def models(x: Array, y: Array) -> Iterable[Array]:
        yield np.zeros(x.shape[1])
        _, r, order = qr(x, mode="economic", pivoting=True)  # FROLS needs linearly independent columns
        left = np.sort(order[: len(r)][np.abs(np.diag(r)) > 1e-4 * abs(r[0, 0])])
        for coefficients in FROLS(alpha=1e-3, max_iter=MOST_STEPS).fit(x[:, left], y).history_:
            found = np.zeros(x.shape[1])
            found[left] = np.ravel(coefficients)
            yield found

    return _validated(c, models)


PEERS: dict[str, Callable[[Columns], list[Title]]] = {
    "F tests, p < 0.05": lambda c: stepwise(c, 0.05),
    "F tests, p < 0.001": lambda c: stepwise(c, 1e-3),
    "LassoCV": lasso_cv,
    "LassoLarsIC": lasso_bic,
    "PySINDy STLSQ": stlsq,
    "PySINDy SR3": sr3,
    "PySINDy SSR": ssr,
    "PySINDy FROLS": frols,
}
"""Methods by their names in the table; all but the F tests need further packages."""


def chosen_by_all(c: Columns, installed: bool) -> dict[str, list[Title]]:
    """Return the effects that each method selects."""
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, choose in PEERS.items():
            if installed or name.startswith("F tests"):
                found[name] = choose(c)
    return found
