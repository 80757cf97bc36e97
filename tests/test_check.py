"""Wrong machine files and wrong data are noticed, the right repair is named, and right ones are not accused.

The readings come from the independent simulator; a file is damaged in one of the ways in which people damage files
(`study/wrong_files.py`, which measures hundreds).
"""

from __future__ import annotations

import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_effects import BENCHES

from rodgen.calibration.check import Check, check
from rodgen.calibration.fit import fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.files.edit import edited_text
from rodgen.machines.machine import Machine

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "study"))
from wrong_files import WRONG, Files, one

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "machines"


def right_files(bench: str, folder: Path) -> Files:
    """Write what a user has of a machine that is not quite as drawn."""
    random = np.random.default_rng(3)
    b = BENCHES[bench](random, 0.4)
    simulated = b.simulator(b.file, b.wrong)
    reading = simulated.with_noise(simulated.measure(b.q, target=b.target), b.sigma, random)
    (folder / "machine.toml").write_text(b.text.replace("{noise}", ""))
    simulated.write_csv(folder / "data.csv", q=b.q, reading=reading, target=b.target)
    return Files.read(folder / "machine.toml", folder / "data.csv")


def checked(files: Files, folder: Path) -> Check:
    machine, data = files.write(folder)
    return check(Machine.load(machine), Measurements.load(data))


def damaged_trunnion(folder: Path) -> tuple[Path, Path]:
    """Write the files of a trunnion whose A turns the other way than its file says."""
    files = right_files("trunnion", folder)
    files.joints[0]["axis"] = [-1, 0, 0]
    return files.write(folder)


@pytest.mark.parametrize("bench", ["rotary_table", "trunnion", "mount", "ballbar", "gantry_rotary"])
def test_right_files_are_not_accused(bench: str, tmp_path: Path) -> None:
    files = right_files(bench, tmp_path)
    assert not checked(files, tmp_path).wrong
    machine, data = files.write(tmp_path)
    assert fit(Machine.load(machine), Measurements.load(data)).check().suspicions == ()


@pytest.mark.thorough
def test_an_axis_with_the_wrong_sign_is_named_though_a_fit_can_turn_it(tmp_path: Path) -> None:
    machine, data = damaged_trunnion(tmp_path)
    found = fit(Machine.load(machine), Measurements.load(data)).check()
    assert found.wrong
    assert found.repairs[0].words == "A turns the other way: axis = [1, 0, 0]"
    assert found.before is not None
    assert found.after is not None
    assert found.before > 10
    assert found.after < 0.004  # noise of 0.002
    assert found.unit == "mm"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "damage", "words"),
    [
        ("gantry_rotary", lambda f: f.joints.reverse(), "from the tool to the base"),
        ("trunnion", lambda f: f.put("C", np.radians(f.numbers("C"))), "C is in rad, not in deg"),
        ("trunnion", lambda f: f.put("A", f.numbers("A") + 90), 'coordinate = "A - 90 deg"'),
        ("trunnion", lambda f: f.put("z", -f.numbers("z")), "the sign of z is wrong"),
        ("gantry_rotary", lambda f: [f.put(x, f.numbers(x) / 25.4) for x in "xyz"], "x, y and z are in inch"),
        ("gantry", lambda f: f.put("Y", f.numbers("Y") / 1000), "Y is in m, not in mm"),
        (
            "mount",
            lambda f: f.joints[1].update(axis=[0, 0, 1]),
            "EL turns about another axis: axis = [1, 0, 0]",
        ),
        (
            "mount",
            lambda f: WRONG["joint_order"](f, np.random.default_rng(0)),
            "order of the chain is AZ and EL",
        ),
    ],
    ids=["order", "radians", "zero", "mirror", "inches", "metres", "axis", "order of a mount"],
)
def test_the_right_repair_is_named(bench: str, damage, words: str, tmp_path: Path) -> None:
    files = right_files(bench, tmp_path)
    damage(files)
    found = checked(files, tmp_path)
    assert found.wrong
    assert any(words in repair.words for repair in found.repairs), str(found)


@pytest.mark.thorough
@pytest.mark.parametrize("offset", [1, -2])
def test_rows_that_are_shifted_are_named(offset: int, tmp_path: Path) -> None:
    files = right_files("trunnion", tmp_path)
    for name in "xyz":
        files.put(name, np.roll(files.numbers(name), 2 * offset))  # two balls a pose
    found = checked(files, tmp_path)
    assert found.wrong


@pytest.mark.thorough
def test_furlongs_are_wrong_though_no_repair_is_known(tmp_path: Path) -> None:
    files = right_files("gantry", tmp_path)
    for name in "xyz":
        files.put(name, files.numbers(name) / 201168)
    found = checked(files, tmp_path)
    assert found.wrong


def test_what_cannot_be_seen_is_not_accused(tmp_path: Path) -> None:
    files = right_files("gantry", tmp_path)
    files.joints[0], files.joints[1] = files.joints[1], files.joints[0]
    assert not checked(files, tmp_path).wrong


