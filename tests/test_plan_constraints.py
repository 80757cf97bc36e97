"""Constraints of a plan: every proposed reading respects them, and what contradicts itself is one sentence."""

from __future__ import annotations

import numpy as np
import pytest
from machine_cases import joint, machine_file, toml
from simulated_fits import fit_to, measure

from rodgen.calibration.fit import fit
from rodgen.calibration.plan import Plan, load_constraints, plan
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.files.read import machine_of
from rodgen.machines.templates import machine_template

TABLE = machine_file(
    [
        joint("X", "prismatic", (1, 0, 0), travel=[0, 500]),
        joint("Y", "prismatic", (0, 1, 0), travel=[0, 400]),
        joint("Z", "prismatic", (0, 0, 1), travel=[0, 300]),
        joint("A", "revolute", (1, 0, 0), (0, 0, 100), travel=[-1.5, 1.5]),
    ],
    [(0, 20, 40), (10, -60, 90)],
    estimate=["X.axis", "Y.axis", "A.axis", "A.point"],
    noise=0.002,
)
MOUNT = machine_file(
    [
        joint("AZ", "revolute", (0, 0, -1), travel=[0, 6.2]),
        joint("EL", "revolute", (1, 0, 0), travel=[0.1, 1.5]),
    ],
    [(0, 1, 0)],
    kind="direction",
    estimate=["AZ.axis", "EL.axis", "target"],
    noise=5e-6,
)


