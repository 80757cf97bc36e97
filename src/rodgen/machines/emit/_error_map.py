"""The error of a machine, and the correction of its commands, on a grid over its travels, by the emitted NumPy code.

The grid is refined until linear interpolation between its points is good to a part of the largest error, which the page
with the tables states with the error that remains.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError, joined
from rodgen.machines.emit._content import content_of
from rodgen.machines.emit._render import render
from rodgen.machines.measured import POINT

if TYPE_CHECKING:
    from rodgen.machines.emit._content import Content
    from rodgen.machines.machine import Machine

__all__ = ["map_texts"]

Array = NDArray[np.float64]

GOOD = 0.02
"""Part of the largest error that interpolation may be off."""
MOST_ROWS = 40_000
MOST_JOINTS = 3


def map_texts(machine: Machine, name: str, note: str, travel: Any) -> dict[str, str]:
    """Return a table for each target, and a page that says what they are and how good interpolation is.

    Raises
    ------
    InputFileError
        When directions are measured, or not one to three joints have a travel; where none has, that of the data counts.
    """
    if machine.measurand.is_pose:  # a map is of places
        places = replace(machine.measured, kind=POINT.kind, attitude_noise=None, correlation=None)
        machine = replace(machine, measured=places)
    if travel is not None and not any(joint.travel for joint in machine.joints):
        ranges = [(float(low), float(high)) if low < high else None for low, high in travel]
        joints = tuple(replace(joint, travel=own) for joint, own in zip(machine.joints, ranges, strict=True))
        machine = replace(machine, joints=joints)
    content = content_of(machine, name, travel)
    file = machine.file or machine.name
    if content.directions:
        raise InputFileError(
            file, "[measured], kind", "directions", "points or distances, which have a place"
        )
    joints = content.machine.joints
    moved = [j for j, joint in enumerate(joints) if joint.travel]
    if not 0 < len(moved) <= MOST_JOINTS:
        found = f"a travel of {len(moved)} joints"
        raise InputFileError(
            file, "joint, travel", found, f"one of 1 to {MOST_JOINTS} joints, over which the grid is"
        )
    code: dict[str, Any] = {}
    exec(render(content, "numpy")[f"{name}.py"], code)
    code["LOWEST"][:], code["HIGHEST"][:] = -np.inf, np.inf  # a command at an end is corrected as the others
    weight = np.where(np.isin(range(len(joints)), moved), code["WEIGHT"], 0.0)
    unit = content.machine.length_unit
    files: dict[str, str] = {}
    page = [f"# {machine.name}: error map", "", note, ""]
    rest = (
        joined([joint.name for j, joint in enumerate(joints) if j not in moved])
        if len(moved) < len(joints)
        else ""
    )
    page += [
        f"Errors are real less nominal places, in machine axes ({unit}). `correct_X` is added to the command of X to",
        "come as near the nominal place as the machine can, nan where that is not found. Between the points both are",
        "interpolated linearly.",
        *([f"At zero: {rest}."] if rest else []),
        *content.at_rest,
        "",
    ]
    for k, target in enumerate(content.machine.targets):
        axes, grid, errors, off = _refined(content, code, moved, k)
        largest = float(np.linalg.norm(errors, axis=1).max())
        wanted = code["ideal"](grid, target=k)
        corrected, status, _ = code["compensate"](
            wanted, grid, **_conditions(content), target=k, weight=weight
        )
        reached = np.isin(status, (code["CONVERGED"], code["NEAREST"]))[:, None]
        change = np.where(reached, np.asarray(corrected) - grid, np.nan)
        middle = _grid(content, moved, [(axis[1:] + axis[:-1]) / 2 for axis in axes])
        between = middle + _mean_of_corners(change, axes)
        left = code["forward"](between, **_conditions(content), target=k) - code["ideal"](middle, target=k)
        left = left[:, :3]
        columns: dict[str, Array] = {}
        for label, values in (("{} [{}]", grid), ("correct_{} [{}]", change)):
            for j in moved:
                factor = parse_unit("deg").factor() if joints[j].revolute else 1.0
                columns[label.format(joints[j].name, "deg" if joints[j].revolute else unit)] = (
                    values[:, j] / factor
                )
        columns |= {f"d{x} [{unit}]": errors[:, i] for i, x in enumerate("xyz")}
        files[f"{name}_map_{target.name}.csv"] = _csv(columns, largest)
        count = " x ".join(str(len(axis)) for axis in axes)
        page.append(
            f"- `{name}_map_{target.name}.csv`: {count} points; largest error {largest:.3g} {unit}; interpolation is "
            f"off by at most {off:.2g} {unit} ({off / largest if largest else 0.0:.1%}), in the middle of a cell. "
            f"Commands corrected there leave at most {np.linalg.norm(left, axis=1).max():.2g} {unit}."
        )
    return files | {f"{name}_map.md": "\n".join(page) + "\n"}


def _conditions(content: Content) -> dict[str, Any]:
    """Return what the functions take in addition to coordinates: nothing moves, nothing loads, nothing is warm."""
    return {field.name: np.zeros(field.length) if field.length else 0.0 for field in content.fields}


def _refined(
    content: Content, code: dict[str, Any], moved: list[int], target: int
) -> tuple[list[Array], Array, Array, float]:
    """Return the axes of a grid, its points (n, joints), the errors there, and what interpolation is off."""

    def error(axes: list[Array]) -> tuple[Array, Array]:
        grid = _grid(content, moved, axes)
        place = code["forward"](grid, **_conditions(content), target=target)
        return grid, np.asarray(place - code["ideal"](grid, target=target))[:, :3]

    travels = [content.machine.joints[j].travel or (0.0, 0.0) for j in moved]
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


def _grid(content: Content, moved: list[int], axes: list[Array]) -> Array:
    """Return the points (n, joints) of a grid."""
    grid = np.zeros((math.prod(map(len, axes)), len(content.machine.joints)))
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


def _csv(columns: dict[str, Array], largest: float) -> str:
    """Return a table whose numbers have four digits below the largest error, coordinates nine."""
    digits = min(max(4 - math.floor(math.log10(largest)), 0), 15) if largest > 0 else 9
    columns = {n: x.round(digits) if n[0] in "dc" else x.round(9) for n, x in columns.items()}
    rows = zip(*columns.values(), strict=True)
    lines = (",".join(repr(float(x) + 0.0) for x in row) for row in rows)
    return "\n".join([",".join(columns), *lines]) + "\n"
