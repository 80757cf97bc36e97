"""Fits to what the plain simulator measures: what the tests of noise, robustness and determinacy share."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from machine_cases import READINGS, Case, joint, machine_file, unit

from rodgen.calibration.fit import Fit, fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

__all__ = ["TABLE", "TRUTH", "fit_to", "joint", "machine_file", "measure", "on_table"]

TABLE = {"joints": [joint("C", "revolute", (0, 0, 1))], "targets": [(150, 0, 30), (-40, 90, 110)]}
"""A rotary table with two balls."""
TRUTH = {
    "C.axis.a": 2e-4,
    "C.axis.b": -1e-4,
    "C.point.a": 0.1,
    "C.point.b": -0.2,
    "target.p.x": 0.3,
    "target.r.z": -0.4,
    "C.encoder_eccentricity.a": 6e-5,
}


def on_table(**more: Any) -> dict[str, Any]:
    """The rotary table, all of its geometry and the eccentricity of its encoder estimated."""
    free = ["C.axis", "C.point", "target"]
    eccentric = [{"name": "encoder_eccentricity", "joint": "C"}]
    return machine_file(**{"estimate": free, "effects": eccentric, **TABLE, **more})


@cache
def _machine(text: str) -> Machine:
    return Case(json.loads(text), {}).machine


def measure(
    file: Mapping[str, Any],
    columns: Mapping[str, Any],
    truth: Mapping[str, float] | None = None,
    *,
    noise: Any = 0.0,
    random: np.random.Generator | None = None,
) -> dict[str, Any]:
    """Add what the simulator reads to columns of commands; the noise of a direction is an angle, across it."""
    first = file["target"][0]["name"]
    rows = len(next(iter(columns.values())))
    columns = {"target": [first] * rows, **columns}
    reading = Case(file, columns).simulated(truth)
    if random is not None:
        reading = reading + noise * random.normal(size=reading.shape)
    kind = file["measured"]["kind"]
    if kind == "direction":
        reading = unit(reading)
    names = [name if kind == "direction" else f"{name} [mm]" for name in READINGS[kind]]
    return {**columns, **dict(zip(names, reading.T, strict=True))}


def fit_to(file: Mapping[str, Any], columns: Mapping[str, Any], **options: Any) -> Fit:
    return fit(_machine(json.dumps(file)), Measurements.from_frame(columns), **options)
