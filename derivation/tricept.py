# %% [markdown]
# # The Tricept: kinematics and its derivatives
#
# Three telescopic rods carry a platform. A fourth rod, fixed to the platform at a right angle, slides and swings in a
# joint in the middle of the base, and keeps the platform from turning about that rod. The lengths of the three rods
# are commanded; asked for are the pose of the platform, the place of a point that is fixed to it (the tool), and how
# much the tool moves when a rod or a radius is a little different.
#
# E. Kureková, M. Omachelová, M. Halaj and I. Martišovitš ("Positioning uncertainty of the Tricept type parallel
# kinematic structure", Acta IMEKO 4(4), 2015, 9-15) give the position of a point of the platform, the lengths of the
# rods, and the derivatives from which the uncertainty of the point follows. Here their equations (1) to (23) and
# their Table 1 are taken one by one. Each is proved, or refuted by an exact counterexample and corrected.
#
# What comes out: all equations hold but (8), which has one minus sign too many, and the rounded numbers of Table 1.
# Eight things that it says or takes for granted need a correction. What the paper leaves out is added: all four poses
# that bring the tool to a point, the determinants that tell where the machine is singular, the direct problem (from
# rods to the pose), and the functions that the package calls. Equation (24), a numerical result over a cube, is
# treated in the notebook `tricept_uncertainty`: it encloses the range of each element and is not the range itself.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    coordinate_rotation,
    dot,
    equal,
    matrix_from_axis_angle,
    select,
)

d = derivation = Derivation(
    "tricept",
    title="The Tricept: pose, rods, derivatives, singularities",
    source='Kureková, Omachelová, Halaj and Martišovitš, "Positioning uncertainty of the Tricept type parallel '
    'kinematic structure", Acta IMEKO 4(4), 2015',
)
im = sp.ImmutableMatrix

# %% [markdown]
# ## Symbols
#
# The base is the plane $z=0$ with its centre $P$ in the origin; the centre of the platform is $P'$. The pose is
# $(\alpha,\beta,z)$: the middle rod has the length $z=|PP'|$ and is tilted by two angles. Rods and joints are counted
# as the paper does: the rod $A_0$ goes from the joint $A$ of the base to the joint $A'$ of the platform, at 0°, $A_1$
# from $B$ to $B'$, at +120°, and $A_{-1}$ from $C$ to $C'$, at −120°. Lists of parameters are in the order
# $A_0, A_1, A_{-1}, r, R$ of the paper's (22); its Table 1 has $R$ before $r$. The letters that the proofs need in
# addition are explained where they first occur; the table at the end has all of them.

# %%
alpha = d.symbol("alpha", r"\alpha", "angle about x, in the paper's sense", "rad")
beta = d.symbol("beta", r"\beta", "angle about y", "rad")
z = d.symbol("z", "z", "shift along the middle rod", "length")
R = d.symbol("R", "R", "radius of the joints of the base", "length", positive=True)
r = d.symbol("r", "r", "radius of the joints of the platform", "length", positive=True)
q = d.vector("q", r"\vec q", "point of the platform, from its centre P'", "length")
Q = d.vector("Q", r"\vec Q", "that point, from the centre P of the base", "length")
qx, qy, qz = (
    d.letter(f"q_{n} | q_{x} | component of q along {x} | length") for n, x in zip("123", "xyz", strict=True)
)
Qx, Qy, Qz = (
    d.letter(f"Q_{n} | Q_{x} | component of Q along {x} | length") for n, x in zip("123", "xyz", strict=True)
)
A0 = d.symbol("A_0", "A_0", "length of the rod AA'", "length", positive=True)
A1 = d.symbol("A_1", "A_1", "length of the rod BB'", "length", positive=True)
Am = d.symbol("A_m1", "A_{-1}", "length of the rod CC'", "length", positive=True)
S = d.symbol("S", "S", "sign of the first root, +1 or −1", "1")
K = d.symbol("K", "K", "sign of the second root, +1 or −1", "1")
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
d

# %% [markdown]
# ## The point
#
# A point of the platform is first shifted along the middle rod by $z$, then turned by $O_x$ and by $O_y$. The paper's
# $O_y$ is the right-handed rotation about $y$; its $O_x$ is the *transposed* of the right-handed rotation about $x$, so
# that a positive $\alpha$ moves the platform's centre towards $+y$. The paper's (16), (17), (19) and its $\sin\alpha$
# all need it that way. It is a convention, and this package keeps it.

# %%
d.state(
    "eq-1",
    equal(Q, Oy * Ox * im(shifted)),
    equal(Oy, im(matrix_from_axis_angle(sp.Matrix([0, 1, 0]), cb, sb))),
    text="The point of the platform, shifted and turned. $O_y$ is the right-handed rotation by $\\beta$.",
    place="eq. (1)",
).prove(given=by_pose)

# %%
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

# %%
usual = OY * matrix_from_axis_angle(sp.Matrix([1, 0, 0]), ca, sa) * shifted
d.state(
    "usual-Ox",
    equal(-Qy + qy * ca + (qz + z) * sa, 0),
    tacit=True,
    text="Equation (16) holds with the right-handed $O_x$ that the words speak of.",
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
# The joints of the base are at $R\,\vec e_k$, with $\vec e_k=(\cos120°k,\ \sin120°k,\ 0)$ and $k=0,1,-1$; those of the
# platform are at $r\,\vec e_k$ from its centre. A rod is the vector from one to the other,
# $$\vec a_k=O_yO_x\,(r\,\vec e_k+z\,\vec e_z)-R\,\vec e_k,$$
# with the unit vector $\vec e_z$ along $z$, and its length is $A_k=|\vec a_k|$.

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
rod_vectors = [
    d.vector(f"a_{name}", rf"\vec a_{{{k}}}", f"rod {k}, from the joint of the base", "length", value=vector)
    for name, k, vector in zip(("0", "1", "m1"), directions, vectors, strict=True)
]
for number, rod, printed in ((2, Am, length_m), (3, A0, length_0), (4, A1, length_1)):
    d.state(
        f"eq-{number}",
        equal(rod, printed),
        text=f"The length of the rod ${d.latex(rod)}$ in the pose $(\\alpha,\\beta,z)$.",
        place=f"eq. ({number})",
    ).prove(
        squares[rods.index(rod)] - printed**2,
        because="Both are positive, and the squares of the distance of the two joints and of the formula are equal.",
    )
d.page("eq-2", "eq-3", "eq-4")

# %% [markdown]
# The words before (2) call these numbers changes of length. A change is counted from a pose, such as
# $\alpha=\beta=0$ with $z=z_h$, where the rod has the length $|\vec a_0|_h$.

# %%
home = d.symbol("home", r"z_h", "shift at which the changes of length are counted from", "length")
reach = d.letter(r"reach | \left|\vec a_0\right| | length of the rod AA' | length", sp.sqrt(squares[0]))
reach_home = d.letter(
    r"reach_home | \left|\vec a_0\right|_h | length of the rod AA' at α = β = 0, z = z_h | length",
    sp.sqrt(squares[0].subs({alpha: 0, beta: 0, z: home})),
)
d.state(
    "changes",
    equal(A0, reach - reach_home),
    said="Let A0 be the change in length of rod AA'",
    place="before eq. (2)",
).refute(
    {alpha: 0, beta: 0, z: 456, home: 456, R: 330, r: 140},
    equal(A0**2, dot(rod_vectors[0], rod_vectors[0])),
    given=by_joints,
    label="T3",
    because="(2) to (4) and Table 1 are the lengths of the rods from joint to joint, 494 mm there, not changes.",
)

# %% [markdown]
# ## The poses of a point
#
# The inverse problem: which poses bring the tool $\vec q$ to a given place $\vec Q$? The paper's conditions below (4)
# answer it with two roots,
# $$u=\sqrt{|\vec Q|^2-q_x^2-q_y^2}\,,\qquad g=\sqrt{Q_x^2+Q_z^2-q_x^2}\,.$$
# The sign of each root is free: $S$ is the sign of $u$, $K$ that of $g$. The paper takes both as $+1$; all four pairs
# of signs are poses, and there are no others.

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
    text="A pose that brings the tool to $\\vec Q$, for each choice of the signs $S$ and $K$.",
    place="conditions below eq. (4)",
    assumptions=["both roots are real", sp.Ne(level, 0)],
).prove(
    (turned * shifted).xreplace(by_formula) - sp.Matrix(list(Q)),
    sin_beta**2 + cos_beta**2 - 1,
    sin_alpha**2 + cos_alpha**2 - 1,
    modulo=roots,
    because="They are sines and cosines, and put into (1) they give the point, for all four pairs of signs and any q.",
)

