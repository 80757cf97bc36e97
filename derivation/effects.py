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
# # The formulas of the catalogue's effects
#
# An effect of the catalogue changes a reading, a point or an axis by a formula. Where does the formula come from? Each
# row of the catalogue names an entry of this derivation, and a test holds the formula of the row against the right side
# of one of the entry's equations, term by term. The left sides are what physics says, to first order in what is small,
# under the assumptions that each entry states. Rows that only name a number, a vector or a wave point to a definition.

# %%
import sympy as sp

from rodgen.symbolic import Derivation, Formulas, cross, dot, equal, norm, skew
from rodgen.symbolic import rigid_motions as motions

derivation = Derivation(
    "effects",
    title="Effects: where the formulas of the catalogue come from",
    source="the sources of the catalogue's rows, and Timoshenko, Strength of Materials, Part I (beams)",
)
d = derivation
FORMULAS = Formulas()

# %% [markdown]
# ## Symbols
#
# Names in the code are those of the formulas; `rodgen effects NAME` says what each parameter is. Vectors are given in
# the axes of the body that carries the joint.

# %%
N, U, V, g, arm, EX, EY, EZ = d.letters(
    r"""
N[3] | \vec N | unit vector of a joint's axis | 1
U[3] | \vec U | unit vector that completes the axis | 1
V[3] | \vec V | unit vector that completes the axis | 1
g[3] | \vec g | direction of gravity | 1
arm[3] | \vec r | from the joint's point to the mean of the targets | length
EX[3] | \vec e_x | machine axis | 1
EY[3] | \vec e_y | machine axis | 1
EZ[3] | \vec e_z | machine axis | 1
"""
)
q, v, acc, s, t, T, F, zeta, L, q_before = d.letters(
    r"""
q | q | coordinate of the joint | rad or length
v | v | its rate | 1/s
acc | \ddot q | its acceleration | 1/s²
s | s | side from which it comes, 1 or −1 | 1
t | t | time | s
T | T | temperature over that of reference | K
F | F | load | N
zeta | \zeta | part of the travel that is run out, 0 to 1 | 1
L>0 | \mathcal{L} | the whole travel | length
q_before | q' | coordinate of the joint before | rad
"""
)
a, b, k, k2, c, r, x, y, z, alpha, epsilon = d.letters(
    r"""
a | a | parameter | its row's
b | b | parameter | its row's
k | k | parameter | its row's
k2 | k_2 | parameter | its row's
c | c | compliance of a leg | length/N
r | r | parameter | its row's
x | x | parameter | its row's
y | y | parameter | its row's
z | z | parameter | its row's
alpha | \alpha | coefficient of expansion | 1/K
epsilon | \epsilon | something small | 1
"""
)
tau, P = d.letters("tau>0 | \\tau | delay, or time constant | s\nP>0 | P | period | rad or length")
basis = {N: (0, 0, 1), U: (1, 0, 0), V: (0, 1, 0)}
machine_axes = {EX: (1, 0, 0), EY: (0, 1, 0), EZ: (0, 0, 1)}


def change(name: str, quantity: str, value: sp.Basic, unit: str = "its row's") -> sp.Basic:
    """Name what changes, by what it is."""
    latex = rf"\Delta_\mathrm{{{name.replace('_', '~')}}}"
    return d.letters(
        f"{name}{'[3]' if getattr(value, 'shape', ()) else ''} | {latex} | {quantity} | {unit}", [value]
    )[0]


def first_order(value: sp.Expr) -> sp.Expr:
    """The part of first order in epsilon."""
    return value.diff(epsilon).subs(epsilon, 0)


d

# %% [markdown]
# ## Numbers, vectors and waves
#
# A zero that is off, a length, an angle: the change is a number. A point that is off, or a frame: a vector, which is
# the sum of its components. An axis, the place of an axis, or a direction has two freedoms: what is across it.

# %%
d.check(
    "constant",
    equal(change("constant", "a number", a), a),
    equal(change("factor", "what a factor is beyond 1", k), k),
    text="Definition: a change by a number, of a quantity or of a factor.",
).prove()

# %%
radius = change("radius", "a way outwards", r * U)
d.check("outwards", equal(radius, r * U), text="Definition: a way along U.").prove()

