# %% [markdown]
# # How instantaneous Euler angles change, compared with the angles of a sequence
#
# A body turns with the angular velocity $\vec\omega$ (in fixed axes). How fast do its instantaneous Euler angles
# $\chi_i$, the angles between the axes $e_i$ and their images $Re_i$, change? And can $\vec\omega$ be found from their
# rates?
#
# **Result.** Each angle changes by the component of $\vec\omega$ along its ridge line,
#
# $$ \dot\chi_i = \Bigl(\vec\omega, \frac{\vec N_i}{|\vec N_i|}\Bigr), \qquad \vec N_i = e_i\times Re_i, $$
#
# and the rates determine $\vec\omega$ unless the three ridge lines have directions in one plane. At $\chi_i = 0$ and
# $\pi$ an angle has a kink, and its rate jumps.
#
# Zhou and Zhu compare their angles with those of a sequence along a motion. So the notebook has the rates of a
# sequence, too, and the way from an attitude back to its angles. (The paper has no equation on rates; this notebook
# proves its own.)

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import (
    PAPER,
    UNIT,
    half_turns,
    length_of_two,
    of_quaternion,
    product,
    q,
    right_zyz,
    turns,
    zyx,
)
from rodgen.derivation.rotations import normalised
from rodgen.symbolic import EPS, LARGEST, Derivation, Letter, cross, dot, equal, norm, rot, select, skew

d = derivation = Derivation(
    "instantaneous_euler_motion",
    title="How instantaneous Euler angles change, compared with the angles of a sequence",
    source=PAPER,
)
sin, cos = sp.sin, sp.cos

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product, $[\vec a]_\times$ the matrix of the cross product with $\vec a$, and
# $r_{ij}$ an element of the matrix $R$. $Xr$, $Yr$, $Zr$ are the ridge lines, in which the coordinate planes meet
# their images.

# %%
a1, a2, a3 = angles = tuple(d.symbol(f"a{n}", f"a_{n}", f"angle {n} of a sequence", "rad") for n in (1, 2, 3))
rates = tuple(d.symbol(f"da{n}", rf"\dot a_{n}", f"its rate {n}", "rad/s") for n in (1, 2, 3))
R = d.matrix("r", r"R", "rotation; its columns are the moved axes", "1", value=Letter("r", 3, 3).components)
omega = d.vector("omega", r"\vec\omega", "angular velocity, in fixed axes", "rad/s")
M = R.components
N = {
    axis: d.letter(
        rf"N_{axis}[3] | \vec N_{axis} | direction of the ridge line {axis.upper()}r, as long as sin χ_{axis} | 1",
        cross(UNIT[axis], M[:, i]),
    )
    for i, axis in enumerate("xyz")
}
chi = {
    axis: d.letter(rf"chi_{axis} | \chi_{axis} | instantaneous Euler angle {axis} | rad", sp.acos(M[i, i]))
    for i, axis in enumerate("xyz")
}
of_q = {R: of_quaternion}
square = sum(x**2 for x in q)
q0, qx, qy, qz = (
    d.symbol(x.name, f"q_{x.name[1:]}", f"component {x.name[1:]} of the quaternion of R", "1") for x in q
)
fixed = {
    axis: d.vector(f"e_{axis}", rf"\vec e_{axis}", f"unit vector along {axis}", "1", value=UNIT[axis])
    for axis in "xyz"
}
moved_axes = {
    axis: d.vector(f"moved_{axis}", rf"R\vec e_{axis}", "its image, a column of R", "1", value=M[:, i])
    for i, axis in enumerate("xyz")
}
d

# %% [markdown]
# ## The rates
#
# A moved axis turns with the body, $\frac{\mathrm d}{\mathrm dt}R\vec e_i=\vec\omega\times R\vec e_i$. Its scalar
# product with $\vec e_i$ is $\cos\chi_i$, whose derivative is $-\sin\chi_i\,\dot\chi_i=(\vec e_i,\vec\omega\times
# R\vec e_i)$:

