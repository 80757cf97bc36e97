# %% [markdown]
# # The robotic arm of section 5.2, and the statements about figures 6, 8 and 9
#
# Zhou and Zhu plot their instantaneous Euler angles $\chi_x,\chi_y,\chi_z$ (notebook `instantaneous_euler`) together
# with conventional Euler angles: for a 3-SPS-S mechanism all of whose angles go from 0° to 360° (figure 6), and for
# an arm with six joints whose wrist turns along two curves (figures 8 and 9). Here the figures are drawn again, and
# each statement about them is proved or refuted. **Result:** of fourteen statements nine are true. Wrong are the one
# that each angle is independent of the rotation in other directions, and four of those about figure 9.
#
# The paper gives no dimensions of its arm, no table of joint parameters and no number from the figures, only "rotates
# in the sequence Z-Y-X", with the reference frame "at the center of the joint". That is enough: with a wrist of that
# sequence the angles depend on the wrist alone, as is proved at the end for an arm of that kind with any lengths.

# %%
import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.derivation.instantaneous_euler import PAPER, UNIT, turns, zyx
from rodgen.symbolic import Derivation, Letter, equal, in_notebook, rot

d = derivation = Derivation(
    "instantaneous_euler_arm",
    title="The robotic arm of section 5.2, and the statements about figures 6, 8 and 9",
    source=PAPER,
)
sin, cos, acos = sp.sin, sp.cos, sp.acos

# %% [markdown]
# ## Symbols

# %%
alpha = d.symbol("alpha", r"\alpha", "first Z-Y-X angle, about z0", "rad")
beta = d.symbol("beta", r"\beta", "second Z-Y-X angle, about y1", "rad")
gamma = d.symbol("gamma", r"\gamma", "third Z-Y-X angle, about x2; λ in the paper's curves", "rad")
t = d.symbol("t", "t", "common value of the three angles of figure 6", "rad")
x = d.symbol("x", "x", "parameter of the curves 1 and 2", "rad")
R = d.matrix("r", r"R", "rotation; its columns are the moved axes", "1", value=Letter("r", 3, 3).components)
chi_x, chi_y, chi_z = CHI = tuple(
    d.letter(rf"chi_{axis} | \chi_{axis} | instantaneous Euler angle {axis} | rad", acos(R.components[i, i]))
    for i, axis in enumerate("xyz")
)
sa, ca, sb, cb, sg, cg = (f(a) for a in (alpha, beta, gamma) for f in (sin, cos))
d


# %%
def along(*angles):
    """The rotation by Z-Y-X angles."""
    return {R: turns("zyx", [sp.sympify(a) for a in angles])}


IN_RANGE = "an angle between 0 and π is known by its cosine"

# %% [markdown]
# ## Figure 6: all angles from 0° to 360°
#
# The paper does not say how the three angles vary together. Its numbers of zeros agree with $\alpha=\beta=\gamma=t$,
# and do not agree with one angle at a time, for which two of the three curves would be alike and one flat. With $t$ in
# all three
#
# $$ \chi_x = \chi_z = \arccos\cos^2t, \qquad \chi_y = \arccos(\sin^3t + \cos^2t). $$
#
# Neither the sizes of the mechanism nor the exchanged labels of (20) matter here. The first statement is that of the
# three curves; those after it are the paper's about them.

# %%
by_t = along(t, t, t)
d.check(
    "figure-6-curves",
    equal(cos(chi_x), cos(t) ** 2),
    equal(cos(chi_y), sin(t) ** 3 + cos(t) ** 2),
    equal(cos(chi_z), cos(t) ** 2),
    text="The three curves, by the cosines of the angles.",
).prove(
    given=by_t,
    because="α = β = γ = t is inserted into the diagonal of the matrix of Z-Y-X.",
)

# %%
d.state(
    "figure-6-do-not-follow",
    *(sp.Ne(c, sp.pi) for c in CHI),
    said="the corresponding instantaneous Euler angles do not follow the conventional Euler angles",
    text="For example where the latter are 180°.",
    place="sec. 5.1, figure 6",
).prove(*(equal(cos(c), 1) for c in CHI), given=along(sp.pi, sp.pi, sp.pi), because="There all three are 0.")

