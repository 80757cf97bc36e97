"""Measurements in many files: read in parts on two processes, with the answers of one table in memory."""

import dataclasses
import json
import os
import shutil
import signal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.predict import predict_parts
from rodgen.calibration.problem.blocks import observed
from rodgen.calibration.simulate import simulate
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.schedulers import workers

pytestmark = pytest.mark.xdist_group("scan")

ROWS, FILES, GROUP = 6000, 4, 400


@pytest.fixture(scope="module")
def plain():
    """A rotary table on a slide with two balls on it."""
    return Machine(
        name="Table",
        length_unit="mm",
        angle_unit="deg",
        gravity=(0, 0, -1),
        reference_temperature=20,
        joints=(Joint("X", "prismatic", (1, 0, 0)), Joint("C", "revolute", (0, 0, 1))),
        targets=(Target("near", (120, 0, 40)), Target("far", (0, 300, 60))),
        measured=Measured("point", "free"),
        estimate=("target",),
    )


@pytest.fixture(scope="module")
def machine(plain):
    """The same with what was measured: backlash, which follows the order of rows, a temperature, and two set-ups."""
    return plain.add("backlash", joint="X").add("thermal_expansion", joint="X").add("frame_shift")


@pytest.fixture(scope="module")
def frame(plain):
    """Rows in which the slide mostly stands still, so that many parts begin without a motion."""
    random = np.random.default_rng(5)
    way = np.cumsum(random.choice([-1, 1], ROWS, p=[0.5, 0.5]) * (np.arange(ROWS) % 500 == 250))
    design = {
        "X [mm]": 40.0 * way + np.where(np.arange(ROWS) < 2000, 0.0, 7.0),
        "C [deg]": np.repeat(random.uniform(0, 360, ROWS // 3), 3),
        "target": np.where(np.arange(ROWS) // 50 % 2, "near", "far"),
        "T_X [degC]": 20 + 3 * np.sin(np.arange(ROWS) / 700),
        "run": np.where(np.arange(ROWS) < 4100, "first", "second"),
        "humidity": random.uniform(size=ROWS),
    }
    effects = ["backlash@X:b=12um", "thermal_expansion@X:alpha=11e-6", "encoder_ellipticity@C:a=4arcsec"]
    made = simulate(plain, design, effects, noise="2um", seed=1)
    return design | {name: np.asarray(values) for name, values in made.columns.items()}


@pytest.fixture(scope="module")
def folder(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("week")
    table = pa.table(frame)
    for k in range(FILES):
        part = table.slice(k * ROWS // FILES, ROWS // FILES)
        pq.write_table(part, path / f"day{k}.parquet", row_group_size=GROUP)
    return path


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    """Every row group a part, and a sample of a sixth of the rows."""
    monkeypatch.setattr("rodgen.data.tables.parts.PART_ROWS", 1)
    monkeypatch.setattr("rodgen.calibration.problem.blocks.STRETCH", ROWS // 6 // 20)


@pytest.fixture(scope="module")
def in_memory(machine, frame):
    return fit(machine, Measurements.from_frame(frame))


def assert_same(found, expected, within=1e-5):
    """To a part of a standard deviation: both end where the next step is far below one."""
    assert found.degrees_of_freedom == expected.degrees_of_freedom
    assert found.rms == pytest.approx(expected.rms, rel=1e-9)
    for key, estimate in expected.estimates.items():
        other = found.estimates[key]
        assert (other.held, other.determined, other.convention) == (
            estimate.held,
            estimate.determined,
            estimate.convention,
        )
        if estimate.std:
            assert abs(other.value - estimate.value) < within * estimate.std, key


@pytest.mark.quick("threads=2")
@pytest.mark.parametrize("where", ["threads=2", "processes=2"])
def test_a_fit_in_parts_is_that_of_the_table(machine, folder, in_memory, where):
    scan = Measurements.scan(folder)
    assert len(scan.parts) == FILES * -(-ROWS // FILES // GROUP)
    with workers(where):
        assert_same(fit(machine, scan), in_memory)


@pytest.mark.slow
def test_a_worker_is_killed_in_the_middle(machine, folder, in_memory):
    """Its parts are read again by the other one."""
    killed = []

    def kill(stage, done, total):
        if stage == "all rows" and done == 3 and not killed:
            killed.append(next(iter(active.client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    with workers("processes=2") as active:
        found = fit(machine, Measurements.scan(folder), progress=kill)
        assert killed
        assert_same(found, in_memory)


def test_a_damaged_row_group_is_named(refuses, machine, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "week")
    file = tmp_path / "week/day2.parquet"
    column = pq.read_metadata(file).row_group(1).column(0)
    data = bytearray(file.read_bytes())
    start = column.data_page_offset
    data[start : start + column.total_compressed_size] = b"\xff" * column.total_compressed_size
    file.write_bytes(data)
    refuses(fit, machine, Measurements.scan(tmp_path / "week"))


def test_a_wrong_cell_is_named_with_its_file_and_row(refuses, machine, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "week")
    table = pq.read_table(tmp_path / "week/day1.parquet")
    x = table["x [mm]"].to_numpy().copy()
    x[1234] = np.nan
    pq.write_table(table.set_column(table.schema.names.index("x [mm]"), "x [mm]", pa.array(x)),
                   tmp_path / "week/day1.parquet", row_group_size=GROUP)  # fmt: skip
    refuses(fit, machine, Measurements.scan(tmp_path / "week"))


@pytest.mark.parametrize("change", [{"x [mm]": "x [m]"}, {"run": "setup"}])
def test_another_unit_or_column_in_one_file_is_told_before_anything_is_read(
    refuses, folder, tmp_path, change
):
    shutil.copytree(folder, tmp_path / "week")
    file = tmp_path / "week/day3.parquet"
    table = pq.read_table(file)
    pq.write_table(table.rename_columns([change.get(name, name) for name in table.schema.names]), file)
    refuses(Measurements.scan, tmp_path / "week/*.parquet")


def test_a_unit_that_does_not_fit_the_machine_is_told_before_anything_is_read(
    refuses, machine, frame, tmp_path, monkeypatch
):
    pq.write_table(
        pa.table({name.replace("C [deg]", "C [mm]"): x for name, x in frame.items()}), tmp_path / "a.parquet"
    )
    scan = Measurements.scan(tmp_path / "a.parquet")
    monkeypatch.setattr("rodgen.calibration.problem.blocks.Blocks.ask", None)
    refuses(fit, machine, scan)


def test_no_file_and_no_rows_are_told(refuses, machine, frame, tmp_path):
    refuses(Measurements.scan, tmp_path / "*.parquet")
    pq.write_table(pa.table(frame).slice(0, 0), tmp_path / "a.parquet")
    refuses(fit, machine, Measurements.scan(tmp_path))


def test_a_file_without_rows_among_others_changes_nothing(machine, folder, frame, in_memory, tmp_path):
    shutil.copytree(folder, tmp_path / "week")
    pq.write_table(pa.table(frame).slice(0, 0), tmp_path / "week/day1b.parquet")
    assert_same(fit(machine, Measurements.scan(tmp_path / "week")), in_memory)


def test_few_rows_in_many_files_are_as_one_table(machine, folder, in_memory, monkeypatch):
    """Also what is decided on single rows: the folds of poses that the fit does not see."""
    monkeypatch.setattr("rodgen.calibration.problem.blocks.STRETCH", ROWS // 20)
    found = fit(machine, Measurements.scan(folder))
    assert found.observations.blocks is None
    assert_same(found, in_memory)
    assert found.held_out().rms == pytest.approx(in_memory.held_out().rms, rel=1e-9)
    assert found.observations.data.place(4500) == "row 4500 (from 0)"


def test_files_at_an_address_are_read(machine, folder, in_memory):
    scan = Measurements.scan(f"file://{folder}/day*.parquet")
    assert scan.rows == ROWS
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    for file in folder.iterdir():
        memory.pipe(f"/week/{file.name}", file.read_bytes())
    assert_same(fit(machine, Measurements.scan("memory://week/*.parquet")), in_memory)


@pytest.mark.slow
def test_a_comparison_and_a_diagnosis_are_those_of_the_table(machine, folder, frame, in_memory, monkeypatch):
    """Both are decided on the same rows; full fits are of all rows. Folds of poses are dealt otherwise."""
    monkeypatch.setattr("rodgen.calibration.problem.blocks.STRETCH", 260)
    expected = in_memory.diagnose()
    found = diagnose(machine, Measurements.scan(folder))
    assert found.rows == ROWS
    assert [step.effect for step in found.steps] == [step.effect for step in expected.steps]
    assert [step.effect.title for step in found.steps] == ["encoder_ellipticity at C"]
    assert_same(found.final, expected.final)
    for key, estimate in expected.final.estimates.items():
        assert found.final.estimates[key].std == pytest.approx(estimate.std, rel=1e-6)
    for own, other in zip(found.fits, expected.fits, strict=True):
        assert own.held_out().rms == pytest.approx(other.held_out().rms, rel=2e-3)
        assert own.rms < own.held_out().rms
    assert found.steps[0].log10_odds == pytest.approx(expected.steps[0].log10_odds, rel=1e-3)
    assert "stretches spread evenly over all" in " ".join(found.summary().split())
    compared = fit(machine, Measurements.scan(folder)).compare()
    assert [one.trial.name for one in compared.found] == [one.trial.name for one in in_memory.compare().found]


@pytest.mark.slow
def test_gross_errors_of_the_sample_are_taken_off_the_sums(machine, frame, tmp_path):
    """Rows that a diagnosis leaves out are left out of all sums, as in memory."""
    wrong = np.array([3, 700])
    x = frame["x [mm]"].copy()
    x[wrong] += 5.0
    pq.write_table(pa.table(frame | {"x [mm]": x}), tmp_path / "a.parquet", row_group_size=GROUP)
    observations = observed(machine, Measurements.scan(tmp_path))
    outliers = np.isin(observations.given(np.arange(observations.n)), wrong)
    assert outliers.sum() == 1
    found = fit(machine, observations, outliers=outliers)
    table = Measurements.from_frame(frame | {"x [mm]": x})
    gone = np.zeros(ROWS, bool)
    gone[observations.given(np.flatnonzero(outliers))] = True
    expected = fit(machine, table, outliers=gone)
    assert_same(found, expected)
    # of the sample, which does not have the other one
    assert found.held_out().rms == pytest.approx(expected.held_out().rms, rel=2e-2)


def test_what_is_not_done_in_parts_is_refused(refuses, machine, folder, frame):
    aside = machine.setting_aside(Measurements.from_frame(frame, name="day0.parquet"), rows=[3], why="bumped")
    refuses(fit, aside, Measurements.scan(folder))
    poses = dataclasses.replace(machine, measured=Measured("pose", "free"))
    refuses(fit, poses, Measurements.scan(folder))


@pytest.mark.thorough
def test_a_robust_fit_finds_the_outliers_of_all_rows(machine, frame, tmp_path):
    """Most of them are not in the sample; the others are those of the table in memory, and so is the fit."""
    machine = machine.add("encoder_ellipticity", joint="C")
    wrong = np.random.default_rng(3).choice(ROWS, 40, replace=False)
    x = frame["x [mm]"].copy()
    x[wrong] += np.linspace(0.02, 50.0, 40)
    pq.write_table(pa.table(frame | {"x [mm]": x}), tmp_path / "a.parquet", row_group_size=GROUP)
    found = fit(machine, Measurements.scan(tmp_path), loss="huber")
    expected = fit(machine, Measurements.from_frame(frame | {"x [mm]": x}), loss="huber")
    assert sorted(found.outlier_numbers) == sorted(expected.outlier_numbers) == sorted(wrong.tolist())
    assert_same(found, expected, within=1e-4)  # of outliers by 50 mm the sums have fewer digits
    assert "40 outliers, taken out: rows" in found.summary()


def test_the_command_line_takes_patterns_and_a_scheduler(machine, folder, tmp_path, capsys):
    file = tmp_path / "machine.toml"
    file.write_text(machine_text(machine))
    assert main(["fit", str(file), f"{folder}/*.parquet", "--scheduler", "threads=2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == ROWS
    assert main(["fit", str(file), str(folder), "--scheduler", "tcp:1"]) == 2
    assert "scheduler 'tcp:1'; expected threads" in capsys.readouterr().err
    assert main(["check", str(file), str(folder)]) == 2
    assert "many files; expected one, as this is not done in parts" in capsys.readouterr().err
    assert main(["fit", str(file), str(folder), "--residuals", str(tmp_path / "r.csv")]) == 2
    assert "--residuals of many files; expected one file" in capsys.readouterr().err


def test_predictions_for_many_files_are_those_for_the_table(machine, in_memory, folder, frame, tmp_path):
    """The slide stands still where most parts begin: what its backlash does there follows from the parts before."""
    file = tmp_path / "machine.toml"
    file.write_text(machine_text(machine))
    pq.write_table(pa.table(frame), tmp_path / "all.parquet")
    command = ["predict", str(file), str(tmp_path / "all.parquet"), str(folder), "--all-digits"]
    assert main([*command, "-o", str(tmp_path / "made")]) == 0
    made = Measurements.scan(tmp_path / "made")
    assert made.rows == ROWS
    found = made.joined([made.load(part) for part in made.parts], range(len(made.parts)))
    expected = in_memory.predict(Measurements.from_frame(frame))
    for name, column in expected.columns().items():
        name = name.partition(" [")[0]
        assert np.allclose(found.columns[name].values, column, rtol=1e-6, atol=1e-7), name
    assert np.array_equal(found.columns["humidity"].values, frame["humidity"])
    assert main([*command, "-o", str(tmp_path / "made")]) == 2  # is there already


def test_no_prediction_is_left_where_a_part_is_wrong(refuses, machine, in_memory, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "week")
    file = tmp_path / "week/day3.parquet"
    table = pq.read_table(file)
    wrong = pa.array(np.where(np.arange(len(table)) == 900, np.nan, table["C [deg]"].to_numpy()))
    pq.write_table(table.set_column(1, "C [deg]", wrong), file)
    refuses(predict_parts, in_memory, Measurements.scan(tmp_path / "week"), tmp_path / "made")
    assert [entry.name for entry in tmp_path.iterdir()] == ["week"]


def test_axes_of_many_files_are_those_of_each(tmp_path, capsys):
    random = np.random.default_rng(2)
    (tmp_path / "pairs").mkdir()
    names = [f"{point}_{x} [mm]" for point in ("rho", "rho_prime") for x in "xyz"]
    for k in range(3):
        table = {name: random.normal(size=50) for name in names} | {"angle [deg]": random.uniform(10, 90, 50)}
        pq.write_table(pa.table(table), tmp_path / f"pairs/{k}.parquet")
    command = ["apply", "solve_axis"]
    pairs, axes = str(tmp_path / "pairs"), str(tmp_path / "axes")
    assert main([*command, pairs, "-o", axes, "--scheduler", "threads=2"]) == 0
    assert "150 rows written: " in capsys.readouterr().err
    assert main([*command, str(tmp_path / "pairs/1.parquet"), "-o", str(tmp_path / "one.parquet")]) == 0
    assert pq.read_table(tmp_path / "axes/00001-1.parquet").equals(pq.read_table(tmp_path / "one.parquet"))
    assert main([*command, pairs, "-o", axes]) == 2
