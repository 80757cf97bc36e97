"""Write a machine file with other effects, fit it with and without them, and describe the change."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgen.cli._machine import load_data, remark_on_readings, remark_on_rows
from rodgen.cli._values import EditedMachine
from rodgen.files import write_file

if TYPE_CHECKING:
    from rodgen.calibration.fit import Estimate
    from rodgen.calibration.ladder import Ladder, Rung
    from rodgen.machines.machine import Effect, Machine


@dataclass(frozen=True)
class Change:
    """The change of a machine."""

    machines: tuple[Machine, Machine]  # as it was, and after the change
    effect: Effect  # that is added or removed
    text: str  # content of the new machine file
    words: tuple[str, ...]  # for the name of the new file, when none is given
    added: bool = True


@dataclass(frozen=True)
class Written:
    """The new machine file, and the fits."""

    change: Change
    machine: str  # name of the file as it was
    output: str  # name of the new file
    ladder: Ladder | None  # the fits; None without measurements

    @property
    def converged(self) -> bool:
        """Whether all fits converged."""
        return self.ladder is None or all(rung.fit.solution.converged for rung in self.ladder.rungs)

    def to_dict(self) -> dict[str, Any]:
        """Return the change as plain data."""
        ladder = self.ladder.to_dict() if self.ladder else None
        return {"file": self.output, **_described(self.change.effect), "ladder": ladder}

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        effect, added = self.change.effect, self.change.added
        yield f"{self.output}: {self.machine} {'with' if added else 'without'} {effect.title}"
        if self.ladder is None:
            if added:
                yield ""
                yield effect.definition.describe()
            return
        yield ""
        yield str(self.ladder)
        (rung,) = self.ladder.rungs[1:]
        yield ""
        yield rung.verdict
        if added:
            yield from _listed(_parameters(rung))
        yield from _advice(effect, rung, added=added)


def carry_out(options: argparse.Namespace, change: Change) -> Written:
    """Write the new machine file, and fit all machines when there are measurements."""
    output = options.output or new_name(options.machine, change.words)
    ladder = None
    write_file(output, change.text.encode())
    if options.data:
        from rodgen.calibration.ladder import ladder_of

        data = load_data(options.data)
        ladder = ladder_of(change.machines, data, loss=options.loss)
        remark_on_rows(ladder.rungs[-1].fit.observations)
        remark_on_readings(ladder.rungs[-1].fit)
    return Written(change, options.machine, output, ladder)


def add_output(command: argparse.ArgumentParser) -> None:
    """Add --output, the new machine file."""
    command.add_argument(
        "-o",
        "--output",
        metavar="NEW.toml",
        type=EditedMachine,
        help="may be MACHINE itself; default: a new name in the same folder, which is printed",
    )


def new_name(machine: str, words: Sequence[str]) -> str:
    """Return an unused file name in the folder of the machine file."""
    from rodgen.machines.files.edit import name_with

    found, number = name_with(machine, words), 2
    while os.path.lexists(found):
        found, number = name_with(machine, (*words, str(number))), number + 1
    return found


# words ------------------------------------------------------------------------------------------------


def _described(effect: Effect) -> dict[str, Any]:
    return {
        "effect": effect.name,
        "place": effect.place,
        "meaning": effect.definition.meaning,
        "usual_size": effect.definition.usual_size,
        "remedy": effect.definition.remedy,
    }


def _parameters(rung: Rung) -> list[Estimate]:
    """Return the parameters of the effect, then those of effects that were there, which change with it."""
    fit = rung.fit
    own = rung.parameters
    others = [p.key for p in fit.parameters if p.effect is not None and p.key not in own]
    found = [fit.estimates[key] for key in [*own, *others]]
    waiting = {p.key for p in fit.parameters if p.optional}  # estimated only when the data call for it
    return [e for e in found if not e.held or e.value or (e.key in own and e.key not in waiting)]


def _listed(estimates: Sequence[Estimate]) -> Iterator[str]:
    width = max((len(e.key) for e in estimates), default=0)
    yield from (f"  {e.key:{width}}  {e.text}" for e in estimates)


def _advice(effect: Effect, rung: Rung, *, added: bool) -> Iterator[str]:
    """Describe the effect, and its remedy when it is significant."""
    definition = effect.definition
    real = rung.step is not None and rung.step.significant
    if added:
        yield from definition.paragraphs("Meaning", "Usual size", *(["Remedy"] if real else []))
    elif real:
        yield "Without it the model is worse than it can be: keep it."
