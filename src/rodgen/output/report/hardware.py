"""What fitted parameters mean on the machine: micrometres off an axis, micrometres per metre, lost motion at a radius.

Where a number needs the size of a part that no file states, such as the radius of a scale, it is given per unit of that
size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from rodgen.calibration.compare.sentences import figure
from rodgen.calibration.fit import Estimate, Fit
from rodgen.machines.machine import Effect

__all__ = ["eccentricity", "in_hardware"]

ARCSEC = math.pi / 648000
VAGUE = 1.0
"""Parameters below this multiple of their standard deviations are not converted into micrometres."""
_TO_MM = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "um": 1e-3,
    "µm": 1e-3,
    "micrometer": 1e-3,
    "inch": 25.4,
    "in": 25.4,
}


def in_hardware(
    effect: Effect, parameters: Mapping[str, Estimate], fit: Fit, radius: float | None = None
) -> list[str]:
    """Return sentences that say what an effect's parameters mean in hardware.

    Parameters
    ----------
    effect : Effect
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
    values = {name: e.value for name, e in parameters.items()}
    spread = {name: e.std for name, e in parameters.items()}
    try:
        return list(say(_Fitted(effect, values, spread, fit, radius)))
    except KeyError:  # parameters under other names, such as those of a set-up
        return []


def eccentricity(parameters: Mapping[str, Estimate]) -> tuple[float, float | None] | None:
    """Return the eccentricity of a scale per millimetre of its radius, in micrometres, and its standard deviation."""
    if not {"a", "b"} <= parameters.keys():
        return None
    found = _amplitude({n: parameters[n].value for n in "ab"}, {n: parameters[n].std for n in "ab"}, "a", "b")
    return found[0] * ARCSEC * 1e3, None if found[1] is None else found[1] * ARCSEC * 1e3


class _Fitted:
    """The fitted parameters of an effect."""

    def __init__(
        self,
        effect: Effect,
        values: Mapping[str, float],
        spread: Mapping[str, float | None],
        fit: Fit,
        radius: float | None,
    ) -> None:
        self.effect, self.values, self.spread, self.fit, self.radius = effect, values, spread, fit, radius
        names = [joint.name for joint in fit.machine.joints]
        self.joint = names.index(str(effect.place)) if effect.place in names else None

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @property
    def turns(self) -> bool:
        return self.joint is not None and self.fit.machine.joints[self.joint].type == "revolute"

    @property
    def mm(self) -> float | None:
        """What a length of the machine file is in millimetres."""
        return _TO_MM.get(self.fit.machine.length_unit)

    def length(self, value: float) -> str:
        """Write a length of the machine file."""
        return _length(value, self.fit.machine.length_unit)

    def range(self) -> float:
        return 0.0 if self.joint is None else float(np.ptp(self.fit.observations.q[:, self.joint]))


def _length(value: float, unit: str) -> str:
    mm = _TO_MM.get(unit)
    if mm is None:
        return f"{figure(value)} {unit}"
    return f"{figure(value * mm * 1e3)} µm" if abs(value) * mm < 0.5 else f"{figure(value * mm)} mm"


def _amplitude(
    values: Mapping[str, float], spread: Mapping[str, float | None], a: str, b: str
) -> tuple[float, float | None]:
    """Return the size of a wave, and its std as if its parts were independent."""
    size = math.hypot(values[a], values[b])
    parts = [spread.get(a), spread.get(b)]
    if size == 0 or parts[0] is None or parts[1] is None:
        return size, None
    return size, math.hypot(values[a] * parts[0], values[b] * parts[1]) / size


def _with(size: float, std: float | None) -> str:
    return figure(size) if std is None else f"{figure(size)} ± {std:.2g}"


def _eccentric(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.values, f.spread, "a", "b")
    highest = math.degrees(math.atan2(f["b"], f["a"])) % 360
    yield f"One wave a turn of {_with(size, std)} arcsec, highest at {highest:.0f}°."
    per_mm, std_mm = size * ARCSEC * 1e3, None if std is None else std * ARCSEC * 1e3
    if f.radius is not None:
        off, off_std = per_mm * f.radius, None if std_mm is None else std_mm * f.radius
        yield f"The scale, {f.radius:g} mm in radius, sits {_with(off, off_std)} µm off the axis."
    else:
        yield (
            f"The scale sits {_with(per_mm, std_mm)} µm off the axis for each mm of its radius: "
            f"{figure(50 * per_mm)} µm where it is 100 mm across."
        )


def _oval(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.values, f.spread, "a", "b")
    per_mm = size * ARCSEC * 1e3
    yield f"Two waves a turn of {_with(size, std)} arcsec."
    of = f.radius if f.radius is not None else 50.0
    yield f"On a scale of {of:g} mm radius the graduation is {figure(per_mm * of)} µm out of its place."


