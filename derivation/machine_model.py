# %% [markdown]
# # The equations behind a machine's model
#
# A machine is a chain of joints from its base to the measured point. Joint $j$ slides along its axis $\vec n$, or
# turns about the line through the point $\vec P$ along it. All axes, points and targets are given in machine axes
# with every joint at zero. A target $\vec p$ is seen at
#
# $$\vec y=(1+k)\;B\;S\;W\;\mathrm{Lift}\;\bigl(D_1J_1\,D_2J_2\cdots D_nJ_n\;\vec p\,\bigr),$$
#
# where $J_j$ is the joint's own motion and $D_j$ its error motion; refraction lifts directions; $W$, $S$ and $B$
# move the frame (a drift, a shift of the set-up, the free frame of the instrument), and $k$ is the instrument's
# scale.
#
# A model of a machine is that line as a program, one joint after the other, with its derivatives. Can one rely on it?
# This notebook proves what such a program needs:
#
# - each step is the intended rigid motion (*One joint*, *The chain*), also near zero, where quotients like
#   $\sin\varphi/\varphi$ lose their digits (*Rotation vectors*);
# - the published machine of Stebulyanin and Pimushkin is one of these chains (*The paper's machine*);
# - how each kind of parameter moves the seen point, which is what a fit needs (a table and its proofs);
# - what an error motion means, and where it must be put (*Where an error motion enters*);
# - which changes no reading can reveal (*What no reading can determine*);
# - how directions, refraction, gravity and sagging beams enter (the formulas of effects have a derivation of their own,
#   `effects`).
#
# Nothing is proved of a copy: the formulas below are what the functions of `rodgen.symbolic.rigid_motions` return when
# they are given letters, and the models of machines are what the same functions return when they are given the numbers
# of a program.

# %%

from dataclasses import replace

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    Derivation,
    Formulas,
    Letter,
    cross,
    dot,
    equal,
    in_notebook,
    norm,
    rodrigues,
    select,
    skew,
)
from rodgen.symbolic import rigid_motions as motions

d = derivation = Derivation(
    "machine_model",
    title="Machines: chains of joints, error motions, and how each parameter moves the seen point",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", sec. 2 and eq. (1)',
)

# %% [markdown]
# ## Symbols
#
# These are needed from the start; others are explained where they first occur, and the whole table is at the end. A
# symbol without a definition may have any value. The image of a point under a motion has a letter of its own, such as
# $J\vec x$ for what the joint $J$ makes of $\vec x$; proofs substitute its definition. Any rotation is written by a
# quaternion of any length. $(\vec a,\vec b)$ is the scalar product.

# %%
q = d.symbol("q", "q", "reading of a joint, with its errors: angle or length", "rad or length")
h = d.symbol("h", "h", "half of an angle", "rad")
n = d.vector("n", r"\vec n", "unit vector of a joint's axis", "1")
P = d.vector("P", r"\vec P", "point on a joint's axis; where its error motion turns", "length")
x = d.vector("x", r"\vec x", "a point, as the joints beyond have left it", "length")
z = d.vector("z", r"\vec z", "another point", "length")
omega = d.vector(
    "omega", r"\vec\omega", "rate of a small turn, a rotation vector per unit of a parameter", "rad"
)
s = d.vector("s", r"\vec s", "translation of any rigid motion", "length")


def any_rotation(name: str) -> sp.Matrix:
    """Matrix of a quaternion of any length: every rotation there is."""
    scalar, *vector = sp.symbols(f"{name}_w {name}_x {name}_y {name}_z", real=True)
    turn = skew(sp.Matrix(vector))
    return sp.eye(3) + (2 * scalar * turn + 2 * turn**2) / (scalar**2 + sum(v**2 for v in vector))


Q = d.matrix("Q", "Q", "any rotation: of the joints before, of a frame", "1", value=any_rotation("Q"))
E = d.matrix("E", "E", "the rotation of an error motion", "1", value=any_rotation("E"))
epsilon = sp.Symbol("epsilon", real=True)
unit = {n.components[2]: dot(n, n) - 1}
FORMULAS = Formulas()
FIRST, SECOND = (Formulas(select=lambda condition, *cases, taken=taken: cases[taken]) for taken in (0, 1))
"""What a function computes where the condition of its cases holds, and where it does not."""


def circle(angle: sp.Expr) -> motions.Turn:
    """Cosine and sine of an angle."""
    return sp.cos(angle), sp.sin(angle)


def turned(v: sp.Basic, angle: sp.Expr = q, axis: sp.Basic = n) -> sp.Basic:
    """Rodrigues' formula: v turned about a unit axis."""
    return motions.turned(FORMULAS, v, axis, circle(angle))


def turn(v: sp.Basic, angle: sp.Expr = q) -> sp.Basic:
    """What a rotary joint does to a point."""
    return motions.turned_about(FORMULAS, v, n, P, circle(angle))


def slide(v: sp.Basic) -> sp.Basic:
    """What a linear joint does to a point."""
    return motions.slid(v, n, q)


def slope(row: str, of: sp.Basic, by: sp.Symbol, at: int | None = None) -> sp.Basic:
    """Name the derivative of an exact expression, taken by SymPy in components, for a proof to compare with."""
    rate = sp.Matrix(d.value(of)).diff(by)
    return d.letter(f"{row} | per unit of the parameter", rate if at is None else rate.subs(by, at))


def slope_along(row: str, of: sp.Basic, by: sp.Basic, rate: sp.Basic) -> sp.Basic:
    """Name the derivative of an exact expression when a vector changes at some rate."""
    of = sp.Matrix(d.value(of))
    terms = (of.diff(part) * speed for part, speed in zip(by, rate, strict=True))
    return d.letter(f"{row} | per unit of the parameter", sum(terms, sp.zeros(3, 1)))


d

# %% [markdown]
# ## One joint
#
# The motion of a rotary joint is the paper's eq. (1), Rodrigues' formula, about a line that need not pass through
# the origin: $J\vec x=\vec P+R(\vec x-\vec P)$. Written with sine and cosine it has no infinite tangent at a half
# turn.

# %%
theta = d.vector("theta", r"\vec\theta", "the paper's Rodrigues vector", "1", value=2 * sp.tan(h) * n)
R_x = d.letter(r"R_x | R\vec x | x turned about n by q | length", turned(x))
R_z = d.letter(r"R_z | R\vec z | z turned about n by q | length", turned(z))
J_x = d.letter(r"J_x | J\vec x | what a rotary joint makes of x | length", turn(x))
J_z = d.letter(r"J_z | J\vec z | what a joint makes of z | length", turn(z))
d.check(
    "turn-is-eq-1",
    equal(R_x, rodrigues(x, theta)),
    text="The joint's rotation is the one of eq. (1) with the Rodrigues vector 2 tan(q/2) n, here with q = 2h.",
).prove(given={q: 2 * h}, modulo=unit)

# %%
R_of_cross = d.letter(
    r"R_of_cross[3] | R(\vec x\times\vec z) | a turned cross product | length", turned(cross(x, z))
)
d.check(
    "turn-is-rigid",
    equal(norm(J_x - J_z) ** 2, norm(x - z) ** 2),
    equal(cross(R_x, R_z), R_of_cross),
    text="It keeps distances and orientation: it is a rigid motion.",
).prove(modulo=unit)

# %%
along = d.symbol("along", r"\lambda", "way along an axis", "length")
of_axis = d.letter(
    r"of_axis | J(\vec P+\lambda\vec n) | what a rotary joint makes of a point of its axis | length",
    turn(P + along * n),
)
elsewhere = d.letter(
    r"elsewhere | J_{\vec P+\lambda\vec n}\,\vec x | the same joint with another point of its axis | length",
    P + along * n + turned(x - P - along * n),
)
d.check(
    "axis-stays",
    equal(of_axis, P + along * n),
    equal(elsewhere, J_x),
    text="It leaves every point of its axis where it is. Which of them is named does not matter: the place of an "
    "axis has two freedoms, across itself.",
).prove(modulo=unit)

# %%
L_x = d.letter(r"L_x | J_s\vec x | what a linear joint makes of x, x + q n | length", slide(x))
L_z = d.letter(r"L_z | J_s\vec z | what a joint makes of z | length", slide(z))
d.check(
    "slide-is-rigid",
    equal(L_x - L_z, x - z),
    text="A linear joint moves every point alike: it keeps all differences, and so distances and directions. Where "
    "its axis lies has no effect.",
).prove()

# %% [markdown]
# ### Why "product of exponentials"
#
# In homogeneous coordinates both motions are $e^{q\Xi}$: of the twist
# $\Xi=\bigl[\begin{smallmatrix}[\vec n]_\times&-\vec n\times\vec P\\0&0\end{smallmatrix}\bigr]$ for a rotary joint,
# of $\bigl[\begin{smallmatrix}0&\vec n\\0&0\end{smallmatrix}\bigr]$ for a linear one. The exponential is the only
# solution of $\frac{dJ}{dq}=\Xi J$ that starts from the identity. So two facts prove it; the first is the
# derivative that a fit needs.

# %%
by_q = slope(r"by_q | \frac{\partial J\vec x}{\partial q} | derivative of a turn by the reading", turn(x), q)
R_of_speed = d.letter(
    r"R_of_speed | R\bigl(\vec n\times(\vec x-\vec P)\bigr) | n × (x − P), turned about n by q | length",
    turned(cross(n, x - P)),
)
at_rest = d.letter(
    r"at_rest[3] | J\vec x|_{q=0} | what a rotary joint makes of x at the reading zero | length",
    turn(x, sp.S.Zero),
)
d.check(
    "by-reading",
    equal(by_q, cross(n, J_x - P)),
    equal(by_q, R_of_speed),
    equal(at_rest, x),
    text="A point moves across the axis and its own arm: n × (Jx − P), which is n × (x − P), turned.",
).prove(modulo=unit)

# %%
by_q_slide = slope(
    r"by_q_slide | \frac{\partial J_s\vec x}{\partial q} | derivative of a slide by the reading", slide(x), q
)
d.check("by-slide", equal(by_q_slide, n), text="The same for a linear joint.").prove()

# %%
q_1 = d.symbol("q_1", "q_1", "a part of a reading", "rad")
q_2 = d.symbol("q_2", "q_2", "the other part of a reading", "rad")
whole = d.letter(r"whole | J(q_1+q_2)\,\vec x | turn by the sum of two readings | length", turn(x, q_1 + q_2))
in_parts = d.letter(
    r"in_parts[3] | J(q_1)\,J(q_2)\,\vec x | turn by one reading after the other | length",
    turn(turn(x, q_2), q_1),
)
d.check(
    "parts-of-a-reading",
    equal(whole, in_parts),
    text="Turns about one axis add up. So an error of the reading is a turn of its own, before or after.",
).prove(modulo=unit)

