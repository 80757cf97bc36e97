"""Watch a file of readings, or standard input, as it grows: what is learned, bad rows, and going on later."""

from __future__ import annotations

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Integral
from typing import Any, ClassVar

from rodgen.calibration.fit import fit
from rodgen.calibration.watch.events import Event
from rodgen.calibration.watch.watch import Watch, per_second
from rodgen.data.measurements import Measurements
from rodgen.data.tables.parts import is_many
from rodgen.data.tail import Lines, Tail
from rodgen.errors import InputFileError, UnfitArgumentError, counted
from rodgen.files import read_start, write_file, written_at_once
from rodgen.machines.machine import Machine

__all__ = ["LEARNED", "BadRow", "watch"]

LEARNED = 200
"""Rows at the beginning that are the reference where none is given."""
SAVED_EVERY = 10.0
"""Seconds between two times that the state is written, at least."""


@dataclass(frozen=True)
class BadRow:
    """A row that cannot be read, and is left out: `text` says why."""

    error: InputFileError
    is_alarm: ClassVar[bool] = False

    @property
    def text(self) -> str:
        """It as a sentence."""
        return f"{self.error}; the row is left out"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"event": "bad_row", "place": self.error.place, "found": self.error.found}


def watch(
    machine: Machine | str | os.PathLike[str],
    data: str | os.PathLike[str],
    *,
    reference: str | os.PathLike[str] | Measurements | None = None,
    learn: int = LEARNED,
    follow: bool = False,
    rate: str | float | None = None,
    false_alarms: str | float = "1/year",
    state: str | os.PathLike[str] | None = None,
    until_alarm: bool = False,
    until_bad_row: bool = False,
    remark: Callable[[str], object] = lambda text: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Event | BadRow]:
    """Compare the rows of a file with a fitted machine, as they arrive, and yield what they show.

    Parameters
    ----------
    machine : Machine, or its file
    data : str or path-like
        A measurement file, which may grow; ``"-"`` is CSV on standard input.
    reference : str, path-like or Measurements, optional
        Readings of the machine as it should stay; else the first `learn` rows of `data`.
    follow : bool
        Whether to wait for more rows at the end.
    rate, false_alarms
        As of `Watch`.
    state : str or path-like, optional
        A file that keeps what was seen; a later watch continues there. It needs a `reference`.
    until_alarm, until_bad_row : bool
        Whether to end after the first alarm, and with an error at a row that cannot be read.
    remark : callable, optional
        Is called with sentences about what is watched, and at the end about how many rows were.
    stopped : callable, optional
        Returns whether to end, after a whole row; asked again and again.

    Yields
    ------
    Changed, OutlierSeen or BadRow
        With `text`, `to_dict`, and `is_alarm`.

    Raises
    ------
    UnfitArgumentError
        When an argument cannot be used, or arguments do not go together: at the call.
    InputFileError
        When a file cannot be used, or has too few rows to learn from.
    """
    if not isinstance(learn, Integral) or learn < 1:
        raise UnfitArgumentError("learn", repr(learn), "a whole number of rows, 1 or more")
    if state and reference is None:
        raise UnfitArgumentError("state", "given without a reference", "a reference with it")
    options = {"false_alarms": per_second("false_alarms", false_alarms)}
    if rate is not None:
        options["rate"] = per_second("rate", rate)
    if not isinstance(machine, Machine):
        machine = Machine.load(machine)
    if isinstance(reference, os.PathLike):
        reference = os.fspath(reference)
    watching = _Watching(machine, learn, options, until_alarm, until_bad_row, remark)
    return _watched(watching, os.fspath(data), reference, follow, state, stopped)


