# %% [markdown]
# # How uncertain is the place of a Tricept's tool?
#
# Three telescopic rods carry a platform, and a central rod, which carries no drive, guides it: a Cardan joint at the
# origin lets it turn by $\beta$ about y and by $\alpha$ about x, and it slides by $z$ along itself. The tool is at
# $\vec Q$. Every length, joint centre and axis of the machine has a small error. How far does each move the tool?
#
# E. Kureková and others ("Positioning uncertainty of the Tricept type parallel kinematic structure", 2015) list in
# section 3, a) to g), what makes the place of the tool uncertain; of this list they then follow five lengths. Here the
# whole list is followed, 43 parameters: the rods and their zeros, every coordinate of the six joint centres, the tool,
# and the guiding rod with its joint. One implicit derivative gives all of them, and the paper's matrix $A$ is the
# special case of five columns.
#
# After that come the paper's statements on covariance matrices, (21) to (24), and its section 4. Two results:
#
# - along a beam, at fixed angles, an element of the covariance matrix is a rational function of $z$ whose stationary
#   points are the roots of one polynomial;
# - intervals of the influences, added up as in (24), *enclose* the range of an element. They are not the range, and a
#   matrix put together of their ends need not be a covariance matrix.

# %%
import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import Derivation, Letter, coordinate_rotation, cross, equal, in_notebook, rot

d = derivation = Derivation(
    "tricept_uncertainty",
    title="Uncertainty of the place of a Tricept's tool",
    source='Kureková, Omachelová, Halaj and Martišovitš, "Positioning uncertainty of the Tricept type parallel '
    'kinematic structure", Acta IMEKO 4(4), 2015',
)

# %% [markdown]
# ## Symbols
#
# The joints of the base are $A$, $B$, $C$, those of the platform $A'$, $B'$, $C'$; $P$ is the centre of the base, in
# the origin, and $P'$ that of the platform. $\vec e_1,\vec e_2,\vec e_3$ are the unit vectors along x, y, z. $R_x$,
# $R_y$, $R_z$ are right-handed rotations; $O_y=R_y(\beta)$ and $O_x=R_x(\alpha)^T$ are the paper's.

# %%
alpha = d.symbol("alpha", r"\alpha", "turn about x, by the paper's (transposed) matrix", "rad")
beta = d.symbol("beta", r"\beta", "turn about y", "rad")
z = d.symbol("z", r"z", "length of the guiding rod, PP'", "length")
r = d.symbol("r", r"r", "radius of the joints of the platform", "length")
R = d.symbol("R", r"R", "radius of the fixed joints", "length")
F = [
    d.vector(f"fixed_{n}", rf"\vec {name}", f"fixed joint {name}", "length")
    for n, name in zip("012", "ABC", strict=True)
]
M = [
    d.vector(f"moving_{n}", rf"\vec {name}'", f"joint {name}' of the platform, in its axes", "length")
    for n, name in zip("012", "ABC", strict=True)
]
q = d.vector("q", r"\vec q", "the tool Q in the platform's axes, from P'", "length")
A0 = d.letter("rod_0>0 | A_{0} | length of the rod AA' | length")
A1 = d.letter("rod_1>0 | A_{1} | length of the rod BB' | length")
A2 = d.letter("rod_2>0 | A_{-1} | length of the rod CC' | length")
rods = (A0, A1, A2)
d


# %%
def columns(vector):
    """A letter's components as a matrix."""
    return sp.Matrix(list(vector))


def e(n):
    """A unit vector."""
    return sp.Matrix([int(k == n) for k in range(3)])


def turned_x(angle):
    """The paper's Ox, the transpose of the usual one."""
    return rot("x", angle).T


O_x, O_y = turned_x(alpha), rot("y", beta)
turned = O_y * O_x

# %% [markdown]
# ## The guiding rod with its errors
#
# Its joint has a centre (three coordinates, $\varepsilon_1$ to $\varepsilon_3$); a first axis, which may point
# elsewhere than y (turns about x and z, $\varepsilon_4$ and $\varepsilon_5$; one about y is $\beta$); a second axis
# that may pass the first at a distance ($\varepsilon_6$) and not at a right angle ($\varepsilon_7$); on it the rod,
# perhaps not at a right angle ($\varepsilon_{11}$; a turn about x is $\alpha$); and the platform on the rod, off its
# axis ($\varepsilon_8$, $\varepsilon_9$) and turned ($\varepsilon_{12}$ to $\varepsilon_{14}$). A shift of the
# platform along the rod, $\varepsilon_{10}$, is the paper's item e), the distance PP'. That makes 14 errors. With
# $\vec p=(\varepsilon_1,\varepsilon_2,\varepsilon_3)$ and $\vec o=(\varepsilon_8,\varepsilon_9,\varepsilon_{10})$ a
# point $\vec x$ of the platform is then at
#
# $$ \vec X=\vec p+R_x(\varepsilon_4)R_z(\varepsilon_5)\,O_y\,\Bigl(\varepsilon_6\vec
# e_3+R_z(\varepsilon_7)\,O_x\,R_y(\varepsilon_{11})\bigl(z\,\vec e_3+\vec
# o+R_x(\varepsilon_{12})R_y(\varepsilon_{13})R_z(\varepsilon_{14})\,\vec x\bigr) \Bigr). $$

# %%
GUIDE = (
    "P_x",
    "P_y",
    "P_z",
    "axis_x",
    "axis_z",
    "axes_gap",
    "axes_square",
    "rod_x",
    "rod_y",
    "rod_z",
    "rod_tilt",
    "mount_x",
    "mount_y",
    "mount_z",
)
guide = sp.Matrix(sp.symbols(" ".join(f"guide_{n}" for n in range(1, 15)), real=True))
none = dict.fromkeys(guide, sp.S.Zero)


def placed(x, g=guide, turn_x=O_x, turn_y=O_y, length=z):
    """Where a point of the platform is; the formula above."""
    on_rod = length * e(2) + sp.Matrix(g[7:10]) + rot("x", g[11]) * rot("y", g[12]) * rot("z", g[13]) * x
    at_second = g[5] * e(2) + rot("z", g[6]) * turn_x * rot("y", g[10]) * on_rod
    return sp.Matrix(g[0:3]) + rot("x", g[3]) * rot("z", g[4]) * turn_y * at_second


x = d.vector("x", r"\vec x", "a point of the platform, in its axes", "length")
X = columns(x)
Q = turned * (X + z * e(2))
Ox_letter, Oy_letter = (
    d.letter("O_x | O_x | the paper's rotation by α | 1", O_x),
    d.letter("O_y | O_y | rotation by β | 1", O_y),
)
e1, e2, e3 = (d.letter(rf"e_{n + 1}[3] | \vec e_{n + 1} | unit vector {n + 1} | 1", e(n)) for n in range(3))
ideal = d.letter(
    r"X_ideal | \vec X_{\varepsilon=0} | place of the point without errors | length", placed(X).xreplace(none)
)
d.state(
    "eq-1",
    equal(ideal, Oy_letter * Ox_letter * (x + z * e3)),
    text="Without errors a point of the platform is where the paper's (1) puts it.",
    place="eq. (1)",
).prove()

