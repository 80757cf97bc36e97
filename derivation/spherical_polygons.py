# %% [markdown]
# # Spherical polygons: direction cosines, X-Y-Z notation, and the laws of triangle to heptagon
#
# A closed loop of links and joints has a spherical image: all joint axes $\vec S_j$ are moved to one point, the twists
# $\alpha_{ij}$ and the joint angles $\theta_j$ stay. It is a polygon of great circles with the sides $\alpha_{ij}$
# and the outer angles $\theta_j$, and closed it says that
#
# $$ R_z(\theta_1)R_x(\alpha_{12})R_z(\theta_2)R_x(\alpha_{23})\cdots R_z(\theta_n)R_x(\alpha_{n1})=I. $$
#
# What follows from that for the angles? Everything below is read off this product:
#
# 1. the direction cosines of axes and links, which have the short names $X$, $Y$, $Z$ and $U$, $V$, $W$ with
# subscripts; 2. the laws: which of these names are equal on every closed polygon of three to seven sides;
# 3. the same laws for lines in space: with dual angles $\theta+\varepsilon S$ and $\alpha+\varepsilon a$, where
#    $\varepsilon^2=0$, they hold as they are, and their dual parts are the secondary laws;
# 4. how a quadrilateral and a pentagon are closed in numbers.
#
# The lecture notes "Robot Geometry", after Crane and Duffy, "Kinematic Analysis of Robot Manipulators", print the
# definitions and some examples; the tables of laws, which they only announce, are generated here, and each law is
# proved.

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

d = derivation = Derivation(
    "spherical_polygons",
    title="Spherical polygons: X-Y-Z notation and the laws of triangle to heptagon",
    source='Lecture notes "Robot Geometry" after Crane and Duffy, "Kinematic Analysis of Robot Manipulators"',
)
im = sp.ImmutableMatrix
x_axis, y_axis, z_axis = (im(sp.eye(3)[:, n]) for n in range(3))


def Rx(angle):
    return im(rot("x", angle))


def Rz(angle):
    return im(rot("z", angle))


# %% [markdown]
# ## Symbols
#
# The twist $\alpha_{ij}$ turns about the link's direction $\vec a_{ij}$ from $\vec S_i$ to $\vec S_j$; the joint angle
# $\theta_j$ turns about $\vec S_j$ from $\vec a_{ij}$ to $\vec a_{jk}$. $R_x$ and $R_z$ are rotations about $x$ and
# $z$, $\vec e_x,\vec e_y,\vec e_z$ the unit vectors. In formulas with names, $s$ and $c$ are sine and cosine, with the
# subscripts of their angle: $s_{12}=\sin\alpha_{12}$, $c_2=\cos\theta_2$. In a recursion, joint $b$ is the next one and
# $\alpha_{b,b\to1}$ the twist after it; $X_a$, $Y_a$, $Z_a$ are the names with the subscripts so far.

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


e_x, e_y, e_z = (
    d.letter(rf"e_{n} | \vec e_{n} | unit vector along {n} | 1", axis)
    for n, axis in zip("xyz", (x_axis, y_axis, z_axis), strict=True)
)
RX = {
    i: d.letter(
        rf"R_x_{i} | R_x(\alpha_{{{i}{i % 7 + 1}}}) | rotation about x by the twist {i}{i % 7 + 1} | 1",
        Rx(alpha[i]),
    )
    for i in (1, 2, 3, 7)
}
RZ = {
    j: d.letter(rf"R_z_{j} | R_z(\theta_{j}) | rotation about z by θ{j} | 1", Rz(theta[j]))
    for j in (1, 2, 3, 7)
}
RXe = d.letter(r"R_x_e | R_x(\alpha_{b,b\to1}) | rotation about x by the twist of a step | 1", Rx(alpha_e))
RZb = d.letter(r"R_z_b | R_z(\theta_b) | rotation about z by the angle of a step | 1", Rz(theta_b))
d

# %% [markdown]
# ## Direction cosines of the joint axes, and single subscripts
#
# Everything is seen in the frame with $x=\vec a_{12}$ and $z=\vec S_1$. An axis $\vec S_j$ is the third column of the
# product of all rotations from this frame to the one with $z=\vec S_j$.

# %%
d.state(
    "S1-S2-S3",
    equal(RX[1] * e_z, im([0, -s12, c12])),
    equal(
        RX[1] * RZ[2] * RX[2] * e_z,
        im([s23 * s2, -(s12 * c23 + c12 * s23 * c2), c12 * c23 - s12 * s23 * c2]),
    ),
    place="Find 1S2, Find 1S3",
    text="The second and the third axis, $\\vec S_2$ and $\\vec S_3$. The first is $\\vec e_z$.",
).prove()

# %% [markdown]
# The components of the third axis are called $\bar X_2$, $\bar Y_2$ and $\bar Z_2$. The names without a bar have the
# two twists exchanged:
# $$\bar X_j=s_{jk}s_j,\qquad\bar Y_j=-(s_{ij}c_{jk}+c_{ij}s_{jk}c_j),\qquad\bar Z_j=c_{ij}c_{jk}-s_{ij}s_{jk}c_j .$$

# %%
bar_names = [
    d.letter(rf"{n}bar_2_value | \bar{{{n}}}_2 | {n} of joint 2 with a bar | 1", term(n, "2", bar=True))
    for n in "XYZ"
]
bare_names = [d.letter(f"{n}_2_value | {n}_2 | {n} of joint 2 | 1", term(n, "2")) for n in "XYZ"]
d.state(
    "single-bar",
    equal(RX[1] * RZ[2] * RX[2] * e_z, im(bar_names)),
    equal(im(bar_names), im([s23 * s2, -(s12 * c23 + c12 * s23 * c2), c12 * c23 - s12 * s23 * c2])),
    place="Single Subscript Notation",
    text="With a bar: the third axis, seen from the first link.",
).prove()

