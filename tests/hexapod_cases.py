"""A hexapod by plain NumPy: the legs of poses, and what instruments see; it shares no code with rodgen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

BASE_AT, PLATFORM_AT = np.radians([-10, 10, 110, 130, 230, 250]), np.radians([-50, 50, 70, 170, 190, 290])
BASE = np.stack([500 * np.cos(BASE_AT), 500 * np.sin(BASE_AT), [0, 20, -10, 5, 0, 15]], axis=1)
PLATFORM = np.stack(
    [250 * np.cos(PLATFORM_AT), 250 * np.sin(PLATFORM_AT), [-40, -35, -40, -45, -40, -38]], axis=1
)
HOME = np.array([5.0, -3.0, 640.0])
LEGS = [f"L{k}" for k in range(1, 7)]
TARGETS = {"p": (180.0, 20.0, 60.0), "r": (-90.0, 150.0, 30.0), "s": (-70.0, -160.0, 90.0)}


def hexapod_file(
    *,
    kind: str = "point",
    frame: str = "machine",
    estimate: Sequence[str] = (),
    effects: Sequence[Mapping[str, Any]] = (),
    base: np.ndarray = BASE,
    platform: np.ndarray = PLATFORM,
    **measured: Any,
) -> dict[str, Any]:
    """Make what stands in a machine file."""
    joints = {f"B{k + 1}": [float(x) for x in p] for k, p in enumerate(base)}
    joints |= {f"P{k + 1}": [float(x) for x in p] for k, p in enumerate(platform)}
    names = ["p"] if kind == "pose" else list(TARGETS)
    return {
        "name": "Six legs",
        "family": "hexapod",
        "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": [0.0, 0.0, -1.0], "reference_temperature": 20.0},
        "geometry": {**joints, "home": [float(x) for x in HOME]},
        "target": [{"name": name, "point": list(TARGETS[name])} for name in names],
        "measured": {"kind": kind, "frame": frame, **measured},
        "estimate": {"parameters": list(estimate)},
        "effect": [dict(e) for e in effects],
    }


def drawn_poses(rows: int, random: np.random.Generator, wider: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Draw positions (rows, 3) and rotation matrices (rows, 3, 3) all over a workspace."""
    position = HOME + wider * random.uniform(-1, 1, (rows, 3)) * [110, 110, 80]
    return position, Rotation.from_rotvec(wider * random.uniform(-0.25, 0.25, (rows, 3))).as_matrix()


def lengths(
    position: np.ndarray, turn: np.ndarray, base: np.ndarray = BASE, platform: np.ndarray = PLATFORM
) -> np.ndarray:
    """Measure the legs, (rows, 6)."""
    return np.stack(
        [np.linalg.norm(position + turn @ p - b, axis=1) for b, p in zip(base, platform, strict=True)], axis=1
    )


def table(
    commands: np.ndarray,
    position: np.ndarray,
    turn: np.ndarray,
    random: np.random.Generator,
    *,
    noise: float,
    turned: float | None = None,
    **more: np.ndarray,
) -> dict[str, Any]:
    """Make columns of readings; with `turned`, the noise of attitudes in rad, of poses."""
    rows = len(commands)
    names = ["p"] * rows if turned is not None else [list(TARGETS)[i % 3] for i in range(rows)]
    seen = np.array([TARGETS[name] for name in names])
    place = position + np.einsum("nij,nj->ni", turn, seen) + noise * random.normal(size=(rows, 3))
    columns: dict[str, Any] = {f"{leg} [mm]": commands[:, k] for k, leg in enumerate(LEGS)}
    columns |= {"target": names, **{f"{x} [mm]": place[:, i] for i, x in enumerate("xyz")}, **more}
    if turned is not None:
        errors = Rotation.from_rotvec(turned * random.normal(size=(rows, 3)))
        vector = (errors * Rotation.from_matrix(turn)).as_rotvec()
        columns |= {f"r{x} [rad]": vector[:, i] for i, x in enumerate("xyz")}
    return columns
