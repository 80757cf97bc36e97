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
# # The reverse analysis of industrial robots: Puma 560, GE P60, Cincinnati T3-776
#
# Given where the end of an arm with six revolute joints is, find all joint angles that bring it there. Two families of
# arms have a closed form with eight solutions, and the three robots of Crane and Duffy belong to them:
#
# * **wrist**: axes 2 and 3 are parallel, and axes 4, 5 and 6 meet in one point (Puma 560, T3-776);
# * **three parallel**: axes 2, 3 and 4 are parallel, and axes 5 and 6 meet (GE P60).
#
# In both the projection of the vector loop on $\vec S_2$ holds $\theta_1$ alone, one more equation gives the sign of
# $\theta_5$, and a plane triangle remains. Lengths, twists and offsets are otherwise free.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, coordinate_rotation, equal, select

derivation = Derivation(
    "robots_6r",
    title="The reverse analysis of robots with six revolute joints, in closed form",
    source="Crane and Duffy, Kinematic Analysis of Robot Manipulators; lecture notes “Robot Geometry”",
)
d = derivation


# %%
def pair(name, latex, quantity):
    """Cosine and sine of an angle as letters."""
    return (
        d.symbol(f"c{name}", rf"c_{{{latex}}}", f"cosine of {quantity}", "1"),
        d.symbol(f"s{name}", rf"s_{{{latex}}}", f"sine of {quantity}", "1"),
    )


LINKS = ("12", "23", "34", "45", "56", "67", "71")
TWIST = {ij: pair(ij, ij, f"the twist of link {ij}") for ij in LINKS}
ANGLE = {j: pair(str(j), str(j), f"the angle of joint {j}") for j in range(1, 8)}
LENGTH = {
    ij: d.symbol(f"a{ij}", f"a_{{{ij}}}", f"length of link {ij}", "length") for ij in LINKS if ij != "67"
}
OFFSET = {j: d.symbol(f"S{j}", f"S_{j}", f"offset of joint {j}", "length") for j in range(1, 8)}
UNIT = {s: c**2 + s**2 - 1 for c, s in (*TWIST.values(), *ANGLE.values())}
X_AXIS, Z_AXIS = sp.Matrix([1, 0, 0]), sp.Matrix([0, 0, 1])
d


# %%
def tx(ij):
    """Rotation by the twist of a link."""
    return coordinate_rotation("x", *TWIST[ij])


def rz(j):
    """Rotation by the angle of a joint."""
    return coordinate_rotation("z", *ANGLE[j])


def moved(ij, j, point):
    """A point of the link after joint j, in the frame of link ij before it."""
    return LENGTH[ij] * X_AXIS + tx(ij) * (OFFSET[j] * Z_AXIS + rz(j) * point)


def vectors(left, right):
    return equal(sp.ImmutableMatrix(left), sp.ImmutableMatrix(right))


ZERO = sp.zeros(3, 1)
c1, s1 = ANGLE[1]
c2, s2 = ANGLE[2]
c3, s3 = ANGLE[3]
c4, s4 = ANGLE[4]
c5, s5 = ANGLE[5]
c6, s6 = ANGLE[6]
c12, s12 = TWIST["12"]
c34, s34 = TWIST["34"]
c45, s45 = TWIST["45"]
c56, s56 = TWIST["56"]
PARALLEL_23 = {TWIST["23"][0]: 1, TWIST["23"][1]: 0}
PARALLEL_34 = {c34: 1, s34: 0}
MEET_456 = {LENGTH["45"]: 0, LENGTH["56"]: 0, OFFSET[5]: 0}

# %% [markdown]
# ## A wrist behind two parallel axes
#
# The axes 4, 5 and 6 meet in the wrist's centre, $\vec W=\vec P-S_6\vec S_6$ with the end point $\vec P$, so that
# the pose gives it without an angle. From the base it is reached by $\theta_1$, $\theta_2$ and $\theta_3$ alone.

# %%
last = moved("45", 5, moved("56", 6, ZERO))
axis_6 = tx("45") * rz(5) * tx("56") * Z_AXIS
d.check(
    "wrist-centre",
    vectors(last - OFFSET[6] * axis_6, ZERO),
    text="With a45 = a56 = S5 = 0 the point S6 before the end is the origin of frame 4.",
).prove(given=MEET_456)

# %%
forearm = sp.Matrix([LENGTH["34"], -s34 * OFFSET[4]])
flat = sp.diag(1, 1, 0)
elbow = LENGTH["23"] * X_AXIS + rz(3) * sp.Matrix([*forearm, 0])
reached = OFFSET[2] * Z_AXIS + rz(2) * moved("23", 3, moved("34", 4, ZERO))
d.check(
    "wrist-plane",
    vectors(reached, rz(2) * elbow + (OFFSET[2] + OFFSET[3] + c34 * OFFSET[4]) * Z_AXIS),
    text="Seen from joint 2, with axes 2 and 3 parallel, the wrist's centre moves in one plane, as the end of an upper "
    "arm a23 and a forearm (a34, -s34 S4).",
).prove(given=PARALLEL_23)

# %%
W = d.vector("W", r"\vec W", "the wrist's centre, from the origin of F, less S1 along its z axis", "length")
height = d.symbol("height", "H", "S2 + S3 + c34 S4, or S2 + S3 + S4 + c45 S5", "length")
before_2 = tx("12").T * (rz(1).T * sp.Matrix(list(W)) - LENGTH["12"] * X_AXIS)
equation_1 = -s12 * W.components[1] * c1 + s12 * W.components[0] * s1 + c12 * W.components[2] - height
d.check(
    "theta1",
    equal((Z_AXIS.T * before_2)[0] - height, equation_1),
    text="Along S2 the loop holds θ1 alone: A c1 + B s1 + D = 0 with A = -s12 Wy, B = s12 Wx and D = c12 Wz - H. The "
    "length a12 is not in it.",
).prove(modulo=UNIT)

# %%
w = sp.Matrix(
    [
        d.symbol("w_x", "w_x", "the triangle's end along x, seen from joint 2", "length"),
        d.symbol("w_y", "w_y", "the triangle's end along y, seen from joint 2", "length"),
    ]
)
l1 = d.symbol("l_1", "l_1", "forearm along x, in link 23", "length")
l2 = d.symbol("l_2", "l_2", "forearm along y, in link 23", "length")
a23 = LENGTH["23"]
arm = sp.Matrix([a23 + c3 * l1 - s3 * l2, s3 * l1 + c3 * l2])
turned = sp.Matrix([[c2, -s2], [s2, c2]]) * arm
d.check(
    "theta3",
    equal(turned.dot(turned), 2 * a23 * l1 * c3 - 2 * a23 * l2 * s3 + a23**2 + l1**2 + l2**2),
    text="The length of the triangle's third side gives θ3: 2 a23 (l1 c3 - l2 s3) + a23² + |l|² - |w|² = 0.",
).prove(modulo=UNIT)

# %%
d.check(
    "theta2",
    equal(arm.dot(turned), arm.dot(arm) * c2),
    equal(arm[0] * turned[1] - arm[1] * turned[0], arm.dot(arm) * s2),
    text="Then θ2 is the angle from the arm to w.",
).prove()

