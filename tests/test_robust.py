"""Robust fits: planted gross errors are found and do no harm; intervals hold the truth as often as they say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi, t
from simulated_fits import TRUTH, fit_to, joint, machine_file, measure, on_table

from rodgen.calibration.fit import Fit, FitError, fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.statistics.robust import HUBER

NOISE = 0.002
BALLBAR = Path(__file__).parent.parent / "examples" / "machines" / "ballbar_gantry"


def columns_of(rows: int, random: np.random.Generator) -> dict[str, Any]:
    return {"C [rad]": np.repeat(random.uniform(-3, 3, rows // 2), 2), "target": ["p", "r"] * (rows // 2)}


def spoilt(data: dict[str, Any], bad: np.ndarray, kind: str, random: np.random.Generator) -> dict[str, Any]:
    """Spoil rows: their readings in all directions, or all alike; their commands within the travel, or far beyond."""
    data = dict(data)
    if kind == "commands":
        data["C [rad]"] = np.where(bad, random.uniform(-3, 3, len(bad)), data["C [rad]"])
    elif kind == "far commands":
        data["C [rad]"] = np.where(bad, 1e4 * random.normal(size=len(bad)), data["C [rad]"])
    else:
        size = random.normal(size=(3, len(bad))) if kind == "readings" else np.full((3, len(bad)), 0.5)
        for name, change in zip("xyz", size, strict=True):
            data[f"{name} [mm]"] = data[f"{name} [mm]"] + np.where(bad, change, 0.0)
    return data


def wrong_by(found: Fit, truth: dict[str, float]) -> float:
    """Return the largest error of a parameter, in its standard deviations."""
    factors = {p.key: p.factor for p in found.parameters}
    return max(
        abs(e.value * factors[e.key] - truth.get(e.key, 0.0)) / (e.std * factors[e.key])
        for e in found.estimates.values()
        if e.std
    )


# gross errors ----------------------------------------------------------------------------------------------------


@pytest.mark.thorough("0.3-readings", "0.3-readings alike", "0.1-readings alike")
@pytest.mark.parametrize("kind", ["readings", "readings alike", "commands", "far commands"])
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_gross_errors_are_named_and_do_no_harm(share: float, kind: str) -> None:
    random = np.random.default_rng(1)
    data = measure(on_table(), columns_of(100, random), TRUTH, noise=NOISE, random=random)
    bad = np.zeros(100, bool)
    bad[random.choice(100, int(100 * share), replace=False)] = True
    found = fit_to(on_table(), spoilt(data, bad, kind, random), loss="huber")
    # An error of a good size may hit the truth by chance: a command within 50 times the noise does so in 1 of 3000.
    assert np.flatnonzero(found.outliers).tolist() == np.flatnonzero(bad).tolist()
    # The result is a fit of the others, as if the outliers were not there.
    alone = fit_to(on_table(), {key: np.asarray(values)[~bad] for key, values in data.items()})
    assert found.rms == pytest.approx(alone.rms, rel=1e-6)
    for key, e in found.estimates.items():
        assert e.value == pytest.approx(alone.estimates[key].value, abs=1e-3 * e.std)
        assert e.std == pytest.approx(alone.estimates[key].std, rel=1e-3)
    assert found.degrees_of_freedom == alone.degrees_of_freedom


@pytest.mark.thorough
def test_gross_errors_in_the_frame_of_a_robot() -> None:
    """A free frame is started from the readings, so that these pull it far off at first."""
    joints = [
        joint("J1", "revolute", (0, 0, 1)),
        joint("J2", "revolute", (0, 1, 0), (175, 0, 495)),
        joint("J3", "revolute", (0, 1, 0), (175, 0, 1390)),
    ]
    estimate = ["J2.axis", "J2.point", "J3.axis", "J3.point", "target"]
    file = machine_file(joints, [(1320, 90, 1565)], frame="free", estimate=estimate)
    truth = {"frame.x": 900.0, "frame.y": -2000.0, "frame.rz": 2.2, "frame.rx": 0.3, "J3.point.b": 0.4}
    random = np.random.default_rng(2)
    columns = {f"J{i} [rad]": random.uniform(-1.4, 1.4, 120) for i in (1, 2, 3)}
    data = measure(file, columns, truth, noise=0.02, random=random)
    bad = np.zeros(120, bool)
    bad[random.choice(120, 36, replace=False)] = True
    for x in "xyz":
        data[f"{x} [mm]"] = data[f"{x} [mm]"] + np.where(bad, 500 * random.normal(size=120), 0.0)
    found = fit_to(file, data, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == np.flatnonzero(bad).tolist()
    assert found.rms == pytest.approx(0.02, rel=0.1)  # 252 readings: two standard deviations are 9 %


def test_distances_and_directions() -> None:
    random = np.random.default_rng(3)
    slides = [joint(name, "prismatic", np.eye(3)[i]) for i, name in enumerate("XYZ")]
    ball = machine_file(slides, [(0, 0, 0)], kind="distance", estimate=["target"], noise=0.001)
    columns = {f"{name} [mm]": random.uniform(-100, 100, 80) for name in "XYZ"}
    data = measure(ball, columns, noise=0.001, random=random)
    data["d [mm]"] = np.where(np.arange(80) % 5 == 0, data["d [mm]"] + 0.1, data["d [mm]"])
    found = fit_to(ball, data, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == list(range(0, 80, 5))
    mount = [joint("AZ", "revolute", (0, 0, -1)), joint("EL", "revolute", (1, 0, 0))]
    stars = machine_file(mount, [(0, 1, 0)], kind="direction", estimate=["AZ.axis", "EL.axis", "target"])
    columns = {"AZ [rad]": random.uniform(-3, 3, 80), "EL [rad]": random.uniform(0.3, 1.3, 80)}
    data = measure(stars, columns, noise=1e-5, random=random)
    wrong = {**data, "AZ [rad]": np.where(np.arange(80) % 5 == 0, data["AZ [rad]"] + 0.01, data["AZ [rad]"])}
    found = fit_to(stars, wrong, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == list(range(0, 80, 5))
    assert wrong_by(found, {}) < 4


def test_a_row_that_alone_tells_of_something_is_no_outlier() -> None:
    """The third ball is seen once: its place is what that row says, and no row contradicts it."""
    random = np.random.default_rng(4)
    columns = columns_of(40, random)
    columns = {"C [rad]": np.append(columns["C [rad]"], 1.0), "target": [*columns["target"], "s"]}
    file = on_table(targets=[(150, 0, 30), (-40, 90, 110), (10, 10, 10)])
    data = measure(file, columns, TRUTH | {"target.s.x": 25.0}, noise=NOISE, random=random)
    found = fit_to(file, data, loss="huber")
    assert not found.outliers.any()
    # Its own noise, carried along by three parameters that nothing else holds.
    assert found.estimates["target.s.x"].value == pytest.approx(25, abs=4 * found.estimates["target.s.x"].std)


def test_a_missing_effect_is_not_taken_for_outliers() -> None:
    """The example's squareness shows in one of the three planes of the ballbar only."""
    machine, data = Machine.load(BALLBAR / "machine.toml"), Measurements.load(BALLBAR / "data.csv")
    assert not fit(machine, data, loss="huber").outliers.any()


