# %% [markdown]
# # Closed chains: the equations behind the model of a machine on legs
#
# A Tricept or a 3-SPS-S is commanded by the lengths $l_k$ of three legs, a hexapod by those of six. Leg $k$ joins the
# point $\vec a_k$ of the base to the point $\vec p_k(\vec y)$ of the platform, whose pose $\vec y$ has as many
# unknowns as there are legs. The pose for given lengths is the solution of the equations
#
# $$F_k(\vec y)=\tfrac12\lvert\vec p_k(\vec y)-\vec a_k\rvert^2-\tfrac12 l_k^2=0 .$$
#
# The model's functions solve them by a few steps of Newton's method, starting from the pose on the nominal machine, and
# are differentiated line by line. This notebook proves
#
# 1. that the derivatives obtained in that way are those of the solution, by the implicit function theorem;
# 2. that the steps move the platform as they should, for the Tricept, the 3-SPS-S and the hexapod;
# 3. what force a load puts into each leg, and how far the load sinks if the legs are springs.
#
# What is proved are the functions of `rodgen.symbolic.legs`, of which the models are built.

# %%
import sympy as sp

from rodgen.symbolic import (
    Derivation,
    Formulas,
    cross,
    dot,
    equal,
    legs,
    matrix_from_rodrigues_vector,
    rodrigues,
    rot,
    skew,
)

d = derivation = Derivation(
    "closed_chain",
    title="Closed chains: poses by Newton's steps, their derivatives, and the forces in the legs",
    source='Kureková et al., "Positioning uncertainty of the Tricept type parallel kinematic structure", and Zhou and '
    'Zhu, "A Decoupling Method for Successive Robot Rotation Based on Time Domain Instantaneous Euler Angle"',
    kernels_in="those of a machine: 'rodgen emit MACHINE.toml'",
)
FORMULAS = Formulas()

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product, and $[\vec a]_\times$ the matrix of the cross product with $\vec a$.

# %%
parameter = d.symbol("theta", r"p", "a parameter of the machine, such as the place of a joint", "1")
y = [d.symbol(f"y_{i}", f"y_{i}", f"unknown {i} of the pose", "1") for i in (1, 2)]
alpha = d.symbol("alpha", r"\alpha", "angle of the Tricept about x, positive as in the paper", "rad")
beta = d.symbol("beta", r"\beta", "angle of the Tricept about y", "rad")
turn = d.vector("turn", r"\vec\theta", "a step of Newton's method for a 3-SPS-S, as a Rodrigues vector", "1")
x = d.vector("x", r"\vec x", "a point of the platform, from its pivot", "length")
g = d.vector("g", r"\vec g", "direction of gravity", "1")
b = d.vector("b", r"\vec b_k", "joint of leg k on the platform, from the pivot", "length")
leg = d.vector("d", r"\vec d_k", "from leg k's joint on the base to that on the platform, p − a", "length")
w = d.vector("w", r"\vec\omega", "a small turn of the platform", "rad")
d

# %% [markdown]
# ## Derivatives of a solved pose
#
# Newton's step for one equation $F(y,p)=0$ with the slope $F'=\partial F/\partial y$ is $N(y,p)=y-F/F'$. How does its
# result depend on the starting point $y$? Differentiated, it is $F\,F''/F'^2$, and at a solution that is zero, because
# $F$ is. So the steps before the last one contribute nothing to the derivative. What the last one contributes,
# $\partial N/\partial p=-(\partial F/\partial p)/F'$, is the derivative of the implicit function.
#
# The proof for three unknowns is the same line by line, with the inverse of the matrix of slopes. It is given here for
# two unknowns, $\vec y=(y_1,y_2)$ and $\vec F=(F_1,F_2)$, where $F_1$ and $F_2$ are any functions. The step is
# $\vec N=\vec y-J^{-1}\vec F$ with the matrix of slopes $J=\partial\vec F/\partial\vec y$.

# %%
F = sp.Matrix([sp.Function(f"F_{i}")(*y, parameter) for i in (1, 2)])
slopes = F.jacobian(y)
step = sp.Matrix(y) - slopes.inv() * F
solved = {F[0]: sp.S.Zero, F[1]: sp.S.Zero}


def at_a_solution(expression):
    """The value where both equations hold; their derivatives stay."""
    names = {derivative: sp.Dummy() for derivative in expression.atoms(sp.Derivative)}
    back = {name: derivative for derivative, name in names.items()}
    return expression.xreplace(names).xreplace(solved).xreplace(back)


