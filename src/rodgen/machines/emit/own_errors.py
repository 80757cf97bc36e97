"""A machine's own errors for a report: location errors by their ISO names, and which effects are not its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.units import parse_unit
from rodgen.machines.emit._error_motions import _along_machine_axis, _locations
from rodgen.machines.emit._numbers import Covariance, K, standard, varied
from rodgen.machines.emit._scope import _left_out

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.parts import Effect


CHOICE, ROUNDING = 1e-3, 1e-10
"""When parameters move in a way that the data leave open, the part of the largest change by which an error moves that
rests on a choice; and the largest change by rounding, internal units."""
NAMES = {"A": "x", "B": "y", "C": "z", "X": "x", "Y": "y", "Z": "z"}


@dataclass(frozen=True)
class LocationError:
    """An error of the position or the orientation of an axis, which is constant over its travel."""

    symbol: str
    """Of ISO 230-1 and ISO 230-7, such as ``"EA0C"``: the tilt of C about x."""
    joint: str
    meaning: str
    value: float
    """Real less nominal, in `unit`."""
    u: float
    """Expanded uncertainty, k = 2; 0 where it is not estimated."""
    unit: str
    """``"um"`` or ``"arcsec"``."""
    by_choice: bool
    """Whether the value rests on a choice among geometries that the data cannot distinguish."""


def location_errors(
    machine: Machine, travel: Any, covariance: Covariance, open_: Array
) -> list[LocationError]:
    """Return the location errors of a fitted machine that are estimated or not zero.

    Parameters
    ----------
    machine : Machine
        Fitted.
    travel : array_like, shape (joints, 2)
        Range of each joint in the data, internal units.
    covariance : tuple of keys and ndarray
        Of the parameters, internal units.
    open_ : ndarray, shape (k, parameters)
        Combinations of these parameters that the data leave open.

    Returns
    -------
    list of LocationError
        None of a closed chain, nor of a machine with a joint that is along no machine axis: ISO 230 names errors of
        axes along x, y and z.
    """
    if machine.kinematics.is_closed or not all(_is_along(np.array(joint.axis)) for joint in machine.joints):
        return []
    keys = covariance[0]
    sizes = {"um": parse_unit("um").factor(machine.length_unit), "arcsec": parse_unit("arcsec").factor()}

    def values(of: Machine) -> Array:
        return np.array([value for _, value, _ in _locations(of, travel)])

    listed = list(_locations(machine, travel))
    factors = np.array([sizes[unit] for _, _, unit in listed])
    variants, expanded = with_uncertainty(machine, covariance, values)
    chosen = np.zeros(len(listed), bool)
    for null in open_:
        step = 1e-4 * null / np.max(np.abs(null))
        moved = replace(
            machine,
            values={
                **machine.values,
                **{k: machine.values.get(k, 0.0) + float(x) for k, x in zip(keys, step, strict=True)},
            },
        )
        change = np.abs(values(moved) - variants)
        for unit in sizes:
            of_unit = np.array([unit_of == unit for _, _, unit_of in listed])
            most = float(np.max(change[of_unit], initial=0.0))
            if most > ROUNDING:
                chosen |= of_unit & (change > CHOICE * most)
    joints = [joint for joint in machine.joints for _ in range(5 if joint.revolute else 3)]
    return [
        LocationError(
            f"E{symbol}", joint.name, _meaning(symbol, joint), float(value), float(u), unit, bool(choice)
        )
        for (symbol, _, unit), joint, value, u, choice in zip(
            listed, joints, variants / factors, expanded / factors, chosen, strict=True
        )
        if value or u
    ]


def with_uncertainty(
    machine: Machine, covariance: Covariance, of: Callable[[Machine], Array]
) -> tuple[Array, Array]:
    """Return what a function says of a machine, and its expanded uncertainty, k = 2; 0 where the noise is not known."""
    variants = [of(each) for each in varied(machine, covariance)]
    return variants[0], K * standard(variants)


def _meaning(symbol: str, joint: Any) -> str:
    """Return what a location error is, in words."""
    about = NAMES[symbol[0]]
    k = int(np.argmax(np.abs(joint.axis)))
    if "xyz"[k] == about:
        return f"zero of {joint.name}"
    if symbol[0] in "XYZ":
        return f"position of {joint.name} in {about}"
    return f"{'tilt' if joint.revolute else 'squareness'} of {joint.name} about {about}"


def _is_along(axis: Array) -> bool:
    k = int(np.argmax(np.abs(axis)))
    return float(np.abs(_along_machine_axis(axis)[k])) == 1.0


def is_of_set_up(machine: Machine, effect: Effect) -> bool:
    """Return whether an effect is of the instrument or its set-up, and not of the machine."""
    return any(left_out == effect for left_out, _ in _left_out(machine))
