# %% [markdown]
# # How the axis of a rotation depends on the data
#
# A point is at $\vec\rho$ before and at $\vec\rho\,'$ after a rotation by the known angle $\chi$ about an axis through
# the origin. With $\vec m=\vec\rho\,'+\vec\rho$, $\vec r=\vec\rho\,'-\vec\rho$, $\kappa=\cot\frac\chi2$ and
# $|\vec\rho\,'|=|\vec\rho|$ the two unit axes are (notebook `rodrigues`, entry `solution`)
#
# $$ \vec e_\pm = \frac{\kappa\,\vec m\times\vec r \pm \sqrt{|\vec m|^2 - \kappa^2|\vec r|^2}\;\vec m}{|\vec
# m|^2}. $$
#
# How well is an axis known when the points and the angle were measured? This notebook proves
#
# 1. a form of that solution in sines and cosines, which shows when there is an axis;
# 2. which axis is best where the angle is too small for any;
# 3. the derivatives of the axis with respect to both points and the angle;
# 4. its covariance and its condition number, in closed form.
#
# The main result is the last: an error in the points, relative to their length, is multiplied by no more than
# $1/(2\sin\frac\chi2\,|\cos\gamma|)$ in the axis, where $\gamma$ is the angle between axis and point. The solver itself
# is made in the notebook `axis`.

# %%
import sympy as sp

from rodgen.symbolic import Derivation, cross, dot, equal, matrix_from_axis_angle, norm, rodrigues, skew

d = derivation = Derivation(
    "axis_sensitivity",
    title="How the axis of a rotation depends on the data",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
    kernels_in="those of the solver: 'rodgen kernels axis'",
)

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product, $[\vec a]_\times$ the matrix of the cross product with $\vec a$, and $I$ the
# unit matrix.

# %%
half = d.symbol("half_angle", r"\tfrac{\chi}{2}", "half the angle of rotation", "rad")
chi = d.symbol("angle", r"\chi", "angle of rotation of the body", "rad", value=2 * half)
kappa = d.symbol("cot_half", r"\kappa", "cotangent of half the angle", "1")
e = d.vector("axis", r"\vec e", "unit vector of the axis", "1")
rho = d.vector("rho", r"\vec\rho", "point before the rotation", "length")
rho_prime = d.vector("rho_prime", r"\vec\rho'", "point after the rotation", "length")
r = d.vector("r", r"\vec r", "displacement of the point, ρ′ − ρ", "length", value=rho_prime - rho)
m = d.vector("m", r"\vec m", "sum of the two vectors, ρ′ + ρ", "length", value=rho_prime + rho)
R = d.symbol("R", "R", "length of ρ", "length")
side = d.symbol("side", r"\sigma", "+1 or −1, one for each solution", "1")
either_side = {side: side**2 - 1}
height = sp.sqrt(norm(m) ** 2 - kappa**2 * norm(r) ** 2)


def axis(along_m: sp.Expr) -> sp.Expr:
    """Return the unit axis whose component along m is `along_m` / |m|."""
    return (kappa * cross(m, r) + along_m * m) / norm(m) ** 2


d

# %% [markdown]
# ## The half-angle form
#
# At $\chi = 0$ the cotangent $\kappa$ is infinite, so numbers are best computed with sines and unit vectors. Let
# $\hat m$ and $\hat r$ be the directions of $\vec m$ and $\vec r$, which are perpendicular to each other, and
# $\vec n = \hat m\times\hat r$. Then the axis lies in the plane of $\vec n$ and $\hat m$, at an angle $b$ from
# $\vec n$:
#
# $$ \vec e_\pm = \cos b\;\vec n \pm \sin b\;\hat m,\qquad
#    \cos b = \frac{\cos\frac\chi2\,|\vec r|}{\sin\frac\chi2\,|\vec m|},\qquad
#    \sin b = \frac{\sqrt{(\sin\frac\chi2|\vec m| - \cos\frac\chi2|\vec r|)
#    (\sin\frac\chi2|\vec m| + \cos\frac\chi2|\vec r|)}}{\sin\frac\chi2\,|\vec m|}. $$
#
# (Where $\sin\frac\chi2\cos\frac\chi2 < 0$, $b$ is obtuse.)

