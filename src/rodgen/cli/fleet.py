"""``rodgen fleet``: many machines diagnosed, and what they have in common."""

from __future__ import annotations

import argparse

from rodgen.cli._console import BAD_INPUT, FAILED, INTERNAL, NOT_CONVERGED, OK, Command, show_result
from rodgen.cli._machine import add_json
from rodgen.cli._values import InputFile, OutputFolder, frequency, whole

_FLEET = """\
Diagnose every machine of a fleet, and say which effects are common, which machines are odd, and what changes from night
to night. MACHINES and DATA are folders, in which a machine file (NAME.toml) and its measurements (NAME.csv) have the
same name; one machine file for all measurements will do.

RESULTS gets one file for each machine. What is there, from the same files, is not diagnosed again, so that a run that
was ended goes on where it was. A machine that cannot be diagnosed is named, and the others go on.

  rodgen fleet machines/ data/ -o results/
  rodgen fleet robot.toml tonight/ -o results-26/ --history results-24/ --history results-25/
  rodgen fleet machines/ data/ -o results/ --jobs 8
  rodgen report results/ -o fleet.html
"""


def add_to(command: Command) -> None:
    """Add the command."""
    fleet = command("fleet", _run, "many machines: which effects are common, which machines odd", _FLEET)
    fleet.add_argument(
        "machines",
        metavar="MACHINES",
        type=InputFile,
        help="a folder of machine files, or one file",
    )
    fleet.add_argument("data", metavar="DATA", type=InputFile, help="a folder of measurements")
    about = "the folder of results"
    fleet.add_argument("-o", "--output", metavar="RESULTS", type=OutputFolder, required=True, help=about)
    about = "the folder of earlier results, to compare the nights; may be given several times"
    fleet.add_argument(
        "--history", metavar="RESULTS", type=InputFile, action="append", default=[], help=about
    )
    fleet.add_argument("--date", metavar="YYYY-MM-DD", help="when the machines were measured; default: today")
    about = "how often an alarm of the whole fleet may come by chance; default: 1/year"
    fleet.add_argument("--false-alarms", metavar="N/TIME", type=frequency, default="1/year", help=about)
    about = "processes of this computer; default: one for each processor"
    fleet.add_argument("--jobs", metavar="N", type=whole(1), default=None, help=about)
    about = "a Dask scheduler instead of --jobs, tcp://HOST:PORT, whose workers read files by the same names"
    fleet.add_argument("--scheduler", metavar="WHERE", help=about)
    add_json(fleet)


def _run(options: argparse.Namespace) -> int:
    from rodgen.calibration.fleet import diagnose_fleet, pairs_of
    from rodgen.data.units import parse_unit
    from rodgen.schedulers import processors

    found = diagnose_fleet(
        pairs_of(options.machines, options.data),
        options.output,
        history=options.history,
        date=options.date,
        false_alarms=float(f"{options.false_alarms * parse_unit('year').factor():.12g}"),
        jobs=options.jobs or processors(),
        scheduler=options.scheduler,
    )
    show_result(options, found.to_dict, found.summary)
    if any(machine.result.get("internal") for machine in found.failed):
        return INTERNAL
    if found.failed:
        return BAD_INPUT
    if found.changes.found:
        return FAILED
    return OK if all(machine.result["fleet"]["converged"] for machine in found.diagnosed) else NOT_CONVERGED
