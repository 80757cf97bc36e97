"""A plan as text: what to measure, what it settles, what else is to be known, and a small table of what is expected."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from textwrap import wrap
from typing import TYPE_CHECKING

from rodgen.calibration.plan.goals import Gain, Goal
from rodgen.calibration.plan.table import as_text
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.plan import Plan

MOST_GAINS = 6
"""Gains of a goal in its table; the others are counted."""
WIDTH = 100
"""Of a line of text."""
NONE = 0.005
"""Chi-square below which it is none."""
HARDLY = 0.005
"""A smaller probability, or one as near to 1, is given in words."""


def lines_of(plan: Plan) -> Iterator[str]:
    """Yield the lines of a plan."""
    if not plan.goals:
        yield from plan.notes
        return
    if plan.count:
        yield f"What to measure: {plan.count} reading{'s' * (plan.count != 1)}"
        yield from _wrapped(plan.words)
        yield from (f"    {line}" for line in as_text(plan.rows))
        if plan.new_targets:
            yield "In the machine file"
            yield from (f"    {line}" for line in plan.target_blocks().splitlines())
        yield "What it settles"
    else:
        if plan.travel_missing:
            yield f"Nothing to measure before the machine file states how far {joined(plan.travel_missing)} can go."
        elif all(goal.kind == "sharpen" for goal in plan.goals):
            yield "Nothing to measure would tell more."
        else:
            yield "Nothing to measure: no reading within the travel settles what is open."
        yield "What is open"
    for goal in plan.goals:
        yield from _wrapped(_sentences(goal, bool(plan.count)))
    if plan.notes:
        yield "Notes"
    yield from _wrapped(plan.notes)
    if plan.count:
        for goal in plan.goals:
            if goal.resolvable and goal.gains:
                yield from _table(goal)


def _wrapped(sentences: Iterable[str]) -> Iterator[str]:
    """Yield sentences as indented lines, each from a line of its own on."""
    for sentence in sentences:
        yield from wrap(
            sentence,
            WIDTH,
            initial_indent="  ",
            subsequent_indent="    ",
            break_long_words=False,
            break_on_hyphens=False,
        )


def _sentences(goal: Goal, planned: bool) -> Iterator[str]:
    """Yield the sentences of a goal, with the chances after the first one."""
    first, stop, rest = goal.sentence.partition(". ")
    yield f"{first}." if stop else first
    if planned:
        yield from _chances(goal)
    if rest:
        *most, last = rest.split(". ")
        yield from (f"{sentence}." for sentence in most)
        yield last


def _chances(goal: Goal) -> Iterator[str]:
    chances = [gain.probability for gain in goal.gains if gain.probability is not None]
    if not goal.resolvable or not chances:
        return
    low, high = min(chances), max(chances)
    if goal.reached:
        yield f"Probability that these readings suffice: {_percent(low)}."
    elif high < HARDLY:
        yield "These readings alone are unlikely to suffice."
    else:
        of = [_percent(low), _percent(high)]
        said = of[0] if of[0] == of[1] else f"{of[0]} to {of[1]}, depending on which is present"
        yield f"Probability that these readings suffice: {said}."


def _table(goal: Goal) -> Iterator[str]:
    """Yield a small table of what is expected."""
    if goal.kind == "separate":
        better = any(gain.now is not None and gain.now < -NONE for gain in goal.gains[:MOST_GAINS])
        sign = " (below zero: it fits better)" if better else ""
        yield f"By how much the wrong effect fits worse, in chi-square{sign}"
        rows = [["", "now", "then", "needed", "chance"]]
    else:
        yield "Standard deviations"
        rows = [["", "now", "then"]]
    rows += [_cells(gain) for gain in goal.gains[:MOST_GAINS]]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for name, *cells in rows:
        numbers = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        yield f"  {'  '.join([name.ljust(widths[0]), *numbers])}"
    if len(goal.gains) > MOST_GAINS:
        yield f"  and {len(goal.gains) - MOST_GAINS} more"


def _cells(gain: Gain) -> list[str]:
    if gain.what == "std":
        unit = "" if gain.unit == "1" else f" {gain.unit}"
        then = "unknown" if gain.determined else "open"  # where the noise is not known
        stds = [(gain.now, "open"), (gain.after, then)]
        return [gain.of, *(lacking if x is None else f"± {x:.3g}{unit}" for x, lacking in stds)]
    sizes = (gain.now, gain.after, gain.needed)
    found = ["" if x is None else f"{x:.3g}" if abs(x) > NONE else "0" for x in sizes]
    return [gain.of, *found, "" if gain.probability is None else _percent(gain.probability)]


def _percent(probability: float) -> str:
    if probability > 1 - HARDLY:
        return "more than 99 %"
    return "less than 1 %" if probability < HARDLY else f"{100 * probability:.0f} %"
