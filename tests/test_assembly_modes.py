"""Which assembly mode a 3-SPS-S is in: the readings of a pose tell it together, and what a fit does near folds."""

from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.problem.binding import bind
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "examples/machines/three_sps_s"


def example(tmp_path, *changes):
    text = (FOLDER / "machine.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def with_distances(data, origin):
    columns = {name: c.values for name, c in data.columns.items() if name != "target"}
    target = data.columns["target"]
    place = np.stack([columns[x] for x in "xyz"], axis=1)
    frame = {f"{name} [mm]": columns[name] for name in ("L1", "L2", "L3")}
    frame |= {
        "target": np.array(target.names)[target.codes],
        "d [mm]": np.linalg.norm(place - origin, axis=1),
    }
    return Measurements.from_frame(frame)


def test_distances_of_one_pose_tell_its_mode_together(tmp_path):
    """One distance is nearly the same in two modes; those to three balls of a body are not."""
    data = Measurements.load(FOLDER / "data.csv")
    by_points = bind(Machine.load(FOLDER / "machine.toml"), data).pose_start
    origin = np.array([300.0, -200.0, 1500.0])
    path = example(
        tmp_path,
        ("R = 200", "R = 201"),
        ('kind  = "point"', f'kind  = "distance"\nfrom = {origin.tolist()}'),
    )
    by_distances = bind(Machine.load(path), with_distances(data, origin)).pose_start
    # 1 mm of R turns the platform by some hundredths, another mode by much more
    assert np.abs(by_distances - by_points).max() < 0.1


@pytest.mark.parametrize("off", [pytest.param(5, marks=pytest.mark.slow), 20])
def test_a_fit_comes_from_far_off(tmp_path, off):
    """The true radius is 200.06 mm; the poses at the start are far from those at the end."""
    fit = Machine.load(example(tmp_path, ("R = 200", f"R = {200 + off}"))).fit(
        Measurements.load(FOLDER / "data.csv")
    )
    right = Machine.load(FOLDER / "machine.toml").fit(Measurements.load(FOLDER / "data.csv"))
    assert fit.solution.converged
    assert fit.rms == pytest.approx(right.rms, rel=1e-6)
    found, wanted = (f.estimates["geometry.R"] for f in (fit, right))
    assert found.value + off == pytest.approx(wanted.value, abs=1e-3 * wanted.std)


@pytest.mark.thorough
def test_another_mode_than_that_of_the_readings_is_reported_and_diagnoses_nothing(tmp_path, capsys):
    path = example(tmp_path, ("h = 260", "start = [0, 0, -150]\nh = 260"))
    main(["fit", str(path), str(FOLDER / "data.csv")])
    said = capsys.readouterr().out
    assert (
        "In 100% of the rows another assembly mode than that of [geometry] start is nearer to the readings"
        in said
    )
    # whether such a fit converges depends on rounding
    converged = Machine.load(path).fit(Measurements.load(FOLDER / "data.csv")).solution.converged
    assert main(["diagnose", str(path), str(FOLDER / "data.csv")]) == (0 if converged else 3)
    assert (
        "These data cannot tell: This looks like a wrong file: in 100% of the rows another assembly mode"
        in " ".join(capsys.readouterr().out.split())
    )