# %% [markdown]
# The derivatives of $\vec X$ by the pose and by each error, at a guiding rod without errors. A small turn about an axis
# is a cross product with it. $\vec s=\vec x+z\,\vec e_3$ leads from the joint to the point, in the platform's axes,
# and a prime on a rotation is its derivative by its angle.


# %%
def by_pose(X):
    """Derivatives of a point by α, β and z."""
    s = X + z * e(2)
    return sp.Matrix.hstack(O_y * O_x.diff(alpha) * s, O_y.diff(beta) * O_x * s, turned * e(2))


def by_guide(X, turned=turned, O_y=O_y, O_x=O_x, z=z):
    """Derivatives of a point by the errors of the guiding rod."""
    s = X + z * e(2)
    point = turned * s
    return sp.Matrix.hstack(
        *(e(n) for n in range(3)),
        e(0).cross(point),
        e(2).cross(point),
        O_y * e(2),
        O_y * e(2).cross(O_x * s),
        *(turned * e(n) for n in range(3)),
        turned * e(1).cross(s),
        *(turned * e(n).cross(X) for n in range(3)),
    )


s = d.letter(r"s | \vec s | from the guiding rod's joint to the point, x + z e₃ | length", X + z * e(2))
Ox_rate = d.letter("O_x_rate | O_x' | derivative of O_x by α | 1/rad", O_x.diff(alpha))
Oy_rate = d.letter("O_y_rate | O_y' | derivative of O_y by β | 1/rad", O_y.diff(beta))
pose_jacobian = placed(X).jacobian([alpha, beta, z]).xreplace(none)
d.check(
    "by-pose",
    *(
        equal(
            d.letter(
                rf"X_by_{name} | \frac{{\partial\vec X}}{{\partial {latex}}} | derivative by {name} | mixed",
                column,
            ),
            formula,
        )
        for name, latex, column, formula in zip(
            ("alpha", "beta", "z"),
            (r"\alpha", r"\beta", "z"),
            (pose_jacobian[:, n] for n in range(3)),
            (Oy_letter * Ox_rate * s, Oy_rate * Ox_letter * s, Oy_letter * Ox_letter * e3),
            strict=True,
        )
    ),
    equal(
        d.letter(
            r"X_by_pose | \frac{\partial\vec X}{\partial(\alpha,\beta,z)} | derivatives by the pose | mixed",
            pose_jacobian,
        ),
        d.letter("J | J | these derivatives in the program | mixed", by_pose(X)),
    ),
    text="The derivatives by the pose. $J$ is the matrix of these three columns, as the package computes it.",
).prove()

# %%
guide_jacobian = placed(X).jacobian(guide).xreplace(none)
turned_letter = Oy_letter * Ox_letter
formulas = (
    *(e1, e2, e3),
    *(cross(e1, ideal), cross(e3, ideal)),
    *(Oy_letter * e3, Oy_letter * cross(e3, Ox_letter * s)),
    *(turned_letter * n for n in (e1, e2, e3)),
    turned_letter * cross(e2, s),
    *(turned_letter * cross(n, x) for n in (e1, e2, e3)),
)
d.check(
    "by-guide",
    *(
        equal(
            d.letter(
                rf"X_by_{n} | \frac{{\partial\vec X}}{{\partial\varepsilon_{{{n}}}}} | derivative by error {n} | mixed",
                guide_jacobian[:, n - 1],
            ),
            formula,
        )
        for n, formula in enumerate(formulas, 1)
    ),
    equal(
        d.letter(
            r"X_by_errors | \frac{\partial\vec X}{\partial\vec\varepsilon} | derivatives by the 14 errors | mixed",
            guide_jacobian,
        ),
        d.letter("G | G | these derivatives in the program | mixed", by_guide(X)),
    ),
    text="The derivatives by the 14 errors of the guiding rod. $G$ is the matrix of these columns, as the package "
    "computes it.",
).prove()

# %% [markdown]
# ## The sensitivity, by the implicit function theorem
#
# The parameters $\vec\theta$ are 43 numbers: changes of $A_0,A_1,A_{-1}$ and of the radii $r$ and $R$, of the zeros of
# the three rods, of the 18 coordinates of the joints, of the three of the tool, and the 14 errors of the guiding rod.
# When one changes while the rods keep their lengths, the pose changes as well. Rod $k$ closes where
# $$\Lambda_k=|\vec l_k|^2-A_k^2=0,\qquad\vec l_k=\vec m_k-\vec F_k,$$
# with $\vec m_k$ the place of its joint on the platform and $\vec F_k$ that on the base. Half the differential of
# that is $\vec l_k\cdot(d\vec m_k-d\vec F_k)-A_k\,dA_k=0$. Let $W$ be the three rows
# $\vec l_k\cdot\partial\vec m_k/\partial(\alpha,\beta,z)$, and $V$ the same by the parameters. Then
# $W\,d(\alpha,\beta,z)+V\,d\vec\theta=0$, and the sensitivity of the tool is
# $$ \frac{d\vec Q}{d\vec\theta}=Q_\theta-Q_pW^{-1}V,$$
# where $Q_\theta$ is the derivative of the tool's place at a held pose, and $Q_p$ that by the pose. $W$, $V$, $Q_p$ and
# $Q_\theta$ are computed from $J$ and $G$ above; here they are compared with the derivatives of $\vec\Lambda$ and
# $\vec Q$ as functions of all parameters.

# %%
PARAMETERS = (
    "A0",
    "A1",
    "A-1",
    "r",
    "R",
    "zero_A0",
    "zero_A1",
    "zero_A-1",
    *(f"{joint}_{axis}" for joint in "ABC" for axis in "xyz"),
    *(f"{joint}p_{axis}" for joint in "ABC" for axis in "xyz"),
    *(f"q_{axis}" for axis in "xyz"),
    *GUIDE,
)
"""The order of the sensitivity's columns; Ap is A', and zero_A0 is added to what the rod AA' reads."""
DIRECTION = [
    sp.Matrix([sp.cos(2 * sp.pi * k / 3), sp.sin(2 * sp.pi * k / 3), 0]) for k in (0, 1, -1)
]  # of the joints on their circles


def loops(by_pose, by_guide, turned, leg, length):
    """W, V and the two derivatives of Q, of what they are made of: pairs (joints, tool)."""
    W = sp.Matrix.vstack(*(leg[k].T * by_pose[k] for k in range(3)))
    rows = []
    for k in range(3):
        mine = lambda v, k=k: [v if n == k else sp.Integer(0) for n in range(3)]  # noqa: E731
        along = leg[k].T * turned
        reading = mine(-length[k])
        rows.append(
            sp.Matrix(
                [
                    [
                        *reading,
                        along.dot(DIRECTION[k]),
                        -leg[k].dot(DIRECTION[k]),
                        *reading,
                        *(part for n in range(3) for part in (-leg[k].T if n == k else sp.zeros(1, 3))),
                        *(part for n in range(3) for part in (along if n == k else sp.zeros(1, 3))),
                        *sp.zeros(1, 3),
                        *(leg[k].T * by_guide[k]),
                    ]
                ]
            )
        )
    direct = sp.Matrix.hstack(sp.zeros(3, 26), turned, by_guide[3])
    return W, sp.Matrix.vstack(*rows), by_pose[3], direct


