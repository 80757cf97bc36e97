"""The noise floor and the lack of fit, on data whose noise is known, and against figures taken by plain loops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_fits import TRUTH, fit_to, joint, machine_file, measure, on_table

import rodgen
from rodgen.calibration.fit import Fit, fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
NOISE = 0.002
RING = np.repeat(np.radians(np.arange(0.0, 360, 30)), 2)
TWICE = {"C [rad]": np.concatenate([RING, RING]), "target": ["p", "r"] * 24, "run": [1] * 24 + [2] * 24}


def example(name: str) -> Fit:
    (data,) = (EXAMPLES / name).glob("*.csv")
    return fit(Machine.load(EXAMPLES / name / "machine.toml"), Measurements.load(data))


def readings(columns: Any) -> np.ndarray:
    return np.stack([columns[f"{x} [mm]"] for x in "xyz"], axis=-1)


def add(columns: Any, change: Any) -> dict[str, Any]:
    changed = readings(columns) + change
    return {**columns, **{f"{x} [mm]": changed[:, i] for i, x in enumerate("xyz")}}


# replicates ------------------------------------------------------------------------------------------------------


def test_pure_error_is_the_pooled_scatter_of_equal_commands() -> None:
    """The model does not distinguish two passes, so residuals differ as the readings do.

    But the second pass comes to its first place from the other side.
    """
    columns = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=np.random.default_rng(1))
    found = fit_to(on_table(), columns).noise
    groups: dict[Any, list[np.ndarray]] = {}
    for row, reading in enumerate(readings(columns)):
        group = (columns["C [rad]"][row], columns["target"][row], row in {24, 25})
        groups.setdefault(group, []).append(reading)
    squares = sum(np.sum((np.array(g) - np.mean(g, axis=0)) ** 2) for g in groups.values())
    freedoms = sum(3 * (len(g) - 1) for g in groups.values())
    assert freedoms == 3 * 22
    assert found.value == pytest.approx(
        np.sqrt(squares / freedoms), rel=1e-9
    )  # rounding of readings of 150 mm
    assert found.source == "replicates"
    assert found.replicated_poses == 22
    assert 0.5 * freedoms < found.replicates.degrees_of_freedom <= freedoms
    assert found.stated is None


def covered(count: int, change: Any = lambda random: 0.0, true: float = NOISE) -> float:
    """Return how often the interval holds the true noise."""
    hits = 0
    for seed in range(count):
        random = np.random.default_rng(seed)
        data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=random)
        found = fit_to(on_table(), add(data, change(random))).noise.replicates
        hits += found.low < true < found.high
    return hits / count


@pytest.mark.slow
def test_intervals_hold_the_noise_in_95_of_100_sets() -> None:
    # 200 sets: two standard deviations of the share are 0.031
    assert covered(200) == pytest.approx(0.95, abs=0.031)


@pytest.mark.slow
def test_what_the_readings_of_a_pose_share_does_not_count_twice() -> None:
    """The balls of a pose move together by three times the noise: a pose is then worth little more than one ball."""
    shared = 3 * NOISE

    def jitter(random: np.random.Generator) -> np.ndarray:
        return np.repeat(shared * random.normal(size=(24, 3)), 2, axis=0)

    true = float(np.hypot(NOISE, shared))
    # 100 sets: two standard deviations of the share are 0.044
    assert covered(100, jitter, true) == pytest.approx(0.95, abs=0.05)
    # Readings of one pose know nothing of it.
    random = np.random.default_rng(1)
    data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=random)
    found = fit_to(on_table(), add(data, jitter(random))).noise
    # 144 readings less 24 poses' 5 motions and 12 parameters: two standard deviations are 27 %
    assert found.within_poses == pytest.approx(NOISE, rel=0.27)
    assert found.text.endswith("; the rest they share.")


def test_repeated_readings_are_no_replicates() -> None:
    """Each pose is read five times with a fifth of its own scatter; a single reading scatters by both."""
    angles = np.tile(np.radians(np.arange(0.0, 360, 12)), 2)
    columns = {"C [rad]": np.repeat(angles, 5)}
    file = on_table(targets=[(150, 0, 30)])
    random = np.random.default_rng(4)
    data = measure(file, columns, noise=NOISE / 5, random=random)
    data = add(data, np.repeat(NOISE * random.normal(size=(60, 3)), 5, axis=0))
    found = fit_to(file, data).noise
    # 720 readings less 180 means: 4 % are two standard deviations of the scatter's
    assert found.within_poses == pytest.approx(NOISE / 5, rel=0.06)
    true = float(np.hypot(NOISE, NOISE / 5))
    assert found.replicates.low < true < found.replicates.high
    assert found.replicates.degrees_of_freedom < 1.2 * 90
    single = fit_to(file, {key: values[:150] for key, values in data.items()}).noise
    assert (single.value, single.replicates) == (None, None)
    assert "Readings of one pose differ by " in single.text


def test_a_drift_between_replicates_is_reported_and_removed() -> None:
    """The example's spindle grows as it warms up; what the sensors add is 1 µm."""
    found = example("trunnion").noise
    assert found.value == pytest.approx(0.001, rel=0.05)
    assert found.replicates.low < 0.001 < found.replicates.high
    assert found.with_drift.value > 2 * found.value
    assert "With what differs from run to run, or wanders slowly, replicates differ by" in found.text


