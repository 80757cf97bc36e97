"""All ways to close a loop with given variables, and all ways in which a robot with slides reaches a pose.

A loop of mobility 1 whose equivalent spherical mechanism is a quadrilateral (group 1: RCCC, 2R-P-2C, 3R-2P-C, 4R-3P) or
a pentagon (group 2: 3R-2C, 4R-P-C, 5R-2P), in any order of the joints, closes in at most two or eight ways once one
variable is given. When that is an offset, one angle more is unknown, and group 1 needs the method of group 2. A robot
with three or two slides among its six freedoms is such a loop with its pose as a link. RCCC and RRRCC loops have closed
forms for some orders of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError, listed
from rodgen.generated.numpy.spatial_loops import RCCCStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.numerics import principal
from rodgen.kinematics.spatial.arm_reverse import solve_arm
from rodgen.kinematics.spatial.loop_closure import solve_merged
from rodgen.kinematics.spatial.mechanism import Mechanism, Merged, merge
from rodgen.kinematics.spatial.pair_equations import solve_pair
from rodgen.kinematics.spatial.status import Reverse, ReverseStatus, solutions_first
from rodgen.kinematics.spatial.transforms import is_pose, rx, rz, transform

PLAIN = 1e-3
"""Least sine of a twist for the closed forms, which divide by it. For smaller ones the general method is used, which
chooses its divisor."""


CERTAIN = (ReverseStatus.REGULAR, ReverseStatus.DOUBLE, ReverseStatus.NONE)
"""The statuses in the slots of a pair of equations of which all solutions are known, and are no family."""


def closed_form(
    mechanism: Mechanism, known: Mapping[int, Array]
) -> tuple[tuple[int, ...], Array, NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Return all angles of an RCCC or RRRCC loop in which the angle of the R before, or after, the C is given.

    These are the joints, their angles (count, N, joints), which solutions exist (count, N), and of which elements that
    is certain (count); None for any other loop.
    """
    if len(known) != 1 or not mechanism.closed:
        return None
    ((variable, value),) = known.items()
    number, which = mechanism.variables[variable]
    n = len(mechanism.joints)
    if which != "theta":
        return None
    ring = [(number + k) % n for k in range(1, n + 1)]
    kinds = "".join(mechanism.joints[j] for j in ring)
    twists, lengths = (np.ascontiguousarray(x[ring]) for x in (mechanism.alpha, mechanism.a))
    offset = mechanism.offset
    if kinds == "CCCR" and (np.abs(np.sin(twists)) >= PLAIN).all():
        theta, _, status = kernels.loop_rccc(twists, lengths, offset[number], value)
        certain = status != RCCCStatus.SINGULAR
        return tuple(ring[:3]), theta, np.isfinite(theta).all(axis=-1), certain
    if kinds == "RRCCR" and abs(np.sin(twists[2])) >= PLAIN:
        offsets = np.array([offset[ring[0]], offset[ring[1]], offset[number]])
        pair = solve_pair(kernels.loop_rrrcc_pair(twists, lengths, offsets, value))
        first, second = pair.theta1, pair.theta2
        rest, _ = kernels.loop_rrrcc_back(twists, lengths, offsets, value[:, None], first, second)
        return (
            tuple(ring[:4]),
            np.stack([first, second, rest[..., 0], rest[..., 1]], axis=-1),
            pair.status <= ReverseStatus.DOUBLE,
            np.asarray(np.isin(pair.status, CERTAIN).all(axis=-1)),
        )
    return None


Variable = int | tuple[int | str, str]
"""A variable of a mechanism: its index, or a joint (by number from 0, or by name) and ``"theta"`` or ``"S"``."""

SLOTS = {3: 2, 4: 8}


