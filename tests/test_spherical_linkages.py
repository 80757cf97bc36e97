"""Spherical quadrilateral and pentagon: against rotation matrices, a numeric search, and where they degenerate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import fsolve

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import PolygonStatus

EPS = float(np.finfo(float).eps)
CLOSED = 16 * EPS
"""Some forty products and sums in the joint angles and in the product of all rotations; measured 6 on 2e5 polygons."""
LINKAGES = pytest.mark.parametrize("n", [4, 5])


def close(alpha: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The function for as many twists; given are the last joint angles."""
    if np.shape(alpha)[-1] == 4:
        return spatial.spherical_quadrilateral(alpha, given[..., 0])
    return spatial.spherical_pentagon(alpha, given[..., 0], given[..., 1])


def rotations(angle: np.ndarray, axis: int) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((*np.shape(angle), 3, 3))
    i, j = [k for k in range(3) if k != axis]
    found[..., axis, axis] = 1
    found[..., i, i] = found[..., j, j] = c
    found[..., i, j], found[..., j, i] = -s, s
    return found


def misfit(alpha: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """How far the product of all rotations is from the unit matrix."""
    whole = np.eye(3)
    for j in range(alpha.shape[-1]):
        whole = whole @ rotations(theta[..., j], 2) @ rotations(alpha[..., j], 0)
    return np.abs(whole - np.eye(3)).max(axis=(-2, -1))


def closed(n: int, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Twists of either sign and joint angles of polygons that are closed."""
    rng = np.random.default_rng(seed)
    alpha, theta = rng.uniform(-np.pi, np.pi, size=(2, count, n))
    chain = rotations(alpha[:, 0], 0)
    for j in range(1, n - 1):
        chain = chain @ rotations(theta[:, j], 2) @ rotations(alpha[:, j], 0)
    sign = rng.choice([-1, 1], size=count)
    sine = sign * np.hypot(chain[:, 0, 2], chain[:, 1, 2])
    alpha[:, n - 1] = np.arctan2(sine, chain[:, 2, 2])
    theta[:, 0] = np.arctan2(chain[:, 0, 2] * sign, chain[:, 1, 2] * sign)
    rest = rotations(alpha[:, n - 1], 0) @ rotations(theta[:, 0], 2) @ chain
    theta[:, n - 1] = np.arctan2(-rest[:, 1, 0], rest[:, 0, 0])
    assert (misfit(alpha, theta) < 1e-13).all()
    return alpha, theta


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@LINKAGES
def test_both_ways_close_and_one_is_the_polygon_they_are_made_of(n: int) -> None:
    alpha, theta = closed(n, 20_000, n)
    found, status = close(alpha, theta[:, 3:])
    assert (status <= PolygonStatus.DOUBLE).all()
    assert np.array_equal(found[..., 3:], np.repeat(theta[:, None, 3:], 2, axis=1))
    assert (np.abs(found[..., :3]) <= np.pi).all()
    assert misfit(alpha[:, None], found).max() < CLOSED
    off = apart(found, theta[:, None]).min(axis=1)
    assert np.median(off) < 8 * EPS
    assert off.max() < np.sqrt(
        64 * EPS
    )  # where the two ways all but meet, an angle takes the root of the rounding


@LINKAGES
def test_fsolve_from_many_starts_finds_no_third_way(n: int) -> None:
    alpha, theta = closed(n, 12, 10 + n)
    found, status = close(alpha, theta[:, 3:])
    assert (status == PolygonStatus.TWO).all()
    rng = np.random.default_rng(n)
    for k in range(len(alpha)):

        def equations(x: np.ndarray, k: int = k) -> np.ndarray:
            angles, whole = np.append(x, theta[k, 3:]), np.eye(3)
            for t, a in zip(angles, alpha[k], strict=True):
                whole = whole @ rotations(t, 2) @ rotations(a, 0)
            return np.array([whole[2, 1] - whole[1, 2], whole[0, 2] - whole[2, 0], whole[1, 0] - whole[0, 1]])

        seen = set()
        for number, start in enumerate(rng.uniform(-np.pi, np.pi, size=(300, 3))):
            x, _, success, _ = fsolve(equations, start, xtol=1e-13, full_output=True)
            angles = np.append(x, theta[k, 3:])
            if success == 1 and misfit(alpha[k], angles) < 1e-9:  # a half turn satisfies the equations, too
                distance = apart(found[k], angles)
                assert distance.min() < 1e-6
                seen.add(int(distance.argmin()))
            if number > 25 and len(seen) == 2:
                break
        assert seen == {0, 1}


def test_worked_example() -> None:
    """The course's figures for alpha = 40, 70, 85, 70 and theta_4 = 75 degrees."""
    alpha = np.radians([40, 70, 85, 70])
    A, B = (np.sin(alpha[0]) * spatial.notation(f"{x}_4", alpha, [0, 0, 0, np.radians(75)]) for x in "YX")
    D = np.cos(alpha[0]) * spatial.notation("Z_4", alpha, [0, 0, 0, np.radians(75)]) - np.cos(alpha[1])
    assert np.abs(np.array([A, B, D]) - [-0.1093, 0.6185, -0.5048]).max() < 5e-5
    theta, status = spatial.spherical_quadrilateral(alpha, np.radians(75))
    assert status == PolygonStatus.TWO
    assert np.abs(np.degrees(theta[1, :3]) - [63.5047, 38.2302, 87.7179]).max() < 5e-5
    assert np.abs(np.degrees(theta[0, :3]) - [136.5430, -38.2302, 135.7593]).max() < 5e-5


HALF = np.pi / 2
DEGENERATE = [
    # twists, given angles, status
    ([0.3, 0.2, 1.5, 1.5], [0.0], PolygonStatus.NONE),  # joints 1 and 3 are 3 rad apart
    ([0.2, 0.3, 1.5, 0.4, 1.0], [0.3, 0.4], PolygonStatus.NONE),
    ([0.6, 0.8, 0.5, 0.9], [0.0], PolygonStatus.DOUBLE),  # stretched, 0.6 + 0.8 = 0.5 + 0.9
    ([0.6, 0.2, 0.5, 0.1, 0.2], [0.0, 0.0], PolygonStatus.DOUBLE),
    ([0.8, 0.8, 0.6, 0.6], [np.pi], PolygonStatus.FAMILY),  # joint 3 lies on joint 1
    ([HALF, HALF, HALF, HALF], [np.pi], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.3, 0.4], [0.0], PolygonStatus.FAMILY),  # joint 2 lies on joint 1
    ([np.pi, 0.7, np.pi - 0.3, -0.4], [0.0], PolygonStatus.FAMILY),
    ([0.7, 0.0, 0.3, 0.4], [0.0], PolygonStatus.FAMILY),  # joint 3 lies on joint 2
    ([0.7, np.pi, 0.3, 0.4 - np.pi], [0.0], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.9, 0.4], [2.0], PolygonStatus.NONE),
    ([0.0, 0.0, 0.4, 0.4], [np.pi], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.4, 0.1, 0.2], [0.0, 0.0], PolygonStatus.FAMILY),
    ([0.7, 0.0, 0.4, 0.1, 0.2], [0.0, 0.0], PolygonStatus.FAMILY),
    ([0.8, 0.8, 0.5, 0.2, 0.7], [0.0, np.pi], PolygonStatus.FAMILY),  # joint 3 on joint 1: folded back
    ([0.5, np.nan, 0.9, 1.1], [1.0], PolygonStatus.INVALID),
    ([0.5, 0.7, 0.9, 1.1], [np.inf], PolygonStatus.INVALID),
    ([0.5, 0.7, 0.9, 1.1, 1.0], [1.0, np.nan], PolygonStatus.INVALID),
]


