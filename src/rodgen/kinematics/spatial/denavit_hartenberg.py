"""Standard and modified Denavit-Hartenberg tables, to and from mechanisms.

A robot is given as rows of four numbers. In the modified convention (Craig) row j is the link before joint j
and the joint, Tx(a) Rx(alpha) Tz(d) Rz(theta): Crane and Duffy's transform, with one more link at the base. In the
standard one row j is the joint and the link after it, Rz(theta) Tz(d) Tx(a) Rx(alpha): the same chain with one more
link at the end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.spatial.forward_analysis import link_transform
from rodgen.kinematics.spatial.mechanism import Mechanism
from rodgen.kinematics.spatial.placement import Placement, at_zero, mechanism_at, placed
from rodgen.views import with_html

Convention = Literal["standard", "modified"]


@with_html
class DenavitHartenberg(NamedTuple):
    """A table of n rows, with the joints at zero, and the frames before and after it.

    Attributes
    ----------
    joints : tuple of str
        Kinds of the joints, the base's first.
    a, alpha, offset, angle : array (n)
        Lengths and twists (rad) of the links, offsets d and angles theta (rad) of the joints where the robot's
        coordinates are zero: a variable is added to its number.
    pitch : array (n)
        Length per rad of screws, zero for other joints.
    base, end : array (4, 4)
        Frames that multiply the rows from the left and from the right.
    """

    joints: tuple[str, ...]
    a: Array
    alpha: Array
    offset: Array
    angle: Array
    pitch: Array
    base: Array
    end: Array


def from_denavit_hartenberg(
    joints: str | Sequence[str],
    a: ArrayLike,
    alpha: ArrayLike,
    offset: ArrayLike,
    angle: ArrayLike | None = None,
    pitch: ArrayLike | None = None,
    *,
    convention: Convention = "standard",
    base: ArrayLike | None = None,
    end: ArrayLike | None = None,
    unit: str = "mm",
    name: str = "",
    names: Iterable[str] = (),
) -> Placement:
    """Return the mechanism of a Denavit-Hartenberg table.

    Parameters
    ----------
    joints : str or sequence of str, length n
        Kinds of the joints, R, P, C and H, the base's first.
    a, alpha : array_like (n)
        Length and twist (rad) of the link after each joint; in the modified convention, before it.
    offset, angle : array_like (n)
        d and theta (rad) of each joint; of a variable its value where the robot's coordinate is zero. Angles left out
        are zero.
    pitch : array_like (n), optional
        Of screws, length per rad.
    convention : {"standard", "modified"}, optional
        The modified one is Craig's.
    base, end : array_like (4, 4), optional
        Frames that multiply the rows from the left and from the right.
    unit, name, names
        As of :class:`Mechanism`.

    Returns
    -------
    Placement
        Whose ``forward`` is base · Π Rz(theta) Tz(d) Tx(a) Rx(alpha) · end, or, in the modified convention,
        base · Π Tx(a) Rx(alpha) Tz(d) Rz(theta) · end.

    Raises
    ------
    RodgenError
        When the table does not fit the joints, or there is no such convention.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> arm = spatial.from_denavit_hartenberg("RR", a=[300.0, 200.0], alpha=[0.0, 0.0], offset=[0.0, 0.0])
    >>> arm.forward([0.0, np.pi / 2])[:3, 3].round(9)
    array([300., 200.,   0.])
    >>> arm = spatial.from_denavit_hartenberg("RR", [0.0, 300.0], [0.0, 0.0], [0.0, 50.0], convention="modified")
    >>> arm.forward([0.0, 0.0])[:3, 3]
    array([300.,   0.,  50.])
    """
    modified = _is_modified(convention)
    kinds, length, twist, *numbers = _table(joints, a, alpha, offset, angle, pitch)
    outer, inner = (0, slice(1, None)) if modified else (-1, slice(-1))
    mechanism, zero = mechanism_at(
        kinds, length[inner], twist[inner], *numbers, unit=unit, name=name, names=names
    )
    link = link_transform(length[outer], twist[outer], 0.0, 0.0)
    if modified:
        base = link if base is None else real_array("base", base, (4, 4)) @ link
    else:
        end = link if end is None else link @ real_array("end", end, (4, 4))
    return Placement(mechanism, base, end, zero)


def to_denavit_hartenberg(
    robot: Mechanism | Placement, convention: Convention = "standard"
) -> DenavitHartenberg:
    """Return the Denavit-Hartenberg table of an open chain.

    Parameters
    ----------
    robot : Mechanism or Placement
    convention : {"standard", "modified"}, optional
        The modified one is Craig's.

    Returns
    -------
    DenavitHartenberg
        An end frame that is a link, Tx(a) Rx(alpha), becomes the last row's; any other stays as ``end``. In the
        modified convention that is so of the base frame, the first row and ``base``.

    Raises
    ------
    RodgenError
        When the chain is closed or has joints E, T or S, or there is no such convention.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.to_denavit_hartenberg(spatial.PUMA_560).a
    array([ 0. , 17. ,  0.8,  0. ,  0. ,  0. ])
    """
    given, modified = placed(robot), _is_modified(convention)
    mechanism, base, end = given.mechanism, np.array(given.base), np.array(given.end)
    if modified:
        (length, twist), base = _link_in(base)
    else:
        (length, twist), end = _link_in(end)
    place = 0 if modified else len(mechanism.a)
    a, alpha = np.insert(mechanism.a, place, length), np.insert(mechanism.alpha, place, twist)
    offset, angle = at_zero(given)
    return DenavitHartenberg(mechanism.joints, a, alpha, offset, angle, np.array(mechanism.pitch), base, end)


def _is_modified(convention: str) -> bool:
    if convention not in ("standard", "modified"):
        raise RodgenError(f"the convention is {convention!r}; expected 'standard' or 'modified'")
    return convention == "modified"


def _table(
    joints: str | Sequence[str],
    a: ArrayLike,
    alpha: ArrayLike,
    offset: ArrayLike,
    angle: ArrayLike | None,
    pitch: ArrayLike | None,
) -> tuple[Any, ...]:
    kinds = tuple(joints)
    columns = [kinds]
    for what, given in (("a", a), ("alpha", alpha), ("offset", offset), ("angle", angle), ("pitch", pitch)):
        column = np.zeros(len(kinds)) if given is None else real_array(what, given).copy()
        if column.shape != (len(kinds),) or not np.isfinite(column).all():
            raise RodgenError(
                f"{what} has the shape {column.shape} or a number that is not finite; expected {len(kinds)} numbers, "
                "one a joint"
            )
        columns.append(column)  # type: ignore[arg-type]
    return tuple(columns)


def _link_in(frame: Array) -> tuple[tuple[float, float], Array]:
    """Return length and twist of a frame that is Tx(a) Rx(alpha), and the unit matrix; else none, and the frame."""
    length, twist = frame[0, 3], np.arctan2(frame[2, 1], frame[1, 1])
    size = 1.0 + np.abs(frame[:3, 3]).max()
    error = np.abs(frame - link_transform(length, twist, 0.0, 0.0)).max()
    if error <= 8 * np.finfo(float).eps * size:
        return (float(length), float(twist)), np.eye(4)
    return (0.0, 0.0), np.array(frame)
