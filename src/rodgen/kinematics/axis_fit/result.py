"""The result of a fit: the axis, its uncertainty, and what the pairs do not determine."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.data.units import ARCSEC
from rodgen.errors import joined
from rodgen.statistics.digits import last_decimal, measured
from rodgen.views import plain, with_html

TWO_SIDED = 1.96
"""Standard deviations within which 95 % of a normal distribution are."""


class AxisFitStatus(IntEnum):
    """How far the pairs determine the direction of the axis.

    A free point is determined exactly when the direction is.
    """

    DETERMINED = 0
    """One axis."""
    SIGN_FREE = 1
    """One line, but the axis and its opposite fit alike: all angles are half turns, all points lie on the
    axis, or the noise hides the sense of the turn; `undetermined` says which."""
    TWO_AXES = 2
    """Two different axes fit alike; `candidate_axes` holds both."""
    ONE_FREEDOM = 3
    """The direction can turn one way, `free_directions`, and the residuals do not tell; `axis` represents."""
    ANY_AXIS = 4
    """The direction can turn any way; `axis` only represents."""


@with_html
@dataclass(frozen=True, eq=False)
class AxisFit:
    """One axis of rotation fitted to pairs of points.

    All uncertainties are standard uncertainties (one sigma). Where sigma is estimated from few degrees of
    freedom, errors divided by them follow Student's t with `dof`, not the normal distribution: twice the
    uncertainty holds less than 95 %, and a remark says so. Lengths are in the unit of the input, angles in
    radians.

    Attributes
    ----------
    axis : (3,) array
        Unit direction; the angles given are positive about it by the right-hand rule.
    point : (3,) array
        Point on the axis: the known one, or where free the point of the axis nearest to `centroid`.
    covariance : (6, 6) array
        Joint covariance of `axis` and `point`; rank 4, or 2 where the point is known. NaN where the
        direction is not determined exactly, or the noise is not known.
    sigma : float
        Standard uncertainty of one coordinate of one reading (unit weight): given, root mean square where
        one a pair was given; otherwise estimated from the residuals. NaN with nothing left to estimate from.
    sigma_given : bool
        Whether `sigma` was given.
    dof : int
        Degrees of freedom: three a pair that counts, less what was fitted.
    chi_square : float or None
        Where sigma was given: Σ |d|²/(2σ²) over the pairs that are not outliers; about `dof` if all is well.
    rms : float
        Root mean square length of a residual, over the pairs that are not outliers.
    residuals : (N, 3) array
        ρ′ - p - R(ρ - p) of every pair.
    weights : (N,) array
        Weight of each pair: 1, less where the loss reduced it, 0 where it was left out.
    outliers : (N,) bool array
        Pairs beyond the limit that the worst pair of one good data set in a hundred exceeds; with
        ``loss="linear"`` they are named but still count.
    centroid : (3,) array
        Mean of all points of the pairs that are not outliers, by what each pair counted.
    condition : float
        Ratio of the largest to the smallest uncertainty that unit noise gives direction (times the root mean
        square arm) and point; 1 is best, infinite where something is not determined.
    status : AxisFitStatus
        How far the direction is determined.
    undetermined : tuple of str
        One sentence for each thing that the pairs do not determine; empty where all is.
    remarks : tuple of str
        What else a user should know, one sentence each.
    candidate_axes, candidate_points : (K, 3) arrays
        All axes that fit equally well within the noise, best first; K is 1 or 2.
    candidate_rms : (K,) array
    free_directions : (F, 3) array
        Unit vectors towards which the axis can turn freely; F is 0, 1 or 2.
    point_known : bool
        Whether the point was given.
    loss : str
        Name of the loss.
    iterations : int
        Solutions computed with reduced weights; 0 for ``loss="linear"``, which needs one.
    slide, slide_uncertainty : float
        By how much the points move along the axis, in each pair or for each radian; NaN uncertainty where unknown.
    slide_fitted : bool
        Whether it is a parameter of the fit, where chance does not explain it; else the axis is that of pure turns.
    slide_by_angle : bool
        Whether the slide is in proportion to the angle.
    """

    axis: Array
    point: Array
    covariance: Array
    sigma: float
    sigma_given: bool
    dof: int
    chi_square: float | None
    rms: float
    residuals: Array
    weights: Array
    outliers: NDArray[np.bool_]
    centroid: Array
    condition: float
    status: AxisFitStatus
    undetermined: tuple[str, ...]
    remarks: tuple[str, ...]
    candidate_axes: Array
    candidate_points: Array
    candidate_rms: Array
    free_directions: Array
    point_known: bool
    loss: str
    iterations: int
    slide: float
    slide_uncertainty: float
    slide_fitted: bool
    slide_by_angle: bool

    @property
    def pairs(self) -> int:
        """Number of pairs given."""
        return len(self.outliers)

    @property
    def axis_covariance(self) -> Array:
        """Covariance (3, 3) of `axis`, of rank 2: a unit vector does not change along itself."""
        return self.covariance[:3, :3]

    @property
    def point_covariance(self) -> Array:
        """Covariance (3, 3) of `point`; zero where it is known."""
        return self.covariance[3:, 3:]

    @property
    def axis_uncertainty(self) -> Array:
        """Standard uncertainties (2,) of the direction in rad: the largest, and that at right angles to it."""
        return principal_sizes(self.axis_covariance)[:2]

    @property
    def point_uncertainty(self) -> Array:
        """Standard uncertainties (3,) of the coordinates of `point`."""
        return np.sqrt(np.maximum(np.diag(self.point_covariance), 0))

    def nearest_point(self, to: ArrayLike) -> tuple[Array, Array]:
        """Return the point of the axis nearest to a given one, and its covariance.

        Parameters
        ----------
        to : (3,) array_like
            Any point, such as the origin.

        Returns
        -------
        point : (3,) array
        covariance : (3, 3) array
            The farther `to` is from the data along the axis, the more the direction's uncertainty adds.
        """
        point, covariance = nearest(self.axis, self.point, self.covariance, np.asarray(to, dtype=float))
        return point, covariance[3:, 3:]

    def summary(self, places: Callable[[NDArray[np.int_]], str] | None = None) -> str:
        """Return a summary of a few lines.

        Parameters
        ----------
        places : callable, optional
            Returns the names of pairs from their indices; left out, these are counted from 0, as in the arrays.
        """
        point = "point known" if self.point_known else "point free"
        used = int(np.count_nonzero(self.weights))
        pairs = f"{self.pairs} pair{'s' * (self.pairs != 1)}"
        lines = [f"Axis fitted to {pairs} ({point}, loss {self.loss}): {self.status.name}"]
        u = self.axis_uncertainty
        lines.append(f"  direction   {vector_text(self.axis, u[0])}")
        lines.append(
            f"              {angle_text(u[0])} in the worst direction, {angle_text(u[1])} perpendicular to it"
        )
        if not self.point_known:
            lines.append(f"  point       {vector_text(self.point, self.point_uncertainty.max())}")
            lines.append(
                f"              ± {lengths_text(self.point_uncertainty)}; nearest to the centroid of the readings"
            )
        if math.isfinite(self.slide_uncertainty):
            lines.append(f"  slide       {self._about_slide()}")
        lines.append(f"  residuals   rms {self.rms:.4g}; {used} of {pairs} count{'s' * (self.pairs == 1)}")
        source = "given" if self.sigma_given else f"estimated, {self.dof} degrees of freedom"
        noise = (
            "unknown" if math.isnan(self.sigma) else f"{self.sigma:.4g} a coordinate of a reading ({source})"
        )
        lines.append(f"  noise       {noise}")
        if self.chi_square is not None:
            spread = math.sqrt(2 * max(self.dof, 0))
            lines.append(f"  chi-square  {self.chi_square:.5g}, expected {self.dof} ± {spread:.2g}")
        lines.append(f"  condition   {self.condition:.3g}")
        bad = np.flatnonzero(self.outliers)
        if len(bad):
            named = joined(map(str, bad))
            lines.append(
                f"  outliers    {len(bad)}: {places(bad) if places else f'pair {named} (counted from 0)'}"
            )
        lines += [f"  not determined: {sentence}" for sentence in self.undetermined]
        lines += [f"  remark: {sentence}" for sentence in self.remarks]
        return "\n".join(lines)

    def _about_slide(self) -> str:
        size = " ± ".join(measured(self.slide, self.slide_uncertainty))
        each = "for each radian" if self.slide_by_angle else "in each pair"
        if self.slide_fitted:
            return f"{size} {each}, fitted: as of a screw or an axial run-out"
        if abs(self.slide) <= TWO_SIDED * self.slide_uncertainty:
            return f"{size} {each}: zero within its uncertainty"
        return f"{size} {each}: not fitted, it may be chance"

    def __str__(self) -> str:
        return self.summary()

    def to_dict(self, *, pairwise: bool = True) -> dict[str, Any]:
        """Return all results as plain Python values for :mod:`json`; numbers that are not finite are None.

        Parameters
        ----------
        pairwise : bool
            Whether residuals and weights of every pair are included.
        """
        everything: dict[str, Any] = {
            "status": self.status.name,
            **plain(self, "undetermined remarks pairs"),
            "outliers": np.flatnonzero(self.outliers),
            "axis": self.axis,
            "axis_uncertainty_rad": self.axis_uncertainty,
            **plain(self, "point point_known point_uncertainty"),
            "covariance_axis_point": self.covariance,
            **plain(self, "centroid rms sigma sigma_given dof chi_square condition"),
            **plain(self, "candidate_axes candidate_points candidate_rms free_directions loss iterations"),
            **plain(self, "slide slide_uncertainty slide_fitted slide_by_angle"),
        }
        if pairwise:
            everything |= {"residuals": self.residuals, "weights": self.weights}
        return {key: plain_value(value) for key, value in everything.items()}


def nearest(axis: Array, point: Array, covariance: Array, to: Array) -> tuple[Array, Array]:
    """Return the point of an axis nearest to a given one, and the covariance (6, 6) of the axis and it.

    `covariance` is that of the axis and of the point given.
    """
    reach = to - point
    along = float(axis @ reach)
    jacobian = np.eye(6)
    jacobian[3:, :3] = along * np.eye(3) + np.outer(axis, reach)
    jacobian[3:, 3:] -= np.outer(axis, axis)
    return point + along * axis, jacobian @ covariance @ jacobian.T


def principal_sizes(covariance: Array) -> Array:
    """Return standard uncertainties along the principal directions, largest first; NaN where unknown."""
    if not np.isfinite(covariance).all():
        return np.full(len(covariance), np.nan)
    sizes: Array = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[::-1], 0))
    return sizes


def plain_value(value: Any) -> Any:
    """Return a value for JSON, with None for numbers that are not finite."""
    if isinstance(value, np.ndarray):
        return plain_value(value.tolist())
    if isinstance(value, list):
        return [plain_value(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def vector_text(value: Array, uncertainty: float) -> str:
    """Return coordinates to two digits of their uncertainty, as far as double precision has them."""
    size = float(np.abs(value).max())
    if size == 0:
        return "(0, 0, 0)"
    known = max(uncertainty if math.isfinite(uncertainty) else size * 1e-5, size * 1e-10, 5e-324)
    digits = int(last_decimal(known, 2))
    if 1e-6 <= size < 1e9 and 0 <= digits <= 16:
        return "(" + ", ".join(f"{c:z.{digits}f}" for c in value) + ")"
    figures = min(max(2 + digits - int(last_decimal(size, 1)), 3), 16)
    return "(" + ", ".join(f"{c:z.{figures - 1}e}" for c in value) + ")"


def lengths_text(values: Array) -> str:
    """Return uncertainties with two digits."""
    return "(" + ", ".join("unknown" if math.isnan(v) else f"{v:.2g}" for v in values) + ")"


def angle_text(radians: float) -> str:
    """Return the uncertainty of a direction."""
    if math.isnan(radians):
        return "± unknown"
    if radians > 0.02:
        return f"± {math.degrees(radians):.3g} deg"
    return f'± {radians * 1e6:.3g} µrad ({radians / ARCSEC:.3g}")'
