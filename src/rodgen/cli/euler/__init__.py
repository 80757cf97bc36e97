"""``rodgen euler``: instantaneous Euler angles, and the 3-SPS-S machine."""

from __future__ import annotations

from rodgen.cli._console import Command, group
from rodgen.cli.euler import instantaneous, three_sps_s

__all__ = ["add_to"]

_TEXT = """\
Instantaneous Euler angles (Zhou and Zhu, 2023): the angles chi_x, chi_y, chi_z by which a rotation turns the yz, xz and
xy planes, and the ridge lines in which these meet their images. legs, direct and workspace are of the paper's 3-SPS-S
machine: a platform that three legs turn about a ball joint.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    member = group(command, "euler", "instantaneous Euler angles, and the 3-SPS-S machine", _TEXT)
    instantaneous.add_to(member)
    three_sps_s.add_to(member)
