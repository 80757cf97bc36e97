"""Stars of a pointing run that were taken for others are told as such, by the rows that have them."""

import numpy as np
import pytest
from test_pointing import fitted, run_of

from rodgen.calibration.check import check
from rodgen.machines.imports.tpoint_model import mount_machine
from rodgen.machines.mounts import ALTAZ


def run(change):
    """A mount's run whose rows, from 0, give the stars of the rows that `change` names."""
    q, seen = run_of(1, lambda a, e: (0 * a, 0 * a))
    order = np.arange(len(q))
    for row, other in change.items():
        order[row] = other
    return fitted(mount_machine(ALTAZ, "m", 0.6), ALTAZ, q, seen[order])


@pytest.mark.thorough("exchanged", "another one")
@pytest.mark.parametrize(
    ("change", "clauses"),
    [
        (
            {5: 40, 40: 5, 17: 80, 80: 17},
            ["row 5 (from 0) and row 40 (from 0) have each other's stars; row 17 (from 0) and row 80"],
        ),
        ({5: 40}, ["row 5 (from 0) gives the star of row 40 (from 0), at which it does not point"]),
        (
            {5: 40, 40: 77, 77: 5},
            ["row 5 (from 0) saw the star of row 77 (from 0)", "row 40 (from 0) saw the star of row 5"],
        ),
    ],
    ids=["exchanged", "another one", "in a circle"],
)
def test_stars_that_stand_out_are_told(change, clauses):
    fit = run(change)
    assert {one.row for one in fit.gross_readings} == {*change}
    checked = check(fit)
    assert not checked.wrong
    for clause in clauses:
        assert clause in fit.summary()
        assert clause in checked.notes[-1]


@pytest.mark.thorough
def test_a_list_of_stars_that_is_shifted_is_a_wrong_file():
    fit = run({row: row + 1 for row in range(60, 80)})
    expected = "19 rows from row 61 (from 0) to row 79 (from 0) saw the star of the previous row"
    assert f"This looks like a wrong file: stars were misidentified: {expected}" in check(fit).sentence
    found = fit.diagnose()
    assert found.verdict == "cannot_tell"
    assert expected in found.reason


def test_a_star_that_is_logged_again_is_the_same_star():
    q, seen = run_of(1, lambda a, e: (0 * a, 0 * a))
    q[41], seen[41] = q[40] + [0, 100 / 206265], seen[40]  # not settled yet
    fit = fitted(mount_machine(ALTAZ, "m", 0.6), ALTAZ, q, seen)
    assert [one.row for one in fit.gross_readings] == [41]
    assert "misidentified" not in fit.summary()


def test_right_stars_and_other_errors_are_none():
    assert check(run({})).notes == ()
    q, seen = run_of(1, lambda a, e: (0 * a, 0 * a))
    seen[7] = seen[7] @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    fit = fitted(mount_machine(ALTAZ, "m", 0.6), ALTAZ, q, seen)
    assert [one.row for one in fit.gross_readings] == [7]
    assert "misidentified" not in fit.summary()
    assert check(fit).notes == ()
