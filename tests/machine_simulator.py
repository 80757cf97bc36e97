"""What does a machine with errors measure? A plain numeric simulation, the judge of rodgen's models.

It shares no code with rodgen: NumPy and tomllib, 4x4 matrices, one formula after the other, clear and slow. Lengths
and angles are in the units of the machine file; only the argument of a sine and the angle of a rotation are radians.

    machine = Simulated("machine.toml", {"C.encoder_eccentricity.a": arcsec(12), "frame_shift[2].x": 0.01})
    reading = machine.measure(q, target=names)                   # q (rows, joints)

An effect is a number by the key ``PLACE.EFFECT.PARAMETER`` (no place for the whole machine), a parameter of the
base is ``NAME.axis.a``, ``NAME.point.b``, ``target.NAME.x`` or ``frame.rx``, and a user's formula is a callable by
``PLACE.COMPONENT`` (``C.rx``, or ``tx`` for the whole machine), which takes a dictionary of columns, angles in it in
radians, and returns values in the units of the file. Besides the catalogue it has the physics behind it:

    revolute    eccentric_scale   offset, direction, radius: the graduation's centre lies off the axis
                play              b: lost motion that remembers the path of the commands
                thermal_lag       k, tau: a body that follows its temperature late
                weight_windup     c: a drive that gives way to the moment of all weights that it carries; the
                                  machine's dictionary lists them, `weight = [{joint, point, newton}]`
                weight_tilt       a: a bearing that does, across its axis
    prismatic   play; thermal_lag alpha, k, tau
                beam              stiffness (E I), tip_force, weight (per length): a cantilever that grows with q
                bridge            stiffness, weight: clamped at both ends of the travel
                carriage          stiffness, force: a weight that moves along a bridge on two supports
    machine     tube_flexure      a: a tube that droops by a sin(zenith angle), whichever way it is mounted

A machine of two branches is two chains from its bed, one that carries the instrument and one that carries the targets:
what the instrument reads is seen from its own body, inv(T_instrument) T_targets p.

The reading of a pose is x, y, z and the matrix of the attitude row by row: 12 numbers.

Readings of the format that were open: of components equally large, the first decides u; tilts of `axis_tilt` and
`NAME.axis` add up as rotation vectors, offsets as vectors; `axial_error_motion` goes along the estimated axis; c counts
every target once, moved by `target` and `target_offset`; a distance is scaled after it is formed; a joint that never
moves has no direction of approach (0); the direction of approach does not start anew with a run; a unit weight at a
later joint has a lever arm for directions too.
"""

from __future__ import annotations

import csv
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
RADIANS = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "arcmin": np.pi / 10800, "arcsec": np.pi / 648000}
COMPONENTS = ("reading", "tx", "ty", "tz", "rx", "ry", "rz")
SIX = ("x", "y", "z", "rx", "ry", "rz")
_PARAMETER = re.compile(r"(?:(?P<place>.+)\.)?(?P<effect>\w+)(?:\[(?P<run>[^]]*)\])?\.(?P<parameter>[^.]+)")


def arcsec(value: float, unit: str = "deg") -> float:
    """Give arc seconds in the angle unit of a machine file."""
    return value * RADIANS["arcsec"] / RADIANS[unit]


# Geometry


def rotation(vector: ArrayLike) -> Array:
    """Give the rotation matrices (..., 3, 3) of rotation vectors (..., 3), by Rodrigues' formula."""
    vector = np.asarray(vector, dtype=float)
    x, y, z = np.moveaxis(vector, -1, 0)
    o = np.zeros_like(x)
    cross = np.stack([np.stack(row, -1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])], -2)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle, and the next (1 - cos(angle)) / angle^2
    return np.eye(3) + sine * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)


def rigid(turn: ArrayLike, point: ArrayLike = (0, 0, 0), shift: ArrayLike = (0, 0, 0)) -> Array:
    """Give x -> point + R(turn) (x - point) + shift as matrices (..., 4, 4)."""
    r = rotation(turn)
    motion = np.zeros((*r.shape[:-2], 4, 4))
    motion[..., :3, :3] = r
    motion[..., :3, 3] = np.asarray(point) - r @ np.asarray(point, dtype=float) + np.asarray(shift)
    motion[..., 3, 3] = 1
    return motion


def carried(motion: Array, x: ArrayLike, *, directions: bool = False) -> Array:
    """Apply motions (..., 4, 4) to points, or to directions, (..., 3)."""
    x = np.asarray(x, dtype=float)
    weight = np.zeros if directions else np.ones
    return (motion @ np.concatenate([x, weight((*x.shape[:-1], 1))], -1)[..., None])[..., :3, 0]


def complete(n: Array) -> tuple[Array, Array]:
    """Give u and v of an axis: u is the next machine axis after the largest component, made perpendicular."""
    next_axis = np.eye(3)[(int(np.argmax(np.abs(n))) + 1) % 3]
    u = next_axis - (next_axis @ n) * n
    u /= np.linalg.norm(u)
    return u, np.cross(n, u)


def unit(vector: ArrayLike) -> Array:
    """Give the unit vectors (..., 3)."""
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def twist(turns: Array, axis: Array) -> Array:
    """Give the angle of rotations (..., 3, 3) about an axis, after the shortest turn that carries the axis along."""
    carried_axis = turns @ axis
    across = np.cross(axis, carried_axis)
    k = np.stack([np.cross(e, across) for e in np.eye(3)], -2)  # k x = across × x
    swing = np.eye(3) + k + k @ k / (1 + carried_axis @ axis)[..., None, None]
    u, v = complete(axis)
    left = (swing.swapaxes(-1, -2) @ turns) @ u
    return np.arctan2(left @ v, left @ u)


def along(scalar: Array, vector: Array) -> Array:
    """Multiply one vector by a scalar of each row."""
    return np.asarray(scalar)[..., None] * vector


# Physics that the catalogue approximates


