# %% [markdown]
# # The reverse analysis of industrial robots: Puma 560, GE P60, Cincinnati T3-776
#
# Given where the end of an arm with six revolute joints is, and how it is turned, find all joint angles that bring it
# there. Two families of arms have a closed form with eight solutions, and the three robots of Crane and Duffy belong to
# them:
#
# * **wrist**: axes 2 and 3 are parallel, and axes 4, 5 and 6 meet in one point (Puma 560, T3-776);
# * **three parallel**: axes 2, 3 and 4 are parallel, and axes 5 and 6 meet (GE P60).
#
# Lengths, twists and offsets are otherwise free. The way is the same in both:
#
# 1. the component of the vector loop along $\vec S_2$ contains no angle but $\theta_1$: two solutions;
# 2. one more equation gives the cosine of $\theta_5$, whose sine may have either sign: two solutions each;
# 3. a triangle in the plane across $\vec S_2$ remains, which may be folded to either side: two solutions each.
#
# Arms beyond these families in which any three consecutive axes meet or are parallel come next: their geometry leaves
# two equations in two angles. At the end the same equations are compared with those of Crane and Duffy, who close the
# arm with a seventh, hypothetical link.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, coordinate_rotation, equal, select

d = derivation = Derivation(
    "robots_6r",
    title="The reverse analysis of robots with six revolute joints, in closed form",
    source="Crane and Duffy, Kinematic Analysis of Robot Manipulators; lecture notes “Robot Geometry”",
)


# %% [markdown]
# ## Symbols
#
# Link $ij$ joins joint $i$ to joint $j=i+1$. Its length $a_{ij}$ is the distance of the two axes $\vec S_i$ and
# $\vec S_j$, its twist $\alpha_{ij}$ the angle between them about their common perpendicular $\vec a_{ij}$. Joint $j$
# has the offset $S_j$ along its axis and the angle $\theta_j$ about it. Frame $j$ has its $x$ axis along the link after
# joint $j$ and its $z$ axis along $\vec S_j$; frame F is that of the base, $z$ along $\vec S_1$. Cosines and sines are
# letters of their own: $c_{ij}$, $s_{ij}$ of a twist, $c_j$, $s_j$ of a joint's angle. $\vec e_x$, $\vec e_y$ and
# $\vec e_z$ are the unit vectors, $R_x$ and $R_z$ rotations about $x$ and $z$.


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
LENGTH = {ij: d.letter(f"a{ij} | a_{{{ij}}} | length of link {ij} | length") for ij in LINKS if ij != "67"}
OFFSET = {j: d.symbol(f"S{j}", f"S_{j}", f"offset of joint {j}", "length") for j in range(1, 8)}
UNIT = {s: c**2 + s**2 - 1 for c, s in (*TWIST.values(), *ANGLE.values())}
X_AXIS, Z_AXIS = sp.Matrix([1, 0, 0]), sp.Matrix([0, 0, 1])


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
TX = {
    ij: d.letter(rf"R_x_{ij}[3,3] | R_x(\alpha_{{{ij}}}) | rotation by the twist of link {ij} | 1", tx(ij))
    for ij in LINKS
}
RZ = {
    j: d.matrix(f"R_z_{j}", rf"R_z(\theta_{j})", f"rotation by the angle of joint {j}", "1", value=rz(j))
    for j in ANGLE
}
e_x = d.letter(r"e_x[3] | \vec e_x | unit vector along x | 1", X_AXIS)
e_z = d.letter(r"e_z[3] | \vec e_z | unit vector along z | 1", Z_AXIS)


PARALLEL_23 = {TWIST["23"][0]: 1, TWIST["23"][1]: 0}
PARALLEL_34 = {c34: 1, s34: 0}
MEET_456 = {LENGTH["45"]: 0, LENGTH["56"]: 0, OFFSET[5]: 0}
d

# %% [markdown]
# ## First family: a wrist behind two parallel axes
#
# The axes 4, 5 and 6 meet in the wrist's centre. The end point is $\vec P$, in the frame of the base; the axis
# $\vec S_6$ is known from the attitude of the end. So the pose gives the wrist's centre without any angle:
# $\vec W=\vec P-S_6\vec S_6$. From the base it is reached by $\theta_1$, $\theta_2$ and $\theta_3$ alone, because it
# is the origin of frame 4. In that frame ${}^4\vec O_6$ is the origin of frame 6, and ${}^4\vec S_6$ its $z$ axis:

# %%
last = moved("45", 5, moved("56", 6, ZERO))
axis_6 = tx("45") * rz(5) * tx("56") * Z_AXIS
origin_6 = d.letter(r"O_6_in_4 | {}^4\vec O_6 | origin of frame 6 in frame 4 | length", last)
axis_6_in_4 = d.letter(r"S_6_in_4 | {}^4\vec S_6 | axis 6 in frame 4 | 1", axis_6)
d.check(
    "wrist-centre",
    equal(origin_6 - OFFSET[6] * axis_6_in_4, ZERO.as_immutable()),
    text="With $a_{45}=a_{56}=S_5=0$ the point $S_6$ before the end is the origin of frame 4.",
).prove(given=MEET_456)