# %%
d.state(
    "single",
    equal(im(bare_names), im([s12 * s2, -(s23 * c12 + c23 * s12 * c2), c23 * c12 - s23 * s12 * c2])),
    place="Single Subscript Notation",
    text="Without a bar: the two twists are exchanged.",
).prove()

# %% [markdown]
# What are the names without a bar? Going back along the chain turns by the opposite angles. With the mirror
# $D=\operatorname{diag}(1,-1,1)$ that is the same as going on.

# %%
mirror = sp.diag(1, -1, 1)
mirror_letter = d.letter("D | D | mirror in y, diag(1, −1, 1) | 1", im(mirror))
d.check(
    "mirror",
    equal(mirror_letter * RXe * mirror_letter, RXe.T),
    equal(mirror_letter * RZb * mirror_letter, RZb.T),
    equal(mirror_letter * RX[2].T * RZ[2].T * RX[1].T * e_z, im(bare_names)),
    text="$X_2$, $Y_2$, $Z_2$ are the first axis, seen from the link after joint 2, mirrored in $y$. So rising "
    "subscripts are the way back, mirrored.",
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
star_b = d.letter("X_star_ab | X^*_{ab} | X* with one more joint | 1", star)
d.state(
    "step",
    equal(
        RXe * RZb * im([Xa, Ya, Za]),
        im(
            [
                Xa * sp.cos(theta_b) - Ya * sp.sin(theta_b),
                sp.cos(alpha_e) * star_b - sp.sin(alpha_e) * Za,
                sp.sin(alpha_e) * star_b + sp.cos(alpha_e) * Za,
            ]
        ),
    ),
    equal(star_b, Xa * sp.sin(theta_b) + Ya * sp.cos(theta_b)),
    place="Multi-Subscript Notation",
    text="$X_{ab}$, $Y_{ab}$ and $Z_{ab}$, on the right, from $X_a$, $Y_a$ and $Z_a$.",
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
    marks = " with a bar" if name.bar else " with a star" if name.star else ""
    return d.symbol(
        code,
        name.latex(),
        f"{letter}, subscripts {subscripts}{marks}",
        "1",
        value=name.value(cosines_and_sines),
    )


rows_of_axes = {j: [named(letter, falling[j], bar=j == 3) for letter in "XYZ"] for j in range(3, 8)}
axes = {
    j: d.vector(f"axis_{j}", rf"\vec S_{j}", f"axis of joint {j}", "1", value=columns[j] * z_axis)
    for j in range(3, 8)
}
d.check(
    "axes",
    *(equal(axes[j], im(rows_of_axes[j])) for j in range(3, 8)),
    text="The axes of loops of three to seven joints by their names. The names are those that the step builds up.",
).prove()

# %% [markdown]
# When are there bars? The notes give a rule by the size of the two subscripts. It fails where the loop is closed from
# 7 to 1. The example is the component of the second axis along link 67.

# %%
along = d.letter(
    r"along_67 | \vec a_{67}\cdot\vec S_2 | component of the second axis along link 67 | 1",
    x_axis.dot(Rz(theta[7]) * Rx(alpha[7]) * Rz(theta[1]) * Rx(alpha[1]) * z_axis),
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
    text="That component is $X_{17}$, as 7 follows on 1 when the joints are counted down. Were $i<j$ the rule, it "
    "would begin with the $X_1$ that has no bar.",
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
    text="$X_{17}$ falls and begins with a bar, $X_{71}$ rises and begins without.",
).prove()

# %% [markdown]
# ## Direction cosines of the links, and U-V-W
#
# The direction of a link, $\vec a_{j,j+1}$, is the first column of the same product without its last factor. Its
# components are called $U$, $V$ and $W$. They are $X$, $Y$ and $Z$ with twists and joint angles exchanged:
# $U_{12}=s_1s_{12}$ and so on. In a row of subscripts $U$ and $U^*$ do without the last joint's angle.

# %%
polar_names = [
    d.letter(f"{n}_12_value | {n}_{{12}} | {n} of the joints 1 and 2 | 1", term(n, "12")) for n in "UVW"
]
exchanged = {alpha[7]: theta[1], theta[1]: alpha[1], alpha[1]: theta[2]}
d.check(
    "polar-single",
    equal(
        im(polar_names),
        im(
            [
                sp.sin(theta[1]) * s12,
                -(s2 * sp.cos(theta[1]) + c2 * sp.sin(theta[1]) * c12),
                c2 * sp.cos(theta[1]) - s2 * sp.sin(theta[1]) * c12,
            ]
        ),
    ),
    equal(
        im(polar_names),
        im(
            [
                d.letter(
                    rf"{n}_1_exchanged | {n}_1|_{{\alpha\leftrightarrow\theta}} | {n} of joint 1, angles exchanged | 1",
                    term(n, "1").subs(exchanged, simultaneous=True),
                )
                for n in "XYZ"
            ]
        ),
    ),
    text="$U$, $V$, $W$ of two joints are $X$, $Y$, $Z$ of one joint with $\\alpha_{71}$, $\\theta_1$, $\\alpha_{12}$ "
    "replaced by $\\theta_1$, $\\alpha_{12}$, $\\theta_2$.",
).prove()

# %%
Ua, Va, Wa = (d.symbol(f"{n}_a", f"{n}_a", "of all subscripts but the last", "1") for n in "UVW")
U_star = d.letter(
    "U_star_ab | (U_as+V_ac) | U_a sin α + V_a cos α of a step | 1",
    Ua * sp.sin(alpha_e) + Va * sp.cos(alpha_e),
)
d.check(
    "polar-step",
    equal(
        im([[Wa, Va, Ua]]) * RXe * RZb,
        im(
            [
                [
                    sp.sin(theta_b) * U_star + sp.cos(theta_b) * Wa,
                    sp.cos(theta_b) * U_star - sp.sin(theta_b) * Wa,
                    Ua * sp.cos(alpha_e) - Va * sp.sin(alpha_e),
                ]
            ]
        ),
    ),
    text="The same step with twist and joint angle exchanged takes the row $(W,V,U)$ one link and one joint on.",
).prove()

# %%
links = {
    j: d.letter(
        rf"link_{j}{j + 1}[3] | \vec a_{{{j}{j + 1}}} | direction of link {j}{j + 1} | 1",
        (columns[j] if j > 2 else Rx(alpha[1])) * Rz(theta[j]) * x_axis,
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
    text="The links are $(W,-U^*,U)$; link 23 has $\\cos\\theta_2$ in place of $W$.",
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
# others. Each name is, up to sign, an entry $\vec e_r^TP\,\vec e_c$ of a product $P$, and so is each right side of a
# law. So two names are equal when these three rules lead both to one entry:
#
# - a rotation leaves its own axis: $R_x\vec e_x=\vec e_x$ and $R_z\vec e_z=\vec e_z$, so factors at the ends drop out;
# - $P=Q^T$ for the product $Q$ of the rest of the loop;
# - an entry of $P^T$ is the entry of $P$ with row and column exchanged.

# %%
d.check(
    "own-axis",
    equal(RXe * e_x, e_x),
    equal(e_x.T * RXe, e_x.T),
    equal(RZb * e_z, e_z),
    equal(e_z.T * RZb, e_z.T),
    equal(
        d.letter(r"R_x_minus | R_x(-\alpha_{b,b\to1}) | rotation by the opposite twist | 1", Rx(-alpha_e)),
        RXe.T,
    ),
    equal(RXe.T * RXe, im(sp.eye(3))),
    equal(RZb.T * RZb, im(sp.eye(3))),
    text="What the three rules need of the factors: they leave their own axes, and their transposes are their "
    "inverses.",
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
    text="Names of all kinds, rising, falling and around the end of the loop, and the entries that the rules take them "
    "for. Longer names are so by the steps above.",
).prove(
    im([name.value(cosines_and_sines) - product_entry(name.entry()) for name in short]),
    because="Written out, both sides are identical.",
)

# %%
sa, ca, sb, cb = sp.sin(alpha_e), sp.cos(alpha_e), sp.sin(theta_b), sp.cos(theta_b)
d.check(
    "right-sides",
    equal(e_z.T * RXe * RZb, im([[sa * sb, sa * cb, ca]])),
    equal(e_y.T * RXe * RZb * e_x, im([ca * sb])),
    equal(RZb * RXe * e_z, im([sa * sb, -sa * cb, ca])),
    equal(e_x.T * RZb * RXe * e_y, im([-ca * sb])),
    equal(e_x.T * RZb * e_x, im([cb])),
    text="The right sides of the laws, products of a sine or a cosine of a twist and of the adjacent joint angle, are "
    "entries as well.",
).prove()


# %%
def formal(entry: Entry):
    """The symbol of an entry's shortest form: equal entries are one symbol, and products are not expanded."""
    shortest = entry.canonical()
    left, right = (rf"\vec e_{'xyz'[k]}" for k in (shortest.row, shortest.column))
    factors = []
    for k in range(shortest.start, shortest.start + shortest.length):
        number = k // 2 % shortest.n + 1
        angle = rf"x(\alpha_{{{number}{number % shortest.n + 1}}})" if k % 2 else rf"z(\theta_{{{number}}})"
        factors.append(f"R_{angle}")
    return shortest.sign * sp.Symbol(rf"{left}^T\,{''.join(factors)}\,{right}", real=True)


def law_claims(n, family):
    """The family's laws with the subscripts 1 to n, as they are typeset; the proof takes all shifts."""
    return [
        equal(written(law.left), law.sign * written(law.right))
        for law in laws(n, shifts=False)
        if law.family == family and isinstance(law, Law)
    ]


def law_residuals(n, family):
    return [
        equal(formal(law.left.entry()), law.sign * formal(law.right.entry()))
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
                because="By the three rules, both sides of each law, and of its shifts, lead to one entry of a product "
                "of rotations.",
            )

# %% [markdown]
# The tables. *Fundamental* laws have all joints but one on the left, and the sine law, the sine-cosine law and the
# cosine law of the last on the right; *subsidiary* laws divide the joints between both sides; *polar* laws are the
# same with twists and joint angles exchanged.

# %%
d.page(
    "fundamental-3",
    "polar-3",
    "fundamental-4",
    "subsidiary-4",
    "polar-4",
    "polar-subsidiary-4",
    "fundamental-5",
    "subsidiary-5",
    "polar-5",
    "polar-subsidiary-5",
    "fundamental-6",
    "subsidiary-6",
    "polar-6",
    "polar-subsidiary-6",
    "fundamental-7",
    "subsidiary-7",
    "polar-7",
    "polar-subsidiary-7",
)

# %% [markdown]
# ### Half-tangent laws
#
# A sine law and a sine-cosine law together, $X=s\,s_j$ and $Y=s\,c_j$ with the sine $s$ of a twist, give the tangent
# $x_j$ of half of $\theta_j$ without a root.

# %%
assert all(law.holds() for n in POLYGONS for law in laws(n) if isinstance(law, HalfTangent))
x_j = d.symbol("x_j", "x_j", "tangent of half a joint angle", "1", value=sp.tan(theta_b / 2))
s_near = d.symbol("s_n", "s", "sine of a twist", "1")
half_given = {sb: 2 * x_j / (1 + x_j**2), cb: (1 - x_j**2) / (1 + x_j**2)}
half_x, half_y = (s_near * half_given[f] for f in (sb, cb))
X_law, Y_law = (
    d.letter("X_law | X | s sin θ by the half tangent | 1", half_x),
    d.letter("Y_law | Y | s cos θ by the half tangent | 1", half_y),
)
d.check(
    "half-tangent",
    equal(x_j, X_law / (Y_law + s_near)),
    equal(x_j, (s_near - Y_law) / X_law),
    text="With $\\sin\\theta_j=2x_j/(1+x_j^2)$ and $\\cos\\theta_j=(1-x_j^2)/(1+x_j^2)$ in $X=s\\sin\\theta_j$ and "
    "$Y=s\\cos\\theta_j$.",
    assumptions=[sp.Ne(s_near, 0)],
).prove(given={x_j: x_j})

# %% [markdown]
# ## The notes' example
#
# The notes print the fundamental laws of a triangle. (In this notation $\theta$ is the angle from link to link, so it
# is $\pi$ less the angle inside the triangle.)

# %%
triangle = {alpha[1]: sp.pi / 2, alpha[2]: sp.pi / 3, theta[2]: sp.pi / 2}
triangle |= {alpha_31: sp.pi / 2, theta[1]: 2 * sp.pi / 3, theta[3]: sp.pi / 2}
loop = d.letter(
    r"loop[3,3] | R_z(\theta_1) R_x(\alpha_{12}) R_z(\theta_2) R_x(\alpha_{23}) R_z(\theta_3) R_x(\alpha_{31}) | "
    r"product of all rotations of a triangle | 1",
    Rz(theta[1]) * Rx(alpha[1]) * Rz(theta[2]) * Rx(alpha[2]) * Rz(theta[3]) * Rx(alpha_31),
)
closed = equal(loop, im(sp.eye(3)))
c31, s31, c1, s1 = sp.cos(alpha_31), sp.sin(alpha_31), sp.cos(theta[1]), sp.sin(theta[1])
Xb2, Yb2, Zb2 = rows_of_axes[3]
d.state(
    "triangle-X",
    equal(Xb2, s31 * s1),
    equal(Zb2, c31),
    text="The laws of $\\bar X_2$ and $\\bar Z_2$ of a closed triangle.",
    place="Spherical Mechanism Equation Toolkit",
    assumptions=[closed],
).prove(d.entries["fundamental-3"], because="They are the first and the third fundamental law.")

# %%
d.state(
    "triangle-Y",
    equal(Yb2, sp.sin(alpha[2]) * c1),
    place="Spherical Mechanism Equation Toolkit",
    text="The law of $\\bar Y_2$. The notes print $s_{32}$, which is $s_{23}$.",
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


parts_of = {
    name: d.letter(
        rf"{code}_{kind} | \operatorname{{{tex}}}\bigl[{latex}\bigr] | {kind} part of {quantity} | 1, length",
        value,
    )
    for code, quantity, latex, dual in (
        ("dual_x", "the rotation by a dual twist", r"R_x(\hat\alpha)", dual_rotation_x(Dual(alpha_e, a_e))),
        (
            "dual_z",
            "the rotation by a dual joint angle",
            r"R_z(\hat\theta)",
            dual_rotation_z(Dual(theta_b, S_b)),
        ),
    )
    for kind, tex, value in (("primary", "P", im(dual.primary)), ("dual", "D", im(dual.secondary)))
    for name in [(code, kind)]
}
d.check(
    "dual-link-and-joint",
    equal(parts_of["dual_x", "primary"], RXe),
    equal(parts_of["dual_x", "dual"], a_e * (skew(e_x) * RXe)),
    equal(parts_of["dual_z", "primary"], RZb),
    equal(parts_of["dual_z", "dual"], S_b * (skew(e_z) * RZb)),
    text="Links and joints are rotations by the dual angles $\\hat\\alpha=\\alpha_{b,b\\to1}+\\varepsilon "
    "a_{b,b\\to1}$ and $\\hat\\theta=\\theta_b+\\varepsilon S_b$. $\\operatorname{P}$ and $\\operatorname{D}$ are the "
    "primary part and the dual part; those of a motion with the rotation $R$ and the shift $\\vec p$ are $R$ and "
    "$[\\vec p]_\\times R$.",
).prove(
    *both_parts(dual_rotation_x(Dual(alpha_e, a_e)), dual_matrix(Rx(alpha_e), a_e * x_axis)),
    *both_parts(dual_rotation_z(Dual(theta_b, S_b)), dual_matrix(Rz(theta_b), S_b * z_axis)),
    equal(parts_of["dual_x", "dual"], a_e * (skew(e_x) * RXe)),
    equal(parts_of["dual_z", "dual"], S_b * (skew(e_z) * RZb)),
    because="Rotations by dual angles, written out with the rules of dual numbers, are the dual matrices of the "
    "motions.",
)

# %%
turned = d.matrix("R", "R", "any rotation", "1", value=R)
d.check(
    "dual-product",
    equal(turned * skew(shift), skew(turned * shift) * turned),
    text="A turned cross product. So $(R+\\varepsilon[\\vec p]_\\times R)(Q+\\varepsilon[\\vec q]_\\times "
    "Q)=RQ+\\varepsilon[\\vec p+R\\vec q]_\\times RQ$: the product of dual matrices is that of the two motions, one "
    "after the other.",
).prove()

# %%
squares_of = {
    key: d.letter(
        rf"{code}_square_{kind} | \operatorname{{{tex}}}\bigl[{latex}^T{latex}\bigr] | "
        rf"{kind} part of the square | 1, length",
        im(value),
    )
    for code, latex, dual in (
        ("dual_x", r"R_x(\hat\alpha)", dual_rotation_x(Dual(alpha_e, a_e))),
        ("dual_z", r"R_z(\hat\theta)", dual_rotation_z(Dual(theta_b, S_b))),
    )
    for kind, tex, value in (
        ("primary", "P", (dual.T * dual).primary),
        ("dual", "D", (dual.T * dual).secondary),
    )
    for key in [(code, kind)]
}
d.check(
    "dual-orthogonal",
    *(equal(squares_of[code, "primary"], im(sp.eye(3))) for code in ("dual_x", "dual_z")),
    *(equal(squares_of[code, "dual"], im(sp.zeros(3))) for code in ("dual_x", "dual_z")),
    equal(parts_of["dual_x", "dual"] * e_x, im([0, 0, 0])),
    equal(parts_of["dual_z", "dual"] * e_z, im([0, 0, 0])),
    text="Dual matrices of motions have the transpose as inverse, and leave their own axes. So the three rules hold "
    "for them.",
).prove()

# %% [markdown]
# The secondary names are the dual parts of the names, written with the index 0. By the rules of dual numbers, for one
# joint and for the step to the next:

# %%
first = [Dual(alpha[1], a_12), Dual(theta[2], S_2), Dual(alpha[2], a_23)]
dual_names = chain_value([(angle.cos(), angle.sin()) for angle in first])
X2, Y2, Z2 = names("XYZ", "2")
X02, Y02, Z02 = (
    d.letter(f"{n}0_2 | {n}_{{02}} | dual part of {n} of joint 2 | length", value.secondary)
    for n, value in zip("XYZ", (dual_names[0], dual_names[2], dual_names[3]), strict=True)
)
X2, Y2, Z2 = bare_names
d.check(
    "secondary-single",
    equal(X02, a_12 * c12 * s2 + S_2 * s12 * c2),
    equal(Y02, a_12 * (s23 * s12 - c23 * c12 * c2) - a_23 * Z2 + S_2 * c23 * X2),
    equal(Z02, a_12 * Yb2 + a_23 * Y2 + S_2 * s23 * X2),
    text="$X_{02}$, $Y_{02}$ and $Z_{02}$ of one joint.",
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
step_names = [
    d.letter(f"{n}_ab | {n}_{{ab}} | {n} with one more joint | 1", value)
    for n, value in zip("XYZ", step, strict=True)
]
stepped = [
    d.letter(f"{name} | {latex} | dual part of {quantity} with one more joint | length", value)
    for name, latex, quantity, value in (
        ("X0_ab", "X_{0ab}", "X", (dual_X * cosine_b - dual_Y * sine_b).secondary),
        ("Xstar0_ab", "X^*_{0ab}", "X*", dual_star.secondary),
        ("Y0_ab", "Y_{0ab}", "Y", (dual_star * cosine_e - dual_Z * sine_e).secondary),
        ("Z0_ab", "Z_{0ab}", "Z", (dual_star * sine_e + dual_Z * cosine_e).secondary),
    )
]
d.check(
    "secondary-step",
    equal(stepped[0], X0a * cb - Y0a * sb - S_b * star_b),
    equal(stepped[1], X0a * sb + Y0a * cb + S_b * step_names[0]),
    equal(stepped[2], ca * stepped[1] - sa * Z0a - a_e * step_names[2]),
    equal(stepped[3], sa * stepped[1] + ca * Z0a + a_e * step_names[1]),
    text="One more joint and link. The offset $S_b$ and the length $a_{b,b\\to1}$ come with the other component of "
    "what is turned, as in the derivative of a rotation.",
).prove()

# %%
s_n1, c_n1 = Dual(alpha_e, a_e).sin(), Dual(alpha_e, a_e).cos()
d.check(
    "secondary-right-sides",
    *(
        equal(
            d.letter(
                rf"{name} | \operatorname{{D}}\bigl[{latex}\bigr] | dual part of {quantity} | length",
                value.secondary,
            ),
            formula,
        )
        for name, latex, quantity, value, formula in (
            (
                "D_ss",
                r"\sin\hat\alpha\,\sin\hat\theta",
                "a sine law",
                s_n1 * sine_b,
                a_e * ca * sb + S_b * sa * cb,
            ),
            (
                "D_sc",
                r"\sin\hat\alpha\,\cos\hat\theta",
                "a sine-cosine law",
                s_n1 * cosine_b,
                a_e * ca * cb - S_b * sa * sb,
            ),
            ("D_c", r"\cos\hat\alpha", "a cosine law", c_n1, -a_e * sa),
        )
    ),
    text="The right sides of the secondary sine, sine-cosine and cosine laws. The last is free of offsets: the "
    "secondary cosine law is $Z_0=-a\\,s$.",
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
    S, c_turn, s_turn = (sp.Symbol(f"{name}_{{{j}}}", real=True) for name in "Scs")
    return equal(
        left, a * c * s_turn + S * s * c_turn if law.kind == "sine" else a * c * c_turn - S * s * s_turn
    )


for n, polygon in POLYGONS.items():
    d.check(
        f"secondary-{n}",
        *(secondary_claims(law) for law in laws(n, shifts=False) if law.family == "fundamental"),
        text=f"Secondary sine, sine-cosine and cosine laws of loops with the {polygon} as spherical image. "
        f"$S_j$ are the "
        "offsets, $a_{ij}$ the lengths.",
        assumptions=["the loop is closed"],
    ).prove(
        d.entries[f"fundamental-{n}"],
        d.entries["dual-product"],
        d.entries["dual-orthogonal"],
        d.entries["secondary-right-sides"],
        because="The three rules hold for dual angles, so the fundamental laws do; these are their dual parts.",
    )

# %%
d.page("secondary-3", "secondary-4", "secondary-5", "secondary-6", "secondary-7")

# %% [markdown]
# ## Closing a quadrilateral
#
# The four twists and $\theta_4$ are given. The cosine law $Z_{41}=\cos\alpha_{23}$ is an equation
# $A\cos\theta_1+B\sin\theta_1+D=0$; then $\theta_2$ and $\theta_3$ follow from sines and cosines. The laws would give
# $\theta_3$ by $X_{14}$ and $Y_{14}$; the package takes it from the row $(W,V,U)_{412}$, which has a value where
# $\sin\alpha_{23}$ vanishes, too.

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


Z41_law, X4_law, Y4_law, Z4_law = (
    d.letter(
        f"{name}_{row}_of_4 | {name}_{{{row}}} | {name} of the joints {row} of a quadrilateral | 1",
        quad_term(name, row),
    )
    for name, row in (("Z", "41"), ("X", "4"), ("Y", "4"), ("Z", "4"))
)
d.check(
    "quadrilateral-theta-1",
    equal(Z41_law - c23, s12 * Y4_law * c1 + s12 * X4_law * s1 + c12 * Z4_law - c23),
    text="The cosine law as an equation in $\\theta_1$.",
).prove()

# %%
d.check(
    "last-angle",
    equal(
        e_x.T * (RX[2] * RZ[3] * RX[3]).T,
        im([[sp.cos(theta[3]), sp.sin(theta[3]) * c23, sp.sin(theta[3]) * s23]]),
    ),
    text="On a closed polygon the product of all factors except those of joint 3 and its two links is the transpose of "
    "those three. Its first row gives $\\theta_3$ without a division by $\\sin\\alpha_{23}$.",
).prove()

# %% [markdown]
# ## Closing a pentagon
#
# The five twists, $\theta_4$ and $\theta_5$ are given. $Z_{45}=\bar Z_2$ gives two $\theta_2$; then $\theta_1$ is
# determined by two equations that are linear in its sine and cosine, $X_{45}=X_{21}$ and $Y_{45}=-X^*_{21}$, and
# $\theta_3$ comes as before. Here $X_{21}=\bar X_2\cos\theta_1-\bar Y_2\sin\theta_1$ and
# $X^*_{21}=\bar X_2\sin\theta_1+\bar Y_2\cos\theta_1$.

# %%
X45, Y45 = (d.symbol(f"{n}_45", f"{n}_{{45}}", f"{n} of the joints 4 and 5", "1") for n in "XY")
bar_x, bar_y = sp.symbols("Xb_2 Yb_2", real=True)
square = bar_x**2 + bar_y**2
linear = {c1: (bar_x * X45 - bar_y * Y45) / square, s1: -(bar_y * X45 + bar_x * Y45) / square}
cos_1 = d.letter(r"cosine_theta_1 | \cos\theta_1 | cosine of θ₁ by the two equations | 1", linear[c1])
sin_1 = d.letter(r"sine_theta_1 | \sin\theta_1 | sine of θ₁ by the two equations | 1", linear[s1])
d.check(
    "pentagon-theta-1",
    equal(bar_x * cos_1 - bar_y * sin_1, X45),
    equal(bar_x * sin_1 + bar_y * cos_1, -Y45),
    text="The solution of the two linear equations: $\\cos\\theta_1=(\\bar X_2X_{45}-\\bar Y_2Y_{45})/(\\bar "
    "X_2^2+\\bar Y_2^2)$ and $\\sin\\theta_1=-(\\bar Y_2X_{45}+\\bar X_2Y_{45})/(\\bar X_2^2+\\bar Y_2^2)$.",
    assumptions=[sp.Ne(square, 0)],
).prove(given={bar_x: bar_x, bar_y: bar_y})

# %% [markdown]
# ## An angle of a triangle from its sides
#
# Both ways begin with a cosine law, which is that of a spherical triangle. In the quadrilateral let $\beta$ be the
# angle between $\vec S_1$ and $\vec S_3$, and $(X_4,Y_4,Z_4)=(\sin\beta\sin\gamma,\ \sin\beta\cos\gamma,\
# \cos\beta)$. Then $\cos(\theta_1-\gamma)=(\cos\alpha_{23}-\cos\alpha_{12}\cos\beta)/(\sin\alpha_{12}\sin\beta)$: a
# triangle with the sides $\alpha_{12}$, $\beta$ and $\alpha_{23}$. Where $\alpha_{23}$ is small or near $\pi$ its
# cosine hardly changes, and the difference loses the digits that $\theta_1$ needs: at $\alpha_{23}=2\cdot10^{-5}$ the
# polygon stayed open by $4\cdot10^{-12}$. Differences of cosines, written as products of sines of half sums, keep all
# digits.
#
# Let $u$, $v$ and $w$ be the sides of a triangle, $w$ opposite to the angle that is sought, and
# $P=\cos(u-v)-\cos w$, $Q=\cos w-\cos(u+v)$.

# %%
u = d.letter("u | u | side of a spherical triangle | rad")
v = d.letter("v | v | side of a spherical triangle | rad")
w = d.letter("w | w | side opposite to the angle sought in a spherical triangle | rad")
P, Q = d.symbol("P", "P", "cos(u - v) - cos w", "1"), d.symbol("Q", "Q", "cos w - cos(u + v)", "1")
root = d.symbol("root", r"\sqrt{PQ}", "root of P Q", "1")
differences = {P: sp.cos(u - v) - sp.cos(w), Q: sp.cos(w) - sp.cos(u + v)}
d.check(
    "half-sums",
    equal(sp.cos(2 * u - 2 * v) - sp.cos(2 * w), 2 * sp.sin(w + u - v) * sp.sin(w - u + v)),
    equal(sp.cos(2 * w) - sp.cos(2 * u + 2 * v), 2 * sp.sin(u + v + w) * sp.sin(u + v - w)),
    text="$P$ and $Q$ as products of sines, here written for the sides $2u$, $2v$ and $2w$.",
).prove()

# %%
d.check(
    "triangle-angle",
    equal(sp.sin(u) * sp.sin(v) * (Q - P) / (P + Q), sp.cos(w) - sp.cos(u) * sp.cos(v)),
    equal(sp.sin(u) * sp.sin(v) * (P - Q) / (P + Q), sp.cos(u) * sp.cos(v) - sp.cos(w)),
    text="The cosine of the angle inside the triangle is $(Q-P)/(P+Q)$; that of the angle from side to side is its "
    "opposite. Multiplied by $\\sin u\\sin v$ they are the cosine law.",
    assumptions=[sp.Ne(sp.sin(u) * sp.sin(v), 0)],
).prove(given=differences)

# %%
d.check(
    "triangle-sine",
    equal(((Q - P) / (P + Q)) ** 2 + (2 * root / (P + Q)) ** 2, 1),
    text="Its sine is $\\pm2\\sqrt{PQ}/(P+Q)$. There are two angles where $P$ and $Q$ have the same sign, and one "
    "where one of them is zero.",
).prove(modulo={root: root**2 - P * Q})


# %% [markdown]
# ## The functions of the package
#
# `polygon_notation_k` evaluates the names with $k$ subscripts from their $2k+1$ angles, the twist at the near end
# first; `polygon_secondary_k` the dual parts as well. The other two close a quadrilateral and a pentagon, with a
# status.


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
        equal(
            d.letter(
                rf"notation_{count}_fn | \vec n^{{\,\mathrm{{fn}}}} | values of polygon_notation_{count} | 1",
                sp.Matrix(list(kernels[count - 1].expand("values"))),
            ),
            d.letter(
                rf"notation_{count} | \vec n | X, X*, Y, Z of {count} subscripts by the steps | 1",
                sp.Matrix(list(expected)),
            ),
        ),
        text=f"`polygon_notation_{count}` computes $\\vec n=(X,X^*,Y,Z)$ by the steps above.",
    ).prove()
    dual = kernels[count + 4]
    angles = [
        Dual(a, b) for a, b in zip(dual.port("angles").symbols, dual.port("lengths").symbols, strict=True)
    ]
    expected = chain_value([(angle.cos(), angle.sin()) for angle in angles])
    d.check(
        f"kernel-secondary-{count}",
        *(
            equal(
                d.letter(
                    rf"{port}_{count}_fn | \vec n_{index}^{{\,\mathrm{{fn}}}} | {port} of polygon_secondary_{count} | "
                    "1, length",
                    sp.Matrix(list(dual.expand(port))),
                ),
                d.letter(
                    rf"{port}_{count} | \vec n_{index} | the same by dual numbers, {count} subscripts | 1, length",
                    sp.Matrix([getattr(value, part) for value in expected]),
                ),
            )
            for port, part, index in (("values", "primary", "p"), ("secondary", "secondary", "d"))
        ),
        text=f"`polygon_secondary_{count}` computes primary part $\\vec n_p$ and dual part $\\vec n_d$ by the "
        f"steps above.",
    ).prove()  # fmt: skip
d.page("kernel-notation-1", "kernel-secondary-1")


# %% [markdown]
# The steps of the two functions that close polygons, one by one, where no axes coincide: the half sums of the sides,
# $P$, $Q$ and the angle of the triangle, the names, and the row that gives the last angle. "fn" marks what the function
# computes.

# %%
half_b = d.symbol("b", "b", "half the angle between two axes", "rad")


def steps(kernel, values, keep=()):
    """Named steps as a column, in the inputs and the steps that are kept."""
    kept = [kernel[name] for name in keep]
    column = [entry for value in values for entry in sp.Matrix([kernel.expand(kernel[value], keep=kept)])]
    return im([entry.xreplace(dict.fromkeys(entry.atoms(sp.atan2), 2 * half_b)) for entry in column])


def claimed(kernel, *rows):
    """Equations between what a function computes and what is wanted, both by name."""
    short = kernel.name.removeprefix("polygon_")
    for name, latex, quantity, found, wanted in rows:
        yield equal(
            d.letter(
                rf"{name}_{short}_fn | {{{latex}}}^\mathrm{{fn}} | {quantity}, by {kernel.name} | 1", found
            ),
            d.letter(f"{name}_{short} | {latex} | {quantity} | 1", wanted),
        )


def check_triangle(kernel, sides, far):
    """The half sums of the sides in the steps `far`, P and Q, and cosine and sine of the angle."""
    u, v, w = sides
    h, p, q = (kernel[name] for name in ("half_sums", "p", "q"))
    inside = 1 if kernel.name.endswith("quadrilateral") else -1
    d.check(
        f"kernel-{kernel.name.removeprefix('polygon_')}-triangle",
        *claimed(
            kernel,
            (
                "half_sums", r"\vec h", "half sums of the sides", steps(kernel, ["half_sums"], keep=far),
                im([w + u - v, w - u + v, u + v + w, u + v - w]) / 2,
            ),
            (
                # the usual case: nothing coincides, and no twist is negative
                "halves", r"\tfrac12(P,Q)", "half of P and of Q",
                last_case(steps(kernel, ["p_side", "q_side"], keep=["half_sums"])),
                im([sp.sin(h[0]) * sp.sin(h[1]), sp.sin(h[2]) * sp.sin(h[3])]),
            ),
            (
                "cosine", "c", "cosine of the angle",
                last_case(steps(kernel, ["angle_c"], keep=("p", "q", "any_angle")))[0], inside * (q - p) / (p + q),
            ),
            (
                "sine", "s", "sine of the angle",
                last_case(steps(kernel, ["angle_s"], keep=("p", "q", "any_angle")))[0],
                2 * sp.sqrt(abs(p * q)) / (p + q),
            ),
        ),
        text=f"`{kernel.name}` computes half sums of the sides, half of $P$ and of $Q$ as products of sines, "
        f"and cosine and "
        "sine of the angle from them.",
    ).prove()  # fmt: skip


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
        *claimed(
            kernel,
            ("row", r"\vec r", "first row of the product of the other rotations", row, im(product.T)),
            ("sine_3", r"\sin\theta_3", "sine of the last angle, from the row", found.xreplace(there), s3),
        ),
        text=f"The row $\\vec r$ of the other rotations that `{kernel.name}` computes, and the sine of "
        f"$\\theta_3$ from it.",
    ).prove()


quad_kernel, pent_kernel = quadrilateral(), pentagon()
a, (g,) = quad_kernel.port("alpha").symbols, quad_kernel.port("theta_4").symbols
check_triangle(quad_kernel, (a[0], 2 * half_b, a[1]), ["sine_13", "z_4"])
d.entries["kernel-quadrilateral-triangle"]

# %%
near = chain_value([(sp.cos(x), sp.sin(x)) for x in (a[2], g, a[3])])
x_4, y_4, z_4, c_1, s_1 = (quad_kernel[name] for name in ("x_4", "y_4", "z_4", "c_1_1", "s_1_1"))
d.check(
    "kernel-quadrilateral-names",
    *claimed(
        quad_kernel,
        (
            "names_4", "(X_4,Y_4,Z_4)", "names of joint 4", steps(quad_kernel, ["x_4", "y_4", "z_4"]),
            im([near[0], near[2], near[3]]),
        ),
        (
            "names_41", "(X_{41},Y_{41})", "names of the joints 4 and 1",
            steps(quad_kernel, ["x_41_1", "y_41_1"], keep=("x_4", "y_4", "z_4", "c_1_1", "s_1_1")),
            im([x_4 * c_1 - y_4 * s_1, sp.cos(a[0]) * (x_4 * s_1 + y_4 * c_1) - sp.sin(a[0]) * z_4]),
        ),
    ),
    text="The names of joint 4, and $X_{41}$ and $Y_{41}$, which are the sine and the cosine of $\\theta_2$ times "
    "$\\sin\\alpha_{23}$.",
).prove()  # fmt: skip

# %%
check_row(
    quad_kernel, 4, [("z", 0), ("x", 3), ("z", ("c_1_1", "s_1_1")), ("x", 0), ("z", ("c_2_1", "s_2_1"))]
)
d.entries["kernel-quadrilateral-row"]

# %%
a, g = pent_kernel.port("alpha").symbols, pent_kernel.port("theta_45").symbols
check_triangle(pent_kernel, (a[0], a[1], 2 * half_b), ["x_45", "y_45", "z_45"])
d.entries["kernel-pentagon-triangle"]

# %%
far = chain_value([(sp.cos(x), sp.sin(x)) for x in (a[2], g[0], a[3], g[1], a[4])])
c_2, s_2 = (pent_kernel[name] for name in ("angle_c", "angle_s"))
bar = chain_value([(sp.cos(a[1]), sp.sin(a[1])), (c_2, s_2), (sp.cos(a[0]), sp.sin(a[0]))])
d.check(
    "kernel-pentagon-names",
    *claimed(
        pent_kernel,
        (
            "names_45", "(X_{45},Y_{45},Z_{45})", "names of the joints 4 and 5",
            steps(pent_kernel, ["x_45", "y_45", "z_45"]), im([far[0], far[2], far[3]]),
        ),
        (
            "names_bar_2", r"(\bar X_2,\bar Y_2)", "names of joint 2 with a bar",
            steps(pent_kernel, ["xb_2_1", "yb_2_1"], keep=("angle_c", "angle_s")), im([bar[0], bar[2]]),
        ),
    ),
    text="The names of the joints 4 and 5, and those of joint 2 with a bar.",
).prove()  # fmt: skip

# %%
keep = ("xb_2_1", "yb_2_1", "x_45", "y_45", "flat_1_1")
to_names = pent_kernel.substitution(xb_2_1=bar_x, yb_2_1=bar_y, x_45=X45, y_45=Y45)
d.check(
    "kernel-pentagon-theta-1",
    *claimed(
        pent_kernel,
        (
            "theta_1", r"(\bar X_2^2+\bar Y_2^2)(\cos\theta_1,\sin\theta_1)",
            "cosine and sine of θ₁, times a positive number",
            last_case(steps(pent_kernel, ["cosine_1_1", "sine_1_1"], keep=keep)).xreplace(to_names),
            im([linear[c1] * square, linear[s1] * square]),
        ),
    ),
    text="Cosine and sine of $\\theta_1$ come with the positive factor $\\bar X_2^2+\\bar Y_2^2$, which `atan2` does "
    "not need to know.",
).prove(given={bar_x: bar_x, bar_y: bar_y})  # fmt: skip

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
d.entries["kernel-pentagon-row"]

# %%
derivation.kernel(*kernels, quad_kernel, pent_kernel)
