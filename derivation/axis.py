# %% [markdown]
# # The axis from one pair of points: a solver without exceptions
#
# A point of a body is at $\vec\rho$ before and at $\vec\rho\,'$ after a rotation by the known angle $\chi$
# about an axis through the origin. With $\vec m=\vec\rho\,'+\vec\rho$, $\vec r=\vec\rho\,'-\vec\rho$ and
# $|\vec\rho\,'|=|\vec\rho|$ the unit axes that do this are
#
# $$\vec e_\pm=\frac{\cot\frac\chi2\;\vec m\times\vec r\;\pm\sqrt{|\vec m|^2-\cot^2\frac\chi2\,|\vec r|^2}\;\vec m}
# {|\vec m|^2},$$
#
# as the notebook on the paper of Stebulyanin and Pimushkin proves (`rodrigues`, entry `solution`).
#
# This notebook makes a program of that line, `solve_axis`, which is right to the last digits that the data allow, for
# every input: angles near 0 and near a half turn, a point that nearly lies on the axis, lengths from $10^{-120}$ to
# $10^{120}$, lengths that differ a little because they were measured. Each of its steps is proved to equal the formula,
# and each case that the formula does not cover gets a name. With the solver come the derivatives of the axes, their
# covariance, their condition number, and the residual that a fit over many pairs needs. The figure at the end
# shows the error of the result against exact arithmetic.

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
    explicit,
    in_notebook,
    norm,
    power_of_two_scale,
    rodrigues,
    select,
)

d = derivation = Derivation(
    "axis",
    title="The axis of a rotation from pairs of points: solver, derivatives, residual",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
)

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product. $\varepsilon$ is the machine epsilon of the number type, $2^{-52}$ in double
# precision.

# %%
theta = d.vector("theta", r"\vec\theta", "Rodrigues vector, 2 tan(χ/2) e", "1")
rho = d.vector("rho", r"\vec\rho", "point before the rotation", "length")
rho_prime = d.vector("rho_prime", r"\vec\rho'", "point after the rotation", "length")
R = d.symbol("R", r"R", "length of ρ", "length", positive=True)
P = d.symbol("P", r"P", "length of ρ′", "length", positive=True)
m = d.vector("m", r"\vec m", "sum of the two points, after they were brought to equal length", "length")
r = d.vector("r", r"\vec r", "their difference, likewise", "length")
S = d.symbol("S", r"S", "|sin(χ/2)|", "1", positive=True)
C = d.symbol("C", r"C", "cos(χ/2), with the sign of sin(χ/2) cos(χ/2)", "1")
d

# %% [markdown]
# ## First step: equal lengths
#
# Measured lengths differ. The nearest rotated point has the direction of $\vec\rho\,'$ and the length of
# $\vec\rho$: it is $\frac RP\vec\rho\,'=\vec\rho\,'-\delta\vec\rho\,'$ with the relative excess $\delta=1-R/P$. The
# solver does not scale the point. It computes $\delta$ and subtracts $\delta\vec\rho\,'$ from the sum
# $\vec\rho\,'+\vec\rho$ and from the difference $\vec\rho\,'-\vec\rho$. So it keeps the relative error of each
# near $\varepsilon$, however small it is; without that, the axis near a half turn would lose half of its digits.
#
# The excess is a small difference of lengths. It follows without cancellation from the difference of their squares,

# %%
d.check(
    "excess",
    equal((P**2 - R**2) / (P**2 + R * P), 1 - R / P),
    text="The excess of the length, from the difference of the squares.",
).prove(because="P² − R² = (P − R)(P + R), and P² + RP = P (P + R).")

# %% [markdown]
# and this in turn from the sum and the difference of the points, which are computed anyway:

# %%
d.check(
    "difference-of-squares",
    equal(dot(rho_prime + rho, rho_prime - rho), norm(rho_prime) ** 2 - norm(rho) ** 2),
    text="The difference of the squares is the product of sum and difference.",
).prove(because="Multiplied out, the mixed products cancel.")

# %% [markdown]
# ## Second step: sine and cosine in place of the cotangent
#
# At $\chi=0$ the cotangent is infinite. With numerator and denominator multiplied by $S=|\sin\frac\chi2|$, the formula
# has only finite numbers and one division:
#
# $$\vec e_\pm=\frac{C\,\vec m\times\vec r\pm\sqrt{S^2|\vec m|^2-C^2|\vec r|^2}\;\vec m}{S\,|\vec m|^2}.$$
#
# Where the radicand is negative the angle is smaller than the one between the points, and there is no such axis. The
# best one is then $\vec n=\vec m\times\vec r/(|\vec m||\vec r|)$ (notebook `axis_sensitivity`, entry
# `least-squares-axis`).
#
# The next four statements say where the formula comes from. In all of them $\vec\rho\,'$ is $\vec\rho$ rotated with the
# Rodrigues vector $\vec\theta$, so that the lengths agree.

