"""Rotations, links, forward analysis and the hypothetical link, against SciPy, mpmath, differences, a closed loop."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from kinematics_cases import rx, rz, shift
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.errors import RodgenError
from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import HypotheticalStatus, Mechanism

EPS = np.finfo(float).eps
ROBOTS = (spatial.PUMA_560, spatial.GE_P60, spatial.T3_776)


def by_hand(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """The chain as a product of matrices, one at a time."""
    values = iter(q)
    found = np.eye(4)
    for j, kind in enumerate(mechanism.joints):
        angle = next(values) if kind in "RCH" else mechanism.angle[j]
        offset = (
            next(values) if kind in "PC" else mechanism.offset[j] + mechanism.pitch[j] * angle * (kind == "H")
        )
        found = found @ shift(z=offset) @ rz(angle)
        if j < len(mechanism.a):
            found = found @ shift(x=mechanism.a[j]) @ rx(mechanism.alpha[j])
    return found


def random_chain(rng: np.random.Generator, kinds: str, *, closed: bool = False) -> Mechanism:
    n, links = len(kinds), len(kinds) - (not closed)
    return Mechanism(
        kinds,
        rng.normal(size=links) * rng.integers(0, 2, size=links),
        np.where(
            rng.random(links) < 0.4,
            rng.choice([0, np.pi / 2, np.pi, -np.pi / 2], links),
            rng.normal(size=links),
        ),
        [np.nan if kind in "PC" else x for kind, x in zip(kinds, rng.normal(size=n), strict=True)],
        [np.nan if kind in "RCH" else x for kind, x in zip(kinds, rng.normal(size=n), strict=True)],
        [0.3 if kind == "H" else 0.0 for kind in kinds],
    )


# vector and angle ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [1e-8, 1e-3, 1.0, 2.5, np.pi - 1e-3, np.pi - 1e-8])
def test_vector_and_angle_are_right_to_a_few_times_the_machine_epsilon(theta):
    """The matrix is made with 40 digits and rounded. That alone may turn it by about one eps: relative to the
    angle where that is small, since the small entries are rounded by their own size."""
    rng = np.random.default_rng(1)
    for _ in range(30):
        axis = rng.normal(size=3)
        with mpmath.workdps(40):
            exact = mpmath.matrix(axis) / mpmath.norm(mpmath.matrix(axis))
            c, s = mpmath.cos(mpmath.mpf(theta)), mpmath.sin(mpmath.mpf(theta))
            x, y, z = exact
            cross = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            matrix = c * mpmath.eye(3) + s * cross + (1 - c) * exact * exact.T
            rounded = np.array(matrix.tolist(), float)
            vector, angle, status = rodgen.axis_angle_from_matrix(rounded)
            # near a half turn -m would be as good to rounding, but not here, where its angle is above π
            wrong = max(abs(mpmath.mpf(float(f)) - e) for f, e in zip(vector, exact, strict=True))
            off = abs(mpmath.mpf(float(angle)) - mpmath.mpf(theta))
        assert wrong <= 4 * EPS
        assert off <= 4 * EPS * max(theta, 0.0) if theta < 1 else off <= 4 * EPS
        assert status == rodgen.RotationStatus.ROTATION


def test_a_transform_and_its_inverse_make_the_unit_matrix():
    rng = np.random.default_rng(3)
    made = spatial.transform(Rotation.random(50, random_state=3).as_matrix(), 100 * rng.normal(size=(50, 3)))
    np.testing.assert_allclose(
        made @ spatial.inverse_transform(made), np.tile(np.eye(4), (50, 1, 1)), atol=1e-12
    )


# mechanisms ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ("", [], []),
        ("RX", [1], [0]),
        ("RR", [1, 2, 3], [0, 0, 0]),
        ("RR", [np.nan], [0]),
        ("RP", [1], [0], [0, 3.0]),
        ("RP", [1], [0], [np.nan, np.nan]),
        ("RH", [1], [0]),
        ("RR", [1], [0], None, None, [0, 2.0]),
        ("RR", [1], [0], None, [0.0, np.nan]),
        ("RR", [1], [0], [0.0]),
        ("RR", ["x"], [0]),
        ("RR", [[1]], [0]),
    ],
)
def test_error_for_what_is_no_mechanism_is_one_sentence(refuses, arguments):
    refuses(Mechanism, *arguments)


def test_a_mechanism_is_a_value():
    other = Mechanism("RP", [1.0], [0.5], names=("A", "B"))
    same = Mechanism(("R", "P"), np.array([1.0]), [0.5], names=["A", "B"])
    assert other == same
    assert hash(other) == hash(same)
    assert other != Mechanism("RP", [1.0], [0.25], names=("A", "B"))
    with pytest.raises(ValueError, match="read-only"):
        other.a[0] = 2.0


def test_variables_stand_in_the_order_of_the_joints():
    assert Mechanism("RCPH", [1.0] * 4, [0.5] * 4, pitch=[0, 0, 0, 2.0]).variables == (
        (0, "theta"),
        (1, "theta"),
        (1, "S"),
        (2, "S"),
        (3, "theta"),
    )
    with pytest.raises(RodgenError, match="expanded"):
        _ = Mechanism("RS", [1.0], [0.5]).variables


def test_an_expanded_plane_joint_moves_in_a_plane_and_turns_across_it():
    """Two shifts at right angles and a turn about the direction across both, from the axes in space."""
    plane = Mechanism("E", [], []).expanded()
    rates = spatial.jacobian(plane, [0.3, -0.2, 0.7])
    first, second, turn = rates[3:, 0], rates[3:, 1], rates[:3, 2]
    np.testing.assert_allclose([first @ second, first @ turn, second @ turn], 0, atol=1e-15)
    np.testing.assert_allclose(rates[:3, :2], 0, atol=0)


@pytest.mark.parametrize(("kind", "freedoms"), [("S", 3), ("T", 2)])
def test_expanded_joints_turn_about_one_point(kind, freedoms):
    joint = Mechanism(kind, [], [], offset=[5.0]).expanded()
    rng = np.random.default_rng(4)
    chain = spatial.frames(joint, rng.uniform(-3, 3, size=(20, freedoms)))
    np.testing.assert_allclose(
        chain[..., :3, 3], np.broadcast_to([0, 0, 5.0], chain[..., :3, 3].shape), atol=1e-14
    )
    assert joint.freedoms == (1,) * freedoms


# forward analysis --------------------------------------------------------------------------------------------------


def test_the_forward_analysis_is_the_product_of_the_links():
    rng = np.random.default_rng(5)
    for kinds in ("RRRRRR", "RPR", "C", "CHRP", "RRRRRRR", "PPPRRR", "HC"):
        for closed in (False, True):
            for _ in range(4):
                chain = random_chain(rng, kinds, closed=closed)
                q = rng.uniform(-3, 3, size=(5, len(chain.variables)))
                expected = np.array([by_hand(chain, row) for row in q])
                np.testing.assert_allclose(spatial.forward(chain, q), expected, atol=2e-14)
                if not closed:
                    np.testing.assert_allclose(spatial.frames(chain, q)[:, -1], expected, atol=2e-14)


def test_the_jacobian_is_that_of_differences():
    """Central differences with a step of 1e-5 are off by its square times third derivatives, some 1e-9 here."""
    rng = np.random.default_rng(8)
    step = 1e-5
    for kinds in ("RRRRRR", "RPR", "CHRP", "HC"):
        for closed in (False, True):
            chain = random_chain(rng, kinds, closed=closed)
            q = rng.uniform(-3, 3, size=len(chain.variables))
            rates = spatial.jacobian(chain, q)
            here = by_hand(chain, q)
            for column in range(len(q)):
                move = step * np.eye(len(q))[column]
                moved = (by_hand(chain, q + move) - by_hand(chain, q - move)) / (2 * step)
                spin = moved[:3, :3] @ here[:3, :3].T
                expected = [spin[2, 1], spin[0, 2], spin[1, 0], *moved[:3, 3]]
                np.testing.assert_allclose(rates[:, column], expected, atol=2e-8)


def test_batches_of_any_shape_and_no_element():
    q = np.random.default_rng(9).normal(size=(2, 3, 6))
    for robot in (spatial.PUMA_560, Mechanism("RRRPRR", spatial.PUMA_560.a, spatial.PUMA_560.alpha)):
        poses, rates = spatial.forward(robot, q), spatial.jacobian(robot, q)
        assert poses.shape == (2, 3, 4, 4)
        assert rates.shape == (2, 3, 6, 6)
        np.testing.assert_allclose(poses[1, 2], spatial.forward(robot, q[1, 2]), atol=1e-14)
        np.testing.assert_allclose(rates[1, 2], spatial.jacobian(robot, q[1, 2]), atol=1e-13)
        assert spatial.forward(robot, q[:0]).shape == (0, 3, 4, 4)
        assert spatial.frames(robot, q).shape == (2, 3, 6, 4, 4)


def test_what_is_not_finite_stays_with_its_element():
    q = np.zeros((3, 6))
    q[1, 2] = np.nan
    assert np.isnan(spatial.forward(spatial.PUMA_560, q)[1, :3, 3]).any()
    assert np.isfinite(spatial.forward(spatial.PUMA_560, q)[[0, 2]]).all()


# the hypothetical link ---------------------------------------------------------------------------------------------


def closure(robot: Mechanism, q: np.ndarray, link: spatial.HypotheticalLink) -> float:
    """How far the closed loop is from closing: in the rotation, and in the origin relative to the robot's size."""
    loop = link.loop(robot)
    off = by_hand(loop, np.array([q[0] + link.gamma1, *q[1:], link.theta7])) - np.eye(4)
    return float(
        max(
            np.abs(off[:3, :3]).max(), np.abs(off[:3, 3]).max() / (robot.a.sum() + np.abs(robot.offset).sum())
        )
    )


