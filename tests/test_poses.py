"""Readings of poses: position and attitude of a body, against the plain simulator."""

from __future__ import annotations

import runpy
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emitted_code import passes_in_c, passes_in_cpp, passes_in_octave, passes_in_python
from hidden_effects import Hidden, board, hidden
from machine_cases import (
    FRAME_TURNS,
    FREE_FRAME,
    JOINTS,
    ROWS,
    TARGETS,
    Case,
    data_for,
    effect,
    joint,
    machine_file,
    possible,
)
from machine_simulator import Simulated
from scipy.spatial.transform import Rotation
from test_machine_jacobians import STENCILS, moved, step

from rodgen.calibration.fit import Fit
from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.errors import InputFileError
from rodgen.machines.emit import emit
from rodgen.machines.emit._content import content_of
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.machine import Machine

pytestmark = pytest.mark.xdist_group("poses")
ATTITUDE = [0.4, -1.1, 2.0]


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")


def posed(*, estimate: Any = ("B.axis", "C.axis", "B.point", "C.point", "target"), **more: Any) -> Case:
    """Return a machine whose poses are read, with every effect at A, at Z and of the whole machine."""
    file = machine_file(
        JOINTS, TARGETS, kind="pose", frame="free", estimate=estimate, gravity=(0.6, 0, -0.8), **more
    )
    file["target"][0]["attitude"] = ATTITUDE
    file["effect"] = possible(file, places=["A", "Z", None, "p", "r"])
    return Case(file, data_for(file, ROWS, np.random.default_rng(4)))


def turns(matrices: np.ndarray) -> np.ndarray:
    """Return rotation vectors."""
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec()


