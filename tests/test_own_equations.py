"""A user's own equations, the whole way: a script, its proofs and page, its code and the emitted test."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import itertools
import os
import re
import shutil
import subprocess
import sys
import warnings
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from conftest import kept_files
from rodgen.cli.main import main
from rodgen.codegen import KernelBuilder, KernelError
from rodgen.codegen import build_cache as _build_cache
from rodgen.codegen import compile as run_time
from rodgen.codegen.compile import cache_folder, compile_kernel, compile_kernels
from rodgen.codegen.printers import ArrayPrinter, CPrinter
from rodgen.codegen.source_files import KernelModule, render
from rodgen.symbolic import EPS, Vector, cross, dot, equal, power_of_two_scale, select

ROOT = Path(__file__).resolve().parent.parent
FOUR_BAR = (ROOT / "examples" / "own_equations" / "four_bar.py").read_text()
HOW_TO = (ROOT / "docs" / "own_equations.md").read_text()
COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler: cc, gcc, clang are not on the PATH"
)


def run(*command: object, cwd: Path, code: int = 0, **environment: str) -> str:
    """Run a command, expect its exit code, and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=cwd,
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        timeout=300,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def rodgen(*command: object, cwd: Path, code: int = 0) -> str:
    """Call a command of rodgen in this process, which has SymPy loaded; expect its exit code, return what it prints."""
    shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        # no byte code: the next script of a name may be as long and, to the second, as old
        patch.setattr(sys, "dont_write_bytecode", True)
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
            found = main([str(argument) for argument in command])
    shown.seek(0)
    printed = shown.read()
    assert found == code, printed
    return printed


def run_tests(folder: Path, *options: str, code: int = 0, **environment: str) -> str:
    """Run emitted tests as their user does, with no plugin of pytest's."""
    command = ["pytest", "-q", "-rsf", "--tb=short", "-p", "no:cacheprovider", "tests", *options]
    return run(*command, cwd=folder, code=code, PYTEST_DISABLE_PLUGIN_AUTOLOAD="1", **environment)


def changed(text: str, *replacements: tuple[str, str]) -> str:
    for old, new in replacements:
        assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
        text = text.replace(old, new)
    return text


# The worked example --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example, and its code in ``build/``."""
    folder = tmp_path_factory.mktemp("four_bar")
    (folder / "four_bar.py").write_text(FOUR_BAR)
    told = run("rodgen", "kernels", "four_bar.py", "-o", "build", cwd=folder)
    assert sorted(re.findall(r"build/\S+", told)) == [
        "build/c/four_bar.c",
        "build/c/four_bar.h",
        "build/numpy/four_bar.py",
        "build/tests/test_four_bar.py",
    ]
    return folder


@pytest.fixture
def build(four_bar: Path, tmp_path: Path) -> Path:
    """A copy of the code of the example, to be spoilt."""
    return Path(shutil.copytree(four_bar / "build", tmp_path / "build"))


@pytest.mark.thorough
def test_every_statement_of_the_example_is_proved_and_the_slip_refuted(four_bar):
    report = rodgen("derive", "four_bar.py", cwd=four_bar)
    assert "7 proved, 1 refuted, 0 open" in report
    assert re.search(r"freudenstein +proved", report)
    assert re.search(r"freudenstein-with-a-slip +refuted", report)


@pytest.mark.thorough
def test_emitted_tests_pass_and_need_nothing_of_this_package(build):
    (build / "conftest.py").write_text("import sys\nsys.modules['rodgen'] = None\n")
    told = run_tests(build)
    assert "failed" not in told
    assert re.search(r"9 passed" if COMPILER else r"5 passed, 4 skipped", told)


@pytest.mark.thorough
def test_emitted_tests_skip_c_with_a_reason_when_there_is_no_compiler(build):
    told = run_tests(build, "-k", "c_agrees", CC="no-such-compiler")
    assert "4 skipped" in told
    assert "no C compiler: no-such-compiler is not on the PATH" in told


@pytest.mark.thorough
def test_check_tells_stale_files_and_keeps_tests_that_a_user_added(four_bar, build):
    check = ("kernels", str(four_bar / "four_bar.py"), "-o", str(build), "--check")
    (build / "tests" / "test_of_mine.py").write_text("def test_it():\n    assert 1 + 1 == 2\n")
    assert "tests" not in rodgen(*check, cwd=four_bar)
    file = build / "tests" / "test_four_bar.py"
    file.write_text(changed(file.read_text(), ("SAMPLES = 200", "SAMPLES = 2")))
    assert "-SAMPLES = 2\n+SAMPLES = 200\n" in rodgen(*check, cwd=four_bar, code=1)


