"""What a fit or a diagnosis leaves open, which further measurements could settle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
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
        Of the model as it was, and of the model with all effects that were found.
    found : tuple of Effect or None
        Effects that were found; None where none were looked for.
    alternatives : tuple of tuple of Effect
        An effect that was found, and those that the data cannot tell from it.
    invisible : tuple of Effect
        Effects that the data would not show.
    dependent : bool
        Whether readings were found to depend on each other.
    spread : mapping of str to float
        By what factor the standard deviation of a parameter of an effect exceeds that of the final fit therefore.
    """

    base: FittedModel
    final: FittedModel
    found: tuple[Effect, ...] | None = None
    alternatives: tuple[tuple[Effect, ...], ...] = ()
    invisible: tuple[Effect, ...] = ()
    dependent: bool = False
    spread: Mapping[str, float] = field(default_factory=dict)


class HasOpenQuestions(Protocol):
    """A fit or a diagnosis."""

    @property
    def open_questions(self) -> OpenQuestions:
        """What it leaves open."""
        ...
