"""GNU Octave, kept running between calls: MATLAB code is tested with it."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, savemat


class OctaveError(Exception):
    """What Octave reports."""


class Octave:
    """A process that runs statements, and functions on arrays through files in a folder."""

    def __init__(self, program: str, folder: Path) -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [program, "--norc", "--quiet", "--no-history", "--no-line-editing"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,  # there it leaves its workspace when it is killed
        )

    def run(self, code: str) -> str:
        """Run statements and return what they print; a warning is printed, too."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(
            f"try\n{code}\ndisp('@done');\ncatch problem\ndisp(['@failed ' problem.message]);\nend\nfflush(stdout);\n"
        )
        self.process.stdin.flush()
        printed = []
        for line in self.process.stdout:
            if line == "@done\n":
                return "".join(printed)
            if line.startswith("@failed "):
                raise OctaveError(line.removeprefix("@failed ").strip())
            printed.append(line)
        raise OctaveError("".join(printed))

    def call(self, function: str, arguments: Sequence[Any], outputs: int) -> list[np.ndarray]:
        """Return the results of a function."""
        given, found = self.folder / "given.mat", self.folder / "found.mat"
        savemat(given, {"given": np.array([*arguments, None], dtype=object)[:-1]})
        names = ", ".join(f"found{n}" for n in range(outputs))
        code = f"load('{given}'); [{names}] = {function}(given{{:}}); save('-v7', '{found}', 'found*');"
        assert self.run(code) == ""
        results = loadmat(found)
        return [results[f"found{n}"] for n in range(outputs)]

    def close(self) -> None:
        self.process.communicate()


def columns(array: np.ndarray) -> np.ndarray:
    """Return rows (n, ...) as columns (..., n), numbers as (1, n)."""
    return np.moveaxis(array.reshape(len(array), *(array.shape[1:] or (1,))), 0, -1)


def rows(array: np.ndarray, shape: tuple[int, ...], count: int) -> np.ndarray:
    """Return columns as rows; Octave drops last axes of length one."""
    return np.moveaxis(array.reshape((*shape, count), order="F"), -1, 0)
