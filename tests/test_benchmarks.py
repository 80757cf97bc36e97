"""Every part of benchmarks/ runs, on few rows and without the packages of its peers, which tests do not install."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import needs_browser

from rodgen import backend
from rodgen.calibration.solve import least_squares

FOLDER = Path(__file__).parent.parent / "benchmarks"
KEPT = json.loads((FOLDER / "results/latest.json").read_text(encoding="utf-8"))
Import = Callable[[str], Any]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Import]:
    """Return what imports a module of benchmarks/; a sample is one call, and what is compiled goes elsewhere."""
    before, variables = set(sys.modules), dict(os.environ)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        for name in {path.stem for path in FOLDER.iterdir()} & set(sys.modules):  # study/ has a run.py, too
            patch.delitem(sys.modules, name)
        clock, environments = importlib.import_module("clock"), importlib.import_module("environments")
        calibrate = clock.calibrate
        patch.setattr(clock, "calibrate", lambda entry, _: calibrate(entry, 0.0))
        patch.setattr(environments, "BUILD", tmp_path_factory.mktemp("build"))
        yield importlib.import_module
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(FOLDER)):
            del sys.modules[name]
    os.environ.clear()  # its libraries are set to one thread there
    os.environ.update(variables)


def with_sizes(module: Any, patch: pytest.MonkeyPatch, **sizes: int) -> Any:
    for name, size in sizes.items():
        patch.setattr(module, name, size)
    return module


def names(rows: list[dict[str, Any]]) -> set[str]:
    assert all(row["ns"] > 0 for row in rows)
    return {row["name"] for row in rows}


def check_page(benchmark: Import, part: str, found: dict[str, Any]) -> None:
    """Assert that a page is made of the figures of this part and the kept ones of the others."""
    assert benchmark("report").compose(KEPT | {part: KEPT[part] | found}).startswith("# Benchmarks")


def test_make_lists_every_part(benchmark: Import) -> None:
    text = (FOLDER.parent / "Makefile").read_text(encoding="utf-8")
    listed = re.search(r"^bench:.*ONLY=(.*): one part", text, re.MULTILINE)[1]
    assert set(re.split(r", | or ", listed)) == set(benchmark("run").PARTS)


def test_page_is_made_of_what_was_measured(benchmark: Import) -> None:
    page = (FOLDER.parent / "docs/benchmarks.md").read_text(encoding="utf-8")
    assert benchmark("report").compose(KEPT) == page


def test_axis(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    axis = with_sizes(benchmark("axis"), monkeypatch, CHECKED=50)
    package = benchmark("contenders.package")
    factories = package.FACTORIES if backend != "numpy" else [package.fallback]
    with ThreadPoolExecutor(1) as pool:
        contenders = [*(factory() for factory in factories), package.threaded(pool, 1)]
        missing: list[tuple[str, str]] = []
        errors = axis.check(contenders, missing)
    assert (missing, len(errors)) == ([], len(contenders))


def test_tricept(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    measure = with_sizes(benchmark("tricept.measure"), monkeypatch, N=500, LOOPED=10, DIRECT=20)
    found = measure.measure(quick=True)
    assert {measure.OWN, measure.FUSED} < names(found["rows"])
    check_page(benchmark, "tricept", found)


def test_three_sps_s(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    module = benchmark("three_sps_s.measure")
    measure = with_sizes(module, monkeypatch, N=200, LOOPED=5, DIRECT=10, BY_ROOTS=3, SEARCHED=1)
    found = measure.measure(quick=True)
    assert {measure.OWN, measure.OWN_DIRECT} < names(found["rows"])
    assert found["same_by_roots"] == 1
    check_page(benchmark, "three_sps_s", found)


def test_spatial(benchmark: Import, monkeypatch: pytest.MonkeyPatch, compiler: str) -> None:
    module = benchmark("spatial.measure")
    measure = with_sizes(module, monkeypatch, TRIG=5000, CACHED=300, PAIRS=100, STABLE_PAIRS=10, LOOPED=5)
    found = measure.measure(quick=True)
    assert {measure.OWN_TRIG, measure.OWN_CACHED} < names(found["trig"]["rows"])
    assert {measure.OWN_PAIR, measure.OWN_STABLE} < names(found["pair"]["rows"])
    check_page(benchmark, "spatial", found)


def test_tasks_for_a_graphics_processor(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    """With NumPy in the place of a library on a device; the page is made of what such a run writes."""
    measure = with_sizes(benchmark("gpu.measure"), monkeypatch, DISTINCT=200)
    numpy = measure.Library(np, np.asarray, lambda _: None, lambda f: f, lambda x: x.copy, "", "NumPy")
    tasks = {}
    for title, make in measure.TASKS.items():
        task = make(numpy, 400)
        error = task.error(task.call(*task.arguments))
        assert error <= measure.TOLERANCE["float32" if "float32" in title else "float64"]
        tasks[title] = {
            "error": error,
            "bytes": task.bytes,
            "to_compile": 0.0,
            "seconds": 1.0,
        }
    found = {"name": "NumPy", "version": "2", "device": "none", "bandwidth": 1e9, "tasks": tasks}
    page = benchmark("gpu.page").page({"rows": 400, "contenders": [found, {"name": "x", "failed": "no GPU"}]})
    assert page.count("|\n") == len(tasks) + 3
    assert "x: no GPU." in page


def test_kernels_are_printed_as_cuda(benchmark: Import) -> None:
    code = benchmark("gpu.device_code")
    assert "axis_solve_axis_f32(before" in code.solve_code("float32")


class NoPeers:
    """What `robots.peers.Peers` offers, without ssik and EAIK."""

    family = "none"

    def __init__(self, _: object) -> None:
        pass

    def disagreement(self, *_: object) -> tuple[float, int]:
        return 0.0, 0

    def poses(self, T: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        return T, list(T)

    def reverse(self, *_: object) -> None:
        pass

    reverse_eaik = reverse_eaik_list = forward_ssik = forward_eaik = reverse


def test_robots(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    measure = with_sizes(benchmark("robots.measure"), monkeypatch, N=40, FEW=4)
    for name in ("ensure", "append_to_path"):
        monkeypatch.setattr(measure.environments, name, lambda *_: None)
    peers = benchmark("robots.peers")
    assert {name for name in vars(NoPeers) if not name.startswith("_")} <= {*vars(peers.Peers), "family"}
    monkeypatch.setattr(peers, "Peers", NoPeers)
    found = measure.measure(quick=True)
    assert set(found["robots"]) == set(measure.ROBOTS)
    for robot in found["robots"].values():
        assert {measure.OWN_REVERSE, measure.OWN_FORWARD} < names(robot["rows"])
    check_page(benchmark, "robots", found)


# diagnoses -------------------------------------------------------------------------------------------------


def test_diagnoses(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    measure, cases = benchmark("diagnose.measure"), benchmark("diagnose.cases")
    monkeypatch.setattr(measure, "CASES", {"2 joints": cases.Chain(2, 20)})
    growing = {
        "rows": [cases.Chain(2, 20, loads=True, temperatures=True)],
        "parameters": [cases.Chain(2, 20, estimated=("axis",), declared=("scale",))],
    }
    monkeypatch.setattr(measure, "GROWING", growing)
    found = measure.measure(quick=True)
    for item in (*found["cases"].values(), *found["growth"]["rows"], *found["growth"]["parameters"]):
        assert 0 < item["start"] < item["all"]
        assert item["memory"] > 10
    axes, frame, scales = 2 * 2, 6, 2
    assert found["growth"]["parameters"][0]["parameters"] == axes + frame + scales
    page = benchmark("diagnose.page")
    assert "60 |" in page.page(found)
    assert "2 joints" in page.headline(found)[0]


def test_memory_is_without_that_of_the_process_that_starts_the_command() -> None:
    large = np.ones(2**25)  # 256 MiB
    words = [sys.executable, FOLDER / "diagnose/alone.py", sys.executable, "-c", "print('said')"]
    found = json.loads(subprocess.run(words, stdout=subprocess.PIPE, check=True).stdout)
    assert found["answer"] == "said\n"
    assert 1 < found["memory"] < large.nbytes / 2**20 / 2


def test_picture_of_growth_shows_what_was_measured(benchmark: Import) -> None:
    growth = KEPT["diagnose"]["growth"]
    shown = benchmark("diagnose.picture").figure(growth)
    assert {(trace.x, trace.y) for trace in shown.data if trace.mode == "lines+markers"} == {
        (tuple(item[of] for item in items), tuple(item[key] for item in items))
        for of, items in growth.items()
        for key in ("all", "memory")
    }


def test_picture_stays_where_there_is_no_browser(
    benchmark: Import, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = benchmark("diagnose.picture")
    monkeypatch.setattr("rodgen.output.figures.files.browser", lambda: None)
    (tmp_path / picture.NAME).write_bytes(b"drawn before")
    picture.draw(KEPT["diagnose"]["growth"], tmp_path)
    assert (tmp_path / picture.NAME).read_bytes() == b"drawn before"
    (said,) = capsys.readouterr().out.splitlines()
    assert "not drawn again" in said
    assert "Chromium" in said


def test_page_shows_a_picture_that_is_there(benchmark: Import) -> None:
    pages = FOLDER.parent / "docs"
    assert f"]({benchmark('diagnose.picture').NAME})" in (pages / "benchmarks.md").read_text(encoding="utf-8")
    assert (pages / benchmark("diagnose.picture").NAME).exists()


# fits ------------------------------------------------------------------------------------------------------


def differences(residuals: Callable[[np.ndarray], np.ndarray], theta: np.ndarray) -> np.ndarray:
    """The Jacobian by central differences."""
    steps = 1e-5 * np.eye(len(theta))
    return np.array([(residuals(theta + s) - residuals(theta - s)) / 2e-5 for s in steps]).T


@pytest.mark.parametrize("few_rows", [least_squares.FEW_ROWS, 0])
def test_fits(benchmark: Import, monkeypatch: pytest.MonkeyPatch, few_rows: int) -> None:
    """rodgen and a peer with rodgen's own driver fit the mount; both branches of the driver are taken."""
    cases, contenders, measure = (benchmark(f"fits.{name}") for name in ("cases", "contenders", "measure"))
    monkeypatch.setattr(least_squares, "FEW_ROWS", few_rows)
    case = cases.mount()
    residuals = contenders._arrays(case)
    exact = contenders.driver.Exact(residuals, lambda t: (residuals(t), differences(residuals, t)), 0.0)
    made = [*contenders.rodgen_fits(case), *contenders._exact("by hand", case, exact)]
    missing: list[dict[str, str]] = []
    judged = measure._judged(case, made, "mount", missing, {})
    assert (missing, len(judged)) == ([], 5)


