"""A fleet of simulated telescope mounts, each with effects of its own from a distribution that the fleet never sees."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rodgen import Machine, Measurements, simulate

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"
NOISE = "3arcsec"


@dataclass(frozen=True)
class Truth:
    """What the machines have: the flexure of the tube, arcsec, which differs between machines by `spread`."""

    mean: float
    spread: float
    flexure: dict[str, float]


def make_fleet(
    folder: Path, count: int, *, night: int = 0, mean: float = 15.0, spread: float = 2.0, **more: Any
) -> Truth:
    """Write machine files into `folder`/machines and measurements of a night into `folder`/data-NIGHT.

    Parameters
    ----------
    folder : Path
    count : int
    night : int, optional
        The noise is that of the night; the machines are the same.
    mean, spread : float, optional
        Of the flexure.
    **more : float
        What a machine has besides, in arcsec, such as ``m3=40.0``.
    """
    machine, design = Machine.load(MOUNT / "machine.toml"), Measurements.load(MOUNT / "mmt_2021.csv")
    truths = mean + spread * np.random.default_rng(5).normal(size=count)
    machines, data = folder / "machines", folder / f"data-{night}"
    for place in (machines, data):
        place.mkdir(parents=True, exist_ok=True)
    flexure = {}
    for number, truth in enumerate(truths.tolist()):
        name = f"m{number}"
        flexure[name] = truth + more.get(name, 0.0)
        made = simulate(
            machine,
            design,
            [f"tube_flexure:a={flexure[name]}arcsec"],
            noise=NOISE,
            seed=1000 * night + number,
        )
        names = [column.text for column in made.data.columns.values()]
        columns = np.column_stack([column.values for column in made.data.columns.values()])
        np.savetxt(data / f"{name}.csv", columns, "%.15g", ",", header=",".join(names), comments="")
        shutil.copy(MOUNT / "machine.toml", machines / f"{name}.toml")
    return Truth(mean, spread, flexure)
