"""Transcripts of commands: what each prints, its exit code, and the files that it writes.

A session is a folder with files, and commands that are called in it one after the other, as a user does.
"""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import html
import io
import json
import os
import re
import shlex
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import fuzz
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

import rodgen
from rodgen.cli.main import main

EXAMPLES = Path(__file__).parent.parent / "examples"
LONGEST = 6000
"""Characters of an output or a file that are kept; of a longer one the first, and a digest of the whole."""
LIMITS = fuzz.LIMITS.decode()
POINTS = "Qx [mm],Qy [mm],Qz [mm]\n0,0,700\n10,20,650\n"
ATTITUDES = "alpha [deg],beta [deg],gamma [deg]\n0,10,20\n5,-8,3\n"
TIMES = {
    r"(proved|refuted) +\d+(?=  )": r"\1 TIME",
    r"\d+\.\d s in proofs": "TIME in proofs",
    r'"seconds": [\d.e-]+': '"seconds": 0',
}
"""What differs from one run to the next, and what stands there instead."""
COMMANDS = """check fit compare diagnose plan predict report fleet watch open add remove exclude set
emit simulate effects new import apply fit-axis mechanism derive kernels doctor completion"""
CHI = "chi_x [deg],chi_y [deg],chi_z [deg]\n10,20,15\n0,0,0\n"
LEGS = "L1 [mm],L2 [mm],L3 [mm]\n320,330,310\n"


def of_example(name: str, **more: str | bytes) -> dict[str, str | bytes]:
    """Return the files of an example, m.toml and d.csv."""
    (data,) = (EXAMPLES / "machines" / name).glob("*.csv")
    return {"m.toml": (data.parent / "machine.toml").read_bytes(), "d.csv": data.read_bytes(), **more}


def of_field(*names: str) -> dict[str, str | bytes]:
    """Return files from the field, each in its folder."""
    return {name: (Path(__file__).parent / "field" / name).read_bytes() for name in names}


def of_fleet() -> dict[str, str | bytes]:
    """Return three machines of a fleet: one table, measured thrice with other rows left out."""
    files = of_example("rotary_table")
    header, *rows = bytes(files["d.csv"]).splitlines(keepends=True)
    few = {f"data/t{n}.csv": header + b"".join(rows[n::3]) for n in range(3)}
    return {"m.toml": files["m.toml"], **few, "data/broken.csv": b"C [deg]\n1\n"}


def _without_angle() -> bytes:
    """Return the pairs of the example without their angles: three balls make each of its moves."""
    rows = [line.split(b",") for line in (EXAMPLES / "pairs.csv").read_bytes().splitlines()]
    return b"".join(b",".join(row[:6] + row[7:]) + b"\n" for row in rows)


