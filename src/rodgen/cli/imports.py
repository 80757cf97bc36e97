"""``rodgen import``: a machine file, and measurements, from the files that people have."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import FAILED, OK, Command, show
from rodgen.cli._outputs import Outputs
from rodgen.cli._values import quantity
from rodgen.errors import InputFileError
from rodgen.files import read_start

if TYPE_CHECKING:
    from rodgen.machines.imports.imported import Imported

__all__ = ["add_to"]

_IMPORT = """\
Make a machine file of a file in another form, and measurements where it has readings; say what was taken for what, and
check the two files.

  rodgen import robot.urdf --base base_link --tip tool0 -o machine.toml
  rodgen import table.csv --convention standard -o machine.toml
  rodgen import run.dat -o machine.toml -d data.csv
  rodgen import run.dat model.mod -o machine.toml -d data.csv

SOURCE is
  a robot in URDF: the chain of joints from the link --base to the link --tip. Lengths become mm, limits travels;
  fixed joints are part of what they join.
  a pointing run of TPOINT: alt-azimuth or equatorial, formats 1 to 4; or the log of the MMT's mount.
  a Denavit-Hartenberg table, CSV with the columns theta, d, a and alpha, and --convention; or TOML.
  a model of TPOINT, alone or with a run: its terms become effects with held parameters.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    made = command("import", _run, "make a machine file of other files", _IMPORT)
    made.add_argument("sources", metavar="SOURCE", nargs="+", help="the file, or files")
    made.add_argument(
        "-o", "--output", metavar="MACHINE.toml", required=True, help="the machine file that is written"
    )
    made.add_argument("-d", "--data", metavar="DATA", help="the measurements: .csv, .csv.gz or .parquet")
    made.add_argument(
        "--base", metavar="LINK", help="of a URDF: the link that stands still; default: the root"
    )
    made.add_argument(
        "--tip", metavar="LINK", help="of a URDF: the link that is measured; default: the only last one"
    )
    made.add_argument(
        "--convention",
        choices=("standard", "modified"),
        help="of a Denavit-Hartenberg table: the link after each joint, or before it",
    )
    made.add_argument(
        "--latitude",
        metavar="ANGLE",
        type=quantity("--latitude", "31.7deg", dimension="angle"),
        help="of an equatorial mount, where no run gives it, such as 31.7deg",
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of
    from rodgen.machines.machine import Machine

    with Outputs(*options.sources) as outputs:
        outputs.claim(options.output, options.data)
        made = _imported(options)
        if bool(options.data) != bool(made.columns):
            found, expected = "readings, and no -d", "-d DATA.csv, where they are written"
            if options.data:
                found, expected = "no readings", "no -d"
            raise InputFileError(options.sources[0], "file", found, expected)
        machine = machine_of(made.text, options.output, Machine)
        outputs.add(options.output, made.text.encode())
        said = [*made.notes, "", f"{options.output}:", machine.describe()]
        wrong = False
        if made.columns:
            from rodgen.calibration.file_check import check
            from rodgen.data.measurements import Measurements

            data = Measurements.from_frame(made.columns, name=options.data)
            checked = check(machine, data)
            wrong = bool(checked.wrong)
            said += ["", f"{options.data}: {data.rows} rows", checked.summary()]
            _write(options.data, made.columns)
    show("\n".join(said))
    return FAILED if wrong else OK


def _write(file: str, columns: Mapping[str, Any]) -> None:
    import pyarrow as pa

    from rodgen.data.tables import open_sink

    table = pa.table({name: pa.array(column) for name, column in columns.items()})
    with open_sink(file, table.schema) as sink:
        for batch in table.to_batches():
            sink.write(sink.encode(batch))


def _imported(options: argparse.Namespace) -> Imported:
    """Return what the sources are, by what they begin with."""
    from rodgen.machines.imports.denavit_hartenberg import is_table, machine_from_table
    from rodgen.machines.imports.tpoint import machine_from_tpoint
    from rodgen.machines.imports.tpoint_data import is_pointing_run
    from rodgen.machines.imports.tpoint_model import is_model
    from rodgen.machines.imports.urdf import is_urdf, machine_from_urdf

    kinds: dict[str, str] = {}
    for source in options.sources:
        start = read_start(source, "a file to import")
        tests = {
            "a Denavit-Hartenberg table": is_table(source, start),
            "a URDF": is_urdf(source, start),
            "a pointing run": is_pointing_run(start),
            "a model of TPOINT": is_model(start),
        }
        kind = next((name for name, fits in tests.items() if fits), "")
        if not kind:
            raise InputFileError(
                source, "file", "none of what can be imported", "what 'rodgen import --help' lists"
            )
        if kind in kinds:
            raise InputFileError(source, "file", f"{kind}, as is {kinds[kind]}", "one of each kind")
        kinds[kind] = source
    for kind in ("a URDF", "a Denavit-Hartenberg table"):
        if kind in kinds and len(kinds) > 1:
            raise InputFileError(kinds[kind], "file", f"{kind} with other files", "it alone")
    if "a URDF" in kinds:
        return machine_from_urdf(kinds["a URDF"], options.base, options.tip)
    if "a Denavit-Hartenberg table" in kinds:
        return machine_from_table(kinds["a Denavit-Hartenberg table"], options.convention)
    latitude = options.latitude.to("rad")[0] if options.latitude else None
    return machine_from_tpoint(kinds.get("a pointing run"), kinds.get("a model of TPOINT"), latitude=latitude)
