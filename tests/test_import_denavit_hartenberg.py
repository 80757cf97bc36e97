"""``rodgen import`` of Denavit-Hartenberg tables, against the product of plain matrices; also of the page's."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rodgen.machines.imports.denavit_hartenberg import machine_from_table
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism

Run = Callable[..., tuple[int, str, str]]
PAGE = (Path(__file__).parent.parent / "docs/guides/import_robots.md").read_text(encoding="utf-8")
UR, KUKA = re.findall(r"```text\n(joint.*?)```", PAGE, re.DOTALL)[:2]
MITSUBISHI = re.search(r"```toml\n(name = \"RV.*?)```", PAGE, re.DOTALL)[1]
SLIDING = """type,theta [rad],d [m],a [inch],alpha [deg]
R,0.3,0.2,4,90
P,1.2,0.1,2,-60
R,-0.4,0.05,-3,20
"""
RNG = np.random.default_rng(4)


def product(rows, q, modified):
    """Multiply the matrices of the rows: theta, d, a, alpha, sign, whether it slides."""
    T = np.eye(4)
    for (theta, d, a, alpha, sign, slides), value in zip(rows, q, strict=True):
        theta, d = (theta, d + sign * value) if slides else (theta + sign * value, d)
        (ct, st), (ca, sa) = ((np.cos(x), np.sin(x)) for x in (theta, alpha))
        joint = np.array([[ct, -st, 0, 0], [st, ct, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
        link = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        T = T @ (link @ joint if modified else joint @ link)
    return T


def rows_of(text):
    if "convention" in text:
        joints = tomllib.loads(text)["joint"]
        return [
            (
                *np.radians([j.get("theta", 0)]),
                j.get("d", 0),
                j.get("a", 0),
                np.radians(j.get("alpha", 0)),
                1,
                False,
            )
            for j in joints
        ]
    header, *lines = [line.split(",") for line in text.strip().splitlines()]
    sizes = {"deg": np.pi / 180, "rad": 1, "mm": 1, "m": 1000, "inch": 25.4}
    found = []
    for line in lines:
        row = {}
        for name, cell in zip(header, line, strict=True):
            key, _, unit = name.partition(" [")
            row[key] = float(cell) * sizes[unit[:-1]] if unit else cell
        numbers = [row[key] for key in ("theta", "d", "a", "alpha")]
        found.append((*numbers, float(row.get("sign", 1)), row.get("type") == "P"))
    return found


def seen(machine, q):
    return (to_mechanism(machine).forward(q) @ [*machine.targets[0].point, 1.0])[:3]


@pytest.mark.parametrize("modified", [False, True])
@pytest.mark.parametrize("text", [UR, KUKA, SLIDING], ids=["UR", "KUKA", "sliding"])
def test_a_table_is_the_product_of_its_matrices(text, modified, tmp_path):
    (tmp_path / "t.csv").write_text(text)
    machine = machine_from_table(tmp_path / "t.csv", "modified" if modified else "standard").machine
    size = {"mm": 1.0, "inch": 25.4}[machine.length_unit]
    rows = rows_of(text)
    for _ in range(5):
        q = RNG.uniform(-3, 3, len(rows))
        expected = product(rows, q * [size if row[-1] else 1 for row in rows], modified)[:3, 3]
        assert size * seen(machine, q) == pytest.approx(expected, abs=1e-9)


def test_a_table_in_toml_has_a_tool_and_travels(tmp_path):
    (tmp_path / "t.toml").write_text(MITSUBISHI)
    machine = machine_from_table(tmp_path / "t.toml").machine
    assert machine.name == "RV robot"
    assert machine.joints[0].travel == pytest.approx((-240 * np.pi / 180, 240 * np.pi / 180))
    q = RNG.uniform(-3, 3, 6)
    expected = product(rows_of(MITSUBISHI), q, modified=True) @ [0, 0, 120, 1]
    assert seen(machine, q) == pytest.approx(expected[:3], abs=1e-9)


def test_the_command_says_what_was_taken_for_what(tmp_path, rodgen_command: Run):
    (tmp_path / "kuka.csv").write_text(KUKA)
    output = tmp_path / "m.toml"
    code, out, err = rodgen_command("import", tmp_path / "kuka.csv", "-o", output)
    assert (code, err) == (0, "")
    assert "It is standard, as a and alpha of the last row are 0; --convention says otherwise." in out
    assert (
        "kuka.csv: a standard Denavit-Hartenberg table of 6 joints, a row is Rz(theta) Tz(d) Tx(a) Rx(alpha)"
        in out
    )
    assert "Turned the other way (sign -1): A1, A4 and A6." in out
    machine = Machine.load(output)
    assert [joint.name for joint in machine.joints] == ["A1", "A2", "A3", "A4", "A5", "A6"]
    assert machine.joints[0].axis == (0, 0, -1)
    assert machine.joints[1].travel == pytest.approx(np.radians([-190, 45]))
    # upper arm upright, forearm level: 25 + 420 + 80 out, 400 + 455 + 35 high; A1 turns clockwise, A5 downwards
    assert seen(machine, np.radians([0, -90, 90, 0, 0, 0])) == pytest.approx([525, 0, 890], abs=1e-9)
    assert seen(machine, np.radians([10, -90, 90, 0, 0, 0]))[1] < 0
    assert seen(machine, np.radians([0, -90, 90, 0, 30, 0]))[2] < 890


CRAIG = "theta [deg],d [mm],a [mm],alpha [deg]\n0,400,0,0\n0,0,25,-90\n0,0,455,0\n"
"""Of an arm of three joints: its first two axes meet at right angles, the others are parallel."""


@pytest.mark.parametrize(
    ("text", "convention"),
    [
        (CRAIG, "modified"),
        (CRAIG.replace(",0,0\n", ",25,-90\n", 1).replace("0,0,25,-90", "0,0,455,0", 1)[:-1] + "\n", None),
        (CRAIG.replace(",400,0,0", ",400,25,-90").replace("\n0,0,455,0\n", "\n0,90,0,0\n"), "standard"),
        (CRAIG + "0,90,0,0\n", None),
    ],
)
def test_a_table_tells_its_convention_by_the_end_without_a_link(refuses, text, convention, tmp_path):
    (tmp_path / "t.csv").write_text(text)
    if convention is None:
        refuses(machine_from_table, tmp_path / "t.csv")
        return
    imported = machine_from_table(tmp_path / "t.csv")
    assert imported.machine.joints == machine_from_table(tmp_path / "t.csv", convention).machine.joints
    assert not any("about one and the same axis" in note for note in imported.notes)
    # the other reading, which needs the option, has two joints on one axis
    (other,) = {"standard", "modified"} - {convention}
    notes = machine_from_table(tmp_path / "t.csv", other).notes
    assert any("about one and the same axis" in note for note in notes)


def test_a_rough_geometry_is_estimated_but_for_the_first_joint(tmp_path, rodgen_command: Run):
    (tmp_path / "kuka.csv").write_text(KUKA)
    output = tmp_path / "m.toml"
    options = ("--convention", "standard", "--estimate", "geometry", "-o", output)
    code, out, _ = rodgen_command("import", tmp_path / "kuka.csv", *options)
    assert code == 0
    assert "all joints but the first, A1, are estimated" in out
    estimate = Machine.load(output).estimate
    assert {f"A{n}.{part}" for n in range(2, 7) for part in ("axis", "point")} <= set(estimate)
    assert not any(name.startswith("A1.") for name in estimate)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("d [mm]", "d [deg]"),
        ("d [mm]", "d"),
        ("A2,1,0", "A2,2,0"),
        ("low [deg]", "lowest [deg]"),
        ("-190,45", "45,-190"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(refuses, old, new, tmp_path):
    assert old in KUKA
    (tmp_path / "t.csv").write_text(KUKA.replace(old, new))
    refuses(machine_from_table, tmp_path / "t.csv", "standard")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("a = 230", "a = '230'"),
        ('"modified"', '"craig"'),
        ("d = 295", "d = 295\nsign = 0"),
        ("theta = -90", "gamma = -90"),
        ('"deg"', '"mm"'),
    ],
)
def test_what_is_wrong_in_toml_is_said_in_one_sentence(refuses, old, new, tmp_path):
    assert old in MITSUBISHI
    (tmp_path / "t.toml").write_text(MITSUBISHI.replace(old, new, 1))
    refuses(machine_from_table, tmp_path / "t.toml")
