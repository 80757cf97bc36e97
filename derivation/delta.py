# %% [markdown]
# # Delta robots and printers
#
# Three pairs of parallel rods hold a platform so that it shifts and does not turn. The upper joint of each rod is on a
# carriage, which slides on a vertical tower (the *linear* delta of printers), or at the end of an arm, which turns
# about a horizontal axis (the *rotary* delta of Clavel). Since the platform does not turn, the place of a rod's lower
# joint on it may be taken from that of the upper one. What is left is one point $\vec p$, the middle of the platform,
# at the distance $L_k$ from three points $\vec c_k$:
#
# $$\lvert\vec p-\vec c_k\rvert^2=L_k^2,\qquad k=1,2,3 .$$
#
# With $\vec u_k=(\cos\varphi_k,\sin\varphi_k,0)$, the direction in which tower or arm $k$ stands, and the radius $R_k$,
# the distance of its joint from the middle less that of the rod's joint on the platform,
#
# $$\vec c_k=R_k\vec u_k+q_k\vec e_3\quad\text{(linear)},\qquad
# \vec c_k=(R_k+A_k\cos\theta_k)\,\vec u_k-A_k\sin\theta_k\,\vec e_3\quad\text{(rotary)} .$$
#
# $q_k$ is the height of the carriage; $\theta_k$ is the angle of the arm, positive downwards, zero where it is level.
#
# This notebook proves where the platform is (*the direct problem*), where carriages and arms must be (*the inverse
# problem*), and in which positions either fails.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, Formulas, cross, dot, equal, legs, select

d = derivation = Derivation(
    "delta",
    title="Delta robots and printers: three rods that shift a platform",
    source='R. Clavel, "Conception d\'un robot parallèle rapide à 4 degrés de liberté", EPFL 1991',
)

# %% [markdown]
# ## Symbols
#
# The first centre is taken as the origin, so that $\vec a$ and $\vec b$ lead to the two others.

# %%
a = d.vector("a", r"\vec a", "from the first centre to the second", "length")
b = d.vector("b", r"\vec b", "from the first centre to the third", "length")
squares = [d.symbol(f"s_{k}", f"L_{k}^2", f"square of the length of rod {k}", "length²") for k in (1, 2, 3)]
t = d.symbol("t", "t", "height above the plane of the centres, over the length of the normal", "1/length")
p = d.vector("p", r"\vec p", "middle of the platform, from the first centre", "length")
x, y, z = (d.symbol(f"p_{c}", f"p_{c}", f"{c} of the middle of the platform", "length") for c in "xyz")
R = d.symbol("R", "R_k", "radius: of the joint of a tower or arm less that on the platform", "length")
L = d.symbol("L", "L_k", "length of a rod", "length")
A = d.symbol("A", "A_k", "length of an arm", "length")
phi = d.symbol("phi", r"\varphi_k", "heading of a tower or an arm, about z", "rad")
theta = d.symbol("theta", r"\theta_k", "angle of an arm, positive downwards", "rad")
X = d.symbol("X", "X_k", "x of a tower, R cos φ", "length")
Y = d.symbol("Y", "Y_k", "y of a tower, R sin φ", "length")
root = d.symbol("root", "w_k", "height of a carriage over the platform", "length", nonnegative=True)
d

# %% [markdown]
# ## The direct problem: three spheres
#
# The platform is where three spheres meet. Let $\vec n=\vec a\times\vec b$ be the normal of the plane of their centres.
# In that plane, the point $\vec g$ with $\vec g\cdot\vec a=\alpha$ and $\vec g\cdot\vec b=\beta$ is
#
# $$\vec g=\frac{\alpha\,\vec b\times\vec n+\beta\,\vec n\times\vec a}{\vec n^2},\qquad
# \alpha=\tfrac12(\vec a^2+L_1^2-L_2^2),\quad\beta=\tfrac12(\vec b^2+L_1^2-L_3^2),$$
#
# and $\vec p=\vec g\pm t\,\vec n$ with $t^2=(L_1^2-\vec g^2)/\vec n^2$. The proof runs the very function that the
# models of machines run, `three_spheres` of `rodgen.symbolic.legs`.

