"""Functions of one coordinate, which are seen at its distinct positions only.

Replicates there average the noise, but they add no position, and some function always goes through the few errors that
there are. So such a function is tested against what any function of that coordinate would explain (a lack of fit at the
positions), and needs as many positions beyond its freedoms as it has freedoms.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.statistics.columns import ColumnSpace, Whiten, orthonormal_basis, unit_columns
from rodgen.statistics.f_tests import f_tail, log_p_of_fall
from rodgen.statistics.thresholds import EVIDENCE, SELECTION, VERDICT

if TYPE_CHECKING:
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Effect


COORDINATE = {"q", "zeta", *(f"P{k}" for k in range(1, 5))}
FIXED = {"L", "N", "U", "V", "EX", "EY", "EZ", "pi"}
"""Names in the formula of an effect for its joint's coordinate, and for what the coordinate does not change."""
OF_NO_POSE = {"t", "T", "F", "s", "v"}
"""Names for what a pose does not determine."""


def positions(values: Array) -> NDArray[np.int_]:
    """Return the number of each row's position, (n,): equal where coordinates of a joint are all but the same.

    A position is no wider than that: coordinates close to each other along a continuous way are several.
    """
    order = np.argsort(values, kind="stable")
    ascending, width = values[order], EVIDENCE.same_position * np.ptp(values)
    first = [0]
    while (end := int(np.searchsorted(ascending, ascending[first[-1]] + width, "right"))) < len(values):
        first.append(end)
    number = np.empty(len(values), int)
    number[order] = np.searchsorted(first, np.arange(len(values)), "right") - 1
    return number


def distinct_positions(values: Array, poses: int) -> NDArray[np.int_] | None:
    """Return the number of each row's position, None where these are not far fewer than those of a continuous way.

    As many poses at random along a way share some positions, too: the next position begins a width and the mean
    distance of two poses further on. With half as many positions as these, or more, poses are as good as positions.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Coordinates of a joint, or another column.
    poses : int
        Number of poses.

    Returns
    -------
    ndarray of int, shape (n,), or None
    """
    number = positions(values)
    continuous = poses / (1 + poses * EVIDENCE.same_position)
    return number if int(number.max(initial=0)) + 1 < continuous / 2 else None


def position_of(effect: Effect, observations: Observations) -> str | None:
    """Return the joint of whose coordinate alone an effect is a function; None where there is no such joint.

    It is the effect's own; where only one joint moves, all that depends on the pose depends on that joint.
    """
    definition = effect.definition
    names = definition.formula.names - definition.parameters.keys()
    if names & COORDINATE and names <= COORDINATE | FIXED:
        return str(effect.place)
    moving = np.flatnonzero(np.ptp(observations.q, axis=0) > 0)
    if len(moving) != 1 or definition.own or definition.per_run or names & OF_NO_POSE:
        return None
    return observations.machine.joints[int(moving[0])].name


def few_positions(effect: Effect, observations: Observations) -> tuple[str, int] | None:
    """Return the joint of whose coordinate alone an effect is a function, and its distinct positions if these are few.

    Returns
    -------
    (str, int) or None
        None where there is no such joint, or its positions are as good as poses.
    """
    joint = position_of(effect, observations)
    if joint is None:
        return None
    of_drive = effect.definition.component == "reading"
    q = (observations.q if of_drive else observations.coordinates)[:, observations.machine.number_of(joint)]
    number = distinct_positions(q, len(np.unique(observations.pose)))
    return None if number is None else (joint, int(number.max()) + 1)


