"""Proofs are proofs: what is false, open or badly refuted does not pass."""

import itertools
import random
import re

import pytest
import sympy as sp
from sympy.polys.rings import ring

from rodgen.symbolic import (
    EPS,
    Derivation,
    DerivationError,
    Letter,
    Vector,
    cross,
    dot,
    equal,
    errata,
    explicit,
    formal_determinant,
    matrix_from_axis_angle,
    matrix_from_rodrigues_vector,
    norm,
    power_of_two_scale,
    remainder,
    rodrigues,
    select,
    skew,
)
from rodgen.symbolic._latex import component_names, latex, latex_lines, rendered_width
from rodgen.symbolic.reduction import _coprime, reduction

x, y, z = sp.symbols("x y z", real=True)


class NamedKernel:
    def __init__(self, name):
        self.name = name


@pytest.fixture
def derivation():
    return Derivation("triangle", title="A right triangle", source="Euclid, with a slip")


def test_a_true_statement_is_proved_and_keeps_its_formula(derivation):
    claim = sp.Eq((x + y) ** 2, x**2 + 2 * x * y + y**2)
    entry = derivation.state("square", claim, place="II.4").prove()
    assert entry.verdict == "proved"
    assert entry.claims == (claim,)
    assert "x + y" in entry.latex()


def test_a_false_statement_raises_and_shows_the_remainder(refuses, derivation):
    entry = derivation.state("square", sp.Eq((x + y) ** 2, x**2 + y**2))
    refuses(entry.prove, raises=DerivationError)
    assert entry.verdict == "open"


def test_one_false_component_of_a_vector_equation_raises(refuses, derivation):
    a, b = derivation.vector("a", r"\vec a", "", "1"), derivation.vector("b", r"\vec b", "", "1")
    wrong = explicit(cross(a, b)) + sp.Matrix([0, 0, 1])
    refuses(derivation.state("cross", equal(cross(a, b), wrong)).prove, raises=DerivationError)


def test_sides_of_different_shapes_raise(refuses, derivation):
    a = derivation.vector("a", r"\vec a", "", "1")
    refuses(derivation.state("mixed", equal(2 * a, x)).prove, raises=DerivationError)


def test_an_open_entry_blocks_kernels(refuses, derivation):
    derivation.state("proved", sp.Eq(x + x, 2 * x, evaluate=False)).prove()
    entry = derivation.state("open", equal(sp.cos(x) ** 2, 1 - sp.sin(x) ** 2))
    refuses(derivation.kernel, NamedKernel("area"), raises=DerivationError)
    assert not derivation.kernels
    entry.prove()
    derivation.kernel(NamedKernel("area"))
    assert list(derivation.kernels) == ["area"]


def test_a_kernel_is_handed_over_once(refuses, derivation):
    derivation.kernel(NamedKernel("area"))
    refuses(derivation.kernel, NamedKernel("area"), raises=DerivationError)


def test_names_are_used_once(refuses, derivation):
    derivation.check("it", sp.Eq(x, y))
    derivation.symbol("h", "h", "height", "m")
    refuses(derivation.state, "it", sp.Eq(x, y), raises=DerivationError)
    refuses(derivation.vector, "h", r"\vec h", "height", "m", raises=DerivationError)


def test_an_entry_is_decided_once(refuses, derivation):
    entry = derivation.check("it", sp.Eq(x + y, y + x, evaluate=False)).prove()
    refuses(entry.prove, raises=DerivationError)


def test_a_claim_that_sympy_evaluates_away_is_refused(refuses, derivation):
    refuses(derivation.state, "trivial", sp.Eq(x, x), raises=DerivationError)
    refuses(derivation.state, "empty", raises=DerivationError)


def test_residuals_of_its_own_need_a_reason(refuses, derivation):
    entry = derivation.state("positive", sp.Ge(x**2 + 2 * x * y + y**2, 0))
    refuses(entry.prove, raises=DerivationError)
    refuses(entry.prove, sp.S.Zero, raises=DerivationError)
    assert (
        entry.prove(x**2 - x * x, because="A square is not negative.").method == "A square is not negative."
    )


def test_a_proof_may_build_on_a_proved_entry_only(refuses, derivation):
    lemma = derivation.check("lemma", sp.Eq(x, y))
    refuses(
        derivation.check("theorem", sp.Eq(x, y)).prove,
        lemma,
        because="It is the lemma.",
        raises=DerivationError,
    )


