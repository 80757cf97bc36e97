"""Made-up measurements: against the plain simulator, found again by fits, kept secret, written as the design was."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_simulator import RADIANS, Simulated

import rodgen
from rodgen.calibration.simulate import read_truth, truth_as_json
from rodgen.data.tables import copy_with
from rodgen.data.units import number_and_unit
from rodgen.machines.rules import UnfitEffectError
from rodgen.machines.typed_effects import assignments, typed_effect

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"


def example(name: str) -> tuple[rodgen.Machine, rodgen.Measurements]:
    (data,) = (EXAMPLES / name).glob("*.csv")
    return rodgen.Machine.load(EXAMPLES / name / "machine.toml"), rodgen.Measurements.load(data)


def commands(machine: rodgen.Machine, data: rodgen.Measurements) -> np.ndarray:
    return np.stack([data.columns[joint.name].values for joint in machine.joints], -1)


def readings(made: rodgen.calibration.simulate.Simulation) -> np.ndarray:
    return np.stack(list(made.columns.values()), -1)


# readings ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "effects", "errors"),
    [
        (
            "rotary_table",
            ["encoder_eccentricity@C:a=12arcsec, b=-3arcsec", "tilt_error_motion@C:u_c2=0.001"],
            {
                "C.encoder_eccentricity.a": 12 / 3600,
                "C.encoder_eccentricity.b": -3 / 3600,
                "C.tilt_error_motion.u_c2": 0.001,
            },
        ),
        (
            "trunnion",
            ["warm_up_drift:z=27um,tau=0.5h", "scale@X:k=12ppm"],
            {"warm_up_drift.z": 0.027, "warm_up_drift.tau": 1800.0, "X.scale.k": 12e-6},
        ),
        ("ballbar_gantry", ["squareness@Y:a=14arcsec"], {"Y.squareness.a": 14 / 3600}),
        (
            "mount",
            ["gravity_windup@EL:k=21.4arcsec", "refraction:a=3e-3"],
            {"EL.gravity_windup.k": 21.4 / 3600, "refraction.a": 3e-3},
        ),
    ],
)
def test_without_noise_readings_are_those_of_the_plain_simulator(name, effects, errors):
    machine, data = example(name)
    made = rodgen.simulate(machine, data, effects, noise=0.0, seed=1)
    columns = {}
    if "target" in data.columns:
        columns["target"] = list(data.columns["target"].values)
    if "t" in data.columns:
        columns["t"] = data.columns["t"].values
    expected = Simulated(EXAMPLES / name / "machine.toml", errors).measure(commands(machine, data), **columns)
    # two programs that round differently, at coordinates of some 1000 mm
    assert np.abs(readings(made) - np.reshape(expected, readings(made).shape)).max() < 1e-10
    assert made.truth["noise"]["rms"] == 0.0


def test_set_ups_are_shifted_each_by_its_own():
    machine, data = example("rotary_table")
    run = np.asarray(data.columns["run"].values)
    name = sorted(set(run))[1]
    plain, moved = (
        rodgen.simulate(machine, data, e, noise=0.0) for e in ([], [f"frame_shift[{name}]:x=0.1,rz=10arcsec"])
    )
    change = readings(moved) - readings(plain)
    assert np.abs(change[run != name]).max() == 0.0
    x, y = readings(plain)[run == name, :2].T
    turn = 10 * RADIANS["arcsec"]
    expected = np.stack(
        [x * np.cos(turn) - y * np.sin(turn) - x + 0.1, y * np.cos(turn) + x * np.sin(turn) - y], -1
    )
    assert change[run == name][:, :2] == pytest.approx(expected, abs=1e-11)


def test_noise_has_the_size_that_was_asked_for():
    machine, data = example("rotary_table")
    exact = readings(rodgen.simulate(machine, data, noise=0.0))
    for noise, size in ((None, 0.0015), ("4um", 0.004), (0.01, 0.01), ("0.01", 0.01)):
        error = readings(rodgen.simulate(machine, data, noise=noise, seed=3)) - exact
        # 1296 normal numbers tell their spread to 2 %, their mean to 3 % of it
        assert error.std() == pytest.approx(size, rel=0.08)
        assert abs(error.mean()) < 0.12 * size


def test_noise_of_directions_is_that_of_each_component_on_the_sky():
    machine, data = example("mount")
    exact = readings(rodgen.simulate(machine, data, noise=0.0))
    errors = []
    for seed in range(10):
        read = readings(rodgen.simulate(machine, data, noise="5arcsec", seed=seed))
        # rounded to a thousandth of the noise
        assert np.linalg.norm(read, axis=1) == pytest.approx(1.0, abs=1e-7)
        errors.append(read - exact)
    error = np.concatenate(errors) / RADIANS["arcsec"]
    assert np.sqrt(np.mean(np.sum(error**2, 1)) / 2) == pytest.approx(5.0, rel=0.08)


def test_noise_follows_the_stated_uncertainties():
    machine, data = example("positioner")
    exact, read = (readings(rodgen.simulate(machine, data, noise=noise, seed=2)) for noise in (0.0, None))
    stated = np.stack([data.columns[f"u_{x}"].values for x in "xyz"], -1)
    assert ((read - exact) / stated).std(axis=0) == pytest.approx([1, 1, 1], rel=0.15)
    assert stated[:, 2].mean() > 3 * stated[:, 0].mean()


def test_a_seed_gives_the_same_data_and_is_recorded():
    machine, data = example("rotary_table")
    first = rodgen.simulate(machine, data)
    again = rodgen.simulate(machine, data, seed=first.truth["seed"])
    assert np.array_equal(readings(first), readings(again))
    assert not np.array_equal(readings(first), readings(rodgen.simulate(machine, data)))


def test_a_fitted_machine_is_simulated_with_its_values():
    machine, data = example("mount")
    fitted = machine.fit(data)
    made = rodgen.simulate(fitted.machine, data, noise=0.0)
    assert machine.fit(made.data).rms < 1e-6  # arcsec: rounding of the readings
    assert rodgen.simulate(machine, data, noise=0.0).truth["change"]["rms"] == 0.0
    assert rodgen.simulate(fitted.machine, data, noise=0.0).truth["effects"] == []


# hidden effects ----------------------------------------------------------------------------------------


MORE_HIDDEN = [("rotary_table", 3), ("trunnion", 2)]


@pytest.mark.parametrize(
    ("name", "seed"),
    [("rotary_table", 1), ("mount", 4), *(pytest.param(*x, marks=pytest.mark.slow) for x in MORE_HIDDEN)],
)
def test_a_hidden_effect_shows_and_is_found_again(name, seed):
    machine, data = example(name)
    noise = "0.5arcsec" if name == "mount" else None
    made = rodgen.simulate(machine, data, hidden=True, noise=noise, seed=seed)
    (truth,) = made.truth["effects"]
    size, left = made.truth["noise"]["rms"], made.truth["change"]["left_by_a_fit"]
    assert 1.9 * size < left < 5.1 * size
    assert left * (1 - 1e-9) <= made.truth["change"]["rms"] < 5.1 * left
    before = machine.fit(made.data)
    assert before.rms == pytest.approx(np.hypot(size, left), rel=0.1)
    place = {"joint": truth["place"]} if truth["place"] else {}
    after = before.machine.add(truth["effect"], **place).fit(made.data)
    assert after.rms == pytest.approx(size, rel=0.1)
    for key, number in truth["parameters"].items():
        found = after.estimates[key]
        assert found.unit == number["unit"]
        if found.std is not None and not found.convention:
            # beyond 5 standard deviations once in two million draws; the t distribution is wider, but for 60 readings
            assert abs(found.value - number["value"]) < 5 * found.std


def test_an_effect_without_numbers_is_given_a_size_that_shows():
    machine, data = example("rotary_table")
    made = rodgen.simulate(machine, data, ["encoder_ellipticity@C"], seed=5)
    (truth,) = made.truth["effects"]
    assert set(truth["parameters"]) == {"C.encoder_ellipticity.a", "C.encoder_ellipticity.b"}
    assert made.truth["change"]["left_by_a_fit"] > 1.9 * 0.0015


def test_drawn_effects_are_of_many_kinds():
    machine, data = example("rotary_table")
    found = {
        rodgen.simulate(machine, data, hidden=True, seed=seed).truth["effects"][0]["effect"]
        for seed in range(12)
    }
    assert len(found) >= 5


def test_what_a_fit_would_hide_is_not_drawn(refuses):
    machine, data = example("mount")
    # the direction that is seen at zero is fitted: an offset of the encoder is the same
    refuses(rodgen.simulate, machine, data, ["zero_offset@EL"], noise="1arcsec")


# what is wrong -----------------------------------------------------------------------------------------

WRONG = [
    "backlash",
    "backlsh@C",
    "backlash@D",
    "backlash@C:c=1",
    "backlash@C:b=1mm",
    "backlash@C:b=1 furlongsecond",
    "backlash@C:b=",
    "backlash@C:b=1,b=2",
    "backlash@C:b=nan",
    "backlash@C:b=1e999",
    "backlash@C@D",
    "backlash[1]@C:b=1",
    "frame_shift:x=1",
    "frame_shift[9]:x=1",
    "periodic_drive_error@C:a=1arcsec",
    "periodic_drive_error@C:a=1arcsec,P=-5",
    "thermal_offset@C:k=1",
    "",
]


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_with_an_effect_is_one_line(refuses, text):
    machine, data = example("rotary_table")
    refuses(rodgen.simulate, machine, data, [text])


@pytest.mark.parametrize(
    "noise",
    [
        "3xx",
        "3s",
        "-3um",
        "",
        "um",
    ],
)
def test_what_is_wrong_with_the_noise_is_one_line(refuses, noise):
    machine, data = example("rotary_table")
    refuses(rodgen.simulate, machine, data, noise=noise)


def test_a_size_is_not_drawn_where_no_noise_is_known(refuses):
    machine, data = example("mount")
    refuses(rodgen.simulate, machine, data, hidden=True)


def test_an_effect_that_the_machine_has_already_is_refused(refuses):
    machine, data = example("gantry_rotary")
    refuses(rodgen.simulate, machine, data, ["scale@X:k=1e-5"])


def test_a_design_needs_no_readings_but_its_commands(refuses):
    machine, _ = example("rotary_table")
    design = rodgen.Measurements.from_frame({"C [deg]": [0.0, 90.0], "target": ["ball_1", "ball_2"]})
    made = rodgen.simulate(machine, design, noise=0.0)
    assert list(made.columns) == ["x [mm]", "y [mm]", "z [mm]"]
    assert list(made.data.columns) == ["C", "target", "x", "y", "z"]
    assert made.data.columns["x"].values.tolist() == made.columns["x [mm]"].tolist()
    refuses(rodgen.simulate, machine, rodgen.Measurements.from_frame({"target": ["ball_1"]}))


def test_readings_are_in_the_units_of_the_design():
    machine, _ = example("rotary_table")
    frame = {
        "C [deg]": [0.0, 90.0],
        "x [m]": [0, 0],
        "y [um]": [0, 0],
        "z [inch]": [0, 0],
        "target": ["ball_1"] * 2,
    }
    made = rodgen.simulate(machine, rodgen.Measurements.from_frame(frame), noise=0.0)
    first = [values[0] for values in made.columns.values()]
    x, y, z = machine.target("ball_1").point
    assert first == pytest.approx([x / 1000, y * 1000, z / 25.4], abs=1e-9)
    assert made.replaced == {name: name for name in ("x [m]", "y [um]", "z [inch]")}


# the truth in a file -----------------------------------------------------------------------------------


def test_a_truth_is_read_as_it_was_written(tmp_path):
    machine, data = example("rotary_table")
    truth = rodgen.simulate(machine, data, ["backlash@C:b=20arcsec"], seed=1).truth
    text = truth_as_json(truth)
    assert json.loads(text)["truth"] == truth
    assert "rodgen simulate --open" in text
    path = tmp_path / "truth.json"
    path.write_text(text)
    assert read_truth(path) == truth
    assert read_truth(path)["effects"][0]["parameters"]["C.backlash.b"]["value"] == pytest.approx(20)


@pytest.mark.parametrize(
    "text",
    [
        *("", "{}", "[]", '{"truth": "%%%"}', '{"truth": []}', "\xff", '{"truth": {"effects": 5}}'),
        '{"truth": {"effects": []}}',
        '{"truth": {"effects": [1], "noise": {"rms": 1, "unit": "mm"}, "change": {}, "machine": 3}}',
        '{"truth": {"effects": [], "noise": 1, "change": {}}}',
        '{"truth": {"effects": [], "noise": {"rms": "x", "unit": "mm"}, "change": {}}}',
    ],
)
def test_a_damaged_truth_is_one_line(refuses_command, tmp_path, text):
    (tmp_path / "truth.json").write_bytes(text.encode("latin-1"))
    refuses_command("simulate", "--open", tmp_path / "truth.json")


# tables that are written again -------------------------------------------------------------------------


def test_other_columns_are_kept_letter_for_letter(tmp_path):
    source, output = tmp_path / "a.csv", tmp_path / "b.csv"
    source.write_text("C [deg],x [mm],load [N]\n0.50,1e0,007\n\n+1, 2.,-0\n")
    columns = {"x [mm]": np.array([1.5, 2.5]), "y [mm]": np.array([0.1, 0.2])}
    copy_with(str(source), output, columns, replaced={"x [mm]": "x [mm]"})
    assert output.read_text() == "C [deg],x [mm],load [N],y [mm]\n0.50,1.5,007,0.1\n+1,2.5,-0,0.2\n"


def test_parquet_gets_numbers(tmp_path):
    source, output = tmp_path / "a.csv", tmp_path / "b.parquet"
    source.write_text("C [deg],target\n0.50,ball\n1,ball\n")
    copy_with(str(source), output, {"x [mm]": np.array([1.5, 2.5])})
    table = pq.read_table(output).to_pydict()
    assert table == {"C [deg]": [0.5, 1.0], "target": ["ball", "ball"], "x [mm]": [1.5, 2.5]}


def test_nothing_is_written_when_something_goes_wrong(refuses, tmp_path):
    source, output = tmp_path / "a.csv", tmp_path / "b.csv"
    source.write_text("C [deg]\n0\n1\n")
    for columns in ({"x [mm]": np.zeros(3)}, {"x [mm]": np.zeros(1)}, {"C [deg]": np.zeros(2)}):
        refuses(copy_with, str(source), output, columns)
    refuses(copy_with, str(source), source, {})
    refuses(copy_with, "-", output, {})
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


# what is typed -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12", (12.0, "")),
        ("-1.5e-3arcsec", (-0.0015, "arcsec")),
        (" +.5 mm/K ", (0.5, "mm/K")),
        ("3e2", (300.0, "")),
        ("2 1/K", (2.0, "1/K")),
        ("2e", (2.0, "e")),
        ("", None),
        ("mm", None),
        ("1e400", None),
        ("inf", None),
        ("0x10", (0.0, "x10")),
    ],
)
def test_numbers_with_units(text, expected):
    assert number_and_unit(text) == expected


@given(text=st.text(max_size=60) | st.text("backlsh@:=,.[]12 mCe-", max_size=60))
def test_whatever_is_typed_is_taken_apart_or_refused_in_one_line(text):
    with contextlib.suppress(UnfitEffectError):
        assert all(typed_effect(text).numbers.values())


def test_effects_as_typed(refuses):
    found = typed_effect("frame_shift[ a 1 ]:x=0.1mm,rz= 3arcsec")
    assert (found.name, found.run, found.place) == ("frame_shift", " a 1 ", None)
    assert dict(found.numbers) == {"x": "0.1mm", "rz": "3arcsec"}
    assert typed_effect("target_offset@ball 1").place == "ball 1"
    assert assignments(["k2 = 0"]) == {"k2": "0"}
    for text in ("=1", "a=", "a", "a=1,,b=2"):
        refuses(assignments, text.split(","))
