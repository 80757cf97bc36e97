"""Machine files: they are loaded as written, errors are reported in one line, and written files read back."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rodgen.errors import InputFileError
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.files.edit import edited_text
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.schema import decimal
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.parts import DRIVES

DEG = math.pi / 180

GANTRY = """\
# A portal with a rotary axis.
name = "Gantry with a rotary C axis"

[units]                      # of every plain number in this file
length = "mm"
angle  = "deg"

[environment]
gravity = [0, 0, -2]
reference_temperature = 21.5

[[joint]]                    # base first
name   = "X"
type   = "prismatic"
axis   = [1, 0, 0]
travel = [0, 800]

[[joint]]
name   = "C"
type   = "revolute"
axis   = [0, 0, 1]
point  = [1.5, 0, 0]
travel = [-180, 180]
period = 360

[[target]]
name  = "ball_1"
point = [120, 0, 40]

[[target]]
name  = "ball_2"
point = [-40, 85, 10]

[measured]
kind  = "point"
frame = "machine"
noise = 0.002

[estimate]
parameters = ["C.axis", "C.point", "X.axis"]

[[effect]]                   # the scale sits off its axis
name  = "encoder_eccentricity"
joint = "C"
hold  = { b = 0.5 }          # of a degree

[[effect]]
name       = "coupling_windup"
joint      = "C"
component  = "reading"
formula    = "a*sin(q) + k*F"
parameters = { a = "arcsec", k = "arcsec/N" }
meaning    = "The coupling winds up under load."
"""

MOUNT = """\
name = "Mount"
[units]
length = "m"
angle = "arcsec"
[[joint]]
name = "AZ"
type = "revolute"
axis = [0, 0, -1]
travel = [0, 1296000]
[[joint]]
name = "EL"
type = "revolute"
axis = [1, 0, 0]
[[joint]]
name = "focus"
type = "prismatic"
axis = [0, 1, 0]
[[target]]
name = "boresight"
point = [0, 3, 4]
[measured]
kind = "direction"
frame = "free"
noise = 2
"""


def load(text: str) -> Machine:
    return machine_of(text, "machine.toml")


# what a file says --------------------------------------------------------------------------------------------------


def test_file_says_what_is_loaded_in_internal_units() -> None:
    machine = load(GANTRY)
    assert (machine.name, machine.length_unit, machine.angle_unit) == (
        "Gantry with a rotary C axis",
        "mm",
        "deg",
    )
    assert (machine.gravity, machine.reference_temperature) == ((0, 0, -1), 21.5)
    assert machine.joints == (
        Joint("X", "prismatic", (1, 0, 0), (0, 0, 0), (0, 800), None),
        Joint("C", "revolute", (0, 0, 1), (1.5, 0, 0), (-math.pi, math.pi), 2 * math.pi),
    )
    assert machine.targets == (Target("ball_1", (120, 0, 40)), Target("ball_2", (-40, 85, 10)))
    assert machine.measured == Measured("point", "machine", None, 0.002)
    assert machine.estimate == ("C.axis", "C.point", "X.axis")
    eccentricity, windup = machine.effects
    assert (eccentricity.name, eccentricity.place, eccentricity.hold) == (
        "encoder_eccentricity",
        "C",
        {"b": 0.5 * DEG},
    )
    assert (windup.name, windup.parameters, windup.hold) == ("coupling_windup", ("a", "k"), {})
    assert windup.definition.own
    assert windup.definition.component == "reading"
    assert windup.definition.formula.names == {"a", "q", "k", "F"}
    assert windup.units(machine) == {"a": "arcsec", "k": "arcsec/N"}
    assert (machine.file, machine.values) == ("machine.toml", {})


def test_directions_are_of_length_one_and_their_noise_is_an_angle() -> None:
    machine = load(MOUNT)
    assert machine.targets[0].point == pytest.approx((0, 0.6, 0.8), rel=1e-15)
    assert machine.measured == Measured("direction", "free", None, 2 * DEG / 3600)
    assert machine.joints[0].travel == (0, pytest.approx(2 * math.pi, rel=1e-15))
    assert (machine.gravity, machine.reference_temperature) == ((0, 0, -1), 20)
    assert machine.estimate == machine.effects == ()


@pytest.mark.parametrize(
    ("text", "noise", "expected"),
    [
        (GANTRY, '"2 um"', 0.002),
        (GANTRY, '"0.002"', 0.002),
        (GANTRY, '"2e-6 m"', 0.002),
        (MOUNT, '"0.5 arcsec"', 0.5 * DEG / 3600),
        (MOUNT, '"2"', 2 * DEG / 3600),
    ],
)
def test_noise_may_be_a_text_with_its_unit(text: str, noise: str, expected: float) -> None:
    found = load(re.sub("noise = .*", f"noise = {noise}", text)).measured.noise
    assert found == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("noise", ["2 deg", "um", "", "-2 um", "0 um", "2 xy"])
def test_a_noise_that_is_none_is_one_sentence(refuses, noise: str) -> None:
    refuses(load, GANTRY.replace("noise = 0.002", f'noise = "{noise}"'))


def test_distance_has_an_origin() -> None:
    text = GANTRY.replace('kind  = "point"', 'kind  = "distance"\nfrom = [1, 2.5, -3]')
    assert load(text).measured == Measured("distance", "machine", (1, 2.5, -3), 0.002)


@pytest.mark.parametrize("axis", [[3, 4, 0], [1e200, 1e200, 0], [5e-324, 0, 0], [1e-300, 1e-310, 0]])
def test_axis_of_any_length_is_a_direction(axis: list[float]) -> None:
    found = load(GANTRY.replace("axis   = [0, 0, 1]", f"axis = {axis}")).joint("C").axis
    scaled = np.array(axis) / max(axis)
    assert found == pytest.approx(tuple(scaled / np.linalg.norm(scaled)), rel=1e-15)


def test_hold_is_in_the_units_of_the_file_combined_by_the_dimension() -> None:
    """By hand: 0.5 deg/K, in an effect that shows arcsec/K, is 0.5·pi/180 rad/K; a tau of 3 s and a k of 2e-6 stay."""
    text = GANTRY + (
        '[[effect]]\nname = "thermal_offset"\njoint = "C"\nhold = { k = 0.5 }\n'
        '[[effect]]\nname = "warm_up_drift"\nhold = { tau = 3, x = 0.25 }\n'
        '[[effect]]\nname = "thermal_expansion"\njoint = "X"\nhold = { alpha = 2e-6 }\n'
    )
    holds = [effect.hold for effect in load(text).effects[2:]]
    assert holds == [{"k": 0.5 * DEG}, {"tau": 3, "x": 0.25}, {"alpha": 2e-6}]


def test_units_of_parameters_follow_the_machine() -> None:
    gantry, mount = load(GANTRY), load(MOUNT)
    assert gantry.effect("backlash", "C").units(gantry) == {"b": "arcsec"}
    assert gantry.effect("backlash", "X").units(gantry) == {"b": "mm"}
    assert gantry.effect("thermal_offset", "X").units(gantry) == {"k": "mm/K"}
    windup = gantry.effect("gravity_windup", "C").units(gantry)
    assert windup == {"k": "arcsec/mm", "k2": "arcsec/mm"}
    windup = mount.effect("gravity_windup", "AZ").units(mount)
    # A direction has no arm of its own; a later joint has a point, whose weight does.
    assert windup == {
        "k": "arcsec",
        "k2": "arcsec",
        "k_EL": "arcsec/m",
        "k2_EL": "arcsec/m",
        "k_focus": "arcsec/m",
    }
    assert mount.effect("target_offset", "boresight").units(mount) == {"a": "arcsec", "b": "arcsec"}
    assert mount.effect("frame_shift").units(mount) == {"x": "arcsec", "y": "arcsec", "z": "arcsec"}


def test_examples_are_machine_files() -> None:
    files = sorted((Path(__file__).parent.parent / "examples" / "machines").rglob("*.toml"))
    assert files
    for file in files:
        machine = Machine.load(file)
        assert load(machine_text(machine)) == machine


def test_byte_order_mark_and_windows_line_ends_change_nothing() -> None:
    assert load("\ufeff" + GANTRY.replace("\n", "\r\n")) == load(GANTRY)


HARDWARE = 'encoder = "motor"\ndrive = "worm"'


def test_joint_may_say_what_is_known_of_its_hardware(tmp_path: Path) -> None:
    machine = load(GANTRY.replace("period = 360", f"period = 360\n{HARDWARE}"))
    x, c = machine.joints
    assert (x.encoder, x.drive, x.passive) == (None, None, False)
    assert (c.encoder, c.drive, c.passive) == ("motor", "worm", False)
    assert load(machine_text(machine)) == machine
    assert f"period = 360\n{HARDWARE}\n" in machine_text(machine)
    assert "travel -180 to 180 deg, worm drive, encoder on the motor" in machine.describe()
    machine.save(tmp_path / "machine.toml")
    added = edited_text(tmp_path / "machine.toml", machine.with_effect(machine.effect("backlash", "C")))
    assert load(added).joint("C") == c


def test_passive_joint_has_no_errors_of_a_drive(refuses) -> None:
    machine = load(GANTRY.replace("period = 360", 'passive = true\nencoder = "axis"'))
    assert machine.joint("C").passive
    assert load(machine_text(machine)) == machine
    for name in ("backlash", "backlash_gradient", "periodic_drive_error", "gravity_windup", "load_windup"):
        refuses(machine.add, name, joint="C")
    assert [e.title for e in machine.add("lateral_windup", joint="C").add("backlash", joint="X").effects][
        -2:
    ] == [
        "lateral_windup at C",
        "backlash at X",
    ]


SEVERAL = """
[[effect]]
name = "bent_column"
joint = "C"
rx = "k*X"
ty = "k*L*X"
parameters = { k = "arcsec/m", L = "mm" }
"""


def test_effect_of_ones_own_may_change_several_components() -> None:
    machine = load(GANTRY + SEVERAL)
    effect = machine.effects[-1]
    assert effect.definition.equation == "rotation about x k*X; translation along y k*L*X"
    assert list(effect.units(machine)) == ["k", "L"]
    assert load(machine_text(machine)) == machine
    assert machine_text(machine).endswith(SEVERAL[1:])
    one = load(GANTRY + SEVERAL.replace('ty = "k*L*X"\n', "").replace(', L = "mm"', ""))
    assert (one.effects[-1].definition.component, one.effects[-1].definition.others) == ("rx", ())
    assert load(machine_text(one)) == one


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('rx = "k*X"', 'component = "rx"\nrx = "k*X"'),
        ('rx = "k*X"', 'rx = "k*X*L"'),
        ('ty = "k*L*X"', 'ty = "k*L*(X"'),
        ('ty = "k*L*X"', 'tu = "k*L*X"'),
        ('ty = "k*L*X"', 'ty = "k*X*X"'),
        ('name = "bent_column"', 'name = "backlash"'),
    ],
)
def test_error_of_an_effect_of_several_components_names_the_component(refuses, old: str, new: str) -> None:
    refuses(load, GANTRY + SEVERAL.replace(old, new))


SKY = '\n[[effect]]\nname = "mine"\n{}component = "rx"\nformula = "a*cos(azimuth)*z"\nparameters = {{ a = "{}" }}\n'


def test_zenith_angle_and_azimuth_are_words_where_directions_are_measured(refuses) -> None:
    machine = load(MOUNT + SKY.format("", "arcsec"))
    assert load(machine_text(machine)) == machine
    refuses(load, MOUNT + SKY.format("", "mm"))
    refuses(load, GANTRY + SKY.format("", "arcsec"))


# what is wrong with a file -------------------------------------------------------------------------------------------

TAIL = 'meaning    = "The coupling winds up under load."\n'
CUT = {  # whole blocks
    "units": '[units]                      # of every plain number in this file\nlength = "mm"\nangle  = "deg"\n',
    "joints": GANTRY[GANTRY.index("[[joint]]") : GANTRY.index("[[target]]")],
    "targets": GANTRY[GANTRY.index("[[target]]") : GANTRY.index("[measured]")],
    "measured": GANTRY[GANTRY.index("[measured]") : GANTRY.index("[estimate]")],
    "estimate": GANTRY[GANTRY.index("[estimate]") : GANTRY.index("[[effect]]")],
}


def effect(**keys: object) -> tuple[str, str]:
    """A third effect, after those of the file."""
    lines = "".join(f"{key} = {value}\n" for key, value in keys.items())
    return TAIL, f"{TAIL}[[effect]]\n{lines}"


def own(**keys: object) -> tuple[str, str]:
    """A third effect, of the user's own."""
    return effect(**({"name": '"mine"', "joint": '"C"', "component": '"reading"', "formula": '"a*q"'} | keys))