def one(link: spatial.HypotheticalLink, row: int) -> spatial.HypotheticalLink:
    return spatial.HypotheticalLink(*(field[row] for field in link))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@pytest.mark.parametrize("free", [{}, {"alpha67": 1.1}, {"a67": 7.0, "alpha67": -2.0}, {"a67": 3.0}], ids=str)
def test_the_hypothetical_link_closes_the_loop(robot, free):
    """Random poses, with every α67: where it is given, s71 may be small, and rounding is divided by it."""
    q = np.random.default_rng(10).uniform(-np.pi, np.pi, size=(60, 6))
    link = spatial.close_loop(spatial.forward(robot, q), **free)
    assert (link.status == HypotheticalStatus.NORMAL).all()
    for row in range(len(q)):
        assert closure(robot, q[row], one(link, row)) <= 100 * EPS / np.sin(link.alpha71[row])


def test_the_chosen_twist_leaves_no_special_case():
    """Rotations with S7 for 90°, 45° and 135° on S1 and everywhere between: s71 is at least sin 45°."""
    turns = np.concatenate([Rotation.random(300, random_state=11).as_matrix(), np.eye(3)[None]])
    for angle in np.linspace(-np.pi, np.pi, 81):
        turns = np.concatenate([turns, Rotation.from_euler("xz", [[angle, 0.3]]).as_matrix()])
    link = spatial.close_loop(spatial.transform(turns, np.ones(3)))
    assert (link.status == HypotheticalStatus.NORMAL).all()
    assert np.sin(link.alpha71).min() >= np.sqrt(0.5) - 4 * EPS
    assert set(np.degrees(link.alpha67).round(9)) == {45.0, 90.0, 135.0}


