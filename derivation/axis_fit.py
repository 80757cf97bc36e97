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
# # One axis from many pairs: the likelihood is a quadratic on the sphere
#
# Points of a body are seen at $\vec\rho_i$ before and at $\vec\rho\,'_i$ after rotations by the known
# angles $\chi_i$ about one axis: the unit vector $\vec e$ through the point $\vec p$. Both readings of a
# pair carry noise, equal and independent in every coordinate. What is the most likely axis?
#
# A pair misses the axis by $\vec d_i=\vec\rho\,'_i-\vec p-R(\vec e,\chi_i)(\vec\rho_i-\vec p)$. A
# rotation turns isotropic noise into isotropic noise, so $\vec d_i$ has the covariance $2\sigma^2 I$ for
# every axis, and the most likely axis minimises $\frac12\sum w_i|\vec d_i|^2$ with $w_i\sim1/\sigma_i^2$.
#
# This looks like a nonlinear problem for four parameters. It is not. For a known point the sum is a
# quadratic in $\vec e$; a free point drops out in closed form, **and what remains is a quadratic in $\vec
# e$ again**. Its minimum on the unit sphere is one symmetric eigenproblem and one root: nothing to start
# from, no local minimum to fall into. `rodgen.fit_axis` works that way.

# %%
import sympy as sp

from rodgen.symbolic import Derivation, cross, dot, equal, norm, rodrigues

derivation = Derivation(
    "axis_fit",
    title="One axis from many pairs: the likelihood is a quadratic on the sphere",
    source='Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric '
    'Accuracy of Multi-Coordinate Systems", eq. (1)',
)
d = derivation

# %% [markdown]
# ## Symbols
#
# The index of the pair is left out. With $t=\tan\frac\chi2$ sine and versine are rational.

# %%
t = d.symbol("t", r"t", "tan(χ/2)", "1")
s = d.symbol("s", r"s", "sin χ", "1", value=2 * t / (1 + t**2))
kappa = d.symbol("kappa", r"\kappa", "1 - cos χ", "1", value=2 * t**2 / (1 + t**2))
e = d.vector("e", r"\vec e", "unit axis", "1")
x = d.vector("x", r"\vec x", "point before the rotation", "length")
y = d.vector("y", r"\vec y", "point after the rotation", "length")
r = d.vector("r", r"\vec r", "difference of the two", "length", value=y - x)
m = d.vector("m", r"\vec m", "sum of the two", "length", value=y + x)
q = d.vector("q", r"\vec q", "point on the axis", "length")
M = d.vector("M", r"\vec M", "sum of w κ m over all pairs", "length")
S = d.vector("S", r"\vec S", "sum of w s r over all pairs", "length")
D = d.symbol("D", r"D", "sum of 2 w κ over all pairs", "1", positive=True)
unit = {e.components[2]: dot(e, e) - 1}
d


# %%
def turned(v):
    """Rodrigues' formula for a unit axis."""
    return v + s * cross(e, v) + kappa * cross(e, cross(e, v))


d.check("turned", equal(turned(x), rodrigues(x, 2 * t * e)), text="The rotation, by sine and versine.").prove(
    modulo=unit
)

# %% [markdown]
# ## A known point
#
# Take it as the origin. Summed over the pairs with their weights, the right side is a constant less
# $\vec e\cdot A\vec e+\vec b\cdot\vec e$ with $A=\sum w\kappa\,\frac12(\vec x\vec y^T+\vec y\vec x^T)$ and
# $\vec b=\sum ws\,\vec x\times\vec y$.

# %%
d.check(
    "half-square",
    equal(
        norm(y - turned(x)) ** 2 / 2,
        (norm(x) ** 2 + norm(y) ** 2) / 2
        - (1 - kappa) * dot(x, y)
        - (kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y))),
    ),
    text="Half the squared residual of a pair is quadratic in the axis.",
).prove(modulo=unit)
d.check(
    "no-cancellation",
    equal(cross(x, y), cross(x, r)),
    text="The form used in the sums: at small angles the points nearly agree, and their difference is exact.",
).prove()

# %% [markdown]
# ## A free point
#
# A point $\vec q$ on the axis changes the residual by $\vec q-R\vec q$, linearly. Its normal matrix is
# $2\kappa(I-\vec e\vec e^T)$: the same for every pair up to the factor. That is what makes the elimination
# possible.

# %%
d.check(
    "with-point",
    equal(y - q - turned(x - q), (y - turned(x)) - (q - turned(q))),
    text="The residual with a point on the axis.",
).prove()
d.check(
    "point-information",
    equal(norm(q - turned(q)) ** 2, 2 * kappa * (norm(q) ** 2 - dot(e, q) ** 2)),
    text="A shift across the axis is seen 2 sin(χ/2) times its length; a shift along it is not seen.",
).prove(modulo=unit)
d.check(
    "point-score",
    equal(dot(q - turned(q), y - turned(x)), dot(q, kappa * (m - dot(e, m) * e) + s * cross(e, r))),
    text="The product of the shift with the residual without it.",
).prove(modulo=unit)