FAULTS = [
    # TOML
    ("axis   = [0, 0, 1]", "axis   = [0, 0, 1"),
    ('type   = "revolute"', "type   = revolute"),
    ("[measured]", "[units]"),
    ("noise = 0.002", "noise = 0.002\nnoise = 1"),
    ("noise = 0.002", f"noise = {'9' * 5000}"),
    ("noise = 0.002", f"noise = {'[' * 5000}"),
    # tables and keys
    (CUT["units"], ""),
    (CUT["joints"], ""),
    (CUT["targets"], ""),
    (CUT["measured"], ""),
    ('name = "Gantry with a rotary C axis"', ""),
    ('name = "Gantry with a rotary C axis"', 'name = ""'),
    ('name = "Gantry with a rotary C axis"', r'name = "a\nb"'),
    ("[environment]", "[enviroment]"),
    ("gravity = ", "gravitation = "),
    ("period = 360", "periode = 360"),
    ("period = 360", 'drive = "wrom"'),
    ("period = 360", 'encoder = "spindle"'),
    ("period = 360", "drive = 3"),
    ("period = 360", 'passive = "yes"'),
    ("period = 360", "period = 360\npassive = true"),
    ("period = 360", 'passive = true\nencoder = "motor"'),
    ("noise = ", "sigma = "),
    ('meaning    = ', 'meanings = '),
    (CUT["units"], "units = 3\n"),
    (CUT["measured"], '[[measured]]\nkind = "point"\n'),
    (CUT["targets"], '[target]\nname = "a"\n'),
    (CUT["units"], 'family = "tricept"\n'),
    ("[environment]", "[geometry]\nR = 1\n[environment]"),
    # units
    ('length = "mm"', ""),
    ('length = "mm"', 'length = "milimeter"'),
    ('angle  = "deg"', 'angle  = "mm"'),
    ('length = "mm"', 'length = "mm*1"'),
    ('length = "mm"', "length = 1"),
    # numbers and vectors
    ("gravity = [0, 0, -2]", "gravity = [0, 0, 0.0]"),
    ("= 21.5", '= "21.5"'),
    ("= 21.5", "= true"),
    ("noise = 0.002", "noise = nan"),
    ("noise = 0.002", "noise = 1979-05-27"),
    ("noise = 0.002", f"noise = 1{'0' * 400}"),
    ("noise = 0.002", "noise = 0"),
    ("point = [120, 0, 40]", "point = [120, 0, inf]"),
    ("point = [120, 0, 40]", ""),
    ("axis   = [0, 0, 1]", "axis = [0, 1]"),
    ("axis   = [0, 0, 1]", 'axis = ["0", 0, 1]'),
    ("axis   = [0, 0, 1]", 'axis = "z"'),
    ("travel = [-180, 180]", "travel = [180, -180]"),
    ("travel = [-180, 180]", "travel = [1e308, 2e308]"),
    ("travel = [-180, 180]", "travel = 360"),
    ("period = 360", "period = -1"),
    # names
    ('name   = "C"', ""),
    ('name   = "C"', 'name   = "X"'),
    ('name  = "ball_2"', 'name  = "ball_1"'),
    ('name  = "ball_2"', 'name  = "C"'),
    ('name   = "C"', 'name   = "load"'),
    ('name   = "C"', 'name   = "T_1"'),
    ('name   = "C"', 'name   = "C [deg]"'),
    ('name  = "ball_2"', 'name  = "a,b"'),
    ('name   = "C"', 'name   = "backlash"'),
    ('type   = "revolute"', 'type   = "rotary"'),
    ('type   = "revolute"', ""),
    # measured and estimate
    ('kind  = "point"', 'kind  = "position"'),
    ('frame = "machine"', ""),
    ('kind  = "point"', 'kind  = "point"\nfrom = [0, 0, 0]'),
    ('kind  = "point"', 'kind  = "distance"'),
    ('"C.axis"', '"C.axes"'),
    ('"C.axis"', '"Q.b"'),
    ('"C.axis"', '"C.point"'),
    ('"C.axis"', "3"),
    # effects
    effect(name='"backlsh"'),
    effect(name='"squareness"', joint='"C"'),
    effect(name='"radial_error_motion"', joint='"X"'),
    effect(name='"backlash"'),
    effect(name='"backlash"', joint='"Q"'),
    effect(name='"warm_up_drift"', joint='"C"'),
    effect(name='"target_offset"'),
    effect(name='"target_offset"', joint='"C"'),
    effect(name='"target_offset"', target='"ball"'),
    effect(name='"backlash"', joint='"C"', target='"ball_1"'),
    effect(name='"encoder_eccentricity"', joint='"C"'),
    effect(name='"axis_tilt"', joint='"C"'),
    effect(name='"squareness"', joint='"X"'),
    effect(name='"axis_offset"', joint='"C"'),
    effect(name='"refraction"'),
    effect(name='"backlash"', joint='"C"', hold="{ c = 1 }"),
    effect(name='"backlash"', joint='"C"', hold='{ b = "1" }'),
    effect(name='"backlash"', joint='"C"', hold="1"),
    effect(name='"warm_up_drift"', hold="{ tau = 0 }"),
    effect(name='"periodic_drive_error"', joint='"C"', hold="{ P = 1 }"),
    # effects of the user
    own(name='"backlash"'),
    own(name='"ball_1"', parameters='{ a = "1" }'),
    own(name='"two words"'),
    own(component='"twist"'),
    (TAIL, f'{TAIL}[[effect]]\nname = "mine"\ncomponent = "tx"\n'),
    (TAIL, f'{TAIL}[[effect]]\nname = "mine"\ncomponent = "reading"\nformula = "t"\n'),
    own(formula='"a*(q"'),
    own(formula='"__import__(q)"'),
    own(parameters='{ a = "arcmoon" }'),
    own(parameters='{ a = 1 }'),
    own(parameters='{ a = "1", b = "1" }'),
    own(parameters='{ q = "1", a = "1" }'),
    own(parameters='{ a = "mm" }'),
    own(formula='"a + F"', parameters='{ a = "arcsec" }'),
    own(formula='"a*x"', parameters='{ a = "arcsec" }'),
    (TAIL, f'{TAIL}[[effect]]\nname = "mine"\ncomponent = "tx"\nformula = "a*q"\nparameters = {{ a = "mm" }}\n'),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new"), FAULTS, ids=range(len(FAULTS)))
def test_error_is_one_line_with_its_place(refuses, old: str, new: str) -> None:
    assert GANTRY.count(old) == 1
    refuses(load, GANTRY.replace(old, new))


def test_word_of_formulas_that_is_also_a_joint_is_not_guessed_at(refuses) -> None:
    with_joint = GANTRY.replace('name   = "X"', 'name   = "F"').replace('"X.axis"', '"F.axis"')
    refuses(load, with_joint)
    without_word = with_joint.replace(" + k*F", "").replace(', k = "arcsec/N"', "")
    assert load(without_word).joints[0].name == "F"


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("radial_error_motion", "AZ"),
        ("axis_offset", "AZ"),
        ("instrument_scale", None),
        ("squareness", "focus"),
        ("backlash", "focus"),
    ],
)
def test_what_only_moves_changes_no_direction(refuses, name: str, place: str | None) -> None:
    mount = load(MOUNT)
    refuses(mount.with_effect, mount.effect(name, place))


