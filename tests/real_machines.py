"""Machines as they are met: several effects at once, of sizes that nature gives them, measured as people measure.

    case = real("6R", 17)
    machine, data = case.write(folder)
    truth = case.sealed.open(diagnosis)

Unlike :func:`hidden_effects.hidden`, nothing is scaled until it shows. Which effects a machine has, and how large, is
drawn from `NATURE`: each has a chance, and a size that is log-normal around a usual one. So some effects are far below
the noise, and many machines have none that can be seen. The plan may have few distinct poses with replicates; the
set-up may wander; readings of a pose may share errors; some rows may be gross errors, or of another star, or of two
targets that were mixed up.

`Truth.seen` has the effects that these readings must show: a test at 1 % over all candidates of the machine finds them
with a probability of 99 %, given everything else that is there, and the covariance of the errors. A function of one
coordinate must also have been measured at twice as many values, over all its components, as it has parameters: any
function goes through fewer. What follows the time alone must be found though the set-up may wander, as one of eight
does: who reads the data does not know that this one is at rest. What is not in it may be claimed, but need not be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from hidden_effects import (
    _XYZ,
    MICRON,
    SECOND,
    Array,
    Bench,
    Hidden,
    Sealed,
    Title,
    Truth,
    _bench,
    _joint,
    _kept,
    _Ones,
    _text,
)
from hidden_parallel import three_sps_s, tricept
from machine_simulator import arcsec
from scipy import stats
from scipy.linalg import solve_triangular


@dataclass(frozen=True)
class Usual:
    """How often a machine has an effect, and how large it is then.

    `size` is the median of the length of the vector of its parameters; the logarithm of this length is normal, with a
    standard deviation of `spread`. The direction of the vector is anywhere.
    """

    chance: float
    size: float
    parameters: tuple[str, ...] = ("a",)
    positive: bool = False
    spread: float = 0.7
    fixed: Mapping[str, tuple[float, float]] = field(
        default_factory=dict
    )  # from, to: parameters that are not sizes


BY_WEIGHTS = frozenset({"weight_windup", "weight_tilt"})
OF_TIME = frozenset({"linear_drift", "warm_up_drift", "frame_shift"})
_WAVE = ("a", "b")
_ACROSS = tuple(f"{w}_{h}" for w in "uv" for h in ("c1", "s1", "c2", "s2"))
_ALONG = ("c1", "s1", "c2", "s2")
_SIX = ("x", "y", "z", "rx", "ry", "rz")


def _robot(joints: Sequence[str], bends: Sequence[str]) -> dict[Title, Usual]:
    """A robot with gears at all joints; `bends` are the joints that carry weight, sizes per N mm."""
    found: dict[Title, Usual] = {}
    for name in joints:
        found["encoder_eccentricity", name] = Usual(0.35, 20 * SECOND, _WAVE)
        found["encoder_ellipticity", name] = Usual(0.08, 8 * SECOND, _WAVE)
        found["backlash", name] = Usual(0.2, 15 * SECOND, ("b",), positive=True)
        found["thermal_offset", name] = Usual(0.05, 1 * SECOND, ("k",))
    for name in bends:
        # 1e6 N m/rad is 2e-4 arcsec/(N mm); the shoulder carries 1e6 N mm
        found["weight_windup", name] = Usual(0.85, 2e-4 * SECOND, ("c",), positive=True)
    found["weight_tilt", joints[0]] = Usual(0.2, 3e-5 * SECOND, ("a",), positive=True)
    found["thermal_axis_drift", joints[0]] = Usual(0.1, 6 * MICRON, ("x", "y", "z"))
    found["instrument_scale", None] = Usual(0.05, 5e-6, ("k",))
    found["frame_shift", None] = Usual(0.12, 30 * MICRON, _SIX)
    found["linear_drift", None] = Usual(0.1, 2e-6, ("x", "y", "z"))
    return found


def _tool(
    rotary: Sequence[str], linear: Sequence[str] = (), bends: Sequence[str] = (), *, worm: bool = False
) -> dict[Title, Usual]:
    """A machine tool; `bends` are rotary joints that carry weight about a level axis."""
    found: dict[Title, Usual] = {}
    for name in rotary:
        found["encoder_eccentricity", name] = Usual(0.35, 6 * SECOND, _WAVE)
        found["encoder_ellipticity", name] = Usual(0.1, 2 * SECOND, _WAVE)
        found["tilt_error_motion", name] = Usual(0.12, 2 * SECOND, _ACROSS)
        found["axial_error_motion", name] = Usual(0.12, 2 * MICRON, _ALONG)
        found["radial_error_motion", name] = Usual(0.12, 3 * MICRON, _ACROSS)
        found["backlash", name] = Usual(0.35 if worm else 0.1, 8 * SECOND, ("b",), positive=True)
        found["thermal_offset", name] = Usual(0.08, 0.7 * SECOND, ("k",))
        found["thermal_axis_drift", name] = Usual(0.1, 4 * MICRON, ("x", "y", "z"))
    for name in bends:
        found["gravity_windup", name] = Usual(0.35, 0.05 * SECOND, ("k",), positive=True)
        found["lateral_windup", name] = Usual(0.1, 0.04 * SECOND, ("a",), positive=True)
    for name in linear:
        found["scale", name] = Usual(0.3, 1e-5, ("k",))
        found["squareness", name] = Usual(0.35, 6 * SECOND, _WAVE)
        found["straightness", name] = Usual(0.15, 3 * MICRON, ("u_2", "u_3", "v_2", "v_3"))
        found["angular_error_motion", name] = Usual(0.12, 4 * SECOND, ("x_1", "y_1", "z_1", "x_2", "y_2"))
        found["backlash", name] = Usual(0.2, 5 * MICRON, ("b",), positive=True)
        found["thermal_expansion", name] = Usual(0.2, 11e-6, ("alpha",), positive=True, spread=0.3)
    found["warm_up_drift", None] = Usual(0.15, 12 * MICRON, ("x", "y", "z"), fixed={"tau": (400.0, 1500.0)})
    return found


def _telescope(first: str, second: str, *, worm: bool) -> dict[Title, Usual]:
    found: dict[Title, Usual] = {
        ("tube_flexure", None): Usual(0.85, 15 * SECOND, ("a",), positive=True),
        ("refraction", None): Usual(0.5, 2 * SECOND, ("a",)),
        ("lateral_windup", first): Usual(0.15, 8 * SECOND, ("a",), positive=True),
    }
    for name in (first, second):
        found["encoder_eccentricity", name] = Usual(0.3, 6 * SECOND, _WAVE)
        found["encoder_ellipticity", name] = Usual(0.08, 2 * SECOND, _WAVE)
        found["tilt_error_motion", name] = Usual(0.08, 1.5 * SECOND, _ACROSS)
        found["scale", name] = Usual(0.25 if worm else 0.03, 1e-4, ("k",))
        if worm:
            found["backlash", name] = Usual(0.2, 12 * SECOND, ("b",), positive=True)
    return found


def _legs(names: Sequence[str]) -> dict[Title, Usual]:
    found: dict[Title, Usual] = {}
    for name in names:
        found["leg_zero_offset", name] = Usual(0.35, 20 * MICRON, ("a",))
        found["leg_scale", name] = Usual(0.15, 1.5e-5, ("k",))
        found["leg_thermal_expansion", name] = Usual(0.2, 1e-5, ("alpha",), positive=True, spread=0.3)
        found["leg_backlash", name] = Usual(0.15, 4 * MICRON, ("b",), positive=True)
        found["leg_compliance", name] = Usual(0.2, 3e-5, ("c",), positive=True)
        found["base_joint_offset", name] = Usual(0.12, 40 * MICRON, ("x", "y", "z"))
        found["platform_joint_offset", name] = Usual(0.12, 40 * MICRON, ("x", "y", "z"))
    return found


# Machines -----------------------------------------------------------------------------------------------------------


def _positions(lo: Sequence[float], hi: Sequence[float], n: int, random: np.random.Generator) -> Array:
    """Draw poses all over the ranges: half of all plans visit fewer of them, several times."""
    if random.integers(2):
        return random.uniform(lo, hi, size=(n, len(lo)))
    few = random.uniform(lo, hi, size=(math.ceil(0.4 * n), len(lo)))
    return np.concatenate([few[random.permutation(len(few))] for _ in range(3)])[:n]


def _grid(values: Sequence[Array], times: int) -> Array:
    """Give every combination of a few values, to and fro."""
    table = np.stack([x.ravel() for x in np.meshgrid(*values, indexing="ij")], -1)
    return np.concatenate([table[:: 1 - 2 * (i % 2)] for i in range(times)])


def arm_6r(random: np.random.Generator) -> Bench:
    """An industrial robot with six joints and three reflectors, seen by a laser tracker that stands anywhere."""
    q = _positions([-70, -45, -55, -120, -90, -150], [70, 45, 45, 120, 90, 150], 70, random)
    places = [(0, 0, 0), (175, 0, 495), (175, 0, 1390), (175, 0, 1565), (1135, 0, 1565), (1270, 0, 1565)]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    targets = {"r1": [1320, 90, 1565], "r2": [1320, -60, 1645], "r3": [1410, -50, 1505]}
    weights = (
        ("J2", (120, 0, 900), 900),
        ("J3", (300, 0, 1560), 700),
        ("J5", (1200, 0, 1565), 150),
        ("J6", (1370, 10, 1570), 300),
    )
    return _arm("6R", axes, places, targets, weights, 0.025, q, random)  # fmt: skip


def arm_7r(random: np.random.Generator) -> Bench:
    """A light arm with seven joints."""
    q = _positions([-80, -70, -80, -90, -80, -80, -150], [80, 70, 80, 90, 80, 80, 150], 80, random)
    heights = (0, 340, 540, 740, 940, 1140, 1140)
    axes = [(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
    targets = {"r1": [60, 0, 1300], "r2": [-40, 55, 1270], "r3": [-20, -60, 1350]}
    weights = (
        ("J2", (0, 0, 450), 60),
        ("J4", (0, 0, 840), 50),
        ("J6", (0, 0, 1150), 25),
        ("J7", (5, 0, 1310), 60),
    )
    return _arm("7R", axes, [(0, 0, z) for z in heights], targets, weights, 0.015, q, random)  # fmt: skip


def _arm(
    name: str,
    axes: Sequence[Sequence[float]],
    places: Sequence[Sequence[float]],
    targets: Mapping[str, Sequence[float]],
    weights: Sequence[tuple[str, Sequence[float], float]],
    sigma: float,
    q: Array,
    random: np.random.Generator,
) -> Bench:
    joints = [
        _joint(f"J{i + 1}", "revolute", axis, place)
        for i, (axis, place) in enumerate(zip(axes, places, strict=True))
    ]
    estimate = [f"J{i + 1}.{what}" for i in range(len(axes)) for what in ("axis", "point")] + ["target"]
    bench = _bench(
        name, joints, targets, estimate, 'kind = "point"\nframe = "free"', sigma, q, random, wrong=0.3
    )
    heavy = random.uniform(0.7, 1.3, len(weights))
    listed = tuple(
        {"joint": joint, "point": point, "newton": newton * factor}
        for (joint, point, newton), factor in zip(weights, heavy, strict=True)
    )
    return replace(bench, weights=listed)


def trunnion(random: np.random.Generator) -> Bench:
    """A five-axis trunnion: balls on its table are probed, often in few positions of each axis."""
    joints = [_joint("A", "revolute", (-1, 0, 0), travel=[-100, 40]), _joint("C", "revolute", (0, 0, -1))]
    if random.integers(2):
        a, c = np.linspace(-90, 30, random.integers(4, 7)), np.arange(0, 360, random.choice([30, 45, 60]))
        q = _grid([a, c.astype(float)], 2)
    else:
        q = random.uniform([-95, 0], [35, 360], size=(60, 2))
    balls = {"b1": [110, 0, 80], "b2": [-40, 70, 30]}
    return _bench(
        "trunnion", joints, balls, ["A.axis", "A.point", "C.axis", "C.point", "target"],
        'kind = "point"\nframe = "machine"', 0.0015, q, random, wrong=0.02,
    )  # fmt: skip


def fork(random: np.random.Generator) -> Bench:
    """A portal with a fork head, C and A, and balls instead of two tools, seen by a tracker."""
    joints = [
        *_XYZ,
        _joint("C", "revolute", (0, 0, 1)),
        _joint("A", "revolute", (1, 0, 0), (0, 0, 0), travel=[-95, 95]),
    ]
    q = _positions([20, 20, -380, -180, -90], [780, 580, -20, 180, 90], 90, random)
    return _bench(
        "fork", joints, {"short": [0, 12, -150], "long": [-10, 0, -290]},
        ["C.axis", "C.point", "A.axis", "A.point", "target"],
        'kind = "point"\nframe = "free"', 0.004, q, random, wrong=0.03,
    )  # fmt: skip


def _sky(
    up: Array,
    joints: Sequence[Mapping[str, Any]],
    tube: Sequence[float],
    lo: Any,
    hi: Any,
    stars: int,
    random: Any,
) -> Array:
    """Draw coordinates of stars that stand at least 15 degrees above the horizon."""
    plain = Bench(
        "sky", _sky_text(joints, tube), (), {}, 1.0, np.zeros((1, 2)), ["tube"], np.zeros(1, int), {}, {}
    )
    q = random.uniform(lo, hi, size=(20 * stars, 2))
    y = plain.simulator(plain.file).measure(q)
    return q[y @ up > math.sin(math.radians(15))][:stars]


def _sky_text(joints: Sequence[Mapping[str, Any]], tube: Sequence[float]) -> str:
    return _text(joints, {"tube": tube}, [], 'kind = "direction"')


def _telescope_bench(
    name: str,
    joints: Sequence[Mapping[str, Any]],
    tube: Sequence[float],
    lo: Any,
    hi: Any,
    sigma: float,
    random: Any,
) -> Bench:
    stars = int(random.choice([40, 70, 110]))
    q = _sky(np.array([0.0, 0, 1]), joints, tube, lo, hi, stars, random)
    axes = [f"{joint['name']}.axis" for joint in joints]
    return _bench(
        name, joints, {"tube": tube}, [*axes, "target"],
        'kind = "direction"\nframe = "machine"', sigma, q, random, wrong=0.0,
    )  # fmt: skip


def equatorial(random: np.random.Generator) -> Bench:
    """A German or fork mount at a latitude of 48 degrees; x east, y north, z up."""
    lat = math.radians(48)
    pole = (0.0, math.cos(lat), math.sin(lat))
    joints = [_joint("HA", "revolute", [-x for x in pole]), _joint("DEC", "revolute", (-1, 0, 0))]
    tube = [
        0.0,
        -math.sin(lat),
        math.cos(lat),
    ]  # hour angle and declination 0: on the meridian, in the equator
    return _telescope_bench("equatorial", joints, tube, [-75, -25], [75, 80], arcsec(3.0), random)


def altaz(random: np.random.Generator) -> Bench:
    """A large telescope's mount; x east, y north, z up."""
    joints = [_joint("AZ", "revolute", (0, 0, -1)), _joint("EL", "revolute", (1, 0, 0))]
    return _telescope_bench("altaz", joints, [0, 1, 0], [0, 16], [360, 86], arcsec(0.7), random)


