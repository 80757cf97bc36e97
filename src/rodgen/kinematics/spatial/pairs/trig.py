"""The angle in A cos θ + B sin θ + D = 0.

Problem: every closed form of a mechanism ends in this equation. With r = √(A² + B²) and A = r cos γ, B = r sin γ it is
cos(θ - γ) = -D/r, so θ = γ ± h with cos h = -D/r: two angles where |D| < r, one where |D| = r, none where |D| > r.
Where A = B = 0 it holds for every angle or for none.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy.trig_equation import TrigStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.broadcasting import call

__all__ = ["TrigStatus", "solve_trig"]


def solve_trig(
    A: ArrayLike,
    B: ArrayLike,
    D: ArrayLike,
    method: Literal["trig", "half_angle"] = "trig",
    *,
    out: tuple[Any, Any] | None = None,
) -> tuple[Any, Any]:
    """Find both angles with ``A cos(theta) + B sin(theta) + D = 0``.

    Parameters
    ----------
    A, B, D : array_like (...)
        Coefficients, in one unit.
    method : {"trig", "half_angle"}, optional
        By the angle of (A, B), or by the tangent of half the angle sought. The second is written without a
        cancellation and without a division, so both are right to rounding; they are here to be compared.
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
        When shapes do not broadcast, or there is no such method.
    TypeError
        When a coefficient is not real.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Solve A c + B s + D = 0", both methods; proved in the
    derivation ``trig_equation``. With g = √(1 - D²/r²) an angle is right to about 2/g rounding units: near g = 0, where
    two angles meet, every method loses as much. DOUBLE is where g² is not above four rounding units.

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
    kernel = {"trig": kernels.trig_solve, "half_angle": kernels.trig_half_angle}.get(method)
    if kernel is None:
        raise ValueError(f"method is {method!r}; expected 'trig' or 'half_angle'")
    _check({"A": A, "B": B, "D": D})
    return call(kernel, (A, B, D), out)  # type: ignore[no-any-return]


def _check(coefficients: dict[str, Any]) -> None:
    """Refuse coefficients that are no real numbers, or do not broadcast."""
    given = {
        name: value if hasattr(value, "dtype") else np.asarray(value) for name, value in coefficients.items()
    }
    for name, value in given.items():
        if value.dtype.kind not in "fiub":
            raise TypeError(f"{name} is of type {value.dtype}; expected real numbers")
    try:
        np.broadcast_shapes(*(value.shape for value in given.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in given.items())
        raise ValueError(f"coefficients have shapes that do not broadcast: {shapes}") from None
