"""Write the results of `fits.measure` as a section of the page of benchmarks."""

from __future__ import annotations

from typing import Any

from report import number, table

from fits.contenders import EXACT, NUMERICAL, OWN, SAME

SINE_COSINE = 22
"""Fused multiply-adds of a sine and its cosine in a kernel, without bit operations."""

BARS = {NUMERICAL: 20, EXACT: 3, SAME: 3}

WORDS = """\
A fit starts at the ideal machine. It ends where no step changes a parameter by a ten-thousandth of its standard
deviation (rodgen), or at the library's own tolerances. All contenders reach the same minimum: the cost within {cost},
all parameters together within {std} standard deviations.

- The mount is a telescope's (80 measured stars). The positioner has two rotary axes, three balls and a camera at an
  unknown place. The arm has six rotary joints and a reflector.
- All get checked arrays in rad and mm. Peers also get the start of a free frame and the sines and cosines of the
  commands; rodgen computes both within its time.
- Times are of all threads; BLAS has one. From 16384 rows on rodgen uses two threads, JAX as many as it likes.
- CasADi and JAX exclude derivation and compilation (up to some seconds). CasADi's function is compiled C in a loop over
  rows, with JᵀJ by BLAS in blocks that fit the cache. JAX has the fastest of the forms that were tried.
- SciPy and lmfit get vectorised NumPy residuals (`benchmarks/fits/formulas.py`).
- *rodgen's driver* is rodgen's damped least squares: only residuals and derivatives then differ.
- With few rows calls and small matrices dominate: a driver in Python costs about 50 µs a step.
"""


def page(result: dict[str, Any]) -> str:
    """Return the tables."""
    from fits.measure import COST_WITHIN, STD_WITHIN

    parts = ["## Fits of machines\n", WORDS.format(cost=f"{COST_WITHIN:.0e}", std=f"{STD_WITHIN:.0e}")]
    parts += [_fits(result["cases"]), _goals(result["cases"])]
    parts += [_large(result["large"])] if result["large"] else []
    parts += [_derive(result["derive"]), _kernels(result["kernels"])]
    parts += [f"Not measured: {item['name']} ({item['reason']}).\n" for item in result["missing"]]
    return "\n".join(parts)


def _fits(cases: list[dict[str, Any]]) -> str:
    """Return one table of all fits: time, and in brackets as a multiple of rodgen's."""
    rows = [{row["name"]: row for row in case["contenders"]} for case in cases]
    first = sorted(cases[-1]["contenders"], key=lambda row: (row["family"] != OWN, row["ms"]))
    names = list(dict.fromkeys([*(row["name"] for row in first), *(name for case in rows for name in case)]))
    body = []
    for name in names:
        one = next(case[name] for case in rows if name in case)
        shown = f"**{name}**" if one["family"] == OWN else name if one["strict"] else f"{name} †"
        cells = [f"{_time(c[name]['ms'])} ({number(c[name]['ratio'])})" if name in c else "–" for c in rows]
        body.append([shown, "" if one["family"] == OWN else one["family"], *cells])
    header = [f"{case['name']}, {case['parameters']} parameters" for case in cases]
    return table(["time (ratio)", "", *header], body) + "\n"


def _goals(cases: list[dict[str, Any]]) -> str:
    said = []
    for family, bar in BARS.items():
        reached = [
            case["name"]
            for case in cases
            if min(
                (r["ratio"] for r in case["contenders"] if r["family"] == family and r["strict"]), default=0
            )
            >= bar
        ]
        article = "a" if family == NUMERICAL else "an"
        said.append(
            f"- {bar} times the speed with {article} {family}: {'; '.join(reached) or '**not reached**'}"
        )
    return "\n".join(["Goals, and the cases in which they are reached:\n", *said]) + "\n"


def _time(ms: float) -> str:
    return f"{ms * 1000:.0f} µs" if ms < 1 else f"{ms:.3g} ms" if ms < 1000 else f"{ms / 1000:.2f} s"


def _large(found: list[dict[str, Any]]) -> str:
    header = ["the arm, 30 parameters", "checked and bound", "fit", "ns a row", "memory"]
    body = [
        [
            f"{item['rows']:,} rows",
            f"{item['bind']:.2f} s",
            f"{item['fit']:.2f} s",
            f"{item['fit'] / item['rows'] * 1e9:.0f}",
            f"{item['resident'] / 2**20:.0f} MiB",
        ]
        for item in found
    ]
    return f"Many rows, in a process of its own; memory has libraries and the table in it:\n\n{table(header, body)}\n"


def _derive(found: dict[str, Any]) -> str:
    header = ["", "rodgen imported", "machine read", "kernels", "whole process", "processor"]
    body = [
        [name, *(f"{item[key]:.3f} s" for key in ("rodgen", "machine", "kernels", "all", "processor"))]
        for name, item in (("nothing in the cache", found["cold"]), ("from the cache", found["cached"]))
    ]
    words = f"A model of six joints and {found['cold']['parameters']} parameters is made in a new process (wall time):"
    return f"{words}\n\n{table(header, body)}\n"


def _kernels(found: dict[str, Any]) -> str:
    body = []
    for name, words in (("residual", "residuals"), ("residual_and_jacobian", "residuals and Jacobian")):
        count = found["operations"][name]
        work = sum(count.get(op, 0) for op in ("add", "sub", "mul")) / 2 + SINE_COSINE * count.get("sin", 0)
        limit = work / found["products a ns"]
        ours, numpy = found["C"][name], found["NumPy"][name]
        body.append([words, number(ours), number(limit), f"{limit / ours:.0%}", number(numpy)])
    words = (
        "Kernels of the arm, one thread. The limit is arithmetic: the vector units do "
        f"{found['products a ns']:.1f} products\nwith a sum a nanosecond, measured in the same run. A sine with its "
        f"cosine counts as {SINE_COSINE}.\n"
    )
    return f"{words}\n{table(['a row', 'C (ns)', 'limit (ns)', 'of the limit', 'NumPy (ns)'], body)}\n"
