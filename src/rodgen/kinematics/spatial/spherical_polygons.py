"""Spherical polygons: values of the names of links and joints, linkages that close, and the toolkit of equations.

The scalar products of the directions of joints and links have short names: with the twists α and the joint
angles θ, X_32 is the component of S₄ along a₁₂, Z_32 = S₁ · S₄, W_32 = a₁₂ · a₃₄. Falling subscripts look ahead, rising
ones back. On a closed loop different names are equal, see :func:`rodgen.spatial.toolkit`.

A dual angle θ + ε S, α + ε a, joins the offset or the length to the angle. The dual part of a name, X_0 and so on, is
its derivative along the lengths and offsets; on closed loops the dual parts obey the secondary laws.

Quadrilateral: the cosine law Z_41 = c_23 is A cos θ₁ + B sin θ₁ + D = 0 with A = s_12 Y_4, B = s_12 X_4 and
D = c_12 Z_4 - c_23, so there are two ways to close, one or none; θ₂ and θ₃ follow from their sines and cosines. Where
two neighbouring axes coincide, a joint can be at any angle.

Pentagon: the cosine law Z_45 = Z_2 has θ₂ alone, so there are two of opposite signs. Then θ₁ is linear in its sine and
cosine by X_45 = X_21 and Y_45 = -X*_21, and θ₃ follows from its own.

To solve a mechanism one picks, of all equations of its spherical polygon, those in the unknowns one wants. The toolkit
lists them: what the names mean, the laws of every kind with every shift of the subscripts, and the secondary laws with
lengths and offsets.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy import spherical_polygons as generated
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by
from rodgen.polygon_laws import FAMILIES, POLYGONS, HalfTangent, Law, laws
from rodgen.polygon_notation import Monomial, Term

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


def _gathered(name: str, alpha: ArrayLike, theta: ArrayLike) -> tuple[Term, Any]:
    """Return the term that a name stands for, and its angles in the order of the chain."""
    twists, joints = np.asarray(alpha), np.asarray(theta)
    sizes = {array.shape[-1] if array.ndim else 0 for array in (twists, joints)}
    if len(sizes) != 1:
        raise ValueError(
            f"there are {twists.shape[-1:]} links and {joints.shape[-1:]} joints; expected one n for both"
        )
    (n,) = sizes
    match = _NAME.match(name) if isinstance(name, str) else None
    if match is None:
        raise ValueError(f"{name!r} is not a name; expected a name such as X_32, Xb_2, X*_321 or W_21")
    letter, bar, star, numbers = match.groups()
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


@documented_by(generated.polygon_quadrilateral)
def spherical_quadrilateral(alpha: ArrayLike, theta_4: ArrayLike) -> tuple[Any, Any]:
    """Return all joint angles of a spherical four-bar linkage.

    Parameters
    ----------
    alpha
        They may have any sign.
    theta_4
        It is between the links 34 and 41.

    Returns
    -------
    theta
        The last one is as it was given. NaN where, and only where, the status is NONE or INVALID.

    Notes
    -----
    The source is the lecture notes "Robot Geometry", "Spherical Mechanism Equation Toolkit". Angles are from link to
    link about the joint, so θ is π less the angle inside the polygon. Near DOUBLE an angle is right to half of the
    digits, as for any method.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> theta, status = spatial.spherical_quadrilateral(np.radians([40, 70, 85, 70]), np.radians(75))
    >>> np.degrees(theta).round(4)
    array([[136.543 , -38.2302, 135.7593,  75.    ],
           [ 63.5047,  38.2302,  87.7179,  75.    ]])
    >>> spatial.PolygonStatus(int(status)).name
    'TWO'
    """
    return call_kernel(kernels.polygon_quadrilateral, (alpha, theta_4))  # type: ignore[no-any-return]


@documented_by(generated.polygon_pentagon)
def spherical_pentagon(alpha: ArrayLike, theta_4: ArrayLike, theta_5: ArrayLike) -> tuple[Any, Any]:
    """Return all joint angles of a spherical five-bar linkage.

    Parameters
    ----------
    alpha
        They may have any sign.
    theta_4 : array_like (...), rad
        Angle of joint 4.
    theta_5 : array_like (...), rad
        Angle of joint 5.

    Returns
    -------
    theta
        The last two are as they were given. NaN where, and only where, the status is NONE or INVALID.

    Notes
    -----
    The source is the lecture notes "Robot Geometry", "Spherical Pentagon Example". For other given joints turn or
    mirror the subscripts.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> alpha = np.radians([60, 80, 70, 50, 65])
    >>> theta, status = spatial.spherical_pentagon(alpha, np.radians(40), np.radians(80))
    >>> np.degrees(theta).round(4)
    array([[ -29.1991,  103.4311,   31.9207,   40.    ,   80.    ],
           [ 146.4949, -103.4311,  154.908 ,   40.    ,   80.    ]])
    """
    angles = np.stack(np.broadcast_arrays(theta_4, theta_5), axis=-1)
    return call_kernel(kernels.polygon_pentagon, (alpha, angles))  # type: ignore[no-any-return]


_NAMES = (
    ("X_j = s_ij s_j", "Xb_j = s_jk s_j"),
    ("Y_j = -(s_jk c_ij + c_jk s_ij c_j)", "Yb_j = -(s_ij c_jk + c_ij s_jk c_j)"),
    ("Z_j = c_jk c_ij - s_jk s_ij c_j", "Zb_j = Z_j"),
    ("U_ij = s_i s_ij", "V_ij = -(s_j c_i + c_j s_i c_ij)", "W_ij = c_j c_i - s_j s_i c_ij"),
)
_STEP = (
    ("X_ab = X_a c_b - Y_a s_b", "X*_ab = X_a s_b + Y_a c_b"),
    ("Y_ab = c_e X*_ab - s_e Z_a", "Z_ab = s_e X*_ab + c_e Z_a"),
)
_POLAR_STEP = (
    ("U_ab = U_a c_e - V_a s_e", "U*_ab = U_a s_e + V_a c_e"),
    ("V_ab = c_b U*_ab - s_b W_a", "W_ab = s_b U*_ab + c_b W_a"),
)
_SECONDARY = (
    ("X0_j = a_ij c_ij s_j + S_j s_ij c_j",),
    ("Y0_j = a_ij (s_jk s_ij - c_jk c_ij c_j) - a_jk Z_j + S_j c_jk X_j",),
    ("Z0_j = a_ij Yb_j + a_jk Y_j + S_j s_jk X_j",),
    ("X0_ab = X0_a c_b - Y0_a s_b - S_b X*_ab", "X*0_ab = X0_a s_b + Y0_a c_b + S_b X_ab"),
    ("Y0_ab = c_e X*0_ab - s_e Z0_a - a_e Z_ab", "Z0_ab = s_e X*0_ab + c_e Z0_a + a_e Y_ab"),
)
_WORDS = {
    "joints": "Joint j has the links ij before it and jk after it; c_j, s_j are of its angle, c_ij, s_ij "
    "of a twist. One subscript; with a bar, Xb, the twist after the joint takes the place of the one before:",
    "step": "More: a is the row so far, b the next joint, e its link on the side where the row goes on. Rows "
    "rise or fall by one, with 1 next to the last joint; a falling row begins with the bar, a rising one without:",
    "polar": "In U, V, W the link e is on the side where the row comes from; U and U* do without the angle "
    "of b:",
    "dual": "With the dual angles of a twist and its length a, an angle and its offset S, the index 0 marks dual "
    "parts:",
    "secondary": "Every law above holds with the index 0 on its names and the dual part of its right side; the "
    "fundamental ones are:",
}


def toolkit(n: int) -> str:
    """Return the equations of the closed spherical polygon of n joints.

    Parameters
    ----------
    n : int
        Number of joints, 3 (triangle) to 7 (heptagon).

    Returns
    -------
    str
        The names, the laws and the secondary laws, in plain characters. As formulas they stand on the page of the
        derivation ``spherical_polygons``.

    Raises
    ------
    ValueError
        For another n.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Spherical Mechanism Equation Toolkit"; every law is proved in
    the derivation ``spherical_polygons``, from the list that is printed here.

    Examples
    --------
    >>> from rodgen import spatial
    >>> text = spatial.toolkit(4)
    >>> print(text.splitlines()[0])
    Spherical quadrilateral: 104 equations
    >>> "X_32 = s41 s1" in text, "Z0_41 = -a23 s23" in text
    (True, True)
    """
    if n not in POLYGONS:
        raise ValueError(f"there is a toolkit for 3 to 7 joints, not for {n}")
    parts = [f"Spherical {POLYGONS[n]}: {len(laws(n))} equations", _words("joints"), _table(_NAMES)]
    parts += [_words("step"), _table(_STEP), _words("polar"), _table(_POLAR_STEP)]
    for family in FAMILIES:
        if rows := [[law.text() for law in group] for group in _grouped(n, family)]:
            parts += [_heading(family), _table(rows)]
    parts += ["Secondary laws", _words("dual"), _table(_SECONDARY), _words("secondary")]
    return "\n\n".join([*parts, _table(list(_secondary(n)))]) + "\n"


def _words(key: str) -> str:
    return textwrap.fill(_WORDS[key], 110)


def _table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of formulas in columns."""
    widths = [max(len(row[k]) for row in rows if k < len(row)) for k in range(max(map(len, rows)))]
    return "\n".join(
        "    " + "   ".join(text.ljust(width) for text, width in zip(row, widths, strict=False)).rstrip()
        for row in rows
    )


def _heading(family: str) -> str:
    kinds = "" if family == "half tangent" else " sine, sine-cosine and cosine"
    return f"{family.capitalize()}{kinds} laws"


def _grouped(n: int, family: str) -> Iterator[Sequence[Law | HalfTangent]]:
    """Yield the laws of a family, the three of one row of subscripts together."""
    members = [law for law in laws(n) if law.family == family]
    size = 1 if family == "half tangent" else 3
    for start in range(0, len(members), size):
        yield members[start : start + size]


def _secondary(n: int) -> Iterator[Sequence[str]]:
    """Yield the three secondary laws of each fundamental row, in plain characters."""
    for group in _grouped(n, "fundamental"):
        sine, sine_cosine, cosine = (law for law in group if isinstance(law, Law))
        assert isinstance(sine.right, Monomial)
        (_, (_, i)), (_, (_, j)) = sine.right.factors
        e = f"{i}{i % n + 1}"
        first, second, third = (law.left.text().replace("_", "0_") for law in (sine, sine_cosine, cosine))
        yield (
            f"{first} = a{e} c{e} s{j} + S{j} s{e} c{j}",
            f"{second} = a{e} c{e} c{j} - S{j} s{e} s{j}",
            f"{third} = -a{e} s{e}",
        )
