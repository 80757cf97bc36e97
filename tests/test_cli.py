"""The command line: what it prints where, its exit codes, and that nothing it is given makes it crash."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from browser import needs_browser
from commands import run, run_process

from rodgen.cli import main as cli
from rodgen.codegen import scripts
from rodgen.codegen.build_cache import source_hash

HEADER = "rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]"
PAIRS = f"""{HEADER}
3,4,12,12,-3,4,120
1,0,0,0,1,0,45
"""
AXIS = np.array([0.02, -0.01, 1]) / np.linalg.norm([0.02, -0.01, 1])
POINT = np.array([5.0, -3.0, 0.0])


@pytest.fixture
def pairs(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_text(PAIRS)
    return path


def measured(n=40, noise=0.005, seed=3):
    """Pairs about one axis, as a machine would measure them."""
    rng = np.random.default_rng(seed)
    rho = rng.uniform(-1, 1, (n, 3)) * [150, 150, 60] + [0, 0, 40]
    angle = np.deg2rad(rng.choice([30.0, 60, 90, 120, -45], n))
    arm = rho - POINT
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = POINT + arm * cos + np.cross(AXIS, arm) * sin + AXIS * (arm @ AXIS)[:, None] * (1 - cos)
    return rho + noise * rng.normal(size=rho.shape), turned + noise * rng.normal(size=rho.shape), angle


@pytest.fixture
def measured_file(tmp_path):
    rho, rho_prime, angle = measured()
    values = [*rho.T, *rho_prime.T, np.rad2deg(angle)]
    path = tmp_path / "measured.parquet"
    table = dict(zip(HEADER.split(","), map(np.ascontiguousarray, values), strict=True))
    pq.write_table(pa.table(table), path)
    return path


# the command itself ------------------------------------------------------------------------------------


def test_help_documents_the_exit_codes_and_imports_nothing_heavy():
    code = (
        "import sys, rodgen.cli.main\n"
        "assert rodgen.cli.main.main(['diagnose', '--help']) == 0\n"
        "assert 'numpy' not in sys.modules and 'rodgen.cli.fit' not in sys.modules\n"
        "assert rodgen.cli.main.main(['--help']) == 0\n"
        "heavy = {'sympy', 'pyarrow', 'pint', 'scipy', 'matplotlib', 'plotly', 'jinja2', 'tqdm'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for word in ("apply", "fit-axis", "derive", "kernels", "exit codes:", "2  bad input: one line"):
        assert word in shown.stdout


def commands_by_group(text):
    """Read the groups of commands from the help of rodgen: their names, and those of their commands."""
    sections = re.findall(r"^(\w[^\n]*):\n((?:  .*\n)+)", text, re.MULTILINE)
    return {
        title: re.findall(r"^  ([a-z][a-z-]*)", rows, re.MULTILINE)
        for title, rows in sections
        if title not in ("options", "exit codes")
    }


def test_help_lists_every_command_once(capsys):
    assert cli.main(["--help", "fit"]) == 0
    text = capsys.readouterr().out
    listed = [name for names in commands_by_group(text).values() for name in names]
    assert cli.main(["--help"]) == 0
    assert capsys.readouterr().out == text
    assert cli.main(["frobnicate"]) == 2
    choices = re.findall(r"[a-z-]+", capsys.readouterr().err.partition("choose from")[2].partition(")")[0])
    assert sorted(listed) == sorted(choices)
    assert len(listed) > 20


@pytest.mark.thorough
def test_solving_never_imports_sympy_nor_what_other_commands_need(pairs, tmp_path):
    code = (
        "import sys, rodgen.cli.main\n"
        "assert rodgen.cli.main.main(['apply', 'solve_axis', sys.argv[1], '-o', sys.argv[2]]) == 0\n"
        "subjects = ('tricept', 'instantaneous_euler', 'three_sps_s', 'spatial')\n"
        "other = {f'rodgen.kinematics.{name}' for name in subjects}\n"
        "heavy = {'sympy', 'matplotlib', 'plotly', 'tqdm', 'rodgen.symbolic', *other} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code, pairs, tmp_path / "out.csv"], check=True, capture_output=True)


USAGE = [
    "",
    "frobnicate",
    "diagnos",
    "-x",
    "fit-axis",
    "fit-axis x.csv --fast",
    "apply f x.csv --sett",
    "fit-axis x.csv --point 1,2",
    "fit-axis x.csv --point 1,2,inf",
    "fit-axis x.csv --sigma 0.01",
    "fit-axis x.csv --sigma 0mm",
    "fit-axis x.csv --loss l1",
]


@pytest.mark.parametrize("words", USAGE)
def test_wrong_usage_is_one_line_and_code_2(refuses_command, words):
    refuses_command(*words.split())


# tables ------------------------------------------------------------------------------------------------


def test_apply_reads_a_pipe_and_writes_one(pairs):
    from_file, from_pipe = (
        run("apply", "solve_axis", pairs),
        run("apply", "solve_axis", "-", "-o", "-", stdin=PAIRS),
    )
    assert from_pipe.returncode == 0
    assert from_pipe.stdout == from_file.stdout
    assert from_pipe.stderr.startswith("standard input: 2 rows written: ")


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz", "out.parquet"])
def test_apply_writes_a_file_and_nothing_to_stdout(name, pairs, tmp_path, capfd):
    assert cli.main(["apply", "solve_axis", str(pairs), "-o", str(tmp_path / name)]) == 0
    out, err = capfd.readouterr()
    assert out == ""
    assert err == f"{pairs}: 2 rows written: 1 two_axes, 1 no_axis\n"
    table = pq.read_table(tmp_path / name) if name.endswith("parquet") else pa_csv.read_csv(tmp_path / name)
    assert table["status"].to_pylist() == ["two_axes", "no_axis"]


BAD = {
    "missing": None,
    "nan": PAIRS.replace("45", "nan"),
    "unit": PAIRS.replace("[deg]", "[mm]"),
    "ragged": PAIRS + "1,2\n",
    "binary": bytes(range(256)) * 8,
    "parquet": b"PAR1" + b"\0" * 100,
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("command", ["apply solve_axis", "fit-axis"])
def test_bad_input_is_one_line_on_stderr_and_code_2(command, name, tmp_path, refuses_command):
    path, output = tmp_path / "bad.csv", tmp_path / "out.csv"
    if BAD[name] is not None:
        path.write_bytes(BAD[name] if isinstance(BAD[name], bytes) else BAD[name].encode())
    refuses_command(*command.split(), path, *([] if command == "fit-axis" else ["-o", output]))


def test_fault_at_the_end_leaves_stdout_empty(tmp_path):
    """Though the first rows were long computed, none of them is printed."""
    path = tmp_path / "bad.csv"
    path.write_text(PAIRS + "3,4,12,12,-3,4,120\n" * 100_000 + "3,4,12,12,-3,4,x\n")
    shown = run("apply", "solve_axis", path)
    assert (shown.returncode, shown.stdout) == (2, "")
    assert shown.stderr == f"{path}: line 100004, column 'angle [deg]': 'x'; expected a number\n"


@pytest.mark.thorough("arguments1")
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
@pytest.mark.parametrize(
    "arguments",
    [
        ("apply", "solve_axis", "-"),
        ("--help",),
        ("apply", "solve_axis", "-", "-o", "/dev/full"),
        ("fit-axis", "-"),
    ],
)
def test_full_stdout_is_one_line(arguments):
    # Unbuffered, argparse writes at once and takes no notice of a failure.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        shown = subprocess.run(
            [sys.executable, "-m", "rodgen", *arguments],
            input=PAIRS,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=60,
            env=environment,
        )
    assert shown.returncode == 2
    assert ": file: cannot be written (No space left on device); expected a writable place" in shown.stderr
    assert shown.stderr.count("\n") == 1


@pytest.mark.parametrize("stream", ["stdin", "stdout"])
def test_closed_streams_are_an_error(stream):
    redirect = {"stdin": "<&-", "stdout": ">&-"}[stream]
    shown = subprocess.run(
        f"exec '{sys.executable}' -m rodgen apply solve_axis - {redirect}",
        shell=True, input=PAIRS, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert shown.returncode == 2
    assert "standard " in shown.stderr
    assert ": file: closed; expected " in shown.stderr
    assert shown.stderr.count("\n") == 1


@pytest.mark.thorough
def test_reader_that_has_seen_enough_ends_the_command_quietly(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_text(PAIRS + "3,4,12,12,-3,4,120\n" * 20_000)
    command = subprocess.Popen(
        [sys.executable, "-m", "rodgen", "apply", "solve_axis", path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    command.stdout.readline()
    command.stdout.close()
    with command.stderr:
        assert command.stderr.read() == b""
    assert command.wait(60) == 141


# fit-axis ----------------------------------------------------------------------------------------------


def json_fit(capsys, path, *options, code=0):
    assert cli.main(["fit-axis", str(path), "--json", *options]) == code
    return json.loads(capsys.readouterr().out)


def test_point_may_be_given(measured_file, capsys):
    free = json_fit(capsys, measured_file)
    known = json_fit(capsys, measured_file, "--point", "5,-3,0")
    assert not free["point_known"]
    assert known["point_known"]
    assert known["point"] == [5, -3, 0]
    assert json_fit(capsys, measured_file, "--point", "origin")["point"] == [0, 0, 0]
    assert json_fit(capsys, measured_file, "--point", "-1,.5,3e0")["point"] == [-1, 0.5, 3]
    assert json_fit(capsys, measured_file, "--point=-1,.5,3e0")["point"] == [-1, 0.5, 3]


def test_sigma_is_in_its_own_unit(measured_file, capsys):
    fits = [json_fit(capsys, measured_file, "--sigma", s) for s in ("0.01mm", "10 um", "1e-5m")]
    for fit in fits:
        assert fit["sigma"] == pytest.approx(0.01, rel=1e-15)  # one product
        assert fit["sigma_given"]


def test_fit_that_cannot_be_done_is_one_line(pairs, capsys):
    assert cli.main(["fit-axis", str(pairs), "--loss", "huber"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"{pairs}: ")


def test_fit_of_undetermined_data_says_so(tmp_path, capsys):
    path = tmp_path / "pairs.csv"
    path.write_text(f"{HEADER}\n1,0,0,1,0,0,0\n0,1,0,0,1,0,0\n")
    fit = json_fit(capsys, path, code=3)
    assert fit["status"] != "DETERMINED"
    assert fit["undetermined"]


@pytest.mark.parametrize("kind", ["html", pytest.param("png", marks=[needs_browser, pytest.mark.slow])])
def test_plot_is_drawn_and_reproducible(kind, measured_file, tmp_path, capsys):
    start = {"html": b"<!DOCTYPE html>", "png": b"\x89PNG"}[kind]
    contents = []
    for name in ("a", "b"):
        assert cli.main(["fit-axis", str(measured_file), "--plot", str(tmp_path / f"{name}.{kind}")]) == 0
        contents.append((tmp_path / f"{name}.{kind}").read_bytes())
    assert contents[0].startswith(start)
    assert contents[0] == contents[1]
    assert "direction" in capsys.readouterr().out


@pytest.mark.parametrize("rows", ["1,0,0,0,1,0,90", "1,0,0,1,0,0,0", "0,0,0,0,0,0,10", "5,-3,1,5,-3,1,30"])
def test_plot_survives_degenerate_pairs(rows, tmp_path, capsys):
    path = tmp_path / "pairs.csv"
    path.write_text(f"{HEADER}\n{rows}\n")
    assert cli.main(["fit-axis", str(path), "--plot", str(tmp_path / "plot.html")]) == 3  # not determined
    assert (tmp_path / "plot.html").stat().st_size > 10_000
    out, err = capsys.readouterr()
    assert err == ""
    assert "Axis fitted to 1 pair (" in out
    assert " of 1 pair counts\n" in out


# derive, kernels ---------------------------------------------------------------------------------------


LENS = """\
# %% [markdown]
# # The thin lens
# %%
import sympy as sp
from rodgen.symbolic import Derivation

