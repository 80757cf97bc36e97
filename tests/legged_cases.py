"""Parallel machines with data, in rodgen and in the independent simulator: machine_cases for closed chains."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache, cached_property
from typing import Any

import numpy as np
from machine_cases import MOVES_ONLY, READINGS, Case, Values, effect, unit
from parallel_simulator import LEGS, Parallel

from rodgen.machines.effects.catalogue import CATALOGUE

GEOMETRY: dict[str, dict[str, Any]] = {
    "tricept": {"R": 330.0, "r": 140.0, "q": [3.0, -4.0, 120.0]},
    "3-sps-s": {"R": 200.0, "r": 120.0, "h": 260.0, "start": [0.0, 0.0, 0.73]},
}
TARGETS = [(120.0, 30.0, 40.0), (-20.0, 90.0, 10.0)]
ROWS = 24


def legged_file(
    family: str,
    targets: Iterable[Any] | None = TARGETS,
    *,
    kind: str = "point",
    frame: str = "machine",
    estimate: Iterable[str] = (),
    effects: Iterable[Mapping[str, Any]] = (),
    gravity: Any = (0.6, 0.0, 0.8),
    geometry: Mapping[str, Any] | None = None,
    **measured: Any,
) -> dict[str, Any]:
    """Make what stands in a machine file; the targets are called p, r, ..., without any there is the platform."""
    if kind == "distance":
        measured = {"from": [300.0, -200.0, 1500.0], **measured}
    file: dict[str, Any] = {
        "name": "A machine on legs",
        "family": family,
        "units": {"length": "mm", "angle": "rad"},
        "environment": {"gravity": [float(x) for x in gravity], "reference_temperature": 20.0},
        "geometry": dict(GEOMETRY[family] if geometry is None else geometry),
    }
    if targets is not None:
        file["target"] = [
            {"name": name, "point": [float(x) for x in point]}
            for name, point in zip("prstuvwxyz", targets, strict=False)
        ]
    measured = {"kind": kind, "frame": frame, **measured}
    return file | {
        "measured": measured,
        "estimate": {"parameters": list(estimate)},
        "effect": [dict(e) for e in effects],
    }


def possible(file: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List every effect of the catalogue that can stand in a machine, but for what is estimated anyway."""
    kind = file["measured"]["kind"]
    names = [target["name"] for target in file.get("target", [])]
    found = []
    for definition in CATALOGUE:
        if definition.of_directions and kind != "direction":
            continue
        if definition.component == "plate" or (definition.component == "axes" and kind != "point"):
            continue
        if kind == "direction" and (
            definition.name in MOVES_ONLY
            or definition.component == "point"
            or definition.name == "leg_compliance"
        ):
            continue
        if "leg" in definition.at:
            found += [effect(definition.name, leg) for leg in LEGS[file["family"]]]
        if "machine" in definition.at:
            found.append(effect(definition.name))
        if "target" in definition.at and "target" not in file["estimate"]["parameters"]:
            found += [effect(definition.name, name, target=True) for name in names]
    return found


def poses(family: str, rows: int, random: np.random.Generator) -> np.ndarray:
    """Draw poses of an honest plan: alpha, beta, z of a Tricept, else rotation vectors."""
    tilt, around = 0.4 * np.sqrt(random.uniform(size=rows)), random.uniform(0, 2 * np.pi, rows)
    third = (580.0, 800.0) if family == "tricept" else (0.45, 1.0)
    return np.stack([tilt * np.cos(around), tilt * np.sin(around), random.uniform(*third, rows)], -1)


class Legged(Case):
    """A machine file of a family and columns of data.

    Parameters
    ----------
    file : mapping
        As `legged_file` makes it.
    data : mapping of str to array
    brought : array, shape (rows, 3)
        Poses into which the platform was brought, as `poses` draws them.
    """

    def __init__(self, file: Mapping[str, Any], data: Mapping[str, Any], brought: np.ndarray) -> None:
        self.file = file
        self.data = dict(data)
        self.brought = brought
        self.kind = file["measured"]["kind"]
        self.joints = list(LEGS[file["family"]])

    def changed(self, **more: Any) -> Legged:
        return Legged(**{"file": self.file, "data": self.data, "brought": self.brought, **more})

    @cached_property
    def arguments(self) -> dict[str, Any]:
        d, rows = self.data, len(self.brought)

        def table(prefix: str) -> np.ndarray | None:
            columns = [d.get(f"{prefix}{leg}") for leg in self.joints]
            return None if any(x is None for x in columns) else np.stack(columns, -1)

        return {
            "q": np.stack([d[f"{leg} [mm]"] for leg in self.joints], -1),
            "target": list(d["target"]) if "target" in d else None,
            "s": table("dir_"),
            "t": d.get("t [s]", np.zeros(rows)),
            "temperature": {leg: d[f"T_{leg} [degC]"] for leg in self.joints if f"T_{leg} [degC]" in d},
            "load": d.get("load [N]"),
            "run": list(d["run"]) if "run" in d else None,
            "start": self.brought if self.file["family"] == "3-sps-s" else None,
        }

    def simulated(self, values: Values | None = None) -> np.ndarray:
        effects = {key: value for key, value in (values or {}).items() if value}
        arguments = dict(self.arguments)
        return Parallel(self.file, effects).measure(arguments.pop("q"), **arguments)

    def measured(self, values: Values | None = None, noise: float = 0.0, random: Any = None) -> Legged:
        """Return the case with readings of the simulator."""
        reading = self.simulated(values)
        if random is not None:
            reading = reading + noise * random.normal(size=reading.shape)
        if self.kind == "direction":
            reading = unit(reading)
        names = [name if self.kind == "direction" else f"{name} [mm]" for name in READINGS[self.kind]]
        return self.changed(data=self.data | dict(zip(names, reading.T, strict=True)))


def legged(file: Mapping[str, Any], rows: int, random: np.random.Generator, *, runs: int = 2) -> Legged:
    """Make a case with columns of everything that an effect may need, and readings of the machine as it is drawn."""
    family = file["family"]
    brought = poses(family, rows, random)
    q = Parallel(file).legs(brought)
    data: dict[str, Any] = {}
    for k, leg in enumerate(LEGS[family]):
        data[f"{leg} [mm]"] = q[:, k]
        data[f"dir_{leg}"] = random.choice([-1.0, 1.0], rows)
        data[f"T_{leg} [degC]"] = random.uniform(15, 35, rows)
    names = [target["name"] for target in file.get("target", [{"name": "platform"}])]
    data["target"] = np.array([names[i % len(names)] for i in range(rows)])
    data["run"] = np.array([f"r{runs * i // rows}" for i in range(rows)])
    data["t [s]"] = np.sort(random.uniform(0, 4000, rows))
    data["load [N]"] = random.uniform(0, 80, rows)
    return Legged(file, data, brought).measured()


@cache
def every(family: str, kind: str = "point") -> Legged:
    """Return a machine with every effect, seen by an instrument that stands anywhere."""
    file = legged_file(family, kind=kind, frame="free", estimate=["geometry"])
    if kind == "direction":
        file["estimate"] = {"parameters": []}
    file["effect"] = possible(file)
    return legged(file, ROWS, np.random.default_rng(4))
