"""The catalogue of effects, against formulas and units that are written here a second time, by hand."""

import math
import re

import numpy as np
import pytest
from numpy.polynomial import legendre

from rodgen.data.units import ANGLE, FORCE, LENGTH, ONE, TEMPERATURE, TIME, parse_unit
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.effects.catalogue import CATALOGUE, as_table, definitions
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import component_dimension
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.measured import DIRECTION, DISTANCE, MEASURANDS, POINT

NUMPY = {name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "sign", "abs")}
RNG = np.random.default_rng(20)
NUMBERS = dict(
    zip(
        "q s v acc t T F M M_perp L tan_zenith sin_zenith fork q_before leg_tension read_x read_y read_z".split(),
        RNG.uniform(0.5, 2.5, 18),
        strict=True,
    )
)
VECTORS = {
    name: RNG.normal(size=3) for name in ("U", "V", "N", "EX", "EY", "EZ", "M_across", "M_guide", "bend")
}
ZETA = 0.37
LEGENDRE = {f"P{k}": legendre.legval(2 * ZETA - 1, [0] * k + [1]) for k in range(1, 5)}
WORLD = {"pi": math.pi, "zeta": ZETA, **NUMBERS, **VECTORS, **LEGENDRE}
MM, AS = "mm", "arcsec"


def in_units(**units):
    """Parameters by unit: names in one text."""
    return {name: unit for unit, names in units.items() for name in names.split()}


def waves(p, w, prefix):
    q = w.q
    return (
        p[f"{prefix}c1"] * math.cos(q)
        + p[f"{prefix}s1"] * math.sin(q)
        + p[f"{prefix}c2"] * math.cos(2 * q)
        + p[f"{prefix}s2"] * math.sin(2 * q)
    )


def side_waves(p, w):
    return waves(p, w, "u_") * w.U + waves(p, w, "v_") * w.V


def xyz(p, suffix=""):
    return sum(p[f"{x}{suffix}"] * VECTORS[f"E{x.upper()}"] for x in "xyz")


def leaning(p, w):
    a, b = math.sin(p["a"]), math.sin(p["b"])
    return w.q * (a * w.U + b * w.V + (math.sqrt(1 - a**2 - b**2) - 1) * w.N)


SIDES = "u_c1 u_s1 u_c2 u_s2 v_c1 v_s1 v_c2 v_s2"

