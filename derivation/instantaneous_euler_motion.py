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
# # How instantaneous Euler angles change, compared with the angles of a sequence
#
# While a body turns with the angular velocity $\omega$ (in fixed axes), each instantaneous Euler angle changes by the
# component of $\omega$ along its ridge line,
#
# $$ \dot\chi_i = \omega\cdot\frac{N_i}{|N_i|}, \qquad N_i = e_i\times Re_i. $$
#
# Where the three ridge lines have directions in one plane, the rates do not determine $\omega$; at $\chi_i = 0$ and
# $\pi$ an angle has a kink. Zhou and Zhu compare their angles with those of a sequence along a motion, so this notebook
# has their rates, too, and the way from an attitude back to them. (The paper has no equation on rates; this notebook
# proves its own.)

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import (
    PAPER,
    UNIT,
    Entries,
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
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    Letter,
    cross,
    dot,
    equal,
    norm,
    rot,
    select,
    skew,
)

derivation = Derivation(
    "instantaneous_euler_motion",
    title="How instantaneous Euler angles change, compared with the angles of a sequence",
    source=PAPER,
)
d = derivation
sin, cos = sp.sin, sp.cos

# %%
a1, a2, a3 = angles = tuple(d.symbol(f"a{n}", f"a_{n}", f"angle {n} of a sequence", "rad") for n in (1, 2, 3))
rates = tuple(d.symbol(f"da{n}", rf"\dot a_{n}", f"its rate {n}", "rad/s") for n in (1, 2, 3))
R = d.matrix("r", r"R", "rotation; its columns are the moved axes", "1", value=Letter("r", 3, 3).components)
omega = d.vector("omega", r"\vec\omega", "angular velocity, in fixed axes", "rad/s")
M = R.components
N = {
    axis: d.vector(
        f"N_{axis}",
        rf"\vec N_{axis}",
        f"direction of the ridge line {axis.upper()}r, as long as sin χ_{axis}",
        "1",
        value=cross(UNIT[axis], M[:, i]),
    )
    for i, axis in enumerate("xyz")
}
chi = {
    axis: d.symbol(
        f"chi_{axis}", rf"\chi_{axis}", f"instantaneous Euler angle {axis}", "rad", value=sp.acos(M[i, i])
    )
    for i, axis in enumerate("xyz")
}
of_q = {R: of_quaternion}
square = sum(x**2 for x in q)
d

# %% [markdown]
# ## The rates
#
# The moved axes turn with $\dot R = \hat\omega R$, so that $-\sin\chi_i\,\dot\chi_i = e_i\cdot(\omega\times Re_i) =
# -\omega\cdot N_i$, and $|N_i| = \sin\chi_i$.

# %%
d.check(
    "rates",
    *(
        equal(dot(UNIT[axis], cross(sp.Matrix(list(omega)), M[:, i])), -dot(omega, N[axis]))
        for i, axis in enumerate("xyz")
    ),
    text="The derivatives of the cosines.",
).prove()

# %%
d.check(
    "rate-squared",
    *(equal(norm(N[axis]) ** 2, 1 - M[i, i] ** 2) for i, axis in enumerate("xyz")),
    text="The direction of a ridge line is as long as the sine of its angle.",
).prove(given=of_q)

# %% [markdown]
# At $\chi_i = 0$ the axis $e_i$ is where it was, and any motion can only make the angle larger: to first order by
# $|\omega\times e_i|$ per unit of time, in either direction of time. At $\pi$ it can only become less. The kernel
# gives the rate towards later times with the status KINK.

# %%
t = d.symbol("t", "t", "time since the kink", "s", positive=True)
e3 = UNIT["z"]
w = sp.Matrix(list(omega))
moved = e3 + t * cross(w, e3)
d.check(
    "kink",
    equal(sp.ImmutableMatrix(cross(e3, moved)), sp.ImmutableMatrix(t * cross(e3, cross(w, e3)))),
    equal(norm(cross(e3, cross(w, e3))) ** 2, omega.components[0] ** 2 + omega.components[1] ** 2),
    text="To first order in t the sine is t times the part of ω across the axis.",
).prove()

# %% [markdown]
# ## Where the rates do not determine the angular velocity
#
# The three directions span a volume that has three equal, short forms, and is $16\,q_0q_xq_yq_z$: it vanishes on the
# boundary of the possible triples, and only there (`instantaneous_euler_inverse`). Near it an angular velocity from
# rates has an error of about the rounding over the volume of the unit directions.

# %%
volume = d.symbol(
    "volume",
    r"\det(N_x, N_y, N_z)",
    "volume of the directions of the ridge lines",
    "1",
    value=sp.Matrix.hstack(*(sp.Matrix(d.value(N[axis])) for axis in "xyz")).det(),
)
d.check(
    "volume",
    equal(volume, M[0, 2] * M[1, 0] * M[2, 1] - M[0, 1] * M[1, 2] * M[2, 0]),
    equal(volume, 16 * q[0] * q[1] * q[2] * q[3] / square**2),
    equal(volume, (M[2, 1] - M[1, 2]) * (M[2, 1] + M[1, 2])),
    equal(volume, (M[0, 2] - M[2, 0]) * (M[0, 2] + M[2, 0])),
    equal(volume, (M[1, 0] - M[0, 1]) * (M[1, 0] + M[0, 1])),
    text="The volume from the matrix and from the quaternion.",
).prove(given=of_q)

