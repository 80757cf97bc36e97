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
# # Closed spatial loops of groups 1 and 2: RCCC and RRRCC
#
# A loop of $n$ joints is closed when the transforms along it are together the unit matrix. With
# $Z_j=T_z(S_j)R_z(\theta_j)$ for a joint and $X_{jk}=T_x(a_{jk})R_x(\alpha_{jk})$ for a link,
#
# $$ Z_1X_{12}Z_2X_{23}\cdots Z_nX_{n1}=1 . $$
#
# Cut at two places it says that two chains, $A$ with the known angle and $B$ with the rest, are one transform: $A=B$.
# Every equation here is an entry of $A-B$, or of $A^{-1}-B^{-1}$, and is proved as such. Crane and Duffy name three
# ways to them: to *project* the vector loop on a direction in which unknown offsets vanish, to take the
# *self-scalar product* of a part of it, and the *secondary cosine laws*, which follow from spherical laws with dual
# angles $\theta+\varepsilon S$ and $\alpha+\varepsilon a$. For the RRRCC loop the first and the third are the same
# equation.

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
    dot,
    dual_value,
    equal,
    inverse_transform,
    rot,
    select,
    transform,
)

derivation = Derivation(
    "spatial_loops",
    title="Closed spatial loops: the group 1 and group 2 solution processes",
    source='Crane and Duffy, "Kinematic Analysis of Robot Manipulators", as in the lecture notes "Robot Geometry"',
)
d = derivation
im = sp.ImmutableMatrix

# %% [markdown]
# ## Symbols

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
# Joint 4 turns and its angle is given; joints 1, 2 and 3 are cylindric. $A=X_{34}Z_4X_{41}Z_1X_{12}$ and
# $B=(Z_2X_{23}Z_3)^{-1}$. The equivalent spherical mechanism is a quadrilateral.

# %%
A = chain("34", 4, "41", 1, "12")
B = inverse_transform(chain(2, "23", 3)).applyfunc(sp.expand)
closure = A - B
Z41 = Notation("34", 4, "41", 1, "12")
Four = Notation("34", 4, "41")
d.check(
    "rccc-cosine-law",
    equal(closure[2, 2], Z41.Z - c("23")),
    equal(Z41.Z, c("12") * Four.Z + s("12") * (Four.X * s(1) + Four.Y * c(1))),
    text="Z₄₁ = cos α₂₃ is the (3,3) entry of the closure: A cos θ₁ + B sin θ₁ + D = 0 with A = sin α₁₂ Y₄, "
    "B = sin α₁₂ X₄ and D = cos α₁₂ Z₄ − cos α₂₃ (the notes' group one solution process).",
).prove()

# %%
Z14 = Notation("12", 1, "41", 4, "34")
d.check(
    "rccc-other-angles",
    equal(closure[2, 0], Z41.X - s("23") * s(2)),
    equal(closure[2, 1], s("23") * c(2) - Z41.Y),
    equal(closure[0, 2], Z14.X - s("23") * s(3)),
    equal(closure[1, 2], Z14.Y - s("23") * c(3)),
    text="The last row gives θ₂ (X₄₁ = sin α₂₃ sin θ₂, Y₄₁ = sin α₂₃ cos θ₂), the last column gives θ₃ (X₁₄, Y₁₄).",
).prove()

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
    equal(im(any_rotation[:2, :2] * sp.sin(beta) ** 2), im(block_of(any_rotation))),
    text="Last row and last column of a rotation determine the rest where its last entry is not ±1. So a root θ₁ of "
    "the cosine law, and the angles that follow from it linearly, close the loop's rotation.",
).prove()

