"""Commands read what other commands of their group have written: through a pipe, with rows that have no result."""

import csv
import io
import sys

import numpy as np
import pytest

from rodgen.cli import main as cli

POINTS = "Qx [mm],Qy [mm],Qz [mm]\n100,50,650\n0,0,0\n-30,80,700.5\n"
RODS = "A0 [mm],A1 [mm],A-1 [mm]\n700,700,720\n10,10,900\n"
ATTITUDES = "alpha [deg],beta [deg],gamma [deg]\n10,20,30\n-40,25,5\n"
ANGLES = "chi_x [deg],chi_y [deg],chi_z [deg]\n40,30,20\n170,10,10\n"
LEGS = ("--R", "100mm", "--r", "80mm", "--h", "120mm")
PUMA = "examples/mechanisms/puma_560.csv"


@pytest.fixture
def pipe(capsys, monkeypatch):
    """Return the function that runs commands on a text, each on what the one before wrote."""

    def run(text, *commands):
        for command in commands:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
            code = cli.main(
                [*command.split(), "-", *(LEGS if "legs" in command or command[6:] == "direct" else ())]
            )
            text, err = capsys.readouterr()
            assert code == 0, err
        return list(csv.DictReader(io.StringIO(text)))

    return run


def numbers(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


def test_the_point_of_the_rods_of_a_point_is_that_point(pipe):
    rows = pipe(POINTS, "tricept inverse", "tricept direct")
    Q = ("Qx [mm]", "Qy [mm]", "Qz [mm]")
    found, given = numbers(rows, *Q), numbers(rows, *[f"given {name}" for name in Q])
    np.testing.assert_allclose(found[::2], given[::2], atol=1e-9)
    assert [row["given status"] for row in rows] == ["reachable", "gimbal_lock", "reachable"]


def test_rows_without_a_result_pass(pipe):
    rows = pipe(RODS, "tricept direct", "tricept inverse", "tricept direct")
    assert [row["status"] for row in rows] == ["reachable", "invalid"]
    assert [row["given status"] for row in rows] == ["reachable", "invalid"]
    assert [row["given given status"] for row in rows] == ["reachable", "unreachable"]
    assert numbers(rows, "A0 [mm]")[0] == pytest.approx(700, abs=1e-9)


def test_rotations_have_the_angles_of_an_attitude(pipe):
    rows = pipe(ATTITUDES, "euler angles", "euler rotations", "euler angles --from quaternion")
    chi = ("chi_x [deg]", "chi_y [deg]", "chi_z [deg]")
    np.testing.assert_allclose(numbers(rows, *chi), numbers(rows, *[f"given {n}" for n in chi]), atol=1e-9)
    assert {row["status"] for row in rows} == {"angles"}
    assert len(rows) == 16
    rows = pipe(ANGLES, "euler rotations", "euler angles --from quaternion")
    assert rows[-1]["given status"] == "infeasible"
    assert rows[-1]["status"] == "invalid"


def test_legs_lead_back_to_the_attitude(pipe):
    rows = pipe(ATTITUDES, "euler legs", "euler direct", "euler legs --from quaternion")
    L = ("L1 [mm]", "L2 [mm]", "L3 [mm]")
    np.testing.assert_allclose(numbers(rows, *L), numbers(rows, *[f"given {name}" for name in L]), atol=1e-9)


def test_joints_lead_back_to_the_pose(pipe):
    joints = "R1 [deg],R2 [deg],R3 [deg],R4 [deg],R5 [deg],R6 [deg]\n10,20,30,40,50,60\n"
    once = pipe(joints, f"mechanism forward {PUMA}")
    names = [name for name in once[0] if name[:1] in "xyzq"]
    rows = pipe(joints, f"mechanism forward {PUMA}", f"mechanism reverse {PUMA}", f"mechanism forward {PUMA}")
    assert len(rows) > 1
    np.testing.assert_allclose(
        np.abs(numbers(rows, *names)), np.abs(numbers(once, *names)).repeat(len(rows), 0), atol=1e-6
    )


@pytest.mark.parametrize(
    "command",
    [
        "tricept inverse", "tricept inverse --all", "tricept direct", "tricept direct --all",
        "tricept uncertainty --u rods=9um", "euler angles", "euler angles --from quaternion",
        "euler angles --from matrix", "euler rotations", "euler rotations --ridge z", "euler rates",
        "euler ridge --point", "euler trajectory", "euler legs", "euler direct",
    ],
)  # fmt: skip
def test_no_command_fails_at_a_row_without_a_result(pipe, command):
    names = "Qx Qy Qz A0 A1 A-1 x y z".replace(" ", " [mm],") + " [mm]"
    names += (
        ",L1 [mm],L2 [mm],L3 [mm]," + "alpha beta gamma chi_x chi_y chi_z".replace(" ", " [deg],") + " [deg]"
    )
    names += ",omega_x [deg/s],omega_y [deg/s],omega_z [deg/s],q0,qx,qy,qz,Zr_x,Zr_y,Zr_z"
    names += "".join(f",r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
    count = names.count(",") + 1
    rows = pipe(f"{names},status\n{'nan,' * count}invalid\n", command)
    assert {row["status"] for row in rows if "status" in row} <= {"invalid"}
