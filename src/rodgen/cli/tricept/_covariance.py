"""Options for the uncertainty of a Tricept's parameters: by name, or as a matrix in a file."""

from __future__ import annotations

import argparse
import contextlib
import re
from typing import Any

import numpy as np

from rodgen.cli._console import located, refused
from rodgen.cli._values import InputFile
from rodgen.errors import InputFileError, in_file, shown
from rodgen.files import decoded, read_input

COVARIANCE_TEXT = """\
--u NAME=VALUE, which may be repeated, gives a standard uncertainty with its unit, of one parameter or of each of a
group:
  rods (A0 A1 A-1), radii (r R), zeros (zero_A0 ...), fixed_joints (A_x A_y ... C_z), moving_joints (Ap_x ... Cp_z), q,
  guide_lengths (P_x P_y P_z axes_gap rod_x rod_y rod_z), guide_angles (axis_x axis_z axes_square rod_tilt mount_x
  mount_y mount_z)
--correlation NAME,NAME=NUMBER correlates two, or all of a group: --correlation rods,rods=0.5. The same in a file, with
--covariance FILE.toml:
  [u]
  rods = "2.9 um"
  guide_angles = "5 arcsec"
  [correlation]
  "A0, A1" = 0.5
or a covariance matrix, FILE.csv: a header of parameters with units, A0 [mm],A1 [mm],..., then a row for each. Where no
uncertainty is given it is the paper's (23): 0.005 mm/√3 for the rods, 0.01 mm/√3 for r and R; correlations apply to it.
"""

_PAPER = {"rods": (0.005 / 3**0.5, "mm"), "radii": (0.01 / 3**0.5, "mm")}

SizeAndUnit = tuple[float, str]


def add_covariance(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--u", metavar="NAME=VALUE", action="append", type=_named, default=[], help="such as rods=2.9um"
    )
    parser.add_argument(
        "--correlation",
        metavar="NAME,NAME=NUMBER",
        action="append",
        type=_correlated,
        default=[],
        help="such as A0,A1=0.5",
    )
    parser.add_argument(
        "--covariance", metavar="FILE", type=InputFile, help=".toml with uncertainties, or .csv with a matrix"
    )


def _named(text: str) -> tuple[str, SizeAndUnit]:
    name, sign, value = text.partition("=")
    found = _size_and_unit(value) if sign else None
    if found is None:
        raise argparse.ArgumentTypeError(
            f"{shown(text)} is not a name and an uncertainty with its unit, such as rods=2.9um"
        )
    return name.strip(), found


def _size_and_unit(text: str) -> SizeAndUnit | None:
    """Return an uncertainty from 0 up and its unit, such as ``2.9 um``; None for another text."""
    from rodgen.data.units import number_and_unit

    found = number_and_unit(text)
    return found if found and found[0] >= 0 and found[1] else None


def _correlated(text: str) -> tuple[tuple[str, str], float]:
    names, sign, value = text.partition("=")
    pair = [name.strip() for name in names.split(",")]
    if sign and len(pair) == 2:
        with contextlib.suppress(ValueError):
            return (pair[0], pair[1]), float(value)
    raise argparse.ArgumentTypeError(f"{shown(text)} is not a pair and a number, such as A0,A1=0.5")


def source_of(options: argparse.Namespace) -> str:
    """Return where the covariance of the parameters is from, as a remark says it."""
    if options.covariance is not None:
        return f"U_x is that of {options.covariance}."
    if options.u:
        return (
            "U_x is by --u: " + ", ".join(f"u({name}) = {u:g} {unit}" for name, (u, unit) in options.u) + "."
        )
    return (
        "U_x is the paper's (23), as neither --u nor --covariance was given: u = 0.005 mm/√3 of the rods, "
        "0.01 mm/√3 of r and R."
    )


def covariance_of(options: argparse.Namespace, unit: str) -> Any:
    """Return the covariance of all parameters, lengths in `unit` and angles in rad.

    Raises
    ------
    InputFileError
        When what was given is not a covariance.
    """
    if options.covariance is None:
        places = ("--u", "--correlation")
        return _made(dict(options.u), dict(options.correlation), unit, "command line", places)
    if options.u or options.correlation:
        raise refused("--covariance", "together with --u or --correlation", "one of the two")
    file = options.covariance
    text = decoded(read_input(file, "a covariance"), file).removeprefix("\ufeff")
    if file.lower().endswith(".toml"):
        return _from_toml(file, text, unit)
    return _from_csv(file, text, unit)


