"""Every command on every example of a machine where a size is as small as it can be: an answer or one sentence.

Kernels run on NumPy, which compiles none: a machine of each kind of reading, and all commands on one of them.
`make test-slow` compiles them, and has all machines with all commands.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rodgen.cli._console import BAD_INPUT, FAILED, NOT_CONVERGED, OK
from rodgen.cli.main import _parser
from rodgen.machines.machine import Machine

EXAMPLES = sorted(
    path.parent for path in (Path(__file__).parent.parent / "examples" / "machines").glob("*/machine.toml")
)
QUICK = "gantry_rotary"
"""The example on which every command is quick, but for those of many rows."""
FEW = {QUICK, "mount", "ballbar_gantry", "tricept"}
"""Points, directions, distances, and legs that close."""

COMMANDS = {
    "check": ["check M D"],
    "fit": ["fit M D -o OUT.toml --residuals OUT.csv"],
    "compare": ["compare M D"],
    "diagnose": ["diagnose M D -o OUT.toml"],
    "plan": ["plan M D -n 3 -o OUT.csv"],
    "predict": ["predict M D D -o OUT.csv", "predict M MEASURED D -o OUT.csv"],
    "report": ["report M D -o OUT.html"],
    "fleet": ["fleet M FOLDER -o OUT --scheduler threads=1"],
    "watch": ["watch M D --reference D", "watch M D --learn 20"],
    "add": ["add M EFFECT D --joint JOINT -o OUT.toml"],
    "remove": ["remove WITH EFFECT D --joint JOINT -o OUT.toml"],
    "set": ["set WITH JOINT.EFFECT.a --bounds=-inf,inf -o OUT.toml"],
    "exclude": ["exclude M D --rows 2 -o OUT.toml", "exclude --undo M D --all -o OUT.toml"],
    "emit": ["emit M D --lang numpy -o OUT", "emit M D --lang iso230 -o OUT"],
    "simulate": ["simulate M D --effect EFFECT@JOINT -o OUT.csv --truth OUT.json"],
}
NOT_CALLED = {"open"}
"""It serves, until it is ended, what the other commands make."""
LONG = {"diagnose", "plan", "report", "fleet", "watch", "emit"}
"""Commands that look at every effect of the catalogue or derive code, which takes seconds."""


class Example(NamedTuple):
    """An example, as its files have it."""

    machine: str
    columns: list[str]
    rows: list[list[str]]

    @classmethod
    def of(cls, folder: Path) -> Example:
        (data,) = folder.glob("*.csv")
        columns, *rows = csv.reader(data.read_text().splitlines())
        return cls((folder / "machine.toml").read_text(), columns, rows)

    @property
    def names(self) -> list[str]:
        return [column.split(" [")[0] for column in self.columns]

    @property
    def without_estimate(self) -> str:
        return re.sub(r"(?ms)^\[estimate\].*?(?=^\[|\Z)", "", self.machine)

    def alike(self, names: Sequence[str]) -> list[list[str]]:
        """Return the rows that are as the first one in some columns."""
        at = [self.names.index(name) for name in names]
        return [row for row in self.rows if all(row[k] == self.rows[0][k] for k in at)]

    @property
    def one_pose(self) -> list[list[str]]:
        """The readings of the first pose; where there is one, it is read twice more."""
        further = {"target", "run", "load", "t", "d", *("x", "y", "z"), *("ux", "uy", "uz")}
        same = self.alike(
            [name for name in self.names if name not in further and not re.match("[uT]_", name)]
        )
        return same if len(same) > 1 else same * 3


SIZES: dict[str, Callable[[Example], tuple[str, list[list[str]]]]] = {
    "nothing to estimate": lambda e: (e.without_estimate, e.rows[:24]),
    "no row": lambda e: (e.machine, []),
    "one row": lambda e: (e.machine, e.rows[:1]),
    "one row, nothing to estimate": lambda e: (e.without_estimate, e.rows[:1]),
    "one pose": lambda e: (e.machine, e.one_pose),
    "one target": lambda e: (e.machine, e.alike(["target"])[:30]),
}
CASES = [
    pytest.param(folder, size, id=f"{folder.name}, {size}")
    for folder in EXAMPLES
    for size in SIZES
    if size != "one target" or "target" in Example.of(folder).names
]


def written(path: Path, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([columns, *rows])
    return path


def called(folder: Path, size: str, tmp_path: Path, rodgen_command, commands: Sequence[str]) -> None:
    """Call commands; each answers, or refuses in one sentence and writes nothing."""
    example = Example.of(folder)
    machine, rows = SIZES[size](example)
    given, out = tmp_path / "given", tmp_path / "out"
    (given / "folder").mkdir(parents=True)
    (given / "m.toml").write_text(machine)
    data = written(given / "folder" / "m.csv", example.columns, rows)
    joint = Machine.load(given / "m.toml").joints[0]
    effect = "leg_zero_offset" if joint.type == "leg" else "zero_offset"
    words = {
        "M": given / "m.toml", "D": data, "FOLDER": data.parent, "WITH": given / "with.toml",
        "MEASURED": written(given / "measured.csv", example.columns, example.rows[:24]),
    }  # fmt: skip
    add = ["add", words["M"], effect, "--joint", joint.name, "-o", words["WITH"]]
    assert rodgen_command(*add)[0] == OK
    before = {path: path.read_bytes() for path in given.rglob("*") if path.is_file()}
    for command in commands:
        for n, line in enumerate(COMMANDS[command]):
            out = tmp_path / f"{command}_{n}"
            out.mkdir()
            text = (
                line.replace("EFFECT", effect).replace("JOINT", joint.name).replace("OUT", str(out / "new"))
            )
            code, shown, told = rodgen_command(*(words.get(word, word) for word in text.split()))
            about = (line, code, shown[-2000:], told)
            assert code in {OK, FAILED, BAD_INPUT, NOT_CONVERGED}, about
            assert not re.search(r"Traceback|warning|\bnan\b", shown + told, re.IGNORECASE), about
            if code == BAD_INPUT:
                assert len((told or shown).splitlines()) == 1 or command == "fleet", about
                assert command == "fleet" or not list(out.iterdir()), about
            elif " -o " in line and code == OK and "is not written: there is nothing to measure" not in told:
                assert list(out.iterdir()), about
    assert {path: path.read_bytes() for path in given.rglob("*") if path.is_file()} == before


def test_every_command_that_takes_a_machine_is_called() -> None:
    (commands,) = (a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    take_a_machine = {
        name
        for name, parser in commands.choices.items()
        if any(a.dest in {"machine", "machines", "data"} for a in parser._actions if not a.option_strings)
    }
    assert take_a_machine == COMMANDS.keys() | NOT_CALLED


@pytest.mark.thorough(*(f"mount, {size}" for size in SIZES))
@pytest.mark.parametrize(("folder", "size"), [case for case in CASES if case.values[0].name in FEW])
def test_commands_answer_or_refuse_in_a_sentence(folder, size, tmp_path, monkeypatch, rodgen_command) -> None:
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    long = set() if size == "no row" or (folder.name == QUICK and size == "one row") else LONG
    called(folder, size, tmp_path, rodgen_command, [c for c in COMMANDS if c not in long])


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "size"), CASES)
def test_commands_with_compiled_kernels_answer_or_refuse_in_a_sentence(
    folder, size, tmp_path, rodgen_command
) -> None:
    called(folder, size, tmp_path, rodgen_command, list(COMMANDS))


def test_a_comparison_with_nothing_to_estimate_is_with_the_file_itself(tmp_path, rodgen_command) -> None:
    (folder,) = (path for path in EXAMPLES if path.name == "mount")
    example = Example.of(folder)
    machine = tmp_path / "m.toml"
    machine.write_text(example.without_estimate)
    data = written(tmp_path / "m.csv", example.columns, example.rows)
    (az, el), u = np.radians(np.array(example.rows, float)[:, :2]).T, np.array(example.rows, float)[:, 2:5]
    aim = np.stack([np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)], axis=1)
    off = np.degrees(np.linalg.norm(np.cross(aim, u), axis=1)) * 3600
    code, shown, told = rodgen_command("compare", machine, data, "--json")
    found = json.loads(shown)
    assert (code, told, found["unit"], found["rows"]) == (OK, "", "arcsec", 80)
    assert found["rms"] * np.sqrt(2) == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-5)
    code, shown, told = rodgen_command("compare", machine, data)
    assert (code, told) == (OK, "")
    each = ", ".join(f"{one['name']} {one['rms']:.3g} arcsec" for one in found["components"])
    assert f"rms by component: {each}\n" in shown
    # the azimuth begins 20 arcmin off, and its axis is tilted by 10 arcsec: both turn the whole
    assert "depend on a turn or shift of the whole set-up: > 99.9 % of their variance (more" in shown
    assert "In addition they depend on EL" in shown
    assert "No dependence" not in shown  # on AZ
