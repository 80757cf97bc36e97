"""The 3-SPS-S machine's part of the page."""

from __future__ import annotations

WORDS = """\
## The 3-SPS-S machine

The hand-written forms of the direct problem do not treat equal legs, symmetric legs and singular poses, and return no
status. As many modes as rodgen: `numpy.roots` in {roots:.1%} of the cases, SciPy in {search:.0%}.
"""


def page(result: dict) -> str:
    lines = [
        WORDS.format(roots=result["same_by_roots"], search=result["same_by_search"]),
        "| | ns each | spread | ratio |",
        "| --- | ---: | ---: | ---: |",
    ]
    for row in result["rows"]:
        name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
        lines.append(f"| {name} | {row['ns']:,.1f} | {row['spread']:.0%} | {row['ratio']:,.2f} |")
    return "\n".join(lines) + "\n"
