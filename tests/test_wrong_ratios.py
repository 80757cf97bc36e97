"""A gear ratio or a number of counts that is wrong in the file is said to be that, with the ratio and what to write.

Machines are drawn by SciPy's rotations.
"""

from __future__ import annotations

import numpy as np
import pytest
from machine_cases import toml
from scipy.spatial.transform import Rotation

from rodgen.calibration.check import check
from rodgen.calibration.diagnose import diagnose
from rodgen.data.measurements import Measurements
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine


def arm(
    ratio: float, first: float = 1.0, *, rows: int = 80, frame: str = "machine", seed: int = 1
) -> tuple[Machine, Measurements]:
    """Two axes, of which each turns by a ratio of what it is commanded; of a first of zero, the second alone."""
    random = np.random.default_rng(seed)
    q = random.uniform(-80, 80, (rows, 2))
    turned = Rotation.from_euler("ZY", np.radians(q * [first, ratio]))
    read = turned.apply([500, 20, 100]) + 0.01 * random.normal(size=(rows, 3))
    axes = {"A": [0.0, 0.0, 1.0], "B": [0.0, 1.0, 0.0]}
    names = "AB" if first else "B"
    file = {
        "name": "arm",
        "units": {"length": "mm", "angle": "deg"},
        "joint": [
            {"name": name, "type": "revolute", "axis": axes[name], "point": [0.0, 0, 0]} for name in names
        ],
        "target": [{"name": "ball", "point": [500.0, 20, 100]}],
        "measured": {"kind": "point", "frame": frame},
        "estimate": {"parameters": ["target"]},
    }
    columns = {f"{name} [deg]": q[:, "AB".index(name)] for name in names}
    columns |= {f"{x} [mm]": read[:, k] for k, x in enumerate("xyz")}
    return machine_of(toml(file), "arm.toml"), Measurements.from_frame(columns)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (
            91 / 90,
            '(91/90 is within that): correct it in the control, or write reading = "B", coordinate = "1.0111',
        ),
        (
            1.0234567,
            'of what it reads: correct it in the control, or write reading = "B", coordinate = "1.0234',
        ),
        (1.00001, ""),
    ],
)
def test_a_ratio_that_is_no_effect_of_a_machine_is_said_to_be_wrong(ratio, said):
    found = diagnose(*arm(ratio))
    text = " ".join(str(found).split())
    assert said in text
    assert ("a wrong ratio" in text) == bool(said)
    if said:  # what is written is exact to a tenth of its uncertainty
        written = float(text.partition('coordinate = "')[2].partition("*")[0])
        e = found.steps[0].parameters["k"]
        assert abs(written - 1 - e.value) < 0.1 * e.std


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("first", "second", "changes"),
    [
        (-1, -1, {"A turns the other way", "B turns the other way"}),
        (1.25, -2, {'coordinate = "1.25*A"', 'coordinate = "-2*B"'}),
        (0.5, 1.5, {'coordinate = "0.5*A"', 'coordinate = "1.5*B"'}),
        (1.432, 1, {'coordinate = "1.4320'}),
    ],
)
def test_ratios_of_two_axes_are_said_together(first, second, changes):
    found = check(*arm(second, first))
    assert found.wrong
    assert all(change in found.repairs[0].words for change in changes)
    assert found.repairs[0].changes == len(changes)
    assert found.after < 0.02  # noise of 0.01 mm


@pytest.mark.thorough
@pytest.mark.parametrize(("ratio", "written"), [(1 / 3, "1/3"), (3, "3"), (0.4, "0.4")])
def test_a_ratio_of_the_only_axis_is_found_by_places(ratio, written):
    found = check(*arm(ratio, first=0))
    assert f'coordinate = "{written}*B"' in found.repairs[0].words
    assert found.after < 0.02  # noise of 0.01 mm


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 3])
def test_no_change_is_named_where_readings_are_hardly_more_than_parameters(seed):
    """Five places of three numbers, nine parameters, and a ratio and a sense that are wrong."""
    found = check(*arm(-1, 0.5, rows=5, frame="free", seed=seed))
    assert found.wrong
    assert not found.repairs


@pytest.mark.thorough
@pytest.mark.parametrize(("rows", "seed"), [(6, 5), (8, 0)])
def test_two_changes_are_named_on_few_rows_and_not_one_that_leaves_an_error(rows, seed):
    """A free frame and the target leave 9 and 15 degrees of freedom: one of the two alone left 25 and 6 mm."""
    (repair,) = check(*arm(-1, 0.5, rows=rows, frame="free", seed=seed)).repairs
    assert "A turns by half" in repair.words
    assert "B turns the other way" in repair.words
    assert repair.changes == 2


def of_one_axis(ratio: float) -> tuple[Machine, Measurements]:
    q = np.linspace(0, 350, 72)
    read = ratio * q + 0.3 + np.random.default_rng(2).normal(scale=5 / 3600, size=72)
    file = {
        "name": "table",
        "units": {"length": "mm", "angle": "deg"},
        "joint": [{"name": "C", "type": "revolute", "axis": [0.0, 0, 1], "point": [0.0, 0, 0]}],
        "target": [{"name": "encoder", "zero": 0.0}],
        "measured": {"kind": "angle", "frame": "machine", "about": [0.0, 0, 1]},
        "estimate": {"parameters": ["target"]},
    }
    columns = {"C [deg]": q, "angle [deg]": read}
    return machine_of(toml(file), "table.toml"), Measurements.from_frame(columns)


@pytest.mark.thorough
def test_a_ratio_of_one_axis_that_is_a_hundredth_off_is_found_by_check_and_by_diagnose():
    """The error is a third of a percent of the motion, as large effects leave."""
    case = of_one_axis(91 / 90)
    change = 'C turns by 91/90 of what its reading says: reading = "C", coordinate = "91/90*C"'
    assert [repair.words for repair in check(*case).repairs] == [change]
    found = diagnose(*case)
    assert found.verdict == "cannot_tell"
    assert change in str(found.reason)
    assert not check(*of_one_axis(1.004)).repairs  # an error of scale, if a large one
    (decimal,) = check(*of_one_axis(1.0234567)).repairs  # no fraction of teeth by chance
    assert 'coordinate = "1.0234' in decimal.words
