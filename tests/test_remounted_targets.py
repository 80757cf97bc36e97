"""A target that was taken off between runs and put on again."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.selection import select
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model

ARM = """name = "Two axes of an arm"
units = { length = "mm", angle = "deg" }
joint = [
  { name = "A1", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] },
  { name = "A2", type = "revolute", axis = [0, 1, 0], point = [0, 0, 340] },
]
target = [{ name = "marker", point = [0, 0, 1300]ATTITUDE }]
measured = { kind = "KIND", frame = "free" }
estimate = { parameters = ["target"] }
"""
KEY = ("target_remounting", "marker")


def arm(folder: Path, turns, heights, *, kind="pose", rows=12, attitude=""):
    """Write what a tracker reads of a marker that sits in each run turned by some degrees and at some height."""
    rng = np.random.default_rng(2)
    table = []
    for run, (turn, height) in enumerate(zip(turns, heights, strict=True), 1):
        for _ in range(rows):
            a, b = rng.uniform(-150, 150), rng.uniform(-80, 80)
            m = Rotation.from_euler("ZY", [a, b], degrees=True)
            place = m.apply([0, 0, height - 340]) + [0, 0, 340] + rng.normal(0, 0.1, 3)  # noqa: RUF005
            noise = Rotation.from_rotvec(1e-4 * rng.normal(size=3))
            turned = noise * m * Rotation.from_euler("Z", turn, degrees=True)
            turn_vector = turned.as_rotvec(degrees=True) if kind == "pose" else []
            table.append([a, b, *place, *turn_vector, run])
    (folder / "machine.toml").write_text(ARM.replace("KIND", kind).replace("ATTITUDE", attitude))
    read = ["rx [deg]", "ry [deg]", "rz [deg]"] if kind == "pose" else []
    header = ",".join(["A1 [deg]", "A2 [deg]", "x [mm]", "y [mm]", "z [mm]", *read, "run"])
    np.savetxt(folder / "data.csv", table, "%.9g", ",", header=header, comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


@pytest.mark.thorough
@pytest.mark.parametrize("attitude", ["", ", attitude = [10, 0, 40]"])
def test_a_marker_that_was_turned_between_runs_is_found_and_measured(attitude, tmp_path):
    base = arm(tmp_path, (0, 20, 38), (1300, 1297, 1302), attitude=attitude)
    evidence = Evidence.of(base)
    (chosen,) = select(evidence)
    assert chosen.key == KEY
    final = base.machine.with_effect(chosen.effect).fit(base.observations.data)
    assert final.rms < 0.12
    for run, turn, height in ((2, 20, -3), (3, 38, 2)):
        found = {x: final.estimates[f"marker.target_remounting[{run}].{x}"] for x in ("z", "rx", "ry", "rz")}
        assert found["z"].value == pytest.approx(height, abs=5 * found["z"].std)
        degrees = [found[x].value / 3600 for x in ("rx", "ry", "rz")]
        assert degrees == pytest.approx([0, 0, turn], abs=0.02)


def test_a_ball_that_was_put_on_again_is_found_by_its_places(tmp_path):
    base = arm(tmp_path, (0, 0, 0), (1300, 1299, 1301), kind="point")
    assert [c.key for c in select(Evidence.of(base))] == [KEY]


def test_nothing_is_remounted_where_nothing_was_and_where_there_is_one_run(tmp_path):
    base = arm(tmp_path, (0, 0, 0), (1300, 1300, 1300))
    evidence = Evidence.of(base)
    assert select(evidence) == []
    assert KEY in {c.key for c in evidence.candidates}
    one = arm(tmp_path, (0,), (1300,))
    assert KEY not in {c.key for c in Evidence.of(one).candidates}
    model = Model(one.machine.add(*KEY[:1], target=KEY[1]), runs=("1",))
    assert not any("remounting" in key for key in model.keys)
    assert one.machine.add("target_remounting", target="marker").fit(
        one.observations.data
    ).rms == pytest.approx(one.rms)