@pytest.mark.parametrize(
    ("block", "most"),
    [("joint", 64), ("target", 1000), ("effect", 200)],
    ids=["joints", "targets", "effects"],
)
def test_number_of_blocks_is_limited(refuses, block: str, most: int) -> None:
    more = {
        "joint": '[[joint]]\nname = "J{}"\ntype = "revolute"\naxis = [0, 0, 1]\n',
        "target": '[[target]]\nname = "b{}"\npoint = [0, 0, 1]\n',
        "effect": '[[effect]]\nname = "e{}"\njoint = "C"\ncomponent = "reading"\nformula = "a"\n'
        'parameters = {{ a = "deg" }}\n',
    }[block]
    text = GANTRY + "".join(more.format(i) for i in range(most - 2))
    assert len(getattr(load(text), f"{block}s")) == most
    refuses(load, text + more.format("_last"))


@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xfen\x00",
        b'name = "a"\nx = "\xe9"',
        b"#" * 1_000_001,
        b"X [mm],Y [mm]\n1,2\n",
        b"",
        b"\x00\x01",
    ],
    ids=["utf-16", "latin-1", "large", "csv", "empty", "binary"],
)
def test_file_that_is_no_machine_file_says_what_it_is(refuses, tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "machine.toml"
    path.write_bytes(content)
    refuses(Machine.load, path)


def test_file_that_cannot_be_read_says_why(refuses, tmp_path: Path) -> None:
    refuses(Machine.load, tmp_path / "none.toml")
    refuses(Machine.load, tmp_path)
    refuses(Machine.load, "a\0b")


# fuzz ----------------------------------------------------------------------------------------------------------------

WORDS = [
    "[[effect]]", "[[joint]]", "[units]", "name", "=", '"', "'", '"""', "\n", "[", "]", "{", "}", ",", "#", ".", "0",
    "-1", "1e400", "nan", "inf", "true", "1979-05-27T07:32:00Z", '"C"', '"backlash"', "hold", "\\", "\\u0000", "\ufeff",
    "\0", "é", "axis", "formula", '"a**b**c**d"', "_", " ",
]  # fmt: skip


def machine_or_line(read: Callable[[Any], Machine], source: object) -> Machine | str:
    try:
        return read(source)
    except InputFileError as error:
        return str(error)


@st.composite
def mutations(draw: st.DrawFn) -> str:
    """A machine file with a few cuts, words put in and lines exchanged."""
    text = draw(st.sampled_from([GANTRY, MOUNT]))
    for _ in range(draw(st.integers(1, 4))):
        how = draw(st.sampled_from(["cut", "put", "replace", "swap"]))
        start = draw(st.integers(0, len(text)))
        stop = min(len(text), start + draw(st.integers(0, 40)))
        word = draw(st.sampled_from(WORDS) | st.text(max_size=6))
        if how == "cut":
            text = text[:start] + text[stop:]
        elif how == "put":
            text = text[:start] + word + text[start:]
        elif how == "replace":
            text = text[:start] + word + text[stop:]
        else:
            lines = text.splitlines(keepends=True)
            if lines:
                i, j = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
                lines[i], lines[j] = lines[j], lines[i]
            text = "".join(lines)
    return text


@given(mutations())
@settings(max_examples=280, deadline=None)
def test_any_text_is_a_machine_or_one_line(text: str) -> None:
    found = machine_or_line(load, text)
    if isinstance(found, Machine):
        assert load(machine_text(found)) == found
    else:
        assert found.startswith("machine.toml: ")
        assert found.isprintable()
        assert len(found) < 600


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.data())
@settings(max_examples=140, deadline=None)
def test_any_value_at_any_key_is_a_machine_or_one_line(data: st.DataObject) -> None:
    """Well-formed TOML, with one value replaced by anything."""
    document = tomllib.loads(data.draw(st.sampled_from([GANTRY, MOUNT])))
    holder = document
    while True:
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        key = data.draw(st.sampled_from(keys))
        if isinstance(holder[key], dict | list) and holder[key] and data.draw(st.booleans()):
            holder = holder[key]
            continue
        holder[key] = data.draw(JUNK.filter(lambda value: "None" not in repr(value)))
        break
    text = tomlkit.dumps(document)
    found = machine_or_line(load, text)
    assert isinstance(found, Machine) or found.isprintable()


