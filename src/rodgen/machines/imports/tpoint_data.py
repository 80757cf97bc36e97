"""Pointing runs: TPOINT's data files, and the log of the MMT's mount control from which such files are made.

A TPOINT file has a caption, options such as ``:ALTAZ``, a record of the site (latitude, and where there are more
numbers date, temperature, pressure, height, humidity, wavelength), then a record an observation:

1. mean place of the star (h m s, deg ' ", proper motions in s and " a year, equinox), the telescope's own (h m s,
   deg ' "), and the sidereal time (h m): 17 numbers;
2. apparent place of the star, the telescope's place, the sidereal time: 14;
3. observed hour angle (h m s) and declination of the star, and the telescope's: 12;
4. observed coordinates of the star and the telescope's in degrees: 4. Azimuth is from north (0) through east (90): so
   written, a fit has the signs of TPOINT's own. A comment such as ``S=0, E=90`` says that it is from south.

Up to three auxiliary readings may follow. Places of stars in 1 and 2 are reduced to what is observed: precession,
nutation and aberration, by ERFA, at 0 h of the date that the file gives; diurnal aberration, but with ``:NODA``;
refraction, where the file gives a pressure.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.poses import poses
from rodgen.errors import InputFileError, joined, shown
from rodgen.files import decoded, read_input
from rodgen.machines.imports.imported import one_line
from rodgen.machines.mounts import ALTAZ, EQUATORIAL, Mount

_EXPECTED = "a pointing run of TPOINT"
_OPTIONS = {"EQUAT": EQUATORIAL, "ALTAZ": ALTAZ}
_COUNTS = {1: 17, 2: 14, 3: 12, 4: 4}
"""How many numbers a line of a format has, without auxiliary readings."""
_WORDS = {
    1: "mean places, reduced by ERFA to apparent ones at 0 h of the date",
    2: "apparent places",
    3: "observed hour angles and declinations",
    4: "observed coordinates in degrees",
}
_FROM = re.compile(r"\b([NS])(?:orth|outh)?\s*=\s*0(?:\.0*)?(?![.\d])", re.IGNORECASE)
"""What a comment says of azimuth: where it is 0."""
_OF_AZIMUTH = re.compile(r"\baz|\b[EW](?:ast|est)?\s*=\s*90\b", re.IGNORECASE)
"""In such a comment; else another S may be 0."""
_THROUGH_WEST = re.compile(r"\bW(?:est)?\s*=\s*90\b", re.IGNORECASE)
_AUXILIARY = 3
_SIDEREAL = 86164.0905 / 24
"""Seconds of a sidereal hour."""
_DIURNAL = 1.5497e-6
"""Velocity of the equator over that of light."""


@dataclass(frozen=True)
class Site:
    """What a pointing run says of the place and the air."""

    latitude: float
    """rad."""
    date: tuple[int, int, int] | None = None
    """Year, month and day, which mean places are reduced with."""
    temperature: float | None = None
    """Degrees Celsius."""
    pressure: float | None = None
    """hPa."""
    height: float | None = None
    """m."""
    humidity: float = 0.5
    """From 0 to 1."""
    wavelength: float = 0.55
    """µm."""


@dataclass(frozen=True)
class Pointings:
    """A pointing run."""

    caption: str
    mount: Mount
    site: Site | None
    commanded: Array
    """Of the mount's axes, rad, (n, 2)."""
    seen: Array
    """Unit vectors of the stars, in the mount's frame, (n, 3)."""
    time: Array | None
    """Seconds from the first observation, by the sidereal times, (n,)."""
    auxiliary: Array
    """Shape (n, m)."""
    notes: tuple[str, ...]
    named: tuple[str, ...] = ()
    """The star of each record, where the file says it."""

    @property
    def counted(self) -> str:
        """How many stars there are; and records, where a star was logged again."""
        records = len(self.seen)
        places = poses([*self.commanded.T], np.zeros(records, int))
        stars = len({*self.named}) if len(self.named) == records else len({*places.tolist()})
        return f"{stars} stars" + (f", {records} records" if stars < records else "")


def is_pointing_run(start: bytes) -> bool:
    """Return whether the first bytes of a file are those of a pointing run."""
    lines = start.decode("utf-8", "replace").splitlines()
    return any(re.match(r"\s*:\s*(ALTAZ|EQUAT)\b", line, re.I) for line in lines) or start.startswith(b"CAT:")


