"""Orientations of a 3-SPS-S machine with given legs: all assembly modes, or the one nearest a start.

The octic of the derivation ``three_sps_s`` has a root for every one of
them, and from a root the rotation follows by square roots. Its roots, as eigenvalues of a companion matrix, are rough
where some of them crowd together, so each is only a start for Newton's method on the legs themselves, and a mode
is accepted when its legs are right to rounding. Three kinds of legs need starts of their own: nearly equal ones
(two modes are nearly pure torsions), a pivot in the plane of the base (the octic is a fourth power), and legs with
Im Z³ near zero, of which symmetric ones (L1 = L3) are the usual case (the octic is nearly a square, of a quartic). An
unnecessary start only costs time.

There is an independent test: legs are a map from all rotations, which have no boundary, to lengths, so each length that
no singular pose has is reached as often with one sign of the Jacobian's determinant as with the other. Where the signs
found do not balance, more starts are tried, and the status is INCOMPLETE if that does not help.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.numerics import roots
from rodgen.kinematics.three_sps_s._legs import SINGULAR, Geometry, nearest_proper

COMPLEX = 0.1
"""Imaginary part of a root, over its size, up to which it may be a real one: eight roots in one keep an eighth
of sixteen digits."""
NEARLY_SQUARE = 0.05
"""Sine of three times the phase of Z up to which the octic's roots are nearly double; the quartic's are taken, too."""
NEARLY_EQUAL = 0.1
"""Part of Z in 4h up to which the tilt of a torsion mode is small enough to be linear."""
FLAT = 0.05
"""h/R up to which the modes of a pivot in the plane of the base are near."""
CLEARLY = 1e3
"""By how much the legs of one sign of the root must be better to leave the other one out."""


def starts(legs: Any, geometry: Geometry) -> Any:
    """Return quaternions (n, m, 4) near every mode of the legs (n, 3); NaN where a column is not needed."""
    octic, quartic, phase_sine, size = kernels.sps_octic_scaled(legs, *geometry.lengths)
    quaternions = [_from_roots(_nearly_real(octic), legs, geometry)]
    rows = np.abs(phase_sine) <= NEARLY_SQUARE
    if rows.any():
        some = np.full((len(legs), 8, 4), np.nan)
        some[rows] = _from_roots(_nearly_real(quartic[rows]), legs[rows], geometry)
        quaternions.append(some)
    eta = geometry.h / geometry.R
    cos_sum, Z = kernels.sps_invariants(legs, *geometry.lengths)
    Z = Z[..., 0] + 1j * Z[..., 1]
    rows = size <= NEARLY_EQUAL * 4 * abs(eta)
    if rows.any():
        with np.errstate(divide="ignore", invalid="ignore"):  # a pivot at h = 0 has no such modes
            quaternions.append(np.where(rows[:, None, None], _torsions(cos_sum, Z, eta), np.nan))
    if abs(eta) <= FLAT:
        quaternions.append(_flat(cos_sum, Z))
    return np.concatenate(quaternions, axis=1)


@cache
def spread() -> Any:
    """Return 72 rotations all over, for legs without better starts: twelve tilts, each with six torsions."""
    directions = [(0.0, 0.0, 1.0)]
    for tilt, count in ((0.8, 4), (1.6, 4), (2.4, 3)):
        directions += [(tilt, 2 * np.pi * n / count + tilt, 0.0) for n in range(count)]
    rows = []
    for tilt, azimuth, _ in directions:
        for torsion in np.arange(6) * np.pi / 3 + 0.5:
            v = np.cos(tilt / 2) * np.exp(0.5j * torsion)
            w = np.sin(tilt / 2) * np.exp(1j * azimuth)
            rows.append([v.real, w.real, w.imag, v.imag])
    return np.array(rows)


def _nearly_real(coefficients: Any) -> Any:
    """Return the roots of polynomials (n, m + 1) that may be real, (n, m); NaN for the others."""
    roots_there = roots(coefficients)
    return np.where(
        np.abs(roots_there.imag) <= COMPLEX * (1 + np.abs(roots_there.real)), roots_there.real, np.nan
    )


def _from_roots(tangents: Any, legs: Any, geometry: Geometry) -> Any:
    """Return both rotations of each root (n, m): (n, 2m, 4); only one where the other's legs are clearly worse."""
    arguments = legs[:, None, None], *geometry.lengths, tangents[..., None], np.array([1.0, -1.0])
    quaternions = kernels.sps_mode(*arguments)
    again = kernels.sps_legs_from_quaternion(quaternions, *geometry.lengths)
    wrong = np.abs(np.square(again) - np.square(legs[:, None, None])).max(axis=-1)
    with np.errstate(invalid="ignore"):
        worse = wrong > CLEARLY * wrong[..., ::-1]
    return np.where(worse[..., None], np.nan, quaternions).reshape(len(legs), -1, 4)


