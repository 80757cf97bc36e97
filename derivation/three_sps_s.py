# %% [markdown]
# # A platform that turns about a point, on three legs
#
# The 3-SPS-S machine of X. Zhou and J. Zhu ("A Decoupling Method for Successive Robot Rotation Based on Time Domain
# Instantaneous Euler Angle", Mathematics 2023, 11(18), 3882, section 5.1) is a platform on a ball joint. Three
# legs of variable length turn it: each has a ball joint on the base, at a radius $R$, a sliding joint, and a ball joint
# on the platform, at a radius $r$. The pivot is the platform's centre, at the height $h$ over the base's.
#
# The lengths of the legs for a given rotation are three distances; the paper gives them in (21) to (23). The way back,
# from lengths to rotations, the paper takes for granted. Here both are derived:
#
# - three lengths belong to up to eight rotations; one polynomial of degree eight, the octic, holds them all, and each
# of   its real simple roots is one rotation;
# - the determinant of the Jacobian, in closed form, shows where the legs do not hold the platform. The position that
# the   machine starts from is one of these places.

# %%
import sympy as sp

from rodgen.codegen import KernelBuilder
from rodgen.symbolic import EPS, Derivation, coordinate_rotation, cross, dot, equal, in_notebook, select

d = derivation = Derivation(
    "three_sps_s",
    title="3-SPS-S: a platform that turns about a point, on three legs",
    source='Zhou and Zhu, "A Decoupling Method for Successive Robot Rotation Based on Time Domain Instantaneous Euler '
    'Angle", Mathematics 2023, 11(18), 3882, sec. 5.1',
)

# %% [markdown]
# ## Symbols
#
# The rotation is a unit quaternion $(q_0,q_1,q_2,q_3)$, scalar first, written as two complex numbers $v=q_0+iq_3$ and
# $w=q_1+iq_2$ with $|v|^2+|w|^2=1$. A rotation about the machine's axis turns the phase of $v$, and $|w|$ is the sine
# of half the tilt. $\Re$ and $\Im$ are real and imaginary part; a bar is the complex conjugate. The legs
# $L_1,L_2,L_3$ stand at $-30°$, $90°$ and $210°$. $K$ stands for $R^2+r^2+h^2$.

