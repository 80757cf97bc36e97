"""Every machine of which code is emitted: templates with their options and examples, in each frame, by each instrument.

A cell is a machine with errors of every kind, its commands and conditions, what rodgen predicts there, and what the
plain simulators see. Files are in millimetres and radians, as emitted code is.
"""

from __future__ import annotations

import copy
import inspect
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from machine_cases import FRAME_TURNS, FREE_FRAME, Case, data_for, effect, possible
from machine_simulator import Simulated, rotation, unit
from parallel_simulator import LEGS, Parallel

from rodgen.calibration.predict import Predictor, in_known_runs
from rodgen.calibration.problem.attitudes import matrices
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.errors import RodgenError
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.measured import MEASURANDS
from rodgen.machines.observations import Observations
from rodgen.machines.parts import BRANCHES
from rodgen.machines.templates import KINDS, machine_template

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
POSITIONS = 20
FRAMES = ("machine", "free")
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"balls": 1},
    {"balls": 3},
    {"ballbar": True},
    {"code": "[w B C b Z X Y t]"},
    {"code": "[w Y b X Z A t]"},
)
OF_INSTRUMENT = {"instrument_scale", "instrument_axis_scales", "instrument_squareness"}
"""Effects that are never the machine's."""
OF_FRAME = {"frame", "linear_drift", "warm_up_drift", "frame_shift"}
"""Those that are not where the frame is free."""
OF_READING = {
    "zero_offset", "scale", "encoder_eccentricity", "encoder_ellipticity", "periodic_drive_error", "backlash",
    "backlash_gradient", "servo_lag", "acceleration_lag", "gravity_windup", "coupling", "load_windup", "fork_flexure",
    "thermal_offset", "thermal_expansion", "bearing_waves",
}  # fmt: skip
SIX = tuple(f"L{k}" for k in range(1, 7))


def sources() -> dict[str, str]:
    """Return the text of each machine file: of templates by all options that they take, and of the examples."""
    options = {name for each in OPTIONS for name in each} | {"kind", "latitude"}
    assert options == set(inspect.signature(machine_template).parameters), (
        "an option of templates without a cell"
    )
    found = {}
    # tests/test_delta.py has the deltas; a rotary axis reads no angles
    simulated = [kind for kind in KINDS if not kind.endswith("-delta") and kind != "rotary-axis"]
    for kind, option in product(simulated, OPTIONS):
        latitude = 0.6 if kind.startswith("equatorial") else None
        try:
            text = machine_template(kind, latitude=latitude, **option)
        except RodgenError:
            continue
        if option.get("code") and kind != "table-table":  # a code stands in place of the kind
            continue
        found["_".join([kind, *(f"{name}_{x}" for name, x in option.items())])] = text
    for path in sorted(EXAMPLES.glob("*/machine.toml")):
        found[f"example_{path.parent.name}"] = path.read_text(encoding="utf-8")
    return found


def in_radians(text: str) -> dict[str, Any]:
    """Return a machine file, which is in millimetres and degrees, in radians."""
    file = tomllib.loads(text)
    assert file["units"] == {"length": "mm", "angle": "deg"}
    file["units"]["angle"] = "rad"
    for joint in file.get("joint", ()):
        if joint["type"] == "revolute" and "travel" in joint:
            joint["travel"] = [float(x) for x in np.radians(joint["travel"])]
    if file.get("family") == "3-sps-s":  # which code would not find without readings
        file["geometry"]["start"] = np.radians(file["geometry"].get("start", [10, 8, 25])).tolist()
    file["measured"].pop("noise", None)
    file.setdefault("estimate", {"parameters": []})
    file.setdefault("effect", [])
    return file


def legs_of(file: Mapping[str, Any]) -> tuple[str, ...]:
    return SIX if file.get("family") == "hexapod" else LEGS.get(file.get("family", ""), ())


# the simulators ------------------------------------------------------------------------------------------------------


