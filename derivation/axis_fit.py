# %% [markdown]
# # One axis from many pairs: the likelihood is a quadratic on the sphere
#
# Points of a body are measured at $\vec\rho_i$ before and at $\vec\rho\,'_i$ after rotations by the known
# angles $\chi_i$ about one axis: the unit vector $\vec e$ through the point $\vec p$. Both readings of a
# pair carry noise, independent and of the same standard deviation $\sigma_i$ in every coordinate. What is the most
# likely axis?
#
# A rotation $R(\vec e,\chi)$ about the axis takes a point to $\vec p+R(\vec e,\chi)(\vec\rho_i-\vec p)$, so a pair
# misses the axis by the residual $\vec d_i=\vec\rho\,'_i-\vec p-R(\vec e,\chi_i)(\vec\rho_i-\vec p)$. A rotation
# turns isotropic noise into isotropic noise, so $\vec d_i$ has the covariance $2\sigma_i^2 I$ for every axis, and the
# most likely axis minimises $\frac12\sum w_i|\vec d_i|^2$ with weights $w_i$ proportional to $1/\sigma_i^2$.
#
# This looks like a nonlinear problem with four unknowns. It is not. For a known point the sum is a quadratic in $\vec
# e$. A free point drops out in closed form, **and what remains is a quadratic in $\vec e$ again**. Its minimum on the
# unit sphere is one symmetric eigenproblem and one root: there is no starting value to choose and no local minimum to
# fall into. `rodgen.fit_axis` works that way. The last section gives the uncertainty of the axis.

# %%
import sympy as sp

from rodgen.symbolic import Derivation, cross, dot, equal, norm, rodrigues

d = derivation = Derivation(
    "axis_fit",
    title="One axis from many pairs: the likelihood is a quadratic on the sphere",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
    kernels_in="those of the solver: 'rodgen kernels axis'",
)

# %% [markdown]
# ## Symbols
#
# The formulas below are for one pair, and its index is left out: $\vec x=\vec\rho_i-\vec p$ and
# $\vec y=\vec\rho\,'_i-\vec p$. Sine and versine of the angle are rational functions of $t=\tan\frac\chi2$, so that
# all proofs are proofs about polynomials. $(\vec a,\vec b)$ is the scalar product. Sums are over all pairs.

# %%
t = d.symbol("t", r"t", "tan(χ/2)", "1")
s = d.symbol("s", r"s", "sin χ = 2t/(1 + t²)", "1", value=2 * t / (1 + t**2))
kappa = d.symbol("kappa", r"\kappa", "1 − cos χ = 2t²/(1 + t²)", "1", value=2 * t**2 / (1 + t**2))
e = d.vector("e", r"\vec e", "unit vector of the axis", "1")
x = d.vector("x", r"\vec x", "point before the rotation", "length")
y = d.vector("y", r"\vec y", "point after the rotation", "length")
r = d.vector("r", r"\vec r", "difference of the two, y − x", "length", value=y - x)
m = d.vector("m", r"\vec m", "sum of the two, y + x", "length", value=y + x)
q = d.vector("q", r"\vec q", "point on the axis", "length")
M = d.vector("M", r"\vec M", "sum of w κ m over all pairs, w the weight", "length")
S = d.vector("S", r"\vec S", "sum of w s r over all pairs", "length")
D = d.symbol("D", r"D", "sum of 2 w κ over all pairs", "1", positive=True)
unit = {e.components[2]: dot(e, e) - 1}
d

# %% [markdown]
# ## The rotation
#
# With sine and versine of the angle, Rodrigues' formula for a unit axis is
# $R\vec x=\vec x+s\,\vec e\times\vec x+\kappa\,\vec e\times(\vec e\times\vec x)$.


# %%
def turned(v):
    """Rodrigues' formula for a unit axis."""
    return v + s * cross(e, v) + kappa * cross(e, cross(e, v))


d.check(
    "turned",
    equal(turned(x), rodrigues(x, 2 * t * e)),
    text="This is the rotation with the Rodrigues vector 2t e, eq. (1) of the paper.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="For a unit axis the denominator of eq. (1) is 1 + t²; over it, 2t is the factor s and 2t² the factor κ.",
)

# %% [markdown]
# ## A known point
#
# Let the point be known, and take it as the origin. Then half the squared residual of a pair is quadratic in the axis:

# %%
d.check(
    "half-square",
    equal(
        norm(y - turned(x)) ** 2 / 2,
        (norm(x) ** 2 + norm(y) ** 2) / 2
        - (1 - kappa) * dot(x, y)
        - (kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y))),
    ),
    text="Only the last bracket depends on the axis.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="A rotation keeps lengths, so the left side is (|x|² + |y|²)/2 − (y, Rx). In the last product "
    "e × (e × x) = (e, x) e − x for a unit vector.",
)

