"""``rodgen simulate``: simulated measurements with a hidden effect."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from rodgen.cli._console import (
    OK,
    Command,
    UsageError,
    argument,
    conclude,
    flag,
    option,
    refused,
    repeated,
    show_json,
    show_result,
)
from rodgen.cli._machine import JSON, load_data
from rodgen.cli._values import InputFile, OutputFile, OutputTable, whole
from rodgen.errors import counted
from rodgen.files import write_file

_SIMULATE = """\
Simulate measurements of a machine with effects that its file does not have, to test the tools. DESIGN is a measurement
file that needs no readings: what is commanded, and what else the effects depend on (target, t, T_..., load, run). The
output is the same table with readings. The truth goes to a JSON file of its own; --open prints it.

An effect is NAME@JOINT:a=12arcsec,b=3arcsec, or NAME@TARGET:..., or NAME:... for one of the whole machine. Numbers
without a unit are in the units of the machine file. Without parameters it gets a size that is visible in the data.

  rodgen simulate machine.toml design.csv --hidden -o data.csv --truth truth.json
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "simulate",
        _run,
        _SIMULATE,
        argument("MACHINE", "the machine file", InputFile, nargs="?"),
        argument("DESIGN", "what is commanded", InputFile, nargs="?"),
        repeated("--effect EFFECT", "an effect that is in the data; may be given several times"),
        flag("--hidden", "draw an effect of the catalogue that shows in this design"),
        option("--noise SIZE", "standard deviation of a reading; default: what the files state"),
        option("--seed N", "the same number gives the same data", whole(0)),
        option("-o --output DATA", "default: CSV on standard output", OutputTable),
        option("--truth TRUTH.json", "what is hidden; needed with --hidden", OutputFile),
        option("--open TRUTH.json", "print what was hidden; takes no other files", InputFile),
        JSON,
    )


def _usage(found: str, expected: str) -> UsageError:
    return UsageError(refused("rodgen simulate", found, expected))


def _run(options: argparse.Namespace) -> int:
    if options.open:
        return _open(options)
    if not options.design:
        raise _usage("no MACHINE and DESIGN", "both, or --open TRUTH.json")
    if options.hidden and not options.truth:
        raise _usage("--hidden without --truth", "--truth TRUTH.json, where the answer is kept")
    if options.json and options.output in (None, "-"):
        raise _usage("--json, while standard output has the data", "-o DATA, too")
    from rodgen.calibration.simulate import simulate, truth_as_json
    from rodgen.data.tables import check_output, copy_with
    from rodgen.machines.machine import Machine

    check_output(options.design, options.output)
    machine = Machine.load(options.machine)
    design = load_data(options.design)
    simulated = simulate(
        machine, design, options.effect, hidden=options.hidden, noise=options.noise, seed=options.seed
    )
    if options.truth:
        write_file(options.truth, truth_as_json(simulated.truth).encode())
    copy_with(options.design, options.output, simulated.columns, replaced=simulated.replaced)
    about = {
        "data": options.output,
        "truth": options.truth,
        "rows": design.rows,
        "noise": simulated.truth["noise"],
    }
    if options.json:
        show_json(about)
    else:
        conclude(_summary(options, about))
    return OK


def _summary(options: argparse.Namespace, about: Mapping[str, Any]) -> str:
    noise = about["noise"]
    noise_text = f"noise {noise['rms']:.3g} {noise['unit']}" if noise["rms"] else "no noise"
    name = options.output if options.output not in (None, "-") else "standard output"
    on_truth = f"; the truth is in {options.truth}" if options.truth else ""
    return f"{name}: {counted(about['rows'], 'row')}, {noise_text}{on_truth}"


def _open(options: argparse.Namespace) -> int:
    from rodgen.calibration.simulate import read_truth, truth_as_text

    if options.machine:
        raise _usage("files together with --open", "--open TRUTH.json alone")
    truth = read_truth(options.open)
    show_result(options, lambda: truth, lambda: truth_as_text(truth, options.open))
    return OK
