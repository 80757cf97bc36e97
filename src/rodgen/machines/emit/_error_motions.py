"""The errors of each axis over its travel, with the names of ISO 230-1 and ISO 230-7, and tables that take them out.

An error motion is what the effects at a joint do to what it carries: three displacements and three turns, in machine
axes, each the error's own: real less commanded. What a joint carries to r moves by E + turns × (r - p), where p is the
joint's point, which stays where it is when a slide moves. The zero of a joint is a location error and no error motion,
so that who corrects both corrects it once. Effects that need more than the position of the joint (loads, temperatures,
times, other joints) are named as left out.

Tables for controls state errors of position as their manuals define them:

SINUMERIK
    $AA_ENC_COMP is added to the actual value: a positive value moves the axis in the negative direction. It is zero at
    the reference point. MD32450 BACKLASH is positive where the encoder leads the machine part, the lost motion of a
    screw; each reversal then moves the axis further in the new direction. (Function manual, K3: Compensations.)
LinuxCNC
    COMP_FILE with COMP_FILE_TYPE = 0: the nominal position, the actual one of a joint that moves in the positive
    direction, and that in the negative direction; at most 256 lines. The motor gets nominal less actual on top, and
    BACKLASH is not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError, joined
from rodgen.machines.effects.formula import ARRAY_FUNCTIONS, Formula
from rodgen.machines.emit._content import title_of
from rodgen.machines.emit._geometry import CONSTANT, located
from rodgen.machines.emit._numbers import (
    Covariance,
    K,
    csv_text,
    number,
    numbers,
    said_of_uncertainties,
    standard,
    uncertain_number,
    varied,
)
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.rigid import complete_basis
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.model import Model
    from rodgen.machines.parts import Effect, Joint


POINTS = range(25, 42)
"""Positions of a table over a travel, where no more are needed: as many of these as make the step a round number."""
MOST_POINTS, MOST_OF_LINUXCNC = 801, 256
INTERPOLATED = 0.02
"""Part of the errors' range that linear interpolation between the points may be off."""
_ALONG = 0.02
"""Largest sine of an axis to a machine axis from which its errors are counted: ISO 230 knows axes along x, y and z."""
_MOTIONS = {"reading", "translation", "rotation", *(f"{kind}{x}" for kind in "tr" for x in "xyz")}
"""Components of effects that move what a joint carries."""


@dataclass(frozen=True)
class _Axis:
    """A joint with the effects at it that follow its position alone."""

    joint: Joint
    effects: tuple[tuple[Effect, dict[str, float]], ...]
    zero: float
    travel: tuple[float, float]
    left_out: tuple[str, ...]
    unit: str
    size: float
    file: str

    def errors(self, q: Array, s: float) -> Array:
        """Return displacements and turns, (n, 6), internal units, at positions and for a direction of approach."""
        axis = np.array(self.joint.axis, float)
        u, v = complete_basis(axis)
        low, high = self.travel
        zeta = (q - low) / (high - low)
        legendre = np.polynomial.legendre.legvander(2 * zeta - 1, 4).T
        catalogue: dict[str, Any] = {f"P{k}": legendre[k][:, None] for k in range(1, 5)}
        catalogue |= {"U": u, "V": v, "N": axis} | dict(zip(("EX", "EY", "EZ"), np.eye(3), strict=True))
        shift, turn = slice(0, 3), slice(3, 6)
        of: dict[str, tuple[Any, Any]] = {"translation": (shift, 1.0), "rotation": (turn, 1.0)}
        of["reading"] = (turn if self.joint.revolute else shift, axis)
        of |= {f"{kind}{x}": ([3 * n + k], 1.0) for n, kind in enumerate("tr") for k, x in enumerate("xyz")}
        errors = np.zeros((len(q), 6))
        for effect, values in self.effects:
            # a joint may be called P1
            words = {self.joint.name: q[:, None]} if effect.definition.own else catalogue
            names = words | {"q": q[:, None], "s": s, "pi": math.pi} | values
            for component, formula in _changes(effect):
                part, along = of[component]
                with np.errstate(all="ignore"):
                    errors[:, part] += np.asarray(formula.evaluate(names, ARRAY_FUNCTIONS, float)) * along
            if not np.isfinite(errors).all():
                worst = q[~np.isfinite(errors).all(axis=1)][0] / self.size
                place = f"{effect.title}, formula"
                at_position = f"no finite value where {self.joint.name} is at {worst:.6g} {self.unit}"
                raise InputFileError(self.file, place, at_position, "one over the whole travel")
        return errors

    def positions(self, most: int = MOST_POINTS) -> tuple[Array, float]:
        """Return the positions of a table, and the largest error of linear interpolation, part of the errors' range."""
        span = (self.travel[1] - self.travel[0]) / self.size
        count = min(POINTS, key=lambda points: len(f"{span / (points - 1):.9g}"))
        while True:
            q = np.linspace(*self.travel, count)
            middle = (q[1:] + q[:-1]) / 2
            part = 0.0
            for s in (1.0, -1.0):
                at, between = self.errors(q, s), self.errors(middle, s)
                spread = np.ptp(at, axis=0)
                off = np.abs((at[1:] + at[:-1]) / 2 - between).max(axis=0)
                part = max(part, float(np.max(np.divide(off, spread, out=np.zeros(6), where=spread > 0))))
            if part <= INTERPOLATED or 2 * count - 1 > most:
                return q, part
            count = 2 * count - 1