# writing -------------------------------------------------------------------------------------------------------------

numbers = st.floats(-1e9, 1e9, allow_subnormal=False)
sizes = st.floats(1e-9, 1e9)
vectors = st.tuples(numbers, numbers, numbers)
directions = vectors.filter(lambda v: max(map(abs, v)) > 1e-6)
names = st.from_regex(r"[A-SW-Z][A-Za-z0-9]{0,5}([-+_ ][A-Za-z0-9]{1,4})?", fullmatch=True)


@st.composite
def machine_files(draw: st.DrawFn) -> str:
    """A random machine file, in random units, with effects wherever they can stand."""
    kind = draw(st.sampled_from(["point", "direction", "distance"]))
    every = draw(st.lists(names, min_size=2, max_size=6, unique=True))
    cut = draw(st.integers(1, len(every) - 1))
    length, angle = (
        draw(st.sampled_from(["mm", "m", "inch", "µm"])),
        draw(st.sampled_from(["deg", "rad", "arcsec"])),
    )
    title = draw(st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=20))
    document: dict[str, object] = {"name": title, "units": {"length": length, "angle": angle}}
    document["environment"] = {"gravity": draw(directions), "reference_temperature": draw(numbers)}
    document["joint"] = []
    for name in every[:cut]:
        joint = {
            "name": name,
            "type": draw(st.sampled_from(["prismatic", "revolute"])),
            "axis": draw(directions),
        }
        joint |= draw(st.fixed_dictionaries({}, optional={"point": vectors, "encoder": st.just("axis")}))
        hardware = {"period": sizes, "drive": st.sampled_from(DRIVES)}
        if draw(st.booleans()):
            hardware = {"passive": st.booleans()}
        joint |= draw(st.fixed_dictionaries({}, optional=hardware))
        if draw(st.booleans()):
            low = draw(st.floats(-1e6, 1e6))
            joint["travel"] = (low, low + draw(st.floats(1.0, 1e6)))
        document["joint"].append(joint)  # type: ignore[attr-defined]
    document["target"] = [{"name": name, "point": draw(directions)} for name in every[cut:]]
    document["measured"] = {"kind": kind, "frame": draw(st.sampled_from(["machine", "free"]))}
    document["measured"] |= {"from": draw(vectors)} if kind == "distance" else {}  # type: ignore[operator]
    document["measured"] |= draw(st.fixed_dictionaries({}, optional={"noise": sizes}))  # type: ignore[operator]
    return tomlkit.dumps(document)


