"""Measure fits: all contenders on three machines, rodgen alone on many rows, and the time to make a model."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import clock
import environments
import numpy as np
from contenders import native

from fits import cases, formulas
from fits.contenders import FAMILIES, FIT, Contender

# rounds of a full run, of a quick one; 0: left out
ROUNDS = {
    "mount, 80 rows": (21, 7),
    "positioner, 615 rows": (15, 5),
    "arm, 1e3 rows": (11, 3),
    "arm, 1e4 rows": (5, 0),
    "arm, 1e5 rows": (3, 0),
}
LARGE = ((100_000, 10_000), (1_000_000, 100_000), (10_000_000, 0))  # full, quick
SHORTEST_S = 0.02
LONGEST_S = 4.0
"""Who would need longer for one fit, ten times as many rows taking ten times as long, is left out, but for the fastest
of its kind."""
BUDGET_S = 90.0
# All must reach the same minimum: the cost, and all parameters together in standard deviations.
COST_WITHIN, STD_WITHIN = 1e-6, 1e-3


def measure(*, quick: bool) -> dict[str, Any]:
    """Return everything measured, as plain data."""
    started = time.perf_counter()
    missing: list[dict[str, str]] = []
    found = []
    spent: dict[str, float] = {}
    for name, (full, few) in ROUNDS.items():
        rounds = few if quick else full
        if rounds:
            found.append(_case(name, rounds, missing, spent))
            print(f"  {name}: {found[-1]['seconds']:.0f} s", flush=True)
    return {
        "cases": found,
        "large": [_large(few if quick else full) for full, few in LARGE if (few if quick else full)],
        "derive": _derive(2 if quick else 3),
        "kernels": _kernels(),
        "missing": missing,
        "seconds": round(time.perf_counter() - started),
    }


# side by side ----------------------------------------------------------------------------------------------


def _case(name: str, rounds: int, missing: list[dict[str, str]], spent: dict[str, float]) -> dict[str, Any]:
    begun = time.perf_counter()
    case = cases.MAKERS[name]()
    contenders = _collected(case, name, missing, spent)
    judged = _judged(case, contenders, name, missing, spent)
    entries = {c.name: clock.Entry(c.call, 1, processor=time.process_time_ns) for c in judged}
    for name_of, entry in entries.items():
        entry.repeats = max(1, round(SHORTEST_S / max(spent[name_of], 1e-6)))
    clock.alternate(entries, rounds, seed=rounds, budget_s=BUDGET_S)
    base = entries[FIT]
    return {
        "name": name,
        "rows": case.observations.n,
        "parameters": len(case.start),
        "rounds": len(base.samples),
        "seconds": time.perf_counter() - begun,
        "contenders": [
            {
                "name": contender.name,
                "family": contender.family,
                "strict": contender.strict,
                "compile": contender.compile_seconds,
                "ms": entries[contender.name].median / 1e6,
                "wall ms": float(np.median(entries[contender.name].walls)) / 1e6,
                "ratio": clock.ratio(entries[contender.name], base),
                "spread": entries[contender.name].spread,
                "cost": judged[contender][0],
                "std": judged[contender][1],
            }
            for contender in judged
        ],
    }


def _collected(
    case: cases.Case, name: str, missing: list[dict[str, str]], spent: Mapping[str, float]
) -> list[Contender]:
    """Return the contenders, and those that cannot be made with the reason."""
    made = []
    for family in FAMILIES:
        try:
            made += list(family(case))
        except Exception as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
            missing.append({"name": f"{family.__name__}, {name}", "reason": reason})
    if name.startswith("arm") and not name.startswith("arm, 1e3"):  # the one before had a tenth of the rows
        kinds = {c.family: [o for o in made if o.family == c.family and o.name in spent] for c in made}
        fastest = [min(kind, key=lambda c: spent[c.name]).name for kind in kinds.values() if kind]
        for contender in list(made):
            seconds = 10 * spent.get(contender.name, 0.0)
            if seconds > LONGEST_S and contender.name not in fastest:
                made.remove(contender)
                reason = f"a fit would take some {seconds:.0f} s"
                missing.append({"name": f"{contender.name}, {name}", "reason": reason})
    return made


def _judged(
    case: cases.Case,
    contenders: list[Contender],
    name: str,
    missing: list[dict[str, str]],
    spent: dict[str, float],
) -> dict[Contender, tuple[float, float]]:
    """Return the distance of each contender's fit from rodgen's minimum; those that end elsewhere are removed.

    The distance is |r - r'|/s, r the residuals at rodgen's parameters, r' at the peer's, s² the variance of one: to
    first order the length of the vector of all parameters' deviations, made independent, in standard deviations. No
    parameter is off by more, and it does not matter where parameters only choose coordinates.
    """
    own = next(c for c in contenders if c.name == FIT).call()
    residuals = own.problem.residuals(own.solution.theta, own.solution.frame).T.ravel()
    variance = own.solution.cost / (len(residuals) - len(own.free))
    found = {}
    for contender in contenders:
        begun = time.perf_counter()
        theta = contender.call()
        spent[contender.name] = time.perf_counter() - begun
        if not isinstance(theta, np.ndarray):
            found[contender] = (0.0, 0.0)
            continue
        there = formulas.ARRAYS[case.name](theta, case.columns, case.frame)
        cost = float(there @ there) / own.solution.cost - 1
        std = float(np.linalg.norm(there - residuals) / np.sqrt(variance))
        if abs(cost) <= COST_WITHIN and std <= STD_WITHIN:
            found[contender] = (cost, std)
        else:
            reason = f"another minimum: cost off by {cost:.1e}, parameters by {std:.1e} standard deviations"
            missing.append({"name": f"{contender.name}, {name}", "reason": reason})
    for contender in found:  # warm by now
        if spent[contender.name] > 1:
            continue
        begun = time.perf_counter()
        contender.call()
        spent[contender.name] = time.perf_counter() - begun
    return found


# in processes of their own ---------------------------------------------------------------------------------


def _worker(*words: object, **variables: str) -> dict[str, Any]:
    command = [sys.executable, Path(__file__).with_name("worker.py"), *words]
    return json.loads(environments.run(command, env=os.environ | variables).splitlines()[-1])


def _large(rows: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(dir=environments.BUILD) as folder:
        _worker("data", folder, rows)
        found = _worker("large", folder)
    print(f"  {rows:,} rows: {found['bind'] + found['fit']:.1f} s", flush=True)
    return found


def _derive(times: int) -> dict[str, Any]:
    """Make the model of 60 parameters with nothing in the cache, and load it again: medians."""
    machine = cases.HERE / "arm60.toml"
    cold, warm = [], []
    for _ in range(times):
        folder = tempfile.mkdtemp(dir=environments.BUILD)
        try:
            cold.append(_worker("derive", machine, RODGEN_CACHE=folder))
            warm += [_worker("derive", machine, RODGEN_CACHE=folder) for _ in range(3)]
        finally:
            shutil.rmtree(folder)
    print(f"  {times} models made, {len(warm)} loaded", flush=True)
    return {name: _median(found) for name, found in (("cold", cold), ("cached", warm))}


def _median(found: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        key: float(np.median([f[key] for f in found])) if isinstance(value, float) else value
        for key, value in found[0].items()
    }


def _kernels() -> dict[str, Any]:
    rows = 10_000
    return {
        "C": _worker("kernels", rows),
        "NumPy": _worker("kernels", rows, RODGEN_CPU="numpy"),
        "operations": _operations(),
        "products a ns": _peak(),
    }


def _operations() -> dict[str, dict[str, int]]:
    """Count what the arm's kernels do a row."""
    from rodgen.machines.derivation import derive_programs
    from rodgen.machines.structure import structure_of

    programs = derive_programs(structure_of(cases.Machine.load(str(cases.HERE / "arm.toml"))))
    return {program.name: program.operations_of_a_row for program in programs}


def _peak() -> float:
    """Return how many products with a sum one core makes in a nanosecond."""
    library = native.shared_library(
        "peak", Path(__file__).with_name("peak.c").read_text(), "c", native.STRICT
    )
    library.peak.argtypes, library.peak.restype = (ctypes.c_long, ctypes.c_double), ctypes.c_double
    rounds, chains = 2_000_000, 12
    entry = clock.Entry(lambda: library.peak(rounds, 0.5), rounds * chains * library.lanes())
    entry.call()
    entry.samples = [entry.once()[0] for _ in range(9)]
    return 1 / entry.median
