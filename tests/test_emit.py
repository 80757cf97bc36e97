"""Emitted machines: compiled and run as a user would, against the plain simulator, and each language against the other.

The files are in millimetres and radians (see machine_cases), so the simulator's numbers are the emitted code's.
Tolerances: places are some 1000 mm away and made by some hundred roundings, 1e-11 mm if they all added up; `WITHIN` is
ten times that, as in the tests of the models. A compensation ends within 2**-40 of the machine's size, some 2e-9 mm.
"""

from __future__ import annotations

import contextlib
import csv
import ctypes
import itertools
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import hypothesis
import numpy as np
import pytest
from code_tokens import ANY_NAME, code_of, python_code
from emitted_code import (
    COMPILERS,
    REACHED,
    Compiled,
    emit_both,
    in_octave,
    loaded,
    passes_in_c,
    passes_in_cpp,
    passes_in_octave,
    passes_in_python,
    succeeds,
)
from hypothesis import strategies as st
from machine_cases import ARCSEC, Case, data_for, effect, joint, machine_file
from machine_simulator import Simulated
from scipy.io import loadmat, savemat

from conftest import CPP_WARNINGS
from rodgen.calibration.fit import fit
from rodgen.data.measurements import Measurements
from rodgen.files import write_files
from rodgen.machines.emit import emit
from rodgen.machines.emit._content import Content, _even, content_of
from rodgen.machines.emit._render import render
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.files.schema import JOINT_NAME
from rodgen.machines.files.toml import UnfitError
from rodgen.machines.imports.tpoint_model import mount_machine
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.mounts import ALTAZ

WITHIN = 1e-10
X, Y, Z = np.eye(3)
needs_octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="no octave-cli")


# machines ------------------------------------------------------------------------------------------------------------


def turned_gantry(**more: Any) -> dict[str, Any]:
    """Make X, Y, Z and a C axis below the spindle, none of them quite along the machine axes."""
    joints = [
        joint("X", "prismatic", X, travel=[0.0, 800.0]),
        joint("Y", "prismatic", Y + 1e-3 * X, travel=[-300.0, 300.0]),
        joint("Z", "prismatic", Z, [0, 0, 50], travel=[-400.0, 0.0]),
        joint("C", "revolute", Z, [10, -5, 0]),
    ]
    return machine_file(
        joints, [(120, 0, -60), (-40, 85, -90)], estimate=["C.axis", "C.point", "target"], **more
    )


def mount(**more: Any) -> dict[str, Any]:
    """Make a telescope's mount: azimuth from north (y) through east (x), elevation up."""
    joints = [joint("AZ", "revolute", -Z), joint("EL", "revolute", X)]
    return machine_file(joints, [Y], kind="direction", estimate=["AZ.axis", "EL.axis", "target"], **more)


def arm(**more: Any) -> dict[str, Any]:
    """Make a 6R arm of some 900 mm."""
    joints = [
        joint("J1", "revolute", Z),
        joint("J2", "revolute", Y, [25, 0, 400]),
        joint("J3", "revolute", Y, [25, 0, 860]),
        joint("J4", "revolute", X, [380, 0, 895]),
        joint("J5", "revolute", Y, [390, 0, 895]),
        joint("J6", "revolute", X, [470, 0, 895]),
    ]
    estimate = [f"J{n}.axis" for n in range(1, 7)] + ["target"]
    return machine_file(joints, [(520, 10, 880), (515, 40, 900)], estimate=estimate, **more)


def placed(file: dict[str, Any], **places: str) -> dict[str, Any]:
    """Return the file with effects of the catalogue, by the places where they stand; `whole` is the whole machine."""
    blocks = [
        effect(name, None if place == "whole" else place)
        for place, names in places.items()
        for name in names.split()
    ]
    return file | {"effect": blocks}


