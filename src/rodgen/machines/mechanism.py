"""Conversions between rigid machines and mechanisms.

A machine file gives each joint by its axis in machine axes, with all joints at zero, and the measured points as
targets; a mechanism has links. A placement adds base frame, end frame and zeros, so that both are one chain.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from rodgen.errors import RodgenError, joined
from rodgen.kinematics.spatial.mechanism import Mechanism
from rodgen.kinematics.spatial.placement import Placement, placed
from rodgen.kinematics.spatial.product_of_exponentials import (
    PARALLEL,
    placement_from_axes,
    to_product_of_exponentials,
)
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.parts import Joint, Target
from rodgen.machines.rigid import three


def to_mechanism(machine: Machine, *, tolerance: float = PARALLEL) -> Placement:
    """Return the mechanism of a rigid machine.

    Parameters
    ----------
    machine : Machine
        A chain of joints, or two branches, which are one from the instrument to the target; with its fitted numbers,
        where it has been fitted.
    tolerance : float, optional
        Largest sine between axes that count as parallel.

    Returns
    -------
    Placement
        Its coordinates are the machine's, angles in rad. Its end frame is fixed to the last body and is that of the
        machine axes where all joints are zero: a target p is seen at forward(q) · p.

    Raises
    ------
    RodgenError
        When the machine is a closed chain, or has effects: a mechanism is ideal.

    Examples
    --------
    >>> from rodgen import spatial
    >>> from rodgen.machines.mechanism import from_mechanism, to_mechanism
    >>> machine = from_mechanism(spatial.PUMA_560)
    >>> to_mechanism(machine).mechanism.a.round(9)
    array([ 0. , 17. ,  0.8,  0. ,  0. ])
    """
    if machine.kinematics.is_closed:
        raise RodgenError(f"{machine.name!r} is a closed chain; expected a chain of joints")
    if machine.effects:
        titles = joined(effect.title for effect in machine.effects)
        raise RodgenError(f"{machine.name!r} has effects ({titles}); expected a rigid machine without")
    if machine.values:
        machine = fixed_machine(machine)
    kinds = tuple("R" if joint.revolute else "P" for joint in machine.joints)
    directions = np.array([joint.axis for joint in machine.joints], float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[: machine.inner] *= -1  # seen from what a joint carries, the rest moves backwards
    points = np.array([joint.point for joint in machine.joints], float)
    labels = {
        "unit": machine.length_unit,
        "name": machine.name,
        "names": tuple(joint.name for joint in machine.joints),
    }
    return placement_from_axes(kinds, directions, points, np.zeros(len(kinds)), np.eye(4), tolerance, labels)


def from_mechanism(
    robot: Mechanism | Placement,
    targets: Mapping[str, Sequence[float]] | None = None,
    *,
    name: str | None = None,
) -> Machine:
    """Return the machine, which can be fitted to measurements, of an open chain.

    Parameters
    ----------
    robot : Mechanism or Placement
        Of joints R, P and C, and E, T and S, which become R and P.
    targets : mapping of str to sequence of float (3), optional
        Points of the end frame that are measured; left out: its origin, ``"end"``.
    name : str, optional
        Of the machine; left out: the mechanism's.

    Returns
    -------
    Machine
        Its axes and targets are in the base frame, its joints those of the variables: a C is a revolute joint and a
        prismatic one, NAME and NAME_S. ``machine.save(path)`` writes its file.

    Raises
    ------
    RodgenError
        When the chain is closed, or has a screw, for which a machine file has no joint.

    Examples
    --------
    >>> from rodgen import spatial
    >>> from rodgen.machines.mechanism import from_mechanism
    >>> print(from_mechanism(spatial.Mechanism("RP", [100.0], [0.0], name="Lift")).describe())
    Lift (mm, deg)
      R1  revolute about [0, 0, 1] through [0, 0, 0]
      P2  prismatic along [0, 0, 1]
    targets: end [100, 0, 0]
    measured: point in machine axes
    estimated: nothing but the effects
    effects: none
    """
    robot_rpc = _of_r_p_c(robot)
    mechanism = robot_rpc.mechanism
    product = to_product_of_exponentials(robot_rpc)
    joints = []
    for (j, which), screw in zip(mechanism.variables, product.screws, strict=True):
        label = _label(mechanism.names[j])
        turns = which == "theta"
        axis = screw[:3] if turns else screw[3:]
        point = np.cross(axis, screw[3:]) if turns else np.zeros(3)
        if not turns and mechanism.joints[j] == "C":
            label += "_S"
        kind = "revolute" if turns else "prismatic"
        joints.append(Joint(label, kind, three(axis), three(point)))
    labels = [joint.name for joint in joints]
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise RodgenError(
            f"two joints are called {twice!r} in a machine file; expected names that differ there"
        )
    seen = {"end": (0.0, 0.0, 0.0)} if targets is None else targets
    marks = [
        Target(label, three(product.home[:3, :3] @ np.asarray(point, float) + product.home[:3, 3]))
        for label, point in seen.items()
    ]
    if not marks:
        raise RodgenError("there are no targets; expected one or more, or None for the end frame's origin")
    title = mechanism.name if name is None else name
    return Machine(
        title or "Mechanism",
        mechanism.unit,
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        tuple(joints),
        tuple(marks),
        Measured("point", "machine"),
    )


def _of_r_p_c(robot: Mechanism | Placement) -> Placement:
    mechanism = robot.mechanism if isinstance(robot, Placement) else robot
    for number, (kind, label) in enumerate(zip(mechanism.joints, mechanism.names, strict=True), 1):
        if kind == "H":
            raise RodgenError(
                f"joint {number}, {label!r}, is a screw, for which a machine file has no joint; expected R, P or C"
            )
    if isinstance(robot, Placement):
        return robot
    return placed(mechanism.expanded())


def _label(name: str) -> str:
    """Return a joint's name as a machine file may have it: letters, digits, _, - and +, at most 60."""
    return re.sub(r"[^A-Za-z0-9_+-]", "_", name)[:60]
