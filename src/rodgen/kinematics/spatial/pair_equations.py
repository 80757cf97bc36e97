"""All common solutions of two equations in two angles, each linear in (1, cos θ1, sin θ1) and in (1, cos θ2, sin θ2).

The equations are Σ M_e,ij u_i v_j = 0 for e = 1, 2 with u = (1, cos θ1, sin θ1), v = (1, cos θ2, sin θ2). In the
tangents of the half angles these are Crane and Duffy's two biquadratics, with no more than eight common solutions
unless they have a common factor. In angles no solution is at infinity: θ = π is one like every other.

The usual rows are solved fast, with a proof that nothing is missing. Where that proof fails, the roles of the two
angles are exchanged; where it fails again, eigenvalues give starts, and two tests tell whether solutions are missing.

One equation in one angle, A cos θ + B sin θ + D = 0, ends every closed form of a mechanism. With r = √(A² + B²) and
A = r cos γ, B = r sin γ it is cos(θ - γ) = -D/r, so θ = γ ± h with cos h = -D/r: two angles where |D| < r, one where
|D| = r, none where |D| > r. Where A = B = 0 it holds for every angle or for none.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy.trig_equation import trig_solve
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by
from rodgen.kinematics.spatial.pair_roots import HALF, grid, starts, with_common_factor
from rodgen.kinematics.spatial.pair_solutions import SLOTS, certain_solutions, collected, consistent
from rodgen.kinematics.spatial.status import ReverseStatus
from rodgen.views import with_html


@documented_by(trig_solve)
def solve_trig(
    A: ArrayLike, B: ArrayLike, D: ArrayLike, *, out: tuple[Any, Any] | None = None
) -> tuple[Any, Any]:
    """Return both angles with ``A cos(theta) + B sin(theta) + D = 0``.

    Parameters
    ----------
    out : tuple of two arrays, optional
        Where the results go: (..., 2) and (...) int8.

    Returns
    -------
    theta
        Here γ is the angle of (A, B) and h is between 0 and π: so each moves continuously with the coefficients. NaN
        where, and only where, the status is neither TWO nor DOUBLE.

    Notes
    -----
    The lecture notes are after Crane and Duffy, "Solve A c + B s + D = 0", by the angle of (A, B). With g = √(1 -
    D²/r²) an angle is right to about 2ε/g, where ε is the machine epsilon: near g = 0, where two angles meet, every
    method loses as much. DOUBLE is where g² is not above 4ε.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> theta, status = spatial.solve_trig(1.0, 0.0, [0.0, -1.0, -2.0])
    >>> np.degrees(theta)
    array([[ 90., -90.],
           [  0.,   0.],
           [ nan,  nan]])
    >>> [spatial.TrigStatus(s).name for s in status]
    ['TWO', 'DOUBLE', 'INFEASIBLE']
    """
    return call_kernel(kernels.trig_solve, (A, B, D), out)  # type: ignore[no-any-return]


COMMON = 1e-13
"""Distance of Sylvester's matrix from being singular everywhere, relative, below which it is: rounding leaves 1e-16
to 1e-15."""
DEPENDENT = 1e13
"""By how much the second equation shrinks when it is made perpendicular to the first, from where on it is the same."""


@with_html
class Pair(NamedTuple):
    """Solutions of two equations in two angles: theta1, theta2 and status, each (..., 8)."""

    theta1: Any
    theta2: Any
    status: Any


def pair_from_biquadratics(E: ArrayLike) -> Any:
    """Return two biquadratics in the form that :func:`solve_pair` takes.

    Parameters
    ----------
    E : array_like (..., 2, 3, 3)
        Coefficients: equation, power of x2 = tan(theta2/2), power of x1 = tan(theta1/2), powers ascending.

    Returns
    -------
    M : array (..., 2, 3, 3)
        The same equations divided by (1 + x1²)(1 + x2²).

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> E = np.zeros((2, 3, 3))
    >>> E[0, 0] = E[0, 2] = [-1, 0, 1]  # (x1² - 1)(1 + x2²) = 0
    >>> E[1, 1] = [-2, 1, 0]  # (x1 - 2) x2 = 0: x2 is 0, or infinite, since x2² is not there
    >>> pair = spatial.solve_pair(spatial.pair_from_biquadratics(E))
    >>> np.degrees(pair.theta1[:4]).round(9), np.degrees(pair.theta2[:4]).round(9) + 0.0
    (array([-90., -90.,  90.,  90.]), array([  0., 180.,   0., 180.]))
    """
    matrices = real_array("E", E, (2, 3, 3))
    back = np.linalg.inv(HALF)
    return np.einsum("jb,ia,...ba->...ij", back, back, matrices)


def solve_pair(M: ArrayLike, *, method: Literal["fast", "sylvester"] = "fast") -> Pair:
    """Return every pair of real angles that solves two equations.

    Parameters
    ----------
    M : array_like (..., 2, 3, 3)
        Equation e is ``sum(M[e, i, j] * u[i] * v[j]) = 0`` with u = (1, cos theta1, sin theta1) and
        v = (1, cos theta2, sin theta2). Each has its own unit.
    method : {"fast", "sylvester"}, optional
        How the starts are found. The first takes eigenvalues of Sylvester's matrix only where it is in doubt; the other
        always. A solution is accepted by the same test for both.

    Returns
    -------
    Pair
        theta1, theta2 in rad, from -π to π, and status, each (..., 8). Solutions come first, in the order of theta1,
        and then of theta2; NaN after them. Two solutions may have one angle in common.

    Raises
    ------
    ValueError
        When the last axes are not (2, 3, 3), or there is no such method.
    TypeError
        When a coefficient is not real.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Sylvester's Method"; proved in the derivation
    ``biquadratic_pair``, with "Bezout's Method", whose determinant is the same octic. A regular solution is one by
    Kantorovich's theorem, with rounding taken into account, and is right to about its condition number times the
    machine epsilon. With "fast" and where it is not in doubt, that there are no others is proved, too; elsewhere two
    necessary conditions are tested, and a row of which one fails has INCOMPLETE in its empty slots.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> M = np.zeros((2, 3, 3))
    >>> M[0, 1, 0], M[0, 0, 1] = 1.0, 1.0               # cos theta1 + cos theta2 = 0
    >>> M[1, 2, 0], M[1, 0, 2], M[1, 0, 0] = 1.0, 1.0, -1.0   # sin theta1 + sin theta2 = 1
    >>> pair = spatial.solve_pair(M)
    >>> np.degrees(pair.theta1[:3]).round(9), np.degrees(pair.theta2[:3]).round(9)
    (array([ 30., 150.,  nan]), array([150.,  30.,  nan]))
    >>> [spatial.ReverseStatus(s).name for s in pair.status[:3]]
    ['REGULAR', 'REGULAR', 'NONE']
    """
    if method not in ("fast", "sylvester"):
        raise ValueError(f"method is {method!r}; expected 'fast' or 'sylvester'")
    matrices = real_array("M", M, (2, 3, 3))
    flat = matrices.reshape(-1, 2, 3, 3)
    one, two, loss = kernels.pair_prepared(flat[:, 0], flat[:, 1])
    angles = np.full((len(flat), SLOTS, 2), np.nan)
    status = np.full((len(flat), SLOTS), ReverseStatus.INVALID, np.int8)
    valid = np.isfinite(one[:, 0, 0])
    left = np.flatnonzero(valid)
    shape = (*matrices.shape[:-3], SLOTS)
    if method == "fast":
        for exchanged in (False, True):
            if len(left):
                left = _fast(one, two, loss, left, exchanged, angles, status)
    if len(left):
        prepared = np.stack([one[left], two[left]], axis=1)
        angles[left], status[left] = _by_eigenvalues(prepared, loss[left])
    return Pair(angles[..., 0].reshape(shape), angles[..., 1].reshape(shape), status.reshape(shape))


def _fast(one: Any, two: Any, loss: Any, rows: Any, exchanged: bool, angles: Any, status: Any) -> Any:
    """Fill in the certain solutions of `rows`; return the other rows."""
    a, b = one[rows], two[rows]
    if exchanged:
        a, b = a.swapaxes(-1, -2), b.swapaxes(-1, -2)
    solutions, certain = certain_solutions(a, b, loss[rows])
    if exchanged:
        solutions = solutions[..., ::-1]
        order = np.argsort(solutions[..., 0], axis=-1, kind="stable")
        solutions = np.take_along_axis(solutions, order[..., None], axis=1)
    done = rows[certain]
    angles[done] = solutions[certain]
    status[done] = np.where(np.isnan(solutions[certain, :, 0]), ReverseStatus.NONE, ReverseStatus.REGULAR)
    return rows[~certain]


def _by_eigenvalues(M: Any, loss: Any) -> tuple[Any, Any]:
    """Return the solutions of prepared equations (n, 2, 3, 3): angles (n, 8, 2), statuses (n, 8)."""
    first, alone, distance = starts(M)
    common = (distance <= COMMON) | (loss >= DEPENDENT)
    angles, status = (
        np.full((len(M), SLOTS, 2), np.nan),
        np.full((len(M), SLOTS), ReverseStatus.NONE, np.int8),
    )
    usual = np.flatnonzero(~common)
    if len(usual):
        angles[usual], status[usual] = _from_starts(M[usual], loss[usual], first[usual], alone[usual])
    for row in np.flatnonzero(common):
        # a dependent equation is rounding once the other is taken off, and an equation that is zero determines nothing
        some = M[row, 0] if M[row, 0].any() else M[row, 1]
        pair = np.stack([some, some]) if loss[row] >= DEPENDENT else M[row]
        angles[row], status[row] = with_common_factor(pair)
    return angles, status


def _from_starts(M: Any, loss: Any, first: Any, alone: Any) -> tuple[Any, Any]:
    """Return solutions of equations without a common factor, from starts (n, m, 2) and more where some are missing."""
    angles, status = collected(M, loss, first)
    flawed = np.flatnonzero(~consistent(M, angles, status, alone))
    if len(flawed):
        transposed, _, _ = starts(M[flawed].swapaxes(-1, -2))
        more = np.concatenate([first[flawed], transposed[..., ::-1], grid(len(flawed))], axis=1)
        angles[flawed], status[flawed] = collected(M[flawed], loss[flawed], more)
        still = flawed[~consistent(M[flawed], angles[flawed], status[flawed], alone[flawed])]
        status[still] = np.where(status[still] == ReverseStatus.NONE, ReverseStatus.INCOMPLETE, status[still])
    return angles, status