# where, name: component, units of the parameters (file in mm, points), value
EXPECTED = {
    ("revolute", "axis_tilt"): ("axis", {"a": AS, "b": AS}, lambda p, w: p["a"] * w.U + p["b"] * w.V),
    ("revolute", "axis_offset"): ("point", {"a": MM, "b": MM}, lambda p, w: p["a"] * w.U + p["b"] * w.V),
    ("revolute", "zero_offset"): ("reading", {"a": AS}, lambda p, w: p["a"]),
    ("revolute", "scale"): ("reading", {"k": "1"}, lambda p, w: p["k"] * w.q),
    ("revolute", "encoder_eccentricity"): (
        "reading", {"a": AS, "b": AS}, lambda p, w: p["a"] * math.cos(w.q) + p["b"] * math.sin(w.q)),
    ("revolute", "encoder_ellipticity"): (
        "reading", {"a": AS, "b": AS}, lambda p, w: p["a"] * math.cos(2 * w.q) + p["b"] * math.sin(2 * w.q)),
    ("revolute", "encoder_harmonics"): (
        "reading", in_units(arcsec="a4 b4 a8 b8"),
        lambda p, w: sum(p[f"a{k}"] * math.cos(k * w.q) + p[f"b{k}"] * math.sin(k * w.q) for k in (4, 8))),
    ("revolute", "periodic_drive_error"): (
        "reading", {"a": AS, "b": AS, "P": "deg"},
        lambda p, w: p["a"] * math.sin(math.tau * w.q / p["P"]) + p["b"] * math.cos(math.tau * w.q / p["P"])),
    ("revolute", "radial_error_motion"): ("translation", in_units(mm=SIDES), side_waves),
    ("revolute", "axial_error_motion"): (
        "translation", in_units(mm="c1 s1 c2 s2"), lambda p, w: waves(p, w, "") * w.N),
    ("revolute", "tilt_error_motion"): ("rotation", in_units(arcsec=SIDES), side_waves),
    ("revolute", "backlash"): ("reading", {"b": AS}, lambda p, w: -p["b"] / 2 * w.s),
    ("revolute", "backlash_gradient"): ("reading", {"k": "1"}, lambda p, w: -p["k"] * w.s * w.q),
    ("revolute", "servo_lag"): ("reading", {"tau": "s"}, lambda p, w: -p["tau"] * w.v),
    ("revolute", "acceleration_lag"): ("reading", {"k": "s**2"}, lambda p, w: -p["k"] * w.acc),
    ("revolute", "gravity_windup"): (
        "reading", {"k": "arcsec/mm", "k2": "arcsec/mm"}, lambda p, w: p["k"] * w.M + p["k2"] * w.M_perp),
    ("revolute", "load_windup"): ("reading", {"k": "arcsec/N/mm"}, lambda p, w: p["k"] * w.F * w.M),
    ("revolute", "lateral_windup"): ("rotation", {"a": "arcsec/mm"}, lambda p, w: p["a"] * w.M_across),
    ("revolute", "thermal_offset"): ("reading", {"k": "arcsec/K"}, lambda p, w: p["k"] * w.T),
    ("revolute", "thermal_axis_drift"): (
        "translation", dict.fromkeys("xyz", "mm/K"), lambda p, w: xyz(p) * w.T),
    ("prismatic", "squareness"): ("axis", {"a": AS, "b": AS}, lambda p, w: p["a"] * w.U + p["b"] * w.V),
    ("prismatic", "zero_offset"): ("reading", {"a": MM}, lambda p, w: p["a"]),
    ("prismatic", "scale"): ("reading", {"k": "1"}, lambda p, w: p["k"] * w.q),
    ("prismatic", "backlash"): ("reading", {"b": MM}, lambda p, w: -p["b"] / 2 * w.s),
    ("prismatic", "backlash_gradient"): ("reading", {"k": "1"}, lambda p, w: -p["k"] * w.s * w.q),
    ("prismatic", "servo_lag"): ("reading", {"tau": "s"}, lambda p, w: -p["tau"] * w.v),
    ("prismatic", "acceleration_lag"): ("reading", {"k": "s**2"}, lambda p, w: -p["k"] * w.acc),
    ("prismatic", "thermal_offset"): ("reading", {"k": "mm/K"}, lambda p, w: p["k"] * w.T),
    ("prismatic", "periodic_drive_error"): (
        "reading", {"a": MM, "b": MM, "P": MM},
        lambda p, w: p["a"] * math.sin(math.tau * w.q / p["P"]) + p["b"] * math.cos(math.tau * w.q / p["P"])),
    ("prismatic", "straightness"): (
        "translation", in_units(mm="u_2 u_3 u_4 v_2 v_3 v_4"),
        lambda p, w: sum((p[f"u_{k}"] * w.U + p[f"v_{k}"] * w.V) * LEGENDRE[f"P{k}"] for k in (2, 3, 4))),
    ("prismatic", "angular_error_motion"): (
        "rotation", in_units(arcsec="x_1 y_1 z_1 x_2 y_2 z_2 x_3 y_3 z_3"),
        lambda p, w: sum(xyz(p, f"_{k}") * LEGENDRE[f"P{k}"] for k in (1, 2, 3))),
    ("prismatic", "thermal_expansion"): ("reading", {"alpha": "1/K"}, lambda p, w: p["alpha"] * w.T * w.q),
    ("prismatic", "gravity_sag"): (
        "sag", {"tip": MM, "own": MM, "mid": MM},
        lambda p, w: p["tip"] * ZETA**3 + p["own"] * ZETA**4 + 16 * p["mid"] * (ZETA * (1 - ZETA)) ** 2),
    ("prismatic", "load_sag"): (
        "sag", {"k0": "mm/N", "k3": "mm/N"}, lambda p, w: w.F * (p["k0"] + p["k3"] * ZETA**3)),
    ("prismatic", "guide_windup"): (
        "rotation", {"a": "arcsec/mm", "b": "arcsec/mm"}, lambda p, w: (p["a"] + p["b"] * ZETA) * w.M_guide),
    ("machine", "warm_up_drift"): (
        "frame", {"x": MM, "y": MM, "z": MM, "tau": "s"}, lambda p, w: xyz(p) * (1 - math.exp(-w.t / p["tau"]))),
    ("machine", "linear_drift"): ("frame", dict.fromkeys("xyz", "mm/s"), lambda p, w: xyz(p) * w.t),
    ("machine", "frame_shift"): (
        "frame_shift", in_units(mm="x y z", arcsec="rx ry rz"), lambda p, w: xyz(p)),
    ("machine", "instrument_scale"): ("factor", {"k": "1"}, lambda p, w: p["k"]),
    ("revolute", "bearing_waves"): (
        "reading", dict.fromkeys(("a2", "b2", "a3", "b3"), AS),
        lambda p, w: sum(p[f"a{n}"] * np.cos(n * w.q_before) + p[f"b{n}"] * np.sin(n * w.q_before) for n in (2, 3)),
    ),
    ("revolute", "coupling"): ("reading", {"k": "1"}, lambda p, w: p["k"] * w.q_before),
    ("machine", "instrument_axis_scales"): (
        "axes", {"x": "1", "y": "1"}, lambda p, w: p["x"] * w.read_x * w.EX + p["y"] * w.read_y * w.EY),
    ("machine", "instrument_squareness"): (
        "axes", dict.fromkeys(("xy", "xz", "yz"), AS),
        lambda p, w: (p["xy"] * w.read_y + p["xz"] * w.read_z) * w.EX + p["yz"] * w.read_z * w.EY),
    ("revolute", "axis_flexure"): ("rotation", {"a": AS}, lambda p, w: p["a"] * w.bend),
    ("revolute", "fork_flexure"): ("reading", {"a": AS}, lambda p, w: p["a"] * w.fork),
    ("machine", "tube_flexure"): ("lift", {"a": AS}, lambda p, w: -p["a"] * w.sin_zenith),
    ("machine", "refraction"): ("lift", {"a": AS}, lambda p, w: p["a"] * w.tan_zenith),
    ("target", "target_offset"): ("target", dict.fromkeys("xyz", MM), lambda p, w: xyz(p)),
    ("target", "target_remounting"): ("remounting", dict.fromkeys("xyz", MM), lambda p, w: xyz(p)),
    ("leg", "base_joint_offset"): ("base_joint", dict.fromkeys("xyz", MM), lambda p, w: xyz(p)),
    ("leg", "platform_joint_offset"): ("platform_joint", dict.fromkeys("xyz", MM), lambda p, w: xyz(p)),
    ("leg", "leg_zero_offset"): ("reading", {"a": MM}, lambda p, w: p["a"]),
    ("leg", "leg_scale"): ("reading", {"k": "1"}, lambda p, w: p["k"] * w.q),
    ("leg", "leg_thermal_expansion"): ("reading", {"alpha": "1/K"}, lambda p, w: p["alpha"] * w.T * w.q),
    ("leg", "leg_backlash"): ("reading", {"b": MM}, lambda p, w: -p["b"] / 2 * w.s),
    ("tower", "zero_offset"): ("reading", {"a": MM}, lambda p, w: p["a"]),
    ("arm", "zero_offset"): ("reading", {"a": "deg"}, lambda p, w: p["a"]),
    **dict.fromkeys(
        [("tower", "scale"), ("arm", "scale")], ("reading", {"k": "1"}, lambda p, w: p["k"] * w.q)),
    ("tower", "backlash"): ("reading", {"b": MM}, lambda p, w: -p["b"] / 2 * w.s),
    ("arm", "backlash"): ("reading", {"b": AS}, lambda p, w: -p["b"] / 2 * w.s),
    **{(at, "delta_radius"): ("base_joint", {"r": MM}, lambda p, w: p["r"] * w.U) for at in ("tower", "arm")},
    **{(at, "delta_angle"): ("heading", {"a": "deg"}, lambda p, w: p["a"]) for at in ("tower", "arm")},
    **{(at, "rod_length"): ("rod", {"a": MM}, lambda p, w: p["a"]) for at in ("tower", "arm")},
    ("arm", "arm_length"): ("arm", {"a": MM}, lambda p, w: p["a"]),
    ("tower", "tower_lean"): ("base_joint", {"a": "deg", "b": "deg"}, leaning),
    ("leg", "leg_compliance"): ("reading", {"c": "mm/N"}, lambda p, w: p["c"] * w.F * w.leg_tension),
}  # fmt: skip


