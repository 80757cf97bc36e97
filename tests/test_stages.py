"""Stages of a computation: how long each took, and what a terminal shows."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest

import rodgen
from rodgen.cli._progress import Display
from rodgen.stages import each, listening, stage, step

MOUNT = Path(__file__).parent.parent / "examples" / "machines" / "mount"
FILES = (MOUNT / "machine.toml", MOUNT / "mmt_2021.csv")


# what is shown on a terminal ---------------------------------------------------------------------------


class Watch:
    def __init__(self):
        self.time = 0.0

    def __call__(self):
        return self.time


@pytest.fixture
def shown():
    """A display on a file, with a clock that stands still."""
    return Display(io.StringIO(), Watch())


def test_the_time_that_is_left_is_shown_where_the_steps_are_counted(shown):
    shown.begin("trying effects", 40)
    assert shown.line() == "trying effects 1 of 40"
    shown._clock.time = 1.9
    shown.step(11)
    assert shown.line() == "trying effects 12 of 40"
    shown._clock.time = 2.2  # 0.2 s each, 29 to go
    assert shown.line() == "trying effects 12 of 40, about 6 s left"
    shown._clock.time = 1100
    assert shown.line() == "trying effects 12 of 40, about 48 min left"


def test_bytes_are_a_percentage(shown):
    shown.begin("reading", 2_000_000)
    shown._clock.time = 4
    shown.step(500_000)
    assert shown.line() == "reading, 25%, about 12 s left"
    shown.step(2_000_000)
    assert shown.line() == "reading, 100%, about 0 s left"


def test_a_counted_stage_is_shown_in_place_of_those_within_it(shown):
    shown.begin("error on poses left out", 10)
    shown.begin("fitting", None)
    shown.step(3)
    assert shown.line() == "error on poses left out 1 of 10"
    shown.end()
    shown.end()
    assert shown.line() == ""


def test_the_line_is_written_over_and_taken_away(shown):
    with listening(shown), stage("reading"):
        shown._clock.time = 1
        for done in each("fitting folds", range(3)):
            shown._clock.time += 0.04 * (done + 1)  # too often to be drawn each time
        shown._clock.time += 1
        step(9)
    lines = [line.rstrip() for line in shown._stream.getvalue().split("\r")]
    assert lines == [
        "",
        "reading",
        "fitting folds 1 of 3",
        "fitting folds 3 of 3",
        "reading, step 9, 2 s",
        "",
        "",
    ]
    assert f"\r{'reading, step 9, 2 s':<20}\r{'':<20}\r" in shown._stream.getvalue()


def test_time_passes_where_nothing_happens(monkeypatch):
    monkeypatch.setattr("rodgen.cli._progress.TICK", 0.01)
    watch, stream = Watch(), io.StringIO()
    with Display(stream, watch).ticking() as shown, listening(shown), stage("compiling"):
        watch.time = 7
        for _ in range(1000):
            if "7 s" in stream.getvalue():
                break
            time.sleep(0.01)
    assert stream.getvalue() == "\rcompiling\rcompiling, 7 s\r" + 14 * " " + "\r"


def test_a_stage_that_is_broken_off_may_end_late():
    """Of a loop that Ctrl-C leaves Python closes the generator later than the display."""
    stream = io.StringIO()
    with Display(stream).ticking() as shown, listening(shown):
        items = each("deriving", ["axis", "rotations"])
        next(items)
    items.close()
    assert stream.getvalue() == "\rderiving 1 of 2\r" + 15 * " " + "\r"


# the progress callback of the library ------------------------------------------------------------------


def test_a_fit_tells_its_stages_and_steps():
    told = []
    machine, data = rodgen.Machine.load(FILES[0]), rodgen.Measurements.load(FILES[1])
    machine.fit(data, progress=lambda *what: told.append(what))
    assert told[0] == ("fitting", 0, None)
    assert [done for what, done, _ in told if what == "fitting"][1:3] == [1, 2]


def test_nobody_is_told_when_nobody_listens():
    with stage("fitting"):
        step(1)
    assert list(each("counting", range(3))) == [0, 1, 2]