# %%
first, second = (sp.Matrix(3, 1, list(v.components)) for v in (a, b))
meet = legs.three_spheres(Formulas(), [sp.zeros(3, 1), first, second], squares)
point = meet.foot + t * meet.normal
solved = d.vector(
    "solution", r"\vec g+t\,\vec n", "the point that is computed, for either sign of t", "length", value=point
)
distances = [dot(solved, solved), dot(solved - a, solved - a), dot(solved - b, solved - b)]
d.check(
    "three-spheres",
    *(equal(distance, square) for distance, square in zip(distances, squares, strict=True)),
    text="Both points have the given distances from the three centres.",
    assumptions=[sp.Ne(meet.area, 0)],
).prove(
    modulo={t: t**2 * meet.area - meet.height},
    because="g·a = α and g·b = β, since (b × n)·a and (n × a)·b are n·n; and n is orthogonal to g, a and b.",
)

# %% [markdown]
# **Where the rods do not hold the platform.** A small shift $\delta\vec p$ changes half the square of rod $k$ by
# $(\vec p-\vec c_k)\cdot\delta\vec p$. The rods hold the platform where these three rows have a determinant that is not
# zero:

# %%
from_first = sp.Matrix(3, 1, list(p.components))
determinant = d.letter(
    r"determinant | \det(\vec p-\vec c_1,\vec p-\vec c_2,\vec p-\vec c_3) | "
    r"determinant of the slopes of half the squares | length³",
    sp.Matrix.hstack(from_first, from_first - first, from_first - second).det(),
)
d.check(
    "singular-positions",
    equal(determinant, dot(cross(a, b), p)),
    text="The determinant is the height of the platform over the plane of the centres, times the length of the normal.",
).prove(
    because="Differences of rows are a and b. So there are two kinds of singular positions and no others: rods that "
    "lie in the plane of their upper joints, all three, and upper joints in one line.",
)

# %% [markdown]
# ## The inverse problem of towers
#
# A carriage is above the platform by $w_k$ with $w_k^2=L_k^2-\rho_k^2$, where $\rho_k$ is the distance of the platform
# from the tower, seen from above.

# %%
level = d.letter(
    r"rho | \rho_k^2 | square of the distance from the tower, seen from above | length²",
    (x - X) ** 2 + (y - Y) ** 2,
)
carriage = sp.Matrix([X, Y, z + root])
gap = sp.Matrix([x, y, z]) - carriage
rod_of_tower = d.letter(
    r"rod_of_tower | \lvert\vec p-\vec c_k\rvert^2 | square of the rod with that carriage | length²",
    gap.dot(gap),
)
d.check(
    "inverse-of-a-tower",
    equal(rod_of_tower, L**2),
    text="With the carriage at $p_z+w_k$ the rod has its length.",
).prove(
    modulo={root: root**2 - (L**2 - (x - X) ** 2 - (y - Y) ** 2)},
    because="ρ² and w² add up to L². Where w = 0 the rod is level: the carriage moves without the platform, to first "
    "order.",
)

# %% [markdown]
# ## The inverse problem of arms
#
# Let $r$ be the part of $\vec p$ along $\vec u_k$ less $R_k$, and $v$ the part across. The condition of a rod is an
# equation $a\cos\theta+b\sin\theta+c=0$ for its arm, whose two solutions the derivation `trig_equation` has, by half
# the angle and by the angle of $(a,b)$.

