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
# # The planar four-bar linkage: from Freudenstein's equation to kernels
#
# Four links in a plane are joined by four pins. The ground link $d$ stands still; the crank $a$ turns about one of
# its ends by the angle $\theta$, the rocker $c$ about the other by $\psi$, and the coupler $b$ joins them under the
# angle $\varphi$. All angles are counted from the direction of the ground link. The linkage closes when
#
# $$a\cos\theta+b\cos\varphi=d+c\cos\psi,\qquad a\sin\theta+b\sin\varphi=c\sin\psi.$$
#
# Wanted are both positions of the rocker and the coupler for a given crank angle, whether the linkage closes at all,
# and by how much each angle moves when a link is longer than it should be.

# %%
from enum import IntEnum

import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, LARGEST, Derivation, equal, in_notebook, select

derivation = Derivation(
    "four_bar",
    title="The planar four-bar linkage",
    source='F. Freudenstein, "Approximate Synthesis of Four-Bar Linkages", Transactions of the ASME 77 (1955)',
)
d = derivation

# %% [markdown]
# ## Symbols
#
# Each has a name for the code and one for the page. A symbol with a value is a definition: proofs put it in.

# %%
crank = d.symbol("crank", "a", "length of the crank", "mm")
coupler = d.symbol("coupler", "b", "length of the coupler", "mm")
rocker = d.symbol("rocker", "c", "length of the rocker", "mm")
ground = d.symbol("ground", "d", "length of the ground link", "mm")
crank_angle = d.symbol("crank_angle", r"\theta", "angle of the crank", "rad")
rocker_angle = d.symbol("rocker_angle", r"\psi", "angle of the rocker", "rad")
coupler_angle = d.symbol("coupler_angle", r"\varphi", "angle of the coupler", "rad")
K1 = d.symbol("K1", "K_1", "ratio d / a", "1", value=ground / crank)
K2 = d.symbol("K2", "K_2", "ratio d / c", "1", value=ground / rocker)
K3 = d.symbol(
    "K3",
    "K_3",
    "ratio (a² - b² + c² + d²) / 2ac",
    "1",
    value=(crank**2 - coupler**2 + rocker**2 + ground**2) / (2 * crank * rocker),
)
d

# %% [markdown]
# ## The printed equation
#
# The coupler's angle drops out when both closure equations are solved for it, squared and added: the coupler has the
# length $b$. Under that condition Freudenstein's equation is true.

# %%
closure = (
    crank * sp.cos(crank_angle) + coupler * sp.cos(coupler_angle) - ground - rocker * sp.cos(rocker_angle),
    crank * sp.sin(crank_angle) + coupler * sp.sin(coupler_angle) - rocker * sp.sin(rocker_angle),
)
across = ground + rocker * sp.cos(rocker_angle) - crank * sp.cos(crank_angle)
up = rocker * sp.sin(rocker_angle) - crank * sp.sin(crank_angle)
closed = {coupler: sp.sqrt(across**2 + up**2)}

d.state(
    "freudenstein",
    equal(
        K1 * sp.cos(rocker_angle) - K2 * sp.cos(crank_angle) + K3,
        sp.cos(crank_angle - rocker_angle),
    ),
    text="The angles of crank and rocker, without that of the coupler.",
    place="Freudenstein's equation",
).prove(given=closed)

# %% [markdown]
# A wrong formula is caught. Here is a deliberate slip, $K_1$ and $K_2$ exchanged. It holds for every linkage with
# $a=c$, so that a test on a symmetric example would pass; one closed linkage in whole numbers shows that it is false,
# and the right formula is proved in its place.

# %%
d.state(
    "freudenstein-with-a-slip",
    equal(
        K2 * sp.cos(rocker_angle) - K1 * sp.cos(crank_angle) + K3,
        sp.cos(crank_angle - rocker_angle),
    ),
    text="The same with two coefficients exchanged.",
    assumptions=[equal(across**2 + up**2, coupler**2)],
).refute(
    {crank: 5, coupler: 13, rocker: 8, ground: 4, crank_angle: sp.pi / 2, rocker_angle: 0},
    equal(
        K1 * sp.cos(rocker_angle) - K2 * sp.cos(crank_angle) + K3,
        sp.cos(crank_angle - rocker_angle),
    ),
    because="The coefficient of each cosine holds the length of the other link.",
    given=closed,
)

# %% [markdown]
# ## The solution
#
# Textbooks put $t=\tan\frac\psi2$ and solve a quadratic. It fails where the rocker points backwards ($t$ is
# infinite) and cancels near there. Geometry has no such place. Let $\vec p$ lead from the rocker's pivot to the
# crank's pin. The rocker's pin is where two circles meet, of radius $c$ about the pivot and $b$ about the crank's
# pin. With $k=\frac12(c^2+p^2-b^2)$ it is at
#
# $$\vec r=\frac{k\,\vec p+\sigma s\,\vec p_\perp}{p^2},\qquad s=\sqrt{c^2p^2-k^2},\qquad\sigma=\pm1.$$
#
# The root $s$ is twice the area of the triangle with the sides $b$, $c$, $p$.