def _torsions(cos_sum: Any, Z: Any, eta: float) -> Any:
    """Return the two modes that are nearly pure torsions: w from Z = 4 h v w̄ to first order."""
    v = _both_v(cos_sum, 1.0)
    return _quaternions(v, np.conj(Z[:, None] / (4 * eta * v)))


def _flat(cos_sum: Any, Z: Any) -> Any:
    """Return the four modes for h = 0, where Z = 2 w²; with lengths in units of R."""
    w = np.sqrt(Z / 2)
    v = _both_v(cos_sum, np.clip(1 - np.abs(w) ** 2, 0, 1))
    return _quaternions(np.concatenate([v, -v], axis=-1), w[:, None])


def _both_v(cos_sum: Any, square: Any) -> Any:
    """Return the two v (n, 2) with 2 Re v² = A and |v|² = `square`, as nearly as there are such."""
    cosine = np.clip(cos_sum / 2, -square, square)
    sine = np.sqrt((square - cosine) * (square + cosine))
    return np.sqrt(np.stack([cosine + 1j * sine, cosine - 1j * sine], axis=-1))


def _quaternions(v: Any, w: Any) -> Any:
    v, w = np.broadcast_arrays(v, w)
    quaternions = np.stack([v.real, w.real, w.imag, v.imag], axis=-1)
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return quaternions / np.where(length > 0, length, 1.0)


EPS = float(np.finfo(float).eps)
CHUNK = 1024
"""Elements a pass: some 40 starts each, and their squares of distances, fit into a cache of some megabytes."""
ROUNDING = 64 * EPS
"""What rounding of the legs leaves of their squares, over the squares of the machine's dimensions: some twenty
roundings a leg, and the user's own in forming the legs."""
SETTLED = 4 * EPS
"""Below this a start is done: rounding of one leg."""
CALLS = 12
"""Calls of the polishing kernel, four steps each. A regular mode takes one or two; where two modes meet the distance
only halves a step, and 27 halvings bring a rough root (1e-4) to where rounding hides the rest."""
SAME = 1e-6
"""Modes that are not farther apart, in rad, are one: at a double mode rounding of the legs moves both by 1e-8 to
1e-7."""
NEAR = 0.05
"""Singular modes that are not farther apart are one if there is one half way between them as well: rounding leaves a
whole stretch, 1e-6 to 1e-4 long, where three modes or more meet, or nearly so."""
MODES = 8


class DirectStatus(IntEnum):
    """The result of a search for the rotations with given legs.

    CONVERGED: every mode (of the one that is asked for) is found, and regular.
    SINGULAR: a mode (or the one asked for) is singular: there two or more meet, and the legs do not hold the platform.
    NO_ASSEMBLY: no rotation has these legs.
    AMBIGUOUS: two modes are equally near the start; one of them is given.
    INCOMPLETE: the signs of the determinants do not balance: a mode is missing.
    INVALID: a leg is negative, NaN or infinite, or the start is not a rotation.
    """

    CONVERGED = 0
    SINGULAR = 1
    NO_ASSEMBLY = 2
    AMBIGUOUS = 3
    INCOMPLETE = 4
    INVALID = 5


