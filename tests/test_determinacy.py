"""What data do not determine, on machines where that is known without a computer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from simulated_fits import fit_to, joint, machine_file, measure

from rodgen.calibration.determinacy import Direction
from rodgen.calibration.determinacy.determinacy import _with_prior, sparse
from rodgen.calibration.fit import Fit

C = joint("C", "revolute", (0, 0, 1))
X = joint("X", "prismatic", (1, 0, 0))
BALL = (100, 0, 40)
RING = np.radians(np.arange(0.0, 360, 30))
EVERYTHING = ["C.axis", "C.point", "target"]


def fitted(
    joints: Any, columns: Any, *, effects: Any = (), truth: Any = None, noise: float = 1e-4, **more: Any
) -> Fit:
    file = machine_file(joints, **{"targets": [BALL], "effects": effects, **more})
    return fit_to(file, measure(file, columns, truth, noise=noise, random=np.random.default_rng(0)))


def keys(direction: Direction) -> set[str]:
    return {key for key, _ in direction.parts}


def test_what_is_determined_has_no_directions() -> None:
    found = fitted([C], {"C [rad]": RING}, estimate=EVERYTHING).determinacy
    assert (found.rank, found.directions, found.weak) == (7, (), ())
    assert not found.undetermined.any()


def test_normal_equations_give_the_covariance_that_the_jacobian_gives() -> None:
    """Where all is well determined the first will do: of a condition of 1e3, squared, ten digits remain."""
    found = fitted([C], {"C [rad]": np.repeat(RING, 3)}, estimate=EVERYTHING)
    jacobian = found.problem.jacobian(found.solution.theta, found.solution.frame)
    exact = np.linalg.pinv(jacobian.reshape(-1, jacobian.shape[-1]))
    std = np.sqrt(np.diag(found.determinacy.covariance))
    room = 1e-10 * np.outer(std, std)
    assert np.all(np.abs(found.determinacy.covariance - exact @ exact.T) <= room)


def test_nothing_tells_where_a_ball_is_along_and_about_the_axis_that_carries_it() -> None:
    found = fitted([C], {"C [rad]": RING}, frame="free", estimate=["target"]).determinacy
    assert all(d.gauge for d in found.directions)
    by_keys = {frozenset(keys(d)): d for d in found.directions}
    assert set(by_keys) == {frozenset({"frame.z", "target.p.z"}), frozenset({"frame.rz", "target.p.y"})}
    along = by_keys[frozenset({"frame.z", "target.p.z"})]
    up, down = (dict(along.parts)[key] for key in ("target.p.z", "frame.z"))
    assert up / down == pytest.approx(-1.0, abs=1e-6)
    assert along.text == (
        "frame.z and target.p.z change together without changing any reading, which is a choice of coordinates, "
        "not a fault."
    )


def test_what_is_chosen_as_the_file_has_it_is_that_and_no_rounding() -> None:
    found = fitted([C], {"C [rad]": RING}, frame="free", estimate=["target"]).estimates
    for key in ("target.p.y", "target.p.z"):  # the frame takes on all that they share with it
        assert (found[key].convention, found[key].value, found[key].std) == (True, 0.0, 0.0)
    assert found["frame.z"].value != 0.0


def test_a_free_frame_with_all_axes_of_six_joints_has_six_choices_of_coordinates() -> None:
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    points = [(0, 0, 0), (175, 0, 495), (175, 0, 1390), (175, 0, 1565), (1135, 0, 1565), (1270, 0, 1565)]
    joints = [joint(f"J{i}", "revolute", a, p) for i, (a, p) in enumerate(zip(axes, points, strict=True), 1)]
    random = np.random.default_rng(1)
    targets = [(1320, 90, 1565), (1320, -60, 1645), (1410, -50, 1505)]
    columns = {f"J{i} [rad]": np.repeat(random.uniform(-1.5, 1.5, 40), 3) for i in range(1, 7)}
    found = fitted(
        joints,
        columns | {"target": ["p", "r", "s"] * 40},
        targets=targets,
        frame="free",
        estimate=[f"J{i}.{x}" for i in range(1, 7) for x in ("axis", "point")] + ["target"],
    ).determinacy
    assert [d.gauge for d in found.directions] == [True] * 6
    assert found.weak == ()
    assert found.rank == 6 * 4 + 3 * 3 + 6 - 6
    # one motion of the frame in each
    motions = [{key for key, _ in d.parts if key.startswith("frame")} for d in found.directions]
    assert motions == [{f"frame.{x}"} for x in ("x", "y", "z", "rx", "ry", "rz")]


def test_a_single_pose_tells_of_the_ball_and_not_of_the_joint() -> None:
    found = fitted([C], {"C [rad]": np.zeros(3)}, estimate=EVERYTHING).determinacy
    assert found.rank == 3
    lacking = {"C.axis.a", "C.axis.b", "C.point.a", "C.point.b"}
    assert {frozenset(keys(d)) for d in found.directions} == {frozenset({key}) for key in lacking}
    assert not any(d.gauge for d in found.directions)
    assert all(
        d.text.endswith("no reading in these data: measure at other positions of C (it never moves).")
        for d in found.directions
    )


def test_a_slide_that_never_moves_goes_with_what_it_carries() -> None:
    columns = {"X [mm]": np.full(12, 100.0), "C [rad]": RING}
    effects = [{"name": "scale", "joint": "X"}]
    found = fitted([X, C], columns, effects=effects, estimate=["X.axis", *EVERYTHING]).determinacy
    # 100 mm out, a tilt of the slide lifts the table and its ball; that the axis of the table is upright is seen.
    assert {frozenset(keys(d)) for d in found.directions} == {
        frozenset({"X.scale.k", "C.point.a", "target.p.x"}),
        frozenset({"X.axis.a", "target.p.z"}),
        frozenset({"X.axis.b", "C.point.b", "target.p.y"}),
    }
    assert all("measure at other positions of X (it never moves)" in d.text for d in found.directions)


def test_choices_of_coordinates_and_lack_of_data_are_told_apart_where_both_are_there() -> None:
    A, B = joint("A", "revolute", (0, 0, 1)), joint("B", "revolute", (0, 0, 1), (200, 0, 0))
    columns = {"A [rad]": RING, "B [rad]": np.zeros(12)}
    estimate = ["A.axis", "A.point", "B.axis", "B.point", "target"]
    options = {"targets": [(300, 0, 0)], "frame": "free", "estimate": estimate}
    found = fitted([A, B], columns, **options).determinacy
    assert [d.gauge for d in found.directions] == [True] * 6 + [False] * 4
    lacking = {frozenset(keys(d)) for d in found.directions if not d.gauge}
    assert lacking == {frozenset({f"B.{x}"}) for x in ("axis.a", "axis.b", "point.a", "point.b")}
    # Where B moves, too, the coordinates are still a choice.
    moving = columns | {"B [rad]": RING[::-1] ** 2 % 3}
    assert [d.gauge for d in fitted([A, B], moving, **options).determinacy.directions] == [True] * 6


def test_backlash_needs_both_sides_of_approach() -> None:
    options = {"effects": [{"name": "backlash", "joint": "C"}], "estimate": ["C.point", "target"]}
    (found,) = fitted([C], {"C [rad]": RING}, **options).determinacy.directions
    assert (keys(found), found.gauge) == ({"C.backlash.b", "target.p.y"}, False)
    # The ball at 100 mm goes half the lost motion ahead.
    assert dict(found.parts)["C.backlash.b"] == pytest.approx(
        dict(found.parts)["target.p.y"] * 2 / 100, abs=1e-4
    )
    assert found.text.endswith("approach C from both sides.")
    both = np.concatenate([RING, RING[::-1]])
    assert fitted([C], {"C [rad]": both}, **options).determinacy.directions == ()


@pytest.mark.parametrize(
    ("effect", "columns", "hint"),
    [
        ("thermal_offset", {"T_C [degC]": np.full(12, 23.0)}, "measure at other temperatures of C"),
        ("servo_lag", {"v_C [rad/s]": np.full(12, 0.1)}, "measure at other speeds of C"),
        ("linear_drift", {"t [s]": np.full(12, 5.0)}, "measure at other times"),
    ],
)
def test_the_hint_names_what_is_the_same_in_all_rows(effect: str, columns: Any, hint: str) -> None:
    block = {"name": effect} if effect == "linear_drift" else {"name": effect, "joint": "C"}
    options = {"effects": [block], "estimate": ["C.point", "target"]}
    found = fitted([C], {"C [rad]": RING, **columns}, **options).determinacy
    assert len(found.directions) >= 1
    assert all(not d.gauge and hint in d.text for d in found.directions)


def test_a_target_that_is_never_seen() -> None:
    columns = {"C [rad]": RING, "target": ["p"] * 12}
    found = fitted([C], columns, targets=[BALL, (0, 50, 0)], estimate=["C.point", "target"]).determinacy
    assert {frozenset(keys(d)) for d in found.directions} == {frozenset({f"target.r.{x}"}) for x in "xyz"}
    assert all("measure target r, which is in no row" in d.text for d in found.directions)


def test_the_same_thing_said_twice_is_no_lack_of_data() -> None:
    effects = [{"name": "zero_offset", "joint": "C"}]
    (found,) = fitted(
        [C], {"C [rad]": RING}, effects=effects, estimate=["C.point", "target"]
    ).determinacy.directions
    assert (keys(found), found.gauge) == ({"C.zero_offset.a", "target.p.y"}, True)
    assert found.text.endswith("whatever is measured: hold one of them.")


def test_one_ball_does_not_tell_an_eccentric_encoder_from_a_wobble_and_another_one_would() -> None:
    """At one radius r, a cos q forwards is a r/2 across, twice a turn, and a shift of the centre."""
    effects = [{"name": "encoder_eccentricity", "joint": "C"}]
    effects += [{"name": "radial_error_motion", "joint": "C", "hold": dict.fromkeys(_FIRST, 0)}]
    columns = {"C [rad]": np.arange(48) * 0.3, "target": ["p", "r"] * 24}
    options = {"effects": effects, "estimate": ["C.point", "target"], "noise": 0.0}
    two = fitted([C], columns, targets=[BALL, (0, 30, 40)], **options).determinacy
    assert two.directions == two.weak == ()
    one = fitted([C], columns | {"target": ["p"] * 48}, **options).determinacy
    assert len(one.directions) == 2
    for d in one.directions:
        assert not d.gauge
        assert "C.encoder_eccentricity" in d.text
        assert d.text.endswith("measure a target at another place on the body.")


_FIRST = ["u_c1", "u_s1", "v_c1", "v_s1"]


def test_a_joint_that_hardly_moves_is_hardly_determined() -> None:
    """Turns of 1e-4 rad show the point of an axis by 1e-4 of what whole turns do, and its tilt across by 1e-8."""
    A, B = joint("A", "revolute", (0, 0, 1)), joint("B", "revolute", (0, 0, 1), (200, 0, 0))
    columns = {"A [rad]": np.linspace(-1.5, 1.5, 24), "B [rad]": np.tile([-1e-4, 0, 1e-4], 8)}
    options = {"targets": [(300, 0, 0)], "estimate": ["B.point", "B.axis", "target"], "noise": 0.0}
    found = fitted([A, B], columns, **options).determinacy
    assert {key for d in found.directions for key in keys(d)} <= {"B.axis.b"}
    assert {key for d in (*found.directions, *found.weak) for key in keys(d)} >= {
        "B.point.a",
        "B.point.b",
        "B.axis.b",
    }
    assert all(d.text.endswith("measure at other positions of B.") for d in found.weak)
    assert not any(d.gauge for d in (*found.directions, *found.weak))


def test_echelon_form_has_the_fewest_parts() -> None:
    """Two sparse vectors that were mixed come back."""
    sparse_ones = np.array([[1.0, 0, -0.5, 0, 0, 0.2], [0, 1.0, 0, 0.3, 0, 0]])
    mixed = np.linalg.qr((np.array([[0.6, 0.8], [-0.8, 0.6]]) @ sparse_ones).T)[0].T
    found, pivots = sparse(mixed)
    np.testing.assert_allclose(found[:, pivots], np.eye(2), atol=1e-12)
    assert sorted(np.sum(np.abs(found) > 1e-12, axis=1)) == [2, 3]
    assert np.linalg.matrix_rank(np.concatenate([found, sparse_ones]), tol=1e-9) == 2


@pytest.mark.parametrize("scale", [1.0, 1e6, 1e12])
def test_a_prior_far_finer_than_the_readings_decides(scale):
    """More rows of a prior than directions that the readings leave: 1 + SSᵀ has no inverse in doubles."""
    rng = np.random.default_rng(5)
    root, unit = rng.standard_normal((4, 2)) * scale, rng.standard_normal((5, 4)) * scale
    found, rows = _with_prior(root, SimpleNamespace(unit=unit), 1.0)
    with mpmath.workdps(80):
        exact, seen = (
            mpmath.matrix(root.tolist()),
            mpmath.matrix(rows.tolist()) * mpmath.matrix(root.tolist()),
        )
        expected = exact * (mpmath.eye(2) + seen.T * seen) ** -1 * exact.T
    expected = np.array(expected.tolist(), float)
    assert len(rows) > 2
    # rounding, times the condition of what the prior sees, which is below a hundred
    np.testing.assert_allclose(found @ found.T, expected, atol=1e-13 * np.abs(expected).max())