@pytest.mark.thorough
def test_good_data_keep_all_rows() -> None:
    """One of 100 sets may have an outlier; of 20 sets three or more have one with probability 0.001."""
    alarms = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        data = measure(on_table(), columns_of(24, random), TRUTH, noise=NOISE, random=random)
        found = fit_to(on_table(), data, loss="huber")
        alarms += bool(found.outliers.any())
        if not found.outliers.any():
            # Rounding in the gradient ends a fit at 1e-7 of a standard deviation.
            alone = fit_to(on_table(), data)
            assert (
                wrong_by(found, {k: e.value * _factor(alone, k) for k, e in alone.estimates.items()}) < 1e-3
            )
    assert alarms < 3


def _factor(found: Fit, key: str) -> float:
    return next(p.factor for p in found.parameters if p.key == key)


def test_exact_data_have_no_outliers_but_gross_ones() -> None:
    random = np.random.default_rng(5)
    data = measure(on_table(), columns_of(40, random), TRUTH)
    assert not fit_to(on_table(), data, loss="huber").outliers.any()
    data["x [mm]"] = data["x [mm]"] + np.where(np.arange(40) == 7, 1e-3, 0.0)
    assert np.flatnonzero(fit_to(on_table(), data, loss="huber").outliers).tolist() == [7]


