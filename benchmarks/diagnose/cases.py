"""Machines and measurements for timed diagnoses, simulated with an effect that the machine file does not name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.machines.parameters import parameters_of

AXES = ("[0, 0, 1]", "[0, 1, 0]", "[0, 1, 0]", "[1, 0, 0]", "[0, 1, 0]", "[1, 0, 0]")
LINK = 400  # mm
TARGETS = 3
HIDDEN = ("encoder_eccentricity@J2:a=40arcsec,b=60arcsec",)


@dataclass(frozen=True)
class Chain:
    """A chain of rotary joints, with three reflectors in the frame of a tracker, of unknown noise.

    Attributes
    ----------
    joints, poses : int
    temperatures : bool
        Whether each row has a temperature of every joint, and a time.
    loads : bool
        Whether each row has a payload.
    estimated : tuple of str
        What is estimated: of each joint ``axis`` and ``point``, and ``target``.
    declared : tuple of str
        Effects that the machine file names at each joint; their parameters are estimated, too.
    """

    joints: int
    poses: int
    temperatures: bool = False
    loads: bool = False
    estimated: tuple[str, ...] = ("axis", "point", "target")
    declared: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        return self.poses * TARGETS

    @property
    def text(self) -> str:
        """The machine file."""
        names = [f"J{j}" for j in range(1, self.joints + 1)]
        parts = ['name = "Chain"', '[units]\nlength = "mm"\nangle = "deg"']
        for j, name in enumerate(names):
            line = f"axis = {AXES[j % len(AXES)]}\npoint = [{LINK * j}, 0, {90 * (j % 2)}]"
            parts.append(f'[[joint]]\nname = "{name}"\ntype = "revolute"\n{line}')
        end = LINK * self.joints
        for t, point in enumerate(([end, 90, 0], [end, -60, 80], [end + 60, -50, -60])):
            parts.append(f'[[target]]\nname = "R{t}"\npoint = {point}')
        of_joints = [part for part in self.estimated if part != "target"]
        estimated = [f"{name}.{part}" for name in names for part in of_joints]
        estimated += ["target"] if "target" in self.estimated else []
        parts.append('[measured]\nkind = "point"\nframe = "free"')
        parts.append("[estimate]\nparameters = [" + ", ".join(f'"{key}"' for key in estimated) + "]")
        parts += [f'[[effect]]\nname = "{e}"\njoint = "{name}"' for e in self.declared for name in names]
        return "\n\n".join(parts) + "\n"

    def write(self, folder: Path) -> tuple[Path, Path, int]:
        """Write machine.toml and data.csv; return their paths and the number of parameters that a fit estimates."""
        file, data = folder / "machine.toml", folder / "data.csv"
        file.write_text(self.text)
        machine, design = Machine.load(file), self._design()
        found = simulate(machine, Measurements.from_frame(design), HIDDEN, noise="20um", seed=1)
        columns = design | found.columns
        texts = [c if c.dtype.kind == "U" else np.char.mod("%.5f", c) for c in columns.values()]
        with data.open("w") as out:
            out.write(",".join(columns) + "\n")
            out.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))
        return file, data, len(parameters_of(machine, machine.structure, ()))

    def _design(self) -> dict[str, np.ndarray]:
        rng = np.random.default_rng([self.joints, self.rows])
        numbers = range(1, self.joints + 1)
        found = {f"J{j} [deg]": np.round(rng.uniform(-120, 120, self.poses), 3) for j in numbers}
        if self.temperatures:
            hours = np.linspace(0, 8, self.poses)
            found["t [s]"] = 3600 * hours
            for j in numbers:
                warm = (3 + j) * (1 - np.exp(-hours / (1 + 0.3 * j)))
                found[f"T_J{j} [degC]"] = 20 + warm + rng.normal(scale=0.1, size=self.poses)
        if self.loads:
            found["load [N]"] = rng.choice([0.0, 50.0, 100.0], self.poses)
        found = {name: np.repeat(values, TARGETS) for name, values in found.items()}
        return found | {"target": np.tile([f"R{t}" for t in range(TARGETS)], self.poses)}


CASES = {
    "6 joints, 108 rows": Chain(6, 36),
    "8 joints, 102 rows": Chain(8, 34),
    "8 joints, 999 rows": Chain(8, 333),
    "11 joints, 402 rows": Chain(11, 134),
    "6 joints, loads, temperatures, 1e5 rows": Chain(6, 33_333, temperatures=True, loads=True),
    "6 joints, loads, temperatures, 1e6 rows": Chain(6, 333_333, temperatures=True, loads=True),
}
GROWING = {
    "rows": [Chain(6, rows // 3) for rows in (1_000, 10_000, 100_000, 1_000_000)],
    "joints": [Chain(joints, 100) for joints in (2, 4, 6, 8, 10, 12)],
    "parameters": [
        Chain(6, 100, estimated=("axis",)),
        Chain(6, 100, estimated=("axis", "point")),
        Chain(6, 100),
        Chain(6, 100, declared=("encoder_ellipticity",)),
        Chain(6, 100, declared=("encoder_ellipticity", "axial_error_motion")),
        Chain(6, 100, declared=("encoder_ellipticity", "axial_error_motion", "scale", "backlash")),
    ],
}