# %%
across = Qz * cb + Qx * sb
d.check(
    "four-poses",
    equal((Qx * cb - Qz * sb) ** 2 + across**2, Qx**2 + Qz**2),
    equal(qy**2 + (qz + z) ** 2, Qy**2 + across**2),
    equal(qx, Qx * cb - Qz * sb),
    equal(Qy, qy * ca + (qz + z) * sa),
    equal(across, (qz + z) * ca - qy * sa),
    text="There are no other poses. By the third line, $Q_x\\cos\\beta-Q_z\\sin\\beta$ is $q_x$; so by the first line "
    "$Q_z\\cos\\beta+Q_x\\sin\\beta$ is $g$ or $-g$, and by the second $q_z+z$ is $u$ or $-u$. For each choice the "
    "equations are linear in the sines and cosines and have one solution.",
).prove(given=by_pose)

# %% [markdown]
# What do the other poses look like? Take the platform's centre as the tool, $\vec q=\vec 0$. Write $O=O_yO_x$ for the
# rotation of the platform and $\vec P'=O\,(z\,\vec e_z)$ for its centre. The other sign $K$ gives the angles
# $\pi-\alpha$ and $\pi+\beta$.

# %%
opposite_angles = {alpha: sp.pi - alpha, beta: beta + sp.pi}
centre_of = d.letter(r"centre[3] | \vec P' | centre of the platform | length", turned * sp.Matrix([0, 0, z]))
opposite_centre = d.letter(
    r"centre_opposite[3] | \vec P'(\pi-\alpha,\pi+\beta,z) | centre of the platform at π − α, π + β, z | length",
    (turned * sp.Matrix([0, 0, z])).subs(opposite_angles, simultaneous=True),
)
attitude = d.letter("O[3,3] | O | rotation of the platform, O_y O_x | 1", turned)
opposite_attitude = d.letter(
    r"O_opposite[3,3] | O(\pi-\alpha,\pi+\beta) | rotation of the platform by π − α and π + β | 1",
    turned.subs(opposite_angles, simultaneous=True),
)
d.check(
    "opposite-pose",
    equal(opposite_centre, centre_of),
    equal(opposite_attitude, attitude * im(sp.diag(-1, -1, 1))),
    text="For $\\vec q=\\vec 0$ the pose with the other sign $K$ has its centre at the same place, with the platform "
    "turned by half a turn about its middle rod. The lengths of the rods alone do not exclude it; the machine's "
    "joints do.",
).prove()

# %% [markdown]
# ## The change of the point with the pose
#
# A small change $(d\alpha,d\beta,dz)$ of the pose moves the point by $M_{33}$ times that change, where the columns of
# $M_{33}$ are the derivatives of $\vec Q$ by $\alpha$, $\beta$ and $z$.

# %%
d_alpha = d.letter(r"d_alpha | d\alpha | small change of alpha | rad")
d_beta = d.letter(r"d_beta | d\beta | small change of beta | rad")
dz = d.letter("d_z | dz | small change of z | length")
true_M33 = (turned * shifted).jacobian(sp.Matrix(pose))
M33 = d.matrix("M33", "M_{33}", "derivatives of Q by the pose", "mixed", value=true_M33)
scale = d.symbol("scale", r"\lambda", "how many of a smaller unit of length are one of the larger", "1")
by_alpha, by_beta, by_z = (
    d.vector(f"Q_by_{name}", rf"\frac{{\partial\vec Q}}{{\partial {latex}}}", f"derivative of Q by {name}", unit,
             value=(turned * shifted).diff(by))
    for name, latex, unit, by in (
        ("alpha", r"\alpha", "length/rad", alpha), ("beta", r"\beta", "length/rad", beta), ("z", "z", "1", z)
    )
)  # fmt: skip
change_of_point = equal(
    d_alpha * by_alpha + d_beta * by_beta + dz * by_z,
    M33 * im([d_alpha, d_beta, dz]),
)
d.state(
    "eq-5",
    change_of_point,
    text="The change of the point is $M_{33}$ times the change of the pose.",
    place="eq. (5)",
).prove()

# %% [markdown]
# In another unit of length, of which $\lambda$ make one of the old, a length has a number $\lambda$ times as large, an
# angle the same. $M_{33}^{(\lambda)}$ is $M_{33}$ in the new unit.

# %%
scaled_M33 = d.matrix(
    "M33_scaled", r"M_{33}^{(\lambda)}", "M33 in the other unit of length", "mixed",
    value=im.hstack(scale * im(true_M33[:, :2]), im(true_M33[:, 2])),
)  # fmt: skip
d.state(
    "dimensionless",
    equal(im([d_alpha, d_beta, scale * dz]), im([d_alpha, d_beta, dz])),
    said="a dimensionless vector of rotations and displacement",
    text="Such a vector is the same in every unit of length.",
    place="before eq. (5)",
).refute(
    {d_alpha: 0, d_beta: 0, dz: 1, scale: 1000},
    equal(scale * M33 * im([d_alpha, d_beta, dz]), scaled_M33 * im([d_alpha, d_beta, scale * dz])),
    label="T4",
    because="dz is a length. The columns of M33 have different units: length for the angles, none for z.",
)

# %% [markdown]
# ## Squares instead of roots
#
# The lengths (2) to (4) are roots. The paper combines their squares to three equations without a root, (7) to (9):
# $\vec L=\vec 0$ with $\vec L=(L_1,L_2,L_3)$. In each the squared lengths of the joints' distances are replaced by the
# pose, so the equations hold where the three rods have the lengths that belong to the pose. First each of them as
# printed, then that nothing was lost.

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
d.state(
    "eq-7",
    equal(L[0], 0),
    text="$L_1=0$: the sum of the three squares.",
    place="eq. (7)",
).prove(given=by_joints)

