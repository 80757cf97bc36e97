"""How often is a diagnosis right? Hundreds of simulated machines with hidden effects, and a table with intervals.

    make study                      # all groups, 60 machines each, and other methods on the same data
    python study/run.py --quick     # two machines of each group, without the other methods
    python study/run.py -n 200 -j 2 --only innocent
    python study/run.py -n 40 --only real          # machines as they are met: 320 cases
    python study/run.py --case "real 6R 17"        # one machine: its diagnosis, and then the truth
    python study/run.py --simulator physics -n 40  # machines made from physics, on which no constant was chosen

Results are written to build/study: one line per machine as they come, so that a stopped study continues where it was,
and the table and all figures at the end. A change of rodgen or of the study starts over.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(path) for path in (HERE, ROOT / "tests") if str(path) not in sys.path]
PEERS = HERE / ".venv-peers"


def peers_installed(*, make: bool) -> bool:
    """Make the other methods importable, installing them first if `make`; return whether they are available."""
    sys.path.append(str(ROOT / "benchmarks"))
    from environments import CommandError, append_to_path, ensure

    try:
        if make:
            ensure(PEERS, HERE / "requirements-peers.txt")
        if not (PEERS / "requirements.sha256").exists():
            return False
        append_to_path(PEERS)
    except CommandError as error:
        print(f"without scikit-learn and PySINDy: {error}", file=sys.stderr)
        return False
    return True


SIMULATORS = {
    "catalogue": "machines with effects of the catalogue, on which constants were chosen",
    "physics": "machines made from physics, which were looked at only after all constants were frozen",
}


def show(case: str, simulator: str) -> int:
    """Write a machine's files, print its diagnosis as a user sees it, and then the record with the truth."""
    draws, judged = _simulator(simulator)
    group, number = draws.named(case)
    hidden = draws.drawn(group, number)
    folder = ROOT / "build" / "study" / case.replace(" ", "-").replace(":", "")
    print(*hidden.write(folder), sep="\n", end="\n\n")
    record = judged(hidden, show=True)
    print()
    for key, value in record.items():
        print(f"{key:<12} {value}")
    return 0


def _simulator(name: str) -> tuple[Any, Any]:
    """Return the module that draws machines, and the function that judges the diagnosis of one."""
    if name == "physics":
        from physics import draws
        from physics.judge import judged

        return draws, judged
    import draws as by_catalogue
    from judge import judged as judged_by_catalogue

    return by_catalogue, judged_by_catalogue


def one(
    group_name: str, number: int, with_peers: bool, installed: bool, simulator: str = "catalogue"
) -> dict[str, Any]:
    """Return the record of one machine: draw, diagnose, judge; an error is recorded as well."""
    draws, judged = _simulator(simulator)
    if installed:
        peers_installed(make=False)
    group = next(g for g in draws.GROUPS if g.name == group_name)
    start, processor = time.perf_counter(), time.process_time()
    try:
        peers = (
            {}
            if simulator == "physics"
            else {"with_peers": with_peers and group.peers, "installed": installed}
        )
        record = judged(draws.drawn(group, number), **peers)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        record = {"error": f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"}
    seconds = {
        "whole_seconds": time.perf_counter() - start,
        "processor_seconds": time.process_time() - processor,
    }
    return {"group": group_name, "number": number, **seconds, **record}


def plain(x: Any) -> Any:
    """Return a NumPy number as a Python number."""
    return x.item()


def digest(simulator: str = "catalogue") -> str:
    """Return a digest of the sources of rodgen, of the study and of its simulator."""
    sources = [
        *(ROOT / "src" / "rodgen").rglob("*.py"),
        *HERE.glob("*.py"),
        *((HERE / "physics").glob("*.py") if simulator == "physics" else ()),
        *(
            ROOT / "tests" / name
            for name in ("hidden_effects.py", "real_machines.py", "machine_simulator.py")
        ),
    ]
    found = hashlib.sha256()
    for path in sorted(sources):
        found.update(path.read_bytes())
    return found.hexdigest()[:12]


def results(
    todo: list[tuple[str, int]], jobs: int, with_peers: bool, installed: bool, simulator: str
) -> Iterator[dict[str, Any]]:
    """Yield a record of each machine as it comes."""
    if jobs == 1:
        for group, number in todo:
            yield one(group, number, with_peers, installed, simulator)
        return
    with ProcessPoolExecutor(jobs) as pool:
        waiting = iter(todo)
        running = set()
        while True:
            while len(running) < 2 * jobs and (following := next(waiting, None)) is not None:
                running.add(pool.submit(one, *following, with_peers, installed, simulator))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for finished in done:
                yield finished.result()


def main(arguments: list[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=60, metavar="N", help="machines of each group (60)")
    parser.add_argument("-j", type=int, default=1, metavar="N", help="processes (1)")
    parser.add_argument(
        "--quick", action="store_true", help="two machines of each group, without the other methods"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="groups whose name contains TEXT")
    parser.add_argument("--case", metavar="CASE", help="one machine, such as 'real 6R 17'")
    parser.add_argument(
        "--simulator", choices=SIMULATORS, default="catalogue", help="by which machines are drawn (catalogue)"
    )
    parser.add_argument("--no-peers", action="store_true", help="without the other methods")
    parser.add_argument("--minutes", type=float, metavar="M", help="start no further machine after M minutes")
    parser.add_argument("--fresh", action="store_true", help="ignore earlier results")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "study", metavar="FOLDER")
    options = parser.parse_args(arguments)
    if options.case:
        return show(options.case, options.simulator)
    from tqdm import tqdm

    all_of = _simulator(options.simulator)[0].all_of
    physics = options.simulator == "physics"
    start = time.perf_counter()
    with_peers = not (options.quick or options.no_peers or physics)
    installed = with_peers and peers_installed(make=True)
    options.out.mkdir(parents=True, exist_ok=True)
    log = (
        options.out
        / f"{digest(options.simulator)}{'-peers' if with_peers else '-physics' if physics else ''}.jsonl"
    )
    if options.fresh:
        log.unlink(missing_ok=True)
    records = [json.loads(text) for text in log.read_text().splitlines()] if log.exists() else []
    wanted = {
        (group.name, number): None
        for group, number in all_of(2 if options.quick else options.n, options.only)
    }
    records = [r for r in records if (r["group"], r["number"]) in wanted]
    done = {(r["group"], r["number"]) for r in records}
    todo = [key for key in wanted if key not in done]
    with (
        log.open("a") as file,
        tqdm(total=len(wanted), initial=len(done), disable=None, unit="machine") as bar,
    ):
        coming = results(todo, options.j, with_peers, installed, options.simulator)
        for record in coming:
            records.append(record)
            file.write(json.dumps(record, default=plain) + "\n")
            file.flush()
            bar.update()
            if options.minutes and time.perf_counter() - start > 60 * options.minutes:
                coming.close()
                break
    if physics:
        from physics.judge import table as table_of_physics

        figures = table_of_physics(records)
    else:
        from table import table

        figures = table(records, sum(r["whole_seconds"] for r in records))
    text = f"Simulator: {options.simulator}, {SIMULATORS[options.simulator]}\n\n{figures}"
    name = "-physics" if physics else ""
    (options.out / f"table{name}.txt").write_text(text + "\n")
    everything = options.out / f"results{name}.json"
    everything.write_text(json.dumps(records, indent=1, default=plain) + "\n")
    print(text)
    print(f"\nAll figures: {everything}")
    return int(any("error" in record for record in records))


if __name__ == "__main__":
    sys.exit(main())
