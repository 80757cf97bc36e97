"""``rodgen watch``: readings as they arrive, against a fitted machine, until something is no longer as it was."""

from __future__ import annotations

import argparse
import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import (
    FAILED,
    OK,
    Command,
    argument,
    arguments_as_options,
    choice,
    flag,
    notify,
    option,
    show,
    show_json,
)
from rodgen.cli._machine import JSON, MACHINE
from rodgen.cli._values import InputFile, StateFile, frequency, whole
from rodgen.files import publish_outputs

if TYPE_CHECKING:
    from rodgen.calibration.watch.events import Event
    from rodgen.calibration.watch.file import BadRow

LEARNED = 200
_GO_ON = ("go-on", "stop")

_WATCH = f"""\
Compare new readings with a fitted machine, and report what has changed, by how much, and since when. The reference
is a fit to --reference, or to the first {LEARNED} rows of DATA. DATA is a measurement file that may grow (--follow),
or '-', CSV on standard input. The exit code is 1 where there was an alarm.

  rodgen watch arm.toml readings.csv --reference calibration.csv --follow --state arm.watch
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
            "rows of DATA to learn from, without --reference; default: 200",
            whole(1),
            default=LEARNED,
        ),
        flag("--follow", "wait for more rows at the end of DATA, until Ctrl-C"),
        option(
            "--rate N/TIME", "how often readings come, such as 100/h; default: by the column t", frequency
        ),
        option(
            "--false-alarms N/TIME",
            "how often one may come by chance; default: 1/year",
            frequency,
            default="1/year",
        ),
        choice("--on-alarm", _GO_ON, "after an alarm, end or go on (default)", default="go-on"),
        choice(
            "--on-bad-row",
            _GO_ON,
            "at a row that cannot be read, end with an error or go on (default)",
            default="go-on",
        ),
        option("--state FILE", "keep there what was seen, for a later call; needs --reference", StateFile),
        JSON,
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.calibration.watch.file import watch
    from rodgen.machines.machine import Machine

    alarms = 0
    with _stopping() as stop, arguments_as_options():
        events = watch(
            Machine.load(options.machine),
            options.data,
            reference=options.reference,
            learn=options.learn,
            follow=options.follow,
            rate=options.rate,
            false_alarms=options.false_alarms,
            state=options.state,
            until_alarm=options.on_alarm == "stop",
            until_bad_row=options.on_bad_row == "stop",
            remark=notify,
            stopped=stop,
        )
        for event in events:
            _report(options, event)
            alarms += event.is_alarm
        publish_outputs()  # also after a signal
    return FAILED if alarms else OK


def _report(options: argparse.Namespace, event: Event | BadRow) -> None:
    from rodgen.calibration.watch.events import Changed
    from rodgen.calibration.watch.file import BadRow

    if options.json:
        show_json(event.to_dict(), indent=None)
    elif not isinstance(event, BadRow):
        show(event.text)
    if isinstance(event, BadRow):
        notify(event.text)
    elif isinstance(event, Changed) and event.settled and not options.json:
        rows = "all rows" if event.by < 0 else f"the rows from {event.counted} {event.by} on"
        show(
            f"To see more, write {rows} into a file of their own, and run "
            f"'rodgen diagnose {options.machine} FILE'."
        )


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
