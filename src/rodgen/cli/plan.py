"""``rodgen plan``: what to measure next."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgen.cli._console import OK, Command, notify, option, repeated, show_result
from rodgen.cli._machine import DATA, FILES, JSON, LOSS, MACHINE, diagnosed, fitted
from rodgen.cli._values import InputFile, OutputFile, whole
from rodgen.errors import RodgenError
from rodgen.stages import stage

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Diagnosis

_PLAN = f"""\
Plan what to measure next: readings within the machine's travel that distinguish the effects which the data cannot tell
apart, or that determine what is undetermined; with --for, those that sharpen chosen parameters. The plan says how well
they decide, and what no reading in reach can. Measure its rows in their order, and add them to the data.

{FILES}
  rodgen plan mount.toml stars.csv -n 12 -o next.csv
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "plan",
        _run,
        _PLAN,
        MACHINE,
        DATA,
        option("-n N", "readings at most; default: 12", whole(1, 500), dest="count", default=12),
        option("-o --output PLAN.csv", "write the rows, if any, as a measurement file", OutputFile),
        repeated(
            "--for KEY",
            "sharpen this parameter, or effect, such as C.backlash; may be repeated",
            dest="wanted",
        ),
        option("--constraints LIMITS.toml", "where readings can be taken", InputFile),
        option("--poses POSES.csv", "choose readings from this measurement file", InputFile),
        LOSS,
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Constraints, PlanError, load_constraints, plan
    from rodgen.data.measurements import Measurements
    from rodgen.machines.machine import Machine

    constraints = Constraints()
    if options.constraints or options.poses:
        machine = Machine.load(options.machine)
        if options.constraints:
            constraints = load_constraints(options.constraints, machine)
        if options.poses:
            constraints = constraints.with_poses(machine, Measurements.load(options.poses))
    of = fitted(options) if options.wanted else _diagnosed(options)
    try:
        with stage("planning"):
            planned = plan(of, options.count, wanted=options.wanted or None, constraints=constraints)
    except PlanError as error:  # the count was checked before, so a parameter is wrong
        raise RodgenError(f"command line: --for: {error}") from None
    if options.output and planned.count:
        planned.save(options.output)
    elif options.output:
        notify(f"{options.output} is not written: there is nothing to measure")
    fit = of if isinstance(of, Fit) else of.final_with_forms
    show_result(options, lambda: planned.to_dict() | {"used": fit.used_rows}, planned.summary)
    return OK


def _diagnosed(options: argparse.Namespace) -> Diagnosis:
    """Return the diagnosis; a remark names the rows that it left out."""
    from rodgen.calibration.gross_readings import on_outliers

    diagnosis = diagnosed(options)
    if out := on_outliers(diagnosis.final_with_forms, diagnosis.base.outliers):
        notify(out)
    return diagnosis
