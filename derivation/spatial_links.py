# %% [markdown]
# # Rotations, links, and the hypothetical link that closes a robot into a loop
#
# How are the joints of a robot described, where is its end for given angles, and how is the robot made a closed loop,
# so that the laws of spherical polygons apply to it? C. Crane's course "Robot Geometry" teaches this after C. Crane and
# J. Duffy's "Kinematic Analysis of Robot Manipulators". Its notes name their subjects and give the formulas of some.
# Here are the first of them, in the order of the course:
#
# 1. rotation and transformation matrices; the matrix of a vector and an angle, and the way back;
# 2. links and joints, the transform from link to link, and the forward analysis of six links with its velocities;
# 3. the seventh, hypothetical link that makes the robot a closed loop.
#
# What is found: the formulas hold but for a sign here and there (L1, L2) and some rules that are stated too widely
# (L3 to L7). And the special cases of the hypothetical link can be avoided altogether, by choosing its free twist.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    LARGEST,
    Derivation,
    cross,
    dot,
    equal,
    in_notebook,
    inverse_transform,
    matrix_from_axis_angle,
    rot,
    select,
    skew,
    transform,
)

d = derivation = Derivation(
    "spatial_links",
    title="Rotations, links, and the hypothetical link",
    source='Crane, "Robot Geometry", notes after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)
im = sp.ImmutableMatrix
cos, sin = sp.cos, sp.sin

# %% [markdown]
# ## Symbols
#
# Link $ij$ joins the joints $i$ and $j=i+1$: its length $a_{ij}$ is measured along the common perpendicular of the
# joints' axes $\vec S_i$ and $\vec S_j$, and its twist $\alpha_{ij}$ about it. Joint $j$ has the offset $S_j$, a signed
# number along $\vec S_j$, and the angle $\theta_j$ about it, both from $\vec a_{ij}$ to $\vec a_{jk}$.

# %%
theta = d.symbol("theta", r"\theta", "angle of a rotation; of a joint", "rad")
alpha = d.symbol("alpha", r"\alpha_{ij}", "twist of a link", "rad")
a = d.symbol("a", r"a_{ij}", "length of a link", "length")
S = d.symbol("S", r"S_j", "offset of a joint", "length")
m = d.vector("m", r"\vec m", "unit vector of a rotation's axis", "1")
along = d.vector("x_C", r"\vec a", "x axis of system C, across m", "1")
across = d.vector("y_C", r"\vec b", "y axis of system C", "1")
q0, q1, q2, q3 = (d.symbol(f"q_{n}", f"q_{n}", "part of a unit quaternion", "1") for n in range(4))
P = d.vector("P", r"\vec P", "origin of a system; of the end frame", "length")
p = d.vector("p", r"\vec p", "a point", "length")
c, s, v = cos(theta), sin(theta), 1 - cos(theta)
mx, my, mz = m
d

# %% [markdown]
# ## Systems of coordinates
#
# ${}^A_BR$ has the axes of system $B$ as its columns, written in system $A$. With $\vec P$, the origin of $B$ in $A$,
# it is the transformation matrix ${}^A_BT=\begin{bmatrix}{}^A_BR&\vec P\\0&1\end{bmatrix}$. Every rotation is that of
# a unit quaternion $(q_0,q_1,q_2,q_3)$, and that is how any rotation is written here.


# %%
def of_quaternion(w, x, y, z):
    """Rotation matrix of a unit quaternion."""
    part = sp.Matrix([x, y, z])
    return sp.eye(3) * (w**2 - part.dot(part)) + 2 * part * part.T + 2 * w * skew(part)


def matrix(name, latex, quantity, value):
    """Enter a matrix into the table of symbols."""
    rows, columns = value.shape
    return d.matrix(name, latex, quantity, "1, length", value=value, rows=rows, columns=columns)


R = of_quaternion(q0, q1, q2, q3)
UNIT = {q0: q0**2 + q1**2 + q2**2 + q3**2 - 1}
T = transform(R, P)
R_AB = matrix("R_AB", "{}^A_BR", "rotation matrix, of a unit quaternion", R)
T_AB = matrix("T_AB", "{}^A_BT", "transformation matrix", T)
T_BA = matrix("T_BA", "{}^B_AT", "transformation matrix of A in B", inverse_transform(T))
one_3, one_4 = im(sp.eye(3)), im(sp.eye(4))
point_1 = matrix(
    "p_1", r"\begin{bmatrix}\vec p\\1\end{bmatrix}", "a point, with a fourth coordinate 1", sp.Matrix([*p, 1])
)
d.state(
    "transformation",
    equal(
        T_AB * point_1,
        matrix(
            "Rp_P_1",
            r"\begin{bmatrix}{}^A_BR\,\vec p+\vec P\\1\end{bmatrix}",
            "the turned and shifted point",
            sp.Matrix([*(R * sp.Matrix(list(p)) + sp.Matrix(list(P))), 1]),
        ),
    ),
    text="A transformation matrix takes the coordinates $\\vec p$ of a point in $B$ to those in $A$.",
    place="Transformation Matrix Definition",
).prove()

# %%
d.state(
    "reverse-transformation",
    equal(T_AB * T_BA, one_4),
    equal(T_BA * T_AB, one_4),
    text="Its inverse ${}^B_AT$ has the transposed rotation, and the origin of $A$ in $B$, $-{}^A_BR^T\\vec P$.",
    place="Reverse Transformation Matrix Definition",
).prove(modulo=UNIT)

# %% [markdown]
# Homogeneous coordinates $(X,Y,Z,w)$ are those of the point $(X,Y,Z)/w$. Where $w\to 0$ the point runs away along
# $(X,Y,Z)$: with $w=0$ it is the point at infinity in this direction, and a transformation only turns it.

# %%
weight = d.symbol("w_h", "w", "last of the homogeneous coordinates, not zero", "1")
direction = d.vector("X", r"\vec X", "first three homogeneous coordinates", "length")
XYZ = sp.Matrix(list(direction))
d.check(
    "homogeneous",
    equal(
        T_AB
        * matrix(
            "X_w",
            r"\begin{bmatrix}\vec X\\w\end{bmatrix}",
            "homogeneous coordinates",
            sp.Matrix([*direction, weight]),
        ),
        matrix(
            "RX_w",
            r"w\begin{bmatrix}{}^A_BR\,\vec X/w+\vec P\\1\end{bmatrix}",
            "w times the transformed point",
            sp.Matrix([*(weight * (R * (XYZ / weight) + sp.Matrix(list(P)))), weight]),
        ),
    ),
    text="Homogeneous coordinates go to those of the transformed point $\\vec X/w$, with the same $w$.",
).prove()

# %%
d.check(
    "point-at-infinity",
    equal(
        T_AB
        * matrix(
            "X_0", r"\begin{bmatrix}\vec X\\0\end{bmatrix}", "a point at infinity", sp.Matrix([*direction, 0])
        ),
        matrix(
            "RX_0",
            r"\begin{bmatrix}{}^A_BR\,\vec X\\0\end{bmatrix}",
            "the turned direction",
            sp.Matrix([*(R * XYZ), 0]),
        ),
    ),
    text="With $w=0$ the matrix turns a direction and does not shift it.",
).prove()

# %% [markdown]
# ## Rotation about a general vector
#
# What is the matrix $R_{\vec m}$ of the rotation by $\theta$ about a unit vector $\vec m$? The notes derive it with an
# auxiliary system $C$ that has its $z$ axis along $\vec m$ and its other axes $\vec a$, $\vec b$ anywhere. $C$ is
# turned about $\vec m$ into system $D$, and $A$ into system $B$; so $B$ is to $D$ as $A$ is to $C$, and
# ${}^A_BR={}^A_CR\,{}^C_DR\,{}^D_BR$ with the rotation ${}^C_DR$ about the $z$ axis.

# %%
ACR = sp.Matrix.hstack(*(sp.Matrix(list(w)) for w in (along, across, m)))


about_m = sp.Matrix(
    [
        [mx**2 * v + c, mx * my * v - mz * s, mx * mz * v + my * s],
        [mx * my * v + mz * s, my**2 * v + c, my * mz * v - mx * s],
        [mx * mz * v - my * s, my * mz * v + mx * s, mz**2 * v + c],
    ]
)
R_AC = matrix("R_AC", "{}^A_CR", "axes a, b, m of C as columns", ACR)
R_CD = matrix("R_CD", "{}^C_DR", "rotation about z", rot("z", theta))
R_m = matrix("R_m", r"R_{\vec m}", "rotation about m", about_m)
in_quaternion = dict(zip((along, across, m), (R[:, 0], R[:, 1], R[:, 2]), strict=True))
d.state(
    "same-relation",
    equal(R_m.T * R_AC * R_CD, R_AC),
    text="The relation of $D$ to $B$ is that of $C$ to $A$: ${}^B_DR={}^A_CR$, with ${}^B_DR=R_{\\vec "
    "m}^T\\,{}^A_CR\\,{}^C_DR$.",
    place="Formula Derivation",
).prove(given=in_quaternion, modulo=UNIT)

# %% [markdown]
# So $R_{\vec m}={}^A_CR\,{}^C_DR\,{}^A_CR^T$. The product still has the components of $\vec a$ and $\vec b$ in it.
# Three rules remove them. *First*, each row of ${}^A_CR$, which are $(a_1,b_1,m_1)$, $(a_2,b_2,m_2)$ and
# $(a_3,b_3,m_3)$, has unit length; *second*, its rows are across each other; *third*, its columns are right-handed,
# $\vec a\times\vec b=\vec m$.

# %%
products = sp.expand(ACR * rot("z", theta) * ACR.T)
first, second, third = (list(w) for w in (along, across, m))
rule_1 = [first[i] ** 2 + second[i] ** 2 - (1 - third[i] ** 2) for i in range(3)]
rule_2 = {
    (i, j): first[i] * first[j] + second[i] * second[j] + third[i] * third[j]
    for i, j in ((0, 1), (0, 2), (1, 2))
}
rule_3 = list(sp.Matrix(list(along)).cross(sp.Matrix(list(across))) - sp.Matrix(list(m)))
d.state(
    "rule-1",
    *(equal(first[i] ** 2 + second[i] ** 2, 1 - third[i] ** 2) for i in range(3)),
    text="First rule: the dot product of a row with itself is one.",
    place="Formula Derivation",
).prove(given=in_quaternion, modulo=UNIT)

# %%
d.state(
    "rule-2",
    *(equal(first[i] * first[j] + second[i] * second[j], -third[i] * third[j]) for i, j in rule_2),
    text="Second rule: the dot product of two rows is zero.",
    place="Formula Derivation",
).prove(given=in_quaternion, modulo=UNIT)

# %%
ax, ay, az = along
bx, by, bz = across
d.state(
    "rule-3",
    equal(im([ay * bz - az * by, ax * bz - az * bx, ax * by - ay * bx]), im([mx, my, mz])),
    text="Third rule: the cross product of the first two columns equals the third column, as the notes write it out.",
    place="Formula Derivation",
    assumptions=[
        *(sp.Eq(first[i] ** 2 + second[i] ** 2 + third[i] ** 2, 1) for i in range(3)),
        *(sp.Eq(rule, 0) for rule in rule_2.values()),
        sp.Eq(dot(along, along), 1),
    ],
).refute(
    {along: (0, 0, 1), across: (1, 0, 0), m: (0, 1, 0)},
    equal(im([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]), im([mx, my, mz])),
    given=in_quaternion,
    modulo=UNIT,
    label="L1",
    because="The component along j is a_z b_x − a_x b_z. With the printed sign the entries (1,3) and (3,1) of the "
    "matrix get m_y s with the wrong sign.",
)

# %% [markdown]
# Each entry of the product is the wanted one plus multiples of expressions that are zero by the rules. These multiples
# are its certificate: the nine equations hold identically, whatever $\vec a$, $\vec b$ and $\vec m$ are.

# %%
certificate = sp.zeros(3, 3)
for i in range(3):
    certificate[i, i] = c * rule_1[i]
for (i, j), rule in rule_2.items():
    k = 3 - i - j
    sign = sp.LeviCivita(i, j, k)
    certificate[i, j] = c * rule - s * sign * rule_3[k]
    certificate[j, i] = c * rule + s * sign * rule_3[k]
for i in range(3):
    for j in range(3):
        d.check(
            f"entry-{i + 1}{j + 1}",
            equal(products[i, j], about_m[i, j] + certificate[i, j]),
            text=f"Entry ({i + 1},{j + 1}): the entry that is wanted, and $\\cos\\theta$ times "
            + (
                f"the first rule for row {i + 1}."
                if i == j
                else f"the second rule for the rows {i + 1} and {j + 1} and $\\sin\\theta$ times the third rule for "
                f"component {4 - i - j}."
            ),
        ).prove()
d.page(
    "entry-11", "entry-12", "entry-13", "entry-21", "entry-22", "entry-23", "entry-31", "entry-32", "entry-33"
)

# %%
d.state(
    "general-rotation",
    equal(R_AC * R_CD * R_AC.T, im(about_m)),
    text="The rotation by the angle $\\theta$ about the unit vector $\\vec m$.",
    place="General Rotation Transformation Matrix",
).prove(
    *(d.entries[f"entry-{i}{j}"] for i in (1, 2, 3) for j in (1, 2, 3)),
    equal(im(certificate), im(sp.zeros(3, 3))),
    given=in_quaternion,
    modulo=UNIT,
    because="Each entry is proved, and what the certificates hold is zero for every rotation matrix.",
)

# %%
d.check(
    "same-as-rotations",
    equal(R_m, c * one_3 + s * skew(m) + v * m * m.T),
    equal(R_m, im(matrix_from_axis_angle(sp.Matrix(list(m)), c, s))),
    text="It is Rodrigues' matrix, which the package computes as `matrix_from_axis_angle` (notebook `rotations`).",
).prove(modulo={mz: dot(m, m) - 1})

# %% [markdown]
# ## Common rotations
#
# For $\vec m$ along an axis the matrix is the elementary rotation about it.

# %%
for axis, unit in (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1))):
    d.state(
        f"about-{axis}",
        equal(
            matrix(
                f"R_e_{axis}",
                rf"R_{{\vec e_{axis}}}",
                f"rotation about m for m along {axis}",
                about_m.subs(dict(zip(m, unit, strict=True))),
            ),
            im(rot(axis, theta)),
        ),
        text=f"The rotation about the {axis} axis.",
        place="Common Rotations",
    ).prove()