def _changes(effect: Effect) -> tuple[tuple[str, Formula], ...]:
    """Return each component that an effect changes, with the formula."""
    return ((effect.definition.component, effect.definition.formula), *effect.definition.others)


def _axes(machine: Machine, travel: Any) -> Iterator[_Axis]:
    if machine.kinematics.is_closed:
        raise InputFileError(machine.file or machine.name, "family", "a machine on legs", "a chain of joints")
    model: Model = scope_of(machine, travel).model
    machine, theta = model.machine, model.start()
    file = machine.file or machine.name
    values = {p.key: float(x) for p, x in zip(model.parameters, theta, strict=True)}
    for j, (joint, zero) in enumerate(zip(machine.joints, located(machine)[2], strict=True)):
        catalogue = {"U", "V", "N", "EX", "EY", "EZ", *(f"P{k}" for k in range(1, 5))}
        taken, left_out = [], []
        for effect in row_effects(machine):
            if effect.place != joint.name or (effect.name in CONSTANT and not effect.definition.own):
                continue
            sizes = {x: effect.hold.get(x, values.get(effect.key(x), 0.0)) for x in effect.units(machine)}
            known = {"q", "s", "pi"} | ({joint.name} if effect.definition.own else catalogue)
            components = {component for component, _ in _changes(effect)}
            names = {name for formula in effect.definition.formulas for name in formula.names}
            if joint.coordinate and joint.is_read and "reading" in components:
                left_out.append(
                    f"{effect.title}: it follows {joint.reading}, not the position of {joint.name}"
                )
            elif names <= known | sizes.keys() and components <= _MOTIONS:
                taken.append((effect, sizes))
            else:
                left_out.append(f"{effect.title}: it depends on more than the position of {joint.name}")
        low, high = joint.travel or model.reach[j]
        if not high > low:
            if not joint.revolute:
                place = f"joint {joint.name}, travel"
                raise InputFileError(file, place, "missing", "travel = [lowest, highest]")
            low, high = 0.0, 2 * math.pi
        unit = "deg" if joint.revolute else machine.length_unit
        size = parse_unit(unit).factor(machine.length_unit)
        yield _Axis(joint, tuple(taken), zero, (float(low), float(high)), tuple(left_out), unit, size, file)


