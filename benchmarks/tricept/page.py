"""The Tricept's part of the page."""

from __future__ import annotations

OWN = "rodgen: pose and propagate"


def caveats() -> str:
    return (
        "- All points share one covariance U_x, and q is the platform's centre; the hand-written forms use both.\n"
        "- rodgen checks its input, including U_x, and returns a status; the hand-written forms do neither. Their\n"
        "  results agree with rodgen's to 1e-9. Each call allocates its arrays.\n"
        "- The loop is timed on fewer points than the others; the table assumes its time per point for all points.\n"
    )


def headline(result: dict) -> list[str]:
    rows = {row["name"]: row for row in result["rows"]}
    fastest = min(
        (row for name, row in rows.items() if name.startswith("NumPy") and "loop" not in name),
        key=lambda row: row["ns"],
    )
    loop, direct = rows["NumPy, a loop over points"], rows["rodgen: direct, the assembled machine's pose"]
    return [
        f"- Tricept, inverse problem and A35·U_x·A35ᵀ on {result['n']:,} points: {rows[OWN]['ns']:.0f} ns a point. "
        f"A loop over points takes {loop['ratio']:.0f} times as long, the fastest vectorised NumPy by hand "
        f"({fastest['name'].removeprefix('NumPy, ')}) {fastest['ratio']:.1f} times.",
        f"- Tricept, direct problem: {1e9 / direct['ns']:,.0f} a second in one thread.",
    ]


def page(result: dict) -> str:
    lines = [
        "## The Tricept\n",
        f"- rounds: {result['rounds']}; share of one processor that the samples had: {result['share']:.0%}\n",
        "| | points timed | ns a point | spread | as a multiple of rodgen |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for row in sorted(result["rows"], key=lambda row: row["ns"]):
        name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
        lines.append(
            f"| {name} | {row['points']:,} | {row['ns']:,.0f} | {row['spread']:.0%} | {row['ratio']:.2f} |"
        )
    return "\n".join(lines) + "\n"
