"""`rodgen diagnose` and `rodgen add --from-diagnosis` as a user types them: what they print, write and refuse."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from commands import run, run_process

import rodgen
from rodgen.calibration.diagnose.diagnosis import VERDICTS
from rodgen.calibration.diagnose.summary import headline
from rodgen.calibration.ladder import ladder
from rodgen.calibration.solve.least_squares import minimise
from rodgen.calibration.words import three_digits
from rodgen.cli import main as cli
from rodgen.cli._from_diagnosis import _NONE
from rodgen.machines.effects.catalogue import CATALOGUE

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
FILES = {
    "mount.toml": EXAMPLES / "mount" / "machine.toml",
    "stars.csv": EXAMPLES / "mount" / "mmt_2021.csv",
    "gantry.toml": EXAMPLES / "gantry_rotary" / "machine.toml",
    "gantry.csv": EXAMPLES / "gantry_rotary" / "data.csv",
}
DATA = {"mount": "stars.csv", "gantry": "gantry.csv"}
HEADER = "AZ [deg],EL [deg],ux,uy,uz"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work where a user does."""
    for name, source in FILES.items():
        shutil.copy(source, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """The diagnoses of both machines: the text of each JSON file."""
    place = tmp_path_factory.mktemp("diagnosed")
    for name, source in FILES.items():
        shutil.copy(source, place / name)
    found = {}
    for name, data in DATA.items():
        done = run("diagnose", f"{name}.toml", data, "--json", folder=place)
        assert (done.returncode, done.stderr) == (0, "")
        found[name] = done.stdout
    assert sorted(path.name for path in place.iterdir()) == sorted(FILES)  # nothing else was written
    return found


@pytest.fixture
def with_diagnoses(folder, diagnosed):
    for name, text in diagnosed.items():
        (folder / f"{name}.json").write_text(text)
    return folder


def parsed(text):
    return json.loads(text, parse_constant=pytest.fail)


# diagnose ------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_json_is_all_that_is_printed(diagnosed):
    mount, gantry = (parsed(diagnosed[name]) for name in DATA)
    counted = ["rows", "copies", "set_aside", "outliers"]
    assert list(mount) == ["verdict", *counted, "rms", "steps", "unexplained", "dependence"]
    assert (mount["verdict"], mount["rows"], mount["rms"]["unit"]) == ("effects_missing", 80, "arcsec")
    assert mount["rms"]["before"] == pytest.approx(2.711, abs=5e-4)
    assert mount["rms"]["after"] <= 0.66
    assert mount["steps"][0]["effect"] == "tube_flexure"
    assert (gantry["verdict"], gantry["rms"]["unit"]) == ("effects_missing", "mm")
    assert [(s["effect"], s["joint"]) for s in gantry["steps"]] == [("encoder_eccentricity", "C")]


@pytest.mark.thorough
def test_text_names_the_effects_and_the_falling_error(with_diagnoses, rodgen_command, diagnosed):
    code, out, err = rodgen_command("diagnose", "mount.toml", "stars.csv", "-o", "better.toml")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[-1] == "better.toml: mount.toml with tube_flexure and refraction"
    assert rodgen_command("add", "mount.toml", "--from-diagnosis", "mount.json", "-o", "added.toml")[0] == 0
    assert Path("better.toml").read_text() == Path("added.toml").read_text()
    assert lines[0] == "Alt-azimuth mount of a telescope, stars.csv: 80 rows"
    assert max(map(len, lines)) <= 130
    found = parsed(diagnosed["mount"])
    for step in found["steps"]:
        title = f"{step['effect']} at {step['joint']}" if step["joint"] else step["effect"]
        assert f"\n{title}\n" in out
        assert any(line.startswith(f"+ {title} ") for line in lines)
        if step["indistinguishable_from"]:
            assert "These data cannot distinguish it from:" in out
    for word in ("as it is", "2.71", "Meaning", "Usual size", "Remedy"):
        assert word in out


def test_further_measurements_are_reported_separately(folder, rodgen_command):
    header, *lines = (folder / "gantry.csv").read_text().splitlines()
    names = [line.split(",")[4] for line in lines]
    parts = {"seen.csv": [], "unseen.csv": []}
    for i, line in enumerate(lines):  # whole poses, of as many readings as there are balls
        parts["seen.csv" if i // len(set(names)) % 2 else "unseen.csv"].append(line)
    for name, part in parts.items():
        (folder / name).write_text("\n".join([header, *part]) + "\n")
    command = ("diagnose", "gantry.toml", "seen.csv", "--test", "unseen.csv")
    code, out, err = rodgen_command(*command, "--json")
    rms = parsed(out)["rms"]
    assert (code, err) == (0, "")
    assert rms["before_test"] == pytest.approx(rms["before_held_out"], rel=0.15)
    assert rms["after_test"] == pytest.approx(0.002, rel=0.15)  # the noise that is stated
    code, out, _ = rodgen_command(*command)
    assert code == 0
    assert "rms in um per reading" in out
    before, after = (three_digits(1000 * rms[when]) for when in ("before_test", "after_test"))
    assert f"On the further measurements: {before} before, {after} after." in out


def test_further_measurements_without_a_column_of_what_was_found_cost_only_that_error(folder, rodgen_command):
    shutil.copy(EXAMPLES / "rotary_table" / "machine.toml", "table.toml")
    lines = [f"{37 * i % 360},ball_{1 + i % 6},{20 + i % 9}" for i in range(90)]
    Path("design.csv").write_text("\n".join(["C [deg],target,T_C [degC]", *lines]) + "\n")
    effect = ("--effect", "thermal_offset@C:k=3arcsec/K")
    assert rodgen_command("simulate", "table.toml", "design.csv", *effect, "-o", "made.csv")[0] == 0
    made = [line.split(",") for line in Path("made.csv").read_text().splitlines()]
    Path("bare.csv").write_text("".join(",".join(row[:2] + row[3:]) + "\n" for row in made))
    command = ("diagnose", "table.toml", "made.csv", "--test", "bare.csv")
    code, out, err = rodgen_command(*command, "--json")
    found = parsed(out)
    assert (code, err) == (0, "")
    assert [s["effect"] for s in found["steps"]] == ["thermal_offset"]
    assert found["rms"]["before_test"] == pytest.approx(found["rms"]["before"], rel=0.05)  # the same readings
    assert found["rms"]["after_test"] is None
    assert "bare.csv: line 1: no column 'T_C [degC]'" in " ".join(rodgen_command(*command)[1].split())
    # Effects of the machine file need their columns, which is checked at once.
    assert rodgen_command("add", "table.toml", "thermal_offset", "--joint", "C", "-o", "new.toml")[0] == 0
    code, out, err = rodgen_command("diagnose", "new.toml", "made.csv", "--test", "bare.csv")
    assert (code, out) == (2, "")
    assert err.startswith("bare.csv: line 1: no column 'T_C [degC]'; expected one, because")


@pytest.mark.thorough
def test_a_machine_with_nothing_to_estimate_is_diagnosed(folder, rodgen_command):
    """What `fit -o` writes: all numbers are held, and the effect is still missing."""
    assert rodgen_command("fit", "gantry.toml", "gantry.csv", "-o", "fixed.toml")[0] == 0
    code, out, err = rodgen_command("diagnose", "fixed.toml", "gantry.csv", "--json")
    found = parsed(out)
    assert (code, err) == (0, "")
    first = found["steps"][0]
    named = [(each["effect"], each["joint"]) for each in (first, *first["indistinguishable_from"])]
    assert ("encoder_eccentricity", "C") in named  # a weight about C does the same


@pytest.mark.thorough
def test_standard_input_is_read(with_diagnoses):
    with open("gantry.csv", encoding="utf-8") as stream:
        done = run_process("diagnose", "gantry.toml", "-", "--json", folder=with_diagnoses, stdin=stream)
    assert (done.returncode, done.stderr) == (0, "")
    assert parsed(done.stdout) == parsed((with_diagnoses / "gantry.json").read_text())


def test_cannot_tell_is_an_answer(folder, rodgen_command):
    lines = (folder / "stars.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join(lines[:5]) + "\n")
    code, out, err = rodgen_command("diagnose", "mount.toml", "few.csv", "--json")
    found = parsed(out)
    assert (code, err) == (0, "")
    assert (found["verdict"], found["steps"], found["unexplained"]) == ("cannot_tell", [], [])
    assert found["reason"]
    code, out, _ = rodgen_command("diagnose", "mount.toml", "few.csv")
    assert code == 0
    assert f"These data cannot tell: {found['reason'][:30]}" in out


@pytest.mark.thorough
def test_a_fit_that_does_not_converge_ends_with_3(folder, rodgen_command, monkeypatch):
    monkeypatch.setattr(
        "rodgen.calibration.solve.least_squares.minimise.__kwdefaults__",
        {**minimise.__kwdefaults__, "max_iterations": 1},
    )
    code, out, err = rodgen_command("diagnose", "mount.toml", "stars.csv", "--json")
    assert (code, err.count("\n")) == (3, 1)
    assert "did not converge" in err
    assert parsed(out)["rows"] == 80


@pytest.mark.thorough
def test_progress_shows_where_somebody_looks_and_nowhere_else(folder, capfd, monkeypatch):
    command = ["diagnose", "mount.toml", "stars.csv", "--json"]
    assert cli.main(command) == 0
    quiet = capfd.readouterr()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert cli.main(command) == 0
    shown = capfd.readouterr()
    assert quiet.err == ""
    assert "testing effects" in shown.err
    assert shown.err.rstrip("\n").endswith("\r")  # and is taken away again
    assert shown.out == quiet.out


def spoilt(number, text):
    """Return the stars with another line; 0 is the header."""
    lines = FILES["stars.csv"].read_text().splitlines()
    lines[number] = text
    return "\n".join(lines) + "\n"


BAD_DATA = {
    "unit": (
        spoilt(0, "AZ [mm],EL [deg],ux,uy,uz"),
        "bad.csv: line 1, column 'AZ [mm]': unit 'mm', which is not a unit of angle; expected",
    ),
    "column": (spoilt(0, "AZ [deg],ux,uy,uz,extra"), "bad.csv: line 1: no column 'EL'"),
    "readings": (spoilt(0, "AZ [deg],EL [deg],ux,uy,other"), "bad.csv: line 1: no column 'uz'"),
    "NaN": (spoilt(3, "10,20,nan,0.5,0.5"), "bad.csv: line 4, column 'ux': 'nan'; expected a finite number"),
    "text": (spoilt(3, "10,twenty,0.1,0.5,0.5"), "bad.csv: line 4, column 'EL [deg]': 'twenty'; expected"),
    "ragged": (spoilt(3, "10,20"), "bad.csv: line 4"),
    "length": (spoilt(3, "10,20,0.5,0.5,0.5"), "bad.csv: line 4"),
    "empty": (HEADER + "\n", "bad.csv: file: no rows"),
    "nothing": ("", "bad.csv: "),
    "bytes": ("\x00\x01\x02", "bad.csv: "),
}


@pytest.mark.parametrize("as_test", [False, True])
@pytest.mark.parametrize("what", BAD_DATA)
def test_measurements_that_cannot_be_used_are_one_line(folder, rodgen_command, what, as_test):
    text, said = BAD_DATA[what]
    (folder / "bad.csv").write_text(text)
    before = sorted(path.name for path in folder.iterdir())
    data = ["stars.csv", "--test", "bad.csv"] if as_test else ["bad.csv"]
    code, out, err = rodgen_command("diagnose", "mount.toml", *data, "--json")
    assert (code, out) == (2, "")
    assert err.startswith(said)
    assert err.count("\n") == 1
    assert "; expected " in err
    assert sorted(path.name for path in folder.iterdir()) == before


REFUSED = {
    "diagnose mount.toml": "rodgen diagnose: the following arguments are required: DATA",
    "diagnose none.toml stars.csv": "none.toml: file: no such file",
    "diagnose mount.toml none.csv": "none.csv: file: no such file",
    "diagnose mount.toml stars.csv --test none.csv": "none.csv: file: no such file",
    "diagnose mount.toml .": ".: file: a folder",
    "diagnose stars.csv mount.toml": "stars.csv: line 1",
    "diagnose mount.toml gantry.csv": "gantry.csv: line 1: no column 'AZ'",
    "diagnose mount.toml stars.csv --test gantry.csv": "gantry.csv: line 1: no column 'AZ'",
    "diagnose mount.toml stars.csv --seed 1": "unrecognized arguments: --seed 1",
    "add mount.toml": "rodgen add: no EFFECT; expected its name, which 'rodgen effects' lists, or --from-diagnosis",
    "add mount.toml refraction --step 1": "--step without --from-diagnosis; expected --from-diagnosis FILE, too",
    "add mount.toml --from-diagnosis mount.json refraction stars.csv": "three files or names; expected MACHINE and",
    "add mount.toml --from-diagnosis mount.json --joint EL": "--joint together with --from-diagnosis; expected",
    "add mount.toml --from-diagnosis mount.json --target boresight": "--target together with --from-diagnosis;",
    "add mount.toml --from-diagnosis mount.json --hold k=0": "--hold together with --from-diagnosis; expected",
    "add mount.toml --from-diagnosis - -": "both on standard input; expected the name of a file for one of them",
    "add mount.toml --from-diagnosis mount.json --step 0": "argument --step: '0' is not a whole number from 1 up",
    "add mount.toml --from-diagnosis mount.json --step x": "argument --step: 'x' is not a whole number from 1 up",
    "add gantry.toml --from-diagnosis gantry.json --step 2": "--step: 2; expected 1, the only step of gantry.json",
    "add mount.toml --from-diagnosis none.json": "none.json: file: no such file; expected a diagnosis",
    "add mount.toml --from-diagnosis .": ".: file: a folder; expected a diagnosis",
    "add mount.toml --from-diagnosis stars.csv": "stars.csv: line 1, column 1: not JSON (",
    "add mount.toml --from-diagnosis mount.toml": "mount.toml: line 1, column ",
    "add none.toml --from-diagnosis mount.json": "none.toml: file: no such file",
    "add gantry.toml --from-diagnosis mount.json": "mount.json: step 1, effect: tube_flexure where measured is 'point'",
    "add mount.toml --from-diagnosis mount.json none.csv": "none.csv: file: no such file",
    "add mount.toml --from-diagnosis mount.json gantry.csv": "gantry.csv: line 1: no column 'AZ'",
    "add mount.toml --from-diagnosis mount.json -o mount.json": "mount.json: file: the input file itself",
    "add mount.toml --from-diagnosis mount.json stars.csv -o stars.csv": "stars.csv: file: the input file itself",
    "add mount.toml --from-diagnosis mount.json -o no/new.toml": "no/new.toml: file: cannot be written",
}


@pytest.mark.thorough(
    "diagnose none.toml stars.csv",
    "diagnose mount.toml stars.csv --test none.csv",
    "diagnose stars.csv mount.toml",
)
@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_is_one_line_and_leaves_nothing(with_diagnoses, rodgen_command, command):
    before = {path.name: path.read_bytes() for path in with_diagnoses.iterdir()}
    code, out, err = rodgen_command(*command.split())
    assert (code, out) == (2, "")
    assert REFUSED[command] in err
    assert err.count("\n") == 1
    assert "; expected " in err
    assert {path.name: path.read_bytes() for path in with_diagnoses.iterdir()} == before


def test_both_commands_have_help(rodgen_command):
    for command, words in (("diagnose", ("--test", "--json")), ("add", ("--from-diagnosis", "--step"))):
        code, out, _ = rodgen_command(command, "--help")
        assert code == 0
        assert "exit codes:" in out
        assert max(map(len, out.splitlines())) <= 120
        for word in words:
            assert word in out
    text = (EXAMPLES.parent.parent / "docs" / "command_line.md").read_text(encoding="utf-8")
    assert "`rodgen add MACHINE --from-diagnosis FILE [DATA]`" in text


# add --from-diagnosis --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DATA)
def test_the_error_falls_to_what_the_diagnosis_says(with_diagnoses, rodgen_command, name):
    found = parsed((with_diagnoses / f"{name}.json").read_text())
    command = ("add", f"{name}.toml", "--from-diagnosis", f"{name}.json", DATA[name])
    code, out, err = rodgen_command(*command, "-o", "better.toml", "--json")
    told = parsed(out)
    assert (code, err) == (0, "")
    assert list(told) == ["file", "effects", "ladder"]
    assert told["file"] == "better.toml"
    effects = [(step["effect"], step["joint"]) for step in found["steps"]]
    assert [(e["effect"], e["place"]) for e in told["effects"]] == effects
    rungs = told["ladder"]["rungs"]
    # Both are full fits from their own starts, to a small part of the parameters' uncertainties.
    expected = [found["rms"]["before"], *(step["rms"] for step in found["steps"])]
    assert [rung["rms"] for rung in rungs] == pytest.approx(expected, rel=1e-6)
    assert rungs[-1]["rms"] == pytest.approx(found["rms"]["after"], rel=1e-6)
    assert rungs[-1]["rms_held_out"] < 0.6 * rungs[0]["rms_held_out"]
    for step in found["steps"]:
        prefix = ".".join(filter(None, (step["joint"], step["effect"])))
        for short, parameter in step["parameters"].items():
            fitted = rungs[-1]["parameters"][f"{prefix}.{short}"]
            assert fitted["unit"] == parameter["unit"]
            assert fitted["value"] == pytest.approx(parameter["value"], abs=1e-2 * parameter["std"])
    machine = rodgen.Machine.load("better.toml")
    assert [(e.name, e.place) for e in machine.effects][-len(effects) :] == effects
    code, out, _ = rodgen_command("fit", "better.toml", DATA[name], "--json")
    assert parsed(out)["rms"] == pytest.approx(found["rms"]["after"], rel=1e-6)


@pytest.mark.parametrize("name", DATA)
def test_the_file_stays_but_for_the_blocks(with_diagnoses, rodgen_command, name):
    original = with_diagnoses / f"{name}.toml"
    original.write_text("# mine, all of it\n" + original.read_text() + "# and its end\n")
    before = original.read_bytes()
    code, out, err = rodgen_command("add", f"{name}.toml", "--from-diagnosis", f"{name}.json")
    assert (code, err) == (0, "")
    after = (with_diagnoses / f"{name}_diagnosed.toml").read_bytes()
    assert out.startswith(f"{name}_diagnosed.toml: {name}.toml with ")
    assert original.read_bytes() == before
    assert after.startswith(before)
    steps = parsed((with_diagnoses / f"{name}.json").read_text())["steps"]
    blocks = tomllib.loads(after.decode())["effect"]
    expected = [{"name": s["effect"], **({"joint": s["joint"]} if s["joint"] else {})} for s in steps]
    assert blocks[-len(steps) :] == expected
    for step in steps:
        assert f"\n{step['effect']}   " in out  # its meaning, as `add` prints it


def test_text_shows_the_ladder_and_what_to_do(with_diagnoses, rodgen_command):
    code, out, err = rodgen_command("add", "mount.toml", "--from-diagnosis", "mount.json", "stars.csv")
    steps = parsed((with_diagnoses / "mount.json").read_text())["steps"]
    titles = [f"{s['effect']} at {s['joint']}" if s["joint"] else s["effect"] for s in steps]
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == f"mount_diagnosed.toml: mount.toml with {' and '.join(titles)}"
    assert lines[4].split()[:2] == ["base", "2.711"]
    for title in titles:
        assert any(line.startswith(f"+ {title} ") for line in lines)
        assert f"{title} explains more than chance does" in out
    assert out.count("  Remedy  ") == len(titles)
    assert max(map(len, lines)) <= 120


def test_names_are_free_ones_and_the_machine_itself_may_be_changed(with_diagnoses, rodgen_command):
    names = []
    for _ in range(2):
        code, out, _ = rodgen_command("add", "mount.toml", "--from-diagnosis", "mount.json", "--json")
        assert code == 0
        names.append(parsed(out)["file"])
    assert names == ["mount_diagnosed.toml", "mount_diagnosed_2.toml"]
    command = ("add", "mount.toml", "--from-diagnosis", "mount.json", "-o", "mount.toml")
    assert rodgen_command(*command)[0] == 0
    assert Path("mount.toml").read_bytes() == Path(names[0]).read_bytes()
    code, out, err = rodgen_command(*command)
    assert (code, out) == (2, "")
    assert err.startswith("mount.json: step 1, effect: ")
    assert "which mount.toml has already; expected an effect that is new" in err
    assert Path("mount.toml").read_bytes() == Path(names[0]).read_bytes()


def written(*steps, **more):
    """Return a diagnosis as text."""
    found = {"verdict": "effects_missing" if steps else "nothing_missing", "rows": 80, "outliers": []}
    found |= {"steps": [{"effect": e, "joint": j} for e, j in steps], "unexplained": []}
    return json.dumps(found | more)


def test_steps_are_chosen(folder, rodgen_command):
    (folder / "d.json").write_text(written(("servo_lag", "X"), ("backlash", "C"), ("servo_lag", "Y")))
    effects = {}
    for steps in ("", "1", "2", "3 1", "3 3"):
        chosen = [word for step in steps.split() for word in ("--step", step)]
        code, out, err = rodgen_command("add", "gantry.toml", "--from-diagnosis", "d.json", *chosen, "--json")
        assert (code, err) == (0, "")
        effects[steps] = [f"{e['effect']}@{e['place']}" for e in parsed(out)["effects"]]
    assert effects[""] == ["servo_lag@X", "backlash@C", "servo_lag@Y"]
    assert (effects["1"], effects["2"], effects["3 1"], effects["3 3"]) == (
        ["servo_lag@X"],
        ["backlash@C"],
        ["servo_lag@X", "servo_lag@Y"],  # in the order of adding
        ["servo_lag@Y"],
    )
    code, out, err = rodgen_command("add", "gantry.toml", "--from-diagnosis", "d.json", "--step", "4")
    assert (code, out) == (2, "")
    assert err == "command line: --step: 4; expected 1 to 3 of d.json\n"


def test_a_target_is_a_place_too(folder, rodgen_command):
    text = (folder / "gantry.toml").read_text()
    (folder / "gantry.toml").write_text(text.replace(', "target"', ""))
    (folder / "d.json").write_text(written(("target_offset", "ball_1")))
    code, _, err = rodgen_command("add", "gantry.toml", "--from-diagnosis", "d.json", "-o", "new.toml")
    assert (code, err) == (0, "")
    assert tomllib.loads(Path("new.toml").read_text())["effect"][-1] == {
        "name": "target_offset",
        "target": "ball_1",
    }


def test_a_pipe_goes_from_one_command_to_the_other(with_diagnoses, rodgen_command, monkeypatch):
    with (with_diagnoses / "mount.json").open(encoding="utf-8") as stream:
        done = run_process(
            "add",
            "mount.toml",
            "--from-diagnosis",
            "-",
            "-o",
            "new.toml",
            folder=with_diagnoses,
            stdin=stream,
        )
    assert (done.returncode, done.stderr) == (0, "")
    assert len(rodgen.Machine.load("new.toml").effects) == 2
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"nothing")))
    code, out, err = rodgen_command("add", "mount.toml", "--from-diagnosis", "-")
    assert (code, out) == (2, "")
    assert err.startswith("standard input: line 1, column 1: not JSON")
    monkeypatch.setattr(sys, "stdin", None)
    assert rodgen_command("add", "mount.toml", "--from-diagnosis", "-")[2].startswith(
        "standard input: file: closed"
    )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_what_a_shell_makes_of_the_file_is_read(with_diagnoses, rodgen_command, encoding):
    text = (with_diagnoses / "mount.json").read_text()
    (with_diagnoses / "mount.json").write_text(text.replace("\n", "\r\n"), encoding=encoding)
    assert rodgen_command("add", "mount.toml", "--from-diagnosis", "mount.json")[0] == 0