def direct_all(legs: ArrayLike, geometry: Geometry) -> tuple[Any, Any, Any]:
    """Return every orientation of the platform with given legs.

    Parameters
    ----------
    legs : array_like (..., 3)
        Lengths of the legs at -30°, 90° and 210°.
    geometry : Geometry
        The machine.

    Returns
    -------
    rotations : array (..., 8, 3, 3)
        Rotation matrices, those with the smallest angle of rotation first, then NaN. A mode that is double, because two
        meet there, is there once.
    count : array (...) of int8
        How many there are, 0 to 8.
    status : array (...) of int8
        Codes of :class:`DirectStatus`.

    Raises
    ------
    ValueError
        When the last axis is not 3 long.
    TypeError
        When the legs are not real.

    Notes
    -----
    The octic is proved in the derivation ``three_sps_s``; its degree says that there are no more than eight. Zhou and
    Zhu give (21)-(23), which are the legs of a rotation, and not this way back.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> machine = three_sps_s.Geometry(2, 1, 1.5)
    >>> rotations, count, status = three_sps_s.direct_all([2.578759391645525] * 3, machine)
    >>> int(count), three_sps_s.DirectStatus(int(status)).name
    (8, 'CONVERGED')
    >>> bool(abs(three_sps_s.legs(rotations, machine) - 2.578759391645525).max() < 1e-14)
    True
    """
    lengths = real_array("legs", legs, (3,))
    flat = lengths.reshape(-1, 3)
    quaternions = np.full((len(flat), MODES, 4), np.nan)
    count, status = np.zeros(len(flat), np.int8), np.zeros(len(flat), np.int8)
    for first in range(0, len(flat), CHUNK):
        part = slice(first, first + CHUNK)
        quaternions[part], count[part], status[part] = _modes(flat[part], geometry)
    shape = lengths.shape[:-1]
    there = np.isfinite(quaternions[..., 0])
    matrices = kernels.matrix_from_quaternion(np.where(there[..., None], quaternions, [1.0, 0, 0, 0]))[0]
    rotations = np.where(there[..., None, None], matrices, np.nan)
    return rotations.reshape(*shape, MODES, 3, 3), count.reshape(shape)[()], status.reshape(shape)[()]


def direct(legs: ArrayLike, geometry: Geometry, *, near: ArrayLike) -> tuple[Any, Any]:
    """Return the orientation with given legs that is nearest a start.

    Parameters
    ----------
    legs : array_like (..., 3)
        Lengths of the legs at -30°, 90° and 210°.
    geometry : Geometry
        The machine.
    near : array_like (..., 3, 3)
        Rotation matrix; the mode wanted is the one that the least rotation brings to it.

    Returns
    -------
    rotation : array (..., 3, 3)
        Rotation matrix; NaN without a mode.
    status : array (...) of int8
        Codes of :class:`DirectStatus`, of that mode: SINGULAR is the one given, and AMBIGUOUS says that another is as
        near (to 1e-6 rad). The start itself may be singular: from the home pose two torsions are equally near.

    Raises
    ------
    ValueError
        When shapes do not broadcast.

    Notes
    -----
    All modes are found, and the nearest is chosen, whichever Newton's method would converge to.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> machine = three_sps_s.Geometry(2, 1, 1.5)
    >>> turned = three_sps_s.rotation_from_tilt_torsion(0.3, 0.2, 0.5)
    >>> found, status = three_sps_s.direct(three_sps_s.legs(turned, machine), machine, near=turned)
    >>> bool(abs(found - turned).max() < 1e-12), int(status)
    (True, 0)
    """
    start, _ = nearest_proper(near, "near")
    rotations, count, status = direct_all(legs, geometry)
    shape = np.broadcast_shapes(np.shape(count), start.shape[:-2])
    rotations = np.broadcast_to(rotations, (*shape, MODES, 3, 3))
    return _nearest(rotations, np.broadcast_to(status, shape), start, geometry)


def follow(legs: ArrayLike, geometry: Geometry, *, start: ArrayLike) -> tuple[Any, Any]:
    """Return the orientations along a motion: each is the mode nearest the one before.

    Parameters
    ----------
    legs : array_like (n, 3)
        Lengths of the legs, one row after the other.
    geometry : Geometry
        The machine.
    start : array_like (3, 3)
        Rotation matrix near the first orientation.

    Returns
    -------
    rotations : array (n, 3, 3)
        Rotation matrices; NaN without a mode. The next row is then compared with the last one found.
    status : array (n,) of int8
        Codes of :class:`DirectStatus`, as of :func:`direct`.

    Notes
    -----
    Where the motion passes a singular pose, two modes are equally near, and the legs do not determine which one a
    machine takes: AMBIGUOUS or SINGULAR marks such rows.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import three_sps_s
    >>> machine = three_sps_s.Geometry(2, 1, 1.5)
    >>> motion = three_sps_s.rotation_from_tilt_torsion(np.linspace(0, 3, 9), 0.3, 0.6)
    >>> found, status = three_sps_s.follow(three_sps_s.legs(motion, machine), machine, start=motion[0])
    >>> bool(abs(found - motion).max() < 1e-12), int(status.max())
    (True, 0)
    """
    now, _ = nearest_proper(start, "start")
    if now.shape != (3, 3):
        raise ValueError(f"start has the shape {now.shape}; expected (3, 3)")
    rotations, _, known = direct_all(legs, geometry)
    if rotations.ndim != 4:
        raise ValueError(f"legs has the shape {np.shape(legs)}; expected (n, 3)")
    followed, status = np.empty((len(rotations), 3, 3)), np.empty(len(rotations), np.int8)
    for n, modes in enumerate(rotations):
        followed[n], status[n] = _nearest(modes, known[n], now, geometry)
        if np.isfinite(followed[n, 0, 0]):
            now = followed[n]
    return followed, status


