"""The dimensions of a 3-SPS-S machine, its legs in an orientation, their rates, and singular poses.

The joints on the base stand at -30°, 90° and 210° on a circle of the radius R in the plane z = 0; those on the platform
in the same directions on one of the radius r, in the plane of the pivot (0, 0, h), when the platform is not turned.

The platform is turned by a rotation about the pivot. Where the legs do not hold it, the Jacobian loses rank: its
determinant, normed to lie between -1 and 1, is zero. The home pose is such a place, and so is every pure tilt straight
towards a joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy import three_sps_s as generated
from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.arrays import broadcast_shapes, finite_number, positive_length, real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.numerics import gains_and_condition, principal
from rodgen.kinematics.ports import documented_by
from rodgen.views import with_html


@with_html
@dataclass(frozen=True)
class Geometry:
    """The fixed dimensions of a 3-SPS-S machine, in one unit of length.

    Parameters
    ----------
    R, r : float
        Radii of the joints on the base and on the platform.
    h : float
        Height of the pivot over the base.

    Raises
    ------
    RodgenError
        When a radius is not positive, or a number not finite.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> three_sps_s.Geometry(2, 1, 1.5).home_leg.__round__(6)
    1.802776
    """

    R: float
    r: float
    h: float

    def __post_init__(self) -> None:
        for name, check in (("R", positive_length), ("r", positive_length), ("h", finite_number)):
            object.__setattr__(self, name, check(name, getattr(self, name)))

    @property
    def lengths(self) -> tuple[float, float, float]:
        """R, r and h, in the kernels' order."""
        return self.R, self.r, self.h

    @property
    def home_leg(self) -> float:
        """Length of each leg when the platform is not turned."""
        return math.hypot(self.R - self.r, self.h)


SINGULAR = 1e-6
"""Normed determinant up to which a pose counts as singular. The angle that errors of the legs open grows by about its
inverse, and two assembly modes are about as far apart, in rad: below 1e-6 rounding of the legs is more than 1e-10."""


NO_ROTATION = 1e-3
"""Largest entry of RᵀR - 1 beyond which a matrix is taken for an error, not for a rotation with few digits."""


def proper(rotation: ArrayLike, what: str = "the rotation") -> tuple[Any, Any]:
    """Return matrices, with NaN for those that are far from a rotation, and codes of `RotationStatus`."""
    matrix = real_array(what, rotation, (3, 3))
    kind = np.array(kernels.quaternion_from_matrix(matrix)[1])
    rough = kind == RotationStatus.NOT_NORMAL
    if rough.any():
        gram = np.swapaxes(matrix[rough], -1, -2) @ matrix[rough]
        far = np.abs(gram - np.eye(3)).max(axis=(-2, -1)) > NO_ROTATION
        kind[rough] = np.where(far, RotationStatus.INVALID, RotationStatus.NOT_NORMAL)
    if (kind == RotationStatus.INVALID).any():
        matrix = np.where((kind == RotationStatus.INVALID)[..., None, None], np.nan, matrix)
    return matrix, kind


def nearest_proper(rotation: ArrayLike, what: str = "the rotation") -> tuple[Any, Any]:
    """Return what `proper` does, with the nearest rotation in place of a matrix that is one only roughly."""
    matrix, kind = proper(rotation, what)
    rough = (kind == RotationStatus.NOT_NORMAL)[..., None, None]
    if rough.any():
        nearest = kernels.matrix_from_quaternion(kernels.quaternion_from_matrix(matrix)[0])[0]
        matrix = np.where(rough, nearest, matrix)
    return matrix, kind


@with_html
class Singularity(NamedTuple):
    """Measures of how well three legs hold the platform, of :func:`singularity`."""

    determinant: Any
    gains: Any
    condition: Any


@documented_by(generated.sps_legs)
def legs(rotation: ArrayLike, geometry: Geometry) -> Any:
    """Return the lengths of the three legs.

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        Orientation of the platform: a rotation matrix, from platform to machine axes.
    geometry : Geometry
        The machine.

    Returns
    -------
    legs
        At -30°, 90° and 210°; NaN where the matrix is not a rotation to 1e-3.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> three_sps_s.legs(np.eye(3), three_sps_s.Geometry(2, 1, 1.5)).round(6)
    array([1.802776, 1.802776, 1.802776])
    """
    return kernels.sps_legs(proper(rotation)[0], *geometry.lengths)


@documented_by(generated.sps_legs_from_quaternion)
def legs_from_quaternion(quaternion: ArrayLike, geometry: Geometry) -> Any:
    """Return the lengths of the three legs, from a quaternion.

    Parameters
    ----------
    quaternion
        That length is not zero.
    geometry : Geometry
        The machine.

    Returns
    -------
    legs
        As of :func:`legs`.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> three_sps_s.legs_from_quaternion([-0.8, 0.6, 0, 0], three_sps_s.Geometry(4, 1, 1.5)).round(6)
    array([3.758989, 3.758989, 3.758989])
    """
    return call_kernel(kernels.sps_legs_from_quaternion, (quaternion, *geometry.lengths))


