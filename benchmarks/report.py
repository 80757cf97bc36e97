"""Write the measured rounds as one record (JSON) and one page (Markdown) that begins with its caveats."""

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
from contenders.base import OWN, YARDSTICK

HEADERS = {1: "1", 1_000: "1e3", 100_000: "1e5", 10_000_000: "1e7"}
PACKAGES = ("numpy", "scipy", "lmfit", "casadi", "jax", "sympy", "numba", "wrenfold", "ssik", "eaik")

SUBJECTS = ("tricept", "three_sps_s", "robots", "spatial", "diagnose", "workbench")
"""Parts that are packages of their own, with `measure.measure` and with `caveats`, `headline` and `page` in `page`."""

TITLE = """\
# Benchmarks

*Written by `make bench` (`python benchmarks/run.py`), or a part of it by `make bench ONLY=fits` (or `axis`,
`tricept`, `three_sps_s`, `robots`, `spatial`, `diagnose`, `workbench`); do not edit. With `--quick` it only prints a
shorter run. The peers are installed into environments of their own, `benchmarks/.venv-peers` and
`benchmarks/.venv-symforce`, from pinned requirements; their generated code is made at each run.*

Read these first:

- The figures come from one run on one shared machine: other tenants use its memory and its last-level cache. Ratios are
  taken within a round, so they are steadier than the times; *spread* is the interquartile range over
  the median of the samples. A difference smaller than the spread means nothing.
- Times are processor time unless they are called wall time, so time given to other processes is excluded (its effect on
  the caches is not).
- Each peer is set up as an expert in it would do.
- Rows marked † are compiled with `-ffast-math` (Numba: `fastmath=True`): the compiler may then assume that no
  NaN or infinity occurs and delete tests for them, and may call functions of lower accuracy. That is no
  option for a library that promises a status for invalid input; the rows show what it would gain.
"""

