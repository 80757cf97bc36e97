"""Tables: what is read is what stands there, and every fault is named by its place."""

import csv
import gzip
import io
import os
import sys

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solved_table import solve_table

from rodgen.data.measurements import Measurements
from rodgen.data.tables import PAIR_COLUMNS, _csv, read_motions, write_table
from rodgen.data.units import conversion_factor
from rodgen.errors import InputFileError, RodgenError, shown

HEADER = "rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]"
ROW = "3,4,12,12,-3,4,90"
GOOD = f"{HEADER}\n{ROW}\n"


def parquet_bytes(columns):
    out = io.BytesIO()
    pq.write_table(pa.table(columns), out)
    return out.getvalue()


def pair_columns(n=3):
    return {name: np.arange(1.0, n + 1) for name in HEADER.split(",")}


def place_in_header(old, new):
    return f"{HEADER.replace(old, new)}\n{ROW}\n"


def cell(text):
    """A second row whose rho_z is `text`."""
    return f"{GOOD}3,4,{text},12,-3,4,90\n"


MALFORMED = {
    # the file as a whole
    "empty": b"",
    "only blank lines": b"\n\r\n \n",
    "excel workbook": b"PK\x03\x04" + b"x" * 99,
    "old excel workbook": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + b"x" * 99,
    "utf-16": GOOD.encode("utf-16"),
    "hdf5": b"\x89HDF\r\n\x1a\n" + b"\0" * 99,
    "binary": bytes(range(1, 9)) + b"\0\n",
    "binary, long": b"\1\0" * 3_000_000,
    "no line end": b"x" * 3_000_000,
    "carriage returns alone, long": b"1,2\r" * 900_000,
    "damaged gzip": gzip.compress(GOOD.encode() * 50)[:-30],
    "gzip around parquet": gzip.compress(parquet_bytes(pair_columns())),
    "truncated parquet": parquet_bytes(pair_columns())[:-50],
    "parquet magic alone": b"PAR1",
    # the header
    "header only": f"{HEADER}\n",
    "header only, blank lines": f"{HEADER}\n\n\n",
    "no header": f"{ROW}\n{ROW}\n",
    "comment": f"# measured on Monday\n{GOOD}",
    "semicolons": GOOD.replace(",", ";"),
    "tabs": GOOD.replace(",", "\t"),
    "missing column": place_in_header("rho_prime_y [mm]", "temperature [K]"),
    "misspelt column": place_in_header("rho_prime_y [mm]", "Rho_Prime_y [mm]"),
    "duplicate column": place_in_header("rho_y [mm]", "rho_x [mm]"),
    "duplicate column in two units": place_in_header("rho_y [mm]", "rho_y [mm],rho_x [um]"),
    "two columns without a name": f"{HEADER},,\n{ROW},,\n",
    "missing unit": place_in_header("rho_z [mm]", "rho_z"),
    "empty unit": place_in_header("rho_z [mm]", "rho_z []"),
    "unit in parentheses": place_in_header("rho_z [mm]", "rho_z (um)"),
    "unclosed bracket": place_in_header("angle [deg]", "angle [deg"),
    "unknown unit": place_in_header("rho_z [mm]", "rho_z [furlings]"),
    "unit in capitals": place_in_header("rho_z [mm]", "rho_z [MM]"),
    "unknown unit in capitals": place_in_header("[deg]", "[Deg]"),
    "wrong dimension": place_in_header("rho_prime_x [mm]", "rho_prime_x [deg]"),
    "angle in millimetres": place_in_header("angle [deg]", "angle [mm]"),
    "angle in per cent": place_in_header("[deg]", "[%]"),
    "unit with a number": place_in_header("[deg]", "[10 deg]"),
    "unit that never ends": place_in_header("[deg]", "[9**9**9**9]"),
    "square unit": place_in_header("rho_z [mm]", "rho_z [mm**2]"),
    "header in Latin-1": GOOD.replace("rho_z [mm]", "rho_z [µm]").encode("latin-1"),
    # cells
    "text": cell("left"),
    "empty cell": cell(""),
    "blank cell": cell("  "),
    "nan": cell("nan"),
    "-inf": cell("-inf"),
    "#N/A": cell("#N/A"),
    "too large": cell("1e999"),
    "decimal comma": cell('"1,5"'),
    "degrees sign": f"{GOOD}3,4,12,12,-3,4,90°\n",
    "unit in the cell": cell("12 mm"),
    "typographic minus": cell("−12"),
    "fortran exponent": cell("1.2D+01"),
    "thousands": cell("1'200.5"),
    "digits of another script": cell("١٢"),
    "hexadecimal": cell("0x10"),
    "underscore": cell("1_000"),
    "escape sequence": cell("\x1b[31m"),
    "very long cell": cell("y" * 200_000),
    "two faults": f"{GOOD}\nx,4,12,12,-3,4,90\n3,4,y,12,-3,4,z\n",
    # rows
    "too few cells": f"{GOOD}3,4,12\n",
    "too many cells": f"{GOOD}{ROW},1\n",
    "cut off": f"{GOOD}3,4,12,12,-3",
    "decimal commas": f"{GOOD}{ROW.replace(',', ',0,')},0\n",
    "semicolons in a row": f"{GOOD}{ROW.replace(',', ';')}\n",
    "row after a blank line": f"{GOOD}\n\n3,4\n",
    "commas alone": f"{GOOD},,,,,,\n",
    "unclosed quote": cell('"12'),
    "quoted line break": f'{HEADER},note\n{ROW},"a\nb"\n',
    "carriage return alone": f"{HEADER}\n{ROW}\r{ROW}\n",
    "zero byte": cell("1\0"),
    "Latin-1": f"{GOOD}3,4,12,12,-3,4,90°\n".encode("latin-1"),
    "damaged UTF-8": f"{GOOD}3,4,".encode() + b"\xff,12,-3,4,90\n",
    # Parquet
    "parquet: text": parquet_bytes(pair_columns() | {"rho_y [mm]": ["1", "2", "3"]}),
    "parquet: truth values": parquet_bytes(pair_columns() | {"rho_y [mm]": [True, False, True]}),
    "parquet: null": parquet_bytes(pair_columns() | {"rho_y [mm]": [1.0, None, 3.0]}),
    "parquet: nan": parquet_bytes(pair_columns() | {"angle [deg]": [1.0, 2.0, np.nan]}),
    "parquet: no rows": parquet_bytes(pair_columns(0)),
    "parquet: missing column": parquet_bytes({"x": [1.0]}),
    "parquet: missing unit": parquet_bytes(
        {k.replace("angle [deg]", "angle"): v for k, v in pair_columns().items()}
    ),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_file_is_named_by_its_place(refuses, name, tmp_path):
    content, path = MALFORMED[name], tmp_path / "pairs.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refuses(read_motions, path)


def test_missing_file_and_folder_are_reported(refuses, tmp_path):
    refuses(read_motions, tmp_path / "nowhere.csv")
    refuses(read_motions, tmp_path)
    refuses(read_motions, "a\0b")
    refuses(read_motions, __file__ + "/pairs.csv")


def test_error_is_one_line_pickles_and_is_a_value_error():
    import pickle

    error = InputFileError("a\nb.csv", "line 1", "x", "y")
    assert isinstance(error, RodgenError)
    assert isinstance(error, ValueError)
    assert str(error) == r"a\nb.csv: line 1: x; expected y"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert shown(b"\xb0C") == r"'\xb0C'"


# what is accepted --------------------------------------------------------------------------------------

EXPECTED = ([[3.0, 4, 12]], [[12.0, -3, 4]], [np.pi / 2], "mm")
ACCEPTED = {
    "plain": GOOD,
    "byte order mark": b"\xef\xbb\xbf" + GOOD.encode(),
    "CR LF": GOOD.replace("\n", "\r\n"),
    "no line end at the end": GOOD.rstrip("\n"),
    "CR LF, no LF at the end": GOOD.replace("\n", "\r\n").rstrip("\n"),
    "blank lines": "\n\r\n" + GOOD.replace("\n", "\n\n"),
    "gzip": gzip.compress(GOOD.encode()),
    "gzip in two members": gzip.compress(f"{HEADER}\n".encode()) + gzip.compress(f"{ROW}\n".encode()),
    "quoted": '"' + HEADER.replace(",", '","') + '"\n"' + ROW.replace(",", '","') + '"\n',
    "blanks around cells": GOOD.replace(",", " , "),
    "no-break spaces around numbers": f"{HEADER}\n{ROW.replace(',', chr(160) + ',')}\n",
    "signs and exponents": f"{HEADER}\n+3,4.,1.2e1,+120E-1,-3,4e+00,90.0\n",
    "no blank before the unit": GOOD.replace(" [", "["),
    "degrees sign as unit": GOOD.replace("[deg]", "[°]"),
    "more columns": f"run,{HEADER},note\n1,{ROW},\"left, wet\"\n",
    "other order": ",".join(reversed(HEADER.split(","))) + "\n" + ",".join(reversed(ROW.split(","))) + "\n",
    "a column without a name": f",{HEADER}\n0,{ROW}\n",
    "trailing comma": f"{HEADER},\n{ROW},\n",
    "parquet": parquet_bytes(dict(zip(HEADER.split(","), ([float(x)] for x in ROW.split(",")), strict=True))),
    "parquet of integers": parquet_bytes(
        dict(zip(HEADER.split(","), ([int(x)] for x in ROW.split(",")), strict=True))
    ),
    "parquet of float32": parquet_bytes(
        {
            name: pa.array([float(x)], pa.float32())
            for name, x in zip(HEADER.split(","), ROW.split(","), strict=True)
        }
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ACCEPTED)
def test_readable_file_gives_its_numbers(name, tmp_path):
    content = ACCEPTED[name]
    path = tmp_path / "pairs.any"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    pairs = read_motions(path)
    for expected, actual in zip(EXPECTED, (pairs.rho, pairs.rho_prime, pairs.angle, pairs.unit), strict=True):
        np.testing.assert_array_equal(actual, expected)  # exact: 90 pi/180 is a double product in both
    assert pairs.rho.flags.c_contiguous


def test_standard_input_is_read_as_csv(refuses, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(GOOD.encode())))
    np.testing.assert_array_equal(read_motions("-").rho, [[3, 4, 12]])
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(parquet_bytes(pair_columns()))))
    refuses(read_motions, "-")