# %%
rx, ry, rz, w = d.letters(
    r"""
rx | r_x | turn about x | rad
ry | r_y | turn about y | rad
rz | r_z | turn about z | rad
w[3] | \vec w | any vector | its row's
"""
)
shift = change("shift", "any vector", sp.Matrix([x, y, z]))
turn = change("turn", "any rotation vector", sp.Matrix([rx, ry, rz]))
aside = change("aside", "the part of a vector across the axis", motions.across(w, N, dot(N, w)))
d.check(
    "vector",
    equal(shift, x * EX + y * EY + z * EZ),
    equal(turn, rx * EX + ry * EY + rz * EZ),
    equal(aside, a * U + b * V),
    text="A vector is the sum of its components along the machine axes. The part across an axis has two components: of "
    "a rotation vector the part that turns the axis, of a shift the part that moves it.",
).prove(given={**machine_axes, **basis, a: dot(U, w), b: dot(V, w)})

# %%
waves = {}
for name in ("", "u_", "v_"):
    parts = d.letters(
        "\n".join(
            f"{name}{f}{n} | {name}{{{f}{n}}} | amplitude of a wave | its row's" for n in "12" for f in "cs"
        )
    )
    angles = [function(n * q) for n in (1, 2) for function in (sp.cos, sp.sin)]
    waves[name] = sum(amplitude * wave for amplitude, wave in zip(parts, angles, strict=True))
eighths = d.letters("\n".join(f"{f}{n} | {f}_{n} | amplitude of a wave | rad" for n in "48" for f in "ab"))
tracks = d.letters("\n".join(f"{f}{n} | {f}_{n} | amplitude of a wave | rad" for n in "23" for f in "ab"))
fine = sum(
    amplitude * function(n * angle)
    for amplitude, (n, function) in zip(
        eighths, [(n, f) for n in (4, 8) for f in (sp.cos, sp.sin)], strict=True
    )
    for angle in [q]
)
nods = sum(
    amplitude * function(n * q_before)
    for amplitude, (n, function) in zip(
        tracks, [(n, f) for n in (2, 3) for f in (sp.cos, sp.sin)], strict=True
    )
)
d.check(
    "waves",
    equal(
        change("radial", "motion across an axis", waves["u_"] * U + waves["v_"] * V),
        waves["u_"] * U + waves["v_"] * V,
    ),
    equal(change("axial", "motion along an axis", waves[""] * N), waves[""] * N),
    equal(change("graduation", "error of a graduation that repeats four times in a turn", fine), fine),
    equal(change("track", "nodding on a track", nods), nods),
    text="Definition: what a turn repeats is a sum of waves; of each kind those are taken that its causes make. Error "
    "motions of an axis have once and twice a turn, strained graduations four and eight, tracks two and three.",
).prove()

# %%
wave = a * sp.sin(2 * sp.pi * q / P) + b * sp.cos(2 * sp.pi * q / P)
later = change("later", "the same, a period later", sp.expand(wave.subs(q, q + P)))
d.check(
    "period",
    equal(change("periodic", "a wave of a period", wave), wave),
    equal(later, wave),
    text="Definition: the first wave of what repeats with a period of the drive.",
).prove()

# %%
u_v = [*d.letters("\n".join(f"{f}_{n} | {f}_{n} | coefficient | length" for n in "234" for f in "uv"))]
x_y = [*d.letters("\n".join(f"{f}_{n} | {f}_{n} | coefficient | rad" for n in "123" for f in "xyz"))]
place = sp.Symbol("place", real=True)
legendre = [polynomial(2 * zeta - 1) for polynomial in motions.LEGENDRE.values()]
P1, P2, P3, P4 = d.letters(
    "\n".join(f"P{n} | P_{n} | Legendre polynomial of 2ζ − 1 | 1" for n in range(1, 5)), legendre
)
bow = (u_v[0] * U + u_v[1] * V) * P2 + (u_v[2] * U + u_v[3] * V) * P3 + (u_v[4] * U + u_v[5] * V) * P4
pitch = sum(
    (
        (u * EX + v * EY + w * EZ) * p
        for u, v, w, p in zip(x_y[::3], x_y[1::3], x_y[2::3], (P1, P2, P3), strict=True)
    ),
    sp.ZeroMatrix(3, 1),
)
d.check(
    "legendre",
    *(
        equal(
            polynomial,
            ((place**2 - 1) ** n).diff(place, n).subs(place, 2 * zeta - 1) / (2**n * sp.factorial(n)),
        )
        for n, polynomial in enumerate((P1, P2, P3, P4), 1)
    ),
    *(equal(sp.integrate(p * m, (zeta, 0, 1)), 0) for n, p in enumerate(legendre) for m in legendre[:n]),
    equal(change("straight", "sideways error of a guideway", bow), bow),
    equal(change("angular", "angular error of a guideway", pitch), pitch),
    text="Definition: an error along a travel is a sum of Legendre polynomials, by Rodrigues' formula. They are "
    "orthogonal, so that on readings all over the travel no coefficient stands for another one. A line is left out "
    "where the squareness has it, a constant where the zero offset has it.",
).prove()

