"""The orientations that a 3-SPS-S machine can take up: legs within limits, on one side of the singularity.

The legs have a least and a greatest length, and the machine must not pass where they do not hold the platform:
there it may go on into another mode. Orientations are written as azimuth, tilt and torsion; on a grid of them the ones
allowed are found, and of these the ones that are joined to one another without a crossing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.errors import RodgenError
from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.arrays import length_limits
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.three_sps_s._legs import SINGULAR, Geometry, nearest_proper, rotation_from_tilt_torsion
from rodgen.views import with_html


class OrientationStatus(IntEnum):
    """Whether a machine may take up an orientation.

    ALLOWED: the legs are within their limits, and hold the platform.
    TOO_SHORT: a leg would be shorter than allowed.
    TOO_LONG: a leg would be longer than allowed, and none too short.
    NEAR_SINGULAR: the normed determinant is not larger than the margin.
    OTHER_SIDE: the determinant has the sign of the other side.
    NOT_NORMAL: allowed, but the matrix is a rotation only roughly; the nearest one was used.
    INVALID: a number is NaN or infinite, or the matrix is off a rotation by more than 1e-3, or a reflection.
    """

    ALLOWED = 0
    TOO_SHORT = 1
    TOO_LONG = 2
    NEAR_SINGULAR = 3
    OTHER_SIDE = 4
    NOT_NORMAL = 5
    INVALID = 6


@with_html
@dataclass(frozen=True)
class Workspace:
    """The orientations that a machine can take up, of :func:`workspace`.

    Attributes
    ----------
    azimuth, tilt, torsion : array (a,), (t,), (s,)
        Middles of the grid's cells, rad.
    status : array (s, a, t) of int8
        Codes of :class:`OrientationStatus`.
    determinant : array (s, a, t)
        Normed determinant.
    joined : array (s, a, t) of bool
        Cells that are joined to the cell `best` through cells that are allowed.
    best : tuple of three floats
        Azimuth, tilt and torsion of the allowed cell with the largest determinant; NaN where none is allowed.
    share, joined_share : float
        Parts of all rotations (of all tilts, where there is one torsion) that are allowed, and joined to the best.
    """

    azimuth: Any
    tilt: Any
    torsion: Any
    status: Any
    determinant: Any
    joined: Any
    best: tuple[float, float, float]
    share: float
    joined_share: float


def orientation_status(
    rotation: ArrayLike,
    geometry: Geometry,
    limits: Sequence[float] | None = None,
    *,
    side: int = 0,
    margin: float = SINGULAR,
) -> tuple[Any, Any]:
    """Return whether a machine may take up orientations.

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        Orientations of the platform.
    geometry : Geometry
        The machine.
    limits : pair of floats, optional
        Least and greatest length of a leg; none when left out.
    side : {0, 1, -1}, optional
        Sign that the determinant must have; 0 is either.
    margin : float, optional
        Normed determinant up to which an orientation counts as near a singularity.

    Returns
    -------
    status : array (...) of int8
        Codes of :class:`OrientationStatus`.
    determinant : array (...)
        The normed determinant of :func:`rodgen.three_sps_s.singularity`.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> machine = three_sps_s.Geometry(2, 1, 1.5)
    >>> status, determinant = three_sps_s.orientation_status(np.eye(3), machine, (1.0, 3.0))
    >>> three_sps_s.OrientationStatus(int(status)).name  # the home pose
    'NEAR_SINGULAR'
    """
    low, high = length_limits(limits, "leg")
    _check(side, margin)
    matrix, kind = nearest_proper(rotation)
    lengths = np.asarray(kernels.sps_legs(matrix, *geometry.lengths))
    determinant = np.asarray(kernels.sps_singularity(matrix, geometry.R, geometry.h))
    with np.errstate(invalid="ignore"):
        status = np.select(
            [
                kind == RotationStatus.INVALID,
                (lengths < low).any(axis=-1),
                (lengths > high).any(axis=-1),
                np.abs(determinant) <= margin,
                determinant * side < 0,
                kind == RotationStatus.NOT_NORMAL,
            ],
            [
                OrientationStatus.INVALID,
                OrientationStatus.TOO_SHORT,
                OrientationStatus.TOO_LONG,
                OrientationStatus.NEAR_SINGULAR,
                OrientationStatus.OTHER_SIDE,
                OrientationStatus.NOT_NORMAL,
            ],
            OrientationStatus.ALLOWED,
        ).astype(np.int8)
    return status[()], determinant[()]


def workspace(
    geometry: Geometry,
    limits: Sequence[float] | None = None,
    *,
    torsion: float | None = None,
    side: int = 1,
    margin: float = SINGULAR,
    samples: int = 45,
) -> Workspace:
    """Return the orientations that a machine can take up without passing a singularity.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    limits : pair of floats, optional
        Least and greatest length of a leg; none when left out.
    torsion : float, optional
        The only torsion, rad; all when left out.
    side : {1, -1, 0}, optional
        Sign of the determinant. The pure torsions between 0 and π are on the side 1, those between -π and 0 on -1; the
        home pose is on neither. With 0, cells of both signs are allowed, but joined only to those of their own.
    margin : float, optional
        Normed determinant up to which an orientation is too near a singularity.
    samples : int, optional
        Cells of the tilt, from 0 to π; of azimuth and torsion there are twice as many.

    Returns
    -------
    Workspace

    Raises
    ------
    RodgenError
        When the limits are not the least length and the greatest, or a number is out of its range.

    Notes
    -----
    Two orientations of different sign are not joined, as the determinant is continuous; that two of one sign are is
    known to the grid's cells. A neck narrower than a cell is not seen.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> found = three_sps_s.workspace(three_sps_s.Geometry(2, 1, 1.5), (1.2, 2.8), samples=20)
    >>> round(found.share, 2), round(found.joined_share, 2)
    (0.08, 0.08)
    """
    _check(side, margin)
    if not 4 <= samples <= 400:
        raise RodgenError(f"samples is {samples}; expected 4 to 400 cells")
    tilt = (np.arange(samples) + 0.5) * np.pi / samples
    turns = (np.arange(2 * samples) + 0.5) * np.pi / samples - np.pi
    if torsion is not None and not np.isfinite(torsion):
        raise RodgenError(f"torsion is {torsion}; expected an angle")
    torsions = turns if torsion is None else np.array([float(torsion)])
    shape = (len(torsions), len(turns), samples)
    status, determinant = np.empty(shape, np.int8), np.empty(shape)
    for n, sigma in enumerate(torsions):
        rotation = rotation_from_tilt_torsion(turns[:, None], tilt, sigma)
        status[n], determinant[n] = orientation_status(rotation, geometry, limits, side=side, margin=margin)
    # a grid's matrices are rotations to the rounding of a product, which NOT_NORMAL may or may not forgive
    status[status == OrientationStatus.NOT_NORMAL] = OrientationStatus.ALLOWED
    allowed = status == OrientationStatus.ALLOWED
    joined, best = np.zeros(shape, bool), (np.nan, np.nan, np.nan)
    if allowed.any():
        at = np.unravel_index(np.argmax(np.where(allowed, np.abs(determinant), -1.0)), shape)
        joined[at] = True
        _spread(joined, allowed & (determinant * determinant[at] > 0), torsion is None)
        best = float(turns[at[1]]), float(tilt[at[2]]), float(torsions[at[0]])
    # of all rotations dF sin(T) dT dσ
    weight = np.broadcast_to(np.sin(tilt) / (np.sin(tilt).sum() * len(turns) * len(torsions)), shape)
    return Workspace(
        turns, tilt, torsions, status, determinant, joined, best,
        float(weight[allowed].sum()), float(weight[joined].sum()),
    )  # fmt: skip


def _spread(joined: Any, allowed: Any, round_torsion: bool) -> None:
    """Mark cells joined to marked ones: azimuth and torsion go round, and at the pole all azimuths meet."""
    count = 0
    while count != (count := int(joined.sum())):
        for _ in range(8):
            for step in (1, -1):
                joined |= np.roll(joined, step, axis=1) & allowed
                if round_torsion:
                    joined |= np.roll(joined, step, axis=0) & allowed
            joined[..., 1:] |= joined[..., :-1] & allowed[..., 1:]
            joined[..., :-1] |= joined[..., 1:] & allowed[..., :-1]
            joined[..., 0] |= joined[..., 0].any(axis=1, keepdims=True) & allowed[..., 0]


def _check(side: int, margin: float) -> None:
    if side not in (-1, 0, 1):
        raise RodgenError(f"side is {side!r}; expected 1, -1, or 0 for either")
    if not 0 <= margin < 1:
        raise RodgenError(f"margin is {margin!r}; expected a number from 0 to below 1")
