"""The kernels of machines against the plain simulator, which shares no code with them.

Every effect of the catalogue stands in one machine for each kind of reading, at a revolute and at a prismatic joint
with other joints before and behind; its kernels are compiled once, and then see many numbers, hard ones among them.
Chains of one to seven joints and formulas of users have kernels of their own.

Tolerances: places are some 1000 mm away, where a double has steps of 1e-13 mm; the longest way through a kernel is some
hundred roundings, which would be 1e-11 mm if they all added up. `WITHIN` is ten times that, and for directions, of
length 1, a thousandth of it. Large angles are not the doubles that they are meant to be: 1e5 rad is known to 1.5e-11
rad, on an arm of 500 mm 1e-8 mm; that is allowed for, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from machine_cases import (
    FREE_FRAME,
    JOINTS,
    ROWS,
    Case,
    data_for,
    effect,
    every,
    frame,
    joint,
    machine_file,
    own,
    possible,
    several,
    skyward,
    unit,
)

from rodgen.data.units import unit_factor
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.effects.definition import ALL_OF_A_LOOP, OF_A_LOOP

KINDS = ["point", "direction", "distance"]
WITHIN = {"point": 1e-10, "distance": 1e-10, "direction": 1e-13}


def agree(case: Case, values: dict[str, float], *, reserve: float = 1.0) -> np.ndarray:
    """Hold the kernels against the simulator, and return what they predict."""
    found, expected = case.predicted(values), case.simulated(values)
    assert np.isfinite(found).all()
    off = np.abs(found - expected).max()
    assert off <= reserve * WITHIN[case.kind], off
    return found


# every effect ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_no_effect_of_the_catalogue_is_left_out(kind):
    places = {"A": "revolute", "Z": "prismatic", None: "machine", "p": "target", "r": "target"}
    there = {(e["name"], places[e.get("joint") or e.get("target")]) for e in every(kind).file["effect"]}
    of_sight = {(d.name, place) for d in CATALOGUE for place in d.at if d.of_directions}
    axes = {(d.name, "machine") for d in CATALOGUE if d.component == "axes"}
    of_others = {*OF_A_LOOP, *ALL_OF_A_LOOP}
    silent = {
        "point": of_sight,
        "distance": of_sight | axes,
        "direction": {(d.name, "prismatic") for d in CATALOGUE if d.component in {"reading", "axis"}}
        | {("straightness", "prismatic"), ("axis_offset", "revolute"), ("instrument_scale", "machine")}
        | axes
        | {(f"{x}_error_motion", "revolute") for x in ("radial", "axial")}
        | {("thermal_axis_drift", "revolute")},
    }[kind]
    of_chains = {(d.name, place) for d in CATALOGUE for place in d.at - of_others if d.component != "plate"}
    assert of_chains - silent == there


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("where", [{}, FREE_FRAME], ids=["machine's own frame", "frame far away"])
def test_each_effect_moves_the_readings_as_in_the_simulator(kind, where):
    case = every(kind)
    where = frame(kind) if where else {}
    start = agree(case, where)
    silent = []
    for block in case.file["effect"]:
        keys = case.keys_of(block)
        found = agree(case, case.sizeable(keys) | where)
        if np.abs(found - start).max() < 1e3 * WITHIN[kind]:
            silent.append(block)
    assert keys
    # Neither a beam without a drop of its own is silent, nor anything else: each effect is sizeable.
    assert silent == []


@pytest.mark.parametrize("kind", KINDS)
def test_all_effects_at_once_and_free_axes_agree_with_the_simulator(kind):
    case = every(kind)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    agree(case, case.sizeable(keys))
    # half a degree, 5 mm each: nothing is linear any more, and near the horizon refraction multiplies roundings
    agree(case, case.sizeable(keys, 100.0) | frame(kind), reserve=30)


@pytest.mark.parametrize("kind", KINDS)
def test_the_unit_of_length_makes_no_difference(kind):
    """A machine in metres and one in millimetres predict the same of the same data: no formula hides a length."""
    case = every(kind)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys)

    def metres(block: dict[str, Any]) -> dict[str, Any]:
        lengths = {"travel", "from"} | ({"point"} if kind != "direction" or "axis" in block else set())
        return {
            name: [x / 1000 for x in value] if name in lengths else value for name, value in block.items()
        }

    file = case.file | {
        "units": {"length": "m", "angle": "rad"},
        "joint": [metres(j) for j in case.file["joint"]],
        "target": [metres(t) for t in case.file["target"]],
        "measured": metres(case.file["measured"]),
    }
    in_metres = case.changed(file=file)
    assert in_metres.model.structure == case.model.structure
    units = {key: case.model.parameters[number].unit for key, number in case.model.keys.items()}
    factor = {key: unit_factor(units[key], "m")[0] / unit_factor(units[key], "mm")[0] for key in values}
    in_its_units = {key: value * factor[key] for key, value in values.items()}
    scale = 1.0 if kind == "direction" else 1000.0
    off = np.abs(scale * in_metres.predicted(in_its_units) - case.predicted(values)).max()
    assert off <= WITHIN[kind]


# hard numbers ------------------------------------------------------------------------------------------------


def with_joints(case: Case, **changes: dict[str, Any]) -> Case:
    joints = [j | changes.get(j["name"], {}) for j in case.file["joint"]]
    return case.changed(file=case.file | {"joint": joints})


def along_axes(case: Case) -> Case:
    """Let all axes lie along machine axes, two of them anti-parallel, and gravity along one."""
    axes = {"B": [0.0, 0.0, -1.0], "A": [-1.0, 0.0, 0.0], "Z": [0.0, -1.0, 0.0], "C": [0.0, 0.0, 1.0]}
    turned = with_joints(case, **{name: {"axis": axis} for name, axis in axes.items()})
    return turned.changed(file=turned.file | {"environment": {"gravity": [0.0, 0.0, -2.0]}})


def equal_components(case: Case) -> Case:
    """Let components of the axes be equally large: the first decides what completes them."""
    axes = {"B": [1.0, 1.0, 1.0], "A": [-1.0, 1.0, -1.0], "Z": [0.0, 2.0, 2.0], "C": [-3.0, 0.0, 3.0]}
    return with_joints(case, **{name: {"axis": axis} for name, axis in axes.items()})


def targets_on_the_axis(case: Case) -> Case:
    """Let one target lie on the last axis, the other on its point (as directions: along the axis and against it)."""
    c = case.file["joint"][-1]
    places = [c["point"], (np.array(c["point"]) - 50 * np.array(c["axis"])).tolist()]
    if case.kind == "direction":
        places = [c["axis"], [-x for x in c["axis"]]]
    targets = [t | {"point": place} for t, place in zip(case.file["target"], places, strict=True)]
    return case.changed(file=case.file | {"target": targets})


def at_zero(case: Case) -> Case:
    """Let all joints stand at zero, and nothing move."""
    names = [f"{j['name']} [{'mm' if j['type'] == 'prismatic' else 'rad'}]" for j in case.file["joint"]]
    return case.changed(data=case.data | {name: np.zeros(ROWS) for name in names})


HARD: dict[str, Callable[[Case], Case]] = {
    "axes along machine axes": along_axes,
    "equal components": equal_components,
    "targets on the axis": targets_on_the_axis,
    "joints at zero": at_zero,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", HARD.values(), ids=HARD.keys())
def test_special_places_agree_with_the_simulator(kind, change):
    case = change(every(kind))
    assert case.model.structure == every(kind).model.structure  # so that nothing is compiled anew
    agree(case, {})
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    agree(case, case.sizeable(keys) | frame(kind))


@pytest.mark.parametrize("kind", KINDS)
def test_many_turns_agree_with_the_simulator(kind):
    """Coordinates beyond 1e5 rad: sine and cosine are taken of the whole angle, with all its digits."""
    case = every(kind)
    rng = np.random.default_rng(6)
    case = case.changed(
        data=case.data
        | {f"{j} [rad]": rng.uniform(1e5, 2e6, ROWS) * rng.choice([-1, 1], ROWS) for j in "ABC"}
    )
    keys = [k for k in case.model.keys if k.startswith(("A.", "Z."))]
    # 2e6 rad have steps of 2.3e-10 rad; errors are added to the coordinate, and the simulator turns by a vector
    agree(case, case.sizeable(keys), reserve=1e4)


@pytest.mark.parametrize("kind", KINDS)
def test_axes_and_set_ups_turned_by_any_angle_agree_with_the_simulator(kind):
    case = every(kind)
    turns = [k for k in case.model.keys if k.endswith((".axis.a", ".axis_tilt.a", ".squareness.b"))]
    turns += [k for k in case.model.keys if "frame_shift" in k and (".r" in k or kind == "direction")]
    if kind == "direction":
        turns += ["p.target_offset.a", "r.target_offset.b"]
    for angle in (1e-12, 1e-3, 0.4999, 0.5001, 1.0, 3.0, np.pi, 3.3, 2 * np.pi, 7.0):
        agree(case, dict.fromkeys(turns, angle), reserve=2)


TURNS = [
    0.0,
    1e-300,
    1e-160,
    1e-9,
    1e-4,
    0.01,
    0.2,
    0.49,
    0.4999999,
    0.5,
    0.5000001,
    0.51,
    1.0,
    2.0,
    3.0,
    np.pi,
]
TURNS += [3.2, 5.0, 2 * np.pi, 6.5, 9.0, 100.0]


def turning(kind: str) -> Case:
    """Return a machine whose errors turn by as much as a column says, about skew vectors of each size of `TURNS`."""
    blocks = []
    places = [("joint", "A"), ("joint", "Z"), (None, None)] + (
        [("target", "p")] if kind == "direction" else []
    )
    for n, (key, place) in enumerate(places):
        for x in "xyz":
            block = {"name": f"own_{n}{x}", "component": f"r{x}", "formula": f"a*turn*w{x}"}
            block |= {"parameters": {"a": "rad"}, "meaning": "A turn."} | ({key: place} if key else {})
            blocks.append(block)
    file = machine_file(JOINTS[1:], [(120, 30, 40)], kind=kind, effects=blocks)
    rng = np.random.default_rng(8)
    rows = len(TURNS) * 4
    data = data_for(file, rows, rng)
    w = unit(rng.normal(size=(rows, 3)))
    data |= {"turn": np.repeat(TURNS, 4)} | {f"w{x}": w[:, i] for i, x in enumerate("xyz")}
    return Case(file, data)


@pytest.mark.parametrize("kind", ["point", "direction"])
def test_rotation_vectors_of_any_length_agree_with_the_simulator(kind):
    case = turning(kind)
    values = {}
    for block in case.file["effect"]:
        n, x = int(block["name"][4]), block["name"][5]
        (key,) = case.keys_of(block)
        values[key] = 0.2 + n + 0.3 * "xyz".index(x)
    # factors of up to 4 on turns of up to 100 rad: sines of angles that are known to 5e-14 rad
    found, expected = case.predicted(values), case.simulated(values)
    off = np.abs(found - expected).max(axis=1)
    size = 1.0 if kind == "direction" else 1000.0
    allowed = size * 1e-15 * (100 + 4 * case.data["turn"])
    assert (off <= allowed).all(), list(zip(case.data["turn"], off / allowed, strict=True))


MOUNT = [joint("AZ", "revolute", (0, 0, -1)), joint("EL", "revolute", (1, 0, 0))]


def test_sine_and_cosine_are_those_of_the_whole_angle():
    """An angle may be any double: 1e5 rad, a number of turns that is nearly whole, 1e100 rad."""
    angles = np.concatenate(
        [10.0 ** np.arange(-300, 101, 12), -(10.0 ** np.arange(0, 25)), [2.0**20 * np.pi]]
    )
    file = machine_file(MOUNT, [(0, 1, 0)], kind="direction", effects=[effect("refraction")])
    data = data_for(file, len(angles), np.random.default_rng(1))
    case = Case(file, data | {"AZ [rad]": angles, "EL [rad]": np.full(len(angles), 0.3)})
    with mpmath.workdps(300):
        expected = [[float(f(mpmath.mpf(x))) for f in (mpmath.sin, mpmath.cos)] for x in angles.tolist()]
    # two roundings of a number near 1
    assert np.abs(case.predicted()[:, :2] - np.multiply(expected, np.cos(0.3))).max() < 2.3e-16


def test_refraction_at_zenith_and_nadir_and_near_the_horizon():
    """Up to 30 arcsec from the horizon, where a tan z is 57 degrees and more; at the zenith nothing is lifted."""
    file = machine_file(MOUNT, [(0, 1, 0)], kind="direction", effects=[effect("refraction")])
    elevation = np.array([np.pi / 2, -np.pi / 2, 1.5, -1.5, 0.5, 0.01, 1.45e-4, -1.45e-4, np.pi / 2 - 1e-9])
    data = data_for(file, len(elevation), np.random.default_rng(1)) | {"EL [rad]": elevation}
    case = Case(file, data)
    for a in (1e-4, -1e-4, 0.0):
        found, expected = case.predicted({"refraction.a": a}), case.simulated({"refraction.a": a})
        # near the horizon a rounding of the zenith angle is multiplied by a tan' z = a / cos² z
        assert (
            np.abs(found - expected).max(axis=1) <= 1e-15 * (100 + 100 * abs(a) / np.sin(elevation) ** 2)
        ).all()
    assert case.predicted({"refraction.a": 1e-4})[0] == pytest.approx([0, 0, 1], abs=1e-15)


# chains ------------------------------------------------------------------------------------------------------


def chain(length: int) -> Case:
    """Return a chain of joints about and along skew axes with six effects somewhere, other ones for each length."""
    rng = np.random.default_rng([11, length])
    types = rng.choice(["revolute", "prismatic"], length)
    kind = KINDS[length % 3]
    if kind == "direction":
        types[rng.integers(length)] = "revolute"
    joints = [
        joint(f"J{j}", str(type), unit(rng.normal(size=3)), rng.uniform(-100, 100, 3))
        for j, type in enumerate(types, start=1)
    ]
    target = rng.normal(size=(1, 3)) * 100
    file = machine_file(joints, target, kind=kind, gravity=rng.normal(size=3))
    there = possible(file)
    file["effect"] = [there[i] for i in sorted(rng.choice(len(there), min(6, len(there)), replace=False))]
    return Case(file, data_for(file, ROWS, rng))


@pytest.mark.parametrize("length", range(1, 8))
def test_chains_of_any_joints_agree_with_the_simulator(length, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")  # what C gives is compared below; this is quicker to make
    case = chain(length)
    agree(case, {})
    keys = [key for block in case.file["effect"] for key in case.keys_of(block)]
    agree(case, case.sizeable(keys), reserve=10)


# formulas of users -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_formulas_of_users_agree_with_python_s_own_arithmetic(kind, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, numbers = own(kind)
    found, expected = case.predicted(numbers), case.simulated(numbers)
    assert np.abs(found - expected).max() <= 2 * WITHIN[kind]
    plain = Case(case.file | {"effect": []}, case.data).simulated()
    assert np.abs(found - plain).max() > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_an_effect_of_several_components_is_their_sum(kind, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, numbers = several(kind)
    found, expected = case.predicted(numbers), case.simulated(numbers)
    assert np.abs(found - expected).max() <= 2 * WITHIN[kind]
    assert np.abs(found - Case(case.file | {"effect": []}, case.data).simulated()).max() > 1e-3


def test_formulas_may_use_the_zenith_angle_and_the_azimuth(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, numbers = skyward()
    found, expected = case.predicted(numbers), case.simulated(numbers)
    assert np.abs(found - expected).max() <= 2 * WITHIN["direction"]
    assert np.abs(found - case.predicted({})).max() > 1e-3