derivation = Derivation("lens", title="The thin lens", source="Any textbook")
d = derivation
f = d.symbol("f", "f", "focal length", "mm", positive=True)
a = d.symbol("a", "a", "object distance", "mm", positive=True)
b = d.symbol("b", "b", "image distance", "mm", value=a * f / (a - f))
d.state("lens-equation", sp.Eq(1 / a + 1 / b, 1 / f), place="eq. (1)").prove()
# %%
wrong = d.state("magnification", sp.Eq(b / a, f / (f - a)), place="eq. (2)")
wrong.refute({a: 3, f: 1}, sp.Eq(b / a, f / (a - f)), because="The sign.", label="L1")
"""


@pytest.fixture
def lens(tmp_path):
    path = tmp_path / "lens.py"
    path.write_text(LENS)
    return path


def test_derive_runs_a_script_and_prints_its_report(lens):
    shown = run("derive", lens)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "The thin lens (Any textbook)" in shown.stdout
    assert "1 proved, 1 refuted, 0 open" in shown.stdout


def test_derive_fails_while_an_entry_is_open(lens, capsys):
    lens.write_text(f'{LENS}\nd.state("open", sp.Eq(a, b))\n')
    assert cli.main(["derive", str(lens)]) == 1
    assert "1 open" in capsys.readouterr().out


SCRIPTS = {
    "no proof": (f'{LENS}\nd.state("x", sp.Eq(a, b)).prove()\n', 1),
    "raises": ("x = 1\ny = x / 0\n", 2),
    "no Python": ("x = (1,\n", 2),
    "ends itself": ("import sys\nsys.exit('enough')\n", 2),
    "no derivation": ("x = 1\n", 2),
    "wrong type": ("derivation = 3\n", 2),
    "not UTF-8": (b"x = '\xff'\n", 2),
}


@pytest.mark.parametrize("name", SCRIPTS)
@pytest.mark.parametrize("command", ["derive", "kernels"])
def test_script_that_fails_is_one_line(command, name, tmp_path, refuses_command):
    content, code = SCRIPTS[name]
    path = tmp_path / "script.py"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refuses_command(command, path, code=code)


def test_error_for_an_unknown_derivation_lists_the_known_ones(capsys, tmp_path):
    assert cli.main(["derive", "rodriges"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("rodriges: file: no such derivation; expected ")
    assert "rodrigues" in err
    assert cli.main(["derive", str(tmp_path / "nowhere.py")]) == 2
    assert capsys.readouterr().err.endswith("nowhere.py: file: no such file; expected a derivation script\n")


def test_script_finds_its_neighbours(tmp_path, capsys):
    (tmp_path / "neighbour_of_lens.py").write_text("NAME = 'lens'\n")
    (tmp_path / "script.py").write_text(f"from neighbour_of_lens import NAME\n{LENS}")
    before = list(sys.path)
    assert cli.main(["derive", str(tmp_path / "script.py")]) == 0
    assert sys.path == before
    sys.modules.pop("neighbour_of_lens")
    capsys.readouterr()


@pytest.mark.slow  # Jupyter is installed for make test-slow only
def test_derive_writes_a_notebook_with_what_it_shows(lens, tmp_path, capsys):
    pytest.importorskip("nbclient")
    output = tmp_path / "lens.ipynb"
    assert cli.main(["derive", str(lens), "--notebook", str(output)]) == 0
    notebook = json.loads(output.read_text())
    assert [cell["cell_type"] for cell in notebook["cells"]] == [
        "markdown",
        "code",
        "code",
        "markdown",
        "code",
    ]
    assert "Refuted (L1)" in json.dumps(notebook["cells"][2]["outputs"])
    assert "focal length" in json.dumps(notebook["cells"][4]["outputs"])
    assert "focal length" in json.dumps(notebook["cells"][4]["outputs"])  # all symbols
    assert "1 proved, 1 refuted" in capsys.readouterr().out
    assert str(tmp_path) not in output.read_text()


def test_notebook_needs_a_name_and_a_folder(lens, tmp_path, capsys):
    assert cli.main(["derive", str(lens), "--notebook", str(tmp_path / "lens.html")]) == 2
    assert ": file: a name without a known ending; expected a name that ends in .ipynb" in (
        capsys.readouterr().err
    )
    assert cli.main(["derive", str(lens), "--notebook", str(tmp_path / "nowhere" / "lens.ipynb")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


# warnings ----------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    "setting", ["error", *(pytest.param(s, marks=pytest.mark.slow) for s in ("default", "ignore"))]
)
def test_warnings_are_one_line_each_and_stop_nothing(setting, lens):
    lens.write_text(
        textwrap.dedent("""
        import warnings
        for _ in range(3):
            warnings.warn("no compiler:\\n   slow", stacklevel=1)
            warnings.warn("for developers", DeprecationWarning, stacklevel=1)
        """)
        + LENS
    )
    shown = run_process("derive", lens, env=os.environ | {"PYTHONWARNINGS": setting})
    assert shown.returncode == 0
    assert shown.stderr == "rodgen: warning: no compiler: slow\n"


# kernels -----------------------------------------------------------------------------------------------


KERNEL = """
from rodgen.codegen import KernelBuilder

