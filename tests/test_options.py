"""Values of options that look like options, are out of range, or are left aside by a mode."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_outputs import COMMANDS, EXAMPLES

from rodgen import Machine, schedulers
from rodgen.cli import main as cli
from rodgen.cli._console import UsageError
from rodgen.data.units import ARCSEC

TAKES_A_MINUS = {
    "add": ["--formula=-k*cos(q)", "--hold=-k2=0"],
    "set": ["--tie=-AZ.axis.a", "--prior=-3 arcsec ± 1 arcsec", "--bounds=-inf,3 um"],
    "exclude": ["--why=-x", "--where=-x > 3"],
    "fit-axis": ["--point=-1,2,3"],
    "mechanism forward": ["--tool=-.5,2,3mm"],
}


@pytest.mark.parametrize("name", TAKES_A_MINUS)
def test_a_value_may_start_with_a_minus_sign(name):
    rest = {"exclude": ["--rows", "1"] if name == "exclude" else []}.get(name, [])
    positions = [a for a in COMMANDS[name] if not a.option_strings and (a.required or a.metavar == "EFFECT")]
    for text in TAKES_A_MINUS[name]:
        option, _, value = text.partition("=")
        more = [] if option == "--where" else rest
        line = [*name.split(), *["a"] * len(positions), *more]
        apart = vars(cli._parser().parse_args([*line, option, value]))
        joined = vars(cli._parser().parse_args([*line, text]))
        del apart["parser"], joined["parser"]
        assert apart == joined


def test_a_forgotten_value_is_not_taken_from_the_next_option(rodgen_command):
    for line in (
        ["fit", "a", "b", "-o", "--json"],
        ["fit", "a", "b", "-o", "-x"],
        ["add", "m", "e", "--formula", "-o"],
    ):
        code, _, err = rodgen_command(*line)
        assert (code, "expected one argument" in err) == (2, True)


@pytest.mark.parametrize("name", COMMANDS)
def test_debug_is_an_option_of_each_command_and_no_value(name):
    parser = cli._parser(name.split()[0])
    texts = [
        a for a in COMMANDS[name] if a.option_strings and a.type is None and not a.choices and a.nargs is None
    ]
    if texts:
        with pytest.raises(UsageError):
            parser.parse_args([*name.split(), texts[0].option_strings[-1], "--debug"])
    assert any("--debug" in action.option_strings for action in COMMANDS[name])


def test_the_name_of_a_file_may_be_debug(rodgen_command):
    code, _, err = rodgen_command("doctor", "--", "--debug")
    assert (code, "unrecognized arguments: -- --debug" in err) == (2, True)
    options = cli._parser("set").parse_args(["--debug", "set", "m.toml", "K", "--prior=--debug"])
    assert (options.debug, options.prior) == (True, "--debug")
    assert not cli._parser("set").parse_args(["set", "m.toml", "K", "--prior=--debug"]).debug


@pytest.mark.parametrize("port", ["0", "65536", "99999", "-1", "10000000000000000000"])
def test_a_port_is_one_that_there_is(port, rodgen_command):
    code, out, err = rodgen_command("open", "--port", port)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "is not a whole number from 1 to 65535" in err


def test_workers_of_one_address_are_started_once(monkeypatch):
    started = []
    make = schedulers._made

    @contextmanager
    def counted(address):
        started.append(address)
        with make(address) as made:
            yield made

    monkeypatch.setattr(schedulers, "_made", counted)
    with schedulers.workers("threads=2") as some, schedulers.workers("threads=2") as same:
        assert some is same
        with schedulers.workers("threads=1") as other:
            assert other is not some
    assert started == ["threads=2", "threads=1"]


def test_a_fleet_starts_its_scheduler_once(monkeypatch, tmp_path, rodgen_command):
    started = []
    make = schedulers._made

    @contextmanager
    def counted(address):
        started.append(address)
        with make("threads=1") as made:
            yield made

    monkeypatch.setattr(schedulers, "_made", counted)
    (tmp_path / "none.csv").write_text("")
    (tmp_path / "none.toml").write_text("")
    line = [
        "fleet",
        tmp_path / "none.toml",
        tmp_path,
        "-o",
        tmp_path / "results",
        "--scheduler",
        "processes=1",
    ]
    assert rodgen_command(*line)[0] == 2
    assert started == ["processes=1"]


def test_a_fleet_and_a_watch_read_how_often_alarms_come_alike(monkeypatch, rodgen_command):
    asked = []

    def diagnosed(*_, false_alarms, **__):
        asked.append(false_alarms)
        return SimpleNamespace(
            to_dict=dict, summary=str, failed=(), changes=SimpleNamespace(found=()), diagnosed=()
        )

    monkeypatch.setattr("rodgen.calibration.fleet.diagnose_fleet", diagnosed)
    monkeypatch.setattr("rodgen.calibration.fleet.pairs_of", lambda *_: [])
    for text in ("1/year", "0.5/year", "4/year"):
        assert rodgen_command("fleet", "a", "b", "-o", "results", "--false-alarms", text)[0] == 0
    assert rodgen_command("fleet", "a", "b", "-o", "results")[0] == 0
    assert asked == [1, 0.5, 4, 1]
    for bad in ("x", "3", "0/year", "-1/year", "1/mm"):
        errors = {
            rodgen_command(*line, f"--false-alarms={bad}")[2].partition("--false-alarms")[2]
            for line in (["fleet", "a", "b", "-o", "results"], ["watch", "a", "b"])
        }
        assert len({error.partition("; expected what")[0] for error in errors}) == 1
        assert "is not a number above 0 per time, such as 100/h or 1/year" in errors.pop()


def test_a_derivation_without_kernels_is_refused(tmp_path, rodgen_command):
    script = tmp_path / "lens.py"
    script.write_text(
        "from rodgen.symbolic import Derivation\nderivation = Derivation('lens', title='A lens', source='none')\n"
    )
    code, out, err = rodgen_command("kernels", script, "-o", tmp_path / "k2")
    assert (code, out) == (2, "")
    assert "kernels: none: it proves statements only; expected a derivation with kernels" in err
    assert not (tmp_path / "k2").exists()


def test_a_derivation_without_kernels_says_where_they_are(tmp_path, rodgen_command):
    code, _, err = rodgen_command("kernels", "axis_fit", "-o", tmp_path / "k2")
    assert code == 2
    assert "expected those of the solver: 'rodgen kernels axis'" in err


JSON = {
    "fit-axis": [str(EXAMPLES.parent / "pairs.csv"), "--json"],
    "effects": ["backlash", "--json"],
}


@pytest.mark.parametrize("name", JSON)
def test_json_is_all_that_stands_on_standard_output(name, rodgen_command):
    code, out, _ = rodgen_command(*name.split(), *JSON[name])
    assert code == 0
    assert json.loads(out, parse_constant=pytest.fail)


# ``rodgen set``: what a machine file says of a parameter, and nothing else of it changed


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