# %%
d.state(
    "figure-6-peaks",
    sp.Le(chi_x, sp.pi / 2),
    sp.Le(chi_y, sp.pi),
    sp.Le(chi_z, sp.pi / 2),
    said="the peaks of the instantaneous Euler angles are smaller than the conventional Euler angles",
    place="sec. 5.1, figure 6",
).prove(
    equal(cos(chi_x), cos(t) ** 2),
    equal(cos(chi_y) + 1, (sin(t) + 1) * ((sin(t) - 1) ** 2 + 1)),
    equal(cos(chi_z), cos(t) ** 2),
    given=by_t,
    because="The peaks are 90°, 180° and 90°, those of the others 360°: no cosine is below 0, −1 and 0.",
)

# %%
d.check(
    "figure-6-greater-at-first",
    equal(cos(t) - cos(chi_x), cos(t) * (1 - cos(t))),
    text="The peaks are smaller, but not the angle at each instant: up to 90° χ_x is greater than α, because β adds "
    "to it.",
).prove(
    given=by_t,
    because="cos χ_x = cos²t. The right side is positive for 0 < t < 90°, so the cosine of χ_x is the smaller one.",
)

# %%
d.state(
    "figure-6-tend-to-zero",
    *(equal(cos(c), 1) for c in CHI),
    said="for a periodic variation in the Euler angles, the corresponding instantaneous Euler angles tend to be zero",
    text="At the end of the period, 360°.",
    place="sec. 5.1, figure 6",
).prove(given=along(2 * sp.pi, 2 * sp.pi, 2 * sp.pi), because="The body is back where it was.")

# %%
d.state(
    "figure-6-zeros",
    equal(1 - cos(chi_x), sin(t) ** 2),
    equal(1 - cos(chi_z), sin(t) ** 2),
    equal(1 - cos(chi_y), sin(t) ** 2 * (1 - sin(t))),
    said="The instantaneous Euler angles correspond to the Euler angles α and γ passing through the origin twice in "
    "the cycle, and the instantaneous Euler angle β passing through the origin three times in the cycle",
    place="sec. 5.1, figure 6",
).prove(
    given=by_t,
    because="χ_x and χ_z vanish where sin t = 0, at 0° and 180°; χ_y where also sin t = 1, at 0°, 90° and 180°. With "
    "both ends of the cycle each is one more.",
)

# %%
d.state(
    "independent-of-others",
    equal(chi_x, acos(cos(alpha))),
    equal(chi_y, acos(cos(beta))),
    equal(chi_z, acos(cos(gamma))),
    said="the angle between the current rotation plane and the initial rotation plane, which is independent of the "
    "rotation in other directions at any time",
    text="The angles are said to correspond to α, β and γ.",
    place="sec. 5.1, and “without considering the coupling of rotation angles in other directions”",
).refute(
    {alpha: 0, beta: sp.pi / 3, gamma: 0},
    [equal(cos(chi_x), ca * cb), equal(cos(chi_y), sa * sb * sg + ca * cg), equal(cos(chi_z), cb * cg)],
    given={R: zyx},
    label="Z42",
    because="Each depends on two or three of the angles: a rotation about y0 alone turns the yz and the xy plane.",
)


# %% [markdown]
# The figure drawn again: from left to right $\alpha$ and $\chi_x$, $\beta$ and $\chi_y$, $\gamma$ and $\chi_z$; blue
# are the conventional angles, orange the instantaneous ones. Below it are the paper's statements about it.


# %%
def marked(*ids):
    """Return the statements and whether they are true, as a Markdown table."""
    lines = ["| statement | true? | why |", "| --- | --- | --- |"]
    for id in ids:
        entry = d.entries[id]
        wrong = entry.refutation
        why = (wrong.because if wrong else entry.because).replace("|", "&#124;")
        words = f"“{entry.words}”" + (f" {entry.text}" if entry.text else "")
        lines.append(f"| {words} | **{'false' if wrong else 'true'}** | {why} |")
    return "\n".join(lines)


# %%
if in_notebook():
    import numpy as np
    from IPython.display import Markdown, display

    from rodgen.derivation.figures import GREEN, ORANGE, show
    from rodgen.derivation.figures import instantaneous_euler as figures

    def numbers(angles, values, letter):
        """Return the instantaneous angles of Z-Y-X angles along a curve."""
        matrix = turns("zyx", [sp.sympify(a) for a in angles])
        return [
            np.broadcast_to(
                np.arccos(np.clip(sp.lambdify(letter, matrix[i, i], "numpy")(values), -1, 1)), values.shape
            )
            for i in range(3)
        ]

    full = np.linspace(0, 2 * np.pi, 721)
    show(
        figures.curves(
            np.degrees(full),
            "t (degrees)",
            [full] * 3,
            numbers((t, t, t), full, t),
            ORANGE,
            "Figure 6, α = β = γ = t",
        )
    )
    display(
        Markdown(
            marked(
                "figure-6-do-not-follow",
                "figure-6-peaks",
                "figure-6-tend-to-zero",
                "figure-6-zeros",
                "independent-of-others",
            )
        )
    )

