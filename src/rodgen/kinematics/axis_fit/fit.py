"""The most likely axis of pairs of points; where angles are not exact, :mod:`.screws` fits them too.

The most likely axis e, and point p on it, of N noisy pairs (ρ, ρ′) with known angles χ.

    minimise  Σ w |ρ′ - p - R(e, χ)(ρ - p)|²  over  |e| = 1 and p

Isotropic noise σ² on every coordinate of ρ and of ρ′ makes this the maximum-likelihood estimate exactly: the
residual has covariance 2σ² I whatever the rotation. The module :mod:`.solve`
finds the optimum, says how uncertain it is, and what the pairs leave undetermined.

Remarks name suspicious angles, outliers, and pairs that contradict the axis. A robust loss is safe while the bad pairs
are a minority without a common answer. When many pairs contradict the rest consistently, for example because the sign
of their angle is reversed, the data support two axes about equally; the fit then takes one of them, or lies between
both and estimates a noise that hides the conflict. So the two fifths of the pairs that agree best with one another are
fitted alone: if their noise is far smaller than that of the fit with all pairs, and the other pairs contradict them, a
remark says so.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array, Mask
from rodgen.errors import RodgenError, joined
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.axis_fit.pairs import (
    CHANCE,
    Line,
    Pairs,
    SharedReadings,
    Slide,
    blocks,
    chance_of,
    shown,
    tangents,
)
from rodgen.kinematics.axis_fit.result import NO_ACCIDENT, AxisFit, AxisFitStatus, nearest, remarks_on_noise
from rodgen.kinematics.axis_fit.screws import fit_points
from rodgen.kinematics.axis_fit.solve import (
    LOSSES,
    MOST_REWEIGHTINGS,
    Loss,
    Noise,
    PairFacts,
    Solution,
    axis_information,
    best_agreement,
    chi_cut,
    choose,
    condition_number,
    find_freedoms,
    information_of,
    is_determined,
    joint_covariance,
    parameter_covariance,
    sentences,
    solve,
    status_of,
)

# Share of the pairs whose contradiction leaves no answer safe.
_MANY = 0.3
# Share of the pairs that are searched for as agreeing: fewer than half, so that one of two camps is enough.
_CAMP = 0.4
# By how much the fit's noise must exceed that of the agreeing pairs. They are the best of many choices, so
# their own noise is already taken at a multiple.
_FAR_BETTER = 10.0
# Least ratio of information within a camp for its axis to be one.
_LEAST_INFORMATION = 1e-4


def contradiction(pairs: Pairs, loss: Loss, noise: Noise, line: Line) -> list[str]:
    """Return one sentence when three pairs in ten or more contradict the others, else none."""
    count = int(noise.used.sum())
    bad = noise.outliers
    hidden = loss.name != "linear" and pairs.variance is None
    if bad.sum() < _MANY * count:
        camp = _hidden_camp(pairs, noise) if hidden else None
        if camp is None:
            return []
        line, bad = camp
        start = (
            f"{int(bad.sum())} of {count} pairs contradict the other {count - int(bad.sum())}, which agree "
            f"on the axis {shown(line.axis)} far better than with the fit"
        )
    else:
        start = f"{int(bad.sum())} of {count} pairs contradict the axis"
    good = noise.used & ~bad
    against = _axis_of(pairs, bad, _variance(pairs, good, line))
    if against is None:
        return [f"{start}: with so many the answer is not safe."]
    opposite = "the opposite axis " if float(against @ line.axis) < -0.99 else "the axis "
    return [
        f"{start}; they agree with one another on {opposite}{shown(against)}: with so many the answer is not "
        "safe (check the signs of the angles and the order of the points)."
    ]


def _hidden_camp(pairs: Pairs, noise: Noise) -> tuple[Line, Mask] | None:
    """Return the line of the pairs that agree far better than the fit, and which pairs contradict it."""
    used = np.flatnonzero(noise.used)
    count = max(math.ceil(_CAMP * len(used)), 3)
    if len(used) - count < max(_MANY * len(used), 1) or not noise.variance > 0:
        return None
    line = best_agreement(pairs.only(used), _CAMP)
    squares = pairs.half_squares(line)
    inside = np.sort(used[np.argsort(squares[used], kind="stable")[:count]])
    variance = max(float(squares[inside].sum()) / (3 * count - pairs.parameters), (4 * pairs.rounding) ** 2)
    # The factor of the least median of squares, for a variance that was made small by choice.
    variance *= (1 + 5 / (count - pairs.parameters / 3)) ** 2
    bad = noise.used & (squares > chi_cut(len(used)) ** 2 * variance)
    if noise.variance < _FAR_BETTER**2 * variance or bad.sum() < _MANY * len(used):
        return None
    return (line, bad) if _is_axis(pairs, inside, line) else None


def _axis_of(pairs: Pairs, bad: Mask, variance: float) -> Array | None:
    """Return the axis on which the contradicting pairs agree, to three times the noise of the others, or None."""
    chosen = np.flatnonzero(bad)
    if 3 * len(chosen) - pairs.parameters < 5:
        return None
    line = pairs.only(chosen).best_line()
    if not _is_axis(pairs, chosen, line):
        return None
    return line.axis if _variance(pairs, bad, line) <= 9 * variance else None


def _variance(pairs: Pairs, chosen: Mask, line: Line) -> float:
    freedoms = max(3 * int(chosen.sum()) - pairs.parameters, 1)
    return max(float(pairs.half_squares(line)[chosen].sum()) / freedoms, (4 * pairs.rounding) ** 2)


def _is_axis(pairs: Pairs, chosen: NDArray[np.intp], line: Line) -> bool:
    """Return whether these pairs alone determine the line, and not by the noise of repeated readings."""
    H = pairs.only(chosen).moments().hessian(line.axis, line.point, tangents(line.axis))
    values = np.linalg.eigvalsh(H)
    return bool(values[0] > _LEAST_INFORMATION * values[-1])


_DEGREES = 4 * math.pi


def remarks_on(
    pairs: Pairs,
    solution: Solution,
    loss: Loss,
    noise: Noise,
    line: Line,
    determined: bool,
    shared: SharedReadings | None,
) -> list[str]:
    """Return sentences, the most important first."""
    remarks: list[str] = []
    largest = max(float(np.abs(block.angle).max()) for _, block in pairs.blocks())
    if largest > _DEGREES:
        remarks.append(f"An angle is {largest:.4g} rad: angles are taken in rad, not in degrees.")
    if math.isnan(noise.variance):
        remarks.append(
            "The pairs leave no degrees of freedom to estimate the noise: give sigma to learn the uncertainty."
        )
    if shared is not None:
        remarks.append(shared.text)
    bad, used = int(noise.outliers.sum()), int(noise.used.sum())
    if bad and loss.name == "linear":
        remarks.append(
            f"{bad} of {used} pairs are farther off than noise explains and still count fully: loss='huber' "
            "would limit their influence."
        )
    remarks += contradiction(pairs, loss, noise, line)
    remarks += remarks_on_noise(pairs.variance is not None, noise.dof, noise.chi_square, determined)
    if not solution.converged:
        remarks.append(
            f"The weights of loss={loss.name!r} had not settled after {MOST_REWEIGHTINGS} solutions."
        )
    if pairs.point is not None:
        remarks += _point_off(pairs, solution, noise, line) + _lengths_differ(pairs, noise, line)
    return remarks


def _point_off(pairs: Pairs, solution: Solution, noise: Noise, line: Line) -> list[str]:
    """Return a remark when a free point fits better than two more parameters do by chance."""
    good = noise.good
    freedoms = 3 * int(good.sum()) - 4
    if freedoms <= 0:
        return []
    some = replace(pairs.weighted(solution.share * good), point=None)
    free = some.best_line().nearest(np.zeros(3))
    left = sum(float(block.half_squares(free).sum()) for _, block in some.blocks())
    gain = sum(float(block.half_squares(line).sum()) for _, block in some.blocks()) - left
    if gain <= (64 * pairs.rounding) ** 2 * int(good.sum()):
        return []
    # Survival functions of χ² with 2 degrees of freedom, and of F with 2 and `freedoms`, in closed form.
    if pairs.variance is not None:
        chance = math.exp(-gain / pairs.variance / 2)
    else:
        chance = math.exp(-freedoms / 2 * math.log1p(gain / left)) if left > 0 else 0.0
    if chance > CHANCE:
        return []
    away = math.sqrt(float(free.point @ free.point)) * pairs.scale
    return [
        f"With a free point the pairs fit far better, and the axis passes {away:.3g} from the point given: is "
        "that point on the axis?"
    ]


def _lengths_differ(pairs: Pairs, noise: Noise, line: Line) -> list[str]:
    """Return a remark when distances from the known point change more than the rest of the residuals explains."""
    good = noise.good
    count = int(good.sum())
    changes = np.empty(len(good))
    squares = radial = 0.0
    for rows, block in pairs.blocks():
        before, after = (np.sqrt((x**2).sum(axis=-1)) for x in (block.rho, block.rho_prime))
        changes[rows] = change = np.abs(after - before) * good[rows]
        squares += float(change @ change)
        radial += float(block.weight @ change**2) / count / 2
    worst = int(np.argmax(changes))
    if changes[worst] <= 64 * pairs.rounding:
        return []
    if pairs.variance is not None:
        limit = pairs.variance * (1 + NO_ACCIDENT * math.sqrt(2 / count))
    else:
        freedoms = 2 * count - 2
        if freedoms <= 0:
            return []
        across = max(float(pairs.half_squares(line).sum(where=good)) - count * radial, 0.0) / freedoms
        limit = across * (1 + NO_ACCIDENT * math.sqrt(2 / count + 2 / freedoms))
    if radial <= limit:
        return []
    rms = math.sqrt(squares / count) * pairs.scale
    return [
        f"Distances from the known point change by {rms:.3g} rms (most in pair {worst}), more than the other "
        "residuals explain."
    ]


def fit_axis(
    rho: ArrayLike,
    rho_prime: ArrayLike,
    angle: ArrayLike | None = None,
    *,
    move: Any = None,
    point: Any = "free",
    origin: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    sigma_angle: float | None = None,
    weights: ArrayLike | None = None,
    loss: str = "linear",
) -> AxisFit:
    """Fit one axis to many noisy pairs of points: of rotations by exact angles, else of screws.

    Maximum likelihood for independent isotropic noise on every reading. With exact angles it is the global optimum,
    found without iteration for ``loss="linear"``. Else a motion is a turn about the axis and a slide along it, with an
    angle and a slide of its own.

    Parameters
    ----------
    rho, rho_prime : (N, 3) array_like
        Points before and after, any one length unit; leading axes are flattened. Without exact angles, (N, 3): three a
        motion at least, not on one line.
    angle : (N,) or scalar array_like, optional
        Angle of rotation of each pair in rad, positive by the right-hand rule about the axis; any size. With
        `sigma_angle` one reading for all rows of a motion; left out, it is fitted.
    move : (N,) sequence, optional
        Label of each row's motion, where angles are not exact; left out, all rows are one motion.
    point : "free" or (3,) array_like
        Whether the point on the axis is fitted too, or is known (``(0, 0, 0)``: vectors from an origin
        on the axis).
    origin : (3,) array_like, optional
        The point of a free axis that is nearest to it is returned; left out, nearest to the mean of the readings.
    sigma : float or (N,) array_like, optional
        Standard uncertainty of one coordinate of one reading, of ρ and of ρ′ alike, in the length unit. It
        gives covariance and chi-square their scale. Left out, it is estimated from the residuals. Without exact angles,
        a number.
    sigma_angle : float, optional
        That of a reading of the angle, in rad; goes with `angle` and `sigma`. Left out, angles given are exact.
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
        four pairs (three for a known point). Without exact angles: a motion of fewer than three points or of points on
        one line, or with two readings of its angle; `point`, `weights` or `loss`; `sigma_angle` without `angle` and
        `sigma`.

    Notes
    -----
    A reading that is in several pairs, to the last digit, makes their errors dependent: the uncertainties
    allow for it, and a remark says so. A known point is taken as exact. Without exact angles, readings of three points
    or more that are in several motions are one reading, whose error is one unknown.

    Source: equation (1) of Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling
    Volumetric Geometric Accuracy of Multi-Coordinate Systems", for many pairs at once; with a slide, derivation
    ``helical_axis``.

    Examples
    --------
    A table turns about z through (1, 2, ·); three balls are seen before and after 90 degrees:

    >>> import numpy as np
    >>> before = [[3, 2, 0], [1, 5, 1], [4, 4, 2]]
    >>> after = [[1, 4.001, 0], [-2.001, 2, 1], [-1, 5, 2.001]]
    >>> fit = fit_axis(before, after, np.pi / 2)
    >>> fit.status.name, np.allclose(fit.axis, [0, 0, 1], atol=1e-3), fit.point.round(3).tolist()
    ('DETERMINED', True, [1.0, 2.0, 1.0])

    It rises by 3 as well, by an angle that was not read:

    >>> after = [[1, 4, 3], [-2, 2, 4], [-1, 5, 5]]
    >>> fit = fit_axis(before, after, sigma=0.001, origin=(0, 0, 0))
    >>> np.degrees(fit.motions.angles).round(3).tolist(), fit.motions.slides.round(6).tolist()
    ([90.0], [3.0])
    """
    if angle is None or sigma_angle is not None:
        options = {
            "point": not isinstance(point, str) or point != "free",
            "weights": weights is not None,
            "loss": loss != "linear",
        }
        if named := [name for name, is_given in options.items() if is_given]:
            raise RodgenError(f"{joined(named)} without exact angles; expected angle, and no sigma_angle")
        return fit_points(
            rho, rho_prime, move=move, angle=angle, sigma=sigma, sigma_angle=sigma_angle, origin=origin
        )
    if loss not in LOSSES:
        raise RodgenError(f"loss is {loss!r}; expected one of {', '.join(map(repr, LOSSES))}")
    pairs, kind = Pairs.of(rho, rho_prime, angle, point, sigma, weights), LOSSES[loss]
    if origin is not None and pairs.point is not None:
        raise RodgenError("origin is for a free point; point is known")
    solution = solve(pairs, kind)
    fit = _assess(pairs, kind, solution, Slide(0.0, by_angle=False, line=solution.best))
    if not math.isnan(fit.slide_uncertainty):
        slid = (_with_slide(pairs, kind, solution, fit.dof, by_angle=by_angle) for by_angle in (False, True))
        fit = min((one for one in slid if one is not None), key=_chance, default=fit)
    return fit if origin is None else _seen_from(fit, real_array("origin", origin, (3,)))


def _seen_from(fit: AxisFit, origin: Array) -> AxisFit:
    """Return the fit with the points of its axes that are nearest to another origin."""
    directions = [
        nearest(axis, point, fit.covariance, origin)
        for axis, point in zip(fit.candidate_axes, fit.candidate_points, strict=True)
    ]
    points = np.array([point for point, _ in directions])
    return replace(fit, point=points[0], covariance=directions[0][1], candidate_points=points, origin=origin)


def _chance(fit: AxisFit) -> float:
    return chance_of(fit.slide, fit.slide_uncertainty**2, max(fit.dof, 1), known=fit.sigma_given)


def _with_slide(pairs: Pairs, loss: Loss, solution: Solution, dof: int, *, by_angle: bool) -> AxisFit | None:
    """Return the fit with a slide; None where chance explains it, or where the pairs do not agree with it."""
    if by_angle and np.ptp(pairs.angle) == 0:
        return None
    counted, known = pairs.weighted(solution.share), pairs.variance is not None
    before = float(counted.half_squares(solution.best).sum())

    def is_chance(left: float) -> bool:
        # Pairs that contradict one another leave squares that a robust noise does not know.
        gain = (before - left) / (pairs.variance or max(left, 1e-300) / max(dof, 1))
        return chance_of(math.sqrt(max(gain, 0.0)), 1.0, max(dof, 1), known=known) > math.log(CHANCE)

    if is_chance(before - Slide(0.0, by_angle=by_angle, line=solution.best).gain(counted)):
        return None
    slide = Slide.fitted(counted, solution.best, by_angle=by_angle)
    if is_chance(float(slide.without(counted).half_squares(slide.line).sum())):
        return None
    slid = _assess(slide.without(pairs), loss, replace(solution, best=slide.line, other=None), slide)
    agree = slid.outliers.sum() < _MANY * slid.pairs
    return slid if agree and _chance(slid) < math.log(CHANCE) else None


def _assess(pairs: Pairs, loss: Loss, solution: Solution, slide: Slide) -> AxisFit:
    """Return the result in the user's unit: uncertainty, outliers, and what is not determined.

    `pairs` are those without the slide.
    """
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
    shared = SharedReadings.of(pairs.weighted(good))
    slid, slide_variance = 0.0, math.nan
    if determined and not math.isnan(noise.variance):
        slide = replace(slide, line=best)
        whole, slope = slide.information(pairs.weighted(solution.share * good), basis, information)
        size = slice(None if pairs.slid else -1)  # a slide that is not fitted takes nothing from the others
        excess = np.zeros_like(whole)
        if shared is not None:
            excess = shared.excess(pairs, solution.share, basis, slide)
            absorbed = np.linalg.solve(whole[size, size], excess[size, size])
            noise = noise.less_dof(float(np.trace(absorbed)) / 2, pairs)
        versines = sum(
            float((solution.share[rows] ** 2 * noise.used[rows]) @ (2 * np.sin(block.angle / 2) ** 2))
            for rows, block in pairs.blocks()
        )

        def covariance_of(some: slice) -> Array:
            normal = whole[some, some]
            shares = np.linalg.solve(normal, np.linalg.solve(normal, excess[some, some]).T)
            return parameter_covariance(normal, score, noise.variance, versines) + noise.variance * shares

        small = covariance_of(size)[: len(information), : len(information)]
        if slide.is_determined(whole):
            slid = -slope * float(np.linalg.inv(whole)[-1, -1])
            rounding = (4 * pairs.rounding) ** 2
            slide_variance = float(covariance_of(slice(None))[-1, -1])
            # Where noise makes all of an arrangement, the second order may leave none: nothing is known then.
            slide_variance = max(slide_variance, rounding) if slide_variance > -rounding else math.nan
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
        sigma_angle=math.nan,
        sigma_given=pairs.variance is not None,
        dof=noise.dof,
        chi_square=noise.chi_square,
        rms=rms[0],
        residuals=residuals[0],
        turns=pairs.angle,
        weights=solution.share,
        outliers=noise.outliers,
        origin=pairs.origin + pairs.scale * centroid,
        condition=condition_number(information, facts.arm) if determined else math.inf,
        status=status,
        undetermined=tuple(sentences(status, freedoms, lines, facts)),
        remarks=tuple(remarks_on(pairs, solution, loss, noise, lines[0], determined, shared)),
        candidate_axes=np.array([line.axis for line in lines]),
        candidate_points=np.array([place(line.point) for line in lines]),
        candidate_rms=np.array(rms),
        free_directions=freedoms.directions,
        point_known=not free,
        loss=loss.name,
        iterations=solution.iterations,
        motions=None,
        slide=(slide.size + slid) * pairs.scale,
        slide_uncertainty=math.sqrt(slide_variance) * pairs.scale,
        slide_fitted=pairs.slid,
        slide_by_angle=slide.by_angle,
    )
