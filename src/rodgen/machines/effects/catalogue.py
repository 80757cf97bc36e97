"""The catalogue: every effect that a chain or a closed chain may have, with its formula and in a mechanic's words.

It is one table, a row an effect: name, where, what it changes, formula, parameters with units; then the words. What
the names in the formulas and the placeholders in the units mean is said at `EffectDefinition`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rodgen.errors import UnexpectedError, nearest_name, shown
from rodgen.machines.effects.definition import EffectDefinition, StartSearch
from rodgen.machines.effects.formula import Formula

_ISO_1 = "ISO 230-1:2012, Geometric accuracy of machines operating under no-load or quasi-static conditions"
_ISO_2 = "ISO 230-2:2014, Determination of accuracy and repeatability of positioning of numerically controlled axes"
_ISO_3 = "ISO 230-3:2020, Determination of thermal effects"
_ISO_10360 = "ISO 10360-2:2009, Acceptance and reverification tests for coordinate measuring machines (CMM)"
_ISO_7 = "ISO 230-7:2015, Geometric accuracy of axes of rotation"
_SLOCUM = "A. H. Slocum, Precision Machine Design, Prentice Hall 1992"
_SCHWENKE = (
    "H. Schwenke et al., Geometric error measurement and compensation of machines - an update, "
    "CIRP Annals 57 (2008) 660-675"
)
_MAYR = "J. Mayr et al., Thermal issues in machine tools, CIRP Annals 61 (2012) 771-791"
_WALLACE = "P. T. Wallace, A rigorous algorithm for telescope pointing, Proc. SPIE 4848 (2002) 125-136"
_TPOINT = "P. T. Wallace, TPOINT - Telescope Pointing Analysis System, Starlink User Note 100, 1994"
_MUDERS = "D. Muders et al., Multi-Beam FITS Raw Data Format, APEX (pointing terms HACA2, HESA2, HECA3 and the like)"
_MOORING = "B. W. Mooring, Z. S. Roth, M. R. Driels, Fundamentals of Manipulator Calibration, Wiley 1991"
_HOLLERBACH = (
    "J. Hollerbach, W. Khalil, M. Gautier, Model identification, in Springer Handbook of Robotics, 2008"
)
_KHALIL = "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, Hermes Penton 2002"
_WHITNEY = (
    "D. E. Whitney, C. A. Lozinski, J. M. Rourke, Industrial robot forward calibration method and results, "
    "J. Dyn. Syst. Meas. Control 108 (1986) 1-8"
)
_JUDD = (
    "R. P. Judd, A. B. Knasinski, A technique to calibrate industrial robots with experimental verification, "
    "IEEE Trans. Robotics Autom. 6 (1990) 20-30"
)
_HEIDENHAIN = (
    "Heidenhain, Angle Encoders (brochure): the error in arcsec is 412 times the eccentricity in µm over the "
    "diameter of the graduation in mm"
)
_TRACKERS = (
    "B. Muralikrishnan, S. Phillips, D. Sawyer, Laser trackers for large-scale dimensional metrology: a review, "
    "Precision Engineering 44 (2016) 13-28"
)
_ALTINTAS = "Y. Altintas, Manufacturing Automation, Cambridge University Press 2012"
_TIMOSHENKO = "S. Timoshenko, Strength of Materials, Part I, Van Nostrand 1955 (deflection of beams)"
_KUREKOVA = (
    "E. Kureková et al., Positioning uncertainty of the Tricept type parallel kinematic structure, "
    "Acta IMEKO 4(4) (2015) 9-15"
)
_CLAVEL = "R. Clavel, Conception d'un robot parallèle rapide à 4 degrés de liberté, EPFL 1991"
_VISCHER = (
    "P. Vischer, R. Clavel, Kinematic calibration of the parallel Delta robot, Robotica 16 (1998) 207-218"
)
_MERLET = "J.-P. Merlet, Parallel Robots, 2nd ed., Springer 2006"
_ALMANAC = (
    "S. E. Urban, P. K. Seidelmann (eds.), Explanatory Supplement to the Astronomical Almanac, "
    "University Science Books 2013"
)


def _in(unit: str, names: str) -> dict[str, str]:
    """Give several parameters one unit."""
    return dict.fromkeys(names.split(), unit)


def _row(
    name: str,
    at: str,
    component: str,
    formula: str,
    parameters: dict[str, str],
    *,
    slope: str = "",
    **words: Any,
) -> EffectDefinition:
    def parsed(text: str) -> Formula:
        return Formula.parse(text, file="catalogue", place=name)

    return EffectDefinition(
        name,
        frozenset(at.split()),
        component,
        parsed(formula),
        parameters,
        slope=parsed(slope) if slope else None,
        **words,
    )


_LETTERS = {"azimuth": "A", "elevation": "E", "polar": "H", "declination": "D"}
"""By axis: TPOINT's letter in the names of harmonics, which are H, the result, S or C, the coordinate, and a number."""


def _waves(**times: int) -> dict[str, str]:
    """Return TPOINT's harmonics of the reading of each axis by itself, by endings of parameters.

    Azimuth counts from south, and is positive to the left: sin(nA) and cos(nA) become -(-1)^n of it and (-1)^n.
    """
    return {
        f"H{letter}{function}{letter}{n}": f"{'-' * (letter == 'A' and (function == 'C') ^ n % 2)}{x}{ending[1:]} "
        f"at the {axis} axis"
        for axis, letter in _LETTERS.items()
        for ending, n in times.items()
        for function, x in (("S", "b"), ("C", "a"))
    }


def _across(count: int) -> tuple[str, str]:
    """Return so many waves a turn along U and along V as a formula, and the names of their amplitudes."""
    names = [f"{x}_{f[0]}{n}" for x in "uv" for n in range(1, count + 1) for f in ("cos", "sin")]
    waves = [f"{f}({f'{n}*' * (n > 1)}q)" for n in range(1, count + 1) for f in ("cos", "sin")]
    u, v = (
        " + ".join(f"{name}*{wave}" for name, wave in zip(some, waves, strict=True))
        for some in (names[: len(waves)], names[len(waves) :])
    )
    return f"({u})*U + ({v})*V", " ".join(names)


_TWO_WAVES, _EIGHT = _across(2)
_FOUR_WAVES, _SIXTEEN = _across(4)

