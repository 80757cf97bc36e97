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
# # Which rotations have given instantaneous Euler angles?
#
# Each angle $\chi_i$ is that by which a rotation tilts the axis $e_i$. In the unit quaternion $(q_0, q_x, q_y, q_z)$
# the diagonal of the matrix is
#
# $$ (\cos\chi_x, \cos\chi_y, \cos\chi_z) = q_0^2\,(1,1,1) + q_x^2\,(1,-1,-1) + q_y^2\,(-1,1,-1) + q_z^2\,(-1,-1,1), $$
#
# so the squares are the barycentric coordinates of the cosines in a tetrahedron (Horn's). A triple outside belongs to
# no rotation, and the angles are not "independent of each other", as Zhou and Zhu say. A triple inside belongs to as
# many rotations as there are signs: eight, fewer on the faces.

# %%
from enum import IntEnum
from itertools import combinations
from itertools import product as every

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import (
    PAPER,
    UNIT,
    Entries,
    of_quaternion,
    product,
    q,
    right_zyz,
    zyx,
)
from rodgen.derivation.rotations import matrix_from_quaternion
from rodgen.symbolic import EPS, Derivation, cross, equal, factored, in_notebook, select

derivation = Derivation(
    "instantaneous_euler_inverse",
    title="Which rotations have given instantaneous Euler angles?",
    source=PAPER,
)
d = derivation
sin, cos = sp.sin, sp.cos

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
diagonal = {cx: M[0, 0], cy: M[1, 1], cz: M[2, 2]}
d


# %%
def at(form):
    """A form in the cosines, of the quaternion."""
    letters = {c: sp.Symbol(f"c{n}") for n, c in enumerate(C)}
    return form.xreplace(letters).xreplace({letters[c]: value for c, value in diagonal.items()})


# %% [markdown]
# ## The geometry of an instantaneous Euler angle
#
# A rotation is a *twist* about $e_i$ and after it a *swing* about an axis across $e_i$. The axis of the swing is the
# ridge line's direction, and its angle is $\chi_i$: with $\tau_i = 2\,\mathrm{atan2}(q_i, q_0)$, $R =
# \mathrm{Rot}(N_i, \chi_i)\, \mathrm{Rot}(e_i, \tau_i)$.

# %%
for i, axis in enumerate("xyz"):
    twist = sp.Matrix([q0, *(q[1 + i] * UNIT[axis])])
    back = sp.Matrix([q0, *(-q[1 + i] * UNIT[axis])])
    swing = product(sp.Matrix(q), back)
    ridge = cross(UNIT[axis], M[:, i])
    d.check(
        f"swing-twist-{axis}",
        equal(sp.ImmutableMatrix(product(swing, twist)), sp.ImmutableMatrix(sp.Matrix(q) * twist.dot(twist))),
        equal(swing[0], twist.dot(twist)),
        equal(swing[1 + i], 0),
        equal(sp.ImmutableMatrix(cross(sp.Matrix(swing[1:]), ridge)), sp.zeros(3, 1)),
        equal(sp.Matrix(swing[1:]).dot(sp.Matrix(swing[1:])), twist.dot(twist) * (1 - twist.dot(twist))),
        text="The swing has no part along the axis, its axis is the ridge line's direction, and the cosine of half its "
        "angle is the root of the sum of two squares.",
    ).prove(modulo=UNIT_LENGTH)
Entries(d, *(f"swing-twist-{axis}" for axis in "xyz"))

# %% [markdown]
# With the axis $n$ and the angle $\chi$ of the whole rotation: each $\chi_i\le\chi$, with equality where $n$ is
# across $e_i$; and their cosines add up to the trace.

