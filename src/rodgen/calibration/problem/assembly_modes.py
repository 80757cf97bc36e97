"""Where the platform of a closed chain is on the nominal machine, for every row, and in which assembly mode.

A model of a closed chain solves for the platform's pose by a few Newton steps. They start here. The mode is the one
that the family counts as the physical one, else the one nearest to what the machine file names, else to the readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.attitudes import nearest_frame
from rodgen.errors import InputFileError
from rodgen.machines.families.on_legs import NEAR, OnLegs
from rodgen.machines.rigid import rotation_matrix, rotation_vector

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.observations import Observations

OTHER_MODE = 0.5
"""Share of the rows nearer to another assembly mode from which on the nominal machine is in the wrong one."""

__all__ = [
    "attainable",
    "closed",
    "far_apart",
    "found_again",
    "in_another_mode",
    "in_its_mode",
    "not_found_by_code",
    "open_legs",
    "other_mode",
    "pose_start",
    "weakest",
    "with_commands",
    "with_what_was_seen",
    "within_reach",
]

Array: TypeAlias = NDArray[np.float64]

TURNS = 20
"""Most times that the frame and the modes nearest the readings in it are found in turn; two are usually enough."""
SINGULAR = 1e-5
"""How well legs hold a platform, 1 at best, below which a micrometre of a leg would be a hundred millimetres."""
FAR = 3e-3
"""In rad, or radii of the base. A pose that starts no farther off than this is found to rounding in two steps."""
SLACK = 0.02
"""Part of its way by which a freedom may be moved farther than in the data: legs are commanded in round numbers."""
WEAK = 0.1
"""How well legs hold a platform, 1 at best, below which a row is worth a look."""
LOOKED_AT = 2000
"""Rows in which assembly modes are compared."""
HALVINGS = 6
"""Times that a command out of reach is brought half way nearer to one in reach."""


def closed(observations: Observations, *, by_readings: bool = True) -> Observations:
    """Return observations of a closed chain with the poses that its model starts from.

    Parameters
    ----------
    observations : Observations
    by_readings : bool
        Whether the readings mean something, and may determine the assembly mode.

    Raises
    ------
    InputFileError
        When the legs of a row do not close, or the assembly mode is unknown.
    """
    o = (
        observations
        if by_readings
        else replace(observations, reading=np.full_like(observations.reading, np.nan))
    )
    start = pose_start(o)
    missing = np.isnan(start).any(axis=1)
    if missing.any():
        raise open_legs(o, int(np.argmax(missing)), f"this {o.machine.kinematics.family}")
    held = _on_legs(o.machine).least_singular_value(start)
    if held.min(initial=1.0) < SINGULAR:
        row = int(np.argmin(held))
        found = "a singular pose, in which the legs do not hold the platform"
        raise InputFileError(
            o.data.file, o.data.place(row), found, "poses away from it: this one determines nothing"
        )
    return replace(observations, pose_start=start)


def open_legs(o: Observations, row: int, which: str) -> InputFileError:
    """Return the error that the legs of a row close in no pose of a machine, `which`."""
    lengths = ", ".join(f"{x:.9g}" for x in o.q[row])
    found = f"legs of {lengths} {o.machine.length_unit}, which close in no pose of {which}"
    expected = "lengths from joint to joint, or another geometry"
    return InputFileError(o.data.file, o.data.place(row), found, expected)


def with_commands(o: Observations, like: Observations) -> Observations:
    """Return observations whose commands are new, with the poses that a closed chain's model starts from.

    Parameters
    ----------
    o : Observations
        Rows whose legs do not close have NaN as their pose.
    like : Observations
        Of the same machine, in its assembly mode.
    """
    if not o.machine.kinematics.is_closed:
        return o
    in_mode = replace(o, machine=in_its_mode(like.machine, like))
    return replace(o, pose_start=pose_start(in_mode))


def far_apart(poses: Array, start: Array, machine: Machine) -> NDArray[np.bool_]:
    """Return where poses are so far from others that a model should rather start from them, (n,)."""
    return np.asarray(np.abs((poses - start) / _on_legs(machine).pose_scale).max(axis=1) > FAR)


def found_again(o: Observations, numbers: Mapping[str, tuple[float, ...]]) -> Array:
    """Return the poses, (n, k), of a closed chain of another geometry, in the assembly mode that it is in.

    Parameters
    ----------
    o : Observations
        Whose poses are of the nominal geometry, or of one before.
    numbers : mapping of str to tuple of float
        The geometry, as its components.

    Returns
    -------
    ndarray
        Where the legs do not close, the poses that were.
    """
    kinematics = _on_legs(o.machine).with_numbers(numbers)
    before = np.asarray(o.pose_start)
    if kinematics.fault:
        return before
    modes = kinematics.modes(o.q)
    poses = _taken(modes, _nearest_poses(modes, before))
    return np.where(np.isfinite(poses).all(axis=1, keepdims=True), poses, before)


def in_another_mode(o: Observations, machine: Machine) -> float:
    """Return in which part of the rows the readings are nearer to another assembly mode than to that of ``start``.

    Parameters
    ----------
    o : Observations
    machine : Machine
    """
    kinematics = machine.kinematics
    if kinematics.start is None or o.pose_start is None or not _tell_mode(o):
        return 0.0
    some = o.take(_looked_at(o))
    asked = pose_start(replace(some, machine=machine))
    free = replace(machine, kinematics=kinematics.in_mode(None))
    return float(np.mean(far_apart(pose_start(replace(some, machine=free)), asked, machine)))


def other_mode(o: Observations, machine: Machine) -> str:
    """Return that the readings are mostly of another assembly mode than ``start``; empty where they are not.

    Parameters
    ----------
    o : Observations
    machine : Machine
    """
    part = in_another_mode(o, machine)
    if part <= OTHER_MODE:
        return ""
    return f"in {part:.0%} of the rows another assembly mode than that of [geometry] start is nearer to the readings"


def _looked_at(o: Observations) -> NDArray[np.intp]:
    """Return the numbers of the rows in which assembly modes are compared."""
    return np.linspace(0, o.n - 1, min(o.n, LOOKED_AT)).astype(np.intp)


def weakest(o: Observations) -> int | None:
    """Return the row of a closed chain whose legs hold the platform worst, None where all do it well."""
    if o.pose_start is None:
        return None
    held = _on_legs(o.machine).least_singular_value(np.asarray(o.pose_start))
    row = int(np.argmin(held))
    return row if held[row] < WEAK else None


def attainable(o: Observations, q: Array) -> NDArray[np.bool_]:
    """Return which commands, (n, legs), the machine of `o` can take: the legs close, and the platform turns no farther.

    What the joints of platform and passive leg allow is in no file. Where the platform was, it can go again: in
    each of its degrees of freedom no farther than in the data.
    """
    machine = in_its_mode(o.machine, o)
    rows = o.take(np.zeros(len(q), int))
    freedoms = _on_legs(machine).degrees_of_freedom
    poses = freedoms(pose_start(replace(rows, machine=machine, q=q)))
    taken = freedoms(np.asarray(o.pose_start))
    low, high = taken.min(axis=0), taken.max(axis=0)
    slack = SLACK * (high - low) + 1e-12
    with np.errstate(invalid="ignore"):
        return np.asarray(((poses >= low - slack) & (poses <= high + slack)).all(axis=1))


def pose_start(o: Observations) -> Array:
    """Return the poses on the nominal machine, (n, k); NaN where the legs do not close."""
    kinematics = _on_legs(o.machine)
    modes = kinematics.modes(o.q)
    return _taken(modes, _chosen(o, kinematics, modes))


def _on_legs(machine: Machine) -> OnLegs:
    assert isinstance(machine.kinematics, OnLegs)
    return machine.kinematics


def _taken(modes: Array, chosen: NDArray[np.intp]) -> Array:
    """Return the chosen mode of each row as the numbers that a model starts from, (n, k)."""
    return np.asarray(modes[np.arange(len(modes)), chosen])


def _nearest_poses(modes: Array, poses: Array) -> NDArray[np.intp]:
    """Return the number of each row's mode that is the nearest to a pose, one for all or one a row.

    Of rotation matrices, those with the least difference have the smallest angle between them.
    """
    return _least(np.sum((modes - poses.reshape(-1, 1, modes.shape[2])) ** 2, axis=2))


def _chosen(o: Observations, kinematics: OnLegs, modes: Array) -> NDArray[np.intp]:
    """Return the number of each row's mode."""
    if modes.shape[1] == 1:
        return np.zeros(len(modes), np.intp)
    if kinematics.start is not None:
        return _nearest_poses(modes, rotation_matrix(kinematics.start))
    measurand, machine_targets = o.machine.measurand, o.machine.targets
    if not _tell_mode(o):
        raise InputFileError(
            o.machine.file or o.machine.name,
            "[geometry], start",
            "missing, while no readings tell the assembly mode",
            "a rotation vector near which the platform is, such as [0, 0, 10]",
        )
    points = np.array([target.point for target in machine_targets])
    if measurand.has_attitude and not measurand.is_pose:  # read is the z axis of the body
        points = rotation_matrix([target.attitude for target in machine_targets])[:, :, 2]
    targets = points[o.target]
    seen = kinematics.placed(modes, targets[:, None], moving=measurand.moving)
    if measurand.has_origin:
        distance = np.linalg.norm(seen - np.array(o.machine.measured.origin), axis=2)
        return _nearest((distance - o.reading) ** 2, o.pose)
    if o.machine.measured.frame == "machine":
        return _nearest(_apart(seen, o.reading), o.pose)
    return _in_a_free_frame(seen, o.reading, measurand.moving, o.pose)