# %% [markdown]
# The offsets follow from the vector loop. Seen from the frame at joint 2, before its rotation, it is $w$, which has all
# but $S_1$, $S_2$ and $S_3$, less their shares. *Projections* on $a_{23}$ and on $a_{12}$, across two of the three
# axes each, leave $S_1$ and $S_3$ alone.

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
d.check(
    "rccc-vector-loop",
    equal(im(shares), im(in_frame)),
    equal(
        w[0],
        -(a["12"] + a["41"] * c(1) + S[4] * s("41") * s(1) + a["34"] * (c(4) * c(1) - s(4) * s(1) * c("41"))),
    ),
    text="The vector loop at joint 2. Its first component is its projection on a₁₂, which is across S₁ and S₂; "
    "W₄₁ = cos θ₄ cos θ₁ − sin θ₄ sin θ₁ cos α₄₁ is a₁₂ · a₃₄.",
).prove(given=by_known)

# %%
S1 = (w[0] * c(2) + w[1] * s(2) - a["23"]) / (s("12") * s(2))
S3 = (w[0] - a["23"] * c(2)) / (s("23") * s(2))
S2 = w[2] - S1 * c("12") - S3 * c("23")
d.check(
    "rccc-offsets",
    equal(im(in_frame), sp.zeros(3, 1).as_immutable()),
    text="The offsets that close the vector loop, where sin θ₂ is not zero: three linear equations with the "
    "determinant sin α₁₂ sin α₂₃ sin θ₂. (Where it is zero the three axes are parallel to one plane.)",
).prove(given={w: w, S[1]: S1, S[2]: S2, S[3]: S3})

# %%


def moment(T):
    """Secondary part of T[2, 2] by geometry: the moment of the last axis about the first one."""
    R, back = T[:3, :3], inverse_transform(T)[:3, 3]
    return R[2, 1] * back[0] - R[2, 0] * back[1]


d.check(
    "rccc-secondary-cosine-law",
    equal(secondary(Z41.Z), moment(A)),
    equal(secondary(c("23")), moment(B)),
    text="Secondary cosine law: Z₄₁ with dual angles is cos α₂₃ with a dual angle, and its secondary part is the "
    "moment of the axes 2 and 3 about each other. It is linear in S₁ and has neither S₂ nor S₃.",
).prove()

# %% [markdown]
# ## Group 2: the RRRCC loop
#
# Joint 5 turns by a given angle; joints 3 and 4 are cylindric. $A=X_{45}Z_5X_{51}Z_1X_{12}Z_2X_{23}$ and
# $B=(Z_3X_{34}Z_4)^{-1}$. The equivalent spherical mechanism is a pentagon.

# %%
A = chain("45", 5, "51", 1, "12", 2, "23")
B = inverse_transform(chain(3, "34", 4)).applyfunc(sp.expand)
closure = A - B
Five = Notation("45", 5, "51")
Z51 = Notation("45", 5, "51", 1, "12")
Z512 = Notation("45", 5, "51", 1, "12", 2, "23")
d.check(
    "rrrcc-cosine-law",
    equal(closure[2, 2], Z512.Z - c("34")),
    text="Z₅₁₂ = cos α₃₄: one equation in θ₁ and θ₂ (the notes' group two solution process).",
).prove()

# %%
d.check(
    "rrrcc-secondary-cosine-law",
    equal(secondary(Z512.Z), moment(A)),
    equal(secondary(c("34")), moment(B)),
    equal(secondary(c("34")), -a["34"] * s("34")),
    text="The second one: the secondary part of Z₅₁₂ is −a₃₄ sin α₃₄. By projection it is the vector loop dotted with "
    "S₃ × S₄, across both unknown offsets; the same equation.",
).prove()

