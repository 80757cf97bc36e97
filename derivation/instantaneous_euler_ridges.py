# %% [markdown]
# # Ridge lines: where the coordinate planes meet their images
#
# A body goes from the frame $O_i$, $e_x, e_y, e_z$ to the frame $O_f$, $x_3, y_3, z_3$; $x_3,y_3,z_3$ are the columns
# of the rotation $R$, and its origin moves by $p$. Each coordinate plane of the first frame meets its image in a
# line, the *ridge line*: $Z_r$ is that of the planes $O_ixy$ and $O_fxy$, and so on. The angle between the two planes
# is the instantaneous Euler angle $\chi_z$ (notebook `instantaneous_euler`). Which line is it?
#
# **Result.** As a line given by its direction and its moment about $O_i$,
#
# $$ Z_r = (e_z\times z_3;\ (z_3, p)\,e_z), $$
#
# and $X_r$ and $Y_r$ likewise. Its direction is as long as $\sin\chi_z$, so that there is no such line where the planes
# are parallel.
#
# Zhou and Zhu look for these lines with the reciprocal product of screws, in equations (2) to (9), (11), (12), (14)
# and (15). This notebook proves or refutes each of them. Their lines (9), (12) and (15) pass through any point $Q$ of
# a coordinate plane, and are ridge lines only if $Q$ is chosen on the ridge line already, that is, if the answer is
# known. Then follow the lines from two planes, the remarks on ridge lines in the paper's tables, and the function
# that computes the lines.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import (
    PAPER,
    TABLE_41,
    TABLE_42,
    UNIT,
    of_quaternion,
    q,
    turns,
    written,
    zyx,
    zyz,
)
from rodgen.symbolic import (
    DELTA,
    EPS,
    LARGEST,
    Derivation,
    Letter,
    couple,
    cross,
    dot,
    equal,
    line_along,
    line_of_planes,
    norm,
    reciprocal_product,
    reciprocal_system,
    screw_transform,
    select,
    self_product,
    skew,
)

d = derivation = Derivation(
    "instantaneous_euler_ridges",
    title="Ridge lines: where the coordinate planes meet their images",
    source=PAPER,
)
sin, cos = sp.sin, sp.cos

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product. A line or screw is a column of six numbers: a direction and a moment about
# $O_i$, separated by a semicolon in the text. A line through the point $\vec a$ along $\vec u$ is
# $(\vec u;\vec a\times\vec u)$. $\circ$ is the reciprocal product, the scalar product of the direction of each with the
# moment of the other. The paper writes a screw as $\$$.

# %%
alpha = d.symbol("alpha", r"\alpha", "first Z-Y-X angle, about z0", "rad")
beta = d.symbol("beta", r"\beta", "second Z-Y-X angle, about y1", "rad")
gamma = d.symbol("gamma", r"\gamma", "third Z-Y-X angle, about x2", "rad")
phi = d.symbol("phi", r"\phi", "first Z-Y-Z angle, about z0", "rad")
theta = d.symbol("theta", r"\theta", "second Z-Y-Z angle, about y1", "rad")
psi = d.symbol("psi", r"\varphi", "third Z-Y-Z angle, about z2", "rad")
R = d.matrix("r", r"R", "rotation; its columns are the moved axes", "1", value=Letter("r", 3, 3).components)
p = d.vector("p", r"\vec p", "from Oi to Of", "length")
Q = d.vector("Q", r"\vec Q", "the point Q of the paper", "length")
ex, ey, ez = UNIT["x"], UNIT["y"], UNIT["z"]
x3, y3, z3 = (R.components[:, i] for i in range(3))
pc, Qc = sp.Matrix(list(p)), sp.Matrix(list(Q))
N = {
    axis: d.letter(
        rf"N_{axis}[3] | \vec N_{axis} | "
        rf"direction of the ridge {axis.upper()}r: e_{axis} × R e_{axis}, as long as sin χ_{axis} | 1",
        cross(UNIT[axis], R.components[:, i]),
    )
    for i, axis in enumerate("xyz")
}
Nx, Ny, Nz = N.values()
X3, Y3, Z3 = (
    d.letter(rf"{axis}3[3] | \vec {axis}_3 | moved axis {axis}, a column of R | 1", R.components[:, i])
    for i, axis in enumerate("xyz")
)
d


# %%
def column(*entries):
    return sp.ImmutableMatrix(entries)


def six(screw):
    return sp.ImmutableMatrix(screw)


def letter_for(name, latex, quantity, value, unit="1"):
    """A letter for a column or matrix."""
    value = sp.Matrix(value)
    return d.matrix(name, latex, quantity, unit, value=value, rows=value.rows, columns=value.cols)


def product_letter(name, latex, one, other):
    """A letter for a reciprocal product."""
    quantity = "reciprocal product of the two"
    return d.symbol(name, latex, quantity, "length", value=reciprocal_product(one, other))


# %% [markdown]
# ## Screws: equations (2) to (5)
#
# The paper seeks the ridge line as a screw $\$=(l,m,n;O,P,Q)$ that is reciprocal to three known lines
# $\$_i=(l_i,m_i,n_i;O_i,P_i,Q_i)$.

# %%
l_, m, n, O_, P, q_ = unknown = sp.symbols("l m n O P Q0", real=True)
known = [sp.symbols(f"l{i} m{i} n{i} O{i} P{i} Q0{i}", real=True) for i in (1, 2, 3)]
ridge = column(*unknown)
for letter in (*unknown, *(x for row in known for x in row)):
    d.symbol(
        letter.name,
        letter.name.replace("Q0", "Q_").rstrip("_"),
        "component of a screw, eqs. (2) and (3)",
        "1",
    )
