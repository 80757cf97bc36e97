# %% [markdown]
# # Instantaneous Euler angles: definition, and conversion from Euler angles
#
# A body turns from the axes $e_x, e_y, e_z$ to the axes $Re_x, Re_y, Re_z$. X. Zhou and J. Zhu ("A Decoupling Method
# for Successive Robot Rotation Based on Time Domain Instantaneous Euler Angle") describe its attitude by the angle
# between each coordinate plane and where the plane has gone. These are the *instantaneous Euler angles*, the angles
# between the normals of the planes:
#
# $$ \chi_i = \arccos(e_i, Re_i), \quad i = x, y, z, $$
#
# that is, the arccosines of the diagonal of the matrix $R$. The line in which a plane meets its image is the *ridge
# line*.
#
# This notebook goes through the paper's equations on the angles, (1), (6), (10), (13) and (16) to (20), and through
# the tables of sections 4.1 and 4.2. Each is proved, or refuted by an exact counterexample and corrected. **Result:**
# the definitions are right, and so are the angles of a Z-Y-X sequence. Wrong are an element of the matrix of Z-Y-Z
# (17), the labels x and z in (18) and (20), which are exchanged, six rows of the tables and some remarks; and three
# angles do not determine an attitude. At the end stand formulas that lose no digits near 0 and π, from which the
# functions are made.
#
# Four other notebooks continue: `instantaneous_euler_ridges` on the ridge lines, `instantaneous_euler_inverse` on
# which attitudes have given angles, `instantaneous_euler_motion` on rates, and `instantaneous_euler_arm` on section
# 5.2 and the figures. Minus signs are lost in the copy of the paper at hand. Where only a sign is in question, the
# right one is taken.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.rotations import matrix_from_quaternion, normalised, quaternion_products
from rodgen.symbolic import EPS, LARGEST, Derivation, Letter, equal, power_of_two_scale, rot, select

PAPER = (
    'Zhou and Zhu, "A Decoupling Method for Successive Robot Rotation Based on Time Domain Instantaneous Euler '
    'Angle", Mathematics 2023, 11(18), 3882'
)
d = derivation = Derivation(
    "instantaneous_euler", title="Instantaneous Euler angles from any Euler angles", source=PAPER
)
sin, cos, acos = sp.sin, sp.cos, sp.acos

# %% [markdown]
# ## Symbols
#
# A sequence such as Z-Y-X is intrinsic: the body turns first about its z axis, then about its y axis as the first
# rotation has left it ($y_1$), then about its x axis ($x_2$). $e_x,e_y,e_z$ are written $x_0,y_0,z_0$ where the paper
# does, and $Re_x,Re_y,Re_z$ are $x_3,y_3,z_3$. The paper writes the third Z-Y-Z angle $\varphi$ or $\phi'$; here it is
# $\varphi$, and φ′ in words.

# %%
alpha = d.symbol("alpha", r"\alpha", "first Z-Y-X angle, about z0", "rad")
beta = d.symbol("beta", r"\beta", "second Z-Y-X angle, about y1", "rad")
gamma = d.symbol("gamma", r"\gamma", "third Z-Y-X angle, about x2", "rad")
phi = d.symbol("phi", r"\phi", "first Z-Y-Z angle, about z0", "rad")
theta = d.symbol("theta", r"\theta", "second Z-Y-Z angle, about y1", "rad")
psi = d.symbol("psi", r"\varphi", "third Z-Y-Z angle, about z2", "rad")
R = d.matrix("r", r"R", "rotation; its columns are the moved axes", "1", value=Letter("r", 3, 3).components)
chi_x = d.symbol("chi_x", r"\chi_x", "angle between the yz planes", "rad", value=acos(R.components[0, 0]))
chi_y = d.symbol("chi_y", r"\chi_y", "angle between the xz planes", "rad", value=acos(R.components[1, 1]))
chi_z = d.symbol("chi_z", r"\chi_z", "angle between the xy planes", "rad", value=acos(R.components[2, 2]))
CHI = (chi_x, chi_y, chi_z)
UNIT = dict(zip("xyz", (sp.Matrix(sp.eye(3)[:, i]) for i in range(3)), strict=True))
d


# %%
def turns(sequence, angles):
    """Intrinsic rotations, each about an axis of the frame that the ones before have turned."""
    product = sp.eye(3)
    for axis, angle in zip(sequence, angles, strict=True):
        product = product * rot(axis, angle)
    return sp.ImmutableMatrix(product)


zyx = turns("zyx", (alpha, beta, gamma))
zyz = turns("zyz", (phi, theta, psi))
IN_RANGE = "an angle between 0 and π is known by its cosine"

# %% [markdown]
# ## The instants of equation (1)
#
# Equation (1) shows the states $\kappa$ of the body, from $\kappa(t_0)$ over three rotations, each of which takes its
# interval. The instants at which they end follow by addition.

# %%
t0 = d.symbol("t0", r"t_0", "instant of the start", "s")
D1, D2, D3 = (d.letter(rf"D{n}>0 | \Delta t_{{0{n}}} | interval of the rotation {n} | s") for n in (1, 2, 3))
t01 = d.symbol("t01", r"t_{01}", "end of the first rotation", "s", value=t0 + D1)
t02 = d.symbol("t02", r"t_{02}", "end of the second rotation", "s", value=t01 + D2)
t03 = d.symbol("t03", r"t_{03}", "end of the third rotation, t3 of the text", "s", value=t02 + D3)
t1 = d.letter("t1 | t_1 | the t1 of equation (1), nowhere defined: the first rotation's end | s", t01)
d.state(
    "eq-1-first",
    equal(t01, t0 + D1),
    place="eq. (1), the line under it",
    text="The first rotation ends one interval after the start.",
).prove(because="The definition of the interval.")