def _nearest(rotations: Any, status: Any, start: Any, geometry: Geometry) -> tuple[Any, Any]:
    """Return the one of modes (..., 8, 3, 3) nearest the start (..., 3, 3), and its status."""
    # |A - B|² = 4 (1 - cos angle) = 8 sin²(angle/2): good for small angles, which the trace is not
    apart = np.square(rotations - start[..., None, :, :]).sum(axis=(-2, -1))
    missing = np.isnan(apart)
    angle = 2 * np.arcsin(np.sqrt(np.clip(np.where(missing, 0.0, apart) / 8, 0, 1)))
    angle = np.where(missing, np.inf, angle)
    order = np.argsort(angle, axis=-1, kind="stable")
    chosen = np.take_along_axis(rotations, order[..., :1, None, None], axis=-3)[..., 0, :, :]
    nearest = np.take_along_axis(angle, order[..., :2], axis=-1)
    is_known = np.isfinite(nearest[..., 0])
    with np.errstate(invalid="ignore"):
        tie = is_known & (nearest[..., 1] - nearest[..., 0] <= SAME)
    safe = np.where(is_known[..., None, None], chosen, np.eye(3))
    determinant = kernels.sps_singularity(safe, geometry.R, geometry.h)
    known = is_known & (status != DirectStatus.INCOMPLETE)
    status = np.where(known, DirectStatus.CONVERGED, status)
    status = np.where(known & tie, DirectStatus.AMBIGUOUS, status)
    status = np.where(known & (np.abs(determinant) <= SINGULAR), DirectStatus.SINGULAR, status)
    status = np.where(np.isfinite(start).all(axis=(-2, -1)), status, DirectStatus.INVALID)
    chosen = np.where((status == DirectStatus.INVALID)[..., None, None], np.nan, chosen)
    return chosen, status.astype(np.int8)[()]


def _modes(legs: Any, geometry: Geometry) -> tuple[Any, Any, Any]:
    """Return quaternions (n, 8, 4), counts and statuses for legs (n, 3)."""
    with np.errstate(invalid="ignore"):
        valid = (np.isfinite(legs) & (legs >= 0)).all(axis=-1)
    # legs longer than all dimensions together have no mode, and their squares might not fit into a number
    longest = geometry.R + geometry.r + abs(geometry.h)
    reach = valid & (legs <= 2 * longest).all(axis=-1)
    safe = np.where(reach[:, None], legs, geometry.home_leg)
    modes, count, determinant = _distinct(*_polished(starts(safe, geometry), safe, geometry), safe, geometry)
    singular = (np.abs(determinant) <= SINGULAR).any(axis=-1)
    lopsided = reach & ~singular & (np.nansum(np.sign(determinant), axis=-1) != 0)
    if lopsided.any():
        rows = np.flatnonzero(lopsided)
        more = np.concatenate([modes[rows], np.broadcast_to(spread(), (len(rows), *spread().shape))], axis=1)
        again = _distinct(*_polished(more, safe[rows], geometry), safe[rows], geometry)
        modes[rows], count[rows], determinant[rows] = again
        singular = (np.abs(determinant) <= SINGULAR).any(axis=-1)
        lopsided = reach & ~singular & (np.nansum(np.sign(determinant), axis=-1) != 0)
    modes[~reach], count[~reach] = np.nan, 0
    status = np.select(
        [~valid, count == 0, lopsided, singular],
        [DirectStatus.INVALID, DirectStatus.NO_ASSEMBLY, DirectStatus.INCOMPLETE, DirectStatus.SINGULAR],
        DirectStatus.CONVERGED,
    )
    return modes, count, status


def _miss(quaternions: Any, legs: Any, geometry: Geometry) -> Any:
    """Return the error of half the squares of the legs, over the squares of the machine's dimensions."""
    R, r, h = geometry.lengths
    legs_there = kernels.sps_legs_from_quaternion(quaternions, R, r, h)
    size = R * R + r * r + h * h + np.square(legs).max(axis=-1)
    # divided first: the norm squares what it gets
    return np.linalg.norm((legs_there - legs) * (legs_there + legs) / size[..., None], axis=-1) / 2


