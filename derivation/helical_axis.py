# %% [markdown]
# # The helical axis of a motion, finite and instantaneous
#
# Any displacement of a rigid body is a screw: a rotation by an angle $\chi$ about an axis, and a slide $s$ along it.
# The axis is the unit vector $\vec e$ through the point $\vec p$. A point of the body at $\vec x$ goes to
#
# $$\vec y=\vec p+Q(\vec x-\vec p)+s\,\vec e,$$
#
# where $Q$ is Rodrigues' rotation. This notebook proves what a fit of such an axis to measured points or poses needs:
# screws about one axis add, the residual of a reading, and the axis of a body whose velocity is known.

# %%
import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import Derivation, cross, dot, equal, norm

d = derivation = Derivation(
    "helical_axis",
    title="The helical axis of a motion, finite and instantaneous",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
)

# %% [markdown]
# ## Symbols
#
# $(\vec a,\vec b)$ is the scalar product. Sines and cosines of the angle are rational functions of $t=\tan\frac\chi2$,
# so that the proofs are proofs about polynomials.

# %%
t = d.symbol("t", r"t", "tan(χ/2)", "1")
u = d.symbol("u", r"u", "tan(ψ/2), ψ the angle of a second screw", "1")
h = d.symbol("h", r"h", "half of the angle, χ/2", "rad")
s = d.symbol("s", r"s", "slide along the axis", "length")
r = d.symbol("r", r"r", "slide of a second screw", "length")
e = d.vector("e", r"\vec e", "unit vector of the axis", "1")
p = d.vector("p", r"\vec p", "point on the axis", "length")
x = d.vector("x", r"\vec x", "point before the motion", "length")
y = d.vector("y", r"\vec y", "point after the motion", "length")
unit = {e.components[2]: dot(e, e) - 1}
d

# %% [markdown]
# ## Screws about one axis add
#
# Readings of a body in many places, all reached about one axis, have one unknown each for angle and slide, counted from
# any one of the places. That place is a reading like the others: its errors are in the model once, however many of
# the others are compared with it.


# %%
def turned(v, tangent):
    """Rodrigues' rotation about the unit axis, by the angle with this tangent of its half."""
    return v + 2 * tangent / (1 + tangent**2) * (cross(e, v) + tangent * cross(e, cross(e, v)))


def screwed(v, tangent, slide):
    """A screw about the axis through p."""
    return p + turned(v - p, tangent) + slide * e


axis_along_z = {e: (0, 0, 1)}
d.check(
    "screws-add",
    equal(screwed(screwed(x, t, s), u, r), screwed(x, (t + u) / (1 - t * u), s + r)),
    text="Two screws about one axis are one: angles and slides add. tan((χ + ψ)/2) = (t + u)/(1 − t u).",
    assumptions=["e along Oz; both sides turn with the frame"],
).prove(
    given=axis_along_z,
    because="The rotation leaves e where it is, so slides add; in the plane across e angles add.",
)

# %% [markdown]
# ## The residual of a reading
#
# At small angles $\vec y$ nearly agrees with $\vec x$. So the residual is formed from their difference, which is exact,
# and from the displacement of the rotation, whose form is that of the derivation `axis`, entry `displacement`.

# %%
arm = x - p
d.check(
    "residual",
    equal(
        (y - x) - 2 * t / (1 + t**2) * cross(e, arm + t * cross(e, arm)) - s * e,
        y - screwed(x, t, s),
    ),
    text="The residual of a reading. The factors are 2 sin(χ/2) cos(χ/2) and 2 sin²(χ/2), with t = tan(χ/2).",
).prove(because="y − p − (x − p) = y − x.")

# %% [markdown]
# ## Where a fit starts
#
# Of rotations $Q_k$ about one axis, the axis is the direction that none of them moves: it makes
# $\sum|Q_k\vec e-\vec e|^2=(\vec e,\sum(2I-Q_k-Q_k^T)\,\vec e)$ zero, at half turns as at small ones. A unit
# vector $\vec v$ across the axis has there $2-2\cos\chi$, so noise moves the least eigenvector little.

