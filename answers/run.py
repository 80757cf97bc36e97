"""What the product says, frozen: write it down, or compare it with what was written.

    make answers                    # compare; exit code 1 where an answer is another one
    make answers ACCEPT=1           # write the answers of today
    make answers ONLY=diagnoses     # one part: diagnoses, transcripts, kernels or machines
    make answers CASE="real .* 3"   # cases whose name matches this
    make answers ALL=1              # every difference, not the first of each kind

Each part is a module, which says which cases there are and answers one. Its answers are in `answers/frozen`: one JSON
file for each part, and the numbers of arrays in a file next to it, bit by bit; the JSON has their digests. So that the
answers are the same on every x86-64 processor that has AVX2, libraries are told to use no more than that, and
compiled code no more than every processor has. What differs by rounding only is listed, and does not count.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import multiprocessing
import os
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
FROZEN = HERE / "frozen"
PARTS = ("diagnoses", "transcripts", "machines", "kernels")
ENVIRONMENT = {
    **{f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")},
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL",
    "RODGEN_CPU": "baseline",
}
"""For the processes that answer; a variable that is set already stays, to see what another processor would say."""

sys.path[:0] = [str(path) for path in (HERE, ROOT / "study", ROOT / "tests") if str(path) not in sys.path]
from compare import Difference, Record, differences, report  # noqa: E402


def begin() -> None:
    """Prepare a process that answers; kernels are compiled in a tenth of the time, and give the same numbers."""
    from rodgen.codegen import rows

    rows.FLAGS = tuple("-O0" if flag == "-O2" else flag for flag in rows.FLAGS)
    warnings.simplefilter("ignore")


def answer(task: tuple[str, str]) -> tuple[str, str, float, dict[str, Record]]:
    """Answer a case of a part; return its records, and the processor time."""
    part, case = task
    start = sum(os.times()[:4])  # with the compiler
    found = dict(importlib.import_module(part).answers(case))
    return part, case, sum(os.times()[:4]) - start, found


def answered(
    parts: list[str], jobs: int, *, only: str = "", reverse: bool = False
) -> dict[str, dict[str, Record]]:
    """Answer the cases of some parts whose name matches `only`, in processes of their own, the longest first."""
    with tempfile.TemporaryDirectory() as cache:
        for name, value in {**ENVIRONMENT, "RODGEN_CACHE": cache}.items():
            os.environ.setdefault(name, value)
        with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), begin) as pool:
            tasks = [
                (part, case)
                for part in parts
                for case in pool.submit(_cases, part).result()
                if re.search(only, case)
            ]
            tasks = tasks[::-1] if reverse else tasks
            coming = as_completed([pool.submit(answer, task) for task in tasks])
            found: dict[str, dict[str, Record]] = {part: {} for part in parts}
            spent: dict[str, list[tuple[float, str]]] = {part: [] for part in parts}
            begun = time.perf_counter()
            for n, (part, case, seconds, records) in enumerate((done.result() for done in coming), 1):
                found[part] |= records
                spent[part].append((seconds, case))
                if sys.stderr.isatty() or n % 50 == 0 or n == len(tasks):
                    end = "\r" if sys.stderr.isatty() and n < len(tasks) else "\n"
                    text = f"{n} of {len(tasks)} cases, {time.perf_counter() - begun:.0f} s  {case:<50.50}"
                    print(text, end=end, file=sys.stderr)
    for part, times in spent.items():
        longest = ", ".join(f"{case} {seconds:.0f} s" for seconds, case in sorted(times)[:-4:-1])
        whole = f"{sum(seconds for seconds, _ in times):.0f} s of processor time"
        print(f"{part}: {len(found[part])} answers, {whole}; longest {longest}", file=sys.stderr)
    return found


def _cases(part: str) -> list[str]:
    return list(importlib.import_module(part).cases())


def write(part: str, answers: Mapping[str, Record], folder: Path) -> None:
    """Write the answers of a part."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"{key}|{name}": array
        for key, record in answers.items()
        for name, array in record.get("arrays", {}).items()
        if array.tobytes() != record["arrays"].get(_same(name), np.array([])).tobytes() or name == _same(name)
    }
    text = json.dumps(
        dict(sorted(answers.items())), indent=1, sort_keys=True, ensure_ascii=False, default=_described
    )
    (folder / f"{part}.json").write_text(text + "\n", encoding="utf-8")
    if arrays:
        np.savez_compressed(folder / f"{part}.npz", **dict(sorted(arrays.items())))


