"""Inputs that were changed at random: those that once failed, and in `make test-slow` 3,000 others."""

from __future__ import annotations

from pathlib import Path

import fuzz
import pytest

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="memory is limited by what Linux says"
)
FAULTS = sorted(path for path in fuzz.KEPT.iterdir()) if fuzz.KEPT.exists() else []
CASES, PARTS = 3000, 30


@pytest.mark.parametrize("folder", FAULTS, ids=[path.name for path in FAULTS])
def test_what_once_failed_is_answered(folder: Path, tmp_path: Path) -> None:
    assert fuzz.fault_of(fuzz.Case.load(folder), tmp_path) == ""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    "part", [pytest.param(n, marks=pytest.mark.xdist_group(f"fuzz {n}")) for n in range(PARTS)]
)
def test_whatever_the_inputs_are_a_command_answers(part: int, tmp_path: Path) -> None:
    each = CASES // PARTS
    faults = fuzz.search(17, range(part * each, (part + 1) * each), 3600, tmp_path)
    assert [fault for fault, _ in faults] == []