# %% [markdown]
# ### The triangle
#
# Seen from joint 2, before its rotation, the wrist's centre is ${}^2\vec W$. The upper arm is $a_{23}\,\vec e_x$; the
# forearm has the components $(a_{34},-s_{34}S_4)$ in the plane across the parallel axes.

# %%
forearm = sp.Matrix([LENGTH["34"], -s34 * OFFSET[4]])
flat = sp.diag(1, 1, 0)
elbow = LENGTH["23"] * X_AXIS + rz(3) * sp.Matrix([*forearm, 0])
reached = OFFSET[2] * Z_AXIS + rz(2) * moved("23", 3, moved("34", 4, ZERO))
seen_W = d.letter(r"W_in_2 | {}^2\vec W | the wrist's centre, seen from joint 2 | length", reached)
d.check(
    "wrist-plane",
    equal(
        seen_W,
        RZ[2] * (sp.ImmutableMatrix([LENGTH["23"], 0, 0]) + RZ[3] * sp.ImmutableMatrix([*forearm, 0]))
        + (OFFSET[2] + OFFSET[3] + c34 * OFFSET[4]) * e_z,
    ),
    text="With axes 2 and 3 parallel, the wrist's centre moves in a plane across them, at the end of an upper arm that "
    "turns by $\\theta_2$ and a forearm that turns by $\\theta_2+\\theta_3$.",
).prove(given=PARALLEL_23)

# %% [markdown]
# ### The first angle
#
# The height of that plane along $\vec S_2$ is a constant, $H=S_2+S_3+c_{34}S_4$. The pose gives the same height with
# $\theta_1$ in it. $\vec W$ is counted from the origin of F, less $S_1$ along $z$; $h_2$ is its component along
# $\vec S_2$, $h_2=\vec e_z^T\,R_x(\alpha_{12})^T\bigl(R_z(\theta_1)^T\,\vec W-a_{12}\,\vec e_x\bigr)$.

# %%
W = d.vector("W", r"\vec W", "the wrist's centre, from the origin of F, less S1 along its z axis", "length")
height = d.symbol("height", "H", "S2 + S3 + c34 S4, or S2 + S3 + S4 + c45 S5", "length")
before_2 = tx("12").T * (rz(1).T * sp.Matrix(list(W)) - LENGTH["12"] * X_AXIS)
equation_1 = -s12 * W.components[1] * c1 + s12 * W.components[0] * s1 + c12 * W.components[2] - height
along_2 = d.letter("h_2 | h_2 | component of the wrist's centre along S2 | length", (Z_AXIS.T * before_2)[0])
d.check(
    "theta1",
    equal(along_2 - height, equation_1),
    text="$h_2=H$ is an equation $A\\,c_1+B\\,s_1+D=0$ in $\\theta_1$ alone, with $A=-s_{12}W_2$, $B=s_{12}W_1$ and "
    "$D=c_{12}W_3-H$. The length $a_{12}$ is not in it.",
).prove(modulo=UNIT)

# %% [markdown]
# ### The second and the third angle
#
# With $\theta_1$ the end $\vec w=(w_x,w_y)$ of the triangle is known. With $(l_1,l_2)$ for the forearm, the arm in the
# direction of link 23 is $\vec u=(a_{23}+c_3l_1-s_3l_2,\ s_3l_1+c_3l_2)$, and $\vec w$ is $\vec u$ turned by
# $\theta_2$.

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
w_squared = d.letter(
    r"w_squared | |\vec w|^2 | square of the triangle's third side | length²", turned.dot(turned)
)
u_squared = d.letter(r"u_squared | |\vec u|^2 | square of the arm's length | length²", arm.dot(arm))
u_dot_w = d.letter(r"u_dot_w | \vec u\cdot\vec w | scalar product | length²", arm.dot(turned))
u_cross_w = d.letter(
    "u_cross_w | u_xw_y-u_yw_x | their cross product | length²", arm[0] * turned[1] - arm[1] * turned[0]
)
d.check(
    "theta3",
    equal(w_squared, 2 * a23 * l1 * c3 - 2 * a23 * l2 * s3 + a23**2 + l1**2 + l2**2),
    text="The length of the triangle's third side contains $\\theta_3$ alone: again an equation "
    "$A\\,c_3+B\\,s_3+D=0$, with two solutions.",
).prove(modulo=UNIT)

# %%
d.check(
    "theta2",
    equal(u_dot_w, u_squared * c2),
    equal(u_cross_w, u_squared * s2),
    text="Then $\\theta_2$ is the angle from $\\vec u$ to $\\vec w$.",
).prove()