@pytest.mark.slow  # Jupyter is installed for make test-slow only
def test_example_becomes_a_notebook_with_formulas_and_a_figure(four_bar):
    nbformat = pytest.importorskip("nbformat")

    run("rodgen", "derive", "four_bar.py", "--notebook", "four_bar.ipynb", cwd=four_bar)
    notebook = nbformat.read(four_bar / "four_bar.ipynb", as_version=4)
    shown = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])]
    entries = [data["text/markdown"] for data in shown if "text/markdown" in data]
    for id in (
        "freudenstein",
        "freudenstein-with-a-slip",
        "solution",
        "heron",
        "velocity-ratio",
        "kernel-first",
    ):
        assert any(f"**{id}**" in entry for entry in entries), f"{id} is not shown"
    assert sum('class="plotly-graph-div"' in data.get("text/html", "") for data in shown) == 1


@pytest.mark.thorough
def test_velocity_ratio_of_the_derivative_kernel_is_the_textbook_formula(four_bar):
    module = imported(four_bar / "build" / "numpy" / "four_bar.py")
    a, b, c, d = 20.0, 70.0, 60.0, 80.0
    theta = np.linspace(-3, 3, 50)
    rocker, coupler, _ = module.four_bar(a, b, c, d, theta)
    slopes, _, _ = module.four_bar_jacobian(a, b, c, d, theta)
    expected = a * np.sin(coupler - theta[:, None]) / (c * np.sin(coupler - rocker))
    # a crank-rocker far from dead centres: some hundred roundings
    np.testing.assert_allclose(slopes[..., 4], expected, rtol=1e-13, atol=1e-14)


def test_statuses_of_the_example(four_bar):
    module = imported(four_bar / "build" / "numpy" / "four_bar.py")
    links = {
        "CLOSES": (20, 70, 60, 80, 1.0),
        "DEAD_CENTRE": (3, 5, 5, 13, np.pi - np.pi),  # the pin is 10 from the pivot
        "CANNOT_CLOSE": (3, 5, 5, 14, 0.0),
        "TURNS_FREELY": (3, 5, 5, 3, 0.0),
        "INVALID": (3, 5, -5, 3, 0.0),
    }
    for name, arguments in links.items():
        rocker, coupler, status = module.four_bar(*arguments)
        assert module.FourBarStatus(status).name == name
        assert np.isnan(rocker).all() == np.isnan(coupler).all() == (name == "INVALID")
    assert module.FourBarStatus(module.four_bar(20, 70, np.nan, 80, 1.0)[2]).name == "INVALID"
    rocker, coupler, _ = module.four_bar(*links["CANNOT_CLOSE"])
    np.testing.assert_array_equal(np.abs(rocker), [np.pi, np.pi])  # towards the pin, which is 11 away
    np.testing.assert_array_equal(coupler, [0.0, 0.0])


# What is wrong is found -----------------------------------------------------------------------------------


def test_wrong_closed_form_is_caught_by_its_proof(tmp_path):
    wrong = changed(
        FOUR_BAR, ("value=(k_half * p_y + sign * s * p_x)", "value=(k_half * p_y - sign * s * p_x)")
    )
    (tmp_path / "four_bar.py").write_text(wrong)
    told = rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path, code=1)
    assert re.search(r"four_bar.py: line \d+: solution is not proved: residual 1 leaves ", told)
    assert not (tmp_path / "build").exists()


WRONG_KERNEL = ("along * y + sign * s * x", "along * y - sign * s * x")
NO_PROOF = (('check_vectors("first", 1)', ""), ('check_vectors("second", -1)', ""))


def test_wrong_kernel_is_caught_by_its_proof(tmp_path):
    (tmp_path / "four_bar.py").write_text(changed(FOUR_BAR, WRONG_KERNEL))
    told = rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path, code=1)
    assert "kernel-first is not proved" in told


@pytest.mark.thorough
def test_wrong_kernel_without_a_proof_is_caught_by_the_emitted_test(tmp_path):
    (tmp_path / "four_bar.py").write_text(changed(FOUR_BAR, WRONG_KERNEL, *NO_PROOF))
    rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path)
    told = run_tests(tmp_path / "build", "-k", "solve or solver", code=1)
    for test in ("test_outputs_solve_the_equations", "starts_nearby", "starts_anywhere"):
        assert re.search(rf"FAILED .*{test}", told), told