points = [*(columns(m) for m in M), columns(q)]
theta = {name: sp.Symbol(f"t{n}", real=True) for n, name in enumerate(PARAMETERS)}


def moved(names, at):
    """Add the parameters of these names to a vector."""
    return at + sp.Matrix([theta[name] for name in names])


def closure(k):
    """Λ of a rod in all parameters."""
    name, rod = "ABC"[k], ("A0", "A1", "A-1")[k]
    joint = moved([f"{name}p_{n}" for n in "xyz"], columns(M[k])) + theta["r"] * DIRECTION[k]
    fixed = moved([f"{name}_{n}" for n in "xyz"], columns(F[k])) + theta["R"] * DIRECTION[k]
    leg = placed(joint, sp.Matrix([theta[n] for n in GUIDE])) - fixed
    return leg.dot(leg) - (rods[k] + theta[rod] + theta[f"zero_{rod}"]) ** 2


tool = placed(moved(["q_x", "q_y", "q_z"], points[3]), sp.Matrix([theta[n] for n in GUIDE]))
still = dict.fromkeys(theta.values(), sp.S.Zero)
legs = [turned * (points[k] + z * e(2)) - columns(F[k]) for k in range(3)]
W, V, Q_pose, Q_direct = loops(
    [by_pose(p) for p in points], [by_guide(p) for p in points], turned, legs, rods
)
closures = sp.Matrix([closure(k) for k in range(3)])
W_letter = d.letter("W | W | half the derivatives of the closures by the pose | mixed", W)
V_letter = d.letter("V | V | half the derivatives of the closures by the parameters | mixed", V)
Qp_letter = d.letter("Q_p | Q_p | derivatives of the tool's place by the pose | mixed", Q_pose)
Qt_letter = d.letter(
    r"Q_theta | Q_\theta | derivatives of the tool's place by the parameters, at a held pose | mixed",
    Q_direct,
)
d.check(
    "loop-by-pose",
    equal(
        d.letter(
            r"closures_by_pose | \frac{\partial\vec\Lambda}{\partial(\alpha,\beta,z)} | of the three closures | mixed",
            closures.jacobian([alpha, beta, z]).xreplace(still),
        ),
        2 * W_letter,
    ),
    text="$W$ is half the derivative of the closures by the pose.",
).prove()

# %%
d.check(
    "loop-by-parameters",
    equal(
        d.letter(
            r"closures_by_parameters | \frac{\partial\vec\Lambda}{\partial\vec\theta} | of the three closures | mixed",
            closures.jacobian(list(theta.values())).xreplace(still),
        ),
        2 * V_letter,
    ),
    text="$V$ is half their derivative by the parameters.",
).prove()

# %%
d.check(
    "place-by-parameters",
    equal(
        d.letter(
            r"tool_by_parameters | \left.\frac{\partial\vec Q}{\partial\vec\theta}\right|_{\alpha,\beta,z} | "
            r"of the tool at a held pose | mixed",
            tool.jacobian(list(theta.values())).xreplace(still),
        ),
        Qt_letter,
    ),
    text="The tool's own derivative by the parameters, at a held pose.",
).prove()

# %% [markdown]
# $W$ is inverted by its adjugate, whose columns are the cross products of the rows of $W$. For any matrix $M$ with the
# rows $\vec a$, $\vec b$, $\vec c$ they are $\vec b\times\vec c$, $\vec c\times\vec a$ and $\vec a\times\vec b$, and
# its determinant is $\vec a\cdot(\vec b\times\vec c)$.

# %%
w = sp.Matrix(3, 3, sp.symbols("w_1_1:4 w_2_1:4 w_3_1:4", real=True))


def adjugate(w):
    """The adjugate and the determinant by cross products of the rows."""
    a, b, c = (w[n, :].T for n in range(3))
    return sp.Matrix.hstack(b.cross(c), c.cross(a), a.cross(b)), a.dot(b.cross(c))


any_matrix = d.matrix("w", "M", "any matrix with three rows", "1", value=Letter("w", 3, 3).components)
d.check(
    "adjugate",
    equal(
        d.letter(r"adj_M | \operatorname{adj}M | its adjugate by cross products | 1", adjugate(w)[0])
        * any_matrix,
        d.letter(r"det_M | \det M | its determinant | 1", adjugate(w)[1]) * sp.eye(3).as_immutable(),
    ),
    text="The adjugate by cross products, divided by the determinant, is the inverse.",
).prove()

# %% [markdown]
# ### The distance PP' is no source of uncertainty
#
# Item e), the distance PP', is on the paper's list. With the rods' lengths given it is no source of its own: a shift
# of the platform along the guiding rod is taken up by $z$. $V_{10}$ and $Q_{10}$ are the columns of $V$ and $Q_\theta$
# for that shift, $\varepsilon_{10}$; $W_z$ and $Q_z$ are the last columns of $W$ and $Q_p$.

# %%
rod_z = PARAMETERS.index("rod_z")
shift = d.letter(
    r"dQz_dPP | \partial Q_z/\partial\overline{PP'} | "
    r"what a shift of the platform along the guiding rod does to Q_z | 1",
    Q_direct[2, rod_z] - (Q_pose[2, :] * adjugate(W)[0]).dot(V[:, rod_z]) / adjugate(W)[1],
)
home = {F[k]: tuple(330 * DIRECTION[k]) for k in range(3)} | {
    M[k]: tuple(140 * DIRECTION[k]) for k in range(3)
}
d.state(
    "item-e",
    sp.Ne(shift, 0),
    text="The distance PP' contributes to the uncertainty of the tool.",
    said="geometrical parameters that contribute to the overall uncertainty of reaching the desired position: ... "
    "e) distance of the fixed platform and the movable one at the central rod, i.e. the distance PP'",
    place="sec. 3, e)",
).refute(
    {**home, q: (0, 0, 0), alpha: 0, beta: 0, z: 700},
    equal(shift, 0),
    proof=[
        equal(
            d.letter("V_10 | V_{10} | column of V for a shift along the guiding rod | mixed", V[:, rod_z]),
            d.letter("W_z | W_z | column of W for z | mixed", W[:, 2]),
        ),
        equal(
            d.letter(
                "Q_10 | Q_{10} | column of Q_θ for a shift along the guiding rod | mixed", Q_direct[:, rod_z]
            ),
            d.letter("Q_z | Q_z | column of Q_p for z | mixed", Q_pose[:, 2]),
        ),
    ],
    label="V1",
    because="With the rods' lengths given, PP' follows from them: a shift along the central rod acts on rods and tool "
    "as z does, so that z takes it up and Q does not move at all.",
)