d.page("about-x", "about-y", "about-z")

# %% [markdown]
# ## Vector and angle from the matrix
#
# The way back: which vector and which angle belong to a given rotation matrix? Its entries are $R_{m,ij}$, and
# $v=1-\cos\theta$.

# %%
UNIT_M = {mz: dot(m, m) - 1}
versine = d.symbol("v", "v", "1 − cos θ", "1", value=v)
r11, r12, r13, r21, r22, r23, r31, r32, r33 = R_m
trace = r11 + r22 + r33
d.state(
    "trace",
    equal(trace, (mx**2 + my**2 + mz**2) * versine + 3 * c),
    text="The sum of the diagonal (the trace).",
    place="Find Vector and Rotation Angle",
).prove()

# %%
d.state(
    "trace-unit",
    equal(trace, versine - 3 * c),
    text="The same, since $\\vec m$ is a unit vector, as the notes print it.",
    place="Find Vector and Rotation Angle",
    assumptions=[sp.Eq(dot(m, m), 1)],
).refute(
    {theta: 0, m: (0, 0, 1)},
    equal(trace, versine + 3 * c),
    modulo=UNIT_M,
    label="L2",
    because="A sign: the line before has + 3c, and so has the next expression in the same line, (1 − c) + 3c.",
)

# %%
d.state(
    "trace-angle",
    equal(trace, 1 + 2 * c),
    text="So the trace gives the cosine of the angle.",
    place="Find Vector and Rotation Angle",
).prove(modulo=UNIT_M)

