# %% [markdown]
# # The formulas of the catalogue's effects
#
# An effect of the catalogue changes a reading, a point or an axis by a formula. Where does the formula come from? Each
# row of the catalogue names an entry of this derivation, and a test holds the formula of the row against the right side
# of one of the entry's equations, term by term. The left sides are what physics says, to first order in what is small,
# under the assumptions that each entry states. Rows that only name a number, a vector or a wave point to a definition,
# in which $\Delta$ stands for the change.

# %%
import sympy as sp

from rodgen.symbolic import Derivation, Formulas, cross, dot, equal, norm, skew
from rodgen.symbolic import rigid_motions as motions

d = derivation = Derivation(
    "effects",
    title="Effects: where the formulas of the catalogue come from",
    source="the sources of the catalogue's rows, and Timoshenko, Strength of Materials, Part I (beams)",
    kernels_in="those of a machine: 'rodgen emit MACHINE.toml'",
)
FORMULAS = Formulas()
counted = iter(range(100))

# %% [markdown]
# ## Symbols
#
# Names in the code are those of the formulas; `rodgen effects NAME` says what each parameter is. Vectors are given in
# the axes of the body that carries the joint.

# %%
N, U, V, g, arm, EX, EY, EZ, w = d.letters(
    r"N[3] | \vec N | unit vector of a joint's axis | 1",
    r"U[3] | \vec U | unit vector that completes the axis | 1",
    r"V[3] | \vec V | unit vector that completes the axis | 1",
    r"g[3] | \vec g | direction of gravity | 1",
    r"arm[3] | \vec r | from the joint's point to the mean of the targets | length",
    r"EX[3] | \vec e_x | machine axis | 1",
    r"EY[3] | \vec e_y | machine axis | 1",
    r"EZ[3] | \vec e_z | machine axis | 1",
    r"w[3] | \vec w | any vector | its row's",
)
q, v, acc, s, t, T, F, zeta, L, q_before = d.letters(
    "q | q | coordinate of the joint | rad or length",
    "v | v | its rate | 1/s",
    r"acc | \ddot q | its acceleration | 1/s²",
    "s | s | side from which it comes, 1 or −1 | 1",
    "t | t | time | s",
    "T | T | temperature over that of reference | K",
    "F | F | load | N",
    r"zeta | \zeta | part of the travel that is run out, 0 to 1 | 1",
    r"L>0 | \mathcal{L} | the whole travel | length",
    "q_before | q' | coordinate of the joint before | rad",
)
a, b, c, k, r, x, y, z, k2, rx, ry, rz = d.letters(
    *(f"{name} | {name} | parameter | its row's" for name in "abckrxyz"),
    *(f"{name} | {name[0]}_{name[1]} | parameter | its row's" for name in ("k2", "rx", "ry", "rz")),
)
tau, P, alpha, epsilon = d.letters(
    r"tau>0 | \tau | delay, or time constant | s",
    "P>0 | P | period | rad or length",
    r"alpha | \alpha | coefficient of expansion | 1/K",
    r"epsilon | \epsilon | something small | 1",
)
basis = {N: (0, 0, 1), U: (1, 0, 0), V: (0, 1, 0)}
machine_axes = {EX: (1, 0, 0), EY: (0, 1, 0), EZ: (0, 0, 1)}


def change(value):
    """Name a change by what it is."""
    n = next(counted)
    return d.letter(rf"change_{n} | \Delta_{{{n}}} | a change | its row's", value)


def defined(value):
    """The equation that defines a change."""
    return equal(change(value), value)


def first_order(value):
    """The part of first order in epsilon."""
    return value.diff(epsilon).subs(epsilon, 0)


def amplitudes(names, unit):
    """Coefficients of waves or polynomials."""
    return d.letters(
        *(f"{name} | {name[0]}_{{{name[1:].strip('_')}}} | amplitude | {unit}" for name in names)
    )


d

# %% [markdown]
# ## Numbers, vectors and waves
#
# A zero that is off, a length, an angle: the change is a number. A point that is off, or a frame: a vector, which is
# the sum of its components. An axis, the place of an axis, or a direction has two freedoms: what is across it.

# %%
d.check(
    "constant",
    defined(a),
    defined(k),
    text="Definition: a change by a number, of a quantity or of a factor.",
).prove()

# %%
d.check("outwards", defined(r * U), text="Definition: a way along U.").prove()