# the model -----------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("estimate", [("C.axis", "B.point", "target"), ("B.axis",)])
def test_poses_are_those_of_the_simulator_and_columns_its_derivatives(estimate):
    case = posed(estimate=estimate)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    assert any(key.endswith(("target.p.rx", "p.target_offset.rx")) for key in keys)
    values = case.sizeable(keys, 30.0) | FREE_FRAME
    expected = case.simulated(values)
    assert np.abs(case.predicted(values) - expected).max() < 1e-9  # 1000 mm, half a degree, 5 mm
    # readings some 10 degrees off, as far as a rough start is
    rng = np.random.default_rng(3)
    off = Rotation.from_rotvec(0.1 * rng.normal(size=(ROWS, 3))).as_matrix()
    read = Rotation.from_matrix(off @ expected[:, 3:].reshape(-1, 3, 3)).as_rotvec()
    case = case.changed(data=case.data | {f"r{x} [rad]": read[:, i] for i, x in enumerate("xyz")})
    arm = case.observations.arm

    def residuals(reading: np.ndarray) -> np.ndarray:
        turned = case.observations.attitude @ reading[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
        vector = turns(turned)
        angle = np.linalg.norm(vector, axis=1, keepdims=True)
        return np.concatenate(
            [case.observations.reading - reading[:, :3], arm * 2 * np.tan(angle / 2) * vector / angle], axis=1
        )

    assert (
        np.abs(case.problem.residuals(case.theta(values), case.frame(values)) - residuals(expected)).max()
        < 1e-9
    )
    jacobian = case.problem.jacobian(case.theta(values), case.frame(values))
    wrong = {}
    chosen = keys if "target" in estimate else [key for key in keys if "target" in key]
    turning = [key for key in case.model.keys if ".r" in key or ".axis." in key]
    for key in {*chosen[::7], *turning[:: 1 if "target" in estimate else 3]}:
        h = step(case, key, values)
        difference = (
            sum(
                factor * sign * residuals(moved(case, values, key, sign * n * h))
                for n, factor in STENCILS[8].items()
                for sign in (1, -1)
            )
            / h
        )
        size = np.abs(difference).max()
        error = np.abs(jacobian[:, :, case.model.keys[key]] - difference).max() / size
        if not error < 1e-9:
            wrong[key] = error
    assert wrong == {}


# readings ------------------------------------------------------------------------------------------------------

ARM = machine_file(
    [
        joint("J1", "revolute", [0, 0, 1]),
        joint("J2", "revolute", [0, 1, 0], [0, 0, 400]),
        joint("J3", "revolute", [0, 1, 0], [0, 0, 850]),
        joint("J4", "revolute", [1, 0, 0], [300, 0, 870]),
        joint("J5", "revolute", [0, 1, 0], [420, 0, 870]),
        joint("J6", "revolute", [1, 0, 0], [500, 0, 870]),
    ],
    [[530, 20, 900]],
    kind="pose",
    frame="free",
    estimate=["target"],
)
SEEN = {"target.p.rx": 1.2, "target.p.ry": -2.0, "target.p.rz": 0.8, "target.p.x": 12.0, **FREE_FRAME}
SIGMA = (0.05, 2e-4)


def measured(
    values: Any = SEEN, rows: int = 40, *, file: Any = ARM, noise: Any = SIGMA, seed: int = 5
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return commands and readings of the simulator."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.3, 1.3, (rows, len(file["joint"])))
    simulated = Simulated(file, values)
    reading = simulated.with_noise(simulated.measure(q), np.repeat(noise, 3), rng)
    columns = {f"{j['name']} [rad]": q[:, i] for i, j in enumerate(file["joint"])}
    return columns | {f"{x} [mm]": reading[:, i] for i, x in enumerate("xyz")}, reading[:, 3:].reshape(
        -1, 3, 3
    )


def written(notation: str, attitude: np.ndarray) -> dict[str, np.ndarray]:
    """Return columns of an attitude, by SciPy."""
    if notation == "matrix":
        return {f"r{i + 1}{j + 1}": attitude[:, i, j] for i in range(3) for j in range(3)}
    rotations = Rotation.from_matrix(attitude)
    if notation == "quaternion":
        signs = np.where(np.arange(len(attitude)) % 3 == 0, -1.0, 1.0)[:, None]
        return dict(zip(("qx", "qy", "qz", "qw"), (signs * rotations.as_quat()).T, strict=True))
    if notation == "rotation vector":
        return {
            f"{x} [deg]": v for x, v in zip(FRAME_TURNS, np.degrees(rotations.as_rotvec()).T, strict=True)
        }
    return {
        f"{x} [rad]": v for x, v in zip(("roll", "pitch", "yaw"), rotations.as_euler("xyz").T, strict=True)
    }


NOTATIONS = ("matrix", "quaternion", "rotation vector", "roll, pitch and yaw")


def test_the_four_notations_say_the_same():
    columns, attitude = measured()
    for notation in NOTATIONS:
        case = Case(ARM, {**columns, **written(notation, attitude)})
        assert np.abs(case.observations.attitude - attitude).max() < 1e-12, notation
        fit = case.machine.fit(Measurements.from_frame(case.data))
        back = fit.residual_columns()
        for name, values in written(
            notation, fit.problem.attitudes(fit.solution.theta, fit.solution.frame)
        ).items():
            assert np.abs(np.abs(back[f"predicted_{name}"]) - np.abs(values)).max() < 1e-9


@pytest.mark.parametrize(
    "change",
    [
        {"qw": [2.0, 0.5], "qx": [0.0, 0.5], "qy": [0.0, 0.5], "qz": [0.0, 0.5]},
        {"qw": [1.0, 0.0], "qx": [0.0, 0.0], "qy": [0.0, 0.0], "qz": [0.0, 0.0]},
        {"qw": [1.0, 1.0], "qx": [0.0, 0.0], "qy": [0.0, 0.0]},
        {},
        {f"{x} [deg]": [0.0, 0.0] for x in ("rx", "ry", "rz", "roll")},
        {x: [0.0, 0.0] for x in ("rx", "ry", "rz")},
        written("matrix", np.array([np.eye(3), np.diag([1.0, 1.0, -1.0])])),
        written("matrix", np.array([np.eye(3), 1.01 * np.eye(3)])),
    ],
)
def test_what_is_no_attitude_is_one_sentence(refuses, change):
    columns = {name: values[:2] for name, values in measured()[0].items()}
    refuses(lambda: Case(ARM, {**columns, **change}).observations)


# fits ----------------------------------------------------------------------------------------------------------


def fitted(values: Any = SEEN, file: Any = ARM, **more: Any) -> Any:
    columns, attitude = measured(values, file=file, **more)
    case = Case(file, {**columns, **written("quaternion", attitude)})
    return case.machine.fit(Measurements.from_frame(case.data))


@pytest.mark.parametrize("seed", [1, 2])
def test_frame_and_attitude_of_the_target_are_found_wherever_they_are(seed):
    rng = np.random.default_rng(seed)
    turns = Rotation.random(2, rng=rng).as_rotvec().ravel()
    wanted = dict(zip(("frame.rx", "frame.ry", "frame.rz", *list(SEEN)[:3]), turns, strict=True))
    fit = fitted({**SEEN, **wanted})
    assert fit.solution.converged
    for key, estimate in fit.estimates.items():
        true = {**SEEN, **wanted}.get(key, 0.0)
        if not key.startswith(("frame.r", "target.p.r")):  # of 2 pi less they are the same
            assert abs(estimate.value - true) < 5 * estimate.std, key
    assert 0.8 < fit.rms / SIGMA[0] < 1.2


def test_a_table_leaves_open_where_the_body_is_along_its_axis_and_how_it_is_turned_about_it():
    fit = fitted(file=ARM | {"joint": ARM["joint"][:1]})
    assert 0.8 < fit.rms / SIGMA[0] < 1.2
    along, about = ({key for key, _ in one.parts} for one in fit.determinacy.directions)
    assert along == {"frame.x", "frame.y", "frame.z", "target.p.z"}
    assert about >= {"target.p.x", "target.p.y", "target.p.rz"}


def test_the_noise_of_positions_and_attitudes_is_estimated_apart():
    for noise in ((0.05, 2e-4), (0.5, 2e-5)):
        fit = fitted(noise=noise, rows=80)
        assert fit.observations.arm == pytest.approx(noise[0] / noise[1], rel=0.15)
        assert fit.rms == pytest.approx(noise[0], rel=0.1)
        file = ARM | {"measured": ARM["measured"] | {"noise": noise[0], "attitude_noise": noise[1]}}
        stated = fitted(noise=noise, rows=80, file=file)
        assert stated.observations.arm == pytest.approx(noise[0] / noise[1])
        assert stated.chi_square / stated.degrees_of_freedom == pytest.approx(1.0, abs=0.2)
        ratio = {key: e.std / stated.estimates[key].std for key, e in fit.estimates.items()}
        assert all(0.8 < r < 1.2 for r in ratio.values())


def test_uncertainties_of_rows_weight_positions_and_attitudes():
    columns, attitude = measured(noise=SIGMA)
    u = {f"u_{x} [mm]": np.full(40, SIGMA[0]) for x in "xyz"} | {
        f"u_r{x} [rad]": np.full(40, SIGMA[1]) for x in "xyz"
    }
    case = Case(ARM, {**columns, **written("matrix", attitude), **u})
    fit = case.machine.fit(Measurements.from_frame(case.data))
    assert fit.chi_square / fit.degrees_of_freedom == pytest.approx(1.0, abs=0.2)
    del u["u_rz [rad]"]
    with pytest.raises(InputFileError, match="no column 'u_rz'"):
        _ = Case(ARM, {**columns, **written("matrix", attitude), **u}).observations


@pytest.mark.slow
def test_wrong_rows_are_found_by_their_place_or_their_attitude():
    columns, attitude = measured(rows=60)
    columns["x [mm]"][12] += 3
    for row, angle in ((7, 0.05), (30, 2.8)):
        attitude[row] = attitude[row] @ Rotation.from_rotvec([angle, 0, 0]).as_matrix()
    case = Case(ARM, {**columns, **written("quaternion", attitude)})
    fit = case.machine.fit(Measurements.from_frame(case.data), loss="huber")
    assert fit.outlier_numbers == [7, 12, 30]
    assert fit.observations.arm == pytest.approx(SIGMA[0] / SIGMA[1], rel=0.2)
    turned = np.linalg.norm((fit.residuals * fit.in_units)[[7, 30], 3:], axis=1) * np.pi / 648000
    assert turned == pytest.approx([0.05, 2.8], abs=1e-3)


def test_correlated_errors_of_place_and_attitude_are_whitened():
    rows, (place, turn) = 200, SIGMA
    correlation = np.eye(6)
    correlation[0, 4] = correlation[4, 0] = 0.9  # a camera that sees a tilt takes it for a shift
    correlation[1, 3] = correlation[3, 1] = -0.9
    columns, attitude = measured(rows=rows, noise=(0.0, 0.0))
    noise = np.random.default_rng(1).multivariate_normal(np.zeros(6), correlation, rows)
    for i, x in enumerate("xyz"):
        columns[f"{x} [mm]"] = columns[f"{x} [mm]"] + place * noise[:, i]
    attitude = Rotation.from_rotvec(turn * noise[:, 3:]).as_matrix() @ attitude
    stated = ARM["measured"] | {"noise": place, "attitude_noise": turn}
    whole, alone = (
        Case(ARM | {"measured": stated | more}, {**columns, **written("matrix", attitude)})
        for more in ({"correlation": correlation.tolist()}, {})
    )
    fits = [case.machine.fit(Measurements.from_frame(case.data)) for case in (whole, alone)]
    seen = [np.cov(fit.relative_residuals.T) for fit in fits]
    assert np.abs(seen[0] - np.eye(6)).max() < 0.25
    assert seen[1][0, 4] > 0.7
    assert fits[0].chi_square / fits[0].degrees_of_freedom == pytest.approx(1.0, abs=0.1)
    # the same residuals; derivatives and weighted residuals are those of independent errors, whitened
    at = fits[1].solution.theta, fits[1].solution.frame
    whitening = np.linalg.inv(np.linalg.cholesky(correlation))
    np.testing.assert_allclose(whole.problem.residuals(*at), alone.problem.residuals(*at), atol=1e-12)
    for one, other in (
        (p.jacobian(*at), p.residuals(*at, weighted=True)[..., None]) for p in [alone.problem]
    ):
        np.testing.assert_allclose(whole.problem.jacobian(*at), whitening @ one, rtol=1e-9, atol=1e-6)
        found = whole.problem.residuals(*at, weighted=True)[..., None]
        np.testing.assert_allclose(found, whitening @ other, rtol=1e-9, atol=1e-9)
    text = machine_text(whole.machine)
    assert machine_of(text, "again.toml").measured == whole.machine.measured
    for wrong in (
        correlation[:3].tolist(),
        (correlation * 1.5).tolist(),
        (correlation + np.eye(6, k=1)).tolist(),
    ):
        with pytest.raises(InputFileError, match="correlation"):
            _ = Case(ARM | {"measured": stated | {"correlation": wrong}}, {}).machine


@pytest.mark.thorough
def test_correlations_of_each_row_are_those_of_one_or_of_its_covariance():
    """A tracker's errors are longer across its beam: as coefficients, and as the covariance that it exports."""
    rows, rng = 300, np.random.default_rng(3)
    columns, _ = measured(rows=rows, noise=(0.0, 0.0))
    where = rng.normal(size=(rows, 3))
    beam = where / np.linalg.norm(where, axis=1, keepdims=True)
    along = 0.01
    covariance = SIGMA[0] ** 2 * np.eye(3) + (along**2 - SIGMA[0] ** 2) * beam[:, :, None] * beam[:, None, :]
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(rows, 3)))
    places = {f"{x} [mm]": columns[f"{x} [mm]"] + noise[:, i] for i, x in enumerate("xyz")}
    joints = {name: values for name, values in columns.items() if name.startswith("J")}
    file = ARM | {"target": [{"name": "p", "point": [530, 20, 900]}]}
    file = file | {"measured": {"kind": "point", "frame": "free", "correlation": "columns"}}
    deviation = np.sqrt(np.einsum("nii->ni", covariance))
    pairs = [(0, 1), (0, 2), (1, 2)]
    stated = {f"u_{x} [mm]": deviation[:, i] for i, x in enumerate("xyz")}
    stated |= {
        f"corr_{'xyz'[i]}_{'xyz'[j]}": covariance[:, i, j] / deviation[:, i] / deviation[:, j]
        for i, j in pairs
    }
    exported = {
        f"cov_{'xyz'[i]}_{'xyz'[j]} [um^2]": 1e6 * covariance[:, i, j]
        for i, j in [*pairs, (0, 0), (1, 1), (2, 2)]
    }
    one, other = (
        Case(file, {**joints, **places, **more}).machine.fit(
            Measurements.from_frame({**joints, **places, **more})
        )
        for more in (stated, exported)
    )
    assert one.chi_square / one.degrees_of_freedom == pytest.approx(1.0, abs=0.12)
    for key, estimate in one.estimates.items():
        assert other.estimates[key].value == pytest.approx(estimate.value, rel=1e-7, abs=1e-7)
        assert other.estimates[key].std == pytest.approx(estimate.std, rel=1e-6)
    # whitened residuals are independent and of unit size; they are Σ^-1/2 times the plain ones
    white = one.relative_residuals
    assert np.abs(np.cov(white.T) - np.eye(3)).max() < 0.2
    square = np.einsum("ni,nij,nj->n", one.residuals, np.linalg.inv(covariance), one.residuals)
    np.testing.assert_allclose(np.sum(white**2, axis=1), square, rtol=1e-9)
    # what is known of each reading counts: deviations alone give larger uncertainties
    alone = {name: values for name, values in stated.items() if name.startswith("u_")}
    bare = file | {"measured": {"kind": "point", "frame": "free"}}
    plain = Case(bare, {**joints, **places, **alone}).machine.fit(
        Measurements.from_frame({**joints, **places, **alone})
    )
    keys = ("frame.x", "frame.y", "target.p.x")
    assert all(one.estimates[key].std < 0.8 * plain.estimates[key].std for key in keys)
    assert one.predict(Measurements.from_frame(joints)).u.shape == (rows, 3)
    assert one.diagnose().verdict == "nothing_missing"
    assert machine_of(machine_text(one.machine), "again.toml").measured == one.machine.measured


