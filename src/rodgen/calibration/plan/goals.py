"""What measurements are planned for and expected to bring, and the sentences that say so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.plan.campaign import MOST_READINGS, PairGain, Search
from rodgen.calibration.words import NAMES
from rodgen.errors import joined
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit

SHARPER = 0.5
"""Part to which a standard deviation must fall for readings to be said to determine the parameter."""
NOTICED = 0.95
"""Readings that lower every standard deviation to no less than this part sharpen nothing: how large a standard
deviation is, is known to a twentieth from 200 readings."""

MOST_GROUPS = 2
"""Groups of effects that a sentence names; the others are counted."""
KEYS = 6
"""Keys of parameters that a sentence names; the others are counted."""
HARDLY = 0.005
"""A smaller probability, or one as near to 1, is given in words."""


@dataclass(frozen=True)
class Gain(Result):
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


@dataclass(frozen=True)
class Goal(Result):
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
    sentences : tuple of str
        What the readings decide, how well, and what they cannot decide.
    resolvable : bool
        Whether any reading within the travel could.
    reached : bool
        Whether the planned ones do, with a probability of 95 %.
    gains : tuple of Gain
    """

    kind: str
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    sentences: tuple[str, ...]
    resolvable: bool
    reached: bool
    gains: tuple[Gain, ...]

    _keys = "kind effects parameters sentence resolvable reached gain=gains"

    @property
    def sentence(self) -> str:
        """All sentences as one text."""
        return " ".join(self.sentences)


def goals_of(search: Search, fit: Fit) -> Iterator[Goal]:
    """Yield the goals of a plan for a fit: one for each group of alternatives, and one for all parameters."""
    gains = search.gains()
    for group, effects in enumerate(search.campaign.question.alternatives):
        yield _separation(search, group, gains, tuple(e.title for e in effects))
    if search.campaign.key_model is not None:
        yield _sharpening(search, fit, _parameters(search))


# effects -------------------------------------------------------------------------------------------------------------


def _separation(search: Search, group: int, every: Sequence[PairGain], titles: tuple[str, ...]) -> Goal:
    """Return the goal to distinguish alternatives."""
    title = search.campaign.titles
    found = [gain for gain in every if gain.pair.group == group]
    possible = sorted(
        (gain for gain in found if gain.pair.possible), key=lambda gain: (gain.probability, gain.after)
    )
    reached = all(gain.reached for gain in found)
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
    alike = {gain.pair.models for gain in found if not gain.pair.possible}
    sentences = []
    if possible:
        names = joined([title[k] for k in sorted({k for gain in possible for k in gain.pair.models})])
        sentences = [
            f"Tell {names} apart{', except within the groups below' if alike else ''}.",
            _chances([gain.probability for gain in possible], reached),
        ]
    refuted = [title[a] for of, a in search.campaign.refuted if of == group]
    if refuted:
        verb = "fits" if len(refuted) == 1 else "fit"
        left = [name for name in titles if name not in refuted]
        only = f"Only {left[0]} remains: " if len(left) == 1 else ""
        sentences.append(
            f"{only}{joined(refuted)} {verb} the data worse already, or with sizes that no machine has."
        )
    if alike:
        groups = sorted(_together(alike), key=len, reverse=True)
        texts = [joined([title[k] for k in numbers], most=NAMES) for numbers in groups[:MOST_GROUPS]]
        if more := len(groups) - len(texts):
            texts.append(f"and {more} more group{'s' * (more > 1)}")
        sentences.append(f"No {MOST_READINGS} readings within reach would distinguish {'; '.join(texts)}.")
    if not sentences:
        sentences = [f"Fewer than two of {joined(titles)} can be added to this machine."]
    return Goal("separate", titles, (), tuple(sentences), bool(possible), reached, gains)


def _chances(chances: Sequence[float], reached: bool) -> str:
    low, high = _percent(min(chances)), _percent(max(chances))
    if reached:
        return f"Probability that these readings suffice: {low}."
    if max(chances) < HARDLY:
        return "These readings alone are unlikely to suffice."
    said = low if low == high else f"{low} to {high}, depending on which is present"
    return f"Probability that these readings suffice: {said}."


def _percent(probability: float) -> str:
    if probability > 1 - HARDLY:
        return "more than 99 %"
    return "less than 1 %" if probability < HARDLY else f"{100 * probability:.0f} %"


