"""Make up measurements of a machine, with effects that its file does not know: to try the tools on oneself.

A design is a measurement file that needs no readings: what is commanded, when, with which load. The machine, as its
file says or as it was fitted, goes through it with the effects, and an instrument with normal noise reads. What is
hidden in the data is the truth, which is kept apart.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.problem.attitudes import attitude_columns
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.simulate.simulator import Simulator, with_reading
from rodgen.data.measurements import Measurements, Numbers
from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError
from rodgen.files import read_input
from rodgen.machines.rules import UnfitEffectError
from rodgen.machines.typed_effects import effect_with, typed_effect

if TYPE_CHECKING:
    from rodgen.machines.machine import Effect, Machine
    from rodgen.machines.observations import Observations

DIGITS = 3
"""Readings are written to so many decimals below the noise."""


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
        The same seed gives the same data; left out, it is drawn, and stands in the truth.

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
        found = simulator.known(effect, run) or simulator.drawn(effect)
        if found is None:
            raise InputFileError(
                "effect",
                effect.title,
                "values that are to be drawn, while nothing of it would show in this design",
                "another effect, or its values",
            )
        known.append(found)
    if hidden:
        known.append(simulator.drawn_of_catalogue(known))
    exact = simulator.read(known)
    columns = _columns(design, machine, simulator.noisy(exact), simulator.sigma)
    readings = machine.measurand.read_columns
    given = {name: column for name, column in design.columns.items() if name not in readings}
    ordered = {name: columns.get(name) or given[name] for name in design.columns}
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
    found = {}
    if read.attitude is not None:
        for text, values in attitude_columns(read.attitude, design, machine.angle_unit).items():
            name, _, written = text.rstrip("]").partition(" [")
            found[name] = Numbers(name, written or None, values)
        if not machine.measurand.moving:
            return found
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
        found[name] = Numbers(name, unit, np.round(rounded, decimals) if 0 <= decimals <= 15 else rounded)
    return found


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