def test_a_definition_is_used_and_may_be_overridden(refuses, derivation):
    h = derivation.symbol("h", "h", "height", "m", value=x + y)
    derivation.check("defined", equal(h**2, (x + y) ** 2)).prove()
    derivation.check("given", equal(h, 3 * z)).prove(given={h: 3 * z})
    refuses(derivation.check("free", equal(h, x + y)).prove, given={h: h}, raises=DerivationError)


def test_a_definition_in_a_circle_is_refused(refuses, derivation):
    a = derivation.symbol("a", "a", "", "1", value=sp.Symbol("b", real=True) + 1)
    derivation.symbol("b", "b", "", "1", value=a + 1)
    refuses(derivation.value, a, raises=DerivationError)


SLIP = equal(sp.Symbol("c", real=True), x + y)
RIGHT = equal(sp.Symbol("c", real=True) ** 2, x**2 + y**2)


@pytest.fixture
def slip(derivation):
    derivation.symbol("c", "c", "hypotenuse", "m", value=sp.sqrt(x**2 + y**2))
    return derivation.state("hypotenuse", SLIP, place="I.47", assumptions=[sp.Gt(x, 0), sp.Gt(y, 0)])


def test_a_refuted_entry_shows_both_values(slip):
    slip.refute({x: 3, y: 4}, RIGHT, because="Sides do not add.", label="E1")
    assert slip.verdict == "refuted"
    assert slip.refutation.values == ((5, 7),)
    assert slip.refutation.counterexample == ((x, 3), (y, 4))


@pytest.mark.parametrize("counterexample", [{x: 0, y: 4}, {x: 3.0, y: 4}, {x: 3, y: z}, {x: 3}])
def test_a_bad_counterexample_raises(refuses, slip, counterexample):
    refuses(slip.refute, counterexample, RIGHT, because="Sides do not add.", raises=DerivationError)
    assert slip.verdict == "open"


def test_a_counterexample_that_satisfies_the_claim_raises(refuses, derivation):
    entry = derivation.state("square", sp.Eq(x**2, x))
    refuses(entry.refute, {x: 1}, equal(x**2, x * x), because="", raises=DerivationError)


def test_a_true_statement_cannot_be_refuted(refuses, derivation):
    entry = derivation.state("root", equal(sp.sqrt(3 + 2 * sp.sqrt(2)), 1 + sp.sqrt(2)))
    refuses(entry.refute, {}, equal(x, x), because="", raises=DerivationError)


def test_a_wrong_correction_raises(refuses, slip):
    refuses(
        slip.refute,
        {x: 3, y: 4},
        sp.Eq(sp.Symbol("c", real=True), x - y),
        because="Sides do not add.",
        raises=DerivationError,
    )


def test_an_inequality_and_a_logical_claim_are_refuted(derivation):
    claim = sp.Implies(sp.Gt(x, 0), sp.Gt(x, 1))
    entry = derivation.state("jump", claim)
    entry.refute({x: sp.Rational(1, 2)}, equal(x + 0 * y, x), because="Halves are positive.")
    assert entry.refutation.values == ((claim, sp.false),)


def test_errata_tell_what_is_printed_said_and_tacit(derivation, slip):
    """Words are quoted and what they mean is not a formula of the source; a tacit one has no words."""
    slip.refute({x: 3, y: 4}, RIGHT, because="Sides do not add.", label="E1")
    said = derivation.state("sum", equal(x + x, x), place="p. 2", said="x twice is x")
    said.refute({x: 1}, equal(x + x, 2 * x), because="It is twice x.", label="E2")
    tacit = derivation.state("divisor", sp.Ne(y, 0), place="p. 3", tacit=True)
    tacit.refute({y: 0}, equal(y + y, 2 * y), because="It may be 0.", label="E3")
    own = derivation.check("own", equal(x + x, 2 * x)).prove()
    assert [entry.origin for entry in derivation] == ["printed", "said", "tacit", "own"]
    text, markdown = errata(derivation), errata(derivation, form="markdown")
    assert "    printed:  c = x + y\n" in text
    assert "    said:     “x twice is x”\n    meaning:  2*x = x\n    wrong:" in text
    assert "    tacit:    y != 0\n" in text
    for name in ("printed", "said", "meaning", "tacit"):
        assert text.count(f"{name}:") == 1
    assert "\nPrinted (I.47):\n\n$$ c = x + y $$" in markdown
    assert "\nSaid (p. 2): “x twice is x” That is,\n\n$$" in markdown
    assert "\nTacit (p. 3):\n\n$$" in markdown
    assert said._repr_markdown_().startswith(
        '<a id="sum"></a>**sum**, said, p. 2. “x twice is x” That is,\n\n$$'
    )
    assert tacit._repr_markdown_().startswith('<a id="divisor"></a>**divisor**, tacit, p. 3.\n\n$$')
    assert own._repr_markdown_().startswith('<a id="own"></a>**own**.\n\n$$')
    both = said.derivation.page("own", "divisor")
    assert both._repr_markdown_() == f"{own._repr_markdown_()}\n\n{tacit._repr_markdown_()}"


