"""What people do with results in Python: tables from other libraries, copies, pickles."""

import copy
import pickle

import numpy as np
import pytest

from rodgen.calibration.simulate import simulate
from rodgen.errors import InputFileError
from rodgen.machines.machine import Joint, Machine, Measured, Target


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


@pytest.mark.parametrize("library", [pandas_frame, indexed, polars_frame, xarray_grid, structured])
def test_a_machine_is_fitted_to_the_tables_of_other_libraries(table, columns, fit, library):
    found = table.fit(library(columns))
    assert found.machine.values == pytest.approx(fit.machine.values, rel=1e-12)
    assert found.rms == pytest.approx(fit.rms, rel=1e-12)


def test_a_fit_predicts_and_is_tested_on_a_table_in_memory(fit, columns):
    assert fit.predict({"C [deg]": [15.0], "target": ["far"]}).place.shape == (1, 3)
    assert fit.diagnose(test=columns).rms.before_test == pytest.approx(fit.rms, rel=0.2)


def test_a_column_without_its_unit_is_one_sentence(table, columns):
    frame = pandas_frame(columns).rename(columns={"C [deg]": "C"})
    with pytest.raises(InputFileError, match=r"^data: columns, column 'C': no unit; expected .*'C \[deg\]'"):
        table.fit(frame)
    with pytest.raises(InputFileError, match="an object of type int; expected a mapping"):
        table.fit(7)


@pytest.fixture(scope="module")
def results(table, columns, fit, diagnosis):
    """Return results, each with what must be the same of its copy."""
    compiled = table.fit(columns, loss="huber")  # holds functions of a compiled library
    assert compiled.problem.model.kernels["residual"].target == "c"
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


def test_a_copy_can_be_used_as_the_original(results):
    (fit, _), *_ = results
    made = pickle.loads(pickle.dumps(fit))
    assert made.refit().rms == pytest.approx(fit.rms, rel=1e-9)