@pytest.mark.parametrize("unit", ["", "mm,", "(mm)", "mm mm", "''", "s", "kg", "m**-1", "mm/m", "__class__"])
def test_what_is_no_length_is_refused(refuses, unit):
    refuses(conversion_factor, unit, "length", "mm")


def test_every_column_may_have_its_own_unit(tmp_path):
    path = tmp_path / "pairs.csv"
    units = ["mm", "um", "m", "inch", "mm", "cm", "arcsec"]
    names = [column.name for column in PAIR_COLUMNS]
    header = ",".join(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))
    path.write_text(f"{header}\n1,2000,3,4,5,6,7200\n")
    pairs = read_motions(path)
    np.testing.assert_allclose(pairs.rho, [[1, 2, 3000]], rtol=4e-16)  # one product of a rounded factor
    np.testing.assert_allclose(pairs.rho_prime, [[101.6, 5, 60]], rtol=4e-16)
    np.testing.assert_allclose(pairs.angle, np.deg2rad([2.0]), rtol=4e-16)


# lines and rows ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", [2, 3, 20, 41])
@pytest.mark.parametrize("block", [500, 1 << 20])
def test_line_of_a_fault_does_not_depend_on_the_blocks_of_arrow(refuses, block, line, monkeypatch, tmp_path):
    rows = [HEADER, *[f"{i},{i + 0.5},{-i},{i},1,2,{i % 360}" for i in range(1, 41)]]
    path = tmp_path / "pairs.csv"
    path.write_text("\r\n".join(rows))
    monkeypatch.setattr(_csv, "BLOCK_BYTES", block)
    np.testing.assert_array_equal(read_motions(path).rho[:, 1], np.arange(1, 41) + 0.5)
    rows[line - 1] = "1,2,x,4,5,6,7"
    path.write_text("\n".join(rows))
    refuses(read_motions, path)


