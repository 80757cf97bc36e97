"""The messages of all malformed inputs of the tests, which are imported from there."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import test_catalogue
import test_cli
import test_cli_diagnose
import test_cli_machines
import test_formula
import test_import_denavit_hartenberg as test_dh
import test_import_deviations
import test_import_tables
import test_import_tpoint
import test_import_urdf
import test_machine_file
import test_measurements
import test_parallel_machines
import test_simulate
import test_tables
import test_units
from fuzz import KEPT, Case
from transcripts import EXAMPLES, ran, working_in

import rodgen
from rodgen.calibration.problem.binding import bind
from rodgen.data.tables import read_motions
from rodgen.data.units import parse_unit
from rodgen.errors import RodgenError
from rodgen.machines.imports.denavit_hartenberg import machine_from_table
from rodgen.machines.imports.tpoint_data import read_pointings
from rodgen.machines.imports.tpoint_model import machine_from_tpoint
from rodgen.machines.imports.urdf import machine_from_urdf


def written(name: str, content: str | bytes) -> str:
    """Write a file into the current folder; return its name."""
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return name


def bound(content: Any, _: str = "", machine: Any = None) -> None:
    """Read measurements and bind them to a machine."""
    data = rodgen.Measurements.load(written("data.csv", content))
    bind(machine or test_measurements.machine(), data)


def called(command: str, name: str, content: Any) -> None:
    """Call a command with a malformed file; raise what it says."""
    if content is not None:
        written(name, content)
    record = ran(command.split())
    raise RodgenError(f"exit code {record['exit code']}: {' | '.join(record['out'] + record['err'])}")


def with_examples(command: str) -> None:
    """Call a command where the files of the tests of commands are."""
    mount, table, gantry = (
        EXAMPLES / "machines" / name for name in ("mount", "rotary_table", "gantry_rotary")
    )
    for name, source in {
        "mount.toml": mount / "machine.toml",
        "stars.csv": mount / "mmt_2021.csv",
        "table.toml": table / "machine.toml",
        "balls.csv": table / "data.csv",
        "gantry.toml": gantry / "machine.toml",
        "gantry.csv": gantry / "data.csv",
    }.items():
        shutil.copy(source, name)
    for name, data in test_cli_diagnose.DATA.items():
        if f"{name}.json" in command:
            written(f"{name}.json", diagnosed(name, data))
    called(command, "empty.csv", "AZ [deg],EL [deg],ux,uy,uz\n")


DIAGNOSED: dict[str, str] = {}


def diagnosed(name: str, data: str) -> str:
    """Return what `rodgen diagnose --json` prints, once for each machine."""
    if name not in DIAGNOSED:
        DIAGNOSED[name] = "\n".join(ran(["diagnose", f"{name}.toml", data, "--json"])["out"])
    return DIAGNOSED[name]


def spoilt_stars(content: str) -> None:
    """Diagnose with malformed measurements."""
    written("bad.csv", content)
    with_examples("diagnose mount.toml bad.csv --json")


def simulated(text: str) -> None:
    """Simulate with an effect that is wrong."""
    machine, data = test_simulate.example("rotary_table")
    rodgen.simulate(machine, data, [text])


def fuzzed(case: Case) -> None:
    """Run a command that once failed."""
    for name, content in case.files.items():
        written(name, content)
    record = ran(case.arguments)
    raise RodgenError(f"exit code {record['exit code']}: {' | '.join(record['out'] + record['err'])}")


def parameters(test: Any) -> list[Any]:
    """Return the cases of a parametrized test."""
    (mark,) = (mark for mark in test.pytestmark if mark.name == "parametrize")
    return [getattr(case, "values", case) for case in mark.args[1]]


IMPORTS: dict[str, tuple[Any, Callable[..., Any]]] = {
    "DH table": (
        test_dh.test_what_is_wrong_is_said_in_one_sentence,
        lambda old, new, _: machine_from_table(written("t.csv", test_dh.KUKA.replace(old, new)), "standard"),
    ),
    "DH file": (
        test_dh.test_what_is_wrong_in_toml_is_said_in_one_sentence,
        lambda old, new, _: machine_from_table(written("t.toml", test_dh.MITSUBISHI.replace(old, new, 1))),
    ),
    "URDF": (
        test_import_urdf.test_what_is_wrong_is_said_in_one_sentence,
        lambda old, new, options, _: machine_from_urdf(
            written("r.urdf", test_import_urdf.ROBOT.replace(old, new) if old else test_import_urdf.ROBOT),
            **options,
        ),
    ),
    "pointings": (
        test_import_tpoint.test_what_is_wrong_with_a_run_is_said_in_one_sentence,
        lambda old, new, _: read_pointings(written("r.dat", test_import_tpoint.RUN.replace(old, new))),
    ),
    "pointing model": (
        test_import_tpoint.test_what_is_wrong_with_a_model_is_said_in_one_sentence,
        lambda terms, _: machine_from_tpoint(None, written("m.mod", f"M\nT 10 1.0 0 0\n{terms}\nEND\n")),
    ),
    "table": (
        test_import_tables.test_what_is_wrong_is_said_in_one_sentence,
        lambda old, new, stated, _: test_import_tables.columns_of(
            test_import_tables.TURNTABLE,
            Path(written("t.csv", test_import_tables.GOOD.replace(old, new))),
            stated=stated,
        ),
    ),
    "map of columns": (
        test_import_tables.test_what_is_wrong_with_the_map_is_said_in_one_sentence,
        lambda entry, _: test_machine_file.load(f"{test_import_tables.TURNTABLE}\n[columns]\n{entry}\n"),
    ),
    "deviations": (
        test_import_deviations.test_what_is_wrong_is_said_in_one_sentence,
        lambda header, option, _: called(
            f"import {test_import_deviations.BALLBAR} t.csv -d d.csv --ballbar {option}",
            "t.csv",
            f"{header}\n0,150\n90,150\n",
        ),
    ),
}
"""By what is imported: a test of malformed files, and what is called with each of its cases."""
GANTRY = test_machine_file.GANTRY
INPUTS: dict[str, dict[str, Callable[[], Any]]] = {
    "tables": {
        n: lambda c=c: read_motions(written("pairs.csv", c)) for n, (c, _) in test_tables.MALFORMED.items()
    },
    "measurements": {n: lambda c=c: bound(*c) for n, c in test_measurements.MALFORMED.items()},
    "frames": {
        n: lambda f=f: rodgen.Measurements.from_frame(f, name="table 3")
        for n, (f, _) in test_measurements.BAD_FRAMES.items()
    },
    "machine files": {
        f"{n}: {new}"[:60]: lambda old=old, new=new: test_machine_file.load(GANTRY.replace(old, new))
        for n, (old, new, _) in enumerate(test_machine_file.FAULTS)
    },
    "machine files of closed chains": {
        n: lambda old=old, new=new: test_machine_file.load(test_parallel_machines.PLAIN.replace(old, new))
        for n, (old, new, _) in test_parallel_machines.FAULTS.items()
    },
    "imports": {
        f"{what} {n}": lambda call=call, case=case: call(*case)
        for what, (test, call) in IMPORTS.items()
        for n, case in enumerate(parameters(test), 1)
    },
    "formulas": {n: lambda t=t: test_formula.parse(t) for n, (t, _) in test_formula.BAD.items()},
    "own effects": {n: lambda c=c: test_catalogue.own(**c) for n, (c, _) in test_catalogue.BAD.items()},
    "units": {t[:60]: lambda t=t: parse_unit(t) for t in test_units.BAD},
    "effects to simulate": {t: lambda t=t: simulated(t) for t in test_simulate.WRONG},
    "pairs": {
        f"{command} {n}": lambda command=command, c=c: called(f"{command} bad.csv", "bad.csv", c)
        for n, (c, _) in test_cli.BAD.items()
        for command in ("apply solve_axis", "fit-axis")
    },
    "data of a diagnosis": {
        n: lambda c=c: spoilt_stars(c) for n, (c, _) in test_cli_diagnose.BAD_DATA.items()
    },
    "commands": {
        command: lambda command=command: with_examples(command)
        for command in (*test_cli_machines.REFUSED, *test_cli_diagnose.REFUSED)
    },
    "what failed once": {
        p.name: lambda p=p: fuzzed(Case.load(p)) for p in sorted(KEPT.iterdir()) if p.is_dir()
    },
}


def cases() -> list[str]:
    """Return the names of the dictionaries."""
    return list(INPUTS)


def answers(case: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a record with the message of each input of a dictionary."""
    for name, call in INPUTS[case].items():
        with TemporaryDirectory() as folder, working_in(folder):
            yield f"{case}: {name}", {"message": message_of(call)}


def message_of(call: Callable[[], Any]) -> str:
    """Return what is said where a call is refused."""
    try:
        call()
    except Exception as error:  # an error in rodgen itself is an answer, too
        name = "" if isinstance(error, RodgenError) else f"{type(error).__name__}: "
        text = str(error).replace(str(EXAMPLES), "EXAMPLES").replace(str(Path.cwd()), "FOLDER")
        return re.sub(r" at 0x[0-9a-f]+", "", name + text)
    return "no error"
