"""``rodgen add`` and ``rodgen remove``: add effects to a machine file, or remove one."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rodgen.cli._change import Change, Written, add_output, carry_out
from rodgen.cli._console import Command, UsageError, after_fits, refused, show_result
from rodgen.cli._machine import FILES, add_json, add_loss, add_place
from rodgen.cli._values import InputFile
from rodgen.errors import shown

if TYPE_CHECKING:
    from rodgen.machines.machine import Effect, Machine

_ADD = f"""\
Copy a machine file and add an effect of the catalogue or of your own formula; the rest of the file, including comments,
is unchanged. What a diagnosis found is added by 'rodgen diagnose -o'. With DATA the machine is fitted without and with
the effect: the error on the poses of the fit and on poses left out, compared with the noise, whether the effect is
significant, and its remedy. F and p are of each effect, given all others; a diagnosis prints the same p.

{FILES}
  rodgen add mount.toml gravity_windup stars.csv --joint EL --hold k2=0
  rodgen add mount.toml sag stars.csv --joint EL --formula "k*cos(2*q)" --parameter k=arcsec
"""

_REMOVE = f"""\
Copy a machine file without one effect; the rest of the file is unchanged. With DATA both machines are fitted, and the
error is shown with and without the effect.

{FILES}"""


def add_to(command: Command) -> None:
    """Add the commands."""
    add = command("add", _add, "add effects to a machine, and see the error fall", _ADD)
    remove = command("remove", _remove, "remove an effect from a machine", _REMOVE)
    for each in (add, remove):
        each.add_argument("machine", metavar="MACHINE", type=InputFile, help="the machine file")
        each.add_argument("effect", metavar="EFFECT", help="its name; 'rodgen effects' lists them")
        about = "measurements, to fit the machine to, before and after"
        each.add_argument("data", metavar="DATA", type=InputFile, nargs="?", help=about)
        add_place(each)
        if each is add:
            each.add_argument(
                "--hold",
                metavar="NAME=VALUE",
                action="append",
                default=[],
                help="a parameter that is not estimated, in the units of the machine file or with its own: k2=0, "
                "b=12arcsec; may be given several times",
            )
            each.add_argument(
                "--formula",
                metavar="FORMULA",
                help="of an effect of your own, which gets the name EFFECT: 'k*cos(q)'",
            )
            each.add_argument(
                "--component",
                metavar="WHAT",
                help="what a formula changes: the reading (default) of the joint, or tx, ty, tz, rx, ry or rz",
            )
            each.add_argument(
                "--parameter",
                metavar="NAME=UNIT",
                action="append",
                default=[],
                help="of a formula, such as k=arcsec; may be given several times",
            )
        add_output(each)
        add_loss(each)
        add_json(each)


def _usage(found: str, expected: str) -> UsageError:
    return UsageError(refused("rodgen add", found, expected))


def _add(options: argparse.Namespace) -> int:
    from rodgen.machines.effects.rules import UnfitEffectError
    from rodgen.machines.effects.typed import assignments, effect_with, holding
    from rodgen.machines.files.edit import text_with_effects
    from rodgen.machines.machine import Machine

    if options.formula is None and (options.component or options.parameter):
        raise _usage("--component or --parameter without --formula", "--formula, too")
    machine = Machine.load(options.machine)
    place = options.joint or options.target
    try:
        held = assignments(options.hold)
        if options.formula is None:
            effect = effect_with(machine, options.effect, place, held)
        else:
            effect = holding(machine, lambda hold: _own(options, machine, hold), held)
    except UnfitEffectError as error:
        place = " ".join(["--hold", *error.key.split(".")[1:]])
        raise refused(place, error.found, error.expected) from None
    machines = (machine, machine.with_effect(effect))
    words = (effect.name, effect.place or "")
    change = Change(machines, effect, text_with_effects(options.machine, [effect]), words)
    return _done(options, carry_out(options, change))


def _own(options: argparse.Namespace, machine: Machine, hold: Mapping[str, float]) -> Effect:
    """Return the effect of a user's formula."""
    from rodgen.machines.files.read import effect_of

    block = {
        "name": options.effect,
        "joint": options.joint,
        "target": options.target,
        "component": options.component or "reading",
        "formula": options.formula,
        "parameters": dict(_parameter(text) for text in options.parameter),
        "hold": dict(hold),
    }
    given = {key: value for key, value in block.items() if value or key == "parameters"}
    return effect_of(machine, given, options.machine, f"effect {options.effect}")


def _parameter(text: str) -> tuple[str, str]:
    """Read ``k=arcsec``."""
    name, equals, unit = (part.strip() for part in text.partition("="))
    if not (name and equals and unit):
        raise refused(
            "--parameter", shown(text), "NAME=UNIT, such as k=arcsec; the unit of a plain number is 1"
        )
    return name, unit


def _remove(options: argparse.Namespace) -> int:
    from rodgen.machines.files.edit import text_without_effect
    from rodgen.machines.machine import Machine

    machine = Machine.load(options.machine)
    place = options.joint or options.target
    changed = machine.without_effect(options.effect, place)
    effect = next(e for e in machine.effects if e.identity == (options.effect, place))
    change = Change(
        (machine, changed),
        effect,
        text_without_effect(options.machine, effect.name, place),
        ("without", effect.name, effect.place or ""),
        added=False,
    )
    return _done(options, carry_out(options, change))


def _done(options: argparse.Namespace, written: Written) -> int:
    show_result(options, written.to_dict, lambda: str(written))
    return after_fits(written.converged)