# %%
d.state(
    "eq-1-instants",
    equal(t02, t1 + D1 + D2),
    equal(t03, t1 + D1 + D2 + D3),
    place="eq. (1), the line under it",
    text="The ends of the second and third rotation.",
).refute(
    {t0: 0, D1: 1, D2: 1, D3: 1},
    [equal(t02, t0 + D1 + D2), equal(t03, t0 + D1 + D2 + D3)],
    label="Z1",
    because="Both sums start at t0; from the end of the first rotation they count its interval twice.",
)

# %%
end = d.symbol("t_end", r"t_{\mathrm{end}}", "instant of the final state", "s", value=t03)
d.state(
    "eq-1-final",
    equal(end, t1),
    place="eq. (1), its last state κ(t1)",
    text="The final state is written as that at t₁.",
).refute(
    {t0: 0, D1: 1, D2: 1, D3: 1},
    equal(end, t0 + D1 + D2 + D3),
    label="Z2",
    because="The final state is that at t3, as the text before the equation says.",
)

# %% [markdown]
# ## The matrix of Z-Y-X, and the three angles
#
# The rotation is the product of three rotations about coordinate axes, $R=R_z(\alpha)R_y(\beta)R_x(\gamma)$.


# %%
def matrix(*rows):
    return sp.ImmutableMatrix(rows)


sa, ca, sb, cb, sg, cg = (f(x) for x in (alpha, beta, gamma) for f in (sin, cos))
printed_zyx = matrix(
    (ca * cb, ca * sb * sg - sa * cg, ca * sb * cg + sa * sg),
    (sa * cb, sa * sb * sg + ca * cg, sa * sb * cg - ca * sg),
    (-sb, cb * sg, cb * cg),
)
by_zyx = {R: zyx}
by_zyz = {R: zyz}
d.state(
    "eq-6",
    equal(R, printed_zyx),
    text="The matrix of the Z-Y-X angles is the product of the three rotations.",
    place="eqs. (6) and (19)",
).prove(
    given=by_zyx,
    because="The product of the three matrices is carried out.",
)

# %% [markdown]
# The three angles are the arccosines of its diagonal:

# %%
for number, name, letter, printed in (
    (10, "z", chi_z, cb * cg),
    (13, "y", chi_y, sa * sb * sg + ca * cg),
    (16, "x", chi_x, ca * cb),
):
    d.state(
        f"eq-{number}",
        equal(letter, acos(printed)),
        text=f"The angle between the normals {name}0 and {name}3 of a plane and of its image.",
        place=f"eq. ({number})",
    ).prove(cos(letter) - printed, given=by_zyx, because=f"Their cosines are equal, and {IN_RANGE}.")
d.page("eq-10", "eq-13", "eq-16")

# %%
d.state(
    "arccosine-of-diagonal",
    equal(
        sp.ImmutableMatrix([cos(c) for c in CHI]), sp.ImmutableMatrix([R.components[i, i] for i in range(3)])
    ),
    said="for the Z-Y-X and Z-Y-Z Euler angles, the instantaneous Euler angle is the arccosine of the diagonal element",
    place="sec. 4.2",
).prove(
    because="So it is for every rotation: the cosine between a unit vector and its image is a diagonal element."
)

# %% [markdown]
# The same attitude has two triples of Z-Y-X angles, and one triple of instantaneous angles, as the paper says:

# %%
other = d.letter(
    r"other[3,3] | R_{zyx}(\alpha+\pi,\pi-\beta,\gamma+\pi) | rotation by other Z-Y-X angles | 1",
    turns("zyx", (alpha + sp.pi, sp.pi - beta, gamma + sp.pi)),
)
d.state(
    "euler-angles-not-unique",
    equal(R, other),
    said="if the final attitude of the rotation plane is specified, the Euler angles are not uniquely determined",
    place="sec. 4.2",
).prove(given=by_zyx, because="(α + π, π − β, γ + π) is the same rotation.")

# %% [markdown]
# The other way is not so. Up to eight attitudes have the same three instantaneous angles
# (`instantaneous_euler_inverse`): a rotation and its inverse $R^T$ have the same diagonal, and a half turn $F$ about a
# coordinate axis, applied before and after, changes only signs off the diagonal.