@pytest.mark.parametrize("same", [1.0, -1.0])
def test_special_case_1_closes_the_loop_where_the_axes_are_parallel(same):
    pose = spatial.transform(np.diag([1.0, same, same]) @ rz(0.7)[:3, :3], [3.0, 4.0, 2.0])
    link = spatial.close_loop(pose, alpha67=0.0)
    assert link.status == HypotheticalStatus.PARALLEL
    assert link.S7 == 0
    assert link.alpha71 == pytest.approx(0.0 if same > 0 else np.pi)
    assert link.a71 == pytest.approx(5.0)
    back = pose @ rz(link.theta7) @ shift(x=link.a71) @ rx(link.alpha71) @ shift(z=link.S1) @ rz(link.gamma1)
    np.testing.assert_allclose(back, np.eye(4), atol=1e-14)


@pytest.mark.parametrize("same", [1.0, -1.0])
def test_special_case_2_closes_the_loop_where_both_axes_are_one(same):
    pose = spatial.transform(np.diag([1.0, same, same]) @ rz(0.7)[:3, :3], [0.0, 0.0, 2.0])
    link = spatial.close_loop(pose, alpha67=0.0)
    assert link.status == HypotheticalStatus.COINCIDENT
    assert (link.S7, link.theta7, link.a71) == (0, 0, 0)
    back = pose @ rx(link.alpha71) @ shift(z=link.S1) @ rz(link.gamma1)
    np.testing.assert_allclose(back, np.eye(4), atol=1e-14)