# %%
p_x = d.symbol("pin_x", "p_x", "crank's pin from the rocker's pivot, along the ground link", "mm")
p_y = d.symbol("pin_y", "p_y", "crank's pin from the rocker's pivot, across", "mm")
p = d.symbol("pin_distance", "p", "distance of the crank's pin from the rocker's pivot", "mm")
k_half = d.symbol(
    "k_half", "k", "scalar product of pin and rocker", "mm²", value=(rocker**2 + p**2 - coupler**2) / 2
)
s = d.symbol("double_area", "s", "twice the area of the triangle of coupler, rocker and pin", "mm²")
sign = d.symbol("sign", r"\sigma", "+1 for the first position, -1 for the second", "1")
r_x = d.symbol("rocker_x", "r_x", "rocker's pin, along", "mm", value=(k_half * p_x - sign * s * p_y) / p**2)
r_y = d.symbol("rocker_y", "r_y", "rocker's pin, across", "mm", value=(k_half * p_y + sign * s * p_x) / p**2)
by_definition = {s: s**2 - rocker**2 * p**2 + k_half**2, p: p**2 - p_x**2 - p_y**2, sign: sign**2 - 1}

d.check(
    "solution",
    equal(r_x**2 + r_y**2, rocker**2),
    equal((r_x - p_x) ** 2 + (r_y - p_y) ** 2, coupler**2),
    text="For both signs the rocker has its length, and the coupler reaches from the crank's pin to the rocker's.",
).prove(modulo=by_definition)

# %% [markdown]
# By Heron's formula $s$ is the root of a product of sums. That is exact near dead centres, where the difference
# $c^2p^2-k^2$ loses every digit.

# %%
heron = (p + coupler + rocker) * (coupler + rocker - p) * (p + coupler - rocker) * (p - coupler + rocker)
d.check("heron", equal(4 * s**2, heron), text="Heron's formula.").prove(modulo=by_definition)

# %% [markdown]
# The ratio of the velocities follows from the closure equations, differentiated by the angle of the crank.

# %%
rocker_rate, coupler_rate = sp.symbols("rocker_rate coupler_rate", real=True)
rates = {crank_angle: 1, rocker_angle: rocker_rate, coupler_angle: coupler_rate}
moving = [sum(f.diff(angle) * rate for angle, rate in rates.items()) for f in closure]
solved = sp.solve(moving, [rocker_rate, coupler_rate], dict=True)[0]
rocker_speed = d.symbol(
    "rocker_speed", r"\tfrac{d\psi}{d\theta}", "ratio of velocities", "1", value=solved[rocker_rate]
)
d.check(
    "velocity-ratio",
    equal(
        rocker_speed,
        crank * sp.sin(coupler_angle - crank_angle) / (rocker * sp.sin(coupler_angle - rocker_angle)),
    ),
    text="How fast the rocker turns when the crank turns with unit speed.",
).prove()

# %% [markdown]
# ## The kernel
#
# A kernel is straight-line code. It names its inputs with units, its steps where a name helps, and its outputs. A case
# distinction is a `select` of two values, and a status says what the numbers mean.


# %%
class FourBarStatus(IntEnum):
    """What the two positions of a four-bar linkage are."""

    CLOSES = 0  # two positions
    DEAD_CENTRE = 1  # coupler and rocker in line, to rounding: the two positions are one
    CANNOT_CLOSE = 2  # the links are too short or too long; the angles are those of the nearest approach
    TURNS_FREELY = (
        3  # the crank's pin on the rocker's pivot, coupler as long as rocker: every position closes
    )
    INVALID = 4  # a length is not positive, or a number is NaN or infinite; the angles are NaN