def iso_texts(
    machine: Machine, name: str, note: str, travel: Any, covariance: Covariance | None
) -> dict[str, str]:
    """Return a table of the error motions of each axis, one of location errors, and a page that says what they are."""
    machines = varied(machine, covariance)
    sizes = {"um": parse_unit("um").factor(machine.length_unit), "arcsec": parse_unit("arcsec").factor()}
    files, page = {}, [f"# {title_of(machine)}: errors of its axes", "", note, ""]
    page += [
        "Errors are real less commanded, in machine axes: X, Y, Z displacements, A, B, C turns about x, y, z. The file",
        "of an axis has its error motions over the travel (ISO 230-1, of a rotary axis ISO 230-7), both ways: what it",
        "carries to r moves by (EX, EY, EZ) + (EA, EB, EC) × (r - p), where p, its point, does not move with a slide.",
        f"`{name}_location.csv` has the location errors: X0C the error in x of the place of C, A0C its tilt about x.",
        "The zero of an axis, X0X or C0C, stands there alone and is in no error motion. What a displaced or tilted",
        "axis carries is in its nominal place where the axis is at zero.",
        *said_of_uncertainties(machines),
        "",
    ]
    for axes in zip(*(_axes(each, travel) for each in machines), strict=True):
        axis = axes[0]
        label = axis.joint.name
        if not axis.effects:
            page += [f"- {label}: no error motions.", *(f"  Not in it: {what}." for what in axis.left_out)]
            continue
        q, part = axis.positions()
        columns = {f"{label} [{axis.unit}]": q / axis.size}
        uncertain = {}
        for sign, approach in ((1.0, "+"), (-1.0, "-")):
            errors = [each.errors(q, sign) for each in axes]
            expanded = K * standard(errors)
            for k, error in enumerate("XYZABC"):
                of = "um" if k < 3 else "arcsec"
                header = f"E{error}{label}{approach} [{of}]"
                columns[header], uncertain[header] = errors[0][:, k] / sizes[of], expanded[:, k] / sizes[of]
        files[f"{name}_{label}.csv"] = csv_text(columns, uncertain)
        p = ", ".join(number(x, machine.length_unit) for x in axis.joint.point)
        page.append(f"- `{name}_{label}.csv`: {len(q)} positions; between them linear interpolation is off by at most "
                    f"{part:.2%} of an error's range. p = ({p}) {machine.length_unit}.")  # fmt: skip
        page += [f"  Not in it: {what}." for what in axis.left_out]
    rows = [list(_locations(each, travel)) for each in machines]
    expanded = K * standard([np.array([value for _, value, _ in each]) for each in rows])
    fitted = len(machines) > 1
    lines = ["symbol,value,unit" + f",U (k = {K:g}),note" * fitted]
    for (symbol, value, unit), u in zip(rows[0], expanded.tolist(), strict=True):
        value_text, of_it = uncertain_number(value / sizes[unit], u / sizes[unit], unit)
        how = "" if of_it else "not estimated"
        lines.append(f"{symbol},{value_text},{unit}" + f",{of_it},{how}" * fitted)
    files[f"{name}_location.csv"] = "\n".join(lines) + "\n"
    return files | {f"{name}_errors.md": "\n".join(page) + "\n"}


def _locations(machine: Machine, travel: Any) -> Iterator[tuple[str, float, str]]:
    """Yield the location errors, internal units: of a slide its squareness, of a rotary axis its tilt and its place.

    Each with the unit that it is shown in; and zeros.
    """
    corrected = scope_of(machine, travel).machine
    for joint, axis, point, zero in zip(corrected.joints, *located(corrected), strict=True):
        nominal = _along_machine_axis(np.array(joint.axis, float))
        turn = np.cross(nominal, axis)
        shift = point - np.array(joint.point, float)
        shift = shift - nominal * float(shift @ nominal)
        for k, error in enumerate("ABC"):
            if abs(nominal[k]) < 0.5:
                yield f"{error}0{joint.name}", float(turn[k]), "arcsec"
        if joint.revolute:
            for k, error in enumerate("XYZ"):
                if abs(nominal[k]) < 0.5:
                    yield f"{error}0{joint.name}", float(shift[k]), "um"
        k = int(np.argmax(np.abs(nominal)))
        error, unit = ("ABC", "arcsec") if joint.revolute else ("XYZ", "um")
        yield f"{error[k]}0{joint.name}", float(np.sign(nominal[k])) * zero, unit


def _along_machine_axis(axis: Array) -> Array:
    """Return the machine axis that an axis is along, but for errors; itself where it is along none."""
    k = int(np.argmax(np.abs(axis)))
    nearest = np.sign(axis[k]) * np.eye(3)[k]
    return nearest if float(np.linalg.norm(axis - nearest)) < _ALONG else axis


