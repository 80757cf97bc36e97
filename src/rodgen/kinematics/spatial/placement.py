"""A mechanism with the base frame, end frame and zeros that other conventions have, and its reverse analysis.

Crane and Duffy's chain begins on the first joint's axis and ends on the last one's, and its variables have the
zeros that the common perpendiculars give them. A robot as others write it has a base frame and an end frame of its own,
and joints with zeros of its own. A placement holds the mechanism and these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.numerics import principal
from rodgen.kinematics.spatial.arm_reverse import solve_arm
from rodgen.kinematics.spatial.forward_analysis import checked, forward, jacobian
from rodgen.kinematics.spatial.loop_reverse import reach
from rodgen.kinematics.spatial.mechanism import Mechanism
from rodgen.kinematics.spatial.status import Reverse
from rodgen.kinematics.spatial.transforms import one_frame
from rodgen.views import with_html


@with_html
@dataclass(frozen=True, eq=False)
class Placement:
    """An open chain with frames at its base and end, and the variables where its joints are at zero.

    Parameters
    ----------
    mechanism : Mechanism
        An open chain of joints R, P, C and H.
    base : array_like (4, 4), optional
        Pose of the chain's fixed frame F in the robot's base frame; left out: they are one.
    end : array_like (4, 4), optional
        Pose of the robot's end frame in the last joint's frame; left out: they are one.
    zero : array_like (v), optional
        Variables of the mechanism where the robot's coordinates are zero; left out: zero.

    Raises
    ------
    RodgenError
        When the chain is closed or has joints E, T or S, or an array does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> arm = spatial.Placement(spatial.PUMA_560, zero=[0, 0, 0, 0, np.pi, 0])
    >>> bool(np.allclose(arm.forward(np.zeros(6)), spatial.forward(spatial.PUMA_560, [0, 0, 0, 0, np.pi, 0])))
    True
    """

    mechanism: Mechanism
    base: NDArray[np.float64]
    end: NDArray[np.float64]
    zero: NDArray[np.float64]

    def __init__(
        self,
        mechanism: Mechanism,
        base: ArrayLike | None = None,
        end: ArrayLike | None = None,
        zero: ArrayLike | None = None,
    ) -> None:
        if mechanism.closed:
            raise RodgenError("the mechanism is a closed loop; expected an open chain")
        count = len(mechanism.variables)
        numbers = np.zeros(count) if zero is None else real_array("zero", zero).copy()
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            raise RodgenError(f"zero has the shape {numbers.shape}; expected {count} numbers, one a variable")
        fixed: dict[str, Any] = {"mechanism": mechanism, "zero": numbers}
        fixed |= {"base": one_frame("base", base), "end": one_frame("end", end)}
        for name, value in fixed.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def forward(self, coordinates: ArrayLike) -> Any:
        """Return the pose of the end frame in the base frame.

        Parameters
        ----------
        coordinates : array_like (..., v)
            The robot's coordinates, angles in rad: variables of the mechanism less `zero`.

        Returns
        -------
        array (..., 4, 4)

        Raises
        ------
        RodgenError
            When the number of coordinates is another one.
        """
        q = checked(self.mechanism, coordinates)
        return self.base @ forward(self.mechanism, q + self.zero) @ self.end

    def jacobian(self, coordinates: ArrayLike) -> Any:
        """Return how the end frame moves with each coordinate.

        Parameters
        ----------
        coordinates : array_like (..., v)
            The robot's coordinates, angles in rad.

        Returns
        -------
        array (..., 6, v)
            Angular velocity (rows 0 to 2) and velocity of the origin of the end frame (rows 3 to 5), in the base frame,
            per unit of each coordinate.

        Raises
        ------
        RodgenError
            As for :func:`jacobian`.

        Examples
        --------
        >>> from rodgen import spatial
        >>> tool = spatial.transform(None, [0, 0, 100.0])
        >>> arm = spatial.Placement(spatial.Mechanism("RR", [0.0], [1.5707963267948966]), end=tool)
        >>> arm.jacobian([0.0, 0.0])[3:].round(9) + 0.0  # the first joint swings the tool along x
        array([[100.,   0.],
               [  0.,   0.],
               [  0.,   0.]])
        """
        q = checked(self.mechanism, coordinates) + self.zero
        rates = jacobian(self.mechanism, q)
        turning = rates[..., :3, :]
        lever = forward(self.mechanism, q)[..., :3, :3] @ self.end[:3, 3]
        moving = rates[..., 3:, :] + np.cross(turning, lever[..., None], axis=-2)
        return np.concatenate([self.base[:3, :3] @ turning, self.base[:3, :3] @ moving], axis=-2)

    def reverse(self, pose: ArrayLike) -> Reverse:
        """Return all coordinates that bring the end frame to a pose in the base frame.

        Parameters
        ----------
        pose : array_like (..., 4, 4)

        Returns
        -------
        Reverse
            As of :func:`reverse`, in the robot's coordinates; angles in (-pi, pi].

        Raises
        ------
        RodgenError
            As for :func:`reverse`.

        Examples
        --------
        >>> import numpy as np
        >>> from rodgen import spatial
        >>> arm = spatial.Placement(spatial.PUMA_560, zero=[0, 0, 0, 0, np.pi, 0])
        >>> q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        >>> bool(np.abs(arm.reverse(arm.forward(q)).solutions - q).max(axis=1).min() < 1e-12)
        True
        """
        T = real_array("the pose", pose, (4, 4))
        solutions = reverse(self.mechanism, np.linalg.inv(self.base) @ T @ np.linalg.inv(self.end))
        moved = solutions.solutions - self.zero
        is_angle = np.array([which == "theta" for _, which in self.mechanism.variables])
        return Reverse(np.where(is_angle & (self.zero != 0), principal(moved), moved), solutions.status)

    def in_unit(self, unit: str) -> Placement:
        """Return the same robot with its lengths in another unit.

        Parameters
        ----------
        unit : str
            A unit of length that Pint knows.

        Returns
        -------
        Placement

        Raises
        ------
        RodgenError
            When it is not a unit of length.
        """
        if unit == self.mechanism.unit:
            return self
        mechanism, factor = self.mechanism.in_unit(unit), self.mechanism.length_in(unit)
        lengths = np.array([factor if which == "S" else 1.0 for _, which in mechanism.variables])
        base, end = np.array(self.base), np.array(self.end)
        base[:3, 3] *= factor
        end[:3, 3] *= factor
        return Placement(mechanism, base, end, self.zero * lengths)


def placed(robot: Mechanism | Placement) -> Placement:
    """Return a mechanism as a placement with nothing added."""
    return robot if isinstance(robot, Placement) else Placement(robot)


def mechanism_at(
    kinds: tuple[str, ...],
    a: ArrayLike,
    alpha: ArrayLike,
    offset: NDArray[Any],
    angle: NDArray[Any],
    pitch: NDArray[Any],
    **labels: Any,
) -> tuple[Mechanism, NDArray[Any]]:
    """Return the mechanism whose joints have these offsets and angles at zero, and its variables there."""
    constant, fixed, zero = offset.copy(), angle.copy(), []
    for j, kind in enumerate(kinds):
        if kind in "RCH":
            zero.append(angle[j])
            fixed[j] = np.nan
        if kind == "H":
            constant[j] = offset[j] - pitch[j] * angle[j]
        if kind in "PC":
            zero.append(offset[j])
            constant[j] = np.nan
    return Mechanism(kinds, a, alpha, constant, fixed, pitch, **labels), np.array(zero)


def reverse(mechanism: Mechanism | Placement, T: ArrayLike) -> Reverse:
    """Return every set of joint angles that brings the end of an arm to a pose.

    Parameters
    ----------
    mechanism : Mechanism or Placement
        Open chain of six revolute joints; or of joints R, P and C with six freedoms, two or three of them slides. Of a
        placement, pose and angles are in the robot's own frames and coordinates.
    T : array_like (..., 4, 4)
        Pose of the last joint's frame in the fixed frame F, as :func:`forward` returns it.

    Returns
    -------
    Reverse
        ``solutions`` (..., N, 6) and ``status`` (..., N). N is 8 where a closed form or a wrist's centre says that
        there are no more, or with two slides, 2 with three, else 16. Where the angles of one solution are not
        determined (a wrist that is singular, an elbow folded onto its shoulder, a wrist's centre on S_1), the status is
        FAMILY, and the free angle of the representative is zero wherever zero leaves a solution. Two solutions that
        meet (an elbow that is straight) are given once, as DOUBLE. What meets is decided by rounding: within about 1e-6
        rad of a degenerate pose either status may result.

    Raises
    ------
    RodgenError
        When the mechanism is not an open chain of six freedoms, or its freedoms depend on each other in every position;
        when `T` has another shape or is not real; and when no three consecutive axes meet or are parallel and `ssik`,
        which solves such arms, is not installed.

    Notes
    -----
    Crane and Duffy, reverse analysis of the Puma 560, the GE P60 and the Cincinnati T3-776; proved in the derivation
    ``robots_6r``, and, with slides, in ``spatial_loops``. :func:`group` says which method is used. Regular solutions of
    a closed form meet the pose to some 1e-14 of the reach; all others have been put back into the forward analysis, and
    meet it to 1e-11 and better.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> pose = spatial.forward(spatial.PUMA_560, [0.3, 0.2, -0.4, 0.5, 0.6, -0.7])
    >>> solutions, status = spatial.reverse(spatial.PUMA_560, pose)
    >>> solutions.shape, status
    ((8, 6), array([0, 0, 0, 0, 0, 0, 0, 0], dtype=int8))
    >>> bool(np.abs(spatial.forward(spatial.PUMA_560, solutions) - pose).max() < 1e-12)
    True
    """
    if isinstance(mechanism, Placement):
        return mechanism.reverse(T)
    pose, kinds = real_array("the pose", T, (4, 4)), set(mechanism.joints)
    slides = not mechanism.closed and kinds & set("PC") and sum(mechanism.freedoms) == 6
    return reach(mechanism, pose) if slides else solve_arm(mechanism, pose)