def _tell_mode(o: Observations) -> bool:
    """Return whether readings tell the assembly mode: no angles, and attitudes only of a body whose own is known."""
    measurand = o.machine.measurand
    alone = measurand.has_attitude and not measurand.is_pose
    unknown = measurand.has_zero or (alone and "target" in o.machine.estimate)
    return not unknown and bool(np.isfinite(o.reading).all())


def _least(distance: Array) -> NDArray[np.intp]:
    """Return the number of each row's least distance; 0 where there is none."""
    return np.asarray(np.argmin(np.where(np.isnan(distance), np.inf, distance), axis=1), np.intp)


def _nearest(squares: Array, pose: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the number of the mode that is the nearest in all rows of a pose together: they are one attitude."""
    _, of = np.unique(pose, return_inverse=True)
    sums = np.zeros((int(of.max(initial=-1)) + 1, squares.shape[1]))
    np.add.at(sums, of, np.where(np.isnan(squares), np.inf, squares))
    return _least(sums)[of]


def _apart(seen: Array, reading: Array) -> Array:
    return np.asarray(np.sum((seen - reading[:, None]) ** 2, axis=2))


def _in_a_free_frame(seen: Array, reading: Array, moves: bool, pose: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the modes of which some frame meets the readings best: each mode of a row is once the first guess."""
    closing = np.flatnonzero(np.isfinite(seen[:, 0, 0]))
    if not len(closing):
        return np.zeros(len(seen), np.intp)
    best: tuple[float, NDArray[np.intp]] | None = None
    for first in range(seen.shape[1]):
        chosen = np.where(np.isfinite(seen[:, first, 0]), first, 0)
        for _ in range(TURNS):
            at = seen[np.arange(len(seen)), chosen]
            frame = nearest_frame(at[closing], reading[closing], np.ones(len(closing)), moving=moves)
            apart = _apart(seen @ frame.rotation.T + frame.position, reading)
            before, chosen = chosen, _nearest(apart, pose)
            if np.array_equal(before, chosen):
                break
        cost = float(np.nansum(apart[closing, chosen[closing]]))
        if best is None or cost < best[0]:
            best = cost, chosen
    assert best is not None
    return best[1]


def within_reach(o: Observations, q: Array) -> Observations:
    """Return observations of a closed chain with other commands, as near to these as the legs close.

    Parameters
    ----------
    o : Observations
    q : ndarray, shape (n, legs)
        A row that does not close comes nearer to the one in `o`, and at last stays where that is.
    """
    machine = in_its_mode(o.machine, o)
    reachable, start = np.array(o.q), np.array(o.pose_start)
    wanted, open_ = np.array(q), np.ones(o.n, bool)
    for _ in range(HALVINGS):
        some = np.flatnonzero(open_)
        tried = replace(o.take(some), machine=machine, q=wanted[some])
        poses = pose_start(tried)
        good = np.isfinite(poses).all(axis=1)
        reachable[some[good]], start[some[good]] = wanted[some[good]], poses[good]
        open_[some[good]] = False
        if not open_.any():
            break
        wanted[open_] = (wanted[open_] + o.q[open_]) / 2
    return replace(o, q=reachable, pose_start=start)


def in_its_mode(machine: Machine, o: Observations) -> Machine:
    """Return a machine that knows in which assembly mode it was measured.

    Where readings determined the mode, its ``start`` becomes the pose in the middle of all.
    """
    kinematics = machine.kinematics
    if not kinematics.has_modes or kinematics.start is not None or o.pose_start is None:
        return machine
    turns = o.pose_start.reshape(-1, 3, 3)
    middle = turns[int(np.argmax(np.einsum("nij,ij->n", turns, turns.mean(axis=0))))]
    x, y, z = (float(c) for c in rotation_vector(middle))
    return replace(machine, kinematics=kinematics.in_mode((x, y, z)))


def with_what_was_seen(machine: Machine, o: Observations) -> Machine:
    """Return a machine that knows poses from which all that were measured are found, for the code that it emits."""
    kinematics = machine.kinematics
    if kinematics.start is None or o.pose_start is None:
        return machine
    some = _looked_at(o)
    return replace(machine, kinematics=kinematics.with_seen(np.asarray(o.pose_start)[some], o.q[some]))


def not_found_by_code(machine: Machine, o: Observations) -> float:
    """Return in which part of the rows emitted code of a fitted machine does not find the platform."""
    if o.pose_start is None:
        return 0.0
    kinematics = _on_legs(machine)
    some = _looked_at(o)
    apart = np.abs((kinematics.found_by_code(o.q[some]) - o.pose_start[some]) / kinematics.pose_scale)
    return float(np.mean(~(apart.max(axis=1) < NEAR)))