# %%
d.check(
    "rates",
    *(equal(dot(fixed[axis], cross(omega, moved_axes[axis])), -dot(omega, N[axis])) for axis in "xyz"),
    text="The derivatives of the three cosines.",
).prove(because="A triple product changes its sign when two of its vectors are exchanged.")

# %%
cosines = [
    d.symbol(f"r_{axis}", f"R_{{{axis * 2}}}", f"diagonal element of R, cos χ_{axis}", "1", value=M[i, i])
    for i, axis in enumerate("xyz")
]
d.check(
    "rate-squared",
    *(equal(norm(N[axis]) ** 2, 1 - c**2) for axis, c in zip("xyz", cosines, strict=True)),
    text="The direction of a ridge line is as long as the sine of its angle.",
    assumptions=["R is a rotation"],
).prove(
    given=of_q,
    because="N is the cross product of two unit vectors whose scalar product is R_ii = cos χ; R is written by a "
    "quaternion.",
)

# %% [markdown]
# The two statements together are the result: $\sin\chi_i\,\dot\chi_i=(\vec\omega,\vec N_i)$ is divided by
# $|\vec N_i|=\sin\chi_i$.
#
# At $\chi_i = 0$ this cannot be done. There the axis $\vec e_i$ is where it was, and any motion can only make the
# angle larger: to first order by $|\vec\omega\times\vec e_i|$ per unit of time, in either direction of time. At $\pi$
# it can only become smaller. In the proof the axis is $\vec e_z$, and $\vec e_z(t)=\vec e_z+t\,\vec\omega\times\vec
# e_z$ its image after a short time $t$. (The function gives the rate towards later times, with the status KINK.)

# %%
t = d.symbol("t", "t", "time since the kink", "s", positive=True)
e3 = UNIT["z"]
w = sp.Matrix(list(omega))
moved = d.letter(
    r"moved[3] | \vec e_z(t) | the image of the axis after the time t, to first order | 1",
    e3 + t * cross(w, e3),
)
ez = fixed["z"]
d.check(
    "kink",
    equal(cross(ez, moved), t * cross(ez, cross(omega, ez))),
    equal(norm(cross(ez, cross(omega, ez))) ** 2, omega.components[0] ** 2 + omega.components[1] ** 2),
    text="To first order in t the sine is t times the part of ω across the axis.",
).prove(because="e × e = 0; and e × (ω × e) is the part of ω perpendicular to e.")

# %% [markdown]
# ## Where the rates do not determine the angular velocity
#
# The three rates are three linear equations for $\vec\omega$. They have one solution unless the volume $\det(\vec
# N_x,\vec N_y,\vec N_z)$ of the directions is zero. It has three short forms, which are equal, and is
# $16\,q_0q_xq_yq_z$ for a unit quaternion. So it vanishes on the boundary of the possible triples of angles, and only
# there (`instantaneous_euler_inverse`). Near the boundary, an angular velocity from rates has an error of about the
# rounding divided by the volume of the unit directions. $|q|^2$ is the sum of the squares of the quaternion's
# components.

# %%
volume = d.letter(
    r"volume | \det(N_x, N_y, N_z) | volume of the directions of the ridge lines | 1",
    sp.Matrix.hstack(*(sp.Matrix(d.value(N[axis])) for axis in "xyz")).det(),
)
length_squared = d.symbol("length_squared", "|q|^2", "squared length of the quaternion", "1", value=square)
d.check(
    "volume",
    equal(volume, M[0, 2] * M[1, 0] * M[2, 1] - M[0, 1] * M[1, 2] * M[2, 0]),
    equal(volume, 16 * q[0] * q[1] * q[2] * q[3] / length_squared**2),
    equal(volume, (M[2, 1] - M[1, 2]) * (M[2, 1] + M[1, 2])),
    equal(volume, (M[0, 2] - M[2, 0]) * (M[0, 2] + M[2, 0])),
    equal(volume, (M[1, 0] - M[0, 1]) * (M[1, 0] + M[0, 1])),
    text="The volume from the matrix and from the quaternion.",
).prove(
    given=of_q,
    because="All are computed from the matrix of the quaternion.",
)

