"""Numeric values of the names X, Y, Z, U, V, W of links and joints.

The scalar products of the directions of joints and links have short names: with the twists α and the joint
angles θ, X_32 is the component of S₄ along a₁₂, Z_32 = S₁ · S₄, W_32 = a₁₂ · a₃₄. Falling subscripts look ahead, rising
ones back. On a closed loop different names are equal, see :func:`rodgen.spatial.toolkit`.

A dual angle θ + ε S, α + ε a, joins the offset or the length to the angle. The dual part of a name, X_0 and so on, is
its derivative along the lengths and offsets; on closed loops the dual parts obey the secondary laws.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel
from rodgen.polygon_notation import Term

_NAME = re.compile(r"([XYZUVW])(b?)([*]?)_?([1-9]+)\Z")
_INDEX = {"X": 0, "Y": 2, "Z": 3, "U": 0, "V": 2, "W": 3}


def notation(name: str, alpha: ArrayLike, theta: ArrayLike) -> Any:
    """Return the value of a name of the X-Y-Z or the U-V-W notation.

    Parameters
    ----------
    name : str
        A letter, ``b`` for the bar of a single X, Y or Z, ``*`` for X* or U*, and the joints, each next to the one
        before, with joint 1 next to the last: ``"X_32"``, ``"Xb_2"``, ``"X*_451"``, ``"W_712"``.
    alpha : array_like (..., n)
        Twists in rad: component i - 1 is that from joint i to the next. n is 3 to 9.
    theta : array_like (..., n)
        Joint angles in rad. What the name does not hold may be NaN.

    Returns
    -------
    array (...)
        The value; NaN where an angle that the name holds is not finite.

    Raises
    ------
    ValueError
        For what is no name for n joints, and for one of more than five steps.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Single Subscript Notation" to "Double Subscript Notation for
    α Terms"; proved in the derivation ``spherical_polygons``. X and U (and X*, U*) do without the last angle.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> alpha, theta_4 = np.radians([40, 70, 85, 70]), np.radians(75)
    >>> theta, status = spatial.spherical_quadrilateral(alpha, theta_4)
    >>> np.allclose(spatial.notation("Z_41", alpha, theta), np.cos(alpha[1]))  # both close the polygon
    True
    """
    term, angles = _gathered(name, alpha, theta)
    values = call_kernel(getattr(kernels, f"polygon_notation_{_steps(term)}"), (_visible(term, angles),))
    return values[..., _place(term)]


def secondary_notation(
    name: str, alpha: ArrayLike, theta: ArrayLike, a: ArrayLike, offset: ArrayLike
) -> tuple[Any, Any]:
    """Return the value of a name and its dual part.

    Parameters
    ----------
    name, alpha, theta
        As for :func:`notation`.
    a : array_like (..., n)
        Lengths of the links, in the order of the twists.
    offset : array_like (..., n)
        Offsets of the joints, in the order of the joint angles and in the same unit.

    Returns
    -------
    primary : array (...)
        The value of :func:`notation`.
    secondary : array (...)
        Its dual part, in the unit of length.

    Raises
    ------
    ValueError
        As for :func:`notation`.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Secondary Cosine Laws", "Dual Angles"; proved in the
    derivation ``spherical_polygons``.

    Examples
    --------
    >>> from rodgen import spatial
    >>> primary, secondary = spatial.secondary_notation("Z_2", [0.5, 1, 1], [0, 0.3, 0], [2, 1, 0], [0, 4, 0])
    >>> h = 1e-6  # twists and angles moved along the lengths and offsets
    >>> ahead = spatial.notation("Z_2", [0.5 + 2 * h, 1 + h, 1], [0, 0.3 + 4 * h, 0])
    >>> round(float((ahead - primary) / h - secondary), 4) + 0.0
    0.0
    """
    term, angles = _gathered(name, alpha, theta)
    _, lengths = _gathered(name, a, offset)
    kernel = getattr(kernels, f"polygon_secondary_{_steps(term)}")
    primary, secondary = call_kernel(kernel, (_visible(term, angles), _visible(term, lengths)))
    return primary[..., _place(term)], secondary[..., _place(term)]


def direction_cosines(alpha: ArrayLike, theta: ArrayLike) -> tuple[Any, Any]:
    """Return the directions of all joints and links in the frame of the first link.

    Parameters
    ----------
    alpha, theta : array_like (..., n)
        Twists and joint angles in rad, as for :func:`notation`. The first joint's angle does not matter, nor does, for
        an open chain, the last twist.

    Returns
    -------
    joints : array (..., n, 3)
        Unit vectors along S_1, S_2, …, S_n; S_1 is z.
    links : array (..., n, 3)
        Unit vectors along a_12, a_23, …, a_n1; a_12 is x.

    Raises
    ------
    ValueError
        When the shapes do not broadcast to at least one joint.
    TypeError
        When an angle is not real.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Find 1S1" to "Rewrite 1a45 through 1a67": S_j is
    (X, Y, Z) with the subscripts j-1 … 2, a_j,j+1 is (W, -U*, U) with j … 2 and j … 21.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> joints, links = spatial.direction_cosines([np.pi / 2, np.pi / 2], [0, np.pi / 2])
    >>> np.round(joints, 6) + 0.0
    array([[ 0.,  0.,  1.],
           [ 0., -1.,  0.]])
    >>> np.round(links, 6) + 0.0
    array([[1., 0., 0.],
           [0., 0., 1.]])
    """
    alpha, theta = np.broadcast_arrays(np.asarray(alpha), np.asarray(theta))
    if not alpha.ndim or not alpha.shape[-1]:
        raise ValueError("alpha and theta need a last axis with one component for each joint")
    number = np.result_type(alpha, theta, np.float32)
    if not np.issubdtype(number, np.floating):
        raise TypeError(f"twists and joint angles are real numbers, not {number}")
    c_twist, s_twist = np.cos(alpha, dtype=number), np.sin(alpha, dtype=number)
    c_joint, s_joint = np.cos(theta, dtype=number), np.sin(theta, dtype=number)
    joints, links = np.empty((*alpha.shape, 3), number), np.empty((*alpha.shape, 3), number)
    x, y, z = (np.broadcast_to(row, (*alpha.shape[:-1], 3)) for row in np.eye(3, dtype=number))
    for j in range(alpha.shape[-1]):
        if j:
            c, s = c_twist[..., j - 1, None], s_twist[..., j - 1, None]
            y, z = c * y + s * z, c * z - s * y
            c, s = c_joint[..., j, None], s_joint[..., j, None]
            x, y = c * x + s * y, c * y - s * x
        joints[..., j, :], links[..., j, :] = z, x
    return joints, links


def _gathered(name: str, alpha: ArrayLike, theta: ArrayLike) -> tuple[Term, Any]:
    """Return the term that a name stands for, and its angles in the order of the chain."""
    twists, joints = np.asarray(alpha), np.asarray(theta)
    sizes = {array.shape[-1] if array.ndim else 0 for array in (twists, joints)}
    if len(sizes) != 1:
        raise ValueError(
            f"there are {twists.shape[-1:]} links and {joints.shape[-1:]} joints; expected one n for both"
        )
    (n,) = sizes
    found = _NAME.match(name) if isinstance(name, str) else None
    if found is None:
        raise ValueError(f"{name!r} is not a name; expected a name such as X_32, Xb_2, X*_321 or W_21")
    letter, bar, star, numbers = found.groups()
    term = Term(letter, tuple(map(int, numbers)), n, bar=bool(bar), star=bool(star))
    if _steps(term) > 5:
        raise ValueError(f"{name} takes {_steps(term)} steps; a heptagon needs no more than 5")
    parts = {"alpha": twists, "theta": joints}
    columns = [parts[kind][..., number - 1] for kind, number in term.angles()]
    return term, np.stack(np.broadcast_arrays(*columns), axis=-1)


def _steps(term: Term) -> int:
    return len(term.subscripts) - term.polar


def _visible(term: Term, angles: Any) -> Any:
    """Return the angles with the last one, which may be unknown, set to 0 where the name does not depend on it."""
    if term.letter in "XU":
        angles[..., -1] = 0
    return angles


def _place(term: Term) -> int:
    return 1 if term.star else _INDEX[term.letter]
