"""The catalogue of effects: its formulas against the derivation `effects`, its units against those written here."""

import re

import pytest
import sympy as sp
from lazy import LazyDerivation

from rodgen.cli.main import main
from rodgen.data.units import ANGLE, FORCE, LENGTH, ONE, TEMPERATURE, TIME, parse_unit
from rodgen.machines.effects.catalogue import CATALOGUE, as_table, definitions
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import component_dimension
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.effects.symbols import symbols
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.measured import DIRECTION, DISTANCE, MEASURANDS, POINT
from rodgen.symbolic import explicit

MM, AS = "mm", "arcsec"
effects = LazyDerivation("effects")


def in_units(**units):
    """Parameters by unit: names in one text."""
    return {name: unit for unit, names in units.items() for name in names.split()}


SIDES = "u_c1 u_s1 u_c2 u_s2 v_c1 v_s1 v_c2 v_s2"

# where, name: component, units of the parameters (file in mm, points)
EXPECTED = {
    ("revolute", "axis_tilt"): ("axis", {"a": AS, "b": AS}),
    ("revolute", "axis_offset"): ("point", {"a": MM, "b": MM}),
    ("revolute", "zero_offset"): ("reading", {"a": AS}),
    ("revolute", "scale"): ("reading", {"k": "1"}),
    ("revolute", "encoder_eccentricity"): ("reading", {"a": AS, "b": AS}),
    ("revolute", "encoder_ellipticity"): ("reading", {"a": AS, "b": AS}),
    ("revolute", "encoder_harmonics"): ("reading", in_units(arcsec="a4 b4 a8 b8")),
    ("revolute", "periodic_drive_error"): ("reading", {"a": AS, "b": AS, "P": "deg"}),
    ("revolute", "radial_error_motion"): ("translation", in_units(mm=SIDES)),
    ("revolute", "axial_error_motion"): ("translation", in_units(mm="c1 s1 c2 s2")),
    ("revolute", "tilt_error_motion"): ("rotation", in_units(arcsec=SIDES)),
    ("revolute", "backlash"): ("reading", {"b": AS}),
    ("revolute", "backlash_gradient"): ("reading", {"k": "1"}),
    ("revolute", "servo_lag"): ("reading", {"tau": "s"}),
    ("revolute", "acceleration_lag"): ("reading", {"k": "s**2"}),
    ("revolute", "gravity_windup"): ("reading", {"k": "arcsec/mm", "k2": "arcsec/mm"}),
    ("revolute", "load_windup"): ("reading", {"k": "arcsec/N/mm"}),
    ("revolute", "lateral_windup"): ("rotation", {"a": "arcsec/mm"}),
    ("revolute", "thermal_offset"): ("reading", {"k": "arcsec/K"}),
    ("revolute", "thermal_axis_drift"): ("translation", dict.fromkeys("xyz", "mm/K")),
    ("prismatic", "squareness"): ("axis", {"a": AS, "b": AS}),
    ("prismatic", "zero_offset"): ("reading", {"a": MM}),
    ("prismatic", "scale"): ("reading", {"k": "1"}),
    ("prismatic", "backlash"): ("reading", {"b": MM}),
    ("prismatic", "backlash_gradient"): ("reading", {"k": "1"}),
    ("prismatic", "servo_lag"): ("reading", {"tau": "s"}),
    ("prismatic", "acceleration_lag"): ("reading", {"k": "s**2"}),
    ("prismatic", "thermal_offset"): ("reading", {"k": "mm/K"}),
    ("prismatic", "periodic_drive_error"): ("reading", {"a": MM, "b": MM, "P": MM}),
    ("prismatic", "straightness"): ("translation", in_units(mm="u_2 u_3 u_4 v_2 v_3 v_4")),
    ("prismatic", "angular_error_motion"): ("rotation", in_units(arcsec="x_1 y_1 z_1 x_2 y_2 z_2 x_3 y_3 z_3")),
    ("prismatic", "thermal_expansion"): ("reading", {"alpha": "1/K"}),
    ("prismatic", "gravity_sag"): ("sag", {"tip": MM, "own": MM, "mid": MM}),
    ("prismatic", "load_sag"): ("sag", {"k0": "mm/N", "k3": "mm/N"}),
    ("prismatic", "guide_windup"): ("rotation", {"a": "arcsec/mm", "b": "arcsec/mm"}),
    ("machine", "warm_up_drift"): ("frame", {"x": MM, "y": MM, "z": MM, "tau": "s"}),
    ("machine", "linear_drift"): ("frame", dict.fromkeys("xyz", "mm/s")),
    ("machine", "frame_shift"): ("frame_shift", in_units(mm="x y z", arcsec="rx ry rz")),
    ("machine", "instrument_scale"): ("factor", {"k": "1"}),
    ("revolute", "bearing_waves"): ("reading", dict.fromkeys(("a2", "b2", "a3", "b3"), AS)),
    ("revolute", "coupling"): ("reading", {"k": "1"}),
    ("machine", "instrument_axis_scales"): ("axes", {"x": "1", "y": "1"}),
    ("machine", "instrument_squareness"): ("axes", dict.fromkeys(("xy", "xz", "yz"), AS)),
    ("revolute", "axis_flexure"): ("rotation", {"a": AS}),
    ("revolute", "fork_flexure"): ("reading", {"a": AS}),
    ("machine", "tube_flexure"): ("lift", {"a": AS}),
    ("machine", "refraction"): ("lift", {"a": AS}),
    ("target", "target_offset"): ("target", dict.fromkeys("xyz", MM)),
    ("target", "target_remounting"): ("remounting", dict.fromkeys("xyz", MM)),
    ("leg", "base_joint_offset"): ("base_joint", dict.fromkeys("xyz", MM)),
    ("leg", "platform_joint_offset"): ("platform_joint", dict.fromkeys("xyz", MM)),
    ("leg", "leg_zero_offset"): ("reading", {"a": MM}),
    ("leg", "leg_scale"): ("reading", {"k": "1"}),
    ("leg", "leg_thermal_expansion"): ("reading", {"alpha": "1/K"}),
    ("leg", "leg_backlash"): ("reading", {"b": MM}),
    ("tower", "zero_offset"): ("reading", {"a": MM}),
    ("arm", "zero_offset"): ("reading", {"a": "deg"}),
    **dict.fromkeys([("tower", "scale"), ("arm", "scale")], ("reading", {"k": "1"})),
    ("tower", "backlash"): ("reading", {"b": MM}),
    ("arm", "backlash"): ("reading", {"b": AS}),
    **{(at, "delta_radius"): ("base_joint", {"r": MM}) for at in ("tower", "arm")},
    **{(at, "delta_angle"): ("heading", {"a": "deg"}) for at in ("tower", "arm")},
    **{(at, "rod_length"): ("rod", {"a": MM}) for at in ("tower", "arm")},
    ("arm", "arm_length"): ("arm", {"a": MM}),
    ("tower", "tower_lean"): ("base_joint", {"a": "deg", "b": "deg"}),
    ("leg", "leg_compliance"): ("reading", {"c": "mm/N"}),
    ("legs", "base_radius"): ("base_joint", {"r": MM}),
    ("legs", "platform_radius"): ("platform_joint", {"r": MM}),
    ("legs", "platform_shift"): ("platform_joint", dict.fromkeys("xyz", MM)),
    **{(at, "common_zero_offset"): ("reading", {"a": MM}) for at in ("legs", "towers")},
    ("arms", "common_zero_offset"): ("reading", {"a": "deg"}),
    ("machine", "plate_bowl"): ("plate", {"a": "1/mm"}),
    ("machine", "plate_warp"): ("plate", dict.fromkeys("bc", "1/mm")),
}  # fmt: skip


