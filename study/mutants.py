"""Measure how many small faults in the code the tests find: change one place, run the tests that reach it, count.

`make mutants` runs it in three steps, each of which writes a file into build/mutants:

map
    Run the tests of `TESTS` once under coverage: which test reaches which line, and what it costs.
run
    Draw places of `PACKAGES` at random, change each as cosmic-ray would, and run the tests that reach it.
table
    Print the shares found, and the changes that no test noticed.

The draw ranks places by a hash of the seed, their definition and its text. So two versions of the code give the same
places wherever a definition is the same in both, and `run --only RESULTS` repeats those of another version.
A changed file is put back after its tests; nothing else may use the checkout meanwhile.
"""

from __future__ import annotations

import argparse
import ast
import collections
import contextlib
import dataclasses
import difflib
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path

import coverage
import parso
import pytest
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider
from cosmic_ray.util import restore_contents

HOME = Path(__file__).resolve().parents[1]
OUT = HOME / "build" / "mutants"
PACKAGES = ("codegen", "statistics", "machines")
NOT_HERE = {
    "thresholds.py"
}  # `make study` judges these numbers: another one is better or worse, seldom wrong

# The tests closest to the packages; others reach them, too, through whole fits and diagnoses, at many times the cost.
TESTS = """
    codegen own_equations rows tape
    statistics compare correlation ladder noise unexplained
    catalogue cli_diagnose cli_machines emit formula machine_file machine_jacobians machine_models parallel_machines
    predict simulate
""".split()
OF_A_TEST = 5.0  # s of processor time: a test that needs more is not used
OF_A_MUTANT = 12.0  # s of processor time for the tests of a mutant: those beyond are not run (--seconds)
OF_A_PROCESS = 3.0  # s of tests that share one process
OF_A_FILE = 0.3  # s to import a test file and what it needs

CANNOT_RUN = 70  # the exit code of a process in which pytest itself failed


@dataclasses.dataclass(frozen=True)
class Mutant:
    """One change: the operator of cosmic-ray and its occurrence in the file, and where that is."""

    package: str
    file: str
    definition: str
    line: int
    lines: tuple[int, int]  # of the statement
    operator: str
    occurrence: int
    key: str  # the same in every version in which the definition is the same


# which test reaches which line ---------------------------------------------------------------------------------


