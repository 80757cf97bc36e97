"""One axis from many noisy pairs: `rodgen.fit_axis` against independent answers.

Oracles: scipy.optimize.least_squares from many starts, dense grids, finite differences, the Cramér-Rao
bound of the true geometry, and Monte-Carlo draws. Rotations come from scipy.spatial.transform.
"""

from __future__ import annotations

import csv
import functools
import json
import math
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kinematics_cases import unit
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi as chi_distribution
from scipy.stats import f as f_distribution
from scipy.stats import t as student
from work import calls_in

from rodgen.kinematics.axis_fit import AxisFitStatus, fit_axis
from rodgen.kinematics.axis_fit import pairs as pairs_module
from rodgen.kinematics.axis_fit.pairs import (
    Moments,
    maximise_on_sphere,
    residual,
    residual_and_jacobian,
    tangents,
)
from rodgen.kinematics.axis_fit.solve import LOSSES, chi_cut

slow = pytest.mark.slow
EPS = np.finfo(float).eps
POSITIONER = Path(__file__).parent / "data/positioner/data.csv"


def turned(x: np.ndarray, e: np.ndarray, p: Any, angle: Any) -> np.ndarray:
    angle = np.broadcast_to(angle, len(x))
    return np.asarray(p) + Rotation.from_rotvec(angle[:, None] * e).apply(x - np.asarray(p))


AXIS = unit([0.36, -0.48, 0.8])
POINT = np.array([1.0, 2.0, 3.0])


def scene(
    n: int, noise: float, seed: int, angle: Any = None, axis: np.ndarray = AXIS, point: np.ndarray = POINT
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-4, 4, n) if angle is None else np.broadcast_to(float(angle), n)
    x = rng.normal(size=(n, 3)) * 2 + [3, 1, -2]
    y = turned(x, axis, point, angle)
    return x + noise * rng.normal(size=(n, 3)), y + noise * rng.normal(size=(n, 3)), angle


def from_line(fit: Any, point: np.ndarray = POINT, axis: np.ndarray = AXIS) -> float:
    """Distance of the fitted point from the true line."""
    return float(np.linalg.norm(np.cross(fit.point - point, axis)))


# The quadratic on the sphere ----------------------------------------------------------------------


def values(A: np.ndarray, b: np.ndarray, e: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...ij,...j", e, A, e) + (b * e).sum(axis=-1)


@pytest.fixture(scope="module")
def quadratics() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(400, 3, 3))
    return A + A.mT, rng.normal(size=(400, 3)) * 10 ** rng.uniform(-20, 1, size=(400, 1))


def test_stationary_to_rounding(quadratics: tuple[np.ndarray, np.ndarray]) -> None:
    A, b = quadratics
    for e in maximise_on_sphere(A, b):
        gradient = 2 * np.einsum("...ij,...j", A, e) + b
        across = gradient - e * (gradient * e).sum(axis=-1, keepdims=True)
        size = np.abs(A).max(axis=(1, 2)) + np.abs(b).max(axis=1)
        assert np.nanmax(np.linalg.norm(across, axis=-1) / size) < 100 * EPS


def test_hard_case_gives_both_signs() -> None:
    A, b = np.diag([3.0, 2.0, 1.0]), np.array([0.0, 1.0, 1.0])
    best, other = maximise_on_sphere(A, b)
    # γ/(λ₁ - λ_k): 0.5/1 and 0.5/2; the first component completes the unit vector.
    expected = [math.sqrt(1 - 0.25 - 0.0625), 0.5, 0.25]
    assert np.abs(best) == pytest.approx(expected, abs=4 * EPS)
    assert other == pytest.approx(best * [-1, 1, 1], abs=4 * EPS)


def test_no_other_maximum_where_the_linear_term_rules() -> None:
    best, other = maximise_on_sphere(np.diag([1.0, 0.5, 0.0]), np.array([0.0, 0.0, 100.0]))
    assert best == pytest.approx([0, 0, 1], abs=EPS)
    assert np.isnan(other).all()


def test_nothing_to_maximise_is_still_a_unit_vector() -> None:
    assert np.linalg.norm(maximise_on_sphere(np.zeros((3, 3)), np.zeros(3)).best) == 1.0


# Residual, moments --------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [1e-6, 1.3, math.pi, -7.0])
def test_residual_vanishes_for_the_rotation_of_another_library(angle: float) -> None:
    x, y, a = scene(20, 0.0, 4, angle)
    assert np.abs(residual(x, y, a, AXIS, POINT)).max() < 30 * EPS * np.abs(x).max()


def test_jacobian_is_the_slope_of_the_residual() -> None:
    x, y, a = scene(20, 0.3, 5)
    d, jacobian = residual_and_jacobian(x, y, a, AXIS, POINT)
    by_axis, by_point = jacobian[..., :3], jacobian[..., 3:]
    assert np.array_equal(d, residual(x, y, a, AXIS, POINT))
    h = 1e-6  # central differences: h² and eps/h both far below 1e-8
    for u in tangents(AXIS).T:
        ahead = residual(x, y, a, unit(AXIS + h * u), POINT) - residual(x, y, a, unit(AXIS - h * u), POINT)
        assert by_axis @ u == pytest.approx(ahead / (2 * h), abs=1e-8)
    for u in np.eye(3):
        ahead = residual(x, y, a, AXIS, POINT + h * u) - residual(x, y, a, AXIS, POINT - h * u)
        assert by_point @ u == pytest.approx(ahead / (2 * h), abs=1e-8)


@pytest.mark.parametrize("point", [None, POINT])
def test_sum_of_squares_is_a_quadratic_in_the_axis(point: np.ndarray | None) -> None:
    """With a free point at its best for each axis, too: what makes the fit global without iteration."""
    x, y, a = scene(9, 0.5, 6)
    w = np.linspace(0.2, 1, 9)
    moments = Moments.of(x, y, a, w, point)
    A, b = moments.quadratic()
    rng = np.random.default_rng(7)
    sums = []
    for e in map(unit, rng.normal(size=(20, 3))):
        p = moments.point(e)
        half = 0.5 * (w[:, None] * residual(x, y, a, e, p) ** 2).sum()
        sums.append(half + values(A, b, e))
        for q in p + 0.1 * rng.normal(size=(5, 3)):
            other = 0.5 * (w[:, None] * residual(x, y, a, e, q) ** 2).sum()
            assert point is not None or other >= half
    assert np.ptp(sums) < 1e-13 * max(sums)  # a sum of 27 squares of order 10


# Maximum likelihood -------------------------------------------------------------------------------