def test_where_nothing_is_estimated_outliers_are_still_named() -> None:
    random = np.random.default_rng(5)
    file = on_table(estimate=[], effects=[])
    data = measure(file, columns_of(40, random), noise=NOISE, random=random)
    data["x [mm]"] = data["x [mm]"] + np.where(np.arange(40) == 7, 0.1, 0.0)
    assert np.flatnonzero(fit_to(file, data, loss="huber").outliers).tolist() == [7]


def test_too_few_rows_to_tell_are_fitted_by_least_squares() -> None:
    random = np.random.default_rng(6)
    data = measure(on_table(), columns_of(4, random), TRUTH, noise=NOISE, random=random)
    assert not fit_to(on_table(), data, loss="huber").outliers.any()


@pytest.mark.parametrize(("m", "k"), HUBER.items())
def test_tuning_constants_have_95_percent_efficiency(m: int, k: float) -> None:
    density = chi(m).pdf
    slope = quad(density, 0, k)[0] + (m - 1) / m * quad(lambda z: density(z) * k / z, k, 40)[0]
    square = quad(lambda z: density(z) * z * z, 0, k)[0] + k * k * chi(m).sf(k)
    assert slope**2 / (square / m) == pytest.approx(0.95, abs=1e-6)


def test_other_losses_are_refused() -> None:
    data = measure(on_table(), columns_of(8, np.random.default_rng(0)))
    with pytest.raises(FitError, match=r"^loss 'cauchy'; expected one of linear, huber$"):
        fit_to(on_table(), data, loss="cauchy")


# coverage --------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("stated", "loss", "sets", "share"),
    [
        pytest.param(False, "linear", 250, 0.0, marks=pytest.mark.slow),
        pytest.param(True, "linear", 250, 0.0, marks=pytest.mark.slow),
        (True, "linear", 100, 0.0),
        (False, "huber", 25, 0.2),
        pytest.param(True, "huber", 25, 0.2, marks=pytest.mark.slow),
    ],
)
def test_intervals_of_95_percent_hold_the_truth_in_93_to_97_of_100_sets(
    stated: bool, loss: str, sets: int, share: float
) -> None:
    """The simulator draws, the fit states intervals; twelve parameters each, which depend on each other somewhat."""
    file = on_table(**({"noise": NOISE} if stated else {}))
    hits = []
    for seed in range(sets):
        random = np.random.default_rng(1000 + seed)
        data = measure(file, columns_of(30, random), TRUTH, noise=NOISE, random=random)
        found = fit_to(file, spoilt(data, random.random(30) < share, "readings", random), loss=loss)
        reach = 1.959964 if stated else t.ppf(0.975, found.degrees_of_freedom)
        for e in found.estimates.values():
            hits.append(abs(e.value - TRUTH.get(e.key, 0.0) / _factor(found, e.key)) < reach * e.std)
    # three standard deviations: of 25 sets of 12 parameters 3.7 %, of 100 sets 1.9 %
    assert np.mean(hits) == pytest.approx(0.95, abs=0.037 if sets == 25 else 0.02)