# %%
sine, cosine = sp.sin(half), sp.cos(half)
m_hat = d.vector("m_hat", r"\hat m", "unit vector along m", "1", value=m / norm(m))
r_hat = d.vector("r_hat", r"\hat r", "unit vector along r", "1", value=r / norm(r))
n = d.vector("n", r"\vec n", "unit vector m̂ × r̂, along ρ × ρ′", "1", value=cross(m_hat, r_hat))
cos_b = d.letter(r"cos_b | \cos b | cosine of the angle from n to e | 1", cosine * norm(r) / (sine * norm(m)))
root_b = d.letter(
    r"root_b | \varrho | the root in sin b | length",
    sp.sqrt((sine * norm(m) - cosine * norm(r)) * (sine * norm(m) + cosine * norm(r))),
)
sin_b = d.symbol("sin_b", r"\sin b", "its sine, times ±1", "1", value=side * root_b / (sine * norm(m)))
d.check(
    "half-angle-form",
    equal(axis(side * root_b / sine), cos_b * n + sin_b * m_hat),
    equal((root_b / sine) ** 2, height**2),
    equal(cos_b**2 + sin_b**2, 1),
    text="The half-angle form is the solution e±, where ϱ / sin(χ/2) is the root in it; and cos b and sin b belong "
    "to one angle.",
).prove(
    given={kappa: cosine / sine},
    modulo=either_side,
    because="With κ = cos(χ/2) / sin(χ/2), m × r = |m| |r| n and m = |m| m̂ the components of both sides are the "
    "same; for the last two equations, ϱ² is a difference of two squares.",
)

# %% [markdown]
# When do these axes exist? The factors under the root are $2|\vec\rho|\sin(\frac\chi2 \mp a)$, where $2a$ is the
# angle between $\vec\rho$ and $\vec\rho\,'$. So for $0 < \chi \le \pi$ there are two axes if
# $\frac\chi2 > a$; at $\frac\chi2 = a$ they meet in $\vec n$; and below, there is none: no rotation by $\chi$ turns a
# vector by more than $\chi$.

# %%
small_a = d.symbol("a_half", "a", "half the angle between ρ and ρ′", "rad")
d.check(
    "gap",
    equal(norm(r), 2 * R * sp.sin(small_a)),
    equal(norm(m), 2 * R * sp.cos(small_a)),
    equal(sine * norm(m) - cosine * norm(r), 2 * R * sp.sin(half - small_a)),
    equal(sine * norm(m) + cosine * norm(r), 2 * R * sp.sin(half + small_a)),
    text="The lengths of r and m, and the two factors under the root.",
    assumptions=["ρ = R (cos a, −sin a, 0) and ρ′ = R (cos a, sin a, 0) with R > 0 and 0 ≤ a ≤ π/2"],
).prove(
    *[
        equal(norm(r) ** 2, (2 * R * sp.sin(small_a)) ** 2),
        equal(norm(m) ** 2, (2 * R * sp.cos(small_a)) ** 2),
    ],
    *[
        equal(2 * R * (sine * sp.cos(small_a) - cosine * sp.sin(small_a)), 2 * R * sp.sin(half - small_a)),
        equal(2 * R * (sine * sp.cos(small_a) + cosine * sp.sin(small_a)), 2 * R * sp.sin(half + small_a)),
    ],
    given={
        rho: R * sp.Matrix([sp.cos(small_a), -sp.sin(small_a), 0]),
        rho_prime: R * sp.Matrix([sp.cos(small_a), sp.sin(small_a), 0]),
    },
    because="The squares of |r| and 2R sin a agree, and those of |m| and 2R cos a; all four are not negative. With "
    "these lengths the last two equations are the addition theorem of the sine.",
)