# %%
v = d.vector("v", r"\vec v", "any vector", "1")
d.check(
    "unmoved",
    equal(
        norm(turned(v, t) - v) ** 2,
        4 * t**2 / (1 + t**2) * (norm(v) ** 2 - dot(e, v) ** 2),
    ),
    text="By how much a rotation moves a vector: nothing along the axis, a chord across it.",
    assumptions=[equal(norm(e), 1)],
).prove(modulo=unit, because="2 − 2 cos χ = 4 t²/(1 + t²).")

# %% [markdown]
# The axial part of the rotation tells the sense of the turn, and its trace the rest:

# %%
columns = [d.value(turned(v, t), {v: tuple(int(i == j) for i in range(3))}) for j in range(3)]
axial = [columns[1][2] - columns[2][1], columns[2][0] - columns[0][2], columns[0][1] - columns[1][0]]
components = e.components
sense = d.letter(
    r"sense | (\vec e, \mathrm{ax}\,Q) | axis times (Q32 − Q23, Q13 − Q31, Q21 − Q12) | 1",
    sum(c * a for c, a in zip(components, axial, strict=True)),
)
trace = d.letter(r"trace | \mathrm{tr}\,Q | trace | 1", columns[0][0] + columns[1][1] + columns[2][2])
d.check(
    "sense", equal(sense, 4 * t / (1 + t**2)), text="Twice the sine.", assumptions=[equal(norm(e), 1)]
).prove(modulo=unit, because="The part of Q that changes sign with it is sin χ e ×.")
d.check(
    "trace",
    equal(trace, 1 + 2 * (1 - t**2) / (1 + t**2)),
    text="One more than twice the cosine.",
    assumptions=[equal(norm(e), 1)],
).prove(modulo=unit, because="The trace does not depend on the axis.")

# %% [markdown]
# ## The axis of a velocity
#
# A body turns with the angular velocity $\vec\omega$ while its point at $\vec r$ moves with $\vec v$. The point at
# $\vec q$ then moves with $\vec v+\vec\omega\times(\vec q-\vec r)$. Which points move along $\vec\omega$ only? Those of
# the instantaneous helical axis. Its point nearest to a given $\vec o$ is
#
# $$\vec q=\vec o+\vec a-\frac{(\vec a,\vec\omega)}{|\vec\omega|^2}\vec\omega
# +\frac{\vec\omega\times\vec v}{|\vec\omega|^2},
# \qquad\vec a=\vec r-\vec o,$$
#
# and the pitch, the slide for each radian, is $(\vec\omega,\vec v)/|\vec\omega|^2$.

# %%
omega = d.vector("omega", r"\vec\omega", "angular velocity", "rad/time")
velocity = d.vector("velocity", r"\vec v", "velocity of the body's point at r", "length/time")
position = d.vector("position", r"\vec r", "point of the body", "length")
origin = d.vector("origin", r"\vec o", "point to which the axis is related", "length")
square = dot(omega, omega)
a = position - origin
place = origin + a - dot(a, omega) / square * omega + cross(omega, velocity) / square
d.check(
    "slides-only",
    equal(velocity + cross(omega, place - position), dot(omega, velocity) / square * omega),
    text="A point of the axis moves along it, with the pitch times ω.",
    assumptions=["ω is not zero"],
).prove(because="ω × (ω × v) = (ω, v) ω − |ω|² v, and ω × ω = 0.")
d.check(
    "nearest",
    equal(dot(place - origin, omega), 0),
    text="The point is the one nearest to o.",
    assumptions=["ω is not zero"],
).prove(because="(ω × v, ω) = 0.")