@pytest.mark.thorough
def test_wrong_status_is_caught_by_the_emitted_test(tmp_path):
    wrong = changed(
        FOUR_BAR,
        ("(FourBarStatus.CANNOT_CLOSE, tight < -rounding)", "(FourBarStatus.CANNOT_CLOSE, tight < 9)"),
    )
    (tmp_path / "four_bar.py").write_text(wrong)
    rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path)
    told = run_tests(tmp_path / "build", "-k", "solver", code=1)
    assert re.search(r"FAILED .*finds_nothing_where_there_is_no_solution", told)
    assert re.search(r"crank=[\d.]+, .*: the solver finds \[", told)


@pytest.mark.thorough
def test_solution_left_out_is_caught_by_the_emitted_test(tmp_path):
    wrong = changed(
        FOUR_BAR,
        (
            'for sign, which in ((1, "first"), (-1, "second")):',
            'for sign, which in ((1, "first"), (1, "second")):',
        ),
    )
    (tmp_path / "four_bar.py").write_text(changed(wrong, *NO_PROOF))
    rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path)
    told = run_tests(tmp_path / "build", "-k", "solve or solver", code=1)
    assert "1 failed" in told
    assert re.search(r"FAILED .*starts_anywhere_finds_no_other_solution", told)


@pytest.mark.slow
def test_wrong_derivative_is_caught_by_the_emitted_test(build):
    file = build / "numpy" / "four_bar.py"
    file.write_text(
        changed(file.read_text(), ("d_pin_y_d_crank_angle = x", "d_pin_y_d_crank_angle = 1.001*x"))
    )
    told = run_tests(build, "-k", "derivatives", code=1)
    assert re.search(r"d rocker_angle / d crank_angle: off by \d", told)


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("const REAL pin_y = ", "const REAL pin_y = K(1.0000001)*", "C and NumPy differ by"),
        ("const REAL pin_y = ", "const REAL unused = K(1.0), pin_y = ", "unused variable"),
    ],
)
def test_wrong_c_is_caught_by_the_emitted_test(build, old, new, told):
    file = build / "c" / "four_bar.c"
    file.write_text(file.read_text().replace(old, new))
    assert told in run_tests(build, "-k", "c_agrees and f64", code=1)


