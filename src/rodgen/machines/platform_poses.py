"""The poses of a closed chain's platform on the nominal machine, from the lengths of its legs."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import rodgen  # its subjects are imported when a closed chain first asks for them
from rodgen.errors import RodgenError
from rodgen.kinematics.rotation import matrix_from_rodrigues_vector
from rodgen.machines.closed_chain import FROM_AFAR, ClosedChain
from rodgen.machines.rigid import rotation_matrix

__all__ = [
    "assembly_modes",
    "found_from",
    "holding",
    "legs_at",
    "physical_pose",
    "placed_at",
    "usual_leg",
]

Array: TypeAlias = NDArray[np.float64]

AROUND = 0.05
"""Part of its usual length by which a leg is taken to change, either way."""


def physical_pose(geometry: ClosedChain, legs: Array) -> Array:
    """Return the pose of a family that counts one of its assembly modes as the physical one.

    Parameters
    ----------
    geometry : ClosedChain
        A tricept.
    legs : ndarray, shape (n, 3)

    Returns
    -------
    ndarray, shape (n, 3)
        alpha, beta, z with all their cosines and z positive; NaN where there is no such pose.
    """
    pose, _ = rodgen.tricept.direct(legs, _tricept(geometry))
    return np.asarray(pose)


def assembly_modes(geometry: ClosedChain, legs: Array) -> Array:
    """Return all poses of a family whose platform turns about a pivot.

    Parameters
    ----------
    geometry : ClosedChain
        A 3-sps-s.
    legs : ndarray, shape (n, 3)

    Returns
    -------
    ndarray, shape (n, 8, 3, 3)
        Rotation matrices; NaN beyond those that there are.
    """
    turns = rodgen.three_sps_s.direct_all(legs, _pivot(geometry))[0]
    return np.asarray(turns)


def placed_at(geometry: ClosedChain, poses: Array, targets: Array) -> Array:
    """Return where targets are on the nominal machine.

    Parameters
    ----------
    geometry : ClosedChain
        A 3-sps-s.
    poses : ndarray, shape (..., 3, 3)
    targets : ndarray, shape (..., 3)
        In platform axes.
    """
    if geometry.family != "3-sps-s":
        raise RodgenError(f"a {geometry.family} has one physical assembly mode")
    return np.asarray(np.einsum("...ij,...j->...i", poses, targets) + np.array([0.0, 0.0, geometry.h]))


def holding(geometry: ClosedChain, starts: Array) -> Array:
    """Tell how well the legs hold the platform: about 1 at best, 0 in a singular pose.

    Parameters
    ----------
    geometry : ClosedChain
    starts : ndarray, shape (n, k)
        Poses, as a model starts from them.

    Returns
    -------
    ndarray, shape (n,)
        The least singular value of how the lengths of the legs change with what the platform is free to do. A turn by
        one radian counts as a way of the joints' distance from where it turns about.
    """
    if geometry.family != "tricept":
        gains = rodgen.three_sps_s.singularity(starts.reshape(-1, 3, 3), _pivot(geometry)).gains
        return np.asarray(gains[:, -1] / geometry.r)
    found = rodgen.tricept.matrices(starts, _tricept(geometry))
    # W33 d(pose) + W35 d(rods, radii) = 0
    slopes = np.linalg.solve(found.W35[..., :3], -found.W33) / np.array([geometry.R, geometry.R, 1.0])
    good = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
    gains = np.linalg.svd(np.where(good[:, None, None], slopes, 0.0), compute_uv=False)
    return np.where(good, gains[:, -1], np.nan)


def legs_at(geometry: ClosedChain, turns: Array) -> Array:
    """Return the lengths of the legs of a 3-sps-s, (n, 3), at rotations, (n, 3, 3)."""
    return np.asarray(rodgen.three_sps_s.legs(turns, _pivot(geometry)))


def found_from(geometry: ClosedChain, begins: Array, legs: Array) -> Array:
    """Return the rotations, (n, 3, 3), that emitted code finds: from the one of some whose legs are the nearest.

    Parameters
    ----------
    geometry : ClosedChain
        A 3-sps-s.
    begins : ndarray, shape (k, 3, 3)
    legs : ndarray, shape (n, 3)
    """
    apart = np.sum((legs[:, None] - legs_at(geometry, begins)) ** 2, axis=2)
    turns = begins[np.argmin(apart, axis=1)]
    with np.errstate(all="ignore"):
        for _ in range(FROM_AFAR):
            now = legs_at(geometry, turns)
            slopes = now[:, :, None] * rodgen.three_sps_s.jacobian(turns, _pivot(geometry))
            slopes[~np.isfinite(np.linalg.cond(slopes))] = np.nan
            step = -np.linalg.solve(slopes, (now**2 - legs**2)[:, :, None] / 2)[:, :, 0]
            turns = matrix_from_rodrigues_vector(step)[0] @ turns
    return np.asarray(turns)


def usual_leg(geometry: ClosedChain, leg: int) -> tuple[float, float]:
    """Return lengths of a leg around the middle of where the machine works, for want of its travel.

    Parameters
    ----------
    geometry : ClosedChain
    leg : int
        Its number.
    """
    if geometry.family == "tricept":
        lengths = rodgen.tricept.legs([0.0, 0.0, 2 * geometry.R], _tricept(geometry))
    else:
        lengths = legs_at(geometry, np.eye(3) if geometry.start is None else rotation_matrix(geometry.start))
    length = float(lengths[leg])
    return (1 - AROUND) * length, (1 + AROUND) * length


def _tricept(geometry: ClosedChain) -> rodgen.tricept.Geometry:
    return rodgen.tricept.Geometry(geometry.R, geometry.r, geometry.q)


def _pivot(geometry: ClosedChain) -> rodgen.three_sps_s.Geometry:
    return rodgen.three_sps_s.Geometry(geometry.R, geometry.r, geometry.h)
