"""``rodgen watch``: readings as they come, against a fitted machine, until something is no longer as it was."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import (
    FAILED,
    OK,
    Command,
    argument,
    choice,
    flag,
    notify,
    option,
    refused,
    show,
    show_json,
)
from rodgen.cli._machine import JSON, MACHINE, load_data, remark_on_rows
from rodgen.cli._values import InputFile, StateFile, frequency, whole
from rodgen.errors import InputFileError, counted
from rodgen.files import publish_outputs, write_file, written_at_once

if TYPE_CHECKING:
    from rodgen.calibration.watch import Watch
    from rodgen.calibration.watch.events import Event
    from rodgen.data.measurements import Measurements
    from rodgen.data.tail import Lines, Tail

LEARNED = 200
"""Rows at the beginning that are the reference where none is given."""
SAVED_EVERY = 10.0
"""Seconds between two times that the state is written, at least."""
_GO_ON = ("go-on", "stop")

_WATCH = f"""\
Compare new readings of a machine with what it was, as they come, and report when something has changed: what it looks
like, by how much, and since when. The reference is a fit to the measurements of --reference, or to the first {LEARNED}
rows of DATA. An alarm comes by chance no more often than --false-alarms says, however long the watch is.

DATA is a measurement file that may grow (--follow), or '-', CSV on standard input.

  rodgen watch arm.toml readings.csv --reference calibration.csv --follow --state arm.watch

The exit code is 1 where there was an alarm.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "watch",
        _run,
        _WATCH,
        MACHINE,
        argument("DATA", "the new readings; '-' is CSV on standard input", InputFile),
        option("--reference FILE", "measurements of the machine as it should stay", InputFile),
        option(
            "--learn ROWS",
            f"without --reference, rows of DATA that are the reference (default: {LEARNED})",
            whole(1),
            default=LEARNED,
        ),
        flag("--follow", "wait for more rows at the end of DATA, until Ctrl-C"),
        option(
            "--rate N/TIME",
            "how often readings come, such as 100/h; default: by the column t, or 100/h",
            frequency,
        ),
        option(
            "--false-alarms N/TIME",
            "how often an alarm may come while nothing changes (default: 1/year)",
            frequency,
            default="1/year",
        ),
        choice(
            "--on-alarm",
            _GO_ON,
            "after an alarm: say so and go on (default), or end after the first alarm",
            default="go-on",
        ),
        choice(
            "--on-bad-row",
            _GO_ON,
            "at a row that cannot be read: say so and go on (default), or end with an error",
            default="go-on",
        ),
        option(
            "--state FILE",
            "keep there what was seen, with --reference; a later call goes on from it",
            StateFile,
        ),
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    with _stopping() as stop:
        watching = _Watching(options, stop)
        watching.run()
        watching.save()
        publish_outputs()  # also after a signal
    return FAILED if watching.alarms else OK


class _Stop:
    """Whether a signal asked for the end."""

    signal = 0

    def __call__(self, *_: Any) -> bool:
        return bool(self.signal)


@contextlib.contextmanager
def _stopping() -> Iterator[_Stop]:
    """Note signals in the block, so that no row is half counted; let them do what they do at its end."""
    stop, before = _Stop(), {}

    def note(number: int, _: Any) -> None:
        stop.signal = number

    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if stop.signal:
            signal.raise_signal(stop.signal)


