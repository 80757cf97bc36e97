"""Machines of two branches: as they are built, against the plain simulator, matrices, and the chains that they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosis_checks import in_file_units
from emitted_code import COMPILERS, REACHED, Compiled, loaded, passes_in_octave
from hidden_effects import Hidden, hidden
from hidden_effects import five_axis as bench_of_five_axes
from machine_cases import ROWS, TARGETS, Case, data_for, effect, frame, joint, machine_file, possible, toml
from test_emit import emitted
from test_machine_jacobians import columns_off, near

from rodgen.calibration.check import check
from rodgen.data.measurements import Measurements
from rodgen.machines.emit._geometry import CONSTANT, geometry_of
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism

pytestmark = pytest.mark.xdist_group("branches")


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")


def branched(
    file: dict[str, Any], workpiece: str, tool: str, instrument: str = "workpiece"
) -> dict[str, Any]:
    """Return a machine file with its joints in branches."""
    branches = [{"name": "workpiece", "joints": workpiece.split()}, {"name": "tool", "joints": tool.split()}]
    return file | {"branch": branches, "measured": file["measured"] | {"instrument": instrument}}


# kernels -------------------------------------------------------------------------------------------------------

SKEW = [
    joint("B", "revolute", [0.3, 0.9, -0.2], [20, -30, 10]),
    joint("A", "revolute", [0.8, 0.1, 0.59], [100, 50, -20]),
    joint("Z", "prismatic", [0.1, -0.2, 0.97], [5, 6, 7], travel=[-100.0, 300.0]),
    joint("C", "revolute", [-0.1, 0.2, -0.97], [-30, 10, 15]),
    joint("Y", "prismatic", [0.1, 0.9, 0.1], [15, -60, 70], travel=[-200.0, 100.0]),
    joint("D", "revolute", [0.7, -0.3, 0.4], [40, 20, -35]),
]


def every(kind: str, instrument: str = "workpiece") -> Case:
    """Return a machine with every effect at joints of the branch that carries the instrument, and some of the other."""
    estimate = ["B.axis", "C.axis", "D.axis", *(["B.point", "D.point"] if kind != "direction" else [])]
    bare = machine_file(SKEW, TARGETS, kind=kind, frame="free", estimate=estimate, gravity=(0.6, 0, -0.8))
    file = branched(bare, "B A Z C", "Y D", instrument)
    file["effect"] = possible(bare, places=["A", "Z", None, "p", "r"])
    return Case(file, data_for(file, ROWS, np.random.default_rng(4)))


@pytest.mark.thorough("pose-workpiece")
@pytest.mark.parametrize(
    ("kind", "instrument"),
    [("point", "workpiece"), ("pose", "workpiece"), ("direction", "workpiece"), ("point", "tool")],
)
def test_every_effect_in_a_branch_is_that_of_the_simulator_and_its_column_the_derivative(kind, instrument):
    case = every(kind, instrument)
    within = 1e-13 if kind == "direction" else 1e-10
    where = frame(kind)
    start = case.predicted(where)
    assert np.abs(start - case.simulated(where)).max() < within
    for block in case.file["effect"] if (kind, instrument) == ("point", "workpiece") else []:
        values = case.sizeable(case.keys_of(block)) | where
        found = case.predicted(values)
        assert np.abs(found - case.simulated(values)).max() < within, block
        assert np.abs(found - start).max() > 1e3 * within, block
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys, 30.0) | where
    assert np.abs(case.predicted(values) - case.simulated(values)).max() < 10 * within
    if kind == "pose":
        return  # its residual is that of any chain
    rows = np.ones(ROWS, bool)
    if kind == "direction":
        # refraction bends most sharply near the horizon, where differences say little
        values, keys = values | {"refraction.a": 0.0}, [key for key in keys if key != "refraction.a"]
        case = case.changed(data=case.data | near(case, values))
    off = columns_off(case, values, keys[:: 4 if kind == "point" else 7], rows)
    assert {key for key in off if key != "Z.load_sag.k0"} == set()


# the chains that they are --------------------------------------------------------------------------------------


def test_a_machine_whose_joints_are_all_in_one_branch_is_the_chain():
    names = " ".join(j["name"] for j in SKEW)
    chain = machine_file(SKEW, TARGETS, effects=possible(machine_file(SKEW, TARGETS), places=["A", "Z"]))
    one = Case(chain, {}).machine
    for workpiece, tool, instrument in (("", names, "workpiece"), (names, "", "tool")):
        other = Case(branched(chain, workpiece, tool, instrument), {}).machine
        assert other.structure == one.structure
        assert [j.name for j in other.joints] == [j.name for j in one.joints]


# emitted -------------------------------------------------------------------------------------------------------


def five_axis() -> dict[str, Any]:
    """Return [w C A b X Y Z t] with errors on both sides of the bed."""
    joints = [
        joint("A", "revolute", [1, 0, 0], [0, 20, -60], travel=[-1.7, 0.7]),
        joint("C", "revolute", [0, 0, 1], [5, 0, 0], travel=[-3.1, 3.1]),
        *(joint(x, "prismatic", n, travel=[-300.0, 300.0]) for x, n in zip("XYZ", np.eye(3), strict=True)),
    ]
    names = {
        "C": "axis_tilt axis_offset zero_offset encoder_eccentricity backlash radial_error_motion",
        "A": "axis_tilt zero_offset gravity_windup", "Y": "squareness straightness", "X": "zero_offset scale",
    }  # fmt: skip
    effects = [effect(name, place) for place, several in names.items() for name in several.split()]
    return branched(machine_file(joints, [(0, 0, 150)], effects=effects), "A C", "X Y Z")


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS[:1])
def test_emitted_code_brings_the_tool_to_its_place_in_the_workpiece(compiler, tmp_path):
    file = five_axis()
    case = Case(file, data_for(file, ROWS, np.random.default_rng(3)))
    device = emitted(case, tmp_path, case.sizeable(case.model.keys))
    passes_in_octave(device.content, tmp_path)
    assert "in machine axes that move with the workpiece" in (tmp_path / "device.h").read_text()
    o, module, compiled = case.observations, loaded(tmp_path), Compiled(compiler, tmp_path)
    wanted = case.simulated()
    commands, status, left = compiled.compensate(wanted, o.q, o.target, device.conditions())
    again, *_ = module.compensate(wanted, o.q, o.target, **device.conditions())
    assert (status == module.CONVERGED).all()
    assert np.abs(commands - again).max() < 1e-9
    units = {True: "rad", False: "mm"}
    corrected = {f"{j.name} [{units[j.revolute]}]": commands[:, i] for i, j in enumerate(case.machine.joints)}
    reached = case.changed(data=case.data | corrected).simulated(device.values)
    assert np.abs(case.simulated(device.values) - wanted).max() > 0.1
    assert np.abs(reached - wanted).max() < REACHED
    assert left.max() < REACHED


def test_the_geometry_of_a_fitted_machine_is_a_chain_from_the_instrument():
    file = five_axis()
    constant = [block for block in file["effect"] if block["name"] in CONSTANT]
    case = Case(file | {"effect": constant}, data_for(file, ROWS, np.random.default_rng(3)))
    values = case.sizeable(case.model.keys, 30.0)
    geometry = geometry_of(replace(case.machine, values=values))
    assert not geometry.machine.branches
    assert "the bed as base: the chain begins at the workpiece" in geometry.left_out
    poses = to_mechanism(geometry.machine).forward(case.observations.q)
    places = poses @ [*geometry.machine.targets[0].point, 1.0]
    assert np.abs(places[:, :3] - case.simulated(values)).max() < 1e-9


# files ---------------------------------------------------------------------------------------------------------

TABLE = """
name = "A table"
[units]
length = "mm"
angle = "deg"
[[branch]]
name = "workpiece"
joints = ["C"]
[[branch]]
name = "tool"
joints = ["X"]
[[joint]]
name = "X"
type = "prismatic"
axis = [1, 0, 0]
[[joint]]
name = "C"
type = "revolute"
axis = [0, 0, 1]
[[target]]
name = "ball"
point = [0, 0, 100]
[measured]
kind = "point"
frame = "machine"
instrument = "tool"
"""


def machine_from(folder: Path, text: str) -> Machine:
    path = folder / "machine.toml"
    path.write_text(text)
    return Machine.load(path)


def test_file_says_the_branches_and_reads_back_equal(tmp_path):
    machine = machine_from(tmp_path, TABLE)
    assert [j.name for j in machine.joints] == ["X", "C"]
    assert "branches: [w C b X t], instrument on the tool" in machine.describe()
    assert "point in machine axes that move with the tool" in machine.describe()
    machine.save(tmp_path / "again.toml")
    assert Machine.load(tmp_path / "again.toml") == machine
    seen = machine_from(tmp_path, TABLE.replace('instrument = "tool"', ""))
    assert [j.name for j in seen.joints] == ["C", "X"]
    seen.save(tmp_path / "again.toml")
    assert Machine.load(tmp_path / "again.toml") == seen
    only = machine_from(tmp_path, TABLE.replace('["C"]', "[]").replace('["X"]', '["X", "C"]'))
    assert only.describe().splitlines()[3] == "branches: [w b X C t], instrument on the tool"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"workpiece"', '"table"'),
        ('"workpiece"', '"tool"'),
        ('["C"]', '["D"]'),
        ('["C"]', '["C", "X"]'),
        ('["C"]', "[]"),
        ('["C"]', '"C"'),
        ('instrument = "tool"', 'instrument = "spindle"'),
        ("[[branch]]", "[branch]"),
    ],
)
def test_what_is_no_branch_is_one_sentence(refuses, tmp_path, old, new):
    refuses(machine_from, tmp_path, TABLE.replace(old, new, 1))


def test_an_instrument_is_on_a_branch_of_a_machine_that_has_them(refuses, tmp_path):
    text = TABLE[: TABLE.index("[[branch]]")] + TABLE[TABLE.index("[[joint]]") :]
    refuses(machine_from, tmp_path, text)


# diagnoses and checks ------------------------------------------------------------------------------------------


def measured(folder: Path, seed: int, *effects: tuple[str, str]) -> tuple[Hidden, Path, Path]:
    case = hidden(bench_of_five_axes(np.random.default_rng(seed)), seed, list(effects), raises=1.5)
    return case, *case.write(folder)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("seed", "name", "place"),
    [
        (1, "encoder_eccentricity", "C"),
        (2, "radial_error_motion", "C"),
        pytest.param(2, "backlash", "A", marks=pytest.mark.slow),
        pytest.param(2, "straightness", "X", marks=pytest.mark.slow),
        pytest.param(2, "thermal_axis_drift", "C", marks=pytest.mark.slow),
    ],
)
def test_an_error_of_the_table_is_found_where_it_is_and_with_its_signs(seed, name, place, tmp_path):
    case, machine, data = measured(tmp_path, seed, (name, place))
    diagnosis = Machine.load(machine).fit(Measurements.load(data)).diagnose()
    truth = case.sealed.open(diagnosis)
    assert [(step.effect.name, step.effect.place) for step in diagnosis.steps] == [(name, place)]
    found = in_file_units(diagnosis.final, "deg")
    for key, estimate in diagnosis.final.estimates.items():
        # a first harmonic is partly a shift of the ball in the table, or of the axis
        if key.startswith(f"{place}.{name}") and not (name == "radial_error_motion" and "1" in key):
            assert abs(found[key] - truth.values[key]) < 4 * estimate.std / estimate.value * found[key], key


@pytest.mark.thorough
def test_a_wrong_instrument_and_a_wrong_sign_are_found(tmp_path):
    file = five_axis() | {"effect": [], "estimate": {"parameters": ["A.point", "C.point", "target"]}}
    case, rng = Case(file, data_for(file, 60, np.random.default_rng(8))), np.random.default_rng(9)
    reading = case.simulated({"A.point.a": 0.1}) + 0.002 * rng.normal(size=(60, 3))
    columns = {name: x for name, x in case.data.items() if name.partition(" ")[0] in [*"ACXYZ"]}
    data = Measurements.from_frame(columns | {f"{x} [mm]": reading[:, i] for i, x in enumerate("xyz")})
    right = toml(file)
    wrong = {
        'the instrument is on the workpiece, the targets are not: instrument = "workpiece"': right.replace(
            'instrument = "workpiece"', 'instrument = "tool"'
        ),
        "C turns the other way: axis = [0, 0, 1]": right.replace('"C"\ntype = "revolute"\naxis = [0.0, 0.0, 1.0]',
                                                                '"C"\ntype = "revolute"\naxis = [0.0, 0.0, -1.0]'),
    }  # fmt: skip
    assert not check(machine_from(tmp_path, right), data).wrong
    for words, text in wrong.items():
        found = check(machine_from(tmp_path, text), data)
        assert found.wrong
        assert words in " ".join(found.summary().split()), found.summary()
