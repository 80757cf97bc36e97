"""What a report says of the machine itself: location errors by their ISO names, and the error over its workspace."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

from rodgen.calibration.volumetric import VolumetricError, volumetric_error
from rodgen.calibration.words import plain, three_digits
from rodgen.machines.emit.own_errors import location_errors
from rodgen.output.figures.drawn_rows import coordinate
from rodgen.output.numbers import minus, shown_unit
from rodgen.statistics.digits import measured

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel

Content: TypeAlias = dict[str, Any]

FEW = 12
"""Location errors that are shown without being unfolded."""


def own_errors(fit: FittedModel) -> Content | None:
    """Return the errors of a fitted machine as texts; None where there is nothing to say.

    Parameters
    ----------
    fit : FittedModel
        With everything that was found.
    """
    keys = [p.key for p in fit.parameters]
    listed = location_errors(
        fit.machine, fit.observations.travel, (keys, fit.covariance), fit.determinacy.null
    )
    volume = volumetric_error(fit)
    rows = [
        {
            "symbol": plain(one.symbol, 40),
            "meaning": plain(one.meaning, 80),
            "value": _number(one.value, one.u),
            "u": _number(one.u, one.u) if one.u else "held",
            "unit": {"um": "µm"}.get(one.unit, one.unit),
            "choice": one.by_choice,
        }
        for one in listed
    ]
    if not rows and (volume is None or volume.largest == 0):
        return None
    return {
        "locations": rows,
        "open": len(rows) <= FEW,
        "choice": any(row["choice"] for row in rows),
        "held": any(row["u"] == "held" for row in rows),
        "volume": None if volume is None else _volume(fit, volume),
    }


def _number(value: float, u: float) -> str:
    """Write a number with two significant digits of its expanded uncertainty."""
    return minus(measured(value, u)[0] if u else three_digits(value))


def _volume(fit: FittedModel, found: VolumetricError) -> Content:
    shown = shown_unit(found.unit, [found.largest, found.most])
    machine, o = fit.machine, fit.observations
    units = [coordinate(o, j) for j in range(len(machine.joints))]

    def said(value: float, u: float | None) -> str:
        if u is None or not math.isfinite(u) or u <= 0:
            return three_digits(value * shown.factor)
        number, uncertain = measured(value * shown.factor, u * shown.factor)
        return f"{number} ± {uncertain}"

    at = ", ".join(
        f"{plain(joint.name, 16)} {value / factor:.4g} {unit}"
        for joint, value, (unit, factor) in zip(machine.joints, found.at, units, strict=True)
    )
    ranges = ", ".join(
        f"{plain(joint.name, 16)} {low / factor:.4g} to {high / factor:.4g} {unit}"
        for joint, (low, high), (unit, factor) in zip(machine.joints, found.ranges, units, strict=True)
    )
    moving = machine.measurand.moving
    how = [
        f"{'Distance' if moving else 'Angle'} between where the last model and the file's machine without any error "
        f"{'put the target' if moving else 'point'}, at {found.positions} positions"
        + (" that were measured" if found.measured_only else f" over {ranges}")
        + ", approached from both sides, at rest, without load, at the reference temperature.",
        "± is the expanded uncertainty, k = 2, of the fitted parameters; what the model lacks is not in it."
        if found.largest_u is not None
        else "The noise is not known, and with it no uncertainty.",
    ]
    if found.free:
        set_up = {"target": "mounting of the target", "instrument": "place of the instrument"}
        of = " and the ".join(set_up[x] for x in found.free)
        are = "is" if len(found.free) == 1 else "are"
        how.append(f"The {of} {are} no error of the machine, and such that both come nearest to each other.")
    if found.by_choice:
        how.append(
            "The data leave a choice between geometries that predict the same readings; these errors are those of the "
            "one nearest to the file."
        )
    return {
        "largest": minus(said(found.largest, found.largest_u)),
        "most": minus(said(found.most, found.most_u)),
        "unit": shown.unit,
        "at": minus(at),
        "how": minus(" ".join(how)),
        "name": "Volumetric error" if moving else "Pointing error",
    }
