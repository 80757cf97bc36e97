"""Formulas: every text is a formula or one sentence about what is wrong with it, and neither takes long."""

import ast
import builtins
import math
import pickle
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rodgen.codegen.tape import Tape
from rodgen.data.units import ANGLE, FORCE, LENGTH, ONE, TEMPERATURE, TIME, parse_unit
from rodgen.errors import InputFileError
from rodgen.machines.algebra import on_tape
from rodgen.machines.effects.formula import FUNCTION_NAMES, Formula, FormulaError

PYTHON = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")} | {
    "abs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
}
SYMPY = {name: getattr(sp, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "sign")} | {
    "abs": sp.Abs
}
VALUES = {"a": 0.7, "b": -1.3, "q": 2.1, "F": 5.0, "x_2": 0.25, "pi": math.pi}


def parse(text):
    return Formula.parse(text, file="machine.toml", place="effect 1, formula")


def value(formula, **names):
    return formula.evaluate(VALUES | names, PYTHON, float)


# what is a formula -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "written", "expected"),
    [
        ("a*sin( 2*q )+b * F", "a*sin(2*q) + b*F", 0.7 * math.sin(4.2) - 6.5),
        ("-a**2", "-a**2", -0.49),
        ("(-a)**2", "(-a)**2", 0.49),
        ("2^3^2", "2**3**2", 512.0),
        ("(2**3)**2", "(2**3)**2", 64.0),
        ("2**-1**2", "2**-1**2", 0.5),
        ("a - b - q", "a - b - q", 0.7 + 1.3 - 2.1),
        ("a - (b - q)", "a - (b - q)", 0.7 + 1.3 + 2.1),
        ("a/b/q", "a/b/q", 0.7 / -1.3 / 2.1),
        ("a/(b*q)", "a/(b*q)", 0.7 / (-1.3 * 2.1)),
        ("a*-b", "a*-b", 0.91),
        ("-(a + b)*q", "-(a + b)*q", 0.6 * 2.1),
        ("--a", "--a", 0.7),
        ("((a))", "a", 0.7),
        (".5 + 5. + 1e-3 + 2E+2", "0.5 + 5 + 0.001 + 200", 205.501),
        ("1e20*0e9 + 1.50e-9", "1e20*0 + 1.5e-9", 1.5e-9),
        ("q/exp(-36)", None, 2.1 * math.exp(36)),
        ("sign(b) + abs(b) + sqrt(q*q) + tan(0) + exp(0) + log(1) + cos(pi)", None, -1 + 1.3 + 2.1 + 1 - 1),
        ("x_2\t*\na", "x_2*a", 0.175),
    ],
)
def test_a_formula_is_worth_what_python_says(text, written, expected):
    formula = parse(text)
    assert formula.text == (written or text)
    # a handful of operations on numbers of order one
    assert value(formula) == pytest.approx(expected, rel=1e-14)


LEAVES = st.sampled_from(["a", "b", "q", "F", "x_2", "pi", "2", "3", "0.5", "1e-3", "12.25", "7"])
TEXTS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds("{}({})".format, st.sampled_from(sorted(FUNCTION_NAMES)), inner),
        st.builds("({}){}({})".format, inner, st.sampled_from("+-*/"), inner),
        st.builds("{}{}{}".format, inner, st.sampled_from(["+", " - ", "*", "/"]), inner),
        st.builds("({})**{}".format, inner, st.sampled_from(["2", "-3", "0.5", "(1/3)", "a"])),
        st.builds("-{}".format, inner),
        st.builds("(-{})".format, inner),
    ),
    max_leaves=12,
)


@settings(max_examples=160, deadline=None)
@given(TEXTS)
def test_a_formula_is_worth_what_python_makes_of_its_text(text):
    try:
        formula = parse(text)
    except InputFileError:
        return  # a constant that is not a number, or too high a power: tested below
    try:
        expected = eval(text, {"__builtins__": {}}, PYTHON | VALUES)
    except (ArithmeticError, ValueError, TypeError):  # TypeError: the cosine of a complex root
        return
    if isinstance(expected, complex) or not 1e-150 < abs(expected) < 1e150:
        return
    # both do the same operations in the same order
    assert value(formula) == pytest.approx(expected, rel=1e-13)