# %% [markdown]
# ## Scales and drives

# %%
d.check(
    "scale",
    equal(
        change(
            "counted", "coordinate of a drive with 1 + k turns for a turn, less what is read", (1 + k) * q - q
        ),
        k * q,
    ),
    text="The drive makes 1 + k turns, or lengths, for one that is read.",
).prove()

# %%
gear = d.symbol("gear", r"\rho", "ratio of the gears through the joint before", "1")
d.check(
    "coupling",
    equal(
        change(
            "coupled",
            "what gears of a ratio ρ + k add, less what the control takes off",
            (gear + k) * q_before - gear * q_before,
        ),
        k * q_before,
    ),
    text="The joint before turns this one by a ratio that is off by k from that of the control.",
).prove()

# %% [markdown]
# ### Graduations
#
# A disc of graduation of radius $R$ turns by $q$ below a reading head that stands still, at $R\,\vec e_x$ from the
# axis. Its middle is off the axis by $\epsilon\,\vec e$, in axes of the disc. The head reads minus the angle under
# which the disc sees it. A resolver or a magnetic encoder reads the angle of two signals; offsets of these, unequal
# amplitudes and an angle between them that is not right act alike.

# %%
radius_of_disc = d.symbol("R", "R", "radius of a graduation", "length", positive=True)
e_x, e_y, u_s, u_c, gain, skewed = d.letters(
    r"""
e_x | e_x | middle of the graduation off the axis | length
e_y | e_y | middle of the graduation off the axis | length
u_s | o_s | offset of the sine signal | 1
u_c | o_c | offset of the cosine signal | 1
gain | \gamma | by how much the sine signal is larger | 1
skewed | \kappa | by how much the signals are off a right angle | rad
"""
)
head = radius_of_disc * sp.Matrix([sp.cos(q), -sp.sin(q)]) - epsilon * sp.Matrix([e_x, e_y])
eccentric = first_order(-sp.atan2(head[1], head[0]))
offsets = first_order(sp.atan2(sp.sin(q) + epsilon * u_s, sp.cos(q) + epsilon * u_c))
once = a * sp.cos(q) + b * sp.sin(q)
d.check(
    "eccentricity",
    equal(change("eccentric", "error of a disc off the axis", eccentric), once),
    equal(change("offsets", "error by offsets of two signals", offsets), once),
    text="Once a turn, to first order in the eccentricity over the radius, or in the offsets.",
).prove(given={e_x: b * radius_of_disc, e_y: a * radius_of_disc, u_s: a, u_c: -b})

# %%
signals = sp.atan2((1 + epsilon * gain) * sp.sin(q + epsilon * skewed / 2), sp.cos(q - epsilon * skewed / 2))
twice = a * sp.cos(2 * q) + b * sp.sin(2 * q)
d.check(
    "ellipticity",
    equal(
        change("signals", "error by signals of unequal size, not at a right angle", first_order(signals)),
        twice,
    ),
    text="Twice a turn, to first order.",
).prove(given={gain: 2 * b, skewed: 2 * a})

# %% [markdown]
# ### Play, delay and windup

# %%
behind = change("behind", "half of the play, on the side where it comes from", -s * b / 2)
d.check(
    "backlash",
    equal(behind, -b / 2 * s),
    text="Definition: with a play b the two sides differ by b, and zero is in the middle.",
).prove()

# %%
play = d.symbol("play", r"\beta(q)", "play that grows with the coordinate", "rad or length", value=2 * k * q)
d.check(
    "backlash-gradient",
    equal(change("growing", "half of that play", -s * play / 2), -k * s * q),
    text="The play is 2 k q at q.",
).prove()

# %%
motion = sp.Function("q")
delayed = first_order(motion(t - epsilon * tau)).doit().subs(motion(t).diff(t), v)
d.check(
    "lag",
    equal(change("late", "what was commanded a time τ before, less what is commanded", delayed), -tau * v),
    text="The axis is where it was commanded to be a time τ before; to first order in τ.",
).prove()

