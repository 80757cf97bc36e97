"""The ways to write an attitude in a table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

TURNS = ("rx", "ry", "rz")

NOTATIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rotation vector": TURNS,
        "roll, pitch and yaw": ("roll", "pitch", "yaw"),
        "quaternion": ("qw", "qx", "qy", "qz"),
        "matrix": tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
    }
)
"""The ways, and their columns."""

ANGULAR = frozenset({"rotation vector", "roll, pitch and yaw"})
"""Those whose numbers are angles."""
