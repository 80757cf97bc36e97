"""``rodgen tricept``: pose, rods, uncertainty, bounds and workspace of a Tricept."""

from __future__ import annotations

from rodgen.cli._console import Command, group
from rodgen.cli.tricept import bounds, poses, uncertainty, workspace

__all__ = ["add_to"]

_TEXT = """\
The Tricept of Kureková et al. (2015): three telescopic rods A0, A1, A-1 at 0°, +120° and −120°, and a middle rod that
slides and swings. A pose is alpha, beta and z, in the paper's sense: a positive alpha moves the platform towards +y.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    member = group(command, "tricept", "pose, rods, uncertainty, bounds and workspace of a Tricept", _TEXT)
    for module in (poses, uncertainty, bounds, workspace):
        module.add_to(member)
