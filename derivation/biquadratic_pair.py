# %% [markdown]
# # Two equations in two angles
#
# Mechanisms of group 2, and robots whose wrist can be decoupled from the rest, lead to two equations in two angles,
# each of them linear in $(1,\cos\theta_1,\sin\theta_1)$ and in $(1,\cos\theta_2,\sin\theta_2)$:
#
# $$f_e=\vec u^T M_e\,\vec v=0,\qquad \vec u=(1,\cos\theta_1,\sin\theta_1),\quad
# \vec v=(1,\cos\theta_2,\sin\theta_2),\quad e=1,2.$$
#
# How many solutions do they have, and how are all of them found? With the tangents of the half angles they become two
# biquadratics, and elimination of one of them leaves an equation of degree eight for the other, an octic. The lecture
# notes name two ways of elimination, Sylvester's and Bezout's, and give neither. Here both are derived, and proved to
# lead to the same octic; and so does a third way, a cross product, which needs no tangents. So there are no more than
# eight solutions, unless the two equations have a common factor.
#
# The functions made here find the roots of the octic, prove which of them are real, and improve the angles on the
# two equations themselves, with a bound of the error that is left.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, dot, equal, power_of_two_scale, select

d = derivation = Derivation(
    "biquadratic_pair",
    title="Two equations in two angles: Sylvester, Bezout, and the cross product",
    source='Lecture notes "Robot Geometry" after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)
im = sp.ImmutableMatrix

# %% [markdown]
# ## Symbols
#
# $M_1$ and $M_2$ are the known coefficients, two matrices of three rows and columns. Where one equation is as good as
# the other, its number is left out.

# %%
x1 = d.symbol("x_1", "x_1", "tangent of half the first angle", "1")
x3 = d.symbol("x_3", "x_3", "tangent of half the second angle, which the notes call the third", "1")
theta_1 = d.symbol("theta_1", r"\theta_1", "first angle", "rad")
theta_2 = d.symbol("theta_2", r"\theta_2", "second angle", "rad")
psi = d.symbol("psi", r"\psi", "the first angle, counted from the turn", "rad")
turn = d.symbol("turn", r"\tau", "the turn: where the first angle is counted from", "rad")
M = [sp.Matrix(3, 3, sp.symbols(f"m_{e}_:3_:3", real=True)) for e in (1, 2)]
HALF = sp.Matrix([[1, 1, 0], [0, 0, 2], [1, -1, 0]])
coefficients_of_one = d.matrix(
    "M", "M", "coefficients of an equation, (1, cos, sin) by rows and columns", "1", value=M[0]
)
half_angles = d.matrix("H", "H", "(1, cos, sin) by powers of the tangent", "1", value=HALF)
d

# %% [markdown]
# ## From angles to biquadratics
#
# With $x=\tan\frac\theta2$, $(1+x^2)(1,\cos\theta,\sin\theta)=(1+x^2,\ 1-x^2,\ 2x)$. So each equation, multiplied by
# $(1+x_1^2)(1+x_3^2)$, is a quadratic in $x_1$ and in $x_3$. The notes call its coefficients $a$ to $j$, without $c$:


# %%
def by_tangent(x):
    """(1, cos, sin) of twice the arc tangent, times 1 + x²."""
    return sp.Matrix([1 + x**2, 1 - x**2, 2 * x])


def powers(x, degree=2):
    return sp.Matrix([x**k for k in range(degree + 1)])


letters = {"a": 22, "b": 21, "d": 20, "e": 12, "f": 11, "g": 10, "h": "02", "i": "01", "j": "00"}
E = HALF * M[0].T * HALF.T  # power of x3, power of x1
of_notes = {
    letter: d.symbol(
        f"{letter}_of_notes",
        letter,
        f"coefficient of x₃^{str(place)[0]} x₁^{str(place)[1]}",
        "1",
        value=E[int(str(place)[0]), int(str(place)[1])],
    )
    for letter, place in letters.items()
}
printed = sum(
    x3 ** int(str(place)[0]) * x1 ** int(str(place)[1]) * of_notes[n] for n, place in letters.items()
)
multiplied = d.letter(
    r"multiplied | (1+x_1^2)(1+x_3^2)\,\vec u^T M\,\vec v | an equation by the tangents | 1",
    (by_tangent(x1).T * M[0] * by_tangent(x3))[0],
)
biquadratic = d.matrix(
    "E", "E", "coefficients of a biquadratic, by powers 0 to 2 of x₃ (rows) and of x₁ (columns)", "1", value=E
)
d.state(
    "biquadratic",
    equal(multiplied, printed),
    equal(
        sp.ImmutableMatrix(3, 3, [of_notes[n] for n in "jihgfedba"]),
        half_angles * coefficients_of_one.T * half_angles.T,
    ),
    text="Each equation of the two angles is the biquadratic x₃²(a x₁² + b x₁ + d) + x₃(e x₁² + f x₁ + g) + (h x₁² + "
    "i x₁ + j).",
    place="Solve x₃²(…) + x₃(…) + (…) = 0",
).prove(because="The nine products of (1 + x², 1 − x², 2x) for both tangents are collected by powers.")

# %% [markdown]
# Nothing is lost on the way back: from any biquadratic one gets an equation of two angles.

# %%
d.check(
    "biquadratic-back",
    equal(im(HALF.inv()) * biquadratic * im(HALF.T.inv()), coefficients_of_one.T),
    text="Every biquadratic is an equation of two angles, because H has an inverse.",
).prove(
    because="E = H Mᵀ Hᵀ is multiplied by the inverse of H from the left and by its transpose from the right."
)

# %% [markdown]
# But a tangent can be infinite where the angle is not:

# %%
leading = d.vector(
    "E_leading", r"E_{x_1^2}", "coefficients of x₁² in the biquadratic, by powers of x₃", "1", value=E[:, 2]
)
d.state(
    "all-have-tangents",
    sp.Ne(sp.cos(psi / 2), 0),
    tacit=True,
    text="A solution of the equations is a solution of the biquadratics.",
    place="Solve x₃²(…) + x₃(…) + (…) = 0",
    assumptions=[sp.Eq(sp.cos(psi) + 1, 0)],
).refute(
    {psi: sp.pi},
    equal(leading, half_angles * coefficients_of_one.T * sp.ImmutableMatrix([1, -1, 0])),
    label="Q1",
    because="At θ₁ = π the tangent is infinite. The biquadratic there is its coefficient of x₁², and where that of "
    "both equations has a common root, the octic below has lost a root to infinity. In angles nothing is lost.",
)

# %% [markdown]
# ## Sylvester's elimination
#
# As quadratics in $x_3$ the two equations are $E_e=p_e x_3^2+q_e x_3+r_e=0$, whose coefficients $p_e$, $q_e$, $r_e$ are
# quadratics in $x_1$. The two equations, and $x_3$ times each of them, are four equations that are linear in
# $(x_3^3,x_3^2,x_3,1)$:

# %%
p, q, r = (
    tuple(d.symbol(f"{letter}_{e}", f"{letter}_{e}", f"{what} in quadratic {e}", "1") for e in (1, 2))
    for letter, what in (
        ("p", "coefficient of x₃²"),
        ("q", "coefficient of x₃"),
        ("r", "constant coefficient"),
    )
)
quadratics = [p[e] * x3**2 + q[e] * x3 + r[e] for e in (0, 1)]
sylvester = sp.Matrix([
    [p[0], q[0], r[0], 0],
    [0, p[0], q[0], r[0]],
    [p[1], q[1], r[1], 0],
    [0, p[1], q[1], r[1]],
])  # fmt: skip
E1, E2 = (
    d.symbol(f"E_{e + 1}", f"E_{e + 1}", f"the quadratic {e + 1}, p x₃² + q x₃ + r", "1", value=quadratics[e])
    for e in (0, 1)
)
d.check(
    "sylvester",
    equal(sp.MatMul(im(sylvester), im([x3**3, x3**2, x3, 1])), im([x3 * E1, E1, x3 * E2, E2])),
    text="Where both equations have a common root, the right side is zero and the column is not: Sylvester's matrix "
    "is singular.",
).prove(because="Each row is one of the four equations, by powers of x₃.")


# %% [markdown]
# So the determinant of this matrix, a polynomial of $x_1$, is zero at every solution.
#
# ## Bezout's elimination
#
# Multiplied crosswise by their leading and by their last coefficients, the two equations leave two that are linear in
# $x_3$. Let $|pq|=p_1q_2-p_2q_1$, and $|pr|$ and $|qr|$ likewise.


# %%
def bracket(u, v):
    return u[0] * v[1] - u[1] * v[0]


pq, pr, qr = (
    d.symbol(name, rf"|{name}|", f"{name[0]}₁{name[1]}₂ − {name[0]}₂{name[1]}₁", "1", value=bracket(u, v))
    for name, u, v in (("pq", p, q), ("pr", p, r), ("qr", q, r))
)
bezout = sp.Matrix([[pq, pr], [pr, qr]])
d.check(
    "bezout",
    equal(
        sp.MatMul(im(bezout), im([x3, 1])),
        im([p[0] * E2 - p[1] * E1, (p[0] * x3 + q[0]) * E2 - (p[1] * x3 + q[1]) * E1]),
    ),
    text="Both rows vanish where the two equations hold.",
).prove(because="In the first row the squares of x₃ cancel, in the second the squares and the cubes.")

# %%
sylvester_det = d.symbol("det_S", r"\det S", "determinant of Sylvester's matrix", "1", value=sylvester.det())
bezout_det = d.symbol("det_B", r"\det B", "determinant of Bezout's matrix", "1", value=bezout.det())
d.check(
    "same-octic",
    equal(sylvester_det, pr**2 - pq * qr),
    equal(bezout_det, pq * qr - pr**2),
    text="The determinants are the same up to the sign, so both ways have the same roots, and neither has any that "
    "the other has not.",
).prove(because="Both determinants are expanded.")

# %% [markdown]
# The second angle follows from a root $x_1$ of the octic by one division:

# %%
root_1 = d.letter(
    r"E_1_at_root | E_1\big|_{x_3=-|pr|/|pq|} | first equation at the common root | 1",
    quadratics[0].subs(x3, -pr / pq),
)
d.check(
    "back-substitution",
    equal(pq**2 * root_1, p[0] * (pr**2 - pq * qr)),
    equal(qr * pr * (-pr / pq + qr / pr), -(qr / pq) * (pr**2 - pq * qr)),
    text="x₃ = −|pr|/|pq| solves the first equation where the octic |pr|² − |pq| |qr| vanishes, and there it is also "
    "−|qr|/|pr|. Where |pq| = |pr| = |qr| = 0 the two quadratics are proportional, and both their roots count.",
    assumptions=[sp.Ne(pq, 0), sp.Ne(pr, 0)],
).prove(because="Multiplied out; p₁ |qr| − q₁ |pr| + r₁ |pq| = 0, a determinant with two equal rows.")

# %% [markdown]
# ## The cross product
#
# There is a third way, without tangents. The two equations say that $\vec v$ is perpendicular to the two vectors
# $\vec r_e=M_e^T\vec u$, so it is a multiple of
#
# $$\vec n=\vec r_1\times\vec r_2=M_1^T\vec u\times M_2^T\vec u,\qquad \vec n=(n_0,n_1,n_2).$$
#
# A multiple of $\vec n$ is $(1,\cos\theta_2,\sin\theta_2)$ for some
# angle if and only if $n_1^2+n_2^2=n_0^2\ne0$. That is the octic again, without a tangent and without a special angle:

# %%
rows = [sp.Matrix(sp.symbols(f"r_{e}_:3", real=True)) for e in (1, 2)]
n = rows[0].cross(rows[1])
octic = n[1] ** 2 + n[2] ** 2 - n[0] ** 2
quadratic = [HALF * row for row in rows]  # coefficients of 1, x3, x3²
by_rows = {s: quadratic[e][2 - k] for k, pair in enumerate((p, q, r)) for e, s in enumerate(pair)}
n0, n1, n2 = (d.letter(f"n_{k} | n_{k} | component {k} of the cross product n | 1", n[k]) for k in range(3))
d.check(
    "cross-product",
    equal(4 * (n1**2 + n2**2 - n0**2), sylvester_det),
    text="n₁² + n₂² − n₀² is a quarter of Sylvester's determinant.",
).prove(
    given=by_rows,
    because="For each equation E = (1 + x₃², 1 − x₃², 2x₃) · r, so the coefficients of 1, x₃ and x₃² are H times the "
    "vector r. Inserted, both sides are the same polynomial of the six components.",
)

# %%
r_1, r_2 = (
    d.letter(rf"row_{e + 1}[3] | \vec r_{e + 1} | equation {e + 1} by (1, cos, sin) of θ₂: Mᵀu | 1", rows[e])
    for e in (0, 1)
)
normal = d.vector("normal", r"\vec n", "cross product of the two", "1", value=n)
d.check(
    "second-angle",
    *(equal(dot(row, normal), 0) for row in (r_1, r_2)),
    equal((n1 / n0) ** 2 + (n2 / n0) ** 2 - 1, (n1**2 + n2**2 - n0**2) / n0**2),
    text="v = n/n₀ solves both equations, and where the octic vanishes its last two components are the cosine and "
    "sine of an angle, θ₂.",
    assumptions=[sp.Ne(n0, 0)],
).prove(because="A cross product is perpendicular to both factors; the last line is a common denominator.")

# %% [markdown]
# Where $\vec n=0$ both equations are one equation of $\theta_2$, with two solutions or none; the octic, quadratic in
# $\vec n$, has a double root there. Where both $M_e^T\vec u=0$, every $\theta_2$ is a solution; where the octic
# vanishes identically, there is one for every $\theta_1$: a common factor of the two equations.
#
# ## The octic, and a turn that keeps its roots small
#
# By sines and cosines of the first angle, $\vec n$ has the degree 2: there are five vectors $\vec k_0$ to $\vec k_4$
# with


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


letters_n = tuple(d.symbol(f"k_{j}", f"k_{j}", f"a component of the vector k {j}", "1") for j in range(5))
cosine, sine = sp.cos(psi), sp.sin(psi)
harmonic = sp.Matrix([1, cosine, sine, sp.cos(2 * psi), sp.sin(2 * psi)])
trigonometric = sum(a * b for a, b in zip(letters_n, harmonic, strict=True))
c_turn, s_turn = sp.cos(turn), sp.sin(turn)
plain = [[M[e][i, :].T for i in range(3)] for e in (0, 1)]
u_psi = sp.Matrix([1, cosine, sine])
k_vectors = [
    d.letter(
        rf"k_vector_{j}[3] | \vec k_{j} | coefficient {j} of n, from the rows of both matrices | 1", value
    )
    for j, value in enumerate(coefficients(plain))
]
n_of_psi = d.letter(
    r"n_of_psi[3] | \vec n(\psi) | the cross product at the angle ψ | 1",
    (M[0].T * u_psi).cross(M[1].T * u_psi),
)
d.check(
    "coefficients-of-n",
    equal(n_of_psi, sum((a * b for a, b in zip(harmonic[1:], k_vectors[1:], strict=True)), k_vectors[0])),
    text="n by sines and cosines of the first angle and of twice the angle.",
).prove(
    because="The nine cross products of the rows of M₁ and M₂ are collected, with cos² ψ = (1 + cos 2ψ)/2 and so on."
)

# %% [markdown]
# If the first angle is counted from a turn $\tau$ on, $\theta_1=\tau+\psi$, the five coefficients $k_0$ to $k_4$ of
# each component change:

# %%
n_at_turn = d.letter(
    r"n_at_turn | n(\tau+\psi) | a component of n, at the angle τ + ψ | 1",
    trigonometric.subs(
        {
            cosine: c_turn * cosine - s_turn * sine,
            sine: s_turn * cosine + c_turn * sine,
            sp.cos(2 * psi): sp.cos(2 * turn + 2 * psi),
            sp.sin(2 * psi): sp.sin(2 * turn + 2 * psi),
        },
        simultaneous=True,
    ),
)
at_turn = [
    d.symbol(f"k_{j}_at_turn", f"k'_{j}", f"coefficient {j} after the turn", "1", value=value)
    for j, value in enumerate(turned(letters_n, c_turn, s_turn))
]
d.check(
    "turned",
    equal(n_at_turn, sum(a * b for a, b in zip(at_turn, harmonic, strict=True))),
    *(
        equal(one, formula)
        for one, formula in zip(
            at_turn,
            (
                letters_n[0],
                letters_n[1] * c_turn + letters_n[2] * s_turn,
                letters_n[2] * c_turn - letters_n[1] * s_turn,
                letters_n[3] * sp.cos(2 * turn) + letters_n[4] * sp.sin(2 * turn),
                letters_n[4] * sp.cos(2 * turn) - letters_n[3] * sp.sin(2 * turn),
            ),
            strict=True,
        )
    ),
    text="A component of n at the angle τ + ψ, with other coefficients.",
).prove(because="The addition theorems of sine and cosine, for ψ and for 2ψ.")

# %% [markdown]
# With the tangent $x_1$ of $\frac\psi2$ each component becomes a quartic, and so $n_1^2+n_2^2-n_0^2$ an octic:

# %%
circle = {
    cosine: (1 - x1**2) / (1 + x1**2),
    sine: 2 * x1 / (1 + x1**2),
    sp.cos(2 * psi): ((1 - x1**2) ** 2 - 4 * x1**2) / (1 + x1**2) ** 2,
    sp.sin(2 * psi): 4 * x1 * (1 - x1**2) / (1 + x1**2) ** 2,
}
n_of_x = d.letter("n_of_x | n(x_1) | a component of n, by the tangent | 1", trigonometric.subs(circle))
d.check(
    "quartic",
    equal((1 + x1**2) ** 2 * n_of_x, sum(a * x1**k for k, a in enumerate(quartic(letters_n)))),
    text="A component of n by the tangent, times (1 + x₁²)², is a quartic.",
).prove(because="cos ψ = (1 − x²)/(1 + x²), sin ψ = 2x/(1 + x²), and the same for twice the angle.")

# %% [markdown]
# So there are no more than eight solutions, unless the octic is zero everywhere. A root at infinity is one at
# $\theta_1=\tau+\pi$. A turn that is far from all roots therefore leaves no large ones; of eight turns the program
# takes the one with the largest leading coefficient.

# %% [markdown]
# ## Which roots are real
#
# A root found in floating point is an approximation. Is the root real, or is its imaginary part only small? Let
# $z_1,\ldots,z_8$ be approximations of the eight roots of the octic $P$ with the leading coefficient $a_8$, however
# they were found, and let
#
# $$W_i=\frac{P(z_i)}{a_8\prod_{j\ne i}(z_i-z_j)}$$
#
# be Weierstrass's corrections. They give $P$ exactly:

# %%
z = d.symbol("z", "z", "any complex number", "1", real=None)
roots = [d.symbol(f"z_{i}", f"z_{i}", f"approximation of the root {i}", "1", real=None) for i in (1, 2, 3)]
a = [d.symbol(f"a_{k}", f"a_{k}", f"coefficient of z{'⁰¹²³'[k]}", "1") for k in range(4)]
cubic = sum(a[k] * z**k for k in range(4))
others = [sp.prod(roots[i] - roots[j] for j in range(3) if j != i) for i in range(3)]
weierstrass = [cubic.subs(z, roots[i]) / (a[3] * others[i]) for i in range(3)]
P_of_z = d.symbol("P_of_z", "P(z)", "a cubic with the coefficients a₀ to a₃", "1", value=cubic)
W = [
    d.symbol(f"W_{i + 1}", f"W_{i + 1}", f"Weierstrass's correction {i + 1}", "1", value=weierstrass[i])
    for i in range(3)
]
d.check(
    "corrections",
    equal(
        P_of_z,
        a[3]
        * sp.prod(z - root for root in roots)
        * (1 + sum(w / (z - root) for w, root in zip(W, roots, strict=True))),
    ),
    text="Lagrange's interpolation at the approximations, written for three of them and a cubic.",
    assumptions=["the three points are different"],
).prove(
    because="Both sides are polynomials of degree three with the same leading coefficient and the same values at the "
    "three points.",
)

# %% [markdown]
# At a root of $P$ the sum $\sum W_i/(z-z_i)$ is $-1$. So one of its eight terms has at least the size $\frac18$, and
# every root is in one of the discs of radius $8|W_i|$ around $z_i$. A disc that meets no other has exactly one root
# (Smith). For a real polynomial this has two consequences:
#
# - a disc that does not meet the real axis has no real root;
# - a disc around a real $z_i$ that meets no other holds one root, and this is real, because its conjugate is in
#   the disc as well.
#
# Where $P$ itself is uncertain by rounding, the bound of that is added to $|P(z_i)|$.
#
# The values of $P$ and of its derivative at a complex number $z=x+iy$ are computed in real numbers. $P$ is divided by
# the real quadratic with the roots $x\pm iy$, $z^2-2xz+x^2+y^2$, which leaves a rest $\varrho_0+\varrho_1 z$; the
# quotient is divided once more, which leaves $\varrho'_0+\varrho'_1z$.

# %%
re_z, im_z = d.symbol("re", "x", "real part of z", "1"), d.symbol("im", "y", "imaginary part of z", "1")


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
parts = [
    d.symbol(name, letter, quantity, "1", value=part(sp.expand(polynomial.subs(z, point))))
    for name, letter, quantity, part, polynomial in (
        ("re_P", r"\Re P", "real part of P", sp.re, value),
        ("im_P", r"\Im P", "imaginary part of P", sp.im, value),
        ("re_slope", r"\Re P'", "real part of the derivative", sp.re, value.diff(z)),
        ("im_slope", r"\Im P'", "imaginary part of the derivative", sp.im, value.diff(z)),
    )
]
rho_0 = d.letter(r"rest_0 | \varrho_0 | constant part of the rest | 1", rest[0])
rho_1 = d.letter(r"rest_1 | \varrho_1 | linear part of the rest | 1", rest[1])
rho_0_again = d.letter(r"rest_again_0 | \varrho'_0 | constant part of the quotient's rest | 1", rest_again[0])
rho_1_again = d.letter(r"rest_again_1 | \varrho'_1 | linear part of the quotient's rest | 1", rest_again[1])
d.check(
    "value-and-slope",
    equal(parts[0], rho_0 + rho_1 * re_z),
    equal(parts[1], rho_1 * im_z),
    equal(parts[2], rho_1 - 2 * im_z * (rho_1_again * im_z)),
    equal(parts[3], 2 * im_z * (rho_0_again + rho_1_again * re_z)),
    text="A real polynomial and its derivative at a complex number, by real divisions; written for the degree 5.",
).prove(
    because="P is its divisor times the quotient, and the rest. At z the divisor is zero and its derivative is 2iy, "
    "so P(z) = ϱ₀ + ϱ₁z and P′(z) = ϱ₁ + 2iy (ϱ′₀ + ϱ′₁z).",
)

# %% [markdown]
# ## The last digits: Newton's method on the two equations
#
# The angles from the octic have lost digits by the elimination. They are improved by Newton's method on the two
# equations themselves. Its derivatives are linear in the same vectors again, with $\vec
# u'=(0,-\sin\theta_1,\cos\theta_1)$ and $\vec v'=(0,-\sin\theta_2,\cos\theta_2)$:


# %%
def of_angle(angle):
    return sp.Matrix([1, sp.cos(angle), sp.sin(angle)])


def slope_of(u):
    """Derivative of (1, cos, sin)."""
    return sp.Matrix([0, -u[2], u[1]])


u, v = of_angle(theta_1), of_angle(theta_2)
equations = sp.Matrix([(u.T * m * v)[0] for m in M])
slopes = sp.Matrix([[(slope_of(u).T * m * v)[0], (u.T * m * slope_of(v))[0]] for m in M])
jacobian = d.letter(
    r"J[2,2] | \frac{\partial(f_1,f_2)}{\partial(\theta_1,\theta_2)} | derivatives of the two equations | 1",
    equations.jacobian([theta_1, theta_2]),
)
products = [
    [
        d.symbol(
            f"slope_{e + 1}_{k + 1}",
            (r"{\vec u'}^T M_{0}\,\vec v" if k == 0 else r"\vec u^T M_{0}\,\vec v'").replace(
                "{0}", str(e + 1)
            ),
            f"equation {e + 1} with the derivative of the vector {k + 1}",
            "1",
            value=slopes[e, k],
        )
        for k in range(2)
    ]
    for e in range(2)
]
d.check(
    "derivatives",
    equal(jacobian, im(products)),
    text="The derivatives of both equations.",
).prove(because="f = uᵀMv is linear in u and in v, and u′ and v′ are their derivatives.")

# %% [markdown]
# How near is the solution? Every second derivative of $f_e$ is no larger than $S_e$, the sum of the sizes of the nine
# coefficients. Let $J$ be the matrix above and $\kappa$ the larger component of $|J^{-1}|\vec S$. Then the
# derivative, relative to that at a point, changes by no more than $4\kappa$ times the larger change of an angle, and
# Kantorovich's theorem reads: where a Newton step $\eta$ is so short that $8\kappa\eta\le1$, there is exactly one
# solution within $1/(4\kappa)$, and it is not farther off than $2\eta$.

# %% [markdown]
# ## The functions
#
# They are called one after the other:
#
# | function | what it does |
# | --- | --- |
# | `pair_prepared` | scales both equations, and makes the second perpendicular to the first |
# | `pair_octic` | computes the octic, with the best of eight turns |
# | `pair_aberth` | does a step of Ehrlich and Aberth's method for all eight roots at once |
# | `pair_real_roots` | decides by the discs which roots are real |
# | `pair_angles` | finds both angles for a real root, by the cross product |
# | `pair_polish` | does two steps of Newton's method, with bounds of the error |
#
# In the first function the coefficients of each equation are taken as a vector. To subtract a multiple of the first
# equation from the second changes no solution, and makes nearly dependent equations as independent as rounding allows.


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
