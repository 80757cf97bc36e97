"""The 3-SPS-S machine's part of the page."""

from __future__ import annotations

OWN, OWN_DIRECT = "rodgen: legs", "rodgen: direct_all, all modes"


def caveats() -> str:
    return (
        "- 3-SPS-S: the hand-written forms of the direct problem omit rodgen's treatment of hard cases (equal legs,\n"
        "  symmetric legs, singular poses), do not polish and return no status. The search may miss modes.\n"
    )


def headline(result: dict) -> list[str]:
    rows = {row["name"]: row for row in result["rows"]}
    own, direct = rows[OWN], rows[OWN_DIRECT]
    return [
        f"- 3-SPS-S, legs of {result['n']:,} orientations: {own['ns']:.1f} ns each. A loop takes "
        f"{rows['NumPy, a loop over orientations']['ratio']:.0f} times as long, vectorised NumPy "
        f"{rows['NumPy, vectorised']['ratio']:.0f} times.",
        f"- 3-SPS-S, all assembly modes: {1e9 / direct['ns']:,.0f} triples of legs a second in one thread; a loop with "
        f"numpy.roots takes {rows['NumPy, a loop with numpy.roots']['ratio']:.0f} times as long, and SciPy from 40 "
        f"starts {rows['SciPy, root from 40 starts']['ratio']:,.0f} times.",
    ]


def page(result: dict) -> str:
    lines = [
        "## The 3-SPS-S machine\n",
        f"- rounds: {result['rounds']}; share of one processor that the samples had: {result['share']:.0%}",
        f"- as many modes as rodgen: numpy.roots in {result['same_by_roots']:.1%}, SciPy's search in "
        f"{result['same_by_search']:.0%} of the cases\n",
        "| | elements timed | ns each | spread | as a multiple of rodgen |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for row in result["rows"]:
        name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
        lines.append(
            f"| {name} | {row['points']:,} | {row['ns']:,.1f} | {row['spread']:.0%} | {row['ratio']:,.2f} |"
        )
    return "\n".join(lines) + "\n"