d.state(
    "eq-3",
    *(
        equal(
            product_letter(f"product_{i}", rf"\$\circ\$_{i}", ridge, column(*row)),
            l_ * row[3] + m * row[4] + n * row[5] + row[0] * O_ + row[1] * P + row[2] * q_,
        )
        for i, row in enumerate(known, 1)
    ),
    text="The reciprocal products of the sought screw with the three of (2).",
    place="eqs. (2) and (3)",
).prove(because="The definition of the reciprocal product.")

# %% [markdown]
# What does it mean that a reciprocal product is zero? For two lines, through $\vec a$ along $\vec u$ and through
# $\vec b$ along $\vec v$, it is $-(\vec b-\vec a,\vec u\times\vec v)$. So it is zero where the lines meet or are
# parallel, and only there. The paper says the contrary.

# %%
a = d.letter(r"a[3] | \vec a | point of a line | length")
b = d.letter(r"b[3] | \vec b | point of another | length")
u = d.letter(r"u[3] | \vec u | direction of the line | 1")
v = d.letter(r"v[3] | \vec v | direction of the other | 1")
ac, bc, uc, vc = (sp.Matrix(list(letter)) for letter in (a, b, u, v))
product = d.letter(
    r"product | \$_a\circ\$_b | reciprocal product of two lines | length",
    reciprocal_product(line_along(ac, uc), line_along(bc, vc)),
)
d.state(
    "lines-that-do-not-meet",
    sp.Implies(sp.Ne(dot(b - a, cross(u, v)), 0), sp.Eq(product, 0)),
    said="if there exists a ridge line with intersection lines that do not intersect with the other three lines, the "
    "screw of the ridge line must be reciprocal to the other three-line vectors",
    place="sec. 2.2, before eq. (3)",
).refute(
    {a: (0, 0, 0), u: (1, 0, 0), b: (0, 0, 1), v: (0, 1, 0)},
    equal(product, -dot(b - a, cross(u, v))),
    label="Z21",
    because="Two lines are reciprocal where they lie in one plane: where they do intersect, or are parallel.",
)

# %% [markdown]
# The screws that are reciprocal to three lines form a space of six dimensions less the rank of the lines. The paper
# takes for granted that the lines are independent. Three lines through one point in one plane are not.

# %%
rank = d.symbol("rank", r"\operatorname{rank}", "rank of three given lines", "1")
generic = reciprocal_system([column(*row) for row in known])
assert (generic.rank, len(generic.basis)) == (3, 3)
rank_of_three = d.letter(
    r"rank_of_three | \operatorname{rank}_3 | rank of three lines in general | 1", sp.Integer(generic.rank)
)
flat = reciprocal_system(
    [line_along(sp.zeros(3, 1), ex), line_along(sp.zeros(3, 1), ey), line_along(sp.zeros(3, 1), ex + ey)]
)
d.state(
    "three-solutions",
    equal(6 - rank, 3),
    said="three of the basic solution systems are linearly independent of the vectors",
    text="The screws reciprocal to three given lines have three dimensions.",
    place="sec. 2.2, after eq. (3)",
).refute(
    {rank: flat.rank},
    equal(6 - rank_of_three, 3),
    label="Z22",
    because="So it is for three independent lines. The lines along x, along y and halfway between them, through one "
    "point, have rank 2.",
)

# %% [markdown]
# Equations (4) and (5) bring the axes of the moved frame into the fixed one. $\hat p$ is the matrix of the cross
# product with $\vec p$.

# %%
T = screw_transform(R.components, pc)
axes = [column(*UNIT[axis], 0, 0, 0) for axis in "xyz"]
own_axes = [
    letter_for(
        f"own_{axis}",
        rf"\$_{axis}",
        f"line along the axis {axis}, in its own frame",
        line_along(sp.zeros(3, 1), UNIT[axis]),
    )
    for axis in "xyz"
]
d.state(
    "eq-4",
    *(equal(line, axes[i]) for i, line in enumerate(own_axes)),
    text="The axes of the moved frame, in that frame.",
    place="eq. (4)",
).prove(because="A line through the origin has no moment.")

# %%
block = sp.BlockMatrix([[R.components, sp.zeros(3)], [skew(pc) * R.components, R.components]])
transform, in_blocks = (
    letter_for("T", "T", "transform of lines from the moved frame into the fixed one", T),
    letter_for(
        "T_blocks",
        r"\begin{bmatrix}R&0\\\hat p R&R\end{bmatrix}",
        "the matrix in blocks",
        block.as_explicit(),
    ),
)
moved_axes = [
    letter_for(
        f"moved_{axis}",
        rf"(\vec {axis}_3;\,\vec p\times\vec {axis}_3)",
        f"line along the moved axis {axis}, in the fixed frame",
        line_along(pc, R.components[:, i]),
    )
    for i, axis in enumerate("xyz")
]
d.state(
    "eq-5",
    equal(transform, in_blocks),
    *(equal(moved, in_blocks * own) for moved, own in zip(moved_axes, own_axes, strict=True)),
    text="The transform in blocks brings the axes of the moved frame, as lines, into the fixed one.",
    place="eq. (5), and the matrix in blocks under it",
).prove(
    because="A direction is turned by R; the moment about O_i is that about O_f, turned, and p × the direction."
)