# %%
flips = [sp.diag(*signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
same_diagonal = [
    d.matrix(
        f"diagonal_{name}_{half_turn}",
        rf"\operatorname{{diag}}(F_{half_turn} {letter} F_{half_turn})",
        f"diagonal of {text}, between equal half turns about {half_turn}"
        if half_turn != "0"
        else f"diagonal of {text}",
        "1",
        value=sp.Matrix([(flip * M * flip)[i, i] for i in range(3)]),
        rows=3,
        columns=1,
    )
    for half_turn, flip in zip("0xyz", flips, strict=True)
    for name, letter, text, M in (("r", "R", "R", R.components), ("rt", "R^T", "the inverse", R.components.T))
]


def diagonal(M):
    return sp.ImmutableMatrix([M[i, i] for i in range(3)])


d.check(
    "same-diagonal",
    *(equal(diagonal_letter, diagonal(R.components)) for diagonal_letter in same_diagonal),
    text="A rotation, its inverse, and both between equal half turns about a coordinate axis have the same diagonal.",
).prove(because="A transpose keeps the diagonal, and an element r_ii is multiplied by the square of a sign.")

# %%
d.state(
    "describes-the-rotation",
    sp.Implies(sp.Eq(cos(alpha), cos(phi)), sp.Eq(sin(alpha), sin(phi))),
    said="they transform the three process variables into three status variables describing the rotation of the "
    "parallel mechanism at a particular moment in time",
    text="Two rotations about z0 with the same instantaneous angles would be the same rotation.",
    place="after eq. (16)",
).refute(
    {alpha: sp.pi / 3, phi: -sp.pi / 3},
    equal(diagonal(rot("z", phi)), diagonal(rot("z", -phi))),
    proof=[d.entries["same-diagonal"]],
    label="Z3",
    because="A rotation, its inverse, and both seen after a half turn about a coordinate axis have the same "
    "diagonal, and so the same three angles: these do not determine the attitude.",
)

# %% [markdown]
# ## Z-Y-Z: equations (17) and (18)
#
# For the sequence Z-Y-Z the rotation is $R=R_z(\phi)R_y(\theta)R_z(\varphi)$. The printed matrix has a wrong element,
# which (18) repeats; and (18) exchanges two of its lines.

# %%
sf, cf, st, ct, sp_, cp = (f(x) for x in (phi, theta, psi) for f in (sin, cos))
printed_zyz = matrix(
    (cf * ct * cp - sf * sp_, -cf * ct * sp_ - sf * cp, cf * st),
    (sf * ct * cp + cf * sp_, -sf * ct * sp_ + cf * sp_, sf * st),
    (-st * cp, st * sp_, ct),
)
right_zyz = matrix(
    printed_zyz.row(0), (printed_zyz[1, 0], -sf * ct * sp_ + cf * cp, sf * st), printed_zyz.row(2)
)
d.state("eq-17", equal(R, printed_zyz), text="The matrix of the Z-Y-Z angles.", place="eq. (17)").refute(
    {phi: 0, theta: 0, psi: 0},
    equal(R, right_zyz),
    given=by_zyz,
    label="Z4",
    because="In the middle of the matrix the last factor is cos φ, not sin φ: without any rotation the printed "
    "element is 0.",
)

# %%
d.state(
    "eq-18-y",
    equal(chi_y, acos(printed_zyz[1, 1])),
    place="eq. (18), second line",
    text="The angle between the xz planes for Z-Y-Z.",
).refute(
    {phi: 0, theta: 0, psi: 0},
    equal(cos(chi_y), right_zyz[1, 1]),
    given=by_zyz,
    label="Z5",
    because="The misprint of (17) is carried along: without any rotation the printed angle is a right one.",
)

# %%
swapped = (
    "x and z are exchanged, against the definitions (10) and (16): the angle between the {} planes is that between "
    "{}0 and {}3."
)
d.state(
    "eq-18-x",
    equal(chi_x, theta),
    place="eq. (18), first line",
    assumptions=[theta >= 0, theta <= sp.pi],
    text="The angle between the yz planes for Z-Y-Z.",
).refute(
    {phi: sp.pi / 2, theta: 0, psi: 0},
    equal(cos(chi_x), cf * ct * cp - sf * sp_),
    given=by_zyz,
    label="Z6",
    because=swapped.format("yz", "x", "x") + " A rotation about z0 alone turns the yz plane.",
)

# %%
d.state(
    "eq-18-z",
    equal(chi_z, acos(cf * ct * cp - sf * sp_)),
    place="eq. (18), third line",
    text="The angle between the xy planes for Z-Y-Z.",
).refute(
    {phi: sp.pi / 2, theta: 0, psi: 0},
    equal(cos(chi_z), ct),
    given=by_zyz,
    label="Z7",
    because=swapped.format("xy", "z", "z") + " A rotation about z0 alone leaves the xy plane where it is.",
)

# %%
d.state(
    "bare-theta",
    equal(chi_z, theta),
    text="With the labels put right.",
    place="eq. (18)",
    assumptions=[sp.Ne(theta, 0)],
).refute(
    {phi: 0, theta: -sp.pi / 3, psi: 0},
    equal(cos(chi_z), cos(theta)),
    given=by_zyz,
    label="Z8",
    because="An angle between planes is between 0 and π: every bare angle of (18) and of the tables denotes its "
    "absolute value, folded into that range, acos(cos θ). Section 5.2 has the absolute value.",
)

# %% [markdown]
# ## Z-Y-X again: equation (20)
#
# Equation (20) repeats the angles of Z-Y-X, now as $\chi_x,\chi_y,\chi_z$. Its first and third line are exchanged, too.

# %%
d.state(
    "eq-20-y",
    equal(chi_y, acos(sa * sb * sg + ca * cg)),
    place="eq. (20), second line",
    text="The angle between the xz planes for Z-Y-X.",
).prove(
    cos(chi_y) - (sa * sb * sg + ca * cg), given=by_zyx, because=f"Their cosines are equal, and {IN_RANGE}."
)

# %%
d.state(
    "eq-20",
    equal(chi_x, acos(cb * cg)),
    equal(chi_z, acos(ca * cb)),
    place="eq. (20), first and third line",
    text="The angles between the yz and between the xy planes for Z-Y-X.",
).refute(
    {alpha: sp.pi / 2, beta: 0, gamma: 0},
    [equal(cos(chi_x), ca * cb), equal(cos(chi_z), cb * cg)],
    given=by_zyx,
    label="Z9",
    because=swapped.format("yz", "x", "x") + " The tables of section 4.1 and section 5.2 have it right.",
)

# %% [markdown]
# ## The four typical sequences
#
# There are twelve sequences of axes. The paper calls four of them typical: those that begin with z. A cyclic exchange
# $C$ of the axes' names, x → y → z → x, is itself a rotation, and makes all twelve of them. $R_{zyx}$ is the rotation
# of the sequence z-y-x, and so on, each time by the angles $\alpha,\beta,\gamma$.

# %%
CYCLIC = sp.Matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""x → y → z → x."""
NEXT = {"x": "y", "y": "z", "z": "x"}
TYPICAL = ("zyx", "zxy", "zyz", "zxz")
angles = (alpha, beta, gamma)
cyclic = d.matrix("cyclic", "C", "rotation that renames the axes, x → y → z → x", "1", value=CYCLIC)


def of_sequence(name, angles, letter=""):
    """A letter for the rotation of a sequence."""
    return d.matrix(
        f"R_{name}{'_opposite' if letter else ''}",
        f"R_{{{name}}}{letter}",
        f"rotation of the sequence {'-'.join(name)}" + (" by the opposite angles" if letter else ""),
        "1",
        value=turns(name, angles),
    )


renamed = []
family = {}
rotation_of = {}
for sequence in TYPICAL:
    name, power = sequence, None
    for _ in range(3):
        family[name] = sequence
        rotation_of[name] = of_sequence(name, angles)
        if power is not None:
            renamed.append(equal(rotation_of[name], power * rotation_of[sequence] * power.T))
        name, power = "".join(NEXT[axis] for axis in name), cyclic if power is None else cyclic * cyclic
assert len(family) == 12
d.state(
    "four-typical",
    *renamed,
    said="basically only four are typical, namely, ZYX, ZXY, ZYZ, and ZXZ",
    place="sec. 4",
).prove(because="The other eight are these four with the axes' names exchanged cyclically, once or twice.")

# %% [markdown]
# For the instantaneous angles two sequences are enough. To exchange two names is a reflection $P$, and it changes the
# signs of all three angles of rotation. With it each sequence becomes Z-Y-X or Z-Y-Z. The instantaneous angles go along
# with their axes: diag $PRP^T$ is the diagonal of $R$ in another order. In the equations a minus marks opposite angles:
# $R_{zyx}^-$ is the rotation by $-\alpha,-\beta,-\gamma$.


# %%
def relabelling(sequence):
    """Return the names of x, y, z that make a sequence z-y-x or z-y-z, and the sign of the angles."""
    first, second, third = sequence
    rest = next(axis for axis in "xyz" if axis not in (first, second))
    names = {"z": first, "y": second, "x": rest}
    permutation = sp.Matrix.hstack(*(UNIT[names[axis]] for axis in "xyz"))
    return permutation, permutation.det(), "zyx" if third == rest else "zyz"


opposite = {like: of_sequence(like, [-angle for angle in angles], "^-") for like in ("zyx", "zyz")}
relabelled = []
for sequence in sorted(family):
    permutation, sign, like = relabelling(sequence)
    by_like = opposite[like] if sign < 0 else rotation_of[like]
    if sequence != like:
        P = sp.ImmutableMatrix(permutation)
        relabelled.append(equal(rotation_of[sequence], P * by_like * P.T))
d.check(
    "twelve-from-two",
    *relabelled,
    text="Each of the twelve is Z-Y-X or Z-Y-Z with other names of the axes and, where that is a reflection, "
    "opposite angles. Its diagonal, and with it the instantaneous angles, is the relabelled one.",
).prove(because="The elements of both sides agree, for each of the ten other sequences.")

# %% [markdown]
# ## The tables of section 4.1
#
# The tables list the instantaneous angles where only one or two of the three rotations take place. Section 4.1 is
# headed Z-Y-Z and takes its angles from (18), but its rows name α, β, γ, and are those of Z-Y-X in the order of the
# definitions. A bare angle denotes its folded absolute value, $\arccos\cos$ (erratum Z8).


# %%
def fold(angle):
    return acos(cos(angle))


TABLE_41 = {
    "alpha": ((alpha, 0, 0), (fold(alpha), fold(alpha), 0)),
    "beta": ((0, beta, 0), (fold(beta), 0, fold(beta))),
    "gamma": ((0, 0, gamma), (0, fold(gamma), fold(gamma))),
    "beta-gamma": ((0, beta, gamma), (fold(beta), fold(gamma), acos(cb * cg))),
    "alpha-beta": ((alpha, beta, 0), (acos(ca * cb), fold(alpha), fold(beta))),
    "alpha-gamma": ((alpha, 0, gamma), (fold(alpha), acos(ca * cg), fold(gamma))),
}
TABLE_42 = {
    "phi": ((phi, 0, 0), (fold(phi), 0, 0)),
    "theta": ((0, theta, 0), (fold(theta), 0, fold(theta))),
    "psi": ((0, 0, psi), (0, acos(sp_), fold(psi))),
    "theta-psi": ((0, theta, psi), (acos(st * cp), fold(psi), fold(theta))),
    "phi-theta": ((phi, theta, 0), (acos(cf * ct), fold(phi), fold(theta))),
    "phi-psi": ((phi, 0, psi), (acos(cf * cp), fold(phi + psi), 0)),
}


def claims(row):
    return [equal(letter, sp.sympify(value)) for letter, value in zip(CHI, row, strict=True)]


def cosines(row):
    return [equal(cos(letter), cos(value)) for letter, value in zip(CHI, row, strict=True)]


GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "phi": "ϕ", "theta": "θ", "psi": "φ"}


def written(angles):
    return "(" + ", ".join(GREEK.get(str(a), str(a)) for a in angles) + ")"


d.state(
    "table-4.1-heading",
    *claims((0, fold(gamma), fold(gamma))),
    text="The row (0, 0, γ), read as Z-Y-Z as the section's head says.",
    place="sec. 4.1, its head and “Through Equation (18)”",
).refute(
    {gamma: sp.pi / 3},
    cosines((gamma, gamma, 0)),
    given={R: turns("zyz", (0, 0, gamma))},
    label="Z10",
    because="The rows of section 4.1 are those of Z-Y-X, (19), and those of section 4.2 are meant as those of Z-Y-Z, "
    "(17): heads and tables are exchanged.",
)

# %%
for name, (given_angles, row) in TABLE_41.items():
    d.state(
        f"table-4.1-{name}",
        *claims(row),
        text=f"Z-Y-X angles {written(given_angles)}.",
        place="sec. 4.1, " + ("one-time" if name.count("-") == 0 else "two-time") + " rotation",
    ).prove(
        *cosines(row),
        given={R: turns("zyx", given_angles)},
        because=f"Their cosines are equal, and {IN_RANGE}.",
    )
d.page(*(f"table-4.1-{name}" for name in TABLE_41))

# %%
d.state(
    "table-4.1-three",
    *claims((theta, acos(printed_zyz[1, 1]), acos(cf * ct * cp - sf * sp_))),
    text="Z-Y-X angles (α, β, γ), by (18) with φ = α, θ = β, φ' = γ.",
    place="sec. 4.1, three-time rotation",
).refute(
    {alpha: sp.pi / 2, beta: 0, gamma: 0},
    [equal(cos(chi_x), ca * cb), equal(cos(chi_y), sa * sb * sg + ca * cg), equal(cos(chi_z), cb * cg)],
    given={R: zyx, phi: alpha, theta: beta, psi: gamma},
    label="Z11",
    because="Three rotations with the angles (α, β, γ) of this section are those of (20), with its labels put right.",
)

# %%
d.state(
    "parallel-planes-4.1",
    sp.Implies(sp.Eq(sin(chi_z) ** 2, 0), sp.Eq(beta, 0) & sp.Eq(gamma, 0)),
    said="for the two parallel planes of rotation, the ox3y3 plane is parallel to the oxy plane, and two of the "
    "three Euler angles are zero, that is, β = γ = 0",
    place="sec. 4.1",
).refute(
    {alpha: 0, beta: 0, gamma: sp.pi},
    equal(1 - R.components[2, 2] ** 2, sb**2 + cb**2 * sg**2),
    given=by_zyx,
    label="Z12",
    because="Half turns turn the plane upside down and leave it parallel: only sin β = 0 and sin γ = 0 follow.",
)

# %%
d.state(
    "same-as-conventional-4.1",
    *claims((fold(alpha), fold(alpha), 0)),
    said="The expression of the instantaneous Euler angle is the same as the corresponding conventional Euler angle",
    place="sec. 4.1, for β = γ = 0",
).prove(
    *cosines((alpha, alpha, 0)),
    given={R: turns("zyx", (alpha, 0, 0))},
    because="Both angles of the planes that turn are |α|; their cosines are equal.",
)

# %% [markdown]
# ## The tables of section 4.2
#
# This section is headed Z-Y-X, but has the angles φ, θ, φ′ of Z-Y-Z, and is meant as that. Four of the six rows are
# wrong: they carry the misprint of (17) or the exchanged labels, or take a product of cosines for the cosine of a sum.

# %%
WRONG_42 = {
    "phi": (
        {phi: sp.pi / 2},
        "Z13",
        "A rotation about z0 turns the xz plane as it turns the yz plane; (18) as printed gives neither.",
        (phi, phi, 0),
    ),
    "psi": (
        {psi: sp.pi / 6},
        "Z14",
        "It is a rotation about z, as the one by φ: the misprint of (17) makes the second angle π/2 − φ', and x and z "
        "are exchanged.",
        (psi, psi, 0),
    ),
    "theta-psi": (
        {theta: sp.pi / 2, psi: 0},
        "Z15",
        "The first element of the matrix is cos θ cos φ', not sin θ cos φ'.",
        (acos(ct * cp), psi, theta),
    ),
    "phi-psi": (
        {phi: sp.pi / 4, psi: sp.pi / 4},
        "Z16",
        "Both rotations are about z0: their angles add up, which cos φ cos φ' does not reflect.",
        (phi + psi, phi + psi, 0),
    ),
}
for name, (given_angles, row) in TABLE_42.items():
    entry = d.state(
        f"table-4.2-{name}",
        *claims(row),
        text=f"Z-Y-Z angles {written(given_angles)}.",
        place="sec. 4.2, " + ("one-time" if name.count("-") == 0 else "two-time") + " rotation",
    )
    by_row = {R: turns("zyz", given_angles)}
    if name in WRONG_42:
        point, label, because, right = WRONG_42[name]
        entry.refute(point, cosines(right), given=by_row, label=label, because=because)
    else:
        entry.prove(*cosines(row), given=by_row, because=f"Their cosines are equal, and {IN_RANGE}.")
d.page(*(f"table-4.2-{name}" for name in TABLE_42))

# %%
d.state(
    "table-4.2-three",
    *claims((acos(cb * cg), acos(sa * sb * sg + ca * cg), acos(ca * cb))),
    text="Z-Y-Z angles (φ, θ, φ'), by (20) with α = φ, β = θ, γ = φ'.",
    place="sec. 4.2, three-time rotation",
).refute(
    {phi: sp.pi / 2, theta: 0, psi: 0},
    [equal(cos(chi_x), right_zyz[0, 0]), equal(cos(chi_y), right_zyz[1, 1]), equal(cos(chi_z), ct)],
    given={R: zyz, alpha: phi, beta: theta, gamma: psi},
    label="Z17",
    because="Three rotations with the angles (φ, θ, φ') of this section are those of (18), put right.",
)

# %%
d.state(
    "parallel-planes-4.2",
    sp.Implies(sp.Eq(sin(chi_z) ** 2, 0), sp.Eq(theta, 0)),
    said="When the ox3y3 plane is parallel to the ox0y0 plane, the Euler angle θ should be equal to zero",
    place="sec. 4.2",
).refute(
    {phi: 0, theta: sp.pi, psi: 0},
    equal(1 - R.components[2, 2] ** 2, st**2),
    given=by_zyz,
    label="Z18",
    because="θ = π turns the plane upside down and leaves it parallel: only sin θ = 0 follows.",
)

# %%
phi3 = d.symbol("phi3", r"\phi_3", "a first angle that makes the same rotation", "rad")
psi3 = d.symbol("psi3", r"\varphi_3", "the third angle with it", "rad")
d.state(
    "any-split-of-a-turn-about-z",
    equal(turns("zyz", (phi3, 0, phi - phi3)), turns("zyz", (phi, 0, 0))),
    said="ϕ3 and φ3 can be arbitrary values",
    place="sec. 4.2",
).prove(because="One of them is arbitrary: the rotation by φ3 and then by φ − φ3 is that by φ.")

# %%
same_turn = sp.Eq(cos(phi3 + psi3), cos(phi)) & sp.Eq(sin(phi3 + psi3), sin(phi))
d.state(
    "same-descriptions",
    sp.Implies(same_turn, sp.Eq(theta + psi3, theta) & sp.Eq(theta, psi3)),
    said="When the equation θ + φ = θ = φ is satisfied, the three descriptions of the instantaneous Euler angle and "
    "the Euler angle are the same",
    place="sec. 4.2",
).refute(
    {phi: sp.pi / 2, phi3: sp.pi / 4, psi3: sp.pi / 4, theta: 0},
    equal(turns("zyz", (phi3, 0, psi3)), turns("zyz", (phi3 + psi3, 0, 0))),
    label="Z19",
    because="As printed it leaves θ = φ = 0 only. With θ = 0 the rotation depends on ϕ3 + φ3 alone, so that "
    "ϕ3 + φ3 = ϕ is what makes the descriptions (ϕ 0 0) and (ϕ3 0 φ3) the same; that seems to be meant.",
)

# %% [markdown]
# ## Angles without loss of digits
#
# Near 0 and π an arccosine loses half of the digits. The half angles do not. With the unit quaternion
# $(q_0, q_x, q_y, q_z)$ of the rotation, and $i,j,k$ the three axes in any order,
#
# $$ \sin^2\tfrac{\chi_i}2 = q_j^2 + q_k^2, \qquad \cos^2\tfrac{\chi_i}2 = q_0^2 + q_i^2. $$
#
# Both are sums of squares, so that $\chi_i = 2\,\mathrm{atan2}(\sqrt{q_j^2+q_k^2}, \sqrt{q_0^2+q_i^2})$ loses nothing
# anywhere. In the proof the quaternion has any length, $|q|^2$ is the sum of its four squares, and $r_{xx}$ to
# $r_{zz}$ are the diagonal elements of its matrix, the cosines of $\chi_x$ to $\chi_z$.

# %%
q = (
    d.symbol("q0", "q_0", "scalar part of a quaternion", "1"),
    *(d.symbol(f"q{axis}", f"q_{axis}", f"its part along {axis}", "1") for axis in "xyz"),
)
square = sum(x**2 for x in q)
of_quaternion = sp.ImmutableMatrix(matrix_from_quaternion(q[0], list(q[1:])))
length_squared = d.letter("length_squared | |q|^2 | sum of the squares of the components | 1", square)
diagonal_of_q = [
    d.letter(
        f"r_{axis} | r_{{{axis * 2}}} | cosine of χ_{axis}, from the quaternion | 1", of_quaternion[i, i]
    )
    for i, axis in enumerate("xyz")
]
others = ((2, 3), (3, 1), (1, 2))
d.check(
    "half-angles",
    *(
        equal(length_squared * (1 - c) / 2, q[j] ** 2 + q[k] ** 2)
        for c, (j, k) in zip(diagonal_of_q, others, strict=True)
    ),
    *(equal(length_squared * (1 + c) / 2, q[0] ** 2 + q[1 + i] ** 2) for i, c in enumerate(diagonal_of_q)),
    text="(1 − cos χ)/2 = sin²(χ/2) and (1 + cos χ)/2 = cos²(χ/2) of each angle, for a quaternion of any length.",
).prove(because="The diagonal of a quaternion's matrix is (q₀² + q_i² − q_j² − q_k²)/|q|².")

# %% [markdown]
# The quaternions of the two sequences are products of the quaternions of their three rotations. $h,k,l$ are the
# halves of the three angles of a sequence.

# %%
h, k_, l_ = (
    d.symbol(f"half_{n}", letter, f"half of angle {n} of a sequence", "rad")
    for n, letter in enumerate("hkl", 1)
)
halves = {alpha: 2 * h, beta: 2 * k_, gamma: 2 * l_, phi: 2 * h, theta: 2 * k_, psi: 2 * l_}


def product(p, r):
    """Quaternion of one rotation after another."""
    a, u = p[0], sp.Matrix(p[1:])
    b, v = r[0], sp.Matrix(r[1:])
    return sp.Matrix([a * b - u.dot(v), *(a * v + b * u + u.cross(v))])


def half_turns(sequence, halves):
    """Quaternion of intrinsic rotations by twice the angles."""
    found = sp.Matrix([1, 0, 0, 0])
    for axis, angle in zip(sequence, halves, strict=True):
        found = product(found, sp.Matrix([cos(angle), *(sin(angle) * UNIT[axis])]))
    return found


q_zyx = half_turns("zyx", (h, k_, l_))
q_zyz = half_turns("zyz", (h, k_, l_))


def letters_of(name, quaternion, sequence):
    """A column for a quaternion, a matrix from it, and the matrix of the sequence."""
    upper = "-".join(sequence.upper())
    return (
        d.matrix(
            name, rf"q_{{{sequence}}}", f"quaternion of {upper}", "1", value=quaternion, rows=4, columns=1
        ),
        d.letter(
            f"M_{sequence}[3,3] | M(q_{{{sequence}}}) | "
            f"its matrix, by the formula for quaternions (notebook rotations, entry matrix-from-quaternion) | 1",
            matrix_from_quaternion(quaternion[0], list(quaternion[1:])),
        ),
        d.letter(
            f"R_{sequence}_halves[3,3] | R_{{{sequence}}}(2h,2k,2l) | matrix of {upper}, by its three rotations | 1",
            sp.Matrix((zyx if sequence == "zyx" else zyz).subs(halves)),
        ),
    )


column_zyx, matrix_zyx, rotation_zyx = letters_of("q_zyx", q_zyx, "zyx")
column_zyz, matrix_zyz, rotation_zyz = letters_of("q_zyz", q_zyz, "zyz")
d.check(
    "quaternions",
    equal(matrix_zyx, rotation_zyx),
    equal(matrix_zyz, rotation_zyz),
    text="The products of quaternions have the matrices of Z-Y-X and Z-Y-Z.",
).prove(because="A product of quaternions is the rotation by one after the other.")

# %% [markdown]
# From Z-Y-X angles the sums of squares for $\chi_x$ and $\chi_z$ need no difference at all. For Z-Y-Z, the quaternion
# has the half sum and the half difference of the outer angles, so that $\chi_z$ is $2k=\theta$,
# folded.

# %%
plus, minus = h + l_, h - l_
w_, x_, y_, z_ = column_zyx
d.check(
    "half-angles-of-sequences",
    equal(y_**2 + z_**2, (sin(h) * cos(k_)) ** 2 + (cos(h) * sin(k_)) ** 2),
    equal(w_**2 + x_**2, (cos(h) * cos(k_)) ** 2 + (sin(h) * sin(k_)) ** 2),
    equal(x_**2 + y_**2, (sin(k_) * cos(l_)) ** 2 + (cos(k_) * sin(l_)) ** 2),
    equal(w_**2 + z_**2, (cos(k_) * cos(l_)) ** 2 + (sin(k_) * sin(l_)) ** 2),
    equal(
        column_zyz,
        sp.ImmutableMatrix(
            [cos(k_) * cos(plus), -sin(k_) * sin(minus), sin(k_) * cos(minus), cos(k_) * sin(plus)]
        ),
    ),
    text="sin² and cos² of χ_x/2, then of χ_z/2, for Z-Y-X, with the components 1 to 4 of its quaternion; and the "
    "quaternion of Z-Y-Z.",
).prove(because="The products of sines and cosines are multiplied out; sin² + cos² = 1 for each half angle.")


# %% [markdown]
# ## The functions
#
# Each gives the three angles and a status: from a quaternion, a rotation matrix, Z-Y-X angles or Z-Y-Z angles. A
# triple with an angle of 0 or π is marked: that plane has not moved, or is upside down, so that it has no ridge line
# and its rate of change jumps.


# %%
class AngleStatus(IntEnum):
    """Kind of a triple of instantaneous Euler angles.

    ANGLES: three angles between 0 and pi, each with its ridge line.
    NO_RIDGE: at least one angle is 0 or pi to rounding: its planes coincide or are parallel, without a ridge line.
    IDENTITY: no rotation; all three angles are 0.
    NOT_NORMAL: the quaternion is not of unit length, or the matrix not orthogonal; it is brought to one.
    INVALID: not finite, a zero quaternion, or a reflection; the result is NaN.
    """

    ANGLES = 0
    NO_RIDGE = 1
    IDENTITY = 2
    NOT_NORMAL = 3
    INVALID = 4


def length_of_two(k, name, a, b):
    """√(a² + b²), scaled because the square of a small number vanishes below 1e-154."""
    scale = k.let(f"{name}_scale", power_of_two_scale(abs(a) + abs(b)))
    scaled = k.let(
        f"{name}_scaled", sp.Matrix([scale * a, scale * b])
    )  # named, so that it is squared as it is
    return k.let(name, sp.sqrt(scaled.dot(scaled)) / scale)


def finish(k, sines, cosines, good, abnormal):
    """Return angles from the sines and cosines of their halves, and their status."""
    chi = [2 * sp.atan2(s, c) for s, c in zip(sines, cosines, strict=True)]
    k.output(
        "chi",
        sp.Matrix([select(good, value, sp.nan) for value in chi]),
        unit="rad",
        doc="angles of the yz, xz and xy planes, 0 to pi",
    )
    flat = sp.Or(*(sp.Le(s, EPS) | sp.Le(c, EPS) for s, c in zip(sines, cosines, strict=True)))
    none = sp.And(*(sp.Eq(s, 0) for s in sines))
    status = sp.Piecewise(
        (AngleStatus.INVALID, sp.Not(good)),
        (AngleStatus.NOT_NORMAL, abnormal),
        (AngleStatus.IDENTITY, none),
        (AngleStatus.NO_RIDGE, flat),
        (AngleStatus.ANGLES, True),
        evaluate=False,
    )
    k.status("status", status, AngleStatus, doc="what the angles are")
    return k.build()


def by_quaternion(k, w, v, good, abnormal):
    sines, cosines = [], []
    for i, axis in enumerate("xyz"):
        j, n = (i + 1) % 3, (i + 2) % 3
        sines.append(length_of_two(k, f"sine_{axis}", v[j], v[n]))
        cosines.append(length_of_two(k, f"cosine_{axis}", w, v[i]))
    return finish(k, sines, cosines, good, abnormal)


def chi_from_quaternion():
    k = KernelBuilder(
        "chi_from_quaternion",
        summary="Instantaneous Euler angles of a unit quaternion.",
        source="Zhou and Zhu, eqs. (10), (13), (16), by half angles",
    )
    quaternion = k.input("quaternion", 4, unit="1", doc="unit quaternion, scalar part first")
    unit, good, abnormal = normalised(k, "quaternion", quaternion)
    return by_quaternion(k, unit[0], unit[1:4, 0], k.let("good", good), abnormal)


def chi_from_matrix():
    k = KernelBuilder(
        "chi_from_matrix",
        summary="Instantaneous Euler angles of a rotation matrix.",
        source="Zhou and Zhu, eqs. (10), (13), (16), by half angles",
    )
    matrix = k.input("matrix", (3, 3), unit="1", doc="rotation matrix")
    w, v, good, abnormal = quaternion_of_matrix(k, matrix)
    return by_quaternion(k, w, v, good, abnormal)


def quaternion_of_matrix(k, matrix):
    """Return a unit quaternion by its largest component, whether the matrix is a rotation, and how nearly."""
    products = k.let("products", quaternion_products(matrix))
    column, largest = products[:, 0], products[0, 0]
    for n in range(1, 4):
        column = select(products[n, n] > largest, products[:, n], column)
        largest = select(products[n, n] > largest, products[n, n], largest)
        column, largest = k.let(f"column_{'abc'[n - 1]}", column), k.let(f"largest_{'abc'[n - 1]}", largest)
    length = k.let("length", sp.sqrt(column.dot(column)))
    unit = k.let("unit", column / length)
    gram = matrix.T * matrix - sp.eye(3)
    deviation = k.let("deviation", sum((abs(x) for x in gram), sp.S.Zero))
    determinant = k.let("determinant", matrix[:, 0].dot(matrix[:, 1].cross(matrix[:, 2])))
    good = k.let("good", (determinant > 0) & (deviation <= LARGEST))
    return unit[0], unit[1:4, 0], good, sp.Not(deviation <= 64 * EPS)


def half_angles(k, angles):
    half = [k.let(f"half_{n}", angle / 2) for n, angle in enumerate(angles, 1)]
    s = [k.let(f"sin_{n}", sin(x)) for n, x in enumerate(half, 1)]
    c = [k.let(f"cos_{n}", cos(x)) for n, x in enumerate(half, 1)]
    return half, s, c, k.let("good", sum((abs(x) / 4 for x in angles), sp.S.Zero) <= LARGEST)


def chi_from_zyx():
    k = KernelBuilder(
        "chi_from_zyx",
        summary="Instantaneous Euler angles of intrinsic Z-Y-X angles.",
        source="Zhou and Zhu, eqs. (10), (13), (16), by half angles",
    )
    angles = k.input("angles", 3, unit="rad", doc="about z0, y1 and x2")
    _, (s1, s2, s3), (c1, c2, c3), good = half_angles(k, angles)
    w = k.let("w", c1 * c2 * c3 + s1 * s2 * s3)
    x = k.let("x", c1 * c2 * s3 - s1 * s2 * c3)
    y = k.let("y", c1 * s2 * c3 + s1 * c2 * s3)
    z = k.let("z", s1 * c2 * c3 - c1 * s2 * s3)
    sines = [
        length_of_two(k, "sine_x", s1 * c2, c1 * s2),
        length_of_two(k, "sine_y", x, z),
        length_of_two(k, "sine_z", s2 * c3, c2 * s3),
    ]
    cosines = [
        length_of_two(k, "cosine_x", c1 * c2, s1 * s2),
        length_of_two(k, "cosine_y", w, y),
        length_of_two(k, "cosine_z", c2 * c3, s2 * s3),
    ]
    return finish(k, sines, cosines, good, sp.false)


def chi_from_zyz():
    k = KernelBuilder(
        "chi_from_zyz",
        summary="Instantaneous Euler angles of intrinsic Z-Y-Z angles.",
        source="Zhou and Zhu, eq. (18) put right, by half angles",
    )
    angles = k.input("angles", 3, unit="rad", doc="about z0, y1 and z2")
    (h1, _, h3), (_, s2, _), (_, c2, _), good = half_angles(k, angles)
    sum_, difference = k.let("half_sum", h1 + h3), k.let("half_difference", h1 - h3)
    w, z = k.let("w", c2 * cos(sum_)), k.let("z", c2 * sin(sum_))
    x, y = k.let("x", -s2 * sin(difference)), k.let("y", s2 * cos(difference))
    sines = [length_of_two(k, "sine_x", y, z), length_of_two(k, "sine_y", x, z), k.let("sine_z", abs(s2))]
    cosines = [
        length_of_two(k, "cosine_x", w, x),
        length_of_two(k, "cosine_y", w, y),
        k.let("cosine_z", abs(c2)),
    ]
    return finish(k, sines, cosines, good, sp.false)


# %%
derivation.kernel(chi_from_quaternion(), chi_from_matrix(), chi_from_zyx(), chi_from_zyz())
