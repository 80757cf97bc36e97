"""The geometry of a fitted machine as a Denavit-Hartenberg table, which `rodgen import` reads again.

Rows are not unique: the normal of two axes may point either way, and where axes are parallel it may be anywhere. Here
rows of the nominal machine are those with the least theta, and of the fitted one those nearest to them. The x axis
after the last row may point anywhere: its theta is 0 on the nominal machine. The common normal of axes that are nearly
parallel runs away along them, so that such a link has its normal where the nominal one is, and a fifth parameter: beta,
a turn about y after alpha (S. Hayati, Robot arm geometric link parameter estimation, CDC 1983).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.machines.emit._geometry import Geometry, of_couplings
from rodgen.machines.emit._numbers import K, said_of_uncertainties, standard, uncertain_number
from rodgen.machines.files.schema import toml_string
from rodgen.machines.imports.denavit_hartenberg import CONVENTIONS
from rodgen.machines.rigid import rotation_matrix

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

PARALLEL = math.sin(math.radians(1.0))
"""Largest sine between axes that count as nearly parallel: their common normal is badly determined, by 60 times."""
_SAME = 1e-9
"""Part of the machine's size, or sine, that is rounding."""


@dataclass(frozen=True)
class _Rows:
    """Where each joint is on its axis, the links between joints, and the frames before the first and after the last."""

    theta: Array
    d: Array
    a: Array
    alpha: Array
    beta: Array
    parallel: tuple[bool, ...]
    base: Array
    end: Array


def table_texts(geometries: Sequence[Geometry], name: str, note: str) -> dict[str, str]:
    """Return a TOML file for each convention, by its name, of the first of the geometries of varied machines."""
    texts = {}
    for convention in CONVENTIONS:
        nominal = _rows(geometries[0].nominal, convention)
        fitted = _rows(geometries[0].machine, convention, nominal)
        rows = [fitted, *(_rows(each.machine, convention, fitted, held=True) for each in geometries[1:])]
        texts[f"{name}_{convention}_dh.toml"] = _text(geometries, rows, convention, note)
    return texts


def _rows(machine: Machine, convention: str, near: _Rows | None = None, *, held: bool = False) -> _Rows:
    """Return the rows of a rigid chain that are nearest to others.

    Without others, the normal of parallel axes is where an imported table of this convention has it: a joint's point
    is where the row begins, of a modified table where it ends. With `held` links count as nearly parallel, and as
    without a length, where the others are.
    """
    axes = [np.array(joint.axis, float) / np.linalg.norm(joint.axis) for joint in machine.joints]
    n = len(axes)
    points = [*(joint.point for joint in machine.joints), *(target.point for target in machine.targets)]
    size = float(np.linalg.norm(points, axis=1).max()) or 1.0
    theta, d = (np.zeros((2, n))) if near is None else (near.theta.copy(), near.d.copy())
    a, alpha, beta = np.zeros((3, n - 1))
    parallel = []
    base = np.eye(4) if near is None else near.base.copy()
    base[:3, :3] = _least_turn(base[:3, 2], axes[0]) @ base[:3, :3]
    if machine.joints[0].revolute:
        base[:3, 3] = _foot(np.array(machine.joints[0].point, float), axes[0], base[:3, 3])
    frame = base.copy()
    for j, joint in enumerate(machine.joints[1:]):
        origin, x, z, after = frame[:3, 3], frame[:3, 0], axes[j], axes[j + 1]
        across = np.cross(z, after)
        sine = float(np.linalg.norm(across))
        parallel.append(near.parallel[j] if near is not None and held else sine < PARALLEL)
        at = origin + d[j] * z
        nominal = math.cos(theta[j]) * x + math.sin(theta[j]) * np.cross(z, x)
        point = np.array(joint.point, float) if joint.revolute else at
        if parallel[j]:
            if near is None and joint.revolute and machine.joints[j].revolute:
                at = _foot(at, z, point if convention == "standard" else np.array(machine.joints[j].point))
            to = point + after * float((at - point) @ z) / float(after @ z)
            a[j] = np.linalg.norm(to - at)
            none = near.a[j] == 0 if near is not None and held else a[j] < _SAME * size
            normal = nominal if none else (to - at) / a[j]
        else:
            normal = across / sine
            across = across / sine**2
            at = origin + z * float(np.cross(point - origin, after) @ across)
            to = point + after * float(np.cross(point - origin, z) @ across)
        a[j] = (to - at) @ normal
        a[j] = 0.0 if abs(a[j]) < _SAME * size else a[j]
        turn = math.atan2(float(np.cross(nominal, normal) @ z), float(nominal @ normal))
        # a half turn of the normal is another row of the same link: the lesser turn, of two alike a positive length
        if abs(turn) > math.pi / 2 + (-_SAME if near is None and a[j] < 0 else _SAME):
            normal, a[j], turn = -normal, -a[j], turn - math.copysign(math.pi, turn)
        theta[j] += turn
        d[j] = (at - origin) @ z
        turned = np.stack([normal, np.cross(z, normal), z], axis=1)
        e, f, g = after @ turned
        around = 0.0 if near is None else near.alpha[j]
        alpha[j] = around + math.remainder(math.atan2(0.0 - f, g) - around, 2 * math.pi)
        beta[j] = math.asin(min(max(e, -1.0), 1.0)) if parallel[j] else 0.0
        frame = np.eye(4)
        frame[:3, :3] = turned @ rotation_matrix([alpha[j], 0, 0]) @ rotation_matrix([0, beta[j], 0])
        frame[:3, 3] = to
    if near is None and machine.joints[-1].revolute and machine.measurand.moving:
        d[-1] = (np.array(machine.targets[0].point, float) - frame[:3, 3]) @ axes[-1]
    frame = frame @ np.block(
        [[rotation_matrix([0, 0, theta[-1]]), np.array([[0], [0], [d[-1]]])], [np.eye(4)[3:]]]
    )
    return _Rows(theta, d, a, alpha, beta, tuple(parallel), base, frame)


