"""The kinematics component for LinuxCNC: built with its headers or without, and run in its simulator."""

import contextlib
import ctypes
import fcntl
import itertools
import os
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_simulator import Simulated, arcsec

from rodgen.calibration.simulate import simulate
from rodgen.cli import main as cli
from rodgen.machines.imports.tpoint_model import mount_machine
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.mounts import ALTAZ

MODULES = Path("/usr/lib/linuxcnc/modules")
"""Where LinuxCNC takes kinematics from, and from nowhere else."""
RUNNING = Path("/tmp/linuxcnc.lock")
"""Is there while LinuxCNC runs; it runs once on a machine."""
NOBODY = "65534"


HEADERS = {
    "kinematics.h": """
typedef struct { double x, y, z; } PmCartesian;
typedef struct { PmCartesian tran; double a, b, c, u, v, w; } EmcPose;
typedef unsigned long KINEMATICS_FORWARD_FLAGS, KINEMATICS_INVERSE_FLAGS;
typedef enum { KINEMATICS_IDENTITY = 1, KINEMATICS_BOTH = 4 } KINEMATICS_TYPE;
#define KINS_NOT_SWITCHABLE
#define EXPORT_SYMBOL(x)
#define FUNCTION(x) void x(void)
KINEMATICS_TYPE kinematicsType();
""",
    "rtapi_math.h": "#include <math.h>\n",
}
"""What the component needs of LinuxCNC's headers, which are not here where LinuxCNC is not."""


class Pose(ctypes.Structure):
    _fields_ = tuple((x, ctypes.c_double) for x in ("x", "y", "z", "a", "b", "c", "u", "v", "w"))


FORMS = ("u_2", "u_3", "u_4", "v_2", "v_3", "v_4")


def five_axes():
    """Return a machine whose joints follow each other in another order than LinuxCNC's axes."""
    travel = (-600, 600)
    slides = {x: Joint(x, "prismatic", tuple(np.eye(3)[k]), travel=travel) for k, x in enumerate("XYZ")}
    machine = Machine(
        "Gantry", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
        (
            slides["Z"], slides["Y"], slides["X"],
            Joint("C", "revolute", (0.0, 0.0, 1.0), travel=(-7.0, 7.0)),
            Joint("A", "revolute", (1.0, 0.0, 0.0), (0.0, 0.0, 20.0), travel=(-2.0, 2.0)),
        ),
        (Target("tool", (60.0, 10.0, 40.0)),), Measured("point", "machine"),
    )  # fmt: skip
    for name, place, hold in (
        ("scale", "X", {"k": 6e-5}),
        ("squareness", "Y", {"a": 0.01, "b": -0.02}),
        ("encoder_eccentricity", "C", {"a": 0.005, "b": 0.002}),
        ("axis_tilt", "C", {"a": 0.01, "b": 0.01}),
        ("zero_offset", "A", {"a": 0.01}),
        ("straightness", "Z", dict(zip(FORMS, (0.01, 0.004, 0, 0.003, 0, 0), strict=True))),
    ):
        machine = machine.add(machine.effect(name, place, hold=hold))
    return machine


def places(machine, design):
    """Return places in mm."""
    made = simulate(machine, design, noise=0.0, seed=1).columns
    return np.stack([made[f"{x} [mm]"] for x in "xyz"], axis=1)


def path_through(library, machine):
    """Return the errors of a commanded path, (n,), on the machine, before and after the kinematics correct it."""
    t = np.linspace(0, 1, 60)
    way = [400 * np.cos(6 * t), 300 * np.sin(9 * t), 500 * t - 250, 50 * np.cos(5 * t), 300 * t - 100]
    q = np.column_stack(way)  # X, Y, Z, A, C; mm, deg
    joints = np.zeros((len(q), 16))
    for row, found in zip(q, joints, strict=True):
        pose = Pose(*row[:3], a=row[3], c=row[4])
        address = found.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        assert library.kinematicsInverse(ctypes.byref(pose), address, None, None) == 0
        back = Pose()
        assert library.kinematicsForward(address, ctypes.byref(back), None, None) == 0
        np.testing.assert_allclose([back.x, back.y, back.z, back.a, back.c], row, atol=1e-9)

    def design(q):
        return {f"{x} [{'deg' if x in 'AC' else 'mm'}]": q[:, k] for k, x in enumerate("XYZAC")}

    wanted = places(replace(machine, effects=()), design(q))
    return [np.linalg.norm(places(machine, design(at)) - wanted, axis=1) for at in (q, joints[:, :5])]