# %%
w = d.letter(r"w[3] | \vec w | differences of the entries | 1", sp.Matrix([r32 - r23, r13 - r31, r21 - r12]))
d.state(
    "differences",
    equal(r21 - r12, 2 * mz * s),
    equal(r32 - r23, 2 * mx * s),
    equal(r13 - r31, 2 * my * s),
    text="Differences of the other entries give the vector, times $2\\sin\\theta$.",
    place="Find Vector and Rotation Angle",
).prove()

# %%
d.state(
    "differences-rule",
    equal(r21 - r12, 2 * mz * s),
    equal(r31 - r13, 2 * my * s),
    equal(r32 - r23, 2 * mx * s),
    said="r_ji − r_ij = 2 m_k sin θ for i ≠ j ≠ k and i < j (…) Exception is r13 − r31 = 2 m_y sin θ",
    text="The notes put these into a rule for $i<j$, with one exception. Without the exception it says:",
    place="Find Vector and Rotation Angle",
    assumptions=[sp.Eq(dot(m, m), 1)],
).refute(
    {theta: sp.pi / 2, m: (0, 1, 0)},
    [equal(r21 - r12, 2 * mz * s), equal(r13 - r31, 2 * my * s), equal(r32 - r23, 2 * mx * s)],
    label="L3",
    because="The condition is not i < j: (i,j,k) must be an even permutation of (1,2,3). (1,3,2) is odd, and so the "
    "pair (1,3) is no exception, but has i = 3, j = 1.",
)

# %%
d.state(
    "always-a-vector",
    sp.Ne(s, 0),
    tacit=True,
    text="The differences $2m_k\\sin\\theta$ always determine $\\vec m$: what is divided by is not zero.",
    place="Find Vector and Rotation Angle",
).refute(
    {theta: sp.pi},
    equal(R_m, 2 * m * m.T - one_3),
    given={theta: sp.pi},
    label="L4",
    modulo=UNIT_M,
    because="Not for θ = 0, where every vector is right, nor for θ = π, where the differences are zero and the vector "
    "stands in the symmetric part: its sign is free.",
)

# %%
d.check(
    "sine-and-cosine",
    equal(dot(w, w), (2 * s) ** 2),
    equal(trace - 1, 2 * c),
    text="The length of the vector $\\vec w$ of the three differences is $2\\sin\\theta$, and the trace less one is "
    "$2\\cos\\theta$. The angle by `atan2` of both is right to rounding where the arccosine is not. The package goes "
    "through the quaternion's largest component, so that the vector is right to rounding, too (notebook `rotations`).",
).prove(modulo=UNIT_M)

# %% [markdown]
# The effect in double precision, for angles near 0 and near $\pi$: the largest errors of the angle in radians, by two
# formulas, and of the vector by two ways, over 50 axes, from matrices that are right to rounding.


# %%
if in_notebook():
    from IPython.display import Markdown, display

    from rodgen.derivation.figures import show
    from rodgen.derivation.figures import spatial_links as figures

    display(Markdown(figures.rotation_errors(matrix_from_axis_angle)))

# %% [markdown]
# ## From link to link
#
# A link of a machine may have any shape: what counts is where it holds the axes of its joints. The relative position of
# two lines is given by the length of their common perpendicular and the angle between them about it, $a_{ij}$ and
# $\alpha_{ij}$, and that is the kinematic link. Where the axes meet the length is zero, and either sense of $\vec
# a_{ij}$ may be chosen; parallel axes have a common perpendicular everywhere, and one is chosen. Once the sense is
# fixed the length may be negative. Where the perpendiculars of two neighbouring links meet a joint's axis gives its
# offset and angle.
#
# System $j$ has its $x$ axis along $\vec a_{jk}$, its $z$ axis along $\vec S_j$, and its origin where both meet. The
# transform of link $ij$ and joint $j$ is a screw motion about $\vec a_{ij}$ and one about $\vec S_j$. It is what
# others call modified Denavit-Hartenberg: length and twist come before offset and angle.


# %%
def shift(x=0, y=0, z=0):
    """Translation."""
    return transform(sp.eye(3), [x, y, z])


def link(a, alpha, S, theta):
    """Transform from link to link."""
    return (
        shift(x=a)
        * transform(rot("x", alpha), [0, 0, 0])
        * shift(z=S)
        * transform(rot("z", theta), [0, 0, 0])
    )


ca, sa = cos(alpha), sin(alpha)
written_out = sp.Matrix(
    [
        [c, -s, 0, a],
        [s * ca, c * ca, -sa, -sa * S],
        [s * sa, c * sa, ca, ca * S],
        [0, 0, 0, 1],
    ]
)
shift_a = matrix("T_a", "T_x(a_{ij})", "shift along a", shift(x=a))
turn_alpha = matrix("T_alpha", r"R_x(\alpha_{ij})", "turn about a", transform(rot("x", alpha), [0, 0, 0]))
shift_S = matrix("T_S", "T_z(S_j)", "shift along S", shift(z=S))
turn_theta = matrix("T_theta", r"R_z(\theta_j)", "turn about S", transform(rot("z", theta), [0, 0, 0]))
d.state(
    "link-transform",
    equal(im(written_out), shift_a * turn_alpha * shift_S * turn_theta),
    text="The transform from link to link, written out and as four motions.",
    place="General Link to Link Transformation Matrix",
).prove()

# %% [markdown]
# ### Joints
#
# Two statements of the notes about joints need a correction: that the offset has no sense of direction, and which
# angle of a Hooke joint is a right one. (A Hooke joint is two revolute joints whose axes $\vec S_j$ and $\vec S_k$
# meet at right angles.)

# %%
d.state(
    "offset-without-direction",
    equal(im([0, 0, S]), im([0, 0, -S])),
    said="has no sense of direction",
    text="An offset of a joint and its opposite lead to the same place.",
    place="Joints",
).refute(
    {S: 1},
    equal(shift_S * matrix("T_minus_S", "T_z(-S_j)", "shift by the opposite offset", shift(z=-S)), one_4),
    label="L5",
    because="S_j is a signed number along S_j: opposite offsets lead to opposite sides, and one undoes the other.",
)

# %%
twist_jk = d.symbol("alpha_jk", r"\alpha_{jk}", "twist of the link after joint j", "rad")
axis_i = d.letter(r"S_i_axis[3] | \vec S_i | axis of joint i, in system i | 1", sp.Matrix([0, 0, 1]))
axis_j = d.letter(r"S_j_axis[3] | \vec S_j | axis of joint j, in system i | 1", rot("x", alpha)[:, 2])
axis_k = d.letter(
    r"S_k_axis[3] | \vec S_k | axis of joint k, in system i | 1",
    (rot("x", alpha) * rot("z", theta) * rot("x", twist_jk))[:, 2],
)
d.state(
    "hooke-joint",
    equal(dot(axis_i, axis_k), 0),
    said="α_ik = 90°",
    text="In a Hooke joint of the joints $j$ and $k$ the axes $\\vec S_i$ and $\\vec S_k$ are at right angles.",
    place="Hook Joint, T",
    assumptions=[sp.Eq(dot(axis_j, axis_k), 0)],
).refute(
    {alpha: sp.pi / 2, theta: 0, twist_jk: sp.pi / 2},
    equal(dot(axis_j, axis_k), cos(twist_jk)),
    label="L6",
    because="The right angle is that of the link between the two axes, α_jk. The axes i and k are two links apart and "
    "at any angle: cos α_ij cos α_jk − sin α_ij sin α_jk cos θ_j.",
)

