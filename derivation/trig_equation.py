# %% [markdown]
# # The equation A cos θ + B sin θ + D = 0
#
# Given $A$, $B$ and $D$, which angles $\theta$ satisfy
# $$A\cos\theta+B\sin\theta+D=0\,?$$
# Every closed form of a spatial mechanism ends in this equation. It has two solutions where $D^2<A^2+B^2$, one where
# the two are equal, and none beyond. The lecture notes solve it twice: by the tangent of half the angle, and by the
# angle $\gamma$ of the vector $(A,B)$. Both ways are proved here. What they leave out is refuted and corrected: a
# solution at $\theta=\pi$, the quadrant of $\gamma$, and the case $A=B=0$. The last section gives both solutions
# without $\gamma$ and without an arc cosine, right to rounding; that is what the package computes, with a status for
# every degenerate case.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, equal, last_case, power_of_two_scale, select

d = derivation = Derivation(
    "trig_equation",
    title="A cos θ + B sin θ + D = 0",
    source='Lecture notes "Robot Geometry" after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)

# %% [markdown]
# ## Symbols

# %%
A = d.symbol("A", "A", "coefficient of the cosine", "1")
B = d.symbol("B", "B", "coefficient of the sine", "1")
D = d.symbol("D", "D", "constant term", "1")
half = d.symbol("half", r"\tfrac\theta2", "half the angle", "rad")
x1 = d.symbol("x_1", "x_1", "tangent of half the angle", "1")
gamma = d.symbol("gamma", r"\gamma", "angle of the vector (A, B)", "rad")
theta = d.symbol("theta", r"\theta", "the unknown angle", "rad")
r = d.symbol("r", "r", "length of the vector (A, B), √(A² + B²)", "1", positive=True)
w = d.symbol("w", "w", "√(r² − D²)", "1", nonnegative=True)
sign = d.symbol("sigma", r"\sigma", "sign of the root, +1 or −1", "1")
d

# %% [markdown]
# ## First way: the tangent of half the angle
#
# With $x_1=\tan\tfrac\theta2$ sine and cosine are rational, and the equation becomes quadratic in $x_1$.

# %%
sine, cosine = 2 * sp.sin(half) * sp.cos(half), sp.cos(half) ** 2 - sp.sin(half) ** 2
d.state(
    "half-angle",
    equal(sine, 2 * x1 / (1 + x1**2)),
    equal(cosine, (1 - x1**2) / (1 + x1**2)),
    text="Sine and cosine of $\\theta$, on the left by the double angle, are rational in the tangent of its half.",
    place="Tan-Half Angle Method",
).prove(given={x1: sp.tan(half)})

# %%
quadratic = x1**2 * (D - A) + x1 * (2 * B) + (D + A)
d.state(
    "quadratic",
    equal((1 + x1**2) * (A * ((1 - x1**2) / (1 + x1**2)) + B * (2 * x1 / (1 + x1**2)) + D), quadratic),
    text="Multiplied by $1+x_1^2$, the equation is quadratic in $x_1$.",
    place="Tan-Half Angle Method",
).prove()

# %%
d.state(
    "all-have-a-tangent",
    sp.Ne(sp.cos(theta / 2), 0),
    tacit=True,
    text="Every solution of the equation has a tangent of its half, and so is a root of the quadratic.",
    place="Tan-Half Angle Method",
    assumptions=[sp.Eq(A * sp.cos(theta) + B * sp.sin(theta) + D, 0)],
).refute(
    {A: 1, B: 2, D: 1, theta: sp.pi},
    equal(A * cosine + B * sine + D, D - A),
    given={half: sp.pi / 2},
    label="E1",
    because="Where D = A the angle π is a solution, and it has no tangent of its half: the quadratic has lost a root "
    "to infinity. That is more than a division by zero, since the other root, −A/B, is found by any care.",
)

# %% [markdown]
# The value of the quadratic at $D=A$ and $x_1=-A/B$ is written out here: the first term vanishes, the others cancel.

# %%
at_other_root = d.symbol(
    "at_other_root", r"\left[(D-A)\,x_1^2+2B\,x_1+(D+A)\right]_{D=A,\;x_1=-A/B}", "value of the quadratic there", "1",
    value=quadratic.subs({D: A, x1: -A / B}),
)  # fmt: skip
d.check(
    "other-root",
    equal(at_other_root, 0),
    text="Where $D=A$, the root that is left is $x_1=-A/B$.",
    assumptions=[sp.Ne(B, 0)],
).prove()

# %% [markdown]
# The roots of the quadratic are $x_1=(-B\mp w)/(D-A)$ with $w=\sqrt{A^2+B^2-D^2}$. They lose digits where $-B$ and $w$
# cancel. But the product of the two is $(D+A)/(D-A)$, so each root can also be written as $(D+A)/(-B\pm w)$, and of the
# two forms one is a quotient of numbers of which neither is made by cancellation. A double root is $-B/(D-A)$ and
# $-(D+A)/B$, of which the one with the longer of $D-A$ and $D+A$ is taken. With $\theta=2\,\mathrm{atan2}$ of numerator
# and denominator nothing is divided at all, and $\theta=\pi$ is like any other angle.

# %%
root_form = (B + sign * w) / (A - D)
at_root = d.symbol(
    "at_root", r"\left[(D-A)\,x_1^2+2B\,x_1+(D+A)\right]_{x_1=(B+\sigma w)/(A-D)}", "value of the quadratic there", "1",
    value=quadratic.subs(x1, root_form),
)  # fmt: skip
d.check(
    "roots",
    equal(at_root * (A - D), 0),
    equal((B + sign * w) * (sign * w - B), (A - D) * (A + D)),
    text="Both roots, for $\\sigma=\\pm1$: $(B+\\sigma w)/(A-D)$ is a root, and it is the same number as "
    "$(A+D)/(\\sigma w-B)$.",
    assumptions=[sp.Ne(A, D), sp.Eq(sign**2, 1)],
).prove(modulo={w: w**2 - (A**2 + B**2 - D**2), sign: sign**2 - 1})

# %% [markdown]
# ## Second way: the angle of (A, B)
#
# Divided by $r=\sqrt{A^2+B^2}$, the two coefficients are cosine and sine of an angle $\gamma$, and the equation is that
# of one cosine.

# %%
by_angle = {A: r * sp.cos(gamma), B: r * sp.sin(gamma)}
d.state(
    "divided",
    equal(
        (A / sp.sqrt(A**2 + B**2)) ** 2 + (B / sp.sqrt(A**2 + B**2)) ** 2,
        sp.sin(gamma) ** 2 + sp.cos(gamma) ** 2,
    ),
    text="The squares of the divided coefficients add up to one, as those of a sine and a cosine do.",
    place="Trig Solution Method",
).prove()

# %%
d.state(
    "gamma-by-squares",
    equal(sp.cos(gamma), sp.sqrt(A**2 / (A**2 + B**2))),
    equal(sp.sin(gamma), sp.sqrt(B**2 / (A**2 + B**2))),
    said="These definitions are used to determine the value of angle γ",
    text="The definitions give the squares of its cosine and sine.",
    place="Trig Solution Method",
).refute(
    {A: -1, B: 0, gamma: sp.pi},
    (
        equal(r**2 * (sp.sin(gamma) ** 2 + sp.cos(gamma) ** 2), A**2 + B**2),
        equal(A, r * sp.cos(gamma)),
        equal(B, r * sp.sin(gamma)),
    ),
    given=by_angle,
    label="E2",
    because="Squares do not determine the quadrant. γ is the angle whose cosine is A/r and whose sine is B/r: "
    "atan2(B, A).",
)

# %%
difference = sp.cos(gamma) * sp.cos(theta) + sp.sin(gamma) * sp.sin(theta)
d.state(
    "difference",
    equal((A * sp.cos(theta) + B * sp.sin(theta) + D) / r, difference + D / r),
    equal(difference, sp.cos(theta - gamma)),
    text="With $A=r\\cos\\gamma$ and $B=r\\sin\\gamma$ the equation, divided by $r$, is "
    "$\\cos(\\theta-\\gamma)+D/r=0$.",
    place="Trig Solution Method",
).prove(
    equal((A * sp.cos(theta) + B * sp.sin(theta) + D) / r, difference + D / r),
    equal(difference, sp.expand_trig(sp.cos(theta - gamma))),
    given=by_angle,
    because="The first line by the definition of γ, the second by the addition theorem of the cosine.",
)

# %%
d.state(
    "only-infeasible",
    sp.Ne(A**2 + B**2, 0),
    said="it only encounters problems for infeasible link lengths",
    text="What is divided by is not zero where there is a solution, $D^2\\le A^2+B^2$.",
    place="Trig Solution Method",
    assumptions=[sp.Le(D**2, A**2 + B**2)],
).refute(
    {A: 0, B: 0, D: 0},
    equal(A * sp.cos(theta) + B * sp.sin(theta) + D, D),
    given={A: 0, B: 0},
    label="E3",
    because="Where A = B = 0 there is no γ. The equation is D = 0 then: every angle solves it, or none.",
)

# %% [markdown]
# ## Both solutions without an arc cosine
#
# The solutions are $\theta_\sigma=\gamma+\sigma h$ for $\sigma=\pm1$, with an angle $h$ between $0$ and $\pi$:
# $$\cos h=-\frac Dr,\qquad\sin h=\frac wr .$$
# Neither $\gamma$ nor $h$ is needed: the sines and cosines of the two solutions, $s_\sigma$ and $c_\sigma$, are
# rational in $A$, $B$, $D$ and $w$,
# $$c_\sigma=\frac{-AD-\sigma Bw}{r^2},\qquad s_\sigma=\frac{-BD+\sigma Aw}{r^2}.$$
# The numerators are right to rounding, relative to $r^2$, so `atan2` of the two is right to rounding.

# %%
cos_theta, sin_theta = (-A * D - sign * B * w) / r**2, (-B * D + sign * A * w) / r**2
letter_c = d.symbol("c_sigma", r"c_\sigma", "cosine of a solution, (−A D − σ B w)/r²", "1", value=cos_theta)
letter_s = d.symbol("s_sigma", r"s_\sigma", "sine of a solution, (−B D + σ A w)/r²", "1", value=sin_theta)
by_roots = {w: w**2 - (r**2 - D**2), r: r**2 - (A**2 + B**2), sign: sign**2 - 1}
d.check(
    "both-angles",
    equal(A * letter_c + B * letter_s + D, 0),
    equal(letter_c**2 + letter_s**2, 1),
    text="$c_\\sigma$ and $s_\\sigma$ solve the equation, and are cosine and sine of one angle. The two solutions are "
    "one where $w=0$.",
).prove(modulo=by_roots)

# %%
d.check(
    "in-this-order",
    equal(letter_c, (A * (-D / r) - B * (sign * w / r)) / r),
    equal(letter_s, (B * (-D / r) + A * (sign * w / r)) / r),
    text="That angle is $\\gamma+\\sigma h$, by the addition theorems with $\\cos\\gamma=A/r$, $\\sin\\gamma=B/r$. So "
    "$\\sigma=+1$ gives $\\gamma+h$, and $\\sigma=-1$ gives $\\gamma-h$.",
).prove()

# %%
d.check(
    "no-others",
    equal(
        (A * sp.cos(theta) + B * sp.sin(theta)) ** 2 + (A * sp.sin(theta) - B * sp.cos(theta)) ** 2,
        A**2 + B**2,
    ),
    text="There are no other solutions. With $A\\cos\\theta+B\\sin\\theta=-D$ the identity leaves $w$ or $-w$ for "
    "$A\\sin\\theta-B\\cos\\theta$. Both expressions are linear in cosine and sine, with the determinant $r^2$, so "
    "each of the two cases has one solution.",
).prove()

# %% [markdown]
# To compute $w^2=A^2+B^2-D^2$ without losing digits, the larger of $|A|$ and $|B|$, here $\ell$, is combined with $D$,
# and the smaller, here $m$, is added: $\ell-D$ is exact for numbers that are near to each other.

# %%
long, short = (
    d.symbol("ell", r"\ell", "larger of |A| and |B|", "1"),
    d.symbol("m", "m", "smaller of them", "1"),
)
d.check(
    "discriminant",
    equal((long - D) * (long + D) + short**2, long**2 + short**2 - D**2),
    text="$w^2$ in the program.",
).prove()

# %% [markdown]
# ## The function of the package
#
# It scales the three coefficients, computes $w$, and returns `atan2` of $r^2s_\sigma$ and $r^2c_\sigma$ for both signs.
# Its status says how many solutions there are.


# %%
class TrigStatus(IntEnum):
    """How many angles solve A cos θ + B sin θ + D = 0.

    TWO: two angles.
    DOUBLE: one, where two meet: the size of D is √(A² + B²) to rounding. It is given twice.
    INFEASIBLE: none, since the size of D is greater than √(A² + B²); the angles are NaN.
    ALL: every angle, since A, B and D are zero; the angles are NaN.
    NONE: none, since A and B are zero and D is not; the angles are NaN.
    INVALID: a coefficient is not finite; the angles are NaN.
    """

    TWO = 0
    DOUBLE = 1
    INFEASIBLE = 2
    ALL = 3
    NONE = 4
    INVALID = 5


# Of w² over r²: a rounding of each coefficient changes it by up to four.
DOUBLE_BELOW = 4 * EPS


def not_negative_zero(value):
    """Zero without a sign, so that the angle of a negative number is π and not −π, and equal angles are equal."""
    return select(sp.Eq(value, 0), 0, value)


def trig_solve():
    k = KernelBuilder(
        "trig_solve",
        summary="Both angles with A cos(theta) + B sin(theta) + D = 0.",
        source="Robot Geometry, trig solution method; derivation trig_equation",
        notes="The angles are gamma + h and gamma - h, where gamma is the angle of (A, B), and h is between 0 and pi.",
    )
    A = k.input("A", unit="1", doc="coefficient of the cosine, in the unit of all three")
    B = k.input("B", unit="1", doc="coefficient of the sine")
    D = k.input("D", unit="1", doc="the rest")
    size = k.let("size", abs(A) / 4 + abs(B) / 4 + abs(D) / 4)
    scale = k.let("scale", power_of_two_scale(size))
    a, b, d_ = k.let("a", A * scale), k.let("b", B * scale), k.let("d", D * scale)
    long = k.let("larger", select(abs(a) < abs(b), abs(b), abs(a)))
    short = k.let("smaller", select(abs(a) < abs(b), abs(a), abs(b)))
    square = k.let("square", (long - d_) * (long + d_) + short**2)
    bound = k.let("bound", DOUBLE_BELOW * (long**2 + short**2))
    double = k.let("is_double", abs(square) <= bound)
    valid = k.let("valid", size <= LARGEST)
    two = k.let("two", square > bound)
    root = k.let("w", select(two, sp.sqrt(select(two, square, 1)), 0))
    # unscaled: compared with a D that is 1e300 times larger they vanish, and the equation is still infeasible
    empty = k.let("empty", sp.Eq(A, 0) & sp.Eq(B, 0))
    there = k.let("there", valid & sp.Not(empty) & (double | two))
    status = sp.Piecewise(
        (TrigStatus.INVALID, sp.Not(valid)),
        (TrigStatus.NONE, empty & (abs(d_) > 0)),
        (TrigStatus.ALL, empty),
        (TrigStatus.DOUBLE, double),
        (TrigStatus.TWO, two),
        (TrigStatus.INFEASIBLE, True),
        evaluate=False,
    )
    angles = []
    for name, s in (("plus", 1), ("minus", -1)):
        cosine = k.let(f"cosine_{name}", not_negative_zero(-a * d_ - s * b * root))
        sine = k.let(f"sine_{name}", not_negative_zero(-b * d_ + s * a * root))
        angles.append(sp.atan2(sine, cosine))
    k.output(
        "theta",
        select(there, sp.Matrix(angles), sp.ones(2, 1) * sp.nan),
        unit="rad",
        doc="gamma + h and gamma - h, from -pi to pi",
    )
    k.status("status", status, TrigStatus, doc="how many angles there are")
    # two angles, and no square that is too large or too small: then the scale changes no bit
    usual = {"scale": 1, "is_double": False, "valid": True, "two": True, "empty": False, "there": True}
    k.usual((size > EPS) & (size < 1 / EPS) & (square > bound), **usual)
    return k.build()


kernel = trig_solve()

# %% [markdown]
# The function computes what was proved: its cosines and sines, before they go to `atan2`, are those of the two
# solutions times $r^2$. They are marked "fn".

# %%
letters = kernel.substitution(a=A, b=B, d=D, w=w)
steps = {}
for s, name in ((1, "plus"), (-1, "minus")):
    for part in ("cosine", "sine"):
        value = kernel.expand(kernel[f"{part}_{name}"], keep=list(letters))
        steps[part, s] = d.letter(
            rf"{part}_{name}_fn | {part[0]}^\mathrm{{fn}}_{{{'+' if s > 0 else '-'}}} | "
            rf"{part} of the function, times r², for σ = {s:+d} | 1",
            last_case(value).subs(letters),
        )
d.check(
    "kernel",
    *(equal(steps["cosine", s], r**2 * cos_theta.subs(sign, s)) for s in (1, -1)),
    *(equal(steps["sine", s], r**2 * sin_theta.subs(sign, s)) for s in (1, -1)),
    text="Cosines and sines of the function are $r^2c_\\sigma$ and $r^2s_\\sigma$ for $\\sigma=\\pm1$.",
).prove()

# %%
derivation.kernel(kernel)