@pytest.mark.skipif(
    not shutil.which("halcompile"), reason="no halcompile: linuxcnc-uspace-dev is not installed"
)
def test_halcompile_builds_the_kinematics(tmp_path):
    (path,) = five_axes().emit("linuxcnc", tmp_path)
    subprocess.run(["halcompile", "--compile", path.name], cwd=tmp_path, check=True)
    _, after = path_through(ctypes.CDLL(str(tmp_path / "gantrykins.so"), mode=os.RTLD_LAZY), five_axes())
    assert after.max() < 1e-8


# the simulator ----------------------------------------------------------------------------------------------

HIDDEN = {
    "C.axis.a": arcsec(15), "C.axis.b": arcsec(25), "C.point.a": 0.015, "C.point.b": -0.03,
    "A.axis.a": arcsec(20), "A.axis.b": arcsec(-30), "A.point.a": 0.02,
    "C.encoder_eccentricity.a": arcsec(15), "C.encoder_eccentricity.b": arcsec(-8),
    "X.scale.k": 6e-5, "Y.squareness.a": arcsec(-20), "Y.squareness.b": arcsec(12), "Z.straightness.u_2": 0.01,
}  # fmt: skip
CORNERS = np.array(
    [[0, 0, 0, 0, 0], [100, 50, 0, 30, 60], [-80, -60, 70, -20, -90], [20, 90, -50, 45, 10]], float
)
"""Of the commanded path: X, Y and Z in millimetres, A and C in degrees."""
LETTERS = "XYZAC"
LIMITS = "MIN_LIMIT = -1000\nMAX_LIMIT = 1000\nMAX_VELOCITY = 2000\nMAX_ACCELERATION = 20000\n"


def configured(folder, kinematics, tables):
    """Write a configuration of LinuxCNC without hardware, which samples motors and axes in each period."""
    joints = "".join(
        f"[AXIS_{letter}]\n{LIMITS}[JOINT_{n}]\nTYPE = {'ANGULAR' if letter in 'AC' else 'LINEAR'}\n{LIMITS}"
        + (f"COMP_FILE = {tables[letter]}\nCOMP_FILE_TYPE = 0\n" if letter in tables else "")
        + "FERROR = 10\nMIN_FERROR = 10\nHOME_SEARCH_VEL = 0\nHOME_SEQUENCE = 0\n"
        for n, letter in enumerate(LETTERS)
    )
    (folder / "path.ini").write_text(f"""[EMC]
VERSION = 1.1
[DISPLAY]
DISPLAY = ./display.py
[RS274NGC]
PARAMETER_FILE = path.var
[KINS]
KINEMATICS = {kinematics}
JOINTS = {len(LETTERS)}
[HAL]
HALFILE = path.hal
[TRAJ]
COORDINATES = {LETTERS}
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
MAX_LINEAR_VELOCITY = 2000
MAX_ANGULAR_VELOCITY = 2000
[EMCMOT]
EMCMOT = motmod
SERVO_PERIOD = 1000000
[TASK]
TASK = milltask
CYCLE_TIME = 0.01
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = path.tbl
{joints}""")
    nets = "".join(
        f"net joint{n} joint.{n}.motor-pos-cmd => joint.{n}.motor-pos-fb sampler.0.pin.{n}\n"
        f"net axis{n} axis.{letter.lower()}.pos-cmd => sampler.0.pin.{n + len(LETTERS)}\n"
        for n, letter in enumerate(LETTERS)
    )
    (folder / "path.hal").write_text(f"""loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt sampler depth=20000 cfg={"f" * 2 * len(LETTERS)}
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf sampler.0 servo-thread
net on iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
{nets}""")
    moves = [" ".join(f"{x}{v:g}" for x, v in zip(LETTERS, corner, strict=True)) for corner in CORNERS]
    program = [
        "G21 G90 G61",
        f"G0 {moves[0]}",
        *(f"G1 F100000 {move}" for move in moves[1:]),
        "G4 P0.05",
        "M2",
    ]
    (folder / "path.ngc").write_text("\n".join(program) + "\n")
    (folder / "path.tbl").write_text("")
    (folder / "path.var").write_text("")
    shutil.copy(Path(__file__).with_name("linuxcnc_driver.py"), folder / "display.py")


