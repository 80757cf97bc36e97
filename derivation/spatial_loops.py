# %% [markdown]
# # Closed spatial loops of groups 1 and 2: RCCC and RRRCC
#
# A closed loop of links has one driven joint with a given angle. Which angles and offsets of the other joints close it?
# This notebook derives the equations for two loops of Crane and Duffy, named by their joints (R revolute, C cylindric,
# which both turns and slides), and then for every loop with four unknown angles and two unknown offsets:
#
# - the RCCC loop (group 1): one equation in one angle, two solutions; everything else follows linearly;
# - the RRRCC loop (group 2): two equations in two angles, up to eight solutions;
# - any other order of the joints of group 2: the same kind of pair.
#
# A loop of $n$ joints is closed when the transforms along it multiply to the unit matrix. With
# $Z_j=T_z(S_j)R_z(\theta_j)$ for a joint, a shift along $z$ and a rotation about it, and
# $X_{jk}=T_x(a_{jk})R_x(\alpha_{jk})$ for a link, the same along $x$,
#
# $$ Z_1X_{12}Z_2X_{23}\cdots Z_nX_{n1}=1 . $$
#
# Cut at two places it says that two chains, $A$ with the known angle and the inverse of the rest, $B$, are one
# transform: $A=B$. Every equation here is an entry of $A-B$, or of $A^{-1}-B^{-1}$, and is proved as such. Crane and
# Duffy name three ways to them: to *project* the vector loop on a direction in which unknown offsets vanish, to take
# the
# *self-scalar product* of a part of it, and the *secondary cosine laws*, which follow from spherical laws with dual
# angles $\theta+\varepsilon S$ and $\alpha+\varepsilon a$ ($\varepsilon^2=0$). For the RRRCC loop the first and the
# third are the same equation.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.polygon_notation import chain_value
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    Dual,
    coordinate_rotation,
    cross,
    dot,
    dual_value,
    equal,
    inverse_transform,
    rot,
    select,
    transform,
)

d = derivation = Derivation(
    "spatial_loops",
    title="Closed spatial loops: the group 1 and group 2 solution processes",
    source='Crane and Duffy, "Kinematic Analysis of Robot Manipulators", as in the lecture notes "Robot Geometry"',
)
im = sp.ImmutableMatrix

# %% [markdown]
# ## Symbols
#
# Joint $j$ has the angle $\theta_j$ and the offset $S_j$, link $ij$ the twist $\alpha_{ij}$ and the length $a_{ij}$.
# $\vec S_j$ is the direction of axis $j$, $\vec a_{ij}$ that of link $ij$. For the rotation of a chain there are the
# short names of spherical polygons (derived in the notebook `spherical_polygons`): for the joints $i\ldots j$ the
# numbers $X_{i\ldots j}$, $Y_{i\ldots j}$ and $Z_{i\ldots j}$ are, up to signs, the last row of the product of the
# rotations, and $X^*$ is $X$ with sine and cosine of the last joint exchanged.

# %%
theta = {j: d.symbol(f"theta_{j}", rf"\theta_{j}", f"angle of joint {j}", "rad") for j in range(1, 6)}
S = {j: d.symbol(f"S_{j}", f"S_{j}", f"offset of joint {j}", "length") for j in range(1, 6)}
links = ("12", "23", "34", "41", "45", "51")
alpha = {e: d.symbol(f"alpha_{e}", rf"\alpha_{{{e}}}", f"twist of link {e}", "rad") for e in links}
a = {e: d.symbol(f"a_{e}", f"a_{{{e}}}", f"length of link {e}", "length") for e in links}
d


# %%
def c(j):
    return sp.cos(theta[j] if isinstance(j, int) else alpha[j])


def s(j):
    return sp.sin(theta[j] if isinstance(j, int) else alpha[j])


def Z(j):
    """Transform of joint j."""
    return transform(coordinate_rotation("z", c(j), s(j)), [0, 0, S[j]])


def X(e):
    """Transform of link e."""
    return transform(coordinate_rotation("x", c(e), s(e)), [a[e], 0, 0])


def chain(*parts):
    product = sp.eye(4)
    for part in parts:
        product = product * (X(part) if isinstance(part, str) else Z(part))
    return product.applyfunc(sp.expand)


def secondary(expr):
    """Secondary part of a spherical law when every angle is dual: the angle θ + ε S of a joint, α + ε a of a link."""
    dual = {theta[j]: Dual(theta[j], S[j]) for j in theta} | {alpha[e]: Dual(alpha[e], a[e]) for e in links}
    return dual_value(expr, dual).secondary


class Notation:
    """X, X*, Y and Z of a chain of links and joints, near twist first."""

    def __init__(self, *names):
        self.X, self.star, self.Y, self.Z = chain_value([(c(name), s(name)) for name in names])


# %% [markdown]
# ## Group 1: the RCCC loop
#
# Joint 4 turns and its angle is given; joints 1, 2 and 3 are cylindric. The two chains are
# $A=X_{34}Z_4X_{41}Z_1X_{12}$ and $B=(Z_2X_{23}Z_3)^{-1}$; $(A-B)_{ij}$ is an entry of their difference. The rotations
# alone are those of a spherical quadrilateral, and its laws give the angles. Unknown are $\theta_1$, $\theta_2$,
# $\theta_3$ and $S_1$, $S_2$, $S_3$.

# %%
A = chain("34", 4, "41", 1, "12")
B = inverse_transform(chain(2, "23", 3)).applyfunc(sp.expand)
closure = A - B
Z41 = Notation("34", 4, "41", 1, "12")
Four = Notation("34", 4, "41")
difference = {
    (i, j): d.letter(
        f"rccc_{i + 1}{j + 1} | (A-B)_{{{i + 1}{j + 1}}} | entry of the closure | 1", closure[i, j]
    )
    for i, j in ((2, 2), (2, 0), (2, 1), (0, 2), (1, 2))
}
X41, Y41, Z41_ = (
    d.letter(f"{name}_41 | {name}_{{41}} | {name} of the joints 4 and 1 | 1", value)
    for name, value in (("X", Z41.X), ("Y", Z41.Y), ("Z", Z41.Z))
)
X4, Y4, Z4 = (
    d.letter(f"{name}_4 | {name}_4 | {name} of joint 4 | 1", value)
    for name, value in (("X", Four.X), ("Y", Four.Y), ("Z", Four.Z))
)
d.check(
    "rccc-cosine-law",
    equal(difference[2, 2], Z41_ - c("23")),
    equal(Z41_, c("12") * Z4 + s("12") * (X4 * s(1) + Y4 * c(1))),
    text="The last entry of the closure is the cosine law of the quadrilateral, $Z_{41}=\\cos\\alpha_{23}$. It "
    "contains $\\theta_1$ alone: $A\\cos\\theta_1+B\\sin\\theta_1+D=0$ with $A=\\sin\\alpha_{12}\\,Y_4$, "
    "$B=\\sin\\alpha_{12}\\,X_4$ and $D=\\cos\\alpha_{12}\\,Z_4-\\cos\\alpha_{23}$ (the notes' group one solution "
    "process).",
).prove()