def row(at, name):
    (definition,) = definitions(name, at)
    return definition


def test_the_catalogue_holds_exactly_these_effects():
    places = [place for d in CATALOGUE for place in d.at]
    order = {"revolute": 0, "prismatic": 1, "machine": 2, "target": 3, "leg": 4, "tower": 5, "arm": 5}
    order |= dict.fromkeys(("legs", "towers", "arms"), 4)
    assert places == sorted(places, key=order.__getitem__)
    assert {(at, d.name) for d in CATALOGUE for at in d.at} == set(EXPECTED)
    assert sum(len(d.at) for d in CATALOGUE) == len(EXPECTED)


RUNGS = {
    0: "zero_offset leg_zero_offset common_zero_offset",
    1: "axis_tilt axis_offset squareness target_offset base_joint_offset platform_joint_offset tower_lean arm_length "
    "delta_radius delta_angle rod_length base_radius platform_radius platform_shift",
    2: "gravity_windup load_windup lateral_windup axis_flexure fork_flexure gravity_sag load_sag guide_windup "
    "leg_compliance",
}
"""Zeros, other dimensions, and what weight or a load does; whatever is not listed is the rest."""


def test_every_effect_has_its_place_in_the_ladder_of_a_robot():
    expected = {name: number for number, names in RUNGS.items() for name in names.split()}
    assert expected.keys() <= {d.name for d in CATALOGUE}
    assert {d.name: d.rung for d in CATALOGUE} == {d.name: expected.get(d.name, 3) for d in CATALOGUE}


@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effect_has_its_component_parameters_and_units(at, name):
    component, units = EXPECTED[at, name]
    definition = row(at, name)
    assert definition.component == component
    assert definition.units("mm") == units
    for unit in units.values():
        parse_unit(unit)


