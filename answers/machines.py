"""Residuals and Jacobians of machines: all templates and instruments, the examples, and every effect.

The readings of templates are random numbers, so that residuals are of the size of the machine; parameters stand beside
zero, so that every derivative says something.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import machine_cases
import numpy as np
from machine_cases import FRAME_TURNS, FREE_FRAME, READINGS, rotation, unit

from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.errors import RodgenError
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.templates import CODES, KINDS, machine_template

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
ROWS = 8
EFFECTS = 3
"""Effects of the catalogue that are drawn for each machine of a template or an example."""
EPS = float(np.finfo(float).eps)
ROUNDINGS = 1e4
"""Rounding errors, in units of the last place of the largest number, that a residual or a derivative may have: of
chains of up to 500 operations on lengths, in which cancellation leaves a tenth or less."""

Question = tuple[Machine, Measurements]


def cases() -> list[str]:
    """Return the names of the machines."""
    return list(made())


def made() -> dict[str, Callable[[], Question]]:
    """Return for each name a function that makes machine and data."""
    found: dict[str, Callable[[], Question]] = {}
    for kind in KINDS:
        more = {"latitude": 0.8} if kind.startswith("equatorial") else {}
        ways: dict[str, dict[str, Any]] = {"": more}
        if kind in CODES:
            ways |= {" tool": {"instrument": "tool"}, " ballbar": {"ballbar": True}}
        if kind in ("table-table", "head-table"):
            ways[" balls"] = {"balls": 2}
        found |= {
            f"template {kind}{way}": partial(of_template, kind, options) for way, options in ways.items()
        }
    found |= {f"example {f.name}": partial(of_example, f) for f in sorted(EXAMPLES.iterdir()) if f.is_dir()}
    for kind in ("point", "direction", "distance", "pose"):
        found[f"every effect, {kind}"] = partial(of_case, lambda kind=kind: machine_cases.every(kind))
    for kind in ("point", "direction", "pose"):
        found[f"own formulas, {kind}"] = partial(of_case, lambda kind=kind: machine_cases.own(kind)[0])
    return found


def of_template(kind: str, options: dict[str, Any]) -> Question:
    """Return a machine of a template, with some effects, and random commands and readings."""
    options = dict(options)
    instrument = options.pop("instrument", "workpiece")
    text = machine_template(kind, **options).replace(
        'instrument = "workpiece"', f'instrument = "{instrument}"'
    )
    machine = machine_of(text, f"{kind}.toml")
    if kind in {"tricept", "3-sps-s"}:
        data = Measurements.load(EXAMPLES / kind.replace("3-sps-s", "three_sps_s") / "data.csv")
        columns = {c.text: c.values[:ROWS] for c in data.columns.values()}
        return with_effects(machine, columns, kind)
    random = np.random.default_rng(zlib.crc32(kind.encode()))
    columns: dict[str, Any] = {}
    for k, joint in enumerate(machine.joints):
        length = "rad" if joint.revolute else machine.length_unit
        usual = machine.kinematics.usual_travel(k) if machine.kinematics.is_closed else (-2.6, 2.6)
        columns[f"{joint.name} [{length}]"] = random.uniform(*(joint.travel or usual), ROWS)
        columns[f"dir_{joint.name}"] = random.choice([-1.0, 1.0], ROWS)
        columns[f"v_{joint.name} [{length}/s]"] = random.uniform(-2, 2, ROWS)
        columns[f"T_{joint.name} [degC]"] = random.uniform(15, 35, ROWS)
    names = [target.name for target in machine.targets]
    columns["target"] = [names[i % len(names)] for i in range(ROWS)]
    columns |= {"t [s]": np.sort(random.uniform(0, 4000, ROWS)), "load [N]": random.uniform(0, 80, ROWS)}
    readings = random.normal(size=(ROWS, 3))
    direction = machine.measured.kind == "direction"
    for i, name in enumerate(READINGS[machine.measured.kind][:3]):
        columns[name if direction else f"{name} [{machine.length_unit}]"] = (
            unit(readings)[:, i] if direction else 100 + readings[:, i]
        )
    return with_effects(machine, columns, kind)


def of_example(folder: Path) -> Question:
    """Return an example with some effects more, and the first rows of its data."""
    (path,) = folder.glob("*.csv")
    data = Measurements.load(path)
    columns = {c.text: c.values[:ROWS] for c in data.columns.values()}
    return with_effects(Machine.load(folder / "machine.toml"), columns, folder.name)


def with_effects(machine: Machine, columns: dict[str, Any], name: str) -> Question:
    """Return the machine with some possible effects more, which its name draws, and the data."""
    data = Measurements.from_frame(columns, name="data.csv")
    possible = [
        e for e in catalogue_effects(machine, bind(machine, data)) if e.definition.name != "frame_shift"
    ]
    random = np.random.default_rng(zlib.crc32(name.encode()))
    for i in sorted(random.choice(len(possible), min(EFFECTS, len(possible)), replace=False)):
        machine = machine.with_effect(possible[i])
    return machine, data


def of_case(case: Callable[[], machine_cases.Case]) -> Question:
    """Return what tests share: a machine with every effect, or with formulas of its own."""
    columns = {name: values[:ROWS] for name, values in case().data.items()}
    return case().machine, Measurements.from_frame(columns, name="data.csv")


@cache
def evaluated(name: str) -> tuple[dict[str, np.ndarray], float]:
    """Return residuals and Jacobian of a machine, and how large the lengths are that residuals come from."""
    machine, data = made()[name]()
    observations = bind(machine, data)
    model = Model(machine, observations.travel, observations.run_names)
    problem = Problem(model, observations)
    theta = model.start()
    keys = [key for key in model.keys if not key.startswith("frame.")]
    for key, value in machine_cases.Case.sizeable(
        SimpleNamespace(machine=machine, model=model), keys
    ).items():
        searched = key.rsplit(".", 1)[1] in {"P", "tau"}
        theta[model.keys[key]] = value if searched else theta[model.keys[key]] + value
    frame = Frame.identity()
    if model.structure.frame:
        turn, position = ([FREE_FRAME[f"frame.{x}"] for x in several] for several in (FRAME_TURNS, "xyz"))
        frame = Frame(rotation(turn), np.array(position))
    residuals, jacobian = problem.residuals(theta, frame), problem.jacobian(theta, frame)
    reach = float(np.abs(observations.reading).max() + np.abs(residuals).max())
    return {"residuals": residuals, **{key: jacobian[..., i] for key, i in model.keys.items()}}, reach


def answers(case: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the key and the record of a machine: residuals, and a column of the Jacobian for each parameter."""
    try:
        yield case, {"arrays": evaluated(case)[0]}
    except RodgenError as error:
        yield case, {"message": str(error)}


def allowance(key: str, name: str, values: np.ndarray) -> np.ndarray:
    """Return how far residuals or a column of derivatives may be off by rounding."""
    size = evaluated(key)[1] if name == "residuals" else float(np.abs(values).max(initial=0.0))
    return np.full(values.shape, ROUNDINGS * EPS * size)