# %% [markdown]
# Where the volume is not zero, the angular velocity is the following vector divided by the volume. $b_i=\sin\chi_i\,
# \dot\chi_i$ are the rates times the sines, that is, the given values of $(\vec\omega,\vec N_i)$.

# %%
Nx, Ny, Nz = N.values()
b = [d.symbol(f"b_{axis}", f"b_{axis}", f"rate of χ_{axis} times its sine", "rad/s") for axis in "xyz"]
solved = b[0] * cross(Ny, Nz) + b[1] * cross(Nz, Nx) + b[2] * cross(Nx, Ny)
d.check(
    "angular-velocity",
    *(equal(dot(N[axis], solved), b[i] * volume) for i, axis in enumerate("xyz")),
    text="The vector b_x N_y × N_z + b_y N_z × N_x + b_z N_x × N_y, divided by the volume, has the given products.",
).prove(
    because="(N_x, N_y × N_z) is the volume, and N_y × N_z is perpendicular to the other two; cyclically for the "
    "others.",
)

# %% [markdown]
# ## From the rates of a sequence
#
# While the angles $a_1,a_2,a_3$ of a sequence change at their rates, the angular velocity is the sum of the three rates
# about their axes, the later axes turned by the earlier rotations. $R_{zyx}$ and $R_{zyz}$ are the rotations of the two
# sequences.


# %%
def velocity(sequence):
    """Angular velocity of intrinsic rotations."""
    found, frame = sp.zeros(3, 1), sp.eye(3)
    for axis, angle, rate in zip(sequence, angles, rates, strict=True):
        found += frame * UNIT[axis] * rate
        frame = frame * rot(axis, angle)
    return found


for sequence in ("zyx", "zyz"):
    matrix = sp.Matrix(turns(sequence, angles))
    upper = "-".join(sequence.upper())
    change = d.letter(
        rf"change_{sequence}[3,3] | \dot R_{{{sequence}}} | derivative of the rotation of {upper} by the time | 1/s",
        sum((matrix.diff(a) * rate for a, rate in zip(angles, rates, strict=True)), sp.zeros(3)),
    )
    by_rates = d.letter(
        rf"omega_{sequence}[3] | \vec\omega_{{{sequence}}} | "
        rf"sum of the three rates of {upper} about their axes | rad/s",
        velocity(sequence),
    )
    rotation = d.letter(f"R_{sequence}[3,3] | R_{{{sequence}}} | rotation of {upper} | 1", matrix)
    d.check(
        f"velocity-{sequence}",
        equal(skew(by_rates) * rotation, change),
        text=f"The sum of the rates of {upper} is the angular velocity: the rotation changes as it says.",
    ).prove(
        because="The derivative of a rotation about an axis is the cross product with the axis, times the rotation."
    )
d.page("velocity-zyx", "velocity-zyz")

# %% [markdown]
# The other ten sequences are these two with other names of the axes (`instantaneous_euler`, entry `twelve-from-two`).
# When the names change by a matrix $P$, an angular velocity becomes $\vec\omega = \det P\; P\vec\omega'$: where $P$
# is a reflection, its sign changes. The statement is for the exchange of x and y, a reflection, and for the cyclic
# exchange.

# %%
reflection = sp.Matrix([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
named_anew = []
for P in (reflection, sp.Matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])):
    names = sp.ImmutableMatrix(P)
    turned = d.vector(
        f"omega_{'reflected' if P.det() < 0 else 'cyclic'}",
        r"\det P\;P\,\vec\omega" if P.det() < 0 else r"P\,\vec\omega",
        "angular velocity after x and y were exchanged"
        if P.det() < 0
        else "angular velocity after a cyclic exchange",
        "rad/s",
        value=P.det() * P * w,
    )
    named_anew.append(equal(names * skew(omega) * names.T, skew(turned)))
