"""``rodgen apply``: functions of arrays on tables give what they give in Python."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rodgen
from rodgen import instantaneous_euler, screws, spatial, three_sps_s, tricept
from rodgen.cli.apply import _BY_ORDER, _FUNCTIONS, _PORTS, _Call, _columns_of
from rodgen.cli.main import main

PAPER = ["--set", "R=330mm", "--set", "r=14cm"]
PLATFORM = ["--set", "R=200mm", "--set", "r=120mm", "--set", "h=260mm"]


def write(path: Path, header: str, rows: Any) -> str:
    lines = [header, *(",".join(map(repr, row)) for row in np.asarray(rows, float).tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def applied(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[list[dict[str, str]], str]:
    assert main(["apply", *arguments]) == 0
    out, err = capsys.readouterr()
    return list(csv.DictReader(io.StringIO(out))), err


def numbers(rows: list[dict[str, str]], header: str) -> Any:
    return np.array([[float(row[name]) for name in header.split(",")] for row in rows])


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["apply", *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


@pytest.fixture
def points(tmp_path: Path) -> str:
    return write(tmp_path / "points.csv", "Qx [mm],Qy [mm],Qz [mm]", [[100, 50, 650], [0, 0, 500], [0, 0, 0]])


def sample(name: str, rng: np.random.Generator) -> tuple[str, Any]:
    """A table for a function: its header, and a few rows."""
    call = _Call(name)
    columns = []
    for key in call.taken:
        port = call.ports[key]
        size = len(_columns_of(port))
        drawn = rng.uniform(0.3, 0.6, (4, size))
        if port in ("matrix", "quaternion"):
            unit = drawn if port == "quaternion" else rng.normal(size=(4, 4))
            unit /= np.linalg.norm(unit, axis=1, keepdims=True)
            drawn = rodgen.matrix_from_quaternion(unit)[0].reshape(4, 9) if port == "matrix" else unit
        columns.append(drawn)
    header = ",".join(f"{n} [{u}]" if u else n for n, kind in call.columns
                      for u in [{"length": "m", "angle": "rad", "rate": "rad/s"}.get(kind, "")])  # fmt: skip
    return header, np.hstack(columns)


SET = {"R": "0.4m", "r": "0.2m", "h": "0.3m", "lengths": "0.4,0.5,0.45,0.15m", "limits": "0.1,0.9m",
       "near": "1,0,0,0,1,0,0,0,1", "start": "1,0,0,0,1,0,0,0,1"}  # fmt: skip


@pytest.mark.parametrize("name", [name for name in _FUNCTIONS if not name.endswith(".choose")])
def test_a_function_gives_what_it_gives_in_python(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header, rows = sample(name, np.random.default_rng(3))
    file = write(tmp_path / "t.csv", header, rows)
    call = _Call(name)
    settings = [f"{key}={SET[key]}" for key in call.needed]
    found, err = applied(capsys, name, file, *(word for each in settings for word in ("--set", each)))
    assert f"{file}: {len(found)} row" in err
    values, at = {}, 0
    for key in call.taken:
        size = len(_columns_of(call.ports[key]))
        part = rows[:, at : at + size]
        at += size
        values[key] = part[:, 0] if size == 1 else part.reshape(-1, 3, 3) if size == 9 else part
    for key in set(call.needed) - set(call.fields):
        value = np.array([float(x) for x in SET[key].rstrip("m").split(",")])
        values[key] = value.reshape(3, 3) if len(value) == 9 else value
    if call.fields:
        geometry = {key: float(SET[key].rstrip("m")) for key in call.needed if key in call.fields}
        values["geometry"] = call.subject.Geometry(**geometry)
    result = call.function(**values)
    parts = result if isinstance(result, tuple) else (result,)
    wanted = [
        (t, p) for t, p in zip(_FUNCTIONS[name].partition(" -> ")[2].split(), parts, strict=True) if t != "-"
    ]
    solutions = np.array([int(row.get("solution", 1)) for row in found])
    read = [f"given {column}" if f"given {column}" in found[0] else column for column in header.split(",")]
    given = numbers(found, ",".join(read))
    index = np.abs(given[:, None] - rows).max(axis=-1).argmin(axis=1)
    names = [column for column in found[0] if column not in (*read, "solution")]
    for token, part in wanted:
        flat = np.asarray(part)
        flat = flat[index, np.maximum(solutions - 1, 0)] if token[0] == "*" else flat[index]
        flat = flat.reshape(len(found), -1)
        for values_of_column in flat.T:
            column = names.pop(0)
            shown = [row[column] for row in found]
            if "Status" in token:
                status = getattr(call.subject, token.lstrip("*").partition("/")[0])
                assert shown == [status(int(code)).name.lower() for code in values_of_column]
            else:
                bare, _, unit = column.rstrip("]").partition(" [")
                number = np.array(shown, float) * {"deg": np.pi / 180, "deg/s": np.pi / 180}.get(unit, 1.0)
                np.testing.assert_allclose(number, values_of_column, rtol=1e-12, atol=1e-14, err_msg=bare)
    assert names == []


@pytest.mark.parametrize("name", [name for name in _FUNCTIONS if not name.endswith(".choose")])
def test_no_function_fails_at_a_row_without_a_result(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header, rows = sample(name, np.random.default_rng(3))
    lines = [f"{header},status", ",".join(["nan"] * rows.shape[1] + ["invalid"])]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    settings = (f"{key}={SET[key]}" for key in _Call(name).needed)
    (row,), err = applied(
        capsys, name, str(tmp_path / "t.csv"), *(word for each in settings for word in ("--set", each))
    )
    assert row.get("status", "invalid") == "invalid"
    assert "warning" not in err


def test_every_line_names_arguments_and_results_that_there_are() -> None:
    for name, line in _FUNCTIONS.items():
        given, _, results = line.partition(" -> ")
        ports = [each.partition("=")[2] or each for each in given.split()]
        tokens = [each.lstrip("*") for each in results.split()]
        assert set(ports) <= set(_PORTS), name
        assert all(t == "-" or t in _PORTS or "Status" in t for t in tokens), name
        columns = [c for t in tokens if t in _PORTS for c, _ in _columns_of(t)]
        assert len(columns) == len(set(columns)), name
    assert set(_BY_ORDER) <= set(_FUNCTIONS)
    used = {word.lstrip("*").rpartition("=")[2] for line in _FUNCTIONS.values() for word in line.split()}
    settable = {key for name in _FUNCTIONS for key in _Call(name).known}
    assert set(_PORTS) == (used | settable) & set(_PORTS)
    for subject in (instantaneous_euler, screws, spatial, three_sps_s, tricept):
        assert any(getattr(rodgen, name.split(".")[0]) is subject for name in _FUNCTIONS if "." in name)


def test_units_of_the_table_and_of_what_is_set_are_converted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path / "p.csv", "Qx [cm],Qy [mm],Qz [m]", [[10, 50, 0.65]])
    more = ["--set", "q=0,-2,30 mm", "--set", "limits=0.5,0.9m"]
    (row,), err = applied(capsys, "tricept.pose", file, *PAPER, *more)
    assert err == f"{file}: 1 row written: 1 reachable\n"
    machine = tricept.Geometry(33, 14, (0, -0.2, 3))
    pose, legs, _ = tricept.pose([10, 5, 65], machine, (50, 90))
    found = numbers([row], "alpha [deg],beta [deg],z [cm],A0 [cm],A1 [cm],A-1 [cm]")[0]
    np.testing.assert_allclose(found, [*np.degrees(pose[:2]), pose[2], *legs], rtol=1e-13)


def test_solutions_are_rows_and_a_row_without_one_stays(
    tmp_path: Path, points: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows, _ = applied(capsys, "tricept.inverse", points, *PAPER)
    assert [row["solution"] for row in rows[:4]] == ["1", "2", "3", "4"]
    file = write(tmp_path / "rods.csv", "A0 [inch],A1 [inch],A-1 [inch]", [[25, 26, 27], [1, 1, 90]])
    rows, _ = applied(capsys, "tricept.direct_all", file, *PAPER)
    assert [row["solution"] for row in rows] == [*map(str, range(1, 9)), "0"]
    assert rows[-1]["z [inch]"] == "nan"


def test_a_table_without_lengths_takes_the_unit_that_is_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path / "a.csv", "q0,qx,qy,qz", [[1, 0, 0, 0]])
    (row,), _ = applied(capsys, "three_sps_s.legs_from_quaternion", file, *PLATFORM)
    np.testing.assert_allclose(numbers([row], "L1 [mm],L2 [mm],L3 [mm]"), np.hypot(80, 260))


def test_the_page_does_the_same_with_pandas(
    points: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    page = (Path(__file__).parent.parent / "docs/guides/python.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n((?:(?!```).)*to_csv.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    with open("rods.csv", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    wanted, _ = applied(capsys, "tricept.pose", points, *PAPER)
    header = "A0 [mm],A1 [mm],A-1 [mm]"
    np.testing.assert_allclose(numbers(found, header), numbers(wanted, header), rtol=1e-12)
    assert [row["status"] for row in found] == [row["status"] for row in wanted]


def test_an_argument_with_a_default_can_be_a_column(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chi = instantaneous_euler.angles_from_quaternion([0.8, 0.3, 0.4, 0.33])[0]
    header = "chi_x [rad],chi_y [rad],chi_z [rad],Zr_x,Zr_y,Zr_z"
    file = write(tmp_path / "c.csv", header, [[*chi, 0.4, -0.3, 0]])
    (row,), _ = applied(capsys, "instantaneous_euler.choose", file, "--set", "z=column")
    choice = instantaneous_euler.choose(chi, z=[0.4, -0.3, 0])
    np.testing.assert_allclose(numbers([row], "q0,qx,qy,qz")[0], choice.quaternion, rtol=1e-12)
    (other,), _ = applied(capsys, "instantaneous_euler.choose", file, "--set", "z=0.4,-0.3,0")
    assert other["q0"] == row["q0"]


FAULTS = [
    (),
    ("solve_axis",),
    ("solve_axs", "POINTS"),
    ("--help", "foo"),
    ("solve_axis", "POINTS"),
    ("solve_axis", "nowhere.csv"),
    ("tricept.pose", "POINTS"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "S=1mm"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "R=1mm"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "R"),
    ("tricept.pose", "POINTS", *PAPER[2:], "--set", "R=3"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "q=1,2mm"),
    ("tricept.pose", "POINTS", *PAPER[2:], "--set", "R=3kg"),
    ("tricept.pose", "POINTS", *PAPER[2:], "--set", "R=-3m"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "limits=9,3m"),
    ("tricept.pose", "POINTS", *PAPER, "--set", "point=0,0,1m"),
    ("instantaneous_euler.angles_from_euler", "POINTS", "--set", "sequence=ZZZ"),
    ("tricept.pose", "POINTS", *PAPER, "-o", "x.xlsx"),
    ("tricept.pose", "POINTS", *PAPER, "-o", "POINTS"),
]  # fmt: skip


@pytest.mark.parametrize("arguments", FAULTS, ids=" ".join)
def test_bad_input_is_one_line_and_no_file(
    refuses_command, arguments: tuple[str, ...], points: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refuses_command("apply", *(points if a == "POINTS" else a for a in arguments))


def test_an_output_is_whole_or_stays_as_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, output = tmp_path / "p.csv", tmp_path / "out.csv"
    file.write_text("Qx [mm],Qy [mm],Qz [mm]\n1,2,600\n1,x,600\n")
    output.write_text("as it was")
    told = complaint(capsys, "tricept.pose", str(file), *PAPER, "-o", str(output))
    assert told == f"{file}: line 3, column 'Qy [mm]': 'x'; expected a number\n"
    assert output.read_text() == "as it was"


def test_list_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["apply", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(_FUNCTIONS)
    assert all(len(line.split()) > 3 for line in lines)
    texts = []
    for arguments in (["--help", "tricept.pose"], ["tricept.pose", "--help"], ["-h", "tricept.pose"]):
        assert main(["apply", *arguments]) == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1] == texts[2]
    assert texts[0].startswith(tricept.pose.__doc__.partition("\n")[0])
    assert "Columns that are read\n  Qx [mm],Qy [mm],Qz [mm]\n" in texts[0]
    assert "  alpha [deg],beta [deg],z [mm],A0 [mm],A1 [mm],A-1 [mm],status\n" in texts[0]
    assert "\n  limits=1mm,2mm\n" in texts[0]
    assert main(["apply", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: rodgen apply ")