def test_runs_that_differ_are_reported() -> None:
    data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=np.random.default_rng(2))
    shifted = add(data, np.where(np.arange(48) < 24, 0.0, 5 * NOISE)[:, None])
    found = fit_to(on_table(), shifted).noise
    assert found.with_drift.value > 3 * NOISE
    assert found.replicates.low < NOISE < found.replicates.high
    # A model that lets the runs differ leaves nothing to take out.
    effects = [{"name": "encoder_eccentricity", "joint": "C"}, {"name": "frame_shift"}]
    modelled = fit_to(on_table(effects=effects), shifted).noise
    assert modelled.with_drift is None
    assert modelled.replicates.low < NOISE < modelled.replicates.high


@pytest.mark.thorough
def test_no_drift_is_seen_where_there_is_none() -> None:
    for seed in range(25):
        data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=np.random.default_rng(seed))
        assert fit_to(on_table(), data).noise.with_drift is None


# within poses, and distances --------------------------------------------------------------------------------------


def test_readings_of_one_pose_do_not_ask_the_model() -> None:
    """The table wobbles by a tenth of a millimetre, which no model here knows."""
    wobble = {**TRUTH, "C.radial_error_motion.u_c2": 0.1, "C.tilt_error_motion.v_s2": 1e-3}
    columns = {"C [rad]": np.repeat(np.linspace(0, 6, 100), 2), "target": ["p", "r"] * 100}
    found = fit_to(
        on_table(), measure(on_table(), columns, wobble, noise=NOISE, random=np.random.default_rng(5))
    )
    assert found.rms > 10 * NOISE
    assert found.noise.value is None
    # 99 differences of distances: two standard deviations are 14 %
    assert found.noise.distances == pytest.approx(NOISE, rel=0.14)
    assert found.noise.within_poses == pytest.approx(NOISE, rel=0.3)
    assert "Readings of one pose differ by " in found.noise.text


def test_distances_of_many_targets() -> None:
    random = np.random.default_rng(6)
    points = [tuple(p) for p in random.uniform(-200, 200, (6, 3))]
    file = machine_file([joint("C", "revolute", (0, 0, 1))], points, estimate=["target"])
    columns = {"C [rad]": np.repeat(np.linspace(0, 6, 60), 6), "target": list("prstuv") * 60}
    found = fit_to(file, measure(file, columns, noise=NOISE, random=random)).noise
    assert found.distances == pytest.approx(NOISE, rel=0.1)
    assert not found.one_body


def test_readings_that_share_nothing_have_no_part_of_their_own() -> None:
    """Chords between directions are as uncertain as these."""
    mount = [joint("AZ", "revolute", (0, 0, -1)), joint("EL", "revolute", (1, 0, 0))]
    file = machine_file(mount, [(0, 1, 0), (0.3, 0.9, -0.2)], kind="direction", estimate=["target"])
    random = np.random.default_rng(8)
    columns = {
        "AZ [rad]": np.repeat(random.uniform(-3, 3, 150), 2),
        "EL [rad]": np.repeat(random.uniform(0.2, 1.2, 150), 2),
        "target": ["p", "r"] * 150,
    }
    sigma = np.radians(2 / 3600)
    found = fit_to(file, measure(file, columns, noise=sigma, random=random)).noise
    assert (found.unit, found.within_poses) == ("arcsec", None)
    assert found.distances == pytest.approx(2, rel=0.15)


