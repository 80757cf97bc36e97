"""The referee of frozen answers: what it notices, and what it takes for rounding."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ANSWERS = Path(__file__).parent.parent / "answers"
DIAGNOSIS = {
    "inputs": "0123456789abcdef",
    "verdict": "effects_missing",
    "reason": "",
    "steps": ["backlash@C", "axis_tilt@C"],
    "equals": [],
    "sizes": {"C.backlash.b": [12.5, 0.5], "C.axis.a": [3.0, None]},
    "rms": [0.01, 0.002, None],
    "held out": [0.011, 0.0021],
    "outliers": [3],
}


@pytest.fixture(scope="module")
def referee() -> Iterator[ModuleType]:
    """The module that runs it, without its folders among those of the other tests."""
    before = list(sys.path)
    spec = importlib.util.spec_from_file_location("answers_run", ANSWERS / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    sys.path[:] = before
    del sys.modules["compare"]


def kinds(referee: ModuleType, old: dict[str, Any], new: dict[str, Any], **options: Any) -> list[str]:
    """Return the kinds of differences between two records."""
    return [one.kind for one in referee.differences({"a": old}, {"a": new}, **options)]


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"verdict": "nothing_missing"}, "verdict changed"),
        ({"steps": ["axis_tilt@C", "backlash@C"]}, "steps changed"),
        ({"equals": ["backlash@C = scale@C"]}, "equals changed"),
        ({"outliers": []}, "outliers changed"),
        ({"reason": "too few poses"}, "reason changed"),
        ({"sizes": {"C.backlash.b": [12.6, 0.5], "C.axis.a": [3.0, None]}}, "size moved"),
        ({"sizes": {"C.backlash.b": [12.5, 0.6], "C.axis.a": [3.0, None]}}, "size moved"),
        ({"sizes": {"C.backlash.b": [12.5, None], "C.axis.a": [3.0, None]}}, "size undetermined"),
        ({"sizes": {"C.backlash.b": [12.5, 0.5]}}, "size missing"),
        ({"rms": [0.01, 0.0021, None]}, "error moved"),
        ({"rms": [0.01, 0.002, 0.002]}, "error moved"),
        ({"held out": [0.011, 0.0022]}, "held-out error moved"),
        ({"inputs": "fedcba9876543210"}, "inputs changed"),
        ({"sizes": {"C.backlash.b": [12.50001, 0.5], "C.axis.a": [3.0, None]}}, "rounding: size"),
        ({"rms": [0.01, 0.002000000001, None]}, "rounding: error"),
    ],
)
def test_a_change_of_a_diagnosis_has_its_kind(referee, change, kind):
    assert kinds(referee, DIAGNOSIS, DIAGNOSIS | change) == [kind]


def test_numbers_of_arrays_may_be_off_by_what_rounding_allows(referee):
    values = np.array([[1.0, np.nan], [2.0, np.inf]])
    codes = np.array([0, 1], np.int8)
    old = {"arrays": {"x": values, "status": codes}}

    def allowance(key, name, array):
        return np.full(array.shape, 1e-15)

    def off(x, status=codes):
        return kinds(referee, old, {"arrays": {"x": x, "status": status}}, allowance=allowance)

    assert off(values.copy()) == []
    assert off(np.nextafter(values, 0)) == ["value moved"]  # infinity became finite
    assert off(np.where(values == 1, np.nextafter(1, 2), values)) == ["rounding: value"]
    assert off(np.where(values == 1, 1 + 1e-12, values)) == ["value moved"]
    assert off(np.where(values == 1, np.nan, values)) == ["value moved"]
    assert off(values[:1]) == ["shape changed"]
    assert off(values, np.array([0, 2], np.int8)) == ["code moved"]


def test_what_was_written_compares_equal_and_its_bytes_depend_on_nothing_else(referee, tmp_path):
    x = np.array([0.1, 0.2])
    answers = {
        "b": DIAGNOSIS,
        "a": {"arrays": {"x": x, "compiled x": x.copy(), "y": x, "compiled y": x + 1}},
    }
    for folder in ("one", "two"):
        referee.write("diagnoses", answers, tmp_path / folder)
        answers = dict(reversed(answers.items()))
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    assert referee.compared("diagnoses", answers, tmp_path / "one") == []
    moved = {**answers, "b": DIAGNOSIS | {"verdict": "cannot_tell"}}
    found = referee.compared("diagnoses", moved, tmp_path / "one")
    assert [one.kind for one in found] == ["verdict changed"]
    assert "verdict changed: 1\n    b: 'effects_missing' -> 'cannot_tell'" in referee.report(
        found, every=False
    )
