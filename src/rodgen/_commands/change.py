"""``rodgen add`` and ``rodgen remove``: a machine file with one effect more, or less, and the error beside it."""

from __future__ import annotations

import argparse
import os
import re
import tempfile
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rodgen._commands._console import FAILED, OK, Command, fitting, show, show_json
from rodgen._commands._machine import FILES, add_json, add_loss, add_place, load_data
from rodgen._commands._outputs import Outputs
from rodgen.errors import InputFileError

if TYPE_CHECKING:
    from rodgen.discrepancy.ladder import Ladder, Rung
    from rodgen.machines.machine import Effect, Machine

__all__ = ["add_to"]

_ADD = f"""\
Copy a machine file with one effect of the catalogue more; what else stands in it, comments included, stays as it is.
With DATA both machines are fitted: the error on the poses that the fit saw and on those that it did not, beside the
noise, whether the effect is real, and what to do about it.

{FILES}
  rodgen add mount.toml gravity_windup stars.csv --joint EL --hold k2=0
"""

_REMOVE = f"""\
Copy a machine file with one effect less; what else stands in it stays as it is. With DATA both machines are fitted,
and the error is shown with and without the effect.

{FILES}"""

_WIDTH = 100


def add_to(command: Command) -> None:
    """Add the commands."""
    add = command("add", _add, "add an effect to a machine, and watch the error fall", _ADD)
    remove = command("remove", _remove, "take an effect out of a machine", _REMOVE)
    for each in (add, remove):
        each.add_argument("machine", metavar="MACHINE", help="the machine file")
        each.add_argument("effect", metavar="EFFECT", help="its name; 'rodgen effects' lists them")
        each.add_argument("data", metavar="DATA", nargs="?", help="measurements, to fit both machines to")
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
            "-o",
            "--output",
            metavar="NEW.toml",
            help="may be MACHINE itself; default: a new name beside it, which the command prints",
        )
        add_loss(each)
        add_json(each)


def _add(options: argparse.Namespace) -> int:
    from rodgen.machines._edit import add_effect_to_file
    from rodgen.machines._effects import UnfitEffectError
    from rodgen.machines._typed import assignments, hold_of
    from rodgen.machines.machine import Machine

    machine = Machine.load(options.machine)
    place = options.joint or options.target
    try:
        effect = machine.effect(options.effect, place)
        hold = hold_of(machine, effect, assignments(options.hold))
    except UnfitEffectError as error:
        place = " ".join(["--hold", *error.key.split(".")[1:]])
        raise InputFileError("command line", place, error.found, error.expected) from None
    effect = machine.effect(options.effect, place, hold=hold)
    changed = machine.with_effect(effect)
    content = _edited(lambda out: add_effect_to_file(options.machine, effect, out))
    return _changed(options, machine, changed, effect, content, added=True)


def _remove(options: argparse.Namespace) -> int:
    from rodgen.machines._edit import remove_effect_from_file
    from rodgen.machines.machine import Machine

    machine = Machine.load(options.machine)
    place = options.joint or options.target
    changed = machine.without_effect(options.effect, place)
    effect = next(e for e in machine.effects if (e.name, e.place) == (options.effect, place))
    content = _edited(lambda out: remove_effect_from_file(options.machine, effect.name, place, out))
    return _changed(options, machine, changed, effect, content, added=False)


def _edited(edit: Callable[[str], object]) -> bytes:
    """Return what an edit of a file writes, for later: nothing is written before all that was asked for is done."""
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "machine.toml")
        edit(file)
        with open(file, "rb") as stream:
            return stream.read()


def _changed(
    options: argparse.Namespace,
    machine: Machine,
    changed: Machine,
    effect: Effect,
    content: bytes,
    *,
    added: bool,
) -> int:
    output = options.output or _new_name(options.machine, effect, added=added)
    ladder = None
    with Outputs(*filter(None, [options.data])) as outputs:
        outputs.claim(output)
        outputs.add(output, content)
        if options.data:
            from rodgen.discrepancy.ladder import ladder_of

            data = load_data(options.data)
            with fitting() as progress:
                ladder = ladder_of([machine, changed], data, loss=options.loss, progress=progress)
    if options.json:
        show_json(_as_dict(output, effect, ladder))
    else:
        show("\n".join(_lines(options.machine, output, effect, ladder, added=added)))
    converged = ladder is None or all(rung.fit.solution.converged for rung in ladder.rungs)
    return OK if converged else FAILED


def _new_name(machine: str, effect: Effect, *, added: bool) -> str:
    """Return the name of no file, beside the machine's."""
    stem, ending = os.path.splitext(machine)
    words = [stem, *([] if added else ["without"]), effect.name, *([effect.place] if effect.place else [])]
    name = words[0] + "".join("_" + re.sub(r"\W", "_", word) for word in words[1:])
    found, number = f"{name}{ending}", 2
    while os.path.lexists(found):
        found, number = f"{name}_{number}{ending}", number + 1
    return found


def _as_dict(output: str, effect: Effect, ladder: Ladder | None) -> dict[str, Any]:
    return {
        "file": output,
        "effect": effect.name,
        "place": effect.place,
        "meaning": effect.definition.meaning,
        "usual_size": effect.definition.usual_size,
        "remedy": effect.definition.remedy,
        "ladder": ladder.to_dict() if ladder else None,
    }


def _lines(machine: str, output: str, effect: Effect, ladder: Ladder | None, *, added: bool) -> Iterator[str]:
    yield f"{output}: {machine} {'with' if added else 'without'} {effect.title}"
    if ladder is None:
        if added:
            yield ""
            yield effect.definition.describe()
        return
    yield ""
    yield str(ladder)
    yield ""
    rung = ladder.rungs[-1]
    yield rung.verdict
    if added:
        yield from _parameters(rung)
    real = rung.step is not None and rung.step.significant
    definition = effect.definition
    words = [("Meaning", definition.meaning), ("Usual size", definition.usual_size)]
    if added:
        yield from _words([*words, ("Remedy", definition.remedy)] if real else words)
    elif real:
        yield "Without it the model is worse than it can be: keep it."


def _parameters(rung: Rung) -> Iterator[str]:
    """List the new parameters, then those of the other effects: they change with what stands beside them."""
    own = rung.parameters
    others = [p.key for p in rung.fit.parameters if p.effect is not None and p.key not in own]
    estimates = [*own.values(), *(rung.fit.estimates[key] for key in others)]
    estimates = [e for e in estimates if not e.held or e.value or e.key in own]
    width = max((len(e.key) for e in estimates), default=0)
    for e in estimates:
        unit = "" if e.unit == "1" else f" {e.unit}"
        if e.held:
            if e.value or not _is_waiting(e.key):
                yield f"  {e.key:{width}}  {e.value:.5g}{unit}, held"
        elif e.std is None:
            yield f"  {e.key:{width}}  not determined by these data"
        else:
            yield f"  {e.key:{width}}  {e.value:.5g} ± {e.std:.2g}{unit}"


def _is_waiting(key: str) -> bool:
    """Tell whether it is a weight at a later joint, which is taken in only where the data call for it."""
    return ".gravity_windup.k_" in key


def _words(words: Sequence[tuple[str, str]]) -> Iterator[str]:
    for title, text in words:
        if text:
            yield from textwrap.wrap(
                text,
                _WIDTH,
                initial_indent=f"  {title:<13}",
                subsequent_indent=" " * 15,
                break_long_words=False,
            )
