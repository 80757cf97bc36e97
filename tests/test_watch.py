"""A watch of simulated machines that change at a hidden time, from Python and on the command line."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import hidden_effects
import numpy as np
import pytest

import rodgen
from rodgen.calibration.fit import fit
from rodgen.calibration.watch import Watch
from rodgen.cli import main as cli
from rodgen.data.tail import Tail
from rodgen.files import write_file

TARGETS = ("b1", "b2")
REFERENCE, BEFORE = 120, 60


@cache
def bench() -> hidden_effects.Bench:
    return hidden_effects.trunnion(np.random.default_rng(11))


def readings(rows: int, seed: int, **effects: float) -> dict:
    """Give rows of a trunnion, anywhere, with independent noise of 2 um."""
    random, b = np.random.default_rng(seed), bench()
    q = random.uniform([-95, 0], [35, 360], size=(rows, 2)).round(3)
    target = [TARGETS[i] for i in random.integers(0, 2, rows)]
    some = replace(b, q=q, target=target, columns={})
    read = some.measure(dict(effects)) + b.sigma * random.normal(size=(rows, 3))
    columns = {"A [deg]": q[:, 0], "C [deg]": q[:, 1], "target": target}
    return columns | dict(zip(("x [mm]", "y [mm]", "z [mm]"), read.T, strict=True))


def joined(*frames: dict) -> dict:
    return {name: np.concatenate([frame[name] for frame in frames]) for name in frames[0]}


def csv_lines(frame: dict) -> list[str]:
    rows = zip(*(frame[name] for name in frame), strict=True)
    return [",".join(frame) + "\n", *(",".join(map(str, row)) + "\n" for row in rows)]


@cache
def reference():
    machine = rodgen.Machine.load(io_machine())
    return fit(machine, rodgen.Measurements.from_frame(readings(REFERENCE, 1)))


@cache
def io_machine() -> Path:
    import tempfile

    path = Path(tempfile.mkdtemp()) / "machine.toml"
    path.write_text(bench().text.replace("{noise}", ""))
    return path


def sigmas(**effects: float) -> float:
    """Give what effects do to readings, rms in units of the noise."""
    q = readings(200, 5)
    some = replace(
        bench(), q=np.column_stack([q["A [deg]"], q["C [deg]"]]), target=list(q["target"]), columns={}
    )
    return float(np.std(some.measure(dict(effects)) - some.measure({})) / bench().sigma)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("title", "key", "size"),
    [
        ("zero_offset at C", "C.zero_offset.a", 1.0),
        pytest.param("encoder_eccentricity at C", "C.encoder_eccentricity.a", 1.5, marks=pytest.mark.slow),
        pytest.param("target.b1", "target.b1.z", 2.0, marks=pytest.mark.slow),
        ("axial_error_motion at C", "C.axial_error_motion.c1", 4.0),
    ],
)
def test_a_hidden_change_raises_an_alarm_and_gets_its_name_size_and_time(title, key, size) -> None:
    value = size / sigmas(**{key: 0.01}) * 0.01  # mm or degrees
    moved = {key: bench().wrong.get(key, 0.0) + value}
    watch = Watch(reference(), rate="100/h")
    assert watch.update(readings(BEFORE, 2)) == []
    alarm, named, *more = watch.update(readings(100, 3, **moved))
    assert not more
    assert alarm.is_alarm
    assert not named.is_alarm
    assert watch.alarms == 1
    assert alarm.at - BEFORE < 40
    assert named.after < BEFORE + 1 <= named.by + 3
    assert named.by - named.after < 25
    (found,) = (one for one in named.likely if one.title == title)
    assert found.probability > 0.3
    (change,) = (one for one in found.changes if one.key == key.rpartition(".")[2])
    assert change.value == pytest.approx(value * (3600 if change.unit == "arcsec" else 1), abs=4 * change.std)
    assert title in alarm.text + named.text


@pytest.mark.thorough
def test_an_effect_that_the_first_readings_show_as_well_is_listed_with_the_commoner_one() -> None:
    """Over a few readings of a quarter of a turn an eccentricity is nearly an offset."""
    value = 2.0 / sigmas(**{"C.encoder_eccentricity.a": 0.01}) * 0.01
    changed = readings(600, 4, **{"C.encoder_eccentricity.a": value})
    sector = (changed["C [deg]"] < 40) | (changed["C [deg]"] > 320)
    watch = Watch(reference(), rate="100/h")
    watch.update(readings(BEFORE, 2))
    alarm = watch.update({name: np.asarray(column)[sector][:30] for name, column in changed.items()})[0]
    found = {one.title: one.probability for one in alarm.likely}
    assert list(found) == ["zero_offset at C", "encoder_eccentricity at C"]
    assert found["encoder_eccentricity at C"] > 0.05
    assert "do not tell it apart from encoder_eccentricity at C" in alarm.text


@pytest.mark.thorough
def test_what_changed_together_is_named_together_and_how_things_are_then() -> None:
    moved = {
        "C.zero_offset.a": 0.05,
        "A.zero_offset.a": -0.03,
        "target.b1.z": bench().wrong.get("target.b1.z", 0.0) + 0.1,
    }
    watch = Watch(reference(), rate="100/h")
    watch.update(readings(20, 2))
    alarm, named, *more = watch.update(readings(150, 9, **moved))
    assert alarm.is_alarm
    assert not more
    assert {"zero_offset at C", "zero_offset at A", "target.b1"} == {
        *named.likely[0].title.replace(" and ", ", ").split(", ")
    }
    sizes = {one.key: one for one in named.likely[0].changes}
    assert named.by - named.after < 4
    assert sizes["zero_offset at A a"].value == pytest.approx(
        -0.03 * 3600, abs=4 * sizes["zero_offset at A a"].std
    )


@pytest.mark.thorough
def test_readings_that_scatter_more_are_said_to() -> None:
    watch, rows = Watch(reference(), rate="100/h"), readings(150, 8)
    random = np.random.default_rng(3)
    for name in ("x [mm]", "y [mm]", "z [mm]"):
        rows[name] = rows[name] + bench().sigma * np.sqrt(8) * random.normal(size=150)
    alarm, named, *more = watch.update(joined(readings(20, 2), rows))
    assert not more
    assert alarm.likely[0].title == named.likely[0].title == "noise"
    assert named.noise == pytest.approx(3, rel=0.3)
    assert "readings are" in named.text or "readings scatter" in named.text


@pytest.mark.slow
def test_a_clock_that_jumps_or_stands_still_neither_raises_an_alarm_nor_prevents_one() -> None:
    seconds = 36.0 * np.arange(BEFORE)
    seconds[30:] += 1.7e9  # set after the controller was switched on
    watch = Watch(reference())
    assert watch.update(readings(BEFORE, 2) | {"t [s]": seconds}) == []
    still = watch.update(readings(80, 3, **{"C.zero_offset.a": 0.004}) | {"t [s]": np.full(80, 5.0)})
    assert still[0].is_alarm
    assert still[0].at - BEFORE < 20
    assert still[0].after >= BEFORE - 2


@pytest.mark.slow
def test_rows_that_a_rule_or_a_run_sets_aside_are_not_watched() -> None:
    wrong = readings(400, 3, **{"C.zero_offset.a": 0.004}) | {"run": np.repeat(["bumped", "a"], (40, 360))}
    new = rodgen.Measurements.from_frame(wrong, name="new.csv")
    plain = rodgen.Measurements.from_frame(readings(REFERENCE, 1))
    machine = rodgen.Machine.load(io_machine()).setting_aside(plain, where="C > 300 deg", why="cables")
    watch = Watch(machine.setting_aside(new, run="bumped").fit(plain))
    assert watch.text.endswith("are left out: C > 300 deg (cables) and run bumped.")
    assert watch.update(new.take(slice(0, 40))) == []
    assert watch.update(new.take(np.flatnonzero(wrong["C [deg]"] > 300))) == []
    alarm = watch.update(new.take(slice(40, None)))[0]
    assert alarm.is_alarm
    assert alarm.after in {-1, 40, 41}


@pytest.mark.thorough
def test_an_alarm_says_that_readings_are_where_the_reference_has_none() -> None:
    rows, new = readings(300, 1), readings(300, 2, **{"C.zero_offset.a": 0.05})
    part, other = rows["C [deg]"] < 120, (new["C [deg]"] > 150) & (new["C [deg]"] < 270)
    machine = rodgen.Machine.load(io_machine())
    watch = Watch(machine.fit({name: np.asarray(x)[part] for name, x in rows.items()}))
    alarm = watch.update({name: np.asarray(x)[other] for name, x in new.items()})[0]
    assert alarm.to_dict()["outside"] is True
    assert "Most of these readings are beyond the coordinates" in alarm.text


@pytest.mark.thorough
def test_rows_of_a_change_are_no_outliers_where_their_numbers_begin_anew() -> None:
    watch = Watch(reference())
    for rows, offset in ((BEFORE, 0.0), (40, 0.01)):  # two tables: rows are numbered from 0 in each
        table = rodgen.Measurements.from_frame(readings(rows, rows, **{"C.zero_offset.a": offset}))
        events = watch.update(table)
    assert [event.to_dict()["event"] for event in events] == ["alarm", "named"]
    assert not events[0].outside


@pytest.mark.slow
def test_what_was_always_there_is_no_change() -> None:
    """Effects that the model lacks are in the reference's readings, too."""
    effects = {"C.encoder_eccentricity.a": 0.006, "A.tilt_error_motion.u_c1": 0.003}
    machine = rodgen.Machine.load(io_machine())
    found = fit(machine, rodgen.Measurements.from_frame(readings(REFERENCE, 1, **effects)))
    assert found.rms > 1.5 * bench().sigma
    watch = Watch(found, rate="100/h")
    assert watch.update(readings(300, 2, **effects)) == []


