"""What commands write: no input is replaced, and all outputs of a command appear, or none does."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import run_process

from rodgen.cli import main as cli
from rodgen.cli._values import EditedMachine, InputFile, OutputFile, OutputFolder, OutputTable, StateFile
from rodgen.data.tables import write_columns
from rodgen.errors import InputFileError
from rodgen.files import OutputSet, make_folder, new_folder, open_input, write_file, written_at_once

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"

NEEDED = {"emit": ["--lang", "c"], "exclude": ["--rows", "1"]}
"""Options that commands need, but files and folders."""

TEXTS = {
    *(
        "--base",
        "--code",
        "--column",
        "--component",
        "--date",
        "--for",
        "--formula",
        "--given",
        "--hold",
    ),
    *(
        "--joint",
        "--joints",
        "--noise",
        "--parameter",
        "--prior",
        "--bounds",
        "--tie",
        "--radius",
        "--rows",
        "--run",
    ),
    *("--scheduler", "--set", "--target", "--tip", "--where", "--why", "--effect"),
    *("EFFECT", "KEY", "NAME", "KIND"),
    *("--units", "--ballbar", "import --latitude"),  # read with the files
    "FUNCTION",
    "--help",
}
"""Options and arguments that are neither numbers nor files."""


def leaves(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, list[argparse.Action]]]:
    """Yield the name of each command, and its arguments."""
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not groups:
        yield name.strip(), parser._actions
    for group in groups:
        for member, below in group.choices.items():
            yield from leaves(below, f"{name} {member}")


COMMANDS = dict(leaves(cli._parser()))


def made(action: argparse.Action) -> object:
    """Return what an argument makes of the name of a file."""
    with contextlib.suppress(ValueError, argparse.ArgumentTypeError):
        return action.type("p.html") if callable(action.type) else None
    return None


def name_of(action: argparse.Action) -> str:
    return action.option_strings[-1] if action.option_strings else str(action.metavar)


def those(name: str, *kinds: type) -> list[argparse.Action]:
    return [action for action in COMMANDS[name] if isinstance(made(action), kinds)]


def arguments(name: str, values: dict[argparse.Action, str]) -> list[str]:
    """Return a command line with such values, and others where one must be there."""
    line = [*name.split(), *NEEDED.get(name, [])]
    positions = [action for action in COMMANDS[name] if not action.option_strings]
    last = max((n for n, action in enumerate(positions) if action in values or action.required), default=-1)
    line += [values.get(action, "other.html") for action in positions[: last + 1]]
    for action in COMMANDS[name]:
        needed = action.required and isinstance(made(action), (InputFile, OutputFile, OutputFolder))
        if action.option_strings and (action in values or needed):
            line += [action.option_strings[-1], values.get(action, "other.html")]
    return line


@pytest.mark.parametrize("name", COMMANDS)
def test_each_argument_is_a_file_or_known_to_be_none(name):
    for action in COMMANDS[name]:
        if action.nargs == 0 or action.choices or action.type is not None:
            continue
        title = name_of(action)
        assert title in TEXTS or f"{name} {title}" in TEXTS, f"is {title} of {name} read, written, or a text?"


PAIRS = [
    pytest.param(name, source, output, id=f"{name} {name_of(source)} {name_of(output)}")
    for name in COMMANDS
    for source, output in itertools.product(those(name, InputFile), those(name, OutputFile, OutputFolder))
]


@pytest.mark.thorough("check DATA --output", "fit MACHINE --output", "fit MACHINE --residuals")
@pytest.mark.parametrize(("name", "source", "output"), PAIRS)
def test_no_input_is_replaced_by_whatever_name(name, source, output, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    content = b"not replaced"
    Path("file.html").write_bytes(content)
    Path("link.html").symlink_to("file.html")
    os.link("file.html", "hard.html")
    before = sorted(os.listdir())
    in_place = isinstance(made(output), EditedMachine) and source.dest == "machine"
    for other in ("file.html", "./file.html", "link.html", "hard.html")[3 if in_place else 0 :]:
        line = arguments(name, {source: "file.html", output: other})
        code, out, err = rodgen_command(*line)
        assert (code, out, err.count("\n")) == (2, "", 1), line
        assert ": the input file itself; expected another name for the output" in err
        assert Path("file.html").read_bytes() == content
        assert sorted(os.listdir()) == before


def test_what_standard_input_is_read_from_is_not_replaced(tmp_path):
    pairs = tmp_path / "p.csv"
    shutil.copy(EXAMPLES.parent / "pairs.csv", pairs)
    before = pairs.read_bytes()
    with pairs.open("rb") as stream:
        done = run_process("apply", "solve_axis", "-", "-o", pairs, stdin=stream)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "the input file itself" in done.stderr
    assert pairs.read_bytes() == before


@pytest.mark.parametrize("name", COMMANDS)
def test_a_hyphen_is_no_name_and_may_be_standard_output_of_a_table(
    name, tmp_path, monkeypatch, rodgen_command
):
    monkeypatch.chdir(tmp_path)
    for output in those(name, OutputFile, OutputFolder):
        if isinstance(made(output), OutputTable):
            continue
        code, out, err = rodgen_command(*arguments(name, {output: "-"}))
        assert (code, out) == (2, "")
        assert err == "-: file: standard output; expected a name; './-' is one\n"
        assert os.listdir() == []


@pytest.mark.parametrize("name", COMMANDS)
def test_a_file_has_no_name_of_a_folder(name, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    for output in those(name, OutputFile):
        if not isinstance(output.type("new.html/"), OutputFile):
            continue
        code, out, err = rodgen_command(*arguments(name, {output: "new.html/"}))
        assert (code, out, err.count("\n")) == (2, "", 1), err
        assert err.startswith("new.html/: file: a folder; expected ")
        assert os.listdir() == []


SEVERAL = [name for name in COMMANDS if len(those(name, OutputFile, OutputFolder)) > 1]


@pytest.mark.parametrize("name", SEVERAL)
def test_where_one_output_cannot_be_written_none_is(name, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    Path("regular").touch()
    Path("folder.html").mkdir()
    outputs = those(name, OutputFile, OutputFolder)
    for bad, place in itertools.product(outputs, ("regular/x.html", "folder.html")):
        if place == "folder.html" and isinstance(made(bad), OutputFolder):
            continue
        values = {output: f"{n}.html" for n, output in enumerate(outputs)} | {bad: place}
        code, out, err = rodgen_command(*arguments(name, values))
        assert (code, out, err.count("\n")) == (2, "", 1), err
        assert err.startswith(place)
        assert sorted(os.listdir()) == ["folder.html", "regular"]


@pytest.mark.parametrize("name", SEVERAL)
def test_two_outputs_have_two_names(name, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    one, two = those(name, OutputFile, OutputFolder)[:2]
    code, out, err = rodgen_command(*arguments(name, {one: "new.html", two: "./new.html"}))
    assert (code, out) == (2, "")
    assert err == "./new.html: file: the name of two outputs; expected a name for each\n"
    assert os.listdir() == []


def test_a_state_is_no_other_input():
    assert [name for name in COMMANDS if those(name, StateFile)] == ["watch"]


# real outputs -------------------------------------------------------------------------------------------------------


@pytest.fixture
def work(tmp_path, monkeypatch):
    shutil.copy(EXAMPLES / "rotary_table" / "machine.toml", tmp_path / "m.toml")
    shutil.copy(EXAMPLES / "rotary_table" / "data.csv", tmp_path / "d.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


LATE = {
    "fit": "fit m.toml d.csv -o f.toml --residuals r.csv",
    "simulate": "simulate m.toml d.csv --hidden --seed 1 -o s.csv --truth t.json",
    "emit": "emit m.toml d.csv --lang c -o code",
}


@pytest.mark.thorough("simulate")
@pytest.mark.parametrize("name", LATE)
def test_a_disk_that_fails_at_the_last_file_leaves_none(name, work, monkeypatch, rodgen_command):
    before = sorted(os.listdir())
    written, count, most = os.fsync, [], [1000]

    def counted(descriptor):
        if os.readlink(f"/proc/self/fd/{descriptor}").startswith(str(work)):  # not in the cache of kernels
            count.append(descriptor)
            if len(count) == most[0]:
                raise OSError(28, "No space left on device")
        written(descriptor)

    monkeypatch.setattr("rodgen.files.os.fsync", counted)
    assert rodgen_command(*LATE[name].split())[0] == 0
    new = sorted(set(os.listdir()) - set(before))
    assert new
    for file in new:
        shutil.rmtree(file) if os.path.isdir(file) else os.unlink(file)
    most[0], count[:] = len(count), []
    code, out, err = rodgen_command(*LATE[name].split())
    assert (code, out) == (2, "")
    assert "cannot be written (No space left on device)" in err.splitlines()[-1]
    assert "complete" not in err
    assert sorted(os.listdir()) == before


def test_where_a_disk_fails_between_two_names_the_first_is_said_to_be_complete(
    work, monkeypatch, rodgen_command
):
    replaced = os.replace

    def full(part, final):
        if str(final).endswith("r.csv"):
            raise OSError(5, "Input/output error")
        replaced(part, final)

    before = sorted(os.listdir())
    monkeypatch.setattr("rodgen.files.os.replace", full)
    code, out, err = rodgen_command(*LATE["fit"].split())
    (there,) = set(os.listdir()).difference(before)
    assert (code, out, there) == (2, "", "f.toml")
    assert err.splitlines()[-1].startswith("r.csv: file: cannot be written (Input/output error); expected")
    assert err.endswith("; complete: f.toml\n")


def test_a_reader_that_leaves_early_takes_no_file_along(work, monkeypatch):
    class Gone:
        encoding = "utf-8"

        def write(self, text):
            raise BrokenPipeError

        def flush(self):
            raise BrokenPipeError

    monkeypatch.setattr("sys.stdout", Gone())
    assert cli.main(["fit", "m.toml", "d.csv", "-o", "f.toml"]) == 141
    assert "f.toml" in os.listdir()


def test_the_machine_file_may_be_changed_in_place_and_nothing_else(work, rodgen_command):
    before = Path("m.toml").read_text()
    command = ["set", "m.toml", "C.axis", "--prior", "0 ± 10 arcsec"]
    assert rodgen_command(*command, "-o", "./m.toml")[0] == 0
    assert Path("m.toml").read_text() != before
    data = Path("d.csv").read_bytes()
    code, _, err = rodgen_command("exclude", "m.toml", "d.csv", "--rows", "2", "-o", "d.csv")
    assert (code, err) == (2, "d.csv: file: the input file itself; expected another name for the output\n")
    assert Path("d.csv").read_bytes() == data


def test_a_folder_that_is_read_gets_no_further_part(tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    Path("parts").mkdir()
    Path("parts/a.parquet").write_bytes(b"PAR1")
    for output in ("parts/a.parquet", "parts/b.parquet", "./parts/../parts/b.parquet"):
        code, _, err = rodgen_command("predict", "m.toml", "parts", "d.csv", "-o", output)
        assert (code, err) == (
            2,
            f"{output}: file: a file in the input folder; expected another folder for the output\n",
        )
    code, _, err = rodgen_command("predict", "m.toml", "parts/*.parquet", "d.csv", "-o", "parts/a.parquet")
    assert (code, "the input file itself" in err) == (2, True)
    assert {path.name: path.read_bytes() for path in Path("parts").iterdir()} == {"a.parquet": b"PAR1"}


@pytest.mark.parametrize("results", ["m", "data", ".", "m/../data"])
def test_results_of_a_fleet_stand_apart_from_its_files(results, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    for folder, name in (("m", "a.toml"), ("data", "a.csv"), ("machines", "b.toml")):
        Path(folder).mkdir()
        Path(folder, name).write_text("file")
    code, _, err = rodgen_command("fleet", "machines" if results == "." else "m", "data", "-o", results)
    assert (code, err.count("\n")) == (2, 1)
    assert f"in the folder of results, {results}; expected another folder of results" in err
    assert sorted(map(str, Path().rglob("*.*"))) == ["data/a.csv", "m/a.toml", "machines/b.toml"]


def test_no_link_among_the_results_of_a_fleet_leads_to_its_files(work, rodgen_command):
    Path("r/machines").mkdir(parents=True)
    Path("r/machines/d.json").symlink_to("../../d.csv")
    before = Path("d.csv").read_bytes()
    code, _, err = rodgen_command("fleet", "m.toml", ".", "-o", "r", "--jobs", "1")
    assert (code, err.count("\n")) == (2, 1)
    assert "d.csv: file: in the folder of results" in err
    assert Path("d.csv").read_bytes() == before


def test_a_folder_of_too_long_a_name_is_bad_input(work, rodgen_command):
    code, _, err = rodgen_command("emit", "m.toml", "--lang", "c", "-o", "x" * 300)
    assert (code, err.count("\n")) == (2, 1)


# the set ------------------------------------------------------------------------------------------------------------


def test_files_of_a_set_appear_together(tmp_path):
    with OutputSet() as outputs:
        write_file(tmp_path / "a", b"1")
        with OutputSet():
            make_folder(tmp_path / "deep" / "er")
            write_file(tmp_path / "deep" / "er" / "b", b"2")
        assert [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")] == ["deep"]
        with new_folder(tmp_path / "new") as folder:
            (folder / "c").write_bytes(b"3")
            assert not (tmp_path / "new").exists()
        with written_at_once():
            write_file(tmp_path / "now", b"4")
        assert (tmp_path / "now").exists()
    assert (tmp_path / "new" / "c").read_bytes() == b"3"
    assert (tmp_path / "deep" / "er" / "b").read_bytes() == b"2"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "deep", "new", "now"]
    assert [os.path.basename(file) for file in outputs.completed] == ["new", "now", "a", "b"]


def test_nothing_of_a_set_that_fails_stays(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), OutputSet():  # noqa: PT012
        write_file(tmp_path / "a", b"1")
        make_folder(tmp_path / "deep" / "er")
        write_file(tmp_path / "deep" / "er" / "b", b"2")
        with new_folder(tmp_path / "new") as folder:
            (folder / "c").write_bytes(b"3")
            raise ZeroDivisionError
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"old"}


def test_what_is_read_after_it_was_written_is_not_replaced_either(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(InputFileError, match="the input file itself"), OutputSet():  # noqa: PT012
        write_file(tmp_path / "b", b"2")
        write_file(tmp_path / "a", b"1")
        open_input(str(tmp_path / "a"), "a file").close()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"old"}


def test_sets_of_threads_that_overlap_are_apart(tmp_path):
    begun, ended = threading.Event(), threading.Event()

    def first():
        with OutputSet():
            write_file(tmp_path / "a", b"1")
            begun.wait(10)
        ended.set()

    def second():
        with OutputSet():
            begun.set()
            ended.wait(10)
            write_file(tmp_path / "b", b"2")

    threads = [threading.Thread(target=each) for each in (first, second)]
    with OutputSet():
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(os.listdir(tmp_path)) == ["a", "b"]
    write_file(tmp_path / "c", b"3")
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]


def test_each_of_many_files_is_written_by_several_threads(tmp_path, rodgen_command):
    names = [f"{point}_{x} [mm]" for point in ("rho", "rho_prime") for x in "xyz"]
    columns = {name: [value] for name, value in zip(names, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0), strict=True)}
    (tmp_path / "parts").mkdir()
    for n in range(12):
        write_columns(tmp_path / "parts" / f"{n:02}.parquet", columns | {"angle [deg]": [90.0]})
    line = ["apply", "solve_axis", tmp_path / "parts", "-o", tmp_path / "axes", "--scheduler", "threads=6"]
    assert rodgen_command(*line)[0] == 0
    assert sorted(os.listdir(tmp_path / "axes")) == [f"{n:05}-{n:02}.parquet" for n in range(12)]
