"""``rodgen tricept inverse``, ``direct`` and ``workspace``: tables in and out, held to the library."""

import csv
import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rodgen.cli import main as cli
from rodgen.kinematics import tricept
from rodgen.kinematics.tricept import LEG_LIMITS, PAPER, Geometry

POINTS = "id,Qx [mm],Qy [mm],Qz [mm]\np1,100,50,650\np2,0,0,500\np3,-30,80,700.5\np4,0,0,0\n"
RODS = "A0 [inch],A1 [inch],A-1 [inch],remark\n25,26,27,first\n7,7,7,none\n24.5,25,26.25,\n"


@pytest.fixture
def points(tmp_path):
    (tmp_path / "points.csv").write_text(POINTS)
    return str(tmp_path / "points.csv")


@pytest.fixture
def rods(tmp_path):
    (tmp_path / "rods.csv").write_text(RODS)
    return str(tmp_path / "rods.csv")


def run(capsys, *arguments):
    code = cli.main(["tricept", *arguments])
    out, err = capsys.readouterr()
    assert code == 0, err
    return list(csv.DictReader(io.StringIO(out))), err


def complaint(capsys, *arguments):
    assert cli.main(["tricept", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    return err


def numbers(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


def test_inverse_adds_the_pose_and_the_rods_of_every_point(points, capsys):
    rows, err = run(capsys, "inverse", points)
    assert err == f"{points}: 4 rows written: 2 reachable, 1 out_of_limits, 1 gimbal_lock\n"
    assert list(rows[0])[:4] == ["id", "Qx [mm]", "Qy [mm]", "Qz [mm]"]
    Q = numbers(rows, "Qx [mm]", "Qy [mm]", "Qz [mm]")
    poses, legs, status = tricept.inverse(Q, PAPER, LEG_LIMITS)
    found = numbers(rows, "alpha [deg]", "beta [deg]", "z [mm]")
    np.testing.assert_allclose(np.radians(found[:, :2]), poses[:, 0, :2], rtol=1e-14, atol=1e-16)
    np.testing.assert_array_equal(found[:, 2], poses[:, 0, 2])
    np.testing.assert_array_equal(numbers(rows, "A0 [mm]", "A1 [mm]", "A-1 [mm]"), legs[:, 0])
    names = [tricept.TriceptStatus(code).name.lower() for code in status[:, 0]]
    assert [row["status"] for row in rows] == names


def test_inverse_all_gives_four_rows_for_each_point(points, capsys):
    rows, _ = run(capsys, "inverse", points, "--all")
    assert [row["id"] for row in rows] == [f"p{n}" for n in (1, 2, 3, 4) for _ in range(4)]
    assert [(row["S"], row["K"]) for row in rows[:4]] == [("1", "1"), ("1", "-1"), ("-1", "1"), ("-1", "-1")]
    pose = numbers(rows, "alpha [deg]", "beta [deg]", "z [mm]")
    pose[:, :2] = np.radians(pose[:, :2])
    np.testing.assert_allclose(
        tricept.point(pose, PAPER), numbers(rows, "Qx [mm]", "Qy [mm]", "Qz [mm]"), atol=1e-9
    )


def test_direct_turns_inverse_round_in_any_unit_and_format(points, tmp_path, capsys):
    first, second = str(tmp_path / "rods.parquet"), str(tmp_path / "points.csv.gz")
    machine = ["--R", "0.33m", "--r", "14cm", "--q", "1,-2,30 mm", "--limits", "0.5,0.9m"]
    run(capsys, "inverse", points, "-o", first, *machine)
    table = pq.read_table(first)
    assert table.schema.field("A0 [mm]").type == pa.float64()
    legs = np.column_stack([table[f"A{n} [mm]"].to_numpy() / 1000 for n in ("0", "1", "-1")])
    good = np.isfinite(legs[:, 0])
    rows = [",".join(map(repr, row)) for row in legs[good].tolist()]
    text = "\n".join(["A0 [m],A1 [m],A-1 [m]", *rows, ""])
    (tmp_path / "rods.csv").write_text(text)
    rows, err = run(capsys, "direct", str(tmp_path / "rods.csv"), *machine)
    assert err.endswith("3 rows written: 3 reachable\n")
    Q = numbers(rows, "Qx [m]", "Qy [m]", "Qz [m]")
    wanted = np.column_stack([table[f"Q{n} [mm]"].to_pylist() for n in "xyz"]).astype(float) / 1000
    np.testing.assert_allclose(Q, wanted[good], atol=1e-12)
    run(capsys, "direct", str(tmp_path / "rods.csv"), *machine, "-o", second)


def test_direct_keeps_rods_without_a_pose_and_numbers_all_poses(rods, capsys):
    rows, err = run(capsys, "direct", rods)
    assert err.endswith("3 rows written: 2 reachable, 1 unreachable\n")
    assert [row["remark"] for row in rows] == ["first", "none", ""]
    assert rows[1]["z [inch]"] == "nan"
    many, _ = run(capsys, "direct", rods, "--all")
    assert [row["pose"] for row in many] == [*map(str, range(1, 9)), "0", *map(str, range(1, 9))]
    assert many[0]["z [inch]"][:12] == rows[0]["z [inch]"][:12]
    pose = numbers([row for row in many if row["pose"] != "0"], "alpha [deg]", "beta [deg]", "z [inch]")
    pose[:, :2] = np.radians(pose[:, :2])
    legs = tricept.legs(pose, Geometry(330 / 25.4, 140 / 25.4))
    given = numbers([row for row in many if row["pose"] != "0"], "A0 [inch]", "A1 [inch]", "A-1 [inch]")
    np.testing.assert_allclose(legs, given, rtol=1e-11)


@pytest.mark.thorough
def test_workspace_prints_what_the_library_finds(capsys):
    assert cli.main(["tricept", "workspace", "--samples", "10", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = tricept.workspace(PAPER, LEG_LIMITS, 10).to_dict()
    assert found == {"unit": "mm", **expected}
    assert (
        cli.main(
            [
                "tricept",
                "workspace",
                "--samples",
                "10",
                "--R",
                "13inch",
                "--r",
                "5.5inch",
                "--limits",
                "22,34inch",
            ]
        )
        == 0
    )
    text = capsys.readouterr().out
    assert "inch³" in text
    assert "det W33" in text


def test_workspace_writes_a_plane(tmp_path, capsys):
    path = tmp_path / "plane.parquet"
    assert cli.main(["tricept", "workspace", "--slice", "z=0.7m", "--points", "9", "-o", str(path)]) == 0
    assert "81 points" in capsys.readouterr().err
    table = pq.read_table(path)
    Q = np.column_stack([table[f"Q{n} [mm]"].to_numpy() for n in "xyz"])
    assert (Q[:, 2] == 700).all()
    inside = tricept.reachable(Q, PAPER, LEG_LIMITS)
    assert [s == "reachable" for s in table["status"].to_pylist()] == inside.tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["inverse", "POINTS", "--R", "330"], "'330' is not a length with its unit"),
        (["inverse", "POINTS", "--R=-330mm"], "expected a positive length"),
        (["inverse", "POINTS", "--R", "330deg"], "--R: unit 'deg', which is not a unit of length"),
        (["inverse", "POINTS", "--q", "1,2mm"], "is not 3 lengths"),
        (["inverse", "POINTS", "--limits", "858,568mm"], "the least length first"),
        (["inverse", "POINTS", "--limits", "nan,568mm"], "is not 2 lengths"),
        (["inverse", "nowhere.csv"], "nowhere.csv: file: no such file"),
        (["inverse", "RODS"], "no column 'Qx'"),
        (["direct", "POINTS"], "no column 'A0'"),
        (["direct", "RODS", "-o", "result.xlsx"], "a name that does not say what to write"),
        (["workspace", "--limits", "1,2mm"], "allow no pose; expected wider limits"),
        (["workspace", "--R", "300mm"], "expected lengths of a rod"),
        (["workspace", "-o", "x.csv"], "no --slice"),
        (["workspace", "--slice", "w=7mm"], "is not a plane"),
        (["workspace", "--samples", "1"], "not a whole number from 2"),
        (["workspace", "--machine", "nowhere.toml"], "nowhere.toml"),
        ([], "required: COMMAND"),
    ],
)
def test_faults_are_one_line_and_exit_code_2(points, rods, capsys, monkeypatch, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    given = [{"POINTS": points, "RODS": rods}.get(a, a) for a in arguments]
    assert words in complaint(capsys, *given)


def test_a_bad_cell_is_named(tmp_path, capsys):
    path = tmp_path / "bad.csv"
    path.write_text("Qx [mm],Qy [mm],Qz [mm]\n1,2,600\n1,x,600\n")
    assert "line 3, column 'Qy [mm]'" in complaint(capsys, "inverse", str(path))