@settings(max_examples=160, deadline=None)
@given(TEXTS)
@example("-(-a)**-(-b)")
@example("a - (b + (q - F))/(a/b)*(a*b)**(a**b)")
def test_a_formula_that_is_written_reads_back_as_the_same_tree(text):
    try:
        formula = parse(text)
    except InputFileError:
        return
    assert parse(formula.text) == formula
    assert parse(formula.text).text == formula.text
    assert pickle.loads(pickle.dumps(formula)) == formula


@settings(max_examples=80, deadline=None)
@given(st.fractions(min_value=Fraction(1, 10**30), max_value=10**30), st.integers(-260, 260))
def test_a_number_is_read_and_written_exactly(mantissa, exponent):
    digits = f"{mantissa.numerator % 10**30 + 1}e{exponent}"
    formula = parse(digits)
    read = formula.evaluate({}, {}, lambda x: x)
    assert read == Fraction(digits)
    assert parse(formula.text).evaluate({}, {}, lambda x: x) == read


def test_it_is_evaluated_with_whatever_its_operands_are():
    formula = parse("a*sin(2*q) + q**2/3")
    q = np.linspace(0.0, 6.0, 7)
    arrays = formula.evaluate({"a": 0.7, "q": q}, {"sin": np.sin}, float)
    np.testing.assert_allclose(arrays, 0.7 * np.sin(2 * q) + q**2 / 3, rtol=1e-15)
    a, x = sp.symbols("a q")
    symbolic = formula.evaluate(
        {"a": a, "q": x}, {"sin": sp.sin}, lambda n: sp.Rational(n.numerator, n.denominator)
    )
    assert symbolic == a * sp.sin(2 * x) + x**2 / 3
    assert formula.names == {"a", "q"}
    assert parse("2*pi").names == {"pi"}


