"""What a controller does with an entry, by its manual, brings a simulated machine nearer to where it was commanded."""

import collections
import csv
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from machine_simulator import Simulated, rotation

from rodgen.machines.imports.tpoint_model import mount_machine
from rodgen.machines.machine import Machine, Measured
from rodgen.machines.mounts import ALTAZ

MACHINE = """name = "Table"
units = { length = "mm", angle = "deg" }
[[joint]]
name = "X"
type = "prismatic"
axis = [SIGN, 0, 0]
point = [5, 10, 40]
travel = [0, 500]
[[joint]]
name = "C"
type = "revolute"
axis = [0, 0, SIGN]
point = [30, -20, 0]
[[target]]
name = "ball"
point = [130, 15, 25]
[measured]
kind = "point"
frame = "machine"
"""
EFFECTS = {
    ("X", "zero_offset"): {"a": 0.011},
    ("X", "scale"): {"k": 6e-5},
    ("X", "backlash"): {"b": 0.008},
    ("X", "periodic_drive_error"): {"a": 0.002, "b": 0.001, "P": 40},
    ("C", "zero_offset"): {"a": 0.004},
    ("C", "backlash"): {"b": 0.003},
    ("C", "encoder_eccentricity"): {"a": 0.006, "b": 0.002},
}
USERS = {
    "X": {
        "reading": ("a*log(1 + X/b)", "mm", 0.004),
        "tx": ("a*sign(q - 2.6*b)", "mm", 0.002),
        "ry": ("a*(q - 2.5*b)/b", "deg", 8 / 3600),
    },
    "C": {"tz": ("a*sin(3*q)", "mm", 0.003), "rx": ("a*abs(sin(q))", "deg", 6 / 3600)},
}
"""Formulas of a user, by joint and component: text, unit and size of a."""


def written(folder, effects, users=(), sign=1):
    """Return the file of a machine with errors, which the simulator and rodgen read."""
    text = MACHINE.replace("SIGN", str(sign))
    for (joint, name), hold in effects.items():
        values = ", ".join(f"{x} = {value}" for x, value in hold.items())
        text += f'[[effect]]\nname = "{name}"\njoint = "{joint}"\nhold = {{ {values} }}\n'
    for joint, formulas in dict(users).items():
        for component, (formula, unit, a) in formulas.items():
            more = {"b": ("mm", 100)} if "b)" in formula else {}
            units = ", ".join(f'{x} = "{of}"' for x, (of, _) in ({"a": (unit, a)} | more).items())
            values = ", ".join(f"{x} = {of}" for x, (_, of) in ({"a": (unit, a)} | more).items())
            text += (
                f'[[effect]]\nname = "own_{component}"\njoint = "{joint}"\ncomponent = "{component}"\n'
                f'formula = "{formula}"\nparameters = {{ {units} }}\nhold = {{ {values} }}\n'
            )
    path = folder / "machine.toml"
    path.write_text(text)
    return path


def bare(path):
    """Return the same machine without errors."""
    return Simulated({key: x for key, x in tomllib.loads(path.read_text()).items() if key != "effect"})


def error_of(path, joint, commanded, encoder, s):
    """Return by how much an axis is too far where its encoder reads so much, mm or degrees."""
    names = ["X", "C"]
    q, at, way = (np.zeros((len(commanded), 2)) for _ in range(3))
    q[:, names.index(joint)], at[:, names.index(joint)], way[:, names.index(joint)] = encoder, commanded, s
    other = next(name for name in names if name != joint)
    file = tomllib.loads(path.read_text())
    file["effect"] = [effect for effect in file["effect"] if effect["joint"] != other]
    real, ideal = Simulated(file).measure(q, s=way), bare(path).measure(at)
    if joint == "X":
        return (real - ideal) @ file["joint"][0]["axis"]
    (x, y), (u, v) = ((p - np.array(file["joint"][1]["point"]))[:, :2].T for p in (ideal, real))
    return np.degrees(np.arctan2(x * v - y * u, x * u + y * v)) * file["joint"][1]["axis"][2]


def sinumerik(text, joint, position, s, with_backlash=True):
    """Return where the encoder stands when the control has brought the axis to a position (function manual, K3).

    The compensation is added to the actual value, constant beyond the ends of the table. The reference point was
    approached in the positive direction; BACKLASH moves the drive further by itself after each reversal.
    """
    lines = [line.partition(";")[0] for line in text.splitlines()]
    assert lines.index("CHANDATA(1)") < lines.index("M17") == len(lines) - 1
    table = {key: float(x) for key, _, x in (line.partition("=") for line in lines) if key.startswith("$")}
    low, high, step, modulo = (
        table.pop(f"$AA_ENC_COMP_{x}[0,{joint}]") for x in ("MIN", "MAX", "STEP", "IS_MODULO")
    )
    points = round((high - low) / step) + 1
    assert int(re.search(r"MD38000 MM_ENC_COMP_MAX_POINTS\[0\] >= (\d+)", text)[1]) == points == len(table)
    values = [table[f"$AA_ENC_COMP[0,{n},{joint}]"] for n in range(points)]
    within = low + (position - low) % (high - low) if modulo else position
    backlash = float(re.search(r"MD32450 BACKLASH\[0\] = (\S+) (?:mm|deg)", text)[1])
    correction = np.interp(within, low + step * np.arange(points), values)
    return position - correction + s * (s < 0) * backlash * with_backlash


