"""Bounds of a Tricept's U_y over boxes: sound intervals, the paper's figures, other optimisers, dense sampling."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from rodgen.kinematics import tricept
from rodgen.kinematics.tricept import ELEMENTS, LEG_LIMITS, PAPER, Geometry
from rodgen.kinematics.tricept._intervals import Jet, certified_extremes, enclose, exact, stack

U_PAPER = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
LOW, HIGH = np.array([-80.0, -80.0, 605.0]), np.array([80.0, 80.0, 765.0])
TOOL = Geometry(330.0, 140.0, (20.0, -35.0, 60.0))

# ../mathematics of the paper's eq. (24): printed, in mm²
PRINTED = {
    "xx": (0.0000185, 0.0000368),
    "yy": (0.0000185, 0.0000370),
    "zz": (0.0000038, 0.0000138),
    "xy": (-7.0896e-6, 7.0896e-6),
    "xz": (-7.3262e-6, 7.2188e-6),
    "yz": (-7.3394e-6, 7.3394e-6),
}
# Found with another program: edge 160, z = 605…765; sums of base matrices, and true ranges
BASE_SUMS = {
    "xx": (1.8495e-5, 3.6795e-5),
    "yy": (1.8471e-5, 3.7057e-5),
    "zz": (3.8001e-6, 1.3842e-5),
    "xy": (-7.1418e-6, 7.1418e-6),
    "xz": (-7.3920e-6, 7.2967e-6),
    "yz": (-7.4060e-6, 7.4060e-6),
}
RANGES = {
    "xx": (2.0458e-5, 3.5032e-5),
    "yy": (2.0104e-5, 3.5005e-5),
    "zz": (6.8131e-6, 9.6269e-6),
    "xy": (-2.6994e-6, 2.6994e-6),
    "xz": (-1.3428e-6, 1.3445e-6),
    "yz": (-1.5544e-6, 1.5544e-6),
}


@pytest.fixture(scope="module")
def found() -> tricept.Bounds:
    return tricept.bounds(LOW, HIGH, PAPER, U_PAPER)


def elements(points: np.ndarray, U_x: np.ndarray = U_PAPER, geometry: Geometry = PAPER) -> np.ndarray:
    U_y, status = tricept.propagate(points, geometry, U_x)
    assert (status == 0).all()
    return np.stack([U_y[..., k, m] for k, m in ELEMENTS.values()], axis=-1)


# intervals ---------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_every_operation_encloses_the_exact_result() -> None:
    rng = np.random.default_rng(1)
    n = 300
    ends = np.sort(rng.normal(size=(2, 2, n)) * 10.0 ** rng.integers(-150, 150, (2, 1, n)), axis=1)
    a, b = Jet((ends[0, 0], ends[0, 1])), Jet((ends[1, 0], ends[1, 1]))
    inside = rng.random((2, n))
    points = np.clip(ends[:, 0] + inside * (ends[:, 1] - ends[:, 0]), ends[:, 0], ends[:, 1])
    x, y = ([Fraction(float(v)) for v in row] for row in points)
    results = {
        "sum": (a + b, [p + q for p, q in zip(x, y, strict=True)]),
        "difference": (a - b, [p - q for p, q in zip(x, y, strict=True)]),
        "product": (a * b, [p * q for p, q in zip(x, y, strict=True)]),
        "square": (a.square(), [p * p for p in x]),
        "inverse": (b.inverse(), [1 / q if q else None for q in y]),
    }
    for name, (jet, values) in results.items():
        for low, high, value in zip(*jet.value, values, strict=True):
            if value is None:
                continue
            assert np.isneginf(low) or Fraction(float(low)) <= value, name
            assert np.isposinf(high) or value <= Fraction(float(high)), name
    root = (a * a).sqrt()
    for low, high, value in zip(*a.square().sqrt().value, x, strict=True):
        assert Fraction(float(low)) ** 2 <= value**2 <= Fraction(float(high)) ** 2
    assert (root.value[1] >= 0).all()


def test_unbounded_results_are_not_narrow() -> None:
    a = Jet((np.array([-1.0, 0.0]), np.array([1.0, 2.0])))
    low, high = a.inverse().value
    assert np.isneginf(low).all()
    assert np.isposinf(high).all()
    with np.errstate(invalid="ignore"):
        assert not np.isfinite(Jet((np.array([-1.0]), np.array([1.0]))).sqrt().value[0]).all()


@pytest.mark.parametrize("geometry", [PAPER, TOOL])
@pytest.mark.parametrize("width", [0.0, 1e-3, 5.0, 60.0])
def test_boxes_enclose_sensitivities_rods_and_slopes(geometry: Geometry, width: float) -> None:
    rng = np.random.default_rng(2)
    low = np.array([[0], [0], [685.0]]) + rng.uniform(-80, 80, (3, 400))
    high = low + width
    boxes = enclose(low, high, geometry, True)
    points = np.clip(low + rng.random(low.shape) * width, low, high).T
    poses, rods, _ = tricept.inverse(points, geometry)
    A = np.moveaxis(tricept.matrices(poses[:, 0], geometry).A35, 0, -1)
    room = 1e-13  # of the values computed here; the enclosures need none
    assert (boxes.A.value[0] <= A + room).all()
    assert (boxes.A.value[1] >= A - room).all()
    assert (boxes.rods.value[0] <= rods[:, 0].T + 1e-11).all()
    assert (boxes.rods.value[1] >= rods[:, 0].T - 1e-11).all()
    assert boxes.A.slope is not None
    h = 1e-3
    for n, e in enumerate(np.eye(3)):
        ends = [
            tricept.matrices(tricept.inverse(points + s * h * e, geometry)[0][:, 0], geometry).A35
            for s in (1, -1)
        ]
        slope = np.moveaxis((ends[0] - ends[1]) / (2 * h), 0, -1)
        assert (boxes.A.slope[0][n] <= slope + 1e-9).all()
        assert (boxes.A.slope[1][n] >= slope - 1e-9).all()


def test_constants_of_a_program_are_enclosed() -> None:
    root = Jet((np.array([2.0]), np.array([2.0]))) * float(np.sqrt(3.0))
    low, high = (Fraction(float(end[0])) / 2 for end in root.value)
    assert low**2 < 3 < high**2
    low, high = (Fraction(float(end)) for end in (exact(1.0) * (2.0 * float(np.sqrt(3.0)) / 3.0)).value)
    assert low**2 < Fraction(4, 3) < high**2
    low, high = (exact(1.0) - 0.1).value
    assert Fraction(float(low)) < Fraction(9, 10) < Fraction(float(high))
    assert exact(0.1).value == (0.1, 0.1)


def exactly(point: np.ndarray, geometry: Geometry) -> tuple[Any, Any]:
    """A35 and the rods by the distances from joint to joint: 50 digits and differences, no formula of the paper."""
    r, R, *q = (mp.mpf(x) for x in (geometry.r, geometry.R, *geometry.q))
    directions = [(1, 0), (-mp.mpf(1) / 2, mp.sqrt(3) / 2), (-mp.mpf(1) / 2, -mp.sqrt(3) / 2)]

    def turned(alpha: Any, beta: Any, v: Any) -> list[Any]:
        y, z = v[1] * mp.cos(alpha) + v[2] * mp.sin(alpha), v[2] * mp.cos(alpha) - v[1] * mp.sin(alpha)
        return [v[0] * mp.cos(beta) + z * mp.sin(beta), y, z * mp.cos(beta) - v[0] * mp.sin(beta)]

    def place(alpha: Any, beta: Any, z: Any) -> list[Any]:
        return turned(alpha, beta, (q[0], q[1], q[2] + z))

    def rods(alpha: Any, beta: Any, z: Any, r: Any, R: Any) -> list[Any]:
        ends = [(turned(alpha, beta, (r * c, r * s, z)), (R * c, R * s, 0)) for c, s in directions]
        return [mp.norm(mp.matrix(joint) - mp.matrix(base)) for joint, base in ends]

    def derivatives(f: Any, x: Any) -> Any:
        h = mp.mpf(10) ** -20  # the rest is of the order of 1e-30
        ends = [[f(*[a + s * h * (j == k) for j, a in enumerate(x)]) for s in (1, -1)] for k in range(len(x))]
        return mp.matrix([[(a - b) / (2 * h) for a, b in zip(*pair, strict=True)] for pair in ends]).T

    start = tricept.inverse(point, geometry)[0][0]
    pose = mp.findroot(
        lambda *x: [a - b for a, b in zip(place(*x), point.tolist(), strict=True)], list(start)
    )
    by_rods = derivatives(place, pose) * derivatives(lambda *x: rods(*x, r, R), pose) ** -1
    by_radii = -by_rods * derivatives(lambda *x: rods(*pose, *x), (r, R))
    A = [[*by_rods[i, :], *by_radii[i, :]] for i in range(3)]
    return np.array(A), np.array(rods(*pose, r, R))


@pytest.mark.parametrize("geometry", [PAPER, TOOL])
def test_points_enclose_the_exact_sensitivities_and_rods(geometry: Geometry) -> None:
    points = np.array([[30.0, -45.0, 700.0], [0.0, 0.0, 650.0], [-79.0, 61.0, 610.0]])
    boxes = enclose(points.T, points.T, geometry, False)
    with mp.workdps(50):
        for n, point in enumerate(points):
            for (low, high), values in zip(
                (boxes.A.value, boxes.rods.value), exactly(point, geometry), strict=True
            ):
                assert (low[..., n] <= values).all()
                assert (values <= high[..., n]).all()
                # some 200 steps, each widened by 2^-50 of numbers that may be 1e3 times as large
                assert (high - low < 1e-10).all()


def test_extremes_of_known_functions_are_found() -> None:
    def function(lower: np.ndarray, upper: np.ndarray, slopes: bool, which: object = None) -> Jet:
        unit = np.zeros((3, 3, lower.shape[1])) + np.eye(3)[:, :, None]
        x, y, z = (Jet((lower[n], upper[n]), (unit[n], unit[n]) if slopes else None) for n in range(3))
        made = stack(
            [
                (x - 0.3).square()
                + (y + 0.2).square()
                + z.square() * 2.0,  # least inside, greatest in a corner
                x * y * z,
                x + y * 2.0 - z,
                (x - 0.25) * (x - 0.25) - (y - 0.5) * (y - 0.5) + z,  # saddle: extremes on faces
            ]
        )
        return made if which is None else made[which, np.arange(lower.shape[1])]

    low, high = np.array([-1.0, -1.0, -1.0]), np.array([1.0, 2.0, 1.0])
    answer = certified_extremes(function, low, high, gap=np.full(4, 1e-7))
    exact = np.array([[0, 1.69 + 4.84 + 2], [-2, 2], [-4, 6], [-2.25 - 1, 1.5625 + 1]])
    assert answer.complete
    assert (answer.outer[:, 0] <= exact[:, 0]).all()
    assert (answer.outer[:, 1] >= exact[:, 1]).all()
    np.testing.assert_allclose(answer.outer, exact, atol=3e-7)
    np.testing.assert_allclose(answer.inner, exact, atol=3e-7)
    again = certified_extremes(function, low, high, gap=np.full(4, 1e-7), most_boxes=1)
    assert not again.complete
    assert (again.outer[:, 0] <= exact[:, 0]).all()
    assert (again.outer[:, 1] >= exact[:, 1]).all()


# the range ---------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_ranges_and_base_sums_are_those_of_another_program(found: tricept.Bounds) -> None:
    assert found.complete
    for n, name in enumerate(ELEMENTS):
        # figures of five digits; certified bounds are wider by the gap, 1e-3 of the greatest magnitude
        size = max(np.abs(RANGES[name]))
        np.testing.assert_allclose(found.inner[n], RANGES[name], atol=1e-4 * size)
        np.testing.assert_allclose(found.outer[n], RANGES[name], atol=1.1e-3 * size)
        base = max(np.abs(BASE_SUMS[name]))
        np.testing.assert_allclose(found.base_inner[n], BASE_SUMS[name], atol=1e-4 * base)
        np.testing.assert_allclose(found.base_outer[n], BASE_SUMS[name], atol=1.1e-3 * base)


@pytest.mark.thorough
def test_outer_is_outside_inner_and_points_reach_it(found: tricept.Bounds) -> None:
    assert (found.outer[:, 0] <= found.inner[:, 0]).all()
    assert (found.outer[:, 1] >= found.inner[:, 1]).all()
    assert (found.base_outer[:, 0] <= found.outer[:, 0]).all()
    assert (found.base_outer[:, 1] >= found.outer[:, 1]).all()
    assert ((found.points >= LOW) & (found.points <= HIGH)).all()
    for n in range(6):
        reached = elements(found.points[n])[:, n]
        np.testing.assert_allclose(reached, found.inner[n], rtol=1e-9, atol=1e-18)


@pytest.mark.thorough
def test_no_sample_is_outside(found: tricept.Bounds) -> None:
    rng = np.random.default_rng(3)
    inside = rng.uniform(LOW, HIGH, (200_000, 3))
    # half of the samples on faces, edges and corners, where extremes are
    ends = np.where(rng.random((100_000, 3)) < 0.5, LOW, HIGH)
    inside[::2] = np.where(rng.random((100_000, 3)) < 0.6, ends, inside[::2])
    values = elements(inside)
    assert (values >= found.outer[:, 0]).all()
    assert (values <= found.outer[:, 1]).all()


def test_correlated_covariance_and_tool_offset() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(5, 5)) * 0.004
    U_x = root @ root.T
    low, high = np.array([0.0, 10.0, 650.0]), np.array([15.0, 25.0, 665.0])
    bounds = tricept.bounds(low, high, TOOL, U_x, gap=1e-2)
    values = elements(rng.uniform(low, high, (20_000, 3)), U_x, TOOL)
    assert (values >= bounds.outer[:, 0]).all()
    assert (values <= bounds.outer[:, 1]).all()
    spread = np.ptp(values, axis=0)
    assert (np.diff(bounds.inner, axis=1)[:, 0] >= spread * 0.99).all()
    assert (np.diff(bounds.base_outer, axis=1) >= np.diff(bounds.outer, axis=1)).all()


def test_eq_24_is_an_enclosure_near_the_base_sums_and_not_the_range(found: tricept.Bounds) -> None:
    for n, name in enumerate(ELEMENTS):
        low, high = PRINTED[name]
        assert low < found.inner[n, 0]
        assert high > found.inner[n, 1]
        # the diagonal to the printed digits but one; the others are 0.7 to 1.1 % less than the sums
        size = max(abs(low), abs(high))
        np.testing.assert_allclose([low, high], found.base_inner[n], atol=0.011 * size)
    assert found.excess[2] > 3.5
    assert (found.excess[3:] > 2.6).all()


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ([0, 0, 0], [1, 1, 1]),
        ([-50, -50, -10], [50, 50, 10]),
        ([1, 0, 600], [0, 1, 601]),
        ([0, 0], [1, 1]),
        ([np.nan, 0, 600], [1, 1, 601]),
    ],
)
def test_boxes_that_are_none_are_refused(refuses, low: list, high: list) -> None:
    refuses(tricept.bounds, low, high, PAPER, U_PAPER)


def test_what_is_no_covariance_is_refused(refuses) -> None:
    refuses(tricept.bounds, LOW, HIGH, PAPER, np.eye(5) - 0.5)


# cubes -------------------------------------------------------------------------------------------------


def test_largest_cube_on_the_axis_is_not_that_of_eq_24() -> None:
    centre, edge = 683.139, 182.704  # as docs/mechanisms/tricept.md says of it
    low, high = (np.array([0, 0, centre]) + side * edge / 2 for side in (-1, 1))
    rods = tricept.rod_bounds(low, high, PAPER).outer
    assert rods.min() >= LEG_LIMITS[0]
    assert rods.max() <= LEG_LIMITS[1]
    # a cube that is a little larger is not inside, wherever its centre on the axis is
    for z in np.linspace(centre - 2, centre + 2, 81):
        larger = (edge + 2e-3) / 2
        corners = np.stack(np.meshgrid(*[[-larger, larger]] * 3), -1).reshape(-1, 3) + np.array([0, 0, z])
        rods = tricept.inverse(corners, PAPER)[1][:, 0]
        assert rods.min() < LEG_LIMITS[0] or rods.max() > LEG_LIMITS[1]


def test_corners_do_not_suffice_for_the_shortest_rod() -> None:
    rods = tricept.rod_bounds(LOW, HIGH, PAPER)
    corners = np.stack(np.meshgrid(*zip(LOW, HIGH, strict=True)), -1).reshape(-1, 3)
    at_corners = tricept.inverse(corners, PAPER)[1][:, 0]
    # the rod A is shortest in the middle of an edge
    assert rods.inner[0, 0] < at_corners[:, 0].min() - 1
    np.testing.assert_allclose(rods.points[0, 0], [80, 0, 605], atol=1e-6)
    np.testing.assert_allclose(rods.outer[:, 1], at_corners.max(axis=0), atol=1e-5)


def test_the_pages_table_is_what_is_computed(found: tricept.Bounds) -> None:
    page = (
        (Path(__file__).parent.parent / "docs/mechanisms/tricept.md")
        .read_text(encoding="utf-8")
        .replace("−", "-")
    )
    for n, name in enumerate(ELEMENTS):
        row = next(line for line in page.splitlines() if line.startswith(f"| {name} |"))
        numbers = [[float(x) for x in cell.split(" … ")] for cell in row.split("|")[2:7] if "…" in cell]
        size = 1e6 * np.abs(found.inner[n]).max()
        for shown, here, room in (
            (numbers[0], 1e6 * np.array(PRINTED[name]), 1e-9),
            (numbers[1], 1e6 * found.base_inner[n], 1e-3 * size),
            (numbers[2], 1e6 * found.outer[n], 1.1e-3 * size),
            (numbers[3], 1e6 * found.inner[n], 1e-4 * size),
        ):
            np.testing.assert_allclose(shown, here, atol=room)


@pytest.mark.thorough
def test_a_grid_of_beams_gives_what_the_paper_prints_within_the_certified_sums(found: tricept.Bounds) -> None:
    step = 0.36
    angles = np.radians((np.arange(-24, 24) + 0.5) * step)
    beams = np.stack(np.meshgrid(angles, angles), -1).reshape(-1, 2)
    base = np.column_stack([beams, np.zeros(len(beams))])
    start = tricept.point(base, PAPER)
    along = tricept.point(base + np.array([0, 0, 1]), PAPER) - start
    ends = np.sort([(LOW - start) / along, (HIGH - start) / along], axis=0)
    enter, leave = ends[0].max(axis=-1), ends[1].min(axis=-1)
    some = enter < leave
    # 0.4 mm apart at most: beside a stationary value the nearest is less off than the digits printed
    z = enter[some] + (leave - enter)[some] * np.linspace(0, 1, 401)[:, None]
    poses = np.concatenate([np.broadcast_to(beams[some], (*z.shape, 2)), z[..., None]], axis=-1)
    A = tricept.matrices(poses, PAPER).A35
    for n, (element, printed) in enumerate(PRINTED.items()):
        k, m = ELEMENTS[element]
        influences = (A[..., k, :] * A[..., m, :]).reshape(-1, 5)
        total = np.diag(U_PAPER) @ np.stack([influences.min(axis=0), influences.max(axis=0)], axis=-1)
        assert found.base_outer[n, 0] <= total[0] <= total[1] <= found.base_outer[n, 1]
        if n < 3:  # printed in units of 1e-7 mm²
            assert (np.round(total, 7) == np.round(printed, 7)).all(), element
        else:
            np.testing.assert_allclose(total, printed, rtol=3e-3)


@pytest.mark.parametrize("gap", [0.0, -1.0, np.nan, np.inf])
def test_a_gap_that_is_none_is_refused(refuses, gap):
    refuses(tricept.bounds, [-1, -1, 700], [1, 1, 701], tricept.PAPER, np.eye(5) * 1e-6, gap=gap)


def test_a_box_behind_the_base_is_refused(refuses):
    refuses(tricept.bounds, [-80, -80, -765], [80, 80, -605], tricept.PAPER, np.eye(5) * 1e-6)