def _together(pairs: set[frozenset[int]]) -> list[list[int]]:
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


# parameters ----------------------------------------------------------------------------------------------------------


def _parameters(search: Search) -> list[Gain]:
    """Return the standard deviations that a fit states now, and is expected to state with planned readings."""
    campaign, number = search.campaign, search.campaign.key_model
    assert number is not None
    fit = campaign.models[number].fit
    further = search.linearized[number].jacobian * np.sqrt(
        campaign.variance
    )  # of weighted readings, as a fit takes them
    expected = fit.estimates_with(further.reshape(-1, further.shape[-1]))
    found = []
    for key in campaign.question.keys:
        now, after = fit.estimates.get(key), expected.get(key)
        if now is None or after is None or key in campaign.unshown:
            found.append(Gain("std", key, None, None, determined=False))
            continue
        found.append(Gain("std", key, now.std, after.std, unit=now.unit, determined=after.determined))
    return found


def _sharpening(search: Search, fit: Fit, every: Sequence[Gain]) -> Goal:
    """Return the goal to determine or sharpen parameters."""
    question, unshown = search.campaign.question, search.campaign.unshown
    show = question.kind == "show"
    keys = tuple(gain.of for gain in every)
    idle = tuple(_no_gain(search, every))
    if idle and not question.asked:
        return Goal(question.kind, (), keys, idle, False, False, tuple(every))
    as_a_whole = question.by_default and not show
    shown = [gain for gain in every if gain.of not in unshown]
    if show:  # what is only weakly determined, and stays so, is not worth a sentence
        shown = [gain for gain in shown if gain.now is None or (gain.after or gain.now) < SHARPER * gain.now]
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
        keys,
        (*_parameter_sentences(search, shown, undetermined), *idle),
        solved or (not shown and as_a_whole),
        not undetermined and (as_a_whole or not unshown),
        tuple(shown),
    )


def _no_gain(search: Search, gains: Sequence[Gain]) -> Iterator[str]:
    """Yield a sentence on readings that sharpen no parameter; none where they do, or determine one."""
    unknown = any(gain.now is None or gain.after is None for gain in gains)
    left = [gain.after / gain.now for gain in gains if gain.now and gain.after]
    if search.campaign.question.kind == "show" or unknown or not left or min(left) <= NOTICED:
        return
    count, keys = search.rows.n, [gain.of for gain in gains]
    yield (
        f"{count} further reading{'s' * (count != 1)} would lower no standard deviation of {joined(keys, most=KEYS)} "
        f"by more than {100 * (1 - min(left)):.1g} %, beside the {search.campaign.o.n} that there are."
    )


def _parameter_sentences(search: Search, shown: Sequence[Gain], undetermined: Sequence[str]) -> Iterator[str]:
    """Yield sentences on the parameters that are to be determined or sharpened."""
    question, unshown = search.campaign.question, search.campaign.unshown
    keys, show = [gain.of for gain in shown], question.kind == "show"
    if not keys and question.by_default and not show:
        yield "Sharpen the model as a whole, as each parameter rests on a choice of coordinates."
        return
    if keys:
        yield f"{'Determine' if show else 'Sharpen'} {joined(keys, most=KEYS)}."
    if determined := [gain for gain in shown if gain.determined]:
        more = f"; and {len(determined) - KEYS} more" if len(determined) > KEYS else ""
        yield f"Standard deviations: {'; '.join(map(_std, determined[:KEYS]))}{more}."
    hidden = [key for key in question.keys if key in unshown]
    if hidden and not show and not question.by_default:
        yield f"No reading shows {joined(hidden, most=KEYS)}: a choice of coordinates, or without any effect here."
    if not keys and show:
        yield f"No reading within the travel determines {joined(question.keys, most=KEYS)}."
    if undetermined:
        names = "them" if len(undetermined) == len(keys) else joined(undetermined, most=KEYS)
        yield f"No reading within the travel determines {names}."


def _std(gain: Gain) -> str:
    unit = "" if gain.unit == "1" else f" {gain.unit}"
    now = "not determined" if gain.now is None else f"± {gain.now:.3g}{unit}"
    then = "known from these readings" if gain.after is None else f"± {gain.after:.3g}{unit}"
    return f"{gain.of} now {now}, then {then}"
