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
# # Closed chains: the equations behind the model of a machine on legs
#
# A machine of a family, a Tricept or a 3-SPS-S, is commanded by the lengths $l_k$ of three legs. Leg $k$ joins the
# point $\vec a_k$ of the base and the point $\vec p_k(\vec y)$ of the platform, whose pose $\vec y$ has three
# unknowns:
#
# $$F_k(\vec y)=\tfrac12\lvert\vec p_k(\vec y)-\vec a_k\rvert^2-\tfrac12 l_k^2=0 .$$
#
# The model's kernels solve that by a few Newton steps from the pose on the nominal machine, and are
# differentiated as written. Here it is proved that this gives the derivatives of the implicit function theorem,
# that the steps of both families turn the platform as they should, and what force a load puts into each leg.

# %%
import sympy as sp

from rodgen.symbolic import (
    Derivation,
    cross,
    dot,
    equal,
    matrix_from_rodrigues_vector,
    rodrigues,
    rot,
    skew,
)

derivation = Derivation(
    "closed_chain",
    title="Closed chains: poses by Newton's steps, their derivatives, and the forces in the legs",
    source='Kureková et al., "Positioning uncertainty of the Tricept type parallel kinematic structure", '
    'and Zhou and Zhu, "Instantaneous Euler angles"',
)
d = derivation

# %% [markdown]
# ## Derivatives of a solved pose
#
# With the slope $F'$ of an equation $F(y,\theta)=0$ the step $N(y,\theta)=y-F/F'$ depends on its starting point only as
# far as $F$ is not zero yet: its derivative with respect to $y$ is $F\,F''/F'^2$. At a solution that vanishes, so
# the steps before the last one do not contribute to the derivative, and $\partial N/\partial\theta=-F_\theta/F'$ is
# that of the implicit function. The proof for three unknowns is the same line by line, with the inverse of the matrix
# of slopes; it is given for two unknowns.

# %%
theta = d.symbol("theta", r"\theta", "a parameter of the machine", "1")
y = [d.symbol(f"y_{i}", f"y_{i}", "unknown of the pose", "1") for i in (1, 2)]
F = sp.Matrix([sp.Function(f"F_{i}")(*y, theta) for i in (1, 2)])
slopes = F.jacobian(y)
step = sp.Matrix(y) - slopes.inv() * F
solved = {F[0]: sp.S.Zero, F[1]: sp.S.Zero}


def at_a_solution(expression):
    """The value where both equations hold; their derivatives stay."""
    names = {derivative: sp.Dummy() for derivative in expression.atoms(sp.Derivative)}
    back = {name: derivative for derivative, name in names.items()}
    return sp.simplify(expression.xreplace(names).xreplace(solved).xreplace(back))


def named(matrix):
    """Derivatives of the unknown functions as plain symbols."""
    return sp.ImmutableMatrix(matrix).xreplace(
        {f.diff(x): sp.Symbol(f"{f.func.__name__}_{x.name}", real=True) for f in F for x in (*y, theta)}
    )


d.check(
    "newton-forgets",
    equal(named(step.jacobian(y).applyfunc(at_a_solution)), sp.ImmutableMatrix(sp.zeros(2, 2))),
    text="At a solution the result of Newton's step does not depend on its starting point.",
).prove()
d.check(
    "implicit-function",
    equal(
        named(step.diff(theta).applyfunc(at_a_solution)),
        named((-slopes.inv() * F.diff(theta)).applyfunc(at_a_solution)),
    ),
    text="Its derivative with respect to a parameter is that of the implicit function.",
).prove()

# %% [markdown]
# ## How the platform turns
#
# The platform of a Tricept is turned by $P=O_y(\beta)O_x(\alpha)$ with the paper's transposed $O_x$, and slides along
# its own $z$ axis. A point $P(\vec b+z\vec e_3)$ of it moves with $\alpha$ as turned about $-O_y\vec e_x$, and with
# $\beta$ as turned about $\vec e_y$.

# %%
alpha = d.symbol("alpha", r"\alpha", "angle about x, positive as in the paper", "rad")
beta = d.symbol("beta", r"\beta", "angle about y", "rad")
Oy = rot("y", beta)
Ox = rot("x", alpha).T
P = Oy * Ox
d.check(
    "tricept-turns",
    equal(sp.ImmutableMatrix(P.diff(alpha)), sp.ImmutableMatrix(skew(-Oy[:, 0]) * P)),
    equal(sp.ImmutableMatrix(P.diff(beta)), sp.ImmutableMatrix(skew(sp.Matrix([0, 1, 0])) * P)),
    text="The derivatives of the Tricept's rotation are turns about these axes.",
).prove()

