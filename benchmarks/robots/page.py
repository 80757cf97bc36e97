"""The robots' part of the page."""

from __future__ import annotations

WORDS = """\
## Robots with six revolute joints

All solutions of a pose. rodgen takes arrays of poses; the peers take one pose a call, EAIK also a list. All three find
as many solutions in {same} poses; angles differ by at most {apart:.0e} rad. Checks of each solution by the forward
analysis are part of ssik, and in rodgen near degenerate poses. The forward analysis of ssik is timed in Python.
"""


def page(result: dict) -> str:
    robots = result["robots"]
    few = result["few"]
    same = f"{sum(few - robot['counts'] for robot in robots.values())} of {few * len(robots)}"
    rows = {name: {row["name"]: row for row in robot["rows"]} for name, robot in robots.items()}
    order = sorted(next(iter(robots.values()))["rows"], key=lambda row: (row["kind"] == "forward", row["ns"]))
    lines = [
        WORDS.format(same=same, apart=max(robot["apart"] for robot in robots.values())),
        "| ns a pose (ratio) | " + " | ".join(robots) + " |",
        "| --- |" + " ---: |" * len(robots),
    ]
    for one in order:
        shown = f"**{one['name']}**" if one["name"].startswith("rodgen") else one["name"]
        cells = [
            f"{rows[name][one['name']]['ns']:,.0f} ({rows[name][one['name']]['ratio']:,.1f})"
            for name in robots
        ]
        lines.append(f"| {shown} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