_REVOLUTE = (
    _row(
        "axis_tilt", "revolute", "axis", "a*U + b*V", _in("arcsec", "a b"), entry="vector",
        iso="EA0C, EB0C",
        tpoint={
            "AN": "-a at the azimuth axis", "AW": "b at the azimuth axis", "NPAE": "-a at the elevation axis",
            "MA": "-a at the polar axis", "ME": "b at the polar axis", "NP": "-b at the declination axis",
        },
        meaning="The axis of rotation is not parallel to the machine axis that it is named after. What it carries "
        "leans over, towards another side at every angle; the error grows with the distance from the axis.",
        usual_size="2 to 20 arcsec on a machine tool, some arcmin on a robot or a site-built mount",
        remedy="Shim or scrape the seat of the bearing housing, or enter the axis direction in the control.",
        source=f"{_ISO_1}; {_MOORING}; {_WALLACE}",
    ),
    _row(
        "axis_offset", "revolute", "point", "a*U + b*V", _in("{length}", "a b"), entry="vector",
        iso="EX0C, EY0C",
        meaning="The axis of rotation is not where the control believes it to be. Turning it carries "
        "the target about the wrong centre: the error is the same on the whole radius and turns with the axis.",
        usual_size="0.005 to 0.1 mm on a machine tool, 0.1 to 1 mm on a robot",
        remedy="Measure the centre of rotation with a ball and enter it in the control (its pivot or rotary table "
        "position); after a collision check the seat.",
        source=f"{_ISO_1}; {_SCHWENKE}",
    ),
    _row(
        "zero_offset", "revolute", "reading", "a", {"a": "arcsec"}, entry="constant",
        iso="EC0C",
        tpoint={
            "IA": "-a at the azimuth axis", "IE": "a at the elevation axis",
            "IH": "a at the polar axis", "ID": "a at the declination axis",
        },
        meaning="The reference mark or the homing switch is not where the control believes zero to be. Every angle "
        "is wrong by the same amount, so everything is turned about this axis.",
        usual_size="5 to 200 arcsec after homing, degrees after an encoder was changed",
        remedy="Enter the offset as the home position of the axis.",
        source=f"{_ISO_1}; {_MOORING}",
    ),
    _row(
        "scale", "revolute", "reading", "k*q", {"k": "1"}, entry="scale",
        iso="ECC (linear part)",
        meaning="A full turn of the drive is not a full turn of the axis: a gear ratio or a number of counts per "
        "turn that is slightly wrong, or a tape scale on a drum. The error grows in proportion to the angle.",
        usual_size="0 with a scale on the axis itself; 1e-5 to 1e-3 with a friction drive or a tape on a drum",
        remedy="Correct the gear ratio or the counts per turn in the control; a friction drive needs a scale on the "
        "axis.",
        source=f"{_ISO_2}; {_WHITNEY}",
    ),
    _row(
        "encoder_eccentricity", "revolute", "reading", "a*cos(q) + b*sin(q)", _in("arcsec", "a b"),
        entry="eccentricity",
        iso="ECC (once per turn)",
        tpoint={
            "ACES": "-b at the azimuth axis", "ACEC": "a at the azimuth axis",
            "ECES": "b at the elevation axis", "ECEC": "a at the elevation axis",
            "HCES": "b at the polar axis", "HCEC": "a at the polar axis",
            "DCES": "b at the declination axis", "DCEC": "a at the declination axis",
            "NRX": "b at the elevation axis", "NRY": "a at the elevation axis",
        },
        meaning="The graduated disc of the encoder sits off the axis, or the axis runs out below it. The reading is "
        "fast on one side of the turn and slow on the other: one wave in each turn. Offsets of the two signals of a "
        "resolver or a magnetic encoder do the same.",
        usual_size="2 to 40 arcsec: 10 µm of eccentricity on a graduation of 100 mm are 41 arcsec; a resolver some "
        "arcmin, a magnet on a shaft up to a degree",
        remedy="Centre the disc with a dial gauge, read it with two heads on opposite sides, or enter the wave in "
        "the control's compensation table.",
        source=f"{_HEIDENHAIN}; {_SLOCUM}",
    ),
    _row(
        "encoder_ellipticity", "revolute", "reading", "a*cos(2*q) + b*sin(2*q)", _in("arcsec", "a b"),
        entry="ellipticity",
        iso="ECC (twice per turn)",
        tpoint=_waves(_=2),
        meaning="The graduation is out of round: a disc clamped on a bent hub, a drum pressed oval, a tape whose "
        "ends meet badly. Two waves in each turn; two heads on opposite sides do not see them. Unequal "
        "signals of a resolver, or such that are not 90 degrees apart, do the same.",
        usual_size="0.5 to 10 arcsec; a resolver some arcmin",
        remedy="Clamp the disc without bending it, read it with four heads, or enter the wave in the control.",
        source=f"{_HEIDENHAIN}; {_SLOCUM}",
    ),
    _row(
        "encoder_harmonics", "revolute", "reading", "a4*cos(4*q) + b4*sin(4*q) + a8*cos(8*q) + b8*sin(8*q)",
        _in("arcsec", "a4 b4 a8 b8"), entry="waves",
        iso="ECC (four and eight times per turn)",
        tpoint=_waves(_3=3, _4=4, _8=8),
        meaning="The graduation is strained by four screws, or read by four heads that do not agree, or a resolver of "
        "four pole pairs has unequal windings. Four and eight waves in each turn.",
        usual_size="0.5 to 5 arcsec of a graduation, 10 to 60 arcsec of a resolver",
        remedy="Clamp the disc evenly, adjust offset and gain of the signals, or enter the waves in the control.",
        source=f"{_HEIDENHAIN}; {_SLOCUM}",
    ).with_directions(
        "a3*cos(3*q) + b3*sin(3*q) + a4*cos(4*q) + b4*sin(4*q) + a8*cos(8*q) + b8*sin(8*q)",
        _in("arcsec", "a3 b3 a4 b4 a8 b8"),
    ),
    _row(
        "periodic_drive_error", "revolute", "reading", "a*sin(2*pi*q/P) + b*cos(2*pi*q/P)",
        _in("arcsec", "a b") | {"P": "deg"}, entry="period",
        of_drive=True,
        iso="ECC (periodic part)",
        searched={"P": StartSearch.PERIOD}, given_by_joint={"P": "period"},
        tpoint={
            "HGES": "a (P = 9 deg) at the polar axis", "HGEC": "b (P = 9 deg) at the polar axis",
            "DGES": "a (P = 9 deg) at the declination axis", "DGEC": "b (P = 9 deg) at the declination axis",
        },
        meaning="A part of the drive runs out: worm, pinion, gear, or the wave generator of a strain wave gear. The "
        "error repeats with each turn of that part, many times in a turn of the axis.",
        usual_size="2 to 60 arcsec; period 360° over the gear ratio, or half of it in a strain wave gear",
        remedy="Replace or centre the worm or gear, put a scale on the axis itself, or enter the wave in the "
        "control.",
        source=f"{_JUDD}; {_SLOCUM}",
    ),
    _row(
        "radial_error_motion", "revolute", "translation", _TWO_WAVES,
        _in("{length}", _EIGHT), entry="waves",
        iso="EXC, EYC",
        meaning="The axis itself moves sideways while it turns, because races and rollers are not round. The target "
        "moves by the same amount wherever it sits, once or twice in each turn.",
        usual_size="0.1 to 2 µm with air or oil bearings, 1 to 10 µm with rolling bearings",
        remedy="Renew or preload the bearing, or add the motion to the compensation of the linear axes.",
        source=_ISO_7,
    ),
    _row(
        "axial_error_motion", "revolute", "translation",
        "(c1*cos(q) + s1*sin(q) + c2*cos(2*q) + s2*sin(2*q))*N", _in("{length}", "c1 s1 c2 s2"), entry="waves",
        iso="EZC",
        meaning="The table or spindle rises and sinks along its axis while it turns: the thrust bearing's race is "
        "not flat or not square to the axis. The whole platter moves alike, at every radius.",
        usual_size="0.1 to 1 µm with air or oil bearings, 1 to 5 µm with rolling bearings",
        remedy="Lap or renew the thrust race and its seat, or compensate along the axis of rotation.",
        source=_ISO_7,
    ),
    _row(
        "tilt_error_motion", "revolute", "rotation", _TWO_WAVES,
        _in("arcsec", _EIGHT), entry="waves",
        iso="EAC, EBC",
        meaning="The axis wobbles while it turns, as two bearings run out against each other or a large race is "
        "warped. The error grows with the height above the bearing and with the radius.",
        usual_size="0.2 to 2 arcsec for a good table, 2 to 10 arcsec for a large ring bearing",
        remedy="Renew or re-seat the bearing on a flat face; compensation needs two further rotary axes.",
        source=_ISO_7,
    ).with_directions(_FOUR_WAVES, _in("arcsec", _SIXTEEN)),
    _row(
        "backlash", "revolute", "reading", "-b/2*s", {"b": "arcsec"}, entry="backlash",
        of_drive=True,
        iso="B of ECC (reversal value)",
        meaning="There is play between drive and axis, in a worm, a gear or a coupling, and the encoder sits on the "
        "motor. The axis stays behind by half of the play, on the side where it comes from.",
        usual_size="5 to 60 arcsec with a worm or spur gear, 0 with a scale on the axis itself",
        remedy="Preload the worm or the split gear, always approach from one side, or enter the backlash in the "
        "control.",
        source=f"{_ISO_2}; {_WHITNEY}",
    ),
    _row(
        "backlash_gradient", "revolute", "reading", "-k*s*q", {"k": "1"}, entry="backlash-gradient",
        of_drive=True,
        iso="B of ECC (change over the travel)",
        meaning="The play differs along the turn, because the gear is worn where it works most or meshes "
        "eccentrically. The difference between the two directions of approach grows with the angle.",
        usual_size="4e-7 to 4e-6: 1 to 10 arcsec more play over a turn",
        remedy="Renew the worn gear or re-centre it; the control's backlash must then be a table over the angle.",
        source=_ISO_2,
    ),
    _row(
        "servo_lag", "revolute", "reading", "-tau*v", {"tau": "s"}, entry="lag",
        meaning="The axis is read while it moves and follows its command late, or the reading is taken late. The "
        "error grows with the speed, changes its sign with it, and is gone at rest.",
        usual_size="0.01 to 50 ms",
        remedy="Use velocity feed-forward or a higher position gain, or correct the delay of the trigger.",
        source=_ALTINTAS,
    ),
    _row(
        "acceleration_lag", "revolute", "reading", "-k*acc", {"k": "s**2"}, entry="acceleration-lag",
        meaning="The axis is read while its speed changes, and stays behind its command in proportion to the "
        "acceleration: the servo does not feed the torque forward, or the drive between motor and axis winds up under "
        "the inertia that it moves.",
        usual_size="1e-5 to 1e-3 s²: 1/ω² of the servo or of the drive, 1e-4 s² at 16 Hz",
        remedy="Use acceleration feed-forward, a lower jerk, or a stiffer drive; or read where it does not accelerate.",
        source=_ALTINTAS,
    ),
    _row(
        "gravity_windup", "revolute", "reading", "k*M + k2*M_perp", _in("arcsec/{arm}", "k k2"), entry="gravity-windup",
        of_drive=True, later_joints=True,
        meaning="The drive and the tube wind up under the weight that they carry, as far as the encoder does not see "
        "it. The axis droops most where the load stands out level, and not at all where it stands upright; k2 is for "
        "a weight off the line to the target.",
        usual_size="1 to 60 arcsec between level and upright; robots some arcmin",
        remedy="Balance the axis with a counterweight, put the encoder on the load's side, or compensate in the "
        "control.",
        source=f"{_TPOINT} (term TF); {_KHALIL}",
    ),
    _row(
        "coupling", "revolute", "reading", "k*q_before", {"k": "1"}, entry="coupling",
        of_drive=True,
        meaning="The drive of this joint runs through the joint before it, as the shafts, bevel gears or belts of a "
        "wrist do, so that turning that one turns this one too. What the control takes off for it is a little wrong, "
        "or nothing. The error grows in proportion to the angle of the joint before.",
        usual_size="1e-5 to 1e-3 where the control takes it off; 0.01 to 1 where the control does not know of it",
        remedy="Enter the coupling ratio of the gears in the control, from their numbers of teeth.",
        source=f"{_KHALIL}; {_MOORING}",
    ),
    _row(
        "load_windup", "revolute", "reading", "k*F*M", {"k": "arcsec/N/{arm}"}, entry="load-windup",
        of_drive=True,
        meaning="The drive winds up under the payload, as a spring between encoder and load. The axis droops in "
        "proportion to load and lever arm, so it shows only when readings with different loads are compared.",
        usual_size="2e-5 to 0.02 arcsec/N/mm, for drives from 1e7 down to 1e4 N m/rad",
        remedy="Stiffen the drive, put the encoder on the load's side, or let the control correct by the known "
        "payload.",
        source=f"{_KHALIL}; {_JUDD}",
    ),
    _row(
        "lateral_windup", "revolute", "rotation", "a*M_across", {"a": "arcsec/{arm}"}, entry="lateral-windup",
        meaning="The bearing gives way to the overturning moment of what it carries. The axis leans over towards the "
        "heavy side, and the lean turns with the load.",
        usual_size="1 to 30 arcsec for a crossed-roller bearing near its rated moment",
        remedy="Preload or enlarge the bearing, balance the load, or compensate in the control.",
        source=f"{_KHALIL}; {_SLOCUM}",
    ),
    _row(
        "axis_flexure", "revolute", "rotation", "a*bend", {"a": "arcsec"}, entry="axis-flexure",
        of_directions=True,
        tpoint={"DAF": "-a at the declination axis"},
        meaning="The axis is a shaft that stands out of its bearings, such as the declination axis of a German "
        "mount, and bends under its own weight and what it carries. Its end sinks, most where the shaft is level, "
        "and the line of sight leans sideways with it.",
        usual_size="5 to 120 arcsec between a level and an upright shaft",
        remedy="Shorten or stiffen the shaft, balance it close to its bearings, or enter it in the pointing model.",
        source=f"{_TPOINT} (term DAF); {_WALLACE}",
    ),
    _row(
        "bearing_waves", "revolute", "reading",
        "a2*cos(2*q_before) + b2*sin(2*q_before) + a3*cos(3*q_before) + b3*sin(3*q_before)",
        _in("arcsec", "a2 b2 a3 b3"), entry="waves",
        of_directions=True,
        tpoint={
            f"H{second}{function}{first}{n}": f"{'-' * (negative == f'{first}{function}{n}')}{x}{n} at the {axis} axis"
            for axis, second, first in (("elevation", "E", "A"), ("declination", "D", "H"))
            for n, negative in ((2, "AS2"), (3, "AC3"))  # of azimuth from south
            for function, x in (("S", "b"), ("C", "a"))
        },
        meaning="The bearing or the track on which the axis before turns is not flat, or its supports yield unequally. "
        "What it carries nods twice or three times in each turn, and this axis with it.",
        usual_size="0.2 to 5 arcsec; some 10 arcsec of a telescope on wheels and a track",
        remedy="Level the track or shim the bearing's supports, or enter the waves in the pointing model.",
        source=f"{_TPOINT} (harmonics, HESA2 and the like); {_MUDERS}",
    ),
    _row(
        "fork_flexure", "revolute", "reading", "a*fork", {"a": "arcsec"}, entry="fork-flexure",
        of_directions=True,
        tpoint={"FO": "a cos(latitude) at the declination axis"},
        meaning="A fork that stands on the axis before carries this axis, and bends under its own weight and what it "
        "carries. This axis and the tube turn as the fork sinks, and most where it leans over as far as it can.",
        usual_size="5 to 120 arcsec on an equatorial fork; 0 on an upright one",
        remedy="Stiffen the fork, balance what it carries, or enter it in the pointing model.",
        source=f"{_TPOINT} (term FO); {_WALLACE}",
    ),
    _row(
        "thermal_offset", "revolute", "reading", "k*T", {"k": "arcsec/K"}, entry="thermal-offset",
        iso="EC0C (with temperature)",
        meaning="Scale and reading head, or motor and table, shift against each other as the joint warms up. All "
        "angles change together, and come back when it cools.",
        usual_size="0.1 to 3 arcsec/K",
        remedy="Warm up before work, cool the motor, or let the control correct by the temperature of the joint.",
        source=f"{_ISO_3}; {_MAYR}",
    ),
    _row(
        "thermal_axis_drift", "revolute", "translation", "(x*EX + y*EY + z*EZ)*T", _in("{length}/K", "x y z"),
        entry="thermal-drift",
        iso="EX0C, EY0C, EZ0C (with temperature)",
        meaning="The housing of the axis grows as motor and bearing warm it, and carries the axis away from its "
        "place. All targets on it move alike, in proportion to its temperature.",
        usual_size="1 to 15 µm/K",
        remedy="Cool the motor, let it warm up before work, or measure the centre again and correct it by "
        "temperature.",
        source=f"{_ISO_3}; {_MAYR}",
    ),
)  # fmt: skip