# %%
along, across = x * sp.cos(phi) + y * sp.sin(phi) - R, y * sp.cos(phi) - x * sp.sin(phi)
upper = legs.elbow(R, A, (sp.cos(theta), sp.sin(theta)))
gap = sp.Matrix([x, y, z]) - legs.upper_joint(Formulas(), (sp.cos(phi), sp.sin(phi)), *upper)
cosine, sine = -2 * A * along, 2 * A * z
constant = along**2 + across**2 + z**2 + A**2 - L**2
rod_of_arm = d.letter(
    r"rod_of_arm | \lvert\vec p-\vec c_k\rvert^2-L_k^2 | what the rod is too long by, squared | length²",
    gap.dot(gap) - L**2,
)
d.check(
    "inverse-of-an-arm",
    equal(rod_of_arm, cosine * sp.cos(theta) + sine * sp.sin(theta) + constant),
    text="The rod of an arm has its length where $-2A r\\cos\\theta+2A p_z\\sin\\theta+r^2+v^2+p_z^2+A^2-L^2=0$.",
).prove(because="sin² + cos² of θ and of φ are one; the squares of the elbow's two parts add up to A².")

# %% [markdown]
# Of the two solutions $\gamma\pm h$ the elbow of $\gamma+h$ is the outer one. The two are one where arm and rod, seen
# along the axis of the arm, are in one line: outstretched, or folded. There the arm moves without the platform, to
# first order.

# %%
half = d.symbol("h", "h", "half of the angle between the two solutions", "rad")
gamma = d.symbol("gamma", r"\gamma", "angle of (a, b): half a turn from the direction of the platform", "rad")
size = d.letter("D>0 | D | distance of the platform from the axis of the arm, seen along it | length")
to_platform = sp.Matrix([-size * sp.cos(gamma), size * sp.sin(gamma)])
side = [
    sp.cos(gamma + s * half) * to_platform[1] + sp.sin(gamma + s * half) * to_platform[0] for s in (1, -1)
]
outer, inner = (
    d.symbol(name, latex, "elbow × platform, over the length of the arm", "length", value=value)
    for name, latex, value in zip(("outer", "inner"), (r"o_+", r"o_-"), side, strict=True)
)
d.check(
    "outer-elbow",
    equal(outer, -size * sp.sin(half)),
    equal(inner, size * sp.sin(half)),
    text="Seen along the axis, from the elbow at $\\gamma+h$ the platform is to the right of the arm, $0<h<\\pi$; from "
    "the other one to the left.",
).prove(because="The addition theorems leave the sine of h alone.")

# %% [markdown]
# ## The functions of the package


# %%
class DeltaStatus(IntEnum):
    """What is known of a position of a delta, or of the joints that it needs.

    SOLVED: there is one answer.
    SINGULAR: two answers meet. Direct: all rods lie in the plane of their upper joints. Inverse: a rod is level, or an
        arm and its rod are in one line.
    COLLINEAR: the upper joints are in one line, about which the platform is free to swing; NaN.
    UNREACHABLE: no position, or no position of a joint, has these rods; NaN.
    INVALID: a number is not finite, or a length is not positive; NaN.
    """

    SOLVED = 0
    SINGULAR = 1
    COLLINEAR = 2
    UNREACHABLE = 3
    INVALID = 4


SOURCE = "Clavel 1991; derivation delta"
# Squares of heights are differences of squares that are rounded some ten times each.
ROUNDING = 16 * EPS


def geometry_inputs(k, *more):
    """Declare the inputs that each delta has: radii, rods and headings; `more` after the radii."""
    radius = k.input("radius", 3, unit="length", doc="of each tower or arm, less that of the platform")
    others = [k.input(name, 3, unit="length", doc=doc) for name, doc in more]
    rod = k.input("rod", 3, unit="length", doc="length of each rod")
    heading = k.input("heading", 3, unit="rad", doc="where each tower or arm stands, about z, rising")
    return [radius, *others, rod, heading]


def sound(k, sizes, lengths):
    """Tell whether all numbers are finite and lengths positive."""
    total = k.let("total", sum((abs(value) for value in sizes), sp.S.Zero))
    return k.let("valid", sp.And(total <= LARGEST, *(value > 0 for value in lengths)))