# %% [markdown]
# The remaining rotation is $N=R_z(\theta_4)R_x(\alpha_{45})R_z(\theta_5)R_x(\alpha_{56})R_z(\theta_6)$ of the wrist.

# %%
wrist = rz(4) * tx("45") * rz(5) * tx("56") * rz(6)
p, q = s56 * s5, -c45 * s56 * c5 - s45 * c56
d.check(
    "wrist-column",
    vectors(wrist * Z_AXIS, sp.Matrix([p * c4 - q * s4, p * s4 + q * c4, c45 * c56 - s45 * s56 * c5])),
    text="The last column holds θ4 and θ5. Its last entry gives the cosine of θ5, whose sine may have either sign; the "
    "other two then give θ4.",
).prove()

# %%
wrist_4 = rz(4).T * sp.Matrix(list(d.vector("n", r"\vec n", "first column of N", "1")))
n = sp.Matrix(sp.symbols("n_1 n_2 n_3", real=True))
from_left = tx("56").T * rz(5).T * tx("45").T * rz(4).T
d.check(
    "theta6",
    vectors(from_left * wrist * X_AXIS, sp.Matrix([c6, s6, 0])),
    text="The first column of N, turned back by all that is known, gives θ6; so an error of θ4 near a singular wrist "
    "does not spoil the orientation.",
).prove(modulo=UNIT)

# %%
x3 = d.symbol(
    "n33", "N_{33}", "cosine between axes 4 and 6 (or 2 and 6)", "1", value=c45 * c56 - s45 * s56 * c5
)
h = d.symbol("h", "h", "sine between axes 4 and 6 (or 2 and 6)", "1")
square = (s45 * s56 * s5) ** 2
between = {h: h**2 + x3**2 - 1}
d.check(
    "sine-of-theta5",
    equal(square * (1 + x3), h**2 * (1 + x3 - 2 * c45 * c56) - (c45 - c56) ** 2 * (1 + x3)),
    equal(square * (1 - x3), h**2 * (1 - x3 + 2 * c45 * c56) - (c45 + c56) ** 2 * (1 - x3)),
    text="(s45 s56 s5)² = h² (1 - 2 c45 c56/(1 + N33)) - (c45 - c56)² = h² (1 + 2 c45 c56/(1 - N33)) - (c45 + c56)²: "
    "one of both does not cancel near a singular wrist, where h is small.",
).prove(modulo={**between, **UNIT})

# %% [markdown]
# ## Three parallel axes
#
# With $a_{56}=0$ the origin of frame 5 is $\vec W=\vec P-S_6\vec S_6$. The angle between $\vec S_4=\vec S_2$ and
# $\vec S_5$ is the twist $\alpha_{45}$, so the offset $S_5$ adds $c_{45}S_5$ along $\vec S_2$, and the equation of
# $\theta_1$ is as before.

# %%
d.check(
    "crossing",
    vectors(moved("56", 6, ZERO) - OFFSET[6] * tx("56") * Z_AXIS, ZERO),
    text="With a56 = 0 the point S6 before the end is the origin of frame 5.",
).prove(given={LENGTH["56"]: 0})

# %%
to_5 = OFFSET[2] * Z_AXIS + rz(2) * moved("23", 3, moved("34", 4, moved("45", 5, ZERO)))
plane_4 = rz(2) * rz(3) * rz(4)
d.check(
    "parallel-plane",
    vectors(
        to_5 - plane_4 * (LENGTH["45"] * X_AXIS + OFFSET[5] * tx("45") * Z_AXIS),
        rz(2) * (a23 * X_AXIS + rz(3) * LENGTH["34"] * X_AXIS) + (OFFSET[2] + OFFSET[3] + OFFSET[4]) * Z_AXIS,
    ),
    text="Less a45 and S5, whose directions are known from θ2 + θ3 + θ4, the same triangle is left, with the forearm "
    "a34.",
).prove(given={**PARALLEL_23, **PARALLEL_34})

# %%
c45_S5 = (Z_AXIS.T * plane_4 * tx("45") * Z_AXIS)[0]
d.check("parallel-height", equal(c45_S5, c45), text="S2 · S5 = c45.").prove()

# %%
row = (Z_AXIS.T * tx("45") * rz(5) * tx("56") * rz(6)).T
p_row, q_row = s45 * s5, c56 * s45 * c5 + s56 * c45
d.check(
    "parallel-row",
    vectors(row, sp.Matrix([p_row * c6 + q_row * s6, q_row * c6 - p_row * s6, c45 * c56 - s45 * s56 * c5])),
    text="S2, seen from the end, holds θ5 and θ6: the cosine of θ5 as in a wrist, and then θ6.",
).prove()

# %%
base_to_4 = tx("45") * rz(5) * tx("56") * rz(6)
d.check(
    "parallel-sum",
    vectors(plane_4 * base_to_4 * (rz(6).T * tx("56").T * sp.Matrix([c5, -s5, 0])), plane_4 * X_AXIS),
    text="Then the x axis of frame 4 is known, and with it θ2 + θ3 + θ4.",
).prove(modulo=UNIT)

# %% [markdown]
# ## Arms with a pair of equations
#
# Any three consecutive axes that meet or are parallel leave two equations in two angles, each linear in $(1, c, s)$ of
# either angle. They are written with the pose $(R,\vec P)$, $\vec P$ less $S_1$ along $\vec S_1$; each is proved to
# vanish for every pose that the chain reaches. Chains with such axes at the other end are read backwards.


# %%
class Given:
    """A pose and an arm's geometry, in letters or as the inputs of a kernel."""

    def __init__(self, R, P, a, cosine, sine, offset):
        self.R, self.P = R, P
        self.a12, self.a23, self.a34, self.a45, self.a56 = a
        self.twists = list(zip(cosine, sine, strict=True))
        _, self.S2, self.S3, self.S4, self.S5, self.S6 = offset

    def tx(self, link):
        return coordinate_rotation("x", *self.twists[link])


def of_letters(R, P, values):
    """The geometry in the derivation's letters, some of them at `values`."""
    lengths = [LENGTH[ij] for ij in LINKS[:5]]
    cosine, sine = zip(*(TWIST[ij] for ij in LINKS[:5]), strict=True)
    rows = [[x.xreplace(values) for x in row] for row in (lengths, cosine, sine, list(OFFSET.values())[:6])]
    return Given(R.xreplace(values), P.xreplace(values), *rows)


# %%
def meet_456(g, two, three):
    """Axes 4, 5, 6 meet: the wrist's distance from the origin of F and its height hold θ2 and θ3 (Pieper)."""
    W = g.P - g.S6 * g.R[:, 2]
    c, s = g.twists[2]
    tip = sp.Matrix([g.a34, -s * g.S4, g.S3 + c * g.S4])
    turned = coordinate_rotation("z", *three) * tip
    link = g.a23 * X_AXIS + g.tx(1) * turned
    swung = coordinate_rotation("z", *two) * link
    c, s = g.twists[0]
    # the squares of vectors that turn are constants
    square = g.a23**2 + tip.dot(tip) + 2 * g.a23 * turned[0]
    size = g.a12**2 + g.S2**2 + 2 * g.a12 * swung[0] + 2 * g.S2 * link[2] + square
    return size - W.dot(W), c * g.S2 + s * swung[1] + c * swung[2] - W[2]


