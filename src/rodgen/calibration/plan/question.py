"""What measurements are to settle: which effect is there, and which parameters are to be determined or sharpened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rodgen.calibration.plan.constraints import Constraints
from rodgen.calibration.words import NAMES
from rodgen.errors import RodgenError, UnexpectedError, joined, listed, shown

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.machines.machine import Effect, Machine
    from rodgen.machines.parts import EffectIdentity


MOST_ALTERNATIVES = 8
"""Effects that are compared with each other at most: every pair of them is a test of its own."""


class PlanError(UnexpectedError):
    """A plan that cannot be made, in one sentence: what was found, and what was expected."""


@dataclass(frozen=True)
class Question:
    """What measurements are to settle."""

    machine: Machine
    """Without the effects in question."""
    alternatives: tuple[tuple[Effect, ...], ...]
    """Of each tuple, one effect is there."""
    keys: tuple[str, ...]
    """Parameters that are to be determined or sharpened."""
    further: tuple[Effect, ...]
    """Effects that these parameters belong to and the machine does not have yet."""
    kind: str
    """Of the goal for the parameters, "show" or "sharpen"."""
    by_default: bool = False
    """Whether the parameters were chosen here, because none were asked for."""
    asked: bool = False
    """Whether a user asked for these parameters: then readings are planned even where they sharpen little."""
    trusted: bool = False
    """Whether a diagnosis, which knows how readings depend on each other, says that the alternatives cannot be told
    apart: where they differ by more in independent readings, the readings are not independent."""
    notes: list[str] = field(default_factory=list)
    constraints: Constraints = field(default_factory=Constraints)


def ask(
    fit: Fit,
    alternatives: Iterable[Sequence[Effect]],
    wanted: Iterable[str],
    *,
    trusted: bool,
    asked: bool = True,
) -> Question:
    """Return the question that a fit, alternatives and wanted parameters amount to.

    Raises
    ------
    PlanError
        When a wanted key is unknown.
    """
    machine, notes = fit.machine, []
    members = []
    for each in alternatives:
        unique = list({e.identity: e for e in each}.values())
        if len(unique) < 2:
            continue
        if len(unique) > MOST_ALTERNATIVES:
            out = joined([e.title for e in unique[MOST_ALTERNATIVES:]])
            notes.append(f"Only {MOST_ALTERNATIVES} of {len(unique)} effects are looked at, without {out}.")
        members.append(tuple(unique[:MOST_ALTERNATIVES]))
    there = {e.identity for e in machine.effects}
    for place in dict.fromkeys(e.identity for each in members for e in each):
        if place in there:
            machine = machine.without_effect(*place)
    further: dict[EffectIdentity, Effect] = {}
    keys: list[str] = []
    for text in wanted:
        found, effect = _wanted(fit, str(text))
        keys += found
        if effect is not None:
            further[effect.identity] = effect
    kind, by_default = "sharpen", not keys
    if not keys and not members:
        d = fit.determinacy
        keys = [key for x in (*d.directions, *d.weak) if not x.gauge for key, _ in x.parts]
        kind = "show" if keys else "sharpen"
        keys = keys or parameters_to_sharpen(fit)
    return Question(
        machine=machine,
        alternatives=tuple(members),
        keys=tuple(dict.fromkeys(keys)),
        further=tuple(further.values()),
        kind=kind,
        by_default=by_default,
        asked=asked and not by_default,
        trusted=trusted,
        notes=notes,
    )


def parameters_to_sharpen(fit: Fit, without: Sequence[str] = ()) -> list[str]:
    """Return the parameters that the data determine, without the frame's; all where there are none."""
    out = {key for x in fit.determinacy.directions for key, _ in x.parts} | set(without)
    every = [fit.parameters[i].key for i in fit.free]
    return [key for key in every if key not in out and not key.startswith("frame.")] or every


def determined_parameters(fit: Fit, effects: Sequence[Effect]) -> tuple[list[str], list[str]]:
    """Return the keys of effects' parameters that the data determine, and sentences on those that they do not."""
    prefixes = tuple(e.key("").rstrip(".") + x for e in effects for x in ".[")
    keys = [fit.parameters[i].key for i in fit.free if fit.parameters[i].key.startswith(prefixes)]
    undetermined = {fit.parameters[i].key for i in fit.free if fit.determinacy.undetermined[i]}
    weak = [key for x in fit.determinacy.weak for key, _ in x.parts]
    left_out = [key for key in keys if key in undetermined or key in weak]
    notes = []
    if left_out:
        others = [key for key in weak if key not in keys]
        of = f" separately from others, such as {others[0]}" if others else ""
        verb, them = ("is", "it") if len(left_out) == 1 else ("are", "them")
        notes.append(f"{joined(left_out, most=NAMES)} {verb} left out: the data do not determine {them}{of}.")
    notes += undetermined_sentences(fit)
    return [key for key in keys if key not in left_out], notes


def undetermined_sentences(fit: Fit) -> list[str]:
    """Return a sentence on what more data would determine; choices of coordinates are not counted."""
    texts = [x.text for x in fit.determinacy.directions if not x.gauge]
    return [f"{texts[0]} {len(texts) - 1} more such." if len(texts) > 1 else texts[0]] if texts else []


def _wanted(fit: Fit, text: str) -> tuple[list[str], Effect | None]:
    """Return the keys that a text means, and an effect that is not in the model yet."""
    keys = [fit.parameters[i].key for i in fit.free]
    inside = [key for key in keys if key == text or key.startswith((f"{text}.", f"{text}["))]
    if inside:
        return inside, None
    machine = fit.machine
    if text in {p.key for p in fit.parameters}:
        raise PlanError(f"parameter {shown(text)} is held", f"one that is estimated: {joined(keys, most=6)}")
    parts, place = _split(machine, text)
    try:
        effect = machine.effect(parts[0], place)
        machine.with_effect(effect)
    except RodgenError:
        few = joined(keys)
        raise PlanError(
            f"no parameter {shown(text)}",
            f"one of {few or 'none, as nothing is estimated'}, or an effect that the machine may have, such as "
            f"EFFECT@JOINT",
        ) from None
    units = effect.units(machine)
    own = [name for name in units if not name.startswith("k_")] or list(units)
    if parts[1:] and parts[1] not in units:
        raise PlanError(f"no parameter {shown(parts[1])} of {effect.title}", listed(units))
    return [effect.key(name) for name in (parts[1:2] or own)], effect


def _split(machine: Machine, text: str) -> tuple[list[str], str | None]:
    """Return the effect and the parameter that a text names, and its place: ``C.backlash.b`` or ``backlash@C``."""
    effect, _, at = text.partition("@")
    if at:
        return effect.split("."), at
    places = {joint.name for joint in machine.joints} | {target.name for target in machine.targets}
    place = next((p for p in sorted(places, key=len, reverse=True) if text.startswith(f"{p}.")), None)
    return (text if place is None else text[len(place) + 1 :]).split("."), place
