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
# # The Tricept: kinematics and its derivatives
#
# Three telescopic rods carry a platform; a fourth rod, fixed to the platform, slides and swings in the middle of the
# base and keeps it from turning about that rod. E. Kureková, M. Omachelová, M. Halaj and I. Martišovitš
# ("Positioning uncertainty of the Tricept type parallel kinematic structure", Acta IMEKO 4(4), 2015, 9-15) give the
# position of a point of the platform, the lengths of the rods, and the derivatives from which the uncertainty of the
# point follows.
#
# Here their equations (1) to (23) and their Table 1 are taken one by one. Each is proved, or refuted by an exact
# counterexample and corrected. Equation (24), a numerical result over a cube, is an *outer enclosure*
# and not the range that it is taken for; the notebook `tricept_uncertainty` proves that. After the paper comes what
# it leaves out: all four poses of a point, the determinants, the direct problem, and the kernels.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    coordinate_rotation,
    equal,
    matrix_from_axis_angle,
    select,
)

derivation = Derivation(
    "tricept",
    title="The Tricept: pose, rods, derivatives, singularities",
    source='Kureková, Omachelová, Halaj and Martišovitš, "Positioning uncertainty of the Tricept type parallel '
    'kinematic structure", Acta IMEKO 4(4), 2015',
)
d = derivation
im = sp.ImmutableMatrix

# %% [markdown]
# ## Symbols
#
# The pose is $(\alpha,\beta,z)$. Rods and joints are counted as the paper does: $A_0$ goes from $A$ to $A'$, at 0°,
# $A_1$ from $B$ to $B'$, at +120°, and $A_{-1}$ from $C$ to $C'$, at −120°. Parameters stand in the order
# $A_0, A_1, A_{-1}, r, R$ of the paper's (22); its Table 1 has $R$ before $r$.

# %%
alpha = d.symbol("alpha", r"\alpha", "angle about x, in the paper's sense", "rad")
beta = d.symbol("beta", r"\beta", "angle about y", "rad")
z = d.symbol("z", "z", "shift along the middle rod", "length")
R = d.symbol("R", "R", "radius of the joints of the base", "length", positive=True)
r = d.symbol("r", "r", "radius of the joints of the platform", "length", positive=True)
q = d.vector("q", r"\vec q", "point of the platform, from its centre P'", "length")
Q = d.vector("Q", r"\vec Q", "that point, from the centre P of the base", "length")
A0 = d.symbol("A_0", "A_0", "length of the rod AA'", "length", positive=True)
A1 = d.symbol("A_1", "A_1", "length of the rod BB'", "length", positive=True)
Am = d.symbol("A_m1", "A_{-1}", "length of the rod CC'", "length", positive=True)
S = d.symbol("S", "S", "sign of the first root, +1 or −1", "1")
K = d.symbol("K", "K", "sign of the second root, +1 or −1", "1")
qx, qy, qz = q
Qx, Qy, Qz = Q
sa, ca, sb, cb = sp.sin(alpha), sp.cos(alpha), sp.sin(beta), sp.cos(beta)
rods = (A0, A1, Am)
pose = (alpha, beta, z)
parameters = (A0, A1, Am, r, R)

Oy = d.matrix("O_y", r"O_y", "rotation by β", "1", value=coordinate_rotation("y", cb, sb))
Ox = d.matrix("O_x", r"O_x", "the paper's rotation by α", "1", value=coordinate_rotation("x", ca, sa).T)
OY, OX = d.value(Oy), d.value(Ox)
turned = OY * OX
shifted = sp.Matrix([qx, qy, qz + z])
by_pose = {Q: turned * shifted}

# %% [markdown]
# ## The point
#
# Equation (1) turns the shifted point. Its $O_y$ is the right-handed rotation about $y$; its $O_x$ is the
# *transposed* of the right-handed rotation about $x$, so a positive $\alpha$ moves the platform's centre towards
# $+y$. The paper's (16), (17), (19) and its $\sin\alpha$ all need it that way, so it is a convention, which this
# package keeps.

# %%
d.state(
    "eq-1",
    equal(Q, Oy * Ox * im(shifted)),
    equal(Oy, im(matrix_from_axis_angle(sp.Matrix([0, 1, 0]), cb, sb))),
    text="The point of the platform, turned and shifted; O_y is the right-handed rotation.",
    place="eq. (1)",
).prove(given=by_pose)
d.state(
    "Ox",
    equal(Ox, im(matrix_from_axis_angle(sp.Matrix([1, 0, 0]), ca, sa))),
    said="rotation about the x axis by the angle α (represented by orthogonal matrix Ox(α))",
    place="before eq. (1)",
).refute(
    {alpha: sp.pi / 2},
    equal(Ox, im(matrix_from_axis_angle(sp.Matrix([1, 0, 0]), ca, -sa))),
    label="T1",
    because="The printed matrix is the rotation by −α in the right-handed sense, in which O_y is the rotation by β.",
)
usual = OY * matrix_from_axis_angle(sp.Matrix([1, 0, 0]), ca, sa) * shifted
d.state(
    "usual-Ox",
    equal(-Qy + qy * ca + (qz + z) * sa, 0),
    tacit=True,
    text="Equation (16), when O_x is the right-handed rotation that the words say.",
    place="eq. (16)",
).refute(
    {alpha: sp.atan(sp.Rational(3, 4)), beta: 0, z: 600, q: (0, 0, 0)},
    equal(-Qy + qy * ca - (qz + z) * sa, 0),
    given={Q: usual},
    label="T2",
    because="With the right-handed O_x the sign of α is the other one throughout: in (2), (4), (8), (16), (17), (19) "
    "and sin α.",
)

# %% [markdown]
# ## The rods
#
# The joints of the base are at $R(\cos 120°k, \sin 120°k, 0)$, those of the platform at $r(\cos 120°k, \sin 120°k,
# 0)$ from its centre.

# %%
directions = {k: sp.Matrix([sp.cos(2 * sp.pi * k / 3), sp.sin(2 * sp.pi * k / 3), 0]) for k in (0, 1, -1)}
joints = [turned * (r * e + sp.Matrix([0, 0, z])) for e in directions.values()]
vectors = [joint - R * e for joint, e in zip(joints, directions.values(), strict=True)]
squares = [sp.expand(v.dot(v)) for v in vectors]  # of the rods' lengths, A0, A1, A-1
bracket = cb * r / 4 + ca * (r * sp.Rational(3, 4) - z * sb / 2)
side = sp.sqrt(3) / 2 * sa * (z + r * sb / 2)
length_m = sp.sqrt(z**2 + r**2 + R**2 - 2 * R * (bracket - side))
length_0 = sp.sqrt(z**2 + r**2 + R**2 - 2 * R * (r * cb + z * sb * ca))
length_1 = sp.sqrt(z**2 + r**2 + R**2 - 2 * R * (bracket + side))
by_joints = {rod: sp.sqrt(square) for rod, square in zip(rods, squares, strict=True)}
for number, rod, printed in ((2, Am, length_m), (3, A0, length_0), (4, A1, length_1)):
    d.state(f"eq-{number}", equal(rod, printed), text="Length of a rod.", place=f"eq. ({number})").prove(
        squares[rods.index(rod)] - printed**2,
        because="Both are positive, and the squares of the distance of the two joints and of the formula are equal.",
    )

home = d.symbol("home", r"z_h", "shift at which the changes of length are counted from", "length")
change = [sp.sqrt(s) - sp.sqrt(s.subs({alpha: 0, beta: 0, z: home})) for s in squares]
d.state(
    "changes",
    equal(A0, change[0]),
    said="Let A0 be the change in length of rod AA'",
    place="before eq. (2)",
).refute(
    {alpha: 0, beta: 0, z: 456, home: 456, R: 330, r: 140},
    equal(A0**2, im(vectors[0]).dot(im(vectors[0]))),
    given=by_joints,
    label="T3",
    because="(2) to (4) and Table 1 are the lengths of the rods from joint to joint, 494 mm there, not changes.",
)

# %% [markdown]
# ## The poses of a point
#
# The conditions below (4), with $u=\sqrt{|\vec Q|^2-q_x^2-q_y^2}$ and $g=\sqrt{Q_x^2+Q_z^2-q_x^2}$. The paper takes
# both signs as +1; all four pairs of signs are poses.

