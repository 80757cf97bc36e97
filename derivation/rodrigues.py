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
# This notebook takes their equations one by one, as printed, and proves each exactly, or refutes it by an exact
# counterexample and corrects it. So it does with what they say in words, marked *said*, and what they need
# but do not state, marked *tacit*. Nothing is rounded.
#
# **Result.** There are two axes, and they fit on one line. With $\vec m=\vec\rho\,'+\vec\rho$,
# $\vec r=\vec\rho\,'-\vec\rho$ and $\kappa=\cot\frac\chi2$, for $|\vec\rho\,'|=|\vec\rho|$ (entry `solution`),
#
# $$ \vec e_\pm = \frac{\kappa\,\vec m\times\vec r \pm \sqrt{|\vec m|^2 - \kappa^2|\vec r|^2}\;\vec m}{|\vec
# m|^2}. $$
#
# The paper's way leads there, too, once these are put right:
#
# | erratum | what is wrong | where |
# | --- | --- | --- |
# | M1 | an index in an expanded product | before eq. (6) |
# | M2 | a square too many on the right side | eq. (10) |
# | M3 | the number of an equation, and a factor that is not printed | before eq. (3) |
# | M4 | a division by a vector, and the sign of the axis for a negative angle | end of sec. 4 |
# | M5 | the sign of $\cos\gamma$ and of $c$: one of two solutions is lost | eq. (5), before eq. (8) |
# | M6 | the sign of a root: half of all results are no solution | end of sec. 4, sec. 5 |
# | M7 | the second root is taken for the second solution | sec. 5 |
# | M8 | conditions that are not mentioned: equal lengths, a large enough angle, a nonzero pivot | secs. 3 to 5 |
# | M9 | a triangle of a number and a length | before eq. (7) |
#
# The notebook `axis_sensitivity` goes on from there to derivatives and uncertainty, the notebook `axis` to the solver.

# %%
import time

import sympy as sp

from rodgen.codegen import Kernel, KernelBuilder
from rodgen.symbolic import (
    Derivation,
    cross,
    dot,
    equal,
    formal_determinant,
    in_notebook,
    matrix_from_axis_angle,
    norm,
    rodrigues,
    select,
    skew,
)

d = derivation = Derivation(
    "rodrigues",
    title="The axis of a rotation, from one point and the angle",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems"',
    kernels_in="those of the solver: 'rodgen kernels axis'",
)

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product, as in the paper, and $|\vec a|$ the length; components have the indices 1, 2,
# 3. A quantity with a definition, such as $\alpha$, is replaced by it in every proof. Only the Rodrigues vector
# $\vec\theta$ and the points $\vec\rho$ and $\vec\rho\,'$ are free. Further symbols are explained where they first
# occur, and the whole table is at the end. (The paper also names the coordinates of $\vec\rho$ $x_A, y_A, z_A$ and
# does not use these names. Its equations on the machine as a whole, in its section 2, are those of the notebook
# `machine_model`.)

# %%
half = d.symbol("half_angle", r"\tfrac{\chi}{2}", "half the angle of rotation", "rad")
chi = d.symbol("angle", r"\chi", "angle of rotation of the body", "rad", value=2 * half)
e = d.vector("axis", r"\vec e", "unit vector of the axis", "1")
theta = d.vector("theta", r"\vec\theta", "Rodrigues vector, 2 tan(χ/2) e", "1")
rho = d.vector("rho", r"\vec\rho", "point before the rotation", "length")
rho_prime = d.vector("rho_prime", r"\vec\rho'", "point after the rotation", "length")
alpha = d.symbol(
    "alpha", r"\alpha", "denominator of Rodrigues' formula, 1 + |θ|²/4", "1", value=1 + norm(theta) ** 2 / 4
)
r = d.vector("r", r"\vec r", "displacement of the point, ρ′ − ρ", "length", value=rho_prime - rho)

t1, t2, t3 = theta
p1, p2, p3 = rho
r1, r2, r3 = r
by_formula = {rho_prime: rodrigues(rho, theta)}
unit_axis = {e.components[2]: dot(e, e) - 1}
d

# %% [markdown]
# ## Rodrigues' formula
#
# The paper starts from Rodrigues' formula (1) for the point after the rotation. With
# $\vec\theta=2\tan\frac\chi2\,\vec e$ it is the rotation by $\chi$ about $\vec e$, that is, the product of $\vec\rho$
# with the rotation matrix $\cos\chi\,I + \sin\chi\,[\vec e]_\times + (1-\cos\chi)\,\vec e\,\vec e^{\,T}$.

# %%
turned = matrix_from_axis_angle(sp.Matrix(e.components), sp.cos(2 * half), sp.sin(2 * half))
d.state(
    "eq-1",
    equal(rho_prime, rodrigues(rho, theta)),
    text="Rodrigues' formula for the point after the rotation.",
    place="eq. (1)",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1), sp.Ne(sp.cos(half), 0)],
).prove(
    given={theta: 2 * sp.tan(half) * e, rho_prime: turned * rho.components},
    modulo=unit_axis,
    because="With the rotation matrix on the left and θ = 2 tan(χ/2) e on the right, both sides are the same "
    "combination of ρ, e × ρ and e × (e × ρ), because sin χ and 1 − cos χ are 2t/(1 + t²) and 2t²/(1 + t²) with t = "
    "tan(χ/2).",
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
    said="χ - angle of rotation of the vector ρ",
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
).prove(
    given=by_formula,
    because="Formula (1) gives α r = θ × ρ + θ × (θ × ρ)/2; multiply by 2.",
)

# %% [markdown]
# ## Two scalar products
#
# Multiplied by $\vec\theta$, both terms on the right of (2) vanish; multiplied by $\vec\rho$, only the first one
# does. The paper announces the first product, which is its equation (3), under the number of the second.

# %%
left_2 = 2 * alpha * r
right_2 = 2 * cross(theta, rho) + cross(theta, cross(theta, rho))
left_4 = 2 * alpha * dot(r, rho)
right_4 = dot(cross(theta, cross(theta, rho)), rho)

d.state(
    "eq-3-announced",
    equal(dot(left_2 - right_2, theta), left_4 - right_4),
    said="Multiplying scalarly (2) by, we obtain equation (4)",
    place="before eq. (3)",
).refute(
    {rho: (0, 0, 1), theta: (1, 0, 0), r: (1, 0, 0)},
    equal(dot(left_2 - right_2, theta), 2 * alpha * dot(r, theta)),
    label="M3",
    because="The product with θ is equation (3); the product with ρ is equation (4). The factor θ is not printed.",
)

