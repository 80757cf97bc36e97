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
# # The axis of a rotation, from one point and the angle
#
# A point of a body is at $\vec\rho$ before a rotation about an axis through the origin, and at
# $\vec\rho\,'$ after it. The angle $\chi$ is known; a machine's rotary axis reports it. Where is the axis?
#
# M. M. Stebulyanin and Ya. I. Pimushkin ("Solution of the Rodriguez Equation in Modeling Volumetric
# Geometric Accuracy of Multi-Coordinate Systems") answer this in closed form, to find the true rotary axis
# of a machine tool. They report that Mathcad and Maxima found no solution, and that Maple found one on forty
# pages after 25 hours.
#
# This notebook takes their equations one by one, as printed. Each is an *entry*: it is proved exactly, or
# shown to be wrong by an exact counterexample, with what is right beside it. Nothing is rounded and nothing
# is taken on trust: the cells below are executed whenever code is made from these equations, and no code is
# made while an entry is open. After the paper's way come the hypotheses that it does not mention, a solution
# that fits on one line, its derivatives, and the kernels.

# %%
from collections.abc import Iterator
from fractions import Fraction
from math import isqrt

import sympy as sp

from rodgen.symbolic import (
    Derivation,
    cross,
    dot,
    equal,
    formal_determinant,
    matrix_from_axis_angle,
    norm,
    rodrigues,
    skew,
)

derivation = Derivation(
    "rodrigues",
    title="The axis of a rotation, from one point and the angle",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems"',
)
d = derivation

# %% [markdown]
# ## Symbols
#
# A quantity with a definition is replaced by it in every proof. What remains free are the Rodrigues vector
# $\vec\theta$ and the points $\vec\rho$ and $\vec\rho\,'$.

# %%
half = d.symbol("half_angle", r"\tfrac{\chi}{2}", "half the angle of rotation", "rad")
chi = d.symbol("angle", r"\chi", "angle of rotation of the body", "rad", value=2 * half)
e = d.vector("axis", r"\vec e", "unit vector of the axis", "1")
theta = d.vector("theta", r"\vec\theta", "Rodrigues vector, 2 tan(χ/2) e", "1")
rho = d.vector("rho", r"\vec\rho", "point before the rotation", "length")
rho_prime = d.vector("rho_prime", r"\vec\rho'", "point after the rotation", "length")
alpha = d.symbol("alpha", r"\alpha", "1 + |θ|²/4", "1", value=1 + norm(theta) ** 2 / 4)
r = d.vector("r", r"\vec r", "displacement of the point, ρ′ − ρ", "length", value=rho_prime - rho)

t1, t2, t3 = theta
p1, p2, p3 = rho
r1, r2, r3 = r
by_formula = {rho_prime: rodrigues(rho, theta)}
unit_axis = {e.components[2]: dot(e, e) - 1}

# %% [markdown]
# ## Rodrigues' formula
#
# Formula (1) is the rotation by $\chi$ about $\vec e$. We compare it with the rotation matrix
# $\cos\chi\,I + \sin\chi\,[\vec e]_\times + (1-\cos\chi)\,\vec e\,\vec e^{\,T}$.

# %%
turned = matrix_from_axis_angle(sp.Matrix(e.components), sp.cos(2 * half), sp.sin(2 * half))
d.state(
    "eq-1",
    equal(rho_prime, rodrigues(rho, theta)),
    text="Rodrigues' formula.",
    place="eq. (1)",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1), sp.Ne(sp.cos(half), 0)],
).prove(
    given={theta: 2 * sp.tan(half) * e, rho_prime: turned * rho.components},
    modulo=unit_axis,
    because="With the rotation matrix on the left, both sides are identical.",
)

# %% [markdown]
# The paper calls $\chi$ the angle of rotation "of the vector $\vec\rho$". It is the angle of rotation of the
# body. The directions of $\vec\rho$ and $\vec\rho\,'$ differ by less, unless $\vec\rho$ is perpendicular to
# the axis.

# %%
by_axis = {theta: 2 * sp.tan(half) * e, **by_formula}
d.state(
    "angle-of-the-vector",
    equal(sp.cos(chi), dot(rho, rho_prime) / (norm(rho) * norm(rho_prime))),
    text="χ is the angle of rotation of the vector ρ.",
    place="sec. 3 and before eq. (7)",
    assumptions=[equal(norm(e), 1)],
).refute(
    {half: sp.pi / 4, e: (0, 0, 1), rho: (1, 0, 1)},
    equal(sp.cos(chi) * (norm(rho) ** 2 - dot(e, rho) ** 2), dot(rho, rho_prime) - dot(e, rho) ** 2),
    given=by_axis,
    modulo=unit_axis,
    label="M8",
    because="χ is the body's angle; only the parts perpendicular to the axis make that angle with each other.",
)