# %% [markdown]
# ## Where the angle is too small
#
# What if $\frac\chi2 < a$, because the data have errors? Then $\vec n$ is the best axis: it brings $\vec\rho$ closest
# to $\vec\rho\,'$, and the angle $2a - \chi$ remains between them. To see it, let both points be unit vectors, and
# write any axis as $\vec e = e_1\hat r + e_2\hat m + e_3\vec n$. Let $R_{\vec e}$ be the rotation by $\chi$ about it.
# The nearer $R_{\vec e}\,\vec\rho$ is to $\vec\rho\,'$, the larger is the scalar product $(\vec\rho\,',
# R_{\vec e}\,\vec\rho)$. It falls short of its value for $\vec n$ by a sum of three terms, none of them negative:

# %%
x, y, z = e
in_plane = {
    rho: (sp.cos(small_a), -sp.sin(small_a), 0),
    rho_prime: (sp.cos(small_a), sp.sin(small_a), 0),
}


def agreement(axis: sp.Matrix) -> sp.Expr:
    """Return the scalar product of ρ′ with ρ rotated by χ about the axis; its components are along r̂, m̂, n."""
    in_frame = sp.Matrix([axis[1], axis[0], axis[2]])  # m̂ is Ox and r̂ is Oy; n = m̂ × r̂ is Oz
    turned = matrix_from_axis_angle(in_frame, sp.cos(2 * half), sp.sin(2 * half))
    return d.value(dot(rho_prime.components, turned * rho.components), in_plane)


best, any_other = (
    d.symbol(
        name,
        rf"\left(\vec\rho', R_{{{axis}}}\vec\rho\right)",
        f"agreement for the axis {axis[-1]}",
        "1",
        value=value,
    )
    for name, axis, value in (
        ("agreement_n", r"\vec n", agreement(sp.Matrix([0, 0, 1]))),
        ("agreement_e", r"\vec e", agreement(sp.Matrix([x, y, z]))),
    )
)
d.check(
    "least-squares-axis",
    equal(
        best - any_other,
        2 * sine**2 * x**2
        + 4 * sine * sp.cos(small_a) * sp.sin(small_a - half) * (1 - z)
        + 2 * sine**2 * sp.cos(small_a) ** 2 * (1 - z) ** 2,
    ),
    equal(best, sp.cos(2 * small_a - chi)),
    text="Where χ/2 < a, the least-squares axis is n, and the angle 2a − χ remains.",
    assumptions=[equal(norm(e), 1), "0 ≤ χ/2 ≤ a ≤ π/2"],
).prove(
    modulo={y: dot(e, e) - 1},
    because="With ρ = cos a m̂ − sin a r̂ and ρ′ = cos a m̂ + sin a r̂ both sides agree where |e| = 1. "
    "On the right sin(a − χ/2), cos a, sin(χ/2) and 1 − e₃ are not negative.",
)