# %% [markdown]
# Revolute and prismatic joints have one variable, $\theta_j$ or $S_j$; a cylindric joint has both, and in a screw joint
# $S_j=S_0+h\theta_j$ with the pitch $h$. The others are rows of these, with links of no length between them. A Hooke
# joint is two revolute ones at right angles; a spherical joint three whose axes meet, which turn to every attitude;
# a plane joint two prismatic ones across each other and a revolute one across both.

# %%
theta_2, theta_3, S_2 = (
    d.symbol("theta_2", r"\theta_2", "angle of a second joint in the row", "rad"),
    d.symbol("theta_3", r"\theta_3", "angle of a third joint in the row", "rad"),
    d.symbol("S_2", "S_2", "offset of a second joint in the row", "length"),
)
corner = sp.pi / 2


def motion(name, latex, quantity, *factors):
    """Name a product of transforms."""
    product = sp.eye(4)
    for factor in factors:
        product = product * factor
    return matrix(name, latex, quantity, product)


still = [0, 0, 0]
d.check(
    "spherical-joint",
    equal(
        motion(
            "three_revolute",
            r"L(0°,\theta_j)\,L(90°,\theta_2)\,L(90°,\theta_3)",
            "three revolute joints at right angles",
            link(0, 0, 0, theta),
            link(0, corner, 0, theta_2),
            link(0, corner, 0, theta_3),
        ),
        motion(
            "zyz",
            r"R_z(\theta_j)\,R_y(-\theta_2)\,R_x(180°)\,R_z(\theta_3)",
            "turns about z, y and z",
            transform(rot("z", theta) * rot("y", -theta_2) * rot("x", sp.pi) * rot("z", theta_3), still),
        ),
    ),
    text="Three revolute joints, each at right angles to the next, turn about one point: about z, y and z, which are "
    "Euler's angles of every attitude. The first two are a Hooke joint. $L(\\alpha,\\theta)$ is the transform of a "
    "link without length and of a joint without offset.",
).prove()

# %%
d.check(
    "plane-joint",
    equal(
        motion(
            "plane_joint",
            r"L_1\,L_2\,L_3",
            "two prismatic joints and a revolute one",
            link(0, 0, S, 0),
            link(0, corner, S_2, corner),
            link(0, corner, 0, theta),
        ),
        motion(
            "plane_place",
            r"T(0,-S_2,S_j)\,R_x(90°)\,R_z(90°)\,R_x(90°)",
            "shift along −y and z, and an attitude",
            transform(rot("x", corner) * rot("z", corner) * rot("x", corner), [0, -S_2, S]),
        )
        * turn_theta,
    ),
    text="A plane joint: two prismatic joints, $L_1$ with the offset $S_j$ and $L_2$ with $S_2$, shift along $-y$ and "
    "$z$, and the revolute joint after them, $L_3$, turns about its own axis.",
).prove()

# %%
d.check(
    "plane-normal",
    equal(
        d.letter(
            r"plane_normal[3] | R_x(90°)\,R_z(90°)\,R_x(90°)\,\vec e_z | axis of that revolute joint | 1",
            (rot("x", corner) * rot("z", corner) * rot("x", corner))[:, 2],
        ),
        im([1, 0, 0]),
    ),
    text="That axis is the normal $x$ of the plane of the two shifts.",
).prove()

# %%
x, y, z = (d.vector(f"{n}_i", rf"\vec {n}", f"{n} axis of system i", "1") for n in "xyz")
before = transform(sp.Matrix.hstack(*(sp.Matrix(list(u)) for u in (x, y, z))), P)


def next_frame(frame, a, ca, sa, S, c, s):
    """Axes and origin of the next system from those of this one, with the least operations."""
    x, y, z, origin = frame
    y_turned, z_turned = ca * y + sa * z, ca * z - sa * y
    return (c * x + s * y_turned, c * y_turned - s * x, z_turned, origin + a * x + S * z_turned)


stepped = next_frame([sp.Matrix(list(u)) for u in (x, y, z, P)], a, ca, sa, S, c, s)
T_Fi = matrix("T_Fi", "{}^F_iT", "system i", before)
T_ij = matrix("T_ij", "{}^i_jT", "transform from link to link", written_out)
T_Fj = matrix("T_Fj", "{}^F_jT", "system j", transform(sp.Matrix.hstack(*stepped[:3]), stepped[3]))
d.check(
    "next-frame",
    equal(T_Fj, T_Fi * T_ij),
    text="The next system, as the package computes it: its axes are those of this one, turned about $x$ by the twist "
    "and about the new $z$ by the joint's angle. It is the product with the transform ${}^i_jT$ from link to link.",
).prove()

# %% [markdown]
# ## Forward analysis
#
# The fixed system has its origin where $\vec a_{12}$ meets $\vec S_1$, and its $z$ axis along $\vec S_1$; $\phi_1$
# is the angle of the first link. Six links give ${}^F_6T={}^F_1T\,{}^1_2T\cdots{}^5_6T$. Its first column is
# $\vec a_{67}$, its third $\vec S_6$, its last the origin of system 6.

# %%
phi = d.symbol("phi", r"\phi_1", "angle of the first link in the fixed system", "rad")
d.check(
    "first-frame",
    equal(
        motion("first_link", r"L(0°,\phi_1)", "transform of a joint with the angle φ1", link(0, 0, 0, phi)),
        motion("turn_phi", r"R_z(\phi_1)", "rotation about z by φ1", transform(rot("z", phi), still)),
    ),
    text="The first system is turned about the first joint's axis.",
).prove()

# %%
tool = d.vector("t", r"\vec t", "tool point in system 6", "length")
x6, y6, z6 = (R[:, n] for n in range(3))
S6, a67_6 = (
    d.vector("S_6", r"\vec S_6", "axis of joint 6", "1", value=z6),
    d.vector("a_6", r"\vec a_{67}", "direction of the link 67", "1", value=x6),
)
tool_F = d.letter(r"P_tool[3] | \vec P_t | tool point in F | length", (T * sp.Matrix([*tool, 1]))[:3, 0])
t1, t2, t3 = tool
d.check(
    "origin-from-tool",
    equal(P, tool_F - t1 * a67_6 - t2 * cross(S6, a67_6) - t3 * S6),
    text="From the tool point $\\vec P_t$ in F back to the origin $\\vec P$ of system 6, with the components of $\\vec "
    "t$ along its axes $\\vec a_{67}$, $\\vec S_6\\times\\vec a_{67}$ and $\\vec S_6$.",
).prove(modulo=UNIT)

# %% [markdown]
# ## Velocities
#
# A joint turns or shifts all that comes after it: with $A$ the system just before its motion and $B$ what follows,
# $T=A\,T_z(S)R_z(\theta)\,B$. The derivative of the motion in the middle is a constant matrix, the twist of the
# joint, times the motion: $\hat\xi_\theta$ turns about $z$, $\hat\xi_S$ shifts along it.

# %%
twist_z, shift_z = sp.zeros(4, 4), sp.Matrix(4, 4, lambda i, j: int(i == 2 and j == 3))
twist_z[:3, :3] = skew(sp.Matrix([0, 0, 1]))
screw = shift(z=S) * transform(rot("z", theta), [0, 0, 0])
xi_theta = matrix("xi_theta", r"\hat\xi_\theta", "twist of a revolute joint about z", twist_z)
xi_S = matrix("xi_S", r"\hat\xi_S", "twist of a prismatic joint along z", shift_z)
d.check(
    "joint-derivative",
    equal(
        matrix(
            "screw_by_theta",
            r"\frac{\partial}{\partial\theta}T_z(S_j)R_z(\theta_j)",
            "by the angle",
            screw.diff(theta),
        ),
        xi_theta * shift_S * turn_theta,
    ),
    equal(
        matrix(
            "screw_by_S", r"\frac{\partial}{\partial S}T_z(S_j)R_z(\theta_j)", "by the offset", screw.diff(S)
        ),
        xi_S * shift_S * turn_theta,
    ),
    text="The derivative of a joint's motion is its twist times the motion.",
).prove()

