"""How many digits the solver for the axis keeps, over all angles."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import plotly.graph_objects as go

from rodgen.derivation.figures import cross_mp, error_maps

SAMPLES = 6
DIGITS = 50


def exact_axes(before, after, chi):
    """Return both axes of two mpmath vectors brought to equal length, by the formula."""
    after = after * mpmath.norm(before) / mpmath.norm(after)
    m, r = after + before, after - before
    sine, cosine = mpmath.sin(chi / 2), mpmath.cos(chi / 2)
    under_root = sine**2 * mpmath.fdot(m, m) - cosine**2 * mpmath.fdot(r, r)
    root, normal = mpmath.sqrt(max(under_root, 0)), cosine * cross_mp(m, r)
    return [(normal + sign * root * m) / (sine * mpmath.fdot(m, m)) for sign in (1, -1)]


def problem(chi, gamma, random):
    """Return two points rounded to double precision, γ from a random axis and χ about it, and their exact axes."""
    axis, side = (mpmath.matrix(random.normal(size=3).tolist()) for _ in range(2))
    axis /= mpmath.norm(axis)
    side -= axis * mpmath.fdot(axis, side)
    side /= mpmath.norm(side)
    turned = mpmath.cos(chi) * side + mpmath.sin(chi) * cross_mp(axis, side)
    size = mpmath.mpf(random.uniform(0.5, 2))
    points = [size * (mpmath.cos(gamma) * axis + mpmath.sin(gamma) * x) for x in (side, turned)]
    points = [[float(part) for part in point] for point in points]
    exact = exact_axes(*map(mpmath.matrix, points), chi)
    return [*points, *([float(part) for part in row] for row in exact)]


def normalised_first(before: np.ndarray, after: np.ndarray, chi: np.ndarray) -> np.ndarray:
    """Return the formula's axes of points that are first divided by their lengths."""
    unit, unit_after = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (before, after))
    m, r = unit_after + unit, unit_after - unit
    sine, cosine = np.sin(chi / 2)[..., None], np.cos(chi / 2)[..., None]
    m_squared, r_squared = (np.sum(x**2, axis=-1, keepdims=True) for x in (m, r))
    root = np.sqrt(np.maximum(sine**2 * m_squared - cosine**2 * r_squared, 0))
    rows = [cosine * np.cross(m, r) + sign * root * m for sign in (1, -1)]
    return np.stack(rows, axis=-2) / (sine * m_squared)[..., None]


def accuracy(kernel: Callable[..., tuple[np.ndarray, np.ndarray]]) -> go.Figure:
    """Return maps of the largest error of the kernel, and of the formula on unit vectors, against 50 digits."""
    half_tangents, gamma_tangents = np.logspace(-8, 8, 33), np.logspace(-6, 6, 25)
    chi, gamma = np.meshgrid(2 * np.arctan(half_tangents), np.arctan(gamma_tangents))
    random = np.random.default_rng(1)
    with mpmath.workdps(DIGITS):
        draws = [
            [problem(mpmath.mpf(c), mpmath.mpf(g), random) for _ in range(SAMPLES)]
            for c, g in zip(chi.ravel().tolist(), gamma.ravel().tolist(), strict=True)
        ]
    points = np.array(draws).reshape(*chi.shape, SAMPLES, 4, 3)
    before, after, exact = points[..., 0, :], points[..., 1, :], points[..., 2:, :]
    angle = np.broadcast_to(chi[..., None], before.shape[:-1])
    found = {
        "the kernel": kernel(before, after, angle, 1e-8)[0],
        "points divided by their lengths first": normalised_first(before, after, angle),
    }
    errors = {
        title: np.abs(axes - exact).max(axis=(-3, -2, -1)) / np.finfo(float).eps
        for title, axes in found.items()
    }
    return error_maps(
        half_tangents,
        gamma_tangents,
        errors,
        (0.1, 1e8),
        labels=("tan(χ/2)", "tan γ", "largest error / ε"),
    )