def _names(prefix: str, n: int) -> list[str]:
    return [f"{prefix}{i + 1}" for i in range(n)]


@dataclass(frozen=True)
class Kind:
    """A kind of machine: how one is drawn and measured, and what is usual in it."""

    bench: Callable[[np.random.Generator], Bench]
    usual: Mapping[Title, Usual]
    equal: Mapping[Title, tuple[Title, ...]] = field(default_factory=dict)
    reach: float = 1.0  # length of an arm, by which compliances per length are multiplied


_WEIGHTS = {
    **{("weight_windup", f"J{i}"): (("gravity_windup", f"J{i}"),) for i in range(1, 8)},
    ("weight_tilt", "J1"): (("lateral_windup", "J1"),),
}
_DROOP: dict[Title, tuple[Title, ...]] = {
    ("tube_flexure", None): (("tube_flexure", None), ("gravity_windup", "EL"))
}

KINDS: dict[str, Kind] = {
    "6R": Kind(arm_6r, _robot(_names("J", 6), ["J2", "J3", "J5"]), _WEIGHTS, 2500),
    "7R": Kind(arm_7r, _robot(_names("J", 7), ["J2", "J4", "J6"]), _WEIGHTS, 1300),
    "trunnion": Kind(trunnion, _tool(["A", "C"], bends=["A"], worm=True), reach=150),
    "fork": Kind(fork, _tool(["C", "A"], "XYZ", bends=["A"]), reach=300),
    "equatorial": Kind(equatorial, _telescope("HA", "DEC", worm=True)),
    "altaz": Kind(altaz, _telescope("AZ", "EL", worm=False), _DROOP),
    "tricept": Kind(tricept, _legs(["A0", "A1", "A-1"])),
    "3-sps-s": Kind(three_sps_s, _legs(["L1", "L2", "L3"])),
}  # fmt: skip
"""Machines by name. `equal` has the catalogue's name of an effect, where it is not the simulator's, and what has the
same formula there."""