_PRISMATIC = (
    _row(
        "squareness", "prismatic", "axis", "a*U + b*V", _in("arcsec", "a b"), entry="vector",
        iso="EC0Y, EB0Z, EA0Z and the like",
        meaning="The guideway is not square to the others, or not parallel to the machine axis that it is named "
        "after. The carriage runs off sideways in proportion to its way, so a square comes out as a rhomb.",
        usual_size="1 to 10 arcsec on a measuring machine, 5 to 40 arcsec on a machine tool: 10 arcsec are 48 µm/m",
        remedy="Align the guideway, or enter the squareness in the control.",
        source=f"{_ISO_1}; {_SCHWENKE}",
    ),
    _row(
        "zero_offset", "prismatic", "reading", "a", {"a": "{length}"}, entry="constant",
        iso="EX0X",
        meaning="The reference mark or the homing switch is not where the control believes zero to be. Every "
        "coordinate of this axis is wrong by the same amount.",
        usual_size="0.001 to 0.5 mm after homing",
        remedy="Enter the offset as the home position of the axis.",
        source=f"{_ISO_1}; {_MOORING}",
    ),
    _row(
        "scale", "prismatic", "reading", "k*q", {"k": "1"}, entry="scale",
        iso="EXX (linear part)",
        meaning="The scale, the screw or the belt is longer or shorter than it says, from its making, its mounting "
        "or a temperature that is not the reference. The error grows in proportion to the way.",
        usual_size="1e-6 to 2e-5 with a scale, 1e-5 to 5e-5 with a screw: 10 to 50 µm/m",
        remedy="Enter a linear compensation, measured with a laser interferometer, at the temperature of work.",
        source=f"{_ISO_2}; {_SCHWENKE}",
    ),
    _row(
        "periodic_drive_error", "prismatic", "reading", "a*sin(2*pi*q/P) + b*cos(2*pi*q/P)",
        _in("{length}", "a b P"), entry="period",
        of_drive=True,
        iso="EXX (periodic part)",
        searched={"P": StartSearch.PERIOD}, given_by_joint={"P": "period"},
        meaning="The screw or the pinion runs out, or its coupling or encoder sits eccentrically. The error repeats "
        "with each turn, that is with each lead of the screw.",
        usual_size="1 to 10 µm; period 5 to 20 mm, the lead",
        remedy="Align the screw's bearing and coupling, put a scale on the carriage, or enter the wave in the "
        "control.",
        source=f"{_ISO_2}; {_SLOCUM}",
    ),
    _row(
        "straightness", "prismatic", "translation",
        "(u_2*U + v_2*V)*P2 + (u_3*U + v_3*V)*P3 + (u_4*U + v_4*V)*P4", _in("{length}", "u_2 u_3 u_4 v_2 v_3 v_4"),
        entry="legendre",
        iso="EYX, EZX",
        meaning="The guideway is bent: the carriage leaves the straight line sideways, in a bow (2), an S (3) or a "
        "double bow (4). All targets move alike, however far out they are.",
        usual_size="1 to 10 µm per metre of travel",
        remedy="Align or scrape the guideway, level the bed, or enter the straightness as a table across the axis.",
        source=f"{_ISO_1}; {_SCHWENKE}",
    ),
    _row(
        "angular_error_motion", "prismatic", "rotation",
        "(x_1*EX + y_1*EY + z_1*EZ)*P1 + (x_2*EX + y_2*EY + z_2*EZ)*P2 + (x_3*EX + y_3*EY + z_3*EZ)*P3",
        _in("arcsec", "x_1 y_1 z_1 x_2 y_2 z_2 x_3 y_3 z_3"), entry="legendre",
        iso="EAX, EBX, ECX",
        meaning="The carriage rolls, pitches and yaws while it moves, because its guideways are bent or not "
        "parallel. The error grows with the distance of the target from the guideway (Abbe's offset).",
        usual_size="1 to 20 arcsec: 10 arcsec at an offset of 500 mm are 24 µm",
        remedy="Align the rails to each other, bring scale and work closer together, or enter the angles in the "
        "control's volumetric compensation.",
        source=f"{_ISO_1}; {_SCHWENKE}",
    ),
    _row(
        "backlash", "prismatic", "reading", "-b/2*s", {"b": "{length}"}, entry="backlash",
        of_drive=True,
        iso="B of EXX (reversal value)",
        meaning="There is play between nut and screw, pinion and rack, or in the coupling, and the encoder sits on "
        "the motor. The carriage stays behind by half of the play, on the side where it comes from.",
        usual_size="2 to 30 µm; 0 to 2 µm with a scale on the carriage",
        remedy="Preload the nut, always approach from one side, or enter the backlash in the control.",
        source=_ISO_2,
    ),
    _row(
        "backlash_gradient", "prismatic", "reading", "-k*s*q", {"k": "1"}, entry="backlash-gradient",
        of_drive=True,
        iso="B of EXX (change over the travel)",
        meaning="The play differs along the travel: the screw is worn where it works most, or winds up more the "
        "longer the way from its drive. The difference between the two directions of approach grows with that way.",
        usual_size="5e-7 to 1e-5: 1 to 20 µm more play per metre",
        remedy="Renew the screw, drive it from both ends, put a scale on the carriage, or use a table over the "
        "travel.",
        source=f"{_ISO_2}; {_SLOCUM}",
    ),
    _row(
        "servo_lag", "prismatic", "reading", "-tau*v", {"tau": "s"}, entry="lag",
        meaning="The carriage is read while it moves and follows its command late, or the reading is taken late. The "
        "error grows with the speed, changes its sign with it, and is gone at rest.",
        usual_size="0.01 to 50 ms",
        remedy="Use velocity feed-forward or a higher position gain, or correct the delay of the trigger.",
        source=_ALTINTAS,
    ),
    _row(
        "acceleration_lag", "prismatic", "reading", "-k*acc", {"k": "s**2"}, entry="acceleration-lag",
        meaning="The carriage is read while its speed changes, and stays behind its command in proportion to the "
        "acceleration: the servo does not feed the force forward, or screw, belt or coupling yield under the mass that "
        "they move.",
        usual_size="1e-5 to 1e-3 s²: 1/ω² of the servo or of the drive, 1e-4 s² at 16 Hz",
        remedy="Use acceleration feed-forward, a lower jerk, or a stiffer drive; or read where it does not accelerate.",
        source=_ALTINTAS,
    ),
    _row(
        "thermal_offset", "prismatic", "reading", "k*T", {"k": "{length}/K"}, entry="thermal-offset",
        iso="EX0X (with temperature)",
        meaning="What lies between the scale's fixed point and the machine grows as the joint warms up: screw "
        "bearing, bracket, headstock. All coordinates change together, and come back when it cools.",
        usual_size="1 to 15 µm/K",
        remedy="Move the fixed point closer to the work, warm up before work, or correct by the temperature.",
        source=f"{_ISO_3}; {_MAYR}",
    ),
    _row(
        "thermal_expansion", "prismatic", "reading", "alpha*T*q", {"alpha": "1/K"}, entry="expansion",
        iso="EXX (with temperature)",
        meaning="The scale or the screw itself grows with its temperature. The error grows with the travel and "
        "with the temperature: a scale error that comes and goes.",
        usual_size="8e-6/K for glass, 1.1e-5/K for steel, 2.3e-5/K for aluminium, 0 for Zerodur",
        remedy="Enter the coefficient of the scale and measure its temperature, or cool the screw.",
        source=f"{_ISO_3}; {_SLOCUM}",
    ),
    _row(
        "gravity_sag", "prismatic", "sag", "tip*zeta**3 + own*zeta**4 + 16*mid*zeta**2*(1 - zeta)**2",
        _in("{length}", "tip own mid"), entry="gravity-sag",
        slope="(3/2*tip*zeta**2 + 4/3*own*zeta**3 + 32*mid*zeta*(1 - zeta)*(1 - 2*zeta))/L",
        iso="EZX, EBX (from weight)",
        meaning="A beam bends under weight: a ram that slides out sinks at its end under the load there (tip) and "
        "its own weight (own), a bridge sinks in the middle (mid). What it carries drops and turns.",
        usual_size="2 to 100 µm at the end of a ram of 1 m, 2 to 30 µm in the middle of a bridge",
        remedy="Stiffen or counterbalance the beam, scrape the guideway to a counter-curve, or compensate.",
        source=f"{_TIMOSHENKO}; {_SLOCUM}",
    ),
    _row(
        "load_sag", "prismatic", "sag", "F*(k0 + k3*zeta**3)", _in("{length}/N", "k0 k3"), entry="load-sag",
        slope="3/2*F*k3*zeta**2/L",
        meaning="The beam bends under the payload: by k3 as it slides out, by k0 wherever it stands. It shows only "
        "when readings with different loads are compared.",
        usual_size="0.01 to 0.5 µm/N",
        remedy="Stiffen the ram or its guide, or let the control correct by the known payload.",
        source=f"{_TIMOSHENKO}; {_SLOCUM}",
    ),
    _row(
        "guide_windup", "prismatic", "rotation", "(a + b*zeta)*M_guide", _in("arcsec/{arm}", "a b"),
        entry="guide-windup",
        meaning="The guide blocks give way to the overturning moment of what they carry, more towards one end where "
        "bed or crossbeam is softer (b). The carriage leans towards the heavy side.",
        usual_size="0.5 to 20 arcsec when the load stands out as far as it can",
        remedy="Preload the guide blocks or set them further apart, balance the load, or compensate.",
        source=f"{_SLOCUM}; {_SCHWENKE}",
    ),
)  # fmt: skip

