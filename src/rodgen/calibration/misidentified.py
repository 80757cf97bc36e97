"""Stars of a pointing run that were taken for others: rows that saw the star of another row, or give its place."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.fitted import Fit
from rodgen.data.measurements import Measurements
from rodgen.data.units import ARCSEC
from rodgen.machines.mounts import mount_of
from rodgen.machines.observations import Observations
from rodgen.statistics.thresholds import COST, EVIDENCE


def elsewhere(count: int, variance: float) -> float:
    """Return the squared error, in standard deviations, from which a star of a run lies elsewhere on the sphere.

    The star of one of n rows lies by the error of a component, σ, from where the telescope points, another one
    anywhere: the first is likelier by 2/(n σ²) exp(-r²/2σ²), with r the distance, rad.

    Parameters
    ----------
    count : int
        n, of rows.
    variance : float
        σ², rad².
    """
    return 2 * math.log(2 / (count * variance))


def on_stars(o: Observations, at: Array, rows: Mask, variance: float) -> str:
    """Return which stars were taken for others, as a clause; empty where none were.

    Parameters
    ----------
    o : Observations
        Of a mount: the readings are where the stars are.
    at : ndarray, shape (n, 3)
        Where the telescope points.
    rows : ndarray of bool, shape (n,)
        Those that are wrong.
    variance : float
        Of a component of the others, rad².
    """
    saw, gives = _nearest(o.reading, at, rows, variance), _nearest(o.reading, o.reading, rows, variance)
    # a star that is logged again is the same star
    width = EVIDENCE.same_position * np.ptp(o.q, axis=0)
    gives = {row: star for row, star in gives.items() if np.any(np.abs(o.q[row] - o.q[star]) > width)}
    clauses = [*_clauses(o.data, saw, gives)]
    return f"stars were misidentified: {'; '.join(clauses)}" if clauses else ""


def on_misidentified(fit: Fit, rows: Mask) -> str:
    """Return the clause of `on_stars` on the rows that a fit of a mount leaves out; empty of other machines."""
    if mount_of(fit.machine) is None or fit.observations.blocks is not None or not rows.any():
        return ""
    at = fit.problem.places(fit.solution.theta, fit.solution.frame)
    return on_stars(fit.observations, at, rows, (fit.rms * ARCSEC) ** 2)


def _nearest(seen: Array, at: Array, rows: Mask, variance: float) -> dict[int, int]:
    """Return by row the other row whose star is at a place, where it is likelier there than elsewhere."""
    nearest = {}
    for row in np.flatnonzero(rows).tolist():
        square = np.sum((seen - at[row]) ** 2, axis=1)
        square[row] = np.inf
        star = int(np.argmin(square))
        if elsewhere(len(seen), variance) - square[star] / variance > COST.something:
            nearest[row] = star
    return nearest


def _clauses(data: Measurements, saw: dict[int, int], gives: dict[int, int]) -> Iterator[str]:
    known = {*saw}
    for row, star in [*saw.items()]:
        if row < star and saw.get(star) == row:
            yield f"{data.place(row)} and {data.place(star)} have each other's stars"
            del saw[row], saw[star]
    steps = {star - row for row, star in saw.items()}
    if len(saw) > 1 and steps in ({1}, {-1}):
        which = "next" if steps == {1} else "previous"
        ends = f"from {data.place(min(saw))} to {data.place(max(saw))}"
        yield f"{len(saw)} rows {ends} saw the star of the {which} row, as where a list of stars is shifted"
        saw = {}
    yield from (f"{data.place(row)} saw the star of {data.place(star)}" for row, star in saw.items())
    for row, star in gives.items():
        if row not in known:
            yield f"{data.place(row)} gives the star of {data.place(star)}, at which it does not point"
