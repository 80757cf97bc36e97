"""TPOINT's terms and ISO 230's symbols: which effect they are, with sign and factor.

The effect is simulated, and TPOINT's own formula, as in its source, must describe what it moves; its purely geometrical
terms may change with it, as those of the axes after a tilted one do.
"""

import re

import numpy as np
import pytest
from machine_simulator import Simulated

from rodgen.cli.main import main
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.effects.catalogue import TERMS, definitions
from rodgen.machines.effects.symbols import symbols
from rodgen.machines.machine import Joint, Machine, Measured, Target

LATITUDE = np.radians(32.0)
SMALL = 1e-6
RNG = np.random.default_rng(3)


def simulated(first, second, target, gravity):
    return {
        "units": {"length": "mm", "angle": "rad"},
        "environment": {"gravity": gravity},
        "joint": [
            {"name": name, "type": "revolute", "axis": axis}
            for name, axis in (("first", first), ("second", second))
        ],
        "target": [{"name": "p", "point": target}],
        "measured": {"kind": "direction"},
    }


ALTAZ = simulated([0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, -1])
EQUATORIAL = simulated([0, 0, -1], [0, -1, 0], [1, 0, 0], [-np.cos(LATITUDE), 0, -np.sin(LATITUDE)])


def altaz(az, el):
    """To the left and up on the sky, of azimuth from south (0) through east, as TPOINT has it."""
    A = np.pi - az
    cos, sin, one, none = np.cos, np.sin, np.ones_like(az), np.zeros_like(az)
    return {
        "IA": (cos(el), none), "IE": (none, one), "CA": (one, none), "NPAE": (sin(el), none),
        "AN": (sin(A) * sin(el), cos(A)), "AW": (-cos(A) * sin(el), sin(A)),
        "ACES": (sin(A) * cos(el), none), "ACEC": (cos(A) * cos(el), none),
        "ECES": (none, sin(el)), "ECEC": (none, cos(el)),
        "NRX": (cos(el), sin(el)), "NRY": (-sin(el), cos(el)),
        "TF": (none, -cos(el)), "TX": (none, -1 / np.tan(el)),
    }  # fmt: skip


def equatorial(h, d):
    """To the west and to the north on the sky."""
    cos, sin, one, none = np.cos, np.sin, np.ones_like(h), np.zeros_like(h)
    cl, sl = np.cos(LATITUDE), np.sin(LATITUDE)
    return {
        "IH": (cos(d), none), "ID": (none, one), "CH": (one, none), "NP": (sin(d), none),
        "ME": (sin(h) * sin(d), cos(h)), "MA": (-cos(h) * sin(d), sin(h)),
        "HCES": (sin(h) * cos(d), none), "HCEC": (cos(h) * cos(d), none),
        "DCES": (none, sin(d)), "DCEC": (none, cos(d)),
        "HGES": (sin(40 * h) * cos(d), none), "HGEC": (cos(40 * h) * cos(d), none),
        "DGES": (none, sin(40 * d)), "DGEC": (none, cos(40 * d)),
        "FO": (none, cos(h)), "DAF": (-(cl * cos(h) * cos(d) + sl * sin(d)), none),
        "TF": (cl * sin(h), cl * cos(h) * sin(d) - sl * cos(d)),
    }  # fmt: skip


GEOMETRY = {
    "altaz": ("IA", "IE", "CA", "NPAE", "AN", "AW"),
    "equatorial": ("IH", "ID", "CH", "NP", "ME", "MA"),
}


def test_every_term_is_of_one_mount_or_both():
    q = np.ones((2, 2))
    assert set(TERMS) == set(altaz(*q)) | set(equatorial(*q))


