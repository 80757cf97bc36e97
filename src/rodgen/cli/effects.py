"""``rodgen effects``: the catalogue."""

from __future__ import annotations

import argparse
import itertools
import textwrap
from collections.abc import Iterator

from rodgen.cli._console import OK, Command, argument, refused, show, show_json
from rodgen.cli._machine import JSON

_EFFECTS = """\
List the effects that a machine may have: what each changes by which formula, its parameters with their units, its
symbols in ISO 230. With a name: also its physical cause, typical size, remedy, and source. The name may also be a term
of TPOINT, such as TF, or a symbol of ISO 230, such as EBZ: then also which parameter of which effect it is.
Terms of TPOINT that the catalogue lacks (FLOP, DNP, PDD2, harmonics such as X2HC) are shown as effects of your
own.

In the formulas q is the joint's coordinate, q_before that of the joint before, s its direction of approach, v its
velocity, acc its acceleration, T its temperature less the reference, t the time, F the load; U, V, N are unit vectors
that complete the axis, and the axis; EX, EY, EZ machine axes; M, M_perp, M_across, M_guide moments of a unit force
along gravity; bend is N × gravity, fork the part along N of n × gravity, n the axis before, upwards; zeta the place in
the travel, P1 to P4 Legendre polynomials of 2 zeta - 1, L the travel; tan_zenith and sin_zenith of the zenith angle;
read_x, read_y and read_z components of the reading; leg_tension the force in a leg, pulling, per unit load at the
target. At a tower or an arm of a delta U points outwards, V across, N upwards.
"""

_PLACES = {
    "revolute": "At a revolute joint (rodgen add MACHINE NAME --joint J)",
    "prismatic": "At a prismatic joint (rodgen add MACHINE NAME --joint J)",
    "machine": "Of the whole machine (rodgen add MACHINE NAME)",
    "target": "Of a target (rodgen add MACHINE NAME --target T)",
    "leg": "At a leg of a closed chain (rodgen add MACHINE NAME --joint J)",
    "legs": "Of all legs of a hexapod alike (rodgen add MACHINE NAME)",
    "legs, towers": "Of all legs or towers alike (rodgen add MACHINE NAME)",
    "arms": "Of all arms of a rotary delta alike (rodgen add MACHINE NAME)",
    "arm, tower": "At a tower or an arm of a delta (rodgen add MACHINE NAME --joint J)",
    "tower": "At a tower of a linear delta (rodgen add MACHINE NAME --joint J)",
    "arm": "At an arm of a rotary delta (rodgen add MACHINE NAME --joint J)",
}
_WIDTH = 110


def add_to(command: Command) -> None:
    """Add the command."""
    command("effects", _run, _EFFECTS, argument("NAME", "show everything about this effect", nargs="?"), JSON)


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.effects.catalogue import CATALOGUE, UnknownEffectError, definitions
    from rodgen.machines.effects.symbols import own_term, symbols

    symbolic = symbols(options.name) if options.name else ()
    try:
        if symbolic:
            those = tuple(symbol.definition for symbol in symbolic)
        else:
            those = definitions(options.name) if options.name else CATALOGUE
    except UnknownEffectError as error:
        if term := own_term(options.name):
            if options.json:
                show_json([term.as_dict()])
            else:
                show(str(term))
            return OK
        raise refused("NAME", error.found, error.expected) from None
    if options.json:
        show_json([definition.as_dict() for definition in those])
    elif options.name:
        paragraphs = ["\n".join(map(str, symbolic))] if symbolic else []
        show("\n\n".join([*paragraphs, *(definition.describe() for definition in those)]))
    else:
        show("\n".join(_table()))
    return OK


def _table() -> Iterator[str]:
    from rodgen.machines.effects.catalogue import CATALOGUE, as_table

    rows = as_table()
    width = max(len(definition.name) for definition in CATALOGUE) + 2
    for place, group in itertools.groupby(rows, key=lambda row: row[0]):
        yield _PLACES[place]
        for _, name, equation, parameters, iso in group:
            yield from textwrap.wrap(
                equation, _WIDTH, initial_indent=f"  {name:{width}}", subsequent_indent=" " * (width + 4)
            )
            symbol = f"   ISO 230: {iso}" if iso else ""
            yield f"{'':{width + 2}}{parameters}{symbol}"
        yield ""
    yield "rodgen effects NAME: cause, typical size, remedy, source."
