"""Write the data.csv of the simulated machines: each machine.toml with errors of geometry and one hidden effect.

rodgen is not used: the readings come from the independent simulator of its tests. `drawn_wrong` lists the errors that
the base fit of the machine file finds, `hidden` those that it cannot, which ANSWERS.md describes. Seeds are fixed.
Needs NumPy.

    python examples/machines/make_data.py [FOLDER]
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from machine_simulator import Simulated, approach, arcsec
from parallel_simulator import Parallel

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Example:
    """One machine: its errors, its commands and its noise."""

    drawn_wrong: dict[str, float]
    hidden: dict[str, float]
    q: Array  # (poses, joints)
    noise: Any
    decimals: dict[str, int]
    seed: int
    conditions: dict[str, Any] = field(default_factory=dict)  # by pose
    targets: tuple[str, ...] = ()  # all seen in every pose; none: the only one
    state_noise: bool = False  # as columns u_x, u_y, u_z

    def rows(self) -> tuple[Array, dict[str, Any]]:
        """Return the commands of each target of each pose, (rows, joints), and the further arguments of `measure`."""
        each = max(len(self.targets), 1)
        conditions = {
            name: {of: np.repeat(x, each) for of, x in values.items()}
            if isinstance(values, dict)
            else np.repeat(values, each, axis=0)
            for name, values in self.conditions.items()
        }
        if self.targets:
            conditions["target"] = list(self.targets) * len(self.q)
        return np.repeat(self.q, each, axis=0), conditions


def gantry_rotary() -> Example:
    """Places all over the portal, C turned all round; the first 15 poses come again at the end."""
    random = np.random.default_rng(11)
    places = random.uniform([50, 50, -450, 0], [1150, 750, -50, 360], size=(85, 4))
    places[:, 3] = random.permutation(np.arange(85)) * 360 / 85
    q = np.round(np.concatenate([places, places[:15]]), 3)
    q[-15:] = q[:15]
    return Example(
        drawn_wrong={
            "C.axis.a": 0.021,
            "C.axis.b": -0.013,
            "C.point.a": 0.034,
            "C.point.b": -0.052,
            **off("ball_1", 0.06, -0.08, 0.05),
            **off("ball_2", -0.07, 0.03, -0.04),
        },
        hidden={
            "C.eccentric_scale.offset": 0.004,
            "C.eccentric_scale.direction": 215.0,
            "C.eccentric_scale.radius": 40.0,
        },
        q=q,
        targets=("ball_1", "ball_2"),
        noise=0.002,
        decimals={"q": 3, "reading": 4},
        seed=12,
    )


def rotary_table() -> Example:
    """Steps of 15 degrees: forwards, backwards, forwards."""
    forwards = np.arange(0, 360, 15.0)
    return Example(
        drawn_wrong={
            "C.axis.a": -0.004,
            "C.axis.b": 0.007,
            "C.point.a": 0.011,
            "C.point.b": 0.018,
            **off("ball_1", 0.02, -0.05, 0.03),
            **off("ball_2", -0.04, 0.02, 0.05),
            **off("ball_3", 0.01, 0.03, -0.02),
            **off("ball_4", -0.03, -0.04, 0.01),
            **off("ball_5", 0.05, 0.01, -0.04),
            **off("ball_6", 0.02, 0.02, 0.02),
        },
        hidden={
            "C.tilt_error_motion.u_c2": arcsec(5.2),
            "C.tilt_error_motion.u_s2": arcsec(-2.1),
            "C.tilt_error_motion.v_c2": arcsec(1.4),
            "C.tilt_error_motion.v_s2": arcsec(4.3),
        },
        q=np.concatenate([forwards, forwards[::-1], forwards])[:, None],
        conditions={"run": np.repeat([1, 2, 3], len(forwards))},
        targets=tuple(f"ball_{i}" for i in range(1, 7)),
        noise=0.0015,
        decimals={"q": 1, "reading": 4},
        seed=21,
    )


def trunnion() -> Example:
    """Round and round with C at several tilts, and back and forth with A; the linear axes follow the ball."""
    tilts = [0, -30, -60, -90, 30, 0, -45, -90]
    rounds = [(a, c) for a in tilts for c in np.arange(0, 360, 18.0)]
    swings = [(a, c) for c in (0, 90, 180, 270) for a in np.arange(-90, 31, 12.0)]
    ac = np.array([*rounds, *swings, *rounds[:20]], dtype=float)
    drawn = Simulated(HERE / "trunnion" / "machine.toml")
    ball = drawn.measure(np.concatenate([np.zeros((len(ac), 3)), ac], axis=1))  # the control's idea of it
    return Example(
        drawn_wrong={
            "A.axis.a": 0.006,
            "A.axis.b": -0.009,
            "A.point.a": 0.016,
            "A.point.b": -0.023,
            "C.axis.a": 0.004,
            "C.axis.b": 0.008,
            "C.point.a": -0.012,
            "C.point.b": 0.019,
            **off("ball", 0.02, -0.03, 0.04),
        },
        hidden={
            "warm_up_drift.x": 0.004,
            "warm_up_drift.y": -0.009,
            "warm_up_drift.z": 0.027,
            "warm_up_drift.tau": 2100.0,
        },
        q=np.round(np.concatenate([ball[:, ::-1], ac], axis=1), 3),
        conditions={"t": 22.0 * np.arange(len(ac))},
        noise=0.001,
        decimals={"q": 3, "reading": 4, "t": 0},
        seed=31,
    )


def positioner() -> Example:
    """A tour of 140 places, twice, so that every place is reached the same way again."""
    random = np.random.default_rng(41)
    tour = np.round(random.uniform([-180, 5], [180, 180], size=(140, 2)), 3)
    return Example(
        drawn_wrong={
            "frame.x": 212.41,
            "frame.y": -98.73,
            "frame.z": 1502.6,
            "frame.rx": 0.31,
            "frame.ry": -0.22,
            "frame.rz": 37.4,
            "phi.axis.a": 0.11,
            "phi.axis.b": -0.06,
            "phi.point.a": 0.013,
            "phi.point.b": -0.009,
            **off("fibre", 0.021, -0.008, 0.004),
        },
        hidden={"phi.play.b": 0.28},
        q=np.concatenate([tour, tour]),
        noise=np.array([0.0012, 0.0012, 0.009]),
        decimals={"q": 3, "reading": 5},
        state_noise=True,
        seed=42,
    )


def robot_6r_tracker() -> Example:
    """A hundred poses in front of the robot, ten of them twice."""
    random = np.random.default_rng(51)
    q = random.uniform([-70, -40, -50, -120, -90, -150], [70, 45, 40, 120, 90, 150], size=(100, 6))
    q = np.round(np.concatenate([q, q[::10]]), 4)
    joints = [f"J{i}" for i in range(1, 7)]
    return Example(
        drawn_wrong={
            "frame.x": 2950.0,
            "frame.y": -1830.0,
            "frame.z": 410.0,
            "frame.rx": 0.4,
            "frame.ry": -0.7,
            "frame.rz": 141.0,
            **{
                f"{j}.axis.{x}": value
                for j in joints
                for x, value in zip("ab", random.normal(size=2) * 0.03, strict=True)
            },
            **{
                f"{j}.point.{x}": value
                for j in joints
                for x, value in zip("ab", random.normal(size=2) * 0.4, strict=True)
            },
            **{f"{j}.zero_offset.a": random.normal() * 0.05 for j in joints},
            **off("reflector_1", 0.4, -0.6, 0.5),
            **off("reflector_2", -0.3, 0.2, 0.7),
            **off("reflector_3", 0.5, 0.4, -0.2),
        },
        hidden={"J2.gravity_windup.k": arcsec(0.035)},
        q=q,
        targets=("reflector_1", "reflector_2", "reflector_3"),
        noise=0.02,
        decimals={"q": 4, "reading": 3},
        seed=52,
    )


def ballbar_gantry() -> Example:
    """A circle in XY and arcs of 220 degrees in ZX and YZ, each there and back."""
    centre, radius = np.array([400.0, 300.0, -200.0]), 150.0
    passes = []
    for first, second, degrees in (
        (0, 1, np.arange(0, 361, 5)),
        (2, 0, np.arange(-20, 201, 5)),
        (1, 2, np.arange(-20, 201, 5)),
    ):
        angle = np.radians(degrees)
        path = np.tile(centre, (len(angle), 1))
        path[:, first] += radius * np.cos(angle)
        path[:, second] += radius * np.sin(angle)
        passes += [path, path[::-1]]
    return Example(
        drawn_wrong=off("spindle_ball", 0.006, -0.011, 0.004),
        hidden={"Y.squareness.a": arcsec(14.0)},
        q=np.round(np.concatenate(passes), 4),
        conditions={"run": np.repeat(np.arange(1, 7), [len(path) for path in passes])},
        noise=0.0005,
        decimals={"q": 4, "reading": 5},
        seed=61,
    )


def tricept() -> Example:
    """Poses all over the legs' travel, one after the other while the machine runs in; the first 10 come again."""
    random = np.random.default_rng(71)
    drawn = simulated("tricept", {})
    tilt, around, z = random.uniform([0, 0, 590], [0.35, 2 * np.pi, 790], size=(400, 3)).T
    legs = drawn.legs(np.stack([tilt * np.cos(around), tilt * np.sin(around), z], axis=-1))
    legs = legs[(legs.min(axis=1) > 568) & (legs.max(axis=1) < 858)][:60]
    q = np.round(np.concatenate([legs, legs[:10]]), 3)
    t = 60.0 * np.arange(len(q))
    runs_in = 1 - np.exp(-t / 1500)
    shop = np.sin(2 * np.pi * t / 5200)  # the hall's heating
    return Example(
        drawn_wrong={
            "frame.x": 1840.0,
            "frame.y": -960.0,
            "frame.z": 1210.0,
            "frame.rx": 178.6,
            "frame.ry": 1.3,
            "frame.rz": -31.0,
            "geometry.R": 0.062,
            "geometry.r": -0.047,
            **off("nose", 0.05, -0.03, 0.08),
            **off("left", -0.06, 0.04, 0.02),
            **off("right", 0.03, 0.07, -0.05),
        },
        hidden={"A1.leg_thermal_expansion.alpha": 1.15e-5},
        q=q,
        targets=("nose", "left", "right"),
        conditions={
            "t": t,
            "temperature": {
                "A0": np.round(20.4 + 3.1 * runs_in + 0.8 * shop, 2),
                "A1": np.round(20.1 + 4.6 * runs_in - 0.9 * shop + 0.2 * random.normal(size=len(q)), 2),
                "A-1": np.round(20.6 + 2.4 * runs_in + 0.5 * shop, 2),
            },
        },
        noise=0.006,
        decimals={"q": 3, "reading": 4, "t": 0, "T": 2},
        seed=72,
    )


