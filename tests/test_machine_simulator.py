"""The simulator that judges rodgen's models, judged itself: by hand-computed cases and by two fits of real data.

Numbers in the tests are chosen so that the answer can be seen without a computer. Tolerances: 1e-12 where only
rounding is in question (lengths about 100, so eps * 100 with a reserve); a linearised answer is held to the square
of the small angle, which stands beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from machine_simulator import (
    Simulated,
    approach,
    arcsec,
    complete,
    rotation,
)
from parallel_simulator import LEGS, Parallel, about_y_then_x
from scipy.optimize import root
from scipy.spatial.transform import Rotation

X, Y, Z = np.eye(3)
TINY = 1e-12


def close(one: Any, other: Any, within: float = TINY) -> bool:
    """Compare all numbers, as differences."""
    return bool(np.abs(np.asarray(one) - np.asarray(other)).max() <= within)


def joint(name: str, type_: str, axis: Sequence[float], **more: Any) -> dict[str, Any]:
    return {"name": name, "type": type_, "axis": list(axis), **more}


def machine(*joints: dict[str, Any], targets: Any = ((100, 0, 0),), **more: Any) -> dict[str, Any]:
    """Make a machine of joints in mm and degrees, its targets called p0, p1, ..."""
    return {
        "units": {"length": "mm", "angle": "deg"},
        "joint": list(joints),
        "target": [{"name": f"p{i}", "point": list(point)} for i, point in enumerate(targets)],
        "measured": {"kind": "point", **more.pop("measured", {})},
        **more,
    }


def table(**more: Any) -> dict[str, Any]:
    """Make a rotary table about z with a ball at x = 100."""
    return machine(joint("C", "revolute", Z), **more)


def boom(**more: Any) -> dict[str, Any]:
    """Make a horizontal boom of 1000 mm along y, which turns about x: positive lifts it."""
    return machine(joint("A", "revolute", X), targets=[(0, 1000, 0)], **more)


def slide(**more: Any) -> dict[str, Any]:
    """Make a horizontal slide along x with 400 mm of travel."""
    return machine(joint("X", "prismatic", X, travel=[0, 400]), **more)


def mount() -> dict[str, Any]:
    """Make the telescope's mount: azimuth from north (y) through east (x), elevation up."""
    return machine(
        joint("AZ", "revolute", -Z),
        joint("EL", "revolute", X),
        targets=[(0, 1, 0)],
        measured={"kind": "direction"},
    )


def moved(of: dict[str, Any], effects: dict[str, Any], q: Any, **conditions: Any) -> np.ndarray:
    """Give how far effects move the readings."""
    return Simulated(of, effects).measure(q, **conditions) - Simulated(of).measure(q, **conditions)


# Geometry


