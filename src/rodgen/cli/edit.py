"""``rodgen add``, ``remove``, ``exclude`` and ``set``: change one thing in a machine file."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rodgen.cli._console import (
    OK,
    Command,
    OneOf,
    UsageError,
    after_fits,
    argument,
    flag,
    option,
    refused,
    repeated,
    show_result,
)
from rodgen.cli._machine import (
    DATA,
    FILES,
    JSON,
    LOSS,
    MACHINE,
    PLACE,
    load_data,
    remark_on_readings,
    remark_on_rows,
)
from rodgen.cli._values import EditedMachine, InputFile
from rodgen.errors import InputFileError, joined, shown
from rodgen.files import write_file

if TYPE_CHECKING:
    from rodgen.machines.machine import Effect, Machine


_ADD = f"""\
Copy a machine file and add an effect of the catalogue, or of your own formula; the rest of the file is unchanged. What
a diagnosis found is added by 'rodgen diagnose -o'. With DATA the machine is fitted without and with it: the error on
the poses of the fit and on poses left out, compared with the noise, the odds of the effect, and its remedy.

{FILES}
  rodgen add mount.toml sag stars.csv --joint EL --formula "k*cos(2*q)" --parameter k=arcsec
"""

_REMOVE = f"""\
Copy a machine file without one effect; the rest of the file is unchanged. With DATA both machines are fitted, and the
error is shown with and without the effect.

{FILES}"""

_EXCLUDE = f"""\
Copy a machine file and note in it, under set_aside in [measured], rows of measurements that do not count: every command
leaves them out, and says so. --undo lets rows count again. DATA is not changed, and may grow; where the lines hold
other measurements than now, it is an error.

{FILES}
  rodgen exclude mount.toml stars.csv --rows 12,40-43 --why clouds -o mount.toml
"""

_SET = """\
Copy a machine file and say in it what is known of a parameter, in [known], or what it is tied to, in [ties]; every fit
uses it. The rest of the file, including comments, is unchanged. KEY is as 'rodgen fit' shows it.

  rodgen set robot.toml J2.gravity_windup.k --tie "2 * J3.gravity_windup.k" -o robot.toml