@pytest.mark.parametrize(("alpha", "given", "expected"), DEGENERATE)
def test_degenerate_polygons_have_a_status_and_what_is_given_closes(
    alpha: list[float], given: list[float], expected: PolygonStatus
) -> None:
    theta, status = close(np.array(alpha), np.array(given))
    assert PolygonStatus(int(status)) == expected
    nothing = expected in (PolygonStatus.NONE, PolygonStatus.INVALID)
    assert np.isnan(theta).all() == np.isnan(theta).any() == nothing
    if not nothing:
        assert misfit(np.array(alpha), theta).max() < CLOSED
    if expected == PolygonStatus.DOUBLE:
        assert apart(theta[0], theta[1]) < 1e-12


def test_family_closes_with_other_angles_of_the_joints_that_are_free() -> None:
    """Joint 3 lies on joint 1, opposite to it or not: the two turn together, or against each other."""
    alpha = np.array([0.8, 0.8, 0.6, 0.6])
    theta, _ = spatial.spherical_quadrilateral(alpha, np.pi)
    turns = np.linspace(-3, 3, 7)[:, None]
    together, against = theta[0] + turns * [1, 0, 1, 0], theta[0] + turns * [1, 0, -1, 0]
    assert min(misfit(alpha, together).max(), misfit(alpha, against).max()) < CLOSED


