"""Mobility and its exceptions, groups, the equivalent spherical mechanism, the picture, and the derivation of loops."""

import numeric_reverse
import numpy as np
import pytest
from kinematics_cases import rotations
from lazy import LazyDerivation
from numeric_reverse import search

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import (
    Mechanism,
    equivalent_spherical,
    group,
    mobility,
)
from rodgen.output.figures import planar_representation

pytestmark = pytest.mark.xdist_group("spatial_loops")
spatial_loops = LazyDerivation("spatial_loops")


def degrees(*values):
    return np.radians(values)


RATIO = np.sin(degrees(50.0)) / np.sin(degrees(30.0))
LOOPS = {
    "four-bar": (Mechanism("RRRR", [1, 3, 2, 3.5], np.zeros(4)), 1, -2, "planar"),
    "slider-crank": (Mechanism("RRRP", [1, 3, 0, 0], degrees(0, 0, 90, 90)), 1, -2, "planar"),
    "reversed links": (Mechanism("RRRR", [1, 3, 2, 3.5], degrees(180, 0, 180, 0)), 1, -2, "planar"),
    "spherical": (Mechanism("RRRR", np.zeros(4), degrees(40, 70, 85, 70)), 1, -2, "spherical"),
    "Bennett": (Mechanism("RRRR", [1, RATIO[0], 1, RATIO[0]], degrees(30, 50, 30, 50)), 1, -2, "bennett"),
    "Bennett, turned over": (
        Mechanism("RRRR", [-1, RATIO[0], 1, RATIO[0]], degrees(-30, 50, 30, 50)),
        1,
        -2,
        "bennett",
    ),
    "no Bennett": (Mechanism("RRRR", [1, 2, 1, 2], degrees(30, 50, 30, 50)), -2, -2, ""),
    "wedges": (Mechanism("PPP", np.zeros(3), degrees(120, 120, 120)), 1, -3, "translational"),
    "six slides": (
        Mechanism("P" * 6, np.zeros(6), np.full(6, np.pi / 2), angle=np.full(6, np.pi / 2)),
        3,
        0,
        "translational",
    ),
    "slide along the axes": (Mechanism("RRRC", [1, 3, 2, 3], np.zeros(4)), 1, -1, "schoenflies"),
    "screws on one line": (
        Mechanism("RHP", np.zeros(3), np.zeros(3), pitch=[0, 2, 0]),
        1,
        -3,
        "coaxial",
    ),
    "RCCC": (Mechanism("RCCC", [1, 2, 3, 4], degrees(40, 70, 85, 70)), 1, 1, ""),
    "7R": (Mechanism("R" * 7, np.ones(7), np.ones(7)), 1, 1, ""),
    "RSSR": (Mechanism("RSSR", [1, 2, 3, 4], degrees(30, 50, 30, 50)), 2, 2, ""),
    "RTSR": (Mechanism("RTSR", [1, 2, 3, 4], degrees(30, 50, 30, 50)), 1, 1, ""),
    "REEP": (Mechanism("REEP", [1, 2, 3, 4], degrees(30, 50, 30, 50)), 2, 2, ""),
}


@pytest.mark.parametrize("name", LOOPS)
def test_mobility_of_loops(name):
    loop, value, formula, exception = LOOPS[name]
    found = mobility(loop)
    assert (found.value, found.formula, found.exception) == (value, formula, exception)
    assert found.bodies == len(loop.joints)
    assert bool(found.remarks) == bool(exception or found.passive)


@pytest.mark.parametrize(
    "name", [n for n, loop in LOOPS.items() if not set(loop[0].joints) & set("STE") and n != "no Bennett"]
)
def test_mobility_is_the_rank_of_the_screws_where_the_loop_closes(name):
    """At a pose found by Newton's method the first-order freedoms are those of the formula or its exception."""
    loop, value, _, _ = LOOPS[name]
    kinds = loop.variables
    for angle in (0.5, 1.2, -0.8, 2.0):
        given = {0: angle} if kinds[0][1] == "theta" else {}
        poses = search(loop, np.eye(4), starts=60, given=given, seed=3)[0].solutions
        # a pose that is no special one
        poses = [
            q for q in poses if np.abs(np.sin(q[[w == "theta" for _, w in kinds]])).min(initial=1) > 0.05
        ]
        if poses:
            break
    assert poses
    assert mobility(loop, poses[0]).instantaneous == value


def test_a_singular_pose_has_more_freedoms_of_first_order():
    """A parallelogram that lies flat."""
    loop = Mechanism("RRRR", [1, 2, 1, 2], np.zeros(4))
    flat = [0.0, np.pi, 0.0, np.pi]
    assert np.abs(numeric_reverse.forward(loop, flat) - np.eye(4)).max() < 1e-15
    found = mobility(loop, flat)
    assert (found.value, found.instantaneous) == (1, 2)
    assert "2 freedoms of first order" in found.remarks[-1]


def test_idle_spins():
    assert mobility(LOOPS["RSSR"][0]).passive == 1
    assert mobility(Mechanism("RRSS", [1, 2, 3, 4], degrees(30, 50, 30, 50))).passive == 1
    assert mobility(Mechanism("SRRS", [1, 2, 3, 4], degrees(30, 50, 30, 50))).passive == 1
    assert mobility(Mechanism("SPSR", [0, 0, 1, 1], degrees(0, 0, 30, 20))).passive == 1
    assert mobility(Mechanism("SPSR", [0, 1, 1, 1], degrees(0, 0, 30, 20))).passive == 0


