"""Are the readings of a plan enough, and how many readings of an evenly spaced plan would achieve the same?

    python study/plan.py                 # 40 machines of each class that looks the same by design
    python study/plan.py -n 10 --only one_side,one_load
    python study/plan.py --diagnosed 10  # of 10 machines of each class, also from diagnosis to diagnosis

For each class of tests/closed_loop.py, machines with a true effect from the class are measured, a plan is made and
measured, and all readings are fitted with each effect of the class. `resolved` is the share of machines for which only
the true effect remains, with its 95 % interval (Wilson), among those that the plan, or a very large evenly spaced plan,
can resolve; `plan` is the mean number of planned readings; `even` is the size of the smallest evenly spaced plan that
resolves 95 % of the same machines, and `with half` how many plans resolve with at most half as many readings. With
`--diagnosed`, a plan is made of what a diagnosis of the whole catalogue leaves open, and after it is measured all is
diagnosed again: `diagnosed` is the share of machines of which the second diagnosis has the true effect, or with it what
no measurement tells from it, and no other effect of the class. The plan has at most half of the readings that an
evenly spaced one needs for nine of ten such diagnoses. The table is written to build/study/plan.json.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(path) for path in (ROOT / "tests",) if str(path) not in sys.path]

import numpy as np  # noqa: E402
from closed_loop import LOOPS, Loop, Trial, joined  # noqa: E402

EVEN = (2, 3, 4, 6, 8, 10, 12, 16, 20, 24, 30, 36, 48, 60, 80, 120)
EVEN_DIAGNOSED = (6, 12, 24, 48, 96)
MOST = 60
LARGE = 400


def wilson(hits: int, n: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a proportion."""
    if not n:
        return 0.0, 1.0
    z, p = 1.96, hits / n
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float((middle - half) / (1 + z * z / n)), float((middle + half) / (1 + z * z / n))


def even(trials: list[Trial], loop: Loop, most: int) -> int | None:
    """Return the least size of an even plan, up to `most`, that resolves 95 % of the trials."""
    for n in EVEN:
        if n > most:
            break
        failed, allowed = 0, len(trials) * 0.05
        for trial in trials:
            failed += not trial.resolved(loop.file, joined(loop.columns, loop.grid(n)))
            if failed > allowed:
                break
        if failed <= allowed:
            return n
    return None


def even_diagnosed(trials: list[Trial], loop: Loop) -> int | None:
    """Return the least size of an even plan after which nine of ten diagnoses have the true effect alone."""
    for n in EVEN_DIAGNOSED:
        settled = [t.settled(t.diagnosed(loop.file, joined(loop.columns, loop.grid(n)))) for t in trials]
        if np.mean(settled) >= 0.9:
            return n
    return None


def from_diagnosis_to_diagnosis(trial: Trial, most: int) -> tuple[bool, int]:
    """Return whether a plan of a diagnosis lets the next one say what is there, and its readings."""
    found = trial.fit.diagnose().plan(most)
    if not found.count:
        return False, 0
    return trial.settled(trial.diagnosed(*trial.after(found))), found.count


def measured(loop: Loop, machines: int, most: int = MOST, diagnosed: int = 0) -> dict[str, Any]:
    """Return one row of the table: measure, plan, measure and fit, for several machines of a class."""
    begin = time.perf_counter()
    could, counts, settled = [], [], []
    aliased = resolved = promised = 0
    for seed in range(machines):
        trial = Trial(loop, seed)
        if trial.resolved(loop.file, loop.columns):
            continue
        aliased += 1
        found = trial.plan(most)
        done = bool(found.count) and trial.resolved(*trial.after(found))
        large = joined(loop.columns, loop.grid(LARGE))
        if not (done or found.reached or trial.resolved(loop.file, large)):
            continue  # no measurement resolves it
        could.append(trial)
        counts.append(found.count)
        settled.append(done)
        resolved += done
        promised += found.reached
    low, high = wilson(resolved, len(could))
    size = even(could, loop, EVEN[-1])
    half = (size or EVEN[-1]) // 2
    with_half = 0
    for trial, count, done in zip(could, counts, settled, strict=True):
        if count > half:
            smaller = trial.plan(half)
            with_half += bool(smaller.count) and trial.resolved(*trial.after(smaller))
        else:
            with_half += done
    again_even = even_diagnosed(could[:diagnosed], loop) if diagnosed else None
    again = [from_diagnosis_to_diagnosis(trial, (again_even or EVEN[-1]) // 2) for trial in could[:diagnosed]]
    return {
        "class": loop.name,
        "machines": machines,
        "look the same": aliased,
        "could be settled": len(could),
        "resolved": resolved,
        "share": resolved / max(len(could), 1),
        "interval": [low, high],
        "promised": promised,
        "plan": float(np.mean(counts)) if counts else 0.0,
        "plan_most": max(counts, default=0),
        "even": size,
        "with_half": with_half,
        "diagnosed": sum(alone for alone, _ in again),
        "diagnosed_of": len(again),
        "diagnosed_even": again_even,
        "diagnosed_plan": float(np.mean([count for _, count in again])) if again else None,
        "seconds": time.perf_counter() - begin,
    }


def line(row: dict[str, Any]) -> str:
    """Return one line of the table."""
    low, high = row["interval"]
    size = "more than 120" if row["even"] is None else str(row["even"])
    ratio = row["plan"] / (row["even"] or EVEN[-1])
    diagnosed = ""
    if row["diagnosed_of"]:
        shares = f"{row['diagnosed']} of {row['diagnosed_of']}"
        diagnosed = (
            f"  diagnosed {shares}, plan {row['diagnosed_plan']:.1f}, even {row['diagnosed_even'] or '> 96'}"
        )
    return (
        f"{row['class']:12s} {row['resolved']:3d} of {row['could be settled']:3d} resolved "
        f"({100 * low:.0f} to {100 * high:.0f} %)  plan {row['plan']:5.1f}  even {size:>13s}  "
        f"{'below' if row['even'] is None else 'ratio'} {ratio:.2f}"
        f"  with half {row['with_half']}  {row['seconds']:.0f} s{diagnosed}"
    )


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=40, help="machines of each class")
    parser.add_argument(
        "--diagnosed",
        type=int,
        default=0,
        metavar="N",
        help="machines of each class diagnosed before and after",
    )
    parser.add_argument("--only", default="", help="names of classes, separated by commas")
    options = parser.parse_args()
    rows = []
    for make in LOOPS:
        if options.only and make.__name__ not in options.only.split(","):
            continue
        rows.append(measured(make(), options.n, diagnosed=options.diagnosed))
        print(line(rows[-1]), flush=True)
    folder = ROOT / "build" / "study"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plan.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
