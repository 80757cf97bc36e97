"""Forward analysis: systems, end frame and Jacobian of a mechanism, and the hypothetical link that closes a robot.

The pose is a product of transforms Tx(a) Rx(alpha) Tz(S) Rz(theta), one for each link and joint. Six revolute joints
have kernels of their own; every other chain is one step of one kernel after the other.

Hypothetical link: the end frame of a robot is given, S6, a67 and its origin P. A seventh joint and two links bring the
chain back to the fixed frame; what are S7, theta7, a71, alpha71, S1 and gamma1? Where S7 and S1 are not parallel, a71
is along S7 × S1 and P + S7 S7 + a71 a71 + S1 S1 = 0 is solved by triple products. Where they are (special case 1)
S7 = 0, and where they are on one line (special case 2) theta7 = 0, too.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy import spatial_links as generated
from rodgen.generated.numpy.spatial_links import HypotheticalStatus
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.ports import documented_by
from rodgen.kinematics.screws import line_along
from rodgen.kinematics.spatial.mechanism import Mechanism, check_mechanism
from rodgen.views import with_html

RIGHT_ANGLE = 2 * float(np.finfo(float).eps)
"""A multiple of 90 degrees, up to a turn, is off by the rounding of an angle near 2π: no more than this."""


@documented_by(generated.link_step, ["transform"])
def link_transform(a: ArrayLike, alpha: ArrayLike, offset: ArrayLike, angle: ArrayLike) -> Any:
    """Return the transform from one link's system to the next.

    Parameters
    ----------
    alpha : array_like (...), rad
        Twist of the link.

    Returns
    -------
    transform : array (..., 4, 4), 1 and length
        Tx(a) Rx(alpha) Tz(S) Rz(theta): the general link to link transformation matrix.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> spatial.link_transform(100.0, np.pi / 2, 20.0, 0.0)[:3, 3].round(9) + 0.0
    array([100., -20.,   0.])
    """
    twist = np.asarray(alpha, float)
    return kernels.link_step(np.eye(4), a, np.cos(twist), np.sin(twist), offset, angle)


def forward(mechanism: Mechanism, variables: ArrayLike) -> Any:
    """Return the end frame of an open chain, or the closure error of a closed loop.

    Parameters
    ----------
    mechanism : Mechanism
        Of joints R, P, C and H.
    variables : array_like (..., v)
        Angles in rad and offsets, in the order of ``mechanism.variables``.

    Returns
    -------
    array (..., 4, 4)
        Pose of the last joint's frame in the fixed frame F: x along the a after it, z along the joint. Of a closed loop
        the product all the way round: the unit matrix where, and only where, the variables close the loop.

    Raises
    ------
    RodgenError
        When the number of variables is another one, or the mechanism has joints E, T or S.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> spatial.forward(spatial.PUMA_560, np.zeros(6))[:3, 3].round(6) + 0.0
    array([17.8, -5.9, 13. ])
    """
    q = checked(mechanism, variables)
    if _is_6r(mechanism):
        return kernels.link_forward_6r(*_six(mechanism), q)
    frame = _all(mechanism, q)[-1]
    return _closing(mechanism, frame) if mechanism.closed else frame


def frames(mechanism: Mechanism, variables: ArrayLike) -> Any:
    """Return the systems of all links.

    Parameters
    ----------
    mechanism : Mechanism
        Of n joints R, P, C and H.
    variables : array_like (..., v)
        Angles in rad and offsets, in the order of ``mechanism.variables``.

    Returns
    -------
    array (..., n, 4, 4)
        System j has x along the link after joint j, z along S_j, and its origin where both meet; in the frame F.

    Raises
    ------
    RodgenError
        As for :func:`forward`.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.frames(spatial.GE_P60, [0.0] * 6)[:, :3, 3].round(6)[3] + 0.0
    array([160. ,   9.8,   0. ])
    """
    q = checked(mechanism, variables)
    return np.stack(_all(mechanism, q), axis=-3)


def jacobian(mechanism: Mechanism, variables: ArrayLike) -> Any:
    """Return how the end frame moves with each variable.

    Parameters
    ----------
    mechanism : Mechanism
        Of joints R, P, C and H.
    variables : array_like (..., v)
        Angles in rad and offsets, in the order of ``mechanism.variables``.

    Returns
    -------
    array (..., 6, v)
        Angular velocity (rows 0 to 2) and velocity of the origin of the end frame (rows 3 to 5), in the frame F, per
        unit of each variable.

    Raises
    ------
    RodgenError
        As for :func:`forward`.

    Notes
    -----
    A column is (S_j; S_j × (P - P_j)) for an angle, with the pitch times S_j more for a screw, and (0; S_j) for an
    offset; proved in the derivation ``spatial_links``.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> rates = spatial.jacobian(spatial.PUMA_560, [0.3, 0.2, 0.1, 0.4, 0.0, 0.6])
    >>> int(np.linalg.matrix_rank(rates))  # the wrist is stretched
    5
    """
    q = checked(mechanism, variables)
    if _is_6r(mechanism):
        return kernels.link_jacobian_6r(*_six(mechanism), q)
    chain = _all(mechanism, q)
    end = (_closing(mechanism, chain[-1]) if mechanism.closed else chain[-1])[..., :3, 3]
    columns = np.zeros((*q.shape[:-1], 6, q.shape[-1]))
    for column, (j, which) in enumerate(mechanism.variables):
        axis, origin = chain[j][..., :3, 2], chain[j][..., :3, 3]
        if which == "theta":
            columns[..., :3, column] = axis
            columns[..., 3:, column] = np.cross(axis, end - origin) + mechanism.pitch[j] * axis
        else:
            columns[..., 3:, column] = axis
    return columns


def screws(mechanism: Mechanism, chain: NDArray[Any]) -> NDArray[np.float64]:
    """Return the screw (v, 6) of each variable, (S; p × S + h S) or (0; S), where its links' systems are (n, 4, 4)."""
    axes, points = chain[:, :3, 2], chain[:, :3, 3]
    turns = line_along(points, axes, mechanism.pitch)
    rows = [
        turns[j] if which == "theta" else np.append(np.zeros(3), axes[j]) for j, which in mechanism.variables
    ]
    return np.array(rows)


