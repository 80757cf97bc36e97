"""Make up measurements of a machine, with effects that its file does not know: to try the tools on oneself.

A design is a measurement file that needs no readings: what is commanded, when, with which load. The machine, as its
file says or as it was fitted, goes through it with the effects, and an instrument with normal noise reads. What is
hidden in the data is the truth, which is kept apart.
"""

from __future__ import annotations

import json
import math
import os
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fit import fit
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.assembly_modes import open_legs
from rodgen.calibration.problem.attitudes import attitude_columns
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements, Numbers
from rodgen.data.units import ANGLE, ARCSEC, TIME, UnitError, parse_unit, typed_quantity, unit_factor
from rodgen.errors import InputFileError, RodgenError, counted, listed
from rodgen.files import read_input
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.machines.parameters import Parameter
from rodgen.machines.plausibility import plausibility
from rodgen.machines.rigid import rotation_matrix, rotation_vector
from rodgen.machines.rules import UnfitEffectError
from rodgen.machines.typed_effects import effect_with, typed_effect

DIGITS = 3
"""Readings are written to so many decimals below the noise."""
TRIAL = 1e-3
"""Part of a usual size at which the effect on the readings is measured."""
VISIBLE = (2.0, 5.0)
"""A drawn effect leaves so many times the noise once the machine's own fit has taken what it can."""
MOSTLY_ABSORBED = 5.0
"""Its effect on the readings may be this many times what a fit leaves of it."""
FEWEST_PLACES = 16
"""Different coordinates of a joint that a drawn period needs."""
LOOKED_AT = 20_000
"""Rows by which sizes are measured."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Made-up measurements.

    Attributes
    ----------
    data : Measurements
        The design with readings.
    columns : mapping of str to ndarray
        The readings by the names of their columns, with the unit, such as ``"x [mm]"``.
    replaced : mapping of str to str
        Names of columns of the design, with their units, and which of `columns` stands there instead.
    truth : dict
        What is hidden in them, as plain data.
    """

    data: Measurements
    columns: Mapping[str, Array]
    replaced: Mapping[str, str]
    truth: Mapping[str, Any]

    def _repr_html_(self) -> str:
        return self.data._repr_html_()


def simulate(
    machine: Machine,
    design: Any,
    effects: Sequence[str | Effect] = (),
    *,
    hidden: bool = False,
    noise: float | str | None = None,
    seed: int | None = None,
) -> Simulation:
    """Make up measurements.

    Parameters
    ----------
    machine : Machine
        With its fitted values, if it has some. What it estimates and has no value for is zero, and the measuring frame
        is its own.
    design : Measurements or a table in memory
        As a measurement file; the columns of readings may be missing, and what stands there does not matter.
    effects : sequence of str or Effect
        Texts such as ``"encoder_eccentricity@C:a=12arcsec,b=3arcsec"``, whose numbers without a unit are in the units
        of the machine file, or effects with their values in ``hold``. Parameters that are not mentioned are zero; where
        none is, all are drawn so that the effect shows.
    hidden : bool
        Draw one more effect from the catalogue, which shows in this design.
    noise : float or str, optional
        Standard deviation of a scalar reading, such as ``"2um"``, or a number in the machine file's length unit (for
        directions in arcsec); of poses two, such as ``"0.02mm, 20arcsec"``. Left out: what data or machine state, else
        none.
    seed : int, optional
        The same seed gives the same data; left out, it is drawn, and is in the truth.

    Returns
    -------
    Simulation

    Raises
    ------
    InputFileError
        When the design does not fit the machine, an effect cannot stand there, or its column is missing.
    RodgenError
        When nothing of the catalogue shows, or an effect is to be drawn while the noise is not known.

    Examples
    --------
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
    ... )
    >>> design = Measurements.from_frame({"C [deg]": [0.0, 90.0]})
    >>> simulate(table, design, ["zero_offset@C:a=0.1deg"], seed=1).columns["y [mm]"].round(4).tolist()
    [0.1745, 99.9998]
    """
    if seed is None:
        seed = int(np.random.SeedSequence().entropy) % 2**32  # type: ignore[arg-type]
    design = Measurements.of(design)
    bound = bind(machine, design, allow_missing_readings=True)
    bound.demand_rows("pose")
    simulator = Simulator(
        machine, with_reading(bound, np.eye(3)[:1] if bound.reading.shape[1] == 3 else 0.0), noise, seed
    )
    known = []
    for each in effects:
        effect, run = _effect(machine, each) if isinstance(each, str) else (each, None)
        drawn = simulator.known(effect, run) or simulator.drawn(effect)
        if drawn is None:
            raise InputFileError(
                "effect",
                effect.title,
                "values that are to be drawn, while nothing of it would show in this design",
                "another effect, or its values",
            )
        known.append(drawn)
    if hidden:
        known.append(simulator.drawn_of_catalogue(known))
    exact = simulator.read(known)
    columns = _columns(design, machine, simulator.noisy(exact), simulator.sigma)
    readings = machine.measurand.read_columns
    commanded = {name: column for name, column in design.columns.items() if name not in readings}
    ordered = {name: columns.get(name) or commanded[name] for name in design.columns}
    truth = {
        "machine": machine.file or machine.name,
        "design": design.file,
        "seed": seed,
        "noise": simulator.noise_as_dict(),
        "effects": [simulator.as_dict(each) for each in known],
        "change": simulator.change(exact),
    }
    return Simulation(
        data=replace(design, columns=ordered | columns),
        columns={column.text: column.values for column in columns.values()},
        replaced={
            design.columns[name].text: column.text
            for name, column in columns.items()
            if name in design.columns
        },
        truth=truth,
    )


