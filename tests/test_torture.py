"""Each file operation, each program and, at chosen places, each call of a command fails in turn.

Afterwards every output is the old one or the new one, whole; one line says what happened; the exit code is that of the
table in docs/command_line.md; and no temporary file is left.
"""

from __future__ import annotations

import contextlib
import errno
import gzip
import io
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from faults import Fault, Operations, Torture
from solved_table import solve_table

from rodgen.codegen import tape
from rodgen.codegen.rows import row_kernels
from rodgen.errors import InputFileError
from rodgen.files import AtomicFile, OutputSet, write_file

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
MOUNT = files_of("machines/mount", m="machine.toml", d="mmt_2021.csv")
PAIRS = files_of("", p="pairs.csv")
IN_PARQUET = {"p.parquet": parquet(PAIRS["p.csv"])}
POINTS = {"p.csv": b"Qx [mm],Qy [mm],Qz [mm]\n0,0,700\n10,20,650\n"}
EFFECT = b'\n[[effect]]\nname = "gravity_windup"\njoint = "C"\n'
WITH_EFFECT = {**FEW, "m.toml": FEW["m.toml"] + EFFECT}
WRONG = {**FEW, "m.toml": FEW["m.toml"].replace(b"[0, 0, 1]", b"[0, 0, -1]", 1)}
URDF = {
    "r.urdf": b'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
    b'<child link="b"/><axis xyz="0 0 1"/></joint></robot>'
}
POINTINGS = b"Run\n:ALTAZ\n31 41 19.6 2021 8 21\n" + b"".join(
    b"%d %d %.2f %.2f\n" % (a, e, a + 0.01, e - 0.02) for a in range(-150, 180, 60) for e in (20, 50, 70)
)
ROBOT = files_of("mechanisms", l="puma_560.csv", o="p60_pose.csv")

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
    "apply Parquet": (IN_PARQUET, "apply solve_axis p.parquet -o s.csv", ""),
    "fit": (FEW, "fit m.toml d.csv -o f.toml --residuals r.csv.gz", "f.toml r.csv.gz"),
    "fit --json": (FEW, "fit m.toml d.csv -o f.toml --residuals r.parquet --json", "r.parquet"),
    "check": (WRONG, "check m.toml d.csv -o mended.toml", "mended.toml"),
    "diagnose": (FEW, "diagnose m.toml d.csv --json", ""),
    "compare": (FEW, "compare m.toml d.csv --plot r.html", "r.html"),
    "compare --plot folder": (FEW, "compare m.toml d.csv --plot r.html --json", ""),
    "add with data": (FEW, "add m.toml gravity_windup d.csv --joint C -o a.toml", "a.toml"),
    "remove": (WITH_EFFECT, "remove m.toml gravity_windup d.csv --joint C -o a.toml", ""),
    "set": (FEW, "set m.toml C.axis.a --prior 0±9arcsec -o a.toml", "a.toml"),
    "exclude": (FEW, "exclude m.toml d.csv --rows 3-5 -o a.toml", "a.toml"),
    "emit c": (FEW, "emit m.toml d.csv --lang c -o code/deep", ""),
    "emit numpy": (FEW, "emit m.toml d.csv --lang numpy -o code", ""),
    "emit matlab": (FEW, "emit m.toml d.csv --lang matlab -o code", ""),
    "plan": (FEW, "plan m.toml d.csv -n 3 -o p.csv", "p.csv"),
    "predict": (FEW, "predict m.toml d.csv d.csv -o p.parquet", "p.parquet"),
    "watch": (FEW, "watch m.toml d.csv --reference d.csv --state s.watch --plot w.html", "w.html"),
    "report": (FEW, "report m.toml d.csv -o r.html", "r.html"),
    "simulate": (FEW, "simulate m.toml d.csv --hidden --truth t.json --seed 1 -o s.csv", "s.csv t.json"),
    "fit-axis": (PAIRS, "fit-axis p.csv --plot a.html --json", ""),
    "mechanism reverse": (ROBOT, "mechanism reverse l.csv o.csv --from matrix -o q.csv", "q.csv"),
    "kernels": ({}, "kernels axis -o generated", ""),
    "derive": ({}, "derive rodrigues", ""),
    "import": (URDF, "import r.urdf -o m.toml", "m.toml"),
    "import with data": ({"r.dat": POINTINGS}, "import r.dat -o m.toml -d d.csv", "m.toml d.csv"),
    "import a table": (
        {**TABLE, "t.txt": TABLE["d.csv"].replace(b",", b";")},
        "import m.toml t.txt -d o.csv",
        "o.csv",
    ),
    "new": ({}, "new turntable -o m.toml", "m.toml"),
    "effects": ({}, "effects", ""),
    "completion": ({}, "completion bash", ""),
}


QUICK = list(COMMANDS)[:5]
LONG = {
    "report",
    "watch",
    "plan",
    "compare",
    "compare --plot folder",
    "check",
    "diagnose",
}


def of_commands(calls=False):
    """Parametrize a test by commands; all but a few are slow."""
    names = ("add", "apply, several rows") if calls else QUICK
    return pytest.mark.parametrize(
        "name",
        [
            pytest.param(name, marks=[] if name in names else pytest.mark.slow)
            for name in COMMANDS
            if not (calls and name in LONG)
        ],
    )