def by_scipy(x: np.ndarray, y: np.ndarray, a: np.ndarray, known: bool, seed: int, scale: np.ndarray) -> Any:
    """Best of twelve starts; the axis as an unnormalised vector, the point anywhere on it."""

    def misses(v: np.ndarray) -> np.ndarray:
        p = POINT if known else v[3:]
        e = unit(v[:3])
        return ((y - p - Rotation.from_rotvec(a[:, None] * e).apply(x - p)) * scale[:, None]).ravel()

    rng = np.random.default_rng(seed)
    starts = [np.r_[rng.normal(size=3), rng.normal(size=0 if known else 3) * 5] for _ in range(12)]
    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": 1.0, "jac": "3-point"}
    return min((least_squares(misses, start, **tight) for start in starts), key=lambda r: r.cost)


@pytest.mark.thorough("1.5-None-True", "0.3-2.9-True", "0.01-None-True")
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize(("noise", "angle"), [(0.01, None), (1.5, None), (0.01, 0.3), (0.3, 2.9)])
def test_agrees_with_the_best_of_many_scipy_starts(known: bool, noise: float, angle: float | None) -> None:
    x, y, a = scene(8, noise, 9, angle)
    w = np.linspace(0.3, 1, 8)
    oracle = by_scipy(x, y, a, known, 10, np.sqrt(w))
    fit = fit_axis(x, y, a, point=POINT if known else "free", weights=w)
    e = unit(oracle.x[:3])
    p = POINT if known else oracle.x[3:]
    cost = 0.5 * (w[:, None] * fit.residuals**2).sum()
    # Costs agree to rounding; scipy's stopping point to the square root of that, times its differences.
    assert cost == pytest.approx(oracle.cost, rel=1e-12)
    assert fit.axis == pytest.approx(e, abs=1e-8 if noise > 1 else 1e-9)
    assert from_line(fit, p, e) < (1e-7 if noise > 1 else 1e-8)


def test_robust_loss_is_stationary() -> None:
    """Σ w(z) Jᵀ d = 0 at the solution, the defining equation of an M-estimate; sigma fixes z."""
    x, y, a = scene(40, 0.05, 11)
    y[::5] += 3
    fit = fit_axis(x, y, a, loss="huber", sigma=0.05)
    d, jacobian = residual_and_jacobian(x, y, a, fit.axis, fit.point)
    z = np.linalg.norm(d, axis=1) / (0.05 * math.sqrt(2))
    share = LOSSES["huber"].weight(z)
    assert fit.weights == pytest.approx(share, abs=1e-9)
    force = share[:, None] * d
    U = tangents(fit.axis)
    pull = np.einsum("ni,nij->j", force, jacobian)
    # Reweighting stops at steps of 1e-12; information times arm² is of order 1e3.
    assert np.abs(np.r_[pull[:3] @ U, pull[3:] @ U]).max() < 1e-8


def test_loss_slope_and_efficiency() -> None:
    kernel = LOSSES["huber"]
    z = np.linspace(0, 12, 120001)
    psi = z * kernel.weight(z)
    middle = (z[1:] + z[:-1]) / 2
    kink = np.abs(middle - 1.6279879) < 1e-3
    assert kernel.slope(middle)[~kink] == pytest.approx(np.diff(psi)[~kink] / np.diff(z)[~kink], abs=1e-6)
    density = chi_distribution(3).pdf(z)
    gain = np.trapezoid((kernel.slope(z) + 2 * kernel.weight(z)) / 3 * density, z)
    spread = np.trapezoid(psi**2 / 3 * density, z)
    assert gain**2 / spread == pytest.approx(0.95, abs=1e-4)  # trapezoids of 1e-4


def test_weight_two_is_the_pair_twice_and_zero_leaves_it_out() -> None:
    x, y, a = scene(10, 0.1, 12)
    w = np.array([2.0, 1, 1, 1, 0, 1, 1, 1, 1, 0])
    twice = np.r_[0, 0:4, 5:9]
    weighted = fit_axis(x, y, a, weights=w, sigma=0.1)
    apart = np.zeros((9, 1))
    apart[0] = 1e-13  # so that it is no reading that stands in two pairs
    repeated = fit_axis(x[twice] + apart, y[twice] + apart, a[twice], sigma=0.1)
    assert weighted.axis == pytest.approx(repeated.axis, abs=1e-13)
    assert weighted.chi_square == pytest.approx(repeated.chi_square, rel=1e-12)
    assert weighted.weights.tolist() == [1, 1, 1, 1, 0, 1, 1, 1, 1, 0]
    # The covariance differs only in the second-order term, (σ/arm)².
    assert weighted.covariance == pytest.approx(repeated.covariance, rel=0.05, abs=1e-7)


def test_sigma_a_pair_is_a_weight_with_a_scale() -> None:
    x, y, a = scene(10, 0.1, 13)
    sigma = np.linspace(0.05, 0.3, 10)
    by_sigma = fit_axis(x, y, a, sigma=sigma)
    by_weight = fit_axis(x, y, a, weights=0.1**2 / sigma**2, sigma=0.1)
    assert by_sigma.axis == pytest.approx(by_weight.axis, abs=1e-14)
    assert by_sigma.covariance == pytest.approx(by_weight.covariance, rel=1e-10)
    assert by_sigma.sigma == pytest.approx(math.sqrt(np.mean(sigma**2)))


# Uncertainty --------------------------------------------------------------------------------------


def line_covariance(fit: Any, U: np.ndarray) -> np.ndarray:
    """Covariance of what :func:`errors_of` takes: the fitted line where it meets the plane through POINT."""
    along = float(AXIS @ (fit.point - POINT))
    T = np.block([[U.T, np.zeros((2, 3))], [-along * U.T, U.T]])
    return T @ fit.covariance @ T.T


@functools.cache
def draws(n: int, noise: float, count: int, angle: Any = None, spread: float = 2.0, **options: Any) -> Any:
    """Fits of the same pairs with other noise; tests with the same arguments share them."""
    rng = np.random.default_rng(20)
    angle = rng.uniform(-4, 4, n) if angle is None else np.broadcast_to(float(angle), n)
    x = rng.normal(size=(n, 3)) * spread + [3, 1, -2]
    y = turned(x, AXIS, POINT, angle)
    fits = []
    bad = int(options.pop("bad", 0) * n)
    for _ in range(count):
        seen, then = x + noise * rng.normal(size=(n, 3)), y + noise * rng.normal(size=(n, 3))
        then[:bad] += 30 * noise * rng.normal(size=(bad, 3)) * rng.choice([0.3, 1, 20], size=(bad, 1))
        fits.append(fit_axis(seen, then, angle, **options))
    return x, angle, fits