FORM = {
    "driver": "C", "component": "tz", "joint": "C", "form": "a*sin(5*q)", "p_value": 1e-9, "rms": 0.1,
    "effect": {
        "name": "tz_by_C", "joint": "C", "component": "tz", "formula": "a*sin(5*q)", "parameters": {"a": "mm"},
    },
}  # fmt: skip


def test_a_form_outside_the_catalogue_is_a_step_like_any_other(folder, rodgen_command):
    (folder / "d.json").write_text(
        written(("backlash", "C"), verdict="unknown_effect", unexplained=[FORM], outliers=[3])
    )
    command = ("add", "gantry.toml", "--from-diagnosis", "d.json", "gantry.csv", "--json", "-o", "new.toml")
    code, out, err = rodgen_command(*command)
    assert code == 0
    assert [e["effect"] for e in parsed(out)["effects"]] == ["backlash", "tz_by_C"]
    assert [rung["title"] for rung in parsed(out)["ladder"]["rungs"][1:]] == [
        "+ backlash at C",
        "+ tz_by_C at C",
    ]
    assert all(rung["rms_held_out"] > 0 for rung in parsed(out)["ladder"]["rungs"])
    assert tomllib.loads(Path("new.toml").read_text())["effect"][-1] == FORM["effect"]
    assert err == "d.json: 1 outlier in the diagnosis, not set aside; diagnose one whole file to do it\n"
    code, out, _ = rodgen_command(*command[:5], "--json", "-o", "form.toml", "--step", "2")
    assert (code, [e["effect"] for e in parsed(out)["effects"]]) == (0, ["tz_by_C"])
    code, out, err = rodgen_command("add", "new.toml", "--from-diagnosis", "d.json", "--step", "2")
    assert (code, out) == (2, "")
    assert err.startswith("d.json: step 2, effect: tz_by_C at C, which new.toml has already")
    assert rodgen_command("emit", "form.toml", "gantry.csv", "--lang", "c", "-o", "form.c")[0] == 0


