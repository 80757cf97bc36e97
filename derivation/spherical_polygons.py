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
# # Spherical polygons: direction cosines, X-Y-Z notation, and the laws of triangle to heptagon
#
# The notes "Robot Geometry" follow Crane and Duffy, "Kinematic Analysis of Robot Manipulators". A closed loop of links
# and joints has a spherical image: all joint axes $\vec S_j$ are moved to one point, the twists $\alpha_{ij}$ and the
# joint angles $\theta_j$ stay. Closed, it says that
#
# $$ R_z(\theta_1)R_x(\alpha_{12})R_z(\theta_2)R_x(\alpha_{23})\cdots R_z(\theta_n)R_x(\alpha_{n1})=I. $$
#
# Everything below is read off this product: the direction cosines, the short names of their entries, and which names
# are equal on every closed polygon. The notes print the definitions and some examples; the tables of laws, which they
# only announce, are generated, and each law is proved. With dual angles $\theta+\varepsilon S$ and
# $\alpha+\varepsilon a$ the same laws hold for lines in space, and their dual parts are the secondary laws.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.polygon_laws import FAMILIES, HalfTangent, Law, laws
from rodgen.polygon_notation import Entry, Term, chain_value
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    Dual,
    dual_matrix,
    dual_rotation_x,
    dual_rotation_z,
    equal,
    last_case,
    matrix_from_rodrigues_vector,
    rot,
    select,
    skew,
)

