"""The examples of README and pages print what is quoted, and everything that they name exists."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rodgen
from rodgen.cli import main as cli
from rodgen.cli.main import _parser
from rodgen.codegen.scripts import packaged_derivations
from rodgen.machines.machine import Machine

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs/site"))
import outline  # noqa: E402
from links import LINK, prose  # noqa: E402

MOUNT = ROOT / "examples/machines/mount"
README = (ROOT / "README.md").read_text(encoding="utf-8")
FILES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*/*.md")),
]
PAGES = "\n".join(file.read_text(encoding="utf-8") for file in FILES)


@pytest.fixture
def mount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the telescope's machine file and its measurements."""
    for name in ("machine.toml", "mmt_2021.csv"):
        shutil.copy(MOUNT / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.thorough
def test_example_of_solve_axis_prints_what_the_page_says() -> None:
    text = (ROOT / "docs/reference/solve_axis.md").read_text(encoding="utf-8")
    ((code, output),) = re.findall(r"```python\n(.*?)```\s+prints\s+```text\n(.*?)```", text, re.DOTALL)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == output


@pytest.mark.thorough
@pytest.mark.parametrize("example", ["examples/off_by_20_um", "examples/machines/mount"])
def test_diagnosis_of_the_readme_is_what_the_command_prints(
    example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / example, tmp_path / "case")
    monkeypatch.chdir(tmp_path / "case")
    _, _, text = README.partition(f"({example})")
    command, quoted = re.search(r"```text\n\$ rodgen (.*?)\n(.*?)```", text, re.DOTALL).groups()
    assert cli.main(command.split()) == 0
    shown = capsys.readouterr().out
    places = [shown.find(part) for part in quoted.split("...\n")]
    assert len(places) == 3
    assert -1 < places[0] < places[1] < places[2]


@pytest.mark.slow
def test_the_python_of_the_tricept_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs/mechanisms/tricept.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec("".join(re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)), names)
    volume = rodgen.tricept.workspace(rodgen.tricept.PAPER, rodgen.tricept.LEG_LIMITS).volume
    assert f"{volume / 1e6:.3f}e6 mm³" in page
    assert names["found"].outer.shape == (6, 2)


def test_every_status_is_explained() -> None:
    page = (ROOT / "docs/reference/solve_axis.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([A-Z_]+)` \|", page, re.MULTILINE)
    assert rows == [status.name for status in rodgen.AxisStatus]


def anchors(page: Path) -> set[str]:
    """The anchors that code hosts and the site make of a page's headings."""
    headings = [
        line.lstrip("# ")
        for line, is_prose in prose(page.read_text(encoding="utf-8"))
        if is_prose and re.match("#+ ", line)
    ]
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = "".join(line for line, is_prose in prose(page.read_text(encoding="utf-8")) if is_prose)
    for link in LINK.findall(text):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_every_page_and_derivation_is_on_the_site() -> None:
    pages = {file for section in outline.OUTLINE for file in section.pages.values()}
    written = {str(file.relative_to(ROOT)) for file in (ROOT / "docs").rglob("*.md")}
    assert written - pages == {"docs/README.md"}  # a list of the pages, for code hosts
    assert {file for file in pages if file and not (ROOT / file).is_file()} == set()
    assert sorted(outline.NAMES) == packaged_derivations()


def test_targets_of_make_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):.*##", makefile, re.MULTILINE))
    named = set(re.findall(r"(?:`|^    )make ([a-z-]+)", PAGES, re.MULTILINE))
    assert {"demo", "test"} <= named
    assert named <= targets


