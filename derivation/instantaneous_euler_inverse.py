# %% [markdown]
# # Which rotations have given instantaneous Euler angles?
#
# The instantaneous Euler angle $\chi_i$ is the angle between the axis $e_i$ and its image $Re_i$ under a rotation $R$
# (notebook `instantaneous_euler`). Which rotations have three given angles $\chi_x,\chi_y,\chi_z$? Is there one for
# every triple, and is there only one?
#
# **Result.** In the components of the unit quaternion $(q_0, q_x, q_y, q_z)$ of the rotation the three cosines are
#
# $$ (\cos\chi_x, \cos\chi_y, \cos\chi_z) = q_0^2\,(1,1,1) + q_x^2\,(1,-1,-1) + q_y^2\,(-1,1,-1) + q_z^2\,(-1,-1,1). $$
#
# The four squares add up to 1. So the point of the cosines lies in a tetrahedron with these four corners, and the
# squares are its barycentric coordinates there (Horn). It follows that
#
# - a triple outside of the tetrahedron belongs to no rotation: the angles are not "independent of each other", as Zhou
#   and Zhu say;
# - a triple inside belongs to eight rotations, one for each choice of signs, and to fewer on the faces;
# - one ridge line with a sense chooses among the eight, and so do two without.

# %%
from enum import IntEnum
from itertools import combinations
from itertools import product as every

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import (
    PAPER,
    UNIT,
    of_quaternion,
    product,
    q,
    right_zyz,
    zyx,
)
from rodgen.derivation.rotations import matrix_from_quaternion
from rodgen.symbolic import EPS, Derivation, cross, dot, equal, factored, in_notebook, select

d = derivation = Derivation(
    "instantaneous_euler_inverse",
    title="Which rotations have given instantaneous Euler angles?",
    source=PAPER,
)
sin, cos = sp.sin, sp.cos

# %% [markdown]
# ## Symbols
#
# $e_x,e_y,e_z$ are the unit vectors of the axes, and $N_i=e_i\times Re_i$ the direction of a ridge line, in which a
# coordinate plane meets its image.

# %%
q0, qx, qy, qz = (
    d.symbol(s.name, rf"q_{s.name[1]}", "component of the unit quaternion, scalar first", "1") for s in q
)
half = {
    axis: d.symbol(f"half_{axis}", rf"\tfrac{{\chi_{axis}}}2", f"half of the angle {axis}", "rad")
    for axis in "xyz"
}
chi_x, chi_y, chi_z = CHI = tuple(
    d.symbol(f"chi_{axis}", rf"\chi_{axis}", f"instantaneous Euler angle {axis}", "rad", value=2 * half[axis])
    for axis in "xyz"
)
UNIT_LENGTH = {q0: q0**2 + qx**2 + qy**2 + qz**2 - 1}
M = of_quaternion
C = cx, cy, cz = tuple(cos(angle) for angle in CHI)
FORMS = (1 + cx + cy + cz, 1 + cx - cy - cz, 1 - cx + cy - cz, 1 - cx - cy + cz)
"""Four times the square of each component, in the cosines."""
VERTICES = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
d


# %% [markdown]
# ## The geometry of an instantaneous Euler angle
#
# Every rotation is a *twist* about $e_i$, and after it a *swing* about an axis perpendicular to $e_i$. The axis of
# the swing is the direction $N_i$ of the ridge line, and its angle is $\chi_i$: with $\tau_i = 2\,\mathrm{atan2}(q_i,
# q_0)$,
#
# $$ R = \mathrm{Rot}(N_i, \chi_i)\, \mathrm{Rot}(e_i, \tau_i). $$
#
# So $\chi_i$ is the angle by which a rotation tilts the axis $e_i$, and the ridge line is the axis of the tilt. In the
# proof for the axis $i$ the quaternion $t$ of the twist has the components $q_0$ and $q_i$, and is not of unit length;
# that of the swing, $s$, is the product of $q$ with the conjugate of $t$. $\vec s$ is its vector part.