MACHINES: dict[str, Callable[[], dict[str, Any]]] = {
    "gantry": lambda: placed(
        turned_gantry(),
        X="scale straightness backlash",
        Y="squareness angular_error_motion gravity_sag",
        Z="thermal_expansion load_sag guide_windup periodic_drive_error",
        C="encoder_eccentricity radial_error_motion gravity_windup load_windup backlash",
        whole="linear_drift",
    ),
    "mount": lambda: placed(
        mount(),
        AZ="tilt_error_motion backlash servo_lag",
        EL="gravity_windup encoder_eccentricity lateral_windup thermal_offset",
        whole="refraction warm_up_drift",
    ),
    "arm": lambda: placed(
        arm(), J2="gravity_windup", J3="gravity_windup backlash", J4="zero_offset", J5="encoder_eccentricity",
        whole="frame_shift",
    ),
    "table": lambda: machine_file(
        [joint("C", "revolute", Z, travel=[-3.0, 3.0])],
        [(100, 0, 0)],
        effects=[effect("encoder_ellipticity", "C"), effect("axial_error_motion", "C")],
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Emitted:
    """A machine with known errors, emitted in both languages; `row` has the conditions in the order of the C struct."""

    case: Case
    values: Mapping[str, float]
    machine: Machine
    folder: Path
    content: Content

    def fields(self) -> list[str]:
        """Return the fields of a row other than q, as the C header declares them."""
        header = next(self.folder.glob("*.h")).read_text()
        struct = re.search(r"typedef struct \{(.*?)\}", header, re.DOTALL)
        assert struct is not None
        return re.findall(r"^  double (\w+)", struct[1], re.MULTILINE)[1:]

    def conditions(self) -> dict[str, np.ndarray]:
        """Return the conditions of the case's rows, as the NumPy functions take them."""
        o = self.case.observations
        temperature = {j: o.temperature[j] if j in o.temperature else np.zeros(o.n) for j in self.case.joints}
        known = {
            "s": o.s, "v": o.v, "T": np.stack(list(temperature.values()), -1), "t": o.t, "load": o.load,
        }  # fmt: skip
        return {name: np.asarray(known[name], float) for name in self.fields()}


def emitted(case: Case, folder: Path, values: Mapping[str, float]) -> Emitted:
    machine = replace(case.machine, values=dict(values))
    return Emitted(case, values, machine, folder, emit_both(machine, folder, case.observations.travel))


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Emitted]:
    """Return a machine of MACHINES with all its effects, emitted once."""

    @cache
    def make(name: str) -> Emitted:
        file = MACHINES[name]()
        case = Case(file, data_for(file, 40, np.random.default_rng(7), runs=1, turn=2.5))
        return emitted(case, tmp_path_factory.mktemp(name), case.sizeable(case.model.keys))

    return make


def simple(
    folder: Path, joints: Any, targets: Any, kind: str = "point", **more: Any
) -> tuple[ModuleType, Machine]:
    """Emit a machine without errors in NumPy."""
    machine = Machine(
        "A machine", "mm", "rad", (0.0, 0.0, -1.0), 20.0, tuple(joints),
        tuple(Target(f"p{i}", tuple(map(float, t))) for i, t in enumerate(targets)), Measured(kind, "machine"), **more,
    )  # fmt: skip
    emit_both(machine, folder)
    return loaded(folder), machine


def revolute(name: str, axis: Any, point: Any = (0, 0, 0), **more: Any) -> Joint:
    return Joint(name, "revolute", tuple(map(float, axis)), tuple(map(float, point)), **more)


def prismatic(name: str, axis: Any, **more: Any) -> Joint:
    return Joint(name, "prismatic", tuple(map(float, axis)), **more)


# the files by themselves ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [2, 3, 8])
def test_samples_are_taken_all_over_the_travel(dimensions):
    points = np.array(list(_even(dimensions, 64)))
    assert points.min() >= 0
    assert points.max() < 1
    for one, other in itertools.combinations(points.T, 2):
        assert np.histogram2d(one, other, bins=2, range=[[0, 1]] * 2)[0].min() >= 8  # 16 on average


@pytest.mark.thorough("gcc-table--O2")
@pytest.mark.parametrize(
    ("name", "optimisation"),
    [
        ("gantry", "-O2"),
        ("table", "-O2"),
        ("mount", "-O0"),  # in a fifth of the time
        ("arm", "-O0"),
        pytest.param("mount", "-O2", marks=pytest.mark.slow),
        pytest.param("arm", "-O2", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("compiler_name", COMPILERS)
def test_own_test_of_the_c_passes_with_strict_flags(every, compiler_name, name, optimisation):
    passes_in_c("device", every(name).folder, compiler_name, optimisation)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "optimisation"),
    [
        ("gantry", "-O0"),
        *[pytest.param(name, "-O2", marks=pytest.mark.slow) for name in MACHINES],
    ],
)
def test_own_test_of_the_cpp_passes_with_strict_flags(every, cpp_compiler, name, optimisation, tmp_path):
    """The header is included twice, and by two sources; a place is read as users read it."""
    (tmp_path / "other.cpp").write_text(
        '#include "device.hpp"\n#include "device.hpp"\n'
        "double other() { const rodgen::device::Row row; return rodgen::device::ideal(row.q)[0]; }\n"
        "bool good() { rodgen::device::Row row; const auto [place, jacobian] = rodgen::device::jacobian(row);\n"
        "const auto [corrected, status, distance] = rodgen::device::compensate(row, place);\n"
        "return jacobian[0].size() == corrected.size() && distance >= 0\n"
        "  && status == rodgen::device::Status::CONVERGED; }\n"
    )
    passes_in_cpp(every(name).content, cpp_compiler, tmp_path, optimisation, "other.cpp")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gantry", *(pytest.param(n, marks=pytest.mark.slow) for n in MACHINES)])
def test_own_test_of_the_matlab_passes_in_octave(every, name, tmp_path):
    passes_in_octave(every(name).content, tmp_path)


@needs_octave
@pytest.mark.parametrize("name", ["table", *(pytest.param(n, marks=pytest.mark.slow) for n in MACHINES)])
def test_matlab_code_does_what_the_numpy_code_does(every, name, tmp_path):
    """Compensations of places within reach and far away, with joints held, of what is not finite, and of no target."""
    found = every(name)
    write_files(tmp_path, render(found.content, "matlab"))
    o, numpy, conditions = found.case.observations, loaded(found.folder), found.conditions()
    wanted, target = numpy.ideal(o.q, o.target), np.array(o.target)
    wanted[::5] *= -3.0
    wanted[3], target[4] = np.nan, len(numpy.TARGETS)
    weight = np.linspace(0, 1, o.q.shape[1])
    row = {name: np.atleast_2d(value.T) for name, value in conditions.items()} | {"q": o.q.T}
    given = {"row": row, "wanted": wanted.T, "target": target + 1.0, "weight": weight[:, None]}
    savemat(tmp_path / "given.mat", given)
    code = "load given.mat; [a, b, c] = rodgen.device.compensate(row, wanted, target);"
    code += (
        "[d, e, f] = rodgen.device.compensate(row, wanted, target, weight); save -v7 found.mat a b c d e f"
    )
    done = in_octave(tmp_path, code)
    assert done.returncode == 0, done.stderr
    by_matlab = loadmat(tmp_path / "found.mat")
    for names, weights in (("abc", None), ("def", weight)):
        corrected, status, distance = numpy.compensate(wanted, o.q, target, **conditions, weight=weights)
        a, b, c = (by_matlab[name] for name in names)
        np.testing.assert_array_equal(b[0], status)
        assert b.dtype == np.int32
        assert {numpy.NOT_FINITE, numpy.NO_TARGET} < set(status.tolist())
        reached = status == numpy.CONVERGED
        np.testing.assert_allclose(a.T[reached], corrected[reached], atol=1e-6)
        np.testing.assert_allclose(c[0], distance, atol=REACHED, rtol=1e-4)


@pytest.mark.thorough("table", "gantry")
@pytest.mark.parametrize("name", MACHINES)
def test_own_test_of_the_numpy_passes_with_nothing_but_numpy(every, name):
    passes_in_python("device_np", every(name).folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_jax_code_does_what_the_numpy_code_does(every, name, tmp_path):
    """Its own test; and compensations of places within reach and far away, of what is not finite, and of no target."""
    pytest.importorskip("jax")
    found = every(name)
    o = found.case.observations
    emit(found.machine, "jax", tmp_path, name="device_jax", travel=o.travel)
    passes_in_python("device_jax", tmp_path)
    numpy, jax, conditions = loaded(found.folder), loaded(tmp_path, "device_jax"), found.conditions()
    wanted, target = numpy.ideal(o.q, o.target), np.array(o.target)
    wanted[::5] *= -3.0
    wanted[3], target[4] = np.nan, len(numpy.TARGETS)
    corrected, status, distance = numpy.compensate(wanted, o.q, target, **conditions)
    by_jax = jax.compensate(wanted, o.q, target, **conditions)
    np.testing.assert_array_equal(by_jax[1], status)
    assert {numpy.NOT_FINITE, numpy.NO_TARGET} < set(status.tolist())
    reached = status == numpy.CONVERGED
    np.testing.assert_allclose(np.asarray(by_jax[0])[reached], corrected[reached], atol=1e-6)
    np.testing.assert_allclose(by_jax[2], distance, atol=REACHED, rtol=1e-4)


@pytest.mark.parametrize("compiler_name", COMPILERS)
def test_own_test_finds_a_wrong_number(every, compiler_name, tmp_path):
    shutil.copytree(every("table").folder, tmp_path / "copy")
    folder = tmp_path / "copy"
    source = folder / "device.c"
    wrong = re.sub(
        r"(effect0_a = )([-\d.e]+)", lambda m: f"{m[1]}{float(m[2]) * 1.001!r}", source.read_text()
    )
    assert wrong != source.read_text()
    source.write_text(wrong)
    command = [compiler_name, str(source), str(folder / "device_test.c"), "-o", str(folder / "run"), "-lm"]
    subprocess.run(command, check=True)
    done = subprocess.run([folder / "run"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "forward is off its reference" in done.stdout
    module = (folder / "device_np.py").read_text()
    (folder / "device_np.py").write_text(module.replace("effect0_a = ", "effect0_a = 1.001 * "))
    done = subprocess.run(
        [sys.executable, folder / "test_device_np.py"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, "")


@needs_octave
def test_own_test_of_the_matlab_finds_a_wrong_number(every, tmp_path):
    files = render(every("table").content, "matlab")
    right = files["+rodgen/device.m"]
    files["+rodgen/device.m"] = right.replace("effect0_a = ", "effect0_a = 1.001 * ", 1)
    write_files(tmp_path, files)
    done = in_octave(tmp_path, "device_test")
    assert done.returncode == 1
    assert "forward is off its reference" in done.stderr


@needs_octave
def test_wrong_arguments_are_an_error_in_matlab(every, tmp_path):
    write_files(tmp_path, render(every("gantry").content, "matlab"))
    wrong = {
        "forward([1 2 3 4].')": "the row has no s; expected q, s, T, t, load",
        "forward(struct('q', [1 2 3 4].'))": "the row has no s; expected q, s, T, t, load",
        "ideal([1 2 3])": "q is 1 x 3; expected 4 x N",
        "ideal(ones(4, 3), [1 2])": "target has 2 columns, another input 3",
    }
    tries = (f"try; rodgen.device.{call}; catch problem; disp(problem.message); end" for call in wrong)
    assert in_octave(tmp_path, "\n".join(tries)).stdout.splitlines() == list(wrong.values())


@pytest.mark.thorough
def test_emitted_c_has_no_state_and_calls_nothing_but_libm(every):
    """So it runs on a controller: nothing but functions, constants, loops over numbers that are known beforehand."""
    for name in MACHINES:
        text = re.sub(r"/\*.*?\*/", "", (every(name).folder / "device.c").read_text(), flags=re.DOTALL)
        assert set(re.findall(r"#include [<\"](\S+)[>\"]", text)) == {"device.h", "math.h"}
        assert not re.search(r"\b(malloc|calloc|realloc|free|printf|goto|while|float)\b", text)
        declared = re.findall(r"^static (?!const\b)[^(]*$", text, re.MULTILINE)
        assert declared == []
        # every function is defined before it is called, and calls no one that follows: there is no recursion
        functions = list(re.finditer(r"^[\w ]+?\*?(\w+)\([^;{]*\) \{$", text, re.MULTILINE))
        names = [m[1] for m in functions]
        for m, end in zip(functions, [*functions[1:], None], strict=True):
            body = text[m.end() : end.start() if end else None]
            called = set(re.findall(r"\b(\w+)\(", body)) & set(names)
            assert called <= set(names[: names.index(m[1])])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only", "-freciprocal-math"])
def test_emitted_c_does_not_compile_with_flags_that_change_arithmetic(every, flag, tmp_path):
    done = subprocess.run(
        ["gcc", "-c", flag, str(every("gantry").folder / "device.c"), "-o", str(tmp_path / "device.o")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode != 0
    assert "#error" in done.stderr
    assert "-ffast-math" in done.stderr


def test_header_serves_cxx(every, cpp_compiler, tmp_path):
    (tmp_path / "alone.cpp").write_text(
        '#include "device.h"\n#include "device.h"\nint main() { return 0; }\n'
    )
    flags = ["-std=c++11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only"]
    succeeds(cpp_compiler, *flags, "-I", every("gantry").folder, tmp_path / "alone.cpp")


# what they compute ----------------------------------------------------------------------------------------------


@pytest.mark.thorough("gantry", "mount", "table")
@pytest.mark.parametrize("name", MACHINES)
def test_forward_is_what_the_simulator_measures(every, name):
    device = every(name)
    o = device.case.observations
    module = loaded(device.folder)
    places = module.forward(o.q, o.target, **device.conditions())
    expected = device.case.simulated(device.values)
    within = WITHIN * (1e-3 if device.case.kind == "direction" else 1)
    assert np.abs(places - expected).max() <= within
    moved = np.abs(places - device.case.simulated()).max()
    assert moved > 1e5 * within  # the errors are there


@pytest.mark.thorough("table", "mount")
@pytest.mark.parametrize("name", MACHINES)
def test_c_and_numpy_compute_the_same(every, compiler, name):
    device = every(name)
    o, conditions = device.case.observations, device.conditions()
    module, c = loaded(device.folder), Compiled(compiler, device.folder)
    place, slopes = module.jacobian(o.q, o.target, **conditions)
    c_place, c_slopes = c.jacobian(o.q, o.target, conditions)
    assert (
        np.abs(c.forward(o.q, o.target, conditions) - module.forward(o.q, o.target, **conditions)).max()
        <= WITHIN
    )
    assert np.abs(c_place - place).max() <= WITHIN
    assert np.abs(c_slopes - slopes).max() <= WITHIN
    wanted = module.ideal(o.q, o.target)
    for weight in (None, np.linspace(0, 1, o.q.shape[1])):
        by_numpy = module.compensate(wanted, o.q, o.target, **conditions, weight=weight)
        by_c = c.compensate(wanted, o.q, o.target, conditions, weight)
        assert (by_c[1] == by_numpy[1]).all()
        assert np.abs(by_c[2] - by_numpy[2]).max() <= REACHED
        reached = by_c[1] == module.CONVERGED
        assert np.abs(by_c[0] - by_numpy[0])[reached].max(initial=0.0) <= REACHED


# what can be reached, and what cannot -----------------------------------------------------------------------------


def test_joints_along_each_other_share_a_correction_by_the_squares_of_their_weights(tmp_path):
    joints = [
        prismatic("X", X, travel=(0.0, 100.0)),
        prismatic("W", Z, travel=(-100.0, 100.0)),
        prismatic("Y", Y, travel=(0.0, 100.0)),
        prismatic("Z", Z, travel=(-300.0, 300.0)),
    ]
    device, _ = simple(tmp_path, joints, [(0, 0, 0)])
    start = np.array([50.0, 10.0, 50.0, 20.0])
    wanted = device.forward(start) + np.array([1.0, 2.0, 10.0])
    corrected, status, _ = device.compensate(wanted, start)
    assert status == device.CONVERGED
    assert np.allclose(corrected - start, [1, 1, 2, 9], atol=1e-9)  # 10 mm in parts of 200² and 600²
    corrected, status, _ = device.compensate(wanted, start, weight=[1, 0, 1, 1])
    assert status == device.CONVERGED
    assert corrected[1] == start[1]
    assert np.allclose(corrected - start, [1, 0, 2, 10], atol=1e-9)
    corrected, status, distance = device.compensate(wanted, start, weight=[1, 0, 1, 0])
    assert status == device.UNREACHABLE
    assert np.allclose(corrected - start, [1, 0, 2, 0], atol=1e-9)
    assert abs(distance - 10) < 1e-9


def test_nearest_point_is_given_where_nothing_reaches(tmp_path):
    """A turntable carries its target on a circle: the nearest point of a circle is known."""
    device, _ = simple(tmp_path, [revolute("C", Z)], [(100, 0, 0)])
    rng = np.random.default_rng(1)
    angle, radius, height = rng.uniform(-3, 3, 50), rng.uniform(30, 300, 50), rng.uniform(-100, 100, 50)
    wanted = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    corrected, status, distance = device.compensate(wanted, angle[:, None] + 0.7)
    nearest = 100 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    assert (status == device.NEAREST).all()
    # the search rests where a step should gain 1e-6 of the squared distance
    assert np.abs(distance / np.linalg.norm(wanted - nearest, axis=1) - 1).max() < 1e-5
    assert np.linalg.norm(device.forward(corrected) - nearest, axis=1).max() < 1.0
    on_circle = device.compensate(nearest, angle[:, None] + 0.7)
    assert (on_circle[1] == device.CONVERGED).all()


def test_travel_is_never_left_and_its_end_is_reported(tmp_path):
    joints = [
        prismatic("X", X, travel=(0.0, 100.0)),
        prismatic("Y", Y, travel=(0.0, 100.0)),
        prismatic("Z", Z),
    ]
    device, _ = simple(tmp_path, joints, [(0, 0, 0)])
    corrected, status, distance = device.compensate([104.0, 50.0, 1e4], [99.0, 0.0, 0.0])
    assert status == device.OUT_OF_TRAVEL
    assert np.allclose(corrected, [100, 50, 1e4], atol=1e-6)
    assert abs(distance - 4) < 1e-6
    corrected, status, _ = device.compensate([100.0, 0.0, 5.0], [500.0, -7.0, 0.0])  # from beyond both ends
    assert status == device.CONVERGED
    assert np.allclose(corrected, [100, 0, 5], atol=1e-9)
    assert (corrected[:2] <= 100).all()
    assert (corrected[:2] >= 0).all()


def test_other_joints_take_over_from_one_at_the_end_of_its_travel(tmp_path):
    joints = [
        prismatic("X", X, travel=(0.0, 100.0)),
        prismatic("U", X, travel=(0.0, 100.0)),
        prismatic("Y", Y),
    ]
    device, _ = simple(tmp_path, joints, [(0, 0, 0)])
    corrected, status, _ = device.compensate([150.0, 0.0, 0.0], [95.0, 20.0, 0.0])
    assert status == device.CONVERGED
    assert np.allclose(corrected, [100, 50, 0], atol=1e-6)


@pytest.mark.parametrize("off", [1e-6, 1e-4, 0.3])
@pytest.mark.parametrize("elevation", [np.pi / 2, np.pi / 2 - 1e-9, 1.5])
def test_mount_at_the_zenith_finds_its_way(off, elevation, tmp_path):
    """Azimuth moves nothing at the zenith, and every direction near it needs another azimuth."""
    device, _ = simple(tmp_path, [revolute("AZ", -Z), revolute("EL", X)], [Y], "direction")
    around = np.linspace(0, 2 * np.pi, 40)
    wanted = np.stack(
        [np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.full(40, np.cos(off))], -1
    )
    corrected, status, distance = device.compensate(wanted, [0.3, elevation])
    assert (status == device.CONVERGED).all()
    assert np.linalg.norm(device.forward(corrected) - wanted, axis=1).max() < 1e-11
    assert (distance < 1e-11).all()


def test_zenith_that_a_crooked_mount_cannot_reach_is_reported(tmp_path):
    """A boresight 1e-3 off its elevation axis's perpendicular leaves a hole of that radius about the azimuth axis."""
    hole = 1e-3
    device, _ = simple(
        tmp_path, [revolute("AZ", -Z), revolute("EL", X)], [(np.sin(hole), np.cos(hole), 0)], "direction"
    )
    around, off = np.meshgrid(np.linspace(0, 6, 15), hole * np.array([0.6, 0.9, 1.1, 3.0]))
    wanted = np.stack([np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)], -1)
    _, status, distance = device.compensate(wanted, [0.2, 1.5])
    assert (status[off > hole] == device.CONVERGED).all()
    assert (status[off < hole] == device.UNREACHABLE).all()
    # the search rests where a step should gain 1e-6 of the squared distance
    assert np.abs(distance / np.abs(hole - off) - 1)[off < hole].max() < 1e-4


@pytest.mark.parametrize("inward", [1e-6, 1e-3, 0.5])
def test_stretched_arm_bends(inward, tmp_path):
    """Both joints move the tip across: there is no first-order way inward."""
    device, _ = simple(tmp_path, [revolute("A", Z), revolute("B", Z, (2, 0, 0))], [(4, 0, 0)])
    corrected, status, _ = device.compensate([4 - inward, 0, 0], [0.0, 0.0])
    assert status == device.CONVERGED
    assert np.linalg.norm(device.forward(corrected) - [4 - inward, 0, 0]) < 1e-11
    _, status, distance = device.compensate([4 + inward, 0, 0], [0.2, 0.1])
    assert status == device.NEAREST  # in its plane only, as the arm is
    assert abs(distance / inward - 1) < 1e-5


def test_far_starts_lead_home(every):
    """A solver that only corrects need not solve the inverse problem; from anywhere near it should."""
    device = every("arm")
    module, conditions = loaded(device.folder), device.conditions()
    q = device.case.observations.q
    wanted = module.forward(q, 0, **conditions)
    start = q + np.random.default_rng(3).uniform(-0.5, 0.5, q.shape)
    corrected, status, _ = module.compensate(wanted, start, 0, **conditions)
    assert (status == module.CONVERGED).mean() > 0.95
    reached = status == module.CONVERGED
    assert np.abs(module.forward(corrected, 0, **conditions) - wanted)[reached].max() <= REACHED


def test_cases_that_step_together_end_as_beside_one_that_takes_no_step(every):
    device = every("arm")
    module, conditions = loaded(device.folder), {k: v[:6] for k, v in device.conditions().items()}
    q = device.case.observations.q[:6]
    wanted = module.forward(q, 0, **conditions)
    start = q + np.geomspace(1e-6, 0.3, 6)[:, None]  # they need different numbers of steps
    together = module.compensate(wanted, start, 0, **conditions)
    further = {k: np.concatenate([v, v[:1]]) for k, v in conditions.items()}
    beside = module.compensate(
        np.concatenate([wanted, wanted[:1]]), np.concatenate([start, start[:1] * np.nan]), 0, **further
    )
    for found, expected in zip(beside, together, strict=True):
        assert np.abs(found[:6] - expected).max() <= WITHIN
    assert beside[1][6] == module.NOT_FINITE


def test_wanted_direction_may_have_any_length(every):
    device = every("mount")
    module, conditions = loaded(device.folder), {k: v[:5] for k, v in device.conditions().items()}
    q = device.case.observations.q[:5]
    wanted = module.ideal(q)
    short, long = (module.compensate(f * wanted, q, **conditions)[0] for f in (1.0, 7.0))
    assert np.abs(short - long).max() < 1e-9


def test_what_is_not_finite_is_reported_and_changes_no_command(every, compiler):
    device = every("mount")
    module, c = loaded(device.folder), Compiled(compiler, device.folder)
    conditions = {name: values[:1] for name, values in device.conditions().items()}
    q, wanted = np.array([[0.3, 0.7]]), np.array([[0.5, 0.6, 0.7]])
    bad = [(wanted * np.nan, q, conditions), (wanted * 0, q, conditions), (wanted * np.inf, q, conditions)]
    bad += [(wanted, q + np.array([[np.inf, 0]]), conditions)]
    bad += [(wanted, q, conditions | {name: np.full_like(conditions[name], np.nan)}) for name in conditions]
    for where, start, given in bad:
        for corrected, status, distance in (
            module.compensate(where, start, **given), c.compensate(where, start, 0, given),
        ):  # fmt: skip
            assert status == module.NOT_FINITE
            assert np.array_equal(corrected, start)
            assert np.isnan(distance)
    for target in (-1, 1, 1000):
        assert np.isnan(module.forward(q, target, **conditions)).all()
        assert np.isnan(c.forward(q, target, conditions)).all()
        assert np.isnan(module.ideal(q, target)).all()
        for corrected, status, distance in (
            module.compensate(wanted, q, target, **conditions), c.compensate(wanted, q, target, conditions),
        ):  # fmt: skip
            assert status == module.NO_TARGET
            assert np.array_equal(corrected, q)
            assert np.isnan(distance)


def test_c_may_write_over_what_it_is_given(every, compiler):
    device = every("gantry")
    o, conditions = device.case.observations, device.conditions()
    c = Compiled(compiler, device.folder)
    wanted, rows = device.case.simulated()[0], c.rows(o.q[:1], {k: v[:1] for k, v in conditions.items()})[0]
    corrected, left = np.empty(4), ctypes.c_double()
    arguments = (c.at(rows), int(o.target[0]), c.at(wanted.copy()), None)
    assert c.function("compensate")(*arguments, c.at(corrected), ctypes.byref(left)) == 0
    for buffer, place in ((np.append(wanted, 0.0), 2), (rows.copy(), 0)):
        again = list(arguments)
        again[place] = c.at(buffer)
        assert c.function("compensate")(*again, c.at(buffer), ctypes.byref(left)) == 0
        assert np.array_equal(buffer[:4], corrected)


def test_numpy_functions_broadcast(every):
    device = every("gantry")
    module = loaded(device.folder)
    conditions = {name: values[:6] for name, values in device.conditions().items()}
    q = device.case.observations.q[:6]
    flat = module.forward(q, 1, **conditions)
    one = {name: values[2] for name, values in conditions.items()}
    assert np.array_equal(module.forward(q[2], 1, **one), flat[2])
    both = module.forward(q[:, None], np.array([0, 1]), **{k: v[:, None] for k, v in conditions.items()})
    assert both.shape == (6, 2, 3)
    assert np.array_equal(both[:, 1], flat)
    corrected, status, distance = module.compensate(flat[2], q, 1, **one)
    assert (corrected.shape, status.shape, distance.shape) == ((6, 4), (6,), (6,))
    assert module.forward(np.empty((0, 4)), 0, **one).shape == (0, 3)


# what belongs to the machine --------------------------------------------------------------------------------------


def two_joints(
    frame: str, effects: list[dict[str, Any]], kind: str = "point"
) -> tuple[Case, dict[str, float]]:
    joints = [joint("X", "prismatic", X, travel=[-200.0, 300.0]), joint("C", "revolute", Z, [20, 0, 0])]
    file = machine_file(joints, [(120, 30, 40)], frame=frame, effects=effects, kind=kind)
    case = Case(file, data_for(file, 20, np.random.default_rng(2), runs=1))
    values = case.sizeable([k for k in case.model.keys if not k.startswith("frame.")])
    return case, values


def forward_of(case: Case, values: Mapping[str, float], folder: Path, **conditions: Any) -> np.ndarray:
    machine = replace(case.machine, values=dict(values))
    emit(machine, "numpy", folder, name="device_np")
    return np.asarray(loaded(folder).forward(case.observations.q, 0, **conditions))


def test_instrument_is_left_out_and_the_head_says_so(tmp_path):
    own = [effect("scale", "X"), effect("backlash", "C")]
    theirs = [effect("instrument_scale"), effect("linear_drift")]
    case, values = two_joints("free", [*own, *theirs])
    values |= {"frame.x": 500.0, "frame.rx": 0.4}
    plain, only = two_joints("machine", own)
    s = case.observations.s.astype(float)
    found = forward_of(case, values, tmp_path, s=s)
    assert np.abs(found - plain.simulated(only)).max() <= WITHIN
    head = (tmp_path / "device_np.py").read_text().partition("import numpy")[0]
    for words in ("the free frame", "'instrument_scale'", "'linear_drift'"):
        assert re.search(rf"^ +{words}: ", head.partition("Not in this place")[2], re.MULTILINE)


def test_set_ups_of_several_runs_are_no_property_of_the_machine(tmp_path):
    joints = [joint("C", "revolute", Z)]
    file = machine_file(joints, [(120, 30, 40)], effects=[effect("frame_shift")])
    case = Case(file, data_for(file, 20, np.random.default_rng(2), runs=2))
    assert forward_of(case, case.sizeable(case.model.keys), tmp_path) == pytest.approx(
        case.simulated(), abs=WITHIN
    )
    assert "'frame_shift': different for each set-up" in (tmp_path / "device_np.py").read_text()


def test_users_formulas_and_covariates_are_emitted(compiler, tmp_path):
    formula = "a*sin(q)*Oil + b*abs(X)/(1 + Oil**2) + c*sign(X)"
    own = {
        "name": "odd", "joint": "C", "component": "reading", "formula": formula,
        "parameters": {"a": "rad", "b": "rad/mm", "c": "rad"},
    }  # fmt: skip
    case, _ = two_joints("machine", [own])
    oil = np.random.default_rng(8).uniform(0, 2, 20)
    case = Case(case.file, case.data | {"Oil": oil})
    values = {"C.odd.a": 1e-3, "C.odd.b": 2e-6, "C.odd.c": -1e-4}
    found = forward_of(case, values, tmp_path, x=oil[:, None])

    def by_hand(c: Mapping[str, Any]) -> Any:
        return 1e-3 * np.sin(c["q"]) * oil + 2e-6 * abs(c["X"]) / (1 + oil**2) - 1e-4 * np.sign(c["X"])

    expected = Simulated(case.file, {"C.reading": by_hand}).measure(case.observations.q)
    assert np.abs(found - expected).max() <= WITHIN
    emit(replace(case.machine, values=values), "c", tmp_path, name="device")
    by_c = Compiled(compiler, tmp_path).forward(case.observations.q, 0, {"x": oil[:, None]})
    assert np.abs(by_c - found).max() <= WITHIN


def seen_by_the_tool() -> Machine:
    joints = (
        replace(prismatic("X", X, travel=(0.0, 100.0)), branch="tool"),
        replace(prismatic("Y", Y, travel=(0.0, 100.0)), branch="tool"),
        replace(revolute("C", Z), branch="workpiece"),
    )
    measured = Measured("point", "machine", instrument="tool")
    machine = table(joints=joints, measured=measured).add("backlash", joint="C", hold={"b": 0.01})
    return machine.add("scale", joint="X", hold={"k": 1e-4})


@pytest.mark.parametrize("fault", ["instrument", "effect", "value"])
def test_own_test_fails_where_another_machine_is_emitted_than_the_fit_predicts(fault, monkeypatch, tmp_path):
    machine = seen_by_the_tool()

    def wrong(given: Machine, travel: Any = None) -> Any:
        changed = {
            "instrument": {"measured": replace(given.measured, instrument="workpiece")},
            "effect": {"effects": given.effects[:1]},
            "value": {"effects": (given.effects[0], replace(given.effects[1], hold={"k": 2e-4}))},
        }[fault]
        return scope_of(replace(given, **changed), travel)

    emit_both(machine, tmp_path / "right")
    monkeypatch.setattr("rodgen.machines.emit._content.scope_of", wrong)
    emit_both(machine, tmp_path / "wrong")
    for folder, holds in (("right", True), ("wrong", False)):
        code = loaded(tmp_path / folder)
        monkeypatch.setitem(sys.modules, "device_np", code)
        own = loaded(tmp_path / folder, "test_device_np")
        with contextlib.nullcontext() if holds else pytest.raises(AssertionError):
            own.test_places_are_the_references()


def test_what_is_tied_to_an_error_of_the_instrument_keeps_its_value(refuses, tmp_path):
    machine = table(joints=(prismatic("X", X, travel=(0.0, 100.0)),))
    machine = (
        machine.add("scale", joint="X").add("instrument_scale").tying("X.scale.k", "2*instrument_scale.k")
    )
    machine = replace(machine, values={"instrument_scale.k": 1e-3})
    emit_both(machine, tmp_path)
    assert loaded(tmp_path).forward([50.0]) == pytest.approx([150.1, 0, 0], abs=1e-12)
    refuses(emit, replace(machine, values={}), "c", tmp_path)


# names, bytes, errors ---------------------------------------------------------------------------------------------


HOSTILE = [
    "*/ #error x /*",
    "G*\\#define cos sin\\*",
    'quote """ \\',
    "??/",
    "line\nbreak\\",
    "/*/ */",
    "%s {0} {{ x }} {% raw %}",
    "\u202eBiDi",
    "ä\u2028x",
]


def hostile_machine(names: Iterator[str]) -> Machine:
    return Machine(
        next(names), "mm", "deg", (0.0, 0.0, -1.0), 20.0,
        (revolute(next(names), Z), prismatic(next(names), X, travel=(0.0, 10.0))),
        (Target(next(names), (10.0, 0.0, 0.0)), Target(next(names), (0.0, 10.0, 0.0))), Measured("point", "machine"),
        file=next(names),
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(
    "first", [pytest.param(k, marks=pytest.mark.slow) if k % 2 else k for k in range(len(HOSTILE))]
)
def test_no_text_of_the_user_becomes_code(first, compiler, cpp_compiler, tmp_path):
    names = iter((HOSTILE * 2)[first:])
    machine = hostile_machine(names)
    for joint_name in (machine.joints[0].name, machine.joints[1].name):
        machine = machine.with_effect(machine.effect("zero_offset", joint_name, hold={"a": 0.1}))
    content = emit_both(machine, tmp_path)
    passes_in_c("device", tmp_path, compiler)
    passes_in_python("device_np", tmp_path)
    passes_in_octave(content, tmp_path)
    write_files(tmp_path, render(content, "cpp"))
    succeeds(cpp_compiler, *CPP_WARNINGS, "-fsyntax-only", tmp_path / "device_test.cpp")


@pytest.mark.thorough
@pytest.mark.parametrize("examples", [20, pytest.param(500, marks=pytest.mark.slow)])
def test_code_of_any_names_is_that_of_plain_names(examples):
    content = content_of(hostile_machine(itertools.repeat("plain")), "device")

    def code(content: Content) -> list[str]:
        c_like = [text for language in ("c", "cpp") for text in render(content, language).values()]
        sources = [code_of(text, "c") for text in c_like]
        sources += [code_of(text, "matlab") for text in render(content, "matlab").values()]
        python = replace(content, name="device_np")
        return sources + [python_code(x) for name in ("numpy", "jax") for x in render(python, name).values()]

    expected = code(content)

    @hypothesis.settings(max_examples=examples, deadline=None, database=None)
    @hypothesis.given(st.lists(ANY_NAME, min_size=6, max_size=6))
    def same(names: list[str]) -> None:
        named = hostile_machine(iter(names))
        assert code(replace(content, machine=named, scope=replace(content.scope, machine=named))) == expected

    same()


def structure(files: Mapping[str, str], names: Mapping[str, str]) -> list[Any]:
    """Return what programs read of tables and models, with other names in place of some."""

    def put(text: str) -> str:
        return re.sub(
            "|".join(map(re.escape, sorted(names, key=len, reverse=True))), lambda m: names[m[0]], text
        )

    found: list[Any] = []
    for name, text in sorted(files.items()):
        kind = name.rpartition(".")[2]
        if kind == "urdf":
            robot = ElementTree.fromstring(text)
            robot.attrib.pop("name")
            found += [(e.tag, {k: put(x) for k, x in e.attrib.items()}) for e in robot.iter()]
        elif kind == "toml":
            read = tomllib.loads(text)
            del read["name"]
            found.append([put(str(read)), text.count("\n")])
        elif kind == "csv":
            rows = list(csv.reader(text.splitlines()))
            assert not any(cell[:1] in "=@+-" and not is_number(cell) for row in rows for cell in row if cell)
            found.append([[put(cell) for cell in row] for row in rows])
        elif kind == "comp" and text.startswith("component"):
            found.append(code_of(text, "c"))
        elif kind in ("ini", "comp"):
            found.append([put(line) for line in text.splitlines() if line[0] not in ";#"])
        elif kind == "mod":
            found.append([line.split()[:2] for line in text.splitlines()[1:]])
        else:
            assert kind == "md"
    return found


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def legal(text: str) -> bool:
    try:
        return JOINT_NAME.read(text) == text
    except UnfitError:
        return False


LEGAL_NAMES = [
    st.from_regex(rf"{n}[\w+-]{{0,20}}( [\w+-]+)?", fullmatch=True).filter(legal) for n in ("slide", "ball")
]


@pytest.mark.parametrize("form", ["urdf", "dh", "iso230", "screw", "linuxcnc", "tpoint"])
@pytest.mark.parametrize("examples", [4, pytest.param(100, marks=pytest.mark.slow)])
def test_what_programs_read_of_other_forms_is_that_of_plain_names(form, examples, tmp_path):
    def machine(title: str, slide: str, target: str) -> Machine:
        if form == "tpoint":
            mount = mount_machine(ALTAZ, title, 0.6)
            return replace(mount, values={f"{n}.axis.{x}": 1e-4 for n in ("AZ", "EL") for x in "ab"}
                           | {"target.boresight.a": 1e-4, "target.boresight.b": -1e-4})  # fmt: skip
        slide = "X" if form == "linuxcnc" else slide
        made = Machine(
            title, "mm", "deg", (0.0, 0.0, -1.0), 20.0, (prismatic(slide, X, travel=(0.0, 10.0)),),
            (Target(target, (10.0, 0.0, 0.0)),), Measured("point", "machine"),
        )  # fmt: skip
        return made.add("scale", joint=slide, hold={"k": 1e-4})

    def files(made: Machine) -> dict[str, str]:
        return {path.name: path.read_text() for path in emit(made, form, tmp_path, name="device", force=True)}

    expected = structure(files(machine("plain", "slide", "ball")), {"slide": "1", "ball": "2"})

    @hypothesis.settings(max_examples=examples, deadline=None, database=None)
    @hypothesis.given(ANY_NAME, st.tuples(*LEGAL_NAMES))
    def same(title: str, names: tuple[str, str]) -> None:
        found = structure(files(machine(title, *names)), dict(zip(names, "12", strict=True)))
        assert str(found) == str(expected)

    same()


@pytest.mark.parametrize("name", ["=1+1", "../x", "a\nb", "-2", "@x", "a,b"])
def test_names_that_no_machine_file_has_are_in_no_table(refuses, name, tmp_path):
    machine = table(targets=(Target(name, (100.0, 0.0, 0.0)),))
    for form in ("urdf", "dh", "iso230", "screw", "linuxcnc", "tpoint"):
        refuses(emit, machine, form, tmp_path)
    assert os.listdir(tmp_path) == []


def table(**more: Any) -> Machine:
    machine = Machine(
        "Rotary table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (revolute("C", Z),),
        (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
    )  # fmt: skip
    return replace(machine, **more)


@pytest.mark.thorough
def test_equal_machines_give_equal_bytes(every, tmp_path):
    device = every("gantry")
    emit(
        replace(device.machine, file="elsewhere.toml"),
        "c",
        tmp_path,
        name="device",
        travel=device.case.model.travel,
    )
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (device.folder / path.name).read_bytes()
        assert b"\r" not in path.read_bytes()


def test_names_come_from_the_machine_or_the_caller(tmp_path):
    assert [p.name for p in emit(table(), "numpy", tmp_path / "a")] == [
        "rotary_table.py",
        "test_rotary_table.py",
    ]
    assert [p.name for p in emit(table(), "c", tmp_path / "b", name="t1")] == ["t1.c", "t1.h", "t1_test.c"]
    assert emit(table(name="math"), "c", tmp_path / "c")[0].name == "math_machine.c"
    assert emit(table(name="Ωß"), "numpy", tmp_path / "d")[0].name == "machine.py"


@pytest.mark.parametrize(
    "name",
    ["Big", "2d", "a-b", "", "x" * 60, "math", "numpy", "jax", "class", "namespace", "end", "../up", "a\nb"],
)
def test_bad_names_are_an_error(refuses, name, tmp_path):
    refuses(emit, table(), "c", tmp_path / "out", name=name)
    assert not (tmp_path / "out").exists()


def test_other_languages_are_an_error(refuses, tmp_path):
    refuses(emit, table(), "rust", tmp_path)


def test_nothing_is_left_of_files_that_cannot_all_be_written(refuses, tmp_path):
    """One of the two MATLAB files is in a folder of its own."""
    (tmp_path / "t1_test.m").mkdir()
    refuses(emit, table(), "matlab", tmp_path, name="t1")
    assert [path.name for path in tmp_path.iterdir()] == ["t1_test.m"]
    (tmp_path / "t1_test.m").rmdir()
    (tmp_path / "+rodgen").mkdir()
    (tmp_path / "+rodgen" / "t1.m").write_text("mine")
    refuses(emit, table(), "matlab", tmp_path, name="t1")
    assert [path.name for path in tmp_path.iterdir()] == ["+rodgen"]
    emit(table(), "matlab", tmp_path, name="t1", force=True)
    assert emit(table(), "matlab", tmp_path, name="t1") == [
        tmp_path / "+rodgen" / "t1.m",
        tmp_path / "t1_test.m",
    ]


def test_machine_without_its_numbers_is_an_error(refuses, tmp_path):
    machine = table(estimate=("C.axis",))
    refuses(emit, machine, "c", tmp_path / "out")
    refuses(emit, replace(machine, values={"C.axis.a": 0.0, "C.axis.b": np.nan}), "c", tmp_path / "out")
    slide = table(joints=(prismatic("X", X),))
    slide = slide.with_effect(slide.effect("straightness", "X", hold=dict.fromkeys(
        ("u_2", "u_3", "u_4", "v_2", "v_3", "v_4"), 0.1
    )))  # fmt: skip
    refuses(emit, slide, "c", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert emit(slide, "c", tmp_path / "out", travel=[[0, 100]])


def test_weights_at_later_joints_that_the_data_did_not_call_for_are_none(tmp_path):
    two = table(joints=(revolute("A", X), revolute("C", Z, (0, 100, 0))))
    two = two.with_effect(two.effect("gravity_windup", "A", hold={"k": 0.001, "k2": 0.0}))
    emit(two, "numpy", tmp_path, name="device_np")
    text = (tmp_path / "device_np.py").read_text()
    assert "effect0_k = " in text
    assert "effect0_k2 = " not in text
    assert "effect0_p" not in text


@pytest.mark.parametrize("sigma", [0.0, 0.002])
def test_correction_learned_from_measurements_brings_the_error_down_to_the_noise(sigma, tmp_path):
    rng = np.random.default_rng(5)
    file = turned_gantry(noise=max(sigma, 1e-6))
    file["effect"] = [effect("encoder_eccentricity", "C"), effect("squareness", "Y"), effect("scale", "X")]
    case = Case(file, data_for(file, 120, rng, runs=1, turn=3.0))
    truth = case.sizeable([key for key in case.model.keys if "axis" not in key], 3.0) | {
        "C.axis.a": 60 * ARCSEC, "C.axis.b": -40 * ARCSEC,
    }  # fmt: skip
    seen = case.simulated(truth) + sigma * rng.normal(size=(120, 3))
    readings = {f"{x} [mm]": seen[:, i] for i, x in enumerate("xyz")}
    fitted = fit(case.machine, Measurements.from_frame(case.data | readings)).machine
    emit(fitted, "numpy", tmp_path, name="device_np")
    module = loaded(tmp_path)

    fresh = Case(file, data_for(file, 200, rng, runs=1, turn=3.0))
    o, wanted = fresh.observations, fresh.simulated()
    corrected, status, _ = module.compensate(wanted, o.q, o.target)
    assert (status == module.CONVERGED).all()
    units = ("mm", "mm", "mm", "rad")
    commands = {
        f"{n} [{u}]": corrected[:, j] for j, (n, u) in enumerate(zip(fresh.joints, units, strict=True))
    }
    before = fresh.simulated(truth) - wanted
    after = fresh.changed(data=fresh.data | commands).simulated(truth) - wanted
    assert np.sqrt(np.mean(before**2)) > 0.02
    # of 360 readings with noise, 15 parameters: the error of the model is sigma * sqrt(15/360) on average
    assert np.sqrt(np.mean(after**2)) <= max(0.5 * sigma, 1e-8)


def test_redundant_arm_changes_least_to_first_order(tmp_path):
    joints = [revolute(f"J{n}", Z, (100 * n, 0, 0), travel=(-2.0 - n, 2.0)) for n in range(5)]
    device, _ = simple(tmp_path, joints, [(500, 0, 0)])
    q = np.array([0.1, 0.5, -0.4, 0.9, 0.2])
    place, slopes = device.jacobian(q)
    move = 1e-4 * np.array([1.0, -2.0, 0.0])
    corrected, status, _ = device.compensate(place + move, q)
    assert status == device.CONVERGED
    weight = np.array([4.0, 5.0, 6.0, 7.0, 8.0])
    least = weight * (np.linalg.pinv(slopes * weight) @ move)
    assert (
        np.abs(corrected - q - least).max() < 1e-3 * np.abs(least).max()
    )  # move/arm, the part of second order


def test_where_targets_are_mounted_is_not_corrected(tmp_path):
    """Balls on a table are where they were put: the commands stay, but for what the encoder gets wrong."""
    rng = np.random.default_rng(3)
    file = machine_file(
        [joint("C", "revolute", Z)], [(120, 0, 40), (0, 80, 10)], estimate=["target"], noise=1e-6
    )
    file["effect"] = [effect("backlash", "C")]
    case = Case(file, data_for(file, 60, rng, runs=1, turn=3.0))
    truth = {"C.backlash.b": 80 * ARCSEC} | {
        f"target.{name}.{x}": 0.3 + 0.2 * i for name in "pr" for i, x in enumerate("xyz")
    }
    seen = case.simulated(truth)
    readings = {f"{x} [mm]": seen[:, i] for i, x in enumerate("xyz")}
    fitted = fit(case.machine, Measurements.from_frame(case.data | readings)).machine
    emit(fitted, "numpy", tmp_path, name="device_np")
    device, o = loaded(tmp_path), case.observations
    corrected, status, distance = device.compensate(device.ideal(o.q, o.target), o.q, o.target, s=o.s)
    assert (status == device.CONVERGED).all()
    assert np.abs(corrected - (o.q + 40 * ARCSEC * o.s)).max() < 1e-9
    assert distance.max() < 1e-6
