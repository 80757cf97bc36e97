"""One axis read as an angle or as a distance: what an expert would sign of a drive, a screw, a resolver, a ring.

The files are those of `rodgen new`; the data are made by `drive_simulator`, without the model.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drive_simulator import (
    ARCSEC,
    ISO,
    Array,
    bidirectional,
    encoder,
    moves,
    pitch,
    resolver,
    servo,
    to_and_fro,
    with_play,
)

from rodgen.calibration.check import check
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.fit import fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine
from rodgen.machines.templates import machine_template

Columns = dict[str, Any]
FULL_TURN = 7.2 * np.arange(50)
SLIDE = np.sort(np.random.default_rng(20).uniform(0, 1000, 100))
RESOLVER = {"offset": 3e-3 + 1e-3j, "unequal": 2e-3, "skew": 1e-3, "third": 6e-4, "seventh": 3e-4}


def new(kind: str, *, noise: str = "") -> Machine:
    text = machine_template(kind)
    return machine_of(
        re.sub(r"# noise = [^#]*", f"noise = {noise}  ", text) if noise else text, f"{kind}.toml"
    )


def noise(size: float, n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(0, size, n)


def turned(q: Array, angle: Array, size: float = 2e-3, **more: Any) -> Columns:
    """A table of angles, degrees, with noise."""
    return {"C [deg]": q, **more, "angle [deg]": (angle + noise(size, len(q))) % 360}


def slid(q: Array, way: Array, size: float = 3e-4, **more: Any) -> Columns:
    """A table of distances from an interferometer 500 mm before zero, mm, with noise."""
    return {"X [mm]": q, **more, "d [mm]": 500 + way + noise(size, len(q))}


def diagnosed(kind: str, columns: Columns, **stated: str) -> Diagnosis:
    return diagnose(fit(new(kind, **stated), Measurements.from_frame(columns)))


def named(diagnosis: Diagnosis) -> set[str]:
    assert not diagnosis.unexplained
    return {step.effect.name for step in diagnosis.steps}


def estimate(diagnosis: Diagnosis, key: str) -> float:
    return float(diagnosis.estimates[key].value)


def said(diagnosis: Diagnosis) -> str:
    return " ".join(diagnosis.summary().split())


# what is wrong with a file


def repaired(kind: str, columns: Columns) -> list[str]:
    found = check(new(kind), Measurements.from_frame(columns))
    return [repair.words for repair in found.repairs]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("q", "angle", "words"),
    [
        (FULL_TURN, 80 - encoder(FULL_TURN, off_centre=5e-4), "C turns the other way: axis = \\[0, 0, -1\\]"),
        (FULL_TURN, 79 / 80 * FULL_TURN, 'C turns by 0.9875 of what its reading says: .* "0.9875\\*C"'),
        (10 * FULL_TURN, FULL_TURN / 10, 'C turns by 0.01 of what its reading says: .* "0.01\\*C"'),
        (10 * FULL_TURN, -FULL_TURN / 2, 'C turns the other way and by 0.05 of .* "-0.05\\*C"'),
    ],
    ids=["reversed", "a tooth", "1:100", "reversed 1:20"],
)
def test_an_axis_that_turns_the_other_way_or_by_another_ratio_is_named(
    q: Array, angle: Array, words: str
) -> None:
    (found,) = repaired("rotary-axis", turned(q, angle))
    assert re.match(words, found)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("way", "words"),
    [
        (1000 - SLIDE, ["X moves the other way: axis = [-1, 0, 0]"]),
        (
            5.08 / 5 * SLIDE,
            ['X moves by 1.016 of what its reading says: reading = "X", coordinate = "1.016*X"'],
        ),
        (
            (500 + SLIDE) / 25.4 - 500,
            [
                "d is in inch, not in mm",
                'X moves by 5/127 of what its reading says: reading = "X", coordinate = "5/127*X"',
            ],
        ),
        (SLIDE - 500, []),
    ],
    ids=["reversed", "another lead", "inch", "distances from where it began"],
)
def test_a_slide_that_moves_the_other_way_or_by_another_lead_is_named(way: Array, words: list[str]) -> None:
    assert repaired("linear-axis", slid(SLIDE, way)) == words


@pytest.mark.parametrize(("kind", "off"), [("rotary-axis", 7.0), ("linear-axis", 0.05)])
def test_one_wrong_reading_is_named_as_one(kind: str, off: float, tmp_path: Path, capsys: Any) -> None:
    columns = turned(FULL_TURN, FULL_TURN) if kind == "rotary-axis" else slid(SLIDE, (1 + 2e-5) * SLIDE)
    reading = columns[list(columns)[-1]]
    reading[20] += off
    (tmp_path / "machine.toml").write_text(machine_template(kind))
    table = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "data.csv", table, "%.7f", ",", header=",".join(columns), comments="")
    assert main(["check", str(tmp_path / "machine.toml"), str(tmp_path / "data.csv")]) == 0
    assert "Line 22 of data.csv is off by" in capsys.readouterr().err


def test_rows_behind_a_reversal_are_not_wrong() -> None:
    q = to_and_fro(0, 1000, 41)
    columns = slid(q, (1 + 3e-5) * with_play(q, 0.012))
    assert not fit(new("linear-axis"), Measurements.from_frame(columns)).gross_readings


@pytest.mark.thorough
def test_a_row_that_is_read_again_behind_a_reversal_may_have_come_from_the_other_side() -> None:
    """Beyond its end the axis turns back: with play of 12 um both rows of that command differ by as much."""
    way = np.linspace(0, 1000, 26)
    q, driven = np.append(way, way[:-4:-1]), np.concatenate([way, [1010], way[:-4:-1]])
    columns = slid(q, np.delete(with_play(driven, 0.012), 26))
    found = diagnosed("linear-axis", columns)
    assert found.outliers == (26,)
    assert "repeats the row before, where X turned back: play shifts it" in said(found)
    told = diagnosed("linear-axis", columns | {"dir_X": np.append(np.ones(26), [-1, -1, -1])})
    assert not told.outliers
    assert named(told) == named(found) == {"backlash"}
    assert estimate(told, "X.backlash.b") == pytest.approx(
        0.012, abs=5 * 3e-4 / np.sqrt(3)
    )  # of three readings


# resolvers and lags


def in_motion(seed: int, **signals: Any) -> Columns:
    random = np.random.default_rng(seed)
    v, q = random.choice([-60.0, -30.0, -10.0, 10.0, 30.0, 60.0], 240), random.uniform(0, 360, 240)
    return turned(q, resolver(q - 0.004 * v, **signals), **{"v_C [deg/s]": v})


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("signals", "waves"),
    [
        (RESOLVER, {"encoder_eccentricity", "encoder_ellipticity", "encoder_harmonics"}),
        ({"offset": 3e-3, "unequal": 2e-3}, {"encoder_eccentricity", "encoder_ellipticity"}),
        ({"third": 6e-4, "seventh": 3e-4}, {"encoder_harmonics"}),
        ({"seventh": 1e-3}, {"encoder_harmonics"}),
    ],
    ids=["1 2 4 8", "1 2", "4 8", "8"],
)
def test_the_waves_of_a_resolver_are_found_together_beside_a_lag(signals: Any, waves: set[str]) -> None:
    found = diagnosed("rotary-axis", in_motion(3, **signals))
    assert named(found) == {"servo_lag", *waves}
    assert estimate(found, "C.servo_lag.tau") == pytest.approx(0.004, abs=3e-5)


@pytest.mark.thorough
def test_a_large_lag_hides_no_small_waves() -> None:
    random = np.random.default_rng(9)
    v, q = random.choice([-200.0, -100.0, 100.0, 200.0], 90), random.uniform(0, 360, 90)
    waves = 60 * np.cos(2 * np.radians(q)) + 15 * np.sin(4 * np.radians(q))
    found = diagnosed(
        "rotary-axis", turned(q, q - 0.0015 * v + waves * ARCSEC, 3 * ARCSEC, **{"v_C [deg/s]": v})
    )
    assert named(found) == {"servo_lag", "encoder_ellipticity", "encoder_harmonics"}
    assert found.final.rms < 3 * 1.2  # arcsec; without the four waves a turn 11


@pytest.mark.thorough
def test_a_large_lag_hides_no_scale() -> None:
    random = np.random.default_rng(15)
    v, q = random.choice([-200.0, -100.0, -50.0, 50.0, 100.0, 200.0], 150), random.uniform(20, 780, 150)
    found = diagnosed("linear-axis", slid(q, (1 + 2.5e-5) * q - 1.2e-3 * v, 2e-3, **{"v_X [mm/s]": v}))
    assert named(found) == {"servo_lag", "scale"}
    scale = found.estimates["X.scale.k"]
    assert abs(scale.value - 2.5e-5) < 4 * scale.std


def driven(natural: float, forward: float, scale: float = 1.0) -> dict[str, Array]:
    """Positions, speeds and accelerations of a servo axis on its way from place to place, at 160 times."""
    t, q = moves(np.random.default_rng(5), 90 * scale)
    at, v, a = servo(q, t, natural=natural, forward=forward)
    some = np.sort(np.random.default_rng(6).choice(len(t), 160, replace=False))
    return {"t": t[some], "q": q[some], "v": v[some], "a": a[some], "at": at[some]}


@pytest.mark.thorough
@pytest.mark.quick(  # a slide has the axis' lags by the same formulas: one of both is enough
    *(f"rotary-axis-{case}" for case in ("1.0-400.0-effects0", "0.95-200.0-effects1", "0.0-1000.0-effects2")),
    "linear-axis-0.95-200.0-effects1",
)
@pytest.mark.parametrize(
    ("forward", "natural", "effects"),
    [
        (1.0, 400.0, {"acceleration_lag"}),
        (0.95, 200.0, {"servo_lag", "acceleration_lag"}),
        (0.0, 1000.0, {"servo_lag"}),
    ],
)
@pytest.mark.parametrize("kind", ["rotary-axis", "linear-axis"])
def test_lags_from_speed_and_from_acceleration_are_told_apart(
    kind: str, forward: float, natural: float, effects: set[str]
) -> None:
    m = driven(natural, forward)
    if kind == "rotary-axis":
        more = {"v_C [deg/s]": m["v"], "a_C [deg/s^2]": m["a"], "t [s]": m["t"]}
        found = diagnosed(kind, turned(m["q"], m["at"], 2e-4, **more))
    else:
        more = {"v_X [mm/s]": m["v"], "a_X [mm/s^2]": m["a"], "t [s]": m["t"]}
        found = diagnosed(kind, slid(m["q"], m["at"], 2e-4, **more))
    assert named(found) == effects
    joint = "C" if kind == "rotary-axis" else "X"
    # of e'' + 2 w e' + w² e = a + 2 w (1 - forward) v, where v and a change slowly
    tau, k = 2 * (1 - forward) / natural, (1 - 4 * (1 - forward)) / natural**2
    if "acceleration_lag" in effects:
        assert estimate(found, f"{joint}.acceleration_lag.k") == pytest.approx(k, rel=0.05)
    if "servo_lag" in effects:
        assert estimate(found, f"{joint}.servo_lag.tau") == pytest.approx(tau, rel=0.02)


# screws and play


@pytest.mark.thorough
@pytest.mark.parametrize("stated", [{}, {"noise": "0.0003"}])
def test_the_pitch_error_of_a_screw_is_found_beside_its_scale(stated: dict[str, str]) -> None:
    found = diagnosed("linear-axis", slid(SLIDE, (1 + 2e-5) * SLIDE + pitch(SLIDE, 4e-3, 10)), **stated)
    assert named(found) == {"scale", "periodic_drive_error"}
    assert estimate(found, "X.periodic_drive_error.P") == pytest.approx(10, abs=0.01)


@pytest.mark.thorough
def test_a_grid_does_not_tell_a_lead_from_its_alias() -> None:
    q = np.arange(0, 1000.1, 7.0)
    found = diagnosed("linear-axis", slid(q, q + pitch(q, 4e-3, 10)))
    assert named(found) == {"periodic_drive_error"}
    assert (
        "At positions 7 mm apart a wave of 23.3 mm is the same as one of 10 mm: state the period of X"
        in said(found)
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("lead", "apart", "repeats"), [(600, 0, False), (600, 2e-3, False), (400, 2e-3, True)]
)
def test_a_wave_that_the_travel_hardly_repeats_is_said_to_be_one(
    lead: float, apart: float, repeats: bool
) -> None:
    there = np.linspace(0, 1000, 60)
    q = np.concatenate([there, there[::-1]]) + noise(apart, 120)  # as an encoder reads a grid
    found = diagnosed("linear-axis", slid(q, q + pitch(q, 4e-3, lead)))
    assert named(found) == {"periodic_drive_error"}
    assert ("The travel of X holds 1.7 waves of periodic_drive_error at X" in said(found)) is not repeats


@pytest.mark.thorough
def test_a_screw_that_warms_up_grows() -> None:
    q, run = np.tile(np.linspace(0, 1000, 21), 6), np.repeat(np.arange(6), 21)
    warm = np.array([0, 1.5, 3, 5, 6.5, 7.5])[run] + noise(0.05, 126, 2)
    more = {"T_X [degC]": 20 + warm, "t [min]": np.arange(126.0)}
    found = diagnosed("linear-axis", slid(q, q * (1 + 1.15e-5 * warm), **more), noise="0.0003")
    assert named(found) == {"thermal_expansion"}
    assert estimate(found, "X.thermal_expansion.alpha") == pytest.approx(1.15e-5, rel=0.01)


@pytest.mark.thorough
def test_play_and_scale_of_a_slide_are_found_there_and_back() -> None:
    q = to_and_fro(0, 1000, 41)
    found = diagnosed("linear-axis", slid(q, (1 + 3e-5) * with_play(q, 0.012)))
    assert named(found) == {"backlash", "scale"}
    assert estimate(found, "X.backlash.b") == pytest.approx(0.012, abs=3e-4)


@pytest.mark.thorough
def test_a_quarter_of_a_turn_does_not_tell_a_scale_from_an_eccentricity() -> None:
    q = to_and_fro(0, 90, 19)
    found = diagnosed("rotary-axis", turned(q, (1 + 3e-4) * with_play(q, 0.02), 1e-3))
    backlash, other = found.steps
    assert backlash.effect.name == "backlash"
    equal = {alias.effects[0].name for alias in other.indistinguishable_from if alias.odds > 0.1}
    assert {other.effect.name, *equal} == {"scale", "encoder_eccentricity"}


# ISO 230-2: five positions, five runs in both directions


@pytest.mark.thorough
def test_five_positions_that_lie_on_a_line_are_scale_and_play() -> None:
    q, s, run = bidirectional(ISO)
    more = {"run": run, "dir_X": s}
    found = diagnosed("linear-axis", slid(q, 3e-5 * q + q - 0.003 * s, 6e-4, **more))
    assert named(found) == {"backlash", "scale"}


@pytest.mark.thorough("pitch-0.0", "wander-0.0", "wander-0.004")
@pytest.mark.parametrize("play", [0.0, 0.004])
@pytest.mark.parametrize(
    "error",
    [lambda q: pitch(q, 6e-3, 10), lambda q: np.interp(q, ISO, [3e-3, -6e-3, 8e-3, -2e-3, 5e-3])],
    ids=["pitch", "wander"],
)
def test_five_positions_do_not_tell_what_an_error_follows(
    error: Callable[[Array], Array], play: float
) -> None:
    q, s, run = bidirectional(ISO)
    found = diagnosed("linear-axis", slid(q, q + error(q) - play / 2 * s, 6e-4, run=run, dir_X=s))
    assert named(found) == ({"backlash"} if play else set())
    assert found.verdict == ("effects_missing" if play else "cannot_tell")
    assert "5 positions of X do not tell what it follows: measure at more positions" in said(found)


@pytest.mark.thorough
def test_five_positions_do_not_tell_waves_of_a_turn_apart() -> None:
    q, s, run = bidirectional(np.arange(5) * 72.0 + 3)
    angle = resolver(q, offset=4e-5, unequal=6e-5) - 0.0015 * s
    found = diagnosed("rotary-axis", turned(q, angle, 2e-4, run=run, dir_C=s))
    assert named(found) == {"backlash"}
    assert "5 positions of C do not tell what it follows: measure at more positions" in said(found)


@pytest.mark.thorough
def test_eight_positions_tell_an_eccentric_encoder_from_play() -> None:
    q, s, run = bidirectional(np.arange(8) * 45.0 + 3)
    found = diagnosed(
        "rotary-axis", turned(q, encoder(q, off_centre=5e-5) - 0.0015 * s, 2e-4, run=run, dir_C=s)
    )
    assert named(found) == {"backlash", "encoder_eccentricity"}


# what to measure next


def planned(diagnosis: Diagnosis, n: int = 12) -> tuple[dict[str, list[Any]], str]:
    plan = diagnosis.plan(n)
    return dict(plan.rows), " ".join(plan.summary().split())


@pytest.mark.thorough
@pytest.mark.parametrize("off_centre", [0.0, 2e-4])
def test_an_axis_that_came_from_one_side_is_to_be_reversed(off_centre: float) -> None:
    found = diagnosed("rotary-axis", turned(FULL_TURN, encoder(FULL_TURN, off_centre=off_centre), 2e-4))
    rows, text = planned(found)
    q = rows["C [deg]"]
    assert q == sorted(q, reverse=True)
    assert q[0] - q[-1] > 300  # over the whole turn
    assert "Come from the other side, too: play of C shows only then." in text


def test_errors_of_five_positions_ask_for_others_from_both_sides() -> None:
    q, s, run = bidirectional(ISO)
    found = diagnosed("linear-axis", slid(q, q + pitch(q, 6e-3, 10), 6e-4, run=run, dir_X=s))
    rows, text = planned(found)
    way = np.array(rows["X [mm]"])
    assert rows["dir_X"] == [1] * 6 + [-1] * 6
    assert sorted(way[:6]) == sorted(way[6:])
    assert np.abs(way[:, None] - ISO).min() > 50
    assert len(set(np.round(way[:6] % 10))) > 2  # a lead of 10 mm shows
    assert "Read at positions that were not read yet, from both sides" in text
