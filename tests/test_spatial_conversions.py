"""Mechanisms from and to other conventions: products of exponentials and machines.

Each convention is evaluated here as its books write it, with plain matrices and `scipy.linalg.expm`; machines by the
kernels of their own models. Lengths are about 1, so that a pose is right to some 1e-14; a link between axes that are
nearly parallel has its feet at a distance of about 1 over the sine, which is allowed for where it occurs.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from rodgen import Machine, Measurements, simulate
from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import Mechanism, Placement, product_of_exponentials
from rodgen.machines.machine import Joint, Measured, Target
from rodgen.machines.mechanism import from_mechanism, to_mechanism


def random_frame(rng):
    return spatial.transform(
        Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), rng.normal(size=3)
    )


def twisted(xi):
    found = np.zeros((4, 4))
    (found[2, 1], found[0, 2], found[1, 0]), found[:3, 3] = xi[:3], xi[3:]
    found[:3, :3] -= found[:3, :3].T
    return found


def product(screws, home, q):
    """exp(q1 [xi1]) ... exp(qn [xin]) M."""
    found = np.eye(4)
    for xi, value in zip(screws, q, strict=True):
        found = found @ expm(value * twisted(np.asarray(xi, float)))
    return found @ home


def random_screws(rng, count):
    """Axes of every kind of neighbours: skew, parallel, opposite, meeting, coincident, and sliding."""
    screws, direction, point = [], None, None
    for _ in range(count):
        relation = (
            rng.choice(["skew", "parallel", "opposite", "meet", "same", "right angle"]) if screws else "skew"
        )
        turned = Rotation.random(random_state=int(rng.integers(2**31))).apply([0, 0, 1])
        place = rng.normal(size=3)
        if relation in ("parallel", "opposite", "same"):
            turned = direction * (-1 if relation == "opposite" else rng.choice([-1, 1]))
        if relation == "right angle":
            turned = np.cross(direction, turned) / np.linalg.norm(np.cross(direction, turned))
        if relation in ("meet", "same", "right angle"):
            place = point + rng.normal() * direction
        direction, point = turned, place
        kind = rng.choice(["R", "P", "H"], p=[0.7, 0.2, 0.1])
        moment = np.cross(point, direction) + (0.4 * direction if kind == "H" else 0)
        screws.append(np.concatenate([direction, moment] if kind != "P" else [np.zeros(3), direction]))
    return np.array(screws)


# products of exponentials --------------------------------------------------------------------------------------------


def test_random_products_of_exponentials_have_the_same_poses_as_their_links():
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(50):
        screws, home = random_screws(rng, int(rng.integers(1, 8))), random_frame(rng)
        robot = spatial.from_product_of_exponentials(screws, home)
        q = rng.uniform(-3, 3, size=len(screws))
        # the feet may be as far away as the least sine between two neighbours is small
        sines = [np.linalg.norm(np.cross(u[:3], w[:3])) for u, w in pairwise(screws)]
        reach = 1 / min([s for s in sines if s > 1e-8], default=1.0)
        off = np.abs(robot.forward(q) - product(screws, home, q)).max()
        worst = max(worst, off / reach)
        again = spatial.to_product_of_exponentials(robot)
        np.testing.assert_allclose(again.screws, screws, atol=1e-13 * reach)
        np.testing.assert_allclose(again.home, home, atol=1e-13)
    assert worst <= 2e-13


@pytest.mark.parametrize(
    ("other", "a", "alpha", "offset"),
    [
        ([0, 0, 1, 0, -2, 0], 2.0, 0.0, 0.0),  # parallel
        ([0, 0, -1, 0, 2, 0], 2.0, np.pi, 0.0),  # opposite
        ([0, 0, 1, 0, 0, 0], 0.0, 0.0, 0.0),  # one line
        ([1, 0, 0, 0, 5, 0], 0.0, np.pi / 2, 5.0),  # meet at z = 5
        (
            [1, 0, 0, 0, 5, 3],
            3.0,
            -np.pi / 2,
            5.0,
        ),  # skew, 3 apart in y: from z to x about y, whose sense a has
    ],
    ids=["parallel", "opposite", "coincident", "meeting", "skew"],
)
def test_relations_of_two_axes_are_told_apart(other, a, alpha, offset):
    """By hand: the first axis is z; the base frame gives the height of the link on it."""
    robot = spatial.from_product_of_exponentials([[0, 0, 1, 0, 0, 0], other])
    mechanism = robot.mechanism
    assert mechanism.a[0] == pytest.approx(a, abs=1e-15)
    assert abs(mechanism.alpha[0]) == pytest.approx(abs(alpha), abs=1e-15)
    assert robot.base[2, 3] == pytest.approx(offset)
    if a == 0:
        assert mechanism.a[0] == 0


def test_axes_that_meet_somewhere_have_no_length_and_axes_a_little_apart_have_theirs():
    """Rounding does not part two axes through one point, and a distance of 1e-12 of the size is one."""
    for turned in Rotation.random(40, random_state=6):
        first, second, third = turned.as_matrix().T
        slanted = 0.8 * first + 0.6 * second
        place = 3 * first - second + 5 * third
        for gap in (0.0, 1e-9, 1e-12 * 6):
            screws = [[*first, *np.cross(place, first)], [*slanted, *np.cross(place + gap * third, slanted)]]
            length = spatial.from_product_of_exponentials(screws).mechanism.a[0]
            assert length == (0 if gap == 0 else pytest.approx(gap, abs=4e-15))


def test_three_parallel_axes_and_a_shift_keep_exact_zeros():
    """A SCARA arm: R, R, R parallel and a P along them; every twist is 0, and S_j of the turning joints is 0."""
    arm = spatial.from_product_of_exponentials(
        [[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, -0.3, 0], [0, 0, 1, 0, -0.5, 0], [0, 0, 0, 0, 0, 1]],
        spatial.transform(origin=[0.5, 0, 0.2]),
    )
    mechanism = arm.mechanism
    assert mechanism.joints == ("R", "R", "R", "P")
    np.testing.assert_allclose(mechanism.a, [0.3, 0.2, 0], atol=1e-16)
    assert mechanism.alpha.tolist() == [0, 0, 0]
    assert mechanism.offset[:3].tolist() == [0, 0, 0]


def test_axes_that_are_all_but_parallel_lose_what_the_convention_must():
    """Feet are known to rounding over the sine, and parallel axes in their place are off by the sine: 1e-7 at worst."""
    for sine in (1e-3, 1e-5, 1e-7, 0.9e-8, 1e-10, 1e-12):
        worst = 0.0
        for turned in Rotation.random(20, random_state=7).as_matrix():
            tilted = turned @ [np.sin(np.arcsin(sine)), 0, np.sqrt(1 - sine**2)]
            places = turned @ np.array([[0.1, 0.3], [0.2, 0.5], [0.7, -0.4]])
            axes = zip((turned[:, 2], tilted), places.T, strict=True)
            screws = [[*axis, *np.cross(place, axis)] for axis, place in axes]
            found = spatial.from_product_of_exponentials(screws).forward([0.4, 1.1])
            worst = max(worst, np.abs(found - product(screws, np.eye(4), [0.4, 1.1])).max())
        assert worst <= (100 * np.finfo(float).eps / sine if sine > 1e-8 else 4 * sine)


def test_links_that_miss_the_axes_are_refused(refuses, monkeypatch):
    """What comes out is put back into the poses: with a link that is 1e-5 of the size too long it does not leave."""
    right = product_of_exponentials.links_from_axes

    def wrong(*arguments):
        links = right(*arguments)
        return links._replace(a=links.a + 1e-5)

    screws = spatial.to_product_of_exponentials(Mechanism("RPR", [1, 0], [1, 1], [0, np.nan, 0]))
    monkeypatch.setattr(product_of_exponentials, "links_from_axes", wrong)
    refuses(spatial.from_product_of_exponentials, *screws)


def test_a_screw_of_another_length_is_an_error(refuses):
    refuses(spatial.from_product_of_exponentials, [[0, 0, 1, 0, 0, 0], [0, 0, 2, 0, 0, 0]])
    refuses(spatial.from_product_of_exponentials, [0, 0, 1, 0, 0, 0])


# Placements -----------------------------------------------------------------------------------------------------------


def test_placements_of_loops_and_wrong_frames_are_an_error(refuses):
    refuses(Placement, Mechanism("RRRR", [1.0] * 4, [0.0] * 4))
    refuses(Placement, spatial.PUMA_560, base=np.eye(3))
    refuses(Placement, spatial.PUMA_560, zero=[0.0])
    refuses(Placement(spatial.PUMA_560).forward, [0.0])


# machines ------------------------------------------------------------------------------------------------------------


def test_the_jacobian_of_a_placement_is_that_of_its_end_in_its_base():
    """Against differences of the pose: h = 1e-6 leaves h² times third derivatives, and eps/h of rounding."""
    rng = np.random.default_rng(11)
    mixed = Mechanism("RPCR", [1.0, 0.5, 0.2], [0.3, -1.2, 0.7])
    for mechanism in (spatial.PUMA_560, mixed):
        count = len(mechanism.variables)
        robot = Placement(mechanism, random_frame(rng), random_frame(rng), rng.normal(size=count))
        q = rng.normal(size=count)
        rates, pose, h = robot.jacobian(q), robot.forward(q), 1e-6
        for v in range(count):
            rate = (robot.forward(q + h * np.eye(count)[v]) - robot.forward(q - h * np.eye(count)[v])) / (
                2 * h
            )
            turning = rate[:3, :3] @ pose[:3, :3].T
            wanted = [turning[2, 1], turning[0, 2], turning[1, 0], *rate[:3, 3]]
            assert np.abs(rates[:, v] - wanted).max() < 1e-8 * (1 + np.abs(pose).max())


def seen(machine: Machine, q: np.ndarray) -> np.ndarray:
    """What the machine's own model says that its targets are seen at: (rows, targets, 3)."""
    units = ["deg" if joint.type == "revolute" else "mm" for joint in machine.joints]
    columns = {
        f"{joint.name} [{unit}]": np.degrees(column) if unit == "deg" else column
        for joint, unit, column in zip(machine.joints, units, q.T, strict=True)
    }
    found = []
    for target in machine.targets:
        named = {**columns, "target": [target.name] * len(q)}
        made = simulate(machine, Measurements.from_frame(named), noise=0.0, seed=1).columns
        found.append(np.stack([made[f"{axis} [mm]"] for axis in "xyz"], axis=-1))
    return np.stack(found, axis=1)