# The how-to page ------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_script_of_the_how_to_page_goes_the_way_that_the_page_tells(tmp_path):
    script, snippet = re.findall(r"```python\n(.*?)```", HOW_TO, re.S)
    (tmp_path / "slider_crank.py").write_text(script)
    report = rodgen("derive", "slider_crank.py", cwd=tmp_path)
    shown = re.search(r"```text\n(id .*?)\n```", HOW_TO, re.S)
    assert shown is not None
    without_times = [re.sub(r" +\d+ +79 ", " 79 ", text) for text in (shown[1].splitlines()[1], report)]
    assert without_times[0] in without_times[1]
    rodgen("kernels", "slider_crank.py", "-o", "build", cwd=tmp_path)
    assert "failed" not in run_tests(tmp_path / "build")
    rodgen("kernels", "slider_crank.py", "-o", "build", "--check", cwd=tmp_path)

    namespace: dict[str, Any] = {"__name__": "slider_crank"}
    exec(compile(script + snippet, "slider_crank.py", "exec"), namespace)
    module = imported(tmp_path / "build" / "numpy" / "slider_crank.py")
    expected = module.slider(20.0, 70.0, 5.0, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(namespace["positions"], expected[0], rtol=1e-15)


@pytest.mark.thorough
def test_errors_of_the_how_to_page_are_the_ones_that_come(tmp_path):
    script = re.findall(r"```python\n(.*?)```", HOW_TO, re.S)[0]
    wrong = changed(script, ("sp.sqrt(rod**2 - (e - r * sp.sin", "sp.sqrt(rod**2 - (e + r * sp.sin"))
    (tmp_path / "slider_crank.py").write_text(wrong)
    told = rodgen("derive", "slider_crank.py", cwd=tmp_path, code=1)
    assert told.strip() in HOW_TO
    (tmp_path / "slider_crank.py").write_text(
        changed(script, ("pin + half, pin - half", "pin + half, pin + half"))
    )
    rodgen("kernels", "slider_crank.py", "-o", "build", cwd=tmp_path)
    told = run_tests(tmp_path / "build", "-k", "anywhere", code=1)
    message = r"crank=.*:\s+the solver finds .*, besides .*"
    found, shown = re.search(message, told), re.search(message, HOW_TO)
    assert found is not None
    assert shown is not None
    number = r"-?\d+\.\d+"
    assert re.sub(number, "#", found[0]) == re.sub(number, "#", shown[0]).replace(":\n", ": ")
    pairs = zip(*(map(float, re.findall(number, text)) for text in (found[0], shown[0])), strict=True)
    assert all(one == pytest.approx(other, rel=1e-9) for one, other in pairs)  # last digits are the solver's


# Other shapes ---------------------------------------------------------------------------------------------


def unit_vectors() -> Any:
    k = KernelBuilder("directions", summary="Both unit vectors along a vector.", source="definition")
    v = k.input("v", 3, unit="mm", doc="a vector", between=(-2, 3))
    k.input("unused", 2, unit="1", doc="read by nothing", between=(0, 1))
    k.input("shift", unit="1", doc="read by the value, not by the derivative", between=(0, 1))
    n = k.let("n", v / sp.sqrt(v.dot(v)))
    k.output("e", sp.Matrix.vstack(n.T, -n.T), unit="1", doc="one direction a row")
    k.output("azimuth", sp.atan2(v[1], v[0]) * 180 / sp.pi, unit="deg", doc="a second output")
    k.output("shifted", v[0] + sp.Symbol("shift", real=True), unit="1", doc="linear")
    e = Vector("e")
    k.solves(cross(e, Vector("v")), equal(dot(e, e), 1))
    return k.build()


@pytest.mark.thorough
def test_vectors_more_equations_than_unknowns_degrees_and_unread_inputs(tmp_path):
    kernel = unit_vectors()
    assert kernel.equations.solutions == 2
    assert kernel.equations.unknowns == ("e",)
    module = KernelModule(
        "directions", "Directions.", "definition", (kernel, kernel.jacobian(("v", "shift")))
    )
    write(module, tmp_path)
    told = run_tests(tmp_path)
    assert "failed" not in told
    assert "8 passed" in told or COMPILER is None


@pytest.mark.thorough
def test_solution_at_a_zero_of_a_function_is_one_to_rounding(tmp_path):
    k = KernelBuilder("half_turns", summary="Angles with equal tangents.", source="definition")
    angle = k.input("angle", unit="rad", doc="an angle", between=(-4, 4))
    k.output("other", sp.Matrix([angle, angle + sp.pi]), unit="rad", doc="both, but for whole turns")
    k.solves(sp.sin(sp.Symbol("other") - angle))  # is zero, and so is each of its terms
    write(KernelModule("half_turns", "Angles.", "definition", (k.build(),)), tmp_path)
    assert "failed" not in run_tests(tmp_path, "-k", "solve or solver")


def test_module_without_a_domain_has_no_test():
    k = KernelBuilder("twice", summary="Twice.", source="definition")
    x = k.input("x", unit="1", doc="a number")
    k.output("y", 2 * x, unit="1", doc="twice that")
    assert set(render(KernelModule("twice", "Twice.", "definition", (k.build(),)))) == {
        "numpy/twice.py",
        "c/twice.c",
        "c/twice.h",
    }


def write(module: KernelModule, folder: Path) -> None:
    for name, text in render(module).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def imported(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Flag(IntEnum):
    """A status."""

    GOOD = 0


class Other(IntEnum):
    """Another kernel's status."""

    BAD = 0


@pytest.mark.parametrize(
    ("domain", "equations", "options", "complaint"),
    [
        (None, ["y**2 - x"], {}, "needs to know where x is sampled"),
        ((0, 1), ["z - x"], {}, "names z; expected inputs and real outputs only"),
        ((0, 1), ["x"], {}, "has equations without an output in them"),
        ((0, 1), ["y - flag"], {}, "names flag"),
        ((0, 1), ["y - u"], {}, "has 1 equations for 2 unknowns"),
        ((0, 1), ["y - x", "w - x"], {}, "mixes outputs of 2 and None solutions"),
        ((0, 1), ["y - x"], {"where": [Other.BAD]}, "none of the kernel's"),
        ((1, 1), ["y - x"], {}, "x is between 1 and 1; expected two increasing numbers"),
        ((0, sp.oo), ["y - x"], {}, "expected two increasing numbers"),
    ],
)
def test_what_solves_cannot_mean_is_said(domain, equations, options, complaint):
    k = KernelBuilder("root", summary="A root.", source="definition")

    def build() -> None:
        x = k.input("x", unit="1", doc="a number", between=domain)
        k.output("y", sp.sqrt(x), unit="1", doc="its root")
        k.output("u", -sp.sqrt(x), unit="1", doc="the other")
        k.output("w", sp.Matrix([x, x]), unit="1", doc="two")
        k.status("flag", sp.Integer(0), Flag, doc="nothing")
        k.solves(*(sp.sympify(e) for e in equations), **options)
        k.build()

    with pytest.raises(KernelError, match=re.escape(complaint)):
        build()


def test_equations_are_said_once():
    k = KernelBuilder("root", summary="A root.", source="definition")
    k.solves(sp.Symbol("y"))
    with pytest.raises(KernelError, match="solves\\(\\) is called twice"):
        k.solves(sp.Symbol("y"))


def test_symbol_of_the_same_name_with_other_assumptions_is_an_error():
    k = KernelBuilder("same", summary="The same.", source="definition")
    k.input("x", unit="1", doc="a number")
    with pytest.raises(KernelError, match="x here is another symbol than input\\(\\) returned"):
        k.output("y", sp.Symbol("x", positive=True), unit="1", doc="it")


x, y = sp.symbols("x y", real=True)


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (
            0.5 * x,
            "kernel half: y: the float 0.5 stands in a kernel; expected an exact number, such as sp.Rational(1, 2)",
        ),
        (sp.Max(x, 3), "kernel half: y: NumPy has no Max(); a kernel may use Abs, acos, "),
        (sp.gamma(x), "NumPy has no gamma()"),
        (sp.Integral(sp.exp(-(x**2)), (x, 0, x)), "NumPy cannot write Integral(exp("),
    ],
)
def test_what_a_kernel_cannot_hold_is_an_error_where_it_is_written(value, complaint):
    k = KernelBuilder("half", summary="Half.", source="definition")
    k.input("x", unit="1", doc="a number")
    with pytest.raises(KernelError, match=re.escape(complaint)):
        k.output("y", value, unit="1", doc="half of it")


