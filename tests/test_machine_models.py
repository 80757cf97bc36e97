"""The kernels of a machine against the plain simulator, which shares no code with them, effect by effect."""

from __future__ import annotations

import numpy as np
import pytest

from machine_simulator import Simulated
from rodgen.discrepancy._problem import Problem
from rodgen.discrepancy.measurements import Measurements, bind
from rodgen.machines._model import Frame, Model
from rodgen.machines.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.units import unit_factor

ARCSEC = np.pi / 648000
ROWS = 24
MACHINE = """
name = "Every effect"
[units]
length = "mm"
angle = "deg"
[environment]
gravity = [0.6, 0.0, -0.8]
[[joint]]
name = "X"
type = "prismatic"
axis = [0.98, 0.1, -0.17]
point = [10, -20, 30]
travel = [0, 400]
[[joint]]
name = "A"
type = "revolute"
axis = [0.8, 0.1, 0.59]
point = [100, 50, -20]
[[joint]]
name = "Z"
type = "prismatic"
axis = [0, 0, 1]
point = [5, 6, 7]
travel = [-100, 300]
[[joint]]
name = "C"
type = "revolute"
axis = [-0.1, 0.2, 0.97]
point = [-30, 10, 15]
{targets}
[measured]
kind = "{kind}"
frame = "{frame}"
{more}
[estimate]
parameters = {estimate}
"""
TARGETS = {
    "point": '[[target]]\nname = "p"\npoint = [120, 30, 40]\n[[target]]\nname = "r"\npoint = [-20, 90, 10]\n',
    "direction": '[[target]]\nname = "p"\npoint = [0.6, 0.8, 0]\n[[target]]\nname = "r"\npoint = [0.5, 0.7, 0.51]\n',
}
TARGETS["distance"] = TARGETS["point"]
GEOMETRIC = {"axis_tilt", "squareness", "axis_offset", "target_offset"}
ONLY_MOVES = {
    "radial_error_motion",
    "axial_error_motion",
    "thermal_axis_drift",
    "straightness",
    "instrument_scale",
}
KINDS = ["point", "direction", "distance"]


def effects(kind: str) -> list[tuple[str, str | None]]:
    """Every effect of the catalogue at every joint where it may stand, without those that are estimates here."""
    joints = {"X": "prismatic", "A": "revolute", "Z": "prismatic", "C": "revolute"}
    found: list[tuple[str, str | None]] = []
    for definition in CATALOGUE:
        if definition.name in GEOMETRIC:
            continue
        if definition.name == "refraction" and kind != "direction":
            continue
        if definition.name in ONLY_MOVES and kind == "direction":
            continue
        for joint, type in joints.items():
            slides = type == "prismatic" and definition.component == "reading"
            if type in definition.at and not (slides and kind == "direction"):
                found.append((definition.name, joint))
        if "machine" in definition.at:
            found.append((definition.name, None))
    return found


def text(kind: str, chosen: list[tuple[str, str | None]], frame: str = "machine") -> str:
    more = "from = [300, -200, 500]" if kind == "distance" else ""
    estimate = '["A.axis", "C.axis", "target"]'
    if kind != "direction":
        estimate = estimate.replace("[", '["X.axis", "A.point", "C.point", ')
    head = MACHINE.format(targets=TARGETS[kind], kind=kind, frame=frame, more=more, estimate=estimate)
    blocks = "".join(
        f'[[effect]]\nname = "{name}"\n' + (f'joint = "{joint}"\n' if joint else "") for name, joint in chosen
    )
    return head + blocks


