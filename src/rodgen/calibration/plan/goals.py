"""What measurements are planned for, and what they are expected to bring."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgen.calibration.plan.goal_sentences import alternatives_sentences, parameter_sentences

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.calibration.plan.candidate_plan import CandidatePlan

__all__ = ["Gain", "Goal", "goals_of"]


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
        The chi-square at which effects count as told apart; None for a parameter.
    probability : float or None
        That it is reached, if the fitted sizes are true.
    unit : str
        Of a standard deviation; empty for chi-square.
    """

    what: str
    of: str
    now: float | None
    after: float | None
    needed: float | None = None
    probability: float | None = None
    unit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "what": self.what,
            "of": self.of,
            "now": self.now,
            "after": self.after,
            "needed": self.needed,
            "probability": self.probability,
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Goal:
    """Something that measurements are to settle.

    Attributes
    ----------
    kind : str
        ``"separate"`` (effects that look the same), ``"show"`` (parameters that the data do not determine), or
        ``"sharpen"`` (parameters that were asked for).
    effects : tuple of str
        Titles of the effects that are to be told apart.
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
        return {
            "kind": self.kind,
            "effects": list(self.effects),
            "parameters": list(self.parameters),
            "sentence": self.sentence,
            "resolvable": self.resolvable,
            "reached": self.reached,
            "gain": [gain.to_dict() for gain in self.gains],
        }


def goals_of(best: CandidatePlan, fit: FittedModel) -> Iterator[Goal]:
    """Yield the goals of a plan for a fit: one for each group of alternatives, and one for all parameters."""
    for group, effects in enumerate(best.campaign.question.alternatives):
        yield _separation(best, group, tuple(e.title for e in effects))
    if best.parameters:
        yield _parameters(best, fit)


def _separation(best: CandidatePlan, group: int, titles: tuple[str, ...]) -> Goal:
    """Return the goal to tell alternatives apart."""
    title = best.campaign.titles
    found = [gain for gain in best.gains if gain.rivals.group == group]
    possible = sorted(
        (gain for gain in found if gain.rivals.possible), key=lambda gain: (gain.probability, gain.after)
    )
    gains = tuple(
        Gain(
            "chi_square",
            f"{title[gain.rivals.pair.true]}, not {title[gain.rivals.pair.wrong]}",
            gain.rivals.pair.now,
            gain.after,
            gain.rivals.threshold,
            gain.probability,
        )
        for gain in possible
    )
    sentence = " ".join(alternatives_sentences(best, group, titles))
    reached = all(gain.reached for gain in found)
    return Goal("separate", titles, (), sentence, bool(possible), reached, gains)


def _parameters(best: CandidatePlan, fit: FittedModel) -> Goal:
    """Return the goal to determine or sharpen parameters."""
    question = best.campaign.question
    show = question.kind == "show"
    shown = [gain for gain in best.parameters if not gain.unshown and not (show and gain.now is not None)]
    undetermined = [gain.key for gain in shown if gain.after is None]
    solved = len(undetermined) < len(shown)
    if show and solved:
        # what is only weakly determined, and stays so, is not worth a sentence
        shown = [gain for gain in shown if gain.after is not None]
        lacking = zip(fit.parameters, fit.determinacy.undetermined, strict=True)
        named = {parameter.key for parameter, is_lacking in lacking if is_lacking}
        undetermined = [key for key in undetermined if key in named]
    any_unshown = any(gain.unshown for gain in best.parameters)
    return Goal(
        question.kind,
        (),
        tuple(gain.key for gain in best.parameters),
        " ".join(parameter_sentences(best, shown, undetermined)),
        solved or (not shown and question.by_default),
        not undetermined and (question.by_default or not any_unshown),
        tuple(Gain("std", gain.key, gain.now, gain.after, unit=gain.unit) for gain in shown),
    )