# %% [markdown]
# A drive is a spring of stiffness $K$ between the motor at $q$ and the axis at $\varphi$, whose inertia is $J$:
# $J\ddot\varphi=K(q-\varphi)$. With $k=J/K$, the square of $1/\omega$, it is behind by $-k\ddot q$ to first order.

# %%
follows = motion(t) - k * motion(t).diff(t, 2)
unbalanced = (k * follows.diff(t, 2) + follows - motion(t)).expand()
d.check(
    "acceleration-lag",
    equal(sp.diff(unbalanced, k).subs(k, 0), 0),
    equal(
        change(
            "inert", "how far it is ahead of the motor", (follows - motion(t)).subs(motion(t).diff(t, 2), acc)
        ),
        -k * acc,
    ),
    text="To first order in k the equation of motion holds.",
).prove()

# %% [markdown]
# A drive, a bearing or a guide is a spring: its turn is the moment times a compliance $\kappa$. The moment is that of
# the weight $G$ or the load $F$ of what it carries; `M`, `M_perp`, `M_across` and `M_guide` are those of a unit force
# along gravity (derivation `machine_model`, *Gravity*).

# %%
rate = motions.moment_rate(FORMULAS, N, g)
unit_moment = motions.moment(FORMULAS, arm, g)
M, M_perp, M_across, M_guide, bend = d.letters(
    r"""
M | M | moment of a unit force about the axis | length
M_perp | M_\perp | the same after a quarter turn of the arm | length
M_across[3] | \vec M_a | part of the moment across the axis | length
M_guide[3] | \vec M_g | the same about where the carriage is | length
bend[3] | \vec B | moment of a unit force along gravity at the end of a unit shaft | 1
""",
    (
        motions.moment_about(FORMULAS, rate, arm),
        motions.moment_turned(FORMULAS, N, rate, arm),
        motions.across(unit_moment, N, dot(N, unit_moment)),
        motions.across(cross(arm - q * N, g), N, dot(N, cross(arm - q * N, g))),
        motions.shaft_bend(FORMULAS, N, g),
    ),
)
compliance, weight, out, beside = d.letters(
    r"""
compliance | \kappa | compliance of a drive, a bearing or a guide | rad/(N·length)
weight | G | weight of what is carried | N
out | \lambda | part of the arm at which the weight acts | 1
beside | \mu | part of the arm, turned by 90° about the axis, at which it acts | 1
"""
)
heavy = out * arm + beside * cross(N, arm)
d.check(
    "gravity-windup",
    equal(
        change("windup", "turn of a spring by the weight", compliance * weight * dot(N, cross(heavy, g))),
        k * M + k2 * M_perp,
    ),
    text="A weight anywhere across the axis winds up a drive by two parts of the moment.",
    assumptions=[
        "the drive is a linear spring; what it carries is rigid, and moves with the mean of the targets"
    ],
).prove(given={k: compliance * weight * out, k2: compliance * weight * beside})

# %%
d.check(
    "load-windup",
    equal(
        change("loaded", "turn of a spring by the load", compliance * dot(N, cross(arm, F * g))), k * F * M
    ),
    text="A load at the mean of the targets winds up a drive in proportion.",
    assumptions=["the drive is a linear spring"],
).prove(given={k: compliance})

# %%
overturning = cross(arm, weight * g)
d.check(
    "lateral-windup",
    equal(
        change(
            "leaning",
            "turn of a bearing by the moment across its axis",
            compliance * motions.across(overturning, N, dot(N, overturning)),
        ),
        a * M_across,
    ),
    text="A bearing leans with the moment across its axis.",
    assumptions=["it is a linear spring, alike about all axes across its own"],
).prove(given={a: compliance * weight})

# %%
softer = d.symbol(
    "softer",
    r"\kappa'",
    "compliance of a guide at the end of the travel, less that at its start",
    "rad/(N·length)",
)
at_carriage = cross(arm - q * N, weight * g)
d.check(
    "guide-windup",
    equal(
        change(
            "guided",
            "turn of a guide by the moment about the carriage",
            (compliance + softer * zeta) * motions.across(at_carriage, N, dot(N, at_carriage)),
        ),
        (a + b * zeta) * M_guide,
    ),
    text="A guide leans with the moment about where the carriage has got to, the more the softer it is there.",
    assumptions=["it is a linear spring, whose compliance changes evenly along the travel"],
).prove(given={a: compliance * weight, b: softer * weight})

