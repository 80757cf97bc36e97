"""Each file operation of a command fails in turn, or is where Ctrl-C is pressed.

Afterwards every output is the old one or the new one, whole; one line says what happened; the exit code is that of the
table in docs/reference/command_line.md; and no temporary file is left.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from faults import Fault, Operations, Torture
from solved_table import solve_table

from rodgen.errors import InputFileError

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="files are found by their descriptors"
)

EXAMPLES = Path(__file__).parent.parent / "examples"


def files_of(folder: str, **names: str) -> dict[str, bytes]:
    """Return files of a folder of examples, by the names that a command calls them."""
    return {
        f"{name}.{file.rpartition('.')[2]}": (EXAMPLES / folder / file).read_bytes()
        for name, file in names.items()
    }


def rows(text: bytes, number: int) -> bytes:
    """Return a table's header and its first rows."""
    return b"".join(text.splitlines(keepends=True)[: number + 1])


def parquet(text: bytes) -> bytes:
    """Return a CSV file as Parquet."""
    out = io.BytesIO()
    pq.write_table(pa_csv.read_csv(io.BytesIO(text)), out)
    return out.getvalue()


TABLE = files_of("machines/rotary_table", m="machine.toml", d="data.csv")
FEW = {**TABLE, "d.csv": rows(TABLE["d.csv"], 48)}
PAIRS = files_of("", p="pairs.csv")
IN_PARQUET = {"p.parquet": parquet(PAIRS["p.csv"])}
POINTS = {"p.csv": b"Qx [mm],Qy [mm],Qz [mm]\n0,0,700\n10,20,650\n"}
COMMANDS: dict[str, tuple[dict[str, bytes], str, str]] = {
    # files, arguments, outputs that are there before
    "add": (FEW, "add m.toml gravity_windup --joint C -o a.toml", "a.toml"),
    "add in place": (FEW, "add m.toml gravity_windup --joint C -o m.toml", ""),
    "apply, several rows": (
        POINTS,
        "apply tricept.inverse p.csv --set R=33cm --set r=14cm -o i.csv.gz",
        "i.csv.gz",
    ),
    "apply to standard output": (PAIRS, "apply solve_axis p.csv", ""),
    "simulate to standard output": (FEW, "simulate m.toml d.csv --truth t.json --seed 1", "t.json"),
    "apply": (PAIRS, "apply solve_axis p.csv -o s.parquet", "s.parquet"),
    "fit": (FEW, "fit m.toml d.csv -o f.toml --residuals r.csv.gz", "f.toml r.csv.gz"),
    "emit c": (FEW, "emit m.toml d.csv --lang c -o code/deep", ""),
    "predict": (FEW, "predict m.toml d.csv d.csv -o p.parquet", "p.parquet"),
    "watch": (FEW, "watch m.toml d.csv --reference d.csv --state s.watch", ""),
}
"""One for each way to write: a file, several, a folder, a table, and standard output."""
QUICK = list(COMMANDS)[:5]


@pytest.fixture
def tortured(tmp_path):
    def made(name):
        inputs, arguments, old = COMMANDS[name]
        return Torture(tmp_path, inputs, arguments.split(), old.split())

    return made


@pytest.mark.thorough("add in place", "apply, several rows", "apply to standard output")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in COMMANDS]
)
def test_every_operation_fails_once_or_is_interrupted(name, tortured):
    torture = tortured(name)
    torture.run()  # what is kept in memory is made
    good = torture.run()
    assert good.code in (0, 1), good.err
    assert len(good.operations.done) > 0
    for at in range(len(good.operations.done)):
        torture.check(good, torture.run(Fault(at)))
        if name in QUICK:
            torture.check(good, torture.run(Fault(at, KeyboardInterrupt)))


KILLED = """
import os, signal, sys
from rodgen.cli.main import main
plain, count = os.{name}, []
def killed(*arguments):
    count.append(arguments)
    if len(count) == {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    return plain(*arguments)
os.{name} = killed
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "at"), [("fsync", 1), ("fsync", 2), ("replace", 2)])
def test_a_command_that_is_killed_leaves_whole_files(name, at, tmp_path):
    """Old ones, or where it is killed between two names, a new one."""
    for file, content in FEW.items():
        (tmp_path / file).write_bytes(content)
    outputs = {"t.json", "s.csv"}
    for file in outputs:
        (tmp_path / file).write_bytes(b"old")
    command = ["simulate", "m.toml", "d.csv", "--seed", "1", "--truth", "t.json", "-o", "s.csv"]
    code = KILLED.format(name=name, at=at)
    done = subprocess.run([sys.executable, "-c", code, *command], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    killed = {file: (tmp_path / file).read_bytes() for file in outputs}
    done = subprocess.run([sys.executable, "-m", "rodgen", *command], cwd=tmp_path, check=False)
    assert done.returncode == 0
    new = [file for file in outputs if killed[file] == (tmp_path / file).read_bytes()]
    assert len(new) == (name == "replace")
    assert all(killed[file] == b"old" for file in outputs.difference(new))


@contextlib.contextmanager
def files_of_at_most(size):
    """As on a full disk the system itself refuses to write, to whatever library."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    "name",
    [
        "apply",
        *(pytest.param(each, marks=pytest.mark.slow) for each in ("fit", "predict")),
    ],
)
def test_a_disk_that_becomes_full_at_any_byte_leaves_the_old_output(name, tortured):
    torture = tortured(name)
    good = torture.run()
    largest = max(len(content) for file, content in good.files.items() if torture.before.get(file) != content)
    for size in np.linspace(0, largest - 1, 8 if name == "apply" else 12).astype(int).tolist():
        with files_of_at_most(size):
            found = torture.run_again()
        assert (found.code, found.files, found.strays) == (2, good.files, []), size
        assert len(found.err.splitlines()) == 1
        assert "cannot be written (File too large); expected a writable place with room" in found.err


@pytest.mark.parametrize("pack", ["Parquet", "gzip"])
def test_a_disk_that_cannot_be_read_is_not_called_damaged_data(pack, tmp_path):
    """Each read fails in turn."""
    path = tmp_path / "p"
    path.write_bytes(IN_PARQUET["p.parquet"] if pack == "Parquet" else gzip.compress(PAIRS["p.csv"]))
    solve_table(path, tmp_path / "s.csv")
    with Operations(tmp_path).watched() as operations:
        solve_table(path, tmp_path / "s.csv")
    reads = [n for n, what in enumerate(operations.done) if what.startswith("read")]
    assert len(reads) > 1
    for at in reads:
        with (
            Operations(tmp_path, Fault(at)).watched(),
            pytest.raises(InputFileError, match=re.escape("p: file: cannot be read (Input/output error)")),
        ):
            solve_table(path, tmp_path / "s.csv")


def test_a_disk_that_is_full_is_one_line(tmp_path):
    for name, content in FEW.items():
        (tmp_path / name).write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-m", "rodgen", "add", "m.toml", "gravity_windup", "--joint", "C", "-o", "a.toml"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)),
    )  # fmt: skip
    line = "a.toml: file: cannot be written (File too large); expected a writable place with room\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", line)
    assert sorted(os.listdir(tmp_path)) == ["d.csv", "m.toml"]
