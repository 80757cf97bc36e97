"""Both angles with A cos θ + B sin θ + D = 0.

Every closed form of a mechanism ends in this equation. With r = √(A² + B²) and A = r cos γ, B = r sin γ it is
cos(θ - γ) = -D/r, so θ = γ ± h with cos h = -D/r: two angles where |D| < r, one where |D| = r, none where |D| > r.
Where A = B = 0 it holds for every angle or for none.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rodgen.generated.numpy.trig_equation import TrigStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel

__all__ = ["TrigStatus", "solve_trig"]


def solve_trig(
    A: ArrayLike, B: ArrayLike, D: ArrayLike, *, out: tuple[Any, Any] | None = None
) -> tuple[Any, Any]:
    """Return both angles with ``A cos(theta) + B sin(theta) + D = 0``.

    Parameters
    ----------
    A, B, D : array_like (...)
        Coefficients, in one unit.
    out : tuple of two arrays, optional
        Where the results go: (..., 2) and (...) int8.

    Returns
    -------
    theta : array (..., 2)
        The angles γ + h and γ - h in rad, from -π to π, where γ is the angle of (A, B) and h is between 0 and π: so
        each moves continuously with the coefficients. NaN where, and only where, the status is neither TWO nor DOUBLE.
    status : array (...) of int8
        Codes of :class:`TrigStatus`.

    Raises
    ------
    ValueError
        When shapes do not broadcast.
    TypeError
        When a coefficient is not real.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Solve A c + B s + D = 0", by the angle of (A, B); derivation
    ``trig_equation``. With g = √(1 - D²/r²) an angle is right to about 2ε/g, where ε is the machine epsilon: near g =
    0, where two angles meet, every method loses as much. DOUBLE is where g² is not above 4ε.

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