# %%
d.check(
    "vector",
    equal(change(sp.Matrix([x, y, z])), x * EX + y * EY + z * EZ),
    equal(change(sp.Matrix([rx, ry, rz])), rx * EX + ry * EY + rz * EZ),
    equal(motions.across(w, N, dot(N, w)), a * U + b * V),
    text="A vector is the sum of its components along the machine axes. The part across an axis has two components: of "
    "a rotation vector the part that turns the axis, of a shift the part that moves it.",
).prove(given={**machine_axes, **basis, a: dot(U, w), b: dot(V, w)})

# %%
turns, further, third, eighths = (
    [f(n * q) for n in numbers for f in (sp.cos, sp.sin)] for numbers in ((1, 2), (3, 4), (3,), (4, 8))
)
nods = [f(n * q_before) for n in (2, 3) for f in (sp.cos, sp.sin)]


def series(names, waves, unit="its row's"):
    """A sum of waves or polynomials with coefficients of these names."""
    return sum(k * wave for k, wave in zip(amplitudes(names.split(), unit), waves, strict=True))


leans, more = (
    [series(names.replace("u", x), waves) for x in "uv"]
    for names, waves in (("u_c1 u_s1 u_c2 u_s2", turns), ("u_c3 u_s3 u_c4 u_s4", further))
)
strained = series("a4 b4 a8 b8", eighths)
a3, b3 = amplitudes(["a3", "b3"], "its row's")
d.check(
    "waves",
    defined(leans[0] * U + leans[1] * V),
    defined((leans[0] + more[0]) * U + (leans[1] + more[1]) * V),
    defined(series("c1 s1 c2 s2", turns) * N),
    defined(strained),
    defined(a3 * third[0] + b3 * third[1] + strained),
    defined(series("a2 b2", nods[:2]) + a3 * nods[2] + b3 * nods[3]),
    text="Definition: what a turn repeats is a sum of waves; of each kind those are taken that its causes make. Error "
    "motions of an axis have once and twice a turn, strained graduations four and eight, tracks two and three. What "
    "stands on an axis and leans by three waves a turn leans by two and four against what stands still; graduations of "
    "mounts have three waves, too.",
).prove()

# %%
wave = a * sp.sin(2 * sp.pi * q / P) + b * sp.cos(2 * sp.pi * q / P)
d.check(
    "period",
    defined(wave),
    equal(change(sp.expand(wave.subs(q, q + P))), wave),
    text="Definition: the first wave of what repeats with a period of the drive.",
).prove()

# %%
place = sp.Symbol("place", real=True)
legendre = [polynomial(2 * zeta - 1) for polynomial in motions.LEGENDRE.values()]
polynomials = [d.letter(f"P{n} | P_{n} | polynomial | 1", value) for n, value in enumerate(legendre, 1)]
d.check(
    "legendre",
    *(
        equal(p, ((place**2 - 1) ** n).diff(place, n).subs(place, 2 * zeta - 1) / (2**n * sp.factorial(n)))
        for n, p in enumerate(polynomials, 1)
    ),
    *(equal(sp.integrate(p * m, (zeta, 0, 1)), 0) for n, p in enumerate(legendre) for m in legendre[:n]),
    defined(series("u_2 u_3 u_4", polynomials[1:]) * U + series("v_2 v_3 v_4", polynomials[1:]) * V),
    defined(
        sum(
            (
                series(f"{name}_1 {name}_2 {name}_3", polynomials[:3]) * e
                for name, e in zip("xyz", (EX, EY, EZ), strict=True)
            ),
            sp.ZeroMatrix(3, 1),
        )
    ),
    text="Definition: an error along a travel is a sum of Legendre polynomials, by Rodrigues' formula. They are "
    "orthogonal, so that on readings all over the travel no coefficient stands for another one. A line is left out "
    "where the squareness has it, a constant where the zero offset has it.",
).prove()

# %% [markdown]
# ## Scales and drives

# %%
gear = d.letter(r"gear | \rho | ratio of the gears through the joint before | 1")
d.check(
    "scale",
    equal((1 + k) * q - q, k * q),
    text="The drive makes 1 + k turns, or lengths, for one that is read.",
).prove()