# %%
total = d.symbol("half_total", r"\tfrac\chi2", "half of the whole angle of rotation", "rad")
nx, ny, nz = axis_n = tuple(
    d.symbol(f"n{axis}", f"n_{axis}", f"axis of the rotation along {axis}", "1") for axis in "xyz"
)
by_axis = {q0: cos(total), qx: sin(total) * nx, qy: sin(total) * ny, qz: sin(total) * nz}
d.check(
    "part-of-the-whole",
    *(equal((1 - M[i, i]) / 2, sin(total) ** 2 * (1 - axis_n[i] ** 2)) for i in range(3)),
    text="sin²(χ_i/2) = sin²(χ/2) (1 − n_i²).",
).prove(given=by_axis, modulo={nz: nx**2 + ny**2 + nz**2 - 1})

# %%
d.check(
    "sum-of-cosines",
    equal(M.trace(), 1 + 2 * cos(2 * total)),
    equal(sum((1 - M[i, i]) / 2 for i in range(3)), 2 * sin(total) ** 2),
    text="The cosines add up to 1 + 2 cos χ; the squared sines of the halves to 2 sin²(χ/2).",
).prove(given=by_axis, modulo={nz: nx**2 + ny**2 + nz**2 - 1})

# %% [markdown]
# ## The tetrahedron

# %%
d.check(
    "tetrahedron",
    equal(
        sp.ImmutableMatrix([M[i, i] for i in range(3)]),
        sp.ImmutableMatrix(
            sum((x**2 * sp.Matrix(v) for x, v in zip(q, VERTICES, strict=True)), sp.zeros(3, 1))
        ),
    ),
    *(equal(at(form), 4 * x**2) for form, x in zip(FORMS, q, strict=True)),
    text="The squares are the barycentric coordinates of the cosines, and the four linear forms are four times them.",
).prove(modulo=UNIT_LENGTH)

# %%
S = {axis: sin(half[axis]) ** 2 for axis in "xyz"}
d.check(
    "feasible-by-half-angles",
    equal(FORMS[0], 2 * (2 - S["x"] - S["y"] - S["z"])),
    equal(FORMS[1], 2 * (S["y"] + S["z"] - S["x"])),
    equal(FORMS[2], 2 * (S["z"] + S["x"] - S["y"])),
    equal(FORMS[3], 2 * (S["x"] + S["y"] - S["z"])),
    text="With S = sin²(χ/2): there is a rotation where S_i ≤ S_j + S_k for each, and S_x + S_y + S_z ≤ 2.",
).prove()

# %%
edges = [sp.Matrix(v) - sp.Matrix(VERTICES[0]) for v in VERTICES[1:]]
d.check(
    "a-third-of-the-cube",
    equal(abs(sp.Matrix.hstack(*edges).det()) / 6, sp.Rational(1, 3) * 2**3),
    *(
        equal((sp.Matrix(a) - sp.Matrix(b)).dot(sp.Matrix(a) - sp.Matrix(b)), 8)
        for a, b in combinations(VERTICES, 2)
    ),
    text="The tetrahedron is regular, its edge is 2√2, and it is a third of the cube of all cosines.",
).prove()

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
    [equal(form, 4 * x**2) for form, x in zip(map(at, FORMS), q, strict=True)],
    proof=[d.entries["tetrahedron"]],
    label="Z41",
    because="No rotation has the angles (90°, 0, 0): where y and z stay, x does, too. Squares are not negative; the "
    "possible triples fill a third of the cube of cosines.",
)

# %% [markdown]
# ## All rotations with one triple
#
# The squares are known and the signs free: $2^m$ quaternions with $m$ components that are not zero, two of them a
# rotation each. In matrices: a rotation, its inverse, and both seen after a half turn about each coordinate axis.

