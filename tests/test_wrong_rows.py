"""Which rows are wrong: those with errors of their own, before and after what is missing is known; no good ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration import held_out as left_out
from rodgen.calibration import rows as judged_rows
from rodgen.calibration.displaced_stretch import stretch_of
from rodgen.calibration.fit import fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.rows import Rows, wrong_in
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"


def design(n: int, m: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return smooth columns of a model and of candidates, and the way along which they go."""
    q = np.sort(np.random.default_rng(0).uniform(0, 2 * np.pi, n))
    waves = np.stack([f(k * q) for k in range(1, 6) for f in (np.sin, np.cos)], -1)
    model = np.stack([np.broadcast_to(np.eye(m)[i], (n, m)) for i in range(m)], -1)
    every = np.stack([wave[:, None] * np.eye(m)[i] for wave in waves.T for i in range(m)], -1)
    return model, every, q


def rows_of(
    residual: np.ndarray, model: np.ndarray, columns: np.ndarray, q: np.ndarray | None = None
) -> Rows:
    n, m = residual.shape
    order = np.arange(n)
    q = np.arange(n, dtype=float) if q is None else q
    motion = np.broadcast_to(np.eye(m), (n, m, m))
    return Rows(
        residual, model, columns, motion, q[:, None], order, [order, np.argsort(q, kind="stable")], 1e-150
    )


def wrong(rows: Rows) -> np.ndarray:
    with one_thread_in_blas():
        found = wrong_in(rows)
        return np.asarray(found.wrong & ~rows.following(found))


@pytest.mark.parametrize("effect", [0.0, 5.0, 500.0])
def test_wrong_rows_are_found_and_nothing_else(effect):
    """5 % of the rows are off by 20 standard deviations, in clean data and where an effect is missing."""
    model, every, _ = design(200)
    for seed in range(4):
        random = np.random.default_rng(seed)
        residual = random.normal(size=(200, 3)) + effect * every[:, :, 4] * 2
        bad = np.sort(random.choice(200, 10, replace=False))
        residual[bad] += 20 * random.choice([-1, 1], size=(10, 3))
        assert np.flatnonzero(wrong(rows_of(residual, model, every))).tolist() == bad.tolist()


@pytest.mark.parametrize("size", [20, 300, 4000])
def test_a_third_of_the_rows_may_be_wrong(size):
    model, every, _ = design(80)
    missed = wrongly = 0
    for seed in range(4):
        random = np.random.default_rng(seed)
        residual = random.normal(size=(80, 3)) + 5 * every[:, :, 4]
        bad = random.choice(80, 28, replace=False)
        residual[bad] += size * random.normal(size=(28, 3))
        found = wrong(rows_of(residual, model, every))
        missed += 28 - int(found[bad].sum())
        wrongly += int(found.sum() - found[bad].sum())
    assert missed <= 2
    assert wrongly <= 1


@pytest.mark.parametrize("effect", [0.0, 5.0, 500.0])
def test_clean_data_have_no_wrong_rows(effect):
    model, every, _ = design(150)
    for seed in range(20):
        random = np.random.default_rng(100 + seed)
        residual = random.normal(size=(150, 3)) + effect * every[:, :, [1, 7]].sum(axis=2)
        assert not wrong(rows_of(residual, model, every)).any()


def test_heavy_tails_are_no_wrong_rows():
    model, every, _ = design(100)
    found = [
        int(wrong(rows_of(np.random.default_rng(s).standard_t(3, size=(100, 3)), model, every)).sum())
        for s in range(8)
    ]
    assert sum(found) <= 1


def test_what_no_candidate_has_is_not_wrong_where_rows_follow_each_other():
    model, every, q = design(300)
    bump = np.exp(-(((q - 3) / 0.15) ** 2))[:, None] * np.array([[1, 0.5, -1]])
    walk = np.cumsum(np.random.default_rng(9).normal(size=(300, 3)) / 2, axis=0)
    noise = np.random.default_rng(0).normal(size=(300, 3))
    assert not wrong(rows_of(noise + 20 * bump, model, every)).any()
    assert not wrong(rows_of(noise + walk, model, every[:, :, :0])).any()
    bad = [20, 77, 150, 210]
    noise[bad] += 15
    assert np.flatnonzero(wrong(rows_of(noise + walk, model, every[:, :, :0]))).tolist() == bad


