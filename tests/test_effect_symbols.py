"""Names of TPOINT and symbols of ISO 230: which effect they are; test_import_tpoint.py holds signs and factors."""

import re

import pytest

from rodgen.cli.main import main
from rodgen.machines.effects.catalogue import definitions
from rodgen.machines.effects.symbols import symbols
from rodgen.machines.machine import Joint, Machine, Measured, Target


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


def test_an_effect_may_be_added_by_its_other_name(refuses):
    added = MOUNT.add("TF").add("ECES", joint="EL").add("EBA")
    assert [e.title for e in added.effects] == [
        "tube_flexure", "encoder_eccentricity at EL", "tilt_error_motion at A",
    ]  # fmt: skip
    refuses(MOUNT.add, "EAA")
    refuses(MOUNT.add, "ECES")


def test_the_command_says_what_a_name_is(refuses, capsys):
    assert main(["effects", "TF"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("TF of TPOINT is a of tube_flexure.\n\ntube_flexure   of the whole machine\n")
    assert "  TPOINT       TF = a\n" in out
    assert main(["effects", "HCEZ"]) != 0
    assert "no effect 'HCEZ'; expected 'HCES', perhaps" in capsys.readouterr().err
    refuses(definitions, "DCEZ")