# %%
u = d.symbol("u", "u", "√(|Q|² − q_x² − q_y²)", "length", positive=True)
g = d.symbol("g", "g", "√(Q_x² + Q_z² − q_x²)", "length", positive=True)
roots = {
    S: S**2 - 1,
    K: K**2 - 1,
    u: u**2 - (Qx**2 + Qy**2 + Qz**2 - qx**2 - qy**2),
    g: g**2 - (Qx**2 + Qz**2 - qx**2),
}
level, whole = Qx**2 + Qz**2, Qx**2 + Qy**2 + Qz**2 - qx**2
sin_beta, cos_beta = (-qx * Qz + K * Qx * g) / level, (qx * Qx + K * Qz * g) / level
sin_alpha, cos_alpha = (S * Qy * u - K * qy * g) / whole, (S * K * u * g + qy * Qy) / whole
by_formula = {sa: sin_alpha, ca: cos_alpha, sb: sin_beta, cb: cos_beta, z: -qz + S * u}
d.state(
    "inverse",
    equal(z, -qz + S * u),
    equal(sb, sin_beta),
    equal(cb, cos_beta),
    equal(sa, sin_alpha),
    equal(ca, cos_alpha),
    text="Pose of a given point; the roots are written u and g.",
    place="conditions below eq. (4)",
    assumptions=["both roots are real", sp.Ne(level, 0)],
).prove(
    (turned * shifted).xreplace(by_formula) - sp.Matrix(list(Q)),
    sin_beta**2 + cos_beta**2 - 1,
    sin_alpha**2 + cos_alpha**2 - 1,
    modulo=roots,
    because="They are sines and cosines, and put into (1) they give the point, for all four pairs of signs and any q.",
)
across = Qz * cb + Qx * sb
d.check(
    "four-poses",
    equal((Qx * cb - Qz * sb) ** 2 + across**2, Qx**2 + Qz**2),
    equal(qy**2 + (qz + z) ** 2, Qy**2 + across**2),
    equal(qx, Qx * cb - Qz * sb),
    equal(Qy, qy * ca + (qz + z) * sa),
    equal(across, (qz + z) * ca - qy * sa),
    text="There are no others: (1) fixes Q_x cos β − Q_z sin β = q_x, so Q_z cos β + Q_x sin β is g or −g, and then "
    "q_z + z is u or −u. Each choice gives both angles by linear equations.",
).prove(given=by_pose)
d.check(
    "opposite-pose",
    equal(
        im(
            (turned * sp.Matrix([0, 0, z])).subs(
                {alpha: sp.pi - alpha, beta: beta + sp.pi}, simultaneous=True
            )
        ),
        im(turned * sp.Matrix([0, 0, z])),
    ),
    equal(
        im(turned.subs({alpha: sp.pi - alpha, beta: beta + sp.pi}, simultaneous=True)),
        im(turned * sp.diag(-1, -1, 1)),
    ),
    text="For q = 0 the pose with K = −1 is the platform turned by half a turn about its middle rod. The lengths of "
    "the rods alone do not exclude it; the machine's joints do.",
).prove()

# %% [markdown]
# ## The change of the point with the pose

# %%
d_alpha, d_beta, dz = (
    d.symbol(f"d_{name}", latex, f"small change of {name}", unit)
    for name, latex, unit in (
        ("alpha", r"d\alpha", "rad"),
        ("beta", r"d\beta", "rad"),
        ("z", "dz", "length"),
    )
)
true_M33 = (turned * shifted).jacobian(sp.Matrix(pose))
M33 = d.matrix("M33", "M_{33}", "derivatives of Q by the pose", "mixed", value=true_M33)
scale = d.symbol("scale", r"\lambda", "how many of a smaller unit of length are one of the larger", "1")
change_of_point = equal(
    im(turned * shifted).diff(alpha) * d_alpha
    + im(turned * shifted).diff(beta) * d_beta
    + im(turned * shifted).diff(z) * dz,
    M33 * im([d_alpha, d_beta, dz]),
)
d.state(
    "eq-5",
    change_of_point,
    text="The change of the point.",
    place="eq. (5)",
).prove()
d.state(
    "dimensionless",
    equal(im([d_alpha, d_beta, scale * dz]), im([d_alpha, d_beta, dz])),
    said="a dimensionless vector of rotations and displacement",
    text="Such a vector is the same in every unit of length.",
    place="before eq. (5)",
).refute(
    {d_alpha: 0, d_beta: 0, dz: 1, scale: 1000},
    equal(
        scale * M33 * im([d_alpha, d_beta, dz]),
        im.hstack(scale * im(true_M33[:, :2]), im(true_M33[:, 2])) * im([d_alpha, d_beta, scale * dz]),
    ),
    label="T4",
    because="dz is a length. The columns of M33 have different units: length for the angles, none for z.",
)

# %% [markdown]
# ## Squares instead of roots
#
# The sums (7) to (9) of the squared lengths have no roots. They are $-\frac13$, $\frac1{\sqrt3}$ … times the squares
# of (2) to (4): three independent combinations, so they hold exactly where the three lengths are right.

# %%
T0 = sp.Matrix(
    [
        [-sp.Rational(1, 3)] * 3,
        [0, 1 / sp.sqrt(3), -1 / sp.sqrt(3)],
        [sp.Rational(2, 3), -sp.Rational(1, 3), -sp.Rational(1, 3)],
    ]
)
L = sp.Matrix(
    [
        -(A0**2 + A1**2 + Am**2) / 3 + R**2 + r**2 + z**2 - R * r * ca - R * r * cb,
        (A1**2 - Am**2) / sp.sqrt(3) + 2 * R * z * sa + R * r * sa * sb,
        (2 * A0**2 - A1**2 - Am**2) / 3 + 2 * R * z * ca * sb + R * r * cb - R * r * ca,
    ]
)
d.state("eq-7", equal(L[0], 0), text="Sum of the squares.", place="eq. (7)").prove(given=by_joints)
d.state(
    "eq-8",
    equal((-(A1**2) - Am**2) / sp.sqrt(3) + 2 * R * z * sa + R * r * sa * sb, 0),
    text="Difference of two squares, if the third of the minus signs that stand in the print belongs to A₁².",
    place="eq. (8)",
).refute(
    {alpha: 0, beta: 0, z: 456, R: 330, r: 140},
    equal(L[1], 0),
    given=by_joints,
    label="T5",
    because="The equation holds with A₁² − A₋₁², which needs two minus signs, one of them that of the index; the print "
    "has three. Row 2 of W35 has one too many in the same way.",
)
d.state("eq-9", equal(L[2], 0), text="The third combination.", place="eq. (9)").prove(given=by_joints)
d.check(
    "combinations",
    equal(im(L), im(T0 * sp.Matrix([rod**2 - square for rod, square in zip(rods, squares, strict=True)]))),
    equal(T0.det(), 2 / (3 * sp.sqrt(3))),
    text="L₁, L₂, L₃ are a regular combination of the three equations A² = |joint − joint|², so all three vanish if "
    "and only if the three lengths are right.",
).prove()

# %%
W33 = L.jacobian(sp.Matrix(pose))
W35 = L.jacobian(sp.Matrix(parameters))
printed_W33 = sp.Matrix(
    [
        [R * r * sa, R * r * sb, 2 * z],
        [R * ca * (2 * z + r * sb), R * r * sa * cb, 2 * R * sa],
        [R * sa * (r - 2 * z * sb), R * (2 * z * ca * cb - r * sb), 2 * R * ca * sb],
    ]
)
third = sp.Rational(1, 3)
printed_W35 = sp.Matrix(
    [
        [-2 * third * A0, -2 * third * A1, -2 * third * Am, 2 * r - R * (ca + cb), 2 * R - r * (ca + cb)],
        [0, 2 / sp.sqrt(3) * A1, -2 / sp.sqrt(3) * Am, R * sa * sb, sa * (2 * z + r * sb)],
        [4 * third * A0, -2 * third * A1, -2 * third * Am, R * (cb - ca), r * cb + ca * (2 * z * sb - r)],
    ]
)
d.state(
    "W33", equal(im(printed_W33), im(W33)), text="Derivatives of L by the pose.", place="after eq. (10)"
).prove()
d.state(
    "W35",
    equal(im(printed_W35), im(W35)),
    text="Derivatives of L by the parameters, with the minus signs of (8) as it holds.",
    place="after eq. (10)",
).prove()

