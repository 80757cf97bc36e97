"""Change the inputs of every command at random, in ways that know tables, machine files and options, and run it.

Whatever the inputs are, a command ends with an exit code of the table, says what is wrong in a line, writes whole files
or none, and needs neither minutes nor gigabytes. `make fuzz` runs this file; a failure is made as small as possible and
written into `tests/data/fuzz`, from where `tests/test_fuzz.py` runs it again.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import gzip
import hashlib
import io
import json
import random
import re
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from rodgen.cli.main import main
from rodgen.machines.templates import machine_template

EXAMPLES = Path(__file__).parent.parent / "examples"
CORPUS = Path(__file__).parent / "data" / "corpus"
KEPT = Path(__file__).parent / "data" / "fuzz"
SECONDS = 30
"""Of processor time, for a command that needs less than one for the files as they are."""
MEMORY = 2 << 30
"""Bytes above what the process has."""
LINES = 8
"""Lines on standard error of a command that succeeds."""


@dataclass(frozen=True)
class Case:
    """A command and its files."""

    arguments: tuple[str, ...]
    files: dict[str, bytes]

    def save(self, folder: Path) -> None:
        """Write it as a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        (folder / "arguments.json").write_text(json.dumps(self.arguments, indent=1) + "\n")

    @classmethod
    def load(cls, folder: Path) -> Case:
        """Read it from a folder."""
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        return cls(tuple(json.loads(files.pop("arguments.json"))), files)


# running ----------------------------------------------------------------------------------------------


class TooSlowError(BaseException):
    """A command takes too long."""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """Limit the processor time and the memory of the block."""

    def too_slow(*_: object) -> None:
        raise TooSlowError

    before = signal.signal(signal.SIGPROF, too_slow)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (has + MEMORY, hard))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def fault_of(case: Case, folder: Path) -> str:
    """Run a command in an empty folder; return what it does that none may, or an empty text."""
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True), io.StringIO()
    with (
        tempfile.TemporaryDirectory(dir=folder) as work,
        tempfile.TemporaryDirectory(dir=folder) as temporary,
        pytest.MonkeyPatch.context() as patch,
        warnings.catch_warnings(),
    ):
        for name, content in case.files.items():
            Path(work, name).write_bytes(content)
        patch.chdir(work)
        patch.setattr(tempfile, "tempdir", temporary)
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        patch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(next(iter(case.files.values()), b""))))
        try:
            with limited():
                code = main(case.arguments)
        except TooSlowError:
            return f"more than {SECONDS} s"
        written = [
            p for p in Path(work).rglob("*") if p.is_file() and case.files.get(p.name) != p.read_bytes()
        ]
        strays = [
            p.name
            for p in [*written, *Path(temporary).rglob("*")]
            if ".rodgen-" in p.name or p not in written
        ]
        changed = [p.name for p in written]
    said = err.getvalue()
    printed = b"" if out.closed else out.buffer.getvalue()  # type: ignore[attr-defined]
    if code not in (0, 1, 2, 3):
        return f"exit code {code}: {said}"
    if "Traceback" in said or "encountered in" in said:
        return f"not for users: {said}"
    if said.count("\n") > LINES:
        return f"{said.count(chr(10))} lines: {said[:300]}"
    if code == 2 and not 1 <= said.count("\n") <= 3:  # remarks on the data may come before
        return f"{said.count(chr(10))} lines for bad input: {said[:300]}"
    if code == 2 and "watch" in case.arguments[:1]:
        printed = b""  # events before it
    if code == 2 and (printed or changed):
        return f"bad input, and yet there is {changed or 'an answer'}: {said}"
    if strays:
        return f"left {strays}"
    if code in (0, 3) and "--json" in case.arguments and printed.strip():
        try:
            json.loads(printed, parse_constant=float.fromhex)
        except ValueError as error:
            return f"no JSON: {error}"
    return ""


def kind_of(fault: str) -> str:
    """Return a fault without what differs from one file to another: numbers and quoted text."""
    return re.sub(r"'[^']*'|\"[^\"]*\"|[-\d.]+(e[-+]?\d+)?", "#", fault.splitlines()[0] if fault else "")[:80]


# changes ----------------------------------------------------------------------------------------------

