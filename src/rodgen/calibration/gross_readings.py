"""Readings that are grossly wrong, and outliers that were taken out: which they are, and how far they are off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.calibration.fitted import Fit
from rodgen.calibration.misidentified import on_misidentified
from rodgen.calibration.reading_motion import motion_with_reading
from rodgen.calibration.rows import Rows, wrong_rows
from rodgen.calibration.words import capitalized, in_component, sized
from rodgen.data.set_aside import rows_text
from rodgen.errors import counted
from rodgen.machines.observations import Observations
from rodgen.views import with_html

NAMED = 8
"""Readings whose errors a sentence gives."""


@with_html
@dataclass(frozen=True)
class GrossReading:
    """A reading that is grossly wrong.

    Attributes
    ----------
    row : int
        From 0, of the observations.
    component : str
        The component that is the farthest off.
    off : float
        Measured less predicted by a fit to the other rows, in the fit's unit.
    others : float
        Largest residual of the other rows there.
    stars : str
        Which stars of the run were taken for others.
    """

    row: int
    component: str
    off: float
    others: float
    stars: str = ""

    def to_dict(self, observations: Observations) -> dict[str, Any]:
        """Return it as plain data, with the number of its row in the data as they were given."""
        content = asdict(self) | {"row": int(observations.given(np.array(self.row)))}
        del content["stars"]
        return content


def gross_readings(fit: Fit) -> tuple[GrossReading, ...]:
    """Return the readings that are grossly wrong, in the order of the rows; two fits at most.

    Parameters
    ----------
    fit : Fit
        None are looked for where rows were left out already.
    """
    if fit.outliers.any():
        return ()
    found = _wrong(fit)
    if not found.any():
        return ()
    # not from what was fitted, where such a row may have turned an axis by a whole turn
    fitted = {fit.problem.model.parameters[i].key for i in fit.free}
    values = {key: value for key, value in fit.machine.values.items() if key not in fitted}
    without = fit.refit(replace(fit.machine, values=values), outliers=found)
    wrong = _wrong(without)
    if not np.array_equal(found, wrong):
        without = without.refit(outliers=wrong)
    rows = np.flatnonzero(wrong)
    others = float(np.abs(without.residuals[~wrong]).max())
    stars = on_misidentified(without, wrong)
    return tuple(
        GrossReading(int(row), component, off, others, stars)
        for row, off, component in zip(rows, *_worst(without, rows), strict=True)
    )


def _wrong(fit: Fit) -> Mask:
    """Return the rows that are wrong even if scales and play of joints are missing: at a reversal play makes a step."""
    rows = wrong_rows(fit)
    if not rows.any():
        return rows
    o, columns = fit.problem.observations, list[Array]()
    for j in np.flatnonzero(np.ptp(o.q, axis=0) > 0):
        motion = motion_with_reading(fit, o, int(j), weighted=True)
        drivers = np.column_stack([o.q[:, j], o.s[:, j]])
        columns.append(motion[:, :, None] * drivers[:, None, :])
    return wrong_rows(fit, Rows.of(fit, np.concatenate(columns, axis=2))) if columns else rows


def _worst(fit: Fit, rows: NDArray[np.int_]) -> tuple[list[float], list[str]]:
    """Return the largest residual of each row, in the fit's unit, and its component."""
    residuals, names = fit.residuals[rows], fit.machine.measurand.components
    worst = np.argmax(np.abs(residuals), axis=1)
    return residuals[np.arange(len(rows)), worst].tolist(), [names[i] for i in worst]


def how_far_off(fit: Fit, offs: Sequence[float], components: Sequence[str]) -> str:
    """Return by how much readings are off, as a sentence lists it: of many the first few.

    Parameters
    ----------
    offs : sequence of float
        In its unit.
    components : sequence of str
        Of the readings.
    """
    names = fit.machine.measurand.components
    unit_of = dict(zip(names, zip(fit.in_units, fit.units, strict=True), strict=True))
    listed = [
        f"{_signed(off * unit_of[name][0])} {unit_of[name][1]}{f' {in_component(name)}' if len(names) > 1 else ''}"
        for off, name in zip(offs[:NAMED], components, strict=False)
    ]
    more = f" and {len(offs) - NAMED} more" if len(offs) > NAMED else ""
    return f"{', '.join(listed)}{more}"


def _signed(off: float) -> str:
    """Return a number with its sign and three digits, without an exponent where that is readable."""
    return f"{off:+.0f}" if 1e3 <= abs(off) < 1e6 else f"{off:+.3g}"


def on_outliers(fit: Fit, rows: NDArray[np.bool_]) -> str:
    """Return which rows were taken out and by how much they are off; empty where none were.

    Parameters
    ----------
    fit : Fit
        Without them.
    rows : ndarray of bool, shape (n,)
    """
    out = np.flatnonzero(rows)
    if not len(out):
        return ""
    off = how_far_off(fit, *_worst(fit, out))
    places = fit.observations.data.places(out)
    sentence = f"{counted(len(out), 'outlier')}, taken out: {places}, off by {off}."
    stars = on_misidentified(fit, rows)
    return " ".join(
        filter(None, [sentence, f"{capitalized(stars)}." if stars else "", *_at_reversals(fit, out)])
    )


def _at_reversals(fit: Fit, rows: NDArray[np.intp]) -> Iterator[str]:
    """Yield a sentence for each joint on rows that repeat the one before where it turned back.

    It may have gone on and come back between the two, so that the order does not tell from which side it came.
    """
    o = fit.observations
    again = np.append(False, (np.diff(o.q, axis=0) == 0).all(axis=1) & (np.diff(o.target) == 0))
    for joint, s in zip(o.machine.joints, o.s.T, strict=True):
        turned = rows[again[rows] & np.append(np.diff(s) != 0, True)[rows] & (s[rows] != 0)]
        if len(turned) and f"dir_{joint.column}" not in o.columns_given and not joint.passive:
            place, one = capitalized(o.data.places(turned)), len(turned) == 1
            yield (
                f"{place} repeat{'s' * one} the row before, where {joint.name} turned back: play shifts "
                f"{'it' if one else 'them'} if {joint.name} came from the other side. Note that in "
                f"dir_{joint.column}, +1 or -1."
            )


def on_gross_readings(fit: Fit) -> str:
    """Return a sentence on the readings that are grossly wrong; empty where there are none."""
    gross = fit.gross_readings
    if not gross:
        return ""
    data = fit.observations.data
    wrong = [one.row for one in gross]
    place = capitalized(data.places(wrong))
    off = how_far_off(fit, [one.off for one in gross], [one.component for one in gross])
    are, them, it = ("are", "these rows", "them") if len(gross) > 1 else ("is", "this row", "it")
    rows = rows_text(data.numbers(wrong).tolist()).replace(" ", "")
    return (
        f"{place} {are} off by {off}, all other rows by {sized(gross[0].others, fit.unit, '.3g')} at most: "
        f"correct {them}, or exclude {it} with rodgen exclude --rows {rows}, or fit with --loss huber; a fit by "
        f"least squares follows such errors.{f' {capitalized(gross[0].stars)}.' if gross[0].stars else ''}"
    )
