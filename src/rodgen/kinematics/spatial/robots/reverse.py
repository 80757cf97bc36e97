"""Every set of joint variables that brings the end of a robot to a pose."""

from __future__ import annotations

from numpy.typing import ArrayLike

from rodgen.kinematics.spatial.arms.plan import plan
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.robots.placement import Placement, solve_pose
from rodgen.kinematics.spatial.status import Reverse


def reverse(mechanism: Mechanism | Placement, T: ArrayLike) -> Reverse:
    """Return every set of joint angles that brings the end of an arm to a pose.

    Parameters
    ----------
    mechanism : Mechanism
        Open chain of six revolute joints. A chain with two or three slides is solved by :func:`reverse_sliding`. For a
        :class:`Placement`, pose and angles are in the robot's own frames and coordinates.
    T : array_like (..., 4, 4)
        Pose of the last joint's frame in the fixed frame F, as :func:`forward` returns it.

    Returns
    -------
    Reverse
        ``solutions`` (..., N, 6) and ``status`` (..., N). N is 8 where a closed form or a wrist's centre says that
        there are no more, else 16. Where the angles of one solution are not determined (a wrist that is singular, an
        elbow folded onto its shoulder, a wrist's centre on S_1), the status is FAMILY, and the free angle of the
        representative is zero wherever zero leaves a solution. Two solutions that meet (an elbow that is straight) are
        given once, as DOUBLE. What meets is decided by rounding: within about 1e-6 rad of a degenerate pose either
        status may result.

    Raises
    ------
    RodgenError
        When the mechanism is not an open chain of six freedoms, or its freedoms depend on each other in every position;
        when `T` has another shape or is not real; and when no three consecutive axes meet or are parallel and `ssik`,
        which solves such arms, is not installed.

    Notes
    -----
    Crane and Duffy, reverse analysis of the Puma 560, the GE P60 and the Cincinnati T3-776; proved in the derivation
    ``robots_6r``. :func:`reverse_method` says which method is used. Regular solutions of a closed form meet the pose to
    some 1e-14 of the reach; all others have been put back into the forward analysis, and meet it to 1e-11 and better.

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
    return mechanism.reverse(T) if isinstance(mechanism, Placement) else solve_pose(mechanism, T)


def reverse_method(mechanism: Mechanism | Placement) -> str:
    """Return how :func:`reverse` solves an arm.

    Parameters
    ----------
    mechanism : Mechanism
        Open chain of six revolute joints.

    Returns
    -------
    str
        ``"closed form: ..."``, ``"pair of equations: ..."`` or ``"general: ssik"``, with the special axes.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.reverse_method(spatial.GE_P60)
    'closed form: axes 2, 3, 4 are parallel, axes 5, 6 meet'
    """
    return plan(mechanism.mechanism if isinstance(mechanism, Placement) else mechanism).method
