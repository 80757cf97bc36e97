"""How a fit or a diagnosis reports where it is to a function of the caller."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TypeAlias

from rodgen.stages import listening

Progress: TypeAlias = Callable[[str, int, int | None], object]
"""Called with the stage, how many of its steps are done, and of how many, None where that is not known."""


def reporting(progress: Progress | None) -> AbstractContextManager[None]:
    """Return a context in which a function is called when a stage begins, and with each of its steps."""
    return nullcontext() if progress is None else listening(_Caller(progress))


class _Caller:
    """A listener that calls a function."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.stages: list[tuple[str, int | None]] = []

    def begin(self, what: str, total: int | None) -> None:
        self.stages.append((what, total))
        self.progress(what, 0, total)

    def step(self, done: int) -> None:
        what, total = self.stages[-1]
        self.progress(what, done, total)

    def end(self) -> None:
        self.stages.pop()
