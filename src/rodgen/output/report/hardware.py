"""What fitted parameters mean on the machine: micrometres off an axis, micrometres per metre, lost motion at a radius.

Where a number needs the size of a part that no file states, such as the radius of a scale, it is given per unit of that
size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.fit import Estimate, Fit
from rodgen.calibration.volumetric import VolumetricError, volumetric_error
from rodgen.calibration.words import plain, three_digits
from rodgen.data.units import ARCSEC, parse_unit, readable
from rodgen.document import Block, Facts, Paragraph, Part, Table
from rodgen.machines.emit.own_errors import LocationError, location_errors
from rodgen.machines.machine import Effect
from rodgen.output.figures.drawn_rows import coordinate
from rodgen.statistics.digits import measured

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit


VAGUE = 1.0
"""Parameters below this multiple of their standard deviations are not converted into micrometres."""


def in_hardware(
    effect: Effect, parameters: Mapping[str, Estimate], fit: Fit, radius: float | None = None
) -> list[str]:
    """Return sentences that say what an effect's parameters mean in hardware.

    Parameters
    ----------
    parameters : mapping of str to Estimate
        By short name.
    fit : Fit
        Of the model that has it.
    radius : float, optional
        Of the joint's scale, in millimetres.
    """
    say = _SENTENCES.get(effect.name)
    if say is None or effect.definition.own:
        return []
    free = [e for e in parameters.values() if not e.held]
    if all(e.std is not None and abs(e.value) < VAGUE * e.std for e in free) and free:
        return ["None of its parameters is known well enough to say what it means on the machine."]
    try:
        return list(say(_Fitted(effect, parameters, fit, radius)))
    except KeyError:  # parameters under other names, such as those of a set-up
        return []


class _Fitted:
    """The fitted parameters of an effect."""

    def __init__(
        self,
        effect: Effect,
        parameters: Mapping[str, Estimate],
        fit: Fit,
        radius: float | None,
    ) -> None:
        self.effect, self.parameters, self.fit, self.radius = effect, parameters, fit, radius
        names = [joint.name for joint in fit.machine.joints]
        self.joint = names.index(str(effect.place)) if effect.place in names else None

    def __getitem__(self, name: str) -> float:
        return self.parameters[name].value

    @property
    def turns(self) -> bool:
        return self.joint is not None and self.fit.machine.joints[self.joint].revolute

    @property
    def mm(self) -> float:
        """What a length of the machine file is in millimetres."""
        return parse_unit(self.fit.machine.length_unit).factor("mm")

    def length(self, value: float) -> str:
        """Write a length of the machine file."""
        size = value * self.mm
        return f"{three_digits(size * 1e3)} µm" if abs(size) < 0.5 else f"{three_digits(size)} mm"

    def range(self) -> float:
        return 0.0 if self.joint is None else float(np.ptp(self.fit.observations.q[:, self.joint]))


def _amplitude(parameters: Mapping[str, Estimate]) -> tuple[float, float | None]:
    """Return the size of the wave of parts a and b, and its std as if these were independent."""
    a, b = parameters["a"], parameters["b"]
    size = math.hypot(a.value, b.value)
    if size == 0 or a.std is None or b.std is None:
        return size, None
    return size, math.hypot(a.value * a.std, b.value * b.std) / size


def _with(size: float, std: float | None) -> str:
    return three_digits(size) if std is None else " ± ".join(measured(size, std))


def _eccentric(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.parameters)
    highest = math.degrees(math.atan2(f["b"], f["a"])) % 360
    yield f"One wave a turn of {_with(size, std)} arcsec, highest at {highest:.0f}°."
    per_mm, std_mm = size * ARCSEC * 1e3, None if std is None else std * ARCSEC * 1e3
    if f.radius is not None:
        off, off_std = per_mm * f.radius, None if std_mm is None else std_mm * f.radius
        yield f"The scale, {f.radius:g} mm in radius, sits {_with(off, off_std)} µm off the axis."
    else:
        yield (
            f"The scale sits {_with(per_mm, std_mm)} µm off the axis for each mm of its radius: "
            f"{three_digits(50 * per_mm)} µm where it is 100 mm across."
        )


def _oval(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.parameters)
    per_mm = size * ARCSEC * 1e3
    yield f"Two waves a turn of {_with(size, std)} arcsec."
    of = f.radius if f.radius is not None else 50.0
    yield f"On a scale of {of:g} mm radius the graduation is {three_digits(per_mm * of)} µm out of its place."


def _wave(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.parameters)
    unit = "arcsec" if f.turns else f.fit.machine.length_unit
    height = f"{_with(size, std)} arcsec" if f.turns else f.length(size)
    period = f["P"] if "P" in f.parameters else None
    joint = f.fit.machine.joints[f.joint] if f.joint is not None else None
    if period is not None:
        turn = " deg" if f.turns else f" {unit}"
        ratio = f": 1/{360 / period:.4g} of a turn" if f.turns and period else ""
        yield f"A wave of {height} every {period:.5g}{turn}{ratio}."
    elif joint is not None and joint.period:
        yield f"A wave of {height} every {joint.period:g} {f.fit.machine.angle_unit if f.turns else unit}."


def _tilt(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.parameters)
    slope = size * ARCSEC * 1e6
    yield f"{_with(size, std)} arcsec are {three_digits(slope)} µm for each metre away from it."


def _offset(f: _Fitted) -> Iterator[str]:
    yield f"The axis stands {f.length(math.hypot(f['a'], f['b']))} from its place."


def _zero(f: _Fitted) -> Iterator[str]:
    if f.turns:
        size = abs(f["a"])
        yield f"{three_digits(size)} arcsec are {three_digits(size * ARCSEC * 1e5)} µm at a radius of 100 mm."
    else:
        yield f"All coordinates are {f.length(abs(f['a']))} too {'large' if f['a'] > 0 else 'small'}."


def _scale(f: _Fitted) -> Iterator[str]:
    if f.turns:
        here = three_digits(f["k"] * f.range() / ARCSEC)
        yield f"{three_digits(f['k'] * 1296000)} arcsec in a whole turn, {here} over what was measured."
    else:
        yield f"{three_digits(f['k'] * 1e6)} µm/m, {f.length(f['k'] * f.range())} over what was measured."


def _backlash(f: _Fitted) -> Iterator[str]:
    size = abs(f["b"])
    if f.turns:
        out = three_digits(size * ARCSEC * 1e5)
        yield f"{three_digits(size)} arcsec between the two directions: {out} µm at a radius of 100 mm."
    else:
        yield f"{f.length(size)} between the two directions."


def _gradient(f: _Fitted) -> Iterator[str]:
    if f.turns:
        yield f"The lost motion changes by {three_digits(2 * abs(f['k']) * 1296000)} arcsec over a whole turn."
    else:
        yield f"The lost motion changes by {three_digits(2 * abs(f['k']) * 1e6)} µm over a metre."


def _lag(f: _Fitted) -> Iterator[str]:
    yield f"A delay of {three_digits(f['tau'] * 1e3)} ms."
    if f.joint is not None:
        fastest = float(np.max(np.abs(f.fit.observations.v[:, f.joint]), initial=0.0))
        if fastest > 0:
            late = abs(f["tau"]) * fastest
            lag_text = f"{three_digits(late / ARCSEC)} arcsec" if f.turns else f.length(late)
            yield f"At the fastest of these readings that is {lag_text}."


def _windup(f: _Fitted) -> Iterator[str]:
    unit = f.effect.units(f.fit.machine)["k"]
    if unit == "arcsec":
        yield f"The tube droops by {three_digits(abs(f['k']))} arcsec between upright and level."
    else:
        droop = three_digits(abs(f["k"]) * 1000 / f.mm)
        yield f"With the target 1 m out, level, the joint droops by {droop} arcsec."


def _expansion(f: _Fitted) -> Iterator[str]:
    yield f"{three_digits(f['alpha'] * 1e6)} µm for each metre and kelvin; steel has 11, glass 8, aluminium 23."


def _per_kelvin(f: _Fitted) -> Iterator[str]:
    if not f.turns:
        yield f"{f.length(f['k'])} for each kelvin."


def _sag(f: _Fitted) -> Iterator[str]:
    for name, where in (
        ("tip", "at the end, under the load there"),
        ("own", "at the end, under its own weight"),
    ):
        if f[name]:
            yield f"{f.length(f[name])} {where}."
    if f["mid"]:
        yield f"{f.length(f['mid'])} in the middle."


def _size(f: _Fitted) -> float:
    return math.sqrt(sum(f[name] ** 2 for name in "xyz" if name in f.parameters))


def _moved(f: _Fitted) -> Iterator[str]:
    turns = not f.fit.machine.measurand.moving
    distance = f"{three_digits(_size(f))} arcsec" if turns else f.length(_size(f))
    if f.effect.name == "warm_up_drift":
        tau = f["tau"]
        long = f"{three_digits(tau / 3600)} h" if tau > 5400 else f"{three_digits(tau / 60)} min"
        yield f"{distance} in the end, two thirds of it after {long}."
    elif f.effect.name == "linear_drift":
        per_hour = 3600 * _size(f)
        yield f"{three_digits(per_hour)} arcsec an hour." if turns else f"{f.length(per_hour)} an hour."
    elif f.effect.name == "thermal_axis_drift":
        yield f"{distance} for each kelvin."
    else:
        yield f"It sits {distance} from where the file says."


def _factor(f: _Fitted) -> Iterator[str]:
    yield f"{three_digits(f['k'] * 1e6)} µm for each metre of distance."


def _air(f: _Fitted) -> Iterator[str]:
    yield f"{three_digits(f['a'] * math.tan(math.radians(60)))} arcsec at an altitude of 30°."


def _droop(f: _Fitted) -> Iterator[str]:
    yield f"{three_digits(f['a'] * math.cos(math.radians(30)))} arcsec at an altitude of 30°."


_SENTENCES: Mapping[str, Callable[[_Fitted], Iterator[str]]] = {
    "encoder_eccentricity": _eccentric,
    "encoder_ellipticity": _oval,
    "periodic_drive_error": _wave,
    "axis_tilt": _tilt,
    "squareness": _tilt,
    "axis_offset": _offset,
    "zero_offset": _zero,
    "scale": _scale,
    "backlash": _backlash,
    "backlash_gradient": _gradient,
    "servo_lag": _lag,
    "gravity_windup": _windup,
    "thermal_expansion": _expansion,
    "thermal_offset": _per_kelvin,
    "thermal_axis_drift": _moved,
    "gravity_sag": _sag,
    "warm_up_drift": _moved,
    "linear_drift": _moved,
    "target_offset": _moved,
    "instrument_scale": _factor,
    "tube_flexure": _droop,
    "refraction": _air,
}


# the whole machine -------------------------------------------------------------------------------------------------

FEW = 12
"""Location errors that are shown without being unfolded."""


def own_errors(fit: Fit, *, locations: bool = True) -> Iterator[Part]:
    """Yield the errors of a fitted machine: of the locations of its axes, and of the whole.

    Parameters
    ----------
    fit : Fit
        With everything that was found.
    locations : bool, optional
        Whether those of locations are wanted; of a mount TPOINT's terms are the same.
    """
    keys = [p.key for p in fit.parameters]
    listed = location_errors(
        fit.machine, fit.observations.travel, (keys, fit.covariance), fit.determinacy.null
    )
    volume = volumetric_error(fit)
    if not listed and (volume is None or volume.largest == 0):
        return
    if listed and locations:
        yield _locations(listed)
    if volume is not None:
        yield _volume(fit, volume)


def _locations(listed: Sequence[LocationError]) -> Part:
    rows = [
        (
            plain(one.symbol, 40),
            plain(one.meaning, 80) + ("*" if one.by_choice else ""),
            measured(one.value, one.u)[0] if one.u else three_digits(one.value),
            measured(one.u, one.u)[0] if one.u else "held",
            one.unit,
        )
        for one in listed
    ]
    title = "Location errors (ISO 230-1, ISO 230-7)"
    lines = ["Real less nominal, in machine axes; a turn is positive about its axis by the right-hand rule."]
    lines += ["Held: as the file states it."] * any(not one.u for one in listed)
    choice = (
        "* Rests on a choice between geometries that predict the same readings: the one nearest to the file."
    )
    lines += [choice] * any(one.by_choice for one in listed)
    table = Table(("symbol", "error", "value", "U, k = 2", "unit"), rows, "llrrl", title)
    blocks: list[Block] = [table, Paragraph(" ".join(lines), "note")]
    return Part(blocks, f"{len(rows)} location errors", "folded") if len(rows) > FEW else Part(blocks)


def _volume(fit: Fit, volumetric: VolumetricError) -> Part:
    factor, unit = readable(volumetric.unit, volumetric.largest)
    machine, o = fit.machine, fit.observations
    units = [coordinate(o, j) for j in range(len(machine.joints))]

    def said(value: float, u: float | None) -> str:
        if u is None or not math.isfinite(u) or u <= 0:
            return f"{three_digits(value * factor)} {unit}"
        number, uncertain = measured(value * factor, u * factor)
        return f"{number} ± {uncertain} {unit}"

    at = ", ".join(
        f"{plain(joint.name, 16)} {value / factor:.4g} {unit}"
        for joint, value, (unit, factor) in zip(machine.joints, volumetric.at, units, strict=True)
    )
    ranges = ", ".join(
        f"{plain(joint.name, 16)} {low / factor:.4g} to {high / factor:.4g} {unit}"
        for joint, (low, high), (unit, factor) in zip(machine.joints, volumetric.ranges, units, strict=True)
    )
    moving = machine.measurand.moving
    how = [
        f"{'Distance' if moving else 'Angle'} between where the last model and the file's machine without any error "
        f"{'put the target' if moving else 'point'}, at {volumetric.positions} positions"
        + (" that were measured" if volumetric.measured_only else f" over {ranges}")
        + ", approached from both sides, at rest, without load, at the reference temperature.",
        "± is the expanded uncertainty, k = 2, of the fitted parameters; what the model lacks is not in it."
        if volumetric.largest_u is not None
        else "The noise is not known, and with it no uncertainty.",
    ]
    if volumetric.free:
        set_up = {"target": "mounting of the target", "instrument": "place of the instrument"}
        of = " and the ".join(set_up[x] for x in volumetric.free)
        are = "is" if len(volumetric.free) == 1 else "are"
        how.append(f"The {of} {are} no error of the machine, and such that both come nearest to each other.")
    if volumetric.by_choice:
        how.append(
            "The data leave a choice between geometries that predict the same readings; these errors are those of the "
            "one nearest to the file."
        )
    rows = [
        ("Largest", f"{said(volumetric.largest, volumetric.largest_u)} at {at}"),
        ("95 % below", said(volumetric.most, volumetric.most_u)),
    ]
    title = f"{'Volumetric' if moving else 'Pointing'} error, k = 2"
    return Part([Facts(rows, title), Paragraph(" ".join(how), "note")])