def test_a_form_without_units_is_reported_as_left_out(folder, rodgen_command):
    old = {key: value for key, value in FORM.items() if key != "effect"}
    (folder / "d.json").write_text(
        written(("backlash", "C"), verdict="unknown_effect", unexplained=[old, FORM])
    )
    code, out, err = rodgen_command("add", "gantry.toml", "--from-diagnosis", "d.json", "--json")
    assert (code, [e["effect"] for e in parsed(out)["effects"]]) == (0, ["backlash", "tz_by_C"])
    assert err == "d.json: 1 form left out, written without units; diagnose again to add\n"


NO_DIAGNOSES = {
    "": "d.json: file: empty; expected a diagnosis, as 'rodgen diagnose --json' writes it",
    "{": "d.json: line 1, column 2: not JSON (",
    '{"verdict":\n "x" "y"}': "d.json: line 2, column 6: not JSON (",
    "[]": "d.json: file: JSON that is a list; expected a diagnosis",
    "3": "d.json: file: JSON that is '3'; expected a diagnosis",
    '"x\\ny"': "d.json: file: JSON that is '\"x\\ny\"'; expected a diagnosis",
    "[" * 100_000: "d.json: file: unreadable JSON",
    "9" * 5000: "d.json: file: unreadable JSON",
    "{}": "d.json: verdict: missing; expected a diagnosis",
    '{"rms": 2.1, "parameters": {}}': "d.json: verdict: missing; expected a diagnosis",  # of `fit --json`
    '{"verdict": ["effects_missing"]}': "d.json: verdict: '[\"effects_missing\"]'; expected a diagnosis",
    written(verdict="fine"): "d.json: verdict: '\"fine\"'; expected a diagnosis",
    '{"verdict": "effects_missing"}': "d.json: steps: missing; expected a diagnosis",
    written(steps={}): "d.json: steps: '{}'; expected a diagnosis",
    written(unexplained=None): "d.json: unexplained: 'null'; expected a diagnosis",
    written(unexplained=[3]): "d.json: unexplained 1: '3'; expected a form and its effect, a table",
    written(
        unexplained=[{"effect": {"name": "x", "formula": "q"}}]
    ): "d.json: step 1, a form, component: missing",
    written(steps=[3], verdict="effects_missing"): "d.json: step 1: '3'; expected an effect and its joint",
    written(("backlash", "C"), (3, "C")): "d.json: step 2, effect: '3'; expected the name of an effect",
    written(steps=[{"joint": "C"}]): "d.json: step 1, effect: missing; expected the name of an effect",
    written(
        steps=[{"effect": "scale"}]
    ): "d.json: step 1, joint: missing; expected the name of a joint or target",
    written(("backlash", 1)): "d.json: step 1, joint: '1'; expected the name of a joint or target, or null",
    written(
        ("backlsh", "C")
    ): "d.json: step 1, effect: no effect 'backlsh' in the catalogue; expected 'backlash'",
    written(("backlash", "D")): "d.json: step 1, joint: no joint or target 'D'; expected",
    written(("backlash", None)): "d.json: step 1, joint: missing; expected a prismatic or revolute joint",
    written(
        ("straightness", "C")
    ): "d.json: step 1, joint: 'C', a revolute joint; expected a prismatic joint",
    written(("linear_drift", "C")): "d.json: step 1, joint: 'C', but linear_drift acts on the whole machine",
    written(("refraction", None)): "d.json: step 1, effect: refraction where measured is 'point'",
    written(
        ("servo_lag", "X"), ("servo_lag", "X")
    ): "d.json: step 2, effect: servo_lag at X twice; expected it once",
    written(): "d.json: steps: none: nothing is missing; expected a diagnosis that found effects",
    written(
        verdict="cannot_tell", reason="x"
    ): "d.json: steps: none: those data cannot tell; expected a diagnosis",
    written(
        verdict="unknown_effect"
    ): "d.json: steps: none: its forms have no formula with units; expected a diagnosis by this version of rodgen",
}


