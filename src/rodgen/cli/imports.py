"""``rodgen import``: a machine file, and measurements, from the files that people have."""

from __future__ import annotations

import argparse
import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rodgen.cli._console import (
    FAILED,
    OK,
    Command,
    Parser,
    UsageError,
    argument,
    choice,
    option,
    refused,
    repeated,
    show,
)
from rodgen.cli._machine import figures_for, plot
from rodgen.cli._values import InputFile, OutputFile, Quantity, quantity
from rodgen.errors import InputFileError, shown
from rodgen.files import read_start, write_file

if TYPE_CHECKING:
    from rodgen.machines.imports.imported import Imported

_IMPORT = """\
Make a machine file of a file in another form, and measurements where it has readings; say what was taken for what, and
check the two files.

  rodgen import machine.toml readings.xlsx -d data.csv --column A="-A_axis [deg]" --units mm,deg

SOURCE is
  a robot in URDF: the chain of joints from the link --base to the link --tip. Lengths become mm, limits travels;
  fixed joints are part of what they join.
  a pointing run of TPOINT: alt-azimuth or equatorial, formats 1 to 4; or the log of the MMT's mount.
  a Denavit-Hartenberg table, CSV with the columns theta, d, a and alpha; or TOML.
  a model of TPOINT, alone or with a run: its terms become effects with held parameters.
  the printer.cfg of a delta printer (Klipper), with the heights that DELTA_CALIBRATE saved, or with a probe log: of
  Klipper (PROBE), Marlin (G30) or RepRapFirmware (heightmap.csv). A log goes with a machine file, too.
  a machine file, or one of these, with tables of readings: CSV or other text, .xlsx or .mat; one file, or one a target
  or a run. Columns are known by their names, by --column, or by [columns] of the machine file: joints; x y z, or
  x1 y1 z1 x2 … of several targets; roll pitch yaw, rx ry rz or qw qx qy qz; az el or ha dec; target, run, t, T_air, …
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command("import", _run, _IMPORT, *OPTIONS)


def imported_with(sources: Sequence[str], arguments: Sequence[str]) -> Imported:
    """Return what the command makes of files.

    Parameters
    ----------
    sources : sequence of str
        Names of the files.
    arguments : sequence of str
        Options of the command.

    Raises
    ------
    RodgenError
        When an option is wrong, or the files are none that can be imported.
    """
    parser = Parser(prog="rodgen import")
    for each in OPTIONS:
        each.add_to(parser)
    try:
        options = parser.parse_args([*arguments, "--", *sources])
    except UsageError as error:
        raise error.args[0] from None
    return _imported(options)[0]


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of

    figures = figures_for(options.plot)
    made, given = _imported(options)
    for name, wanted, there in (("-o", options.output, not given), ("-d", options.data, bool(made.columns))):
        if bool(wanted) != there:
            raise refused("rodgen import", *_MISFITS[name, there])
    machine = made.machine
    said = list(made.notes)
    if options.output:
        machine = machine_of(made.text, options.output)
        write_file(options.output, made.text.encode())
        said += ["", f"{options.output}:", machine.describe()]
    wrong, observations = False, None
    if made.columns:
        from rodgen.calibration.check import check

        data = made.measurements()
        checked = check(machine, data)
        wrong, observations = bool(checked.wrong), checked.observations
        said += ["", f"{options.data}: {data.rows} rows", checked.summary()]
        made.write_data(options.data)
    if figures is not None:
        figures.save_figure(figures.skeleton(machine, observations), options.plot)
    show("\n".join(said))
    return FAILED if wrong else OK


_MISFITS = {
    ("-o", False): ("-o, though a SOURCE is a machine file", "no -o: that file stays as it is"),
    ("-o", True): ("no -o", "-o MACHINE.toml: the machine file that is made"),
    ("-d", False): ("-d, but no SOURCE has readings", "no -d, or a table of readings, too"),
    ("-d", True): ("no -d", "-d DATA.csv: the readings go there"),
}
"""By option, and whether it is needed: what was found, and what was expected."""
_UNKNOWN = (
    "readings without a machine, as it is no URDF (<robot>), no Denavit-Hartenberg table (theta, d, a, alpha), no "
    "pointing run (:ALTAZ or :EQUAT) and no model (terms, then END) of TPOINT"
)

_URDF, _TABLE, _RUN, _MODEL = "a URDF", "a Denavit-Hartenberg table", "a pointing run", "a model of TPOINT"
_MACHINE, _READINGS = "a machine file", "a table of readings"
_PRINTER, _LOG = "a printer.cfg", "a probe log"


def _imported(options: argparse.Namespace) -> tuple[Imported, bool]:
    """Return what the sources are, and whether one of them is a machine file already."""
    from rodgen.machines.imports.denavit_hartenberg import machine_from_table
    from rodgen.machines.imports.imported import Imported
    from rodgen.machines.imports.printers import machine_from_klipper, with_probe_log
    from rodgen.machines.imports.tpoint_model import machine_from_tpoint
    from rodgen.machines.imports.urdf import machine_from_urdf
    from rodgen.machines.machine import Machine

    kinds: dict[str, list[str]] = {}
    for source in options.sources:
        kinds.setdefault(_kind(source), []).append(source)
    for kind, files in kinds.items():
        if len(files) > 1 and kind != _READINGS:
            raise InputFileError(files[1], "file", f"{kind}, as is {files[0]}", "one of each kind")
    alone = [kind for kind in (_URDF, _TABLE, _MACHINE, _PRINTER) if kind in kinds]
    others = kinds.keys() - {_READINGS, _LOG} - set(alone[:1])
    if alone and others:
        file = kinds[alone[0]][0]
        raise InputFileError(file, "file", f"{alone[0]} together with {min(others)}", "one of the two")
    if alone == [_URDF]:
        made = machine_from_urdf(kinds[_URDF][0], options.base, options.tip)
    elif alone == [_TABLE]:
        made = machine_from_table(kinds[_TABLE][0], options.convention)
    elif alone == [_MACHINE]:
        made = Imported(Machine.load(kinds[_MACHINE][0]), ())
    elif alone == [_PRINTER]:
        made = machine_from_klipper(kinds[_PRINTER][0])
    elif _RUN in kinds or _MODEL in kinds:
        run, model = (kinds.get(kind, [None])[0] for kind in (_RUN, _MODEL))
        latitude = options.latitude.to("rad")[0] if options.latitude else None
        made = machine_from_tpoint(
            run, model, latitude=latitude, from_south=options.azimuth == "south", form=options.format
        )
    else:
        file = kinds.get(_READINGS, kinds.get(_LOG, [""]))[0]
        raise InputFileError(file, "file", _UNKNOWN, "a machine file, too: 'rodgen new' makes one")
    if _LOG in kinds:
        made = with_probe_log(made, kinds[_LOG][0], *kinds.get(_PRINTER, ()))
    if options.estimate == "geometry":
        if alone not in ([_URDF], [_TABLE]):
            found = "--estimate geometry, and neither a URDF nor a Denavit-Hartenberg table"
            raise refused("--estimate", found, "[estimate] in the machine file")
        parts = {"revolute": ("axis", "point"), "prismatic": ("axis",)}
        # the frame is free: axis and point of the first joint are the base
        first, *carried = made.machine.joints
        estimate = tuple(f"{joint.name}.{part}" for joint in carried for part in parts[joint.type])
        estimate += made.machine.estimate
        note = f"Axes and points of all joints but the first, {first.name}, are estimated: a rough geometry will do."
        made = replace(made, machine=replace(made.machine, estimate=estimate), notes=(*made.notes, note))
    elif alone in ([_URDF], [_TABLE]):
        note = "Axes and points of joints are taken as they are; --estimate geometry calibrates them, too."
        made = replace(made, notes=(*made.notes, note))
    return (_with_readings(options, made, kinds) if _READINGS in kinds else made), _MACHINE in kinds


def _kind(source: str) -> str:
    """Return what a file is, by its name and what it begins with."""
    from rodgen.machines.imports.denavit_hartenberg import is_table
    from rodgen.machines.imports.printers import is_printer, is_probe_log
    from rodgen.machines.imports.tpoint_data import is_pointing_run
    from rodgen.machines.imports.tpoint_model import is_model
    from rodgen.machines.imports.urdf import is_urdf

    start = read_start(source, "a file to import")
    tests = {
        _TABLE: is_table(source, start),
        _MACHINE: source.lower().endswith(".toml"),
        _URDF: is_urdf(source, start),
        _RUN: is_pointing_run(start),
        _MODEL: is_model(start),
        _PRINTER: is_printer(start),
        _LOG: is_probe_log(start),
    }
    return next((name for name, fits in tests.items() if fits), _READINGS)


def _with_readings(options: argparse.Namespace, made: Imported, kinds: Mapping[str, list[str]]) -> Imported:
    """Return what was imported with the readings of tables."""
    from rodgen.errors import UnexpectedError
    from rodgen.machines.files.read import column_source
    from rodgen.machines.imports.tables import measurements_of, numbered, with_targets
    from rodgen.machines.measured import NOTATIONS
    from rodgen.machines.parts import ColumnSource

    if made.columns:
        raise InputFileError(kinds[_READINGS][0], "file", "a table, and a pointing run", "one of the two")
    stated = dict(made.machine.column_sources)
    if options.joints:
        joints = [joint.column for joint in made.machine.joints if joint.is_read]
        try:
            theirs = numbered(options.joints, len(joints))
        except UnexpectedError as error:
            raise refused("--joints", error.found, error.expected) from None
        stated |= {joint: ColumnSource(column) for joint, column in zip(joints, theirs, strict=True)}
    for text in options.column:
        name, mark, rest = text.partition("=")
        try:
            if not mark or not name.strip():
                raise UnexpectedError(shown(text), "NAME=THEIRS, such as A='-A_axis [deg] + 90'")
            stated[name.strip()] = column_source(rest)
        except UnexpectedError as error:
            raise refused("--column", error.found, error.expected) from None
    units = options.units or (("m", "rad") if _URDF in kinds else None)
    ballbar = None
    if options.ballbar:
        plane, size = options.ballbar
        ballbar = plane, size.to(made.machine.length_unit)[0]
    fresh = _MACHINE not in kinds
    machine = made.machine
    files = kinds[_READINGS]
    if (_URDF in kinds or _TABLE in kinds) and not {"x", "y", "z"} & stated.keys():
        machine = with_targets(machine, files[0])
    columns, notes, places = measurements_of(machine, files, stated, units, ballbar, attitudes=fresh)
    names = {name.partition(" [")[0] for name in columns}
    if fresh and any(names >= set(notation) for notation in NOTATIONS.values()):
        machine = replace(machine, measured=replace(machine.measured, kind="pose"))
    if units and not options.units:
        notes.append("Columns without a unit are in m and rad, as the URDF is; --units says otherwise.")
    return replace(
        made,
        machine=machine,
        columns=columns,
        notes=(*made.notes, *notes),
        source=", ".join(files),
        places=places if len(files) == 1 else (),
    )


def _ballbar(text: str) -> tuple[str, Quantity]:
    """Read --ballbar."""
    plane, _, size = text.partition("=")
    if not re.fullmatch("[XYZ]{2}", plane) or len(set(plane)) != 2:
        raise argparse.ArgumentTypeError(f"{shown(text)} is not two axes and a radius, such as XY=150mm")
    return plane, quantity("--ballbar", "XY=150mm", positive=True)(size)


def _units(text: str) -> tuple[str, ...]:
    """Read --units."""
    from rodgen.data.units import UnitError, conversion_factor

    with contextlib.suppress(UnitError, ValueError):
        length, angle, *deviation = units = tuple(part.strip() for part in text.split(","))
        for unit in (length, *deviation):
            conversion_factor(unit, "length", "mm")
        conversion_factor(angle, "angle", "deg")
        if len(units) < 4:
            return units
    raise argparse.ArgumentTypeError(
        f"{shown(text)} is not a unit of length and one of angle, such as mm,deg, or these and one of deviations, such "
        "as mm,deg,um"
    )


OPTIONS = (
    argument("SOURCE", "the file, or files", InputFile, nargs="+", dest="sources"),
    option("-o --output MACHINE.toml", "the machine file, unless a SOURCE is one", OutputFile),
    option("-d --data DATA", "the measurements: .csv, .csv.gz or .parquet", OutputFile),
    plot("the machine's axes and targets, and the first readings, in space,"),
    repeated(
        "--column NAME=THEIRS",
        "of a table: what a column is, with sign, unit and offset, such as A='-A_axis [deg] + 90'",
    ),
    option(
        "--joints FIRST",
        "of a table: the column of the machine's first joint, such as q1; q2, q3 … are the others in their order",
    ),
    option(
        "--units LENGTH,ANGLE[,DEVIATION]",
        "of a table: units of columns without, such as mm,deg; of a table of deviations also theirs: mm,deg,um",
        _units,
    ),
    option(
        "--ballbar PLANE=RADIUS",
        "of a table with angle and radius, or its deviation: the circle, such as XY=150mm",
        _ballbar,
    ),
    option("--base LINK", "of a URDF: the link that stands still; default: the root"),
    option("--tip LINK", "of a URDF: the link that is measured; default: the only leaf"),
    choice(
        "--convention",
        ("standard", "modified"),
        "of a Denavit-Hartenberg table that does not tell: the link after each joint, or before it",
    ),
    choice(
        "--estimate",
        ("target", "geometry"),
        "of a URDF or a Denavit-Hartenberg table: what a fit adjusts; geometry is axes and points of all joints, "
        "too, to calibrate the robot itself",
        default="target",
    ),
    choice(
        "--azimuth",
        ("south", "north"),
        "of a pointing run: where azimuth is 0; it runs through east",
        default="south",
    ),
    choice(
        "--format",
        (1, 2, 3, 4),
        "of a pointing run: TPOINT's format of its lines, where their numbers could be of two",
        type=int,
    ),
    option(
        "--latitude ANGLE",
        "of an equatorial mount, where no run gives it, such as 31.7deg",
        quantity("--latitude", "31.7deg", dimension="angle"),
    ),
)