# %%
quaternion_T = screw_transform(of_quaternion, pc)
kept = letter_for(
    "kept",
    r"T^T\Delta\,T",
    "with the matrix Δ of the reciprocal product",
    quaternion_T.T * DELTA * quaternion_T,
)
swap = letter_for(
    "Delta", r"\Delta", "matrix of the reciprocal product; it swaps direction and moment", DELTA
)
d.check(
    "reciprocal-product-stays",
    equal(kept, swap),
    text="The transform leaves every reciprocal product as it is.",
).prove(because="R is written by a quaternion of any length; RᵀR = I, and p̂ is antisymmetric.")

# %% [markdown]
# The paper then writes the matrix out. There, the lower right block holds $\hat p$ where the blocks have $R$. The
# axes are not affected, because they have no moment in their own frame. But a screw with a moment would be wrong, and
# the printed matrix has no inverse.

# %%
explicit_T = sp.Matrix(
    sp.BlockMatrix([[R.components, sp.zeros(3)], [skew(pc) * R.components, skew(pc)]]).as_explicit()
)
by_zyx, by_zyz = {R: zyx}, {R: zyz}
d.state(
    "eq-5-written-out",
    equal(
        transform,
        letter_for(
            "T_printed", r"\begin{bmatrix}R&0\\\hat p R&\hat p\end{bmatrix}", "as printed", explicit_T
        ),
    ),
    place="under eq. (5), the matrix written out",
    text="The same matrix, written out.",
).refute(
    {alpha: 0, beta: 0, gamma: 0, p: (0, 0, 0)},
    equal(transform, in_blocks),
    given=by_zyx,
    label="Z23",
    because="The lower right block is R, as the matrix in blocks has it, and not the cross product with p. The "
    "printed one is singular.",
)

# %%
singular = d.symbol("det_p", r"\det\hat p", "determinant of that block", "length³", value=sp.det(skew(pc)))
d.check(
    "printed-transform-is-singular",
    equal(singular, 0),
    text="The printed matrix has the determinant det R · det p̂ = 0.",
).prove(because="An antisymmetric matrix of three rows has the determinant zero.")

# %%
d.state(
    "eq-7",
    *(
        equal(
            moved,
            column(
                *c,
                -p.components[2] * c[1] + p.components[1] * c[2],
                p.components[2] * c[0] - p.components[0] * c[2],
                -p.components[1] * c[0] + p.components[0] * c[1],
            ),
        )
        for moved, c in zip(moved_axes, (x3, y3, z3), strict=True)
    ),
    text="The axes of the moved frame as lines of the fixed one.",
    place="eq. (7)",
).prove(because="p × the direction, written out.")

# %% [markdown]
# ## What equations (8) and (9) determine
#
# For $Z_r$ the paper takes $p = 0$ and three lines: the axis $y_3$, the axis $y_0$, and a line $\$_3$ parallel to $z_0$
# through a point $Q$ of the fixed plane. It looks for the screw that is reciprocal to the three, and gives the line (9)
# through $O$ and $Q$. That line is reciprocal to the three. But it is the ridge line only if $Q$ is on the ridge line.

# %%
qx, qy, qz = Q
w_y3, w_y0, w_Qz = column(*y3, 0, 0, 0), column(0, 1, 0, 0, 0, 0), column(0, 0, 1, qy, -qx, 0)
line_y3, line_y0, line_Q = (
    letter_for(
        "line_y3",
        r"\$_{y_3}",
        "line along the axis y3, by the Z-Y-X angles",
        line_along(sp.zeros(3, 1), zyx[:, 1]),
    ),
    letter_for("line_y0", r"\$_{y_0}", "line along the axis y0", line_along(sp.zeros(3, 1), ey)),
    letter_for(
        "line_Q",
        r"\$_3",
        "line through Q = (Qx, Qy, 0) parallel to z0",
        line_along(column(qx, qy, 0), ez),
        "1, length",
    ),
)
d.state(
    "eq-8",
    equal(line_y3, column(*zyx[:, 1], 0, 0, 0)),
    equal(line_y0, w_y0),
    equal(line_Q, w_Qz),
    text="The axis y3 by its Z-Y-X angles, the axis y0, and the line through Q parallel to z0.",
    place="eq. (8)",
).prove(because="A line through O has no moment; that of the third line is Q × z0.")

# %%
line_9 = column(qx, qy, 0, 0, 0, 0)


def with_three(number, line, names, three):
    """The reciprocal products of a printed line with three others, each zero."""
    return [
        equal(
            product_letter(f"product_{number}_{k}", rf"\$_{{({number})}}\circ\$_{{{name}}}", line, other), 0
        )
        for k, (name, other) in enumerate(zip(names, three, strict=True), 1)
    ]


d.state(
    "eq-9-reciprocal",
    *with_three(9, line_9, ("y_3", "y_0", "3"), (w_y3, w_y0, w_Qz)),
    said="According to the principle of reciprocal products",
    text="The line (9), from O to Q, is reciprocal to the three lines of (8), whatever Q is.",
    place="eq. (9)",
).prove(because="It meets all three: the first two in O, the third in Q.")

# %%
ridge_z = column(*cross(ez, z3), 0, 0, 0)
d.state(
    "eq-9",
    equal(
        dot(Z3, letter_for("toward_Q", r"\vec d_{(9)}", "direction of the line (9)", line_9[:3], "length")), 0
    ),
    said="where the point Q is an arbitrary point on the moving platform",
    text="The line (9) lies in the plane Ofxy, too, so that it is the ridge line.",
    place="eq. (9)",
).refute(
    {alpha: 0, beta: sp.pi / 3, gamma: sp.pi / 4, Q: (1, 0, 0)},
    equal(Nz, column(-R.components[1, 2], R.components[0, 2], 0)),
    given=by_zyx,
    label="Z24",
    because="Every line in the plane Oixy through O is reciprocal to the three. It lies in Ofxy only where Q does: Q "
    "must be on the ridge line, along Nz = z0 × z3, which is what is sought.",
)