_MACHINE = (
    _row(
        "warm_up_drift", "machine", "frame", "(x*EX + y*EY + z*EZ)*(1 - exp(-t/tau))",
        _in("{move}", "x y z") | {"tau": "s"}, entry="warm-up",
        searched={"tau": StartSearch.TIME_CONSTANT},
        meaning="The machine warms up after it is switched on, and the workpiece moves against the instrument or the "
        "spindle. The motion is fast at first and dies away: the readings run off and then stand.",
        usual_size="5 to 100 µm; tau 0.2 to 3 h",
        remedy="Warm up for three times tau before measuring, or repeat a reference point and correct by it.",
        source=f"{_ISO_3}; {_MAYR}",
    ),
    _row(
        "linear_drift", "machine", "frame", "(x*EX + y*EY + z*EZ)*t", _in("{move}/s", "x y z"), entry="drift",
        meaning="The workpiece or the instrument moves steadily while the readings are taken: a room that warms up, "
        "a tripod that settles. The error grows with time and does not ask where the machine stands.",
        usual_size="0.5 to 10 µm/h",
        remedy="Wait for the room to settle, measure faster, and repeat a reference point and correct by it.",
        source=f"{_ISO_3} (environmental temperature variation error)",
    ),
    _row(
        "frame_shift", "machine", "frame_shift", "x*EX + y*EY + z*EZ",
        _in("{length}", "x y z") | _in("arcsec", "rx ry rz"), entry="vector",
        slope="rx*EX + ry*EY + rz*EZ",
        per_run=True,
        meaning="The instrument or the workpiece was set up anew or pushed: all readings of a run are moved and "
        "turned as one rigid piece against the others. Within a run nothing changes.",
        usual_size="as large as the set-up is careless: 0.005 to 1 mm, 1 to 100 arcsec",
        remedy="Measure fixed references in every run, clamp the instrument, and note each set-up in the column run.",
        source=f"{_HOLLERBACH}; {_TRACKERS}",
    ).with_directions("x*EX + y*EY + z*EZ", _in("arcsec", "x y z")),
    _row(
        "instrument_scale", "machine", "factor", "k", {"k": "1"}, entry="constant",
        meaning="The instrument measures all lengths too long or too short: a wrong refractive index of the air, a "
        "camera's scale bar, a thermal length that was not corrected. The error grows with the distance.",
        usual_size="1e-7 to 1e-5 for a laser (1 K of air temperature is 1e-6), 1e-5 to 1e-4 for a camera",
        remedy="Enter temperature, pressure and humidity of the air in the instrument, or calibrate it on a known "
        "length.",
        source=_TRACKERS,
    ),
    _row(
        "instrument_axis_scales", "machine", "axes", "x*read_x*EX + y*read_y*EY", _in("1", "x y"),
        entry="instrument-axes",
        meaning="The scales of the instrument's own axes differ, as those of a measuring machine or arm do, or its "
        "angles and distances do not agree. Lengths along x and y of its frame come out too long against those along "
        "z; what all have in common is instrument_scale.",
        usual_size="1e-6 to 2e-5: 1 to 20 µm/m",
        remedy="Have the instrument calibrated along each axis, on one length in several directions.",
        source=f"{_TRACKERS}; {_SCHWENKE}",
    ),
    _row(
        "instrument_squareness", "machine", "axes", "(xy*read_y + xz*read_z)*EX + yz*read_z*EY",
        _in("arcsec", "xy xz yz"), entry="instrument-axes",
        meaning="The instrument's own axes are not square to each other: the guideways of a measuring machine, or the "
        "linear axes of the machine tool whose probe takes the readings. A right angle is read as wrong by as much, "
        "wherever it lies and whatever the machine does; a circle about z is read as an ellipse.",
        usual_size="1 to 20 arcsec: a good measuring machine 1 to 5, a machine tool up to 20",
        remedy="Measure a square or a ball bar in two diagonals, and enter the squareness in the instrument's "
        "compensation.",
        source=f"{_ISO_10360}; {_ISO_1}, squareness; {_SCHWENKE}",
    ),
    _row(
        "plate_bowl", "machine", "plate", "a*(read_x**2 + read_y**2)", {"a": "1/{length}"}, entry="plate",
        meaning="The plate over which heights are read is not flat but sags or domes, as a bed does that is heated "
        "from below or held at its rim. It is off by a times the square of the distance from the middle.",
        usual_size="0.05 to 0.3 mm at 100 mm from the middle of a printer's bed",
        remedy="Lay a straight edge on the plate before anything of the machine is changed: rods and radius of a delta "
        "bend what is measured alike.",
        source=f"{_ISO_1}, flatness",
    ),
    _row(
        "plate_warp", "machine", "plate", "b*(read_x**2 - read_y**2) + c*2*read_x*read_y", _in("1/{length}", "b c"),
        entry="plate",
        meaning="The plate over which heights are read is warped: it rises one way and falls the other way, along x "
        "and y by b, between the diagonals by c, as a bed does whose corners are screwed down unequally.",
        usual_size="0.05 to 0.3 mm at 100 mm from the middle of a printer's bed",
        remedy="Turn the plate by a quarter turn and probe again: what turns along is the plate's, and the machine may "
        "be right.",
        source=f"{_ISO_1}, flatness",
    ),
    _row(
        "tube_flexure", "machine", "lift", "-a*sin_zenith", {"a": "arcsec"}, entry="tube-flexure",
        of_directions=True,
        tpoint={"TF": "a"},
        meaning="The tube bends under its own weight, or the mirrors sink in their cells. The line of sight droops "
        "towards the horizon, in azimuth and elevation as in hour angle and declination: not at all at the zenith, "
        "by a at the horizon.",
        usual_size="5 to 60 arcsec from zenith to horizon; never 0 on a telescope",
        remedy="Enter it in the control's pointing model; a truss whose two ends sink alike (Serrurier's) has less.",
        source=f"{_TPOINT} (term TF); {_WALLACE}",
    ),
    _row(
        "refraction", "machine", "lift", "a*tan_zenith", {"a": "arcsec"}, entry="refraction",
        of_directions=True,
        tpoint={"TX": "-a"},
        meaning="The air bends light that comes in at a slant, so that things are seen higher than they are. The "
        "error is zero at the zenith and grows with the tangent of the zenith angle towards the horizon, from 85° on "
        "more slowly.",
        usual_size="60 arcsec at sea level for a star, 45 arcsec on a mountain; less what was corrected already",
        remedy="Correct the readings by pressure, temperature and colour, or leave the rest to this term.",
        source=f"{_ALMANAC}; {_TPOINT} (term TX)",
    ),
)  # fmt: skip

