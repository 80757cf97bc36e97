"""Inputs for the kernels of the 3-SPS-S machine: ordinary poses, and poses near or at what a kernel decides by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rodgen.generated.numpy import three_sps_s

DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([-30, 90, 210])])


def legs_of(matrices: np.ndarray, dims: np.ndarray) -> np.ndarray:
    """Lengths of the legs, from points."""
    R, r, h = (dims[:, n, None, None] for n in range(3))
    platform = np.einsum("nij,kj->nki", matrices, DIRECTIONS)
    return np.linalg.norm(r * platform + h * np.array([0, 0, 1]) - R * DIRECTIONS, axis=-1)


def sps_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(11)
    turns = Rotation.random(14, random_state=7)
    dims = np.array(
        [[2, 1, 1.5]] * 8 + [[330, 140, 600], [1, 3, 0.2], [1, 0.2, -4], [2, 1, 1.5], [1, 1, 1], [5, 4, 3]]
    )
    dims[11] *= 1e3
    matrices, quaternions = turns.as_matrix(), turns.as_quat(scalar_first=True)
    if name == "sps_polish":
        # starts so far off that four steps do not reach where rounding decides, and so near that they do
        off = np.where(np.arange(14) % 2, 0.4, 0.05)[:, None] * rng.normal(size=(14, 3)) / np.sqrt(3)
        near = (Rotation.from_rotvec(off) * turns).as_quat(scalar_first=True)
        near[3] *= -7
        trust = np.full(14, 0.5)
        trust[4] = 0.01
        return {"quaternion": near, "trust": trust, **_shared(matrices, dims)}
    if name == "sps_mode":
        shared = _shared(matrices, dims)
        root = rng.uniform(-1.2, 1.1, size=14)
        root[2], root[5] = 40.0, -40.0  # beyond a tilt of π, and below none
        octics = three_sps_s.sps_octic_scaled(*shared.values())[0]
        for row in (0, 4, 7, 9, 13):  # no guess, but a root; most guesses lie where w² is clipped to Z's side
            roots = np.roots(octics[row, ::-1])
            root[row] = roots[np.argmin(np.abs(roots.imag))].real
        return {**shared, "root": root, "sign": np.where(np.arange(14) % 3, 1.0, -1.0)}
    special = np.concatenate(
        [np.eye(3)[None], Rotation.from_rotvec([[0, 0, 0.7]]).as_matrix(), np.full((1, 3, 3), np.nan)]
    )
    more = np.concatenate([matrices, special])
    more_dims = np.concatenate([dims, dims[:3]])
    shared = _shared(more, more_dims)
    if name in ("sps_invariants", "sps_octic_scaled"):
        equal = np.full((1, 3), 2.578759391645525)
        shared["legs"] = np.concatenate([shared["legs"], equal, [[1.0, 2, np.inf]]])
        for key in ("base_radius", "platform_radius", "height"):
            shared[key] = np.concatenate([shared[key], shared[key][:2]])
        return shared
    q = np.concatenate([quaternions, [[1, 0, 0, 0], [3, 0, 0, 4], [np.nan, 0, 0, 1]]])
    return {
        **shared,
        "matrix": more,
        "quaternion": q,
    }


def _shared(matrices: np.ndarray, dims: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "legs": legs_of(matrices, dims),
        "base_radius": dims[:, 0].copy(),
        "platform_radius": dims[:, 1].copy(),
        "height": dims[:, 2].copy(),
    }
