# %% [markdown]
# # Rotating a vector, and the ways to write a rotation
#
# A rotation is written in four ways: by a unit axis $\vec e$ and an angle $\chi$; by the Rodrigues vector
# $\vec\theta=2\tan\frac\chi2\,\vec e$; by a matrix; and by a unit quaternion
# $(w,\vec v)=(\cos\frac\chi2,\ \sin\frac\chi2\,\vec e)$, scalar part first. This notebook proves that the four mean the
# same rotation, and makes from the proofs the functions that convert each of them into each other one.
#
# Every conversion goes through the quaternion with $w\ge0$. No step there divides by a number near zero, whatever the
# rotation is, and the half angle keeps small rotations and half turns exact to rounding.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import (
    EPS,
    LARGEST,
    Derivation,
    cross,
    dot,
    equal,
    matrix_from_axis_angle,
    matrix_from_rodrigues_vector,
    norm,
    power_of_two_scale,
    rodrigues,
    select,
    skew,
)

d = derivation = Derivation(
    "rotations",
    title="Rotations: Rodrigues' formula and conversions",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
)

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product of two vectors, $[\vec a]_\times$ the matrix of the cross product,
# $[\vec a]_\times\vec b=\vec a\times\vec b$, and $I$ the unit matrix.


# %%
def matrix_from_quaternion(w, v):
    """Rotation matrix of a quaternion of any length."""
    v = sp.Matrix(v)
    square = w**2 + v.dot(v)
    return sp.eye(3) + (2 * w * skew(v) + 2 * skew(v) ** 2) / square


axis = d.vector("axis", r"\vec e", "unit vector of the axis", "1")
cosine = d.symbol("cosine", r"c", "cos(χ/2)", "1")
sine = d.symbol("sine", r"s", "sin(χ/2)", "1")
theta = d.vector("theta", r"\vec\theta", "Rodrigues vector, 2 tan(χ/2) e", "1")
w = d.symbol("w", r"w", "scalar part of the quaternion, cos(χ/2) when its length is 1", "1", positive=True)
v = d.vector("v", r"\vec v", "vector part of the quaternion, sin(χ/2) e when its length is 1", "1")
by_quaternion = matrix_from_quaternion(w, list(v))
q = d.matrix("q", "q", "quaternion as a column, w above v", "1", value=sp.Matrix([w, *v]), rows=4, columns=1)
rho = d.vector("rho", r"\vec\rho", "vector to rotate", "length")
scale = d.symbol("scale", r"k", "a positive factor", "1", positive=True)
by_theta = d.letter(
    r"matrix_of_theta[3,3] | M(\vec\theta) | matrix of the rotation with a Rodrigues vector | 1",
    matrix_from_rodrigues_vector(sp.Matrix(list(theta))),
)
M = d.matrix("m", "M", "matrix of the rotation with the quaternion (w, v)", "1", value=by_quaternion)
d

# %% [markdown]
# ## One rotation, four ways
#
# **From the Rodrigues vector.** Rodrigues' formula rotates a vector without an angle in it:
# $\vec\rho\,'=\vec\rho+\vec\theta\times(\vec\rho+\frac12\vec\theta\times\vec\rho)\,/\,(1+\frac14|\vec\theta|^2)$. It is
# linear in $\vec\rho$, so it is the product with a matrix.

# %%
identity = sp.Identity(3)
d.check(
    "rotate",
    equal(by_theta, identity + (skew(theta) + skew(theta) * skew(theta) / 2) / (1 + norm(theta) ** 2 / 4)),
    equal(by_theta * rho, rodrigues(rho, theta)),
    text="The matrix of a Rodrigues vector, and its product with a vector: Rodrigues' formula.",
).prove(
    because="Each cross product with θ is a product with [θ]×; the components of both sides are identical."
)

# %% [markdown]
# **From the quaternion.** The quaternion is the Rodrigues vector with its denominator taken off:
# $\vec\theta=2\vec v/w$. Its matrix exists for $w=0$, too, where $\vec\theta$ is infinite, and does not depend on the
# quaternion's length.