# %%
carried = sp.zeros(4, 4)
carried[:3, :3] = skew(z6)
carried[:3, 3] = -z6.cross(sp.Matrix(list(P)))
twist_S = matrix(
    "twist_S",
    r"\xi",
    "turns by S, the z axis of B, about the origin P of B: p moves with S × (p − P)",
    carried,
)
d.check(
    "carried-twist",
    equal(T_AB * xi_theta * T_BA, twist_S),
    text="Carried into the fixed system the twist is $\\xi$, the turn about the joint's axis there: a point $\\vec p$ "
    "moves with $\\vec S\\times(\\vec p-\\vec P)$.",
).prove(modulo=UNIT)

# %% [markdown]
# So the column of a revolute joint in the Jacobian is $(\vec S_j;\ \vec S_j\times(\vec P_6-\vec P_j))$, with the
# angular velocity first, and that of a prismatic one $(\vec 0;\ \vec S_j)$.
#
# ## Other conventions
#
# Standard Denavit-Hartenberg has the joint first and the link after it, $R_zT_zT_xR_x$. Regrouped it is the chain
# above with one link more at the end. A product of exponentials gives each joint by its axis where all
# variables are zero.

# %%
turn = d.symbol("turn", "q", "variable of a joint", "rad")
d.check(
    "standard-dh",
    equal(
        turn_theta * shift_S * shift_a * turn_alpha,
        motion("screw", r"\bigl(T_z(S_j)R_z(\theta_j)\bigr)", "screw motion of the joint", screw)
        * motion(
            "link_screw",
            r"\bigl(T_x(a_{ij})R_x(\alpha_{ij})\bigr)",
            "screw motion of the link",
            link(a, alpha, 0, 0),
        ),
    ),
    text="Standard Denavit-Hartenberg on the left is the joint's screw motion and then the link's.",
).prove()

# %%
line = sp.eye(4)
line[:3, :3] = matrix_from_axis_angle(z6, cos(turn), sin(turn))
line[:3, 3] = (sp.eye(3) - line[:3, :3]) * sp.Matrix(list(P))
T_line = matrix("T_line", r"e^{\xi q}", "turn by q about the line along S through P", line)
d.check(
    "exponential",
    equal(
        T_AB * motion("turn_q", "R_z(q)", "rotation about z by q", transform(rot("z", turn), still)),
        T_line * T_AB,
    ),
    text="To turn the joint after its axis is carried somewhere is to turn about the carried line, $e^{\\xi q}$, and "
    "then carry. All joints one after the other make the product of exponentials.",
).prove(modulo=UNIT)

# %%
other = d.vector("p_other", r"\vec p'", "a point of another line", "length")
u = d.vector("u", r"\vec u", "direction of a line", "1")
u_other = d.vector("u_other", r"\vec u'", "direction of another line", "1")
lines = [sp.Matrix(list(w)) for w in (p, u, other, u_other)]
normal = lines[1].cross(lines[3])
gap = lines[2] - lines[0]
foot_value = lines[0] + gap.cross(lines[3]).dot(normal) / normal.dot(normal) * lines[1]
foot_other_value = lines[2] + gap.cross(lines[1]).dot(normal) / normal.dot(normal) * lines[3]
across_both = d.vector("n", r"\vec n", "u × u'", "1", value=normal)
foot = d.vector("f", r"\vec f", "foot p + (((p' − p) × u') · n / n²) u", "length", value=foot_value)
foot_other = d.vector(
    "f_other", r"\vec f'", "foot p' + (((p' − p) × u) · n / n²) u'", "length", value=foot_other_value
)
d.check(
    "common-perpendicular",
    equal(dot(foot_other - foot, u), 0),
    equal(dot(foot_other - foot, u_other), 0),
    equal(foot_other - foot, dot(other - p, across_both) / dot(across_both, across_both) * across_both),
    text="How axes in space become links: the feet $\\vec f$ and $\\vec f'$ of the common perpendicular of two lines "
    "that are not parallel. It is across both lines, and its length is the projection of $\\vec p'-\\vec p$ on the "
    "common normal.",
).prove()

# %% [markdown]
# ## The iterative technique
#
# The reverse analysis asks which angles bring the end to a given pose $T_g$. One may look for where
# $F(\phi_1,\theta_2,\ldots,\theta_6)=\lVert{}^F_6T-T_g\rVert^2$ is least, with the Jacobian above for the steps.
# From one start that gives one solution or none, and from however many starts it never says that there are no more: so
# it is the check here, from 300 starts a pose and without the equations of these notebooks, and not the way.
#
# ## Closing the loop with a hypothetical link
#
# The end frame is given: $\vec S_6$, $\vec a_{67}$ and its origin $\vec P$. A seventh joint and the links 67 and 71
# bring the chain back to the fixed system. The length $a_{67}$ and the twist $\alpha_{67}$ are free; all else follows:
# $\vec S_7=\vec S_6c_{67}+(\vec a_{67}\times\vec S_6)s_{67}$, and the loop
# $\vec P+a_{67}\vec a_{67}+S_7\vec S_7+a_{71}\vec a_{71}+S_1\vec S_1=\vec 0$. From here on $\vec P$ is where the link
# 67 ends, so that $a_{67}\vec a_{67}$ is in it, and $s_{71}=\sin\alpha_{71}$, where $\alpha_{71}$ is the angle from
# $\vec S_7$ to $\vec S_1$.

# %%
a67 = d.symbol("a_67", r"a_{67}", "length of the link 67, free", "length")
alpha67 = d.symbol("alpha_67", r"\alpha_{67}", "twist of the link 67, free", "rad")
alpha71 = d.symbol("alpha_71", r"\alpha_{71}", "twist of the link 71", "rad")
azimuth = d.symbol("beta", r"\beta", "azimuth of S7", "rad")
spin = d.symbol("psi", r"\psi", "angle of a67 about S7", "rad")
azimuth_a = d.symbol("delta", r"\delta", "azimuth of a71", "rad")
r71 = d.symbol("r", "r", "a71 in the special cases", "length", positive=True)
height = d.symbol("h", "h", "height of the loop's open end", "length")
same = d.symbol("e", r"\epsilon", "+1 where S7 and S1 are parallel, −1 where they are opposite", "1")
c67, s67 = cos(alpha67), sin(alpha67)
X_F, S_1 = sp.Matrix([1, 0, 0]), sp.Matrix([0, 0, 1])


def normal_case(S7v, a67v, P, c71, s71):
    """All of the loop where S7 and S1 are not parallel; P is where the link 67 ends."""
    a71v = S7v.cross(S_1) / s71
    S7 = S_1.cross(P).dot(a71v) / s71
    a71 = P.cross(S_1).dot(S7v) / s71
    S1 = P.cross(S7v).dot(a71v) / s71
    return a71v, S7, a71, S1


def turns(S7v, a67v, a71v):
    """Cosine and sine of theta 7 and of gamma 1."""
    seven = a67v.dot(a71v), a67v.cross(a71v).dot(S7v)
    one = a71v.dot(X_F), a71v.cross(X_F).dot(S_1)
    return seven, one


def link_by(a, twist, S, angle):
    """Transform from link to link, by cosines and sines."""
    replaced = {ca: twist[0], sa: twist[1], c: angle[0], s: angle[1], globals()["a"]: a, globals()["S"]: S}
    return written_out.xreplace(replaced)


