"""Does a diagnosis find what was hidden? Machines with one thing more than their file says, and a sealed answer.

A case is what a user has (a machine file, a measurement file) and the truth, which opens only for a finished diagnosis.
The readings come from the independent simulator, which shares no code with rodgen and has real physics besides the
catalogue's formulas: a graduation off its axis by exact geometry, play with memory, bodies that follow their
temperature late, beams. Nothing of rodgen is used here.

    case = hidden("trunnion", seed=3, effects=[("encoder_eccentricity", "C")], raises=1.2)
    machine, data = case.write(folder)
    truth = case.sealed.open(diagnosis)                          # of rodgen, given these two files

How large an effect is, is said by what it does: `raises` is the factor by which it raises the RMS of the base fit. What
the base fit absorbs does not count; the part that is left is found by projecting the effect off the derivatives by the
base's parameters, which are differences of the simulator.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from machine_simulator import RADIANS, SIX, Simulated, approach, arcsec, carried, rigid

Array = np.ndarray[Any, np.dtype[np.float64]]
Title = tuple[str, str | None]


# The sealed truth ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """What was hidden.

    Attributes
    ----------
    kind : {"none", "catalogue", "outside"}
    effects : tuple of (name, place)
        By the names of the catalogue; of physics that it approximates, the nearest; of what lies outside, those that
        may stand beside it.
    values : mapping of str to float
        What the simulator was given, units of the machine file.
    exact : bool
        Whether the catalogue's formulas are those of the simulator, so that parameters can be compared.
    drivers : frozenset of str
        Columns that the effect outside the catalogue depends on.
    place : str or None
        Where it acts.
    raises : float
        Factor by which all of it together raises the RMS of the base fit.
    outliers : frozenset of int
    sigma : float
        Standard deviation of a reading's own noise, units of the file.
    wanders : str
        What is not independent from row to row, as :func:`hidden` has it.
    seen : frozenset of (name, place)
        Of machines as they are met, the effects that their readings must show.
    shown : frozenset of (name, place)
        Those that are rather found than not, one after the other.
    equal : mapping of (name, place) to tuple of (name, place)
        What says the same of the machine, by its formula, itself included.
    inexact : frozenset of (name, place)
        Effects of which parameters cannot be compared.
    known : frozenset of str
        Parameters of the base that nothing else imitates, so that they can be.
    reach : float
        Length of the longest lever arm.
    chance : mapping of (name, place) to float
        How often such machines have an effect.
    windup : mapping of (name, place) to float
        By how much a joint yields where all weights that it carries have a lever arm of one, arcsec per mm.
    """

    kind: str
    effects: tuple[Title, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    exact: bool = True
    drivers: frozenset[str] = frozenset()
    place: str | None = None
    raises: float = 1.0
    outliers: frozenset[int] = frozenset()
    sigma: float = 0.0
    wanders: str = ""
    seen: frozenset[Title] = frozenset()
    shown: frozenset[Title] = frozenset()
    equal: Mapping[Title, tuple[Title, ...]] = field(default_factory=dict)
    inexact: frozenset[Title] = frozenset()
    known: frozenset[str] = frozenset()
    reach: float = 1.0
    chance: Mapping[Title, float] = field(default_factory=dict)
    windup: Mapping[Title, float] = field(default_factory=dict)


class Sealed:
    """A truth that opens for a finished diagnosis, and for nothing else."""

    def __init__(self, truth: Truth) -> None:
        self._read: Callable[[], Truth] = lambda: truth
        self.opened = False

    def open(self, diagnosis: Any) -> Truth:
        """Give the truth; `diagnosis` is one, or the dictionary that the command line prints."""
        verdict = diagnosis["verdict"] if isinstance(diagnosis, Mapping) else diagnosis.verdict
        if verdict not in {
            "nothing_missing",
            "effects_missing",
            "wrong_geometry",
            "unknown_effect",
            "cannot_tell",
        }:
            raise ValueError(f"verdict {verdict!r}: no finished diagnosis; the truth stays sealed")
        self.opened = True
        return self._read()

    def __repr__(self) -> str:
        return "Sealed(opened)" if self.opened else "Sealed()"


@dataclass(frozen=True)
class Hidden:
    """What the user has, and the sealed truth."""

    name: str
    bench: Bench = field(repr=False)
    measured: Mapping[str, Any] = field(repr=False)  # arguments of Simulated.write_csv
    text: str = field(repr=False)  # of the machine file
    sealed: Sealed
    further: Mapping[str, Any] | None = field(repr=False, default=None)  # independent readings of other poses

    def write(self, folder: str | Path) -> tuple[Path, Path]:
        """Write machine.toml and data.csv; give their paths."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        machine, data = folder / "machine.toml", folder / "data.csv"
        machine.write_text(self.text, encoding="utf-8")
        self._write(data, self.measured)
        return machine, data

    def write_further(self, path: str | Path) -> Path:
        """Write independent readings of other poses, without gross errors and with a set-up that stands still."""
        assert self.further is not None
        self._write(Path(path), self.further)
        return Path(path)

    def _write(self, path: Path, measured: Mapping[str, Any]) -> None:
        simulator = self.bench.simulator(tomllib.loads(self.text))
        # a mount tracks its stars: the order of the rows does not tell from which side it came, the user notes it
        noted = {"s": approach(measured["q"])} if simulator.kind == "direction" else {}
        simulator.write_csv(path, **measured, **noted)


