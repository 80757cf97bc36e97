"""The result of a fit of a helical axis."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.array_types import Array, Index
from rodgen.errors import joined
from rodgen.kinematics.axis_fit.result import (
    AxisFitStatus,
    angle_text,
    lengths_text,
    plain_value,
    principal_sizes,
    vector_text,
)
from rodgen.statistics.digits import measured
from rodgen.views import plain, with_html

MOST_SHOWN = 12
"""Motions that a summary has lines for."""
ZERO_CHANCE = 0.05
"""Probability below which a slide is not zero within its uncertainty: the usual 95 %."""


@with_html
@dataclass(frozen=True, eq=False)
class HelicalAxis:
    """One axis of screws fitted to points or poses, with the angle and the slide of each motion.

    Uncertainties are standard uncertainties. Lengths are in the unit of the input, angles in radians.

    Attributes
    ----------
    axis : (3,) array
        Unit direction. Without readings of the angle, the first motion that is near neither a half turn nor none is
        positive about it.
    point : (3,) array
        Point of the axis nearest to `origin`.
    origin : (3,) array
        The point that was asked for, or the middle of all readings.
    covariance : (6, 6) array
        Joint covariance of `axis` and `point`, of rank 4; NaN where the noise is not known.
    angles, angle_uncertainty : (M,) arrays
        Of each motion, from -π to π, or to the nearest whole turn of its reading.
    slides, slide_uncertainty : (M,) arrays
        Along the axis.
    motions : tuple of str
        The label of each motion: that of the table, or the number of the pose, from 1.
    no_slide : float or None
        Probability of slides as large as these where there are none; None where the noise is not known.
    pitch, pitch_uncertainty : float
        Slide for each radian, where all motions have one; NaN for one motion, or without a turn.
    one_pitch : float or None
        Probability of slides so far from one pitch.
    sigma : float
        Standard uncertainty of a coordinate of a reading; NaN where unknown.
    sigma_angle : float
        Of an attitude about each axis, or of a reading of the angle; NaN where there is none, or it is unknown.
    sigma_given : bool
    dof : int
        Degrees of freedom; of poses whose noises are estimated, those of each noise.
    chi_square : float or None
        Weighted squares of the residuals, where the noise was given; about `dof` if all is well.
    rms : float
        Root mean square length of a residual of a point.
    outliers : int array
        The row of the table whose point, or position, is farther off the others than the worst of good data in 99 of
        100 cases; empty without one.
    status : AxisFitStatus
        SIGN_FREE where all motions are half turns within their uncertainty. ANY_AXIS and ONE_FREEDOM where the axis is
        hidden in the noise.
    undetermined, remarks : tuple of str
    """

    axis: Array
    point: Array
    origin: Array
    covariance: Array
    angles: Array
    angle_uncertainty: Array
    slides: Array
    slide_uncertainty: Array
    motions: tuple[str, ...]
    no_slide: float | None
    pitch: float
    pitch_uncertainty: float
    one_pitch: float | None
    sigma: float
    sigma_angle: float
    sigma_given: bool
    dof: int
    chi_square: float | None
    rms: float
    outliers: Index
    status: AxisFitStatus
    undetermined: tuple[str, ...]
    remarks: tuple[str, ...]

    def summary(self, places: Callable[[Index], str] | None = None) -> str:
        """Return a summary of a few lines.

        Parameters
        ----------
        places : callable, optional
            Returns the names of rows from their indices; left out, these are counted from 0, as in the arrays.
        """
        count = len(self.angles)
        many = f"{count} motion{'s' * (count != 1)}"
        u = self.axis_uncertainty
        lines = [
            f"Helical axis of {many}: {self.status.name}",
            f"  direction   {vector_text(self.axis, u[0])}",
            f"              {angle_text(u[0])} in the worst direction, {angle_text(u[1])} perpendicular to it",
            f"  point       {vector_text(self.point, self.point_uncertainty.max())}",
            f"              ± {lengths_text(self.point_uncertainty)}; nearest to {vector_text(self.origin, math.nan)}",
        ]
        angles = [
            " ± ".join(measured(math.degrees(a), math.degrees(u)))
            for a, u in zip(self.angles[:MOST_SHOWN], self.angle_uncertainty, strict=False)
        ]
        slides = [
            " ± ".join(measured(s, u)) for s, u in zip(self.slides, self.slide_uncertainty, strict=True)
        ]
        if count == 1:
            lines += [f"  angle       {angles[0]} deg", f"  slide       {slides[0]}{self._about_slides()}"]
        else:
            lines += table_lines({"motion": self.motions, "angle [deg]": angles, "slide": slides})
            if count > MOST_SHOWN:
                lines.append(f"  and {count - MOST_SHOWN} more motions")
            lines.append(f"  slides      {self._about_slides()}")
        lines.append(f"  residuals   rms {self.rms:.4g}")
        source = "given" if self.sigma_given else f"estimated, {self.dof} degrees of freedom"
        noise = "unknown" if math.isnan(self.sigma) else f"{self.sigma:.4g} a coordinate of a reading"
        if math.isfinite(self.sigma_angle):
            noise += f", {angle_text(self.sigma_angle)[2:]} an attitude or angle"
        lines.append(f"  noise       {noise}{'' if math.isnan(self.sigma) else f' ({source})'}")
        if self.chi_square is not None:
            spread = math.sqrt(2 * max(self.dof, 0))
            lines.append(f"  chi-square  {self.chi_square:.5g}, expected {self.dof} ± {spread:.2g}")
        if len(self.outliers):
            rows = f"row {joined(map(str, self.outliers))} (counted from 0)"
            lines.append(f"  outliers    {places(self.outliers) if places else rows}")
        lines += [f"  not determined: {sentence}" for sentence in self.undetermined]
        lines += [f"  remark: {sentence}" for sentence in self.remarks]
        return "\n".join(lines)

    def _about_slides(self) -> str:
        if self.no_slide is None:
            return ""
        one = len(self.slides) == 1
        if self.no_slide >= ZERO_CHANCE:
            return ": zero within its uncertainty" if one else "zero within their uncertainties"
        if one:
            return ""
        if self.one_pitch is not None and self.one_pitch >= ZERO_CHANCE:
            radian, turn = (
                " ± ".join(measured(self.pitch * size, self.pitch_uncertainty * size))
                for size in (1, 2 * math.pi)
            )
            return f"in proportion to the angles: {radian} for each radian, {turn} a turn"
        return "not zero, and not in proportion to the angles"

    def __str__(self) -> str:
        return self.summary()

    @property
    def axis_uncertainty(self) -> Array:
        """Standard uncertainties (2,) of the direction in rad: the largest, and that at right angles to it."""
        return principal_sizes(self.covariance[:3, :3])[:2]

    @property
    def point_uncertainty(self) -> Array:
        """Standard uncertainties (3,) of the coordinates of `point`."""
        return np.sqrt(np.maximum(np.diag(self.covariance[3:, 3:]), 0))

    def to_dict(self) -> dict[str, Any]:
        """Return all results as plain Python values for :mod:`json`; numbers that are not finite are None."""
        found = {
            "status": self.status.name,
            **plain(self, "undetermined remarks motions"),
            "axis": self.axis,
            "axis_uncertainty_rad": self.axis_uncertainty,
            **plain(self, "point point_uncertainty origin"),
            "covariance_axis_point": self.covariance,
            "angles_rad": self.angles,
            "angle_uncertainty_rad": self.angle_uncertainty,
            **plain(self, "slides slide_uncertainty no_slide pitch pitch_uncertainty one_pitch"),
            "sigma": self.sigma,
            "sigma_angle_rad": self.sigma_angle,
            **plain(self, "sigma_given dof chi_square rms outliers"),
        }
        return {key: plain_value(value) for key, value in found.items()}


def table_lines(columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the lines of a table of a summary; the shortest column ends it."""
    rows = [tuple(columns), *zip(*columns.values(), strict=False)]
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