# %%
d.state(
    "eq-8",
    equal((-(A1**2) - Am**2) / sp.sqrt(3) + 2 * R * z * sa + R * r * sa * sb, 0),
    text="$L_2=0$: the difference of two squares, if the third of the minus signs that stand in the print belongs to "
    "$A_1^2$.",
    place="eq. (8)",
).refute(
    {alpha: 0, beta: 0, z: 456, R: 330, r: 140},
    equal(L[1], 0),
    given=by_joints,
    label="T5",
    because="The equation holds with A₁² − A₋₁², which needs two minus signs, one of them that of the index; the print "
    "has three. Row 2 of W35 has one too many in the same way.",
)

# %%
d.state(
    "eq-9",
    equal(L[2], 0),
    text="$L_3=0$: twice the first square less the other two.",
    place="eq. (9)",
).prove(given=by_joints)

# %% [markdown]
# With the closures $f_k=A_k^2-|\vec a_k|^2$, which vanish where each rod has the right length, the three equations are
# $\vec L=T_0\,\vec f$ with a constant matrix $T_0$, here written with its entries.

# %%
letter_L = d.vector("L", r"\vec L", "left sides of (7) to (9)", "length²", value=L)
closures = d.vector(
    "f", r"\vec f", "closures of the rods, A_k² − |a_k|²", "length²",
    value=sp.Matrix([rod**2 - square for rod, square in zip(rods, squares, strict=True)]),
)  # fmt: skip
letter_T0 = d.matrix("T_0", "T_0", "from the closures to L", "1", value=T0)
det_T0 = d.symbol("det_T0", r"\det T_0", "its determinant", "1", value=T0.det())
d.check(
    "combinations",
    equal(letter_L, letter_T0 * closures),
    equal(letter_T0, im(T0)),
    equal(det_T0, 2 / (3 * sp.sqrt(3))),
    text="$\\vec L$ is a regular combination of the three closures. So all three equations hold if and only if all "
    "three lengths are right.",
).prove()

# %% [markdown]
# The derivatives of $\vec L$ by the pose are the columns of the paper's $W_{33}$, those by the five parameters
# $A_0,A_1,A_{-1},r,R$ the columns of its $W_{35}$.

# %%
W33 = L.jacobian(sp.Matrix(pose))
W35 = L.jacobian(sp.Matrix(parameters))
letter_W33 = d.matrix("W33", "W_{33}", "derivatives of L by the pose", "mixed", value=W33)
letter_W35 = d.matrix("W35", "W_{35}", "derivatives of L by the parameters", "length", value=W35, columns=5)
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
    "W33",
    equal(letter_W33, im(printed_W33)),
    text="The derivatives of $\\vec L$ by the pose.",
    place="after eq. (10)",
).prove()

# %%
d.state(
    "W35",
    equal(letter_W35, im(printed_W35)),
    text="The derivatives of $\\vec L$ by the parameters, with the minus signs of (8) as it holds.",
    place="after eq. (10)",
).prove()

# %% [markdown]
# The lengths depend on the pose, $r$ and $R$; put into $\vec L$ they make it vanish identically. So the derivatives of
# that identity vanish. $W_A$ and $W_{rR}$ are the first three and the last two columns of $W_{35}$;
# $\partial A/\partial(\alpha,\beta,z)$ and $\partial A/\partial(r,R)$ are the derivatives of the three lengths (2) to
# (4).

# %%
rod_by_pose = sp.Matrix(3, 3, lambda i, j: squares[i].diff(pose[j]) / (2 * rods[i]))
rod_by_radius = sp.Matrix(3, 2, lambda i, j: squares[i].diff((r, R)[j]) / (2 * rods[i]))
T = W35[:, :3]
letter_T = d.matrix("W_A", "W_A", "derivatives of L by the rods", "length", value=T)
letter_radii = d.letter("W_rR[3,2] | W_{rR} | derivatives of L by r and R | length", W35[:, 3:])
letter_by_pose = d.matrix(
    "A_by_pose", r"\frac{\partial A}{\partial(\alpha,\beta,z)}", "derivatives of the lengths by the pose", "mixed",
    value=rod_by_pose,
)  # fmt: skip
letter_by_radius = d.matrix(
    "A_by_radii", r"\frac{\partial A}{\partial(r,R)}", "derivatives of the lengths by r and R", "1",
    value=rod_by_radius, columns=2,
)  # fmt: skip
d.state(
    "eq-10",
    equal(letter_W33, -letter_T * letter_by_pose),
    equal(letter_radii, -letter_T * letter_by_radius),
    text="$W_{33}\\,d(\\alpha,\\beta,z)+W_{35}\\,d(A_0,A_1,A_{-1},r,R)=0$ along every motion: for a change of the pose "
    "and for one of the radii, each with the change of the rods that goes with it.",
    place="eqs. (10) and (11)",
).prove()

# %%
det_W33 = d.symbol("det_W33", r"\det W_{33}", "determinant of W33", "length⁵")
M35 = -(W33.adjugate() / det_W33) * W35
letter_M35 = d.letter("M35[3,5] | M_{35} | derivatives of the pose by the parameters | mixed", M35)
d.state(
    "eq-12",
    equal(letter_W33 * letter_M35, -letter_W35),
    text="Where $\\det W_{33}$ is not zero, $M_{35}=-W_{33}^{-1}W_{35}$ is the derivative of the pose by the "
    "parameters.",
    place="eqs. (6) and (12)",
).prove(given={det_W33: W33.det(method="berkowitz")})

# %%
change_of_square = d.letter(
    "d_A_1_squared | d(A_1^2) | change of the square of (4) with the pose | length²",
    sum((squares[1].diff(p) * step for p, step in zip(pose, (d_alpha, d_beta, dz), strict=True)), sp.S.Zero),
)  # fmt: skip
d.state(
    "vector-of-4",
    equal(change_of_square, d_alpha),
    said="A marginal change of the vector of rotations and translation from (4)",
    text="The change of the square of (4) is the first component of that vector.",
    place="before eq. (6)",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140, d_alpha: 0, d_beta: 0, dz: 1},
    change_of_point,
    label="T6",
    because="The vector (dα, dβ, dz) stands in (5). Equation (4) is the length of one rod.",
)

# %% [markdown]
# ### Where the rods do not determine the pose
#
# The rods determine the pose to first order wherever $\det W_{33}$ is not zero. The paper does not write it out.

# %%
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
    equal(det_W33, written_det),
    text="The determinant of $W_{33}$.",
).prove(given={det_W33: W33.det(method="berkowitz")})

# %%
det_home = d.symbol(
    "det_W33_home", r"\det W_{33}|_{\alpha=\beta=0}", "determinant of W33 without tilt", "length⁵",
    value=written_det.subs({alpha: 0, beta: 0}),
)  # fmt: skip
d.check(
    "det-W33-home",
    equal(det_home, 8 * R**2 * z**3),
    text="Without tilt it is not zero: there the rods determine the pose.",
).prove()

# %% [markdown]
# ## The change of the point, from implicit equations
#
# The paper derives $M_{33}$ a second time. Equation (1), multiplied by $O_y^T$ and brought to one side, is (14); its
# three components, the first and the third times $-1$, are $H_1=H_2=H_3=0$, (15) to (17).

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
    text="Equation (1), multiplied by the transposed of $O_y$.",
    place="eq. (13)",
).prove(given=by_pose)