# %%
by_ratio = d.letter(
    r"matrix_of_ratio[3,3] | M(2\vec v/w) | matrix of the rotation with the Rodrigues vector 2 v / w | 1",
    matrix_from_rodrigues_vector(2 * sp.Matrix(list(v)) / w),
)
d.check(
    "matrix-from-quaternion",
    equal(M, identity + (2 * w * skew(v) + 2 * skew(v) * skew(v)) / (w**2 + norm(v) ** 2)),
    equal(M, by_ratio),
    text="The matrix of a quaternion is that of the Rodrigues vector 2 v / w.",
).prove(
    because="With θ = 2 v / w the denominator 1 + |θ|²/4 is (w² + |v|²) / w²; multiply numerator and denominator by "
    "w².",
)

# %% [markdown]
# **From axis and angle.** With the quaternion $(c, s\,\vec e)$, $c=\cos\frac\chi2$ and $s=\sin\frac\chi2$, the matrix
# is the textbook's, $\cos\chi\,I+\sin\chi\,[\vec e]_\times+(1-\cos\chi)\,\vec e\,\vec e^{\,T}$.

# %%
by_halves = d.letter(
    r"matrix_of_halves[3,3] | M(c,s\,\vec e) | matrix of the rotation with the quaternion (c, s e) | 1",
    matrix_from_quaternion(cosine, [sine * x for x in axis]),
)
by_angle = d.letter(
    r"matrix_of_angle[3,3] | M(\vec e,\chi) | matrix of the rotation about the axis e by the angle χ | 1",
    matrix_from_axis_angle(sp.Matrix(list(axis)), cosine**2 - sine**2, 2 * sine * cosine),
)
d.check(
    "matrix-from-axis-angle",
    equal(
        by_angle,
        (cosine**2 - sine**2) * identity + 2 * sine * cosine * skew(axis) + 2 * sine**2 * axis * axis.T,
    ),
    equal(by_halves, by_angle),
    text="The matrix of the quaternion (c, s e) is that of the axis e and the angle χ.",
    assumptions=[equal(norm(axis), 1), equal(cosine**2 + sine**2, 1)],
).prove(
    modulo={axis.components[2]: dot(axis, axis) - 1, cosine: cosine**2 + sine**2 - 1},
    because="cos χ = c² − s², sin χ = 2sc and 1 − cos χ = 2s² by the double angle, and [e]×² = e eᵀ − I for a unit "
    "vector.",
)

# %% [markdown]
# **In numbers.** Near a half turn $\vec\theta$ is huge, and its square overflows. Scaled by a small factor $k$, a power
# of two near $1/|\vec\theta|$, everything stays in range.

# %%
d.check(
    "rotate-scaled",
    equal(
        rodrigues(rho, theta),
        rho
        + cross(scale * theta, scale * rho + cross(scale * theta, rho) / 2)
        / (scale**2 + dot(scale * theta, scale * theta) / 4),
    ),
    text="Rodrigues' formula with the scaled vector k θ in place of θ.",
).prove(because="Numerator and denominator of the fraction are multiplied by k².")

# %% [markdown]
# **Back from the matrix to the quaternion.** Sums and differences of a matrix's entries $M_{ij}$ are the products of
# the quaternion's components. So each row of the symmetric matrix $4qq^T$ is the quaternion times four times one of
# its components. The row of the largest component is taken; in a unit quaternion that one is at least $\frac12$, so
# nothing small is divided by.


# %%
def quaternion_products(M):
    """4 q qᵀ of a rotation matrix."""
    trace = M.trace()
    top = [1 + trace, M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]
    rows = [top]
    for i in range(3):
        diagonal = [M[i, j] + M[j, i] for j in range(3)]
        diagonal[i] = 1 + 2 * M[i, i] - trace
        rows.append([top[i + 1], *diagonal])
    return sp.Matrix(rows)


d.check(
    "quaternion-from-matrix",
    equal(
        sp.ImmutableMatrix(quaternion_products(M.components)),
        4 * q * q.T / (w**2 + norm(v) ** 2),
    ),
    text="The products of a quaternion's components, from the entries of its matrix.",
).prove(because="With the entries of M inserted, all sixteen elements agree.")

# %% [markdown]
# ## The functions
#
# There is one for each pair of different ways, and `rotate` for Rodrigues' formula. Each returns a status as well: an
# ordinary rotation, no turn (the axis is not determined), a half turn, an input that is not quite of unit length or
# orthogonal, or no rotation at all.