class SixLegs(Simulated):
    """A hexapod with errors: six legs close by Newton's steps; the simulator of three legs has the effects of a leg."""

    def __init__(self, machine: Mapping[str, Any], effects: Mapping[str, float] | None = None) -> None:
        super().__init__({**machine, "joint": [{"name": name, "type": "leg"} for name in SIX]}, effects)

    def _take(self, key: str, value: Any) -> None:
        place, _, rest = key.partition(".")
        if place in SIX or place == "geometry":
            name, _, parameter = rest.partition(".")
            self.numbers.setdefault((place, name, None), {})[parameter] = float(value)
        else:
            super()._take(key, value)

    def joints_of(self, which: str) -> np.ndarray:
        """Return the joints of the legs on the base, ``B``, or on the platform, ``P``, with their errors."""
        name = {"B": "base_joint_offset", "P": "platform_joint_offset"}[which]
        found = []
        for k, leg in enumerate(SIX, 1):
            moves = [
                self.numbers.get(of, {}) for of in [(leg, name, None), ("geometry", f"{which}{k}", None)]
            ]
            off = [sum(move.get(x, 0.0) for move in moves) for x in "xyz"]
            found.append(np.array(self.file["geometry"][f"{which}{k}"]) + off)
        return np.array(found)

    def closed(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find position and attitude near home of one row."""
        base, platform = self.joints_of("B"), self.joints_of("P")
        place, turn = np.array(self.file["geometry"]["home"], float), np.eye(3)
        for _ in range(30):
            leg = place + platform @ turn.T - base
            now = np.linalg.norm(leg, axis=1)
            along = leg / now[:, None]
            slopes = np.hstack([along, np.cross(platform @ turn.T, along)])
            step = np.linalg.solve(slopes, length - now)
            place, turn = place + step[:3], rotation(step[3:]) @ turn
        return place, turn

    def measure(self, q: Any, *, target: Any = None, s: Any = None, t: Any = None, temperature: Any = None,
                load: Any = None, run: Any = None, **_: Any) -> np.ndarray:  # fmt: skip
        length = np.array(q, float)
        for k, leg in enumerate(SIX):
            warm = temperature[leg] - self.reference
            length[:, k] += Parallel._of_leg(self, leg, {"q": length[:, k].copy(), "s": s[:, k], "T": warm})
        soft = np.array([self.numbers.get((leg, "leg_compliance", None), {}).get("c", 0.0) for leg in SIX])
        seen = self._targets()[[self.target_names.index(name) for name in target]]
        found = []
        for row, point in enumerate(seen):
            place, turn = self.closed(length[row])
            if soft.any():
                joints = place + self.joints_of("P") @ turn.T
                pull = unit(self.joints_of("B") - joints)
                wrenches = np.concatenate([pull, np.cross(joints, pull) / 500], axis=1).T
                at = place + turn @ point
                weight = np.concatenate([self.gravity, np.cross(at, self.gravity) / 500])
                place, turn = self.closed(length[row] + soft * load[row] * np.linalg.solve(wrenches, -weight))
            found.append(place + turn @ point)
        return self._read(np.array(found), {"t": t, "T": None}, run)


def simulator(file: Mapping[str, Any], values: Mapping[str, float]) -> Any:
    made = {None: Simulated, "hexapod": SixLegs}.get(file.get("family"), Parallel)
    return made(file, {key: value for key, value in values.items() if value})


# cells ---------------------------------------------------------------------------------------------------------------


class Cell(Case):
    """A machine with errors, at some commands.

    Parameters
    ----------
    source : str
        Decides which effects and which commands: those are the same in each frame, and under a ballbar.
    file : mapping
        In radians, without effects but those of its source.
    whole : bool
        Whether every effect is in it; else one at a joint or each leg, one at targets, and those of the instrument and
        its frame.
    """

    def __init__(self, source: str, file: Mapping[str, Any], *, whole: bool = False) -> None:
        self.random = np.random.default_rng(zlib.crc32(source.partition("_ballbar")[0].encode()))
        self.file = {**file, "effect": [*file["effect"], *self._effects(file, source, whole)]}
        self.data = self._columns(file)
        self.kind = file["measured"]["kind"]
        self.joints = [*legs_of(file)] or [joint["name"] for joint in file["joint"]]

    def _effects(self, file: Mapping[str, Any], source: str, whole: bool) -> Iterator[dict[str, Any]]:
        """Yield effects that the machine can have."""
        here = {(e["name"], e.get("joint")) for e in file["effect"]}
        kind = MEASURANDS[file["measured"]["kind"]]
        alike = kind.kind if kind.moving else "direction"
        if legs := legs_of(file):
            found = [effect(d.name, leg) for leg in legs for d in CATALOGUE if "leg" in d.at]
            found += [effect(name) for name in ("linear_drift", "frame_shift", "instrument_scale")]
        else:
            found = possible({**file, "measured": {**file["measured"], "kind": alike}})
        if kind.is_pose:  # a target is given by its place alone
            found = [block for block in found if "target" not in block]
        if (
            alike != kind.kind
        ):  # no line of sight, no weight at its end, and a frame that poses would shift, too
            bends = {"target_offset", "linear_drift", "warm_up_drift", "frame_shift"}
            bends |= {definition.name for definition in CATALOGUE if definition.of_directions}
            found = [block for block in found if not (block["name"] in bends or "windup" in block["name"])]
        coupled = {
            joint["name"] for joint in file.get("joint", ()) if {"reading", "coordinate"} & joint.keys()
        }
        places: dict[str | None, list[dict[str, Any]]] = {}
        for block in found:
            place = block.get("joint") or block.get("target")
            if (block["name"], place) in here or (place in coupled and block["name"] in OF_READING):
                continue
            if (coupled or "branch" in file) and block["name"] in {
                "bearing_waves",
                "coupling",
                "fork_flexure",
            }:
                continue  # what carries a joint is not the joint before it in the file
            places.setdefault(place, []).append(block)
        joints = [joint["name"] for joint in file.get("joint", ()) if joint["name"] in places]
        one = joints[int(self.random.integers(len(joints)))] if joints else ""
        of_whole = OF_INSTRUMENT | {"refraction"}
        if file["measured"]["frame"] == "free" or source.startswith("example"):
            of_whole |= {"linear_drift", "frame_shift"}  # templates in either frame share their code
        for place, blocks in places.items():
            if whole:
                yield from blocks
            elif place is None:
                yield from (block for block in blocks if block["name"] in of_whole)
            elif place == one or place not in joints:
                yield blocks[int(self.random.integers(len(blocks)))]

    def _columns(self, file: Mapping[str, Any]) -> dict[str, Any]:
        rows, random = POSITIONS, self.random
        if not (legs := legs_of(file)):
            names = {j["name"]: j.get("reading", j["name"]) for j in file["joint"]}
            followers = {j["name"] for j in file["joint"] if "coordinate" in j and "reading" not in j}
            readings = (*(c for m in MEASURANDS.values() for c in m.columns), *FRAME_TURNS)
            bare = {**file, "measured": {**file["measured"], "kind": "point"}}
            columns = {}
            for column, x in data_for(bare, rows, random, runs=1, turn=2.5).items():
                head, bracket, tail = column.partition(" [")
                prefix, _, of = (
                    head.rpartition("_") if head.startswith(("dir_", "v_", "T_")) else ("", "", head)
                )
                if head in readings or (of in followers and prefix != "T"):
                    continue
                columns["_".join(filter(None, [prefix, names.get(of, of)])) + bracket + tail] = x
            return columns
        home = np.zeros((rows, 3))
        if file["family"] == "tricept":
            home = random.uniform([-0.3, -0.3, 580], [0.3, 0.3, 800], (rows, 3))
        elif file["family"] == "3-sps-s":
            home = np.array(file["geometry"]["start"]) + random.uniform(-0.1, 0.1, (rows, 3))
        if file["family"] == "hexapod":
            base, platform = (np.array([file["geometry"][f"{x}{k}"] for k in range(1, 7)]) for x in "BP")
            place = file["geometry"]["home"] + random.uniform(-1, 1, (rows, 3)) * [60, 60, 40]
            turn = rotation(random.uniform(-0.15, 0.15, (rows, 3)))
            q = np.linalg.norm(place[:, None] + np.einsum("nij,kj->nki", turn, platform) - base, axis=2)
        else:
            q = Parallel(file).legs(home)
        columns = {f"{leg} [mm]": q[:, k] for k, leg in enumerate(legs)}
        columns |= {f"dir_{leg}": random.choice([-1.0, 1.0], rows) for leg in legs}
        columns |= {f"T_{leg} [degC]": random.uniform(15, 35, rows) for leg in legs}
        targets = [t["name"] for t in file["target"]]
        columns["target"] = np.array([targets[i % len(targets)] for i in range(rows)])
        columns |= {"t [s]": np.sort(random.uniform(0, 4000, rows)), "load [N]": random.uniform(0, 80, rows)}
        return columns

    @cached_property
    def values(self) -> dict[str, float]:
        """Errors, none of which is zero."""
        keys = [p.key for p in self.model.parameters if p.slot[0] != "frame" and p.hold is None]
        keys.sort(
            key=lambda key: key.split(".")[0] in OF_INSTRUMENT | OF_FRAME
        )  # the machine's as in another frame
        frame = FREE_FRAME if self.file["measured"]["frame"] == "free" else {}
        turns = self.machine.measurand.moving
        return self.sizeable(keys) | {key: x for key, x in frame.items() if turns or ".r" in key}

    @cached_property
    def fitted(self) -> Machine:
        return replace(self.machine, values=self.values)

    @cached_property
    def observations(self) -> Observations:
        return bind(self.machine, Measurements.from_frame(self.data), allow_missing_readings=True)

    # predictions and simulations

    def predicted(self, values: Any = None) -> np.ndarray:
        """Return the readings that `Fit.predict` gives, of poses and attitudes with the matrix."""
        at = self.theta(self.values), self.frame(self.values)
        p = len(at[0])
        named = self.observations.run_names, "mm", 1.0
        predictor = Predictor(self.fitted, self.model, *at, np.zeros((p, p)), np.zeros((0, p)), *named)
        found = predictor.at(in_known_runs(self.observations, self.model, self.observations.run_names))
        if not found.attitude:
            return found.place
        turned = matrices("rotation vector", np.stack([*found.attitude.values()], -1)).reshape(-1, 9)
        return np.hstack([found.place, turned]) if self.machine.measurand.is_pose else turned

    @cached_property
    def arguments(self) -> dict[str, Any]:
        """Return the arguments of the simulators but the commands: columns in the order of the file."""
        d, o = self.data, self.observations
        order = [self.machine.number_of(name) for name in self.joints]
        read = {j["name"]: j.get("reading", j["name"]) for j in self.file.get("joint", ())}
        warm = {x: d.get(f"T_{read.get(x, x)} [degC]", np.full(o.n, 20.0)) for x in self.joints}
        return {
            "target": list(d["target"]), "s": np.asarray(o.s, float)[:, order], "v": o.v[:, order], "t": d["t [s]"],
            "temperature": warm, "load": d["load [N]"], "run": None,
        }  # fmt: skip

    def at_rest(self) -> Cell:
        """Return the cell with its first target alone, at rest, cold, without load, at the beginning."""
        case, rows = copy.copy(self), np.zeros(POSITIONS)
        case.arguments = {
            "target": [self.machine.targets[0].name] * POSITIONS, "s": np.zeros((POSITIONS, len(self.joints))),
            "v": np.zeros((POSITIONS, len(self.joints))), "t": rows, "load": rows, "run": None,
            "temperature": dict.fromkeys(self.joints, np.full(POSITIONS, 20.0)),
        }  # fmt: skip
        return case

    def commands(self, q: np.ndarray) -> np.ndarray:
        """Return commands in the machine's order as coordinates in the order of the file."""
        columns = dict(zip((joint.name for joint in self.machine.joints), q.T, strict=True))
        columns |= {j["reading"]: columns[j["name"]] for j in self.file.get("joint", ()) if "reading" in j}
        for j in self.file.get("joint", ()):
            if "coordinate" in j:
                columns[j["name"]] = eval(j["coordinate"], {}, columns)
        return np.stack([columns[name] for name in self.joints], -1)

    def own(self, *, instrument: bool = False) -> dict[str, float]:
        """Return the errors that are the machine's, or the others."""
        others = OF_INSTRUMENT | (OF_FRAME if self.file["measured"]["frame"] == "free" else set())
        if self.machine.measurand.has_zero:  # how it is mounted
            others |= {"about", "vertical", "target"}
        return {key: x for key, x in self.values.items() if (key.split(".")[0] in others) == instrument}

    @cached_property
    def reach(self) -> dict[str, list[float]]:
        """Travels of joints in the data."""
        return {j.name: x.tolist() for j, x in zip(self.machine.joints, self.model.reach, strict=True)}

    def plain(self, **measured: Any) -> dict[str, Any]:
        """Return the file as simulators take it, with something else measured."""
        joints = [
            {"travel": self.reach[j["name"]]}
            | {k: x for k, x in j.items() if k not in {"reading", "coordinate"}}
            for j in self.file.get("joint", ())
        ]
        found = {**self.file, "measured": {**self.file["measured"], **measured}}
        return {**found, "joint": joints} if joints else found

    def places(self, q: np.ndarray, values: Mapping[str, float], *, nominal: bool = False) -> np.ndarray:
        """Return where targets are in machine axes, by the simulator; on the nominal machine without what is held."""
        measurand = self.machine.measurand
        attitudes = not (measurand.moving or measurand.is_direction)
        kind = "pose" if measurand.is_pose or attitudes else "point" if measurand.moving else "direction"
        file = self.plain(kind=kind, frame="machine")
        made = simulator({**file, "effect": []} if nominal else file, values)
        start = {"start": self.starts} if isinstance(made, Parallel) and made.family == "3-sps-s" else {}
        found = made.measure(self.commands(q), **self.arguments, **start)
        return found[:, 3:] if attitudes else found

    @property
    def starts(self) -> np.ndarray:
        return np.broadcast_to(self.file["geometry"]["start"], (POSITIONS, 3))

    def ideal(self, q: np.ndarray) -> np.ndarray:
        """Return where the nominal machine has its targets: points as they are mounted, directions as in the file."""
        mounted = {
            key: x for key, x in self.values.items() if ".target_offset." in key or key[:7] == "target."
        }
        measurand = self.machine.measurand
        in_file = measurand.is_direction or measurand.has_zero
        return self.places(q, {} if in_file else mounted, nominal=True)

    def read(self, places: np.ndarray) -> np.ndarray:
        """Return what the instrument reads of places in machine axes, by the simulator."""
        made = simulator(self.plain(), self.own(instrument=True))
        return made._read(places, {"t": self.data["t [s]"], "T": None}, None)


def measuring(file: Mapping[str, Any], kind: str) -> dict[str, Any]:
    """Return a machine file with something else measured."""
    measurand = MEASURANDS[kind]
    measured = {key: x for key, x in file["measured"].items() if key in {"frame", "instrument"}}
    if measurand.has_origin:
        measured["from"] = file["measured"].get("from", [300.0, -200.0, 500.0])
    if measurand.line == "about":
        measured["about"] = [0.0, 0.6, 0.8]
    targets = [dict(target) for target in file["target"]]
    for k, target in enumerate(targets):
        if not measurand.moving:
            del target["point"]
        if measurand.is_direction or measurand.line == "vertical":
            target["point"] = [float(x) for x in unit([0.3 * k, 0.8, 0.5])]
    estimate, effects = file["estimate"]["parameters"], file["effect"]
    if not measurand.moving:
        slides = {j["name"] for j in file.get("joint", ()) if j["type"] == "prismatic"}
        turning = [entry for entry in estimate if entry.endswith(".axis") and entry[:-5] not in slides]
        estimate = [*turning, *(entry for entry in estimate if entry == "target")]
        effects = [block for block in effects if block.get("joint") not in slides]
    found = {**file, "target": targets, "measured": {"kind": kind, **measured}}
    return {**found, "estimate": {"parameters": estimate}, "effect": effects}


def cells() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the source and the file of each cell by its name."""
    found = {}
    for source, text in sources().items():
        file = in_radians(text)
        instruments = BRANCHES if "branch" in file else BRANCHES[:1]
        for frame, instrument in product(FRAMES, instruments):
            measured = {**file["measured"], "frame": frame}
            name = f"{source}-{frame}"
            if "branch" in file:
                measured, name = measured | {"instrument": instrument}, f"{name}-{instrument}"
            found[name] = source, {**file, "measured": measured}
    return found