# Drawing ------------------------------------------------------------------------------------------------------------


def _drawn(kind: Kind, random: np.random.Generator) -> dict[Title, dict[str, float]]:
    """Draw the effects of a machine: values by parameter."""
    found: dict[Title, dict[str, float]] = {}
    if random.uniform() < 0.15:  # an innocent machine
        return found
    more = random.choice([0.5, 1.0, 1.0, 1.4])
    for title, usual in kind.usual.items():
        if random.uniform() >= min(0.95, more * usual.chance):
            continue
        size = usual.size * math.exp(usual.spread * random.normal())
        if len(usual.parameters) == 1:
            parts = np.array([1.0 if usual.positive else random.choice([-1, 1])])
        else:
            parts = random.normal(size=len(usual.parameters))
            parts /= np.linalg.norm(parts)
        values = {p: float(size * x) for p, x in zip(usual.parameters, parts, strict=True)}
        if title[0] == "frame_shift":  # turns in arc seconds, where lengths are 30 µm
            values |= {p: values[p] / (30 * MICRON) * 5 * SECOND for p in ("rx", "ry", "rz")}
        values |= {p: float(random.uniform(*ends)) for p, ends in usual.fixed.items()}
        found[title] = values
    return found


def _keys(title: Title, values: Mapping[str, float], random: np.random.Generator) -> dict[str, float]:
    effect, place = title
    if effect != "frame_shift":
        return {".".join(filter(None, [place, effect, p])): x for p, x in values.items()}
    return {
        f"frame_shift[{run}].{p}": x * float(f)
        for run, f in (("2", 1), ("3", random.uniform(-1, 1)))
        for p, x in values.items()
    }