def test_targets_at_one_place_are_no_body() -> None:
    file = machine_file([joint("C", "revolute", (0, 0, 1))], [(150, 0, 30)] * 2, estimate=["target"])
    columns = {"C [rad]": np.repeat(np.linspace(0, 6, 40), 2), "target": ["p", "r"] * 40}
    for noise in (0.0, NOISE):
        data = measure(file, columns, noise=noise, random=np.random.default_rng(3))
        assert not fit_to(file, data).noise.one_body


# what is stated --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stated", "verdict"),
    [
        (NOISE, "agrees"),
        (NOISE / 4, "times smaller than the replicates say"),
        (NOISE * 5, "times larger than the replicates say"),
    ],
)
def test_what_is_stated_is_held_against_the_replicates(stated: float, verdict: str) -> None:
    data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=np.random.default_rng(1))
    found = fit_to(on_table(noise=stated), data).noise
    assert found.source == "replicates"
    assert found.stated == stated
    assert f"the stated {1000 * stated:.3g} um" in found.text
    assert f"{verdict}." in found.text


def test_the_stated_noise_is_the_value_without_replicates() -> None:
    data = measure(on_table(), {"C [rad]": RING[::2]}, TRUTH, noise=NOISE, random=np.random.default_rng(1))
    found = fit_to(on_table(noise=0.003), data).noise
    assert (found.value, found.source, found.text) == (0.003, "stated", "The noise is 3 um, as stated.")


def test_unknown_noise_is_said_to_be_unknown() -> None:
    found = example("mount")
    assert found.noise.value is None
    assert found.noise.text == "The noise is not known: none is stated, and no pose was repeated."
    assert found.lack_of_fit is None


def test_readings_that_share_their_errors_are_not_taken_for_the_noise() -> None:
    """Three points made from one measured pose keep their distances to the last digit."""
    columns = {"C [rad]": np.repeat(np.linspace(0, 6, 40), 2), "target": ["p", "r"] * 40}
    data = measure(on_table(), columns, TRUTH)
    data = add(data, np.repeat(NOISE * np.random.default_rng(3).normal(size=(40, 3)), 2, axis=0))
    found = fit_to(on_table(), data).noise
    assert found.value is None
    assert found.text.endswith("what was measured is the pose of one body, and this does not say how well.")