@pytest.mark.parametrize(
    "change",
    [
        {"corr_x_y": None},
        {"corr_x_y": 0.9, "corr_x_z": 0.9, "corr_y_z": -0.9},
        {"cov_x_x [mm]": 1.0},
        {"cov_x_x [mm^2]": 1.0},
    ],
)
def test_what_is_no_correlation_of_a_row_is_one_sentence(refuses, change):
    columns, _ = measured(rows=4)
    stated = {"measured": {"kind": "point", "frame": "free", "correlation": "columns", "noise": 0.1}}
    made = {**columns, **{f"corr_{pair}": np.zeros(4) for pair in ("x_y", "x_z", "y_z")}}
    made |= {name: None if value is None else np.full(4, value) for name, value in change.items()}
    given = {name: values for name, values in made.items() if values is not None}
    refuses(lambda: Case(ARM | stated, given).observations)


@pytest.mark.thorough
def test_a_fitted_machine_predicts_what_the_fit_did():
    stated = {"noise": SIGMA[0], "attitude_noise": SIGMA[1]}
    parameters = ["target", "J3.axis", "J2.point"]
    file = ARM | {"estimate": {"parameters": parameters}, "measured": ARM["measured"] | stated}
    fit = fitted({**SEEN, "J3.axis.a": 0.003}, file)
    again = fixed_machine(fit.machine)
    fixed = again.fit(fit.observations.data)
    assert fixed.rms == pytest.approx(fit.rms, rel=1e-9)
    assert again.targets[0].attitude == pytest.approx(
        [fit.machine.values[f"target.p.{x}"] for x in FRAME_TURNS]
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"noise": 0.1}, "attitude_noise.*missing, while noise is stated"),
        ({"kind": "point", "attitude_noise": 0.1}, "attitude_noise.*with kind = 'pose' only"),
    ],
)
def test_a_file_states_both_noises_or_none(change, said):
    with pytest.raises(InputFileError, match=said):
        _ = Case(ARM | {"measured": ARM["measured"] | change}, {}).machine