_TARGET = (
    _row(
        "target_offset", "target", "target", "x*EX + y*EY + z*EZ", _in("{length}", "x y z"), entry="vector",
        tpoint={"CA": "a", "CH": "-b"},
        meaning="One ball, prism or mark sits elsewhere than the file says: a holder that was swapped, a magnetic "
        "nest with dirt in it, a mirror that is not square. Its readings alone are off, in every pose.",
        usual_size="0.01 to 1 mm",
        remedy="Clean and re-seat the target, measure where it sits, or let the fit find it.",
        source=f"{_MOORING}; {_HOLLERBACH}",
    ).with_directions("a*U + b*V", _in("arcsec", "a b")).with_poses("rx*EX + ry*EY + rz*EZ", _in("arcsec", "rx ry rz")),
    _row(
        "target_remounting", "target", "remounting", "x*EX + y*EY + z*EZ", _in("{length}", "x y z"), entry="vector",
        per_run=True,
        meaning="A ball, prism, mark or marker was taken off between runs and put on again, and sits a little "
        "differently since. Each run alone fits; together they do not. All numbers are relative to the first run.",
        usual_size="0.01 to 1 mm; a marker may be turned by any angle",
        remedy="Leave the target on, use a holder that centres it, note each mounting in the column run, or let the "
        "fit find where it sits in each run.",
        source=f"{_HOLLERBACH}; {_TRACKERS}",
    ).with_directions("a*U + b*V", _in("arcsec", "a b")).with_poses("rx*EX + ry*EY + rz*EZ", _in("arcsec", "rx ry rz")),
)  # fmt: skip