def chain_456():
    """A pose that the chain reaches: the wrist's centre by three angles, and S6 anywhere."""
    centre = LENGTH["12"] * X_AXIS + tx("12") * (
        OFFSET[2] * Z_AXIS + rz(2) * moved("23", 3, moved("34", 4, ZERO))
    )
    R = coordinate_rotation("z", *ANGLE[7]) * tx("45") * rz(6)
    return R, rz(1) * centre + OFFSET[6] * R * Z_AXIS


R_456, P_456 = chain_456()
d.check(
    "pieper",
    *(equal(e, 0) for e in meet_456(of_letters(R_456, P_456, MEET_456), ANGLE[2], ANGLE[3])),
    text="The wrist's distance from the origin of F, and its height along S1.",
).prove(modulo=UNIT)


# %%
def meet_234(g, one, six):
    """Axes 2, 3, 4 meet in a point that the base turns by θ1 alone.

    In the axes of joint 5 its height and its distance are constants, and with the pose they hold θ1 and θ6.
    """
    c, s = g.twists[0]
    point = sp.Matrix([g.a12, -s * g.S2, c * g.S2])
    turned = coordinate_rotation("z", *one) * point
    seen = g.R.T * (turned - g.P)
    swung = coordinate_rotation("z", *six) * seen
    # the squares of vectors that turn are constants
    square = point.dot(point) + g.P.dot(g.P) - 2 * turned.dot(g.P)
    c, s = g.twists[4]
    height = s * swung[1] + c * (g.S6 + seen[2])
    size = g.a56**2 + g.S6**2 + 2 * g.a56 * swung[0] + 2 * g.S6 * seen[2] + square
    c, s = g.twists[3]
    wanted = g.a45**2 + (s * g.S4) ** 2 + (c * g.S4 + g.S5) ** 2
    return height + c * g.S4 + g.S5, size - wanted


MEET_234 = {LENGTH["23"]: 0, LENGTH["34"]: 0, OFFSET[3]: 0}
of_5 = rz(5).T * (tx("45").T * (-OFFSET[4] * Z_AXIS - LENGTH["45"] * X_AXIS) - OFFSET[5] * Z_AXIS)
of_6 = rz(6).T * (tx("56").T * (of_5 - LENGTH["56"] * X_AXIS) - OFFSET[6] * Z_AXIS)
point_1 = rz(1) * (LENGTH["12"] * X_AXIS + tx("12") * OFFSET[2] * Z_AXIS)
R_234 = rz(2) * tx("23") * rz(3)
meeting = of_letters(R_234, point_1 - R_234 * of_6, MEET_234)
d.check(
    "meeting-in-the-middle",
    vectors(moved("34", 4, -OFFSET[4] * Z_AXIS).subs(MEET_234), ZERO),
    vectors(moved("45", 5, moved("56", 6, of_6)), -OFFSET[4] * Z_AXIS),
    *(equal(e, 0) for e in meet_234(meeting, ANGLE[1], ANGLE[6])),
    text="The point where the axes meet, S4 before frame 4, from the base and from the end, with any rotation.",
).prove(modulo=UNIT)


# %%
def parallel_234(g, one, six):
    """Axes 2, 3, 4 are parallel: S2 · S5 = c45, and the loop from S2 to the origin of frame 5 along S2."""
    axis_2 = coordinate_rotation("z", *one) * g.tx(0) * Z_AXIS
    axis_5 = coordinate_rotation("z", *six).T * g.tx(4).T * Z_AXIS
    corner = coordinate_rotation("z", *six).T * (-g.a56 * X_AXIS) - g.S6 * Z_AXIS
    c, _ = g.twists[3]
    up = g.R.T * axis_2
    return up.dot(axis_5) - c, axis_2.dot(g.P) + up.dot(corner) - (g.S2 + g.S3 + g.S4 + c * g.S5)


PARALLEL_234 = {**PARALLEL_23, **PARALLEL_34}
turned_4 = rz(1) * tx("12") * rz(2)  # one turn for three joints about one direction
R_parallel = turned_4 * tx("45") * rz(5) * tx("56") * rz(6)
plane = sp.Matrix([sp.Symbol("x_4", real=True), sp.Symbol("y_4", real=True), 0])
height_4 = (OFFSET[2] + OFFSET[3] + OFFSET[4]) * Z_AXIS
P_parallel = rz(1) * (LENGTH["12"] * X_AXIS + tx("12") * (plane + height_4)) + turned_4 * moved(
    "45", 5, moved("56", 6, ZERO)
)
d.check(
    "three-parallel",
    vectors(
        (to_5 - plane_4 * moved("45", 5, ZERO)).subs(PARALLEL_234),
        rz(2) * (a23 * X_AXIS + rz(3) * LENGTH["34"] * X_AXIS) + height_4,
    ),
    *(
        equal(e, 0)
        for e in parallel_234(of_letters(R_parallel, P_parallel, PARALLEL_234), ANGLE[1], ANGLE[6])
    ),
    vectors(rz(5).T * tx("45").T * Z_AXIS, sp.Matrix([s45 * s5, s45 * c5, c45])),
    text="Frame 4 is anywhere in the plane. Both equations hold; then S2, seen from frame 5, gives θ5.",
).prove(modulo=UNIT)


# %%
def parallel_123(g, five, six):
    """Axes 1, 2, 3 are parallel: S1 · S4 = c34, and the loop along S1. S1, seen from the end, is a row of R."""
    up = g.R[2, :].T
    back_6, back_5 = coordinate_rotation("z", *six).T, coordinate_rotation("z", *five).T
    axis_5 = back_6 * g.tx(4).T * Z_AXIS
    axis_4 = back_6 * g.tx(4).T * back_5 * g.tx(3).T * Z_AXIS
    x_4 = back_6 * g.tx(4).T * back_5 * X_AXIS
    c, _ = g.twists[2]
    along = c * g.S4 + g.a45 * up.dot(x_4) + g.S5 * up.dot(axis_5) + g.a56 * up.dot(back_6 * X_AXIS)
    return up.dot(axis_4) - c, along + g.S6 * up[2] + g.S2 + g.S3 - g.P[2]


to_6 = moved("34", 4, moved("45", 5, moved("56", 6, ZERO)))
R_123 = rz(1) * tx("34") * rz(4) * tx("45") * rz(5) * tx("56") * rz(6)
P_123 = rz(1) * (to_6 + plane) + (OFFSET[2] + OFFSET[3]) * Z_AXIS
d.check(
    "three-parallel-first",
    *(equal(e, 0) for e in parallel_123(of_letters(R_123, P_123, {}), ANGLE[5], ANGLE[6])),
    vectors(rz(4).T * tx("34").T * Z_AXIS, sp.Matrix([s34 * s4, s34 * c4, c34])),
    text="Frame 3 is anywhere in the plane, turned by any angle. Both equations hold; then S1, seen from frame 4, "
    "gives θ4.",
).prove(modulo=UNIT)

