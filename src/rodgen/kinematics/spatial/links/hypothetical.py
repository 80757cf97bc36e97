"""The hypothetical link that closes a robot into a loop.

The end frame of a robot is given, S6, a67 and its origin P. A seventh joint and two links bring the chain back
to the fixed frame; what are S7, theta7, a71, alpha71, S1 and gamma1? Where S7 and S1 are not parallel, a71 is along
S7 × S1 and P + S7 S7 + a71 a71 + S1 S1 = 0 is solved by triple products. Where they are (special case 1) S7 = 0, and
where they are on one line (special case 2) theta7 = 0, too.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.errors import RodgenError
from rodgen.generated.numpy.spatial_links import HypotheticalStatus
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.views import html_of

__all__ = ["HypotheticalLink", "HypotheticalStatus", "close_loop"]


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

    def _repr_html_(self) -> str:
        return html_of(self)

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
    pose : array_like (..., 4, 4)
        End frame in the fixed frame: x along a67, z along S6.
    a67 : array_like (...), optional
        Length of the link after the last joint, free.
    alpha67 : array_like (...), optional
        Its twist in rad, free. Left out: 90°, where that leaves s71 ≥ sin 45°, and else the better of 45° and 135°, of
        which one always does. Then the loop is NORMAL for every pose, and right to rounding.
    tolerance : float, optional
        Largest sine s71 of the angle between S7 and S1 that counts as parallel, and largest a71 / abs(P) that counts as
        none. It matters only where `alpha67` is given.

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
    Crane and Duffy, hypothetical link technique; proved with all signs in the derivation ``spatial_links``. In the
    normal case rounding is divided by s71; special case 1 is off by up to abs(P) s71. In double precision both are
    about 1e-8 abs(P) at s71 = 1e-8, the default tolerance; a coarser one, such as abs(c71) > 0.999, leaves errors of
    0.04 abs(P).

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
    given, length = real_array("the pose", pose, (4, 4)), real_array("a67", a67)
    twist = _best_twist(given) if alpha67 is None else real_array("alpha67", alpha67)
    S7, theta7, a71, alpha71, S1, gamma1, status = kernels.hypothetical_link(given, length, twist, tolerance)
    length, twist, _ = np.broadcast_arrays(length, twist, np.asarray(status))
    return HypotheticalLink(S7, theta7, a71, alpha71, S1, gamma1, length, twist, status)


def _best_twist(pose: Any) -> Any:
    """Return 90° where s71 is at least sin 45°, else 45° or 135°: c71 is that of S6 c67 - y6 s67."""
    y, z = pose[..., 2, 1], pose[..., 2, 2]
    diagonal = np.where(np.abs(z - y) <= np.abs(z + y), math.pi / 4, 3 * math.pi / 4)
    return np.where(y * y <= 0.5, math.pi / 2, diagonal)
