"""``rodgen parameter``: what a machine file says of a parameter: a prior, bounds, or what it is tied to."""

from __future__ import annotations

import argparse

from rodgen.cli._change import add_output, new_name
from rodgen.cli._console import OK, Command, UsageError, show_result
from rodgen.cli._machine import add_json
from rodgen.cli._values import InputFile
from rodgen.errors import InputFileError, joined, shown
from rodgen.files import write_file

_PARAMETER = """\
Copy a machine file and say in it what is known of a parameter, in [known], or what it is tied to, in [ties]; every fit
uses it. The rest of the file, including comments, is unchanged. KEY is as 'rodgen fit' shows it.

  rodgen parameter gantry.toml C.axis.a --prior "0 ± 10 arcsec" -o gantry.toml
  rodgen parameter gantry.toml C.backlash.b --bounds "0 arcsec,30 arcsec"
  rodgen parameter robot.toml J2.gravity_windup.k --tie "2 * J3.gravity_windup.k"
  rodgen parameter robot.toml J2.gravity_windup.k --free
"""


def add_to(command: Command) -> None:
    """Add the command."""
    made = command("parameter", _run, "say what is known of a parameter, or tie it to others", _PARAMETER)
    made.add_argument("machine", metavar="MACHINE", type=InputFile, help="the machine file")
    made.add_argument("key", metavar="KEY", help="of the parameter, or in [known] of several: C.axis")
    made.add_argument("--prior", metavar="TEXT", help="such as '0 ± 10 arcsec'")
    made.add_argument(
        "--bounds", metavar="LOW,HIGH", help="such as '0 um,50 um'; inf or -inf where there is none"
    )
    made.add_argument("--tie", metavar="SUM", help="multiples of others, such as '2 * J3.gravity_windup.k'")
    made.add_argument("--free", action="store_true", help="nothing is known of it, and it is tied to none")
    add_output(made)
    add_json(made)


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.edit import text_with_known, text_with_tie
    from rodgen.machines.files.read import machine_of
    from rodgen.machines.files.write import known_line
    from rodgen.machines.machine import Machine

    file, key, known = options.machine, options.key, {}
    if options.prior is not None:
        known["prior"] = options.prior
    if options.bounds is not None:
        known["bounds"] = [_end(part) for part in options.bounds.split(",")]
    if [bool(known), options.tie is not None, options.free].count(True) != 1:
        expected = "a prior, bounds, or both; or --tie; or --free"
        raise UsageError(InputFileError("command line", "rodgen parameter", "none, or too much", expected))
    machine = Machine.load(file)
    if options.tie is not None:
        text = text_with_tie(file, key, options.tie)
    elif known:
        text = text_with_known(file, key, known)
    elif key in {**machine.known, **machine.ties}:
        text = text_with_tie(file, key, "", text_with_known(file, key, {}))
    else:
        expected = joined([*machine.known, *machine.ties]) or "an entry; there is none"
        raise InputFileError(file, "[known] and [ties]", f"nothing of {shown(key)}", expected)
    output = options.output or new_name(file, key.split("."))
    write_file(output, text.encode())
    changed = machine_of(text, output, Machine)
    entries = {
        "known": known_line(changed, key, changed.known[key]) if key in changed.known else None,
        "tied_to": changed.ties[key].text if key in changed.ties else None,
    }
    said = entries["known"] or (f"{key} = {entries['tied_to']}" if entries["tied_to"] else f"{key} is free")
    show_result(options, lambda: {"file": output, "parameter": key, **entries}, lambda: f"{output}: {said}")
    return OK


def _end(text: str) -> str | float:
    """Return an end of bounds: a number, or one with its unit."""
    try:
        return float(text)
    except ValueError:
        return text.strip()