# %% [markdown]
# Multiplied out, with $\alpha = 1 + \frac14|\vec\theta|^2$ and the displacement $\vec r$:

# %%
d.state(
    "eq-2",
    equal(2 * alpha * r, 2 * cross(theta, rho) + cross(theta, cross(theta, rho))),
    equal(r, rho_prime - rho),
    text="Formula (1) without its denominator.",
    place="eq. (2) and the line before it",
).prove(given=by_formula)

# %% [markdown]
# ## Two scalar products
#
# Multiply (2) by $\vec\theta$, and both terms on the right vanish: the displacement is perpendicular to the
# axis. The paper announces the result under a wrong number.

# %%
left_2 = 2 * alpha * r
right_2 = 2 * cross(theta, rho) + cross(theta, cross(theta, rho))
left_4 = 2 * alpha * dot(r, rho)
right_4 = dot(cross(theta, cross(theta, rho)), rho)

d.state(
    "eq-3-announced",
    equal(dot(left_2 - right_2, theta), left_4 - right_4),
    text="Multiplying (2) scalarly by [θ], we obtain equation (4).",
    place="before eq. (3)",
).refute(
    {rho: (0, 0, 1), theta: (1, 0, 0), r: (1, 0, 0)},
    equal(dot(left_2 - right_2, theta), 2 * alpha * dot(r, theta)),
    label="M3",
    because="The product with θ is equation (3); the product with ρ is equation (4). The factor θ is not "
    "printed.",
)

# %%
d.state(
    "eq-3",
    equal(2 * alpha * dot(r, theta), 0),
    equal(r1 * t1 + r2 * t2 + r3 * t3, 0),
    text="The displacement is perpendicular to the axis.",
    place="eq. (3)",
).prove(given=by_formula)

# %%
d.state("eq-4", equal(left_4, right_4), text="The product of (2) with ρ.", place="eq. (4)").prove(
    given=by_formula
)

# %% [markdown]
# ## The angle between axis and point
#
# With $\gamma$ the angle from $\vec\theta$ to $\vec\rho$, the unit vector $\vec u$ along
# $\vec\theta\times\vec\rho$ and the unit vector $\vec v$ that completes $\vec\theta$ and $\vec u$ to a right
# angle, (4) gives $\gamma$ from what is known.

# %%
sin_gamma = d.symbol(
    "sin_gamma",
    r"\sin\gamma",
    "sine of the angle between θ and ρ",
    "1",
    value=norm(cross(theta, rho)) / (norm(theta) * norm(rho)),
)
cos_gamma = d.symbol(
    "cos_gamma", r"\cos\gamma", "its cosine", "1", value=dot(theta, rho) / (norm(theta) * norm(rho))
)
u = d.vector(
    "u", r"\vec u", "unit vector along θ × ρ", "1", value=cross(theta, rho) / norm(cross(theta, rho))
)
v = d.vector("v", r"\vec v", "unit vector along θ × u", "1", value=cross(theta, u) / norm(theta))
cos_gamma_90 = d.symbol(
    "cos_gamma_90",
    r"\cos\left(90^\circ + \gamma\right)",
    "cosine of the angle between v and ρ",
    "1",
    value=dot(v, rho) / norm(rho),
)

d.check(
    "gamma",
    equal(sin_gamma**2 + cos_gamma**2, 1),
    equal(norm(u) ** 2, 1),
    equal(norm(v) ** 2, 1),
    text="Sine, cosine and the unit vectors are what their names say.",
).prove()

# %%
d.state(
    "theta-cross-rho-length",
    equal(cross(theta, rho), norm(theta) * norm(rho) * sin_gamma * u),
    place="after eq. (4)",
).prove()

# %%
d.state(
    "theta-cross-theta-cross-rho-length",
    equal(cross(theta, cross(theta, rho)), norm(theta) ** 2 * norm(rho) * sin_gamma * v),
    place="after eq. (4)",
).prove()

# %%
d.state(
    "dot-by-gamma",
    equal(right_4, norm(theta) ** 2 * norm(rho) ** 2 * sin_gamma * cos_gamma_90),
    equal(right_4, -(norm(theta) ** 2) * norm(rho) ** 2 * sin_gamma**2),
    place="after eq. (4)",
).prove()

# %%
ratio = 2 * alpha * dot(r, rho) / (norm(theta) ** 2 * norm(rho) ** 2)
d.state(
    "sin-cos-squared",
    equal(sin_gamma**2, -ratio),
    equal(cos_gamma**2, 1 + ratio),
    place="before eq. (5)",
).prove(given=by_formula)

# %% [markdown]
# The cosine itself has the sign of $\vec\theta\cdot\vec\rho$; a square root has not.