# %% [markdown]
# What else is reciprocal to the three lines of (8)? All screws $\$_c=c_1\$_1'+c_2\$_2'+c_3\$_3'$ with a basis
# $\$_1',\$_2',\$_3'$ and any coefficients. A screw is a line if its reciprocal product with itself is zero. Here that
# is a product of two linear forms of the coefficients, so that the lines are two families: the lines through $O$ in
# the plane of $O$ and $\$_3$, to which (9) belongs for every $Q$, and the lines in the plane of $y_0$ and $y_3$
# through the point where $\$_3$ meets it.

# %%
system = reciprocal_system([w_y3, w_y0, w_Qz])
assert system.rank == 3
assert system.contains(line_9)
assert not system.contains(column(1, 0, 0, 0, 0, 0))
coefficients = sp.symbols("c_1:4", real=True)
for letter in coefficients:
    d.symbol(letter.name, letter.name, "coefficient in the reciprocal system of (8)", "1")
member = system.member(coefficients)
condition = system.line_condition(coefficients)
c1, c2, c3 = coefficients
one, two = (f for f, _ in sp.factor_list(sp.numer(condition))[1] if f.free_symbols & set(coefficients))
if one != c3:
    one, two = two, one
pencil, field = member.subs(c3, 0), member.subs(c2, sp.solve(two, c2)[0])
foot = column(qx, qy, qx * R.components[2, 1] / R.components[0, 1])
own_product = d.letter(
    r"own_product | \$_c\circ\$_c | reciprocal product of a member with itself | length", self_product(member)
)
d.check(
    "eq-8-lines",
    *with_three("c", member, ("y_3", "y_0", "3"), (w_y3, w_y0, w_Qz)),
    equal(own_product, condition),
    text="Its members are reciprocal to the three, and are lines where one of two linear forms vanishes.",
    assumptions=[sp.Ne(R.components[0, 1], 0), sp.Ne(qy, 0)],
).prove(because="The members of the reciprocal system, computed from the three lines.")

# %%
d.state(
    "solutions-are-lines",
    equal(own_product, 0),
    text="What solves (3), here for the lines of (8), is a line.",
    place="sec. 2.2, eq. (3)",
    tacit=True,
).refute(
    {alpha: 0, beta: sp.pi / 3, gamma: sp.pi / 4, Q: (1, 1, 0), c1: 0, c2: 0, c3: 1},
    equal(own_product, condition),
    given=by_zyx,
    label="Z47",
    because="It is a screw, in general with a pitch; to be a line its direction and moment must be perpendicular, too.",
)

# %%
first_moment, first_direction = (
    letter_for("first_moment", r"\vec m_1", "moment of a line of the first family", pencil[3:], "length"),
    letter_for("first_direction", r"\vec d_1", "direction of a line of the first family", pencil[:3]),
)
plane_of_Q = letter_for(
    "plane_of_Q",
    r"\vec Q\times\vec e_z",
    "normal of the plane of O and the third line",
    cross(column(qx, qy, 0), ez),
    "length",
)
d.check(
    "eq-8-first-family",
    equal(one, c3),
    equal(first_moment, sp.ZeroMatrix(3, 1)),
    equal(dot(first_direction, plane_of_Q), 0),
    text="The first family, c₃ = 0: no moment, so the lines go through O; and they are in the plane of O and the "
    "third line.",
).prove(because="The basis of the reciprocal system, with c₃ = 0.")

# %%
plane = cross(ey, y3)
second_moment, second_direction, normal, meeting = (
    letter_for("second_moment", r"\vec m_2", "moment of a line of the second family", field[3:], "length"),
    letter_for("second_direction", r"\vec d_2", "direction of a line of the second family", field[:3]),
    letter_for("normal", r"\vec e_y\times\vec y_3", "normal of the plane of y0 and y3", plane),
    letter_for("foot", r"\vec F", "point where the third line meets that plane", foot, "length"),
)
d.check(
    "eq-8-second-family",
    equal(dot(second_direction, normal), 0),
    equal(cross(second_moment, normal), sp.ZeroMatrix(3, 1)),
    equal(cross(meeting, second_direction), second_moment),
    equal(dot(meeting, normal), 0),
    text="The second family: in the plane of y0 and y3, through its point F on the third line.",
    assumptions=[sp.Ne(R.components[0, 1], 0), sp.Ne(qy, 0)],
).prove(because="The basis of the reciprocal system, with c₂ from the second linear form.")

# %% [markdown]
# The paper repeats this for the other two ridge lines: (11) and (12) for $Y_r$, (14) and (15) for $X_r$. Several
# lines are misprinted, and the lines (12) and (15) depend on $Q$ as (9) does.

