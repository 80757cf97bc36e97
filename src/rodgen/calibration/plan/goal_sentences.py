"""Sentences on what a plan settles, and on what no measurement would settle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeAlias

from rodgen.calibration.plan.words import some
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.plan.candidate_plan import CandidatePlan, ParameterGain

__all__ = ["alternatives_sentences", "parameter_sentences"]

Pairs: TypeAlias = set[frozenset[int]]

MOST_SENTENCES = 2
"""Sentences on which effects a plan tells from which; the others are counted."""
KEYS = 6
"""Keys of parameters that a sentence names; the others are counted."""


def alternatives_sentences(best: CandidatePlan, group: int, titles: Sequence[str]) -> Iterator[str]:
    """Yield sentences on alternatives: which can be told apart, and why the others cannot.

    Parameters
    ----------
    best : CandidatePlan
    group : int
        Number of the alternatives.
    titles : sequence of str
        Titles of their effects.
    """
    campaign = best.campaign
    title = campaign.titles
    pairs = [gain.rivals for gain in best.gains if gain.rivals.group == group]
    refuted = [title[a] for of, a in campaign.refuted if of == group]
    left = [name for name in titles if name not in refuted]
    texts = _from_each_other({p.models for p in pairs if p.possible}, title)
    yield from (f"Tell {text}." for text in texts[:MOST_SENTENCES])
    if len(texts) > MOST_SENTENCES:
        yield f"And so on, for {len(texts) - MOST_SENTENCES} more of them."
    if refuted:
        verb = "fits" if len(refuted) == 1 else "fit"
        yield f"{joined(refuted)} {verb} the data worse already, or with sizes that no machine has."
    if len(left) == 1:
        yield f"{left[0]} is left."
    exact = {p.models for p in pairs if not p.possible and not p.tiny}
    small = {p.models for p in pairs if not p.possible} - exact
    if exact:
        yield (
            f"No measurement tells {_groups(exact, title, 2)} apart: they do the same to every reading within the "
            f"travel."
        )
    if small:
        yield f"Too much alike, as fitted, for a reasonable number of readings: {_groups(small, title, 1)}."
    larger = [
        (less, more)
        for of, less, more in campaign.included
        if of == group and frozenset((less, more)) not in exact | small
    ]
    if larger:
        less, more = larger[0]
        others = f" ({len(larger) - 1} more such)" if len(larger) > 1 else ""
        yield (
            f"{title[more]} can do all that {title[less]} does: no reading speaks for the latter, only that it is "
            f"simpler{others}."
        )


def parameter_sentences(
    best: CandidatePlan, gains: Sequence[ParameterGain], undetermined: Sequence[str]
) -> Iterator[str]:
    """Yield sentences on the parameters that are to be determined or sharpened.

    Parameters
    ----------
    best : CandidatePlan
    gains : sequence of ParameterGain
        Of the goal.
    undetermined : sequence of str
        Keys of those that no reading determines.
    """
    question = best.campaign.question
    if not gains and question.by_default:
        yield "Sharpen the model as a whole, as each parameter rests on a choice of coordinates."
        return
    if gains:
        verb = "Determine" if question.kind == "show" else "Sharpen"
        yield f"{verb} {some([gain.key for gain in gains], KEYS)}."
    unshown = [gain.key for gain in best.parameters if gain.unshown]
    if unshown and question.kind == "sharpen" and not question.by_default:
        yield f"No reading shows {some(unshown, KEYS)}: a choice of coordinates, or without any effect here."
    if undetermined:
        names = "them" if len(undetermined) == len(gains) else some(undetermined, KEYS)
        yield f"No reading within the travel determines {names}."


def _groups(pairs: Pairs, title: Sequence[str], most: int) -> str:
    """Name the largest groups of models of which all are pairs, and count the others."""
    groups = sorted(_together(pairs), key=len, reverse=True)
    texts = [some([title[k] for k in group]) for group in groups[:most]]
    more = len(groups) - len(texts)
    return "; ".join([*texts, *([f"and {more} more group{'s' * (more > 1)}"] if more else [])])


def _from_each_other(pairs: Pairs, title: Sequence[str]) -> list[str]:
    """Say which effects are to be told from which: all from each other, or one after the other from some."""
    nodes = sorted({k for pair in pairs for k in pair})
    if nodes and 2 * len(pairs) == len(nodes) * (len(nodes) - 1):
        return [f"{some([title[k] for k in nodes])} apart"]
    left, found = set(pairs), []
    while left:
        most = max(nodes, key=lambda k: sum(k in pair for pair in left))
        others = [k for k in nodes if frozenset((k, most)) in left]
        left -= {frozenset((k, most)) for k in others}
        found.append(f"{title[most]} from {some([title[k] for k in others])}")
    return found


def _together(pairs: Iterable[frozenset[int]]) -> list[list[int]]:
    """Return groups of numbers of which all are pairs; every pair is in one."""
    every = set(pairs)
    nodes = sorted({k for pair in every for k in pair})
    groups: list[list[int]] = []
    for pair in sorted(every, key=sorted):
        if any(pair <= set(group) for group in groups):
            continue
        group = sorted(pair)
        while True:
            more = [k for k in nodes if k not in group and all(frozenset((k, x)) in every for x in group)]
            if not more:
                break
            group.append(more[0])
        groups.append(sorted(group))
    return groups