class World:
    """The names of formulas as attributes."""

    def __getattr__(self, name):
        return WORLD[name]


def row(at, name):
    (definition,) = definitions(name, at)
    return definition


def drawn(definition):
    return dict(zip(definition.parameters, RNG.uniform(0.3, 0.7, len(definition.parameters)), strict=True))


def evaluated(formula, parameters):
    return formula.evaluate(WORLD | parameters, NUMPY, float)


def test_the_catalogue_holds_exactly_these_effects():
    places = [place for d in CATALOGUE for place in d.at]
    order = {"revolute": 0, "prismatic": 1, "machine": 2, "target": 3, "leg": 4, "tower": 5, "arm": 5}
    assert places == sorted(places, key=order.__getitem__)
    assert {(at, d.name) for d in CATALOGUE for at in d.at} == set(EXPECTED)
    assert sum(len(d.at) for d in CATALOGUE) == len(EXPECTED)


@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effect_has_its_component_parameters_and_units(at, name):
    component, units, _ = EXPECTED[at, name]
    definition = row(at, name)
    assert definition.component == component
    assert definition.units("mm") == units
    for unit in units.values():
        parse_unit(unit)


@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effects_formula_is_worth_what_was_written_by_hand(at, name):
    definition = row(at, name)
    parameters = drawn(definition)
    expected = EXPECTED[at, name][2](parameters, World())
    # sums of a dozen products at most
    np.testing.assert_allclose(evaluated(definition.formula, parameters), expected, rtol=1e-13, atol=1e-13)
    used = definition.formula.names | (definition.slope.names if definition.slope else frozenset())
    assert parameters.keys() <= used