def checked(mechanism: Mechanism, variables: ArrayLike) -> NDArray[Any]:
    """Return variables as an array of numbers (..., v).

    Raises
    ------
    TypeError, RodgenError
        When they are no real numbers, or another number of them.
    """
    check_mechanism(mechanism)
    return real_array("the array of variables", variables, (len(mechanism.variables),))


def _is_6r(mechanism: Mechanism) -> bool:
    return mechanism.joints == ("R",) * 6 and not mechanism.closed


def _six(mechanism: Mechanism) -> tuple[NDArray[Any], ...]:
    return mechanism.a, *_cosine_and_sine(mechanism.alpha), mechanism.offset


def _all(mechanism: Mechanism, q: NDArray[Any]) -> list[NDArray[Any]]:
    offsets: list[Any] = list(mechanism.offset)
    angles: list[Any] = list(mechanism.angle)
    for column, (j, which) in enumerate(mechanism.variables):
        (angles if which == "theta" else offsets)[j] = q[..., column]
    for j, kind in enumerate(mechanism.joints):
        if kind == "H":
            offsets[j] = offsets[j] + mechanism.pitch[j] * angles[j]
    cosine, sine = _cosine_and_sine(mechanism.alpha)
    frame = kernels.link_step(np.eye(4), 0.0, 1.0, 0.0, offsets[0], angles[0])
    each_frame = [frame]
    for j in range(1, len(mechanism.joints)):
        link = mechanism.a[j - 1], cosine[j - 1], sine[j - 1]
        frame = kernels.link_step(frame, *link, offsets[j], angles[j])
        each_frame.append(frame)
    # a chain that begins with fixed numbers has single systems there; every system has the batch's shape
    shape = (*q.shape[:-1], 4, 4)
    return [np.broadcast_to(each, shape) for each in each_frame]


def _closing(mechanism: Mechanism, frame: NDArray[Any]) -> Any:
    cosine, sine = _cosine_and_sine(mechanism.alpha[-1])
    return kernels.link_step(frame, mechanism.a[-1], cosine, sine, 0.0, 0.0)


def _cosine_and_sine(twist: Any) -> tuple[Any, Any]:
    """Return both, exact at right angles, which are no number of radians: no dust in poses and machine files."""
    cosine, sine = np.cos(twist), np.sin(twist)
    level, upright = np.abs(sine) <= RIGHT_ANGLE, np.abs(cosine) <= RIGHT_ANGLE
    return (
        np.where(level, np.sign(cosine), np.where(upright, 0.0, cosine)),
        np.where(upright, np.sign(sine), np.where(level, 0.0, sine)),
    )


