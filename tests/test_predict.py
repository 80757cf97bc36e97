"""Where a fitted machine will be, and the covariance of that: by hand, by many fits, and where the data do not tell."""

import json
import math

import numpy as np
import pytest

from rodgen.calibration.predict import Prediction
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Joint, Machine, Measured, Target

NOISE = 0.004


def table(estimate, *, frame="machine", kind="point"):
    return Machine(
        "Table",
        "mm",
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        joints=(Joint("X", "prismatic", (1.0, 0.0, 0.0)), Joint("C", "revolute", (0.0, 0.0, 1.0))),
        targets=(Target("ball", (100.0, 0.0, 40.0)),),
        measured=Measured(kind, frame, noise=NOISE),
        estimate=estimate,
    )


def places(x, c):
    """Where the ball is, with plain trigonometry."""
    c = np.radians(c)
    return np.stack([x + 100 * np.cos(c), 100 * np.sin(c), np.full_like(c, 40.0)], axis=1)


def rows(x, c, read=None):
    x, c = np.asarray(x, float), np.asarray(c, float)
    read = places(x, c) if read is None else read
    columns = {"X [mm]": x, "C [deg]": c}
    return Measurements.from_frame(columns | {f"{n} [mm]": read[:, i] for i, n in enumerate("xyz")})


def commands(**columns):
    return Measurements.from_frame(
        {f"{n} [{u}]": v for (n, u), v in zip((("X", "mm"), ("C", "deg")), columns.values(), strict=True)}
    )


def test_a_target_of_which_n_readings_are_the_mean_has_their_noise_over_root_n():
    c = np.linspace(0, 300, 16)
    fit = table(("target",)).fit(rows(np.zeros(16), c))
    made = fit.predict(commands(x=[0.0, 700.0], c=[33.0, 250.0]))
    np.testing.assert_allclose(made.place, places(np.array([0, 700.0]), np.array([33.0, 250.0])), atol=1e-9)
    np.testing.assert_allclose(
        made.covariance, np.broadcast_to(np.eye(3) * NOISE**2 / 16, (2, 3, 3)), atol=1e-14
    )
    assert made.determined.all()


def test_a_slide_that_never_moved_leaves_its_direction_open_only_where_it_moves():
    fit = table(("X.axis",)).fit(rows(np.zeros(9), np.linspace(0, 320, 9)))
    made = fit.predict(commands(x=[0.0, 500.0], c=[10.0, 10.0]))
    assert made.determined.tolist() == [True, False]
    assert np.isfinite(made.u[0]).all()
    assert np.isnan(made.u[1]).all()


@pytest.mark.slow
def test_the_scatter_of_many_fits_is_what_one_says_of_itself():
    machine = table(("C.axis", "C.point", "target"))
    random = np.random.default_rng(5)
    x, c = random.uniform(0, 400, 24), random.uniform(0, 360, 24)
    far = commands(x=[900.0, -200.0], c=[77.0, 181.0])
    exact = places(x, c)
    fits = [machine.fit(rows(x, c, exact + NOISE * random.normal(size=exact.shape))) for _ in range(300)]
    seen = np.array([fit.predict(far).place for fit in fits])
    said = fits[0].predict(far).covariance
    for k in range(2):
        found = np.cov(seen[:, k].T)
        # 299 degrees of freedom: a variance scatters by sqrt(2/299) = 8 %, and four of that are let pass
        whitened = np.linalg.solve(
            np.linalg.cholesky(said[k]), seen[:, k].T - seen[:, k].mean(axis=0)[:, None]
        )
        np.testing.assert_allclose(np.var(whitened, axis=1, ddof=1), 1.0, atol=4 * np.sqrt(2 / 299))
        assert np.linalg.norm(found - said[k]) < 0.5 * np.linalg.norm(said[k])


def test_the_same_holds_for_a_machine_on_legs():
    machine = Machine.load("examples/machines/tricept/machine.toml").add("leg_thermal_expansion", joint="A1")
    data = Measurements.load("examples/machines/tricept/data.csv")
    fit = machine.fit(data)
    made = fit.predict(data)
    # the mean variance of a prediction where the data are: parameters per reading, times that of a reading
    readings = fit.observations.n * 3
    mean = np.mean(np.trace(made.covariance, axis1=1, axis2=2)) / 3
    np.testing.assert_allclose(mean, fit.determinacy.rank / readings * 0.006**2, rtol=1e-6)


