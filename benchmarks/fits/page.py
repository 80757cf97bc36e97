"""Write the results of `fits.measure` as a section of the page of benchmarks."""

from __future__ import annotations

from typing import Any

from report import number, table

from fits.contenders import EXACT, FIT, NUMERICAL, OWN, SAME

SINE_COSINE = 22
"""Fused multiply-adds of a sine and its cosine in a kernel, without bit operations."""

BARS = {NUMERICAL: 20, EXACT: 3, SAME: 3}

CAVEATS = """\
- A *fit* starts at the ideal machine and ends where no step changes a parameter by a ten-thousandth of its standard
  deviation (rodgen), or where the library's own tolerances are met. All contenders must reach the same minimum, the
  cost within {cost} and all parameters together within {std} standard deviations, or are left out of the tables.
- All contenders get checked arrays in memory, in radians and millimetres, and do not check them again; the rows of
  rodgen say where it does. Peers get the closed-form start of a free frame, and the sines and cosines of
  the commands, at no cost; rodgen computes both within its time. Only the second row of rodgen, and none of the
  peers, estimates standard deviations.
- Fits are timed as processor time of all threads, because some have one and others two; wall time is given as well.
  BLAS has one thread everywhere. From 16384 rows on rodgen uses two threads, JAX as many as it likes.
- The times of CasADi and JAX exclude derivation and compilation, which have a column of their own. rodgen finds its
  kernels in its cache; the time to make them is given below.
- The residuals of SciPy and lmfit are vectorised NumPy with few and large operations, one matrix product per link, and
  quantities common to all rows outside of the arrays (`benchmarks/fits/formulas.py`). CasADi and JAX differentiate the
  formulas of one row, and what is common to all rows separately, as rodgen does; CasADi's function is written as C
  and compiled into a loop over rows, with JᵀJ by BLAS from blocks that fit the cache; JAX has the fastest of the forms
  that were tried. *rodgen's driver* is the damped least-squares method of rodgen, so that only residuals and
  derivatives differ; *SciPy least_squares* is what one would use without it.
- With few rows the time of a fit is that of calls and small matrices, not of arithmetic: a driver written in Python
  costs about 50 µs per step, whatever the derivatives cost.
"""


def caveats() -> str:
    """Return the caveats that precede the figures."""
    from fits.measure import COST_WITHIN, STD_WITHIN

    return CAVEATS.format(cost=f"{COST_WITHIN:.0e}", std=f"{STD_WITHIN:.0e}")


def headline(result: dict[str, Any]) -> list[str]:
    """Return the main figures, one per line."""
    lines = []
    for case in result["cases"]:
        rows = {row["name"]: row for row in case["contenders"]}
        own = rows[FIT]
        said = []
        for family in (NUMERICAL, EXACT, SAME):
            peer = _fastest(case, family)
            if peer:
                said.append(f"{peer['name']} takes {number(peer['ratio'])} times as long")
        lines.append(
            f"- {case['name']}, {case['parameters']} parameters: {_time(own['ms'])}; {'; '.join(said)}."
        )
    large = {item["rows"]: item for item in result["large"]}
    if large:
        most = large[max(large)]
        lines.append(
            f"- {most['rows']:,} rows: {most['fit']:.1f} s of a processor, {most['fit'] / most['rows'] * 1e9:.0f} ns a "
            f"row, {most['resident'] / 2**20:.0f} MiB of memory."
        )
    cold, cached = result["derive"]["cold"], result["derive"]["cached"]
    lines.append(
        f"- A model of {cold['parameters']} parameters is derived, generated and compiled in {cold['kernels']:.1f} s, "
        f"and loaded from the cache in {cached['machine'] + cached['kernels']:.3f} s, with all imports in "
        f"{cached['all']:.2f} s."
    )
    return lines


def page(result: dict[str, Any]) -> str:
    """Return the tables."""
    parts = ["## Fits of machines\n"]
    parts += [
        "Three machines: the mount of a telescope with 80 measured stars (real data), a positioner with two rotary\n"
        "axes, three balls and a camera whose place is not known, and a robot with six rotary joints and a reflector.\n"
    ]
    for case in result["cases"]:
        parts += [_case(case)]
    parts += [_large(result["large"])] if result["large"] else []
    parts += [_derive(result["derive"]), _kernels(result["kernels"])]
    parts.append("### Fits that were not measured\n")
    parts += [f"- {item['name']}: {item['reason']}" for item in result["missing"]] or ["None."]
    return "\n".join(parts) + "\n"


def _fastest(case: dict[str, Any], family: str) -> dict[str, Any] | None:
    found = [row for row in case["contenders"] if row["family"] == family and row["strict"]]
    return min(found, key=lambda row: row["ratio"], default=None)