class _Watching:
    """A watch, from files to lines on standard output."""

    def __init__(self, options: argparse.Namespace, stop: _Stop) -> None:
        self.options, self.stop = options, stop
        self.watch: Watch | None = None
        self.alarms = 0
        self._ended = False
        self._tail: Tail | None = None
        self._learned: Measurements | None = None
        self._place: dict[str, Any] | None = None
        self._saved = time.monotonic()

    def run(self) -> None:
        """Read until the end, a signal, or what an option says."""
        from rodgen.data.tail import Tail

        if self.options.reference is not None:
            self._begin(load_data(self.options.reference))
        elif self.options.state:
            raise refused("--state", "given without --reference", "--reference with it")
        if self.watch is not None and self.options.state and os.path.exists(self.options.state):
            self._place = self.watch.restore(self.options.state)
            notify(f"{self.options.state}: goes on after {self.watch.rows} rows")
        if _is_table(self.options.data):
            for option in ("follow", "state"):
                if getattr(self.options, option):
                    found = f"given with {self.options.data}, which is not read as it grows"
                    raise refused(f"--{option}", found, "a plain CSV file with it")
            self._take(load_data(self.options.data))
            self._end(self.options.data)
            return
        self._tail = Tail(
            self.options.data,
            follow=self.options.follow,
            place=self._place,
            stopped=lambda: bool(self.stop.signal) or self._ended,
        )
        with contextlib.closing(self._tail) as tail:
            for lines in tail:
                if lines.notice:
                    notify(f"{tail.file} {lines.notice}")
                for data in self._measured(lines, tail.file) if lines.text else ():
                    self._take(data)
                self._place = tail.place
                if time.monotonic() - self._saved > SAVED_EVERY:
                    with written_at_once():
                        self.save()
        self._end(tail.file)

    def _end(self, file: str) -> None:
        """Say what there is to say at the end of the rows."""
        if self.stop.signal:
            return
        if self.watch is None:
            rows = 0 if self._learned is None else self._learned.rows
            expected = f"{self.options.learn} to learn from, or --reference"
            raise InputFileError(file, "file", f"{rows} rows", expected)
        if not self.options.state and not self._ended:
            self._report_all(self.watch.finish())
        alarms = counted(self.alarms, "alarm") if self.alarms else "no alarm"
        notify(f"{file}: {counted(self.watch.rows, 'row')} watched, {alarms}")

    def _measured(self, lines: Lines, file: str) -> Iterator[Measurements]:
        """Yield the rows of lines that can be read; of others, say why they cannot."""
        from rodgen.data.measurements import Measurements

        try:
            yield Measurements.from_lines(lines.header, lines.text, lines.first, name=file)
        except InputFileError as error:
            yield from self._one_by_one(lines, file, error)

    def _one_by_one(self, lines: Lines, file: str, error: InputFileError) -> Iterator[Measurements]:
        from rodgen.data.measurements import Measurements

        if not error.place.startswith("line") or error.place.partition(",")[0] == "line 1":
            raise error
        for i, line in enumerate(lines.text.splitlines(keepends=True)):
            try:
                yield Measurements.from_lines(lines.header, line, lines.first + i, name=file)
            except InputFileError as fault:
                self._bad(fault)

    def _bad(self, error: InputFileError) -> None:
        """Say that a row is left out, or end."""
        if self.options.on_bad_row == "stop":
            raise error
        if self.options.json:
            show_json({"event": "bad_row", "place": error.place, "found": error.found}, indent=None)
        notify(f"{error}; the row is left out")

    def _take(self, data: Measurements) -> None:
        """Give rows to the watch, or to the reference as long as it is not complete."""
        if self._ended:
            return
        if self.watch is None:
            self._learned = data if self._learned is None else data.after(self._learned)
            if self._learned.rows < self.options.learn:
                return
            further = self._learned.take(slice(self.options.learn, None))
            self._learned = self._learned.take(slice(0, self.options.learn))
            self._begin(self._learned)
            data = further
        assert self.watch is not None
        try:
            events = self.watch.update(data)
        except InputFileError as error:
            place = error.place.partition(",")[0]
            if not place.startswith(data.counted) or place == data.header_place:
                raise
            if data.rows == 1:
                self._bad(error)
                return
            for row in range(data.rows):
                self._take(data.take(slice(row, row + 1)))
            return
        self._report_all(events)

    def _report_all(self, events: Sequence[Event]) -> None:
        for event in events:
            self._report(event)
            if event.is_alarm:
                self.alarms += 1
                if self.options.on_alarm == "stop":
                    self._ended = True
                    return

    def _report(self, event: Event) -> None:
        from rodgen.calibration.watch.events import Changed

        if self.options.json:
            show_json(event.to_dict(), indent=None)
            return
        show(event.text)
        if isinstance(event, Changed) and event.settled:
            rows = "all rows" if event.by < 0 else f"the rows from {event.counted} {event.by} on"
            show(
                f"To see more, write {rows} into a file of their own, and run "
                f"'rodgen diagnose {self.options.machine} FILE'."
            )

    def _begin(self, reference: Measurements) -> None:
        """Begin to watch."""
        from rodgen.calibration.fit import fit
        from rodgen.calibration.watch import Watch
        from rodgen.machines.machine import Machine

        found = fit(Machine.load(self.options.machine), reference, loss="huber")
        self.watch = Watch(found, rate=self.options.rate, false_alarms=self.options.false_alarms)
        remark_on_rows(found.observations)
        notify(self.watch.text)

    def save(self) -> None:
        """Write the state, where it is wanted and there is one."""
        if self.options.state and self.watch is not None:
            write_file(self.options.state, self.watch.state(self._place))
        self._saved = time.monotonic()


def _is_table(file: str) -> bool:
    """Return whether a file is no plain CSV, which is read as it grows: Parquet, or packed."""
    from rodgen.files import read_start

    return file != "-" and read_start(file, "CSV or Parquet", 4).startswith((b"PAR1", b"\x1f\x8b"))
