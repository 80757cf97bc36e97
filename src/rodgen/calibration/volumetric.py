"""The error of a machine over its whole workspace: its largest, and that which 95 % of the positions stay below.

An error is where the fitted machine puts its target less where the machine of the file would without any error. How
the target was mounted, where it is estimated, and where the instrument stood, where its frame is free, are no errors of
the machine: of all mountings those count that bring both nearest to each other, by least squares over all positions.
Drifts of a set-up and the instrument's scale are left out. The uncertainty is that of the fitted parameters: each
statistic is found again with the parameters moved along each principal axis of their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.data.units import ARCSEC
from rodgen.machines.emit.own_errors import is_of_set_up, with_uncertainty
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame
from rodgen.machines.observations import Observations
from rodgen.statistics.columns import unit_columns
from rodgen.statistics.decompositions import lstsq

SHARE, NEAR = 0.95, 0.01
"""Part of the positions whose errors are smaller, and of those to both sides that say how uncertain it is."""
STEP = 1e-3
"""By which a target is moved to see what that does: of points it does not matter, of directions radians."""
POSITIONS = (1, 101, 33, 11)
"""Positions of each joint where none, one, two or three move."""
MOST = 1500
"""Positions where more joints move, or where the legs of a closed chain were measured."""
CHOICE = 0.05
"""Part of what a combination that the data leave open moves, by which it changes an error that rests on a choice."""


@dataclass(frozen=True)
class VolumetricError:
    """Errors over a workspace, in `unit`, with expanded uncertainties (k = 2); None where the noise is not known."""

    largest: float
    largest_u: float | None
    """The largest error."""
    most: float
    most_u: float | None
    """The error that 95 % of the positions stay below."""
    unit: str
    at: Array
    """Commanded coordinates of the largest, internal units, (J,)."""
    positions: int
    """How many positions were looked at, each approached from both sides."""
    ranges: Array
    """Of the coordinates, internal units, (J, 2)."""
    measured_only: bool
    """Whether the positions are those that were measured: the legs of a closed chain cannot have any lengths."""
    free: tuple[str, ...]
    """What was set up anew, so that both come nearest to each other: ``"target"``, ``"instrument"``."""
    by_choice: bool
    """Whether the errors rest on a choice among geometries that the data cannot distinguish."""


def volumetric_error(fit: Fit) -> VolumetricError | None:
    """Return the errors of a fitted machine over its travel; None where only angles or attitudes are read.

    At the reference temperature, at rest, without load, at time 0, and with the median of other columns.

    Parameters
    ----------
    fit : Fit

    Examples
    --------
    >>> from rodgen.calibration.fit import fit
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> slide = Machine(
    ...     name="Slide", length_unit="mm", angle_unit="deg", gravity=(0, 0, -1), reference_temperature=20,
    ...     joints=(Joint("X", "prismatic", (1, 0, 0), travel=(0, 200)),), targets=(Target("ball", (0, 0, 0)),),
    ...     measured=Measured("point", "machine", noise=0.001),
    ... )
    >>> slide = slide.with_effect(slide.effect("scale", "X"))
    >>> x = np.linspace(0, 100, 11)
    >>> data = Measurements.from_frame({"X [mm]": x, "x [mm]": 1.0001 * x, "y [mm]": 0 * x, "z [mm]": 0 * x})
    >>> found = volumetric_error(fit(slide, data))
    >>> round(found.largest, 6), round(found.most, 6), found.unit, float(found.at[0]), round(found.largest_u, 4)
    (0.02, 0.019, 'mm', 200.0, 0.002)
    """
    measurand = fit.machine.measurand
    if not (measurand.moving or measurand.is_direction):
        return None
    with one_thread_in_blas():
        return _over_travel(fit)


def _over_travel(fit: Fit) -> VolumetricError:
    measurand = fit.machine.measurand
    o, measured_only = _positions(fit)
    problem, theta = Problem(fit.problem.model, o), fit.values
    effects = [next((e for e in fit.machine.effects if e.owns(p.key)), None) for p in fit.parameters]
    of_machine = np.array([e is None or not is_of_set_up(fit.machine, e) for e in effects], bool)
    of_targets = np.array([kind == "target" for kind in fit.problem.model.kinds], bool)
    for i, (p, e) in enumerate(zip(fit.parameters, effects, strict=True)):  # a period means nothing at zero
        of_targets[i] |= e is not None and p.key.rpartition(".")[2] in e.definition.searched
    free_frame = fit.machine.measured.frame == "free"
    mounted = [i for i, p in enumerate(fit.parameters) if i in fit.free and p.slot[:2] == ("target", 0)]

    def places(values: Array) -> Array:
        return np.asarray(problem.places(np.where(of_machine | of_targets, values, 0.0), Frame.identity()))

    def ideal(values: Array) -> Array:
        return np.asarray(problem.places(np.where(of_targets, values, 0.0), Frame.identity()))

    def errors(values: Array) -> Array:
        real, nominal = places(values), ideal(values)
        moves = [(ideal(values + STEP * np.eye(len(values))[i]) - nominal) / STEP for i in mounted]
        if free_frame:
            moves += [np.cross(e, nominal) for e in np.eye(3)]
            moves += [np.broadcast_to(e, nominal.shape) for e in np.eye(3)] * measurand.moving
        off = real - nominal
        if moves:
            columns = unit_columns(np.stack(moves, axis=-1).reshape(-1, len(moves)))
            off -= (columns @ lstsq(columns, off.reshape(-1), relative=1e-9)).reshape(off.shape)
        size = np.linalg.norm(off, axis=1)
        return np.asarray(size if measurand.moving else 2 * np.arcsin(size / 2) / ARCSEC)

    lengths = errors(theta)
    where, rank = int(np.argmax(lengths)), np.argsort(lengths, kind="stable")
    near = rank[int((SHARE - NEAR) * o.n) : int((SHARE + NEAR) * o.n) + 1]

    def statistics(machine: Machine) -> Array:
        moved = errors(np.array([machine.values[p.key] for p in fit.parameters]))
        return np.array([moved[where], moved[near].mean()])

    steps = [1e-4 * null / np.max(np.abs(null)) for null in fit.determinacy.null]
    at, unit = places(theta), fit.unit_factor
    changes = [np.abs(errors(theta + step) - lengths).max() * unit for step in steps]
    moves = [np.abs(places(theta + step) - at).max() for step in steps]
    by_choice = any(x > CHOICE * y > 0 for x, y in zip(changes, moves, strict=True))
    keys = [p.key for p in fit.parameters]
    largest_u, most_u = with_uncertainty(fit.machine, (keys, fit.covariance), statistics)[1].tolist()
    largest, most = float(lengths[where]), float(np.quantile(lengths, SHARE))
    known = bool(np.isfinite(fit.covariance).all())
    return VolumetricError(
        largest, largest_u if known else None, most, most_u if known else None, fit.unit, o.q[where], o.n // 2,
        np.stack([o.q.min(axis=0), o.q.max(axis=0)], axis=1), measured_only,
        ("target",) * bool(mounted) + ("instrument",) * free_frame, by_choice,
    )  # fmt: skip


def _positions(fit: Fit) -> tuple[Observations, bool]:
    """Return observations at positions over the travel, each approached from both sides; and whether measured ones."""
    o, machine = fit.observations, fit.machine
    if not machine.kinematics.is_closed:
        read = np.array([[joint.is_read] for joint in machine.joints])
        q = machine.followed(_grid(np.where(read, o.travel, 0.0)))
        q = q[machine.within_travel(q)]
        rows = np.zeros(len(q), np.intp)
    if measured_only := machine.kinematics.is_closed or not len(q):
        rows = np.unique(np.linspace(0, o.n - 1, min(o.n, MOST)).astype(np.intp))
        q = o.q[rows]
    both = np.concatenate([rows, rows])
    n = len(both)

    positions = replace(
        o.take(both),
        q=np.concatenate([q, q]),
        s=np.repeat(np.array([1, -1], np.int8), len(q))[:, None] * np.ones((1, q.shape[1]), np.int8),
        v=np.zeros((n, q.shape[1])),
        t=None if o.t is None else np.zeros(n),
        load=None if o.load is None else np.zeros(n),
        temperature={name: np.zeros(n) for name in o.temperature},
        covariates={name: np.full(n, float(np.median(values))) for name, values in o.covariates.items()},
        target=np.zeros(n, np.int32),
        run=np.zeros(n, np.int32),
    )
    return positions, measured_only


def _grid(travel: Array) -> Array:
    """Return positions over ranges, (n, J): a grid of up to three, of more the corners and an even spread."""
    moved = np.flatnonzero(travel[:, 1] > travel[:, 0])
    d = len(moved)
    side = np.linspace(0, 1, POSITIONS[d]) if d < len(POSITIONS) else (0.0, 1.0)
    shares = np.array([*islice(product(side, repeat=d), MOST)]).reshape(-1, d)
    if d >= len(POSITIONS):
        from scipy.stats import qmc  # takes half a second to import

        shares = np.concatenate([shares, qmc.Halton(d, scramble=False).random(MOST)])
    q = np.tile(travel[:, 0], (len(shares), 1))
    q[:, moved] += shares * (travel[moved, 1] - travel[moved, 0])
    return q
