"""What measurements are planned for and expected to bring, and the sentences that say so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from rodgen.calibration.words import NAMES
from rodgen.errors import joined
from rodgen.statistics.thresholds import PLAN
from rodgen.views import plain

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.calibration.plan.candidate_plan import CandidatePlan

Pairs: TypeAlias = set[frozenset[int]]

MOST_SENTENCES = 2
"""Sentences on which effects a plan distinguishes; the others are counted."""
KEYS = 6
"""Keys of parameters that a sentence names; the others are counted."""


@dataclass(frozen=True)
class Gain:
    """What one goal has now, and is expected to have with the planned readings.

    Attributes
    ----------
    what : str
        ``"chi_square"`` (by how much the wrong effect fits worse than the right one) or ``"std"`` of a parameter.
    of : str
        If which effect is the right one, and which the wrong; or the parameter's key.
    now, after : float or None
        None where it cannot be said: the standard deviation of what is not determined.
    needed : float or None
        The chi-square at which effects count as distinguished; None for a parameter.
    probability : float or None
        That it is reached, if the fitted sizes are true.
    unit : str
        Of a standard deviation; empty for chi-square.
    determined : bool
        Whether a parameter is determined then; its standard deviation is None even so where the noise is not known.
    """

    what: str
    of: str
    now: float | None
    after: float | None
    needed: float | None = None
    probability: float | None = None
    unit: str = ""
    determined: bool = True

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


@dataclass(frozen=True)
class Goal:
    """Something that measurements are to settle.

    Attributes
    ----------
    kind : str
        ``"separate"`` (effects that look the same), ``"show"`` (parameters that the data do not determine), or
        ``"sharpen"`` (parameters that were asked for), or ``"order"`` (what the order of the rows hid).
    effects : tuple of str
        Titles of the effects to distinguish.
    parameters : tuple of str
        Keys of the parameters that are to be determined or sharpened.
    sentence : str
    resolvable : bool
        Whether any reading within the travel could.
    reached : bool
        Whether the planned ones do, with a probability of 95 %.
    gains : tuple of Gain
    """

    kind: str
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    sentence: str
    resolvable: bool
    reached: bool
    gains: tuple[Gain, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        found = plain(self, "kind effects parameters sentence resolvable reached")
        return found | {"gain": [gain.to_dict() for gain in self.gains]}


def goals_of(best: CandidatePlan, fit: FittedModel) -> Iterator[Goal]:
    """Yield the goals of a plan for a fit: one for each group of alternatives, and one for all parameters."""
    for group, effects in enumerate(best.campaign.question.alternatives):
        yield _separation(best, group, tuple(e.title for e in effects))
    if best.parameters:
        yield _parameters(best, fit)


def _separation(best: CandidatePlan, group: int, titles: tuple[str, ...]) -> Goal:
    """Return the goal to distinguish alternatives."""
    title = best.campaign.titles
    found = [gain for gain in best.gains if gain.pair.group == group]
    possible = sorted(
        (gain for gain in found if gain.pair.possible), key=lambda gain: (gain.probability, gain.after)
    )
    gains = tuple(
        Gain(
            "chi_square",
            f"{title[gain.pair.true]}, not {title[gain.pair.wrong]}",
            gain.pair.now,
            gain.after,
            gain.pair.threshold,
            gain.probability,
        )
        for gain in possible
    )
    sentence = " ".join(_alternatives_sentences(best, group, titles))
    reached = all(gain.reached for gain in found)
    return Goal("separate", titles, (), sentence, bool(possible), reached, gains)


def _parameters(best: CandidatePlan, fit: FittedModel) -> Goal:
    """Return the goal to determine or sharpen parameters."""
    question, unshown = best.campaign.question, best.campaign.unshown
    show = question.kind == "show"
    if not question.asked and (sentence := no_gain(best)):
        keys = tuple(gain.of for gain in best.parameters)
        return Goal(question.kind, (), keys, sentence, False, False, tuple(best.parameters))
    as_a_whole = question.by_default and not show
    shown = [gain for gain in best.parameters if gain.of not in unshown]
    if show:  # what is only weakly determined, and stays so, is not worth a sentence
        shown = [
            gain for gain in shown if gain.now is None or (gain.after or gain.now) < PLAN.sharper * gain.now
        ]
    undetermined = [gain.of for gain in shown if not gain.determined]
    solved = len(undetermined) < len(shown)
    if show and solved:
        shown = [gain for gain in shown if gain.determined]
        lacking = zip(fit.parameters, fit.determinacy.undetermined, strict=True)
        named = {parameter.key for parameter, is_lacking in lacking if is_lacking}
        undetermined = [key for key in undetermined if key in named]
    return Goal(
        question.kind,
        (),
        tuple(gain.of for gain in best.parameters),
        " ".join(_parameter_sentences(best, [gain.of for gain in shown], undetermined)),
        solved or (not shown and as_a_whole),
        not undetermined and (as_a_whole or not unshown),
        tuple(shown),
    )


def no_gain(best: CandidatePlan) -> str:
    """Return a sentence on readings that sharpen no parameter; empty where they do, or determine one."""
    left = best.sharpest
    if best.campaign.question.kind == "show" or left is None or left <= PLAN.noticed:
        return ""
    count, keys = best.rows.n, [gain.of for gain in best.parameters]
    return (
        f"{count} further reading{'s' * (count != 1)} would lower no standard deviation of {joined(keys, most=KEYS)} "
        f"by more than {100 * (1 - left):.1g} %, beside the {best.campaign.o.n} that there are."
    )


def _alternatives_sentences(best: CandidatePlan, group: int, titles: Sequence[str]) -> Iterator[str]:
    """Yield sentences on alternatives: which can be distinguished, and why the others cannot."""
    campaign = best.campaign
    title = campaign.titles
    pairs = [gain.pair for gain in best.gains if gain.pair.group == group]
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
        yield f"Only {left[0]} remains."
    exact = {p.models for p in pairs if not p.possible and not p.tiny}
    small = {p.models for p in pairs if not p.possible} - exact
    if exact:
        yield (
            "No measurement can tell these apart, as they change every reading within the travel in the same way: "
            f"{_groups(exact, title, 2)}."
        )
    if small:
        yield (
            f"Too similar, as fitted, to be distinguished by a reasonable number of readings: "
            f"{_groups(small, title, 1)}."
        )
    larger = [
        (less, more)
        for of, less, more in campaign.included
        if of == group and frozenset((less, more)) not in exact | small
    ]
    if larger:
        less, more = larger[0]
        others = f" ({len(larger) - 1} more such)" if len(larger) > 1 else ""
        yield (
            f"{title[more]} can reproduce all that {title[less]} does: no reading favours the latter, which is only "
            f"simpler{others}."
        )


def _parameter_sentences(
    best: CandidatePlan, keys: Sequence[str], undetermined: Sequence[str]
) -> Iterator[str]:
    """Yield sentences on the parameters that are to be determined or sharpened."""
    question = best.campaign.question
    if not keys and question.by_default and question.kind == "sharpen":
        yield "Sharpen the model as a whole, as each parameter rests on a choice of coordinates."
        return
    if keys:
        verb = "Determine" if question.kind == "show" else "Sharpen"
        yield f"{verb} {joined(keys, most=KEYS)}."
    unshown = [gain.of for gain in best.parameters if gain.of in best.campaign.unshown]
    if unshown and question.kind == "sharpen" and not question.by_default:
        yield f"No reading shows {joined(unshown, most=KEYS)}: a choice of coordinates, or without any effect here."
    if not keys and question.kind == "show":
        yield f"No reading within the travel determines {joined([gain.of for gain in best.parameters], most=KEYS)}."
    if undetermined:
        names = "them" if len(undetermined) == len(keys) else joined(undetermined, most=KEYS)
        yield f"No reading within the travel determines {names}."


def _groups(pairs: Pairs, title: Sequence[str], most: int) -> str:
    """Name the largest groups of models of which all are pairs, and count the others."""
    groups = sorted(_together(pairs), key=len, reverse=True)
    texts = [joined([title[k] for k in group], most=NAMES) for group in groups[:most]]
    more = len(groups) - len(texts)
    return "; ".join([*texts, *([f"and {more} more group{'s' * (more > 1)}"] if more else [])])


def _from_each_other(pairs: Pairs, title: Sequence[str]) -> list[str]:
    """Say which effects are to be distinguished: all from each other, or one after the other from some."""
    nodes = sorted({k for pair in pairs for k in pair})
    if nodes and 2 * len(pairs) == len(nodes) * (len(nodes) - 1):
        return [f"{joined([title[k] for k in nodes], most=NAMES)} apart"]
    left, found = set(pairs), []
    while left:
        most = max(nodes, key=lambda k: sum(k in pair for pair in left))
        others = [k for k in nodes if frozenset((k, most)) in left]
        left -= {frozenset((k, most)) for k in others}
        found.append(f"{title[most]} from {joined([title[k] for k in others], most=NAMES)}")
    return found


def _together(pairs: Pairs) -> list[list[int]]:
    """Return groups of numbers of which all are pairs; every pair is in one."""
    nodes = sorted({k for pair in pairs for k in pair})
    groups: list[list[int]] = []
    for pair in sorted(pairs, key=sorted):
        if any(pair <= set(group) for group in groups):
            continue
        group = sorted(pair)
        for k in nodes:
            if k not in group and all(frozenset((k, x)) in pairs for x in group):
                group.append(k)
        groups.append(sorted(group))
    return groups
