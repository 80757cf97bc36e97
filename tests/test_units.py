"""Units: the table of everyday names agrees with Pint, and every bad text has its sentence."""

import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rodgen.data import units
from rodgen.data.units import (
    ANGLE,
    FORCE,
    LENGTH,
    ONE,
    TEMPERATURE,
    TIME,
    Dimension,
    UnitError,
    conversion_factor,
    display_unit,
    parse_unit,
    unit_factor,
)


@pytest.mark.parametrize("text", ["rev/min", "rpm", "turn/min"])
def test_a_rate_may_be_in_turns_a_minute(text):
    assert conversion_factor(text, "rate", "rad/s") == pytest.approx(2 * math.pi / 60, rel=1e-15)


@pytest.mark.parametrize("name", sorted((units._EVERYDAY.keys() | units._PI_PARTS.keys()) - {"1", "°C"}))
def test_everyday_names_mean_what_pint_says(name):
    registry = units._registry()
    size, root = registry.get_root_units(registry.parse_units(name))
    unit = parse_unit(name)
    # Pint reckons mass in grams, and a mass is a force over an acceleration here
    powers = {
        "meter": LENGTH,
        "radian": ANGLE,
        "second": TIME,
        "kelvin": TEMPERATURE,
        "gram": FORCE * TIME**2 / LENGTH,
    }
    expected = ONE
    for base, power in root._units.items():
        expected *= powers[base] ** power
    assert unit.dimension == expected
    # to rounding
    assert unit.factor("m") == pytest.approx(float(size) / 1000.0 ** root._units.get("gram", 0), rel=1e-15)


@pytest.mark.parametrize(
    ("text", "length", "factor", "dimension"),
    [
        ("mm", "mm", 1.0, LENGTH),
        ("um", "mm", 1e-3, LENGTH),
        ("inch", "mm", 25.4, LENGTH),
        ("m", "inch", 1 / 0.0254, LENGTH),
        ("deg", "mm", math.pi / 180, ANGLE),
        ("arcsec", "m", math.pi / 648000, ANGLE),
        ("°", "mm", math.pi / 180, ANGLE),
        ("rpm", "mm", math.tau / 60, ANGLE / TIME),
        ("arcsec/N/mm", "mm", math.pi / 648000, ANGLE / FORCE / LENGTH),
        ("arcsec/N/m", "mm", math.pi / 648000000, ANGLE / FORCE / LENGTH),
        ("um/m", "mm", 1e-6, ONE),
        ("1/K", "mm", 1.0, ONE / TEMPERATURE),
        ("1", "mm", 1.0, ONE),
        ("arcsec/1", "mm", math.pi / 648000, ANGLE),
        ("%", "mm", 0.01, ONE),
        ("percent", "mm", 0.01, ONE),
        ("mm/degC", "mm", 1.0, LENGTH / TEMPERATURE),
        ("um/°C", "mm", 1e-3, LENGTH / TEMPERATURE),
        ("kgf", "mm", 9.80665, FORCE),
        ("kg*m/s**2", "mm", 1.0, FORCE),
        ("kg·m/s²", "mm", 1.0, FORCE),
        ("N*m", "mm", 1000.0, FORCE * LENGTH),
        ("J", "mm", 1000.0, FORCE * LENGTH),
        ("MPa", "mm", 1.0, FORCE / LENGTH**2),
        ("kg", "m", 1.0, FORCE * TIME**2 / LENGTH),
        ("mm / s ^ 2", "mm", 1.0, LENGTH / TIME**2),
        ("V", "m", 1.0, FORCE * LENGTH / TIME * Dimension((("ampere", -1),))),
        ("mA", "mm", 1e-3, Dimension((("ampere", 1),))),
        ("V*A", "m", 1.0, FORCE * LENGTH / TIME),
        (" mm ", "mm", 1.0, LENGTH),
        ("μm", "mm", 1e-3, LENGTH),
    ],
)  # fmt: skip
def test_a_unit_has_a_factor_and_a_dimension(text, length, factor, dimension):
    found, its = unit_factor(text, length)
    assert its == dimension
    # products and quotients of a few numbers
    assert found == pytest.approx(factor, rel=1e-15)