# %%
X0 = {5: a["45"] * c("45") * s(5) + S[5] * s("45") * c(5)}
Y0 = {
    5: a["45"] * (s("51") * s("45") - c("51") * c("45") * c(5)) - a["51"] * Five.Z + S[5] * c("51") * Five.X
}
Y_bar = -(s("45") * c("51") + c("45") * s("51") * c(5))
Z0 = {5: a["45"] * Y_bar + a["51"] * Five.Y + S[5] * s("51") * Five.X}
star0 = X0[5] * s(1) + Y0[5] * c(1) + S[1] * (Five.X * c(1) - Five.Y * s(1))
d.check(
    "secondary-single",
    equal(secondary(Five.X), X0[5]),
    equal(secondary(Five.Y), Y0[5]),
    equal(secondary(Five.Z), Z0[5]),
    equal(secondary(Z51.X), X0[5] * c(1) - Y0[5] * s(1) - S[1] * Z51.star),
    equal(secondary(Z51.Y), c("12") * star0 - s("12") * Z0[5] - a["12"] * Z51.Z),
    equal(secondary(Z51.Z), s("12") * star0 + c("12") * Z0[5] + a["12"] * Z51.Y),
    text="Secondary parts of X, Y and Z, one joint and the step to the next; the kernels compute them so.",
).prove()

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
    equal(Z512.Z, bilinear(cosine_table(*five, *trig), 1, 2)),
    equal(
        secondary(Z512.Z),
        bilinear(secondary_table(*five, X0[5], Y0[5], Z0[5], trig, (a["12"], a["23"]), (S[1], S[2])), 1, 2),
    ),
    text="Both equations are bilinear in 1, cos θ₁, sin θ₁ and 1, cos θ₂, sin θ₂: with half tangents a pair of "
    "biquadratics, of degree 8.",
).prove()

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
    equal(im(B[2, :3]), closed["row"]),
    equal(im(B[:3, 2]), closed["column"]),
    equal(im(inverse_transform(B)[:3, 3]), closed["vector"]),
    text="Last row and column of A's rotation give θ₃ and θ₄; its vector, seen from joint 3, gives both offsets.",
).prove()

# %%
S4 = (back[0] * s(3) - back[1] * c(3)) / s("34")
d.check(
    "rrrcc-offsets",
    equal(im(closed["vector"]), im(list(back))),
    equal(
        closed["row"][1] * back[0] - closed["row"][0] * back[1],
        -s("34") * (back[0] * c(3) + back[1] * s(3)),
    ),
    text="The vector loop closes with S₄ = (p_x sin θ₃ − p_y cos θ₃) / sin α₃₄ and S₃ = p_z − S₄ cos α₃₄ wherever the "
    "secondary cosine law holds: with the last row it is p_x cos θ₃ + p_y sin θ₃ = a₃₄.",
).prove(
    given={
        back: back,
        S[4]: S4,
        S[3]: back[2] - S4 * c("34"),
        a["34"]: back[0] * c(3) + back[1] * s(3),
    }
)
# %% [markdown]
# ## Any two slides
#
# The same holds for every loop of group 2, whatever the order of its joints. Four unknown angles are left, of turns
# about $s_1,\ldots,s_4$ in a ring of four links, and two unknown offsets along directions $p$ and $q$ that are fixed in
# links (a cylindric joint's axis lies in both of its links; link 41 is chosen so that it has none). The first equation
# is $s_4\cdot s_1=\cos\alpha_{41}$. The second is the projection of the vector loop on $p\times q$. Seen from link 23,
# vectors of link 12 turn with $\theta_2$ and those of link 34 with $\theta_3$; those of link 41 are sums of $s_4$,
# $s_1$ and $s_4\times s_1$, so its first two parts are added to the vectors of links 34 and 12. The remainder is
#
# $$(p\times q)\cdot(s_4\times s_1)=(p\cdot q)(s_1\cdot s_4)+(p\times s_1)\cdot(s_4\times q)-(p\cdot s_1)(q\cdot s_4)$$
#
# for slides in two links. Wherever the first equation holds, $s_1\cdot s_4$ is a constant, and with it each term is
# bilinear in $1,\cos,\sin$ of $\theta_2$ and $\theta_3$. Below, functions of $\theta_2$ are tables with the columns
# $1,\cos\theta_2,\sin\theta_2$, those of $\theta_3$ likewise.