# %%
d.state(
    "eq-3",
    equal(2 * alpha * dot(r, theta), 0),
    equal(r1 * t1 + r2 * t2 + r3 * t3, 0),
    text="The displacement is perpendicular to the axis.",
    place="eq. (3)",
).prove(
    given=by_formula,
    because="Both cross products on the right of (2) are perpendicular to θ, and α is not zero.",
)

# %%
d.state("eq-4", equal(left_4, right_4), text="The product of (2) with ρ.", place="eq. (4)").prove(
    given=by_formula,
    because="θ × ρ is perpendicular to ρ, so only the second term of (2) remains.",
)

# %% [markdown]
# ## The angle between axis and point
#
# Let $\gamma$ be the angle between $\vec\theta$ and $\vec\rho$, $\vec u$ the unit vector along
# $\vec\theta\times\vec\rho$, and $\vec v$ the unit vector along $\vec\theta\times\vec u$. By them the right side of (4)
# is a multiple of $\sin^2\gamma$, so that (4) gives $\gamma$ from what is known.

# %%
sin_gamma = d.letter(
    r"sin_gamma | \sin\gamma | sine of the angle between θ and ρ | 1",
    norm(cross(theta, rho)) / (norm(theta) * norm(rho)),
)
cos_gamma = d.letter(r"cos_gamma | \cos\gamma | its cosine | 1", dot(theta, rho) / (norm(theta) * norm(rho)))
u = d.letter(r"u[3] | \vec u | unit vector along θ × ρ | 1", cross(theta, rho) / norm(cross(theta, rho)))
v = d.vector("v", r"\vec v", "unit vector along θ × u", "1", value=cross(theta, u) / norm(theta))
cos_gamma_90 = d.letter(
    r"cos_gamma_90 | \cos\left(90^\circ + \gamma\right) | cosine of the angle between v and ρ | 1",
    dot(v, rho) / norm(rho),
)

d.check(
    "gamma",
    equal(sin_gamma**2 + cos_gamma**2, 1),
    equal(norm(u) ** 2, 1),
    equal(norm(v) ** 2, 1),
    text="Sine and cosine belong to an angle, and the unit vectors have unit length.",
).prove(
    because="Lagrange's identity |θ × ρ|² = |θ|²|ρ|² − (θ, ρ)² gives the first line. u is a vector over its length, "
    "and |θ × u| = |θ| because u is perpendicular to θ.",
)

# %%
d.state(
    "theta-cross-rho-length",
    equal(cross(theta, rho), norm(theta) * norm(rho) * sin_gamma * u),
    place="after eq. (4)",
    text="The first cross product by length and direction.",
).prove(because="This is the definition of sin γ and of u.")

# %%
d.state(
    "theta-cross-theta-cross-rho-length",
    equal(cross(theta, cross(theta, rho)), norm(theta) ** 2 * norm(rho) * sin_gamma * v),
    place="after eq. (4)",
    text="The second cross product by length and direction.",
).prove(because="Insert the first, and θ × u = |θ| v.")

# %%
d.state(
    "dot-by-gamma",
    equal(right_4, norm(theta) ** 2 * norm(rho) ** 2 * sin_gamma * cos_gamma_90),
    equal(right_4, -(norm(theta) ** 2) * norm(rho) ** 2 * sin_gamma**2),
    place="after eq. (4)",
    text="The right side of (4) by the angle γ.",
).prove(
    because="The product of v and ρ is |ρ| cos(90° + γ) = −|ρ| sin γ, because v is perpendicular to θ and in the "
    "plane of θ and ρ.",
)

# %%
ratio = 2 * alpha * dot(r, rho) / (norm(theta) ** 2 * norm(rho) ** 2)
d.state(
    "sin-cos-squared",
    equal(sin_gamma**2, -ratio),
    equal(cos_gamma**2, 1 + ratio),
    place="before eq. (5)",
    text="So (4) gives the squares of sine and cosine.",
).prove(
    given=by_formula,
    because="In (4) insert −|θ|²|ρ|² sin²γ for the right side; cos²γ = 1 − sin²γ.",
)

# %% [markdown]
# The cosine itself has the sign of $(\vec\theta,\vec\rho)$; a square root has not.

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
    because="The sign is missing: minus where γ is obtuse. The data do not determine which, so both signs "
    "give a solution.",
)

# %% [markdown]
# ## Equation (4) in components
#
# The paper now writes the right side of (4) in components: the first cross product, and with a change of variables
# the second.

# %%
i = d.vector("i", r"\vec i", "unit vector of Ox", "1", value=sp.Matrix([1, 0, 0]))
j = d.vector("j", r"\vec j", "unit vector of Oy", "1", value=sp.Matrix([0, 1, 0]))
k = d.vector("k", r"\vec k", "unit vector of Oz", "1", value=sp.Matrix([0, 0, 1]))

d.state(
    "theta-cross-rho",
    equal(cross(theta, rho), (t2 * p3 - p2 * t3) * i + (-t1 * p3 + p1 * t3) * j + (t1 * p2 - p1 * t2) * k),
    place="after eq. (5)",
    text="The first cross product, with the unit vectors i, j, k of the axes.",
).prove(because="The definition of the cross product.")

# %%
theta_prime = d.vector("theta_prime", r"\vec\theta'", "θ × ρ", "length", value=cross(theta, rho))
s1, s2, s3 = theta_prime
d.state(
    "theta-prime",
    equal(s1, t2 * p3 - p2 * t3),
    equal(s2, -t1 * p3 + p1 * t3),
    equal(s3, t1 * p2 - p1 * t2),
    text="Change of variables: θ′ is the first cross product.",
    place="after eq. (5)",
).prove(because="The components of the cross product.")

# %%
d.state(
    "determinant",
    equal(cross(theta, cross(theta, rho)), formal_determinant(theta, theta_prime)),
    equal(
        cross(theta, cross(theta, rho)),
        (t2 * s3 - s2 * t3) * i + (-t1 * s3 + s1 * t3) * j + (t1 * s2 - s1 * t2) * k,
    ),
    place="before eq. (6)",
    text="The second cross product as a determinant.",
).prove(because="The determinant is expanded along its first row.")

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
    text="The components of θ′ are inserted.",
).prove(because="θ × θ′ with the components of θ′.")

# %% [markdown]
# In the expanded form one index of the first component is wrong. The next line of the paper is right again.

# %%
twice = cross(theta, cross(theta, rho))
d.state(
    "expanded-i",
    equal(dot(twice, i), p2 * t1 * t2 - p1 * t2**2 - p1 * t3**2 + p3 * t1 * t2),
    place="before eq. (6), component i",
    text="Expanded, its first component.",
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
    text="Its second component.",
).prove(because="The bracket is multiplied out.")

