"""Fixtures that several test modules share: the emitted C, compiled when it is used, and the installed gufuncs."""

from __future__ import annotations

import ctypes
import functools
import importlib.metadata
import importlib.util
import json
import os
import re
import shutil
import subprocess
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from octave import Octave

# Threads of the linear algebra would wait for each other in a loop: the test processes have the cores already.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ.get("OPENBLAS_NUM_THREADS", "1")
os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"]

# Where nothing was compiled NumPy is asked for, so that the notice about it is in no test's output but its own.
if not any("_gufuncs" in file.name for file in importlib.metadata.files("rodgen") or ()):
    os.environ.setdefault("RODGEN_CPU", "numpy")

import rodgen.generated

collect_ignore = ["linuxcnc_driver.py"]
"""Run by LinuxCNC with the Python of the system: only that has what it imports."""

C_FOLDER = Path(rodgen.generated.__file__).parent / "c"
C_MODULES = sorted(path.stem for path in C_FOLDER.glob("*.c"))
C_WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
CPP_WARNINGS = ["-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror"]
LEVELS = ("baseline", "avx2", "avx512")
OPTIMISED = {"test_machine_jacobians", "test_rows"}  # every effect's values and derivatives, every construct


def group_of(derivation: str) -> str:
    """The group of the tests that execute a derivation; the parts of the Euler angles execute the first of them."""
    return "instantaneous_euler" if derivation.startswith("instantaneous_euler") else derivation


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let messages be frozen anew."""
    parser.addoption("--freeze", action="store_true", help="freeze the messages of refused inputs anew")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse what would lose messages: each of several processes would write the file with its own ones."""
    if config.option.freeze and getattr(config.option, "numprocesses", None):
        raise pytest.UsageError("--freeze: together with -n; expected one process, which writes the file")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give a file to one of several test processes, so that its fixtures and derivations are made once.

    Groups with many thorough tests begin first, so that no process waits for the other at the end.

    Of a grid whose mark names the quick cases, the others are slow. Cases that the mark `thorough` names are not
    thorough themselves.
    """
    if not config.getoption("lf", False) and not any("::" in argument for argument in config.args):
        for item in items:  # before -k and -m: each file's tests are all here
            COLLECTED[item.path.stem].add(item.name)
    for item in items:
        quick = item.get_closest_marker("quick")
        if quick is not None and item.callspec.id not in quick.args:
            item.add_marker(pytest.mark.slow)
        thorough = item.get_closest_marker("thorough")
        if thorough is not None and thorough.args and item.callspec.id in thorough.args:
            item.own_markers.remove(thorough)
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    if getattr(config.option, "loadgroup", False):
        groups = [item.get_closest_marker("xdist_group").args[0] for item in items]
        long = Counter(
            group for group, item in zip(groups, items, strict=True) if item.get_closest_marker("thorough")
        )
        order = sorted(range(len(items)), key=lambda n: -long[groups[n]])
        items[:] = [items[n] for n in order]


@pytest.fixture(scope="module", autouse=True)
def quickly_compiled(request: pytest.FixtureRequest) -> Iterator[None]:
    """Compile models without optimisation: in a tenth of the time, of which a test of few rows needs the most.

    `OPTIMISED` modules, commands in processes of their own and `make test-slow` have what a user has.
    """
    if request.config.option.markexpr == "slow" or request.path.stem in OPTIMISED:
        yield
        return
    from rodgen.codegen import rows

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows, "FLAGS", tuple("-O0" if flag == "-O2" else flag for flag in rows.FLAGS))
        yield


@pytest.fixture(scope="session")
def compiler() -> str:
    """The C compiler; tests that need one are skipped where there is none."""
    found = shutil.which(os.environ.get("CC", "cc"))
    if found is None or not _compiles(found):
        pytest.skip("no C compiler; set CC to one")
    return found


def kept_files(cache: Path) -> list[Path]:
    """Return the libraries and texts in a cache, without the notes of the libraries."""
    return [path for path in cache.iterdir() if path.suffix != ".json"]


def _compiles(compiler: str) -> bool:
    """Tell whether it makes a program, of an empty one."""
    command = [compiler, "-x", "c", "-", "-o", os.devnull]
    done = subprocess.run(command, input="int main(void) { return 0; }", text=True, capture_output=True)
    return done.returncode == 0


def compile_shared(
    compiler: str, sources: list[Path], library: Path, *flags: str, warnings: Sequence[str] = C_WARNINGS
) -> Path:
    """Compile into a shared library; an error shows the compiler's words."""
    unfinished = library.with_name(f"{library.name}.{os.getpid()}")
    command = [
        compiler,
        *warnings,
        *flags,
        "-fPIC",
        "-shared",
        *map(str, sources),
        "-o",
        str(unfinished),
        "-lm",
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    os.replace(unfinished, library)  # another test process may make the same one
    return library


@pytest.fixture(scope="session")
def emitted_c(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ctypes.CDLL]:
    """The emitted C of a module alone, as a library: no Python, no NumPy, no flag but those of a careful user."""
    folder = tmp_path_factory.mktemp("emitted_c")

    @functools.cache
    def library(module: str) -> ctypes.CDLL:
        made = compile_shared(compiler, [C_FOLDER / f"{module}.c"], folder / f"{module}.so", "-O1")
        return ctypes.CDLL(str(made))

    return library


@pytest.fixture(scope="session")
def cpp_compiler() -> str:
    """The C++ compiler; tests that need one are skipped where there is none."""
    found = shutil.which(os.environ.get("CXX", "c++"))
    if found is None:
        pytest.skip("no C++ compiler; set CXX to one")
    return found


@pytest.fixture(scope="session")
def octave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Octave]:
    """GNU Octave; tests that need it are skipped where there is none."""
    found = shutil.which("octave-cli")
    if found is None:
        pytest.skip("no octave-cli")
    running = Octave(found, tmp_path_factory.mktemp("octave"))
    yield running
    running.close()