def named(matrix):
    """Derivatives of the unknown functions as plain symbols."""
    return sp.ImmutableMatrix(matrix).xreplace(
        {f.diff(x): sp.Symbol(f"{f.func.__name__}_{x.name}", real=True) for f in F for x in (*y, parameter)}
    )


by_start = d.letter(
    r"step_by_start[2,2] | \frac{\partial\vec N}{\partial\vec y} | "
    r"derivative of the step's result by its starting point, at a solution | 1",
    named(step.jacobian(y).applyfunc(at_a_solution)),
)
d.check(
    "newton-forgets",
    equal(by_start, sp.ZeroMatrix(2, 2)),
    text="At a solution the result of Newton's step does not depend on its starting point.",
    assumptions=["F₁ = F₂ = 0, and the matrix of slopes has an inverse"],
).prove(
    because="The derivative of y − J⁻¹F by y is I − J⁻¹J, which is zero, less the derivative of J⁻¹ times F, which "
    "is zero where F is.",
)

# %%
by_parameter = d.letter(
    r"step_by_parameter[2,1] | \frac{\partial\vec N}{\partial p} | "
    r"derivative of the step's result by the parameter, at a solution | 1",
    named(step.diff(parameter).applyfunc(at_a_solution)),
)
implicit = d.letter(
    r"implicit_by_parameter[2,1] | -J^{-1}\frac{\partial\vec F}{\partial p} | derivative of the implicit function | 1",
    named((-slopes.inv() * F.diff(parameter)).applyfunc(at_a_solution)),
)
d.check(
    "implicit-function",
    equal(by_parameter, implicit),
    text="Its derivative by a parameter of the machine is that of the implicit function.",
    assumptions=["F₁ = F₂ = 0, and the matrix of slopes has an inverse"],
).prove(because="As before, the term with the derivative of J⁻¹ vanishes with F.")

# %% [markdown]
# The functions take half the square of each leg, less half of that of its length, and as slopes the leg times the
# derivative of its end:

# %%
base = sp.Matrix(sp.symbols("a_1 a_2 a_3", real=True))
end = sp.Matrix([sp.Function(f"p_{i}")(*y) for i in (1, 2, 3)])
half_square = sp.Symbol("h_l", real=True)
closed = legs.half_gap(FORMULAS, end - base, half_square)
rates = {f.diff(x): sp.Symbol(f"{f.func.__name__}_{x.name}", real=True) for f in end for x in y}
by_pose = d.letter(
    r"leg_by_pose[1,2] | \frac{\partial F_k}{\partial\vec y} | slopes of half the square of a leg | length",
    sp.Matrix([[closed.diff(x) for x in y]]).doit().xreplace(rates),
)
by_legs = d.letter(
    "leg_slopes[1,2] | J_k | its slopes in the program | length",
    legs.slopes(FORMULAS, [end - base], [end.jacobian(y)]).xreplace(rates),
)
d.check(
    "closed-leg",
    equal(by_pose, by_legs),
    text="The slopes are the derivatives of the equations.",
).prove()

# %% [markdown]
# Six equations are solved without a choice of pivots by their normal equations, $J^TJ\,\vec s=-J^T\vec F$, whose matrix
# is positive definite. It is the same step:

# %%
square = sp.Matrix(2, 2, sp.symbols("J_11 J_12 J_21 J_22", real=True))
gap = sp.Matrix(sp.symbols("F_1 F_2", real=True))
by_normal = d.letter(
    r"step_by_normal_equations[2,1] | (J^TJ)^{-1}J^T\vec F | step of the normal equations, with the opposite sign | 1",
    legs.solution(FORMULAS, square, gap),
)
by_normal_transposed = d.letter(
    r"transposed_by_normal_equations[2,1] | J(J^TJ)^{-1}\vec F | solution of the transposed equations | 1",
    legs.transposed_solution(FORMULAS, square, gap),
)
direct = d.letter(
    r"step_by_inverse[2,1] | J^{-1}\vec F | Newton's step, with the opposite sign | 1", square.inv() * gap
)
direct_transposed = d.letter(
    r"transposed_by_inverse[2,1] | J^{-T}\vec F | the same of the transposed | 1", square.inv().T * gap
)
d.check(
    "normal-equations",
    equal(by_normal, direct),
    equal(by_normal_transposed, direct_transposed),
    text="The normal equations have Newton's step as their solution, and the transposed ones that of the transposed.",
    assumptions=["the matrix of slopes has an inverse"],
).prove(because="(JᵀJ)⁻¹ is J⁻¹ J⁻ᵀ, and J⁻ᵀ Jᵀ is the unit matrix; J (JᵀJ)⁻¹ is J⁻ᵀ.")