def loop_of(S7v, a67v, P, twist71, found):
    """The end frame and the links 67 and 71; the twist 67 turns S6 into S7."""
    a71v, S7, a71, S1 = found
    S6 = c67 * S7v - s67 * a67v.cross(S7v)
    seven, one = turns(S7v, a67v, a71v)
    end = transform(sp.Matrix.hstack(a67v, S6.cross(a67v), S6), P - a67 * a67v)
    return end, link_by(a67, (c67, s67), S7, seven), link_by(a71, twist71, S1, one)


c71, s71 = cos(alpha71), sin(alpha71)
S7v = sp.Matrix([s71 * cos(azimuth), s71 * sin(azimuth), c71])
level = sp.Matrix([sin(azimuth), -cos(azimuth), 0])
a67v = cos(spin) * level + sin(spin) * S7v.cross(level)
end_67 = sp.Matrix(list(P))
found = normal_case(S7v, a67v, end_67, c71, s71)
by_loop = loop_of(S7v, a67v, end_67, (c71, s71), found)
LOOP = tuple(
    matrix(name, latex, quantity, value)
    for name, latex, quantity, value in zip(
        ("T_F6", "T_67", "T_71"),
        ("{}^F_6T", "{}^6_7T", "{}^7_1T"),
        ("end frame", "transform over the link 67", "transform over the link 71, with γ1"),
        by_loop,
        strict=True,
    )
)
T_F6, T_67, T_71 = LOOP
axis_7 = d.vector("S_7v", r"\vec S_7", "axis of joint 7", "1", value=S7v)
axis_1 = d.vector("S_1v", r"\vec S_1", "axis of joint 1", "1", value=S_1)
along_67 = d.vector("a_67v", r"\vec a_{67}", "direction of the link 67", "1", value=a67v)
along_71 = d.vector("a_71v", r"\vec a_{71}", "direction of the link 71", "1", value=found[0])
S_7 = d.symbol("S_7", "S_7", "offset of joint 7", "length", value=found[1])
a_71 = d.symbol("a_71", "a_{71}", "length of the link 71", "length", value=found[2])
S_1n = d.symbol("S_1", "S_1", "offset of joint 1", "length", value=found[3])
d.check(
    "normal-lengths",
    equal(s71 * along_71, cross(axis_7, axis_1)),
    equal(s71 * S_7, dot(cross(axis_1, P), along_71)),
    equal(s71 * a_71, dot(cross(P, axis_1), axis_7)),
    equal(s71 * S_1n, dot(cross(P, axis_7), along_71)),
    equal(P + S_7 * axis_7 + a_71 * along_71 + S_1n * axis_1, im(sp.zeros(3, 1))),
    text="Where $s_{71}$ is not zero, the three lengths are triple products of $\\vec P$ with two of the three "
    "directions, and the vector loop closes. The length $a_{71}$ comes out signed.",
).prove()

# %%
d.check(
    "normal-case",
    equal(T_F6 * T_67 * T_71, one_4),
    text="The angles are $\\cos\\theta_7=\\vec a_{67}\\cdot\\vec a_{71}$, $\\sin\\theta_7=(\\vec a_{67}\\times\\vec "
    "a_{71})\\cdot\\vec S_7$, $\\cos\\gamma_1=\\vec a_{71}\\cdot\\vec x$ and $\\sin\\gamma_1=(\\vec a_{71}\\times\\vec "
    "x)\\cdot\\vec S_1$. With $\\gamma_1$ in place of $\\theta_1$ the product of the transforms all the way round is "
    "the unit matrix, so $\\phi_1=\\theta_1-\\gamma_1$. Here $\\vec S_7$ is any vector off the $z$ axis, $\\vec "
    "a_{67}$ any one across it: every pose is one of these.",
).prove()

# %% [markdown]
# ### Special case 1: S7 and S1 are parallel
#
# Then $\vec a_{71}$ is not determined by the directions, and one length is free: $S_7=0$ is chosen. The open end of
# the loop is at $\vec P=(-r\cos\delta,\,-r\sin\delta,\,h)$, and $\vec P+a_{71}\vec a_{71}+S_1\vec S_1=\vec0$.

# %%
S7v_parallel = sp.Matrix([0, 0, same])
a67v_level = sp.Matrix([cos(spin), sin(spin), 0])
end_parallel = sp.Matrix([-r71 * cos(azimuth_a), -r71 * sin(azimuth_a), height])
S1_1 = -end_parallel.dot(S_1)
across_1 = end_parallel + S1_1 * S_1
a71_1 = sp.sqrt(across_1.dot(across_1))
a71v_1 = -across_1 / r71
special = "Special Case 1"
S_1_special = d.letter("S_1_special | S_1' | offset of joint 1 in special case 1 | length", S1_1)
a_71_special = d.letter("a_71_special | a_{71}' | length of the link 71 in special case 1 | length", a71_1)
along_special = d.vector(
    "a_71_direction", r"\vec a_{71}'", "direction of the link 71 in special case 1", "1", value=a71v_1
)
P_special = d.vector(
    "P_special", r"\vec P'", "open end of the loop in special case 1", "length", value=end_parallel
)
d.state(
    "special-1-S1",
    equal(S_1_special, -dot(P_special, axis_1)),
    equal(dot(along_special, axis_1), 0),
    text="The loop times $\\vec S_1$: $S_1=-\\vec P\\cdot\\vec S_1$, since $\\vec a_{71}$ is across $\\vec S_1$. A "
    "prime marks what belongs to this case.",
    place=special,
).prove()

# %%
d.state(
    "special-1-a71",
    equal(a_71_special, r71),
    equal(P_special + r71 * along_special + S_1_special * axis_1, im(sp.zeros(3, 1))),
    text="$a_{71}$ is the length of the vector that remains, $\\vec P+S_1\\vec S_1$, and $\\vec a_{71}$ is "
    "opposite to it.",
    place=special,
).prove(
    a71_1**2 - r71**2,
    equal(P_special + r71 * along_special + S_1_special * axis_1, im(sp.zeros(3, 1))),
    because="Both sides of the first are positive and have one square; the second adds up to zero.",
)

# %%
d.check(
    "special-1",
    equal(T_F6 * T_67 * T_71, one_4),
    text="The transforms close, with $\\alpha_{71}=0$ or $\\pi$; $\\epsilon=\\cos\\alpha_{71}=\\pm1$.",
).prove(
    given=dict(
        zip(
            LOOP,
            loop_of(S7v_parallel, a67v_level, end_parallel, (same, 0), (a71v_1, 0, r71, S1_1)),
            strict=True,
        )
    ),
    modulo={same: same**2 - 1},
)

# %% [markdown]
# The notes go to this case when $\alpha_{71}$ is "very close" to 0° or 180°. It closes the loop only when it is equal:
# otherwise $\vec a_{71}$ is across $\vec S_1$ but not across $\vec S_7$, and no $\theta_7$ has the sine and the cosine.

# %%
a71v_near = sp.Matrix([cos(azimuth_a), sin(azimuth_a), 0])
seven_near, _ = turns(S7v, a67v, a71v_near)
along_near = d.vector("a_near", r"\vec a_{71}'", "a71 of special case 1", "1", value=a71v_near)
c7, s7 = (
    d.symbol(f"{letter}_7", f"{letter}_7", quantity, "1", value=value)
    for letter, quantity, value in zip("cs", ("a67 · a71'", "(a67 × a71') · S7"), seven_near, strict=True)
)
d.state(
    "very-close",
    equal(c7**2 + s7**2, 1),
    said="problems are encountered when α71 is very close to either 0 or 180 degrees. The first step to solving "
    "special case one is to set S7 equal to zero (…) Now the same series of sin and cos equations as the normal case "
    "can be used to find the remaining angles",
    text="In special case 1, $c_7=\\vec a_{67}\\cdot\\vec a_{71}'$ and $s_7=(\\vec a_{67}\\times\\vec "
    "a_{71}')\\cdot\\vec S_7$ are "
    "cosine and sine of an angle $\\theta_7$ also where $\\alpha_{71}$ is only close to 0.",
    place=special,
    assumptions=[sp.Lt(sp.Abs(s71), sp.Rational(1, 500))],
).refute(
    {alpha71: 2 * sp.atan(sp.Rational(1, 1000)), azimuth: 0, spin: 0, azimuth_a: 0},
    equal(c7**2 + s7**2, 1 - dot(along_near, axis_7) ** 2),
    label="L7",
    because="Only where S7 and S1 are parallel is a71 across both. With S7 = 0 the loop misses by up to |P| s71; "
    "without, rounding is multiplied by 1/s71. In double precision the two are alike at s71 = 1e-8, which is the "
    "default tolerance here.",
)