def _wander_covariance(b: Bench, kind: str) -> Array:
    """Give the covariance (poses, poses) of what each coordinate of the set-up does, in sigma squared."""
    t = np.asarray(b.columns["t"], dtype=float)
    poses = int(b.pose[-1]) + 1
    at = t[np.searchsorted(b.pose, np.arange(poses))]
    span = at[-1] - at[0]
    apart = np.abs(at[:, None] - at)
    if kind == "pose":
        return np.eye(poses)
    if kind == "ou":
        return np.exp(-apart / (span / 8))
    # a random walk that varies by one sigma about its mean
    walk = np.minimum(at[:, None], at) - at[0]
    centred = np.eye(poses) - 1 / poses
    walk = centred @ walk @ centred
    return walk / (np.trace(walk) / poses)


def _moves(b: Bench) -> Array:
    """Give how readings (readings,) change by a unit move of the set-up along, or about, x, y and z: (3, readings)."""
    letter = "r" if b.kind == "direction" else "t"
    small = SECOND if letter == "r" else MICRON
    clean = b.measure({})
    return np.stack(
        [b.difference(b.measure({f"{letter}{x}": lambda c: small}), clean) / small for x in "xyz"]
    )


def real(kind_name: str, number: int) -> Hidden:
    """Return machine `number` of a kind, with its readings, further readings of it, and its sealed truth."""
    kind = KINDS[kind_name]
    random = np.random.default_rng([sorted(KINDS).index(kind_name), number, 16])
    b = kind.bench(random)
    again = kind.bench(np.random.default_rng([number, 17]))  # further poses, of the same machine
    again = replace(again, wrong=b.wrong, weights=b.weights, text=b.text)
    effects = _drawn(kind, random)
    keys = {title: _keys(title, values, random) for title, values in effects.items()}
    b, again = (replace(x, columns=dict(x.columns)) for x in (b, again))
    everything = {key: value for values in keys.values() for key, value in values.items()}

    wanders = str(random.choice(["", "pose", "walk", "ou"], p=[0.6, 0.15, 0.125, 0.125]))
    if wanders == "pose" and b.kind == "direction":
        wanders = ""  # a pose is one reading
    formulas: dict[str, Callable[..., Any]] = {}
    if wanders:
        spread = np.linalg.cholesky(_wander_covariance(b, wanders) + 1e-9 * np.eye(int(b.pose[-1]) + 1))
        path = b.sigma * spread @ random.normal(size=(len(spread), 3))
        letter = "r" if b.kind == "direction" else "t"
        formulas = {f"{letter}{x}": lambda c, i=i: path[b.pose, i] for i, x in enumerate("xyz")}

    plain = b.simulator(b.file)
    noise = b.sigma * random.normal(size=(len(b.q), 1 if b.kind == "distance" else 3))
    reading = plain.with_noise(b.measure({**everything, **formulas}), noise, _Ones())
    reading, bad = _gross(b, reading, random)
    further = again.simulator(again.file).with_noise(
        again.measure(everything), again.sigma * random.normal(size=(len(again.q), 3)), _Ones()
    )

    states = bool(random.integers(2))
    text = b.text.replace("{noise}", f"noise = {b.sigma!r}" if states else "")
    if b.kind == "direction":
        del b.columns["v"]  # no star is read while the mount slews to it
    kept = _kept(b.columns, list(effects), None, "some", (), random)
    also = {kept_key: again.columns[kept_key] for kept_key in kept if kept_key in again.columns}
    named = {title: kind.equal.get(title, (title,)) for title in effects}
    seen, shown = _seen(b, kind, keys, named, wanders, bad)
    truth = Truth(
        kind="catalogue" if effects else "none",
        effects=tuple(equal[0] for equal in named.values()),
        values={
            key: x
            for title, values in keys.items()
            if named[title] == (title,) or title in named[title]
            for key, x in values.items()
        }
        | {key: x for key, x in b.wrong.items() if not key.startswith("frame.")},
        exact=False,
        outliers=frozenset(bad),
        sigma=b.sigma,
        wanders=wanders,
        seen=seen,
        shown=shown,
        known=_known(b, keys),
        equal={equal[0]: equal for equal in named.values()},
        inexact=frozenset(equal[0] for title, equal in named.items() if title not in equal),
        reach=kind.reach,
        chance={
            name: usual.chance
            for title, usual in kind.usual.items()
            for name in kind.equal.get(title, (title,))
        },
        windup={
            named[title][0]: values["c"] / SECOND * _carried_by(b, str(title[1]))
            for title, values in effects.items()
            if title[0] == "weight_windup"
        },
    )
    arguments = {"q": b.q, "reading": reading, "target": b.target, **kept}
    new = {"q": again.q, "reading": further, "target": again.target, **also}
    return Hidden(f"real {kind_name} {number}", b, arguments, text, Sealed(truth), new)