"""


OUTPUT = option(
    "-o --output NEW.toml", "may be MACHINE itself; default: a new name, which is printed", EditedMachine
)
_EFFECT = argument("EFFECT", "its name; 'rodgen effects' lists them")
_BEFORE_AND_AFTER = argument(
    "DATA", "measurements, to fit the machine to, before and after", InputFile, nargs="?"
)


def add_to(command: Command) -> None:
    """Add the commands."""
    command(
        "exclude",
        _exclude,
        _EXCLUDE,
        MACHINE,
        DATA,
        OneOf(
            option(
                "--rows N,N-N", "lines of a CSV file from 1, else rows from 0, such as 12,40-43", default=""
            ),
            option("--run NAME", "a run, as the column run names it", dest="of_run", default=""),
            option("--where RULE", "such as 'EL < 20 deg'; <, <=, >, >=, =, !=, joined by 'and'", default=""),
            flag("--all", "with --undo: all rows of DATA"),
            required=True,
        ),
        flag("--undo", "let these rows count again"),
        option("--why TEXT", "a note", default=""),
        OUTPUT,
        JSON,
    )
    command(
        "set",
        _set,
        _SET,
        MACHINE,
        argument("KEY", "of the parameter, or in [known] of several: C.axis"),
        option("--prior TEXT", "such as '0 ± 10 arcsec'"),
        option("--bounds LOW,HIGH", "such as '0 um,50 um'; inf or -inf where there is none"),
        option("--tie SUM", "multiples of others, such as '2 * J3.gravity_windup.k'"),
        flag("--free", "nothing is known of it, and it is tied to none"),
        OUTPUT,
        JSON,
    )
    command(
        "add",
        _add,
        _ADD,
        MACHINE,
        _EFFECT,
        _BEFORE_AND_AFTER,
        PLACE,
        repeated(
            "--hold NAME=VALUE", "a parameter that is not estimated, such as b=12arcsec; may be repeated"
        ),
        option("--formula FORMULA", "of an effect of your own, named EFFECT: 'k*cos(q)'"),
        option("--component WHAT", "what a formula changes: the reading (default), tx, ty, tz, rx, ry or rz"),
        repeated("--parameter NAME=UNIT", "of a formula, such as k=arcsec; may be repeated"),
        OUTPUT,
        LOSS,
        JSON,
    )
    command("remove", _remove, _REMOVE, MACHINE, _EFFECT, _BEFORE_AND_AFTER, PLACE, OUTPUT, LOSS, JSON)


def _add(options: argparse.Namespace) -> int:
    from rodgen.machines.machine import Machine
    from rodgen.machines.rules import UnfitEffectError
    from rodgen.machines.typed_effects import assignments, effect_with, holding

    if options.formula is None and (options.component or options.parameter):
        found = "--component or --parameter without --formula"
        raise UsageError(refused("rodgen add", found, "--formula, too"))
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
    words = (effect.name, effect.place or "")
    return _done(options, (machine, machine.with_effect(effect)), effect, words)


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
    keys = {key: value for key, value in block.items() if value or key == "parameters"}
    return effect_of(machine, keys, options.machine, f"effect {options.effect}")


def _parameter(text: str) -> tuple[str, str]:
    """Read ``k=arcsec``."""
    name, equals, unit = (part.strip() for part in text.partition("="))
    if not (name and equals and unit):
        raise refused(
            "--parameter", shown(text), "NAME=UNIT, such as k=arcsec; the unit of a plain number is 1"
        )
    return name, unit


def _remove(options: argparse.Namespace) -> int:
    from rodgen.machines.machine import Machine

    machine = Machine.load(options.machine)
    place = options.joint or options.target
    changed = machine.without_effect(options.effect, place)
    effect = next(e for e in machine.effects if e.identity == (options.effect, place))
    words = ("without", effect.name, effect.place or "")
    return _done(options, (machine, changed), effect, words)


def _exclude(options: argparse.Namespace) -> int:
    from rodgen.machines.files.edit import edited_text
    from rodgen.machines.machine import Machine

    if options.all and not options.undo:
        raise UsageError(refused("rodgen exclude", "--all without --undo", "--rows, --run, or --where"))
    machine, data = Machine.load(options.machine), load_data(options.data)
    which = {"rows": options.rows, "run": options.of_run, "where": options.where, "why": options.why}
    try:
        changed = (machine.bringing_back if options.undo else machine.setting_aside)(data, **which)
    except InputFileError as error:
        if error.place != "[measured], set_aside":
            raise
        option = next((name for name in ("rows", "run", "where") if which[name]), "all")
        raise refused(f"--{option}", error.found, error.expected) from None
    text = edited_text(options.machine, changed)
    output = write_machine(options, text, ("included" if options.undo else "excluded",))
    aside = changed.aside(data)
    sentence = aside.text if aside else f"No row of {options.data} is set aside."
    content = {"file": output, "set_aside": aside.to_dict() if aside else {"rows": 0, "entries": []}}
    show_result(options, lambda: content, lambda: f"{output}: {sentence}")
    return OK


def _set(options: argparse.Namespace) -> int:
    from rodgen.machines.files.edit import edited_text
    from rodgen.machines.files.write import known_line
    from rodgen.machines.machine import Machine

    file, key, known = options.machine, options.key, {}
    if options.prior is not None:
        known["prior"] = options.prior
    if options.bounds is not None:
        known["bounds"] = [_end(part) for part in options.bounds.split(",")]
    if [bool(known), options.tie is not None, options.free].count(True) != 1:
        expected = "a prior, bounds, or both; or --tie; or --free"
        raise UsageError(refused("rodgen set", "none, or too much", expected))
    machine = Machine.load(file)
    if options.tie is not None:
        changed = machine.tying(key, options.tie)
    elif known:
        changed = machine.knowing(key, **known)
    elif (changed := machine.freeing(key)) == machine:
        expected = joined([*machine.known, *machine.ties]) or "an entry; there is none"
        raise InputFileError(file, "[known] and [ties]", f"nothing of {shown(key)}", expected)
    output = write_machine(options, edited_text(file, changed), key.split("."))
    entries = {
        "known": known_line(changed, key, changed.known[key]) if key in changed.known else None,
        "tied_to": changed.ties[key].text if key in changed.ties else None,
    }
    statement = entries["known"] or (
        f"{key} = {entries['tied_to']}" if entries["tied_to"] else f"{key} is free"
    )
    show_result(
        options, lambda: {"file": output, "parameter": key, **entries}, lambda: f"{output}: {statement}"
    )
    return OK


def _end(text: str) -> str | float:
    """Return an end of bounds: a number, or one with its unit."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


# the new file, and the fits ----------------------------------------------------------------------------------------


def _done(
    options: argparse.Namespace, machines: tuple[Machine, Machine], effect: Effect, words: Sequence[str]
) -> int:
    """Write the new machine file, fit both machines when there are measurements, and show what there is to say."""
    from rodgen.machines.files.edit import edited_text
    from rodgen.views import plain

    output = write_machine(options, edited_text(options.machine, machines[1]), words)
    added = effect in machines[1].effects
    ladder, parts = None, [effect.definition.describe()] if added else []
    if options.data:
        from rodgen.calibration.ladder import ladder_of

        ladder = ladder_of(machines, load_data(options.data), loss=options.loss)
        rung = ladder.rungs[-1]
        remark_on_rows(rung.fit.observations)
        remark_on_readings(rung.fit)
        parts = [str(ladder), str(rung)]
    about = "effect=name place " + " ".join(f"{name}=definition.{name}" for name in _ABOUT)
    title = f"{output}: {options.machine} {'with' if added else 'without'} {effect.title}"
    show_result(
        options,
        lambda: {"file": output, **plain(effect, about), "ladder": ladder.to_dict() if ladder else None},
        lambda: "\n\n".join([title, *parts]),
    )
    return after_fits(ladder is None or all(rung.fit.solution.converged for rung in ladder.rungs))


_ABOUT = ("meaning", "usual_size", "remedy")


def write_machine(options: argparse.Namespace, text: str, words: Sequence[str]) -> str:
    """Write the new machine file, without --output under a name with these words; return its name."""
    from rodgen.machines.files.edit import unused_name

    output: str = options.output or unused_name(options.machine, words)
    write_file(output, text.encode())
    return output
