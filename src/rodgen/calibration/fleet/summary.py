"""The results of a fleet as text, and its sentences, which pages show, too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from rodgen.calibration.fleet.changes import Change
from rodgen.calibration.fleet.fleet import Fleet, FleetEffect, FleetParameter, Odd
from rodgen.calibration.words import capitalized, probability, two_digits
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.statistics.digits import measured
from rodgen.statistics.thresholds import FLEET

VERDICTS = {
    "nothing_missing": "nothing is missing",
    "effects_missing": "effects are missing",
    "wrong_geometry": "dimensions that are not those of the file",
    "unknown_effect": "effects outside the catalogue",
    "cannot_tell": "the data cannot tell",
}
MOST = 12
"""Lines of a list that are shown as text; the page and --json have all."""


def as_text(fleet: Fleet) -> str:
    """Return a fleet as text."""
    return "\n".join(_lines(fleet))


def _lines(fleet: Fleet) -> Iterator[str]:
    yield f"{about_machines(fleet)}"
    for kind in fleet.kinds:
        yield ""
        yield f"{capitalized(kind.title)}: {_count(len(kind.machines), 'machine')}"
        if not kind.effects:
            yield "  No effect was found in any of them."
        yield from _first_of([_effect_text(effect) for effect in kind.effects], "effects")
        if len(kind.machines) < FLEET.fewest:
            yield f"  A distribution is estimated from {FLEET.fewest} machines on."
    if any(kind.parameters for kind in fleet.kinds):
        yield ""
        odd = [f"  {name}: {text}" for name, text in by_machine(fleet.odd)]
        yield f"Odd machines: {len(odd) or 'none'} (of these {FLEET.false_discoveries:.0%} may be like the others)"
        yield from _first_of(odd, "machines")
    if len(fleet.changes.nights) > 1:
        yield ""
        yield about_alarms(fleet)
        yield from _first_of(
            [f"  {name}: {text}" for name, text in by_machine(fleet.changes.found)], "machines"
        )
    if fleet.failed:
        yield ""
        yield "Not diagnosed:"
        yield from (f"  {machine.name}: {machine.error}" for machine in fleet.failed)


def _first_of(texts: Sequence[str], what: str) -> Iterator[str]:
    yield from texts[:MOST]
    if len(texts) > MOST:
        yield f"  … and {len(texts) - MOST} more {what}, which the page and --json show"


def _count(count: float, what: str) -> str:
    return f"{count:g} {what}{'s' * (count != 1)}"


def about_machines(fleet: Fleet) -> str:
    """Return a sentence on how many machines were diagnosed, and what was found."""
    counts = Counter(str(machine.result["verdict"]) for machine in fleet.diagnosed)
    about = [f"{words} in {counts[verdict]}" for verdict, words in VERDICTS.items() if counts[verdict]]
    about += [f"{len(fleet.failed)} could not be diagnosed"] * bool(fleet.failed)
    about += [f"{len(fleet.pending)} are not diagnosed yet"] * bool(fleet.pending)
    return f"{_count(len(fleet.machines), 'machine')}, {fleet.plan.date}: {joined(about)}."


def _effect_text(effect: FleetEffect) -> str:
    alike = f", and may be there in {effect.alike} more" if effect.alike else ""
    text = f"  {effect.title}: found in {effect.found} of {effect.of}{alike}{about_effect(effect, '; ')}"
    for parameter in effect.parameters:
        name = parameter.key.rpartition(".")[2]
        mean, spread, alone = parameter_cells(parameter)
        text += f"\n    {name}: mean {mean}, between machines {spread}; one machine alone is known to {alone}"
    return text


def about_effect(effect: FleetEffect, before: str = "") -> str:
    """Return in a few words how common an effect is, after a separator; empty of one of some machines."""
    words = "common" if effect.common else "there on average" if effect.on_average else ""
    return words and f"{before}{words}"


def parameter_cells(parameter: FleetParameter) -> tuple[str, str, str]:
    """Return mean, spread with its interval, and the typical standard deviation of one machine, with the unit."""
    p = parameter.population
    low, high = p.spread_interval
    std = float(sorted(parameter.std)[len(parameter.std) // 2])
    factor, unit = readable(parameter.unit, max(abs(p.mean), p.spread, std))
    unit = "" if unit == "1" else f" {unit}"
    mean, of_mean = measured(p.mean * factor, p.mean_std * factor)
    spread, low_text, high_text, std_text = (two_digits(x * factor) for x in (p.spread, low, high, std))
    return f"{mean} ± {of_mean}{unit}", f"{spread} ({low_text} to {high_text}){unit}", f"{std_text}{unit}"


def by_machine(found: Sequence[Odd | Change]) -> list[tuple[str, str]]:
    """Return each machine with the text of what is first of it, and which other parameters there are."""
    by: dict[str, list[Odd | Change]] = {}
    for one in found:
        by.setdefault(one.machine, []).append(one)
    texts = []
    for name, (first, *rest) in by.items():
        others = list(dict.fromkeys(one.key for one in rest if one.key != first.key))
        text = _odd_text(first) if isinstance(first, Odd) else _change_text(first)
        texts.append((name, text + (f"; also {joined(others, most=3)}" if others else "")))
    return texts


def _odd_text(one: Odd) -> str:
    value = valued(one.value, one.std, one.unit)
    others = valued(one.mean, one.spread or one.mean_std, one.unit)
    return f"{one.key} = {value}, where the others have {others}, p {_sign(one.p_value)}"


def valued(value: float, std: float, unit: str) -> str:
    """Return a value with its standard deviation and unit."""
    factor, unit = readable(unit, max(abs(value), std))
    number, spread = measured(value * factor, std * factor)
    return f"{number} ± {spread}{'' if unit == '1' else f' {unit}'}"


def _sign(p: float) -> str:
    text = probability(p)
    return text if text.startswith("<") else f"= {text}"


def about_alarms(fleet: Fleet) -> str:
    """Return a sentence on alarms and their rate, then which parameters changed in most machines at once."""
    changes = fleet.changes
    first, last = changes.nights[0].date, changes.nights[-1].date
    alarmed = _count(len({change.machine for change in changes.found}), "machine")
    head = f"{len(changes.nights)} nights, {first} to {last}: {alarmed} with an alarm"
    if not changes.tests:
        return f"{head}; changes are looked for from two nights of the same machine file on."
    rate = _count(changes.false_alarms, "false alarm")
    text = (
        f"{head}. By chance the whole fleet has {rate} a year: {changes.tests} tests a night, {FLEET.nights:g} nights "
        f"a year, each alarm with p below {changes.threshold:.1e}."
    )
    alarms = {(change.key, change.since, change.machine) for change in changes.found}
    counts = Counter((key, since) for key, since, _ in alarms)
    least = max(FLEET.common * len(fleet.diagnosed), 2)
    shared = [
        f"{key} changed in {count} machines on {since}: look at what they share, such as the instrument."
        for (key, since), count in sorted(counts.items())
        if count >= least
    ]
    return " ".join([text, *shared])


def _change_text(change: Change) -> str:
    size = valued(change.size, change.std, change.unit)
    what = f"changed by {size} on {change.since}"
    if change.what == "trend":
        what = f"drifts by {size} a day since {change.since}"
    return f"{change.key} {what}, p {_sign(change.p_value)}"
