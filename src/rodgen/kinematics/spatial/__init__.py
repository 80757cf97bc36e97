"""Spatial mechanisms after Crane and Duffy: links, loops, robots, and their forward and reverse analysis.

A :class:`Mechanism` is a row of joints with the links between them: an open chain or a closed loop. Functions take
arrays of any shape, with the components along the last axes; lengths are in one unit, angles in rad.

>>> from rodgen import spatial
>>> spatial.PUMA_560.closed, len(spatial.PUMA_560.variables)
(False, 6)
"""

from rodgen.kinematics.spatial.links.forward import forward, frames, jacobian, link_transform
from rodgen.kinematics.spatial.links.hypothetical import HypotheticalLink, HypotheticalStatus, close_loop
from rodgen.kinematics.spatial.links.link_table import link_table, load_mechanism, save_mechanism
from rodgen.kinematics.spatial.links.mechanism import FREEDOMS, GE_P60, PUMA_560, T3_776, Mechanism
from rodgen.kinematics.spatial.links.mobility import Mobility, mobility, mobility_of
from rodgen.kinematics.spatial.links.transforms import (
    VectorAngle,
    inverse_transform,
    transform,
    vector_and_angle,
)
from rodgen.kinematics.spatial.loops.reverse import reverse_loop, reverse_sliding
from rodgen.kinematics.spatial.pairs.solve import Pair, pair_from_biquadratics, solve_pair
from rodgen.kinematics.spatial.pairs.trig import TrigStatus, solve_trig
from rodgen.kinematics.spatial.polygons.equivalent import SphericalEquivalent, equivalent_spherical
from rodgen.kinematics.spatial.polygons.linkages import (
    PolygonStatus,
    spherical_pentagon,
    spherical_quadrilateral,
)
from rodgen.kinematics.spatial.polygons.notation import direction_cosines, notation, secondary_notation
from rodgen.kinematics.spatial.polygons.toolkit import toolkit
from rodgen.kinematics.spatial.robots.denavit_hartenberg import (
    DenavitHartenberg,
    from_denavit_hartenberg,
    from_modified_denavit_hartenberg,
    to_denavit_hartenberg,
    to_modified_denavit_hartenberg,
)
from rodgen.kinematics.spatial.robots.group import Group, group
from rodgen.kinematics.spatial.robots.placement import Placement
from rodgen.kinematics.spatial.robots.product_of_exponentials import (
    ProductOfExponentials,
    from_product_of_exponentials,
    to_product_of_exponentials,
)
from rodgen.kinematics.spatial.robots.reverse import reverse, reverse_method
from rodgen.kinematics.spatial.status import PairStatus, Reverse, ReverseStatus

__all__ = [
    "FREEDOMS",
    "GE_P60",
    "PUMA_560",
    "T3_776",
    "DenavitHartenberg",
    "Group",
    "HypotheticalLink",
    "HypotheticalStatus",
    "Mechanism",
    "Mobility",
    "Pair",
    "PairStatus",
    "Placement",
    "PolygonStatus",
    "ProductOfExponentials",
    "Reverse",
    "ReverseStatus",
    "SphericalEquivalent",
    "TrigStatus",
    "VectorAngle",
    "close_loop",
    "direction_cosines",
    "equivalent_spherical",
    "forward",
    "frames",
    "from_denavit_hartenberg",
    "from_modified_denavit_hartenberg",
    "from_product_of_exponentials",
    "group",
    "inverse_transform",
    "jacobian",
    "link_table",
    "link_transform",
    "load_mechanism",
    "mobility",
    "mobility_of",
    "notation",
    "pair_from_biquadratics",
    "reverse",
    "reverse_loop",
    "reverse_method",
    "reverse_sliding",
    "save_mechanism",
    "secondary_notation",
    "solve_pair",
    "solve_trig",
    "spherical_pentagon",
    "spherical_quadrilateral",
    "to_denavit_hartenberg",
    "to_modified_denavit_hartenberg",
    "to_product_of_exponentials",
    "toolkit",
    "transform",
    "vector_and_angle",
]