# %% [markdown]
# Summed over the pairs with their weights, the sum to be minimised is a constant less
# $(\vec e, A\vec e)+(\vec b,\vec e)$ with the symmetric matrix
# $A=\sum w\kappa\,\frac12(\vec x\vec y^T+\vec y\vec x^T)$ and the vector $\vec b=\sum ws\,\vec x\times\vec y$.
#
# In numbers $\vec x\times\vec y$ cancels where the angle is small, because the two points nearly agree there. The
# difference $\vec r=\vec y-\vec x$ of two nearly equal numbers is exact, and serves as well:

# %%
d.check(
    "no-cancellation",
    equal(cross(x, y), cross(x, r)),
    text="The cross product, without cancellation.",
).prove(because="r = y − x, and x × x = 0.")

# %% [markdown]
# ## A free point
#
# Now let the axis pass through an unknown point $\vec q$. The residual changes by $\vec q-R\vec q$:

# %%
d.check(
    "with-point",
    equal(y - q - turned(x - q), (y - turned(x)) - (q - turned(q))),
    text="The residual with a point on the axis.",
).prove(because="A rotation is linear.")

# %% [markdown]
# How strongly a pair determines the point is the square of that change. It is the same for
# every pair up to the factor $2\kappa=4\sin^2\frac\chi2$, and this is what makes the elimination possible.

# %%
d.check(
    "point-information",
    equal(norm(q - turned(q)) ** 2, 2 * kappa * (norm(q) ** 2 - dot(e, q) ** 2)),
    text="A shift across the axis changes the residual by 2 sin(χ/2) times its length; a shift along it, not at all.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="The chord of a circle of radius |q − (e, q) e| that subtends the angle χ; in components, with s² = 2κ − "
    "κ².",
)

# %% [markdown]
# In the square of the whole residual the point is multiplied by the residual without it:

# %%
d.check(
    "point-score",
    equal(dot(q - turned(q), y - turned(x)), dot(q, kappa * (m - dot(e, m) * e) + s * cross(e, r))),
    text="The product of the change with the residual without the point.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="(q, y − Rx) − (Rq, y) + (q, x), because a rotation keeps the scalar product of q with x; then "
    "Rodrigues' formula for both rotated vectors.",
)

# %% [markdown]
# Summed with weights, a point adds $-(\vec q,\vec g)+\frac D2\left(|\vec q|^2-(\vec e,\vec q)^2\right)$ to
# the half squares, where
#
# $$\vec g=\vec M-(\vec e,\vec M)\,\vec e+\vec e\times\vec S.$$
#
# This sum is completed to a square. As $\vec g$ is perpendicular to the axis, the square can be made zero.

# %%
g = M - dot(e, M) * e + cross(e, S)
d.check("across", equal(dot(e, g), 0), text="g is perpendicular to the axis.").prove(
    modulo=unit,
    because="(e, M) (1 − |e|²) = 0, and e × S is perpendicular to e.",
)

# %%
across = q - dot(e, q) * e
d.check(
    "completed-square",
    equal(
        -dot(q, g) + D / 2 * (norm(q) ** 2 - dot(e, q) ** 2),
        D / 2 * norm(across - g / D) ** 2 - norm(g) ** 2 / (2 * D),
    ),
    text="The first term on the right is never negative, and vanishes at the best point. The second is what the free "
    "point gains.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="|q|² − (e, q)² is the square of q − (e, q) e, and (q − (e, q) e, g) = (q, g), because g is "
    "perpendicular to the axis.",
)

# %% [markdown]
# So the best point is $\vec q=\vec g/D$, or any other point on the axis through it. What it gains is, once more, a
# quadratic in the axis:

# %%
d.check(
    "gain",
    equal(
        norm(g) ** 2,
        norm(M) ** 2 + norm(S) ** 2 - dot(e, M) ** 2 - dot(e, S) ** 2 + 2 * dot(e, cross(S, M)),
    ),
    text="The gain, times 2D.",
    assumptions=[equal(norm(e), 1)],
).prove(
    modulo=unit,
    because="The two parts of g have the squares |M|² − (e, M)² and |S|² − (e, S)², and the product (M, e × S) = (e, "
    "S × M).",
)