def test_a_displaced_stretch_is_found_with_its_ends_and_no_row_is_wrong():
    model, every, _ = design(80)
    residual = np.random.default_rng(0).normal(size=(80, 3))
    residual[30:41] += [4, 2, -3]
    rows = rows_of(residual, model, every[:, :, :0])
    assert not wrong(rows).any()
    stretch = rows.stretch(np.zeros(80, bool))
    assert stretch is not None
    assert (stretch.first, stretch.last) == (30, 40)
    assert stretch.gain > 50


def test_a_stretch_of_many_poses_is_found_to_the_pose():
    random = np.random.default_rng(1)
    residual, motion = random.normal(size=(3000, 3)), np.broadcast_to(np.eye(3), (3000, 3, 3))
    residual[1234:1801] += 1
    none = np.zeros(3000, bool)
    stretch = stretch_of(residual, motion, motion, np.arange(3000), np.arange(3000), none)
    assert stretch is not None
    assert abs(stretch.first - 1234) < 15
    assert abs(stretch.last - 1800) < 15
    residual[1234:1801] -= 1
    assert stretch_of(residual, motion, motion, np.arange(3000), np.arange(3000), none) is None


def test_rows_are_judged_alike_block_by_block(monkeypatch):
    model, every, _ = design(200)
    random = np.random.default_rng(0)
    residual = random.normal(size=(200, 3)) + 10 * every[:, :, 4]
    residual[[7, 90, 171]] += 20
    rows = rows_of(residual, model, every)
    whole = wrong_in(rows)
    assert np.flatnonzero(whole.wrong).tolist() == [7, 90, 171]
    monkeypatch.setattr(judged_rows, "BLOCK", 64)
    parts = wrong_in(rows)
    assert (parts.wrong == whole.wrong).all()
    np.testing.assert_allclose([parts.cost, *parts.weight], [whole.cost, *whole.weight], rtol=1e-8)


def test_the_only_row_of_a_posture_is_not_wrong():
    model, every, _ = design(60)
    residual, q = np.random.default_rng(0).normal(size=(60, 3)), np.linspace(0, 1, 60)
    residual[59] += 30
    marked = wrong(rows_of(residual, model, every[:, :, :0], q))
    assert np.flatnonzero(marked).tolist() == [59]
    assert rows_of(residual, model, every, q).without_sole_postures(marked)[59]
    q[59] = 20
    assert not rows_of(residual, model, every, q).without_sole_postures(marked).any()


def test_few_or_perfect_rows_are_none():
    model, every, _ = design(150)
    assert not wrong_in(rows_of(np.zeros((150, 3)), model, every)).wrong.any()
    assert not wrong_in(rows_of(np.ones((5, 3)), model[:5], every[:5])).wrong.any()
    one = np.zeros((150, 3))  # readings to the last digit, but for one
    one[3] = 1.0
    assert np.flatnonzero(wrong_in(rows_of(one, model, every)).wrong).tolist() == [3]


@pytest.mark.thorough
@pytest.mark.parametrize("off", [0.5, -5.0])
def test_a_wrong_row_is_found_where_all_candidates_together_could_follow_it(off, tmp_path):
    """One reading of the first row of a trunnion, after which its warm-up begins, is off by so many mm."""
    header, first, *others = (EXAMPLES / "trunnion" / "data.csv").read_text().splitlines()
    cells = first.split(",")
    cells[6] = repr(float(cells[6]) + off)
    file = tmp_path / "data.csv"
    file.write_text("\n".join([header, ",".join(cells), *others]))
    found = fit(Machine.load(EXAMPLES / "trunnion" / "machine.toml"), Measurements.load(file)).diagnose()
    assert [step["effect"] for step in found.to_dict()["steps"]] == ["warm_up_drift"]
    assert list(found.outliers) == [0]


def test_folds_are_left_out_of_many_rows_as_of_few(monkeypatch):
    mount = EXAMPLES / "mount"
    found = fit(Machine.load(mount / "machine.toml"), Measurements.load(mount / "mmt_2021.csv"))
    few = found.held_out(5)
    monkeypatch.setattr(left_out, "MANY_ROWS", 0)
    assert found.held_out(5).rms == pytest.approx(few.rms, rel=1e-6)