# %% [markdown]
# Summed with weights, the point adds $-\vec q\cdot\vec g+\frac D2(|\vec q|^2-(\vec e\cdot\vec q)^2)$ to
# the half squares, with $\vec g=\vec M-(\vec e\cdot\vec M)\vec e+\vec e\times\vec S$. It is least for
# $\vec q=\vec g/D$, and for every point that lies along the axis from there.

# %%
g = M - dot(e, M) * e + cross(e, S)
across = q - dot(e, q) * e
d.check("across", equal(dot(e, g), 0), text="g is square to the axis.").prove(modulo=unit)
d.check(
    "completed-square",
    equal(
        -dot(q, g) + D / 2 * (norm(q) ** 2 - dot(e, q) ** 2),
        D / 2 * norm(across - g / D) ** 2 - norm(g) ** 2 / (2 * D),
    ),
    text="The first term is never negative, and vanishes at the best point; the second is the gain.",
).prove(modulo=unit)
d.check(
    "gain",
    equal(
        norm(g) ** 2,
        norm(M) ** 2 + norm(S) ** 2 - dot(e, M) ** 2 - dot(e, S) ** 2 + 2 * dot(e, cross(S, M)),
    ),
    text="The gain is quadratic in the axis.",
).prove(modulo=unit)

# %% [markdown]
# Hence with a free point
#
# $$A'=A-\frac{\vec M\vec M^T+\vec S\vec S^T}{2D},\qquad \vec b'=\vec b+\frac{\vec S\times\vec M}{D}.$$
#
# With the origin at $\sum w\kappa\,\vec m/D$ the sum $\vec M$ vanishes, and nothing cancels however far the
# points are from the origin.
#
# ## On the sphere
#
# A stationary axis obeys $2A\vec e+\vec b=2\mu\vec e$, so $2\mu=2\,\vec e\cdot A\vec e+\vec b\cdot\vec e$.
# Let the axis turn by $\varphi$ towards $\vec u\perp\vec e$. The curvature of the sum there,
# $2(\mu-\vec u\cdot A\vec u)$, is the information on that turn; it is free of the bias that squares of
# noisy readings have, because it has products of $\vec x$ with $\vec y$ only.

# %%
u = d.vector("u", r"\vec u", "unit vector perpendicular to the axis", "1")
phi = d.symbol("phi", r"\varphi", "angle by which the axis is turned towards u", "rad")
turning = {e: sp.Matrix([0, 0, sp.cos(phi)]) + sp.Matrix([sp.sin(phi), 0, 0])}
quadratic = kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y))
along = d.value(quadratic, turning)
two_mu = d.value(2 * kappa * dot(e, x) * dot(e, y) + s * dot(e, cross(x, y)), {e: (0, 0, 1)})
u_A_u = d.value(kappa * dot(u, x) * dot(u, y), {u: (1, 0, 0)})
d.check(
    "curvature",
    equal(sp.diff(-along, phi, 2).subs(phi, 0), two_mu - 2 * u_A_u),
    text="In the basis (u, v, e), for the half square of a pair.",
).prove()

# %% [markdown]
# ## How uncertain the axis is
#
# The score of the axis along $\vec u$ is $-\sum w\,(\partial_uR\,\vec x)\cdot\vec d$. The noise $\vec n$
# of $\vec x$ is in both factors, once as $\partial_uR\,\vec n$ and once as $-R\vec n$. These two are
# perpendicular to each other: no bias. The remaining second-order term is $(\partial_uR\,\vec n)\cdot\vec n'$ with
# the noise of $\vec y$; its variance is $\sigma^4\,\|\partial_uR\|^2=4\kappa\,\sigma^4$. With
# $w=1/(2\sigma^2)$ it adds $\kappa$ to the variance of the score, and the covariance becomes
# $H^{-1}(H+\sum\kappa\,I)H^{-1}$. The addition matters where the points lie within some $\sigma$ of the
# axis. Without it pairs of pure noise would claim an axis.

# %%
n = d.vector("n", r"\vec n", "noise of the point before the rotation", "length")
frame = {e: (0, 0, 1), u: (1, 0, 0)}


def turned_by_error(v):
    """Derivative of the rotated vector when the axis turns towards u."""
    return s * cross(u, v) + kappa * (cross(u, cross(e, v)) + cross(e, cross(u, v)))


d.check(
    "no-bias",
    equal(dot(turned_by_error(n), turned(n)), 0),
    text="A rotation changes by a turn: its derivative is perpendicular to its value.",
).prove(given=frame)
columns = [d.value(turned_by_error(n), {**frame, n: tuple(int(i == j) for i in range(3))}) for j in range(3)]
d.check(
    "second-order",
    equal(sum(sum(c**2 for c in column) for column in columns), 4 * kappa),
    text="The sum of the squares of all nine elements of the derivative.",
).prove()