def _carried_by(b: Bench, joint: str) -> float:
    """Give the sum of the weights that a joint carries, N."""
    names = [str(j["name"]) for j in b.file["joint"]]
    later = names[names.index(joint) :]
    return float(sum(weight["newton"] for weight in b.weights if weight["joint"] in later))


def _gross(b: Bench, reading: Array, random: np.random.Generator) -> tuple[Array, set[int]]:
    """Put gross errors into some data sets: shocks, another star than was meant, two targets mixed up."""
    what = str(random.choice(["none", "shocks", "mixed up"], p=[0.6, 0.25, 0.15]))
    rows = len(reading)
    plain = b.simulator(b.file)
    bad: set[int] = set()
    if what == "shocks":
        bad = {int(i) for i in random.permutation(rows)[: max(1, round(random.uniform(0.005, 0.05) * rows))]}
        for row in sorted(bad):
            reading = plain.with_outliers(reading, [row], b.sigma * random.uniform(8, 60), random)
    elif what == "mixed up" and b.kind == "direction":
        bad = {int(i) for i in random.permutation(rows)[: random.integers(1, 5)]}
        for row in sorted(bad):  # a neighbour of the star that was meant
            reading = plain.with_outliers(reading, [row], arcsec(random.uniform(30, 900)), random)
    elif what == "mixed up":
        reading = reading.copy()
        for pose in random.permutation(int(b.pose[-1]) + 1)[: random.integers(1, 3)]:
            first, second = np.flatnonzero(b.pose == pose)[:2]
            reading[[first, second]] = reading[[second, first]]
            bad |= {int(first), int(second)}
    return reading, bad