@pytest.mark.parametrize("mount", GEOMETRY)
@pytest.mark.parametrize("term", TERMS)
def test_a_term_of_tpoint_moves_the_line_of_sight_as_its_effect_does(term, mount):
    file, formulas = (ALTAZ, altaz) if mount == "altaz" else (EQUATORIAL, equatorial)
    q = np.stack([RNG.uniform(-1, 1, 60), RNG.uniform(0.3, 1.2, 60)], -1)
    if term not in formulas(*q.T):
        return
    relation = re.fullmatch(
        r"(-?)([ab])( cos\(latitude\))?( \(P = 9 deg\))?( at the .*)?", TERMS[term].tpoint[term]
    )
    value = SMALL * (-1 if relation[1] else 1) / (np.cos(LATITUDE) if relation[3] else 1)
    (place,) = TERMS[term].at
    if place == "revolute":
        place = "first" if relation[5].split()[2] in {"azimuth", "polar"} else "second"
    key = ".".join(filter(None, [{"target": "p", "machine": ""}.get(place, place), TERMS[term].name]))
    effects = {f"{key}.{relation[2]}": value} | ({f"{key}.P": np.radians(9)} if relation[4] else {})
    plain = Simulated(file).measure(q)
    moved = (Simulated(file, effects).measure(q) - plain) / SMALL
    zenith = [0, 0, 1]  # of the coordinates: the pole, of an equatorial mount
    west = np.cross(zenith, plain) * (1 if mount == "altaz" else -1)
    west /= np.linalg.norm(west, axis=1, keepdims=True)
    north = np.array(zenith) - plain * plain[:, 2:]
    north /= np.linalg.norm(north, axis=1, keepdims=True)
    on_sky = np.concatenate([np.sum(moved * west, axis=1), np.sum(moved * north, axis=1)])
    known = {name: np.concatenate(columns) for name, columns in formulas(*q.T).items()}
    basis = [term, *(name for name in GEOMETRY[mount] if name != term)]
    size, *_ = np.linalg.lstsq(np.stack([known[name] for name in basis], -1), on_sky, rcond=None)
    assert size[0] == pytest.approx(1, abs=1e-4)
    assert np.stack([known[name] for name in basis], -1) @ size == pytest.approx(on_sky, abs=1e-4)


@pytest.mark.parametrize(
    ("symbol", "expected"),
    {
        "EXX": [("scale", "k"), ("periodic_drive_error", "a, b"), ("backlash", "b")],
        "EYX": [("straightness", "u_2, u_3, u_4")],
        "EXY": [("straightness", "v_2, v_3, v_4")],
        "EBZ": [("angular_error_motion", "y_1, y_2, y_3")],
        "EAA": [("scale", "k"), ("encoder_eccentricity", "a, b"), ("encoder_ellipticity", "a, b"),
                ("periodic_drive_error", "a, b"), ("backlash", "b")],
        "EYA": [("radial_error_motion", "u_c1, u_s1, u_c2, u_s2")],
        "EYC": [("radial_error_motion", "v_c1, v_s1, v_c2, v_s2")],
        "EZC": [("axial_error_motion", "c1, s1, c2, s2")],
        "EBC": [("tilt_error_motion", "v_c1, v_s1, v_c2, v_s2")],
        "C0Y": [("squareness", "a")],
        "EB0Z": [("squareness", "b")],
        "A0C": [("axis_tilt", "a")],
        "EY0C": [("axis_offset", "b")],
        "EC0C": [("zero_offset", "a")],
        "EX0X": [("zero_offset", "a")],
        "EX0Y": [],
        "XX": [],
        "tube_flexure": [],
    }.items(),
)  # fmt: skip
def test_a_symbol_of_iso_230_is_a_parameter_of_the_axis_it_names(symbol, expected):
    found = symbols(symbol)
    assert [(s.definition.name, re.split(r" \(| at ", s.relation)[0]) for s in found] == expected
    for s in found:
        assert s.joint == symbol[-1]
        assert s.definition in definitions(
            s.definition.name, "prismatic" if symbol[-1] in "XYZ" else "revolute"
        )


MOUNT = Machine(
    "Mount", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
    (Joint("A", "revolute", (0.0, 0.0, -1.0)), Joint("EL", "revolute", (1.0, 0.0, 0.0))),
    (Target("p", (0.0, 1.0, 0.0)),), Measured("direction", "machine"),
)  # fmt: skip


def test_an_effect_may_be_added_by_its_other_name():
    added = MOUNT.add("TF").add("ECES", joint="EL").add("EBA")
    assert [e.title for e in added.effects] == [
        "tube_flexure", "encoder_eccentricity at EL", "tilt_error_motion at A",
    ]  # fmt: skip
    with pytest.raises(InputFileError, match="'EAA', which is several effects; expected 'scale', "):
        MOUNT.add("EAA")
    with pytest.raises(InputFileError, match="ECES: missing; expected a revolute joint: 'A' or 'EL'"):
        MOUNT.add("ECES")


def test_the_command_says_what_a_name_is(capsys):
    assert main(["effects", "TF"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("TF of TPOINT is a of tube_flexure.\n\ntube_flexure   of the whole machine\n")
    assert "  TPOINT       TF = a\n" in out
    assert main(["effects", "HCEZ"]) != 0
    assert "no effect 'HCEZ'; expected 'HCES', perhaps" in capsys.readouterr().err
    with pytest.raises(RodgenError, match="'DCES', perhaps"):
        definitions("DCEZ")