@pytest.mark.parametrize("text", NO_DIAGNOSES, ids=lambda text: text[:40])
def test_what_is_no_diagnosis_is_one_line_and_leaves_nothing(folder, rodgen_command, text):
    (folder / "d.json").write_text(text)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, out, err = rodgen_command("add", "gantry.toml", "--from-diagnosis", "d.json", "-o", "new.toml")
    assert (code, out) == (2, "")
    assert err.startswith(NO_DIAGNOSES[text])
    assert err.count("\n") == 1
    assert "; expected " in err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_every_verdict_is_known():
    assert set(_NONE) == set(VERDICTS)


def test_every_effect_of_the_catalogue_may_be_added_where_it_can_stand(folder, rodgen_command):
    machine = rodgen.Machine.load("gantry.toml")
    places = [None, *(j.name for j in machine.joints), *(t.name for t in machine.targets)]
    steps = []
    for definition in CATALOGUE:
        for place in places:
            if machine.kind_of(place) in definition.at:
                try:
                    machine = machine.add(machine.effect(definition.name, place))
                except rodgen.RodgenError:
                    continue
                steps.append((definition.name, place))
    (folder / "d.json").write_text(written(*steps))
    code, out, err = rodgen_command(
        "add", "gantry.toml", "--from-diagnosis", "d.json", "-o", "new.toml", "--json"
    )
    assert (code, err) == (0, "")
    assert [(e["effect"], e["place"]) for e in parsed(out)["effects"]] == steps
    assert rodgen.Machine.load("new.toml") == machine


