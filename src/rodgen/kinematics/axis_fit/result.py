"""The result of a fit: the axis, its uncertainty, the motions about it, and what the readings do not determine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.units import ARCSEC
from rodgen.errors import counted, joined
from rodgen.statistics.digits import last_decimal, measured
from rodgen.views import plain, with_html

TWO_SIDED = 1.96
"""Standard deviations within which 95 % of a normal distribution are."""
ZERO_CHANCE = 0.05
"""Probability below which a slide is not zero within its uncertainty: the usual 95 %."""
MOST_SHOWN = 12
"""Motions that a summary has lines for."""
FEW_FREEDOMS = 10
"""Below this many degrees of freedom the estimated noise is too uncertain for the usual two sigma."""
NO_ACCIDENT = 5.0
"""A statistic this many of its standard deviations off is no accident."""

_KEYS = (
    "status undetermined remarks pairs outliers axis axis_uncertainty_rad=axis_uncertainty "
    "point point_known point_uncertainty covariance_axis_point=covariance origin rms sigma sigma_angle_rad=sigma_angle "
    "sigma_given dof chi_square condition candidate_axes candidate_points candidate_rms free_directions loss "
    "iterations slide slide_uncertainty slide_fitted slide_by_angle motions"
)


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
class Motions:
    """Angles and slides that were fitted, of each motion; uncertainties are standard uncertainties.

    Attributes
    ----------
    labels : tuple of str
        Those of the table, or the numbers of the poses, from 1.
    angles, angle_uncertainty : (M,) arrays
        In rad, from -π to π, or to the nearest whole turn of its reading.
    slides, slide_uncertainty : (M,) arrays
        Along the axis.
    no_slide : float or None
        Probability of slides as large as these where there are none; None where the noise is not known.
    one_pitch : float or None
        Probability of slides so far from one pitch; None of one motion, or without a turn.
    """

    labels: tuple[str, ...]
    angles: Array
    angle_uncertainty: Array
    slides: Array
    slide_uncertainty: Array
    no_slide: float | None
    one_pitch: float | None

    def lines(self, pitch: float, uncertainty: float) -> list[str]:
        """Return the lines of a summary, with the slide for each radian, where the motions have one."""
        angles = _measured(np.degrees(self.angles[:MOST_SHOWN]), np.degrees(self.angle_uncertainty))
        slides = _measured(self.slides[:MOST_SHOWN], self.slide_uncertainty)
        count = len(self.angles)
        if count == 1:
            about = ": zero within its uncertainty" if (self.no_slide or 0.0) >= ZERO_CHANCE else ""
            return [f"  angle       {angles[0]} deg", f"  slide       {slides[0]}{about}"]
        lines = table_lines({"motion": self.labels, "angle [deg]": angles, "slide": slides})
        if count > MOST_SHOWN:
            lines.append(f"  and {count - MOST_SHOWN} more motions")
        if self.no_slide is None:
            about = ""
        elif self.no_slide >= ZERO_CHANCE:
            about = "zero within their uncertainties"
        elif self.one_pitch is not None and self.one_pitch >= ZERO_CHANCE:
            units = np.array([1, 2 * math.pi])
            radian, turn = _measured(pitch * units, uncertainty * units)
            about = f"in proportion to the angles: {radian} for each radian, {turn} a turn"
        else:
            about = "not zero, and not in proportion to the angles"
        return [*lines, f"  slides      {about}"]

    def to_dict(self) -> dict[str, Any]:
        """Return them as plain Python values."""
        names = "labels angles_rad=angles angle_uncertainty_rad=angle_uncertainty"
        return plain(self, f"{names} slides slide_uncertainty no_slide one_pitch")


@with_html
@dataclass(frozen=True, eq=False)
class AxisFit:
    """One axis of rotations, or of screws, fitted to pairs of points or to poses.

    A row is one of the pairs, or one of the poses. Uncertainties are standard uncertainties (one sigma). Where sigma is
    estimated from few degrees of freedom, errors divided by them follow Student's t with `dof`, not the normal
    distribution: twice the uncertainty holds less than 95 %, and a remark says so. Lengths are in the unit of the
    input, angles in radians.

    Attributes
    ----------
    axis : (3,) array
        Unit direction; the angles given are positive about it by the right-hand rule. Without any, the first motion
        that is near neither a half turn nor none is positive.
    point : (3,) array
        Point on the axis: the known one, or where free the point of the axis nearest to `origin`.
    origin : (3,) array
        The point that was asked for; else the mean of the points of pairs that are not outliers, by what each counted,
        or of all readings.
    covariance : (6, 6) array
        Joint covariance of `axis` and `point`; rank 4, or 2 where the point is known. NaN where the
        direction is not determined exactly, or the noise is not known.
    sigma : float
        Standard uncertainty of one coordinate of one reading (unit weight): given, root mean square where
        one a pair was given; otherwise estimated from the residuals. NaN with nothing left to estimate from.
    sigma_angle : float
        Of an attitude about each axis, or of a reading of the angle; NaN where there is none, or it is unknown.
    sigma_given : bool
        Whether `sigma` was given.
    dof : int
        Degrees of freedom: numbers read that count, less what was fitted; of poses whose noises are estimated, those of
        each noise.
    chi_square : float or None
        Weighted squares of the residuals, where sigma was given, over what is no outlier of exact angles; about `dof`
        if all is well.
    rms : float
        Root mean square length of a residual, over the rows that are not outliers.
    residuals : (N, 3) array
        ρ′ - p - R(ρ - p) of every pair, less a slide that was fitted; of a pose by what its position is off.
    turns : (N,) array
        The angle of each row's motion, given or fitted; of a pose, from the first one.
    weights : (N,) array
        Weight of each row: 1, less where the loss reduced it, 0 where it was left out.
    outliers : (N,) bool array
        Rows beyond the limit that the worst row of one good data set in a hundred exceeds; they are named, but with
        ``loss="linear"`` still count. Without exact angles the worst one alone.
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
    motions : Motions or None
        What was fitted of each motion; None where all angles are given as exact.
    slide, slide_uncertainty : float
        By how much the points move along the axis, in each pair or for each radian; NaN uncertainty where unknown. Of
        several fitted motions, their pitch.
    slide_fitted : bool
        Whether it is a parameter of the fit, where chance does not explain it; else the axis is that of pure turns.
    slide_by_angle : bool
        Whether the slide is in proportion to the angle.
    """

    axis: Array
    point: Array
    origin: Array
    covariance: Array
    sigma: float
    sigma_angle: float
    sigma_given: bool
    dof: int
    chi_square: float | None
    rms: float
    residuals: Array
    turns: Array
    weights: Array
    outliers: NDArray[np.bool_]
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
    motions: Motions | None
    slide: float
    slide_uncertainty: float
    slide_fitted: bool
    slide_by_angle: bool

    @property
    def pairs(self) -> int:
        """Number of pairs, or of poses, given."""
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

    def summary(self, places: Callable[[NDArray[np.int_]], str] | None = None) -> str:
        """Return a summary of a few lines.

        Parameters
        ----------
        places : callable, optional
            Returns the names of pairs from their indices; left out, these are counted from 0, as in the arrays.
        """
        used = int(np.count_nonzero(self.weights))
        pairs = counted(self.pairs, "pair")
        if self.motions is None:
            point = "point known" if self.point_known else "point free"
            lines = [f"Axis fitted to {pairs} ({point}, loss {self.loss}): {self.status.name}"]
        else:
            count = len(self.motions.labels)
            lines = [f"Helical axis of {counted(count, 'motion')}: {self.status.name}"]
        u = self.axis_uncertainty
        lines += [
            f"  direction   {vector_text(self.axis, u[0])}",
            f"              {angle_text(u[0])} in the worst direction, {angle_text(u[1])} perpendicular to it",
        ]
        if not self.point_known:
            near = vector_text(self.origin, math.nan)
            lines += [
                f"  point       {vector_text(self.point, self.point_uncertainty.max())}",
                f"              ± {lengths_text(self.point_uncertainty)}; nearest to {near}",
            ]
        if self.motions is not None:
            lines += self.motions.lines(self.slide, self.slide_uncertainty)
        elif math.isfinite(self.slide_uncertainty):
            lines.append(f"  slide       {self._about_slide()}")
        of_them = f"; {used} of {pairs} count{'s' * (self.pairs == 1)}" if self.motions is None else ""
        lines.append(f"  residuals   rms {self.rms:.4g}{of_them}")
        source = "given" if self.sigma_given else f"estimated, {self.dof} degrees of freedom"
        noise = "unknown" if math.isnan(self.sigma) else f"{self.sigma:.4g} a coordinate of a reading"
        if math.isfinite(self.sigma_angle):
            noise += f", {angle_text(self.sigma_angle)[2:]} an attitude or angle"
        lines.append(f"  noise       {noise}{'' if math.isnan(self.sigma) else f' ({source})'}")
        if self.chi_square is not None:
            spread = math.sqrt(2 * max(self.dof, 0))
            lines.append(f"  chi-square  {self.chi_square:.5g}, expected {self.dof} ± {spread:.2g}")
        lines.append(f"  condition   {self.condition:.3g}")
        bad = np.flatnonzero(self.outliers)
        if len(bad):
            named = f"pair {joined(map(str, bad))} (counted from 0)"
            lines.append(f"  outliers    {len(bad)}: {places(bad) if places else named}")
        lines += [f"  not determined: {sentence}" for sentence in self.undetermined]
        lines += [f"  remark: {sentence}" for sentence in self.remarks]
        return "\n".join(lines)

    def _about_slide(self) -> str:
        (size,) = _measured([self.slide], [self.slide_uncertainty])
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
            Whether residuals and weights of every row are included.
        """
        content = plain(self, _KEYS + " residuals weights" * pairwise)
        return content | {"outliers": np.flatnonzero(self.outliers).tolist()}


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


