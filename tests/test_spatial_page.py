"""The page on spatial mechanisms: its code runs, and gives what it says."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from rodgen.cli import main as cli
from rodgen.kinematics import spatial

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs/mechanisms/spatial_mechanisms.md").read_text(encoding="utf-8")


def test_code_runs_and_gives_problem_6_2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(block, names)
    assert names["found"].status.tolist() == [spatial.ReverseStatus.REGULAR] * 8
    told = re.search(r"# ([-\d., ]+); ([-\d., ]+): problem 6.2", PAGE)
    expected = [[float(x) for x in row.split(",")] for row in told.groups()]
    np.testing.assert_allclose(np.degrees(names["ways"].solutions[:, [1, 3, 5]]), expected, atol=6e-5)


def test_every_status_is_explained() -> None:
    rows = re.findall(r"^\| ([A-Z_]+) \|", PAGE, re.MULTILINE)
    assert rows == [status.name for status in spatial.ReverseStatus]


def test_link_table_of_the_page_is_one(tmp_path: Path) -> None:
    lines = re.search(r"((?:    .*\n)+)", PAGE[PAGE.index("As a table") :])[1]
    path = tmp_path / "arm.csv"
    path.write_text("\n".join(line.strip() for line in lines.splitlines()))
    found = spatial.load_mechanism(path)
    assert (found.joints, found.names) == (("R", "P", "R"), ("base", "slide", "tool"))


def test_commands_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = re.findall(r"^    rodgen (mechanism .*)$", PAGE, re.MULTILINE)
    assert {command.split()[1] for command in commands} == {"forward", "reverse"}
    for name, example in {"arm.csv": "ge_p60.csv", "rccc.csv": "rccc.csv"}.items():
        shutil.copy(ROOT / "examples/mechanisms" / example, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    Path("joints.csv").write_text(",".join(f"R{j} [deg]" for j in range(1, 7)) + "\n10,20,30,40,50,60\n")
    Path("inputs.csv").write_text("R1 [deg]\n75\n")
    assert cli.main("mechanism forward ge_p60 joints.csv --tool 2,3,5cm -o poses.parquet".split()) == 0
    for command in commands:
        assert cli.main(command.split()) == 0, capsys.readouterr().err
        made = re.search(r"(?:-o|--svg) (\S+)", command)
        assert made is None or Path(made[1]).stat().st_size > 0