def test_what_is_said_is_not_tacit(refuses, derivation):
    refuses(derivation.state, "it", sp.Eq(x, y), said="x is y", tacit=True, raises=DerivationError)


def test_errata_say_where_nothing_is_refuted(derivation):
    derivation.check("it", equal(x + x, 2 * x)).prove()
    for form in ("text", "markdown"):
        assert errata(derivation, form=form).endswith("\n\nNothing is refuted.\n")


def test_report_and_markdown_show_the_verdicts(derivation, slip):
    derivation.check("later", sp.Eq(x, y))
    slip.refute({x: 3, y: 4}, RIGHT, because="Sides do not add.", label="E1")
    report = derivation.report()
    assert "0 proved, 1 refuted, 1 open" in report
    assert re.search(r"\nhypotenuse  refuted +\d+  c = x \+ y\n    Sides do not add\.\n", report)
    page = slip._repr_markdown_()
    assert "**hypotenuse**, printed, I.47." in page
    assert "Refuted (E1)" in page
    assert "s in proofs" not in page
    assert "| `c` | $c$ | hypotenuse | m |" in derivation._repr_markdown_()


# The steps of a proof


def test_a_proof_shows_what_it_inserted(derivation):
    h = derivation.symbol("h", "h", "height", "m", value=x + y)
    entry = derivation.check("square", equal(h**2, x**2 + 2 * x * y + y**2)).prove()
    assert entry.proof.substituted == (h,)
    page = entry._repr_markdown_()
    statement, proof = page.split("*Proof.*")
    assert "- $h = x + y$: height [m]" in statement
    assert "$$ h^{2} = " in statement
    assert "Insert the definition of $h$." in proof
    assert "By computation (polynomial division, `rodgen.symbolic.remainder`)" in proof
    later = derivation.check("later", equal(h - x, y)).prove()
    assert "$$ h = x + y $$" in later._repr_markdown_()
    assert "    h = x + y\n" in later.steps()


def test_a_proof_names_the_relations_it_used(derivation):
    s = derivation.symbol("s", "s", "root", "1")
    conditions = {s: s**2 - x - 1}
    entry = derivation.check(
        "circle", equal(s**4 + x * sp.sin(y) ** 2, (x + 1) ** 2 + x - x * sp.cos(y) ** 2)
    )
    entry.prove(modulo={**conditions, z: z - y})
    page = entry._repr_markdown_()
    assert r"\sin^{2}" in page
    assert "$s^{2} = x + 1$" in page
    assert "$z" not in page


def test_a_proof_shows_its_difference_as_multiples_of_what_is_zero():
    found = reduction(x**3 * y - x * y + (x**2 - 1) * sp.sin(z) ** 2 + y**2 - 4, {x: x**2 - 1, y: y**2 - 4})
    assert found.remainder == 0
    numerator = sum(cofactor * zero for cofactor, zero in found.cofactors())
    assert sp.expand(numerator - (x**3 * y - x * y + (x**2 - 1) * sp.sin(z) ** 2 + y**2 - 4)) == 0
    assert len(found.divisions) == 3


def test_a_proof_links_the_entries_it_follows_from(derivation):
    lemma = derivation.check("lemma", equal(x + x, 2 * x)).prove()
    entry = derivation.check("theorem", sp.Ge(x + y, z)).prove(lemma, because="A square.")
    page = entry._repr_markdown_()
    assert '*Proof.* A square. It follows from <a href="#lemma">lemma</a>.' in page
    assert '<a id="lemma"></a>' in lemma._repr_markdown_()


def test_a_proof_does_not_show_that_zero_is_zero(derivation):
    entry = derivation.check("rows", sp.Ge(x, y)).prove(sp.S.Zero, sp.S.Zero, because="Row by row.")
    page = entry._repr_markdown_()
    assert "*Proof.* Row by row.\n\nBy computation (polynomial division, " in page
    assert "0 = 0" not in page