# %%
R = d.symbol("base_radius", "R", "radius of the joints on the base", "length", positive=True)
r = d.symbol("platform_radius", "r", "radius of the joints on the platform", "length", positive=True)
h = d.symbol("height", "h", "height of the pivot over the base", "length", nonzero=True)
q = [
    d.symbol(f"q_{n}", f"q_{n}", ("scalar" if n == 0 else f"{'xyz'[n - 1]}") + " part of the quaternion", "1")
    for n in range(4)
]
q0, q1, q2, q3 = q
UNIT = {q3: q0**2 + q1**2 + q2**2 + q3**2 - 1}
M = sp.ImmutableMatrix(
    [
        [q0**2 + q1**2 - q2**2 - q3**2, 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
        [2 * (q1 * q2 + q0 * q3), q0**2 - q1**2 + q2**2 - q3**2, 2 * (q2 * q3 - q0 * q1)],
        [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2],
    ]
)
rotation = d.matrix("rotation", r"\mathbf R", "orientation of the platform", "1", value=M)
r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation
root3 = sp.sqrt(3)
ANGLES = (-sp.pi / 6, sp.pi / 2, 7 * sp.pi / 6)
DIRECTIONS = [sp.Matrix([sp.cos(a), sp.sin(a), 0]) for a in ANGLES]
A = [
    d.vector(f"A_{n}", rf"\vec A_{n}", f"joint of leg {n} on the base", "length", value=R * u)
    for n, u in enumerate(DIRECTIONS, 1)
]
b = [
    d.letter(rf"b_{n}[3] | \vec b_{n} | joint of leg {n} on the platform, in its axes | length", r * u)
    for n, u in enumerate(DIRECTIONS, 1)
]
pivot = sp.Matrix([0, 0, h])
B = [
    d.letter(
        rf"B_{n}[3] | \vec B_{n} | joint of leg {n} on the platform, in machine axes | length",
        sp.Matrix(rotation.components) * (r * u) + pivot,
    )
    for n, u in enumerate(DIRECTIONS, 1)
]
K = R**2 + r**2 + h**2
length_squared = [
    d.symbol(f"square_{n}", f"L_{n}^2", f"square of leg {n}", "length²", value=dot(b_n - a_n, b_n - a_n))
    for n, a_n, b_n in zip((1, 2, 3), A, B, strict=True)
]
S1, S2, S3 = length_squared
d

# %% [markdown]
# ## The lengths of the legs
#
# The paper's (21) are the joints $\vec b_k$ on the platform, in its own axes, and $\vec A_k$ on the base; (22) are the
# joints of the platform in machine axes, $\vec B_k=\mathbf R\,\vec b_k+(0,0,h)$; (23) are the lengths
# $L_k=|\vec B_k-\vec A_k|$. The minus signs of (21) and (22) are lost in the text of the paper that was at hand. Read
# with $B_1$ at $+x$ the equations are right; with $B_1$ at $-x$ they are right, too, and legs 1 and 3 change names.

# %%
triple = root3 / 2, sp.Rational(-1, 2), 0
d.state(
    "21",
    equal(b[0], r * sp.Matrix(triple)),
    equal(b[1], r * sp.Matrix([0, 1, 0])),
    equal(b[2], r * sp.Matrix([-triple[0], triple[1], 0])),
    equal(A[0], R * sp.Matrix(triple)),
    equal(A[1], R * sp.Matrix([0, 1, 0])),
    equal(A[2], R * sp.Matrix([-triple[0], triple[1], 0])),
    text="The joints on the platform and on the base stand at −30°, 90° and 210°.",
    place="eq. (21)",
).prove()

# %%
d.state(
    "22",
    equal(
        B[0],
        sp.Matrix(
            [root3 * r * r11 - r * r12, root3 * r * r21 - r * r22, root3 * r * r31 - r * r32 + 2 * h],
        )
        / 2,
    ),
    equal(B[1], sp.Matrix([r * r12, r * r22, r * r32 + h])),
    equal(
        B[2],
        sp.Matrix(
            [-root3 * r * r11 - r * r12, -root3 * r * r21 - r * r22, -root3 * r * r31 - r * r32 + 2 * h],
        )
        / 2,
    ),
    text="The platform's joints in machine axes, by the entries of $\\mathbf R$.",
    place="eq. (22)",
).prove()

# %% [markdown]
# Written out, the squares of the lengths are linear in the rotation matrix, since $|\vec b_k|$ and $|\vec A_k|$ are
# constants.

# %%
d.check(
    "23-expanded",
    equal(S1, K + h * r * (root3 * r31 - r32) - R * r / 2 * (3 * r11 + r22 - root3 * (r12 + r21))),
    equal(S2, K + 2 * h * r * r32 - 2 * R * r * r22),
    equal(S3, K + h * r * (-root3 * r31 - r32) - R * r / 2 * (3 * r11 + r22 + root3 * (r12 + r21))),
    text="The squares of the legs, (23) squared.",
).prove(modulo=UNIT)

# %% [markdown]
# The paper calls what (23) gives the changes of the sliding joints. It gives the lengths of the legs. $L_0$ is the
# length of a leg at the start, where the platform is not turned.

# %%
home_square = d.letter("home_square | L_0^2 | square of a leg at the start | length²", (R - r) ** 2 + h**2)
L2_now = d.symbol("leg_2", "L_2", "leg 2, by (23)", "length", value=sp.sqrt(S2))
change_2 = d.letter(r"change_2 | \Delta L_2 | change of leg 2 | length", sp.sqrt(S2) - sp.sqrt(home_square))
d.state(
    "23-changes",
    equal(change_2, L2_now),
    text="What (23) gives is the change of a leg.",
    said="if the rotation angles (α, β, γ) are specified, the corresponding changes in the prismatic joint will be "
    "realized",
    place="eq. (23)",
).refute(
    {q0: 1, q1: 0, q2: 0, q3: 0, R: 2, r: 1, h: 1},
    equal(change_2, L2_now - sp.sqrt(home_square)),
    because="It is the length, from joint to joint; the change is the difference from the length at the start.",
    label="P1",
)

# %% [markdown]
# ## What three legs determine
#
# Three combinations of the squares hold all the information of the legs about the rotation. One of them is
# $A=r_{11}+r_{22}=\cos\chi_x+\cos\chi_y$, where $\chi_x$ and $\chi_y$ are two of the paper's instantaneous Euler
# angles; the other two are the real and the imaginary part of a complex number $Z$. From the legs they are
# $$A=\frac{3K-L_1^2-L_2^2-L_3^2}{3rR},\qquad \Re Z=\frac{2L_2^2-L_1^2-L_3^2}{3r},\qquad
# \Im Z=\frac{L_1^2-L_3^2}{\sqrt3\,r}.$$

# %%
cos_sum = d.symbol("cos_sum", "A", "cos χx + cos χy", "1", value=(3 * K - S1 - S2 - S3) / (3 * r * R))
Z_re = d.symbol("Z_re", r"\Re Z", "real part of Z", "length", value=(2 * S2 - S1 - S3) / (3 * r))
Z_im = d.symbol("Z_im", r"\Im Z", "imaginary part of Z", "length", value=(S1 - S3) / (root3 * r))
d.check(
    "invariants",
    equal(cos_sum, r11 + r22),
    equal(Z_re, 2 * h * r32 + R * (r11 - r22)),
    equal(Z_im, 2 * h * r31 + R * (r12 + r21)),
    text="The three numbers, which are made of the squares of the legs, by the entries of $\\mathbf R$.",
).prove(modulo=UNIT)

# %% [markdown]
# In the two complex numbers they become short: $Z_{vw}=4hv\bar w+2Rw^2$.

# %%


def parts(value):
    """Real and imaginary part of a polynomial in I and real symbols."""
    return sp.expand(value).as_real_imag()


v, w = q0 + sp.I * q3, q1 + sp.I * q2
v_bar, w_bar = q0 - sp.I * q3, q1 - sp.I * q2
Z_of_q = 4 * h * v * w_bar + 2 * R * w**2
Z_parts = parts(Z_of_q)


v2_re, v2_im = (
    d.letter(rf"v2_{name} | \{latex}(v^2) | {what} part of v² | 1", value)
    for name, latex, what, value in zip(
        ("re", "im"), ("Re", "Im"), ("real", "imaginary"), parts(v**2), strict=True
    )
)
Zq_re, Zq_im = (
    d.letter(rf"Zq_{name} | \{latex}(4hv\bar w+2Rw^2) | {what} part of Z by v and w | length", value)
    for name, latex, what, value in zip(
        ("re", "im"), ("Re", "Im"), ("real", "imaginary"), Z_parts, strict=True
    )
)
d.check(
    "complex-form",
    equal(cos_sum, 2 * v2_re),
    equal(Z_re, Zq_re),
    equal(Z_im, Zq_im),
    text="$A=2\\,\\Re(v^2)$ and $Z=4hv\\bar w+2Rw^2$.",
).prove(modulo=UNIT)

# %%
legs_again = [
    K - r * R * cos_sum + r * (Z_re * sp.cos(turn) + Z_im * sp.sin(turn))
    for turn in (2 * sp.pi / 3, 0, -2 * sp.pi / 3)
]
d.check(
    "legs-from-invariants",
    *(equal(square, again) for square, again in zip(length_squared, legs_again, strict=True)),
    text="And back: $L_k^2=K-rRA+r\\,\\Re(Ze^{-i\\delta_k})$ with $\\delta=120°,0°,-120°$. So $A$ and $Z$ say as much "
    "as the three legs.",
).prove(modulo=UNIT)

# %% [markdown]
# The paper goes on: "According to Equations (21)–(23), the instantaneous Euler angles are obtained." From the legs
# alone they are not. Here are two orientations with the same legs, by the quaternions $q$ and $p$, and with other
# angles. The angles are $\cos\chi_x=r_{11}$ and $\cos\chi_z=r_{33}$; $r_{ij}(p)$ and $L_k(p)$ are those of the other
# orientation.

# %%
p = [d.symbol(f"p_{n}", f"p_{n}", "another quaternion", "1") for n in range(4)]
to_other = dict(zip(q, p, strict=True))


def other(formula):
    """A formula for the other orientation."""
    return d.value(formula).xreplace(to_other)


r11_p, r33_p = (
    d.letter(f"r{n}{n}_p | r_{{{n}{n}}}(p) | that entry for the other quaternion | 1", other(value))
    for n, value in ((1, r11), (3, r33))
)
squares_p = [
    d.letter(
        f"square_{n}_p | L_{n}^2(p) | square of leg {n} for the other quaternion | length²", other(square)
    )
    for n, square in zip((1, 2, 3), length_squared, strict=True)
]
d.state(
    "angles-from-legs",
    equal(r11, r11_p),
    equal(r33, r33_p),
    text="Orientations with equal legs have equal angles $\\chi_x$ and $\\chi_z$.",
    said="According to Equations (21)-(23), the instantaneous Euler angles are obtained",
    place="sec. 5.1",
    assumptions=[
        *(sp.Eq(square, square_p) for square, square_p in zip(length_squared, squares_p, strict=True)),
        sp.Eq(sum(x**2 for x in q), 1),
        sp.Eq(sum(x**2 for x in p), 1),
    ],
).refute(
    {
        **dict(zip(q, (sp.Rational(-4, 5), sp.Rational(3, 5), 0, 0), strict=True)),
        **dict(zip(p, (sp.sqrt(82) / 10, 0, 0, 3 * sp.sqrt(2) / 10), strict=True)),
        R: 4,
        r: 1,
        h: sp.Rational(3, 2),
    },
    equal(r11 + r22, cos_sum),
    because="Equal legs leave up to eight orientations. Without a choice among these the legs give only "
    "the sum cos χx + cos χy.",
    label="P2",
    modulo=UNIT,
)

# %% [markdown]
# ## All rotations with given legs
#
# The legs give $A$ and $Z$; unknown are $v$ and $w$. The plan: everything but one number $\rho$ is eliminated, and a
# polynomial equation for $\rho$ is left. Let
# $$\rho=|w|^2=\sin^2(\chi_z/2),\qquad W=w^2,\qquad k=4R^2+16h^2 .$$
#
# 1. From $Z-2RW=4hv\bar w$ comes $|Z-2RW|^2=16h^2\rho(1-\rho)$, which is linear in the part of $W$ along $Z$. With
#    $y=|Z|^2+k\rho^2-16h^2\rho$ it is $4R\,\Re(Z\bar W)=y$ (`tilt`). As $|W|=\rho$, that determines $W$ up to a
#    reflection about $Z$.
# 2. The same equation gives $v$ from $w$: $4h\rho\,v=(Z-2RW)\,w$ (`back-substitution`).
# 3. Squared and multiplied by $Z^3$ it gives $64h^2R\,\Re(Z^3\bar v^2)=P$, where
#    $P=y\,(g^2-12R^2|Z|^2)+16R^2|Z|^4$ with $g=k\rho-16h^2$ is a polynomial in $\rho$ (`P`).
# 4. The legs also say that $v^2=\frac A2+i\tau$ with $\tau^2=(1-\rho)^2-A^2/4$. With that the equation of step 3 has
#    one square root, $\tau$; squared away it leaves a polynomial equation of degree eight in $\rho$, the octic.

# %%
rho = d.symbol("rho", r"\rho", "sin²(χz/2)", "1", value=q1**2 + q2**2)
Z_squared = d.symbol("Z_squared", "|Z|^2", "square of |Z|", "length²", value=Z_re**2 + Z_im**2)
cube_re = d.symbol("cube_re", r"\Re Z^3", "real part of Z³", "length³", value=Z_re**3 - 3 * Z_re * Z_im**2)
cube_im = d.letter(r"cube_im | \Im Z^3 | imaginary part of Z³ | length³", 3 * Z_re**2 * Z_im - Z_im**3)
k_rho = 4 * R**2 + 16 * h**2
y = Z_squared + k_rho * rho**2 - 16 * h**2 * rho
g = k_rho * rho - 16 * h**2
P = y * (g**2 - 12 * R**2 * Z_squared) + 16 * R**2 * Z_squared**2

# The proofs stay short when Z is replaced by its polynomial in the quaternion.
in_q = {Z_re: Z_parts[0], Z_im: Z_parts[1]}
W_parts = parts(w**2)
along = Z_re * W_parts[0] + Z_im * W_parts[1]
W_re, W_im = (
    d.letter(rf"W_{name} | \{latex} W | {what} part of W = w² | 1", value)
    for name, latex, what, value in zip(
        ("re", "im"), ("Re", "Im"), ("real", "imaginary"), W_parts, strict=True
    )
)
letter_k = d.letter("k_rho | k | 4R² + 16h² | length²", k_rho)
letter_y = d.letter("y | y | |Z|² + k ρ² − 16 h² ρ | length²", y)
letter_g = d.letter("g | g | k ρ − 16 h² | length²", g)
d.check(
    "tilt",
    equal(4 * R * (Z_re * W_re + Z_im * W_im), letter_y),
    equal(letter_y, Z_squared + letter_k * rho**2 - 16 * h**2 * rho),
    text="First step: $4R\\,\\Re(Z\\bar W)=y$.",
).prove(given=in_q, modulo=UNIT)

# %%
lifted = parts((Z_of_q - 2 * R * w**2) * w)
lifted_re, lifted_im = (
    d.letter(rf"lifted_{name} | \{latex}\bigl((Z-2RW)\,w\bigr) | {what} part of (Z − 2RW) w | length", value)
    for name, latex, what, value in zip(
        ("re", "im"), ("Re", "Im"), ("real", "imaginary"), lifted, strict=True
    )
)
d.check(
    "back-substitution",
    equal(4 * h * rho * q0, lifted_re),
    equal(4 * h * rho * q3, lifted_im),
    text="Second step: $4h\\rho\\,v=(Z-2RW)\\,w$, for $Z=4hv\\bar w+2Rw^2$, in real and imaginary parts.",
).prove()

# %%
v_square = parts(v**2)
d.check(
    "P",
    equal(
        64 * h**2 * R * (cube_re * v2_re + cube_im * v2_im),
        letter_y * (letter_g**2 - 12 * R**2 * Z_squared) + 16 * R**2 * Z_squared**2,
    ),
    text="Third step: $64h^2R\\,\\Re(Z^3\\bar v^2)=P$, with $P$ written out on the right.",
).prove(given=in_q, modulo=UNIT)

# %%
# numbers that the legs give, as letters that proofs do not replace
tau = d.symbol("tau", r"\tau", "Im v²", "1")
Re3 = d.symbol("Z3_re", r"Z^3_r", "real part of Z³, as a letter", "length³")
Im3 = d.symbol("Z3_im", r"Z^3_i", "imaginary part of Z³, as a letter", "length³")
a_letter = d.symbol("a", "a", "A, as a letter", "1")
rho_letter = d.symbol("x_rho", r"\varrho", "ρ, as a letter", "1")
P_letter = d.symbol("P", "P", "P(ρ), as a letter", "length⁶")
octic_left = (P_letter - 32 * a_letter * h**2 * R * Re3) ** 2
octic_right = 1024 * R**2 * h**4 * Im3**2 * (4 * (1 - rho_letter) ** 2 - a_letter**2)
octic_entry = d.check(
    "octic",
    equal(octic_left, octic_right),
    text="Fourth step: every orientation satisfies the octic. By the third step $P=64h^2R\\,(\\Re Z^3\\,A/2+\\Im Z^3\\,"
    "\\tau)$ with $\\tau=\\Im(v^2)$, and $\\tau^2=(1-\\rho)^2-A^2/4$.",
)
octic_entry.prove(
    given={P_letter: 64 * h**2 * R * (Re3 * a_letter / 2 + Im3 * tau)},
    modulo={tau: tau**2 + a_letter**2 / 4 - (1 - rho_letter) ** 2},
)

# %%
d.check(
    "square-of-v",
    equal(v2_re**2 + v2_im**2, (1 - rho) ** 2),
    text="That is so because $|v^2|=|v|^2=1-\\rho$.",
).prove(modulo=UNIT)

# %% [markdown]
# ### How many rotations there are
#
# The octic has degree eight with the leading coefficient $k^6$, which no geometry makes vanish: there are never more
# than eight rotations with given legs (modes), and never a whole curve of them (for $h\ne0$). Where $\Im Z^3\ne0$
# each root belongs to one pair $\pm(v,w)$, and with the conjugate of a root goes the conjugate of the pair. A real
# simple root is its own conjugate, so its pair is conjugated to itself or to its negative; the negative would make
# $|v|^2+|w|^2=-1$. So **each real simple root is one real orientation**. Where $\Im Z^3=0$ the octic is a square, and
# each of the four roots belongs to two orientations, mirror images of each other, which are real or conjugate.

# %%
x_free = sp.Symbol("rho_free", real=True)
letters = {Z_squared: sp.Symbol("m", real=True)}
P_free = (
    (Z_squared + k_rho * x_free**2 - 16 * h**2 * x_free)
    * ((k_rho * x_free - 16 * h**2) ** 2 - 12 * R**2 * Z_squared)
    + 16 * R**2 * Z_squared**2
).xreplace(letters)
octic_poly = sp.Poly(
    (P_free - 32 * a_letter * h**2 * R * Re3) ** 2
    - 1024 * R**2 * h**4 * Im3**2 * (4 * (1 - x_free) ** 2 - a_letter**2),
    x_free,
)
assert octic_poly.degree() == 8
leading = d.symbol("leading", "c_8", "leading coefficient of the octic", "length^12", value=octic_poly.LC())
d.check(
    "degree",
    equal(leading, letter_k**6),
    text="The leading coefficient of the octic, that of $\\rho^8$, is $k^6$.",
).prove()

# %%
equal_legs = d.letter(
    r"octic_equal_legs | O_0(\varrho) | the octic for Z = 0 | length^12",
    octic_poly.as_expr().xreplace({x_free: rho_letter, letters[Z_squared]: 0, Re3: 0, Im3: 0}),
)
d.check(
    "equal-legs",
    equal(equal_legs, rho_letter**2 * (letter_k * rho_letter - 16 * h**2) ** 6),
    text="For equal legs, $Z=0$, two modes are pure torsions ($\\rho=0$), and six have $\\rho=4h^2/(R^2+4h^2)$.",
).prove()

# %%
psi = d.symbol("psi", r"\psi", "phase of w", "rad")
tilted = 2 * h / sp.sqrt(R**2 + 4 * h**2)
w_phase = sp.Matrix([sp.cos(psi), sp.sin(psi)])
cube = [4 * w_phase[0] ** 3 - 3 * w_phase[0], 3 * w_phase[1] - 4 * w_phase[1] ** 3]
six = [sp.S.Zero] * 4
six[1], six[2] = tilted * w_phase
six[0], six[3] = (-R / (2 * h) * tilted * part for part in cube)
at_six = dict(zip(q, six, strict=True))
norm_of_six = d.letter("norm_six | |v|^2+|w|^2 | |v|² + |w|² of the six modes | 1", sum(x**2 for x in six))
Z_re_six = d.letter(
    r"Z_re_six | \Re Z|_{\text{six}} | Re Z of the six modes | length", Z_parts[0].xreplace(at_six)
)
Z_im_six = d.letter(
    r"Z_im_six | \Im Z|_{\text{six}} | Im Z of the six modes | length", Z_parts[1].xreplace(at_six)
)
A_six = d.letter(r"A_six | A|_{\text{six}} | A of the six modes | 1", 2 * (six[0] ** 2 - six[3] ** 2))
cos_3psi = d.letter(r"cos_3psi | \cos(3\psi) | cosine of 3ψ | 1", cube[0])
d.check(
    "six",
    equal(norm_of_six, 1),
    equal(Z_re_six, 0),
    equal(Z_im_six, 0),
    equal(A_six, 2 * R**2 / (R**2 + 4 * h**2) * (2 * cos_3psi**2 - 1)),
    text="The six for equal legs: $w=\\frac{2h}{\\sqrt{R^2+4h^2}}e^{i\\psi}$ of any phase and "
    "$v=-\\frac{R}{2h}\\,w^2/\\bar w$ are a unit quaternion with $Z=0$, and $A=\\frac{2R^2}{R^2+4h^2}\\cos6\\psi$. So "
    "all eight modes of equal legs are real where $|A|<2R^2/(R^2+4h^2)$.",
).prove()

# %% [markdown]
# ### The octic that the kernel computes
#
# Near equal legs six roots crowd together and a root-finder loses them: six roots in one cost all but a sixth of the
# digits. The phase of $W$ does not crowd. With all lengths in units of $R$, $\eta=h/R$, $z=|Z|/R$ and
# $Z^3=|Z|^3(c_3+is_3)$, put
#
# $$\rho=\beta+\mu x,\qquad\beta=\frac{4\eta^2}{1+4\eta^2},\qquad\mu=\frac{z}{1+4\eta^2}.$$
#
# Then $g=4zx$, a factor $z^6$ leaves the octic, and for $z=0$ its six finite roots are $x=\cos\psi$ for the six phases.
# With the quartic $Q(x)=16\mu x^4+16\beta x^3+(4z-12\mu)x^2-12\beta x+z-8a\eta^2c_3$ and
# $T(x)=64\eta^4s_3^2\,\bigl(4(1-\beta-\mu x)^2-a^2\bigr)$ the octic in $x$ is:

# %%
eta = d.symbol("eta", r"\eta", "h/R", "1", nonzero=True)
z = d.symbol("z", "z", "|Z|/R", "1", nonnegative=True)
c3 = d.symbol("c3", "c_3", "cosine of three times the phase of Z", "1")
s3 = d.symbol("s3", "s_3", "sine of three times the phase of Z", "1")
x = d.symbol("x", "x", "root of the scaled octic", "1")
beta, mu = 4 * eta**2 / (1 + 4 * eta**2), z / (1 + 4 * eta**2)


def quartic_coefficients(a, eta, z, beta, mu, c3):
    """Coefficients of the polynomial whose square the octic is where the sine s3 vanishes, from x⁰ on."""
    return [z - 8 * a * eta**2 * c3, -12 * beta, 4 * z - 12 * mu, 16 * beta, 16 * mu]


def remainder_coefficients(a, eta, beta, mu, s3):
    """Coefficients of what is taken off that square, from x⁰ on."""
    factor = 64 * eta**4 * s3**2
    return [factor * (4 * (1 - beta) ** 2 - a**2), -8 * factor * (1 - beta) * mu, 4 * factor * mu**2]


def horner(coefficients, at):
    """Value of a polynomial."""
    return sum((c * at**n for n, c in enumerate(coefficients)), sp.S.Zero)


scaled = {R: 1, h: eta, letters[Z_squared]: z**2, Re3: z**3 * c3, Im3: z**3 * s3, x_free: beta + mu * x}
octic_in_x = d.symbol(
    "octic_in_x", "O(x)", "the octic for R = 1 at ρ = β + μ x", "1", value=octic_poly.as_expr().subs(scaled)
)
quartic_value = horner(quartic_coefficients(a_letter, eta, z, beta, mu, c3), x)
taken_off = horner(remainder_coefficients(a_letter, eta, beta, mu, s3), x)
quartic_letter = d.letter("Q_x | Q(x) | quartic of the scaled octic | 1", quartic_value)
taken_letter = d.letter("T_x | T(x) | what is taken off its square | 1", taken_off)
beta_letter, mu_letter = (
    d.letter(r"beta_x | \beta | 4η²/(1 + 4η²) | 1", beta),
    d.letter(r"mu_x | \mu | z/(1 + 4η²) | 1", mu),
)
quartic_shown = horner(quartic_coefficients(a_letter, eta, z, beta_letter, mu_letter, c3), x)
d.check(
    "scaled-octic",
    equal(octic_in_x, 16 * z**6 * (quartic_letter**2 - taken_letter)),
    equal(quartic_letter, quartic_shown),
    equal(taken_letter, 64 * eta**4 * s3**2 * (4 * (1 - beta_letter - mu_letter * x) ** 2 - a_letter**2)),
    text="The octic in $x$ has the factor $z^6$. What is left is $Q^2-T$.",
).prove()

# %%
rho_scaled = d.letter(r"rho_x | \rho | β + μ x | 1", beta + mu * x)
y_scaled = d.letter(
    "y_x | y | y for R = 1 | 1",
    z**2 + 4 * (1 + 4 * eta**2) * (beta + mu * x) ** 2 - 16 * eta**2 * (beta + mu * x),
)
d.check(
    "phase-of-w",
    equal(y_scaled, z**2 + 4 * (1 + 4 * eta**2) * rho_scaled**2 - 16 * eta**2 * rho_scaled),
    equal(y_scaled, z * (z + 4 * rho_scaled * x)),
    text="With $\\rho=\\beta+\\mu x$ and $R=1$, $y=z\\,(z+4\\rho x)$. So $W=e^{i\\arg Z}\\,(c\\pm "
    "i\\sqrt{\\rho^2-c^2})$ with $c=(z+4\\rho x)/4$: the phase of $w$ comes from $x$ without a small difference.",
).prove()  # fmt: skip

# %% [markdown]
# ## Where the legs do not hold the platform
#
# How fast do the legs change when the platform turns with the angular velocity $\vec\omega$ (in machine axes)? With
# $\vec c_k=\vec A_k-(0,0,h)$ from the pivot to a joint on the base,
# $$L_k\dot L_k=\tfrac12\frac{d(L_k^2)}{dt}=\vec\omega\cdot(\vec c_k\times\mathbf R\vec b_k).$$
# The left side is computed by the chain rule from (23) with the rate of the quaternion,
# $\dot q=\tfrac12(0,\vec\omega)\,q$.

# %%
omega = d.vector("omega", r"\vec\omega", "angular velocity", "rad/time")
c = [sp.Matrix(d.value(a_n)) - pivot for a_n in A]
Rb = [sp.Matrix(d.value(rotation)) * sp.Matrix(d.value(b_n)) for b_n in b]
rows = [cross(c_n, rb) for c_n, rb in zip(c, Rb, strict=True)]
spin = sp.Matrix(list(omega))
# the quaternion turns by dq/dt = (0, ω) q / 2
rates = {
    q0: -(spin[0] * q1 + spin[1] * q2 + spin[2] * q3) / 2,
    q1: (spin[0] * q0 + spin[1] * q3 - spin[2] * q2) / 2,
    q2: (spin[1] * q0 + spin[2] * q1 - spin[0] * q3) / 2,
    q3: (spin[2] * q0 + spin[0] * q2 - spin[1] * q1) / 2,
}
half_rates = []
for square in length_squared:
    written = sp.expand(d.value(square))
    half_rates.append(sum((sp.diff(written, part) * rate for part, rate in rates.items()), sp.S.Zero) / 2)
c_letters, Rb_letters = (
    [
        d.letter(f"{name}_{n} | {latex % n} | {what} of leg {n} | length", value)
        for n, value in enumerate(values, 1)
    ]
    for name, latex, what, values in (
        ("c_arm", r"\vec c_%d", "from the pivot to the joint on the base,", c),
        ("Rb", r"\mathbf R\vec b_%d", "from the pivot to the joint on the platform,", Rb),
    )
)
d.check(
    "leg-rates",
    *(
        equal(
            d.letter(
                rf"half_rate_{n} | \tfrac12\frac{{d(L_{n}^2)}}{{dt}} | half the rate of L_{n}² | length²/time",
                half,
            ),
            dot(omega, cross(c_n, rb_n)),
        )
        for n, half, c_n, rb_n in zip((1, 2, 3), half_rates, c_letters, Rb_letters, strict=True)
    ),
    text="Half the rates of the squares of the legs.",
).prove(modulo=UNIT)

# %% [markdown]
# The legs hold the platform where the three rows $\vec c_k\times\mathbf R\vec b_k$ are independent, so where their
# determinant $\Delta$ is not zero.

# %%
determinant = d.letter(
    r"determinant | \Delta | determinant of the rows c_k × R b_k | length⁶",
    dot(rows[0], cross(rows[1], rows[2])),
)
rho_v = q0**2 + q3**2
v_w_cubed = parts(v * w**3)[1]
determinant_short = (
    sp.Rational(3, 2)
    * root3
    * R
    * r**3
    * (v_square[1] * (h**2 * (rho_v - rho) - R**2 * rho) + R * h * v_w_cubed)
)
vw3_im = d.letter(r"v_w3_im | \Im(vw^3) | imaginary part of v w³ | 1", v_w_cubed)
d.check(
    "determinant",
    equal(
        determinant,
        sp.Rational(3, 2)
        * root3
        * R
        * r**3
        * (
            v2_im * (h**2 * (d.letter("v_squared | |v|^2 | square of |v| | 1", rho_v) - rho) - R**2 * rho)
            + R * h * vw3_im
        ),
    ),
    text="The determinant by $v$ and $w$, with $\\rho=|w|^2$.",
).prove(modulo=UNIT)

# %% [markdown]
# In tilt and torsion it can be read off. Every rotation is a tilt by $T$ towards the azimuth $F$, with a torsion
# $\sigma$ about the machine's axis: the Z-Y-Z angles $F$, $T$ and $\sigma-F$. Its quaternion has
# $v=\cos\tfrac T2\,e^{i\sigma/2}$ and $w=i\sin\tfrac T2\,e^{i(F-\sigma/2)}$. $\mathbf R_q$ is the rotation of that
# quaternion.

# %%

T = d.symbol("tilt_half", r"\tfrac T2", "half the tilt, χz/2", "rad")
F = d.symbol("azimuth", "F", "azimuth: the tilt is towards it", "rad")
s = d.symbol("torsion_half", r"\tfrac\sigma2", "half the torsion", "rad")
# Z-Y-Z angles F, T, σ - F: q1 + i q2 = i sin(T/2) exp(i (F - σ/2))
tilt_torsion = {
    q0: sp.cos(T) * sp.cos(s),
    q3: sp.cos(T) * sp.sin(s),
    q1: -sp.sin(T) * (sp.sin(F) * sp.cos(s) - sp.cos(F) * sp.sin(s)),
    q2: sp.sin(T) * (sp.cos(F) * sp.cos(s) + sp.sin(F) * sp.sin(s)),
}


def tripled(angle):
    """Cosine and sine of three times an angle."""
    cosine, sine = sp.cos(angle), sp.sin(angle)
    return 4 * cosine**3 - 3 * cosine, 3 * sine - 4 * sine**3


C3F, S3F = tripled(F)
cos_torsion, sin_torsion = sp.cos(s) ** 2 - sp.sin(s) ** 2, 2 * sp.sin(s) * sp.cos(s)
cos_phase = C3F * cos_torsion + S3F * sin_torsion  # cos(3F - σ)


cos_T, sin_T = sp.cos(T) ** 2 - sp.sin(T) ** 2, 2 * sp.sin(T) * sp.cos(T)
turn_y = coordinate_rotation("y", cos_T, sin_T)
last = coordinate_rotation(
    "z", cos_torsion * sp.cos(F) + sin_torsion * sp.sin(F), sin_torsion * sp.cos(F) - cos_torsion * sp.sin(F)
)
of_quaternion = d.letter(
    r"R_q[3,3] | \mathbf R_q | rotation of the quaternion of T, F and σ | 1", M.xreplace(tilt_torsion)
)
turn_F = d.letter(
    "R_F[3,3] | R_z(F) | rotation about z by F | 1", coordinate_rotation("z", sp.cos(F), sp.sin(F))
)
turn_T = d.letter("R_T[3,3] | R_y(T) | rotation about y by T | 1", turn_y)
turn_rest = d.letter(r"R_rest[3,3] | R_z(\sigma-F) | rotation about z by σ − F | 1", last)
d.check(
    "tilt-and-torsion",
    equal(of_quaternion, turn_F * turn_T * turn_rest),
    text="The quaternion is that of the Z-Y-Z angles $F$, $T$, $\\sigma-F$.",
).prove()  # fmt: skip

# %%
determinant_tilt = (
    sp.Rational(3, 2)
    * root3
    * R
    * r**3
    * (
        sp.cos(T) ** 2 * sin_torsion * (h**2 * cos_T - R**2 * sp.sin(T) ** 2)
        - R * h * sp.cos(T) * sp.sin(T) ** 3 * cos_phase
    )
)
letter_sin_torsion = d.letter(r"sin_torsion | \sin(\sigma) | sine of the torsion | 1", sin_torsion)
letter_cos_T = d.letter(r"cos_T | \cos(T) | cosine of the tilt | 1", cos_T)
letter_cos_phase = d.letter(r"cos_phase | \cos(3F-\sigma) | cosine of 3F − σ | 1", cos_phase)
cos_3F = d.letter(r"cos_3F | \cos(3F) | cosine of 3F | 1", C3F)
determinant_of_tilt = d.letter(
    r"determinant_tilt | \Delta(T,F,\sigma) | the determinant in tilt and torsion | length⁶",
    d.value(determinant_short).xreplace(tilt_torsion),
)  # fmt: skip
d.check(
    "determinant-tilt-torsion",
    equal(
        determinant_of_tilt,
        sp.Rational(3, 2)
        * root3
        * R
        * r**3
        * (
            sp.cos(T) ** 2 * letter_sin_torsion * (h**2 * letter_cos_T - R**2 * sp.sin(T) ** 2)
            - R * h * sp.cos(T) * sp.sin(T) ** 3 * letter_cos_phase
        ),
    ),
    text="The determinant in tilt and torsion.",
).prove()

# %% [markdown]
# It vanishes for a pure torsion by $0$ or $\pi$; at a tilt by $\pi$; and without torsion at every tilt straight towards
# a joint or away from it ($\cos3F=0$). The first of these is the position that the machine starts from: all legs grow
# with the square of a small yaw, so they neither drive nor hold it. The paper leaves singularities out ("the
# singularities within the cycle are neglected"), and its figure 6 starts there.

# %%
pure_torsion = d.letter(
    r"pure_torsion | \Delta_{T=0} | the determinant without tilt | length⁶", determinant_tilt.xreplace({T: 0})
)
d.check(
    "pure-torsion",
    equal(pure_torsion, sp.Rational(3, 2) * root3 * R * r**3 * h**2 * letter_sin_torsion),
    text="Without tilt the determinant vanishes for torsions by $0$ and $\\pi$ only.",
).prove()

# %%
untwisted = d.letter(
    r"untwisted | \Delta_{\sigma=0} | the determinant without torsion | length⁶",
    determinant_tilt.xreplace({s: 0}),
)
d.check(
    "no-torsion",
    equal(
        untwisted,
        -sp.Rational(3, 2) * root3 * R**2 * r**3 * h * sp.cos(T) * sp.sin(T) ** 3 * cos_3F,
    ),
    text="Without torsion it vanishes at every tilt towards $F=30°$, $90°$, …",
).prove()

# %%
d.check(
    "half-turn-tilt",
    equal(
        d.letter(
            r"half_turn | \Delta_{T=\pi} | the determinant at a tilt by π | length⁶",
            determinant_tilt.xreplace({T: sp.pi / 2}),
        ),
        0,
    ),
    text="At a tilt by $\\pi$ it is zero, whatever azimuth and torsion.",
).prove()

# %%
at_home = d.letter(
    r"determinant_home | \Delta_0 | the determinant at the start | length⁶",
    d.value(determinant).xreplace({q0: 1, q1: 0, q2: 0, q3: 0}),
)
d.state(
    "home-is-regular",
    sp.Ne(determinant, 0, evaluate=False),
    text="At the start, where the platform is not turned, the three legs drive three rotations.",
    tacit=True,
    place="sec. 5.1",
    assumptions=[sp.Eq(q0, 1), sp.Eq(q1, 0), sp.Eq(q2, 0), sp.Eq(q3, 0)],
).refute(
    {q0: 1, q1: 0, q2: 0, q3: 0, R: 2, r: 1, h: sp.Rational(3, 2)},
    equal(at_home, 0),
    because="The start is singular for every R, r and h: the legs are stationary in a yaw, and from it each of their "
    "lengths allows a yaw to either side.",
    label="P3",
)

# %% [markdown]
# The determinant over tilt (the distance from the middle) and azimuth, for three torsions of the machine $R=2$, $r=1$,
# $h=\frac32$. It vanishes on the black lines: without torsion on three straight ones, which meet in the start.

# %%
if in_notebook():
    from rodgen.derivation.figures import show
    from rodgen.derivation.figures import three_sps_s as figures

    normed = determinant_tilt / (r**3 * sp.sqrt(R**2 + h**2) ** 3)
    sizes = {R: 2, r: 1, h: sp.Rational(3, 2)}
    show(figures.singularities(sp.lambdify([F, T, s], normed.subs(sizes), "numpy")))

# %% [markdown]
# ## The functions of the package


# %%
SOURCE = "derivation three_sps_s; Zhou and Zhu, eqs. (21)-(23)"


def geometry(k):
    """Declare the three lengths of the machine."""
    return (
        k.input("base_radius", unit="length", doc="radius of the joints on the base"),
        k.input("platform_radius", unit="length", doc="radius of the joints on the platform"),
        k.input("height", unit="length", doc="height of the pivot over the base"),
    )


def radius_and_height(k):
    """Declare the two lengths that matter to where the machine is singular."""
    return (
        k.input("base_radius", unit="length", doc="radius of the joints on the base"),
        k.input("height", unit="length", doc="height of the pivot over the base"),
    )


def direction_rows():
    """Directions of the three joints, with one square root for all."""
    half = sp.Rational(1, 2)
    return [
        sp.Matrix([root3 / 2, -half, 0]),
        sp.Matrix([0, 1, 0]),
        sp.Matrix([-root3 / 2, -half, 0]),
    ]


def arms(matrix, R, r, h):
    """For each leg: from the pivot to its joint on the base, and to its joint on the platform."""
    return [(R * u - sp.Matrix([0, 0, h]), matrix * (r * u)) for u in direction_rows()]


def quaternion_matrix(parts_of_q):
    """Rotation matrix of a quaternion of unit length."""
    return sp.Matrix(M.xreplace(dict(zip(q, parts_of_q, strict=True))))


def normalised(k, name, quaternion):
    """A quaternion of unit length."""
    return k.let(name, quaternion / k.let(f"{name}_length", sp.sqrt(quaternion.dot(quaternion))))


def legs_output(k, matrix, R, r, h):
    spans = [k.let(f"span_{n}", turned - base) for n, (base, turned) in enumerate(arms(matrix, R, r, h), 1)]
    k.output(
        "legs",
        sp.Matrix([sp.sqrt(span.dot(span)) for span in spans]),
        unit="length",
        doc="lengths of the legs",
    )


def sps_legs():
    k = KernelBuilder("sps_legs", summary="Lengths of the three legs of a 3-SPS-S machine.", source=SOURCE)
    matrix = k.input("matrix", (3, 3), unit="1", doc="orientation of the platform, a rotation matrix")
    legs_output(k, matrix, *geometry(k))
    return k.build()


def sps_legs_from_quaternion():
    k = KernelBuilder(
        "sps_legs_from_quaternion",
        summary="Lengths of the three legs of a 3-SPS-S machine, from a quaternion.",
        source=SOURCE,
    )
    quaternion = k.input(
        "quaternion", 4, unit="1", doc="orientation, a quaternion of any length, scalar first"
    )
    lengths = geometry(k)
    legs_output(k, k.let("matrix", quaternion_matrix(normalised(k, "unit", quaternion))), *lengths)
    return k.build()


def jacobian_rows(k, matrix, R, r, h):
    pairs = arms(matrix, R, r, h)
    return [k.let(f"row_{n}", base.cross(turned)) for n, (base, turned) in enumerate(pairs, 1)]


def sps_jacobian():
    k = KernelBuilder(
        "sps_jacobian",
        summary="Leg rates of a 3-SPS-S machine by the platform's angular velocity.",
        source=SOURCE,
        notes="Row k is (c_k × R b_k) / L_k; NaN or infinite where a leg has no length.",
    )
    matrix = k.input("matrix", (3, 3), unit="1", doc="orientation of the platform, a rotation matrix")
    R, r, h = geometry(k)
    legs = []
    for n, (base, turned) in enumerate(arms(matrix, R, r, h), 1):
        span = k.let(f"span_{n}", turned - base)
        legs.append(k.let(f"leg_{n}", sp.sqrt(span.dot(span))))
    rows = jacobian_rows(k, matrix, R, r, h)
    stacked = sp.Matrix.vstack(*((row / leg).T for row, leg in zip(rows, legs, strict=True)))
    k.output(
        "jacobian",
        stacked,
        unit="length/rad",
        doc="dL/dt of each leg by each component of ω, in machine axes",
    )
    return k.build()


def sps_singularity():
    k = KernelBuilder(
        "sps_singularity",
        summary="Determinant of the normed leg moments of a 3-SPS-S machine: how well the legs hold the platform.",
        source=SOURCE,
        notes="The determinant of the rows (c_k × R b_k) / (|c_k| |b_k|): between -1 and 1, zero where the legs do not "
        "hold the platform. Its sign changes where two assembly modes meet.",
    )
    matrix = k.input("matrix", (3, 3), unit="1", doc="orientation of the platform, a rotation matrix")
    R, h = radius_and_height(k)
    size = k.let("size", sp.sqrt(R**2 + h**2))
    pairs = arms(matrix, R / size, 1, h / size)
    rows = [k.let(f"row_{n}", base.cross(turned)) for n, (base, turned) in enumerate(pairs, 1)]
    k.output("determinant", rows[0].dot(rows[1].cross(rows[2])), unit="1", doc="normed determinant")
    return k.build()


# %% [markdown]
# The invariants of the legs, in units of the base's radius. Where $Z=0$ its phase is free and taken as zero.


# %%
def said_by_legs(k, legs, R, r, h):
    """A, η, z, cosine and sine of the phase of Z, and of three times it."""
    # (R² + h² + r² - L²)/(R r) without squares of lengths that might not fit into a number
    square = [k.let(f"square_{n}", (leg / R) ** 2) for n, leg in enumerate(legs, 1)]
    ratio, eta = k.let("ratio", r / R), k.let("eta", h / R)
    K = k.let("K", 1 + ratio**2 + eta**2)
    a = k.let("a", (3 * K - square[0] - square[1] - square[2]) / (3 * ratio))
    Z_re = k.let("Z_re", (2 * square[1] - square[0] - square[2]) / (3 * ratio))
    Z_im = k.let("Z_im", (square[0] - square[2]) / (root3 * ratio))
    z = k.let("z", sp.sqrt(Z_re**2 + Z_im**2))
    cosine = k.let("cosine", select(z > 0, Z_re / select(z > 0, z, 1), 1))
    sine = k.let("sine", select(z > 0, Z_im / select(z > 0, z, 1), 0))
    c3 = k.let("c3", cosine * (4 * cosine**2 - 3))
    s3 = k.let("s3", sine * (3 - 4 * sine**2))
    base = k.let("base", 1 + 4 * eta**2)
    return a, eta, z, cosine, sine, c3, s3, k.let("beta", 4 * eta**2 / base), k.let("mu", z / base)


def sps_invariants():
    k = KernelBuilder(
        "sps_invariants",
        summary="Invariants of the rotation from the legs of a 3-SPS-S machine: A = r11 + r22, and Z.",
        source=SOURCE,
    )
    legs = k.input("legs", 3, unit="length", doc="lengths of the legs")
    a, *_ = said_by_legs(k, legs, *geometry(k))
    k.output("cos_sum", a, unit="1", doc="cos χx + cos χy")
    k.output(
        "Z",
        sp.Matrix([k["Z_re"], k["Z_im"]]),
        unit="1",
        doc="real and imaginary part of Z, over the base's radius",
    )
    return k.build()


def sps_octic():
    k = KernelBuilder(
        "sps_octic",
        summary="Coefficients of the octic whose roots are ρ = sin²(χz/2) of every assembly mode.",
        source=SOURCE,
        notes="With lengths in units of the base's radius; from ρ⁰ to ρ⁸. Near equal legs six roots crowd together: "
        "sps_octic_scaled does not.",
    )
    legs = k.input("legs", 3, unit="length", doc="lengths of the legs")
    a, eta, z, _, _, c3, s3, _, _ = said_by_legs(k, legs, *geometry(k))
    m = k.let("m", z**2)
    four, sixteen = k.let("k_rho", 4 + 16 * eta**2), k.let("sixteen", 16 * eta**2)
    y = [m, -sixteen, four]
    g = [sixteen**2 - 12 * m, -2 * four * sixteen, four**2]
    product = times(y, g)
    product[0] += 16 * m**2 - 32 * a * eta**2 * z**3 * c3
    bracket = [k.let(f"bracket_{n}", part) for n, part in enumerate(product)]
    octic = times(bracket, bracket)
    factor = k.let("factor", 1024 * eta**4 * z**6 * s3**2)
    for n, part in enumerate((4 - a**2, -8, 4)):
        octic[n] -= factor * part
    k.output("octic", sp.Matrix(octic), unit="1", doc="coefficients, of rising powers of ρ")
    return k.build()


def times(a, b):
    """Product of two polynomials, by coefficients."""
    product = [sp.S.Zero] * (len(a) + len(b) - 1)
    for i, p in enumerate(a):
        for j, q_j in enumerate(b):
            product[i + j] += p * q_j
    return product


LEAST_SLOPE = sp.Rational(1, 10**7)


def sps_octic_scaled():
    k = KernelBuilder(
        "sps_octic_scaled",
        summary="Coefficients of the octic of a 3-SPS-S machine, scaled so that equal legs are no special case.",
        source=SOURCE,
        notes="In x, with ρ = β + μ x. The leading coefficient goes to zero with z (two roots, the torsions, go to "
        "infinity); it is kept above (16e-7 β)², which moves the six others by 1e-7 at the most.",
    )
    legs = k.input("legs", 3, unit="length", doc="lengths of the legs")
    a, eta, z, _, _, c3, s3, beta, mu = said_by_legs(k, legs, *geometry(k))
    quartic = quartic_coefficients(a, eta, z, beta, mu, c3)
    least = k.let("least", LEAST_SLOPE * beta)
    quartic[4] = 16 * select(mu > least, mu, least)
    quartic = [k.let(f"b_{n}", part) for n, part in enumerate(quartic)]
    octic = times(quartic, quartic)
    for n, part in enumerate(remainder_coefficients(a, eta, beta, mu, s3)):
        octic[n] -= part
    k.output("octic", sp.Matrix(octic), unit="1", doc="coefficients, of rising powers of x")
    k.output(
        "quartic", sp.Matrix(quartic), unit="1", doc="the polynomial whose square the octic is where s3 = 0"
    )
    k.output("phase_sine", s3, unit="1", doc="sine of three times the phase of Z")
    k.output("size", z, unit="1", doc="|Z| over the base's radius")
    return k.build()


# %% [markdown]
# Back from a root to a rotation. Only phases are taken from the formulas and lengths from $\rho$, so that a root with
# few digits gives a rotation nonetheless, near enough for Newton's method.


# %%
def clipped(value, low, high):
    """A number brought between two others."""
    return select(value < low, low, select(value > high, high, value))


def root_of_unit(k, name, real, imaginary):
    """Square root of a complex number of unit length, with a real part that is not negative."""
    # the larger of the two parts first: no digits are lost at either end
    outer = k.let(f"{name}_outer", sp.sqrt((1 + abs(real)) / 2))
    inner = k.let(f"{name}_inner", abs(imaginary) / (2 * outer))
    re = k.let(f"{name}_re", select(real < 0, inner, outer))
    size = k.let(f"{name}_size", select(real < 0, outer, inner))
    return re, k.let(f"{name}_im", select(imaginary < 0, -size, size))


def sps_mode():
    k = KernelBuilder(
        "sps_mode",
        summary="Rotation of a 3-SPS-S machine from its legs and a root x of the scaled octic.",
        source=SOURCE,
        notes="One of the two signs makes the legs right, both where the octic is a square. The root may be rough: the "
        "result is a unit quaternion in any case.",
    )
    legs = k.input("legs", 3, unit="length", doc="lengths of the legs")
    lengths = geometry(k)
    root = k.input("root", unit="1", doc="root x of the scaled octic")
    sign = k.input("sign", unit="1", doc="1 or -1: side of Z on which w² is")
    _, eta, z, cosine, sine, _, _, beta, mu = said_by_legs(k, legs, *lengths)
    rho = k.let("rho", clipped(beta + mu * root, sp.S.Zero, sp.S.One))
    along = k.let(
        "along", clipped(root + select(rho > EPS**2, z / (4 * select(rho > EPS**2, rho, 1)), 0), -1, 1)
    )
    across = k.let("across", sign * sp.sqrt((1 - along) * (1 + along)))
    W_re = k.let("W_re", cosine * along - sine * across)
    W_im = k.let("W_im", sine * along + cosine * across)
    w_re, w_im = root_of_unit(k, "w", W_re, W_im)
    lift_re = k.let("lift_re", z * cosine - 2 * rho * W_re)
    lift_im = k.let("lift_im", z * sine - 2 * rho * W_im)
    v_re = k.let("v_re", lift_re * w_re - lift_im * w_im)
    v_im = k.let("v_im", lift_re * w_im + lift_im * w_re)
    length = k.let("v_length", sp.sqrt(v_re**2 + v_im**2))
    known = k.let("known", length > 0)
    factor = k.let(
        "v_factor",
        select(eta < 0, -1, 1) * sp.sqrt(1 - rho) / select(known, length, 1),
    )
    size = k.let("w_factor", sp.sqrt(rho))
    k.output(
        "quaternion",
        sp.Matrix(
            [select(known, factor * v_re, sp.sqrt(1 - rho)), size * w_re, size * w_im, factor * v_im],
        ),
        unit="1",
        doc="unit quaternion, scalar first",
    )
    return k.build()


# %% [markdown]
# Newton's method for the squares of the legs, on the rotation itself, within a radius of trust: a step is taken where
# it makes the squares better, and shortened fourfold where it does not. At a singular pose, where two modes meet, the
# step runs along the direction that the legs do not hold, and halves the distance each time. Where the squares are
# right to rounding nothing moves any more. Four steps a call.

# %%
STEPS = 4


def sps_polish():
    k = KernelBuilder(
        "sps_polish",
        summary="Four steps of Newton's method from a rotation of a 3-SPS-S machine towards one with the legs given.",
        source=SOURCE,
        notes="Within a radius of trust, so that it ends at a nearest point where there is no solution. Call it again, "
        "with its own results, until the miss is rounding or does not fall.",
    )
    quaternion = k.input("quaternion", 4, unit="1", doc="where to start, of any length, scalar first")
    trust = k.input("trust", unit="rad", doc="longest step")
    legs = k.input("legs", 3, unit="length", doc="lengths of the legs")
    R, r, h = geometry(k)
    # lengths in units of R: squares and products of six lengths stay numbers
    ratio, eta = k.let("ratio", r / R), k.let("eta", h / R)
    targets = [k.let(f"target_{n}", (leg / R) ** 2) for n, leg in enumerate(legs, 1)]
    bases = [u - sp.Matrix([0, 0, eta]) for u in direction_rows()]

    def look(quaternion, step):
        """Return half of the residuals of the squares, and the arms on the platform."""
        matrix = k.let(f"matrix_{step}", quaternion_matrix(quaternion))
        turned = [k.let(f"arm_{step}_{n}", matrix * (ratio * u)) for n, u in enumerate(direction_rows(), 1)]
        found = []
        for n, (base, arm) in enumerate(zip(bases, turned, strict=True)):
            span = k.let(f"span_{step}_{n + 1}", arm - base)
            found.append((targets[n] - span.dot(span)) / 2)
        missing = k.let(f"missing_{step}", sp.Matrix(found))
        return turned, missing, k.let(f"merit_{step}", missing.dot(missing))

    # where the squares are right to rounding there is nothing to decide by
    scale = k.let("scale", 1 + ratio**2 + eta**2 + sum(targets, sp.S.Zero) / 3)
    settled = k.let("settled", (4 * EPS * scale) ** 2)
    now = normalised(k, "start", quaternion)
    turned, missing, merit = look(now, "0")
    for step in range(1, STEPS + 1):
        rows = [
            k.let(f"row_{step}_{n}", base.cross(arm))
            for n, (base, arm) in enumerate(zip(bases, turned, strict=True), 1)
        ]
        crosses = [rows[1].cross(rows[2]), rows[2].cross(rows[0]), rows[0].cross(rows[1])]
        crosses = [k.let(f"cross_{step}_{n}", value) for n, value in enumerate(crosses, 1)]
        determinant = k.let(f"determinant_{step}", rows[0].dot(crosses[0]))
        solved = k.let(
            f"solved_{step}", sum((m * c_n for m, c_n in zip(missing, crosses, strict=True)), sp.zeros(3, 1))
        )
        size = k.let(f"solved_size_{step}", sp.sqrt(solved.dot(solved)))
        far = k.let(f"far_{step}", size > trust * abs(determinant))
        sign = select(determinant < 0, -1, 1)
        within = k.let(
            f"factor_{step}",
            select(far, sign * trust / select(size > 0, size, 1), 1 / select(far, 1, determinant)),
        )
        turn = k.let(f"turn_{step}", solved * select(size > 0, within, 0))
        scalar, vector = now[0], sp.Matrix(now[1:4])
        moved = k.let(
            f"moved_{step}",
            sp.Matrix([scalar - turn.dot(vector) / 2, *(vector + (scalar * turn + turn.cross(vector)) / 2)]),
        )
        moved = normalised(k, f"unit_{step}", moved)
        new_turned, new_missing, new_merit = look(moved, str(step))
        done = k.let(f"done_{step}", merit <= settled)
        better = k.let(f"better_{step}", sp.Not(done) & (new_merit < merit))
        now = k.let(f"now_{step}", select(better, moved, now))
        turned = [
            k.let(f"taken_{step}_{n}", select(better, a, b_n))
            for n, (a, b_n) in enumerate(zip(new_turned, turned, strict=True), 1)
        ]
        missing = k.let(f"left_{step}", select(better, new_missing, missing))
        merit = k.let(f"merit_taken_{step}", select(better, new_merit, merit))
        length = k.let(f"turned_by_{step}", sp.sqrt(turn.dot(turn)))
        shorter = select(length < trust, length, trust) / 4
        trust = k.let(f"trust_{step}", select(better, 2 * trust, select(done, trust, shorter)))
    k.output("polished", now, unit="1", doc="unit quaternion")
    k.output("radius", trust, unit="rad", doc="radius of trust to go on with")
    return k.build()


scaled_octic = sps_octic_scaled()
kernel_octic = sps_octic()

# %% [markdown]
# The functions compute these formulas. With the numbers that the legs give as letters, their coefficients are those of
# the octics: $O_k$ and $O_s$ are the polynomials with the coefficients of the functions, $O_1$ is the octic for $R=1$.

# %%
letters_of = kernel_octic.substitution(a=a_letter, eta=eta, z=z, c3=c3, s3=s3)
plain = kernel_octic.expand("octic", keep=letters_of).xreplace(letters_of)
kernel_in_rho = d.letter("kernel_octic | O_k | octic of sps_octic at ρ | 1", horner(list(plain), rho_letter))
octic_unit = d.letter(
    "octic_unit | O_1 | the octic for R = 1 | 1", octic_poly.as_expr().subs({**scaled, x_free: rho_letter})
)
d.check(
    "kernel-octic",
    equal(kernel_in_rho, octic_unit),
    text="The coefficients of `sps_octic` are those of the octic.",
).prove()

# %%
top = d.symbol("top", "t", "the quartic's leading coefficient", "1")
letters_of = scaled_octic.substitution(
    a=a_letter, eta=eta, z=z, c3=c3, s3=s3, b_4=top, beta=beta_letter, mu=mu_letter
)
shifted = scaled_octic.expand("octic", keep=letters_of)
kernel_in_x = d.letter(
    "kernel_scaled | O_s | octic of sps_octic_scaled at x | 1", horner(list(shifted.xreplace(letters_of)), x)
)
d.check(
    "kernel-scaled-octic",
    equal(kernel_in_x, quartic_letter**2 - taken_letter),
    text="The coefficients of `sps_octic_scaled` are those of $Q^2-T$. (Where the leading coefficient $t=16\\mu$ of "
    "$Q$ is nearly zero, the function keeps it away from zero.)",
).prove(given={top: 16 * mu})

# %%
derivation.kernel(
    sps_legs(),
    sps_legs_from_quaternion(),
    sps_jacobian(),
    sps_singularity(),
    sps_invariants(),
    scaled_octic,
    sps_mode(),
    sps_polish(),
)