def _measured(values: Any, uncertainties: Any) -> list[str]:
    return [" ± ".join(measured(float(x), float(u))) for x, u in zip(values, uncertainties, strict=False)]


def table_lines(columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the lines of a table of a summary; the shortest column ends it."""
    rows = [tuple(columns), *zip(*columns.values(), strict=False)]
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def remarks_on_noise(known: bool, dof: int, chi_square: float | None, determined: bool) -> list[str]:
    """Return sentences on few degrees of freedom, and on residuals that a noise that was given does not explain."""
    if not known:
        return [_few_freedoms(dof)] if determined and 0 < dof < FEW_FREEDOMS else []
    excess = 0.0 if chi_square is None else chi_square - dof
    if dof <= 0 or abs(excess) <= NO_ACCIDENT * math.sqrt(2 * dof):
        return []
    return [
        f"The residuals are {math.sqrt(1 + excess / dof):.3g} times what sigma leads to expect; "
        "the reported uncertainties are those of sigma."
    ]


def _few_freedoms(dof: int) -> str:
    """Return how far the 95 % region reaches when the noise is estimated with `dof` degrees of freedom.

    The direction has two components: the region is where their squares, in units of the uncertainties, sum
    to less than twice the quantile of F with 2 and `dof` degrees of freedom, dof (0.05^(-2/dof) - 1) in
    closed form; with a known noise it is -2 log 0.05.
    """
    reach = math.sqrt(dof * (0.05 ** (-2 / dof) - 1))
    known = math.sqrt(-2 * math.log(0.05))
    degrees = "1 degree" if dof == 1 else f"{dof} degrees"
    return (
        f"The noise is estimated with {degrees} of freedom: the region that holds the direction with 95 % "
        f"probability reaches to {reach:.2g} standard uncertainties, {reach / known:.2g} times as far as "
        "if the noise were known."
    )
