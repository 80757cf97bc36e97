"""The physics of parts: discs, gears, screws, play, beams, heat, and air, as functions of arrays.

Lengths are in mm, angles in rad, times in s, weights in N. Nothing here knows a formula of rodgen's catalogue: an
eccentric disc is a disc that is seen by a head at its edge, a worm gear is a flank that moves on another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Array = Any  # of float
ARCSEC = np.pi / 180 / 3600


def rotation(vectors: Array) -> Array:
    """Return the matrices of rotation vectors (…, 3), by Rodrigues' formula."""
    vectors = np.asarray(vectors, float)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], -1).reshape(*x.shape, 3, 3)
    half = np.sinc(angle / 2 / np.pi)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + half**2 / 2 * (cross @ cross)


def rotation_vector(matrices: Array) -> Array:
    """Return the rotation vectors (n, 3) of matrices (n, 3, 3), by their quaternions."""
    trace = np.trace(matrices, axis1=1, axis2=2)
    outer = np.empty((len(matrices), 4, 4))  # four times the quaternion times itself, w first
    skew = np.stack([matrices[:, k, j] - matrices[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], -1)
    outer[:, 0, 0] = 1 + trace
    outer[:, 0, 1:] = outer[:, 1:, 0] = skew
    outer[:, 1:, 1:] = matrices + np.swapaxes(matrices, 1, 2) + (1 - trace)[:, None, None] * np.eye(3)
    best = outer[np.arange(len(outer)), np.argmax(np.einsum("nii->ni", outer), 1)]
    best = best / np.linalg.norm(best, axis=1)[:, None] * np.where(best[:, :1] < 0, -1, 1)
    length = np.linalg.norm(best[:, 1:], axis=1)
    angle = 2 * np.arctan2(length, best[:, 0])
    return best[:, 1:] * (angle / np.maximum(length, 1e-300))[:, None]


# -- encoders: how far the shaft stands from what is read -----------------------------------------------------------


def inverse_of(reading: Callable[[Array], Array], q: Array) -> Array:
    """Return the true angles less q at which an encoder reads q."""
    true = q.copy()
    for _ in range(6):
        true = true + q - reading(true)
    return true - q


def eccentric_disc(q: Array, radius: float, eccentricity: float, phase: float) -> Array:
    """Return by how much a shaft is ahead of its encoder, whose graduation has its centre beside the axis.

    The head stands still at (radius, 0). In axes of the disc it moves round, and the line that it sees is that in its
    direction from the centre of the graduation.
    """

    def reading(true: Array) -> Array:
        x = radius * np.cos(true) - eccentricity * np.cos(phase)
        y = -radius * np.sin(true) - eccentricity * np.sin(phase)
        lines = -np.arctan2(y, x)
        return true + (lines - true + np.pi) % (2 * np.pi) - np.pi

    return inverse_of(reading, q)


def oval_disc(q: Array, strain: float, phase: float) -> Array:
    """Return the same of a disc that is pressed oval: longer by strain along phase, shorter across it."""

    def reading(true: Array) -> Array:
        seen = -true - phase  # direction of the head in the disc, from the long axis
        line = np.arctan2(np.sin(seen) / (1 - strain), np.cos(seen) / (1 + strain)) + phase
        return true + (-line - true + np.pi) % (2 * np.pi) - np.pi

    return inverse_of(reading, q)


# -- drives --------------------------------------------------------------------------------------------------------


def eccentric_pinion(q: Array, teeth: int, ratio: int, module: float, runout: float, phase: float) -> Array:
    """Return the transmission error of involute gears, of which the pinion turns about a point beside its centre.

    Involutes touch along the common tangent of their base circles, as if a string were wound from one to the other:
    what the pinion unwinds is what the wheel winds, and what the changing tangent takes.
    """
    pressure = np.deg2rad(20)
    small, large = (module * n * np.cos(pressure) / 2 for n in (teeth, teeth * ratio))
    centres = module * teeth * (1 + ratio) / 2
    turn = ratio * q + phase
    x, y = centres - runout * np.cos(turn), -runout * np.sin(turn)
    distance, direction = np.hypot(x, y), np.arctan2(y, x)
    base = small + large
    lost = base * (direction - np.arccos(base / distance)) + np.sqrt(distance**2 - base**2)
    none = np.sqrt(centres**2 - base**2) - base * np.arccos(base / centres)
    return -(lost - none) / large


def eccentric_worm(q: Array, teeth: int, module: float, runout: float, phase: float) -> Array:
    """Return the error of a worm gear whose worm runs out: its flank is a helicoid about a moving centre."""
    pressure, radius = np.deg2rad(20), 5 * module
    turn = teeth * q + phase
    x, y = radius - runout * np.cos(turn), -runout * np.sin(turn)
    axial = module / 2 * -np.arctan2(y, x) + np.tan(pressure) * (np.hypot(x, y) - radius)
    return axial / (module * teeth / 2)


def strain_wave(q: Array, ratio: int, wave: float, phase: float) -> Array:
    """Return the error of a harmonic drive: the generator meets the teeth on two sides in each of its turns."""
    turn = ratio * q + phase
    return wave * (np.sin(2 * turn) + 0.1 * np.sin(4 * turn + 1))


def wobbling_screw(q: Array, lead: float, runout: float, phase: float) -> Array:
    """Return how far a nut is ahead, whose screw runs with its collar on a thrust bearing that is not square.

    The collar and its seat are both tilted: the gap at the point where they touch closes once in each turn.
    """
    turn = 2 * np.pi * q / lead + phase
    return runout * np.sqrt(1 + 0.05**2 + 2 * 0.05 * np.cos(turn)) / 0.1 - runout * 10


def play(path: Array, width: Array) -> Array:
    """Return where a part stands that friction holds, pushed along a path (k,) through a play."""
    width = np.broadcast_to(width, path.shape) / 2
    stands = np.empty_like(path)
    last = path[0]
    for k, (u, half) in enumerate(zip(path, width, strict=True)):
        stands[k] = last = min(max(last, u - half), u + half)
    return stands


# -- structures ----------------------------------------------------------------------------------------------------


def cantilever(overhang: Array, force: float, weight: float, stiffness: float) -> tuple[Array, Array]:
    """Return drop and slope at the end of a beam: a force there, a weight per length, and E·I (N, N/mm, N·mm²)."""
    a = overhang
    drop = force * a**3 / 3 + weight * a**4 / 8
    slope = force * a**2 / 2 + weight * a**3 / 6
    return drop / stiffness, slope / stiffness


def bridge(x: Array, span: float, force: float, stiffness: float) -> tuple[Array, Array]:
    """Return drop and slope under a force at x on a beam on two supports."""
    y = span - x
    return force * x**2 * y**2 / (3 * stiffness * span), force * x * y * (y - x) / (3 * stiffness * span)


def rail(x: Array, supports: Array, heights: Array) -> tuple[Array, Array]:
    """Return height and slope of a rail that lies on supports: a thin beam, so a cubic spline without end moments."""
    step = np.diff(supports)
    n = len(supports)
    a, b = np.eye(n), np.zeros(n)
    for i in range(1, n - 1):
        a[i, i - 1 : i + 2] = step[i - 1] / 6, (step[i - 1] + step[i]) / 3, step[i] / 6
        b[i] = (heights[i + 1] - heights[i]) / step[i] - (heights[i] - heights[i - 1]) / step[i - 1]
    bend = np.linalg.solve(a, b)
    i = np.clip(np.searchsorted(supports, x) - 1, 0, n - 2)
    h, right = step[i], x - supports[i]
    left = h - right
    height = (bend[i] * left**3 + bend[i + 1] * right**3) / (6 * h)
    height = (
        height
        + (heights[i] / h - bend[i] * h / 6) * left
        + (heights[i + 1] / h - bend[i + 1] * h / 6) * right
    )
    slope = (bend[i + 1] * right**2 - bend[i] * left**2) / (2 * h) + (heights[i + 1] - heights[i]) / h
    return height, slope - (bend[i + 1] - bend[i]) * h / 6


# -- surroundings --------------------------------------------------------------------------------------------------


def warming(t: Array, power: Array, rise: float, tau: float) -> Array:
    """Return by how much a part is warmer: heated by power (as a share, constant between times), cooled by the air."""
    warmer = np.zeros(len(t))
    for k in range(1, len(t)):
        stays = np.exp(-(t[k] - t[k - 1]) / tau)
        warmer[k] = warmer[k - 1] * stays + rise * power[k] * (1 - stays)
    return warmer


def wander(t: Array, tau: float, columns: int, random: np.random.Generator) -> Array:
    """Return Ornstein-Uhlenbeck processes (n, columns) with a variance of 1, of which errors last about tau."""
    steps = random.standard_normal((len(t), columns))
    for k in range(1, len(t)):
        stays = np.exp(-(t[k] - t[k - 1]) / tau)
        steps[k] = steps[k - 1] * stays + steps[k] * np.sqrt(1 - stays**2)
    return steps


def air(zenith: Array, density: float = 1.0) -> Array:
    """Return by how much light that is seen at a zenith angle was bent: Snell's law from shell to shell of air.

    The density falls by e in 8 km; at the ground the index of refraction is 1.000277 at a density of 1.
    """
    height = np.linspace(0, 80e3, 161)
    index = 1 + 2.77e-4 * density * np.exp(-height / 8e3)
    radius = 6371e3 + height
    invariant = index[0] * radius[0] * np.sin(zenith)[:, None]
    before = np.arcsin(invariant / (index[:-1] * radius[1:]))
    after = np.arcsin(invariant / (index[1:] * radius[1:]))
    return (after - before).sum(1)
