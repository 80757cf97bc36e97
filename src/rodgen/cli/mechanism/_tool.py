"""The option for the point of the last link that a table refers to."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._values import quantity

if TYPE_CHECKING:
    from rodgen.cli.mechanism._mechanism import Chain

__all__ = ["add_tool", "tool_of"]


def add_tool(parser: argparse.ArgumentParser) -> None:
    """Add --tool."""
    parser.add_argument(
        "--tool",
        metavar="X,Y,Z",
        type=quantity("--tool", "2,3,5cm", 3),
        help="point of the last link, in its frame (x along the next link, z along the last joint), such as 2,3,5cm; "
        "of a machine file in machine axes at zero; default: the frame's origin",
    )


def tool_of(options: argparse.Namespace, chain: Chain) -> Any:
    """Return the frame at the tool in that of the last link, (4, 4)."""
    shift = np.eye(4)
    if options.tool:
        shift[:3, 3] = options.tool.to(chain.mechanism.unit)
    return shift