# %%
d.state(
    "expanded-k",
    equal(dot(twice, k), p1 * t1 * t3 - p3 * t1**2 - p3 * t2**2 + p2 * t2 * t3),
    place="before eq. (6), component k",
    text="Its third component.",
).prove(because="The bracket is multiplied out.")

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
    text="The right side of (4) in components, and as a sum of squares.",
).prove(because="Multiplied out, the twelve terms are those of the three squares.")

# %%
d.state(
    "eq-6",
    equal(squares, -2 * alpha * dot(r, rho)),
    place="eq. (6)",
    text="Equation (4) in components.",
).prove(
    given=by_formula,
    because="The right side of (4) is minus the sum of the squares (entry dot-expanded).",
)

# %% [markdown]
# The left side of (6) is $|\vec\theta\times\vec\rho|^2$, by Lagrange's identity. So (6) does not determine on which
# side of the plane of $\vec\rho$ and $\vec r$ the vector $\vec\theta$ lies, and this produces a false root below.

# %%
d.check(
    "lagrange",
    equal(squares, norm(theta) ** 2 * norm(rho) ** 2 - dot(theta, rho) ** 2),
    text="Lagrange's identity.",
).prove(because="Both sides are |θ × ρ|², multiplied out.")

# %% [markdown]
# ## The triangle of θ and ρ
#
# A third equation is needed. The modulus of $\vec\theta$ is known from the angle, and the paper finds the scalar
# product $c=(\vec\theta,\vec\rho)$ from the third side $\ell$ of a triangle with the sides $\vec\theta$ and
# $\vec\rho$.

# %%
ell = d.symbol("ell", r"\ell", "third side of the triangle of θ and ρ", "none", value=norm(theta - rho))
c = d.letter("c | c | scalar product of θ and ρ | length", (norm(rho) ** 2 + norm(theta) ** 2 - ell**2) / 2)
d.state(
    "system-6-7",
    equal(t1**2 + t2**2 + t3**2, norm(theta) ** 2),
    equal((t1 - p1) ** 2 + (t2 - p2) ** 2 + (t3 - p3) ** 2, ell**2),
    place="before eq. (7)",
    text="The lengths of θ and of the third side, in components.",
).prove(because="The definitions of the two lengths.")

# %%
d.state(
    "modulus",
    equal(norm(theta) ** 2, 4 * sp.tan(half) ** 2),
    place="before eq. (7)",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1)],
    text="The modulus of θ is known from the angle.",
).prove(
    given={theta: 2 * sp.tan(half) * e},
    modulo=unit_axis,
    because="θ is 2 tan(χ/2) times a unit vector.",
)

# %%
d.state(
    "brackets",
    equal(t1**2 - 2 * (t1 * p1 + t2 * p2 + t3 * p3) + t2**2 + t3**2 + p1**2 + p2**2 + p3**2, ell**2),
    place="before eq. (7)",
    text="The second of these equations, multiplied out.",
).prove(because="Both sides are |θ|² − 2 (θ, ρ) + |ρ|².")

# %%
d.state(
    "eq-7",
    equal(t1 * p1 + t2 * p2 + t3 * p3, (norm(rho) ** 2 + norm(theta) ** 2 - ell**2) / 2),
    equal(t1 * p1 + t2 * p2 + t3 * p3, c),
    place="eq. (7)",
    text="The scalar product of θ and ρ.",
).prove(
    because="The sum of the squares of the components is |θ|² and |ρ|²; the right side is the definition of c."
)

# %%
d.state(
    "cosine-law",
    equal(ell**2, norm(rho) ** 2 + norm(theta) ** 2 - 2 * norm(rho) * norm(theta) * cos_gamma),
    place="after eq. (7)",
    text="The law of cosines.",
).prove(because="(θ, ρ) = |θ||ρ| cos γ.")

# %% [markdown]
# This triangle has a side without a unit and a side that is a length. Formula (7) is right nevertheless, for
# any unit, because $\ell$ drops out; but $\ell$ is not a physical quantity. A quantity that is a length to some power
# is multiplied by a power of $\lambda$ when the unit of length becomes $\lambda$ times smaller, so its values at
# $\lambda = 1, 2, 4$ are in geometric progression. Those of $\ell^2$ are not; those of $c$ are.


# %%
def in_unit(quantity: sp.Expr, factor: int) -> sp.Symbol:
    """Return a letter for a quantity of θ and ρ when the unit of length is `factor` times smaller."""
    value = d.value(quantity).xreplace({component: factor * component for component in rho})
    name = f"{quantity.name}_in_unit_{factor}"
    return d.symbol(
        name,
        rf"{quantity.name}|_{{{factor}}}".replace("ell", r"\ell"),
        f"{quantity.name.replace('ell', 'ℓ')} in a unit of length that is {factor} times smaller",
        "1",
        value=value,
    )


ell_at, c_at = ({factor: in_unit(quantity, factor) for factor in (1, 2, 4)} for quantity in (ell, c))
d.state(
    "triangle-units",
    equal(ell_at[2] ** 4, ell_at[1] ** 2 * ell_at[4] ** 2),
    text="θ and ρ can be sides of a triangle: ℓ is a quantity (a power of a length).",
    place="before eq. (7)",
    tacit=True,
).refute(
    {theta: (1, 0, 0), rho: (1, 0, 0)},
    [equal(c_at[2] ** 2, c_at[1] * c_at[4]), equal(c, dot(theta, rho))],
    label="M9",
    because="θ has no unit and ρ is a length, so θ − ρ depends on the unit of length, and here the values "
    "of ℓ² in units that are 1, 2 and 4 times smaller are 0, 1 and 9. c = (θ, ρ) needs no triangle.",
)

# %%
d.state(
    "c-by-gamma",
    equal(c, norm(rho) * norm(theta) * cos_gamma),
    place="before eq. (8)",
    text="c by the angle γ.",
).prove(because="This is the definition of cos γ.")