# %%
w = cross(m, r)
root = sp.sqrt(S**2 * norm(m) ** 2 - C**2 * norm(r) ** 2)
plus = (C * w + root * m) / (S * norm(m) ** 2)
minus = (C * w - root * m) / (S * norm(m) ** 2)
given = {m: rodrigues(rho, theta) + rho, r: rodrigues(rho, theta) - rho}
quarter = dot(theta, theta) / 4  # tan²(χ/2)

d.check(
    "orthogonal",
    equal(dot(m, r), 0),
    text="Sum and difference of two vectors of equal length are perpendicular.",
).prove(given=given, because="The product is the difference of the squares of two lengths, which are equal.")

# %%
d.check(
    "area",
    equal(dot(cross(m, r), cross(m, r)), dot(m, m) * dot(r, r)),
    text="So their cross product is as long as the product of their lengths.",
).prove(given=given, because="Lagrange's identity, with (m, r) = 0.")

# %%
d.check(
    "axis-from-parts",
    equal(theta, (2 * cross(m, r) + dot(m, theta) * m) / norm(m) ** 2),
    text="The axis is the sum of its part along m × r and its part along m. The two signs of (m, θ) give the two axes.",
).prove(
    given=given,
    because="r = θ × m / 2, so that 2 m × r = m × (θ × m) = |m|² θ − (m, θ) m.",
)

# %%
d.check(
    "root",
    equal(dot(m, theta) ** 2 / dot(theta, theta), norm(m) ** 2 - norm(r) ** 2 / quarter),
    text="The part along m, |(m, e)|, is the root over S: on the right is the radicand over S², because C²/S² = "
    "cot²(χ/2) = 4/|θ|².",
).prove(
    given=given,
    because="r = θ × m / 2 gives 4|r|² = |θ × m|² = |θ|²|m|² − (m, θ)², by Lagrange's identity.",
)

# %% [markdown]
# ## The solver
#
# First both points are scaled by a power of two, which rounds nothing, to a length near 1. Then follow the two steps
# above. Where the formula does not apply, the solver returns a status that says why:
#
# | status | which axes the pair of points has |
# | --- | --- |
# | TWO_AXES | two; the first is at an acute angle to $\vec\rho$ |
# | ONE_AXIS | the two coincide to rounding, because the angle is that between the points |
# | NO_AXIS | none: too small an angle, or one point at the origin; the result is the least-squares axis |
# | PARALLEL | the point does not move; the axis is its direction, or the opposite |
# | PERPENDICULAR | a half turn to the opposite point; every axis perpendicular to $\vec\rho$ |
# | EVERY_AXIS | no turn and no motion, or both points at the origin |
# | LENGTHS_DIFFER | by more than is allowed; the result is for $\vec\rho\,'$ brought to the length of $\vec\rho$ |
# | INVALID | a point or the angle is NaN or infinite, or the tolerance is NaN |
#
# These are the tolerances that decide between the cases. $2a$ is the angle between the points, $\gamma$ that between
# the axis and the point:
#
# | where | tolerance | why |
# | --- | --- | --- |
# | $\sin\frac\chi2$ or $\cos\frac\chi2$ is zero | $\varepsilon\,\frac{\lvert\chi\rvert}2$ | rounding of the angle |
# | the angle is zero | $\varepsilon^4$ | squares stay in range above it |
# | the points coincide, or are opposite | $4\varepsilon R$ | each component is rounded by $\varepsilon/2$ |
# | axes meet, $\chi/2\geq a$ | $\varepsilon(1+\lvert\chi\rvert/2)$ in $\sin(\frac\chi2-a)$ | closer, they are one |
# | axes meet, $\chi/2<a$ | 4 times that | rounding of both points and of the angle |
# | axis parallel to the point | $4\varepsilon$ in $\sin\gamma$ | both axes have the point's direction to rounding |
# | lengths agree | $8\varepsilon$ at least | rounding of a point that was rotated in floating point |

# %%


class AxisStatus(IntEnum):
    """Which axes one pair of points has.

    TWO_AXES: two axes; the first is at an acute angle to rho.
    ONE_AXIS: the two coincide to rounding, because the angle is that between the points; both rows hold it.
    NO_AXIS: the angle is smaller than that between the points, or one point is at the origin; both rows are the
    least-squares axis.
    PARALLEL: the point does not move; the axis is its direction, or the opposite.
    PERPENDICULAR: a half turn to the opposite point; every axis perpendicular to rho, both rows are one of them.
    EVERY_AXIS: no turn and no motion, or both points at the origin; both rows are one of all axes.
    LENGTHS_DIFFER: more than allowed; the rows are the axes for rho_prime brought to the length of rho.
    INVALID: a point or the angle is NaN or infinite, or the tolerance is NaN; the rows are NaN.
    """

    TWO_AXES = 0
    ONE_AXIS = 1
    NO_AXIS = 2
    PARALLEL = 3
    PERPENDICULAR = 4
    EVERY_AXIS = 5
    LENGTHS_DIFFER = 6
    INVALID = 7