def test_row_of_a_fault_in_parquet_does_not_depend_on_the_row_groups(refuses, tmp_path):
    columns = pair_columns(40)
    columns["rho_z [mm]"][33] = np.inf
    path = tmp_path / "pairs.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=16)
    refuses(read_motions, path)


def test_a_table_larger_than_memory_is_refused(refuses, tmp_path, monkeypatch):
    monkeypatch.setattr(_csv, "_most_bytes", lambda: 1_000_000)
    path = tmp_path / "pairs.csv.gz"
    path.write_bytes(gzip.compress(GOOD.encode() + b"\n" * 3_000_000))
    refuses(read_motions, path)


# any bytes ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "pairs.any"


def cut_file(cell, last, lines=30, end=""):
    random = np.random.default_rng(0)
    rows = [f"{i},{cell(random.normal())}\n" for i in range(lines)]
    return "t [s],x [mm]\n" + "".join(rows) + f"{lines},{last}{end}"


CUT = {
    "fewer decimals": (lambda x: f"{x:.4f}", "1.23"),
    "no decimals": (lambda x: f"{x:.4f}", "1"),
    "of many digits": (repr, "0.123"),
    "in an exponent": (lambda x: f"{x:.6e}", "1.234567e-0"),
    "before an exponent": (lambda x: f"{x:.6e}", "1.234567"),
    "before the digits of an exponent": (lambda x: f"{1e16 * x:.0e}", "-1"),
    "before a zero's decimals": (lambda x: f"{x:.4f}", "0.0"),
}