def true_angle(reading: Array, offset: float, direction: float, radius: float) -> Array:
    """Give the angle that a shaft has turned when a graduation off its axis reads so much; all in radians.

    On the graduation (the frame of this drawing) lies the shaft's axis O at -offset towards `direction` from the
    graduation's centre S. The head, at `radius` from O, is seen from S on the line marked `mark`; seen from O it has
    gone back by as much as the shaft went forward. The head starts at angle 0, and reads 0 there.
    """
    to_centre = offset * np.array([np.cos(direction), np.sin(direction)])  # from O to S
    start = np.arctan2(-to_centre[1], radius - to_centre[0])
    mark = start - np.asarray(reading)
    ray = np.stack([np.cos(mark), np.sin(mark)], -1)
    forward = ray @ to_centre
    distance = -forward + np.sqrt(
        forward**2 + radius**2 - offset**2
    )  # of the head from S: |O to head| = radius
    head = to_centre + distance[..., None] * ray
    turned = -np.arctan2(head[..., 1], head[..., 0])
    return reading + (turned - reading + np.pi) % (2 * np.pi) - np.pi  # in the same turn as the reading


def play(path: Array, lost: float, first: float = 1.0) -> Array:
    """Follow a path through a gap of width `lost`: the driven part stays until a flank pushes it."""
    driven = np.empty(len(path))
    last = path[0] - first * lost / 2
    for i, q in enumerate(path):
        driven[i] = last = min(max(last, q - lost / 2), q + lost / 2)
    return driven


def lagged(t: Array, temperature: Array, tau: float) -> Array:
    """Give the temperature of a body that follows `temperature`, linear between its values, with the lag tau."""
    body = np.empty(len(t))
    body[0] = temperature[0]
    for i in range(1, len(t)):
        step = t[i] - t[i - 1]
        slope = (temperature[i] - temperature[i - 1]) / step if step > 0 else 0.0
        behind = temperature[i - 1] - slope * tau  # the solution that has forgotten its start, at t[i - 1]
        body[i] = behind + slope * step + (body[i - 1] - behind) * np.exp(-step / tau)
    return body