# %% [markdown]
# ## The paper's A as five columns
#
# With the joints on their circles, $\vec F_k=R\,\vec e_k$ and $\vec m_k$ at $r\,\vec e_k$ with
# $\vec e_k=(\cos120°k,\ \sin120°k,\ 0)$, the numbers $(A_0,A_1,A_{-1},r,R)$ are the first five parameters: $r$ moves
# the three joints of the platform outwards together, $R$ the fixed ones. The paper's equations (7) to (9) are
# combinations $T\vec\Lambda$ of the closures with a constant matrix $T$; its $W_{33}$ and $W_{35}$ are their
# derivatives by the pose and by the five parameters, and its $F_{33}$ and $G_{33}$ give the derivative of $\vec Q$ by
# the pose. (They are written out and proved in the notebook `tricept`.) So its $A=M_{33}\,(-W_{33}^{-1}W_{35})$ with
# $M_{33}=-F_{33}^{-1}G_{33}$ is compared with the sensitivity piece by piece.

# %%
ca, sa, cb, sb = sp.cos(alpha), sp.sin(alpha), sp.cos(beta), sp.sin(beta)
root3 = sp.sqrt(3)
W33 = sp.Matrix(
    [
        [R * r * sa, R * r * sb, 2 * z],
        [R * ca * (2 * z + r * sb), R * r * sa * cb, 2 * R * sa],
        [R * sa * (r - 2 * z * sb), R * (2 * z * ca * cb - r * sb), 2 * R * ca * sb],
    ]
)
W35 = sp.Matrix(
    [
        [
            -2 * A0 / 3,
            -2 * A1 / 3,
            -2 * A2 / 3,
            2 * r - R * (ca + cb),
            2 * R - r * (ca + cb),
        ],
        [0, 2 * A1 / root3, -2 * A2 / root3, R * sa * sb, sa * (2 * z + r * sb)],
        [
            4 * A0 / 3,
            -2 * A1 / 3,
            -2 * A2 / 3,
            R * (cb - ca),
            r * cb + ca * (2 * z * sb - r),
        ],
    ]
)
place_of_q = turned * (points[3] + z * e(2))
qx, qy, qz = points[3]
F33 = sp.Matrix([[cb, 0, -sb], [0, -1, 0], [sb, 0, cb]])
G33 = sp.Matrix(
    [
        [0, -place_of_q[0] * sb - place_of_q[2] * cb, 0],
        [(qz + z) * ca - qy * sa, 0, sa],
        [qy * ca + (qz + z) * sa, place_of_q[0] * cb - place_of_q[2] * sb, -ca],
    ]
)
third = sp.Rational(1, 3)
T = sp.Matrix(
    [
        [third, third, third],
        [0, -1 / root3, 1 / root3],
        [-2 * third, third, third],
    ]
)
circles = {F[k]: tuple(R * DIRECTION[k]) for k in range(3)} | {
    M[k]: tuple(r * DIRECTION[k]) for k in range(3)
}
W33_letter, W35_letter, F33_letter, G33_letter, T_letter = (
    d.letter(f"{name} | {f'{name[0]}_{{{name[1:]}}}' if name != 'T' else 'T'} | {quantity} | mixed", value)
    for name, quantity, value in (
        ("W33", "the paper's derivatives of (7) to (9) by the pose", W33),
        ("W35", "the paper's derivatives of (7) to (9) by the five parameters", W35),
        ("F33", "the paper's derivatives of (15) to (17) by the point", F33),
        ("G33", "the paper's derivatives of (15) to (17) by the pose", G33),
        ("T", "from the closures to (7) to (9)", T),
    )
)
d.check(
    "paper-W33",
    equal(W33_letter, 2 * T_letter * W_letter),
    equal(T_letter, T.as_immutable()),
    text="The paper's $W_{33}$ is $2\\,T\\,W$, for joints on their circles.",
).prove(given=circles)

# %%
d.check(
    "paper-W35",
    equal(
        W35_letter, 2 * T_letter * d.letter(r"V_5 | V_{1\ldots5} | first five columns of V | mixed", V[:, :5])
    ),
    text="The paper's $W_{35}$ is $2\\,T$ times the first five columns of $V$.",
).prove(given=circles)

# %%
d.check(
    "T-regular",
    equal(d.letter(r"det_T | \det T | determinant of T | 1", T.det()), -2 * root3 / 9),
    text="$T$ can be inverted, so it drops out: $W_{33}^{-1}W_{35}=W^{-1}V_{1\\ldots5}$.",
).prove()

# %%
d.check(
    "paper-M33",
    equal(-G33_letter, F33_letter * Qp_letter),
    text="The paper's $M_{33}=-F_{33}^{-1}G_{33}$ is $Q_p$, the derivative of $\\vec Q$ by the pose.",
).prove()

# %%
d.check(
    "paper-direct",
    equal(
        d.letter(r"Q_5 | Q_{\theta,1\ldots5} | first five columns of Q_θ | mixed", Q_direct[:, :5]),
        sp.zeros(3, 5).as_immutable(),
    ),
    text="None of the five parameters moves the tool at a held pose. So the paper's $A=-M_{33}W_{33}^{-1}W_{35}$ is "
    "the first five columns of the sensitivity.",
).prove()

# %% [markdown]
# The radii could be left out, since the joints' coordinates are parameters as well:

# %%
radial = sum(
    (
        V[:, PARAMETERS.index(f"{name}_{axis}")] * DIRECTION[k][n]
        for k, name in enumerate("ABC")
        for n, axis in enumerate("xyz")
    ),
    sp.zeros(3, 1),
)
d.check(
    "radius-of-fixed-joints",
    equal(
        d.letter("V_R | V_R | column of V for the radius R | mixed", V[:, 4]),
        d.letter(
            r"V_radial | \sum_kV_{F_k}\vec e_k | columns of V for a radial shift of all fixed joints | mixed",
            radial,
        ),
    ),
    text="A change of $R$ is the same radial shift of all three fixed joints, and likewise $r$. So a covariance matrix "
    "of the joints' coordinates has that of $r$ and $R$ as its special case of full correlation.",
).prove()

# %% [markdown]
# ## Covariance matrices: (21) and (22)
#
# The estimates of the five parameters have errors $d\vec x$ with the covariance matrix $U_x$, whose elements are the
# expectations $u_{ij}=E[dx_i\,dx_j]$. The point has the errors $A\,d\vec x$.

# %%
a = sp.Matrix(3, 5, lambda i, j: sp.Symbol(f"a_{{{i + 1}{j + 1}}}", real=True))
names = [f"u_{{{min(i, j)}{max(i, j)}}}" for i in range(1, 6) for j in range(1, 6)]
U_x = sp.Matrix(5, 5, [sp.Symbol(name, real=True) for name in names])
bases = [(i, j) for i in range(5) for j in range(i, 5)]