# %% [markdown]
# They are solved by the factors $LDL^T$ of their matrix; three equations by the inverse:

# %%
lower = sp.Matrix(3, 3, sp.symbols("A_1 A_2 A_3 A_2 A_4 A_5 A_3 A_5 A_6", real=True))
right = sp.Matrix(sp.symbols("b_1 b_2 b_3", real=True))
any_three = sp.Matrix(3, 3, sp.symbols("J_1_1 J_1_2 J_1_3 J_2_1 J_2_2 J_2_3 J_3_1 J_3_2 J_3_3", real=True))
by_factors = d.letter(
    r"by_factors[3] | A\vec x | a symmetric matrix times the solution by its factors | 1",
    lower * sp.Matrix(legs.solved(FORMULAS.let, lower, right)),
)
b_vector = d.vector("b_vector", r"\vec b", "right sides of the system", "1", value=right)
by_inverse = d.letter(
    r"by_inverse[3,3] | J\,J^{-1} | a matrix times its inverse in the program | 1",
    any_three * legs.inverse(FORMULAS, any_three),
)
d.check(
    "factors",
    equal(by_factors, b_vector),
    equal(by_inverse, sp.Identity(3)),
    text="The solution by factors solves the system, and the inverse is the inverse.",
    assumptions=["no pivot vanishes", "the matrix has an inverse"],
).prove()

# %% [markdown]
# ## How the platform turns
#
# **The Tricept.** Its platform is turned by $P=O_y(\beta)\,O_x(\alpha)$, a rotation about $y$ times one about $x$, with
# the paper's transposed $O_x$; and it slides along its own $z$ axis, so that a point of it is at
# $P(\vec b+z\vec e_3)$. As $\alpha$ grows, the platform turns about $-O_y\vec e_1$; as $\beta$ grows, about $\vec e_2$
# ($\vec e_1,\vec e_2,\vec e_3$ are the unit vectors of the base):

# %%
Oy = rot("y", beta)
Ox = rot("x", alpha).T
P = legs.tricept_turn(FORMULAS, *((sp.cos(angle), sp.sin(angle)) for angle in (alpha, beta)))
stroke = d.symbol("stroke", "z", "way of the platform along its own z axis", "length")
own = sp.Matrix(b.components)
by_unknowns = d.letter(
    r"point_by_unknowns[3,3] | \frac{\partial\vec p}{\partial(\alpha,\beta,z)} | "
    r"derivative of a point of the platform | length",
    (P * own + P[:, 2] * stroke).jacobian([alpha, beta, stroke]),
)
rates_of_b = d.letter(
    r"point_rates[3,3] | (-O_y\vec e_1\times\vec p,\;\vec e_2\times\vec p,\;P\vec e_3) | "
    r"the same in the program | length",
    legs.tricept_rates(FORMULAS, P, (sp.cos(beta), sp.sin(beta)), P * own + P[:, 2] * stroke),
)
by_alpha = d.letter(
    r"platform_by_alpha[3,3] | \frac{\partial P}{\partial\alpha} | derivative of the rotation | 1",
    P.diff(alpha),
)
by_beta = d.letter(
    r"platform_by_beta[3,3] | \frac{\partial P}{\partial\beta} | derivative of the rotation | 1", P.diff(beta)
)
platform = d.letter("platform[3,3] | P | rotation of the platform, Oy(β) Ox(α) | 1", P)
about_x = d.vector("about_x", r"O_y\vec e_1", "the x axis after the rotation about y", "1", value=Oy[:, 0])
about_y = d.vector("about_y", r"\vec e_2", "unit vector along y", "1", value=sp.Matrix([0, 1, 0]))
d.check(
    "tricept-turns",
    equal(by_alpha, -skew(about_x) * platform),
    equal(by_beta, skew(about_y) * platform),
    equal(platform, Oy * Ox),
    equal(by_unknowns, rates_of_b),
    text="The derivatives of the Tricept's rotation are turns about these two axes.",
).prove(
    because="Both sides are matrices of sines and cosines of α and β; their elements agree. The sign of the first is "
    "that of the transposed Ox.",
)