def quarter_size(vector):
    """Return a quarter of the sum of magnitudes: near the length, and finite for every finite vector."""
    return sum((abs(x) / 4 for x in vector), sp.S.Zero)


def input_pair(k):
    """Declare a pair of points and an angle as inputs."""
    return (
        k.input("rho", 3, unit="length", doc="point before the rotation"),
        k.input("rho_prime", 3, unit="length", doc="point after the rotation"),
        k.input("angle", unit="rad", doc="angle of the rotation"),
    )


def scaled_points(k, rho, rho_prime):
    """Scale both points to a length near 1; the same factor for both unless they are far apart."""
    size_before = k.let("size_before", quarter_size(rho))
    size_after = k.let("size_after", quarter_size(rho_prime))
    scale_before = k.let("scale_before", power_of_two_scale(size_before))
    scale_after = k.let("scale_after", power_of_two_scale(size_after))
    comparable = k.let("comparable", (scale_after < 8 * scale_before) & (scale_before < 8 * scale_after))
    scale = k.let("scale", select(comparable, scale_before, scale_after))
    u = k.let("u", rho * scale_before)
    v = k.let("v", rho_prime * scale)
    return u, v


def sum_and_difference(k, u, v):
    """Return m and r of two points, after the excess of the second length is removed."""
    difference = k.let("difference", v - u)
    total = k.let("total", v + u)
    length_squared = k.let("length_squared", u.dot(u))
    length_prime_squared = k.let("length_prime_squared", v.dot(v))
    length_product = k.let("length_product", sp.sqrt(length_squared * length_prime_squared))
    gain = k.let("gain", total.dot(difference))
    divisor = k.let("excess_divisor", length_prime_squared + length_product)
    nonzero = k.let("nonzero", divisor > 0)
    excess = k.let("excess", gain / select(nonzero, divisor, 1))
    return k.let("m", total - excess * v), k.let("r", difference - excess * v)


def half_turn_parts(k, angle):
    """Return S and C, scaled by a power of two so that the square of a small S does not vanish."""
    half = k.let("half_angle", angle / 2)
    sine = k.let("sine", sp.sin(half))
    cosine = k.let("cosine", sp.cos(half))
    size = k.let("sine_size", abs(sine))
    turn_scale = k.let("turn_scale", power_of_two_scale(select(size > EPS**2, size, EPS**2)))
    return (
        k.let("S", size * turn_scale),
        k.let("C", select(sine < 0, -cosine, cosine) * turn_scale),
        turn_scale,
    )


def root_parts(k, S, C, m, r):
    """Return |m|², |r|², the two terms under the root, and their difference."""
    m_squared = k.let("m_squared", m.dot(m))
    r_squared = k.let("r_squared", r.dot(r))
    along_m = k.let("along_m", S**2 * m_squared)
    n = k.let("n", C * r)  # a step of its own: in float32 the square of a small r, unscaled, vanishes
    along_n = k.let("along_n", n.dot(n))
    return m_squared, r_squared, along_m, along_n, k.let("root_squared", along_m - along_n)


def band_of(k, S, C, along_m):
    """Return the root's square that rounding makes: at most that, the two axes meet."""
    # There sin(χ/2 - a) = root² / (8 R² S |C|), because root² = 4 R² sin(χ/2 - a) sin(χ/2 + a) (entry condition).
    rounding = k.let("rounding", 8 * EPS * (1 + abs(k["half_angle"])) * k["length_squared"] * S * abs(C))
    return k.let("band", select(rounding < along_m / 2, rounding, along_m / 2))


def far_ratio(k, length_squared, other_squared):
    """Return the ratio of lengths, the second over the first, that are far apart."""
    return k.let("ratio", sp.sqrt(other_squared / length_squared)) * (k["scale_before"] / k["scale"])


def tilt_from(half_excess):
    """Return the tilt, (P - R) / (P + R), of points whose lengths are nearly equal."""
    return half_excess * (1 + half_excess**2)