def mahalanobis(fits: list[Any], U: np.ndarray) -> np.ndarray:
    """(T,) squared errors in units of the stated covariance; F times 4 distributed."""
    out = []
    for fit in fits:
        along = float(AXIS @ (fit.point - POINT))
        error = np.r_[(fit.axis - AXIS) @ U, (fit.point - POINT - along * fit.axis) @ U]
        out.append(error @ np.linalg.solve(line_covariance(fit, U), error))
    return np.array(out)


MANY = 1300
"""Draws of which a share can be told from others; fewer tell a gross fault."""


def binomial(count: int) -> float:
    """Half-width of the 99.9 % interval of an observed 95 % share."""
    return 3.29 * math.sqrt(0.95 * 0.05 / count)


@pytest.mark.parametrize("count", [300, pytest.param(MANY, marks=slow)])
@pytest.mark.parametrize(
    ("n", "noise", "options"),
    [
        pytest.param(12, 0.01, {}, id="estimated"),
        pytest.param(4, 0.01, {}, id="four pairs", marks=slow),
        pytest.param(12, 0.01, {"sigma": 0.01}, id="given", marks=slow),
        pytest.param(30, 0.3, {"sigma": 0.3}, id="noise a tenth of the arm", marks=slow),
        pytest.param(200, 0.02, {"angle": 0.01, "sigma": 0.02}, id="small angle", marks=slow),
        pytest.param(300, 0.3, {"sigma": 0.3, "spread": 0.3}, id="arm as small as the noise"),
    ],
)
def test_95_percent_regions_hold_95_percent(
    n: int, noise: float, options: dict[str, Any], count: int
) -> None:
    U = tangents(AXIS)
    _, _, fits = draws(n, noise, count, **options)
    squares = mahalanobis(fits, U)
    limit = 4 * f_distribution.ppf(0.95, 4, 1e9 if "sigma" in options else 3 * n - 4)
    share = np.mean(squares < limit)
    assert binomial(MANY) < 0.02  # 93 to 97 % is what the interval means
    assert share == pytest.approx(0.95, abs=binomial(count))


def robust_interval_share(loss: str, bad: float, count: int, n: int = 60) -> float:
    """Share of components within their 95 % interval; regions are F-distributed only nearly."""
    U = tangents(AXIS)
    _, _, fits = draws(n, 0.01, count, loss=loss, bad=bad)
    z = [((f.axis - AXIS) @ U) / np.sqrt(np.diag(U.T @ f.axis_covariance @ U)) for f in fits]
    return float(np.mean(np.abs(z) < student.ppf(0.975, np.median([f.dof for f in fits]))))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bad", "n", "count"),
    [
        (0.25, 60, 80),
        pytest.param(0.25, 60, 250, marks=slow),
        pytest.param(0.0, 60, 250, marks=slow),
        pytest.param(0.0, 12, 250, marks=slow),
    ],
)
def test_robust_95_percent_intervals(bad: float, n: int, count: int) -> None:
    # Two nearly independent components a draw; 1 % more for the asymptotic formula in small samples.
    share = robust_interval_share("huber", bad, count, n)
    assert share == pytest.approx(0.95, abs=binomial(2 * count) + 0.01)


@pytest.mark.parametrize("count", [250, pytest.param(1000, marks=slow)])
def test_chi_square_has_its_degrees_of_freedom(count: int) -> None:
    _, _, fits = draws(50, 0.01, count, sigma=0.01)
    assert {f.dof for f in fits if not f.outliers.any()} == {146}
    assert np.mean([f.chi_square for f in fits]) == pytest.approx(146, abs=4 * math.sqrt(292 / count) + 0.05)


def test_covariances_have_the_rank_they_say() -> None:
    x, y, a = scene(12, 0.01, 30)
    fit = fit_axis(x, y, a)
    assert fit.axis_covariance @ fit.axis == pytest.approx(np.zeros(3), abs=1e-20)
    values_ = np.linalg.eigvalsh(fit.covariance)
    assert (values_[:2] < 1e-12 * values_[-1]).all()
    assert (values_[2:] > 0).all()
    known = fit_axis(x, y, a, point=POINT)
    assert np.linalg.matrix_rank(known.axis_covariance) == 2
    assert not known.point_covariance.any()
    assert known.point.tolist() == POINT.tolist()


def test_nearest_point_propagates_like_differences(refuses) -> None:
    x, y, a = scene(12, 0.01, 31)
    fit = fit_axis(x, y, a)
    target = np.array([50.0, -20.0, 10.0])
    asked = fit_axis(x, y, a, origin=target)
    place, covariance = asked.point, asked.point_covariance
    assert np.cross(place - fit.point, fit.axis) == pytest.approx(np.zeros(3), abs=1e-12)
    assert (target - place) @ fit.axis == pytest.approx(0, abs=1e-12)

    def moved(v: np.ndarray) -> np.ndarray:
        e, p = unit(fit.axis + v[:3]), fit.point + v[3:]
        return p + e * (e @ (target - p))

    h = 1e-6
    jacobian = np.stack([(moved(h * u) - moved(-h * u)) / (2 * h) for u in np.eye(6)], axis=1)
    assert covariance == pytest.approx(jacobian @ fit.covariance @ jacobian.T, rel=1e-6, abs=1e-12)
    assert asked.candidate_points[0].tolist() == asked.point.tolist()
    refuses(fit_axis, x, y, a, point=POINT, origin=target)
    at_centroid = fit_axis(x, y, a, origin=fit.origin)
    assert at_centroid.point == pytest.approx(fit.point, abs=1e-13)
    assert at_centroid.point_covariance == pytest.approx(fit.point_covariance, abs=1e-18)


def test_condition_is_one_for_the_best_arrangement_and_grows_with_a_short_lever() -> None:
    x = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1.0]]) + POINT
    best = fit_axis(x, turned(x, AXIS, POINT, math.pi), math.pi)
    assert best.condition < 2
    flat = np.array([[1, 0, 0], [1.001, 0, 0], [1, 0.001, 0.0]]) + POINT
    assert fit_axis(flat, turned(flat, AXIS, POINT, 0.5), 0.5).condition > 100


