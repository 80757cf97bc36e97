"""Machines with data, held by rodgen and by the plain simulator at once: what the tests of models and fits share.

The files of these machines are in millimetres and radians, so that a number means the same in the file, in the
simulator and inside rodgen, and no unit stands between them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from kinematics_cases import unit
from machine_simulator import COMPONENTS, Simulated, rotation

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations

ARCSEC = np.pi / 648000
READINGS = {
    "point": ("x", "y", "z"),
    "direction": ("ux", "uy", "uz"),
    "distance": ("d",),
    "height": ("d",),
    "pose": ("x", "y", "z", "rx", "ry", "rz"),
    "angle": ("angle",),
}
FRAME_TURNS = ("rx", "ry", "rz")
FRAME = ("frame.x", "frame.y", "frame.z", "frame.rx", "frame.ry", "frame.rz")
MOVES_ONLY = {
    "radial_error_motion",
    "axial_error_motion",
    "thermal_axis_drift",
    "straightness",
    "instrument_scale",
}
"""Effects that move and do not turn: where directions are measured they change nothing."""

Values = Mapping[str, float]


def joint(name: str, type: str, axis: Any, point: Any = (0, 0, 0), **more: Any) -> dict[str, Any]:
    axis, point = ([float(x) for x in vector] for vector in (axis, point))
    return {"name": name, "type": type, "axis": axis, "point": point, **more}


def machine_file(
    joints: Sequence[Mapping[str, Any]],
    targets: Any = ((120, 30, 40),),
    *,
    kind: str = "point",
    frame: str = "machine",
    estimate: Iterable[str] = (),
    effects: Iterable[Mapping[str, Any]] = (),
    gravity: Any = (0, 0, -1),
    **measured: Any,
) -> dict[str, Any]:
    """Make what stands in a machine file; the targets are called p, r, s, ..."""
    if kind == "distance":
        measured = {"from": [300.0, -200.0, 500.0], **measured}
    return {
        "name": "A machine",
        "units": {"length": "mm", "angle": "rad"},
        "environment": {"gravity": [float(x) for x in gravity], "reference_temperature": 20.0},
        "joint": [dict(j) for j in joints],
        "target": [
            {"name": name, "point": [float(x) for x in point]}
            for name, point in zip("prstuvwxyz", targets, strict=False)
        ],
        "measured": {"kind": kind, "frame": frame, **measured},
        "estimate": {"parameters": list(estimate)},
        "effect": [dict(effect) for effect in effects],
    }


def effect(name: str, place: str | None = None, *, target: bool = False, **more: Any) -> dict[str, Any]:
    """Make an [[effect]] of the file."""
    return {"name": name, **({("target" if target else "joint"): place} if place else {}), **more}


def possible(file: Mapping[str, Any], *, places: Iterable[str | None] | None = None) -> list[dict[str, Any]]:
    """List every effect of the catalogue that can stand in a machine, at some of its joints or at all of them."""
    kind = file["measured"]["kind"]
    types = {j["name"]: j["type"] for j in file["joint"]}
    estimated = set(file["estimate"]["parameters"])
    chosen = {*types, None, *(t["name"] for t in file["target"])} if places is None else set(places)
    found = []
    for definition in CATALOGUE:
        if definition.of_directions and kind != "direction":
            continue
        if definition.component == "plate" or (
            definition.component == "axes" and kind not in {"point", "pose"}
        ):
            continue
        if kind == "direction" and (definition.name in MOVES_ONLY or definition.component == "point"):
            continue
        for before, (name, type) in zip([None, *types.values()], types.items(), strict=False):
            if definition.name in {"bearing_waves", "coupling", "fork_flexure"} and before != "revolute":
                continue
            slides = type == "prismatic" and definition.component in {"reading", "axis"}
            same = f"{name}.{definition.component}" in estimated
            if type in definition.at and name in chosen and not same and not (kind == "direction" and slides):
                found.append(effect(definition.name, name))
        if "machine" in definition.at and None in chosen:
            found.append(effect(definition.name))
        if "target" in definition.at and ("target" not in estimated or definition.per_run):
            found += [
                effect(definition.name, t["name"], target=True) for t in file["target"] if t["name"] in chosen
            ]
    return found


def data_for(
    file: Mapping[str, Any], rows: int, rng: np.random.Generator, *, runs: int = 2, turn: float = 3.0
) -> dict[str, Any]:
    """Make columns of everything that an effect may need; the readings are of the right kind and mean nothing.

    Revolute joints go over ± `turn` rad; prismatic ones over their travel.
    """
    data: dict[str, Any] = {}
    for j in file["joint"]:
        name, slides = j["name"], j["type"] == "prismatic"
        low, high = j.get("travel", (-200.0, 300.0) if slides else (-turn, turn))
        length = "mm" if slides else "rad"
        data[f"{name} [{length}]"] = rng.uniform(low, high, rows)
        data[f"dir_{name}"] = rng.choice([-1.0, 1.0], rows)
        data[f"v_{name} [{length}/s]"] = rng.uniform(-20, 20, rows) * (1 if slides else 0.02)
        data[f"T_{name} [degC]"] = rng.uniform(15, 35, rows)
    names = [t["name"] for t in file["target"]]
    more = np.random.default_rng(9)  # the other columns stay as they were
    data["target"] = np.array([names[i % len(names)] for i in range(rows)])
    data["run"] = np.array([f"r{runs * i // rows}" for i in range(rows)])
    data["t [s]"] = np.sort(rng.uniform(0, 4000, rows))
    data["load [N]"] = rng.uniform(0, 80, rows)
    for j in file["joint"]:
        slides = j["type"] == "prismatic"
        data[f"a_{j['name']} [{'mm' if slides else 'rad'}/s^2]"] = more.uniform(-20, 20, rows) * (
            1 if slides else 0.02
        )
    kind = file["measured"]["kind"]
    readings = rng.normal(size=(rows, 3))
    if kind == "direction":
        readings = unit(readings)
    if kind == "pose":
        data |= {f"{name} [rad]": x for name, x in zip(FRAME_TURNS, rng.normal(size=(3, rows)), strict=True)}
    for i, name in enumerate(READINGS[kind][:3]):
        data[name if kind == "direction" else f"{name} [mm]"] = (
            np.abs(readings[:, i]) + 1 if name == "d" else readings[:, i]
        )
    return data


def toml(file: Mapping[str, Any]) -> str:
    """Write what `machine_file` makes as TOML."""

    def value(x: Any) -> str:
        if isinstance(x, Mapping):
            return "{" + ", ".join(f"{json.dumps(k)} = {value(v)}" for k, v in x.items()) + "}"
        return json.dumps(x, ensure_ascii=False)

    lines = []
    for name, part in file.items():
        if isinstance(part, str):
            lines.append(f"{name} = {value(part)}")
            continue
        for block in part if isinstance(part, list) else [part]:
            lines.append(f"[[{name}]]" if isinstance(part, list) else f"[{name}]")
            lines += [f"{key} = {value(x)}" for key, x in block.items()]
    return "\n".join(lines)


class Case:
    """A machine file and columns of data.

    Parameters
    ----------
    file : mapping
        As `machine_file` makes it.
    data : mapping of str to array
        Columns with their units, as `data_for` makes them.
    """

    def __init__(self, file: Mapping[str, Any], data: Mapping[str, Any]) -> None:
        self.file = file
        self.data = dict(data)
        self.kind = file["measured"]["kind"]
        self.joints = [j["name"] for j in file["joint"]]

    def changed(self, **more: Any) -> Case:
        """Return the case with another machine file or other data."""
        return Case(**{"file": self.file, "data": self.data, **more})

    @cached_property
    def machine(self) -> Machine:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "machine.toml"
            path.write_text(toml(self.file), encoding="utf-8")
            return Machine.load(path)

    @cached_property
    def observations(self) -> Observations:
        return bind(self.machine, Measurements.from_frame(self.data))

    @cached_property
    def model(self) -> Model:
        return Model(self.machine, self.observations.travel, self.observations.run_names)

    @cached_property
    def problem(self) -> Problem:
        return Problem(self.model, self.observations)

    @cached_property
    def arguments(self) -> dict[str, Any]:
        """Return the arguments of the simulator for the rows."""
        types = {j["name"]: j["type"] for j in self.file["joint"]}
        units = {name: "mm" if types[name] == "prismatic" else "rad" for name in self.joints}
        known = {f"{name} [{u}]" for name, u in units.items()} | {"target", "run", "t [s]", "load [N]"}
        known |= {f"{prefix}_{name}" for prefix in ("dir", "v", "T") for name in self.joints}
        d = self.data
        rows = len(d["target"])

        def table(prefix: str, unit: str, missing: float) -> np.ndarray | None:
            columns = [d.get(f"{prefix}_{n}{unit.format(units[n])}") for n in self.joints]
            if all(column is None for column in columns):
                return None
            return np.stack([np.full(rows, missing) if c is None else c for c in columns], -1)

        covariates = {
            name.partition(" [")[0]: values
            for name, values in d.items()
            if name.partition(" [")[0] not in {k.partition(" [")[0] for k in known}
            and name.partition(" [")[0] not in READINGS[self.kind]
        }
        return {
            "q": np.stack([d[f"{n} [{units[n]}]"] for n in self.joints], -1),
            "target": list(d["target"]),
            "s": table("dir", "", 0.0),
            "v": table("v", " [{}/s]", 0.0),
            "t": d.get("t [s]"),
            "temperature": {n: d[f"T_{n} [degC]"] for n in self.joints if f"T_{n} [degC]" in d},
            "load": d.get("load [N]"),
            "run": list(d["run"]) if "run" in d else None,
            "covariates": covariates,
        }

    def simulated(self, values: Values | None = None) -> np.ndarray:
        """Return what the simulator reads, (rows, 3) or (rows, 1)."""
        values = dict(values or {})
        formulas: dict[str, list[Callable[..., Any]]] = {}
        for block in self.file["effect"]:
            parts = {block["component"]: block["formula"]} if "formula" in block else {}
            parts |= {component: block[component] for component in COMPONENTS if component in block}
            if parts:
                place = block.get("joint") or block.get("target")
                key = ".".join(filter(None, [place, block["name"]]))
                own = {name: values.pop(f"{key}.{name}", 0.0) for name in block["parameters"]}
            for component, formula in parts.items():
                where = ".".join(filter(None, [place, component]))
                formulas.setdefault(where, []).append(python_s(formula, own))
        effects: dict[str, Any] = {key: value for key, value in values.items() if value}
        for where, several in formulas.items():
            effects[where] = lambda columns, several=several: sum(f(columns) for f in several)
        arguments = dict(self.arguments)
        return Simulated(self.file, effects).measure(arguments.pop("q"), **arguments)

    def theta(self, values: Values | None = None) -> np.ndarray:
        theta = self.model.start()
        for key, value in (values or {}).items():
            theta[self.model.keys[key]] = 0.0 if key.startswith("frame.") else value
        return theta

    def frame(self, values: Values | None = None) -> Frame:
        at = np.array([(values or {}).get(key, 0.0) for key in FRAME])
        return Frame(rotation(at[3:]), at[:3])

    def predicted(self, values: Values | None = None) -> np.ndarray:
        """Return what rodgen's kernels predict, (rows, 3) or (rows, 1), of poses (rows, 12)."""
        theta, frame = self.theta(values), self.frame(values)
        if self.kind == "pose":
            turned = self.problem.attitudes(theta, frame).reshape(-1, 9)
            return np.concatenate([self.problem.places(theta, frame), turned], axis=1)
        if self.kind != "distance":
            return self.problem.places(theta, frame)
        return self.observations.reading - self.problem.residuals(theta, frame)

    def keys_of(self, block: Mapping[str, Any]) -> list[str]:
        """Return the keys of the parameters of an [[effect]]."""
        prefix = ".".join(filter(None, [block.get("joint") or block.get("target"), block["name"]]))
        return [key for key in self.model.keys if key.startswith((f"{prefix}.", f"{prefix}["))]

    def sizeable(self, keys: Iterable[str], factor: float = 1.0) -> dict[str, float]:
        """Return errors that are plain to see: some 20 arcsec, 50 µm, or as far at arms of 500 mm, of either sign."""
        values = {}
        for n, key in enumerate(keys):
            parameter = self.model.parameters[self.model.keys[key]]
            name = key.rsplit(".", 1)[1]
            if name == "P":
                revolute = self.machine.joint(str(parameter.place)).type == "revolute"
                values[key] = 1.3 if revolute else 55.0
            elif name == "tau":
                values[key] = 900.0 if parameter.effect == "warm_up_drift" else 0.02
            else:
                values[key] = factor * size(parameter.unit) * (1 + 0.3 * (n % 4)) * (-1) ** (n % 3 == 2)
        return values