NUMBERS = [
    *"0 -0.0 1 -1 2 3 0.5 1e-9 -1e-9 1e-160 5e-324 1e6 -1e6 9.9e99 1e100 1e160 1e308 1e400 nan inf -inf 90".split(),
    *"180 360 9007199254740993 9223372036854775808 0x1F 1_000 00 1,5 12e 1e-400".split(),
    "9" * 400,
    "1" * 5000,
]
WORDS = [
    "", "mm", "deg", "X", "x", "C", "run", "target", "t", "free", "machine", "revolute", "prismatic", "direction",
    "distance", "ü", "a\tb", "a\nb", "\x1b[31m", "\u202e", "../x", "x" * 3000, "[", "]", "#", "=", "'", '"', ",", "\\",
    "a.b.c", "-", "--", "%s", "{0}", "nan", "axis", "C.axis", "C.point", "furlong", "kg", "mm^2", "deg/mm",
]  # fmt: skip
VALUES = [
    "true",
    "[]",
    "{}",
    "[[]]",
    "[1, 2, 3]",
    "[0, 0, 0]",
    "[nan, 0, 0]",
    '""',
    "1979-05-27",
    "[[1, 0], [0, 1]]",
]
TOKEN = re.compile(rb"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\"[^\"\n]*\"|[A-Za-z_]\w*")


def number(rng: random.Random, old: str = "") -> str:
    """Return a number: one that hurts, or the old one changed."""
    if rng.random() < 0.4:
        with contextlib.suppress(ValueError):
            return repr(float(old) * rng.choice([-1, 1 + 1e-9, 1e3, 1e-3, 2, 1e9, 1e-9, 1e150]))
    return rng.choice(NUMBERS)


def changed_text(rng: random.Random, text: bytes) -> bytes:
    """Change a token, a line or a block of a TOML or JSON file."""
    how = rng.random()
    lines = text.splitlines(keepends=True)
    if how < 0.6 and (tokens := list(TOKEN.finditer(text))):
        token = rng.choice(tokens)
        old = token[0].decode("utf-8", "replace")
        if old[0] == '"':
            new = f'"{rng.choice(WORDS)}"' if rng.random() < 0.8 else rng.choice([*VALUES, *NUMBERS])
        elif old[0].isalpha():
            new = rng.choice([*WORDS, old + "x", old.upper()])
        else:
            new = number(rng, old) if rng.random() < 0.8 else rng.choice([*VALUES, '"a"'])
        return text[: token.start()] + new.encode() + text[token.end() :]
    if how < 0.85 and lines:
        at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
        line = lines.pop(at)
        if rng.random() < 0.5:  # moved or doubled
            lines.insert(to, line)
            lines[at:at] = [line] * rng.choice([0, 1])
        return b"".join(lines)
    if how < 0.95:
        blocks = re.split(rb"(?=^\[)", text, flags=re.M)
        at = rng.randrange(len(blocks))
        blocks[at : at + 1] = [blocks[at]] * rng.choice([0, 2, 2, 30])
        return b"".join(blocks)
    return changed_bytes(rng, text)


def changed_bytes(rng: random.Random, content: bytes) -> bytes:
    """Cut a file, change one of its bytes, or put others before it."""
    at = rng.randrange(len(content) + 1)
    return rng.choice(
        [
            content[:at],
            content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :],
            content[:at] + rng.choice([b"\0", b"\xff", b"\r", b"\n\n", b"\xc3\xa9", b'"']) + content[at:],
            b"\xef\xbb\xbf" + content,
            content.replace(b"\n", b"\r\n"),
            b"",
        ]
    )


