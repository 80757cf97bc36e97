"""Spatial mechanisms after Crane and Duffy: links, loops, robots, and their forward and reverse analysis.

A :class:`Mechanism` is a row of joints with the links between them: an open chain or a closed loop. Functions take
arrays of any shape, with the components along the last axes; lengths are in one unit, angles in rad.

>>> from rodgen import spatial
>>> spatial.PUMA_560.closed, len(spatial.PUMA_560.variables)
(False, 6)
"""

from rodgen.generated.numpy.spatial_links import HypotheticalStatus
from rodgen.generated.numpy.spherical_polygons import PolygonStatus
from rodgen.generated.numpy.trig_equation import TrigStatus
from rodgen.kinematics.spatial.classification import (
    Group,
    Mobility,
    SphericalEquivalent,
    equivalent_spherical,
    group,
    mobility,
)
from rodgen.kinematics.spatial.forward_analysis import (
    HypotheticalLink,
    close_loop,
    forward,
    frames,
    jacobian,
    link_transform,
)
from rodgen.kinematics.spatial.link_files import load_mechanism
from rodgen.kinematics.spatial.loop_reverse import reverse_loop
from rodgen.kinematics.spatial.mechanism import FREEDOMS, GE_P60, PUMA_560, T3_776, Mechanism
from rodgen.kinematics.spatial.pair_equations import (
    Pair,
    pair_from_biquadratics,
    solve_pair,
    solve_trig,
)
from rodgen.kinematics.spatial.placement import Placement, reverse
from rodgen.kinematics.spatial.product_of_exponentials import (
    ProductOfExponentials,
    from_product_of_exponentials,
    to_product_of_exponentials,
)
from rodgen.kinematics.spatial.spherical_polygons import (
    notation,
    secondary_notation,
    spherical_pentagon,
    spherical_quadrilateral,
    toolkit,
)
from rodgen.kinematics.spatial.status import Reverse, ReverseStatus
from rodgen.kinematics.spatial.transforms import inverse_transform, transform

__all__ = [
    "FREEDOMS",
    "GE_P60",
    "PUMA_560",
    "T3_776",
    "Group",
    "HypotheticalLink",
    "HypotheticalStatus",
    "Mechanism",
    "Mobility",
    "Pair",
    "Placement",
    "PolygonStatus",
    "ProductOfExponentials",
    "Reverse",
    "ReverseStatus",
    "SphericalEquivalent",
    "TrigStatus",
    "close_loop",
    "equivalent_spherical",
    "forward",
    "frames",
    "from_product_of_exponentials",
    "group",
    "inverse_transform",
    "jacobian",
    "link_transform",
    "load_mechanism",
    "mobility",
    "notation",
    "pair_from_biquadratics",
    "reverse",
    "reverse_loop",
    "secondary_notation",
    "solve_pair",
    "solve_trig",
    "spherical_pentagon",
    "spherical_quadrilateral",
    "to_product_of_exponentials",
    "toolkit",
    "transform",
]