# %%
cos_squared = (norm(theta) ** 2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho)) / (
    norm(theta) ** 2 * norm(rho) ** 2
)
d.state("eq-5", equal(cos_gamma, sp.sqrt(cos_squared)), text="The cosine of γ.", place="eq. (5)").refute(
    {theta: (0, 0, -2), rho: (0, 3, 4)},
    equal(cos_gamma, sp.sign(dot(theta, rho)) * sp.sqrt(cos_squared)),
    given=by_formula,
    proof=[equal(cos_gamma**2, cos_squared)],
    label="M5",
    because="The sign is missing: minus where γ is obtuse. Which it is the data do not say, so both signs give "
    "a solution.",
)

# %% [markdown]
# ## Equation (4) in components
#
# The first cross product, and a change of variables for the second.

# %%
i = d.vector("i", r"\vec i", "unit vector of Ox", "1", value=sp.Matrix([1, 0, 0]))
j = d.vector("j", r"\vec j", "unit vector of Oy", "1", value=sp.Matrix([0, 1, 0]))
k = d.vector("k", r"\vec k", "unit vector of Oz", "1", value=sp.Matrix([0, 0, 1]))

d.state(
    "theta-cross-rho",
    equal(cross(theta, rho), (t2 * p3 - p2 * t3) * i + (-t1 * p3 + p1 * t3) * j + (t1 * p2 - p1 * t2) * k),
    place="after eq. (5)",
).prove()

# %%
theta_prime = d.vector("theta_prime", r"\vec\theta'", "θ × ρ", "length", value=cross(theta, rho))
s1, s2, s3 = theta_prime
d.state(
    "theta-prime",
    equal(s1, t2 * p3 - p2 * t3),
    equal(s2, -t1 * p3 + p1 * t3),
    equal(s3, t1 * p2 - p1 * t2),
    text="Change of variables.",
    place="after eq. (5)",
).prove()

# %%
d.state(
    "determinant",
    equal(cross(theta, cross(theta, rho)), formal_determinant(theta, theta_prime)),
    equal(
        cross(theta, cross(theta, rho)),
        (t2 * s3 - s2 * t3) * i + (-t1 * s3 + s1 * t3) * j + (t1 * s2 - s1 * t2) * k,
    ),
    place="before eq. (6)",
).prove()

# %%
d.state(
    "bracketed",
    equal(
        cross(theta, cross(theta, rho)),
        (t2 * (t1 * p2 - p1 * t2) - t3 * (p1 * t3 - p3 * t1)) * i
        + (t3 * (t2 * p3 - p2 * t3) - t1 * (t1 * p2 - p1 * t2)) * j
        + (t1 * (p1 * t3 - p3 * t1) - t2 * (t2 * p3 - p2 * t3)) * k,
    ),
    place="before eq. (6)",
).prove()

# %% [markdown]
# In the expanded form one index of the first component is wrong. The next line of the paper is right again.

# %%
twice = cross(theta, cross(theta, rho))
d.state(
    "expanded-i",
    equal(dot(twice, i), p2 * t1 * t2 - p1 * t2**2 - p1 * t3**2 + p3 * t1 * t2),
    place="before eq. (6), component i",
).refute(
    {theta: (1, 1, 0), rho: (0, 0, 1)},
    equal(dot(twice, i), p2 * t1 * t2 - p1 * t2**2 - p1 * t3**2 + p3 * t1 * t3),
    label="M1",
    because="The last term is ρ₃θ₁θ₃, not ρ₃θ₁θ₂.",
)

# %%
d.state(
    "expanded-j",
    equal(dot(twice, j), p3 * t2 * t3 - p2 * t3**2 - p2 * t1**2 + p1 * t1 * t2),
    place="before eq. (6), component j",
).prove()

# %%
d.state(
    "expanded-k",
    equal(dot(twice, k), p1 * t1 * t3 - p3 * t1**2 - p3 * t2**2 + p2 * t2 * t3),
    place="before eq. (6), component k",
).prove()

# %%
squares = (p1 * t2 - p2 * t1) ** 2 + (p1 * t3 - p3 * t1) ** 2 + (p2 * t3 - p3 * t2) ** 2
d.state(
    "dot-expanded",
    equal(
        right_4,
        sp.Add(
            *[p1 * p2 * t1 * t2, -(p1**2) * t2**2, -(p1**2) * t3**2, p1 * p3 * t1 * t3],
            *[p2 * p3 * t2 * t3, -(p2**2) * t3**2, -(p2**2) * t1**2, p1 * p2 * t1 * t2],
            *[p1 * p3 * t1 * t3, -(p3**2) * t1**2, -(p3**2) * t2**2, p3 * p2 * t2 * t3],
        ),
    ),
    equal(right_4, -squares),
    place="before eq. (6)",
).prove()