def changed_table(rng: random.Random, text: bytes) -> bytes:
    """Change cells, rows, columns or headings of a CSV file."""
    rows = [line.split(b",") for line in text.splitlines()]
    if not rows or rng.random() < 0.04:
        return changed_bytes(rng, text)
    column, row = rng.randrange(len(rows[0])), rng.randrange(len(rows))
    body = [r for r in rows[1:] if len(r) > column]
    old = body[0][column].decode("utf-8", "replace") if body else ""
    new = number(rng, old).encode()
    hows = "cell cell word column scale heading unit delete double swap empty first few doubled shuffled extra short"
    how = rng.choice(hows.split())
    if how in ("cell", "word") and rows[row]:
        rows[row][rng.randrange(len(rows[row]))] = new if how == "cell" else rng.choice(WORDS).encode()
    elif how in ("column", "empty"):
        for r in body:
            r[column] = new if how == "column" else b""
    elif how == "scale":
        factor = rng.choice([0, -1, 1e-12, 1e12, 1e-160, 1e90, 1e150, 1e300])
        for r in body:
            with contextlib.suppress(ValueError):
                r[column] = repr(float(r[column]) * factor).encode()
    elif how == "heading":
        rows[0][column] = rng.choice(
            [rng.choice(WORDS).encode(), rng.choice(rows[0]), b"load [N]", b"u_x [mm]", b"t [s]"]
        )
    elif how == "unit":
        unit = rng.choice(
            ["", " [mm]", " [deg]", " [m]", " [furlong]", " [mm", " [mm*1e300]", " [rad]", " [K]", " [1]"]
        )
        rows[0][column] = rows[0][column].partition(b" ")[0] + unit.encode()
    elif how == "delete":
        rows = [[*r[:column], *r[column + 1 :]] for r in rows]
    elif how == "double":
        rows = [[*r, r[column] if column < len(r) else b""] for r in rows]
    elif how == "swap":
        for r in body:
            r[0], r[column] = r[column], r[0]
    elif how == "first":
        rows = [rows[0], *[rows[min(1, len(rows) - 1)]] * (len(rows) - 1)]
    elif how == "few":
        rows = rows[: rng.randrange(5)]
    elif how == "doubled":
        rows += rows[1:]
    elif how == "shuffled":
        rest = rows[1:]
        rng.shuffle(rest)
        rows = [rows[0], *rest]
    elif how == "extra":
        rows[row].append(new)
    else:
        rows[row] = rows[row][:column]
    return b"\n".join(b",".join(r) for r in rows) + b"\n"


def as_parquet(rng: random.Random, text: bytes) -> bytes:
    """Return a CSV file as Parquet, with another type for one of its columns, or damaged."""
    import pyarrow as pa
    import pyarrow.csv as pa_csv
    import pyarrow.parquet as pq

    try:
        table = pa_csv.read_csv(io.BytesIO(text))
    except pa.ArrowException:
        return text
    types = [
        pa.float32(), pa.float16(), pa.int8(), pa.uint64(), pa.string(), pa.large_string(), pa.binary(), pa.bool_(),
        pa.dictionary(pa.int32(), pa.string()), pa.decimal128(20, 5), pa.timestamp("ms"), pa.null(),
    ]  # fmt: skip
    names, columns = table.column_names, list(table.columns)
    at = rng.randrange(len(columns)) if columns else 0
    with contextlib.suppress(pa.ArrowException, IndexError, OverflowError, ValueError):
        columns[at] = columns[at].cast(rng.choice(types), safe=False)
        if rng.random() < 0.2:
            columns[at] = pa.chunked_array([pa.array([[v] for v in columns[at].to_pylist()])])
    out = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(columns, names), out)
    content = out.getvalue()
    return changed_bytes(rng, content) if rng.random() < 0.2 else content