# %%
c_squared = norm(theta) ** 2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho)
d.state(
    "c",
    equal(c, sp.sqrt(c_squared)),
    place="before eq. (8)",
    text="c from the data.",
).refute(
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
    text="The two linear equations for θ.",
).prove(
    given=by_formula,
    because="Equations (7) and (3).",
)

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
    text="θ₁ and θ₂ by θ₃: a₁ and a₂ are the constant parts, b₁ and b₂ the factors.",
).prove(
    given=by_formula,
    because="Cramer's rule for the two equations (8) in θ₁ and θ₂, whose determinant is w₃. For ρ′ of (1), both "
    "sides agree.",
)
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
    text="θ₁ and θ₂ inserted into (6).",
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
L2 = d.letter(
    "L2 | L_2 | coefficient of θ₃² | length²",
    p13 * b2**2 + p23 * b1**2 + p12 - 2 * p1 * p2 * b1 * b2 - 2 * p1 * p3 * b1 - 2 * p2 * p3 * b2,
)
L1 = d.letter(
    "L1 | L_1 | coefficient of θ₃ | length²",
    2 * p13 * a2 * b2
    + 2 * p23 * a1 * b1
    - 2 * p1 * p2 * (b2 * a1 + b1 * a2)
    - 2 * p1 * p3 * a1
    - 2 * p2 * p3 * a2,
)
L0 = d.letter("L0 | L_0 | constant coefficient | length²", p13 * a2**2 + p23 * a1**2 - 2 * p1 * p2 * a2 * a1)
quadratic = L2 * t3**2 + L1 * t3 + L0
letters = {letter: letter for letter in (a1, b1, a2, b2)}
d.state(
    "eq-10-collected",
    equal(substituted, quadratic),
    text="The coefficients L₂, L₁, L₀, for any a₁, b₁, a₂, b₂.",
    place="after eq. (10)",
).prove(given=letters, because="Both sides are the same polynomial in θ₃, a₁, b₁, a₂, b₂ and ρ.")

# %%
d.state(
    "quadratic",
    equal(quadratic, -2 * alpha * dot(r, rho)),
    text="The quadratic equation for θ₃.",
    place="after eq. (10)",
    assumptions=[sp.Ne(w3, 0)],
).prove(
    given=by_formula,
    because="Equation (6), with θ₁ and θ₂ of (9) and the coefficients of the entry before.",
)

# %% [markdown]
# The coefficients are simpler than they look: up to the factor $|\vec\rho|^2 / w_3^2$, $L_2$ is
# $|\vec w|^2$ and $L_1$ is $-2c\,(\vec r\times\vec w)_3$. ($\vec k$ is the unit vector of $Oz$.)

# %%
d.check(
    "coefficients-compact",
    equal(L2, norm(rho) ** 2 * norm(w) ** 2 / w3**2),
    equal(L1, -2 * c * norm(rho) ** 2 * dot(cross(r, w), k) / w3**2),
    equal(L0, (p1 * a2 - p2 * a1) ** 2 + p3**2 * (a1**2 + a2**2)),
    assumptions=[sp.Ne(w3, 0), "ρ, r and c are any: (1) is not used"],
    text="The coefficients of the quadratic in short.",
).prove(
    given={c: c, r: r},
    because="The definitions of a₁ to b₂ are inserted; both sides are multiplied by w₃².",
)

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
).prove(
    given=by_formula,
    because="From (1), α r = a + θ × a/2 with a = θ × ρ. As θ × (θ × a) = −|θ|² a, θ × m/2 = θ × ρ + θ × r/2 is the "
    "same. The determinant is 1 + |θ|²/4.",
)
cayley

# %% [markdown]
# ## The sign of the root
#
# The paper takes the root of the quadratic with the plus sign, "assuming the angle γ to be acute". But the angle has
# nothing to do with it: $\gamma$ is acute exactly if $c > 0$. The right sign is that of the pivot $w_3$, as the next
# three statements show. First, the discriminant of the quadratic is a square. Here the modulus of $\vec\theta$ and $c$
# are data, and only $c^2=|\vec\theta|^2|\vec\rho|^2+2\alpha(\vec r,\vec\rho)$ is known of $c$.

# %%
modulus = d.letter(r"modulus>0 | \left|\vec\theta\right|_{\mathrm{given}} | known modulus of θ | 1")
data = {alpha: 1 + modulus**2 / 4, c: c}
equal_lengths = {rho_prime.components[2]: norm(rho_prime) ** 2 - norm(rho) ** 2}
two_values_of_c = {c: c**2 - (modulus**2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho))}
discriminant = L1**2 - 4 * L2 * (L0 + 2 * alpha * dot(r, rho))
square = d.check(
    "discriminant",
    equal(discriminant, (2 * norm(rho) ** 2 * norm(r) ** 2 / w3) ** 2),
    text="The discriminant is a square, for all data that satisfy the assumptions.",
    assumptions=[sp.Ne(w3, 0), equal(norm(rho), norm(rho_prime)), equal(c**2, c_squared)],
).prove(
    given={**data, r: r},
    modulo={**two_values_of_c, r3: norm(r) ** 2 + 2 * dot(r, rho)},
    because="With ρ and r free, the difference vanishes modulo |ρ + r|² = |ρ|² and the value of c².",
)
square

# %%
root = d.check(
    "root-of-the-discriminant",
    equal(2 * L2 * t3 + L1, 2 * norm(rho) ** 2 * norm(r) ** 2 / w3),
    text="θ₃ takes the root of the discriminant with the sign of w₃.",
    assumptions=[sp.Ne(w3, 0)],
).prove(
    given=by_formula,
    because="The derivative of the quadratic at θ₃ is ± the root of the discriminant. For ρ′ of (1) it has the value "
    "on the right, whose sign is that of w₃.",
)
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
    proof=[square, root],
    label="M6",
    because="The root has the sign of w₃ = ρ₁r₂ − ρ₂r₁, whether γ is acute or not; here γ is acute, w₃ < 0 "
    "and the printed root is wrong.",
)

# %% [markdown]
# How often is the printed sign wrong? In half of all cases, exactly. Turn the whole picture by half a turn
# about the $x$-axis, $(x, y, z) \to (x, -y, -z)$: the angle $\gamma$, the modulus $|\vec\theta|$ and $c$
# stay, and $w_3$ changes its sign. Whatever the distribution of $\vec\theta$ and $\vec\rho$ is, if it is the same
# after that half turn, $w_3 < 0$ is as likely as $w_3 > 0$, among the acute angles as among all.

# %%
flip = d.matrix("flip", "F", "half turn about Ox", "1", value=sp.diag(1, -1, -1))
d.check(
    "half-of-all",
    equal(rodrigues(flip * rho, flip * theta), flip * rodrigues(rho, theta)),
    equal(dot(flip * theta, flip * rho), dot(theta, rho)),
    equal(dot(cross(flip * rho, flip * r), k), -dot(cross(rho, r), k)),
    text="A half turn about Ox keeps (1) and c and changes the sign of w₃.",
).prove(
    because="A half turn is a rotation: it can be applied before or after (1). It keeps scalar products, and changes "
    "the signs of the second and third components.",
)

# %% [markdown]
# With $c$ positive and the root positive, the printed formulas therefore give a vector that satisfies (1) in half of
# all cases, and the vector that was put in, which the paper's validation says it found "certainly", in a quarter.
# (The tests count both in exact arithmetic. Perhaps the authors picked the fitting root by hand: the text speaks of
# pairs of roots.)