def test_problem_of_a_peer_has_all_that_the_driver_asks_for(benchmark: Import) -> None:
    """A fit may ask for some of it only where a step is refused, or after many of them."""
    driver = benchmark("fits.driver")
    module = ast.parse(inspect.getsource(least_squares))
    of_fits = [
        node for node in module.body if getattr(node, "name", "") != "minimise_without"
    ]  # several fits at once
    asked = {
        node.attr
        for part in of_fits
        for node in ast.walk(part)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "problem"
    }
    assert {"normal_equations", "bend", "starts"} < asked
    exact = driver.Exact(lambda theta: theta, lambda theta: (theta, np.eye(2)), 0.0)
    assert {name for name in asked if not hasattr(driver._Problem(exact, 2, 1, 2), name)} == set()


def test_fits_of_other_machines_and_of_many_rows(benchmark: Import, tmp_path: Path) -> None:
    cases, worker = benchmark("fits.cases"), benchmark("fits.worker")
    fit = importlib.import_module("rodgen.calibration.fit").fit
    positioner = cases.positioner()
    assert fit(positioner.machine, positioner.observations).solution.converged
    assert worker.data(str(tmp_path), "300") == {"rows": 300}
    assert worker.kernels("300")["normal equations"] > 0
    if Path("/proc/self/status").exists():  # where the memory is read
        assert worker.large(str(tmp_path))["rows"] == 300