def changed_arguments(rng: random.Random, arguments: tuple[str, ...]) -> tuple[str, ...]:
    """Change, double, swap, move or leave out an argument."""
    found = list(arguments)
    if not found:
        return ("fit",)
    at = rng.randrange(min(1, len(found) - 1), len(found))
    how = rng.random()
    if how < 0.5:
        numbers = list(re.finditer(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?", found[at]))
        if numbers and rng.random() < 0.8:
            one = rng.choice(numbers)
            found[at] = found[at][: one.start()] + number(rng, one[0]) + found[at][one.end() :]
        else:
            found[at] = rng.choice([*WORDS, *NUMBERS[:20], found[at] + "x", found[at][:-1]])
    elif how < 0.65:
        found.pop(at)
    elif how < 0.8:
        found.insert(rng.randrange(len(found) + 1), found[at])
    else:
        to = rng.randrange(len(found))
        found[at], found[to] = found[to], found[at]
    return tuple(found)


def changed(case: Case, seed: int) -> Case:
    """Return a case with one change, which the seed decides."""
    rng = random.Random(seed)
    if not case.files or rng.random() < 0.2:
        return replace(case, arguments=changed_arguments(rng, case.arguments))
    name = rng.choice(sorted(case.files))
    change: Callable[[random.Random, bytes], bytes] = changed_table if name.endswith(".csv") else changed_text
    content = change(rng, case.files[name])
    files, arguments = {**case.files, name: content}, case.arguments
    if name.endswith(".csv") and rng.random() < 0.1:  # as another kind of file
        ending = rng.choice([".csv.gz", ".parquet"])
        other = gzip.compress(content, mtime=0) if ending == ".csv.gz" else as_parquet(rng, content)
        if ending == ".csv.gz" and rng.random() < 0.3:
            other = changed_bytes(rng, other)
        del files[name]
        files[name[:-4] + ending] = other
        arguments = tuple(name[:-4] + ending if word == name else word for word in arguments)
    return Case(arguments, files)


# what is changed --------------------------------------------------------------------------------------


def rows(file: Path, count: int) -> bytes:
    """Return the header and some rows, spread over a table."""
    header, *lines = file.read_bytes().splitlines(keepends=True)
    return b"".join([header, *lines[:: max(1, len(lines) // count)][:count]])


COMMANDS = [  # NAME stands for each of MACHINES
    "fit NAME.toml NAME.csv -o f.toml --residuals r.csv",
    "fit NAME.toml NAME.csv --json --loss huber",
    "check NAME.toml NAME.csv -o c.toml --repaired-data c.csv",
    "compare NAME.toml NAME.csv --json",
    "predict NAME.toml NAME.csv NAME.csv -o p.csv",
    "emit NAME.toml NAME.csv --lang c -o code",
    "emit NAME.toml NAME.csv --lang numpy -o code --force",
    "add NAME.toml scale --joint JOINT -o a.toml",
    "add NAME.toml gravity_windup NAME.csv --joint JOINT --hold k2=0 -o a.toml",
    "remove NAME.toml gravity_windup NAME.csv --joint JOINT -o a.toml",
    "set NAME.toml JOINT.axis.a --bounds -9arcsec,inf -o a.toml --json",
    "add NAME.toml own --joint JOINT --formula k*cos(q) --parameter k=1 --hold k=2 -o a.toml",
    "set NAME.toml JOINT.axis.a --tie 2*JOINT.axis.b -o a.toml",
    "exclude NAME.toml NAME.csv --rows 3-5,9 --why clouds -o a.toml",
    "exclude NAME.toml NAME.csv --where JOINT<-5e3 -o a.toml --json",
    "exclude --undo NAME.toml NAME.csv --rows 4 -o a.toml",
    "simulate NAME.toml NAME.csv --effect encoder_eccentricity@JOINT:a=9arcsec --noise NOISE -o s.csv --seed 3",
    "simulate NAME.toml NAME.csv --hidden --truth t.json --noise NOISE -o s.csv",
    "diagnose NAME.toml NAME.csv --json --prefer scale@JOINT",
    "watch NAME.toml NAME.csv --reference NAME.csv --state s.watch --rate 5/min --json",
    "plan NAME.toml NAME.csv -n 4 -o p.csv --constraints limits.toml",
]
MACHINES = {"rotary_table": "C", "gantry_rotary": "C", "mount": "EL", "trunnion": "A", "tricept": "A0"}
SLOW = {"diagnose", "plan", "compare"}
LIMITS = b"""allowed = ["C > 20 deg"]
[limits]
C = [0, 300]
[[keep_out]]
x = [200, 300]
z = [0, 50]
[session]
readings = 20
"""
JOINTS = b"R1 [deg],R2 [deg],R3 [deg],R4 [deg],R5 [deg],R6 [deg]\n1,2,3,4,5,6\n"
URDF = b"""<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1"/></joint>
<joint name="k" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 1 0" rpy="1 2 3"/></joint></robot>
"""
POINTINGS = b"Run\n:EQUAT\n31 41 19.6 2021 8 21 13 741 2608 .2\n" + b"".join(
    b"%d 0 0 -0 30 %d 0 0 2015.5 %d 0 5 -0 31 2 3 40.2\n" % (h, h, h) for h in range(9)
)
MODEL = b"Mount\nT 80 0.7 0 0\n  IH 3.0 .1\n= ME -2.0\n& TF 1\n  HDSH3 1 1\nEND\n"
TABLE = b"""joint,type,sign,theta [deg],d [mm],a [m],alpha [deg]
A,R,1,0,400,.025,-90
B,P,-1,20,0,.455,0
C,R,1,-90,0,0.35,-90
"""
TURNTABLE = (EXAMPLES / "machines/rotary_table/machine.toml").read_bytes()
EXPORT = b"""Tracker 7

Axis [deg];Time;Ball;x [mm];y (mm);z [mm];use
0,0;2026-03-01T12:00:00;ball_1;150,1;0,2;30;1
-90,0;2026-03-01T12:01:00;ball_1;0,1;150,2;30;0
-180,0;2026-03-01T12:02:00;ball_1;-150,1;;30;1
"""
ROBOT = b"""name = "r"
units = { length = "mm", angle = "deg" }
joint = [{ name = "j", type = "revolute", axis = [0, 0, 1] }, { name = "k", type = "prismatic", axis = [-1, 0.1, 0] }]
target = [{ name = "c", point = [0, 1000, 0] }]
measured = { kind = "point", frame = "machine" }
effect = [{ name = "zero_offset", joint = "j", hold = { a = 0.5 } }]
"""
TWO_FILES = {
    "c.csv": b"id;j;k\n1;0;0\n2;0,5;0,1\n",
    "t.csv": b"id,x,y,z,time\n2,1,2,3,12:00\n1,4,5,6,12:01\n",
}
LASER = b"""HEADER::
File type  : rtl

TARGET DATA::
Target-count: 3
Targets :
0.0  100.0
200.0
Flags: 0 0 2 0

USER-TEXT::
Axis:X

DEVIATIONS::
Run Target Data:
1 1 0.5
1 2 1.5
1 3 2.0
2 3 5.0

EOF::
"""
FURTHER: list[tuple[str, dict[str, bytes]]] = [
    ("simulate --open t.json", {"t.json": (CORPUS / "truth.json").read_bytes()}),
    (
        "apply tricept.inverse p.csv --set R=330mm --set r=140mm --set limits=568,858mm -o o.csv",
        {"p.csv": b"Qx [mm],Qy [mm],Qz [mm]\n0,0,700\n10,20,650\n"},
    ),
    (
        "apply instantaneous_euler.angles_from_euler a.csv --set sequence=xyz",
        {"a.csv": b"alpha [deg],beta [deg],gamma [deg]\n0,10,20\n5,-8,3\n"},
    ),
    (
        "apply instantaneous_euler.rotations a.csv -o o.parquet --set tolerance=1e-6",
        {"a.csv": b"chi_x [deg],chi_y [deg],chi_z [deg]\n10,20,15\n0,0,0\n"},
    ),
    (
        "apply three_sps_s.direct_all a.csv --set R=200mm --set r=100mm --set h=300mm",
        {"a.csv": b"L1 [mm],L2 [mm],L3 [mm]\n320,330,310\n"},
    ),
    ("effects scale", {}),
    ("new 3-axis --code [w,X,b,Y,Z,t] -o m.toml", {}),
    ("import r.urdf -o m.toml", {"r.urdf": URDF}),
    ("import t.csv --convention modified -o m.toml", {"t.csv": TABLE}),
    ("import t.toml t.txt -d d.csv --column C=-Axis", {"t.toml": TURNTABLE, "t.txt": EXPORT}),
    ("import r.dat m.mod -o m.toml -d d.csv", {"r.dat": POINTINGS, "m.mod": MODEL}),
    ("import t.toml l.rtl -d d.csv", {"t.toml": machine_template("linear-axis").encode(), "l.rtl": LASER}),
    ("import r.urdf c.csv t.csv -o m.toml -d d.csv", {"r.urdf": URDF, **TWO_FILES}),
    (
        "emit m.toml --lang urdf --into r.urdf -o out",
        {"m.toml": ROBOT, "r.urdf": URDF.replace(b"1 2 3", b"0 0 3")},
    ),
]


def originals() -> list[Case]:
    """Return the commands with files that are right."""
    found = []
    for name, joint in MACHINES.items():
        folder = EXAMPLES / "machines" / name
        (data,) = folder.glob("*.csv")
        machine = (folder / "machine.toml").read_bytes()
        for command in COMMANDS:
            if (command.split()[0] in SLOW and name != "rotary_table") or (
                name == "tricept" and "JOINT" in command
            ):
                continue
            noise = "0.5arcsec" if name == "mount" else "2um"
            own = machine
            if command.startswith("remove"):
                own += f'\n[[effect]]\nname = "gravity_windup"\njoint = "{joint}"\n'.encode()
            if "--undo" in command:
                entry = f'[measured]\nset_aside = [{{ rows = "4", file = "{name}.csv", why = "x" }}]\n'
                own = own.replace(b"[measured]\n", entry.encode())
            files = {f"{name}.toml": own, f"{name}.csv": rows(data, 40)}
            if "limits.toml" in command:
                files["limits.toml"] = LIMITS
            found.append(
                Case(
                    tuple(
                        command.replace("NAME", name).replace("JOINT", joint).replace("NOISE", noise).split()
                    ),
                    files,
                )
            )
    pairs = {"p.csv": (EXAMPLES / "pairs.csv").read_bytes()}
    for words in (
        "apply solve_axis p.csv -o s.csv",
        "apply solve_axis p.csv --set length_tolerance=1e-3",
        "fit-axis p.csv --json --sigma 2um",
        "fit-axis p.csv --loss huber --point 1,2,3",
    ):
        found += [Case(tuple(words.split()), pairs)] * 2
    links = {"l.csv": (EXAMPLES / "mechanisms" / "puma_560.csv").read_bytes()}
    pose = {"p.csv": (EXAMPLES / "mechanisms" / "p60_pose.csv").read_bytes()}
    found += [
        Case(("mechanism", "reverse", "l.csv", "p.csv", "--from", "matrix"), {**links, **pose}),
        Case(("mechanism", "forward", "puma_560", "q.csv"), {"q.csv": JOINTS}),
    ]  # fmt: skip
    return found + [Case(tuple(words.split()), files) for words, files in FURTHER]


# searching --------------------------------------------------------------------------------------------


def drawn(seed: int, number: int) -> tuple[Case, list[int]]:
    """Return the case of a number that is changed, and the seeds of its changes."""
    rng = random.Random(seed * 1_000_003 + number)
    cases = originals()
    case = cases[rng.randrange(len(cases))]
    if case.arguments[0] in SLOW and rng.random() < 0.7:  # one of them takes as long as ten others
        case = rng.choice([each for each in cases if each.arguments[0] not in SLOW])
    return case, [rng.randrange(1 << 40) for _ in range(rng.choice([1, 1, 1, 2, 2, 3, 5]))]


def made(case: Case, seeds: list[int]) -> Case:
    """Return a case with all changes."""
    for seed in seeds:
        case = changed(case, seed)
    return case


def smaller(case: Case, fault: str, folder: Path) -> Case:
    """Return a case with fewer lines, of which the command does the same."""
    stop = time.monotonic() + 60
    for name in sorted(case.files):
        size = len(case.files[name].splitlines()) // 2
        while size and time.monotonic() < stop:
            lines = case.files[name].splitlines(keepends=True)
            for at in range(0, len(lines), size):
                less = replace(case, files={**case.files, name: b"".join(lines[:at] + lines[at + size :])})
                if kind_of(fault_of(less, folder)) == kind_of(fault):
                    case = less
                    break
            else:
                size //= 2
    return case


def search(seed: int, numbers: range, seconds: float, folder: Path) -> list[tuple[str, Case]]:
    """Return the faults of the cases of these numbers, one of each kind, as small as they become."""
    found: dict[str, tuple[str, Case]] = {}
    stop = time.monotonic() + seconds
    for number in numbers:
        if time.monotonic() > stop:
            print(f"{number - numbers.start} cases in {seconds:g} s")
            break
        original, seeds = drawn(seed, number)
        (folder / "running").write_text(f"FUZZ_SEED={seed}, case {number}\n")  # where the process is killed
        fault = fault_of(made(original, seeds), folder)
        if fault and kind_of(fault) not in found:
            for each in list(seeds):  # without the changes that are not needed
                fewer = [one for one in seeds if one != each]
                if kind_of(fault_of(made(original, fewer), folder)) == kind_of(fault):
                    seeds = fewer
            case = smaller(made(original, seeds), fault, folder)
            found[kind_of(fault)] = (fault, case)
            print(
                f"seed {seed}, case {number}: rodgen {' '.join(case.arguments)[:200]}\n  {fault[:400]}",
                flush=True,
            )
    return list(found.values())


def run() -> int:
    """Search with the seed of the day, or a given one, and keep what is found."""
    today = int(datetime.datetime.now(datetime.UTC).strftime("%Y%m%d"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=today)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=600)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(f"FUZZ_SEED={options.seed}; {folder}/running names the case that runs", flush=True)
        numbers = range(options.first, options.first + options.cases)
        faults = search(options.seed, numbers, options.seconds, Path(folder))
    for fault, case in faults:
        name = (
            f"{case.arguments[0]}-{hashlib.sha256(fault.encode()).hexdigest()[:8]}"
            if case.arguments
            else "none"
        )
        case.save(KEPT / name)
        print(f"kept: {KEPT / name}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(run())