def four_bar():
    k = KernelBuilder(
        "four_bar",
        summary="Both positions of a planar four-bar linkage for an angle of its crank.",
        source="Freudenstein (1955); derivation four_bar, entries solution and heron",
        notes="In the first position pivot, crank's pin and rocker's pin turn counterclockwise.",
    )
    a = k.input("crank", unit="mm", doc="length of the crank")
    b = k.input("coupler", unit="mm", doc="length of the coupler")
    c = k.input("rocker", unit="mm", doc="length of the rocker")
    g = k.input("ground", unit="mm", doc="length of the ground link")
    theta = k.input("crank_angle", unit="rad", doc="angle of the crank")

    x = k.let("pin_x", a * sp.cos(theta) - g)
    y = k.let("pin_y", a * sp.sin(theta))
    square = k.let("square", x**2 + y**2)
    p = k.let("pin_distance", sp.sqrt(square))
    slack = [
        k.let("too_far", b + c - p),
        k.let("too_near_rocker", p + b - c),
        k.let("too_near_coupler", p - b + c),
    ]
    tight = slack[0]
    for other in slack[1:]:
        tight = select(other < tight, other, tight)
    tight = k.let("tight", tight)
    area = k.let("area", (p + b + c) * slack[0] * slack[1] * slack[2])
    s = k.let("double_area", select(tight > 0, sp.sqrt(select(tight > 0, area, 0)) / 2, 0))
    along_rocker = k.let("along_rocker", ((c - b) * (c + b) + square) / 2)
    along_coupler = k.let("along_coupler", ((c - b) * (c + b) - square) / 2)

    valid = (a > 0) & (b > 0) & (c > 0) & (g > 0) & (a + b + c + g <= LARGEST) & (abs(theta) <= LARGEST)
    valid = k.let("valid", valid)

    def both(name, along):
        """The angles of the vectors along p ± s p⊥."""
        angles = []
        for sign, which in ((1, "first"), (-1, "second")):
            u = k.let(f"{name}_{which}_x", along * x - sign * s * y)
            v = k.let(f"{name}_{which}_y", along * y + sign * s * x)
            angles.append(select(valid, sp.atan2(v, u), sp.nan))
        return sp.Matrix(angles)

    k.output(
        "rocker_angle", both("rocker", along_rocker), unit="rad", doc="angle of the rocker, both positions"
    )
    k.output(
        "coupler_angle",
        both("coupler", along_coupler),
        unit="rad",
        doc="angle of the coupler, both positions",
    )

    rounding = k.let("rounding", 4 * EPS * (a + b + c + g))  # of a sum of the four lengths
    status = sp.Piecewise(
        (FourBarStatus.INVALID, sp.Not(valid)),
        (FourBarStatus.TURNS_FREELY, (p <= rounding) & (abs(b - c) <= rounding)),
        (FourBarStatus.CANNOT_CLOSE, tight < -rounding),
        (FourBarStatus.DEAD_CENTRE, tight <= rounding),
        (FourBarStatus.CLOSES, True),
        evaluate=False,
    )
    k.status("status", status, FourBarStatus, doc="what the positions are")
    return k.build()


solver = four_bar()

# %% [markdown]
# What the kernel computes is proved to be the formula. `expand` writes a step in terms of the inputs and of the steps
# to keep. The kernel's vectors are $p^2$ times as long as the links, which does not matter to their angles.

# %%
pin_squared = p_x**2 + p_y**2


def check_vectors(which, value):
    """Prove the kernel's vectors along rocker and coupler in one position."""
    kept = [solver[step] for step in ("pin_x", "pin_y", "double_area")]
    along = {
        f"{link}_{c}": solver.expand(solver[f"{link}_{which}_{c}"], keep=kept)
        for link in ("rocker", "coupler")
        for c in "xy"
    }
    return d.check(
        f"kernel-{which}",
        equal(pin_squared * r_x, along["rocker_x"]),
        equal(pin_squared * r_y, along["rocker_y"]),
        equal(pin_squared * (r_x - p_x), along["coupler_x"]),
        equal(pin_squared * (r_y - p_y), along["coupler_y"]),
        text=f"The kernel's vectors along rocker and coupler in the {which} position.",
    ).prove(given={sign: value}, modulo={p: p**2 - pin_squared})


check_vectors("first", 1)

# %%
check_vectors("second", -1)

# %%
d.check(
    "kernel-area",
    equal(4 * s**2, solver.expand(solver["area"], keep=[solver["pin_distance"]])),
    text="What is under the kernel's root.",
).prove(modulo=by_definition)

# %% [markdown]
# ## Derivatives
#
# The sensitivity of both angles to every length and to the crank's angle is a kernel of its own, made from the first
# one line by line. With it an error of a link becomes an error of the angle, and a fit of the link lengths to
# measured angles has its Jacobian.

# %%
jacobian = solver.jacobian(
    name="four_bar_jacobian",
    summary="Derivatives of both positions of a planar four-bar linkage.",
)
derivation.kernel(solver, jacobian)
for kernel in derivation.kernels.values():
    print(f"{kernel.name:20} {sum(kernel.operations.values()):4d} operations")

# %% [markdown]
# ## What it says
#
# The kernels run at once, on NumPy. A crank-rocker of 20, 70, 60 and 80 mm: the two
# positions of the rocker over one turn, and what 0.01 mm on the coupler does to the first.

# %%
if in_notebook():
    import numpy as np
    from plotly.subplots import make_subplots

    from rodgen.codegen import numpy_function

    theta = np.linspace(-np.pi, np.pi, 721)
    links = (20.0, 70.0, 60.0, 80.0)
    angles, _, _ = numpy_function(solver)(*links, theta)
    rocker_jacobian, _, _ = numpy_function(jacobian)(*links, theta)
    figure = make_subplots(
        1, 2, subplot_titles=["rocker in both positions", "0.01 mm more coupler, first position"]
    )
    for name, angle in zip(("first", "second"), np.degrees(np.unwrap(angles, axis=0)).T, strict=True):
        figure.add_scatter(x=np.degrees(theta), y=angle, name=name, row=1, col=1)
    change = 0.01 * np.degrees(rocker_jacobian[:, 0, 1]) * 3600
    figure.add_scatter(x=np.degrees(theta), y=change, showlegend=False, row=1, col=2)
    figure.update_xaxes(title="crank [deg]")
    figure.update_yaxes(title="rocker [deg]", col=1)
    figure.update_yaxes(title="rocker [arcsec]", col=2)
    figure.show()