# %% [markdown]
# ## The same with the hypothetical link
#
# Crane and Duffy close the chain with a seventh, hypothetical link and write the equations of a spherical heptagon.
# Each side of the equations below is a component of one vector, reached from the base backwards over joints 1, 7 and 6
# or forwards. Singles without a bar are $X_j=s_{ij}s_j$, $Y_j=-(s_{jk}c_{ij}+c_{jk}s_{ij}c_j)$,
# $Z_j=c_{jk}c_{ij}-s_{jk}s_{ij}c_j$; with a bar the twists are exchanged.


# %%
def single(ij, j, jk):
    """Return X, Y and Z of one joint, for the twist of link ij."""
    (cj, sj), (ci, si), (ck, sk) = ANGLE[j], TWIST[ij], TWIST[jk]
    return sp.Matrix([si * sj, -(sk * ci + ck * si * cj), ck * ci - sk * si * cj])


def joined(xyz, b, e):
    """X, X*, Y and Z with one more joint b, and then the twist of link e."""
    (x, y, z), (cb, sb) = xyz, ANGLE[b]
    star = x * sb + y * cb
    first = x * cb - y * sb
    if e is None:
        return sp.Matrix([first, star, z])
    ce, se = TWIST[e]
    return sp.Matrix([first, ce * star - se * z, se * star + ce * z])


xyz_7 = single("67", 7, "71")
xyz_1 = single("71", 1, "12")
xyz_71 = joined(xyz_7, 1, "12")
xyz_712 = joined(xyz_71, 2, "23")
xyz_7123 = joined(xyz_712, 3, "34")
bar_5 = single("56", 5, "45")
star_54 = joined(bar_5, 4, None)
axis_2 = sp.Matrix([0, -s12, c12])
back = {
    "S6": rz(1).T * tx("71").T * rz(7).T * tx("67").T * Z_AXIS,
    "S7": rz(1).T * tx("71").T * Z_AXIS,
    "a71": rz(1).T * X_AXIS,
}
rest = OFFSET[6] * back["S6"] + OFFSET[7] * back["S7"] + LENGTH["71"] * back["a71"] + OFFSET[1] * Z_AXIS
c67, s67 = TWIST["67"]
c71, s71 = TWIST["71"]
S1, S6, S7, a71 = OFFSET[1], OFFSET[6], OFFSET[7], LENGTH["71"]
A_7 = s12 * (S6 * xyz_7[1] - S7 * s71)
B_7 = s12 * (S6 * xyz_7[0] + a71)
D_7 = c12 * (S6 * xyz_7[2] + S7 * c71 + S1)
d.check(
    "heptagon-theta1",
    equal(A_7 * c1 + B_7 * s1 + D_7, rest.dot(axis_2)),
    text="A = s12 (S6 Y7 - S7 s71), B = s12 (S6 X7 + a71), D = c12 (S6 Z7 + S7 c71 + S1) + H: the loop along S2.",
).prove()

# %%
K_1 = -S6 * xyz_71[0] - S7 * xyz_1[0] - a71 * c1
K_2 = -S1 * s12 + S6 * xyz_71[1] + S7 * xyz_1[1] + a71 * c12 * s1
d.check(
    "heptagon-plane",
    equal(K_1, -rest[0]),
    equal(K_2, -rest.dot(sp.Matrix([0, c12, s12]))),
    text="The triangle's end for a12 = 0: K1 = -S6 X71 - S7 X1 - a71 c1, K2 = -S1 s12 + S6 Y71 + S7 Y1 + a71 c12 s1, "
    "the loop along a12 and S2 × a12.",
).prove()

# %%
from_base = tx("34").T * rz(3).T * tx("23").T * rz(2).T * tx("12").T * back["S6"]
d.check(
    "heptagon-wrist",
    vectors(from_base, sp.diag(1, -1, 1) * xyz_7123),
    vectors(rz(4) * tx("45") * rz(5) * tx("56") * Z_AXIS, star_54),
    text="S6 in the axes of joint 4 from both sides: X7123 = X54, Y7123 = -X*54, Z7123 = Z5, which give θ5 and θ4.",
).prove()

# %%
from_end = tx("56").T * rz(5).T * tx("45").T * rz(4).T
xyz_67 = joined(single("56", 6, "67"), 7, "71")
d.check(
    "heptagon-parallel",
    vectors(tx("12").T * back["S6"], sp.diag(1, -1, 1) * xyz_71),
    text="With three parallel axes S4 = S2, and Z71 = c45 c56 - s45 s56 c5 gives θ5.",
).prove()

# %%
side_5 = rz(1).T * tx("71").T * rz(7).T * tx("67").T * rz(6).T * tx("56").T * Z_AXIS
xyz_671 = joined(xyz_67, 1, "12")
d.check(
    "heptagon-parallel-plane",
    equal(side_5[0], xyz_671[0]),
    equal(side_5.dot(sp.Matrix([0, c12, s12])), -xyz_671[1]),
    text="The offset S5 adds -S5 X671 to K1 and S5 Y671 to K2.",
).prove()

# %% [markdown]
# ## A free angle
#
# Where an angle $t$ is free, the next step may not be possible for each value: a wrist with twists of 61° does not
# bend in every direction, and a triangle has to reach. Both ask that a scalar product with a vector that $t$ turns lies
# in an interval, $|f(t)-f_0|\le b$ with $f=f_c\cos t+f_s\sin t+f_1$.

# %%
x_turned = sp.Matrix(d.vector("x", r"\vec x", "a vector that a free angle turns", "1"))
y_held = sp.Matrix(d.vector("y", r"\vec y", "a vector that it does not turn", "1"))
f_c, f_s = (
    x_turned[0] * y_held[0] + x_turned[1] * y_held[1],
    x_turned[0] * y_held[1] - x_turned[1] * y_held[0],
)
d.check(
    "free-angle",
    equal((rz(1) * x_turned).dot(y_held), c1 * f_c + s1 * f_s + x_turned[2] * y_held[2]),
    text="The product with a turned vector.",
).prove()

# %%
at = d.symbol("at", r"\kappa", "the value of fc cos t + fs sin t that is wanted", "1")
aside = d.symbol("rest", r"q", "√(fc² + fs² - κ²)", "1")
fc, fs = d.symbol("along", "f_c", "factor of cos t", "1"), d.symbol("across", "f_s", "factor of sin t", "1")
chosen_c, chosen_s = (fc * at - fs * aside) / (fc**2 + fs**2), (fs * at + fc * aside) / (fc**2 + fs**2)
mirrored_c = ((fc**2 - fs**2) * chosen_c + 2 * fc * fs * chosen_s) / (fc**2 + fs**2)
mirrored_s = (2 * fc * fs * chosen_c - (fc**2 - fs**2) * chosen_s) / (fc**2 + fs**2)
on_circle = {aside: aside**2 + at**2 - fc**2 - fs**2}
d.check(
    "free-angle-chosen",
    equal(fc * chosen_c + fs * chosen_s, at),
    equal(fc * mirrored_c + fs * mirrored_s, at),
    equal(chosen_c**2 + chosen_s**2, 1),
    equal(mirrored_c**2 + mirrored_s**2, 1),
    text="An angle with the value κ, and its mirror image.",
).prove(modulo=on_circle)

