"""The best values of what a term is searched for: periods, places, widths, time constants.

Around the value on the coarse grid neighbours are tried, ever nearer, all of a round at once. At the end as many digits
are written as the data determine.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.diagnose.forms.dictionary import (
    DECAYS,
    HARMONICS,
    LEAST_WAVES,
    PLACES,
    WIDTHS,
    Term,
)
from rodgen.calibration.diagnose.forms.projected_rows import ProjectedRows
from rodgen.data.drivers import Driver
from rodgen.statistics.thresholds import FORMS

ROUNDS, LAST_ROUNDS = 10, 5
ROUNDING = 1e-9
"""Relative difference of falls that are the same: those of a step are, anywhere between two coordinates of the data."""
DIGITS = 9


def refined(
    projected: ProjectedRows, term: Term, sensitivity: int, drivers: Sequence[Driver], *, last: bool = False
) -> Term:
    """Return a term with its searched values where it lowers the sum of squares most.

    Parameters
    ----------
    term : Term
        With values from the coarse grid, or, as the `last` of two searches, with those of one on fewer rows.
    """
    if not term.searched:
        return term
    radius = np.array(list(_radii(term, drivers)))
    rounds = LAST_ROUNDS if last else ROUNDS
    return _climbed(
        projected, term, sensitivity, drivers, radius / 2 ** (ROUNDS - 3) if last else radius, rounds
    )


def _radii(term: Term, drivers: Sequence[Driver]) -> Iterator[float]:
    """Yield half the distance to the next value on the coarse grid; logarithms of widths and times."""
    for factor in term.factors:
        driver = drivers[factor.driver]
        match factor.kind:
            case "wave":
                yield 0.25 * 2 * np.pi / driver.span
            case "step" | "kink":
                yield 0.6 * driver.span / PLACES
            case "bump":
                yield 0.6 * factor.values[1] / 0.75
                yield 0.6 * np.log(WIDTHS[0] / WIDTHS[-1])
            case "decay":
                yield 0.6 * np.log(90) / (DECAYS - 1)


def _limits(term: Term, drivers: Sequence[Driver]) -> Iterator[tuple[float, float]]:
    for factor in term.factors:
        driver = drivers[factor.driver]
        low, high = driver.low, driver.low + driver.span
        match factor.kind:
            case "wave":
                yield 2 * np.pi / driver.span * LEAST_WAVES, np.inf
            case "step" | "kink":
                yield low, high
            case "bump":
                yield low - driver.span / 10, high + driver.span / 10
                yield driver.span / 100, driver.span / 2
            case "decay":
                yield driver.span / 200, driver.span * 10


def _logarithmic(term: Term) -> list[bool]:
    return [
        (factor.kind == "bump" and k == 1) or factor.kind == "decay"
        for factor in term.factors
        for k in range(len(factor.values))
    ]


def _climbed(
    projected: ProjectedRows,
    term: Term,
    sensitivity: int,
    drivers: Sequence[Driver],
    radius: Array,
    rounds: int,
) -> Term:
    logs = np.array(_logarithmic(term))
    low, high = np.array(list(_limits(term, drivers))).T
    x = np.where(logs, np.log(np.maximum(term.searched, 1e-300)), term.searched)
    low, high = (np.where(logs, np.log(np.maximum(bound, 1e-300)), bound) for bound in (low, high))
    offsets = np.array(list(itertools.product((0.0, -1.0, -0.5, 0.5, 1.0), repeat=len(x))))
    for _ in range(rounds):
        tried = np.clip(x + offsets * radius, low, high)
        values = np.where(logs, np.exp(np.where(logs, tried, 0.0)), tried)
        terms = [term.with_values([float(v) for v in row]) for row in values]
        falls = projected.falls(terms, sensitivity)
        best = int(np.argmax(falls >= falls.max() * (1 - ROUNDING)))
        x, term = tried[best], terms[best]
        radius = np.where(np.abs(offsets[best]) == 1.0, radius, radius / 2)
    return term


def short(projected: ProjectedRows, term: Term, sensitivity: int, drivers: Sequence[Driver]) -> Term:
    """Return the term with values of as few digits as the data determine; a whole number of waves is a harmonic."""
    if not term.searched:
        return term
    tried = [_rounded(term, digits, drivers) for digits in range(1, DIGITS + 1)]
    falls = projected.falls([*tried, term], sensitivity)
    lost = FORMS.lost * projected.total / max(projected.dof, 1)
    chosen = next((t for t, fall in zip(tried, falls, strict=False) if falls[-1] - fall < lost), term)
    factors = []
    for factor in chosen.factors:
        driver = drivers[factor.driver]
        whole = factor.kind == "wave" and driver.revolute and float(factor.values[0]).is_integer()
        if whole and 1 <= factor.values[0] <= HARMONICS:
            factor = replace(factor, kind="harmonic", order=int(factor.values[0]), values=())
        factors.append(factor)
    return replace(chosen, factors=tuple(factors))


def _rounded(term: Term, digits: int, drivers: Sequence[Driver]) -> Term:
    values: list[float] = []
    for factor in term.factors:
        driver = drivers[factor.driver]
        if factor.kind == "wave" and not driver.revolute:
            values.append(2 * np.pi / float(f"{2 * np.pi / factor.values[0]:.{digits}g}"))
        elif factor.kind in {"wave", "decay"}:
            values.append(float(f"{factor.values[0]:.{digits}g}"))
        elif factor.values:  # a place has decimals relative to the range
            decimals = digits - 1 - int(np.floor(np.log10(driver.span)))
            values.append(round(factor.values[0], decimals) + 0.0)
            values += [float(f"{width:.{digits}g}") for width in factor.values[1:]]
    return term.with_values(values)