WORDS = {"pi": np.pi, "sin": np.sin, "cos": np.cos, "tan": np.tan, "exp": np.exp, "log": np.log}
WORDS |= {"sqrt": np.sqrt, "abs": np.abs, "sign": np.sign}


def python_s(formula: str, parameters: Values) -> Callable[[Mapping[str, Any]], Any]:
    """Let Python evaluate a user's formula; a column of temperatures is seen from the reference of 20 degrees."""
    code = compile(formula.replace("^", "**"), "formula", "eval")

    def value(columns: Mapping[str, Any]) -> Any:
        warm = {name: x - 20.0 for name, x in columns.items() if name.startswith("T_")}
        return eval(code, {**WORDS, **columns, **warm, **parameters})

    return value


def size(unit: str) -> float:
    """Return a sizeable value of a parameter that is shown in this unit."""
    if unit == "1/K":
        return 1e-5
    if unit == "1":
        return 2e-4
    value = 1e-4 if "arcsec" in unit else 0.05
    for part, smaller in (("/mm", 1e-3), ("/N", 0.02), ("/K", 0.1), ("/s", 1e-3)):
        if part in unit:
            value *= smaller
    return value


# a machine with every effect ------------------------------------------------------------------------------------

ROWS = 24
FREE_FRAME = {
    "frame.x": 700.0, "frame.y": -150.0, "frame.z": 90.0, "frame.rx": 1.1, "frame.ry": -2.0, "frame.rz": 0.7,
}  # fmt: skip
JOINTS = [
    joint("B", "revolute", [0.3, 0.9, -0.2], [20, -30, 10]),
    joint("A", "revolute", [0.8, 0.1, 0.59], [100, 50, -20]),
    joint("Z", "prismatic", [0.1, -0.2, 0.97], [5, 6, 7], travel=[-100.0, 300.0]),
    joint("C", "revolute", [-0.1, 0.2, -0.97], [-30, 10, 15]),
]
TARGETS = [(120, 30, 40), (-20, 90, 10)]