# %%
w_x3, w_x0, w_Qy = column(*x3, 0, 0, 0), column(1, 0, 0, 0, 0, 0), column(0, 1, 0, -qz, 0, qx)
printed_x3 = column(*zyx[:, 1], 0, 0, 0)
line_x3, line_x0, line_Qy, line_Qx = (
    letter_for(name, latex, quantity, line, unit)
    for name, latex, quantity, line, unit in (
        ("line_x3", r"\$_{x_3}", "line along the axis x3", column(*x3, 0, 0, 0), "1"),
        ("line_x0", r"\$_{x_0}", "line along the axis x0", line_along(sp.zeros(3, 1), ex), "1"),
        (
            "line_Qy",
            r"\$_{Q,y}",
            "line through Q = (Qx, 0, Qz) parallel to y0",
            line_along(column(qx, 0, qz), ey),
            "1, length",
        ),
        (
            "line_Qx",
            r"\$_{Q,x}",
            "line through Q = (0, Qy, Qz) parallel to x0",
            line_along(column(0, qy, qz), ex),
            "1, length",
        ),
    )
)
d.state("eq-11-x3", equal(line_x3, printed_x3), text="The axis x3.", place="eq. (11), first line").refute(
    {alpha: 0, beta: 0, gamma: 0},
    equal(line_x3, column(cos(alpha) * cos(beta), sin(alpha) * cos(beta), -sin(beta), 0, 0, 0)),
    given=by_zyx,
    label="Z25",
    because="It is a copy of the axis y3 of (8).",
)

# %%
d.state(
    "eq-11-x0", equal(line_x0, column(0, 1, 0, 0, 0, 0)), text="The axis x0.", place="eq. (11), second line"
).refute({}, equal(line_x0, w_x0), label="Z26", because="It is the axis y0.")

# %%
d.state(
    "eq-11-Qy",
    equal(line_Qy, column(0, 0, 1, qy, -qx, 0)),
    text="The line through Q = (Qx, 0, Qz) parallel to y0.",
    place="eq. (11), third line",
).refute(
    {Q: (1, 0, 1)},
    equal(line_Qy, w_Qy),
    label="Z27",
    because="It is the third line of (8), parallel to z0.",
)

# %%
line_12 = column(qx, 0, qz, 0, 0, 0)
d.state(
    "eq-12-reciprocal",
    *with_three(12, line_12, ("x_3", "x_0", "Q"), (w_x3, w_x0, w_Qy)),
    text="The line (12) is reciprocal to the lines of (11), put right.",
    place="eq. (12)",
).prove(because="It meets the first two in O, the third in Q.")

# %%
d.state(
    "eq-12",
    equal(
        dot(
            Y3, letter_for("along_12", r"\vec d_{(12)}", "direction of the line (12)", line_12[:3], "length")
        ),
        0,
    ),
    text="The line (12) lies in the plane Ofxz, for every Q of Oixz.",
    place="eq. (12)",
).refute(
    {alpha: sp.pi / 3, beta: 0, gamma: 0, Q: (1, 0, 0)},
    equal(Ny, column(R.components[2, 1], 0, -R.components[0, 1])),
    given=by_zyx,
    label="Z28",
    because="As with (9): Q must be on the ridge line, along y0 × y3.",
)

# %%
w_z3, w_z0, w_Qx = column(*z3, 0, 0, 0), column(0, 0, 1, 0, 0, 0), column(1, 0, 0, 0, qz, -qy)
d.state(
    "eq-14-axes",
    equal(
        letter_for("line_z3", r"\$_{z_3}", "line along the axis z3", line_along(sp.zeros(3, 1), zyx[:, 2])),
        column(*zyx[:, 2], 0, 0, 0),
    ),
    equal(letter_for("line_z0", r"\$_{z_0}", "line along the axis z0", line_along(sp.zeros(3, 1), ez)), w_z0),
    place="eq. (14), first two lines",
    text="The axes z3, by the Z-Y-X angles, and z0.",
).prove(because="A line through O has no moment.")

# %%
d.state(
    "eq-14-Qx",
    equal(line_Qx, column(1, 0, 0, 0, qz, qy)),
    text="The line through Q = (0, Qy, Qz) parallel to x0, as far as its signs can be read.",
    place="eq. (14), third line",
).refute(
    {Q: (0, 1, 1)},
    equal(line_Qx, w_Qx),
    label="Z29",
    because="The last component is −Qy; its sign is wrong, or lost in the copy. With +Qy the line (15) would not "
    "even be reciprocal to it.",
)

# %%
line_15 = column(0, qy, qz, 0, 0, 0)
d.state(
    "eq-15-reciprocal",
    *with_three(15, line_15, ("z_3", "z_0", "Q"), (w_z3, w_z0, w_Qx)),
    text="The line (15) is reciprocal to the lines of (14), put right.",
    place="eq. (15)",
).prove(because="It meets the first two in O, the third in Q.")

# %%
d.state(
    "eq-15",
    equal(
        dot(
            X3, letter_for("along_15", r"\vec d_{(15)}", "direction of the line (15)", line_15[:3], "length")
        ),
        0,
    ),
    text="The line (15) lies in the plane Ofyz, for every Q of Oiyz.",
    place="eq. (15)",
).refute(
    {alpha: sp.pi / 3, beta: 0, gamma: 0, Q: (0, 1, 0)},
    equal(Nx, column(0, -R.components[2, 0], R.components[1, 0])),
    given=by_zyx,
    label="Z30",
    because="As with (9): Q must be on the ridge line, along x0 × x3.",
)

# %% [markdown]
# ## The ridge lines
#
# No screws are needed. The points $x$ of a coordinate plane satisfy $(e_i, x) = 0$, those of its image $(Re_i, x -
# p) = 0$. Two such planes meet in a line along the cross product of their normals, $e_i\times Re_i$, with the moment
# $(Re_i, p)\,e_i$. Its direction is as long as $\sin\chi_i$: at $\chi_i = 0$ or $\pi$ the planes are parallel, and
# where also $(Re_i, p) = 0$ they coincide.