def _radius(plate: str, does: str) -> EffectDefinition:
    """Return the effect of a plate of a hexapod whose joints stand on another circle."""
    return _row(
        f"{plate}_radius", "legs", f"{plate}_joint", "r*U", {"r": "{length}"}, entry="outwards",
        meaning=f"The joints of the {plate} stand on a larger or smaller circle than in the drawing: the plate was "
        f"drilled to another radius, or a radius was entered wrongly. {does}",
        usual_size="0.01 to 0.5 mm as built; any size where a number was mistyped",
        remedy="Measure across the plate, or enter the fitted joint centres in the control.",
        source=f"{_MOORING}; {_MERLET}",
    )  # fmt: skip


_LEG = (
    _row(
        "base_joint_offset", "leg", "base_joint", "x*EX + y*EY + z*EZ", _in("{length}", "x y z"), entry="vector",
        meaning="The centre of the leg's joint on the base is not where the drawing puts it. The leg pulls the "
        "platform from a wrong place: its error changes with the leg's direction.",
        usual_size="0.01 to 0.5 mm as built, a few µm after a calibration",
        remedy="Measure the joint centres on a coordinate measuring machine, or enter the fitted ones in the control.",
        source=f"{_KUREKOVA}, section 3; {_MOORING}",
    ),
    _row(
        "platform_joint_offset", "leg", "platform_joint", "x*EX + y*EY + z*EZ", _in("{length}", "x y z"),
        entry="vector",
        meaning="The centre of the leg's joint on the platform is not where the drawing puts it. It is carried along "
        "with the platform, so its error turns as the platform does.",
        usual_size="0.01 to 0.5 mm as built, a few µm after a calibration",
        remedy="Measure the joint centres on a coordinate measuring machine, or enter the fitted ones in the control.",
        source=f"{_KUREKOVA}, section 3; {_MOORING}",
    ),
    _row(
        "leg_zero_offset", "leg", "reading", "a", {"a": "{length}"}, entry="constant",
        meaning="The leg's reference mark is not where the control believes it to be, or its joints are mounted nearer "
        "or farther. The leg is longer or shorter than commanded, by the same amount everywhere.",
        usual_size="0.001 to 0.5 mm after homing",
        remedy="Enter the offset as the home position of the leg.",
        source=f"{_KUREKOVA}, section 3; {_ISO_2}",
    ),
    _row(
        "leg_scale", "leg", "reading", "k*q", {"k": "1"}, entry="scale",
        meaning="The screw or scale of the leg is longer or shorter than it says. The error grows in proportion to "
        "the leg's whole length.",
        usual_size="1e-6 to 2e-5 with a scale, 1e-5 to 5e-5 with a screw: 10 to 50 µm/m",
        remedy="Enter a linear compensation of the leg, measured at the temperature of work.",
        source=f"{_ISO_2}; {_SCHWENKE}",
    ),
    _row(
        "leg_thermal_expansion", "leg", "reading", "alpha*T*q", {"alpha": "1/K"}, entry="expansion",
        meaning="The leg grows as its screw warms up, in proportion to its temperature and its length. Legs that warm "
        "up unequally tilt the platform; all together they push it away from the base.",
        usual_size="11e-6 to 12e-6 /K for steel: 8 µm/K on 700 mm; less where the scale stays cool",
        remedy="Cool the screw, warm up before work, or let the control correct by the leg's temperature.",
        source=f"{_ISO_3}; {_MAYR}",
    ),
    _row(
        "leg_backlash", "leg", "reading", "-b/2*s", {"b": "{length}"}, entry="backlash",
        meaning="There is play in the leg's nut, gear or joints. The leg stays behind by half of it, on the side where "
        "it comes from.",
        usual_size="0.5 to 20 µm",
        remedy="Preload nut and joints, always approach from one side, or enter the backlash in the control.",
        source=_ISO_2,
    ),
    _row(
        "leg_compliance", "leg", "reading", "c*F*leg_tension", {"c": "{length}/N"}, entry="leg-compliance",
        meaning="Leg, nut and joints give way to the force that the payload puts on this leg, as one spring. The error "
        "grows with the load and with how steeply the leg has to carry it.",
        usual_size="5e-6 to 1e-4 mm/N: 10 to 200 N/µm",
        remedy="Stiffen or preload nut and joints, or let the control correct by the known payload.",
        source=f"{_MERLET}; {_KHALIL}",
    ),
    _radius("base", "All six legs lean by a little more or less."),
    _radius("platform", "The platform turns less or more than it should."),
    _row(
        "platform_shift", "legs", "platform_joint", "x*EX + y*EY + z*EZ", _in("{length}", "x y z"), entry="vector",
        meaning="All joints of the platform sit, together, elsewhere against what is measured on it than in the "
        "drawing: a shim below the platform or below what it carries, or a plate of another thickness.",
        usual_size="0.01 to 1 mm; as thick as a shim",
        remedy="Measure how the platform is mounted, or enter the fitted joint centres in the control.",
        source=_MOORING,
    ),
    _row(
        "common_zero_offset", "legs towers", "reading", "a", {"a": "{length}"}, entry="constant",
        meaning="The zeros of all legs or towers are off alike: they were homed against a gauge, a stop or switches "
        "that are elsewhere than the control believes, or what is measured is nearer or farther than in the drawing.",
        usual_size="0.01 to 1 mm after homing",
        remedy="Enter the offset in the home position of every leg or tower; of a printer, position_endstop or M665 H.",
        source=f"{_KUREKOVA}, section 3; {_VISCHER}",
    ),
    _row(
        "common_zero_offset", "arms", "reading", "a", {"a": "deg"}, entry="constant",
        meaning="The zeros of all arms are off alike: they were homed against stops, switches or a gauge that are "
        "higher or lower than the control believes.",
        usual_size="0.01 to 0.5 deg after homing",
        remedy="Enter the offset in the home position of every arm, or measure the height of the switches.",
        source=_VISCHER,
    ),
)  # fmt: skip

