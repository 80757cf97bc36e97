"""Inputs for the kernels of robots with six joints: ordinary poses, and poses at what the kernels decide by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rodgen.kinematics import spatial

WRISTS = (spatial.PUMA_560, spatial.T3_776)
PARALLEL = (spatial.GE_P60,)


def free_arms(wrist: bool, rng: np.random.Generator, count: int) -> list[spatial.Mechanism]:
    """Arms of a family whose other lengths, twists and offsets are anything."""
    arms = []
    for _ in range(count):
        a, alpha, offset = rng.uniform(1, 3, 5), rng.uniform(0.5, 2.5, 5), rng.uniform(-2, 2, 6)
        alpha[1] = 0
        if wrist:
            a[3] = a[4] = offset[4] = 0
        else:
            alpha[2] = a[4] = 0
        arms.append(spatial.Mechanism("R" * 6, a, alpha, offset))
    return arms


def folded_arm(wrist: bool) -> spatial.Mechanism:
    """An arm whose elbow can fold onto its shoulder, and whose wrist's centre can lie on S1."""
    a = [0.0, 2.0, 2.0, 0.0, 0.0]
    alpha = np.radians([90.0, 0.0, 0.0 if not wrist else 30.0, 90.0, 90.0])
    return spatial.Mechanism("R" * 6, a, alpha, [0.5, 0.0, 0.0, 0.0, 0.0, 1.0])


def pair_inputs() -> dict[str, np.ndarray]:
    """Any arm and any pose: the equations are polynomials in all of them."""
    rng = np.random.default_rng(32)
    n = 6
    alpha = rng.uniform(-3, 3, (n, 5))
    pose = np.tile(np.eye(4), (n, 1, 1))
    pose[:, :3, :3] = Rotation.random(n, random_state=33).as_matrix()
    pose[:, :3, 3] = rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-2, 3, size=(n, 1))
    a, offset = rng.normal(size=(n, 5)), rng.normal(size=(n, 6))
    return {"pose": pose, "a": a, "cosine": np.cos(alpha), "sine": np.sin(alpha), "offset": offset}


def robot_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input."""
    if name.startswith("robot_pair_"):
        return pair_inputs()
    wrist = name == "robot_wrist_reverse"
    rng = np.random.default_rng(31)
    arms: list[spatial.Mechanism] = []
    poses: list[np.ndarray] = []

    def add(arm: spatial.Mechanism, angles: object) -> None:
        arms.append(arm)
        poses.append(spatial.forward(arm, angles))

    robots = WRISTS if wrist else PARALLEL
    for arm in (*robots, *robots, *free_arms(wrist, rng, 3)):
        add(arm, rng.uniform(-3, 3, 6))
    singular = rng.uniform(-3, 3, 6)
    for fifth in (0.0, np.pi, 1e-3):
        add(robots[-1], [*singular[:4], fifth, singular[5]])
    folded = folded_arm(wrist)
    for third in (0.0, np.pi):  # the elbow straight, and folded onto the shoulder
        add(folded, [0.3, 0.4, third, 0.5, 0.6, 0.7])
    add(folded, [0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    poses[-1][:3, 3] = [0, 0, 1.5] + poses[-1][:3, 2]  # the wrist's centre on S1
    ordinary = poses[0]
    for change in ("far", "nan", "mirrored", "no rotation"):
        pose = ordinary.copy()
        if change == "far":
            pose[:3, 3] *= 100
        elif change == "nan":
            pose[1, 3] = np.nan
        elif change == "mirrored":
            pose[:3, 0] *= -1
        else:
            pose[:3, :3] = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix() * 1.01
        arms.append(arms[0])
        poses.append(pose)
    alpha = np.array([arm.alpha for arm in arms])
    return {
        "pose": np.array(poses),
        "a": np.array([arm.a for arm in arms]),
        "cosine": np.round(np.cos(alpha), 15),
        "sine": np.round(np.sin(alpha), 15),
        "offset": np.array([arm.offset for arm in arms]),
    }