# %%
leg_tension = d.symbol(
    "leg_tension", "t", "force in the leg, tension positive, per unit load (derivation closed_chain)", "1"
)
d.check(
    "leg-compliance",
    equal(
        change("pulled", "way of a spring of compliance c under the force in the leg", c * (F * leg_tension)),
        c * F * leg_tension,
    ),
    text="Leg, nut and joints are one spring.",
    assumptions=["it is linear"],
).prove()

# %% [markdown]
# ## Flexures of telescopes, and the air
#
# A shaft, a fork and a tube are cantilevers under their own weight and what they carry. Only the part of gravity across
# them bends, by a slope $\beta$ where they are level (*Beams*, below).

# %%
slope_when_level = d.symbol("beta", r"\beta", "slope of the end of a beam that is level", "rad")
n = d.vector("n", r"\vec n", "axis before, on which a fork stands upwards", "1")
sagging = slope_when_level * cross(N, g - dot(N, g) * N)
d.check(
    "axis-flexure",
    equal(change("shaft", "turn of the end of a shaft", sagging), a * bend),
    text="The end of a shaft along the axis turns about what is across axis and gravity.",
    assumptions=["a linear cantilever, round or square, so that it bends alike to all sides"],
).prove(given={a: slope_when_level})

# %%
fork = d.symbol(
    "fork",
    r"\Phi",
    "part about the axis of the bend of a fork on the axis before",
    "1",
    value=motions.fork_bend(Formulas(select=lambda condition, down, upright: upright), N, n, g),
)
turned_by = slope_when_level * cross(n, g - dot(n, g) * n)
d.check(
    "fork-flexure",
    equal(change("forked", "part of the turn of a fork's end about the axis", dot(N, turned_by)), a * fork),
    text="The end of a fork that stands on the axis before turns as that of a shaft; the part about its own axis is "
    "seen as an error of this joint.",
    assumptions=["as above", "the axis before points upwards: where it points down, n is its opposite"],
).prove(given={a: slope_when_level})

# %%
sight = d.vector("sight", r"\vec x", "line of sight, along the tube", "1")
up = -g
sin_zenith, across_tube = d.letters(
    r"""
sin_zenith | \sin\zeta | sine of the zenith angle | 1
across_tube | \left|\vec g_a\right| | length of the part of gravity across the tube | 1
""",
    (norm(cross(sight, up)), norm(g - dot(sight, g) * sight)),
)
d.check(
    "tube-flexure",
    equal(change("droop", "lift of a tube that droops", -slope_when_level * across_tube), -a * sin_zenith),
    text="A tube droops by the part of gravity across it, which is the sine of the zenith angle.",
    assumptions=["a linear cantilever", equal(norm(sight), 1), equal(norm(g), 1)],
).prove(
    equal(across_tube**2, sin_zenith**2),
    equal(-slope_when_level * across_tube, (-a * sin_zenith).subs(sin_zenith, across_tube)),
    given={a: slope_when_level},
    modulo={sight.components[2]: dot(sight, sight) - 1, g.components[2]: dot(g, g) - 1},
    because="The squares of both lengths agree, and lengths are not negative.",
)

# %% [markdown]
# Through layers of air that lie level, $n\sin\zeta$ stays the same (Snell). Outside, $n$ is 1; at the ground it is
# $1+a$. So the true zenith angle $\zeta+\alpha$ of what is seen at $\zeta$ obeys $\sin(\zeta+\alpha)=(1+a)\sin\zeta$.

# %%
seen_at = sp.Symbol("seen_at", positive=True)
snell = sp.asin((1 + epsilon) * seen_at)
tan_zenith = d.symbol(
    "tan_zenith", r"\tan\zeta", "tangent of the zenith angle", "1", value=seen_at / sp.sqrt(1 - seen_at**2)
)
d.check(
    "refraction",
    equal(
        change("bent", "lift by layers of air, of first order in a", a * first_order(snell)), a * tan_zenith
    ),
    text="The lift is a tan ζ to first order in a, with the sine of ζ from 0 to 1.",
    assumptions=[
        "the layers are level and flat: up to 85°; from there on the model's lift is finite (finite-lift)"
    ],
).prove()

# %% [markdown]
# ## Temperature and time
#
# What is $\ell$ long grows by $\alpha T\ell$.

# %%
length = d.symbol("length", r"\ell", "length of what grows", "length")
along = sp.Symbol("along", real=True)
d.check(
    "expansion",
    equal(
        change("grown", "growth of a scale from its zero to q", sp.integrate(alpha * T, (along, 0, q))),
        alpha * T * q,
    ),
    text="A scale grows from its fixed point on.",
    assumptions=["its temperature is the same all along"],
).prove()