@with_html
class HypotheticalLink(NamedTuple):
    """Links and joint that close a robot into a loop, of :func:`close_loop`; every field has the shape of the poses."""

    S7: Any
    theta7: Any
    a71: Any
    alpha71: Any
    S1: Any
    gamma1: Any
    a67: Any
    alpha67: Any
    status: Any

    def loop(self, mechanism: Mechanism) -> Mechanism:
        """Return the closed loop that a robot and this link make.

        Parameters
        ----------
        mechanism : Mechanism
            The robot, an open chain.

        Returns
        -------
        Mechanism
            With one joint R more, at theta7. Its theta1 is phi1 + gamma1.

        Raises
        ------
        RodgenError
            When the mechanism is closed, or this is not one link with a solution, but many or none.

        Examples
        --------
        >>> import numpy as np
        >>> from rodgen import spatial
        >>> q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        >>> link = spatial.close_loop(spatial.forward(spatial.PUMA_560, q))
        >>> round_trip = spatial.forward(link.loop(spatial.PUMA_560), [q[0] + link.gamma1, *q[1:], link.theta7])
        >>> bool(np.allclose(round_trip, np.eye(4), atol=1e-12))
        True
        """
        if mechanism.closed:
            raise RodgenError("the mechanism is a closed loop; expected an open chain to close")
        if np.ndim(self.status):
            raise RodgenError(f"there are links for {np.shape(self.status)} poses; expected that of one pose")
        if self.status == HypotheticalStatus.INVALID:
            raise RodgenError("the link is INVALID; expected one that closes a pose")
        first = float(self.S1) + mechanism.offset[0]  # NaN stays: the variable of a first joint P or C
        return Mechanism(
            (*mechanism.joints, "R"),
            [*mechanism.a, float(self.a67), float(self.a71)],
            [*mechanism.alpha, float(self.alpha67), float(self.alpha71)],
            [first, *mechanism.offset[1:], float(self.S7)],
            [*mechanism.angle, np.nan],
            [*mechanism.pitch, 0.0],
            unit=mechanism.unit,
            name=mechanism.name,
        )


@documented_by(generated.hypothetical_link)
def close_loop(
    pose: ArrayLike,
    a67: ArrayLike = 0.0,
    alpha67: ArrayLike | None = None,
    *,
    tolerance: float = 1e-8,
) -> HypotheticalLink:
    """Return the hypothetical link that closes a robot into a loop.

    Parameters
    ----------
    pose
        It has x along a67, z along S6.
    alpha67
        Left out: 90°, where that leaves s71 ≥ sin 45°, and else the better of 45° and 135°, of which one always does.
        Then the loop is NORMAL for every pose, and right to rounding.
    tolerance
        It is that of s71, the sine between S7 and S1, and the largest a71 / abs(P) that counts as none. It matters only
        where `alpha67` is given.

    Returns
    -------
    HypotheticalLink
        Offset S7, angle theta7, length a71 (signed), twist alpha71, offset S1, angle gamma1 (theta1 = phi1 + gamma1),
        the free a67 and alpha67, and the status, codes of :class:`HypotheticalStatus`. Angles in rad; NaN where the
        status is INVALID.

    Raises
    ------
    RodgenError
        When the tolerance is not between 0 and 1, or an argument is not an array of real numbers of its shape.

    Notes
    -----
    The hypothetical link technique, with all signs. In the normal case rounding is divided by s71; special case 1 is
    off by up to abs(P) s71. In double precision both are about 1e-8 abs(P) at s71 = 1e-8, the default tolerance; a
    coarser one, such as abs(c71) > 0.999, leaves errors of 0.04 abs(P).

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> link = spatial.close_loop(spatial.transform(np.eye(3), [3.0, 0.0, 1.0]), alpha67=0.0)
    >>> spatial.HypotheticalStatus(int(link.status)), float(link.a71), float(link.S1)
    (<HypotheticalStatus.PARALLEL: 1>, 3.0, -1.0)
    """
    if not 0 <= tolerance < 1:
        raise RodgenError(f"the tolerance is {tolerance}; expected a sine, from 0 to 1")
    T, length = real_array("the pose", pose, (4, 4)), real_array("a67", a67)
    twist = _best_twist(T) if alpha67 is None else real_array("alpha67", alpha67)
    S7, theta7, a71, alpha71, S1, gamma1, status = kernels.hypothetical_link(T, length, twist, tolerance)
    length, twist, _ = np.broadcast_arrays(length, twist, np.asarray(status))
    return HypotheticalLink(S7, theta7, a71, alpha71, S1, gamma1, length, twist, status)


def _best_twist(pose: Any) -> Any:
    """Return 90° where s71 is at least sin 45°, else 45° or 135°: c71 is that of S6 c67 - y6 s67."""
    y, z = pose[..., 2, 1], pose[..., 2, 2]
    diagonal = np.where(np.abs(z - y) <= np.abs(z + y), math.pi / 4, 3 * math.pi / 4)
    return np.where(y * y <= 0.5, math.pi / 2, diagonal)