# %% [markdown]
# ### The wrist
#
# The rotations before the wrist are now known. The attitude of the end, multiplied by their inverses, is the rotation
# of the wrist,
# $$N=R_z(\theta_4)R_x(\alpha_{45})R_z(\theta_5)R_x(\alpha_{56})R_z(\theta_6).$$
# Write $p=s_{56}s_5$ and $q=-(c_{45}s_{56}c_5+s_{45}c_{56})$.

# %%
wrist = rz(4) * tx("45") * rz(5) * tx("56") * rz(6)
p, q = s56 * s5, -c45 * s56 * c5 - s45 * c56
N = d.matrix("N", "N", "rotation of the wrist", "1", value=wrist)
letter_p = d.letter("p_wrist | p | s56 s5 | 1", p)
letter_q = d.letter("q_wrist | q | −(c45 s56 c5 + s45 c56) | 1", q)
d.check(
    "wrist-column",
    equal(
        N * e_z,
        sp.ImmutableMatrix(
            [letter_p * c4 - letter_q * s4, letter_p * s4 + letter_q * c4, c45 * c56 - s45 * s56 * c5]
        ),
    ),
    text="The last column of $N$ contains $\\theta_4$ and $\\theta_5$. Its last entry gives the cosine of $\\theta_5$, "
    "whose sine may have either sign; the other two then give $\\theta_4$.",
).prove()

# %%
wrist_4 = rz(4).T * sp.Matrix(list(d.vector("n", r"\vec n", "first column of N", "1")))
n = sp.Matrix(sp.symbols("n_1 n_2 n_3", real=True))
from_left = tx("56").T * rz(5).T * tx("45").T * rz(4).T
d.check(
    "theta6",
    equal(TX["56"].T * RZ[5].T * TX["45"].T * RZ[4].T * N * e_x, sp.ImmutableMatrix([c6, s6, 0])),
    text="The first column of $N$, turned back by all that is known, gives $\\theta_6$. So an error of $\\theta_4$, "
    "which is large near a singular wrist, does not spoil the attitude: $\\theta_6$ makes up for it.",
).prove(modulo=UNIT)

# %% [markdown]
# The sine of $\theta_5$ follows from its cosine, but near a singular wrist, where axes 4 and 6 are in line, that loses
# half of the digits. Better is a form with the sine $h$ between the two axes, which the pose gives to rounding;
# $N_{33}$ is their cosine, $c_{45}c_{56}-s_{45}s_{56}c_5$.

# %%
x3 = d.letter("n33 | N_{33} | cosine between axes 4 and 6 (or 2 and 6) | 1", c45 * c56 - s45 * s56 * c5)
h = d.symbol("h", "h", "sine between axes 4 and 6 (or 2 and 6)", "1")
square = (s45 * s56 * s5) ** 2
between = {h: h**2 + x3**2 - 1}
d.check(
    "sine-of-theta5",
    equal(square * (1 + x3), h**2 * (1 + x3 - 2 * c45 * c56) - (c45 - c56) ** 2 * (1 + x3)),
    equal(square * (1 - x3), h**2 * (1 - x3 + 2 * c45 * c56) - (c45 + c56) ** 2 * (1 - x3)),
    text="Two expressions for $(s_{45}s_{56}s_5)^2$, here times $1\\pm N_{33}$: "
    "$h^2\\bigl(1-\\tfrac{2c_{45}c_{56}}{1+N_{33}}\\bigr)-(c_{45}-c_{56})^2$ and "
    "$h^2\\bigl(1+\\tfrac{2c_{45}c_{56}}{1-N_{33}}\\bigr)-(c_{45}+c_{56})^2$. In one of the two nothing cancels near a "
    "singular wrist, where $h$ is small.",
).prove(modulo={**between, **UNIT})

# %% [markdown]
# ## Second family: three parallel axes
#
# Now axes 2, 3 and 4 are parallel, and axes 5 and 6 meet, $a_{56}=0$. The point $\vec W=\vec P-S_6\vec S_6$ is the
# origin of frame 5; ${}^5\vec O_6$ and ${}^5\vec S_6$ are origin and axis of frame 6 in it.

# %%
d.check(
    "crossing",
    equal(
        d.letter(r"O_6_in_5 | {}^5\vec O_6 | origin of frame 6 in frame 5 | length", moved("56", 6, ZERO))
        - OFFSET[6] * d.letter(r"S_6_in_5 | {}^5\vec S_6 | axis 6 in frame 5 | 1", tx("56") * Z_AXIS),
        ZERO.as_immutable(),
    ),
    text="With $a_{56}=0$ the point $S_6$ before the end is the origin of frame 5.",
).prove(given={LENGTH["56"]: 0})

