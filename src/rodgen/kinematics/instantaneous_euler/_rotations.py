"""All rotations with given instantaneous Euler angles or ridge lines, and an arm with a Z-Y-X wrist.

Ridge lines are where the coordinate planes meet their images. The arm has six joints, as in section 5.2 of Zhou and
Zhu.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy import instantaneous_euler_arm as arm
from rodgen.generated.numpy import instantaneous_euler_inverse as inverse
from rodgen.generated.numpy import instantaneous_euler_ridges as ridges
from rodgen.generated.numpy.instantaneous_euler_inverse import RotationsStatus
from rodgen.kinematics.arrays import refuse_masked
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by
from rodgen.views import with_html


def ridge_normal(matrix: Any, axis: int) -> Any:
    """Return e_i × R e_i (..., 3): along the ridge line, as long as the sine of its angle."""
    return np.cross(np.eye(3)[axis], matrix[..., :, axis])


@documented_by(ridges.chi_ridge_lines, ["lines", "status"])
def ridge_lines(matrix: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Any, Any]:
    """Return the lines in which the yz, xz and xy planes meet their images.

    Parameters
    ----------
    point
        The fixed one when left out.

    Returns
    -------
    lines
        X_r, Y_r, Z_r as Plücker coordinates: a unit direction, and the moment about the fixed origin. The rotation by
        χ_i about the direction brings the plane to its image. NaN where there is no line.
    status : array (..., 3) of int8
        Codes of :class:`RidgeStatus`: where the angle is 0 or π, whether the planes coincide or are parallel.

    Notes
    -----
    Z_r = (e_z × z_3; (z_3 · p) e_z) / sin χ_z, and so on. The error of a direction is the
    machine epsilon over sin χ_i.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> tilted = [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]]  # about x
    >>> lines, status = ie.ridge_lines(tilted, [0.0, 0.0, 2.0])
    >>> lines[2]
    array([1. , 0. , 0. , 0. , 0. , 1.5])
    >>> [ie.RidgeStatus(int(code)).name for code in status]
    ['PLANES_COINCIDE', 'LINE', 'LINE']
    """
    lines, *statuses = call_kernel(kernels.chi_ridge_lines, (matrix, point))
    return lines, np.stack(statuses, axis=-1)


_COUNT = np.array([8, 4, 2, 1, 0, 0])
"""Rotations for each code of `RotationsStatus`."""


@with_html
class Rotations(NamedTuple):
    """Rotations with given instantaneous Euler angles.

    Attributes
    ----------
    quaternions : array (..., 8, 4)
        Unit quaternions, scalar part first and not negative; rows beyond `count` are NaN.
    count : array (...) of int
        8, 4, 2 or 1; 0 without a rotation.
    status : array (...) of int8
        Codes of :class:`RotationsStatus`.
    distance : array (...)
        Distance of the three cosines from those of the nearest triple that is possible; 0 where there are rotations.
    nearest : array (..., 3)
        That triple, rad; the given one where there are rotations.
    """

    quaternions: Any
    count: Any
    status: Any
    distance: Any
    nearest: Any


class ChoiceStatus(IntEnum):
    """Whether ridge lines choose one of the rotations with given angles.

    CHOSEN: one fits better than all others.
    AMBIGUOUS: several fit as well; the first of them is given.
    INFEASIBLE: no rotation has these angles.
    INVALID: not finite, an angle that is not between 0 and pi, or no ridge line at all.
    """

    CHOSEN = 0
    AMBIGUOUS = 1
    INFEASIBLE = 2
    INVALID = 3


@with_html
class Choice(NamedTuple):
    """The rotation that ridge lines choose.

    Attributes
    ----------
    quaternion : array (..., 4)
        Unit quaternion; NaN without a rotation.
    misfit : array (...)
        Largest angle between a given ridge line and the chosen rotation's, rad.
    left : array (...) of int
        Rotations that fit as well as the chosen one, it included.
    status : array (...) of int8
        Codes of :class:`ChoiceStatus`.
    """

    quaternion: Any
    misfit: Any
    left: Any
    status: Any


@documented_by(inverse.chi_rotations)
def rotations(chi: ArrayLike, *, tolerance: ArrayLike = 0.0) -> Rotations:
    """Return all rotations with three given instantaneous Euler angles.

    Parameters
    ----------
    tolerance
        16 times the machine epsilon is what angles that were computed are off by. For angles with the standard
        uncertainty u take about 3u divided by the largest of them.

    Returns
    -------
    Rotations
        ``quaternions``, ``count``, ``status``, ``distance``, ``nearest``.

    Notes
    -----
    The squares of the quaternion are the barycentric coordinates of the cosines in a tetrahedron. Inside it there are
    eight rotations, {D R D, D Rᵀ D} with the half turns D about the axes, on a face four, on an edge two, at a corner
    one, outside none. The size of a rotation is the sum of the three squares of its quaternion that are not the
    largest, doubled. The angles hold the squares, so that a component is known to the square root of the rounding only:
    what is below √tolerance of the size is given as 0, and two rotations that differ in its sign as one. Near a half
    turn about a coordinate axis that is more, because angles near π are rounded as π is. Squares of angles below 1e-150
    lose digits, and then the status may be wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> found = ie.rotations(np.radians([[48.439, 36.595, 60.501], [90.0, 0.0, 0.0], [0.0, 180.0, 180.0]]))
    >>> found.count.tolist(), [ie.RotationsStatus(int(code)).name for code in found.status]
    ([8, 0, 1], ['EIGHT', 'INFEASIBLE', 'ONE'])
    >>> found.quaternions[2, 0]
    array([0., 1., 0., 0.])
    >>> found.distance.round(6), np.degrees(found.nearest[1]).round(2)
    (array([0.     , 0.57735, 0.     ]), array([70.53, 48.19, 48.19]))
    """
    quaternions, distance, nearest, status = call_kernel(kernels.chi_rotations, (chi, tolerance))
    return Rotations(quaternions, _COUNT[np.asarray(status)], status, distance, nearest)


def choose(
    chi: ArrayLike,
    *,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    z: ArrayLike | None = None,
    oriented: bool = True,
    tolerance: ArrayLike = 0.0,
    angle_tolerance: float = 1e-6,
) -> Choice:
    """Return the rotation with given instantaneous Euler angles that the directions of its ridge lines select.

    Parameters
    ----------
    chi : array_like (..., 3)
        χ_x, χ_y, χ_z in rad, 0 to π.
    x, y, z : array_like (..., 3), optional
        Directions, of any length, of the ridge lines X_r, Y_r, Z_r; at least one of them. NaN where one is not known.
    oriented : bool, optional
        Whether the directions have a sense, that about which the rotation by χ_i is right-handed. Without it one
        ridge line leaves two rotations of eight, two lines leave one.
    tolerance : array_like (...), optional
        As for :func:`rotations`.
    angle_tolerance : float, optional
        Up to which misfits, in rad, are the same.

    Returns
    -------
    Choice
        ``quaternion``, ``misfit``, ``left``, ``status``.

    Raises
    ------
    RodgenError
        When no ridge line is given.

    Notes
    -----
    Derivation ``instantaneous_euler_inverse``, entries ``opposite-directions`` and ``four-directions``. A ridge line
    that a rotation has not, because its angle is 0 or π, does not count.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> chi, _ = ie.angles_from_euler([0.3, 0.2, 0.5])
    >>> matrix, _ = ie.motion_from_euler([0.3, 0.2, 0.5], [0.0, 0.0, 0.0])
    >>> lines, _ = ie.ridge_lines(matrix)
    >>> choice = ie.choose(chi, z=lines[2, :3])
    >>> int(choice.left), np.abs(ie.euler_from_quaternion(choice.quaternion)[0] - [0.3, 0.2, 0.5]).max() < 1e-12
    (1, np.True_)
    >>> int(ie.choose(chi, z=lines[2, :3], oriented=False).left)
    2
    """
    for name, part in (("x", x), ("y", y), ("z", z)):
        refuse_masked(name, part)
    parts = {i: np.asarray(part, float) for i, part in enumerate((x, y, z)) if part is not None}
    if not parts:
        raise RodgenError("choose: no ridge line is given; expected x, y or z")
    feasible = rotations(chi, tolerance=tolerance)
    quaternions = np.asarray(feasible.quaternions)
    worst: NDArray[Any] = np.zeros(quaternions.shape[:-1])
    seen: NDArray[np.bool_] = np.zeros(quaternions.shape[:-2], bool)
    matrices = kernels.matrix_from_quaternion(quaternions)[0]
    for i, part in parts.items():
        if part.ndim == 0 or part.shape[-1] != 3:
            raise ValueError(
                f"a ridge line's direction has the shape {part.shape}; expected a last axis of 3"
            )
        ridge = ridge_normal(matrices, i)
        direction = part[..., None, :]
        sine = np.linalg.norm(np.cross(ridge, direction), axis=-1)
        cosine = (ridge * direction).sum(axis=-1)
        angle = np.arctan2(sine, cosine if oriented else np.abs(cosine))
        length = np.linalg.norm(ridge, axis=-1)
        usable = np.isfinite(direction).all(axis=-1) & (np.abs(direction).max(axis=-1) > 0)
        worst, angle, usable = np.broadcast_arrays(worst, angle, usable)
        seen = seen | usable[..., 0]
        flat = length <= 4 * np.finfo(float).eps
        worst = np.where(usable & ~flat, np.fmax(worst, angle), worst)
    there = ~np.isnan(quaternions[..., 0])
    misfit = np.where(there, worst, np.inf)
    misfit = np.where(seen[..., None], misfit, np.inf)
    best = misfit.argmin(axis=-1)
    least = np.take_along_axis(misfit, best[..., None], axis=-1)
    left = (misfit <= least + angle_tolerance).sum(axis=-1)
    solvable = np.isfinite(least[..., 0])
    left = np.where(solvable, left, 0)
    quaternions = np.broadcast_to(quaternions, (*misfit.shape, 4))
    chosen = np.take_along_axis(quaternions, best[..., None, None], axis=-2)[..., 0, :]
    code = np.where(left > 1, ChoiceStatus.AMBIGUOUS, ChoiceStatus.CHOSEN)
    code = np.where(solvable, code, ChoiceStatus.INVALID)
    code = np.where(feasible.status == RotationsStatus.INFEASIBLE, ChoiceStatus.INFEASIBLE, code)
    return Choice(
        np.where(solvable[..., None], chosen, np.nan),
        np.where(solvable, least[..., 0], np.nan),
        left,
        code.astype(np.int8),
    )


@documented_by(arm.chi_arm_pose)
def arm_pose(joints: ArrayLike, lengths: ArrayLike) -> tuple[Any, Any, Any]:
    """Return the pose of an arm with six joints whose wrist turns about z, y and x.

    At zero the upper arm stands upright and the forearm points along x. Joint 1 turns about z, joints 2 and 3 about
    y, in the shoulder and the elbow, joints 4, 5 and 6 about the z, y and x axes of the wrist, through one point.

    Notes
    -----
    The paper gives neither lengths nor joint parameters of its arm, so there are no default ones. In the axes of the
    forearm the instantaneous Euler angles are those of the last three joints as Z-Y-X angles, whatever the lengths.

    Examples
    --------
    >>> from rodgen import instantaneous_euler as ie
    >>> matrix, point, wrist = ie.arm_pose([0.0] * 6, [0.4, 0.5, 0.45, 0.15])
    >>> point, wrist
    (array([0.6, 0. , 0.9]), array([0.45, 0.  , 0.9 ]))
    """
    return call_kernel(kernels.chi_arm_pose, (joints, lengths))  # type: ignore[no-any-return]
