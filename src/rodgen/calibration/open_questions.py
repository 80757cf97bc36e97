"""What a fit or a diagnosis leaves open, which further measurements could settle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.machines.machine import Effect


@dataclass(frozen=True)
class OpenQuestions:
    """What a fit or a diagnosis leaves open."""

    final: Fit
    """With all effects and forms that were found."""
    found: tuple[Effect, ...] | None = None
    """Effects and forms that were found; None where none were looked for."""
    alternatives: tuple[tuple[Effect, ...], ...] = ()
    """An effect that was found, and those that the data cannot tell from it."""
    sides: tuple[Effect, ...] = ()
    """Play of joints that are to be approached from both sides."""
    why: str = ""
    """The reason for that, in a sentence."""


class HasOpenQuestions(Protocol):
    """A fit or a diagnosis."""

    @property
    def open_questions(self) -> OpenQuestions:
        """What it leaves open."""
        ...