k = KernelBuilder("image_distance", summary="Distance of the image of a thin lens", source="Any textbook, eq. (1)")
focal, object_distance = k.input("focal", unit="mm", doc="f"), k.input("object_distance", unit="mm", doc="a")
k.output("image", object_distance * focal / (object_distance - focal), unit="mm", doc="b")
derivation.kernel(k.build())
"""


@pytest.mark.thorough
def test_kernels_are_derived_again_only_where_a_source_has_changed(monkeypatch, tmp_path):
    derived, found, sources = [], scripts.load_derivation, {}
    monkeypatch.setenv("RODGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(scripts, "load_derivation", lambda name: derived.append(name) or found(name))
    for name in ("instantaneous_euler", "rotations"):  # the first imports the second
        sources[name] = tmp_path / f"{name}.py"
        sources[name].write_text(scripts.script_path(name).read_text())
    path = scripts.script_path
    monkeypatch.setattr(scripts, "script_path", lambda name: sources.get(name) or path(name))
    first = scripts.kept_kernels("instantaneous_euler")
    assert "c/instantaneous_euler.c" in first.files
    assert scripts.kept_kernels("instantaneous_euler") == first
    assert derived == ["instantaneous_euler"]
    sources["rotations"].write_text(sources["rotations"].read_text() + "# changed\n")
    source_hash.cache_clear()
    assert scripts.kept_kernels("instantaneous_euler") == first
    assert derived == ["instantaneous_euler"] * 2


def test_kernels_are_written_and_compared(lens, tmp_path, capsys):
    lens.write_text(LENS + KERNEL)
    folder = tmp_path / "out"
    assert cli.main(["kernels", str(lens), "-o", str(folder), "--check"]) == 1
    out, err = capsys.readouterr()
    assert "+++ regenerated/c/lens.c" in out
    assert err == (
        f"{folder}: differs from what the derivations generate; 'rodgen kernels {lens} -o {folder}' regenerates it\n"
    )
    assert not folder.exists()

    assert cli.main(["kernels", str(lens), "-o", str(folder)]) == 0
    written = capsys.readouterr().out.split()
    assert f"{folder}/numpy/lens.py" in written
    assert f"{folder}/c/lens.h" in written
    assert cli.main(["kernels", str(lens), "-o", str(folder), "--check"]) == 0
    assert cli.main(["kernels", str(lens), "-o", str(folder)]) == 0
    said = f"{folder}: the files are there already, as they would be written\n"
    assert capsys.readouterr() == ("", said)  # nothing differs, nothing is written

    code = "import numpy, lens; print(lens.image_distance(numpy.float64(50.0), numpy.float64(75.0)))"
    made = subprocess.run(
        [sys.executable, "-c", code], cwd=folder / "numpy", capture_output=True, text=True, check=True
    )
    assert float(made.stdout.strip("[]()\n ")) == 150.0

    with open(folder / "c" / "lens.c", "a") as file:
        file.write("\n")
    assert cli.main(["kernels", str(lens), "-o", str(folder), "--check"]) == 1
    assert "committed/c/lens.c" in capsys.readouterr().out


# ``rodgen completion``: what the shells complete


Run = Callable[..., tuple[int, str, str]]
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")


@needs_bash
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rodgen di", "diagnose"),
        ("rodgen mechanism ", "forward reverse"),
        ("rodgen fit --lo", "--loss"),
        ("rodgen fit --loss ", "linear huber"),
        ("rodgen fit mach", "machine.toml"),
        ("rodgen fit machine.toml --loss huber dat", "data.csv"),
        ("rodgen mechanism forward puma_560 points.csv -o dat", "data.csv"),
    ],
)
def test_bash_completes(line: str, expected: str, rodgen_command: Run, tmp_path: Path) -> None:
    code, script, err = rodgen_command("completion", "bash")
    assert (code, err) == (0, "")
    for name in ("machine.toml", "data.csv"):
        (tmp_path / name).touch()
    words = line.split(" ")
    ask = f'\nCOMP_WORDS=("$@")\nCOMP_CWORD={len(words) - 1}\n_shtab_rodgen\necho "${{COMPREPLY[*]}}"'
    done = subprocess.run(
        ["bash", "-c", script + ask, "bash", *words], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout == f"{expected}\n"


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script(shell: str, rodgen_command: Run) -> None:
    code, script, _ = rodgen_command("completion", shell)
    assert code == 0
    assert all(word in script for word in ("diagnose", "fit-axis", "apply", "--loss"))
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


def test_completion_says_which_extra_it_needs(rodgen_command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, _, err = rodgen_command("completion", "bash")
    assert code == 2
    assert "pip install 'rodgen[completion]'" in err


# Commands read what other commands of their group have written: through a pipe, with rows that have no result


POINTS = "Qx [mm],Qy [mm],Qz [mm]\n100,50,650\n0,0,0\n-30,80,700.5\n"
RODS = "A0 [mm],A1 [mm],A-1 [mm]\n700,700,720\n10,10,900\n"
ATTITUDES = "alpha [deg],beta [deg],gamma [deg]\n10,20,30\n-40,25,5\n"
ANGLES = "chi_x [deg],chi_y [deg],chi_z [deg]\n170,10,10\n"
PAPER = " --set R=330mm --set r=140mm"


@pytest.fixture
def pipe(capsys, monkeypatch):
    """Return the function that runs commands on a text, each on what the one before wrote."""

    def run(text, *commands):
        for command in commands:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
            code = cli.main([*command.split(), "-"])
            text, err = capsys.readouterr()
            assert code == 0, err
        return list(csv.DictReader(io.StringIO(text)))

    return run


def numbers(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


def test_the_point_of_the_rods_of_a_point_is_that_point(pipe):
    rows = pipe(POINTS, *(f"apply tricept.{name}{PAPER}" for name in ("pose", "direct", "point")))
    Q = ("Qx [mm]", "Qy [mm]", "Qz [mm]")
    found, given = numbers(rows, *Q), numbers(rows, *[f"given {name}" for name in Q])
    np.testing.assert_allclose(found[::2], given[::2], atol=1e-9)
    assert [row["given status"] for row in rows] == ["reachable", "gimbal_lock", "reachable"]


def test_rows_without_a_result_pass(pipe):
    names = ("direct", "legs", "direct")
    rows = pipe(RODS, *(f"apply tricept.{name}{PAPER}" for name in names))
    assert [row["status"] for row in rows] == ["reachable", "invalid"]
    assert [row["given status"] for row in rows] == ["reachable", "unreachable"]
    assert numbers(rows, "A0 [mm]")[0] == pytest.approx(700, abs=1e-9)


def test_rotations_have_the_angles_that_they_are_of(pipe):
    names = ("angles_from_euler", "rotations", "angles_from_quaternion")
    rows = pipe(ATTITUDES, *(f"apply instantaneous_euler.{name}" for name in names))
    chi = ("chi_x [deg]", "chi_y [deg]", "chi_z [deg]")
    np.testing.assert_allclose(numbers(rows, *chi), numbers(rows, *[f"given {n}" for n in chi]), atol=1e-9)
    assert len(rows) == 16
    (row,) = pipe(ANGLES, *(f"apply instantaneous_euler.{name}" for name in names[1:]))
    assert (row["given status"], row["status"]) == ("infeasible", "invalid")
