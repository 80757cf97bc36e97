"""Measure the speed of solve_axis, compared with other solvers of the same equation and with the hardware's limits.

All contenders run in one process on one thread, in rounds: each of them once per round, in a random order,
so that a slow minute of a shared machine affects all. Figures are medians over the rounds; ratios
are medians of the quotients within a round. Before a contender is timed, its answers are compared with
an extended-precision reference. What cannot be installed or made is listed with its reason.
"""

from __future__ import annotations

import importlib
import time
from concurrent.futures import ThreadPoolExecutor

import clock
import limits
import numpy as np
import problem
import report
from contenders import Contender, UnavailableError, package

FAMILIES = (
    "package",
    "numba_gufunc",
    "casadi_map",
    "symforce_cpp",
    "wrenfold_cpp",
    "sympy_functions",
    "solvers",
    "by_hand",
)
CHECKED = 2000  # solves of every contender that are compared with the reference
# Generous: enough for any correct answer at these condition numbers and any solver's own tolerance.
LARGEST_ERROR = 1e-8
THREADS = 2

# N: rounds of a full run, rounds of a quick one, the longest sample (s), the shortest (s)
PLAN = {
    1: (21, 5, 0.02, 0.004),
    1_000: (25, 7, 0.06, 0.003),
    100_000: (25, 7, 0.1, 0.004),
    10_000_000: (7, 0, 0.5, 0.0),
}


def collect() -> tuple[list[Contender], list[tuple[str, str]]]:
    """Return the contenders, and those that cannot be made with the reason."""
    made, missing = [], []
    for family in FAMILIES:
        try:
            factories = importlib.import_module(f"contenders.{family}").FACTORIES
        except Exception as error:
            missing.append((family, f"{type(error).__name__}: {error}"))
            continue
        for factory in factories:
            started = time.perf_counter()
            try:
                made.append(factory())
            except Exception as error:
                reason = (
                    str(error) if isinstance(error, UnavailableError) else f"{type(error).__name__}: {error}"
                )
                missing.append((f"{family}.{factory.__name__}", reason.splitlines()[0]))
            else:
                print(f"  {made[-1].name} ({time.perf_counter() - started:.1f} s to make)", flush=True)
    return made, missing


def check(contenders: list[Contender], missing: list[tuple[str, str]]) -> dict[str, float]:
    """Return the largest error of each contender; one that is wrong or raises is removed, with the reason."""
    small = problem.make(CHECKED)
    expected = problem.reference(small)
    errors = {}
    for contender in list(contenders):
        small.axes[:] = np.nan
        try:
            contender.bind(small)()
            errors[contender.name] = problem.largest_error(small.axes, expected)
            if not errors[contender.name] <= LARGEST_ERROR:
                raise UnavailableError(f"wrong answers: largest error {errors[contender.name]:.1e}")
        except Exception as error:
            contenders.remove(contender)
            missing.append((contender.name, f"{type(error).__name__}: {error}".splitlines()[0]))
    return errors


def bind(
    contender: Contender, full: problem.Problem, longest_s: float, ns_a_solve: float | None
) -> clock.Entry:
    """Bind to as many of the problems as fit ``longest_s``, given what a solve took at a smaller N."""
    n = min(len(full), contender.largest_n)
    if ns_a_solve is not None:
        affordable = int(longest_s * 1e9 / ns_a_solve)
        n = n if affordable >= n else max(1, affordable)
    part = full if n == len(full) else full.head(n)
    return clock.Entry(contender.bind(part), n)


def measure(
    n: int, rounds: int, contenders: list[Contender], known: dict[str, float]
) -> tuple[dict[str, clock.Entry], float]:
    """Time every contender at one N, with the machine's own limits and the threads among them.

    Returns the entries and the share of a processor that the rounds got.
    """
    _, _, longest_s, shortest_s = PLAN[n]
    full = problem.make(n)
    entries = {c.name: bind(c, full, longest_s, known.get(c.name)) for c in contenders}
    pool = ThreadPoolExecutor(THREADS)
    names = [c.name for c in contenders]
    if n >= 100_000:
        if package.GUFUNC in names:
            two = package.threaded(pool, THREADS)
            entries[two.name] = clock.Entry(two.bind(full), n, threads=THREADS)
        for name in ("traffic", "traffic_streaming"):
            add_limit(entries, name, lambda name=name: limits.traffic(full, name), n)
    if n == 1_000:
        add_limit(entries, "arithmetic", lambda: limits.arithmetic(full)[0], limits.arithmetic(full)[1])
    if n == max(PLAN):
        # As many bytes as a solve at this N moves, far more than the caches hold.
        triad = limits.Triad(limits.BYTES_A_SOLVE * n // limits.TRIAD_BYTES)
        solves = triad.bytes // limits.BYTES_A_SOLVE
        for name in ("triad", "triad_streaming"):
            add_limit(entries, name, lambda name=name: triad.call(name), solves)
            add_limit(
                entries, f"{name}_2", lambda name=name: triad.call(name, pool, THREADS), solves, THREADS
            )
    for entry in entries.values():
        clock.calibrate(entry, shortest_s)
    share = clock.alternate(entries, rounds, seed=n)
    pool.shutdown()
    return entries, share


def add_limit(entries: dict[str, clock.Entry], name: str, make, solves: int, threads: int = 1) -> None:
    try:
        call = make()
        call()
    except Exception as error:
        print(f"  limit {name} not measured: {error}")
    else:
        entries[f"limit:{name}"] = clock.Entry(call, solves, threads=threads)


def only_bandwidth() -> dict[str, clock.Entry]:
    """The triad alone, for a quick run, which has no N large enough to carry it along."""
    triad = limits.Triad(30_000_000)
    entries: dict[str, clock.Entry] = {}
    with ThreadPoolExecutor(THREADS) as pool:
        for name in ("triad", "triad_streaming"):
            solves = triad.bytes // limits.BYTES_A_SOLVE
            add_limit(entries, name, lambda name=name: triad.call(name), solves)
            add_limit(
                entries, f"{name}_2", lambda name=name: triad.call(name, pool, THREADS), solves, THREADS
            )
        clock.alternate(entries, 5)
    return entries


def run(machine: dict[str, str], *, quick: bool) -> dict:
    """Return everything measured, as plain data."""
    started = time.perf_counter()
    print("making the contenders:")
    contenders, missing = collect()
    errors = check(contenders, missing)

    sizes: dict[int, dict[str, clock.Entry]] = {}
    shares: dict[int, float] = {}
    known: dict[str, float] = {}
    for n, (full_rounds, quick_rounds, _, _) in PLAN.items():
        rounds = quick_rounds if quick else full_rounds
        if not rounds:
            sizes[n] = only_bandwidth()
            continue
        begun = time.perf_counter()
        if not known:
            # One call on few problems shows the time of a solve, so that slow loops get an affordable share.
            few = problem.make(20)
            for contender in contenders:
                entry = clock.Entry(contender.bind(few), 20)
                clock.calibrate(entry, 0.0)
                known[contender.name], _ = entry.once()
        sizes[n], shares[n] = measure(n, rounds, contenders, known)
        if n > 1:
            known |= {name: entry.median for name, entry in sizes[n].items()}
        print(
            f"N = {n:,}: {len(next(iter(sizes[n].values())).samples)} rounds in {time.perf_counter() - begun:.0f} s",
            flush=True,
        )

    result = report.result(machine, contenders, missing, errors, sizes, shares)
    result["seconds"] = round(time.perf_counter() - started)
    return result
