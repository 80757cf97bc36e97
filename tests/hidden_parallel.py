"""Machines of parallel legs with one thing more than their file says: benches for :func:`hidden_effects.hidden`.

The plans are those of honest measurements: poses all over the workspace, three reflectors on the platform, each leg's
temperature, load and time noted; the lengths commanded are those that the drawn machine has in these poses.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hidden_effects import MICRON, SECOND, Array, Bench, Outside, Title, _conditions
from parallel_simulator import LEGS, NUMBERS, Parallel

PHYSICS: dict[str, tuple[str, Mapping[str, float]]] = {
    "play": ("leg_backlash", {"b": MICRON}),
    "thermal_lag": ("leg_thermal_expansion", {"alpha": 1e-6, "tau": 150.0}),
    "spring": ("leg_compliance", {"c": 1e-5}),
}
"""What the catalogue approximates: its nearest effect, and sizes in proportion."""

OUTSIDE: dict[str, Outside] = {
    "leg_wave": Outside("", "", "reading", ("",), lambda c: np.sin(2 * np.pi * c["q"] / 61)),
    "leg_bend": Outside("", "", "reading", ("",), lambda c: np.abs(c["q"] - np.median(c["q"])) / 100),
    "humidity": Outside("", None, "tz", ("humidity",), lambda c: (c["humidity"] - 50) / 10),
}
"""Formulas that no effect of the catalogue has; `at` puts them at a leg."""


POINT = {"measured": {"kind": "point"}}


def at(what: str, leg: str) -> Outside:
    form = OUTSIDE[what]
    if form.place is None:
        return form
    return Outside(form.bench, leg, form.component, (leg,), form.form, (("leg_scale", leg),))


@dataclass(frozen=True)
class LeggedBench(Bench):
    """A bench of which the platform is brought to each pose, so that it is in the assembly mode that was meant."""

    brought: Array | None = None  # rotation vectors by row

    def measure(self, effects: Mapping[str, Any], columns: Mapping[str, Any] | None = None) -> Array:
        columns = self.columns if columns is None else columns
        machine = Parallel(self.file, {**self.wrong, **effects})
        return machine.measure(self.q, target=self.target, start=self.brought, **columns)


def natural(family: str, targets: Sequence[str]) -> dict[Title, dict[str, float]]:
    """List effects that can hide in a machine, with the sizes of their parameters in proportion."""
    found: dict[Title, dict[str, float]] = {}
    for leg in LEGS[family]:
        found["leg_zero_offset", leg] = {"a": MICRON}
        found["leg_scale", leg] = {"k": 1e-6}
        found["leg_thermal_expansion", leg] = {"alpha": 1e-6}
        found["leg_backlash", leg] = {"b": MICRON}
        found["leg_compliance", leg] = {"c": 1e-5}
        found["base_joint_offset", leg] = dict.fromkeys("xyz", MICRON)
        found["platform_joint_offset", leg] = dict.fromkeys("xyz", MICRON)
    found["warm_up_drift", None] = dict.fromkeys("xyz", MICRON) | {"tau": 700.0}
    found["linear_drift", None] = dict.fromkeys("xyz", MICRON)
    found["frame_shift", None] = dict.fromkeys("xyz", MICRON) | dict.fromkeys(("rx", "ry", "rz"), SECOND)
    found["instrument_scale", None] = {"k": 1e-6}
    for target in targets:
        found["target_offset", target] = dict.fromkeys("xyz", MICRON)
    return found


def _text(family: str, geometry: str, targets: Mapping[str, Sequence[float]], frame: str, rest: str) -> str:
    lines = ['name = "A machine"', f'family = "{family}"', "[units]", 'length = "mm"', 'angle = "deg"']
    lines += ["[geometry]", geometry, "[environment]", "gravity = [0, 0, 1]"]
    for name, point in targets.items():
        lines += ["[[target]]", f'name = "{name}"', f"point = {list(point)}"]
    lines += ["[measured]", 'kind = "point"', f'frame = "{frame}"', "{noise}", rest]
    return "\n".join(lines) + "\n"


def _bench(
    name: str,
    family: str,
    geometry: str,
    targets: Mapping[str, Sequence[float]],
    estimated: Sequence[str],
    frame: str,
    sigma: float,
    poses: Array,
    random: np.random.Generator,
) -> LeggedBench:
    entries = [*estimated, "target"]
    text = _text(family, geometry, targets, frame, f"[estimate]\nparameters = {entries}".replace("'", '"'))
    drawn = Parallel(tomllib.loads(text.replace("{noise}", "")))
    q = np.round(drawn.legs(poses), 3)
    base = [f"geometry.{n}" for n in NUMBERS[family] if n in estimated]
    base += [f"target.{t}.{x}" for t in targets for x in "xyz"]
    wrong = {key: 0.02 * random.normal() for key in base}
    if frame == "free":
        keys = [f"frame.{x}" for x in ("x", "y", "z", "rx", "ry", "rz")]
        wrong |= {k: random.uniform(-1, 1) * (20 if ".r" in k else 900) for k in keys}
        base += keys
    each = len(targets)
    columns = _conditions(drawn.joint_names, q, each, random)
    return LeggedBench(
        name=name,
        text=text,
        base=tuple(base),
        wrong=wrong,
        sigma=sigma,
        q=np.repeat(q, each, axis=0),
        target=list(targets) * len(q),
        pose=np.repeat(np.arange(len(q)), each),
        columns=columns,
        natural=natural(family, list(targets)),
        simulator=Parallel,
        physics=PHYSICS,
        brought=np.repeat(poses, each, axis=0) if family == "3-sps-s" else None,
    )


def tricept(random: np.random.Generator, size: float = 1.0, frame: str = "machine") -> LeggedBench:
    """A Tricept that hangs from its base, with three reflectors on its spindle."""
    n = round(60 * size)
    tilt, around = np.radians(30) * np.sqrt(random.uniform(size=9 * n)), random.uniform(0, 2 * np.pi, 9 * n)
    poses = np.stack([tilt * np.cos(around), tilt * np.sin(around), random.uniform(560, 810, 9 * n)], -1)
    reflectors = {"m1": [90, 0, 60], "m2": [-50, 80, 60], "m3": [-40, -70, 180]}
    geometry = "R = 330\nr = 140\nq = [0, 0, 120]"
    drawn = Parallel(
        {"family": "tricept", "units": {"angle": "deg"}, "geometry": {"R": 330, "r": 140}} | POINT
    )
    legs = drawn.legs(poses)
    poses = poses[(legs.min(axis=1) > 568) & (legs.max(axis=1) < 858)][:n]
    return _bench("tricept", "tricept", geometry, reflectors, ["R", "r"], frame, 0.002, poses, random)


def three_sps_s(random: np.random.Generator, size: float = 1.0, frame: str = "machine") -> LeggedBench:
    """A platform on a ball and three legs, turned far enough from its home pose, which is singular."""
    n = round(60 * size)
    tilt, around = np.radians(24) * np.sqrt(random.uniform(size=n)), random.uniform(0, 2 * np.pi, n)
    torsion = np.radians(random.uniform(25, 60, n))
    poses = np.stack([tilt * np.cos(around), tilt * np.sin(around), torsion], -1)
    balls = {"m1": [130, 0, 40], "m2": [-60, 110, 30], "m3": [-50, -90, 110]}
    geometry = "R = 200\nr = 120\nh = 260\nstart = [0, 0, 42]"
    return _bench("three_sps_s", "3-sps-s", geometry, balls, ["R", "r", "h"], frame, 0.002, poses, random)


BENCHES: dict[str, Callable[..., LeggedBench]] = {f.__name__: f for f in (tricept, three_sps_s)}
FAMILY = {"tricept": "tricept", "three_sps_s": "3-sps-s"}