# %%
FLIPS = [sp.diag(*signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]


def signed(signs):
    return sp.Matrix(
        matrix_from_quaternion(signs[0] * q0, [s * x for s, x in zip(signs[1:], q[1:], strict=True)])
    )


claims = []
for signs in every((1, -1), repeat=3):
    odd = sp.prod(signs) < 0
    like = [-s for s in signs] if odd else list(signs)  # the inverse has the opposite vector part
    flip = sp.diag(*like)
    assert flip in FLIPS
    claims.append(
        equal(sp.ImmutableMatrix(signed((1, *signs))), sp.ImmutableMatrix(flip * (M.T if odd else M) * flip))
    )
d.check(
    "eight-rotations",
    *claims,
    text="Other signs of the vector part: R or its transpose, between equal half turns.",
).prove()

# %%
assert {tuple(sp.diag(*s).diagonal()) for s in every((1, -1), repeat=3) if sp.prod(s) > 0} == {
    tuple(flip.diagonal()) for flip in FLIPS
}

# %% [markdown]
# ## One ridge line, or two, choose among them
#
# The directions of $Z_r$ for the eight are $\pm$ four, each of the four shared by a rotation and the one turned by a
# half turn about z. Of the four no two are parallel unless $q_0q_xq_yq_z$ or $r_{13}r_{23}$ vanishes. So one ridge
# line without a sense leaves two, one with a sense leaves one, and so do two without.


# %%
def ridge_z(signs):
    direction = cross(UNIT["z"], signed((1, *signs))[:, 2])
    return sp.Matrix([sp.expand(direction[0]), sp.expand(direction[1])])


def across(a, b):
    return factored(a[0] * b[1] - a[1] * b[0])


four = [(1, 1, 1), (-1, -1, -1), (-1, 1, 1), (-1, 1, -1)]
square = sum(x**2 for x in q)
d.check(
    "opposite-directions",
    *(
        equal(
            sp.ImmutableMatrix(ridge_z((-a, -b, c))),
            sp.ImmutableMatrix(-ridge_z((a, b, c))),
        )
        for a, b, c in every((1, -1), repeat=3)
    ),
    text="A half turn about z turns the ridge Zr around.",
).prove()

# %%
pairs = {(i, j): square**2 * across(ridge_z(four[i]), ridge_z(four[j])) for i, j in combinations(range(4), 2)}
r13, r23 = 2 * (qx * qz + q0 * qy), 2 * (qy * qz - q0 * qx)
r31, r32 = 2 * (qx * qz - q0 * qy), 2 * (qy * qz + q0 * qx)
d.check(
    "four-directions",
    equal(pairs[0, 1], 8 * q0 * qz * (qx**2 + qy**2)),
    equal(pairs[2, 3], -8 * q0 * qz * (qx**2 + qy**2)),
    equal(pairs[0, 2], 8 * qx * qy * (q0**2 + qz**2)),
    equal(pairs[1, 3], -8 * qx * qy * (q0**2 + qz**2)),
    equal(pairs[0, 3], -2 * r23 * r13),
    equal(pairs[1, 2], 2 * r32 * r31),
    text="The other four are, up to their sense, R itself, its inverse, and two more: no two of these directions are "
    "parallel, but for special rotations.",
).prove()

# %% [markdown]
# ## In the angles of a sequence
#
# For Z-Y-X the square $u = \cos^2\beta$ solves a quadratic; its discriminant is the product of the four forms, so
# both roots are real where there is a rotation, and they are two groups of four rotations, by the sign of
# $q_0q_xq_yq_z$. For Z-Y-Z the middle angle is $\chi_z$, and sum and difference of the outer ones follow.

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
kx, ky, kz = (zyx[i, i] for i in range(3))
d.check(
    "zyx-quadratic",
    equal(u**2 - (1 + kx**2 + kz**2 - ky**2) * u + kx**2 + kz**2 + kx**2 * kz**2 - 2 * kx * ky * kz, 0),
    text="The quadratic of cos²β, with the cosines of the three angles.",
).prove()

# %%
c1, c2, c3 = (d.symbol(f"c_{axis}", f"c_{axis}", f"cosine of χ_{axis}", "1") for axis in "xyz")
forms = [form.xreplace({cx: c1, cy: c2, cz: c3}) for form in FORMS]
d.check(
    "zyx-discriminant",
    equal(
        (1 + c1**2 + c3**2 - c2**2) ** 2 - 4 * (c1**2 + c3**2 + c1**2 * c3**2 - 2 * c1 * c2 * c3),
        forms[0] * forms[1] * forms[2] * forms[3],
    ),
    text="Its discriminant is the product of the four forms, 256 q0² qx² qy² qz².",
).prove()

# %%
mx, my, mz = (right_zyz[i, i] for i in range(3))
d.check(
    "zyz",
    equal(mx + my, (1 + mz) * cos(phi + psi)),
    equal(my - mx, (1 - mz) * cos(phi - psi)),
    equal(mz, cos(theta)),
    text="For Z-Y-Z: θ = ±χ_z, cos(φ + φ') = (c_x + c_y)/(1 + c_z), cos(φ − φ') = (c_y − c_x)/(1 − c_z).",
).prove()

# %% [markdown]
# ## How far is a triple from the possible ones?
#
# Distances are taken between the cosines. The tetrahedron is regular: the distance of two points is twice that of
# their barycentric coordinates, so that the nearest point is the nearest point of $b_0+b_1+b_2+b_3 = 1$, $b_k\ge0$.
# That is $\max(b_k-\tau, 0)$ with one number $\tau$, the largest of the means $(b_{(1)}+\ldots+b_{(j)}-1)/j$ over the
# largest $j$.

# %%
b = sp.symbols("b_0:4", real=True)
step = sp.symbols("e_0:3", real=True)
steps = [*step, -sum(step)]  # between two points whose coordinates add up to 1
moved = sum((e * sp.Matrix(v) for e, v in zip(steps, VERTICES, strict=True)), sp.zeros(3, 1))
for letter in step:
    d.symbol(letter.name, letter.name, "difference of two barycentric coordinates", "1")
d.check(
    "distance",
    equal(moved.dot(moved), 4 * sum(e**2 for e in steps)),
    text="The squared distance of cosines is four times that of the coordinates.",
).prove()

# %% [markdown]
# ## The kernel
#
# The squares of the components are small differences near the boundary, so a component of a rotation that is below
# $\sqrt{\mathrm{tolerance}}$ times the size of the rotation cannot be distinguished from 0, and two rotations that
# differ in its sign are given as one. That is in the nature of the problem: the angles depend on the square. For small
# rotations, and near the three half turns about the axes, the differences are formed from small quantities: from the
# squared sines of half angles, and with those of two axes replaced by the squared cosines. So the tolerance is relative
# to the size of the rotation. Near a half turn it is larger: an angle near $\pi$ has the absolute rounding of $\pi$.

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
        text="The four forms in terms of small quantities.",
    ).prove()
Entries(d, *(id for id in d.entries if id.startswith("near-")))


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
# The kernel's four squares are those of the quaternion, before anything is set to zero.

# %%
shares = [rotations_kernel.expand(rotations_kernel[f"share_{n}"]) for n in range(4)]
ports = {s: 2 * half[axis] for s, axis in zip(rotations_kernel.port("chi").symbols, "xyz", strict=True)}
d.check(
    "kernel-shares",
    *(equal(4 * share.xreplace(ports), form) for share, form in zip(shares, FORMS, strict=True)),
).prove()

# %%
derivation.kernel(rotations_kernel)
derivation.kernels

# %% [markdown]
# The cosines of all triples, and of 4000 random rotations, each $\cos\chi_i$ of which is uniform. Of the cube of
# *angles* the possible triples are about 14.7 per cent.

# %%
if in_notebook():
    from rodgen.derivation.figures import instantaneous_euler as figures
    from rodgen.derivation.figures import show

    show(figures.possible_cosines(VERTICES))
    print(f"{figures.possible_part(VERTICES):.3f} of the cube of angles")