# %%
d.state("eq-6", equal(squares, -2 * alpha * dot(r, rho)), place="eq. (6)").prove(given=by_formula)

# %% [markdown]
# Equation (6) is Lagrange's identity $|\vec\theta\times\vec\rho|^2 = |\vec\theta|^2|\vec\rho|^2 -
# (\vec\theta\cdot\vec\rho)^2$ in disguise. It does not know on which side of the plane of $\vec\rho$ and
# $\vec r$ the vector $\vec\theta$ lies, and that costs a root below.

# %%
d.check("lagrange", equal(squares, norm(theta) ** 2 * norm(rho) ** 2 - dot(theta, rho) ** 2)).prove()

# %% [markdown]
# ## The triangle of θ and ρ
#
# The modulus of $\vec\theta$ is known, and the third side of the triangle with the sides $\vec\theta$ and
# $\vec\rho$ gives their scalar product.

# %%
ell = d.symbol("ell", r"\ell", "third side of the triangle of θ and ρ", "none", value=norm(theta - rho))
c = d.symbol(
    "c",
    "c",
    "scalar product of θ and ρ",
    "length",
    value=(norm(rho) ** 2 + norm(theta) ** 2 - ell**2) / 2,
)
d.state(
    "system-6-7",
    equal(t1**2 + t2**2 + t3**2, norm(theta) ** 2),
    equal((t1 - p1) ** 2 + (t2 - p2) ** 2 + (t3 - p3) ** 2, ell**2),
    place="before eq. (7)",
).prove()

# %%
d.state(
    "modulus",
    equal(norm(theta) ** 2, 4 * sp.tan(half) ** 2),
    place="before eq. (7)",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1)],
).prove(given={theta: 2 * sp.tan(half) * e}, modulo=unit_axis)

# %%
d.state(
    "brackets",
    equal(t1**2 - 2 * (t1 * p1 + t2 * p2 + t3 * p3) + t2**2 + t3**2 + p1**2 + p2**2 + p3**2, ell**2),
    place="before eq. (7)",
).prove()

# %%
d.state(
    "eq-7",
    equal(t1 * p1 + t2 * p2 + t3 * p3, (norm(rho) ** 2 + norm(theta) ** 2 - ell**2) / 2),
    equal(t1 * p1 + t2 * p2 + t3 * p3, c),
    place="eq. (7)",
).prove()

# %%
d.state(
    "cosine-law",
    equal(ell**2, norm(rho) ** 2 + norm(theta) ** 2 - 2 * norm(rho) * norm(theta) * cos_gamma),
    place="after eq. (7)",
).prove()

# %% [markdown]
# This triangle has a side without a unit and a side that is a length. Formula (7) is right all the same, for
# any unit, because $\ell$ drops out; but $\ell$ is no quantity. A quantity that is a length to some power is
# multiplied by a power of $\lambda$ when the unit of length becomes $\lambda$ times smaller, so its values
# at $\lambda = 1, 2, 4$ are in geometric progression. Those of $\ell^2$ are not; those of $c$ are.


# %%
def in_unit(quantity: sp.Expr, factor: int) -> sp.Expr:
    """Value of a quantity of θ and ρ when the unit of length is `factor` times smaller."""
    return d.value(quantity).xreplace({component: factor * component for component in rho})


def is_power_of_length(quantity: sp.Expr) -> sp.Eq:
    return equal(in_unit(quantity, 2) ** 2, in_unit(quantity, 1) * in_unit(quantity, 4))


d.state(
    "triangle-units",
    is_power_of_length(ell**2),
    text="θ and ρ are sides of a triangle: ℓ is a quantity (a power of a length).",
    place="before eq. (7)",
).refute(
    {theta: (1, 0, 0), rho: (1, 0, 0)},
    [is_power_of_length(c), equal(c, dot(theta, rho))],
    label="M9",
    because="θ has no unit and ρ is a length, so θ − ρ depends on the unit of length. c = (θ, ρ) needs no "
    "triangle.",
)

# %%
d.state(
    "c-by-gamma",
    equal(c, norm(rho) * norm(theta) * cos_gamma),
    place="before eq. (8)",
).prove()

# %%
c_squared = norm(theta) ** 2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho)
d.state("c", equal(c, sp.sqrt(c_squared)), place="before eq. (8)").refute(
    {theta: (0, 0, -2), rho: (0, 3, 4)},
    equal(c, sp.sign(dot(theta, rho)) * sp.sqrt(c_squared)),
    given=by_formula,
    proof=[equal(c**2, c_squared)],
    label="M5",
    because="The sign is missing, as in (5): c is negative where γ is obtuse.",
)

