"""The examples of README and pages print what is quoted, and everything that they name exists."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import rodgen
from rodgen.cli import main as cli

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
FILES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").glob("*.md")),
]
PAGES = "\n".join(file.read_text(encoding="utf-8") for file in FILES)


def test_examples_print_what_the_readme_says(tmp_path: Path) -> None:
    machine = re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1]
    (tmp_path / "machine.toml").write_text(machine, encoding="utf-8")
    shutil.copy(ROOT / "examples/machines/mount/mmt_2021.csv", tmp_path)
    examples = re.findall(r"```python\n(.*?)```\s+prints\s+```text\n(.*?)```", README, re.DOTALL)
    assert len(examples) == README.count("```python") == 2
    for code, output in examples:
        assert len([line for line in code.splitlines() if line]) <= 12  # ten lines of use, and imports
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout == output
    assert len(list((tmp_path / "build").iterdir())) == 3


def test_every_status_is_explained() -> None:
    rows = re.findall(r"^\| `([A-Z_]+)` \|", README, re.MULTILINE)
    assert rows == [status.name for status in rodgen.AxisStatus]


@pytest.mark.parametrize("page", FILES, ids=lambda file: file.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


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
    assert textwrap.indent(capsys.readouterr().out, "    ") in (ROOT / "docs/tutorial.md").read_text(
        encoding="utf-8"
    )


def test_c_example_prints_what_it_says(compiler: str, tmp_path: Path) -> None:
    page = (ROOT / "docs/c.md").read_text(encoding="utf-8")
    code, output = re.search(r"```c\n(.*?)```.*?```text\n(.*?)```", page, re.DOTALL).groups()
    source, program, emitted = tmp_path / "main.c", tmp_path / "main", ROOT / "generated/c"
    source.write_text(code, encoding="utf-8")
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{emitted}"]
    subprocess.run([compiler, *flags, source, emitted / "axis.c", "-o", program, "-lm"], check=True)
    assert subprocess.run([program], capture_output=True, text=True, check=True).stdout == output


def test_example_pairs_are_those_of_their_script() -> None:
    spec = importlib.util.spec_from_file_location("make_pairs", ROOT / "examples/make_pairs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (ROOT / "examples/pairs.csv").read_text().splitlines()[1:] == module.rows()