# %%
d.check(
    "thermal-offset",
    equal(change("pushed", "growth of a part of one length", alpha * T * length), k * T),
    text="A part between the scale and the machine grows.",
).prove(given={k: alpha * length})

# %%
housing = d.vector("housing", r"\vec\ell", "from where the housing is held to the axis", "length")
d.check(
    "thermal-drift",
    equal(
        change("carried", "way of an axis by the growth of its housing", alpha * T * housing),
        (x * EX + y * EY + z * EZ) * T,
    ),
    text="A housing grows and carries its axis away.",
).prove(given={**machine_axes, **{p: alpha * part for p, part in zip((x, y, z), housing, strict=True)}})

# %% [markdown]
# A machine that is switched on at $t=0$ warms up by Newton's law of cooling: its temperature approaches the last one at
# a rate that is in proportion to what is left. What moves with it does the same.

# %%
moved = (x * EX + y * EY + z * EZ) * (1 - sp.exp(-t / tau))
warmed = sp.Matrix(d.value(moved))
left_over = sp.Matrix(d.value(x * EX + y * EY + z * EZ)) - warmed
d.check(
    "warm-up",
    equal(change("warm", "way of what warms up", warmed), moved),
    equal(
        change("speed", "its speed", warmed.diff(t)), change("rest", "what is left, over τ", left_over / tau)
    ),
    equal(change("begin", "the same at t = 0", warmed.subs(t, 0)), sp.ZeroMatrix(3, 1)),
    text="The way obeys Newton's law and starts at zero.",
).prove()

# %%
d.check(
    "drift",
    equal(change("steady", "a steady motion", t * sp.Matrix([x, y, z])), (x * EX + y * EY + z * EZ) * t),
    text="Definition: any motion, to first order in time.",
).prove(given=machine_axes)

# %% [markdown]
# ## Instruments
#
# An instrument whose axes are neither of one scale nor square reads $\vec r+A\vec r$ for $\vec r$, with any small
# matrix $A$ of nine numbers. Of these, three are a turn of the frame and one is a scale, which are effects of their
# own. Five are left: two scales and three angles.

# %%
A = d.matrix("A", "A", "errors of the axes of an instrument", "1")
read_x, read_y, read_z, xy, xz, yz = d.letters(
    r"""
read_x | r_x | component of the reading | length
read_y | r_y | component of the reading | length
read_z | r_z | component of the reading | length
xy | \alpha_{xy} | angle between the axes x and y, less a right angle | rad
xz | \alpha_{xz} | angle between the axes x and z, less a right angle | rad
yz | \alpha_{yz} | angle between the axes y and z, less a right angle | rad
"""
)
reading = sp.Matrix([read_x, read_y, read_z])
(a11, a12, a13), (a21, a22, a23), (a31, a32, a33) = A.components.tolist()
common = a33 * reading + skew(sp.Matrix([a32, -a31, a21])) * reading
stretched = sp.Matrix([(a11 - a33) * read_x, (a22 - a33) * read_y, 0])
sheared = sp.Matrix([(a12 + a21) * read_y + (a13 + a31) * read_z, (a23 + a32) * read_z, 0])
d.check(
    "instrument-axes",
    equal(
        change("distorted", "any distortion, less a scale and a turn", A.components * reading - common),
        stretched + sheared,
    ),
    equal(change("stretched", "its part of two scales", stretched), x * read_x * EX + y * read_y * EY),
    equal(
        change("sheared", "its part of three angles", sheared),
        (xy * read_y + xz * read_z) * EX + yz * read_z * EY,
    ),
    text="What is left has two scales and three angles.",
).prove(given={**machine_axes, x: a11 - a33, y: a22 - a33, xy: a12 + a21, xz: a13 + a31, yz: a23 + a32})

# %% [markdown]
# ## Towers of deltas
#
# A tower leans outwards by $a$ and across by $b$: the sines are the components of its direction.

# %%
direction = sp.sin(a) * U + sp.sin(b) * V + sp.sqrt(1 - sp.sin(a) ** 2 - sp.sin(b) ** 2) * N
d.check(
    "tower-lean",
    equal(norm(direction) ** 2, 1),
    equal(
        change("leant", "way of a carriage by the lean of its tower", q * (direction - N)),
        q * (sp.sin(a) * U + sp.sin(b) * V + (sp.sqrt(1 - sp.sin(a) ** 2 - sp.sin(b) ** 2) - 1) * N),
    ),
    text="A carriage moves along a unit vector with these components.",
).prove(given=basis)