# %% [markdown]
# ## The kernels
#
# One straight-line program gives all eight solutions, with a status each; those that exist come first.
# Cosines and sines are carried as pairs; angles are taken at the very end, so that none has to be brought back into its
# range. Where an angle is not determined (the wrist's centre on $\vec S_1$, the elbow folded on joint 2, axes 4 and 6
# in line) the status is FAMILY, and the free angle is zero wherever that leaves a solution; where two solutions meet,
# one is given, as DOUBLE.


# %%
class RobotStatus(IntEnum):
    """Kind of one slot of the solutions.

    REGULAR: a solution that stands alone.
    DOUBLE: two solutions meet here; the slot of the other one is empty.
    FAMILY: an angle is free; the representative has zero there, where zero leaves a solution.
    NONE: no solution; the value is NaN.
    INVALID: the pose is not finite, or not a pose; the value is NaN.
    """

    REGULAR = 0
    DOUBLE = 1
    FAMILY = 2
    NONE = 3
    INVALID = 5


ROUNDINGS = 64
"""Multiple of eps times the sum of all lengths within which two solutions meet: some thirty roundings lead there, and
the pose has as many."""
SURE = 64
"""What of that rounding mostly is: within it two solutions are taken as one, beyond it one of both is given."""
FREE = 4096
"""Multiple of eps below which a vector has no direction: poses with 12 digits are that exact."""
KNOWN = 32
"""Multiple of the square root of eps to which an error of an angle is followed: where it is larger, as with the
wrist's centre almost on S1, the steps after it make up for it, and nothing meets."""
POSE = sp.Rational(1, 10**6)
"""How far a matrix may be from a rotation."""


def total(values):
    return sum((abs(x) for x in values), sp.S.Zero)


def larger(a, b):
    return select(a > b, a, b)


def roots(k, name, A, B, D, tolerance, free, more=sp.S.Zero):
    """Both solutions of A c + B s + D = 0 as (cosine, sine, exists, is double, is free), and their error.

    `tolerance` is the rounding error of the equation; by `more` it may miss a solution and still have one, which is
    then double. Below `free` all coefficients are nothing, and the angle is any.
    """
    r = k.let(f"{name}_r", sp.sqrt(A**2 + B**2))
    room = k.let(f"{name}_room", r - abs(D))
    any_angle = k.let(f"{name}_free", (r <= free) & (abs(D) <= free))
    double = k.let(f"{name}_double", (room <= tolerance) & sp.Not(any_angle))
    exists = k.let(f"{name}_exists", any_angle | ((room >= -tolerance - more) & (r > 0)))
    q = k.let(f"{name}_q", sp.sqrt(select(room > tolerance / SURE, room * (r + abs(D)), 0)))
    size = k.let(f"{name}_size", r * sp.sqrt(D**2 + q**2))
    scale = k.let(f"{name}_scale", 1 / select(size > 0, size, 1))
    found = []
    for letter, sign in (("a", 1), ("b", -1)):
        cosine = k.let(f"{name}_c_{letter}", select(any_angle, 1, (-A * D - sign * B * q) * scale))
        sine = k.let(f"{name}_s_{letter}", select(any_angle, 0, (-B * D + sign * A * q) * scale))
        there = exists if sign > 0 else k.let(f"{name}_two", exists & sp.Not(double | any_angle))
        found.append((cosine, sine, there, double, any_angle))
    # the derivative of the equation is q; where it vanishes the error is a square root
    slope = k.let(f"{name}_slope", q**2 + r * tolerance)
    regular = sp.Not(any_angle) & (slope > 0)
    error = k.let(
        f"{name}_error", select(regular, tolerance / sp.sqrt(select(slope > 0, slope, 1)), sp.S.Zero)
    )
    return found, error


def bend(k, name, row3, h, cosine, sine, error):
    """Both θ5 from the cosine and the sine between the outer axes: (c5, s5, exists, is double, is free, is any).

    `error` is how far, in rad, the axes may be off by what was computed before. The other angle counts as
    free within that error, but as arbitrary only where its direction is nothing but rounding.
    """
    (c_45, c_56), (s_45, s_56) = cosine, sine
    ahead = row3 >= 0
    denominator = k.let(f"{name}_denominator", 1 + abs(row3))
    apart = k.let(f"{name}_apart", select(ahead, c_45 - c_56, c_45 + c_56))
    product = k.let(f"{name}_product", select(ahead, c_45 * c_56, -c_45 * c_56))
    gram = k.let(f"{name}_gram", h**2 * (1 - 2 * product / denominator) - apart**2)
    rounding = k.let(f"{name}_rounding", ROUNDINGS * EPS * (h + apart**2))
    tolerance = k.let(f"{name}_tolerance", rounding + (2 * h + error) * error)
    exists = k.let(f"{name}_exists", gram >= -tolerance)
    free = k.let(f"{name}_free", (h <= FREE * EPS + 4 * error) & exists)
    any_angle = k.let(f"{name}_any", (h <= FREE * EPS) & exists)
    double = k.let(f"{name}_double", (gram <= tolerance) & sp.Not(free))
    q = k.let(f"{name}_q", sp.sqrt(select(gram > rounding / SURE, gram, 0)))
    along = k.let(f"{name}_along", c_45 * c_56 - row3)
    size = k.let(f"{name}_size", sp.sqrt(along**2 + q**2))
    scale = k.let(f"{name}_scale", select(s_45 * s_56 < 0, -1, 1) / select(size > 0, size, 1))
    cosine_5, sine_5 = k.let(f"{name}_c", along * scale), k.let(f"{name}_s", q * scale)
    two = k.let(f"{name}_two", exists & sp.Not(double | any_angle))
    return [
        (cosine_5, sine_5, exists, double, free, any_angle),
        (cosine_5, -sine_5, two, double, free, any_angle),
    ]


def direction(k, name, x, y, u, v, free):
    """Return cosine and sine of the angle from (x, y) to (u, v); of zero where it is free."""
    c, s = k.let(f"{name}_dot", x * u + y * v), k.let(f"{name}_cross", x * v - y * u)
    size = k.let(f"{name}_size", sp.sqrt(c**2 + s**2))
    scale = k.let(f"{name}_scale", 1 / select(size > 0, size, 1))
    return (
        k.let(f"{name}_c", select(free, 1, c * scale)),
        k.let(f"{name}_s", select(free, 0, s * scale)),
    )


def freed(k, name, along, across, fixed, centre, width):
    """Two choices of a free angle t: cosine and sine of the first and of the second, and whether there is a second.

    What follows needs along cos t + across sin t + fixed within `width` of `centre`. Zero is chosen where it serves,
    else an angle that comes nearest the centre. Where both extremes are out of reach the angles that serve are two
    arcs, each the other's mirror image: two families, so the second choice is the first one mirrored.
    """
    square = k.let(f"{name}_square", along**2 + across**2)
    size = k.let(f"{name}_amplitude", sp.sqrt(square))
    scale = k.let(f"{name}_per_square", 1 / select(square > 0, square, 1))
    serves = k.let(f"{name}_serves", (abs(along + fixed - centre) <= width) | (square <= 0))
    wanted = centre - fixed
    at = k.let(f"{name}_at", select(wanted > size, size, select(wanted < -size, -size, wanted)))
    rest = k.let(f"{name}_rest", sp.sqrt(select(square > at**2, square - at**2, 0)))
    c = k.let(f"{name}_c_first", select(serves, 1, (along * at - across * rest) * scale))
    s = k.let(f"{name}_s_first", select(serves, 0, (across * at + along * rest) * scale))
    c_twice, s_twice = (along**2 - across**2) * scale, 2 * along * across * scale
    mirrored = (
        k.let(f"{name}_c_second", c_twice * c + s_twice * s),
        k.let(f"{name}_s_second", s_twice * c - c_twice * s),
    )
    split = k.let(f"{name}_split", (size - wanted > width) & (size + wanted > width))
    return (c, s), mirrored, split