# %%
def solve_axis():
    k = KernelBuilder(
        "solve_axis",
        summary="Unit axes through the origin that turn a point into another by a known angle.",
        source="Stebulyanin and Pimushkin, eq. (1), solved in the coordinate-free form",
        notes="The two rows are the axes at an acute and at an obtuse angle to rho. Elements are independent.",
    )
    rho, rho_prime, angle = input_pair(k)
    tolerance = k.input(
        "length_tolerance", unit="1", doc="relative difference of the lengths that is accepted"
    )
    u, v = scaled_points(k, rho, rho_prime)
    m, r = sum_and_difference(k, u, v)
    S, C, turn_scale = half_turn_parts(k, angle)
    m_squared, r_squared, along_m, _, root_squared = root_parts(k, S, C, m, r)
    w = k.let("w", m.cross(r))
    # steps that the functions above define
    names = ("half_angle", "sine_size", "cosine", "length_squared", "gain", "excess")
    half, sine_size, cosine, length_squared, gain, excess = (k[n] for n in names)
    size_before, size_after, comparable = k["size_before"], k["size_after"], k["comparable"]

    band = band_of(k, S, C, along_m)  # the root vanishes where the two axes meet, at χ/2 = a
    both = k.let("both", k["length_product"] > 0)
    # m and r are perpendicular, unless one of them is mere rounding; such an m determines no axis.
    area_squared = k.let("area_squared", w.dot(w))
    product = m_squared * r_squared
    plane = k.let("plane", (area_squared > product / 2) & (area_squared > EPS**4))  # above what underflows
    turns = sine_size > EPS**4  # below it the square of S underflows
    two = k.let("two", both & turns & (root_squared > band) & (plane | (m_squared >= r_squared)))
    # Where r is not quite perpendicular to m, by more than rounding of a few EPS, the rows are not of unit length.
    crooked = k.let("crooked", area_squared < (1 - 32 * EPS) * product)
    across = k.let(
        "across",
        select(abs(u[2]) > abs(u[0]), sp.Matrix([0, -u[2], u[1]]), sp.Matrix([-u[1], u[0], 0])),
    )
    under_root = select(two, root_squared, select(plane, area_squared, across.dot(across)))
    root = k.let("root", sp.sqrt(k.let("under_root", under_root)))
    divisor = k.let("divisor", select(two, S * m_squared, select(root > 0, root, 1)))
    inverse = k.let("inverse", 1 / divisor)
    w_factor = k.let("w_factor", inverse * select(two, C, select(C < 0, -1, 1)))
    m_factor = k.let("m_factor", select(two, inverse * root, 0))
    any_across = select(root > 0, across * inverse, sp.Matrix([0, 0, 1]))
    base = k.let("base", select(two | plane, w_factor * w, any_across))
    offset = k.let("offset", m_factor * m)
    finite = (size_before <= LARGEST) & (size_after <= LARGEST) & (abs(angle) <= LARGEST)
    is_number = (tolerance >= 0) | (tolerance <= 0)  # infinite: any lengths
    valid = k.let("valid", finite & is_number)
    rows = []
    for name, row in (("plus", base + offset), ("minus", base - offset)):
        row = k.let(name, row)
        square = select(crooked, row.dot(row), 1)
        rows.append(row * k.let(f"{name}_factor", select(crooked, 1 / sp.sqrt(square), 1)))
    axes = [select(valid, row, sp.Matrix([sp.nan] * 3)).T for row in rows]
    k.output("axes", sp.Matrix.vstack(*axes), unit="1", doc="two unit axes, one a row")

    both_zero = k.let("both_zero", sp.Eq(size_before, 0) & sp.Eq(size_after, 0))
    one_zero = k.let("one_zero", sp.Eq(size_before, 0) | sp.Eq(size_after, 0))
    coincident = k.let("coincident", 16 * EPS**2 * length_squared)
    no_turn = k.let("no_turn", (sine_size <= EPS * abs(half)) | (sine_size <= EPS**4))
    every = k.let("every", no_turn & (r_squared <= coincident))
    opposite = k.let("opposite", (abs(cosine) <= EPS * abs(half)) & (m_squared <= coincident))
    too_small = k.let("too_small", no_turn | (root_squared < -4 * band))
    # sin γ <= 4 EPS in |r|² = 4 R² sin²(χ/2) sin²γ; the step S is sin(χ/2) times turn_scale, so r takes that, too
    still = 64 * EPS**2 * length_squared * S**2
    scaled_r = k.let("scaled_r", turn_scale * r)
    parallel = k.let("parallel", scaled_r.dot(scaled_r) <= still)
    least = k.let("least_tolerance", select(tolerance > 8 * EPS, tolerance, 8 * EPS))
    # excess / (1 - excess) = |rho_prime| / |rho| - 1, which is what length_mismatch returns
    near = abs(excess) <= least * (1 - excess)
    far = far_ratio(k, select(length_squared > 0, length_squared, 1), k["length_prime_squared"])
    agree = k.let("lengths_agree", (comparable & near) | (sp.Not(comparable) & (abs(far - 1) <= least)))
    status = sp.Piecewise(
        (AxisStatus.INVALID, sp.Not(valid)),
        (AxisStatus.EVERY_AXIS, both_zero),
        (AxisStatus.NO_AXIS, one_zero),
        (AxisStatus.LENGTHS_DIFFER, sp.Not(agree)),
        (AxisStatus.EVERY_AXIS, every),
        (AxisStatus.PERPENDICULAR, opposite),
        (AxisStatus.NO_AXIS, too_small),
        (AxisStatus.ONE_AXIS, sp.Not(two)),
        (AxisStatus.PARALLEL, parallel),
        (AxisStatus.TWO_AXES, True),
        evaluate=False,
    )
    k.status("status", status, AxisStatus, doc="what the axes are")

    # Where nothing is near a case distinction or the ends of the number range, and the lengths are nearly equal, most
    # of the work falls away. m and r are made equally long by the tilt (entries tilt to tilt-series), without a root,
    # and keep the factor that this leaves in both. There the step `excess` is half the relative difference of the
    # lengths, to 2⁻¹¹ of itself. The tangent takes the place of sine and cosine (entry common-factor-turn); its sign
    # goes into the divisor.
    total, difference = k["total"], k["difference"]
    squares = k["excess_divisor"]  # 2 (R² + P²)
    tilt = tilt_from(excess)
    S = k["S"]  # |tan(χ/2)| here; S / (1 + S) is below the sine
    k.usual(
        (squares > 4 * EPS**2)
        & (squares < 4 * EPS**-2)
        & (abs(excess) <= sp.Rational(1, 2**12))
        & is_number
        & (agree | (abs(excess) >= least * 5 / 8))
        & (16 * gain**2 < m_squared * r_squared)
        & (abs(half) < 2**3)
        & (S * m_squared > 2**4 * sp.sqrt(EPS) * (1 + S) * squares)
        & (root_squared > 2 * sp.sqrt(EPS) * along_m)  # with the line before, more than twice the band
        & (root_squared < along_m),
        scale_before=1,
        scale=1,
        turn_scale=1,
        valid=True,
        nonzero=True,
        comparable=True,
        excess_divisor=4 * length_squared + 2 * gain,
        **{f"m_{n + 1}": total[n] - tilt * difference[n] for n in range(3)},
        **{f"r_{n + 1}": difference[n] - tilt * total[n] for n in range(3)},
        sine=sp.tan(half),
        C=1,
        divisor=k["sine"] * m_squared,
        m_factor=abs(inverse) * root,
        crooked=False,
        lengths_agree=abs(excess) <= least * 3 / 8,
        both_zero=False,
        one_zero=False,
        every=False,
        opposite=False,
        too_small=False,
        parallel=False,
        two=True,
    )
    return k.build()


