"""``rodgen set``: what a machine file says of a parameter, and nothing else of it changed."""

import json
import shutil
from pathlib import Path

import pytest

from rodgen import Machine
from rodgen.data.units import ARCSEC

MOUNT = Path(__file__).parents[1] / "examples/machines/mount/machine.toml"


@pytest.fixture
def file(tmp_path):
    return shutil.copy(MOUNT, tmp_path / "m.toml")


def test_a_prior_bounds_and_a_tie_are_written_and_taken_away(file, rodgen_command):
    def done(*arguments):
        code, out, err = rodgen_command("set", file, *arguments, "-o", file)
        assert (code, err) == (0, "")
        return out

    text = file.read_text()
    assert 'bounds = [-inf, "9 arcsec"]' in done(
        "EL.axis.a", "--prior", "0 ± 5 arcsec", "--bounds", "-inf,9arcsec"
    )
    known = Machine.load(file).known["EL.axis.a"]
    assert known.prior == pytest.approx((0, 5 * ARCSEC))
    assert known.bounds == pytest.approx((float("-inf"), 9 * ARCSEC))
    done("EL.axis.a", "--free")
    assert done("EL.axis.a", "--tie", "-2*EL.axis.b") == f"{file}: EL.axis.a = -2*EL.axis.b\n"
    assert Machine.load(file).ties.keys() == {"EL.axis.a"}
    assert json.loads(done("EL.axis.a", "--free", "--json"))["tied_to"] is None
    machine = Machine.load(file)
    assert (machine.known, machine.ties) == ({}, {})
    assert file.read_text().startswith(text.rstrip())  # but for headers of tables that are empty now


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ('EL.axis.a.prior = "0 ± 3 arcsec" # b', '"EL.axis.a" = { prior = "0 ± 12 arcsec" } # b'),
        (
            'EL = { axis = { a = { prior = "0 ± 3 arcsec" } } } # b',
            '"EL.axis.a" = { prior = "0 ± 12 arcsec" } # b',
        ),
        (
            'EL.axis.a.bounds = ["-30 arcsec", inf]\n# x\nEL.axis.a.prior = "0 ± 3 arcsec" # b',
            '# x\n"EL.axis.a" = { prior = "0 ± 12 arcsec" } # b',
        ),
        ("EL.axis.a = { prior = '0 ± 3 arcsec' } # b", 'EL.axis.a = { prior = "0 ± 12 arcsec" } # b'),
    ],
)
def test_an_entry_in_any_form_is_set(file, rodgen_command, entry, expected):
    text = file.read_text() + "\n[known]\n{}\nAZ.axis.b.prior = '0 ± 9 arcsec'\n"
    file.write_text(text.format(entry))
    rodgen_command("set", file, "EL.axis.a", "--prior", "0 ± 12 arcsec", "-o", file)
    assert file.read_text() == text.format(expected)
    assert rodgen_command("set", file, "EL.axis.a", "--free", "-o", file)[0] == 0
    assert Machine.load(file).known.keys() == {"AZ.axis.b"}


def test_a_new_table_leaves_comments_with_the_block_below(file, rodgen_command):
    head, effects = file.read_text().rstrip(), '# above\n# it\n[[effect]]\nname = "tube_flexure"\n'
    file.write_text(f"{head}\n{effects}")
    rodgen_command("set", file, "EL.axis.a", "--tie", "EL.axis.b", "-o", file)
    assert file.read_text() == f'{head}\n\n[ties]\n"EL.axis.a" = "EL.axis.b"\n\n{effects}'


@pytest.mark.parametrize(
    ("statement", "option", "message"),
    [
        (
            '[known]\n"EL.axis.a" = { prior = "0 ± 3 arcsec" } # why',
            ["--tie", "EL.axis.b"],
            "out of [known] first",
        ),
        ('[ties]\n"EL.axis.a" = "EL.axis.b" # why', ["--prior", "0 ± 3 arcsec"], "out of [ties] first"),
    ],
)
def test_a_statement_does_not_replace_one_of_another_kind(file, rodgen_command, statement, option, message):
    text = f"{file.read_text()}\n{statement}\n"
    file.write_text(text)
    code, out, err = rodgen_command("set", file, "EL.axis.a", *option, "-o", file)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert file.read_text() == text


@pytest.mark.parametrize(
    "arguments",
    [
        ["EL.axis.a"],
        ["EL.axis.a", "--free", "--tie", "EL.axis.b"],
        ["EL.axis.a", "--free"],
        ["EL.axis.c", "--prior", "0 ± 5 arcsec"],
        ["EL.axis.a", "--prior", "5"],
        ["EL.axis.a", "--bounds", "9 arcsec,3 arcsec"],
        ["EL.axis.a", "--bounds", "9 arcsec"],
        ["EL.axis.a", "--tie", "EL.axis.a"],
    ],
)
def test_what_cannot_be_said_is_one_line_and_nothing_is_written(file, refuses_command, arguments):
    refuses_command("set", file, *arguments, "-o", file)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sag", "--parameter", "k=arcsec"], "--component or --parameter without --formula"),
        (["sag", "--joint", "EL", "--formula", "k*cos(q"], "effect sag, formula"),
        (["sag", "--joint", "EL", "--formula", "k*cos(q)", "--parameter", "k"], "expected NAME=UNIT"),
        (["tube_flexure", "--formula", "1"], "which the catalogue has"),
        (["sag", "--joint", "EL", "--formula", "k*q", "--parameter", "k=N"], "effect sag"),
    ],
)
def test_a_formula_of_ones_own_that_cannot_be_is_one_line(file, rodgen_command, arguments, message):
    code, out, err = rodgen_command("add", file, *arguments, "-o", file)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert file.read_text() == MOUNT.read_text()