@pytest.mark.thorough
def test_a_step_is_added_in_python_too(folder):
    machine = rodgen.Machine.load("gantry.toml")
    diagnosis = machine.fit(rodgen.Measurements.load("gantry.csv")).diagnose()
    step = diagnosis.steps[0]
    better = machine.add(step)
    data = rodgen.Measurements.load("gantry.csv")
    rung = ladder(machine, data, [step.effect]).rungs[1]
    assert step.log10_p == pytest.approx(rung.step.log10_p, rel=1e-6)  # one test for both
    assert better.effects[-1].title == "encoder_eccentricity at C"
    assert better == machine.with_effect(diagnosis.steps[0].effect)
    assert better.fit(rodgen.Measurements.load("gantry.csv")).rms == pytest.approx(
        diagnosis.rms.after, rel=1e-6
    )


# without what is not needed --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fresh_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def without_a_compiler(cache, **more):
    env = {k: v for k, v in os.environ.items() if k not in ("CC", "RODGEN_CPU")}
    return env | {"RODGEN_CACHE": str(cache), "CC": "/nonexistent"} | more


@pytest.mark.thorough
def test_few_rows_need_no_compiler(with_diagnoses, fresh_cache):
    same = {key: x for key, x in os.environ.items() if key == "RODGEN_CPU"}
    env = without_a_compiler(fresh_cache, **same)
    done = run_process("diagnose", "mount.toml", "stars.csv", "--json", folder=with_diagnoses, env=env)
    assert (done.returncode, done.stderr) == (0, "")
    # To the last digit: what is compiled, or in the cache, decides nothing.
    assert done.stdout == (with_diagnoses / "mount.json").read_text()