@pytest.mark.parametrize(("cell", "last"), CUT.values(), ids=CUT)
@pytest.mark.parametrize("pack", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_a_file_that_was_cut_in_its_last_number_is_refused(refuses, cell, last, pack, scratch):
    """The number was read as it stood."""
    scratch.write_bytes(pack(cut_file(cell, last).encode()))
    refuses(Measurements.load, scratch)
    scratch.write_bytes(pack(cut_file(cell, last, end="\n").encode()))
    assert Measurements.load(scratch).rows == 31


WHOLE = {
    "as many digits": (lambda x: f"{x:.4f}", "1.2345", 30),
    "digits that vary": (lambda x: str(round(x, 3)), "1.2", 30),
    "few lines": (lambda x: f"{x:.4f}", "1.2", 5),
    "whole numbers": (lambda x: str(round(100 * x)), "7", 30),
    "mixed": (lambda x: f"{1e-4 * x:.3g}", "0.5", 30),
    "zero after exponents": (lambda x: f"{1e16 * x:.0e}", "0.0", 30),
    "zero of many digits": (lambda x: repr(1e-9 * x), "0", 30),
}


@pytest.mark.parametrize(("cell", "last", "lines"), WHOLE.values(), ids=WHOLE)
def test_a_whole_last_line_needs_no_line_end(cell, last, lines, scratch):
    scratch.write_text(cut_file(cell, last, lines))
    assert Measurements.load(scratch).rows == lines + 1


def test_flipped_bits_of_a_written_parquet_file_are_found(scratch):
    """Nine in ten changed numbers."""
    random = np.random.default_rng(0)
    table = pa.table({"x [mm]": random.normal(size=200), "t [s]": np.arange(200.0), "run": ["a", "b"] * 100})
    path = scratch.with_suffix(".parquet")
    write_table(path, table)
    good = path.read_bytes()
    pages = len(good) - 8 - int.from_bytes(good[-8:-4], "little")

    def numbers():
        columns = Measurements.load(path).columns
        return {name: column.values.tolist() for name, column in columns.items()}

    expected, found = numbers(), 0
    for at, bit in zip(random.integers(pages, size=500), random.integers(8, size=500), strict=True):
        path.write_bytes(good[:at] + bytes([good[at] ^ 1 << bit]) + good[at + 1 :])
        try:
            assert numbers() == expected  # a bit of a page's statistics, which nobody reads
        except InputFileError:
            found += 1
    assert found > 450


def test_parquet_without_checksums_is_read(scratch):
    path = scratch.with_suffix(".parquet")
    pq.write_table(pa.table({"x [mm]": [1.5, 2.5]}), path, write_page_checksum=False)
    assert Measurements.load(path).columns["x"].values.tolist() == [1.5, 2.5]


@settings(max_examples=100, deadline=None)
@given(
    rows=st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=7, max_size=7),
        min_size=1,
        max_size=20,
    )
)
def test_numbers_come_back_bit_for_bit(rows, scratch):
    names = [f"{c.name} [{'mm' if c.quantity == 'length' else 'rad'}]" for c in PAIR_COLUMNS]
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows)]
    scratch.write_text("\n".join([*lines, ""]))
    pairs = read_motions(scratch)
    values = np.column_stack([pairs.rho, pairs.rho_prime, pairs.angle])
    np.testing.assert_array_equal(values, np.array(rows))
    np.testing.assert_array_equal(np.signbit(values), np.signbit(np.array(rows)))


