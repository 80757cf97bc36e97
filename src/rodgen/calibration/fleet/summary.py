"""What there is to say of a fleet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from rodgen.calibration.diagnosis import VERDICTS
from rodgen.calibration.fleet.changes import Change
from rodgen.calibration.fleet.fleet import Fleet, FleetEffect, FleetParameter, Kind, Odd
from rodgen.calibration.words import capitalized, probability, sized, two_digits
from rodgen.data.units import readable
from rodgen.document import Block, Document, Facts, Paragraph, Part, Table
from rodgen.errors import counted, joined
from rodgen.statistics.digits import measured
from rodgen.statistics.thresholds import FLEET

MOST = 12
"""Rows of a list that are shown at once."""
DRAWN, COLUMNS = 8, 4
"""Parameters of each kind of machine that are drawn, and that each machine is listed with."""


def document(fleet: Fleet) -> Document:
    """Return what is known of a fleet: what failed, alarms, odd machines, and the effects of each kind."""
    return Document(list(_blocks(fleet)))


def _blocks(fleet: Fleet) -> Iterator[Block]:
    yield Paragraph(about_machines(fleet))
    if fleet.failed:
        rows = [(machine.name, machine.error) for machine in fleet.failed]
        yield Part([Facts(rows)], "Not diagnosed", "section")
    if len(fleet.changes.nights) > 1:
        rows = by_machine(fleet.changes.found)
        yield Part([Paragraph(about_alarms(fleet)), *_listed("what changed", rows)], "Alarms", "section")
    if any(kind.parameters for kind in fleet.kinds):
        rows = by_machine(fleet.odd)
        like = f"{len(rows) or 'None'}; of these {FLEET.false_discoveries:.0%} may be like the others."
        yield Part([Paragraph(like), *_listed("what is odd", rows)], "Odd machines", "section")
    for kind in fleet.kinds:
        yield Part(list(_effects(kind)), f"Effects of {kind.title}", "section")


def _listed(what: str, rows: list[tuple[str, str]]) -> list[Block]:
    more = "more machines, which the page and --json show"
    return [Table(("machine", what), rows, most=MOST, more=more)] if rows else []


def _effects(kind: Kind) -> Iterator[Block]:
    spread = "Spread is that of the machines themselves, with its 95 % interval."
    few = f"A distribution is estimated from {FLEET.fewest} machines on."
    note = few if len(kind.machines) < FLEET.fewest else spread
    yield Paragraph(f"{counted(len(kind.machines), 'machine')}. {note}")
    rows = []
    for effect in kind.effects:
        head = (effect.title + about_effect(effect), f"{effect.found} of {effect.of}", f"{effect.alike}")
        for parameter in effect.parameters or (None,):
            cells = ("", "–", "–", "–")
            if parameter is not None:
                cells = parameter.key.rpartition(".")[2], *parameter_cells(parameter)
            rows.append((*head, *cells))
            head = ("", "", "")
    header = (
        "effect",
        "found in",
        "may be in",
        "parameter",
        "mean",
        "spread between machines",
        "one machine ±",
    )
    more = "more rows, which the page and --json show"
    yield (
        Table(header, rows, most=MOST, more=more)
        if rows
        else Paragraph("No effect was found in any of them.")
    )


def machines(kind: Kind) -> Part:
    """Return each machine of a kind: its verdict, what is known of it alone, and given the others."""
    columns = drawn_parameters(kind)[:COLUMNS]
    places = [{name: i for i, name in enumerate(p.machines)} for p in columns]
    rows = []
    for machine in kind.machines:
        rms = machine.result["rms"]
        cells = [machine.name, VERDICTS[str(machine.result["verdict"])], ", ".join(machine.found) or "–"]
        cells.append("–" if rms["after"] is None else sized(float(rms["after"]), str(rms["unit"])))
        for p, place in zip(columns, places, strict=True):
            i = place.get(machine.name)
            pairs = ((p.values, p.std), (p.population.shrunk, p.population.shrunk_std))
            cells += ["–" if i is None else valued(float(x[i]), float(u[i]), p.unit) for x, u in pairs]
        rows.append(tuple(cells))
    header = ["machine", "verdict", "effects", "error left"]
    header += [words for p in columns for words in (f"{p.key} alone", "given the others")]
    note = "What is known of a machine given the others is nearer to the truth on average than what it shows alone."
    blocks: list[Block] = [*([Paragraph(note)] if columns else []), Table(header, rows)]
    return Part(blocks, capitalized(kind.title), "section")


def drawn_parameters(kind: Kind) -> list[FleetParameter]:
    """Return the parameters of the commonest effects, which are drawn."""
    return [p for effect in kind.effects for p in effect.parameters][:DRAWN]


def about_machines(fleet: Fleet) -> str:
    """Return a sentence on how many machines were diagnosed, and what was found."""
    counts = Counter(str(machine.result["verdict"]) for machine in fleet.diagnosed)
    about = [f"{words} in {counts[verdict]}" for verdict, words in VERDICTS.items() if counts[verdict]]
    about += [f"{len(fleet.failed)} could not be diagnosed"] * bool(fleet.failed)
    about += [f"{len(fleet.pending)} are not diagnosed yet"] * bool(fleet.pending)
    return f"{counted(len(fleet.machines), 'machine')}, {fleet.plan.date}: {joined(about)}."


def about_effect(effect: FleetEffect) -> str:
    """Return in a few words how common an effect is, after a comma; empty of one of some machines."""
    return ", common" if effect.common else ", there on average" if effect.on_average else ""


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


def by_machine(those: Sequence[Odd | Change]) -> list[tuple[str, str]]:
    """Return each machine with the text of what is first of it, and which other parameters there are."""
    by: dict[str, list[Odd | Change]] = {}
    for one in those:
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
    alarmed = counted(len({change.machine for change in changes.found}), "machine")
    head = f"{len(changes.nights)} nights, {first} to {last}: {alarmed} with an alarm"
    if not changes.tests:
        return f"{head}; changes are looked for from two nights of the same machine file on."
    rate = counted(changes.false_alarms, "false alarm")
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