@pytest.mark.parametrize("power", [-3, -6, -9, -12, -15])
def test_small_twists_cost_no_digits(power: int) -> None:
    """Axes that all but coincide: cosines of the twists are 1 to rounding, and the polygon still closes."""
    rng = np.random.default_rng(-power)
    for short in range(4):
        alpha, theta = closed(4, 200, 50 + short)
        alpha[:, short] = 10.0**power * rng.uniform(1, 2, size=200)
        found, status = spatial.spherical_quadrilateral(alpha, theta[:, 3])
        there = status <= PolygonStatus.FAMILY
        assert not np.isnan(found[there]).any()
        if short > 1:  # else it closes for hardly any angle
            assert there.sum() > 50
        assert (misfit(alpha[there, None], found[there]) < CLOSED).all()


numbers = st.one_of(
    st.floats(-7, 7),
    st.integers(-4, 4).map(lambda k: k * HALF),
    st.sampled_from([0.0, 1e-300, 1e-9, 1e-16, np.pi]),
)


@LINKAGES
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_any_finite_input_has_a_status_and_what_is_given_closes(n: int, data: st.DataObject) -> None:
    alpha = data.draw(arrays(float, n, elements=numbers))
    angles = data.draw(arrays(float, n - 3, elements=numbers))
    theta, status = close(alpha, angles)
    assert status in (PolygonStatus.TWO, PolygonStatus.DOUBLE, PolygonStatus.FAMILY, PolygonStatus.NONE)
    assert np.isnan(theta).any() == (status == PolygonStatus.NONE)
    if status != PolygonStatus.NONE:
        # a fold that is open by less than the kernel can tell is taken for closed
        assert misfit(alpha, theta).max() < 128 * EPS


@LINKAGES
def test_float32_and_shapes(n: int) -> None:
    alpha, theta = closed(n, 50, 20 + n)
    found, status = close(alpha.astype(np.float32), theta[:, 3:].astype(np.float32))
    assert (found.dtype, status.dtype, found.shape) == (np.float32, np.int8, (50, 2, n))
    good = status == PolygonStatus.TWO
    assert good.mean() > 0.9
    assert np.median(misfit(alpha[good, None], found[good].astype(float))) < 1e-6
    with pytest.raises(ValueError, match=r"alpha has shape \(\d,\); expected \(\.\.\., \d,?\)"):
        close(np.ones(n + 2), np.ones(2)) if n == 5 else spatial.spherical_quadrilateral(np.ones(6), 1.0)