@st.composite
def machines(draw: st.DrawFn) -> Machine:
    machine = load(draw(machine_files()))
    places = [None, *(joint.name for joint in machine.joints), *(target.name for target in machine.targets)]
    fitting = [(d, place) for place in places for d in CATALOGUE if machine.kind_of(place) in d.at]
    for _ in range(draw(st.integers(0, 5))):
        definition, place = draw(st.sampled_from(fitting))
        try:
            bare = machine.effect(definition.name, place)
            units = list(bare.units(machine))
            held = draw(st.dictionaries(st.sampled_from(units), sizes, max_size=2)) if units else {}
            machine = machine.with_effect(machine.effect(definition.name, place, hold=held))
        except InputFileError:
            continue
    if draw(st.booleans()):
        formula = draw(st.sampled_from(["a*t", "a*F/(1 + b*t)", "-a*exp(-b*t)**2"]))
        units = draw(st.sampled_from([{}, {"a": "arcsec", "b": "1/s"}, {"a": "mrad/h", "b": "1/min"}]))
        meaning = draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=20).filter(str.strip))
        kind = draw(st.sampled_from(["rx", "ry", "rz"]))
        place = draw(st.sampled_from([None, *(joint.name for joint in machine.joints)]))
        block = {"name": "mine", "component": kind, "formula": formula, "meaning": meaning}
        block["parameters"] = {name: unit for name, unit in units.items() if name in formula}
        block |= {"joint": place} if place else {}
        added = machine_or_line(load, machine_text(machine) + "\n" + tomlkit.dumps({"effect": [block]}))
        machine = added if isinstance(added, Machine) else machine
    return machine