# lack of fit -----------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(("noise", "shared"), [({}, 0.0), ({}, 2.0), ({"noise": NOISE}, 0.0)])
def test_a_right_model_lacks_nothing(noise: dict[str, float], shared: float) -> None:
    """Probabilities are uniform, or on the safe side, also where the readings of a pose share most of their error."""
    p = []
    for seed in range(100):
        random = np.random.default_rng(seed)
        columns = TWICE if not noise else {key: values[:24] for key, values in TWICE.items()}
        data = measure(on_table(), columns, TRUTH, noise=NOISE, random=random)
        poses = shared * NOISE * random.normal(size=(len(columns["run"]) // 2, 3))
        found = fit_to(on_table(**noise), add(data, np.repeat(poses, 2, axis=0))).lack_of_fit
        assert found.against == ("stated" if noise else "replicates")
        p.append(found.p_value)
    # 100 sets: two standard deviations of the share of 5 % are 4.4 %, of 50 % are 10 %
    assert np.mean(np.array(p) < 0.05) < 0.05 + 0.044
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.12)


@pytest.mark.parametrize("noise", [{}, {"noise": NOISE}])
def test_a_missing_effect_is_a_lack_of_fit(noise: dict[str, float]) -> None:
    random = np.random.default_rng(0)
    wobble = {**TRUTH, "C.tilt_error_motion.u_c2": 6e-5}
    columns = TWICE if not noise else {key: values[:24] for key, values in TWICE.items()}
    found = fit_to(
        on_table(**noise), measure(on_table(), columns, wobble, noise=NOISE, random=random)
    ).lack_of_fit
    assert found.p_value < 1e-6
    assert "the model misses something (p < " in found.text
    # a tilt of 60 µrad at 150 mm, an eighth of it in the mean square over balls and components
    assert 1.2 < found.ratio < 4


def test_residuals_of_a_thousand_times_the_noise_have_the_smallest_p() -> None:
    columns = {"C [rad]": np.linspace(0, 6, 200)}
    data = measure(on_table(), columns, {**TRUTH, "C.radial_error_motion.u_c2": 3.0})
    found = fit_to(on_table(noise=NOISE), data).lack_of_fit
    assert found.p_value == 1e-300
    assert found.text.endswith("the model misses something (p < 1e-16).")


def test_too_large_a_stated_noise_is_reported() -> None:
    data = measure(
        on_table(), {"C [rad]": RING[::2]}, TRUTH, noise=NOISE / 5, random=np.random.default_rng(1)
    )
    found = fit_to(on_table(noise=NOISE), data).lack_of_fit
    assert found.p_value > 0.99
    assert "the noise is less than stated" in found.text


@pytest.mark.parametrize("shared", [0.0, 1.5])
def test_where_replicates_and_a_stated_noise_are_known_residuals_must_exceed_either(shared: float) -> None:
    """A stated noise may be too small, and replicates that share errors scatter too little; a diagnosis agrees."""
    random = np.random.default_rng(3)
    data = measure(on_table(), TWICE, TRUTH, noise=NOISE, random=random)
    place = np.round(np.degrees(np.asarray(TWICE["C [rad]"]))).astype(int)
    errors = dict.fromkeys(place.tolist())
    errors = {key: shared * NOISE * random.normal(size=3) for key in errors}
    data = add(data, np.array([errors[key] for key in place.tolist()]))
    stated = NOISE / 1.5 if not shared else NOISE * np.hypot(1, shared)
    fitted = fit_to(on_table(noise=stated), data)
    assert fitted.lack_of_fit.against == ("stated" if shared else "replicates")
    assert fitted.lack_of_fit.p_value > 0.01
    assert fitted.diagnose().verdict == "nothing_missing"


# The ratio of the noises of positions and attitudes, where none is stated; poses made by rotation matrices
# alone


PLACE, TURN = 0.1, 2e-4  # mm, rad
FILE = """
name = "Two axes of an arm, and a tracker of six freedoms"
units = { length = "mm", angle = "rad" }
joint = [
  { name = "A1", type = "revolute", axis = [0, 0, 1] },
  { name = "A2", type = "revolute", axis = [0, 1, 0], point = [0, 0, 340] },
]
target = [{ name = "tool", point = [0, 0, 1300] }]
measured = { kind = "pose", frame = "free" }
estimate = { parameters = ["target"] }
"""


def arm_of(tmp_path, mounted: list[float], off: float = 0.0, twice: bool = False) -> float:
    """Fit poses of runs, in each of which the marker is mounted anew, turned by an angle; A2's zero may be off."""
    random = np.random.default_rng(4)
    a1, a2 = random.uniform(-2.5, 2.5, 60), random.uniform(-1, 1.2, 60)
    if twice:
        a1, a2 = np.tile(a1[:30], 2), np.tile(a2[:30], 2)
    run = np.arange(60) * len(mounted) // 60
    first, second = (
        Rotation.from_rotvec(np.outer(a, e)) for a, e in ((a1, [0, 0, 1]), (a2 + off * a2**2, [0, 1, 0]))
    )
    body = first * second * Rotation.from_rotvec(np.outer(np.array(mounted)[run], [0, 0, 1]))
    place = (
        first.apply([0, 0, 340]) + (first * second).apply([0, 0, 960]) + PLACE * random.normal(size=(60, 3))
    )
    turned = (Rotation.from_rotvec(TURN * random.normal(size=(60, 3))) * body).as_matrix()
    columns = {"A1 [rad]": a1, "A2 [rad]": a2, "run": [f"r{i}" for i in run]}
    columns |= {f"{x} [mm]": place[:, i] for i, x in enumerate("xyz")}
    columns |= {f"r{i + 1}{j + 1}": turned[:, i, j] for i in range(3) for j in range(3)}
    (tmp_path / "m.toml").write_text(FILE)
    return fit(rodgen.Machine.load(str(tmp_path / "m.toml")), columns).observations.arm


def test_it_is_that_of_the_residuals(tmp_path) -> None:
    assert arm_of(tmp_path, [0.0]) == pytest.approx(PLACE / TURN, rel=0.15)


def test_a_marker_that_is_mounted_anew_in_each_run_is_no_noise(tmp_path) -> None:
    assert arm_of(tmp_path, [0.0, 0.35, 0.66]) == pytest.approx(PLACE / TURN, rel=0.2)


def test_repeated_poses_do_not_ask_the_model(tmp_path) -> None:
    """The error of a joint that the model lacks raises both by much, and not alike."""
    wrong = arm_of(tmp_path, [0.0], off=3e-3)
    assert wrong > 1.5 * PLACE / TURN
    assert arm_of(tmp_path, [0.0], off=3e-3, twice=True) == pytest.approx(PLACE / TURN, rel=0.2)
