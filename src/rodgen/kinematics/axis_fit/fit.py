"""The most likely axis e, and point p on it, of N noisy pairs (ρ, ρ′) with known angles χ.

    minimise  Σ w |ρ′ - p - R(e, χ)(ρ - p)|²  over  |e| = 1 and p

Isotropic noise σ² on every coordinate of ρ and of ρ′ makes this the maximum-likelihood estimate exactly: the
residual has covariance 2σ² I whatever the rotation. The optimum is :mod:`.solve`'s, the
uncertainty :mod:`.covariance`'s; :mod:`.determinacy` says what the pairs leave undetermined.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.data.spool import blocks
from rodgen.errors import RodgenError
from rodgen.kinematics.axis_fit.covariance import (
    condition_number,
    information_of,
    joint_covariance,
    parameter_covariance,
)
from rodgen.kinematics.axis_fit.determinacy import (
    PairFacts,
    axis_information,
    choose,
    find_freedoms,
    is_determined,
    sentences,
    status_of,
)
from rodgen.kinematics.axis_fit.moments import tangents
from rodgen.kinematics.axis_fit.noise import Noise
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.remarks import remarks_on
from rodgen.kinematics.axis_fit.result import AxisFit, AxisFitStatus
from rodgen.kinematics.axis_fit.robust import LOSSES, Loss
from rodgen.kinematics.axis_fit.solve import Solution, solve


def fit_axis(
    rho: ArrayLike,
    rho_prime: ArrayLike,
    angle: ArrayLike,
    *,
    point: Any = "free",
    sigma: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    loss: str = "linear",
) -> AxisFit:
    """Fit one axis of rotation to many noisy pairs of points with known angles.

    Maximum likelihood for independent isotropic noise on both points of every pair; the global optimum,
    found without iteration for ``loss="linear"``.

    Parameters
    ----------
    rho, rho_prime : (N, 3) array_like
        Points before and after the rotation, any one length unit; leading axes are flattened.
    angle : (N,) or scalar array_like
        Angle of rotation of each pair in rad, positive by the right-hand rule about the axis; any size.
    point : "free" or (3,) array_like
        Whether the point on the axis is fitted too, or is known (``(0, 0, 0)``: vectors from an origin
        on the axis).
    sigma : float or (N,) array_like, optional
        Standard uncertainty of one coordinate of one reading, of ρ and of ρ′ alike, in the length unit. It
        gives covariance and chi-square their scale. Left out, it is estimated from the residuals.
    weights : (N,) array_like, optional
        Factors on the inverse variances; 0 leaves a pair out (its residual is still reported).
    loss : {"linear", "huber"}
        What a large residual costs: its square, or beyond Huber's threshold its size. "huber" has 95 % efficiency on
        good data and starts from a least-median fit.

    Returns
    -------
    AxisFit
        Frozen; ``print(fit)`` is a summary, ``fit.to_dict()`` is for JSON. What
        the pairs do not determine is in ``fit.status`` and, as sentences, in ``fit.undetermined``: a fit
        does not raise because of it.

    Raises
    ------
    RodgenError
        (a ValueError) Shapes that do not fit together, no pairs, a number that is not finite (with its
        row), a sigma that is not positive, a negative weight, an unknown loss; with "huber" fewer than
        four pairs (three for a known point).

    Notes
    -----
    Pairs must not share readings: a reading that stands in several pairs makes their errors dependent, and
    the reported uncertainties come out too small. A known point is taken as exact, and so are the angles.

    Source: equation (1) of Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling
    Volumetric Geometric Accuracy of Multi-Coordinate Systems", for many pairs at once.

    Examples
    --------
    A table turns about z through (1, 2, ·); three balls are seen before and after 90 degrees:

    >>> import numpy as np
    >>> before = [[3, 2, 0], [1, 5, 1], [4, 4, 2]]
    >>> after = [[1, 4.001, 0], [-2.001, 2, 1], [-1, 5, 2.001]]
    >>> fit = fit_axis(before, after, np.pi / 2)
    >>> fit.status.name, np.allclose(fit.axis, [0, 0, 1], atol=1e-3), fit.point.round(3).tolist()
    ('DETERMINED', True, [1.0, 2.0, 1.0])
    """
    if loss not in LOSSES:
        raise RodgenError(f"loss is {loss!r}; expected one of {', '.join(map(repr, LOSSES))}")
    pairs = Pairs.of(rho, rho_prime, angle, point, sigma, weights)
    return _assess(pairs, LOSSES[loss], solve(pairs, LOSSES[loss]))


def _assess(pairs: Pairs, loss: Loss, solution: Solution) -> AxisFit:
    """Return the result in the user's unit: uncertainty, outliers, and what is not determined."""
    free = pairs.point is None
    lines = choose(pairs, solution)
    squares = pairs.half_squares(lines[0])
    noise = Noise.of(pairs, loss, squares)
    good = noise.good
    total, moment = 0.0, np.zeros(3)
    for rows, block in pairs.blocks():
        counted = block.weight * solution.share[rows] * good[rows]
        total += 2 * float(counted.sum())
        moment += counted @ (block.rho + block.rho_prime)
    centroid = moment / total
    if free:
        lines = [line.nearest(centroid) for line in lines]
    best = lines[0]
    facts = PairFacts.of(pairs, good, best)
    basis = tangents(best.axis)
    information, score = information_of(pairs, noise, loss, best, basis)
    reference = float(np.trace(information[2:, 2:])) / 2 if free else facts.versines
    small = np.full(information.shape, np.nan)
    determined = is_determined(axis_information(information), reference * facts.arm**2, facts)
    if determined and not math.isnan(noise.variance):
        versines = sum(
            float((solution.share[rows] ** 2 * noise.used[rows]) @ (2 * np.sin(block.angle / 2) ** 2))
            for rows, block in pairs.blocks()
        )
        small = parameter_covariance(information, score, noise.variance, versines)
    freedoms = find_freedoms(
        axis_information(information), reference * facts.arm**2, small[:2, :2], basis, facts
    )
    status = status_of(freedoms, lines)
    if status in (AxisFitStatus.ONE_FREEDOM, AxisFitStatus.ANY_AXIS):
        lines = lines[:1]

    def place(point: Array) -> Array:
        return pairs.origin + pairs.scale * point if free else pairs.origin.copy()

    residuals, rms = [], []
    for line in lines:
        d, missed = pairs.residuals(line), 0.0
        for rows in blocks(d):
            missed += float((d[rows][good[rows]] ** 2).sum())
            d[rows] *= pairs.scale
        residuals.append(d)
        rms.append(math.sqrt(missed / facts.count) * pairs.scale)
    return AxisFit(
        axis=best.axis,
        point=place(best.point),
        covariance=joint_covariance(small, best, centroid, basis, pairs.scale),
        sigma=noise.sigma,
        sigma_given=pairs.variance is not None,
        dof=noise.dof,
        chi_square=noise.chi_square,
        rms=rms[0],
        residuals=residuals[0],
        weights=solution.share,
        outliers=noise.outliers,
        centroid=pairs.origin + pairs.scale * centroid,
        condition=condition_number(information, facts.arm) if determined else math.inf,
        status=status,
        undetermined=tuple(sentences(status, freedoms, lines, facts)),
        remarks=tuple(remarks_on(pairs, solution, loss, noise, lines[0], determined)),
        candidate_axes=np.array([line.axis for line in lines]),
        candidate_points=np.array([place(line.point) for line in lines]),
        candidate_rms=np.array(rms),
        free_directions=freedoms.directions,
        point_known=not free,
        loss=loss.name,
        iterations=solution.iterations,
    )