# %% [markdown]
# ## Beams
#
# How drop and slope of a beam are related follows from the beam equation, $EI\,\eta''''=p$. A **cantilever**, an arm
# that has been run out of its guide by $\ell$ and carries a load $F$ at its end:

# %%
stiffness, ell, p = d.letters(r"""
stiffness>0 | EI | bending stiffness | force·length²
ell>0 | \ell | length that is run out | length
p | p | weight per length | force/length
""")
xi = sp.Symbol("xi", real=True)


def bent(shape: sp.Expr, order: int, place: sp.Basic | int = xi) -> sp.Expr:
    """A derivative of a shape, at a place."""
    return (shape.diff(xi, order) if order else shape).subs(xi, place)


def number(name: str, latex: str, quantity: str, value: sp.Expr, its_unit: str = "length") -> sp.Symbol:
    """Name a number by what it is."""
    return d.symbol(name, latex, quantity, its_unit, value=value)


tip_shape = F * xi**2 * (3 * ell - xi) / (6 * stiffness)
own_shape = p * xi**2 * (6 * ell**2 - 4 * ell * xi + xi**2) / (24 * stiffness)
tip_drop = number("tip_drop", r"\delta_F", "drop at the end under the load", bent(tip_shape, 0, ell))
tip_slope = number("tip_slope", r"\beta_F", "slope at the end of the beam", bent(tip_shape, 1, ell), "rad")
own_drop = number("own_drop", r"\delta_p", "drop at the end by its own weight", bent(own_shape, 0, ell))
own_slope = number("own_slope", r"\beta_p", "slope at the end of the beam", bent(own_shape, 1, ell), "rad")
at_the_end = [
    equal(tip_drop, F * ell**3 / (3 * stiffness)),
    equal(tip_slope, sp.Rational(3, 2) * tip_drop / ell),
    equal(own_drop, p * ell**4 / (8 * stiffness)),
    equal(own_slope, sp.Rational(4, 3) * own_drop / ell),
]
d.check(
    "cantilever",
    *at_the_end,
    text="The slope at the end is 3/2 of drop over length for a load, 4/3 for the beam's own weight. It is not the "
    "derivative of the drop by the length: a beam that is run out further is another beam.",
    assumptions=["EI η'''' = p; at the guide η = η' = 0; at the end EI η'' = 0 and EI η''' = −F"],
).prove(
    *[equal(stiffness * bent(shape, 4), load) for shape, load in ((tip_shape, 0), (own_shape, p))],
    *[equal(bent(shape, order, 0), 0) for shape in (tip_shape, own_shape) for order in (0, 1)],
    *[equal(bent(shape, 2, ell), 0) for shape in (tip_shape, own_shape)],
    *[equal(stiffness * bent(shape, 3, ell), force) for shape, force in ((tip_shape, -F), (own_shape, 0))],
    *at_the_end,
    because="The shapes obey the beam equation and its four conditions, which have one solution; these are their "
    "values at the end.",
)

# %%
tip, own = d.letters(r"""
tip | \mathrm{tip} | drop by the load at full travel | length
own | \mathrm{own} | drop by the beam's own weight at full travel | length
""")
d.check(
    "cantilever-by-travel",
    equal(tip_drop, tip * zeta**3),
    equal(tip_slope, sp.Rational(3, 2) * tip * zeta**2 / L),
    equal(own_drop, own * zeta**4),
    equal(own_slope, sp.Rational(4, 3) * own * zeta**3 / L),
    text="With ℓ = ζ𝓛, and `tip` and `own` for the drops at full travel: the catalogue's cantilever.",
).prove(given={ell: zeta * L, tip: F * L**3 / (3 * stiffness), own: p * L**4 / (8 * stiffness)})

# %% [markdown]
# A **bridge** is built in at both ends; a carriage runs along it and follows its shape. Here the slope *is* the
# derivative.

