# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Two equations in two angles
#
# Group 2 mechanisms, and robots whose wrist can be decoupled from the rest, lead to two equations that are linear in
# $(1,\cos\theta_1,\sin\theta_1)$ and in $(1,\cos\theta_2,\sin\theta_2)$:
# $f_e=\vec u^TM_e\vec v=0$ with $\vec u=(1,\cos\theta_1,\sin\theta_1)$ and $\vec v=(1,\cos\theta_2,\sin\theta_2)$.
# With the tangents of the half angles they are the notes' two biquadratics. The notes name two ways of
# elimination, Sylvester's and Bezout's, and give neither. Both are derived here and proved to be the same octic, and
# the same again as a third way that needs no tangents. The kernels below find its roots, prove which of them are real,
# and polish the angles on the equations themselves.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    equal,
    power_of_two_scale,
    select,
)

derivation = Derivation(
    "biquadratic_pair",
    title="Two equations in two angles: Sylvester, Bezout, and the cross product",
    source='Lecture notes "Robot Geometry" after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)
d = derivation
im = sp.ImmutableMatrix

# %%
x1 = d.symbol("x_1", "x_1", "tangent of half the first angle", "1")
x3 = d.symbol("x_3", "x_3", "tangent of half the second angle; x₂ in the code, which counts its own", "1")
psi = d.symbol("psi", r"\psi", "the first angle, counted from the turn", "rad")
turn = d.symbol("turn", r"\tau", "where the first angle is counted from", "rad")
p, q, r = (sp.symbols(f"{letter}_1 {letter}_2", real=True) for letter in "pqr")
M = [sp.Matrix(3, 3, sp.symbols(f"m_{e}_:3_:3", real=True)) for e in (1, 2)]
HALF = sp.Matrix([[1, 1, 0], [0, 0, 2], [1, -1, 0]])
d

# %% [markdown]
# ## Angles and biquadratics
#
# Both forms are equivalent: the nine products of $1,x,x^2$ are the nine products of $1,\cos,\sin$ times
# $(1+x_1^2)(1+x_3^2)$, and the change between them is invertible. The notes call the coefficients $a$ to $j$ without
# $c$; their $i$ is the number of the equation as well. The code counts them: equation, power of $x_3$, power of $x_1$.


# %%
def by_tangent(x):
    """(1, cos, sin) of twice the arc tangent, times 1 + x²."""
    return sp.Matrix([1 + x**2, 1 - x**2, 2 * x])


def powers(x, degree=2):
    return sp.Matrix([x**k for k in range(degree + 1)])


letters = {"a": 22, "b": 21, "d": 20, "e": 12, "f": 11, "g": 10, "h": "02", "i": "01", "j": "00"}
E = HALF * M[0].T * HALF.T  # power of x3, power of x1
printed = sum(
    x3 ** int(str(place)[0]) * x1 ** int(str(place)[1]) * E[int(str(place)[0]), int(str(place)[1])]
    for place in letters.values()
)
d.state(
    "biquadratic",
    equal((by_tangent(x1).T * M[0] * by_tangent(x3))[0], printed),
    text="x₃²(a x₁² + b x₁ + d) + x₃(e x₁² + f x₁ + g) + (h x₁² + i x₁ + j) is an equation of the two angles, with "
    "coefficients H Mᵀ Hᵀ, where the rows of H are the coefficients of (1, cos, sin) by powers of the tangent.",
    place="Solve x₃²(…) + x₃(…) + (…) = 0",
).prove()
d.check(
    "biquadratic-back",
    equal(im(HALF.inv() * E * HALF.T.inv()), im(M[0].T)),
    text="Every biquadratic is one of two angles: H can be inverted.",
).prove()
d.state(
    "all-have-tangents",
    sp.Ne(sp.cos(psi / 2), 0),
    tacit=True,
    text="A solution of the equations is a solution of the biquadratics.",
    place="Solve x₃²(…) + x₃(…) + (…) = 0",
    assumptions=[sp.Eq(sp.cos(psi) + 1, 0)],
).refute(
    {psi: sp.pi},
    equal(im(E[:, 2]), im(HALF * (M[0].T * sp.Matrix([1, -1, 0])))),
    label="Q1",
    because="At θ₁ = π the tangent is infinite. The biquadratic there is its coefficient of x₁², and where that of "
    "both equations has a common root, the octic below has lost a root to infinity. In angles nothing is lost.",
)

# %% [markdown]
# ## Sylvester
#
# With $E_e=p_ex_3^2+q_ex_3+r_e$, the two equations and $x_3$ times each are linear in $(x_3^3,x_3^2,x_3,1)$.

# %%
quadratics = [p[e] * x3**2 + q[e] * x3 + r[e] for e in (0, 1)]
sylvester = sp.Matrix([
    [p[0], q[0], r[0], 0],
    [0, p[0], q[0], r[0]],
    [p[1], q[1], r[1], 0],
    [0, p[1], q[1], r[1]],
])  # fmt: skip
d.check(
    "sylvester",
    equal(
        im(sylvester * sp.Matrix([x3**3, x3**2, x3, 1])),
        im([x3 * quadratics[0], quadratics[0], x3 * quadratics[1], quadratics[1]]),
    ),
    text="The matrix is singular where both have a common root.",
).prove()


# %% [markdown]
# ## Bezout
#
# Multiplied crosswise by their leading and by their last coefficients, the two equations leave two that are linear in
# $x_3$. With $|uv|=u_1v_2-u_2v_1$:


# %%
def bracket(u, v):
    return u[0] * v[1] - u[1] * v[0]


pq, pr, qr = bracket(p, q), bracket(p, r), bracket(q, r)
bezout = sp.Matrix([[pq, pr], [pr, qr]])
d.check(
    "bezout",
    equal(
        im(bezout * sp.Matrix([x3, 1])),
        im([
            p[0] * quadratics[1] - p[1] * quadratics[0],
            (p[0] * x3 + q[0]) * quadratics[1] - (p[1] * x3 + q[1]) * quadratics[0],
        ]),
    ),
    text="Both rows vanish with the two equations.",
).prove()  # fmt: skip
d.check(
    "same-octic",
    equal(sylvester.det(), pr**2 - pq * qr),
    equal(bezout.det(), pq * qr - pr**2),
    text="The determinants are the same up to the sign, so both ways have the same roots, none of them spurious.",
).prove()
d.check(
    "back-substitution",
    equal(pq * quadratics[0].subs(x3, -pr / pq) * pq, p[0] * (pr**2 - pq * qr)),
    equal(qr * pr * (-pr / pq + qr / pr), -(qr / pq) * (pr**2 - pq * qr)),
    text="x₃ = −|pr|/|pq| solves the first equation where the octic vanishes, and it is −|qr|/|pr| then, too. Where "
    "|pq| = |pr| = |qr| = 0 the two quadratics are proportional, and both their roots count.",
    assumptions=[sp.Ne(pq, 0), sp.Ne(pr, 0)],
).prove()

# %% [markdown]
# ## The cross product
#
# In angles the two equations say that $\vec v$ is perpendicular to the two vectors $M_e^T\vec u$, so it is a multiple
# of $\vec n=M_1^T\vec u\times M_2^T\vec u$; and a multiple of $\vec n$ is $(1,\cos\theta_2,\sin\theta_2)$ for some
# angle if and only if $n_1^2+n_2^2=n_0^2\ne0$. That is the octic again, without a tangent and without a special angle.

# %%
rows = [sp.Matrix(sp.symbols(f"r_{e}_:3", real=True)) for e in (1, 2)]
n = rows[0].cross(rows[1])
octic = n[1] ** 2 + n[2] ** 2 - n[0] ** 2
quadratic = [HALF * row for row in rows]  # coefficients of 1, x3, x3²
by_rows = {s: quadratic[e][2 - k] for k, pair in enumerate((p, q, r)) for e, s in enumerate(pair)}
d.check(
    "cross-product",
    equal(4 * octic, sylvester.det().subs(by_rows)),
    text="n₁² + n₂² − n₀² is a quarter of Sylvester's determinant.",
).prove()
d.check(
    "second-angle",
    *(equal(row.dot(n), 0) for row in rows),
    equal((n[1] / n[0]) ** 2 + (n[2] / n[0]) ** 2 - 1, octic / n[0] ** 2),
    text="v = n/n₀ solves both equations, and where the octic vanishes its last two components are the cosine and sine "
    "of an angle, θ₂.",
    assumptions=[sp.Ne(n[0], 0)],
).prove()

# %% [markdown]
# Where $\vec n=0$ both equations are one equation of $\theta_2$, with two solutions or none; the octic, quadratic in
# $\vec n$, has a double root there. Where both $M_e^T\vec u=0$, every $\theta_2$ is a solution; where the octic
# vanishes identically, there is one for every $\theta_1$: a common factor of the two equations.
#
# The octic as a polynomial of $x_1$: $(1+x_1^2)^2\vec n$ has degree 4, so the octic has degree 8, and there are
# no more than eight solutions without a common factor. As a trigonometric polynomial $\vec n$ has the degree 2. Turning
# the first angle turns its coefficients, and the root that is at infinity is one at $\theta_1=\tau+\pi$: a turn away
# from all roots leaves no large ones.


# %%
def coefficients(m):
    """Constant, cosine, sine, cosine and sine of twice the angle in n, for rows m[e][i] of the two matrices."""
    product = [[m[0][i].cross(m[1][j]) for j in range(3)] for i in range(3)]
    half = sp.Rational(1, 2)
    return [
        product[0][0] + half * (product[1][1] + product[2][2]),
        product[0][1] + product[1][0],
        product[0][2] + product[2][0],
        half * (product[1][1] - product[2][2]),
        half * (product[1][2] + product[2][1]),
    ]


def turned(k, c, s):
    """The same after the angle is counted from a turn with cosine c and sine s."""
    c2, s2 = c**2 - s**2, 2 * c * s
    return [
        k[0],
        c * k[1] + s * k[2],
        c * k[2] - s * k[1],
        c2 * k[3] + s2 * k[4],
        c2 * k[4] - s2 * k[3],
    ]


def quartic(k):
    """Powers of x in (1 + x²)² n."""
    return [
        k[0] + k[1] + k[3],
        2 * k[2] + 4 * k[4],
        2 * k[0] - 6 * k[3],
        2 * k[2] - 4 * k[4],
        k[0] - k[1] + k[3],
    ]


def product_of(one, other):
    """Powers in the product of two polynomials."""
    found = [sp.S.Zero] * (len(one) + len(other) - 1)
    for i, x in enumerate(one):
        for j, y in enumerate(other):
            found[i + j] += x * y
    return found


letters_n = sp.symbols("k_:5", real=True)
cosine, sine = sp.cos(psi), sp.sin(psi)
harmonic = sp.Matrix([1, cosine, sine, cosine**2 - sine**2, 2 * cosine * sine])
trigonometric = sum(a * b for a, b in zip(letters_n, harmonic, strict=True))
c_turn, s_turn = sp.cos(turn), sp.sin(turn)
plain = [[M[e][i, :].T for i in range(3)] for e in (0, 1)]
u_psi = sp.Matrix([1, cosine, sine])
d.check(
    "coefficients-of-n",
    equal(
        im((M[0].T * u_psi).cross(M[1].T * u_psi)),
        im(sum((a * b for a, b in zip(coefficients(plain), harmonic, strict=True)), sp.zeros(3, 1))),
    ),
    text="n by sines and cosines of the first angle and of twice the angle.",
).prove()
d.check(
    "turned",
    equal(
        sum(a * b for a, b in zip(turned(letters_n, c_turn, s_turn), harmonic, strict=True)),
        trigonometric.subs(
            {
                cosine: c_turn * cosine - s_turn * sine,
                sine: s_turn * cosine + c_turn * sine,
            },
            simultaneous=True,
        ),
    ),
    text="The same at the angle τ + ψ.",
).prove()
circle = {cosine: (1 - x1**2) / (1 + x1**2), sine: 2 * x1 / (1 + x1**2)}
d.check(
    "quartic",
    equal(
        (1 + x1**2) ** 2 * trigonometric.subs(circle),
        sum(a * x1**k for k, a in enumerate(quartic(letters_n))),
    ),
    text="The same by the tangent: a quartic.",
).prove()

# %% [markdown]
# ## Which roots are real
#
# Approximations $z_i$ of the eight roots, however they are found, come with a proof. With Weierstrass's corrections
# $W_i=P(z_i)/(a_8\prod_{j\ne i}(z_i-z_j))$, Lagrange's interpolation at the $z_i$ is
# $P(z)=a_8\prod(z-z_j)\,(1+\sum W_i/(z-z_i))$. At a root the sum is $-1$, so one of its eight parts has at least the
# size $\frac18$: every root is in one of the discs of radius $8|W_i|$ around $z_i$, and a disc that meets no other has
# exactly one root (Smith). For a real polynomial that has two consequences: a disc that does not meet the real axis has
# no real root; and a disc around a real $z_i$ that meets no other holds one root, which is real, because its conjugate
# is in the disc as well. Where $P$ is off by rounding, its bound is added to $|P(z_i)|$.

# %%
z = sp.Symbol("z")
roots = sp.symbols("z_1:4")
a = sp.symbols("a_:4", real=True)
cubic = sum(a[k] * z**k for k in range(4))
others = [sp.prod(roots[i] - roots[j] for j in range(3) if j != i) for i in range(3)]
weierstrass = [cubic.subs(z, roots[i]) / (a[3] * others[i]) for i in range(3)]
d.check(
    "corrections",
    equal(
        cubic,
        a[3]
        * sp.prod(z - root for root in roots)
        * (1 + sum(W / (z - root) for W, root in zip(weierstrass, roots, strict=True))),
    ),
    text="Lagrange's interpolation, written for three roots: both sides have the same leading coefficient and the same "
    "values at the three points.",
    assumptions=["the three points are different"],
).prove()
re_z, im_z = sp.symbols("re im", real=True)


def division(coefficients_, s, t):
    """Divide a polynomial, powers ascending, by z² − s z + t: quotient, and the rest as (constant, linear)."""
    b = [sp.S.Zero] * (len(coefficients_) + 2)
    for k in range(len(coefficients_) - 1, 0, -1):
        b[k] = coefficients_[k] + s * b[k + 1] - t * b[k + 2]
    return b[2 : len(coefficients_)], (coefficients_[0] - t * b[2], b[1])


quintic = sp.symbols("a_:6", real=True)
s_z, t_z = 2 * re_z, re_z**2 + im_z**2
quotient, rest = division(quintic, s_z, t_z)
_, rest_again = division(quotient, s_z, t_z)
value = sum(x * z**k for k, x in enumerate(quintic))
point = re_z + sp.I * im_z
d.check(
    "value-and-slope",
    equal(sp.re(sp.expand(value.subs(z, point))), rest[0] + rest[1] * re_z),
    equal(sp.im(sp.expand(value.subs(z, point))), rest[1] * im_z),
    equal(
        sp.re(sp.expand(value.diff(z).subs(z, point))),
        rest[1] - 2 * im_z * (rest_again[1] * im_z),
    ),
    equal(
        sp.im(sp.expand(value.diff(z).subs(z, point))),
        2 * im_z * (rest_again[0] + rest_again[1] * re_z),
    ),
    text="A real polynomial and its derivative at a complex number, by real divisions; written for the degree 5.",
).prove()

# %% [markdown]
# ## The equations and their derivatives
#
# Newton's method needs the derivatives; each is linear in the same vectors again. Every second derivative of $f_e$ is
# no more than $S_e$, the sum of the sizes of the nine coefficients. So with $\kappa$, the larger component of
# $|J^{-1}|\vec S$, the derivative relative to that at a point changes by no more than $4\kappa$ times the larger change
# of an angle, and Kantorovich's theorem reads: where a Newton step $\eta$ is so short that $8\kappa\eta\le1$, there is
# exactly one solution within $1/(4\kappa)$, and it is not farther off than $2\eta$.

# %%
theta_1 = d.symbol("theta_1", r"\theta_1", "first angle", "rad")
theta_2 = d.symbol("theta_2", r"\theta_2", "second angle", "rad")


def of_angle(angle):
    return sp.Matrix([1, sp.cos(angle), sp.sin(angle)])


def slope_of(u):
    """Derivative of (1, cos, sin)."""
    return sp.Matrix([0, -u[2], u[1]])


u, v = of_angle(theta_1), of_angle(theta_2)
equations = sp.Matrix([(u.T * m * v)[0] for m in M])
slopes = sp.Matrix([[(slope_of(u).T * m * v)[0], (u.T * m * slope_of(v))[0]] for m in M])
d.check(
    "derivatives",
    equal(im(equations.jacobian([theta_1, theta_2])), im(slopes)),
    text="The derivatives of both equations.",
).prove()

# %% [markdown]
# ## The kernels
#
# The first prepares the two equations: each is scaled to a size of 1 to 2, and the second is made orthogonal to the
# first, which changes no solution and makes nearly dependent equations independent as far as rounding allows. The
# others compute the octic; do a step of Ehrlich and Aberth's method for all eight roots at once; decide by the discs
# which roots are real; find the second angle of each; and polish both angles, with bounds of their errors.


# %%
class PairRoots(IntEnum):
    """What is known about the eight roots of an octic.

    CERTAIN: which of them are real is proved, and each real one stands alone.
    UNCERTAIN: two are too near each other to tell, or a number is not finite.
    """

    CERTAIN = 0
    UNCERTAIN = 1


SOURCE = "derivation biquadratic_pair; Robot Geometry, pairs of biquadratics"


def absolute_sum(values):
    return sum((abs(x) for x in values), sp.S.Zero)


def pair_prepared():
    k = KernelBuilder(
        "pair_prepared",
        summary="Two equations in two angles, scaled and made perpendicular as vectors of their coefficients.",
        source=SOURCE,
        notes="loss is the factor by which the second one shrank; the largest number where the two are dependent.",
    )
    first = k.input("first", (3, 3), unit="1", doc="coefficients of the first equation")
    second = k.input("second", (3, 3), unit="1", doc="coefficients of the second equation")
    scaled = []
    good = sp.true
    for name, m in (("a", first), ("b", second)):
        size = k.let(f"size_{name}", absolute_sum(list(m / 8)))
        good = k.let(f"good_{name}", good & (size <= LARGEST))
        scaled.append(k.let(f"scaled_{name}", m * power_of_two_scale(size) / 4))
    one, two = scaled
    length = k.let("square", sum((x**2 for x in one), sp.S.Zero))
    share = k.let(
        "share",
        sum((x * y for x, y in zip(one, two, strict=True)), sp.S.Zero) / select(length > 0, length, 1),
    )
    rest = k.let("rest", two - share * one)
    before = k.let("before", absolute_sum(list(two)) + abs(share) * absolute_sum(list(one)))
    left = k.let("left", absolute_sum(list(rest)))
    scale = k.let("rest_scale", power_of_two_scale(left))
    there = k.let("there", good & (left > 0) & (length > 0))
    k.output("one", select(good, one, sp.ones(3, 3) * sp.nan), unit="1", doc="the first equation, scaled")
    k.output(
        "two",
        select(good, rest * scale / 2, sp.ones(3, 3) * sp.nan),
        unit="1",
        doc="the second equation, made perpendicular to the first and scaled",
    )
    k.output(
        "loss",
        select(there, before / select(there, left, 1), LARGEST),
        unit="1",
        doc="factor by which rounding errors grow",
    )
    return k.build()


CANDIDATES = [(sp.cos(j * sp.pi / 4), sp.sin(j * sp.pi / 4)) for j in range(8)]


def pair_octic():
    k = KernelBuilder(
        "pair_octic",
        summary="The octic of two equations in two angles, in the tangent of half the first angle from a turn on.",
        source=SOURCE,
        notes="Of eight turns it is the one with the largest leading coefficient, so that no root is far out.",
    )
    one = k.input(
        "one", (3, 3), unit="1", doc="coefficients of the first equation, by (1, cos, sin) of both angles"
    )
    two = k.input("two", (3, 3), unit="1", doc="those of the second")
    m = [[k_.row(i).T for i in range(3)] for k_ in (one, two)]
    letters_k = [k.let(f"k{j}", value) for j, value in enumerate(coefficients(m))]
    best = None
    for j, (c, s) in enumerate(CANDIDATES):
        # n at the angle τ + π, where x is infinite
        at = letters_k[0] - c * letters_k[1] - s * letters_k[2]
        at += (c**2 - s**2) * letters_k[3] + 2 * c * s * letters_k[4]
        value = k.let(f"value{j}", abs((at[1] - at[0]) * (at[1] + at[0]) + at[2] ** 2))
        if best is None:
            best = (value, sp.Integer(1), sp.Integer(0))
        else:
            better = k.let(f"better{j}", value > best[0])
            best = tuple(
                k.let(f"{name}{j}", select(better, new, old))
                for name, new, old in zip(("best", "cosine", "sine"), (value, c, s), best, strict=True)
            )
    turned_k = [k.let(f"t{j}", value) for j, value in enumerate(turned(letters_k, best[1], best[2]))]
    quartics = [k.let(f"q{i}", sp.Matrix(quartic([t[i] for t in turned_k]))) for i in range(3)]
    difference = k.let("minus", quartics[1] - quartics[0])
    total = k.let("plus", quartics[1] + quartics[0])
    octic_ = [
        a_ + b_
        for a_, b_ in zip(product_of(difference, total), product_of(quartics[2], quartics[2]), strict=True)
    ]
    sizes = [
        sum((sp.sqrt(row.dot(row)) for row in equation), sp.S.Zero) for equation in m
    ]  # |n| is no more than their product
    k.output("octic", sp.Matrix(octic_), unit="1", doc="coefficients, powers ascending")
    k.output("turn", sp.Matrix(best[1:]), unit="1", doc="cosine and sine of the angle that is counted from")
    k.output("size", (sizes[0] * sizes[1]) ** 2, unit="1", doc="of the terms of the octic, over (1 + x²)⁴")
    return k.build()


def value_and_slope(k, name, octic_, x, y):
    """Value and derivative at x + iy, each as (real, imaginary); the octic is a column of nine."""
    s, t = k.let(f"s{name}", 2 * x), k.let(f"t{name}", x**2 + y**2)

    def divided(letter, given):
        b = [sp.S.Zero] * (len(given) + 2)
        for power in range(len(given) - 1, 0, -1):
            value = given[power] + s * b[power + 1] - t * b[power + 2]
            b[power] = k.let(f"{letter}{name}_{power}", value) if b[power + 1] != 0 else value
        return b[2 : len(given)], given[0] - t * b[2], b[1]

    quotient_, constant, linear = divided("b", list(octic_))
    _, constant_again, linear_again = divided("c", quotient_)
    value_ = (k.let(f"re{name}", constant + linear * x), k.let(f"im{name}", linear * y))
    twice = 2 * y
    slope = (
        k.let(f"slope_re{name}", linear - twice * (linear_again * y)),
        k.let(f"slope_im{name}", twice * (constant_again + linear_again * x)),
    )
    return value_, slope


def pair_aberth():
    k = KernelBuilder(
        "pair_aberth",
        summary="A step of Ehrlich and Aberth's method for the eight roots of a real octic.",
        source="Ehrlich 1967, Aberth 1973; derivation biquadratic_pair",
        notes="Each root moves by Newton's step of the octic deflated by the other seven roots.",
    )
    octic_ = k.input("octic", 9, unit="1", doc="coefficients, powers ascending")
    z_ = k.input("roots", (8, 2), unit="1", doc="approximations, real and imaginary part")
    parts = [value_and_slope(k, i, octic_, z_[i, 0], z_[i, 1]) for i in range(8)]
    sums = [[sp.S.Zero, sp.S.Zero] for _ in range(8)]
    for i in range(8):
        for j in range(i):
            dx, dy = k.let(f"dx{i}{j}", z_[i, 0] - z_[j, 0]), k.let(f"dy{i}{j}", z_[i, 1] - z_[j, 1])
            square = dx**2 + dy**2
            by = k.let(f"by{i}{j}", select(square > 0, 1 / select(square > 0, square, 1), 0))
            for one, sign in ((i, 1), (j, -1)):
                sums[one][0] += sign * dx * by
                sums[one][1] -= sign * dy * by
    moved, largest = [], sp.S.Zero
    for i, ((re_p, im_p), (re_s, im_s)) in enumerate(parts):
        re_w, im_w = k.let(f"sum_re{i}", sums[i][0]), k.let(f"sum_im{i}", sums[i][1])
        below_re = k.let(f"below_re{i}", re_s - (re_p * re_w - im_p * im_w))
        below_im = k.let(f"below_im{i}", im_s - (re_p * im_w + im_p * re_w))
        square = below_re**2 + below_im**2
        by = k.let(f"inverse{i}", select(square > 0, 1 / select(square > 0, square, 1), 0))
        step_re = k.let(f"step_re{i}", (re_p * below_re + im_p * below_im) * by)
        step_im = k.let(f"step_im{i}", (im_p * below_re - re_p * below_im) * by)
        moved.append([z_[i, 0] - step_re, z_[i, 1] - step_im])
        share = (step_re**2 + step_im**2) / (1 + z_[i, 0] ** 2 + z_[i, 1] ** 2) ** 2
        share = k.let(f"share{i}", share)
        largest = share if i == 0 else k.let(f"largest{i}", select(share > largest, share, largest))
    k.output("moved", sp.Matrix(moved), unit="1", doc="the roots after the step")
    k.output("change", largest, unit="1", doc="largest square of a step, over (1 + |z|²)²")
    return k.build()


# The error of a coefficient of the octic, over its size, and of the octic at a root: some thirty roundings, times the
# largest sum of the sizes of the powers in (1 + x²)⁴.
NOISE = 256 * EPS
# A root of this imaginary part, over 1 + |z|², is taken for real and must then be proved to be.
NEARLY_REAL = sp.Rational(1, 2**24)


def pair_real_roots():
    k = KernelBuilder(
        "pair_real_roots",
        summary="Which roots of an octic are real, proved by inclusion discs.",
        source="Smith 1970; derivation biquadratic_pair",
    )
    octic_ = k.input("octic", 9, unit="1", doc="coefficients, powers ascending")
    size = k.input("size", unit="1", doc="of the octic's terms, over (1 + x²)⁴, times the loss")
    z_ = k.input("roots", (8, 2), unit="1", doc="approximations, real and imaginary part")
    noise = k.let("noise", NOISE * size)
    x, y, real, above = [], [], [], []
    for i in range(8):
        whole = k.let(f"whole{i}", 1 + z_[i, 0] ** 2 + z_[i, 1] ** 2)
        is_real = k.let(f"is_real{i}", abs(z_[i, 1]) <= NEARLY_REAL * whole)
        x.append(z_[i, 0])
        y.append(k.let(f"y{i}", select(is_real, 0, z_[i, 1])))
        real.append(is_real)
        (re_p, im_p), _ = value_and_slope(k, i, octic_, x[i], y[i])
        above.append(k.let(f"above{i}", abs(re_p) + abs(im_p) + noise * whole**4))
    squares = {}
    for i in range(8):
        for j in range(i):
            squares[i, j] = k.let(f"square{i}{j}", (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2)
    radii = []
    leading = k.let("leading", abs(octic_[8]))
    for i in range(8):
        around = sp.prod(squares[max(i, j), min(i, j)] for j in range(8) if j != i)
        product = k.let(f"around{i}", leading * sp.sqrt(around))
        radii.append(k.let(f"radius{i}", 8 * above[i] / product))
    certain = sp.true
    for i in range(8):
        apart = sp.true
        for j in range(8):
            if j != i:
                apart = apart & ((radii[i] + radii[j]) ** 2 < squares[max(i, j), min(i, j)])
        alone = k.let(f"alone{i}", real[i] & apart)
        off = k.let(f"off{i}", abs(y[i]) > radii[i])
        certain = k.let(f"certain{i}", certain & (alone | off))
    k.output(
        "tangents",
        sp.Matrix([select(certain & real[i], x[i], sp.nan) for i in range(8)]),
        unit="1",
        doc="the real roots; NaN for the others, and for all where they are not certain",
    )
    k.output(
        "radii",
        sp.Matrix([select(real[i], radii[i], 0) for i in range(8)]),
        unit="1",
        doc="bounds of their errors",
    )
    k.status(
        "status",
        sp.Piecewise((PairRoots.CERTAIN, certain), (PairRoots.UNCERTAIN, True), evaluate=False),
        PairRoots,
        doc="whether that is proved",
    )
    return k.build()


def rows_at(one, two, cosine_, sine_):
    """The two equations as rows in (1, cos, sin) of the second angle."""
    return [m.row(0).T + cosine_ * m.row(1).T + sine_ * m.row(2).T for m in (one, two)]


def pair_angles():
    k = KernelBuilder(
        "pair_angles",
        summary="Both angles for a real root of the octic of two equations in two angles.",
        source=SOURCE,
    )
    one = k.input("one", (3, 3), unit="1", doc="coefficients of the first equation")
    two = k.input("two", (3, 3), unit="1", doc="those of the second")
    turn_ = k.input("turn", 2, unit="1", doc="cosine and sine of the angle that is counted from")
    x = k.input("tangent", unit="1", doc="tangent of half the first angle from there on")
    by = k.let("by", 1 / (1 + x**2))
    c, s = k.let("c", (1 - x) * (1 + x) * by), k.let("s", 2 * x * by)
    cosine_ = k.let("cosine", turn_[0] * c - turn_[1] * s)
    sine_ = k.let("sine", turn_[1] * c + turn_[0] * s)
    row_a, row_b = (k.let(f"row{j}", row) for j, row in enumerate(rows_at(one, two, cosine_, sine_)))
    normal = k.let("normal", row_a.cross(row_b))
    sign = k.let("sign", select(normal[0] < 0, -1, 1))
    k.output(
        "angles",
        sp.Matrix([sp.atan2(sine_, cosine_), sp.atan2(sign * normal[2], sign * normal[1])]),
        unit="rad",
        doc="first and second angle",
    )
    return k.build()


STEPS = 2
LARGEST_STEP = sp.Rational(1, 2)


def pair_polish():
    k = KernelBuilder(
        "pair_polish",
        summary="Newton's method for two equations in two angles, with bounds of the errors.",
        source=SOURCE,
        notes=f"{STEPS} steps, none longer than {LARGEST_STEP} rad; where the derivative is nearly singular, those of "
        "least squares.",
    )
    one = k.input("one", (3, 3), unit="1", doc="coefficients of the first equation")
    two = k.input("two", (3, 3), unit="1", doc="those of the second")
    angles = k.input("angles", 2, unit="rad", doc="first and second angle")
    sizes = [k.let(f"size{j}", absolute_sum(list(m))) for j, m in enumerate((one, two))]
    first, second = angles

    def at(step):
        """Values and derivatives."""
        vectors = []
        for name, angle in (("u", first), ("v", second)):
            c, s = k.let(f"c{name}{step}", sp.cos(angle)), k.let(f"s{name}{step}", sp.sin(angle))
            vectors.append(sp.Matrix([1, c, s]))
        u_, v_ = vectors
        values, slopes_ = [], []
        for j, m in enumerate((one, two)):
            row, column = k.let(f"row{j}_{step}", m.T * u_), k.let(f"column{j}_{step}", m * v_)
            values.append(k.let(f"f{j}_{step}", row.dot(v_)))
            slopes_.append([
                k.let(f"j{j}_{step}", column[2] * u_[1] - column[1] * u_[2]),
                k.let(f"i{j}_{step}", row[2] * v_[1] - row[1] * v_[2]),
            ])  # fmt: skip
        return values, slopes_

    for step in range(STEPS):
        (f, g), ((fa, fb), (ga, gb)) = at(step)
        det = k.let(f"det{step}", fa * gb - fb * ga)
        trace = k.let(f"trace{step}", fa**2 + fb**2 + ga**2 + gb**2)
        # near solutions that meet the plain step goes along the curve on which they lie, the damped one hardly at all
        regular = k.let(f"regular{step}", abs(det) > 64 * EPS * trace)
        # least squares with a trace of damping
        damping = k.let(f"damping{step}", EPS * trace)
        aa, bb = fa**2 + ga**2 + damping, fb**2 + gb**2 + damping
        ab = k.let(f"ab{step}", fa * fb + ga * gb)
        aa, bb = k.let(f"aa{step}", aa), k.let(f"bb{step}", bb)
        ra, rb = k.let(f"ra{step}", fa * f + ga * g), k.let(f"rb{step}", fb * f + gb * g)
        below = k.let(f"below{step}", select(regular, det, aa * bb - ab**2))
        by = k.let(f"by{step}", select(sp.Ne(below, 0), 1 / select(sp.Ne(below, 0), below, 1), 0))
        step_a = k.let(f"step_a{step}", select(regular, gb * f - fb * g, bb * ra - ab * rb) * by)
        step_b = k.let(f"step_b{step}", select(regular, fa * g - ga * f, aa * rb - ab * ra) * by)
        longest = k.let(f"longest{step}", select(abs(step_a) > abs(step_b), abs(step_a), abs(step_b)))
        short = k.let(
            f"short{step}", select(longest > LARGEST_STEP, LARGEST_STEP / select(longest > 0, longest, 1), 1)
        )
        first, second = (
            k.let(f"first{step}", first - short * step_a),
            k.let(f"second{step}", second - short * step_b),
        )
    (f, g), ((fa, fb), (ga, gb)) = at("end")
    det = k.let("determinant_end", fa * gb - fb * ga)
    residuals = [k.let(f"miss{j}", abs(x) / sizes[j]) for j, x in enumerate((f, g))]
    condition = [abs(gb) * sizes[0] + abs(fb) * sizes[1], abs(ga) * sizes[0] + abs(fa) * sizes[1]]
    condition = [k.let(f"condition{j}", x) for j, x in enumerate(condition)]
    worst = k.let("worst", select(condition[0] > condition[1], condition[0], condition[1]))
    k.output("polished", sp.Matrix([first, second]), unit="rad", doc="first and second angle")
    k.output(
        "residual", select(residuals[0] > residuals[1], *residuals), unit="1", doc="of the equations, over S"
    )
    k.output(
        "condition",
        select(sp.Ne(det, 0), worst / select(sp.Ne(det, 0), abs(det), 1), LARGEST),
        unit="1",
        doc="largest component of |J⁻¹| S",
    )
    k.output("determinant", det, unit="1", doc="of the derivatives")
    return k.build()


kernels = {
    k.name: k
    for k in (pair_prepared(), pair_octic(), pair_aberth(), pair_real_roots(), pair_angles(), pair_polish())
}

# %%
derivation.kernel(*kernels.values())
derivation.kernels
