"""Write the measured rounds as one record (JSON) and one page (Markdown): a table a question."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Callable
from pathlib import Path

import clock
import limits
import problem
from contenders import Contender, package
from contenders.base import OWN

HEADERS = {1: "1", 1_000: "1e3", 100_000: "1e5", 10_000_000: "1e7"}
PACKAGES = ("numpy", "scipy", "lmfit", "casadi", "jax", "sympy", "numba", "wrenfold", "ssik", "eaik")

SUBJECTS = ("tricept", "three_sps_s", "robots", "spatial", "diagnose", "workbench")
"""Parts that are packages of their own, with `measure.measure`, and with `page` in `page`."""

FAR = 40
"""Contenders that take more times as long are only named."""

TITLE = """\
# Benchmarks

*`make bench` writes this page; `make bench ONLY=fits` measures one part again (also `axis`, `tricept`, `three_sps_s`,
`robots`, `spatial`, `diagnose`, `workbench`). Peers have pinned versions and environments of their own.*

How to read the tables:

- The figures are from one run on a shared machine. Ratios are taken within a round and are steadier than times. A ratio
  above 1 says that the peer takes longer than rodgen.
- *Spread* is the interquartile range over the median. A difference smaller than the spread is not significant.
- Times are processor time unless they are called wall time.
- Each peer is set up as an expert in it would do.
- Rows marked † are compiled with `-ffast-math` (Numba: `fastmath=True`). The compiler may then delete tests for NaN,
  which a library with statuses cannot allow. The rows show what it would gain.
"""

CAVEATS = """\
One pair of points is some fifty operations and one tangent. This compares how well each tool turns a short formula into
a loop over memory; it says nothing about large expressions or derivatives.

- Closed-form peers evaluate `e± = (κ m×r ± sqrt(max(|m|² − κ²|r|², 0)) m)/|m|²`, κ = cot(χ/2), and nothing else. The
  function of rodgen also scales its input, corrects unequal lengths, treats degenerate cases and writes a status.
- The inputs are generic ({condition}).
  Blocks in which all inputs are ordinary take a short form of the kernel; here all are, which is its best case.
- Peers get allocated outputs, `-O3 -march=native`, blocks that fit the cache, analytic Jacobians and good starts.
  The code of rodgen is portable and chooses its instruction set when it runs.
- `benchmarks/contenders` says how each is set up. *Measured lengths*: every |ρ′| is 1e-6 longer, within the stated
  tolerance. *1 % lengths differ*: one input in a hundred is beyond it, and gets a status.
