"""Every command states the same standard deviation, and the same p, of the same thing: from what they print as JSON.

Three data sets of a table with three balls, by plain trigonometry, which lacks two effects: one whose set-up wanders,
one with replicates and a stated noise, and one that is plain.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.ladder import ladder
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

BALLS = {"b1": (100.0, 0.0, 20.0), "b2": (-60.0, 90.0, 40.0), "b3": (-30.0, -80.0, 60.0)}
NOISE = 0.002


def machine(noise: float | None) -> str:
    balls = "".join(f'[[target]]\nname = "{name}"\npoint = {list(at)}\n' for name, at in BALLS.items())
    stated = "" if noise is None else f"noise = {noise}\n"
    return (
        'name = "Table"\n'
        '[units]\nlength = "mm"\nangle = "deg"\n'
        '[[joint]]\nname = "C"\ntype = "revolute"\naxis = [0, 0, 1]\npoint = [0, 0, 0]\n'
        f'{balls}[measured]\nkind = "point"\nframe = "machine"\n{stated}'
        '[estimate]\nparameters = ["target", "C.point"]\n'
    )


def measure(path: Path, angles: np.ndarray, *, wander: float = 0.0, seed: int = 1) -> None:
    """Readings of a table with an elliptic encoder and an axial wave, whose set-up may wander."""
    random = np.random.default_rng(seed)
    at, shift = np.zeros(3), np.exp(-1 / 8)
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["C [deg]", "target", "t [s]", "x [mm]", "y [mm]", "z [mm]"])
        for k, angle in enumerate(angles):
            at = shift * at + np.sqrt(1 - shift**2) * random.normal(size=3)
            q = np.radians(angle)
            turn, lift = q + 1e-4 * np.cos(2 * q), 0.006 * np.sin(2 * q)
            for name, (x, y, z) in BALLS.items():
                seen = [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z + lift]
                read = np.array(seen) + wander * NOISE * at + NOISE * random.normal(size=3)
                out.writerow([f"{angle:.6f}", name, 30.0 * k, *(f"{value:.7f}" for value in read)])


def made(case: str, folder: Path) -> tuple[str, str]:
    random = np.random.default_rng(5)
    few = np.arange(0.0, 360.0, 15.0)
    angles = np.concatenate([random.permutation(few) for _ in range(3)])
    if case != "replicates":
        angles = random.uniform(0, 360, 72)
    (folder / "table.toml").write_text(machine(NOISE if case == "replicates" else None))
    measure(folder / "balls.csv", angles, wander=2.0 if case == "wander" else 0.0)
    return str(folder / "table.toml"), str(folder / "balls.csv")


@pytest.mark.thorough
@pytest.mark.quick("plain")
@pytest.mark.parametrize("case", ["wander", "replicates", "plain"])
def test_the_same_question_has_the_same_answer_in_every_command(case, tmp_path, capsys):
    def printed(*command: str) -> dict:
        assert main([*command, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    file, data = made(case, tmp_path)
    better = str(tmp_path / "better.toml")
    found = printed("diagnose", file, data, "-o", better)
    assert {step["effect"] for step in found["steps"]} == {"encoder_ellipticity", "axial_error_motion"}
    before = Machine.load(file)
    effects = [before.effect(step["effect"], step["joint"]) for step in found["steps"]]
    rungs = ladder(before, Measurements.load(data), effects).to_dict()["rungs"]
    fit = printed("fit", better, data)
    assert fit["dependence"]["independent"] is (case != "wander")
    for other in (rungs[-1], found):
        assert other["dependence"]["text"] == fit["dependence"]["text"]
        assert other["dependence"]["factor"] == pytest.approx(fit["dependence"]["factor"], rel=1e-4)

    # the parameters of an effect
    for step in found["steps"]:
        for name, parameter in step["parameters"].items():
            key = f"C.{step['effect']}.{name}"
            for other in (rungs[-1]["parameters"][key], fit["parameters"][key]):
                assert parameter["value"] == pytest.approx(other["value"], abs=1e-3 * parameter["std"])
                assert parameter["std"] == pytest.approx(other["std"], rel=1e-4)
    # taken away again, an effect is worth as much
    for step, rung in zip(found["steps"], rungs[1:], strict=True):
        gone = printed(
            "remove", better, step["effect"], data, "--joint", "C", "-o", str(tmp_path / "gone.toml")
        )
        odds = gone["ladder"]["rungs"][1]["step"]["log10_odds"], rung["step"]["log10_odds"]
        # beyond a million to one they say the same
        assert min(odds[0], 6.0) == pytest.approx(min(odds[1], 6.0), rel=0.05)
        (tmp_path / "gone.toml").unlink()

    # the errors, and the noise that they are held against
    assert found["rms"]["after"] == pytest.approx(fit["rms"], rel=1e-6)
    compared = printed("compare", better, data)
    assert compared["rms"] == pytest.approx(fit["rms"], rel=1e-9)
    # a comparison claims a wander where the standard deviations allow for one
    assert any("successive poses" in claim for claim in compared["claims"]) is (case == "wander")
    if fit["lack_of_fit"]:
        assert fit["lack_of_fit"]["p_value"] > 0.01

    # a plan begins with the standard deviations of the fit
    keys = [key for key in fit["parameters"] if key.startswith("C.encoder_ellipticity")]
    planned = printed("plan", better, data, *(word for key in keys for word in ("--for", key)))
    gains = {gain["of"]: gain["now"] for goal in planned["goals"] for gain in goal["gain"]}
    assert gains == {key: pytest.approx(fit["parameters"][key]["std"], rel=1e-9) for key in keys}

    # a ball is as high as its own parameter says, wherever the table is
    (tmp_path / "design.csv").write_text(
        "C [deg],target,t [s]\n" + "".join(f"45,{name},0\n" for name in BALLS)
    )
    design, out = str(tmp_path / "design.csv"), str(tmp_path / "out.csv")
    assert main(["predict", file, data, design, "-o", out, "--all-digits"]) == 0
    capsys.readouterr()
    base = printed("fit", file, data)["parameters"]
    for row in csv.DictReader((tmp_path / "out.csv").read_text().splitlines()):
        key = f"target.{row['target']}.z"
        assert float(row["model_u_z [mm]"]) == pytest.approx(base[key]["std"], rel=1e-6)
        assert base[key]["std"] == pytest.approx(rungs[0]["parameters"][key]["std"], rel=1e-4)