def log_p_by_position(
    o: Observations,
    model: Array,
    columns: Array,
    residual: Array,
    whiten: Whiten,
    driver: str,
    searched: int,
    tries: float = 1.0,
) -> tuple[float, bool]:
    """Return the logarithm of the probability that chance explains as much as a function of one coordinate.

    And whether the positions are enough to show its shape: three for each of its freedoms.

    Parameters
    ----------
    model : ndarray, shape (n, m, p)
        Columns of what else there is.
    columns : ndarray, shape (n, m, k)
        Of the function.
    residual : ndarray, shape (n, m)
        Without the function.
    driver : str
        The joint or column whose function it is.
    searched : int
        Number of its parameters that were searched.
    tries : float
        Number of independent tests that the values tried amount to.

    Returns
    -------
    (float, bool)
        0 where positions are too few; minus infinity where they are nearly as many as poses, or the errors at the
        positions scatter no more than noise does: then readings are what counts.
    """
    rows = rows_by_position(o, driver)
    if rows is None:
        return -np.inf, True
    every = [columns, bases_by_rows(columns, rows)]
    found = explained_within(model, columns, every, residual, whiten, searched)
    if found.few < found.freedoms:
        return 0.0, False
    log_p = -np.inf if found.by_noise else min(found.log_p + float(np.log(tries)), 0.0)
    return log_p, found.few >= (EVIDENCE.positions_a_freedom - 1) * found.freedoms


def rows_by_position(o: Observations, driver: str) -> list[NDArray[np.bool_]] | None:
    """Return the rows of each position of a joint or a column; None where poses are as good as positions."""
    values = [d.values for d in o.drivers() if d.name == driver]
    number = distinct_positions(np.asarray(values[0], float), len(np.unique(o.pose))) if values else None
    return None if number is None else [number == i for i in range(int(number.max()) + 1)]


class ExplainedWithin(NamedTuple):
    """What columns explain of what a larger set does."""

    log_p: float
    """Logarithm of the probability that chance does."""
    by_noise: bool
    """Whether chance is noise, as the rest of what the larger set explains is no more than that."""
    few: int
    freedoms: int
    """Further freedoms of the larger set, and those of the columns."""


def explained_within(
    model: Array, columns: Array, every: Sequence[Array], residual: Array, whiten: Whiten, searched: int
) -> ExplainedWithin:
    """Return what columns explain of what a larger set does.

    Parameters
    ----------
    model, columns : ndarray, shape (n, m, ...)
    every : sequence of ndarray, each with n m rows in all
        What spans the larger set, in which the columns are.
    residual : ndarray, shape (n, m)
    searched : int
        Freedoms of the columns besides their number.
    """
    n, m, k = columns.shape
    further = np.concatenate([columns.reshape(n * m, k), *(x.reshape(n * m, -1) for x in every)], axis=1)
    parts = [model, further.reshape(n, m, -1), residual[:, :, None]]
    white = whiten(np.concatenate(parts, axis=2)).reshape(n * m, -1)
    count = further.shape[1]
    base = ColumnSpace.of(white[:, : -count - 1])
    r, further = base.project_out(white[:, -1]), unit_columns(white[:, -count - 1 : -1])
    own = base.score_test(r, base.visible_part(further[:, :k], SELECTION.visible))
    whole = base.score_test_of_many(r, further, SELECTION.visible)
    if own is None or whole is None:
        return ExplainedWithin(0.0, False, 0, k + searched)
    freedoms = own.dof + searched
    few = whole.dof - freedoms
    if few < 1:
        return ExplainedWithin(0.0, False, few, freedoms)
    scatter = max(own.left - whole.left, 0.0) / few
    if f_tail(scatter / (whole.left / whole.residual_dof), few, whole.residual_dof) > VERDICT.rare:
        log_p = log_p_of_fall(own.fall, whole.left, own.dof, whole.residual_dof)
        return ExplainedWithin(log_p, True, few, freedoms)
    return ExplainedWithin(log_p_of_fall(own.fall / scatter, few, own.dof, few), False, few, freedoms)


def bases_by_rows(columns: Array, parts: Sequence[NDArray[np.bool_]]) -> Array:
    """Return orthonormal bases of what columns span in each part of the rows, (n m, r), zero in the other parts."""
    n, m, k = columns.shape
    bases = [orthonormal_basis(columns[rows].reshape(-1, k)) for rows in parts]
    found, before = np.zeros((n, m, sum(basis.shape[1] for basis in bases))), 0
    for rows, basis in zip(parts, bases, strict=True):
        after = before + basis.shape[1]
        found[rows, :, before:after] = basis.reshape(int(rows.sum()), m, basis.shape[1])
        before = after
    return found.reshape(n * m, found.shape[2])
