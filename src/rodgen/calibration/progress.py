"""How a fit reports where it is."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

__all__ = ["Progress", "of_stage"]

Progress: TypeAlias = Callable[[str, int, float], object]
"""Called with what is done, the iteration and the cost."""


def of_stage(progress: Progress | None, what: str) -> Callable[[int, float], object] | None:
    """Return what reports the iterations and costs of one stage, named by `what`."""
    return None if progress is None else partial(progress, what)