def off_by(sine: float, tolerance: float) -> float:
    """Largest error of the closed loop in space where S7 and S1 are at an angle of this sine, |P| = 10."""
    rng = np.random.default_rng(12)
    worst = 0.0
    for _ in range(60):
        spin, azimuth = rng.uniform(-np.pi, np.pi, size=2)
        turned = Rotation.from_rotvec(
            np.arcsin(sine) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
        ).as_matrix()
        place = rng.normal(size=3)
        pose = spatial.transform(turned @ rz(spin)[:3, :3], 10 * place / np.linalg.norm(place))
        link = spatial.close_loop(pose, alpha67=0.0, tolerance=tolerance)
        back = pose @ shift(z=link.S7) @ rz(link.theta7) @ shift(x=link.a71) @ rx(link.alpha71)
        back = back @ shift(z=link.S1) @ rz(link.gamma1)
        worst = max(worst, float(np.abs(back[:3, 3]).max()))
    return worst


def test_the_tolerance_is_where_both_cases_are_alike():
    """Normal: rounding divided by the sine. Special case 1: distance times the sine. They cross near 1e-8."""
    for sine in (1e-2, 1e-4, 1e-6):
        assert off_by(sine, 0.0) <= 100 * EPS * 10 / sine
        assert 0.1 * 10 * sine <= off_by(sine, 2 * sine) <= 2 * 10 * sine
    assert off_by(1e-6, 0.0) < 0.1 * off_by(1e-6, 2e-6)
    assert off_by(1e-10, 0.0) > 10 * off_by(1e-10, 2e-10)
    assert max(off_by(1.1e-8, 1e-8), off_by(0.9e-8, 1e-8)) <= 2e-6


@pytest.mark.parametrize(
    "call",
    [
        lambda: spatial.close_loop(1j * np.eye(4)),
        lambda: spatial.close_loop(None),
        lambda: spatial.close_loop(np.eye(3)),
        lambda: spatial.inverse_transform(1j * np.eye(4)),
        lambda: spatial.transform([[1.0], [2.0, 3.0]]),
        lambda: spatial.from_product_of_exponentials("x"),
        lambda: Mechanism("RR", [1j], [0.0]),
    ],
)
def test_error_for_what_is_no_array_of_numbers_is_one_sentence(refuses, call):
    refuses(call)


# Link tables: a mechanism is written and read back bit for bit, and every slip is reported with line and column


HEADER = "joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]"
ROWS = ["base,R,0,,,120,90", "slide,P,,30,,0,-90", "screw,H,2,,1.5,1e-1,45", "tool,C,,,,,"]