solver = solve_axis()

# %% [markdown]
# ## Proof of the solver
#
# The steps of the program are inserted into each other, and the result is compared with the formulas above. First, its
# $\vec m$ and $\vec r$ are those of the points brought to equal length, $\frac RP\vec\rho\,'\pm\vec\rho$. (The common
# factor of the scaling is left out.)


# %%
def renamed(value, **vectors):
    """Put the derivation's symbols in place of a kernel's."""
    vectors = {name: list(explicit(vector)) for name, vector in vectors.items()}
    return value.subs(solver.substitution(S=S, sine_size=S, C=C, **vectors))


computed_m, computed_r = (
    d.letter(
        rf"computed_{name}[3] | \vec {name}_{{\mathrm{{computed}}}} | {name} as the program computes it | length",
        sp.ImmutableMatrix(
            renamed(
                solver.expand(solver[name], keep=[solver["excess"], solver["u"], solver["v"]]).subs(
                    solver["excess"], 1 - R / P
                ),
                u=rho,
                v=rho_prime,
            )
        ),
    )
    for name in ("m", "r")
)
d.check(
    "kernel-m",
    equal(computed_m, R / P * rho_prime + rho),
    text="The program's m is the sum of the points brought to equal length.",
).prove(because="The program subtracts δ ρ′ from the sum, with δ = 1 − R/P (entry excess).")

# %%
d.check(
    "kernel-r",
    equal(computed_r, R / P * rho_prime - rho),
    text="The program's r is their difference.",
).prove(because="The program subtracts δ ρ′ from the difference, with δ = 1 − R/P.")

# %% [markdown]
# From these it computes the two axes of the formula:

# %%
kept = solver.expand("axes", keep=[solver[n] for n in ("m", "r", "w", "S", "C", "two", "crooked", "valid")])
kept = renamed(kept.subs(solver.substitution(two=True, crooked=False, valid=True)), m=m, r=r, w=w)


def as_vectors(rows, name, letter, quantity):
    """Letters for the two rows that a program returns."""
    return [
        d.letter(
            rf"{name}_{sign}[3] | \vec e_{{{mark}}}^{{\,\mathrm{{{letter}}}}} | {row} row of {quantity} | 1",
            sp.ImmutableMatrix(rows.row(n).T),
        )
        for n, (sign, mark, row) in enumerate((("plus", "+", "first"), ("minus", "-", "second")))
    ]


computed_plus, computed_minus = as_vectors(kept, "computed", "computed", "the axes that the program returns")
d.check(
    "kernel-axes",
    equal(computed_plus, plus),
    equal(computed_minus, minus),
    text="The two rows of the program are e₊ and e₋.",
    assumptions=["the status is TWO_AXES, and m and r are perpendicular"],
).prove(because="The program multiplies by the inverse of S |m|² instead of dividing; the components agree.")

# %% [markdown]
# Most pairs are nowhere near a special case. For them the program has a shorter form, without the scaling, without the
# distinction of cases, and without bringing the points to equal length: it takes the tilt $\tau=\frac{P-R}{P+R}$ and
#
# $$\vec m=(\vec\rho\,'+\vec\rho)-\tau\,(\vec\rho\,'-\vec\rho),\qquad
# \vec r=(\vec\rho\,'-\vec\rho)-\tau\,(\vec\rho\,'+\vec\rho).$$
#
# These are the vectors above, times a factor that both have, and such a factor leaves the axes as they are:

# %%
total, difference = rho_prime + rho, rho_prime - rho
tau = d.symbol("tau", r"\tau", "tilt, (P − R)/(P + R)", "1")
by_lengths = {tau: (P - R) / (P + R)}
d.check(
    "tilt",
    equal(total - tau * difference, 2 * P / (P + R) * (R / P * rho_prime + rho)),
    equal(difference - tau * total, 2 * P / (P + R) * (R / P * rho_prime - rho)),
    text="Sum and difference of the points brought to equal length, times 2P/(P + R).",
).prove(given=by_lengths, because="1 − τ = 2R/(P + R) and 1 + τ = 2P/(P + R).")

# %%
factor = d.symbol("factor", r"\lambda", "any factor", "1", positive=True)
longer = {x: factor * x for x in (*m.components, *r.components)}
d.check(
    "common-factor",
    equal(plus, plus.subs(longer, simultaneous=True)),
    equal(minus, minus.subs(longer, simultaneous=True)),
    text="A factor of both m and r cancels in the axes.",
).prove(because="Numerator and denominator are of the second degree in them.")

# %% [markdown]
# A small tilt takes no root. It is a series in the quotient of $P^2-R^2$ and $2(P^2+R^2)$:

# %%
d.check(
    "tilt-quotient",
    equal((P**2 - R**2) / (4 * R**2 + 2 * (P**2 - R**2)), tau / (1 + tau**2)),
    text="The quotient by the tilt.",
).prove(given=by_lengths, because="1 + τ² = 2 (P² + R²)/(P + R)².")

# %%
d.check(
    "tilt-series",
    equal(sp.series(tilt_from(tau / (1 + tau**2)), tau, 0, 5).removeO(), tau),
    text="What the program computes from the quotient is the tilt to the fourth order.",
).prove(because="The coefficients of the series in τ agree.")

# %% [markdown]
# The form is used where the quotient is at most $2^{-12}$: lengths that differ by up to 1/2000. What is cut off is then
# below $\varepsilon$ times the condition number. The angle between sum and difference has to be more than 75°, too:
# nearer to a parallel pair, $\vec m$ or $\vec r$ would lose digits in the subtraction.
#
# $S$ and $C$ are divided by $\lvert\cos\frac\chi2\rvert$ here: they are $|t|$ and the sign of $t=\tan\frac\chi2$, one
# function in place of two. A factor of both cancels as well:

# %%
longer = {S: factor * S, C: factor * C}
d.check(
    "common-factor-turn",
    equal(C / S, (C / S).subs(longer, simultaneous=True)),
    equal((root / S) ** 2, ((root / S) ** 2).subs(longer, simultaneous=True)),
    text="In the axes S and C stand only in C/S and in the root over S, where a factor of both cancels.",
    assumptions=["the factor is positive, so that the root takes it without a change of sign"],
).prove(because="The radicand is of the second degree in S and C.")

# %% [markdown]
# The rest of the program is the same:

# %%
t_size = d.symbol("t_size", r"|t|", "|tan(χ/2)|", "1", positive=True)
usual = solver.usual_case()
short = renamed(usual.expand("axes", keep=[usual[n] for n in ("sine", "m", "r")]), m=m, r=r)
for sign, name in ((1, "positive"), (-1, "negative")):
    rows = as_vectors(
        short.subs(usual["sine"], sign * t_size),
        f"short_{name}",
        f"short, {name}",
        "the axes that the shorter form returns",
    )
    formula = (axis.subs({S: t_size, C: sign}) for axis in (plus, minus))
    d.check(
        f"kernel-usual-{name}",
        *(equal(*pair) for pair in zip(rows, formula, strict=True)),
        text=f"The two rows of the shorter form are e₊ and e₋ of its m and r, S and C, where t is {name}.",
    ).prove(
        because="Its steps are those of the program with every distinction decided; the components agree."
    )

# %% [markdown]
# ## How far an error is amplified
#
# An error in the points, relative to their length, is multiplied in the axis by at most the condition number
#
# $$\mathrm{cond}=\frac1{2\sqrt{\sin(\frac\chi2-a)\sin(\frac\chi2+a)}}
# =\frac R{\sqrt{S^2|\vec m|^2-C^2|\vec r|^2}}$$
#
# (notebook `axis_sensitivity`, entry `condition`). The second form takes one step from the solver's own numbers. The
# two agree, because the radicand is a product of two sines:

# %%
a = d.symbol("a", r"a", "half the angle between the points", "rad")
h = d.symbol("h", r"\tfrac{\chi}{2}", "half the angle of rotation", "rad")
d.check(
    "condition",
    equal(
        sp.sin(h) ** 2 * (2 * R * sp.cos(a)) ** 2 - sp.cos(h) ** 2 * (2 * R * sp.sin(a)) ** 2,
        4 * R**2 * sp.sin(h - a) * sp.sin(h + a),
    ),
    text="The radicand in terms of the two angles.",
    assumptions=["|m| = 2R cos a and |r| = 2R sin a, as in axis_sensitivity, entry gap"],
).prove(
    sp.expand(
        sp.expand_trig(
            4
            * R**2
            * (
                sp.sin(h) ** 2 * sp.cos(a) ** 2
                - sp.cos(h) ** 2 * sp.sin(a) ** 2
                - sp.sin(h - a) * sp.sin(h + a)
            )
        )
    ),
    because="By the addition theorems sin(χ/2 − a) sin(χ/2 + a) = (sin(χ/2) cos a)² − (cos(χ/2) sin a)².",
)

# %% [markdown]
# The relative difference of the two lengths, by which measured data can be judged, is computed by another function,
# with the excess above.


# %%
def length_mismatch():
    k = KernelBuilder(
        "length_mismatch",
        summary="Relative difference of two lengths, |rho_prime| / |rho| - 1.",
        source="Stebulyanin and Pimushkin; the paper takes both lengths as equal",
    )
    rho = k.input("rho", 3, unit="length", doc="point before the rotation")
    rho_prime = k.input("rho_prime", 3, unit="length", doc="point after the rotation")
    u, v = scaled_points(k, rho, rho_prime)
    comparable = k["comparable"]
    difference, total = k.let("difference", v - u), k.let("total", v + u)
    length_squared, other_squared = k.let("length_squared", u.dot(u)), k.let("other_squared", v.dot(v))
    product = k.let("length_product", sp.sqrt(length_squared * other_squared))
    near = total.dot(difference) / (length_squared + product)
    far = far_ratio(k, length_squared, other_squared) - 1
    same = sp.Eq(length_squared, 0) & sp.Eq(other_squared, 0)
    k.output(
        "mismatch", select(same, 0, select(comparable, near, far)), unit="1", doc="|rho_prime| / |rho| - 1"
    )
    return k.build()


def axis_condition():
    k = KernelBuilder(
        "axis_condition",
        summary="Condition number of the axis: largest factor from a relative error of a point to the axis.",
        source="Stebulyanin and Pimushkin, eq. (1); derivation axis, entry condition",
        notes="Infinite where the two axes meet and beyond (ONE_AXIS, NO_AXIS). NaN where a number is not finite.",
    )
    rho, rho_prime, angle = input_pair(k)
    u, v = scaled_points(k, rho, rho_prime)
    m, r = sum_and_difference(k, u, v)
    S, C, turn_scale = half_turn_parts(k, angle)
    _, _, along_m, _, root_squared = root_parts(k, S, C, m, r)
    length_squared = k["length_squared"]
    band = band_of(k, S, C, along_m)
    finite = (k["size_before"] <= LARGEST) & (k["size_after"] <= LARGEST) & (abs(angle) <= LARGEST)
    length = sp.sqrt(k.let("positive", select(sp.Eq(length_squared, 0), 1, length_squared)))
    under = k.let("under_root", select(root_squared > band, root_squared, 0))
    found = select(finite, turn_scale * length / sp.sqrt(under), sp.nan)
    k.output("condition", found, unit="1", doc="condition number; NaN where a number is not finite")
    return k.build()


# %% [markdown]
# ## Derivatives and covariance
#
# The derivatives $J_\rho$, $J_{\rho'}$ and $j_\chi$ of both axes with respect to both points and the angle are made
# from the solver's own program, line by line. With the covariance matrices $\Sigma_\rho$ and $\Sigma_{\rho'}$ of the
# points and the variance $\sigma_\chi^2$ of the angle they give the covariance of each axis,
# $\Sigma_e=J_\rho\Sigma_\rho J_\rho^T+J_{\rho'}\Sigma_{\rho'}J_{\rho'}^T+\sigma_\chi^2\,j_\chi j_\chi^T$. Where the
# two axes meet, or there is none, there is no covariance.

# %%
jacobian = solver.jacobian(
    ("rho", "rho_prime", "angle"),
    ("axes",),
    name="axis_jacobian",
    summary="Derivatives of both axes with respect to both points and the angle.",
)


def axis_covariance():
    k = KernelBuilder(
        "axis_covariance",
        summary="Covariance of both axes from those of the points and the angle, to first order.",
        source="GUM, law of propagation of uncertainty, on Stebulyanin and Pimushkin, eq. (1)",
    )
    derivatives = k.include(jacobian)
    cov_rho = k.input("cov_rho", (3, 3), unit="length²", doc="covariance of rho")
    cov_prime = k.input("cov_rho_prime", (3, 3), unit="length²", doc="covariance of rho_prime")
    var_angle = k.input("var_angle", unit="rad²", doc="variance of the angle")
    covariance = []
    for row in range(2):
        J = sp.Matrix(3, 7, lambda i, j, row=row: derivatives["axes_jacobian"][row, i, j])
        half_rho = k.let(f"half_rho_{'ab'[row]}", J[:, 0:3] * cov_rho)
        half_prime = k.let(f"half_prime_{'ab'[row]}", J[:, 3:6] * cov_prime)
        covariance.append(half_rho * J[:, 0:3].T + half_prime * J[:, 3:6].T + var_angle * J[:, 6] * J[:, 6].T)
    # where the axes meet, or are not those of the formula, there is no covariance
    blocks = [[select(k["two"], number, sp.nan) for number in block] for block in covariance]
    blocks = sp.ImmutableDenseNDimArray(blocks).reshape(2, 3, 3)
    k.output("covariance", blocks, unit="1", doc="covariance of each axis, one 3x3 matrix a row")
    k.status("axis_status", derivatives["status"], AxisStatus, doc="what the axes are")
    return k.build()