d.check(
    "velocity-relabelled",
    *named_anew,
    text="An angular velocity in other names of the axes.",
).prove(because="A cross product is kept by a rotation and changes its sign with a reflection.")

# %% [markdown]
# ## Back to the angles of a sequence
#
# An attitude is given by its quaternion; wanted are the three angles of a sequence. In the quaternion of Z-Y-Z stand
# the half sum $\sigma=\frac12(a_1+a_3)$ and the half difference $\delta=\frac12(a_1-a_3)$ of the outer angles:

# %%
h1, h2, h3 = (x / 2 for x in angles)
q_zyz = d.letter(
    "q_zyz[4,1] | q_{zyz} | quaternion of Z-Y-Z, the product of those of the three rotations | 1",
    half_turns("zyz", (h1, h2, h3)),
)
d.check(
    "zyz-by-halves",
    equal(
        q_zyz,
        sp.ImmutableMatrix(
            [
                cos(h2) * cos(h1 + h3),
                -sin(h2) * sin(h1 - h3),
                sin(h2) * cos(h1 - h3),
                cos(h2) * sin(h1 + h3),
            ]
        ),
    ),
    text="The quaternion of Z-Y-Z by the middle angle, the half sum and the half difference.",
).prove(because="The product of the three quaternions, with the addition theorems.")

# %% [markdown]
# So $\sigma$, $\delta$ and the middle angle are read off by three arctangents of two numbers each. They are well
# conditioned right up to gimbal lock, where only the sum or only the difference is determined.
#
# Z-Y-X becomes Z-Y-Z by a quarter turn about y from the right, with the quaternion $(1,0,1,0)$ up to its length:

# %%
quarter = sp.Matrix([1, 0, 1, 0])
turned_zyx, other_zyz, turned_q = (
    d.matrix(name, letter, quantity, "1", value=value, rows=value.rows, columns=value.cols)
    for name, letter, quantity, value in (
        (
            "turned_zyx",
            r"R_{zyx}\,R_y(\tfrac\pi2)",
            "rotation of Z-Y-X after a quarter turn about y",
            sp.Matrix(turns("zyx", angles)) * rot("y", sp.pi / 2),
        ),
        (
            "other_zyz",
            r"R_{zyz}(a_1,a_2+\tfrac\pi2,a_3)",
            "rotation of Z-Y-Z with another second angle",
            sp.Matrix(turns("zyz", (a1, a2 + sp.pi / 2, a3))),
        ),
        (
            "turned_q",
            r"q\,(1,0,1,0)",
            "product of the quaternion with that of a quarter turn",
            product(sp.Matrix(q), quarter),
        ),
    )
)
d.check(
    "quarter-turn",
    equal(turned_zyx, other_zyz),
    equal(turned_q, sp.ImmutableMatrix([q[0] - q[2], q[1] - q[3], q[0] + q[2], q[1] + q[3]])),
    text="Z-Y-X and then a quarter turn about y is Z-Y-Z with a second angle greater by π/2; and its quaternion.",
).prove(because="R_x(a₃) R_y(π/2) = R_y(π/2) R_z(a₃): the quarter turn takes z to x.")

# %% [markdown]
# The middle angle of Z-Y-X itself has the sine $-R_{31}$, and its squared cosine is $1-R_{31}^2$:

# %%
r31 = d.symbol("r31", "R_{31}", "element of the quaternion's matrix", "1", value=of_quaternion[2, 0])
middle = d.symbol("beta", r"\beta", "second Z-Y-X angle", "rad")
r31_zyx = d.symbol("r31_zyx", "R_{31}^{zyx}", "the same element by the Z-Y-X angles", "1", value=zyx[2, 0])
d.check(
    "middle-angle",
    equal(r31 * length_squared, -2 * (q[0] * q[2] - q[1] * q[3])),
    equal(
        (1 - r31**2) * length_squared**2,
        ((q[0] + q[2]) ** 2 + (q[1] - q[3]) ** 2) * ((q[0] - q[2]) ** 2 + (q[1] + q[3]) ** 2),
    ),
    equal(r31_zyx, -sin(middle)),
    text="Sine and squared cosine of the middle angle of Z-Y-X.",
).prove(
    because="(|q|² − 2(q₀q_y − q_xq_z)) (|q|² + 2(q₀q_y − q_xq_z)), and both factors are sums of two squares."
)


# %% [markdown]
# ## The functions
#
# `chi_rates` gives the rates for an angular velocity, `chi_angular_velocity` the reverse; two functions give the
# rotation and the angular velocity for the angles of a sequence and their rates; and two give the angles of a
# sequence for a quaternion. The statuses name the kinks, the singular attitudes and the attitudes near them.


# %%
class MotionStatus(IntEnum):
    """Kind of rates, or of the angles of a sequence.

    REGULAR: the ordinary case.
    NEAR_SINGULAR: of rates: the directions of the ridge lines are so near to one plane that an angular velocity that is
        computed from the rates has fewer than half of its digits.
    SINGULAR: of rates: the ridge lines have directions in one plane, and the rates do not give the angular velocity
        (NaN where that is asked for). Of the angles of a sequence: gimbal lock; the first and the third angle are about
        one axis, and the third is given as 0.
    KINK: an angle is 0 or pi, where its rate jumps; the rate is that towards later times.
    NOT_NORMAL: the quaternion is not of unit length, or the matrix not orthogonal.
    INVALID: not finite, a zero quaternion, or a reflection; the result is NaN.
    """

    REGULAR = 0
    NEAR_SINGULAR = 1
    SINGULAR = 2
    KINK = 3
    NOT_NORMAL = 4
    INVALID = 5


def frame(k):
    """Return a rotation, whether it is one, how nearly, and its ridge lines."""
    matrix = k.input("matrix", (3, 3), unit="1", doc="rotation; its columns are the moved axes")
    gram = matrix.T * matrix - sp.eye(3)
    deviation = k.let("deviation", sum((abs(x) for x in gram), sp.S.Zero))
    handed = k.let("handed", matrix[:, 0].dot(matrix[:, 1].cross(matrix[:, 2])))
    good = k.let("good", (handed > 0) & (deviation <= LARGEST))
    abnormal = k.let("abnormal", sp.Not(deviation <= 64 * EPS))
    rows = [UNIT[axis].cross(matrix[:, i]) for i, axis in enumerate("xyz")]
    sines = [k.let(f"sine_{axis}", sp.sqrt(n.dot(n))) for axis, n in zip("xyz", rows, strict=True)]
    kinks = [k.let(f"kink_{axis}", sp.Le(s, 4 * EPS)) for axis, s in zip("xyz", sines, strict=True)]
    size = k.let("volume", (matrix[2, 1] - matrix[1, 2]) * (matrix[2, 1] + matrix[1, 2]))
    largest = k.let("most", sines[0] * sines[1] * sines[2])  # of three directions at right angles
    flat = k.let("flat", sp.Le(abs(size), 16 * EPS * largest))
    near = k.let("near", sp.Le(abs(size), sp.sqrt(EPS) * largest))
    return matrix, rows, sines, kinks, size, (flat, near), good, abnormal


def verdict(good, abnormal, kinks, flat):
    return sp.Piecewise(
        (MotionStatus.INVALID, sp.Not(good)),
        (MotionStatus.KINK, sp.Or(*kinks)),
        (MotionStatus.SINGULAR, flat[0]),
        (MotionStatus.NOT_NORMAL, abnormal),
        (MotionStatus.NEAR_SINGULAR, flat[1]),
        (MotionStatus.REGULAR, True),
        evaluate=False,
    )


