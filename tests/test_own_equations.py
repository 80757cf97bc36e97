"""A user's own equations, the whole way: a script, its proofs and page, and its code."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import re
import shutil
import subprocess
import sys
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from rodgen.cli.main import main
from rodgen.codegen import KernelBuilder, KernelError, numpy_function
from rodgen.codegen.source_files import KernelModule, render

ROOT = Path(__file__).resolve().parent.parent
FOUR_BAR = (ROOT / "examples" / "own_equations" / "four_bar.py").read_text()
HOW_TO = (ROOT / "docs/guides/own_equations.md").read_text()


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
    told = rodgen("kernels", "four_bar.py", "-o", "build", cwd=folder)
    assert sorted(re.findall(r"build/\S+", told)) == [
        "build/c/four_bar.c",
        "build/c/four_bar.h",
        "build/numpy/four_bar.py",
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


def test_wrong_kernel_is_caught_by_its_proof(tmp_path):
    (tmp_path / "four_bar.py").write_text(changed(FOUR_BAR, WRONG_KERNEL))
    told = rodgen("kernels", "four_bar.py", "-o", "build", cwd=tmp_path, code=1)
    assert "kernel-first is not proved" in told


# The how-to page ------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_script_of_the_how_to_page_goes_the_way_that_the_page_tells(tmp_path):
    script, comparison = re.findall(r"```python\n(.*?)```", HOW_TO, re.S)
    (tmp_path / "slider_crank.py").write_text(script)
    report = rodgen("derive", "slider_crank.py", cwd=tmp_path)
    shown = re.search(r"```text\n(id .*?)\n```", HOW_TO, re.S)
    assert shown is not None
    without_times = [re.sub(r"proved +\d+ ", "proved ", text) for text in (shown[1].splitlines()[1], report)]
    assert without_times[0] in without_times[1]
    rodgen("kernels", "slider_crank.py", "-o", "build", cwd=tmp_path)
    rodgen("kernels", "slider_crank.py", "-o", "build", "--check", cwd=tmp_path)

    (tmp_path / "comparison.py").write_text(comparison)
    assert run("comparison", cwd=tmp_path) == ""
    wrong = changed(
        script, ("select(under_root > 0, under_root, 0)", "select(under_root > 0, under_root + 1, 0)")
    )
    (tmp_path / "slider_crank.py").write_text(wrong)
    assert "AssertionError" in run("comparison", cwd=tmp_path, code=1)


@pytest.mark.thorough
def test_errors_of_the_how_to_page_are_the_ones_that_come(tmp_path):
    script = re.findall(r"```python\n(.*?)```", HOW_TO, re.S)[0]
    wrong = changed(script, ("sp.sqrt(rod**2 - (e - r * sp.sin", "sp.sqrt(rod**2 - (e + r * sp.sin"))
    (tmp_path / "slider_crank.py").write_text(wrong)
    told = rodgen("derive", "slider_crank.py", cwd=tmp_path, code=1)
    assert told.strip() in HOW_TO


# The kernel ------------------------------------------------------------------------------------------------


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


def test_symbol_of_the_same_name_with_other_assumptions_is_an_error(refuses):
    k = KernelBuilder("same", summary="The same.", source="definition")
    k.input("x", unit="1", doc="a number")
    refuses(k.output, "y", sp.Symbol("x", positive=True), unit="1", doc="it", raises=KernelError)


x, y = sp.symbols("x y", real=True)


@pytest.mark.parametrize(
    "value", [0.5 * x, sp.Max(x, 3), sp.gamma(x), sp.Integral(sp.exp(-(x**2)), (x, 0, x))]
)
def test_what_a_kernel_cannot_hold_is_an_error_where_it_is_written(refuses, value):
    k = KernelBuilder("half", summary="Half.", source="definition")
    k.input("x", unit="1", doc="a number")
    refuses(k.output, "y", value, unit="1", doc="half of it", raises=KernelError)


def test_statuses_that_share_a_code_name_are_an_error_before_c_is_written(refuses):
    class Another(IntEnum):
        """Another status with the same name in it."""

        GOOD = 0

    kernels = []
    for name, enum in (("one", Flag), ("two", Another)):
        k = KernelBuilder(name, summary="A status.", source="definition")
        k.status("status", k.input("x", unit="1", doc="a number") * 0, enum, doc="nothing")
        kernels.append(k.build())
    refuses(render, KernelModule("both", "Both.", "definition", tuple(kernels)), raises=KernelError)


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
            "line 44: KernelError: kernel slider: pin: the float 1 is in a kernel",
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
def test_reciprocal_of_a_sum_keeps_its_parentheses(value):
    k = KernelBuilder("reciprocal", summary="A reciprocal.", source="definition")
    for name in ("x", "y"):
        k.input(name, unit="1", doc="a number")
    k.output("z", value, unit="1", doc="the reciprocal")
    assert numpy_function(k.build())(3.0, 5.0) == pytest.approx(float(value.subs({x: 3, y: 5})))


# A user's words -------------------------------------------------------------------------------------------

HOSTILE = [
    '"""\nraise SystemExit(3)\n"""',
    "*/ #error words /*",
    'ends in "',
    "ends in a backslash \\",
    "\\N{BEL} \\x",
]


@pytest.mark.parametrize("words", HOSTILE)
def test_words_stay_in_docstrings(words):
    class Status(IntEnum):
        GOOD = 0

    Status.__doc__ = words
    k = KernelBuilder("twice", summary=words, source=words, notes=words)
    number = k.input("x", unit="mm", doc="a number")
    k.output("y", 2 * number, unit="mm", doc="twice that")
    k.status("status", sp.Integer(0), Status, doc="nothing")
    twice = numpy_function(k.build())
    assert twice(2.0) == (4.0, 0)
    assert twice.__doc__ is not None
    assert twice.__doc__.startswith(words.splitlines()[0])


def test_derivatives_of_unit_vectors_with_inputs_that_nothing_reads():
    k = KernelBuilder("directions", summary="Both unit vectors along a vector.", source="definition")
    v = k.input("v", 3, unit="mm", doc="a vector")
    k.input("unused", 2, unit="1", doc="read by nothing")
    n = k.let("n", v / sp.sqrt(v.dot(v)))
    k.output("e", sp.Matrix.vstack(n.T, -n.T), unit="1", doc="one direction a row")
    found = numpy_function(k.build().jacobian(("v",)))([1.0, 2.0, 2.0], [0.0, 0.0])
    v = np.array([1.0, 2.0, 2.0])
    expected = (np.eye(3) - np.outer(v, v) / 9) / 3  # of v / |v|
    np.testing.assert_allclose(found, [expected, -expected], rtol=1e-14, atol=1e-15)