def test_symbols_without_a_row_are_found(derivation):
    h = derivation.symbol("h", "h", "height", "m")
    a = derivation.vector("a", r"\vec a", "arm", "m")
    derivation.check("known", equal(h + a.components[1], h))
    derivation.check("unknown", equal(h, x + sp.Symbol("X_{12}")))
    derivation.symbol("x", "x", "too late", "m")
    assert derivation.undeclared() == ["triangle: unknown uses x before the table of symbols has it"]


# Typesetting


def test_sums_begin_with_a_positive_term_and_subtract():
    a, b = Vector("a"), Vector("b")
    assert latex(y - x, {}) == "y - x"
    assert latex(-x - y, {}) == "- x - y"
    assert latex(-2 * cross(a, b) - a + 2 * b, {}) == r"2 \, \vec b - \vec a - 2 \, \vec a \times \vec b"
    assert latex(x * (y - z) * sp.sin(x) / 2, {}) == r"\frac{x \sin x}{2} \left(y - z\right)"
    assert latex(-sp.Mul(2, x + y, evaluate=False), {}) == r"- 2 \left(x + y\right)"


def test_functions_drop_the_brackets_of_a_letter():
    names = {x: r"\tfrac{\chi}{2}", y: r"\chi"}
    assert latex(sp.sin(x) * sp.cos(2 * y) ** 2, names) == r"\sin \tfrac{\chi}{2} \cos^{2} 2 \chi"
    assert latex(sp.sin(2 * x) + sp.cos(y + z), names) == (
        r"\sin\left(2 \cdot \tfrac{\chi}{2}\right) + \cos\left(\chi + z\right)"
    )
    assert latex(sp.atan2(y, z), names) == r"\operatorname{atan2}\left(\chi,\, z\right)"
    assert latex(sp.acos(z), names) == r"\arccos z"


def test_powers_and_components_of_decorated_names():
    names = {x: r"\rho'_{1}", y: "s_{12} c_1"}
    assert latex(x**2 + y**2, names) == r"{\rho'_{1}}^{2} + \left(s_{12} c_1\right)^{2}"
    for name, first in [
        (r"\vec r_1", "r_{1,1}"),
        (r"\vec\rho'", r"\rho'_{1}"),
        (r"\vec a_{67}", "a_{67,1}"),
        (r"R\vec x", r"\left(R\vec x\right)_{1}"),
    ]:
        assert next(iter(component_names(Vector("v"), name).values())) == first
    assert latex(sp.Symbol("m_1_0_2") + sp.Symbol("offset_1"), {}) == r"m_{102} + \mathrm{offset}_{1}"


def test_a_wide_formula_is_broken_into_lines():
    terms = sp.Add(*(sp.Symbol(f"a_{i}") * (x + y) ** i for i in range(1, 20)))
    text = latex_lines(sp.Eq(z, terms, evaluate=False), {}, 60, 10)
    lines = text.removeprefix(r"\begin{aligned} ").removesuffix(r" \end{aligned}").split(r" \\ ")
    assert len(lines) > 3
    assert all(rendered_width(line) <= 66 for line in lines)
    assert lines[0].startswith("z &= a_{1}")
    assert text.count("{") == text.count("}")
    assert text.count("a_{") == 19
    assert r"\text{(3 more lines)}" in latex_lines(sp.Eq(z, terms, evaluate=False), {}, 60, len(lines) - 2)


# Reduction to zero


def test_remainder_of_an_identity_with_nested_roots_and_functions_is_zero():
    inner = sp.sqrt(x**2 + y**2)
    outer = sp.sqrt(inner + z)
    assert remainder(outer**4 - (x**2 + y**2) - 2 * inner * z - z**2) == 0
    assert remainder(sp.cos(2 * x) + 2 * sp.sin(x) ** 2 - 1) == 0
    assert remainder(sp.tan(x) * sp.cos(x) - sp.sin(x)) == 0
    assert remainder(sp.exp(x) * (y + 1) - y * sp.exp(x) - sp.exp(x)) == 0


@pytest.mark.parametrize(
    "expr",
    [sp.sqrt(x**2 + 1) - x, sp.sqrt(x) * sp.sqrt(y) + 1, sp.sin(x) ** 2 - 1, sp.sin(x) - sp.sin(y), 1 / x],
)
def test_remainder_of_what_is_not_zero_is_not_zero(expr):
    assert remainder(expr) != 0