def machine_of(screws, targets) -> Machine:
    joints = []
    for n, xi in enumerate(screws):
        turns = xi[:3].any()
        axis = xi[:3] if turns else xi[3:]
        point = np.cross(axis, xi[3:]) if turns else np.zeros(3)
        joints.append(Joint(f"J{n}", "revolute" if turns else "prismatic", tuple(axis), tuple(point)))
    marks = tuple(Target(f"t{n}", tuple(point)) for n, point in enumerate(targets))
    return Machine(
        "Made up", "mm", "deg", (0.0, 0.0, -1.0), 20.0, tuple(joints), marks, Measured("point", "machine")
    )


def test_machine_files_of_robots_at_right_angles_have_no_dust():
    for joint in from_mechanism(spatial.PUMA_560).joints:
        assert set(np.abs(joint.axis)) <= {0.0, 1.0}
        assert set(np.abs(joint.point)) <= {0.0, 5.9, 17.0, 0.8 + 17.0}


def test_a_rigid_machine_and_its_mechanism_see_targets_alike():
    rng = np.random.default_rng(3)
    for _ in range(6):
        screws = random_screws(rng, 4)
        screws = np.array(
            [xi if not xi[:3].any() else [*xi[:3], *(xi[3:] - xi[:3] * (xi[:3] @ xi[3:]))] for xi in screws]
        )
        machine = machine_of(screws, 10 * rng.normal(size=(2, 3)))
        robot = to_mechanism(machine)
        q = rng.uniform(-3, 3, size=(5, 4))
        points = np.array([[*target.point, 1.0] for target in machine.targets])
        expected = np.einsum("nij,tj->nti", robot.forward(q), points)[..., :3]
        np.testing.assert_allclose(seen(machine, q), expected, atol=1e-11)