def test_statuses_that_share_a_code_name_are_an_error_before_c_is_written():
    class Another(IntEnum):
        """Another status with the same name in it."""

        GOOD = 0

    kernels = []
    for name, enum in (("one", Flag), ("two", Another)):
        k = KernelBuilder(name, summary="A status.", source="definition")
        k.status("status", k.input("x", unit="1", doc="a number") * 0, enum, doc="nothing")
        kernels.append(k.build())
    with pytest.raises(KernelError, match="module both: Flag and Another both have GOOD"):
        render(KernelModule("both", "Both.", "definition", tuple(kernels)))
    assert set(compile_kernels(kernels)) == {"one", "two"}


def test_errors_of_a_script_lead_to_its_line(tmp_path):
    script = re.findall(r"```python\n(.*?)```", HOW_TO, re.S)[0]
    for old, new, told in (
        (
            'Derivation("slider_crank"',
            'Derivation("slider crank"',
            "line 15: 'slider crank' is not a name for a derivation",
        ),
        (
            "derivation.kernel(slider, ",
            "derivation.kernel(k, ",
            "KernelBuilder is not a kernel; register what build()",
        ),
        (
            'k.let("pin", r',
            'k.let("pin", 1.0 * r',
            "line 44: KernelError: kernel slider: pin: the float 1 stands",
        ),
    ):
        (tmp_path / "script.py").write_text(changed(script, (old, new)))
        code = 2 if "KernelError" in told else 1
        output = rodgen("kernels", "script.py", "-o", "build", cwd=tmp_path, code=code)
        assert told in output
        assert "Traceback" not in output


@pytest.mark.parametrize(
    "value", [1 / (x + y), 1 / (x**2 + y**2), (x + y) ** -3, 2 / (x * y), 1 / (1 + 1 / (x + y))]
)
@pytest.mark.parametrize("printer", [ArrayPrinter(), CPrinter()], ids=["numpy", "c"])
def test_reciprocal_of_a_sum_keeps_its_parentheses(printer, value):
    assert eval(printer.line(value), {"x": 3.0, "y": 5.0}) == pytest.approx(float(value.subs({x: 3, y: 5})))


# A user's words -------------------------------------------------------------------------------------------

HOSTILE = [
    '"""\nraise SystemExit(3)\n"""',
    "*/ #error words /*",
    'ends in "',
    "ends in a backslash \\",
    "\\N{BEL} \\x",
]