def base(i, j):
    """The paper's base matrix: 1 in one place and in that across the diagonal."""
    return sp.Matrix(5, 5, lambda m, n: int((m, n) in ((i, j), (j, i))))


errors = sp.Matrix(sp.symbols("dx_1:6", real=True))


def expectation(form):
    """Put the covariance u_ij for each product dx_i dx_j of a quadratic form in the errors."""
    terms = sp.Poly(form, *errors).terms()
    places = [
        ([n for n, power in enumerate(powers) for _ in range(power)], factor) for powers, factor in terms
    ]
    return sum((factor * U_x[i, j] for (i, j), factor in places), sp.Integer(0))


a_letter = d.letter("A_any | A | any sensitivity, with the elements a_ij | 1", a)
Ux_letter = d.letter("U_x | U_x | any symmetric matrix, with the elements u_ij | length²", U_x)
d.state(
    "eq-21",
    equal(
        a_letter * Ux_letter * a_letter.T,
        d.letter(
            r"U_y | E\bigl[(A\,d\vec x)(A\,d\vec x)^T\bigr] | "
            r"expectation of the products of the point's errors | length²",
            (a * errors * (a * errors).T).applyfunc(expectation),
        ),
    ),
    text="The covariance matrix of the point is $U_y=A\\,U_xA^T$, for any $U_x$.",
    place="eq. (21)",
).prove()

# %% [markdown]
# The paper's base matrix $E_{ij}$ has a one in place $ij$ and in place $ji$, and zeros elsewhere.

# %%
d.state(
    "eq-22",
    equal(
        Ux_letter,
        d.letter(
            r"U_by_bases | \sum_{i\le j}u_{ij}E_{ij} | sum of the base matrices | length²",
            sum((U_x[i, j] * base(i, j) for i, j in bases), sp.zeros(5)),
        ),
    ),
    equal(Ux_letter, Ux_letter.T),
    text="A covariance matrix is symmetric: fifteen numbers, and fifteen base matrices.",
    place="eq. (22), sec. 4",
).prove()

# %%
d.state(
    "linear-in-bases",
    equal(
        a_letter * Ux_letter * a_letter.T,
        d.letter(
            r"Uy_by_bases | \sum_{i\le j}u_{ij}\,A\,E_{ij}A^T | sum of the influences of the base matrices | length²",
            sum((U_x[i, j] * a * base(i, j) * a.T for i, j in bases), sp.zeros(3)),
        ),
    ),
    said="Estimates of 15 base matrices Ux can be linearly combined and can thus provide an estimate for any general "
    "(non-base) symmetric matrix Ux",
    text="$U_y$ is the sum of the influences of the base matrices.",
    place="sec. 4",
).prove(because="At one position this is so; what it means for intervals over many positions stands below.")

# %%
root = sp.Matrix(5, 5, lambda i, j: sp.Symbol(f"l_{{{i + 1}{j + 1}}}", real=True))
v_letter = d.vector("v", r"\vec v", "any linear function of the point", "1")
v = columns(v_letter)
image = root.T * a.T * v
root_letter = d.letter("L | L | any matrix with U_x = L Lᵀ | length", root)
image_letter = d.letter(r"L_A_v | \vec g | Lᵀ Aᵀ v | length", image)
d.check(
    "semidefinite",
    equal(
        v_letter.T * (a_letter * root_letter * root_letter.T * a_letter.T) * v_letter,
        image_letter.T * image_letter,
    ),
    text="If $U_x=LL^T$ is positive semidefinite, so is $U_y$: the variance $\\vec v^TU_y\\vec v$ of each linear "
    "function is the square of the vector $\\vec g=L^TA^T\\vec v$.",
).prove()

# %%
rod_u, fixed_u = sp.Rational(5, 1000), sp.Rational(1, 100)  # permissible deviations of rods and radii, (23)

# %% [markdown]
# ## A mirror, and why (24) has ±
#
# The machine is its own mirror image in the plane $y=0$, which exchanges the rods B and C. So over a region that is
# symmetric in $y$, with equal uncertainties of these rods, the covariances $u_{xy}$ and $u_{yz}$ take opposite values
# in pairs; $u_{xz}$ does not. That is the pattern that (24) shows.
#
# To prove it, $A$ is taken at $-\alpha$, with the rods B and C exchanged; a tilde marks it. With the diagonal matrices
# $D_y=\operatorname{diag}(1,-1,1)$ and $D_\alpha=\operatorname{diag}(-1,1,1)$ and the permutation $\Pi$ of the five
# parameters that exchanges the two rods, $\tilde A=D_yA\,\Pi$. The tool is at the centre of the platform.

# %%
mirror = sp.diag(1, -1, 1)
swap = sp.Matrix([[1, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 1, 0, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]])
swapped = {A1: A2, A2: A1}
flip = sp.diag(-1, 1, 1)  # of (alpha, beta, z)
change = sp.diag(1, -1, 1)  # of the three equations
M33 = sp.Matrix(
    [[-z * sb * sa, z * cb * ca, sb * ca], [z * ca, 0, sa], [-z * cb * sa, -z * sb * ca, cb * ca]]
)
no_tool = {q: (0, 0, 0)}
M33_letter = d.letter("M33 | M_{33} | the paper's derivatives of Q by the pose, for q = 0 | mixed", M33)
Dy = d.letter("D_y | D_y | mirror in the plane y = 0 | mixed", mirror)
Da = d.letter(r"D_alpha | D_\alpha | change of sign of α | mixed", flip)
Pi = d.letter(r"Pi | \Pi | exchange of the rods B and C | mixed", swap)
d.check(
    "M33",
    equal(Qp_letter, M33.as_immutable()),
    text="The derivatives by the pose where the tool is $P'$, $\\vec q=\\vec 0$; from here on $M_{33}$ is this matrix.",
).prove(given=no_tool)

# %%


def mirrored(m):
    """The matrix at -alpha, with the rods B and C exchanged."""
    return m.xreplace({alpha: -alpha, **swapped})


W33_mirror, W35_mirror, M33_mirror = (
    d.letter(
        rf"{name}_mirror | \tilde {name[0]}_{{{name[1:]}}} | {name} at −α, the rods B and C exchanged | mixed",
        mirrored(value),
    )
    for name, value in (("W33", W33), ("W35", W35), ("M33", M33))
)
d.check(
    "mirror-W33",
    equal(W33_mirror, Dy * W33_letter * Da),
    text="$W_{33}$ in the mirror.",
).prove()

# %%
d.check(
    "mirror-W35",
    equal(W35_mirror, Dy * W35_letter * Pi),
    text="$W_{35}$ in the mirror.",
).prove()

# %%
d.check(
    "mirror-M33",
    equal(M33_mirror, Dy * M33_letter * Da),
    text="$M_{33}$ in the mirror. Together: $\\tilde A=-\\tilde M_{33}\\tilde W_{33}^{-1}\\tilde W_{35}=D_yA\\,\\Pi$, "
    "since $D_y$ and $D_\\alpha$ are their own inverses.",
).prove()

