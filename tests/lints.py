"""Lints of the repository as a whole, for `make check`: what imports what, who writes files, what pages promise."""

from __future__ import annotations

import ast
import functools
import graphlib
import importlib.util
import inspect
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import rodgen
from rodgen import facade
from rodgen.cli.main import _GROUPS

ROOT = Path(__file__).parent.parent


FUNCTIONS = [name for name in rodgen.__all__ if inspect.isfunction(getattr(rodgen, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_docstring_tells_parameters_and_what_comes_back(name: str) -> None:
    function = getattr(rodgen, name)
    text = inspect.getdoc(function)
    parameters = text.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    told = {
        word.strip()
        for line in re.findall(r"^(\w[\w, ]*?)(?: :|$)", parameters, re.MULTILINE)
        for word in line.split(",")
    }
    assert told == set(inspect.signature(function).parameters)
    assert "Returns\n-------\n" in text


def test_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    headings = re.findall(
        r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = re.findall(r"^version: (.*)$", citation, re.MULTILINE)
    assert [headings[0], *cited] == [project["version"], rodgen.__version__]


PACKAGE = ROOT / "src/rodgen"


MODULES = {
    ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): file
    for file in PACKAGE.rglob("*.py")
}


@functools.cache
def imported_names(file: Path) -> set[str]:
    return Imports(file).names


class Imports(ast.NodeVisitor):
    """The names that a module imports, also within functions and for type checkers alone."""

    def __init__(self, file: Path) -> None:
        self.names: set[str] = set()
        self.visit(ast.parse(file.read_text(encoding="utf-8")))

    def visit_Import(self, node: ast.Import) -> None:
        self.names |= {alias.name for alias in node.names}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        self.names |= {f"{node.module}.{alias.name}" for alias in node.names}


def module_of(name: str) -> str | None:
    """Return the module of rodgen that an imported name is, or is in."""
    if name.startswith(("rodgen.generated", "rodgen.derivation")):
        return None  # not in this folder
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name or None


def test_nothing_private_is_imported_from_another_folder() -> None:
    wrong = []
    for module, file in MODULES.items():
        folder = module if file.name == "__init__.py" else module.rpartition(".")[0]
        for name in imported_names(file):
            parts = name.split(".")
            private = next((n for n, part in enumerate(parts) if re.match("_[a-z]", part)), None)
            if parts[0] != "rodgen" or private is None:
                continue
            home = ".".join(parts[:private])
            of_folder = MODULES[home].name == "__init__.py" and f"{folder}.".startswith(f"{home}.")
            if not of_folder:
                wrong.append(f"{module} imports {name}")
    assert wrong == []


WRITERS = {
    "write_text",
    "write_bytes",
    "replace",
    "rename",
    "makedirs",
    "mkdir",
    "copyfile",
    "copy2",
    "savetxt",
}
"""Names of functions that change files."""


OWN_PLACES = {
    "rodgen.files": "the writers themselves",
    "rodgen.codegen.build_cache": "the cache of kernels",
    "rodgen.workbench.start": "a temporary folder",
}


def writes(call: ast.Call) -> bool:
    """Return whether a call changes files past `rodgen.files`."""
    function = call.func
    if isinstance(function, ast.Name):
        modes = [*call.args[1:2], *(each.value for each in call.keywords if each.arg == "mode")]
        return function.id == "open" and any(ast.unparse(mode) not in ("'r'", "'rb'") for mode in modes)
    if isinstance(function, ast.Attribute) and function.attr == "open":  # of a path, or a module such as gzip
        texts = [ast.unparse(each) for each in (*call.args, *(each.value for each in call.keywords))]
        return any(re.fullmatch("'[rbt]*[wax+][rbt+]*'", text) for text in texts)
    if not isinstance(function, ast.Attribute) or function.attr not in WRITERS:
        return False
    # str.replace has the name of os.replace
    return function.attr not in ("replace", "rename") or ast.unparse(function.value) in ("os", "path")


def test_files_are_written_by_the_set_of_outputs_alone() -> None:
    wrong = [
        f"{module}, line {node.lineno}: {ast.unparse(node.func)}"
        for module, file in MODULES.items()
        if module not in OWN_PLACES
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and writes(node)
    ]
    assert wrong == []
    at_once = {"rodgen.cli.open"}  # what is saved on a page
    for module, file in MODULES.items():
        names = {name.rpartition(".")[2] for name in Imports(file).names if name.startswith("rodgen.files.")}
        if module.startswith("rodgen.cli"):
            assert "AtomicFile" not in names, module
            assert ("written_at_once" in names) == (module in at_once), module


def test_the_page_of_the_command_line_lists_the_commands_that_there_are() -> None:
    page = (ROOT / "docs/reference/command_line.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\|.*\| `([\w-]+)` \| (.*) \|$", page, re.MULTILINE)
    rows = {name: text.replace("|", "\\|") for group in _GROUPS.values() for name, (_, text) in group.items()}
    assert {name: text for name, text in listed if name in rows} == rows


def test_pages_are_short_and_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    words = importlib.import_module("words")
    assert words.faults() == []


def test_modules_import_each_other_in_no_circle() -> None:
    graph = {
        module: {target for name in imported_names(file) if (target := module_of(name)) not in (None, module)}
        for module, file in MODULES.items()
    }
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) == len(MODULES)


def _imported_names(path: Path) -> Iterator[tuple[str, str]]:
    """Yield module and name of what a script imports from the package, imports inside functions included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "rodgen":
            yield from ((node.module, alias.name) for alias in node.names)
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.startswith("rodgen."))


@pytest.mark.parametrize("folder", ["answers", "benchmarks", "docs", "examples", "study"])
def test_scripts_import_what_there_is(folder: str) -> None:
    """These run seldom: a name that was moved would be missed until then."""
    names = {(p, *name) for p in sorted((ROOT / folder).rglob("*.py")) for name in _imported_names(p)}
    assert names
    missing = []
    for path, module, name in sorted(names):
        try:
            there = not name or hasattr(importlib.import_module(module), name)
            there = there or bool(importlib.util.find_spec(f"{module}.{name}"))
        except ModuleNotFoundError:
            there = False
        missing += [f"{path.relative_to(ROOT)}: {module} {name}"] * (not there)
    assert not missing


def test_only_the_top_says_which_function_a_method_is() -> None:
    asked = [m for m, file in MODULES.items() if "rodgen.methods.implement" in imported_names(file)]
    assert asked == ["rodgen.facade"]


def test_each_method_that_a_class_names_has_its_function() -> None:
    named = {
        f"{of.name}.{target.id}"
        for file in MODULES.values()
        for of in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(of, ast.ClassDef)
        for each in of.body
        if isinstance(each, ast.Assign) and re.search(r"\b(method|attribute)\(", ast.unparse(each.value))
        for target in ast.walk(each.targets[0])
        if isinstance(target, ast.Name)
    }
    assert named == set(facade.FUNCTIONS)
    for function in facade.FUNCTIONS.values():
        module, _, name = function.rpartition(".")
        assert callable(getattr(importlib.import_module(module), name)), function


def test_each_promise_names_a_check_that_there_is() -> None:
    page = (ROOT / "docs/science/trust.md").read_text(encoding="utf-8")
    tests = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests").glob("*.py"))
    rows = re.findall(r"^\| (?!promise|---)(.*) \| (.*) \|$", page, re.MULTILINE)
    assert len(rows) > 20
    for promise, checks in rows:
        named = re.findall(r"`([^`]+)`", checks)
        assert named, promise
        for check in named:
            if "/" in check:
                assert list(ROOT.glob(check)), check
            elif check.startswith("test_"):
                assert f"def {check}(" in tests, check
            else:  # tests/test_readme.py finds the target
                assert check.startswith(("make ", "rodgen ", "RECORD")), check


def test_the_page_of_benchmarks_is_made_of_what_was_measured() -> None:
    """In a process of its own: benchmarks/ names its modules as other folders do."""
    code = (
        "import json, pathlib, report\n"
        "kept = json.loads(pathlib.Path('results/latest.json').read_text(encoding='utf-8'))\n"
        "page = pathlib.Path('README.md').read_text(encoding='utf-8')\n"
        "assert report.compose(kept) == page"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT / "benchmarks"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_each_frozen_message_is_of_a_test_that_there_is() -> None:
    """The cases of a test are compared where its file is run: `frozen_refusals` of tests/conftest.py."""
    kept = json.loads((ROOT / "answers/frozen/refusals.json").read_text(encoding="utf-8"))
    for file, messages in kept.items():
        text = (ROOT / f"tests/{file}.py").read_text(encoding="utf-8")
        there = set(re.findall(r"^ *def (test_\w+)\(", text, re.MULTILINE))
        assert {re.match(r"\w+", test)[0] for test in messages} <= there, file