def _least_turn(before: Array, after: Array) -> Array:
    """Return the least rotation that turns a unit vector into another; about x where it is half a turn."""
    across = np.cross(before, after)
    sine, cosine = float(np.linalg.norm(across)), float(before @ after)
    if sine < _SAME:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_matrix(across / sine * math.atan2(sine, cosine))


def _foot(point: Array, axis: Array, of: Array) -> Array:
    return np.asarray(point + axis * float((of - point) @ axis))


def _text(geometries: Sequence[Geometry], rows: Sequence[_Rows], convention: str, note: str) -> str:
    geometry, table = geometries[0], rows[0]
    machine = geometry.machine
    # a link is in the row of the joint before it, or after it
    at, outer = (slice(0, -1), -1) if convention == "standard" else (slice(1, None), 0)
    columns = {}
    for key, angular in (("theta", True), ("d", False), ("a", False), ("alpha", True), ("beta", True)):
        each = [np.degrees(getattr(row, key)) if angular else getattr(row, key) for row in rows]
        if key not in ("theta", "d"):
            each = [np.insert(values, outer % (len(values) + 1), 0.0) for values in each]
        columns[key] = each[0], K * standard(each, 360.0 if angular else math.inf)
    fifth = [False] * len(machine.joints)
    fifth[at] = np.any([row.beta != 0 for row in rows], axis=0).tolist()
    order = CONVENTIONS[convention].replace("Rx(alpha)", "Rx(alpha) Ry(beta)" if any(fifth) else "Rx(alpha)")
    coupled = of_couplings(machine, [joint.name for joint in machine.joints if joint.coordinate])
    lines = [f"# {note}", *(f"# not in it: {what}" for what in (*geometry.left_out, *coupled))]
    lines += [f"# {line}" for line in said_of_uncertainties(geometries)]
    choices = ["theta"] * geometry.turns + ["d"] * geometry.slides
    if any(columns[key][1][0] > 0 for key in choices):
        lines.append(
            "# * A choice of coordinates is in this U: the frame is free, and so is the base along its axis."
        )
    lines += [
        f"# A row is {order}; the coordinate of a joint is added to its theta, or to its d where it slides.",
        "# Of equal tables this is the one with the least theta. That of the last row is 0 on the nominal machine,",
        "# which does not say how the frame after it stands: with another theta there, tool is turned back by as much.",
        *(
            ["# beta: of axes that are nearly parallel (Hayati), at which d is that of the nominal machine"]
            * any(fifth)
        ),
        f"# The frame before the first row, in machine axes ({machine.length_unit}), a row each of its matrix:",
        *(f"#   {' '.join(map(_number, row))}" for row in table.base),
        f"name = {toml_string(machine.name)}",
        f'convention = "{convention}"',
        f'units = {{ length = {toml_string(machine.length_unit)}, angle = "deg" }}',
    ]
    place = float(machine.measurand.moving)  # a direction is turned, and not displaced
    tools = [(np.linalg.inv(table.end) @ [*target.point, place])[:3] for target in machine.targets]
    for target, tool in zip(machine.targets[1:], tools[1:], strict=True):
        lines.append(f"# {target.name} in the frame after the last row: {_listed(tool)}")
    lines.append(f"tool = {_listed(tools[0])}  # {machine.targets[0].name}, in the frame after the last row")
    for j, joint in enumerate(machine.joints):
        kind = "R" if joint.revolute else "P"
        lines += ["", "[[joint]]", f"name = {toml_string(joint.name)}", f'type = "{kind}"']
        for key, (values, u) in columns.items():
            if key != "beta" or fifth[j]:
                uncertainty = uncertain_number(float(values[j]), float(u[j]), machine.length_unit)[1]
                star = "*" * (j == 0 and key in choices)
                lines.append(
                    f"{key} = {_number(values[j])}" + f"  # U = {uncertainty}{star}" * bool(uncertainty)
                )
        if joint.travel:
            scale = math.degrees(1.0) if joint.revolute else 1.0
            lines.append(f"travel = {_listed([x * scale for x in joint.travel])}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


def _listed(values: object) -> str:
    return f"[{', '.join(_number(x) for x in values)}]"  # type: ignore[attr-defined]