_ALONG_OWN = {
    "encoder_eccentricity": 1, "encoder_ellipticity": 1, "axial_error_motion": 1, "tilt_error_motion": 2,
    "radial_error_motion": 2, "straightness": 2, "angular_error_motion": 3,
}  # fmt: skip
"""Effects that are a function of their joint's coordinate, with the number of their components."""

# What can be seen ---------------------------------------------------------------------------------------------------


def _known(b: Bench, keys: Mapping[Title, Mapping[str, float]]) -> frozenset[str]:
    """Give the parameters of the base that no combination of the others, and of what is there, imitates."""
    everything = {key: value for values in keys.values() for key, value in values.items()}
    columns = b.derivatives([*b.base, *everything], at=everything)
    _, s, v = np.linalg.svd(columns, full_matrices=False)
    loose = np.linalg.norm(v[s < 1e-6 * s[0]], axis=0)
    return frozenset(key for key, x in zip(b.base, loose, strict=False) if x < 1e-4)


def _of_weights(b: Bench, reach: float, at: Mapping[str, float]) -> Array:
    """Give what the weights of the parts, which no file tells, may change in the readings: (readings, columns).

    By half of each weight, and by a tenth of the machine's reach along x, y and z of its place.
    """
    plain = b.measure(at)
    columns = [b.difference(plain, plain)[:, None][:, :0]]
    for i, weight in enumerate(b.weights):
        heavier = weight | {"newton": 1.5 * weight["newton"]}
        moved = [weight | {"point": np.asarray(weight["point"]) + 0.1 * reach * x} for x in np.eye(3)]
        for changed in (heavier, *moved):
            weights = (*b.weights[:i], changed, *b.weights[i + 1 :])
            columns.append(b.difference(replace(b, weights=weights).measure(at), plain)[:, None])
    return np.concatenate(columns, axis=1)


