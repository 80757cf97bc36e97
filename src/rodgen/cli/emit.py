"""``rodgen emit``: a fitted machine as standalone code, or as what others read."""

from __future__ import annotations

import argparse

from rodgen.cli._console import Command, after_fits, choice, flag, notify, option, refused, show_result
from rodgen.cli._machine import DATA_OR_NONE, FILES, JSON, LOSS, MACHINE, fitted
from rodgen.cli._values import InputFile, OutputFolder
from rodgen.machines.emit import FORMS

_EMIT = f"""\
Write a fitted machine as standalone code: its actual positions, their derivatives, the compensated commands, and a
test. C99 or a C++17 header without allocation, MATLAB, NumPy, or JAX. Or write it in a form that others read:

  urdf, dh   its geometry, with what is constant in it: a URDF, or Denavit-Hartenberg tables, standard and modified
  tpoint     a mount as a model of TPOINT
  iso230     error motions of each axis over its travel (EXX, EBZ), and location errors (A0C)
  screw      errors of position of each axis, as tables for SINUMERIK and LinuxCNC
  linuxcnc   a kinematics component for halcompile, which corrects the commands
  printer    radius, rods, angles and endstops of a delta printer, for Klipper, Marlin and RepRapFirmware
Each file says what of the fitted model is not in it.

  rodgen emit machine.toml balls.csv --lang iso230 -o certificate

With DATA the machine is fitted first. Without DATA every parameter of MACHINE must have a value, as in a file from
'rodgen fit -o'; that file is then the nominal machine, and its axes and points are not compensated.

{FILES}"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "emit",
        _run,
        _EMIT,
        MACHINE,
        DATA_OR_NONE,
        choice("--lang", FORMS, "the language, or one of the forms above", required=True),
        option("-o --output FOLDER", "default: %(default)s", OutputFolder, default="build"),
        option(
            "--into ROBOT.urdf", "with --lang urdf: the URDF that was imported, to be corrected", InputFile
        ),
        LOSS,
        flag("--force", "write code for a machine that cannot be right, too, and over files of others"),
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.calibration.problem.assembly_modes import not_found_by_code
    from rodgen.machines.machine import Machine

    if options.into and options.lang != "urdf":
        raise refused("--into", f"with --lang {options.lang}", "--lang urdf")
    converged, lost, missing, used = True, 0.0, "", {}
    keys = {"into": options.into, "force": options.force}
    if not options.data:
        written = Machine.load(options.machine).emit(options.lang, options.output, **keys)
    else:
        fit = fitted(options)
        written = fit.emit(options.lang, options.output, **keys)
        used = fit.used_rows
        converged, lost = fit.solution.converged, not_found_by_code(fit.machine, fit.observations)
        missing = fit.lack_of_fit.text if fit.lack_of_fit and fit.lack_of_fit.misses else ""
    files = [str(path) for path in written]
    show_result(options, lambda: {"files": files, "converged": converged, **used}, lambda: "\n".join(files))
    if missing:
        notify(f"{missing} That is in none of these files; 'rodgen diagnose' looks for it.")
    if lost > 0:
        notify(
            f"In {lost:.1%} of the rows the emitted code does not find the pose of the platform: it returns NaN or "
            "another pose."
        )
    return after_fits(converged)