# %%
planes = {
    axis: line_of_planes(UNIT[axis], 0, R.components[:, i], dot(R.components[:, i], pc))
    for i, axis in enumerate("xyz")
}
r = R.components
ridge_lines = {
    axis: letter_for(
        f"ridge_{axis}",
        f"{axis.upper()}_r",
        f"line of the plane across {axis} and its image",
        planes[axis],
        "1, length",
    )
    for axis in "xyz"
}
d.check(
    "ridge-lines",
    equal(ridge_lines["x"], column(0, -r[2, 0], r[1, 0], dot(X3, p), 0, 0)),
    equal(ridge_lines["y"], column(r[2, 1], 0, -r[0, 1], 0, dot(Y3, p), 0)),
    equal(ridge_lines["z"], column(-r[1, 2], r[0, 2], 0, 0, 0, dot(Z3, p))),
    *(
        equal(
            d.letter(
                rf"own_{axis}{axis} | {axis.upper()}_r\circ {axis.upper()}_r | "
                rf"reciprocal product of the ridge line with itself | length",
                self_product(planes[axis]),
            ),
            0,
        )
        for axis in "xyz"
    ),
    text="The ridge lines as the lines of two planes. They are lines: direction and moment are perpendicular.",
).prove(because="The line of two planes (n, x) = a and (m, x) = b is (n × m; b n − a m).")

# %%
of_q = {R: of_quaternion}
square = sum(x**2 for x in q)
diagonal = [
    d.symbol(f"r_{axis}{axis}", f"R_{{{axis * 2}}}", f"diagonal element, cos χ_{axis}", "1", value=r[i, i])
    for i, axis in enumerate("xyz")
]
d.check(
    "ridge-length",
    *(equal(norm(N[axis]) ** 2 + c**2, 1) for axis, c in zip("xyz", diagonal, strict=True)),
    text="The direction is as long as the sine of the angle.",
    assumptions=["R is a rotation"],
).prove(given=of_q, because="N is the cross product of two unit vectors whose scalar product is cos χ.")

# %% [markdown]
# The angles do not determine the lines: a rotation and its inverse have the same three angles and other ridge lines.

# %%
N_back = d.vector(
    "N_back", r"\vec N_z^{-1}", "direction of Zr for the inverse rotation", "1", value=cross(ez, r.T[:, 2])
)
d.state(
    "lines-from-angles",
    equal(cross(Nz, N_back), sp.zeros(3, 1)),
    said="The corresponding intersection line can be derived using Equations (10), (13) and (16)",
    text="A rotation and its inverse, whose angles are the same, have parallel ridge lines.",
    place="sec. 4.2, the last paragraph",
).refute(
    {alpha: 0, beta: sp.pi / 3, gamma: sp.pi / 4},
    equal(Nz, column(-r[1, 2], r[0, 2], 0)),
    given=by_zyx,
    label="Z20",
    because="Those equations depend on the diagonal of the matrix alone; the lines need the columns.",
)

# %% [markdown]
# With screws the ridge line can be found as well, for any $p$: it is what is reciprocal to two axes of each plane and
# to the two couples about their normals. These six have rank 5, so that one screw is reciprocal to all of them; where
# the planes coincide the rank is 3.

# %%
sample = {alpha: sp.pi / 6, beta: sp.pi / 4, gamma: sp.pi / 3}
exact = sp.Matrix(zyx.subs(sample))
at = sp.Matrix([1, 2, 3])
both_planes = [
    line_along(sp.zeros(3, 1), ex),
    line_along(sp.zeros(3, 1), ey),
    line_along(at, exact[:, 0]),
    line_along(at, exact[:, 1]),
    couple(ez),
    couple(exact[:, 2]),
]
whole = reciprocal_system(both_planes)
assert whole.rank == 5
assert whole.contains(line_of_planes(ez, 0, exact[:, 2], dot(exact[:, 2], at)))
turned = turns("zyx", (sp.pi / 6, 0, 0))
same_plane = [
    line_along(sp.zeros(3, 1), ex),
    line_along(sp.zeros(3, 1), ey),
    *(line_along(column(1, 2, 0), turned[:, i]) for i in (0, 1)),
    couple(ez),
    couple(turned[:, 2]),
]
assert reciprocal_system(same_plane).rank == 3
d.check(
    "ridge-by-screws",
    *(
        equal(product_letter(f"screw_{k}", rf"Z_r\circ {name}", planes["z"], screw), 0)
        for k, (name, screw) in enumerate(
            (
                (r"\$_{x_0}", line_along(sp.zeros(3, 1), ex)),
                (r"\$_{y_0}", line_along(sp.zeros(3, 1), ey)),
                (r"\$_{x_3}", line_along(pc, x3)),
                (r"\$_{y_3}", line_along(pc, y3)),
                (r"(\vec 0;\vec e_z)", couple(ez)),
                (r"(\vec 0;\vec z_3)", couple(z3)),
            )
        )
    ),
    text="The ridge Zr is reciprocal to the axes of both planes and to the couples about their normals.",
).prove(
    given=of_q,
    because="It meets the lines of both planes or is parallel to them, and its direction is perpendicular to both "
    "normals.",
)

# %% [markdown]
# The introduction of the paper says that the third rotation of a sequence does not move the ridge line. That is true
# for Z-Y-Z, whose last rotation is about z, and not for Z-Y-X.