# %% [markdown]
# The lengths depend on pose, $r$ and $R$; put into $L$ they make it vanish identically. So the derivatives of that
# identity vanish, and what (12) calls $M_{35}$ is the derivative of the pose.

# %%
rod_by_pose = sp.Matrix(3, 3, lambda i, j: squares[i].diff(pose[j]) / (2 * rods[i]))
rod_by_radius = sp.Matrix(3, 2, lambda i, j: squares[i].diff((r, R)[j]) / (2 * rods[i]))
T = W35[:, :3]
d.state(
    "eq-10",
    equal(im(W33 + T * rod_by_pose), sp.zeros(3, 3).as_immutable()),
    equal(im(W35[:, 3:] + T * rod_by_radius), sp.zeros(3, 2).as_immutable()),
    text="W33 dpose + W35 dparameters = 0 along every motion: for each change of pose, r and R with the change of "
    "the rods that goes with it.",
    place="eqs. (10) and (11)",
).prove()
M35 = -(W33.adjugate() / sp.Symbol("det_W33", real=True)) * W35
d.state(
    "eq-12",
    equal(im(W33 * M35 + W35), sp.zeros(3, 5).as_immutable()),
    text="M35 = −W33⁻¹ W35, where det W33 is not zero.",
    place="eqs. (6) and (12)",
).prove(given={sp.Symbol("det_W33", real=True): W33.det(method="berkowitz")})
d.state(
    "vector-of-4",
    equal(
        sum(
            (squares[1].diff(p) * step for p, step in zip(pose, (d_alpha, d_beta, dz), strict=True)),
            sp.S.Zero,
        ),
        d_alpha,
    ),
    said="A marginal change of the vector of rotations and translation from (4)",
    text="The change of (4) would be the first component of that vector.",
    place="before eq. (6)",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140, d_alpha: 0, d_beta: 0, dz: 1},
    change_of_point,
    label="T6",
    because="The vector (dα, dβ, dz) stands in (5). Equation (4) is the length of one rod.",
)
det_W33 = d.symbol("det_W33", r"\det W_{33}", "determinant of W33", "length⁵")
written_det = (
    2
    * R**2
    * (
        4 * z**3 * ca**2 * cb
        + 2 * r * z**2 * sb * (cb - ca)
        - r * z * (2 * R * sa**2 * ca * cb + 2 * R * sb**2 + r * sa**2 * cb + r * sb**2 * ca)
        + R * r**2 * sb * (sa**2 * ca * cb + 2 * sa**2 - sb**2 * ca**2)
    )
)
d.check(
    "det-W33",
    equal(W33.det(method="berkowitz"), written_det),
    text="The rods determine the pose to first order where this is not zero.",
).prove()
d.check(
    "det-W33-home",
    equal(written_det.subs({alpha: 0, beta: 0}), 8 * R**2 * z**3),
    text="At α = β = 0 it is 8R²z³.",
).prove()

# %% [markdown]
# ## The change of the point, from implicit equations

# %%
H = sp.Matrix(
    [
        -qx + Qx * cb - Qz * sb,
        -Qy + qy * ca + (qz + z) * sa,
        -(qz + z) * ca + Qz * cb + qy * sa + Qx * sb,
    ]
)
d.state(
    "eq-13",
    equal(Oy.T * Q, Oy.T * Oy * Ox * im(shifted)),
    text="(1), multiplied by the transposed O_y.",
    place="eq. (13)",
).prove(given=by_pose)
d.state(
    "eq-14",
    equal(-Oy.T * Q + Ox * im(shifted), sp.zeros(3, 1).as_immutable()),
    place="eq. (14)",
).prove(given=by_pose)
d.state(
    "after-multiplying-3",
    equal(A0**2 - length_0**2, H[0]),
    said="After multiplying of (3) we get",
    text="(3), brought to one side and squared, would be (15).",
    place="before eq. (15)",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140, A0: 1000, q: (0, 0, 0), Q: (0, 0, 600)},
    equal(sp.diag(-1, 1, -1).as_immutable() * (-Oy.T * Q + Ox * im(shifted)), im(H)),
    label="T7",
    because="(15) to (17) are the components of (14), the first and the third times −1. (3) is the length of a rod.",
)
for number, row in zip((15, 16, 17), H, strict=True):
    d.state(f"eq-{number}", equal(row, 0), place=f"eq. ({number})").prove(given=by_pose)
F33, G33 = H.jacobian(sp.Matrix(list(Q))), H.jacobian(sp.Matrix(pose))
printed_F33 = sp.Matrix([[cb, 0, -sb], [0, -1, 0], [sb, 0, cb]])
printed_G33 = sp.Matrix(
    [
        [0, -Qx * sb - Qz * cb, 0],
        [(qz + z) * ca - qy * sa, 0, sa],
        [qy * ca + (qz + z) * sa, Qx * cb - Qz * sb, -ca],
    ]
)
d.state(
    "eq-18", equal(im(printed_F33), im(F33)), text="Derivatives of H by the point.", place="eq. (18)"
).prove()
d.state(
    "eq-19", equal(im(printed_G33), im(G33)), text="Derivatives of H by the pose.", place="eq. (19)"
).prove()
d.check("det-F33", equal(F33.det(), -1), text="F33 is regular everywhere.").prove()
d.check(
    "M33",
    equal(im(F33 * true_M33), im(-G33)),
    text="M33 = −F33⁻¹ G33 is the derivative of (1).",
).prove(given=by_pose)
h = qz + z
det_M33 = -h * (h * ca - qy * sa)
d.check(
    "det-M33",
    equal(true_M33.det(method="berkowitz"), det_M33),
    text="The pose is determined by the point to first order where this is not zero.",
).prove()
d.check(
    "det-M33-by-roots",
    equal(det_M33.xreplace(by_formula), -S * K * u * g),
    text="By the roots of the inverse problem: it vanishes exactly where two of the four poses meet.",
).prove(modulo=roots)
d.state(
    "eq-20",
    equal(
        im((-F33.adjugate() / -1 * G33) * (-W33.adjugate() / det_W33 * W35)),
        im(true_M33 * M35),
    ),
    text="A35 = (−F33⁻¹ G33)(−W33⁻¹ W35) = M33 M35; the inverses are written by adjugates.",
    place="eq. (20)",
).prove(given=by_pose)
d.state(
    "cannot-be-derived",
    equal(det_W33 * F33.det(), 0),
    said="Because of this, the equations cannot be partially derived, making the uncertainty analysis unfeasible",
    text="The implicit equations would have no derivatives.",
    place="sec. 5",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140},
    equal(det_W33 * F33.det(), -written_det),
    given={det_W33: written_det},
    label="T8",
    because="The paper itself derives them: F33 is regular everywhere and W33 wherever the polynomial is not zero, "
    "which is so at home.",
)

# %% [markdown]
# ## Uncertainty
#
# (21) is the law of propagation of uncertainty, $U_y = A\,U_x A^T$, for any symmetric positive semidefinite $U_x$,
# (22) its names. Of (23) and Table 1 what can be checked independently is the uncertainty of a rectangular
# distribution.