def test_remainder_knows_no_sign_of_a_root():
    # sqrt(x**2) is -x for half of all x: a proof may not take it for x.
    assert remainder(sp.sqrt(sp.Symbol("u") ** 2) - sp.Symbol("u")) != 0


def test_remainder_uses_side_conditions_in_turn():
    assert remainder(x**2 * y**2 - 6, {x: x**2 - y, y: y**3 - 6}) == 0
    assert remainder(x**2 - 2, {x: z * x**2 - 2 * z}) == 0


def test_remainder_refuses_floats():
    with pytest.raises(ValueError, match="exact numbers"):
        remainder(0.5 * x)


# Vectors, rotations, functions


def random_vector(generator):
    return sp.Matrix([sp.Rational(generator.randint(-99, 99), generator.randint(1, 99)) for _ in range(3)])


def test_letters_and_components_agree():
    generator = random.Random(1)
    a, b = Vector("a"), Vector("b")
    values = {letter: random_vector(generator) for letter in (a, b)}
    point = {s: v for letter, value in values.items() for s, v in zip(letter, value, strict=True)}
    product = values[a].cross(values[b])
    for formula, expected in [
        (cross(a, b), product),
        (formal_determinant(a, b), product),
        (skew(a) * b, product),
        (dot(a, b) * a + 2 * b, values[a].dot(values[b]) * values[a] + 2 * values[b]),
        ((sp.Identity(3) - a * a.T / norm(a) ** 2) * b, b_across(values[a], values[b])),
    ]:
        assert sp.Matrix(explicit(formula)).xreplace(point) == expected
    assert explicit(norm(a)).xreplace(point) ** 2 == values[a].dot(values[a])


def b_across(a, b):
    return b - a * a.dot(b) / a.dot(a)


def test_a_letter_has_the_component_names_of_a_kernel_port():
    assert [str(s) for s in Letter("J", 2, 2)] == ["J_1_1", "J_1_2", "J_2_1", "J_2_2"]
    assert [str(s) for s in Vector("rho")] == ["rho_1", "rho_2", "rho_3"]


def test_rotations_agree_and_are_orthogonal():
    generator = random.Random(2)
    rho, axis = random_vector(generator), sp.Matrix([2, -6, 3]) / 7
    tangent = sp.Rational(5, 12)  # of half the angle: exact cosine and sine
    cosine, sine = (1 - tangent**2) / (1 + tangent**2), 2 * tangent / (1 + tangent**2)
    matrix = matrix_from_axis_angle(axis, cosine, sine)
    assert matrix * matrix.T == sp.eye(3)
    assert matrix.det() == 1
    assert matrix * axis == axis
    assert matrix_from_rodrigues_vector(2 * tangent * axis) == matrix
    assert rodrigues(rho, 2 * tangent * axis) == matrix * rho


def test_select_takes_matrices_entry_by_entry():
    chosen = select(x < 0, sp.Matrix([x, 1]), sp.Matrix([y, 2]))
    assert chosen.subs(x, -3) == sp.Matrix([-3, 1])
    assert chosen.subs(x, 3) == sp.Matrix([y, 2])
    with pytest.raises(ValueError, match="equal shapes"):
        select(x < 0, sp.Matrix([x]), sp.Matrix([x, y]))


@pytest.mark.parametrize(
    "number", [sp.Rational(1, 3), sp.Integer(1), sp.Rational(1023, 1024), sp.Integer(10) ** 40]
)
def test_power_of_two_scale_brings_a_number_between_one_and_two(number):
    scale = power_of_two_scale(number)
    assert 1 <= number * scale < 2
    assert sp.log(scale, 2).is_integer


def test_power_of_two_scale_is_constant_to_a_derivative_and_one_at_zero():
    u = sp.Symbol("u", positive=True)
    assert power_of_two_scale(u).diff(u) == 0
    assert power_of_two_scale(sp.S.Zero) == 1
    assert power_of_two_scale(u).is_positive
    assert EPS.is_positive


def test_fractions_are_brought_to_lowest_terms_only_where_something_is_in_common() -> None:
    _, x, y, z = ring("x, y, z", sp.ZZ)
    for f, g in itertools.product((x + y, x * y - 1, x**2 + y**2 + 1, 3 * z + x), repeat=2):
        for h in (x + z, y**2 - z):
            assert _coprime(f * h, g * h) == (f * h).cancel(g * h)  # shares h
            assert _coprime(f * h, g) == (f * h).cancel(g)  # shares f where it is g
    assert _coprime(6 * x, 4 * y + 2) == (3 * x, 2 * y + 1)  # a number
