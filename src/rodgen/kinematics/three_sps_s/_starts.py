"""Starting values of Newton's method for every rotation of a 3-SPS-S machine with given legs.

Roots of the scaled octic, as eigenvalues of its companion matrix, and a few more where its roots are rough: see
:mod:`rodgen.kinematics.three_sps_s._direct`. An unnecessary start only costs time.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.polynomials import roots
from rodgen.kinematics.three_sps_s._geometry import Geometry

COMPLEX = 0.1
"""Imaginary part of a root, over its size, up to which it may be a real one: eight roots in one lose all but an eighth
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
    found = [_from_roots(_nearly_real(octic), legs, geometry)]
    rows = np.abs(phase_sine) <= NEARLY_SQUARE
    if rows.any():
        some = np.full((len(legs), 8, 4), np.nan)
        some[rows] = _from_roots(_nearly_real(quartic[rows]), legs[rows], geometry)
        found.append(some)
    eta = geometry.h / geometry.R
    cos_sum, Z = kernels.sps_invariants(legs, *geometry.lengths)
    Z = Z[..., 0] + 1j * Z[..., 1]
    rows = size <= NEARLY_EQUAL * 4 * abs(eta)
    if rows.any():
        with np.errstate(divide="ignore", invalid="ignore"):  # a pivot at h = 0 has no such modes
            found.append(np.where(rows[:, None, None], _torsions(cos_sum, Z, eta), np.nan))
    if abs(eta) <= FLAT:
        found.append(_flat(cos_sum, Z))
    return np.concatenate(found, axis=1)


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
    found = roots(coefficients)
    return np.where(np.abs(found.imag) <= COMPLEX * (1 + np.abs(found.real)), found.real, np.nan)


def _from_roots(found: Any, legs: Any, geometry: Geometry) -> Any:
    """Return both rotations of each root (n, m): (n, 2m, 4); only one where the other's legs are clearly worse."""
    arguments = legs[:, None, None], *geometry.lengths, found[..., None], np.array([1.0, -1.0])
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