# %%
half_width = d.symbol("a", "a", "permissible deviation", "length", positive=True)
standard = d.symbol("u_x", "u_x", "standard uncertainty", "length")
x = sp.Symbol("x", real=True)
variance = sp.integrate(x**2 / (2 * half_width), (x, -half_width, half_width))
U = sp.Matrix(5, 5, lambda i, j: sp.Symbol(f"u_{min(i, j) + 1}_{max(i, j) + 1}", real=True))
A = sp.Matrix(3, 5, lambda i, j: sp.Symbol(f"a_{i + 1}_{j + 1}", real=True))
v = sp.Matrix(sp.symbols("v_1:4", real=True))
d.state(
    "eq-21",
    equal((v.T * (A * U * A.T) * v)[0, 0], ((A.T * v).T * U * (A.T * v))[0, 0]),
    text="U_y = A U_x Aᵀ; the variance of a linear function v of the point is that of the function Aᵀ v of the "
    "parameters, so U_y is symmetric and positive semidefinite whenever U_x is.",
    place="eqs. (21) and (22)",
).prove()
d.state(
    "eq-23",
    equal(variance, (half_width / sp.sqrt(3)) ** 2),
    text="(a/√3)² on the diagonal: variance of a rectangular distribution of half width a.",
    place="eq. (23)",
).prove()
d.state(
    "table-1",
    equal(standard, half_width / sp.sqrt(3)),
    text="Uncertainty 0.0029 mm for a permissible deviation of 0.005 mm; 0.0058 mm for 0.010 mm.",
    place="Table 1",
).refute(
    {half_width: sp.Rational(5, 1000), standard: sp.Rational(29, 10000)},
    equal(standard**2, variance),
    proof=[equal((half_width / sp.sqrt(3)) ** 2, variance)],
    label="T9",
    because="Table 1 is rounded to two digits: its squares are 0.9 % greater than those of (23), with which (24) was "
    "computed.",
)
d.state(
    "units",
    equal(scale**2 * variance, variance),
    tacit=True,
    text="(23) and (24) have no unit, as if their numbers were the same in every unit.",
    place="eqs. (23) and (24)",
).refute(
    {half_width: 1, scale: 1000},
    equal(scale**2 * variance, variance.subs(half_width, scale * half_width)),
    label="T10",
    because="Both are in mm²: they are squares of lengths.",
)

# %% [markdown]
# ## The direct problem
#
# Given the three lengths, (7) to (9) are three equations for the pose. The numbers $m=\cos\alpha+\cos\beta$ and
# $e=(mr+k_3)/2$ are linear in $w=z^2$; with $p=r-z\sin\beta$ the rest is rational, and the two circles
# $\sin^2+\cos^2=1$ are two polynomials in $p$ and $w$. Their resultant in $p$ has every solution among its roots.

# %%
k2, k3 = (A1**2 - Am**2) / (sp.sqrt(3) * R), (2 * A0**2 - A1**2 - Am**2) / (3 * R)
w = d.symbol("w", "w", "z²", "length²", value=z**2)
p = d.symbol("p", "p", "r − z sin β", "length", value=r - z * sb)
m = d.symbol(
    "m", "m", "(w + R² + r² − (A₀² + A₁² + A₋₁²)/3)/(R r)", "1",
    value=(w + R**2 + r**2 - (A0**2 + A1**2 + Am**2) / 3) / (R * r),
)  # fmt: skip
e = d.symbol("e", "e", "(m r + k₃)/2", "length", value=(m * r + k3) / 2)
by_e = {e: e, m: m, w: z**2, p: r - z * sb}
d.check(
    "elimination",
    equal(L[0], R * r * (m - ca - cb)),
    equal(L[1], R * (k2 + sa * (2 * z + r * sb))),
    equal(L[2] + L[0], 2 * R * (e - p * ca)),
    text="The three equations: cos α + cos β = m, sin α (2z + r sin β) = −k₂, p cos α = e.",
).prove()
circle_beta = w * (m * p - e) ** 2 + p**2 * (r - p) ** 2 - p**2 * w
spread = 2 * w + r**2 - r * p
circle_alpha = e**2 * spread**2 + k2**2 * w * p**2 - p**2 * spread**2
free = {name: name for name in (m, e, w, p)}
on_p = {cb: m - e / p, sb: (r - p) / z, ca: e / p, sa: -k2 * z / spread}
d.check(
    "two-circles",
    equal((cb**2 + sb**2 - 1).xreplace(on_p) * p**2 * z**2, circle_beta.xreplace({w: z**2})),
    equal(
        (ca**2 + sa**2 - 1).xreplace(on_p).xreplace({w: z**2}) * p**2 * spread.xreplace({w: z**2}) ** 2,
        circle_alpha.xreplace({w: z**2}),
    ),
    equal(((2 * z + r * sb) * z).xreplace(on_p), spread.xreplace({w: z**2})),
    text="With these the two circles are polynomials of degree 4 in p, of degree 3 and 4 in w.",
).prove(given={m: m, e: e, p: p, w: z**2})
d.check(
    "in-pairs",
    equal(im(L.subs({alpha: -alpha, beta: -beta, z: -z}, simultaneous=True)), im(L)),
    text="With (α, β, z) also (−α, −β, −z) solves them; that is why only z² appears.",
).prove()

# %% [markdown]
# Real solutions have $|m|\le2$, so $w$ lies in an interval that is known beforehand. How many complex ones there are
# is found exactly in an example: apart from $w^2$ and $e^4$, which belong to no pose ($z=0$, and $p=e=0$), the
# resultant has the degree 14 in $w$. So there are at most 28 solutions, in pairs. In this example 4 of the 14 roots
# are real and positive, so there are 8 real poses; one of them has both cosines and $z$ positive. For the machine
# that is the physical one.

# %%
example = {R: 330, r: 140, A0: 650, A1: 700, Am: 760}


def exact_resultant(values: dict[sp.Symbol, int]) -> tuple[sp.Poly, sp.Poly]:
    """Resultant of the two circles in p at rational lengths, and the linear polynomial e(w)."""
    unknown, pivot = sp.symbols("w_ p_")
    forms = {}
    for name, value in (("m", d.value(m, {w: w})), ("e", d.value(e, {w: w}))):
        forms[name] = value.subs(values).subs(w, unknown)
    put = {m: forms["m"], e: forms["e"], w: unknown, p: pivot}
    circles = [sp.expand(c.xreplace(put).subs(values)) for c in (circle_beta, circle_alpha)]
    return sp.Poly(sp.resultant(*circles, pivot), unknown), sp.Poly(forms["e"], unknown)


def without(polynomial: sp.Poly, factor: sp.Poly) -> tuple[sp.Poly, int]:
    """Divide by a factor as often as it goes."""
    times = 0
    while True:
        quotient, rest = sp.div(polynomial, factor)
        if not rest.is_zero:
            return polynomial, times
        polynomial, times = quotient, times + 1


resultant, linear = exact_resultant(example)
resultant, powers_of_w = without(resultant, sp.Poly(resultant.gen, resultant.gen))
resultant, powers_of_e = without(resultant, linear)
d.check(
    "degree",
    equal(im([powers_of_w, powers_of_e, resultant.degree()]), im([2, 4, 14])),
    equal(sp.Integer(resultant.count_roots(0, sp.oo)), 4),
    equal(sp.Integer(sp.gcd(resultant, resultant.diff()).degree()), 0),
    text="Degrees in an exact example, R = 330, r = 140, rods 650, 700, 760; the roots are simple.",
).prove()

# %% [markdown]
# ## What the kernels compute
#
# A rod as a vector, $\vec a_k=\vec b_k-R\vec e_k$ with the platform's joint $\vec b_k=O_yO_x(r\vec e_k+z\vec e_3)$,
# gives the derivatives with fewer operations than $W_{33}$ and $W_{35}$: $A_k\,dA_k=\vec a_k\cdot d\vec a_k$, so
# $P\,d\text{pose}=A_k\,dA_k-\vec a_k\cdot O\vec e_k\,dr+\vec a_k\cdot\vec e_k\,dR$ with the rows $P_k=\vec
# a_k\cdot\partial\vec b_k/\partial(\alpha,\beta,z)$.


# %%
def rod_rows(sines, heights):
    """Rods and rows P_k, and the products with Oe_k and e_k, as the kernels compute them."""
    sa, ca, sb, cb = sines
    z, r, R = heights
    half, root = sp.Rational(1, 2), sp.sqrt(3) / 2
    found = []
    for c, s in ((sp.S.One, sp.S.Zero), (-half, root), (-half, -root)):
        along = sp.Matrix([cb * c - sb * sa * s, ca * s, -sb * c - cb * sa * s])  # O e_k
        joint = r * along + z * sp.Matrix([sb * ca, sa, cb * ca])
        rod = joint - R * sp.Matrix([c, s, 0])
        row = [
            R * (c * sb * (ca * r * s + sa * z) + s * (sa * r * s - ca * z)),
            -R * c * joint[2],
            rod.dot(sp.Matrix([sb * ca, sa, cb * ca])),
        ]
        found.append((rod, row, rod.dot(along), rod.dot(sp.Matrix([c, s, 0]))))
    return found