# %%
d.state(
    "third-rotation-zyx",
    equal(cross(cross(ez, turns("zyx", (alpha, beta, 0))[:, 2]), Nz), sp.zeros(3, 1)),
    said="the conventional ridge line of a single rigid body appears at the completion of the second rotation, and "
    "the third rotation does not affect the position of the ridge lines",
    text="For Z-Y-X, of the xy planes.",
    place="sec. 2.1",
).refute(
    {alpha: 0, beta: sp.pi / 3, gamma: sp.pi / 4},
    equal(
        Nz,
        column(
            -sin(alpha) * sin(beta) * cos(gamma) + cos(alpha) * sin(gamma),
            cos(alpha) * sin(beta) * cos(gamma) + sin(alpha) * sin(gamma),
            0,
        ),
    ),
    given=by_zyx,
    label="Z31",
    because="The last rotation of Z-Y-X is about x2, and turns z with it. For Z-Y-Z it is true.",
)

# %%
d.state(
    "third-rotation-zyz",
    equal(Nz, sin(theta) * column(-sin(phi), cos(phi), 0)),
    said="the conventional ridge line of a single rigid body appears at the completion of the second rotation, and "
    "the third rotation does not affect the position of the ridge lines",
    text="For Z-Y-Z, of the xy planes: sin θ times y1, the line of nodes.",
    place="sec. 2.1",
).prove(
    given=by_zyz,
    because="z3 does not depend on the third angle.",
)

# %% [markdown]
# ## The remarks on ridge lines in the tables
#
# Each row of the tables of sections 4.1 and 4.2 names the existing ridge lines, and says with which axis one of
# them coincides. A ridge line exists where its direction $\vec N_i$ is not zero. For each remark the three directions
# are computed.


# %%
def there(*names):
    return [sp.Ne(norm(N[axis]) ** 2, 0) for axis in names]


def parallel(axis, to):
    return equal(cross(N[axis], to), sp.zeros(3, 1))


def off(axis, to):
    return sp.Ne(norm(cross(N[axis], to)) ** 2, 0)


def directions(angles, sequence):
    """The three directions, row by row, as they are for these angles."""
    M = turns(sequence, angles)
    return [equal(N[axis], sp.ImmutableMatrix(cross(UNIT[axis], M[:, i]))) for i, axis in enumerate("xyz")]


third = sp.pi / 3
half = sp.pi / 2
none, both, all_three = sp.zeros(3, 1), "Zr and Xr", "Zr, Yr and Xr"
REMARKS = [
    # row, sequence, said, claims, counterexample, label, why
    (
        "alpha",
        "zyx",
        "the ridge axes are expressed as Zr and Yr, the axis Zr coincides with the z0 axis",
        [*there("z", "y")],
        {alpha: half},
        "Z32",
        "The xy planes coincide, so that Zr is not determined; Xr and Yr exist, and both are z0.",
    ),
    (
        "beta",
        "zyx",
        "the ridge axes are denoted as Zr and Xr, each axis is not coincident with the y0 axis",
        [*there("z", "x"), off("z", ey), off("x", ey)],
        {beta: half},
        "Z33",
        "Both are y0, about which the body turns.",
    ),
    (
        "gamma",
        "zyx",
        "the ridge axes are denoted as Yr and Xr, the axis Xr coincides with the x0 axis",
        [*there("y", "x")],
        {gamma: half},
        "Z34",
        "The yz planes coincide, so that Xr is not determined; Yr and Zr exist, and both are x0.",
    ),
    (
        "beta-gamma",
        "zyx",
        "the ridge axes are denoted as Zr and Yr",
        [sp.Eq(norm(Nx) ** 2, 0)],
        {beta: third, gamma: third},
        "Z35",
        "All three exist; Xr is y0.",
    ),
    ("alpha-beta", "zyx", "the ridge axes are denoted as Zr, Yr, and Xr", there("x", "y", "z"), None, "", ""),
    (
        "alpha-gamma",
        "zyx",
        "the ridge axes are denoted as Xr and Yr",
        [sp.Eq(norm(Nz) ** 2, 0)],
        {alpha: third, gamma: third},
        "Z36",
        "All three are there.",
    ),
    (
        "phi",
        "zyz",
        "the ridge axis is expressed as Zr, the axis coincides with the z1 axis",
        [*there("z")],
        {phi: half},
        "Z37",
        "Zr is the one that does not exist; Xr and Yr do, and both are z0, which is z1.",
    ),
    (
        "theta",
        "zyz",
        "the ridge axes are represented as Zr and Xr, the axis Zr coincides with the y2 axis",
        [*there("z", "x"), parallel("z", ey)],
        None,
        "",
        "",
    ),
    (
        "psi",
        "zyz",
        "the ridge axes are represented as Yr and Xr, the axis Xr coincides with the z3 axis",
        [*there("y", "x"), parallel("x", ez)],
        None,
        "",
        "",
    ),
    (
        "theta-psi",
        "zyz",
        "the ridge axes are denoted as Zz, Yr, and Xr, the ridge axis Xr coincides with the original z3 axis",
        [parallel("x", z3)],
        {theta: third, psi: third},
        "Z38",
        "It is Yr that is z3, the axis of the last rotation; Zr is y0. (Zz is a slip for Zr.)",
    ),
    (
        "phi-theta",
        "zyz",
        "the ridge axes are denoted as Zr, Yr, and Xr, the ridge axis Xr coincides with the original y3 axis",
        [parallel("x", y3)],
        {phi: third, theta: third},
        "Z39",
        "It is Zr that is y3, the axis of the last rotation; Yr is z0.",
    ),
    (
        "phi-psi",
        "zyz",
        "the ridge axes are represented as Xr, Yr, and Zr, each axis is not coincident with the original axis",
        [*there("z"), off("x", ez), off("y", ez)],
        {phi: half, psi: 0},
        "Z40",
        "Both rotations are about z0: Xr and Yr are z0, and Zr is not determined.",
    ),
]
TABLES = {
    **{name: row[0] for name, row in TABLE_41.items()},
    **{name: row[0] for name, row in TABLE_42.items()},
}
for name, sequence, words, what, point, label, why in REMARKS:
    angles = TABLES[name]
    section = "4.1" if sequence == "zyx" else "4.2"
    entry = d.state(
        f"ridges-{section}-{name}",
        *what,
        said=words,
        text=f"{'-'.join(sequence.upper())} angles {written(angles)}.",
        place=f"sec. {section}",
    )
    true, at_row = directions(angles, sequence), {R: turns(sequence, angles)}
    if point is None:
        entry.prove(
            *true,
            given=at_row,
            because="With the directions of the ridge lines computed, each line exists wherever the sines in its "
            "direction do not vanish.",
        )
    else:
        entry.refute(point, true, given=at_row, label=label, because=why)
