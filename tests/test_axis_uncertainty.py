"""Derivatives and covariance of the axes: against 50-digit differences, a closed form, and drawn noise."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from kernel_reference import KERNELS
from kinematics_cases import unit
from scipy.spatial.transform import Rotation

import rodgen
from rodgen import AxisStatus

EPS = float(np.finfo(float).eps)


def sample(n: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    axes, rho, angle = unit(rng.normal(size=(n, 3))), rng.normal(size=(n, 3)), rng.uniform(-3, 3, n)
    return rho, Rotation.from_rotvec(axes * angle[:, None]).apply(rho), angle


def with_inputs(name: str, numbers: np.ndarray | list) -> dict[str, object]:
    return {"rho": numbers[:3], "rho_prime": numbers[3:6], "angle": numbers[6], "length_tolerance": 1e-8}


def differences(numbers: np.ndarray, step: float = 1e-20) -> np.ndarray:
    """Central differences of the expression trees; with 50 digits only step² times the third derivative is left."""
    columns = []
    with mpmath.workdps(50):
        for k in range(7):
            values = []
            for sign in (1, -1):
                moved = [mpmath.mpf(float(x)) for x in numbers]
                moved[k] += sign * mpmath.mpf(step)
                values.append(KERNELS["solve_axis"].evaluate(with_inputs("solve_axis", moved))["axes"])
            columns.append((values[0] - values[1]) / (2 * mpmath.mpf(step)))
    return np.stack([c.astype(float) for c in columns], axis=-1)


@pytest.mark.thorough
def test_jacobian_is_that_of_the_solver() -> None:
    rho, rho_prime, angle = sample(5, 1)
    jacobian, status = rodgen.axis_jacobian(rho, rho_prime, angle)
    assert (status == AxisStatus.TWO_AXES).all()
    condition = rodgen.axis_condition(rho, rho_prime, angle)
    for k in range(len(rho)):
        exact = differences(np.array([*rho[k], *rho_prime[k], angle[k]]))
        # the derivatives have cond² in them, and rounding is felt once more
        assert np.abs(jacobian[k] - exact).max() <= 16 * EPS * max(condition[k], 1) ** 2 * np.abs(exact).max()


def test_jacobian_near_special_angles() -> None:
    """Angles near 0 and half turns; the closed form of the derivative, in many digits, is the other side."""
    rng = np.random.default_rng(3)
    for chi in (1e-6, 1e-3, math.pi - 1e-6, math.pi, -math.pi + 1e-9, 2 * math.pi + 1e-3, 50.0):
        e, rho = unit(rng.normal(size=3)), rng.normal(size=3)
        rho_prime = Rotation.from_rotvec(e * chi).apply(rho)
        jacobian, _ = rodgen.axis_jacobian(rho, rho_prime, chi)
        exact = differences(np.array([*rho, *rho_prime, chi]), 1e-25)
        condition = float(rodgen.axis_condition(rho, rho_prime, chi))
        assert np.abs(jacobian - exact).max() <= 32 * EPS * max(condition, 1) ** 2 * np.abs(exact).max()


def closed_form(
    rho: np.ndarray, rho_prime: np.ndarray, angle: float, axis: np.ndarray, sigma: float, of_angle: float
):
    """Covariance for equal, independent noise: two directions across the axis, r̂ and d = e x r̂."""
    r_hat = unit(rho_prime - rho)
    d = np.cross(axis, r_hat)
    sine, cosine = math.sin(angle / 2), axis @ unit(rho)
    points = sigma**2 / (2 * (rho @ rho) * sine**2) * (np.outer(r_hat, r_hat) + np.outer(d, d) / cosine**2)
    return points + of_angle**2 * (1 / cosine**2 - 1) / (4 * sine**2) * np.outer(d, d)


def test_covariance_is_the_closed_form_for_equal_noise() -> None:
    rho, rho_prime, angle = sample(100, 7)
    sigma, of_angle = 1e-3, 2e-4
    noise = sigma**2 * np.eye(3)
    covariance, _ = rodgen.axis_covariance(rho, rho_prime, angle, noise, noise, of_angle**2)
    axes, _ = rodgen.solve_axis(rho, rho_prime, angle)
    condition = np.maximum(rodgen.axis_condition(rho, rho_prime, angle), 1)
    for k in range(len(rho)):
        for row in range(2):
            expected = closed_form(rho[k], rho_prime[k], angle[k], axes[k, row], sigma, of_angle)
            bound = 64 * EPS * condition[k] ** 2 * np.abs(expected).max()
            assert np.abs(covariance[k, row] - expected).max() <= bound


def test_covariance_is_what_drawn_noise_makes() -> None:
    rng = np.random.default_rng(8)
    rho = np.array([2.0, 0.5, 1.0])
    angle = 1.1
    rho_prime = Rotation.from_rotvec(angle * unit(np.array([1.0, 2, 3]))).apply(rho)
    roots = 1e-4 * rng.normal(size=(2, 3, 3))
    cov_rho, cov_rho_prime = roots @ roots.swapaxes(1, 2)
    of_angle = 1e-4
    n = 200_000
    axes, status = rodgen.solve_axis(
        rng.multivariate_normal(rho, cov_rho, n),
        rng.multivariate_normal(rho_prime, cov_rho_prime, n),
        rng.normal(angle, of_angle, n),
        length_tolerance=0.01,
    )
    assert (status == AxisStatus.TWO_AXES).all()
    covariance, _ = rodgen.axis_covariance(rho, rho_prime, angle, cov_rho, cov_rho_prime, of_angle**2)
    for row in range(2):
        drawn = np.cov(axes[:, row].T)
        # an entry of a covariance from n draws is off by √(2/n) of the variances, 0.3 %; 5 of these
        scale = np.sqrt(np.outer(np.diag(covariance[row]), np.diag(covariance[row])))
        assert (np.abs(drawn - covariance[row]) <= 5 * math.sqrt(2 / n) * scale).all()


@pytest.mark.parametrize("of_angle", [0.0, 0.1])
def test_exact_points_have_no_covariance_but_the_angles(of_angle: float) -> None:
    covariance, _ = rodgen.axis_covariance(
        [2.0, 0, 1], [0, 2.0, 1], 1.0 + math.pi / 2, np.zeros((3, 3)), np.zeros((3, 3)), of_angle
    )
    assert (np.trace(covariance, axis1=-2, axis2=-1) > 0).all() == (of_angle > 0)