# %% [markdown]
# The platform of a 3-SPS-S turns about its pivot. A step is a small turn $\vec\theta$ after the one before. As the
# Rodrigues vector of it the step is a rotation whatever its size, and to first order it is $\vec\theta\times$, which
# is all that Newton's method needs.

# %%
turn = d.vector("turn", r"\vec\theta", "a step of Newton's method, as a Rodrigues vector", "1")
x = d.vector("x", r"\vec x", "a point of the platform, from the pivot", "length")
tau = turn / 2
d.check(
    "step-turns",
    equal(x + 2 * (cross(tau, x) + cross(tau, cross(tau, x))) / (1 + dot(tau, tau)), rodrigues(x, turn)),
    text="The step as it is computed, with half of it, is Rodrigues' formula.",
).prove()
size = d.symbol("size", "s", "factor of a step", "1")
scaled = matrix_from_rodrigues_vector(size * sp.Matrix(list(turn))) * sp.Matrix(list(x))
d.check(
    "step-is-small",
    equal(sp.ImmutableMatrix(scaled.diff(size).subs(size, 0)), cross(turn, x)),
    text="To first order it is the cross product.",
).prove()

# %% [markdown]
# ## The force in a leg
#
# A unit load pulls along $\vec g$ at the point $\vec x$ of the platform. Where the platform turns about a pivot that
# takes any force, the moments about it are in balance: leg $k$, under the tension $t_k$, pulls the joint $\vec p_k$
# along $-\vec d_k/l_k$, with $\vec d_k=\vec p_k-\vec a_k$ and $\vec p_k=h\vec e_3+\vec b_k$,
#
# $$\vec x\times\vec g-\sum_k t_k\,\vec b_k\times\vec d_k/l_k=0 .$$
#
# The model has it from virtual work: with the slopes $J$ of the half squares of the lengths, row $k$ of which is
# $(\vec b_k\times\vec d_k)^T$, the tensions are $t_k=l_k\,(J^{-T}\vec m)_k$ where $\vec m$ is the load on the
# unknowns, $\partial(\vec x\cdot\vec g)/\partial\vec y=\vec x\times\vec g$. They balance the moments, whatever the
# legs are.

# %%
g = d.vector("g", r"\vec g", "direction of gravity", "1")
b = d.vector("b", r"\vec b_k", "joint of a leg on the platform, from the pivot", "length")
leg = d.vector("d", r"\vec d_k", "from the leg's joint on the base to that on the platform", "length")
w = d.vector("w", r"\vec\omega", "a small turn of the platform", "rad")
d.check(
    "slope-of-a-leg",
    equal(dot(leg, cross(w, b)), dot(w, cross(b, leg))),
    equal(dot(g, cross(w, x)), dot(w, cross(x, g))),
    text="How half the square of a leg, and the height of the load, change with a turn.",
).prove()
J = sp.Matrix(3, 3, sp.symbols("J_1_1 J_1_2 J_1_3 J_2_1 J_2_2 J_2_3 J_3_1 J_3_2 J_3_3", real=True))
m = sp.Matrix(sp.symbols("m_1 m_2 m_3", real=True))
lengths = sp.Matrix(sp.symbols("l_1 l_2 l_3", positive=True))
tension = sp.Matrix([lengths[k] * (J.inv().T * m)[k] for k in range(3)])
d.check(
    "tensions-balance",
    equal(
        sp.ImmutableMatrix(
            (sum((tension[k] / lengths[k] * J[k, :].T for k in range(3)), sp.zeros(3, 1)) - m).applyfunc(
                sp.cancel
            )
        ),
        sp.ImmutableMatrix(sp.zeros(3, 1)),
    ),
    text="These tensions balance the load in every unknown.",
).prove()

# %% [markdown]
# On a Tricept the passive leg takes what would turn the platform about its own axis or move it off that leg. It
# leaves free the three unknowns, and along these the same balance holds: the row of a leg is $\vec
# d_k\cdot\partial\vec p_k/\partial\vec y$ with the derivatives above, and $\vec m=\vec g\cdot\partial\vec
# x/\partial\vec y$.
#
# A leg that is a spring of compliance $c$ gives way by $c\,F\,t_k$ under the load $F$. So the load sinks: along $\vec
# g$, by $\sum_k t_k\cdot c\,F\,t_k=cF\sum_k t_k^2\geq0$, as $\partial(\vec x\cdot\vec g)/\partial l_k=t_k$.

# %%
change = J.inv() * sp.Matrix([lengths[0], 0, 0])
d.check(
    "tension-is-a-slope",
    equal(sp.cancel((m.T * change)[0]), sp.cancel(tension[0])),
    text="The tension of a leg is how the load's way along gravity changes with its length.",
).prove()

# %%
d
