"""`rodgen diagnose` as a user types it: what it prints, writes and refuses."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from commands import run, run_process

import rodgen
from rodgen.calibration.ladder import ladder
from rodgen.calibration.words import three_digits

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
    # those lie between the poses that were seen; without their neighbours the missing effect is predicted worse
    assert rms["before_test"] < rms["before_held_out"] < 1.25 * rms["before_test"]
    assert parsed(out)["held_out_by"] == "posture"
    assert rms["after_test"] == pytest.approx(0.002, rel=0.15)  # the noise that is stated
    code, out, _ = rodgen_command(*command)
    assert code == 0
    assert "rms in um per reading" in out
    before, after = (three_digits(1000 * rms[when]) for when in ("before_test", "after_test"))
    assert re.search(rf"test file  odds\nthe file .* {before}\n\+ .* {after}  more than", out)


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
    aliases = [alias["effects"] for alias in first["indistinguishable_from"]]
    named = [
        (each["effect"], each["joint"]) for each in (first, *(one for one, *more in aliases if not more))
    ]
    assert ("encoder_eccentricity", "C") in named  # a weight about C does the same


def test_cannot_tell_is_an_answer(folder, rodgen_command):
    lines = (folder / "stars.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join(lines[:5]) + "\n")
    code, out, err = rodgen_command("diagnose", "mount.toml", "few.csv", "--json")
    found = parsed(out)
    assert (code, err) == (0, "")
    assert (found["verdict"], found["steps"], found["unexplained"]) == ("cannot_tell", [], [])
    assert found["reason"]
    assert found["not_held_out"]["reason"] == "undecidable"
    code, out, _ = rodgen_command("diagnose", "mount.toml", "few.csv")
    assert code == 0
    assert f"These data cannot tell: {found['reason'][:30]}" in out


def spoilt(number, text):
    """Return the stars with another line; 0 is the header."""
    lines = FILES["stars.csv"].read_text().splitlines()
    lines[number] = text
    return "\n".join(lines) + "\n"


BAD_DATA = {
    "unit": spoilt(0, "AZ [mm],EL [deg],ux,uy,uz"),
    "column": spoilt(0, "AZ [deg],ux,uy,uz,extra"),
    "readings": spoilt(0, "AZ [deg],EL [deg],ux,uy,other"),
    "NaN": spoilt(3, "10,20,nan,0.5,0.5"),
    "text": spoilt(3, "10,twenty,0.1,0.5,0.5"),
    "ragged": spoilt(3, "10,20"),
    "length": spoilt(3, "10,20,0.5,0.5,0.5"),
    "empty": HEADER + "\n",
    "nothing": "",
    "bytes": "\x00\x01\x02",
}


@pytest.mark.parametrize("as_test", [False, True])
@pytest.mark.parametrize("what", BAD_DATA)
def test_measurements_that_cannot_be_used_are_one_line(folder, refuses_command, what, as_test):
    (folder / "bad.csv").write_text(BAD_DATA[what])
    data = ["stars.csv", "--test", "bad.csv"] if as_test else ["bad.csv"]
    refuses_command("diagnose", "mount.toml", *data, "--json")


REFUSED = [
    "diagnose mount.toml",
    "diagnose none.toml stars.csv",
    "diagnose mount.toml none.csv",
    "diagnose mount.toml stars.csv --test none.csv",
    "diagnose mount.toml .",
    "diagnose stars.csv mount.toml",
    "diagnose mount.toml gantry.csv",
    "diagnose mount.toml stars.csv --test gantry.csv",
    "diagnose mount.toml stars.csv --seed 1",
    "diagnose mount.toml stars.csv --only 1",
    "diagnose mount.toml stars.csv --only 0 -o x.toml",
]


@pytest.mark.thorough(
    "diagnose none.toml stars.csv",
    "diagnose mount.toml stars.csv --test none.csv",
    "diagnose stars.csv mount.toml",
)
@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_is_one_line_and_leaves_nothing(folder, refuses_command, command):
    refuses_command(*command.split())


# diagnose -o --------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("name", DATA)
def test_the_file_that_is_written_is_the_old_one_with_what_was_found(with_diagnoses, rodgen_command, name):
    original = with_diagnoses / f"{name}.toml"
    original.write_text("# mine, all of it\n" + original.read_text() + "# and its end\n")
    before = original.read_bytes()
    code, out, err = rodgen_command("diagnose", f"{name}.toml", DATA[name], "-o", "better.toml", "--json")
    found = parsed(out)
    assert (code, err) == (0, "")
    after = (with_diagnoses / "better.toml").read_bytes()
    assert original.read_bytes() == before
    assert after.startswith(before)
    steps = found["steps"]
    expected = [{"name": s["effect"], **({"joint": s["joint"]} if s["joint"] else {})} for s in steps]
    assert tomllib.loads(after.decode())["effect"][-len(steps) :] == expected
    fit = parsed(rodgen_command("fit", "better.toml", DATA[name], "--json")[1])
    assert fit["rms"] == pytest.approx(found["rms"]["after"], rel=1e-6)
    for step in steps:
        prefix = ".".join(filter(None, (step["joint"], step["effect"])))
        for short, parameter in step["parameters"].items():
            fitted = fit["parameters"][f"{prefix}.{short}"]
            assert fitted["unit"] == parameter["unit"]
            assert fitted["value"] == pytest.approx(parameter["value"], abs=1e-2 * parameter["std"])


@pytest.mark.thorough
def test_only_some_of_the_effects_are_written(with_diagnoses, rodgen_command):
    command = ("diagnose", "mount.toml", "stars.csv")
    code, out, _ = rodgen_command(*command, "-o", "better.toml", "--only", "2")
    assert (code, out.splitlines()[-1]) == (0, "better.toml: mount.toml with refraction (TX)")
    assert [effect.name for effect in rodgen.Machine.load("better.toml").effects] == ["refraction"]
    code, _, err = rodgen_command(*command, "-o", "more.toml", "--only", "3")
    assert (code, err) == (2, "command line: --only: 3; expected 1 to 2, what was found\n")
    assert not Path("more.toml").exists()


@pytest.mark.thorough
def test_a_step_is_added_in_python_too(folder):
    machine = rodgen.Machine.load("gantry.toml")
    diagnosis = machine.fit(rodgen.Measurements.load("gantry.csv")).diagnose()
    step = diagnosis.steps[0]
    better = machine.add(step)
    data = rodgen.Measurements.load("gantry.csv")
    rung = ladder(machine, data, [step.effect]).rungs[1]
    assert rung.step.log10_odds > 6
    assert step.log10_odds > 6
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
    command = ["fit", "mount.toml", "stars.csv", "--json"]
    env = without_a_compiler(fresh_cache, **({"RODGEN_CPU": "numpy"} if how == "numpy asked for" else {}))
    code = "import rodgen.calibration.fit as fit, rodgen.cli.main as cli; fit.COMPILE_FROM = 0; cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *command],
        capture_output=True,
        text=True,
        cwd=folder,
        env=env,
        check=True,
    )
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
        "assert cli.main(['add', 'gantry.toml', 'backlash', 'gantry.csv', '--joint', 'C']) == 0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "encoder_eccentricity at C" in done.stdout