_DELTA = (
    _row(
        "zero_offset", "tower", "reading", "a", {"a": "{length}"}, entry="constant",
        meaning="The endstop of the tower is not as high as the firmware believes. The carriage is higher or lower "
        "than commanded, by the same amount everywhere; the plane of the nozzle tilts about the two others.",
        usual_size="0.05 to 1 mm before a calibration, 0.01 to 0.03 mm as a switch repeats",
        remedy="Enter the offset of the endstop in the firmware: position_endstop, or M666.",
        source=_VISCHER,
    ),
    _row(
        "scale", "tower", "reading", "k*q", {"k": "1"}, entry="scale",
        meaning="The belt or screw of the tower moves the carriage by more or less than commanded: its pitch, or the "
        "steps per length, are slightly wrong. The error grows with the height of the carriage.",
        usual_size="1e-4 to 1e-3 with a belt, 1e-5 to 1e-4 with a screw",
        remedy="Correct the steps per length of the tower in the firmware.",
        source=_ISO_2,
    ),
    _row(
        "backlash", "tower", "reading", "-b/2*s", {"b": "{length}"}, entry="backlash",
        of_drive=True,
        meaning="There is play in the belt, the carriage or the joints of the rods. The carriage stays behind by half "
        "of it, on the side where it comes from.",
        usual_size="0.01 to 0.1 mm",
        remedy="Tighten the belt, preload the joints of the rods by springs, always approach from one side.",
        source=_ISO_2,
    ),
    _row(
        "tower_lean", "tower", "base_joint",
        "q*(sin(a)*U + sin(b)*V + (sqrt(1 - sin(a)**2 - sin(b)**2) - 1)*N)", _in("deg", "a b"), entry="tower-lean",
        meaning="The tower is not upright: it leans outwards by a, and across by b. The joint of the rod moves aside "
        "as the carriage rises.",
        usual_size="0.05 to 0.3 deg",
        remedy="Square the frame: measure between the towers at top and bottom, and shim.",
        source=_CLAVEL,
    ),
    _row(
        "zero_offset", "arm", "reading", "a", {"a": "deg"}, entry="constant",
        meaning="The arm is not where the control believes it to be: its reference mark or its switch is elsewhere. "
        "The angle is wrong by the same amount everywhere.",
        usual_size="0.01 to 0.5 deg after homing",
        remedy="Enter the offset as the home position of the arm.",
        source=_VISCHER,
    ),
    _row(
        "scale", "arm", "reading", "k*q", {"k": "1"}, entry="scale",
        meaning="The gear or belt of the arm turns it by more or less than commanded: a ratio that is slightly wrong. "
        "The error grows with the angle of the arm.",
        usual_size="1e-4 to 1e-3 with a belt, 0 with a gear",
        remedy="Correct the ratio of the arm in the control.",
        source=_ISO_2,
    ),
    _row(
        "backlash", "arm", "reading", "-b/2*s", {"b": "arcsec"}, entry="backlash",
        of_drive=True,
        meaning="There is play in the gear or belt of the arm. It stays behind by half of it, on the side where it "
        "comes from.",
        usual_size="20 arcsec to 0.2 deg",
        remedy="Preload the gear or tighten the belt, always approach from one side.",
        source=_ISO_2,
    ),
    _row(
        "arm_length", "arm", "arm", "a", {"a": "{length}"}, entry="constant",
        meaning="The arm is longer or shorter than in the drawing, from its axis to the joints of the rods.",
        usual_size="0.01 to 0.2 mm",
        remedy="Measure the arm, or enter its fitted length in the control.",
        source=_VISCHER,
    ),
    _row(
        "delta_radius", "tower arm", "base_joint", "r*U", {"r": "{length}"}, entry="outwards",
        meaning="The joint of the rod is farther from the middle, or nearer to it, than in the drawing: the tower or "
        "the arm's axis stands off, or the platform's joint. If all three are, a plate looks like a dome or bowl.",
        usual_size="0.1 to 1 mm on a printer, 0.01 to 0.2 mm on a robot",
        remedy="Enter the radius in the firmware: delta_radius, or M665 R; or measure and shim the tower.",
        source=_VISCHER,
    ),
    _row(
        "delta_angle", "tower arm", "heading", "a", {"a": "deg"}, entry="constant",
        meaning="The tower or the arm does not stand where the drawing has it, but turned about the middle. Lines that "
        "should be square are not, and the plate looks twisted.",
        usual_size="0.05 to 0.5 deg on a printer, 0.01 to 0.05 deg on a robot",
        remedy="Enter the angle of the tower in the firmware: angle, or M665 X, Y, Z; or turn the tower's foot.",
        source=_VISCHER,
    ),
    _row(
        "rod_length", "tower arm", "rod", "a", {"a": "{length}"}, entry="constant",
        meaning="The rods of this tower or arm are longer or shorter than the others. The platform is pulled aside, by "
        "an error that changes with the direction of the rod.",
        usual_size="0.02 to 0.3 mm",
        remedy="Measure the rods against each other and make them equal, or enter the length of each in the firmware.",
        source=_VISCHER,
    ),
)  # fmt: skip