def test_open_chains_have_the_sum_of_the_freedoms():
    found = mobility(spatial.PUMA_560)
    assert (found.value, found.bodies, found.freedoms) == (6, 7, (1,) * 6)
    assert mobility(Mechanism("CSE", [1, 1], [0, 0])).value == 8


def test_a_wrong_number_of_variables_is_an_error(refuses):
    refuses(mobility, LOOPS["four-bar"][0], [0.0, 1.0])


@pytest.mark.parametrize("kinds", ["RCPCR", "PRRPRPR", "RPPRCR", "PCCRR"])
def test_the_equivalent_spherical_mechanism_turns_as_the_spatial_one(kinds):
    """Rotations all round a loop, at any angles: the same up to the joint from which they are counted."""
    rng = np.random.default_rng(len(kinds))
    n = len(kinds)
    angle = np.where([k == "P" for k in kinds], rng.uniform(-3, 3, n), np.nan)
    loop = Mechanism(kinds, rng.normal(size=n), rng.uniform(-3, 3, n), angle=angle)
    found = equivalent_spherical(loop)
    assert set(found.mechanism.joints) == {"R"}
    assert not found.mechanism.a.any()
    turns = np.where([k == "P" for k in kinds], angle, rng.uniform(-3, 3, n))
    first = found.joints[0]
    spatial_turn = np.eye(3)
    for k in range(n):
        j = (first + k) % n
        spatial_turn = spatial_turn @ rotations(turns[j], 2) @ rotations(loop.alpha[j], 0)
    q = turns[list(found.joints)] + found.shift
    spherical = numeric_reverse.forward(found.mechanism, q)[:3, :3]
    # it starts at the first joint, in the middle of a link: the same turn, seen from another frame
    assert np.isclose(np.trace(spherical), np.trace(spatial_turn), rtol=0, atol=1e-13)
    axis, same = (
        np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) for R in (spherical, spatial_turn)
    )
    assert np.isclose(axis[2], same[2], rtol=0, atol=1e-13)


def test_no_turning_joint_has_no_spherical_equivalent(refuses):
    refuses(equivalent_spherical, LOOPS["wedges"][0])


@pytest.mark.parametrize(
    ("kinds", "number", "polygon", "most"),
    [
        ("CCCR", 1, "quadrilateral", 2),
        ("RRPCC", 1, "quadrilateral", 2),
        ("RPRPRPR", 1, "quadrilateral", 2),
        ("RRRCC", 2, "pentagon", 8),
        ("RRRRPC", 2, "pentagon", 8),
        ("RRRRRC", 3, "hexagon", 16),
        ("RRRRRRP", 3, "hexagon", 16),
        ("RRRRRRR", 4, "heptagon", 16),
        ("RSSR", 5, "8-gon", None),
        ("RRR", 0, "triangle", None),
        ("PPR", -2, "", None),
    ],
)
def test_groups_of_loops(kinds, number, polygon, most):
    n = len(kinds)
    found = group(Mechanism(kinds, np.ones(n), np.ones(n)))
    assert (found.number, found.polygon, found.most_solutions) == (number, polygon, most)
    assert found.method.startswith("no group's method") == (most is None)


@pytest.mark.parametrize(
    ("name", "why"),
    [("four-bar", "(planar)"), ("RSSR", "of 2 freedoms 1 are idle spins"), ("no Bennett", "-2")],
)
def test_why_no_group_applies(name, why):
    assert why in group(LOOPS[name][0]).method


def test_groups_of_robots():
    assert group(spatial.PUMA_560).number == 4
    assert group(spatial.PUMA_560).most_solutions == 8
    general = Mechanism("RRRRRR", np.ones(5), np.ones(5))
    assert (group(general).polygon, group(general).most_solutions) == ("heptagon", 16)
    assert group(Mechanism("RRRPPP", np.ones(5), np.ones(5))).number == 1
    assert group(Mechanism("RRRRPP", np.ones(5), np.ones(5))).most_solutions == 8


@pytest.mark.thorough("mechanism2", "mechanism5", "mechanism7")
@pytest.mark.parametrize("mechanism", [loop[0] for loop in LOOPS.values()] + [spatial.T3_776])
def test_the_picture_has_every_joint_and_link(mechanism):
    figure = planar_representation(mechanism, input=0, output=mechanism.names[-1])
    joints = figure.data[-1]
    assert list(joints.text) == list(mechanism.joints)
    words = [note.text for note in figure.layout.annotations]
    assert sum(text.endswith(", input") for text in words) == 1
    assert sum(text.endswith(", output") for text in words) == 1
    assert sum("°" in text for text in words) == len(mechanism.a)
    for values, axis in ((joints.x, figure.layout.xaxis), (joints.y, figure.layout.yaxis)):
        for value in values:
            assert axis.range[0] + 15 < value < axis.range[1] - 15


def test_names_are_escaped_in_the_picture():
    mechanism = Mechanism("RR", [1.0], [0.0], name="a < b & c", names=["<1>", '"2"'])
    figure = planar_representation(mechanism)
    assert figure.layout.title.text == "a &lt; b &amp; c"
    assert "&lt;1&gt;" in [note.text for note in figure.layout.annotations]


def test_the_derivation_of_loops_is_closed():
    """Every entry is proved, or refuted with an exact counterexample; the figure of the facts sheet is reported."""
    derivation = spatial_loops.derivation
    assert derivation.open == []
    verdicts = [entry.verdict for entry in derivation]
    assert verdicts.count("refuted") == 2
    assert verdicts.count("proved") >= 18
    assert [entry.refutation.label for entry in derivation if entry.refutation] == ["M1", "M2"]