# %% [markdown]
# By how much the loop fails to close, in double precision, solved by either case: of a loop with $|\vec P|=10$, the
# largest of 60 poses for each angle between the axes. The two lines cross at $s_{71}=10^{-8}$.


# %%
def tolerance_table():
    """Return by how much the loop misses, solved as the normal case and as special case 1, as a Markdown table."""
    import numpy as np

    lines = ["| s71 | normal case | special case 1 |", "| --- | --- | --- |"]
    random = np.random.default_rng(0)
    inputs = (*S7v, *a67v, *end_67)
    names = sp.symbols("n1:10")
    made = dict(zip(names, inputs, strict=True))
    general, near = sp.symbols("c71 s71")
    numbers = sp.Matrix(names[:3]), sp.Matrix(names[3:6]), sp.Matrix(names[6:])
    level = sp.Matrix([-names[6], -names[7], 0]) / sp.sqrt(names[6] ** 2 + names[7] ** 2)
    cases = (
        (normal_case(*numbers, general, near), (general, near)),
        ((level, 0, sp.sqrt(names[6] ** 2 + names[7] ** 2), -names[8]), (sp.S.One, sp.S.Zero)),
    )
    product = [
        sp.lambdify(
            (*names, general, near),
            [part.subs({alpha67: sp.pi / 2, a67: 0}) for part in loop_of(*numbers, twist, found)],
            "numpy",
        )
        for found, twist in cases
    ]
    point = sp.lambdify((alpha71, azimuth, spin), [made[n] for n in names[:6]], "numpy")
    for power in (2, 4, 6, 8, 10):
        sine = 10.0**-power
        worst = np.zeros(2)
        for _ in range(60):
            place = random.normal(size=3)
            place *= 10 / np.linalg.norm(place)
            given = [
                *point(np.arcsin(sine), *random.uniform(-3, 3, size=2)),
                *place,
                np.sqrt(1 - sine**2),
                sine,
            ]
            for number, evaluate in enumerate(product):
                first, second, third = (np.array(part, float) for part in evaluate(*given))
                worst[number] = max(worst[number], np.abs((first @ second @ third)[:3, 3]).max())
        lines.append(f"| 1e-{power} | {worst[0]:.0e} | {worst[1]:.0e} |")
    return "\n".join(lines)


if in_notebook():
    display(Markdown(tolerance_table()))

# %% [markdown]
# ### Special case 2: the lines of S7 and S1 are the same
#
# Then $\vec P=(0,0,h)$, and an angle is free as well: $\theta_7=0$ is chosen.

# %%
d.state(
    "special-2",
    equal(T_F6 * T_67 * T_71, one_4),
    equal(
        matrix(
            "turn_7",
            r"\begin{bmatrix}\cos\theta_7\\\sin\theta_7\end{bmatrix}",
            "for a71 along a67",
            sp.Matrix(turns(S7v_parallel, a67v_level, a67v_level)[0]),
        ),
        im([1, 0]),
    ),
    text="With $S_7=0$, $\\theta_7=0$, $a_{71}=0$ and $\\vec a_{71}$ along $\\vec a_{67}$ the transforms close.",
    place="Special Case 2",
).prove(
    given=dict(
        zip(
            LOOP,
            loop_of(
                S7v_parallel,
                a67v_level,
                sp.Matrix([0, 0, height]),
                (same, 0),
                (a67v_level, 0, 0, -height),
            ),
            strict=True,
        )
    ),
    modulo={same: same**2 - 1},
)

# %% [markdown]
# ### No need for special cases
#
# The loop closes for every $\alpha_{67}$, and the robot does not depend on it. Of 45° and 135°, whose $\vec S_7$ are at
# right angles, one always has $s_{71}\ge\sin45°$. So this package takes 90°, as the notes do, where that is as good,
# and else the better of these two. $\vec S_{7,45}$ and $\vec S_{7,135}$ are the axes $\vec S_7$ for the two twists.

# %%
S6v = sp.Matrix(list(z))
a67v_any = sp.Matrix(list(x))
level_z = a67v_any.cross(S6v)
half, three = sp.pi / 4, 3 * sp.pi / 4
S7_at = {angle: S6v * cos(angle) + level_z * sin(angle) for angle in (half, three)}
by_R = {x: x6, z: z6}
S7_half, S7_three = (
    d.letter(
        rf"S_7_{name}[3] | \vec S_{{7,{name}}} | axis of joint 7 for a twist of {name}° | 1", S7_at[angle]
    )
    for name, angle in (("45", half), ("135", three))
)
d.check(
    "chosen-twist",
    equal(dot(S7_half, S7_three), 0),
    equal(dot(S7_half, axis_1) ** 2 + dot(S7_three, axis_1) ** 2, 1 - dot(x, axis_1) ** 2),
    text="The cosines $c_{71}$ are the scalar products with $\\vec S_1$. The squares of the two add up to at most 1, "
    "so the smaller one is at most ½.",
).prove(given=by_R, modulo=UNIT)

# %% [markdown]
# ## The functions of the package
#
# The steps of the functions, with their inputs as letters, are compared with the transform from link to link. The
# status of the hypothetical link says which case was met.


# %%
class HypotheticalStatus(IntEnum):
    """How a robot's end frame is closed into a loop.

    NORMAL: the axes S7 and S1 are not parallel.
    PARALLEL: they are, to the tolerance, and S7 = 0 was chosen (special case 1).
    COINCIDENT: they are on one line, and S7 = 0 and theta7 = 0 were chosen (special case 2).
    INVALID: the pose is not finite or no pose, or a number is not finite; the values are NaN.
    """

    NORMAL = 0
    PARALLEL = 1
    COINCIDENT = 2
    INVALID = 3


SOURCE = "derivation spatial_links; Crane and Duffy"


def frame_of(T):
    """Axes and origin of a transformation matrix."""
    return tuple(T[:3, n] for n in range(4))


def named_frame(k, name, frame):
    """Name the components of a system."""
    return tuple(k.let(f"{part}_{name}", vector) for part, vector in zip("xyzp", frame, strict=True))


def matrix_of(frame):
    """Transformation matrix of axes and origin."""
    return transform(sp.Matrix.hstack(*frame[:3]), frame[3])


def step_kernel():
    k = KernelBuilder("link_step", summary="Go from one link's system to the next.", source=SOURCE)
    frame = k.input("frame", (4, 4), unit="1 and length", doc="system of the link before")
    a = k.input("a", unit="length", doc="length of the link")
    cosine = k.input("cos_alpha", unit="1", doc="cosine of its twist")
    sine = k.input("sin_alpha", unit="1", doc="sine of its twist")
    S = k.input("offset", unit="length", doc="offset of the joint")
    angle = k.input("angle", unit="rad", doc="angle of the joint")
    turned = k.let("c", cos(angle)), k.let("s", sin(angle))
    found = next_frame(frame_of(frame), a, cosine, sine, S, *turned)
    k.output("next_frame", matrix_of(found), unit="1 and length", doc="system of the link after the joint")
    return k.build()


def inverse_kernel():
    k = KernelBuilder("link_inverse", summary="Invert a transformation matrix.", source=SOURCE)
    T = k.input("transform", (4, 4), unit="1 and length", doc="rotation and origin")
    k.output("inverse", inverse_transform(T), unit="1 and length", doc="the inverse transformation")
    return k.build()