def write(folder: Path, *lines: str, ending: str = "\n") -> str:
    path = folder / "arm.csv"
    path.write_bytes((ending.join(lines) + ending).encode())
    return str(path)


def test_table_gives_the_mechanism(tmp_path: Path) -> None:
    found = spatial.load_mechanism(write(tmp_path, HEADER, *ROWS))
    n = math.nan
    expected = spatial.Mechanism(
        "RPHC",
        a=[120, 0, 0.1],
        alpha=[math.pi / 2, -math.pi / 2, math.pi / 4],
        offset=[0, n, 2, n],
        angle=[n, math.pi / 6, n, n],
        pitch=[0, 0, 1.5, 0],
        name="arm",
        names=["base", "slide", "screw", "tool"],
    )
    assert found == expected
    assert not found.closed


def test_windows_blanks_quotes_and_order_do_not_matter(tmp_path: Path) -> None:
    expected = spatial.load_mechanism(write(tmp_path, HEADER, *ROWS))
    lines = [
        "\ufeff alpha [deg] , a [mm],type,S [mm],theta [deg],pitch [mm/rad], joint",
        "",
        '90,"120",R,0,,,base',
    ]
    lines += ["-90, 0 ,P,,30,,slide", "  ", "45,.1,H,2,,1.5,screw", ",,C,,,,tool", ",,,,,,"][:-1]
    assert spatial.load_mechanism(write(tmp_path, *lines, ending="\r\n")) == expected


def test_units_are_those_of_each_column(tmp_path: Path) -> None:
    lines = ["type,S [in],theta [rad],pitch [mm/rev],a [cm],alpha [rad]", "H,1,,25.4,2.54,0.5", "P,,1.25,,,"]
    found = spatial.load_mechanism(write(tmp_path, *lines))
    assert (found.unit, found.names) == ("in", ("H1", "P2"))
    np.testing.assert_allclose(found.a, [1.0], rtol=4e-16)
    np.testing.assert_allclose(found.pitch, [1 / (2 * math.pi), 0], rtol=4e-16)
    assert (found.alpha[0], found.angle[1]) == (0.5, 1.25)


def test_columns_that_are_left_out_are_zero(tmp_path: Path) -> None:
    found = spatial.load_mechanism(write(tmp_path, "type,a [m],alpha [deg]", "R,1,0", "P,0,90", "R,,"))
    assert found == spatial.Mechanism("RPR", [1, 0], np.radians([0, 90]), unit="m", name="arm")


def random_mechanism(seed: int) -> spatial.Mechanism:
    rng = np.random.default_rng(seed)
    kinds = rng.choice(list("RPCHEST"), rng.integers(1, 8))
    n = len(kinds)
    links = n - int(rng.integers(2))
    lengths, angles = rng.normal(0, 10.0 ** rng.integers(-8, 8), (2, n)), rng.uniform(-7, 7, (2, n))
    if seed % 2:
        angles = np.radians(np.round(np.degrees(angles)))
    blank = spatial.Mechanism(kinds, np.zeros(n), np.zeros(n), pitch=(kinds == "H") * 1.0)
    return spatial.Mechanism(
        kinds,
        lengths[0, :links],
        angles[0, :links],
        np.where(np.isnan(blank.offset), np.nan, lengths[1]),
        np.where(np.isnan(blank.angle), np.nan, angles[1]),
        np.where(kinds == "H", rng.normal(size=n), 0.0),
        unit=str(rng.choice(["mm", "in", "inch", "um"])),
        names=[f'{name}, "{k}"' for k, name in enumerate(kinds)],
    )