# %% [markdown]
# ## The residual of a pair
#
# For a fit over many pairs the axis goes through a point $\vec p$. The residual of a pair is
# $\vec\rho\,'-\vec p-Q(\vec\rho-\vec p)$ with the rotation $Q$ by $\chi$ about $\vec e$. At small angles the rotated
# point nearly agrees with the one before, and the difference would lose digits. So the residual is computed as
# $(\vec\rho\,'-\vec\rho)-(Q\vec x-\vec x)$ with $\vec x=\vec\rho-\vec p$ and the displacement
#
# $$Q\vec x-\vec x=2\sin\tfrac\chi2\;\vec e\times\bigl(\cos\tfrac\chi2\,\vec x+\sin\tfrac\chi2\,\vec e\times\vec
# x\bigr).$$

# %%
e = d.vector("axis", r"\vec e", "unit axis", "1")
x = d.vector("x", r"\vec x", "point relative to a point on the axis", "length")
sine, cosine = sp.sin(h), sp.cos(h)
d.check(
    "displacement",
    equal(
        2 * sine * cross(e, cosine * x + sine * cross(e, x)),
        2 * sine * cosine * cross(e, x) + 2 * sine**2 * cross(e, cross(e, x)),
    ),
    text="This is sin χ e × x + (1 − cos χ) e × (e × x), Rodrigues' formula.",
).prove(because="sin χ = 2 sin(χ/2) cos(χ/2) and 1 − cos χ = 2 sin²(χ/2).")

# %%
tangent = d.symbol("tangent", r"t", "tan(χ/2)", "1")
d.check(
    "displacement-is-rodrigues",
    equal(
        rodrigues(x, 2 * tangent * e) - x,
        2 * tangent / (1 + tangent**2) * cross(e, x + tangent * cross(e, x)),
    ),
    text="The same from eq. (1) of the paper: for a unit axis the displacement is that of the Rodrigues vector 2t e.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo={e.components[2]: dot(e, e) - 1},
    because="|2t e|²/4 = t². With t = tan(χ/2), 2t / (1 + t²) is 2 sin(χ/2) cos(χ/2).",
)

# %%


def axis_residual():
    k = KernelBuilder(
        "axis_residual",
        summary="Residual of a pair of points for a rotation about a given axis, and its derivatives.",
        source="Stebulyanin and Pimushkin, eq. (1); derivation axis, entry displacement",
        notes="The axis must be a unit vector; derivatives are those of the formula, without that constraint.",
    )
    rho, rho_prime, angle = input_pair(k)
    axis = k.input("axis", 3, unit="1", doc="unit vector of the axis")
    point = k.input("point", 3, unit="length", doc="a point on the axis")
    half = k.let("half_angle", angle / 2)
    sine, cosine = k.let("sine", sp.sin(half)), k.let("cosine", sp.cos(half))
    arm = k.let("arm", rho - point)
    inner = k.let("inner", cosine * arm + sine * axis.cross(arm))
    moved = k.let("moved", rho_prime - rho)
    k.output(
        "residual", moved - 2 * sine * axis.cross(inner), unit="length", doc="rho_prime minus the rotated rho"
    )
    return k.build()


residual = axis_residual().jacobian(("axis", "point"), name="axis_residual", values=True)

# %%
derivation.kernel(solver, length_mismatch(), axis_condition(), jacobian, axis_covariance(), residual)

# %% [markdown]
# ## Accuracy
#
# For every angle of rotation $\chi$ and every angle $\gamma$ between axis and point, six points are drawn, turned and
# rounded to double precision; the exact axes of the rounded points are found with 50 digits. The maps show the largest
# error of a component, in units of $\varepsilon$. On the left is the kernel. On the right is the same formula when both
# points are first divided by their lengths: that rounds them once more, and costs up to
# $\mathrm{cond}=1/(2\sin\frac\chi2\,\lvert\cos\gamma\rvert)$ times $\varepsilon$. The kernel pays that only where
# the two axes nearly meet.

# %%
if in_notebook():
    from rodgen.derivation.figures import axis as figures
    from rodgen.derivation.figures import show
    from rodgen.generated.numpy import axis as generated

    show(figures.accuracy(generated.solve_axis))
