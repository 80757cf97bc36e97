"""The group of a mechanism, and how many solutions its reverse analysis has.

The group is the mobility of the equivalent spherical mechanism: the number of its angles that must be given before the
others follow from spherical trigonometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from rodgen.kinematics.spatial.arms.plan import plan
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.links.mobility import mobility
from rodgen.polygon_laws import POLYGONS
from rodgen.views import html_of

MOST_SOLUTIONS = {1: 2, 2: 8, 3: 16, 4: 16}
METHODS = {
    1: "one equation A cos + B sin + D = 0, all other unknowns linear",
    2: "two equations, bilinear in cosine and sine of two angles, all other unknowns linear",
    3: "an eigenvalue problem of degree 16, which is not solved here",
    4: "a polynomial of degree 16, or a closed form where the geometry is special",
}


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

    _repr_html_ = html_of


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
    found = mobility(mechanism)
    if not mechanism.closed:
        return f"no group's method applies: {found.value} freedoms instead of the 6 of a robot"
    if found.exception:
        return f"no group's method applies: the loop moves by its special geometry ({found.exception})"
    if found.passive:
        return f"no group's method applies: of {found.value} freedoms {found.passive} are idle spins"
    return f"no group's method applies: mobility {found.value} instead of 1"