def test_a_run_that_was_not_measured_has_no_place(refuses):
    base = table(("target",)).add("frame_shift")
    c = np.linspace(0, 300, 12)
    read = places(np.zeros(12), c)
    columns = {"X [mm]": np.zeros(12), "C [deg]": c, "run": np.repeat(["1", "2"], 6)}
    data = Measurements.from_frame(columns | {f"{n} [mm]": read[:, i] for i, n in enumerate("xyz")})
    fit = base.fit(data)
    again = Measurements.from_frame({"X [mm]": [0.0], "C [deg]": [5.0], "run": ["2"]})
    assert np.isfinite(fit.predict(again).place).all()
    other = Measurements.from_frame({"X [mm]": [0.0], "C [deg]": [5.0], "run": ["3"]})
    refuses(fit.predict, other)


def test_the_command_adds_places_and_their_uncertainty(tmp_path, capsys):
    design = tmp_path / "design.csv"
    design.write_text("A0 [mm],A1 [mm],A-1 [mm],target,T_A0 [degC]\n760,770,750,nose,21.5\n")
    out = tmp_path / "places.csv"
    folder = "examples/machines/tricept"
    assert main(["predict", f"{folder}/machine.toml", f"{folder}/data.csv", str(design), "-o", str(out)]) == 0
    assert "1 row" in capsys.readouterr().err
    head, row = out.read_text().splitlines()
    names = head.split(",")
    assert names[5:8] == ["predicted_x [mm]", "predicted_y [mm]", "predicted_z [mm]"]
    assert names[-1] == "determined"
    assert row.endswith(",1")
    u = [float(x) for x in row.split(",")[8:11]]
    assert 0 < min(u) < max(u) < 0.04
    # a leg expands, which is not in the model: successive poses share errors, and the uncertainty allows for it
    fit = Machine.load(f"{folder}/machine.toml").fit(Measurements.load(f"{folder}/data.csv"))
    assert fit.dependence.factor > 2
    exact = fit.predict(Measurements.load(design))
    assert u == [float(f"{x:.1e}") for x in exact.u[0]]  # two significant digits
    for written, place, uncertainty in zip(row.split(",")[5:8], exact.place[0], u, strict=True):
        decimals = 1 - math.floor(math.log10(uncertainty))
        assert float(written) == round(place, decimals)
        assert len(written.partition(".")[2]) <= decimals
    more = ["--coverage", "2", "--all-digits"]
    files = [f"{folder}/machine.toml", f"{folder}/data.csv", str(design)]
    assert main(["predict", *files, "-o", str(out), *more]) == 0
    assert "expanded, k = 2" in capsys.readouterr().err
    head, row = out.read_text().splitlines()
    assert head.split(",")[8:11] == ["model_U_x [mm]", "model_U_y [mm]", "model_U_z [mm]"]
    assert [float(x) for x in row.split(",")[8:11]] == pytest.approx(2 * exact.u[0], rel=1e-12)


def test_directions_have_the_decimals_of_their_angles():
    turn = 10 * np.pi / 648000  # 10 arcsec
    made = Prediction(
        np.array([[0.6, 0.0, 0.8], [1.0, 0, 0]]) + 1e-9, np.array([np.eye(2) * turn**2, np.full((2, 2), np.nan)]),
        np.array([True, False]), ("ux", "uy", "uz"), "arcsec", _factor=np.pi / 648000,
    )  # fmt: skip
    columns = made.columns(rounded=True)
    assert columns["model_u_horizontal [arcsec]"].tolist()[0] == 10
    assert columns["predicted_uz"].tolist() == [0.8, 1e-9]  # what is not determined is left as it is


def test_a_command_out_of_reach_is_an_error_with_its_place(tmp_path, capsys):
    design = tmp_path / "design.csv"
    design.write_text("A0 [mm],A1 [mm],A-1 [mm],target\n760,770,750,nose\n100,770,750,nose\n")
    folder = "examples/machines/tricept"
    out = tmp_path / "places.csv"
    assert main(["predict", f"{folder}/machine.toml", f"{folder}/data.csv", str(design), "-o", str(out)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "line 3: legs of 100, 770, 750 mm, which close in no pose of this tricept" in said.err
    assert not out.exists()
    assert json.dumps(said.err).count("\\n") == 1