# %%
whole = d.matrix("whole", "q", "quaternion of the rotation", "1", value=sp.Matrix(q), rows=4, columns=1)
for i, axis in enumerate("xyz"):
    twist = sp.Matrix([q0, *(q[1 + i] * UNIT[axis])])
    back = sp.Matrix([q0, *(-q[1 + i] * UNIT[axis])])
    swing = product(sp.Matrix(q), back)
    product_of_both = d.letter(
        rf"swing_twist_{axis}[4,1] | s_{axis}\,t_{axis} | "
        rf"the twist about {axis} and after it the swing, a product of quaternions | 1",
        product(swing, twist),
    )
    twist_squared = d.letter(
        f"twist_squared_{axis} | |t_{axis}|^2 | squared length of the twist | 1", twist.dot(twist)
    )
    swing_scalar = d.letter(f"swing_scalar_{axis} | s_{{{axis},0}} | scalar part of the swing | 1", swing[0])
    swing_vector = d.letter(
        rf"swing_vector_{axis}[3] | \vec s_{axis} | vector part of the swing | 1", sp.Matrix(swing[1:])
    )
    unit = d.letter(rf"e_{axis}[3] | \vec e_{axis} | unit vector of the axis {axis} | 1", UNIT[axis])
    ridge = d.letter(
        rf"N_{axis}[3] | \vec N_{axis} | direction of the ridge line {axis.upper()}r | 1",
        cross(UNIT[axis], M[:, i]),
    )
    d.check(
        f"swing-twist-{axis}",
        equal(product_of_both, twist_squared * whole),
        equal(swing_scalar, twist_squared),
        equal(dot(swing_vector, unit), 0),
        equal(cross(swing_vector, ridge), sp.ZeroMatrix(3, 1)),
        equal(dot(swing_vector, swing_vector), twist_squared * (1 - twist_squared)),
        text="Twist and swing are the rotation. The swing has no part along the axis, and its axis is the direction of "
        "the ridge line. With its length |t| the cosine of half its angle is |t|, the root of the sum of two squares.",
        assumptions=["q is a unit quaternion"],
    ).prove(
        modulo=UNIT_LENGTH,
        because="A quaternion times its conjugate is the square of its length; all other lines are components.",
    )
d.page(*(f"swing-twist-{axis}" for axis in "xyz"))

# %% [markdown]
# How large can the angles be? Let $n$ be the axis and $\chi$ the angle of the whole rotation. No angle $\chi_i$ is
# larger than $\chi$, and it is as large where $n$ is perpendicular to $e_i$. $R_{ii}$ are the diagonal elements of
# the matrix, the cosines of the three angles.

# %%
total = d.symbol("half_total", r"\tfrac\chi2", "half of the whole angle of rotation", "rad")
nx, ny, nz = axis_n = tuple(
    d.symbol(f"n{axis}", f"n_{axis}", f"axis of the rotation along {axis}", "1") for axis in "xyz"
)
by_axis = {q0: cos(total), qx: sin(total) * nx, qy: sin(total) * ny, qz: sin(total) * nz}
diagonal_letters = [
    d.letter(f"R_{axis} | R_{{{axis * 2}}} | cosine of χ_{axis}, from the quaternion | 1", M[i, i])
    for i, axis in enumerate("xyz")
]
unit_axis = {nz: nx**2 + ny**2 + nz**2 - 1}
d.check(
    "part-of-the-whole",
    *(
        equal((1 - c) / 2, sin(total) ** 2 * (1 - n**2))
        for c, n in zip(diagonal_letters, axis_n, strict=True)
    ),
    text="sin²(χ_i/2) = sin²(χ/2) (1 − n_i²), because (1 − cos χ_i)/2 is sin²(χ_i/2).",
    assumptions=[equal(nx**2 + ny**2 + nz**2, 1)],
).prove(
    given=by_axis,
    modulo=unit_axis,
    because="In the quaternion of axis and angle, q_j² + q_k² = sin²(χ/2) (n_j² + n_k²).",
)

# %%
d.check(
    "sum-of-cosines",
    equal(sum(diagonal_letters), 1 + 2 * cos(2 * total)),
    equal(sum((1 - c) / 2 for c in diagonal_letters), 2 * sin(total) ** 2),
    text="The cosines add up to 1 + 2 cos χ, the trace of the matrix; the squared sines of the half angles to "
    "2 sin²(χ/2).",
    assumptions=[equal(nx**2 + ny**2 + nz**2, 1)],
).prove(
    given=by_axis,
    modulo=unit_axis,
    because="The sum of the three lines of the entry before, with n of unit length.",
)

