"""The part of the page about a graphics processor."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

KEPT = Path(__file__).parent.parent / "results/gpu.json"
GOAL = 0.8
TITLE = "## On a graphics processor\n"


def kept() -> str:
    """Return the page of what `benchmarks/gpu/measure.py` wrote last."""
    return page(json.loads(KEPT.read_text())) if KEPT.exists() else f"{TITLE}\nNot measured.\n"


def page(result: dict) -> str:
    made = [each for each in result["contenders"] if "failed" not in each]
    rows = result["rows"]
    devices = ", ".join(sorted({each["device"] for each in made})) or "no device"
    about = (
        f"`benchmarks/gpu/measure.py`, {devices}, {rows:,} rows, float64 unless a row says otherwise. The generated "
        "modules run on arrays of each library; the last contender is `generated/c/axis.c`, compiled for the device. "
        "*Share* is that of the bandwidth of a copy by the same library. *Error* is the largest difference to NumPy."
    )
    lines = [
        TITLE,
        textwrap.fill(about, 118),
        "\n| | ns a row | share | error | s to compile |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for each in made:
        for title, row in each["tasks"].items():
            name = f"{each['name']} ({each['version']}): {title}"
            if "seconds" not in row:
                lines.append(f"| {name} | {row.get('failed', 'not timed')} | | | |")
                continue
            share = row["bytes"] / row["seconds"] / each["bandwidth"]
            time = f"{1e9 * row['seconds'] / rows:.3f}"
            lines.append(f"| {name} | {time} | {share:.2f} | {row['error']:.0e} | {row['to_compile']:.0f} |")
    shares = [
        (row["bytes"] / row["seconds"] / each["bandwidth"], title, each["name"])
        for each in made
        for title, row in each["tasks"].items()
        if "seconds" in row
    ]
    if shares:
        best, title, name = max(shares)
        reached = "reached" if best >= GOAL else "**not reached**"
        lines.append(
            f"\nThe goal of {GOAL} of the bandwidth is {reached}: {best:.2f} at best ({name}, {title})."
        )
    lines += [f"\n{each['name']}: {each['failed']}." for each in result["contenders"] if "failed" in each]
    return "\n".join(lines) + "\n"