CAVEATS = """\
- One-thread figures are the thread's processor time; two-thread figures and their ratios are wall time. The
  share of a processor that the samples got is given below: if it is well under 100 %, the machine was busy and all
  figures are worse.
- The problem is small (some fifty operations and one tangent), so this compares how well each tool turns a
  short formula into a loop over memory. It says nothing about large expressions, derivatives or other subjects.
- Every closed-form peer evaluates the compact form e± = (κ m×r ± sqrt(max(|m|² − κ²|r|², 0)) m)/|m|²,
  κ = cot(χ/2), and nothing else. rodgen's general form does more work per solve: it rescales the input,
  corrects unequal lengths, keeps its accuracy near χ = π, ρ′ ≈ −ρ and tangency. Its short form (below) checks
  whether it applies, and both write a status. The inputs here
  are generic ones ({condition}), where the compact form is accurate too.
- The kernel decides block by block: where all elements are ordinary (two axes, well apart, lengths that differ by
  at most 1/2000) it runs a short form, otherwise the general one. The inputs here are ordinary throughout, which is
  its best case. In the row "measured lengths" |ρ′| is off by 1e-6, as measured points are: rodgen corrects that;
  the answers of the peers would be wrong by as much. In the row "1 % lengths differ" one element in a hundred is
  beyond the tolerance and gets a status that says so.
- Peers get outputs that are allocated and touched beforehand, `-O3 -march=native` where they are compiled, blocks that
  fit the cache where they are NumPy, analytic Jacobians and good starts where they iterate. rodgen ships portable code
  and chooses its instruction set when it runs.
- Numba from PyPI has no SVML, so it calls the scalar tangent.
- N = 1 is one call from Python with arrays of one element: it shows call overhead. Peers in C or C++ go
  through ctypes with addresses taken beforehand, which is less than any Python interface would cost.
- Slow contenders are timed on fewer solves than N; such figures are marked with the number timed.
- At N = 1e7 only non-temporal stores avoid reading each output line before it is overwritten. The limit
  shown counts {bytes} bytes per solve (56 in, 48 and a status byte out) at the triad's bandwidth with such
  stores.
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
    """Write the page of those parts that were ever measured: caveats, machine, headlines, tables."""
    from fits import page as fits
    from gpu import page as gpu

    axis, machines = parts.get("axis"), parts.get("fits")
    condition = f"random, condition number of the axis at most {problem.LARGEST_CONDITION:.0f}"
    lines = [TITLE]
    if machines:
        lines += ["Of fits of machines:\n", fits.caveats()]
    subjects = {
        name: (importlib.import_module(f"{name}.page"), found)
        for name in SUBJECTS
        if (found := parts.get(name))
    }
    if subjects:
        lines += [
            "Of mechanisms, robots, diagnoses and the workbench:\n",
            "".join(module.caveats() for module, _ in subjects.values()),
        ]
    if axis:
        lines += ["Of solve_axis:\n", CAVEATS.format(condition=condition, bytes=limits.BYTES_A_SOLVE)]
    lines += ["## Machine\n"]
    titled = {"fits": machines, **{name: found for name, (_, found) in subjects.items()}, "solve_axis": axis}
    facts = [part["machine"] for part in titled.values() if part]
    same = facts[0] if all(f == facts[0] for f in facts) else None
    if same:
        lines += [f"- {name}: {value}" for name, value in same.items()] + [""]
    else:
        for title, part in titled.items():
            if not part:
                continue
            lines += [
                f"For {title}:\n",
                *(f"- {name}: {value}" for name, value in part["machine"].items()),
                "",
            ]
    lines += ["## In short\n"]
    lines += [*fits.headline(machines), ""] if machines else []
    lines += [line for module, found in subjects.values() for line in (*module.headline(found), "")]
    lines += [*_headline(axis), ""] if axis else []
    lines += [fits.page(machines)] if machines else []
    lines += [module.page(found) for module, found in subjects.values()]
    lines += [page(axis)] if axis else []
    lines += [gpu.kept()]
    return "\n".join(lines)


def page(result: dict) -> str:
    """Write the part on solve_axis: tables, limits, threads, what is missing."""
    columns = _columns(result)
    parts = ["## solve_axis\n"]
    parts += [f"- rounds: {', '.join(f'{r} at N = {n}' for n, r in result['rounds'].items())}"]
    shares = ", ".join(f"{share:.0%} at N = {n}" for n, share in result["processor share"].items())
    parts += [f"- share of one processor that the samples had: {shares}\n"]
    rows = sorted(result["rows"], key=lambda row: row["sizes"]["1e5"]["ns a solve"])
    parts += ["### Time for one solve, one thread (ns)\n"]
    parts.append(
        table(
            ["contender", *(f"N = {HEADERS[n]}" for n in columns), "largest error"],
            [
                [
                    _mark(row),
                    *(_cell(row["sizes"], n, "ns a solve") for n in columns),
                    f"{row['largest error']:.0e}",
                ]
                for row in rows
            ],
        )
    )
    parts.append("\nA number in brackets is how many solves were timed where that is fewer than N.\n")
    if any(row["name"] == package.GUFUNC for row in rows):
        parts += [f"### The same as a multiple of {package.GUFUNC}\n"]
        header = ["contender", *(f"N = {HEADERS[n]}" for n in columns)]
        body = [[_mark(row), *(_cell(row["sizes"], n, "ratio") for n in columns)] for row in rows]
        if 10_000_000 in columns:
            header.append("fraction of the bandwidth limit at 1e7")
            for cells, row in zip(body, rows, strict=True):
                cells.append(_cell(row["sizes"], 10_000_000, "fraction of the limit"))
        parts += [table(header, body), ""]
    parts += _limits(result) + _threads(result)
    parts += ["### How each is set up\n", *(f"- {_mark(row)}: {row['note']}" for row in rows), ""]
    parts.append("### Not measured\n")
    parts += [f"- {item['name']}: {item['reason']}" for item in result["missing"]] or [
        "Nothing: all of them ran."
    ]
    return "\n".join(parts) + "\n"


def _mark(row: dict) -> str:
    name = row["name"] + ("" if row["strict"] else " †")
    return f"**{name}**" if row["family"] == OWN else name


def _fastest(rows: list[dict], n: str, *, strict: bool, family: str | None = None) -> dict | None:
    found = [
        row
        for row in rows
        if row["family"] not in (OWN, YARDSTICK)
        and (row["strict"] or not strict)
        and (family is None or row["family"] == family)
        and n in row["sizes"]
    ]
    return min(found, key=lambda row: row["sizes"][n]["ns a solve"], default=None)


def _headline(result: dict) -> list[str]:
    rows = {row["name"]: row for row in result["rows"]}
    own = rows.get(package.GUFUNC)
    if own is None:
        return []
    lines = []
    for n in ("1e5", "1e7"):
        if n not in own["sizes"]:
            continue
        peer, loose = (_fastest(result["rows"], n, strict=s) for s in (True, False))
        text = f"- N = {n}: {number(own['sizes'][n]['ns a solve'])} ns a solve"
        text += f" (spread {own['sizes'][n]['spread']:.0%})"
        text += f"; the fastest peer, {peer['name']}, takes {number(peer['sizes'][n]['ratio'])} times as long"
        if loose is not peer:
            text += f"; of the † rows, {loose['name']} takes "
            text += f"{number(loose['sizes'][n]['ratio'])} times as long"
        yardsticks = [row for row in result["rows"] if row["family"] == YARDSTICK and n in row["sizes"]]
        for row in yardsticks:
            text += f"; {_mark(row)} takes {number(row['sizes'][n]['ratio'])} times as long"
        if "fraction of the limit" in own["sizes"][n]:
            text += f"; {own['sizes'][n]['fraction of the limit']:.0%} of what the measured bandwidth allows"
        lines.append(text + ".")
    lines.append(f"- One solve on its own: {own['sizes']['1']['ns a solve'] / 1000:.2f} µs a call.")
    fallback, peer = rows.get(package.FALLBACK), _fastest(result["rows"], "1e5", strict=True, family="NumPy")
    if fallback and peer:
        quotient = peer["sizes"]["1e5"]["ns a solve"] / fallback["sizes"]["1e5"]["ns a solve"]
        lines.append(
            f"- NumPy fallback at N = 1e5: the fastest NumPy peer, {peer['name']}, takes "
            f"{quotient:.2f} times as long."
        )
    busy = ", on a machine too busy to tell" if min(result["processor share"].values()) < 0.9 else ""
    for name, sizes in result["threads"].items():
        for n, found in sizes.items():
            lines.append(f"- {name}, N = {n}: {1 / found['ratio']:.2f} times as fast as one thread{busy}.")
    return lines


def _limits(result: dict) -> list[str]:
    found = result["limits"]
    names = {
        "triad": "triad, plain stores, one thread",
        "triad_streaming": "triad, non-temporal stores, one thread",
        "triad_2": "triad, plain stores, two threads",
        "triad_streaming_2": "triad, non-temporal stores, two threads",
    }
    rows = [
        [text, f"{limits.BYTES_A_SOLVE / found[name]:.1f}", number(found[name])]
        for name, text in names.items()
        if name in found
    ]
    parts = ["### The machine's own limits\n"]
    parts.append(
        table(["memory", "GB/s", f"ns for the {limits.BYTES_A_SOLVE} bytes of a solve"], rows) + "\n"
    )
    moved = {
        "traffic 1e5": "plain stores, N = 1e5",
        "traffic_streaming 1e5": "non-temporal stores, N = 1e5",
        "traffic 1e7": "plain stores, N = 1e7",
        "traffic_streaming 1e7": "non-temporal stores, N = 1e7",
    }
    rows = [[text, number(found[name])] for name, text in moved.items() if name in found]
    if rows:
        parts += ["What a solve reads and writes, without its arithmetic, one thread:\n"]
        parts.append(table(["moved by", "ns a solve"], rows) + "\n")
    if "arithmetic" in found:
        parts.append(
            "Arithmetic: the compact form alone, on component arrays in the first cache, compiled with\n"
            "`-ffast-math` (vector tangent from libmvec, nothing tested), takes "
            f"{number(found['arithmetic'])} ns a solve on one thread.\n"
            "It has two divisions, a square root and a tangent; a kernel with statuses and safe ranges has\n"
            "more, so below that only a cheaper formula would go.\n"
        )
    return parts


def _threads(result: dict) -> list[str]:
    if not result["threads"]:
        return []
    parts = [
        "### Two threads\n",
        "The gufunc releases the GIL, so threads on slices of the same arrays are all it takes:\n",
        "```python",
        "def work(part):",
        "    rodgen.solve_axis(rho[part], rho_prime[part], angle[part], out=(axes[part], status[part]))",
        "",
        "half = len(angle) // 128 * 64          # parts that start on a cache line of every array",
        "with ThreadPoolExecutor(2) as pool:",
        "    list(pool.map(work, [slice(0, half), slice(half, None)]))",
        "```\n",
    ]
    rows = [
        [
            name,
            f"N = {n}",
            number(found["ns a solve"]),
            f"{1 / found['ratio']:.2f}",
            number(found.get("fraction of the limit of two threads")),
        ]
        for name, sizes in result["threads"].items()
        for n, found in sizes.items()
    ]
    header = ["", "N", "ns a solve", "times as fast as one thread", "fraction of two threads' bandwidth"]
    if min(result["processor share"].values()) < 0.9:
        parts.append(
            "The machine was busy in this run: two threads did not have two processors, so no gain shows.\n"
        )
    return [*parts, table(header, rows) + "\n"]