@pytest.mark.thorough
def test_one_bad_reading_is_an_outlier_and_an_instrument_that_is_stuck_an_alarm() -> None:
    rows = readings(120, 4)
    rows["y [mm]"][30] += 0.5
    rows["x [mm]"][80:] = rows["x [mm]"][80]
    events = Watch(reference()).update(rows)
    outlier, stuck = events[:2]
    assert outlier.to_dict() == {"event": "outlier", "row": 30, "distance": outlier.distance}
    assert outlier.distance > 50
    assert stuck.is_alarm
    assert 80 <= stuck.at < 90
    assert "in no way that one effect explains" in stuck.text


def wandering(rows: int, seed: int) -> dict:
    """Give readings with a set-up that wanders by twice the noise within ten poses."""
    found, random = readings(rows, seed), np.random.default_rng(seed + 100)
    keeps, walk = np.exp(-1 / 10), [random.normal(size=3)]
    for _ in range(rows - 1):
        walk.append(keeps * walk[-1] + np.sqrt(1 - keeps**2) * random.normal(size=3))
    for name, x in zip(("x [mm]", "y [mm]", "z [mm]"), np.transpose(walk), strict=True):
        found[name] = found[name] + 0.004 * x
    return found


@pytest.mark.slow
def test_a_set_up_that_wanders_as_it_did_is_no_change() -> None:
    machine = rodgen.Machine.load(io_machine())
    watch = Watch(fit(machine, rodgen.Measurements.from_frame(wandering(200, 1))), rate="100/h")
    assert "The set-up wanders by" in watch.text
    rows = wandering(100, 2)
    parts = [{name: column[i : i + 25] for name, column in rows.items()} for i in range(0, 100, 25)]
    assert [event for part in parts for event in watch.update(part)] == []
    careless = Watch(watch.fit, rate="100/h")
    careless._whitener = None
    assert careless.update(rows)[0].is_alarm