# what follows from a fit -----------------------------------------------------------------------------------------


def test_a_prediction_has_attitudes_with_uncertainties_that_hold():
    fit = fitted(seed=3)
    design = {f"J{j} [rad]": np.linspace(-1, 1, 7) * (-1) ** j for j in range(1, 7)}
    prediction = fit.predict(Measurements.from_frame(design))
    columns = prediction.columns()
    exact = Simulated(ARM, SEEN).measure(np.stack(list(design.values()), -1))
    u = np.stack([columns[f"model_u_{x} [mm]"] for x in "xyz"], -1)
    places = np.stack([columns[f"predicted_{x} [mm]"] for x in "xyz"], -1)
    assert np.sqrt(np.mean(((places - exact[:, :3]) / u) ** 2)) == pytest.approx(1.0, abs=0.5)
    vectors = np.stack([columns[f"predicted_r{x} [rad]"] for x in "xyz"], -1)
    u = np.stack([columns[f"model_u_r{x} [arcsec]"] for x in "xyz"], -1) * np.pi / 648000
    off = Rotation.from_rotvec(vectors).as_matrix() @ exact[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
    assert np.sqrt(np.mean((turns(off) / u) ** 2)) == pytest.approx(1.0, abs=0.5)


def test_a_fit_of_poses_is_kept_with_the_weights_that_it_found(tmp_path):
    fit = fitted()
    fit.save(tmp_path / "fit.json")
    again = Fit.load(tmp_path / "fit.json")
    assert again.observations.arm == fit.observations.arm
    assert again.rms == pytest.approx(fit.rms, rel=1e-12)
    said = fit.to_dict()
    assert said["rms_of_positions"] == pytest.approx(SIGMA[0], rel=0.2)
    assert said["rms_of_attitudes"] == pytest.approx(SIGMA[1] * 648000 / np.pi, rel=0.2)


def test_simulated_poses_have_the_noise_that_was_typed(refuses):
    columns, attitude = measured(noise=(0.0, 0.0), rows=200)
    case = Case(ARM, {**columns, **written("quaternion", attitude)})
    made = simulate(case.machine, Measurements.from_frame(case.data), noise="0.2mm, 40 arcsec", seed=2)
    assert {"qw", "qx", "qy", "qz"} <= made.columns.keys()
    fit = case.machine.fit(made.data)
    assert fit.rms == pytest.approx(0.2, rel=0.1)
    assert fit.observations.arm == pytest.approx(0.2 / (40 * np.pi / 648000), rel=0.1)
    refuses(simulate, case.machine, Measurements.from_frame(case.data), noise="0.2mm")


@pytest.mark.slow
def test_attitudes_that_are_the_inverse_are_a_mistake_that_a_check_repairs():
    file = ARM | {"joint": [ARM["joint"][0], ARM["joint"][3]]}
    columns, attitude = measured(file=file)
    data = Measurements.from_frame({**columns, **written("matrix", attitude.swapaxes(1, 2))})
    check = Case(file, {}).machine.fit(data).check()
    assert "the attitudes are those of the measuring frame in the body" in check.repairs[0].words


WRONG = {"J2.zero_offset.a": 0.004, "J3.axis.a": 0.003, "J5.axis.b": -0.002, "J4.point.a": 0.4}
HELD = {key: value for key, value in SEEN.items() if key.startswith("target")}


def fitted_with_errors() -> tuple[Any, Any]:
    """Return the file of an arm with errors, and a fit to its poses without noise."""
    estimate = {"parameters": ["target", "J3.axis", "J5.axis", "J4.point"]}
    file = ARM | {"effect": [effect("zero_offset", "J2")], "estimate": estimate}
    return file, fitted({**SEEN, **WRONG}, file, noise=(0.0, 0.0))


@pytest.mark.thorough
def test_emitted_code_corrects_place_and_attitude_of_the_tool(tmp_path):
    """With the corrected commands the simulated machine is, and is turned, where the nominal one would be."""
    file, fit = fitted_with_errors()
    emit(fit.machine, "numpy", tmp_path, name="arm")
    code = runpy.run_path(str(tmp_path / "arm.py"))
    q = np.random.default_rng(7).uniform(-1.2, 1.2, (12, 6))
    corrected, status, distance = code["compensate"](code["ideal"](q), q)
    assert (status == code["CONVERGED"]).all()
    assert distance.max() < 1e-6
    real, nominal = Simulated(file, HELD | WRONG).measure(corrected), Simulated(file, HELD).measure(q)
    before = Simulated(file, HELD | WRONG).measure(q)
    assert np.abs(before - nominal).max(axis=0)[[0, 1, 2, 3]].min() > 1e-3
    assert np.abs(real - nominal).max() < 1e-5
    emit(fit.machine, "urdf", tmp_path, name="arm")
    origin = ElementTree.parse(tmp_path / "arm.urdf").find("joint[@name='p_fixed']/origin")
    angles = [float(x) for x in origin.get("rpy").split()]
    at_zero = Simulated(file, HELD | WRONG).measure(np.zeros((1, 6)))[0, 3:].reshape(3, 3)
    assert np.abs(Rotation.from_euler("xyz", angles).as_matrix() - at_zero).max() < 1e-5


@pytest.mark.slow
def test_emitted_tests_of_poses_hold(tmp_path, compiler, cpp_compiler):
    _, fit = fitted_with_errors()
    content = content_of(fit.machine, "device")
    passes_in_cpp(content, cpp_compiler, tmp_path)
    passes_in_octave(content, tmp_path)
    emit(fit.machine, "numpy", tmp_path, name="arm")
    emit(fit.machine, "c", tmp_path, name="arm")
    passes_in_c("arm", tmp_path, compiler)
    passes_in_python("arm", tmp_path)


# attitudes alone ---------------------------------------------------------------------------------------------------


def of_attitudes(file: Any = ARM, **measured: Any) -> Any:
    """Return a machine file of which only attitudes are read."""
    targets = [{"name": "p"} | {key: t[key] for key in ("attitude",) if key in t} for t in file["target"]]
    return file | {"target": targets, "measured": {"kind": "orientation", "frame": "free"} | measured}


@pytest.mark.thorough
def test_attitudes_alone_say_what_they_say_in_poses():
    """Where positions count for nothing, a pose says of frame, body and axes what its attitude says."""
    estimate = {"parameters": ["target", "J3.axis", "J5.axis"]}
    effects = [effect("encoder_eccentricity", "J4")]
    file = ARM | {"estimate": estimate, "effect": effects}
    truth = {**SEEN, "J3.axis.a": 0.003, "J4.encoder_eccentricity.a": 0.001}
    columns, attitude = measured(truth, file=file)
    data = {name: x for name, x in columns.items() if name.startswith("J")} | written("quaternion", attitude)
    alone = Case(of_attitudes(file), data).machine.fit(Measurements.from_frame(data))
    u = {f"u_{x} [mm]": np.full(40, 20.0) for x in "xyz"}
    u |= {f"u_r{x} [rad]": np.full(40, SIGMA[1]) for x in "xyz"}
    case = Case(file, {**columns, **written("quaternion", attitude), **u})
    poses = case.machine.fit(Measurements.from_frame(case.data))
    assert np.sqrt(alone.chi_square / alone.degrees_of_freedom) == pytest.approx(SIGMA[1], rel=0.15)
    turns_of = [key for key in alone.estimates if key.startswith(("frame.r", "target.p.r", "J"))]
    assert {"frame.rx", "target.p.rx", "J3.axis.a", "J4.encoder_eccentricity.b"} <= set(turns_of)
    assert turns_of == list(alone.estimates)
    for key in turns_of:
        one, other = alone.estimates[key], poses.estimates[key]
        assert one.value == pytest.approx(other.value, abs=0.05 * other.std)
    columns = alone.residual_columns()
    assert {"predicted_qw", "residual_rx [arcsec]"} <= columns.keys()
    prediction = alone.predict(Measurements.from_frame(data)).columns()
    assert {"predicted_qw", "model_u_rx [arcsec]"} <= prediction.keys()
    assert alone.compare().to_dict()["components"][0]["unit"] == "arcsec"


@pytest.mark.thorough
def test_an_effect_is_found_in_attitudes_alone():
    columns, attitude = measured({**SEEN, "J5.encoder_eccentricity.a": 0.001}, 60)
    data = {name: x for name, x in columns.items() if name.startswith("J")} | written("matrix", attitude)
    machine = Case(of_attitudes(noise=SIGMA[1]), data).machine
    found = machine.fit(Measurements.from_frame(data)).diagnose()
    assert named(found) == [("encoder_eccentricity", "J5")]
    made = simulate(machine, Measurements.from_frame(data), seed=1)
    assert {"r11", "r33"} <= made.columns.keys()


# angles --------------------------------------------------------------------------------------------------------


def of_angles(**more: Any) -> Any:
    """Return the file of a tilting table on a turning one, whose turn about a leaning axis is read."""
    joints = [joint("C", "revolute", [0, 0, 1]), joint("A", "revolute", [1, 0, 0], [0, 0, 200])]
    file = machine_file(joints, kind="angle", about=[0.1, 0.2, 0.97], **more)
    return file | {"target": [{"name": "p"}, {"name": "r"}]}


ANGLES = {"target.p.zero": 2.5, "target.r.zero": -3.0, "C.encoder_eccentricity.a": 2e-3, "A.axis.b": 4e-3}


def angles(noise: float, rows: int = 80) -> dict[str, Any]:
    rng = np.random.default_rng(2)
    q = np.stack([rng.uniform(-20, 20, rows), rng.uniform(-0.6, 0.6, rows)], -1)
    names = ["p" if i % 2 else "r" for i in range(rows)]
    read = Simulated(of_angles(), ANGLES).measure(q, target=names)[:, 0] + noise * rng.normal(size=rows)
    turns = 2 * np.pi * rng.integers(-3, 4, rows)  # whole turns do not count
    return {"C [rad]": q[:, 0], "A [rad]": q[:, 1], "target": names, "angle [rad]": read + turns}


def test_angles_about_an_axis_are_those_of_the_simulator_and_columns_its_derivatives():
    file = of_angles(estimate=["target", "C.axis", "A.axis"], effects=[effect("encoder_eccentricity", "C")])
    case = Case(file, angles(0.0))

    def off(values: Any) -> np.ndarray:
        difference = case.observations.reading - Simulated(file, values).measure(
            np.stack([case.data["C [rad]"], case.data["A [rad]"]], -1), target=case.data["target"]
        )
        return 2 * np.tan(np.angle(np.exp(1j * difference)) / 2)

    at = ANGLES | {"C.axis.a": 0.02, "A.axis.a": -0.03, "target.p.zero": 2.3}
    assert np.abs(case.problem.residuals(case.theta(at), case.frame()) - off(at)).max() < 1e-12
    jacobian = case.problem.jacobian(case.theta(at), case.frame())
    for key, column in case.model.keys.items():
        found = (
            sum(
                factor * sign * off(at | {key: at.get(key, 0.0) + sign * n * 2e-3})
                for n, factor in STENCILS[8].items()
                for sign in (1, -1)
            )
            / 2e-3
        )
        assert np.abs(jacobian[:, :, column] - found).max() < 1e-8 * max(np.abs(found).max(), 0.1), key


@pytest.mark.thorough
def test_angles_say_what_turns_about_their_axis():
    file = of_angles(estimate=["target"], noise=5e-5)
    machine = Case(file, {}).machine
    data = angles(5e-5)
    fit = machine.fit(Measurements.from_frame(data))
    assert fit.estimates["target.r.zero"].value == pytest.approx(-3.0, abs=5e-3)
    found = fit.diagnose()
    assert {"encoder_eccentricity", "axis_tilt"} <= {effect for effect, _ in named(found)}
    final = found.final
    assert final.estimates["C.encoder_eccentricity.a"].value == pytest.approx(2e-3 * 648000 / np.pi, abs=10)
    columns = final.residual_columns()
    off = np.asarray(columns["predicted_angle [rad]"]) + columns["residual_angle [rad]"] - data["angle [rad]"]
    assert np.abs(off).max() < 1e-9
    prediction = final.predict(Measurements.from_frame({k: v for k, v in data.items() if k != "angle [rad]"}))
    assert {"predicted_angle [arcsec]", "model_u_angle [arcsec]"} <= prediction.columns().keys()
    made = simulate(machine, Measurements.from_frame(data), seed=1)
    assert "angle [rad]" in made.columns


# hidden effects ------------------------------------------------------------------------------------------------


def diagnosed(case: Hidden, folder: Path, *, attitudes: bool = True) -> Any:
    """Diagnose as a user would, with the attitudes or without."""
    machine, data = case.write(folder)
    text = machine.read_text(encoding="utf-8")
    if not attitudes:
        text = "\n".join(line for line in text.splitlines() if "attitude_noise" not in line)
        text = text.replace('"pose"', '"point"')
    machine.write_text(text, encoding="utf-8")
    return Machine.load(machine).fit(Measurements.load(data)).diagnose()


def named(diagnosis: Any) -> list[tuple[str, str | None]]:
    return [step.effect.identity for step in diagnosis.steps]


def equals(diagnosis: Any) -> set[tuple[str, str | None]]:
    return {alias.effect.identity for step in diagnosis.steps for alias in step.indistinguishable_from}


@pytest.mark.thorough
@pytest.mark.parametrize("state_noise", [pytest.param(True, marks=pytest.mark.slow), False])
def test_an_effect_of_the_last_joint_shows_in_attitudes_that_positions_do_not_tell(state_noise, tmp_path):
    """A flange that wobbles turns the board and moves its middle as a radial motion does, which turns nothing."""
    case = hidden(
        board(np.random.default_rng(3)), 3, [("tilt_error_motion", "J6")], raises=2.0, state_noise=state_noise
    )
    whole, points = (diagnosed(case, tmp_path / str(k), attitudes=k) for k in (True, False))
    assert named(whole) == [("tilt_error_motion", "J6")]
    assert not equals(whole)
    assert {*named(points), *equals(points)} >= {("tilt_error_motion", "J6"), ("radial_error_motion", "J6")}
