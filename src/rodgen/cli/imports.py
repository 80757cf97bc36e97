"""``rodgen import``: a machine file, and measurements, from the files that people have."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rodgen.cli._console import (
    FAILED,
    OK,
    Command,
    Parser,
    UsageError,
    argument,
    arguments_as_options,
    choice,
    option,
    refused,
    repeated,
    show,
)
from rodgen.cli._machine import figures_for, plot
from rodgen.cli._values import InputFile, OutputFile
from rodgen.errors import shown
from rodgen.files import write_file

if TYPE_CHECKING:
    from rodgen.machines.imports.imported import Imported

_IMPORT = """\
Make a machine file of a file in another form, and measurements where it has readings; say what was taken for what, and
check the two files. SOURCE is

  a robot in URDF, from the link --base to the link --tip; or a Denavit-Hartenberg table: CSV or TOML
  a pointing run of TPOINT, formats 1 to 4, or the log of the MMT's mount; a model of TPOINT, alone or with a run
  the printer.cfg of a delta printer (Klipper); the probe log of Klipper, Marlin or RepRapFirmware, with that or a
  machine file
  a machine file, or one of these, with tables of readings: CSV or other text, .xlsx or .mat; one, or one a target or
  run. Columns are known by their names, by --column, or by [columns] of the machine file.

  rodgen import machine.toml readings.xlsx -d data.csv --column A="-A_axis [deg]" --units mm,deg
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command("import", _run, _IMPORT, *_FILES, *_OPTIONS)


def imported_with(sources: Sequence[str], arguments: Sequence[str]) -> Imported:
    """Return what the command makes of files; `arguments` are its options, as on a command line, but for its files.

    Raises
    ------
    RodgenError
        When an option is wrong, or the files are none that can be imported.
    """
    parser = Parser(prog="rodgen import", add_help=False)
    for each in _OPTIONS:
        each.add_to(parser)
    try:
        return _imported(parser.parse_args(arguments, argparse.Namespace(sources=sources)))
    except UsageError as error:
        raise error.args[0] from None


def _imported(options: argparse.Namespace) -> Imported:
    from rodgen.machines.imports.files import import_files

    columns = dict(map(_column, options.column))
    typed = {name: getattr(options, name) for name in _ARGUMENTS}
    with arguments_as_options():
        return import_files(options.sources, columns=columns, **typed)


def _column(text: str) -> tuple[str, str]:
    name, mark, theirs = text.partition("=")
    if not mark or not name.strip():
        raise refused("--column", shown(text), "NAME=THEIRS, such as A='-A_axis [deg] + 90'")
    return name, theirs


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of

    figures = figures_for(options.plot)
    imported = _imported(options)
    for name, wanted, there in (
        ("-o", options.output, not imported.is_given),
        ("-d", options.data, bool(imported.columns)),
    ):
        if bool(wanted) != there:
            raise refused("rodgen import", *_MISFITS[name, there])
    machine = imported.machine
    notes = list(imported.notes)
    if options.output:
        machine = machine_of(imported.text, options.output)
        write_file(options.output, imported.text.encode())
        notes += ["", f"{options.output}:", machine.describe()]
    wrong, observations = False, None
    if imported.columns:
        from rodgen.calibration.check import check

        data = imported.measurements()
        checked = check(machine, data)
        wrong, observations = bool(checked.wrong), checked.observations
        notes += ["", f"{options.data}: {data.rows} rows", checked.summary()]
        imported.write_data(options.data)
    if figures is not None:
        figures.save_figure(figures.skeleton(machine, observations), options.plot)
    show("\n".join(notes))
    return FAILED if wrong else OK


_ARGUMENTS = "joints units ballbar base tip convention estimate azimuth format latitude".split()
"""Options that are arguments of `import_files`, as they are typed."""
_MISFITS = {
    ("-o", False): ("-o, though a SOURCE is a machine file", "no -o: that file stays as it is"),
    ("-o", True): ("no -o", "-o MACHINE.toml: the machine file that is made"),
    ("-d", False): ("-d, but no SOURCE has readings", "no -d, or a table of readings, too"),
    ("-d", True): ("no -d", "-d DATA.csv: the readings go there"),
}
"""By option, and whether it is needed: what was found, and what was expected."""

_FILES = (
    argument("SOURCE", "the file, or files", InputFile, nargs="+", dest="sources"),
    option("-o --output MACHINE.toml", "the machine file, unless a SOURCE is one", OutputFile),
    option("-d --data DATA", "the measurements: .csv, .csv.gz or .parquet", OutputFile),
    plot("the machine's axes and targets, and the first readings, in space"),
)
_OPTIONS = (
    repeated("--column NAME=THEIRS", "of a table: what a column is, such as A='-A_axis [deg] + 90'"),
    option("--joints FIRST", "of a table: the column of the first joint, such as q1, then q2, q3 …"),
    option(
        "--units LENGTH,ANGLE[,DEVIATION]",
        "of a table: units of columns without, such as mm,deg or mm,deg,um",
    ),
    option("--ballbar PLANE=RADIUS", "of a table with angle and radius: the circle, such as XY=150mm"),
    option("--base LINK", "of a URDF: the link that stands still; default: the root"),
    option("--tip LINK", "of a URDF: the link that is measured; default: the only leaf"),
    choice("--convention", ("standard", "modified"), "of a Denavit-Hartenberg table that does not tell"),
    choice(
        "--estimate",
        ("target", "geometry"),
        "of a robot: what a fit adjusts; geometry is axes and points, too",
        default="target",
    ),
    choice(
        "--azimuth",
        ("north", "south"),
        "of a pointing run: where azimuth is 0; it runs through east. Default: what comments of the run say, or north",
    ),
    choice(
        "--format", (1, 2, 3, 4), "of a pointing run: TPOINT's format, where it could be of two", type=int
    ),
    option("--latitude ANGLE", "of an equatorial mount, where no run gives it, such as 31.7deg"),
)