# %%
theta_printed = d.letter(
    r"theta_printed[3] | \vec\theta_{+} | the paper's solution with the printed signs | 1",
    sp.Matrix([a1 + b1 * theta3_printed, a2 + b2 * theta3_printed, theta3_printed]),
)
theta_right = d.letter(
    r"theta_right[3] | \vec\theta_{w} | the same with the sign of w₃ at the root | 1",
    sp.Matrix([a1 + b1 * theta3_right, a2 + b2 * theta3_right, theta3_right]),
)
d.state(
    "validation",
    equal(theta, theta_printed),
    said="the components of the vector θ certainly agreed with those specified",
    place="sec. 5",
    assumptions=[sp.Ne(w3, 0)],
).refute(
    {theta: (0, 0, -2), rho: (3, 0, 4), c: 8},
    equal(theta, theta_right),
    given=by_formula,
    proof=[square, root, by_theta3],
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
    """Return the Rodrigues vector that turns ρ into ρ′, for one of the two values of c."""
    return (c * cross(r, w) + norm(r) ** 2 * w) / norm(w) ** 2


jump = norm(rho) ** 2 * norm(r) ** 2 / w3  # half the root of the discriminant, with the sign of w3
t3_right, t3_wrong = (-L1 / 2 + jump) / L2, (-L1 / 2 - jump) / L2
d.check(
    "roots-compact",
    equal(sp.Matrix([a1 + b1 * t3_right, a2 + b2 * t3_right, t3_right]), solution(c)),
    equal(sp.Matrix([a1 + b1 * t3_wrong, a2 + b2 * t3_wrong, t3_wrong]), -solution(-c)),
    text="The vectors that belong to the two roots.",
    assumptions=[sp.Ne(w3, 0), "ρ, r and c are any: (1) is not used"],
).prove(
    given={c: c, r: r},
    because="With the compact coefficients, θ₃ = (−L₁/2 ± |ρ|²|r|²/w₃)/L₂, and θ₁ and θ₂ by (9).",
)

# %%
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
theta_other = d.letter(
    r"theta_other[3] | \vec\theta_{\mathrm{other}} | vector of the other root, for the same c | 1",
    sp.Matrix([a1 + b1 * theta3_other, a2 + b2 * theta3_other, theta3_other]),
)
theta_minus = d.vector("theta_minus", r"\vec\theta(-c)", "second solution, with −c", "1", value=solution(-c))
d.state(
    "pairs-of-roots",
    equal(rho_prime, rodrigues(rho, theta_other)),
    text="The second root of the quadratic is a solution, too.",
    said="pairs of roots were obtained, which was due to the solution of this equation, depending on the "
    "value of the angle γ, acute or obtuse",
    place="sec. 5",
    assumptions=[sp.Ne(w3, 0)],
).refute(
    {theta: (0, 0, 2), rho: (1, 0, 1)},
    [equal(rho_prime, rodrigues(rho, theta_minus)), equal(norm(theta_minus), norm(theta))],
    given=by_formula,
    proof=[solves],
    label="M7",
    because="The second root gives minus the second solution, which turns ρ′ into ρ. The second solution is "
    "found with −c, and again with the sign of w₃ at the root.",
)

# %% [markdown]
# ## From the vector to the axis
#
# The last step of the paper divides by the length of $\vec\theta$.

# %%
d.state(
    "axis",
    equal(e, theta / norm(theta)),
    said="Dividing by θ|θ|, we find the unit vector of the rotation axis e",
    place="the last line of sec. 4",
    assumptions=[equal(theta, 2 * sp.tan(half) * e), equal(norm(e), 1)],
).refute(
    {half: -sp.pi / 4, e: (0, 0, 1), theta: (0, 0, -2)},
    equal(e, theta / (2 * sp.tan(half))),
    given={theta: 2 * sp.tan(half) * e},
    label="M4",
    because="One cannot divide by the vector θ|θ|. Division by |θ|, which must be meant, reverses e when χ is "
    "negative; divide by 2 tan(χ/2).",
)

# %% [markdown]
# ## The quadratic, found by a machine
#
# Do computer algebra systems really fail here? Asked in the right way, SymPy answers at once. First the
# paper's quadratic. A resultant of two polynomials eliminates a variable from them, without any insight; two in turn
# eliminate $\theta_1$ and $\theta_2$ from (3), (7) and (6). What comes out is the printed quadratic, times a factor
# without $\theta_3$.

# %%
S = d.letter("S | S | right side of (6) with the other sign, 2α(r, ρ) | length²", 2 * alpha * dot(r, rho))
plane, triangle = dot(r.components, theta.components), dot(rho.components, theta.components) - c
resultant = sp.resultant(sp.resultant(squares + S, plane, t1), sp.resultant(triangle, plane, t1), t2)
elimination = d.letter(
    r"elimination | \operatorname{Res} | resultant of (6), (7), (3) by θ₁, then by θ₂ | length⁸",
    resultant,
)
d.check(
    "quadratic-by-resultants",
    equal(elimination, r1**2 * w3**2 * (quadratic + S)),
    text="The resultants of (6), (7) and (3) give the printed quadratic.",
).prove(
    given={c: c, S: S, r: r},
    because="The resultants are computed, and compared as polynomials.",
)

# %% [markdown]
# Then from (1) alone, by a Gröbner basis. The three components of (2), the known modulus, and $c$ as a name
# for $(\vec\theta, \vec\rho)$ go in, in the order $\theta_1 > \theta_2 > \theta_3 > c$. The one condition to
# add is that $\vec\rho$ and $\vec\rho\,'$ have the same length: with
# $\vec\rho = (\vec m - \vec r)/2$ and $\vec\rho\,' = (\vec m + \vec r)/2$ this is $(\vec m,\vec r) = 0$, so
# $r_3 = -(r_1 m_1 + r_2 m_2)/m_3$. The basis $B$ has four elements. The first statement gives their degrees in
# $\theta_1,\theta_2,\theta_3,c$, a row for each; the second, that they vanish at $\vec\theta(c)$.

# %%
m1, m2, m3 = m
frame = {
    r: sp.Matrix([r1, r2, -(r1 * m1 + r2 * m2) / m3]),
    m: m,
    rho: (m - r) / 2,
    rho_prime: (m + r) / 2,
    **data,
}
polynomials = [
    *d.value(left_2 - right_2, frame),
    dot(theta.components, theta.components) - modulus**2,
    d.value(dot(theta, rho), frame) - c,
]
start = time.perf_counter()
basis = sp.groebner(polynomials, t1, t2, t3, c, order="lex")
elimination_seconds = time.perf_counter() - start
ideal = dict(zip((t1, t2, t3, c), basis.exprs, strict=True))
at_solution = dict(zip(theta, d.value(solution(c), frame), strict=True))
remaining = d.letter(
    r"basis_at_solution[4,1] | B(\vec\theta(c)) | elements of the basis at θ(c) | 1",
    sp.Matrix([polynomial.xreplace(at_solution) for polynomial in basis.exprs]),
)
degree = d.letter(
    r"degrees[4,4] | \deg B | degrees of the basis in θ₁, θ₂, θ₃, c | 1",
    sp.Matrix([polynomial.degree_list() for polynomial in basis.polys]),
)
d.check(
    "groebner",
    equal(degree, sp.ImmutableMatrix([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 2]])),
    equal(remaining, sp.ZeroMatrix(4, 1)),
    text="The Gröbner basis of (1) is linear in θ₁, θ₂, θ₃ and quadratic in c alone; θ(c) is its solution.",
).prove(
    given=frame,
    modulo={c: basis.exprs[-1]},
    because="The basis is computed; its last element is c² less its value, by which the others are reduced.",
)