# writing -----------------------------------------------------------------------------------------------


SMALL = pa.table({"x [mm]": [1.5, -0.0, 1e-300], "note": ["a", "b, c", 'say "d"'], "n": [1, None, 3]})


def test_csv_reads_back_as_written(tmp_path):
    path = tmp_path / "out.csv"
    write_table(path, SMALL)
    assert path.read_text() == 'x [mm],note,n\n"1.5","a","1"\n'.replace('"1.5"', "1.5").replace(
        '"1"', "1"
    ) + ('-0,"b, c",\n1e-300,"say ""d""",3\n')


@pytest.mark.parametrize("name", ["out.csv", "out.CSV", "out.csv.gz", "out.parquet"])
def test_every_format_reads_back_as_written(name, tmp_path):
    path = tmp_path / name
    write_table(path, SMALL)
    read = pq.read_table(path) if name.endswith("parquet") else pa_csv.read_csv(gunzipped(path))
    assert read.to_pydict() == SMALL.to_pydict()
    assert os.listdir(tmp_path) == [name]


def gunzipped(path):
    content = path.read_bytes()
    return io.BytesIO(gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content)


def test_gzip_bytes_do_not_depend_on_time_or_name(tmp_path):
    for name in ("a.csv.gz", "b.csv.gz"):
        write_table(tmp_path / name, SMALL)
    assert (tmp_path / "a.csv.gz").read_bytes() == (tmp_path / "b.csv.gz").read_bytes()


def test_parquet_has_row_groups_of_moderate_size(tmp_path, monkeypatch):
    monkeypatch.setattr("rodgen.data.tables.writer._ROW_GROUP", 1000)
    write_table(tmp_path / "out.parquet", pa.table({"x": np.arange(3500.0)}))
    written = pq.ParquetFile(tmp_path / "out.parquet").metadata
    assert [written.row_group(i).num_rows for i in range(written.num_row_groups)] == [1000, 1000, 1000, 500]


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz", "out.parquet"])
def test_an_error_on_the_way_leaves_what_was_there(name, tmp_path, monkeypatch):
    path = tmp_path / name
    path.write_text("what was there")
    monkeypatch.setattr("rodgen.data.tables.writer._write_csv", lambda *_: 1 / 0)
    monkeypatch.setattr(pq, "write_table", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_table(path, SMALL)
    assert path.read_text() == "what was there"
    assert os.listdir(tmp_path) == [name]


def test_replaced_file_keeps_its_permissions_and_its_link(tmp_path):
    path, link = tmp_path / "out.csv", tmp_path / "link.csv"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_table(link, SMALL)
    assert link.is_symlink()
    assert path.read_text().startswith("x [mm]")
    assert path.stat().st_mode & 0o777 == 0o640


def test_new_file_has_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "any").write_text("")
    write_table(tmp_path / "out.csv", SMALL)
    assert (tmp_path / "out.csv").stat().st_mode == (tmp_path / "any").stat().st_mode