def chi_rates():
    k = KernelBuilder(
        "chi_rates",
        summary="Rates of the instantaneous Euler angles of a turning body.",
        source="derivation instantaneous_euler_motion, entries rates, kink and volume",
    )
    matrix, rows, sines, kinks, size, flat, good, abnormal = frame(k)
    omega = k.input("omega", 3, unit="rad/time", doc="angular velocity, in fixed axes")
    known = k.let("known", good & (sum((abs(x) / 4 for x in omega), sp.S.Zero) <= LARGEST))
    found = []
    for i, axis in enumerate("xyz"):
        across = cross(UNIT[axis], omega)
        speed = k.let(f"speed_{axis}", sp.sqrt(across.dot(across)))
        along = rows[i].dot(omega) / select(kinks[i], 1, sines[i])
        found.append(select(kinks[i], select(matrix[i, i] > 0, speed, -speed), along))
    k.output(
        "rate",
        sp.Matrix([select(known, value, sp.nan) for value in found]),
        unit="rad/time",
        doc="rates of the three angles",
    )
    k.output(
        "determinant",
        select(good, size, sp.nan),
        unit="1",
        doc="volume of the directions of the ridge lines, 16 q0 qx qy qz; 0 where the rates do not determine omega",
    )
    k.status("status", verdict(known, abnormal, kinks, flat), MotionStatus, doc="what the rates are")
    return k.build()


def chi_angular_velocity():
    k = KernelBuilder(
        "chi_angular_velocity",
        summary="Angular velocity of a body whose instantaneous Euler angles change at given rates.",
        source="derivation instantaneous_euler_motion, entry angular-velocity",
    )
    _, rows, sines, kinks, size, flat, good, abnormal = frame(k)
    rate = k.input("rate", 3, unit="rad/time", doc="rates of the three angles")
    known = k.let("known", good & (sum((abs(x) / 4 for x in rate), sp.S.Zero) <= LARGEST))
    b = [k.let(f"b_{axis}", rate[i] * sines[i]) for i, axis in enumerate("xyz")]
    lost = k.let("lost", sp.Or(flat[0], *kinks))
    total = b[0] * rows[1].cross(rows[2]) + b[1] * rows[2].cross(rows[0]) + b[2] * rows[0].cross(rows[1])
    divisor = k.let("divisor", select(lost, 1, size))
    k.output(
        "omega",
        select(known & sp.Not(lost), total / divisor, sp.ones(3, 1) * sp.nan),
        unit="rad/time",
        doc="angular velocity, in fixed axes",
    )
    k.status(
        "status", verdict(known, abnormal, kinks, flat), MotionStatus, doc="whether the rates determine it"
    )
    return k.build()


def chi_motion(sequence):
    name = "-".join(sequence.upper())
    k = KernelBuilder(
        f"chi_motion_from_{sequence}",
        summary=f"Rotation matrix and angular velocity of intrinsic {name} angles and their rates.",
        source="Zhou and Zhu, eq. (19) or (17) put right, and derivation instantaneous_euler_motion",
    )
    given = k.input("angles", 3, unit="rad", doc="the three angles in the order of the sequence")
    change = k.input("angle_rates", 3, unit="rad/time", doc="their rates")
    insert = {**dict(zip(angles, given, strict=True)), **dict(zip(rates, change, strict=True))}
    k.output(
        "matrix",
        sp.Matrix(turns(sequence, given)),
        unit="1",
        doc="rotation; its columns are the moved axes",
    )
    k.output(
        "omega",
        velocity(sequence).xreplace(insert),
        unit="rad/time",
        doc="angular velocity, in fixed axes",
    )
    return k.build()


def wrapped(k, name, angle):
    angle = k.let(name, angle)
    return select(angle > sp.pi, angle - 2 * sp.pi, select(angle <= -sp.pi, angle + 2 * sp.pi, angle))