# %% [markdown]
# **The 3-SPS-S.** Its platform turns about a pivot. A step of Newton's method is a small turn $\vec\theta$ after the
# turns before it. If it is applied as the rotation with the Rodrigues vector $\vec\theta$, then the platform stays
# rigid however large the step is. The model computes it with $\vec\tau=\frac12\vec\theta$ as

# %%
tau = d.vector("tau", r"\vec\tau", "half the Rodrigues vector of the step", "1", value=turn / 2)
turned_x = d.vector(
    "turned_x",
    r"\vec x+\frac{2(\vec\tau\times\vec x+\vec\tau\times(\vec\tau\times\vec x))}{1+(\vec\tau,\vec\tau)}",
    "x after the step in the program",
    "length",
    value=legs.turned_by_step(FORMULAS, sp.eye(3), sp.Matrix(turn.components)) * sp.Matrix(x.components),
)
d.check(
    "step-turns",
    equal(turned_x, rodrigues(x, turn)),
    text="The step of the program is Rodrigues' formula.",
).prove(because="With θ = 2τ both denominators are 1 + |τ|², and both numerators 2τ × x + 2τ × (τ × x).")

# %% [markdown]
# Where the search for a pose starts, a rotation is given as a unit quaternion $(w,\vec v)$; it is that with the
# Rodrigues vector $2\vec v/w$:

# %%
scalar = d.symbol("scalar", "w", "scalar of a unit quaternion", "1")
v = d.vector("v", r"\vec v", "its vector", "1")
of_quaternion = d.letter(
    r"of_quaternion[3,3] | R(w,\vec v) | matrix of a unit quaternion in the program | 1",
    legs.matrix_of_quaternion(FORMULAS, scalar, sp.Matrix(v.components)),
)
d.check(
    "quaternion",
    equal(scalar**2 * (of_quaternion * x), scalar**2 * rodrigues(x, 2 * v / scalar)),
    text="The matrix turns by that Rodrigues vector.",
    assumptions=[equal(scalar**2 + dot(v, v), 1), sp.Ne(scalar, 0)],
).prove(modulo={scalar: scalar**2 + dot(v, v) - 1})

# %% [markdown]
# Newton's method needs no more than the first order of the step, and that is the one of a small turn:

# %%
size = d.symbol("size", "s", "factor of a step", "1")
scaled = matrix_from_rodrigues_vector(size * sp.Matrix(list(turn))) * sp.Matrix(list(x))
first_order = d.letter(
    r"first_order[3] | \left.\frac{\mathrm d}{\mathrm ds}\,R(s\,\vec\theta)\,\vec x\,\right|_{s=0} | "
    r"derivative of the rotated point by the size of the step, at zero | length",
    scaled.diff(size).subs(size, 0),
)
by_turn = d.letter(
    r"by_turn[3,3] | \frac{\partial(\vec\theta\times\vec x)}{\partial\vec\theta} | "
    r"its derivative by the turn in the program | length",
    legs.turn_rates(FORMULAS, sp.Matrix(x.components)),
)
d.check(
    "step-is-small",
    equal(first_order, cross(turn, x)),
    equal(first_order, by_turn * turn),
    text="To first order the step moves each point by the cross product with the turn.",
).prove(because="In Rodrigues' formula for s θ the part of first order in s is s θ × x.")

# %% [markdown]
# **The hexapod.** Its platform is shifted by the first three unknowns, $\vec t$, and turned as that of the 3-SPS-S by
# the last three. A small step changes half the square of a leg's length by a scalar product with each of them:

# %%
shift = d.vector("t", r"\vec t", "a small shift of the platform", "length")
d.check(
    "slope-of-a-hexapod's-leg",
    equal(dot(leg, shift + cross(w, b)), dot(shift, leg) + dot(w, cross(b, leg))),
    text="Row k of the hexapod's matrix of slopes is d_k and b_k × d_k.",
).prove(because="A triple product stays the same when its three vectors are permuted cyclically.")

