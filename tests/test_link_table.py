"""Link tables: a mechanism is written and read back bit for bit, and every slip is reported with line and column."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rodgen.kinematics import spatial

HEADER = "joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]"
ROWS = ["base,R,0,,,120,90", "slide,P,,30,,0,-90", "screw,H,2,,1.5,1e-1,45", "tool,C,,,,,"]


def write(folder: Path, *lines: str, ending: str = "\n") -> str:
    path = folder / "arm.csv"
    path.write_bytes((ending.join(lines) + ending).encode())
    return str(path)


def test_table_gives_the_mechanism(tmp_path: Path) -> None:
    found = spatial.load_mechanism(write(tmp_path, HEADER, *ROWS))
    n = math.nan
    expected = spatial.Mechanism(
        "RPHC",
        a=[120, 0, 0.1],
        alpha=[math.pi / 2, -math.pi / 2, math.pi / 4],
        offset=[0, n, 2, n],
        angle=[n, math.pi / 6, n, n],
        pitch=[0, 0, 1.5, 0],
        name="arm",
        names=["base", "slide", "screw", "tool"],
    )
    assert found == expected
    assert not found.closed


def test_windows_blanks_quotes_and_order_do_not_matter(tmp_path: Path) -> None:
    expected = spatial.load_mechanism(write(tmp_path, HEADER, *ROWS))
    lines = [
        "\ufeff alpha [deg] , a [mm],type,S [mm],theta [deg],pitch [mm/rad], joint",
        "",
        '90,"120",R,0,,,base',
    ]
    lines += ["-90, 0 ,P,,30,,slide", "  ", "45,.1,H,2,,1.5,screw", ",,C,,,,tool", ",,,,,,"][:-1]
    assert spatial.load_mechanism(write(tmp_path, *lines, ending="\r\n")) == expected


def test_units_are_those_of_each_column(tmp_path: Path) -> None:
    lines = ["type,S [in],theta [rad],pitch [mm/rev],a [cm],alpha [rad]", "H,1,,25.4,2.54,0.5", "P,,1.25,,,"]
    found = spatial.load_mechanism(write(tmp_path, *lines))
    assert (found.unit, found.names) == ("in", ("H1", "P2"))
    np.testing.assert_allclose(found.a, [1.0], rtol=4e-16)
    np.testing.assert_allclose(found.pitch, [1 / (2 * math.pi), 0], rtol=4e-16)
    assert (found.alpha[0], found.angle[1]) == (0.5, 1.25)


def test_columns_that_are_left_out_are_zero(tmp_path: Path) -> None:
    found = spatial.load_mechanism(write(tmp_path, "type,a [m],alpha [deg]", "R,1,0", "P,0,90", "R,,"))
    assert found == spatial.Mechanism("RPR", [1, 0], np.radians([0, 90]), unit="m", name="arm")


def random_mechanism(seed: int) -> spatial.Mechanism:
    rng = np.random.default_rng(seed)
    kinds = rng.choice(list("RPCHEST"), rng.integers(1, 8))
    n = len(kinds)
    links = n - int(rng.integers(2))
    lengths, angles = rng.normal(0, 10.0 ** rng.integers(-8, 8), (2, n)), rng.uniform(-7, 7, (2, n))
    if seed % 2:
        angles = np.radians(np.round(np.degrees(angles)))
    blank = spatial.Mechanism(kinds, np.zeros(n), np.zeros(n), pitch=(kinds == "H") * 1.0)
    return spatial.Mechanism(
        kinds,
        lengths[0, :links],
        angles[0, :links],
        np.where(np.isnan(blank.offset), np.nan, lengths[1]),
        np.where(np.isnan(blank.angle), np.nan, angles[1]),
        np.where(kinds == "H", rng.normal(size=n), 0.0),
        unit=str(rng.choice(["mm", "in", "inch", "um"])),
        names=[f'{name}, "{k}"' for k, name in enumerate(kinds)],
    )


def table_of(mechanism: spatial.Mechanism) -> list[str]:
    """Lines of a table, all numbers with all digits; angles in rad."""
    unit = mechanism.unit
    lines = [f"joint,type,S [{unit}],theta [rad],pitch [{unit}/rad],a [{unit}],alpha [rad]"]
    for j, kind in enumerate(mechanism.joints):
        link = (mechanism.a[j], mechanism.alpha[j]) if j < len(mechanism.a) else (np.nan, np.nan)
        numbers = (mechanism.offset[j], mechanism.angle[j], mechanism.pitch[j], *link)
        name = '"' + mechanism.names[j].replace('"', '""') + '"'
        lines.append(",".join([name, kind, *("" if np.isnan(x) else repr(float(x)) for x in numbers)]))
    return lines


@pytest.mark.parametrize("seed", range(30))
def test_all_digits_are_loaded_to_the_last_bit(seed: int, tmp_path: Path) -> None:
    mechanism = replace(random_mechanism(seed), name="arm")
    assert spatial.load_mechanism(write(tmp_path, *table_of(mechanism))) == mechanism


@pytest.mark.parametrize(
    "lines",
    [
        [],
        [HEADER],
        [HEADER.replace(",", ";"), "a;R"],
        [HEADER.replace("theta", "angle"), *ROWS],
        [HEADER.replace(" [mm]", "", 1), *ROWS],
        [HEADER.replace("type", "type [mm]"), *ROWS],
        [HEADER.replace("S [mm]", "S [kg]"), *ROWS],
        [HEADER.replace("S [mm]", "S [foo]"), *ROWS],
        [HEADER.replace("mm/rad", "mm"), *ROWS],
        [HEADER.replace("mm/rad", "mm/s"), *ROWS],
        [HEADER.replace("a [mm]", "S [mm]"), *ROWS],
        [HEADER.replace(",a [mm]", ""), *ROWS],
        [HEADER + ",", *ROWS],
        [HEADER, "x,r,0,,,1,1"],
        [HEADER, "x,,0,,,1,1"],
        [HEADER, "x,X,0,,,1,1"],
        [HEADER, *ROWS[:2], "s,H,2,,,1,45", ROWS[3]],
        [HEADER, "s,H,2,,0,1,45", ROWS[3]],
        [HEADER, "s,R,2,,3,1,45", ROWS[3]],
        ["type,a [mm],alpha [deg]", "H,1,1"],
        [HEADER, "x,R,,,,1,1"],
        [HEADER, "x,P,1,0,,1,1"],
        [HEADER, "x,R,1,0,,1,1"],
        [HEADER, "x,R,0,,,,1", ROWS[3]],
        [HEADER, ROWS[0], "y,R,0,,,5,"],
        [HEADER, 'x,R,"12,5",,,1,1'],
        [HEADER, "x,R,1_000,,,1,1"],
        [HEADER, "x,R,nan,,,1,1"],
        [HEADER, "x,R,1e999,,,1,1"],
        [HEADER, "x,R,0,,,1,1,7"],
        [HEADER, "x [1],R,0,,,1,1"],
        [HEADER, ROWS[0], ROWS[0]],
        [HEADER, 'x,R,"0,,,1,1'],
        [HEADER, "x,R,0,,\0,1,1"],
    ],
)
def test_faults_are_reported_in_one_line(refuses, lines: list[str], tmp_path: Path) -> None:
    refuses(spatial.load_mechanism, write(tmp_path, *lines))


def test_what_is_no_table_is_an_error(refuses, tmp_path: Path) -> None:
    latin, large = tmp_path / "latin.csv", tmp_path / "large.csv"
    latin.write_bytes(HEADER.encode() + b"\n\xe4,R\n")
    large.write_bytes(b"joint,type\n" * 200_000)
    for path in (tmp_path, tmp_path / "none.csv", latin, large):
        refuses(spatial.load_mechanism, path)


def test_millimetres_and_degrees_need_numpy_alone(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER.replace("mm/rad", "mm/rev"), *ROWS)
    hide = "import sys\nfor m in ('pint', 'pyarrow', 'sympy', 'scipy'): sys.modules[m] = None\n"
    code = f"from rodgen import spatial\nprint(spatial.load_mechanism({path!r}).joints)"
    done = subprocess.run([sys.executable, "-c", hide + code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