# Outliers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.05, 0.2, 0.3])
@pytest.mark.parametrize("known", [False, True])
def test_gross_errors_are_named_and_do_not_move_the_axis(share: float, known: bool) -> None:
    x, y, a = scene(100, 0.01, 40)
    bad = np.arange(100) < 100 * share
    rng = np.random.default_rng(41)
    y[bad] += rng.normal(size=(int(bad.sum()), 3)) * 5
    fit = fit_axis(x, y, a, loss="huber", point=POINT if known else "free")
    assert np.array_equal(fit.outliers, bad)
    assert fit.sigma == pytest.approx(0.01, rel=0.15)  # 1/sqrt(2·3·70) = 5 %, three of them
    error = np.linalg.norm(fit.axis - AXIS)
    assert error < 5 * fit.axis_uncertainty[0]
    assert fit.axis_uncertainty[0] < 5e-4


def test_conspiring_outliers_lose() -> None:
    """Three pairs in ten that agree among themselves on another axis."""
    x, y, a = scene(60, 0.01, 42)
    y[:18] = turned(x[:18], unit([1, 1, 0]), [5, 5, 5], a[:18])
    fit = fit_axis(x, y, a, loss="huber")
    assert np.array_equal(np.flatnonzero(fit.outliers), np.arange(18))
    assert np.linalg.norm(fit.axis - AXIS) < 5 * fit.axis_uncertainty[0]


def test_linear_loss_names_outliers_but_counts_them() -> None:
    x, y, a = scene(100, 0.01, 44)
    y[17] += 1
    fit = fit_axis(x, y, a)
    assert np.flatnonzero(fit.outliers).tolist() == [17]
    assert fit.weights[17] == 1
    assert any("still count" in sentence for sentence in fit.remarks)


@pytest.mark.slow
def test_good_data_have_an_outlier_once_in_a_hundred() -> None:
    _, _, fits = draws(50, 0.01, 1000, sigma=0.01)
    # 1 % by construction; the fit's own freedoms make it a little rarer.
    assert np.mean([f.outliers.any() for f in fits]) < 0.01 + 3.29 * math.sqrt(0.01 / 1000)
    assert 1 - chi_distribution(3).cdf(chi_cut(50)) == pytest.approx(0.01 / 50, rel=1e-6)


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_same_answer_every_time_and_in_any_order(loss: str) -> None:
    x, y, a = scene(300, 0.01, 45)
    y[::4] += 2
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - it is the global state that must not be touched
    first, again = fit_axis(x, y, a, loss=loss), fit_axis(x, y, a, loss=loss)
    assert np.array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    assert np.array_equal(first.axis, again.axis)
    order = np.random.default_rng(46).permutation(300)
    shuffled = fit_axis(x[order], y[order], a[order], loss=loss)
    assert shuffled.axis == pytest.approx(first.axis, abs=1e-9)


@pytest.mark.parametrize("sigma", [None, 0.01])
@pytest.mark.parametrize("known", [False, True])
def test_the_fewest_pairs_and_one_gross_error_name_it(sigma: float | None, known: bool) -> None:
    """Three good pairs determine an axis with a free point, two one through a known point."""
    before = np.array([[100, 0, 0], [0, 100, 0], [0, 0, 100], [60, 60, 60]])[known:].astype(float)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        after = turned(before, AXIS, POINT, 1.0) + 0.01 * rng.normal(size=before.shape)
        bad = seed % len(before)
        after[bad, seed % 3] += 5
        fit = fit_axis(before, after, 1.0, loss="huber", sigma=sigma, point=POINT if known else "free")
        assert fit.outliers[bad]


@pytest.mark.parametrize(("n", "reversed_"), [(6, 3), (8, 4), (10, 4), (20, 6), (60, 30)])
def test_pairs_with_two_answers_are_reported(n: int, reversed_: int) -> None:
    """Signs of angles reversed from three in ten to half: whichever axis is taken, a remark says so."""
    for seed in range(8):
        x, y, a = scene(n, 0.01, 500 + seed, 1.0)
        a = np.where(np.arange(n) < reversed_, -a, a)
        remarks = fit_axis(x * 10, y * 10, a, loss="huber").remarks
        told = [sentence for sentence in remarks if f"of {n} pairs contradict" in sentence]
        assert len(told) == 1
        assert "not safe" in told[0]
        if n >= 8:
            assert "they agree with one another on the opposite axis" in told[0]


@pytest.mark.thorough("6")
@pytest.mark.parametrize("n", [6, pytest.param(8, marks=slow), 30])
def test_good_pairs_rarely_contradict(n: int) -> None:
    fits = [fit_axis(*scene(n, 0.01, 900 + seed), loss="huber") for seed in range(40)]
    # Six pairs with two outliers by chance: one data set in a hundred.
    assert sum("contradict" in " ".join(fit.remarks) for fit in fits) <= (2 if n < 8 else 0)


def test_groups_of_repeated_readings_do_not_contradict() -> None:
    """Readings of one ball agree with one another on many axes: that is no second answer."""
    rng = np.random.default_rng(50)
    balls = np.repeat([[30.0, 0, 0], [0, 40.0, 5], [-20, 9, 60]], 4, axis=0)
    after = turned(balls, AXIS, POINT, 1.0) + np.repeat(rng.normal(size=(3, 3)) * 0.01, 4, axis=0)
    fit = fit_axis(balls, after, 1.0, loss="huber")
    assert "contradict" not in " ".join(fit.remarks)


def test_exact_pairs_and_one_gross_error() -> None:
    x, y, a = scene(20, 0.0, 47)
    y[3] += 7
    fit = fit_axis(x, y, a, loss="huber")
    assert np.flatnonzero(fit.outliers).tolist() == [3]
    assert fit.axis == pytest.approx(AXIS, abs=1e-14)


# Exact pairs: accuracy over angles and lengths ----------------------------------------------------


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize(
    "angle", [1e-8, 1e-4, 0.5, -2.0, math.pi - 1e-8, 4.0, 2 * math.pi - 1e-3, 50.0, "mixed"]
)
def test_exact_pairs_give_the_axis_to_rounding(angle: Any, known: bool) -> None:
    point = np.zeros(3) if known else POINT
    if angle == "mixed":
        angle = np.array([1e-3, -1e-3, 0.1, 3.1, math.pi, 7.0, -2.0, 0.5])
    rng = np.random.default_rng(50)
    x = rng.normal(size=(8, 3))
    half = np.asarray(angle) / 2
    y = turned(x, AXIS, point, angle)
    if np.ndim(angle) == 0 and abs(angle) < 1e-3:
        # The rotation of another library rounds what a small angle adds; build it from the difference.
        y = (
            x
            + np.sin(angle) * np.cross(AXIS, x - point)
            + 2 * np.sin(half) ** 2 * np.cross(AXIS, np.cross(AXIS, x - point))
        )
    fit = fit_axis(x, y, angle, point=point if known else "free")
    # The rounding of y, eps·5, is a turn of that over the angle; a few of them.
    limit = 40 * EPS / max(abs(np.sin(half)).max(), 1e-300)
    sign = 1.0
    if fit.status is AxisFitStatus.SIGN_FREE:
        sign = np.sign(fit.axis @ AXIS)
    assert np.abs(sign * fit.axis - AXIS).max() < limit
    assert np.linalg.norm(fit.axis) == pytest.approx(1, abs=2 * EPS)