def seen_through(x, y):
    """What a vector's turning about z makes of its product with another one: times cosine, times sine, and constant."""
    return x[0] * y[0] + x[1] * y[1], x[0] * y[1] - x[1] * y[0], x[2] * y[2]


def triangle(k, name, end, forearm, a, square, spare, error, more=sp.S.Zero, needs=None):
    """θ2 and θ3 of both triangles with the sides a23 and l and the third side `end`, and their error.

    `error` is the length by which the end may be off, and `more` one by which it may be brought nearer.

    Where θ2 is free, what follows may need it: `needs` gives the arguments of :func:`freed` for a pair of θ3.
    """
    l1, l2 = forearm
    side = k.let(f"{name}_side", sp.sqrt(end.dot(end)))
    area = k.let(f"{name}_area", ROUNDINGS * EPS * spare**2 + 2 * side * error)
    third, error_3 = roots(
        k,
        f"{name}_3",
        2 * a * l1,
        -2 * a * l2,
        square - side**2,
        area,
        FREE * EPS * spare**2,
        2 * side * more,
    )
    found = []
    any_2 = k.let(f"{name}_any", total(end) <= FREE * EPS * spare)
    for number, (letter, (c, s, exists, double, any_3)) in enumerate(zip("ab", third, strict=True)):
        arm = k.let(f"{name}_arm_{letter}", sp.Matrix([a + c * l1 - s * l2, s * l1 + c * l2]))
        c_2, s_2 = direction(k, f"{name}_2_{letter}", arm[0], arm[1], end[0], end[1], any_2)
        if needs is not None:
            *choices, split = freed(k, f"{name}_free_{letter}", *needs(c, s))
            c_2 = k.let(f"{name}_chosen_c_{letter}", select(any_2, choices[number][0], c_2))
            s_2 = k.let(f"{name}_chosen_s_{letter}", select(any_2, choices[number][1], s_2))
            if number:
                exists = k.let(f"{name}_more", exists | (third[0][2] & any_2 & split))
        found.append((c_2, s_2, c, s, exists, double, any_3 | any_2))
    error_2 = select(any_2, sp.S.Zero, error / select(side > 0, side, 1))
    return found, k.let(f"{name}_error", error_2 + error_3)


def known(error):
    """Return the error of an angle, limited to the largest one that is tracked."""
    return select(error < KNOWN * sp.sqrt(EPS), error, KNOWN * sp.sqrt(EPS))


def angle(k, name, c, s):
    """Return an angle in (-π, π]."""
    value = k.let(name, sp.atan2(s, c))
    return select(value > -sp.pi, value, sp.pi)


def begin(name, summary, notes):
    k = KernelBuilder(
        name,
        summary=summary,
        source="Crane and Duffy, robots with closed forms; derivation robots_6r",
        notes=notes,
    )
    pose = k.input("pose", (4, 4), unit="1, length", doc="transform from the end to the base")
    a = k.input("a", 5, unit="length", doc="a12, a23, a34, a45, a56")
    cosine = k.input("cosine", 5, unit="1", doc="cosines of the twists alpha12 to alpha56")
    sine = k.input("sine", 5, unit="1", doc="sines of the twists")
    offset = k.input("offset", 6, unit="length", doc="S1 to S6")
    R = pose[:3, :3]
    gram = R.T * R - sp.eye(3)
    rough = k.let("rough", total(gram) + total(pose[3, :3]) + abs(pose[3, 3] - 1))
    handed = k.let("handed", R[:, 0].dot(R[:, 1].cross(R[:, 2])))
    spare = k.let("spare", total([*pose[:3, 3], *a, *offset]))
    good = k.let("good", (rough <= POSE) & (handed > 0) & (spare <= LARGEST))
    near = k.let("near", good & (spare <= sp.sqrt(LARGEST) * EPS))
    W = k.let("centre", pose[:3, 3] - sp.Matrix([0, 0, offset[0]]) - offset[5] * R[:, 2])
    return k, R, W, a, cosine, sine, offset, spare, good, near


def first_angle(k, W, cosine, sine, height, spare):
    return roots(
        k,
        "first",
        -sine[0] * W[1],
        sine[0] * W[0],
        cosine[0] * W[2] - height,
        ROUNDINGS * EPS * spare,
        FREE * EPS * spare,
    )


def seen_from_2(k, letter, R, W, c, s, a12, c_12, s_12):
    """W in the plane of joint 2, and the end's axes in its axes."""
    side = k.let(f"side_{letter}", -s * W[0] + c * W[1])
    end = k.let(f"end_{letter}", sp.Matrix([c * W[0] + s * W[1] - a12, c_12 * side + s_12 * W[2]]))
    return end, axes_from_2(k, letter, R, c, s, c_12, s_12)


def axes_from_2(k, letter, R, c, s, c_12, s_12):
    return k.let(
        f"axes_{letter}", coordinate_rotation("x", c_12, s_12).T * (coordinate_rotation("z", c, s).T * R)
    )


def moved_up(k, rows):
    """Return the rows with the existing ones first, in their order: each moves by the number of holes before it.

    A row is (exists, values). The bits of that number move rows by 1, by 2 and by 4, and no two meet on the way.
    """
    there = [row[0] for row in rows]
    values, holes = [], sp.S.Zero
    for n, row in enumerate(rows):
        values.append([k.let(f"holes_{n}", holes), *row[1]])
        holes += select(row[0], 0, 1)
    for step in (1, 2, 4):
        moves = []
        for n in range(8):
            left = values[n][0]  # how far it still has to go: a multiple of the step
            odd = sp.S.false
            for multiple in range(step, 8, 2 * step):
                odd |= sp.Eq(left, multiple)
            moves.append(k.let(f"moves_{step}_{n}", there[n] & odd) if n >= step else sp.S.false)
        now, shifted = [], []
        for n in range(8):
            come = moves[n + step] if n + step < 8 else sp.S.false
            now.append(k.let(f"there_{step}_{n}", come | (there[n] & sp.Not(moves[n]))))
            if n + step < 8:
                other = [values[n + step][0] - step, *values[n + step][1:]]
                pairs = zip(other, values[n], strict=True)
                shifted.append(
                    [k.let(f"row_{step}_{n}_{i}", select(come, a, b)) for i, (a, b) in enumerate(pairs)]
                )
            else:
                shifted.append(values[n])
        there, values = now, shifted
    return [(here, row[1:]) for here, row in zip(there, values, strict=True)]