def _described(array: np.ndarray) -> Any:
    """Return what the JSON has of an array: its digest and its first numbers."""
    first = [x.hex() if isinstance(x, float) else str(x) for x in array.ravel()[:2].tolist()]
    digest = hashlib.sha256(array.tobytes()).hexdigest()[:16]
    return f"{digest} {array.dtype}{list(array.shape)} {' '.join(first)} ..."


def read(part: str, folder: Path) -> dict[str, Record]:
    """Read the answers of a part; there are none where nothing is frozen."""
    path = folder / f"{part}.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if path.with_suffix(".npz").exists():
        with np.load(path.with_suffix(".npz")) as arrays:
            for key, record in found.items():
                for name in record.get("arrays", {}):
                    own, same = f"{key}|{name}", f"{key}|{_same(name)}"
                    record["arrays"][name] = arrays[own if own in arrays else same]
    return found


def _same(name: str) -> str:
    """Return the array that has the same numbers, as a rule, so that they are written once."""
    return name.removeprefix("compiled ")


def of_other_cases(part: str, folder: Path, only: str) -> dict[str, Record]:
    """Return the frozen answers of a part that were not asked; a key begins with its case."""
    cases = tuple(case for case in _cases(part) if re.search(only, case)) if only else ()
    frozen = read(part, folder).items() if only else ()
    return {
        k: r
        for k, r in frozen
        if k not in cases and not k.startswith(tuple(f"{c}{x}" for c in cases for x in " :"))
    }


def compared(part: str, today: Mapping[str, Record], folder: Path) -> list[Difference]:
    """Return how the answers of today differ from the frozen ones."""
    plain = json.loads(
        json.dumps({k: {f: x for f, x in r.items() if f != "arrays"} for k, r in today.items()})
    )
    for key, record in today.items():
        if "arrays" in record:
            plain[key]["arrays"] = record["arrays"]
    allowance = (
        getattr(importlib.import_module(part), "allowance", None) if part in ("kernels", "machines") else None
    )
    return list(differences(read(part, folder), plain, allowance))


def main(arguments: list[str] | None = None) -> int:
    """Compare, or write with --accept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--accept", action="store_true", help="write the answers of today")
    parser.add_argument("--only", choices=PARTS, help="one part")
    parser.add_argument("--case", default="", metavar="REGEX", help="cases whose name matches")
    parser.add_argument("--all", action="store_true", help="print every difference")
    parser.add_argument("-j", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--reverse", action="store_true", help="answer in the other order")
    parser.add_argument("--frozen", type=Path, default=FROZEN, metavar="FOLDER")
    options = parser.parse_args(arguments)
    parts = [options.only] if options.only else list(PARTS)
    found = answered(parts, options.j, only=options.case, reverse=options.reverse)
    for part in parts:
        found[part] |= of_other_cases(part, options.frozen, options.case)
    if options.accept:
        for part in parts:
            write(part, found[part], options.frozen)
        size = sum(path.stat().st_size for path in options.frozen.iterdir())
        print(f"{sum(map(len, found.values()))} answers written to {options.frozen}, {size / 1e6:.1f} MB")
        return 0
    several = {part: compared(part, found[part], options.frozen) for part in parts}
    for part, ones in several.items():
        print(f"{part}: {'as frozen' if not ones else ''}")
        print(report(ones, every=options.all), end="\n" if ones else "")
    return int(any(one.counts for ones in several.values() for one in ones))


if __name__ == "__main__":
    sys.exit(main())