@pytest.mark.thorough
@pytest.mark.parametrize("words", HOSTILE)
def test_words_stay_in_docstrings_and_comments(words, tmp_path):
    class Status(IntEnum):
        GOOD = 0

    Status.__doc__ = words
    k = KernelBuilder("twice", summary=words, source=words, notes=words)
    number = k.input("x", unit="mm", doc="a number", between=(0, 1))
    k.output("y", 2 * number, unit="mm", doc="twice that")
    k.status("status", sp.Integer(0), Status, doc="nothing")
    kernel = k.build()
    write(KernelModule("twice", words, words, (kernel,)), tmp_path)
    module = imported(tmp_path / "numpy" / "twice.py")
    assert module.twice(2.0) == (4.0, 0)
    assert module.twice.__doc__.startswith(words.splitlines()[0])
    assert "failed" not in run_tests(tmp_path)
    assert compile_kernel(kernel)(2.0) == (4.0, 0)


@pytest.mark.parametrize("name", ["x; system(0)", "x\n", "x)", ""])
def test_name_that_is_no_identifier_is_not_compiled(name):
    import dataclasses

    k = KernelBuilder("twice", summary="Twice.", source="definition")
    k.output("y", 2 * k.input("x", unit="1", doc="a number"), unit="1", doc="twice that")
    with pytest.raises(KernelError, match="is not a valid name in generated code"):
        compile_kernel(dataclasses.replace(k.build(), name=name))


# The run-time compiler ------------------------------------------------------------------------------------


def product(name: str = "product") -> Any:
    k = KernelBuilder(name, summary="Scaled sum and product.", source="definition")
    a = k.input("a", 3, unit="1", doc="a vector")
    b = k.input("b", unit="1", doc="a number")
    c = k.input("c", (2, 2), unit="1", doc="a matrix")
    k.output("scaled", b * a * power_of_two_scale(1 + abs(a[0])) + EPS * a, unit="1", doc="a vector")
    k.output("trace", sp.atan2(c.trace(), select(b > 0, b, sp.sin(b))), unit="1", doc="a number")
    k.status("status", select(b > 0, 1, 0), Flag, doc="whether b is positive")
    return k.build()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, in place of the user's."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("RODGEN_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    _build_cache.notice.cache_clear()
    _build_cache.compiler_version.cache_clear()
    return folder


def generated_numpy() -> Any:
    functions: dict[str, Any] = {}
    text = render(KernelModule("kernels", "", "", (product(),)))["numpy/kernels.py"]
    exec(compile(text, "kernels.py", "exec"), functions)
    return functions["product"]


def arguments(dtype: type, *loops: tuple[int, ...]) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    cores = ((3,), (), (2, 2))
    return [rng.normal(size=loop + core).astype(dtype) for loop, core in zip(loops, cores, strict=True)]


@pytest.mark.thorough("loops1-float64", "loops1-float32", "loops7-float64")
@needs_compiler
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(
    "loops",
    [
        ((), (), ()),
        ((5,), (), ()),
        ((), (5,), (5,)),
        ((4, 1), (1, 3), ()),
        ((0,), (0,), ()),
        ((1,), (1,), (1,)),
        ((9000,), (), (9000,)),
        ((2, 5000), (5000,), (1, 1)),
    ],
)
def test_compiled_kernel_is_called_like_the_generated_numpy(cache, dtype, loops):
    compiled, expected = compile_kernel(product()), generated_numpy()
    assert compiled.target == "c"
    inputs = arguments(dtype, *loops)
    for found, known in zip(compiled(*inputs), expected(*inputs), strict=True):
        assert np.shape(found) == np.shape(known)
        assert found.dtype == known.dtype
        # the elementary functions of C and NumPy differ in the last bits
        np.testing.assert_allclose(found, known, rtol=8 * np.finfo(dtype).eps)


@needs_compiler
def test_layouts_and_types_of_inputs_make_no_difference(cache):
    compiled = compile_kernel(product())
    a, b, c = arguments(np.float64, (50,), (50,), (50,))
    expected = compiled(a, b, c)
    unaligned = np.zeros(b.nbytes + 1, np.uint8)[1:].view(np.float64)
    unaligned[:] = b
    for inputs in (
        (np.asfortranarray(a), b, np.asfortranarray(c)),
        (np.repeat(a, 2, axis=0)[::2], np.repeat(b, 2)[::2], np.repeat(c, 2, axis=0)[::2]),
        (a[::-1][::-1], unaligned, c.astype(">f8")),
        (a.tolist(), b.tolist(), c.tolist()),
    ):
        for found, known in zip(compiled(*inputs), expected, strict=True):
            np.testing.assert_array_equal(found, known)
    whole = compiled([1, 2, 3], 2, [[1, 2], [3, 4]])[0]
    np.testing.assert_array_equal(whole, compiled([1.0, 2.0, 3.0], 2.0, [[1.0, 2.0], [3.0, 4.0]])[0])