def direct_outputs(k, centres, rod, valid):
    """Write the position below three joints, and its status."""
    squares = [k.let(f"square_{n}", value**2) for n, value in enumerate(rod, 1)]
    counted = iter(range(100))
    algebra = Formulas(let=lambda name, value: k.let(f"{name}_{next(counted)}", value))
    meet = legs.three_spheres(algebra, centres, squares)
    a, b = centres[1] - centres[0], centres[2] - centres[0]
    bound = k.let("bound", ROUNDING * (2 * squares[0] - meet.height))
    area_bound = k.let("area_bound", ROUNDING**2 * a.dot(a) * b.dot(b))
    collinear = k.let("collinear", meet.area <= area_bound)
    flat = k.let("flat", abs(meet.height) <= bound)
    above = k.let("above", meet.height > bound)
    ratio = k.let("below", select(above, sp.sqrt(select(above, meet.ratio, 1)), 0))
    down = k.let("down", select(meet.normal[2] < 0, ratio, -ratio))
    position = k.let("position_found", meet.foot + meet.normal * down)
    there = k.let("there", valid & sp.Not(collinear) & (flat | above))
    k.output(
        "position",
        select(there, position, sp.ones(3, 1) * sp.nan),
        unit="length",
        doc="middle of the platform, below the joints",
    )
    status = sp.Piecewise(
        (DeltaStatus.INVALID, sp.Not(valid)),
        (DeltaStatus.COLLINEAR, collinear),
        (DeltaStatus.SINGULAR, flat),
        (DeltaStatus.SOLVED, above),
        (DeltaStatus.UNREACHABLE, True),
        evaluate=False,
    )
    k.status("status", status, DeltaStatus, doc="whether there is a position")
    return k.build()


def linear_delta_direct():
    k = KernelBuilder(
        "linear_delta_direct",
        summary="Where the platform of a linear delta is, from its carriages.",
        source=SOURCE,
    )
    carriage = k.input("carriage", 3, unit="length", doc="height of each carriage")
    radius, rod, heading = geometry_inputs(k)
    centres = [
        k.let(f"joint_{n}", legs.upper_joint(Formulas(), (sp.cos(at), sp.sin(at)), r, height))
        for n, (r, at, height) in enumerate(zip(radius, heading, carriage, strict=True), 1)
    ]
    return direct_outputs(k, centres, rod, sound(k, [*carriage, *radius, *rod, *heading], rod))


def rotary_delta_direct():
    k = KernelBuilder(
        "rotary_delta_direct",
        summary="Where the platform of a rotary delta is, from its arms.",
        source=SOURCE,
    )
    angle = k.input("angle", 3, unit="rad", doc="of each arm, zero where it is level, positive downwards")
    radius, arm, rod, heading = geometry_inputs(k, ("arm", "length of each arm"))
    centres = []
    for n, (r, length, turn, at) in enumerate(zip(radius, arm, angle, heading, strict=True), 1):
        reach, height = legs.elbow(r, length, (sp.cos(turn), sp.sin(turn)))
        upper = k.let(f"reach_{n}", reach), height
        elbow = legs.upper_joint(Formulas(), (sp.cos(at), sp.sin(at)), *upper)
        centres.append(k.let(f"elbow_{n}", elbow))
    valid = sound(k, [*angle, *radius, *arm, *rod, *heading], [*arm, *rod])
    return direct_outputs(k, centres, rod, valid)