# %% [markdown]
# ## The chain
#
# Everything is given at zero, but when joint 1 moves, it carries the axis of joint 2 away. The product takes care of
# that: with $G\vec x=Q\vec x+\vec s$ for whatever the joints before have done,
# $G\,J_{\vec n,\vec P}=J_{Q\vec n,G\vec P}\,G$. Read from the right, joints move in their places at zero, the last one
# first. Read from the left, they move one after the other from the base, each about the axis to which those before
# have carried it.

# %%
G_x = d.letter(r"G_x | G\vec x | x, carried by the joints before | length", Q * x + s)
G_P = d.letter(r"G_P | G\vec P | the joint's point, carried by them | length", Q * P + s)
G_J_x = d.letter(
    r"G_J_x[3] | G\,J\vec x | what a rotary joint made of x, carried by the joints before | length",
    Q * turn(x) + s,
)
J_G_x = d.letter(
    r"J_G_x | J_{Q\vec n,G\vec P}\,G\vec x | what the carried joint makes of the carried x | length",
    Q * P + s + turned(Q * (x - P), axis=Q * n),
)
d.check(
    "carried-turn",
    equal(G_J_x, J_G_x),
    equal(G_x - G_P, Q * (x - P)),
    text="A rotary joint, carried, turns about the carried axis through the carried point.",
).prove()

# %%
G_L_x = d.letter(
    r"G_L_x[3] | G\,J_s\vec x | what a linear joint made of x, carried by the joints before | length",
    Q * slide(x) + s,
)
d.check(
    "carried-slide",
    equal(G_L_x, G_x + q * (Q * n)),
    text="A linear joint, carried, slides along the carried axis.",
).prove()

# %% [markdown]
# ## The paper's machine
#
# Section 2 of the paper describes a gantry of three linear joints that carries a rotary one, with
# $\vec r_A=\vec r_1+C\vec q+\vec r_a$. Some of the words that define its symbols are lost in print; this is how they
# map.
#
# | paper | chain | machine file |
# | --- | --- | --- |
# | stationary Cartesian system | machine axes | `frame = "machine"` |
# | $\vec q$, linear displacements | readings of the first three joints | `type = "prismatic"` |
# | column $\vec c_j$ of the calibration matrix $C$ | $(1+k_j)\,\vec n_j$ | `axis`, effects `squareness` and `scale` |
# | $\vec r_1$, origin of the moving system | point $\vec P$ of the rotary joint | `point` |
# | $\vec e$, $\chi$ | axis $\vec n$ and reading $q$ of the fourth joint | `type = "revolute"`, `axis` |
# | $\vec\rho$, pole of the effector before the turn | $\vec p-\vec P$ | `[[target]]`, less `point` |
# | $\vec r_a=\vec\rho\,'$, the pole after it | $R(\vec p-\vec P)$ | |
# | $\vec r_A$, the pole in the stationary system | $J_1J_2J_3J_4\,\vec p$ | columns `x`, `y`, `z` |
#
# The axes of a machine file are unit vectors; the lengths of the columns of $C$ are therefore scales. Nine numbers
# of $C$ are three times the two tilts of an axis and one scale, and every $C$ without a column of zeros is such a
# chain.

# %%
C = d.matrix("C", "C", "the paper's calibration matrix", "1", value=Letter("C", 3, 3).components)
commands = d.vector("commands", r"\vec q", "the paper's coordinates of the three linear joints", "length")
r_1 = d.vector("r_1", r"\vec r_1", "the paper's origin of the moving system", "length")
r_a = d.vector("r_a", r"\vec r_a", "the paper's pole of the effector in the moving system", "length")
columns = [C.components[:, j] for j in range(3)]
scales = [
    d.symbol(f"k_{j}", f"k_{j}", f"scale of linear joint {j}", "1", value=norm(column) - 1)
    for j, column in enumerate(columns, start=1)
]
axes = [
    d.vector(f"n_{j}", rf"\vec n_{j}", f"unit axis of linear joint {j}", "1", value=column / norm(column))
    for j, column in enumerate(columns, start=1)
]


def gantry(point: sp.Basic) -> sp.Basic:
    """Three linear joints, the last one first, each with its scale on the reading."""
    for axis, k, command in reversed(list(zip(axes, scales, commands, strict=True))):
        point = point + (command + k * command) * axis
    return point


r_A = d.letter(
    r"r_A[3] | \vec r_A | what three linear joints make of the target r₁ + r_a | length", gantry(r_1 + r_a)
)
d.state(
    "r-A",
    equal(r_A, r_1 + C * commands + r_a),
    text="Three linear joints along the columns of C, and the target r₁ + r_a.",
    place="sec. 2",
    assumptions=["no column of C vanishes"],
).prove()

# %% [markdown]
# That no column vanishes is all that the chain needs. To *command* a place, $C$ must be invertible. The paper
# takes an inverse for granted where it speaks of correcting motions.

# %%
wanted = d.vector("wanted", r"\vec r^*", "where the pole is wanted", "length")
lacking = sp.Matrix(d.value(wanted - r_1 - r_a))
command_for = d.letter(
    r"command_for | \vec q^* | the command that brings it there, C⁻¹(r* − r₁ − r_a) | length",
    C.components.adjugate() * lacking / C.components.det(),
)
d.check(
    "command",
    equal(r_1 + C * command_for + r_a, wanted),
    text="With an invertible C every place has one command, and as r_a may be any vector, that is so with a rotary "
    "joint, too. The paper says that translations alone do not correct a machine with one: that is true of the "
    "body's direction, not of the place of the pole. In either case the axis and its place must be known.",
    assumptions=["det C ≠ 0"],
).prove()

# %%
zero = d.vector("zero", r"\vec a", "zero offsets of the linear joints", "length")
of_sum = d.letter(
    r"of_sum[3] | \vec r_A' | r_A of (r₁ + C a) + z and r_a − z | length",
    (r_1 + C * zero + z) + C * commands + r_a - z,
)
d.check(
    "only-the-sum",
    equal(r_1 + C * (commands + zero) + r_a, of_sum),
    text="Readings of the pole determine only the sum of r₁, C a and r_a: zero offsets, the origin of the moving "
    "system and a target that does not turn are one vector.",
).prove()

# %% [markdown]
# With the rotary joint as the fourth of the chain, its point $\vec P=\vec r_1$ and the target
# $\vec p=\vec r_1+\vec\rho$, the paper's $\vec r_a$ is $\vec\rho\,'$ of eq. (1).

# %%
rho = d.vector("rho", r"\vec\rho", "the paper's pole before the turn, in the moving system", "length")
four = d.letter(
    r"four | J_1J_2J_3J_4(\vec r_1+\vec\rho) | "
    r"what a chain of three linear joints and a rotary one makes of the pole | length",
    gantry(r_1 + turned(rho)),
)
d.state(
    "r-A-with-rotation",
    equal(four, r_1 + C * commands + rodrigues(rho, theta)),
    text="The chain of three linear joints and a rotary one.",
    place="sec. 2, with eq. (1)",
    assumptions=["no column of C vanishes", equal(norm(n), 1), sp.Ne(sp.cos(h), 0)],
).prove(given={q: 2 * h}, modulo=unit)

# %%
beside = d.letter(
    r"beside | J_{\vec n,\vec P+C\vec q}\,(\vec x+C\vec q) | "
    r"a turn about an axis that was carried along, parallel to itself | length",
    P + C * commands + turned((x + C * commands) - (P + C * commands)),
)
d.state(
    "axis-unchanged",
    equal(J_x + C * commands, beside),
    text="The slides carry the axis along, parallel to itself.",
    said="remains unchanged and does not depend on the movement in telescopic kinematic pairs",
    place="sec. 2",
).prove()

# %% [markdown]
# One thing the paper leaves out. Eq. (1) turns about an axis through the origin of the moving system. If the axis
# passes it by, at $\vec b$, its direction does not determine $\vec r_a$; `point` is as much a parameter as `axis`.

# %%
aside = d.vector("aside", r"\vec b", "a point of the axis in the moving system", "length")
after = d.letter(
    r"after[3] | \vec r_a(\vec b) | pole after a turn about an axis through b | length",
    aside + turned(rho - aside),
)
d.state(
    "direction-is-enough",
    equal(after, rodrigues(rho, theta)),
    text="The pole after the turn follows from the direction of the axis.",
    said="a vector that completely depends on the true direction of the unit vector of the axis",
    place="sec. 2",
    assumptions=[equal(norm(n), 1)],
).refute(
    {n: (0, 0, 1), h: sp.pi / 4, rho: (1, 0, 0), aside: (0, 1, 0)},
    equal(after, aside + rodrigues(rho - aside, theta)),
    given={q: 2 * h},
    modulo=unit,
    label="M10",
    because="It depends on the place of the axis, too, unless the axis passes through the origin of the moving system.",
)

# %% [markdown]
# ## Rotation vectors
#
# An error motion turns by a rotation vector $\vec w$: about its direction, by its length $\varphi$. It enters
# exactly, $R(\vec w)=I+S[\vec w]_\times+K[\vec w]_\times^2$ with $S=\frac{\sin\varphi}\varphi$ and
# $K=\frac{1-\cos\varphi}{\varphi^2}$. Nothing in it is singular at $\vec w=0$, near which all error motions are.

# %%
w = d.vector("w", r"\vec w", "rotation vector", "rad")
phi = d.symbol("phi", r"\varphi", "length of the rotation vector, the angle", "rad", value=norm(w))
S = d.symbol("S", "S", "sin(φ)/φ", "1", value=sp.sin(phi) / phi)
K = d.symbol("K", "K", "(1 - cos φ)/φ²", "1", value=(1 - sp.cos(phi)) / phi**2)
T = d.symbol("T", "T", "(φ - sin φ)/φ³", "1", value=(phi - sp.sin(phi)) / phi**3)
COEFFICIENTS = ("S", "K", "T")


def by_vector(v: sp.Basic, w: sp.Basic = w) -> sp.Basic:
    """Turn v by a rotation vector, whose length S and K know."""
    return v + motions.change_by_quotients(FORMULAS, v, w, S, K)