# %% [markdown]
# ## The tetrahedron
#
# Now the squares themselves. Solved for them, the cosines give four linear forms, each four times a square.
# $c_x,c_y,c_z$ are the cosines of the three angles.

# %%
squares_by_cosines = [
    equal(form.xreplace(dict(zip(C, diagonal_letters, strict=True))), 4 * x**2)
    for form, x in zip(FORMS, q, strict=True)
]
d.check(
    "tetrahedron",
    equal(
        sp.ImmutableMatrix(diagonal_letters),
        sp.ImmutableMatrix(
            sum((x**2 * sp.Matrix(v) for x, v in zip(q, VERTICES, strict=True)), sp.zeros(3, 1))
        ),
    ),
    *squares_by_cosines,
    text="The squares are the barycentric coordinates of the cosines, and the four linear forms are four times them.",
    assumptions=["q is a unit quaternion"],
).prove(
    modulo=UNIT_LENGTH,
    because="The diagonal of a unit quaternion's matrix is q₀² + q_i² − q_j² − q_k², and the squares add up to 1.",
)

# %% [markdown]
# Squares are not negative, so there is a rotation for a triple of angles if and only if none of the four forms is
# negative. In half angles:

# %%
S = {axis: sin(half[axis]) ** 2 for axis in "xyz"}
d.check(
    "feasible-by-half-angles",
    equal(FORMS[0], 2 * (2 - S["x"] - S["y"] - S["z"])),
    equal(FORMS[1], 2 * (S["y"] + S["z"] - S["x"])),
    equal(FORMS[2], 2 * (S["z"] + S["x"] - S["y"])),
    equal(FORMS[3], 2 * (S["x"] + S["y"] - S["z"])),
    text="With S = sin²(χ/2): there is a rotation where S_i ≤ S_j + S_k for each, and S_x + S_y + S_z ≤ 2.",
).prove(because="cos χ = 1 − 2S is inserted.")

# %% [markdown]
# How many triples are that? The volume of the tetrahedron is a third of the volume $2^3$ of the cube in which all
# cosines are:

# %%
edges = [sp.Matrix(v) - sp.Matrix(VERTICES[0]) for v in VERTICES[1:]]
volume = d.letter(
    "volume | V | volume of the tetrahedron: a sixth of the determinant of three edges | 1",
    abs(sp.Matrix.hstack(*edges).det()) / 6,
)
lengths = d.letter(
    "edges[1,6] | l^2 | squares of the six edges | 1",
    sp.Matrix(
        [(sp.Matrix(a) - sp.Matrix(b)).dot(sp.Matrix(a) - sp.Matrix(b)) for a, b in combinations(VERTICES, 2)]
    ),
)
d.check(
    "a-third-of-the-cube",
    equal(volume, sp.Rational(1, 3) * 2**3),
    equal(lengths, sp.ImmutableMatrix([[8] * 6])),
    text="The tetrahedron is regular, its edge is 2√2, and it is a third of the cube of all cosines.",
).prove(because="The determinant and the lengths are computed from the four corners.")

# %% [markdown]
# So the angles are not independent:

# %%
d.state(
    "independent",
    *(sp.Ge(form, 0) for form in FORMS),
    said="the three variables are in the same time domain and independent of each other",
    text="Every triple of angles would belong to a rotation.",
    place="sec. 5.2",
    assumptions=[sp.Ge(chi_x, 0), sp.Le(chi_x, sp.pi)],
).refute(
    {half["x"]: sp.pi / 4, half["y"]: 0, half["z"]: 0},
    squares_by_cosines,
    proof=[d.entries["tetrahedron"]],
    label="Z41",
    because="No rotation has the angles (90°, 0, 0): where y and z stay, x does, too. Squares are not negative; the "
    "possible triples fill a third of the cube of cosines.",
)

# %% [markdown]
# ## All rotations with one triple
#
# The squares of the components are known, and their signs are free. If $m$ components are not zero, these are $2^m$
# quaternions; $q$ and $-q$ are the same rotation, so there are $2^{m-1}$ rotations, eight in general. In matrices
# they are the rotation $R$, its inverse $R^T$, and both between equal half turns about a coordinate axis. $F_x$ is
# the half turn about x, and so on; $R^{+-+}$ is the rotation with the signs +, −, + of $q_x,q_y,q_z$.