def angles_from_quaternion(sequence):
    name = "-".join(sequence.upper())
    k = KernelBuilder(
        f"chi_{sequence}_from_quaternion",
        summary=f"Intrinsic {name} angles of a unit quaternion.",
        source="derivation instantaneous_euler_motion, entries quarter-turn, middle-angle and zyz-by-halves",
    )
    quaternion = k.input("quaternion", 4, unit="1", doc="unit quaternion, scalar part first")
    unit, good, abnormal = normalised(k, "quaternion", quaternion)
    good = k.let("good", good)
    w, x, y, z = unit
    if sequence == "zyx":
        w, x, y, z = k.let(
            "turned", sp.Matrix(product(unit, quarter)) / sp.sqrt(2)
        )  # Z-Y-Z with a second angle greater by π/2
    sine = length_of_two(k, "sine", x, y)
    cosine = length_of_two(k, "cosine", w, z)
    low, high = k.let("low", sp.Le(sine, 4 * EPS)), k.let("high", sp.Le(cosine, 4 * EPS))
    sigma, delta = k.let("sigma", sp.atan2(z, w)), k.let("delta", sp.atan2(-x, y))
    half_sum = k.let("half_sum", select(high, delta, sigma))
    half_difference = k.let("half_difference", select(low, sigma, delta))
    if sequence == "zyx":
        middle = sp.atan2(2 * (unit[0] * unit[2] - unit[1] * unit[3]), 2 * sine * cosine)
    else:
        middle = 2 * sp.atan2(sine, cosine)
    found = [
        wrapped(k, "first", half_sum + half_difference),
        middle,
        wrapped(k, "third", half_sum - half_difference),
    ]
    k.output(
        "angles",
        sp.Matrix([select(good, value, sp.nan) for value in found]),
        unit="rad",
        doc="the angles; the middle one is "
        + ("-pi/2 to pi/2" if sequence == "zyx" else "0 to pi")
        + ", the others are in (-pi, pi]",
    )
    status = sp.Piecewise(
        (MotionStatus.INVALID, sp.Not(good)),
        (MotionStatus.SINGULAR, low | high),
        (MotionStatus.NOT_NORMAL, abnormal),
        (MotionStatus.REGULAR, True),
        evaluate=False,
    )
    k.status("status", status, MotionStatus, doc="what the angles are")
    return k.build()


# %% [markdown]
# The functions' matrices are those of the paper, (19), and (17) put right.

# %%
motions = {sequence: chi_motion(sequence) for sequence in ("zyx", "zyz")}
alpha = d.symbol("alpha", r"\alpha", "first Z-Y-X angle", "rad")
gamma = d.symbol("gamma", r"\gamma", "third Z-Y-X angle", "rad")
phi = d.symbol("phi", r"\phi", "first Z-Y-Z angle", "rad")
theta = d.symbol("theta", r"\theta", "second Z-Y-Z angle", "rad")
psi = d.symbol("psi", r"\varphi", "third Z-Y-Z angle", "rad")
letters = (alpha, middle, gamma), (phi, theta, psi)
for (sequence, kernel), paper, names in zip(motions.items(), (zyx, right_zyz), letters, strict=True):
    ports = dict(zip(kernel.port("angles").symbols, names, strict=True))
    upper = "-".join(sequence.upper())
    computed = d.letter(
        rf"computed_{sequence}[3,3] | R_{{{sequence}}}^{{\mathrm{{computed}}}} | "
        rf"matrix of {upper} as the function computes it | 1",
        kernel.expand("matrix").xreplace(ports),
    )
    d.check(
        f"kernel-{sequence}",
        equal(computed, paper),
        text=f"The function's matrix of {upper}.",
    ).prove(because="The function's steps are inserted into each other.")
d.page("kernel-zyx", "kernel-zyz")

# %%
derivation.kernel(
    chi_rates(),
    chi_angular_velocity(),
    *motions.values(),
    angles_from_quaternion("zyx"),
    angles_from_quaternion("zyz"),
)