W_x = d.letter(r"W_x | R(\vec w)\,\vec x | x turned by w, with the letters S and K | length", by_vector(x))
W_z = d.letter(r"W_z | R(\vec w)\,\vec z | z turned by w | length", by_vector(z))
d.check(
    "vector-is-eq-1",
    equal(W_x, x + S * cross(w, x) + K * cross(w, cross(w, x))),
    equal(W_x, rodrigues(x, theta)),
    equal(W_x, R_x),
    text="For w = 2h n it is the rotation of eq. (1) about n by 2h.",
).prove(given={w: 2 * h * n, phi: 2 * h, q: 2 * h}, modulo=unit)

# %%
left = d.letter(
    "left[3,3] | L | left Jacobian of w, I + K[w] + T[w]² | 1",
    sp.Matrix(d.value(sp.Identity(3) + K * skew(w) + T * skew(w) * skew(w), {K: K, T: T})),
)
change = d.vector(
    "change", r"\vec\delta", "change of a vector per unit of a parameter", "per unit of the parameter"
)
by_w = slope_along(
    r"by_w | \frac{d}{d\epsilon}R(\vec w+\epsilon\vec\delta)\,\vec z | derivative of the turned z by w, at ε = 0",
    by_vector(z),
    w,
    change,
)
d.check(
    "left-jacobian",
    equal(by_w, cross(left * change, W_z)),
    text="To first order R(w + δ) = R(Lδ) R(w) with L = I + K[w] + T[w]²: what w turns moves by (Lδ) × what it is.",
).prove()

# %%
small_turn = (
    x
    + sp.sin(epsilon * phi) / phi * cross(w, x)
    + (1 - sp.cos(epsilon * phi)) / phi**2 * cross(w, cross(w, x))
)
at_zero = slope(
    r"at_zero | \frac{d}{d\epsilon}R(\epsilon\vec w)\,\vec x | rate of x turned by a small w, at ε = 0",
    small_turn,
    epsilon,
    0,
)
d.check(
    "at-zero",
    equal(x + at_zero, motions.turned_a_little(FORMULAS, x, w)),
    text="At zero L is the identity: a small turn adds w × x.",
).prove()

# %%
Q_W_x = d.letter(r"Q_W_x | Q\,R(\vec w)\,\vec x | the turned x, carried | length", Q * by_vector(x))
W_Q_x = d.letter(
    r"W_Q_x | R(Q\vec w)\,Q\vec x | the carried x, turned by the carried w | length", by_vector(Q * x, Q * w)
)
d.check(
    "carried-vector",
    equal(Q_W_x, W_Q_x),
    equal(norm(Q * w) ** 2, norm(w) ** 2),
    text="Carried by a rotation Q, the turn by w is the turn by Qw, as long as w itself: S and K are the same.",
).prove(given={S: S, K: K})

# %% [markdown]
# ### Smooth at zero
#
# Near zero the quotients lose their digits, and at zero they are 0/0. Below $\varphi^2=\frac14$ eight terms of their
# series in $\varphi^2$ stand in, $S_8=\sum_{k<8}\frac{(-\varphi^2)^k}{(2k+1)!}$, and likewise $K_8$ with $(2k+2)!$ and
# $T_8$ with $(2k+3)!$. By Taylor's theorem a function differs from its Taylor polynomial at zero, of the degree $m-1$,
# by at most $\frac{\varphi^m}{m!}$ times the largest value of its $m$-th derivative.

# %%
TERMS = motions.TERMS
square = d.symbol("square", r"\varphi^2", "square of an angle φ", "rad²")
small = d.symbol("small", r"\varphi", "an angle", "rad")


S_8, K_8, T_8 = (
    d.letter(f"{name}_8 | {name}_8 | eight terms of the series of {name} | 1", motions.series(square, first))
    for first, name in enumerate(COEFFICIENTS, start=1)
)


def taylor(function: sp.Expr, degree: int) -> sp.Expr:
    """The Taylor polynomial at zero, by derivatives."""
    return sum(function.diff(small, n).subs(small, 0) / sp.factorial(n) * small**n for n in range(degree + 1))


for first, terms, function, written in (
    (1, S_8, sp.sin(small), "sin φ"),
    (2, K_8, 1 - sp.cos(small), "1 − cos φ"),
    (3, T_8, small - sp.sin(small), "φ − sin φ"),
):
    name = COEFFICIENTS[first - 1]
    order = 2 * TERMS + first
    exact = function / small**first
    polynomial = d.letter(
        f"taylor_{name} | p_{name} | Taylor polynomial of {written} at zero, of degree {order - 1} | 1",
        taylor(function, order - 1),
    )
    last = d.letter(
        f"derivative_{name} | f_{name}^{{({order})}} | derivative of {written} of order {order} | 1",
        function.diff(small, order),
    )
    d.check(
        f"series-{name}",
        sp.Le(
            sp.Abs(terms - exact),
            small ** (2 * TERMS) / sp.factorial(order, evaluate=False),
        ),
        text=f"Eight terms of the series differ from ${d.latex(exact)}$ by at most this much.",
        assumptions=[sp.Ne(small, 0)],
    ).prove(
        equal(polynomial, small**first * terms),
        equal(last, sp.cos(small)),
        given={square: small**2},
        because=f"Times {('φ', 'φ²', 'φ³')[first - 1]}, the eight terms are the Taylor polynomial of {written}. What "
        f"this leaves out is the power {order} of φ, divided by {order}!, times a value of the derivative of this "
        "order, which is a cosine.",
    )
d.page("series-S", "series-K", "series-T")

# %%
beta_S, beta_K, beta_T = (
    d.letter(
        rf"beta_{name} | \beta_{name} | what may be left out of {name} below φ² = 1/4 | 1",
        sp.Rational(motions.SERIES_BELOW) ** TERMS / sp.factorial(2 * TERMS + first),
    )
    for first, name in enumerate(COEFFICIENTS, start=1)
)
d.check(
    "series-bound",
    sp.Lt(beta_S, sp.Rational(1, 2**64)),
    sp.Lt(beta_K, sp.Rational(1, 2**68)),
    sp.Lt(beta_T, sp.Rational(1, 2**72)),
    text="4.3e-20, 2.4e-21 and 1.3e-22, of numbers near 1, 1/2 and 1/6: a thousandth of the rounding of double "
    "precision.",
).prove(
    equal(beta_S, sp.Rational(1, 23310331287699456000)),
    equal(beta_K, sp.Rational(1, 419585963178590208000)),
    equal(beta_T, sp.Rational(1, 7972133300393213952000)),
    because="Their reciprocals are 23310331287699456000 > 2⁶⁴, 419585963178590208000 > 2⁶⁸ and "
    "7972133300393213952000 > 2⁷².",
)

# %%
d.check(
    "half-angle",
    equal((1 - sp.cos(2 * h)) / (2 * h) ** 2, 2 * (sp.sin(h) / (2 * h)) ** 2),
    text="Beyond, K is 2 sin²(φ/2)/φ², in which nothing cancels.",
).prove()

# %% [markdown]
# The function that turns by a rotation vector has these two cases:

# %%
computed = d.letter(
    r"computed | R_{\geq}(\vec w)\,\vec x | x turned by w in the program, from φ² = 1/4 on | length",
    motions.turned_by_vector(SECOND, x, w),
)
computed_small = d.letter(
    r"computed_small | R_{<}(\vec w)\,\vec x | x turned by w in the program, below φ² = 1/4 | length",
    motions.turned_by_vector(FIRST, x, w),
)
d.check(
    "quotients",
    equal(computed, W_x),
    equal(computed_small, x + S_8 * cross(w, x) + K_8 * cross(w, cross(w, x))),
    text="It is the rotation by w, with the quotients from φ² = 1/4 on and with the series below.",
).prove(given={square: norm(w) ** 2})

# %% [markdown]
# ### The tilted axis
#
# The axis of the file, $\vec n_0$, with unit vectors $\vec u$ and $\vec v$ that complete it, is turned by the rotation
# vector $a\vec u+b\vec v$. Every direction is reached with a turn of at most $\pi$, so two freedoms are all there
# are; and the derivatives are smooth in $a$ and $b$.

# %%
a = d.symbol("a", "a", "tilt about u", "rad")
b = d.symbol("b", "b", "tilt about v", "rad")
n_0 = d.vector("n_0", r"\vec n_0", "axis of the file", "1")
u = d.vector("u", r"\vec u", "unit vector perpendicular to the axis of the file", "1")
v = d.vector("v", r"\vec v", "unit vector perpendicular to that axis and to u", "1")
tilt = {w: a * u + b * v}
in_frame = {n_0: (0, 0, 1), u: (1, 0, 0), v: (0, 1, 0), **tilt}
tilted = d.letter(
    r"tilted | \vec n(a,b) | the tilted axis, R(a u + b v) n₀ | 1", by_vector(n_0, a * u + b * v)
)
d.check(
    "tilted-axis",
    equal(tilted, sp.cos(phi) * n_0 + S * (b * u - a * v)),
    equal(norm(tilted), 1),
    text="The tilted axis, for orthonormal u, v, n₀.",
).prove(
    equal(tilted, sp.cos(phi) * n_0 + S * (b * u - a * v)),
    equal(norm(tilted) ** 2, 1),
    given=in_frame,
    because="Both sides are identical for u, v, n₀ = x, y, z, and turn with them; a length is not negative.",
)

# %%
by_a, by_b = (
    d.letter(
        rf"by_{name} | \frac{{\partial\vec n}}{{\partial {name}}} | derivative of the tilted axis by {name} | 1/rad",
        sp.Matrix(d.value(tilted, in_frame)).diff(symbol),
    )
    for name, symbol in (("a", a), ("b", b))
)
d.check(
    "by-tilt-of-the-axis",
    equal(by_a, cross(left * u, tilted)),
    equal(by_b, cross(left * v, tilted)),
    equal(by_a, -a * S * n_0 - S * v - a * (K - T) * (b * u - a * v)),
    equal(by_b, -b * S * n_0 + S * u - b * (K - T) * (b * u - a * v)),
    text="Its derivatives, as turns and in components; no quotient is left but S, K and T.",
).prove(given=in_frame)

# %% [markdown]
# ## Two branches
#
# A machine tool carries the tool from its bed by some joints and the workpiece by others. Each branch is a chain of
# its own, and the tool is seen from the workpiece at $T_w^{-1}\,T_t\,\vec p$. So a target goes to the bed as in a
# chain, and then through the joints of the workpiece from the bed outwards, each backwards:
# $\vec x\leftarrow J^{-1}D^{-1}\vec x$, with $D\vec x=\vec P+E(\vec x-\vec P)+\vec s$.


# %%
def undone(v: sp.Basic) -> sp.Basic:
    """What a rotary joint of the opposite axis does to a point."""
    return P + turned(v - P, axis=-n)