# %%
d.check(
    "coupling",
    equal((gear + k) * q_before - gear * q_before, k * q_before),
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
R, e_x, e_y, o_s, o_c, gain, skewed = d.letters(
    "R>0 | R | radius of a graduation | length",
    "e_x | e_x | middle of the graduation off the axis | length",
    "e_y | e_y | middle of the graduation off the axis | length",
    "o_s | o_s | offset of the sine signal | 1",
    "o_c | o_c | offset of the cosine signal | 1",
    r"gain | \gamma | by how much the sine signal is larger | 1",
    r"skewed | \kappa | by how much the signals are off a right angle | rad",
)
eccentric = -sp.atan2(-R * sp.sin(q) - epsilon * e_y, R * sp.cos(q) - epsilon * e_x)
offsets = sp.atan2(sp.sin(q) + epsilon * o_s, sp.cos(q) + epsilon * o_c)
signals = sp.atan2((1 + epsilon * gain) * sp.sin(q + epsilon * skewed / 2), sp.cos(q - epsilon * skewed / 2))
d.check(
    "eccentricity",
    equal(change(first_order(eccentric)), a * sp.cos(q) + b * sp.sin(q)),
    equal(change(first_order(offsets)), a * sp.cos(q) + b * sp.sin(q)),
    text="A disc off the axis, and offsets of two signals: once a turn, to first order.",
).prove(given={e_x: b * R, e_y: a * R, o_s: a, o_c: -b})

# %%
d.check(
    "ellipticity",
    equal(change(first_order(signals)), a * sp.cos(2 * q) + b * sp.sin(2 * q)),
    text="Signals of unequal size, not at a right angle: twice a turn, to first order.",
).prove(given={gain: 2 * b, skewed: 2 * a})

# %% [markdown]
# ### Play, delay and windup

# %%
d.check(
    "backlash",
    defined(-b / 2 * s),
    text="Definition: half of the play b, on the side where it comes from; zero is in the middle.",
).prove()

# %%
d.check(
    "backlash-gradient",
    equal((-b / 2 * s).subs(b, 2 * k * q), -k * s * q),
    text="The play is 2 k q at q.",
).prove()

# %%
motion = sp.Function("q")
d.check(
    "lag",
    equal(change(first_order(motion(t - epsilon * tau)).doit().subs(motion(t).diff(t), v)), -tau * v),
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
    equal(change((follows - motion(t)).subs(motion(t).diff(t, 2), acc)), -k * acc),
    text="To first order in k the equation of motion holds.",
).prove()

# %% [markdown]
# A drive, a bearing or a guide is a spring: its turn is the moment times a compliance $\kappa$. The moment is that of
# the weight $G$ or the load $F$ of what it carries; `M`, `M_perp`, `M_across` and `M_guide` are those of a unit force
# along gravity (derivation `machine_model`, *Gravity*).

# %%
rate, unit_moment = motions.moment_rate(FORMULAS, N, g), motions.moment(FORMULAS, arm, g)
at_carriage = motions.moment(FORMULAS, arm - q * N, g)
M = d.letter(
    "M | M | moment of a unit force about the axis | length", motions.moment_about(FORMULAS, rate, arm)
)
M_perp = d.letter(
    r"M_perp | M_\perp | the same after a quarter turn of the arm | length",
    motions.moment_turned(FORMULAS, N, rate, arm),
)
M_across = d.letter(
    r"M_across | \vec M_a | part of the moment across the axis | length",
    motions.across(unit_moment, N, dot(N, unit_moment)),
)
M_guide = d.letter(
    r"M_guide | \vec M_g | the same about where the carriage is | length",
    motions.across(at_carriage, N, dot(N, at_carriage)),
)
compliance, softer, G, out, beside, leg_tension = d.letters(
    r"compliance | \kappa | compliance of a drive, a bearing or a guide | rad/(N·length)",
    r"softer | \kappa' | that of a guide at the end of the travel, less that at its start | rad/(N·length)",
    "G | G | weight of what is carried | N",
    r"out | \lambda | part of the arm at which the weight acts | 1",
    r"beside | \mu | part of the arm, turned by 90° about the axis, at which it acts | 1",
    "leg_tension | t | force in a leg per unit load (derivation closed_chain) | 1",
)
SPRING = "it is a linear spring"
heavy = G * cross(out * arm + beside * cross(N, arm), g)
d.check(
    "gravity-windup",
    equal(compliance * dot(N, heavy), k * M + k2 * M_perp),
    text="A weight anywhere across the axis winds up a drive by two parts of the moment.",
    assumptions=[SPRING, "what it carries is rigid, and moves with the mean of the targets"],
).prove(given={k: compliance * G * out, k2: compliance * G * beside})

# %%
d.check(
    "load-windup",
    equal(compliance * dot(N, cross(arm, F * g)), k * F * M),
    text="A load at the mean of the targets winds up a drive in proportion.",
    assumptions=[SPRING],
).prove(given={k: compliance})

# %%
overturning = cross(arm, G * g)
d.check(
    "lateral-windup",
    equal(compliance * (overturning - dot(N, overturning) * N), a * M_across),
    text="A bearing leans with the moment across its axis.",
    assumptions=[SPRING, "alike about all axes across its own"],
).prove(given={a: compliance * G})

# %%
overturning = cross(arm - q * N, G * g)
d.check(
    "guide-windup",
    equal((compliance + softer * zeta) * (overturning - dot(N, overturning) * N), (a + b * zeta) * M_guide),
    text="A guide leans with the moment about where the carriage has got to, the more the softer it is there.",
    assumptions=[SPRING, "its compliance changes evenly along the travel"],
).prove(given={a: compliance * G, b: softer * G})

# %%
d.check(
    "leg-compliance",
    equal(c * (leg_tension * F), c * F * leg_tension),
    text="Leg, nut and joints are one spring of the compliance c under the force in the leg.",
    assumptions=[SPRING],
).prove()

# %% [markdown]
# ## Flexures of telescopes, and the air
#
# A shaft, a fork and a tube are cantilevers under their own weight and what they carry. Only the part of gravity across
# them bends, by a slope $\beta$ where they are level (*Beams*, below).

# %%
beta, n, sight = d.letters(
    r"beta | \beta | slope of the end of a beam that is level | rad",
    r"n[3] | \vec n | axis before, on which a fork stands | 1",
    r"sight[3] | \vec x | line of sight, along the tube | 1",
)
bend = d.letter(r"bend | \vec B | of a shaft, per slope | 1", motions.shaft_bend(FORMULAS, N, g))
upright = Formulas(select=lambda condition, down, up: up)
fork = d.letter(r"fork | \Phi | of a fork, per slope | 1", motions.fork_bend(upright, N, n, g))
ALIKE = "a linear cantilever that bends alike to all sides"
d.check(
    "axis-flexure",
    equal(beta * cross(N, g - dot(N, g) * N), a * bend),
    text="The end of a shaft along the axis turns about what is across axis and gravity.",
    assumptions=[ALIKE],
).prove(given={a: beta})

# %%
d.check(
    "fork-flexure",
    equal(dot(N, beta * cross(n, g - dot(n, g) * n)), a * fork),
    text="The end of a fork that stands on the axis before turns as that of a shaft; the part about its own axis is "
    "seen as an error of this joint.",
    assumptions=[ALIKE, "the axis before points upwards: where it points down, n is its opposite"],
).prove(given={a: beta})

# %%
sin_zenith = d.letter(r"sin_zenith | \sin\zeta | of the zenith angle | 1", norm(cross(sight, -g)))
across_tube = norm(g - dot(sight, g) * sight)
d.check(
    "tube-flexure",
    equal(-beta * across_tube, -a * sin_zenith),
    text="A tube droops by the part of gravity across it, which is the sine of the zenith angle.",
    assumptions=[ALIKE, equal(norm(sight), 1), equal(norm(g), 1)],
).prove(
    equal(across_tube**2, sin_zenith**2),
    given={a: beta},
    modulo={sight.components[2]: dot(sight, sight) - 1, g.components[2]: dot(g, g) - 1},
    because="With a = β, the squares of both lengths agree, and lengths are not negative.",
)

# %% [markdown]
# Through layers of air that lie level, $n\sin\zeta$ stays the same (Snell). Outside, $n$ is 1; at the ground it is
# $1+a$. So the true zenith angle $\zeta+\alpha$ of what is seen at $\zeta$ obeys $\sin(\zeta+\alpha)=(1+a)\sin\zeta$.

# %%
sine = d.letter(r"sine>0 | \sigma | sine of the zenith angle at which a star is seen | 1")
tan_zenith = d.letter(r"tan_zenith | \tan\zeta | its tangent | 1", sine / sp.sqrt(1 - sine**2))
d.check(
    "refraction",
    equal(change(first_order(sp.asin((1 + epsilon * a) * sine))), a * tan_zenith),
    text="The lift is a tan ζ to first order in a.",
    assumptions=[
        "the layers are level and flat: up to 85°; from there on the model's lift is finite (finite-lift)"
    ],
).prove()

# %% [markdown]
# ## Temperature and time
#
# What is $\ell$ long grows by $\alpha T\ell$.

# %%
length, housing, along = d.letters(
    r"length | \ell | length of what grows | length",
    r"housing[3] | \vec\ell | from where the housing is held to the axis | length",
    r"along | \xi | place along a scale | length",
)
d.check(
    "expansion",
    equal(change(sp.integrate(alpha * T, (along, 0, q))), alpha * T * q),
    text="A scale grows from its zero on.",
    assumptions=["its temperature is the same all along"],
).prove()

# %%
d.check(
    "thermal-offset",
    equal(alpha * T * length, k * T),
    text="A part between the scale and the machine grows.",
).prove(given={k: alpha * length})

# %%
d.check(
    "thermal-drift",
    equal(alpha * T * housing, (x * EX + y * EY + z * EZ) * T),
    text="A housing grows and carries its axis away.",
).prove(given={**machine_axes, **{p: alpha * part for p, part in zip((x, y, z), housing, strict=True)}})

# %% [markdown]
# A machine that is switched on at $t=0$ warms up by Newton's law of cooling: its temperature approaches the last one at
# a rate that is in proportion to what is left. What moves with it does the same.

# %%
last = sp.Matrix([x, y, z])
warmed = last * (1 - sp.exp(-t / tau))
d.check(
    "warm-up",
    equal(change(warmed), (x * EX + y * EY + z * EZ) * (1 - sp.exp(-t / tau))),
    equal(change(warmed.diff(t)), change((last - warmed) / tau)),
    equal(change(warmed.subs(t, 0)), sp.ZeroMatrix(3, 1)),
    text="The way starts at zero, and its speed is what is left over τ.",
).prove(given=machine_axes)

# %%
d.check(
    "drift", defined((x * EX + y * EY + z * EZ) * t), text="Definition: any motion, to first order in time."
).prove()

# %% [markdown]
# ## Instruments
#
# An instrument whose axes are neither of one scale nor square reads $\vec r+A\vec r$ for $\vec r$, with any small
# matrix $A$ of nine numbers. Of these, three are a turn of the frame and one is a scale, which are effects of their
# own. Five are left: two scales and three angles.

# %%
A = d.letter("A[3,3] | A | errors of the axes of an instrument | 1")
read_x, read_y, read_z = d.letters(*(f"read_{i} | r_{i} | component of the reading | length" for i in "xyz"))
xy, xz, yz = amplitudes(("xy", "xz", "yz"), "rad")
(a11, a12, a13), (a21, a22, a23), (a31, a32, a33) = A.components.tolist()
reading = sp.Matrix([read_x, read_y, read_z])
common = a33 * reading + skew(sp.Matrix([a32, -a31, a21])) * reading
stretched = sp.Matrix([(a11 - a33) * read_x, (a22 - a33) * read_y, 0])
sheared = sp.Matrix([(a12 + a21) * read_y + (a13 + a31) * read_z, (a23 + a32) * read_z, 0])
d.check(
    "instrument-axes",
    equal(change(A.components * reading - common), stretched + sheared),
    equal(change(stretched), x * read_x * EX + y * read_y * EY),
    equal(change(sheared), (xy * read_y + xz * read_z) * EX + yz * read_z * EY),
    text="A distortion, less a scale and a turn, has two scales and three angles.",
).prove(given={**machine_axes, x: a11 - a33, y: a22 - a33, xy: a12 + a21, xz: a13 + a31, yz: a23 + a32})

# %% [markdown]
# ## Plates
#
# The height of a smooth plate is to second order a plane, which is where the plate lies, and half the quadratic form of
# its curvatures. Half the mean curvature is a bowl. The rest, a warp, bends the plate one way and the other: it has no
# mean curvature.

# %%
h11, h12, h22 = d.letters(
    *(f"h{i} | h_{{{i}}} | curvature of the plate | 1/length" for i in ("11", "12", "22"))
)
across = sp.Matrix([read_x, read_y])
curved = sp.Matrix([[h11, h12], [h12, h22]])
bowl = (h11 + h22) / 4 * sp.eye(2)
d.check(
    "plate",
    equal(change((across.T * bowl * across)[0]), a * (read_x**2 + read_y**2)),
    equal(
        change((across.T * (curved / 2 - bowl) * across)[0]),
        b * (read_x**2 - read_y**2) + c * 2 * read_x * read_y,
    ),
    equal((curved / 2 - bowl).trace(), 0),
    text="The bowl is the part that is the same when the plate is turned; the rest is a warp.",
).prove(given={a: (h11 + h22) / 4, b: (h11 - h22) / 4, c: h12 / 2})

# %% [markdown]
# ## Towers of deltas
#
# A tower leans outwards by $a$ and across by $b$: the sines are the components of its direction.

# %%
upwards = sp.sqrt(1 - sp.sin(a) ** 2 - sp.sin(b) ** 2)
direction = sp.sin(a) * U + sp.sin(b) * V + upwards * N
d.check(
    "tower-lean",
    equal(norm(direction) ** 2, 1),
    equal(q * (direction - N), q * (sp.sin(a) * U + sp.sin(b) * V + (upwards - 1) * N)),
    text="A carriage moves along a unit vector with these components.",
).prove(given=basis)

# %% [markdown]
# ## Beams
#
# How drop and slope of a beam are related follows from the beam equation, $EI\,\eta''''=p$. A **cantilever**, an arm
# that has been run out of its guide by $\ell$ and carries a load $F$ at its end:

# %%
stiffness, ell, p, tip, own = d.letters(
    "stiffness>0 | EI | bending stiffness | force·length²",
    r"ell>0 | \ell | length that is run out | length",
    "p | p | weight per length | force/length",
    r"tip | \mathrm{tip} | drop by the load at full travel | length",
    r"own | \mathrm{own} | drop by the beam's own weight at full travel | length",
)
xi = sp.Symbol("xi", real=True)


def bent(shape: sp.Expr, order: int, place: sp.Basic | int = xi) -> sp.Expr:
    """A derivative of a shape, at a place."""
    return (shape.diff(xi, order) if order else shape).subs(xi, place)


tip_shape = F * xi**2 * (3 * ell - xi) / (6 * stiffness)
own_shape = p * xi**2 * (6 * ell**2 - 4 * ell * xi + xi**2) / (24 * stiffness)
tip_drop = d.letter(r"tip_drop | \delta_F | drop at the end under the load | length", bent(tip_shape, 0, ell))
tip_slope = d.letter(r"tip_slope | \beta_F | slope at the end of the beam | rad", bent(tip_shape, 1, ell))
own_drop = d.letter(
    r"own_drop | \delta_p | drop at the end by its own weight | length", bent(own_shape, 0, ell)
)
own_slope = d.letter(r"own_slope | \beta_p | slope at the end of the beam | rad", bent(own_shape, 1, ell))
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
mid = d.letter(r"mid | \mathrm{mid} | sag in the middle | length", p * L**4 / (384 * stiffness))
bridge_shape = p * xi**2 * (L - xi) ** 2 / (24 * stiffness)
bridge = d.letter(
    r"bridge | \eta(\zeta\mathcal{L}) | sag of the bridge | length", bent(bridge_shape, 0, zeta * L)
)
bridge_slope = d.letter(
    r"bridge_slope | \eta'(\zeta\mathcal{L}) | slope of the bridge | rad", bent(bridge_shape, 1, zeta * L)
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
under = d.letter(r"under | \eta_F | drop under a load that stands at ζ𝓛 | length", bent(left_part, 0, ell))
under_slope = d.letter(r"under_slope | \eta_F' | slope under that load | rad", bent(left_part, 1, ell))
middle = d.letter(
    r"middle | \mathrm{mid}_F | drop of the load in the middle | length", F * L**3 / (48 * stiffness)
)
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
k0, k3, support = d.letters(
    "k0 | k_0 | drop per load, wherever it stands | length/N",
    "k3 | k_3 | drop per load at full travel | length/N",
    r"support | \kappa_0 | compliance of what carries the beam | length/N",
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
d.check(
    "load-sag",
    equal(support * F + tip_drop, F * (k0 + k3 * zeta**3)),
    equal(tip_slope, sp.Rational(3, 2) * F * k3 * zeta**2 / L),
    text="A load at the end of a ram whose guide gives way evenly.",
    assumptions=["a linear cantilever on a linear spring, which does not turn"],
).prove(given={ell: zeta * L, k0: support, k3: L**3 / (3 * stiffness)})