def finish(k, slots, good, near):
    """Write out angles and statuses of eight slots: pairs of cosine and sine, existence, double, free."""
    rows = []
    for number, (pairs, exists, double, free) in enumerate(slots, 1):
        there = k.let(f"there_{number}", exists & near)
        code = select(free, RobotStatus.FAMILY, select(double, RobotStatus.DOUBLE, RobotStatus.REGULAR))
        angles = [angle(k, f"angle_{number}_{j}", c, s) for j, (c, s) in enumerate(pairs, 1)]
        rows.append((there, [k.let(f"code_{number}", code), *angles]))
    values, codes = [], []
    for there, (code, *angles) in moved_up(k, rows):
        values += [select(there, value, sp.nan) for value in angles]
        codes.append(
            sp.Piecewise(
                (RobotStatus.INVALID, sp.Not(good)),
                (RobotStatus.NONE, sp.Not(there)),
                (code, True),
                evaluate=False,
            )
        )
    k.output(
        "angles", sp.Matrix(8, 6, values), unit="rad", doc="theta1 to theta6 of each solution, in (-pi, pi]"
    )
    k.status("status", sp.Matrix(codes), RobotStatus, doc="what each slot is")
    return k.build()


def behind_wrist():
    """The kernel for parallel axes 2 and 3 and a wrist."""
    k, R, W, a, cosine, sine, offset, spare, good, near = begin(
        "robot_wrist_reverse",
        "All joint angles of an arm with parallel axes 2 and 3 and a wrist of axes 4, 5, 6.",
        "alpha23, a45, a56 and S5 are taken as zero; s12, s45 and s56 must not be zero.",
    )
    height = k.let("height", offset[1] + offset[2] + cosine[2] * offset[3])
    forearm = k.let("forearm", sp.Matrix([a[2], -sine[2] * offset[3]]))
    square = k.let("square", a[1] ** 2 + forearm.dot(forearm))
    wrist_bends = k.let("bends", sp.Matrix([cosine[3] * cosine[4], abs(sine[3] * sine[4])]))
    slots = []
    roots_1, error_1 = first_angle(k, W, cosine, sine, height, spare)
    off = k.let("off", (ROUNDINGS * EPS + known(error_1)) * spare)
    for number, (i, (c_1, s_1, exists_1, double_1, free_1)) in enumerate(zip("ab", roots_1, strict=True)):
        end, from_2 = seen_from_2(k, i, R, W, c_1, s_1, a[0], cosine[0], sine[0])

        def if_folded(c, s, axis_6=from_2[:, 2]):
            axis_4 = sp.Matrix([s * sine[2], -c * sine[2], cosine[2]])
            return *seen_through(axis_4, axis_6), *wrist_bends

        both, error_23 = triangle(k, f"triangle_{i}", end, forearm, a[1], square, spare, off, needs=if_folded)
        error = k.let(f"error_{i}", known(error_1 + error_23))
        for j, (c_2, s_2, c_3, s_3, exists_3, double_3, free_3) in zip("ab", both, strict=True):
            here = f"{i}{j}"
            c_23 = k.let(f"c_23_{here}", c_2 * c_3 - s_2 * s_3)
            s_23 = k.let(f"s_23_{here}", s_2 * c_3 + c_2 * s_3)
            # with the wrist's centre on S1 the wrist may not bend far enough for every θ1
            axis_4 = sp.Matrix([s_23 * sine[2], -c_23 * sine[2], cosine[2]])
            axis_4 = k.let(f"axis_4_{here}", coordinate_rotation("x", cosine[0], sine[0]) * axis_4)
            *choices, split = freed(k, f"first_{here}", *seen_through(axis_4, R[:, 2]), *wrist_bends)
            first = [
                k.let(f"{letter}_1_{here}", select(free_1, chosen, usual))
                for letter, chosen, usual in zip("cs", choices[number], (c_1, s_1), strict=True)
            ]
            there_1 = exists_1 if number == 0 else k.let(f"more_{here}", exists_1 | (free_1 & split))
            axes = axes_from_2(k, here, R, *first, cosine[0], sine[0])
            N = k.let(
                f"N_{here}",
                coordinate_rotation("x", cosine[2], sine[2]).T
                * (coordinate_rotation("z", c_23, s_23).T * axes),
            )
            h = k.let(f"h_{here}", sp.sqrt(N[0, 2] ** 2 + N[1, 2] ** 2))
            bends = bend(k, f"bend_{here}", N[2, 2], h, cosine[3:, 0], sine[3:, 0], error)
            for m, (c_5, s_5, exists_5, double_5, free_5, any_5) in zip("ab", bends, strict=True):
                slot = f"{here}{m}"
                x = sine[4] * s_5
                y = -cosine[3] * sine[4] * c_5 - sine[3] * cosine[4]
                c_4, s_4 = direction(k, f"fourth_{slot}", x, y, N[0, 2], N[1, 2], any_5)
                u = c_4 * N[0, 0] + s_4 * N[1, 0]
                v = -s_4 * N[0, 0] + c_4 * N[1, 0]
                v_5 = cosine[3] * v + sine[3] * N[2, 0]
                z_5 = -sine[3] * v + cosine[3] * N[2, 0]
                c_6 = k.let(f"c_6_{slot}", c_5 * u + s_5 * v_5)
                s_6 = k.let(f"s_6_{slot}", cosine[4] * (-s_5 * u + c_5 * v_5) + sine[4] * z_5)
                slots.append(
                    (
                        (first, (c_2, s_2), (c_3, s_3), (c_4, s_4), (c_5, s_5), (c_6, s_6)),
                        there_1 & exists_3 & exists_5,
                        double_1 | double_3 | double_5,
                        free_1 | free_3 | free_5,
                    )
                )
    return finish(k, slots, good, near)