# %%
class RotationStatus(IntEnum):
    """Kind of a converted rotation.

    ROTATION: a turn about a determined axis.
    IDENTITY: no turn; the axis is not determined, and is given as z.
    HALF_TURN: by pi to rounding; axis and opposite axis are the same, and the Rodrigues vector is huge.
    NOT_NORMAL: the axis or quaternion is not of unit length, or the matrix not orthogonal; it is brought to one.
    INVALID: not finite, a zero axis or quaternion, or a reflection; the result is NaN.
    """

    ROTATION = 0
    IDENTITY = 1
    HALF_TURN = 2
    NOT_NORMAL = 3
    INVALID = 4


def normalised(k, name, vector):
    """A vector of unit length, its squared length before (after scaling), and whether it has one."""
    size = k.let(f"{name}_size", sum((abs(x) / 4 for x in vector), sp.S.Zero))
    scaled = k.let(f"{name}_scaled", vector * power_of_two_scale(size))
    length = k.let(f"{name}_length", sp.sqrt(scaled.dot(scaled)))
    good = (size > 0) & (size <= LARGEST)
    unit = k.let(f"{name}_unit", scaled / select(length > 0, length, 1))
    deviation = k.let(f"{name}_deviation", abs(vector.dot(vector) - 1))
    return unit, good, sp.Not(deviation <= 16 * EPS)


def positive(k, w, v):
    """The one of the two quaternions of a rotation with w >= 0."""
    sign = k.let("quaternion_sign", select(w < 0, -1, 1))
    return k.let("w", sign * w), k.let("v", sign * v)


def from_axis_angle(k):
    axis = k.input("axis", 3, unit="1", doc="unit vector of the axis")
    angle = k.input("angle", unit="rad", doc="angle of rotation")
    half = k.let("half_angle", angle / 2)
    unit, good, abnormal = normalised(k, "axis", axis)
    w, v = positive(k, sp.cos(half), sp.sin(half) * unit)
    return w, v, good & (abs(angle) <= LARGEST), abnormal


def from_rodrigues_vector(k):
    theta = k.input("theta", 3, unit="1", doc="Rodrigues vector, 2 tan(angle/2) times the unit axis")
    size = k.let("size", 1 + sum((abs(x) / 8 for x in theta), sp.S.Zero))
    factor = k.let("factor", power_of_two_scale(size))
    scaled = k.let("theta_scaled", theta * factor / 2)
    length = k.let("length", sp.sqrt(factor**2 + scaled.dot(scaled)))
    return k.let("w", factor / length), k.let("v", scaled / length), size <= LARGEST, sp.false


def from_quaternion(k):
    quaternion = k.input("quaternion", 4, unit="1", doc="unit quaternion, scalar part first")
    unit, good, abnormal = normalised(k, "quaternion", quaternion)
    w, v = positive(k, unit[0], unit[1:4, 0])
    return w, v, good, abnormal


def from_matrix(k):
    matrix = k.input("matrix", (3, 3), unit="1", doc="rotation matrix")
    products = k.let("products", quaternion_products(matrix))
    column = products[:, 0]
    largest = products[0, 0]
    for n in range(1, 4):
        column = select(products[n, n] > largest, products[:, n], column)
        largest = select(products[n, n] > largest, products[n, n], largest)
        column, largest = k.let(f"column_{'abc'[n - 1]}", column), k.let(f"largest_{'abc'[n - 1]}", largest)
    length = k.let("length", sp.sqrt(column.dot(column)))
    w, v = positive(k, column[0] / length, column[1:4, 0] / length)
    gram = matrix.T * matrix - sp.eye(3)
    deviation = k.let("deviation", sum((abs(x) for x in gram), sp.S.Zero))
    determinant = k.let("determinant", matrix[:, 0].dot(matrix[:, 1].cross(matrix[:, 2])))
    return w, v, (determinant > 0) & (deviation <= LARGEST), sp.Not(deviation <= 64 * EPS)


def to_quaternion(k, w, v, length):
    return {"quaternion": (sp.Matrix([w, *v]), "1", "unit quaternion, scalar part first and not negative")}


def to_axis_angle(k, w, v, length):
    scaled = sp.Matrix(sp.symbols("v_scaled_1 v_scaled_2 v_scaled_3", real=True))
    unit = select(
        length > 0, scaled / select(length > 0, sp.sqrt(scaled.dot(scaled)), 1), sp.Matrix([0, 0, 1])
    )
    return {
        "axis": (unit, "1", "unit vector of the axis"),
        "angle": (2 * sp.atan2(length, w), "rad", "angle of rotation, 0 to pi"),
    }


