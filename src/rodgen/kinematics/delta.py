"""Delta robots and printers: where the platform is, from carriages on towers or from arms, and what joints it needs.

Three pairs of rods shift the platform and do not turn it. The upper joints of the rods are on carriages of vertical
towers, or at the ends of arms that turn about horizontal axes.

>>> from rodgen import delta
>>> printer = delta.LinearGeometry(radius=140, rod=290)
>>> carriages, status = delta.linear_inverse([30, 20, 0.2], printer)
>>> delta.linear_direct(carriages, printer)[0].round(9)
array([30. , 20. ,  0.2])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.generated.numpy import delta as generated
from rodgen.generated.numpy.delta import DeltaStatus
from rodgen.generated.numpy.trig_equation import TrigStatus
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by
from rodgen.views import with_html

__all__ = [
    "DeltaStatus",
    "LinearGeometry",
    "RotaryGeometry",
    "linear_direct",
    "linear_inverse",
    "rods",
    "rotary_direct",
    "rotary_inverse",
]

Three: TypeAlias = float | tuple[float, float, float]

OF_PRINTERS = (210.0, 330.0, 90.0)
"""Where the towers of printers stand, degrees about z: A or X, B or Y, C or Z."""
OF_ROBOTS = (0.0, 120.0, 240.0)
"""Where the arms of robots stand."""


@with_html
@dataclass(frozen=True)
class LinearGeometry:
    """The dimensions of a linear delta: carriages on three vertical towers.

    Parameters
    ----------
    radius : float or tuple of float, length 3
        Distance of the joints of a carriage from the middle, less that of the rods' joints on the platform.
    rod : float or tuple of float, length 3
        Length of the rods from joint to joint.
    heading : tuple of float, length 3
        Where the towers stand, degrees about z.

    Raises
    ------
    RodgenError
        When a number is not finite, or a length is not positive.
    """

    radius: Three
    rod: Three
    heading: tuple[float, float, float] = OF_PRINTERS

    def __post_init__(self) -> None:
        _check(self, "radius", "rod")

    @property
    def numbers(self) -> tuple[Array, Array, Array]:
        """Radii, rods and headings in rad, each (3,): the order of the kernels."""
        return _three(self.radius), _three(self.rod), np.radians(self.heading)


@with_html
@dataclass(frozen=True)
class RotaryGeometry:
    """The dimensions of a rotary delta: three arms, whose axes are level in the plane z = 0.

    Parameters
    ----------
    radius : float or tuple of float, length 3
        Distance of the axis of an arm from the middle, less that of the rods' joints on the platform.
    arm, rod : float or tuple of float, length 3
        Length of the arms, and of the rods from joint to joint.
    heading : tuple of float, length 3
        Where the arms stand, degrees about z.

    Raises
    ------
    RodgenError
        When a number is not finite, or a length is not positive.
    """

    radius: Three
    arm: Three
    rod: Three
    heading: tuple[float, float, float] = OF_ROBOTS

    def __post_init__(self) -> None:
        _check(self, "arm", "rod")

    @property
    def numbers(self) -> tuple[Array, Array, Array, Array]:
        """Radii, arms, rods and headings in rad, each (3,): the order of the kernels."""
        return _three(self.radius), _three(self.arm), _three(self.rod), np.radians(self.heading)


@documented_by(generated.linear_delta_direct, ["position", "residual", "status"])
def linear_direct(carriage: ArrayLike, geometry: LinearGeometry) -> tuple[Any, Any, Any]:
    """Return where the platform of a linear delta is.

    Parameters
    ----------
    geometry : LinearGeometry

    Returns
    -------
    position
        NaN where the status is above SINGULAR.
    residual : array (...), length
        Largest error of the length of a rod in that position: rounding. It bounds the error of the position, divided
        by the least singular value of the rods' directions (:func:`rods`), to first order.

    Notes
    -----
    Three spheres.

    Examples
    --------
    >>> from rodgen import delta
    >>> printer = delta.LinearGeometry(radius=120, rod=200)
    >>> delta.linear_direct([160, 160, 160], printer)[0].round(9) + 0.0
    array([0., 0., 0.])
    """
    position, status = call_kernel(kernels.linear_delta_direct, (carriage, *geometry.numbers))
    return position, _residual(position, carriage, geometry), status


@documented_by(generated.rotary_delta_direct, ["position", "residual", "status"])
def rotary_direct(angle: ArrayLike, geometry: RotaryGeometry) -> tuple[Any, Any, Any]:
    """Return where the platform of a rotary delta is.

    Parameters
    ----------
    geometry : RotaryGeometry

    Returns
    -------
    position
        NaN where the status is above SINGULAR.
    residual : array (...), length
        As of :func:`linear_direct`.

    Examples
    --------
    >>> from rodgen import delta
    >>> robot = delta.RotaryGeometry(radius=100, arm=200, rod=500)
    >>> delta.rotary_direct([0, 0, 0], robot)[0].round(9) + 0.0
    array([   0.,    0., -400.])
    """
    position, status = call_kernel(kernels.rotary_delta_direct, (angle, *geometry.numbers))
    return position, _residual(position, angle, geometry), status


@documented_by(generated.linear_delta_inverse)
def linear_inverse(position: ArrayLike, geometry: LinearGeometry) -> tuple[Any, Any]:
    """Return where the carriages of a linear delta are.

    Parameters
    ----------
    geometry : LinearGeometry

    Returns
    -------
    carriage
        Above the platform; NaN where the status is above SINGULAR.
    status
        SINGULAR where a rod is level.

    Examples
    --------
    >>> from rodgen import delta
    >>> delta.linear_inverse([0, 0, 0], delta.LinearGeometry(radius=120, rod=200))[0]
    array([160., 160., 160.])
    """
    return call_kernel(kernels.linear_delta_inverse, (position, *geometry.numbers))  # type: ignore[no-any-return]


@documented_by(generated.rotary_delta_equations, ["angle", "status"])
def rotary_inverse(position: ArrayLike, geometry: RotaryGeometry) -> tuple[Any, Any]:
    """Return how the arms of a rotary delta stand, with their elbows outwards.

    Parameters
    ----------
    geometry : RotaryGeometry

    Returns
    -------
    angle : array (..., 3), rad
        From -π to π, positive downwards; NaN where the status is above SINGULAR.
    status : int8 array (...)
        Codes of :class:`DeltaStatus`; SINGULAR where an arm and its rod are in one line, seen along the arm's axis.

    Examples
    --------
    >>> from rodgen import delta
    >>> robot = delta.RotaryGeometry(radius=100, arm=200, rod=500)
    >>> delta.rotary_inverse([0, 0, -400], robot)[0].round(12) + 0.0
    array([0., 0., 0.])
    """
    with np.errstate(all="ignore"):
        equations = call_kernel(kernels.rotary_delta_equations, (position, *geometry.numbers))
        angles, kinds = kernels.trig_solve(*equations)
    worst = np.asarray(kinds).max(axis=-1)  # two, double, and then what has no answer
    of = {TrigStatus.TWO: DeltaStatus.SOLVED, TrigStatus.DOUBLE: DeltaStatus.SINGULAR}
    none = np.where(worst == TrigStatus.INVALID, DeltaStatus.INVALID, DeltaStatus.UNREACHABLE)
    status = np.select([worst == kind for kind in of], list(of.values()), none).astype(np.int8)
    return np.where(status[..., None] > DeltaStatus.SINGULAR, np.nan, np.asarray(angles)[..., 0]), status


def rods(position: ArrayLike, geometry: LinearGeometry | RotaryGeometry) -> Array:
    """Return the directions of the rods, unit vectors from joint to platform, (..., 3, 3): one row a rod.

    Their least singular value says how well they hold the platform: 0 in a singular position of the direct problem.
    """
    at = real_array("position", position, (3,))
    if isinstance(geometry, LinearGeometry):
        coordinates = linear_inverse(at, geometry)[0]
    else:
        coordinates = rotary_inverse(at, geometry)[0]
    vectors = np.asarray(at)[..., None, :] - _joints(coordinates, geometry)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _joints(coordinates: ArrayLike, geometry: LinearGeometry | RotaryGeometry) -> Array:
    """Return where the upper joints of the rods are, (..., 3, 3)."""
    at = np.asarray(coordinates, float)
    if isinstance(geometry, LinearGeometry):
        radius, _, heading = geometry.numbers
        reach, height = np.broadcast_arrays(radius, at)
    else:
        radius, arm, _, heading = geometry.numbers
        reach, height = radius + arm * np.cos(at), -arm * np.sin(at)
    return np.stack([reach * np.cos(heading), reach * np.sin(heading), height], axis=-1)


def _residual(position: Array, coordinates: ArrayLike, geometry: LinearGeometry | RotaryGeometry) -> Array:
    """Return the largest error of the length of a rod, (...)."""
    lengths = np.linalg.norm(position[..., None, :] - _joints(coordinates, geometry), axis=-1)
    return np.asarray(np.abs(lengths - _three(geometry.rod)).max(axis=-1))


def _three(value: Three) -> Array:
    return np.array(np.broadcast_to(np.asarray(value, float), 3))


def _check(geometry: Any, *lengths: str) -> None:
    for name, value in vars(geometry).items():
        numbers = np.asarray(value, float)
        wrong = not np.isfinite(numbers).all() or (name in lengths and not (numbers > 0).all())
        if numbers.shape not in {(), (3,)} or wrong:
            expected = "one positive number, or three" if name in lengths else "one finite number, or three"
            raise RodgenError(f"{name} = {value}; expected {expected}")