# %% [markdown]
# ## Derivatives
#
# How does the axis move when the data do? A unit axis solves $\kappa\vec r = \vec e\times\vec m$ and
# $(\vec e,\vec e) = 1$ (notebook `rodrigues`, entry `cayley`). Differentiate both:
#
# $$ \mathrm{d}\vec e\times\vec m = \vec q,\quad
#    \vec q = \kappa\,\mathrm{d}\vec r + \vec r\,\mathrm{d}\kappa - \vec e\times\mathrm{d}\vec m,\qquad
#    (\vec e,\mathrm{d}\vec e) = 0. $$
#
# This linear system has exactly one solution $\mathrm d\vec e$ if $(\vec e,\vec m) \ne 0$, because
# $\mathrm d\vec e\times\vec m = 0$ leaves only multiples of $\vec m$. It is $\mathrm{d}\vec e = G\,\vec q$ with
#
# $$ G = \Bigl(I - \frac{\vec m\,\vec e^{\,T}}{(\vec e,\vec m)}\Bigr)\frac{[\vec m]_\times}{|\vec m|^2}. $$
#
# Lengths do not matter, only directions, so the vectors may be scaled to $|\vec\rho| = |\vec\rho\,'| = 1$
# and a change of $\vec\rho$ counts only by its part $(I - \hat\rho\hat\rho^T)\,\mathrm{d}\vec\rho/|\vec\rho|$
# across $\vec\rho$, where $\hat\rho=\vec\rho/|\vec\rho|$ is its direction. Collecting terms,
#
# $$ \frac{\partial\vec e}{\partial\vec\rho\,'} = G\,(\kappa I - [\vec e]_\times)\,
#    \frac{I - \hat\rho'{\hat\rho'}^T}{|\vec\rho\,'|},\quad
#    \frac{\partial\vec e}{\partial\vec\rho} = G\,(-\kappa I - [\vec e]_\times)\,
#    \frac{I - \hat\rho\hat\rho^T}{|\vec\rho|},\quad
#    \frac{\partial\vec e}{\partial\chi} = -\frac{G\,\vec r}{2\sin^2\frac\chi2}. $$
#
# First the two derivatives that go into them, of a direction and of the cotangent:

# %%
identity = sp.Identity(3)


def across(direction: sp.Expr) -> sp.Expr:
    """Return the projector across a vector: the derivative of its direction, times its length."""
    return identity - direction * direction.T / norm(direction) ** 2


components = sp.Matrix(rho.components)
direction_by_rho = d.letter(
    r"direction_by_rho[3,3] | \frac{\partial\hat\rho}{\partial\vec\rho} | derivative of the direction of ρ | 1/length",
    (components / norm(components)).jacobian(components),
)
kappa_by_angle = d.letter(
    r"kappa_by_angle | \frac{\mathrm{d}\kappa}{\mathrm{d}\chi} | derivative of κ by χ | 1/rad",
    sp.diff(cosine / sine, half) / 2,
)
d.check(
    "direction-derivative",
    equal(direction_by_rho, across(rho) / norm(rho)),
    equal(kappa_by_angle, -1 / (2 * sine**2)),
    text="Derivatives of the direction of ρ, and of κ by χ.",
).prove(because="Componentwise, with |ρ| the root of the sum of squares; and by the quotient rule.")

# %% [markdown]
# Now the derivatives of the axis. Every formula keeps its form when the frame is turned, so it is enough to prove them
# for $\vec e$ along $Oz$, with $\vec\rho$ and $\kappa$ free. With $J_\rho=\partial\vec e/\partial\vec\rho$ and so on,
# $\mathrm d\vec e=J_\rho\,\mathrm d\vec\rho+J_{\rho'}\,\mathrm d\vec\rho\,'+J_\chi\,\mathrm d\chi$ must solve the
# differentiated equations for every change of the data; $\mathrm d_\perp\vec\rho$ is the part of $\mathrm d\vec\rho$
# across $\vec\rho$.

# %%
G = d.letter(
    "G[3,3] | G | change of the axis by q | 1/length",
    (identity - m * e.T / dot(e, m)) * skew(m) / norm(m) ** 2,
)
by_rho = d.letter(
    r"axis_by_rho[3,3] | \frac{\partial\vec e}{\partial\vec\rho} | derivative of the axis by ρ | 1/length",
    G * (-kappa * identity - skew(e)) * across(rho),
)
by_rho_prime = d.letter(
    r"axis_by_rho_prime[3,3] | \frac{\partial\vec e}{\partial\vec\rho'} | derivative of the axis by ρ′ | 1/length",
    G * (kappa * identity - skew(e)) * across(rho_prime),
)
half_sine_squared = d.letter(r"half_sine_squared | \sin^2\tfrac{\chi}{2} | by κ | 1", 1 / (1 + kappa**2))
by_angle = d.letter(
    r"axis_by_angle[3] | \frac{\partial\vec e}{\partial\chi} | derivative of the axis by χ | 1/rad",
    -G * r / (2 * half_sine_squared),
)