def commanded(folder, kinematics, tables=()):
    """Return the motors (n, 5) and the axes (n, 5) on the path, as LinuxCNC commands them."""
    configured(folder, kinematics, dict(tables))
    # as root it takes the user who loads modules from here; its logs and its socket go to the home
    settings = {**os.environ, "HOME": str(folder), "RTAPI_UID": str(os.getuid() or NOBODY)}
    settings.pop("DISPLAY", None)
    call = ["linuxcnc", "-r", "path.ini"]
    with subprocess.Popen(
        call, cwd=folder, env=settings, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True,
    ) as run:  # fmt: skip
        try:
            said, _ = run.communicate(timeout=120)
        except subprocess.TimeoutExpired:
            run.terminate()  # which ends its parts, too
            said, _ = run.communicate(timeout=60)
    assert "rodgen:" not in said, said
    assert (folder / "path.txt").exists(), said
    rows = np.loadtxt(folder / "path.txt")
    # the splines of the joints come three periods after the axes
    start = np.argmax(np.abs(rows[:, 5:] - CORNERS[0]).max(axis=1) < 1e-6) + 3
    return np.hsplit(rows[start:], 2)


def off_the_path(places, line):
    """Return the distance of each place (n, 3) from a line through points (m, 3)."""
    ahead = np.diff(line, axis=0)
    along = np.einsum("nmk,mk->nm", places[:, None] - line[:-1], ahead) / np.sum(ahead**2, axis=1)
    nearest = line[:-1] + np.clip(along, 0, 1)[..., None] * ahead
    return np.linalg.norm(places[:, None] - nearest, axis=2).min(axis=1)


@pytest.fixture
def place_for_linuxcnc():
    """Return a folder for what runs in it, which is run by one test at a time."""
    if not shutil.which("linuxcnc") or not shutil.which("halcompile"):
        pytest.skip("linuxcnc-uspace and linuxcnc-uspace-dev are not installed")
    if not os.access(MODULES, os.W_OK):
        pytest.skip(
            f"{MODULES}, where halcompile installs kinematics, cannot be written: run this test as root"
        )
    with contextlib.ExitStack() as stack:
        lock = stack.enter_context(open(Path(tempfile.gettempdir()) / "rodgen-linuxcnc.lock", "w"))
        fcntl.flock(lock, fcntl.LOCK_EX)
        if RUNNING.exists():
            pytest.skip(f"LinuxCNC is running: {RUNNING} exists")
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(dir="/tmp"))
        )  # a short path, for a socket
        folder.chmod(0o777)  # it gives up being root
        yield folder