def _watched(
    watching: _Watching,
    data: str,
    reference: str | Measurements | None,
    follow: bool,
    state: str | os.PathLike[str] | None,
    stopped: Callable[[], bool],
) -> Iterator[Event | BadRow]:
    """Yield what the rows of a file show; where the caller goes, the state is kept, too."""
    place, remark = None, watching.remark
    if reference is not None:
        watching.begin(_read(reference) if isinstance(reference, str) else reference)
        if state and os.path.exists(state):
            place = watching.known.restore(os.fspath(state))
            remark(f"{state}: goes on after {watching.known.rows} rows")

    def save() -> float:
        if state and watching.watch is not None:
            write_file(os.fspath(state), watching.watch.state(place))
        return time.monotonic()

    name = "standard input" if data == "-" else data
    if _is_table(data):
        for option, argument in (("follow", follow), ("state", state)):
            if argument:
                found = f"given with {data}, which is not read as it grows"
                raise UnfitArgumentError(option, found, "a plain CSV file with it")
        yield from watching.take(_read(data))
    else:
        saved = time.monotonic()
        tail = Tail(data, follow=follow, place=place, stopped=lambda: stopped() or watching.ended)
        with contextlib.closing(tail):
            for lines in tail:
                if lines.notice:
                    remark(f"{name} {lines.notice}")
                events = watching.read(lines, name) if lines.text else iter(())
                try:
                    while (event := next(events, None)) is not None:
                        yield event
                except GeneratorExit:
                    deque(events, 0)  # of these lines all rows count, or none: the place is after them
                    place = tail.place
                    save()
                    raise
                place = tail.place
                if time.monotonic() - saved > SAVED_EVERY:
                    with written_at_once():
                        saved = save()
    if not stopped():
        if watching.watch is None:
            rows = 0 if watching.learned is None else watching.learned.rows
            raise InputFileError(
                name, "file", f"{rows} rows", f"{watching.learn} to learn from, or a reference"
            )
        if not state and not watching.ended:
            yield from watching.shown(watching.watch.finish())
        alarms = counted(watching.alarms, "alarm") if watching.alarms else "no alarm"
        remark(f"{name}: {counted(watching.watch.rows, 'row')} watched, {alarms}")
    save()


class _Watching:
    """A watch, the rows that it learns from before it begins, and what it has shown."""

    def __init__(
        self,
        machine: Machine,
        learn: int,
        options: Mapping[str, Any],
        until_alarm: bool,
        until_bad_row: bool,
        remark: Callable[[str], object],
    ) -> None:
        self.machine, self.learn, self.options, self.remark = machine, learn, options, remark
        self.until_alarm, self.until_bad_row = until_alarm, until_bad_row
        self.watch: Watch | None = None
        self.learned: Measurements | None = None
        self.alarms, self.ended = 0, False

    @property
    def known(self) -> Watch:
        """The watch, which has begun."""
        assert self.watch is not None
        return self.watch

    def begin(self, reference: Measurements) -> None:
        """Begin to watch."""
        reference_fit = fit(self.machine, reference, loss="huber")
        self.watch = Watch(reference_fit, **self.options)
        for sentence in [*reference_fit.observations.on_rows, self.watch.text]:
            self.remark(sentence)

    def read(self, lines: Lines, file: str) -> Iterator[Event | BadRow]:
        """Take lines in, all at once; one by one where one of them cannot be read."""
        try:
            data = Measurements.from_lines(lines.header, lines.text, lines.first, name=file)
        except InputFileError as error:
            if not error.place.startswith("line") or error.place.partition(",")[0] == "line 1":
                raise
        else:
            yield from self.take(data)
            return
        for number, line in enumerate(lines.text.splitlines(keepends=True), lines.first):
            try:
                data = Measurements.from_lines(lines.header, line, number, name=file)
            except InputFileError as error:
                yield self._bad(error)
            else:
                yield from self.take(data)

    def _bad(self, error: InputFileError) -> BadRow:
        if self.until_bad_row:
            raise error
        return BadRow(error)

    def take(self, data: Measurements) -> Iterator[Event | BadRow]:
        """Give rows to the watch, or to the reference as long as it is not complete."""
        if self.ended:
            return
        if self.watch is None:
            self.learned = data if self.learned is None else data.after(self.learned)
            if self.learned.rows < self.learn:
                return
            data = self.learned.take(slice(self.learn, None))
            self.learned = self.learned.take(slice(0, self.learn))
            self.begin(self.learned)
        try:
            events = self.known.update(data)
        except InputFileError as error:
            place = error.place.partition(",")[0]
            if not place.startswith(data.counted) or place == data.header_place:
                raise
            if data.rows == 1:
                yield self._bad(error)
                return
            for row in range(data.rows):
                yield from self.take(data.take(slice(row, row + 1)))
        else:
            yield from self.shown(events)

    def shown(self, events: list[Event]) -> Iterator[Event]:
        """Yield events, up to the first alarm where that is wanted."""
        for event in events:
            self.alarms += event.is_alarm
            self.ended = self.until_alarm and event.is_alarm
            yield event
            if self.ended:
                return


def _read(file: str) -> Any:
    return Measurements.scan(file) if is_many(file) else Measurements.load(file)


def _is_table(file: str) -> bool:
    """Return whether a file is no plain CSV, which is read as it grows: Parquet, or packed."""
    return file != "-" and read_start(file, "CSV or Parquet", 4).startswith((b"PAR1", b"\x1f\x8b"))
