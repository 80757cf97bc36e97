"""The pairs of a fit, checked and brought to moderate size about a common origin, and their residuals.

The residual of a pair against an axis is d = ρ′ - p - R(e, χ)(ρ - p). With noise of covariance σ² I on both ρ and ρ′,
d has covariance 2σ² I whatever the rotation, and half of Σ |d|²/(2σ²) is the negative log-likelihood of e and p once
the true ρ are eliminated. The kernel is derived, proved and generated in ``derivation/axis.py``; it forms ρ′ - ρ and
(R - I)(ρ - p) apart, which keeps the smallest angles exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.axis_fit.moments import Moments, global_maximum
from rodgen.kinematics.backend import kernels

BLOCK = 1 << 16
"""Pairs that are looked at together, so that what is computed of them stays in the cache."""
# Pairs at a time: the derivatives, eighteen numbers a pair, stay in the cache.
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Line:
    """An axis and a point on it, scaled lengths; with batch axes, many of them."""

    axis: Array
    point: Array

    def nearest(self, to: Array) -> Line:
        """Return the same line with its point nearest to `to`."""
        return Line(self.axis, self.point + self.axis * (self.axis @ (to - self.point)))


def residual_and_jacobian(
    rho: Array, rho_prime: Array, angle: Array, axis: Array, point: Array
) -> tuple[Array, Array]:
    """Return the residuals (N, 3) of pairs against one axis, and their derivatives (N, 3, 6) by axis and point.

    Of the derivatives by the axis only those perpendicular to it mean anything.
    """
    d, jacobian = kernels.axis_residual(rho, rho_prime, angle, axis, point)
    return d, jacobian


def residual(rho: Array, rho_prime: Array, angle: Array, axis: Array, point: Array) -> Array:
    """Return the residuals (N, 3) alone; arguments as :func:`residual_and_jacobian`."""
    d = np.empty_like(rho)
    for first in range(0, len(d), _BLOCK):
        block = slice(first, first + _BLOCK)
        d[block] = residual_and_jacobian(rho[block], rho_prime[block], angle[block], axis, point)[0]
    return d


def residual_gradient(
    rho: Array, rho_prime: Array, angle: Array, weight: Array, axis: Array, point: Array
) -> tuple[Array, Array]:
    """Return the derivatives of ½ Σ w |d|² by axis (3,) and point (3,); arguments as :func:`residual_and_jacobian`."""
    gradient = np.zeros(6)
    for first in range(0, len(rho), _BLOCK):
        block = slice(first, first + _BLOCK)
        d, jacobian = residual_and_jacobian(rho[block], rho_prime[block], angle[block], axis, point)
        gradient += (weight[block, None] * d).ravel() @ jacobian.reshape(-1, 6)
    return gradient[:3], gradient[3:]


_EPS = float(np.finfo(float).eps)
# A half angle's sine at which a turn is rounding of the angle itself, and far below that of the points.
ZERO_TURN = 4 * _EPS
# Sigma and the lengths are kept within this power of two of each other: a ratio that no data have.
_WIDEST = 400


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs in scaled lengths: true length = `origin` + `scale` · length here.

    Sums over many pairs go over them a block at a time.
    """

    rho: Array
    rho_prime: Array
    """Shape (N, 3)."""
    angle: Array
    """All zero where no pair turns by more than rounding, (N,)."""
    weight: Array
    """Relative inverse variances, at most 1; 0 for pairs that are left out, (N,)."""
    point: Array | None
    """The known point (then the origin), or None where it is free, (3,)."""
    variance: float | None
    """Variance of a coordinate of a reading of weight 1, where sigma was given."""
    sigma: float
    """Root mean square of the sigma given, in the user's unit; NaN where none was."""
    unit_weight: float
    """Weight here of a pair to which the user gave weight 1."""
    scale: float
    """A power of two."""
    origin: Array
    """In the user's unit, (3,)."""
    size: float
    """Largest coordinate before the origin was subtracted, scaled."""
    slid: bool = False
    """Whether a slide along the axis was fitted and taken off."""

    @property
    def rounding(self) -> float:
        """Rounding error of a coordinate."""
        return _EPS * max(self.size, 1.0)

    @property
    def parameters(self) -> int:
        """What is fitted: two angles of the axis, two coordinates of a free point, a slide; nothing without a turn."""
        if not self.angle[self.weight > 0].any():
            return 0
        return (4 if self.point is None else 2) + self.slid

    def only(self, rows: Any) -> Pairs:
        """Return some of the pairs; `rows` (S, k) makes sets of them, for :meth:`best_line`."""
        arrays = (self.rho, self.rho_prime, self.angle, self.weight)
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            if rows.all():
                return self
            rows = np.flatnonzero(rows)
        rho, rho_prime, angle, weight = (array[rows] for array in arrays)
        return replace(self, rho=rho, rho_prime=rho_prime, angle=angle, weight=weight)

    def blocks(self) -> Iterator[tuple[slice, Pairs]]:
        """Yield all pairs, block by block, each with its place."""
        if len(self.angle) <= BLOCK:
            yield slice(None), self
            return
        for rows in blocks(self.angle):
            yield rows, self.only(rows)

    def weighted(self, share: NDArray[Any]) -> Pairs:
        """Return the pairs with their weights multiplied by `share`."""
        return replace(self, weight=self.weight * share)

    def moments(self) -> Moments:
        """Return the sums on which the likelihood depends."""
        if self.angle.ndim > 1 or len(self.angle) <= BLOCK:
            return self._moments_about(self.point)
        centre = self.point
        if centre is None:
            rough = Moments.total(block._moments_about(np.zeros(3)) for _, block in self.blocks())
            centre = rough.M / rough.D if rough.D > 0 else rough.M
        sums = Moments.total(block._moments_about(centre) for _, block in self.blocks())
        return replace(sums, free=self.point is None)

    def _moments_about(self, centre: Array | None) -> Moments:
        return Moments.of(self.rho, self.rho_prime, self.angle, self.weight, centre)

    def best_line(self) -> Line:
        """Return the most likely line, of each set of pairs where these are sets."""
        moments = self.moments()
        axis = global_maximum(*moments.quadratic())
        return Line(axis, moments.point(axis))

    def residuals(self, line: Line) -> Array:
        """Return the residuals (N, 3)."""
        return residual(self.rho, self.rho_prime, self.angle, line.axis, line.point)

    def half_squares(self, line: Line) -> Array:
        """Return w |d|²/2 of every pair: three times the variance of unit weight, in the mean."""
        squares = np.empty(len(self.angle))
        for rows, block in self.blocks():
            d = block.residuals(line)
            squares[rows] = block.weight * (d[:, 0] ** 2 + d[:, 1] ** 2 + d[:, 2] ** 2) / 2
        return squares

    @classmethod
    def of(
        cls,
        rho: ArrayLike,
        rho_prime: ArrayLike,
        angle: ArrayLike,
        point: Any,
        sigma: ArrayLike | None,
        weights: ArrayLike | None,
    ) -> Pairs:
        """Check, broadcast, flatten, shift and scale."""
        x, y = real_array("rho", rho, (3,)), real_array("rho_prime", rho_prime, (3,))
        a = real_array("angle", angle)
        try:
            shape = np.broadcast_shapes(x.shape[:-1], y.shape[:-1], a.shape)
        except ValueError:
            raise RodgenError(
                f"rho {x.shape}, rho_prime {y.shape} and angle {a.shape} do not fit together; "
                "expected (N, 3), (N, 3) and (N,) or one angle for all"
            ) from None
        x = np.broadcast_to(x, (*shape, 3)).reshape(-1, 3)
        y = np.broadcast_to(y, (*shape, 3)).reshape(-1, 3)
        a = np.broadcast_to(a, shape).reshape(-1)
        if len(a) == 0:
            raise RodgenError("rho, rho_prime and angle hold no pairs; at least one is needed")
        for name, values in (("rho", x), ("rho_prime", y), ("angle", a)):
            demand_finite(name, values)
        if (np.abs(np.sin(a / 2)) <= ZERO_TURN).all():
            # No turn at all, rather than a turn about a point that noise puts at infinity.
            a = np.zeros(len(a))
        known = _known_point(point)

        ends = np.concatenate([_ends(x), _ends(y)])
        exponent = _exponent(np.abs(ends if known is None else np.concatenate([ends, known[None]])))
        # The median, not the mean: one gross error must not move the origin to where differences cancel.
        middle = (
            _median(x, exponent) / 2 + _median(y, exponent) / 2
            if known is None
            else np.ldexp(known, -exponent)
        )
        ends = np.ldexp(ends, -exponent)
        size = max(float(np.abs(ends).max()), float(np.abs(middle).max()))
        second = _exponent(np.abs(ends - middle))
        if sigma is not None:
            # Lengths that are negligible against sigma must not make its square overflow.
            second = max(second, _exponent(np.abs(real_array("sigma", sigma))) - exponent - _WIDEST)
        second = min(second, 1023 - exponent)  # so that the scale is a number
        x, y = (_scaled(values, exponent, middle, second) for values in (x, y))

        w, variance, unit, rms_sigma = _weights(sigma, weights, shape, exponent + second)
        return cls(
            rho=x,
            rho_prime=y,
            angle=np.ascontiguousarray(a),
            weight=w,
            point=None if known is None else np.zeros(3),
            variance=variance,
            sigma=rms_sigma,
            unit_weight=unit,
            scale=float(np.ldexp(1.0, exponent + second)),
            origin=np.ldexp(middle, exponent),
            size=float(np.ldexp(size, -second)),
        )


