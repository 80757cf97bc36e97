"""How many digits the left Jacobian of a rotation vector keeps."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import plotly.graph_objects as go

from rodgen.derivation.figures import BLUE, ORANGE

DIGITS = 60


def jacobian(w, by_cosine, by_rest, one):
    """Return L from its two coefficients, for floats and numbers of mpmath."""
    x, y, z = w
    turn = np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])
    return one + by_cosine * turn + by_rest * (turn @ turn)


def by_quotients(w: np.ndarray) -> np.ndarray:
    """Return L with its coefficients as quotients, without series."""
    angle = np.sqrt(w @ w)
    return jacobian(w, (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3, np.eye(3))


def exactly(w: np.ndarray) -> np.ndarray:
    """Return L in numbers of mpmath."""
    w = np.array([mpmath.mpf(float(part)) for part in w])
    angle = mpmath.sqrt(w @ w)
    one = np.vectorize(mpmath.mpf)(np.eye(3))
    return jacobian(w, (1 - mpmath.cos(angle)) / angle**2, (angle - mpmath.sin(angle)) / angle**3, one)


def accuracy(kernel: Callable[[np.ndarray], np.ndarray]) -> go.Figure:
    """Return the largest error of an entry of L, by the kernel and by quotients, for rotation vectors of all sizes."""
    angles = np.logspace(-10, 1, 300)
    vectors = np.random.default_rng(1).normal(size=(300, 3))
    vectors *= (angles / np.linalg.norm(vectors, axis=1))[:, None]
    with mpmath.workdps(DIGITS):
        exact = [exactly(w) for w in vectors]
        found = {
            "the quotients": ([by_quotients(w) for w in vectors], ORANGE),
            "the kernel": (kernel(vectors), BLUE),
        }
        figure = go.Figure()
        for name, (values, colour) in found.items():
            errors = [float(abs(a - b).max()) for a, b in zip(values, exact, strict=True)]
            y = np.maximum(np.array(errors) / np.finfo(float).eps, 1e-2)
            marks = {"size": 4, "color": colour}
            figure.add_trace(go.Scatter(x=angles, y=y, mode="markers", marker=marks, name=name))
    figure.update_xaxes(type="log", title="φ (rad)", exponentformat="power")
    figure.update_yaxes(type="log", title="largest error / ε", exponentformat="power")
    return figure.update_layout(width=700, height=420)