along_z = {e: (0, 0, 1), rho_prime: rodrigues(rho, 2 / kappa * e)}
drho = d.vector("drho", r"\mathrm{d}\vec\rho", "change of ρ", "length")
drho_prime = d.vector("drho_prime", r"\mathrm{d}\vec\rho'", "change of ρ′", "length")
dangle = d.symbol("dangle", r"\mathrm{d}\chi", "change of the angle", "rad")
daxis = d.letter(
    r"daxis[3] | \mathrm{d}\vec e | change of the axis | 1",
    by_rho * drho + by_rho_prime * drho_prime + by_angle * dangle,
)
turn_rho = d.letter(r"turn_rho[3] | \mathrm{d}_\perp\vec\rho | part across ρ | length", across(rho) * drho)
turn_rho_prime = d.letter(
    r"turn_rho_prime[3] | \mathrm{d}_\perp\vec\rho' | part across ρ′ | length", across(rho_prime) * drho_prime
)
dkappa = d.symbol("dkappa", r"\mathrm{d}\kappa", "change of κ", "1", value=-dangle / (2 * half_sine_squared))
d.check(
    "jacobian",
    equal(
        cross(daxis, m),
        kappa * (turn_rho_prime - turn_rho) + dkappa * r - cross(e, turn_rho_prime + turn_rho),
    ),
    equal(dot(e, daxis), 0),
    text="The derivatives of e solve the differentiated equations, for points of one length.",
    assumptions=[sp.Ne(dot(e, m), 0), "e along Oz; both sides turn with the frame"],
).prove(
    given=along_z,
    because="With ρ′ from Rodrigues' formula for θ = 2e/κ, the coefficients of each component of dρ and dρ′, and of "
    "dχ, agree.",
)

# %% [markdown]
# ## Uncertainty
#
# To first order the covariance of the axis is
# $J_\rho\Sigma_\rho J_\rho^T + J_{\rho'}\Sigma_{\rho'}J_{\rho'}^T + \sigma_\chi^2 J_\chi J_\chi^T$ with these
# derivatives, where $\Sigma_\rho$ and $\Sigma_{\rho'}$ are the covariances of the points and $\sigma_\chi$ is the
# standard deviation of the angle. If every coordinate of both points has the same standard deviation $\sigma$, it has a
# closed form: with $\vec d = \vec e\times\hat r$, and $\gamma$ the angle between $\vec e$ and $\vec\rho$,
#
# $$ \operatorname{Cov}\vec e = \frac{\sigma^2}{2|\vec\rho|^2\sin^2\frac\chi2}
#    \Bigl(\hat r\hat r^T + \frac{\vec d\,\vec d^{\,T}}{\cos^2\gamma}\Bigr)
#    + \sigma_\chi^2\,\frac{\tan^2\gamma}{4\sin^2\frac\chi2}\,\vec d\,\vec d^{\,T}. $$
#
# So the axis is uncertain mostly in the plane in which the two solutions lie, and without bound as they meet,
# at $\cos\gamma = 0$: choose a point whose direction is far from perpendicular to the axis.