# %% [markdown]
# ## Figure 8: curve 1, α = sin x
#
# The wrist turns by $\alpha=\sin x$ about its first axis, z, while $x$ goes from 0 to $2\pi$; $\beta=\gamma=0$. So the
# rotation is about z0 alone.

# %%
by_curve_1 = along(sin(x), 0, 0)
d.state(
    "figure-8-x",
    equal(cos(chi_x), cos(sin(x))),
    said="the instantaneous Euler angle corresponding to the x axis is equal to the absolute value of α",
    place="sec. 5.2, figure 8",
).prove(
    given=by_curve_1,
    because=f"χ_x = |α|: |α| ≤ 1, the cosines are equal, and {IN_RANGE}. (By (20) as printed it would be 0.)",
)

# %%
d.state(
    "figure-8-y",
    equal(chi_y, chi_x),
    said="the instantaneous Euler angle corresponding to the y axis is consistent with the instantaneous Euler angle "
    "corresponding to the x axis",
    place="sec. 5.2, figure 8",
).prove(given=by_curve_1, because="Both planes turn about z0.")

# %%
d.state(
    "figure-8-z",
    equal(chi_z, 0),
    said="the instantaneous Euler angle corresponding to the z axis is 0",
    place="sec. 5.2, figure 8",
).prove(given=by_curve_1, because="The xy plane stays. (By (20) as printed it would be |α|.)")

# %%
d.state(
    "figure-8-coupling",
    equal(cos(chi_y), cos(alpha)),
    said="when a certain rotation angle changes, other rotation planes will also produce a corresponding coupling "
    "rotation angle",
    text="The first angle turns two planes.",
    place="sec. 5.2, figure 8",
).prove(given=along(alpha, 0, 0), because="χ_x and χ_y are both |α|.")

# %% [markdown]
# The figure drawn again, with the instantaneous angles in green as in the paper:

# %%
if in_notebook():
    show(
        figures.curves(
            full,
            "x",
            [np.sin(full), 0 * full, 0 * full],
            numbers((sin(x), 0, 0), full, x),
            GREEN,
            "Figure 8, curve 1: α = sin x",
        )
    )
    display(Markdown(marked("figure-8-x", "figure-8-y", "figure-8-z", "figure-8-coupling")))

# %% [markdown]
# ## Figure 9: curve 2, α = sin x, β = cos x
#
# Now the first two angles vary, $\alpha=\sin x$ and $\beta=\cos x$, and $\gamma=0$. Both are angles in radians, so that
# neither is above 57.3°. Along the curve $\chi_x=\arccos(\cos\alpha\cos\beta)$ stays between 54.69° and 57.30°.

# %%
by_curve_2 = along(sin(x), cos(x), 0)
curve_alpha = d.symbol("curve_alpha", r"\alpha_2", "α along curve 2", "rad", value=sin(x))
d.state(
    "figure-9-x",
    sp.Gt(chi_x, curve_alpha),
    said="the instantaneous Euler angle corresponding to the x axis is greater than the value of α",
    place="sec. 5.2, figure 9",
).refute(
    {x: sp.pi / 2},
    equal(cos(curve_alpha) - cos(chi_x), cos(sin(x)) * (1 - cos(cos(x)))),
    given=by_curve_2,
    label="Z43",
    because="Not smaller is right: where cos x = 0 both are equal, everywhere else it is greater than |α|.",
)

# %%
d.state(
    "figure-9-y",
    equal(chi_y, curve_alpha),
    said="the instantaneous Euler angle corresponding to the y axis varies in sinusoidal waveform",
    place="sec. 5.2, figure 9",
).refute(
    {x: -sp.pi / 2},
    equal(cos(chi_y), cos(sin(x))),
    given=by_curve_2,
    label="Z44",
    because="It is |α| = |sin x|, a rectified sine with kinks and half the period.",
)

# %%
d.state(
    "figure-9-z",
    equal(chi_z, sp.Abs(curve_alpha)),
    said="the instantaneous Euler angle corresponding to the z axis is equal to the absolute value of the angle α",
    place="sec. 5.2, figure 9",
).refute(
    {x: 0},
    equal(cos(chi_z), cos(cos(x))),
    given=by_curve_2,
    label="Z45",
    because="It is |β| = |cos x|: at x = 0 there is no α, and χ_z is 57.3°. What is |α| is χ_y.",
)

