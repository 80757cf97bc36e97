"""What people do with results in Python: tables from other libraries, copies, pickles."""

import copy
import inspect
import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import is_dataclass, replace

import numpy as np
import pytest
from made_diagnoses import mount

import rodgen
from rodgen.calibration.fit import Fit
from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.errors import InputFileError
from rodgen.kinematics import delta, hexapod, instantaneous_euler, screws, spatial, three_sps_s, tricept
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.views import Records


@pytest.fixture(scope="module")
def table():
    return Machine(
        "Table",
        "mm",
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        joints=(Joint("C", "revolute", (0.0, 0.0, 1.0)),),
        targets=(Target("near", (100.0, 0.0, 40.0)), Target("far", (0.0, 150.0, 10.0))),
        measured=Measured("point", "machine", noise=0.002),
        estimate=("C.axis", "target"),
    )


@pytest.fixture(scope="module")
def columns(table):
    design = {"C [deg]": np.tile(np.arange(0.0, 360.0, 30.0), 2), "target": ["near"] * 12 + ["far"] * 12}
    made = simulate(table, design, ["encoder_eccentricity@C:a=30arcsec"], noise="2um", seed=3).data
    return {column.text: column.values for column in made.columns.values()}


@pytest.fixture(scope="module")
def fit(table, columns):
    return table.fit(columns)


@pytest.fixture(scope="module")
def diagnosis(fit):
    return fit.diagnose()


def pandas_frame(columns):
    return pytest.importorskip("pandas").DataFrame(columns)


def indexed(columns):
    return pandas_frame(columns).set_index(["target", "C [deg]"])


def polars_frame(columns):
    return pytest.importorskip("polars").DataFrame(columns)


def xarray_grid(columns):
    """Return a Dataset of dimensions target and C, with the units as attributes."""
    xarray = pytest.importorskip("xarray")
    cells = {n: (("target", "C"), columns[f"{n} [mm]"].reshape(2, 12), {"units": "mm"}) for n in "xyz"}
    places = {"target": columns["target"][::12], "C": ("C", columns["C [deg]"][:12], {"units": "deg"})}
    return xarray.Dataset(cells, places)


