"""Inputs for the kernels of instantaneous Euler angles: ordinary attitudes, and those at and near special cases."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

ROWS = 26
"""Rows of every input, so that inputs of one kernel go together."""


def turns() -> Rotation:
    """Attitudes: of all sizes, about coordinate axes, in their planes, half turns, and near all of these."""
    rng = np.random.default_rng(21)
    vectors = list(rng.normal(size=(8, 3)))
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    vectors += [axes[0] * 1e-3, axes[1] * 1e-8, axes[2] * (np.pi - 1e-6), axes[3] * (np.pi - 1e-3)]
    vectors += [[0.7, 0, 0], [0, -2.5, 0], [0, 0, 1.2]]  # no ridge line about the axis
    vectors += [[0.7, 0.3, 0], [0, 2.1, 1.5], [1.3, 0, -0.4]]  # a face of the tetrahedron
    vectors += [[0, 0, np.pi], [1e-5, 0, 1.2], [0.4, 1e-4, 1e-4]]
    return Rotation.from_rotvec(np.array(vectors))


def _padded(good: np.ndarray, bad: list[object]) -> np.ndarray:
    found = np.concatenate([good, np.array(bad, float)])
    assert len(found) == ROWS
    return found


def matrices() -> np.ndarray:
    """The attitudes, no rotation, what is nearly orthogonal, a reflection, and no matrix at all."""
    good = turns().as_matrix()
    return _padded(
        good, [np.eye(3), 1.001 * good[0], np.diag([1.0, 1, -1]), np.full((3, 3), np.nan), np.zeros((3, 3))]
    )


def quaternions() -> np.ndarray:
    """The attitudes, some with the other sign, of other lengths, tiny parts, and none."""
    good = turns().as_quat(scalar_first=True)
    good[1] *= -1
    good[2] *= 1e150
    return _padded(
        good, [[1, 0, 0, 0], [1, 1e-200, 0, 3e-160], [0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 1, 0]]
    )


def triples() -> np.ndarray:
    """Angles of rotations, of corners, edges and faces, outside, and no angles."""
    chi = np.arccos(np.clip(np.diagonal(turns().as_matrix(), axis1=1, axis2=2), -1, 1))[:12]
    pi = np.pi
    special = [
        [0, 0, 0],
        [pi, pi, 0],
        [0, pi, pi],
        [0.5, 0.5, 0],
        [2.0, pi, pi - 2.0],
        [1e-6, 1.2e-6, 0.9e-6],
        [pi - 1e-4, pi - 1.2e-4, 0.9e-4],
        [pi / 2, 0, 0],
        [1.0, 0.1, 0.2],
        [pi, pi, pi],
        [pi / 2, pi / 2, pi / 2],
        [0.3, 3.5, 0.3],
        [-0.1, 0.2, 0.2],
        [np.nan, 1, 1],
    ]
    return _padded(chi, special)


def chi_inputs(names: set[str]) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for the named inputs."""
    rng = np.random.default_rng(22)
    angles = rng.uniform(-4, 4, (ROWS, 3))
    angles[10:22] = turns().as_euler("ZYX")[9:21]
    angles[22] = [0, 0, 0]
    angles[23] = [1e-9, -2e-9, 3e-9]
    angles[24] = [300.0, -200.0, 100.0]
    vectors = rng.normal(size=(ROWS, 3))
    vectors[5] = 0
    points = 1e3 * rng.normal(size=(ROWS, 3))
    points[12:15] = [[0, 3, 4], [3, 0, 4], [3, 4, 0]]  # the planes coincide
    tolerance = np.zeros(ROWS)
    tolerance[[3, 18, 20]] = 1e-3, 1e-6, 0.9
    made = {
        "matrix": matrices(),
        "quaternion": quaternions(),
        "chi": triples(),
        "tolerance": tolerance,
        "angles": angles,
        "angle_rates": vectors,
        "omega": vectors,
        "rate": vectors,
        "point": points,
        "joints": np.concatenate([angles, angles[::-1]], axis=1),
        "lengths": rng.uniform(0.1, 900, (ROWS, 4)),
    }
    return {name: made[name] for name in names}