rows = rod_rows((sa, ca, sb, cb), (z, r, R))
P = sp.Matrix([row for _, row, _, _ in rows])
d.check(
    "rod-rows",
    *(equal(im(rod), im(vector)) for (rod, _, _, _), vector in zip(rows, vectors, strict=True)),
    equal(2 * im(P), im(sp.Matrix(3, 3, lambda i, j: squares[i].diff(pose[j])))),
    equal(
        2 * im(sp.Matrix([[by_r, -by_R] for _, _, by_r, by_R in rows])),
        im(sp.Matrix(3, 2, lambda i, j: squares[i].diff((r, R)[j]))),
    ),
    text="The rods and half the derivatives of their squares.",
).prove()
d.check(
    "P-and-W33",
    equal(im(W33), im(-2 * T0 * P)),
    equal(im(W35), im((T0 * sp.diag(2 * A0, 2 * A1, 2 * Am)).row_join(-2 * T0 * sp.Matrix(
        [[by_r, -by_R] for _, _, by_r, by_R in rows])))),
    equal(written_det, -16 / (3 * sp.sqrt(3)) * P.det(method="berkowitz")),
    text="The same equations in another combination: W33 = −2 T₀ P and W35 = 2 T₀ (…), so M35 = −W33⁻¹ W35 is "
    "P⁻¹ (A_k dA_k − …).",
).prove()  # fmt: skip


class TriceptStatus(IntEnum):
    """Kind of a pose of the Tricept, and whether the data allow it.

    REACHABLE: a pose, its rods within the limits.
    OUT_OF_LIMITS: a pose, with a rod shorter or longer than the limits.
    DOUBLE_POSE: two of the four poses meet here to rounding, since one of the two roots is zero.
    GIMBAL_LOCK: an angle is not determined, because the point does not move with it; it is given as 0.
    UNREACHABLE: there is no such pose, because a root is imaginary, or no pose of the physical branch has such rods.
    SINGULAR: the rods do not determine the pose to first order: det W33 is zero.
    NOT_COVARIANCE: U_x is not symmetric and positive semidefinite.
    INVALID: a number is NaN or infinite, or a radius or a rod not positive.
    """

    REACHABLE = 0
    OUT_OF_LIMITS = 1
    DOUBLE_POSE = 2
    GIMBAL_LOCK = 3
    UNREACHABLE = 4
    SINGULAR = 5
    NOT_COVARIANCE = 6
    INVALID = 7


# %%
SOURCE = "Kureková et al., Acta IMEKO 4(4), 2015, "


LETTERS = (sa, ca, sb, cb, z, r, R, *rods)


def letters(sines, heights, length=()):
    """A kernel's names for the letters of the equations."""
    return dict(zip(LETTERS, (*sines, *heights, *length), strict=False))


def builder(name, summary, place, notes=""):
    return KernelBuilder(f"tricept_{name}", summary=summary, source=SOURCE + place, notes=notes)


def pose_input(k):
    """The pose; return its sines and cosines, and z."""
    pose = k.input("pose", 3, unit="rad, rad, length", doc="alpha, beta, z")
    a, b = k.let("alpha", pose[0]), k.let("beta", pose[1])
    sines = [k.let(name, f(x)) for name, f, x in (
        ("sa", sp.sin, a), ("ca", sp.cos, a), ("sb", sp.sin, b), ("cb", sp.cos, b))]  # fmt: skip
    return sines, pose[2]


def radii_inputs(k):
    return (
        k.input("r", unit="length", doc="radius of the joints of the platform"),
        k.input("R", unit="length", doc="radius of the joints of the base"),
    )


def q_input(k):
    """The point of the platform, as numbers: one value for a whole batch is then read without a copy."""
    return [k.input(f"q_{c}", unit="length", doc=f"{c} of the point on the platform") for c in "xyz"]


def limits_input(k):
    return (
        k.input("shortest", unit="length", doc="least length of a rod"),
        k.input("longest", unit="length", doc="greatest length of a rod"),
    )


def orientation(sines):
    sa, ca, sb, cb = sines
    return sp.Matrix([[cb, -sb * sa, sb * ca], [0, ca, sa], [-sb, -cb * sa, cb * ca]])


def point_kernel():
    k = builder("point", "Point and orientation of the platform in a pose.", "eq. (1)")
    sines, z = pose_input(k)
    q = q_input(k)
    rotation = k.let("rotation_", orientation(sines))
    k.output(
        "point",
        rotation * sp.Matrix([q[0], q[1], q[2] + z]),
        unit="length",
        doc="the point, from the base's centre",
    )
    k.output("rotation", rotation, unit="1", doc="orientation of the platform, O_y(beta) O_x(alpha)")
    return k.build()


def lengths(k, rods, name="rod"):
    return k.let(f"{name}_length", sp.Matrix([sp.sqrt(rod.dot(rod)) for rod in rods]))


def legs_kernel():
    k = builder("legs", "Lengths of the three rods in a pose.", "eqs. (2) to (4)")
    sines, z = pose_input(k)
    r, R = radii_inputs(k)
    rods = [k.let(f"rod_{n}", row[0]) for n, row in zip("abc", rod_rows(sines, (z, r, R)), strict=True)]
    k.output("legs", lengths(k, rods), unit="length", doc="A0, A1, A-1")
    return k.build()


def finite(*values):
    return sum((abs(x) for x in values), sp.S.Zero) <= LARGEST


def roots_of(k, point, q):
    """The two roots of the inverse problem, and their tolerances."""
    X, Y, Z = point
    level = k.let("level_squared", X**2 + Z**2)
    distance = k.let("level", sp.sqrt(level))
    g2 = k.let("g_squared", (distance - abs(q[0])) * (distance + abs(q[0])))
    # q_x near the distance: each is rounded, and so is the difference of their squares
    band = k.let("g_band", 16 * EPS * (level + q[0] ** 2))
    u2 = k.let("u_squared", (Y - q[1]) * (Y + q[1]) + select(g2 > 0, g2, 0))
    wide = k.let("u_band", 16 * EPS * (Y**2 + q[1] ** 2) + band)
    none = k.let("no_root", (g2 < -band) | (u2 < -wide))
    k.let("double_root", (g2 <= band) | (u2 <= wide))
    g = k.let("g", sp.sqrt(select(g2 > 0, g2, 0)))
    u = k.let("u", sp.sqrt(select(u2 > 0, u2, 0)))
    return level, g, u, none


def beta_of(k, name, K, point, q, parts):
    """Sine and cosine of beta for the sign K."""
    X, _, Z = point
    g, _ = parts
    free, inverse = k["free_beta"], k["by_level"]
    sine = k.let(f"sb_{name}", select(free, 0, (-q[0] * Z + K * X * g) * inverse))
    return sine, k.let(f"cb_{name}", select(free, 1, (q[0] * X + K * Z * g) * inverse))


def alpha_of(k, name, SK, point, q, parts):
    """Sine, but for the factor S, and cosine of alpha for the product of both signs."""
    g, u = parts
    free, inverse = k["free_alpha"], k["by_whole"]
    sine = k.let(f"sa_{name}", select(free, 0, (point[1] * u - SK * q[1] * g) * inverse))
    return sine, k.let(f"ca_{name}", select(free, 1, (SK * u * g + q[1] * point[1]) * inverse))


def inverse_parts(k):
    """Inputs and roots, shared by the inverse problem and the propagation."""
    point = k.input("point", 3, unit="length", doc="the point, from the base's centre")
    r, R = radii_inputs(k)
    q = q_input(k)
    shortest, longest = limits_input(k)
    level, g, u, none = roots_of(k, point, q)
    whole = k.let("whole", point[1] ** 2 + g**2)
    free_beta = k.let("free_beta", sp.Eq(level, 0))
    free_alpha = k.let("free_alpha", sp.Eq(whole, 0))
    k.let("by_level", 1 / select(free_beta, 1, level))
    k.let("by_whole", 1 / select(free_alpha, 1, whole))
    good = finite(*point, *q, r, R) & (r > 0) & (R > 0) & (shortest <= longest)
    good = k.let("valid", good & (whole <= LARGEST))
    return point, (r, R), q, (shortest, longest), (g, u), good, none