def _effect(machine: Machine, text: str) -> tuple[Effect, str | None]:
    """Return an effect of the catalogue with its typed values in `hold`, and the set-up that they are of."""
    try:
        typed = typed_effect(text)
        return effect_with(machine, typed.name, typed.place, typed.numbers), typed.run
    except UnfitEffectError as error:
        raise InputFileError("effect", text, error.found, error.expected) from None


def _columns(
    design: Measurements, machine: Machine, read: Observations, sigma: Array | None
) -> dict[str, Numbers]:
    """Return the columns of readings, in the units that the design has for them, to a thousandth of the noise."""
    columns = {}
    if read.attitude is not None:
        for text, values in attitude_columns(read.attitude, design, machine.angle_unit).items():
            name, _, written = text.rstrip("]").partition(" [")
            columns[name] = Numbers(name, written or None, values)
        if not machine.measurand.moving:
            return columns
    for name, values in zip(machine.measurand.columns, read.reading.T, strict=False):
        unit = None
        factor = 1.0
        if machine.measurand.has_zero:
            unit = getattr(design.columns.get(name), "unit", None) or machine.angle_unit
            factor = parse_unit(unit).factor()
        elif machine.measurand.moving:
            unit = getattr(design.columns.get(name), "unit", None) or machine.length_unit
            factor = parse_unit(unit).factor(machine.length_unit)
        noise = 0.0 if sigma is None else float(np.min(sigma)) / factor
        decimals = math.ceil(-math.log10(noise)) + DIGITS if noise > 0 else 17
        rounded = values / factor
        columns[name] = Numbers(name, unit, np.round(rounded, decimals) if 0 <= decimals <= 15 else rounded)
    return columns


@dataclass(frozen=True)
class Hidden:
    """An effect with the values of its parameters, by key, internal units."""

    effect: Effect
    values: Mapping[str, float]


def with_reading(observations: Observations, reading: Any) -> Observations:
    """Return observations with other readings, which may be one for all rows."""
    return replace(observations, reading=np.broadcast_to(reading, observations.reading.shape))


def _difference(of: Observations, to: Observations) -> Array:
    """Return how readings differ, (n, m), internal units; turns of poses as lengths on their arm."""
    difference = of.reading - to.reading
    if of.attitude is None or to.attitude is None:
        return difference
    turns = of.arm * rotation_vector(of.attitude @ to.attitude.swapaxes(1, 2))
    return np.concatenate([difference, turns], axis=1) if of.machine.measurand.moving else turns