# %% [markdown]
# Seen from joint 2, the origin of frame 5 is ${}^2\vec O_5$. The last link of the plane, $a_{45}$, and the offset $S_5$
# have directions that depend on the sum $\theta_2+\theta_3+\theta_4$ only.

# %%
to_5 = OFFSET[2] * Z_AXIS + rz(2) * moved("23", 3, moved("34", 4, moved("45", 5, ZERO)))
plane_4 = rz(2) * rz(3) * rz(4)
d.check(
    "parallel-plane",
    equal(
        d.letter(r"O_5_in_2 | {}^2\vec O_5 | origin of frame 5, seen from joint 2 | length", to_5)
        - RZ[2] * RZ[3] * RZ[4] * (LENGTH["45"] * e_x + OFFSET[5] * (TX["45"] * e_z)),
        RZ[2] * (a23 * e_x + RZ[3] * (LENGTH["34"] * e_x)) + (OFFSET[2] + OFFSET[3] + OFFSET[4]) * e_z,
    ),
    text="Less $a_{45}$ and $S_5$, the same triangle is left, with the forearm $a_{34}$.",
).prove(given={**PARALLEL_23, **PARALLEL_34})

# %% [markdown]
# The equation of $\theta_1$ is as before, with another height:

# %%
c45_S5 = (Z_AXIS.T * plane_4 * tx("45") * Z_AXIS)[0]
d.check(
    "parallel-height",
    equal(d.letter(r"S_2_dot_S_5 | \vec S_2\cdot\vec S_5 | cosine between axes 2 and 5 | 1", c45_S5), c45),
    text="The angle between $\\vec S_2=\\vec S_4$ and $\\vec S_5$ is the twist $\\alpha_{45}$. So the offset $S_5$ "
    "adds $c_{45}S_5$ along $\\vec S_2$, and $H=S_2+S_3+S_4+c_{45}S_5$.",
).prove()

# %%
row = (Z_AXIS.T * tx("45") * rz(5) * tx("56") * rz(6)).T
p_row, q_row = s45 * s5, c56 * s45 * c5 + s56 * c45
letter_p_row = d.letter("p_row | p' | s45 s5 | 1", p_row)
letter_q_row = d.letter("q_row | q' | c56 s45 c5 + s56 c45 | 1", q_row)
d.check(
    "parallel-row",
    equal(
        RZ[6].T * TX["56"].T * RZ[5].T * TX["45"].T * e_z,
        sp.ImmutableMatrix(
            [
                letter_p_row * c6 + letter_q_row * s6,
                letter_q_row * c6 - letter_p_row * s6,
                c45 * c56 - s45 * s56 * c5,
            ]
        ),
    ),
    text="$\\vec S_2$, seen from the end, contains $\\theta_5$ and $\\theta_6$: its last component gives the cosine of "
    "$\\theta_5$ as in a wrist, the other two then $\\theta_6$, with $p'=s_{45}s_5$ and "
    "$q'=c_{56}s_{45}c_5+s_{56}c_{45}$.",
).prove()

# %%
base_to_4 = tx("45") * rz(5) * tx("56") * rz(6)
to_link_4 = RZ[2] * RZ[3] * RZ[4]
d.check(
    "parallel-sum",
    equal(
        to_link_4
        * TX["45"]
        * RZ[5]
        * TX["56"]
        * RZ[6]
        * (RZ[6].T * TX["56"].T * sp.ImmutableMatrix([c5, -s5, 0])),
        to_link_4 * e_x,
    ),
    text="Then the $x$ axis of frame 4 is known in the frame of the end, the bracket on the left. The attitude of the "
    "end takes it to joint 2, and there its direction is $\\theta_2+\\theta_3+\\theta_4$.",
).prove(modulo=UNIT)

# %% [markdown]
# ## Arms with a pair of equations
#
# Any three consecutive axes that meet or are parallel leave two equations in two angles, each linear in $(1,c,s)$ of
# either angle. They are written with the pose of the end, its attitude $R$ and its origin $\vec P$, less $S_1$ along
# $\vec S_1$. Each equation is proved to hold for every pose that such a chain reaches. Chains with such axes at the
# other end are read backwards.


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


# %% [markdown]
# ### Axes 4, 5 and 6 meet
#
# Let $\vec t=(a_{34},\,-s_{34}S_4,\,S_3+c_{34}S_4)$ lead from the axis of joint 3 to the wrist's centre,
# $\vec v=a_{23}\vec e_x+R_x(\alpha_{23})R_z(\theta_3)\,\vec t$ the same from joint 2, and
# $\vec v\,'=R_z(\theta_2)\,\vec v$. The distance of the wrist's centre $\vec W=\vec P-S_6R\,\vec e_z$ from the origin
# of F, and its height along $\vec S_1$, do not depend on $\theta_1$. (This is Pieper's pair of equations.)


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
distance, level = meet_456(of_letters(R_456, P_456, MEET_456), ANGLE[2], ANGLE[3])
d.check(
    "pieper",
    equal(
        d.letter(
            r"pieper_distance | a_{12}^2+S_2^2+2a_{12}v'_x+2S_2v_z+|\vec v|^2-|\vec W|^2 | "
            r"first equation, axes 4, 5, 6 meet | length²",
            distance,
        ),
        0,
    ),
    equal(
        d.letter(
            "pieper_height | c_{12}S_2+s_{12}v'_y+c_{12}v'_z-W_z | second equation, axes 4, 5, 6 meet | length",
            level,
        ),
        0,
    ),
    text="Distance and height of the wrist's centre: two equations in $\\theta_2$ and $\\theta_3$.",
).prove(modulo=UNIT)