def pose_status(k, rod_lengths, limits, further=(), singular=sp.false):
    shortest, longest = limits
    short = sp.Or(*(length < shortest for length in rod_lengths))
    long = sp.Or(*(length > longest for length in rod_lengths))
    valid, none, double, free_beta, free_alpha = (
        k[n] for n in ("valid", "no_root", "double_root", "free_beta", "free_alpha")
    )
    return sp.Piecewise(
        (TriceptStatus.INVALID, sp.Not(valid)),
        *further,
        (TriceptStatus.UNREACHABLE, none),
        *([(TriceptStatus.SINGULAR, singular)] if singular != sp.false else []),
        (TriceptStatus.GIMBAL_LOCK, free_beta | free_alpha),
        (TriceptStatus.DOUBLE_POSE, double),
        (TriceptStatus.OUT_OF_LIMITS, short | long),
        (TriceptStatus.REACHABLE, True),
        evaluate=False,
    )


BRANCHES = ((1, 1), (1, -1), (-1, 1), (-1, -1))
PLUS_MINUS = {1: "plus", -1: "minus"}


def inverse_kernel():
    k = builder(
        "inverse",
        "All four poses in which the platform's point is at a given point, and their rods.",
        "conditions below eq. (4)",
        "The rows are (S, K) = (+, +), which is the physical one, (+, -), (-, +), (-, -). With S the sine of alpha "
        "changes its sign and with K the other root does, so there are two values of beta, and of alpha but for the "
        "sign.",
    )
    point, (r, R), q, limits, parts, valid, none = inverse_parts(k)
    betas = {K: beta_of(k, name, K, point, q, parts) for K, name in PLUS_MINUS.items()}
    alphas = {SK: alpha_of(k, name, SK, point, q, parts) for SK, name in PLUS_MINUS.items()}
    angles = {
        (angle, sign): k.let(f"{angle}_{PLUS_MINUS[sign]}", sp.atan2(*pair))
        for angle, pairs in (("beta", betas), ("alpha", alphas))
        for sign, pair in pairs.items()
    }
    poses, legs, codes = [], [], []
    for name, (S, K) in zip("abcd", BRANCHES, strict=True):
        (sine, cosine), z = alphas[S * K], k.let(f"z_{name}", S * parts[1] - q[2])
        sines = (S * sine, cosine, *betas[K])
        rods = [
            k.let(f"rod_{name}{n}", row[0]) for n, row in zip("xyz", rod_rows(sines, (z, r, R)), strict=True)
        ]
        length = lengths(k, rods, f"rods_{name}")
        poses.append([S * angles["alpha", S * K], angles["beta", K], z])
        legs.append(list(length))
        codes.append(pose_status(k, length, limits))
    there = k.let("there", valid & sp.Not(none))
    hidden = sp.ones(4, 3) * sp.nan
    k.output(
        "poses",
        select(there, sp.Matrix(poses), hidden),
        unit="rad, rad, length",
        doc="alpha, beta, z, one a row",
    )
    k.output("legs", select(there, sp.Matrix(legs), hidden), unit="length", doc="A0, A1, A-1, one a row")
    k.status("status", sp.Matrix(codes), TriceptStatus, doc="what each pose is")
    return k.build()


def pose_kernel():
    k = builder(
        "pose",
        "The physical pose in which the platform's point is at a given point, and its rods.",
        "conditions below eq. (4)",
        "The first row of tricept_inverse alone.",
    )
    point, (r, R), q, limits, parts, valid, none = inverse_parts(k)
    alpha, beta = alpha_of(k, "plus", 1, point, q, parts), beta_of(k, "plus", 1, point, q, parts)
    z = k.let("z", parts[1] - q[2])
    rows = rod_rows((*alpha, *beta), (z, r, R))
    length = lengths(k, [k.let(f"rod_{n}", row[0]) for n, row in zip("abc", rows, strict=True)])
    there, hidden = k.let("there", valid & sp.Not(none)), sp.ones(3, 1) * sp.nan
    found = sp.Matrix([sp.atan2(*alpha), sp.atan2(*beta), z])
    k.output("pose", select(there, found, hidden), unit="rad, rad, length", doc="alpha, beta, z")
    k.output("legs", select(there, length, hidden), unit="length", doc="A0, A1, A-1")
    k.status("status", pose_status(k, length, limits), TriceptStatus, doc="what the pose is")
    return k.build()


def cofactors(M):
    """Transposed cofactors of a 3x3 matrix: its adjugate."""
    return sp.Matrix(
        3, 3,
        lambda i, j: M[(j + 1) % 3, (i + 1) % 3] * M[(j + 2) % 3, (i + 2) % 3]
        - M[(j + 1) % 3, (i + 2) % 3] * M[(j + 2) % 3, (i + 1) % 3],
    )  # fmt: skip


def pose_to_point(sines, shifted_q):
    """M33, with q_z + z as the third component of `shifted_q`."""
    sa, ca, sb, cb = sines
    x, y, h = shifted_q
    by_alpha = sp.Matrix([0, ca * h - sa * y, -sa * h - ca * y])
    across = ca * h - sa * y  # Q_z cos β + Q_x sin β
    middle = sa * h + ca * y
    return sp.Matrix(
        [
            [sb * by_alpha[2], cb * across - sb * x, sb * ca],
            [across, 0, sa],
            [cb * by_alpha[2], -(sb * across + cb * x), cb * ca],
        ]
    ), middle


def rod_parts(k, sines, heights):
    """Lengths of the rods, P with its adjugate and determinant, and the products for r and R."""
    rows = rod_rows(sines, heights)
    vectors = [k.let(f"rod_{n}", row[0]) for n, row in zip("abc", rows, strict=True)]
    length = lengths(k, vectors)
    P = k.let("P", sp.Matrix([row[1] for row in rows]))
    by_r = k.let("by_r", sp.Matrix([row[2] for row in rows]))
    by_R = k.let("by_R", sp.Matrix([row[3] for row in rows]))
    adjugate = k.let("adjugate", cofactors(P))
    terms = [P[0, n] * adjugate[n, 0] for n in range(3)]
    determinant = k.let("determinant", sum(terms, sp.S.Zero))
    size = k.let("determinant_size", sum(map(abs, terms), sp.S.Zero))
    singular = k.let("singular", abs(determinant) <= 16 * EPS * size)
    return length, P, by_r, by_R, adjugate, determinant, singular


def sensitivity_of(k, M33, parts, name="A"):
    """A35 = M33 P⁻¹ (diag(A_k) | −by_r | +by_R)."""
    length, _, by_r, by_R, adjugate, determinant, singular = parts
    inverse = k.let("inverse_determinant", 1 / select(singular, 1, determinant))
    N = k.let("point_by_P", M33 * adjugate * inverse)
    return k.let(name, (N * sp.diag(*length)).row_join(-N * by_r).row_join(N * by_R))


def sensitivity_kernel():
    k = builder("sensitivity", "Derivatives of the point by the rods and the two radii.", "eq. (20)")
    sines, z = pose_input(k)
    r, R = radii_inputs(k)
    q = q_input(k)
    parts = rod_parts(k, sines, (z, r, R))
    M33, _ = pose_to_point(sines, (q[0], q[1], q[2] + z))
    A = sensitivity_of(k, k.let("M33", M33), parts, "A")
    k.output(
        "A35",
        select(k["singular"], sp.ones(3, 5) * sp.nan, A),
        unit="1",
        doc="derivatives of Q by A0, A1, A-1, r, R; NaN where the rods do not determine the pose",
    )
    return k.build()