def fit_of(file: dict, *, rows: int = 60):
    random = np.random.default_rng(5)
    columns = {
        f"{j['name']} [{'rad' if j['type'] == 'revolute' else 'mm'}]": random.uniform(*j["travel"], rows)
        for j in file["joint"]
    }
    if len(file["target"]) > 1:
        columns["target"] = ["p", "r"] * (rows // 2)
    return fit_to(file, measure(file, columns, noise=file["measured"]["noise"], random=random))


@pytest.fixture(scope="module")
def table():
    return fit_of(TABLE)


@pytest.fixture(scope="module")
def mount():
    return fit_of(MOUNT)


@pytest.fixture
def planned(tmp_path):
    def of(fit, text: str = "", n: int = 14, wanted=("A", "X.axis"), poses=None) -> Plan:
        path = tmp_path / "limits.toml"
        path.write_text(text, encoding="utf-8")
        found = load_constraints(path, fit.machine)
        if poses is not None:
            found = found.with_poses(fit.machine, Measurements.from_frame(poses, name="poses.csv"))
        return plan(fit, n, wanted=wanted, constraints=found)

    return of


def places(file: dict, found: Plan) -> np.ndarray:
    """Where the independent simulator has the target in the planned readings."""
    read = measure(file, found.rows)
    return np.array(
        [values for name, values in read.items() if name.split(" ")[0] in {"x", "y", "z", "ux", "uy", "uz"}]
    ).T


# what readings respect ---------------------------------------------------------------------------------------------


def test_limits_of_joints(table, planned):
    found = planned(table, "[limits]\nX = [100, 250]\nA = [-0.2, 0.9]")
    X, A = (np.array(found.rows[name]) for name in ("X [mm]", "A [rad]"))
    assert found.count == 14
    assert (X >= 100).all()
    assert (X <= 250).all()
    assert (A >= -0.2).all()
    assert (A <= 0.9).all()
    assert np.ptp(X) > 100


def test_altitude_and_formulas(mount, planned):
    text = 'allowed = ["altitude > 20 deg", "EL < 1.2", "sin(AZ)*EL < 0.5 rad"]'
    found = planned(mount, text, wanted=["EL.axis", "AZ.axis"])
    AZ, EL = (np.array(found.rows[name]) for name in ("AZ [rad]", "EL [rad]"))
    assert found.count == 14
    assert (np.arcsin(places(MOUNT, found)[:, 2]) > np.radians(20)).all()
    assert (EL < 1.2).all()
    assert (np.sin(AZ) * EL < 0.5).all()
    low = planned(mount, 'allowed = ["altitude > 10 deg"]', wanted=["EL.axis", "AZ.axis"])
    assert (np.array(low.rows["EL [rad]"]) < 0.3).any()


def test_stars_are_neither_low_nor_in_the_zenith_unless_that_is_asked_for(mount, planned):
    found = planned(mount, wanted=["EL.axis", "AZ.axis"])
    altitude = np.degrees(np.arcsin(places(MOUNT, found)[:, 2]))
    assert ((altitude > 19.99) & (altitude < 80.01)).all()  # the fitted mount, not the nominal one
    assert "Stars are taken at altitudes of 20 to 80 deg" in " ".join(found.notes)
    assert not found.sky


@pytest.mark.parametrize("travel", [[0.1, 0.45], [1.2, 1.5]], ids=["low", "high"])
def test_stars_are_within_the_travel_of_the_mount_and_well_seen(travel, planned):
    some = fit_of({**MOUNT, "joint": [MOUNT["joint"][0], {**MOUNT["joint"][1], "travel": travel}]})
    found = planned(some, wanted=["EL.axis", "AZ.axis"])
    EL = np.array(found.rows["EL [rad]"])
    assert ((max(travel[0], np.radians(20)) - 1e-3 < EL) & (min(travel[1], np.radians(80)) + 1e-3 > EL)).all()


@pytest.mark.thorough
@pytest.mark.parametrize("travel", [[0.05, 0.3], [1.45, 1.55]], ids=["low", "zenith"])
def test_a_mount_that_sees_no_star_well_is_planned_for_all_the_same(refuses, travel, planned):
    low = fit_of({**MOUNT, "joint": [MOUNT["joint"][0], {**MOUNT["joint"][1], "travel": travel}]})
    found = planned(low, "[limits]\nAZ = [1, 4]", wanted=["EL.axis", "AZ.axis"])
    assert found.count == 14
    assert "No star within the travel and the constraints is at an altitude of 20 to 80 deg" in " ".join(
        found.notes
    )
    assert "Stars are taken at" not in " ".join(found.notes)
    refuses(planned, low, 'allowed = ["AZ < 0"]', wanted=["EL.axis"])


def test_a_german_mount_s_stars_have_altitudes_and_both_sides_of_its_pier(planned):
    latitude, random = np.radians(45.0), np.random.default_rng(2)
    built = machine_of(machine_template("equatorial-german", latitude=latitude), "german.toml")
    ha, dec = random.uniform(-60, 60, 40), random.uniform(-10, 60, 40)
    over = np.arange(40) % 2 == 1  # the other side of the pier: through the pole
    h, d = np.radians(np.where(over, ha + 180, ha)), np.radians(np.where(over, 180 - dec, dec))
    ux, uy, uz = np.cos(d) * np.cos(h), -np.cos(d) * np.sin(h), np.sin(d)
    columns = {"HA [deg]": np.degrees(h), "DEC [deg]": np.degrees(d), "ux": ux, "uy": uy, "uz": uz}
    noise = 1e-5 * random.normal(size=(3, 40))
    columns |= {name: columns[name] + x for name, x in zip(("ux", "uy", "uz"), noise, strict=True)}
    found = planned(fit(built, Measurements.from_frame(columns)), wanted=["HA.axis", "target"])
    h, d = (np.radians(found.rows[name]) for name in ("HA [deg]", "DEC [deg]"))
    # spherical trigonometry; the fitted mount is within its noise of the nominal one
    sine = np.sin(latitude) * np.sin(d) + np.cos(latitude) * np.cos(d) * np.cos(h)
    assert np.array(found.sky["altitude [deg]"]) == pytest.approx(np.degrees(np.arcsin(sine)), abs=0.02)
    assert all(20 <= x <= 80 for x in found.sky["altitude [deg]"])
    west, north = (
        np.cos(d) * np.sin(h),
        np.cos(latitude) * np.sin(d) - np.sin(latitude) * np.cos(d) * np.cos(h),
    )
    turned = np.degrees(np.arctan2(-west, north)) - found.sky["azimuth [deg]"]
    assert np.abs((turned + 180) % 360 - 180).max() < 0.05
    sides = np.cos(d) > 0
    assert sides.sum() == found.count / 2
    assert "altitude [deg]  azimuth [deg]" in found.summary()
    assert "altitude" not in found.csv()


def test_boxes_are_kept_out_of(table, planned):
    text = "[[keep_out]]\nx = [0, 500]\ny = [-50, 250]\n[[keep_out]]\nz = [250, 1000]\n"
    x, y, z = places(TABLE, planned(table, text)).T
    # the fitted machine is outside, not the nominal one
    assert ((y < -49.98) | (y > 249.98) | (x < 0.02) | (x > 499.98)).all()
    assert (z < 250.02).all()
    _, y, z = places(TABLE, planned(table)).T
    assert ((y > -50) & (y < 250)).any()  # without the boxes these were the places to be
    assert (z > 250).any()


def test_ways_through_boxes_are_left_to_the_user_and_that_is_noted(table, planned):
    around = planned(table, "[[keep_out]]\nx = [240, 260]\n")
    assert any("not on the ways between them" in note for note in around.notes)


@pytest.mark.thorough
def test_a_narrow_region_is_searched_for_readings(table, planned):
    text = 'allowed = ["x + y < 101 mm", "x + y > 99 mm", "z < 200"]'
    found = planned(table, text)
    x, y, z = places(TABLE, found).T
    assert found.count == 14
    assert (np.abs(x + y - 100) < 1.01).all()
    assert (z < 200).all()


def test_balls_of_an_artefact_are_the_only_places(table, planned):
    balls = [[100, 50, 200], [300, 50, 200], [100, 300, 250], [400, 300, 100], [9000, 0, 0]]
    found = planned(table, f"[artefact]\nballs = {balls}", n=20)
    at = places(TABLE, found)
    off = np.linalg.norm(at[:, None] - np.array(balls), axis=2)
    # the fitted machine is at the ball, not the nominal one: they differ by the noise
    assert (off.min(axis=1) < 0.02).all()
    assert set(np.argmin(off, axis=1)) <= {0, 1, 2, 3}  # the last is out of reach
    assert len(set(np.argmin(off, axis=1))) >= 3
    assert np.ptp(found.rows["A [rad]"]) > 0.5  # a ball is reached with A anywhere
    assert "Out of reach within the travel and the limits: ball 5 of the artefact." in found.notes


def test_poses_come_from_the_list(table, planned):
    random = np.random.default_rng(1)
    poses = {
        f"{j['name']} [{'rad' if j['name'] == 'A' else 'mm'}]": random.uniform(*j["travel"], 40)
        for j in TABLE["joint"]
    }
    poses["target"] = ["p"] * 20 + ["r"] * 20
    found = planned(table, poses=poses)
    rows = {(*np.round(row[:4], 5), row[4]) for row in zip(*poses.values(), strict=True)}
    names = [*list(poses)[:4], "target"]
    assert found.count == 14
    for row in zip(*(found.rows[name] for name in names), strict=True):
        assert (*np.round(row[:4], 5), row[4]) in rows
    any_target = planned(table, poses={name: x for name, x in poses.items() if name != "target"})
    assert any_target.count
    assert {*any_target.rows["target"]} <= {"p", "r"}
    inside = planned(table, "[limits]\nX = [0, 250]", poses=poses)
    assert max(inside.rows["X [mm]"]) <= 250


def test_readings_of_a_session_are_the_most_that_are_planned(table, planned):
    assert planned(table, "[session]\nreadings = 5", n=20).count == 5


# what contradicts itself ---------------------------------------------------------------------------------------------


@pytest.mark.thorough(
    "[limits]\\nX = [300, 200]", "[limits]\\nU = [0, 1]", "[artefact]\\nballs = [9000, 0, 0]"
)
@pytest.mark.parametrize(
    "text",
    [
        'allowed = ["X < 100", "X > 200"]',
        'allowed = ["x > 9 m"]',
        "[[keep_out]]\nx = [-9000, 9000]",
        "[limits]\nX = [600, 700]",
        "[limits]\nX = [300, 200]",
        "[limits]\nU = [0, 1]",
        "[artefact]\nballs = [[9000, 0, 0]]",
        "[artefact]\nballs = [9000, 0, 0]",
        'allowed = ["X"]',
        'allowed = ["X < 3 deg"]',
        'allowed = ["V < 3"]',
        'allowed = ["X + A < 3"]',
        "[session]\nreadings = 0",
        "[move]\nsettle = 2",
        "[[keep_out]]\n",
    ],
)
def test_contradictions_and_mistakes_are_one_sentence(refuses, table, planned, text):
    refuses(planned, table, text)


# the command ---------------------------------------------------------------------------------------------------------


def test_command_reads_constraints_and_poses(tmp_path, capsys):
    (tmp_path / "mount.toml").write_text(toml(MOUNT), encoding="utf-8")
    data = fit_of(MOUNT).observations.data
    names = [column.text for column in data.columns.values()]
    lines = [",".join(map(str, row)) for row in zip(*(c.values for c in data.columns.values()), strict=True)]
    (tmp_path / "stars.csv").write_text("\n".join([",".join(names), *lines]) + "\n", encoding="utf-8")
    (tmp_path / "limits.toml").write_text('allowed = ["altitude > 30 deg"]', encoding="utf-8")
    random = np.random.default_rng(3)
    poses = [f"{a},{e}" for a, e in zip(random.uniform(0, 360, 50), random.uniform(6, 85, 50), strict=True)]
    (tmp_path / "poses.csv").write_text("\n".join(["AZ [deg],EL [deg]", *poses]) + "\n", encoding="utf-8")
    files = [str(tmp_path / name) for name in ("mount.toml", "stars.csv")]
    more = ["--constraints", str(tmp_path / "limits.toml"), "--poses", str(tmp_path / "poses.csv")]
    out = tmp_path / "next.csv"
    assert main(["plan", *files, "--for", "EL.axis", *more, "-n", "8", "-o", str(out)]) == 0
    capsys.readouterr()
    found = Measurements.load(out)
    assert found.rows == 8
    elevation = found.columns["EL"].values
    assert (elevation > np.radians(30)).all()
    listed = np.radians([float(pose.split(",")[1]) for pose in poses])
    assert (np.abs(elevation[:, None] - listed).min(axis=1) < 1e-8).all()
    (tmp_path / "limits.toml").write_text('allowed = ["altitude > 89 deg"]', encoding="utf-8")
    assert main(["plan", *files, "--for", "EL.axis", *more, "-o", str(tmp_path / "none.csv")]) == 2
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    assert "no reading within the list of poses meets it" in shown.err
    assert not (tmp_path / "none.csv").exists()
    capsys.readouterr()
    (tmp_path / "poses.csv").write_text("AZ [deg],EL [deg]\n", encoding="utf-8")
    assert main(["plan", *files, "--for", "EL.axis", *more]) == 2
    assert "poses.csv: file: no rows" in capsys.readouterr().err