# %% [markdown]
# ## The turn of an angular velocity that changes
#
# By which one turn does a body turn in the time $\tau$ whose angular velocity begins with $\vec\omega$ and gains
# $\vec\alpha$ in a unit of time? Magnus' series has its rotation vector: the integral of the angular velocity, then
# half the double integral of the cross product of each angular velocity with every earlier one. The terms after that
# are of the order $\tau^5$.

# %%
alpha = d.vector("alpha", r"\vec\alpha", "change of the angular velocity in a unit of time", "rad/s²")
tau = d.symbol("tau", r"\tau", "time", "s", positive=True)
late, early = sp.symbols("late early", real=True)
first, change = (sp.Matrix(v.components) for v in (omega, alpha))
product = (first + late * change).cross(first + early * change)
double = d.letter(
    r"double[3] | \vec\Omega_2 | half the double integral of the cross products | rad",
    product.applyfunc(lambda c: sp.integrate(sp.integrate(c, (early, 0, late)), (late, 0, tau)) / 2),
)
d.check(
    "changing-turn",
    equal(double, -(tau**3) / 12 * cross(omega, alpha)),
    text="By this the rotation vector differs from the integral ω τ + α τ²/2.",
).prove(because="The product is (t − t′) α × ω for times t after t′, whose double integral is τ³/6 α × ω.")

# %%


def screw_residual():
    k = KernelBuilder(
        "screw_residual",
        summary="Residual of a reading of a point after a screw about a given axis, and its derivatives.",
        source="derivation helical_axis, entry residual",
        notes="The axis must be a unit vector; derivatives are those of the formula, without that constraint.",
    )
    before = k.input("before", 3, unit="length", doc="point before the screw")
    reading = k.input("reading", 3, unit="length", doc="reading of the point after it")
    angle = k.input("angle", unit="rad", doc="angle of the screw")
    slide = k.input("slide", unit="length", doc="slide along the axis")
    axis = k.input("axis", 3, unit="1", doc="unit vector of the axis")
    point = k.input("point", 3, unit="length", doc="a point on the axis")
    half = k.let("half_angle", angle / 2)
    sine, cosine = k.let("sine", sp.sin(half)), k.let("cosine", sp.cos(half))
    from_axis = k.let("arm", before - point)
    inner = k.let("inner", cosine * from_axis + sine * axis.cross(from_axis))
    moved = k.let("moved", reading - before)
    k.output(
        "residual",
        moved - 2 * sine * axis.cross(inner) - slide * axis,
        unit="length",
        doc="reading minus the point after the screw",
    )
    return k.build()


def velocity_axis():
    k = KernelBuilder(
        "velocity_axis",
        summary="Instantaneous helical axis of a body from its velocity, and its derivatives.",
        source="derivation helical_axis, entries slides-only and nearest",
        notes="Nothing of it is defined where the angular velocity is zero.",
    )
    turning = k.input("omega", 3, unit="rad/time", doc="angular velocity")
    speed = k.input("velocity", 3, unit="length/time", doc="velocity of a point of the body")
    at = k.input("position", 3, unit="length", doc="where that point is")
    near = k.input("origin", 3, unit="length", doc="the axis's point nearest to it is wanted")
    rate = k.let("rate", sp.sqrt(turning.dot(turning)))
    along = k.let("along", turning / rate)
    arm = k.let("arm", at - near)
    across = k.let("across", arm - along.dot(arm) * along)
    place = k.let("place", near + across + along.cross(speed) / rate)
    slide_rate = k.let("slide_rate", along.dot(speed))
    k.output(
        "helical",
        sp.Matrix([*along, *place, slide_rate / rate, rate, slide_rate]),
        unit="mixed",
        doc="axis, point, pitch (length/rad), angular velocity about it and velocity along it",
    )
    return k.build()


derivation.kernel(
    screw_residual().jacobian(
        ("before", "angle", "slide", "axis", "point"), name="screw_residual", values=True
    ),
    velocity_axis().jacobian(("omega", "velocity", "position"), name="velocity_axis", values=True),
)