# %%
d.state(
    "eq-14",
    equal(-Oy.T * Q + Ox * im(shifted), sp.zeros(3, 1).as_immutable()),
    text="On one side, as $O_y^TO_y$ is the unit matrix.",
    place="eq. (14)",
).prove(given=by_pose)

# %%
letter_H = d.vector("H", r"\vec H", "left sides of (15) to (17)", "length", value=H)
d.state(
    "after-multiplying-3",
    equal(A0**2 - length_0**2, H[0]),
    said="After multiplying of (3) we get",
    text="(3), brought to one side and squared, is (15).",
    place="before eq. (15)",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140, A0: 1000, q: (0, 0, 0), Q: (0, 0, 600)},
    equal(sp.diag(-1, 1, -1).as_immutable() * (-Oy.T * Q + Ox * im(shifted)), letter_H),
    label="T7",
    because="(15) to (17) are the components of (14), the first and the third times −1. (3) is the length of a rod.",
)

# %%
for number, row, name in zip((15, 16, 17), H, ("first", "second", "third"), strict=True):
    d.state(
        f"eq-{number}",
        equal(row, 0),
        text=f"The {name} component, $H_{number - 14}=0$.",
        place=f"eq. ({number})",
    ).prove(given=by_pose)
d.page("eq-15", "eq-16", "eq-17")

# %% [markdown]
# The derivatives of $\vec H$ by the point are $F_{33}$, those by the pose $G_{33}$. Along every motion
# $F_{33}\,d\vec Q+G_{33}\,d(\alpha,\beta,z)=0$, so the derivative of the point is $-F_{33}^{-1}G_{33}$.

# %%
F33, G33 = H.jacobian(sp.Matrix(list(Q))), H.jacobian(sp.Matrix(pose))
letter_F33 = d.matrix("F33", "F_{33}", "derivatives of H by the point", "1", value=F33)
letter_G33 = d.matrix("G33", "G_{33}", "derivatives of H by the pose", "mixed", value=G33)
printed_F33 = sp.Matrix([[cb, 0, -sb], [0, -1, 0], [sb, 0, cb]])
printed_G33 = sp.Matrix(
    [
        [0, -Qx * sb - Qz * cb, 0],
        [(qz + z) * ca - qy * sa, 0, sa],
        [qy * ca + (qz + z) * sa, Qx * cb - Qz * sb, -ca],
    ]
)
d.state(
    "eq-18",
    equal(letter_F33, im(printed_F33)),
    text="The derivatives of $\\vec H$ by the point.",
    place="eq. (18)",
).prove()

# %%
d.state(
    "eq-19",
    equal(letter_G33, im(printed_G33)),
    text="The derivatives of $\\vec H$ by the pose.",
    place="eq. (19)",
).prove()

# %%
det_F33 = d.symbol("det_F33", r"\det F_{33}", "determinant of F33", "1", value=F33.det())
d.check(
    "det-F33",
    equal(det_F33, -1),
    text="$F_{33}$ can be inverted everywhere.",
).prove()

# %%
d.check(
    "M33",
    equal(letter_F33 * M33, -letter_G33),
    text="So $-F_{33}^{-1}G_{33}$ is $M_{33}$, the derivative of (1).",
).prove(given=by_pose)

# %%
h = qz + z
det_M33 = -h * (h * ca - qy * sa)
letter_det_M33 = d.symbol(
    "det_M33", r"\det M_{33}", "determinant of M33", "length²", value=true_M33.det(method="berkowitz")
)
d.check(
    "det-M33",
    equal(letter_det_M33, det_M33),
    text="The point determines the pose to first order where this is not zero.",
).prove()

# %%
d.check(
    "det-M33-by-roots",
    equal(letter_det_M33, -S * K * u * g),
    text="By the roots of the inverse problem: it vanishes exactly where two of the four poses meet.",
).prove(
    d.entries["det-M33"],
    d.entries["inverse"],
    equal(det_M33.xreplace(by_formula), -S * K * u * g),
    modulo=roots,
    because="With the sines, the cosines and z of `inverse` the determinant of `det-M33` becomes this product, as "
    "u² and g² are the sums under the roots and S² = K² = 1.",
)

# %% [markdown]
# The sensitivity of the point to the parameters is $A_{35}$: the parameters change the pose, and the pose the point.

# %%
F33_inverse = d.matrix(
    "F33_inverse", "F_{33}^{-1}", "inverse of F33, by the adjugate", "1", value=-F33.adjugate()
)
W33_inverse = d.matrix(
    "W33_inverse", "W_{33}^{-1}", "inverse of W33, by the adjugate", "mixed", value=W33.adjugate() / det_W33
)
d.state(
    "eq-20",
    equal((-F33_inverse * letter_G33) * (-W33_inverse * letter_W35), M33 * letter_M35),
    text="$A_{35}=\\left(-F_{33}^{-1}G_{33}\\right)\\left(-W_{33}^{-1}W_{35}\\right)$ is $M_{33}M_{35}$.",
    place="eq. (20)",
).prove(given=by_pose)

# %%
d.state(
    "cannot-be-derived",
    equal(det_W33 * det_F33, 0),
    said="Because of this, the equations cannot be partially derived, making the uncertainty analysis unfeasible",
    text="The implicit equations have no derivatives, as one of the two matrices cannot be inverted.",
    place="sec. 5",
).refute(
    {alpha: 0, beta: 0, z: 600, R: 330, r: 140},
    equal(det_W33 * det_F33, -written_det),
    given={det_W33: written_det},
    label="T8",
    because="The paper itself derives them: F33 is regular everywhere and W33 wherever the polynomial is not zero, "
    "which is so at home.",
)

# %% [markdown]
# ## Uncertainty
#
# The law of propagation of uncertainty, (21), takes the covariance matrix $U_x$ of the five parameters to that of the
# point, $U_y=A\,U_x A^T$, for any symmetric positive semidefinite $U_x$; (22) names its elements. A covariance matrix
# $U$ gives each linear function $\vec v$ the variance $\vec v^TU\vec v$, which must not be negative. Of (23) and
# Table 1 what can be checked independently is the uncertainty of a rectangular distribution of half width $a$.

# %%
half_width = d.symbol("a", "a", "permissible deviation", "length", positive=True)
standard = d.symbol("u_x", "u_x", "standard uncertainty", "length")
x = sp.Symbol("x", real=True)
variance = sp.integrate(x**2 / (2 * half_width), (x, -half_width, half_width))
U = sp.Matrix(5, 5, lambda i, j: sp.Symbol(f"u_{min(i, j) + 1}_{max(i, j) + 1}", real=True))
A = sp.Matrix(3, 5, lambda i, j: sp.Symbol(f"a_{i + 1}_{j + 1}", real=True))
v = sp.Matrix(sp.symbols("v_1:4", real=True))
any_U = d.matrix("U_any", "U_x", "any symmetric matrix", "length²", value=U, rows=5, columns=5)
any_A = d.matrix("A_any", "A", "any sensitivity", "1", value=A, columns=5)
any_U_y = d.matrix("U_y_any", "U_y", "A U_x Aᵀ", "length²", value=A * U * A.T)
any_v = d.vector("v", r"\vec v", "coefficients of a linear function of the point", "1")
carried_v = d.matrix("A_v", r"\vec w", "Aᵀ v, coefficients of a linear function of the parameters", "1",
                     value=A.T * v, rows=5, columns=1)  # fmt: skip