@pytest.mark.thorough
def test_linuxcnc_brings_the_tool_of_a_machine_with_errors_where_it_is_commanded(place_for_linuxcnc):
    """From the file of a five-axis machine and its readings to a path in the simulator; the truth is NumPy's."""
    folder = place_for_linuxcnc
    nominal, model, data = (folder / name for name in ("nominal.toml", "model.toml", "data.csv"))
    assert cli.main(["new", "table-table", "-o", str(nominal)]) == 0
    effects = {"encoder_eccentricity": "C", "scale": "X", "squareness": "Y", "straightness": "Z"}
    text = nominal.read_text().replace("Machine tool w C A b X Y Z t", "Simulated by rodgen")
    text += "".join(f'[[effect]]\nname = "{name}"\njoint = "{joint}"\n' for name, joint in effects.items())
    model.write_text(text)
    real, ideal = Simulated(nominal, HIDDEN), Simulated(nominal)
    in_file = [LETTERS.index(name) for name in real.joint_names]
    random = np.random.default_rng(3)
    q = random.uniform(-1, 1, (150, 5)) * [180, 60, 200, 200, 150]
    table = np.hstack([q, real.measure(q) + random.normal(0, 0.001, (150, 3))])
    header = "C [deg],A [deg],X [mm],Y [mm],Z [mm],x [mm],y [mm],z [mm]"
    np.savetxt(data, table, "%.6f", ",", header=header, comments="")
    assert cli.main(["emit", str(model), str(data), "--lang", "linuxcnc", "-o", str(folder)]) == 0
    name = "simulated_by_rodgenkins"
    subprocess.run(
        ["halcompile", "--install", f"{name}.comp"], cwd=folder, check=True, stdout=subprocess.DEVNULL
    )
    try:
        corrected, _ = commanded(folder, name)
    finally:
        (MODULES / f"{name}.so").unlink()
    plain, axes = commanded(folder, f"trivkins coordinates={LETTERS} kinstype=BOTH")
    np.testing.assert_allclose(plain[-1], axes[-1], atol=1e-6)
    steps = np.linspace(0, 1, 1000, endpoint=False)[:, None]
    line = np.concatenate([a + (b - a) * steps for a, b in itertools.pairwise(CORNERS)])
    line = ideal.measure(np.vstack([line, CORNERS[-1:]])[:, in_file])
    before, after = (
        1000 * off_the_path(real.measure(joints[:, in_file]), line) for joints in (plain[::4], corrected[::4])
    )
    end = 1000 * np.linalg.norm(real.measure(corrected[-1:, in_file])[0] - line[-1])
    assert min(len(before), len(after)) > 100
    assert before.max() > 40  # um
    # 450 readings with a noise of 1 um leave 0.2 um of 22 parameters in their mean, and some times this at an end
    assert after.max() < 1
    assert end < 1


@pytest.mark.thorough
def test_linuxcnc_takes_errors_of_position_out_with_an_emitted_table(place_for_linuxcnc):
    """X ends its way upwards, Z downwards: each at rest where it was commanded, lost motion included."""
    folder = place_for_linuxcnc
    machine = five_axes()
    for name, place, hold in (
        ("backlash", "X", {"b": 0.02}),
        ("scale", "Z", {"k": -9e-5}),
        ("backlash", "Z", {"b": 0.03}),
    ):
        machine = machine.add(machine.effect(name, place, hold=hold))
    machine.emit("screw", folder)
    tables = {x: f"gantry_{x}.comp" for x in "XZ"}
    motors, axes = commanded(folder, f"trivkins coordinates={LETTERS} kinstype=BOTH", tables)
    x, z = motors[-1, [0, 2]]
    np.testing.assert_allclose([x * (1 + 6e-5) - 0.01, z * (1 - 9e-5) + 0.015], axes[-1, [0, 2]], atol=1e-6)
    assert np.abs(motors[-1] - axes[-1])[[0, 2]].min() > 0.008


def test_a_machine_that_linuxcnc_has_no_axes_for_is_refused(refuses, tmp_path):
    machine = five_axes()
    joints = (replace(machine.joints[0], name="A1"), *machine.joints[1:])
    refuses(replace(machine, joints=joints, effects=()).emit, "linuxcnc", tmp_path)
    refuses(replace(mount_machine(ALTAZ, "Telescope", 0.6), estimate=()).emit, "linuxcnc", tmp_path)
