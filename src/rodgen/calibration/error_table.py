"""The errors of models, one after the other, with the odds for each and the noise: the one table of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from rodgen.calibration.words import three_digits
from rodgen.data.units import readable
from rodgen.document import Table

if TYPE_CHECKING:
    from rodgen.calibration.noise_floor import NoiseFloor

THE_FILE = "the file"
"""The model that a machine file describes, before anything is added."""


class Model(NamedTuple):
    """A model: what it has more than the one before, its errors and the odds for it in words."""

    title: str
    rms: float
    rms_held_out: float | None
    odds: str = ""
    rms_test: float | None = None
    """On further measurements."""
    parameters: int | None = None
    """How many are estimated."""


def error_table(models: Sequence[Model], unit: str, noise: NoiseFloor | None) -> Table:
    """Return the errors of models, then the noise where it is known.

    Parameters
    ----------
    models : sequence of Model
    unit : str
        Of their errors.
    noise : NoiseFloor or None
    """
    factor, readable_unit = readable(unit, max(model.rms for model in models))

    def size(value: float | None) -> str:
        return "–" if value is None else three_digits(value * factor)

    header = [f"rms in {readable_unit} per reading", "fitted", "held out"]
    rows = [[model.title, size(model.rms), size(model.rms_held_out)] for model in models]
    more = {
        "test file": [None if m.rms_test is None else size(m.rms_test) for m in models],
        "parameters": [None if m.parameters is None else str(m.parameters) for m in models],
    }
    for name, cells in more.items():
        if any(cells):
            header.append(name)
            for row, cell in zip(rows, cells, strict=True):
                row.append(cell or "")
    align = "l".ljust(len(header), "r")
    rows = [[*row, model.odds] for row, model in zip(rows, models, strict=True)]
    if noise is not None and noise.value is not None:
        rows.append([noise_name(noise.source), size(noise.value), *[""] * (len(header) - 1)])
    return Table([*header, "odds"], rows, align)


def on_replicates(models: Sequence[Model], unit: str, noise: NoiseFloor) -> str:
    """Return how well replicates determine the noise, in the unit of the table, and what is stated; or nothing."""
    if (known := noise.replicates) is None:
        return ""
    factor, readable_unit = readable(unit, max(model.rms for model in models))
    low, high = (three_digits(x * factor) for x in (known.low, known.high))
    stated = (
        "" if noise.stated is None else f"; {three_digits(noise.stated * factor)} {readable_unit} is stated"
    )
    return f"By replicates the noise is between {low} and {high} {readable_unit} (95 %){stated}."


def noise_name(source: str | None) -> str:
    """Return what the noise is called, by where it is known from."""
    return {"replicates": "noise, by replicates", "stated": "noise, as stated"}.get(str(source), "noise")