# %%
Nx, Ny, Nz = N.values()
b = [d.symbol(f"b_{axis}", f"b_{axis}", f"rate of χ_{axis} times its sine", "rad/s") for axis in "xyz"]
solved = b[0] * cross(Ny, Nz) + b[1] * cross(Nz, Nx) + b[2] * cross(Nx, Ny)
d.check(
    "angular-velocity",
    *(equal(dot(N[axis], solved), b[i] * volume) for i, axis in enumerate("xyz")),
    text="Where the volume is not zero, this over the volume is the angular velocity with given rates.",
).prove()

# %% [markdown]
# ## From the rates of a sequence
#
# The angular velocity is the sum of the three rates about their axes, the later ones turned by the earlier rotations.
# The twelve sequences are two with other names of the axes (see "twelve-from-two" in `instantaneous_euler`); an
# angular velocity goes along as $\omega = \det P\; P\omega'$.


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
    change = sum((matrix.diff(a) * rate for a, rate in zip(angles, rates, strict=True)), sp.zeros(3))
    d.check(
        f"velocity-{sequence}",
        equal(sp.ImmutableMatrix(skew(velocity(sequence)) * matrix), sp.ImmutableMatrix(change)),
        text=f"The angular velocity of {'-'.join(sequence.upper())} is that of its matrix.",
    ).prove()
Entries(d, "velocity-zyx", "velocity-zyz")

# %%
reflection = sp.Matrix([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
d.check(
    "velocity-relabelled",
    *(
        equal(
            sp.ImmutableMatrix(P * skew(w) * P.T),
            sp.ImmutableMatrix(skew(P.det() * P * w)),
        )
        for P in (reflection, sp.Matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    ),
    text="Names exchanged: an angular velocity changes its sign with a reflection.",
).prove()

# %% [markdown]
# ## Back to the angles of a sequence
#
# From the quaternion of Z-Y-Z, $(\cos\frac\theta2\cos\sigma,\ -\sin\frac\theta2\sin\delta,\
# \sin\frac\theta2\cos\delta,\ \cos\frac\theta2\sin\sigma)$ with half the sum $\sigma$ and half the difference
# $\delta$ of the outer angles, all three are read off by atan2, well conditioned right up to the lock. Z-Y-X becomes
# Z-Y-Z by a quarter turn about y from the right.

# %%
quarter = sp.Matrix([1, 0, 1, 0])
d.check(
    "quarter-turn",
    equal(
        sp.ImmutableMatrix(turns("zyx", angles) * rot("y", sp.pi / 2)),
        turns("zyz", (a1, a2 + sp.pi / 2, a3)),
    ),
    equal(
        sp.ImmutableMatrix(product(sp.Matrix(q), quarter)),
        sp.ImmutableMatrix([q[0] - q[2], q[1] - q[3], q[0] + q[2], q[1] + q[3]]),
    ),
    text="Z-Y-X and then a quarter turn about y is Z-Y-Z with a second angle greater by π/2.",
).prove()

# %%
d.check(
    "middle-angle",
    equal(of_quaternion[2, 0] * square, -2 * (q[0] * q[2] - q[1] * q[3])),
    equal(
        (1 - of_quaternion[2, 0] ** 2) * square**2,
        ((q[0] + q[2]) ** 2 + (q[1] - q[3]) ** 2) * ((q[0] - q[2]) ** 2 + (q[1] + q[3]) ** 2),
    ),
    equal(zyx[2, 0], -sin(sp.Symbol("beta", real=True))),
    text="Sine and squared cosine of the middle angle of Z-Y-X.",
).prove()

# %%
h1, h2, h3 = (x / 2 for x in angles)
q_zyz = half_turns("zyz", (h1, h2, h3))
d.check(
    "zyz-by-halves",
    equal(
        sp.ImmutableMatrix(q_zyz),
        sp.ImmutableMatrix(
            [
                cos(h2) * cos(h1 + h3),
                -sin(h2) * sin(h1 - h3),
                sin(h2) * cos(h1 - h3),
                cos(h2) * sin(h1 + h3),
            ]
        ),
    ),
).prove()


# %% [markdown]
# ## The kernels


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
# The matrix of the kernels is the paper's, (19), and (17) put right.

# %%
motions = {sequence: chi_motion(sequence) for sequence in ("zyx", "zyz")}
letters = sp.symbols("alpha beta gamma", real=True), sp.symbols("phi theta psi", real=True)
for (sequence, kernel), paper, names in zip(motions.items(), (zyx, right_zyz), letters, strict=True):
    ports = dict(zip(kernel.port("angles").symbols, names, strict=True))
    d.check(
        f"kernel-{sequence}",
        equal(sp.ImmutableMatrix(kernel.expand("matrix").xreplace(ports)), paper),
        text=f"The kernel's matrix of {'-'.join(sequence.upper())}.",
    ).prove()
Entries(d, "kernel-zyx", "kernel-zyz")

# %%
derivation.kernel(
    chi_rates(),
    chi_angular_velocity(),
    *motions.values(),
    angles_from_quaternion("zyx"),
    angles_from_quaternion("zyz"),
)
derivation.kernels