# %% [markdown]
# ## Elimination
#
# Two linear equations, (3) and (7), give $\theta_1$ and $\theta_2$ by $\theta_3$. They can be solved if the
# *pivot* $w_3 = \rho_1 r_2 - \rho_2 r_1$ is not zero, the third component of $\vec w = \vec\rho\times\vec r =
# \vec\rho\times\vec\rho\,'$.

# %%
w = d.vector("w", r"\vec w", "ρ × r = ρ × ρ′", "length²", value=cross(rho, r))
w1, w2, w3 = w
d.state(
    "eq-8",
    equal(t1 * p1 + t2 * p2 + t3 * p3, c),
    equal(r1 * t1 + r2 * t2 + r3 * t3, 0),
    place="eq. (8)",
).prove(given=by_formula)

# %%
a1 = d.symbol("a1", "a_1", "constant part of θ₁", "1", value=r2 * c / (r2 * p1 - r1 * p2))
b1 = d.symbol("b1", "b_1", "θ₃-part of θ₁", "1", value=(r3 * p2 - r2 * p3) / (r2 * p1 - r1 * p2))
a2 = d.symbol("a2", "a_2", "constant part of θ₂", "1", value=r1 * c / (r1 * p2 - r2 * p1))
b2 = d.symbol("b2", "b_2", "θ₃-part of θ₂", "1", value=(r3 * p1 - r1 * p3) / (r1 * p2 - r2 * p1))
by_theta3 = d.state(
    "eq-9",
    equal(t1, r2 * c / (r2 * p1 - r1 * p2) + (r3 * p2 - r2 * p3) / (r2 * p1 - r1 * p2) * t3),
    equal(t1, a1 + b1 * t3),
    equal(t2, r1 * c / (r1 * p2 - r2 * p1) + (r3 * p1 - r1 * p3) / (r1 * p2 - r2 * p1) * t3),
    equal(t2, a2 + b2 * t3),
    place="eq. (9)",
    assumptions=[sp.Ne(w3, 0)],
).prove(given=by_formula)
by_theta3

# %% [markdown]
# Put into (6), they give a quadratic equation for $\theta_3$. Its right side is printed with a square that
# does not belong there; the line after it is right.

# %%
substituted = (
    (p1 * (a2 + b2 * t3) - p2 * (a1 + b1 * t3)) ** 2
    + (p1 * t3 - p3 * (a1 + b1 * t3)) ** 2
    + (p2 * t3 - p3 * (a2 + b2 * t3)) ** 2
)
d.state(
    "eq-10",
    equal(substituted, -2 * alpha * dot(r, rho) ** 2),
    place="eq. (10)",
    assumptions=[sp.Ne(w3, 0)],
).refute(
    {theta: (0, 0, 2), rho: (1, 0, 1)},
    equal(substituted, -2 * alpha * dot(r, rho)),
    given=by_formula,
    label="M2",
    because="The scalar product (r, ρ) on the right is not squared.",
)

# %%
p12 = d.symbol("rho_12", r"\rho_{12}", "ρ₁² + ρ₂²", "length²", value=p1**2 + p2**2)
p13 = d.symbol("rho_13", r"\rho_{13}", "ρ₁² + ρ₃²", "length²", value=p1**2 + p3**2)
p23 = d.symbol("rho_23", r"\rho_{23}", "ρ₂² + ρ₃²", "length²", value=p2**2 + p3**2)
L2 = d.symbol(
    "L2",
    "L_2",
    "coefficient of θ₃²",
    "length²",
    value=p13 * b2**2 + p23 * b1**2 + p12 - 2 * p1 * p2 * b1 * b2 - 2 * p1 * p3 * b1 - 2 * p2 * p3 * b2,
)
L1 = d.symbol(
    "L1",
    "L_1",
    "coefficient of θ₃",
    "length²",
    value=2 * p13 * a2 * b2
    + 2 * p23 * a1 * b1
    - 2 * p1 * p2 * (b2 * a1 + b1 * a2)
    - 2 * p1 * p3 * a1
    - 2 * p2 * p3 * a2,
)
L0 = d.symbol(
    "L0",
    "L_0",
    "constant coefficient",
    "length²",
    value=p13 * a2**2 + p23 * a1**2 - 2 * p1 * p2 * a2 * a1,
)
quadratic = L2 * t3**2 + L1 * t3 + L0
letters = {letter: letter for letter in (a1, b1, a2, b2)}
d.state(
    "eq-10-collected",
    equal(substituted, quadratic),
    text="The coefficients L₂, L₁, L₀, for whatever a₁, b₁, a₂, b₂ stand for.",
    place="after eq. (10)",
).prove(given=letters, because="Both sides are the same polynomial in θ₃, a₁, b₁, a₂, b₂ and ρ.")