def linuxcnc(text, position, s):
    """Return where the motor is sent for a joint that is commanded to a position (usrmotintf.cc, control.c)."""
    entries = []
    for line in text.splitlines():
        try:
            nominal, forward, reverse = (float(x) for x in line.split()[:3])
        except ValueError:
            break
        entries.append((nominal, nominal - forward, nominal - reverse))
    entries = np.array(entries)
    assert len(entries) <= 256  # EMCMOT_COMP_SIZE
    assert (np.diff(entries[:, 0]) > 0).all()
    return position + np.interp(position, entries[:, 0], entries[:, 1 if s > 0 else 2])


@pytest.mark.parametrize("sign", [1, -1], ids=["along", "against"])
@pytest.mark.parametrize("joint", ["X", "C"])
def test_sinumerik_and_linuxcnc_take_out_errors_of_position_and_lost_motion(tmp_path, joint, sign):
    path = written(tmp_path, EFFECTS, sign=sign)
    Machine.load(path).emit("screw", tmp_path)
    eec = (tmp_path / f"table_{joint}_eec.ini").read_text()
    comp = (tmp_path / f"table_{joint}.comp").read_text()
    lost, zero = EFFECTS[joint, "backlash"]["b"], EFFECTS[joint, "zero_offset"]["a"]
    wanted = np.linspace(3, 490, 80) if joint == "X" else np.linspace(-170, 530, 80)
    before, by_table, by_both, by_comp = [], [], [], []
    for s in (1, -1):
        before.append(error_of(path, joint, wanted, wanted, s))
        by_table.append(error_of(path, joint, wanted, sinumerik(eec, joint, wanted, s, False), s))
        by_both.append(error_of(path, joint, wanted, sinumerik(eec, joint, wanted, s), s))
        # LinuxCNC's positions do not repeat after a turn
        within = wanted if joint == "X" else wanted % 360
        by_comp.append(error_of(path, joint, within, linuxcnc(comp, within, s), s))
    assert np.ptp(before) > 3 * lost
    tolerance = 0.02 * np.ptp(before)
    # each leaves the zero, which is the reference point's
    np.testing.assert_allclose(np.mean(by_table, axis=0) - zero, 0, atol=tolerance)
    np.testing.assert_allclose(by_comp, zero, atol=tolerance)
    # the lost motion is gone, and the reference was approached from its one side
    np.testing.assert_allclose(by_both[0], by_both[1], atol=1e-3 * lost)
    np.testing.assert_allclose(by_both, zero - lost / 2, atol=tolerance)
    assert f"MD32450 BACKLASH[0] = {lost:g} {'mm' if joint == 'X' else 'deg'}" in eec
    for text in (eec, comp):
        assert f"Not in it: the zero of {joint}, {zero:g} " in text
    assert f"{joint}, {zero:g} " in (tmp_path / "table_tables.md").read_text()


def test_a_table_for_linuxcnc_has_no_more_lines_than_it_reads(tmp_path):
    fine = {("X", "periodic_drive_error"): {"a": 0.004, "b": 0.0, "P": 6}, ("X", "backlash"): {"b": 0.002}}
    Machine.load(written(tmp_path, fine)).emit("screw", tmp_path)
    at = np.linspace(10, 480, 50)
    assert linuxcnc((tmp_path / "table_X.comp").read_text(), at, 1).shape == at.shape
    assert (tmp_path / "table_X_eec.ini").read_text().count("$AA_ENC_COMP[") > 256