# Machines, and what was done with them ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Bench:
    """A machine with a plan of measurement; columns are by row."""

    name: str
    text: str  # the machine file, with {noise} where the noise may be stated
    base: tuple[str, ...]  # keys of the simulator that the base fit finds
    wrong: Mapping[str, float]  # their values: the machine is not quite as drawn
    sigma: float  # of the noise, units of the file
    q: Array  # (rows, joints)
    target: list[str]
    pose: Array
    columns: Mapping[str, Any]  # t, load, v, run, temperature
    natural: Mapping[Title, Mapping[str, float]]  # effects that can hide here, with sizes in proportion
    simulator: type[Simulated] = Simulated
    physics: Mapping[str, tuple[str, Mapping[str, float]]] | None = None  # other than PHYSICS
    weights: tuple[Mapping[str, Any], ...] = ()  # of its parts, which the machine file does not tell
    arm: float = 1.0  # of poses: noise of a coordinate over that of a turn, length per radian

    @property
    def file(self) -> dict[str, Any]:
        return {**tomllib.loads(self.text.replace("{noise}", "")), "weight": self.weights}

    @property
    def kind(self) -> str:
        return str(self.file["measured"]["kind"])

    def measure(self, effects: Mapping[str, Any], columns: Mapping[str, Any] | None = None) -> Array:
        return self.simulator(self.file, {**self.wrong, **effects}).measure(
            self.q, target=self.target, **(self.columns if columns is None else columns)
        )

    def difference(self, to: Array, of: Array) -> Array:
        """Give how readings differ, flat, units of the file (an angle for directions); turns as lengths on `arm`."""
        if self.kind == "pose":
            a, b = (reading[:, 3:].reshape(-1, 3, 3) for reading in (to, of))
            turns = (a @ b.swapaxes(1, 2) - b @ a.swapaxes(1, 2)) / 2  # sine of the angle
            vector = np.stack([turns[:, 2, 1], turns[:, 0, 2], turns[:, 1, 0]], -1)
            return np.concatenate([(to - of)[:, :3], self.arm * vector], axis=1).ravel()
        factor = 1 / RADIANS[self.file["units"]["angle"]] if self.kind == "direction" else 1.0
        return (to - of).ravel() * factor

    def rms(self, difference: Array) -> float:
        """Give the RMS per scalar reading: of a direction two."""
        readings = len(self.q) * {"point": 3, "direction": 2, "distance": 1, "pose": 6}[self.kind]
        return float(np.sqrt(difference @ difference / readings))

    def noise(self, ones: Array) -> Array:
        """Give noise of the instrument from numbers of size 1."""
        if self.kind != "pose":
            return self.sigma * ones
        return self.sigma * ones / np.repeat([1.0, self.arm * RADIANS[self.file["units"]["angle"]]], 3)

    def derivatives(self, keys: Sequence[str], at: Mapping[str, float] | None = None) -> Array:
        """Give derivatives (readings, keys) by differences of the simulator, scaled to length 1."""
        at = dict(at or {})
        columns = []
        for key in keys:
            value = at.get(key, self.wrong.get(key, 0.0))
            step = max(1e-3, 1e-3 * abs(value))
            ends = [self.measure(at | {key: value + s}) for s in (step, -step)]
            columns.append(self.difference(*ends))
        c = np.stack(columns, -1) if columns else np.zeros((self.difference(self.q[:1], self.q[:1]).size, 0))
        length = np.linalg.norm(c, axis=0)
        return c / np.where(length > 0, length, 1.0)


def off(columns: Array, x: Array) -> Array:
    """Give what columns of length 1 cannot imitate."""
    if not columns.shape[1]:
        return x
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-7 * s[0]]
    return x - u @ (u.T @ x)