d.state(
    "eq-21",
    equal(any_U_y, any_A * any_U * any_A.T),
    equal(any_v.T * any_U_y * any_v, carried_v.T * any_U * carried_v),
    text="A linear function $\\vec v$ of the point is the function $\\vec w=A^T\\vec v$ of the parameters, and has the "
    "same variance by both matrices. So $U_y$ is symmetric and positive semidefinite whenever $U_x$ is.",
    place="eqs. (21) and (22)",
).prove()

# %% [markdown]
# A deviation that is equally likely everywhere between $-a$ and $a$ has the variance
# $\sigma^2=\int_{-a}^{a}x^2/(2a)\,dx$.

# %%
letter_variance = d.symbol(
    "variance", r"\sigma^2", "variance of a rectangular distribution", "length²", value=variance
)
scaled_variance = d.symbol(
    "variance_scaled", r"\sigma^2_\lambda", "the same in the other unit of length", "length²",
    value=variance.subs(half_width, scale * half_width),
)  # fmt: skip
d.state(
    "eq-23",
    equal(letter_variance, (half_width / sp.sqrt(3)) ** 2),
    text="The diagonal of (23) has $(a/\\sqrt3)^2$, the variance of a rectangular distribution of half width $a$.",
    place="eq. (23)",
).prove()

# %%
d.state(
    "table-1",
    equal(standard, half_width / sp.sqrt(3)),
    text="The uncertainty is 0.0029 mm for a permissible deviation of 0.005 mm, and 0.0058 mm for 0.010 mm.",
    place="Table 1",
).refute(
    {half_width: sp.Rational(5, 1000), standard: sp.Rational(29, 10000)},
    equal(standard**2, letter_variance),
    proof=[equal((half_width / sp.sqrt(3)) ** 2, variance)],
    label="T9",
    because="Table 1 is rounded to two digits: its squares are 0.9 % greater than those of (23), with which (24) was "
    "computed.",
)

# %%
d.state(
    "units",
    equal(scaled_variance, letter_variance),
    tacit=True,
    text="(23) and (24) have no unit, as if their numbers were the same in every unit of length.",
    place="eqs. (23) and (24)",
).refute(
    {half_width: 1, scale: 1000},
    equal(scaled_variance, scale**2 * letter_variance),
    label="T10",
    because="Both are in mm²: they are squares of lengths.",
)

# %% [markdown]
# ## The direct problem
#
# Which poses belong to three given lengths? Equations (7) to (9) are three equations for the pose. Four letters turn
# them into two polynomials,
# $$w=z^2,\qquad p=r-z\sin\beta,\qquad m=\cos\alpha+\cos\beta,\qquad e=\tfrac12(mr+k_3),$$
# with the numbers $k_2=(A_1^2-A_{-1}^2)/(\sqrt3R)$ and $k_3=(2A_0^2-A_1^2-A_{-1}^2)/(3R)$ from the lengths. By (7), $m$
# is linear in $w$, and so is $e$. The other two equations give the sines and cosines as quotients of polynomials in $p$
# and $w$. That their squares add up to one, $\sin^2+\cos^2=1$ for both angles, is two polynomial equations in $p$ and
# $w$. The resultant of the two in $p$ has the $w$ of every solution among its roots.

# %%
k2, k3 = (A1**2 - Am**2) / (sp.sqrt(3) * R), (2 * A0**2 - A1**2 - Am**2) / (3 * R)
letter_k2 = d.symbol("k_2", "k_2", "(A₁² − A₋₁²)/(√3 R)", "length", value=k2)
w = d.symbol("w", "w", "z²", "length²", value=z**2)
p = d.symbol("p", "p", "r − z sin β", "length", value=r - z * sb)
m = d.symbol(
    "m", "m", "(w + R² + r² − (A₀² + A₁² + A₋₁²)/3)/(R r)", "1",
    value=(w + R**2 + r**2 - (A0**2 + A1**2 + Am**2) / 3) / (R * r),
)  # fmt: skip
e = d.symbol("e", "e", "(m r + k₃)/2", "length", value=(m * r + k3) / 2)
by_e = {e: e, m: m, w: z**2, p: r - z * sb}
L1, L2, L3 = letter_L
d.check(
    "elimination",
    equal(L1, R * r * (m - ca - cb)),
    equal(L2, R * (letter_k2 + sa * (2 * z + r * sb))),
    equal(L3 + L1, 2 * R * (e - p * ca)),
    text="The three equations $\\vec L=\\vec 0$ are $\\cos\\alpha+\\cos\\beta=m$, "
    "$\\sin\\alpha\\,(2z+r\\sin\\beta)=-k_2$ and $p\\cos\\alpha=e$.",
).prove()

# %% [markdown]
# So $\cos\alpha=e/p$, $\cos\beta=m-e/p$, $\sin\beta=(r-p)/z$ and $\sin\alpha=-k_2z/s$ with $s=2w+r^2-rp$, which is
# $z\,(2z+r\sin\beta)$. With $C_\beta$ and $C_\alpha$ for the polynomials
# $$C_\beta=w\,(mp-e)^2+p^2(r-p)^2-p^2w,\qquad C_\alpha=e^2s^2+k_2^2\,w\,p^2-p^2s^2,$$
# the two circles are $C_\beta=0$ and $C_\alpha=0$.

# %%
circle_beta = w * (m * p - e) ** 2 + p**2 * (r - p) ** 2 - p**2 * w
spread = 2 * w + r**2 - r * p
circle_alpha = e**2 * spread**2 + k2**2 * w * p**2 - p**2 * spread**2
free = {name: name for name in (m, e, w, p)}
on_p = {cb: m - e / p, sb: (r - p) / z, ca: e / p, sa: -k2 * z / spread}
unit_beta = d.letter(
    r"unit_beta | (\cos^2\beta+\sin^2\beta) | sum of the squares for β | 1", (cb**2 + sb**2).xreplace(on_p)
)
unit_alpha = d.letter(
    r"unit_alpha | (\cos^2\alpha+\sin^2\alpha) | sum of the squares for α | 1", (ca**2 + sa**2).xreplace(on_p)
)
letter_spread = d.letter("s | s | 2w + r² − r p | length²", spread)
C_beta = d.letter(r"C_beta | C_\beta | circle of β, a polynomial in p and w | length⁴", circle_beta)
C_alpha = d.letter(r"C_alpha | C_\alpha | circle of α, a polynomial in p and w | length⁶", circle_alpha)
reach_of_alpha = d.letter(
    r"s_by_p | z(2z+r\sin\beta) | with the sine above | length²", ((2 * z + r * sb) * z).xreplace(on_p)
)
d.check(
    "two-circles",
    equal((unit_beta - 1) * p**2 * w, C_beta),
    equal((unit_alpha - 1) * p**2 * letter_spread**2, C_alpha),
    equal(reach_of_alpha, letter_spread),
    text="The two circles are polynomials of degree 4 in $p$, and of degree 3 and 4 in $w$, as $m$ and $e$ are linear "
    "in $w$.",
).prove(given={m: m, e: e, p: p, w: z**2})

# %% [markdown]
# Only $w=z^2$ occurs in them, not $z$. That is because solutions come in pairs:

