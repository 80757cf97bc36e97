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
        f"Written by `benchmarks/gpu/measure.py` on {devices}. The generated modules run on arrays of each library; "
        f"the last contender is `generated/c/axis.c` as it stands, compiled for the device. {rows:,} rows; float64 "
        "unless it says otherwise. *Share*: of the bandwidth of a copy by the same library, bytes read and written, "
        "for the bytes that a call must read and write at least. *Error*: largest difference to NumPy's answer in "
        "float64, relative to the largest number."
    )
    lines = [
        TITLE,
        textwrap.fill(about, 118),
        "\n| | | ns a row | GB/s | share | error | s to compile |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for each in made:
        lines.append(
            f"| {each['name']} ({each['version']}) | copy | | {each['bandwidth'] / 1e9:,.0f} | | | |"
        )
        for title, row in each["tasks"].items():
            if "seconds" not in row:
                lines.append(
                    f"| | {title} | {row.get('failed', 'not timed')} | | | | {row['to_compile']:.0f} |"
                )
                continue
            speed = row["bytes"] / row["seconds"]
            lines.append(
                f"| | {title} | {1e9 * row['seconds'] / rows:.3f} | {speed / 1e9:,.0f} | "
                f"{speed / each['bandwidth']:.2f} | {row['error']:.0e} | {row['to_compile']:.0f} |"
            )
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
