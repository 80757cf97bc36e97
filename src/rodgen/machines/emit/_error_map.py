"""The error of a machine, and the correction of its commands, on a grid over its travels, by the emitted NumPy code.

The grid is refined until linear interpolation between its points is good to a part of the largest error, which the page
with the tables states with the error that remains.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError, joined
from rodgen.machines.emit._content import content_of, ideal_of, title_of
from rodgen.machines.emit._kernels import numbers_of
from rodgen.machines.emit._numbers import (
    ROUNDING,
    Covariance,
    K,
    csv_text,
    number,
    said_of_uncertainties,
    standard,
    varied,
)
from rodgen.machines.emit._render import render
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.measured import POINT
from rodgen.machines.model import Model

if TYPE_CHECKING:
    from rodgen.machines.emit._content import Content
    from rodgen.machines.machine import Joint, Machine


GOOD = 0.02
"""Part of the largest error that interpolation may be off."""
MOST_ROWS = 40_000
MOST_JOINTS = 3
SMALL_PART = 0.05
"""Of an error: so much remains where interpolation alone is not exact."""


def map_texts(
    machine: Machine, name: str, note: str, travel: Any, covariance: Covariance | None
) -> dict[str, str]:
    """Return a table for each target, and a page that says what they are and how good interpolation is.

    Raises
    ------
    InputFileError
        When directions are measured, or not one to three joints have a travel, of more three slides; where none has,
        that of the data counts.
    """
    if machine.measurand.is_pose:  # a map is of places
        places = replace(machine.measured, kind=POINT.kind, attitude_noise=None, correlation=None)
        machine = replace(machine, measured=places)
    if travel is not None and not any(machine.limits):
        ranges = [(float(low), float(high)) if low < high else None for low, high in travel]
        joints = tuple(_within(joint, own) for joint, own in zip(machine.joints, ranges, strict=True))
        machine = replace(machine, joints=joints)
    content = content_of(machine, name, travel)
    file = machine.file or machine.name
    if not content.scope.machine.measurand.moving:
        raise InputFileError(
            file, "[measured], kind", machine.measurand.words, "points or distances, which have a place"
        )
    joints = content.machine.joints
    moved = [j for j, own in enumerate(content.machine.limits) if own]
    if len(moved) > MOST_JOINTS and len(carts := [j for j in moved if not joints[j].revolute]) == MOST_JOINTS:
        moved = carts
    if not 0 < len(moved) <= MOST_JOINTS:
        found = f"a travel of {len(moved)} joints"
        expected = f"one of 1 to {MOST_JOINTS} joints, over which the grid is; c, numpy and linuxcnc correct any number"
        raise InputFileError(file, "joint, travel", found, expected)
    code = _Code(content, varied(machine, covariance), travel)
    with_three = [j for j, joint in enumerate(joints) if not joint.revolute and joint.is_read]
    axes_of_slides = np.array([joints[j].axis for j in with_three]).reshape(-1, 3)
    correcting = with_three if np.linalg.matrix_rank(axes_of_slides) == 3 else moved
    unit = content.machine.length_unit
    files: dict[str, str] = {}
    still = [joint.name for j, joint in enumerate(joints) if j not in moved]
    names = joined([joints[j].name for j in correcting])
    page = [f"# {title_of(machine)}: error map", "", note, ""]
    page += [
        f"Errors are real less nominal places, in machine axes ({unit}). `correct_X` is added to the command of X: the",
        f"corrections of {names} bring the place as near the nominal one as these can. Between the points both are",
        "interpolated linearly.",
        *([f"At zero: {joined(still)}; elsewhere the errors are others."] if still else []),
        *content.at_rest,
        *said_of_uncertainties(code.machines),
        "",
    ]
    for k, target in enumerate(content.machine.targets):
        axes, grid, errors, off = _refined(code, moved, k)
        change = code.corrections(grid, k, correcting)
        middle = _grid(len(joints), moved, [(axis[1:] + axis[:-1]) / 2 for axis in axes])
        left = np.vstack(
            [code.errors(grid, k, change), code.errors(middle, k, _mean_of_corners(change, axes))]
        )
        columns: dict[str, Array] = {}
        for label, values, of in (("{} [{}]", grid, moved), ("correct_{} [{}]", change, correcting)):
            for j in of:
                its = "deg" if joints[j].revolute else unit
                size = parse_unit(its).factor(content.machine.length_unit)
                columns[label.format(joints[j].name, its)] = values[:, j] / size
        of_errors = [f"d{x} [{unit}]" for x in "xyz"]
        u = K * code.standard_uncertainties(grid, k)
        columns |= dict(zip(of_errors, errors.T, strict=True))
        files[f"{name}_map_{target.name}.csv"] = csv_text(columns, dict(zip(of_errors, u.T, strict=True)))
        count = " x ".join(str(len(axis)) for axis in axes)
        page += [
            f"- `{name}_map_{target.name}.csv`: {count} points.",
            f"  Interpolation is off by at most {_two(off, unit)} {unit}, in the middle of a cell.",
            f"  {_of_errors(errors, left, unit, names)}",
            *([f"  U of an error is at most {u.max():.2g} {unit}."] if u.any() else []),
        ]
    return files | {f"{name}_map.md": "\n".join(page) + "\n"}


def _of_errors(errors: Array, left: Array, unit: str, names: str) -> str:
    """Say what of the errors corrections leave, measured on the grid and between its points."""
    before, after = (float(np.linalg.norm(x, axis=1).max()) for x in (errors, left))
    if not after > SMALL_PART * before:
        return f"Of errors up to {before:.3g} {unit}, {_two(after, unit)} remain after correction."
    parts = ", ".join(f"{np.abs(left[:, i]).max():.2g} in {x}" for i, x in enumerate("xyz"))
    rms = [np.sqrt(np.mean(np.sum(x**2, axis=1))) for x in (errors, left)]
    return (
        f"Of errors up to {before:.3g} {unit} (rms {rms[0]:.2g}), {after:.2g} (rms {rms[1]:.2g}) remain after\n"
        f"  correction, {parts}: in directions in which {names} cannot move the target."
    )


def _within(joint: Joint, travel: tuple[float, float] | None) -> Joint:
    """Return a joint whose reading is within a travel, if it has one."""
    if joint.coordinate is None:
        return replace(joint, travel=travel)
    return replace(joint, reading_travel=travel) if joint.is_read else joint


def _two(value: float, unit: str) -> str:
    """Return a number with two digits, or 0 below what controls resolve."""
    return number(float(f"{value:.2g}"), unit)


@dataclass
class _Code:
    """The emitted NumPy code, run for the machine and for what it may be by the uncertainties of a fit."""

    content: Content
    machines: list[Machine]
    travel: Any

    def __post_init__(self) -> None:
        self.run: dict[str, Any] = {}
        exec(render(self.content, "numpy")[f"{self.content.name}.py"], self.run)
        # a command at an end is corrected as the others
        self.run["LOWEST"][:], self.run["HIGHEST"][:] = -np.inf, np.inf
        # nothing moves, nothing loads, nothing is warm
        fields = self.content.fields
        self.conditions = {f.name: np.zeros(f.length) if f.length else 0.0 for f in fields}

    def errors(self, q: Array, target: int, change: Array | float = 0.0) -> Array:
        """Return real less nominal places (n, 3) at commands, of which the real ones are changed."""
        real = self.run["forward"](q + change, **self.conditions, target=target)
        return np.asarray(real - self.run["ideal"](q, target=target))[:, :3]

    def corrections(self, q: Array, target: int, joints: list[int]) -> Array:
        """Return what corrects commands, (n, joints), by some of the joints."""
        weight = np.where(np.isin(range(q.shape[1]), joints), self.run["WEIGHT"], 0.0)
        wanted = self.run["ideal"](q, target=target)
        found, _, _ = self.run["compensate"](wanted, q, **self.conditions, target=target, weight=weight)
        return np.asarray(found - q)

    def standard_uncertainties(self, q: Array, target: int) -> Array:
        """Return those of the errors, (n, 3); 0 where there are none."""
        found = []
        for machine in self.machines:
            self._become(machine)
            found.append(self.errors(q, target))
        self._become(self.machines[0])
        u = standard(found)
        return np.where(u > ROUNDING * self.content.size, u, 0.0)

    def _become(self, machine: Machine) -> None:
        scope = scope_of(machine, self.travel)
        for model, prefix, seen in (
            (scope.model, "", "SEEN"),
            (Model(ideal_of(scope)), "ideal_", "IDEAL_SEEN"),
        ):
            constants, of_targets = numbers_of(model, prefix)
            self.run.update({name: x for name, x in constants.items() if name in self.run})
            self.run[seen] = of_targets


def _refined(code: _Code, moved: list[int], target: int) -> tuple[list[Array], Array, Array, float]:
    """Return the axes of a grid, its points (n, joints), the errors there, and what interpolation is off."""

    def error(axes: list[Array]) -> tuple[Array, Array]:
        grid = _grid(len(joints), moved, axes)
        return grid, code.errors(grid, target)

    joints = code.content.machine.joints
    travels = [code.content.machine.limits[j] or (0.0, 0.0) for j in moved]
    counts = [3] * len(moved)
    while True:
        axes = [np.linspace(*ends, count) for ends, count in zip(travels, counts, strict=True)]
        grid, errors = error(axes)
        largest = float(np.linalg.norm(errors, axis=1).max(initial=0.0))
        shape = [*map(len, axes), 3]
        offs = []
        cells = errors.reshape(shape)
        for k in range(len(moved)):  # in the middle of the edges along each axis: where a finer step helps
            ends = [np.take(cells, range(a, len(axes[k]) - 1 + a), axis=k) for a in (0, 1)]
            halved = [(x[1:] + x[:-1]) / 2 if i == k else x for i, x in enumerate(axes)]
            between = error(halved)[1].reshape(ends[0].shape)
            offs.append(float(np.linalg.norm((ends[0] + ends[1]) / 2 - between, axis=-1).max()))
        finer = [
            2 * n - 1 if off > GOOD / len(moved) * largest else n for n, off in zip(counts, offs, strict=True)
        ]
        if finer == counts or math.prod(finer) > MOST_ROWS:
            break
        counts = finer
    middle = error([(axis[1:] + axis[:-1]) / 2 for axis in axes])[1]
    off = float(np.linalg.norm(_mean_of_corners(errors, axes) - middle, axis=1).max())
    return axes, grid, errors, max(off, *offs)


def _grid(joints: int, moved: list[int], axes: list[Array]) -> Array:
    """Return the points (n, joints) of a grid."""
    grid = np.zeros((math.prod(map(len, axes)), joints))
    for j, values in zip(moved, np.meshgrid(*axes, indexing="ij"), strict=True):
        grid[:, j] = values.ravel()
    return grid


def _mean_of_corners(values: Array, axes: list[Array]) -> Array:
    """Return what linear interpolation of values (n, k) on a grid gives in the middle of its cells."""
    cells = values.reshape(*map(len, axes), -1)
    sides = itertools.product((0, 1), repeat=len(axes))
    corners = [
        cells[tuple(slice(a, len(axis) - 1 + a) for a, axis in zip(side, axes, strict=True))]
        for side in sides
    ]
    return np.asarray(sum(corners) / len(corners)).reshape(-1, cells.shape[-1])