# %%
opposite_L = d.vector(
    "L_opposite", r"\vec L(-\alpha,-\beta,-z)", "L in the opposite pose", "length²",
    value=L.subs({alpha: -alpha, beta: -beta, z: -z}, simultaneous=True),
)  # fmt: skip
d.check(
    "in-pairs",
    equal(opposite_L, letter_L),
    text="With $(\\alpha,\\beta,z)$ also $(-\\alpha,-\\beta,-z)$ solves the three equations.",
).prove()

# %% [markdown]
# Real solutions have $|m|\le2$, so $w$ lies in an interval that is known beforehand. How many complex ones there are
# is found exactly in an example, $R=330$, $r=140$, rods of 650, 700 and 760. Its resultant has the factors $w$ and $e$
# some times, which belong to no pose ($z=0$, and $p=e=0$); $n_w$ and $n_e$ count them, and $n$ is the degree in $w$ of
# what is left. It has $n_+$ positive roots, and no two are the same: the polynomial and its derivative have a common
# divisor of degree $n_0=0$. So there are at most 28 solutions, in pairs. In this example 4 of the 14 roots are real
# and positive, so there are 8 real poses; one of them has both cosines and $z$ positive. For the machine that is the
# physical one.

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
counted = [
    d.symbol(name, latex, quantity, "1", value=sp.Integer(value))
    for name, latex, quantity, value in (
        ("n_w", "n_w", "how often w divides the resultant", powers_of_w),
        ("n_e", "n_e", "how often e divides it", powers_of_e),
        ("n_left", "n", "degree of what is left", resultant.degree()),
        ("n_positive", "n_+", "number of its positive roots", resultant.count_roots(0, sp.oo)),
        (
            "n_common",
            "n_0",
            "degree of its divisor with its derivative",
            sp.gcd(resultant, resultant.diff()).degree(),
        ),
    )
]
d.check(
    "degree",
    *(equal(number, value) for number, value in zip(counted, (2, 4, 14, 4, 0), strict=True)),
    text="The degrees of the resultant in the example, and its roots.",
    assumptions=["R = 330, r = 140, A₀ = 650, A₁ = 700, A₋₁ = 760"],
).prove()

# %% [markdown]
# ## The derivatives that the kernel computes
#
# The functions of the package take the derivatives from the rods as vectors, which needs fewer operations than
# $W_{33}$ and $W_{35}$. With the platform's joint $\vec b_k=O\,(r\,\vec e_k+z\,\vec e_z)$ a rod is
# $\vec a_k=\vec b_k-R\,\vec e_k$, and $A_k^2=|\vec a_k|^2$ gives $A_k\,dA_k=\vec a_k\cdot d\vec a_k$:
# $$P\;d(\alpha,\beta,z)=\bigl(A_k\,dA_k-\vec a_k\cdot O\vec e_k\,dr+\vec a_k\cdot\vec e_k\,dR\bigr)_k$$
# with the rows $P_k=\vec a_k\cdot\partial\vec b_k/\partial(\alpha,\beta,z)$. $N$ has the rows
# $(\vec a_k\cdot O\vec e_k,\ -\vec a_k\cdot\vec e_k)$. The functions compute $P$ and $N$ by shorter formulas, and
# these are what is compared here with the derivatives of the squared lengths.


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
by_radii = sp.Matrix([[by_r, -by_R] for _, _, by_r, by_R in rows])
computed_rods = [
    d.vector(f"rod_{n}", rf"\vec a_{{{k}}}'", f"rod {k} in the program", "length", value=rod)
    for n, k, (rod, _, _, _) in zip("abc", directions, rows, strict=True)
]
letter_P = d.matrix("P", "P", "half the derivatives of the squared lengths by the pose", "mixed", value=P)
letter_N = d.matrix("N", "N", "half their derivatives by r and R", "length", value=by_radii, columns=2)
squares_by_pose = d.matrix(
    "squares_by_pose", r"\frac{\partial A^2}{\partial(\alpha,\beta,z)}", "squared lengths by the pose",
    "mixed", value=sp.Matrix(3, 3, lambda i, j: squares[i].diff(pose[j])),
)  # fmt: skip
squares_by_radii = d.matrix(
    "squares_by_radii", r"\frac{\partial A^2}{\partial(r,R)}", "their derivatives by r and R", "length",
    value=sp.Matrix(3, 2, lambda i, j: squares[i].diff((r, R)[j])), columns=2,
)  # fmt: skip
d.check(
    "rod-rows",
    *(equal(computed, rod) for computed, rod in zip(computed_rods, rod_vectors, strict=True)),
    equal(2 * letter_P, squares_by_pose),
    equal(2 * letter_N, squares_by_radii),
    text="The rods, and half the derivatives of their squares.",
).prove()

# %%
det_P = d.symbol("det_P", r"\det P", "determinant of P", "length⁵", value=P.det(method="berkowitz"))
of_rods = d.matrix(
    "A_diagonal", r"A_\mathrm{diag}", "diagonal matrix of the lengths", "length", value=sp.diag(*rods)
)
d.check(
    "P-and-W33",
    equal(letter_W33, -2 * letter_T0 * letter_P),
    equal(letter_T, 2 * letter_T0 * of_rods),
    equal(letter_radii, -2 * letter_T0 * letter_N),
    equal(det_W33, -16 / (3 * sp.sqrt(3)) * det_P),
    text="$P$ and $N$ hold the same as $W_{33}$ and $W_{35}$, in another combination: the constant matrix $T_0$ drops "
    "out of $-W_{33}^{-1}W_{35}$. $A_\\mathrm{diag}$ is the diagonal matrix of the lengths, $W_A$ and $W_{rR}$ the "
    "parts of $W_{35}$.",
).prove(given={det_W33: written_det})

# %% [markdown]
# ## The functions of the package
#
# Each function below is written once as a program of symbolic steps, from which the package's NumPy and C code is
# made. A status says what kind of pose was found.


# %%
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


