"""The robots' part of the page."""

from __future__ import annotations


def caveats() -> str:
    return (
        "- rodgen takes arrays of poses, the peers one pose per call (EAIK also a list); a call from Python costs\n"
        "  them about a microsecond. One pose per call is slower in rodgen than in the peers: see the row so called.\n"
        "- ssik checks each solution by the forward analysis; rodgen does so only near degenerate poses. If there is\n"
        "  no solution, EAIK returns a flagged least-squares answer, rodgen a status.\n"
        "- ssik's compiled forward analysis is C++ without a Python interface; the row is its Python function.\n"
    )


def headline(result: dict) -> list[str]:
    parts = []
    for name, robot in result["robots"].items():
        rows = {row["name"]: row for row in robot["rows"]}
        reverse = min(
            (
                row
                for row in robot["rows"]
                if row["kind"] == "reverse" and not row["name"].startswith("rodgen")
            ),
            key=lambda row: row["ns"],
        )
        forward = min(
            (
                row
                for row in robot["rows"]
                if row["kind"] == "forward" and not row["name"].startswith("rodgen")
            ),
            key=lambda row: row["ns"],
        )
        parts.append(
            f"- {name}, all solutions of a pose: {rows['rodgen: reverse']['ns']:.0f} ns; {reverse['name']} takes "
            f"{reverse['ratio']:.0f} times as long. Forward: {rows['rodgen: forward']['ns']:.0f} ns; {forward['name']} "
            f"takes {forward['ratio']:.0f} times as long."
        )
    return parts


def page(result: dict) -> str:
    lines = [
        "## Robots with six revolute joints\n",
        f"- poses a call: {result['n']:,} for rodgen, {result['few']:,} calls for the peers; rounds: "
        f"{result['rounds']}; share of one processor that the samples had: {result['share']:.0%}\n",
    ]
    for name, robot in result["robots"].items():
        lines += [
            f"### {name} (ssik: {robot['family']})\n",
            "| | ns a pose | spread | as a multiple of rodgen |",
            "| --- | ---: | ---: | ---: |",
        ]
        differ, apart = robot["counts"], robot["apart"]
        lines.insert(
            -2,
            f"All three find as many solutions in {result['few'] - differ} of {result['few']} poses; angles differ by "
            f"{apart:.0e} rad at most.\n",
        )
        for row in sorted(robot["rows"], key=lambda row: (row["kind"] == "forward", row["ns"])):
            shown = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
            lines.append(f"| {shown} | {row['ns']:,.0f} | {row['spread']:.0%} | {row['ratio']:.2f} |")
        lines.append("")
    return "\n".join(lines) + "\n"