@pytest.fixture(scope="session")
def gufuncs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ModuleType]:
    """The installed extension once for each instruction set that this processor has, by its name.

    The extension chooses when it is imported, and Python imports a file once; so each is a copy.
    """
    spec = importlib.util.find_spec("rodgen._gufuncs")
    if spec is None or spec.origin is None:
        return {}
    modules = {}
    with pytest.MonkeyPatch.context() as patch:
        for level in LEVELS:
            copy = tmp_path_factory.mktemp(level) / Path(spec.origin).name
            shutil.copy(spec.origin, copy)
            patch.setenv("RODGEN_CPU", level)
            copied = importlib.util.spec_from_file_location("_gufuncs", copy)
            assert copied is not None
            assert copied.loader is not None
            module = importlib.util.module_from_spec(copied)
            copied.loader.exec_module(module)
            if module.instruction_set == level:  # a processor that has less gives less
                modules[level] = module
    return modules


@pytest.fixture
def rodgen_command(capsys):
    """Run a command; return its exit code, and what it printed on standard output and standard error."""

    from rodgen.cli import main as cli

    def run(*arguments):
        code = cli.main([str(argument) for argument in arguments])
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run


REFUSALS = Path(__file__).parents[1] / "answers" / "frozen" / "refusals.json"
"""What is said of each input that is refused: by file of tests, and by test with its case."""

COLLECTED: defaultdict[str, set[str]] = defaultdict(set)
"""The tests with their cases of each file that was collected as a whole."""


def test_of(key: str) -> str:
    """Return the test of a frozen message: the second one of a test is numbered, and so on."""
    return re.sub(r" #\d+$", "", key)


@pytest.fixture(scope="session")
def frozen_refusals(request: pytest.FixtureRequest) -> Iterator[dict[str, dict[str, str]]]:
    """All frozen messages; at the end none is of a test that is gone. With --freeze what was asked is written."""
    kept: dict[str, dict[str, str]] = json.loads(REFUSALS.read_text(encoding="utf-8"))
    yield kept
    gone = [
        (file, key) for file in COLLECTED for key in kept.get(file, ()) if test_of(key) not in COLLECTED[file]
    ]
    if request.config.option.freeze:
        for file, key in gone:
            del kept[file][key]
        text = json.dumps(kept, indent=1, sort_keys=True, ensure_ascii=False)
        REFUSALS.write_text(f"{text}\n", encoding="utf-8")
    else:
        assert gone == [], "messages of tests that are gone: pytest --freeze the files as a whole"


@pytest.fixture
def is_frozen(
    request: pytest.FixtureRequest, tmp_path: Path, frozen_refusals: dict[str, dict[str, str]]
) -> Iterator[Callable[[str], None]]:
    """Assert that a message is one printable line, and the frozen one of this test and case; and all are asked."""

    def check(message: str) -> None:
        message = message.replace(str(tmp_path), "FOLDER").replace(str(Path(__file__).parents[1]), "ROOT")
        message = re.sub(rf"{tempfile.gettempdir()}/([^ /:]+/)*", "FOLDER/", message)
        message = re.sub(r" \(choose from .*", "", message)  # which Python quotes otherwise in each version
        message = re.sub(r"(damaged Parquet data) \(.*\);", r"\1;", message)  # in the words of Arrow
        assert message.isprintable()
        key = request.node.name
        count = len(asked)
        key += f" #{count + 1}" * (count > 0)
        asked.append(key)
        if request.config.option.freeze:
            of_file[key] = message
        assert message == of_file.get(key), (
            f"look at the message, and freeze it: pytest --freeze {request.node.nodeid}"
        )

    asked: list[str] = []
    of_file = frozen_refusals.setdefault(request.node.path.stem, {})
    failed = request.session.testsfailed
    yield check
    if request.session.testsfailed == failed:
        left = [key for key in of_file if test_of(key) == request.node.name and key not in asked]
        if request.config.option.freeze:
            for key in left:
                del of_file[key]
        else:
            assert left == [], f"messages that are not asked: pytest --freeze {request.node.nodeid}"


@pytest.fixture
def refuses(is_frozen: Callable[[str], None]):
    """Call a function with what it must refuse, in the frozen sentence; another type of error is named."""
    from rodgen.errors import RodgenError

    def call(
        function: Callable[..., Any], *arguments: Any, raises: type[Exception] = RodgenError, **options: Any
    ) -> None:
        with pytest.raises(raises) as error:
            function(*arguments, **options)
        kind = "" if isinstance(error.value, RodgenError) else f"{error.type.__name__}: "
        is_frozen(f"{kind}{error.value}")

    return call


@pytest.fixture
def refuses_command(is_frozen: Callable[[str], None], rodgen_command, tmp_path: Path):
    """Call a command with what it must refuse, in the frozen sentence: code 2, one line, no file made or changed."""

    def files() -> dict[Path, bytes]:
        return {
            file: file.read_bytes()
            for file in tmp_path.rglob("*")
            if file.is_file() and file.suffix != ".pyc"
        }

    def call(*arguments: Any, code: int = 2) -> None:
        before = files()
        found, out, err = rodgen_command(*arguments)
        assert (found, out) == (code, "")
        is_frozen(err.removesuffix("\n"))
        assert files() == before

    return call