def test_directions_of_approach_follow_from_the_rows_before() -> None:
    rows = readings(40, 6)
    watch = Watch(reference())
    watch.update({name: column[:30] for name, column in rows.items()})
    columns = watch._watched
    whole = columns.bound(rodgen.Measurements.from_frame(rows))
    after = {name: column[30:] for name, column in rows.items()}
    part = columns.bound(rodgen.Measurements.from_frame(after).after(watch._context))
    assert np.array_equal(part.s[-10:], whole.s[-10:])


def test_a_reference_that_leaves_no_freedom_is_refused(refuses) -> None:
    few = fit(rodgen.Machine.load(io_machine()), rodgen.Measurements.from_frame(readings(9, 1)))
    refuses(Watch, few)
    refuses(Watch, fit(rodgen.Machine.load(io_machine()), rodgen.Measurements.from_frame(readings(1, 1))))
    refuses(Watch, reference(), rate="often")


# the command line ------------------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    (tmp_path / "m.toml").write_text(io_machine().read_text())
    (tmp_path / "ref.csv").write_text("".join(csv_lines(readings(REFERENCE, 1))))
    return tmp_path


def changed() -> list[str]:
    return csv_lines(joined(readings(BEFORE, 2), readings(60, 3, **{"C.zero_offset.a": 0.002})))


