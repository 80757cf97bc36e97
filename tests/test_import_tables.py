"""``rodgen import`` of tables as other programs write them: the measurements are those of a table written by hand."""

from __future__ import annotations

import csv
import datetime
import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from rodgen.data.measurements import Measurements
from rodgen.data.tables.foreign import read_foreign
from rodgen.machines.files.read import column_source
from rodgen.machines.imports.files import import_files
from rodgen.machines.imports.tables import measurements_of
from rodgen.machines.machine import Machine
from rodgen.machines.mounts import ALTAZ, EQUATORIAL
from rodgen.machines.templates import machine_template

Run = Callable[..., tuple[int, str, str]]
UR10 = Path(__file__).parent / "data" / "ur10"
TURNTABLE = machine_template("turntable")

MESSY = """Tracker export, made by SuperTrack 4.2; do not edit
Operator: N. N.

Time;C-Achse;Ball;X meas;Y meas;Z meas;use;Temp;remark
;deg;;mm;mm;um;;;
2026-03-01T12:00:00;0,0;ball_1;150,001;0,002;30001,5;1;20,1;first
2026-03-01T12:00:30;-90,0;ball_1;0,003;150,0;30000;1;20,2;
2026-03-01T12:01:00;-90,0;ball_2;-130,0;-75,01;110000;0;20,2;bumped
2026-03-01T12:01:30;-90,0;ball_2;;-75,01;110000;1;20,2;lost
2026-03-01T12:02:00;-180,0;ball_2;75,002;-130,0;110000;1;20,3;
"""
COLUMNS = """
[columns]
C = "-C-Achse [deg]"
x = "X meas"
y = "Y meas"
z = { from = "Z meas", offset = -5 }
T_C = "Temp [degC]"
"""


def columns_of(machine: str, *files: Path, **options) -> tuple[dict, list[str]]:
    from rodgen.machines.files.read import machine_of

    stated = {name: column_source(text) for name, text in options.pop("stated", {}).items()}
    machine = machine_of(machine, "m.toml")
    return measurements_of(machine, list(map(str, files)), stated, **options)[:2]


def test_a_tracker_s_export_becomes_measurements(tmp_path, rodgen_command: Run):
    (tmp_path / "m.toml").write_text(TURNTABLE + COLUMNS)
    (tmp_path / "run.txt").write_text(MESSY)
    data = tmp_path / "d.csv"
    code, out, err = rodgen_command("import", tmp_path / "m.toml", tmp_path / "run.txt", "-d", data)
    assert err == ""
    assert code in (0, 1)  # so few rows may not tell
    assert data.read_text() == (
        "C [deg],x [mm],y [mm],z [um],T_C [degC],t [s],target\n"
        "0,150.001,0.002,29996.5,20.1,0,ball_1\n"
        "90,0.003,150,29995,20.2,30,ball_1\n"
        "180,75.002,-130,109995,20.3,120,ball_2\n"
    )
    for said in (
        "run.txt: text, semicolons between columns, decimal commas.",
        "Line 5 has the units.",
        "Above the header, and not read: 2 lines.",
        "C is -'C-Achse'.",
        "z is 'Z meas' -5.",
        "target is 'Ball'.",
        "t is 'Time'.",
        "Not taken: 'remark';",
        "Rows that are not to be used stay out: 1.",
        "Rows or targets with a blank cell stay out: 1.",
    ):
        assert said in out
    # the map changes nothing else
    (tmp_path / "plain.toml").write_text(TURNTABLE)
    stated = Machine.load(tmp_path / "m.toml")
    assert replace(stated, column_sources={}) == Machine.load(tmp_path / "plain.toml")


_SECOND, _AFTER = TURNTABLE.index('[[target]]\nname  = "ball_2"'), TURNTABLE.index("[measured]")
MACHINES = {"three": TURNTABLE, "one": TURNTABLE[:_SECOND] + TURNTABLE[_AFTER:]}
"""By the number of their targets."""