# %%
Z14 = Notation("12", 1, "41", 4, "34")
X14, Y14 = (
    d.letter(f"{name}_14 | {name}_{{14}} | {name} of the joints 1 and 4 | 1", value)
    for name, value in (("X", Z14.X), ("Y", Z14.Y))
)
d.check(
    "rccc-other-angles",
    equal(difference[2, 0], X41 - s("23") * s(2)),
    equal(difference[2, 1], s("23") * c(2) - Y41),
    equal(difference[0, 2], X14 - s("23") * s(3)),
    equal(difference[1, 2], Y14 - s("23") * c(3)),
    text="The rest of the last row gives sine and cosine of $\\theta_2$, as $X_{41}=\\sin\\alpha_{23}\\sin\\theta_2$ "
    "and $Y_{41}=\\sin\\alpha_{23}\\cos\\theta_2$; the rest of the last column gives those of $\\theta_3$.",
).prove()

# %% [markdown]
# That settles five of the nine entries of the rotation. The others follow: let $M$ be any rotation, here
# $R_z(\theta_1)R_x(\beta)R_z(\theta_2)$ with any angles, $\vec m$ the first two entries of its last column, $\vec n$
# those of its last row, and $\mu=M_{33}=\cos\beta$. Its upper left block is determined by these alone;
# $\vec m^\perp=(-m_2,m_1)$ and $\vec n^\perp=(-n_2,n_1)$ are the turned pairs.

# %%
beta = d.symbol("beta", r"\beta", "any angle", "rad")


def block_of(R):
    """Upper left block of a rotation times 1 - R[2, 2]², from its last row and column."""
    row, column, corner = R[2, :2], R[:2, 2], R[2, 2]
    return -corner * column * row - sp.Matrix([-column[1], column[0]]) * sp.Matrix([[-row[1], row[0]]])


tilt = rot("x", beta)
any_rotation = rot("z", theta[1]) * tilt * rot("z", theta[2])
d.check(
    "rotation-from-row-and-column",
    equal(
        d.letter(
            r"block_times | (1-\mu^2)\,M_{1\ldots2,\,1\ldots2} | upper left block of a rotation, times 1 − μ² | 1",
            any_rotation[:2, :2] * sp.sin(beta) ** 2,
        ),
        d.letter(
            r"block_from | -\mu\,\vec m\,\vec n^T-\vec m^\perp\,(\vec n^\perp)^T | block from last row and column | 1",
            block_of(any_rotation),
        ),
    ),
    text="Last row and last column of a rotation determine the rest where its last entry is not $\\pm1$. So a root "
    "$\\theta_1$ of the cosine law, and the angles that follow from it linearly, close the loop's rotation.",
).prove()

# %% [markdown]
# ### The offsets
#
# The offsets follow from the vector loop. Seen from the frame at joint 2, before its rotation, the way from joint 2
# over joint 4 to joint 3 is $\vec w$, without the unknown $S_1$. The loop closes where $A^{-1}$ and $B^{-1}$ have the
# same translation. The difference of the two is $\vec w$ less the unknown parts, $\vec\delta$:

# %%
known = inverse_transform(chain("34", 4, "41", 1, "12").subs(S[1], 0))[:3, 3]
shares = inverse_transform(A)[:3, 3] - inverse_transform(B)[:3, 3]
w = d.vector("w", r"\vec w", "vector loop from joint 2 to joint 3 by way of joint 4, without S₁", "length")
by_known = {w: known}
in_frame = sp.Matrix(
    [
        w[0] - a["23"] * c(2) - S[3] * s("23") * s(2),
        w[1] - S[1] * s("12") - a["23"] * s(2) + S[3] * s("23") * c(2),
        w[2] - S[1] * c("12") - S[2] - S[3] * c("23"),
    ]
)
difference_vector = d.letter(
    r"shares | (A^{-1}-B^{-1})_{1\ldots3,\,4} | vector of the closure | length", shares
)
w1, w2, w3 = w
d.check(
    "rccc-vector-loop",
    equal(
        difference_vector,
        im(
            [
                w1 - a["23"] * c(2) - S[3] * s("23") * s(2),
                w2 - S[1] * s("12") - a["23"] * s(2) + S[3] * s("23") * c(2),
                w3 - S[1] * c("12") - S[2] - S[3] * c("23"),
            ]
        ),
    ),
    equal(
        w1,
        -(a["12"] + a["41"] * c(1) + S[4] * s("41") * s(1) + a["34"] * (c(4) * c(1) - s(4) * s(1) * c("41"))),
    ),
    text="The vector loop at joint 2. Its first component is the projection on $\\vec a_{12}$, which is across both "
    "$\\vec S_1$ and $\\vec S_2$: it contains neither $S_1$ nor $S_2$. The last bracket is $\\vec "
    "a_{12}\\cdot\\vec a_{34}$.",
).prove(given=by_known)

# %% [markdown]
# The first component gives $S_3$; the projection on $\vec a_{23}$, which is across $\vec S_2$ and $\vec S_3$, gives
# $S_1$; the third component then $S_2$:
# $$S_3=\frac{w_1-a_{23}\cos\theta_2}{\sin\alpha_{23}\sin\theta_2},\qquad
# S_1=\frac{w_1\cos\theta_2+w_2\sin\theta_2-a_{23}}{\sin\alpha_{12}\sin\theta_2},\qquad
# S_2=w_3-S_1\cos\alpha_{12}-S_3\cos\alpha_{23}.$$

# %%
S1 = (w[0] * c(2) + w[1] * s(2) - a["23"]) / (s("12") * s(2))
S3 = (w[0] - a["23"] * c(2)) / (s("23") * s(2))
S2 = w[2] - S1 * c("12") - S3 * c("23")
d.check(
    "rccc-offsets",
    equal(
        im(
            [
                w1 - a["23"] * c(2) - S[3] * s("23") * s(2),
                w2 - S[1] * s("12") - a["23"] * s(2) + S[3] * s("23") * c(2),
                w3 - S[1] * c("12") - S[2] - S[3] * c("23"),
            ]
        ),
        sp.zeros(3, 1).as_immutable(),
    ),
    text="These offsets close the vector loop, where $\\sin\\theta_2$ is not zero: three linear equations with the "
    "determinant $\\sin\\alpha_{12}\\sin\\alpha_{23}\\sin\\theta_2$. (Where it is zero the three axes are parallel to "
    "one plane.)",
).prove(given={w: w, S[1]: S1, S[2]: S2, S[3]: S3})

# %% [markdown]
# ### The same by the secondary cosine law
#
# A line in space has a dual angle to another: the angle, and $\varepsilon$ times their distance. Laws of spherical
# polygons hold for dual angles, too, and their dual part is the secondary law. Geometrically the dual part of the
# cosine of two axes is the moment of one about the other. $D[\ldots]$ is the dual part; $\mathcal M(A)$ is the moment
# of the last axis of the chain $A$ about its first.

# %%


def moment(T):
    """Secondary part of T[2, 2] by geometry: the moment of the last axis about the first one."""
    R, back = T[:3, :3], inverse_transform(T)[:3, 3]
    return R[2, 1] * back[0] - R[2, 0] * back[1]