def structured(columns):
    columns = {name: np.asarray(values) for name, values in columns.items()}
    made = np.zeros(24, [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        made[name] = values
    return made


@pytest.mark.parametrize(
    "library",
    [
        pandas_frame,
        indexed,
        pytest.param(polars_frame, marks=pytest.mark.slow),
        pytest.param(xarray_grid, marks=pytest.mark.slow),
        structured,
    ],
)
def test_a_machine_is_fitted_to_the_tables_of_other_libraries(table, columns, fit, library):
    found = table.fit(library(columns))
    assert found.machine.values == pytest.approx(fit.machine.values, rel=1e-12)
    assert found.rms == pytest.approx(fit.rms, rel=1e-12)


def test_a_fit_predicts_and_is_tested_on_a_table_in_memory(fit, columns):
    assert fit.predict({"C [deg]": [15.0], "target": ["far"]}).place.shape == (1, 3)
    assert fit.diagnose(test=columns).rms.before_test == pytest.approx(fit.rms, rel=0.2)


def test_a_column_without_its_unit_is_one_sentence(refuses, table, columns):
    frame = pandas_frame(columns).rename(columns={"C [deg]": "C"})
    refuses(table.fit, frame)
    refuses(table.fit, 7)


@pytest.fixture(scope="module")
def results(table, columns, fit, diagnosis):
    """Return results, each with what must be the same of its copy."""
    compiled = table.fit(columns, compiled=True)  # holds functions of a compiled library
    target = "numpy" if os.environ.get("RODGEN_CPU") == "numpy" else "c"
    assert compiled.problem.model.kernels["residual"].target == target
    return [
        (compiled, lambda fit: (fit.to_dict(), fit.machine.doubts())),
        (fit.compare(), lambda comparison: comparison.to_dict()),
        (diagnosis, lambda diagnosis: (diagnosis.to_dict(), str(diagnosis))),
        (diagnosis.plan(4), str),
        (fit.check(), str),
        (fit.predict(columns), lambda prediction: prediction.u.tolist()),
    ]


COPIES = [copy.copy, copy.deepcopy, lambda result: pickle.loads(pickle.dumps(result))]


@pytest.mark.parametrize("again", COPIES, ids=["copy", "deepcopy", "pickle"])
def test_results_can_be_copied_and_pickled(results, again):
    for one, essence in results:
        assert essence(again(one)) == essence(one)


@pytest.mark.thorough
def test_results_are_dataframes_on_request(fit, diagnosis, columns):
    pandas = pytest.importorskip("pandas")
    parameters = fit.parameters.to_pandas()
    assert list(parameters["key"]) == list(fit.estimates)
    assert parameters["std"].iloc[0] == fit.estimates["C.axis.a"].std
    residuals = fit.residuals.to_pandas()
    assert list(residuals)[:5] == list(columns)
    np.testing.assert_array_equal(residuals["residual_y [mm]"], fit.residuals[:, 1])
    table = fit.compare().table.to_pandas()
    assert list(table) == ["covariate", "unit", "component", "explained", "log10_odds"]
    steps = diagnosis.steps.to_pandas()
    assert list(steps["effect"]) == ["encoder_eccentricity"]
    assert re.fullmatch(
        r"a = 3\d\.\d\d ± 0\.\d\d arcsec; b = .* arcsec", steps["parameters"][0]
    )  # 30 are hidden
    prediction = fit.predict({"C [deg]": [15.0], "target": ["far"]}).to_pandas()
    assert list(prediction["determined"]) == [1]
    back = fit.observations.data.to_pandas()
    assert all(isinstance(frame, pandas.DataFrame) for frame in (parameters, residuals, table, steps, back))
    np.testing.assert_array_equal(back["x [mm]"], columns["x [mm]"])


def test_residuals_of_copied_rows_stand_in_the_rows_as_they_were_given(table, columns):
    pytest.importorskip("pandas")
    twice = {name: np.r_[values, values] for name, values in columns.items()}
    fit = table.fit(twice)
    found = fit.residuals.to_pandas()
    assert fit.observations.copies == 24
    np.testing.assert_array_equal(found["C [deg]"], twice["C [deg]"])
    np.testing.assert_array_equal(found["residual_x [mm]"][24:], found["residual_x [mm]"][:24])
    many = table.fit({name: np.tile(values, 3) for name, values in columns.items()}).residuals
    assert "72 rows" in many._repr_html_()
    assert [row[0] for row in many.document().blocks[0].rows] == [
        *(f"{c:.6g}" for c in many.columns()["C [deg]"][:5]),
        "…",
        *(f"{c:.6g}" for c in many.columns()["C [deg]"][-5:]),
    ]


def test_residuals_are_an_array(refuses, fit):
    pairs = [(fit.residuals * 2, "product"), (fit.residuals[:3], "part"), (np.sqrt(fit.residuals**2), "root")]
    assert {type(made) for made, _ in pairs} == {np.ndarray}
    assert isinstance(float(fit.residuals.mean()), float)
    assert type(pickle.loads(pickle.dumps(fit.residuals))) is np.ndarray
    refuses(fit.residuals.reshape(-1).to_pandas, raises=TypeError)


def test_a_dataframe_without_pandas_is_one_sentence(refuses, fit, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    refuses(fit.parameters.to_pandas)


def test_every_result_shows_itself_in_a_notebook(table, fit, diagnosis, results):
    for one in (fit, diagnosis, table, *(result for result, _ in results)):
        assert one._repr_html_().startswith("<")
    assert "encoder_eccentricity" in diagnosis.steps._repr_html_()
    assert ">C.axis.a</th>" in fit.parameters._repr_html_()
    assert ">C [deg]</th>" in fit.observations._repr_html_()
    assert ">residual_x [mm]</th>" in fit.residuals._repr_html_()
    assert "<b>" not in replace(table, name="<b>")._repr_html_()
    parts = (
        fit.noise,
        fit.lack_of_fit,
        fit.held_out(),
        fit.dependence,
        fit.estimates["C.axis.a"],
        *diagnosis.steps,
    )
    for one in parts:
        assert one._repr_html_().startswith("<")


def test_a_long_table_costs_the_rows_that_are_shown(fit):
    calls = []
    records = Records(range(10_000_000), lambda i: calls.append(i) or {"i": i, "all": [0] * 10_000})
    (table,) = records.document().blocks
    assert calls == [*range(5), *range(9_999_995, 10_000_000)]
    assert [row[0] for row in table.rows] == [*map(str, calls[:5]), "…", *map(str, calls[5:])]
    assert "10000000 rows" in records._repr_html_()
    assert table.rows[0][1] == "list of 10000"
    many = fit.predict({"C [deg]": np.linspace(0, 90, 100), "target": ["far"] * 100})
    assert "100 rows" in many._repr_html_()


def test_an_error_in_the_input_is_short_in_a_notebook(table):
    """IPython shows what the method returns, of which it expects lines."""
    with pytest.raises(InputFileError) as error:
        table.fit({"C": [1.0], "x [mm]": [2.0]})
    lines = error.value._render_traceback_()
    assert lines[-1] == f"InputFileError: {error.value}"
    assert len(lines) == 2
    assert 'table.fit({"C": [1.0], "x [mm]": [2.0]})' in lines[0]


def test_a_fit_draws_its_residuals(refuses, fit, monkeypatch):
    pytest.importorskip("plotly")
    assert len(fit.plot().data) > 0
    assert [*fit.plot("C").data[0].x[:3]] == [0, 30, 60]
    assert [*fit.plot().data[0].x[:3]] == [0, 1, 2]
    refuses(fit.plot, "W")
    monkeypatch.setitem(sys.modules, "rodgen.output.figures.residuals", None)
    monkeypatch.setitem(sys.modules, "plotly", None)
    refuses(fit.plot)


def test_a_diagnosis_draws_the_error_of_each_model():
    pytest.importorskip("plotly")
    diagnosis = mount()
    drawn = [value for mark in diagnosis.plot().data for value in mark.x]
    assert {diagnosis.rms.before, diagnosis.rms.after} <= set(drawn)


def public_classes():
    """Yield the names and classes of results and parts that users import."""
    for name in sorted({*rodgen.__all__, *rodgen._LATER, *rodgen._SUBJECTS}):
        one = getattr(rodgen, name)
        inner = {f"{name}.{n}": getattr(one, n) for n in getattr(one, "__all__", ())}
        for full, each in {name: one, **inner}.items():
            if isinstance(each, type) and (is_dataclass(each) or issubclass(each, tuple)):
                yield full, each


@pytest.mark.parametrize(
    ("name", "one"), [*public_classes()], ids=lambda value: value if isinstance(value, str) else ""
)
def test_everything_that_is_public_shows_itself_in_a_notebook(name, one):
    assert callable(one._repr_html_), name


GEOMETRIES = {
    "LinearGeometry": delta.LinearGeometry(140.0, 290.0),
    "RotaryGeometry": delta.RotaryGeometry(140.0, 300.0, 750.0),
    "hexapod": hexapod.Geometry(np.eye(6, 3), np.ones((6, 3))),
    "three_sps_s": three_sps_s.Geometry(200.0, 120.0, 260.0),
    "tricept": tricept.Geometry(300.0, 200.0, (0.0, 0.0, -100.0)),
}


def functions_of_arrays():
    """Yield public functions that need arrays and perhaps a geometry, with arrays of a shape that none has."""
    for name in sorted({*rodgen.__all__, *rodgen._SUBJECTS}):
        one = getattr(rodgen, name)
        for inner in getattr(one, "__all__", [name]):
            each = getattr(one, inner, one)
            if not inspect.isfunction(each):
                continue
            needed = [p for p in inspect.signature(each).parameters.values() if p.default is p.empty]
            given = {p.name: np.ones((2, 7, 5)) for p in needed if "ArrayLike" in str(p.annotation)}
            kinds = {p.name: str(p.annotation).rpartition(" ")[2] for p in needed}
            kinds = {
                p: kind if kind in GEOMETRIES else name for p, kind in kinds.items() if "Geometry" in kind
            }
            given |= {p: GEOMETRIES[kind] for p, kind in kinds.items()}
            if given and given.keys() == {p.name for p in needed}:
                yield f"{name}.{inner}", each, given


def test_a_wrong_shape_is_a_sentence_of_rodgen_everywhere():
    """What is elementwise takes any shape; all else says what it expects, and no function NumPy's own words."""
    calls = [*functions_of_arrays()]
    assert len(calls) > 70
    refused = {}
    for name, function, given in calls:
        try:
            function(**given)
        except (ValueError, TypeError) as error:
            refused[name] = str(error)
    assert len(refused) > 60
    assert {name: said for name, said in refused.items() if "expected" not in said} == {}


def test_parts_and_numeric_results_are_shown_copied_and_pickled(table):
    joint, target = table.joints[0], table.targets[0]
    geometry = GEOMETRIES["tricept"]
    many = [
        joint, target, table.measured, table.effect("scale", "C"), geometry,
        tricept.matrices([0.1, 0.2, 700.0], geometry), hexapod.Geometry(np.eye(6, 3), np.ones((6, 3))),
        instantaneous_euler.rotations([1.0, 1.0, 1.0]), spatial.PUMA_560,
        screws.screw_axis(np.eye(6)[0]), rodgen.fit_axis(np.eye(3), np.eye(3)[[1, 2, 0]], 2.0943951),
    ]  # fmt: skip
    for one in many:
        assert one._repr_html_().startswith("<")
        for again in COPIES:
            assert repr(again(one)) == repr(one)


def test_nothing_of_a_notebook_is_imported_before_it_is_needed():
    code = (
        "import sys, rodgen, rodgen.views; rodgen.figures\n"
        "late = {'pandas', 'polars', 'xarray', 'plotly', 'kaleido', 'matplotlib'}; print(late & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_a_saved_fit_is_the_same_again(table, columns, tmp_path, loss):
    columns = columns | {"x [mm]": columns["x [mm]"] + np.eye(24)[5] * (loss == "huber")}
    columns = {name: np.r_[values, values] for name, values in columns.items()}  # copies of rows
    fit = table.fit(columns, loss=loss)
    assert fit.outliers.sum() == (loss == "huber")
    fit.save(tmp_path / "fit.json")
    again = rodgen.Fit.load(tmp_path / "fit.json")
    assert json.dumps(again.to_dict() | {"copies": 24}) == json.dumps(fit.to_dict())
    assert again.loss == loss
    assert again.machine == fit.machine
    assert again.machine.doubts() == fit.machine.doubts()
    np.testing.assert_array_equal(again.residuals, fit.residuals)


def test_a_saved_fit_needs_no_other_file(tmp_path, columns, table):
    pytest.importorskip("pandas").DataFrame(columns).to_csv(tmp_path / "data.csv", index=False)
    (tmp_path / "machine.toml").write_text("# mine\n" + machine_text(table))
    fit = Machine.load(tmp_path / "machine.toml").fit(Measurements.load(tmp_path / "data.csv"))
    (tmp_path / "data.csv").write_text("changed since")
    fit.save(tmp_path / "fit.json")  # what was fitted, not what is there now
    about = json.loads((tmp_path / "fit.json").read_text())
    assert about["versions"]["rodgen"] == rodgen.__version__
    assert about["files"] == {
        name: str(tmp_path / f"{name}.{x}") for name, x in (("machine", "toml"), ("data", "csv"))
    }
    again = Fit.load(tmp_path / "fit.json")
    assert again.to_dict() == fit.to_dict()
    assert again.observations.data.place(3) == "line 5"


@pytest.mark.thorough
def test_what_is_no_saved_fit_is_one_sentence(refuses, fit, tmp_path):
    path = tmp_path / "fit.json"
    fit.save(path)
    about = json.loads(path.read_text())

    def complaint(text):
        path.write_text(text)
        with pytest.raises(InputFileError) as caught:
            Fit.load(path)
        return str(caught.value).removeprefix(f"{path}: ")

    for name, changed in (("machine", about["machine"] + "#"), ("data", {})):
        wrong = complaint(json.dumps(about | {name: changed}))
        assert wrong.startswith(f"{name}: not the content that was fitted, by its hash")
    worse = json.dumps(about | {"rms": 2 * about["rms"]})
    assert "its model was another one; expected the versions that made it: rodgen" in complaint(worse)
    assert complaint(json.dumps(about | {"settings": 7})).startswith("file: 'TypeError")
    for part, wrong in (
        ("settings", {"outliers": [10**25]}),
        ("solution", {"rotation": 1}),
        ("solution", {"position": [1]}),
    ):
        assert complaint(json.dumps(about | {part: about[part] | wrong})).startswith("file: ")
    assert complaint("[" * 100_000).startswith("file: 'RecursionError")
    assert complaint("[]").startswith("file: 'TypeError")
    assert complaint(json.dumps(about | {"format": 9})) == "format: 9; expected 2"
    assert complaint("nothing").startswith("file: 'JSONDecodeError")
    path.write_bytes(b"PK\x03\x04\xff")
    refuses(Fit.load, path)
    refuses(Fit.load, tmp_path / "none.json")


def test_a_fit_to_part_of_observations_cannot_be_saved(refuses, fit, tmp_path):
    some = fit.refit(observations=fit.observations.take(slice(None, None, -1)))
    refuses(some.save, tmp_path / "fit.json")
    assert not (tmp_path / "fit.json").exists()


# machines built in Python ----------------------------------------------------------------------------------------


def built(*joints, **changes):
    given = {
        "name": "Table", "length_unit": "mm", "angle_unit": "deg", "gravity": (0, 0, -1), "reference_temperature": 20.0,
        "joints": joints, "targets": (rodgen.Target("ball", (100, 0, 0)),),
        "measured": rodgen.Measured("point", "machine"),
    }  # fmt: skip
    return rodgen.Machine(**(given | changes))


C = rodgen.Joint("C", "revolute", [0, 0, 2])
ROWS = {"C [deg]": [0.0, 90.0], "x [mm]": [100.0, 0.0], "y [mm]": [0.0, 100.0], "z [mm]": [0.0, 0.0]}


@pytest.mark.parametrize(
    'made',
    [
        lambda: rodgen.Joint("C", "rotary"),
        lambda: rodgen.Joint("C", "revolute"),
        lambda: rodgen.Joint("C", "revolute", (0, 1)),
        lambda: rodgen.Joint("C", "revolute", (0, 0, 1), drive="wurm"),
        lambda: rodgen.Target("ball", "near"),
        lambda: built(C, C).fit(ROWS),
        lambda: built(C, estimate=("C.axes",)).fit(ROWS),
        lambda: built(C, gravity=(0, 0, -9.81)).fit(ROWS),
        lambda: built(
                rodgen.Joint("A", "revolute", (1, 0, 0), branch="workpiece"),
                rodgen.Joint("C", "revolute", (0, 0, 1), branch="tool"),
                rodgen.Joint("B", "revolute", (0, 1, 0), branch="workpiece"),
            ).fit(ROWS),
    ],
)  # fmt: skip
def test_a_machine_built_in_python_is_checked_as_a_file_is(refuses, made):
    refuses(made)