d.page(*(id for id in d.entries if id.startswith("ridges-")))

# %% [markdown]
# For three rotations the paper says that all three ridges exist, and for Z-Y-Z that none coincides with an
# original axis, except in "peculiar circumstances". For Z-Y-Z there is more to say: $Z_r$ is $y_1$ always.

# %%
node = column(-sin(phi), cos(phi), 0)
d.check(
    "line-of-nodes",
    parallel("z", node),
    text="For Z-Y-Z the ridge Zr is the axis y1 of the second rotation, (−sin ϕ, cos ϕ, 0).",
).prove(
    given=by_zyz,
    because="The entry third-rotation-zyz: N_z is sin θ times that vector.",
)


# %% [markdown]
# ## The function
#
# It gives each line as a unit direction and its moment. Where two planes are parallel there is none, and the status
# says whether they coincide. The direction is such that the rotation by $\chi_i$ about it, right-handed, brings the
# one plane to the other.


# %%
class RidgeStatus(IntEnum):
    """Kind of a ridge line.

    LINE: the two planes meet in it.
    PLANES_COINCIDE: the angle is 0 or pi, and the moved origin is in the plane: every line of it; the result is NaN.
    PLANES_PARALLEL: the angle is 0 or pi, and the planes have a distance: no line; the result is NaN.
    NOT_NORMAL: the matrix is not orthogonal; its line, and NaN where it has none.
    INVALID: not finite, or a reflection; the result is NaN.
    """

    LINE = 0
    PLANES_COINCIDE = 1
    PLANES_PARALLEL = 2
    NOT_NORMAL = 3
    INVALID = 4


def chi_ridge_lines():
    k = KernelBuilder(
        "chi_ridge_lines",
        summary="Lines in which the coordinate planes meet their images.",
        source="Zhou and Zhu, eqs. (9), (12), (15) put right",
        notes="The rows of `lines` are Xr, Yr, Zr: a unit direction and its moment about the fixed origin.",
    )
    matrix = k.input("matrix", (3, 3), unit="1", doc="rotation; its columns are the moved axes")
    point = k.input("point", 3, unit="length", doc="the moved origin")
    gram = matrix.T * matrix - sp.eye(3)
    deviation = k.let("deviation", sum((abs(x) for x in gram), sp.S.Zero))
    determinant = k.let("determinant", matrix[:, 0].dot(matrix[:, 1].cross(matrix[:, 2])))
    size = k.let("size", sum((abs(x) for x in point), sp.S.Zero))
    good = k.let("good", (determinant > 0) & (deviation <= LARGEST) & (size <= LARGEST))
    abnormal = k.let("abnormal", sp.Not(deviation <= 64 * EPS))
    rows, statuses = [], []
    for i, axis in enumerate("xyz"):
        moved = matrix[:, i]
        direction = UNIT[axis].cross(moved)
        sine = k.let(f"sine_{axis}", sp.sqrt(direction.dot(direction)))
        height = k.let(f"height_{axis}", moved.dot(point))
        flat = k.let(f"flat_{axis}", sp.Le(sine, 4 * EPS))
        length = k.let(f"length_{axis}", select(flat, sp.nan, sine))
        line = sp.Matrix([*(direction / length), *(UNIT[axis] * height / length)])
        zero = [*(UNIT[axis] * 1), *(1 - x for x in UNIT[axis])]  # what is zero in a line that exists
        entries = [
            select(flat | sp.Not(good), sp.nan, 0 if z else x) for x, z in zip(line, zero, strict=True)
        ]
        rows.append(sp.Matrix([entries]))
        statuses.append(
            sp.Piecewise(
                (RidgeStatus.INVALID, sp.Not(good)),
                (RidgeStatus.NOT_NORMAL, abnormal),
                (RidgeStatus.PLANES_COINCIDE, flat & sp.Le(abs(height), 4 * EPS * size)),
                (RidgeStatus.PLANES_PARALLEL, flat),
                (RidgeStatus.LINE, True),
                evaluate=False,
            )
        )
    k.output("lines", sp.Matrix.vstack(*rows), unit="1, length", doc="the ridge lines, one a row")
    for axis, status in zip("xyz", statuses, strict=True):
        k.status(f"status_{axis}", status, RidgeStatus, doc=f"what the ridge line {axis.upper()}r is")
    return k.build()


lines_kernel = chi_ridge_lines()

# %%
derivation.kernel(lines_kernel)