def at_point_kernel():
    k = builder(
        "at_point",
        "Derivatives of the point by the rods and the two radii, and the rods, where the point is.",
        "conditions below eq. (4), eqs. (2) to (4) and (20)",
        "In the physical pose S = K = +1, without angles and case distinctions: NaN or infinite where there is no such "
        "pose. Every quantity is used as rarely as possible, so that intervals put into the steps give narrow "
        "intervals.",
    )
    X, Y, Z = k.input("point", 3, unit="length", doc="the point, from the base's centre")
    r, R = radii_inputs(k)
    q = q_input(k)
    level = k.let("level_squared", X**2 + Z**2)
    whole = k.let("whole_squared", level + Y**2 - q[0] ** 2)
    g = k.let("g", sp.sqrt(level - q[0] ** 2))
    sines = []
    # each angle is that of the point less that by which q is beside the middle rod
    for name, squared, opposite, adjacent, beside in (
        ("b", level, X, Z, q[0]),
        ("a", whole, Y, g, q[1]),
    ):
        inverse = k.let(f"by_{name}", 1 / sp.sqrt(squared))
        s, c = k.let(f"s{name}_point", opposite * inverse), k.let(f"c{name}_point", adjacent * inverse)
        less = k.let(f"s{name}_less", beside * inverse)
        across = k.let(f"c{name}_less", sp.sqrt(1 - less**2))
        sines = [k.let(f"s{name}", s * across - c * less), k.let(f"c{name}", c * across + s * less), *sines]
    sa, ca, sb, cb = sines
    z = k.let("z", sp.sqrt(whole - q[1] ** 2) - q[2])
    lean = k.let("lean", z * sb)
    middle = k.let("middle", r * cb / 4 + ca * (r * sp.Rational(3, 4) - lean / 2))
    side = k.let("side", sp.sqrt(3) / 2 * sa * (z + sb * r / 2))
    shared = k.let("shared", z**2 + r**2 + R**2)
    along = (k.let("along", r * cb + lean * ca), middle + side, middle - side)
    length = k.let("rod_length", sp.Matrix([sp.sqrt(shared - 2 * R * part) for part in along]))
    W33 = k.let("W33", printed_W33.xreplace(letters(sines, (z, r, R))).subs(z * sb, lean))
    adjugate = k.let("adjugate", cofactors(W33))
    inverse = k.let("inverse_determinant", 1 / (W33[0, :] * adjugate[:, 0])[0])
    M33 = sp.Matrix([[-sb * Y, Z, sb * ca], [g, 0, sa], [-cb * Y, -X, cb * ca]])
    N = k.let("N", k.let("M33", M33) * adjugate)
    # the lengths, factors of the first columns of W35, come last
    W35 = printed_W35.xreplace(letters(sines, (z, r, R), (1, 1, 1))).subs(z * sb, lean)
    by_radii = k.let("W35_radii", W35[:, 3:])
    A = (-(N * W35[:, :3]) * sp.diag(*length)).row_join(-(N * by_radii)) * inverse
    k.output("A35", A, unit="1", doc="derivatives of Q by A0, A1, A-1, r, R")
    k.output("legs", length, unit="length", doc="A0, A1, A-1")
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
# The propagation of uncertainty goes from the point to $U_y$ in one function. Roots and divisions give the sines and
# cosines of the pose; no angle is needed. $U_x$ is rejected where it is no covariance matrix: its correlations must be
# symmetric, and elimination must find no negative pivot. The tolerance, 256 times the machine epsilon, is what a matrix
# that was computed as a product may have lost.


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
# The package solves the direct problem by Newton's method, for the pose of the machine as it is built, in which both
# cosines and $z$ are positive. The start neglects what the tilt does to the second order. Each step $\delta$ solves
# $W_{33}\,\delta=-\vec L$. An angle is kept as its sine and cosine; instead of adding $\delta$ to it, the pair is
# turned by the exact rotation whose half angle has the tangent $\tfrac12\delta$. So the pairs stay sines and cosines,
# and no trigonometric function is called. Within the limits of the paper's machine five steps are enough to rounding;
# there is one more.

# %%
STEPS = 6
h = d.symbol("half_step", r"\tfrac12\delta", "half a step, as a tangent", "1")
step_sine, step_cosine = 2 * h / (1 + h**2), (1 - h**2) / (1 + h**2)
step_s = d.symbol("step_sine", r"s_\delta", "sine of a step, 2h/(1 + h²) with h = δ/2", "1", value=step_sine)
step_c = d.symbol("step_cosine", r"c_\delta", "cosine of a step, (1 − h²)/(1 + h²)", "1", value=step_cosine)
step_rate = d.symbol(
    "step_rate", r"\left.\frac{ds_\delta}{d(\delta/2)}\right|_{\delta=0}", "rate of a step", "1",
    value=step_sine.diff(h).subs(h, 0),
)  # fmt: skip
d.check(
    "step-is-a-rotation",
    equal(step_s**2 + step_c**2, 1),
    equal(step_rate, 2),
    equal((sa * step_c + ca * step_s) ** 2 + (ca * step_c - sa * step_s) ** 2, 1),
    text="The step has $s_\\delta=2h/(1+h^2)$ and $c_\\delta=(1-h^2)/(1+h^2)$ with $h=\\tfrac12\\delta$. It turns by "
    "$2h=\\delta$ to first order, and keeps sine and cosine on the circle.",
).prove()

# %%
level_L1, L2_by_alpha, L3_by_beta = (
    d.symbol(
        name,
        rf"\left.{latex}\right|_{{\alpha=\beta=0}}",
        quantity,
        "length²",
        value=form.subs({alpha: 0, beta: 0}),
    )
    for name, latex, quantity, form in (
        ("L_1_level", "L_1", "L₁ without tilt", L[0]),
        ("L_2_by_alpha", r"\frac{\partial L_2}{\partial\alpha}", "rate of L₂ there", L[1].diff(alpha)),
        ("L_3_by_beta", r"\frac{\partial L_3}{\partial\beta}", "rate of L₃ there", L[2].diff(beta)),
    )
)
d.check(
    "start",
    equal(level_L1, z**2 - ((A0**2 + A1**2 + Am**2) / 3 - (R - r) ** 2)),
    equal(L2_by_alpha, 2 * R * z),
    equal(L3_by_beta, 2 * R * z),
    text="The start: $z$ from (7) without tilt, the two sines from (8) and (9) to first order.",
).prove()


# %%
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
        at_point_kernel(),
        propagate_kernel(),
        singularity_kernel(),
    )
}

# %% [markdown]
# ## The functions compute what was proved
#
# The steps of each function, with its inputs replaced by the letters of this notebook, are compared with the formulas
# above: the rods, the four poses, $A_{35}$, and a step of Newton's method. A letter with the mark "fn" is what the
# function computes.


# %%
def steps(name, step, keep, **letters_):
    """A step of a kernel, with its names replaced by the derivation's letters."""
    kernel = kernels[f"tricept_{name}"]
    value = kernel.expand(kernel[step], keep=[kernel[n] for n in keep])
    return im(sp.Matrix([value]) if isinstance(value, sp.Expr) else value).subs(
        kernel.substitution(**letters_)
    )


by_letters = {"sa": sa, "ca": ca, "sb": sb, "cb": cb, "pose": (alpha, beta, z), "r": r, "R": R}
kernel_rods = [
    d.vector(
        f"rod_{name}_fn", rf"\vec a_{{{k}}}^{{\,\mathrm{{fn}}}}", f"rod {k} of the function legs", "length",
        value=sp.Matrix(steps("legs", f"rod_{name}", ("sa", "ca", "sb", "cb"), **by_letters)),
    )
    for name, k in zip("abc", directions, strict=True)
]  # fmt: skip
d.check(
    "kernel-legs",
    *(equal(computed, rod) for computed, rod in zip(kernel_rods, rod_vectors, strict=True)),
    text="The rods of `tricept_legs` are the vectors from joint to joint.",
).prove()

# %%
by_q = dict(zip(("q_x", "q_y", "q_z"), q, strict=True))
by_point = {"g": g, "u": u, "by_level": 1 / level, "by_whole": 1 / whole}
by_point |= {"point": list(Q), **by_q, "free_alpha": False, "free_beta": False}
kept = ("g", "u", "by_level", "by_whole", "free_alpha", "free_beta")
found_poses = []
for branch, (s_sign, k_sign) in enumerate(BRANCHES, start=1):
    signs = {S: s_sign, K: k_sign}
    for name, formula, factor, sign in (
        ("sa", sin_alpha, s_sign, s_sign * k_sign),
        ("ca", cos_alpha, 1, s_sign * k_sign),
        ("sb", sin_beta, 1, k_sign),
        ("cb", cos_beta, 1, k_sign),
    ):
        step = steps("inverse", f"{name}_{PLUS_MINUS[sign]}", kept, **by_point)
        latex = rf"\{'sin' if name[0] == 's' else 'cos'}\{'alpha' if name[1] == 'a' else 'beta'}"
        computed = d.letter(
            rf"{name}_fn_{branch} | {latex}^\mathrm{{fn}}_{{S={s_sign:+d},K={k_sign:+d}}} | "
            rf"of the function inverse, for S = {s_sign:+d} and K = {k_sign:+d} | 1",
            factor * step[0],
        )
        found_poses.append(equal(computed, formula.subs(signs)))
