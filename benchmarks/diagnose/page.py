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


WORDS = """\
## Diagnoses

`rodgen diagnose` in a process of its own, with Python's start. Kernels are in the cache unless a row says otherwise.
The chains have rotary joints, three reflectors seen by a tracker, all axes estimated, unknown noise and correlation,
and one hidden effect. No peer answers this question.
"""


def page(result: dict[str, Any]) -> str:
    """Return the tables."""
    body = []
    for name, item in result["cases"].items():
        start, memory = f"{item['start']:.2f} s", f"{item['memory']:.0f} MiB"
        body.append([name, f"{item['all']:.2f} s", start, _goal(name, item["all"]), memory])
        if "cold" in item:
            cold = f"{name}, nothing in the cache"
            body.append([cold, f"{item['cold']:.2f} s", "", _goal(cold, item["cold"]), ""])
    parts = [WORDS, table(["", "processor", "of it the start", "goal", "memory"], body)]
    parts.append(f"\n![{picture.alt_text(result['growth'])}]({picture.NAME})\n")
    return "\n".join(parts)


def _goal(name: str, seconds: float) -> str:
    bar = BARS.get(name)
    return "–" if bar is None else f"{bar:g} s, {'reached' if seconds <= bar else '**not reached**'}"
