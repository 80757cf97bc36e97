"""``rodgen check``: whether a machine file and its data are plausible, and what is wrong where they are not."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rodgen.cli._console import FAILED, OK, Command, option, show_result
from rodgen.cli._machine import DATA, FILES, JSON, MACHINE, load_data, remark_on_readings
from rodgen.cli._values import OutputFile
from rodgen.errors import InputFileError, RodgenError
from rodgen.files import write_file
from rodgen.stages import stage

if TYPE_CHECKING:
    from rodgen.calibration.check import Check
    from rodgen.calibration.repairs import Repair

_CHECK = f"""\
Check whether a machine file and its measurements can belong together. Where they cannot, what people get wrong is
tried: signs and directions of axes, the order of joints and of columns, handedness, units, ratios, base and tool,
gravity, a target mounted anew in each run, rows shifted. The smallest change that puts the files right is named, with
others that are equally probable. The exit code is 1 where something is wrong.

{FILES}"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "check",
        _run,
        _CHECK,
        MACHINE,
        DATA,
        option("-o --output REPAIRED.toml", "write the repaired machine file", OutputFile),
        option("--repaired-data FILE", "write the repaired data", OutputFile),
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    with stage("starting"):
        from rodgen.calibration.check import check
        from rodgen.calibration.repairs import write_repaired_data
        from rodgen.machines.files.edit import edited_text
        from rodgen.machines.machine import Machine

    with stage("reading"):
        machine = Machine.load(options.machine)
    checked = check(machine, load_data(options.data))
    repair = checked.repairs[0] if checked.repairs else None
    if options.output or options.repaired_data:
        if repair is None:
            why = "no single change repairs the files" if checked.wrong else "nothing is wrong with the files"
            raise InputFileError(options.machine, "file", why, "no output")
        for path, changed, right, hint in (
            (options.output, repair.of_machine, "a machine file that is right", "--repaired-data"),
            (options.repaired_data, repair.of_data, "data that are right", "-o"),
        ):
            if path and not changed:
                why = f"{right}, as {repair.words}"
                raise InputFileError(path, "file", why, f"{hint} for what is wrong")
        repaired, observations = repair.applied(checked.machine, checked.observations)
        if options.output:
            write_file(options.output, edited_text(options.machine, repaired).encode())
        if options.repaired_data:
            write_repaired_data(observations, checked.observations, options.repaired_data)
    fit = None
    if not checked.wrong:
        with contextlib.suppress(RodgenError):  # nothing to fit
            fit = machine.fit(checked.observations)
    used = {} if fit is None else fit.used_rows
    show_result(
        options,
        lambda: checked.to_dict() | used,
        lambda: "\n".join([checked.summary(), *_repairing(options, checked, repair)]),
    )
    if fit is not None:
        remark_on_readings(fit)
    return FAILED if checked.wrong else OK


def _repairing(options: argparse.Namespace, checked: Check, repair: Repair | None) -> Iterator[str]:
    """Yield which repaired files were written, or which option writes them."""
    written = [path for path in (options.output, options.repaired_data) if path]
    if written:
        yield f"Repaired: {', '.join(written)}"
        if options.repaired_data and repair:
            yield f"{options.repaired_data} has {repair.on_rows(checked.observations)}"
        return
    if repair and repair.of_data:
        yield "The data must be changed; --repaired-data FILE writes them."
    if repair and repair.of_machine:
        yield "-o REPAIRED.toml writes the machine file with that change."