# %%
without_gamma = d.letter(
    r"chi_x_0 | \chi_x|_{\gamma=0} | χ_x with γ = 0 | rad", acos(turns("zyx", (alpha, beta, 0))[0, 0])
)
d.state(
    "figure-9-jointly",
    sp.Ne(chi_x, without_gamma),
    said="the variation in any instantaneous Euler angle is jointly determined by the other three Euler angles",
    text="χ_x would depend on γ.",
    place="sec. 5.2, figure 9",
    assumptions=[sp.Ne(gamma, 0)],
).refute(
    {alpha: sp.pi / 3, beta: 0, gamma: sp.pi / 3},
    equal(cos(chi_x), cos(alpha) * cos(beta)),
    given={R: zyx},
    label="Z46",
    because="Only χ_y depends on all three: χ_x does not on γ, nor χ_z on α.",
)

# %%
d.state(
    "state-quantity",
    *(equal(cos(c), R.components[i, i]) for i, c in enumerate(CHI)),
    said="the instantaneous Euler angle is a state quantity",
    place="sec. 5.2",
).prove(because="It is a function of the attitude.")

# %% [markdown]
# The figure drawn again, in the same colours:

# %%
if in_notebook():
    show(
        figures.curves(
            full,
            "x",
            [np.sin(full), np.cos(full), 0 * full],
            numbers((sin(x), cos(x), 0), full, x),
            GREEN,
            "Figure 9, curve 2: α = sin x, β = cos x",
        )
    )
    display(Markdown(marked("figure-9-x", "figure-9-y", "figure-9-z", "figure-9-jointly", "state-quantity")))

# %% [markdown]
# ## An arm with six joints
#
# Do the figures depend on the arm? The arm here has any lengths: a column of the height $d_1$ with a joint about z,
# an upper arm $a_2$ and a forearm $a_3$ with joints about y, and at the end of the forearm a wrist whose joints turn
# about z, y and x through one point, the sequence of the paper. The tool point is $d_6$ in front of the wrist. When
# all joints are at zero the upper arm stands upright and the forearm points along x.
#
# The pose of the tool is written down link by link, and compared with the product of exponentials: six rotations about
# the joint axes in their places at zero.

# %%
joints = sp.Matrix([d.symbol(f"q{n}", f"q_{n}", f"joint {n}", "rad") for n in range(1, 7)])
d1, a2, a3, d6 = lengths = tuple(
    d.symbol(name, letter, quantity, "length")
    for name, letter, quantity in (
        ("d1", "d_1", "height of the shoulder"),
        ("a2", "a_2", "upper arm"),
        ("a3", "a_3", "forearm, to the wrist's centre"),
        ("d6", "d_6", "from the wrist's centre to the tool point"),
    )
)


def pose(joints, lengths):
    """Rotation of the tool, its point and the wrist's centre, in axes of the base."""
    d1, a2, a3, d6 = lengths
    ex, ez = UNIT["x"], UNIT["z"]
    base, upper = rot("z", joints[0]), rot("y", joints[1])
    forearm = rot("y", joints[2])
    arm = base * upper * forearm
    wrist = base * (d1 * ez + upper * (a2 * ez + forearm * a3 * ex))
    rotation = arm * sp.Matrix(turns("zyx", joints[3:]))
    return rotation, wrist + rotation * d6 * ex, wrist


def about(axis, point, angle):
    """Displacement: a rotation about a line along a coordinate axis."""
    rotation = rot(axis, angle)
    return sp.Matrix(
        sp.BlockMatrix([[rotation, point - rotation * point], [sp.zeros(1, 3), sp.ones(1, 1)]]).as_explicit()
    )


ez, ex = UNIT["z"], UNIT["x"]
elbow, centre = (d1 + a2) * ez, (d1 + a2) * ez + a3 * ex
screws = [("z", 0 * ez), ("y", d1 * ez), ("y", elbow), ("z", centre), ("y", centre), ("x", centre)]
product = sp.eye(4)
for (axis, point), joint in zip(screws, joints, strict=True):
    product = product * about(axis, point, joint)
rotation, tool, wrist = pose(joints, lengths)


