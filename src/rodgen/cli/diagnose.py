"""``rodgen diagnose``: which physical effect is missing in a machine's model."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from rodgen.cli._console import Command, UsageError, after_fits, option, refused, repeated, show_result
from rodgen.cli._machine import DATA, FILES, JSON, MACHINE, SCHEDULER, TEST, diagnosed
from rodgen.cli._values import OutputFile, whole
from rodgen.errors import counted, joined
from rodgen.files import write_file

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Diagnosis

_DIAGNOSE = f"""\
Fit a machine, and find the physical effects that its model lacks: the most probable set of those of the catalogue, each
with its odds, and with those that these data cannot distinguish from it. An error that none explains is given as a
formula. "Nothing is missing" and "these data cannot tell" are possible answers. Outliers are left out.

{FILES}
  rodgen diagnose mount.toml stars.csv -o better.toml
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "diagnose",
        _run,
        _DIAGNOSE,
        MACHINE,
        DATA,
        TEST,
        repeated(
            "--prefer EFFECT[@PLACE]",
            "name this effect first of those that fit as well; may be repeated",
            _preferred,
        ),
        option(
            "-o --output BETTER.toml",
            "write the machine file with what was found, and outliers set aside",
            OutputFile,
        ),
        repeated("--only N", "with -o: only this effect, counted from 1; may be repeated", whole(1)),
        JSON,
        SCHEDULER,
    )


def _run(options: argparse.Namespace) -> int:
    if options.only and not options.output:
        raise UsageError(refused("rodgen diagnose", "--only without -o", "-o BETTER.toml, too"))
    diagnosis = diagnosed(options, options.test, options.prefer, shown=True)
    written = ""
    if options.output:
        written = f"\n\n{_write(options, diagnosis)}"
    show_result(options, diagnosis.to_dict, lambda: diagnosis.summary() + written)
    return after_fits(all(each.solution.converged for each in diagnosis.fits))


def _write(options: argparse.Namespace, diagnosis: Diagnosis) -> str:
    """Write the machine file with what was found, and return what it has more than the one before."""
    from rodgen.machines.files.edit import edited_text
    from rodgen.machines.machine import Machine

    if options.only and max(options.only) > len(diagnosis.found):
        expected = (
            f"1 to {len(diagnosis.found)}, what was found"
            if diagnosis.found
            else "a diagnosis that finds effects"
        )
        raise refused("--only", f"{max(options.only)}", expected)
    effects = [
        one.effect for n, one in enumerate(diagnosis.found, 1) if not options.only or n in options.only
    ]
    machine, geometry = Machine.load(options.machine), diagnosis.geometry
    if geometry is not None:
        machine = replace(geometry.before.machine, estimate=geometry.estimate)
    for effect in [*(geometry.effects if geometry is not None else ()), *effects]:
        machine = machine.with_effect(effect)
    if diagnosis.further_exclusions:
        machine = replace(machine, measured=diagnosis.machine.measured)
    write_file(options.output, edited_text(options.machine, machine).encode())
    more = ["its dimensions estimated"] if diagnosis.geometry is not None else []
    more += [effect.title for effect in effects]
    what = f"with {joined(more)}" if more else "without a change"
    if count := len(diagnosis.outliers):
        outliers = counted(count, "outlier")
        if diagnosis.further_exclusions:
            what = f"{what if more else 'with the same model'}; {outliers} set aside"
        else:
            what = f"{what}; {outliers} not set aside: that is done in one file that is read whole"
    return f"{options.output}: {options.machine} {what}"


def _preferred(text: str) -> tuple[str, str | None]:
    """Return name and place of an effect; the place is None where none is given."""
    from rodgen.machines.effects.catalogue import UnknownEffectError, definitions

    name, _, place = text.partition("@")
    try:
        definitions(name)
    except UnknownEffectError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return name, place or None
