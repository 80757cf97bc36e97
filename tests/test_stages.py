"""Stages of a computation: how long each took, and what a terminal shows."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import pytest

import rodgen
from rodgen.cli._progress import Display
from rodgen.cli._timings import Timings
from rodgen.machines.model import _kernels
from rodgen.stages import each, listening, stage, step

MOUNT = Path(__file__).parent.parent / "examples" / "machines" / "mount"
FILES = (MOUNT / "machine.toml", MOUNT / "mmt_2021.csv")


class Clock:
    """A wall clock and a processor clock that the test sets."""

    def __init__(self):
        self.wall = self.processor = 0.0

    def __call__(self):
        return self.wall, self.processor

    def work(self, seconds, processor=None):
        self.wall += seconds
        self.processor += seconds if processor is None else processor


# timings -----------------------------------------------------------------------------------------------


def test_a_stage_is_timed_without_the_stages_within_it():
    clock = Clock()
    timings = Timings(clock)
    with listening(timings):
        clock.work(1)
        with stage("fitting"):
            clock.work(2)
            with stage("compiling"):
                clock.work(4, processor=8)
            clock.work(16)
        with stage("fitting"):
            clock.work(32)
    clock.work(64)
    found = timings.to_dict()
    spent = {of["stage"]: (of["wall_s"], of["processor_s"]) for of in found["stages"]}
    assert spent == {"fitting": (50, 50), "compiling": (4, 8), "other": (65, 65)}
    assert (found["wall_s"], found["processor_s"]) == (119, 123)
    assert [of["share"] for of in found["stages"]] == [50 / 119, 4 / 119, 65 / 119]
    assert str(timings).splitlines() == [
        "stage       wall s  processor s  share",
        "fitting      50.00        50.00    42%",
        "compiling     4.00         8.00     3%",
        "other        65.00        65.00    55%",
        "total       119.00       123.00   100%",
    ]


def test_a_stage_ends_with_an_error():
    clock = Clock()
    timings = Timings(clock)
    with listening(timings), pytest.raises(ValueError, match="wrong"), stage("fitting"):
        raise ValueError("wrong")
    clock.work(1)
    assert {of["stage"]: of["wall_s"] for of in timings.to_dict()["stages"]} == {"fitting": 0, "other": 1}


@pytest.mark.quick("fit-stages0")
@pytest.mark.parametrize(
    ("command", "stages"),
    [
        ("fit", {"starting", "reading", "fitting", "loading kernels"}),
        ("compare", {"fitting", "comparing"}),
        (
            "diagnose",
            {"estimating the correlation", "testing effects", "further fits", "error on poses left out"},
        ),
    ],
)
def test_the_stages_of_a_command_add_up_to_its_total(command, stages, rodgen_command):
    _kernels.cache_clear()  # a process loads them once
    code, out, err = rodgen_command(command, *FILES, "--json", "--timings")
    timed = json.loads(out, parse_constant=pytest.fail)
    timings = timed.pop("timings")
    assert (code, err) == (0, "")
    assert stages < {of["stage"] for of in timings["stages"]}
    for kind in ("wall_s", "processor_s"):
        assert sum(of[kind] for of in timings["stages"]) == pytest.approx(timings[kind], rel=1e-12)
    assert sum(of["share"] for of in timings["stages"]) == pytest.approx(1, rel=1e-12)
    # Nothing else differs.
    _, out, _ = rodgen_command(command, *FILES, "--json")
    assert json.loads(out) == timed


def test_the_table_of_stages_comes_after_the_answer(rodgen_command):
    _, plain, _ = rodgen_command("fit", *FILES)
    code, timed, err = rodgen_command("fit", *FILES, "--timings")
    assert (code, err) == (0, "")
    assert timed.startswith(f"{plain}\nstage ")
    assert timed.splitlines()[-1].startswith("total")


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


def test_no_time_that_is_left_is_made_up(shown):
    shown.begin("fitting", None)
    shown._clock.time = 1.9
    assert shown.line() == "fitting"
    shown._clock.time = 3.4
    assert shown.line() == "fitting, 3 s"
    shown.step(7)
    assert shown.line() == "fitting, step 7, 3 s"
    shown.end()
    shown.begin("trying effects", 40)  # none is done yet
    shown._clock.time = 8.4
    assert shown.line() == "trying effects 1 of 40, 5 s"


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