@documented_by(generated.sps_jacobian)
def jacobian(rotation: ArrayLike, geometry: Geometry) -> Any:
    """Return the derivatives of the legs with respect to a turn of the platform.

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        Orientation of the platform.
    geometry : Geometry
        The machine.

    Returns
    -------
    jacobian
        A row for each leg: ``jacobian @ omega`` are the rates of the legs. Not finite where a leg has no length, or the
        matrix is not a rotation.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> three_sps_s.jacobian(np.eye(3), three_sps_s.Geometry(2, 1, 1.5)).round(4)[:, 2] + 0.0  # yaw at the start
    array([0., 0., 0.])
    """
    return kernels.sps_jacobian(proper(rotation)[0], *geometry.lengths)


def singularity(rotation: ArrayLike, geometry: Geometry) -> Singularity:
    """Return how well the legs hold the platform.

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        Orientation of the platform.
    geometry : Geometry
        The machine.

    Returns
    -------
    Singularity
        determinant (...): of the moments of the legs' spans about the pivot, normed to lie between -1 and 1. Zero where
        the legs do not hold the platform; its sign says on which side, and two modes that meet have different signs.
        gains (..., 3): singular values of the Jacobian, length per rad, the greatest first. condition (...): ratio of
        the greatest to the least, infinite where the latter is zero. NaN where an input is, or a leg has no length.

    Notes
    -----
    The closed form of the determinant is proved in the derivation ``three_sps_s``.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> found = three_sps_s.singularity(np.eye(3), three_sps_s.Geometry(2, 1, 1.5))  # the home pose
    >>> bool(abs(found.determinant) < 1e-15), bool(found.condition > 1e15)
    (True, True)
    """
    matrix, _ = proper(rotation)
    determinant = kernels.sps_singularity(matrix, geometry.R, geometry.h)
    return Singularity(determinant, *gains_and_condition(kernels.sps_jacobian(matrix, *geometry.lengths)))


def rotation_from_tilt_torsion(azimuth: ArrayLike, tilt: ArrayLike, torsion: ArrayLike) -> Any:
    """Return the rotation that tilts the platform's axis towards an azimuth, with a torsion.

    Parameters
    ----------
    azimuth, tilt, torsion : array_like (...)
        Angles F, T and σ in rad: the Z-Y-Z angles F, T, σ - F. Without torsion the axis of the turn is in the base.

    Returns
    -------
    array (..., 3, 3)
        Rotation matrix.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> three_sps_s.rotation_from_tilt_torsion(0.0, np.pi / 2, 0.0)[:, 2].round(6)  # where the platform's axis is
    array([1., 0., 0.])
    """
    angles = {"azimuth": azimuth, "tilt": tilt, "torsion": torsion}
    read = {name: (real_array(name, values), 0) for name, values in angles.items()}
    shape = broadcast_shapes(read)
    F, T, sigma = (np.broadcast_to(values, shape) for values, _ in read.values())
    scalar, along = np.cos(T / 2) * np.cos(sigma / 2), np.cos(T / 2) * np.sin(sigma / 2)
    phase = F - sigma / 2
    quaternion = np.stack([scalar, -np.sin(T / 2) * np.sin(phase), np.sin(T / 2) * np.cos(phase), along], -1)
    return kernels.matrix_from_quaternion(quaternion)[0]


def tilt_torsion(rotation: ArrayLike) -> Any:
    """Return azimuth, tilt and torsion of a rotation.

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        Rotation matrix.

    Returns
    -------
    array (..., 3)
        Azimuth (-π to π), tilt (0 to π) and torsion (-π to π) in rad. Of a pure torsion the azimuth is 0; of a tilt by
        π the torsion is 0. NaN where an entry is.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> turned = three_sps_s.rotation_from_tilt_torsion(0.5, 0.3, -0.2)
    >>> three_sps_s.tilt_torsion(turned).round(6)
    array([ 0.5,  0.3, -0.2])
    """
    quaternion = kernels.quaternion_from_matrix(proper(rotation)[0])[0]
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    along, across = np.hypot(w, z), np.hypot(x, y)
    rounding = 4 * np.finfo(float).eps
    half = np.where(along <= rounding, 0.0, np.arctan2(z, w))
    phase = np.where(across <= rounding, -half, np.arctan2(-x, y))
    return np.stack([principal(phase + half), 2 * np.arctan2(across, along), principal(2 * half)], axis=-1)
