"""``rodgen euler legs | direct | workspace``: tables of a 3-SPS-S machine, in and out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.csv as csv
import pyarrow.parquet as parquet
import pytest
from scipy.spatial.transform import Rotation

from rodgen.cli.main import main
from rodgen.kinematics import three_sps_s

MACHINE = ["--R", "200mm", "--r", "12cm", "--h", "0.26m"]
GEOMETRY = three_sps_s.Geometry(200, 120, 260)


@pytest.fixture
def attitudes(tmp_path):
    angles = np.array([[0, 0, 0], [30, 5, 4], [100, 60, 10], [-40, 10, 20]], float)
    path = tmp_path / "attitudes.csv"
    rows = "\n".join(",".join(map(str, row)) + ",note" for row in angles)
    path.write_text(f"alpha [deg],beta [deg],gamma [deg],text\n{rows}\n")
    return path, Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()


def complaint(capsys, arguments):
    """The one line of a command that does not run."""
    assert main([str(a) for a in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_legs_of_attitudes_and_back(attitudes, tmp_path, suffix):
    path, matrices = attitudes
    legs = tmp_path / f"legs{suffix}"
    assert main(["euler", "legs", str(path), "-o", str(legs), "--limits", "25,38cm", *MACHINE]) == 0
    table = csv.read_csv(legs) if suffix == ".csv" else parquet.read_table(legs)
    assert table.column_names[-5:] == ["L1 [mm]", "L2 [mm]", "L3 [mm]", "determinant", "status"]
    values = np.column_stack([table[f"L{n} [mm]"].to_numpy() for n in (1, 2, 3)])
    assert np.allclose(values, three_sps_s.legs(matrices, GEOMETRY), rtol=1e-14)
    assert table["status"].to_pylist() == ["near_singular", "allowed", "too_long", "allowed"]

    back = tmp_path / f"back{suffix}"
    assert main(["euler", "direct", str(legs), "-o", str(back), "--all", *MACHINE]) == 0
    table = csv.read_csv(back) if suffix == ".csv" else parquet.read_table(back)
    assert set(table["given status"].to_pylist()) == {"near_singular", "allowed", "too_long"}
    quaternions = np.column_stack([table[name].to_numpy() for name in ("q0", "qx", "qy", "qz")])
    found = Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
    assert np.allclose(
        three_sps_s.legs(found, GEOMETRY),
        np.column_stack([table[f"L{n} [mm]"].to_numpy() for n in (1, 2, 3)]),
        rtol=0,
        atol=1e-9,
    )
    for matrix in matrices[1:]:
        assert np.abs(found - matrix).max(axis=(1, 2)).min() < 1e-9
    assert set(table["status"].to_pylist()) == {"converged", "singular"}
    chi = np.column_stack([table[f"chi_{axis} [deg]"].to_numpy() for axis in "xyz"])
    assert np.allclose(np.cos(np.radians(chi)), np.diagonal(found, axis1=1, axis2=2), atol=1e-14)


def test_nearest_and_following(tmp_path, capsys):
    t = np.linspace(0, 3, 20)
    motion = three_sps_s.rotation_from_tilt_torsion(t, 0.4, 0.7)
    legs = three_sps_s.legs(motion, GEOMETRY)
    path = tmp_path / "legs.csv"
    rows = "\n".join(",".join(repr(float(x)) for x in row) for row in legs)
    path.write_text(f"L1 [mm],L2 [mm],L3 [mm]\n{rows}\n")
    for more in (["--follow", "--near", "0,0,40deg"], ["--near", "0,0,0.7rad"]):
        assert main(["euler", "direct", str(path), *more, *MACHINE]) == 0
        captured = capsys.readouterr()
        assert "20 converged" in captured.err
        rows = [line.split(",") for line in captured.out.splitlines()[1:]]
        found = Rotation.from_quat(np.array([row[3:7] for row in rows], float), scalar_first=True)
        assert np.allclose(found.as_matrix(), motion, rtol=0, atol=1e-9)


def test_the_machine_comes_from_a_file(attitudes, capsys):
    path, matrices = attitudes
    file = "examples/machines/three_sps_s/machine.toml"
    assert main(["euler", "legs", str(path), "--machine", file]) == 0
    rows = [line.split(",") for line in capsys.readouterr().out.splitlines()[1:]]
    assert np.allclose(np.array([row[4:7] for row in rows], float), three_sps_s.legs(matrices, GEOMETRY))


def test_the_start_of_a_machine_file_chooses_the_mode(tmp_path, capsys):
    text = Path("examples/machines/three_sps_s/machine.toml").read_text()
    file = tmp_path / "machine.toml"
    file.write_text(text.replace("h = 260 ", "start = [0, 0, -40]\nh = 260 "))
    legs = tmp_path / "legs.csv"
    legs.write_text("L1 [mm],L2 [mm],L3 [mm]\n273,273,273\n")
    signs = {}
    for more in ([], ["--near", "0,0,40deg"]):
        assert main(["euler", "direct", str(legs), "--machine", str(file), *more]) == 0
        row = capsys.readouterr().out.splitlines()[1].split(",")
        assert row[-1] == "converged"
        signs[bool(more)] = float(row[6])
    assert signs[False] == -signs[True] < 0


def test_the_workspace_is_printed_drawn_and_written(tmp_path, capsys):
    plot, grid = tmp_path / "map.html", tmp_path / "grid.parquet"
    more = ["--limits", "230,330mm", "--samples", "12", "--plot", str(plot), "-o", str(grid), *MACHINE]
    assert main(["euler", "workspace", *more, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = three_sps_s.workspace(GEOMETRY, (230, 330), samples=12)
    assert told["share"] == found.share
    assert told["cells"]["allowed"] == int((found.status == 0).sum()) > 0
    assert plot.stat().st_size > 10000
    table = parquet.read_table(grid)
    assert table.num_rows == found.status.size
    assert table["status"].to_pylist().count("allowed") == told["cells"]["allowed"]
    assert sum(table["joined"].to_pylist()) == int(found.joined.sum())
    assert main(["euler", "workspace", *more[:2], "--torsion", "30deg", "--side", "either", *MACHINE]) == 0
    assert "home        singular" in capsys.readouterr().out


def test_bad_input_is_one_line(attitudes, tmp_path, capsys):
    path, _ = attitudes
    legs = tmp_path / "legs.csv"
    legs.write_text("L1 [mm],L2 [mm]\n300,300\n")
    assert "L3" in complaint(capsys, ["euler", "direct", legs, *MACHINE])
    legs.write_text("L1 [mm],L2 [mm],L3 [mm]\n300,300,300\n")
    assert "--h: nothing" in complaint(capsys, ["euler", "direct", legs, *MACHINE[:4]])
    assert "--R: unit 'deg'" in complaint(capsys, ["euler", "legs", path, "--R", "200deg", *MACHINE[2:]])
    assert "R is -200.0" in complaint(capsys, ["euler", "legs", path, "--R=-200mm", *MACHINE[2:]])
    assert "least length first" in complaint(capsys, ["euler", "legs", path, "--limits", "3,2mm", *MACHINE])
    assert "is not a rotation vector with its unit" in complaint(
        capsys, ["euler", "direct", legs, "--near", "1,2", *MACHINE]
    )
    assert "--all: together with" in complaint(
        capsys, ["euler", "direct", legs, "--all", "--follow", *MACHINE]
    )
    tricept = "examples/machines/tricept/machine.toml"
    assert 'expected family = "3-sps-s"' in complaint(capsys, ["euler", "legs", path, "--machine", tricept])
    assert "one of the two" in complaint(capsys, ["euler", "legs", path, "--machine", tricept, *MACHINE])
    assert "is not an angle" in complaint(capsys, ["euler", "workspace", "--torsion", "30", *MACHINE])