@pytest.mark.parametrize("scale", [1e-120, 1e-30, 1e30, 1e120])
@pytest.mark.parametrize("loss", ["linear", "huber"])
@pytest.mark.parametrize("known", [False, True])
def test_lengths_from_tiny_to_huge(scale: float, loss: str, known: bool) -> None:
    x, y, a = scene(20, 0.01, 51)
    plain = fit_axis(x, y, a, sigma=0.01, loss=loss, point=POINT if known else "free")
    scaled = fit_axis(
        x * scale, y * scale, a, sigma=0.01 * scale, loss=loss, point=POINT * scale if known else "free"
    )
    assert scaled.axis == pytest.approx(plain.axis, abs=1e-13)
    assert scaled.point / scale == pytest.approx(plain.point, rel=1e-12)
    assert scaled.rms / scale == pytest.approx(plain.rms, rel=1e-12)
    assert scaled.chi_square == pytest.approx(plain.chi_square, rel=1e-10)
    assert scaled.axis_covariance == pytest.approx(plain.axis_covariance, rel=1e-10, abs=1e-20)
    assert scaled.point_uncertainty / scale == pytest.approx(plain.point_uncertainty, rel=1e-10)


def test_points_far_from_the_origin_cost_only_their_own_rounding() -> None:
    far = np.array([1e8, -2e8, 3e8])
    x, y, a = scene(20, 0.0, 52)
    fit = fit_axis(x + far, y + far, a)
    assert fit.status is AxisFitStatus.DETERMINED
    assert fit.axis == pytest.approx(AXIS, abs=20 * EPS * 3e8)
    assert from_line(fit, POINT + far) < 20 * EPS * 3e8 * 3


# Equivariance -------------------------------------------------------------------------------------

vectors = arrays(float, 3, elements=st.floats(-10, 10))


@settings(max_examples=40, deadline=None)
@given(
    turn=vectors,
    shift=vectors,
    exponent=st.integers(-40, 40),
    loss=st.sampled_from(["linear", "huber"]),
    seed=st.integers(0, 5),
)
def test_turning_shifting_and_scaling_the_data_does_the_same_to_the_fit(
    turn: np.ndarray, shift: np.ndarray, exponent: int, loss: str, seed: int
) -> None:
    x, y, a = scene(12, 0.05, seed)
    y[0] += 4
    R, scale = Rotation.from_rotvec(turn), 10.0**exponent

    def move(v: np.ndarray) -> np.ndarray:
        return scale * (R.apply(v) + shift)

    plain, moved = fit_axis(x, y, a, loss=loss), fit_axis(move(x), move(y), a, loss=loss)
    # Rounding of the moved data, 20 eps, through a condition number of order 10; a hundred times that.
    assert moved.axis == pytest.approx(R.apply(plain.axis), abs=1e-11)
    assert moved.point / scale == pytest.approx(move(plain.point) / scale, abs=1e-10)
    assert moved.sigma / scale == pytest.approx(plain.sigma, rel=1e-10)
    M = R.as_matrix()
    size = np.trace(plain.axis_covariance)
    assert moved.axis_covariance == pytest.approx(M @ plain.axis_covariance @ M.T, abs=1e-9 * size)
    assert np.array_equal(moved.outliers, plain.outliers)
    assert moved.status is plain.status


# What the data do not determine -------------------------------------------------------------------

Z = np.array([0.0, 0.0, 1.0])
ORIGIN = (0.0, 0.0, 0.0)


def test_one_pair_and_a_known_point_return_both_axes() -> None:
    fit = fit_axis([1, 0, 0.5], [0, 1, 0.5], 1.7, point=ORIGIN)
    assert fit.status is AxisFitStatus.TWO_AXES
    assert fit.candidate_axes.shape == (2, 3)
    for e, p in zip(fit.candidate_axes, fit.candidate_points, strict=True):
        assert turned(np.array([[1, 0, 0.5]]), e, p, 1.7)[0] == pytest.approx([0, 1, 0.5], abs=8 * EPS)
    assert np.linalg.norm(fit.candidate_axes[0] - fit.candidate_axes[1]) > 0.5
    assert "two axes" in fit.undetermined[0]
    # Which comes first does not hang on rounding.
    again = fit_axis([1, 0, 0.5 + 1e-15], [0, 1, 0.5], 1.7, point=ORIGIN)
    assert again.axis == pytest.approx(fit.axis, abs=1e-13)


def test_one_direction_and_one_angle_return_both_axes_in_spite_of_noise() -> None:
    rng = np.random.default_rng(60)
    found = 0
    for _ in range(50):
        x = np.outer(np.linspace(1, 2, 50), unit([1, 2, 3]))
        y = turned(x, Z, ORIGIN, 0.7)
        fit = fit_axis(
            x + 1e-3 * rng.normal(size=x.shape), y + 1e-3 * rng.normal(size=x.shape), 0.7, point=ORIGIN
        )
        found += fit.status is AxisFitStatus.TWO_AXES
        assert min(np.linalg.norm(fit.candidate_axes - Z, axis=1)) < 1e-3
    assert found == 50


def test_one_pair_with_a_free_point_turns_about_its_displacement() -> None:
    fit = fit_axis([1, 0, 0], [0, 1, 0], 1.2)
    assert fit.status is AxisFitStatus.ONE_FREEDOM
    assert fit.rms < 4 * EPS
    assert fit.axis @ unit([-1, 1, 0]) == pytest.approx(0, abs=4 * EPS)
    assert np.abs(fit.free_directions[0] @ unit([-1, 1, 0])) < 1e-7
    assert "one pair with a free point" in fit.undetermined[0]
    assert "the point" in fit.undetermined[1]
    assert any("give sigma" in sentence for sentence in fit.remarks)
    assert np.isnan(fit.covariance).all()
    assert math.isinf(fit.condition)


