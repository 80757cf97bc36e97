"""``rodgen fleet``: many machines diagnosed, and what they have in common."""

from __future__ import annotations

import argparse

from rodgen.cli._console import (
    BAD_INPUT,
    FAILED,
    INTERNAL,
    NOT_CONVERGED,
    OK,
    Command,
    argument,
    option,
    repeated,
    show_result,
)
from rodgen.cli._machine import JSON
from rodgen.cli._values import InputFile, OutputFolder, frequency, whole

_FLEET = """\
Diagnose every machine of a fleet, and say which effects are common, which machines are odd, and what changes from night
to night. In the folders MACHINES and DATA a machine file (NAME.toml) and its measurements (NAME.csv) have the same
name; one machine file for all measurements will do.

RESULTS gets one file for each machine. What is there, from the same files, is not diagnosed again. A machine that
cannot be diagnosed is named, and the others go on.

  rodgen fleet robot.toml tonight/ -o results-26/ --history results-24/ --history results-25/
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "fleet",
        _run,
        _FLEET,
        argument("MACHINES", "a folder of machine files, or one file", InputFile),
        argument("DATA", "a folder of measurements", InputFile),
        option("-o --output RESULTS", "the folder of results", OutputFolder, required=True),
        repeated("--history RESULTS", "earlier results, to compare the nights; may be repeated", InputFile),
        option("--date YYYY-MM-DD", "when the machines were measured; default: today"),
        option(
            "--false-alarms N/TIME",
            "how often one of the fleet may come by chance; default: 1/year",
            frequency,
            default="1/year",
        ),
        option("--jobs N", "processes; default: one for each processor", whole(1)),
        option("--scheduler WHERE", "a Dask scheduler instead of --jobs: tcp://HOST:PORT"),
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.calibration.fleet import diagnose_fleet, pairs_of
    from rodgen.data.units import parse_unit
    from rodgen.schedulers import processors

    fleet = diagnose_fleet(
        pairs_of(options.machines, options.data),
        options.output,
        history=options.history,
        date=options.date,
        false_alarms=float(f"{options.false_alarms * parse_unit('year').factor():.12g}"),
        jobs=options.jobs or processors(),
        scheduler=options.scheduler,
    )
    show_result(options, fleet.to_dict, fleet.summary)
    if any(machine.result.get("internal") for machine in fleet.failed):
        return INTERNAL
    if fleet.failed:
        return BAD_INPUT
    if fleet.changes.found:
        return FAILED
    return OK if all(machine.result["fleet"]["converged"] for machine in fleet.diagnosed) else NOT_CONVERGED