# %%
turn_before, turn_after = sp.symbols("phi_1 phi_2", real=True)


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
d.check(
    "any-two-slides",
    *(
        equal(
            (see[name[:2]] * p).cross(see[name[3:]] * q).dot(loop),
            bilinear(table, 2, 3)
            + (
                0
                if name[:2] == name[3:]
                else gamma
                * (see[name[:2]] * p).dot(see[name[3:]] * q)
                * ((see["12"] * s1).dot(see["34"] * s4) - cosine41)
            ),
        )
        for name, table in tables.items()
    ),
    text="For slides in any two links of 12, 23 and 34 the projection is a bilinear table, plus a multiple of the "
    "first equation.",
).prove()

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
d.check(
    "link-41",
    equal(im(parts[0] * z + parts[1] * n + parts[2] * z.cross(n)), im((n[0] ** 2 + n[1] ** 2) * v41)),
    text="The vector of link 41 as a sum of s₄, s₁ and s₄ × s₁; it needs axes that are not parallel.",
).prove(modulo={n_axis.components[2]: dot(n_axis, n_axis) - 1})

# %%
d.check(
    "first-of-any-two-slides",
    equal(bilinear(from_first(s1).T * from_third(s4, middle), 2, 3), (see["12"] * s1).dot(see["34"] * s4)),
    text="The first equation is bilinear at sight.",
).prove()

# %% [markdown]
# ## The self-scalar product
#
# The square of a part of the vector loop is the sum of the squares of its lengths and of twice all products of two of
# them, which are the direction cosines of the notation. It has no angle of the rest of the loop.

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
d.check(
    "self-scalar-product",
    equal(
        dot(im(part), im(part)),
        a["45"] ** 2 + S[5] ** 2 + a["51"] ** 2 + S[1] ** 2 + a["12"] ** 2 + 2 * products,
    ),
    text="For the part a₄₅, S₅, a₅₁, S₁, a₁₂: a₄₅ · S₁ = X̄₅, a₄₅ · a₁₂ = W₁₅, S₅ · a₁₂ = U₁₅.",
).prove()

# %% [markdown]
# ## The mobility formula
#
# The formula counts; it does not see that all motions of a loop can be of one kind.

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
    text="The freedoms of a loop, those of its joints less the rank of their screws, are 6 (n − 1) − Σ (6 − f). For a "
    "four-bar linkage with parallel axes, here at the corners of a square:",
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
# A planar representation draws a link as a line and a joint as its letter, and hatches the link that stands still:
# `rodgen.output.figures.planar_representation`. It shows which links are joined, and the formula above needs no more.
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
M_spherical = d.symbol(
    "M_spherical",
    r"M_\mathrm{spherical}",
    "mobility of the spherical mechanism, whose motions have order 3",
    "1",
    value=3 * (turning - 1) - turning * (3 - 1),
)
d.state(
    "group-of-a-mechanism",
    equal(M_spatial, turning - 3),
    text="The mobility that gives a mechanism its group is written with the index “spatial”. For the RRRCC loop:",
    place="Spherical Mechanism Groups",
).refute(
    {total: 7, turning: 5},
    equal(M_spherical, turning - 3),
    label="M2",
    because="It is that of the equivalent spherical mechanism; the spatial loop has one freedom.",
)

# %% [markdown]
# ## The kernels
#
# Points and directions go along the chain joint by joint, as the functions below say; that they are the formulas above
# is proved of the functions themselves, which the kernels call.


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
        equal(im(seen_back(origin, steps)), im(inverse_transform(along)[:3, 3])),
        equal(im(seen_back(upright, directions_only(steps))), im(along[2, :3].T)),
        equal(im(seen_on(upright, steps)), im(along[:3, 2])),
        text="Joint by joint: the vector of the chain seen from its end, and last row and column of its rotation.",
    ).prove()


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


derivation.kernel(rccc(), rrrcc_pair(), rrrcc_back(), *(ring_pair(slides) for slides in tables))
derivation.kernels
