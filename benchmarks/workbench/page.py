"""The part of the page on the workbench."""

from __future__ import annotations

from typing import Any

from report import table

BARS = {"first view": 2.0, "telescope, 1e5 rows": 1.0}
"""Wall time that is wanted, seconds, of any first view and of actions on a case."""
USUAL = 0.3
"""Of actions on all other cases."""


def caveats() -> str:
    """Return the caveats that precede the figures."""
    return (
        "- The page of `rodgen open` is used in headless Chromium on a server of its own. The first view counts from\n"
        "  the start of the command, with the browser open and nothing in its cache; an action from the click. Both\n"
        "  end when the last plot that follows is painted. These are wall times, because two programs take turns: on\n"
        "  a busy machine they are longer; the processor time of each, until then, says by how much.\n"
        "- Headless Chromium draws by the processor; with a graphics processor less of it is needed.\n"
    )


def headline(result: dict[str, Any]) -> list[str]:
    """Return the main figures, one per line."""
    found = []
    for name, case in result["cases"].items():
        slowest = max(item["wall"] for what, item in case.items() if not what.startswith("first view"))
        first = case["first view"]["wall"]
        found.append(f"{name}: first view {first:.1f} s, slowest action {slowest:.2f} s")
    return [f"- Workbench, wall time: {'; '.join(found)}."]


def page(result: dict[str, Any]) -> str:
    """Return the table."""
    body = []
    for name, case in result["cases"].items():
        for what, item in case.items():
            bar = BARS.get("first view" if what.startswith("first view") else name, USUAL)
            times = [f"{item[key]:.2f} s" for key in ("wall", "server", "browser")]
            share = f"{item['wall'] / bar:.2f}"
            body.append([f"{name}: {what}", times[0], f"{bar:g} s", share, *times[1:]])
    header = ["", "wall time", "goal", "share of the goal", "processor, server", "processor, browser"]
    said = f"\nChromium {result['browser']}; load of the machine after the run {result['load after the run']:.1f}.\n"
    return "\n".join(["## The workbench\n", table(header, body), said])
