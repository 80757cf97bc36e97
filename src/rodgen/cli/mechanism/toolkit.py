"""``rodgen mechanism toolkit``: the laws of the spherical polygons."""

from __future__ import annotations

import argparse

from rodgen.cli._console import OK, Command, show
from rodgen.polygon_laws import POLYGONS

_TEXT = """\
Print the fundamental, subsidiary and polar sine, sine-cosine and cosine laws of a spherical polygon, and its
half-tangent laws, in the X, Y, Z and U, V, W of Crane and Duffy. The tables are generated, and every identity in them
is checked.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("toolkit", _run, "the laws of spherical triangles to heptagons", _TEXT)
    parser.add_argument(
        "polygon",
        metavar="POLYGON",
        nargs="?",
        choices=[*POLYGONS.values(), *map(str, POLYGONS)],
        help="triangle, quadrilateral, pentagon, hexagon or heptagon, or 3 to 7; default: all",
    )
    parser.add_argument(
        "--format", choices=("text", "markdown", "latex"), default="text", help="default: %(default)s"
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.kinematics import spatial

    wanted = [n for n, name in POLYGONS.items() if options.polygon in (None, name, str(n))]
    show("\n\n".join(spatial.toolkit(n, form=options.format).rstrip("\n") for n in wanted))
    return OK
