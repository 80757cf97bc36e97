"""The part of the page on whole diagnoses."""

from __future__ import annotations

from typing import Any

from report import table

from diagnose import picture

BARS = {
    "telescope, 80 rows": 0.3,
    "telescope, 80 rows, nothing in the cache": 1.5,
    "6 joints, 108 rows": 1.0,
    "8 joints, 102 rows": 1.0,
    "8 joints, 999 rows": 1.0,
    "11 joints, 402 rows": 8.0,
    "6 joints, loads, temperatures, 1e5 rows": 3.0,
}
"""Processor time of a diagnosis that is wanted, seconds."""


def caveats() -> str:
    """Return the caveats that precede the figures."""
    return (
        "- A *diagnosis* is the command `rodgen diagnose` in a process of its own: Python's start and all imports are\n"
        "  in its time, and given in a column of their own. Its kernels are in the cache unless it says otherwise.\n"
        "- The chains have rotary joints, three reflectors in the free frame of a tracker, all axes estimated, noise\n"
        "  and correlation unknown, and one hidden effect. No peer diagnoses; there is nothing to compare with.\n"
        "- Where parameters grow, the directions of the axes are estimated alone, then also their places and the\n"
        "  reflectors, then one, two and four effects that the machine file declares at each joint.\n"
    )


def headline(result: dict[str, Any]) -> list[str]:
    """Return the main figures, one per line."""
    said = ", ".join(f"{name} {item['all']:.2g} s" for name, item in result["cases"].items())
    return [f"- Diagnosis, processor time with Python's start: {said}."]


def page(result: dict[str, Any]) -> str:
    """Return the tables."""
    body = []
    for name, item in result["cases"].items():
        start, memory = f"{item['start']:.2f} s", f"{item['memory']:.0f} MiB"
        body.append([name, f"{item['all']:.2f} s", start, _goal(name, item["all"]), memory])
        if "cold" in item:
            cold = f"{name}, nothing in the cache"
            body.append([cold, f"{item['cold']:.2f} s", "", _goal(cold, item["cold"]), ""])
    parts = ["## Diagnoses\n", table(["", "processor", "of it the start", "goal", "memory"], body)]
    parts.append(f"\n![{picture.alt_text(result['growth'])}]({picture.NAME})")
    for of, items in result["growth"].items():
        parts.append(f"\n### Growth with {of}\n")
        counts = [name for name in ("joints", "rows", "parameters") if name in items[0]]
        rows = [
            [
                *(f"{item[name]:,}" for name in counts),
                f"{item['all']:.2f} s",
                f"{(item['all'] - item['start']) / item['rows'] * 1e6:.0f} µs",
                f"{item['memory']:.0f} MiB",
            ]
            for item in items
        ]
        parts.append(table([*counts, "processor", "a row, without the start", "memory"], rows))
    return "\n".join(parts) + "\n"


def _goal(name: str, seconds: float) -> str:
    bar = BARS.get(name)
    return "–" if bar is None else f"{bar:g} s, {'reached' if seconds <= bar else '**not reached**'}"
