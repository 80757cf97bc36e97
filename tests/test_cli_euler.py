"""``rodgen euler``: tables in and out, units, statuses in words, and one line for every fault."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from rodgen.cli import main as cli
from rodgen.kinematics import instantaneous_euler as ie

TURNS = Rotation.random(60, random_state=9)
ANGLES = np.array([[30.0, 40, 50], [0, 0, 0], [90, 0, 0], [-20, 10, 5]])


@pytest.fixture
def table(tmp_path: Path):
    """Write columns as a CSV file."""

    def write(**columns: object) -> Path:
        path = tmp_path / "in.csv"
        names = list(columns)
        rows = zip(*(np.asarray(columns[name]).tolist() for name in names), strict=True)
        lines = [",".join(names), *(",".join(map(str, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def euler(capsys: pytest.CaptureFixture[str]):
    """Run a command; return its table and its messages."""

    def run(*arguments: object) -> tuple[dict[str, list], str]:
        code = cli.main(["euler", *map(str, arguments)])
        out, err = capsys.readouterr()
        assert code == 0, err
        return pa_csv.read_csv(io.BytesIO(out.encode())).to_pydict() if out else {}, err

    return run


def of_angles(unit: str = "deg", factor: float = 1.0) -> dict[str, np.ndarray]:
    return {f"{n} [{unit}]": ANGLES[:, i] * factor for i, n in enumerate(("alpha", "beta", "gamma"))}


def of_quaternions(turns: Rotation = TURNS) -> dict[str, np.ndarray]:
    return dict(zip(("q0", "qx", "qy", "qz"), turns.as_quat(scalar_first=True).T, strict=True))


def of_matrices(turns: Rotation = TURNS) -> dict[str, np.ndarray]:
    matrices = turns.as_matrix()
    return {f"r{i + 1}{j + 1}": matrices[:, i, j] for i in range(3) for j in range(3)}


def columns(found: dict[str, list], *names: str) -> np.ndarray:
    return np.array([found[name] for name in names], float).T


def test_angles_keep_the_table_and_its_unit(table, euler) -> None:
    found, told = euler("angles", table(**of_angles(), who=["a", "b", "c", "d"]))
    assert found["who"] == ["a", "b", "c", "d"]
    expected, _ = ie.angles_from_euler(np.radians(ANGLES))
    chi = columns(found, "chi_x [deg]", "chi_y [deg]", "chi_z [deg]")
    np.testing.assert_allclose(chi, np.degrees(expected), atol=1e-12)
    assert found["status"] == ["angles", "identity", "no_ridge", "angles"]
    assert told.endswith("4 rows written: 2 angles, 1 no_ridge, 1 identity\n")
    in_mrad, _ = euler("angles", table(**of_angles("mrad", 1000 * np.pi / 180)))
    np.testing.assert_allclose(columns(in_mrad, "chi_x [mrad]")[:, 0], 1000 * expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("form", ["ZYX", "ZYZ", "XYX", "xyz", "quaternion", "matrix"])
def test_attitudes_in_every_form(form: str, table, euler) -> None:
    if form == "quaternion":
        given = of_quaternions()
    elif form == "matrix":
        given = of_matrices()
    else:
        given = dict(zip(("alpha [rad]", "beta [rad]", "gamma [rad]"), TURNS.as_euler(form).T, strict=True))
    path = table(**given)
    unit = "deg" if form in ("quaternion", "matrix") else "rad"
    found, _ = euler("angles", path, "--from", form)
    chi = columns(found, *(f"chi_{axis} [{unit}]" for axis in "xyz"))
    expected = np.diagonal(TURNS.as_matrix(), axis1=1, axis2=2)
    np.testing.assert_allclose(np.cos(np.radians(chi) if unit == "deg" else chi), expected, atol=1e-13)
    found, _ = euler("ridge", path, "--from", form)
    lines = np.array([columns(found, *(f"{a}r_{c}" for c in "xyz")) for a in "XYZ"])
    expected = ie.ridge_lines(TURNS.as_matrix())[0][..., :3].swapaxes(0, 1)
    np.testing.assert_allclose(lines, expected, atol=1e-11)
    found, _ = euler("trajectory", path, "--from", form, "--to", "ZXZ")
    made = columns(found, *(f"ZXZ_{n} [{unit}]" for n in (1, 2, 3)))
    again = Rotation.from_euler("ZXZ", made, degrees=unit == "deg")
    assert (again * TURNS.inv()).magnitude().max() < 1e-12


def test_parquet_in_and_out_holds_what_csv_does(table, euler, tmp_path: Path) -> None:
    path = table(**of_angles(), t=range(4))
    pq.write_table(pa_csv.read_csv(path), tmp_path / "in.parquet")
    for command in ("angles", "ridge", "trajectory"):
        by_csv, _ = euler(command, path)
        euler(command, tmp_path / "in.parquet", "-o", tmp_path / "out.parquet")
        by_parquet = pq.read_table(tmp_path / "out.parquet").to_pydict()
        assert list(by_parquet) == list(by_csv)
        for name, values in by_csv.items():
            if isinstance(by_parquet[name][0], str):
                assert by_parquet[name] == values
            else:
                np.testing.assert_allclose(by_parquet[name], np.array(values, float), rtol=1e-14)


def test_rotations_have_a_row_each(table, euler) -> None:
    chi = np.degrees(ie.angles_from_matrix(TURNS[:2].as_matrix())[0])
    chi = np.concatenate([chi, [[90, 0, 0], [0, 0, 0]]])
    given = {f"chi_{axis} [deg]": chi[:, i] for i, axis in enumerate("xyz")}
    found, told = euler("rotations", table(**given, id=[1, 2, 3, 4]))
    assert found["id"] == [1] * 8 + [2] * 8 + [3, 4]
    assert found["rotation"] == [*range(1, 9), *range(1, 9), 0, 1]
    assert found["status"] == ["eight"] * 16 + ["infeasible", "one"]
    assert "1 infeasible" in told
    assert found["distance"][16] == pytest.approx(1 / np.sqrt(3))
    np.testing.assert_allclose(
        columns(found, "nearest_x [deg]", "nearest_y [deg]", "nearest_z [deg]")[16],
        np.degrees(np.arccos([1 / 3, 2 / 3, 2 / 3])),
    )
    made = columns(found, "q0", "qx", "qy", "qz")
    assert np.isnan(made[16]).all()
    again, _ = ie.angles_from_quaternion(made[:16])
    np.testing.assert_allclose(np.degrees(again), np.repeat(chi[:2], 8, axis=0), atol=1e-9)


@pytest.mark.parametrize("options", [["--ridge", "z"], ["--ridge", "xy", "--unoriented"]])
def test_ridge_lines_choose_a_rotation(options: list[str], table, euler) -> None:
    chi, _ = ie.angles_from_matrix(TURNS.as_matrix())
    lines = ie.ridge_lines(TURNS.as_matrix())[0]
    given = {f"chi_{axis} [rad]": chi[:, i] for i, axis in enumerate("xyz")}
    for i, axis in enumerate("XYZ"):
        given |= {f"{axis}r_{c}": lines[:, i, n] for n, c in enumerate("xyz")}
    found, _ = euler("rotations", table(**given), *options)
    assert found["status"] == ["chosen"] * 60
    assert found["left"] == [1] * 60
    made = Rotation.from_quat(columns(found, "q0", "qx", "qy", "qz"), scalar_first=True)
    assert (made * TURNS.inv()).magnitude().max() < 1e-7
    assert max(found["misfit [rad]"]) < 1e-7


def test_ridge_lines_with_a_moved_origin(table, euler) -> None:
    points = np.random.default_rng(1).normal(size=(60, 3))
    path = table(**of_matrices(), **{f"{axis} [mm]": points[:, i] for i, axis in enumerate("xyz")})
    found, told = euler("ridge", path, "--from", "matrix", "--point")
    expected = ie.ridge_lines(TURNS.as_matrix(), points)[0]
    for i, axis in enumerate("XYZ"):
        moments = columns(found, *(f"{axis}r_m{c} [mm]" for c in "xyz"))
        np.testing.assert_allclose(moments, expected[:, i, 3:], atol=1e-12)
    assert told.endswith("60 rows written: 60 line\n")


def test_rates_by_angular_velocity_and_by_the_rates_of_a_sequence(table, euler) -> None:
    speed = np.array([[1.0, 2, 3], [0, 0, 1], [0, 1, 0], [4, 5, 6]])
    rates = {f"{n}_rate [deg/s]": speed[:, i] for i, n in enumerate(("alpha", "beta", "gamma"))}
    found, _ = euler("rates", table(**of_angles(), **rates), "--euler-rates")
    expected = ie.rates_from_euler(np.radians(ANGLES), speed)
    made = columns(found, *(f"chi_{axis}_rate [deg/s]" for axis in "xyz"))
    np.testing.assert_allclose(made, expected.rate, atol=1e-12)
    assert found["status"] == ["regular", "kink", "kink", "regular"]
    _, omega = ie.motion_from_euler(np.radians(ANGLES), np.radians(speed))
    rates = {f"omega_{axis} [rad/min]": 60 * omega[:, i] for i, axis in enumerate("xyz")}
    found, _ = euler("rates", table(**of_angles(), **rates))
    made = columns(found, *(f"chi_{axis}_rate [rad/min]" for axis in "xyz"))
    np.testing.assert_allclose(made, 60 * np.radians(expected.rate), atol=1e-12)
    np.testing.assert_allclose(found["determinant"], expected.determinant, atol=1e-15)


@pytest.mark.parametrize("form", ["quaternion", "matrix"])
def test_what_is_nearly_a_rotation_has_the_status_not_normal(form: str, table, euler) -> None:
    given = of_quaternions(TURNS[:3]) if form == "quaternion" else of_matrices(TURNS[:3])
    given = {name: values * np.array([1, 1.01, 1]) for name, values in given.items()}
    path = table(**given, **{f"omega_{axis} [rad/s]": [1, 2, 3] for axis in "xyz"})
    for command, column, good in (
        ("angles", "status", "angles"),
        ("ridge", "status_y", "line"),
        ("rates", "status", "regular"),
        ("trajectory", "ZYX_status", "regular"),
    ):
        found, _ = euler(command, path, "--from", form)
        assert found[column] == [good, "not_normal", good]


def test_trajectory_follows_curve_1_through_zero(table, euler) -> None:
    x = np.linspace(0.1, 7, 70)
    path = table(t=x, **{"alpha [rad]": np.sin(x), "beta [rad]": 0 * x, "gamma [rad]": 0 * x})
    found, told = euler("trajectory", path)
    np.testing.assert_allclose(found["chi_x [rad]"], np.abs(np.sin(x)), atol=1e-14)
    np.testing.assert_allclose(found["signed_x [rad]"], np.sin(x), atol=1e-14)
    np.testing.assert_allclose(found["ZYX_1 [rad]"], np.sin(x), atol=1e-14)
    assert found["path_x"].count("turned") == 2
    assert set(found["path_z"]) == {"no_ridge"}
    assert set(found["ZYZ_status"]) == {"singular"}
    assert "2 turned" in told


def test_trajectory_of_many_blocks_is_one_motion(tmp_path: Path, euler) -> None:
    n = 70_000  # more rows than a block has
    angle = np.linspace(0.2, 300, n)
    path = tmp_path / "long.parquet"
    pq.write_table(pa.table({"alpha [rad]": angle, "beta [rad]": 0 * angle, "gamma [rad]": 0 * angle}), path)
    euler("trajectory", path, "-o", tmp_path / "out.parquet", "--to", "ZYX")
    found = pq.read_table(tmp_path / "out.parquet").to_pydict()
    np.testing.assert_allclose(found["signed_x [rad]"], angle, atol=1e-11)
    np.testing.assert_allclose(found["ZYX_1 [rad]"], angle, atol=1e-11)


@pytest.mark.parametrize(
    ("arguments", "header", "told"),
    [
        (["angles"], "alpha [deg],beta [deg]", "no column 'gamma'; expected one such as 'gamma [deg]'"),
        (["angles"], "alpha,beta [deg],gamma [deg]", "no unit; expected one in brackets"),
        (["angles"], "alpha [mm],beta [deg],gamma [deg]", "unit 'mm', which is not a unit of angle"),
        (
            ["angles", "--from", "quaternion"],
            "q0,qx,qy [deg],qz",
            "the unit 'deg'; expected 'qy', which has no unit",
        ),
        (["angles", "--from", "quaternion"], "q0,qx,qy", "no column 'qz'; expected all of q0,qx,qy,qz"),
        (["angles", "--from", "XXY"], "", "'XXY' is none of quaternion, matrix and the twelve sequences"),
        (
            ["rates"],
            "alpha [deg],beta [deg],gamma [deg],omega_x [deg],omega_y [deg/s],omega_z [deg/s]",
            "which is not a unit of rate",
        ),
        (["rates", "--euler-rates", "--from", "matrix"], "", "--from matrix; expected a sequence"),
        (["rotations", "--ridge", "w"], "", "'w' names no axes"),
        (["rotations", "--tolerance", "-1"], "", "'-1' is not a ratio"),
        (["rotations", "--ridge", "z"], "chi_x [deg],chi_y [deg],chi_z [deg]", "no column 'Zr_x'"),
        (["trajectory", "--to", "ZYX,ABC"], "", "the sequence 'ABC'; expected one of"),
        (["trajectory", "--to", "ZYX,ZYX"], "", "a sequence twice"),
    ],
)
def test_one_line_for_a_fault(arguments: list[str], header: str, told: str, tmp_path, capsys) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(f"{header}\n{','.join('1' for _ in header.split(','))}\n")
    assert cli.main(["euler", arguments[0], str(path), *arguments[1:]]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert told in err
    assert err.count("\n") == 1


def test_a_command_is_needed(capsys) -> None:
    assert cli.main(["euler"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert cli.main(["euler", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in ("angles", "rotations", "rates", "ridge", "trajectory"))