def test_a_mechanism_and_its_machine_see_the_end_alike_and_come_back(tmp_path):
    rng = np.random.default_rng(4)
    scara = Mechanism("RRCP", [300.0, 200.0, 0.0], [0.0, np.pi, np.pi / 2], names=("J1", "J2", "quill", "Z"))
    placement = Placement(spatial.GE_P60, random_frame(rng), random_frame(rng), rng.normal(size=6))
    for robot in (spatial.PUMA_560, spatial.T3_776, scara, placement, Mechanism("RS", [10.0], [0.3])):
        machine = from_mechanism(robot, {"end": [0, 0, 0], "tool": [1.0, -2.0, 3.0]})
        q = rng.uniform(-2, 2, size=(4, len(machine.joints)))
        chain = robot if isinstance(robot, Placement) else Placement(robot.expanded())
        mechanism = chain.mechanism
        expected = chain.forward(q)[:, None] @ np.array([[0, 0, 0, 1.0], [1, -2, 3, 1]])[..., None]
        expected = expected[..., :3, 0]
        in_mm = Machine(**{**vars(machine), "length_unit": "mm"})
        np.testing.assert_allclose(seen(in_mm, q), expected, atol=1e-10)

        machine.save(tmp_path / "machine.toml")
        read = Machine.load(tmp_path / "machine.toml")
        again = to_mechanism(read)
        assert again.mechanism.unit == mechanism.unit
        tools = np.array([[*target.point, 1.0] for target in read.targets])
        back = np.einsum("nij,tj->nti", again.forward(q), tools)[..., :3]
        np.testing.assert_allclose(back, expected, atol=1e-10)


