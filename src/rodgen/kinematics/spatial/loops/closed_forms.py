"""Closed forms of RCCC and RRRCC loops, and the order of the joints for which they apply."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy.spatial_loops import RCCCStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.pairs.solve import solve_pair
from rodgen.kinematics.spatial.status import PairStatus

PLAIN = 1e-3
"""Least sine of a twist for the closed forms, which divide by it. For smaller ones the general method is used, which
chooses its divisor."""


def closed_form(
    mechanism: Mechanism, known: Mapping[int, Array]
) -> tuple[tuple[int, ...], Array, NDArray[np.bool_]] | None:
    """Return all angles of an RCCC or RRRCC loop in which the angle of the R before, or after, the C is given.

    These are the joints, their angles (count, N, joints), and which solutions exist; None for any other loop, and where
    the closed form may fail.
    """
    if len(known) != 1 or not mechanism.closed:
        return None
    ((variable, value),) = known.items()
    given, which = mechanism.variables[variable]
    n = len(mechanism.joints)
    if which != "theta":
        return None
    ring = [(given + k) % n for k in range(1, n + 1)]
    kinds = "".join(mechanism.joints[j] for j in ring)
    twists, lengths = (np.ascontiguousarray(x[ring]) for x in (mechanism.alpha, mechanism.a))
    offset = mechanism.offset
    if kinds == "CCCR" and (np.abs(np.sin(twists)) >= PLAIN).all():
        theta, _, status = kernels.loop_rccc(twists, lengths, offset[given], value)
        if (status == RCCCStatus.SINGULAR).any():
            return None
        return tuple(ring[:3]), theta, np.isfinite(theta).all(axis=-1)
    if kinds == "RRCCR" and abs(np.sin(twists[2])) >= PLAIN:
        offsets = np.array([offset[ring[0]], offset[ring[1]], offset[given]])
        pair = solve_pair(kernels.loop_rrrcc_pair(twists, lengths, offsets, value))
        if (pair.status == PairStatus.COMMON_FACTOR).any() or (pair.status > PairStatus.NONE).any():
            return None
        first, second = pair.theta1, pair.theta2
        rest, _ = kernels.loop_rrrcc_back(twists, lengths, offsets, value[:, None], first, second)
        return (
            tuple(ring[:4]),
            np.stack([first, second, rest[..., 0], rest[..., 1]], axis=-1),
            pair.status <= 1,
        )
    return None