def test_nothing_of_a_formula_is_run_as_code(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("code was run")

    def only_parse(source, filename, mode, flags=0, **options):
        assert flags & ast.PyCF_ONLY_AST
        return compiled(source, filename, mode, flags, **options)

    compiled = compile
    monkeypatch.setattr(builtins, "compile", only_parse)
    for name in ("eval", "exec", "__import__"):
        monkeypatch.setattr(builtins, name, refuse)
    formula = parse("a*sin(q) + b/2 - 3*F")
    assert value(formula) == pytest.approx(0.7 * math.sin(2.1) - 0.65 - 15.0, rel=1e-14)


def test_reading_a_formula_needs_neither_sympy_nor_pint():
    program = (
        "import sys; from rodgen.machines.effects.formula import Formula; from rodgen.data.units import parse_unit;"
        "Formula.parse('a*sin(q)', file='f', place='p'); parse_unit('arcsec/N/mm').factor('mm');"
        "print([m for m in ('sympy', 'pint') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# what is none --------------------------------------------------------------------------------------------------

BAD = {
    "empty": "",
    "blank": " \t\n",
    "implicit product": "2q",
    "product by a blank": "a q",
    "name before number": "q 2",
    "number before parenthesis": "2(q)",
    "parentheses side by side": "(a)(b)",
    "half an exponent": "1e",
    "two points": "1.2.3",
    "never closed": "a*(b+2",
    "never opened": "a)",
    "call never closed": "sin(q",
    "no operand": "a+",
    "no first operand": "*a",
    "plus as sign": "+a",
    "two operators": "a*/b",
    "whole division": "a//b",
    "only a sign": "-",
    "nothing inside": "()",
    "no argument": "sin()",
    "unknown function": "sine(q)",
    "capital function": "Cos(q)",
    "name called": "q(2)",
    "bare function": "a*sin",
    "function of a blank": "sin q",
    "two arguments": "log(a, b)",
    "decimal comma": "1,5*q",
    "attribute": "q.real",
    "method": "q.__class__()",
    "dunder": "__import__('os')",
    "underscores in a number": "1_000",
    "string": "'a'",
    "double quotes": '"a"',
    "comparison": "a<b",
    "assignment": "x=a",
    "factorial": "5!",
    "condition": "a if b else q",
    "logic": "a and b",
    "complement": "~q",
    "lambda": "lambda x: x",
    "index": "q[0]",
    "braces": "{a}",
    "statement": "a; b",
    "remainder": "a%b",
    "matrix product": "a@b",
    "backslash": "a\\b",
    "square sign": "q²",
    "greek pi": "2*π",
    "raised dot": "a·b",
    "typographic minus": "a−b",
    "root sign": "√(a)",
    "cyrillic a": "\u0430*q",
    "letter like a function": "s\u0456n(q)",
    "wide digit": "１*q",
    "accent": "Öl*a",
    "nothing to see": "q\u200b",
    "null": "a\0",
    "tower": "9**9**9",
    "tower of carets": "9^9^9^9",
    "high power": "q**21",
    "low power": "q**-21",
    "large number": "1e999",
    "larger number": "1e99999999999",
    "small number": "q+1e-999",
    "large product": "1e200*1e200",
    "large exponential": "exp(1000)",
    "small exponential": "q/exp(-800)",
    "product of small": "q + exp(-400)*exp(-400)",
    "small quotient": "exp(-400)/exp(400)",
    "power of small": "exp(-40)**20",
    "many digits": "1" * 41,
    "division by zero": "a/(2 - 2)",
    "division by rounded zero": "1/sin(pi)",
    "power of zero": "0**-1",
    "root of minus one": "sqrt(-1)",
    "complex power": "(-8)**(1/3)",
    "negative base": "(-2)**q",
    "logarithm of zero": "log(0)",
    "pole": "tan(pi/2)",
    "deep": "(" * 41 + "a" + ")" * 41,
    "many signs": "-" * 60 + "a",
    "many terms": "+".join("a" * 151),
    "long name": "a" * 61,
    "long": " " * 2000 + "a",
    "long when written": "+".join(["a" * 14] * 133),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_formula_is_reported_in_one_sentence(refuses, case):
    refuses(parse, BAD[case])


@pytest.mark.parametrize(
    "text",
    [
        "(" * 39 + "a" + ")" * 39,
        "+".join("a" * 150),
        "a" * 60,
        "q**20",
        "(q**20)**20",
        "9" * 40,
        "a" + " " * 1999,
        "1e300*q",
        "-1e-300*q",
        "0*exp(-400) + 0/exp(400) + 0**20*q",
        "2**(F/300)",
        "exp(-log(q)**2/2)",
        "a*(1 - exp(-q/b))",
        "0*a",
        "a**b**q",
        "(((2*q)**20)**20)**20",
        "(2*q)**(10**9*a/a)",
        "exp(10**9*log(2*q))",
        "exp(1e-9*log(3))",
        "3**-1e-9",
        "3**-sqrt(1e-18)",
    ],
)
def test_what_is_just_within_the_limits_is_a_formula(text):
    formula = parse(text)
    assert parse(formula.text) == formula


PIECES = st.one_of(
    st.sampled_from("abqxF0123456789.+-*/^()eE "),
    st.sampled_from(["**", "sin", "cos(", "log(", "exp(", "sqrt(", "pi", "1e9", "9**9", "1e-300"]),
    st.sampled_from(["²", "\u0430", "\n", "__", "'", ",", "lambda", "\U0001f600", "\ud800", "\0"]),
)


@settings(max_examples=600, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(st.text(max_size=80), st.lists(PIECES, max_size=60).map("".join)))
@example("(" * 2000)
@example("-" * 2000)
@example("9" * 2000)
@example("1e" + "9" * 1998)
@example("(9**9)**" * 200 + "9")
@example("sin(" * 400)
@example("2**" * 600 + "2")
def test_any_text_is_a_formula_or_one_sentence(text):
    try:
        formula = parse(text)
    except InputFileError as error:
        text = str(error)
        assert text.isprintable() and "; expected " in text  # noqa: PT018
    else:
        assert parse(formula.text) == formula


GROWTH = st.recursive(
    st.sampled_from(["a", "q", "2", "20", "9", "0.5", "1e9", "1e-9", "1e300", "1/3", "pi", "7"]),
    lambda inner: st.one_of(
        st.builds("({})**({})".format, inner, inner),
        st.builds("({}){}({})".format, inner, st.sampled_from("*/-+"), inner),
        st.builds("{}({})".format, st.sampled_from(["exp", "log", "sqrt", "abs", "sin"]), inner),
    ),
    max_leaves=12,
)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(GROWTH)
@example("(((2*a)**10)**10)**10")
@example("9**(20*a/a)")
@example("exp(20*log(9*exp(20*log(2*a))))")
@example("(0.5/20)**(1e-9/2)")
@example("sqrt((20**7*abs(q))**(-9)**-9)")
@example("exp(1e-9**1)/(1/3 + 1e-9)**1e-9**3")
def test_what_is_accepted_is_soon_on_a_tape(text):
    """Constants of a tape are exact: 9**9**9**9 would never end."""
    try:
        formula = parse(text)
    except InputFileError:
        return
    algebra = on_tape(Tape())
    names = sorted(formula.names)
    numbers = algebra.builder("").input("x", (len(names),), unit="", doc="")
    symbols = dict(zip(names, numbers, strict=True))
    formula.evaluate(symbols | {"pi": algebra.pi}, algebra.functions, algebra.number)


# units ---------------------------------------------------------------------------------------------------------

DIMENSIONS = {
    "q": ANGLE, "x": LENGTH, "t": TIME, "T": TEMPERATURE, "F": FORCE, "n": ONE, "u": None,
    "a": ANGLE, "k": ANGLE / FORCE, "alpha": ONE / TEMPERATURE, "v": LENGTH / TIME, "tau": TIME,
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a*sin(q) + k*F", ANGLE),
        ("alpha*T*x", LENGTH),
        ("x + 3", LENGTH),
        ("3 + x", LENGTH),
        ("2*pi - x", LENGTH),
        ("-tau*v", LENGTH),
        ("a*(1 - exp(-t/tau))", ANGLE),
        ("x*q + x", LENGTH * ANGLE),
        ("q + n", ANGLE),
        ("sqrt(x*x)", LENGTH),
        ("x**2/abs(x)", LENGTH),
        ("x**(1/2)*x**0.5", LENGTH),
        ("sign(x)*F", FORCE),
        ("n**q", ONE),
        ("2**n*x", LENGTH),
        ("sin(x/x)", ONE),
        ("(1 + 2)*3", ONE),
        ("u*x", None),
        ("u + x", LENGTH),
        ("x + u**2", LENGTH),
        ("sin(u)*x", LENGTH),
        ("u**n", None),
        ("x**-2", LENGTH**-2),
    ],
)
def test_a_formula_has_the_dimension_of_its_value(text, expected):
    assert parse(text).dimension(DIMENSIONS | {"pi": ONE}) == expected


@pytest.mark.parametrize(
    ("text", "found", "expected"),
    [
        ("x + a", "'x + a' of length and angle", "two of one kind"),
        ("x - t*F", "'x - t*F' of length and force*time", "two of one kind"),
        ("a*sin(x)", "'sin(x)', sin of length", "an angle or a plain number inside"),
        ("exp(t)", "'exp(t)', exp of time", "an angle or a plain number inside"),
        ("n**x", "exponent 'x', length", "a plain number"),
        ("x**n", "'x**n', a power of length with an exponent that is not a number", "a plain number as base"),
        ("u*(x + t)", "'x + t' of length and time", "two of one kind"),
        ("x + F*(1 + 2)", "'x + F*(1 + 2)' of length and force", "two of one kind"),
    ],
)
def test_dimensions_that_do_not_fit_are_reported(text, found, expected):
    with pytest.raises(FormulaError) as caught:
        parse(text).dimension(DIMENSIONS)
    assert caught.value.found == found
    assert expected in caught.value.expected
    assert str(caught.value) == f"{caught.value.found}; expected {caught.value.expected}"


def test_every_dimension_comes_out_as_if_the_units_were_calculated():
    """The factor of a formula's value, computed with numbers that are all one unit, is that of its dimension."""
    units = {"a": "arcsec/N", "F": "kN", "x": "m", "k": "1/um"}
    factors = {name: parse_unit(unit).factor("mm") for name, unit in units.items()}
    dimension = parse("a*F*k*x**2").dimension(
        {name: parse_unit(unit).dimension for name, unit in units.items()}
    )
    assert dimension == ANGLE * LENGTH
    factor = parse("a*F*k*x**2").evaluate(factors, {}, float)
    # arcsec * 1e3 * 1/(1e-3 mm) * (1e3 mm)^2
    assert factor == pytest.approx(math.radians(1 / 3600) * 1e3 * 1e3 * 1e6, rel=1e-14)
