"""Inputs that are made to harm end with one line, at once and in little memory."""

from __future__ import annotations

import gzip
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from rodgen.calibration.effort import why_long
from rodgen.cli._console import notify, show
from rodgen.cli.main import main
from rodgen.codegen import build_cache
from rodgen.data.measurements import Measurements
from rodgen.data.tables._arrow import ParquetTable
from rodgen.files import write_file
from rodgen.kinematics import tricept
from rodgen.machines.files import toml
from rodgen.machines.machine import Joint, Machine, Measured, Target


def error_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_more_cells_than_the_limit_are_not_kept(
    refuses, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rodgen.data.tables.table.CELLS", 5)
    refuses(Measurements.from_frame, {"C [deg]": [0, 90, 180], "d [mm]": [1, 2, 3]})
    pairs = str(Path(__file__).parent.parent / "examples" / "pairs.csv")  # 30 rows of 8 cells
    monkeypatch.setattr("rodgen.data.tables.table.CELLS", 239)
    assert "more than 239 cells" in error_of(capsys, "fit-axis", pairs)
    monkeypatch.setattr("rodgen.data.tables.table.CELLS", 240)
    assert main(["fit-axis", pairs]) == 0


def test_arrays_in_each_other_are_limited(refuses) -> None:
    text = "a = " + "[1, " * 49 + "]" * 49
    assert list(toml.parse(text, "m.toml")) == ["a"]
    refuses(toml.parse, f"a = [{text[4:]}]", "m.toml")


@pytest.mark.parametrize("start", ["", "[", "[[", "x = {", "x = {b = 1, ", "a = 1\n  "])
@pytest.mark.parametrize("name", ["a", '"a b"', "'a'"])
def test_a_key_of_many_names_is_refused(refuses, start: str, name: str) -> None:
    """The TOML reader of Python takes 7.9 GB and 101 s for 200,000."""
    text = start + f"{name} . " * 200_000
    refuses(toml.parse, text, "m.toml")


def test_dots_in_texts_are_no_key() -> None:
    text = 'a = "' + "b." * 200 + '"\nc.d.e = "..."\n'
    assert toml.parse(text, "m.toml") == {"a": "b." * 200, "c": {"d": {"e": "..."}}}


@pytest.mark.parametrize("text", ["{", '{"a', "[" * 500 + "a.", "'a'", 'a"', "a ", "a. "])
def test_texts_that_are_nearly_keys_are_read_soon(refuses, text: str) -> None:
    refuses(toml.parse, text * (900_000 // len(text)), "m.toml")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no endless device")
def test_an_endless_file_is_not_read(refuses) -> None:
    refuses(toml.read_text, "/dev/zero")


def test_millions_of_empty_lines_are_skipped_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "empty.csv.gz"
    file.write_bytes(gzip.compress(b"\n" * 30_000_000, 1))
    assert "only empty lines" in error_of(capsys, "fit-axis", str(file))


def test_no_memory_is_no_damaged_file() -> None:
    table = ParquetTable.__new__(ParquetTable)
    table.file = "t.parquet"
    error = table._damaged(pa.lib.ArrowMemoryError("malloc of size 64 failed"))
    assert "needs more memory than there is (malloc of size 64 failed)" in str(error)


@pytest.mark.parametrize("command", ["fit", "check", "diagnose"])
def test_a_target_at_1e308_is_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = Path(__file__).parent.parent / "examples" / "machines" / "rotary_table"
    file = tmp_path / "far.toml"
    file.write_text((machine / "machine.toml").read_text().replace("[150, 0, 30]", "[1e308, 0, 30]"))
    err = error_of(capsys, command, str(file), str(machine / "data.csv"))
    assert "target ball_1, point: numbers of 1e+100 and more" in err


def test_rods_beyond_reach_have_no_pose() -> None:
    rods = [
        [1e100, 700, 700],
        [1e100, 1e100, 1e100],
        [1e200, 1e200, 1e200],
        [5000, 700, 700],
        [650, 700, 760],
    ]
    poses, count = tricept.direct_all(rods, tricept.PAPER)
    assert count.tolist() == [0, 0, 0, 0, 8]
    assert np.isnan(poses[:4]).all()


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
def test_a_full_device_tells_which_files_are_complete(tmp_path: Path) -> None:
    machine = Path(__file__).parent.parent / "examples" / "machines" / "rotary_table"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rodgen", "fit", machine / "machine.toml", machine / "data.csv", "-o", "x.toml"],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False, cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.endswith("; complete: x.toml\n")
    assert done.stderr.count("\n") == 1


def test_a_file_that_is_read_only_is_not_replaced(refuses, tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(b"mine")
    file.chmod(0o444)
    refuses(write_file, file, b"new")
    assert file.read_bytes() == b"mine"
    assert [path.name for path in tmp_path.iterdir()] == ["x.toml"]


def test_characters_that_a_terminal_obeys_are_written_out(capsys: pytest.CaptureFixture[str]) -> None:
    show("run a\x1b[2J\r\u202e\tb\nα")
    notify("run \x9b2J")
    assert capsys.readouterr() == ("run a\\x1b[2J\\r\\u202e\tb\nα\n", "run \\x9b2J\n")


# compilers ---------------------------------------------------------------------------------------------


def compiler_that(folder: Path, does: str) -> Path:
    path = folder / "mycc"
    path.write_text(f"#!/bin/sh\n{does}\n")
    path.chmod(0o755)
    return path


def test_a_command_with_an_open_quotation_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", 'gcc "')
    with pytest.raises(build_cache.CompilerError, match=r"CC holds .gcc .., .*No closing quotation"):
        build_cache.compiler()


def test_a_compiler_of_this_folder_compiles(
    compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It runs in another folder."""
    compiler_that(tmp_path, f'exec {compiler} "$@"')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CC", "./mycc")
    build_cache.check_compiler(build_cache.compiler())


def test_messages_of_a_compiler_need_not_be_utf_8(tmp_path: Path) -> None:
    path = compiler_that(tmp_path, "printf 'error: \\374bel\\n' >&2; exit 1")
    with pytest.raises(build_cache.CompilerError, match="fails: error: \ufffdbel"):
        build_cache.check_compiler((str(path),))


def test_a_compiler_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = compiler_that(tmp_path, "sleep 100")
    monkeypatch.setattr("rodgen.limits.COMPILE", 0.2)
    with pytest.raises(build_cache.CompilerError, match=r"does not end in 0\.2 s$"):
        build_cache.check_compiler((str(path),))


def arm_with_targets(count: int, *, estimate: tuple[str, ...]) -> Machine:
    joints = tuple(Joint(f"J{i}", "revolute", axis=(0, i % 2, 1 - i % 2), point=(0, 0, 0)) for i in range(6))
    targets = tuple(Target(f"m{i}", (1.0, 0.0, i / count)) for i in range(count))
    return Machine(
        "arm", "m", "rad", (0.0, 0.0, -1.0), 293.15, joints, targets, Measured("point", "free"),
        estimate=estimate,
    )  # fmt: skip


def test_what_will_take_minutes_is_said_before_it_begins() -> None:
    rows = Measurements.from_frame({"J0 [rad]": np.zeros(5000)})
    said = why_long(arm_with_targets(500, estimate=("target",)), rows)
    assert "500 targets of unknown position make some 1524 parameters for 5000 rows" in said
    assert not why_long(arm_with_targets(500, estimate=("target.m1", "J1.point")), rows)
    assert not why_long(arm_with_targets(60, estimate=("target",)), rows)
    assert "takes a while: 90 targets" in why_long(
        arm_with_targets(90, estimate=("target",)), rows, diagnosis=True
    )
    assert not why_long(arm_with_targets(20, estimate=("target",)), rows, diagnosis=True)


def test_a_diagnosis_of_many_rows_or_joints_is_said_to_take_long() -> None:
    machine = arm_with_targets(3, estimate=("target",))
    many = Measurements.from_frame({"J0 [rad]": np.zeros(1_000_000)})
    assert "there are 1000000 rows" in why_long(machine, many, diagnosis=True)
    assert not why_long(machine, many)
    few = Measurements.from_frame({"J0 [rad]": np.zeros(100)})
    long = replace(machine, joints=tuple(Joint(f"J{i}", "revolute", (0.0, 0.0, 1.0)) for i in range(20)))
    assert "the effects of 20 joints" in why_long(long, few, diagnosis=True)
    assert not why_long(long, few)


def test_many_columns_are_said_to_take_long_by_a_diagnosis_only() -> None:
    wide = Measurements.from_frame({f"c{i}": np.zeros(2) for i in range(2500)})
    machine = arm_with_targets(3, estimate=("target",))
    assert "each of 2500 columns" in why_long(machine, wide, diagnosis=True)
    assert not why_long(machine, wide)