def test_rotation_is_that_of_scipy(rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(50, 3)) * np.logspace(-9, 0.5, 50)[:, None]
    assert np.abs(rotation(vectors) - Rotation.from_rotvec(vectors).as_matrix()).max() < 1e-15 * 10


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.mark.parametrize(
    ("n", "u", "v"),
    [(Z, X, Y), (X, Y, Z), (Y, Z, X), (-Z, X, -Y), (np.array([0.6, 0, 0.8]), np.array([0.8, 0, -0.6]), Y)],
)
def test_u_and_v_complete_an_axis(n: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
    assert close(complete(n), (u, v))
    assert close(np.cross(u, v), n)


def test_first_joint_carries_the_others() -> None:
    q = [[10, 90]]
    x, c = joint("X", "prismatic", X), joint("C", "revolute", Z)
    assert close(Simulated(machine(x, c)).measure(q), [[10, 100, 0]])
    assert close(Simulated(machine(c, x)).measure([[90, 10]]), [[0, 110, 0]])


def test_paper_s_machine_is_r1_plus_C_q_plus_turned_vector() -> None:
    columns = np.array([[1, 0, 0], [0.6, 0.8, 0], [0, 0.28, 0.96]]).T
    joints = [joint(name, "prismatic", columns[:, i]) for i, name in enumerate("XYZ")]
    of = machine(*joints, joint("C", "revolute", Z, point=[5, 6, 7]), targets=[(25, 6, 17)])
    reading = Simulated(of).measure([[1, 2, 3, 90]])
    assert close(reading, np.array([5, 6, 7]) + columns @ [1, 2, 3] + [0, 20, 10])


def test_elevation_lifts_and_azimuth_goes_from_north_to_east() -> None:
    reading = Simulated(mount()).measure([[90, 0], [0, 30]])
    assert close(reading, [[1, 0, 0], [0, np.cos(np.pi / 6), 0.5]])


def test_free_frame_turns_then_shifts() -> None:
    of = table(measured={"frame": "free"})
    effects = {"frame.rz": 90.0, "frame.x": 5.0}
    assert close(Simulated(of, effects).measure([[0]]), [[5, 100, 0]])
    with pytest.raises(KeyError, match="not free"):
        Simulated(table(), effects)


def test_distance_is_from_its_point() -> None:
    of = table(measured={"kind": "distance", "from": [100, 3, 4]})
    assert close(Simulated(of).measure([[0]]), [[5]])
    assert close(Simulated(of, {"instrument_scale.k": 0.01}).measure([[0]]), [[5.05]])


# Axes and points


def test_squareness_moves_x_by_minus_a_times_y() -> None:
    # n = y, so u = z, v = x: a turns the axis about z, which leans it towards -x.
    of = machine(joint("X", "prismatic", X), joint("Y", "prismatic", Y))
    a = arcsec(20)
    change = moved(of, {"Y.squareness.a": a}, [[50, 300], [50, -300]])
    assert close(change[:, 0], np.sin(np.radians(a)) * np.array([-300, 300]))
    assert np.abs(change[:, 1:]).max() < 300 * np.radians(a) ** 2  # the cosine's part
    of_x = moved(of, {"X.squareness.a": a, "X.squareness.b": 2 * a}, [[300, 0]])[0]
    # n = x: a about y leans x towards -z, b about z towards y; together one turn, hence the square
    assert close(
        of_x, [0, 300 * np.radians(2 * a), -300 * np.radians(a)], within=300 * np.radians(3 * a) ** 2
    )


def test_tilt_and_offset_of_a_rotary_axis() -> None:
    a = 0.01
    # About x by a the axis n leans towards -y. Half a turn takes p to 2 (n.p) n - p, and n.p is -100 a for a ball on
    # y, 0 for one on x.
    on_y = moved(table(targets=[(0, 100, 0)]), {"C.axis_tilt.a": a}, [[180]])[0]
    assert on_y[2] == pytest.approx(-2 * 100 * np.radians(a), rel=1e-6)
    assert close(moved(table(), {"C.axis_tilt.a": a}, [[180]])[0], 0)
    # The axis passes x = 0.02: half a turn about it brings x = 100 to -99.96.
    assert close(moved(table(), {"C.axis_offset.a": 0.02}, [[180]]), [[0.04, 0, 0]])
    assert close(moved(table(), {"C.point.b": 0.02}, [[180]]), [[0, 0.04, 0]])
    assert close(
        Simulated(table(), {"C.axis.a": a, "C.axis_tilt.a": -a}).measure([[70]]),
        Simulated(table()).measure([[70]]),
    )


def test_later_joints_stay_where_they_are_when_an_axis_moves() -> None:
    of = machine(joint("A", "revolute", X), joint("C", "revolute", Z))
    for effect in ("A.axis.a", "A.point.b", "A.axis_tilt.b"):
        assert close(moved(of, {effect: 0.1}, [[0, 40]]), 0)


def test_target_moves() -> None:
    of = table(targets=[(100, 0, 0), (0, 50, 0)])
    effects = {"p0.target_offset.x": 1.0, "target.p0.x": 1.0, "target.p1.z": 3.0}
    change = moved(of, effects, [[90], [90]], target=["p0", "p1"])
    assert close(change, [[0, 2, 0], [0, 0, 3]])
    # d = y: u = z, v = x. About z by a the boresight goes to -x, about x by b up.
    change = moved(mount(), {"p0.target_offset.a": 0.01, "target.p0.b": 0.02}, [[0, 0]])[0]
    assert close(change, [-np.radians(0.01), 0, np.radians(0.02)], within=np.radians(0.03) ** 2)


# Readings: at the ball's 100 mm an angle d moves the ball by 100 d along y

READINGS: list[tuple[dict[str, float], float, float]] = [
    ({"C.zero_offset.a": 0.01}, 30, 0.01),
    ({"C.scale.k": 1e-4}, 90, 0.009),
    ({"C.encoder_eccentricity.a": 0.01, "C.encoder_eccentricity.b": 0.02}, 30, 0.01 * np.sqrt(0.75) + 0.01),
    ({"C.encoder_ellipticity.a": 0.01, "C.encoder_ellipticity.b": 0.02}, 45, 0.02),
    ({"C.periodic_drive_error.a": 0.01, "C.periodic_drive_error.P": 4.0}, 1, 0.01),
    ({"C.periodic_drive_error.b": 0.01, "C.periodic_drive_error.P": 4.0}, 2, -0.01),
]


@pytest.mark.parametrize(("effects", "q", "expected"), READINGS)
def test_change_of_the_coordinate(effects: dict[str, float], q: float, expected: float) -> None:
    assert close(Simulated(table(), effects).measure([[q]]), Simulated(table()).measure([[q + expected]]))


def test_backlash_leaves_the_joint_short_of_where_it_goes() -> None:
    s = [[1.0], [-1.0]]
    assert close(moved(slide(), {"X.backlash.b": 0.01}, [[7], [7]], s=s)[:, 0], [-0.005, 0.005])
    change = moved(slide(), {"X.backlash_gradient.k": 1e-4}, [[7], [7]], s=s)[:, 0]
    assert close(change, [-7e-4, 7e-4])


def test_direction_of_approach_is_taken_from_the_order_of_rows() -> None:
    q = np.array([[5, 0], [5, 0], [3, 1], [3, 1], [8, 0]], dtype=float)
    assert approach(q).T.tolist() == [[-1, -1, -1, -1, 1], [1, 1, 1, 1, -1]]
    assert approach(np.ones((3, 1))).tolist() == [[0], [0], [0]]


def test_servo_lags_behind() -> None:
    assert close(moved(slide(), {"X.servo_lag.tau": 0.01}, [[7]], v=[[50]]), [[-0.5, 0, 0]])


def test_heat() -> None:
    warm = {"X": [25.0], "C": [25.0]}
    assert close(
        moved(slide(), {"X.thermal_expansion.alpha": 1e-5}, [[200]], temperature=warm),
        [[0.01, 0, 0]],
    )
    assert close(moved(slide(), {"X.thermal_offset.k": 0.002}, [[200]], temperature=warm), [[0.01, 0, 0]])
    of = table(environment={"reference_temperature": 23})
    drift = moved(
        of, {"C.thermal_axis_drift.x": 0.5, "C.thermal_axis_drift.z": -1.0}, [[90]], temperature=warm
    )
    assert close(drift, [[1, 0, -2]])


# Error motions


def test_error_motions_of_an_axis_of_rotation() -> None:
    q = [[0], [90], [45]]
    half = np.sqrt(0.5)
    names = ("c1", "s1", "c2", "s2")
    radial = {
        f"C.radial_error_motion.{w}_{h}": float(i)
        for w, i0 in (("u", 1), ("v", 5))
        for i, h in enumerate(names, i0)
    }
    u, v = ([k[0] + k[2], k[1] - k[2], half * (k[0] + k[1]) + k[3]] for k in ((1, 2, 3, 4), (5, 6, 7, 8)))
    assert close(moved(table(), radial, q), np.stack([u, v, np.zeros(3)], -1))
    axial = {f"C.axial_error_motion.{h}": float(i) for i, h in enumerate(names, 1)}
    assert close(moved(table(), axial, q), np.stack([np.zeros(3), np.zeros(3), u], -1))


def test_tilt_has_the_lever_arm_of_the_height_above_the_point() -> None:
    of = machine(joint("C", "revolute", Z, point=[0, 0, 20]), targets=[(0, 0, 120)])
    a = 0.01
    # about x (u) by a: a point 100 above goes to -y; about y (v): to +x
    assert close(
        moved(of, {"C.tilt_error_motion.u_c1": a}, [[0]]),
        [[0, -100 * np.radians(a), 0]],
        within=100 * np.radians(a) ** 2,
    )
    assert close(
        moved(of, {"C.tilt_error_motion.v_s2": a}, [[45]]),
        [[100 * np.radians(a), 0, 0]],
        within=100 * np.radians(a) ** 2,
    )


def test_straightness_is_a_legendre_polynomial_of_the_travel() -> None:
    q = [[0], [100], [200], [400]]  # 2 zeta - 1 = -1, -1/2, 0, 1
    for degree, values in (
        (2, [1, -1 / 8, -1 / 2, 1]),
        (3, [-1, 7 / 16, 0, 1]),
        (4, [1, -37 / 128, 3 / 8, 1]),
    ):
        change = moved(slide(), {f"X.straightness.u_{degree}": 2.0, f"X.straightness.v_{degree}": 1.0}, q)
        assert close(change, np.outer(values, [0, 2, 1]))


def test_angular_error_motion_acts_by_abbe_s_arm() -> None:
    of = machine(joint("X", "prismatic", X, travel=[0, 400], point=[0, 0, 50]), targets=[(0, 0, 250)])
    a = 0.001
    # pitch about y at the far end: 200 above the point, and 400 along: x by 200 a, z by -400 a
    change = moved(of, {"X.angular_error_motion.y_1": a}, [[400]])
    assert close(change, np.radians(a) * np.array([[200, 0, -400]]), within=500 * np.radians(a) ** 2)
    assert close(moved(of, {"X.angular_error_motion.z_2": a}, [[400]])[0, 1], 400 * np.radians(a))
    assert close(moved(of, {"X.angular_error_motion.x_3": a}, [[0]])[0, 1], 200 * np.radians(a))


# Gravity


def test_moment_of_a_horizontal_boom_and_the_sign_of_its_sag() -> None:
    # r = 1000 y, g = -z: r x g = -1000 x. A compliance k > 0 lets the boom droop; upright it does nothing.
    k = 1e-5  # deg/mm
    q = np.array([[0.0], [60.0], [90.0], [180.0]])
    m = -1000 * np.cos(np.radians(q))
    expected = Simulated(boom()).measure(q + k * m)
    assert close(Simulated(boom(), {"A.gravity_windup.k": k}).measure(q), expected, within=1e-10)
    assert moved(boom(), {"A.gravity_windup.k": k}, [[0]])[0, 2] == pytest.approx(
        -1000 * np.radians(0.01), rel=1e-6
    )
    # c turned by +90 degrees about x stands upright when the boom lies, so M_perp is +sin: r = 1000 (-sin y + cos z)
    expected = Simulated(boom()).measure(q + k * 1000 * np.sin(np.radians(q)))
    assert close(Simulated(boom(), {"A.gravity_windup.k2": k}).measure(q), expected, within=1e-10)
    load = moved(boom(), {"A.load_windup.k": k / 50}, [[0]], load=[50.0])
    assert close(load, moved(boom(), {"A.gravity_windup.k": k}, [[0]]))


def test_gravity_and_arms_are_those_of_the_pose() -> None:
    # The first joint lays the second one's axis from y to x (about z) and gravity stays; the second one's boom, along
    # x at zero, then lies along -... about z by 90: x -> y. Turned up by 30 degrees its moment is 1000 cos 30.
    of = machine(joint("C", "revolute", Z), joint("B", "revolute", Y), targets=[(1000, 0, 0)])
    q = np.array([[0, -30], [90, -30]])  # about +y a negative angle lifts x
    expected = Simulated(of).measure(q + np.array([[0, 1e-5 * 1000 * np.cos(np.pi / 6)]]))
    assert close(Simulated(of, {"B.gravity_windup.k": 1e-5}).measure(q), expected, within=1e-10)
    # A roll joint below it, turned by a quarter, lays B's axis upright: no moment is left about it.
    of = machine(joint("A", "revolute", X), joint("B", "revolute", Y), targets=[(1000, 0, 0)])
    assert close(moved(of, {"B.gravity_windup.k": 1e-5}, [[90, 0], [90, 40]]), 0)
    # And gravity may point anywhere.
    of["environment"] = {"gravity": [0, 3, 0]}
    change = moved(of, {"B.gravity_windup.k": 1e-5}, [[90, 0]])[0]  # B's axis along z, gravity along y
    assert np.abs(change[1]) == pytest.approx(1000 * np.radians(0.01), rel=1e-6)
    assert change[1] > 0


def test_a_later_joint_s_weight_hangs_at_its_point() -> None:
    of = machine(
        joint("A", "revolute", X), joint("B", "revolute", X, point=[0, 400, 0]), targets=[(0, 1000, 0)]
    )
    change = moved(of, {"A.gravity_windup.k_B": 1e-5}, [[60, 25]])[0]
    expected = Simulated(of).measure([[60 - 1e-5 * 400 * 0.5, 25]]) - Simulated(of).measure([[60, 25]])
    assert close(change, expected[0], within=1e-10)
    # and, a quarter turn on, hangs at (0, 0, 400) of A's own link, whatever B does: 400 sin 60 the other way
    change = moved(of, {"A.gravity_windup.k2_B": 1e-5}, [[60, 25]])[0]
    turned = [[60 + 1e-5 * 400 * np.sin(np.pi / 3), 25]]
    assert close(change, (Simulated(of).measure(turned) - Simulated(of).measure([[60, 25]]))[0], within=1e-10)


def test_a_drive_gives_way_to_the_weights_that_it_carries() -> None:
    of = machine(
        joint("A", "revolute", X), joint("B", "revolute", X, point=[0, 400, 0]), targets=[(0, 1000, 0)]
    )
    of["weight"] = [
        {"joint": "A", "point": [0, 200, 0], "newton": 30.0},
        {"joint": "B", "point": [0, 700, 0], "newton": 10.0},
    ]
    # A at 60 degrees, B stretched: 30 N at 100 mm and 10 N at 350 mm; B bent by 60 degrees more: 10 N at 200 - 150 mm
    for bend, moment_a, moment_b in ((0, 6500, 1500), (60, 3500, -1500)):
        moved_a = Simulated(of).measure([[60 - 1e-5 * moment_a, bend]])
        assert close(Simulated(of, {"A.weight_windup.c": 1e-5}).measure([[60, bend]]), moved_a, within=1e-10)
        moved_b = Simulated(of).measure([[60, bend - 1e-5 * moment_b]])
        assert close(Simulated(of, {"B.weight_windup.c": 1e-5}).measure([[60, bend]]), moved_b, within=1e-10)
    # an upright axis with all of it along x: the bearing leans about y, as with a weight of 60 N at 100 mm
    of = machine(joint("C", "revolute", Z), targets=[(100, 0, 0)])
    of["weight"] = [{"joint": "C", "point": [300, 0, 0], "newton": 20.0}]
    leant = moved(of, {"C.lateral_windup.a": 6e-4}, [[30]])
    assert close(moved(of, {"C.weight_tilt.a": 1e-5}, [[30]]), leant, within=1e-10)


def test_lateral_windup_bends_across_the_axis() -> None:
    # An upright axis with a boom along x: the moment is about y, the boom droops; about its own axis nothing turns.
    change = moved(table(), {"C.lateral_windup.a": 1e-4}, [[0], [90]])
    assert close(change, [[0, 0, -100 * np.radians(0.01)]] * 2, within=100 * np.radians(0.01) ** 2)
    assert close(moved(boom(), {"A.lateral_windup.a": 1e-4}, [[0], [50]]), 0)


def test_guide_pitches_under_an_overhang_along_it() -> None:
    # 100 ahead of the point that travels with the slide, wherever it stands; the roll of an overhang aside is left out.
    a = 1e-4
    pitch = np.radians(0.01)
    change = moved(slide(), {"X.guide_windup.a": a}, [[0], [400]])
    assert close(change, [[0, 0, -100 * pitch], [0, 0, -500 * pitch]], within=500 * pitch**2)
    change = moved(slide(), {"X.guide_windup.b": a}, [[0], [200]])
    assert close(change, [[0, 0, 0], [0, 0, -300 * pitch / 2]], within=500 * pitch**2)
    assert close(moved(slide(targets=[(0, 100, 0)]), {"X.guide_windup.a": a}, [[0], [400]]), 0)


def test_sag_drops_the_target_and_noses_the_beam_down() -> None:
    q = np.array([[0.0], [200.0], [400.0]])
    z = q[:, 0] / 400
    shapes: dict[str, tuple[Any, Any]] = {
        "tip": (z**3, 1.5 * z**2),
        "own": (z**4, 4 / 3 * z**3),
        "mid": (16 * z**2 * (1 - z) ** 2, 16 * (2 * z - 6 * z**2 + 4 * z**3)),
    }
    for parameter, (drop, slope) in shapes.items():
        key = f"X.gravity_sag.{parameter}"
        assert close(moved(slide(), {key: 0.1}, q), np.outer(drop, [0, 0, -0.1]))
        # Of two targets the mean drops so; one 50 farther out hangs lower by 50 slopes, where the slope is positive.
        ends = slide(targets=[(50, 0, 0), (150, 0, 0)])
        near, far = (moved(ends, {key: 0.1}, q, target=p) for p in ("p0", "p1"))
        assert close((near + far) / 2, np.outer(drop, [0, 0, -0.1]))
        assert close((far - near)[:, 2], -100 * 0.1 / 400 * slope, within=100 * (0.1 * 2 / 400) ** 2)
    load = moved(slide(), {"X.load_sag.k0": 1e-4, "X.load_sag.k3": 3e-4}, q, load=[100.0, 100.0, 200.0])
    assert close(load[:, 2], [-0.01, -(0.01 + 0.03 / 8), -0.08])
    tilt = moved(
        slide(targets=[(0, 0, 0), (100, 0, 0)]), {"X.load_sag.k3": 1e-3}, q[2:], target="p1", load=[100.0]
    )
    assert tilt[0, 2] == pytest.approx(-0.1 - 50 * 1.5 * 0.1 / 400, abs=1e-6)


def test_sag_follows_gravity_and_leaves_an_upright_ram_straight() -> None:
    upright = machine(joint("Z", "prismatic", Z, travel=[0, 400]), targets=[(0, 0, 0), (0, 0, 100)])
    change = moved(upright, {"Z.gravity_sag.tip": 0.1}, [[400], [400]], target=["p0", "p1"])
    assert close(change, [[0, 0, -0.1]] * 2)
    sideways = slide(environment={"gravity": [0, 9.81, 0]})
    assert close(moved(sideways, {"X.gravity_sag.tip": 0.1}, [[400]]), [[0, 0.1, 0]])


# The whole machine


def test_frame_drifts_in_time() -> None:
    t = [0.0, 100.0, 1e6]
    q = [[0]] * 3
    warm = {"warm_up_drift.x": 1.0, "warm_up_drift.z": -2.0, "warm_up_drift.tau": 100.0}
    assert close(moved(table(), warm, q, t=t), np.outer([0, 1 - np.exp(-1), 1], [1, 0, -2]))
    assert close(moved(table(), {"linear_drift.y": 0.01}, q, t=t)[:, 1], [0, 1, 1e4])
    # for directions the frame turns: about x by a north goes up
    change = moved(mount(), {"linear_drift.x": 0.01}, [[0, 0]], t=[2.0])
    assert close(change, [[0, 0, np.radians(0.02)]], within=np.radians(0.02) ** 2)


def test_set_ups_move_the_frame() -> None:
    q = [[0]] * 3
    effects = {"frame_shift[2].x": 1.0, "frame_shift[2].rz": 90.0, "frame_shift[b].y": 2.0}
    reading = Simulated(table(), effects).measure(q, run=[1, 2, "b"])
    assert close(reading, [[100, 0, 0], [1, 100, 0], [100, 2, 0]])
    assert close(Simulated(table(), {"frame_shift.z": 1.0}).measure(q)[:, 2], 1)
    assert close(Simulated(mount(), {"frame_shift.z": 90.0}).measure([[0, 0]]), [[-1, 0, 0]])


def test_a_target_sits_differently_in_another_run() -> None:
    q = [[90]] * 3
    effects = {"p0.target_remounting[2].x": 1.0, "p0.target_remounting[b].y": 2.0}
    reading = Simulated(table(), effects).measure(q, run=[1, 2, "b"])
    assert close(reading, [[0, 100, 0], [0, 101, 0], [-2, 100, 0]])


def test_drift_comes_before_set_up_and_set_up_before_the_free_frame() -> None:
    of = table(measured={"frame": "free"})
    effects = {
        "linear_drift.x": 1.0,
        "frame_shift.rz": 90.0,
        "frame.rz": 90.0,
        "frame.y": 7.0,
        "instrument_scale.k": 1.0,
    }
    # 100 x, drifted to 101 x, turned to 101 y, then to -101 x, shifted, and twice as long in all
    assert close(Simulated(of, effects).measure([[0]], t=[1.0]), [[-202, 14, 0]])


def test_refraction_lifts_by_a_times_the_tangent_of_the_zenith_angle() -> None:
    a = 0.01
    q = np.array([[0, 45], [70, 30], [120, 90.0]])
    expected = Simulated(mount()).measure(q + a * np.array([[0, 1], [0, np.sqrt(3)], [0, 0]]))
    assert close(Simulated(mount(), {"refraction.a": a}).measure(q), expected)


def test_signs_of_the_telescope_s_terms() -> None:
    # TF: the tube sags by k cos(E), so the true elevation is less than the encoder's.
    q = np.array([[20.0, 60.0]])
    sag = Simulated(mount(), {"EL.gravity_windup.k": arcsec(20)}).measure(q)
    assert close(sag, Simulated(mount()).measure(q - [[0, arcsec(10)]]))


# Formulas of the user


# The simulator of machines of parallel legs: its loops and forces against SciPy, and against each other


FILES: dict[str, dict[str, Any]] = {
    "tricept": {"geometry": {"R": 330.0, "r": 140.0, "q": [3.0, -4.0, 120.0]}},
    "3-sps-s": {"geometry": {"R": 200.0, "r": 120.0, "h": 260.0, "start": [0.0, 0.0, 42.0]}},
}
for name, made in FILES.items():
    made |= {
        "name": "A machine",
        "family": name,
        "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": [0.3, -0.2, 0.9]},
        "measured": {"kind": "point"},
        "target": [{"name": "p", "point": [60.0, -30.0, 40.0]}],
    }