# %% [markdown]
# ## The force in a leg
#
# A unit load pulls along $\vec g$ at the point $\vec x$ of the platform. What is the tension $t_k$ in each leg?
# Leg $k$ pulls its joint $\vec p_k=h\vec e_3+\vec b_k$, at the height $h$ of the pivot, along $-\vec d_k/l_k$ with
# $\vec d_k=\vec p_k-\vec a_k$. Where the platform turns about a pivot that
# takes any force, the moments about it are in balance:
#
# $$\vec x\times\vec g-\sum_k t_k\,\vec b_k\times\vec d_k/l_k=0 .$$
#
# The model finds the tensions from virtual work. A small turn $\vec\omega$ changes half the square of a leg's
# length by $(\vec d_k,\vec\omega\times\vec b_k)$, and the height of the load by $(\vec g,\vec\omega\times\vec x)$; both
# are scalar products of $\vec\omega$ with a vector:

# %%
d.check(
    "slope-of-a-leg",
    equal(dot(leg, cross(w, b)), dot(w, cross(b, leg))),
    equal(dot(g, cross(w, x)), dot(w, cross(x, g))),
    text="How half the square of a leg, and the height of the load, change with a turn.",
).prove(because="A triple product stays the same when its three vectors are permuted cyclically.")

# %% [markdown]
# So row $k$ of the matrix of slopes $J$ is $(\vec b_k\times\vec d_k)^T$, the load on the unknowns is the vector
# $\vec m=\partial(\vec x,\vec g)/\partial\vec y=\vec x\times\vec g$, and the balance of moments reads
# $\sum_k (t_k/l_k)\,J_k^T=\vec m$, where $J_k$ is the row $k$. Its solution is $t_k=l_k\,(J^{-T}\vec m)_k$:

# %%
J = any_three
m = sp.Matrix(sp.symbols("m_1 m_2 m_3", real=True))
spans = [sp.Matrix(sp.symbols(f"d_{k}1 d_{k}2 d_{k}3", real=True)) for k in (1, 2, 3)]
lengths = [sp.sqrt(dot(span, span)) for span in spans]
# gravity along the first axis, and m as the rates of the load along it
rates = sp.Matrix.vstack(m.T, sp.zeros(2, 3))
tension = legs.tensions(FORMULAS, spans, J, rates, sp.Matrix([1, 0, 0]))
load = d.vector("m", r"\vec m", "load on the three unknowns", "length", value=m)
pull = d.letter(
    r"pull[3] | \sum_k\tfrac{t_k}{l_k}J_k^T | what the tensions t_k = l_k (J⁻ᵀ m)_k put against it | length",
    sum((tension[k] / lengths[k] * J[k, :].T for k in range(3)), sp.zeros(3, 1)),
)
d.check(
    "tensions-balance",
    equal(pull, load),
    text="These tensions balance the load in every unknown, whatever the legs are.",
    assumptions=["J has an inverse"],
).prove(because="The sum is Jᵀ J⁻ᵀ m.")

# %% [markdown]
# On a hexapod the six legs bear the load alone: with the rows $(\vec d_k,\vec b_k\times\vec d_k)$ and $\vec m=(\vec g,
# \vec x\times\vec g)$ the balance is that of the forces and of the moments about the origin of the platform axes.
#
# On a Tricept the passive leg takes what would turn the platform about its own axis or move it off that leg. It
# leaves the three unknowns free, and for these the same balance holds, with the row
# $(\vec d_k,\partial\vec p_k/\partial\vec y)$ for leg $k$ and $\vec m=(\vec g,\partial\vec x/\partial\vec y)$.
#
# A tension is also a slope: if leg 1 is made longer by a small amount, the load moves along $\vec g$ by $t_1$ times
# that amount; and so for the other legs.

# %%
change = J.inv() * sp.Matrix([lengths[0], 0, 0])
way = d.letter(
    r"way | \frac{\partial(\vec x,\vec g)}{\partial l_1} | way of the load along gravity, by the length of leg 1 | 1",
    (m.T * change)[0],
)
first_tension = d.symbol("t_1", "t_1", "tension of leg 1", "1", value=tension[0])
d.check(
    "tension-is-a-slope",
    equal(way, first_tension),
    text="The tension of a leg is how the load's way along gravity changes with its length.",
    assumptions=["J has an inverse"],
).prove(
    because="A longer leg changes its half square by l₁ and the other two by nothing, so the unknowns by J⁻¹ (l₁, 0, "
    "0)ᵀ and the load's way by mᵀ times that, which is l₁ (J⁻ᵀ m)₁.",
)

# %% [markdown]
# A leg that is a spring of compliance $c$ gives way by $c\,F\,t_k$ under the load $F$. So the load sinks along $\vec
# g$ by $\sum_k t_k\cdot c\,F\,t_k=cF\sum_k t_k^2$, which is never negative.