def _seen(
    b: Bench, kind: Kind, keys: Mapping[Title, Mapping[str, float]], named: Mapping[Title, Sequence[Title]],
    wanders: str, bad: set[int],
) -> tuple[frozenset[Title], frozenset[Title]]:  # fmt: skip
    """Give the effects that a test at 1 % finds with a probability of 99 %, given all others.

    Then those that it rather finds than not, one after the other, beginning with the one that explains most of what all
    do together: of effects that do nearly the same, one shows. The weights of the parts are not known, as they are not
    to who reads the data, as far as the others depend on them.
    """
    if not keys:
        return frozenset(), frozenset()
    everything = {key: value for values in keys.values() for key, value in values.items()}
    whole = b.measure(everything)
    readings = b.difference(whole, b.measure({})).size
    components = readings // len(b.q)
    good = np.repeat(~np.isin(np.arange(len(b.q)), list(bad)), components)

    def wandering(kind: str) -> Array:
        pose = np.repeat(b.pose, components)
        path = b.sigma**2 * _wander_covariance(b, kind)[np.ix_(pose, pose)]
        return np.asarray(sum(np.outer(move, move) * path for move in _moves(b)))

    covariance = b.sigma**2 * np.eye(readings)
    if wanders:
        covariance += wandering(wanders)

    base = b.derivatives(b.base, at=everything)
    columns = {title: b.derivatives(list(values), at=everything) for title, values in keys.items()}
    joints = [str(joint["name"]) for joint in b.file.get("joint", ())]
    names = list(kind.usual)
    by_weights = frozenset(title for title in keys if title[0] in BY_WEIGHTS)

    @cache
    def among(yielding: frozenset[Title], walks: bool = False) -> tuple[Array, Array]:
        """Give a root of the covariance, and a basis of the geometry, where weights act through some effects."""
        moved = _of_weights(b, kind.reach, {key: x for t in yielding for key, x in keys[t].items()})
        errors = covariance + wandering("walk") if walks else covariance
        root = np.linalg.cholesky((errors + moved @ moved.T)[np.ix_(good, good)])
        u, s, _ = np.linalg.svd(white(root, base), full_matrices=False)
        return root, u[:, s > 1e-9 * s[0]]

    def white(root: Array, x: Array) -> Array:
        return np.asarray(solve_triangular(root, x[good], lower=True))

    def joined(root: Array, u: Array, further: Sequence[Array]) -> Array:
        """Add to a basis; what it imitates but for a hundredth would have to be a hundred times as large."""
        rest = np.concatenate([u[:, :0], *(white(root, x) for x in further)], 1)
        rest /= np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
        more, s, _ = np.linalg.svd(rest - u @ (u.T @ rest), full_matrices=False)
        return np.concatenate([u, more[:, s > 0.01]], 1)

    def power(u: Array, change: Array, k: int) -> float:
        """Give how likely a test at 1 % is to find what a change does outside of a basis."""
        change = change - u @ (u.T @ change)
        needed = stats.chi2.isf(0.01 / len(names), k)
        return float(stats.ncx2.sf(needed, k, float(change @ change)))

    seen = set()
    for title, values in keys.items():
        if title[0] in _ALONG_OWN and (
            len(np.unique(b.q[:, joints.index(str(title[1]))])) * _ALONG_OWN[title[0]] < 2 * len(values)
        ):
            continue
        others = [c for t, c in columns.items() if t != title]
        without = {key: x for key, x in everything.items() if key not in values}
        root, plain = among(by_weights - {title}, title[0] in OF_TIME and wanders != "walk")
        change = white(root, b.difference(whole, b.measure(without)))
        if power(joined(root, plain, others), change, len(values)) > 0.99:
            seen.add(title)

    shown: list[Title] = []
    while len(shown) < len(keys):
        root, plain = among(by_weights & set(shown))
        u = joined(root, plain, [columns[t] for t in shown])
        there = {key: x for t in shown for key, x in keys[t].items()}
        change = white(root, b.difference(whole, b.measure(there)))
        change -= u @ (u.T @ change)
        found: dict[Title, float] = {}
        for title in keys.keys() - set(shown):
            own = joined(root, u, [columns[title]])[:, u.shape[1] :]
            found[title] = power(u, own @ (own.T @ change), len(keys[title]))
        best = max(found, key=lambda title: (found[title], str(title)))
        if found[best] < 0.5:
            break
        shown.append(best)
    return frozenset(named[t][0] for t in seen), frozenset(named[t][0] for t in shown)