def columns(kind: str, rng: np.random.Generator) -> dict[str, object]:
    data: dict[str, object] = {
        "X [mm]": rng.uniform(0, 400, ROWS),
        "A [deg]": rng.uniform(-100, 100, ROWS),
        "Z [mm]": rng.uniform(-100, 300, ROWS),
        "C [deg]": rng.uniform(-180, 180, ROWS),
        "target": np.where(np.arange(ROWS) % 2, "r", "p"),
        "run": np.repeat(["one", "two", "three"], ROWS // 3),
        "t [s]": np.sort(rng.uniform(0, 4000, ROWS)),
        "load [N]": rng.uniform(0, 80, ROWS),
    }
    for joint, unit in {"X": "mm", "A": "deg", "Z": "mm", "C": "deg"}.items():
        data[f"dir_{joint}"] = rng.choice([-1.0, 1.0], ROWS)
        data[f"v_{joint} [{unit}/s]"] = rng.uniform(-20, 20, ROWS)
        data[f"T_{joint} [degC]"] = rng.uniform(15, 35, ROWS)
    if kind == "direction":
        readings = rng.normal(size=(ROWS, 3))
        readings /= np.linalg.norm(readings, axis=1, keepdims=True)
        data |= {name: readings[:, i] for i, name in enumerate(["ux", "uy", "uz"])}
    elif kind == "point":
        data |= {f"{x} [mm]": rng.normal(size=ROWS) for x in "xyz"}
    else:
        data["d [mm]"] = rng.uniform(100, 200, ROWS)
    return data


class Case:
    """A machine that has every effect, with kernels and simulator side by side."""

    def __init__(self, kind: str, folder, frame: str = "machine") -> None:
        self.kind = kind
        self.effects = effects(kind)
        path = folder / f"{kind}.toml"
        path.write_text(text(kind, self.effects, frame))
        self.path = path
        self.machine = Machine.load(path)
        self.data = columns(kind, np.random.default_rng(4))
        self.observations = bind(self.machine, Measurements.from_frame(self.data))
        self.model = Model(self.machine, self.observations.travel, self.observations.run_names)
        self.problem = Problem(self.model, self.observations)
        self.keys = self.model.keys

    def size(self, key: str) -> float:
        """A sizeable value of a parameter in internal units: about 20 arcsec, 20 µm, or as far at the arms here."""
        parameter = self.model.parameters[self.keys[key]]
        name = key.rsplit(".", 1)[1]
        if name == "tau":
            return 900.0 if "warm" in key else 0.02
        if name == "P":
            return 1.3 if parameter.place in {"A", "C"} else 55.0
        unit = parameter.unit
        size = 1e-4 if "arcsec" in unit else 0.05
        for part, factor in (("arcsec/mm", 1e-7), ("/N", 0.02), ("/K", 0.1), ("/s", 1e-3)):
            if part in unit:
                size = factor if part == "arcsec/mm" else size * factor
        return {"1": 2e-4, "1/K": 1e-5}.get(unit, size)

    def theta(self, keys) -> np.ndarray:
        theta = self.model.start()
        for n, key in enumerate(keys):
            theta[self.keys[key]] = self.size(key) * (1 + 0.3 * (n % 4)) * (-1) ** (n % 3 == 2)
            if key.rsplit(".", 1)[1] in {"tau", "P"}:
                theta[self.keys[key]] = self.size(key)
        return theta

    def simulated(self, theta: np.ndarray) -> np.ndarray:
        values = {}
        for parameter, value in zip(self.model.parameters, theta, strict=True):
            if value:
                unit = parameter.unit.replace("arcsec", "deg")  # the simulator takes the units of the file
                values[parameter.key] = value / unit_factor(unit, "mm")[0]
        d = self.data
        joints = "XAZC"
        q = np.stack([d["X [mm]"], d["A [deg]"], d["Z [mm]"], d["C [deg]"]], -1)
        return Simulated(self.path, values).measure(
            q,
            target=list(d["target"]),
            s=np.stack([d[f"dir_{j}"] for j in joints], -1),
            v=np.stack([d[f"v_{j} [{'deg' if j in 'AC' else 'mm'}/s]"] for j in joints], -1),
            t=d["t [s]"],
            temperature={j: d[f"T_{j} [degC]"] for j in joints},
            load=d["load [N]"],
            run=list(d["run"]),
        )

    def predicted(self, theta: np.ndarray, frame: Frame | None = None) -> np.ndarray:
        frame = frame or Frame.identity()
        if self.kind == "distance":
            residual = self.problem.residuals(theta, frame)
            return np.asarray(self.data["d [mm]"]) - residual[:, 0]
        return self.problem.places(theta, frame)


@pytest.fixture(scope="module", params=KINDS)
def case(request, tmp_path_factory) -> Case:
    return Case(request.param, tmp_path_factory.mktemp("every_effect"))


def test_each_effect_moves_the_prediction_as_in_the_simulator(case):
    start = case.predicted(case.theta([]))
    assert np.allclose(start, np.squeeze(case.simulated(case.theta([]))), rtol=0, atol=1e-10)
    silent = []
    for name, place in case.effects:
        prefix = f"{place}.{name}" if place else name
        keys = [key for key in case.keys if key.startswith((f"{prefix}.", f"{prefix}["))]
        assert keys, prefix
        theta = case.theta(keys)
        found, expected = case.predicted(theta), np.squeeze(case.simulated(theta))
        # 1e-11 of a place some 500 mm away: rounding of about fifty operations
        assert np.allclose(found, expected, rtol=0, atol=1e-8 if case.kind != "direction" else 1e-13), (
            prefix,
            np.abs(found - expected).max(),
        )
        if np.allclose(found, start, rtol=0, atol=1e-9 if case.kind != "direction" else 1e-12):
            silent.append(prefix)
    if case.kind != "direction":
        assert not silent


def test_all_effects_at_once_agree_with_the_simulator(case):
    theta = case.theta(list(case.keys))
    found, expected = case.predicted(theta), np.squeeze(case.simulated(theta))
    assert np.allclose(found, expected, rtol=0, atol=1e-8 if case.kind != "direction" else 1e-12)