def test_operations_of_the_arm_are_counted(benchmark: Import) -> None:
    counts = benchmark("fits.measure")._operations()
    assert all(
        counts[name]["mul"] > counts[name]["sin"] > 0 for name in ("residual", "residual_and_jacobian")
    )
    check_page(benchmark, "fits", {"kernels": KEPT["fits"]["kernels"] | {"operations": counts}})


def test_scale(benchmark: Import, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scale = with_sizes(benchmark("scale"), monkeypatch, FILE_ROWS=1000)
    scale.make(tmp_path, 3000)
    found = scale.measure(tmp_path, "threads=2", diagnosed=False)
    assert found["rows"] == 3000
    assert found["parts"] == 3
    assert min(found[name] for name in ("fit_s", "fit_cpu_s", "pass_s", "pass_cpu_s", "largest_GB")) > 0
    assert found["reduced_B"] > 8 * 39**2  # a triangle would do


# the workbench ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@needs_browser
def test_workbench(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nicegui")
    measure, cases = benchmark("workbench.measure"), benchmark("workbench.cases")
    monkeypatch.setattr(measure, "CASES", {"telescope, 40 rows": cases.Telescope(40)})
    found = measure.measure(quick=True)
    (case,) = found["cases"].values()
    assert {"first view", "add", "undo", "redo", "another covariate", "brush"} < set(case)
    assert all(min(item.values()) >= 0 < item["wall"] for item in case.values())
    page = benchmark("workbench.page")
    assert "telescope, 40 rows: brush" in page.page(found)
    assert "40 rows: first view" in page.headline(found)[0]