@pytest.mark.thorough
@given(machines())
@settings(max_examples=120, deadline=None)
def test_machine_that_is_written_reads_back_equal(machine: Machine) -> None:
    text = machine_text(machine)
    assert load(text) == machine
    assert tomlkit.parse(text).unwrap() == tomllib.loads(text)  # two readers of TOML agree on it


def test_saved_file_is_as_a_person_would_write_it(tmp_path: Path) -> None:
    load(GANTRY).save(tmp_path / "out.toml")
    text = (tmp_path / "out.toml").read_text(encoding="utf-8")
    assert text.startswith(
        'name = "Gantry with a rotary C axis"\n\n[units]\nlength = "mm"\nangle = "deg"\n\n'
    )
    assert "travel = [-180, 180]\nperiod = 360\n" in text
    assert text.endswith(
        '[[effect]]\nname = "coupling_windup"\njoint = "C"\ncomponent = "reading"\nformula = "a*sin(q) + k*F"\n'
        'parameters = { a = "arcsec", k = "arcsec/N" }\nmeaning = "The coupling winds up under load."\n'
    )
    assert Machine.load(tmp_path / "out.toml") == load(GANTRY)


def test_file_that_cannot_be_written_is_an_error(refuses, tmp_path: Path) -> None:
    refuses(load(GANTRY).save, tmp_path / "no" / "out.toml")


@given(
    st.floats(
        allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300, allow_subnormal=False
    ),
    st.sampled_from([1.0, DEG, DEG / 3600, 1 / DEG]),
)
@settings(max_examples=400, deadline=None)
def test_decimal_gives_the_number_back(value: float, factor: float) -> None:
    """A quotient and a product are each off by half a unit in the last place: 2.2e-16 in all."""
    if abs(value) > 1e-290:
        assert float(decimal(value, factor)) * factor == pytest.approx(value, rel=2.3e-16, abs=0)


@given(st.decimals(-1000, 1000, places=4), st.sampled_from([1.0, DEG, DEG / 3600]))
@settings(max_examples=200, deadline=None)
def test_decimal_of_what_a_person_wrote_is_what_they_wrote(written: object, factor: float) -> None:
    value = float(str(written)) * factor
    text = decimal(value, factor)
    assert float(text) * factor == value
    assert float(text) == float(str(written))


# fitted numbers ------------------------------------------------------------------------------------------------------

FITTED = {
    "C.axis.a": 2e-4,
    "C.axis.b": -3e-4,
    "C.point.a": 0.25,
    "C.point.b": -0.5,
    "X.axis.a": 1e-3,
    "C.encoder_eccentricity.a": 12.5 * DEG / 3600,
    "C.coupling_windup.a": -1e-5,
    "C.coupling_windup.k": 3e-8,
    "frame.x": 1000.0,
}


def test_fixed_file_has_fitted_numbers_in_place(tmp_path: Path) -> None:
    """Against SciPy's rotations; u, v of z are x, y, and of x they are y, z."""
    replace(load(GANTRY), values=FITTED).save(tmp_path / "fixed.toml", fixed=True)
    fixed = Machine.load(tmp_path / "fixed.toml")
    assert fixed.joint("C").axis == pytest.approx(
        Rotation.from_rotvec([2e-4, -3e-4, 0]).apply([0, 0, 1]), abs=2e-16
    )
    assert fixed.joint("C").point == (1.75, -0.5, 0)
    assert fixed.joint("X").axis == pytest.approx(
        Rotation.from_rotvec([0, 1e-3, 0]).apply([1, 0, 0]), abs=2e-16
    )
    assert fixed.estimate == ()
    assert fixed.targets == load(GANTRY).targets
    eccentricity, windup = fixed.effects
    assert eccentricity.hold == {"a": pytest.approx(12.5 * DEG / 3600, rel=1e-15), "b": 0.5 * DEG}
    assert windup.hold == {"a": pytest.approx(-1e-5, rel=1e-15), "k": pytest.approx(3e-8, rel=1e-15)}
    assert "1000" not in (tmp_path / "fixed.toml").read_text(encoding="utf-8")


