"""The poses of a closed chain's platform on the nominal machine, from the lengths of its legs."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import RodgenError
from rodgen.machines._rigid import rotation_matrix
from rodgen.machines.closed_chain import ClosedChain

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
    from rodgen import tricept

    pose, _ = tricept.direct(legs, tricept.Geometry(geometry.R, geometry.r, geometry.q))
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
    from rodgen import three_sps_s

    turns = three_sps_s.direct_all(legs, three_sps_s.Geometry(geometry.R, geometry.r, geometry.h))[0]
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
    angles = np.radians(list(geometry.of.legs.values()))
    across = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    if geometry.family == "tricept":
        alpha, beta, z = starts.T
        ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
        zero = np.zeros_like(z)
        turn = np.array([[cb, -sb * sa, sb * ca], [zero, ca, sa], [-sb, -cb * sa, cb * ca]]).transpose(
            2, 0, 1
        )
        arms = np.einsum("nij,kj->nki", turn, geometry.r * across) + (turn[:, :, 2] * z[:, None])[:, None]
        legs = _unit(arms - geometry.R * across)
        moments = np.cross(arms, legs) / geometry.R
        about = np.stack([cb, zero, -sb], axis=1)
        slide = np.einsum("nki,ni->nk", legs, turn[:, :, 2])
        rows = np.stack([np.einsum("nki,ni->nk", moments, about), moments[:, :, 1], slide], axis=2)
    else:
        arms, along = _joints(geometry, starts.reshape(-1, 3, 3))
        legs = _unit(along)
        rows = np.cross(arms, legs) / geometry.r
    found = np.full(len(rows), np.nan)
    known = np.isfinite(rows).all(axis=(1, 2))
    found[known] = np.linalg.svd(rows[known], compute_uv=False)[:, -1]
    return found


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _joints(geometry: ClosedChain, turns: Array) -> tuple[Array, Array]:
    """Return the joints on the platform from the pivot, and the legs as vectors, of a 3-sps-s, (n, 3, 3) each."""
    angles = np.radians(list(geometry.of.legs.values()))
    across = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    arms = np.einsum("nij,kj->nki", turns, geometry.r * across)
    return arms, arms + np.array([0.0, 0.0, geometry.h]) - geometry.R * across


def legs_at(geometry: ClosedChain, turns: Array) -> Array:
    """Return the lengths of the legs of a 3-sps-s, (n, 3), at rotations, (n, 3, 3)."""
    return np.asarray(np.linalg.norm(_joints(geometry, turns)[1], axis=2))


def found_from(geometry: ClosedChain, begins: Array, legs: Array, steps: int) -> Array:
    """Return the rotations, (n, 3, 3), that Newton's steps find from the one of some whose legs are the nearest.

    Parameters
    ----------
    geometry : ClosedChain
        A 3-sps-s.
    begins : ndarray, shape (k, 3, 3)
    legs : ndarray, shape (n, 3)
    steps : int
    """
    apart = np.sum((legs[:, None] - legs_at(geometry, begins)) ** 2, axis=2)
    turns = begins[np.argmin(apart, axis=1)]
    with np.errstate(all="ignore"):
        for _ in range(steps):
            arms, along = _joints(geometry, turns)
            gap = (np.sum(along**2, axis=2) - legs**2) / 2
            slopes = np.cross(arms, along)
            slopes[~np.isfinite(np.linalg.cond(slopes))] = np.nan
            half = -np.linalg.solve(slopes, gap[:, :, None])[:, None, :, 0] / 2
            columns = turns.swapaxes(1, 2)
            across = np.cross(half, columns)
            factor = 2 / (1 + np.sum(half**2, axis=2, keepdims=True))
            turns = (columns + factor * (across + np.cross(half, across))).swapaxes(1, 2)
    return np.asarray(turns)


def usual_leg(geometry: ClosedChain, leg: int) -> tuple[float, float]:
    """Return lengths of a leg around the middle of where the machine works, for want of its travel.

    Parameters
    ----------
    geometry : ClosedChain
    leg : int
        Its number.
    """
    angle = np.radians(list(geometry.of.legs.values())[leg])
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    if geometry.family == "tricept":
        joint = geometry.r * across + np.array([0.0, 0.0, 2 * geometry.R])
    else:
        turn = np.eye(3) if geometry.start is None else rotation_matrix(geometry.start)
        joint = turn @ (geometry.r * across) + np.array([0.0, 0.0, geometry.h])
    length = float(np.linalg.norm(joint - geometry.R * across))
    return (1 - AROUND) * length, (1 + AROUND) * length
