"""The equations' part of the page."""

from __future__ import annotations

from spatial.measure import ARITHMETIC, BANDWIDTH, OWN_CACHED, OWN_PAIR, OWN_STABLE, OWN_TRIG


def caveats() -> str:
    return (
        "- Equations of spatial mechanisms: the hand-written forms of pairs of equations do not rotate half-angles,\n"
        "  do not polish or prove anything, return no status, and decide by a fixed threshold which roots are real.\n"
        "  The arithmetic limit of the trigonometric equation is two arc tangents and a root, compiled with\n"
        "  `-ffast-math`.\n"
    )


def _by_name(part: dict) -> dict[str, dict]:
    return {row["name"]: row for row in part["rows"]}


def headline(result: dict) -> list[str]:
    trig, pair = _by_name(result["trig"]), _by_name(result["pair"])
    limit = max(trig[ARITHMETIC]["ratio"], trig[BANDWIDTH]["ratio"])
    which = "arithmetic" if trig[ARITHMETIC]["ratio"] == limit else "bandwidth"
    cached = trig[ARITHMETIC]["ratio"] / trig[OWN_CACHED]["ratio"]
    loop, stable = pair["NumPy, eigenvalues in a loop"], pair[OWN_STABLE]
    return [
        f"- A cos θ + B sin θ + D = 0: {trig[OWN_TRIG]['ns']:.1f} ns for both angles and a status, {limit:.2f} of what "
        f"the {which} allows; {cached:.2f} of the arithmetic where the arrays stay in the cache.",
        f"- Pairs of equations in two angles, all solutions with a proof: {pair[OWN_PAIR]['ns'] / 1000:.2f} µs. "
        f"NumPy's eigenvalues in a loop, without polish or proof, take {loop['ratio']:.0f} times as long, and rodgen "
        f"with eigenvalues for all rows {stable['ratio']:.0f} times.",
    ]


def page(result: dict) -> str:
    lines = ["## Equations of spatial mechanisms\n"]
    for title, key in (("A cos θ + B sin θ + D = 0", "trig"), ("Two equations in two angles", "pair")):
        part = result[key]
        share = f"share of one processor that the samples had: {part['share']:.0%}"
        lines += [f"### {title}\n", f"- rounds: {part['rounds']}; {share}"]
        if key == "pair":
            eigenvalues, pencils, roots = (
                f"{part['same'][name]:.1%}" for name in ("by_eigenvalues", "by_pencils", "by_roots")
            )
            lines.append(
                f"- as many solutions as rodgen: NumPy's eigenvalues in {eigenvalues}, SciPy's generalised ones in "
                f"{pencils}, roots of the octic in {roots} of the pairs; INCOMPLETE in rodgen: {part['incomplete']}"
            )
        lines += [
            "",
            "| | solved | ns each | spread | as a multiple of rodgen |",
            "| --- | ---: | ---: | ---: | ---: |",
        ]
        for row in part["rows"]:
            name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
            figures = f"{row['solved']:,} | {row['ns']:,.1f} | {row['spread']:.0%} | {row['ratio']:,.2f}"
            lines.append(f"| {name} | {figures} |")
        lines.append("")
    return "\n".join(lines) + "\n"