def linear_delta_inverse():
    k = KernelBuilder(
        "linear_delta_inverse", summary="Heights of the carriages of a linear delta.", source=SOURCE
    )
    position = k.input("position", 3, unit="length", doc="middle of the platform")
    radius, rod, heading = geometry_inputs(k)
    valid = sound(k, [*position, *radius, *rod, *heading], rod)
    heights, status = [], []
    for n, (r, length, at) in enumerate(zip(radius, rod, heading, strict=True), 1):
        dx = k.let(f"dx_{n}", position[0] - r * sp.cos(at))
        dy = k.let(f"dy_{n}", position[1] - r * sp.sin(at))
        away = k.let(f"away_{n}", sp.sqrt(dx**2 + dy**2))
        square = k.let(f"height_{n}", (length - away) * (length + away))
        bound = k.let(f"bound_{n}", ROUNDING * length**2)
        above = k.let(f"above_{n}", square > bound)
        heights.append(position[2] + select(above, sp.sqrt(select(above, square, 1)), 0))
        status.append((k.let(f"level_{n}", abs(square) <= bound), above))
    there = k.let("there", valid & sp.And(*(sp.Or(*pair) for pair in status)))
    k.output(
        "carriage",
        select(there, sp.Matrix(heights), sp.ones(3, 1) * sp.nan),
        unit="length",
        doc="height of each carriage",
    )
    k.status(
        "status",
        sp.Piecewise(
            (DeltaStatus.INVALID, sp.Not(valid)),
            (DeltaStatus.UNREACHABLE, sp.Not(there)),
            (DeltaStatus.SINGULAR, sp.Or(*(level for level, _ in status))),
            (DeltaStatus.SOLVED, True),
            evaluate=False,
        ),
        DeltaStatus,
        doc="whether each rod reaches its tower",
    )
    return k.build()


def rotary_delta_equations():
    k = KernelBuilder(
        "rotary_delta_equations",
        summary="Coefficients of the equations a cos(angle) + b sin(angle) + c = 0 of the arms of a rotary delta.",
        source=SOURCE,
        notes="Over the length of the arm. Of the two angles that the kernel trig_solve returns the first has the "
        "outer elbow.",
    )
    position = k.input("position", 3, unit="length", doc="middle of the platform")
    radius, arm, rod, heading = geometry_inputs(k, ("arm", "length of each arm"))
    parts = []
    for n, (r, length, reach, at) in enumerate(zip(radius, arm, rod, heading, strict=True), 1):
        c, s = k.let(f"cosine_{n}", sp.cos(at)), k.let(f"sine_{n}", sp.sin(at))
        along = k.let(f"along_{n}", position[0] * c + position[1] * s - r)
        across = k.let(f"across_{n}", position[1] * c - position[0] * s)
        rest = along**2 + across**2 + position[2] ** 2 + (length - reach) * (length + reach)
        parts.append((-2 * along, 2 * position[2], rest / length))
    for name, column, doc in zip("abc", zip(*parts, strict=True), ("cosine", "sine", "rest"), strict=True):
        k.output(name, sp.Matrix(column), unit="length", doc=f"coefficients: {doc}")
    return k.build()


# %% [markdown]
# The functions compute what was proved:

# %%
linear, rotary, equations = linear_delta_direct(), rotary_delta_direct(), rotary_delta_equations()
inverse = linear_delta_inverse()
of_tower = inverse.substitution(position=(x, y, z), radius=(R, R, R), rod=(L, L, L), heading=(phi, phi, phi))
of_arm = equations.substitution(
    position=(x, y, z), radius=(R, R, R), rod=(L, L, L), heading=(phi, phi, phi), arm=(A, A, A)
)
height = d.letter(
    r"height_fn | w_k^{2,\mathrm{fn}} | "
    r"square of the height of a carriage over the platform, of the function | length²",
    inverse.expand(inverse["height_1"]).subs(of_tower),
)
coefficients = [
    d.letter(rf"{name}_fn | {name}^\mathrm{{fn}} | coefficient {name} of the function | length", value)
    for name, value in zip(
        "abc", (sp.Matrix(equations.expand(n))[0].subs(of_arm) for n in "abc"), strict=True
    )
]
d.check(
    "kernels",
    equal(height, L**2 - level),
    *(equal(A * found, stated) for found, stated in zip(coefficients, (cosine, sine, constant), strict=True)),
    text="The functions of the inverse problems have the proved terms; those of the direct one run the proved steps.",
).prove(given={X: R * sp.cos(phi), Y: R * sp.sin(phi)})
derivation.kernel(linear, rotary, inverse, equations)