def _estimate(kind: str) -> list[str]:
    moving = ["B.point", "C.point"] if kind != "direction" else []
    return ["B.axis", "C.axis", *moving]


@cache
def every(kind: str) -> Case:
    """Return a machine with every effect: at A and Z, of the whole machine, at the targets."""
    file = machine_file(
        JOINTS, TARGETS, kind=kind, frame="free", estimate=_estimate(kind), gravity=(0.6, 0, -0.8)
    )
    file["effect"] = possible(file, places=["A", "Z", None, "p", "r"])
    return Case(file, data_for(file, ROWS, np.random.default_rng(4)))


def frame(kind: str) -> dict[str, float]:
    return {key: value for key, value in FREE_FRAME.items() if kind != "direction" or ".r" in key}


Title = tuple[str, str | None]


def title(block: Mapping[str, Any]) -> Title:
    """Return name and place of an [[effect]]."""
    return block["name"], block.get("joint") or block.get("target")


def with_effects(
    kind: str, chosen: Iterable[Title], data: Mapping[str, Any], *, geometry_known: bool, **measured: Any
) -> Case:
    """Return the machine of every effect with some that are estimated; the others are held where they do nothing.

    So all of these machines share the kernels of one. Where the geometry is not known, axes, points and targets are
    estimated, too.
    """
    case, chosen = every(kind), set(chosen)
    file = dict(case.file)
    effects = []
    if geometry_known:
        for name, what in (entry.split(".") for entry in file["estimate"]["parameters"]):
            same = {"axis": "axis_tilt", "point": "axis_offset"}[what]
            effects.append(effect(same, name, hold={"a": 0.0, "b": 0.0}))
        file["estimate"] = {"parameters": []}
    for block in case.file["effect"]:
        geometric = block["name"] in {"axis_tilt", "axis_offset", "squareness", "target_offset"}
        if title(block) in chosen or (geometric and not geometry_known):
            effects.append(block)
            continue
        held = sorted({key.rsplit(".", 1)[1] for key in case.keys_of(block)})
        positive = {"P"} if block["name"] == "servo_lag" else {"P", "tau"}
        effects.append(block | {"hold": {name: float(name in positive) for name in held}})
    file["effect"] = effects
    file["measured"] = file["measured"] | measured
    made = Case(file, data)
    assert made.model.structure == case.model.structure
    return made