# %% [markdown]
# So there are exactly two solutions, one for each sign of $c$, and the basis has found them without a root
# whose sign must be chosen. The paper's quadratic is a consequence of the basis, as it must be. But it is a
# weaker one: by using (6) in place of (2) it has lost on which side the solution lies, which is where its
# false second root comes from.

# %%
d.check(
    "quadratic-in-ideal",
    equal(quadratic, -2 * alpha * dot(r, rho)),
    text="The printed quadratic follows from the Gröbner basis of (1).",
).prove(
    given=frame,
    modulo=ideal,
    because="Reduced by the four elements of the basis, the difference of both sides is zero.",
)

# %% [markdown]
# ## Hypotheses that are not mentioned
#
# The vectors are "given by the results of an experiment". Then, as a rule, there is no solution: a rotation
# keeps lengths, and measured lengths differ.

# %%
d.check(
    "lengths",
    equal(norm(rho_prime) ** 2, norm(rho) ** 2),
    text="A rotation keeps lengths.",
).prove(
    given=by_formula,
    because="With ρ′ of (1), the difference of both sides is zero.",
)

# %%
c_data = sp.sqrt(modulus**2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho))
d.state(
    "any-experiment",
    equal(rho_prime, rodrigues(rho, theta_printed)),
    text="The solution is one for any ρ and ρ′.",
    said="the vectors ρ′ and ρ are known (for example, given by the results of an experiment)",
    place="after eq. (1)",
    assumptions=[sp.Ne(w3, 0), equal(c, c_data)],
).refute(
    {rho: (1, 0, 0), rho_prime: (0, 2, 0), modulus: 2 * sp.sqrt(3), alpha: 4, c: 2},
    equal(norm(rho), norm(rho_prime)),
    proof=[d.entries["lengths"]],
    label="M8",
    because="A solution exists only if |ρ′| = |ρ|.",
)

# %% [markdown]
# This may be what makes general-purpose solvers fail. Given six independent coordinates, the system has no
# solution, and its Gröbner basis $B$ says so: it is $\{1\}$. With the modulus left open, the last element $B_5$ of the
# basis is $|\vec\theta|^2 + 4$, so a "solution" would have $\alpha = 0$.

# %%
unequal = {rho: (3, 4, 12), rho_prime: (12, -3, 5)}
modulus_squared = d.symbol("modulus_squared", r"\left|\vec\theta\right|^2", "|θ|², left open", "1")
components = list(d.value(left_2 - right_2, {**unequal, alpha: 1 + modulus_squared / 4}))
length = dot(theta.components, theta.components) - modulus_squared
inconsistent = sp.groebner(
    [p.subs(modulus_squared, 20) for p in [*components, length]], t1, t2, t3, order="lex"
)
open_modulus = sp.groebner([*components, length], t1, t2, t3, modulus_squared, order="lex")
known = d.letter("basis_known | B | Gröbner basis for |θ|² = 20 | 1", inconsistent.exprs[0])
unknown = d.letter(
    "basis_unknown | B_5 | last element of the basis for open |θ|² | 1", open_modulus.exprs[-1]
)
d.check(
    "inconsistent",
    equal(known, 1),
    equal(unknown, modulus_squared + 4),
    text="Gröbner bases of (2) for ρ = (3, 4, 12) and ρ′ = (12, −3, 5), with |θ|² = 20 and with any |θ|.",
).prove(because="Buchberger's algorithm; an ideal that contains 1 has no zero.")

# %% [markdown]
# What to do with measured lengths? Take the axis that brings $\vec\rho$ closest to $\vec\rho\,'$. For unit
# vectors $\vec a$ and $\vec b$ and lengths $s$ and $R$,
# $|s\vec b - R\vec a|^2 = (s-R)^2 + sR\,|\vec b - \vec a|^2$: the lengths contribute a constant, and only the
# directions count. So the least-squares axis is the exact solution after $\vec\rho\,'$ has been rescaled to
# the length of $\vec\rho$.

# %%
a, b = d.vector("a", r"\vec a", "a unit vector", "1"), d.vector("b", r"\vec b", "a unit vector", "1")
s, R = d.symbol("s", "s", "length of ρ′", "length"), d.symbol("R", "R", "length of ρ", "length")
d.check(
    "rescaling",
    equal(norm(s * b - R * a) ** 2, (s - R) ** 2 + s * R * norm(b - a) ** 2),
    text="Distance of two vectors by their lengths and directions.",
    assumptions=[equal(norm(a), 1), equal(norm(b), 1)],
).prove(
    modulo={a.components[2]: dot(a, a) - 1, b.components[2]: dot(b, b) - 1},
    because="Both sides are s² + R² − 2sR (a, b).",
)

# %% [markdown]
# The angle must be large enough. $c^2$ has a simple form, and it is negative if
# $|\vec\theta| < 2|\vec r|/|\vec m|$: no rotation turns a vector by more than its own angle.

# %%
d.state(
    "any-modulus",
    sp.Ge(modulus**2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho), 0),
    text="The known modulus of θ gives a real c.",
    place="before eq. (8)",
    tacit=True,
    assumptions=[equal(norm(rho), norm(rho_prime))],
).refute(
    {rho: (1, 0, 0), rho_prime: (0, 1, 0), modulus: 1},
    equal(
        modulus**2 * norm(rho) ** 2 + 2 * alpha * dot(r, rho),
        modulus**2 * norm(m) ** 2 / 4 - norm(r) ** 2,
    ),
    given={alpha: 1 + modulus**2 / 4},
    modulo=equal_lengths,
    label="M8",
    because="c is real only if |θ| ≥ 2|r|/|m|, that is if |χ|, folded to at most π, is no less than the "
    "angle between ρ and ρ′.",
)