# %%
mid = d.symbol("mid", r"\mathrm{mid}", "sag in the middle", "length", value=p * L**4 / (384 * stiffness))
bridge_shape = p * xi**2 * (L - xi) ** 2 / (24 * stiffness)
bridge = number("bridge", r"\eta(\zeta\mathcal{L})", "sag of the bridge", bent(bridge_shape, 0, zeta * L))
bridge_slope = number(
    "bridge_slope",
    r"\eta'(\zeta\mathcal{L})",
    "slope of the bridge",
    bent(bridge_shape, 1, zeta * L),
    "rad",
)
on_the_bridge = [
    equal(bridge, 16 * mid * zeta**2 * (1 - zeta) ** 2),
    equal(bridge_slope, 32 * mid * zeta * (1 - zeta) * (1 - 2 * zeta) / L),
]
d.check(
    "bridge",
    *on_the_bridge,
    text="A bridge that is built in at both ends sags by its own weight.",
    assumptions=["EI η'''' = p; at both ends η = η' = 0; mid is η in the middle"],
).prove(
    equal(stiffness * bent(bridge_shape, 4), p),
    *[equal(bent(bridge_shape, order, end), 0) for order in (0, 1) for end in (0, L)],
    equal(bent(bridge_shape, 0, L / 2), mid),
    *on_the_bridge,
    because="The shape obeys the beam equation and its four conditions; these are its sag and its slope at ζ𝓛.",
)

# %% [markdown]
# The same drop belongs to another bridge: a light one on two supports, bent by the carriage's own weight. But where a
# load makes the shape that it stands on, the slope below it is *half* the derivative of its drop. Which bridge a
# machine has shows in its angles, not in the heights.

# %%
rest = L - ell
left_part = F * rest * xi * (L**2 - rest**2 - xi**2) / (6 * stiffness * L)
right_part = F * ell * (L - xi) * (L**2 - ell**2 - (L - xi) ** 2) / (6 * stiffness * L)
under = number("under", r"\eta_F", "drop under a load that stands at ζ𝓛", bent(left_part, 0, ell))
under_slope = number("under_slope", r"\eta_F'", "slope under that load", bent(left_part, 1, ell), "rad")
middle = number("middle", r"\mathrm{mid}_F", "drop of the load in the middle", F * L**3 / (48 * stiffness))
under_the_load = [
    equal(under, 16 * middle * zeta**2 * (1 - zeta) ** 2),
    equal(under_slope, 16 * middle * zeta * (1 - zeta) * (1 - 2 * zeta) / L),
]
d.check(
    "bridge-bent-by-its-load",
    *under_the_load,
    text="A bridge on two supports under a travelling load.",
    assumptions=["η = η'' = 0 at both ends; under the load η, η', η'' are continuous and EI η''' jumps by F"],
).prove(
    *[equal(bent(part, 4), 0) for part in (left_part, right_part)],
    *[
        equal(bent(part, order, end), 0)
        for part, end in ((left_part, 0), (right_part, L))
        for order in (0, 2)
    ],
    *[equal(bent(left_part, order, ell), bent(right_part, order, ell)) for order in (0, 1, 2)],
    equal(stiffness * (bent(right_part, 3, ell) - bent(left_part, 3, ell)), F),
    *under_the_load,
    given={ell: zeta * L},
    because="Both parts obey the beam equation, the conditions at the ends and those under the load.",
)

# %% [markdown]
# On a ram all three act at once; a load adds to them what is in proportion to it.

# %%
k0, k3 = d.letters(
    "k0 | k_0 | drop per load, wherever it stands | length/N\nk3 | k_3 | drop per load at full travel | length/N"
)
sag_slope = (
    sp.Rational(3, 2) * tip * zeta**2
    + sp.Rational(4, 3) * own * zeta**3
    + 32 * mid * zeta * (1 - zeta) * (1 - 2 * zeta)
) / L
d.check(
    "gravity-sag",
    equal(tip_drop + own_drop + bridge, tip * zeta**3 + own * zeta**4 + 16 * mid * zeta**2 * (1 - zeta) ** 2),
    equal(tip_slope + own_slope + bridge_slope, sag_slope),
    text="A ram that is run out under its own weight and that at its end, and a bridge under its own weight.",
    assumptions=["linear beams of one section: cantilever and bridge, above"],
).prove(
    given={ell: zeta * L, tip: F * L**3 / (3 * stiffness), own: p * L**4 / (8 * stiffness)},
)

# %%
support = d.symbol("support", r"\kappa_0", "compliance of what carries the beam", "length/N")
d.check(
    "load-sag",
    equal(support * F + tip_drop, F * (k0 + k3 * zeta**3)),
    equal(tip_slope, sp.Rational(3, 2) * F * k3 * zeta**2 / L),
    text="A load at the end of a ram whose guide gives way evenly.",
    assumptions=["a linear cantilever on a linear spring, which does not turn"],
).prove(given={ell: zeta * L, k0: support, k3: L**3 / (3 * stiffness)})

# %% [markdown]
# ## All symbols

# %%
d
