"""Inputs for the kernels of the trigonometric equation and of pairs of equations; hard ones among them."""

from __future__ import annotations

import numpy as np

STARTS = np.array(
    [[0.5, 0.2], [-0.1, 0.6], [-0.5, -0.3], [0.2, -0.5], [1.2, 1.6], [-1.5, 1.3], [-1.3, -1.4], [1.6, -1.1]]
)


def trig_inputs(name: str) -> dict[str, np.ndarray]:
    """Coefficients of every kind: two angles, one, none, all; tiny and huge; not finite."""
    del name  # both kernels have the same inputs
    rng = np.random.default_rng(31)
    rows = [*rng.normal(size=(10, 3))]
    rows += [[1, 2, 1], [1, 2, 1 + 1e-12], [-1, 2, 1], [0, 1, 0.5], [1, 0, 0.5], [1, 1e-9, 1], [2, -1e-5, 2]]
    rows += [
        [3, 4, 5],
        [3, 4, -5],
        [1, 0, 1],
        [-2, 0, 2],
        [0, -3, 3],
        [3, 4, 5.1],
        [0, 0, 1],
        [0, 0, 0],
        [1, 0, 0],
    ]
    rows += [[2e36, -1e36, 3e35], [2e-36, 1e-36, 3e-37], [np.nan, 1, 1], [1, np.inf, 1], [1, 1, -np.inf]]
    table = np.array(rows, float)
    return {"A": table[:, 0].copy(), "B": table[:, 1].copy(), "D": table[:, 2].copy()}


def pair_inputs(name: str) -> dict[str, np.ndarray]:
    """Two random equations, and for what comes after them, what comes before."""
    rng = np.random.default_rng(32)
    one, two = rng.normal(size=(2, 8, 3, 3))
    if name == "pair_prepared":
        near = one[:2] + 1e-3 * two[:2]
        zero = np.zeros((2, 3, 3))
        bad = np.stack([np.full((3, 3), np.nan), np.diag([1.0, np.inf, 1])])
        large = np.array([1e30, 1e-30])[:, None, None]
        first = np.concatenate([one, one[:2], zero[:1], one[:1], one[:2], bad])
        second = np.concatenate([two, near, two[:1], zero[:1], large * two[:2], two[:2]])
        return {"first": first, "second": second}
    if name in ("pair_octic", "pair_angles"):
        angle = rng.uniform(-3, 3, size=8)
        tangent = rng.normal(size=8) * 10.0 ** np.arange(-3, 5)
        return {
            "one": one,
            "two": two,
            "turn": np.stack([np.cos(angle), np.sin(angle)], -1),
            "tangent": tangent,
        }
    if name == "pair_polish":
        # so far off that the residual is no rounding after the steps, some of which are cut short
        off = 2.0 * rng.choice([-1, 1], size=(8, 2)) + 0.3 * rng.normal(size=(8, 2))
        planted = rng.uniform(-3, 3, size=(8, 2))
        u, v = (np.stack([np.ones(8), np.cos(a), np.sin(a)], -1) for a in planted.T)
        for m in (one, two):
            m[:, 0, 0] -= np.einsum("nij,ni,nj->n", m, u, v)
        one[6], two[6] = 0.0, 0.0
        one[6, 0, 0], one[6, 0, 1], two[6, 0, 0] = (
            1.0,
            0.5,
            1.0,
        )  # no derivative with respect to the first angle
        return {"one": one, "two": two, "angles": planted + off}
    octic = rng.normal(size=(8, 9))
    near = np.stack([np.roots(row[::-1]) for row in octic])
    if name == "pair_real_roots":
        octic[6] = np.poly([0.5, 0.5 + 1e-9, -0.7, 1.3, -2.0, 0.1j, -0.1j, 3.0])[
            ::-1
        ].real  # two that are not distinguished
        near[6] = [0.5, 0.5 + 1e-9, -0.7, 1.3, -2.0, 0.1j, -0.1j, 3.0]
        octic[7, 8] = 0.0
        near = near * (1 + 1e-12 * rng.normal(size=near.shape))
    else:
        near[:4] += 0.3 * (rng.normal(size=(4, 8)) + 1j * rng.normal(size=(4, 8)))
        near[4:6] = STARTS @ [1, 1j]
    return {"octic": octic, "size": np.full(8, 3.0), "roots": np.stack([near.real, near.imag], -1)}