# %% [markdown]
# The pivot $w_3$ may be zero without anything being wrong with the data. Then another component of $\vec w$
# must take its place. Formula (1) keeps its form if $x, y, z$ are renamed to $y, z, x$, so all formulas hold
# with the indices $1, 2, 3$ replaced by $2, 3, 1$, and again by $3, 1, 2$. The largest $|w_i|$ is the best
# pivot. All three vanish only if $\vec\rho\,' = \pm\vec\rho$.


# %%
def renamed(formula: sp.Basic) -> sp.Basic:
    """Replace the indices 1, 2, 3 of all vectors by 2, 3, 1."""
    letters = (theta, rho, rho_prime, r, w, m)
    turns = {
        old: new for letter in letters for old, new in zip(letter, [*letter][1:] + [*letter][:1], strict=True)
    }
    return formula.xreplace(turns)


shift = d.matrix(
    "shift", r"\Pi", "renames x, y, z to y, z, x", "1", value=sp.Matrix([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
)
d.check(
    "renaming",
    equal(rodrigues(shift * rho, shift * theta), shift * rodrigues(rho, theta)),
    text="Formula (1) keeps its form when the axes are renamed.",
).prove(because="A cyclic exchange of the axes is a rotation, which keeps cross and scalar products.")

# %%
pivot_1 = [renamed(claim) for claim in by_theta3.claims[::2]]
pivot_2 = [renamed(claim) for claim in pivot_1]
d.state(
    "pivot",
    sp.Ne(w3, 0),
    text="θ₁ and θ₂ can be expressed by θ₃.",
    place="eq. (9)",
    tacit=True,
    assumptions=[sp.Ne(norm(w), 0)],
).refute(
    {theta: (0, 2, 0), rho: (0, 0, 1)},
    [*pivot_1, *pivot_2],
    given=by_formula,
    label="M8",
    because="The denominators vanish where ρ₁r₂ = ρ₂r₁, that is where ρ and ρ′ lie in a plane that contains Oz, "
    "however good the data are. Divide by another component of w.",
)

# %% [markdown]
# At $\chi = \pi$ there is no $\vec\theta$ at all, although there is an axis.

# %%
d.state(
    "half-turn",
    sp.Ne(sp.cos(half), 0),
    text="|θ|² = 4 tan²(χ/2) has a value.",
    place="before eq. (7)",
    tacit=True,
).refute(
    {half: sp.pi / 2},
    equal(rho_prime, 2 * dot(m, rho) / norm(m) ** 2 * m - rho),
    modulo=equal_lengths,
    label="M8",
    because="For χ = π the modulus is infinite. The axis is ±m/|m|: half a turn about it takes ρ to ρ′. If "
    "ρ′ = −ρ, every axis perpendicular to ρ does.",
)

# %% [markdown]
# ## The solution on one line
#
# With $\vec r$, $\vec m$ and $\kappa = \cot\frac\chi2$ everything becomes short. The vectors $\vec m$,
# $\vec r$ and $\vec m\times\vec r$ are perpendicular to each other, and $\vec w = \frac12\,\vec m\times\vec r$:

# %%
kappa = d.symbol("cot_half", r"\kappa", "cotangent of half the angle", "1")
side = d.symbol("side", r"\sigma", "+1 or −1, one for each solution", "1")
either_side = {side: side**2 - 1}
height = sp.sqrt(norm(m) ** 2 - kappa**2 * norm(r) ** 2)


def axis(along_m: sp.Expr) -> sp.Expr:
    """Return the unit axis whose component along m is `along_m` / |m|."""
    return (kappa * cross(m, r) + along_m * m) / norm(m) ** 2


d.check(
    "frame",
    equal(dot(m, r), 0),
    equal(w, cross(m, r) / 2),
    equal(norm(m) ** 2 + norm(r) ** 2, 4 * norm(rho) ** 2),
    assumptions=[equal(norm(rho), norm(rho_prime))],
    text="m and r are perpendicular, and w is half of their cross product.",
).prove(
    modulo=equal_lengths,
    because="(m, r) = |ρ′|² − |ρ|² = 0; m × r = (ρ′ + ρ) × (ρ′ − ρ) = 2 ρ × ρ′; and the sum of the squares is 2|ρ|² "
    "+ 2|ρ′|².",
)

# %% [markdown]
# In this frame Cayley's form for the unit axis, $\kappa\,\vec r = \vec e\times\vec m$, gives the part of $\vec e$ along
# $\vec m\times\vec r$. Its part along $\vec m$ follows from the unit length, up to the sign $\sigma=\pm1$:

# %%
both_axes = d.vector("axes", r"\vec e_\pm", "the two axes", "1", value=axis(side * height))
d.check(
    "solution",
    equal(both_axes, axis(side * height)),
    equal(kappa * r, cross(both_axes, m)),
    equal(norm(both_axes) ** 2, 1),
    text="Both axes solve (1), for any ρ and ρ′ of one length and any κ for which the root is real.",
    assumptions=[equal(norm(rho), norm(rho_prime)), sp.Ge(norm(m), sp.Abs(kappa) * norm(r))],
).prove(
    modulo={**equal_lengths, **either_side},
    because="The first line is the definition. e × m = κ (m × r) × m/|m|² = κ r, because r is perpendicular to m; "
    "and |e|² is (κ²|m|²|r|² + (|m|² − κ²|r|²)|m|²)/|m|⁴ = 1.",
)

# %% [markdown]
# This is the paper's solution, divided by $2\tan\frac\chi2 = 2/\kappa$, and its root is $\kappa c$. As the paper's
# $a_1$ to $L_0$ give $\vec\theta(c)$ (entry `roots-compact`), the printed formulas, with the right signs, lead to
# this line.

# %%
d.check(
    "solution-is-the-papers",
    equal(kappa / 2 * solution(c), axis(kappa * c)),
    text="The axis of the paper's θ(c) is e±, with κc as the root.",
    assumptions=[equal(norm(rho), norm(rho_prime))],
).prove(
    given={c: c},
    modulo=equal_lengths,
    because="With w = m × r/2: r × w = |r|² m/2, |w|² = |m|²|r|²/4.",
)

# %%
d.check(
    "solution-root-is-c",
    equal((kappa * c) ** 2, height**2),
    text="The root of e± is κc.",
    assumptions=[equal(norm(rho), norm(rho_prime)), equal(kappa, 2 / modulus)],
).prove(
    given={**data, modulus: 2 / kappa},
    modulo={**two_values_of_c, **equal_lengths},
    because="With the value of c², (r, ρ) = −|r|²/2 and 4|ρ|² = |m|² + |r|² (entry frame).",
)

# %% [markdown]
# ## How long is the solution?
#
# Table 1 of the paper reports what three packages did: two found no solution, and one found a solution of forty
# pages. That is a report, and nothing here refutes it. But a solution need not be long:

# %%
in_components = sp.ImmutableMatrix(d.value(axis(side * height), {m: m, r: r}))
lengths = {
    "e± in vectors": len(sp.sstr(axis(side * height))),
    "e± in components of m and r": sum(len(sp.sstr(part)) for part in in_components),
    "the paper's solution, by its a₁ to L₀": len(sp.sstr(theta_printed.components))
    + sum(
        len(sp.sstr(row.value)) for row in d.symbols if row.name in ("a1", "b1", "a2", "b2", "L2", "L1", "L0")
    ),
    "the paper's θ₃, with everything inserted": len(
        sp.sstr(d.value(theta3_printed, {r: r, c: c, alpha: alpha}))
    ),
}
d.check(
    "table-1",
    equal(both_axes, in_components),
    text="The solution with its components written out, as long as it becomes: "
    f"{lengths['e± in components of m and r']} characters; in vectors it has {lengths['e± in vectors']}.",
).prove(because="The first line of the solution, in components.")


# %% [markdown]
# The paper's table, with this derivation added, and the lengths of several forms of the solution in characters. (Forty
# pages are some 120 000 characters.)


# %%
def table_1() -> str:
    """Return the paper's Table 1 with this derivation added; the time is that of its Gröbner basis in this run."""
    return "\n".join(
        [
            "| package | time | solution |",
            "| --- | --- | --- |",
            "| Mathcad | not reported | not found |",
            "| Maxima | 4.5 h | not found |",
            "| Maple | 25 h | 40 pages |",
            f"| this notebook (SymPy {sp.__version__}) | {elimination_seconds:.1f} s | "
            f"{lengths['e± in vectors']} characters |",
        ]
    )


# %%
if in_notebook():
    from IPython.display import Markdown, display

    display(Markdown(table_1()))
    rows = [f"| {form} | {length} |" for form, length in lengths.items()]
    display(Markdown("\n".join(["| form of the solution | characters |", "| --- | ---: |", *rows])))

# %% [markdown]
# ## Pictures
#
# The figure shows both axes for one pair of points and one angle. All axes that turn $\vec\rho$ into $\vec\rho\,'$ by
# some angle lie on the great circle perpendicular to $\vec r$, through the directions $\hat m$ of $\vec m$ and $\vec
# n$ of $\vec m\times\vec r$. About each of the two axes, the point moves on a circle from $\vec\rho$ to
# $\vec\rho\,'$, the rim of a cone. The angle of turning is the same.

# %%
if in_notebook():
    from rodgen.derivation.figures import rodrigues as figures
    from rodgen.derivation.figures import show

    components = list(d.value(axis(side * height)))
    show(figures.both_axes(sp.lambdify([*rho, *rho_prime, kappa, side], components, cse=True)))

# %% [markdown]
# How well can the axis be computed in double precision? The map shows the error of both forms, against
# exact arithmetic, over the angle $\chi$ and the pivot $w_3$. The paper's form (with the right signs)
# loses digits with a small pivot and with a small angle; the coordinate-free form does not.

# %%
if in_notebook():
    inputs = [*rho, *rho_prime, modulus]
    given_c = {alpha: 1 + modulus**2 / 4, c: c_data}
    papers_axis = list(d.value(theta_right / modulus, given_c))
    short_axis = d.value(axis(height).subs(kappa, 2 / modulus))
    same_length = rho_prime.components * norm(rho.components) / norm(rho_prime.components)
    exact_axis = list(short_axis.xreplace(dict(zip(rho_prime, same_length, strict=True))))
    formulas = {
        "as the paper, with right signs": sp.lambdify(inputs, papers_axis, "numpy", cse=True),
        "coordinate-free": sp.lambdify(inputs, list(short_axis), "numpy", cse=True),
    }
    show(figures.accuracy(formulas, sp.lambdify(inputs, exact_axis, "mpmath", cse=True)))

# %% [markdown]
# ## The paper's form as a program
#
# The solver that is shipped is made from the half-angle form, in `derivation/axis.py`. This kernel takes the
# definitions above step by step, for comparison; it is not shipped. It gives both solutions, $c = \pm\sqrt{\ldots}$
# each with the sign of $w_3$ at the root, and what the paper prints, with plus at both. It needs
# $|\vec\rho\,'| = |\vec\rho|$ and a large enough angle, and divides by $w_3$.


# %%
def solve_axis_paper() -> Kernel:
    k = KernelBuilder(
        "solve_axis_paper",
        summary="Rodrigues vectors that turn a point into another by a known angle, as the paper computes them.",
        source="Stebulyanin and Pimushkin, eqs. (2), (9), (10) and the formulas after them",
        notes="For comparison; solve_axis is the one to use. NaN or infinite where the angle is too small or "
        "rho_1 r_2 = rho_2 r_1; wrong where the lengths differ.",
    )
    before = k.input("rho", 3, unit="length", doc="point before the rotation")
    after = k.input("rho_prime", 3, unit="length", doc="point after the rotation")
    angle = k.input("angle", unit="rad", doc="angle of the rotation")
    modulus_squared = k.let("modulus_squared", 4 * sp.tan(k.let("half_angle", angle / 2)) ** 2)
    k.let("alpha", 1 + modulus_squared / 4)
    moved = k.let("r", after - before)
    known = k.let("S", 2 * alpha * moved.dot(before))
    k.let("c", sp.sqrt(modulus_squared * before.dot(before) + known))
    for row in d.symbols:
        if row.symbol in (a1, b1, a2, b2, p12, p13, p23, L2, L1, L0):
            k.let(row.name, row.value)
    printed_root = k.let("printed_root", sp.sqrt(L1**2 - 4 * L2 * (L0 + S)))
    root = k.let("root", select(before.cross(moved)[2] < 0, -printed_root, printed_root))

    def vector(name: str, sign: int, root: sp.Expr) -> sp.Matrix:
        t3 = k.let(
            f"theta3_{name}", (-sign * L1 + root) / (2 * L2)
        )  # a1, a2 and L1 change their signs with c
        return sp.Matrix([sign * a1 + b1 * t3, sign * a2 + b2 * t3, t3])

    both = sp.Matrix.hstack(vector("plus", 1, root), vector("minus", -1, root)).T
    k.output("theta", both, unit="1", doc="both Rodrigues vectors, one a row")
    k.output(
        "theta_printed",
        vector("printed", 1, printed_root),
        unit="1",
        doc="the vector with the printed signs; half of the time it is not a solution",
    )
    return k.build()


paper = solve_axis_paper()