def read_pointings(
    path: str | os.PathLike[str], *, azimuth: str | None = None, form: int | None = None
) -> Pointings:
    """Return a pointing run.

    Parameters
    ----------
    path : str or os.PathLike
    azimuth : {"north", "south"}, optional
        Where azimuths of a TPOINT file of format 4 are 0; they run through east. Default: what its first comment on
        that says, else north.
    form : {1, 2, 3, 4}, optional
        Format of observations; default: that which their numbers fit, how many there are and what they can be.

    Raises
    ------
    InputFileError
        With the line that cannot be read.
    """
    file = os.fspath(path)
    text = decoded(read_input(file, _EXPECTED), file)
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    if any(line.startswith("RAA:") for _, line in lines):
        return _of_log(file, lines)
    stated = [(number, line) for number, line in lines if line and not line.startswith("!")]
    reason = "."
    if not azimuth:
        azimuth, reason = "north", ", as TPOINT's do; --azimuth south says otherwise."
        for number, line in lines:
            if line.startswith("!") and _OF_AZIMUTH.search(line) and (match := _FROM.search(line)):
                if _THROUGH_WEST.search(line):
                    raise InputFileError(
                        file, f"line {number}", "azimuths through west", "azimuths through east, or --azimuth"
                    )
                azimuth, reason = "south" if match[1] in "sS" else "north", f", as line {number} says."
                break
    return _of_tpoint(file, stated, form, azimuth, reason)


# TPOINT's files ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Record:
    line: int
    values: tuple[float, ...]


def _of_tpoint(
    file: str, lines: Sequence[tuple[int, str]], form: int | None, azimuth: str, reason: str
) -> Pointings:
    if not lines:
        raise InputFileError(file, "file", "no lines", _EXPECTED)
    (_, caption), *rest = lines
    mount: Mount | None = None
    options: list[str] = []
    site: Site | None = None
    records: list[_Record] = []
    for number, line in rest:
        if line.upper() == "END":
            break
        if line.startswith(":"):
            option = line[1:].strip().upper()
            mount = _OPTIONS.get(option, mount)
            options.append(option)
        elif site is None:
            site = _site(file, number, line)
        else:
            records.append(_record(file, number, line, records))
    if mount is None:
        raise InputFileError(file, "file", "no mount", ":ALTAZ or :EQUAT on a line below the caption")
    if site is None or not records:
        raise InputFileError(
            file, "file", "no observations", "the record of the site, then a line for each star"
        )
    form, notes = _form(file, records, form)
    numbers = np.array([record.values for record in records])
    values, auxiliary = numbers[:, : _COUNTS[form]], numbers[:, _COUNTS[form] :]
    records = [replace(record, values=record.values[: _COUNTS[form]]) for record in records]
    time = None
    if form == 4:
        for record in records:
            if abs(record.values[1]) > 90:
                found = (
                    f"a star's {'elevation' if mount is ALTAZ else 'declination'} of {record.values[1]:.6g}"
                )
                raise InputFileError(file, f"line {record.line}", found, "from -90 to 90")
        angles = np.radians(values)
        if mount is ALTAZ:
            angles[:, ::2] = np.pi - angles[:, ::2] if azimuth == "south" else angles[:, ::2]
            notes.append(f"Azimuths of the file run from {azimuth} through east{reason}")
        seen = mount.direction(angles[:, 0], angles[:, 1])
        commanded = angles[:, 2:]
    else:
        star, commanded, sidereal = _hour_angles(file, records, site, form)
        seen = EQUATORIAL.direction(*star.T)
        if sidereal is not None:
            seen = _observed(seen, site, diurnal="NODA" not in options)
            time = _elapsed(sidereal)
            notes += _on_reduction(site, "NODA" in options)
        if mount is ALTAZ:
            seen = seen @ _level(site.latitude)
            x, y, z = (EQUATORIAL.direction(*commanded.T) @ _level(site.latitude)).T
            commanded = np.stack([np.arctan2(x, y), np.arcsin(np.clip(z, -1, 1))], axis=-1)
            notes.append("Hour angles and declinations of star and telescope became azimuths and elevations.")
    unused = sorted(set(options) - {*_OPTIONS, "NODA", "ALLSKY"})
    notes += [f"Options that are not used: {joined(unused)}."] if unused else []
    notes += [f"Auxiliary readings are covariates: {auxiliary.shape[1]}."] if auxiliary.shape[1] else []
    return Pointings(
        one_line(caption) or "Pointing run", mount, site, commanded, seen, time, auxiliary, tuple(notes)
    )


def _numbers(file: str, number: int, line: str) -> list[float]:
    values = []
    for text in line.partition("!")[0].replace(",", " ").split():
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text or abs(value) > 1e9:
            raise InputFileError(file, f"line {number}", shown(text), "numbers between blanks")
        values.append(value)
    return values


