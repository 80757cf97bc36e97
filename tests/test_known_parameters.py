"""Priors and bounds of a machine file: read, written, and used in fits as further rows and as limits.

The references solve the same problem with SciPy, from the simulator's readings.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated_fits import fit_to, joint, machine_file, measure

from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.solve.least_squares import minimise
from rodgen.cli import main as cli
from rodgen.data.measurements import Measurements
from rodgen.machines.files.edit import edited_text
from rodgen.machines.machine import Machine

EXAMPLE = Path(__file__).parent.parent / "examples" / "machines" / "rotary_table"
ARCSEC = np.pi / 648000
KNOWN = """
[known]
C.axis = { prior = "0 ± 20 arcsec" }
"C.point.a" = { prior = "0.01 +- 0.002", bounds = [-0.1, "30 um"] }
"C.backlash.b" = { bounds = ["0 arcsec", inf] }
"""
SHORT = {"C [rad]": np.tile([0.0, 0.02, 0.05], 4), "target": ["p", "r"] * 6}
"""The table hardly turns: its axis and point are determined badly."""
TABLE = machine_file(
    [joint("C", "revolute", (0, 0, 1))], [(100, 0, 40), (-30, 70, 10)], estimate=["C.point", "target"], noise=0.01
)  # fmt: skip
TRUTH = {"C.point.a": 0.4, "C.point.b": -0.3, "target.p.x": 0.05}


def written(tmp_path: Path, known: str) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text((EXAMPLE / "machine.toml").read_text() + known)
    return path


def of_table(**known: Any) -> Fit:
    """Fit the table that hardly turns, with what is known of its parameters."""
    made = fit_to(TABLE, measure(TABLE, SHORT, TRUTH, noise=0.01, random=np.random.default_rng(2)))
    machine = replace(made.machine, values={})
    for key, value in known.items():
        machine = machine.knowing(key.replace("_", "."), **value)
    return fit(machine, made.observations)


def reference(found: Fit, rows: Any = None, **options: Any) -> np.ndarray:
    """Solve the same least-squares problem, with further rows, by SciPy."""
    problem, frame = found.problem, found.solution.frame

    def residuals(theta: np.ndarray) -> np.ndarray:
        own = problem.residuals(theta, frame, weighted=True).ravel()
        return own if rows is None else np.concatenate([own, rows(theta)])

    start = np.zeros(len(found.parameters))
    if "bounds" in options:
        start = np.clip(start, *options["bounds"])
    done = least_squares(residuals, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, **options)
    return np.asarray(done.x)


def test_known_parameters_are_read_and_written_back(tmp_path: Path) -> None:
    path = written(tmp_path, KNOWN)
    machine = Machine.load(path)
    assert machine.known["C.axis"].prior == (0.0, 20 * ARCSEC)
    assert machine.known["C.point.a"].prior == (0.01, 0.002)
    assert machine.known["C.point.a"].bounds == (-0.1, pytest.approx(0.03))
    assert machine.known["C.backlash.b"].bounds == (0.0, np.inf)
    machine.save(tmp_path / "again.toml")
    assert Machine.load(tmp_path / "again.toml") == machine
    text = edited_text(path, machine.with_effect(machine.effect("backlash", "C")))
    assert KNOWN in text
    by_python = Machine.load(EXAMPLE / "machine.toml").knowing("C.axis", prior="0 ± 20 arcsec")
    assert by_python.known == {"C.axis": machine.known["C.axis"]}


@pytest.mark.parametrize(
    'entry',
    [
        '"C.axi" = { prior = "0 ± 2" }',
        'C.axis = { prior = "0 ± 2 mm" }',
        'C.axis = { prior = "0 2" }',
        'C.axis = { prior = "0 ± 0 deg" }',
        "C.axis.a = 3",
        "C = 3",
        "C.axis = {}",
        "C.axis = { bounds = [3, 2] }",
        "C.axis = { bounds = [-inf, inf] }",
        'C.axis = { prior = "4 ± 1", bounds = [0, 2] }',
        "C.axis = { least = 3 }",
        "C.backlash_gradient.b = { bounds = [0, 2] }",
    ],
)  # fmt: skip
def test_errors_name_the_file_and_the_key(refuses, entry: str, tmp_path: Path) -> None:
    refuses(Machine.load, written(tmp_path, f"\n[known]\n{entry}\n"))


def test_a_prior_is_a_further_row_of_the_least_squares() -> None:
    free, known = of_table(), of_table(C_point={"prior": "0 ± 0.02 mm"})
    file = known.problem.file_values
    expected = reference(known, lambda theta: (theta * file.precision)[:2])
    std = np.sqrt(np.diag(known.covariance))
    assert np.all(np.abs(known.values - expected) < 2e-3 * std)
    # the information adds up
    information = np.linalg.inv(free.covariance) + np.diag([2500.0, 2500.0, *[0.0] * 6])
    assert np.allclose(known.covariance, np.linalg.inv(information), rtol=1e-5, atol=1e-12)
    assert free.estimates["C.point.a"].std > 5 * 0.02 > known.estimates["C.point.a"].std  # type: ignore[operator]
    own = known.problem.residuals(known.solution.theta, known.solution.frame, weighted=True)
    assert known.chi_square == pytest.approx(np.sum(own**2))
    assert known.prior_chi_square == pytest.approx(np.sum((known.values[:2] / 0.02) ** 2))
    assert known.chi_square > free.chi_square
    # a prior that says nearly all of two parameters leaves their readings for the noise
    assert known.degrees_of_freedom == free.degrees_of_freedom + 2


def test_a_prior_ends_a_choice_of_coordinates() -> None:
    file = TABLE | {"effect": [{"name": "zero_offset", "joint": "C"}]}
    columns = SHORT | {"C [rad]": np.linspace(-3, 3, 12)}
    free = fit_to(file, measure(file, columns, TRUTH, noise=0.01, random=np.random.default_rng(2)))
    assert free.estimates["C.zero_offset.a"].convention
    machine = replace(free.machine, values={}).knowing("C.zero_offset.a", prior="30 ± 1 arcsec")
    known = fit(machine, free.observations)
    estimate = known.estimates["C.zero_offset.a"]
    assert not known.determinacy.undetermined.any()
    assert (estimate.value, estimate.std) == (pytest.approx(30.0, abs=1e-3), pytest.approx(1.0, rel=1e-3))
    assert known.chi_square == pytest.approx(free.chi_square, rel=1e-6)


def test_a_fit_keeps_combinations_of_parameters_and_is_the_least_squares_otherwise() -> None:
    free = of_table()
    start, kept = free.solution.theta + 0.3, np.zeros((1, len(free.free)))
    kept[0, :3] = [1.0, -0.5, 0.2]
    found = minimise(free.problem, start, free.solution.frame, free.free, kept=kept)
    expected = reference(free, lambda theta: 1e6 * kept @ (theta - start))
    assert found.converged
    assert kept @ found.theta == pytest.approx(kept @ start, abs=1e-9)
    np.testing.assert_allclose(found.theta, expected, rtol=0, atol=1e-5)
    assert np.abs(found.theta - free.solution.theta).max() > 0.1  # elsewhere without it


def test_bounds_hold_and_the_rest_is_the_least_squares_within_them() -> None:
    free, known = (
        of_table(),
        of_table(C_point_a={"bounds": [0.0, "1e-2 mm"]}, C_point_b={"bounds": [-50, 50]}),
    )
    low, high = np.full(8, -np.inf), np.full(8, np.inf)
    low[:2], high[:2] = [0.0, -50.0], [0.01, 50.0]
    assert not low[0] < free.values[0] < high[0]
    expected = reference(known, bounds=(low, high))
    std = np.sqrt(np.diag(free.covariance))
    assert np.all(np.abs(known.values - expected)[1:] < 2e-3 * std[1:])
    estimate = known.estimates["C.point.a"]
    assert estimate.value in (0.0, 0.01)
    assert (estimate.std, estimate.determined) == (None, True)
    assert estimate.at_bound == ("lowest" if estimate.value == 0 else "highest")
    said = f"C.point.a is held at its bound, {estimate.value:g} mm; without it the error falls"
    assert known.summary().splitlines()[1].startswith(said)
    assert f"with C.point.a = {free.values[0]:.4g} mm, and the readings" in known.summary()
    assert known.estimates["C.point.b"].at_bound is None
    assert known.estimates["C.point.b"].std == pytest.approx(np.sqrt(np.linalg.inv(np.linalg.inv(
        free.covariance)[1:, 1:])[0, 0]), rel=1e-3)  # fmt: skip
    assert known.solution.converged


def test_bounds_that_do_not_matter_change_nothing() -> None:
    free, known = of_table(), of_table(target={"bounds": [-100, 100]})
    assert np.allclose(known.values, free.values, rtol=0, atol=1e-4 * np.sqrt(np.diag(free.covariance)).min())
    assert np.allclose(known.covariance, free.covariance, rtol=1e-6)


@pytest.mark.thorough
def test_commands_pass_on_what_is_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, '\n[known]\nC.backlash.b = { bounds = ["5 arcsec", "9 arcsec"] }\n')
    data, better = str(EXAMPLE / "data.csv"), str(tmp_path / "better.toml")
    assert cli.main(["add", str(path), "backlash", data, "--joint", "C", "-o", better, "--json"]) == 0
    rung = json.loads(capsys.readouterr().out)["ladder"]["rungs"][1]
    assert rung["parameters"]["C.backlash.b"]["at_bound"] == "lowest"
    assert rung["parameters"]["C.backlash.b"]["value"] == pytest.approx(5.0)
    assert cli.main(["fit", better, data, "-o", str(tmp_path / "fitted.toml")]) == 0
    assert "C.backlash.b is held at its bound, 5 arcsec; without it the error " in capsys.readouterr().out
    fixed = Machine.load(tmp_path / "fitted.toml")
    assert fixed.effects[0].hold["b"] == pytest.approx(5 * ARCSEC)
    right = Machine.load(better).knowing("C.backlash.b", bounds=("-9 arcsec", "9 arcsec"))
    found = fit(right, Measurements.load(data))
    assert found.diagnose().final.machine.known == found.machine.known


def test_readings_that_contradict_a_prior_are_told() -> None:
    """A fit said "the model misses something" where a prior was in the wrong unit."""
    right, wrong = (of_table(C_point_a={"prior": f"{mean} ± 0.01 mm"}).summary() for mean in (0.4, 4.0))
    assert "contradict" not in right
    assert "The readings contradict the priors of the machine file (p " in wrong
    assert " standard deviations in C.point.a, the most." in wrong


def test_a_deviation_whose_square_vanishes_is_refused(refuses, tmp_path: Path) -> None:
    path = written(tmp_path, '[known]\nC.axis = { prior = "0 ± 1e-200 arcsec" }\n')
    refuses(Machine.load, path)