def matrices_kernel():
    k = builder("matrices", "The matrices W33, W35, M33, M35 and A35 in a pose.", "eqs. (5) to (20)")
    sines, z = pose_input(k)
    r, R = radii_inputs(k)
    q = q_input(k)
    parts = rod_parts(k, sines, (z, r, R))
    length, _, by_r, by_R, adjugate, _, singular = parts
    ours = letters(sines, (z, r, R), length)
    k.output("W33", printed_W33.xreplace(ours), unit="mixed", doc="derivatives of L by the pose")
    k.output("W35", printed_W35.xreplace(ours), unit="length", doc="derivatives of L by the parameters")
    M33, _ = pose_to_point(sines, (q[0], q[1], q[2] + z))
    M33 = k.let("M33_", M33)
    A = sensitivity_of(k, M33, parts, "A")
    inverse = k["inverse_determinant"]
    M35 = (adjugate * sp.diag(*length)).row_join(-adjugate * by_r).row_join(adjugate * by_R) * inverse
    hidden = sp.ones(3, 5) * sp.nan
    k.output("M33", M33, unit="mixed", doc="derivatives of the point by the pose")
    k.output(
        "M35", select(singular, hidden, M35), unit="mixed", doc="derivatives of the pose by the parameters"
    )
    k.output("A35", select(singular, hidden, A), unit="1", doc="derivatives of the point by the parameters")
    return k.build()


def singularity_kernel():
    k = builder("singularity", "Determinants that vanish in singular poses.", "eqs. (10) to (20)")
    sines, z = pose_input(k)
    r, R = radii_inputs(k)
    q = q_input(k)
    _, _, _, _, _, determinant, _ = rod_parts(k, sines, (z, r, R))
    sa, ca, _, _ = sines
    h = k.let("h", q[2] + z)
    det = k.let("det_W33_", -16 / (3 * sp.sqrt(3)) * determinant)
    k.output("det_W33", det, unit="length⁵", doc="zero where the rods do not determine the pose")
    k.output(
        "ratio", det / (8 * R**2 * z**3), unit="1", doc="det W33 over its value at alpha = beta = 0, 8 R² z³"
    )
    k.output("det_M33", -h * (h * ca - sa * q[1]), unit="length²", doc="zero where two poses of a point meet")
    return k.build()


# %% [markdown]
# The propagation goes from the point to $U_y$ in one kernel. Roots and divisions give the sines of the pose, no
# angle is needed. $U_x$ is judged by its correlations: they must be symmetric, and elimination must find no negative
# pivot. The tolerance, 256 times the machine epsilon, is what a matrix that was computed as a product may have lost.


# %%
def covariance_fault(k, U):
    """Whether U is not a covariance matrix: unsymmetric, or a pivot of the correlations is negative."""
    n = U.rows
    band = 256 * EPS
    scale = k.let(
        "correlation_scale",
        # with a zero variance any covariance is invalid, however small: this makes it large
        sp.Matrix([1 / sp.sqrt(select(U[i, i] > 0, U[i, i], EPS**5)) for i in range(n)]),
    )
    faults = [sp.Not((U[i, i] >= 0) & (U[i, i] <= LARGEST)) for i in range(n)]
    C = sp.eye(n)
    for i in range(n):
        C[i, i] = k.let(f"correlation_{i}{i}", select(U[i, i] > 0, 1, 0))
        for j in range(i):
            C[i, j] = k.let(f"correlation_{i}{j}", U[i, j] * scale[i] * scale[j])
            faults.append(sp.Not(abs(U[j, i] * scale[i] * scale[j] - C[i, j]) <= band))
    for step in range(n):
        pivot = C[step, step]
        faults.append(sp.Not(pivot >= -band))
        positive = k.let(f"pivot_{step}", pivot > band)
        divisor = k.let(f"pivot_{step}_inverse", select(positive, 1 / select(positive, pivot, 1), 0))
        for i in range(step + 1, n):
            # where the pivot is zero, so must be the column below it: |c| ≤ √(pivot · 1)
            faults.append(sp.Not(positive) & sp.Not(C[i, step] ** 2 <= 2 * band))
            for j in range(step + 1, i + 1):
                C[i, j] = k.let(f"left_{step}_{i}{j}", C[i, j] - C[i, step] * C[j, step] * divisor)
    return k.let("no_covariance", sp.Or(*faults))


def propagate_kernel():
    k = builder(
        "propagate",
        "Covariance of a point from that of the rods and the two radii, in the physical pose S = K = +1.",
        "eqs. (20) and (21)",
    )
    point, (r, R), q, limits, parts, valid, none = inverse_parts(k)
    U = k.input("U_x", (5, 5), unit="length²", doc="covariance of A0, A1, A-1, r, R")
    sines = (*alpha_of(k, "plus", 1, point, q, parts), *beta_of(k, "plus", 1, point, q, parts))
    z = k.let("z", parts[1] - q[2])
    found = rod_parts(k, sines, (z, r, R))
    M33, _ = pose_to_point(sines, (q[0], q[1], q[2] + z))
    A = sensitivity_of(k, k.let("M33", M33), found, "A")
    fault = covariance_fault(k, U)
    half = k.let("half", A * U)
    upper = {(i, j): half[i, :].dot(A[j, :]) for i in range(3) for j in range(i, 3)}
    upper = {key: k.let(f"covariance_{key[0]}{key[1]}", value) for key, value in upper.items()}
    covariance = sp.Matrix(3, 3, lambda i, j: upper[min(i, j), max(i, j)])
    singular = k["singular"]
    there = k.let("there", valid & sp.Not(none) & sp.Not(singular) & sp.Not(fault))
    k.output(
        "U_y",
        select(there, covariance, sp.ones(3, 3) * sp.nan),
        unit="length²",
        doc="covariance of the point",
    )
    further = [(TriceptStatus.NOT_COVARIANCE, fault)]
    status = pose_status(k, found[0], limits, further, singular)
    k.status("status", status, TriceptStatus, doc="kind of the pose, and whether U_x is a covariance")
    return k.build()


# %% [markdown]
# ## The direct problem, by Newton's method
#
# The physical pose has both cosines and $z$ positive. The start neglects what the tilt does to the second order;
# each step solves $W_{33}\,\delta=-L$ and turns the pairs of sine and cosine by the exact rotation with
# $\tan\frac12\delta$ for $\frac12\delta$, so they stay sines and cosines, and no trigonometric function is called.
# Within the limits of the paper's machine five steps are enough to rounding; there is one more.

# %%
STEPS = 6
h = d.symbol("half_step", r"\tfrac12\delta", "half a step, as a tangent", "1")
step_sine, step_cosine = 2 * h / (1 + h**2), (1 - h**2) / (1 + h**2)
d.check(
    "step-is-a-rotation",
    equal(step_sine**2 + step_cosine**2, 1),
    equal(step_sine.diff(h).subs(h, 0), 2),
    equal((sa * step_cosine + ca * step_sine) ** 2 + (ca * step_cosine - sa * step_sine) ** 2, 1),
    text="The step keeps sine and cosine on the circle, and turns by 2h to first order.",
).prove()
d.check(
    "start",
    equal(L[0].subs({alpha: 0, beta: 0}), z**2 - ((A0**2 + A1**2 + Am**2) / 3 - (R - r) ** 2)),
    equal(L[1].diff(alpha).subs({alpha: 0, beta: 0}), 2 * R * z),
    equal(L[2].diff(beta).subs({alpha: 0, beta: 0}), 2 * R * z),
    text="The start: z from (7) without tilt, the two sines from (8) and (9) to first order.",
).prove()