def reverse_loop(mechanism: Mechanism, given: Mapping[Variable, ArrayLike]) -> Reverse:
    """Return all ways to close a loop, some of whose variables are given.

    Parameters
    ----------
    mechanism : Mechanism
        A closed loop of joints R, P and C.
    given : mapping of variable to array_like (...)
        Values of all but six variables: of one, where the mobility is 1. Lengths in the mechanism's unit, angles in
        rad; they broadcast against each other. With three unknown angles there are at most two ways, with four eight.

    Returns
    -------
    Reverse
        All variables, (..., N, v). Every way closes the loop to 1e-11 rad and, relative to its largest length, slides
        among them, to 1e-11. Ways with a slide longer than a million times the loop are at infinity and do not count.

    Raises
    ------
    RodgenError
        When the chain is open or has other joints, when six unknowns are not left, and when five or six of them are
        angles (groups 3 and 4), which is not solved here, except that a 7R loop is solved as an arm with six joints.

    Notes
    -----
    Crane and Duffy, "Kinematic Analysis of Robot Manipulators", group one and group two solution processes; proved in
    the derivation ``spatial_loops``. A status FAMILY marks a way that can be moved although the input is held.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> loop = spatial.Mechanism("CCCR", a=[1.0, 2.0, 3.0, 4.0], alpha=np.radians([40, 70, 85, 70]),
    ...                          offset=[np.nan, np.nan, np.nan, 0.5])
    >>> found = spatial.reverse_loop(loop, {(3, "theta"): np.radians(75)})
    >>> np.degrees(found.solutions[:, 0]).round(4)
    array([136.543 ,  63.5047])
    """
    if not mechanism.closed:
        raise RodgenError(
            "the mechanism is an open chain; expected a closed loop, with a link after every joint"
        )
    _check_joints(mechanism)
    known = {_index(mechanism, key): _number(key, value) for key, value in given.items()}
    if len(known) != len(given):
        raise RodgenError("a variable is given twice; expected each once")
    return _solved(mechanism, known, None)


def reach(mechanism: Mechanism, pose: Array) -> Reverse:
    """Return all ways in which a robot with two or three slides among its six freedoms reaches poses (..., 4, 4).

    The pose, inverted, is the link that closes the chain to a loop of group 1 or 2; no hypothetical link is needed.
    """
    _check_joints(mechanism)
    R, p = pose[..., :3, :3], pose[..., :3, 3]
    back = np.where(is_pose(pose)[..., None, None], np.swapaxes(R, -1, -2), np.nan)
    return _solved(mechanism, {}, (back, -np.einsum("...ij,...j->...i", back, p)))


def _check_joints(mechanism: Mechanism) -> None:
    for name, kind in zip(mechanism.names, mechanism.joints, strict=True):
        if kind == "H":
            raise RodgenError(
                f"joint {name} is a screw; expected joints R, P and C: its offset is not a polynomial in its angle"
            )
        if kind not in "RPC":
            raise RodgenError(f"joint {name} is {kind!r}; expected R, P or C: call expanded() first")


def _index(mechanism: Mechanism, key: Variable) -> int:
    variables = mechanism.variables
    names = [f"({mechanism.names[j]!r}, {which!r})" for j, which in variables]
    if isinstance(key, tuple) and len(key) == 2:
        joint: Any = key[0]
        if isinstance(joint, str):
            joint = mechanism.names.index(joint) if joint in mechanism.names else -1
        for i, (j, which) in enumerate(variables):
            if (joint, key[1]) == (j, which):
                return i
    elif isinstance(key, int | np.integer) and 0 <= key < len(variables):
        return int(key)
    raise RodgenError(f"there is no variable {key!r}; expected {listed(names)}, or its index")