J_undone = d.letter(
    r"J_undone[3] | J_{-\vec n}\,J\vec x | a turned point, turned about −n | length", undone(turn(x))
)
L_undone = d.letter(
    r"L_undone[3] | J_{s,-\vec n}\,J_s\vec x | a slid point, slid along −n | length", slide(x) + q * -n
)
d.check(
    "joint-backwards",
    equal(J_undone, x),
    equal(L_undone, x),
    text="A joint backwards is the joint with the opposite axis. So ideal branches are one chain from the workpiece to "
    "the tool, in which the joints that carry the workpiece come first, the last one of them before the others, "
    "and have the axes −n. An error of the reading is a turn or slide of its own (parts-of-a-reading): of one sign in "
    "both.",
).prove(modulo=unit)

# %%
D_undone = d.letter(
    r"D_undone | D^{-1}D\vec x | x, moved by an error motion and back | length",
    P + E.T * (P + E * (x - P) + s - s - P),
)
W_transposed = d.letter(
    r"W_transposed | R(\vec w)^\top\vec x | x, turned by the transpose | length",
    (sp.Identity(3) + S * skew(w) + K * skew(w) * skew(w)).T * x,
)
d.check(
    "error-backwards",
    equal(D_undone, x),
    equal(W_transposed, by_vector(x, -w)),
    text="An error motion backwards: the translation first, then the turn by −w about the same point.",
).prove(given={S: S, K: K})

# %%
moved = d.letter(r"moved[3] | D\vec x | x, moved, in the program | length", motions.moved(SECOND, x, P, s, w))
moved_back = d.letter(
    r"moved_back[3] | D^{-1}\vec x | x, moved back, in the program | length",
    motions.moved_back(SECOND, x, P, s, w),
)
d.check(
    "error-motion",
    equal(moved, P + by_vector(x - P) + s),
    equal(moved_back, P + by_vector(x - s - P, -w)),
    text="These are the error motions that the program computes.",
).prove()

# %%
back = d.letter(r"back | J^{-1}D^{-1}\vec x | x, passed backwards | length", undone(P + E.T * (x - s - P)))
in_chain = d.letter(
    r"in_chain | D'J_{-\vec n}\,\vec x | "
    r"x in the chain: the joint with the opposite axis, then an error motion | length",
    P + turned(E.T * turned(undone(x) - P), axis=-n) - turned(E.T * s, axis=-n),
)
d.check(
    "error-in-a-branch",
    equal(back, in_chain),
    text="In the chain the same error motion would have to be D' with the rotation RᵀEᵀR and the translation −RᵀEᵀs: "
    "opposite, and turning with the table. The error of the table against what carries it is not the error of what the "
    "table sees; written in its branch, it is the former, as ISO 230-1 has it.",
).prove(given={E: E}, modulo=unit)

# %% [markdown]
# ## How each parameter moves the seen point
#
# A parameter of joint $j$ enters at one place of the chain. Everything to the left of it, the joint's error motion,
# the joints nearer to the base, the moves of the frame and the scale, carries the change like a direction: it turns
# it, and stretches it by $1+k$. So it is enough to know the change where it arises.
#
# | parameter | change where it arises | entry |
# | --- | --- | --- |
# | reading of a rotary joint | $\vec n\times(J\vec x-\vec P)$ | by-reading |
# | reading of a linear joint | $\vec n$ | by-slide |
# | tilt of a rotary axis | $\vec\omega\times(J\vec x-\vec P)-R(\vec\omega\times(\vec x-\vec P))$ | by-tilt |
# | tilt of a linear axis | $q\;\vec\omega\times\vec n$ | by-tilt |
# | offset of a point, $\vec\delta=\vec u$ or $\vec v$ | $\vec\delta-ER\,\vec\delta$ | by-point |
# | translation of an error motion | $\vec\delta$ | by-error-motion |
# | rotation vector of an error motion | $(L\vec\delta)\times E(J\vec x-\vec P)$ | by-error-motion |
# | target | $\vec\delta$, carried by all joints | carried-change |
# | target that is a direction | as the tilt of an axis | by-tilt-of-the-axis |
# | last turn of a target that is put on again, $R_r R_t$ | $L_r\vec\delta$, carried by all joints | by-error-motion |
# | its turn before that | $R_r L_t\vec\delta$, carried by all joints | carried-change |
# | drift or shift of the frame, $W$, $S$ | as an error motion about the origin | by-error-motion |
# | free frame, $B$ | $\vec\delta$; $R_B(\vec\delta\times\vec x)$ | by-frame |
# | scale of the instrument | the point that it multiplies | by-scale |
# | coefficient of refraction | $\vec\omega\times\vec y$ with $\vec\omega=\vec x\times\vec h/c$ | by-refraction |
#
# An axis tilts at the rate $\vec\omega=L\vec u$ or $L\vec v$. A parameter of a reading, a translation or a rotation
# vector comes with the slope of its effect's formula as a factor.

# %%
factor = d.symbol("factor", "k", "scale of the instrument", "1")
carried = slope(
    r"carried | \frac{d}{d\epsilon}(1+k)\,G(\vec x+\epsilon\vec\delta) | "
    r"derivative of a point that is carried and stretched, at ε = 0",
    (1 + factor) * (Q * (x + epsilon * change) + s),
    epsilon,
    0,
)
d.check(
    "carried-change",
    equal(carried, (1 + factor) * (Q * change)),
    equal(Q * cross(n, x - P), cross(Q * n, G_x - G_P)),
    text="A change is carried like a direction; and the motion n × (x − P) that a joint gives, carried, is the motion "
    "about the carried axis.",
).prove()

# %%
by_axis = d.letter(
    r"by_axis[3,3] | \frac{\partial J\vec x}{\partial\vec n} | "
    r"derivative of a turn by the components of the axis, as if they were free | length",
    sp.Matrix(d.value(turn(x))).jacobian(sp.Matrix(n.components)),
)
by_slide_axis = d.letter(
    r"by_slide_axis[3,3] | \frac{\partial J_s\vec x}{\partial\vec n} | "
    r"derivative of a slide by the components of the axis, as if they were free | length",
    sp.Matrix(d.value(slide(x))).jacobian(sp.Matrix(n.components)),
)
R_of_tilt = d.letter(
    r"R_of_tilt | R\bigl(\vec\omega\times(\vec x-\vec P)\bigr) | ω × (x − P), turned about n by q | length",
    turned(cross(omega, x - P)),
)
d.check(
    "by-tilt",
    equal(by_axis * cross(omega, n), cross(omega, J_x - P) - R_of_tilt),
    equal(by_slide_axis * cross(omega, n), q * cross(omega, n)),
    text="The axis turns at the rate ω. A rotary joint turns its result with it, minus its image of the turned "
    "arm; a linear joint swings its stroke. The left sides differentiate by the components of n as if they "
    "were free: so a program may add ε ∂n/∂a to the axis, though that is of unit length to first order only.",
).prove(modulo=unit)

# %%
translation = d.vector("translation", r"\vec t", "translation of an error motion", "length")
E_R_change = d.letter(
    r"E_R_change | ER\,\vec\delta | δ, turned by joint and error motion | length", E * turned(change)
)
by_point = slope(
    r"by_point | \frac{d}{d\epsilon}D_{\vec P+\epsilon\vec\delta}\,J_{\vec P+\epsilon\vec\delta}\,\vec x | "
    r"derivative by the point of a joint with an error motion, at ε = 0",
    (P + epsilon * change) + E * turned(x - P - epsilon * change) + translation,
    epsilon,
    0,
)
d.check(
    "by-point",
    equal(by_point, change - E_R_change),
    text="The point is the centre of the joint's turn and of its error motion: what turns about it moves by δ, less "
    "the turned δ.",
).prove()

# %%
D_x = d.letter(
    r"D_x | D\vec x | what an error motion makes of x, P + R(w)(x − P) + t | length",
    motions.moved(SECOND, x, P, translation, w),
)
by_t = slope(
    r"by_t | \frac{d}{d\epsilon}D_{\vec t+\epsilon\vec\delta}\,\vec x | "
    r"derivative of an error motion by its translation",
    P + by_vector(x - P) + translation + epsilon * change,
    epsilon,
)
by_D_w = slope_along(
    r"by_D_w | \frac{d}{d\epsilon}D_{\vec w+\epsilon\vec\delta}\,\vec x | "
    r"derivative of an error motion by its rotation vector, at ε = 0",
    P + by_vector(x - P) + translation,
    w,
    change,
)
d.check(
    "by-error-motion",
    equal(by_t, change),
    equal(by_D_w, cross(left * change, D_x - P - translation)),
    text="Where w and t are sums over several effects, each has its part of the change.",
).prove(
    equal(by_t, change),
    equal(by_D_w, by_w),
    equal(D_x - P - translation, W_z),
    d.entries["left-jacobian"],
    given={x: P + z},
    because="The translation adds its own change; the arm z = x − P is turned by w as any vector is.",
)

# %%
by_B = slope(
    r"by_B | \frac{d}{d\epsilon}\bigl(Q\,R(\epsilon\vec w)\,\vec x+\vec s+\epsilon\vec\delta\bigr) | "
    r"derivative of a free frame by a turn about machine axes and by its translation, at ε = 0",
    Q * small_turn + s + epsilon * change,
    epsilon,
    0,
)
d.check(
    "by-frame",
    equal(by_B, Q * cross(w, x) + change),
    text="The free frame may be anywhere: it is kept as a matrix, and changed by small turns about machine axes.",
).prove()

# %%
by_k = slope(
    r"by_k | \frac{\partial(1+k)\vec x}{\partial k} | derivative of a point by the scale of the instrument",
    (1 + factor) * x,
    factor,
)
origin = d.vector("origin", r"\vec o", "where distances are measured from", "length")
by_distance = d.letter(
    r"by_distance | \frac{d}{d\epsilon}\left|\vec x+\epsilon\vec\delta-\vec o\right| | "
    r"derivative of a distance, at ε = 0 | 1",
    sp.sqrt(sum(p**2 for p in d.value(x + epsilon * change - origin))).diff(epsilon).subs(epsilon, 0),
)
d.check(
    "by-scale",
    equal(by_k, x),
    equal(by_distance, dot(x - origin, change) / norm(x - origin)),
    text="The scale of the instrument; and of a distance the part of a change that lies along it.",
).prove()