VOCABULARY = {
    **dict.fromkeys("s U V N EX EY EZ zeta P1 P2 P3 P4 tan_zenith sin_zenith bend fork leg_tension pi".split(), ONE),
    "T": TEMPERATURE, "F": FORCE, "t": TIME, "L": LENGTH, **dict.fromkeys(("read_x", "read_y", "read_z"), LENGTH),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["point", "direction"])
@pytest.mark.parametrize(("at", "name"), EXPECTED)
def test_an_effects_units_make_what_its_component_takes(at, name, kind):
    definition = row(at, name).for_measurand(MEASURANDS[kind])
    coordinate = ANGLE if at in {"revolute", "arm"} else LENGTH
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
        component_dimension(definition.component, at, MEASURANDS[kind])
    )
    if definition.slope is not None:
        assert definition.slope.dimension(names).fits(ANGLE)


def test_a_cantilever_sags_and_turns_as_beam_theory_says():
    """A beam of length l = zeta L: load W at its end, own weight w per length, stiffness EI."""
    W, w, EI, L = 3.0, 0.4, 70.0, NUMBERS["L"]
    reach = ZETA * L
    parameters = {"tip": W * L**3 / (3 * EI), "own": w * L**4 / (8 * EI), "mid": 0.0}
    drop = W * reach**3 / (3 * EI) + w * reach**4 / (8 * EI)
    slope = W * reach**2 / (2 * EI) + w * reach**3 / (6 * EI)
    definition = row("prismatic", "gravity_sag")
    # a few products
    assert evaluated(definition.formula, parameters) == pytest.approx(drop, rel=1e-14)
    assert evaluated(definition.slope, parameters) == pytest.approx(slope, rel=1e-14)
    loaded = row("prismatic", "load_sag")
    assert evaluated(loaded.slope, {"k0": 9.0, "k3": parameters["tip"] / NUMBERS["F"]}) == pytest.approx(
        W * reach**2 / (2 * EI), rel=1e-14
    )


def test_a_bridge_turns_by_the_slope_of_its_sag():
    definition = row("prismatic", "gravity_sag")
    parameters = {"tip": 0.0, "own": 0.0, "mid": 1.7}
    polynomial = np.polynomial.Polynomial([0, 0, 1, -2, 1]) * 16 * 1.7
    assert evaluated(definition.formula, parameters) == pytest.approx(polynomial(ZETA), rel=1e-14)
    slope = polynomial.deriv()(ZETA) / NUMBERS["L"]
    assert evaluated(definition.slope, parameters) == pytest.approx(slope, rel=1e-13)
    assert definition.formula.evaluate(WORLD | parameters | {"zeta": 0.5}, NUMPY, float) == pytest.approx(1.7)


def test_where_directions_are_measured_a_frame_turns_and_a_target_has_two_freedoms():
    shift = row("machine", "frame_shift")
    turned = shift.for_measurand(DIRECTION)
    assert (turned.component, turned.units(measurand=DIRECTION), turned.slope) == (
        "frame_shift", dict.fromkeys("xyz", AS), None,
    )  # fmt: skip
    assert shift.for_measurand(POINT) is shift.for_measurand(DISTANCE) is shift
    rotation = {f"r{x}": value for x, value in zip("xyz", (0.1, 0.2, 0.3), strict=True)}
    np.testing.assert_allclose(
        evaluated(shift.slope, rotation),
        sum(rotation[f"r{x}"] * VECTORS[f"E{x.upper()}"] for x in "xyz"),
        rtol=1e-15,
    )
    target = row("target", "target_offset").for_measurand(DIRECTION)
    assert target.units(measurand=DIRECTION) == {"a": AS, "b": AS}
    np.testing.assert_allclose(
        evaluated(target.formula, {"a": 2.0, "b": 3.0}), 2 * VECTORS["U"] + 3 * VECTORS["V"], rtol=1e-15
    )
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