d.check(
    "kernel-inverse",
    *found_poses,
    text="The sines and cosines of `tricept_inverse` are those of the four poses.",
).prove()

# %%
by_letters |= {
    "rod_length": rods,
    **by_q,
    "singular": False,
    "inverse_determinant": -16 / (3 * sp.sqrt(3)) / det_W33,
}
kernel_A35 = d.matrix(
    "A35_fn", r"A_{35}^\mathrm{fn}", "A35 of the function sensitivity", "1", columns=5,
    value=sp.Matrix(
        steps("sensitivity", "A", ("sa", "ca", "sb", "cb", "rod_length", "inverse_determinant"), **by_letters)
    ),
)  # fmt: skip
d.check(
    "kernel-A35",
    equal(kernel_A35, M33 * letter_M35),
    text="The matrix of `tricept_sensitivity` is the $A_{35}$ of (20), with $\\det "
    "P=-\\tfrac{3\\sqrt3}{16}\\det W_{33}$.",
).prove()

# %% [markdown]
# `tricept_at_point` takes each angle as that of the point, less the one by which $\vec q$ is beside the middle rod.
# With the distances $\varrho$ and $\ell$ the sines of the two smaller angles are $q_x/\varrho$ and $q_y/\ell$. Its
# roots are positive, so their squares say what they are.

# %%
rho = d.symbol("rho", r"\varrho", "√(Q_x² + Q_z²)", "length", positive=True)
ell = d.symbol("ell", r"\ell", "√(|Q|² − q_x²)", "length", positive=True)
positive_roots = {rho: rho**2 - level, ell: ell**2 - whole, u: roots[u], g: roots[g]}
of_point = {"point": list(Q), **by_q}
by_distances = {"g": g, "by_b": 1 / rho, "by_a": 1 / ell, "cb_less": g / rho, "ca_less": u / ell}
SINES = ("sa", "ca", "sb", "cb")
of_roots = {"g": (), "by_b": (), "by_a": ("g",), "cb_less": ("by_b",), "ca_less": ("by_a",)}
squared_roots = [
    steps("at_point", name, keep, **of_point, **{kept: by_distances[kept] for kept in keep})[0] ** 2
    for name, keep in of_roots.items()
]
computed_pose = [
    *(steps("at_point", name, tuple(by_distances), **of_point, **by_distances)[0] for name in SINES),
    (steps("at_point", "z", (), **of_point)[0] + qz) ** 2,
]
at_point_roots = d.matrix(
    "roots_at_point", r"\vec\varrho^{\,\mathrm{fn}}", "squares of the roots of the function at_point", "mixed",
    value=sp.Matrix(squared_roots), rows=5, columns=1,
)  # fmt: skip
at_point_pose = d.matrix(
    "pose_at_point", r"\vec p^{\,\mathrm{fn}}", "sines, cosines and (z + q_z)² of the function at_point", "mixed",
    value=sp.Matrix(computed_pose), rows=5, columns=1,
)  # fmt: skip
physical = [formula.subs({S: 1, K: 1}) for formula in (sin_alpha, cos_alpha, sin_beta, cos_beta)]
d.check(
    "kernel-at-point-pose",
    equal(at_point_roots, im([g**2, 1 / rho**2, 1 / ell**2, (g / rho) ** 2, (u / ell) ** 2])),
    equal(at_point_pose, im([*physical, u**2])),
    text="The sines, the cosines and $z$ of `tricept_at_point` are those of the pose with $S=K=1$.",
).prove(modulo=positive_roots)

# %%
for name in ("pose", "singular", "inverse_determinant"):
    del by_letters[name]
by_letters |= {"z": z, "point": list(Q), "g": across}
pose_steps = (*SINES, "z")
at_point_squares = d.vector(
    "squares_at_point", r"\vec A^{2\,\mathrm{fn}}", "squared rods of the function at_point", "length²",
    value=sp.Matrix([rod**2 for rod in steps("at_point", "rod_length", pose_steps, **by_letters)]),
)  # fmt: skip
at_point_det = d.symbol(
    "det_at_point", r"\det\nolimits^\mathrm{fn} W_{33}", "det W33 of the function at_point", "length⁵",
    value=1 / steps("at_point", "inverse_determinant", pose_steps, **by_letters)[0],
)  # fmt: skip
by_letters["inverse_determinant"] = 1 / det_W33
kept = (*pose_steps, "g", "rod_length", "inverse_determinant")
at_point_A35 = d.matrix(
    "A35_at_point", r"A_{35}^\mathrm{at}", "A35 of the function at_point", "1", columns=5,
    value=sp.Matrix(3, 5, list(steps("at_point", "A35", kept, **by_letters))),
)  # fmt: skip
d.check(
    "kernel-at-point",
    *(equal(at_point_squares[n], square) for n, square in enumerate(squares)),
    equal(at_point_det, written_det),
    equal(at_point_A35, M33 * letter_M35),
    text="The rods of `tricept_at_point` are (2) to (4), and its matrix is the $A_{35}$ of (20), with the determinant "
    "of `det-W33`.",
).prove(given=by_pose)

# %%
unknown = ("sa1", "ca1", "sb1", "cb1", "z1", "c1", "c2", "c3")
by_step = {"sa1": sa, "ca1": ca, "sb1": sb, "cb1": cb, "z1": z, "r": r, "R": R}
by_step |= {
    "c1": R**2 + r**2 - (A0**2 + A1**2 + Am**2) / 3,
    "c2": (A1**2 - Am**2) / sp.sqrt(3),
    "c3": (2 * A0**2 - A1**2 - Am**2) / 3,
    "inverse2": 1 / W33.det(method="berkowitz"),
}
kernel_L, kernel_W33, kernel_move = (
    d.vector("L_fn", r"\vec L^\mathrm{fn}", "L in a step of the function direct", "length²",
             value=sp.Matrix(steps("direct", "L2", unknown, **by_step))),
    d.matrix("W33_fn", r"W_{33}^\mathrm{fn}", "W33 in that step", "mixed",
             value=sp.Matrix(steps("direct", "W2", unknown, **by_step))),
    d.vector("move_fn", r"\vec\delta^{\,\mathrm{fn}}", "the change of the pose in that step", "mixed",
             value=sp.Matrix(steps("direct", "move2", ("inverse2", *unknown), **by_step))),
)  # fmt: skip
d.check(
    "kernel-direct",
    equal(kernel_L, letter_L),
    equal(kernel_W33, letter_W33),
    equal(letter_W33 * kernel_move, -letter_L),
    text="Each step of `tricept_direct` solves $W_{33}\\,\\vec\\delta=-\\vec L$.",
).prove()

# %%
derivation.kernel(*kernels.values())
