"""Whether an effect of the catalogue has the same form as a term: what the catalogue explains is not outside of it."""

from __future__ import annotations

from collections.abc import Sequence

from rodgen.discrepancy.diagnose._unexplained._dictionary import Driver, Term
from rodgen.machines.machine import Machine

__all__ = ["is_catalogued"]

_TWO_WAVES = {("harmonic", 1), ("harmonic", 2)}
_READING = {
    "revolute": {
        (("q", kind, order),) for kind, order in (*_TWO_WAVES, ("power", 1), ("wave", 1))
    },
    "prismatic": {(("q", "power", 1),), (("q", "wave", 1),), (("T", "power", 1), ("q", "power", 1))},
}
_OF_ANY_READING = {
    (("s", "power", 1),),
    (("q", "power", 1), ("s", "power", 1)),
    (("v", "power", 1),),
    (("T", "power", 1),),
}
_STRAIGHTNESS, _ANGULAR = 4, 3
"""Degrees of a slide's errors."""


def is_catalogued(
    term: Term, place: str | None, component: str, drivers: Sequence[Driver], machine: Machine
) -> bool:
    """Tell whether an effect of the catalogue is this term at this place, along some direction."""
    if any(drivers[f.driver].joint not in {None, place} for f in term.factors):
        return False
    parts = tuple(sorted((drivers[f.driver].kind, f.kind, f.order) for f in term.factors))
    if place is None:
        return parts in {(("t", "power", 1),), (("t", "decay", 1),)}
    of = machine.kind_of(place)
    if component == "reading":
        return parts in {tuple(sorted(p)) for p in (*_READING[of], *_OF_ANY_READING)}
    if parts == (("T", "power", 1),):
        return of == "revolute" and component[0] == "t"
    if len(parts) != 1 or parts[0][0] != "q":
        return False
    _, kind, order = parts[0]
    if of == "revolute":
        return (kind, order) in _TWO_WAVES
    return kind in {"power", "series"} and order <= (_STRAIGHTNESS if component[0] == "t" else _ANGULAR)