def test_the_same_pair_many_times_is_distinguished_from_noise() -> None:
    rng = np.random.default_rng(61)
    told = []
    for _ in range(100):
        x = np.tile([1.0, 2, 3], (50, 1))
        y = turned(x, Z, ORIGIN, 0.7)
        fit = fit_axis(x + 1e-3 * rng.normal(size=x.shape), y + 1e-3 * rng.normal(size=x.shape), 0.7)
        told.append(fit.status in (AxisFitStatus.ONE_FREEDOM, AxisFitStatus.ANY_AXIS))
    # Missed where chance makes the noise's own curvature three times its standard deviation.
    assert np.mean(told) > 0.9


def test_pure_noise_is_recognised() -> None:
    rng = np.random.default_rng(62)
    told = [
        fit_axis(rng.normal(size=(200, 3)), rng.normal(size=(200, 3)), 1.0).status
        is not AxisFitStatus.DETERMINED
        for _ in range(100)
    ]
    assert np.mean(told) > 0.9


@pytest.mark.parametrize("angle", [0.0, 2 * math.pi, -4 * math.pi])
@pytest.mark.parametrize("point", ["free", ORIGIN])
def test_without_a_turn_nothing_is_determined(angle: float, point: Any) -> None:
    x = np.random.default_rng(63).normal(size=(6, 3))
    fit = fit_axis(x, x, angle, point=point)
    assert fit.status is AxisFitStatus.ANY_AXIS
    assert "all angles are zero or whole turns" in fit.undetermined[0]
    assert len(fit.free_directions) == 2
    assert len(fit.undetermined) == (2 if point == "free" else 1)
    assert np.linalg.norm(fit.axis) == pytest.approx(1)


def test_points_at_the_known_point_determine_nothing() -> None:
    fit = fit_axis(np.zeros((4, 3)), np.zeros((4, 3)), 1.0, point=ORIGIN)
    assert fit.status is AxisFitStatus.ANY_AXIS
    assert "lie at the known point" in fit.undetermined[0]


def test_one_point_at_rest_determines_nothing_but_lies_on_the_axis() -> None:
    fit = fit_axis(np.tile([1.0, 2, 3], (4, 1)), np.tile([1.0, 2, 3], (4, 1)), [1.0, 2, 3, -1])
    assert fit.status is AxisFitStatus.ANY_AXIS
    assert fit.point == pytest.approx([1, 2, 3])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_points_at_rest_along_a_line_are_the_axis_but_not_its_sign(noise: float) -> None:
    rng = np.random.default_rng(64)
    x = POINT + np.linspace(-2, 2, 20)[:, None] * AXIS
    fit = fit_axis(x + noise * rng.normal(size=x.shape), x + noise * rng.normal(size=x.shape), 0.7)
    assert fit.status is AxisFitStatus.SIGN_FREE
    assert np.abs(fit.axis @ AXIS) == pytest.approx(1, abs=1e-5)
    assert "do not move" in fit.undetermined[0]


def test_a_wrong_known_point_is_not_taken_for_points_at_rest() -> None:
    """The residuals of a point far off are as long as the displacements, and hide the sign; the remarks say both."""
    x, y, a = scene(30, 0.01, 66)
    fit = fit_axis(x, y, a, point=POINT + np.array([30, 20, -10]))
    assert fit.status is AxisFitStatus.SIGN_FREE
    moved = math.sqrt(((y - x) ** 2).sum(axis=1).mean())
    assert "lie on the axis" not in fit.undetermined[0]
    assert f"({moved:.3g} and {fit.rms:.3g} rms)" in fit.undetermined[0]
    assert any("is that point on the axis?" in sentence for sentence in fit.remarks)


def test_noise_that_hides_the_sense_of_turns_near_half_ones_leaves_the_sign_free() -> None:
    fit = fit_axis(*scene(30, 0.05, 65, math.pi - 1e-3))
    assert fit.status is AxisFitStatus.SIGN_FREE
    assert "within the noise" in fit.undetermined[0]


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("point", ["free", POINT])
def test_half_turns_have_no_sign(noise: float, point: Any) -> None:
    x, y, a = scene(20, noise, 65, math.pi)
    fit = fit_axis(x, y, a, point=point)
    assert fit.status is AxisFitStatus.SIGN_FREE
    assert "half turns" in fit.undetermined[0]
    assert fit.candidate_axes[1] == pytest.approx(-fit.candidate_axes[0], abs=1e-3)
    assert fit.axis[np.argmax(np.abs(fit.axis))] > 0
    assert np.abs(fit.axis @ AXIS) == pytest.approx(1, abs=1e-5)


def test_half_turn_to_the_opposite_point_allows_a_circle_of_axes() -> None:
    fit = fit_axis([1, 0, 0], [-1, 0, 0], math.pi, point=ORIGIN)
    assert fit.status is AxisFitStatus.ONE_FREEDOM
    assert fit.axis[0] == pytest.approx(0, abs=4 * EPS)
    assert "reverse the points" in fit.undetermined[0]


def test_tangent_angle_merges_the_two_axes() -> None:
    fit = fit_axis([1, 0, 0], [0, 1, 0], math.pi / 2, point=ORIGIN)
    assert fit.status is AxisFitStatus.ONE_FREEDOM
    assert fit.axis == pytest.approx(Z, abs=1e-7)  # the square root of rounding
    assert "merge" in fit.undetermined[0]


def test_two_pairs_of_equal_angle_determine_all() -> None:
    x, y, a = scene(2, 0.0, 66, 0.8)
    fit = fit_axis(x, y, a)
    assert fit.status is AxisFitStatus.DETERMINED
    assert fit.axis == pytest.approx(AXIS, abs=1e-13)
    assert from_line(fit) < 1e-12
    assert fit.dof == 2