@pytest.fixture
def tortured(tmp_path):
    def made(name):
        inputs, arguments, old = COMMANDS[name]
        return Torture(tmp_path, inputs, arguments.split(), old.split())

    return made


@of_commands()
def test_every_operation_fails_once(name, tortured):
    torture = tortured(name)
    torture.run()  # what is kept in memory is made
    good = torture.run()
    assert good.code in (0, 1), good.err
    assert len(good.operations.done) > 0
    for lasting in (False,) if name in QUICK or name in LONG else (False, True):
        for at in range(len(good.operations.done)):
            torture.check(good, torture.run(Fault(at, lasting=lasting)))


@pytest.mark.quick("apply, several rows")
@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # a file that the interpreter closes
@of_commands(calls=True)
def test_memory_ends_or_ctrl_c_is_pressed_at_a_call(name, tortured):
    """At the calls that write files, and at others that are spread over the command."""
    torture = tortured(name)
    torture.run()
    good = torture.run(calls=True)
    done = good.operations.done
    writing = [n for n, what in enumerate(done) if what.endswith((" files.py", "writer.py", "_outputs.py"))]
    quick = name in QUICK
    spread = np.linspace(0, len(done) - 1, 10 if quick else 30).astype(int)
    for at in sorted({*spread.tolist(), *writing[:: 4 if quick else 1]}):
        for error in (MemoryError, KeyboardInterrupt):
            torture.check(good, torture.run(Fault(at, error), calls=True))


@pytest.mark.slow
def test_every_operation_of_compiling_fails_once(tmp_path, monkeypatch, compiler):
    """The function computes the same then, by the compiled library or by NumPy, and the cache stays whole."""

    def hypotenuse():
        on = tape.Tape()
        (a,), (b,) = on.inputs("a", 1, same=False), on.inputs("b", 1)
        side = tape.sqrt(a**2 + b**2)
        return row_kernels("side", lambda: [on.program("c", {"a": (), "b": ()}, {"c": ((), [side])})])["c"]

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("RODGEN_CPU", raising=False)

    def run(fault=None):
        cache = Path(tempfile.mkdtemp())
        monkeypatch.setenv("RODGEN_CACHE", str(cache))
        with warnings.catch_warnings(), Operations(tmp_path, fault).watched() as operations:
            warnings.simplefilter("ignore")
            assert hypotenuse()([3.0], 4.0) == 5
        failed = operations.done[fault.at] if fault else ""
        left = [path.name for path in cache.iterdir() if path.name.startswith("build-")]
        assert left == [] or failed.startswith(("unlink", "scandir", "open to read")), failed
        made = hypotenuse()
        assert (made.target, made([5.0], 12.0)) == ("c", 13), failed
        return operations

    run()
    for at in range(len(run().done)):
        run(Fault(at))


KILLED = """
import os, signal, sys
from rodgen import files
from rodgen.cli.main import main
def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)
os.fsync = killed
sys.exit(main(sys.argv[1:]))
"""


def test_what_a_killed_command_left_is_removed_by_the_next(tmp_path):
    for name, content in FEW.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "a.toml").write_bytes(b"old")
    command = ["add", "m.toml", "gravity_windup", "--joint", "C", "-o", "a.toml"]
    done = subprocess.run([sys.executable, "-c", KILLED, *command], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "a.toml").read_bytes() == b"old"
    assert len(os.listdir(tmp_path)) == 4
    write_file(tmp_path / "a.toml", b"new")
    assert sorted(os.listdir(tmp_path)) == ["a.toml", "d.csv", "m.toml"]


def test_what_others_write_and_call_alike_stays(tmp_path):
    """Another process that writes the same file now; and files of other names."""
    for name in (
        ".x.toml.12345678",
        ".x.toml.rodgen-1234567",
        ".x.toml.rodgen-1234567g",
        ".y.toml.rodgen-12345678",
    ):
        (tmp_path / name).touch()
    os.mkfifo(tmp_path / ".x.toml.rodgen-00000000")
    there = set(os.listdir(tmp_path)) - {".x.toml.rodgen-00000000"}
    other = AtomicFile(str(tmp_path / "x.toml"))
    with other.open() as stream:
        stream.write(b"other")
        write_file(tmp_path / "x.toml", b"mine")
    assert (tmp_path / "x.toml").read_bytes() == b"mine"
    other.commit()
    other.discard()
    assert (tmp_path / "x.toml").read_bytes() == b"other"
    assert set(os.listdir(tmp_path)) == {*there, "x.toml"}


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
        *(
            pytest.param(each, marks=pytest.mark.slow)
            for each in ("fit", "fit --json", "predict", "simulate")
        ),
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


def test_what_was_complete_is_undone_on_a_disk_without_hard_links(tmp_path, monkeypatch):
    def refused(*_, **__):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    first, second = (AtomicFile(str(tmp_path / name)) for name in ("a", "b"))
    monkeypatch.setattr(second, "publish", refused)
    with pytest.raises(OSError, match="not permitted"), OutputSet():  # noqa: PT012
        for file in (first, second):
            Path(file.file).write_bytes(b"old")
            file.write(b"new")
            file.commit()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"old", "b": b"old"}


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
