"""What a fit or a diagnosis leaves open, which further measurements could settle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.machines.machine import Effect

__all__ = ["HasOpenQuestions", "OpenQuestions"]


@dataclass(frozen=True)
class OpenQuestions:
    """What a fit or a diagnosis leaves open.

    Attributes
    ----------
    base, final : FittedModel
        Of the model as it was, and of the model with all effects and forms that were found.
    found : tuple of Effect or None
        Effects and forms that were found; None where none were looked for.
    alternatives : tuple of tuple of Effect
        An effect that was found, and those that the data cannot tell from it.
    invisible : tuple of Effect
        Effects that the data would not show.
    dependent : bool
        Whether readings were found to depend on each other.
    wanders : bool
        Whether the set-up was found to wander from pose to pose.
    """

    base: FittedModel
    final: FittedModel
    found: tuple[Effect, ...] | None = None
    alternatives: tuple[tuple[Effect, ...], ...] = ()
    invisible: tuple[Effect, ...] = ()
    dependent: bool = False
    wanders: bool = False


class HasOpenQuestions(Protocol):
    """A fit or a diagnosis."""

    @property
    def open_questions(self) -> OpenQuestions:
        """What it leaves open."""
        ...