derivation = Derivation(
    "spherical_polygons",
    title="Spherical polygons: X-Y-Z notation and the laws of triangle to heptagon",
    source='Lecture notes "Robot Geometry" after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)
d = derivation
im = sp.ImmutableMatrix
x_axis, y_axis, z_axis = (im(sp.eye(3)[:, n]) for n in range(3))


def Rx(angle):
    return im(rot("x", angle))


def Rz(angle):
    return im(rot("z", angle))


# %% [markdown]
# ## Symbols
#
# Twists and joint angles of up to seven joints; $\alpha_{ij}$ turns about $\vec a_{ij}$ from $\vec S_i$ to
# $\vec S_j$, $\theta_j$ about $\vec S_j$ from $\vec a_{ij}$ to $\vec a_{jk}$. `alpha_e`, `theta_b` are those of one
# step of a recursion, and `X_a`, `Y_a`, `Z_a` what the step starts from.

# %%
alpha = {
    i: d.symbol(
        f"alpha_{i}{i % 7 + 1}", rf"\alpha_{{{i}{i % 7 + 1}}}", f"twist from joint {i} to {i % 7 + 1}", "rad"
    )
    for i in range(1, 8)
}
theta = {j: d.symbol(f"theta_{j}", rf"\theta_{j}", f"angle of joint {j}", "rad") for j in range(1, 8)}
alpha_31 = d.symbol("alpha_31", r"\alpha_{31}", "twist that closes a triangle", "rad")
alpha_41 = d.symbol("alpha_41", r"\alpha_{41}", "twist that closes a quadrilateral", "rad")
alpha_51 = d.symbol("alpha_51", r"\alpha_{51}", "twist that closes a pentagon", "rad")
alpha_e = d.symbol("alpha_e", r"\alpha_{b,b\to1}", "twist of a step", "rad")
theta_b = d.symbol("theta_b", r"\theta_b", "joint angle of a step", "rad")
Xa, Ya, Za = (d.symbol(f"{name}_a", f"{name}_a", "of all subscripts but the last", "1") for name in "XYZ")
cosines_and_sines = {
    **{("alpha", i): (sp.cos(a), sp.sin(a)) for i, a in alpha.items()},
    **{("theta", j): (sp.cos(t), sp.sin(t)) for j, t in theta.items()},
}


def term(name, subscripts, n=7, **marks):
    """A name of the notation, written out."""
    return Term(name, tuple(map(int, subscripts)), n, **marks).value(cosines_and_sines)


def names(letters, subscripts, n=7, **marks):
    return im([term(letter, subscripts, n, **marks) for letter in letters])


c12, s12, c23, s23 = (f(alpha[i]) for i in (1, 2) for f in (sp.cos, sp.sin))
c2, s2 = sp.cos(theta[2]), sp.sin(theta[2])
d

# %% [markdown]
# ## Direction cosines of the joint axes, and single subscripts
#
# In the frame with $x=\vec a_{12}$ and $z=\vec S_1$. An axis $\vec S_j$ is the third column of the product of all
# rotations from this frame to the one with $z = \vec S_j$.

# %%
d.state(
    "S1-S2-S3",
    equal(Rx(alpha[1]) * z_axis, im([0, -s12, c12])),
    equal(
        Rx(alpha[1]) * Rz(theta[2]) * Rx(alpha[2]) * z_axis,
        im([s23 * s2, -(s12 * c23 + c12 * s23 * c2), c12 * c23 - s12 * s23 * c2]),
    ),
    place="Find 1S2, Find 1S3",
    text="The second and the third axis; the first is z.",
).prove()

# %%
d.state(
    "single-bar",
    equal(Rx(alpha[1]) * Rz(theta[2]) * Rx(alpha[2]) * z_axis, names("XYZ", "2", bar=True)),
    equal(
        names("XYZ", "2", bar=True),
        im([s23 * s2, -(s12 * c23 + c12 * s23 * c2), c12 * c23 - s12 * s23 * c2]),
    ),
    place="Single Subscript Notation",
    text="X ≡ s s_θ, Y ≡ -(sc + cs c_θ), Z ≡ cc - ss c_θ; with a bar the twist after the joint goes with θ.",
).prove()

# %%
d.state(
    "single",
    equal(
        names("XYZ", "2"),
        im([s12 * s2, -(s23 * c12 + c23 * s12 * c2), c23 * c12 - s23 * s12 * c2]),
    ),
    place="Single Subscript Notation",
    text="Without a bar the twist before the joint goes with θ.",
).prove()

# %%
mirror = sp.diag(1, -1, 1)
d.check(
    "mirror",
    equal(im(mirror * Rx(alpha_e) * mirror), Rx(-alpha_e)),
    equal(im(mirror * Rz(theta_b) * mirror), Rz(-theta_b)),
    equal(im(mirror * Rx(-alpha[2]) * Rz(-theta[2]) * Rx(-alpha[1]) * z_axis), names("XYZ", "2")),
    text="Rising subscripts are the way back, mirrored in y: the names without a bar are the axis before, seen from "
    "the link after the joint.",
).prove()

# %% [markdown]
# ## More subscripts
#
# The notes' rule is one more rotation about $z$ and one about $x$. So falling subscripts $b\ldots a$ are the column
# of a product of any length, by induction: a single one with a bar to begin with, and the step below. Rising ones
# are its mirror image. $X^*$, which has the sine and the cosine of the last joint exchanged, is the step's second
# component between the two rotations; the notes have no name for it.

# %%
star = Xa * sp.sin(theta_b) + Ya * sp.cos(theta_b)
step = im(
    [
        Xa * sp.cos(theta_b) - Ya * sp.sin(theta_b),
        sp.cos(alpha_e) * star - sp.sin(alpha_e) * Za,
        sp.sin(alpha_e) * star + sp.cos(alpha_e) * Za,
    ]
)
d.state(
    "step",
    equal(Rx(alpha_e) * Rz(theta_b) * im([Xa, Ya, Za]), step),
    place="Multi-Subscript Notation",
    text="X_ab, Y_ab and Z_ab of X_a, Y_a, Z_a.",
).prove()

# %%
columns = {}
column = im([Xa, Ya, Za])
for j in range(2, 7):
    frame = Rx(alpha[1])
    for k in range(2, j + 1):
        frame = frame * Rz(theta[k]) * Rx(alpha[k])
    columns[j + 1] = frame  # the frame with z = S of the joint after it
falling = {j: "".join(map(str, range(j - 1, 1, -1))) for j in range(3, 8)}


def named(letter, subscripts, **marks):
    """A name of the heptagon as a symbol, which the table of symbols writes out."""
    name = Term(letter, tuple(map(int, subscripts)), 7, **marks)
    code = name.text().replace("*", "star")
    return d.symbol(code, name.latex(), "name of the notation", "1", value=name.value(cosines_and_sines))


rows_of_axes = {j: [named(letter, falling[j], bar=j == 3) for letter in "XYZ"] for j in range(3, 8)}
axes = {
    j: d.vector(f"axis_{j}", rf"\vec S_{j}", f"axis of joint {j}", "1", value=columns[j] * z_axis)
    for j in range(3, 8)
}
d.check(
    "axes",
    *(equal(axes[j], im(rows_of_axes[j])) for j in range(3, 8)),
    text="The axes of three to seven joints.",
).prove()

# %%
along = d.symbol(
    "along_67",
    r"\vec a_{67}\cdot\vec S_2",
    "component of the second axis along link 67",
    "1",
    value=x_axis.dot(Rz(theta[7]) * Rx(alpha[7]) * Rz(theta[1]) * Rx(alpha[1]) * z_axis),
)
X_1, Y_1, X_7, Y_7 = (named(letter, row) for row in "17" for letter in "XY")
Xb_1, Yb_1 = (named(letter, "1", bar=True) for letter in "XY")
X_17, X_71 = named("X", "17"), named("X", "71")
d.state(
    "double-subscripts",
    equal(along, X_1 * sp.cos(theta[7]) - Y_1 * sp.sin(theta[7])),
    said="For double subscript notation the order ij means the X, Y, Z terms will not have bars and the order ji "
    "means that they will have bars, where i < j",
    place="Multi-Subscript Notation",
    text="The component of S_2 along a_67 is X_17, because 7 follows on 1 when the joints are counted down: were "
    "i < j the rule, it would begin with the X_1 that has no bar.",
).refute(
    {alpha[1]: sp.pi / 2, alpha[7]: sp.pi / 6, theta[1]: sp.pi / 2, theta[7]: 0},
    equal(along, Xb_1 * sp.cos(theta[7]) - Yb_1 * sp.sin(theta[7])),
    label="N1",
    because="What counts is whether the subscripts rise or fall around the loop, where 1 follows on n: 71 rises and "
    "has no bar, 17 falls and has one.",
)

# %%
d.check(
    "wrapped",
    equal(X_17, Xb_1 * sp.cos(theta[7]) - Yb_1 * sp.sin(theta[7])),
    equal(X_71, X_7 * sp.cos(theta[1]) - Y_7 * sp.sin(theta[1])),
    equal(X_17, along),
    text="X_17 begins with a bar, X_71 without.",
).prove()

# %% [markdown]
# ## Direction cosines of the links, and U-V-W
#
# $\vec a_{j,j+1}$ is the first column of the same product without its last factor. Twists and joint angles change
# places in the names: $U_{ij}=s_is_{ij}$ and so on. In a row of them $U$ and $U^*$ do without the last joint's angle.

# %%
d.check(
    "polar-single",
    equal(
        names("UVW", "12"),
        im(
            [
                sp.sin(theta[1]) * s12,
                -(s2 * sp.cos(theta[1]) + c2 * sp.sin(theta[1]) * c12),
                c2 * sp.cos(theta[1]) - s2 * sp.sin(theta[1]) * c12,
            ]
        ),
    ),
    equal(
        names("UVW", "12"),
        names("XYZ", "1").subs(
            {alpha[7]: theta[1], theta[1]: alpha[1], alpha[1]: theta[2]}, simultaneous=True
        ),
    ),
    text="U, V, W of two joints, and X, Y, Z of one with twists and joint angles exchanged.",
).prove()

# %%
Ua, Va, Wa = Xa, Ya, Za
d.check(
    "polar-step",
    equal(
        im([[Wa, Va, Ua]]) * Rx(alpha_e) * Rz(theta_b),
        im(
            [
                [
                    sp.sin(theta_b) * (Ua * sp.sin(alpha_e) + Va * sp.cos(alpha_e)) + sp.cos(theta_b) * Wa,
                    sp.cos(theta_b) * (Ua * sp.sin(alpha_e) + Va * sp.cos(alpha_e)) - sp.sin(theta_b) * Wa,
                    Ua * sp.cos(alpha_e) - Va * sp.sin(alpha_e),
                ]
            ]
        ),
    ),
    text="The same step with twist and joint angle exchanged takes the row (W, V, U) one link and one joint on.",
).prove()

# %%
links = {
    j: d.vector(
        f"link_{j}{j + 1}",
        rf"\vec a_{{{j}{j + 1}}}",
        f"direction of link {j}{j + 1}",
        "1",
        value=(columns[j] if j > 2 else Rx(alpha[1])) * Rz(theta[j]) * x_axis,
    )
    for j in range(2, 7)
}
rows = {j: f"{j}{falling[j]}" for j in range(3, 7)}
U21, U21_star = named("U", "21"), named("U", "21", star=True)
d.check(
    "links",
    equal(links[2], im([c2, -U21_star, U21])),
    equal(im([U21, U21_star]), im([s2 * s12, -s2 * c12])),
    *(
        equal(
            links[j],
            im([named("W", rows[j]), -named("U", rows[j] + "1", star=True), named("U", rows[j] + "1")]),
        )
        for j in range(3, 7)
    ),
    text="The links: (W, -U*, U), of 23 with c_2 in place of W.",
).prove()

# %% [markdown]
# All scalar products of the loop's vectors are these by a shift of the subscripts:
# $\vec S_i\cdot\vec S_j=Z_{j-1\ldots i+1}$, $\vec a_{i,i+1}\cdot\vec S_j=X_{j-1\ldots i+1}$,
# $\vec a_{i,i+1}\cdot\vec a_{j,j+1}=W_{j\ldots i+1}$, $\vec S_i\cdot\vec a_{j,j+1}=U_{j\ldots i+1,i}$. They hold for
# open chains too: nothing was closed yet.
#
# ## The laws
#
# On a closed polygon a product of neighbouring factors is the inverse, so the transpose, of the product of all
# others. Each name is, up to sign, an entry $\vec e_r^TP\vec e_c$ of a product $P$ (the checks above), and so is each
# right side of a law. So two names are equal when three rules lead both to one entry: $R_x\vec e_x=\vec e_x$ and
# $R_z\vec e_z=\vec e_z$; $P=Q^T$ for the rest $Q$; and the transpose. `Entry.canonical` takes an entry to the
# shortest that these rules reach.

# %%
d.check(
    "own-axis",
    equal(Rx(alpha_e) * x_axis, x_axis),
    equal(x_axis.T * Rx(alpha_e), x_axis.T),
    equal(Rz(theta_b) * z_axis, z_axis),
    equal(z_axis.T * Rz(theta_b), z_axis.T),
    equal(Rx(alpha_e).T, Rx(-alpha_e)),
    equal(Rx(alpha_e).T * Rx(alpha_e), im(sp.eye(3))),
    equal(Rz(theta_b).T * Rz(theta_b), im(sp.eye(3))),
    text="What the three rules need.",
).prove()


# %%
def written(name):
    return sp.Symbol(name.latex(), real=True)


def product_entry(entry):
    """The entry of the product of rotations itself, written out."""
    found = im(sp.eye(3))
    for factor in range(entry.start, entry.start + entry.length):
        number = factor // 2 % 7 + 1
        found = found * (Rx(alpha[number]) if factor % 2 else Rz(theta[number]))
    return entry.sign * found[entry.row, entry.column]


short = [
    Term(letter, row, 7, bar=len(row) == 1 and bar, star=star)
    for row, bar in (
        ((2,), False),
        ((2,), True),
        ((2, 3), False),
        ((3, 2), False),
        ((7, 1), False),
        ((1, 7), False),
    )
    for letter, star in (*((letter, False) for letter in "XYZUVW"), ("X", True), ("U", True))
    if len(row) > 1 or letter in "XYZ"
]


def typeset_entry(entry):
    """The entry as a product that is not carried out."""
    left, right = (rf"{{\vec e_{'xyz'[k]}}}" for k in (entry.row, entry.column))
    factors = [
        rf"R_x(\alpha_{{{k // 2 % 7 + 1}{(k // 2 + 1) % 7 + 1}}})"
        if k % 2
        else rf"R_z(\theta_{{{k // 2 % 7 + 1}}})"
        for k in range(entry.start, entry.start + entry.length)
    ]
    letters = [sp.Symbol(text, commutative=False) for text in (left + "^T", *factors, right)]
    return sp.Mul(entry.sign, *letters)


d.check(
    "entries",
    *(equal(written(name), typeset_entry(name.entry())) for name in short),
    text="All kinds of names, rising, falling and around the end, are the entries that the calculus takes them for; "
    "longer ones are so by the steps above.",
).prove(
    im([name.value(cosines_and_sines) - product_entry(name.entry()) for name in short]),
    because="Written out, both sides are identical.",
)

# %%
sa, ca, sb, cb = sp.sin(alpha_e), sp.cos(alpha_e), sp.sin(theta_b), sp.cos(theta_b)
d.check(
    "right-sides",
    equal(z_axis.T * Rx(alpha_e) * Rz(theta_b), im([[sa * sb, sa * cb, ca]])),
    equal(y_axis.T * Rx(alpha_e) * Rz(theta_b) * x_axis, im([ca * sb])),
    equal(Rz(theta_b) * Rx(alpha_e) * z_axis, im([sa * sb, -sa * cb, ca])),
    equal(x_axis.T * Rz(theta_b) * Rx(alpha_e) * y_axis, im([-ca * sb])),
    equal(x_axis.T * Rz(theta_b) * x_axis, im([cb])),
    text="Products of a sine or a cosine of a twist and of the adjacent joint angle are entries as well.",
).prove()


# %%
def formal(entry: Entry):
    """The symbol of an entry's shortest form: equal entries are one symbol, and products are not expanded."""
    shortest = entry.canonical()
    return shortest.sign * sp.Symbol(
        f"entry_{shortest.n}_{shortest.row}{shortest.start}_{shortest.length}{shortest.column}"
    )


def law_claims(n, family):
    """The family's laws with the subscripts 1 to n, as they are typeset; the proof takes all shifts."""
    return [
        equal(written(law.left), law.sign * written(law.right))
        for law in laws(n, shifts=False)
        if law.family == family and isinstance(law, Law)
    ]


def law_residuals(n, family):
    return [
        formal(law.left.entry()) - law.sign * formal(law.right.entry())
        for law in laws(n)
        if law.family == family and isinstance(law, Law)
    ]


POLYGONS = {3: "triangle", 4: "quadrilateral", 5: "pentagon", 6: "hexagon", 7: "heptagon"}
for n, polygon in POLYGONS.items():
    for family in FAMILIES[:4]:
        claims = law_claims(n, family)
        if claims:
            d.check(
                f"{family.replace(' ', '-')}-{n}",
                *claims,
                text=f"Laws of the spherical {polygon}, {family}, with every cyclic shift of the subscripts.",
                assumptions=["the polygon is closed"],
            ).prove(
                *law_residuals(n, family),
                because="Both sides of each law, and of its shifts, are one entry of a product of rotations.",
            )

# %%
d.entries["subsidiary-5"]

# %%
d.entries["polar-7"]

# %% [markdown]
# Half-tangent laws follow from a sine and a sine-cosine law, $X=s\,s_j$ and $Y=s\,c_j$.

# %%
assert all(law.holds() for n in POLYGONS for law in laws(n) if isinstance(law, HalfTangent))
x_j = d.symbol("x_j", "x_j", "tangent of half a joint angle", "1", value=sp.tan(theta_b / 2))
s_near = d.symbol("s_n", "s", "sine of a twist", "1")
half_given = {sb: 2 * x_j / (1 + x_j**2), cb: (1 - x_j**2) / (1 + x_j**2)}
half_x, half_y = (s_near * half_given[f] for f in (sb, cb))
d.check(
    "half-tangent",
    equal(x_j, half_x / (half_y + s_near)),
    equal(x_j, (s_near - half_y) / half_x),
    text="With sin θ = 2x/(1+x²) and cos θ = (1-x²)/(1+x²): x = X/(Y + s) = (s - Y)/X.",
    assumptions=[sp.Ne(s_near, 0)],
).prove(given={x_j: x_j})

# %% [markdown]
# ## The notes' example
#
# $\theta$ is the angle from link to link, so it is $\pi$ less the angle inside the triangle.

# %%
triangle = {alpha[1]: sp.pi / 2, alpha[2]: sp.pi / 3, theta[2]: sp.pi / 2}
triangle |= {alpha_31: sp.pi / 2, theta[1]: 2 * sp.pi / 3, theta[3]: sp.pi / 2}
loop = d.matrix(
    "loop",
    r"R_z(\theta_1) R_x(\alpha_{12}) R_z(\theta_2) R_x(\alpha_{23}) R_z(\theta_3) R_x(\alpha_{31})",
    "product of all rotations of a triangle",
    "1",
    value=Rz(theta[1]) * Rx(alpha[1]) * Rz(theta[2]) * Rx(alpha[2]) * Rz(theta[3]) * Rx(alpha_31),
)
closed = equal(loop, im(sp.eye(3)))
c31, s31, c1, s1 = sp.cos(alpha_31), sp.sin(alpha_31), sp.cos(theta[1]), sp.sin(theta[1])
Xb2, Yb2, Zb2 = rows_of_axes[3]
d.state(
    "triangle-X",
    equal(Xb2, s31 * s1),
    equal(Zb2, c31),
    place="Spherical Mechanism Equation Toolkit",
    assumptions=[closed],
).prove(d.entries["fundamental-3"], because="They are the first and the third fundamental law.")

# %%
d.state(
    "triangle-Y",
    equal(Yb2, sp.sin(alpha[2]) * c1),
    place="Spherical Mechanism Equation Toolkit",
    text="It is s_32 in the notes, which is s_23.",
    assumptions=[closed],
).refute(
    triangle,
    equal(Yb2, s31 * c1),
    proof=[d.entries["fundamental-3"]],
    label="N2",
    because="The sine is that of the twist between joints 3 and 1, as in the law of X.",
)

# %% [markdown]
# ## Dual angles: the secondary laws
#
# A link turns by $\alpha$ about $x$ and shifts by $a$ along it, a joint turns by $\theta$ about $z$ and shifts by $S$
# along it. As dual matrices $R+\varepsilon[\vec p]_\times R$ these are $R_x$ and $R_z$ of the dual angles
# $\alpha+\varepsilon a$ and $\theta+\varepsilon S$, and products of motions are products of dual matrices. So a closed
# loop in space is a closed spherical polygon of dual angles. The checks of the names and the three rules above use
# nothing but sums, products and $\sin^2+\cos^2=1$, which hold for dual angles: **every law has a secondary law**, its
# dual part.

# %%
a_e = d.symbol("a_e", r"a_{b,b\to1}", "length of the link of a step", "length")
S_b = d.symbol("S_b", r"S_b", "offset of the joint of a step", "length")
a_12 = d.symbol("a_12", r"a_{12}", "length of a link", "length")
a_23 = d.symbol("a_23", r"a_{23}", "length of a link", "length")
S_2 = d.symbol("S_2", r"S_2", "offset of joint 2", "length")
turn_vector = d.vector("tau", r"\vec\tau", "Rodrigues vector of any rotation R", "1")
shift = d.vector("p", r"\vec p", "shift of any motion", "length")
R = sp.Matrix(matrix_from_rodrigues_vector(sp.Matrix(list(turn_vector))))
p = sp.Matrix(list(shift))


def both_parts(left, right):
    return equal(im(left.primary), im(right.primary)), equal(im(left.secondary), im(right.secondary))


d.check(
    "dual-link-and-joint",
    *both_parts(dual_rotation_x(Dual(alpha_e, a_e)), dual_matrix(Rx(alpha_e), a_e * x_axis)),
    *both_parts(dual_rotation_z(Dual(theta_b, S_b)), dual_matrix(Rz(theta_b), S_b * z_axis)),
    text="Links and joints are rotations by dual angles.",
).prove()

# %%
turned = d.matrix("R", "R", "any rotation", "1", value=R)
d.check(
    "dual-product",
    equal(turned * skew(shift), skew(turned * shift) * turned),
    text="So (R + ε[p]R)(Q + ε[q]Q) = RQ + ε[p + Rq]RQ, the matrix of the two motions one after the other.",
).prove()

# %%
d.check(
    "dual-orthogonal",
    *both_parts(dual_rotation_x(Dual(alpha_e, a_e)).T * dual_rotation_x(Dual(alpha_e, a_e)), Dual(sp.eye(3))),
    *both_parts(dual_rotation_z(Dual(theta_b, S_b)).T * dual_rotation_z(Dual(theta_b, S_b)), Dual(sp.eye(3))),
    equal(dual_rotation_x(Dual(alpha_e, a_e)).secondary * x_axis, im([0, 0, 0])),
    equal(dual_rotation_z(Dual(theta_b, S_b)).secondary * z_axis, im([0, 0, 0])),
    text="Dual matrices of motions have the transpose as inverse, and leave their own axis: the three rules hold.",
).prove()

# %% [markdown]
# The secondary names by the rules of dual numbers, written out. $X_0$ and so on are the dual parts.

# %%
first = [Dual(alpha[1], a_12), Dual(theta[2], S_2), Dual(alpha[2], a_23)]
dual_names = chain_value([(angle.cos(), angle.sin()) for angle in first])
X2, Y2, Z2 = names("XYZ", "2")
d.check(
    "secondary-single",
    equal(dual_names[0].secondary, a_12 * c12 * s2 + S_2 * s12 * c2),
    equal(dual_names[2].secondary, a_12 * (s23 * s12 - c23 * c12 * c2) - a_23 * Z2 + S_2 * c23 * X2),
    equal(dual_names[3].secondary, a_12 * Yb2 + a_23 * Y2 + S_2 * s23 * X2),
    text="X_0, Y_0 and Z_0 of one joint.",
).prove()

# %%
X0a, Y0a, Z0a = (
    d.symbol(f"{name}0_a", f"{name}_{{0a}}", "dual part for all subscripts but the last", "length")
    for name in "XYZ"
)
dual_b, dual_e = Dual(theta_b, S_b), Dual(alpha_e, a_e)
cosine_b, sine_b, cosine_e, sine_e = dual_b.cos(), dual_b.sin(), dual_e.cos(), dual_e.sin()
dual_X, dual_Y, dual_Z = Dual(Xa, X0a), Dual(Ya, Y0a), Dual(Za, Z0a)
dual_star = dual_X * sine_b + dual_Y * cosine_b
star_0 = X0a * sp.sin(theta_b) + Y0a * sp.cos(theta_b) + S_b * step[0]
d.check(
    "secondary-step",
    equal((dual_X * cosine_b - dual_Y * sine_b).secondary, X0a * cb - Y0a * sb - S_b * star),
    equal(dual_star.secondary, star_0),
    equal((dual_star * cosine_e - dual_Z * sine_e).secondary, ca * star_0 - sa * Z0a - a_e * step[2]),
    equal((dual_star * sine_e + dual_Z * cosine_e).secondary, sa * star_0 + ca * Z0a + a_e * step[1]),
    text="One more joint and link: the derivative of each turn is the other component times its length.",
).prove()

# %%
s_n1, c_n1 = Dual(alpha_e, a_e).sin(), Dual(alpha_e, a_e).cos()
d.check(
    "secondary-right-sides",
    equal((s_n1 * sine_b).secondary, a_e * ca * sb + S_b * sa * cb),
    equal((s_n1 * cosine_b).secondary, a_e * ca * cb - S_b * sa * sb),
    equal(c_n1.secondary, -a_e * sa),
    text="Right sides of the secondary sine, sine-cosine and cosine laws. The last is free of offsets: the secondary "
    "cosine law Z_0 = -a s.",
).prove()


# %%
def secondary_claims(law):
    """The dual part of a fundamental law: its name with the index 0, and the right side above."""
    letter, row = law.left.latex().split("_{")
    left = sp.Symbol(f"{letter}_{{0{row}", real=True)
    (_, twist), *turn = law.right.factors
    e = f"{twist[1]}{twist[1] % law.left.n + 1}"
    a, c, s = (sp.Symbol(f"{name}_{{{e}}}", real=True) for name in "acs")
    if not turn:
        return equal(left, -a * s)
    j = turn[0][1][1]
    S, c_turn, s_turn = (sp.Symbol(f"{name}_{j}", real=True) for name in "Scs")
    return equal(
        left, a * c * s_turn + S * s * c_turn if law.kind == "sine" else a * c * c_turn - S * s * s_turn
    )


for n, polygon in POLYGONS.items():
    d.check(
        f"secondary-{n}",
        *(secondary_claims(law) for law in laws(n, shifts=False) if law.family == "fundamental"),
        text=f"Secondary sine, sine-cosine and cosine laws of loops with the {polygon} as spherical image.",
        assumptions=["the loop is closed"],
    ).prove(
        d.entries[f"fundamental-{n}"],
        d.entries["dual-product"],
        d.entries["dual-orthogonal"],
        d.entries["secondary-right-sides"],
        because="The three rules hold for dual angles, so the fundamental laws do; these are their dual parts.",
    )

# %%
d.entries["secondary-5"]

# %% [markdown]
# ## Quadrilateral
#
# The four twists and $\theta_4$ are given. The cosine law $Z_{41}=c_{23}$ is $Ac_1+Bs_1+D=0$; $\theta_2$ and
# $\theta_3$ follow from sines and cosines. The laws would give $\theta_3$ by $X_{14}$ and $Y_{14}$; the kernel takes it
# from the row $(W,V,U)_{412}$, which has a value where $s_{23}$ vanishes, too.
#
# With $\beta$ the angle between $\vec S_1$ and $\vec S_3$, $(X_4,Y_4,Z_4)=(\sin\beta\sin\gamma,\sin\beta\cos\gamma,
# \cos\beta)$, the law is that of a triangle with the sides $\alpha_{12}$, $\beta$, $\alpha_{23}$:
# $\cos(\theta_1-\gamma)=(c_{23}-c_{12}\cos\beta)/(s_{12}\sin\beta)$. Where $\alpha_{23}$ is small or near $\pi$ its
# cosine hardly changes, and the difference loses the digits that $\theta_1$ needs: at $2\cdot10^{-5}$ the polygon
# stayed open by $4\cdot10^{-12}$. The differences of cosines as products of sines of half sums keep them all.

# %%
quad = {
    **{
        ("alpha", i): (sp.cos(a), sp.sin(a))
        for i, a in ((1, alpha[1]), (2, alpha[2]), (3, alpha[3]), (4, alpha_41))
    },
    **{("theta", j): (sp.cos(theta[j]), sp.sin(theta[j])) for j in range(1, 5)},
}


def quad_term(name, subscripts, **marks):
    return Term(name, tuple(map(int, subscripts)), 4, **marks).value(quad)


d.check(
    "quadrilateral-theta-1",
    equal(
        quad_term("Z", "41") - c23,
        s12 * quad_term("Y", "4") * c1 + s12 * quad_term("X", "4") * s1 + c12 * quad_term("Z", "4") - c23,
    ),
    text="The cosine law as an equation in θ₁.",
).prove()

# %%
d.check(
    "last-angle",
    equal(
        x_axis.T * (Rx(alpha[2]) * Rz(theta[3]) * Rx(alpha[3])).T,
        im([[sp.cos(theta[3]), sp.sin(theta[3]) * c23, sp.sin(theta[3]) * s23]]),
    ),
    text="The row of all factors except those of joint 3 and the adjacent links gives the last angle without division.",
).prove()

# %% [markdown]
# ## Pentagon
#
# The five twists, $\theta_4$ and $\theta_5$ are given. $Z_{45}=\bar Z_2$ gives two $\theta_2$; then $\theta_1$ is
# linear in its sine and cosine by $X_{45}=X_{21}$ and $Y_{45}=-X^*_{21}$, and $\theta_3$ comes as before.

# %%
X45, Y45 = sp.symbols("X_45 Y_45", real=True)
bar_x, bar_y = sp.symbols("Xb_2 Yb_2", real=True)
square = bar_x**2 + bar_y**2
linear = {c1: (bar_x * X45 - bar_y * Y45) / square, s1: -(bar_y * X45 + bar_x * Y45) / square}
d.check(
    "pentagon-theta-1",
    equal(bar_x * linear[c1] - bar_y * linear[s1], X45),
    equal(bar_x * linear[s1] + bar_y * linear[c1], -Y45),
    text="The cosine and the sine of θ₁ of the two linear equations.",
    assumptions=[sp.Ne(square, 0)],
).prove()

# %%
u, v, w = (
    d.symbol(name, name, f"{words} a spherical triangle", "rad")
    for name, words in (("u", "side of"), ("v", "side of"), ("w", "side opposite to the angle sought in"))
)
P, Q = d.symbol("P", "P", "cos(u - v) - cos w", "1"), d.symbol("Q", "Q", "cos w - cos(u + v)", "1")
root = d.symbol("root", r"\sqrt{PQ}", "root of P Q", "1")
differences = {P: sp.cos(u - v) - sp.cos(w), Q: sp.cos(w) - sp.cos(u + v)}
d.check(
    "half-sums",
    equal(sp.cos(2 * u - 2 * v) - sp.cos(2 * w), 2 * sp.sin(w + u - v) * sp.sin(w - u + v)),
    equal(sp.cos(2 * w) - sp.cos(2 * u + 2 * v), 2 * sp.sin(u + v + w) * sp.sin(u + v - w)),
    text="P and Q of the sides 2u, 2v and 2w are products.",
).prove()

# %%
d.check(
    "triangle-angle",
    equal(sp.sin(u) * sp.sin(v) * (Q - P) / (P + Q), sp.cos(w) - sp.cos(u) * sp.cos(v)),
    equal(sp.sin(u) * sp.sin(v) * (P - Q) / (P + Q), sp.cos(u) * sp.cos(v) - sp.cos(w)),
    text="The cosine of the angle inside a triangle, and of that from side to side: (Q - P)/(P + Q), and its opposite.",
    assumptions=[sp.Ne(sp.sin(u) * sp.sin(v), 0)],
).prove(given=differences)

# %%
d.check(
    "triangle-sine",
    equal(((Q - P) / (P + Q)) ** 2 + (2 * root / (P + Q)) ** 2, 1),
    text="Its sine is ±2√(PQ)/(P + Q); there are two angles where P and Q have one sign, one where one of them is 0.",
).prove(modulo={root: root**2 - P * Q})


# %% [markdown]
# ## The kernels
#
# `polygon_notation_k` evaluates a row of $k$ subscripts from its $2k+1$ angles, near one first (`Term.angles`);
# `polygon_secondary_k` the dual parts as well. The other two close a quadrilateral and a pentagon.


# %%
class PolygonStatus(IntEnum):
    """How a spherical polygon closes.

    TWO: in two ways.
    DOUBLE: the two ways are one, to rounding.
    FAMILY: some joints can be at any angle, because two axes coincide; one of the ways represents them all.
    NONE: not at all, for these angles; the result is NaN.
    INVALID: an input is not finite; the result is NaN.
    """

    TWO = 0
    DOUBLE = 1
    FAMILY = 2
    NONE = 3
    INVALID = 4


NEAR = 16 * EPS
"""Sides of a triangle are sums and products of at most ten sines and cosines, angles of some rad."""


def pairs(k, name, angles):
    """Cosine and sine of each angle, named."""
    cosines = k.let(f"c_{name}", sp.Matrix([sp.cos(angle) for angle in angles]))
    sines = k.let(f"s_{name}", sp.Matrix([sp.sin(angle) for angle in angles]))
    return list(zip(cosines, sines, strict=True))


def notation_kernel(count, secondary):
    size = 2 * count + 1
    words = f"{count} subscript{'s' if count > 1 else ''}"
    k = KernelBuilder(
        f"polygon_{'secondary' if secondary else 'notation'}_{count}",
        summary=f"Evaluate X, X*, Y, Z of {words}" + (" with their dual parts." if secondary else "."),
        source="derivation spherical_polygons; Crane and Duffy, X-Y-Z notation",
        notes="U, U*, V, W are the same with twists and joint angles exchanged.",
    )
    angles = k.input("angles", size, unit="rad", doc="near twist, joint, twist, ..., joint, far twist")
    lengths = None
    if secondary:
        lengths = k.input(
            "lengths", size, unit="length", doc="link lengths and offsets that go with the angles"
        )
    chain = pairs(k, "angle", angles)
    zero = sp.S.Zero
    x, y, z = zero, -chain[0][1], chain[0][0]
    near = zero if lengths is None else lengths[0]
    x0, y0, z0 = zero, -near * chain[0][0], -near * chain[0][1]
    star = star0 = zero
    for b in range(1, size, 2):
        (c, s), (ce, se) = chain[b], chain[b + 1]
        number = (b + 1) // 2
        if lengths is not None:
            S, a = lengths[b], lengths[b + 1]
        new, star = k.let(f"x_{number}", x * c - y * s), k.let(f"star_{number}", x * s + y * c)
        if lengths is not None:
            x0, star0 = (
                k.let(f"x0_{number}", x0 * c - y0 * s - S * star),
                k.let(f"star0_{number}", x0 * s + y0 * c + S * new),
            )
        x, y, z = new, k.let(f"y_{number}", star * ce - z * se), k.let(f"z_{number}", star * se + z * ce)
        if lengths is not None:
            y0, z0 = (
                k.let(f"y0_{number}", star0 * ce - z0 * se - a * z),
                k.let(f"z0_{number}", star0 * se + z0 * ce + a * y),
            )
    k.output("values", sp.Matrix([x, star, y, z]), unit="1", doc="X, X*, Y, Z")
    if secondary:
        k.output("secondary", sp.Matrix([x0, star0, y0, z0]), unit="length", doc="their dual parts")
    return k.build()


def closing_row(k, name, row, chain):
    """Take the row (W, V, U) through links and joints, in turn, beginning with a link."""
    for number, (c, s) in enumerate(chain):
        x, y, z = row
        row = [x, y * c + z * s, z * c - y * s] if number % 2 == 0 else [x * c + y * s, y * c - x * s, z]
        row = list(k.let(f"row_{name}{number + 1}", sp.Matrix(row)))
    return row


def polygon_status(k, finite, none, family, double):
    return sp.Piecewise(
        (PolygonStatus.INVALID, sp.Not(finite)),
        (PolygonStatus.NONE, none),
        (PolygonStatus.FAMILY, family),
        (PolygonStatus.DOUBLE, double),
        (PolygonStatus.TWO, True),
        evaluate=False,
    )


def magnitudes(*vectors):
    return sum((abs(x) for v in vectors for x in v), sp.S.Zero)


def triangle(k, u, v, w, size, inside):
    """Cosine and both sines of an angle of a triangle from its sides u, v and the opposite one w, and what it is.

    `size` is sin u sin v. The angle is the one inside, or that from side to side; 0 where it can be any.
    """
    half = k.let("half_sums", sp.Matrix([(w + u - v) / 2, (w - u + v) / 2, (u + v + w) / 2, (u + v - w) / 2]))
    factors = k.let("factors", sp.Matrix([sp.sin(x) for x in half]))
    sign = k.let("side", select(size < 0, -1, 1))
    found, short, zero = [], [], []
    for name, (f, g) in (("p", factors[0:2]), ("q", factors[2:4])):
        value, tolerance = (
            k.let(f"{name}_side", sign * f * g),
            k.let(f"{name}_near", NEAR * (abs(f) + abs(g))),
        )
        short.append(k.let(f"{name}_short", value < -tolerance))
        zero.append(k.let(f"{name}_zero", abs(value) <= tolerance))
        found.append(k.let(f"{name}", select(zero[-1], 0, value)))
    flat = k.let("flat", abs(size) <= NEAR)
    none = k.let("no_angle", sp.Or(*short, flat & sp.Not(sp.And(*zero))))
    one = k.let("one_angle", sp.Or(*zero))
    (p, q), any_angle = found, k.let("any_angle", sp.Or(flat, sp.And(*zero)))
    whole = k.let("p_and_q", select(any_angle, 1, p + q))
    cosine = k.let("angle_c", select(any_angle, 1, (q - p if inside else p - q) / whole))
    sine = k.let("angle_s", select(any_angle, 0, 2 * sp.sqrt(abs(p * q)) / whole))
    # not the sine with another sign where both angles are one: -0 would make -pi of pi
    other = k.let("other_sine", select(one, sine, -sine))
    return (cosine, sine, other), none, any_angle, one


def quadrilateral():
    k = KernelBuilder(
        "polygon_quadrilateral",
        summary="Close a spherical quadrilateral: all joint angles of the twists and the last joint angle.",
        source="derivation spherical_polygons; Crane and Duffy, spherical quadrilateral",
    )
    twists = k.input("alpha", 4, unit="rad", doc="twists 12, 23, 34, 41")
    theta_4 = k.input("theta_4", unit="rad", doc="angle of joint 4")
    (p12, p23, p34, p41), (p4,) = pairs(k, "alpha", twists), pairs(k, "theta", [theta_4])
    x4, y4, z4 = (
        k.let(f"{n}_4", v) for n, v in zip("xsyz", chain_value([p34, p4, p41]), strict=True) if n != "s"
    )
    far = k.let("sine_13", sp.sqrt(x4**2 + y4**2))
    sides = (twists[0], sp.atan2(far, z4), twists[1])
    (cosine, *sines), none, every, double = triangle(k, *sides, p12[1] * far, True)
    on_axis = k.let("on_axis", far <= NEAR)
    divisor = k.let("far", select(on_axis, 1, far))
    toward = (
        k.let("c_gamma", select(on_axis, 1, y4 / divisor)),
        k.let("s_gamma", select(on_axis, 0, x4 / divisor)),
    )
    roots = [
        (
            k.let(f"c_1_{number}", toward[0] * cosine - toward[1] * sine),
            k.let(f"s_1_{number}", toward[1] * cosine + toward[0] * sine),
        )
        for number, sine in enumerate(sines, start=1)
    ]
    family = k.let("family", sp.Or(every, abs(p23[1]) <= NEAR))
    finite = k.let("finite", magnitudes(twists, [theta_4]) <= LARGEST)
    good = k.let("good", finite & sp.Not(none))
    rows = []
    for number, (c, s) in enumerate(roots, start=1):
        x41 = k.let(f"x_41_{number}", x4 * c - y4 * s)
        y41 = k.let(f"y_41_{number}", p12[0] * (x4 * s + y4 * c) - p12[1] * z4)
        flat = abs(p23[1]) <= NEAR
        side = select(p23[1] < 0, -1, 1)
        sine_2 = k.let(f"sine_2_{number}", select(flat, 0, side * x41))
        cosine_2 = k.let(f"cosine_2_{number}", select(flat, 1, side * y41))
        length = k.let(f"length_2_{number}", sp.sqrt(sine_2**2 + cosine_2**2))
        length = k.let(f"divisor_2_{number}", select(length > 0, length, 1))
        second = (k.let(f"c_2_{number}", cosine_2 / length), k.let(f"s_2_{number}", sine_2 / length))
        row = closing_row(k, f"{number}", [p4[0], -p4[1], 0], [p41, (c, s), p12, second])
        sine_3 = k.let(f"sine_3_{number}", p23[0] * row[1] + p23[1] * row[2])
        third = sp.atan2(sine_3, row[0])
        rows.append([sp.atan2(s, c), sp.atan2(sine_2, cosine_2), third, theta_4])
    values = sp.Matrix(rows)
    k.output(
        "theta",
        select(good, values, sp.ones(2, 4) * sp.nan),
        unit="rad",
        doc="joint angles 1 to 4 of both ways, from -pi to pi but the given one",
    )
    k.status(
        "status",
        polygon_status(k, finite, none, family, double),
        PolygonStatus,
        doc="how the quadrilateral closes",
    )
    return k.build()


def pentagon():
    k = KernelBuilder(
        "polygon_pentagon",
        summary="Close a spherical pentagon: all joint angles of the twists and the last two joint angles.",
        source="derivation spherical_polygons; Crane and Duffy, spherical pentagon example",
    )
    twists = k.input("alpha", 5, unit="rad", doc="twists 12, 23, 34, 45, 51")
    given = k.input("theta_45", 2, unit="rad", doc="angles of the joints 4 and 5")
    (p12, p23, p34, p45, p51), (p4, p5) = pairs(k, "alpha", twists), pairs(k, "theta", given)
    x45, _, y45, z45 = chain_value([p34, p4, p45, p5, p51])
    x45, y45, z45 = k.let("x_45", x45), k.let("y_45", y45), k.let("z_45", z45)
    sides = (twists[0], twists[1], sp.atan2(sp.sqrt(x45**2 + y45**2), z45))
    (cosine, *sines), none, every, double = triangle(k, *sides, p12[1] * p23[1], False)
    roots = [(cosine, sine) for sine in sines]
    finite = k.let("finite", magnitudes(twists, given) <= LARGEST)
    good = k.let("good", finite & sp.Not(none))
    rows, free = [], []
    for number, (c, s) in enumerate(roots, start=1):
        xb = k.let(f"xb_2_{number}", p23[1] * s)
        yb = k.let(f"yb_2_{number}", -(p12[1] * p23[0] + p12[0] * p23[1] * c))
        length = k.let(f"length_1_{number}", sp.sqrt(xb**2 + yb**2))
        flat = k.let(f"flat_1_{number}", length <= NEAR)
        free.append(flat)
        cosine_1 = k.let(f"cosine_1_{number}", select(flat, 1, xb * x45 - yb * y45))
        sine_1 = k.let(f"sine_1_{number}", select(flat, 0, -(yb * x45 + xb * y45)))
        divisor = k.let(f"size_1_{number}", sp.sqrt(cosine_1**2 + sine_1**2))
        divisor = k.let(f"divisor_1_{number}", select(divisor > 0, divisor, 1))
        first = (k.let(f"c_1_{number}", cosine_1 / divisor), k.let(f"s_1_{number}", sine_1 / divisor))
        row = closing_row(k, f"{number}", [p4[0], -p4[1], 0], [p45, p5, p51, first, p12, (c, s)])
        sine_3 = k.let(f"sine_3_{number}", p23[0] * row[1] + p23[1] * row[2])
        third = sp.atan2(sine_3, row[0])
        rows.append([sp.atan2(sine_1, cosine_1), sp.atan2(s, c), third, *given])
    family = k.let("family", sp.Or(every, *free))
    values = sp.Matrix(rows)
    k.output(
        "theta",
        select(good, values, sp.ones(2, 5) * sp.nan),
        unit="rad",
        doc="joint angles 1 to 5 of both ways, from -pi to pi but the given ones",
    )
    k.status(
        "status",
        polygon_status(k, finite, none, family, double),
        PolygonStatus,
        doc="how the pentagon closes",
    )
    return k.build()


# %%
kernels = [notation_kernel(count, secondary) for secondary in (False, True) for count in range(1, 6)]
for count in (1, 2):
    port = kernels[count - 1].port("angles").symbols
    expected = chain_value([(sp.cos(angle), sp.sin(angle)) for angle in port])
    d.check(
        f"kernel-notation-{count}",
        equal(im(kernels[count - 1].expand("values")), im(expected)),
        text="The kernel is the recursion.",
    ).prove()
    dual = kernels[count + 4]
    angles = [
        Dual(a, b) for a, b in zip(dual.port("angles").symbols, dual.port("lengths").symbols, strict=True)
    ]
    expected = chain_value([(angle.cos(), angle.sin()) for angle in angles])
    d.check(
        f"kernel-secondary-{count}",
        equal(im(dual.expand("values")), im([value.primary for value in expected])),
        equal(im(dual.expand("secondary")), im([value.secondary for value in expected])),
        text="The kernel is the recursion with dual angles.",
    ).prove()


# %% [markdown]
# The steps of the two kernels that close polygons, one by one, where no axes coincide. `b` is half the angle that
# they find by an arctangent.

# %%
half_b = d.symbol("b", "b", "half the angle between two axes", "rad")


def steps(kernel, values, keep=()):
    """Named steps as a column, in the inputs and the steps that are kept."""
    kept = [kernel[name] for name in keep]
    column = [entry for value in values for entry in sp.Matrix([kernel.expand(kernel[value], keep=kept)])]
    return im([entry.xreplace(dict.fromkeys(entry.atoms(sp.atan2), 2 * half_b)) for entry in column])


def check_triangle(kernel, sides, far):
    """The half sums of the sides in the steps `far`, P and Q, and cosine and sine of the angle."""
    u, v, w = sides
    h, p, q = (kernel[name] for name in ("half_sums", "p", "q"))
    inside = 1 if kernel.name.endswith("quadrilateral") else -1
    d.check(
        f"kernel-{kernel.name.removeprefix('polygon_')}-triangle",
        equal(
            2 * steps(kernel, ["half_sums"], keep=far),
            im([w + u - v, w - u + v, u + v + w, u + v - w]),
        ),
        equal(
            # the usual case: nothing coincides, and no twist is negative
            last_case(steps(kernel, ["p_side", "q_side"], keep=["half_sums"])),
            im([sp.sin(h[0]) * sp.sin(h[1]), sp.sin(h[2]) * sp.sin(h[3])]),
        ),
        equal(
            last_case(steps(kernel, ["angle_c"], keep=("p", "q", "any_angle"))),
            im([inside * (q - p) / (p + q)]),
        ),
        equal(
            last_case(steps(kernel, ["angle_s"], keep=("p", "q", "any_angle"))),
            im([2 * sp.sqrt(abs(p * q)) / (p + q)]),
        ),
        text="The kernel takes half of P and of Q.",
    ).prove()


def check_row(kernel, number, factors):
    """Return the row of all factors except those of joint 3 and the adjacent links."""
    steps_of = [name for _, place in factors if isinstance(place, tuple) for name in place]
    a, g = (kernel.inputs[n].symbols for n in (0, 1))
    product = x_axis.T
    for kind, place in factors:
        if kind == "x":
            product = product * Rx(a[place])
        else:
            named_pair = isinstance(place, tuple)
            c, s = (kernel[n] for n in place) if named_pair else (sp.cos(g[place]), sp.sin(g[place]))
            product = product * im([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    row = steps(kernel, [f"row_1{number}"], keep=steps_of)
    c3, s3 = sp.cos(theta[3]), sp.sin(theta[3])
    last = kernel[f"row_1{number}"]
    found = kernel.expand(kernel["sine_3_1"], keep=[last])
    twist = a[1]
    there = dict(zip(last, (c3, s3 * sp.cos(twist), s3 * sp.sin(twist)), strict=True))
    d.check(
        f"kernel-{kernel.name.removeprefix('polygon_')}-row",
        equal(row, im(product.T)),
        equal(found.xreplace(there), s3),
        text="The row of the other rotations, and the sine of θ₃ from it.",
    ).prove()


quad_kernel, pent_kernel = quadrilateral(), pentagon()
a, (g,) = quad_kernel.port("alpha").symbols, quad_kernel.port("theta_4").symbols
check_triangle(quad_kernel, (a[0], 2 * half_b, a[1]), ["sine_13", "z_4"])
near = chain_value([(sp.cos(x), sp.sin(x)) for x in (a[2], g, a[3])])
x_4, y_4, z_4, c_1, s_1 = (quad_kernel[name] for name in ("x_4", "y_4", "z_4", "c_1_1", "s_1_1"))
d.check(
    "kernel-quadrilateral-names",
    equal(steps(quad_kernel, ["x_4", "y_4", "z_4"]), im([near[0], near[2], near[3]])),
    equal(
        steps(quad_kernel, ["x_41_1", "y_41_1"], keep=("x_4", "y_4", "z_4", "c_1_1", "s_1_1")),
        im(
            [
                x_4 * c_1 - y_4 * s_1,
                sp.cos(a[0]) * (x_4 * s_1 + y_4 * c_1) - sp.sin(a[0]) * z_4,
            ]
        ),
    ),
    text="X₄, Y₄, Z₄, and X₄₁ and Y₄₁, whose quotients are the sine and the cosine of θ₂.",
).prove()

# %%
check_row(
    quad_kernel, 4, [("z", 0), ("x", 3), ("z", ("c_1_1", "s_1_1")), ("x", 0), ("z", ("c_2_1", "s_2_1"))]
)

# %%
a, g = pent_kernel.port("alpha").symbols, pent_kernel.port("theta_45").symbols
check_triangle(pent_kernel, (a[0], a[1], 2 * half_b), ["x_45", "y_45", "z_45"])
far = chain_value([(sp.cos(x), sp.sin(x)) for x in (a[2], g[0], a[3], g[1], a[4])])
c_2, s_2 = (pent_kernel[name] for name in ("angle_c", "angle_s"))
bar = chain_value([(sp.cos(a[1]), sp.sin(a[1])), (c_2, s_2), (sp.cos(a[0]), sp.sin(a[0]))])
d.check(
    "kernel-pentagon-names",
    equal(steps(pent_kernel, ["x_45", "y_45", "z_45"]), im([far[0], far[2], far[3]])),
    equal(steps(pent_kernel, ["xb_2_1", "yb_2_1"], keep=("angle_c", "angle_s")), im([bar[0], bar[2]])),
    text="X₄₅, Y₄₅, Z₄₅, and X and Y of joint 2 with a bar.",
).prove()

# %%
keep = ("xb_2_1", "yb_2_1", "x_45", "y_45", "flat_1_1")
to_names = pent_kernel.substitution(xb_2_1=bar_x, yb_2_1=bar_y, x_45=X45, y_45=Y45)
d.check(
    "kernel-pentagon-theta-1",
    equal(
        last_case(steps(pent_kernel, ["cosine_1_1", "sine_1_1"], keep=keep)).xreplace(to_names),
        im([linear[c1] * square, linear[s1] * square]),
    ),
    text="Cosine and sine of θ₁, times a positive number.",
).prove()

# %%
check_row(
    pent_kernel,
    6,
    [
        ("z", 0),
        ("x", 3),
        ("z", 1),
        ("x", 4),
        ("z", ("c_1_1", "s_1_1")),
        ("x", 0),
        ("z", ("angle_c", "angle_s")),
    ],
)

# %%
derivation.kernel(*kernels, quad_kernel, pent_kernel)
derivation.kernels