@needs_compiler
def test_out_is_filled_whatever_it_is_like(cache):
    compiled = compile_kernel(product())
    a, b, c = arguments(np.float64, (50,), (50,), (50,))
    expected = compiled(a, b, c)
    fits = (np.empty((50, 3)), np.empty(50), np.empty(50, np.int8))
    other = (np.empty((3, 50), np.float32).T, np.empty(100)[::2], np.empty(50, np.int64))
    overlapping = (a.copy(), np.empty(50), np.empty(50, np.int8))
    for out, first in ((fits, a), (other, a), (overlapping, overlapping[0])):
        result = compiled(first, b, c, out=out)
        assert all(r is o for r, o in zip(result, out, strict=True))
        for found, known in zip(out, expected, strict=True):
            np.testing.assert_allclose(found, known, rtol=1e-6 if found.dtype == np.float32 else 0)


@needs_compiler
@pytest.mark.parametrize(
    ("inputs", "out", "error", "told"),
    [
        (
            ([1, 2], 1, [[1, 2], [3, 4]]),
            None,
            ValueError,
            r"product: a has shape \(2,\); expected \(..., 3\)",
        ),
        (([1, 2, 3], 1j, [[1, 2], [3, 4]]), None, TypeError, "b has type complex128; expected real numbers"),
        (([1, 2, 3], 1), None, TypeError, "2 arguments; expected a, b, c"),
        (([[1, 2, 3]] * 2, [1] * 3, [[1, 2], [3, 4]]), None, ValueError, "broadcast"),
        (([1, 2, 3], 1, [[1, 2], [3, 4]]), (np.empty(3),), ValueError, "out has 1 arrays; expected 3"),
        (
            ([1, 2, 3], 1, [[1, 2], [3, 4]]),
            (np.empty(2), np.empty(()), np.empty(())),
            ValueError,
            r"out for scaled has shape \(2,\); expected \(3,\)",
        ),
    ],
)
def test_arguments_that_do_not_fit_are_refused(cache, inputs, out, error, told):
    with pytest.raises(error, match=told):
        compile_kernel(product())(*inputs, out=out)


@needs_compiler
def test_compiled_once_then_loaded(cache, monkeypatch):
    compile_kernel(product())
    (library,) = kept_files(cache)
    before = library.stat().st_mtime_ns, library.stat().st_ino
    monkeypatch.setattr(_build_cache, "_build", lambda *_: pytest.fail("compiled again"))
    assert compile_kernel(product())(np.ones(3), 2.0, np.eye(2))[2] == 1
    assert (library.stat().st_mtime_ns, library.stat().st_ino) == before


@needs_compiler
def test_other_flags_another_compiler_or_kernel_are_another_library(cache, monkeypatch):
    compile_kernel(product())
    assert len(kept_files(cache)) == 1
    monkeypatch.setattr(run_time, "FLAGS", (*run_time.FLAGS, "-DOTHER"))
    compile_kernel(product())
    assert len(kept_files(cache)) == 2
    monkeypatch.setattr(_build_cache, "compiler_version", lambda _: "another version")
    compile_kernel(product())
    assert len(kept_files(cache)) == 3
    compile_kernel(product("renamed"))
    assert len(kept_files(cache)) == 4


@needs_compiler
def test_several_kernels_share_a_library(cache):
    kernels = compile_kernels([product(), product("again")])
    assert list(kernels) == ["product", "again"]
    inputs = arguments(np.float64, (4,), (4,), (4,))
    for one, other in itertools.pairwise([k(*inputs) for k in kernels.values()]):
        np.testing.assert_array_equal(one[0], other[0])
    assert len(kept_files(cache)) == 1
    with pytest.raises(KernelError, match="share a name: product, product"):
        compile_kernels([product(), product()])