def run(folder: Path, *more: str, data: str = "new.csv") -> int:
    ref = ["--reference", str(folder / "ref.csv")] if "--learn" not in more else []
    return cli.main(["watch", str(folder / "m.toml"), str(folder / data), *ref, *more])


@pytest.mark.parametrize(
    "wrong",
    [
        {"learn": 0},
        {"learn": 2.5},
        {"rate": 0},
        {"rate": "often"},
        {"false_alarms": -1.0},
        {"state": "s.watch"},
    ],
    ids=str,
)
def test_a_wrong_argument_is_refused_at_the_call(refuses, wrong) -> None:
    refuses(rodgen.watch, rodgen.Machine.load(io_machine()), "new.csv", **wrong)


@pytest.mark.thorough
def test_a_loop_that_is_left_keeps_the_state(files) -> None:
    (files / "new.csv").write_text("".join(changed()))
    state = files / "kept.watch"
    watching = {"reference": files / "ref.csv", "state": state}
    for event in rodgen.watch(files / "m.toml", files / "new.csv", **watching):
        assert event.is_alarm
        break
    said: list[str] = []
    assert not [*rodgen.watch(files / "m.toml", files / "new.csv", remark=said.append, **watching)]
    assert f"goes on after {BEFORE + 60} rows" in said[-2]  # each row counts once


@pytest.mark.thorough
def test_the_command_reports_lines_and_its_exit_code_is_that_of_an_alarm(files, capsys) -> None:
    (files / "new.csv").write_text("".join(csv_lines(readings(BEFORE, 2))))
    assert run(files) == 0
    assert capsys.readouterr().out == ""
    with gzip.open(files / "new.csv.gz", "wt") as packed:
        packed.writelines(csv_lines(readings(40, 3, **{"C.zero_offset.a": 0.004})))
    assert run(files, data="new.csv.gz") == 1
    assert "write all rows into a file of their own" in capsys.readouterr().out
    for option in (["--follow"], ["--state", str(files / "kept.watch")]):
        assert run(files, *option, data="new.csv.gz") == 2
        assert f"{option[0]}: given with" in capsys.readouterr().err
    (files / "new.csv").write_text("".join(changed()))
    assert run(files, "--json") == 1
    alarm, named = map(json.loads, capsys.readouterr().out.splitlines())
    assert (alarm["event"], named["event"]) == ("alarm", "named")
    text = Path(__file__).parents[1].joinpath("docs/guides/watch.md").read_text()
    assert all(f"`{key}`" in text for key in (*alarm, *alarm["likely"][0]))
    assert named["after"] <= BEFORE + 1 <= named["by"] + 1  # the first changed line is 62
    assert "zero_offset at C" in [one["title"] for one in named["likely"]]
    assert run(files, "--on-alarm", "stop") == 1
    out = capsys.readouterr().out
    assert out.count("alarm") == 1
    assert "zero_offset at C" in out