d.check(
    "rccc-secondary-cosine-law",
    equal(
        d.letter("D_Z_41 | D[Z_{41}] | dual part of Z₄₁ | length", secondary(Z41.Z)),
        d.letter(r"moment_A | \mathcal M(A) | moment by the chain A | length", moment(A)),
    ),
    equal(
        d.letter(r"D_c_23 | D[\cos\alpha_{23}] | dual part of cos α₂₃ | length", secondary(c("23"))),
        d.letter(r"moment_B | \mathcal M(B) | moment by the chain B | length", moment(B)),
    ),
    text="The dual parts of both sides of the cosine law $Z_{41}=\\cos\\alpha_{23}$ are the moment of the axes 2 and 3 "
    "about each other, by either chain. The equation is linear in $S_1$ and has neither $S_2$ nor $S_3$.",
).prove()

# %% [markdown]
# ## Group 2: the RRRCC loop
#
# Joint 5 turns by a given angle; joints 3 and 4 are cylindric. Now $A=X_{45}Z_5X_{51}Z_1X_{12}Z_2X_{23}$ and
# $B=(Z_3X_{34}Z_4)^{-1}$. The rotations are those of a spherical pentagon. Its cosine law has two unknown angles,
# $\theta_1$ and $\theta_2$, so a second equation is needed that has neither $S_3$ nor $S_4$.

# %%
A = chain("45", 5, "51", 1, "12", 2, "23")
B = inverse_transform(chain(3, "34", 4)).applyfunc(sp.expand)
closure = A - B
Five = Notation("45", 5, "51")
Z51 = Notation("45", 5, "51", 1, "12")
Z512 = Notation("45", 5, "51", 1, "12", 2, "23")
Z512_ = d.letter("Z_512 | Z_{512} | Z of the joints 5, 1 and 2 | 1", Z512.Z)
Z51_ = d.letter("Z_51 | Z_{51} | Z of the joints 5 and 1 | 1", Z51.Z)
X51_ = d.letter("X_51 | X_{51} | X of the joints 5 and 1 | 1", Z51.X)
Y51_ = d.letter("Y_51 | Y_{51} | Y of the joints 5 and 1 | 1", Z51.Y)
star51 = d.letter("Xstar_51 | X^*_{51} | X* of the joints 5 and 1 | 1", Z51.star)
X5, Y5, Z5 = (
    d.letter(f"{name}_5 | {name}_5 | {name} of joint 5 | 1", value)
    for name, value in (("X", Five.X), ("Y", Five.Y), ("Z", Five.Z))
)
d.check(
    "rrrcc-cosine-law",
    equal(d.letter("rrrcc_33 | (A-B)_{33} | last entry of the closure | 1", closure[2, 2]), Z512_ - c("34")),
    text="The cosine law of the pentagon, $Z_{512}=\\cos\\alpha_{34}$: one equation in $\\theta_1$ and $\\theta_2$ "
    "(the notes' group two solution process).",
).prove()

# %%
D_Z512 = d.letter("D_Z_512 | D[Z_{512}] | dual part of Z₅₁₂ | length", secondary(Z512.Z))
D_c34 = d.letter(r"D_c_34 | D[\cos\alpha_{34}] | dual part of cos α₃₄ | length", secondary(c("34")))
d.check(
    "rrrcc-secondary-cosine-law",
    equal(D_Z512, d.letter(r"moment_A_2 | \mathcal M(A) | moment by the chain A | length", moment(A))),
    equal(D_c34, d.letter(r"moment_B_2 | \mathcal M(B) | moment by the chain B | length", moment(B))),
    equal(D_c34, -a["34"] * s("34")),
    text="The second equation is its dual part, $D[Z_{512}]=-a_{34}\\sin\\alpha_{34}$. As a projection it is the "
    "vector loop on $\\vec S_3\\times\\vec S_4$, which is across both unknown offsets: the same equation, since both "
    "are the moment of the axes 3 and 4 about each other.",
).prove()

# %% [markdown]
# The dual parts can be computed joint by joint. A product has the dual part $uD[v]+vD[u]$, and sine and cosine of a
# dual angle $\theta+\varepsilon S$ have $S\cos\theta$ and $-S\sin\theta$.

# %%
X0 = {5: a["45"] * c("45") * s(5) + S[5] * s("45") * c(5)}
Y0 = {
    5: a["45"] * (s("51") * s("45") - c("51") * c("45") * c(5)) - a["51"] * Five.Z + S[5] * c("51") * Five.X
}
Y_bar = -(s("45") * c("51") + c("45") * s("51") * c(5))
Z0 = {5: a["45"] * Y_bar + a["51"] * Five.Y + S[5] * s("51") * Five.X}
star0 = X0[5] * s(1) + Y0[5] * c(1) + S[1] * (Five.X * c(1) - Five.Y * s(1))
DX5, DY5, DZ5, DX51, DY51, DZ51 = (
    d.letter(f"D_{name} | D[{latex}] | dual part of {latex.replace('_', '').strip('{}')} | length", secondary(value))
    for name, latex, value in (
        ("X_5", "X_5", Five.X), ("Y_5", "Y_5", Five.Y), ("Z_5", "Z_5", Five.Z),
        ("X_51", "X_{51}", Z51.X), ("Y_51", "Y_{51}", Z51.Y), ("Z_51", "Z_{51}", Z51.Z),
    )
)  # fmt: skip
star_of_D = d.letter("D_Xstar_51 | D[X^*_{51}] | dual part of X*51 | length", star0)
bar_Y5 = d.letter(r"Ybar_5 | \bar Y_5 | Y of joint 5 with its twists exchanged | 1", Y_bar)
d.check(
    "secondary-single",
    equal(DX5, a["45"] * c("45") * s(5) + S[5] * s("45") * c(5)),
    equal(
        DY5,
        a["45"] * (s("51") * s("45") - c("51") * c("45") * c(5)) - a["51"] * Z5 + S[5] * c("51") * X5,
    ),
    equal(DZ5, a["45"] * bar_Y5 + a["51"] * Y5 + S[5] * s("51") * X5),
    equal(DX51, DX5 * c(1) - DY5 * s(1) - S[1] * star51),
    equal(DY51, c("12") * star_of_D - s("12") * DZ5 - a["12"] * Z51_),
    equal(DZ51, s("12") * star_of_D + c("12") * DZ5 + a["12"] * Y51_),
    text="The dual parts of $X$, $Y$ and $Z$ of one joint, and the step to the next, in which $D[X^*_{51}]="
    "D[X_5]\\sin\\theta_1+D[Y_5]\\cos\\theta_1+S_1\\,(X_5\\cos\\theta_1-Y_5\\sin\\theta_1)$. The package "
    "computes them so.",
).prove()

# %% [markdown]
# ### Two bilinear equations
#
# Each of the two equations is linear in $(1,\cos\theta_1,\sin\theta_1)=\vec u$ and in
# $(1,\cos\theta_2,\sin\theta_2)=\vec v$: it is $\vec u^TM\vec v=0$ with a table $M$ of coefficients. The tables below,
# $M_0$ of $Z_{512}$ and $M_1$ of its dual part, are what the package computes.