CATALOGUE: tuple[EffectDefinition, ...] = (*_REVOLUTE, *_PRISMATIC, *_MACHINE, *_TARGET, *_LEG, *_DELTA)
"""All effects, in the order in which ``rodgen effects`` lists them."""

NAMES = tuple(dict.fromkeys(definition.name for definition in CATALOGUE))
"""Their names, each once."""

OFFSETS = frozenset({"zero_offset", "leg_zero_offset", "common_zero_offset"})
SCALES = frozenset({"scale", "leg_scale", "instrument_scale"})
"""Names of effects of the reading that need no cause in the machine: where it counts from, and in what unit."""
GEOMETRY = frozenset(d.name for d in CATALOGUE if d.rung <= 1) - {"squareness", "tower_lean"}
"""Names of effects that say that a dimension is not that of the file; guides and towers are set square one by one."""
WINDUPS = frozenset({"gravity_windup", "load_windup"})
"""Names of those by which a drive yields."""

TERMS = {name: definition for definition in CATALOGUE for name in definition.tpoint}
"""TPOINT's terms that are effects of the catalogue."""


class UnknownEffectError(UnexpectedError):
    """An effect that the catalogue does not have there: what was found, and what was expected."""


def definitions(name: str, at: str | None = None) -> tuple[EffectDefinition, ...]:
    """Look up an effect by its name.

    Parameters
    ----------
    at : str, optional
        ``"revolute"``, ``"prismatic"``, ``"leg"``, ``"tower"``, ``"arm"``, ``"machine"`` or ``"target"``; left out: all
        of this name, which may differ between types of joints.

    Returns
    -------
    tuple of EffectDefinition
        One at least; exactly one when `at` is given.

    Raises
    ------
    UnknownEffectError
        When there is none, with the nearest name.

    Examples
    --------
    >>> [sorted(d.at) for d in definitions("backlash")]
    [['revolute'], ['prismatic'], ['tower'], ['arm']]
    >>> definitions("backlsh")
    Traceback (most recent call last):
    rodgen.machines.effects.catalogue.UnknownEffectError: no effect 'backlsh'; expected 'backlash', perhaps; \
'rodgen effects' lists all
    """
    named = tuple(definition for definition in CATALOGUE if definition.name == name)
    if not named:
        near = nearest_name(name, [*NAMES, *TERMS])
        hint = f"{near!r}, perhaps; " if near else "a name of the catalogue; "
        raise UnknownEffectError(f"no effect {shown(name)}", f"{hint}'rodgen effects' lists all")
    those = tuple(definition for definition in named if at is None or at in definition.at)
    if not those:
        places = " or ".join(sorted(place for definition in named for place in definition.at))
        raise UnknownEffectError(f"{name} at a place of type {shown(at)}", f"{places}, where it can be")
    return those


def as_table(rows: Iterable[EffectDefinition] = CATALOGUE) -> list[tuple[str, str, str, str, str]]:
    """Return a short list of effects: where, name, what it does, parameters with units, ISO 230 symbols.

    Examples
    --------
    >>> as_table(definitions("zero_offset", "revolute"))
    [('revolute', 'zero_offset', 'reading += a', 'a [arcsec]', 'EC0C')]
    """
    return [(", ".join(sorted(row.at)), row.name, row.equation, row.listed(), row.iso) for row in rows]