def test_a_unit_that_is_the_files_own_is_not_rounded():
    assert all(parse_unit(unit).factor(unit) == 1.0 for unit in ("mm", "um", "inch", "ft", "yard", "m"))
    assert parse_unit("deg").factor() == math.pi / 180
    assert [parse_unit(unit).factor("mm") for unit in ("um", "inch", "m")] == [1e-3, 25.4, 1000.0]


@pytest.mark.parametrize(
    ("text", "zero"), [("degC", 0), ("°C", 0), ("degF", -160 / 9), ("fahrenheit", -160 / 9)]
)
def test_a_temperature_with_its_own_zero_differs_from_a_difference(text, zero):
    unit = parse_unit(text)
    assert float(unit.zero) == pytest.approx(zero, rel=1e-15)
    assert parse_unit(f"mm/{text}").zero is None
    assert parse_unit("K").zero is None
    assert parse_unit("delta_degC").zero is None


BAD = [
    "",
    "   ",
    "(mm)",
    "arcsec/(N*mm)",
    "N m",
    "Deg",
    "'mm'",
    "mm/",
    "arcse",
    "frobs",
    "10 mm",
    "1e3*mm",
    "mm**10",
    "9**9**9**9",
    "mm.real",
    "__import__('os')",
    "dB",
    "m\0m",
    "m" * 61,
    "Ym**9*Ym**9*Ym**9*Ym**9",
    "ym**9*ym**9*ym**9*ym**9",
]


@pytest.mark.parametrize("text", BAD)
def test_a_bad_unit_is_reported_in_one_sentence(refuses, text):
    refuses(parse_unit, text)


@settings(max_examples=120, deadline=None)
@given(
    st.one_of(
        st.text(max_size=70),
        st.lists(
            st.sampled_from([*"mNsK1*/^()-29 °%µ", "arcsec", "deg", "**", "dB", "kg", "inch"]), max_size=14
        ).map("".join),
    )
)
def test_any_text_is_a_unit_or_one_sentence(text):
    try:
        unit = parse_unit(text)
    except UnitError as error:
        message = str(error)
        assert message.isprintable() and "; expected " in message  # noqa: PT018
    else:
        assert 0 < unit.factor("mm") < math.inf


POWERS = st.integers(-2, 2)


@settings(max_examples=80, deadline=None)
@given(
    POWERS,
    POWERS,
    POWERS,
    POWERS,
    POWERS,
    st.sampled_from(["mm", "m", "inch"]),
    st.sampled_from(["arcsec", "deg"]),
)
def test_a_display_unit_reads_back_as_itself(
    length, angle, time, temperature, force, length_unit, angle_unit
):
    dimension = LENGTH**length * ANGLE**angle * TIME**time * TEMPERATURE**temperature * FORCE**force
    shown = display_unit(dimension, length_unit, angle_unit)
    read = parse_unit(shown.text)
    assert shown.dimension == read.dimension == dimension
    # the same few factors in another order
    assert shown.factor(length_unit) == pytest.approx(read.factor(length_unit), rel=1e-14)


@pytest.mark.parametrize(
    ("text", "display"),
    [
        ("deg/kN/m", "arcsec/N/mm"),
        ("um/degC", "mm/K"),
        ("m/s", "mm/s"),
        ("%", "1"),
        ("1/degC", "1/K"),
        ("deg/kg", "arcsec/kg"),
        ("t", "kg"),
        ("pixel", "pixel"),
        ("min", "s"),
        ("rpm", "arcsec/s"),
    ],
)
def test_a_dimension_is_shown_as_a_mechanic_writes_it(text, display):
    assert display_unit(parse_unit(text).dimension, "mm").text == display


def test_a_root_of_a_unit_has_a_display():
    shown = display_unit(LENGTH ** Fraction(1, 2), "um")
    assert shown.text == "um**0.5"
    assert shown.factor("um") == pytest.approx(1.0, rel=1e-15)


def test_angles_are_as_good_as_plain_numbers():
    assert ANGLE.fits(ONE)
    assert (ANGLE * LENGTH).fits(LENGTH)
    assert not LENGTH.fits(FORCE)
    assert str(ONE) == "a plain number"
    assert str(ANGLE / FORCE / LENGTH) == "angle/force/length"
    assert str(ONE / TIME) == "1/time"
