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
ANGLES = "chi_x [deg],chi_y [deg],chi_z [deg]\n170,10,10\n"
PAPER = " --set R=330mm --set r=140mm"


@pytest.fixture
def pipe(capsys, monkeypatch):
    """Return the function that runs commands on a text, each on what the one before wrote."""

    def run(text, *commands):
        for command in commands:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
            code = cli.main([*command.split(), "-"])
            text, err = capsys.readouterr()
            assert code == 0, err
        return list(csv.DictReader(io.StringIO(text)))

    return run


def numbers(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


def test_the_point_of_the_rods_of_a_point_is_that_point(pipe):
    rows = pipe(POINTS, *(f"apply tricept.{name}{PAPER}" for name in ("pose", "direct", "point")))
    Q = ("Qx [mm]", "Qy [mm]", "Qz [mm]")
    found, given = numbers(rows, *Q), numbers(rows, *[f"given {name}" for name in Q])
    np.testing.assert_allclose(found[::2], given[::2], atol=1e-9)
    assert [row["given status"] for row in rows] == ["reachable", "gimbal_lock", "reachable"]


def test_rows_without_a_result_pass(pipe):
    names = ("direct", "legs", "direct")
    rows = pipe(RODS, *(f"apply tricept.{name}{PAPER}" for name in names))
    assert [row["status"] for row in rows] == ["reachable", "invalid"]
    assert [row["given status"] for row in rows] == ["reachable", "unreachable"]
    assert numbers(rows, "A0 [mm]")[0] == pytest.approx(700, abs=1e-9)


def test_rotations_have_the_angles_that_they_are_of(pipe):
    names = ("angles_from_euler", "rotations", "angles_from_quaternion")
    rows = pipe(ATTITUDES, *(f"apply instantaneous_euler.{name}" for name in names))
    chi = ("chi_x [deg]", "chi_y [deg]", "chi_z [deg]")
    np.testing.assert_allclose(numbers(rows, *chi), numbers(rows, *[f"given {n}" for n in chi]), atol=1e-9)
    assert len(rows) == 16
    (row,) = pipe(ANGLES, *(f"apply instantaneous_euler.{name}" for name in names[1:]))
    assert (row["given status"], row["status"]) == ("infeasible", "invalid")