@pytest.mark.thorough("3")
@pytest.mark.parametrize("seed", [3, 4, *(pytest.param(n, marks=slow) for n in (0, 1, 2, 5, 6, 7))])
def test_any_mixture_of_degenerate_pairs_is_fitted_as_well_as_can_be(seed: int) -> None:
    """No exception, no warning, a unit axis, plain JSON, and no other line that fits better."""
    rng = np.random.default_rng(seed)
    for _ in range(60):
        n = int(rng.choice([1, 2, 3, 5, 20]))
        e, p = unit(rng.normal(size=3)), rng.normal(size=3) * rng.choice([0, 1, 1e6])
        angle = rng.choice([0, 1e-9, math.pi, -math.pi, math.pi - 1e-8, 3, 2 * math.pi, 1e-200, 100, 0.7], n)
        if rng.random() < 0.4:
            angle = np.full(n, angle[0])
        spread = [
            rng.normal(size=(n, 3)),
            np.tile(rng.normal(size=3), (n, 1)),
            rng.normal(size=(n, 1)) * rng.normal(size=3),
            rng.normal(size=(n, 1)) * e,
            np.zeros((n, 3)),
        ]
        x = p + spread[rng.integers(5)]
        y = turned(x, e, p, angle)
        noise = rng.choice([0, 1e-12, 1e-3, 1, 100])
        x, y = x + noise * rng.normal(size=(n, 3)), y + noise * rng.normal(size=(n, 3))
        known = rng.random() < 0.5
        fit = fit_axis(x, y, angle, point=p if known else "free", sigma=rng.choice([None, 1e-6, 1.0]))
        assert np.linalg.norm(fit.axis) == pytest.approx(1, abs=4 * EPS)
        assert np.isfinite(fit.point).all()
        json.dumps(fit.to_dict(), allow_nan=False)
        assert str(fit)
        if np.abs(np.sin(angle / 2)).max() < 1e-15:
            continue  # a turn by less than rounding is taken as none
        cost = (fit.residuals**2).sum()
        size = max(np.abs(x).max(), np.abs(y).max())
        for reach in 10.0 ** rng.uniform(-4, 1, 5):
            f = unit(fit.axis + reach * rng.normal(size=3))
            q = fit.point + (0 if known else reach * rng.normal(size=3))
            other = (residual(x, y, angle, f, q) ** 2).sum()
            assert cost <= other * (1 + 1e-9) + n * (100 * EPS * size) ** 2


def test_good_data_leave_nothing_to_say() -> None:
    fit = fit_axis(*scene(30, 0.01, 67))
    assert fit.status is AxisFitStatus.DETERMINED
    assert fit.undetermined == ()
    assert fit.remarks == ()
    assert len(fit.candidate_axes) == 1
    assert len(fit.free_directions) == 0


# Slide --------------------------------------------------------------------------------------------


def slid(n: int, slide: float, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, a = scene(n, 0.0, seed)
    rng = np.random.default_rng(seed + 1000)
    y = y + slide * a[:, None] * AXIS
    return x + noise * rng.normal(size=x.shape), y + noise * rng.normal(size=x.shape), a


@pytest.mark.parametrize("known", [False, True])
def test_a_fitted_slide_agrees_with_scipy(known: bool) -> None:
    x, y, a = slid(10, 0.8, 0.02, 90)
    fit = fit_axis(x, y, a, point=POINT if known else "free", sigma=0.02)
    assert fit.slide_fitted
    assert fit.slide_by_angle
    U = tangents(AXIS)

    def misses(v: np.ndarray) -> np.ndarray:
        e = unit(AXIS + U @ v[1:3])
        p = POINT + (0 if known else U @ v[3:])
        return (y - turned(x, e, p, a) - v[0] * a[:, None] * e).ravel() / (0.02 * math.sqrt(2))

    best = least_squares(misses, np.zeros(3 if known else 5), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fit.chi_square == pytest.approx(2 * best.cost, rel=1e-9)
    assert fit.dof == 30 - len(best.x)
    assert fit.slide == pytest.approx(best.x[0], abs=1e-7)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    # the second order of the noise, (σ/arm)², and the differences of scipy
    assert fit.slide_uncertainty == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-2)
    spread = np.sqrt(np.linalg.eigvalsh(covariance[1:3, 1:3])[::-1])
    assert fit.axis_uncertainty == pytest.approx(spread, rel=1e-2)


def test_no_slide_is_said_to_be_zero_and_none_is_fitted() -> None:
    fit = fit_axis(*scene(30, 0.01, 91))
    assert not fit.slide_fitted
    assert abs(fit.slide) < 4 * fit.slide_uncertainty
    assert re.search(r"slide .* in each pair: (zero within its uncertainty|not fitted)", fit.summary())
    assert fit_axis(*scene(30, 0.0, 91)).slide_fitted is False  # rounding is no slide


@pytest.mark.thorough
@pytest.mark.parametrize("rest", ["of its own", "shared"])
@pytest.mark.parametrize("slide", [0.0, 0.5])
def test_95_percent_intervals_of_a_slide(rest: str, slide: float) -> None:
    """Also where all pairs have one rest pose, whose errors are in all of them."""
    z, count = [], 200
    for seed in range(count):
        rng = np.random.default_rng(seed)
        balls = np.array([[4.0, 1, 0], [-1, 3, 2], [0, -2, 5]]) + POINT
        a = np.repeat(np.linspace(0.5, 2, 6), 3)
        x = np.tile(balls, (6, 1))
        y = turned(x, AXIS, POINT, a) + slide * AXIS + 0.01 * rng.normal(size=x.shape)
        noise = 0.01 * rng.normal(size=x.shape)
        fit = fit_axis(x + (np.tile(noise[:3], (6, 1)) if rest == "shared" else noise), y, a)
        assert fit.slide_fitted == (slide > 0)
        z.append((fit.slide - slide) / fit.slide_uncertainty)
    assert np.mean(np.abs(z) < student.ppf(0.975, 49)) == pytest.approx(0.95, abs=binomial(count))


# Remarks ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [None, 0.01])
def test_a_known_point_off_the_axis_is_reported(sigma: float | None) -> None:
    x, y, a = scene(30, 0.01, 70)
    fit = fit_axis(x, y, a, point=POINT + 0.2 * tangents(AXIS)[:, 0], sigma=sigma)
    assert any("is that point on the axis?" in sentence for sentence in fit.remarks)
    assert not fit_axis(x, y, a, point=POINT, sigma=sigma).remarks


def test_sigma_that_does_not_fit_the_residuals_is_reported() -> None:
    fit = fit_axis(*scene(30, 0.01, 71), sigma=0.001)
    assert any("times what sigma leads to expect" in sentence for sentence in fit.remarks)
    assert fit.chi_square is not None


def test_degrees_are_suspected() -> None:
    x, y, a = scene(30, 0.01, 72, 1.0)
    assert any("not in degrees" in sentence for sentence in fit_axis(x, y, np.degrees(a)).remarks)


@pytest.mark.parametrize(
    ("n", "count"), [(2, 200), (4, 200), *(pytest.param(n, 600, marks=slow) for n in (2, 3, 4))]
)
def test_with_few_degrees_of_freedom_the_95_percent_reach_is_given_and_holds(n: int, count: int) -> None:
    dof = 3 * n - 4
    x, y, a = scene(n, 1e-5, 73, 1.0)
    told = [sentence for sentence in fit_axis(x, y, a).remarks if "degrees of freedom" in sentence]
    reach = math.sqrt(2 * f_distribution.ppf(0.95, 2, dof))
    assert f"with {dof} degrees of freedom" in told[0]
    assert f"reaches to {reach:.2g} standard uncertainties" in told[0]
    assert f"{reach / math.sqrt(-2 * math.log(0.05)):.2g} times as far" in told[0]
    assert not fit_axis(x, y, a, sigma=1e-5).remarks
    U = tangents(AXIS)
    _, _, fits = draws(n, 1e-5, count, angle=1.0)
    held = []
    for fit in fits:
        off = U.T @ (fit.axis - AXIS)
        held.append(off @ np.linalg.solve(U.T @ fit.axis_covariance @ U, off) < reach**2)
    assert np.mean(held) == pytest.approx(0.95, abs=binomial(count))


# Result, input ------------------------------------------------------------------------------------


def test_residuals_are_measured_less_predicted() -> None:
    x, y, a = scene(10, 0.1, 74)
    fit = fit_axis(x, y, a)
    assert fit.residuals == pytest.approx(y - turned(x, fit.axis, fit.point, a), abs=1e-13)
    assert fit.rms == pytest.approx(np.sqrt((fit.residuals**2).sum(axis=1).mean()), rel=1e-12)
    assert fit.point @ fit.axis == pytest.approx(fit.origin @ fit.axis, abs=1e-12)
    assert fit.origin == pytest.approx(np.concatenate([x, y]).mean(axis=0), abs=1e-12)


@pytest.mark.parametrize(
    "arguments",
    [
        ([[1, 2]], [[1, 2]], 1),
        (np.ones((3, 3)), np.ones((4, 3)), 1),
        (np.ones((3, 3)), np.ones((3, 3)), [1, 2]),
        (np.ones((0, 3)), np.ones((0, 3)), []),
        ([[1, 2, 3], [1, math.nan, 3]], np.ones((2, 3)), 1),
        (np.ones((2, 3)), [[1, 2, math.inf], [1, 2, math.inf]], 1),
        (np.ones((2, 3)), np.ones((2, 3)), [1, math.nan]),
        (np.ones((2, 3)), np.ones((2, 3)), ["a", "b"]),
    ],
)
def test_bad_input_is_refused_in_words(refuses, arguments: Any) -> None:
    refuses(fit_axis, *arguments)


@pytest.mark.parametrize(
    "options",
    [
        {"loss": "l2"},
        {"point": "origin"},
        {"point": (1, 2)},
        {"point": (1, 2, math.nan)},
        {"sigma": 0.0},
        {"sigma": [1, 2]},
        {"sigma": math.nan},
        {"weights": [1, -1, 1]},
        {"weights": 0},
        {"loss": "huber"},
    ],
)
def test_bad_options_are_refused_in_words(refuses, options: dict[str, Any]) -> None:
    refuses(fit_axis, *scene(3, 0.01, 76), **options)


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_a_fit_makes_no_call_for_each_pair(loss: str) -> None:
    def calls(pairs: int) -> int:
        x, y, a = scene(pairs, 0.01, 77)
        y[::5] += 1
        fits = []
        count = calls_in(lambda: fits.append(fit_axis(x, y, a, loss=loss)))
        assert fits[0].status is AxisFitStatus.DETERMINED
        return count

    # a loop over pairs makes calls for each pair in each of some ten steps, a million; on NumPy each block of rows
    # makes one for each operation, 120 000 in all
    assert calls(100_000) < calls(1000) + 400_000


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sigma": 0.01, "point": POINT},
        {"loss": "huber"},
        {"loss": "huber", "point": POINT + 0.1},
        {"weights": True},
    ],
)
def test_many_pairs_give_the_same_in_blocks(options: dict[str, Any], monkeypatch: Any) -> None:
    x, y, a = scene(1000, 0.01, 78)
    y[::4] += 1
    if options.get("weights"):
        options = {"weights": np.where(np.arange(1000) % 3, 1.0, 0.0)}
    whole = fit_axis(x, y, a, **options)
    monkeypatch.setattr(pairs_module, "BLOCK", 64)
    parts = fit_axis(x, y, a, **options)
    assert parts.summary() == whole.summary()
    np.testing.assert_allclose(parts.residuals, whole.residuals, rtol=0, atol=1e-13)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-9, atol=1e-20)
    np.testing.assert_array_equal(parts.outliers, whole.outliers)