def _site(file: str, number: int, line: str) -> Site:
    values = _numbers(file, number, line)
    if len(values) != 3 and len(values) < 6:
        expected = "latitude (deg ' \"), and where known year, month, day, °C, hPa, m, humidity"
        raise InputFileError(file, f"line {number}", f"{len(values)} numbers of the site", expected)
    latitude = _sexagesimal(values[:3])
    year, month, day = [int(x) for x in values[3:6]] or (2000, 1, 1)
    if not (abs(latitude) <= 90 and 1800 <= year <= 2300 and 1 <= month <= 12 and 1 <= day <= 31):
        raise InputFileError(
            file, f"line {number}", shown(line), "a latitude (deg ' \"), a year, a month and a day"
        )
    air: dict[str, Any] = dict(
        zip(("temperature", "pressure", "height", "humidity", "wavelength"), values[6:], strict=False)
    )
    if air.get("humidity", 0.0) > 1:  # in per cent
        air["humidity"] /= 100
    return replace(Site(math.radians(latitude), (year, month, day) if values[3:] else None), **air)


def _record(file: str, number: int, line: str, before: Sequence[_Record]) -> _Record:
    values = _numbers(file, number, line)
    count = len(values)
    if before and count != len(before[0].values):
        found, expected = f"{count} numbers of an observation", f"{len(before[0].values)}, as above"
        raise InputFileError(file, f"line {number}", found, expected)
    return _Record(number, tuple(values))


def _form(file: str, records: Sequence[_Record], stated: int | None) -> tuple[int, list[str]]:
    """Return the format of observations, and notes on it."""
    count, line = len(records[0].values), f"line {records[0].line}"
    fits = [form for form, least in _COUNTS.items() if 0 <= count - least <= _AUXILIARY]
    if not fits or (stated and stated not in fits):
        of = [_COUNTS[stated]] if stated else _COUNTS.values()
        expected = f"{joined([str(n) for n in of], 'or')}, and up to {_AUXILIARY} auxiliary readings"
        raise InputFileError(file, line, f"{count} numbers of an observation", expected)
    can_be = [form for form in fits if all(_can_be(form, record.values) for record in records)]
    form = stated or (can_be or fits)[0]
    notes = [f"Observations are of format {form}: {_WORDS[form]}."]
    if len(fits) > 1 and not stated:
        others = joined([str(each) for each in fits if each != form], "or")
        notes.append(
            f"Their {count} numbers a line could be of format {others}, too: --format says otherwise."
        )
    return form, notes


def _can_be(form: int, v: Sequence[float]) -> bool:
    """Return whether the numbers of a line can be of a format: minutes, an equinox, a sidereal time."""
    if form == 4:
        return True
    star, telescope = v[:6], v[_COUNTS[1] - 8 :] if form == 1 else v[6:]
    minutes = all(0 <= x <= 60 for angles in (star, telescope) for x in (*angles[1:3], *angles[4:6]))
    sidereal = form == 3 or (v[_COUNTS[form] - 2] in range(25) and 0 <= v[_COUNTS[form] - 1] <= 60)
    return minutes and sidereal and (form != 1 or v[8] > 1000)


def _sexagesimal(values: Sequence[float]) -> float:
    """Return degrees or hours from degrees or hours, whose sign counts, also that of -0, minutes and seconds."""
    first, minutes, seconds = values
    return math.copysign(abs(first) + minutes / 60 + seconds / 3600, first)


def _hour_angles(
    file: str, records: Sequence[_Record], site: Site, form: int
) -> tuple[Array, Array, Array | None]:
    """Return hour angle and declination of stars and telescope, rad, and the sidereal time, h."""
    stars, telescopes, sidereal = [], [], []
    for record in records:
        v = record.values
        star = [15 * _sexagesimal(v[:3]), _sexagesimal(v[3:6])]
        if form == 1:
            star = _apparent(file, record.line, star, v[6:9], site)
        telescope = [15 * _sexagesimal(v[-8:-5]), _sexagesimal(v[-5:-2])]
        if form == 3:
            telescope = [15 * _sexagesimal(v[6:9]), _sexagesimal(v[9:12])]
        else:
            time = v[-2] + v[-1] / 60
            sidereal.append(time)
            star, telescope = ([15 * time - a, d] for a, d in (star, telescope))
        for place, angle in (("declination", star[1]), ("sidereal time", 0 if form == 3 else sidereal[-1])):
            if abs(angle) > 90:
                raise InputFileError(
                    file, f"line {record.line}", f"a {place} of {angle:.6g}", "at most 90 (24 h)"
                )
        stars.append(star)
        telescopes.append(telescope)
    folded = np.radians([stars, telescopes])
    folded[..., 0] = (folded[..., 0] + np.pi) % (2 * np.pi) - np.pi
    return folded[0], folded[1], np.array(sidereal) if sidereal else None