@pytest.mark.parametrize(
    "command", sorted(set(re.findall(r"^    rodgen ([a-z-]+)|`rodgen ([a-z-]+)", PAGES, re.MULTILINE)))
)
def test_commands_are_there(command: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["".join(command), "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: rodgen ")


def test_tutorial_prints_what_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    assert cli.main(["fit-axis", "examples/pairs.csv", "--loss", "huber"]) == 0
    assert textwrap.indent(capsys.readouterr().out, "    ") in (ROOT / "docs/guides/axis.md").read_text(
        encoding="utf-8"
    )


@pytest.mark.thorough
def test_c_examples_print_what_they_say(compiler: str, mount: Path) -> None:
    page = (ROOT / "docs/guides/c.md").read_text(encoding="utf-8")
    examples = re.findall(r"```c\n(.*?)```.*?```text\n(.*?)```", page, re.DOTALL)
    assert len(examples) == 2
    assert cli.main(re.search(r"^    rodgen (.*)$", page, re.MULTILINE)[1].split()) == 0
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    for code, output in examples:
        header = re.search(r'#include "(.*)\.h"', code)[1]
        folder = ROOT / "generated/c" if (ROOT / f"generated/c/{header}.c").is_file() else mount / "build"
        (mount / "main.c").write_text(code, encoding="utf-8")
        command = [compiler, *flags, f"-I{folder}", "main.c", folder / f"{header}.c", "-o", "main", "-lm"]
        subprocess.run(command, check=True)
        assert subprocess.run(["./main"], capture_output=True, text=True, check=True).stdout == output


@pytest.mark.thorough
def test_examples_in_other_languages_print_what_the_c_does(cpp_compiler: str, mount: Path) -> None:
    page = (ROOT / "docs/guides/c.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```cpp\n(.*?)```", page, re.DOTALL)
    output = re.search(r"```text\n(AZ .*?)```", page, re.DOTALL)[1]
    command = re.search(r"^    rodgen (.*)$", page, re.MULTILINE)[1].replace("--lang c ", "--lang cpp ")
    assert cli.main(command.split()) == 0
    (mount / "main.cpp").write_text(code, encoding="utf-8")
    subprocess.run([cpp_compiler, "-std=c++17", "-O0", "-Ibuild", "main.cpp", "-o", "main"], check=True)
    assert subprocess.run(["./main"], capture_output=True, text=True, check=True).stdout == output
    if not shutil.which("octave-cli"):
        return
    (code,) = re.findall(r"```matlab\n(.*?)```", page, re.DOTALL)
    assert cli.main(command.replace("--lang cpp ", "--lang matlab ").split()) == 0
    octave = ["octave-cli", "--norc", "--quiet", "--eval", code]
    assert subprocess.run(octave, cwd="build", capture_output=True, text=True, check=True).stdout == output


def test_own_effect_is_fitted_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs/guides/own_effect.md").read_text(encoding="utf-8")
    shutil.copytree(ROOT / "examples/off_by_20_um", tmp_path / "case")
    monkeypatch.chdir(tmp_path / "case")
    effect = re.search(r"```toml\n(.*?)```", page, re.DOTALL)[1]
    Path("own.toml").write_text(Path("machine.toml").read_text(encoding="utf-8") + effect, encoding="utf-8")
    examples = re.findall(r"^    rodgen ([^\n]*)\n\n```text\n(.*?)```", page, re.DOTALL | re.MULTILINE)
    assert len(examples) == 2
    for command, quoted in examples:
        assert cli.main(command.split()) == 0
        printed = capsys.readouterr().out
        for line in quoted.splitlines():
            assert line in printed
    for command in re.findall(r"`rodgen ((?:plan|emit) own.toml .*?)`", page, re.DOTALL):
        assert cli.main(command.split()) == 0


@pytest.mark.parametrize("name", ["pairs", "poses"])
def test_an_example_is_that_of_its_script(name: str) -> None:
    spec = importlib.util.spec_from_file_location(f"make_{name}", ROOT / f"examples/make_{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (ROOT / f"examples/{name}.csv").read_text().splitlines()[1:] == module.rows()


def commands(page: Path) -> list[str]:
    """The commands of a page to be pasted, without what a shell does with them."""
    return re.findall(r"^(?:    |\$ )rodgen ([^\n>|#]+)", page.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", [file for file in FILES if commands(file)], ids=lambda file: file.stem)
def test_commands_of_the_pages_have_arguments_that_there_are(page: Path) -> None:
    for words in commands(page):
        arguments = shlex.split(words)
        assert callable(_parser(arguments[0]).parse_args(arguments).run), words


def test_effect_is_added_as_the_page_says(mount: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs/reference/command_line.md").read_text(encoding="utf-8")
    example = r"^    rodgen (add [^\n]*)\n\n```text\n(.*?)  \.\.\.\n```"
    command, quoted = re.search(example, page, re.MULTILINE | re.DOTALL).groups()
    (mount / "machine.toml").rename("mount.toml")
    (mount / "mmt_2021.csv").rename("stars.csv")
    assert cli.main(command.split()) == 0
    assert capsys.readouterr().out.startswith(quoted)


def test_table_of_corrections_that_the_page_makes_corrects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs/reference/command_line.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    gantry = Machine.load(ROOT / "examples/machines/ballbar_gantry/machine.toml")
    gantry = replace(gantry, estimate=()).add("squareness", joint="Y", hold={"a": 0.02, "b": 0.0})
    gantry.add("scale", joint="X", hold={"k": 5e-5}).emit("numpy", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    exec(code, {})
    x, y, z, dx, dy, dz, status, left = np.loadtxt("table.csv", delimiter=",", skiprows=1).T
    tilt = np.radians(-0.02)  # of Y, towards X

    def place(x, y, z):
        return np.stack([x * (1 + 5e-5) + y * np.sin(tilt), y * np.cos(tilt), z])

    assert not status.any()
    assert left.max() < 1e-8
    assert np.abs(place(x, y, z) - [x, y, z]).max() > 0.2
    assert np.abs(place(x + dx, y + dy, z + dz) - [x, y, z]).max() < 1e-8


@pytest.mark.slow
def test_plan_of_the_telescope_is_what_the_page_says(mount: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs/guides/plan.md").read_text(encoding="utf-8")
    command = re.search(r"^    rodgen (plan .*)$", page, re.MULTILINE)[1]
    quoted = page[page.index("    What to measure") : page.index("The plan first lists")]
    assert cli.main(command.replace("data.csv", "mmt_2021.csv").split()) == 0
    printed = capsys.readouterr().out
    parts = [part.strip() for part in re.split(r"^ *\.\.\.\n", textwrap.dedent(quoted), flags=re.MULTILINE)]
    places = [printed.find(part) for part in parts]
    assert len(parts) == 4
    assert -1 < places[0] < places[1] < places[2] < places[3]