# %% [markdown]
# ## Where an error motion enters
#
# In $D_jJ_j$ a point is first moved by the joint, then by its error: $D\vec x=\vec P+R(\vec w)(\vec x-\vec P)+\vec t$,
# with $\vec w$ and $\vec t$ along machine axes *at zero*, and all of that carried by the joints before. So the
# components are those that an instrument on the body that carries the joint sees: the fixed sensitive direction of ISO
# 230-7. Had it been put after the joint, $J_jD_j$, it would belong to the body that the joint moves, and with the
# same numbers differ:
#
# - at a rotary joint $\vec w$ and $\vec t$ would turn with it: a constant radial error would go round;
# - at a linear joint the centre of its rotation would travel along, and the stroke would not swing: the arm that makes
#   a displacement of an angular error (Abbe's offset) would lack $q\,\vec n$.

# %%
back_w = d.letter(r"back_w | R^{-1}\vec w | rotation vector, turned back by the joint | rad", turned(w, -q))
back_t = d.letter(
    r"back_t[3] | R^{-1}\vec t | translation, turned back by the joint | length", turned(translation, -q)
)
D_J_x = d.letter(
    r"D_J_x | D\,J\vec x | error motion before the joint | length", P + by_vector(turned(x - P)) + translation
)
J_D_x = d.letter(
    r"J_D_x | J\,D_{R^{-1}\vec w,\,R^{-1}\vec t}\;\vec x | error motion after the joint, turned back | length",
    turn(P + by_vector(x - P, back_w) + back_t),
)
d.check(
    "before-or-after-a-turn",
    equal(D_J_x, J_D_x),
    text="A motion before a rotary joint is one after it, with w and t turned back by the reading.",
).prove(given={S: S, K: K}, modulo=unit)

# %%
D_L_x = d.letter(
    r"D_L_x | D\,J_s\vec x | error motion before a slide | length", P + by_vector(slide(x) - P) + translation
)
L_D_x = d.letter(
    r"L_D_x | J_s\,D\vec x | error motion after a slide | length", slide(P + by_vector(x - P) + translation)
)
travelling = d.letter(
    r"travelling | \vec P-q\vec n | the fixed centre, as the moving body sees it | length", P - q * n
)
L_D_back = d.letter(
    r"L_D_back | J_s\,D_{\vec P-q\vec n}\,\vec x | error motion after a slide, about the fixed centre | length",
    slide(travelling + by_vector(x - travelling) + translation),
)
W_n = d.letter(r"W_n | R(\vec w)\,\vec n | the axis, turned by w | 1", by_vector(n))
d.check(
    "before-or-after-a-slide",
    equal(D_L_x, L_D_back),
    equal(D_L_x - L_D_x, q * (W_n - n)),
    text="Before a linear joint the error turns about a point that does not travel. After it, the same w and t about "
    "the same P would lack the swing of the stroke.",
).prove(given={S: S, K: K})

# %%
D_about = d.letter(
    r"D_about | D_{\vec P+\vec s}\,\vec x | error motion about another centre | length",
    (P + s) + E * (x - P - s) + translation,
)
d.check(
    "centre-of-an-error-motion",
    equal(D_about, P + E * (x - P) + (translation + s - E * s)),
    text="About another centre it is the same motion with another translation. So the tilt of a spindle, given for "
    "another height along its axis, implies a radial error as well: `point` fixes the height.",
).prove(given={E: E})

# %% [markdown]
# A *constant* error motion is a change of the geometry: of the joint and of everything beyond it. Not of the joint
# alone: `axis_tilt` and `axis_offset` leave the later joints and the targets where they are given at zero, and are
# therefore a constant error motion *and its inverse behind the joint*, $DJD^{-1}$.

# %%
D_P = d.letter(r"D_P | D\vec P | the joint's point after a constant error motion | length", P + translation)
E_D_x = d.letter(r"E_D_x | D\vec x | x after a constant error motion | length", P + E * (x - P) + translation)
E_D_J_x = d.letter(
    r"E_D_J_x[3] | D\,J\vec x | a constant error motion of a rotary joint | length",
    P + E * turned(x - P) + translation,
)
E_D_L_x = d.letter(
    r"E_D_L_x | D\,J_s\vec x | a constant error motion of a linear joint | length",
    P + E * (slide(x) - P) + translation,
)
J_E_D_x = d.letter(
    r"J_E_D_x | J_{E\vec n,\,D\vec P}\,D\vec x | what the moved joint makes of the moved x | length",
    P + translation + turned(E * (x - P), axis=E * n),
)
d.check(
    "constant-error-motion",
    equal(E_D_J_x, J_E_D_x),
    equal(E_D_L_x, E_D_x + q * (E * n)),
    equal(E_D_x - D_P, E * (x - P)),
    text="D J = J′ D, where J′ is the joint about D's image of its axis. Passed on from joint to joint, D moves the "
    "axes and points of this joint and of all later ones, and in the end the target.",
).prove(
    equal(E_D_x, E * x + (P + translation - E * P)),
    equal(D_P, E * P + (P + translation - E * P)),
    d.entries["carried-turn"],
    d.entries["carried-slide"],
    given={E: E},
    because="D is a rigid motion like any: these are carried-turn and carried-slide for Q = E and s = P + t − E P.",
)

# %%
ahead = d.letter(r"ahead | J(q+a)\,\vec x | the joint with a zero offset | length", turn(x, q + a))
by_offset = d.letter(
    r"by_offset | D_{a\vec n,\,0}\,J\vec x | an error motion about the joint's own axis | length",
    P + by_vector(turned(x - P), a * n),
)
d.check(
    "zero-offset",
    equal(by_offset, ahead),
    text="A constant rotation vector a n along the joint's own axis is its zero offset.",
).prove(given={S: sp.sin(a) / a, K: (1 - sp.cos(a)) / a**2}, modulo=unit)

# %% [markdown]
# ## What no reading can determine
#
# Move the whole machine by $G\vec x=Q\vec x+\vec s$: axes, points, targets and error motions. Each factor of the chain
# passes $G$ on to its left, $G\,D_1J_1\cdots D_nJ_n\,\vec p=D'_1J'_1\cdots D'_nJ'_n\,G\vec p$. A free frame takes it
# back. Where the frame and the axes are both free, six numbers therefore change no reading. That is gauge, no lack of
# data.

# %%
B = d.matrix("B", "R_B", "rotation of the free frame", "1", value=Letter("B", 3, 3).components)
t_B = d.vector("t_B", r"\vec t_B", "translation of the free frame", "length")
d.check(
    "gauge",
    equal((B * Q.T) * G_x + (t_B - B * Q.T * s), B * x + t_B),
    text="The frame B G⁻¹ sees the machine that was moved by G as B sees the machine.",
).prove(
    equal(Q.T * G_x - Q.T * s, x),
    d.entries["carried-turn"],
    d.entries["carried-slide"],
    d.entries["carried-vector"],
    because="Qᵀ takes back what Q does. x is what the chain makes of a target, and G x is what it makes of it when "
    "axes, points, targets, and the translations and rotation vectors of error motions are moved along.",
)

# %% [markdown]
# It ends where something does not move along. Effects that depend on gravity allow only those $G$ that keep its
# direction (`moment-in-the-pose`, below). An effect with components along fixed directions allows only the $G$ that
# keep these. Three more directions of that kind, by `parts-of-a-reading` and `slide-is-rigid`:
#
# - the zero offset of a first rotary joint, with a free frame: $B\,J_1(q+a)=\bigl(B\,J_1(a)\bigr)J_1(q)$;
# - the zero offset of a last rotary joint, with free targets:
#   $J_n(q+a)\,\vec p=J_n(q)\,\bigl(J_n(a)\,\vec p\,\bigr)$;
# - the place of a linear joint, unless an error motion turns about it.
#
# ## Directions
#
# An autocollimator, a telescope or a laser beam measures directions: unit vectors, on which only rotations act. The
# residual compares the seen direction $\vec y$ with the measured one, $\vec m$, on the plane that touches the sphere in
# $\vec m$, by stereographic projection: with $\vec e_1$ horizontal and $\vec e_2=\vec m\times\vec e_1$
#
# $$r_i=\frac{2\,\vec e_i\cdot(\vec m-\vec y)}{1+\vec m\cdot\vec y}.$$

# %%
m = d.vector("m", r"\vec m", "measured direction", "1")
y = d.vector("y", r"\vec y", "seen direction", "1")
e_1 = d.vector("e_1", r"\vec e_1", "unit vector perpendicular to m", "1")
e_2 = d.vector("e_2", r"\vec e_2", "unit vector perpendicular to m and to e₁", "1")
up = d.vector("up", r"\vec h", "direction of the zenith, against gravity", "1")
in_basis = {m: (0, 0, 1), e_1: (1, 0, 0), e_2: (0, 1, 0)}
seen_unit = {y.components[2]: dot(y, y) - 1}
res_1, res_2 = (
    d.letter(f"res_{i} | r_{i} | component {i} of the residual | 1", 2 * dot(e, m - y) / (1 + dot(m, y)))
    for i, e in ((1, e_1), (2, e_2))
)
residual_along = motions.stereographic(FORMULAS, m, y)
between = d.symbol("between", r"\psi", "angle between measured and seen direction", "rad")
d.check(
    "residual",
    equal(res_1, residual_along(e_1)),
    equal(res_1**2 + res_2**2, 4 * (1 - dot(m, y)) / (1 + dot(m, y))),
    equal((2 * sp.tan(between / 2)) ** 2, 4 * (1 - sp.cos(between)) / (1 + sp.cos(between))),
    text="The residual is 2 tan(ψ/2) long, of the angle ψ between the directions: with m · y = cos ψ both squares are "
    "the same. It is the angle but for ψ³/12, alike in all directions, and finite up to opposite ones.",
).prove(
    equal(res_1, residual_along(e_1)),
    equal(res_1**2 + res_2**2, 4 * (1 - dot(m, y)) / (1 + dot(m, y))),
    equal((2 * sp.tan(h)) ** 2, 4 * (1 - sp.cos(2 * h)) / (1 + sp.cos(2 * h))),
    given=in_basis,
    modulo=seen_unit,
    because="In the basis (e₁, e₂, m) both sides are identical for a unit vector y; scalar products do not depend on "
    "the basis. With ψ = 2h the last line is the double angle.",
)

# %%
d.check(
    "horizontal",
    equal(dot(cross(up, m), up), 0),
    equal(dot(cross(m, cross(up, m)), up), norm(up) ** 2 * norm(m) ** 2 - dot(up, m) ** 2),
    text="With e₁ along h × m the first component is horizontal; the second, along m × e₁, points up, as "
    "|h|²|m|² − (h · m)² is not negative.",
).prove()