# %% [markdown]
# ### Axes 2, 3 and 4 meet
#
# They meet in a point $\vec m$ that the base turns by $\theta_1$ alone: $\vec m=R_z(\theta_1)\,(a_{12},\,-s_{12}S_2,\,
# c_{12}S_2)$. Seen from the end it is $\vec n=R^T(\vec m-\vec P)$, and $\vec n'=R_z(\theta_6)\,\vec n$ after joint 6 is
# undone. The same point lies $S_4$ before frame 4, so its height over joint 5 and its distance from it are constants of
# the arm.


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
before_4 = d.letter(
    r"meeting_from_3 | {}^3\vec m | where the axes meet, from link 23 | length",
    moved("34", 4, -OFFSET[4] * Z_AXIS).subs(MEET_234),
)
from_the_end = d.letter(
    r"meeting_from_end | {}^4\vec m | where they meet, from the end by joints 6 and 5 | length",
    moved("45", 5, moved("56", 6, of_6)),
)
level, distance = meet_234(meeting, ANGLE[1], ANGLE[6])
d.check(
    "meeting-in-the-middle",
    equal(before_4, ZERO.as_immutable()),
    equal(from_the_end, -OFFSET[4] * e_z),
    equal(
        d.letter(
            "middle_height | s_{56}n'_y+c_{56}(S_6+n_z)+c_{45}S_4+S_5 | first equation, axes 2, 3, 4 meet | length",
            level,
        ),
        0,
    ),
    equal(
        d.letter(
            r"middle_distance | a_{56}^2+S_6^2+2a_{56}n'_x+2S_6n_z+|\vec n|^2-a_{45}^2-s_{45}^2S_4^2-(c_{45}S_4+S_5)^2"
            r" | second equation, axes 2, 3, 4 meet | length²",
            distance,
        ),
        0,
    ),
    text="The point where the axes meet is the origin of frame 3, and it is $S_4$ before frame 4, as reached from the "
    "end. Its height and its distance are two equations in $\\theta_1$ and $\\theta_6$, for any rotation of the three "
    "joints.",
).prove(modulo=UNIT)


# %% [markdown]
# ### Axes 2, 3 and 4 are parallel
#
# Their common direction is $\vec S_2=R_z(\theta_1)R_x(\alpha_{12})\,\vec e_z$ in the base, and
# $\vec\sigma=R^T\vec S_2$ from the end. Seen from the end, axis 5 is
# $\vec S_5=R_z(\theta_6)^TR_x(\alpha_{56})^T\,\vec e_z$, and $\vec k=-a_{56}R_z(\theta_6)^T\vec e_x-S_6\,\vec e_z$
# leads to the origin of frame 5. Where frame 4 is in the plane does not matter: $(x_4,y_4)$ is any place.


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
plane = sp.Matrix(
    [d.letter(f"{name}_4 | {name}_4 | place of a frame in the plane, along {name} | length") for name in "xy"]
    + [0]
)
height_4 = (OFFSET[2] + OFFSET[3] + OFFSET[4]) * Z_AXIS
P_parallel = rz(1) * (LENGTH["12"] * X_AXIS + tx("12") * (plane + height_4)) + turned_4 * moved(
    "45", 5, moved("56", 6, ZERO)
)
twist_left, height_left = parallel_234(of_letters(R_parallel, P_parallel, PARALLEL_234), ANGLE[1], ANGLE[6])
d.check(
    "three-parallel",
    equal(
        d.letter(
            r"O_4_in_2 | {}^2\vec O_4 | origin of frame 4, seen from joint 2 | length",
            (to_5 - plane_4 * moved("45", 5, ZERO)).subs(PARALLEL_234),
        ),
        RZ[2] * (a23 * e_x + RZ[3] * (LENGTH["34"] * e_x)) + (OFFSET[2] + OFFSET[3] + OFFSET[4]) * e_z,
    ),
    equal(
        d.letter(
            r"parallel_twist | \vec\sigma\cdot\vec S_5-c_{45} | first equation, axes 2, 3, 4 parallel | 1",
            twist_left,
        ),
        0,
    ),
    equal(
        d.letter(
            r"parallel_height | \vec S_2\cdot\vec P+\vec\sigma\cdot\vec k-(S_2+S_3+S_4+c_{45}S_5) | "
            r"second equation, axes 2, 3, 4 parallel | length",
            height_left,
        ),
        0,
    ),
    equal(RZ[5].T * TX["45"].T * e_z, sp.ImmutableMatrix([s45 * s5, s45 * c5, c45])),
    text="The origin of frame 4 moves in the plane across $\\vec S_2$. Wherever it is, the angle between axes 2 and 5 "
    "and the loop along $\\vec S_2$ are two equations in $\\theta_1$ and $\\theta_6$. Then $\\vec S_2$, seen from "
    "frame 5, gives $\\theta_5$.",
).prove(modulo=UNIT)


