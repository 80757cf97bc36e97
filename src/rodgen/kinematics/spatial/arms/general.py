"""Arms without special geometry, solved by ssik: Raghavan and Roth's 16 solutions of any six revolute joints.

ssik is an optional dependency (``pip install 'rodgen[ik]'``). The first pose of an arm costs it up to a minute and a
half of preparation, which it keeps on disk; each further pose costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from rodgen.errors import RodgenError
from rodgen.kinematics.spatial.arms.plan import reach
from rodgen.kinematics.spatial.links.forward import link_transform
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.status import ReverseStatus

SLOTS = 16


@lru_cache(maxsize=16)
def general(mechanism: Mechanism) -> Callable[[Any], tuple[Any, Any, Any]]:
    """Return the function that solves an arm for poses (n, 4, 4).

    It returns candidates: angles (n, 16, 6), statuses (n, 16), and whether one may be missing (n).

    Raises
    ------
    RodgenError
        When ssik is not installed.
    """
    try:
        import ssik
    except ImportError:
        raise RodgenError(
            "no three consecutive axes of this arm meet in one point or are parallel; expected such an arm, or the "
            "package ssik, which solves every arm: pip install 'rodgen[ik]'"
        ) from None
    # ssik's tolerances are for lengths near 1
    unit = reach(mechanism) or 1.0
    a, alpha = np.append(0.0, mechanism.a), np.append(0.0, mechanism.alpha)
    links = link_transform(a / unit, alpha, mechanism.offset / unit, 0.0)
    arm = ssik.Manipulator.from_transforms([*links, np.eye(4)])
    scale = np.ones((4, 4))
    scale[:3, 3] = 1 / unit

    def solve(T: Any) -> tuple[Any, Any, Any]:
        angles = np.zeros((len(T), SLOTS, 6))
        status = np.full((len(T), SLOTS), ReverseStatus.NONE, np.int8)
        missing = np.zeros(len(T), bool)
        for row, pose in enumerate(T * scale):
            found = arm.solve(pose, respect_limits=False, enumerate_windings=False, allow_refinement=True)
            missing[row] = len(found) % 2  # solutions come and go in pairs
            for slot, solution in enumerate(found[:SLOTS]):
                angles[row, slot] = solution.q
                status[row, slot] = ReverseStatus.REGULAR
        return angles, status, missing

    return solve