def test_fixed_targets(tmp_path: Path) -> None:
    values = {"target.ball_2.x": 0.5, "target.ball_2.z": -10.0}
    replace(load(GANTRY), values=values).save(tmp_path / "fixed.toml", fixed=True)
    assert Machine.load(tmp_path / "fixed.toml").target("ball_2").point == (-39.5, 85, 0)
    # The largest component of [0, 0.6, 0.8] is z: u is x, v = n × u.
    replace(load(MOUNT), values={"target.boresight.b": 0.1}).save(tmp_path / "fixed.toml", fixed=True)
    expected = Rotation.from_rotvec(0.1 * np.array([0, 0.8, -0.6])).apply([0, 0.6, 0.8])
    assert Machine.load(tmp_path / "fixed.toml").target("boresight").point == pytest.approx(
        expected, abs=3e-16
    )


def test_axis_along_whose_sides_an_effect_is_written_stays_and_gets_a_held_tilt(tmp_path: Path) -> None:
    machine = load(GANTRY)
    machine = machine.with_effect(machine.effect("radial_error_motion", "C"))
    replace(machine, values=FITTED).save(tmp_path / "fixed.toml", fixed=True)
    fixed = Machine.load(tmp_path / "fixed.toml")
    assert fixed.joint("C").axis == (0, 0, 1)
    tilt = fixed.effects[0]
    assert (tilt.name, tilt.place) == ("axis_tilt", "C")
    assert tilt.hold == {"a": pytest.approx(2e-4, rel=1e-15), "b": pytest.approx(-3e-4, rel=1e-15)}


def test_fixed_file_needs_the_travel_that_an_effect_is_measured_over(refuses, tmp_path: Path) -> None:
    machine = load(GANTRY)
    machine = machine.with_effect(machine.effect("straightness", "X"))
    machine.save(tmp_path / "fixed.toml", fixed=True)
    x = replace(machine.joint("X"), travel=None)
    refuses(replace(machine, joints=(x, machine.joint("C"))).save, tmp_path / "fixed.toml", fixed=True)


def test_searched_parameter_without_a_value_is_left_to_be_searched(tmp_path: Path) -> None:
    machine = load(GANTRY)
    machine = machine.with_effect(machine.effect("warm_up_drift"))
    machine.save(tmp_path / "fixed.toml", fixed=True)
    assert Machine.load(tmp_path / "fixed.toml").effects[-1].hold == {"x": 0, "y": 0, "z": 0}


def test_frame_shift_of_each_run_is_no_property_of_the_machine(tmp_path: Path) -> None:
    machine = load(GANTRY)
    machine = machine.with_effect(machine.effect("frame_shift"))
    for values, held in (({"frame_shift[2].x": 0.5}, False), ({"frame_shift.x": 0.5}, True)):
        replace(machine, values=values).save(tmp_path / "fixed.toml", fixed=True)
        hold = Machine.load(tmp_path / "fixed.toml").effects[-1].hold
        assert (hold.get("x"), bool(hold)) == ((0.5, True) if held else (None, False))


# effects come and go --------------------------------------------------------------------------------------------------


def test_effect_is_added_after_the_others_and_taken_away_again() -> None:
    machine = replace(load(GANTRY), values={"C.backlash.b": 1.0, "C.axis.a": 2.0})
    larger = machine.with_effect(machine.effect("backlash", "C", hold={"b": 0.01}))
    assert [e.title for e in larger.effects] == [
        "encoder_eccentricity at C",
        "coupling_windup at C",
        "backlash at C",
    ]
    assert larger.effects[-1].hold == {"b": 0.01 * DEG}
    smaller = larger.without_effect("backlash", "C")
    assert smaller.effects == machine.effects
    assert smaller.values == {"C.axis.a": 2.0}


def test_unknown_names_are_an_error(refuses) -> None:
    machine = load(GANTRY)
    refuses(machine.joint, "B")
    refuses(machine.target, "ball")
    refuses(machine.without_effect, "backlash", "C")


# edits of a user's file -----------------------------------------------------------------------------------------------


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_bytes(GANTRY.encode())
    return path


def written(out: Path, text: str) -> Machine:
    out.write_bytes(text.encode())
    return Machine.load(out)


def add(path: Path, name: str, place: str | None = None, **hold: float) -> Machine:
    machine = Machine.load(path)
    return written(path, edited_text(path, machine.with_effect(machine.effect(name, place, hold=hold))))


def remove(path: Path, name: str, place: str | None = None) -> Machine:
    return written(path, edited_text(path, Machine.load(path).without_effect(name, place)))


def test_added_block_leaves_every_byte_before_it(path: Path, tmp_path: Path) -> None:
    effect = Machine.load(path).effect("backlash", "C", hold={"b": 0.01})
    machine = written(tmp_path / "out.toml", edited_text(path, Machine.load(path).with_effect(effect)))
    added = '\n[[effect]]\nname = "backlash"\njoint = "C"\nhold = { b = 0.01 }\n'
    assert (tmp_path / "out.toml").read_bytes() == (GANTRY + added).encode()
    assert path.read_bytes() == GANTRY.encode()
    assert machine == Machine.load(path).with_effect(effect)
    assert machine.file == str(tmp_path / "out.toml")


def test_added_and_removed_is_the_same_file(path: Path) -> None:
    add(path, "backlash", "X")
    add(path, "target_offset", "ball_1")
    add(path, "warm_up_drift", None, tau=60)
    remove(path, "target_offset", "ball_1")
    remove(path, "warm_up_drift", None)
    remove(path, "backlash", "X")
    assert path.read_bytes() == GANTRY.encode()


