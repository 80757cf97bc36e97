"""What is measured: a point, a direction, a distance, a height or a pose, and all that differs between them.

Everything else asks the measurand. Only files call it by its name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.data.notations import NOTATIONS as NOTATIONS
from rodgen.data.notations import TURNS as TURNS
from rodgen.data.set_aside import SetAside
from rodgen.data.units import ANGLE, LENGTH, Dimension
from rodgen.symbolic import rigid_motions as motions
from rodgen.views import with_html

Vector: TypeAlias = tuple[float, float, float]


class Steps(motions.Algebra, Protocol):
    """What a measurand needs of the steps of a kernel; see :class:`rodgen.machines.model_steps.ModelSteps`."""

    def turn(self, angle: Any) -> tuple[Any, Any]:
        """Return cosine and sine of an angle."""
        ...

    def factor(self) -> Any:
        """Return what the instrument multiplies its readings by."""

    def scaled(self, x: Any) -> Any:
        """Add to a reading what the errors of the instrument's axes do."""

    def changes_by_place(self, component: str, x: Any, value: Any) -> Any:
        """Add to a value what the effects on a component do at a place."""

    def freedoms(self, name: str, components: Sequence[str]) -> Any:
        """Return the freedoms of a part of the geometry."""

    def known(self, name: str, number: int = 0) -> Any:
        """Return a vector of the geometry."""

    def varied(self, name: str, number: int) -> Any:
        """Return a unit vector of the geometry, with its freedoms."""