def to_rodrigues_vector(k, w, v, length):
    # w is exactly 0 only for exact half turns; the smallest cosine that an angle in floating point has stands in
    return {
        "theta": (
            2 * v / select(w > EPS / 4, w, EPS / 4),
            "1",
            "Rodrigues vector, 2 tan(angle/2) times the unit axis",
        )
    }


def to_matrix(k, w, v, length):
    return {"matrix": (sp.eye(3) + 2 * w * skew(v) + 2 * skew(v) ** 2, "1", "rotation matrix")}


FROM = {
    "axis_angle": from_axis_angle,
    "rodrigues_vector": from_rodrigues_vector,
    "matrix": from_matrix,
    "quaternion": from_quaternion,
}
TO = {
    "axis_angle": to_axis_angle,
    "rodrigues_vector": to_rodrigues_vector,
    "matrix": to_matrix,
    "quaternion": to_quaternion,
}


def conversion(target, source):
    words = {name: name.replace("_", " ").replace("axis angle", "axis and angle") for name in FROM}
    k = KernelBuilder(
        f"{target}_from_{source}",
        summary=f"Convert a rotation from {words[source]} to {words[target]}.",
        source="derivation rotations; Stebulyanin and Pimushkin, eq. (1)",
    )
    w, v, good, abnormal = FROM[source](k)
    good = k.let("good", good)
    # scaled, because the square of a small turn vanishes below 1e-154
    scale = k.let("sine_scale", power_of_two_scale(sum((abs(x) for x in v), sp.S.Zero)))
    v_scaled = k.let("v_scaled", v * scale)
    length = k.let("sine", sp.sqrt(v_scaled.dot(v_scaled)) / scale)
    for name, (value, unit, doc) in TO[target](k, w, v, length).items():
        nan = sp.nan if not isinstance(value, sp.MatrixBase) else sp.ones(*value.shape) * sp.nan
        k.output(name, select(good, value, nan), unit=unit, doc=doc)
    status = sp.Piecewise(
        (RotationStatus.INVALID, sp.Not(good)),
        (RotationStatus.NOT_NORMAL, abnormal),
        (RotationStatus.IDENTITY, sp.Eq(length, 0)),
        (RotationStatus.HALF_TURN, w <= EPS),
        (RotationStatus.ROTATION, True),
        evaluate=False,
    )
    k.status("status", status, RotationStatus, doc="what the rotation is")
    return k.build()


def rotate():
    k = KernelBuilder(
        "rotate",
        summary="Rotate a vector by Rodrigues' formula.",
        source="Stebulyanin and Pimushkin, eq. (1)",
        notes="The Rodrigues vector is scaled first, so that half turns, where it is huge, do not overflow.",
    )
    rho = k.input("rho", 3, unit="length", doc="vector to rotate")
    theta = k.input("theta", 3, unit="1", doc="Rodrigues vector, 2 tan(angle/2) times the unit axis")
    factor = k.let("factor", power_of_two_scale(1 + sum((abs(x) / 8 for x in theta), sp.S.Zero)))
    turn = k.let("turn", theta * factor / 2)
    divisor = k.let("divisor", factor**2 + turn.dot(turn))
    inner = k.let("inner", factor * rho + turn.cross(rho))
    k.output("rotated", rho + 2 * turn.cross(inner) / divisor, unit="length", doc="the rotated vector")
    return k.build()


rotate_kernel = rotate()
kept = rotate_kernel.expand("rotated", keep=[rotate_kernel["factor"]])
kept = kept.subs(rotate_kernel.substitution(factor=scale, rho=list(rho), theta=list(theta)))
rotated = d.vector(
    "rotated", r"\vec\rho_{\mathrm{rotate}}", "what the function rotate returns", "length", value=kept
)

# %% [markdown]
# What `rotate` computes, written out from its own lines of code, is the formula proved above:

# %%
d.check(
    "kernel-rotate",
    equal(rotated, rodrigues(rho, theta)),
    text="The function rotate returns Rodrigues' formula, whatever its scale k is.",
).prove(because="The steps of the function are inserted into each other; k cancels.")

# %%
derivation.kernel(rotate_kernel)
derivation.kernel(*(conversion(target, source) for source in FROM for target in TO if target != source))