# A real positioner --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def positioner() -> dict[float, list[tuple[float, np.ndarray]]]:
    """Poses by P1: P2 and the three points."""
    poses: dict[tuple[float, float, float], list[list[float]]] = defaultdict(list)
    with POSITIONER.open(newline="") as file:
        for row in csv.DictReader(file):
            key = (float(row["P1 [rad]"]), float(row["P2 [rad]"]), float(row["t [s]"]))
            poses[key].append([float(row[f"{c} [mm]"]) for c in "xyz"])
    groups: dict[float, list[tuple[float, np.ndarray]]] = defaultdict(list)
    for (p1, p2, _), points in poses.items():
        groups[round(p1, 2)].append((p2, np.array(points)))
    return groups


def pairs_of(group: list[tuple[float, np.ndarray]], step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of poses that differ by `step` in P2; each pose in one pair only, for independent errors."""
    left, x, y, a = list(group), [], [], []
    while left:
        p2, before = left.pop(0)
        match = [i for i, (other, _) in enumerate(left) if abs(other - p2 - step) < 0.02]
        if match:
            other, after = left.pop(match[0])
            x.append(before)
            y.append(after)
            a.append(np.full(3, other - p2))
    return np.concatenate(x), np.concatenate(y), np.concatenate(a)


def test_positioner_axis_is_found_in_every_group(positioner: Any) -> None:
    assert len(positioner) == 13
    axes = {}
    for p1, group in positioner.items():
        x, y, a = pairs_of(group, math.pi)
        fit = fit_axis(x, y, a, loss="huber")
        assert fit.status is AxisFitStatus.DETERMINED
        assert fit.rms < 0.6  # mm; the camera's own repeatability is a few tenths
        assert fit.axis_uncertainty[0] < 1.2e-4
        assert fit.outliers.sum() <= 3
        axes[p1] = fit.axis
    # P1 carries P2: its axis turns with P1, by the same angle, about one axis.
    order = sorted(axes)
    spans = [
        math.atan2(np.linalg.norm(np.cross(axes[order[0]], axes[p1])), axes[order[0]] @ axes[p1])
        for p1 in order[1:]
    ]
    # P1 and P2 are nearly square to each other; 5 mrad is the accuracy of the rounded P1 of a group.
    assert spans == pytest.approx([p1 - order[0] for p1 in order[1:]], abs=1e-2)
