"""The equivalent spherical mechanism of a spatial one, its group, and how many solutions its reverse analysis has.

Move all axes S_j, with their directions kept, to one point: angles stay, lengths and offsets vanish. Joints R, C and H
become R; a P, which turns nothing, is locked, and the links on both sides of it become one. What is left is a spherical
polygon with as many sides as joints, and its mobility, that number less three, is the mechanism's group: the number of
its angles that must be given before the others follow from spherical trigonometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.spatial._angles import nearest_turn
from rodgen.kinematics.spatial._loops_links import rx, rz
from rodgen.kinematics.spatial._mechanism import Mechanism
from rodgen.kinematics.spatial._mobility import mobility

__all__ = ["Group", "SphericalEquivalent", "equivalent_spherical", "group"]

POLYGONS = {
    3: "triangle",
    4: "quadrilateral",
    5: "pentagon",
    6: "hexagon",
    7: "heptagon",
}
MOST_SOLUTIONS = {1: 2, 2: 8, 3: 16, 4: 16}
METHODS = {
    1: "one equation A cos + B sin + D = 0, all other unknowns linear",
    2: "two equations, bilinear in cosine and sine of two angles, all other unknowns linear",
    3: "an eigenvalue problem of degree 16, which is not solved here",
    4: "a polynomial of degree 16, or a closed form where the geometry is special",
}


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


@dataclass(frozen=True)
class Group:
    """To which group a mechanism belongs.

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
    kinds, n = full.joints, len(full.joints)
    turning = [j for j in range(n) if kinds[j] != "P"]
    if not turning:
        raise RodgenError("no joint of the mechanism turns; expected one with an angle")
    m = len(turning)
    shift = np.zeros(m)
    twists = []
    for i, j in enumerate(turning if full.closed else turning[:-1]):
        following, k = turning[(i + 1) % m], j
        if (j + 1) % n == following:  # kept as it was given, a negative twist or one beyond pi, too
            twists.append(float(full.alpha[j]))
            continue
        R = np.eye(3)
        while True:
            R = R @ rx(full.alpha[k])
            k = (k + 1) % n
            if k == following:
                break
            R = R @ rz(full.angle[k])
        sine = float(np.hypot(R[0, 2], R[1, 2]))
        twists.append(float(np.arctan2(sine, R[2, 2])))
        if sine > 8 * np.finfo(float).eps:
            shift[i] += np.arctan2(R[0, 2], -R[1, 2])
            shift[(i + 1) % m] += np.arctan2(R[2, 0], R[2, 1])
        else:  # parallel axes: only the whole turn between them is determined
            shift[i] += np.arctan2(R[1, 0], R[0, 0])
    names = tuple(full.names[j] for j in turning)
    found = Mechanism(
        "R" * m, np.zeros(len(twists)), twists, unit=full.unit, name=mechanism.name, names=names
    )
    return SphericalEquivalent(found, tuple(turning), nearest_turn(shift))


def group(mechanism: Mechanism) -> Group:
    """Tell the group of a closed loop, or of the loop that closes a robot.

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
        from rodgen.kinematics.spatial._reverse import reverse_method
        from rodgen.kinematics.spatial._reverse_plan import plan

        most, method = plan(mechanism).slots, reverse_method(mechanism)
    polygon = POLYGONS.get(turning, f"{turning}-gon") if turning > 2 else ""
    return Group(number, polygon, most, method)


def _no_method(mechanism: Mechanism) -> str:
    """Say why the solution process of a group does not apply."""
    found = mobility(mechanism)
    if not mechanism.closed:
        return f"no group's method applies: {found.value} freedoms instead of the 6 of a robot"
    if found.exception:
        return f"no group's method applies: the loop moves by its special geometry ({found.exception})"
    if found.passive:
        return f"no group's method applies: of {found.value} freedoms {found.passive} are idle spins"
    return f"no group's method applies: mobility {found.value} instead of 1"