def screw_texts(
    machine: Machine, name: str, note: str, travel: Any, covariance: Covariance | None
) -> dict[str, str]:
    """Return tables that take the errors of position out of each axis, in the forms of SINUMERIK and LinuxCNC."""
    files, without, zeros, machines = {}, [], {}, varied(machine, covariance)
    for axes in zip(*(_axes(each, travel) for each in machines), strict=True):
        axis = axes[0]
        label, turns = axis.joint.name, axis.joint.revolute
        unit = "deg" if turns else "mm"
        scale = parse_unit(unit).factor(machine.length_unit)
        along = np.array([0.0, 0, 0, *axis.joint.axis] if turns else [*axis.joint.axis, 0, 0, 0])
        if axis.zero:
            zeros[label] = f"{number(axis.zero / scale, unit)} {unit}"
        q, part = axis.positions()
        both = [[each.errors(q, s) @ along / scale for s in (1.0, -1.0)] for each in axes]
        forward, reverse = both[0]
        if not np.any(forward) and not np.any(reverse):
            without.append(label)
            continue
        gaps = [np.mean(r - f) for f, r in both]
        gap = uncertain_number(float(gaps[0]), K * float(standard(gaps)), unit)[0]
        largest = K * float(standard([np.array(each) for each in both]).max())
        u = uncertain_number(largest, largest, unit)[1]
        head = f"{title_of(machine)}, axis {label}. {note}"
        head_lines = [
            *([f"Expanded uncertainty of an error, k = {K:g}: at most {u} {unit}."] if u else []),
            *([f"Not in it: the zero of {label}, {zeros[label]}."] if label in zeros else []),
            *(f"Not in it: {what}." for what in axis.left_out),
        ]
        gap_said = f"{gap} {unit}" if np.any(forward != reverse) else ""
        at = numbers(q / scale, unit)
        of_table = {
            "STEP": number(float(q[1] - q[0]) / scale, unit),
            "MIN": at[0],
            "MAX": at[-1],
            "IS_MODULO": str(int(turns and math.isclose(np.ptp(q), 2 * math.pi))),
        }
        mean = numbers((forward + reverse) / 2, unit)
        files[f"{name}_{label}_eec.ini"] = _sinumerik(
            label, mean, [head, _said_of_points(q, part, unit), *head_lines], gap_said, of_table
        )
        q, part = axis.positions(MOST_OF_LINUXCNC)
        actual = [numbers((q + axis.errors(q, s) @ along) / scale, unit) for s in (1.0, -1.0)]
        rows = zip(numbers(q / scale, unit), *actual, strict=True)
        # LinuxCNC reads up to the first line that is not three numbers
        files[f"{name}_{label}.comp"] = "".join(
            f"{' '.join(row)}\n"
            for row in (*rows, *(["#", x] for x in (head, _said_of_points(q, part, unit), *head_lines)))
        )
    if not files:
        found, expected = "no error of position", "an effect such as scale or backlash at a joint"
        raise InputFileError(machine.file or machine.name, "[[effect]]", found, expected)
    page = [
        note,
        "",
        "*.comp: LinuxCNC, [JOINT_n] COMP_FILE with COMP_FILE_TYPE = 0: nominal, real when approached from below,",
        f"real when approached from above, in mm or degrees, at most {MOST_OF_LINUXCNC} lines. It replaces BACKLASH.",
        "*_eec.ini: SINUMERIK, $AA_ENC_COMP, the mean of both approaches, and MD32450 BACKLASH for their difference.",
        "The zero of an axis is in no table: it belongs to the reference point.",
        *(
            [f"Zeros, by which an axis is too far: {joined([f'{x}, {zero}' for x, zero in zeros.items()])}."]
            if zeros
            else []
        ),
        *(
            [f"Without an error of position in the model, and so without a table: {joined(without)}."]
            if without
            else []
        ),
    ]
    return files | {f"{name}_tables.md": "\n".join(page) + "\n"}


def _said_of_points(q: Array, part: float, unit: str) -> str:
    return f"{len(q)} points, {unit}; between them linear interpolation is off by at most {part:.2%} of the range."


def _sinumerik(
    label: str, errors: Sequence[str], head_lines: Sequence[str], gap: str, of_table: Mapping[str, str]
) -> str:
    lines = [f"; {line}" for line in head_lines]
    lines += [
        f"; Needs MD38000 MM_ENC_COMP_MAX_POINTS[0] >= {len(errors)}; acts with MD32700 ENC_COMP_ENABLE[0] = 1.",
        "; A positive value is an error by which the axis is too far: the control moves it back by as much.",
    ]
    if gap:
        lines.append(f"; MD32450 BACKLASH[0] = {gap}: positive where the axis lags behind its encoder.")
    lines += ["CHANDATA(1)"]
    lines += [f"$AA_ENC_COMP[0,{n},{label}]={error}" for n, error in enumerate(errors)]
    lines += [f"$AA_ENC_COMP_{name}[0,{label}]={value}" for name, value in of_table.items()]
    return "\n".join([*lines, "M17"]) + "\n"