# %% [markdown]
# ## Section 4: an element of U_y along a beam
#
# A beam is the line of all poses with given angles; $z$ varies along it. There $W_{33}^{-1}$ is a matrix of
# polynomials in $z$ over the polynomial $D=\det W_{33}$ of degree 3. So the elements of $A$ are
# $a_{ki}=A_i\,n_{ki}/D$ for the rods and $n_{ki}/D$ for the radii, with polynomials $n_{ki}$. The lengths $A_i$ are
# roots of polynomials in $z$: with $\lambda_k=-R\,\vec e_k\cdot O_yO_x\vec e_3$ and $\kappa_k=R^2+r^2-2Rr\,\vec
# e_k\cdot O_yO_x\vec e_k$,

# %%
c_a, s_a, c_b, s_b = (
    d.symbol(f"{part[0]}_{angle}", rf"\{part}\{angle}", f"{what} of {angle}, as a letter", "1")
    for angle in ("alpha", "beta")
    for part, what in (("cos", "cosine"), ("sin", "sine"))
)
letters = {sa: s_a, ca: c_a, sb: s_b, cb: c_b}
bare = W35.copy()
for n in range(3):
    bare[:, n] = (W35[:, n] / rods[n]).expand()
adjugate_W33, det_W33 = adjugate(W33.xreplace(letters))
numerator = (-Q_pose.xreplace(letters) * adjugate_W33 * bare.xreplace(letters)).expand()
determinant = sp.Poly(det_W33.expand(), z)
parts = [[sp.Poly(numerator[k, i], z) for i in range(5)] for k in range(3)]
at_home_tool = dict(zip(q, (0, 0, 0), strict=True))
plain = [[sp.Poly(p.as_expr().xreplace(at_home_tool), z) for p in row] for row in parts]
on_circles = [sp.Matrix(d.value(sp.ImmutableMatrix(leg), given=circles)).xreplace(letters) for leg in legs]
circle_relations = {s_a: s_a**2 + c_a**2 - 1, s_b: s_b**2 + c_b**2 - 1}
half_slopes = [-R * (DIRECTION[k].T * turned.xreplace(letters))[2] for k in range(3)]
constants = [
    R**2 + r**2 - 2 * R * r * (DIRECTION[k].T * turned.xreplace(letters) * DIRECTION[k])[0] for k in range(3)
]
monic = [z**2 + z * 2 * slope + constant for slope, constant in zip(half_slopes, constants, strict=True)]
d.check(
    "lengths-on-a-beam",
    *(
        equal(
            d.letter(
                rf"l_{n}_squared | |\vec l_{{{k}}}|^2 | square of the length of rod {k} | length²",
                leg.dot(leg),
            ),
            z**2
            + 2 * z * d.letter(rf"lambda_{n} | \lambda_{{{k}}} | half the slope for rod {k} | length", slope)
            + d.letter(rf"kappa_{n} | \kappa_{{{k}}} | constant term for rod {k} | length²", constant),
        )
        for n, k, leg, slope, constant in zip(
            range(3), (0, 1, -1), on_circles, half_slopes, constants, strict=True
        )
    ),
    text="The square of each length is a quadratic in $z$.",
).prove(modulo=circle_relations)

# %% [markdown]
# For a diagonal $U_x$ a variance is $N/D^2$ with $N=\sum_iu_{ii}A_i^2n_{ki}^2$, and its stationary points are the
# roots of $N'D-2ND'$, where the prime is the derivative by $z$. The degrees are those for the tool at $P'$ and angles
# of general position; $\ell[\ldots]$ is a leading coefficient, $n_8$ that of $N$ and $d_3$ that of $D$. Leading terms
# of $N$ are squares times variances, so they do not cancel.

# %%
n_z = sp.Poly([sp.Symbol(f"n_{{{n}}}", real=True) for n in reversed(range(9))], z)
d_z = sp.Poly([sp.Symbol(f"d_{{{n}}}", real=True) for n in reversed(range(4))], z)
stationary = n_z.diff(z) * d_z - 2 * n_z * d_z.diff(z)
squared = [2 * (plain[k][i].degree() + (1 if i < 3 else 0)) for k in range(3) for i in range(5)]
d.state(
    "degrees",
    *(
        equal(d.letter(f"{name} | {latex} | degree of {quantity} | 1", sp.Integer(value)), wanted)
        for name, latex, quantity, value, wanted in (
            ("deg_N", r"\deg N", "N", max(squared), 8),
            ("deg_D2", r"\deg D^2", "D²", 2 * determinant.degree(), 6),
            ("deg_stationary", r"\deg(N'D-2ND')", "N′D − 2ND′", stationary.degree(), 10),
        )
    ),
    equal(
        d.letter(
            r"lc_stationary | \ell[N'D-2ND'] | leading coefficient of N′D − 2ND′ | mixed", stationary.LC()
        ),
        2 * n_z.LC() * d_z.LC(),
    ),
    said="Each element value of the matrix Uy ... can be precisely expressed using a formula ... divided by other "
    "polynomials also dependent on z",
    text="The formula exists: a polynomial of degree 8 over one of degree 6. Its stationary points are among the roots "
    "of a polynomial of degree 10.",
    place="sec. 4",
).prove()

# %% [markdown]
# For a single element of $U_x$ the influence is $\sqrt S\,P/D^2$ with polynomials $S$, $P$ and $D$: $S$ is 1, or the
# square of a length, or of a product of two.

# %%
functions = {name: sp.Function(name)(z) for name in ("S", "P", "D")}
S_z, P_z, D_z = functions.values()
rates = {
    sp.diff(f, z): d.symbol(f"{name}_rate", f"{name}'", f"derivative of {name} by z", "1")
    for name, f in functions.items()
}
values = {
    f: d.symbol(name, name, f"value of the polynomial {name} in z", "1", positive=True)
    for name, f in functions.items()
}
slope = sp.diff(sp.sqrt(S_z) * P_z / D_z**2, z).xreplace(rates).xreplace(values)
S_, P_, D_ = values.values()
S1, P1, D1 = rates.values()
d.state(
    "stationary-points",
    equal(
        d.letter(
            r"slope | \frac{d}{dz}\frac{\sqrt S\,P}{D^2} | derivative of the influence by z | mixed", slope
        )
        * 2
        * sp.sqrt(S_)
        * D_**3,
        S1 * P_ * D_ + 2 * S_ * (P1 * D_ - 2 * P_ * D1),
    ),
    said="any stationary point of the original expression is also the root of this polynomial",
    text="One root occurs, and goes out when the derivative is multiplied by $2\\sqrt S\\,D^3$. What is left is "
    "a polynomial.",
    place="sec. 4",
).prove()