def _conditions(joints: Sequence[str], q: Array, each: int, random: np.random.Generator) -> dict[str, Any]:
    """Give times, temperatures, loads, speeds and runs of poses as rows: what an honest measurement plan notes."""
    poses = len(q)
    t = np.cumsum(random.uniform(20, 40, poses))
    warm = {}
    for name in joints:
        slow, fast = random.uniform(0.3, 0.8), random.uniform(0.25, 0.6)
        cycle = np.sin(2 * np.pi * (t / t[-1] / fast + random.uniform()))
        warm[name] = np.round(
            20 + random.uniform(3, 6) * (1 - np.exp(-t / t[-1] / slow)) + random.uniform(1, 2) * cycle, 2
        )
    moved = np.sign(np.diff(q, axis=0, prepend=q[1:2] * 0 + 2 * q[:1] - q[1:2]))
    speed = np.round(moved * random.choice([2.0, 6.0, 15.0], size=q.shape), 1)
    load = random.choice([0.0, 30.0, 60.0], poses)
    rows = {"t": np.round(t, 1), "load": load, "v": speed, "run": 1 + np.arange(poses) * 3 // poses}
    rows = {name: np.repeat(x, each, axis=0) for name, x in rows.items()}
    rows["temperature"] = {name: np.repeat(x, each) for name, x in warm.items()}
    return rows


MICRON, SECOND = 1e-3, arcsec(1.0)
_HARMONICS = ("c1", "s1", "c2", "s2")
_ACROSS = [f"{w}_{h}" for w in "uv" for h in _HARMONICS]


def _natural(
    kind: str, joints: Sequence[tuple[str, str]], targets: Sequence[str]
) -> dict[Title, dict[str, float]]:
    """List effects that can hide in a machine, with the sizes of their parameters in proportion."""
    found: dict[Title, dict[str, float]] = {}
    points = kind != "direction"
    windup = 0.01 * SECOND if points else SECOND  # an angle over a lever arm of a hundred units
    for name, type_ in joints:
        turns = type_ == "revolute"
        reading = SECOND if turns else MICRON

        def put(effect: str, sizes: Mapping[str, float], name: str = name) -> None:
            found[effect, name] = dict(sizes)

        if not turns and not points:
            continue
        put("axis_tilt" if turns else "squareness", {"a": SECOND, "b": SECOND})
        put("zero_offset", {"a": reading})
        put("scale", {"k": 1e-6})
        put("backlash", {"b": reading})
        put("backlash_gradient", {"k": 1e-6})
        put("servo_lag", {"tau": 1e-3})
        put("thermal_offset", {"k": reading})
        put("periodic_drive_error", {"a": reading, "b": reading, "P": 37.0 if turns else 45.0})
        if turns:
            put("encoder_eccentricity", {"a": SECOND, "b": SECOND})
            put("encoder_ellipticity", {"a": SECOND, "b": SECOND})
            put("tilt_error_motion", dict.fromkeys(_ACROSS, SECOND))
            put("gravity_windup", {"k": windup})
            put("load_windup", {"k": SECOND})
            put("lateral_windup", {"a": windup})
            if points:
                put("axis_offset", {"a": MICRON, "b": MICRON})
                put("radial_error_motion", dict.fromkeys(_ACROSS, MICRON))
                put("axial_error_motion", dict.fromkeys(_HARMONICS, MICRON))
                put("thermal_axis_drift", dict.fromkeys("xyz", MICRON))
        else:
            put("straightness", dict.fromkeys([f"{w}_{k}" for w in "uv" for k in (2, 3, 4)], MICRON))
            put("angular_error_motion", dict.fromkeys([f"{w}_{k}" for w in "xyz" for k in (1, 2, 3)], SECOND))
            put("thermal_expansion", {"alpha": 1e-6})
            put("gravity_sag", {"tip": MICRON, "own": MICRON, "mid": MICRON})
            put("load_sag", {"k0": MICRON, "k3": MICRON})
            put("guide_windup", {"a": windup, "b": windup})
    frame = dict.fromkeys("xyz", MICRON if points else SECOND)
    found["warm_up_drift", None] = frame | {"tau": 700.0}
    found["linear_drift", None] = frame
    found["frame_shift", None] = frame | (dict.fromkeys(("rx", "ry", "rz"), SECOND) if points else {})
    found["instrument_scale", None] = {"k": 1e-6}
    if not points:
        found["refraction", None] = {"a": SECOND}
        del found["instrument_scale", None]
    for target in targets:
        size = dict.fromkeys("xyz", MICRON) if points else dict.fromkeys("ab", SECOND)
        found["target_offset", target] = size
    return found


def _text(
    joints: Sequence[Mapping[str, Any]],
    targets: Mapping[str, Sequence[float]],
    estimate: Sequence[str],
    measured: str,
    branches: Mapping[str, str] | None = None,
) -> str:
    lines = ['name = "A machine"', "[units]", 'length = "mm"', 'angle = "deg"']
    for name, its in (branches or {}).items():
        lines += ["[[branch]]", f'name = "{name}"', f"joints = {list(its)}".replace("'", '"')]
    for joint in joints:
        lines.append("[[joint]]")
        lines += [f"{key} = {value!r}".replace("'", '"') for key, value in joint.items()]
    for name, point in targets.items():
        lines += ["[[target]]", f'name = "{name}"', f"point = {list(point)}"]
    lines += ["[measured]", measured, "{noise}", "[estimate]"]
    lines.append(f"parameters = {list(estimate)}".replace("'", '"'))
    return "\n".join(lines) + "\n"


def _bench(
    name: str,
    joints: Sequence[Mapping[str, Any]],
    targets: Mapping[str, Sequence[float]],
    estimate: Sequence[str],
    measured: str,
    sigma: float,
    q: Array,
    random: np.random.Generator,
    *,
    wrong: float,
    branches: Mapping[str, str] | None = None,
) -> Bench:
    text = _text(joints, targets, estimate, measured, branches)
    kind = tomllib.loads(text.replace("{noise}", ""))["measured"]["kind"]
    base: list[str] = []
    for what in estimate:
        if what == "target":
            freedoms = {"direction": ("a", "b"), "pose": SIX}.get(kind, SIX[:3])
            base += [f"target.{t}.{x}" for t in targets for x in freedoms]
        else:
            base += [f"{what}.a", f"{what}.b"]
    values = {key: wrong * random.normal() * (SECOND * 20 if ".axis" in key else 1) for key in base}
    if kind == "direction":
        values = {key: arcsec(30) * random.normal() for key in base}
    if 'frame = "free"' in measured:
        frame = ["frame.rx", "frame.ry", "frame.rz"] + (
            ["frame.x", "frame.y", "frame.z"] if kind in {"point", "pose"} else []
        )
        values |= {k: random.uniform(-1, 1) * (20 if ".r" in k else 900) for k in frame}
        base += frame
    each = len(targets)
    rows = np.repeat(np.round(q, 3), each, axis=0)
    names = [str(joint["name"]) for joint in joints]
    columns = _conditions(names, np.round(q, 3), each, random)
    natural = _natural(kind, [(str(j["name"]), str(j["type"])) for j in joints], list(targets))
    pose = np.repeat(np.arange(len(q)), each)
    return Bench(name, text, tuple(base), values, sigma, rows, list(targets) * len(q), pose, columns, natural)


def _joint(
    name: str, type_: str, axis: Sequence[float], point: Sequence[float] = (0, 0, 0), **more: Any
) -> dict[str, Any]:
    return {"name": name, "type": type_, "axis": list(axis), "point": list(point), **more}


def rotary_table(random: np.random.Generator, size: float = 1.0) -> Bench:
    """Three balls, turned round forwards and backwards twice."""
    steps = np.arange(0, 360, 15 / size) + random.uniform(0, 15)
    q = np.concatenate([steps, steps[::-1], steps, steps[::-1]])[:, None]
    balls = {"b1": [150, 0, 30], "b2": [-60, 120, 110], "b3": [-80, -100, 60]}
    return _bench(
        "rotary_table", [_joint("C", "revolute", (0, 0, 1))], balls, ["C.axis", "C.point", "target"],
        'kind = "point"\nframe = "machine"', 0.0015, q, random, wrong=0.02,
    )  # fmt: skip


def trunnion(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A tilting table that carries a turning one; two balls, anywhere and back."""
    q = random.uniform([-95, 0], [35, 360], size=(round(70 * size), 2))
    balls = {"b1": [110, 0, 80], "b2": [-40, 70, 30]}
    joints = [_joint("A", "revolute", (1, 0, 0), travel=[-100, 40]), _joint("C", "revolute", (0, 0, 1))]
    return _bench(
        "trunnion", joints, balls, ["A.axis", "A.point", "C.axis", "C.point", "target"],
        'kind = "point"\nframe = "machine"', 0.002, q, random, wrong=0.02,
    )  # fmt: skip


def five_axis(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A machine tool [w C A b X Y Z t]: its head follows sensors on the table with a ball, anywhere and back."""
    turned = random.uniform([-95, 0], [35, 360], size=(round(100 * size), 2))
    nest, zero = np.array([110.0, 0.0, 80.0]), np.zeros((len(turned), 2))
    vectors = (
        np.concatenate([np.deg2rad(turned[:, :1]), zero], 1),
        np.concatenate([zero, np.deg2rad(turned[:, 1:])], 1),
    )
    table = rigid(vectors[0], [0, 0, -60]) @ rigid(vectors[1])
    q = np.concatenate([turned, carried(table, nest) - nest], axis=1)
    joints = [
        _joint("A", "revolute", (1, 0, 0), (0, 0, -60), travel=[-100, 40]), _joint("C", "revolute", (0, 0, 1)),
        *(_joint(x, "prismatic", n) for x, n in zip("XYZ", np.eye(3).tolist(), strict=True)),
    ]  # fmt: skip
    return _bench(
        "five_axis", joints, {"ball": nest.tolist()}, ["A.axis", "A.point", "C.axis", "C.point", "target"],
        'kind = "point"\nframe = "machine"', 0.002, q, random, wrong=0.02,
        branches={"workpiece": "AC", "tool": "XYZ"},
    )  # fmt: skip


def mount(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A telescope's mount and 100 stars."""
    stars = round(100 * size)
    q = np.stack([random.uniform(0, 360, stars), random.uniform(18, 85, stars)], -1)
    joints = [_joint("AZ", "revolute", (0, 0, -1)), _joint("EL", "revolute", (1, 0, 0))]
    return _bench(
        "mount", joints, {"tube": [0, 1, 0]}, ["AZ.axis", "EL.axis", "target"],
        'kind = "direction"\nframe = "machine"', arcsec(0.8), q, random, wrong=0.0,
    )  # fmt: skip


_XYZ = (
    _joint("X", "prismatic", (1, 0, 0), travel=[0, 800]),
    _joint("Y", "prismatic", (0, 1, 0), travel=[0, 600]),
    _joint("Z", "prismatic", (0, 0, 1), travel=[-400, 0]),
)


def gantry(random: np.random.Generator, size: float = 1.0) -> Bench:
    """Three linear axes and two balls under the spindle, all over the volume."""
    q = random.uniform([20, 20, -380], [780, 580, -20], size=(round(80 * size), 3))
    return _bench(
        "gantry", _XYZ, {"short": [0, 0, -60], "long": [70, 30, -220]}, ["target"],
        'kind = "point"\nframe = "machine"', 0.002, q, random, wrong=0.02,
    )  # fmt: skip


def ballbar(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A ball bar of 150 mm in three planes, there and back; only distances are read."""
    centre, passes = np.array([400.0, 300.0, -200.0]), []
    for first, second, degrees in ((0, 1, 360), (2, 0, 220), (1, 2, 220)):
        angle = np.radians(np.arange(0, degrees, 12 / size) + random.uniform(0, 12) - (20 if first else 0))
        path = np.tile(centre, (len(angle), 1))
        path[:, first] += 150 * np.cos(angle)
        path[:, second] += 150 * np.sin(angle)
        passes += [path, path[::-1]]
    return _bench(
        "ballbar", _XYZ, {"ball": [0, 0, 0]}, ["target"],
        'kind = "distance"\nframe = "machine"\nfrom = [400, 300, -200]', 0.0005, np.concatenate(passes), random,
        wrong=0.01,
    )  # fmt: skip


def gantry_rotary(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A portal with a C axis on its ram, and two balls on its arm."""
    q = random.uniform([20, 20, -380, 0], [780, 580, -20, 360], size=(round(80 * size), 4))
    joints = [*_XYZ, _joint("C", "revolute", (0, 0, 1))]
    return _bench(
        "gantry_rotary", joints, {"b1": [120, 0, -60], "b2": [-40, 85, -90]}, ["C.axis", "C.point", "target"],
        'kind = "point"\nframe = "machine"', 0.002, q, random, wrong=0.03,
    )  # fmt: skip


def robot(random: np.random.Generator, size: float = 1.0) -> Bench:
    """A robot with six joints, seen by a laser tracker that stands anywhere."""
    q = random.uniform(
        [-70, -40, -50, -120, -90, -150], [70, 45, 40, 120, 90, 150], size=(round(75 * size), 6)
    )
    places = [(0, 0, 0), (175, 0, 495), (175, 0, 1390), (175, 0, 1565), (1135, 0, 1565), (1270, 0, 1565)]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    joints = [
        _joint(f"J{i + 1}", "revolute", axis, point)
        for i, (axis, point) in enumerate(zip(axes, places, strict=True))
    ]
    estimate = [f"J{i}.{what}" for i in range(1, 7) for what in ("axis", "point")] + ["target"]
    targets = {"r1": [1320, 90, 1565], "r2": [1320, -60, 1645], "r3": [1410, -50, 1505]}
    return _bench(
        "robot", joints, targets, estimate, 'kind = "point"\nframe = "free"', 0.02, q, random, wrong=0.2
    )


def board(random: np.random.Generator, size: float = 1.0) -> Bench:
    """The same robot, a board on its flange whose middle is on the last axis, and a camera that reads its pose."""
    arm = robot(random, size)
    joints = arm.file["joint"]
    estimate = [f"J{i}.{what}" for i in range(2, 6) for what in ("axis", "point")] + ["target"]
    q = arm.q[:: len(arm.file["target"])]
    made = _bench(
        "board", joints, {"board": [1420, 0, 1565]}, estimate, 'kind = "pose"\nframe = "free"', 0.02, q, random,
        wrong=0.2,
    )  # fmt: skip
    return replace(made, arm=150.0)


def still(random: np.random.Generator, size: float = 1.0, *, estimated: bool = False) -> Bench:
    """A portal whose C axis was never turned; whether the base fit looks for that axis all the same."""
    q = random.uniform([20, 20, -380, 0], [780, 580, -20, 0], size=(round(60 * size), 4))
    joints = [*_XYZ, _joint("C", "revolute", (0, 0, 1))]
    estimate = ["C.axis", "C.point", "target"] if estimated else ["target"]
    return _bench(
        "still", joints, {"b1": [120, 0, -60], "b2": [-40, 85, -90]}, estimate,
        'kind = "point"\nframe = "machine"', 0.002, q, random, wrong=0.03,
    )  # fmt: skip


BENCHES: dict[str, Callable[..., Bench]] = {
    f.__name__: f for f in (rotary_table, trunnion, mount, gantry, ballbar, gantry_rotary, robot)
}


# What lies outside the catalogue ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outside:
    """A formula that no effect of the catalogue has: where, what drives it, and its form at a size of 1."""

    bench: str
    place: str | None
    component: str
    drivers: tuple[str, ...]
    form: Callable[[Mapping[str, Any]], Any]
    beside: tuple[Title, ...] = ()  # effects of the catalogue that may accompany the form


_SCALE: tuple[Title, ...] = (("scale", "X"),)
OUTSIDE: dict[str, Outside] = {
    "fifth_harmonic": Outside("rotary_table", "C", "tz", ("C",), lambda c: np.sin(5 * c["q"] + 0.4)),
    "third_wobble": Outside("trunnion", "C", "rx", ("C",), lambda c: np.cos(3 * c["q"])),
    "cubic_slide": Outside("gantry", "X", "reading", ("X",), lambda c: _cubic(c["q"] / 400 - 1), _SCALE),
    "two_scales_in_a_row": Outside(
        "gantry", "X", "reading", ("X",), lambda c: (c["q"] > 430) - c["q"] / 530, _SCALE
    ),
    "bump": Outside("gantry", "Y", "tz", ("Y",), lambda c: np.exp(-(((c["q"] - 350) / 40) ** 2))),
    "kink": Outside("gantry", "Y", "reading", ("Y",), lambda c: np.abs(c["q"] - 330) / 300),
    "play_round_the_turn": Outside(
        "trunnion", "C", "reading", ("C", "dir_C"), lambda c: c["s"] * np.sin(c["q"])
    ),
    "humidity": Outside("rotary_table", None, "tz", ("humidity",), lambda c: (c["humidity"] - 50) / 10),
    "humidity_scale": Outside(
        "gantry", "X", "reading", ("X", "humidity"), lambda c: c["q"] * (c["humidity"] - 50)
    ),
    "product_of_joints": Outside(
        "gantry_rotary", "C", "reading", ("C", "X"), lambda c: (c["X"] / 400 - 1) * np.cos(2 * c["q"])
    ),
    "driven_by_another": Outside("trunnion", "A", "reading", ("C",), lambda c: np.sin(3 * c["C"])),
    "load_squared": Outside("trunnion", "A", "reading", ("load",), lambda c: (c["F"] / 60) ** 2),
    "warms_in_time": Outside("trunnion", "C", "reading", ("t",), lambda c: np.exp(-c["t"] / 500)),
    "other_temperature": Outside("gantry", "Z", "reading", ("T_room",), lambda c: (c["T_room"] - 20) / 3),
    "speed_squared": Outside("rotary_table", "C", "reading", ("v_C",), lambda c: c["v"] ** 2),
    "wave_under_load": Outside(
        "rotary_table", "C", "tz", ("C", "load"), lambda c: c["F"] / 30 * np.sin(4 * c["q"] + 1)
    ),
    "slide_under_load": Outside(
        "gantry", "X", "reading", ("X", "load"), lambda c: c["F"] / 30 * _cubic(c["q"] / 400 - 1)
    ),
    "local_play": Outside(
        "gantry", "Y", "reading", ("Y", "dir_Y"), lambda c: c["s"] * np.exp(-(((c["q"] - 250) / 60) ** 2))
    ),
    "wave_that_grows": Outside(
        "trunnion", "C", "reading", ("C", "t"), lambda c: (1 - np.exp(-c["t"] / 900)) * np.sin(3 * c["q"])
    ),
    "azimuth_wave": Outside("mount", "AZ", "rx", ("AZ",), lambda c: np.sin(5 * c["q"])),
    "wrist_wave": Outside("robot", "J4", "tz", ("J4",), lambda c: np.sin(5 * c["q"])),
}
"""None of these is close to an effect of the catalogue: what would be, such as a cubic slide beside its scale, is an
effect with a rest."""


def _cubic(x: Array) -> Array:
    """Give the part of a cube that no scale can imitate."""
    return (5 * x**3 - 3 * x) / 2


# Physics behind the catalogue's formulas ----------------------------------------------------------------------------

PHYSICS: dict[str, tuple[str, dict[str, float]]] = {  # nearest effect of the catalogue; sizes in proportion
    "eccentric_scale": ("encoder_eccentricity", {"offset": 1e-3, "direction": 215.0, "radius": 40.0}),
    "play": ("backlash", {"b": 1e-3}),
    "thermal_lag": ("thermal_offset", {"k": 1e-3, "tau": 150.0}),
    "beam": ("gravity_sag", {"stiffness": 1e9, "tip_force": 0.5, "weight": 1e-3}),
    "bridge": ("gravity_sag", {"stiffness": 1e9, "weight": 1e-2}),
    "carriage": ("gravity_sag", {"stiffness": 1e9, "force": 1.0}),
}
FIXED = {"P", "tau", "direction", "radius", "stiffness"}
"""Parameters that are not sizes; tau of servo_lag is one."""
POSITIVE = {
    "play",
    "servo_lag",
    "backlash",
    "beam",
    "bridge",
    "carriage",
    "leg_backlash",
    "leg_compliance",
    "spring",
    "gravity_windup",
    "load_windup",
    "lateral_windup",
    "gravity_sag",
    "load_sag",
    "guide_windup",
}
"""What cannot be negative: play and lag, and whatever gives way to a force."""


def size_of(effect: str, parameter: str) -> bool:
    return parameter not in FIXED or effect == "servo_lag"


# Hiding -------------------------------------------------------------------------------------------------------------

MOST_HIDDEN = 0.03
"""An effect of which the base fit absorbs more than all but this part is not hidden: none could find it."""
MOST_TIMES = 1000.0
"""Nor does one that must be so many times its unit of size to show as much as the noise: no machine has it. Others need
up to 250."""


def visible(bench: Bench, values: Mapping[str, Any], base: Array) -> tuple[Array, float]:
    """Give what the base fit leaves of an effect, and which part of it that is."""
    change = bench.difference(bench.measure(values), bench.measure({}))
    left = off(base, change)
    whole = np.linalg.norm(change)
    return left, float(np.linalg.norm(left) / whole) if whole > 0 else 0.0


def _drawn(bench: Bench, title: Title, random: np.random.Generator) -> tuple[dict[str, float], Title, bool]:
    """Draw values of an effect in proportion; give them, what the catalogue calls it, and whether exactly so."""
    effect, place = title
    exact, name = True, effect
    physics = PHYSICS if bench.physics is None else bench.physics
    if effect in physics:
        name, sizes = physics[effect]
        exact = False
        sizes = dict(sizes)
        if "direction" in sizes:
            sizes["direction"] = random.uniform(0, 360)
    else:
        sizes = dict(bench.natural[title])
    values = {}
    if effect == "gravity_sag":
        kept = random.choice(list(sizes))
        sizes = {kept: sizes[kept]}  # each is a shape of its own
    for parameter, size in sizes.items():
        drawn = random.choice([-1, 1]) * random.uniform(0.4, 1.6) if size_of(effect, parameter) else 1.0
        if effect in POSITIVE:
            drawn = abs(drawn)
        if parameter == "P":
            drawn = random.uniform(0.8, 1.2)
        if parameter == "tau" and effect == "warm_up_drift":
            drawn = random.uniform(0.7, 1.4)
        values[parameter] = float(size * drawn)
    keys = {}
    for parameter, value in values.items():
        runs = ("2", "3") if effect == "frame_shift" else (None,)
        for run in runs:
            title_ = effect if run is None else f"{effect}[{run}]"
            keys[".".join(filter(None, [place, title_, parameter]))] = value * (
                1.0 if run in (None, "2") else float(random.uniform(-1, 1))
            )
    return keys, (name, place), exact


def _scaled(values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Multiply what is a size."""
    scaled = {}
    for key, value in values.items():
        *_, effect, parameter = key.split(".")
        scaled[key] = value * (factor if size_of(effect.partition("[")[0], parameter) else 1.0)
    return scaled


def hidden(
    bench: str | Bench,
    seed: int,
    effects: Sequence[Title] = (),
    *,
    outside: str | Outside | None = None,
    raises: float = 1.2,
    wanders: str = "",
    outliers: float = 0.0,
    spread: str = "even",
    state_noise: bool | None = None,
    covariates: bool = False,
    columns: str = "all",
    keep: Sequence[str] = (),
    size: float = 1.0,
) -> Hidden:
    """Hide effects in a machine.

    Parameters
    ----------
    bench : str or Bench
        Of :data:`BENCHES`.
    seed : int
    effects : sequence of (name, place)
        Of the catalogue (``bench.natural``) or of :data:`PHYSICS`.
    outside : str or Outside, optional
        Of :data:`OUTSIDE`, or another.
    raises : float
        Factor by which each effect raises the RMS of the base fit, by what neither base nor the other effects imitate.
    wanders : {"", "pose", "joint", "walk", "ou", "day"}
        What is not independent from row to row, by one sigma: whole poses, joints, or the set-up in time.
    outliers : float
        Part of the rows that are 8 to 40 sigma off.
    spread : {"even", "stated", "hidden"}
        Noise of one size, or of sizes 0.4 to 4, in columns u_… or unknown.
    state_noise : bool, optional
        Whether the machine file tells the noise; left out: by the seed.
    covariates : bool
        Add columns that matter for nothing.
    columns : {"all", "some", "few"}
        Of time, temperatures, load, speeds and runs: all, those that the effects need and some, or only those needed.
    keep : sequence of str
        Columns that are kept in any case.
    size : float
        Times as many poses as usual.

    Raises
    ------
    UnhiddenError
        When the base fit absorbs an effect, two are one, or one would have to be larger than machines have it.
    """
    random = np.random.default_rng([seed, 4])
    b = BENCHES[bench](random, size) if isinstance(bench, str) else bench
    form = OUTSIDE[outside] if isinstance(outside, str) else outside
    rows, clean = len(b.q), b.measure({})
    noise, sizes = _noise(b, spread, random)
    wander = _wander(b, wanders, random)
    base = b.derivatives(b.base)
    plain = b.simulator(b.file)
    noisy = plain.with_noise(b.measure(wander), b.noise(sizes * noise), _Ones())
    without = off(base, b.difference(noisy, clean))
    floor = b.rms(without)

    values: dict[str, float] = {}
    formulas: dict[str, Callable[..., Any]] = {}
    more = _covariates(b, covariates, form, random)
    measured = dict(b.columns) | ({"covariates": more} if more else {})
    b = replace(b, columns=measured)
    drawn = [_drawn(b, title, random) for title in effects]
    goal = floor * np.sqrt(raises**2 - 1)
    for i, (keys, _, _) in enumerate(drawn):
        others = {k: x for j, (them, _, _) in enumerate(drawn) for k, x in them.items() if j != i}
        imitable = np.concatenate([base, b.derivatives(list(others), others)], 1) if others else base
        left, seen = visible(b, keys, imitable)
        if seen < MOST_HIDDEN:
            raise UnhiddenError(f"{list(effects)[i]}: {seen:.1%} of it is visible")
        times = floor / b.rms(left)
        if times > MOST_TIMES:
            raise UnhiddenError(f"{list(effects)[i]}: it shows when it is {times:.0f} times its unit of size")
        values |= _scaled(keys, goal / b.rms(left))
    place, drivers = None, frozenset[str]()
    if form is not None:
        place, drivers = form.place, frozenset(form.drivers)
        where = ".".join(filter(None, [form.place, form.component]))
        turning = [joint["name"] for joint in b.file.get("joint", []) if joint["type"] == "revolute"]
        slides = form.component == "reading" and form.place not in turning
        small = 1e-2 if form.component.startswith("t") or slides else arcsec(20)
        left, seen = visible(b, {where: lambda c: small * form.form(c)}, base)
        if seen < MOST_HIDDEN:
            raise UnhiddenError(f"{outside}: {seen:.1%} of it is visible")
        size = small * goal / b.rms(left)
        formulas[where] = lambda c: size * form.form(c)

    everything = {**values, **wander}
    for where, formula in formulas.items():
        at = everything.get(where)
        everything[where] = formula if at is None else (lambda c, a=at, f=formula: a(c) + f(c))
    true = b.measure({**values, **formulas})
    reading = plain.with_noise(b.measure(everything), b.noise(sizes * noise), _Ones())
    bad = random.permutation(rows)[: round(outliers * rows)]
    for row in bad:
        far = b.sigma * random.uniform(8, 40)
        reading = plain.with_outliers(reading, [int(row)], far, random)
    together = off(base, b.difference(true, clean))
    kept = _kept(measured, effects, form, columns, keep, random)
    states = bool(random.integers(2)) if state_noise is None else state_noise
    stated = f"noise = {b.sigma!r}"
    if b.kind == "pose":
        stated += f"\nattitude_noise = {b.sigma / b.arm / RADIANS[b.file['units']['angle']]!r}"
    text = b.text.replace("{noise}", stated if states and spread == "even" else "")
    nothing = not effects and outside is None
    truth = Truth(
        kind="none" if nothing else "outside" if outside else "catalogue",
        effects=form.beside if form else tuple(title for _, title, _ in drawn),
        values=values,
        exact=all(exact for _, _, exact in drawn),
        drivers=drivers,
        place=place,
        raises=float(np.hypot(1, b.rms(together) / floor)),
        outliers=frozenset(int(row) for row in bad),
        sigma=b.sigma,
        wanders=wanders,
    )
    name = f"{b.name}-{seed}"
    arguments = {"q": b.q, "reading": reading, "target": b.target, **kept}
    if spread == "stated":
        arguments["uncertainty"] = sizes * b.sigma
    return Hidden(name, b, arguments, text, Sealed(truth))


class UnhiddenError(ValueError):
    """What cannot hide: the base fit absorbs it, or no machine has as much of it as would show."""


class _Ones:
    """In place of random numbers: the noise is drawn already."""

    def normal(self, size: Any) -> Array:
        return np.ones(size)


def _noise(b: Bench, spread: str, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw noise of size 1 as with_noise takes it, and the sizes by row."""
    components = {"distance": 1, "pose": 6}.get(b.kind, 3)
    sizes = np.ones((len(b.q), 1))
    if spread != "even":
        # as a tracker's: larger where the target is far, here: from pose to pose, and in one corner of the machine
        by_pose = np.exp(random.uniform(np.log(0.4), np.log(4), b.pose[-1] + 1))
        sizes = by_pose[b.pose][:, None]
    noise = random.normal(size=(len(b.q), components))
    return noise, np.broadcast_to(sizes, noise.shape)


def _wander(b: Bench, kind: str, random: np.random.Generator) -> dict[str, Callable[..., Any]]:
    """Give formulas of what moves by one sigma and is no effect."""
    if not kind:
        return {}
    t, poses = np.asarray(b.columns["t"]), int(b.pose[-1]) + 1
    at = t[np.searchsorted(b.pose, np.arange(poses))]
    span = at[-1] - at[0]
    if kind == "joint":
        found = {}
        for i, joint in enumerate(b.file["joint"]):
            path = random.normal(size=poses)[b.pose]
            key = f"{joint['name']}.reading"
            small = arcsec(1) if joint["type"] == "revolute" else 1e-3
            change = b.difference(b.measure({key: lambda c, p=path, s=small: s * p}), b.measure({}))
            amount = small * b.sigma / max(b.rms(change), 1e-12) / np.sqrt(len(b.file["joint"]))
            found[key] = lambda c, p=path, a=amount: a * p
            del i
        return found
    path = np.empty((poses, 3))
    for i in range(3):
        if kind == "pose":
            path[:, i] = random.normal(size=poses)
        elif kind == "walk":
            steps = np.sqrt(np.diff(at, prepend=at[0]))
            path[:, i] = np.cumsum(random.normal(size=poses) * steps)
        elif kind == "ou":
            path[0, i] = random.normal()
            for k in range(1, poses):
                keep = np.exp(-(at[k] - at[k - 1]) / (span / 8))
                path[k, i] = keep * path[k - 1, i] + np.sqrt(1 - keep**2) * random.normal()
        elif kind == "day":
            path[:, i] = np.sin(2 * np.pi * (at / span + random.uniform())) * random.uniform(0.5, 1.5)
        else:
            raise ValueError(f"wanders {kind!r}")
    if kind != "pose":
        path -= path.mean(axis=0)
    path *= b.sigma / np.sqrt(np.mean(path**2, axis=0))
    letter = "r" if b.kind == "direction" else "t"
    return {f"{letter}{x}": lambda c, i=i: path[b.pose, i] for i, x in enumerate("xyz")}


def _covariates(b: Bench, idle: bool, outside: Outside | None, random: np.random.Generator) -> dict[str, Any]:
    """Give further columns by row: those that matter for nothing, and those that an effect needs."""
    poses = int(b.pose[-1]) + 1
    x = np.arange(poses) / poses

    def wave(waves: float, size: float, noise: float) -> Array:
        return size * np.sin(2 * np.pi * (waves * x + random.uniform())) + noise * random.normal(size=poses)

    all_of_them = {
        "humidity": np.round(50 + wave(2.3, 8, 1), 1),
        "T_room": np.round(20 + wave(1.7, 2, 0.3), 2),
        "operator_number": random.integers(1, 4, poses).astype(float),
        "pressure": np.round(1013 + np.cumsum(random.normal(size=poses)) * 0.3, 1),
        "battery": np.round(100 - 40 * x, 0),
    }  # fmt: skip
    needed = set(outside.drivers) if outside else set()
    return {name: values[b.pose] for name, values in all_of_them.items() if idle or name in needed}


NEEDS: dict[str, tuple[str, ...]] = {
    "servo_lag": ("v",),
    "load_windup": ("load",),
    "load_sag": ("load",),
    "thermal_offset": ("temperature",),
    "thermal_axis_drift": ("temperature",),
    "thermal_expansion": ("temperature",),
    "thermal_lag": ("temperature", "t"),
    "leg_thermal_expansion": ("temperature",),
    "leg_compliance": ("load",),
    "spring": ("load",),
    "warm_up_drift": ("t",),
    "linear_drift": ("t",),
    "frame_shift": ("run",),
}


def _kept(
    measured: Mapping[str, Any],
    effects: Sequence[Title],
    outside: Outside | None,
    columns: str,
    keep: Sequence[str],
    random: np.random.Generator,
) -> dict[str, Any]:
    """Choose which columns the user wrote down."""
    needed = {name for effect, _ in effects for name in NEEDS.get(effect, ())} | set(keep) | {"covariates"}
    if outside:
        drivers = outside.drivers
        needed |= {d for d in ("t", "load") if d in drivers} | {"v" for d in drivers if d.startswith("v_")}
    chance = {"all": 1.0, "some": 0.6, "few": 0.0}[columns]
    kept: dict[str, Any] = {}
    for name, values in measured.items():
        lucky = random.uniform() < chance
        if name in needed or (lucky and name != "run") or (name == "run" and lucky and columns == "some"):
            kept[name] = values
    if "covariates" in kept:
        units = {"T_room": "T_room [degC]"}
        kept["covariates"] = {units.get(name, name): values for name, values in kept["covariates"].items()}
    return kept


def plantable(bench: Bench, random: np.random.Generator, *, least: float = 0.1) -> list[Title]:
    """List the effects of which the base fit leaves something to see.

    What acts only because the machine is not quite as drawn, such as a moment about an upright axis, is left out: it
    would have to be absurdly large.
    """
    base = bench.derivatives(bench.base)
    drawn_right = replace(bench, wrong={k: 0.0 if ".axis." in k else x for k, x in bench.wrong.items()})
    found = []
    for title in bench.natural:
        values, _, _ = _drawn(bench, title, random)
        sizes = [b.rms(b.difference(b.measure(values), b.measure({}))) for b in (bench, drawn_right)]
        if sizes[1] > 0.5 * sizes[0] and visible(bench, values, base)[1] >= least:
            found.append(title)
    return found
