"""The messages of malformed machine files, imports and formulas of the tests, which are imported from there.

Those of all other malformed inputs are frozen by the tests themselves (`refuses` in `tests/conftest.py`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import test_formula
import test_import_denavit_hartenberg as test_dh
import test_import_deviations
import test_import_tables
import test_import_tpoint
import test_import_urdf
import test_machine_file
from fuzz import KEPT, Case
from transcripts import EXAMPLES, ran, working_in

from rodgen.errors import RodgenError
from rodgen.machines.imports.denavit_hartenberg import machine_from_table
from rodgen.machines.imports.tpoint_data import read_pointings
from rodgen.machines.imports.tpoint_model import machine_from_tpoint
from rodgen.machines.imports.urdf import machine_from_urdf


def written(name: str, content: str | bytes) -> str:
    """Write a file into the current folder; return its name."""
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return name


def called(command: str, name: str, content: Any) -> None:
    """Call a command with a malformed file; raise what it says."""
    if content is not None:
        written(name, content)
    record = ran(command.split())
    raise RodgenError(f"exit code {record['exit code']}: {' | '.join(record['out'] + record['err'])}")


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
    "machine files": {
        f"{n}: {new}"[:60]: lambda old=old, new=new: test_machine_file.load(GANTRY.replace(old, new))
        for n, (old, new, _) in enumerate(test_machine_file.FAULTS)
    },
    "imports": {
        f"{what} {n}": lambda call=call, case=case: call(*case)
        for what, (test, call) in IMPORTS.items()
        for n, case in enumerate(parameters(test), 1)
    },
    "formulas": {n: lambda t=t: test_formula.parse(t) for n, (t, _) in test_formula.BAD.items()},
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