def exactly(formula):
    """The value of a formula of the catalogue, in components of the letters of the derivation."""
    letters = {row.name: explicit(row.symbol) for row in effects.derivation.symbols}
    functions = {name: getattr(sp, name, None) for name in FUNCTION_NAMES}
    return sp.Matrix([formula.evaluate({"pi": sp.pi, **letters}, functions, sp.Rational)])


@pytest.mark.xdist_group("effects")
@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effects_formulas_are_those_of_its_proved_entry(at, name):
    definition = row(at, name)
    entry = effects.derivation.entries[definition.entry]
    assert entry.verdict == "proved"
    proved = [sp.Matrix([explicit(claim.rhs)]) for claim in entry.claims if isinstance(claim, sp.Eq)]
    for each in filter(None, (definition, definition.directions, definition.poses)):
        for formula in each.formulas:
            value = exactly(formula)
            of_shape = (p - value for p in proved if p.shape == value.shape)
            assert any(difference.expand().is_zero_matrix for difference in of_shape), formula.text
        assert each.parameters.keys() <= frozenset().union(*(formula.names for formula in each.formulas))


@pytest.mark.xdist_group("effects")
def test_every_entry_of_effects_is_proved_and_serves_a_row_or_another_entry():
    derivation = effects.derivation
    assert derivation.open == []
    beams = {"cantilever", "cantilever-by-travel", "bridge", "bridge-bent-by-its-load"}
    assert {d.entry for d in CATALOGUE} | beams == set(derivation.entries)


VOCABULARY = {
    **dict.fromkeys("s U V N EX EY EZ zeta P1 P2 P3 P4 tan_zenith sin_zenith bend fork leg_tension pi".split(), ONE),
    "T": TEMPERATURE, "F": FORCE, "t": TIME, "L": LENGTH, **dict.fromkeys(("read_x", "read_y", "read_z"), LENGTH),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["point", "direction"])
@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effects_units_make_what_its_component_takes(at, name, kind):
    definition = row(at, name).for_measurand(MEASURANDS[kind])
    coordinate = ANGLE if at in {"revolute", "arm", "arms"} else LENGTH
    names = VOCABULARY | {
        "q": coordinate,
        "q_before": ANGLE,
        "v": coordinate / TIME,
        "acc": coordinate / TIME**2,
    }
    names |= dict.fromkeys(("M", "M_perp", "M_across", "M_guide"), ONE if kind == "direction" else LENGTH)
    names |= {
        name: parse_unit(unit).dimension for name, unit in definition.units("mm", MEASURANDS[kind]).items()
    }
    assert definition.formula.dimension(names).fits(
        component_dimension(definition.component, at.removesuffix("s"), MEASURANDS[kind])
    )
    if definition.slope is not None:
        assert definition.slope.dimension(names).fits(ANGLE)


def test_where_directions_are_measured_a_frame_turns_and_a_target_has_two_freedoms():
    shift = row("machine", "frame_shift")
    turned = shift.for_measurand(DIRECTION)
    assert (turned.component, turned.units(measurand=DIRECTION), turned.slope) == (
        "frame_shift", dict.fromkeys("xyz", AS), None,
    )  # fmt: skip
    assert shift.for_measurand(POINT) is shift.for_measurand(DISTANCE) is shift
    assert shift.slope.text == "rx*EX + ry*EY + rz*EZ"
    target = row("target", "target_offset").for_measurand(DIRECTION)
    assert target.units(measurand=DIRECTION) == {"a": AS, "b": AS}
    assert target.formula.text == "a*U + b*V"
    assert row("machine", "warm_up_drift").units("mm", DIRECTION) == {"x": AS, "y": AS, "z": AS, "tau": "s"}
    assert row("machine", "linear_drift").units("mm", DIRECTION) == dict.fromkeys("xyz", "arcsec/s")
    assert row("revolute", "gravity_windup").units("mm", DIRECTION) == {"k": AS, "k2": AS}
    assert row("revolute", "load_windup").units("mm", DIRECTION) == {"k": "arcsec/N"}


def test_the_table_has_a_row_for_each_effect():
    rows = as_table()
    assert [(at, name) for at, name, *_ in rows] == [(", ".join(sorted(d.at)), d.name) for d in CATALOGUE]
    by_name = {(at, name): (equation, parameters) for at, name, equation, parameters, _ in rows}
    assert by_name["revolute", "backlash"] == ("reading -= b/2*s", "b [arcsec]")
    assert by_name["machine", "frame_shift"][1] == "x, y, z [length]; rx, ry, rz [arcsec]"
    assert by_name["machine", "instrument_scale"][0] == "reading × (1 + k)"
    assert as_table(definitions("zero_offset")) == [row for row in rows if row[1] == "zero_offset"]


