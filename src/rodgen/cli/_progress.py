"""Show on a terminal which stage a command is at, and how long it will take."""

from __future__ import annotations

import contextlib
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import TextIO

DRAWN_EVERY, TICK = 0.1, 0.5
"""Seconds between two pictures at least where something happens, and where nothing does."""
PATIENCE = 2.0
"""Seconds of a stage before its time is shown: a short one is over before it is read."""
COUNTED = 1000
"""More steps than this are shown as a percentage."""


class _Stage:  # no dataclass: every command imports this module, and `dataclasses` takes longer than it all
    def __init__(self, what: str, total: int | None, began: float) -> None:
        self.what, self.total, self.began, self.done = what, total, began, 0


class Display:
    """A listener that keeps one line of a terminal: the stage, its step, and the time that is left or has passed.

    Of stages within each other it shows the innermost whose number of steps is known, else the innermost.

    Parameters
    ----------
    stream : file
        The terminal.
    clock : callable, optional
        Returns seconds.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream, clock
        self._stages: list[_Stage] = []
        self._drawn, self._length = -DRAWN_EVERY, 0
        self._lock = threading.Lock()

    def begin(self, what: str, total: int | None) -> None:
        """Show a stage that begins."""
        self._stages.append(_Stage(what, total, self._clock()))
        self.draw()

    def step(self, done: int) -> None:
        """Show a step."""
        if self._stages:
            self._stages[-1].done = done
            self.draw()

    def end(self) -> None:
        """Show the stage that goes on, or nothing."""
        self._stages.pop()
        if not self._stages:
            self.clear()

    def line(self) -> str:
        """Return what is shown now."""
        stages = self._stages[:]
        if not stages:
            return ""
        stage = next((each for each in reversed(stages) if each.total), stages[-1])
        passed, done, total = self._clock() - stage.began, stage.done, stage.total
        text = stage.what
        if total:
            text += f", {done / total:.0%}" if total > COUNTED else f" {min(done + 1, total)} of {total}"
        elif done:
            text += f", step {done}"
        if passed < PATIENCE:
            return text
        if total and done:
            return f"{text}, about {_duration(passed * (total - done) / done)} left"
        return f"{text}, {_duration(passed)}"

    def draw(self) -> None:
        """Write the line anew, unless that was done just now."""
        now = self._clock()
        with self._lock:
            if now - self._drawn >= DRAWN_EVERY:
                self._write(self.line()[: shutil.get_terminal_size().columns - 1])
                self._drawn = now

    def clear(self) -> None:
        """Take the line away; what comes next brings it back."""
        with self._lock:
            self._write("")
            self._drawn = -DRAWN_EVERY

    def _write(self, text: str) -> None:
        if text or self._length:
            self._stream.write("\r" + text.ljust(self._length) + "\r" * (not text))
            self._stream.flush()
        self._length = len(text)

    @contextlib.contextmanager
    def ticking(self) -> Iterator[Display]:
        """Draw again and again while the block runs, so that time passes where nothing happens; then clear."""
        ended = threading.Event()

        def tick() -> None:
            while not ended.wait(TICK):
                self.draw()

        thread = threading.Thread(target=tick, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()
            self.clear()  # a stage that was broken off may end later still


def _duration(seconds: float) -> str:
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 99.5 * 60 else f"{seconds / 3600:.0f} h"


@contextlib.contextmanager
def display() -> Iterator[Display | None]:
    """Return a display on standard error for the block, or None if standard error is not a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    with Display(sys.stderr).ticking() as progress:
        yield progress
