"""How far the numbers of a machine may plausibly be from its file, and which are farther."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.machines.effects.catalogue import SCALES
from rodgen.machines.measured import TURNS
from rodgen.machines.model import Model

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

USUAL_TURN = 0.03
"""Standard deviation of an axis from the file, radians: two degrees, as of a machine that was drawn by hand. A
correction costs the likelihood what it is improbable; a usual fit moves by far less, so that the cost only decides
where the data leave a choice, such as half a turn."""
USUAL_SHIFT = 0.03
"""The same of a point on an axis, and of a length of a closed chain, relative to the machine's size."""
USUAL_TARGET = 0.05
"""The same of a target: where a ball or a reflector is glued is known less well."""
USUAL_EXCHANGE = 0.2
"""The same relative to the distance to the next target, where that is less: else two names could be exchanged."""
LARGEST_SCALE = 0.5
"""Scale error beyond which a number is no scale error: encoders are off by 1e-3 at most."""
LARGEST_TURN = 0.35
"""Correction of an axis, radians (20 degrees), beyond which a file describes another machine."""
LARGEST_SHIFT = 0.3
"""The same of a point or a length, relative to the machine's size."""
LARGEST_TARGET = 1.0
"""The same of a target, which may be given roughly."""
EXTENT = 5.0
"""The machine's size is its extent, but no more than so many motions: its lengths may be in another unit."""


MOST_TARGETS = 100
"""Targets that are compared with each other at most."""


def implausible_numbers(machine: Machine) -> Iterator[str]:
    """Yield the numbers that a machine carries, held or fitted, and that no machine has."""
    model = Model(machine, compiled=False)
    theta = model.start()
    points = np.array([*(j.point for j in machine.joints), *(t.point for t in machine.targets)])
    extent = float(np.ptp(points, axis=0).max())
    sizes = np.abs(relative_corrections(model, theta, extent)) if extent else np.zeros(len(theta))
    for parameter, value, size in zip(model.parameters, theta, sizes, strict=True):
        is_scale = parameter.slot[0] == "e" and parameter.effect in SCALES
        if size > 1 or (is_scale and abs(value) > LARGEST_SCALE):
            unit = "" if parameter.unit == "1" else f" {parameter.unit}"
            yield f"{parameter.key} = {value / parameter.factor:.4g}{unit}, which no machine has"


def tolerances(model: Model, moved: float, *, usual: bool) -> Array:
    """Return the usual, or the largest plausible, correction of each parameter; infinite where any is plausible.

    Parameters
    ----------
    moved : float
        How far the joints move what is measured, length unit.
    usual : bool
        Whether the usual ones are asked for.

    Returns
    -------
    ndarray, shape (parameters,)
        Internal units.
    """
    size = _machine_size(model.machine, moved)
    if usual:
        turn, shift = USUAL_TURN, USUAL_SHIFT
        aim = min(USUAL_TARGET * size, USUAL_EXCHANGE * _least_distance(model.machine))
    else:
        turn, shift, aim = LARGEST_TURN, LARGEST_SHIFT, LARGEST_TARGET * size
    of_kind = {
        "axis": turn,
        "point": shift * size,
        "geometry": shift * size,
        "target": aim if model.structure.moving else turn,
    }
    # how a body is turned in itself is a matter of which of its axes are read, and no fault of a file
    turned = [p.slot[0] == "target" and p.slot[-1] in {*TURNS, "zero"} for p in model.parameters]
    return np.where(turned, np.inf, [of_kind.get(kind, np.inf) for kind in model.kinds])


def relative_corrections(model: Model, theta: Array, moved: float) -> Array:
    """Return the corrections of axes, points, geometry and targets, each relative to the largest plausible one.

    Parameters
    ----------
    theta : ndarray, shape (parameters,)
        Internal units.
    moved : float
        How far the joints move what is measured, length unit.

    Returns
    -------
    ndarray, shape (parameters,)
        Zero of other parameters, and of all where nothing moves: then no size is known that they are large to. What a
        prior or bounds of the file make plausible is not large.
    """
    if not moved > 0:
        return np.zeros(len(theta))
    largest = np.maximum(
        tolerances(model, moved, usual=False),
        LARGEST_TURN / USUAL_TURN * stated_deviations(model),
    )
    return np.where(np.isfinite(theta), theta - model.known[0], np.inf) / largest


def stated_deviations(model: Model) -> Array:
    """Return the standard deviation that the file states of each parameter: of its prior, or of all within its bounds.

    Returns
    -------
    ndarray, shape (parameters,)
        Internal units; zero where it states neither.
    """
    _, precision, lowest, highest = model.known
    within = np.where(np.isfinite(highest - lowest), (highest - lowest) / np.sqrt(12), 0.0)
    return np.divide(1.0, precision, out=within, where=precision > 0)


def _machine_size(machine: Machine, moved: float) -> float:
    """Return the length that corrections of lengths are compared with.

    The motion of the readings, or the extent of the machine in its file: a small motion far from the base needs
    points that are known as well as the machine is. But the file may be in other units, so not much more.
    """
    points = np.array([*(j.point for j in machine.joints), *(t.point for t in machine.targets)])
    extent = float(np.ptp(points, axis=0).max()) if machine.measurand.moving else 0.0
    return max(moved, min(extent, EXTENT * moved))


def _least_distance(machine: Machine) -> float:
    """Return the distance of the two targets that are nearest to each other; infinite with one target."""
    targets = np.array([target.point for target in machine.targets[:MOST_TARGETS]])
    apart = np.linalg.norm(targets[:, None] - targets, axis=-1)
    apart = apart[apart > 0]
    return float(apart.min(initial=np.inf))