def table_of(mechanism: spatial.Mechanism) -> list[str]:
    """Lines of a table, all numbers with all digits; angles in rad."""
    unit = mechanism.unit
    lines = [f"joint,type,S [{unit}],theta [rad],pitch [{unit}/rad],a [{unit}],alpha [rad]"]
    for j, kind in enumerate(mechanism.joints):
        link = (mechanism.a[j], mechanism.alpha[j]) if j < len(mechanism.a) else (np.nan, np.nan)
        numbers = (mechanism.offset[j], mechanism.angle[j], mechanism.pitch[j], *link)
        name = '"' + mechanism.names[j].replace('"', '""') + '"'
        lines.append(",".join([name, kind, *("" if np.isnan(x) else repr(float(x)) for x in numbers)]))
    return lines


@pytest.mark.parametrize("seed", range(30))
def test_all_digits_are_loaded_to_the_last_bit(seed: int, tmp_path: Path) -> None:
    mechanism = replace(random_mechanism(seed), name="arm")
    assert spatial.load_mechanism(write(tmp_path, *table_of(mechanism))) == mechanism


@pytest.mark.parametrize(
    "lines",
    [
        [],
        [HEADER],
        [HEADER.replace(",", ";"), "a;R"],
        [HEADER.replace("theta", "angle"), *ROWS],
        [HEADER.replace(" [mm]", "", 1), *ROWS],
        [HEADER.replace("type", "type [mm]"), *ROWS],
        [HEADER.replace("S [mm]", "S [kg]"), *ROWS],
        [HEADER.replace("S [mm]", "S [foo]"), *ROWS],
        [HEADER.replace("mm/rad", "mm"), *ROWS],
        [HEADER.replace("mm/rad", "mm/s"), *ROWS],
        [HEADER.replace("a [mm]", "S [mm]"), *ROWS],
        [HEADER.replace(",a [mm]", ""), *ROWS],
        [HEADER + ",", *ROWS],
        [HEADER, "x,r,0,,,1,1"],
        [HEADER, "x,,0,,,1,1"],
        [HEADER, "x,X,0,,,1,1"],
        [HEADER, *ROWS[:2], "s,H,2,,,1,45", ROWS[3]],
        [HEADER, "s,H,2,,0,1,45", ROWS[3]],
        [HEADER, "s,R,2,,3,1,45", ROWS[3]],
        ["type,a [mm],alpha [deg]", "H,1,1"],
        [HEADER, "x,R,,,,1,1"],
        [HEADER, "x,P,1,0,,1,1"],
        [HEADER, "x,R,1,0,,1,1"],
        [HEADER, "x,R,0,,,,1", ROWS[3]],
        [HEADER, ROWS[0], "y,R,0,,,5,"],
        [HEADER, 'x,R,"12,5",,,1,1'],
        [HEADER, "x,R,1_000,,,1,1"],
        [HEADER, "x,R,nan,,,1,1"],
        [HEADER, "x,R,1e999,,,1,1"],
        [HEADER, "x,R,0,,,1,1,7"],
        [HEADER, "x [1],R,0,,,1,1"],
        [HEADER, ROWS[0], ROWS[0]],
        [HEADER, 'x,R,"0,,,1,1'],
        [HEADER, "x,R,0,,\0,1,1"],
    ],
)
def test_faults_are_reported_in_one_line(refuses, lines: list[str], tmp_path: Path) -> None:
    refuses(spatial.load_mechanism, write(tmp_path, *lines))


def test_what_is_no_table_is_an_error(refuses, tmp_path: Path) -> None:
    latin, large = tmp_path / "latin.csv", tmp_path / "large.csv"
    latin.write_bytes(HEADER.encode() + b"\n\xe4,R\n")
    large.write_bytes(b"joint,type\n" * 200_000)
    for path in (tmp_path, tmp_path / "none.csv", latin, large):
        refuses(spatial.load_mechanism, path)


def test_millimetres_and_degrees_need_numpy_alone(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER.replace("mm/rad", "mm/rev"), *ROWS)
    hide = "import sys\nfor m in ('pint', 'pyarrow', 'sympy', 'scipy'): sys.modules[m] = None\n"
    code = f"from rodgen import spatial\nprint(spatial.load_mechanism({path!r}).joints)"
    done = subprocess.run([sys.executable, "-c", hide + code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