@dataclass(frozen=True)
class Measurand:
    """What the readings of a machine are."""

    kind: ClassVar[str]
    """Its name in machine files."""
    words: ClassVar[str]
    """What its readings are called in a sentence."""
    columns: ClassVar[tuple[str, ...]]
    """The columns of a reading in a measurement file."""
    components: ClassVar[tuple[str, ...]]
    """Names of the components of a residual."""
    labels: ClassVar[tuple[str, ...]]
    """What these are called in a figure."""
    inputs: ClassVar[int]
    """Numbers of a reading in the rows of a kernel; of a direction those of the vectors across it, too."""
    dimension: ClassVar[Dimension] = LENGTH
    """Of noise and residuals."""
    moving: ClassVar[bool] = True
    """Whether a translation changes a reading; a direction is only turned."""
    is_direction: ClassVar[bool] = False
    """Whether a reading is a unit vector."""
    is_place: ClassVar[bool] = True
    """Whether a reading is where the target is seen; else a function of it."""
    freedoms: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    """Components in which a target may be off."""
    rigid: ClassVar[tuple[str, ...]] = ("x", "y", "z", *TURNS)
    """Components of the motion of a frame that a reading depends on."""
    has_origin: ClassVar[bool] = False
    """Whether it is measured from a point."""
    has_attitude: ClassVar[bool] = False
    """Whether the attitude of a body is read, too. Its residual is a rotation vector about the axes of the measuring
    frame, times a lever arm (`Observations.arm`): a length, as those of the place."""
    is_pose: ClassVar[bool] = False
    """Whether place and attitude are read together; attitudes alone have no lever arm."""
    has_axes: ClassVar[bool] = False
    """Whether a residual depends on how a body is turned, not on a vector in it alone."""
    place_numbers: ClassVar[int] = 3
    """Numbers that a kernel predicts: a point or a direction, the matrix of an attitude, or both."""
    has_zero: ClassVar[bool] = False
    """Whether it is an angle from a zero of the instrument, which is a freedom of a target."""
    line: ClassVar[str] = ""
    """What an angle is read about or against, as the keys of its two freedoms have it: an axis or the vertical."""
    unchanged_by: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Components of effects that do not change a reading, and why."""

    @property
    def read_columns(self) -> frozenset[str]:
        """Every column that may hold a reading: of an attitude those of all notations."""
        attitudes = NOTATIONS.values() if self.has_attitude else ()
        return frozenset(self.columns).union(*attitudes)

    def unit(self, length: str) -> str:
        """Return the unit of residuals, given the machine file's unit of length."""
        return length

    def arm(self, length: str) -> str:
        """Return the unit of lever arms, given the machine file's unit of length."""
        return length

    def size(self, reading: Array) -> float:
        """Return the largest number in readings (n, k), against which rounding is measured."""
        return float(max(reading.max(initial=0.0), -reading.min(initial=0.0)))

    def component_sigma(self, sigma: Array, basis: Sequence[Array] | None) -> Array:
        """Return the standard uncertainty of each component of the residuals.

        Parameters
        ----------
        sigma : ndarray, shape (n, k)
            Of each column of the readings.
        basis : sequence of ndarray, each (n, 3), or None
            The unit vectors across each direction, along which its residuals are.
        """
        return sigma

    def error(self, residuals: Array, arm: float = 1.0) -> Array:
        """Return residuals (n, components) as errors in internal units: lengths or angles; turns times an arm."""
        return residuals

    # as steps --------------------------------------------------------------------------------------------------

    def seen(self, steps: Steps, place: Any) -> Any:
        """Return where the instrument sees a place, (3, 1)."""
        return place

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return measured less predicted, (components, 1).

        Parameters
        ----------
        steps : Steps
            Of the kernel that it is written into.
        reading : Matrix, shape (inputs, 1)
        place : Matrix, shape (3, 1)
            As :meth:`seen`.
        axes : Matrix, shape (3, 3), optional
            The attitude: the axes of the body, as columns.
        """
        raise NotImplementedError


def _angles(residuals: Array) -> Array:
    """Return vectors as long as the angles whose vectors 2 tan(angle / 2) long are given, (n, k)."""
    size = np.linalg.norm(residuals, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(size > 0, residuals * (2 * np.arctan(size / 2) / size), residuals))


@dataclass(frozen=True)
class Point(Measurand):
    """The coordinates of a point."""

    kind = "point"
    words = "points x, y, z"
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    components = labels = columns
    inputs = 3

    def seen(self, steps: Steps, place: Any) -> Any:
        """Return the place as a multiple of the instrument's unit."""
        return steps.scaled(place * steps.factor())

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the difference of the coordinates."""
        return reading - place


@dataclass(frozen=True)
class _Angular(Measurand):
    """What only turns change: residuals are vectors 2 tan(angle / 2) long."""

    dimension = ANGLE
    moving = False
    rigid: ClassVar[tuple[str, ...]] = TURNS
    unchanged_by: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "translation": "no direction: it only moves",
            "point": "no direction: it only moves",
            "factor": "no direction: it has no length",
            "axes": "no direction: it has no length",
        }
    )

    def unit(self, length: str) -> str:
        """Return arcsec."""
        return "arcsec"

    def arm(self, length: str) -> str:
        """Return 1: arms are multiples of a unit vector's length."""
        return "1"

    def size(self, reading: Array) -> float:
        """Return 1."""
        return 1.0

    def error(self, residuals: Array, arm: float = 1.0) -> Array:
        """Return angles, or rotation vectors."""
        return _angles(residuals)


@dataclass(frozen=True)
class Direction(_Angular):
    """A unit vector."""

    kind = "direction"
    words = "directions"
    columns = ("ux", "uy", "uz")
    components = ("horizontal", "zenith")
    labels = ("horizontal", "to zenith")
    inputs = 9
    is_direction = True
    freedoms: ClassVar[tuple[str, ...]] = ("a", "b")

    def component_sigma(self, sigma: Array, basis: Sequence[Array] | None) -> Array:
        """Return what the ellipsoid of the uncertainties spans across the direction."""
        assert basis is not None
        return np.asarray(np.sqrt(np.stack([np.sum(e**2 * sigma**2, axis=-1) for e in basis], axis=-1)))

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the stereographic image of the prediction, seen from opposite the reading, along two vectors."""
        along = motions.stereographic(steps, reading[:3, :], place)
        return type(reading)([along(reading[3:6, :]), along(reading[6:, :])])


@dataclass(frozen=True)
class Distance(Measurand):
    """A distance from a point."""

    kind = "distance"
    words = "distances"
    columns = components = labels = ("d",)
    inputs = 1
    is_place = False
    has_origin = True
    unchanged_by = MappingProxyType({"axes": "no distance: it has no axes"})

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the difference of the distances."""
        arm = steps.let("arm", place - steps.known("origin"))
        distance = steps.let("distance", motions.length(steps, arm) * steps.factor())
        return type(reading)([reading[0] - distance])