def _case(case: dict[str, Any]) -> str:
    rows = sorted(case["contenders"], key=lambda row: (row["family"] != OWN, row["ms"]))
    title = f"### {case['name'][0].upper()}{case['name'][1:]}, {case['parameters']} parameters\n"
    header = [
        "contender",
        "",
        "a fit",
        "as a multiple",
        "wall",
        "spread",
        "cost off",
        "std off",
        "compiled in",
    ]
    body = [
        [
            ("**" + row["name"] + "**" if row["family"] == OWN else row["name"])
            + ("" if row["strict"] else " †"),
            "" if row["family"] == OWN else row["family"],
            _time(row["ms"]),
            number(row["ratio"]),
            _time(row["wall ms"]),
            f"{row['spread']:.0%}",
            "" if row["family"] == OWN else f"{abs(row['cost']):.0e}",
            "" if row["family"] == OWN else f"{row['std']:.0e}",
            "" if row["compile"] is None else f"{row['compile']:.1f} s",
        ]
        for row in rows
    ]
    said = [f"{case['rounds']} rounds."]
    for family, bar in BARS.items():
        peer = _fastest(case, family)
        if peer:
            verdict = "reached" if peer["ratio"] >= bar else "**not reached**"
            said.append(
                f"The goal of {bar} times the speed with {'a' if family == NUMERICAL else 'an'} {family} is {verdict}: "
                f"{number(peer['ratio'])} ({peer['name']})."
            )
    return f"{title}\n{table(header, body)}\n\n{' '.join(said)}\n"


def _time(ms: float) -> str:
    return f"{ms * 1000:.0f} µs" if ms < 1 else f"{ms:.3g} ms" if ms < 1000 else f"{ms / 1000:.2f} s"


def _large(found: list[dict[str, Any]]) -> str:
    header = [
        "rows",
        "checked and bound",
        "fit",
        "ns a row",
        "wall of both",
        "steps",
        "rms (mm)",
        "memory",
    ]
    body = [
        [
            f"{item['rows']:,}",
            f"{item['bind']:.2f} s",
            f"{item['fit']:.2f} s",
            f"{item['fit'] / item['rows'] * 1e9:.0f}",
            f"{item['wall of both']:.2f} s",
            str(item["iterations"]),
            f"{item['rms']:.5f}",
            f"{item['resident'] / 2**20:.0f} MiB",
        ]
        for item in found
    ]
    words = (
        "The robot with 30 parameters, rodgen alone, in a process of its own. Normal equations are summed up\n"
        "block by block. *Memory* is the largest size of the process, libraries and the table included. Times are of\n"
        "processors, both threads.\n"
    )
    return f"### Many rows\n\n{words}\n{table(header, body)}\n"


def _derive(found: dict[str, Any]) -> str:
    header = [
        "",
        "NumPy imported",
        "rodgen imported",
        "machine read",
        "kernels",
        "whole process",
        "processor",
    ]
    body = [
        [
            name,
            *(f"{item[key]:.3f} s" for key in ("numpy", "rodgen", "machine", "kernels", "all", "processor")),
        ]
        for name, item in (("nothing in the cache", found["cold"]), ("from the cache", found["cached"]))
    ]
    words = (
        f"A robot with six joints and {found['cold']['parameters']} parameters, each time in a new process: wall\n"
        "time, medians. The processor time is that of Python's start and of the compiler, too.\n"
    )
    return f"### Making a model\n\n{words}\n{table(header, body)}\n"


def _kernels(found: dict[str, Any]) -> str:
    body = []
    for name, words in (("residual", "residuals"), ("residual_and_jacobian", "residuals and Jacobian")):
        count = found["operations"][name]
        work = sum(count.get(op, 0) for op in ("add", "sub", "mul")) / 2 + SINE_COSINE * count.get("sin", 0)
        limit = work / found["products a ns"]
        body.append(
            [
                words,
                ", ".join(f"{n} {kind}" for kind, n in count.items()),
                number(found["C"][name]),
                number(limit),
                f"{limit / found['C'][name]:.0%}",
                number(found["NumPy"][name]),
            ]
        )
    name = "normal equations"
    body.append(["normal equations", "", number(found["C"][name]), "–", "–", number(found["NumPy"][name])])
    words = (
        "The robot with 30 parameters, three residuals a row, one thread, in blocks as a fit uses them. The limit is\n"
        f"what this processor's vector units can do: {found['products a ns']:.1f} products with a sum a nanosecond, "
        "measured\nin the same run; a sum and a product count as one where they could be, a sine with its cosine as "
        f"{SINE_COSINE}.\nWhat is read and written is not in it: a row's Jacobian has 720 bytes.\n"
    )
    header = ["a row", "operations", "C (ns)", "limit (ns)", "part of the limit", "NumPy (ns)"]
    return f"### Kernels\n\n{words}\n{table(header, body)}\n"