@pytest.mark.parametrize(
    ("machine", "header", "labels", "angles", "targets"),
    [
        ("three", "ball", "1 2 3", "0 0 0", "ball_1 ball_2 ball_3"),
        ("three", "Marker", "3 1 3 1", "0 0 9 9", "ball_3 ball_1 ball_3 ball_1"),
        ("three", "SMR", "7 5 11 7 5 11", "0 0 0 9 9 9", "ball_2 ball_1 ball_3 ball_2 ball_1 ball_3"),
        ("three", "target", "N E S N E S", "0 0 0 9 9 9", "ball_1 ball_2 ball_3 ball_1 ball_2 ball_3"),
        ("three", "Ball", "Ball 2;BALL-1", "0 9", "ball_2 ball_1"),
        ("three", "ball", "1 - 2", "0 0 0", "ball_1 ball_2"),
        ("one", "point", "P1 P2 P3", "0 9 18", None),
        ("one", "point", "1 1 2", "0 0 9", None),
        ("one", "target", "P1 P2 P3", "0 0 9", None),
        ("one", "reflector", "SMR SMR SMR", "0 0 9", "ball_1 ball_1 ball_1"),
        ("one", "ball", "A B A B", "0 9 18 27", None),
    ],
)
def test_labels_of_targets_are_known_and_those_of_poses_are_left(
    machine, header, labels, angles, targets, tmp_path
):
    labels = labels.split(";") if ";" in labels else labels.split()
    rows = [f"{label},{angle},1,2,3" for label, angle in zip(labels, angles.split(), strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([f"{header},C [deg],x [mm],y [mm],z [mm]", *rows]) + "\n")
    columns, notes = columns_of(MACHINES[machine], tmp_path / "t.csv")
    assert columns.get("target") == (targets and targets.split())
    start = f"target is '{header}'" if targets else f"Not taken: '{header}'"
    assert any(note.startswith(start) for note in notes)


@pytest.mark.parametrize(("machine", "labels"), [("three", "1 4 1 4"), ("one", "a b a b")])
def test_labels_of_no_targets_are_refused_where_they_stand(refuses, machine, labels, tmp_path):
    rows = [f"{label},{angle},1,2,3" for label, angle in zip(labels.split(), (0, 0, 9, 9), strict=True)]
    (tmp_path / "t.csv").write_text("\n".join(["ball,C [deg],x [mm],y [mm],z [mm]", *rows]) + "\n")
    refuses(columns_of, MACHINES[machine], tmp_path / "t.csv")


def test_messages_are_about_files_that_the_user_has(tmp_path, refuses_command):
    """A row that no machine can use is named in the table that it comes from, not in what would be written."""
    (tmp_path / "m.toml").write_text(TURNTABLE)
    (tmp_path / "t.csv").write_text("C,x,y,z,u_x [mm],target\n0,1,2,3,0.1,ball_1\n\n9,1,2,3,-0.1,ball_1\n")
    files = tmp_path / "m.toml", tmp_path / "t.csv", "-d", tmp_path / "d.csv"
    refuses_command("import", *files, "--units", "mm,deg")


WIDE = "C [deg]\tx1 [mm]\ty1 [mm]\tz1 [mm]\tx2 [mm]\ty2 [mm]\tz2 [mm]\tx3 [mm]\ty3 [mm]\tz3 [mm]\n"
WIDE += "0\t1\t2\t3\t4\t5\t6\t7\t8\t9\n45\t10\t20\t30\t\t\t\t70\t80\t90\n"


@pytest.mark.parametrize("names", ["numbers", "targets"])
def test_a_row_of_several_targets_becomes_rows(names, tmp_path):
    text = WIDE
    if names == "targets":
        for k in "123":
            for x in "xyz":
                text = text.replace(f"{x}{k} [", f"ball_{k}.{x.upper()} [")
    (tmp_path / "wide.tsv").write_text(text)
    columns, notes = columns_of(TURNTABLE, tmp_path / "wide.tsv")
    assert list(columns) == ["C [deg]", "x [mm]", "y [mm]", "z [mm]", "target"]
    assert columns["C [deg]"].tolist() == [0, 0, 0, 45, 45]
    assert columns["x [mm]"].tolist() == [1, 4, 7, 10, 70]
    assert columns["target"] == ["ball_1", "ball_2", "ball_3", "ball_1", "ball_3"]
    assert any(note.startswith("Readings of 3 targets in a row: ball_1 is ") for note in notes)


@pytest.mark.parametrize(
    ("coding", "said"), [("cp1252", "Windows-1252"), ("utf-16", "UTF-16"), ("utf-8-sig", "")]
)
def test_tables_are_read_as_windows_codes_them(coding, said, tmp_path):
    (tmp_path / "t.csv").write_bytes("Prüfling;C (°)\r\n1;2,5\r\n".encode(coding))
    table = read_foreign(tmp_path / "t.csv")
    assert [column.header for column in table.columns] == ["Prüfling", "C (°)"]
    assert said in table.notes[0]
    assert ("text in " in table.notes[0]) == bool(said)


@pytest.mark.parametrize(
    ("machine", "data", "hinted"),
    [
        ("m.toml", "t.csv", True),
        ("t.csv", "d.csv", True),
        ("m.toml", "none.csv", False),
        ("d.toml", "d.csv", False),
    ],
)
def test_files_of_other_programs_are_referred_to_the_import(
    machine, data, hinted, tmp_path, rodgen_command: Run
):
    (tmp_path / "m.toml").write_text(TURNTABLE)
    (tmp_path / "d.toml").write_text("[")
    (tmp_path / "t.csv").write_text("C;x;y;z\n1,5;2;3;4\n")
    (tmp_path / "d.csv").write_text("C [deg],x [mm],y [mm],z [mm]\n1,2,3,4\n")
    code, out, err = rodgen_command("check", tmp_path / machine, tmp_path / data)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.endswith("; 'rodgen import' reads files of other programs\n") == hinted


def test_a_quoted_cell_may_hold_ends_of_lines(refuses, tmp_path):
    """Excel writes them so; places of rows after it are those that an editor shows."""
    text = 'remark;"x\n[mm]";"C\r\n(deg)"\r\n"a\nb; ""c""";1,5;2\r\n\r\n"5"" ball";2,5;3\r\n5";x;4\r\n'
    (tmp_path / "t.csv").write_text(text, newline="")
    table = read_foreign(tmp_path / "t.csv")
    assert [(c.name, c.unit) for c in table.columns] == [("remark", ""), ("x", "mm"), ("C", "deg")]
    assert table.columns[0].cells == ('a\nb; "c"', '5" ball', '5"')
    assert table.places == ("line 4", "line 7", "line 8")
    refuses(table.numbers, table.columns[1])


def test_a_quotation_mark_without_a_second_is_named(refuses, tmp_path):
    for later in ("", '"second;4\n'):
        (tmp_path / "t.csv").write_text(f'remark;x [mm]\n;1\n"open;2\n;3\n{later}')
        refuses(read_foreign, tmp_path / "t.csv")


def test_balls_that_a_machinist_probed_become_measurements(tmp_path):
    """A wide table with decimal commas, whose columns are named in words: nothing has to be mapped."""
    (tmp_path / "balls.csv").write_text(
        "Nr;A-Achse;C axis;K1 X;K1 Y;K1 Z;K2 X;K2 Y;K2 Z\n1;-30,5;90;1,5;2;3;4;5;6,25\n"
    )
    columns, notes = columns_of(
        machine_template("table-table", balls=2), tmp_path / "balls.csv", units=("mm", "deg")
    )
    assert {name: list(values) for name, values in columns.items()} == {
        "A [deg]": [-30.5, -30.5],
        "C [deg]": [90, 90],
        "x [mm]": [1.5, 4],
        "y [mm]": [2, 5],
        "z [mm]": [3, 6.25],
        "target": ["ball_1", "ball_2"],
    }
    assert {"A is 'A-Achse'.", "C is 'C axis'."} <= set(notes)


def test_each_file_may_be_a_target_or_a_run(tmp_path):
    for k in (1, 2, 3):
        for name in (f"ball_{k}", f"day {k}"):
            target = ",target\n" if name.startswith("day") else "\n"
            end = ",ball_1\n" if name.startswith("day") else "\n"
            (tmp_path / f"{name}.csv").write_text(f"C,x,y,z{target}0,{k},2,3{end}90,{k},2,3{end}")
    files = [tmp_path / f"ball_{k}.csv" for k in (1, 2, 3)]
    columns, notes = columns_of(TURNTABLE, *files, units=("mm", "deg"))
    assert columns["target"] == ["ball_1", "ball_1", "ball_2", "ball_2", "ball_3", "ball_3"]
    assert "Each of the 3 files is a target, by its name." in notes
    columns, notes = columns_of(TURNTABLE, *[tmp_path / f"day {k}.csv" for k in (1, 2)], units=("mm", "deg"))
    assert columns["run"] == ["day 1", "day 1", "day 2", "day 2"]
    assert columns["x [mm]"].tolist() == [1, 1, 2, 2]


def test_a_workbook_and_a_matlab_file_give_what_text_gives(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    rows = [[0.0, 150.0, 0.5, 30.25], [90.0, -0.5, 150.0, 30.5]]
    book = openpyxl.Workbook()
    book.active.append(["Measured on Monday"])
    book.active.append(["C [deg]", "x (mm)", "y (mm)", "z (mm)", "time", "target"])
    for k, row in enumerate(rows):
        book.active.append([*row, datetime.datetime(2026, 3, 1, 12, k), "ball_1"])
    book.save(tmp_path / "a.xlsx")
    columns, notes = columns_of(TURNTABLE, tmp_path / "a.xlsx")
    expected = {
        "C [deg]": [0.0, 90.0],
        "x [mm]": [150.0, -0.5],
        "y [mm]": [0.5, 150.0],
        "z [mm]": [30.25, 30.5],
    }
    assert {name: columns[name].tolist() for name in expected} == expected
    assert columns["t [s]"].tolist() == [0, 60]
    assert "a.xlsx: workbook, sheet 'Sheet'." in notes
    table = np.array(rows)
    content = {"C": table[:, :1], "ball_1": table[:, 1:], "note": "text", "short": [1.0]}
    scipy.io.savemat(tmp_path / "a.mat", content)
    columns, notes = columns_of(MACHINES["one"], tmp_path / "a.mat", units=("mm", "deg"))
    assert {name: columns[name].tolist() for name in expected} == expected
    assert "a.mat: MATLAB arrays of 2 rows; of another shape, and not read: short." in notes


@pytest.mark.parametrize(
    ("kind", "mount", "header", "first"),
    [
        ("alt-azimuth", ALTAZ, "AZ [deg],EL [deg],az [deg],el [deg]", 1.0),
        ("alt-azimuth", ALTAZ, "AZ [deg],EL [deg],True Az [deg],Star Alt [deg]", 1.0),
        ("equatorial-fork", EQUATORIAL, "HA [deg],DEC [deg],ha [h],dec [deg]", 15.0),
    ],
)
def test_two_angles_are_a_direction(kind, mount, header, first, tmp_path):
    (tmp_path / "stars.csv").write_text(f"{header}\n10,20,2,21\n30,40,3,41\n")
    columns, notes = columns_of(machine_template(kind, latitude=0.7), tmp_path / "stars.csv")
    expected = mount.direction(*np.radians([[2 * first, 3 * first], [21, 41]]))
    np.testing.assert_allclose(np.stack([columns[x] for x in ("ux", "uy", "uz")], -1), expected, atol=1e-15)
    assert list(columns) == [*header.split(",")[:2], "ux", "uy", "uz"]
    assert any("are directions: " in note for note in notes)


@pytest.mark.thorough
def test_ur10_s_measurements_fit_its_urdf(tmp_path, rodgen_command: Run):
    machine, data = tmp_path / "m.toml", tmp_path / "d.csv"
    links = ("--base", "base_link", "--tip", "wrist_3_link")
    code, out, err = rodgen_command(
        "import", UR10 / "robot.urdf", UR10 / "calibration.csv", *links, "-o", machine, "-d", data
    )
    assert (code, err) == (0, "")
    assert "Not taken: 'phix1', 'phiy1' and 'phiz1'" in out
    assert "nothing looks wrong" in out
    # 2.0 mm in SOURCE.txt, of an independent fit with frame and target free
    assert Machine.load(machine).fit(Measurements.load(data)).rms == pytest.approx(2.0, abs=0.05)


def test_a_robot_gets_a_target_for_each_that_a_row_reads(tmp_path, rodgen_command: Run):
    """Three reflectors on a flange, in one row a pose: a URDF has one point there, and none of theirs."""
    machine, data, table = tmp_path / "m.toml", tmp_path / "d.csv", tmp_path / "t.csv"
    head, *rows = csv.reader((UR10 / "calibration.csv").read_text().splitlines())
    values = np.array(rows, float)
    # a point of the board a hand away; roll, pitch and yaw as URDF has them
    aside = Rotation.from_euler("xyz", values[:, 3:6]).apply([0.1, 0.0, 0.05])
    names = [*head[:3], "x2", "y2", "z2", *head[6:]]
    every = np.hstack([values[:, :3], values[:, :3] + aside, values[:, 6:]])
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([names, *every.tolist()])
    links = ("--base", "base_link", "--tip", "wrist_3_link")
    code, out, err = rodgen_command("import", UR10 / "robot.urdf", table, *links, "-o", machine, "-d", data)
    assert (code, err) == (0, "")
    assert "Readings of 2 targets in a row: wrist_3_link_1 is 'x1' 'y1' 'z1' and" in out
    assert [target.name for target in Machine.load(machine).targets] == ["wrist_3_link_1", "wrist_3_link_2"]
    assert Measurements.load(data).rows == 2 * len(rows)


def test_a_robot_gets_a_target_for_each_that_a_column_names(tmp_path, rodgen_command: Run):
    head, *rows = (UR10 / "calibration.csv").read_text().replace("x1,y1,z1", "x,y,z").splitlines()
    links, count = ("--base", "base_link", "--tip", "wrist_3_link"), len(rows)
    one, two = (f"wrist_3_link_SMR_{k}" for k in (1, 2))
    # labels that are in two rows each are those of poses; one that was written wrongly changes nothing of the others
    for labels, names in (
        (["SMR 1", "SMR 2"] * count, [one, two]),
        (["SMR 1", "SMR 2"] * (count // 2) + ["SMR 3"], [one, two, "wrist_3_link_SMR_3"]),
        ([str(k // 2) for k in range(count)], ["wrist_3_link"]),
    ):
        machine, data, table = (tmp_path / f"{len(names)}{end}" for end in (".toml", "_d.csv", ".csv"))
        table.write_text("\n".join([f"{head},marker", *map(",".join, zip(rows, labels, strict=False))]))
        code, _, err = rodgen_command("import", UR10 / "robot.urdf", table, *links, "-o", machine, "-d", data)
        assert (code, err) == (0, "")
        assert [target.name for target in Machine.load(machine).targets] == names
        assert Measurements.load(data).rows == count


def test_a_robot_has_one_target_where_its_place_is_named(tmp_path, rodgen_command: Run):
    """Forces and torques beside x, y, z are no targets, nor a second triple where columns say which one is read."""
    text = (UR10 / "calibration.csv").read_text()
    head, *rows = text.splitlines()
    other = head.replace("x1,y1,z1", "x,y,z").replace("phi", "").replace("x1,y1,z1", "f_x,f_y,f_z")
    tables = {
        "forces": (other + ",t_x,t_y,t_z", [row + ",0,0,1" for row in rows], ()),
        "stated": (
            head + ",x2,y2,z2",
            [row + ",0,0,1" for row in rows],
            [f"--column={x}={x}1" for x in "xyz"],
        ),
    }
    for name, (first, lines, options) in tables.items():
        machine, data, table = (tmp_path / f"{name}{end}" for end in (".toml", "_d.csv", ".csv"))
        table.write_text("\n".join([first, *lines]))
        links = ("--base", "base_link", "--tip", "wrist_3_link", *options)
        code, _, err = rodgen_command("import", UR10 / "robot.urdf", table, *links, "-o", machine, "-d", data)
        assert (code, err) == (0, ""), name
        assert [target.name for target in Machine.load(machine).targets] == ["wrist_3_link"]
        assert Measurements.load(data).rows == len(rows)


@pytest.mark.thorough
def test_ur10_s_attitudes_are_read_where_they_are_named(tmp_path, rodgen_command: Run):
    machine, data = tmp_path / "m.toml", tmp_path / "d.csv"
    named = [
        f"--column={name}=phi{axis}1" for name, axis in zip(("roll", "pitch", "yaw"), "xyz", strict=True)
    ]
    links = ("--base", "base_link", "--tip", "wrist_3_link")
    figure = tmp_path / "f.html"
    code, out, err = rodgen_command(
        "import", UR10 / "robot.urdf", UR10 / "calibration.csv", *links, *named, "-o", machine, "-d", data,
        "--plot", figure,
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "roll, pitch, yaw are attitudes: roll, pitch and yaw." in out
    assert "measured: pose in a free frame" in out
    assert figure.stat().st_size > 1e6
    fit = Machine.load(machine).fit(Measurements.load(data))
    turn = re.search(r"([\d.]+) mm of a coordinate and ([\d.]+) arcsec of a turn", fit.summary())
    # 2.0 mm in SOURCE.txt; angles between poses agree with the URDF to 0.007 rad, 1444 arcsec, there
    assert float(turn[1]) == pytest.approx(2.0, abs=0.1)
    assert float(turn[2]) < 1444


GOOD = "C [deg],x [mm],y [mm],z [mm],target\n0,150,0,30,ball_1\n90,0,150,30,ball_1\n"


@pytest.mark.parametrize(
    ("old", "new", "stated"),
    [
        ("C [deg]", "C", {}),
        ("C [deg]", "Table [deg]", {}),
        ("C [deg]", "C [mm]", {}),
        ("x [mm]", "q [mm]", {}),
        ("x [mm]", "q [mm]", {"x": "p"}),
        ("90,0,150", "9O,0,150", {}),
        ("90,0,150,30,ball_1", "90,0,150,30,ball_1,7", {}),
        (GOOD[GOOD.index(",target") :], ",who\n0,150,0,30,P1\n90,0,150,30,P2\n", {}),
        (GOOD[GOOD.index("0,150") :], "", {}),
        (GOOD[: GOOD.index("0,150")], "", {}),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(refuses, old, new, stated, tmp_path):
    (tmp_path / "t.csv").write_text(GOOD.replace(old, new))
    refuses(columns_of, TURNTABLE, tmp_path / "t.csv", stated=stated)


@pytest.mark.parametrize(
    "entry",
    ['C = { from = "A", sign = 2 }', 'C = { unit = "deg" }', "C = 3", 'C = { from = "A", factor = 2 }'],
)
def test_what_is_wrong_with_the_map_is_said_in_one_sentence(refuses, entry, tmp_path):
    (tmp_path / "m.toml").write_text(f"{TURNTABLE}\n[columns]\n{entry}\n")
    refuses(Machine.load, tmp_path / "m.toml")


@pytest.mark.parametrize(
    "words",
    [
        "t.csv -d d.csv",
        "m.toml t.csv",
        "m.toml t.csv -d d.csv -o o.toml",
        "m.toml m.toml -d d.csv",
        "m.toml t.csv -d d.csv --column C",
        "m.toml t.csv -d d.csv --units deg,mm",
        "m.toml t.csv -d t.csv",
    ],
)
def test_sources_that_do_not_go_together_are_refused(words, tmp_path, monkeypatch, refuses_command):
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text(TURNTABLE)
    Path("t.csv").write_text(GOOD)
    refuses_command("import", *words.split())


@pytest.mark.parametrize(("name", "content"), [("a.xlsx", b"no zip"), ("a.mat", b"no matlab" * 30)])
def test_a_damaged_file_is_named(refuses, name, content, tmp_path):
    if name.endswith("xlsx"):
        pytest.importorskip("openpyxl")
    (tmp_path / name).write_bytes(content)
    refuses(read_foreign, tmp_path / name)


# as the software of instruments writes them ------------------------------------------------------------


def test_commands_and_readings_may_be_in_two_files(refuses, tmp_path):
    """The robot's program has the angles, the tracker the points, by names, and one of them was lost."""
    (tmp_path / "program.csv").write_text("Point Name;C [deg]\nball_3;30\nball_2;90\nball_1;0\n")
    (tmp_path / "sa.csv").write_text(
        "// Exported from SpatialAnalyzer; do not edit\nPoint Name,X,Y,Z,Time\n"
        "ball_1,150.001,0.002,30,23:59:30\nball_2,-130.0,-75.0,110,00:00:10.5\n"
    )
    columns, notes = columns_of(TURNTABLE, tmp_path / "program.csv", tmp_path / "sa.csv", units=("mm", "deg"))
    assert {name: list(values) for name, values in columns.items()} == {
        "C [deg]": [0, 90],
        "x [mm]": [150.001, -130],
        "y [mm]": [0.002, -75],
        "z [mm]": [30, 110],
        "t [s]": [0, 40.5],
        "target": ["ball_1", "ball_2"],
    }
    assert "Rows of program.csv, with the commands, belong to those of sa.csv by 'Point Name'." in notes
    assert "target is 'Point Name', which has names of targets." in notes
    (tmp_path / "program.csv").write_text("No;C [deg]\n1;30\n2;90\n")
    columns, notes = columns_of(TURNTABLE, tmp_path / "sa.csv", tmp_path / "program.csv", units=("mm", "deg"))
    assert columns["C [deg]"].tolist() == [30, 90]
    assert any(note.endswith("belong to those of sa.csv in their order.") for note in notes)
    (tmp_path / "program.csv").write_text("No;C [deg]\n1;30\n2;90\n3;0\n")
    refuses(columns_of, TURNTABLE, tmp_path / "program.csv", tmp_path / "sa.csv")


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (("01.03.2026 12:00:00", "02.03.2026 12:00:30"), [0, 86430]),
        (("12:00:00", "12:00:30.5"), [0, 30.5]),
        (("3/1/2026 12:00 PM", "3/1/2026 12:01 PM"), None),
    ],
)
def test_times_are_read_where_they_have_one_meaning(refuses, cells, seconds, tmp_path):
    lines = [f"{cell}\t{k}\tball_1\t1\t2\t3" for k, cell in enumerate(cells)]
    (tmp_path / "t.txt").write_text(
        "\n".join(["Date Time\tC [deg]\tID\tx [mm]\ty [mm]\tz [mm]", *lines]) + "\n"
    )
    columns, notes = columns_of(TURNTABLE, tmp_path / "t.txt")
    assert ("t [s]" in columns) == (seconds is not None)
    if seconds is not None:
        assert columns["t [s]"].tolist() == seconds
    else:
        assert (
            "'Date Time' is no time: '3/1/2026 12:00 PM'; expected a time such as 2026-03-01T12:30:00."
            in notes
        )
        refuses(columns_of, TURNTABLE, tmp_path / "t.txt", stated={"t": "Date Time"})


@pytest.mark.parametrize("cell", ["1e400", "-inf", "2,5,1"])
def test_a_cell_that_is_no_finite_number_is_named(refuses, cell, tmp_path):
    (tmp_path / "t.csv").write_text(
        f"C [deg];target;x [mm];y [mm];z [mm]\n0;ball_1;1;2;3\n0;ball_1;1;{cell};3\n"
    )
    refuses(columns_of, TURNTABLE, tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("kind", "header", "names"),
    [
        ("angle", "C;angle", ["C [deg]", "angle [deg]"]),
        ("orientation", "C;roll;pitch;yaw", ["C [deg]", "roll [deg]", "pitch [deg]", "yaw [deg]"]),
    ],
)
def test_turns_alone_are_readings(kind, header, names, tmp_path):
    machine = re.sub('kind *= "point"', f'kind = "{kind}"\nabout = [0, 0, 1]', TURNTABLE)
    machine = machine if kind == "angle" else machine.replace("about = [0, 0, 1]", "")
    machine = re.sub(r"(?s)(\[\[target\]\]\nname  = \"ball_2.*?)\[measured\]", "[measured]", machine)
    machine = machine.replace("point = [150, 0, 30]", "").replace('"C.point", ', "")
    width = header.count(";")
    (tmp_path / "t.csv").write_text(f"{header}\n0{';0,5' * width}\n90{';90,5' * width}\n")
    columns, _ = columns_of(machine, tmp_path / "t.csv", units=("mm", "deg"))
    assert list(columns) == names
    assert columns[names[-1]].tolist() == [0.5, 90.5]


# files that take more than they show ---------------------------------------------------------------------

SHEET = "xl/worksheets/sheet1.xml"


def changed_sheet(path, more):
    """Write a workbook with more text at the end of its first sheet's rows."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["C [deg]", "x [mm]"])
    book.active.append([1.0, 2.0])
    plain = io.BytesIO()
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(
                name, text.replace(b"</sheetData>", more + b"</sheetData>") if name == SHEET else text
            )


BOMBS = {
    "packed": b" " * 101_000_000,
    "a row far off": b'<row r="999999999999"><c r="A1"><v>1</v></c></row>',
    "cells far off": b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (n, n) for n in range(3, 900)),
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [*(pytest.param(name, marks=pytest.mark.slow) for name in ("packed", "a row far off")), "cells far off"],
)
def test_a_small_workbook_takes_no_gigabytes(refuses, name, tmp_path):
    changed_sheet(tmp_path / "a.xlsx", BOMBS[name])
    assert (tmp_path / "a.xlsx").stat().st_size < 1_000_000
    refuses(read_foreign, tmp_path / "a.xlsx")


@pytest.mark.parametrize("ending", ["xlsx", "mat"])
def test_a_table_without_an_end_is_not_read_to_it(refuses, ending, tmp_path):
    if ending == "xlsx":
        pytest.importorskip("openpyxl")
    (tmp_path / f"a.{ending}").symlink_to("/dev/zero")
    refuses(read_foreign, tmp_path / f"a.{ending}")


def matlab(rows, columns, payload):
    """Return a MATLAB file with one packed array of numbers, whatever its size says."""
    body = struct.pack("<4I2I2i", 6, 8, 6, 0, 5, 8, rows, columns) + struct.pack("<2I8s", 1, 1, b"C")
    body += struct.pack("<2I", 9, len(payload)) + payload
    packed = zlib.compress(struct.pack("<2I", 14, len(body)) + body)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM"
    return head + struct.pack("<2I", 15, len(packed)) + packed


@pytest.mark.parametrize("turned", [(), ("q",), ("p",), ("q", "p"), ("t",), ("t", "q", "p")])
def test_points_may_be_rows_or_columns_of_a_matlab_matrix(turned, tmp_path):
    """The number of readings is the size that the arrays have in common, however each of them lies."""
    numbers = np.random.default_rng(1)
    content = {"t": numbers.random((5, 1)), "q": numbers.random((5, 6)), "p": numbers.random((5, 3))}
    scipy.io.savemat(tmp_path / "a.mat", {n: x.T if n in turned else x for n, x in content.items()})
    table = read_foreign(tmp_path / "a.mat")
    assert [c.name for c in table.columns] == ["t", *(f"q_{k}" for k in range(1, 7)), "p_x", "p_y", "p_z"]
    np.testing.assert_array_equal([c.cells for c in table.columns], np.hstack([*content.values()]).T)
    matrices = [name for name in turned if name != "t"]
    assert (f", which are columns of {' and '.join(matrices)}" in table.notes[0]) == bool(matrices)


def test_single_numbers_are_no_rows_of_a_matlab_file(tmp_path):
    content = {"q": np.ones((6, 9)), "p": np.ones((3, 9)), "pose": np.ones((4, 4, 9))}
    scipy.io.savemat(tmp_path / "a.mat", content | dict.fromkeys("abc", 1.0))
    table = read_foreign(tmp_path / "a.mat")
    assert [len(column.cells) for column in table.columns] == [9] * 9
    assert table.notes[0].endswith("; of another shape, and not read: pose, a, b and c.")


NUMBERED = "pose,q1 [deg],q2 [deg],x [mm],y [mm],z [mm]\n1,10,20,1,2,3\n2,30,40,4,5,6\n"


@pytest.mark.thorough
def test_numbered_columns_are_the_joints_in_their_order(tmp_path, rodgen_command: Run, refuses_command):
    joint = '[[joint]]\nname = "A"\ntype = "revolute"\naxis = [1, 0, 0]\n\n[[target]]'
    (tmp_path / "m.toml").write_text(MACHINES["one"].replace("[[target]]", joint, 1))
    (tmp_path / "t.csv").write_text(f"a remark\n{NUMBERED}")
    files = ("import", tmp_path / "m.toml", tmp_path / "t.csv", "-d", tmp_path / "d.csv")
    refuses_command(*files)
    _, _, err = rodgen_command(*files, "--joints", "q1")
    assert err == ""
    data = Measurements.load(tmp_path / "d.csv")
    assert [data.columns[name].values.tolist() for name in ("C", "A")] == [[10, 30], [20, 40]]
    for first in ("q2", "q"):
        refuses_command(*files, "--joints", first)


@pytest.mark.parametrize(
    "wrong",
    [
        {"azimuth": "South"},
        {"estimate": "Geometry"},
        {"convention": "dh"},
        {"format": 9},
        {"format": "2"},
        {"latitude": 0.0},
        {"joints": 1},
        {"units": ("mm", "deg")},
        {"columns": "AZ=A"},
        {"columns": {"AZ": 1}},
        {"sources": 5},
        {"sources": ["m.toml", None]},
    ],
    ids=str,
)
def test_an_argument_of_another_type_or_value_is_refused(refuses, wrong):
    refuses(import_files, **{"sources": "m.toml", **wrong})


def test_one_file_needs_no_list():
    path = UR10 / "robot.urdf"
    for sources in (path, str(path), [path]):
        assert import_files(sources, tip="tool0").machine.name


def test_a_matlab_matrix_alone_has_more_readings_than_columns(refuses, tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"p": np.arange(12.0).reshape(3, 4)})
    columns = {c.name: c.cells for c in read_foreign(tmp_path / "a.mat").columns}
    assert columns == {"p_x": (0, 1, 2, 3), "p_y": (4, 5, 6, 7), "p_z": (8, 9, 10, 11)}
    scipy.io.savemat(tmp_path / "a.mat", {"t": np.ones(2), "q": np.ones((2, 30_000)), "u": np.ones(2)})
    refuses(read_foreign, tmp_path / "a.mat")


@pytest.mark.parametrize(
    "array",
    [pytest.param((1, 13_000_000, bytes(104_000_000)), marks=pytest.mark.slow), (0, 2_000_000_000, b"")],
)
def test_a_small_matlab_file_takes_no_gigabytes(refuses, array, tmp_path):
    (tmp_path / "a.mat").write_bytes(matlab(*array))
    refuses(read_foreign, tmp_path / "a.mat")