EFFECTS = {"leg_scale.k": 2e-4, "base_joint_offset.y": 0.7, "platform_joint_offset.z": -0.4}


def poses(family: str, rows: int) -> np.ndarray:
    random = np.random.default_rng(1)
    if family == "tricept":
        return random.uniform([-0.4, -0.4, 600], [0.4, 0.4, 780], (rows, 3))
    return random.uniform([-0.3, -0.3, 0.4], [0.3, 0.3, 1.0], (rows, 3))


@pytest.mark.parametrize("family", LEGS)
def test_a_closed_loop_is_what_scipy_closes(family):
    machine = Parallel(FILES[family], {f"{LEGS[family][1]}.{key}": x for key, x in EFFECTS.items()})
    x = poses(family, 8)
    q = machine.legs(x)
    read = machine.measure(q, start=x)
    at = np.radians({"tricept": [0, 120, -120], "3-sps-s": [-30, 90, 210]}[family])
    ring = np.stack([np.cos(at), np.sin(at), 0 * at], -1)
    g = machine.file["geometry"]
    base, platform = g["R"] * ring, g["r"] * ring
    base[1, 1] += 0.7
    platform[1, 2] -= 0.4
    for i, first in enumerate(x):

        def placed(at, p):
            if family == "tricept":
                turn = about_y_then_x(at[:1], at[1:2])[0]
                return turn @ np.add(p, (0, 0, at[2] * 600))
            return rotation(at) @ p + (0, 0, g["h"])

        def gap(at, i=i):
            length = [np.linalg.norm(placed(at, p) - a) for a, p in zip(base, platform, strict=True)]
            return np.array(length) - q[i] * [1, 1.0002, 1]

        start = first / [1, 1, 600] if family == "tricept" else first
        found = root(gap, start, tol=1e-14).x
        p = np.array([60, -30, 40]) + g.get("q", [0, 0, 0])
        assert read[i] == pytest.approx(placed(found, p), abs=1e-8)


@pytest.mark.parametrize("family", LEGS)
def test_forces_do_the_work_that_the_load_does(family):
    machine = Parallel(FILES[family])
    x = poses(family, 20)
    q, shape = machine.legs(x), machine.shape(displaced=False)
    target = np.array([60.0, -30.0, 40.0])

    def seen(length):
        pose = machine.closed(length, shape, x)
        return pose.origin + pose.turn @ target

    tension = machine.tensions(machine.closed(q, shape, x), shape, seen(q))
    step = 1e-3
    for k, e in enumerate(np.eye(3)):
        sinks = (seen(q + step * e) - seen(q - step * e)) @ machine.gravity / (2 * step)
        assert tension[:, k] == pytest.approx(sinks, abs=1e-7)
