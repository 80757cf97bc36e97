"""The equivalent spherical mechanism of a spatial one.

Move all axes S_j to one point and keep their directions: angles stay, lengths and offsets vanish. Joints R, C and H
become R; a P, which turns nothing, is locked, and the links on both sides of it become one. The result is a spherical
polygon with as many sides as joints; its mobility is that number less three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.angles import principal
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.links.merged import merge
from rodgen.polygon_laws import POLYGONS
from rodgen.views import html_of


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

    _repr_html_ = html_of

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
    found = Mechanism(
        "R" * m, np.zeros(len(twists)), twists, unit=full.unit, name=mechanism.name, names=names
    )
    return SphericalEquivalent(found, turning, principal(shift))