def _spent() -> float:
    """Return the processor time of this process and of its children that have ended, in seconds."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


class Recorder:
    """A pytest plugin: name the running test to coverage, measure it, and end it where it costs too much."""

    def __init__(self, measured: coverage.Coverage) -> None:
        self.measured = measured
        self.tests: dict[str, dict] = {}
        self.fixtures: dict[str, float] = {}
        self.current = ""
        self.too_long: set[str] = set()  # the other cases of such a test are skipped
        signal.signal(signal.SIGPROF, self._too_long)

    def _too_long(self, *_) -> None:
        self.too_long.add(self.current.partition("[")[0])
        pytest.fail(f"more than {OF_A_TEST} s of processor time")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        self.current = item.nodeid
        self.tests[item.nodeid] = {"fixtures": [], "passed": True}
        self.measured.switch_context(item.nodeid)
        start, of_fixtures = _spent(), sum(self.fixtures.values())
        signal.setitimer(signal.ITIMER_PROF, OF_A_TEST)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            shared = sum(self.fixtures.values()) - of_fixtures
            self.tests[item.nodeid]["seconds"] = _spent() - start - shared
            self.tests[item.nodeid]["fixtures"] = sorted(
                name for name in map(self._name, self._definitions(item)) if name in self.fixtures
            )
            self.measured.switch_context("")

    def pytest_runtest_setup(self, item):
        if item.nodeid.partition("[")[0] in self.too_long:
            pytest.skip("another case takes too long")

    @staticmethod
    def _definitions(item):
        info = getattr(item, "_fixtureinfo", None)
        return [d for found in info.name2fixturedefs.values() for d in found] if info else []

    @staticmethod
    def _name(definition) -> str:
        return f"fixture {definition.baseid}::{definition.argname}"

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        if fixturedef.scope == "function":
            return (yield)
        name, start = self._name(fixturedef), _spent()
        self.fixtures.setdefault(name, 0.0)
        inner = sum(self.fixtures.values())
        self.measured.switch_context(name)
        try:
            return (yield)
        finally:
            inner = sum(self.fixtures.values()) - inner
            self.fixtures[name] += _spent() - start - inner
            self.measured.switch_context(self.current)

    def pytest_runtest_logreport(self, report):
        if report.nodeid in self.tests and not report.passed:
            self.tests[report.nodeid]["passed"] = False


def make_map() -> None:
    """Run the tests under coverage, and write which of them reach each line."""
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "results.jsonl").unlink(missing_ok=True)
    cache = _empty(OUT / "cache")
    os.environ |= {"RODGEN_CACHE": str(cache), "OPENBLAS_NUM_THREADS": "1", "PYTEST_ADDOPTS": ""}
    folders = [str(HOME / "src" / "rodgen" / name) for name in PACKAGES]
    data = OUT / "coverage"
    measured = coverage.Coverage(data_file=str(data), source=folders, config_file=False, branch=False)
    recorder = Recorder(measured)
    files = [f"tests/test_{name}.py" for name in TESTS] + [str(folder) for folder in folders]
    arguments = ["-q", "-n0", "-m", "not slow", "-p", "no:cacheprovider", "--tb=line", *files]
    measured.erase()
    measured.start()
    pytest.main(arguments, plugins=[recorder])
    measured.stop()
    measured.save()
    reached: dict[str, dict[int, list[str]]] = {}
    for file in measured.get_data().measured_files():
        lines = measured.get_data().contexts_by_lineno(file)
        reached[str(Path(file).relative_to(HOME))] = {n: sorted(set(c)) for n, c in lines.items()}
    tests = {name: t for name, t in recorder.tests.items() if t["passed"]}
    written = {"tests": tests, "fixtures": recorder.fixtures, "reached": reached}
    (OUT / "map.json").write_text(json.dumps(written), encoding="utf-8")
    print(f"{len(tests)} tests of {len(recorder.tests)}, {_spent():.0f} s of processor time")


# the places ------------------------------------------------------------------------------------------------------


def _family(operator: str) -> str:
    """Return what an operator replaces, so that a place with many replacements is not drawn more often."""
    for prefix in ("ReplaceBinaryOperator", "ReplaceComparisonOperator", "ReplaceUnaryOperator"):
        if operator.startswith(prefix):
            return prefix
    return operator


def _wanted(operator: str) -> bool:
    """Leave out what needs names, and shifts and bits in the place of arithmetic, which any test notices."""
    return not operator.startswith("Variable") and not operator.endswith(("RShift", "LShift", "BitXor"))


def _ancestors(node) -> Iterator:
    while node is not None:
        yield node
        node = node.parent


def _statements(text: str) -> list[tuple[int, int]]:
    """Return the first and last line of each simple statement, and of the head of each compound one."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt | ast.excepthandler):
            first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
            body = getattr(node, "body", None)
            found.append((first, max(node.lineno, body[0].lineno - 1) if body else node.end_lineno or first))
    return found


def _is_syntax(node) -> bool:
    """Tell whether a node is part of an annotation or an import, or the star of a signature: no place for a fault."""
    if node.parent is not None and node.parent.type in {"parameters", "lambdef"} and node.type == "operator":
        return True
    for inner, outer in zip(_ancestors(node), _ancestors(node.parent), strict=False):
        if outer.type in {"import_from", "import_name"}:
            return True
        if outer.type == "annassign" and outer.children[1] is inner:
            return True
        if outer.type == "tfpdef":
            return True
        if outer.type == "funcdef" and outer.annotation is inner:
            return True
    return False