def three_sps_s() -> Example:
    """Tilts to all sides, with the platform turned by 25 to 60 degrees about its ball, which no leg could tell from
    less than none near the home pose."""
    random = np.random.default_rng(81)
    tilt, around, turn = random.uniform([0, 0, 25], [22, 360, 60], size=(70, 3)).T
    vectors = np.radians(
        np.stack([tilt * np.cos(np.radians(around)), tilt * np.sin(np.radians(around)), turn], -1)
    )
    return Example(
        drawn_wrong={
            "geometry.R": 0.03,
            "geometry.r": -0.04,
            "geometry.h": 0.05,
            **off("ball_1", 0.02, -0.04, 0.03),
            **off("ball_2", -0.03, 0.02, 0.04),
            **off("ball_3", 0.04, 0.03, -0.02),
        },
        hidden={
            "L2.platform_joint_offset.x": 0.06,
            "L2.platform_joint_offset.y": -0.09,
            "L2.platform_joint_offset.z": 0.05,
        },
        q=np.round(simulated("three_sps_s", {}).legs(vectors), 3),
        targets=("ball_1", "ball_2", "ball_3"),
        conditions={"start": vectors},
        noise=0.003,
        decimals={"q": 3, "reading": 4},
        seed=82,
    )


def palletiser() -> Example:
    """Places all over the reach, each motor from both sides."""
    random = np.random.default_rng(91)
    q = np.round(random.uniform([-120, -35, -45, -170], [120, 65, 40, 170], size=(70, 4)), 3)
    return Example(
        drawn_wrong={
            "frame.x": 3120.0,
            "frame.y": -1480.0,
            "frame.z": 390.0,
            "frame.rx": -0.6,
            "frame.ry": 0.9,
            "frame.rz": 152.0,
            **{
                f"{joint}.{what}.{x}": value
                for joint in ("J2", "J3", "J4", "J5")
                for what, size in (("axis", 0.02), ("point", 0.3))
                for x, value in zip("ab", size * random.normal(size=2), strict=True)
                if (joint, what) not in {("J2", "point"), ("J5", "point")}
            },
            **off("reflector_1", 0.3, -0.5, 0.4),
            **off("reflector_2", -0.4, 0.2, 0.6),
            **off("reflector_3", 0.5, 0.3, -0.2),
        },
        hidden={"J2.backlash.b": 0.024},
        q=q,
        targets=("reflector_1", "reflector_2", "reflector_3"),
        noise=0.03,
        decimals={"q": 3, "reading": 3},
        seed=92,
    )


