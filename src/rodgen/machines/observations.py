"""Observations: measurements of a machine as arrays in internal units."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.measurements import Measurements
from rodgen.data.poses import groups, originals
from rodgen.data.set_aside import RowsAside
from rodgen.data.units import FORCE, ONE, TEMPERATURE, TIME, Dimension, parse_unit, unit_factor
from rodgen.errors import InputFileError
from rodgen.machines.drivers import Driver, Kind
from rodgen.machines.machine import Machine

TRIMMED = 1e-3
"""Part of a joint's range below which its way from row to row is a trim, not a move, ..."""
TRIMS = 0.05
"""... and share of its ways that may be so short by chance, if positions are random."""


@dataclass(frozen=True, eq=False, repr=False)
class Observations:
    """Measurements in internal units, checked against a machine; `rodgen.calibration.problem.binding.bind` makes them.

    Lengths are in the machine's unit, angles in radians, times in seconds, temperatures in kelvins from the machine's
    reference, forces in newtons. n is the number of rows, J that of joints. Arrays are read-only; what is
    the same in all rows takes no memory.

    Attributes
    ----------
    machine : Machine
    data : Measurements
    q : ndarray, shape (n, J)
        Commanded coordinates: the reading of each joint, the coordinate of one that has none.
    s : ndarray of int8, shape (n, J)
        Direction of approach, +1 or -1; 0 of a joint that never moves and has no column for it.
    v : ndarray, shape (n, J)
        Velocities.
    t, load : ndarray, shape (n,), or None
        Times and payload forces, where there are such columns.
    temperature : mapping of str to ndarray, shape (n,)
        By joint.
    covariates : mapping of str to ndarray, shape (n,)
        Every column without a meaning of its own, by name; temperatures from the reference, too.
    reading : ndarray, shape (n, 3), or (n, 1) for distances
        Directions have length 1. NaN where readings may be missing and are. Of poses the points, of attitudes alone the
        z axes of the bodies.
    sigma : ndarray like `reading`, or None
        Standard uncertainty of each component, from the columns ``u_…`` or the machine's ``noise``; None where neither
        is given. Of poses (n, 6), those of attitudes times `arm`.
    correlation : ndarray, shape (n, m, m), or None
        Of the errors of the components of each reading; None where they are independent.
    target : ndarray of int, shape (n,)
        Index into the machine's targets.
    run : ndarray of int, shape (n,)
        Index into `run_names`.
    run_names : tuple of str
        In the order in which they occur; ``("",)`` without such a column.
    pose : ndarray of int, shape (n,)
        Consecutive rows with equal commanded coordinates and run have one number.
    travel : ndarray, shape (J, 2)
        Range of each joint: the machine's, or that of the data.
    columns_given : frozenset of str
        Names of all columns in the data.
    pose_start : ndarray, shape (n, k), or None
        Of a closed chain: the platform's pose on the nominal machine, near which a model solves for its own.
    attitude : ndarray, shape (n, 3, 3), or None
        Of poses the measured attitudes: the axes of the body as columns, in the measuring frame.
    arm : float
        Of poses the lever arm by which turns are lengths, length unit: the ratio of the noise of positions to that of
        attitudes.
    arm_is_known : bool
        False until a fit has estimated it.
    counted_as : ndarray of int, or None
        Of each row of the table as it was given, the row here that it is counted as: of copies that of the first, and
        -1 of rows that are set aside; None where it has neither. Parts of the observations do not have it.
    aside : RowsAside or None
        Rows that the machine file sets aside, which are not here; None where it says nothing of any.
    table : Measurements or None
        As it was given, with the rows that are not here. Parts of the observations do not have it.
    blocks : Blocks or None
        Where these are a sample of more rows, all of them. Parts of the observations do not have it.
    """

    machine: Machine
    data: Measurements
    q: NDArray[np.float64]
    s: NDArray[np.int8]
    v: NDArray[np.float64]
    t: NDArray[np.float64] | None
    load: NDArray[np.float64] | None
    temperature: Mapping[str, NDArray[np.float64]]
    covariates: Mapping[str, NDArray[np.float64]]
    reading: NDArray[np.float64]
    sigma: NDArray[np.float64] | None
    target: NDArray[np.int32]
    run: NDArray[np.int32]
    run_names: tuple[str, ...]
    pose: NDArray[np.int32]
    travel: NDArray[np.float64]
    columns_given: frozenset[str]
    pose_start: NDArray[np.float64] | None = None
    attitude: NDArray[np.float64] | None = None
    arm: float = 1.0
    arm_is_known: bool = True
    counted_as: NDArray[np.int_] | None = None
    correlation: NDArray[np.float64] | None = None
    aside: RowsAside | None = None
    table: Measurements | None = None
    blocks: Any = None

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.q)

    @cached_property
    def coordinates(self) -> NDArray[np.float64]:
        """The coordinates of the joints, (n, J): `q`, unless joints are coupled."""
        return self.machine.coordinates(self.q)

    @cached_property
    def approach_known(self) -> NDArray[np.bool_]:
        """Whether the direction of approach of each joint is known, (J,).

        It is where a column `dir_…` has it. The order of the rows tells it where each row was driven to from the one
        before: not of the directions of stars, which a mount may track, nor of a joint whose position is trimmed, so
        that many of its ways go back by less than a thousandth of its range.
        """
        known = np.empty(len(self.machine.joints), bool)
        for j, joint in enumerate(self.machine.joints):
            ways = np.diff(self.q[:, j])
            ways = ways[ways != 0]
            short = np.abs(ways[1:]) < TRIMMED * np.ptp(self.q[:, j])
            back = ways[1:] * ways[:-1] < 0  # a dense scan has short ways, all of them onwards
            trimmed = np.count_nonzero(short & back) > TRIMS * len(ways)
            ordered = not self.machine.measurand.is_direction and not trimmed
            known[j] = self.s[:, j].any() and (f"dir_{joint.column}" in self.columns_given or ordered)
        return known

    @cached_property
    def approach_assumed(self) -> NDArray[np.bool_]:
        """Whether each joint scans directions to and fro, so that the rows' order is likely that of its motion, (J,).

        Of positions in random order two of three ways turn back; a scan turns back seldom.
        """
        scans = np.zeros(len(self.machine.joints), bool)
        for j in np.flatnonzero(~self.approach_known if self.machine.measurand.is_direction else scans):
            ways = np.diff(self.q[:, j])
            ways = ways[ways != 0]
            turns = np.count_nonzero(ways[1:] * ways[:-1] < 0)
            scans[j] = 0 < turns < len(ways) / 3
        return scans

    @cached_property
    def replicate(self) -> NDArray[np.intp]:
        """The number of each row's replicates, (n,): equal for equal commands, target, directions of approach and load.

        Rows of one pose with one number are repeated readings, those of several poses are replicates.
        """
        load = [] if self.load is None else [self.load]
        return groups([*self.q.T, self.target, *self.s.T, *load], self.n)

    @cached_property
    def basis(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Two unit vectors that complete each measured direction, (n, 3) each: to its left, horizontal, and upwards.

        The first is up × direction, up being against gravity, or any horizontal one where the direction is along it.
        """
        up = -np.asarray(self.machine.gravity)
        left, above = np.empty((self.n, 3)), np.empty((self.n, 3))
        left[:] = np.cross(up, self.reading)
        # Nearer than 2" to the pole the product's rounding would tilt it by more than 1e-11 rad.
        pole = np.einsum("ij,ij->i", left, left) < 1e-10
        left[pole] = np.cross(np.cross(up, np.eye(3)[np.argmin(np.abs(up))]), self.reading[pole])
        left /= np.sqrt(np.einsum("ij,ij->i", left, left))[:, None]
        above[:] = np.cross(self.reading, left)
        return left, above

    def drivers(self, *kinds: Kind) -> list[Driver]:
        """Return what errors may depend on; where kinds are given, only those, in the order of the kinds."""
        every = list(_drivers(self))
        return [driver for kind in kinds for driver in every if driver.kind == kind] if kinds else every

    def demand_rows(self, of: str = "measurement") -> None:
        """Refuse a table without rows, of measurements or of poses.

        Raises
        ------
        InputFileError
        """
        if not self.n:
            raise InputFileError(self.data.file, "file", "no rows", f"at least one {of} under the header")

    @property
    def copies(self) -> int:
        """How many rows of the table are copies of others, and are therefore not here."""
        return 0 if self.counted_as is None else int((self.counted_as >= 0).sum()) - self.n

    @property
    def on_rows(self) -> list[str]:
        """Sentences on rows of the table that are not here: copies, those that are set aside, and those of a scan."""
        sentences = [] if self.aside is None else [self.aside.text]
        if self.copies and self.counted_as is not None:
            sentences.append(
                f"{self.copies} of the {len(self.counted_as)} rows of {os.path.basename(self.data.file)} are copies of "
                "others, their readings included; each is counted once."
            )
        if self.blocks is not None and self.n < self.blocks.rows:
            sentences.append(
                f"The fit is to all {self.blocks.rows} rows; what is decided on single rows is decided on {self.n} of "
                f"them, stretches spread evenly over all."
            )
        return sentences

    @property
    def not_here(self) -> dict[str, Any]:
        """How many rows of the table are copies, and which are set aside, as plain data."""
        nothing = {"rows": 0, "entries": []}
        counts = {"copies": self.copies, "set_aside": self.aside.to_dict() if self.aside else nothing}
        return counts | ({} if self.blocks is None else {"sample": self.n})

    def given(self, rows: NDArray[np.int_]) -> NDArray[np.int_]:
        """Return the numbers, from 0, that rows had in the table as it was given, with those that are not here."""
        if self.blocks is not None:
            return self.data.numbers(rows)
        if self.counted_as is None:
            return rows
        there = np.flatnonzero(self.counted_as >= 0)
        return there[np.unique(self.counted_as[there], return_index=True)[1]][rows]

    def in_table(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which rows of the table as it was given are counted as some of those here, (n,)."""
        return mask if self.counted_as is None else np.isin(self.counted_as, np.flatnonzero(mask))

    def counted(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which rows here, (n,), are counted for some of those of the table as it was given."""
        if self.counted_as is None:
            return mask
        return np.bincount(self.counted_as[mask & (self.counted_as >= 0)], minlength=self.n) > 0

    def without(self, aside: RowsAside | None) -> Observations:
        """Return the observations without rows of their table that are set aside."""
        if aside is None:
            return self
        is_used = ~aside.mask
        if is_used.all():
            return replace(self, aside=aside)
        there, run = np.unique(self.run[is_used], return_inverse=True)
        return replace(
            self.take(is_used),
            run=run.astype(np.int32),
            run_names=tuple(self.run_names[i] for i in there),
            counted_as=np.where(is_used, np.cumsum(is_used) - 1, -1),
            aside=aside,
            table=self.table,
        )

    def counted_once(self) -> Observations:
        """Return the observations without the rows that are copies; see `rodgen.data.poses.originals`."""
        columns = [c.codes if hasattr(c, "codes") else c.values for c in self.data.columns.values()]
        first_of = originals(columns, self.n)
        if first_of is None:
            return self
        once, counted_as = np.unique(first_of, return_inverse=True)
        if self.counted_as is not None:
            counted_as = np.where(self.counted_as < 0, -1, counted_as[self.counted_as])
        return replace(self.take(once), counted_as=counted_as, aside=self.aside, table=self.table)

    def unit_of(self, column: str, usual: str = "") -> tuple[str, float]:
        """Return the unit of a column of the data, `usual` where it states none, and its internal value."""
        unit = self.data.columns[column].unit or usual
        return unit, parse_unit(unit).factor(self.machine.length_unit)

    def read_as(self, source: Observations) -> Observations:
        """Return the observations with the readings of others, row by row."""
        return replace(self, reading=source.reading, attitude=source.attitude, sigma=source.sigma)

    @cached_property
    def colouring(self) -> NDArray[np.float64] | None:
        """What makes independent errors correlated as stated, lower triangles (n, m, m); None where they are not."""
        return None if self.correlation is None else _of_each(np.linalg.cholesky, self.correlation)

    @cached_property
    def whitening(self) -> NDArray[np.float64] | None:
        """What makes correlated errors independent, each in its uncertainty, (n, m, m); None where they are."""
        return None if self.colouring is None else _of_each(np.linalg.inv, self.colouring)

    def take(self, rows: Any) -> Observations:
        """Return some of the rows; numbers of poses and runs stay what they were.

        Parameters
        ----------
        rows : ndarray of bool or int, or slice
            A mask, indices or a slice; a slice copies nothing.
        """

        def some(array: Any) -> Any:
            return None if array is None else _rows(array, rows)

        return Observations(
            machine=self.machine,
            data=self.data.take(rows),
            **{name: some(getattr(self, name)) for name in _BY_ROW},
            temperature={name: some(column) for name, column in self.temperature.items()},
            covariates={name: some(column) for name, column in self.covariates.items()},
            run_names=self.run_names,
            travel=self.travel,
            columns_given=self.columns_given,
            arm=self.arm,
            arm_is_known=self.arm_is_known,
        )

    def arrays(self) -> Iterator[NDArray[Any]]:
        """Yield every array."""
        present = (getattr(self, name) for name in _BY_ROW)
        yield from (array for array in present if array is not None)
        yield from (*self.temperature.values(), *self.covariates.values(), self.travel)

    def _repr_html_(self) -> str:
        return self.data._repr_html_()

    def __repr__(self) -> str:
        return f"Observations({self.machine.name!r}, {self.data!r})"


def _drivers(o: Observations) -> Iterator[Driver]:
    """Yield the drivers of observations, the machine's own first; also those that do not vary."""
    machine, columns = o.machine, o.data.columns
    joints = [_coordinate(o, j) for j in range(len(machine.joints))]
    yield from joints
    for joint, driver in zip(machine.joints, joints, strict=True):
        if joint.period is not None:
            yield replace(
                driver,
                kind="period",
                name=f"{joint.name} within its period",
                text=f"{joint.name} within its period",
                values=driver.values % joint.period,
                noted=driver.noted % (joint.period / driver.scale),
                period=joint.period,
            )

    def of_joint(j: int, kind: Kind, name: str, values: Any, text: str, dimension: Dimension = ONE) -> Driver:
        column = columns.get(name) if kind != "approach" else None
        unit, noted = (column.unit or "", column.values) if column is not None else ("", values)
        return Driver(
            kind,
            name,
            values,
            noted,
            unit,
            text,
            dimension=dimension,
            joint=machine.joints[j].name,
            number=j,
            coordinate=joints[j],
        )

    for j, joint in enumerate(machine.joints):
        # also without a column, where the order of the rows says where a joint came from
        if o.approach_known[j]:
            text = f"the direction of approach of {joint.name}"
            yield of_joint(j, "approach", f"dir_{joint.column}", o.s[:, j], text)
    for j, joint in enumerate(machine.joints):
        if (name := f"v_{joint.column}") in columns:
            text, dimension = f"the velocity of {joint.name}", joints[j].dimension / TIME
            yield of_joint(j, "velocity", name, o.v[:, j], text, dimension)
    if o.load is not None:
        load = columns["load"]
        yield Driver("load", "load", o.load, load.values, load.unit or "", "the load", dimension=FORCE)
    for j, joint in enumerate(machine.joints):
        if joint.name in o.temperature:
            name, values = f"T_{joint.column}", o.temperature[joint.name]
            yield of_joint(j, "temperature", name, values, name, TEMPERATURE)
    for name, values in o.covariates.items():
        unit = columns[name].unit or ""
        dimension = parse_unit(unit).dimension if unit else ONE
        yield Driver("column", name, values, columns[name].values, unit, name, dimension=dimension)
    if o.t is not None:
        t = columns["t"]
        yield Driver("time", "t", o.t, t.values, t.unit or "", "time", dimension=TIME)
    else:
        yield order_of_rows(o)
    targets = tuple(target.name for target in machine.targets)
    yield Driver("target", "target", o.target, o.target, text="the target", categories=targets)
    yield Driver("run", "run", o.run, o.run, text="the run", categories=o.run_names)


def order_of_rows(o: Observations) -> Driver:
    """Return the order of measurement, as the numbers of the rows in their file."""
    order = o.data.numbers(np.arange(o.n)).astype(float)
    return Driver("order", "order", order, order, o.data.counted, "the order of measurement")


def _coordinate(o: Observations, j: int) -> Driver:
    """Return the coordinate of a joint."""
    joint = o.machine.joints[j]
    column = o.data.columns[joint.column]
    return Driver(
        "joint",
        joint.column,
        o.q[:, j],
        column.values,
        column.unit or "",
        joint.column,
        unit_factor(column.unit, o.machine.length_unit)[0] if column.unit else 1.0,
        joint.dimension,
        joint.name,
        j,
        period=2 * np.pi if joint.revolute else None,
    )


_BY_ROW = (
    "q",
    "s",
    "v",
    "t",
    "load",
    "reading",
    "sigma",
    "target",
    "run",
    "pose",
    "pose_start",
    "attitude",
    "correlation",
)


def _rows(array: NDArray[Any], rows: Any) -> NDArray[Any]:
    """Return some rows; what is one value repeated without memory stays so."""
    if array.strides[0] or isinstance(rows, slice):
        return np.asarray(array[rows])
    count = len(np.empty(len(array), np.bool_)[rows])
    return np.broadcast_to(array[0] if len(array) else array, (count, *array.shape[1:]))


def _of_each(function: Any, matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a function makes of each matrix, (n, m, m); of one matrix repeated without memory once."""
    if matrices.strides[0] or not len(matrices):
        return np.asarray(function(matrices))
    return np.broadcast_to(function(matrices[0]), matrices.shape)