# %% [markdown]
# For a full $U_x$ an element $kl$ of $U_y$ is $N_{kl}/D^2$ with
# $N_{kl}=\sum_{ij}A_iA_j\,n_i\,m_j\,u_{ij}$, where $n_i=n_{ki}$ and $m_j=n_{lj}$, and $A_i=1$ for the two radii. Its
# terms are sorted: $\Sigma_6$ are those with one of the six factors $A_0A_1$, $A_0A_{-1}$, $A_1A_{-1}$, $A_0$, $A_1$,
# $A_{-1}$, which are square roots of polynomials; $\Sigma_0$ are the others, which have no root, since $A_i^2$ is a
# polynomial.

# %%
n_k, n_l = ([sp.Symbol(f"{name}_{{{i}}}", real=True) for i in range(1, 6)] for name in ("n", "m"))
A = (*rods, sp.S.One, sp.S.One)
element = sum((A[i] * A[j] * n_k[i] * n_l[j] * U_x[i, j] for i in range(5) for j in range(5)), sp.S.Zero)
six = [
    *(A[i] * A[j] * (n_k[i] * n_l[j] + n_k[j] * n_l[i]) * U_x[i, j] for i, j in ((0, 1), (0, 2), (1, 2))),
    *(A[i] * sum((n_k[i] * n_l[j] + n_k[j] * n_l[i]) * U_x[i, j] for j in (3, 4)) for i in range(3)),
]
free = (
    sum((A[i] ** 2 * n_k[i] * n_l[i] * U_x[i, i] for i in range(5)), sp.S.Zero)
    + (n_k[3] * n_l[4] + n_k[4] * n_l[3]) * U_x[3, 4]
)
variances = [rod_u**2 / 3] * 3 + [fixed_u**2 / 3] * 2
element_letter = d.letter("N_kl | N_{kl} | numerator of an element of U_y | mixed", element)
six_letter = d.letter(
    r"Sigma_6 | \Sigma_6 | its terms with one of the six roots | mixed", sum(six, sp.S.Zero)
)
free_letter = d.letter(r"Sigma_0 | \Sigma_0 | its terms without a root | mixed", free)
d.state(
    "six-roots",
    equal(element_letter, six_letter),
    text="The numerator is a sum of six square roots.",
    said="a formula that is represented by the sum of 6 square roots of polynomials of the variable z divided by "
    "other polynomials",
    place="sec. 4",
).refute(
    {
        **{U_x[i, j]: (variances[i] if i == j else 0) for i, j in bases},
        **{name: sp.Rational(1, 2100) for name in (*n_k[:3], *n_l[:3])},
        **{n_k[3]: sp.Rational(190, 700), n_l[3]: sp.Rational(190, 700)},
        **{n_k[4]: -sp.Rational(190, 700), n_l[4]: -sp.Rational(190, 700)},
        **dict.fromkeys(rods, sp.sqrt(526100)),
    },
    equal(element_letter, free_letter + six_letter),
    label="V2",
    because="The six roots are A0A1, A0A-1, A1A-1, A0, A1, A-1, plus a part without a root. For a diagonal U_x, such "
    "as the paper's (23), only that part remains: no root at all. (Here: u²(Q_z) at α = β = 0, z = 700 mm.)",
)

# %% [markdown]
# ## (24): added intervals enclose the range, and are not it
#
# The paper finds the least and the greatest influence of each base matrix over a cube of poses, and adds these up.
# But the least value of a sum is at least the sum of the least values, and more where these are not taken at one
# place. The mirror shows it without any search: at $(\alpha,0,z)$ and at $(-\alpha,0,z)$ the variance $u^2(Q_z)$ is
# the same number, since the rods B and C change places; the intervals of their two influences are not points.
# $b_{ij}$ is the influence of rod $j$ at place $i$.

# %%
place_alpha = {s_a: sp.Rational(20, 101), c_a: sp.Rational(99, 101), s_b: 0, c_b: 1, z: 700, R: 330, r: 140}


def squared_influence(i):
    """The squared element of A for Q_z and rod i at that place."""
    n = plain[2][i].as_expr().xreplace(place_alpha) / det_W33.expand().xreplace(place_alpha)
    return sp.nsimplify(n**2 * monic[i].xreplace(place_alpha))


b = [
    d.symbol(f"b_{i}_{j}", f"b_{{{i}{j}}}", f"influence of rod {j} at place {i}", "1", positive=True)
    for i in (1, 2)
    for j in (1, 2)
]
least_of_sum = sp.Min(b[0] + b[1], b[2] + b[3])
sum_of_least = sp.Min(b[0], b[2]) + sp.Min(b[1], b[3])
d_1, d_2 = b[0] - b[2], b[1] - b[3]


def by_absolute(a, c):
    """The lesser of two numbers."""
    return (a + c - sp.Abs(a - c)) / 2


d.state(
    "eq-24-range",
    equal(least_of_sum, sum_of_least),
    said="a matrix of ordered pairs (minimum and maximum impacts of components of the matrix Ux). They represent the "
    "range of values of elements of the matrix Uy",
    text="For two rods at two places: the least sum of the two influences is the sum of the least ones.",
    place="sec. 4, eq. (24)",
).refute(
    {
        b[0]: squared_influence(1),
        b[1]: squared_influence(2),
        b[2]: squared_influence(2),
        b[3]: squared_influence(1),
    },
    equal(
        by_absolute(b[0] + b[1], b[2] + b[3]),
        by_absolute(b[0], b[2])
        + by_absolute(b[1], b[3])
        + (sp.Abs(d_1) + sp.Abs(d_2) - sp.Abs(d_1 + d_2)) / 2,
    ),
    label="V3",
    proof=[
        equal(
            by_absolute(b[0], b[2]) + by_absolute(b[1], b[3]) + (sp.Abs(d_1) + sp.Abs(d_2)) / 2, sum(b) / 2
        ),
        equal(by_absolute(b[0] + b[1], b[2] + b[3]) + sp.Abs(d_1 + d_2) / 2, sum(b) / 2),
    ],
    because="Intervals added up enclose the range: the last term is never negative (|x| + |y| >= |x + y|), and 0 only "
    "where both rods' influences rise together. Eq. (24) is such an outer enclosure. (Here: the rods B and C, Q_z, at "
    "sin α = ±20/101, β = 0, z = 700 mm.)",
)

# %%
printed = sp.Matrix(
    3,
    3,
    lambda i, j: sp.Rational(
        {
            (0, 0): "0.0000185",
            (1, 1): "0.0000185",
            (2, 2): "0.0000038",
            (0, 1): "0.0000070896",
            (0, 2): "-0.0000073262",
            (1, 2): "0.0000073394",
        }[min(i, j), max(i, j)]
    ),
)
entries = [
    d.symbol(f"y_{key}", f"u_{{{xy}}}", f"element {xy} of U_y", "mm²")
    for key, xy in (("1", "xx"), ("2", "yy"), ("3", "zz"), ("12", "xy"), ("13", "xz"), ("23", "yz"))
]
general = sp.Matrix(
    [
        [entries[0], entries[3], entries[4]],
        [entries[3], entries[1], entries[5]],
        [entries[4], entries[5], entries[2]],
    ]
)
by_hand = (
    entries[0] * entries[1] * entries[2]
    + 2 * entries[3] * entries[4] * entries[5]
    - entries[0] * entries[5] ** 2
    - entries[1] * entries[4] ** 2
    - entries[2] * entries[3] ** 2
)
d.state(
    "eq-24-corners",
    sp.Ge(by_hand, 0),
    tacit=True,
    text="A matrix with elements in the intervals (24) is a covariance matrix: its determinant, here written out, is "
    "not negative.",
    place="eq. (24)",
).refute(
    dict(
        zip(
            entries,
            (printed[0, 0], printed[1, 1], printed[2, 2], printed[0, 1], printed[0, 2], printed[1, 2]),
            strict=True,
        )
    ),
    equal(d.letter(r"det_U_y | \det U_y | determinant of U_y | mm⁶", general.det()), by_hand),
    label="V4",
    because="The elements do not take their extremes together. A corner of (24) can have a negative determinant; no "
    "matrix may be put together of them.",
)