def test_device_is_written_and_not_replaced():
    write_table("/dev/null", SMALL)
    assert not os.path.isfile("/dev/null")


UNWRITABLE = {
    "nowhere/out.csv": "file: cannot be written (No such file or directory); expected a writable place",
    "folder.csv": "file: a folder; expected the name of a file",
    "out.txt": "file: a name that does not say what to write; expected a name that ends in .csv, .csv.gz or",
    "out": "file: a name that does not say what to write; expected a name that ends in .csv",
    "pairs.csv": "file: the input file itself; expected another name for the output",
    "link.csv": "file: the input file itself; expected another name for the output",
    "pairs.csv/out.csv": "file: cannot be written (Not a directory); expected a writable place with room",
    "x" * 300 + ".csv": "file: cannot be written (File name too long)",
    "a\0.csv": "file: cannot be written (",
}


@pytest.mark.parametrize("name", UNWRITABLE)
def test_output_that_cannot_be_written_is_named(refuses, name, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "pairs.csv").write_text(GOOD)
    (tmp_path / "link.csv").symlink_to(tmp_path / "pairs.csv")
    before = sorted(os.listdir(tmp_path))
    refuses(solve_table, tmp_path / "pairs.csv", tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == before
    assert (tmp_path / "pairs.csv").read_text() == GOOD


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
@pytest.mark.parametrize("rows", [1, 20_000])
def test_full_disk_is_reported(refuses, rows):
    table = pa.table({"x": np.arange(float(rows))})
    refuses(write_table, "/dev/full", table)


def test_nested_columns_need_parquet(refuses, tmp_path):
    nested = pa.table({"x": [[1.0], [2.0]]})
    refuses(write_table, tmp_path / "out.csv", nested)
    write_table(tmp_path / "out.parquet", nested)
    assert pq.read_table(tmp_path / "out.parquet").to_pydict() == nested.to_pydict()


# solving -----------------------------------------------------------------------------------------------


RESULTS = ["e1_x", "e1_y", "e1_z", "e2_x", "e2_y", "e2_z", "status", "length_mismatch", "condition"]


def turned_pairs(n, seed=0):
    """Random pairs, the axis that made each, and the angle."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    rho = rng.normal(size=(n, 3)) * 100
    angle = rng.uniform(0.3, 2.8, n)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = (axis * rho).sum(axis=1)[:, None]
    return rho, rho * cos + np.cross(axis, rho) * sin + axis * along * (1 - cos), angle, axis


def pair_table(n, **more):
    rho, rho_prime, angle, axis = turned_pairs(n)
    values = [*rho.T, *rho_prime.T, np.rad2deg(angle)]
    return pa.table(
        {**dict(zip(HEADER.split(","), map(np.ascontiguousarray, values), strict=True)), **more}
    ), axis


def write_pairs(path, table):
    if str(path).endswith(".parquet"):
        pq.write_table(table, path)
    else:
        pa_csv.write_csv(table, path)


def read_table(path):
    return pq.read_table(path) if str(path).endswith(".parquet") else pa_csv.read_csv(gunzipped(path))


@pytest.mark.parametrize("given_as", ["in.csv", "in.parquet"])
@pytest.mark.parametrize("asked_for", ["out.csv", "out.csv.gz", "out.parquet"])
def test_solved_table_keeps_its_columns_and_gains_the_axis(given_as, asked_for, tmp_path):
    run, note = np.arange(300), [f'"{i}", ü' for i in range(300)]
    table, axis = pair_table(300, run=run, note=note)
    write_pairs(tmp_path / given_as, table)
    summary = solve_table(tmp_path / given_as, tmp_path / asked_for)
    assert summary.rows == 300
    assert summary.counts == {"two_axes": 300}
    solved = read_table(tmp_path / asked_for)
    assert solved.column_names == [*table.column_names, *RESULTS]
    # An unused column of a CSV file is text; only a reader of CSV makes numbers of it again.
    unread = str if (given_as, asked_for) == ("in.csv", "out.parquet") else int
    assert solved["run"].to_pylist() == [unread(i) for i in run]
    assert solved["note"].to_pylist() == note
    for name in HEADER.split(","):
        np.testing.assert_array_equal(solved[name], table[name])
    roots = np.stack([[np.asarray(solved[f"e{root}_{x}"]) for x in "xyz"] for root in (1, 2)])
    error = np.abs(roots - axis.T).max(axis=1).min(axis=0)
    # A turned point is off by some eps of its length, which the condition number multiplies.
    assert (error <= 8 * np.finfo(float).eps * np.asarray(solved["condition"])).all()
    assert (np.abs(np.asarray(solved["length_mismatch"])) < 1e-14).all()


def test_cells_of_a_csv_stay_letter_for_letter(tmp_path):
    rows = ["+3.000,4.,12e0,12.00,-3,0004,90.0", "3,4,12,12,-3,4, 90 "]
    (tmp_path / "in.csv").write_text("\n".join([HEADER, *rows]))
    solve_table(tmp_path / "in.csv", tmp_path / "out.csv")
    written = (tmp_path / "out.csv").read_text().splitlines()
    assert [line[: len(row) + 1] for line, row in zip(written[1:], rows, strict=True)] == [
        f"{r}," for r in rows
    ]


def test_status_is_the_name_of_the_solver(tmp_path):
    rows = {
        "two_axes": "3,4,12,12,-3,4,120",
        "no_axis": "1,0,0,0,1,0,45",
        "parallel": "1,0,0,1,0,0,30",
        "perpendicular": "1,0,0,-1,0,0,180",
        "every_axis": "1,0,0,1,0,0,360",
        "lengths_differ": "1,0,0,0,1.001,0,120",
    }
    (tmp_path / "in.csv").write_text("\n".join([HEADER, *rows.values()]))
    summary = solve_table(tmp_path / "in.csv", tmp_path / "out.parquet")
    solved = pq.read_table(tmp_path / "out.parquet")
    assert solved["status"].to_pylist() == list(rows)
    assert summary.counts == dict.fromkeys(rows, 1)
    axes = np.array([solved[name] for name in RESULTS[:6]]).T.reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=4e-16)  # unit to two roundings
    assert solved["length_mismatch"][5].as_py() == pytest.approx(1e-3, rel=1e-12)  # cancellation of 1e3
    wide = solve_table(tmp_path / "in.csv", tmp_path / "out.parquet", length_tolerance=1e-2)
    assert "lengths_differ" not in wide.counts


def test_results_of_an_earlier_run_are_not_mixed_with_new_ones(tmp_path):
    (tmp_path / "in.csv").write_text(GOOD)
    solve_table(tmp_path / "in.csv", tmp_path / "out.csv")
    solve_table(tmp_path / "out.csv", tmp_path / "again.csv")
    with (tmp_path / "out.csv").open() as first, (tmp_path / "again.csv").open() as second:
        once, again = list(csv.DictReader(first)), list(csv.DictReader(second))
    assert [name for name in again[0] if not name.startswith("given ")] == list(once[0])
    for name in RESULTS:
        assert [row[f"given {name}"] for row in again] == [row[name] for row in once]