SESSIONS: dict[str, tuple[dict[str, str | bytes], str]] = {
    "telescope": (
        of_example("mount", **{"new.csv": fuzz.rows(EXAMPLES / "machines/mount/mmt_2021.csv", 20)}),
        """
        check m.toml d.csv
        fit m.toml d.csv -o f.toml --residuals r.csv
        fit m.toml d.csv --loss huber --json
        compare m.toml d.csv
        compare m.toml d.csv --json --plot c.html
        diagnose m.toml d.csv
        diagnose m.toml d.csv --json -o better.toml
        fit better.toml d.csv
        compare better.toml d.csv
        add m.toml gravity_windup d.csv --joint EL --hold k2=0 -o a.toml
        remove a.toml gravity_windup d.csv --joint EL -o b.toml --json
        emit better.toml d.csv --lang tpoint -o tpoint
        emit better.toml d.csv --lang c -o c
        predict better.toml d.csv new.csv -o p.csv
        watch better.toml new.csv --reference d.csv --state s.watch
        plan m.toml d.csv -n 4 -o plan.csv
        report m.toml d.csv -o report.html
        """,
    ),
    "five axes": (
        of_example("trunnion"),
        """
        diagnose m.toml d.csv
        diagnose m.toml d.csv --json -o better.toml
        compare better.toml d.csv --json
        emit better.toml d.csv --lang iso230 -o iso230 --json
        emit better.toml d.csv --lang screw -o screw
        emit better.toml d.csv --lang map -o map
        emit better.toml d.csv --lang linuxcnc -o linuxcnc
        emit better.toml d.csv --lang cpp -o cpp
        emit better.toml d.csv --lang numpy -o numpy
        emit better.toml d.csv --lang matlab -o matlab
        emit better.toml d.csv --lang jax -o jax
        fit better.toml d.csv --json
        """,
    ),
    "gantry": (
        of_example("gantry_rotary", **{"limits.toml": LIMITS}),
        """
        diagnose m.toml d.csv
        diagnose m.toml d.csv --json
        compare m.toml d.csv
        set m.toml C.axis.a --prior 0±9arcsec -o p.toml
        set m.toml C.axis.a --tie 2*C.axis.b -o t.toml --json
        fit p.toml d.csv --json
        exclude m.toml d.csv --rows 3-5,9 --why clouds -o s.toml
        fit s.toml d.csv
        exclude --undo s.toml d.csv --rows 4 -o s.toml --json
        plan m.toml d.csv -n 3 --constraints limits.toml --json
        emit m.toml d.csv --lang screw -o screw
        """,
    ),
    "ballbar": (of_example("ballbar_gantry"), "diagnose m.toml d.csv\nfit m.toml d.csv"),
    "palletiser": (of_example("palletiser"), "diagnose m.toml d.csv\nfit m.toml d.csv"),
    "positioner": (of_example("positioner"), "diagnose m.toml d.csv\nfit m.toml d.csv"),
    "arm": (
        of_example("robot_6r_tracker"),
        """
        fit m.toml d.csv -o f.toml
        emit f.toml --lang dh -o dh
        emit f.toml --lang urdf -o urdf
        """,
    ),
    "legs": (
        of_example("tricept", **{"p.csv": POINTS}),
        """
        diagnose m.toml d.csv
        emit m.toml d.csv --lang c -o c
        apply tricept.inverse p.csv --set R=330mm --set r=140mm -o legs.csv
        apply tricept.direct_all legs.csv --set R=330mm --set r=140mm
        """,
    ),
    "spheres": (
        of_example("three_sps_s", **{"a.csv": ATTITUDES, "chi.csv": CHI, "l.csv": LEGS}),
        """
        diagnose m.toml d.csv
        apply instantaneous_euler.angles_from_euler a.csv
        apply instantaneous_euler.rotations chi.csv
        apply three_sps_s.direct_all l.csv --set R=200mm --set r=100mm --set h=300mm
        """,
    ),
    "table": (
        of_example("rotary_table", **{"truth.json": (fuzz.CORPUS / "truth.json").read_bytes()}),
        """
        diagnose m.toml d.csv
        simulate m.toml d.csv --effect encoder_eccentricity@C:a=9arcsec --seed 3 -o s.csv
        simulate m.toml d.csv --hidden --truth t.json --seed 4 -o h.parquet --json
        simulate --open truth.json
        check m.toml s.csv
        diagnose m.toml s.csv
        add m.toml own --joint C --formula k*cos(q) --parameter k=1 --hold k=2 -o own.toml
        add m.toml scale --joint C
        """,
    ),
    "wrong file": (
        of_example("rotary_table", **{"m.toml": fuzz.TURNTABLE.replace(b"[0, 0, 1]", b"[0, 0, -1]", 1)}),
        """
        check m.toml d.csv -o repaired.toml
        check m.toml d.csv --json
        fit m.toml d.csv
        diagnose m.toml d.csv
        emit m.toml d.csv --lang c -o c
        """,
    ),
    "pairs": (
        {"p.csv": (EXAMPLES / "pairs.csv").read_bytes()},
        """
        apply solve_axis p.csv
        apply solve_axis p.csv -o s.parquet
        fit-axis p.csv
        fit-axis p.csv --json --sigma 2um
        fit-axis p.csv --loss huber --point 1,2,3
        fit-axis p.csv --sigma 4um --sigma-angle 5arcsec --near 0,0,0
        """,
    ),
    "poses": (
        {"p.csv": (EXAMPLES / "poses.csv").read_bytes(), "t.csv": _without_angle()},
        """
        fit-axis p.csv
        fit-axis p.csv --json --sigma 30um --sigma-angle 0.1mrad --near 0,0,0
        fit-axis p.csv --instantaneous --near 0,0,0 -o axes.csv
        fit-axis t.csv
        fit-axis t.csv --loss huber
        fit-axis t.csv --instantaneous
        """,
    ),
    "mechanisms": (
        {
            "l.csv": (EXAMPLES / "mechanisms/puma_560.csv").read_bytes(),
            "p60.csv": (EXAMPLES / "mechanisms/ge_p60.csv").read_bytes(),
            "q.csv": fuzz.JOINTS,
            "pose.csv": (EXAMPLES / "mechanisms/p60_pose.csv").read_bytes(),
        },
        """
        mechanism forward l.csv q.csv
        mechanism reverse l.csv q.csv
        mechanism reverse p60.csv pose.csv --from matrix
        """,
    ),
    "imports": (
        {
            "r.urdf": fuzz.URDF,
            "dh.csv": fuzz.TABLE,
            "r.dat": fuzz.POINTINGS,
            "m.mod": fuzz.MODEL,
            "t.toml": fuzz.TURNTABLE,
            "t.txt": fuzz.EXPORT,
        },
        """
        import r.urdf -o urdf.toml
        import dh.csv --convention modified -o dh.toml
        import r.dat m.mod -o sky.toml -d sky.csv
        import t.toml t.txt -d d.csv --column C=-Axis
        new turntable
        new table-table --balls 3 -o balls.toml
        new
        effects
        effects scale --json
        """,
    ),
    "field": (
        of_field(
            "axis_pairs/shared.csv",
            "axis_pairs/slide.csv",
            "coaxial_dh_table/other.csv",
            "point_column/dh.csv",
            "point_column/cal.csv",
            "arm_of_dh_table/cal.csv",
            "balls/machine.toml",
            "balls/probing.csv",
            "constant_commands/machine.toml",
            "constant_commands/data.csv",
            "parallel_joints/machine.toml",
            "parallel_joints/data.csv",
            "angle_of_one_axis/machine.toml",
            "angle_of_one_axis/good_full_turn.csv",
            "five_outliers/better.toml",
            "five_outliers/data.csv",
        ),
        """
        fit-axis axis_pairs/shared.csv
        fit-axis axis_pairs/slide.csv --sigma 0.01mm
        import coaxial_dh_table/other.csv --convention standard -o coaxial.toml
        import point_column/dh.csv point_column/cal.csv --convention standard -o points.toml -d points.csv
        import point_column/dh.csv arm_of_dh_table/cal.csv --convention standard -o arm.toml -d arm.csv
        fit arm.toml arm.csv -o fitted.toml
        emit fitted.toml --lang dh -o dh
        import balls/machine.toml balls/probing.csv -d p.csv --column 'x=X meas [mm]' \
--column 'y=Y meas [mm]' --column 'z=Z meas [mm]'
        check constant_commands/machine.toml constant_commands/data.csv
        check parallel_joints/machine.toml parallel_joints/data.csv
        check angle_of_one_axis/machine.toml angle_of_one_axis/good_full_turn.csv
        emit five_outliers/better.toml five_outliers/data.csv --lang map -o map
        emit five_outliers/better.toml five_outliers/data.csv --lang screw -o screw
        """,
    ),
    "fleet": (of_fleet(), "fleet m.toml data -o results --jobs 1 --date 2026-11-20\nreport results -o fleet.html"),
    "equations": ({}, """
        derive rodrigues
        kernels axis -o out
        kernels rodrigues -o none
        completion bash
        doctor --json
        """),
    "help": (
        {},
        "--version\n--help\n" + "\n".join(f"{command} --help" for command in COMMANDS.split()),
    ),
    "refusals": (
        of_example("rotary_table"),
        """
        nonsense
        fit m.toml
        fit m.toml none.csv
        fit d.csv m.toml
        fit m.toml d.csv -o m.toml
        diagnose m.toml d.csv --test m.toml
        add m.toml encoder_excentricity --joint C
        emit m.toml d.csv --lang java
        open none.toml
        apply solve_axis d.csv
        fleet m.toml . -o d.csv
        """,
    ),
}  # fmt: skip