def test_windows_file_stays_one(path: Path) -> None:
    path.write_bytes(b"\xef\xbb\xbf" + GANTRY.replace("\n", "\r\n").encode())
    add(path, "backlash", "C")
    assert path.read_bytes().endswith(
        b'under load."\r\n\r\n[[effect]]\r\nname = "backlash"\r\njoint = "C"\r\n'
    )
    assert path.read_bytes().startswith(b"\xef\xbb\xbf# A portal")
    remove(path, "backlash", "C")
    assert path.read_bytes() == b"\xef\xbb\xbf" + GANTRY.replace("\n", "\r\n").encode()


def test_removed_block_takes_its_own_comments_and_leaves_those_of_others(path: Path) -> None:
    head = GANTRY[: GANTRY.index("[[effect]]")]
    text = head + (
        "# --- effects ---\n"
        "[[effect]]      # first\n"
        'name = "backlash"   # since the service\n'
        "# the lost motion\n"
        'joint = "X"\n'
        "# hold = { b = 0 }\n"
        "\n"
        "# seen in May\n"
        "[[effect]]\n"
        'name = "backlash"\n'
        'joint = "C"\n'
        "[effect.hold]   # by hand\n"
        "b = 1\n"
        "# of the scale\n"
        "[[effect]]\n"
        'name = "encoder_eccentricity"\n'
        'joint = "C"\n'
        "# the end\n"
    )
    path.write_text(text, encoding="utf-8")
    remove(path, "backlash", "X")
    first = text.replace(text[text.index("[[effect]]      # first") : text.index("# seen in May")], "")
    assert path.read_text(encoding="utf-8") == first
    remove(path, "backlash", "C")
    second = first.replace(first[first.index("[[effect]]") : first.index("# of the scale")], "")
    assert path.read_text(encoding="utf-8") == second
    remove(path, "encoder_eccentricity", "C")
    assert path.read_text(encoding="utf-8") == head + "# --- effects ---\n# seen in May\n# of the scale\n"


def test_blocks_may_stand_anywhere_between_others(path: Path) -> None:
    """A layout that TOML allows: effects before the joints, their tables elsewhere, headers inside texts."""
    trap = '"""\n[[effect]]\nname = "backlash" \\"""""'
    text = (
        'name = "trap [[effect]]"\n'
        '[[ "effect" ]]\nname = "backlash"\njoint = "C"\n\n'
        + GANTRY[GANTRY.index("[units]") : GANTRY.index("[[effect]]")]
        + '\n[effect.hold]\nb = 0.5\n\n[[effect]]\nname = "mine"\ncomponent = "tx"\nformula = "a"\n'
        f"parameters.a = 'mm'\nmeaning = {trap} # [[effect]]\n"
    )
    path.write_text(text, encoding="utf-8")
    before = Machine.load(path)
    assert [e.title for e in before.effects] == ["backlash at C", "mine"]
    add(path, "backlash", "X")
    assert path.read_text(encoding="utf-8") == text + '\n[[effect]]\nname = "backlash"\njoint = "X"\n'
    remove(path, "backlash", "X")
    assert path.read_text(encoding="utf-8") == text
    after = remove(path, "backlash", "C")
    assert after == before.without_effect("backlash", "C")
    assert "hold" not in path.read_text(encoding="utf-8").replace("hold a", "")
    remove(path, "mine", None)
    assert "[[" not in path.read_text(encoding="utf-8").split("[units]")[0].replace("trap [[effect]]", "")


def test_first_block_goes_to_the_end(path: Path) -> None:
    path.write_text(MOUNT.rstrip("\n"), encoding="utf-8")
    add(path, "refraction")
    assert path.read_text(encoding="utf-8") == MOUNT + '\n[[effect]]\nname = "refraction"\n'


def test_effects_in_line_are_not_edited(refuses, path: Path) -> None:
    text = 'effect = [{ name = "backlash", joint = "C" }]\n' + GANTRY[: GANTRY.index("[[effect]]")]
    path.write_text(text, encoding="utf-8")
    refuses(add, path, "backlash", "X")
    refuses(remove, path, "backlash", "C")
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.thorough
@given(st.data())
@settings(max_examples=80, deadline=None)
def test_edits_of_any_layout_do_what_they_say(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Comments, blanks and new lines between all statements; only the block in question comes or goes."""
    filler = st.sampled_from(["", "", "\n", "\n\n", "# a [[effect]]\n", "  # ]]\n", "\t\n", '#\'"""\n'])
    lines = [line + data.draw(filler) for line in GANTRY.splitlines(keepends=True)]
    path = tmp_path_factory.getbasetemp() / "layout.toml"
    text = "".join(lines)
    path.write_text(text, encoding="utf-8")
    machine = Machine.load(path)
    out = path.with_name("layout_out.toml")
    added = written(out, edited_text(path, machine.with_effect(machine.effect("backlash", "X"))))
    assert added == machine.with_effect(machine.effect("backlash", "X"))
    removed = written(out, edited_text(path, machine.without_effect("encoder_eccentricity", "C")))
    assert removed == machine.without_effect("encoder_eccentricity", "C")
    kept = out.read_text(encoding="utf-8").splitlines()
    whole = text.splitlines()
    assert len(whole) - len(kept) >= 4
    start = next((i for i, (a, b) in enumerate(zip(whole, kept, strict=False)) if a != b), len(kept))
    assert whole[start + len(whole) - len(kept) :] == kept[start:]  # one piece was cut out, no more