def _mutants_of(path: Path, package: str) -> list[Mutant]:
    """Return all changes of a file: one for each place and family, whichever replacement the hash ranks first."""
    text = path.read_text(encoding="utf-8")
    tree = parso.parse(text)
    rows, statements = text.splitlines(keepends=True), _statements(text)
    nodes: list = []

    def walk(node) -> None:  # the order of cosmic-ray's visitor, on which occurrences count
        nodes.append(node)
        for child in getattr(node, "children", []):
            walk(child)

    walk(tree)
    file = str(path.relative_to(HOME))
    found: dict[tuple, list[Mutant]] = collections.defaultdict(list)
    twins: collections.Counter = collections.Counter()
    for name in OperatorProvider():
        if not _wanted(name):
            continue
        operator = OperatorProvider()[name]()
        occurrence = 0
        for node in nodes:
            for start, _ in operator.mutation_positions(node):
                occurrence += 1
                if _is_syntax(node) or (name == "RemoveDecorator" and "cache" in node.get_code()):
                    continue
                scopes = [a for a in _ancestors(node.parent) if a.type in {"funcdef", "classdef"}]
                functions = [a for a in scopes if a.type == "funcdef"]
                definition = ".".join(a.name.value for a in reversed(scopes))
                lines = min((x for x in statements if x[0] <= start[0] <= x[1]), key=lambda x: x[1] - x[0])
                if functions:
                    body, first = functions[-1].get_code().strip(), functions[-1].start_pos[0]
                else:
                    body, first = "".join(rows[lines[0] - 1 : lines[1]]), lines[0]
                offset = start[0] - first
                place = (file, definition, body, offset, start[1], _family(name))
                key = hashlib.sha256(repr((*place, name)).encode()).hexdigest()[:16]
                twins[key] += 1
                key += f"-{twins[key]}"
                found[place].append(
                    Mutant(package, file, definition, start[0], lines, name, occurrence - 1, key)
                )
    return [min(mutants, key=lambda m: m.key) for mutants in found.values()]


def draw(count: int, seed: int) -> list[Mutant]:
    """Return `count` places of each package, drawn at random."""
    chosen = []
    for package in PACKAGES:
        every = [
            mutant
            for path in sorted((HOME / "src" / "rodgen" / package).rglob("*.py"))
            if path.name not in NOT_HERE
            for mutant in _mutants_of(path, package)
        ]
        every.sort(key=lambda m: hashlib.sha256(f"{seed} {m.key}".encode()).digest())
        print(f"{package}: {len(every)} places", file=sys.stderr)
        chosen += every[:count]
    return chosen


# the tests of one change -------------------------------------------------------------------------------------------


class Selection:
    """Which tests to run for a mutant, and in which order, from what `make_map` wrote."""

    def __init__(self) -> None:
        written = json.loads((OUT / "map.json").read_text(encoding="utf-8"))
        self.tests, self.fixtures = written["tests"], written["fixtures"]
        self.reached = {
            f: {int(n): set(c) for n, c in lines.items()} for f, lines in written["reached"].items()
        }
        self.users = collections.defaultdict(set)
        for name, test in self.tests.items():
            for fixture in test["fixtures"]:
                self.users[fixture].add(name)

    def _reaching(self, file: str, lines: Sequence[int]) -> set[str]:
        contexts = set().union(*(self.reached.get(file, {}).get(n, set()) for n in lines))
        return {t for c in contexts for t in self.users.get(c, {c})} & self.tests.keys()

    def batches(self, mutant: Mutant, most: float) -> tuple[list[list[str]], int]:
        """Return the tests in processes, cheapest first, and how many are left out beyond `most` seconds."""
        tests = self._reaching(mutant.file, range(mutant.lines[0], mutant.lines[1] + 1))
        if not tests:  # executed when the file is imported
            lines = self.reached.get(mutant.file, {})
            if not any(n in lines for n in range(mutant.lines[0], mutant.lines[1] + 1)):
                return [], 0
            tests = self._reaching(mutant.file, list(lines))
        files = collections.defaultdict(list)
        for test in tests:
            files[test.partition("::")[0]].append(test)
        groups = []
        for chosen in files.values():
            cost = OF_A_FILE + sum(
                self.fixtures[f] for f in {f for t in chosen for f in self.tests[t]["fixtures"]}
            )
            first, others, seen = [], [], set()
            for test in sorted(chosen, key=lambda t: (self.tests[t]["seconds"], t)):
                function = test.partition("[")[0]
                (others if function in seen else first).append(test)
                seen.add(function)
            for part in (first, others):
                seconds = sum(self.tests[t]["seconds"] for t in part)
                if part:
                    groups.append((part is others, cost + seconds, part))
        batches, spent, left, last = [], 0.0, 0, OF_A_PROCESS
        for _, seconds, part in sorted(groups, key=lambda g: g[:2]):
            while part and spent + seconds > most:  # the most expensive are left out
                seconds -= self.tests[part.pop()]["seconds"]
                left += 1
            if not part:
                continue
            if last + seconds > OF_A_PROCESS:
                batches.append([])
                last = 0.0
            batches[-1] += part
            last += seconds
            spent += seconds
        return batches, left

    def usual(self, tests: Sequence[str]) -> float:
        """Return the usual processor time of tests, in seconds."""
        fixtures = {f for t in tests for f in self.tests[t]["fixtures"]}
        return sum(self.tests[t]["seconds"] for t in tests) + sum(self.fixtures[f] for f in fixtures)