def _polished(quaternions: Any, legs: Any, geometry: Geometry) -> tuple[Any, Any]:
    """Return starts (n, m, 4) polished to rotations with the legs; NaN where they do not converge."""
    n, m, _ = quaternions.shape
    flat = quaternions.reshape(-1, 4)
    miss = np.full(n * m, np.inf)
    active = np.flatnonzero(np.isfinite(flat[:, 0]))
    radius = np.full(len(active), 0.5)
    for _ in range(CALLS):
        if not len(active):
            break
        before, wanted = miss[active], legs[active // m]
        now, radius = kernels.sps_polish(flat[active], radius, wanted, *geometry.lengths)
        missed = _miss(now, wanted, geometry)
        flat[active], miss[active] = now, missed
        # done, or stuck: no better in four steps, and the steps are mere rounding
        going = (missed > SETTLED) & ((missed < before) | (radius > EPS))
        active, radius = active[going], radius[going]
    with np.errstate(invalid="ignore"):
        right = miss <= ROUNDING
    return np.where(right[:, None], flat, np.nan).reshape(n, m, 4), np.where(right, miss, np.inf).reshape(
        n, m
    )


def _distinct(quaternions: Any, miss: Any, legs: Any, geometry: Geometry) -> tuple[Any, Any, Any]:
    """Return each mode once, in order: (n, 8, 4), their number, and the normed determinants, NaN in empty slots."""
    n = len(quaternions)
    # the best comes first, and is kept of those that are the same
    order = np.argsort(miss, axis=-1, kind="stable")
    quaternions = np.take_along_axis(quaternions, order[..., None], axis=1)
    there = np.isfinite(quaternions[..., 0])
    width = max(1, int(there.sum(axis=-1).max(initial=0)))
    quaternions, there = quaternions[:, :width], there[:, :width]
    safe = np.where(there[..., None], quaternions, [1.0, 0, 0, 0])
    determinant = kernels.sps_singularity(kernels.matrix_from_quaternion(safe)[0], geometry.R, geometry.h)
    double = there & (np.abs(determinant) <= SINGULAR)
    is_new = np.zeros((n, width), bool)
    for i in range(width):
        same = np.zeros(n, bool)
        for j in range(i):
            same_sign = _of_same_sign(safe[:, j], safe[:, i])
            apart = 2 * np.linalg.norm(safe[:, i] - same_sign, axis=-1)
            both = is_new[:, j] & there[:, i]
            same |= both & (apart <= SAME)
            rows = np.flatnonzero(both & double[:, i] & double[:, j] & (apart > SAME) & (apart <= NEAR))
            if len(rows):
                half_way = (safe[rows, i] + same_sign[rows]) / 2
                same[rows] |= _is_mode(half_way, apart[rows] / 4, legs[rows], geometry)
        is_new[:, i] = there[:, i] & ~same
    w, x, y, z = np.moveaxis(safe, -1, 0)
    positive = np.where(
        (w < 0) | ((w == 0) & ((z < 0) | ((z == 0) & ((x < 0) | ((x == 0) & (y < 0)))))), -1.0, 1.0
    )
    safe = safe * positive[..., None]
    # rounded, so that equal angles are in the order of their torsions, not of their rounding errors
    keys = np.where(is_new[..., None], np.round(safe, 9), -2.0)
    order = np.lexsort((-keys[..., 2], -keys[..., 1], -keys[..., 3], -keys[..., 0]), axis=-1)
    safe = np.take_along_axis(safe, order[..., None], axis=1)
    is_new = np.take_along_axis(is_new, order, axis=1)
    modes, determinants = np.full((n, MODES, 4), np.nan), np.full((n, MODES), np.nan)
    width = min(width, MODES)
    modes[:, :width] = np.where(is_new[:, :width, None], safe[:, :width], np.nan)
    ordered = np.take_along_axis(determinant, order, axis=1)[:, :width]
    determinants[:, :width] = np.where(is_new[:, :width], ordered, np.nan)
    return modes, is_new[:, :width].sum(axis=-1).astype(np.int8), determinants


def _is_mode(quaternions: Any, within: Any, legs: Any, geometry: Geometry) -> Any:
    """Return whether there is a mode near rotations, not farther off than `within`."""
    polished, _ = kernels.sps_polish(quaternions, within / 4, legs, *geometry.lengths)
    moved = 2 * np.linalg.norm(polished - _of_same_sign(quaternions, polished), axis=-1)
    return (moved <= within) & (_miss(polished, legs, geometry) <= ROUNDING)


def _of_same_sign(quaternions: Any, others: Any) -> Any:
    """Return quaternions (n, 4), or their negatives where these are nearer to the others."""
    return np.where((quaternions * others).sum(axis=-1) < 0, -1.0, 1.0)[:, None] * quaternions