# %%
FLIPS = [sp.diag(*signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]


def signed(signs):
    return sp.Matrix(
        matrix_from_quaternion(signs[0] * q0, [s * x for s, x in zip(signs[1:], q[1:], strict=True)])
    )


rotation = d.matrix("rotation", "R", "matrix of the quaternion", "1", value=M)
half_turns_by = {
    tuple(flip.diagonal()): d.matrix(f"F_{axis}", f"F_{axis}", f"half turn about {axis}", "1", value=flip)
    for axis, flip in zip("xyz", FLIPS[1:], strict=True)
}
claims = []
for signs in every((1, -1), repeat=3):
    odd = sp.prod(signs) < 0
    like = [-s for s in signs] if odd else list(signs)  # the inverse has the opposite vector part
    flip = sp.diag(*like)
    assert flip in FLIPS
    marks = "".join("+" if sign > 0 else "-" for sign in signs)
    changed = d.matrix(
        f"R_{''.join('p' if sign > 0 else 'm' for sign in signs)}",
        f"R^{{{marks}}}",
        f"matrix of the quaternion with the signs {marks.replace('-', '−')}",
        "1",
        value=signed((1, *signs)),
    )
    core = rotation.T if odd else rotation
    F = half_turns_by.get(tuple(flip.diagonal()))
    claims.append(equal(changed, core if F is None else F * core * F))
d.check(
    "eight-rotations",
    *claims,
    text="Other signs of the vector part: R or its transpose, between equal half turns.",
).prove(
    because="A product of two components in the matrix changes its sign with either of them. Two changed signs are "
    "those of a half turn before and after; all three, those of the transpose.",
)

assert {tuple(sp.diag(*s).diagonal()) for s in every((1, -1), repeat=3) if sp.prod(s) > 0} == {
    tuple(flip.diagonal()) for flip in FLIPS
}

# %% [markdown]
# ## One ridge line, or two, choose among them
#
# Which of the eight rotations is it? The direction $N_z$ of the ridge line $Z_r$ helps. Half turns about z reverse
# it, so that the eight rotations have four directions, each of them in both senses:


# %%
def ridge_z(signs):
    direction = cross(UNIT["z"], signed((1, *signs))[:, 2])
    return sp.Matrix([sp.expand(direction[0]), sp.expand(direction[1])])


def across(a, b):
    return factored(a[0] * b[1] - a[1] * b[0])


four = [(1, 1, 1), (-1, -1, -1), (-1, 1, 1), (-1, 1, -1)]
square = sum(x**2 for x in q)
ridge_of = {
    signs: d.matrix(
        f"ridge_{''.join('p' if sign > 0 else 'm' for sign in signs)}",
        rf"N_z^{{{''.join('+' if sign > 0 else '-' for sign in signs)}}}",
        "x and y component of N_z, with these signs of q_x, q_y, q_z",
        "1",
        value=ridge_z(signs),
        rows=2,
        columns=1,
    )
    for signs in every((1, -1), repeat=3)
}
d.check(
    "opposite-directions",
    *(equal(ridge_of[-a, -b, c], -ridge_of[a, b, c]) for a, b, c in every((1, -1), repeat=3) if a > 0),
    text="A half turn about z, which changes the signs of q_x and q_y, reverses the ridge Zr.",
).prove(because="N_z is −r₂₃ along x and r₁₃ along y, and these elements are odd in (q_x, q_y).")

# %% [markdown]
# No two of the four directions are parallel unless $q_0q_xq_yq_z$, $r_{13}r_{23}$ or $r_{31}r_{32}$ vanishes. So one
# ridge line without a sense leaves two rotations; one with a sense leaves one, and so do two without. In the six
# equations $[12]$ is the cross product of the first and the second of the directions $N_z^{+++}$, $N_z^{---}$,
# $N_z^{-++}$, $N_z^{-+-}$, times the square of $|q|^2=q_0^2+q_x^2+q_y^2+q_z^2$; and so on.

# %%
pairs = {
    (i, j): d.letter(
        f"cross_{i + 1}{j + 1} | [{i + 1}{j + 1}] | "
        f"cross product of the directions {i + 1} and {j + 1}, times |q|⁴ | 1",
        square**2 * across(ridge_z(four[i]), ridge_z(four[j])),
    )
    for i, j in combinations(range(4), 2)
}
r13, r23, r31, r32 = (
    d.symbol(name, f"r_{{{name[1:]}}}", f"element {name[1:]} of the matrix, times |q|²", "1", value=value)
    for name, value in (
        ("r13", 2 * (qx * qz + q0 * qy)),
        ("r23", 2 * (qy * qz - q0 * qx)),
        ("r31", 2 * (qx * qz - q0 * qy)),
        ("r32", 2 * (qy * qz + q0 * qx)),
    )
)
d.check(
    "four-directions",
    equal(pairs[0, 1], 8 * q0 * qz * (qx**2 + qy**2)),
    equal(pairs[2, 3], -8 * q0 * qz * (qx**2 + qy**2)),
    equal(pairs[0, 2], 8 * qx * qy * (q0**2 + qz**2)),
    equal(pairs[1, 3], -8 * qx * qy * (q0**2 + qz**2)),
    equal(pairs[0, 3], -2 * r23 * r13),
    equal(pairs[1, 2], 2 * r32 * r31),
    text="Two directions are parallel only for special rotations.",
).prove(because="The cross products are computed from the elements of the four matrices.")

# %% [markdown]
# ## In the angles of a sequence
#
# The same rotations by the angles of a sequence. For Z-Y-X the square $u = \cos^2\beta$ of the middle angle's cosine
# solves a quadratic in the cosines $k_x,k_y,k_z$ of the three given angles.

# %%
angles = alpha, beta, gamma = tuple(
    d.symbol(name, rf"\{name}", f"Z-Y-X angle {n}", "rad")
    for n, name in enumerate(("alpha", "beta", "gamma"), 1)
)
phi, theta, psi = (
    d.symbol(name, letter, f"Z-Y-Z angle {n}", "rad")
    for n, (name, letter) in enumerate((("phi", r"\phi"), ("theta", r"\theta"), ("psi", r"\varphi")), 1)
)
u = cos(beta) ** 2
kx, ky, kz = (
    d.symbol(f"k_{axis}", f"k_{axis}", f"cosine of χ_{axis}, by the Z-Y-X angles", "1", value=zyx[i, i])
    for i, axis in enumerate("xyz")
)
d.check(
    "zyx-quadratic",
    equal(u**2 - (1 + kx**2 + kz**2 - ky**2) * u + kx**2 + kz**2 + kx**2 * kz**2 - 2 * kx * ky * kz, 0),
    text="The quadratic for cos²β.",
).prove(because="k_x = cos α cos β, k_z = cos β cos γ, k_y = sin α sin β sin γ + cos α cos γ are inserted.")

# %% [markdown]
# Its discriminant is the product of the four forms. So both roots are real where there is a rotation; they belong to
# two groups of four rotations, which differ in the sign of $q_0q_xq_yq_z$.

# %%
c1, c2, c3 = (d.symbol(f"c_{axis}", f"c_{axis}", f"cosine of χ_{axis}", "1") for axis in "xyz")
forms = [form.xreplace({cx: c1, cy: c2, cz: c3}) for form in FORMS]
d.check(
    "zyx-discriminant",
    equal(
        (1 + c1**2 + c3**2 - c2**2) ** 2 - 4 * (c1**2 + c3**2 + c1**2 * c3**2 - 2 * c1 * c2 * c3),
        forms[0] * forms[1] * forms[2] * forms[3],
    ),
    text="The discriminant is the product of the four forms, 256 q₀² q_x² q_y² q_z².",
).prove(because="Both sides are the same polynomial of the three cosines.")

# %% [markdown]
# For Z-Y-Z it is simpler. The middle angle is $\pm\chi_z$, and the sum and the difference of the outer ones follow
# from the other two angles. $m_x,m_y,m_z$ are the cosines of the given angles by the angles of this sequence.

# %%
mx, my, mz = (
    d.symbol(f"m_{axis}", f"m_{axis}", f"cosine of χ_{axis}, by the Z-Y-Z angles", "1", value=right_zyz[i, i])
    for i, axis in enumerate("xyz")
)
d.check(
    "zyz",
    equal(mx + my, (1 + mz) * cos(phi + psi)),
    equal(my - mx, (1 - mz) * cos(phi - psi)),
    equal(mz, cos(theta)),
    text="So θ = ±χ_z, cos(ϕ + φ) = (m_x + m_y)/(1 + m_z), and cos(ϕ − φ) = (m_y − m_x)/(1 − m_z).",
).prove(because="The diagonal of the matrix of Z-Y-Z, with the addition theorems.")

# %% [markdown]
# ## How far is a triple from the possible ones?
#
# Measured angles may lie outside the tetrahedron. Which possible triple is nearest? Let distances be those between the
# cosines. The tetrahedron is regular, so the distance of two points is twice that of their barycentric coordinates:

# %%
b = sp.symbols("b_0:4", real=True)
step = sp.symbols("e_0:3", real=True)
steps = [*step, -sum(step)]  # between two points whose coordinates add up to 1
moved = sum((e * sp.Matrix(v) for e, v in zip(steps, VERTICES, strict=True)), sp.zeros(3, 1))
for letter in step:
    d.symbol(letter.name, letter.name, "difference of two barycentric coordinates", "1")
distance_squared = d.letter(
    r"distance_squared | |\Delta\cos\chi|^2 | "
    r"squared distance of the cosines of two triples, whose coordinates differ by e₀, e₁, e₂, −(e₀ + e₁ + e₂) | 1",
    moved.dot(moved),
)
d.check(
    "distance",
    equal(distance_squared, 4 * sum(e**2 for e in steps)),
    text="The squared distance of cosines is four times that of the coordinates.",
).prove(
    because="The four corners add up to zero, and the scalar product of two of them is −1, that of one with itself 3."
)

# %% [markdown]
# So the nearest point is the nearest point of $b_0+b_1+b_2+b_3 = 1$, $b_k\ge0$, in the barycentric coordinates $b_k$.
# That is $\max(b_k-\tau, 0)$ with one number $\tau$, the largest of the four means $(b_{(1)}+\ldots+b_{(j)}-1)/j$ over
# the $j$ largest coordinates, $j=1$ to 4.

# %% [markdown]
# ## The function
#
# `chi_rotations` gives all rotations with three given angles, the distance of the triple from the possible ones, and
# the nearest possible triple.
#
# Near the boundary of the tetrahedron the squares of the components are small differences. A component that is below
# $\sqrt{\mathrm{tolerance}}$ times the size of the rotation cannot be distinguished from 0, and two rotations that
# differ in its sign are given as one. That is in the nature of the problem: the angles depend on the square.
#
# Near a corner of the tetrahedron, for small rotations and near the three half turns about the axes, the four forms
# are computed from small quantities: from $S_i=\sin^2\frac{\chi_i}2$, and near the half turn about x from $S_x$,
# $1-S_y$, $1-S_z$, and so on. With $t_1,t_2,t_3$ half the sum of the three less each of them, and $t_0$ one less half
# the sum, the forms are four times these numbers, in an order that depends on the corner. So the tolerance is
# relative to the size of the rotation. Near a half turn it is larger: an angle near $\pi$ has the absolute rounding
# of $\pi$.

# %%
small = {
    0: (S["x"], S["y"], S["z"]),
    1: (S["x"], 1 - S["y"], 1 - S["z"]),
    2: (1 - S["x"], S["y"], 1 - S["z"]),
    3: (1 - S["x"], 1 - S["y"], S["z"]),
}
for vertex, parts in small.items():
    rest = [(sum(parts) - 2 * part) / 2 for part in parts]
    t = [1 - sum(parts) / 2, *rest]
    d.check(
        f"near-{('no rotation', 'a half turn about x', 'a half turn about y', 'a half turn about z')[vertex]}".replace(
            " ", "-"
        ),
        *(equal(FORMS[n], 4 * t[n ^ vertex]) for n in range(4)),
        text="The four forms by small quantities near "
        + ("no rotation.", "a half turn about x.", "a half turn about y.", "a half turn about z.")[vertex],
    ).prove(because="cos χ = 1 − 2 sin²(χ/2) is inserted.")
d.page(*(id for id in d.entries if id.startswith("near-")))


# %%
class RotationsStatus(IntEnum):
    """How many rotations have three given instantaneous Euler angles.

    EIGHT: the angles are inside the tetrahedron of the possible ones.
    FOUR: on a face of it, to the tolerance: one component of the quaternion is 0.
    TWO: on an edge: two are 0.
    ONE: at a corner: no rotation, or a half turn about a coordinate axis.
    INFEASIBLE: outside: no rotation has these angles.
    INVALID: not finite, or an angle that is not between 0 and pi.
    """

    EIGHT = 0
    FOUR = 1
    TWO = 2
    ONE = 3
    INFEASIBLE = 4
    INVALID = 5


def sorted_down(k, values):
    """Four numbers, the largest first, by five comparisons."""
    values = list(values)
    for n, (i, j) in enumerate(((0, 1), (2, 3), (0, 2), (1, 3), (1, 2))):
        a, b = values[i], values[j]
        values[i] = k.let(f"upper_{n}", select(a < b, b, a))
        values[j] = k.let(f"lower_{n}", select(a < b, a, b))
    return values


def chi_rotations():
    k = KernelBuilder(
        "chi_rotations",
        summary="All rotations with three given instantaneous Euler angles.",
        source="derivation instantaneous_euler_inverse; Zhou and Zhu, eqs. (10), (13), (16)",
        notes="Rows of `quaternions` beyond the number that the status gives are NaN. Scalar parts are not negative.",
    )
    chi = k.input("chi", 3, unit="rad", doc="angles of the yz, xz and xy planes, 0 to pi")
    tolerance = k.input(
        "tolerance",
        unit="1",
        doc="square of a component, relative to the rotation's size, that is taken for 0; at least 16 eps",
    )
    good = k.let(
        "good", sp.And(*(sp.Ge(x, 0) & sp.Le(x, sp.pi * (1 + 4 * EPS)) for x in chi), sp.Ge(tolerance, 0))
    )
    slack = k.let("slack", select(tolerance < 16 * EPS, 16 * EPS, tolerance))
    s = [k.let(f"s_{n}", sin(x / 2) ** 2) for n, x in enumerate(chi, 1)]
    c = [k.let(f"c_{n}", cos(x / 2) ** 2) for n, x in enumerate(chi, 1)]
    whole = k.let("whole", (s[0] + s[1] + s[2]) / 2)
    share = [k.let("share_0", 1 - whole), *(k.let(f"share_{n}", whole - x) for n, x in enumerate(s, 1))]
    largest, flags = share[0], []
    for n in (1, 2, 3):
        flags.append(k.let(f"above_{n}", share[n] > largest))
        largest = k.let(f"largest_{n}", select(flags[-1], share[n], largest))
    at_3 = flags[2]
    at_2 = k.let("at_2", flags[1] & sp.Not(at_3))
    at_1 = k.let("at_1", flags[0] & sp.Not(flags[1]) & sp.Not(at_3))

    # the squares by what is small near the vertex; square n of the vertex m belongs to the component n xor m
    a = [
        k.let(f"part_{n}", select(first | second, ci, si))
        for n, (first, second, ci, si) in enumerate(
            zip((at_3, at_3, at_1), (at_2, at_1, at_2), c, s, strict=True), 1
        )
    ]
    size = k.let("size", a[0] + a[1] + a[2])
    raw = [k.let(f"raw_{n}", (size - 2 * x) / 2) for n, x in enumerate(a, 1)]
    # an angle near pi is rounded like pi, so that the small cosine of its half is off by a few eps
    coarse = k.let("coarse", select(at_1 | at_2 | at_3, 16 * EPS * (sp.sqrt(size) + EPS), 0))
    floor = k.let("floor", slack * size + coarse)
    outside = k.let("outside", sp.Or(*(x < -floor for x in raw)))
    rest = [k.let(f"rest_{n}", select(x <= floor, 0, x)) for n, x in enumerate(raw, 1)]
    near = [k.let("rest_0", 1 - (rest[0] + rest[1] + rest[2])), *rest]

    def component(n):
        value = near[n]
        for flag, vertex in ((at_1, 1), (at_2, 2), (at_3, 3)):
            value = select(flag, near[n ^ vertex], value)
        return k.let(f"component_{n}", sp.sqrt(value))

    length = [component(n) for n in range(4)]
    present = [k.let(f"present_{n}", x > 0) for n, x in enumerate(length)]

    # the first component that is there has no sign to choose; the others take the bits of the row's number
    free = [k.let(f"free_{n}", present[n] & sp.Or(*present[:n])) for n in (1, 2, 3)]
    count = sum((select(flag, 1, 0) for flag in free), sp.S.Zero)
    freedom = k.let("freedom", count)
    before = [0, k.let("before_2", select(free[0], 1, 0)), 0]
    before[2] = k.let("before_3", before[1] + select(free[1], 1, 0))
    known = k.let("known", good & sp.Not(outside))
    rows = []
    for row in range(8):
        bits = [-1 if row >> n & 1 else 1 for n in range(3)]
        there = known & (freedom > sp.Rational(2 * row.bit_length() - 1, 2))
        entries = [length[0]]
        for n, flag, rank in zip((1, 2, 3), free, before, strict=True):
            sign = (
                bits[0]
                if rank == 0
                else select(rank < sp.S.Half, bits[0], select(rank < sp.Rational(3, 2), bits[1], bits[2]))
            )
            entries.append(select(flag, sign * length[n], length[n]))
        rows.append(sp.Matrix([[select(there, x, sp.nan) for x in entries]]))
    k.output(
        "quaternions", sp.Matrix.vstack(*rows), unit="1", doc="unit quaternions, one a row, scalar part first"
    )

    ordered = sorted_down(k, share)
    shift, total = None, sp.S.Zero
    for n, value in enumerate(ordered, 1):
        total = k.let(f"total_{n}", total + value)
        mean = k.let(f"mean_{n}", (total - 1) / n)
        shift = mean if shift is None else k.let(f"shift_{n}", select(mean > shift, mean, shift))
    nearest = [k.let(f"kept_{n}", select(x > shift, x - shift, 0)) for n, x in enumerate(share)]
    gap = sum(((x - y) ** 2 for x, y in zip(share, nearest, strict=True)), sp.S.Zero)
    k.output(
        "distance",
        select(good, select(outside, 2 * sp.sqrt(gap), 0), sp.nan),
        unit="1",
        doc="distance of the cosines from those of the nearest possible triple",
    )
    for_angles = []
    for i, (j, n) in enumerate(((2, 3), (3, 1), (1, 2)), 1):
        angle = 2 * sp.atan2(sp.sqrt(nearest[j] + nearest[n]), sp.sqrt(nearest[0] + nearest[i]))
        for_angles.append(select(good, select(outside, angle, chi[i - 1]), sp.nan))
    k.output("nearest", sp.Matrix(for_angles), unit="rad", doc="that triple")
    status = sp.Piecewise(
        (RotationsStatus.INVALID, sp.Not(good)),
        (RotationsStatus.INFEASIBLE, outside),
        (RotationsStatus.EIGHT, freedom > sp.Rational(5, 2)),
        (RotationsStatus.FOUR, freedom > sp.Rational(3, 2)),
        (RotationsStatus.TWO, freedom > sp.S.Half),
        (RotationsStatus.ONE, True),
        evaluate=False,
    )
    k.status("status", status, RotationsStatus, doc="how many rotations there are")
    return k.build()


rotations_kernel = chi_rotations()

# %% [markdown]
# What the function computes, before anything is set to zero, are the four squares of the quaternion:

# %%
shares = [rotations_kernel.expand(rotations_kernel[f"share_{n}"]) for n in range(4)]
ports = {s: 2 * half[axis] for s, axis in zip(rotations_kernel.port("chi").symbols, "xyz", strict=True)}
d.check(
    "kernel-shares",
    *(
        equal(
            4
            * d.letter(
                f"share_{n} | b_{n} | square {n} as the function computes it | 1", share.xreplace(ports)
            ),
            form,
        )
        for n, (share, form) in enumerate(zip(shares, FORMS, strict=True))
    ),
    text="The program's squares are a quarter of the four forms.",
).prove(because="The steps of the function are inserted into each other.")

# %%
derivation.kernel(rotations_kernel)

# %% [markdown]
# ## Picture
#
# The figure shows the tetrahedron in the cube of all cosines, with 4000 random rotations in it; each $\cos\chi_i$ of
# them is uniformly distributed. Of the cube of *angles* the possible triples are about 14.7 per cent.

# %%
if in_notebook():
    from rodgen.derivation.figures import instantaneous_euler as figures
    from rodgen.derivation.figures import show

    show(figures.possible_cosines(VERTICES))
    print(f"Part of the cube of angles, by counting: {figures.possible_part(VERTICES):.3f}")