def test_error_for_an_unknown_name_gives_the_nearest():
    for name, hint in {
        "backlsh": "'backlash', perhaps",
        "Encoder_Excentricity": "'encoder_eccentricity', perhaps",
        "zzz": "a name of the catalogue",
        "x" * 100_000: "a name of the catalogue",
    }.items():
        with pytest.raises(RodgenError, match=re.escape(hint)):
            definitions(name)
    with pytest.raises(
        RodgenError, match="squareness at a place of type 'revolute'; expected prismatic, where it"
    ):
        definitions("squareness", "revolute")


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
    "name": ({"name": "1st"}, "name: '1st'; expected letters, digits and '_', a letter first, 60 at most"),
    "empty name": ({"name": ""}, "name: ''; expected letters"),
    "name with a blank": ({"name": "a b"}, "name: 'a b'; expected letters"),
    "component": ({"component": "sag"}, "component: 'sag' at a revolute joint; expected one of reading, tx, ty"),
    "reading of a machine": ({"at": "machine", "formula": "t*a"}, "'reading' at a machine; expected one of tx"),
    "translation of a direction": ({"component": "tx", "measurand": DIRECTION}, "'tx' at a revolute joint; expected"),
    "rotation of a point": ({"component": "rx", "at": "target"}, "'rx' at a target; expected one of tx, ty, tz"),
    "formula": ({"formula": "2q"}, "formula: '2q' at character 1, with no operator between; expected '2*q'"),
    "unused parameter": ({"formula": "a*q/q"}, "parameters.k: a parameter that is not in the formula; expected those"),
    "parameter is no name": ({"parameters": {"a-b": "mm"}}, "parameters.a-b: 'a-b'; expected letters, digits"),
    "parameter with homoglyph": ({"parameters": {"\u0430": "mm"}}, "parameters.\u0430: '\u0430'; expected letters"),
    "many parameters": (
        {"parameters": MANY, "formula": " + ".join(MANY)}, "parameters: 41 parameters; expected at most 40"),
    "unit": ({"parameters": {"a": "arcse", "k": "1"}}, "parameters.a: unknown unit 'arcse'; expected 'arcsec', or"),
    "no unit": ({"parameters": {"a": "", "k": "1"}}, "parameters.a: no unit; expected one such as mm, arcsec"),
    "length": ({"parameters": {"a": "mm", "k": "mm/N"}}, "formula: a value in length; expected angle for component"),
    "sum": ({"parameters": {"a": "mm", "k": "arcsec/N"}}, "'a*sin(q) + k*F' of length and angle; expected two of"),
    "sine of a length": ({"at": "prismatic", "parameters": {"a": "mm", "k": "mm/N"}}, "'sin(q)', sin of length"),
    "joint's words": ({"at": "machine", "component": "tx"}, "'q', which only a joint has; expected a joint by"),
    "no column": ({"columns": {"oil": None}, "formula": "a*q + k*F*oyl"}, "'oyl', no parameter, joint or column"),
    "wrong column": (
        {"columns": {"U": parse_unit("V").dimension}, "formula": "a*U + k*F"}, "'a*U + k*F' of"),
    **{f"parameter {name}": (
        {"parameters": {name: "arcsec"}, "formula": f"{name}"}, f"parameters.{name}: '{name}', the name of")
       for name in ("q", "s", "v", "t", "T", "F", "pi")},
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_error_of_a_bad_effect_of_a_user_is_one_sentence(case):
    changes, message = BAD[case]
    with pytest.raises(InputFileError) as caught:
        own(**changes)
    told = str(caught.value)
    assert told.startswith("machine.toml: effect 1, ")
    assert message in told
    assert told.isprintable()


@pytest.mark.parametrize("name", sorted(FUNCTION_NAMES | JOINTS.keys()))
def test_a_parameter_may_not_hide_a_function_or_a_joint(name):
    with pytest.raises(InputFileError, match=r"the name of a .*; expected another name"):
        own(parameters={name: "arcsec"}, formula="q")