def _wave(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.values, f.spread, "a", "b")
    unit = "arcsec" if f.turns else f.fit.machine.length_unit
    said = f"{_with(size, std)} arcsec" if f.turns else f.length(size)
    period = f.values.get("P")
    joint = f.fit.machine.joints[f.joint] if f.joint is not None else None
    if period is not None:
        turn = " deg" if f.turns else f" {unit}"
        ratio = f": 1/{360 / period:.4g} of a turn" if f.turns and period else ""
        yield f"A wave of {said} every {period:.5g}{turn}{ratio}."
    elif joint is not None and joint.period:
        yield f"A wave of {said} every {joint.period:g} {f.fit.machine.angle_unit if f.turns else unit}."


def _tilt(f: _Fitted) -> Iterator[str]:
    size, std = _amplitude(f.values, f.spread, "a", "b")
    slope = size * ARCSEC * 1e6
    yield f"{_with(size, std)} arcsec are {figure(slope)} µm for each metre away from it."


def _offset(f: _Fitted) -> Iterator[str]:
    yield f"The axis stands {f.length(math.hypot(f['a'], f['b']))} from its place."


def _zero(f: _Fitted) -> Iterator[str]:
    if f.turns:
        yield f"{figure(abs(f['a']))} arcsec are {figure(abs(f['a']) * ARCSEC * 1e5)} µm at a radius of 100 mm."
    else:
        yield f"All coordinates are {f.length(abs(f['a']))} too {'large' if f['a'] > 0 else 'small'}."


def _scale(f: _Fitted) -> Iterator[str]:
    if f.turns:
        here = figure(f["k"] * f.range() / ARCSEC)
        yield f"{figure(f['k'] * 1296000)} arcsec in a whole turn, {here} over what was measured."
    else:
        yield f"{figure(f['k'] * 1e6)} µm/m, {f.length(f['k'] * f.range())} over what was measured."


def _backlash(f: _Fitted) -> Iterator[str]:
    size = abs(f["b"])
    if f.turns:
        out = figure(size * ARCSEC * 1e5)
        yield f"{figure(size)} arcsec between the two directions: {out} µm at a radius of 100 mm."
    else:
        yield f"{f.length(size)} between the two directions."


def _gradient(f: _Fitted) -> Iterator[str]:
    if f.turns:
        yield f"The lost motion changes by {figure(2 * abs(f['k']) * 1296000)} arcsec over a whole turn."
    else:
        yield f"The lost motion changes by {figure(2 * abs(f['k']) * 1e6)} µm over a metre."


def _lag(f: _Fitted) -> Iterator[str]:
    yield f"A delay of {figure(f['tau'] * 1e3)} ms."
    if f.joint is not None:
        fastest = float(np.max(np.abs(f.fit.observations.v[:, f.joint]), initial=0.0))
        if fastest > 0:
            late = abs(f["tau"]) * fastest
            said = f"{figure(late / ARCSEC)} arcsec" if f.turns else f.length(late)
            yield f"At the fastest of these readings that is {said}."


def _windup(f: _Fitted) -> Iterator[str]:
    unit = f.effect.units(f.fit.machine)["k"]
    if unit == "arcsec":
        yield f"The tube droops by {figure(abs(f['k']))} arcsec between upright and level."
    else:
        mm = f.mm
        if mm:
            yield f"With the target 1 m out, level, the joint droops by {figure(abs(f['k']) * 1000 / mm)} arcsec."


def _expansion(f: _Fitted) -> Iterator[str]:
    yield f"{figure(f['alpha'] * 1e6)} µm for each metre and kelvin; steel has 11, glass 8, aluminium 23."


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


def _size(f: _Fitted, names: str = "xyz") -> float:
    return math.sqrt(sum(f.values.get(name, 0.0) ** 2 for name in names))


def _moved(f: _Fitted) -> Iterator[str]:
    turns = not f.fit.machine.measurand.moving
    said = f"{figure(_size(f))} arcsec" if turns else f.length(_size(f))
    if f.effect.name == "warm_up_drift":
        tau = f["tau"]
        long = f"{figure(tau / 3600)} h" if tau > 5400 else f"{figure(tau / 60)} min"
        yield f"{said} in the end, two thirds of it after {long}."
    elif f.effect.name == "linear_drift":
        per_hour = 3600 * _size(f)
        yield f"{figure(per_hour)} arcsec an hour." if turns else f"{f.length(per_hour)} an hour."
    elif f.effect.name == "thermal_axis_drift":
        yield f"{said} for each kelvin."
    else:
        yield f"It sits {said} from where the file says."


def _factor(f: _Fitted) -> Iterator[str]:
    yield f"{figure(f['k'] * 1e6)} µm for each metre of distance."


def _air(f: _Fitted) -> Iterator[str]:
    yield f"{figure(f['a'] * math.tan(math.radians(60)))} arcsec at an altitude of 30°."


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
    "refraction": _air,
}