# %%
d.state(
    "quadratic",
    equal(quadratic, -2 * alpha * dot(r, rho)),
    text="The quadratic equation for θ₃.",
    place="after eq. (10)",
    assumptions=[sp.Ne(w3, 0)],
).prove(given=by_formula)

# %% [markdown]
# The coefficients are simpler than they look: up to the factor $|\vec\rho|^2 / w_3^2$ they are
# $|\vec w|^2$ and $-2c\,(\vec r\times\vec w)_3$.

# %%
d.check(
    "coefficients-compact",
    equal(L2, norm(rho) ** 2 * norm(w) ** 2 / w3**2),
    equal(L1, -2 * c * norm(rho) ** 2 * dot(cross(r, w), k) / w3**2),
    equal(L0, (p1 * a2 - p2 * a1) ** 2 + p3**2 * (a1**2 + a2**2)),
    assumptions=[sp.Ne(w3, 0), "any ρ, r and c: (1) is not used"],
).prove(given={c: c, r: r})

# %% [markdown]
# ## The same equation, linear in θ
#
# With $\vec m = \vec\rho\,' + \vec\rho$, formula (1) becomes $\vec r = \frac12\vec\theta\times\vec m$
# (Cayley's form of a rotation). The two are equivalent: this is the linear system
# $(I - \frac12[\vec\theta]_\times)\,\vec\rho\,' = (I + \frac12[\vec\theta]_\times)\,\vec\rho$ for
# $\vec\rho\,'$, and its determinant $\alpha$ is never zero.

# %%
m = d.vector("m", r"\vec m", "sum of the two vectors, ρ′ + ρ", "length", value=rho_prime + rho)
tilde = skew(theta.components)
cayley = d.check(
    "cayley",
    equal(r, cross(theta, m) / 2),
    equal((sp.eye(3) - tilde / 2).det(), alpha),
    text="(1) is equivalent to r = θ × m / 2.",
).prove(given=by_formula)
cayley

# %% [markdown]
# ## The sign of the root
#
# The paper takes the root with the plus sign, "assuming the angle γ to be acute". But γ has nothing to do
# with it: it is acute exactly if $c > 0$. The right sign is that of the pivot.

# %%
discriminant = L1**2 - 4 * L2 * (L0 + 2 * alpha * dot(r, rho))
root = d.check(
    "discriminant",
    equal(discriminant, (2 * norm(rho) ** 2 * norm(r) ** 2 / w3) ** 2),
    equal(2 * L2 * t3 + L1, 2 * norm(rho) ** 2 * norm(r) ** 2 / w3),
    text="The discriminant is a square, and θ₃ takes its root with the sign of w₃.",
    assumptions=[sp.Ne(w3, 0)],
).prove(given=by_formula)
root

# %%
theta3_printed = (-L1 + sp.sqrt(discriminant)) / (2 * L2)
theta3_right = (-L1 + sp.sign(w3) * sp.sqrt(discriminant)) / (2 * L2)
d.state(
    "theta-3",
    equal(t3, theta3_printed),
    text="θ₃, assuming the angle γ to be acute.",
    place="the last formula of sec. 4",
    assumptions=[sp.Ne(w3, 0), sp.Gt(c, 0)],
).refute(
    {theta: (0, 0, -2), rho: (1, 0, -1)},
    equal(t3, theta3_right),
    given=by_formula,
    proof=[root],
    label="M6",
    because="The root has the sign of w₃ = ρ₁r₂ − ρ₂r₁, whether γ is acute or not; here γ is acute, w₃ < 0 and "
    "the printed root is wrong.",
)

# %% [markdown]
# How often is the printed sign wrong? In half of all cases, exactly. Turn the whole picture by half a turn
# about the $x$-axis, $(x, y, z) \to (x, -y, -z)$: the angle $\gamma$, the modulus $|\vec\theta|$ and $c$ stay,
# and $w_3$ changes its sign. Whatever the distribution of $\vec\theta$ and $\vec\rho$ is, if it is the same
# after that half turn, $w_3 < 0$ is as likely as $w_3 > 0$, among the acute angles as among all.

# %%
half_turn = {component: -component for component in (t2, t3, p2, p3)}
w3_value, c_value = d.value(w3, by_formula), d.value(c, by_formula)
d.check(
    "half-of-all",
    equal(w3_value.xreplace(half_turn), -w3_value),
    equal(c_value.xreplace(half_turn), c_value),
    text="A half turn about Ox changes the sign of w₃ and keeps c.",
).prove()