class Watch:
    """A pytest plugin: write which test runs, so that a loop can be told from a batch that takes long."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def pytest_runtest_logstart(self, nodeid, location):
        self.path.write_text(json.dumps([nodeid, time.process_time()]), encoding="utf-8")

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.path.write_text(json.dumps([report.nodeid, str(report.longrepr)[-300:]]), encoding="utf-8")


def _run(tests: list[str], limit: float, folder: Path) -> tuple[int, float]:
    """Run tests in a process of their own; return its exit code (negative: a signal) and its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        code = CANNOT_RUN
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 3))
            with open(folder / "output", "w") as shown:
                os.dup2(shown.fileno(), 1)
                os.dup2(shown.fileno(), 2)
            options = f"-x -q -n0 --tb=short -p no:cacheprovider --basetemp={folder / 'tmp'}".split()
            code = int(pytest.main([*options, *tests], plugins=[Watch(folder / "test")]))
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    end = time.monotonic() + 60 + 8 * limit  # wall time: a test that waits
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.02)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return os.waitstatus_to_exitcode(status), seconds


def judge(mutant: Mutant, selection: Selection, most: float, first: str | None) -> dict:
    """Apply one change, run its tests, that which found it in another version first, and return what came of it."""
    path = HOME / mutant.file
    text = path.read_text(encoding="utf-8")
    changed = mutate_code(text, OperatorProvider()[mutant.operator](), mutant.occurrence)
    assert changed is not None, mutant
    shown = list(difflib.ndiff(text.splitlines(), changed.splitlines()))
    old, new = ("\n".join(line[2:] for line in shown if line.startswith(sign)) for sign in ("- ", "+ "))
    result = dataclasses.asdict(mutant) | {"old": old, "new": new, "limit": most, "seconds": 0.0}
    batches, left = selection.batches(mutant, most)
    if not batches:
        return result | {"outcome": "survived", "tests": 0, "left": left}
    if first in selection.tests:
        batches.insert(0, [str(first)])
    folder = _empty(OUT / "run")
    shutil.copytree(OUT / "cache", folder / "cache", copy_function=os.link)
    os.environ["RODGEN_CACHE"] = str(folder / "cache")
    result |= {"tests": 0, "left": left}
    with restore_contents(path):
        path.write_text(changed, encoding="utf-8")
        for tests in batches:
            limit = 20 + 5 * selection.usual(tests)
            (folder / "test").unlink(missing_ok=True)
            code, seconds = _run(tests, limit, folder)
            result["seconds"] += seconds
            result["tests"] += len(tests)
            if code == 0:
                continue
            written = folder / "test"
            noted = written.read_text(encoding="utf-8") if written.exists() else '["import", ""]'
            test, said = json.loads(noted)
            if code == -signal.SIGKILL:  # a test that waits
                return result | {"outcome": "not decided", "by": f"the clock, in {test}"}
            if code != -signal.SIGXCPU:
                return result | {"outcome": "killed", "by": test, "said": said}
            loops = test in tests and limit - float(said) > 10 * (1 + selection.usual([test]))
            return result | {"outcome": "killed" if loops else "not decided", "by": f"the limit, in {test}"}
    return result | {"outcome": "not decided" if left else "survived"}