# %% [markdown]
# ### Axes 1, 2 and 3 are parallel
#
# Their direction $\vec S_1$, seen from the end, is the last row of $R$: $\vec\sigma=R^T\vec e_z$. Seen from the end,
# joints 6 and 5 undone, the axes 4 and 5 are $\vec S_4$ and $\vec S_5$, and $\vec x_4$ and $\vec x_5$ are the
# directions of links 45 and 56.


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
twist_left, height_left = parallel_123(of_letters(R_123, P_123, {}), ANGLE[5], ANGLE[6])
d.check(
    "three-parallel-first",
    equal(
        d.letter(
            r"first_twist | \vec\sigma\cdot\vec S_4-c_{34} | first equation, axes 1, 2, 3 parallel | 1",
            twist_left,
        ),
        0,
    ),
    equal(
        d.letter(
            r"first_height | c_{34}S_4+a_{45}\,\vec\sigma\cdot\vec x_4+S_5\,\vec\sigma\cdot\vec S_5"
            r"+a_{56}\,\vec\sigma\cdot\vec x_5+S_6\sigma_z+S_2+S_3-P_z | "
            "second equation, axes 1, 2, 3 parallel | length",
            height_left,
        ),
        0,
    ),
    equal(RZ[4].T * TX["34"].T * e_z, sp.ImmutableMatrix([s34 * s4, s34 * c4, c34])),
    text="Frame 3 is anywhere in the plane, turned by any angle. The angle between axes 1 and 4 and the loop along "
    "$\\vec S_1$ are two equations in $\\theta_5$ and $\\theta_6$. Then $\\vec S_1$, seen from frame 4, gives "
    "$\\theta_4$.",
).prove(modulo=UNIT)

# %% [markdown]
# ## The same with the hypothetical link
#
# Crane and Duffy close the arm with a seventh, hypothetical link, and write the equations of the spherical heptagon
# that the seven axes make. Their short names are components of an axis, seen from a link some joints further on. For
# one joint, without a bar,
# $$X_j=s_{ij}s_j,\qquad Y_j=-(s_{jk}c_{ij}+c_{jk}s_{ij}c_j),\qquad Z_j=c_{jk}c_{ij}-s_{jk}s_{ij}c_j;$$
# with a bar the two twists are exchanged. One more subscript is one more rotation by a joint's angle and by a twist;
# $X^*$ is the second component before the rotation by the twist. (The notebook `spherical_polygons` derives them.)
#
# Here their equations are compared with those above. In each the left side is written in these names, the right side is
# the same component of the same vector, by matrices. The rest of the loop, from the end back to the base over the
# joints 7 and 1 in the axes of link 12, is
# $\vec r=S_6\vec S_6+S_7\vec S_7+a_{71}\vec a_{71}+S_1\vec S_1$.


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
names_7, names_71, names_1 = (
    [
        d.letter(f"{x}_{subscripts} | {x}_{{{subscripts}}} | {x} of the joints {subscripts} | 1", value)
        for x, value in zip("XYZ", xyz, strict=True)
    ]
    for subscripts, xyz in (("7", xyz_7), ("71", xyz_71), ("1", xyz_1))
)
rest_along_2 = d.letter(r"r_S_2 | \vec r\cdot\vec S_2 | rest of the loop along S2 | length", rest.dot(axis_2))
rest_along_a = d.letter(r"r_a_12 | \vec r\cdot\vec a_{12} | rest of the loop along a12 | length", rest[0])
rest_across = d.letter(
    r"r_across | \vec r\cdot(\vec S_2\times\vec a_{12}) | rest of the loop along S2 × a12 | length",
    rest.dot(sp.Matrix([0, c12, s12])),
)
X7, Y7, Z7 = names_7
d.check(
    "heptagon-theta1",
    equal(
        s12 * (S6 * Y7 - S7 * s71) * c1 + s12 * (S6 * X7 + a71) * s1 + c12 * (S6 * Z7 + S7 * c71 + S1),
        rest_along_2,
    ),
    text="Their equation of $\\theta_1$, $A\\,c_1+B\\,s_1+D=0$ with $A=s_{12}(S_6Y_7-S_7s_{71})$, "
    "$B=s_{12}(S_6X_7+a_{71})$ and $D=c_{12}(S_6Z_7+S_7c_{71}+S_1)+H$, is the loop along $\\vec S_2$.",
).prove()