def blocks(array: Array) -> Iterator[slice]:
    """Yield slices that cover an array, (n, ...)."""
    for first in range(0, len(array), BLOCK):
        yield slice(first, first + BLOCK)


def demand_finite(name: str, values: Array) -> None:
    """Refuse rows, (n, ...), that have a number that is not finite; the sentence names the first."""
    good = np.isfinite(values)
    bad = np.flatnonzero(~(good.reshape(len(good), -1).all(axis=1)))
    if len(bad):
        row, more = int(bad[0]), len(bad) - 1
        others = f" ({more} more rows are like it)" if more else ""
        raise RodgenError(
            f"{name}, row {row} (counted from 0) is {_shown(values[row])}; expected finite numbers; "
            f"leave such rows out{others}"
        )


def _ends(points: Array) -> Array:
    """Return the least and the largest coordinates, (2, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def _median(points: Array, exponent: int) -> Array:
    """Return the median of each coordinate, (3,), divided by a power of two."""
    columns = (np.ldexp(column, -exponent) for column in points.T)
    return np.array([np.median(column, overwrite_input=True) for column in columns])


def _scaled(points: Array, exponent: int, middle: Array, second: int) -> Array:
    # in rows, whatever the order of the array that was given: sums over it have the same digits
    return np.ascontiguousarray(np.ldexp(np.ldexp(points, -exponent) - middle, -second))


def _known_point(point: Any) -> Array | None:
    if isinstance(point, str):
        if point == "free":
            return None
        raise RodgenError(
            f"point is {point!r}; expected 'free' or the three coordinates of a point on the axis"
        )
    known = real_array("point", point)
    if known.shape != (3,):
        raise RodgenError(
            f"point has shape {known.shape}; expected 'free' or the three coordinates of a point on the axis"
        )
    if not np.isfinite(known).all():
        raise RodgenError(f"point is {_shown(known)}; expected finite coordinates")
    return known


def _weights(
    sigma: ArrayLike | None, weights: ArrayLike | None, shape: tuple[int, ...], exponent: int
) -> tuple[Array, float | None, float, float]:
    """Relative inverse variances (N,), variance at weight 1 if known, weight of a user's 1, rms sigma."""
    if weights is None and (sigma is None or np.ndim(sigma) == 0):
        # One weight for all, which needs no array of them.
        _, variance, unit, rms = _weights(sigma, np.ones(1), (1,), exponent)
        return np.broadcast_to(1.0, (math.prod(shape),)), variance, unit, rms
    given = np.ones(shape) if weights is None else _broadcast("weights", weights, shape)
    if (given < 0).any():
        row = int(np.argmax(given.ravel() < 0))
        raise RodgenError(f"weights, row {row} (counted from 0) is negative; expected 0 or more")
    used = given > 0
    if not used.any():
        raise RodgenError("all weights are zero; at least one pair must count")
    if sigma is None:
        largest = float(given.max())
        return (given / largest).ravel(), None, 1 / largest, float("nan")
    s = _broadcast("sigma", sigma, shape)
    if not (s > 0).all():
        row = int(np.argmin(s.ravel() > 0))
        raise RodgenError(
            f"sigma, row {row} (counted from 0) is not positive; expected a standard uncertainty"
        )
    scaled = np.ldexp(s, -exponent)
    scaled = np.maximum(scaled, 2.0**-_WIDEST)
    reach = np.where(used, scaled / np.sqrt(np.where(used, given, 1.0)), np.inf)
    smallest = float(reach.min())
    rms = smallest * float(np.sqrt(np.mean((scaled[used] / smallest) ** 2)))
    return ((smallest / reach) ** 2).ravel(), smallest**2, float("nan"), float(np.ldexp(rms, exponent))


def _broadcast(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = real_array(name, values)
    try:
        array = np.broadcast_to(array, shape)
    except ValueError:
        raise RodgenError(
            f"{name} has shape {array.shape}; expected one number, or one a pair: {shape}"
        ) from None
    demand_finite(name, array.ravel())
    return array


def _exponent(sizes: Array) -> int:
    """Exponent of two that brings the largest size to between 1/2 and 1; 0 for all zero."""
    largest = float(sizes.max(initial=0.0))
    return int(np.frexp(largest)[1]) if np.isfinite(largest) else 0


def _shown(value: Array) -> str:
    return np.array2string(np.ravel(value), separator=", ", max_line_width=1000)