def _number(key: Variable, value: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise RodgenError(f"the value of {key!r} is {value!r}; expected a number") from None


def _solved(
    mechanism: Mechanism,
    known: Mapping[int, NDArray[np.float64]],
    closing: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
) -> Reverse:
    variables = mechanism.variables
    unknown = [i for i in range(len(variables)) if i not in known]
    angles = sum(variables[i][1] == "theta" for i in unknown)
    if len(unknown) != 6:
        counts = f"{len(known)} of {len(variables)} variables are given"
        raise RodgenError(
            f"{len(unknown)} unknowns are left ({counts}); expected 6, which is {len(variables) - 6} given"
        )
    if angles not in SLOTS:
        if mechanism.joints == ("R",) * 7 and closing is None:
            return _seven_turning(mechanism, known)
        if angles > 4:
            raise RodgenError(
                f"{angles} of the six unknowns are angles: a problem of group {angles - 2}, of degree 16; "
                "expected three or four (groups 1 and 2)"
            )
        raise RodgenError(f"only {angles} of the six unknowns are angles; expected three or four")
    shape = np.broadcast_shapes(
        *(value.shape for value in known.values()), () if closing is None else closing[1].shape[:-1]
    )
    count = int(np.prod(shape))
    flat = {i: np.broadcast_to(value, shape).reshape(count) for i, value in known.items()}
    link = None
    if closing is not None:
        link = closing[0].reshape(count, 3, 3), closing[1].reshape(count, 3)
    good = np.ones(count, bool)
    for value in flat.values():
        good &= np.isfinite(value)
    if link is not None:
        good &= np.isfinite(link[0]).all(axis=(1, 2)) & np.isfinite(link[1]).all(axis=1)
        link = np.where(good[:, None, None], link[0], np.eye(3)), np.where(good[:, None], link[1], 0.0)
    clean = {i: np.where(good, value, 0.0) for i, value in flat.items()}
    merged = merge(mechanism, clean, link)
    size = _size(mechanism, merged, count)
    start = None
    if (form := closed_form(mechanism, clean)) is not None:
        joints, angles_there, there, certain = form
        start = angles_there[..., [joints.index(j) for j in merged.joints]], there, certain
    theta, slides, status = solve_merged(mechanism, merged, count, size, start)
    values = np.full((count, status.shape[1], len(variables)), np.nan)
    values[..., list(merged.rotary)] = theta
    values[..., list(merged.slides)] = slides
    for i, value in flat.items():
        values[..., i] = value[:, None]
    turning = [i for i, (_, which) in enumerate(variables) if which == "theta" and i not in known]
    values[..., turning] = principal(values[..., turning])
    status = np.where(good[:, None], status, np.int8(ReverseStatus.INVALID))
    values = np.where((status < ReverseStatus.NONE)[..., None], values, np.nan)
    values, kinds = solutions_first(values, status.astype(np.int8))
    slots = kinds.shape[1]
    return Reverse(values.reshape(*shape, slots, len(variables)), kinds.reshape(*shape, slots))


def _seven_turning(mechanism: Mechanism, known: Mapping[int, NDArray[np.float64]]) -> Reverse:
    """Return all ways to close a 7R loop with one angle given: the others are an arm posed by that joint."""
    ((index, value),) = known.items()
    ring = [(index + k) % 7 for k in range(1, 8)]
    arm = Mechanism(
        "R" * 6,
        mechanism.a[ring[:5]],
        mechanism.alpha[ring[:5]],
        mechanism.offset[ring[:6]],
        unit=mechanism.unit,
    )
    good = np.isfinite(value)
    angle = np.where(good, value, 0.0)
    before, after = mechanism.alpha[ring[5]], mechanism.alpha[index]
    turned = rx(before) @ rz(angle)
    R = turned @ rx(after)
    v = mechanism.a[ring[5]] * np.array([1.0, 0.0, 0.0]) + mechanism.offset[index] * rx(before)[:, 2]
    v = v + mechanism.a[index] * turned[..., 0]
    pose = transform(np.swapaxes(R, -1, -2), -np.einsum("...ji,...j->...i", R, v))
    solutions, status = solve_arm(arm, pose)
    values = np.empty((*solutions.shape[:-1], 7))
    values[..., ring[:6]] = solutions
    values[..., index] = value[..., None]
    status = np.where(good[..., None], status, np.int8(ReverseStatus.INVALID))
    values = np.where((status < ReverseStatus.NONE)[..., None], values, np.nan)
    return Reverse(values, status)


def _size(mechanism: Mechanism, merged: Merged, count: int) -> NDArray[np.float64]:
    """Return the unit of length of each loop: its largest known length, and 1 where all vanish."""
    sizes = np.zeros(count)
    for link in merged.links:
        sizes = np.maximum(sizes, np.abs(link.v).max(axis=-1))
    sizes = np.maximum(sizes, np.abs(mechanism.a).max(initial=0.0))
    return np.where(sizes > 0, sizes, 1.0)
