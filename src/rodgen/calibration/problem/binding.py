"""Check measurements against a machine, and convert them to internal units.

The reference of file formats says what each column means, and which may be omitted. Two details are not in it: a joint
that never moves has no direction of approach (0), and a new run does not reset the directions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.assembly_modes import closed
from rodgen.calibration.problem.attitudes import UnfitAttitudeError, matrices
from rodgen.data.measurements import Measurements, Names, Numbers, plain_name
from rodgen.data.notations import ANGULAR
from rodgen.data.poses import approach, poses
from rodgen.data.units import ANGLE, FORCE, LENGTH, ONE, TEMPERATURE, TIME, Dimension, parse_unit
from rodgen.errors import InputFileError, joined, listed, nearest_hint, shown
from rodgen.machines.effects.definition import OF_A_LOOP
from rodgen.machines.measured import MEASURANDS, NOTATIONS, TURNS
from rodgen.machines.observations import Observations
from rodgen.stages import stage

if TYPE_CHECKING:
    from rodgen.machines.machine import Joint, Machine

__all__ = ["bind", "bind_once", "names_of"]

SMALLEST, LARGEST = 1e-100, 1e100
"""Numbers and uncertainties outside this range overflow or underflow: squares of both are summed."""
LARGEST_READING = 1e70
"""The correlation of readings takes fourth powers."""
UNIT_LENGTH_TOLERANCE = 1e-3
"""Largest deviation of a measured direction's length from 1: components rounded to three decimals pass, an azimuth in
the wrong column does not."""

ABSOLUTE_ZERO = -273.15
"""In degrees Celsius."""
TOO_COLD = 200.0
"""Kelvins below the reference at which a temperature on the kelvin scale is taken for a difference of temperatures."""

_QUANTITIES = {
    LENGTH: ("length", "mm"),
    ANGLE: ("angle", "deg"),
    TIME: ("time", "s"),
    FORCE: ("force", "N"),
    TEMPERATURE: ("temperature", "degC"),
    LENGTH / TIME: ("speed", "mm/s"),
    ANGLE / TIME: ("angular speed", "deg/s"),
    LENGTH / TIME**2: ("acceleration", "mm/s^2"),
    ANGLE / TIME**2: ("angular acceleration", "deg/s^2"),
}
"""The name of each dimension in messages, and an example of its units."""

_WORDS_OF_FORMULAS = {
    "q": "the joint's name, such as '{0}'",
    "s": "the joint that it is of, 'dir_{0}'",
    "v": "the joint that it is of, 'v_{0}'",
    "T": "what it is the temperature of, such as 'T_{0} [degC]'",
    "F": "'load [N]'",
}
"""The word of formulas for a column, and the name of the column in the data."""


@stage("reading")
def bind(machine: Machine, data: Any, *, allow_missing_readings: bool = False) -> Observations:
    """Return the observations of a machine: its measurements, checked and in internal units.

    Rows that the machine file sets aside are left out, of measurements; not of poses without readings.

    Parameters
    ----------
    machine : Machine
    data : Measurements, or a table in memory
        As of `rodgen.data.measurements.Measurements.from_frame`.
    allow_missing_readings : bool
        Whether the columns of readings may all be missing, as in a plan of what to measure.

    Returns
    -------
    Observations

    Raises
    ------
    InputFileError
        When a column is missing, has no unit or one that does not fit, is meant for a joint that does not exist, or
        holds an impossible value, or when rows that are set aside are not there.

    Examples
    --------
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     name="Rotary table", length_unit="mm", angle_unit="deg", gravity=(0, 0, -1), reference_temperature=20,
    ...     joints=(Joint("C", "revolute", (0, 0, 1)),), targets=(Target("ball", (120, 0, 40)),),
    ...     measured=Measured("point", "machine"),
    ... )
    >>> data = Measurements.from_frame({"C [deg]": [0, 180], "x [m]": [0.12, -0.12], "y [m]": [0, 0], "z [m]": [0, 0]})
    >>> observations = bind(table, data)
    >>> observations.q.T, observations.reading
    (array([[0.        , 3.14159265]]), array([[ 120.,    0.,    0.],
           [-120.,    0.,    0.]]))
    """
    machine.validate()
    table = data = Measurements.of(data)
    aside = None if allow_missing_readings else machine.aside(data)
    binder = _Binder(machine, data)
    binder.check_names()
    commands = [binder.column(joint.column, *binder.kind(joint)).values for joint in binder.read]
    q = binder.coordinates()
    data = binder.data
    s = binder.approach(q)
    run, run_names = binder.run()
    target = binder.target()
    attitude = binder.attitude(may_be_missing=allow_missing_readings)
    is_pose = machine.measurand.is_pose
    if attitude is None or is_pose:
        reading = binder.reading(may_be_missing=allow_missing_readings)
    else:
        reading = np.ascontiguousarray(attitude[:, :, 2])
    sigma, correlation = binder.sigma(), binder.correlation(may_be_missing=allow_missing_readings)
    if sigma is None and correlation is not None and not allow_missing_readings:
        expected = "columns u_…, or noise in the machine file"
        raise InputFileError(
            data.file, data.header_place, "no uncertainties, while correlation is stated", expected
        )
    arm = 1.0
    if is_pose:
        arm = _arm(machine, q, sigma)
        sigma = None if sigma is None else sigma * np.repeat([1.0, arm], 3)
    load = binder.optional("load", FORCE)
    driven = q if aside is None else q[~aside.mask]
    travel = [
        limits or ((column.min(), column.max()) if data.rows else (0.0, 0.0))
        for limits, column in zip(machine.limits, driven.T, strict=True)
    ]
    observations = Observations(
        machine=machine,
        data=data,
        table=table,
        q=q,
        s=s,
        v=binder.velocities(),
        t=binder.optional("t", TIME),
        load=load,
        temperature=binder.temperatures(),
        covariates=binder.covariates(),
        reading=reading,
        sigma=sigma,
        target=target,
        run=run,
        run_names=run_names,
        pose=poses([*commands, *s.T[binder.approach_stated]], run),
        travel=np.array(travel, dtype=float).reshape(-1, 2),
        columns_given=frozenset(data.columns),
        attitude=attitude,
        correlation=correlation,
        arm=arm,
        arm_is_known=not is_pose or sigma is not None,
    )
    observations = observations.without(aside)
    if machine.kinematics.is_closed:
        observations = closed(observations, by_readings=not allow_missing_readings)
    for array in observations.arrays():
        array.flags.writeable = False
    return observations


def bind_once(machine: Machine, data: Any) -> Observations:
    """Return the observations to fit a machine to, at least one and each once; bound already, they stay as they are.

    Raises
    ------
    InputFileError
        As of `bind`, and when there is no row.
    """
    observations = data if isinstance(data, Observations) else bind(machine, data).counted_once()
    observations.demand_rows()
    return observations


def names_of(machine: Machine) -> frozenset[str]:
    """Return the names of the columns that have a meaning of their own for a machine, or that its effects use."""
    used = {str(of) for term in machine.structure.terms for _, (kind, of) in term.columns if kind == "x"}
    return frozenset(_own_names(machine) | used)


def _own_names(machine: Machine) -> set[str]:
    joints = [joint.column for joint in machine.joints if joint.is_read]
    measurand = machine.measurand
    reserved = {"target", "run", "t", "load", *joints, *(n for n in measurand.columns if n not in TURNS)}
    reserved |= {f"{prefix}{name}" for prefix in ("dir_", "v_", "T_") for name in joints}
    reserved |= {joint.name for joint in machine.joints if not joint.is_read}
    reserved |= {f"u_{name}" for name in measurand.columns} | measurand.read_columns
    if machine.measured.correlation == "columns":
        names = measurand.components
        reserved |= {f"{of}_{a}_{b}" for of in ("corr", "cov") for a in names for b in names}
    return reserved


class _Binder:
    """The columns of measurements in internal units, each checked when it is used."""

    def __init__(self, machine: Machine, data: Measurements) -> None:
        self.machine = machine
        self.data = data
        self.columns: Mapping[str, Any] = data.columns  # Numbers, or Names of a target or run
        self.read = [joint for joint in machine.joints if joint.is_read]
        self.joints = [joint.column for joint in self.read]
        self.uncertain = machine.measurand.columns  # what has columns u_...
        self.readings = tuple(name for name in self.uncertain if name not in TURNS)
        self.own = _own_names(machine)

    # faults --------------------------------------------------------------------------------------------------

    def _wrong_column(self, column: Numbers | Names, found: str, expected: str) -> InputFileError:
        place = f"{self.data.header_place}, column {shown(column.text)}"
        return InputFileError(self.data.file, place, found, expected)

    def _wrong_cell(self, column: Numbers | Names, row: int, found: str, expected: str) -> InputFileError:
        place = f"{self.data.place(row)}, column {shown(column.text)}"
        return InputFileError(self.data.file, place, found, expected)

    def _missing(self, name: str, expected: str) -> InputFileError:
        others = {n: c.text for n, c in self.columns.items() if n not in self.own}
        found = f"no column {name!r}{nearest_hint(name, others)}"
        return InputFileError(self.data.file, self.data.header_place, found, expected)

    def check_names(self) -> None:
        """Refuse probable misspellings: names in another case, or for a joint or reading that does not exist."""
        columns = self.columns
        meant = {name.casefold(): name for name in self.own if name not in columns}
        for name, column in columns.items():
            if name in self.own:
                continue
            if name in _WORDS_OF_FORMULAS:
                expected = _WORDS_OF_FORMULAS[name].format(self.joints[0])
                raise self._wrong_column(column, f"{name!r}, which is a word of formulas", expected)
            if name.casefold() in meant:
                expected = f"{meant[name.casefold()]!r}, in this spelling"
                raise self._wrong_column(column, f"the name {name!r}", expected)
            for prefix, what, names in (
                ("dir_", "joint", self.joints),
                ("v_", "joint", self.joints),
                ("u_", "reading", list(self.uncertain)),
            ):
                if name.startswith(prefix):
                    rest = name.removeprefix(prefix)
                    hint = nearest_hint(rest, {n: n for n in names})
                    expected = f"{prefix!r} with {listed(names)}, or another name for a covariate"
                    raise self._wrong_column(column, f"no {what} {rest!r}{hint}", expected)

    # units ---------------------------------------------------------------------------------------------------

    def kind(self, joint: Joint) -> tuple[Dimension, str]:
        """Return the dimension of a joint's coordinate, and the reason for an error message."""
        what = (
            f"{joint.name} is {OF_A_LOOP[joint.type]}"
            if joint.in_loop
            else f"joint {joint.name} is {joint.type}"
        )
        return joint.dimension, f" ({what})"

    def column(self, name: str, dimension: Dimension, why: str = "") -> Any:
        """Return a column, after checking that it is there and has a unit of this dimension."""
        column = self.columns.get(name)
        if column is None:
            raise self._missing(name, f"one such as '{name} [{_QUANTITIES[dimension][1]}]'{why}")
        return self._checked(column, dimension, why)

    def _checked(self, column: Any, dimension: Dimension, why: str = "") -> Any:
        quantity, example = _QUANTITIES[dimension]
        self._check_numbers(column)
        if column.unit is None:
            expected = f"one in brackets, such as '{column.name} [{example}]'{why}"
            raise self._wrong_column(column, "no unit", expected)
        unit = parse_unit(column.unit)
        if unit.dimension != dimension:
            found = f"unit {shown(column.unit)}, which is not a unit of {quantity}"
            weight = " or kgf" * (dimension == FORCE)  # of a mass in kg
            raise self._wrong_column(column, found, f"a unit of {quantity}, such as {example}{weight}{why}")
        return column

    def _check_numbers(self, column: Any) -> None:
        if hasattr(column, "codes"):
            raise self._wrong_cell(column, 0, shown(column.values[0]), "a number")

    def _unitless(self, column: Any, what: str) -> NDArray[np.float64]:
        self._check_numbers(column)
        if column.unit is not None:
            unit = parse_unit(column.unit)
            if unit.dimension != ONE or unit.factor() != 1.0:
                raise self._wrong_column(column, f"a unit, {shown(column.unit)}", f"none: {what}")
        return column.values  # type: ignore[no-any-return]

    def _scaled(
        self, column: Numbers, out: NDArray[np.float64] | None = None, most: float = LARGEST
    ) -> NDArray[np.float64]:
        """Return a column in internal units, in `out` where it is given; no number of it is above `most`."""
        factor = parse_unit(column.unit).factor(self.machine.length_unit) if column.unit else 1.0
        largest = max(column.values.max(initial=0.0), -column.values.min(initial=0.0))
        if largest > most / factor:
            row = int(np.argmax(np.abs(column.values)))
            found = f"{_number(column, row)}, too large in {self.machine.length_unit}, rad, s, K and N"
            raise self._wrong_cell(column, row, found, "a number of a usual size")
        if out is None and factor == 1.0:
            return column.values
        return np.multiply(column.values, factor, out=out)

    def optional(self, name: str, dimension: Dimension) -> NDArray[np.float64] | None:
        """Return a column in internal units; None where there is no such column."""
        column = self.columns.get(name)
        return None if column is None else self._scaled(self._checked(column, dimension))

    # joints --------------------------------------------------------------------------------------------------

    def coordinates(self) -> NDArray[np.float64]:
        """Return what was commanded, (n, J), with the coordinates of joints that follow; they become columns, too."""
        machine = self.machine
        q = np.empty((self.data.rows, len(machine.joints)))
        for j, joint in enumerate(machine.joints):
            if joint.is_read:
                self._scaled(self.columns[joint.column], q[:, j])
            else:
                q[:, j] = 0.0
        if machine.couplings is None:
            return q
        followed = machine.couplings.coordinates(q)
        computed: dict[str, Numbers] = {}
        for j, (joint, coupling) in enumerate(zip(machine.joints, machine.couplings.of, strict=True)):
            if coupling is None or joint.reading == joint.name:
                continue
            if not joint.is_read:
                q[:, j] = followed[:, j]
            alike = (machine.joints[i] for i in (j, *dict(coupling.factors)))
            units = [
                self.columns[x.column].unit for x in alike if x.is_read and x.dimension == joint.dimension
            ]
            unit = units[0] if units else machine.file_unit(joint.dimension)
            factor = parse_unit(unit).factor(machine.length_unit)
            computed[joint.name] = Numbers(joint.name, unit, followed[:, j] / factor)
        self.columns = {**self.columns, **computed}
        self.data = replace(self.data, columns=self.columns)
        return q

    @property
    def approach_stated(self) -> list[bool]:
        """Whether a column says from which side each joint came: from another side it is another pose."""
        return [joint.is_read and f"dir_{joint.column}" in self.columns for joint in self.machine.joints]

    def approach(self, q: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the directions of approach, (n, J)."""
        s = np.empty(q.shape, np.int8)
        for j, joint in enumerate(self.machine.joints):
            if not self.approach_stated[j]:
                s[:, j] = approach(self.columns[joint.column].values)
                continue
            column = self.columns[f"dir_{joint.column}"]
            values = self._unitless(column, "a direction of approach is +1 or -1, or 0 where it is not known")
            wrong = ~np.isin(values, (-1.0, 0.0, 1.0))
            if wrong.any():
                row = int(np.argmax(wrong))
                raise self._wrong_cell(
                    column, row, _number(column, row), "+1, -1, or 0 where it is not known"
                )
            s[:, j] = values
        return s

    def velocities(self) -> NDArray[np.float64]:
        """Return the velocities, (n, J), zero where there is no column."""
        joints = self.machine.joints
        shape = (self.data.rows, len(joints))
        with_velocity = [j for j, x in enumerate(joints) if x.is_read and f"v_{x.column}" in self.columns]
        if not with_velocity:
            return np.broadcast_to(0.0, shape)
        v = np.empty(shape)
        v[:] = 0.0
        for j in with_velocity:
            dimension, why = self.kind(joints[j])
            self._scaled(self.column(f"v_{joints[j].column}", dimension / TIME, why), v[:, j])
        if self.machine.couplings is not None:
            v = np.where([joint.is_read for joint in joints], v, self.machine.couplings.rates(v))
        return v

    # target and run ------------------------------------------------------------------------------------------

    def target(self) -> NDArray[np.int32]:
        """Return the index of each row's target."""
        names = [target.name for target in self.machine.targets]
        column = self.columns.get("target")
        if column is None:
            if len(names) == 1:
                return np.broadcast_to(np.int32(0), self.data.rows)
            raise self._missing("target", f"one, because the machine has the targets {joined(names)}")
        index = {plain_name(name): i for i, name in enumerate(names)}
        known = np.array([index.get(name, -1) for name in column.names], np.int32)
        numbers: NDArray[np.int32] = known[column.codes]
        if numbers.min(initial=0) < 0:
            row = int(np.argmin(numbers))
            name = column.names[column.codes[row]]
            hint = nearest_hint(name, {n: n for n in names})
            expected = "the machine's target" if len(names) == 1 else "one of the machine's targets"
            raise self._wrong_cell(column, row, f"{shown(name)}{hint}", f"{expected}, {joined(names)}")
        return numbers

    def run(self) -> tuple[NDArray[np.int32], tuple[str, ...]]:
        """Return the index of each row's run, and the names of those that occur."""
        column = self.columns.get("run")
        if column is None:
            return np.broadcast_to(np.int32(0), self.data.rows), ("",)
        used = np.flatnonzero(np.bincount(column.codes, minlength=len(column.names)))
        if len(used) == len(column.names):
            return column.codes, column.names
        new = np.zeros(len(column.names), np.int32)
        new[used] = np.arange(len(used))
        return new[column.codes], tuple(column.names[i] for i in used)

    # readings ------------------------------------------------------------------------------------------------

    def reading(self, *, may_be_missing: bool) -> NDArray[np.float64]:
        """Return the readings, (n, 3) or (n, 1)."""
        columns, measurand = self.columns, self.machine.measurand
        shape = (self.data.rows, len(self.readings))
        missing = [name for name in self.readings if name not in columns]
        if len(missing) == len(self.readings):
            if may_be_missing:
                return np.broadcast_to(np.nan, shape)
            meant = next((m for m in MEASURANDS.values() if all(n in columns for n in m.columns)), None)
            if meant:
                found = f"the readings {joined(meant.columns)}, of the kind {meant.kind!r}"
                expected = f'{joined(self.readings)}: the machine file says kind = "{measurand.kind}"'
                raise InputFileError(self.data.file, self.data.header_place, found, expected)
        reading = np.empty(shape)
        if measurand.has_zero:
            self._scaled(self.column("angle", ANGLE), reading[:, 0], LARGEST_READING)
            return reading
        if not measurand.moving:
            for i, name in enumerate(self.readings):
                column = columns.get(name)
                if column is None:
                    raise self._missing(name, f"{joined(self.readings)}, without a unit")
                reading[:, i] = self._unitless(column, f"{joined(self.readings)} are a vector of length 1")
            return self._normalized(reading)
        for i, name in enumerate(self.readings):
            self._scaled(self.column(name, LENGTH), reading[:, i], LARGEST_READING)
        if measurand.has_origin and reading.min(initial=0.0) < 0.0:
            column, row = columns["d"], int(np.argmax(reading < 0.0))
            expected = "the whole distance, which is positive, not a deviation from a nominal one"
            raise self._wrong_cell(column, row, _number(column, row), expected)
        return reading

    def attitude(self, *, may_be_missing: bool) -> NDArray[np.float64] | None:
        """Return the attitudes of poses as matrices, (n, 3, 3); None where none are measured."""
        if not self.machine.measurand.has_attitude:
            return None
        columns = {
            notation: [name for name in names if name in self.columns]
            for notation, names in NOTATIONS.items()
        }
        used = [notation for notation, names in columns.items() if names]
        if len(used) != 1:
            if not used and may_be_missing:
                return np.broadcast_to(np.eye(3), (self.data.rows, 3, 3))
            found = (
                f"attitudes in {len(used)} notations, {joined(used)}" if used else "no columns of an attitude"
            )
            expected = "one of " + "; ".join(", ".join(names) for names in NOTATIONS.values())
            raise InputFileError(self.data.file, self.data.header_place, found, expected)
        (notation,) = used
        names = NOTATIONS[notation]
        numbers = np.empty((self.data.rows, len(names)))
        for i, name in enumerate(names):
            if name not in self.columns:
                raise self._missing(name, f"all of {joined(names)}")
            if notation in ANGULAR:
                self._scaled(self.column(name, ANGLE), numbers[:, i])
            else:
                numbers[:, i] = self._unitless(self.columns[name], f"{joined(names)} are a {notation}")
        try:
            return matrices(notation, numbers)
        except UnfitAttitudeError as error:
            place = f"{self.data.place(error.row)}, columns {joined(names)}"
            raise InputFileError(self.data.file, place, error.found, error.expected) from None

    def _normalized(self, reading: NDArray[np.float64]) -> NDArray[np.float64]:
        length = np.sqrt(np.einsum("ij,ij->i", reading, reading))
        wrong = ~(np.abs(length - 1.0) <= UNIT_LENGTH_TOLERANCE)
        if wrong.any():
            row = int(np.argmax(wrong))
            place = f"{self.data.place(row)}, columns {joined(self.readings)}"
            expected = f"a length of 1 within {UNIT_LENGTH_TOLERANCE:g}"
            raise InputFileError(self.data.file, place, f"a direction of length {length[row]:.6g}", expected)
        reading /= length[:, None]
        return reading

    def sigma(self) -> NDArray[np.float64] | None:
        """Return the standard uncertainties of the readings, None where they are not stated."""
        measured = self.machine.measured
        turns = measured.attitude_noise if self.machine.measurand.moving else measured.noise
        noises = [turns if name in TURNS else measured.noise for name in self.uncertain]
        shape = (self.data.rows, len(self.uncertain))
        if self._has_covariance:
            variances = [self._covariance(name, name) for name in self.machine.measurand.components]
            return np.sqrt(np.stack(variances, axis=-1))
        stated = [name for name in self.uncertain if f"u_{name}" in self.columns]
        if not stated:
            if noises[0] is None:
                return None
            # one number for all is kept as one, whatever is taken of the rows
            return np.broadcast_to(np.array(noises if len(set(noises)) > 1 else noises[0], float), shape)
        sigma = np.empty(shape)
        for i, (name, noise) in enumerate(zip(self.uncertain, noises, strict=True)):
            column = self.columns.get(f"u_{name}")
            if column is None:
                if noise is None:
                    every = joined(f"u_{component}" for component in self.uncertain)
                    expected = f"all of {every}, or noise in the machine file"
                    raise self._missing(f"u_{name}", expected)
                sigma[:, i] = noise
                continue
            if name in TURNS:
                self._checked(column, ANGLE)
            elif self.machine.measurand.moving:
                self._checked(column, LENGTH)
            elif column.unit is not None:
                self._checked(column, ANGLE)
            self._scaled(column, sigma[:, i])
            usual = (sigma[:, i] > SMALLEST) & (sigma[:, i] < LARGEST)
            if not usual.all():
                row = int(np.argmin(usual))
                raise self._wrong_cell(column, row, _number(column, row), "a positive uncertainty")
        return sigma

    def correlation(self, *, may_be_missing: bool) -> NDArray[np.float64] | None:
        """Return the correlation of the errors of each reading, (n, m, m); None where they are independent."""
        stated, names = self.machine.measured.correlation, self.machine.measurand.components
        if stated is None:
            return None
        shape = (self.data.rows, len(names), len(names))
        if stated != "columns":
            return np.broadcast_to(np.array(stated, float), shape)
        correlations = np.empty(shape)
        correlations[:] = np.eye(len(names))
        of = "cov" if self._has_covariance else "corr"
        wanted = [(i, j, f"{of}_{names[i]}_{names[j]}") for j in range(len(names)) for i in range(j)]
        if may_be_missing and not any(name in self.columns for _, _, name in wanted):
            return correlations
        for i, j, name in wanted:
            if self._has_covariance:
                values = self._covariance(names[i], names[j])
                scale = self._covariance(names[i], names[i]) * self._covariance(names[j], names[j])
                values = values / np.sqrt(scale)
            else:
                if name not in self.columns:
                    raise self._missing(name, 'one, because [measured] says correlation = "columns"')
                values = self._unitless(self.columns[name], "a correlation coefficient is a number")
            correlations[:, i, j] = correlations[:, j, i] = values
        wrong = ~(np.linalg.eigvalsh(correlations)[:, 0] > 0)
        if wrong.any():
            row = int(np.argmax(wrong))
            place = f"{self.data.place(row)}, columns {joined([name for _, _, name in wanted])}"
            expected = "coefficients between -1 and 1 of a matrix that is"
            raise InputFileError(
                self.data.file, place, "a correlation that is not positive definite", expected
            )
        return correlations

    @property
    def _has_covariance(self) -> bool:
        """Whether the data have a covariance for each reading."""
        first = self.machine.measurand.components[0]
        return self.machine.measured.correlation == "columns" and f"cov_{first}_{first}" in self.columns

    def _covariance(self, a: str, b: str) -> NDArray[np.float64]:
        """Return a column of covariances of two components of a reading, internal units."""
        name = f"cov_{a}_{b}"
        dimension, example = self._product(a, b)
        column = self.columns.get(name)
        if column is None:
            raise self._missing(name, f"one such as '{name} [{example}]', as of every pair")
        self._check_numbers(column)
        if column.unit is None or parse_unit(column.unit).dimension != dimension:
            found = "no unit" if column.unit is None else f"unit {shown(column.unit)}"
            raise self._wrong_column(column, found, f"one of a product such as {example}")
        values = self._scaled(column)
        if a == b and not (values > SMALLEST**2).all():
            row = int(np.argmin(values))
            raise self._wrong_cell(column, row, _number(column, row), "a positive variance")
        return values

    def _product(self, a: str, b: str) -> tuple[Dimension, str]:
        """Return the dimension of a covariance of two components, and a unit of it."""
        turns = [name in TURNS or not self.machine.measurand.moving for name in (a, b)]
        dimensions, units = zip(*((ANGLE, "rad") if t else (LENGTH, "mm") for t in turns), strict=True)
        return dimensions[0] * dimensions[1], f"{units[0]}^2" if turns[0] == turns[1] else "*".join(units)

    # the rest ------------------------------------------------------------------------------------------------

    def temperatures(self) -> dict[str, NDArray[np.float64]]:
        """Return the temperature of each joint that has one."""
        columns = self.data.columns
        return {
            joint.name: self._temperature(columns[f"T_{joint.column}"])
            for joint in self.machine.joints
            if f"T_{joint.column}" in columns
        }

    def _temperature(self, column: Any) -> NDArray[np.float64]:
        """Return a column of temperatures in kelvins from the machine's reference."""
        unit = parse_unit(self._checked(column, TEMPERATURE).unit or "")
        values = self._scaled(column)
        if unit.text.startswith(("delta", "Δ")):
            return values
        celsius = values + (ABSOLUTE_ZERO if unit.zero is None else float(unit.zero))
        if celsius.min(initial=0.0) < ABSOLUTE_ZERO - 1e-9:
            row = int(np.argmin(celsius))
            found = f"{_number(column, row)} {column.unit}, below absolute zero"
            raise self._wrong_cell(column, row, found, "a temperature, or delta_degC for a difference")
        reference = self.machine.reference_temperature
        celsius -= reference
        if unit.zero is None and celsius.min(initial=0.0) < -TOO_COLD:
            row = int(np.argmin(celsius))
            found = f"{_number(column, row)} {column.unit}, far below the reference of {reference:g} degC"
            expected = (
                "a temperature (delta_degC for a difference), or another reference_temperature in the machine"
            )
            raise self._wrong_cell(column, row, found, expected)
        return celsius

    def covariates(self) -> dict[str, NDArray[np.float64]]:
        """Return every column of numbers without a meaning of its own."""
        covariates = {}
        accelerations = {f"a_{joint.column}": joint for joint in self.read}
        for name, column in self.columns.items():
            if name in self.own or hasattr(column, "codes"):
                continue
            if name in accelerations:
                dimension, why = self.kind(accelerations[name])
                covariates[name] = self._scaled(self.column(name, dimension / TIME**2, why))
                continue
            is_temperature = name.startswith("T_")
            is_temperature |= column.unit is not None and parse_unit(column.unit).dimension == TEMPERATURE
            covariates[name] = self._temperature(column) if is_temperature else self._scaled(column)
        return covariates


def _arm(machine: Machine, q: NDArray[np.float64], sigma: NDArray[np.float64] | None) -> float:
    """Return the lever arm at which the noise of attitudes is as large as that of positions.

    Where no noise is stated, one to begin with: the size of the machine, as if all errors were turns of its joints.
    """
    if sigma is not None and len(sigma):
        return float(np.sqrt(np.mean(sigma[:, :3] ** 2) / np.mean(sigma[:, 3:] ** 2)))
    points = np.array([x.point for of in (machine.joints, machine.targets) for x in of])
    slides = [j for j, joint in enumerate(machine.joints) if not joint.revolute]
    travel = np.ptp(q[:, slides], axis=0).max(initial=0.0) if len(q) else 0.0
    return float(max(np.ptp(points, axis=0).max(), travel)) or 1.0


def _number(column: Any, row: int) -> str:
    return f"{column.values[row]:.12g}"