@pytest.mark.thorough
@pytest.mark.parametrize("how", ["numpy asked for", "no compiler"])
def test_without_a_compiler(folder, fresh_cache, how):
    """The same answer; and one notice, where a compiler was meant to be there."""
    command = ["fit", "mount.toml", "stars.csv", "--loss", "huber", "--json"]
    env = without_a_compiler(fresh_cache, **({"RODGEN_CPU": "numpy"} if how == "numpy asked for" else {}))
    done = run_process(*command, folder=folder, env=env)
    assert done.returncode == 0
    if how == "no compiler":
        assert done.stderr.startswith("rodgen: warning: ")
        assert done.stderr.count("\n") == 1
    else:
        assert done.stderr == ""
    assert parsed(done.stdout)["rms"] == pytest.approx(
        parsed(run(*command, folder=folder).stdout)["rms"], rel=1e-6
    )


@pytest.mark.thorough
def test_without_plotly_and_what_else_is_not_needed(with_diagnoses):
    code = (
        "import sys\n"
        "sys.modules['plotly'] = None\n"
        "from rodgen.cli import main as cli\n"
        "assert cli.main(['diagnose', 'gantry.toml', 'gantry.csv']) == 0\n"
        "assert cli.main(['add', 'gantry.toml', '--from-diagnosis', 'gantry.json', 'gantry.csv']) == 0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "encoder_eccentricity at C" in done.stdout


@pytest.mark.parametrize(
    ("drivers", "said"),
    [
        (["C"], "follows C"),
        (["t and Y", "Y"], "follows t and Y"),
        (["A", "C and t"], "follows A, C and t"),
    ],
)
def test_headline_of_a_form_names_each_driver_once_and_a_fall_that_can_be_seen(drivers, said):
    forms = [SimpleNamespace(driver=driver) for driver in drivers]
    rms = SimpleNamespace(before=0.0029312, after=0.0028992, unit="mm")
    found = SimpleNamespace(verdict="unknown_effect", unexplained=forms, steps=(), rms=rms, wrong_bounds="")
    found.base = SimpleNamespace(weighted=False)
    assert headline(found) == (
        f"Something outside the catalogue {said}; the error falls by 1.1 %, from 2.931 to 2.899 um."
    )


def test_sizes_have_the_digits_that_their_uncertainty_leaves(with_diagnoses, rodgen_command):
    code, out, _ = rodgen_command("diagnose", "mount.toml", DATA["mount"])
    sizes = re.findall(r"^  \w+ +(-?[\d.e-]+) ± ([\d.e-]+) arcsec$", out, re.MULTILINE)
    assert code == 0
    assert sizes
    for value, std in sizes:
        assert len(value.partition(".")[2]) == len(std.partition(".")[2])
        assert len(std.replace(".", "").lstrip("0")) == 2


@pytest.mark.thorough
def test_errors_are_weighted_where_stated_uncertainties_differ(rodgen_command):
    """Along z the tracker is eight times worse: in millimetres the error hardly falls."""
    place = EXAMPLES / "positioner"
    code, out, _ = rodgen_command("diagnose", place / "machine.toml", place / "data.csv")
    assert code == 0
    assert "the error falls from 1.95 to 0.981 stated uncertainties." in " ".join(out.split())
    assert "uncertainties" not in rodgen_command("diagnose", FILES["mount.toml"], FILES["stars.csv"])[1]