@dataclass(frozen=True)
class Height(Measurand):
    """A distance from a plate, the plane z = 0 of the measuring frame: positive above it."""

    kind = "height"
    words = "heights over a plate"
    columns = components = labels = ("d",)
    inputs = 1
    is_place = False
    rigid: ClassVar[tuple[str, ...]] = ("z", "rx", "ry")
    unchanged_by = MappingProxyType({"axes": "no height: it has one axis"})

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the difference of the heights."""
        height = place[2] * steps.factor() - steps.changes_by_place("plate", place, 0)
        return type(reading)([reading[0] - steps.let("height", height)])


@dataclass(frozen=True)
class Pose(Point):
    """The coordinates of a point of a body, and the body's attitude."""

    kind = "pose"
    words = "poses: points x, y, z and attitudes"
    columns = components = labels = ("x", "y", "z", *TURNS)
    inputs = place_numbers = 12
    freedoms = ("x", "y", "z", *TURNS)
    has_attitude = has_axes = is_pose = True

    def error(self, residuals: Array, arm: float = 1.0) -> Array:
        """Return differences of coordinates, and rotation vectors; residuals of turns are 2 tan(angle / 2) long."""
        return np.concatenate([residuals[:, :3], arm * _angles(residuals[:, 3:] / arm)], axis=1)

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the differences of the coordinates, and the Rodrigues vector from the prediction to the reading."""
        return type(reading)([*(reading[:3, :] - place), *_turn_to(steps, axes, reading[3:, :])])


def _turn_to(steps: Steps, axes: Any, read: Any) -> Any:
    """Return the Rodrigues vector that turns predicted axes of a body to those that were read, (3, 1)."""
    return motions.rodrigues_between(steps, _columns(axes), _columns(type(read)(3, 3, list(read))))


def _columns(matrix: Any) -> list[Any]:
    return [matrix[:, i] for i in range(3)]


@dataclass(frozen=True)
class Orientation(_Angular):
    """The attitude of a body, wherever it is."""

    kind = "orientation"
    words = "attitudes"
    columns = components = labels = TURNS
    inputs = place_numbers = 9
    is_place = False
    freedoms = TURNS
    has_attitude = has_axes = True

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return the Rodrigues vector that turns the prediction to the reading."""
        return _turn_to(steps, axes, reading)


@dataclass(frozen=True)
class Angle(_Angular):
    """The angle by which a body has turned about an axis of the measuring frame, modulo whole turns.

    Of any rotation it is the twist: the turn about the axis that is left when the turn of the axis itself is taken off.
    """

    kind = "angle"
    words = "angles about an axis"
    columns = components = labels = ("angle",)
    inputs = 2
    place_numbers = 9
    is_place = False
    freedoms: ClassVar[tuple[str, ...]] = ("zero",)
    has_axes = has_zero = True
    line = "about"
    unchanged_by = MappingProxyType(
        {k: v.replace("direction", "angle") for k, v in _Angular.unchanged_by.items()}
    )

    def residual(self, steps: Steps, reading: Any, place: Any, axes: Any = None) -> Any:
        """Return 2 tan of half the angle from the prediction to the reading, given cosine and sine of half of this."""
        sine, cosine = self.half(steps, place, axes)
        c, s = reading[0], reading[1]
        zero = steps.known("target_zero")[0] + steps.freedoms("target", ("zero",))[0]
        of_zero = steps.turn(zero / 2)
        c, s = c * of_zero[0] + s * of_zero[1], s * of_zero[0] - c * of_zero[1]
        return type(reading)([motions.angle_between(cosine, sine, c, s)])

    def half(self, steps: Steps, place: Any, axes: Any) -> tuple[Any, Any]:
        """Return numbers as sine and cosine of half the predicted angle from the zero."""
        line = steps.varied(self.line, 0)
        return motions.half_twist(steps, line, _columns(steps.matrix.eye(3)), _columns(axes))