def off(target: str, x: float, y: float, z: float) -> dict[str, float]:
    """Give by how much a target is not where it is drawn."""
    return {f"target.{target}.{name}": value for name, value in zip("xyz", (x, y, z), strict=True)}


class Palletiser(Simulated):
    """The arm on its rods: four motors turn five joints, and play behind a motor moves all that the motor moves."""

    def __init__(self, file: dict[str, Any], effects: dict[str, float]) -> None:
        self.play = effects.get("J2.backlash.b", 0.0)
        super().__init__(file, {key: x for key, x in effects.items() if key != "J2.backlash.b"})

    def measure(self, q: Array, **conditions: Any) -> Array:
        """Give what the tracker reads; q are the motors' angles, (rows, 4)."""
        first, second, third, flange = q.T
        second = second - self.play / 2 * approach(q)[:, 1]
        return super().measure(
            np.stack([first, second, third - second, -third, flange], axis=-1), **conditions
        )

    def write_csv(self, *given: Any, **more: Any) -> None:
        """Write the angles of the motors."""
        motors = [joint for joint in self.joints if "coordinate" not in joint or "reading" in joint]
        columns = [{**joint, "name": joint.get("reading", joint["name"])} for joint in motors]
        Simulated({**self.file, "joint": columns}).write_csv(*given, **more)


MACHINES: tuple[Callable[[], Example], ...] = (
    gantry_rotary,
    rotary_table,
    trunnion,
    positioner,
    robot_6r_tracker,
    ballbar_gantry,
    tricept,
    three_sps_s,
    palletiser,
)


def simulated(name: str, effects: dict[str, float]) -> Any:
    """Give the simulator of a machine with errors."""
    file = tomllib.loads((HERE / name / "machine.toml").read_text(encoding="utf-8"))
    made = Palletiser if name == "palletiser" else Parallel if "family" in file else Simulated
    return made(file, effects)


def write(folder: Path) -> None:
    """Write NAME/data.csv of every machine."""
    for make in MACHINES:
        example = make()
        machine = simulated(make.__name__, example.drawn_wrong | example.hidden)
        q, conditions = example.rows()
        reading = machine.with_noise(
            machine.measure(q, **conditions), example.noise, np.random.default_rng(example.seed)
        )
        path = folder / make.__name__ / "data.csv"
        path.parent.mkdir(exist_ok=True)
        machine.write_csv(
            path,
            q,
            reading,
            uncertainty=example.noise if example.state_noise else None,
            decimals=example.decimals,
            **conditions,
        )


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