def _apparent(file: str, line: int, mean: Sequence[float], rest: Sequence[float], site: Site) -> list[float]:
    """Return the apparent right ascension and declination, deg, of a mean place."""
    import erfa

    across, along, equinox = rest
    if equinox < 1984:
        raise InputFileError(
            file,
            f"line {line}",
            f"the equinox {equinox:g}",
            "one from 1984 on: places of FK4 are reduced first",
        )
    if site.date is None:
        found = "the mean place of a star, and no date with the latitude of the site"
        raise InputFileError(file, f"line {line}", found, "year, month and day after the latitude")
    tt = erfa.cal2jd(*site.date)
    place = erfa.s2c(*np.radians(mean))
    ra, dec = erfa.c2s(erfa.pmat06(*erfa.epj2jd(equinox)).T @ place)
    motion = math.radians(across / 240), math.radians(along / 3600)
    seen_ra, seen_dec, origins = erfa.atci13(ra, dec, *motion, 0.0, 0.0, *tt)
    return [math.degrees(seen_ra - origins), math.degrees(seen_dec)]


def _observed(seen: Array, site: Site, *, diurnal: bool) -> Array:
    """Return directions with diurnal aberration, towards the east, and lifted by refraction."""
    if diurnal:
        seen = seen + np.array([0.0, _DIURNAL * math.cos(site.latitude), 0.0])
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    if not site.pressure:
        return seen
    import erfa

    zenith = -np.array(EQUATORIAL.gravity(site.latitude))
    warm = 10.0 if site.temperature is None else site.temperature
    a, b = erfa.refco(site.pressure, warm, site.humidity, site.wavelength)
    height = np.maximum(seen @ zenith, 0.05)  # ERFA's own limit, 3 degrees
    level = seen - np.outer(seen @ zenith, zenith)
    tangent = np.linalg.norm(level, axis=1) / height
    lift = (a + b * tangent**2) * tangent / (1 + (a + 3 * b * tangent**2) / height**2)
    across = np.cross(np.cross(seen, zenith), seen)  # towards the zenith
    size = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.divide(across, size, out=np.zeros_like(across), where=size > 0)
    return np.asarray(np.cos(lift)[:, None] * seen + np.sin(lift)[:, None] * across)


def _level(latitude: float) -> Array:
    """Return the matrix that takes rows from the equatorial mount's frame to east, north and up."""
    cos, sin = math.cos(latitude), math.sin(latitude)
    return np.array([[0.0, 1.0, 0.0], [-sin, 0.0, cos], [cos, 0.0, sin]]).T


def _on_reduction(site: Site, no_diurnal: bool) -> Iterator[str]:
    done = [] if no_diurnal else ["diurnal aberration"]
    done += ["refraction by the pressure of the file"] if site.pressure else []
    if done:
        yield f"Places of stars are reduced by {' and '.join(done)}."
    if not site.pressure:
        yield "No pressure is given: refraction is left to the model, as the effect refraction."


def _elapsed(sidereal: Array) -> Array:
    steps = (np.diff(sidereal, prepend=sidereal[0]) + 12) % 24 - 12
    return np.asarray(np.cumsum(steps) * _SIDEREAL)


# the MMT's log ----------------------------------------------------------------------------------------------


def _of_log(file: str, lines: Sequence[tuple[int, str]]) -> Pointings:
    """Return the run of a log: of each star RAA, elevation and azimuth of the encoders, TAA, of the star, and LST."""
    columns_of: dict[str, list[list[float]]] = {"RAA": [], "TAA": [], "LST": []}
    stars: list[str] = []
    for number, line in lines:
        key, _, rest = line.partition(":")
        if key == "CAT" and rest.strip():
            stars.append(rest.split()[0])
        if key in columns_of:
            values = _numbers(file, number, rest.replace(":", " "))
            if len(values) != (3 if key == "LST" else 2):
                raise InputFileError(
                    file, f"line {number}", shown(line), f"{key}: elevation and azimuth in degrees"
                )
            if key == "RAA":
                for name in ("TAA", "LST"):
                    if len(columns_of[name]) not in (0, len(columns_of["RAA"])):
                        raise InputFileError(
                            file, f"line {number}", f"a star before it without {name}", "one of each"
                        )
            columns_of[key].append(values)
    if len(columns_of["RAA"]) != len(columns_of["TAA"]):
        count = f"{len(columns_of['RAA'])} lines RAA and {len(columns_of['TAA'])} lines TAA"
        raise InputFileError(file, "file", count, "one of each for each star")
    raw, true = (np.radians(columns_of[key])[:, ::-1] for key in ("RAA", "TAA"))
    times = np.array(columns_of["LST"])
    time = _elapsed(times @ [1, 1 / 60, 1 / 3600]) if len(times) == len(raw) else None
    notes = [
        "Log of the MMT's mount: RAA is what the encoders read, TAA where the star is; elevation, then azimuth."
    ]
    return Pointings(
        "MMT pointing run",
        ALTAZ,
        None,
        raw,
        ALTAZ.direction(*true.T),
        time,
        np.empty((len(raw), 0)),
        tuple(notes),
        tuple(stars),
    )