# %% [markdown]
# Hence with a free point the sum to be minimised is a constant less $(\vec e, A'\vec e)+(\vec b',\vec e)$ with
#
# $$A'=A-\frac{\vec M\vec M^T+\vec S\vec S^T}{2D},\qquad \vec b'=\vec b+\frac{\vec S\times\vec M}{D}.$$
#
# With the origin at $\sum w\kappa\,\vec m/D$ the sum $\vec M$ vanishes, and nothing cancels however far the
# points are from the origin.
#
# ## The minimum on the sphere
#
# The best unit axis is stationary on the sphere: $2A\vec e+\vec b=2\mu\vec e$ with a multiplier $\mu$, that is,
# $2\mu=2(\vec e,A\vec e)+(\vec b,\vec e)$. How sharp is the minimum? Turn the axis by the angle $\varphi$ towards a
# unit vector $\vec u\perp\vec e$, that is, to $\cos\varphi\,\vec e+\sin\varphi\,\vec u$. The second derivative of the
# sum there, its curvature, is $2(\mu-(\vec u,A\vec u))$:

# %%
u = d.vector("u", r"\vec u", "unit vector perpendicular to the axis", "1")
phi = d.symbol("phi", r"\varphi", "angle by which the axis is turned towards u", "rad")
turning = {e: sp.Matrix([0, 0, sp.cos(phi)]) + sp.Matrix([sp.sin(phi), 0, 0])}
quadratic = kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y))
curvature = d.letter(
    r"curvature | \left.\frac{\mathrm{d}^2}{\mathrm{d}\varphi^2}\,\tfrac12|\vec d|^2\right|_{\varphi=0} | "
    r"curvature of the half square of a pair | length²",
    sp.diff(-d.value(quadratic, turning), phi, 2).subs(phi, 0),
)
frame = {e: (0, 0, 1), u: (1, 0, 0)}
d.check(
    "curvature",
    equal(
        curvature,
        2 * kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y)) - 2 * kappa * dot(u, x) * dot(u, y),
    ),
    text="The curvature for one pair: its share of 2μ − 2 (u, A u).",
    assumptions=["e along Oz, u along Ox; both sides turn with the frame"],
).prove(
    given=frame,
    because="In the half square, e occurs in −κ (e, x)(e, y) − s (e, x × y). With cos φ e + sin φ u for e, the "
    "second derivative of cos²φ at 0 is −2, that of sin²φ is 2, that of cos φ is −1, and those of sin φ and of sin φ "
    "cos φ vanish.",
)

# %% [markdown]
# The curvature is the information $H$ on a turn of the axis. It is free of the bias that squares of
# noisy readings have, because it has products of $\vec x$ with $\vec y$ only.
#
# ## How uncertain the axis is
#
# The score of the axis along $\vec u$ is $-\sum w\,(\partial_uR\,\vec x,\vec d)$, where $\partial_uR$ is the
# derivative of the rotation as the axis turns towards $\vec u$. The noise $\vec n$ of $\vec x$ is in both factors,
# once as $\partial_uR\,\vec n$ and once as $-R\vec n$. Were the two not perpendicular to each other, their product
# would have a mean, and the axis a bias.

# %%
n = d.vector("n", r"\vec n", "noise of the point before the rotation", "length")


def turned_by_error(v):
    """Derivative of the rotated vector when the axis turns towards u."""
    return s * cross(u, v) + kappa * (cross(u, cross(e, v)) + cross(e, cross(u, v)))


d.check(
    "no-bias",
    equal(dot(turned_by_error(n), turned(n)), 0),
    text="The derivative of a rotated vector, and the rotated vector, are perpendicular. There is no bias.",
    assumptions=["e along Oz, u along Ox; both sides turn with the frame"],
).prove(
    given=frame,
    because="The length of Rn does not depend on the axis, so the derivative of |Rn|², twice the product, is zero.",
)

# %% [markdown]
# What remains in second order is $(\partial_uR\,\vec n,\vec n')$ with
# the noise $\vec n'$ of $\vec y$. Its variance is $\sigma^4\,\|\partial_uR\|^2$, where $\|\cdot\|^2$ is the sum of the
# squares of all nine elements:

# %%
columns = [d.value(turned_by_error(n), {**frame, n: tuple(int(i == j) for i in range(3))}) for j in range(3)]
squares = d.letter(
    r"squares | \left\|\partial_u R\right\|^2 | sum of the squares of the elements of the derivative | 1",
    sum(sum(c**2 for c in column) for column in columns),
)
d.check(
    "second-order",
    equal(squares, 4 * kappa),
    text="The sum of the squares of all nine elements of the derivative.",
    assumptions=["e along Oz, u along Ox; both sides turn with the frame"],
).prove(because="The columns are the derivatives of the three rotated unit vectors; s² = 2κ − κ².")

# %% [markdown]
# With $w=1/(2\sigma^2)$ each pair therefore adds $\kappa$ to the variance of the score, and the covariance of the axis
# becomes $H^{-1}(H+\sum\kappa\,I)H^{-1}$. The addition matters where the points lie within some $\sigma$ of the
# axis. Without it pairs of pure noise would seem to determine an axis.