# %%
K_1 = -S6 * xyz_71[0] - S7 * xyz_1[0] - a71 * c1
K_2 = -S1 * s12 + S6 * xyz_71[1] + S7 * xyz_1[1] + a71 * c12 * s1
X71, Y71, _ = names_71
X1, Y1, _ = names_1
d.check(
    "heptagon-plane",
    equal(-S6 * X71 - S7 * X1 - a71 * c1, -rest_along_a),
    equal(-S1 * s12 + S6 * Y71 + S7 * Y1 + a71 * c12 * s1, -rest_across),
    text="Their end of the triangle for $a_{12}=0$, $(K_1,K_2)$ on the left, is the loop along $\\vec a_{12}$ and "
    "along $\\vec S_2\\times\\vec a_{12}$.",
).prove()

# %%
from_base = tx("34").T * rz(3).T * tx("23").T * rz(2).T * tx("12").T * back["S6"]
names_7123 = [
    d.letter(f"{x}_7123 | {x}_{{7123}} | {x} of the joints 7123 | 1", value)
    for x, value in zip("XYZ", xyz_7123, strict=True)
]
names_54 = [
    d.letter(f"{name} | {latex} | {name.split('_')[0]} of the joints 54 | 1", value)
    for name, latex, value in zip(
        ("X_54", "Xstar_54", "Z_5_bar"), ("X_{54}", "X^*_{54}", r"\bar Z_5"), star_54, strict=True
    )
]
d.check(
    "heptagon-wrist",
    equal(
        d.letter(
            r"S_6_from_base | \vec S_6^{\,\mathrm{base}} | axis 6 in joint 4, over the base | 1", from_base
        ),
        sp.ImmutableMatrix([names_7123[0], -names_7123[1], names_7123[2]]),
    ),
    equal(RZ[4] * TX["45"] * RZ[5] * TX["56"] * e_z, sp.ImmutableMatrix(names_54)),
    text="$\\vec S_6$ in the axes of joint 4, reached from the base over the joints 7, 1, 2 and 3, and from the wrist. "
    "Equated they are their laws $X_{7123}=X_{54}$, $Y_{7123}=-X^*_{54}$ and $Z_{7123}=\\bar Z_5$, which give "
    "$\\theta_5$ and $\\theta_4$.",
).prove()

# %%
from_end = tx("56").T * rz(5).T * tx("45").T * rz(4).T
xyz_67 = joined(single("56", 6, "67"), 7, "71")
d.check(
    "heptagon-parallel",
    equal(
        d.letter(r"S_6_in_12 | {}^{12}\vec S_6 | axis 6 in the axes of joint 2 | 1", tx("12").T * back["S6"]),
        sp.ImmutableMatrix([names_71[0], -names_71[1], names_71[2]]),
    ),
    text="With three parallel axes $\\vec S_4=\\vec S_2$, so $\\vec S_6$ is seen from joint 2 as from joint 4, and "
    "$Z_{71}=c_{45}c_{56}-s_{45}s_{56}c_5$ gives $\\theta_5$.",
).prove()

# %%
side_5 = rz(1).T * tx("71").T * rz(7).T * tx("67").T * rz(6).T * tx("56").T * Z_AXIS
xyz_671 = joined(xyz_67, 1, "12")
X671, Y671 = (
    d.letter(f"{x}_671 | {x}_{{671}} | {x} of the joints 671 | 1", value)
    for x, value in zip("XY", xyz_671[:2], strict=True)
)
d.check(
    "heptagon-parallel-plane",
    equal(d.letter(r"S_5_a_12 | \vec S_5\cdot\vec a_{12} | axis 5 along a12 | 1", side_5[0]), X671),
    equal(
        d.letter(
            r"S_5_across | \vec S_5\cdot(\vec S_2\times\vec a_{12}) | axis 5 along S2 × a12 | 1",
            side_5.dot(sp.Matrix([0, c12, s12])),
        ),
        -Y671,
    ),
    text="The offset $S_5$ adds $-S_5X_{671}$ to $K_1$ and $S_5Y_{671}$ to $K_2$.",
).prove()

# %% [markdown]
# ## A free angle
#
# In a singular pose an angle $t$ may be free. Then the next step may not be possible for each value of it: a wrist with
# twists of 61° does not bend in every direction, and a triangle has to reach. Both ask that a scalar product with a
# vector that $t$ turns lies in an interval, $|f(t)-f_0|\le b$. Such a product is a wave in $t$:

# %%
turned_vector = d.vector("x", r"\vec x", "a vector that a free angle turns", "1")
x_turned = sp.Matrix(list(turned_vector))
y_held = sp.Matrix(list(d.vector("y", r"\vec y", "a vector that it does not turn", "1")))
f_c, f_s = (
    x_turned[0] * y_held[0] + x_turned[1] * y_held[1],
    x_turned[0] * y_held[1] - x_turned[1] * y_held[0],
)
d.check(
    "free-angle",
    equal(
        d.letter(
            r"f | \bigl(R_z(\theta_1)\,\vec x\bigr)\cdot\vec y | f, for t = θ1 | 1",
            (rz(1) * x_turned).dot(y_held),
        ),
        c1 * f_c + s1 * f_s + x_turned[2] * y_held[2],
    ),
    text="The scalar product of a turned vector with a fixed one is $f=f_c\\cos t+f_s\\sin t+f_1$, here for "
    "$t=\\theta_1$, with $f_c=x_1y_1+x_2y_2$, $f_s=x_1y_2-x_2y_1$ and $f_1=x_3y_3$.",
).prove()

# %% [markdown]
# An angle at which $f_c\cos t+f_s\sin t$ has a wanted value $\kappa$ has the cosine $(f_c\kappa-f_sq)/(f_c^2+f_s^2)$
# and the sine $(f_s\kappa+f_cq)/(f_c^2+f_s^2)$ with $q=\sqrt{f_c^2+f_s^2-\kappa^2}$: $c_t$ and $s_t$. The other is
# its mirror image at the direction $(f_c,f_s)$: $c_t'$ and $s_t'$.

# %%
at = d.symbol("at", r"\kappa", "the value of fc cos t + fs sin t that is wanted", "1")
aside = d.symbol("rest", r"q", "√(fc² + fs² - κ²)", "1")
fc, fs = d.symbol("along", "f_c", "factor of cos t", "1"), d.symbol("across", "f_s", "factor of sin t", "1")
chosen_c, chosen_s = (fc * at - fs * aside) / (fc**2 + fs**2), (fs * at + fc * aside) / (fc**2 + fs**2)
mirrored_c = ((fc**2 - fs**2) * chosen_c + 2 * fc * fs * chosen_s) / (fc**2 + fs**2)
mirrored_s = (2 * fc * fs * chosen_c - (fc**2 - fs**2) * chosen_s) / (fc**2 + fs**2)
on_circle = {aside: aside**2 + at**2 - fc**2 - fs**2}
c_t = d.letter("c_t | c_t | cosine of the chosen angle | 1", chosen_c)
s_t = d.letter("s_t | s_t | sine of the chosen angle | 1", chosen_s)
c_m = d.letter("c_m | c_t' | cosine of its mirror image | 1", mirrored_c)
s_m = d.letter("s_m | s_t' | sine of its mirror image | 1", mirrored_s)
d.check(
    "free-angle-chosen",
    equal(fc * c_t + fs * s_t, at),
    equal(fc * c_m + fs * s_m, at),
    equal(c_t**2 + s_t**2, 1),
    equal(c_m**2 + s_m**2, 1),
    text="Both angles have the value $\\kappa$, and are angles.",
).prove(modulo=on_circle)

# %% [markdown]
# ## The functions of the package
#
# One program without branches gives all eight solutions of either family, with a status each; those that exist come
# first. Cosines and sines are carried as pairs, and angles are taken at the very end, so that none has to be brought
# back into its range. Where an angle is not determined (the wrist's centre on $\vec S_1$, the elbow folded on joint
# 2, axes 4 and 6 in line) the status is FAMILY, and the free angle is zero wherever that leaves a solution; where two
# solutions meet, one is given, as DOUBLE.


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
# The functions for pairs return an equation as a table of coefficients $M_{eij}$ ($e$ counts the two equations), so
# that it reads $\sum_{ij}M_{eij}\,u_iv_j=0$ with $\vec u=(1,c,s)$ of the first and $\vec v$ of the second angle. The
# tables are derivatives of the expressions that are proved above; that they hold all of them is checked here.

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
        *(
            equal(
                d.letter(
                    rf"sum_{name}_{e} | \sum_{{ij}}M_{{{e + 1}ij}}u_iv_j | sum of robot_pair_{name} | its own",
                    (u.T * found[e].tomatrix() * v)[0],
                ),
                d.letter(
                    f"equation_{name}_{e} | E_{e + 1} | equation {e + 1}, {PAIRS[name][1]} | its own",
                    written[e],
                ),
            )
            for e in (0, 1)
        ),
        text=f"The coefficients of `robot_pair_{name}` give the left sides $E_1$ and $E_2$ of the two equations where "
        f"{PAIRS[name][1]}.",
    ).prove()
    pair_kernels.append(kernel)
d.page("kernel-456", "kernel-234", "kernel-parallel-234", "kernel-parallel-123")

# %%
derivation.kernel(behind_wrist(), three_parallel(), *pair_kernels)