# %%
y_rate = d.vector("y_rate", r"\dot{\vec y}", "change of the seen direction per unit of a parameter", "1")
by_direction = d.letter(
    r"by_direction | \dot r_1 | derivative of a component of the residual | 1",
    sum(d.value(res_1).diff(part) * rate for part, rate in zip(y, y_rate, strict=True)),
)
d.check(
    "by-direction",
    equal(by_direction, -(2 * dot(e_1, y_rate) + res_1 * dot(m, y_rate)) / (1 + dot(m, y))),
    text="Its derivative; where the model fits, y = m, it is −e₁ · ẏ.",
).prove(given=in_basis)

# %% [markdown]
# ### Refraction
#
# The air lifts a direction $\vec x$ at the zenith angle $\zeta$ towards the zenith $\vec h$ by $\alpha=a\tan\zeta$.
# With $c=\vec h\cdot\vec x=\cos\zeta$ and $\sigma=\sin\zeta$ that is
# $\vec y=\vec x\cos\alpha+(\vec h-c\,\vec x)\frac{\sin\alpha}\sigma$. At the zenith it is 0/0. But
# $\alpha=f\sigma$ with $f=a/c$, which has no singularity there: the lift is the rotation by the vector
# $f\,\vec x\times\vec h$. At the horizon the tangent is infinite, and the lift of real air is not: from $c=c_0$ on,
# 85° from the zenith, $1/c$ goes on as $2c_0/(c_0^2+c^2)$, with the same value and slope, up to $2/c_0$ at the horizon.
#
# A tube that bends under its weight droops by $a\sin\zeta$: $f=-a$. Lifts and droops add up to one $f$.

# %%
ray = d.vector("ray", r"\vec x", "a direction before it is lifted", "1")
cosine = d.symbol("cosine", "c", "cosine of the zenith angle", "1", value=dot(up, ray))
sine = d.symbol("sine", r"\sigma", "sine of the zenith angle", "1", value=norm(cross(ray, up)))
f = d.symbol("f", "f", "lift over the sine of the zenith angle", "rad")
coefficient = d.symbol("coefficient", "a", "coefficient of refraction", "rad")


def lift(alpha: sp.Expr) -> sp.Basic:
    """Lift the ray by an angle."""
    return sp.cos(alpha) * ray + sp.sin(alpha) / sine * (up - cosine * ray)


lifted = d.letter(r"lifted | \vec y | the ray, lifted by the angle fσ | 1", lift(f * sine))
lift_vector = d.letter(
    r"lift_vector | \vec w_a | rotation vector of the lift, f x × h | rad", f * cross(ray, up)
)
raised = {up: (0, 0, 1)}
computed_lift = d.letter(
    r"computed_lift | \vec y_\geq | the ray, lifted, in the program from α² = 1/4 on | 1",
    motions.lifted(replace(SECOND, sqrt=lambda known: f * sine), ray, up, cosine, f),
)
computed_small_lift = d.letter(
    r"computed_small_lift | \vec y_< | the ray, lifted, in the program below α² = 1/4 | 1",
    motions.lifted(replace(FIRST, sqrt=lambda known: f * sine), ray, up, cosine, f),
)
ray_unit = {ray.components[2]: dot(ray, ray) - 1}
d.check(
    "lift",
    equal(lifted, ray + S * cross(lift_vector, ray) + K * cross(lift_vector, cross(lift_vector, ray))),
    equal(norm(lift_vector) ** 2, f**2 * (norm(ray) ** 2 * norm(up) ** 2 - cosine**2)),
    equal(dot(up, lifted), cosine * sp.cos(f * sine) + sine * sp.sin(f * sine)),
    equal(f**2 * (1 - cosine**2), (f * sine) ** 2),
    equal(computed_lift, lifted),
    equal(computed_small_lift, (1 - square * K_8) * ray + f * S_8 * (up - cosine * ray)),
    text="The lift is the rotation by the vector f x × h: S and K of f²σ² = f²(1 − c²) are smooth at the zenith, and "
    "no root is taken of a difference. The zenith angle falls by α: its cosine becomes cos(ζ − α). The program has it "
    "so, with the series of S and K where α is small.",
    assumptions=[equal(norm(ray), 1), equal(norm(up), 1)],
).prove(given={**raised, phi: f * sine, square: f**2 * (1 - cosine**2)}, modulo=ray_unit)

# %%
by_refraction = slope(
    r"by_refraction | \frac{\partial\vec y}{\partial a} | derivative of the lifted direction by the coefficient",
    lift(coefficient / cosine * sine),
    coefficient,
)
lift_rate = d.letter(r"lift_rate | \vec\omega_a | rate of the turn, x × h / c | 1", cross(ray, up) / cosine)
d.check(
    "by-refraction",
    equal(by_refraction, cross(lift_rate, lifted)),
    equal(by_refraction, (sp.cos(f * sine) * (up - cosine * ray) - sine * sp.sin(f * sine) * ray) / cosine),
    text="The direction turns about its own fixed axis, by tan ζ per unit of a: not at all at the zenith.",
).prove(given={**raised, f: coefficient / cosine}, modulo=ray_unit)

# %%
low = d.letter("low | c_0 | cosine of the zenith angle from which on the lift is less than the tangent | 1")
above = d.symbol("above", "c_1", "cosine of a zenith angle beyond", "1")
beyond = d.symbol("beyond", "d_c", "1/c beyond", "1", value=2 * low / (low**2 + above**2))
beyond_slope = d.symbol("beyond_slope", "d_c'", "its slope by c", "1", value=sp.diff(d.value(beyond), above))
d.check(
    "finite-lift",
    equal(beyond, 1 / low),
    equal(beyond_slope, -1 / low**2),
    text="Beyond 85° the lift goes on with the value and the slope of the tangent.",
    assumptions=[equal(above, low)],
).prove(given={above: low})

# %%
d.check(
    "air",
    equal(1 / motions.air_depth(FIRST, cosine), 1 / cosine),
    equal(1 / motions.air_depth(SECOND, above), beyond),
    text="The function computes both cases, with $c_0=0.087$.",
).prove(given={low: sp.Rational(motions.TANGENT_TO)})

# %% [markdown]
# ### Flexures in hour angle and declination
#
# An equatorial mount turns by the hour angle $H$, westward about the pole $\vec p$, and by the declination $\delta$
# about an axis that points west on the meridian, $\vec e_H$. In axes along the meridian at the equator, west, and the
# pole, a direction is $(\cos\delta\cos H,\cos\delta\sin H,\sin\delta)$, and the zenith
# $(\cos\varphi_0,0,\sin\varphi_0)$ with the latitude $\varphi_0$. (These axes are left-handed; each expression below
# has an even number of vector products, and is the same in both.) Three parts bend: the tube; the shaft of the
# declination axis, which turns by $a\,\vec e_H\times\vec g$; a fork along the polar axis, which turns the declination
# axis about itself by $a\,\vec e_H\cdot(\vec p\times\vec g)$.

# %%
hour = d.symbol("hour", "H", "hour angle, westward", "rad")
declination = d.symbol("declination", r"\delta", "declination", "rad")
latitude = d.symbol("latitude", r"\varphi_0", "latitude of the telescope", "rad")
cos_h, sin_h = sp.cos(hour), sp.sin(hour)
cos_d, sin_d = sp.cos(declination), sp.sin(declination)
cos_l, sin_l = sp.cos(latitude), sp.sin(latitude)
star = d.letter(r"star | \vec s | a direction | 1", sp.Matrix([cos_d * cos_h, cos_d * sin_h, sin_d]))
zenith = d.letter(r"zenith | \vec h_0 | the zenith | 1", sp.Matrix([cos_l, 0, sin_l]))
pole = d.letter(r"pole | \vec p | the pole | 1", sp.Matrix([0, 0, 1]))
west = d.letter(
    r"west | \vec e_H | west of the direction: the declination axis | 1", sp.Matrix([-sin_h, cos_h, 0])
)
north = d.letter(
    r"north | \vec e_\delta | north of the direction | 1", sp.Matrix([-sin_d * cos_h, -sin_d * sin_h, cos_d])
)
fork = motions.fork_bend(SECOND, west, pole, -zenith)
droop = cos_l * sin_h * west + (cos_l * cos_h * sin_d - sin_l * cos_d) * north
d.check(
    "flexures",
    equal(dot(star, zenith) * star - zenith, droop),
    equal(
        cross(motions.shaft_bend(FORMULAS, west, -zenith), star),
        (cos_l * cos_h * cos_d + sin_l * sin_d) * west,
    ),
    equal(fork * cross(west, star), cos_l * cos_h * north),
    equal(motions.fork_bend(FIRST, west, -pole, -zenith), fork),
    text="Per unit of a: the tube droops by TPOINT's TF; the shaft of the declination axis leans by −DAF, to the "
    "west by the cosine of the zenith angle; the fork by FO = a cos φ₀, whichever way the axis is named on which it "
    "stands. West on the sky is cos δ times the hour angle.",
).prove()

# %% [markdown]
# ## Attitudes
#
# A camera or a tracker with six freedoms reads where a body is and how it is turned. The axes $\vec m_i$ of the body
# as predicted, the columns of any rotation, are compared with those that were measured, $\vec r_i$. The residual is
# the Rodrigues vector $\vec\theta$ that turns the first to the second,
#
# $$\vec\theta=\frac{2\sum_i\vec m_i\times\vec r_i}{1+\sum_i\vec m_i\cdot\vec r_i}:$$
#
# $2\tan(\psi/2)$ long, of the angle $\psi$ between both, as the residual of a direction; finite up to half a turn, and
# along the axis about which the body is turned, in the axes of the measuring frame. There is no branch, and no
# notation of attitudes whose poles it would inherit.

# %%
m_i = [sp.ImmutableMatrix(d.value(Q)[:, i]) for i in range(3)]
r_i = [turned(column, 2 * h, sp.Matrix(n.components)) for column in m_i]
both_sums = motions.quaternion_between(FORMULAS, m_i, r_i)
across_axes = d.letter(
    r"across_axes | \sum_i\vec m_i\times\vec r_i | "
    r"sum of the products of predicted axes and these turned by 2h about n | 1",
    both_sums[0],
)
along_axes = d.letter(
    r"along_axes | 1+\sum_i\vec m_i\cdot\vec r_i | 1 and the sum of the scalar products of the same axes | 1",
    both_sums[1],
)
d.check(
    "attitude-residual",
    equal(across_axes, 2 * sp.sin(2 * h) * n),
    equal(along_axes, 2 + 2 * sp.cos(2 * h)),
    equal(4 * sp.sin(2 * h) / (2 + 2 * sp.cos(2 * h)), 2 * sp.tan(h)),
    text="Of axes that were turned by 2h about n, the quotient of twice the first sum by the second is "
    "2 tan(h) n, the Rodrigues vector of that turn, whatever the attitude is.",
).prove(modulo=unit)