def noisy(kind: str, reading: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """Add the noise of an instrument; across a direction, so that its length stays 1."""
    noise = size * rng.normal(size=reading.shape)
    return reading + noise if kind != "direction" else unit(reading + np.cross(noise, reading))


# a machine with formulas of its own ----------------------------------------------------------------------------

OWN = [  # component, formula, units of its parameters, values
    ("A", "reading", "a*sin(3*q) + b*sign(s)*F + k*T*q", {"a": "rad", "b": "rad/N", "k": "1/K"}, (1e-3, 2e-5, 1e-4)),
    ("A", "tx", "a*cos(q) - b*(t/c)**2 + d*abs(v)", {"a": "mm", "b": "mm", "c": "s", "d": "mm*s"}, (0.3, 0.1, 900, 1)),
    ("A", "ty", "a*log(2 + flow)/sqrt(1 + flow^2)", {"a": "mm"}, (0.4,)),
    ("A", "tz", "-a*Z*tan(B/4)", {"a": "1"}, (2e-3,)),
    ("A", "rx", "a*exp(-t/tau)*sign(C)", {"a": "rad", "tau": "s"}, (2e-3, 1500)),
    ("A", "ry", "a*q**3 - 2**-1*b*s", {"a": "1", "b": "rad"}, (1e-4, 1e-3)),
    ("A", "rz", "a*abs(sin(q))", {"a": "rad"}, (2e-3,)),
    ("Z", "reading", "a*sin(2*pi*q/P)*s + k*q*T", {"a": "mm", "P": "mm", "k": "1/K"}, (0.1, 50, 1e-5)),
    ("Z", "rz", "a*q*C", {"a": "1/mm"}, (1e-5,)),
    ("Z", "ty", "a*q^2/L0 + b*flow", {"a": "1", "L0": "mm", "b": "mm"}, (0.2, 400, 0.1)),
    (None, "tx", "a*(T_room - T0) + b*sin(2*t/D)", {"a": "mm/K", "T0": "K", "b": "mm", "D": "s"}, (0.05, 7, 0.2, 300)),
    (None, "ry", "a*flow*cos(A)", {"a": "rad"}, (1e-3,)),
    (None, "rz", "a/(1 + exp(-flow))", {"a": "rad"}, (1e-3,)),
    ("p", "tz", "a*F + b*Z*sin(C)", {"a": "mm/N", "b": "1"}, (0.01, 1e-3)),
    ("p", "tx", "a*cos(B)", {"a": "mm"}, (0.2,)),
    ("r", "rx", "a*cos(B)*F", {"a": "rad/N"}, (2e-5,)),
]  # fmt: skip


@cache
def own(kind: str) -> tuple[Case, dict[str, float]]:
    """Return a machine with formulas of its own, and values of their parameters."""
    blocks: list[dict[str, Any]] = []
    numbers: dict[str, float] = {}
    for n, (place, component, formula, parameters, given) in enumerate(OWN):
        turns, target = component in {"rx", "ry", "rz"}, place in {"p", "r"}
        slides = place == "Z" and component == "reading"
        if (kind == "direction" and not turns and (component != "reading" or slides)) or (
            kind != "direction" and target and turns
        ):
            continue
        key = "target" if target else "joint"
        blocks.append(
            {"name": f"own_{n}", "component": component, "formula": formula, "parameters": parameters}
        )
        blocks[-1] |= {"meaning": "Something."} | ({key: place} if place else {})
        values = dict(zip(parameters, given, strict=True))
        numbers |= {".".join(filter(None, [place, f"own_{n}", name])): x for name, x in values.items()}
    if kind != "direction":
        numbers |= {"Z.point.a": 3.0, "Z.point.b": -2.0}
    estimate = [] if kind == "direction" else ["Z.point"]
    file = machine_file(JOINTS, TARGETS, kind=kind, estimate=estimate, effects=blocks, gravity=(0.6, 0, -0.8))
    rng = np.random.default_rng(14)
    more = {"flow": rng.uniform(0, 4, ROWS), "T_room [degC]": rng.uniform(15, 30, ROWS)}
    return Case(file, data_for(file, ROWS, rng) | more), numbers


def several(kind: str) -> tuple[Case, dict[str, float]]:
    """Return a machine whose effects change several components each, and their parameters."""
    moves = {} if kind == "direction" else {"ty": "b*cos(q)", "tz": "b*C"}
    more = {} if kind == "direction" else {"tx": "c*b", "tz": "-b*B"}
    units = {"a": "rad", "b": "mm/rad"} if moves else {"a": "rad"}
    blocks = [
        {"name": "own_1", "joint": "A", "reading": "a*sin(B)", "rx": "a*cos(2*q)*w", "rz": "-a*w", **moves},
        {"name": "own_2", "rx": "a*sin(B)", "ry": "a*w**2", **more},
    ]
    blocks[0]["parameters"] = units
    blocks[1]["parameters"] = units | ({"c": "rad"} if moves else {})
    file = machine_file(JOINTS, TARGETS, kind=kind, effects=blocks)
    rng = np.random.default_rng(9)
    data = data_for(file, ROWS, rng) | {"w": rng.uniform(-1, 1, ROWS)}
    case = Case(file, data)
    return case, {key: 0.02 if key.endswith(".a") else 1.5 for key in case.model.keys}


def skyward() -> tuple[Case, dict[str, float]]:
    """Return a mount with formulas of the zenith angle and the azimuth, and their parameters."""
    blocks = [
        {"name": "own_1", "joint": "A", "component": "reading", "formula": "a*sin(z)*cos(azimuth)"},
        {"name": "own_2", "component": "rx", "formula": "a*z + a*azimuth/10"},
        {"name": "own_3", "target": "p", "component": "rz", "formula": "a*tan(z/2)"},
    ]
    blocks = [block | {"parameters": {"a": "rad"}} for block in blocks]
    file = machine_file(
        JOINTS,
        TARGETS,
        kind="direction",
        gravity=(0.6, 0, -0.8),
        estimate=["B.axis", "C.axis"],
        effects=blocks,
    )
    case = Case(file, data_for(file, ROWS, np.random.default_rng(10)))
    return case, {key: 0.02 for key in case.model.keys if key.endswith(".a") and "own" in key}