def letters_for(name, latex, quantity, one, other):
    """Letters for the same quantity, by links and by the product."""
    one, other = sp.Matrix(one), sp.Matrix(other)
    return tuple(
        d.matrix(
            f"{name}_{way}",
            f"{latex}_{{\\mathrm{{{way}}}}}",
            f"{quantity}, {words}",
            unit,
            value=value,
            rows=value.rows,
            columns=value.cols,
        )
        for way, words, value, unit in (
            ("links", "link by link", one, "1" if one.cols == 3 else "length"),
            ("product", "by the product of six rotations", other, "1" if one.cols == 3 else "length"),
        )
    )


turned_tool = letters_for("R", "R", "rotation of the tool", rotation, product[:3, :3])
tool_point = letters_for(
    "tool", r"\vec t", "tool point", tool, (product * sp.Matrix([*(centre + d6 * ex), 1]))[:3]
)
wrist_centre = letters_for(
    "wrist", r"\vec w", "centre of the wrist", wrist, (product * sp.Matrix([*centre, 1]))[:3]
)
d.check(
    "arm",
    *(equal(one, other) for one, other in (turned_tool, tool_point, wrist_centre)),
    text="The pose is the product of the six rotations about the joint axes at zero.",
).prove(because="Both are computed, and their components compared.")

# %% [markdown]
# In the axes of the forearm, where the paper has its reference frame, the rotation of the tool is $R_3^TR$ with the
# rotation $R_3$ of the forearm, and only the wrist is in it:

# %%
held = [joints[0], joints[1], joints[2]]
start = pose([*held, 0, 0, 0], lengths)[0]
by_wrist = dict(zip((alpha, beta, gamma), joints[3:], strict=True))
forearm = d.letter("forearm[3,3] | R_3 | rotation of the forearm, by the first three joints | 1", start)
of_wrist = d.letter(
    "of_wrist[3,3] | R_{zyx}(q_4,q_5,q_6) | rotation by the Z-Y-X angles of the wrist | 1",
    zyx.xreplace(by_wrist),
)
d.check(
    "wrist-alone",
    equal(forearm.T * turned_tool[0], of_wrist),
    text="So the figures do not depend on the lengths of the arm, nor on its first three joints.",
).prove(because="The tool's rotation is that of the forearm times that of the wrist, and R₃ᵀR₃ = I.")

# %% [markdown]
# In other axes the three angles are others. Take the second joint at 90°, so that the forearm points straight down, and
# turn the first wrist joint by $\alpha$. In a reference frame that is fixed in the base this is a rotation about x:

# %%
tilted = {joints[0]: 0, joints[1]: sp.pi / 2, joints[2]: 0, joints[3]: alpha, joints[4]: 0, joints[5]: 0}
in_base = (rotation * start.T).xreplace(tilted)
d.check(
    "frame-matters",
    equal(
        d.matrix("in_base", r"R\,R_3^T", "rotation of the tool in axes of the base", "1", value=in_base),
        sp.ImmutableMatrix(rot("x", alpha)),
    ),
    text="Curve 1 with the second joint at 90°, in axes of the base: χ = (0, |α|, |α|) instead of (|α|, |α|, 0).",
).prove(because="The rotation of the wrist about the z axis of the forearm, which is the x axis of the base.")


# %%
def chi_arm_pose():
    k = KernelBuilder(
        "chi_arm_pose",
        summary="Pose of an arm with six joints and a Z-Y-X wrist.",
        source="Zhou and Zhu, sec. 5.2; derivation instantaneous_euler_arm, entry arm",
    )
    joints = k.input("joints", 6, unit="rad", doc="joint angles, the base's first")
    lengths = k.input(
        "lengths",
        4,
        unit="length",
        doc="height of the shoulder, upper arm, forearm, wrist's centre to tool point",
    )
    rotation, tool, wrist = pose(list(joints), list(lengths))
    k.output("matrix", sp.Matrix(rotation), unit="1", doc="rotation of the tool, in axes of the base")
    k.output("point", tool, unit="length", doc="tool point")
    k.output("wrist", wrist, unit="length", doc="centre of the wrist")
    return k.build()


derivation.kernel(chi_arm_pose())

# %% [markdown]
# The figure shows the arm along curve 2 in four attitudes. At the tool point are the directions of the ridge lines, in
# which the coordinate planes meet their images.

# %%
if in_notebook():
    posture_of = sp.Tuple(rotation, tool, wrist).subs(dict(zip(lengths, figures.SIZES, strict=True)))
    show(figures.postures(sp.lambdify([list(joints)], list(posture_of), "numpy")))
