"""What kind a mechanism is: its mobility, its equivalent spherical mechanism, and its group.

n bodies, one of them fixed, would have 6 (n - 1) freedoms; a joint with f freedoms takes away 6 - f:

    M = 6 (n - 1) - sum of (6 - f_i)

which is the sum of the f_i for an open chain, and 6 less for a single loop. The formula counts freedoms and does not
see the geometry. Where all motions stay within a group of displacements of an order below 6 (planar: 3, spherical: 3),
that order takes the place of 6; the Bennett loop moves against every count; and a body that is held by two ball joints
alone spins idly about the line through them.

Equivalent spherical mechanism: move all axes S_j to one point and keep their directions: angles stay, lengths and
offsets vanish. Joints R, C and H become R; a P, which turns nothing, is locked, and the links on both sides of it
become one. The result is a spherical polygon with as many sides as joints; its mobility is that number less three. The
group of a mechanism is this mobility: the number of its angles that must be given before the others follow from
spherical trigonometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.numerics import principal
from rodgen.kinematics.spatial.arm_plan import plan
from rodgen.kinematics.spatial.forward_analysis import frames, screws
from rodgen.kinematics.spatial.mechanism import Mechanism, merge
from rodgen.polygon_laws import POLYGONS
from rodgen.views import with_html

PARALLEL = 1e-9
"""Sine, or length relative to the largest one, below which axes are parallel and a length is zero: far above what the
rounding of an angle given in degrees makes, far below what a drawing says."""

ORDERS = {
    "translational": "no joint turns: all motions are translations",
    "planar": "all axes are parallel, and all slides perpendicular to them: a planar linkage",
    "schoenflies": "all axes are parallel: links turn about one direction only",
    "coaxial": "all axes are one line",
    "spherical": "all axes meet in one point: a spherical linkage",
}


@with_html
@dataclass(frozen=True)
class Mobility:
    """The freedoms of a mechanism.

    Attributes
    ----------
    value : int
        The mobility: that of the formula, or of the exception where a known one applies.
    formula : int
        What the general formula gives, with 6 (n - 1).
    bodies : int
        How many there are, the fixed one among them.
    freedoms : tuple of int
        Of each joint.
    exception : str
        Why the formula does not hold: ``"planar"``, ``"spherical"``, ``"translational"``, ``"coaxial"``,
        ``"schoenflies"``, ``"bennett"``, or ``""``.
    passive : int
        How many of the freedoms in `value` are idle spins of a body between two ball joints.
    instantaneous : int or None
        Freedoms of first order in the pose that was given: variables less the rank of the joints' screws.
    remarks : tuple of str
        These findings in words.
    """

    value: int
    formula: int
    bodies: int
    freedoms: tuple[int, ...]
    exception: str = ""
    passive: int = 0
    instantaneous: int | None = None
    remarks: tuple[str, ...] = ()


def mobility(mechanism: Mechanism, q: ArrayLike | None = None) -> Mobility:
    """Return the mobility of an open chain or a single closed loop, with known exceptions.

    Parameters
    ----------
    mechanism : Mechanism
        Joints of any kind.
    q : array_like (v), optional
        A pose in which the loop is closed: the variables of the mechanism (of ``mechanism.expanded()``, where there are
        joints E, T or S). With it, the freedoms of first order are counted, too.

    Returns
    -------
    Mobility

    Raises
    ------
    RodgenError
        When `q` has not one number for each variable.

    Notes
    -----
    Crane and Duffy, "Kinematic Analysis of Robot Manipulators", on mobility. Known exceptions: groups of
    displacements of an order below 6 (all axes parallel, concurrent or one line, no rotations), and the Bennett loop.
    Others (Bricard's, Goldberg's, Sarrus' loops) appear only in the count at `q`.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> four_bar = spatial.Mechanism("RRRR", a=[1.0, 3.0, 2.0, 3.0], alpha=np.zeros(4))
    >>> found = spatial.mobility(four_bar)
    >>> found.value, found.formula, found.exception
    (1, -2, 'planar')
    """
    freedoms = mechanism.freedoms
    n = len(freedoms)
    if not mechanism.closed:
        total = sum(freedoms)
        return Mobility(total, total, n + 1, freedoms, remarks=("an open chain: the sum of the freedoms",))
    formula = sum(freedoms) - 6
    full = mechanism.expanded()
    exception, order = _order(full)
    value = formula
    remarks: list[str] = []
    if exception:
        value = sum(freedoms) - order
        remarks.append(f"{ORDERS[exception]}, whose displacements have order {order} instead of 6")
    elif _is_bennett(full):
        exception, value = "bennett", 1
        remarks.append("Bennett's loop: four turning joints that move although the formula gives -2")
    passive = _idle_spins(mechanism)
    if passive:
        remarks.append(f"{passive} of the freedoms {_spins(passive)}")
    instantaneous = None
    if q is not None:
        instantaneous = len(full.variables) - int(np.linalg.matrix_rank(_screws(full, q), tol=PARALLEL))
        if instantaneous != value:
            remarks.append(f"in this pose {instantaneous} freedoms of first order, by the rank of the screws")
    return Mobility(value, formula, n, freedoms, exception, passive, instantaneous, tuple(remarks))


def _spins(count: int) -> str:
    return "is an idle spin between two ball joints" if count == 1 else "are idle spins between ball joints"


def _idle_spins(mechanism: Mechanism) -> int:
    """Return how many links, or slides in line with both centres, are held by two ball joints alone."""
    kinds, n = mechanism.joints, len(mechanism.joints)
    count = 0
    for j in range(n):
        k = (j + 1) % n
        if kinds[j] != "S" or n < 3:
            continue
        in_line = abs(mechanism.a[j]) <= PARALLEL * _size(mechanism)
        if kinds[k] == "S":
            count += 1
        elif kinds[k] in "PC" and kinds[(k + 1) % n] == "S" and k != j and (k + 1) % n != j:
            # both bodies spin with the slide where its axis goes through both centres
            count += bool(in_line and abs(mechanism.a[k]) <= PARALLEL * _size(mechanism))
    return count


def _size(mechanism: Mechanism) -> float:
    lengths = np.concatenate([np.abs(x) for x in (mechanism.a, mechanism.offset, mechanism.pitch)])
    return float(np.nanmax(lengths, initial=0.0)) or 1.0


def _order(mechanism: Mechanism) -> tuple[str, int]:
    """Return the group in which all motions of a loop stay, and its order; "" and 6 for the general one."""
    kinds = mechanism.joints
    small = PARALLEL * _size(mechanism)
    links = merge(mechanism, {}).links
    slides = np.array([d for link in links for _, d in link.slides])
    if set(kinds) == {"P"}:
        return "translational", int(np.linalg.matrix_rank(slides, tol=PARALLEL))
    if set(kinds) == {"R"} and max(np.abs(mechanism.a).max(), np.abs(mechanism.offset).max()) <= small:
        parallel = np.abs(np.sin(mechanism.alpha)).max() <= PARALLEL
        return ("coaxial", 1) if parallel else ("spherical", 3)
    if any(np.hypot(link.R[0, 2], link.R[1, 2]) > PARALLEL for link in links):
        return "", 6
    one_line = all(np.hypot(link.v[0], link.v[1]) <= small for link in links)
    along = any(kind in "CH" for kind in kinds) or any(abs(d[2]) > PARALLEL for d in slides)
    across = any(np.hypot(d[0], d[1]) > PARALLEL for d in slides)
    if one_line and not across:
        return "coaxial", 1 + along
    return ("schoenflies", 4) if along else ("planar", 3)


def _is_bennett(mechanism: Mechanism) -> bool:
    """Return whether a loop RRRR has equal opposite links, no offsets, and a / sin(alpha) of one size all round."""
    if "".join(mechanism.joints) != "RRRR":
        return False
    a, alpha = np.array(mechanism.a), np.array(mechanism.alpha)
    # a link is the same one with its length and its twist both reversed
    flip = np.where(a < 0, -1.0, 1.0)
    a, alpha = a * flip, alpha * flip
    small = PARALLEL * _size(mechanism)
    if np.abs(mechanism.offset).max() > small or np.abs(a[:2] - a[2:]).max() > small or min(a) <= small:
        return False
    turned = np.exp(1j * alpha)
    if np.abs(turned[:2] - turned[2:]).max() > PARALLEL:
        return False
    first, second = a[0] * np.sin(alpha[1]), a[1] * np.sin(alpha[0])
    return bool(abs(abs(first) - abs(second)) <= small and abs(first) > small)


def _screws(mechanism: Mechanism, q: ArrayLike) -> Any:
    """Return the screws of the variables in the fixed frame, (v, 6); lengths in units of the largest one."""
    count = len(mechanism.variables)
    values = np.asarray(q, float)
    if values.shape != (count,):
        raise RodgenError(f"q has the shape {values.shape}; expected one number for each of {count}")
    return screws(mechanism, frames(mechanism, values)) / np.array([1.0] * 3 + [_size(mechanism)] * 3)


@with_html
@dataclass(frozen=True)
class SphericalEquivalent:
    """A spherical mechanism with the angles of a spatial one.

    Attributes
    ----------
    mechanism : Mechanism
        Its joints are all R, its lengths and offsets zero.
    joints : tuple of int
        For each of its joints, which one of the spatial mechanism (with E, T and S expanded) it is.
    shift : array
        What is added to the angle of that joint to get the angle of the spherical one: not zero where a P was locked.
    """

    mechanism: Mechanism
    joints: tuple[int, ...]
    shift: NDArray[np.float64]

    @property
    def mobility(self) -> int:
        """Freedoms: of a closed polygon three less than it has joints."""
        return len(self.joints) - (3 if self.mechanism.closed else 0)

    @property
    def polygon(self) -> str:
        """Its name: triangle to heptagon, or n-gon; ``"open"`` for an open chain."""
        if not self.mechanism.closed:
            return "open"
        return POLYGONS.get(len(self.joints), f"{len(self.joints)}-gon")


def equivalent_spherical(mechanism: Mechanism) -> SphericalEquivalent:
    """Move all axes to one point.

    Parameters
    ----------
    mechanism : Mechanism
        With joints of any kind: T becomes two R, S three, and E one.

    Returns
    -------
    SphericalEquivalent

    Raises
    ------
    RodgenError
        When no joint turns.

    Notes
    -----
    Crane and Duffy, "Kinematic Analysis of Robot Manipulators", on equivalent spherical mechanisms. A locked P of angle
    theta between twists alpha and beta makes one link, whose rotation is written as
    Rz(u) Rx(twist) Rz(w) with a twist of 0 to pi: u is added to the angle before, and w to the angle after it.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> loop = spatial.Mechanism("RCPCR", a=np.ones(5), alpha=np.radians([40, 90, 30, 70, 60]))
    >>> found = spatial.equivalent_spherical(loop)
    >>> found.joints, found.polygon, found.mobility, np.degrees(found.mechanism.alpha).round(9) + 0.0
    ((0, 1, 3, 4), 'quadrilateral', 1, array([ 40., 120.,  70.,  60.]))
    """
    full = mechanism.expanded()
    if set(full.joints) == {"P"}:
        raise RodgenError("no joint of the mechanism turns; expected one with an angle")
    merged = merge(full, {})
    turning, m = merged.joints, len(merged.joints)
    shift = np.zeros(m)
    twists = []
    for i, link in enumerate(merged.links if full.closed else merged.links[:-1]):
        if (turning[i] + 1) % len(full.joints) == turning[
            (i + 1) % m
        ]:  # as given, also negative or beyond pi
            twists.append(float(full.alpha[turning[i]]))
            continue
        R = link.R
        sine = float(np.hypot(R[0, 2], R[1, 2]))
        twists.append(float(np.arctan2(sine, R[2, 2])))
        if sine > 8 * np.finfo(float).eps:
            shift[i] += np.arctan2(R[0, 2], -R[1, 2])
            shift[(i + 1) % m] += np.arctan2(R[2, 0], R[2, 1])
        else:  # parallel axes: only the whole turn between them is determined
            shift[i] += np.arctan2(R[1, 0], R[0, 0])
    names = tuple(full.names[j] for j in turning)
    spherical = Mechanism(
        "R" * m, np.zeros(len(twists)), twists, unit=full.unit, name=mechanism.name, names=names
    )
    return SphericalEquivalent(spherical, turning, principal(shift))


MOST_SOLUTIONS = {1: 2, 2: 8, 3: 16, 4: 16}
METHODS = {
    1: "one equation A cos + B sin + D = 0, all other unknowns linear",
    2: "two equations, bilinear in cosine and sine of two angles, all other unknowns linear",
    3: "an eigenvalue problem of degree 16, which is not solved here",
    4: "a polynomial of degree 16, or a closed form where the geometry is special",
}


@with_html
@dataclass(frozen=True)
class Group:
    """The group of a mechanism.

    Attributes
    ----------
    number : int
        Mobility of the equivalent spherical mechanism; of a robot, that of the loop with its hypothetical link. Groups
        are counted from 1 to 4; a polygon with another mobility belongs to none.
    polygon : str
        The spherical polygon; empty where too few joints turn for one.
    most_solutions : int or None
        How many solutions the reverse analysis of a loop with mobility 1, or of a robot with 6 freedoms, can have.
        Where axes of a robot meet or are parallel, fewer than the group's; None for other mechanisms.
    method : str
        How it is done, or why a group's method does not apply.
    """

    number: int
    polygon: str
    most_solutions: int | None
    method: str


def group(mechanism: Mechanism) -> Group:
    """Return the group of a closed loop, or of the loop that closes a robot.

    Parameters
    ----------
    mechanism : Mechanism
        A loop; or an open chain, which is closed by a hypothetical link and a turning joint whose angle is known.

    Returns
    -------
    Group

    Notes
    -----
    Crane and Duffy, "Kinematic Analysis of Robot Manipulators", on groups. A group g with 4 - g slides is solved in
    g angles together; special geometry lowers the number of solutions.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.group(spatial.PUMA_560).number
    4
    >>> spatial.group(spatial.PUMA_560).most_solutions  # 16 for the group
    8
    >>> loop = spatial.Mechanism("RRRCC", a=[1.0] * 5, alpha=[1.0] * 5)
    >>> spatial.group(loop).polygon, spatial.group(loop).most_solutions
    ('pentagon', 8)
    """
    turning = sum(kind != "P" for kind in mechanism.expanded().joints) + (not mechanism.closed)
    number = turning - 3
    wanted = 7 if mechanism.closed else 6
    counted = sum(mechanism.freedoms) == wanted and number in METHODS
    most, method = (MOST_SOLUTIONS[number], METHODS[number]) if counted else (None, _no_method(mechanism))
    if mechanism.joints == ("R",) * 6 and not mechanism.closed:
        chosen = plan(mechanism)
        most, method = chosen.slots, chosen.method
    polygon = POLYGONS.get(turning, f"{turning}-gon") if turning > 2 else ""
    return Group(number, polygon, most, method)


def _no_method(mechanism: Mechanism) -> str:
    """Return why the solution process of a group does not apply."""
    freedom = mobility(mechanism)
    if not mechanism.closed:
        return f"no group's method applies: {freedom.value} freedoms instead of the 6 of a robot"
    if freedom.exception:
        return f"no group's method applies: the loop moves by its special geometry ({freedom.exception})"
    if freedom.passive:
        return f"no group's method applies: of {freedom.value} freedoms {freedom.passive} are idle spins"
    return f"no group's method applies: mobility {freedom.value} instead of 1"
