"""Dimensions that are not those of the file are one answer; effects of a machine that is as drawn are not.

A robot is drawn once. The simulator measures it, with dimensions that are off by what such machines have, or with
drives that give way to the moments of the weights that they carry, which is physics and no formula of the catalogue.
Platforms on legs have joint centres and rods of their own, and loops that are closed as vectors.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from commands import run
from delta_cases import ARM, PRINTER, R_OF_ROBOT, ROD, TARGET, L, R, elbows, hung, probed, spiral
from diagnosis_checks import diagnosis_of
from hexapod_cases import BASE, PLATFORM, drawn_poses, hexapod_file, lengths, table
from hidden_effects import Hidden, Sealed, Truth
from machine_cases import toml
from machine_simulator import arcsec
from parallel_simulator import LEGS, Parallel
from real_machines import arm_6r
from test_delta import machine, machine_file, printer, rows_of

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.geometry import with_geometry
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.catalogue import GEOMETRY
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine

WINDUPS = {f"{joint}.weight_windup.c": 2e-4 * arcsec(1) for joint in ("J2", "J3")}
"""1e6 N m/rad, as gears of such a robot have."""


def drawn(seed: int, off: dict[str, float], effects: dict[str, float]) -> Hidden:
    """Return a robot whose file estimates targets only; `off` are its own dimensions, targets and frame."""
    random = np.random.default_rng(seed)
    bench = arm_6r(random)
    text = bench.text.replace("{noise}", "")
    text = text[: text.index("[estimate]")] + '[estimate]\nparameters = ["target"]\n'
    mounted = {key: x for key, x in bench.wrong.items() if key.startswith(("target.", "frame."))}
    bench = replace(bench, text=text, wrong=mounted | off)
    machine = bench.simulator(bench.file)
    reading = machine.with_noise(bench.measure(effects), bench.sigma, random)
    return Hidden(
        "arm", bench, {"q": bench.q, "reading": reading, "target": bench.target}, text, Sealed(Truth("none"))
    )


def tolerances(seed: int) -> dict[str, float]:
    """Return axes off by 100 arcsec and points by 0.2 mm: what machining and mounting leave."""
    random = np.random.default_rng(seed)
    size = {"axis": arcsec(100), "point": 0.2}
    return {
        f"J{j}.{what}.{x}": size[what] * random.normal() for j in range(2, 7) for what in size for x in "ab"
    }


def names(found) -> set[str]:
    return {step.effect.title for step in found.steps}


@pytest.mark.thorough
def test_dimensions_that_are_all_off_are_one_answer(tmp_path):
    found = diagnosis_of(drawn(2, tolerances(2), WINDUPS), tmp_path)
    assert found.geometry is not None
    assert (
        found.geometry.odds > 0.01
    )  # single ones in their place are more causes, and may be equally probable
    assert {"J2.axis", "J6.point", "target"} <= set(found.geometry.estimate)
    assert {"gravity_windup at J2", "gravity_windup at J3"} <= names(found)
    assert not {name.split(" at ")[0] for name in names(found)} & {"axis_tilt", "axis_offset", "zero_offset"}
    assert found.rms.after < 1.1 * arm_6r(np.random.default_rng(2)).sigma


@pytest.mark.thorough
def test_effects_of_a_machine_that_is_as_drawn_are_no_dimensions(tmp_path):
    eccentric = {"J4.encoder_eccentricity.a": arcsec(40), "J4.encoder_eccentricity.b": arcsec(-30)}
    found = diagnosis_of(drawn(2, {}, WINDUPS | eccentric), tmp_path)
    assert found.geometry is None
    assert {"gravity_windup at J2", "gravity_windup at J3", "encoder_eccentricity at J4"} <= names(found)


@pytest.mark.thorough
def test_two_dimensions_that_are_off_are_two(tmp_path):
    off = {"J3.axis.a": arcsec(250), "J5.point.a": 0.6, "J5.point.b": -0.4}
    found = diagnosis_of(drawn(3, off, WINDUPS), tmp_path)
    assert found.geometry is None
    assert {"gravity_windup at J2", "gravity_windup at J3"} <= names(found)
    assert len(names(found)) == 4


@pytest.mark.thorough
@pytest.mark.parametrize(
    "size", [pytest.param(2.0, id="degrees", marks=pytest.mark.slow), pytest.param(0.035, id="arcminutes")]
)
def test_zeros_and_windups_are_told_apart(size, tmp_path):
    """The second order of zeros of degrees is some mm, of the windups 0.2 mm: what is small shows about the large.

    What a zero of an arcminute does alone is less than two percent of what the windup of another joint does: an
    inexact formula of that is no reason to leave it out.
    """
    off = {"J2.zero_offset.a": size, "J3.zero_offset.a": -size / 2}
    found = diagnosis_of(drawn(2, {}, WINDUPS | off), tmp_path)
    assert found.geometry is None
    assert names(found) == {
        f"{name} at {joint}" for name in ("zero_offset", "gravity_windup") for joint in ("J2", "J3")
    }
    for key, true in off.items():
        one = found.final.estimates[key]
        assert abs(one.value - 3600 * true) < 4 * one.std, (key, one)
    assert found.rms.after < 1.1 * arm_6r(np.random.default_rng(2)).sigma


def dimensions(found) -> set[str]:
    return {name for name in names(found) if name.split(" at ")[0] in GEOMETRY}


@pytest.mark.thorough
def test_towers_that_are_all_off_are_one_answer(tmp_path):
    """The file that is written estimates what the diagnosis did."""
    random = np.random.default_rng(1)
    towers = {"radius": (R + 0.5, 0.3), "heading": (PRINTER, 0.2), "rod": (L, 0.2), "offset": (0.0, 0.3)}
    off = {name: drawn + size * random.normal(size=3) for name, (drawn, size) in towers.items()}
    log = probed(80, seed=1, **off)
    head = ",".join(log)
    np.savetxt(
        tmp_path / "data.csv", np.column_stack([*log.values()]), delimiter=",", header=head, comments=""
    )
    rows = Measurements.load(tmp_path / "data.csv")
    text = toml(machine_file("linear-delta", kind="height", noise=0.012))
    (tmp_path / "machine.toml").write_text(text, encoding="utf-8")
    found = diagnose(machine_of(text, "machine.toml"), rows)
    assert found.verdict == "wrong_geometry"
    assert not dimensions(found)
    assert found.rms.after == pytest.approx(0.012, rel=0.3)  # three deviations of 68 readings
    written = run("diagnose", "machine.toml", "data.csv", "-o", "new.toml", folder=tmp_path)
    assert written.returncode == 0, written.stderr
    again = fit(Machine.load(tmp_path / "new.toml"), rows)
    assert again.rms == pytest.approx(found.rms.after, rel=1e-3)  # as far as both converge


@pytest.mark.thorough
def test_one_or_two_dimensions_of_a_tower_are_named():
    rows = probed(offset=[0, 0.45, 0], heading=PRINTER + np.array([0, 0, 0.35]), radius=R + 0.8)
    found = diagnose(printer(), Measurements.from_frame(rows))
    assert found.geometry is None
    assert names(found) == {"zero_offset at B", "delta_angle at C"}


@pytest.mark.thorough
@pytest.mark.parametrize(("legs", "several"), [(slice(None), True), ([2], False)])
def test_joint_centres_of_a_hexapod(legs, several):
    random = np.random.default_rng(5)
    base, platform = BASE.copy(), PLATFORM.copy()
    for centres in (base, platform):
        centres[legs] += 0.1 * random.normal(size=centres[legs].shape)
    position, turn = drawn_poses(60, random)
    commands = lengths(position, turn, base, platform)
    rows = table(commands, position, turn, random, noise=0.01)
    built = machine_of(toml(hexapod_file(estimate=["target"])), "machine.toml")
    found = diagnose(built, Measurements.from_frame(rows))
    assert (found.geometry is not None) == several
    assert dimensions(found) == (
        set() if several else {"base_joint_offset at L3", "platform_joint_offset at L3"}
    )
    assert not {effect.name for effect in found.unseen} & (GEOMETRY if several else set())
    assert found.rms.after < 0.011  # the noise, and three deviations of 100 readings or more


REFLECTORS = {"nose": [0.0, 0, 0], "left": [120.0, 80, -60], "right": [-100.0, 70, -90]}
PLATFORMS = {
    "tricept": {"R": 330.0, "r": 140.0, "q": [0.0, 0, 250]},
    "3-sps-s": {"R": 200.0, "r": 120.0, "h": 260.0},
}


def platform(family: str, off: dict[str, float], estimate: list[str]) -> tuple[Machine, dict]:
    """Return a platform on three legs, and what a tracker with noise of 10 µm sees of three reflectors on it."""
    random = np.random.default_rng(2)
    file = {
        "name": "Three legs", "family": family, "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": [0.0, 0, 1]}, "geometry": PLATFORMS[family],
        "target": [{"name": name, "point": point} for name, point in REFLECTORS.items()],
        "measured": {"kind": "point", "frame": "free", "noise": 0.01},
        "estimate": {"parameters": estimate},
    }  # fmt: skip
    machine, legs = Parallel(file, off), LEGS[family]
    if family == "tricept":
        where = np.column_stack([*random.uniform(-0.4, 0.4, (2, 80)), random.uniform(660, 920, 80)])
    else:
        where = random.uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.9], (80, 3))
    q, names_of_rows = machine.legs(where), [[*REFLECTORS][k % 3] for k in range(80)]
    read = machine.measure(q, target=names_of_rows) + 0.01 * random.normal(size=(80, 3))
    columns = {f"{leg} [mm]": q[:, k] for k, leg in enumerate(legs)} | {"target": names_of_rows}
    columns |= {f"{x} [mm]": read[:, k] for k, x in enumerate("xyz")}
    return machine_of(toml(file), "machine.toml"), columns


@pytest.mark.thorough
@pytest.mark.parametrize("several", [True, False])
def test_joint_centres_of_a_tricept(several):
    """With radii that the file estimates already. Three joints of another draw explain as much as all."""
    random = np.random.default_rng(5)
    off = {
        f"{leg}.{joint}_joint_offset.{x}": 0.2 * random.normal()
        for leg in LEGS["tricept"][: 3 if several else 1]
        for joint in ("base", "platform")
        for x in "xyz"
    }
    built, columns = platform("tricept", off, ["geometry", "target"])
    found = diagnose(built, Measurements.from_frame(columns))
    assert (found.geometry is not None) == several
    assert bool(dimensions(found)) != several
    assert found.rms.after == pytest.approx(0.01, rel=0.15)  # three deviations of 200 readings


def delta_robot(arm: float, rod: float, radius: float, zeros: float = 0.0) -> tuple[Machine, dict]:
    """Return a delta robot, and what a tracker with noise of 20 µm sees of it; zeros of the arms in degrees."""
    random = np.random.default_rng(6)
    q = random.uniform(-0.6, 0.6, (60, 3))
    seen = [
        hung(elbows(row + np.radians(zeros), R_OF_ROBOT + radius, ARM + arm), ROD + rod, [0, 0, -800])
        for row in q
    ]
    read = np.array(seen) + TARGET + random.normal(scale=0.02, size=(60, 3))
    built = machine("rotary-delta", kind="point", estimate=["target"], noise=0.02)
    return built, rows_of(built, q) | {f"{x} [mm]": c for x, c in zip("xyz", read.T, strict=True)}


SHARED = {
    "radius of a printer": (lambda: (printer([]), probed(60, radius=R + 0.8)), {"R": 0.8}),
    "rods and radius of a printer": (
        lambda: (printer([]), probed(60, rod=L + 0.8, radius=R - 0.5, seed=1)),
        {"L": 0.8, "R": -0.5},
    ),
    "rods of a robot": (lambda: delta_robot(0.0, 0.6, 0.0), {"L": 0.6}),
    "radius and rods of a robot": (lambda: delta_robot(0.0, -0.5, 0.6), {"R": 0.6, "L": -0.5}),
    "arms of a robot": (lambda: delta_robot(0.4, 0.0, 0.0), {"A": 0.4}),
    "radii of a Tricept": (
        lambda: platform("tricept", {"geometry.R": 0.3, "geometry.r": -0.2}, ["target"]),
        {"R": 0.3, "r": -0.2},
    ),
    "height of the ball of a 3-SPS-S": (
        lambda: platform("3-sps-s", {"geometry.h": 0.3}, ["target"]),
        {"h": 0.3},
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("made", "off"), SHARED.values(), ids=SHARED.keys())
def test_numbers_that_all_legs_share_are_one_answer(made, off):
    """None of single legs, of the target or of the instrument, which do nearly the same together."""
    built, columns = made()
    found = diagnose(built, Measurements.from_frame(columns))
    assert found.verdict == "wrong_geometry"
    assert not found.steps
    assert {*found.geometry.estimate} - {"target"} == off.keys()
    for name, true in off.items():
        one = found.estimates[f"geometry.{name}"]
        assert abs(one.value - true) < 4 * one.std
        drawn = getattr(built.kinematics, name)
        assert re.search(rf"{name} is \d+\.\d+ ± 0\.\d+ mm, not {drawn:g}", " ".join(str(found).split()))
    assert found.geometry.odds > 20  # of a printer a bowl of the plate, with all zeros, does nearly the same
    assert found.rms.after_held_out < 1.3 * found.rms.noise  # three deviations of 60 readings


@pytest.mark.thorough
def test_a_number_that_the_file_estimates_is_not_called_wrong():
    built = replace(printer([]), estimate=("R", *printer([]).estimate))
    found = diagnose(built, Measurements.from_frame(probed(60, rod=L + 0.8)))
    text = " ".join(str(found).split())
    assert re.search(rf"not those of the file: L is \d+\.\d+ ± 0\.\d+ mm, not {L:g}; with that", text)
    assert "R is" not in text


@pytest.mark.thorough
def test_the_file_in_the_table_of_errors_is_that_with_its_own_dimensions_on_further_measurements_too():
    seen, further = (Measurements.from_frame(probed(60, radius=R + 0.8, seed=seed)) for seed in (0, 5))
    built = printer([])
    found = diagnose(built, seen, test=further)
    assert found.geometry is not None
    assert found.rms.before_test == pytest.approx(fit(built, further).rms)  # nothing of it is estimated
    assert found.rms.after_test < 0.2 * found.rms.before_test  # as on the readings that were seen
    assert found.rms.after < 0.2 * found.rms.before


@pytest.mark.thorough
@pytest.mark.parametrize("family", PLATFORMS)
def test_a_leg_that_is_off_is_no_number_of_all(family):
    leg = LEGS[family][0]
    for off in ({}, {f"{leg}.leg_zero_offset.a": 0.2}):
        built, columns = platform(family, off, ["target"])
        found = diagnose(built, Measurements.from_frame(columns))
        assert found.geometry is None
        assert names(found) == {f"leg_zero_offset at {leg}" for _ in off}


def test_numbers_that_the_file_estimates_are_part_of_the_whole_geometry():
    """A file that names both is refused."""
    built, _ = platform("tricept", {}, ["R", "target"])
    whole = with_geometry(built)
    assert machine_of(machine_text(whole), "machine.toml").estimate == ("geometry", "target")


def hexapod(
    base: Any = 0.0, platform: Any = 0.0, legs: float = 0.0, seed: int = 5, poses: int = 60, **file: Any
) -> tuple[Machine, dict]:
    """Return a hexapod with displaced joints and longer legs than commanded, and what is seen with 10 µm."""
    random = np.random.default_rng(seed)
    position, turn = drawn_poses(poses, random)
    commands = lengths(position, turn, BASE + base, PLATFORM + platform) - legs
    rows = table(commands, position, turn, random, noise=0.01)
    return machine_of(toml(hexapod_file(**{"estimate": ["target"]} | file, noise=0.01)), "machine.toml"), rows


def outwards(joints: np.ndarray, by: float) -> np.ndarray:
    return by * joints * [1, 1, 0] / np.hypot(*joints[:, :2].T)[:, None]


def tolerance(seed: int) -> np.ndarray:
    """Displace all joints of a plate, by 0.1 mm in each direction."""
    return 0.1 * np.random.default_rng(seed).normal(size=(6, 3))


def bed(estimate: list[str], seed: int = 0, **errors: Any) -> tuple[Machine, dict]:
    """Return a printer, and touches on its bed in any order: else a bowl would look like a drift along a spiral."""
    log = probed(seed=seed, **errors)
    order = np.random.default_rng(seed).permutation(44)
    return printer(estimate), {name: column[order] for name, column in log.items()}


def bowl(x: float, y: float) -> float:
    return 2e-5 * (x * x + y * y)


def saddle(x: float, y: float) -> float:
    return 1.5e-5 * (x * x - y * y) + 1e-5 * 2 * x * y


ALIKE = {
    "zeros of arms": (
        lambda: delta_robot(0, 0, 0, 0.31),
        {"common_zero_offset.a": 0.31},
        "zeros of all arms .* 0.3",
    ),
    "endstops": (
        lambda: bed([], offset=0.3),
        {"common_zero_offset.a": 0.3},
        "another L and target_offset at nozzle",
    ),
    "base of a hexapod": (
        lambda: hexapod(outwards(BASE, 0.31)),
        {"base_radius.r": 0.31},
        r"base is 500\.3\d+ ± 0\.00\d+ mm, not 500",
    ),
    "both plates": (
        lambda: hexapod(outwards(BASE, 0.3), outwards(PLATFORM, 0.25)),
        {"base_radius.r": 0.3, "platform_radius.r": 0.25},
        "platform is 250.2",
    ),
    "legs, a free frame": (
        lambda: hexapod(legs=0.3, frame="free"),
        {"common_zero_offset.a": 0.3},
        "all legs are off",
    ),
    "shim": (
        lambda: hexapod(platform=[0, 0, -0.5], estimate=[]),
        {"platform_shift.z": -0.5},
        "a shim below the platform",
    ),
    "bowl": (lambda: bed([], plate=bowl), {"plate_bowl.a": 2e-5}, "At 100 mm from the middle: a 0.2"),
    "warp": (
        lambda: bed(["R"], radius=R + 0.8, plate=saddle),
        {"plate_warp.b": 1.5e-5, "plate_warp.c": 1e-5},
        "b 0.14 mm and c 0.10 mm",
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("made", "off", "words"), ALIKE.values(), ids=ALIKE.keys())
def test_what_legs_share_and_the_form_of_a_plate_are_one_cause(made, off, words):
    """Not several legs, the instrument or a drift, which do nearly the same together."""
    built, columns = made()
    found = diagnose(built, Measurements.from_frame(columns))
    assert names(found) == {key.partition(".")[0] for key in off}
    for key, true in off.items():
        one = found.estimates[key]
        assert abs(one.value - true) < 4 * one.std
    assert re.search(words, " ".join(str(found).split()))
    assert found.rms.after < 1.3 * found.rms.noise  # four deviations of 44 readings


@pytest.mark.thorough
@pytest.mark.parametrize("errors", [{"plate": bowl}, {"radius": R + 0.8}], ids=["bowl", "radius"])
def test_a_bowl_of_a_plate_of_unknown_height_is_not_told_from_the_radius(errors):
    built, columns = bed([], **errors)
    free = replace(built, measured=replace(built.measured, frame="free"))
    found = diagnose(free, Measurements.from_frame(columns))
    if found.geometry is None:
        (step,) = found.steps
        both = {step.effect.title, *(alias.effect.title for alias in step.indistinguishable_from)}
    else:
        assert not found.steps
        both = {e.title for one in found.geometry.alternatives for e in (*one.named, *one.effects)}
    assert both >= {"plate_bowl", "another R"}


@pytest.mark.thorough
def test_an_endstop_is_no_wander_of_the_plate():
    """16 touches from row to row: that a plate lies askew all the time is no sign that it wanders."""
    log = probed(16, offset=[0.3, 0, 0], noise=0.02)
    order = np.argsort([y for _, y in spiral(16, 95)])
    found = diagnose(printer(["R"]), Measurements.from_frame({x: log[x][order] for x in log}))
    assert names(found) == {"zero_offset at A"}
    assert abs(found.estimates["A.zero_offset.a"].value - 0.3) < 4 * found.estimates["A.zero_offset.a"].std


@pytest.mark.thorough
def test_two_endstops_are_named_beside_the_third_and_all():
    """An endstop and a bowl: with an estimated radius all endstops do what the bowl does, so that two do both."""
    built, columns = bed(["R"], seed=5, offset=[0, 0.3, 0], plate=bowl, noise=0.015)
    found = diagnose(built, Measurements.from_frame(columns))
    sets = [names(found), *({e.title for e in one.effects} for one in found.indistinguishable_sets)]
    assert {"common_zero_offset", "zero_offset at B"} in sets


@pytest.mark.thorough
def test_numbers_that_do_nearly_the_same_are_named_beside_each_other():
    built, columns = bed([], offset=0.3)
    (one,) = diagnose(built, Measurements.from_frame(columns)).steps
    odds = {alias.effect.title: alias.odds for alias in one.indistinguishable_from}
    assert odds["another L"] > odds["target_offset at nozzle"] > 0.01


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [12, 14])
def test_a_hexapod_all_of_whose_joints_are_off_has_one_error(seed):
    """As few single joints as explain that are about as probable; but parts are made with tolerances."""
    built, columns = hexapod(tolerance(seed), tolerance(seed + 100), seed=seed)
    found = diagnose(built, Measurements.from_frame(columns))
    assert found.geometry is not None
    assert not found.steps


@pytest.mark.thorough
def test_a_radius_that_no_model_can_reach_is_no_machine_without_errors():
    """A tenth: the pose on the machine of the file is no start for that on this one."""
    built, columns = hexapod(platform=outwards(PLATFORM, 25), poses=15)
    found = diagnose(built, Measurements.from_frame(columns))
    assert found.verdict == "cannot_tell"
    assert "platform_radius" in found.reason