def test_error_for_an_unknown_name_gives_the_nearest(refuses):
    for name in ("backlsh", "Encoder_Excentricity", "zzz", "x" * 100_000):
        refuses(definitions, name)
    refuses(definitions, "squareness", "revolute")


# effects of users ----------------------------------------------------------------------------------------------

JOINTS = {"X": "prismatic", "C": "revolute"}


def own(component="reading", formula="a*sin(q) + k*F", parameters=None, **more):
    more = {
        "name": "mine",
        "at": "revolute",
        "joints": JOINTS,
        "file": "machine.toml",
        "place": "effect 1",
    } | more
    name = more.pop("name")
    units = {"a": "arcsec", "k": "arcsec/N"} if parameters is None else parameters
    return own_effect(name, component, formula, units, "The coupling winds up.", **more)


def test_an_effect_of_a_user_is_taken():
    effect = own()
    assert (effect.name, effect.at, effect.component, effect.own) == ("mine", {"revolute"}, "reading", True)
    assert effect.parameters == {"a": "arcsec", "k": "arcsec/N"}
    assert effect.formula.text == "a*sin(q) + k*F"
    assert "The coupling winds up." in effect.describe()


@pytest.mark.parametrize(
    ("component", "formula", "parameters", "more"),
    [
        ("tx", "a*X*cos(C)", {"a": "um/m"}, {}),
        ("tz", "a*exp(-t/tau)", {"a": "um", "tau": "min"}, {"at": "machine"}),
        ("rx", "a*P1", {"a": "arcsec"}, {}),  # P1 is a column of the user's
        ("reading", "a*oil", {"a": "arcsec/percent"}, {"columns": {"oil": parse_unit("percent").dimension}}),
        ("reading", "a*U", {"a": "um/V"}, {"columns": {"U": parse_unit("mV").dimension}, "at": "prismatic"}),
        ("reading", "a*U", {"a": "mm/V"}, {"columns": {"U": None}, "at": "prismatic"}),
        ("reading", "k*v*s", {"k": "ms"}, {"at": "prismatic"}),
        ("reading", "k*T*q", {"k": "1/degC"}, {}),
        ("tx", "0.001", {}, {}),
        ("reading", "0.001*q", {}, {}),
        ("ty", "a", {"a": "inch"}, {"at": "target"}),
        ("rz", "a", {"a": "deg"}, {"at": "target", "measurand": DIRECTION}),
        ("rz", "a*b*c*d/pi", {"a": "kg", "b": "m/s**2", "c": "1/N", "d": "rad"}, {}),
    ],
)
def test_what_a_user_may_write(component, formula, parameters, more):
    assert own(component, formula, parameters, **more).component == component


MANY = {f"p{i}": "arcsec" for i in range(41)}
BAD = {
    "name": {"name": "1st"},
    "empty name": {"name": ""},
    "name with a blank": {"name": "a b"},
    "component": {"component": "sag"},
    "reading of a machine": {"at": "machine", "formula": "t*a"},
    "translation of a direction": {"component": "tx", "measurand": DIRECTION},
    "rotation of a point": {"component": "rx", "at": "target"},
    "formula": {"formula": "2q"},
    "unused parameter": {"formula": "a*q/q"},
    "parameter is no name": {"parameters": {"a-b": "mm"}},
    "parameter with homoglyph": {"parameters": {"\u0430": "mm"}},
    "many parameters": {"parameters": MANY, "formula": " + ".join(MANY)},
    "unit": {"parameters": {"a": "arcse", "k": "1"}},
    "no unit": {"parameters": {"a": "", "k": "1"}},
    "length": {"parameters": {"a": "mm", "k": "mm/N"}},
    "sum": {"parameters": {"a": "mm", "k": "arcsec/N"}},
    "sine of a length": {"at": "prismatic", "parameters": {"a": "mm", "k": "mm/N"}},
    "joint's words": {"at": "machine", "component": "tx"},
    "no column": {"columns": {"oil": None}, "formula": "a*q + k*F*oyl"},
    "wrong column": {"columns": {"U": parse_unit("V").dimension}, "formula": "a*U + k*F"},
    **{f"parameter {name}": {"parameters": {name: "arcsec"}, "formula": f"{name}"}
       for name in ("q", "s", "v", "t", "T", "F", "pi")},
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_error_of_a_bad_effect_of_a_user_is_one_sentence(refuses, case):
    refuses(own, **BAD[case])


@pytest.mark.parametrize("name", sorted(FUNCTION_NAMES | JOINTS.keys()))
def test_a_parameter_may_not_hide_a_function_or_a_joint(refuses, name):
    refuses(own, parameters={name: "arcsec"}, formula="q")


# Names of TPOINT and symbols of ISO 230: which effect they are; test_import_tpoint.py holds signs and factors


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