# %%
turned_axes = slope(
    r"turned_axes | \frac{\partial\vec\theta}{\partial\epsilon} | "
    r"derivative of the residual, at zero, when the prediction turns by ε ω",
    motions.rodrigues_between(
        FORMULAS,
        [motions.turned_a_little(FORMULAS, m, epsilon * sp.Matrix(omega.components)) for m in m_i],
        m_i,
    ),
    epsilon,
    0,
)
d.check(
    "attitude-slope",
    equal(turned_axes, -omega),
    text="Where the prediction meets the reading, a small turn of the prediction by the rotation vector ω changes the "
    "residual by −ω: to first order it is the rotation vector itself.",
).prove()

# %% [markdown]
# An encoder, an autocollimator or an inclinometer reads the angle $\alpha$ of a body about one axis $\vec e$ only. Of a
# turn by $2h$ about $\vec n$ that is the *twist* $\varphi$: with the unit quaternion $(\cos h,\sin h\,\vec n)$ it has
# $\tan(\varphi/2)=\tan h\;\vec n\cdot\vec e$, and for axes $\vec m_i$ that were $\vec e_i$ at zero the two sums above
# are $4\cos h$ times the quaternion. The residual has no branch either, and whole turns do not count.

# %%
alpha = d.symbol("alpha", r"\alpha/2", "half of the angle that was read", "rad")
half_twist = d.symbol("half_twist", r"\varphi/2", "half of the predicted twist", "rad")
d.check(
    "angle-residual",
    equal(2 * sp.sin(2 * h), 4 * sp.cos(h) * sp.sin(h)),
    equal(2 + 2 * sp.cos(2 * h), 4 * sp.cos(h) ** 2),
    equal(motions.angle_between(*circle(half_twist), *circle(alpha)), 2 * sp.tan(alpha - half_twist)),
    text="The sums are 4 cos h times sin h n and cos h. From cosines and sines of the half angles, by any common "
    "factor, the residual is 2 tan of half of what the reading is beyond the prediction.",
).prove()

# %%
line = d.vector("line", r"\vec e", "unit vector about which angles are read", "1")
unit_axes = [sp.eye(3)[:, i] for i in range(3)]
turned_units = [turned(column, 2 * h, sp.Matrix(n.components)) for column in unit_axes]
near, far = (
    [
        d.letter(f"{part}_{name} | {part[0]}_{name[0]} | as {part} of half the twist, {where} | 1", value)
        for part, value in zip(
            ("sine", "cosine"),
            motions.half_twist(case, sp.Matrix(line.components), unit_axes, turned_units),
            strict=True,
        )
    ]
    for name, where, case in (
        ("near", "up to a quarter turn", FIRST),
        ("far", "beyond", SECOND),
    )
)
d.check(
    "half-twist",
    *(equal(s * sp.cos(h), c * sp.sin(h) * dot(n, line)) for s, c in (near, far)),
    text="Of a body that was turned by 2h about n, the two numbers are as sine and cosine of half of its twist about e "
    "in both cases.",
).prove(modulo={**unit, line.components[2]: dot(line, line) - 1})

# %% [markdown]
# An inclinometer reads how a line $\vec x$ of the body rises over the horizon: by the angle $\varphi$ with
# $\sin\varphi=\vec h\cdot\vec x$ and $\cos\varphi=|\vec h\times\vec x|$.

# %%
rise, level = motions.half_tilt(replace(FORMULAS, sqrt=lambda known: sp.cos(2 * h)), up, ray)
d.check(
    "inclination",
    equal(dot(up, ray) ** 2 + dot(cross(up, ray), cross(up, ray)), norm(up) ** 2 * norm(ray) ** 2),
    equal(rise, dot(up, ray)),
    equal(sp.sin(2 * h) * sp.cos(h), level * sp.sin(h)),
    text="With φ = 2h, sin φ and 1 + cos φ are as sine and cosine of half the angle.",
).prove()

# %% [markdown]
# ## Gravity
#
# What is not balanced winds up drives and bends beams. The pose is the ideal one: $\vec r=\vec c-\vec P$ leads from the
# joint's point to the mean of the targets, carried by the joint and those beyond; $\vec g$ is gravity's direction,
# carried *back* by the joints before. Then everything is given in the axes at zero of the body that carries the joint,
# as its error motion is.

# %%
g = d.vector("g", r"\vec g", "direction of gravity in that body", "1")
arm = d.vector("arm", r"\vec r", "from the joint's point to the mean of the targets", "length")
moment = d.letter(
    r"moment[3] | \vec M | moment of a unit force along g | length", motions.moment(FORMULAS, arm, g)
)
rate = motions.moment_rate(FORMULAS, n, g)
M = d.symbol("M", "M", "part of the moment about the axis", "length", value=dot(n, moment))
quarter = d.letter(
    r"quarter[3] | \vec r_\perp | the arm, turned by 90° about the axis | length",
    cross(n, arm) + dot(n, arm) * n,
)
M_perp = d.letter(
    r"M_perp | M_\perp | part about the axis of the moment with the turned arm | length",
    dot(n, cross(quarter, g)),
)
across = d.letter(
    r"across[3] | \vec M_a | part of the moment across the axis | length", motions.across(moment, n, M)
)
R_arm = d.letter(r"R_arm | R\,\vec r | the arm, turned by q about the axis | length", turned(arm))
d.check(
    "moment-in-the-pose",
    equal(cross(Q * arm, Q * g), Q * moment),
    equal(dot(Q * n, cross(Q * arm, Q * g)), M),
    text="In the pose the carrying body is turned by Q: arm, gravity and axis are Qr, Qg and Qn. The moment about the "
    "axis is the same, the moment vector is carried.",
).prove()

# %%
d.check(
    "moment-about-the-axis",
    equal(dot(n, cross(arm + along * n, g)), M),
    equal(dot(cross(n, arm), g), M),
    equal(motions.moment_about(FORMULAS, rate, arm), M),
    text="M does not depend on which point of the axis is taken. And it is how fast the load comes down as the joint "
    "turns: a joint that gives way to its load has a positive coefficient.",
).prove()

# %%
d.check(
    "moment-turned",
    equal(quarter, R_arm),
    equal(M_perp, dot(n, arm) * dot(n, g) - dot(arm, g)),
    equal(M_perp, motions.moment_turned(FORMULAS, n, rate, arm)),
    text="For q = 90° the turned arm is that of M⊥; and M⊥ is, with the minus sign, the scalar product of the parts of "
    "arm and gravity that lie across the axis.",
).prove(given={q: sp.pi / 2}, modulo=unit)

# %%
d.check(
    "moment-by-reading",
    equal(dot(n, cross(R_arm, g)), M * sp.cos(q) + M_perp * sp.sin(q)),
    text="As the joint turns, M and M⊥ are cosine and sine of one wave: k M + k₂ M⊥ has any amplitude and phase. Where "
    "the joints before do not turn gravity and those beyond do not move the load, that is a cos q + b sin q, and "
    "it cannot be distinguished from an eccentric encoder.",
).prove(modulo=unit)

# %%
weight_arm = d.vector("weight_arm", r"\vec s", "from the joint's point to a weight of its own link", "length")
link_arm = d.vector("link_arm", r"\vec l", "from the joint's point to the point of the next joint", "length")
M_s, M_l, M_l_perp = (dot(n, cross(a, g)) for a in (weight_arm, link_arm, cross(n, link_arm)))
across_l = cross(n, link_arm)
d.check(
    "weight-of-the-own-link",
    equal(
        dot(across_l, across_l) * M_s,
        dot(across_l, cross(n, weight_arm)) * M_l + dot(n, cross(link_arm, weight_arm)) * M_l_perp,
    ),
    text="A link's centre of mass has two coordinates across the axis. So wherever it is, the moment of its "
    "weight is that of one at the point of the next joint and one there after a quarter turn, `k_NAME` and `k2_NAME`.",
).prove(modulo=unit)

# %% [markdown]
# The weights of later links act at the points $\vec P_k$ of later joints. Here a rotary joint carries a linear one, and
# that another rotary one.

# %%
points = [d.vector(f"P_{k}", rf"\vec P_{k}", f"point of joint {k}", "length") for k in (2, 3, 4)]
n_s = d.vector("n_s", r"\vec n_2", "unit vector along the linear joint", "1")
n_t = d.vector("n_t", r"\vec n_3", "unit vector of the axis of the second rotary joint", "1")
slid_by = d.symbol("slid_by", "q_2'", "coordinate of the linear joint", "length")
turned_by = d.symbol("turned_by", "q_3'", "coordinate of the second rotary joint", "rad")
links = [
    motions.Link(n, circle(q), q, P, points[0]),
    motions.Link(n_s, None, slid_by, points[0], points[1]),
    motions.Link(n_t, circle(turned_by), turned_by, points[1], points[2]),
]
at_last = motions.turned_about(FORMULAS, points[2], n_t, points[1], circle(turned_by))
places = [
    turn(points[0]),
    turn(motions.slid(points[1], n_s, slid_by)),
    turn(motions.slid(at_last, n_s, slid_by)),
]
link_arm = places[0] - P
moments = [*(place - P for place in places), cross(n, link_arm) + dot(n, link_arm) * n]
d.check(
    "weights",
    *(
        equal(computed, dot(n, cross(arm, g)))
        for computed, arm in zip(motions.moments_of_weights(FORMULAS, n, rate, links), moments, strict=True)
    ),
    text="The moments about the first axis of unit forces at these points, and of one at the first of them after a "
    "quarter turn, computed from joint to joint outwards.",
).prove(modulo=unit)

# %%
guided = motions.moment(FORMULAS, arm - q * n, g)
guide = d.letter(
    r"guide[3] | \vec M_g | moment about P + q n, across the axis | length",
    motions.across(guided, n, dot(n, guided)),
)
d.check(
    "moment-across",
    equal(dot(n, across), 0),
    equal(across, cross(n, cross(moment, n))),
    equal(guide, across - q * cross(n, g)),
    text="The part across the axis; and that of a carriage, about where it has got to.",
).prove(modulo=unit)

# %% [markdown]
# ### A beam that sags
#
# The load $\vec c_0$ on a beam drops along gravity by $\delta$, and turns by the slope $\beta$ about
# $\vec n\times\vec g$. As an error motion about $\vec P$ that is $\vec w=\beta\,\vec n\times\vec g$ and
# $\vec t=\delta\,\vec g+(\vec c_0-\vec P)-R(\vec w)(\vec c_0-\vec P)$.

