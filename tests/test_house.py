"""The package as a whole: what it needs, and what takes over without it; `tests/lints.py` reads its sources."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import rodgen

FUNCTIONS = [name for name in rodgen.__all__ if inspect.isfunction(getattr(rodgen, name))]


def test_all_lists_what_there_is() -> None:
    assert len(set(rodgen.__all__)) == len(rodgen.__all__)
    assert {"solve_axis", "rotate", "fit_axis", "axis_covariance"} <= set(FUNCTIONS)
    assert all(hasattr(rodgen, name) for name in rodgen.__all__)


def run_without(modules: set[str], code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a Python that does not have some modules."""
    hide = f"import sys\nfor name in {sorted(modules)!r}: sys.modules[name] = None\n"
    return subprocess.run([sys.executable, "-c", hide + code], capture_output=True, text=True, check=False)


def test_functions_need_numpy_alone() -> None:
    extras = {"sympy", "mpmath", "jinja2", "pint", "pyarrow", "tqdm", "plotly", "scipy", "dask"}
    code = (
        "import numpy, rodgen\n"
        "before, after = numpy.eye(3), numpy.eye(3)[[1, 0, 2]] * [[1], [-1], [1]]\n"
        "assert rodgen.solve_axis(before, after, numpy.pi / 2)[1].tolist() == [1, 1, 3]\n"
        "assert rodgen.rotate(before, [0, 0, 2]).shape == (3, 3)\n"
        "assert rodgen.fit_axis(before, after, numpy.pi / 2, point=(0, 0, 0)).pairs == 3\n"
    )
    done = run_without(extras, code)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("module", "extra", "command"),
    [("pyarrow", "tables", ["apply", "solve_axis", "pairs.csv"]), ("sympy", "derive", ["derive", "axis"])],
)
def test_command_says_which_extra_it_needs(module: str, extra: str, command: list[str]) -> None:
    done = run_without({module}, f"from rodgen.cli import main as cli\nsys.exit(cli.main({command!r}))")
    assert done.returncode == 2
    assert f"pip install 'rodgen[{extra}]'" in done.stderr
    assert done.stderr.count("\n") == 1


def test_numpy_takes_over_without_the_extension_with_one_notice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RODGEN_CPU", raising=False)
    code = "import rodgen\nfor _ in range(3): print(rodgen.solve_axis([3, 4, 12.0], [12, -3, 4.0], 2.2)[1])"
    done = run_without({"rodgen._gufuncs"}, code)
    assert (done.returncode, done.stdout) == (0, "0\n" * 3)
    assert done.stderr.count("RuntimeWarning") == 1
    assert "install a C compiler" in done.stderr


def test_cases_of_a_group_run_in_one_process(request: pytest.FixtureRequest) -> None:
    """A pair of pytest and pytest-xdist that takes no notice of groups makes every fixture in every process."""
    if not getattr(request.config.option, "loadgroup", False):
        pytest.skip("run without --dist loadgroup")
    assert request.node.nodeid.endswith("@test_house")