def _made(
    given: dict[str, SizeAndUnit],
    correlations: dict[tuple[str, str], float],
    unit: str,
    file: str,
    places: tuple[str, str],
) -> Any:
    from rodgen.kinematics import tricept

    place, other = places
    values = {}
    for name, (value, written) in (given or _PAPER).items():
        members = tricept.GROUPS.get(name, (name,))
        if not set(members) <= set(tricept.PARAMETERS):
            groups = ", ".join(tricept.GROUPS)
            raise InputFileError(file, place, shown(name), f"a parameter, or one of {groups}")
        values[name] = value * _factor(written, members[0], unit, file, place)
    with located(file, place, "a covariance"):
        tricept.covariance(values)
    with located(file, other, "a covariance"):
        return tricept.covariance(values, correlations)


def _factor(written: str, name: str, unit: str, file: str, place: str) -> float:
    from rodgen.data.units import conversion_factor
    from rodgen.kinematics.tricept import ANGLES

    with in_file(file, f"{place}, {name}"):
        if name in ANGLES:
            return conversion_factor(written, "angle", "rad")
        return conversion_factor(written, "length", unit)


def _from_toml(file: str, text: str, unit: str) -> Any:
    from rodgen.machines.files.toml import parse

    data = parse(text, file)
    for key in data:
        if key not in ("u", "correlation") or not isinstance(data[key], dict):
            raise InputFileError(file, shown(key), "unknown here", "[u] and [correlation]")
    given: dict[str, SizeAndUnit] = {}
    for name, value in data.get("u", {}).items():
        found = _size_and_unit(value) if isinstance(value, str) else None
        if found is None:
            raise InputFileError(
                file, f"[u], {name}", shown(value), "an uncertainty with its unit, such as '2.9 um'"
            )
        given[name] = found
    correlations: dict[tuple[str, str], float] = {}
    for key, value in data.get("correlation", {}).items():
        pair = [name.strip() for name in key.split(",")]
        if len(pair) != 2 or isinstance(value, bool) or not isinstance(value, int | float):
            raise InputFileError(
                file, f"[correlation], {shown(key)}", shown(value), 'two names and a number, "A0, A1" = 0.5'
            )
        correlations[pair[0], pair[1]] = float(min(max(value, -2), 2))  # no integer beyond floating point
    return _made(given, correlations, unit, file, ("[u]", "[correlation]"))


def _from_csv(file: str, text: str, unit: str) -> Any:
    from rodgen.kinematics import tricept

    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise InputFileError(file, "file", "nothing", "a header of parameters, and a row for each")
    names, factors = [], []
    for cell in lines[0].split(","):
        found = re.fullmatch(r"\s*(\S+?)\s*\[(.+)\]\s*", cell)
        if not found or found[1] not in tricept.PARAMETERS or found[1] in names:
            raise InputFileError(
                file, "line 1", shown(cell), "parameters with their units, each once, such as A0 [mm]"
            )
        names.append(found[1])
        factors.append(_factor(found[2], found[1], unit, file, "line 1"))
    if len(lines) != len(names) + 1:
        raise InputFileError(file, "file", f"{len(lines) - 1} rows", f"{len(names)}, one for each parameter")
    matrix = np.empty((len(names), len(names)))
    for n, line in enumerate(lines[1:]):
        cells = line.split(",")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) != len(names):
            raise InputFileError(file, f"line {n + 2}", shown(line), f"{len(names)} numbers")
        matrix[n] = row
    scale = np.array(factors)
    places = [tricept.PARAMETERS.index(name) for name in names]
    whole = np.zeros((len(tricept.PARAMETERS),) * 2)
    with located(file, "file", "a covariance"):
        whole[np.ix_(places, places)] = tricept.check_covariance(matrix * scale[:, None] * scale, len(names))
    return whole