# %%
c_0 = d.vector("c_0", r"\vec c_0", "the load, carried by this joint alone", "length")
drop = d.symbol("drop", r"\delta", "by how much the load drops", "length")
E_2 = d.matrix("E_2", "E_2", "rotation of all error motions of the joint", "1", value=any_rotation("E_2"))
t_sag = d.letter(r"t_sag | \vec t_s | translation of the sag | length", drop * g + (c_0 - P) - E * (c_0 - P))
t_computed = d.letter(
    r"t_computed | \vec t_s(\vec w) | translation of the sag in the program | length",
    motions.sag_shift(SECOND, c_0 - P, g, drop, w),
)
d.check(
    "sag",
    equal(P + E * (c_0 - P) + t_sag, c_0 + drop * g),
    equal(P + E * (x - P) + t_sag, (c_0 + drop * g) + E * (x - c_0)),
    equal(P + E_2 * (c_0 - P) + t_sag, (c_0 + drop * g) + (E_2 - E) * (c_0 - P)),
    equal(t_computed, drop * g + (c_0 - P) - by_vector(c_0 - P)),
    text="The load is where it has dropped to, and all else turns about it. With other rotations at the same joint the "
    "sum of all rotation vectors acts, E₂, and they carry the load on.",
).prove(given={E: E, E_2: E_2})

# %%
d.check(
    "sag-turns-down",
    equal(cross(motions.sag_turn(FORMULAS, n, g, 1), n), g - dot(n, g) * n),
    text="The beam turns towards gravity: with a positive slope its end goes down. On an inclined axis the turn is "
    "smaller the steeper it is; the drop stays along g.",
).prove(modulo=unit)

# %% [markdown]
# How drop and slope are related follows from the beam equation; the derivation `effects` has it, with the other
# formulas of the catalogue.

# %% [markdown]
# ## The functions of the package
#
# Two steps are the same in every machine, and are also needed outside its own program, where its geometry is set
# up: the matrix of a rotation vector with its left Jacobian, and a tilted axis with its derivatives. Both are smooth
# at zero, where every fit starts.


# %%
def coefficients(k: KernelBuilder, w: sp.Matrix) -> tuple[sp.Symbol, sp.Symbol, sp.Symbol]:
    """S, K and T of a rotation vector."""
    square = k.let("square", w.dot(w))
    is_small = k.let("is_small", square < motions.SERIES_BELOW)
    safe = k.let("safe", select(is_small, sp.S.One, square))
    angle = k.let("angle", sp.sqrt(safe))
    half_angle = k.let("half_angle", angle / 2)
    sine, half_sine = k.let("sine", sp.sin(angle)), k.let("half_sine", sp.sin(half_angle))
    quotients = sine / angle, 2 * (half_sine / angle) ** 2, (angle - sine) / (angle * safe)
    return tuple(
        k.let(name, select(is_small, motions.series(square, first), quotient))
        for first, (name, quotient) in enumerate(zip(COEFFICIENTS, quotients, strict=True), start=1)
    )


def rotation_from_vector():
    k = KernelBuilder(
        "rotation_from_vector",
        summary="Matrix of the rotation by a rotation vector, and its left Jacobian.",
        source="derivation machine_model, entries vector-is-eq-1 and left-jacobian",
        notes="R(w + dw) = R(L dw) R(w) to first order. Smooth at zero.",
    )
    w = k.input("w", 3, unit="rad", doc="rotation vector")
    S, K, T = coefficients(k, w)
    turn = skew(w)
    k.output("matrix", sp.eye(3) + S * turn + K * turn**2, unit="1", doc="rotation matrix R")
    k.output("left_jacobian", sp.eye(3) + K * turn + T * turn**2, unit="1", doc="left Jacobian L")
    return k.build()


def tilted_axis():
    k = KernelBuilder(
        "tilted_axis",
        summary="An axis, turned by the rotation vector a u + b v, and its derivatives by a and b.",
        source="derivation machine_model, entries tilted-axis and by-tilt-of-the-axis",
        notes="u and v are meant to complete the axis to a right-handed basis; the turn is exact for any.",
    )
    axis, u, v = (
        k.input(name, 3, unit="1", doc=doc)
        for name, doc in (
            ("axis", "unit vector"),
            ("u", "unit vector square to it"),
            ("v", "axis x u"),
        )
    )
    tilt = k.input("tilt", 2, unit="rad", doc="a and b")
    w = k.let("w", tilt[0] * u + tilt[1] * v)
    S, K, T = coefficients(k, w)
    across = k.let("across", w.cross(axis))
    turned_axis = k.let("turned_axis", axis + S * across + K * w.cross(across))
    k.output("tilted", turned_axis, unit="1", doc="the tilted axis")
    slopes = []
    for name, side in (("a", u), ("b", v)):
        beside = k.let(f"beside_{name}", w.cross(side))
        slopes.append((side + K * beside + T * w.cross(beside)).cross(turned_axis))
    slopes = sp.Matrix.hstack(*slopes)
    k.output("tilted_jacobian", slopes, unit="1/rad", doc="derivative of tilted; last axis: a, b")
    return k.build()


rotation, tilting = rotation_from_vector(), tilted_axis()

# %% [markdown]
# They compute what was proved: in terms of $S$, $K$ and $T$, and these on both sides of the case distinction.

# %%
kept = [rotation[c] for c in COEFFICIENTS]
kernel_matrix, kernel_left = (
    d.matrix(name, latex, quantity, "1", value=rotation.expand(output, keep=kept))
    for name, latex, quantity, output in (
        ("kernel_matrix", "R_k", "matrix that rotation_from_vector computes", "matrix"),
        ("kernel_left", "L_k", "left Jacobian that rotation_from_vector computes", "left_jacobian"),
    )
)
in_kernel = dict(zip((S, K, T), kept, strict=True))
d.check(
    "kernel-rotation",
    equal(kernel_matrix * x, W_x),
    equal(kernel_left, left),
    text="The matrices of `rotation_from_vector` are the rotation by $\\vec w$ and its left Jacobian.",
).prove(
    equal(kernel_matrix * x, W_x),
    equal(kernel_left, sp.Identity(3) + K * skew(w) + T * skew(w) * skew(w)),
    given=in_kernel,
    because="Both sides are identical, for any S, K, T.",
)

# %%
of_tilt = tilting.substitution(tilt=(a, b), axis=list(n_0))
kept = [tilting[c] for c in COEFFICIENTS]
kernel_axis = d.letter(
    r"kernel_axis | \vec n_k | axis that tilted_axis computes | 1",
    tilting.expand("tilted", keep=kept).subs(of_tilt),
)
slopes = tilting.expand("tilted_jacobian", keep=kept).subs(of_tilt)
kernel_by_a = d.letter(
    r"kernel_by_a | \vec n_{k,a} | derivative by a that tilted_axis computes | 1/rad", slopes[:, 0]
)
kernel_by_b = d.letter(
    r"kernel_by_b | \vec n_{k,b} | derivative by b that tilted_axis computes | 1/rad", slopes[:, 1]
)
d.check(
    "kernel-tilted",
    equal(kernel_axis, tilted),
    equal(kernel_by_a, cross(left * u, tilted)),
    equal(kernel_by_b, cross(left * v, tilted)),
    text="The axis of `tilted_axis` and its derivatives are those of above, for any $\\vec u$, $\\vec v$ and "
    "$\\vec n_0$.",
).prove(given={**tilt, **in_kernel})

# %%
both = (rotation, tilting)
steps = ("is_small", "square", "safe", "angle")
kernel_large = d.letter(
    r"kernel_large[3,2] | \kappa_{\varphi^2\geq1/4} | S, K and T of both functions from φ² = 1/4 | 1",
    sp.Matrix(
        [
            [k.expand(k[c], keep=[k[n] for n in steps]).subs(k["is_small"], sp.false) for k in both]
            for c in COEFFICIENTS
        ]
    ),
)
kernel_small = d.letter(
    r"kernel_small[3,2] | \kappa_{\varphi^2<1/4} | S, K and T of both functions below φ² = 1/4 | 1",
    sp.Matrix(
        [
            [k.expand(k[c], keep=[k[n] for n in steps]).subs(k["is_small"], sp.true) for k in both]
            for c in COEFFICIENTS
        ]
    ),
)
kernel_square = d.letter(
    r"kernel_square | \varphi_k^2 | square of the angle in both functions | rad²",
    rotation.expand(rotation["square"]),
)
kernel_angle = d.letter(
    r"kernel_angle | \varphi_k | angle in both functions from φ² = 1/4 on | rad",
    rotation.expand(rotation["angle"], keep=[rotation["is_small"]]).subs(rotation["is_small"], sp.false),
)
quotients = sp.ImmutableMatrix([[c, c] for c in (S, K, T)])
sums = sp.ImmutableMatrix([[c, c] for c in (S_8, K_8, T_8)])
in_half = rotation.substitution(angle=2 * h, safe=(2 * h) ** 2)
d.check(
    "kernel-coefficients",
    equal(kernel_square, norm(w) ** 2),
    equal(kernel_angle, phi),
    equal(kernel_large, quotients),
    equal(kernel_small, sums),
    text="Both functions compute $S$, $K$ and $T$ from the length of the rotation vector, and below $\\varphi^2=1/4$ "
    "by the series.",
).prove(
    equal(kernel_square, norm(w) ** 2),
    equal(kernel_angle**2, kernel_square),
    equal(
        sp.ImmutableMatrix(d.value(kernel_large).subs(in_half)),
        sp.ImmutableMatrix(d.value(quotients, {phi: 2 * h})),
    ),
    equal(kernel_small, sums),
    because="The squares of the angles agree, and angles are not negative; with φ = 2h the quotients are identical by "
    "the double angle, and so are the sums.",
)

# %%
derivation.kernel(rotation, tilting)

# %% [markdown]
# ## Accuracy
#
# The largest error of an entry of the left Jacobian, in units of $\varepsilon$, for rotation vectors of all sizes:
# of the kernel, and of the quotients without series and half angle. At zero, where a fit starts, the quotients are not
# defined, and for the errors of a machine, some $10^{-8}$ to $10^{-3}$ rad, they lose up to half of the digits.

# %%
if in_notebook():
    from rodgen.derivation.figures import machine_model as figures
    from rodgen.derivation.figures import show
    from rodgen.generated.numpy import machine_model as generated

    show(figures.accuracy(lambda vectors: generated.rotation_from_vector(vectors)[1]))