ONE_OF_MANY = """
import sympy as sp
from rodgen.codegen import KernelBuilder
from rodgen.codegen.compile import compile_kernel
k = KernelBuilder("sine", summary="Sine.", source="definition")
k.output("y", sp.sin(k.input("x", unit="rad", doc="an angle")), unit="1", doc="its sine")
kernel = k.build()
input()
assert compile_kernel(kernel).target == "c"
print(compile_kernel(kernel)(0.5))
"""


@pytest.mark.slow
@needs_compiler
def test_processes_that_compile_at_once_do_not_disturb_each_other(cache):
    several = [
        subprocess.Popen(
            [sys.executable, "-W", "error::RuntimeWarning:rodgen.codegen", "-c", ONE_OF_MANY],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    outputs = [None] * len(several)
    for process in several:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    outputs = [process.communicate(timeout=120) for process in several]
    assert all(process.returncode == 0 for process in several), outputs
    assert {float(out) for out, _ in outputs} == {np.sin(0.5)}
    assert [path.suffix for path in kept_files(cache)] == [".so"]


def counted(call: Any) -> tuple[Any, list[str]]:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = call()
    return result, [str(w.message) for w in told]


@pytest.mark.parametrize(
    ("compiler", "reason"),
    [
        ("no-such-compiler", "CC names the compiler 'no-such-compiler', which is not found"),
        ("false", "false fails: exit code 1"),
    ],
)
def test_without_a_compiler_numpy_runs_and_one_notice_says_why(cache, monkeypatch, compiler, reason):
    monkeypatch.setenv("CC", compiler)
    compiled, told = counted(lambda: compile_kernel(product()))
    assert compiled.target == "numpy"
    assert len(told) == 1
    assert told[0].startswith("kernels that are made at run time run on NumPy, not in C: ")
    assert told[0].endswith(reason)
    _, again = counted(lambda: compile_kernel(product("again")))
    assert again == []
    inputs = arguments(np.float64, (4,), (), (4,))
    for found, known in zip(compiled(*inputs), generated_numpy()(*inputs), strict=True):
        np.testing.assert_array_equal(found, known)


def test_without_any_compiler_on_the_path_the_notice_says_what_to_do(cache, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    compiled, told = counted(lambda: compile_kernel(product()))
    assert compiled.target == "numpy"
    assert told[0].endswith("no C compiler is found (cc, gcc or clang); install one, or name one in CC")


@needs_compiler
def test_what_is_no_library_is_made_anew(cache, tmp_path, monkeypatch):
    compile_kernel(product())
    (good,) = kept_files(cache)
    broken = tmp_path / "another cache" / good.name
    broken.parent.mkdir()
    broken.write_bytes(b"half a library")
    monkeypatch.setenv("RODGEN_CACHE", str(broken.parent))
    with pytest.warns(RuntimeWarning, match="is not as it was written"):
        assert compile_kernel(product())(np.ones(3), 2.0, np.eye(2))[2] == 1
    assert broken.read_bytes() == good.read_bytes()


@needs_compiler
def test_cache_into_which_others_can_write_is_not_used(cache):
    cache.mkdir()
    cache.chmod(0o777)
    assert compile_kernel(product()).target == "c"
    assert list(cache.iterdir()) == []


@needs_compiler
def test_cache_that_cannot_be_made_is_done_without(cache, monkeypatch):
    monkeypatch.setenv("RODGEN_CACHE", os.path.join(os.devnull, "cache"))
    assert compile_kernel(product()).target == "c"


@pytest.mark.parametrize(
    ("platform", "environment", "expected"),
    [
        ("linux", {"RODGEN_CACHE": "/r"}, "/r"),
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x/rodgen"),
        ("linux", {}, "/home/me/.cache/rodgen"),
        ("darwin", {}, "/home/me/Library/Caches/rodgen"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/rodgen/Cache"),
    ],
)
def test_cache_is_where_the_platform_keeps_caches(monkeypatch, platform, environment, expected):
    for name in ("RODGEN_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"HOME": "/home/me", **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    assert cache_folder() == Path(expected)


def test_derivative_kernel_compiles_with_its_status(cache):
    kernel = unit_vectors().jacobian(("v",))
    compiled = compile_kernel(kernel)
    found = compiled([1.0, 2.0, 2.0], [0.0, 0.0], 0.0)[0]
    v = np.array([1.0, 2.0, 2.0])
    expected = (np.eye(3) - np.outer(v, v) / 9) / 3  # of v / |v|
    np.testing.assert_allclose(found, [expected, -expected], rtol=1e-14, atol=1e-15)