def three_parallel():
    """The kernel for parallel axes 2, 3 and 4, and axes 5 and 6 that meet."""
    k, R, W, a, cosine, sine, offset, spare, good, near = begin(
        "robot_parallel_reverse",
        "All joint angles of an arm with parallel axes 2, 3 and 4, and axes 5 and 6 that meet.",
        "alpha23, alpha34 and a56 are taken as zero; s12, s45 and s56 must not be zero.",
    )
    height = k.let("height", offset[1] + offset[2] + offset[3] + cosine[3] * offset[4])
    square = k.let("square", a[1] ** 2 + a[2] ** 2)
    hand = sp.Matrix([a[3], -offset[4] * sine[3]])  # a45 and S5 in the plane, less the turn by θ2 + θ3 + θ4
    width = k.let("width", 2 * abs(a[1] * a[2]))
    # with W on S1 the wrist may not bend far enough for every θ1
    *choices, split = freed(
        k,
        "first_free",
        *seen_through(sp.Matrix([0, -sine[0], cosine[0]]), R[:, 2]),
        cosine[3] * cosine[4],
        abs(sine[3] * sine[4]),
    )
    slots = []
    roots_1, error_1 = first_angle(k, W, cosine, sine, height, spare)
    for number, (i, (c_1, s_1, exists_1, double_1, free_1)) in enumerate(zip("ab", roots_1, strict=True)):
        c_1, s_1 = (
            k.let(f"{letter}_1_{i}", select(free_1, chosen, usual))
            for letter, chosen, usual in zip("cs", choices[number], (c_1, s_1), strict=True)
        )
        if number:
            exists_1 = k.let("first_more", exists_1 | (free_1 & split))
        whole, axes = seen_from_2(k, i, R, W, c_1, s_1, a[0], cosine[0], sine[0])
        h = k.let(f"h_{i}", sp.sqrt(axes[2, 0] ** 2 + axes[2, 1] ** 2))
        bends = bend(
            k, f"bend_{i}", axes[2, 2], h, cosine[3:, 0], sine[3:, 0], k.let(f"error_{i}", known(error_1))
        )
        off = k.let(f"off_{i}", (ROUNDINGS * EPS + known(error_1)) * spare)
        error_6 = (ROUNDINGS * EPS + error_1) / select(h > 0, h, 1)
        for branch, (m, (c_5, s_5, exists_5, double_5, free_5, any_5)) in enumerate(
            zip("ab", bends, strict=True)
        ):
            here = f"{i}{m}"
            x = sine[3] * s_5
            y = cosine[4] * sine[3] * c_5 + sine[4] * cosine[3]
            c_6, s_6 = direction(k, f"sixth_{here}", axes[2, 0], axes[2, 1], x, y, any_5)
            u, v = c_5, -cosine[4] * s_5
            back = sp.Matrix([c_6 * u + s_6 * v, -s_6 * u + c_6 * v, sine[4] * s_5])
            c_234 = k.let(f"c_zero_{here}", (axes[0, :] * back)[0])
            s_234 = k.let(f"s_zero_{here}", (axes[1, :] * back)[0])
            # where S2 and S6 are parallel, θ6 is free, but the triangle may not reach for every θ6
            turned = sp.Matrix([c_234 * hand[0] - s_234 * hand[1], s_234 * hand[0] + c_234 * hand[1]])
            turned = k.let(f"hand_{here}", turned)
            *turns, more = freed(
                k,
                f"turn_{here}",
                -2 * whole.dot(turned),
                -2 * (turned[0] * whole[1] - turned[1] * whole[0]),
                whole.dot(whole) + turned.dot(turned),
                square,
                width,
            )
            c_t, s_t = (select(any_5, x, y) for x, y in zip(turns[branch], (1, 0), strict=True))
            c_t, s_t = k.let(f"c_turn_{here}", c_t), k.let(f"s_turn_{here}", s_t)
            c_6 = k.let(f"c_6_{here}", select(any_5, c_t, c_6))
            s_6 = k.let(f"s_6_{here}", select(any_5, select(axes[2, 2] > 0, -s_t, s_t), s_6))
            if branch:
                exists_5 = k.let(f"bend_more_{here}", exists_5 | (any_5 & more))
            c_234, s_234 = (
                k.let(f"c_234_{here}", c_234 * c_t - s_234 * s_t),
                k.let(f"s_234_{here}", s_234 * c_t + c_234 * s_t),
            )
            end = k.let(
                f"corner_{here}",
                whole - sp.Matrix([c_t * turned[0] - s_t * turned[1], s_t * turned[0] + c_t * turned[1]]),
            )
            # an error of θ6 turns a45 and S5, with no effect at the end
            more = select(any_5, sp.S.Zero, error_6) * total(hand)
            more = k.let(f"more_{here}", select(more < spare, more, spare))
            forearm = (a[2], sp.S.Zero)
            both, _ = triangle(k, f"triangle_{here}", end, forearm, a[1], square, spare, off, more)
            for j, (c_2, s_2, c_3, s_3, exists_3, double_3, free_3) in zip("ab", both, strict=True):
                c_23 = k.let(f"c_23_{here}{j}", c_2 * c_3 - s_2 * s_3)
                s_23 = k.let(f"s_23_{here}{j}", s_2 * c_3 + c_2 * s_3)
                c_4 = k.let(f"c_4_{here}{j}", c_23 * c_234 + s_23 * s_234)
                s_4 = k.let(f"s_4_{here}{j}", c_23 * s_234 - s_23 * c_234)
                slots.append(
                    (
                        ((c_1, s_1), (c_2, s_2), (c_3, s_3), (c_4, s_4), (c_5, s_5), (c_6, s_6)),
                        exists_1 & exists_3 & exists_5,
                        double_1 | double_3 | double_5,
                        free_1 | free_3 | free_5,
                    )
                )
    return finish(k, slots, good, near)


# %% [markdown]
# The pairs of equations as coefficients $M_{eij}$ of $u_iv_j$ with $u=(1,c,s)$ of the first and $v$ of the second
# angle: derivatives of the expressions that are proved above.

# %%
FIRST, SECOND = sp.symbols("c_first s_first", real=True), sp.symbols("c_second s_second", real=True)
PAIRS = {
    "456": (meet_456, "axes 4, 5, 6 meet", "theta2 and theta3"),
    "234": (meet_234, "axes 2, 3, 4 meet", "theta1 and theta6"),
    "parallel_234": (parallel_234, "axes 2, 3, 4 are parallel", "theta1 and theta6"),
    "parallel_123": (parallel_123, "axes 1, 2, 3 are parallel", "theta5 and theta6"),
}


def pair_kernel(name):
    """The kernel of one pair, and its equations in the kernel's inputs."""
    equations, what, angles = PAIRS[name]
    k = KernelBuilder(
        f"robot_pair_{name}",
        summary=f"Two equations in {angles} of an arm whose {what}.",
        source="derivation robots_6r, group 2 of Crane and Duffy: projections and self-scalar products of the loop",
        notes="The numbers that the geometry makes zero are taken as zero, and parallel axes point the same way.",
    )
    pose = k.input("pose", (4, 4), unit="1, length", doc="transform from the end to the base")
    a = k.input("a", 5, unit="length", doc="a12, a23, a34, a45, a56")
    cosine = k.input("cosine", 5, unit="1", doc="cosines of the twists alpha12 to alpha56")
    sine = k.input("sine", 5, unit="1", doc="sines of the twists")
    offset = k.input("offset", 6, unit="length", doc="S1 to S6")
    P = pose[:3, 3] - sp.Matrix([0, 0, offset[0]])
    written = equations(Given(pose[:3, :3], P, a, cosine, sine, offset), FIRST, SECOND)
    zero = dict.fromkeys((*FIRST, *SECOND), 0)
    coefficients = []
    for equation in written:
        for x in (None, *FIRST):
            row = equation if x is None else equation.diff(x)
            coefficients += [(row if y is None else row.diff(y)).xreplace(zero) for y in (None, *SECOND)]
    array = sp.ImmutableDenseNDimArray(coefficients, (2, 3, 3))
    k.output(
        "equations", array, unit="1 or length or length^2", doc="coefficients of u_i v_j in each equation"
    )
    return k.build(), written


pair_kernels = []
for name in PAIRS:
    kernel, written = pair_kernel(name)
    found = kernel.expand("equations")
    u, v = sp.Matrix([1, *FIRST]), sp.Matrix([1, *SECOND])
    d.check(
        f"kernel-{name.replace('_', '-')}",
        *(equal((u.T * found[e].tomatrix() * v)[0], written[e]) for e in (0, 1)),
        text="The kernel's coefficients are those of the equations.",
    ).prove()
    pair_kernels.append(kernel)

# %%
derivation.kernel(behind_wrist(), three_parallel(), *pair_kernels)
derivation.kernels