# %%


def bilinear(M, first, second):
    """Value of an equation: rows of M multiply 1, cos, sin of the first angle, columns those of the second."""
    u, v = (sp.Matrix([1, c(j), s(j)]) for j in (first, second))
    return (u.T * M * v)[0]


def cosine_table(X, Y, Z, c12, s12, c23, s23, alone=None):
    """Coefficients of Z₅₁₂ in 1, cos θ₁, sin θ₁ and 1, cos θ₂, sin θ₂; `alone` is s23 where there is no c12 or s12."""
    alone = s23 if alone is None else alone
    return sp.Matrix(
        [
            [c23 * c12 * Z, -s23 * s12 * Z, 0],
            [c23 * s12 * Y, s23 * c12 * Y, alone * X],
            [c23 * s12 * X, s23 * c12 * X, -alone * Y],
        ]
    )


def shifted(M, along_rows, along_columns):
    """Change of a table when the first angle has the secondary part `along_rows`, the second `along_columns`."""
    turn = sp.Matrix([[0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return along_rows * turn * M + along_columns * M * turn.T


def secondary_table(X, Y, Z, X0, Y0, Z0, trig, lengths, offsets):
    """Coefficients of the secondary part of Z₅₁₂; `trig` is c12, s12, c23, s23, `lengths` a12 and a23."""
    c12, s12, c23, s23 = trig
    a12, a23 = lengths
    found = cosine_table(X0, Y0, Z0, *trig)
    found += a12 * cosine_table(X, Y, Z, -s12, c12, c23, s23, 0)
    found += a23 * cosine_table(X, Y, Z, c12, s12, -s23, c23)
    return found + shifted(cosine_table(X, Y, Z, *trig), *offsets)


trig = (c("12"), s("12"), c("23"), s("23"))
five = (Five.X, Five.Y, Five.Z)
d.check(
    "rrrcc-bilinear",
    equal(
        Z512_,
        d.letter(
            r"uM0v | \vec u^TM_0\,\vec v | value of the table of Z₅₁₂ | 1",
            bilinear(cosine_table(*five, *trig), 1, 2),
        ),
    ),
    equal(
        D_Z512,
        d.letter(
            r"uM1v | \vec u^TM_1\,\vec v | value of the table of its dual part | length",
            bilinear(
                secondary_table(*five, X0[5], Y0[5], Z0[5], trig, (a["12"], a["23"]), (S[1], S[2])), 1, 2
            ),
        ),
    ),
    text="Both equations are bilinear. With the tangents of the half angles they are a pair of biquadratics, which has "
    "up to eight solutions.",
).prove()

# %% [markdown]
# ### The other joints
#
# With $\theta_1$ and $\theta_2$ the chain $A$ is known. Its rotation gives $\theta_3$ and $\theta_4$, its vector the
# two offsets. $\vec p$ is the way from joint 3 over the joints 2, 1 and 5 to joint 4, seen from joint 3.

# %%
back = d.vector(
    "p", r"\vec p", "from joint 3 to joint 4 by way of joints 5, 1 and 2, seen from joint 3", "length"
)
row = A[2, :3]
closed = {
    "row": im([[s("34") * s(3), -s("34") * c(3), c("34")]]),
    "column": im([s("34") * s(4), s("34") * c(4), c("34")]),
    "vector": im(
        [
            a["34"] * c(3) + S[4] * s("34") * s(3),
            a["34"] * s(3) - S[4] * s("34") * c(3),
            S[3] + S[4] * c("34"),
        ]
    ),
}
d.check(
    "rrrcc-other-angles",
    equal(
        d.letter(r"B_row | B_{3,\,1\ldots3} | last row of B's rotation | 1", sp.Matrix(B[2, :3])),
        closed["row"],
    ),
    equal(
        d.letter(r"B_column | B_{1\ldots3,\,3} | its last column | 1", sp.Matrix(B[:3, 2])), closed["column"]
    ),
    equal(
        d.letter(
            r"B_vector | (B^{-1})_{1\ldots3,\,4} | vector of B, seen from joint 3 | length",
            sp.Matrix(inverse_transform(B)[:3, 3]),
        ),
        closed["vector"],
    ),
    text="Last row and last column of the rotation, which are those of $A$, give $\\theta_3$ and $\\theta_4$; the "
    "vector, which is $\\vec p$, gives both offsets.",
).prove()

# %%
p1, p2, p3 = back
d.check(
    "rrrcc-offsets",
    equal(closed["vector"], back),
    equal(-s("34") * c(3) * p1 - s("34") * s(3) * p2, -s("34") * (p1 * c(3) + p2 * s(3))),
    text="The vector loop closes with $S_4=(p_1\\sin\\theta_3-p_2\\cos\\theta_3)/\\sin\\alpha_{34}$ and "
    "$S_3=p_3-S_4\\cos\\alpha_{34}$, provided that $p_1\\cos\\theta_3+p_2\\sin\\theta_3=a_{34}$. That is the secondary "
    "cosine law: the second line is the moment of the axes 3 and 4 about each other by the last row of the rotation.",
).prove(
    given={
        back: back,
        S[4]: (p1 * s(3) - p2 * c(3)) / s("34"),
        S[3]: p3 - (p1 * s(3) - p2 * c(3)) / s("34") * c("34"),
        a["34"]: p1 * c(3) + p2 * s(3),
    }
)
# %% [markdown]
# ## Any loop of group 2
#
# The same holds for every loop of group 2, whatever the order of its joints. Four unknown angles are left, of turns
# about the axes $\vec s_1,\ldots,\vec s_4$ in a ring of four links 12, 23, 34 and 41, and two unknown offsets along
# directions $\vec p$ and $\vec q$ that are fixed in links. (A cylindric joint's axis lies in both of its links; link
# 41 is chosen so that it has none.) Two equations in $\theta_2$ and $\theta_3$ are asked for.
#
# The first is $\vec s_4\cdot\vec s_1=\cos\alpha_{41}$. The second is the projection of the vector loop on
# $\vec p\times\vec q$, which is across both offsets. Seen from link 23, vectors of link 12 turn with $\theta_2$ and
# those of link 34 with $\theta_3$. The vector of link 41 is a sum of $\vec s_4$, $\vec s_1$ and $\vec s_4\times\vec
# s_1$, the last with the factor $\gamma$; its first two parts are added to the vectors $\vec v_{34}$ and $\vec
# v_{12}$ of the links 34 and 12. What the third part contributes is
#
# $$(\vec p\times\vec q)\cdot(\vec s_4\times\vec s_1)=(\vec p\cdot\vec q)(\vec s_1\cdot\vec s_4)
# +(\vec p\times\vec s_1)\cdot(\vec s_4\times\vec q)-(\vec p\cdot\vec s_1)(\vec q\cdot\vec s_4)$$
#
# for slides in two different links. Wherever the first equation holds, $\vec s_1\cdot\vec s_4$ is a constant, and
# with it each term is bilinear in $(1,\cos\theta_2,\sin\theta_2)$ and $(1,\cos\theta_3,\sin\theta_3)$: a table of
# coefficients, as above. The tables are built in the code of this cell, one for each pair of links. Here all vectors
# are taken by matrices, with any rotation of link 23, and the projection is compared with the table.

# %%
turn_before = d.letter(r"phi_1 | \phi_1 | angle about z, before the twist of link 23 | rad")
turn_after = d.letter(r"phi_2 | \phi_2 | angle about z, after the twist of link 23 | rad")


def from_first(t):
    """Vector of link 12, given along the axes at joint 2, seen from link 23 (at joint 2): Rz(-theta_2) t."""
    return sp.Matrix([[0, t[0], t[1]], [0, t[1], -t[0]], [t[2], 0, 0]])


def from_third(t, rotation):
    """Vector of link 34 seen from link 23: R Rz(theta_3) t, with the rotation R along link 23."""
    return rotation * sp.Matrix([[0, t[0], -t[1]], [0, t[1], t[0]], [t[2], 0, 0]])


def across(v, table):
    """Cross product of a vector of link 23 with each column of a table."""
    return sp.Matrix.hstack(*(v.cross(table[:, n]) for n in range(3)))


def alone(value):
    return sp.Matrix([[value, 0, 0], [0, 0, 0], [0, 0, 0]])


def second_only(row):
    """Function of the second angle alone, as a function of both."""
    return sp.Matrix.vstack(row, sp.zeros(2, 3))


def first_only(column):
    return sp.Matrix.hstack(column, sp.zeros(3, 2))


def projections(p, q, V, s1, s4, c41, gamma, R):
    """Projection of the vector loop on p x q, as a table, for slides in each pair of links.

    `V` are the vectors of links 12, 23 and 34; `s1` is given in link 12 and `s4` in link 34, `gamma` times s4 x s1 is
    left of link 41. For each pair the slide `p` lies in the first link named, and `q` in the second.
    """
    V0, V1, V2 = V
    f, t = from_first, lambda v: from_third(v, R)
    p0, q2 = f(p), t(q)
    return {
        "12_12": alone((p.cross(q)).dot(V0))
        + first_only(f(p.cross(q)).T * V1)
        + f(p.cross(q)).T * t(V2)
        + gamma * f(s1.cross(p.cross(q))).T * t(s4),
        "23_23": first_only(f(V0).T * p.cross(q))
        + alone(p.cross(q).dot(V1))
        + second_only(p.cross(q).T * t(V2))
        - gamma * across(p.cross(q), f(s1)).T * t(s4),
        "34_34": f(V0).T * t(p.cross(q))
        + second_only(V1.T * t(p.cross(q)))
        + alone(p.cross(q).dot(V2))
        + gamma * f(s1).T * t(p.cross(q).cross(s4)),
        "12_23": first_only(f(V0.cross(p)).T * q + p0.T * q.cross(V1))
        + p0.T * across(q, t(V2))
        + gamma
        * (
            first_only(c41 * p0.T * q)
            - f(p.cross(s1)).T * across(q, t(s4))
            - second_only(p.dot(s1) * q.T * t(s4))
        ),
        "12_34": f(V0.cross(p)).T * q2
        - p0.T * across(V1, q2)
        + p0.T * t(q.cross(V2))
        + gamma * (c41 * p0.T * q2 + f(p.cross(s1)).T * t(s4.cross(q)) - alone(p.dot(s1) * q.dot(s4))),
        "23_34": f(V0).T * across(p, q2)
        + second_only(V1.cross(p).T * q2 + p.T * t(q.cross(V2)))
        + gamma
        * (
            second_only(c41 * p.T * q2)
            + across(p, f(s1)).T * t(s4.cross(q))
            - first_only(q.dot(s4) * f(s1).T * p)
        ),
    }


letters = {
    name: d.vector(name, latex, doc, unit)
    for name, latex, doc, unit in (
        ("p_slide", r"\vec p", "direction of a slide", "1"),
        ("q_slide", r"\vec q", "direction of another slide", "1"),
        ("v_12", r"\vec v_{12}", "vector of link 12", "length"),
        ("v_23", r"\vec v_{23}", "vector of link 23", "length"),
        ("v_34", r"\vec v_{34}", "vector of link 34", "length"),
        ("s_1", r"\vec s_1", "direction of axis 1, in link 12", "1"),
        ("s_4", r"\vec s_4", "direction of axis 4, in link 34", "1"),
    )
}
p, q, *V, s1, s4 = (sp.Matrix(list(v)) for v in letters.values())
cosine41 = d.symbol("c_41", r"c_{41}", "cosine of the twist of link 41", "1")
gamma = d.symbol("gamma", r"\gamma", "part of link 41 along s₄ × s₁", "length")
middle = rot("z", turn_before) * tilt * rot("z", turn_after)
see = {
    "12": rot("z", -theta[2]),
    "23": sp.eye(3),
    "34": middle * rot("z", theta[3]),
}
loop = sum(
    (see[link] * v for link, v in zip(see, V, strict=True)), gamma * (see["34"] * s4).cross(see["12"] * s1)
)
tables = projections(p, q, V, s1, s4, cosine41, gamma, middle)
law = d.letter(
    r"s4_s1 | \vec s_4\cdot\vec s_1 | cosine between axes 4 and 1 | 1", (see["12"] * s1).dot(see["34"] * s4)
)
d.check(
    "any-two-slides",
    *(
        equal(
            d.letter(
                rf"loop_{name} | (\vec p_{{{name[:2]}}}\times\vec q_{{{name[3:]}}})\cdot\vec r | "
                rf"projection of the loop, slides in links {name[:2]} and {name[3:]} | length",
                (see[name[:2]] * p).cross(see[name[3:]] * q).dot(loop),
            ),
            d.letter(
                rf"table_{name} | \vec u^TM_{{{name[:2]},{name[3:]}}}\vec v | value of its table | length",
                bilinear(table, 2, 3),
            )
            + (
                0
                if name[:2] == name[3:]
                else gamma
                * d.letter(
                    rf"p_q_{name} | (\vec p_{{{name[:2]}}}\cdot\vec q_{{{name[3:]}}}) | "
                    rf"scalar product of the slides | 1",
                    (see[name[:2]] * p).dot(see[name[3:]] * q),
                )
                * (law - cosine41)
            ),
        )
        for name, table in tables.items()
    ),
    text="For slides in any two of the links 12, 23 and 34 the projection of the vector loop $\\vec r$ is the value of "
    "a table, plus a multiple of the first equation, $\\vec s_4\\cdot\\vec s_1-c_{41}=0$. The subscripts say in which "
    "link a slide lies; $\\vec u$ and $\\vec v$ hold $1$, cosine and sine of $\\theta_2$ and $\\theta_3$.",
).prove()

# %% [markdown]
# The parts of link 41. In its frame $\vec s_4$ is $\vec e_z$, $\vec s_1$ is the unit vector $\vec n$, and $\vec
# v_{41}$ its vector. With $\nu=n_3$, the cosine between the two, and $\vec v=\vec v_{41}$ the parts are, times
# $n_1^2+n_2^2=1-\nu^2$,
# $$k_z=v_3-\nu\,\vec v\cdot\vec n,\qquad k_n=\vec v\cdot\vec n-\nu v_3,\qquad k_\times=n_1v_2-n_2v_1.$$

# %%
n_axis = d.vector("n", r"\vec n", "direction of axis 1 seen from axis 4, along z, in link 41", "1")
v_41 = d.vector("v_41", r"\vec v_{41}", "vector of link 41, there", "length")


def closing_parts(n, v):
    """Parts of a vector along z, n and z x n, each times the square of the sine between z and n."""
    along, other = v[2], v.dot(n)
    return along - n[2] * other, other - n[2] * along, n[0] * v[1] - n[1] * v[0]


n, v41 = sp.Matrix(list(n_axis)), sp.Matrix(list(v_41))
z = sp.Matrix([0, 0, 1])
parts = closing_parts(n, v41)
k_z, k_n, k_x = (
    d.letter(f"{name} | {latex} | part of link 41 along {along}, times n₁² + n₂² | length", value)
    for name, latex, along, value in zip(
        ("k_z", "k_n", "k_cross"), ("k_z", "k_n", r"k_\times"), ("z", "n", "z × n"), parts, strict=True
    )
)
e_z = d.vector("e_z", r"\vec e_z", "unit vector along z", "1", value=z)
d.check(
    "link-41",
    equal(
        k_z * e_z + k_n * n_axis + k_x * cross(e_z, n_axis),
        (n_axis.components[0] ** 2 + n_axis.components[1] ** 2) * v_41,
    ),
    text="The vector of link 41 as a sum of $\\vec s_4$, $\\vec s_1$ and $\\vec s_4\\times\\vec s_1$. It needs axes "
    "that are not parallel.",
).prove(modulo={n_axis.components[2]: dot(n_axis, n_axis) - 1})

# %%
d.check(
    "first-of-any-two-slides",
    equal(
        law,
        d.letter(
            r"table_first | \vec u^TM_s\,\vec v | value of its table | 1",
            bilinear(from_first(s1).T * from_third(s4, middle), 2, 3),
        ),
    ),
    text="The first equation is bilinear, too.",
).prove()

# %% [markdown]
# ## The self-scalar product
#
# The third way of Crane and Duffy. The square of a part of the vector loop is the sum of the squares of its lengths and
# of twice all products of two of them, with the cosines between their directions. It has no angle of the rest of the
# loop. An example is the part $\vec r_5$ of $a_{45}$, $S_5$, $a_{51}$, $S_1$ and $a_{12}$.

# %%
part = chain("45", 5, "51", 1, "12")[:3, 3]
W15 = c(1) * c(5) - s(1) * s(5) * c("51")
products = (
    a["45"] * a["51"] * c(5)
    + a["45"] * S[1] * s("51") * s(5)
    + a["45"] * a["12"] * W15
    + S[5] * S[1] * c("51")
    + S[5] * a["12"] * s(1) * s("51")
    + a["51"] * a["12"] * c(1)
)
part_vector = d.letter(
    r"r_5 | \vec r_5 | the part a₄₅, S₅, a₅₁, S₁, a₁₂ of the loop | length", sp.Matrix(part)
)
letter_W15 = d.letter("W_15 | W_{15} | cosine between a₄₅ and a₁₂ | 1", W15)
d.check(
    "self-scalar-product",
    equal(
        dot(part_vector, part_vector),
        a["45"] ** 2
        + S[5] ** 2
        + a["51"] ** 2
        + S[1] ** 2
        + a["12"] ** 2
        + 2 * products.subs(W15, letter_W15),
    ),
    text="The square of $\\vec r_5$. Three of the cosines have names: $\\vec a_{45}\\cdot\\vec S_1=\\bar X_5="
    "\\sin\\alpha_{51}\\sin\\theta_5$, $\\vec a_{45}\\cdot\\vec a_{12}=W_{15}$ and "
    "$\\vec S_5\\cdot\\vec a_{12}=U_{15}=\\sin\\alpha_{51}\\sin\\theta_1$.",
).prove()

# %% [markdown]
# ## The mobility formula
#
# How many freedoms has a closed loop? The usual formula counts those of $n$ bodies, six each but for the one that
# stands still, less what the joints take away: $6(n-1)-\sum(6-f)$ for joints with $f$ freedoms. It does not see that
# all motions of a loop may be of one kind. The true number is that of the joints' freedoms, less the rank $r$ of
# their screws. The example is a four-bar linkage with parallel axes, at the corners of a square.

# %%
square = [(0, 0), (1, 0), (1, 1), (0, 1)]
screws = sp.Matrix([[0, 0, 1, y, -x, 0] for x, y in square]).T
rank = d.symbol("r", "r", "rank of the joints' screws", "1", value=sp.Integer(screws.rank()))
bodies = d.symbol("bodies", "n", "bodies, and joints, of a single loop", "1")
freedoms = d.symbol("f", "f", "freedoms of each joint", "1")
d.state(
    "mobility-formula",
    equal(bodies * freedoms - rank, 6 * (bodies - 1) - bodies * (6 - freedoms)),
    tacit=True,
    text="The freedoms of a loop, on the left, are those that the formula counts.",
    place="Mobility",
).refute(
    {bodies: 4, freedoms: 1},
    equal(bodies * freedoms - rank, 3 * (bodies - 1) - bodies * (3 - freedoms)),
    label="M1",
    because="The motions of a planar linkage are a group of order 3, which takes the place of 6.",
)

# %% [markdown]
# ## Planar representation, equivalent spherical mechanism, groups
#
# A planar representation draws a link as a line and a joint as its letter, and hatches the link that stands still
# (`rodgen.output.figures.planar_representation` draws it). It shows which links are joined, and the formula above needs
# no more.
#
# The transforms around a closed loop multiply to the unit matrix, and in the rotation part of the product there is no
# length: $\prod R_x(\alpha_{ij})R_z(\theta_j)=1$ is the closure of the spherical polygon with the same twists and
# angles. So all axes may be moved to one point and every law of the polygon holds for the loop. Then a revolute, a
# cylindric and a screw joint are a revolute one, a prismatic one is rigid, and the mobility is counted with 3 in place
# of 6. The mobility of this spherical mechanism is the group: with one angle given, a loop of group 1 has all others
# from the polygon alone, and each group higher needs an equation more that has the lengths in it.

# %%
total = d.symbol("F", "F", "freedoms of all joints of a loop", "1")
turning = d.symbol("N", "N", "joints of its equivalent spherical mechanism", "1")
M_spatial = d.symbol("M_spatial", r"M_\mathrm{spatial}", "mobility of the loop", "1", value=total - 6)
M_spherical = d.letter(
    r"M_spherical | M_\mathrm{spherical} | mobility of the spherical mechanism, whose motions have order 3 | 1",
    3 * (turning - 1) - turning * (3 - 1),
)
d.state(
    "group-of-a-mechanism",
    equal(M_spatial, turning - 3),
    text="The group of a mechanism with $N$ joints that turn is $N-3$. The notes write this mobility with the index "
    "“spatial”, here for the RRRCC loop with the freedoms $F$ of its joints.",
    place="Spherical Mechanism Groups",
).refute(
    {total: 7, turning: 5},
    equal(M_spherical, turning - 3),
    label="M2",
    because="It is that of the equivalent spherical mechanism; the spatial loop has one freedom.",
)

# %% [markdown]
# ## The functions of the package
#
# They take points and directions along the chain joint by joint. That this gives the vectors, rows and columns of the
# chains used above is proved of the very steps that they are built from. "fn" marks what the steps give.


# %%
def before_joint(v, cosine, sine, offset=0):
    """See a point from before a joint's transform: its inverse."""
    return sp.Matrix([cosine * v[0] + sine * v[1], cosine * v[1] - sine * v[0], v[2] - offset])


def before_link(v, cosine, sine, length=0):
    """See a point from before a link's transform: its inverse."""
    return sp.Matrix([v[0] - length, cosine * v[1] + sine * v[2], cosine * v[2] - sine * v[1]])


def after_joint(v, cosine, sine):
    """Turn a direction by a joint."""
    return before_joint(v, cosine, -sine)


def after_link(v, cosine, sine):
    """Turn a direction by a link."""
    return before_link(v, cosine, -sine)


def seen_back(start, steps):
    """Go back along a chain of links and joints, each (cosine, sine, length), from its first part on."""
    for n, step in enumerate(steps):
        start = (before_joint if n % 2 else before_link)(start, *step)
    return start


def seen_on(start, steps):
    """Go on along a chain with a direction, from its last part to its first."""
    for n, (cosine, sine, *_) in reversed(list(enumerate(steps))):
        start = (after_joint if n % 2 else after_link)(start, cosine, sine)
    return start


origin, upright = sp.zeros(3, 1), sp.Matrix([0, 0, 1])


def step(j):
    return (c(j), s(j), S[j] if isinstance(j, int) else a[j])


def directions_only(steps):
    return [(cosine, sine, 0) for cosine, sine, _ in steps]


for name, names in (("rccc", ("34", 4, "41", 1, "12")), ("rrrcc", ("45", 5, "51", 1, "12", 2, "23"))):
    along, steps = chain(*names), [step(j) for j in names]
    d.check(
        f"{name}-steps",
        *(
            equal(
                d.letter(rf"{name}_{key}_fn | {latex}^\mathrm{{fn}} | {quantity}, by the steps | {unit}", found),
                d.letter(f"{name}_{key} | {latex} | {quantity}, by the chain | {unit}", sp.Matrix(wanted)),
            )
            for key, latex, quantity, unit, found, wanted in (
                ("vector", r"\vec p_A", "vector seen from the end", "length", seen_back(origin, steps),
                 inverse_transform(along)[:3, 3]),
                ("row", r"\vec r_A", "last row of the rotation", "1", seen_back(upright, directions_only(steps)),
                 along[2, :3].T),
                ("column", r"\vec c_A", "last column of the rotation", "1", seen_on(upright, steps), along[:3, 2]),
            )
        ),
        text=f"Joint by joint along the chain $A$ of the {name.upper()} loop: its vector seen from the end, and "
        f"last row "
        "and column of its rotation.",
    ).prove()  # fmt: skip
d.page("rccc-steps", "rrrcc-steps")

# %% [markdown]
# A status says how many ways there are to close the loop.


# %%


class RCCCStatus(IntEnum):
    """How many ways an RCCC loop closes.

    TWO: with two angles theta_1.
    DOUBLE: both are the same to rounding.
    NONE: the spherical quadrilateral does not close.
    SINGULAR: three axes are parallel to a plane, or the first angle is free: offsets are not determined.
    INVALID: an input is not finite.
    """

    TWO = 0
    DOUBLE = 1
    NONE = 2
    SINGULAR = 3
    INVALID = 4


def geometry(k, order):
    """Inputs alpha and a, and for each link cosine, sine and length."""
    alphas = k.input("alpha", len(order), unit="rad", doc=f"twists of the links {', '.join(order)}")
    lengths = k.input("a", len(order), unit="length", doc="lengths of these links")
    cosines, sines = (
        k.let("cos_alpha", alphas.applyfunc(sp.cos)),
        k.let("sin_alpha", alphas.applyfunc(sp.sin)),
    )
    return {e: (cosines[n], sines[n], lengths[n]) for n, e in enumerate(order)}


def turned(k, name, angle):
    return k.let(f"cos_{name}", sp.cos(angle)), k.let(f"sin_{name}", sp.sin(angle))


def rccc():
    k = KernelBuilder(
        "loop_rccc",
        summary="Close an RCCC loop, whose joint 4 turns by a given angle, in both ways.",
        source="derivation spatial_loops; Crane and Duffy, group one solution process",
    )
    link = geometry(k, ("12", "23", "34", "41"))
    S4 = k.input("S_4", unit="length", doc="offset of joint 4")
    theta4 = k.input("theta_4", unit="rad", doc="angle of joint 4")
    joint4 = (*turned(k, "theta_4", theta4), S4)
    (c12, s12, _), (c23, s23, a23), (c34, s34, _), (c41, s41, _) = link.values()
    X4 = k.let("X_4", s34 * joint4[1])
    Y4 = k.let("Y_4", -(s41 * c34 + c41 * s34 * joint4[0]))
    Z4 = k.let("Z_4", c41 * c34 - s41 * s34 * joint4[0])
    D = k.let("D", c12 * Z4 - c23)
    r = k.let("r", s12 * sp.sqrt(X4**2 + Y4**2))
    size = k.let("size", abs(r))
    square = k.let("square", (size - D) * (size + D))
    root = k.let("root", sp.sqrt(select(square > 0, square, 0)))
    middle = k.let("middle", sp.atan2(s12 * X4, s12 * Y4))
    half = k.let("half", sp.atan2(root, -D))
    angles, offsets, across = [], [], []
    for name, theta1 in (("a", middle + half), ("b", middle - half)):
        theta1 = k.let(f"theta_1_{name}", theta1)
        joint1 = (*turned(k, f"theta_1_{name}", theta1), 0)
        steps = [link["34"], joint4, link["41"], joint1, link["12"]]
        row = k.let(f"row_{name}", seen_back(upright, directions_only(steps)))
        column = k.let(f"column_{name}", seen_on(upright, steps))
        vector = k.let(f"vector_{name}", seen_back(origin, steps))
        # sin(alpha_23) times sine and cosine, whatever its sign
        theta2 = k.let(f"theta_2_{name}", sp.atan2(s23 * row[0], -s23 * row[1]))
        theta3 = k.let(f"theta_3_{name}", sp.atan2(s23 * column[0], s23 * column[1]))
        c2, s2 = turned(k, f"theta_2_{name}", theta2)
        first = k.let(f"S_1_{name}", (vector[0] * c2 + vector[1] * s2 - a23) / (s12 * s2))
        third = k.let(f"S_3_{name}", (vector[0] - a23 * c2) / (s23 * s2))
        angles.append([theta1, theta2, theta3])
        offsets.append([first, vector[2] - first * c12 - third * c23, third])
        across.append(abs(s12 * s23 * s2))
    numbers = [*link.values(), joint4]
    total = k.let("total", sum((abs(x) / 64 for parts in numbers for x in parts), sp.S.Zero))
    good = k.let("good", total <= LARGEST)
    closes = k.let("closes", abs(D) <= size + 4 * EPS)
    determined = k.let("determined", (across[0] > 8 * EPS) & (across[1] > 8 * EPS))
    there = k.let("there", good & closes)
    nan = sp.ones(2, 3) * sp.nan
    k.output(
        "theta",
        select(there, sp.Matrix(angles), nan),
        unit="rad",
        doc="angles of joints 1, 2 and 3, both ways",
    )
    k.output(
        "S",
        select(there & determined, sp.Matrix(offsets), nan),
        unit="length",
        doc="offsets of joints 1, 2 and 3",
    )
    status = sp.Piecewise(
        (RCCCStatus.INVALID, sp.Not(good)),
        (RCCCStatus.NONE, sp.Not(closes)),
        (RCCCStatus.SINGULAR, sp.Not(determined)),
        (RCCCStatus.DOUBLE, root <= 4 * sp.sqrt(EPS) * size),
        (RCCCStatus.TWO, True),
        evaluate=False,
    )
    k.status("status", status, RCCCStatus, doc="how many ways there are")
    return k.build()


def rrrcc_inputs(k):
    link = geometry(k, ("12", "23", "34", "45", "51"))
    given = k.input("S", 3, unit="length", doc="offsets of the joints 1, 2 and 5, which only turn")
    theta5 = k.input("theta_5", unit="rad", doc="angle of joint 5")
    return link, given, turned(k, "theta_5", theta5)


def rrrcc_pair():
    k = KernelBuilder(
        "loop_rrrcc_pair",
        summary="Write the cosine law and the secondary cosine law of an RRRCC loop as a bilinear pair.",
        source="derivation spatial_loops; Crane and Duffy, group two solution process",
        notes="Joints 3 and 4 are cylindric, and the angle of joint 5 is given. Rows multiply 1, cos, sin of theta_1, "
        "columns those of theta_2.",
    )
    link, (S1, S2, S5), (c5, s5) = rrrcc_inputs(k)
    (c12, s12, a12), (c23, s23, a23), (c34, s34, a34), (c45, s45, a45), (c51, s51, a51) = link.values()
    X, Y, Z = (
        k.let(f"{n}_5", v)
        for n, v in zip(
            "XYZ",
            (s45 * s5, -(s51 * c45 + c51 * s45 * c5), c51 * c45 - s51 * s45 * c5),
            strict=True,
        )
    )
    X0 = k.let("X0_5", a45 * c45 * s5 + S5 * s45 * c5)
    Y0 = k.let("Y0_5", a45 * (s51 * s45 - c51 * c45 * c5) - a51 * Z + S5 * c51 * X)
    Z0 = k.let("Z0_5", -a45 * (s45 * c51 + c45 * s51 * c5) + a51 * Y + S5 * s51 * X)
    trig = (c12, s12, c23, s23)
    first = cosine_table(X, Y, Z, *trig)
    second = secondary_table(X, Y, Z, X0, Y0, Z0, trig, (a12, a23), (S1, S2))
    first[0, 0] -= c34
    second[0, 0] += a34 * s34
    pair = sp.ImmutableDenseNDimArray([first.tolist(), second.tolist()])
    k.output("pair", pair, unit="1", doc="coefficients; those of the second equation are lengths")
    return k.build()


def rrrcc_back():
    k = KernelBuilder(
        "loop_rrrcc_back",
        summary="Close an RRRCC loop with a solution of its pair.",
        source="derivation spatial_loops; Crane and Duffy, group two solution process",
    )
    link, (S1, S2, S5), joint5 = rrrcc_inputs(k)
    theta1 = k.input("theta_1", unit="rad", doc="angle of joint 1")
    theta2 = k.input("theta_2", unit="rad", doc="angle of joint 2")
    joint1, joint2 = turned(k, "theta_1", theta1), turned(k, "theta_2", theta2)
    steps = [
        link["45"],
        (*joint5, S5),
        link["51"],
        (*joint1, S1),
        link["12"],
        (*joint2, S2),
        link["23"],
    ]
    row = k.let("row", seen_back(upright, directions_only(steps)))
    column = k.let("column", seen_on(upright, steps))
    vector = k.let("vector", seen_back(origin, steps))
    c34, s34, _ = link["34"]
    theta3 = k.let("theta_3", sp.atan2(s34 * row[0], -s34 * row[1]))
    theta4 = k.let("theta_4", sp.atan2(s34 * column[0], s34 * column[1]))
    c3, s3 = turned(k, "theta_3", theta3)
    S4 = k.let("S_4", (vector[0] * s3 - vector[1] * c3) / s34)
    k.output("angles", sp.Matrix([theta3, theta4]), unit="rad", doc="angles of joints 3 and 4")
    k.output("offsets", sp.Matrix([vector[2] - S4 * c34, S4]), unit="length", doc="offsets of joints 3 and 4")
    return k.build()


def ring_pair(slides):
    first_link, second_link = slides[:2], slides[3:]
    where = f"the links {first_link} and {second_link}" if first_link != second_link else f"link {first_link}"
    k = KernelBuilder(
        f"loop_pair_{slides}",
        summary=f"Write a ring of four links with two slides, in {where}, as a bilinear pair.",
        source="derivation spatial_loops; Crane and Duffy, group two solution process",
        notes="Each link is a rotation from the frame at its second joint to that at its first, z along the joint, and "
        "a vector in the latter. Rows multiply 1, cos, sin of the second angle, columns those of the third.",
    )
    rotations = k.input("rotation", (4, 3, 3), unit="1", doc="of the links 12, 23, 34 and 41")
    vectors = k.input("vector", (4, 3), unit="length", doc="of these links, without the slides")
    p = k.input("p", 3, unit="1", doc=f"direction of the first slide, in link {first_link}")
    q = k.input("q", 3, unit="1", doc=f"direction of the second slide, in link {second_link}")
    R12, R23, R34, R41 = (sp.Matrix(rotations[n].tolist()) for n in range(4))
    v12, v23, v34, v41 = (vectors[n, :].T for n in range(4))
    n = R41[:, 2]
    square = k.let("square", n[0] ** 2 + n[1] ** 2)
    parts = k.let("part", sp.Matrix(closing_parts(n, v41)) / square)
    s1 = R12[2, :].T  # along the axes at joint 2
    s4 = R34[:, 2]
    V12 = k.let("v_12", R12.T * v12 + parts[1] * s1)
    V34 = k.let("v_34", v34 + parts[0] * s4)
    inward = lambda link, v, name: k.let(f"{name}_12", R12.T * v) if link == "12" else v  # noqa: E731
    p, q = inward(first_link, p, "p"), inward(second_link, q, "q")
    second = projections(p, q, (V12, v23, V34), s1, s4, n[2], parts[2], R23)[slides]
    first = from_first(s1).T * from_third(s4, R23) - alone(n[2])
    pair = sp.ImmutableDenseNDimArray([first.tolist(), second.tolist()])
    k.output("pair", pair, unit="1", doc="coefficients; those of the second equation are lengths")
    return k.build()


# %%
derivation.kernel(rccc(), rrrcc_pair(), rrrcc_back(), *(ring_pair(slides) for slides in tables))