- N = 1 is one call from Python. C and C++ are called through ctypes with prepared addresses.
- The bandwidth limit counts {bytes} bytes per solve at the triad's bandwidth with non-temporal stores.
"""


def machine(compiler: Callable[[str], str]) -> dict[str, str]:
    """Return the processor, compilers and packages on which the figures depend."""

    def first_line(command: list[str]) -> str:
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            return "none"
        return done.stdout.splitlines()[0]

    def version(name: str) -> str:
        try:
            return f"{name} {importlib.metadata.version(name)}"
        except importlib.metadata.PackageNotFoundError:
            return f"{name} (not installed)"

    facts = {"processor": platform.processor() or platform.machine(), "caches": "unknown"}
    information = Path("/proc/cpuinfo")
    if information.exists():
        fields = dict(
            (part.strip() for part in line.split(":", 1))
            for line in information.read_text().split("\n\n")[0].splitlines()
            if ":" in line
        )
        vector = [name for name in ("avx2", "avx512f") if name in fields.get("flags", "").split()]
        facts["processor"] = (
            f"{fields.get('model name', 'unknown')} (family {fields.get('cpu family')}, "
            f"model {fields.get('model')}, {', '.join(vector) or 'no AVX2'}), {os.cpu_count()} cores"
        )
        caches = sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*"))
        facts["caches"] = ", ".join(
            f"L{(c / 'level').read_text().strip()} {(c / 'type').read_text().strip().lower()} "
            f"{(c / 'size').read_text().strip()}"
            for c in caches
        )
    for language in ("c", "c++"):
        try:
            facts[f"{language} compiler"] = first_line([compiler(language), "--version"])
        except Exception as error:
            facts[f"{language} compiler"] = str(error)
    facts["Python"] = f"{platform.python_implementation()} {platform.python_version()}"
    facts["packages"] = ", ".join(version(name) for name in PACKAGES)
    facts["load before the run"] = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"
    return facts


def result(
    facts: dict[str, str],
    contenders: list[Contender],
    missing: list[tuple[str, str]],
    errors: dict[str, float],
    sizes: dict[int, dict[str, clock.Entry]],
    shares: dict[int, float],
) -> dict:
    """Everything measured, as plain data."""
    rows = []
    threaded = [
        name for name in sizes[100_000] if name.startswith(f"{package.GUFUNC}, ") and "threads" in name
    ]
    for contender in contenders:
        rows.append(
            {
                "name": contender.name,
                "family": contender.family,
                "strict": contender.strict,
                "note": contender.note,
                "largest error": errors[contender.name],
                "sizes": _sizes(contender.name, sizes),
            }
        )
    return {
        "machine": facts,
        "rows": rows,
        "threads": {name: _sizes(name, sizes) for name in threaded},
        "missing": [{"name": name, "reason": reason} for name, reason in missing],
        "limits": {
            name.removeprefix("limit:") + (f" {HEADERS[n]}" if "traffic" in name else ""): round(
                entry.median, 3
            )
            for n, entries in sizes.items()
            for name, entry in entries.items()
            if name.startswith("limit:")
        },
        "processor share": {HEADERS[n]: round(share, 3) for n, share in shares.items()},
        "rounds": {HEADERS[n]: len(next(iter(entries.values())).samples) for n, entries in sizes.items()},
    }


def _sizes(name: str, sizes: dict[int, dict[str, clock.Entry]]) -> dict[str, dict]:
    found = {}
    for n, entries in sizes.items():
        if name not in entries:
            continue
        entry, base = entries[name], entries.get(package.GUFUNC)
        found[HEADERS[n]] = {
            "ns a solve": round(entry.median, 3),
            "fastest ns a solve": round(min(entry.samples), 3),
            "spread": round(entry.spread, 3),
            "solves timed": entry.solves,
            "ratio": round(clock.ratio(entry, base), 3) if base else None,
        }
        streaming = entries.get("limit:triad_streaming")
        if streaming:
            # Within rounds, as every ratio: the machine's bandwidth moves with its other tenants.
            found[HEADERS[n]]["fraction of the limit"] = round(clock.ratio(streaming, entry), 3)
        both = entries.get(f"limit:triad_streaming_{2}")
        if both and "threads" in name:
            found[HEADERS[n]]["fraction of the limit of two threads"] = round(clock.ratio(both, entry), 3)
    return found


def number(value: float | None) -> str:
    if value is None:
        return "–"
    if value >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _cell(sizes: dict, n: int, key: str) -> str:
    found = sizes.get(HEADERS[n])
    if not found or found.get(key) is None:
        return "–"
    text = number(found[key])
    if key == "ns a solve" and found["solves timed"] != n:
        text += f" [{found['solves timed']:,}]"
    return text


def table(header: list[str], rows: list[list[str]]) -> str:
    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cells) + " |"

    align = ["---"] + ["---:"] * (len(header) - 1)
    return "\n".join([line(header), line(align), *(line(row) for row in rows)])


def _columns(result: dict) -> list[int]:
    measured = {n for row in result["rows"] for n, text in HEADERS.items() if text in row["sizes"]}
    return [n for n in HEADERS if n in measured]


def compose(parts: dict[str, dict]) -> str:
    """Write the page of those parts that were ever measured: how to read it, the machine, and a table a question."""
    from fits import page as fits
    from gpu import page as gpu

    axis, machines = parts.get("axis"), parts.get("fits")
    lines = [TITLE, _machine([part["machine"] for part in parts.values()])]
    lines += [fits.page(machines)] if machines else []
    for name in SUBJECTS:
        if found := parts.get(name):
            lines += [importlib.import_module(f"{name}.page").page(found)]
    lines += [page(axis)] if axis else []
    lines += [gpu.kept()]
    return "\n".join(lines)


def _machine(facts: list[dict[str, str]]) -> str:
    """Write what the runs of all parts share, once; the packages of each, and the loads, are joined."""
    lines = ["## Machine\n"]
    for name in facts[0]:
        found = [fact[name] for fact in facts]
        if name == "packages":
            found = [
                package for each in found for package in each.split(", ") if "not installed" not in package
            ]
        lines.append(f"- {name}: {', '.join(dict.fromkeys(found))}")
    return "\n".join(lines) + "\n"


def page(result: dict) -> str:
    """Write the part on solve_axis: table, limits, threads, what is missing."""
    columns = _columns(result)
    condition = f"random, condition number of the axis at most {problem.LARGEST_CONDITION:.0f}"
    parts = ["## solve_axis\n", CAVEATS.format(condition=condition, bytes=limits.BYTES_A_SOLVE)]
    rounds = ", ".join(f"{r} at N = {n}" for n, r in result["rounds"].items())
    parts += [
        f"Rounds: {rounds}; share of a processor: at least {min(result['processor share'].values()):.0%}.\n"
    ]
    rows = sorted(result["rows"], key=lambda row: row["sizes"]["1e5"]["ns a solve"])
    near = [row for row in rows if row["sizes"]["1e5"]["ratio"] <= FAR]
    header = [
        "ns a solve, one thread",
        *(f"N = {HEADERS[n]}" for n in columns),
        "ratio at 1e5",
        "at 1e7",
        "of bandwidth",
    ]
    body = [
        [
            _mark(row),
            *(_cell(row["sizes"], n, "ns a solve") for n in columns),
            _cell(row["sizes"], 100_000, "ratio"),
            _cell(row["sizes"], 10_000_000, "ratio"),
            _cell(row["sizes"], 10_000_000, "fraction of the limit"),
        ]
        for row in near
    ]
    far = ", ".join(f"`{r['name']}: {_cell(r['sizes'], 100_000, 'ratio')}`" for r in rows if r not in near)
    error = max(row["largest error"] for row in rows)
    parts += [
        table(header, body),
        f"\nRatios of the others at 1e5: {far}. Largest error of all: {error:.0e}.\n",
    ]
    parts += _limits(result) + _threads(result)
    parts += [f"Not measured: {item['name']} ({item['reason']})." for item in result["missing"]]
    return "\n".join(parts) + "\n"


def _mark(row: dict) -> str:
    name = row["name"] + ("" if row["strict"] else " †")
    return f"**{name}**" if row["family"] == OWN else name


def _limits(result: dict) -> list[str]:
    found = result["limits"]
    names = {
        "triad_streaming": "bandwidth, triad with non-temporal stores, one thread",
        "triad_streaming_2": "the same, two threads",
        "arithmetic": "arithmetic of the compact form alone, in the first cache, `-ffast-math`",
    }
    rows = [[text, number(found[name])] for name, text in names.items() if name in found]
    return [
        "The machine's own limits:\n",
        table(["limit", f"ns for a solve of {limits.BYTES_A_SOLVE} bytes"], rows) + "\n",
    ]


def _threads(result: dict) -> list[str]:
    rows = [
        [
            f"{name}, N = {n}",
            number(found["ns a solve"]),
            f"{1 / found['ratio']:.2f}",
            number(found.get("fraction of the limit of two threads")),
        ]
        for name, sizes in result["threads"].items()
        for n, found in sizes.items()
    ]
    if not rows:
        return []
    said = (
        "The gufunc releases the interpreter lock: threads work on slices of the same arrays (wall time).\n"
    )
    header = ["two threads", "ns a solve", "times as fast as one", "of two threads' bandwidth"]
    return [said, table(header, rows) + "\n"]