def test_a_bad_row_is_named_and_left_out_or_ends_the_watch(files, capsys) -> None:
    lines = csv_lines(readings(30, 2))
    lines[10] = lines[10].replace(",b", ",nobody", 1)
    lines[20] = "1,2,b1,oops,0,0\n"
    (files / "new.csv").write_text("".join(lines))
    assert run(files) == 0
    err = capsys.readouterr().err
    assert "new.csv: line 11, column 'target'" in err
    assert "new.csv: line 21, column 'x [mm]': 'oops'" in err
    assert err.count("the row is left out") == 2
    assert run(files, "--on-bad-row", "stop") == 2
    assert "left out" not in capsys.readouterr().err
    (files / "new.csv").write_text(lines[0].replace("x [mm]", "x [kg]") + lines[1])
    assert run(files) == 2
    assert capsys.readouterr().err.splitlines()[-1].count("line 1, column 'x [kg]'") == 1


@pytest.mark.thorough
def test_a_state_goes_on_and_counts_no_row_twice(files, capsys) -> None:
    lines, state = changed(), str(files / "kept.watch")
    (files / "new.csv").write_text("".join(lines))
    assert run(files, "--json") == 1
    whole = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    found = []
    for end in (40, 64, len(lines)):
        (files / "new.csv").write_text("".join(lines[:end]))
        run(files, "--json", "--state", state)
        found += [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["event"] for one in found] == [one["event"] for one in whole]
    assert found[0]["line"] == whole[0]["line"]
    # another file of the same name is read from its beginning
    (files / "new.csv").write_text("".join(csv_lines(readings(20, 9, **{"C.zero_offset.a": 0.002}))))
    assert run(files, "--state", state) == 0
    assert "is another file than before" in capsys.readouterr().err
    # a state of another rate is refused, and what is none
    assert run(files, "--state", state, "--rate", "1/min") == 2
    assert "kept.watch: file: the state of a watch with another" in capsys.readouterr().err
    write_file(state, b"something")
    assert run(files, "--state", state) == 2


@pytest.mark.slow
def test_the_first_rows_are_the_reference_where_none_is_given(files, capsys) -> None:
    lines = csv_lines(
        joined(readings(REFERENCE, 1), readings(BEFORE, 2), readings(60, 3, **{"C.zero_offset.a": 0.002}))
    )
    (files / "new.csv").write_text("".join(lines))
    assert run(files, "--learn", "120", "--json") == 1
    alarm = json.loads(capsys.readouterr().out.splitlines()[0])
    assert alarm["after"] <= REFERENCE + BEFORE + 1 <= alarm["by"] + 1
    assert run(files, "--learn", "120", "--state", str(files / "kept.watch")) == 2
    assert "--state: given without a reference" in capsys.readouterr().err
    assert run(files, "--learn", "1000") == 2
    assert "240 rows; expected 1000 to learn from, or a reference" in capsys.readouterr().err


@pytest.mark.thorough
def test_standard_input_is_watched(files, capsys, monkeypatch) -> None:
    read, write = os.pipe()
    os.write(write, "".join(changed()).encode())
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(stream))
        ref = str(files / "ref.csv")
        assert cli.main(["watch", str(files / "m.toml"), "-", "--reference", ref]) == 1
    assert "zero_offset at C" in capsys.readouterr().out


def test_a_growing_file_is_read_line_by_line(tmp_path) -> None:
    path = tmp_path / "grows.csv"
    path.write_text("a,b\n1,2\n3,")
    with contextlib.closing(Tail(str(path), follow=True, place=None, stopped=lambda: False)) as whole:
        _grow(path, iter(whole))


def _grow(path, tail) -> None:
    assert next(tail).text == b"1,2\n"
    assert next(tail).text == b""  # half a line waits
    with path.open("a") as stream:
        stream.write("4\n5,6\n")
    lines = next(tail)
    assert (lines.header, lines.text, lines.first) == (b"a,b", b"3,4\n5,6\n", 3)
    path.write_text("a,b\n7,8\n")
    found = next(line for line in tail if line.text)
    assert (found.text, found.first, found.notice) == (
        b"7,8\n",
        2,
        "became shorter, and is read from its beginning",
    )
    path.rename(path.with_name("old.csv"))
    path.write_text("a,b\n9,9\n")
    found = next(line for line in tail if line.text)
    assert (found.text, found.notice) == (
        b"9,9\n",
        "was replaced by another file, which is read from its beginning",
    )