def six_links(k):
    """The systems of six revolute joints, one after the other."""
    a = k.input("a", 5, unit="length", doc="a12 to a56")
    cosine = k.input("cos_alpha", 5, unit="1", doc="cosines of alpha12 to alpha56")
    sine = k.input("sin_alpha", 5, unit="1", doc="their sines")
    S = k.input("offset", 6, unit="length", doc="S1 to S6")
    angle = k.input("angle", 6, unit="rad", doc="phi1, theta2 to theta6")
    c = k.let("c", sp.Matrix([cos(x) for x in angle]))
    s = k.let("s", sp.Matrix([sin(x) for x in angle]))
    frame = (sp.Matrix([c[0], s[0], 0]), sp.Matrix([-s[0], c[0], 0]), S_1, sp.Matrix([0, 0, S[0]]))
    frames = [frame]
    for n in range(1, 6):
        frame = next_frame(frames[-1], a[n - 1], cosine[n - 1], sine[n - 1], S[n], c[n], s[n])
        frames.append(named_frame(k, "_abcdef"[n + 1], frame))
    return frames


def forward_kernel():
    k = KernelBuilder("link_forward_6r", summary="End frame of six revolute joints.", source=SOURCE)
    k.output("pose", matrix_of(six_links(k)[-1]), unit="1 and length", doc="end frame in the fixed system")
    return k.build()


def jacobian_kernel():
    k = KernelBuilder(
        "link_jacobian_6r", summary="Jacobian of the end frame of six revolute joints.", source=SOURCE
    )
    frames = six_links(k)
    end = frames[-1][3]
    columns = [z.col_join(z.cross(end - origin)) for _, _, z, origin in frames]
    k.output(
        "jacobian",
        sp.Matrix.hstack(*columns),
        unit="1 and length",
        doc="angular velocity and velocity of the end frame's origin, a column a joint, in the fixed system",
    )
    return k.build()


def hypothetical_kernel():
    k = KernelBuilder(
        "hypothetical_link", summary="Close a robot into a loop with a hypothetical link.", source=SOURCE
    )
    pose = k.input("pose", (4, 4), unit="1 and length", doc="end frame in the fixed system")
    a67 = k.input("a67", unit="length", doc="length of the link 67, free")
    alpha67 = k.input("alpha67", unit="rad", doc="twist of the link 67, free")
    tolerance = k.input("tolerance", unit="1", doc="largest sine between axes that count as parallel")
    x, y, z, origin = frame_of(pose)
    # a67 × S6 = −y
    S7v = k.let("S7v", z * cos(alpha67) - y * sin(alpha67))
    P = k.let("end", origin + a67 * x)
    sine = k.let("sine", sp.sqrt(S7v[0] ** 2 + S7v[1] ** 2))
    level = k.let("level_length", sp.sqrt(P[0] ** 2 + P[1] ** 2))
    size = k.let("size", sp.sqrt(P.dot(P)))
    skewed = k.let("skewed", sine > tolerance)
    apart = k.let("apart", level > tolerance * size)
    one = sp.S.One
    a71v, S7, a71, S1 = normal_case(S7v, x, P, S7v[2], k.let("divisor", select(skewed, sine, one)))
    outward = -sp.Matrix([P[0], P[1], 0]) / select(apart, level, one)
    a71v = k.let("a71v", a71v)
    chosen = k.let("chosen", select(skewed, a71v, select(apart, outward, x)))
    seven, gamma = turns(S7v, x, chosen)
    gram = pose[:3, :3].T * pose[:3, :3] - sp.eye(3)
    deviation = k.let("deviation", sum((abs(entry) for entry in gram), sp.S.Zero))
    volume = k.let("volume", x.dot(y.cross(z)))
    finite = abs(P[0]) + abs(P[1]) + abs(P[2]) + abs(alpha67) + abs(tolerance) <= LARGEST
    good = k.let("good", finite & (deviation <= sp.Rational(1, 1000)) & (volume > 0))
    zero = sp.S.Zero
    coincident = sp.Not(skewed) & sp.Not(apart)
    for name, value, unit, doc in (
        ("S7", select(skewed, S7.xreplace({}), zero), "length", "offset of the joint 7"),
        ("theta7", select(coincident, zero, sp.atan2(seven[1], seven[0])), "rad", "angle of the joint 7"),
        ("a71", select(skewed, a71, select(apart, level, zero)), "length", "length of the link 71"),
        (
            "alpha71",
            select(skewed, sp.atan2(sine, S7v[2]), select(S7v[2] > 0, zero, sp.pi)),
            "rad",
            "twist of the link 71",
        ),
        ("S1", select(skewed, S1, -P[2]), "length", "offset of the joint 1 in the loop"),
        ("gamma1", sp.atan2(gamma[1], gamma[0]), "rad", "theta1 less phi1"),
    ):
        k.output(name, select(good, value, sp.nan), unit=unit, doc=doc)
    status = sp.Piecewise(
        (HypotheticalStatus.INVALID, sp.Not(good)),
        (HypotheticalStatus.NORMAL, skewed),
        (HypotheticalStatus.PARALLEL, apart),
        (HypotheticalStatus.COINCIDENT, True),
        evaluate=False,
    )
    k.status("status", status, HypotheticalStatus, doc="which case it is")
    return k.build()


kernels = {
    made.name: made
    for made in (step_kernel(), inverse_kernel(), forward_kernel(), jacobian_kernel(), hypothetical_kernel())
}
made_frame = kernels["link_step"].expand("next_frame")
by_port = kernels["link_step"].substitution(
    a=a, offset=S, angle=theta, cos_alpha=ca, sin_alpha=sa, frame=list(before)
)
d.check(
    "kernel-step",
    equal(T_Fj, T_Fi * T_ij),
    text="The next system of `link_step` is the product with the transform from link to link.",
).prove(given={T_Fj: made_frame.xreplace(by_port)})


# %%
def step_of_forward(n):
    """System n by the kernel of six links, from the letters of system n − 1."""
    kernel = kernels["link_forward_6r"]
    last, this = "_abcdef"[n - 1], "_abcdef"[n]
    kept = [kernel[f"{part}_{last}"] for part in "xyzp"] if n > 2 else []
    if n < 6:
        steps = [kernel.expand(kernel[f"{part}_{this}"], keep=kept) for part in "xyzp"]
        found = transform(sp.Matrix.hstack(*steps[:3]), steps[3])
    else:
        found = kernel.expand("pose", keep=kept)
    vectors = zip("xyzp", (x, y, z, P), strict=True) if n > 2 else ()
    here = kernel.substitution(**{f"{part}_{last}": list(vector)[:3] for part, vector in vectors})
    length, cosine, sine, offset, angle = (
        kernel[name] for name in ("a", "cos_alpha", "sin_alpha", "offset", "angle")
    )
    by_letters = {length[n - 2]: a, cosine[n - 2]: ca, sine[n - 2]: sa, offset[n - 1]: S, angle[n - 1]: theta}
    first = transform(rot("z", phi), [0, 0, offset[0]])
    by_first = {angle[0]: phi}
    wanted = (before if n > 2 else first) * written_out
    return im(found.xreplace(here | by_letters | by_first)) - im(wanted)


d.check(
    "kernel-forward",
    equal(T_Fj, T_Fi * T_ij),
    text="`link_forward_6r` goes from each system to the next by the product with that link's transform.",
).prove(
    *(step_of_forward(n) for n in range(2, 7)),
    because="The five steps, written in the letters of the system before, are that product.",
)

# %% [markdown]
# ## Flow chart of the hypothetical link
#
# The steps of `hypothetical_link`, from the pose of the end to the closed loop.

# %%
if in_notebook():
    show(figures.flow_chart())

# %%
derivation.kernel(*kernels.values())
