"""Write several files, all or none, and draw with ``--plot``."""

from __future__ import annotations

import argparse
import os
from types import TracebackType
from typing import Any

from rodgen.errors import InputFileError
from rodgen.files import AtomicFile, commit_all


def add_plot(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--plot``, the file in which `what` is drawn."""
    parser.add_argument("--plot", metavar="FILE", help=f"draw {what}: .html, .png, .svg or .pdf")


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


class Outputs:
    """Output files that appear together, when the `with` block ends without an error.

    Parameters
    ----------
    *inputs : str
        Input files, which must not be overwritten.
    """

    def __init__(self, *inputs: str) -> None:
        self._inputs = inputs
        self._files: list[AtomicFile] = []
        self._places: list[str] = []

    def __enter__(self) -> Outputs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                commit_all(self._files)
        finally:
            for file in self._files:
                file.discard()

    def claim(self, *paths: str | None) -> None:
        """Reserve file names for outputs; refuse the name of an input or of another output.

        Parameters
        ----------
        *paths : str or None
            None is an output that is not wanted.

        Raises
        ------
        InputFileError
        """
        for path in filter(None, paths):
            if os.path.isdir(path):
                raise InputFileError(path, "file", "a folder", "the name of a file")
            place = os.path.realpath(path)
            if any(place == os.path.realpath(name) for name in self._inputs):
                raise InputFileError(path, "file", "the input file itself", "another name for the output")
            if place in self._places:
                raise InputFileError(path, "file", "the name of two outputs", "a name for each")
            self._places.append(place)

    def add(self, path: str, content: bytes) -> None:
        """Write the content of a reserved file under a temporary name.

        Raises
        ------
        InputFileError
            When the file cannot be written.
        """
        file = AtomicFile(path)
        self._files.append(file)
        file.write(content)