def run(count: int, seed: int, most: float, only: Path | None) -> None:
    """Judge mutants, and append each result to results.jsonl.

    What is there is not repeated, unless it was not decided within a smaller limit.
    """
    if subprocess.run(["git", "diff", "--quiet", "--", "src"], cwd=HOME).returncode:
        sys.exit("commit the changes in src first: the files there are changed and put back")
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1", "PYTEST_ADDOPTS": ""}
    sys.dont_write_bytecode = True
    # imported once for all processes; with one thread, since a lock that another thread holds would outlive the fork
    for name in ("jinja2", "mpmath", "scipy.linalg", "scipy.stats", "sympy", "tqdm"):
        with contextlib.suppress(ImportError):
            __import__(name)
    others = {r["key"]: r for r in _read(only)} if only else {}
    mutants = draw(10**9 if only else count, seed)
    if only:
        mutants = [m for m in mutants if m.key in others]
        print(f"{len(mutants)} of {len(others)} places are as they were")
    # the packages in turn, so that a run that is ended early is a sample of all three
    turn: collections.Counter = collections.Counter()
    mutants.sort(key=lambda m: (turn.update([m.package]), turn[m.package])[1])
    results = OUT / "results.jsonl"
    known = {r["key"]: r for r in _read(results)} if results.exists() else {}
    selection = Selection()
    for mutant in mutants:
        if mutant.key in known:
            before = known[mutant.key]
            if before["outcome"] != "not decided" or before["limit"] >= most:
                continue
        result = judge(mutant, selection, most, others.get(mutant.key, {}).get("by"))
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")
        place = f"{mutant.file}:{mutant.line} {mutant.operator}"
        print(f"{result['outcome']:11} {result['seconds']:5.1f} s {place}", flush=True)


def _empty(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _read(results: Path) -> list[dict]:
    """Return the last result of each change."""
    every = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
    return list({result["key"]: result for result in every}.values())


def table(results: list[dict]) -> None:
    """Print the share found, with the interval of 95 % of Clopper and Pearson, and what survived."""
    from table import interval

    print("| package | killed | survived | not decided | share killed of those decided |")
    print("| --- | --- | --- | --- | --- |")
    for package in (*PACKAGES, "all"):
        count = collections.Counter(r["outcome"] for r in results if package in (r["package"], "all"))
        killed, survived = count["killed"], count["survived"]
        if killed + survived:
            low, high = interval(killed, killed + survived)
            share = f"{killed / (killed + survived):.0%} ({low:.0%} to {high:.0%})"
            print(f"| {package} | {killed} | {survived} | {count['not decided']} | {share} |")
    for r in results:
        if r["outcome"] in ("survived", "not decided"):
            ran = f"{r['tests']} tests run, {r['left']} not"
            print(f"\n{r['file']}:{r['line']} {r['definition']}: {r['outcome']}, {ran}")
            for sign, lines in ("-", r["old"]), ("+", r["new"]):
                print("\n".join(f"  {sign} {line.strip()}" for line in lines.splitlines()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=["map", "run", "table"])
    parser.add_argument("-n", type=int, default=60, help="places of each package")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=OF_A_MUTANT, help="of tests for each change")
    parser.add_argument("--only", type=Path, help="results of another version: the same places")
    chosen = parser.parse_args()
    os.chdir(HOME)
    if chosen.step == "map":
        make_map()
    elif chosen.step == "run":
        run(chosen.n, chosen.seed, chosen.seconds, chosen.only)
    else:
        table(_read(chosen.only or OUT / "results.jsonl"))
