"""What a machine file says of other people's columns is still there in every file that is written from it."""

from __future__ import annotations

from pathlib import Path

import pytest

from rodgen.cli.main import main
from rodgen.machines.files.read import ColumnSource
from rodgen.machines.machine import Machine

TABLE = Path(__file__).resolve().parents[1] / "examples" / "machines" / "rotary_table"
COLUMNS = """
[columns]
C = "-C-Achse [deg] + 90"
x = { from = "X [meas]", unit = "mm" }
"T C" = { from = "Temp", offset = -5e-3 }
"""
SOURCES = {
    "C": ColumnSource("C-Achse", "deg", -1.0, 90.0),
    "x": ColumnSource("X [meas]", "mm"),
    "T C": ColumnSource("Temp", offset=-5e-3),
}


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text((TABLE / "machine.toml").read_text() + COLUMNS)
    return str(TABLE / "data.csv")


@pytest.mark.thorough(
    "add m.toml backlash --joint C -o new.toml",
    "remove more.toml backlash --joint C -o new.toml",
    "set m.toml C.axis.a --prior 0\\xb120arcsec -o new.toml",
)
@pytest.mark.parametrize(
    "words",
    [
        "fit m.toml DATA -o new.toml",
        "diagnose m.toml DATA -o new.toml",
        "add m.toml backlash --joint C -o new.toml",
        "remove more.toml backlash --joint C -o new.toml",
        "exclude m.toml DATA --rows 12 -o new.toml",
        "set m.toml C.axis.a --prior 0±20arcsec -o new.toml",
    ],
)
def test_every_command_keeps_the_columns(words: str, data: str, capsys: pytest.CaptureFixture[str]) -> None:
    if words.startswith("remove"):
        main("add m.toml backlash --joint C -o more.toml".split())
    main([data if word == "DATA" else word for word in words.split()])
    assert Machine.load("new.toml").column_sources == SOURCES, capsys.readouterr()


def test_a_saved_machine_keeps_the_columns(data: str) -> None:
    machine = Machine.load("m.toml")
    machine.save("new.toml")
    assert Machine.load("new.toml") == machine
    machine.save("fixed.toml", fixed=True)
    assert Machine.load("fixed.toml").column_sources == SOURCES