# %%
cos_gamma_squared = d.symbol(
    "cos_gamma_squared", r"\cos^2\gamma", "by e and ρ", "1", value=dot(e, rho) ** 2 / norm(rho) ** 2
)
d_vector = d.letter(r"d[3] | \vec d | e × r̂, across r in the plane of both axes | 1", cross(e, r) / norm(r))
sigma = d.symbol("sigma", r"\sigma", "standard deviation of each coordinate", "length")
sigma_angle = d.symbol("sigma_angle", r"\sigma_\chi", "standard deviation of the angle", "rad")
covariance = d.letter(
    r"covariance[3,3] | \operatorname{Cov}\vec e | covariance of the axis | 1",
    sigma**2 * (by_rho * by_rho.T + by_rho_prime * by_rho_prime.T) + sigma_angle**2 * by_angle * by_angle.T,
)
d.check(
    "covariance",
    equal(
        covariance,
        sigma**2
        / (2 * norm(rho) ** 2 * half_sine_squared)
        * (r * r.T / norm(r) ** 2 + d_vector * d_vector.T / cos_gamma_squared)
        + sigma_angle**2 * (1 / cos_gamma_squared - 1) / (4 * half_sine_squared) * d_vector * d_vector.T,
    ),
    text="Covariance of the axis for isotropic uncertainty.",
    assumptions=["e along Oz; both sides turn with the frame"],
).prove(
    given=along_z,
    because="The products of the derivatives with their transposes are multiplied out; all nine elements agree.",
)

# %% [markdown]
# The *condition number* is the largest factor from a relative change of $\vec\rho$ or $\vec\rho\,'$ to the
# change of the axis: $|\vec\rho|$ times the largest singular value of $J_\rho$, which is the same for
# $J_{\rho'}$. The squares of the singular values are $1/(4|\vec\rho|^2\sin^2\frac\chi2)$, the same divided by
# $\cos^2\gamma$, and 0, so
#
# $$ \operatorname{cond} = \frac{1}{2\sin\frac\chi2\,|\cos\gamma|}
#    = \frac{1}{2\sqrt{\sin(\frac\chi2 - a)\sin(\frac\chi2 + a)}}. $$
#
# The squares of the singular values are the eigenvalues of $J^TJ$. One of them is 0 where $J^T\vec e=0$, and the other
# two follow from their sum, the trace, and their product, the sum $M(J^TJ)$ of the principal minors of order two. The
# last equation, with $|\vec r|=2|\vec\rho|\sin a$, is the second form of the condition number.


# %%
def invariants(jacobian: sp.Basic, name: str, letter: str) -> tuple[sp.Symbol, sp.Symbol]:
    """Return the sums of the squares, and of the products of two squares, of the singular values of J."""
    values = sp.Matrix(d.value(jacobian))
    gram = values.T * values
    minors = sum(gram[i, i] * gram[j, j] - gram[i, j] ** 2 for i, j in ((0, 1), (0, 2), (1, 2)))
    product = rf"J_{{{letter}}}^T J_{{{letter}}}"
    return (
        d.letter(rf"{name}_trace | \operatorname{{tr}} {product} | trace | 1/length²", gram.trace()),
        d.letter(f"{name}_minors | M({product}) | sum of principal minors | 1/length⁴", minors),
    )


size = 1 / (4 * norm(rho) ** 2 * half_sine_squared)
wanted = size * (1 + 1 / cos_gamma_squared), size**2 / cos_gamma_squared
d.check(
    "condition",
    *[equal(*pair) for pair in zip(invariants(by_rho, "before", r"\rho"), wanted, strict=True)],
    *[equal(*pair) for pair in zip(invariants(by_rho_prime, "after", r"\rho'"), wanted, strict=True)],
    equal(by_rho.T * e, sp.ZeroMatrix(3, 1)),
    equal(by_rho_prime.T * e, sp.ZeroMatrix(3, 1)),
    equal(half_sine_squared * cos_gamma_squared, half_sine_squared - norm(r) ** 2 / (4 * norm(rho) ** 2)),
    text="Trace and minors for both points, the direction without influence, and sin(χ/2 − a) sin(χ/2 + a) = "
    "sin²(χ/2) cos²γ.",
    assumptions=["e along Oz; both sides turn with the frame"],
).prove(
    given=along_z,
    because="All are rational functions of κ and the components of ρ; their numerators agree. For the last one, "
    "sin(x − a) sin(x + a) = sin²x − sin²a.",
)