def test_a_screw_an_effect_a_loop_and_no_target_are_errors(refuses):
    refuses(from_mechanism, Mechanism("RH", [1.0], [0.0], pitch=[0.0, 2.0]))
    refuses(from_mechanism, Mechanism("RRRR", [1.0] * 4, [0.0] * 4))
    refuses(from_mechanism, spatial.PUMA_560, {})
    refuses(from_mechanism, Mechanism("CP", [1.0], [0.0], names=("C", "C_S")))
    worn = from_mechanism(spatial.PUMA_560).add("backlash", joint="R1")
    refuses(to_mechanism, worn)


def test_a_closed_chain_of_the_workbench_is_no_mechanism(refuses, tmp_path):
    (tmp_path / "tricept.toml").write_text(
        'name = "T"\nfamily = "tricept"\n[units]\nlength = "mm"\nangle = "deg"\n[geometry]\nR = 330\nr = 140\n'
        'q = [0, 0, 200]\n[measured]\nkind = "point"\nframe = "machine"\n'
    )
    refuses(to_mechanism, Machine.load(tmp_path / "tricept.toml"))


def test_fitted_numbers_are_taken_along():
    """A fitted axis is where the machine of the fixed numbers has it."""
    machine = from_mechanism(spatial.PUMA_560, {"end": [0, 0, 10.0]})
    fitted = dataclasses.replace(
        machine,
        estimate=("R2.axis", "R2.point"),
        values={"R2.axis.a": 0.01, "R2.axis.b": -0.02, "R2.point.a": 0.3},
    )
    q = np.random.default_rng(5).uniform(-2, 2, size=(3, 6))
    points = np.array([*fitted.targets[0].point, 1.0])
    expected = (to_mechanism(fitted).forward(q) @ points)[:, :3]
    in_mm = dataclasses.replace(fitted, length_unit="mm")
    np.testing.assert_allclose(seen(in_mm, q)[:, 0], expected, atol=1e-10)
    plain = (to_mechanism(machine).forward(q) @ points)[:, :3]
    assert np.abs(plain - expected).max() > 0.01
