"""A page is made of the benchmarks' results; one part runs, on few rows and without the packages of its peers."""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

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


def test_page_is_made_of_what_was_measured(benchmark: Import) -> None:
    page = (FOLDER.parent / "docs/benchmarks.md").read_text(encoding="utf-8")
    assert benchmark("report").compose(KEPT) == page


def test_a_part_is_measured_and_reported(benchmark: Import, monkeypatch: pytest.MonkeyPatch) -> None:
    measure = benchmark("tricept.measure")
    for name, size in {"N": 500, "LOOPED": 10, "DIRECT": 20}.items():
        monkeypatch.setattr(measure, name, size)
    found = measure.measure(quick=True)
    assert {measure.OWN, measure.FUSED} < {row["name"] for row in found["rows"] if row["ns"] > 0}
    page = benchmark("report").compose(KEPT | {"tricept": KEPT["tricept"] | found})
    assert page.startswith("# Benchmarks")
