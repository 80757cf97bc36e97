"""The Tricept's part of the page."""

from __future__ import annotations

WORDS = """\
## The Tricept

All points share one covariance U_x. rodgen checks its input and returns a status; the hand-written NumPy does neither.
Results agree to 1e-9.
"""


def page(result: dict) -> str:
    lines = [WORDS, "| | ns a point | spread | ratio |", "| --- | ---: | ---: | ---: |"]
    for row in sorted(result["rows"], key=lambda row: row["ns"]):
        name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
        lines.append(f"| {name} | {row['ns']:,.0f} | {row['spread']:.0%} | {row['ratio']:,.2f} |")
    return "\n".join(lines) + "\n"
