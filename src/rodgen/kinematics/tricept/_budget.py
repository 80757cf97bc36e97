"""The uncertainty budget of a Tricept's tool: the contribution of each parameter.

The variance is u²(Q_k) = Σ_ij S_ki U_ij S_kj. Without correlations parameter i contributes (S_ki u_i)². With them a
part belongs to pairs; it is given in equal halves to both, S_ki Σ_j U_ij S_kj, so that the parts still add up, and one
may be negative: it then reduces the sum of the others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.kinematics.tricept._covariance import parameter_covariance
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._parameters import ANGLES, PARAMETERS
from rodgen.kinematics.tricept._uncertainty import regular_place
from rodgen.views import html_of

# Sensitivities this small relative to the greatest of their unit are rounding, as those that vanish by symmetry.
_ROUNDING = 64 * 2.0**-52


class BudgetLine(NamedTuple):
    """The contribution of one parameter to one coordinate.

    Attributes
    ----------
    parameter : str
        Its name.
    sensitivity : float
        ∂Q_k by it.
    u : float
        Its standard uncertainty.
    alone : float
        |sensitivity| · u: the standard uncertainty of Q_k from this parameter alone.
    part : float
        Its part of u²(Q_k), with half of what it has with others by correlation.
    share : float
        That part over u²(Q_k).
    """

    parameter: str
    sensitivity: float
    u: float
    alone: float
    part: float
    share: float

    def _repr_html_(self) -> str:
        return html_of(self)


class Budget(NamedTuple):
    """The uncertainty budget of a point.

    Attributes
    ----------
    names : tuple of str
        The parameters, n of them.
    sensitivity : ndarray, shape (3, n)
        Derivatives of Qx, Qy, Qz.
    u : ndarray, shape (n,)
        Standard uncertainties of the parameters.
    parts : ndarray, shape (3, n)
        Contributions to u²(Qx), u²(Qy), u²(Qz); they add up to these along each row.
    U_y : ndarray, shape (3, 3)
        The covariance matrix of the point.
    correlated : bool
        Whether any of the parameters are.
    """

    names: tuple[str, ...]
    sensitivity: Array
    u: Array
    parts: Array
    U_y: Array
    correlated: bool

    def _repr_html_(self) -> str:
        return html_of(self)

    def lines(self, coordinate: int) -> list[BudgetLine]:
        """Return the parameters with an uncertainty, the greatest share first; coordinate 0, 1, 2 is Qx, Qy, Qz."""
        total = self.U_y[coordinate, coordinate]
        made = [
            BudgetLine(
                name,
                float(self.sensitivity[coordinate, n]),
                float(self.u[n]),
                float(abs(self.sensitivity[coordinate, n]) * self.u[n]),
                float(self.parts[coordinate, n]),
                float(self.parts[coordinate, n] / total) if total > 0 else 0.0,
            )
            for n, name in enumerate(self.names)
            if self.u[n] > 0
        ]
        return sorted(made, key=lambda line: (-abs(line.part), -line.alone))

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON."""
        return {
            "correlated": self.correlated,
            "U_y": self.U_y.tolist(),
            **{
                f"Q{axis}": {
                    "u": float(np.sqrt(self.U_y[k, k])),
                    "parameters": [line._asdict() for line in self.lines(k)],
                }
                for k, axis in enumerate("xyz")
            },
        }

    def summary(self, unit: str = "") -> str:
        """Return a text table; lines below a thousandth of the whole are added up."""
        text = []
        for k, axis in enumerate("xyz"):
            total = np.sqrt(self.U_y[k, k])
            text.append(f"u(Q{axis}) = {total:.4g} {unit}".rstrip())
            rest = 0.0
            for line in self.lines(k):
                if abs(line.share) < 1e-3:
                    rest += line.share
                    continue
                text.append(
                    f"  {line.parameter:12} alone {line.alone:10.4g}   share {100 * line.share:7.2f} %"
                )
            if rest:
                text.append(f"  {'all others':12} {'':16}   share {100 * rest:7.2f} %")
        if self.correlated:
            text.append(
                "Some parameters are correlated: shares have half of each pair's part, and can be negative."
            )
        return "\n".join(text)


def budget(point: ArrayLike, geometry: Geometry, U: ArrayLike) -> Budget:
    """Return the uncertainty budget of one point.

    Parameters
    ----------
    point : array_like (3,)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    U : array_like (5, 5) or (n, n)
        Covariance of A0, A1, A-1, r, R, or of all ``PARAMETERS``.

    Returns
    -------
    Budget

    Raises
    ------
    RodgenError
        When U is not a covariance matrix, or the point has no regular pose.

    Examples
    --------
    >>> from rodgen import tricept
    >>> U = tricept.covariance({"rods": 0.0029, "radii": 0.0058})
    >>> found = tricept.budget([0.0, 0.0, 700.0], tricept.PAPER, U)
    >>> line = found.lines(2)[0]
    >>> line.parameter, round(line.share, 3)
    ('r', 0.311)
    """
    matrix = parameter_covariance(U)
    count = len(matrix)
    S = _without_rounding(regular_place(point, geometry)[2][:, :count])
    parts = S * (S @ matrix)
    off = matrix[~np.eye(count, dtype=bool)]
    return Budget(
        PARAMETERS[:count], S, np.sqrt(np.diagonal(matrix)), parts, S @ matrix @ S.T, bool((off != 0).any())
    )


def _without_rounding(S: Array) -> Array:
    """Return sensitivities with those set to 0 that are rounding relative to the greatest, of lengths and of angles."""
    angle = np.array([name in ANGLES for name in PARAMETERS[: S.shape[1]]])
    greatest = np.where(angle, np.abs(S[:, angle]).max(initial=0.0), np.abs(S[:, ~angle]).max(initial=0.0))
    return np.where(np.abs(S) > _ROUNDING * greatest, S, 0.0)