def columns(path):
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("sign", [1, -1], ids=["along", "against"])
def test_error_motions_and_location_errors_take_out_what_they_state_once(tmp_path, sign):
    """Subtracted from a place of the real machine they leave the nominal one, a user's formulas among them."""
    location = {
        ("C", "axis_tilt"): {"a": 0.006, "b": -0.004},
        ("C", "axis_offset"): {"a": 0.02, "b": -0.03},
        ("X", "squareness"): {"a": 0.005, "b": 0.003},
    }
    path = written(tmp_path, EFFECTS | location, USERS, sign)
    Machine.load(path).emit("iso230", tmp_path)
    page = (tmp_path / "table_errors.md").read_text()
    assert "Not in it" not in page
    a = {(joint, x): size for joint in USERS for x, (_, _, size) in USERS[joint].items()}
    formulas = {
        "X.reading": lambda of: a["X", "reading"] * np.log(1 + of["q"] / 100),
        "X.tx": lambda of: a["X", "tx"] * np.sign(of["q"] - 260),
        "X.ry": lambda of: a["X", "ry"] * (of["q"] - 250) / 100,
        "C.tz": lambda of: a["C", "tz"] * np.sin(3 * of["q"]),
        "C.rx": lambda of: a["C", "rx"] * np.abs(np.sin(of["q"])),
    }
    real, ideal = Simulated(path, formulas), bare(path)
    with (tmp_path / "table_location.csv").open() as file:
        constant = collections.defaultdict(float)
        constant |= {f"E{row['symbol']} [{row['unit']}]": float(row["value"]) for row in csv.DictReader(file)}
    random = np.random.default_rng(4)
    q = np.stack([random.uniform(5, 250, 60), random.uniform(5, 355, 60)], -1)
    slide, table = tomllib.loads(path.read_text())["joint"]
    along = q[:, :1] * np.array(slide["axis"])
    turned = rotation(np.radians(q[:, 1:]) * np.array(table["axis"]))

    def errors(of, joint):
        """Return displacements, mm, and turns, rad, by their symbols."""
        return np.stack([of[f"{x}{joint} [um]"] / 1e3 for x in ("EX", "EY", "EZ")], -1), np.stack(
            [np.radians(of[f"{x}{joint} [arcsec]"] / 3600) for x in ("EA", "EB", "EC")], -1
        )

    def motions(joint, at, way):
        motion = columns(tmp_path / f"table_{joint}.csv")
        position = next(x for name, x in motion.items() if name.startswith(f"{joint} ["))
        return errors({k.replace(way, ""): np.interp(at, position, x) for k, x in motion.items()}, joint)

    x_at, x_turned = errors(constant, "0X")
    c_at, c_turned = errors(constant, "0C")
    for way, s in (("+", 1.0), ("-", -1.0)):
        seen, r = real.measure(q, s=np.full_like(q, s)), ideal.measure(q)
        shift, turn = motions("X", q[:, 0], way)
        # the direction of a slide is off, and not what it carries
        corrected = seen - shift - np.cross(turn, r - slide["point"]) - x_at - np.cross(x_turned, along)
        shift, turn = motions("C", q[:, 1], way)
        arm = r - (table["point"] + along)  # C stands on X
        axis = np.array(table["axis"])
        # C turns about another line, and what it carries is in place at its zero
        shift = shift + c_at - turned @ c_at
        turn = turn + c_turned - turned @ c_turned + (c_turned @ axis) * axis
        corrected -= shift + np.cross(turn, arm)
        before, after = (1000 * np.linalg.norm(x - r, axis=1) for x in (seen, corrected))
        assert before.max() > 40
        assert after.max() < 0.05 * before.max()


def test_a_formula_without_a_value_on_the_travel_is_refused(refuses, tmp_path):
    path = written(tmp_path, {}, {"X": {"reading": ("a*log(X/b)", "mm", 0.004)}})
    for form in ("iso230", "screw"):
        refuses(Machine.load(path).emit, form, tmp_path / form)
        assert not (tmp_path / form).exists()


def test_a_control_with_the_terms_of_tpoint_points_at_the_stars(tmp_path):
    """It takes the sum of the terms off azimuth and elevation of a star, with the signs of TPOINT's manual."""
    arcsec = 1 / 3600  # the file has degrees
    hidden = {
        ("AZ", "zero_offset"): {"a": 50 * arcsec},
        ("EL", "zero_offset"): {"a": -40 * arcsec},
        ("AZ", "axis_tilt"): {"a": 30 * arcsec, "b": -20 * arcsec},
        ("EL", "axis_tilt"): {"a": 0, "b": 25 * arcsec},
    }
    machine = replace(
        mount_machine(ALTAZ, "Telescope", 0.6), measured=Measured("direction", "machine"), estimate=()
    )
    for (joint, name), hold in hidden.items():
        machine = machine.add(name, joint=joint, hold=hold)
    machine = machine.add("tube_flexure", hold={"a": 12 * arcsec})
    machine.save(tmp_path / "machine.toml")
    (path,) = machine.emit("tpoint", tmp_path)
    lines = (line.split() for line in path.read_text().splitlines()[2:])
    terms = collections.defaultdict(float, {words[0]: float(words[1]) for words in lines if len(words) > 1})
    assert set(terms) <= {"IA", "IE", "NPAE", "CA", "AN", "AW", "TF"}
    random = np.random.default_rng(3)
    A, E = random.uniform(-3, 3, 40), random.uniform(0.3, 1.2, 40)

    def off(a, e):
        seen = Simulated(tmp_path / "machine.toml").measure(np.degrees(np.stack([a, e], -1)))
        star = np.stack([np.sin(A) * np.cos(E), np.cos(A) * np.cos(E), np.sin(E)], -1)
        return np.linalg.norm(np.cross(seen, star), axis=1) * 206265

    sin, cos, tan = np.sin, np.cos, np.tan
    right = -terms["IA"] - terms["CA"] / cos(E) - terms["NPAE"] * tan(E)
    right += -terms["AN"] * sin(A) * tan(E) - terms["AW"] * cos(A) * tan(E)
    up = terms["IE"] - terms["AN"] * cos(A) + terms["AW"] * sin(A) - terms["TF"] * cos(E)
    assert off(A, E).max() > 40
    assert off(A - right / 206265, E - up / 206265).max() < 0.1