def cases() -> list[str]:
    """Return the names of the sessions."""
    return list(SESSIONS)


def answers(case: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a record of each command of a session."""
    files, commands = SESSIONS[case]
    with TemporaryDirectory() as folder, working_in(folder):
        for name, content in files.items():
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
        for number, command in enumerate(map(str.strip, commands.strip().splitlines()), 1):
            before = contents()
            record = ran(shlex.split(command))
            if command.startswith("doctor"):  # which says what this computer has
                record = {"out": [line for line in record["out"] if re.match(" {0,2}[^ ]", line)]}
                record["out"] = [re.sub(r": .*", "", line) for line in record["out"]]
            written = {n: c for n, c in contents().items() if before.get(n) != c}
            record["files"] = {n: lines_of(text_of(n, c)) for n, c in written.items()}
            yield f"{case} {number:02}: rodgen {command}", record


@contextlib.contextmanager
def working_in(folder: str) -> Iterator[None]:
    """Work in a folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def ran(arguments: Sequence[str]) -> dict[str, Any]:
    """Call a command in the current folder; return exit code and output, without what is of this computer."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    with (
        mock.patch.object(sys, "stdout", out),
        mock.patch.object(sys, "stderr", err),
        mock.patch.object(sys, "stdin", io.TextIOWrapper(io.BytesIO())),
        mock.patch.dict(os.environ, COLUMNS="120"),
        warnings.catch_warnings(),
    ):
        code = main(list(arguments))
        printed = [stream.buffer.getvalue().decode() for stream in (out, err)]
    return {"exit code": code} | dict(zip(("out", "err"), map(lines_of, printed), strict=True))


def contents() -> dict[str, bytes]:
    """Return all files in the current folder."""
    return {str(p): p.read_bytes() for p in sorted(Path().rglob("*")) if p.is_file()}


def text_of(name: str, content: bytes) -> str:
    """Return a file as text: a table as CSV, of a page what one reads there."""
    if name.endswith(".parquet"):
        out = io.BytesIO()
        pa_csv.write_csv(pq.read_table(io.BytesIO(content)), out)
        content = out.getvalue()
    if name.endswith(".gz"):
        content = gzip.decompress(content)
    if b"\0" in content:
        return f"{len(content)} bytes"
    text = content.decode()
    if name.endswith(".json") and len(text.splitlines()) == 1:
        text = json.dumps(json.loads(text), indent=1, ensure_ascii=False)
    if name.endswith(".html"):
        text = re.sub(r"<(script|style)\b.*?</\1>", " ", text, flags=re.DOTALL)
        text = html.unescape(re.sub(r"\s*\n\s*", "\n", re.sub(r"<[^>]*>", "\n", text)))
    return text


def lines_of(text: str) -> list[str]:
    """Return the lines of a text without paths, times, version and digits beyond the ninth."""
    text = text.replace(str(Path.cwd()), "FOLDER").replace(rodgen.__version__, "VERSION")
    for pattern, instead in TIMES.items():
        text = re.sub(pattern, instead, text)
    text = re.sub(r"-?\d+\.\d{7,}(e[-+]?\d+)?", lambda number: f"{float(number[0]):.9g}", text)
    lines = text.splitlines()
    kept, length = 0, 0
    while kept < len(lines) and length + len(lines[kept]) < LONGEST:
        length += len(lines[kept])
        kept += 1
    if kept == len(lines):
        return lines
    rounded = re.sub(r"-?\d+\.\d{6,}(e[-+]?\d+)?", lambda number: f"{float(number[0]):.5g}", text)
    digest = hashlib.sha256(rounded.encode()).hexdigest()[:16]
    return [*lines[:kept], f"... {len(lines)} lines, digest of all {digest}"]
