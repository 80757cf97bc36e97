"""The stages of a long computation, for those who show them or measure how long they take.

A computation names its stages, one within another, and counts the steps of one where it knows how many there are. It
does not know who listens; without a listener all of this costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Protocol, TypeAlias, TypeVar

Item = TypeVar("Item")


class Listener(Protocol):
    """Receives the events of the stages of one thread; an inner stage ends before the outer one."""

    def begin(self, what: str, total: int | None) -> None:
        """Note that a stage begins; `total` is the number of its steps, None if unknown."""

    def step(self, done: int) -> None:
        """Note how many steps of the innermost stage are done."""

    def end(self) -> None:
        """Note that the innermost stage ends."""


_listeners: ContextVar[tuple[Listener, ...]] = ContextVar("listeners", default=())


@contextmanager
def listening(*listeners: Listener) -> Iterator[None]:
    """Add listeners to the stages of the block; those that are there already stay."""
    before = _listeners.set((*_listeners.get(), *listeners))
    try:
        yield
    finally:
        _listeners.reset(before)


@contextmanager
def stage(what: str, total: int | None = None) -> Iterator[None]:
    """Name what the block does.

    Parameters
    ----------
    what : str
        Such as ``"fitting"``.
    total : int, optional
        Number of its steps, where it is known.
    """
    heard = _listeners.get()
    for listener in heard:
        listener.begin(what, total)
    try:
        yield
    finally:
        for listener in heard:
            listener.end()


def step(done: int) -> None:
    """Say how many steps of the innermost stage are done."""
    for listener in _listeners.get():
        listener.step(done)


def each(what: str, items: Sequence[Item]) -> Iterator[Item]:
    """Yield the items; what is done with each of them is a step of a stage.

    Examples
    --------
    >>> class Log:
    ...     def begin(self, what, total): print(what, "of", total)
    ...     def step(self, done): print(done)
    ...     def end(self): print("end")
    >>> with listening(Log()):
    ...     squares = [n**2 for n in each("squaring", [3, 4])]
    squaring of 2
    0
    1
    end
    """
    with stage(what, len(items)):
        for done, item in enumerate(items):
            step(done)
            yield item


# How a fit or a diagnosis reports where it is to a function of the caller.


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
