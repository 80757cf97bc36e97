"""The uncertainty budget of a Tricept's tool, and the same by Monte Carlo after GUM Supplement 1.

The variance is u²(Q_k) = Σ_ij S_ki U_ij S_kj. Without correlations parameter i contributes (S_ki u_i)². With them a
part belongs to pairs; it is given in equal halves to both, S_ki Σ_j U_ij S_kj, so that the parts still add up, and one
may be negative: it then reduces the sum of the others.

Monte Carlo draws the parameters from their distributions, solves the exact direct problem for every draw, and takes
mean, covariance and coverage intervals from the draws; then it decides, by clause 8 of the Supplement, whether the
linear result agrees with them to its stated digits.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.tricept._geometry import ANGLES, PARAMETERS, Geometry
from rodgen.kinematics.tricept._kinematics import disturbed_point
from rodgen.kinematics.tricept._uncertainty import correlation_of, parameter_covariance, regular_place
from rodgen.statistics.digits import last_decimal
from rodgen.views import with_html

# Sensitivities this small relative to the greatest of their unit are rounding, as those that vanish by symmetry.
_ROUNDING = 64 * 2.0**-52


@with_html
class BudgetLine(NamedTuple):
    """The contribution of one parameter to one coordinate.

    Attributes
    ----------
    parameter : str
        Its name.
    sensitivity : float
        ∂Q_k by it.
    u : float
        Its standard uncertainty.
    alone : float
        |sensitivity| · u: the standard uncertainty of Q_k from this parameter alone.
    part : float
        Its part of u²(Q_k), with half of what it has with others by correlation.
    share : float
        That part over u²(Q_k).
    """

    parameter: str
    sensitivity: float
    u: float
    alone: float
    part: float
    share: float


@with_html
class Budget(NamedTuple):
    """The uncertainty budget of a point.

    Attributes
    ----------
    names : tuple of str
        The parameters, n of them.
    sensitivity : ndarray, shape (3, n)
        Derivatives of Qx, Qy, Qz.
    u : ndarray, shape (n,)
        Standard uncertainties of the parameters.
    parts : ndarray, shape (3, n)
        Contributions to u²(Qx), u²(Qy), u²(Qz); they add up to these along each row.
    U_y : ndarray, shape (3, 3)
        The covariance matrix of the point.
    correlated : bool
        Whether any of the parameters are.
    """

    names: tuple[str, ...]
    sensitivity: Array
    u: Array
    parts: Array
    U_y: Array
    correlated: bool

    def lines(self, coordinate: int) -> list[BudgetLine]:
        """Return the parameters with an uncertainty, the greatest share first; coordinate 0, 1, 2 is Qx, Qy, Qz."""
        total = self.U_y[coordinate, coordinate]
        made = [
            BudgetLine(
                name,
                float(self.sensitivity[coordinate, n]),
                float(self.u[n]),
                float(abs(self.sensitivity[coordinate, n]) * self.u[n]),
                float(self.parts[coordinate, n]),
                float(self.parts[coordinate, n] / total) if total > 0 else 0.0,
            )
            for n, name in enumerate(self.names)
            if self.u[n] > 0
        ]
        return sorted(made, key=lambda line: (-abs(line.part), -line.alone))

    def summary(self, unit: str = "") -> str:
        """Return a text table; lines below a thousandth of the whole are added up."""
        text = []
        for k, axis in enumerate("xyz"):
            total = np.sqrt(self.U_y[k, k])
            text.append(f"u(Q{axis}) = {total:.4g} {unit}".rstrip())
            rest = 0.0
            for line in self.lines(k):
                if abs(line.share) < 1e-3:
                    rest += line.share
                    continue
                text.append(
                    f"  {line.parameter:12} alone {line.alone:10.4g}   share {100 * line.share:7.2f} %"
                )
            if rest:
                text.append(f"  {'all others':12} {'':16}   share {100 * rest:7.2f} %")
        if self.correlated:
            text.append(
                "Some parameters are correlated: shares have half of each pair's part, and can be negative."
            )
        return "\n".join(text)


def budget(point: ArrayLike, geometry: Geometry, U: ArrayLike) -> Budget:
    """Return the uncertainty budget of one point.

    Parameters
    ----------
    point : array_like (3,)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    U : array_like (5, 5) or (n, n)
        Covariance of A0, A1, A-1, r, R, or of all ``PARAMETERS``.

    Returns
    -------
    Budget

    Raises
    ------
    RodgenError
        When U is not a covariance matrix, or the point has no regular pose.

    Examples
    --------
    >>> from rodgen import tricept
    >>> U = tricept.covariance({"rods": 0.0029, "radii": 0.0058})
    >>> found = tricept.budget([0.0, 0.0, 700.0], tricept.PAPER, U)
    >>> line = found.lines(2)[0]
    >>> line.parameter, round(line.share, 3)
    ('r', 0.311)
    """
    matrix = parameter_covariance(U)
    count = len(matrix)
    S = _without_rounding(regular_place(point, geometry)[2][:, :count])
    parts = S * (S @ matrix)
    off = matrix[~np.eye(count, dtype=bool)]
    return Budget(
        PARAMETERS[:count], S, np.sqrt(np.diagonal(matrix)), parts, S @ matrix @ S.T, bool((off != 0).any())
    )


def _without_rounding(S: Array) -> Array:
    """Return sensitivities with those set to 0 that are rounding relative to the greatest, of lengths and of angles."""
    angle = np.array([name in ANGLES for name in PARAMETERS[: S.shape[1]]])
    greatest = np.where(angle, np.abs(S[:, angle]).max(initial=0.0), np.abs(S[:, ~angle]).max(initial=0.0))
    return np.where(np.abs(S) > _ROUNDING * greatest, S, 0.0)


_BATCHES = 20
_BLOCK = 20_000


@with_html
@dataclass(frozen=True)
class MonteCarlo:
    """The results of the draws and of the linear law for one point.

    Attributes
    ----------
    point : ndarray, shape (3,)
        Q with the nominal parameters: the estimate of the linear law.
    draws, failed : int
        Numbers of draws, and of those without a pose, which are left out.
    probability : float
        Of the coverage intervals.
    mean, covariance : ndarray, shape (3,) and (3, 3)
        Of the draws.
    linear_covariance : ndarray, shape (3, 3)
        By the law of propagation.
    symmetric, shortest : ndarray, shape (3, 2)
        The probabilistically symmetric and the shortest coverage interval of each coordinate.
    linear : ndarray, shape (3, 2)
        Q ± k u of the linear law, with k of the normal distribution.
    end_uncertainty : ndarray, shape (3, 2)
        Standard uncertainty of the ends of `symmetric`, because the draws are finite.
    digits : int
        Significant digits of u that count.
    delta : ndarray, shape (3,)
        The numerical tolerance of clause 7.9.2.
    difference : ndarray, shape (3, 2)
        d_low and d_high of clause 8.1.
    validated : ndarray, shape (3,) of bool
        Whether both are at most `delta`.
    enough : ndarray, shape (3,) of bool
        Whether there are as many draws as clause 8.2 requires: twice `end_uncertainty` is at most delta/5.
    """

    point: Array
    draws: int
    failed: int
    probability: float
    mean: Array
    covariance: Array
    linear_covariance: Array
    symmetric: Array
    shortest: Array
    linear: Array
    end_uncertainty: Array
    digits: int
    delta: Array
    difference: Array
    validated: NDArray[np.bool_]
    enough: NDArray[np.bool_]

    def summary(self, unit: str = "") -> str:
        """Return a text table."""
        lines = [
            f"{self.draws} draws"
            + (f", {self.failed} without a pose" if self.failed else "")
            + f"; {100 * self.probability:g} % intervals, {self.digits} digits"
        ]
        for k, axis in enumerate("xyz"):
            low, high = self.symmetric[k] - self.point[k]
            spread = np.sqrt(self.covariance[k, k])
            by_law = np.sqrt(self.linear_covariance[k, k])
            verdict = "agrees" if self.validated[k] else "does not agree"
            lines.append(
                f"Q{axis}: u {spread:.4g} {unit} (linear {by_law:.4g}), mean {self.mean[k] - self.point[k]:+.2g}, "
                f"interval {low:+.4g} to {high:+.4g}; the linear law {verdict} to {self.delta[k]:.1g}"
                + ("" if self.enough[k] else " (more draws are needed to be sure)")
            )
        return "\n".join(lines)


def monte_carlo(
    point: ArrayLike,
    geometry: Geometry,
    U: ArrayLike,
    *,
    draws: int = 1_000_000,
    rectangular: Collection[str] = (),
    probability: float = 0.95,
    digits: int = 2,
    seed: int = 0,
) -> MonteCarlo:
    """Return the distribution of a point by drawing the parameters, compared with the linear law.

    Parameters
    ----------
    point : array_like (3,)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    U : array_like (5, 5) or (n, n)
        Covariance of A0, A1, A-1, r, R, or of all ``PARAMETERS``.
    draws : int, optional
        How many.
    rectangular : collection of str, optional
        Parameters whose error is anywhere within ±√3 u with equal probability, such as those of the paper's Table 1;
        they must have no correlations. All others are normal.
    probability : float, optional
        Of the coverage intervals.
    digits : int, optional
        How many significant digits of u count in the comparison, 1 or 2.
    seed : int, optional
        Of the random numbers.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    RodgenError
        When U is not a covariance matrix, an option is out of range, or the point has no regular pose.

    Notes
    -----
    JCGM 101:2008 (GUM Supplement 1), clauses 5.9, 7.7, 7.9 and 8.

    Examples
    --------
    >>> from rodgen import tricept
    >>> U = tricept.covariance({"rods": 0.0029, "radii": 0.0058})
    >>> found = tricept.monte_carlo([0.0, 0.0, 700.0], tricept.PAPER, U, draws=20_000)
    >>> bool(abs(found.covariance[2, 2] / found.linear_covariance[2, 2] - 1) < 0.05)
    True
    """
    if not (isinstance(draws, int | np.integer) and draws >= 1000):
        raise RodgenError(f"{draws} draws; expected a whole number from 1000 up")
    if not 0 < probability < 1:
        raise RodgenError(f"the probability is {probability}; expected a number between 0 and 1")
    if digits not in (1, 2):
        raise RodgenError(f"{digits} significant digits; expected 1 or 2")
    given = parameter_covariance(U)
    matrix = np.zeros((len(PARAMETERS),) * 2)
    matrix[: len(given), : len(given)] = given
    uniform = _uniform(matrix, rectangular)
    place, pose, S = regular_place(point, geometry)
    places = _drawn(pose, geometry, matrix, uniform, int(draws), np.random.default_rng(seed))
    good = places[np.isfinite(places).all(axis=1)]
    if len(good) < 1000:
        raise RodgenError(f"only {len(good)} of {draws} draws have a pose; expected smaller uncertainties")
    linear_U = S @ matrix @ S.T
    u = np.sqrt(np.diagonal(linear_U))
    k = NormalDist().inv_cdf((1 + probability) / 2)
    linear = place[:, None] + k * u[:, None] * [-1.0, 1.0]
    symmetric, shortest = coverage_intervals(good, probability)
    parts = good[: len(good) // _BATCHES * _BATCHES].reshape(_BATCHES, -1, 3)
    ends = np.stack([coverage_intervals(part, probability)[0] for part in parts])
    spread = ends.std(axis=0, ddof=1) / math.sqrt(_BATCHES)
    U_y = np.cov(good.T)
    delta = np.array([numerical_tolerance(float(x), digits) for x in np.sqrt(np.diagonal(U_y))])
    difference = np.abs(linear - symmetric)
    return MonteCarlo(
        place,
        int(draws),
        int(draws) - len(good),
        probability,
        place + (good - place).mean(axis=0),
        U_y,
        linear_U,
        symmetric,
        shortest,
        linear,
        spread,
        digits,
        delta,
        difference,
        np.asarray((difference <= delta[:, None]).all(axis=1)),
        (2 * spread <= delta[:, None] / 5).all(axis=1),
    )


def _uniform(matrix: Array, names: Collection[str]) -> NDArray[np.bool_]:
    chosen = np.zeros(len(PARAMETERS), bool)
    for name in names:
        if name not in PARAMETERS:
            raise RodgenError(
                f"{name!r} is not a parameter of a Tricept; expected one of {', '.join(PARAMETERS)}"
            )
        n = PARAMETERS.index(name)
        if np.delete(matrix[n], n).any():
            raise RodgenError(
                f"{name} is correlated and cannot be drawn from a rectangle; expected no correlation"
            )
        chosen[n] = True
    return chosen


def _drawn(
    pose: Array,
    geometry: Geometry,
    matrix: Array,
    uniform: NDArray[np.bool_],
    draws: int,
    random: np.random.Generator,
) -> Array:
    """Return drawn places, made in blocks: a million draws of 43 parameters would fill the memory."""
    correlation, sizes = correlation_of(matrix)
    values, vectors = np.linalg.eigh(np.where(uniform | uniform[:, None], 0.0, correlation))
    root = sizes[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    root = root[:, values > 1e-14]
    parts = []
    for start in range(0, draws, _BLOCK):
        count = min(_BLOCK, draws - start)
        errors = random.standard_normal((count, root.shape[1])) @ root.T
        errors[:, uniform] = (
            math.sqrt(3.0) * sizes[uniform] * random.uniform(-1, 1, (count, int(uniform.sum())))
        )
        parts.append(disturbed_point(pose, geometry, errors)[0])
    return np.concatenate(parts)


def coverage_intervals(values: ArrayLike, probability: float) -> tuple[Array, Array]:
    """Return the symmetric and the shortest coverage intervals (m, 2) of n draws of m quantities (n, m).

    JCGM 101:2008, clause 7.7.2: with q = [P n] the symmetric interval is from draw r = [(n − q)/2] on.
    """
    ordered = np.sort(np.asarray(values, float), axis=0)
    n = len(ordered)
    inside = min(math.floor(probability * n + 0.5), n - 1)
    first = max(math.floor((n - inside) / 2 + 0.5) - 1, 0)
    symmetric = np.stack([ordered[first], ordered[first + inside]], axis=-1)
    widths = ordered[inside:] - ordered[: n - inside]
    least = widths.argmin(axis=0)
    columns = np.arange(ordered.shape[1])
    return symmetric, np.stack([ordered[least, columns], ordered[least + inside, columns]], axis=-1)


def numerical_tolerance(u: float, digits: int = 2) -> float:
    """Return half a unit of the last significant digit of a standard uncertainty: JCGM 101:2008, clause 7.9.2."""
    if not u > 0:
        return 0.0
    return float(f"5e{-int(last_decimal(u, digits)) - 1}")