def direct_kernel():
    k = builder(
        "direct",
        "The physical pose of the platform with given rods.",
        "eqs. (7) to (9)",
        "Newton's method from a start without tilt; NaN where it does not come to a pose with both cosines and z "
        "positive.",
    )
    legs = k.input("legs", 3, unit="length", doc="lengths of the rods A0, A1, A-1")
    r, R = radii_inputs(k)
    s0, s1, sm = (k.let(f"square_{n}", legs[i] ** 2) for i, n in enumerate("abc"))
    sum_of_three = k.let("third_of_sum", (s0 + s1 + sm) / 3)
    c1 = k.let("c1", R**2 + r**2 - sum_of_three)
    c2 = k.let("c2", (legs[1] - legs[2]) * (legs[1] + legs[2]) / sp.sqrt(3))
    c3 = k.let(
        "c3", ((legs[0] - legs[1]) * (legs[0] + legs[1]) + (legs[0] - legs[2]) * (legs[0] + legs[2])) / 3
    )
    height = k.let("start_squared", 2 * R * r - c1)
    z = k.let("start_height", sp.sqrt(select(height > r**2 / 16, height, r**2 / 16)))
    largest = sp.Rational(7, 8)
    sines = {}
    for name, constant in (("a", c2), ("b", c3)):
        sine = k.let(f"first_s{name}", -constant / (2 * R * z))
        sine = k.let(
            f"start_s{name}", select(abs(sine) <= largest, sine, select(sine > 0, largest, -largest))
        )
        sines[name] = (sine, k.let(f"start_c{name}", sp.sqrt(1 - sine**2)))
    (sa, ca), (sb, cb) = sines["a"], sines["b"]
    tilted = k.let("tilted_squared", R * r * (ca + cb) - c1)
    z = k.let("start_z", sp.sqrt(select(tilted > r**2 / 16, tilted, r**2 / 16)))
    for step in range(1, STEPS + 1):
        left = k.let(
            f"L{step}",
            sp.Matrix(
                [
                    c1 + z**2 - R * r * (ca + cb),
                    c2 + R * sa * (2 * z + r * sb),
                    c3 + R * (2 * z * ca * sb + r * (cb - ca)),
                ]
            ),
        )
        W = k.let(f"W{step}", printed_W33.xreplace(letters((sa, ca, sb, cb), (z, r, R))))
        adjugate = k.let(f"adjugate{step}", cofactors(W))
        terms = [W[0, n] * adjugate[n, 0] for n in range(3)]
        determinant = k.let(f"determinant{step}", sum(terms, sp.S.Zero))
        singular = abs(determinant) <= 16 * EPS * sum(map(abs, terms), sp.S.Zero)
        inverse = k.let(f"inverse{step}", 1 / select(sp.Eq(determinant, 0), 1, determinant))
        move = k.let(f"move{step}", -(adjugate * left) * inverse)
        # a step that would turn the platform over, or leave the machine, is cut short
        halves = [k.let(f"half_{n}{step}", select(abs(x) <= 1, x / 2, select(x > 0, 1, -1) / 2)) for n, x in
                  (("a", move[0]), ("b", move[1]))]  # fmt: skip
        down = k.let(f"down{step}", select(move[2] > -z / 2, move[2], -z / 2))
        turned = []
        for name, half, (sine, cosine) in zip("ab", halves, ((sa, ca), (sb, cb)), strict=True):
            by = k.let(f"by_{name}{step}", 1 / (1 + half**2))
            turn_s, turn_c = 2 * half * by, k.let(f"turn_{name}{step}", (1 - half**2) * by)
            turned.append((
                k.let(f"s{name}{step}", sine * turn_c + cosine * turn_s),
                k.let(f"c{name}{step}", cosine * turn_c - sine * turn_s),
            ))  # fmt: skip
        (sa, ca), (sb, cb) = turned
        z = k.let(f"z{step}", z + down)
    # The error after a step is about its square; a last step this small leaves only rounding.
    small = 4 * sp.sqrt(EPS)
    still = (abs(move[0]) <= small) & (abs(move[1]) <= small) & (abs(move[2]) <= small * z)
    physical = (ca > 0) & (cb > 0) & (z > 0)
    valid = k.let("valid", finite(*legs, r, R) & (sum_of_three <= LARGEST) & (r > 0) & (R > 0) & sp.And(
        *(leg > 0 for leg in legs)))  # fmt: skip
    there = k.let("there", valid & still & physical)
    found = sp.Matrix([sp.atan2(sa, ca), sp.atan2(sb, cb), z])
    k.output(
        "pose", select(there, found, sp.ones(3, 1) * sp.nan), unit="rad, rad, length", doc="alpha, beta, z"
    )
    status = sp.Piecewise(
        (TriceptStatus.INVALID, sp.Not(valid)),
        (TriceptStatus.UNREACHABLE, sp.Not(there)),
        (TriceptStatus.SINGULAR, singular),
        (TriceptStatus.REACHABLE, True),
        evaluate=False,
    )
    k.status("status", status, TriceptStatus, doc="whether there is such a pose")
    return k.build()


kernels = {
    k.name: k
    for k in (
        point_kernel(),
        legs_kernel(),
        inverse_kernel(),
        pose_kernel(),
        direct_kernel(),
        matrices_kernel(),
        sensitivity_kernel(),
        propagate_kernel(),
        singularity_kernel(),
    )
}

# %% [markdown]
# The kernels compute the formulas: the rods, the four poses, A35 with the determinant as a letter, and a step
# of Newton's method.


# %%
def steps(name, step, keep, **letters_):
    """A step of a kernel, with its names replaced by the derivation's letters."""
    kernel = kernels[f"tricept_{name}"]
    value = kernel.expand(kernel[step], keep=[kernel[n] for n in keep])
    return im(sp.Matrix([value]) if isinstance(value, sp.Expr) else value).subs(
        kernel.substitution(**letters_)
    )


by_letters = {"sa": sa, "ca": ca, "sb": sb, "cb": cb, "pose": (alpha, beta, z), "r": r, "R": R}
d.check(
    "kernel-legs",
    *(
        equal(steps("legs", f"rod_{name}", ("sa", "ca", "sb", "cb"), **by_letters), im(vector))
        for name, vector in zip("abc", vectors, strict=True)
    ),
    text="The kernel's rods are the vectors from joint to joint.",
).prove()
by_q = dict(zip(("q_x", "q_y", "q_z"), q, strict=True))
by_point = {"g": g, "u": u, "by_level": 1 / level, "by_whole": 1 / whole}
by_point |= {"point": list(Q), **by_q, "free_alpha": False, "free_beta": False}
kept = ("g", "u", "by_level", "by_whole", "free_alpha", "free_beta")
found_poses = []
for s_sign, k_sign in BRANCHES:
    signs = {S: s_sign, K: k_sign}
    for name, formula, factor, sign in (
        ("sa", sin_alpha, s_sign, s_sign * k_sign),
        ("ca", cos_alpha, 1, s_sign * k_sign),
        ("sb", sin_beta, 1, k_sign),
        ("cb", cos_beta, 1, k_sign),
    ):
        step = steps("inverse", f"{name}_{PLUS_MINUS[sign]}", kept, **by_point)
        found_poses.append(equal(factor * step, im([formula.subs(signs)])))
d.check(
    "kernel-inverse", *found_poses, text="The kernel's sines and cosines are those of the four poses."
).prove()
by_letters |= {
    "rod_length": rods,
    **by_q,
    "singular": False,
    "inverse_determinant": -16 / (3 * sp.sqrt(3)) / det_W33,
}
d.check(
    "kernel-A35",
    equal(
        im(
            steps(
                "sensitivity",
                "A",
                ("sa", "ca", "sb", "cb", "rod_length", "inverse_determinant"),
                **by_letters,
            )
        ),
        im(true_M33 * (-W33.adjugate() / det_W33 * W35)),
    ),
    text="The kernel's A35 is that of (20); det P = −3√3/16 det W33.",
).prove()
unknown = ("sa1", "ca1", "sb1", "cb1", "z1", "c1", "c2", "c3")
by_step = {"sa1": sa, "ca1": ca, "sb1": sb, "cb1": cb, "z1": z, "r": r, "R": R}
by_step |= {
    "c1": R**2 + r**2 - (A0**2 + A1**2 + Am**2) / 3,
    "c2": (A1**2 - Am**2) / sp.sqrt(3),
    "c3": (2 * A0**2 - A1**2 - Am**2) / 3,
    "inverse2": 1 / W33.det(method="berkowitz"),
}
d.check(
    "kernel-direct",
    equal(steps("direct", "L2", unknown, **by_step), im(L)),
    equal(steps("direct", "W2", unknown, **by_step), im(W33)),
    equal(im(W33) * steps("direct", "move2", ("inverse2", *unknown), **by_step), im(-L)),
    text="Each step of the kernel solves W33 δ = −L.",
).prove()

# %%
derivation.kernel(*kernels.values())
derivation.kernels
