"""Machines and measurements with as many rows as the goals of the page of `rodgen open` name."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diagnose.cases import Chain
from fits.cases import EXAMPLES

from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine


@dataclass(frozen=True)
class Telescope:
    """The mount of the examples, on stars all over the sky, with a tube that bends.

    Attributes
    ----------
    rows : int
    covariate : str
        What residuals are then shown against.
    """

    rows: int
    covariate: str = "EL"

    def write(self, folder: Path) -> list[Path]:
        """Write machine.toml and data.csv; return their paths."""
        file, data, random = folder / "machine.toml", folder / "data.csv", np.random.default_rng(1)
        shutil.copy(EXAMPLES / "mount/machine.toml", file)
        design = {
            "AZ [deg]": random.uniform(0, 360, self.rows),
            "EL [deg]": random.uniform(15, 88, self.rows),
        }
        hidden = ["tube_flexure:a=20arcsec", "refraction:a=3arcsec"]
        frame = Measurements.from_frame(design)
        made = simulate(Machine.load(file), frame, hidden, noise="0.6arcsec", seed=1).data
        columns = list(made.columns.values())
        header = ",".join(column.text for column in columns)
        np.savetxt(data, np.transpose([c.values for c in columns]), "%.11g", ",", header=header, comments="")
        return [file, data]


@dataclass(frozen=True)
class Arm:
    """A chain of six joints, whose residuals have three components."""

    rows: int
    covariate: str = "J2"

    def write(self, folder: Path) -> list[Path]:
        """Write machine.toml and data.csv; return their paths."""
        return list(Chain(6, self.rows // 3).write(folder)[:2])


CASES: dict[str, Telescope | Arm] = {
    "telescope, 1,000 rows": Telescope(1_000),
    "6 joints, 999 rows": Arm(999),
    "telescope, 1e5 rows": Telescope(100_000),
}
