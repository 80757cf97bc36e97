"""What does a machine of parallel legs with errors measure? A plain numeric simulation, the judge of rodgen's families.

It shares no code with rodgen: joint centres as vectors, a loop that is closed when every leg is as long as it is,
forces that hold each other in balance. What acts on readings whatever the machine is made of (instrument, frame, noise,
files) is that of :mod:`machine_simulator`; keys, units and columns are as there.

    machine = Parallel("machine.toml", {"A1.leg_thermal_expansion.alpha": 12e-6, "geometry.R": 0.04})
    legs = machine.legs(alpha_beta_z)                        # what a control of the drawn machine would command
    reading = machine.measure(legs, temperature={"A1": t_1})

A leg's errors are ``LEG.EFFECT.PARAMETER``; the drawing's are ``geometry.R`` (``r``, ``h``, ``q.x`` ...) and
``target.NAME.x``; a callable belongs to ``LEG.reading``. Besides the catalogue it has the physics behind it:
``play`` (b: lost motion that remembers its path), ``thermal_lag`` (alpha, k, tau) and ``spring`` (c: a leg that
stretches in the pose which it takes because it stretches).

``leg_compliance`` takes the forces of the machine with all its errors, before the legs give way.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from machine_simulator import _PARAMETER, Array, Simulated, along, approach, lagged, play, rotation, unit
from numpy.typing import ArrayLike

LEGS = {"tricept": ("A0", "A1", "A-1"), "3-sps-s": ("L1", "L2", "L3")}
AT = {"tricept": (0.0, 120.0, -120.0), "3-sps-s": (-30.0, 90.0, 210.0)}
NUMBERS = {"tricept": ("R", "r", "q.x", "q.y", "q.z"), "3-sps-s": ("R", "r", "h")}
OF_LEG = {
    "leg_zero_offset": "a",
    "leg_scale": "k",
    "leg_thermal_expansion": ("alpha",),
    "leg_backlash": "b",
    "leg_compliance": "c",
    "base_joint_offset": "xyz",
    "platform_joint_offset": "xyz",
    "play": "b",
    "thermal_lag": ("alpha", "k", "tau"),
    "spring": "c",
}
E3 = np.array([0.0, 0.0, 1.0])


class Shape(NamedTuple):
    """Where the joint centres are, base (3, 3) and platform (3, 3), and the pivot, or None where there is a slide."""

    base: Array
    platform: Array
    pivot: Array | None


class Pose(NamedTuple):
    """Where the platform is: x -> origin + turn x; the first axis of its passive joint is y, this the second."""

    turn: Array  # (rows, 3, 3)
    origin: Array  # (rows, 3)
    second: Array | None  # (rows, 3), None of a ball


class OpenError(ValueError):
    """No pose closes the loop."""


# Attitudes; analytic, so that they take complex numbers


def about_y_then_x(alpha: Array, beta: Array) -> Array:
    """Give Oy(beta) Ox(alpha) as the paper on the Tricept has them: Ox is the transpose of what is usual."""
    o, i = np.zeros_like(alpha), np.ones_like(alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    ox = _matrix([[i, o, o], [o, c, s], [o, -s, c]])
    c, s = np.cos(beta), np.sin(beta)
    return _matrix([[c, o, s], [o, i, o], [-s, o, c]]) @ ox


def cayley(c: Array) -> Array:
    """Give the rotations by 2 atan|c| about c, (..., 3, 3): (1 - C)^-1 (1 + C) with C x = c cross x."""
    o = np.zeros_like(c[..., 0])
    x, y, z = np.moveaxis(c, -1, 0)
    cross = _matrix([[o, -z, y], [z, o, -x], [-y, x, o]])
    return np.linalg.solve(np.eye(3) - cross, np.eye(3) + cross)


def _matrix(rows: Sequence[Sequence[Array]]) -> Array:
    return np.stack([np.stack(row, -1) for row in rows], -2)


def newton(f: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    """Solve f(x) = 0 in each row, by Newton's steps, of at most 0.3, with derivatives by complex steps.

    Returns
    -------
    x : array, shape (rows, 3)
    left : array, shape (rows,)
        Length of the last step.
    """
    tiny, left = 1e-40, np.full(len(x), np.inf)
    for _ in range(60):
        jacobian = np.stack([f(x + 1j * tiny * e).imag / tiny for e in np.eye(3)], -1)
        step = (np.linalg.pinv(jacobian, rcond=1e-14) @ f(x)[..., None])[..., 0]  # some starts are singular
        left = np.linalg.norm(step, axis=-1)
        x = x - step * np.minimum(1, 0.3 / np.maximum(left, 1e-300))[:, None]
        if left.max() < 1e-13:
            break
    return x, left


# The machine


class Parallel(Simulated):
    """A machine file of a family with its errors, which are numbers or callables by key (see the top of this file).

    Parameters
    ----------
    machine : path or dict
        The machine file, or what tomllib reads from it.
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
        self.family = machine["family"]
        legs = [{"name": name, "type": "leg"} for name in LEGS[self.family]]
        centre = [{"name": "platform", "point": [0.0, 0.0, 0.0]}]
        super().__init__({"target": centre, **machine, "joint": legs}, effects)

    def _take(self, key: str, value: float | Callable[..., Any]) -> None:
        if callable(value):
            place, _, component = key.rpartition(".")
            if place in self.joint_names and component != "reading":
                raise KeyError(f"{key!r}: of a leg only the reading is told")
            return super()._take(key, value)
        match = _PARAMETER.fullmatch(key)
        place, effect, parameter = match.group("place", "effect", "parameter") if match else (None, "", "")
        if place in self.joint_names:
            known = parameter in OF_LEG.get(effect, ())
        elif key.startswith("geometry."):
            place, effect, parameter = None, "geometry", key.removeprefix("geometry.")
            known = parameter in NUMBERS[self.family]
        else:
            return super()._take(key, value)
        if not known:
            raise KeyError(f"{key!r} is no effect that this machine can have")
        self.numbers.setdefault((place, effect, None), {})[parameter] = float(value)
        return None

    # Geometry

    def number(self, name: str) -> float:
        """Give R, r, h, q.x, q.y or q.z, as it truly is."""
        drawn = self.file["geometry"]
        drawn = {**dict(zip(("q.x", "q.y", "q.z"), drawn.get("q", (0, 0, 0)), strict=True)), **drawn}
        return float(drawn[name] + self.numbers.get((None, "geometry", None), {}).get(name, 0.0))

    def shape(self, *, displaced: bool) -> Shape:
        """Give the joint centres, with or without what displaces single ones."""
        at = np.radians(AT[self.family])
        ring = np.stack([np.cos(at), np.sin(at), 0 * at], -1)
        base, platform = self.number("R") * ring, self.number("r") * ring
        for k, leg in enumerate(self.joint_names if displaced else []):
            base[k] += self._sum(leg, {"base_joint_offset"}, "xyz")
            platform[k] += self._sum(leg, {"platform_joint_offset"}, "xyz")
        return Shape(base, platform, None if self.family == "tricept" else self.number("h") * E3)

    def lengths(self, pose: Pose, shape: Shape) -> Array:
        """Give the distances between joint centres, (rows, 3)."""
        return np.linalg.norm(self._vectors(pose, shape), axis=-1)

    @staticmethod
    def _vectors(pose: Pose, shape: Shape) -> Array:
        joints = pose.origin[:, None] + np.einsum("nij,kj->nki", pose.turn, shape.platform)
        return np.asarray(joints - shape.base)

    def pose(self, coordinates: ArrayLike) -> Pose:
        """Give a pose by (alpha, beta, z), of a 3-SPS-S by rotation vectors; (rows, 3), angles in radians."""
        x = np.asarray(coordinates, dtype=float)
        if self.family == "tricept":
            return self._slid(x[:, 0], x[:, 1], x[:, 2])
        turn = rotation(x)
        return Pose(turn, np.broadcast_to(self.number("h") * E3, x.shape), None)

    @staticmethod
    def _slid(alpha: Array, beta: Array, z: Array) -> Pose:
        turn = about_y_then_x(alpha, beta)
        second = about_y_then_x(0 * beta, beta)[..., 0]
        return Pose(turn, z[:, None] * turn[..., 2], second)

    def legs(self, coordinates: ArrayLike) -> Array:
        """Give the lengths that the drawn machine has in poses as `pose` takes them."""
        drawn = Parallel(self.file)
        return drawn.lengths(drawn.pose(coordinates), drawn.shape(displaced=False))

    def closed(self, length: Array, shape: Shape, start: ArrayLike | None = None) -> Pose:
        """Find the pose in which the legs are so long: the loop is closed.

        Parameters
        ----------
        length : array, shape (rows, 3)
        shape : Shape
        start : array_like, optional, shape (rows, 3) or (3,)
            Rotation vectors from which the platform of a 3-SPS-S is brought there, in radians; `start` of the file when
            left out.

        Raises
        ------
        OpenError
            When there is none, or it lies where a Tricept does not go: alpha, beta within 90 degrees, z positive.
        """
        if start is None:
            start = np.asarray(self.file["geometry"].get("start", (0, 0, 0)), dtype=float) * self.radian
        pose, ok = self._solved(length, shape, rotation(start))
        if not ok.all():
            raise OpenError(f"no pose closes the loop in rows {np.flatnonzero(~ok).tolist()}")
        return pose

    def _solved(self, length: Array, shape: Shape, start: Array) -> tuple[Pose, Any]:
        """Give what Newton's steps come to, and where that is a pose."""
        unit_ = self.number("R")
        rows = len(length)

        def gap(turn: Array, origin: Array) -> Array:
            d = origin[:, None] + np.einsum("nij,kj->nki", turn, shape.platform) - shape.base
            return ((d * d).sum(-1) - length**2) / (2 * unit_**2)

        if self.family == "tricept":

            def f(x: Array) -> Array:
                turn = about_y_then_x(x[:, 0], x[:, 1])
                return gap(turn, unit_ * x[:, 2:] * turn[..., 2])

            height = np.sqrt(
                np.maximum((length**2).mean(-1) - (unit_ - self.number("r")) ** 2, unit_**2 / 100)
            )
            x, left = newton(f, np.stack([0 * height, 0 * height, height / unit_], -1))
            ok = (left < 1e-12) & (np.cos(x[:, :2]).min(-1) > 0) & (x[:, 2] > 0)
            return self._slid(x[:, 0], x[:, 1], unit_ * x[:, 2]), ok
        before = np.broadcast_to(start, (rows, 3, 3))
        origin = np.broadcast_to(shape.pivot, (rows, 3))
        c, left = newton(lambda c: gap(cayley(c) @ before, origin), np.zeros((rows, 3)))
        ok = left < 1e-10  # a singular pose is found less well
        return Pose(
            np.where(ok[:, None, None], cayley(np.where(ok[:, None], c, 0)), np.nan) @ before, origin, None
        ), ok

    # Forces

    def tensions(self, pose: Pose, shape: Shape, target: Array, gravity: Array | None = None) -> Array:
        """Give the legs' tensions (rows, 3) that hold a unit force along gravity at targets (rows, 3) of the machine.

        The six equations of a rigid body: the platform with what slides, pulled by three legs, held by the passive
        joint. The universal joint of a Tricept, at the origin, transmits any force and the moment across both of its
        axes; the slide no force along itself. The ball of a 3-SPS-S transmits any force.
        """
        g = self.gravity if gravity is None else gravity
        rows = len(target)
        joints = shape.base + self._vectors(pose, shape)
        pull = unit(shape.base - joints)  # a leg in tension pulls its platform joint to the base
        forces = list(np.moveaxis(pull, 1, 0))
        moments = list(np.moveaxis(np.cross(joints, pull), 1, 0))
        none = np.zeros((rows, 3))
        if pose.second is not None:
            slide = pose.turn[..., 2]
            across = np.cross(slide, pose.second)
            forces += [pose.second - along((pose.second * slide).sum(-1), slide), unit(across), none]
            moments += [none, none, np.cross([0, 1, 0], pose.second)]
        else:
            forces += [np.broadcast_to(e, (rows, 3)) for e in np.eye(3)]
            moments += [np.cross(pose.origin, e) for e in np.eye(3)]
        size = np.linalg.norm(joints, axis=-1).mean()  # so that moments and forces are alike
        system = np.concatenate([np.stack(forces, -1), np.stack(moments, -1) / size], 1)
        load = np.concatenate([np.broadcast_to(g, (rows, 3)), np.cross(target, g) / size], 1)
        return np.linalg.solve(system, -load[..., None])[:, :3, 0]

    # Readings

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
        start: ArrayLike | None = None,
    ) -> Array:
        """Give what an instrument without noise reads; as `Simulated.measure`, and `start` as `closed` takes it."""
        q = np.asarray(q, dtype=float)
        rows = len(q)
        s = approach(q) if s is None else np.asarray(s, dtype=float)
        warm = {name: np.asarray(x, dtype=float) - self.reference for name, x in (temperature or {}).items()}
        names = (
            [target or self.target_names[0]] * rows if target is None or isinstance(target, str) else target
        )
        columns: dict[str, Any] = {
            **{name: np.asarray(x, dtype=float) for name, x in (covariates or {}).items()},
            **{name: q[:, k] for k, name in enumerate(self.joint_names)},
            "t": None if t is None else np.asarray(t, dtype=float),
            "F": None if load is None else np.asarray(load, dtype=float),
        }
        directions = self.kind == "direction"
        labels = [None] * rows if run is None else [str(label) for label in run]
        seen = self._of_rows(self._targets, names, labels)
        if self.family == "tricept" and not directions:
            seen = seen + [self.number(x) for x in ("q.x", "q.y", "q.z")]

        length = np.array(q)
        for k, leg in enumerate(self.joint_names):
            of_formula = {
                **columns,
                "q": q[:, k],
                "s": s[:, k],
                "v": np.zeros(rows) if v is None else np.asarray(v, dtype=float)[:, k],
                "T": warm.get(leg),
            }
            length[:, k] += self._of_leg(leg, of_formula)
            length[:, k] += self._formula(leg, "reading", of_formula, rows)
        shape = self.shape(displaced=True)
        length = length + self._compliance("leg_compliance", length, shape, columns, seen, start)
        stretched = length
        for _ in range(20):
            before, stretched = (
                stretched,
                length + self._compliance("spring", stretched, shape, columns, seen, start),
            )
            if np.abs(stretched - before).max() <= 1e-14 * np.abs(length).max():
                break
        pose = self.closed(stretched, shape, start)

        moves = np.stack(
            [self._of_targets(names, ("r" if directions else "t") + x, columns) for x in "xyz"], -1
        )
        if directions:
            y = np.einsum("nij,nj->ni", pose.turn @ rotation(moves * self.radian), seen)
        else:
            y = pose.origin + np.einsum("nij,nj->ni", pose.turn, seen + moves)
        return self._read(y, columns, run)

    def write_csv(
        self,
        path: str | Path,
        q: ArrayLike,
        reading: Array,
        *,
        start: ArrayLike | None = None,
        **columns: Any,
    ) -> None:
        """Write a measurement file, as `Simulated.write_csv`; `start` is not recorded."""
        super().write_csv(path, q, reading, **columns)

    def _of_leg(self, leg: str, columns: Mapping[str, Any]) -> Array:
        """Give by how much a leg is longer than commanded, but for what it bears."""
        p = {effect: self.numbers.get((leg, effect, None), {}) for effect in OF_LEG}
        q, s = columns["q"], columns["s"]

        def warm() -> Array:
            if columns["T"] is None:
                raise ValueError(f"an effect needs T_{leg}, and it was not given")
            return np.asarray(columns["T"])

        longer = p["leg_zero_offset"].get("a", 0.0) + p["leg_scale"].get("k", 0.0) * q
        longer = longer - p["leg_backlash"].get("b", 0.0) / 2 * s
        if p["leg_thermal_expansion"]:
            longer = longer + p["leg_thermal_expansion"]["alpha"] * warm() * q
        if p["thermal_lag"]:
            lag = p["thermal_lag"]
            behind = lagged(columns["t"], warm(), lag["tau"])
            longer = longer + (lag.get("k", 0.0) + lag.get("alpha", 0.0) * q) * behind
        if p["play"]:
            moves = np.flatnonzero(s)
            longer = longer + play(q, p["play"]["b"], s[moves[0]] if len(moves) else 0.0) - q
        return np.asarray(longer)

    def _compliance(
        self,
        effect: str,
        length: Array,
        shape: Shape,
        columns: Mapping[str, Any],
        seen: Array,
        start: ArrayLike | None,
    ) -> Array:
        """Give by how much the legs are stretched by what hangs at the targets seen, (rows, 3)."""
        soft = np.array([self.numbers.get((leg, effect, None), {}).get("c", 0.0) for leg in self.joint_names])
        if not soft.any():
            return np.zeros_like(length)
        if columns["F"] is None:
            raise ValueError(f"{effect} needs F, and it was not given")
        pose = self.closed(length, shape, start)
        at = pose.origin + np.einsum("nij,nj->ni", pose.turn, seen)
        return soft * columns["F"][:, None] * self.tensions(pose, shape, at)

    def modes(self, length: ArrayLike, random: np.random.Generator, starts: int = 300) -> Array:
        """Find the assembly modes (modes, 3, 3) of a 3-SPS-S for one row of lengths, from starts everywhere."""
        quaternion = unit(random.normal(size=(starts, 4)))
        sine = np.linalg.norm(quaternion[:, 1:], axis=-1)
        first = along(2 * np.arctan2(sine, quaternion[:, 0]), unit(quaternion[:, 1:]))
        lengths = np.broadcast_to(np.asarray(length, dtype=float), (starts, 3))
        pose, ok = self._solved(lengths, self.shape(displaced=True), rotation(first))
        found: list[Array] = []
        for turn in pose.turn[ok]:
            if all(np.abs(turn - other).max() > 1e-6 for other in found):
                found.append(turn)
        return np.array(found)