def _tail(path, place=None) -> Tail:
    return Tail(str(path), follow=False, place=place, stopped=lambda: False)


@pytest.mark.parametrize("change", ["header", "first row", "shorter", "none"])
def test_a_file_is_known_again_by_all_that_was_read(change, tmp_path) -> None:
    """A file is longer than what is read at once; what changes keeps its length."""
    path = tmp_path / "grows.csv"
    rows = [f"{k:05},{k}\n" for k in range(10_000)]
    path.write_text("".join(["\na [mm],b\n", *rows]))
    with contextlib.closing(_tail(path)) as tail:
        assert sum(lines.text.count(b"\n") for lines in tail) == len(rows)
        place = json.loads(json.dumps(tail.place))
    text = path.read_text() + "7,7\n"
    changes = {"header": ("[mm]", "[um]"), "first row": ("00000,0", "00000,1"), "shorter": (rows[-1], "")}
    path.write_text(text.replace(*changes.get(change, ("", ""))))
    with contextlib.closing(_tail(path, place)) as tail:
        found = next(iter(tail))
    if change == "none":
        assert (found.header, found.text, found.first) == (b"a [mm],b", b"7,7\n", len(rows) + 3)
    else:
        assert found.notice == "is another file than before, and is read from its beginning"
        assert found.first == 3


def test_a_file_that_ends_before_its_header_is_read_from_there(tmp_path) -> None:
    path = tmp_path / "grows.csv"
    path.write_text("\n\n")
    with contextlib.closing(_tail(path)) as tail:
        assert not [lines for lines in tail if lines.text]
        place = tail.place
    path.write_text("\n\na,b\n1,2\n")
    with contextlib.closing(_tail(path, place)) as tail:
        (found,) = tail
    assert (found.header, found.text, found.first) == (b"a,b", b"1,2\n", 4)


def test_an_unfinished_line_that_is_taken_back_leaves_no_trace(tmp_path) -> None:
    path = tmp_path / "grows.csv"
    path.write_text("a,b\n1,2\n3,45")
    with contextlib.closing(Tail(str(path), follow=True, place=None, stopped=lambda: False)) as whole:
        tail = iter(whole)
        assert next(tail).text == b"1,2\n"
        assert next(tail).text == b""
        path.write_text("a,b\n1,2\n")  # written again, without the half line
        assert next(tail).text == b""
        with path.open("a") as stream:
            stream.write("6,7\n")
        found = next(line for line in tail if line.text)
        assert (found.text, found.first, found.notice) == (b"6,7\n", 3, "")


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_watch_with_its_state_whole(files, number, code) -> None:
    lines, data = changed(), files / "new.csv"
    data.write_text("".join(lines[:30]))
    command = [
        sys.executable,
        "-m",
        "rodgen.cli.main",
        "watch",
        "m.toml",
        "new.csv",
        "--reference",
        "ref.csv",
    ]
    watching = subprocess.Popen(
        [*command, "--follow", "--state", "kept.watch"], cwd=files, stdout=subprocess.PIPE, text=True
    )
    assert watching.stdout is not None
    try:
        time.sleep(2)
        with data.open("a") as stream:
            stream.write("".join(lines[30:]))
        assert "alarm" in watching.stdout.readline()
        watching.send_signal(number)
        assert watching.wait(timeout=30) == code
    finally:
        watching.kill()
        watching.stdout.close()
    assert (files / "kept.watch").exists()


def test_a_state_of_another_version_is_refused(refuses, tmp_path) -> None:
    # its position was hashed over other bytes: the rows before it would count twice
    about = np.frombuffer(json.dumps({"format": 1}).encode(), np.uint8)
    with open(tmp_path / "old.watch", "wb") as file:
        np.savez(file, about=about)
    refuses(Watch(reference()).restore, str(tmp_path / "old.watch"))
