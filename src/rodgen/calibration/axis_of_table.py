"""Fit one axis to a table of pairs of points, or of poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rodgen.calibration.problem.attitudes import UnfitAttitudeError, matrices
from rodgen.data.notations import NOTATIONS
from rodgen.data.tables import Pairs, Poses
from rodgen.errors import InputFileError, RodgenError, UnfitArgumentError, joined
from rodgen.kinematics.axis_fit import (
    AxisFit,
    InstantaneousAxes,
    fit_axis,
    fit_pose_axis,
    instantaneous_axes,
)


def fit_axis_of(
    table: Pairs | Poses,
    *,
    point: str | Sequence[float] | None = None,
    near: Sequence[float] | None = None,
    loss: str | None = None,
    sigma: float | None = None,
    sigma_angle: float | None = None,
    instantaneous: bool = False,
) -> AxisFit | InstantaneousAxes:
    """Fit one axis to all rows of a table, or one at each instant of a trajectory.

    Parameters
    ----------
    table : Pairs or Poses
        As `rodgen.data.tables.read_motions` returns it.
    point, loss
        As of `fit_axis`; only where angles are known without error.
    near : sequence of float, optional
        The point of the axis is that which is nearest to this one, in the unit of the table.
    sigma, sigma_angle : float, optional
        Standard uncertainties of a coordinate, in the unit of the table, and of an angle or attitude, rad.
    instantaneous : bool
        Whether poses have their time, and each instant its axis.

    Raises
    ------
    UnfitArgumentError
        When an argument does not go with this table.
    InputFileError
        When an attitude is not a rotation, or the time is missing.
    RodgenError
        When there is nothing to fit.
    """
    exact = isinstance(table, Pairs) and table.angle is not None and not sigma_angle
    for name, argument in (("point", point), ("loss", loss)):
        if argument is not None and not exact:
            expected = "it with pairs of points and a column angle"
            raise UnfitArgumentError(name, "a table without known angles", expected)
    if near is not None and point not in (None, "free"):
        raise UnfitArgumentError("near", "a known point", "it with a point that is fitted")
    if instantaneous and (isinstance(table, Pairs) or table.time is None):
        raise InputFileError(table.file, "columns", "no poses with their time", "poses and t [s]")
    noise: dict[str, Any] = {"sigma": sigma, "sigma_angle": sigma_angle, "origin": near}
    try:
        if isinstance(table, Pairs):
            noise |= {"point": "free" if point is None else point, "loss": loss or "linear"}
            return fit_axis(table.rho, table.rho_prime, table.angle, move=table.move, **noise)
        try:
            attitudes = matrices(table.notation, table.attitude)
        except UnfitAttitudeError as error:
            place = f"{table.places([error.row])}, columns {joined(NOTATIONS[table.notation])}"
            raise InputFileError(table.file, place, error.found, error.expected) from None
        if instantaneous and table.time is not None:
            return instantaneous_axes(table.time, table.position, attitudes, **noise)
        return fit_pose_axis(table.position, attitudes, **noise)
    except InputFileError:
        raise
    except RodgenError as error:
        raise RodgenError(f"{table.file}: {error}") from None