# %% [markdown]
# And counted, in exact arithmetic on a sample that is spread evenly and is the same every time (a Halton
# sequence): the printed formulas, with $c$ positive and the root positive, give back a vector that
# satisfies (1) in half of the cases, and the very vector that was put in, as the paper's validation reports,
# in a quarter.

# %%
Triple = tuple[Fraction, Fraction, Fraction]


def halton(count: int) -> Iterator[tuple[Triple, Triple]]:
    """Vectors θ and ρ with rational components that fill the cube from -1 to 1 evenly."""
    for number in range(1, count + 1):
        point = []
        for base in (2, 3, 5, 7, 11, 13):
            value, weight, rest = Fraction(0), Fraction(1, base), number
            while rest:
                rest, digit = divmod(rest, base)
                value += digit * weight
                weight /= base
            point.append(2 * value - 1)
        yield tuple(point[:3]), tuple(point[3:])


def cross_of(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot_of(a: Triple, b: Triple) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def exact_root(square: Fraction) -> Fraction:
    root = Fraction(isqrt(square.numerator), isqrt(square.denominator))
    assert root * root == square
    return root


def rotated(rho: Triple, theta: Triple) -> Triple:
    once = cross_of(theta, rho)
    twice = cross_of(theta, once)
    alpha = 1 + dot_of(theta, theta) / 4
    return tuple(x + (y + z / 2) / alpha for x, y, z in zip(rho, once, twice, strict=True))


def as_printed(rho: Triple, rho_prime: Triple, modulus_squared: Fraction) -> Triple | None:
    """Evaluate the paper's algorithm as printed; None where its pivot is zero."""
    (p1, p2, p3), alpha = rho, 1 + modulus_squared / 4
    r1, r2, r3 = r = tuple(x - y for x, y in zip(rho_prime, rho, strict=True))
    if r2 * p1 == r1 * p2:
        return None
    known = 2 * alpha * dot_of(r, rho)
    c = exact_root(modulus_squared * dot_of(rho, rho) + known)
    a1, b1 = r2 * c / (r2 * p1 - r1 * p2), (r3 * p2 - r2 * p3) / (r2 * p1 - r1 * p2)
    a2, b2 = r1 * c / (r1 * p2 - r2 * p1), (r3 * p1 - r1 * p3) / (r1 * p2 - r2 * p1)
    p12, p13, p23 = p1 * p1 + p2 * p2, p1 * p1 + p3 * p3, p2 * p2 + p3 * p3
    L2 = p13 * b2**2 + p23 * b1**2 + p12 - 2 * p1 * p2 * b1 * b2 - 2 * p1 * p3 * b1 - 2 * p2 * p3 * b2
    L1 = 2 * (p13 * a2 * b2 + p23 * a1 * b1 - p1 * p2 * (b2 * a1 + b1 * a2) - p1 * p3 * a1 - p2 * p3 * a2)
    L0 = p13 * a2**2 + p23 * a1**2 - 2 * p1 * p2 * a2 * a1
    t3 = (-L1 + exact_root(L1**2 - 4 * L2 * (L0 + known))) / (2 * L2)
    return a1 + b1 * t3, a2 + b2 * t3, t3


def count_printed(count: int) -> dict[str, int]:
    """Count on how many of `count` inputs the printed algorithm satisfies (1) and returns its input."""
    found = {"inputs": 0, "satisfies (1)": 0, "is the given θ": 0, "γ acute": 0, "acute and satisfies": 0}
    for theta, rho in halton(count):
        rho_prime = rotated(rho, theta)
        answer = as_printed(rho, rho_prime, dot_of(theta, theta))
        if answer is None:
            continue
        valid, acute = rotated(rho, answer) == rho_prime, dot_of(theta, rho) > 0
        found["inputs"] += 1
        found["satisfies (1)"] += valid
        found["is the given θ"] += answer == theta
        found["γ acute"] += acute
        found["acute and satisfies"] += valid and acute
    return found


printed_counts = count_printed(1000)
printed_counts

# %% [markdown]
# So the claim of the paper's validation, that the given components were "certainly" found again, cannot hold
# for the formulas as printed: it holds in every fourth case. (Perhaps the authors picked the fitting
# root by hand; the text speaks of pairs of roots.)

# %%
theta_printed = d.vector(
    "theta_printed",
    r"\vec\theta_{+}",
    "the paper's solution with the printed signs",
    "1",
    value=sp.Matrix([a1 + b1 * theta3_printed, a2 + b2 * theta3_printed, theta3_printed]),
)
d.state(
    "validation",
    equal(theta, theta_printed),
    text="The components of θ certainly agreed with those given.",
    place="sec. 5",
    assumptions=[sp.Ne(w3, 0)],
).refute(
    {theta: (0, 0, -2), rho: (3, 0, 4), c: 8},
    equal(theta, sp.Matrix([a1 + b1 * theta3_right, a2 + b2 * theta3_right, theta3_right])),
    given=by_formula,
    proof=[root, by_theta3],
    label="M6",
    because="With c = +√… and the root +√… the given θ comes back only if γ is acute and w₃ > 0, in a quarter "
    "of all cases. With the signs of (θ, ρ) and of w₃ it always does.",
)

# %% [markdown]
# What is the vector that the wrong root gives? With the compact coefficients the whole solution is
#
# $$ \vec\theta(c) = \frac{c\,\vec r\times\vec w + |\vec r|^2\,\vec w}{|\vec w|^2}, $$
#
# and it satisfies (1) with the known modulus for both signs of $c$. The other root of the quadratic is not
# $\theta_3(-c)$ but $-\theta_3(-c)$: its vector is the second solution reversed, which turns $\vec\rho\,'$
# back to $\vec\rho$. So the "pairs of roots" of the paper are not the two solutions; these come from
# $c = \pm\sqrt{\ldots}$, each with the sign of $w_3$ at its root.


# %%
def solution(c: sp.Expr) -> sp.Expr:
    """Rodrigues vector that turns ρ into ρ′, for one of the two values of c."""
    return (c * cross(r, w) + norm(r) ** 2 * w) / norm(w) ** 2


jump = norm(rho) ** 2 * norm(r) ** 2 / w3  # half the root of the discriminant, with the sign of w3
t3_right, t3_wrong = (-L1 / 2 + jump) / L2, (-L1 / 2 - jump) / L2
d.check(
    "roots-compact",
    equal(sp.Matrix([a1 + b1 * t3_right, a2 + b2 * t3_right, t3_right]), solution(c)),
    equal(sp.Matrix([a1 + b1 * t3_wrong, a2 + b2 * t3_wrong, t3_wrong]), -solution(-c)),
    text="The vectors that belong to the two roots.",
    assumptions=[sp.Ne(w3, 0), "any ρ, r and c: (1) is not used"],
).prove(given={c: c, r: r})

# %%
modulus = d.symbol(
    "modulus", r"\left|\vec\theta\right|_{\mathrm{given}}", "known modulus of θ", "1", positive=True
)
data = {alpha: 1 + modulus**2 / 4, c: c}
equal_lengths = {rho_prime.components[2]: norm(rho_prime) ** 2 - norm(rho) ** 2}
two_values_of_c = {c: c**2 - (modulus**2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho))}
solves = d.check(
    "solution-by-c",
    equal(r, cross(solution(c), m) / 2),
    equal(norm(solution(c)) ** 2, modulus**2),
    text="θ(c) turns ρ into ρ′ and has the known modulus, for any ρ and ρ′ of one length and both values of c.",
    assumptions=[sp.Ne(norm(w), 0), equal(norm(rho), norm(rho_prime)), equal(c**2, c_squared)],
).prove(
    given=data,
    modulo={**two_values_of_c, **equal_lengths},
    because="Both hold modulo the assumptions, with ρ and ρ′ free; Cayley's form is equivalent to (1).",
)
solves