def bent(x: Array, curvature: Array) -> tuple[Array, Array]:
    """Integrate a curvature from x[0] twice: the slope and the deflection (trapezoidal rule)."""

    def integral(y: Array) -> Array:
        return np.concatenate([[0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])

    slope = integral(curvature)
    return slope, integral(slope)


def cantilever(length: float, stiffness: float, tip_force: float, weight: float) -> tuple[float, float]:
    """Give drop and slope at the end of a clamped beam (Euler and Bernoulli)."""
    x = np.linspace(0, length, 2001)
    moment = tip_force * (length - x) + weight * (length - x) ** 2 / 2
    slope, deflection = bent(x, moment / stiffness)
    return float(deflection[-1]), float(slope[-1])


def clamped_bridge(length: float, stiffness: float, weight: float) -> tuple[Array, Array, Array]:
    """Give places, drop and slope of a beam clamped at both ends, under its own weight."""
    x = np.linspace(0, length, 4001)
    by_weight, by_moment, by_force = (np.array(bent(x, y / stiffness)) for y in (weight * x**2 / 2, x**0, x))
    moment, force = np.linalg.solve(
        np.stack([by_moment[:, -1], by_force[:, -1]], -1), -by_weight[:, -1]
    )  # of the clamp at 0, so that the other end is clamped too
    slope, drop = by_weight + moment * by_moment + force * by_force
    return x, drop, slope


def loaded_bridge(length: float, stiffness: float, force: float, place: float) -> tuple[float, float]:
    """Give drop and slope under a force at `place` of a beam on two supports."""
    x = np.union1d(np.linspace(0, length, 2001), place)
    moment = force * np.minimum(x * (length - place), (length - x) * place) / length
    slope, drop = bent(x, -moment / stiffness)
    first = -drop[-1] / length  # the slope at 0 that brings the other end onto its support
    under = int(np.searchsorted(x, place))
    return float(drop[under] + first * place), float(slope[under] + first)


# Effects


@dataclass
class Joint:
    """One joint in all rows; lengths and angles in the units of the file."""

    n: Array  # estimated
    u: Array  # of the file's axis
    v: Array
    point: Array
    q: Array
    phase: Array  # q, of a revolute joint in radians
    s: Array
    speed: Array
    arm: Array  # from `point` to c, in the pose, in this joint's frame
    gravity: Array  # in this joint's frame
    before: Array | None  # the axis of the joint before
    q_before: Array | None  # and its coordinate
    later: Mapping[str, Array]  # from `point` to a later joint's
    turns_only: bool  # a direction is carried: arms are directions without a length
    weights: Array  # moment vectors of the weights that this joint carries, in this joint's frame
    start: Array  # c at zero
    radian: float  # radians in the file's angle unit
    period: float | None
    travel: tuple[float, float] | None
    _columns: Mapping[str, Array | None]

    def column(self, name: str) -> Array:
        """Give t, T or F, or say that it is missing."""
        values = self._columns[name]
        if values is None:
            raise ValueError(f"an effect needs {name}, and it was not given")
        return values

    @property
    def span(self) -> float:
        """Give L."""
        lo, hi = (self.q.min(), self.q.max()) if self.travel is None else self.travel
        return float(hi - lo)

    @property
    def zeta(self) -> Array:
        """Give the place in the travel, 0 to 1."""
        return (self.q - (self.q.min() if self.travel is None else self.travel[0])) / self.span

    def legendre(self, degree: int) -> Array:
        """Give a Legendre polynomial of 2 zeta - 1."""
        return np.polynomial.Legendre.basis(degree)(2 * self.zeta - 1)

    def moment(self, arm: Array | None = None) -> Array:
        """Give the moment vectors (rows, 3) of a unit force along gravity."""
        return np.cross(self.arm if arm is None else arm, self.gravity)

    def turned(self, arm: Array) -> Array:
        """Give arms after a quarter turn about the axis."""
        return np.cross(self.n, arm) + along(arm @ self.n, self.n)

    def across(self, moment: Array) -> Array:
        """Give the part across the axis."""
        return moment - along(moment @ self.n, self.n)


Change = dict[str, Array]  # "reading" (rows,), "rotation" and "translation" (rows, 3)


def zero_offset(j: Joint, a: float = 0) -> Change:
    return {"reading": np.full(len(j.q), a)}


def scale(j: Joint, k: float = 0) -> Change:
    return {"reading": k * j.q}


def encoder_eccentricity(j: Joint, a: float = 0, b: float = 0) -> Change:
    return {"reading": a * np.cos(j.phase) + b * np.sin(j.phase)}


def encoder_ellipticity(j: Joint, a: float = 0, b: float = 0) -> Change:
    return {"reading": a * np.cos(2 * j.phase) + b * np.sin(2 * j.phase)}


def encoder_harmonics(j: Joint, **p: float) -> Change:
    waves = [
        p.get(f"a{k}", 0) * np.cos(k * j.phase) + p.get(f"b{k}", 0) * np.sin(k * j.phase) for k in (3, 4, 8)
    ]
    return {"reading": sum(waves)}


def periodic_drive_error(j: Joint, a: float = 0, b: float = 0, P: float | None = None) -> Change:
    period = j.period if P is None else P
    if period is None:
        raise ValueError("periodic_drive_error needs P, or `period` in the machine file")
    turns = 2 * np.pi * j.q / period
    return {"reading": a * np.sin(turns) + b * np.cos(turns)}


def _harmonics(j: Joint, **sizes: float) -> Array:
    waves = {"c": np.cos, "s": np.sin}
    return sum((x * waves[name[0]](int(name[1]) * j.phase) for name, x in sizes.items()), 0 * j.phase)


def _across_harmonics(j: Joint, parameters: Mapping[str, float], most: int = 2) -> Array:
    unknown = set(parameters) - {f"{w}_{h}{n}" for w in "uv" for h in "cs" for n in range(1, most + 1)}
    if unknown:
        raise TypeError(f"no such parameters: {sorted(unknown)}")
    u, v = (_harmonics(j, **{p[2:]: x for p, x in parameters.items() if p[0] == w}) for w in "uv")
    return along(u, j.u) + along(v, j.v)


def radial_error_motion(j: Joint, **parameters: float) -> Change:
    return {"translation": _across_harmonics(j, parameters)}


def axial_error_motion(j: Joint, c1: float = 0, s1: float = 0, c2: float = 0, s2: float = 0) -> Change:
    return {"translation": along(_harmonics(j, c1=c1, s1=s1, c2=c2, s2=s2), j.n)}


def tilt_error_motion(j: Joint, **parameters: float) -> Change:
    return {"rotation": _across_harmonics(j, parameters, 4)}


def backlash(j: Joint, b: float = 0) -> Change:
    return {"reading": -b / 2 * j.s}


def backlash_gradient(j: Joint, k: float = 0) -> Change:
    return {"reading": -k * j.s * j.q}


def servo_lag(j: Joint, tau: float = 0) -> Change:
    return {"reading": -tau * j.speed}


def acceleration_lag(j: Joint, k: float = 0) -> Change:
    return {"reading": -k * j.column("acceleration")}


def gravity_windup(j: Joint, k: float = 0, k2: float = 0, **later: float) -> Change:
    reading = k * (j.moment() @ j.n) + k2 * (j.moment(j.turned(j.arm)) @ j.n)
    for parameter, value in later.items():
        which, _, name = parameter.partition("_")
        arm = j.later[name]
        reading = reading + value * (j.moment(arm if which == "k" else j.turned(arm)) @ j.n)
    return {"reading": reading}


def load_windup(j: Joint, k: float = 0) -> Change:
    return {"reading": k * j.column("F") * (j.moment() @ j.n)}


def lateral_windup(j: Joint, a: float = 0) -> Change:
    return {"rotation": a * j.across(j.moment())}


def coupling(j: Joint, k: float = 0) -> Change:
    assert j.q_before is not None, "no other axis carries this joint"
    return {"reading": k * j.q_before}


def bearing_waves(j: Joint, a2: float = 0, b2: float = 0, a3: float = 0, b3: float = 0) -> Change:
    assert j.q_before is not None, "no other axis carries this joint"
    turns = np.exp(1j * j.q_before)
    return {"reading": ((a2 - 1j * b2) * turns**2 + (a3 - 1j * b3) * turns**3).real}


def weight_windup(j: Joint, c: float = 0) -> Change:
    return {"reading": c * (j.weights @ j.n)}


def weight_tilt(j: Joint, a: float = 0) -> Change:
    return {"rotation": a * j.across(j.weights)}


def axis_flexure(j: Joint, a: float = 0) -> Change:
    return {"rotation": a * np.cross(j.n, j.gravity)}


def fork_flexure(j: Joint, a: float = 0) -> Change:
    assert j.before is not None, "no other axis carries this joint"
    fork = -np.sign(j.gravity @ j.before)[:, None] * j.before  # it stands upwards
    return {"reading": a * (np.cross(fork, j.gravity) @ j.n)}


def thermal_offset(j: Joint, k: float = 0) -> Change:
    return {"reading": k * j.column("T")}


def thermal_axis_drift(j: Joint, x: float = 0, y: float = 0, z: float = 0) -> Change:
    return {"translation": along(j.column("T"), np.array([x, y, z]))}


def eccentric_scale(j: Joint, offset: float = 0, direction: float = 0, radius: float = 1) -> Change:
    angle = true_angle(j.phase, offset, direction * j.radian, radius)
    return {"reading": (angle - j.phase) / j.radian}


def play_of_joint(j: Joint, b: float = 0) -> Change:
    moves = np.flatnonzero(j.s)
    return {"reading": play(j.q, b, j.s[moves[0]] if len(moves) else 0.0) - j.q}


def thermal_lag(j: Joint, tau: float = 1, k: float = 0, alpha: float = 0) -> Change:
    return {"reading": (k + alpha * j.q) * lagged(j.column("t"), j.column("T"), tau)}


def straightness(j: Joint, **parameters: float) -> Change:
    translation = np.zeros((len(j.q), 3))
    for parameter, value in parameters.items():
        vector, degree = {"u": j.u, "v": j.v}[parameter[:-2]], int(parameter[-1])
        assert degree in (2, 3, 4), parameter
        translation += along(value * j.legendre(degree), vector)
    return {"translation": translation}


def angular_error_motion(j: Joint, **parameters: float) -> Change:
    turn = np.zeros((len(j.q), 3))
    for parameter, value in parameters.items():
        component, degree = "xyz".index(parameter[:-2]), int(parameter[-1])
        assert degree in (1, 2, 3), parameter
        turn[:, component] += value * j.legendre(degree)
    return {"rotation": turn}


def thermal_expansion(j: Joint, alpha: float = 0) -> Change:
    return {"reading": alpha * j.column("T") * j.q}


def _sag(j: Joint, drop: Array, slope: Array) -> Change:
    """Let c, carried by this joint alone, drop along gravity, and the beam turn about it by a slope in radians."""
    turn = slope[:, None] * np.cross(j.n, j.gravity)
    c = j.start + along(j.q, j.n) - j.point
    shift = drop[:, None] * j.gravity + c - carried(rigid(turn), c)
    return {"rotation": turn / j.radian, "translation": shift}


def gravity_sag(j: Joint, tip: float = 0, own: float = 0, mid: float = 0) -> Change:
    z = j.zeta
    drop = tip * z**3 + own * z**4 + 16 * mid * z**2 * (1 - z) ** 2
    slope = 1.5 * tip * z**2 + 4 / 3 * own * z**3 + 32 * mid * z * (1 - z) * (1 - 2 * z)
    return _sag(j, drop, slope / j.span)


def load_sag(j: Joint, k0: float = 0, k3: float = 0) -> Change:
    force = j.column("F")
    return _sag(j, force * (k0 + k3 * j.zeta**3), 1.5 * force * k3 * j.zeta**2 / j.span)


def guide_windup(j: Joint, a: float = 0, b: float = 0) -> Change:
    moment = j.moment(j.arm if j.turns_only else j.arm - along(j.q, j.n))
    return {"rotation": (a + b * j.zeta)[:, None] * j.across(moment)}


def beam(j: Joint, stiffness: float = 1, tip_force: float = 0, weight: float = 0) -> Change:
    ends = np.array([cantilever(z * j.span, stiffness, tip_force, weight) for z in j.zeta])
    return _sag(j, ends[:, 0], ends[:, 1])


def bridge(j: Joint, stiffness: float = 1, weight: float = 0) -> Change:
    x, drop, slope = clamped_bridge(j.span, stiffness, weight)
    return _sag(j, np.interp(j.zeta * j.span, x, drop), np.interp(j.zeta * j.span, x, slope))


def carriage(j: Joint, stiffness: float = 1, force: float = 0) -> Change:
    places = np.array([loaded_bridge(j.span, stiffness, force, z * j.span) for z in j.zeta])
    return _sag(j, places[:, 0], places[:, 1])


_BOTH: dict[str, Callable[..., Change]] = {
    f.__name__: f
    for f in (
        zero_offset,
        scale,
        periodic_drive_error,
        backlash,
        backlash_gradient,
        servo_lag,
        acceleration_lag,
        thermal_offset,
        thermal_lag,
    )
} | {"play": play_of_joint}
EFFECTS: dict[str, dict[str, Callable[..., Change]]] = {
    "revolute": _BOTH
    | {
        f.__name__: f
        for f in (
            encoder_eccentricity,
            encoder_ellipticity,
            encoder_harmonics,
            radial_error_motion,
            axial_error_motion,
            tilt_error_motion,
            gravity_windup,
            load_windup,
            lateral_windup,
            coupling,
            bearing_waves,
            weight_windup,
            weight_tilt,
            axis_flexure,
            fork_flexure,
            thermal_axis_drift,
            eccentric_scale,
        )
    },
    "prismatic": _BOTH
    | {
        f.__name__: f
        for f in (
            straightness,
            angular_error_motion,
            thermal_expansion,
            gravity_sag,
            load_sag,
            guide_windup,
            beam,
            bridge,
            carriage,
        )
    },
}
AXIS = {
    "revolute": {"axis", "axis_tilt"},
    "prismatic": {"axis", "squareness"},
}  # parameters that turn the axis
POINT = {"point", "axis_offset"}  # and those that move the point
MACHINE = {"frame", "frame_shift", "warm_up_drift", "linear_drift", "instrument_scale"}
BY_RUN = {"frame_shift", "target_remounting"}
MACHINE |= {"refraction", "tube_flexure", "instrument_axis_scales", "instrument_squareness"}


# The machine


class Simulated:
    """A machine file with its errors, which are numbers or callables by key (see the top of this file).

    Parameters
    ----------
    machine : path or dict
        The machine file, or what tomllib reads from it. Values of its `hold` are errors of the machine too.
    effects : mapping, optional
        Number or callable by key, in the units of the file. A key that means nothing here is an error.
    """

    def __init__(
        self,
        machine: str | Path | Mapping[str, Any],
        effects: Mapping[str, float | Callable[..., Any]] | None = None,
    ) -> None:
        if isinstance(machine, str | Path):
            machine = tomllib.loads(Path(machine).read_text(encoding="utf-8"))
        self.file = machine
        self.radian = RADIANS[machine["units"]["angle"]]
        environment = machine.get("environment", {})
        self.gravity = unit(environment.get("gravity", [0, 0, -1]))
        self.reference = float(environment.get("reference_temperature", 20))
        self.joints = machine["joint"]
        self.weights = machine.get("weight", [])
        self.joint_names = [joint["name"] for joint in self.joints]
        self.target_names = [target["name"] for target in machine["target"]]
        self.kind = machine["measured"]["kind"]
        named = {branch["name"]: branch["joints"] for branch in machine.get("branch", [])}
        instrument = machine["measured"].get("instrument", "workpiece")
        carrying = named.pop(instrument, [])
        (others,) = named.values() or [self.joint_names if not carrying else []]
        self.carrying, self.others = (
            [self.joint_names.index(name) for name in names] for names in (carrying, others)
        )
        self.numbers: dict[tuple[str | None, str, str | None], dict[str, float]] = {}
        self.formulas: dict[tuple[str | None, str], Callable[..., Any]] = {}
        for effect in machine.get("effect", []):
            place = effect.get("joint") or effect.get("target")
            key = ".".join(filter(None, [place, effect.get("component")]))
            if "formula" in effect:
                if key not in (effects or {}):
                    raise ValueError(
                        f"the file's formula {effect['name']} needs a callable by the key {key!r}"
                    )
                continue
            for parameter, value in effect.get("hold", {}).items():
                self._take(".".join(filter(None, [place, effect["name"], parameter])), value)
        for key, value in (effects or {}).items():
            self._take(key, value)

    def _take(self, key: str, value: float | Callable[..., Any]) -> None:
        """Put an effect to the others, when it can act on this machine."""
        if callable(value):
            place, _, component = key.rpartition(".")
            if component not in COMPONENTS or place not in {*self.joint_names, *self.target_names, ""}:
                raise KeyError(f"{key!r}: a callable belongs to PLACE.COMPONENT, of {COMPONENTS}")
            self.formulas[place or None, component] = value
            return
        match = _PARAMETER.fullmatch(key)
        if match is None:
            raise KeyError(f"{key!r} is not PLACE.EFFECT.PARAMETER")
        place, effect, run, parameter = match.group("place", "effect", "run", "parameter")
        if place == "target":  # target.NAME.x
            place, effect = effect, "target"
        types = {joint["name"]: joint["type"] for joint in self.joints}
        if place is None:
            known = MACHINE
        elif place in types:
            known = {*EFFECTS[types[place]], *AXIS[types[place]], *POINT}
        else:
            known = {"target", "target_offset", "target_remounting"} if place in self.target_names else set()
        if effect not in known or (run is not None and effect not in BY_RUN):
            raise KeyError(f"{key!r} is no effect that this machine can have")
        if effect == "frame" and self.file["measured"].get("frame", "machine") != "free":
            raise KeyError(f"{key!r}: the frame of this machine is not free")
        self.numbers.setdefault((place, effect, run), {})[parameter] = float(value)

    def _sum(
        self, place: str | None, effects: set[str], names: Sequence[str], run: str | None = None
    ) -> Array:
        """Add up the parameters called `names` of some effects; other parameters of theirs are errors."""
        total = np.zeros(len(names))
        for effect in sorted(effects):
            parameters = self.numbers.get((place, effect, run), {})
            unknown = set(parameters) - set(names)
            if unknown:
                raise KeyError(f"{place}.{effect} has no parameters {sorted(unknown)}")
            total += [parameters.get(name, 0.0) for name in names]
        return total

    def _axis(self, joint: Mapping[str, Any]) -> tuple[Array, Array, Array, Array]:
        """Give n (as estimated), u and v (of the file) and the point."""
        n = unit(joint["axis"])
        u, v = complete(n)
        a, b = self._sum(joint["name"], AXIS[joint["type"]], "ab") * self.radian
        c, d = self._sum(joint["name"], POINT, "ab")
        return rotation(a * u + b * v) @ n, u, v, np.array(joint.get("point", [0, 0, 0])) + c * u + d * v

    def _targets(self, run: str | None = None) -> Array:
        """Give the targets at zero, (targets, 3), as they sit in a run."""
        targets = []
        for target in self.file["target"]:
            p = np.array(target.get("point", (0, 0, 1)), dtype=float)
            names = {"direction": ("a", "b"), "pose": SIX, "angle": ("zero", "", "")}.get(self.kind, SIX[:3])
            moved = self._sum(target["name"], {"target", "target_offset"}, names)[:3]
            if run is not None:
                moved = moved + self._sum(target["name"], {"target_remounting"}, names, run)[:3]
            if self.kind == "direction":
                u, v = complete(unit(p))
                a, b = moved * self.radian
                p = rotation(a * u + b * v) @ unit(p)
            elif self.kind != "angle":
                p = p + moved
            targets.append(p)
        return np.array(targets)

    def _attitudes(self, run: str | None = None) -> Array:
        """Give the attitudes of the targets at zero, (targets, 4, 4): by the file, by what is wrong, by the run."""
        found = []
        if self.kind == "angle":
            return np.array([np.eye(4)] * len(self.target_names))
        for target in self.file["target"]:
            own = self._sum(target["name"], {"target", "target_offset"}, SIX)[3:] * self.radian
            again = self._sum(target["name"], {"target_remounting"}, SIX, run)[3:] * self.radian
            of_file = rigid(np.array(target.get("attitude", [0, 0, 0])) * self.radian)
            found.append(rigid(again) @ rigid(own) @ of_file)
        return np.array(found)

    def _of_rows(
        self, of_run: Callable[[str | None], Array], names: Sequence[str], labels: Sequence[str | None]
    ) -> Array:
        """Give, for each row, what is the target's in its run."""
        by_run = {label: of_run(label) for label in labels}
        rows = zip(names, labels, strict=True)
        return np.array([by_run[label][self.target_names.index(name)] for name, label in rows])

    def _motion(self, joint: Mapping[str, Any], n: Array, point: Array, q: Array) -> Array:
        """Give the motions J of one joint, for coordinates in units of the file."""
        if joint["type"] == "prismatic":
            return rigid(np.zeros((len(q), 3)), shift=along(q, n))
        return rigid(along(q * self.radian, n), point)

    def _formula(self, place: str | None, component: str, columns: Mapping[str, Any], rows: int) -> Array:
        """Evaluate a user's formula, zero where there is none."""
        formula = self.formulas.get((place, component))
        return np.zeros(rows) if formula is None else np.broadcast_to(formula(columns), rows).astype(float)

    def _of_targets(self, names: Sequence[str], component: str, columns: Mapping[str, Any]) -> Array:
        """Evaluate the formulas at targets, in each row that of its own."""
        values = np.zeros(len(names))
        for name in self.target_names:
            its = np.array(names) == name
            values[its] = self._formula(name, component, columns, len(names))[its]
        return values

    def measure(
        self,
        q: ArrayLike,
        *,
        target: Sequence[str] | str | None = None,
        s: ArrayLike | None = None,
        v: ArrayLike | None = None,
        t: ArrayLike | None = None,
        temperature: Mapping[str, ArrayLike] | None = None,
        load: ArrayLike | None = None,
        run: Sequence[Any] | None = None,
        covariates: Mapping[str, ArrayLike] | None = None,
    ) -> Array:
        """Give what an instrument without noise reads.

        Parameters
        ----------
        q : array_like, shape (rows, joints)
            Commanded coordinates, in units of the file.
        target : names of the rows' targets, or one for all; the first when left out
        s, v : array_like, shape (rows, joints)
            Direction of approach (left out: from the order of the rows) and velocity (left out: 0).
        t, load : array_like, shape (rows,)
            Seconds and newtons.
        temperature : mapping
            Temperatures in degC by joint.
        run, covariates
            Labels, and further columns by name that formulas may use.

        Returns
        -------
        array, shape (rows, 3), for distances (rows, 1), for poses (rows, 12)
        """
        q = np.asarray(q, dtype=float)
        rows = len(q)
        s = approach(q) if s is None else np.asarray(s, dtype=float)
        speed = np.zeros_like(q) if v is None else np.asarray(v, dtype=float)
        directions = self.kind == "direction"
        axes = [self._axis(joint) for joint in self.joints]
        targets = self._targets()
        c = np.broadcast_to(targets.mean(axis=0), (rows, 3))
        ideal = [
            self._motion(joint, n, point, q[:, j])
            for j, (joint, (n, _, _, point)) in enumerate(zip(self.joints, axes, strict=True))
        ]

        columns = {
            **{name: np.asarray(x, dtype=float) for name, x in (covariates or {}).items()},
            **{
                joint["name"]: q[:, j] * (self.radian if joint["type"] == "revolute" else 1.0)
                for j, joint in enumerate(self.joints)
            },
            "t": None if t is None else np.asarray(t, dtype=float),
            "F": None if load is None else np.asarray(load, dtype=float),
            "T": None,
        }

        names = (
            [target or self.target_names[0]] * rows if target is None or isinstance(target, str) else target
        )
        if directions:
            columns = self._sky(q, names) | columns
        unmoved = np.broadcast_to(np.eye(4), (rows, 4, 4))
        real = {"instrument": unmoved, "targets": unmoved}
        ways = [("instrument", i, j) for i, j in enumerate(self.carrying)]
        ways += [("targets", i, j) for i, j in enumerate(self.others)]
        before = unmoved  # the ideal motion of the joints before this one
        for way, place_in_way, j in ways:
            joint, chain = self.joints[j], self.carrying if way == "instrument" else self.others
            if place_in_way == 0:
                before = unmoved
            previous = chain[place_in_way - 1] if place_in_way else None
            onwards = chain[place_in_way:]
            n, u, w, point = axes[j]
            name = joint["name"]
            warm = None
            if temperature is not None and name in temperature:
                warm = np.asarray(temperature[name], dtype=float) - self.reference
            later, arm = {}, c
            weights = np.zeros((rows, 3))
            for k in reversed(onwards):
                arm = carried(ideal[k], arm, directions=directions)
                if k != j:
                    place = np.broadcast_to(axes[k][3], (rows, 3))
                    for between in reversed(onwards[: onwards.index(k)]):
                        place = carried(ideal[between], place)
                    later[self.joint_names[k]] = place - point
            gravity = np.einsum("rji,j->ri", before[:, :3, :3], self.gravity)
            for weight in self.weights:
                place = np.broadcast_to(np.array(weight["point"], dtype=float), (rows, 3))
                carrier = self.joint_names.index(weight["joint"])
                if carrier in onwards:
                    for k in reversed(onwards[: onwards.index(carrier) + 1]):
                        place = carried(ideal[k], place)
                    weights += weight["newton"] * np.cross(place - point, gravity)
            state = Joint(
                n=n,
                u=u,
                v=w,
                point=point,
                q=q[:, j],
                phase=columns[name],
                s=s[:, j],
                speed=speed[:, j],
                arm=arm if directions else arm - point,
                gravity=gravity,
                before=None if previous is None else axes[previous][0],
                q_before=None if previous is None else q[:, previous],
                later=later,
                weights=weights,
                turns_only=directions,
                start=c,
                radian=self.radian,
                period=joint.get("period"),
                travel=joint.get("travel"),
                _columns={**columns, "T": warm, "acceleration": columns.get(f"a_{name}")},
            )
            change: Change = {
                "reading": np.zeros(rows),
                "rotation": np.zeros((rows, 3)),
                "translation": np.zeros((rows, 3)),
            }
            for (place_name, effect, _), parameters in self.numbers.items():
                if place_name == name and effect in EFFECTS[joint["type"]]:
                    for component, value in EFFECTS[joint["type"]][effect](state, **parameters).items():
                        change[component] = change[component] + value
            of_formula = {
                **columns,
                "q": state.phase,
                "s": state.s,
                "v": state.speed * (self.radian if joint["type"] == "revolute" else 1.0),
                "T": warm,
            }
            user = {x: self._formula(name, x, of_formula, rows) for x in COMPONENTS}
            change["reading"] = change["reading"] + user["reading"]
            change["translation"] = change["translation"] + np.stack([user[f"t{x}"] for x in "xyz"], -1)
            change["rotation"] = change["rotation"] + np.stack([user[f"r{x}"] for x in "xyz"], -1)

            error = rigid(change["rotation"] * self.radian, point, change["translation"])
            real[way] = real[way] @ error @ self._motion(joint, n, point, q[:, j] + change["reading"])
            before = before @ ideal[j]

        labels = [None] * rows if run is None else [str(label) for label in run]
        seen = self._of_rows(self._targets, names, labels)
        moves = np.stack(
            [self._of_targets(names, ("r" if directions else "t") + x, columns) for x in "xyz"], -1
        )
        seen = carried(rigid(moves * self.radian), seen) if directions else seen + moves
        at_bed = carried(real["targets"], seen, directions=directions)
        at_bed = self._lifted(at_bed)
        back = np.linalg.inv(real["instrument"])
        read = self._read(carried(back, at_bed, directions=directions), columns, run)
        if self.kind not in {"pose", "angle"}:
            return read
        turned = back @ real["targets"] @ self._of_rows(self._attitudes, names, labels)
        for motion in (self._drift(columns, rows), self._set_up(run, rows), self._frame()):
            turned = motion @ turned
        if self.kind == "angle":
            zeros = {name: self._sum(name, {"target", "target_offset"}, ["zero"])[0] for name in set(names)}
            zero = np.array([zeros[name] for name in names])
            zero = zero + [
                self._sum(name, {"target_remounting"}, ["zero"], label)[0]
                for name, label in zip(names, labels, strict=True)
            ]
            return (twist(turned[:, :3, :3], unit(self.file["measured"]["about"])) / self.radian + zero)[
                :, None
            ]
        return np.concatenate([read, turned[:, :3, :3].reshape(rows, 9)], axis=1)

    def _sky(self, q: Array, names: Sequence[str]) -> dict[str, Array]:
        """Give zenith angle and azimuth of the lines of sight of a machine without errors."""
        given = {target["name"]: unit(target["point"]) for target in self.file["target"]}
        x = np.array([given[name] for name in names])
        for joint, coordinate in ((self.joints[j], q[:, j]) for j in reversed(self.others)):
            x = carried(self._motion(joint, unit(joint["axis"]), np.zeros(3), coordinate), x, directions=True)
        up = -self.gravity
        east, north = complete(up)
        return {"z": np.arccos(np.clip(x @ up, -1, 1)), "azimuth": np.arctan2(x @ east, x @ north)}

    def _read(self, y: Array, columns: Mapping[str, Any], run: Sequence[Any] | None) -> Array:
        """Give what an instrument reads of points, or directions, (rows, 3) of the machine."""
        rows, directions = len(y), self.kind == "direction"
        for motion in (self._drift(columns, rows), self._set_up(run, rows), self._frame()):
            y = carried(motion, y, directions=directions)
        (k,) = self._sum(None, {"instrument_scale"}, "k")
        if self.kind == "distance":
            y = np.linalg.norm(y - self.file["measured"]["from"], axis=1, keepdims=True)
        if self.kind in {"point", "pose"}:
            x_scale, y_scale = self._sum(None, {"instrument_axis_scales"}, "xy")
            xy, xz, yz = self._sum(None, {"instrument_squareness"}, ["xy", "xz", "yz"]) * self.radian
            y = y @ np.array([[1 + x_scale, xy, xz], [0, 1 + y_scale, yz], [0, 0, 1]]).T
        return y if directions else (1 + k) * y

    def _lifted(self, y: Array) -> Array:
        """Turn directions towards the zenith by a tan(z), finite near the horizon, less the tube's droop, b sin(z)."""
        (a,) = self._sum(None, {"refraction"}, "a") * self.radian
        (b,) = self._sum(None, {"tube_flexure"}, "a") * self.radian
        if (a == 0 and b == 0) or self.kind != "direction":
            return y
        up = -self.gravity
        cosine = y @ up
        horizontal = np.cross(y, up)  # about it y turns towards the zenith; its length is sin(z)
        low = 0.087  # of z = 85 degrees; below, the tangent goes on smoothly to 2/low at the horizon
        secant = np.where(cosine > low, 1 / np.maximum(cosine, low), 2 * low / (low**2 + cosine**2))
        return carried(rigid((a * secant - b)[:, None] * horizontal), y)

    def _drift(self, columns: Mapping[str, Any], rows: int) -> Array:
        """Give the moves of the frame that differ from row to row; directions turn where points shift."""
        move, turn = np.zeros((rows, 3)), np.zeros((rows, 3))
        drift = turn if self.kind == "direction" else move
        for effect in ("warm_up_drift", "linear_drift"):
            parameters = dict(self.numbers.get((None, effect, None), {}))
            if parameters:
                t = columns["t"]
                if t is None:
                    raise ValueError(f"{effect} needs t, and it was not given")
                time = t if effect == "linear_drift" else 1 - np.exp(-t / parameters.pop("tau"))
                drift += along(time, np.array([parameters.pop(x, 0.0) for x in "xyz"]))
                if parameters:
                    raise KeyError(f"{effect} has no parameters {sorted(parameters)}")
        for i, x in enumerate("xyz"):
            move[:, i] += self._formula(None, f"t{x}", columns, rows)
            turn[:, i] += self._formula(None, f"r{x}", columns, rows)
        return rigid(turn * self.radian, shift=move)

    def _set_up(self, run: Sequence[Any] | None, rows: int) -> Array:
        """Give the rigid transform of the frame in each run, or of all."""
        labels = [None] * rows if run is None else [str(label) for label in run]
        motions = {}
        for label in {None, *labels}:
            names = "xyz" if self.kind == "direction" else ("x", "y", "z", "rx", "ry", "rz")
            values = self._sum(None, {"frame_shift"}, names, label)
            if self.kind == "direction":
                motions[label] = rigid(values * self.radian)
            else:
                motions[label] = rigid(values[3:] * self.radian, shift=values[:3])
        return np.stack([motions[None] @ motions[label] if label else motions[None] for label in labels])

    def _frame(self) -> Array:
        """Give the transform B into the frame of the instrument."""
        values = self._sum(None, {"frame"}, ("x", "y", "z", "rx", "ry", "rz"))
        return rigid(values[3:] * self.radian, shift=values[:3])

    # What instruments and set-ups add

    def with_noise(self, reading: Array, sigma: ArrayLike, random: np.random.Generator) -> Array:
        """Add noise of standard deviation `sigma`: a length, or an angle across a direction; of poses three of each."""
        shape = (len(reading), 6) if self.kind == "pose" else reading.shape
        return self._moved(reading, random.normal(size=shape) * np.asarray(sigma, dtype=float))

    def with_outliers(
        self, reading: Array, rows: Sequence[int], size: float, random: np.random.Generator
    ) -> Array:
        """Move the readings of some rows by `size`, each in its own direction."""
        move = np.zeros_like(reading)
        move[list(rows)] = unit(random.normal(size=(len(rows), reading.shape[1]))) * size
        if self.kind == "direction":  # across the direction, so that all of it counts
            move[list(rows)] = unit(np.cross(move[list(rows)], reading[list(rows)])) * size
        return self._moved(reading, move)

    def _moved(self, reading: Array, move: Array) -> Array:
        if self.kind == "direction":
            return carried(rigid(move * self.radian), reading)
        if self.kind == "pose":
            turned = rotation(move[:, 3:] * self.radian) @ reading[:, 3:].reshape(-1, 3, 3)
            return np.concatenate([reading[:, :3] + move[:, :3], turned.reshape(-1, 9)], axis=1)
        return reading + move

    def write_csv(
        self,
        path: str | Path,
        q: ArrayLike,
        reading: Array,
        *,
        target: Sequence[str] | None = None,
        s: ArrayLike | None = None,
        v: ArrayLike | None = None,
        t: ArrayLike | None = None,
        temperature: Mapping[str, ArrayLike] | None = None,
        load: ArrayLike | None = None,
        run: Sequence[Any] | None = None,
        covariates: Mapping[str, ArrayLike] | None = None,
        uncertainty: ArrayLike | None = None,
        decimals: Mapping[str, int] | None = None,
    ) -> None:
        """Write a measurement file; arguments as of `measure`, so that both take the same.

        Parameters
        ----------
        uncertainty : array_like, shape (rows, 3 or 1)
            Standard uncertainty of each scalar reading.
        decimals : mapping
            Decimals by column, "q" for all joints and "reading" for all readings; all figures when left out.
        """
        q = np.asarray(q, dtype=float)
        length, angle = self.file["units"]["length"], self.file["units"]["angle"]
        decimals = dict(decimals or {})
        units = [angle if joint["type"] == "revolute" else length for joint in self.joints]
        columns: list[tuple[str, str, Any, int | None]] = []  # name, unit, values, decimals

        def put(name: str, unit_: str, values: Any, kind: str = "") -> None:
            columns.append((name, unit_, values, decimals.get(name, decimals.get(kind))))

        for j, name in enumerate(self.joint_names):
            put(name, units[j], q[:, j], "q")
        if target is not None:
            put("target", "", target)
        names = {"direction": ["ux", "uy", "uz"], "distance": ["d"]}.get(self.kind, ["x", "y", "z"])
        for i, name in enumerate(names):
            put(name, "" if self.kind == "direction" else length, reading[:, i], "reading")
        for i, value in enumerate(reading[:, 3:].T):
            put(f"r{i // 3 + 1}{i % 3 + 1}", "", value)
        if uncertainty is not None:
            names += ["rx", "ry", "rz"] if self.kind == "pose" else []
            stated = np.broadcast_to(np.asarray(uncertainty, dtype=float), (len(reading), len(names)))
            for i, name in enumerate(names):
                turns = self.kind == "direction" or name.startswith("r")
                put(f"u_{name}", angle if turns else length, stated[:, i])
        for prefix, table in (("dir", s), ("v", v)):
            for j, name in enumerate(self.joint_names if table is not None else []):
                values = np.asarray(table, dtype=float)[:, j]
                put(f"{prefix}_{name}", f"{units[j]}/s" if prefix == "v" else "", values, prefix)
        if t is not None:
            put("t", "s", t)
        for name, values in (temperature or {}).items():
            put(f"T_{name}", "degC", values, "T")
        if load is not None:
            put("load", "N", load)
        if run is not None:
            put("run", "", run)
        for name, values in (covariates or {}).items():
            put(name, "", values)

        def text(value: Any, places: int | None) -> str:
            if isinstance(value, str | int | np.integer):
                return str(value)
            if places is None:
                return f"{value:.17g}" if float(f"{value:.15g}") != value else f"{value:.15g}"
            return f"{value:.{places}f}"

        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([f"{name} [{unit_}]" if unit_ else name for name, unit_, _, _ in columns])
            for row in zip(*(values for _, _, values, _ in columns), strict=True):
                writer.writerow([text(x, places) for x, (_, _, _, places) in zip(row, columns, strict=True)])


def approach(q: Array) -> Array:
    """Give the direction of approach (rows, joints) of each row, from the order of the rows."""
    s = np.zeros_like(q)
    for j in range(q.shape[1]):
        steps = np.sign(np.diff(q[:, j]))
        moves = np.flatnonzero(steps)
        last = steps[moves[0]] if len(moves) else 0.0
        for row in range(len(q)):
            if row > 0 and steps[row - 1]:
                last = steps[row - 1]
            s[row, j] = last
    return s


def random_walk(
    t: ArrayLike, per_root_second: float, random: np.random.Generator
) -> dict[str, Callable[..., Array]]:
    """Give the formulas of a frame that wanders from row to row, as an instrument's tripod does."""
    steps = np.sqrt(np.diff(np.asarray(t, dtype=float), prepend=np.asarray(t)[0]))
    path = np.cumsum(random.normal(size=(len(steps), 3)) * steps[:, None] * per_root_second, axis=0)
    return {f"t{x}": lambda columns, i=i: path[:, i] for i, x in enumerate("xyz")}