class Simulator:
    """A machine with a design.

    Parameters
    ----------
    observations : Observations
        The design; its readings do not matter, but that they are finite.
    noise : float, str or None
        Typed, in the machine's length unit, or arcsec for directions; of poses a text with two, of a coordinate and of
        a turn. None: what is stated.

    Attributes
    ----------
    sigma : ndarray or None
        Standard deviations of the readings, internal units; None where nothing is known of them.
    unit : str
        Of a scalar reading.
    """

    def __init__(
        self, machine: Machine, observations: Observations, noise: float | str | None, seed: int
    ) -> None:
        self.machine = machine
        self.observations = observations
        self.random = np.random.default_rng(seed)
        self.unit = machine.measurand.unit(machine.length_unit)
        self.unit_factor, _ = unit_factor(self.unit, machine.length_unit)
        self.sigma = observations.sigma if noise is None else self._typed(noise)
        step = -(-observations.n // LOOKED_AT)
        self.some = observations if step <= 1 else observations.take(slice(None, None, step))

    def _typed(self, noise: float | str) -> Array:
        """Return a typed noise in internal units, (1, 1), or of poses (1, 6)."""
        if not self.machine.measurand.is_pose:
            return np.array([[self._noise(noise, self.unit)]])
        parts = str(noise).split(",")
        if len(parts) != 2:
            expected = "that of a coordinate and that of a turn, such as '0.02mm, 20arcsec'"
            raise InputFileError("noise", str(noise), counted(len(parts), "number"), expected)
        place, turn = (
            self._noise(text, unit) for text, unit in zip(parts, (self.unit, "arcsec"), strict=True)
        )
        return np.repeat([place, turn * self.observations.arm], 3)[None]

    def _noise(self, noise: float | str, without: str) -> float:
        """Return a typed noise in internal units; `without` is the unit of a number without one."""
        factor, dimension = unit_factor(without, self.machine.length_unit)
        if not isinstance(noise, str):
            return float(noise) * factor
        expected = f"a number from 0 up with its unit, such as {'0.5arcsec' if dimension == ANGLE else '2um'}"
        try:
            number = typed_quantity(noise.strip(), dimension, self.machine.length_unit, factor)
        except UnitError as error:
            raise InputFileError("noise", noise, error.found, expected) from None
        if number < 0:
            raise InputFileError("noise", noise, "no such number", expected)
        return number

    # readings ------------------------------------------------------------------------------------------------

    def read(self, effects: Sequence[Hidden], observations: Observations | None = None) -> Observations:
        """Return the observations with readings without noise."""
        o = observations or self.observations
        machine = self.machine
        for each in effects:
            machine = machine.with_effect(replace(each.effect, hold={}))
            machine = replace(machine, values={**machine.values, **each.values})
        model = Model(machine, o.travel, o.run_names)
        problem = Problem(model, o)
        theta, frame = model.start(), Frame.identity()
        readings = problem.predicted_observations(theta, frame)
        bad = ~np.isfinite(readings.reading).all(axis=1)
        if bad.any():
            row = int(np.argmax(bad))
            if machine.kinematics.is_closed:
                raise open_legs(o, row, "the machine with these effects")
            expected = "formulas and numbers that are"
            raise InputFileError(o.data.file, o.data.place(row), "the model is not finite here", expected)
        return readings

    def noisy(self, exact: Observations) -> Observations:
        """Return readings with noise."""
        if self.sigma is None:
            return exact
        if exact.attitude is not None:
            noise = self.sigma * self._errors(exact)
            turned = rotation_matrix(noise[:, -3:] / exact.arm) @ exact.attitude
            read = exact.reading + noise[:, :3] if self.machine.measurand.moving else turned[:, :, 2]
            return replace(exact, reading=read, attitude=turned)
        if not self.machine.measurand.is_direction:
            noise = self.sigma * self._errors(exact)
            return replace(exact, reading=exact.reading + noise)
        variance = np.broadcast_to(self.sigma**2, exact.reading.shape)
        read = exact.reading.copy()
        for across in exact.basis:
            spread = np.sqrt(np.sum(across**2 * variance, axis=1))
            read += across * (spread * self.random.normal(size=exact.n))[:, None]
        return replace(exact, reading=np.asarray(read / np.linalg.norm(read, axis=1, keepdims=True)))

    def _errors(self, o: Observations) -> Array:
        """Return normal errors of deviation 1, (n, m), correlated as is stated."""
        drawn = self.random.normal(size=(o.n, len(self.machine.measurand.components)))
        return drawn if o.colouring is None else np.einsum("nij,nj->ni", o.colouring, drawn)

    def _rms(self, change: Array) -> float:
        """Return the root mean square of a change, per scalar reading, internal units."""
        scalars = len(self.machine.measurand.components)
        return float(np.sqrt(np.sum(change**2) / max(len(change) * scalars, 1)))

    def _left(self, read: Observations) -> float:
        """Return what the machine's own fit leaves of readings of `some` rows, internal units."""
        return fit(self.machine, replace(read, arm_is_known=True)).rms * self.unit_factor

    def change(self, exact: Observations) -> dict[str, Any]:
        """Return by how much the effects change the readings, and what a fit without them leaves of that."""
        some = exact.take(slice(None, None, -(-exact.n // LOOKED_AT) or 1))
        unchanged = self.read([], self.some)
        return {
            "rms": self._rms(_difference(some, unchanged)) / self.unit_factor,
            "left_by_a_fit": self._left(some) / self.unit_factor,
            "unit": self.unit,
        }

    # effects -------------------------------------------------------------------------------------------------

    def _parameters(self, effect: Effect) -> list[Parameter]:
        """Return the parameters of an effect, without weights at later joints."""
        machine = self.machine.with_effect(replace(effect, hold={}))
        found = Model(machine, self.observations.travel, self.observations.run_names).parameters
        return [p for p in found if (p.effect, p.place) == effect.identity]

    def known(self, effect: Effect, run: str | None) -> Hidden | None:
        """Return an effect whose values are given in `hold`; None where none is."""
        self.machine.with_effect(effect)  # the rules for what is held
        parameters = {p.key: p for p in self._parameters(effect)}
        runs = self.observations.run_names
        prefix = effect.key("") if run is None else f"{effect.key('')}[{run}]"
        if run is not None and not any(key.startswith(f"{prefix}.") for key in parameters):
            found = f"{effect.name}[{run}]"
            expected = (
                "a set-up in the column 'run', of frame_shift alone, or of target_remounting but the first"
            )
            raise InputFileError("effect", effect.title, found, expected)
        if not effect.hold:
            return None
        if run is None and effect.definition.per_run and len(runs) > 1:
            found, expected = (
                "no set-up",
                f"{listed(runs)}, such as {effect.name}[{runs[-1]}]:{next(iter(effect.hold))}=0.1",
            )
            raise InputFileError("effect", effect.title, found, expected)
        values = {f"{prefix}.{name}": value for name, value in effect.hold.items()}
        for key, parameter in parameters.items():
            if parameter.searched and key not in values:
                name = key.rpartition(".")[2]
                raise InputFileError("effect", effect.title, f"no {name}", f"its value, in {parameter.unit}")
        return Hidden(effect, values)

    def drawn_of_catalogue(self, others: Sequence[Hidden]) -> Hidden:
        """Return an effect of the catalogue that shows in this design."""
        effects = catalogue_effects(self.machine, self.observations)
        taken = {each.effect.identity for each in others}
        for i in self.random.permutation(len(effects)):
            drawn = None if effects[i].identity in taken else self.drawn(effects[i])
            if drawn is not None:
                return drawn
        raise RodgenError(f"{self.observations.data.file}: no effect of the catalogue shows in this design")

    def drawn(self, effect: Effect) -> Hidden | None:
        """Return an effect of such a size that it shows after a fit without it; None where no possible one does."""
        noise = 0.0 if self.sigma is None else float(np.sqrt(np.mean(self.sigma**2)))
        if not noise > 0:
            raise RodgenError(
                f"{self.observations.data.file}: noise that is not known, for an effect whose size is drawn; "
                "expected noise in the machine file, columns u_…, or --noise"
            )
        parameters, usual = self._parameters(effect), plausibility(self.machine, effect).sizes
        fixed = {p.key: self._searched(p) for p in parameters if p.searched}
        if not all(math.isfinite(value) for value in fixed.values()):
            return None
        free = [p.key for p in parameters if not (p.searched or p.optional or p.hold is not None)]
        known = {key: usual.get(key.rpartition(".")[2]) for key in free}
        drawn = {key: self.random.normal() * (size.usual if size else 1.0) for key, size in known.items()}
        unchanged = self.read([], self.some)

        def scaled(factor: float) -> Hidden:
            return Hidden(effect, fixed | {key: factor * size for key, size in drawn.items()})

        def change(factor: float) -> tuple[Observations, float]:
            read = self.read([scaled(factor)], self.some)
            return read, self._rms(_difference(read, unchanged))

        # of noise size first: large ones would not be in proportion
        _, small = change(TRIAL)
        if not small > 0:
            return None
        factor = TRIAL * noise / small
        read, changed = change(factor)
        left = self._left(read)
        if not left * MOSTLY_ABSORBED > changed:
            return None
        factor *= self.random.uniform(*VISIBLE) * noise / left
        possible = all(not size or abs(factor * drawn[key]) <= size.largest for key, size in known.items())
        return scaled(factor) if possible else None

    def _searched(self, parameter: Parameter) -> float:
        """Draw a time constant or a period; NaN where the design shows none."""
        o = self.observations
        if unit_factor(parameter.unit, self.machine.length_unit)[1] == TIME:
            span = 0.0 if o.t is None or not len(o.t) else float(np.ptp(o.t))
            return span * float(self.random.uniform(0.15, 0.5)) if span > 0 else math.nan
        joint = self.machine.number_of(str(parameter.place))
        places = np.unique(o.q[:, joint])
        if len(places) < FEWEST_PLACES:
            return math.nan
        waves = math.exp(self.random.uniform(math.log(3), math.log(len(places) / 4)))
        return float(np.ptp(places)) / waves

    # what is hidden -----------------------------------------------------------------------------------------------

    def as_dict(self, hidden: Hidden) -> dict[str, Any]:
        """Return an effect with its values as plain data."""
        parameters = {p.key: p for p in self._parameters(hidden.effect)}
        definition = hidden.effect.definition
        return {
            "effect": hidden.effect.name,
            "place": hidden.effect.place,
            "parameters": {
                key: {"value": value / parameters[key].factor, "unit": parameters[key].unit}
                for key, value in hidden.values.items()
            },
            "meaning": definition.meaning,
            "remedy": definition.remedy,
        }

    def noise_as_dict(self) -> dict[str, Any]:
        """Return the noise as plain data."""
        if self.sigma is None:
            return {"rms": 0.0, "unit": self.unit}
        content = {
            "rms": float(np.sqrt(np.mean(self.sigma[:, :3] ** 2))) / self.unit_factor,
            "unit": self.unit,
        }
        if self.machine.measurand.is_pose:
            turns = self.sigma[:, 3:] / self.observations.arm / ARCSEC
            content |= {"rms_of_turns": float(np.sqrt(np.mean(turns**2))), "unit_of_turns": "arcsec"}
        return content


# The truth behind simulated measurements, in a file of its own: plain JSON, to be read when the answer is there.


TRUTH_FILE = "a file that 'rodgen simulate --truth' wrote"
NOTE = "What is hidden in the data. Read it when you have your answer: rodgen simulate --open TRUTH.json"


def truth_as_json(truth: Mapping[str, Any]) -> str:
    """Return a truth as the text of a JSON file.

    Examples
    --------
    >>> json.loads(truth_as_json({"effects": []}))["truth"]
    {'effects': []}
    """
    return json.dumps({"note": NOTE, "truth": truth}, indent=2, allow_nan=False) + "\n"


def read_truth(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the truth that a file holds.

    Raises
    ------
    InputFileError
        When the file holds none.
    """
    file = os.fspath(path)
    content = read_input(file, TRUTH_FILE)
    try:
        truth = json.loads(content)["truth"]
        if not isinstance(truth["effects"], list):
            raise TypeError
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputFileError(file, "file", "no truth of a simulation", TRUTH_FILE) from None
    return dict(truth)


def truth_as_text(truth: Mapping[str, Any], file: str) -> str:
    """Return a truth that was read from a file as sentences.

    Raises
    ------
    InputFileError
        When a part of it is not there.
    """
    try:
        return "\n".join(_lines(truth))
    except (ValueError, TypeError, KeyError, AttributeError):
        raise InputFileError(file, "file", "no whole truth of a simulation", TRUTH_FILE) from None


def _lines(truth: Mapping[str, Any]) -> Iterator[str]:
    noise, change = truth["noise"], truth["change"]
    noise_text = f"noise {noise['rms']:.3g} {noise['unit']}"
    yield f"{truth['machine']} through {truth['design']}, seed {truth['seed']}, {noise_text}"
    if not truth["effects"]:
        yield "Nothing is hidden: noise alone."
    for effect in truth["effects"]:
        at = f" at {effect['place']}" if effect["place"] else ""
        yield f"{effect['effect']}{at}"
        for key, number in effect["parameters"].items():
            unit = "" if number["unit"] == "1" else f" {number['unit']}"
            yield f"  {key}  {number['value']:.6g}{unit}"
        yield from textwrap.wrap(effect["meaning"], 100, initial_indent="  ", subsequent_indent="  ")
    if truth["effects"]:
        yield (
            f"A reading changes by {change['rms']:.3g} {change['unit']} (rms), of which a fit of the machine without "
            f"it leaves {change['left_by_a_fit']:.3g}."
        )