# %%
theta3_other = (-L1 - sp.sign(w3) * sp.sqrt(discriminant)) / (2 * L2)
theta_other = sp.Matrix([a1 + b1 * theta3_other, a2 + b2 * theta3_other, theta3_other])
d.state(
    "pairs-of-roots",
    equal(rho_prime, rodrigues(rho, theta_other)),
    text="Pairs of roots were obtained, depending on γ being acute or obtuse: the second root of the quadratic "
    "is a solution.",
    place="sec. 5",
    assumptions=[sp.Ne(w3, 0)],
).refute(
    {theta: (0, 0, 2), rho: (1, 0, 1)},
    [equal(rho_prime, rodrigues(rho, solution(-c))), equal(norm(solution(-c)), norm(theta))],
    given=by_formula,
    proof=[solves],
    label="M7",
    because="The second root gives minus the second solution, which turns ρ′ into ρ. The second solution is "
    "found with −c, and again with the sign of w₃ at the root.",
)

# %% [markdown]
# ## From the vector to the axis

# %%
d.state(
    "axis",
    equal(e, theta / norm(theta)),
    text="Dividing by θ|θ| (printed so; |θ| is meant) we find the unit vector e.",
    place="the last line of sec. 4",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1)],
).refute(
    {half: -sp.pi / 4, e: (0, 0, 1), theta: (0, 0, -2)},
    equal(e, theta / (2 * sp.tan(half))),
    given={theta: 2 * sp.tan(half) * e},
    label="M4",
    because="One cannot divide by the vector θ|θ|, and division by |θ| reverses e when χ is negative; divide by "
    "2 tan(χ/2).",
)

# %% [markdown]
# ## The kernels
