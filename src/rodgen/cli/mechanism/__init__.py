"""``rodgen mechanism``: forward and reverse analysis of spatial mechanisms; one module a command."""

from __future__ import annotations

from rodgen.cli._console import Command, group
from rodgen.cli.mechanism import forward, reverse

__all__ = ["add_to"]

SUMMARIES = {
    "forward": "poses of a robot from its joint coordinates",
    "reverse": "all joint coordinates of poses, or of a loop's input",
}
_TEXT = """\
Robots and closed loops of joints R, P, C and H in the convention of Crane and Duffy, Kinematic Analysis of Robot
Manipulators: where the last link is, and all joint values that bring it somewhere.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    member = group(command, "mechanism", _TEXT, SUMMARIES)
    for module in (forward, reverse):
        module.add_to(member)