@dataclass(frozen=True)
class Inclination(Angle):
    """The angle by which a line in a body rises above the horizon, as an inclinometer with one axis reads it."""

    kind = "inclination"
    words = "inclinations"
    freedoms = ("a", "b", "zero")
    place_numbers = 3
    has_axes = False
    line = "vertical"
    unchanged_by = MappingProxyType(
        {k: v.replace("direction", "inclination") for k, v in _Angular.unchanged_by.items()}
    )

    def half(self, steps: Steps, place: Any, axes: Any) -> tuple[Any, Any]:
        """Return numbers as sine and cosine of half the predicted angle: tan(φ/2) = sin φ / (1 + cos φ)."""
        return motions.half_tilt(steps, steps.varied(self.line, 0), place)


POINT, DIRECTION, DISTANCE, HEIGHT = Point(), Direction(), Distance(), Height()
POSE, ORIENTATION, ANGLE_ABOUT, INCLINATION = Pose(), Orientation(), Angle(), Inclination()
MEASURANDS: Mapping[str, Measurand] = MappingProxyType(
    {m.kind: m for m in (POINT, DIRECTION, DISTANCE, HEIGHT, POSE, ORIENTATION, ANGLE_ABOUT, INCLINATION)}
)
"""All measurands, by their names in machine files."""
READING_COLUMNS = frozenset(column for m in (POINT, DIRECTION, DISTANCE) for column in m.columns)
"""Columns of measurements that are readings of any machine; where poses are read, those of `NOTATIONS` are, too."""


@with_html
@dataclass(frozen=True)
class Measured:
    """What a reading is, and in which frame.

    Attributes
    ----------
    kind : {"point", "direction", "distance", "height", "pose", "orientation", "angle", "inclination"}
    frame : {"machine", "free"}
        Readings are in machine axes, or in a frame that is found with the rest; of angles the axis about which they are
        read, or the vertical.
    origin : tuple of float, length 3, or None
        Where a distance is measured from, in the measuring frame.
    noise : float or None
        Standard uncertainty of a scalar reading; of poses that of a coordinate.
    attitude_noise : float or None
        Standard uncertainty of an attitude about each axis; stated where and only where `noise` of poses is.
    correlation : tuple of tuple of float, "columns", or None
        Of the errors of the components of a reading, (m, m), or by row in columns of the data; None where they are
        independent.
    about : tuple of float, length 3, or None
        Unit vector about which angles are read, in the measuring frame.
    instrument : {"workpiece", "tool"}
        Of a machine of two branches, that which carries the instrument; the targets are on the other one.
    set_aside : tuple of SetAside
        Rows of measurements that do not count; later entries overrule earlier ones. See `Machine.setting_aside`.
    """

    kind: str
    frame: str
    origin: Vector | None = None
    noise: float | None = None
    attitude_noise: float | None = None
    correlation: tuple[tuple[float, ...], ...] | Literal["columns"] | None = None
    about: Vector | None = None
    instrument: str = "workpiece"
    set_aside: tuple[SetAside, ...] = ()

    @property
    def measurand(self) -> Measurand:
        """What is measured, with all that depends on it."""
        return MEASURANDS[self.kind]
