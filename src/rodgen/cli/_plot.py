"""Draw with ``--plot``."""

from __future__ import annotations

import argparse
from typing import Any

from rodgen.cli._values import OutputFile


def add_plot(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--plot``, the file in which `what` is drawn."""
    about = f"draw {what}: .html, .png, .svg or .pdf"
    parser.add_argument("--plot", metavar="FILE", type=OutputFile, help=about)


def figures_for(path: str | None) -> Any:
    """Return `rodgen.output.figures` to draw into a file, whose name is checked first; None without a file.

    Raises
    ------
    InputFileError
        When the name is none of a figure.
    """
    if not path:
        return None
    from rodgen.output import figures

    figures.check_figure_name(path)
    return figures
