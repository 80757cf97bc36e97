"""One axis as it is measured: an angle or a distance, with what drives, resolvers, screws and servos really do.

Nothing of rodgen is used: signals of a resolver are made and evaluated by the arc tangent, play has a memory, a servo
is integrated in time, a screw has a profile of its pitch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray[Any, np.dtype[np.float64]]
ARCSEC = 1 / 3600
"""In degrees."""


def to_and_fro(low: float, high: float, steps: int) -> Array:
    """Return positions on the way there and back; beyond the last one the axis reverses."""
    way = np.linspace(low, high, steps)
    return np.concatenate([way, way[-2::-1]])


def resolver(
    turn: Array,
    *,
    offset: complex = 0,
    unequal: float = 0,
    skew: float = 0,
    third: float = 0,
    seventh: float = 0,
) -> Array:
    """Return the angle that a resolver reads, degrees, for angles of its shaft, degrees.

    Offsets of its signals make a wave a turn, unequal amplitudes or a phase that is not 90 degrees two, their third
    harmonic four, and the seventh eight.
    """
    phi = np.radians(turn)
    cosine = np.cos(phi) + offset.real + third * np.cos(3 * phi) + seventh * np.cos(7 * phi)
    sine = (
        (1 + unequal) * np.sin(phi + skew) + offset.imag - third * np.sin(3 * phi) - seventh * np.sin(7 * phi)
    )
    return np.degrees(np.arctan2(sine, cosine)) % 360


def encoder(turn: Array, *, off_centre: float, azimuth: float = 30.0) -> Array:
    """Return the angle that one head reads on a disc that is off the axis by a part of its radius, degrees."""
    phi = np.radians(turn)
    at = np.exp(1j * phi) + off_centre * np.exp(1j * np.radians(azimuth))
    return np.degrees(np.angle(at)) % 360


def with_play(commands: Array, play: float) -> Array:
    """Return where a table stands whose drive has play: it moves when a flank touches."""
    at = np.empty(len(commands))
    place = commands[0] - play  # the first approach comes from below
    for k, q in enumerate(commands):
        place = min(max(place, q - play), q)
        at[k] = place
    return at + play / 2


def servo(
    q: Array, t: Array, *, natural: float, damping: float = 1.0, forward: float = 0.0
) -> tuple[Array, Array, Array]:
    """Return the position of a servo axis that follows set points, and the set speed and acceleration.

    ``e'' + 2 d w e' + w² e = q'' + 2 d w (1 - forward) q'`` for the error e = q - position: integrated in steps of
    the time table. `forward` is the part of the speed that is fed forward.
    """
    v = np.gradient(q, t)
    a = np.gradient(v, t)
    error, rate, at = 0.0, 0.0, np.empty(len(q))
    for k in range(len(q)):
        step = t[1] - t[0]
        push = a[k] + 2 * damping * natural * (1 - forward) * v[k]
        rate += step * (push - 2 * damping * natural * rate - natural**2 * error)
        error += step * rate
        at[k] = q[k] - error
    return at, v, a


def moves(random: np.random.Generator, reach: float) -> tuple[Array, Array]:
    """Return times, in steps of 0.1 ms, and set points of ten moves from place to place, each of least jerk."""
    parts, at = [], 0.0
    for _ in range(10):
        steps, goal = int(1e4 * random.uniform(0.5, 1.5)), random.uniform(-reach, reach)
        part = np.arange(steps) / steps
        parts.append(at + (goal - at) * part**3 * (10 - 15 * part + 6 * part**2))
        at = goal
    q = np.concatenate(parts)
    return 1e-4 * np.arange(len(q)), q


def pitch(q: Array, size: float, lead: float) -> Array:
    """Return the error of a screw whose nut or bearing wobbles once a turn."""
    return size * np.sin(2 * np.pi * q / lead + 0.4)


ISO = np.array([36.0, 253.0, 497.0, 761.0, 948.0])
"""Target positions of ISO 230-2 on an axis of a metre, not at even distances, mm."""


def bidirectional(positions: Array, runs: int = 5) -> tuple[Array, NDArray[np.int_], list[str]]:
    """Return positions, directions of approach and runs of a test by ISO 230-2: up and down, so many times."""
    way = np.concatenate([positions, positions[::-1]])
    side = np.repeat([1, -1], len(positions))
    return np.tile(way, runs), np.tile(side, runs), [str(k // len(way) + 1) for k in range(runs * len(way))]