def called(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


@pytest.mark.thorough
def test_the_command_names_writes_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine, data = damaged_trunnion(tmp_path)
    machine.write_text(machine.read_text() + "# a note\n")
    repaired = tmp_path / "repaired.toml"
    assert called("check", machine, data, "-o", repaired) == 1
    assert "A turns the other way: axis = [1, 0, 0]; with that the error is 1.8" in capsys.readouterr().out
    assert Machine.load(repaired).joint("A").axis == (1.0, 0.0, 0.0)
    assert repaired.read_text().endswith("# a note\n")
    assert called("check", repaired, data, "--json") == 0
    assert json.loads(capsys.readouterr().out)["wrong"] is False
    assert called("emit", machine, data, "--lang", "c", "-o", tmp_path / "code") == 2
    assert "A turns the other way" in capsys.readouterr().err
    assert not (tmp_path / "code").exists()
    called("fit", machine, data)
    assert "A turns the other way" in capsys.readouterr().out.splitlines()[0]


def test_a_diagnosis_does_not_explain_wrong_files(tmp_path: Path) -> None:
    machine, data = damaged_trunnion(tmp_path)
    diagnosis = Machine.load(machine).fit(Measurements.load(data)).diagnose()
    assert diagnosis.verdict == "cannot_tell"
    assert diagnosis.reason is not None
    assert "A turns the other way: axis = [1, 0, 0]" in diagnosis.reason
    assert diagnosis.steps == ()


@pytest.mark.thorough
def test_repaired_data_are_those_before_the_damage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = right_files("trunnion", tmp_path)
    right = files.numbers("C")
    files.put("C", np.radians(right))
    machine, data = files.write(tmp_path)
    repaired = tmp_path / "repaired.csv"
    assert called("check", machine, data, "--repaired-data", repaired) == 1
    np.testing.assert_allclose(Measurements.load(repaired).columns["C"].values, right, rtol=1e-11)
    assert called("check", machine, repaired) == 0
    assert called("check", machine, data, "-o", tmp_path / "repaired.toml") == 2
    assert "--repaired-data" in capsys.readouterr().err
    assert not (tmp_path / "repaired.toml").exists()


@pytest.mark.thorough
def test_repaired_data_say_which_rows_are_dropped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = right_files("trunnion", tmp_path)
    for name in "xyz":
        files.put(name, np.roll(files.numbers(name), 2))  # two balls a pose: a pose later
    machine, data = files.write(tmp_path)
    repaired, n = tmp_path / "repaired.csv", len(files.numbers("x"))
    assert called("check", machine, data, "--repaired-data", repaired, "--json") == 1
    repair = json.loads(capsys.readouterr().out)["repairs"][0]
    lost = repair["commands_without_readings"], repair["readings_without_commands"]
    assert lost == ([n - 2, n - 1], [0, 1])
    assert repair["rows"] == Measurements.load(repaired).rows == n - 2
    assert called("check", machine, data, "--repaired-data", repaired) == 1
    said = capsys.readouterr().out
    assert (
        f"repaired.csv has {n - 2} of {n} rows: the commands of lines {n} and {n + 1} of data.csv and the "
        in said
    )
    assert "readings of lines 2 and 3 of data.csv have no partner." in said
    assert called("check", machine, repaired) == 0


def machine_of_a_table_that_turns_the_other_way(folder: Path) -> Path:
    text = (EXAMPLES / "rotary_table" / "machine.toml").read_text().partition("[estimate]")[0]
    machine = folder / "machine.toml"
    machine.write_text(text + '[[effect]]\nname = "scale"\njoint = "C"\nhold = { k = -2 }\n')
    return machine


def test_a_number_that_no_machine_has_is_not_emitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = machine_of_a_table_that_turns_the_other_way(tmp_path)
    assert called("emit", machine, "--lang", "numpy", "-o", tmp_path / "code") == 2
    assert "C.scale.k = -2" in capsys.readouterr().err
    assert not (tmp_path / "code").exists()


@pytest.mark.thorough
def test_python_emits_no_more_than_the_command(refuses, tmp_path: Path) -> None:
    machine = Machine.load(machine_of_a_table_that_turns_the_other_way(tmp_path))
    refuses(machine.emit, "numpy", tmp_path / "code")
    files = damaged_trunnion(tmp_path)
    turned = fit(Machine.load(files[0]), Measurements.load(files[1]))
    assert pickle.loads(pickle.dumps(turned.machine)) == turned.machine
    for wrong in (turned.machine, turned.diagnose().machine):
        refuses(wrong.emit, "numpy", tmp_path / "code")
    assert not (tmp_path / "code").exists()


@pytest.mark.slow
def test_force_emits_it_all_the_same(tmp_path: Path) -> None:
    machine = machine_of_a_table_that_turns_the_other_way(tmp_path)
    assert called("emit", machine, "--lang", "numpy", "-o", tmp_path / "code", "--force") == 0


TRUNNION = EXAMPLES / "trunnion" / "machine.toml"


def commented_trunnion() -> str:
    """Return the example's text with comments in, right above and below blocks of joints."""
    text = TRUNNION.read_text()
    text = text.replace('[[joint]]\nname   = "A"', '# The cradle.\n[[joint]]  # horizontal\nname   = "A"')
    text = text.replace("axis   = [1, 0, 0]", "axis   = [ 1, 0,\n  0 ]  # to the right")
    return text.replace("travel = [-100, 40]", "travel = [-100, 40]\n# as its manual says")


@pytest.mark.parametrize(
    ("change", "edited"),
    [
        (
            lambda m: with_joint(m, 3, axis=(-1.0, 0.0, 0.0)),
            lambda t: t.replace("[ 1, 0,\n  0 ]", "[-1, 0, 0]"),
        ),
        (
            lambda m: replace(m, joints=(*m.joints[:3], m.joints[4], m.joints[3])),
            lambda t: t.replace('["A", "C"]', '["C", "A"]'),
        ),
        (
            lambda m: replace(m, targets=(replace(m.targets[0], point=(2794.0, 0.0, 2032.0)),)),
            lambda t: t.replace("[110, 0, 80]", "[2794, 0, 2032]"),
        ),
    ],
    ids=["axis", "order", "target"],
)
def test_a_changed_geometry_keeps_every_other_byte(change, edited, tmp_path: Path) -> None:
    (tmp_path / "machine.toml").write_text(commented_trunnion())
    machine = Machine.load(tmp_path / "machine.toml")
    assert edited_text(tmp_path / "machine.toml", change(machine)) == edited(commented_trunnion())


def test_blocks_of_a_chain_are_moved_with_their_comments(tmp_path: Path) -> None:
    text = commented_trunnion().replace('instrument = "tool"\n', "")
    text = text[: text.index("[[branch]]")] + text[text.index("[[joint]]") :]
    (tmp_path / "machine.toml").write_text(text)
    machine = Machine.load(tmp_path / "machine.toml")
    meant = replace(machine, joints=(*machine.joints[:3], machine.joints[4], machine.joints[3]))
    expected = exchanged(text, "# The cradle", "[[joint]]\nname  =", "\n\n[[target]]")
    assert edited_text(tmp_path / "machine.toml", meant) == expected


def with_joint(machine: Machine, j: int, **changes: object) -> Machine:
    joints = list(machine.joints)
    joints[j] = replace(joints[j], **changes)  # type: ignore[arg-type]
    return replace(machine, joints=tuple(joints))


def exchanged(text: str, first: str, second: str, end: str) -> str:
    """Exchange the two parts of a text that begin at `first` and at `second` and are followed by a blank line."""
    i, j, k = text.index(first), text.index(second), text.index(end)
    return text[:i] + text[j:k] + "\n" + text[j - 1 : j] + text[i : j - 2] + "\n" + text[k + 1 :]


def test_a_file_that_cannot_be_edited_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    text = TRUNNION.read_text().replace('[[target]]\nname  = "ball"\npoint = [110, 0, 80]\n', "")
    path.write_text('target = [{ name = "ball", point = [110, 0, 80] }]\n' + text)
    machine = Machine.load(path)
    meant = replace(machine, targets=(replace(machine.targets[0], point=(1.0, 2.0, 3.0)),))
    (tmp_path / "new.toml").write_text(edited_text(path, meant))
    assert Machine.load(tmp_path / "new.toml") == meant


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("number", range(0, 56, 7))
def test_damage_of_every_kind_is_repaired_on_every_machine(kind: str, number: int) -> None:
    record = one(number, kind)
    if "skipped" not in record:
        assert record["told"]
        assert record["named"], record["text"]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(1000, 1040))
def test_right_files_of_all_sorts_are_not_accused(number: int) -> None:
    record = one(number, "")
    assert not record["told"], record["text"]


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_too_few_rows_are_neither_right_nor_wrong(
    rows: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No row raised an IndexError, one a ZeroDivisionError; of two "nothing looks wrong" was said."""
    lines = (EXAMPLES / "rotary_table" / "data.csv").read_text().splitlines(keepends=True)
    (tmp_path / "data.csv").write_text("".join(lines[: rows + 1]))
    files = [str(EXAMPLES / "rotary_table" / "machine.toml"), str(tmp_path / "data.csv")]
    assert main(["check", *files]) == (0 if rows else 2)
    said = capsys.readouterr()
    if not rows:
        assert said.err.endswith("no rows; expected at least one measurement under the header\n")
        return
    assert "too few readings, for as many parameters, to show whether something is wrong." in said.out
    assert main(["fit", *files]) == 0
    fitted = capsys.readouterr()
    assert fitted.err == ""
    assert "There are no more readings than parameters that they determine" in fitted.out