# %% [markdown]
# ## The functions of the package
#
# They compute the sensitivity by $W$, $V$, $Q_p$ and $Q_\theta$ from $J$ and $G$ with the very functions that were
# compared above, and the closures with all errors.


# %%
def sensitivity_kernel():
    k = KernelBuilder(
        "tricept_parameter_sensitivity",
        summary="Sensitivity of a Tricept's tool to every geometrical parameter.",
        source="Kureková et al., sec. 3 a) to g) and eq. (20); derivation tricept_uncertainty",
        notes="The columns are in the order of PARAMETERS; the first five, with the joints on their circles, are the "
        "paper's A.",
    )
    pose = k.input("pose", 3, unit="rad, rad, length", doc="alpha, beta, z")
    fixed = k.input("fixed", (3, 3), unit="length", doc="the fixed joints A, B, C, a row each")
    moving = k.input("moving", (3, 3), unit="length", doc="the joints A', B', C' in the platform's axes")
    tool = k.input("tool", 3, unit="length", doc="Q in the platform's axes")
    ca, sa = k.let("c_alpha", sp.cos(pose[0])), k.let("s_alpha", sp.sin(pose[0]))
    cb, sb = k.let("c_beta", sp.cos(pose[1])), k.let("s_beta", sp.sin(pose[1]))
    O_x, O_y = coordinate_rotation("x", ca, sa).T, coordinate_rotation("y", cb, sb)
    turned = k.let("turn", O_y * O_x)
    dO = (
        sp.Matrix([[0, 0, 0], [0, -sa, ca], [0, -ca, -sa]]),
        sp.Matrix([[-sb, 0, cb], [0, 0, 0], [-cb, 0, -sb]]),
    )
    by_pose, by_error, places = [], [], []
    for n, x in enumerate((*(moving[i, :].T for i in range(3)), tool)):
        s = x + pose[2] * e(2)
        place = k.let(f"at_{n}", turned * s)
        by_pose.append(
            k.let(f"by_pose_{n}", sp.Matrix.hstack(O_y * dO[0] * s, dO[1] * O_x * s, turned * e(2)))
        )
        by_error.append(k.let(f"by_guide_{n}", by_guide(x, turned, O_y, O_x, pose[2])))
        places.append(place)
    leg = [k.let(f"leg_{n}", places[n] - fixed[n, :].T) for n in range(3)]
    length = [k.let(f"length_{n}", sp.sqrt(leg[n].dot(leg[n]))) for n in range(3)]
    W, V, Q_pose, direct = loops(by_pose, by_error, turned, leg, length)
    W = k.let("w", W)
    adj, det = adjugate(W)
    det = k.let("det", det)
    gain = k.let("gain", Q_pose * k.let("adj", adj) / det)
    size = [k.let(f"size_{n}", sp.sqrt(W[n, :].dot(W[n, :]))) for n in range(3)]
    k.output("place", places[3], unit="length", doc="the tool Q")
    k.output("rods", sp.Matrix(length), unit="length", doc="lengths A0, A1, A-1 of the rods")
    k.output(
        "sensitivity",
        direct - gain * V,
        unit="1, or length for the parameters that are angles",
        doc="derivatives of Q, a column a parameter",
    )
    k.output(
        "regularity",
        det / (size[0] * size[1] * size[2]),
        unit="1",
        doc="determinant of the loops by its rows' lengths, -1 to 1; 0 where the machine is singular",
    )
    return k.build()


def closure_kernel():
    k = KernelBuilder(
        "tricept_closure_values",
        summary="How far a Tricept's rods are from closing at a pose, with every error, and where its tool is.",
        source="derivation tricept_uncertainty, entry eq-1 and what follows",
    )
    pose = k.input("pose", 3, unit="rad, rad, length", doc="alpha, beta, z")
    rods = k.input("rods", 3, unit="length", doc="lengths A0, A1, A-1")
    fixed = k.input("fixed", (3, 3), unit="length", doc="the fixed joints A, B, C, a row each")
    moving = k.input("moving", (3, 3), unit="length", doc="the joints A', B', C' in the platform's axes")
    tool = k.input("tool", 3, unit="length", doc="Q in the platform's axes")
    guide = k.input("guide", 14, unit="length or rad", doc="errors of the guiding rod, in the order of GUIDE")
    mount = k.let("mount", rot("x", guide[11]) * rot("y", guide[12]) * rot("z", guide[13]))
    inner = k.let("inner", rot("z", guide[6]) * turned_x(pose[0]) * rot("y", guide[10]))
    outer = k.let("outer", rot("x", guide[3]) * rot("z", guide[4]) * rot("y", pose[1]))

    def placed(name, x):
        on_rod = k.let(f"{name}_on_rod", pose[2] * e(2) + sp.Matrix(guide[7:10]) + mount * x)
        turned = k.let(f"{name}_turned", guide[5] * e(2) + inner * on_rod)
        return sp.Matrix(guide[0:3]) + outer * turned

    leg = [k.let(f"leg_{n}", placed(f"joint_{n}", moving[n, :].T) - fixed[n, :].T) for n in range(3)]
    k.output(
        "residual",
        sp.Matrix([(leg[n].dot(leg[n]) - rods[n] ** 2) / 2 for n in range(3)]),
        unit="square of length",
        doc="half of the amount by which the square of each rod is too short",
    )
    k.output("place", placed("tool", tool), unit="length", doc="the tool Q")
    return k.build()


closing = closure_kernel().jacobian(("pose",), name="tricept_closure", values=True)

# %%
derivation.kernel(sensitivity_kernel(), closing)

# %% [markdown]
# ## Figures 3 to 10
#
# The influence of one element of $U_x$ on the least or the greatest value of one element of $U_y$ along each beam, for
# the machine and the limits of Table 1. The paper's figures have no scales to compare with; the shapes are these.

# %%
if in_notebook():
    from rodgen.derivation.figures import show
    from rodgen.derivation.figures import tricept_uncertainty as figures
    from rodgen.generated.numpy import tricept

    show(figures.surfaces(figures.influences(tricept.tricept_legs, tricept.tricept_sensitivity)))
